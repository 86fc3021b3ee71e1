"""The workflow, check and plan; and what people and programs get: pictures, the report,
tables, the improved vehicle file, and what the estimator gains by it.
"""
