"""Run `tselab gap`, `tselab gap check` and `tselab gap plan`, and write their results:
verdict, report, pictures, tables, and the improved vehicle file. Also compute by how much
the improved vehicle file improves the estimates.
"""
