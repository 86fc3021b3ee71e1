"""The gap workflow: find where simulation and measurement disagree, which effect is
missing, and what adding it gains.

An effect is a property of the car, a sensor or the road that the simulation can include,
such as roll steer or a delay. Two modules of this folder do the basic work: problem.py
compares simulation and measurement, and fit.py fits parameters. catalogue.py lists the
effects. The subfolders use these modules:
    infer    infer which effect or formula is missing, judged by held-out pieces of logs
    run      run `tselab gap`, `tselab gap check` and `tselab gap plan`; write the results
"""
