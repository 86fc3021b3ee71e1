"""The gap workflow: where simulation and measurement disagree, which effect is missing,
what adding it gains.

Here is what the two rooms above share: data, the comparison (problem.py) and its fit.
    infer    which effect or formula it is, judged by pieces of logs that were held out
    run      workflow, check and plan, and its results: vehicle file, header, report,
    tables, pictures
"""
