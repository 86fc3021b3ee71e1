"""The gap workflow: find where simulation and measurement disagree, which effect is
missing, and what adding it gains.

The modules of this folder are used by both subfolders: the catalogue of effects, the
comparison of simulation and measurement (problem.py), and fits (fit.py).
    infer    infer which effect or formula is missing, judged by held-out pieces of logs
    run      run the workflow, check and plan, and write their results
"""
