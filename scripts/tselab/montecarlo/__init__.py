"""Monte-Carlo studies: many seeds of many cases, every estimator on the same simulated
data.

case.py        a case of a study, and the simulation of a drive of it
studies.py     manoeuvres, errors of logs, and all cases
estimators.py  the estimators that run on a drive
peers.py       Kalman filters for comparison
scores.py      a row of numbers from a drive and its estimate
summary.py     tables from rows: of all studies, and of one
engine.py      all runs: processes, Dask, resuming
pictures.py    pictures and files of a study

They are part of the package, since `tselab paper` needs no checkout, and drive the rooms
of tse row by row. The commands in tselab/studies.py call them.
"""

STUDIES = {  # name: (usual number of runs, title)
    "accuracy": (24, "Accuracy in the paper's set-up (Sec. IV-A)"),
    "paper": (
        200,
        "The paper's figures: its filter as printed, the same made robust, and the default filter",
    ),
    "robust": (16, "What keeps the paper's filter from diverging, and what else was tried"),
    "peers": (100, "tse beside an EKF with the true covariances"),
    "stress": (200, "What can go wrong, with the default settings"),
    "regimes": (100, "Changes of the road: detected, followed, no false alarms"),
    "false-alarms": (
        600,
        "Ordinary driving of a car known exactly, in stretches of ten minutes: every change is a false alarm",
    ),
}
