"""The gap workflow: find where simulation and measurement disagree, which effect is
missing, and what adding it gains.

This folder has what its two subfolders share: the catalogue of effects, the comparison
(problem.py) and its fit (fit.py).
    infer    infer which effect or formula is missing, judged by held-out pieces of logs
    run      run the workflow, check and plan, and write their results
"""
