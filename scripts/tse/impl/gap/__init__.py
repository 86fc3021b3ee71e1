"""The gap workflow: where simulation and measurement disagree, which physical effect is missing, and what adding it brings.

Three rooms around what they share (data -> problem: a simulation of all logs -> fit):
    localise  where it disagrees, what is left, what the logs excite
    infer     which effect or formula it is; logs that were held out judge
    export    what comes out: vehicle file, header, report, tables, pictures
The first two do not know each other, and neither knows the third; workflow.py, check.py and plan.py lead through them.
"""
