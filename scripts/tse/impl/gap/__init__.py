"""The gap workflow: where simulation and measurement disagree, which physical effect is missing, and what adding it brings.

Two rooms above what they share (identify/data -> problem: a simulation of all logs -> fit):
    infer     where it disagrees, what is left, what the logs excite; which effect or formula it is: logs that were held out judge
    run       workflow, check and plan, and what comes out: vehicle file, header, report, tables, pictures
"""
