"""Run the gap workflow, the check and the plan, and write their results: verdict, report,
pictures, tables, the improved vehicle file, and by how much this file improves the
estimates.
"""
