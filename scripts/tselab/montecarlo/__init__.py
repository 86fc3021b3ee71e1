"""Monte-Carlo studies: many seeds of many cases, every estimator on the same simulated
data.

case.py        what a case is; driving one of it            studies.py   manoeuvres, what goes wrong with a log, and all cases
estimators.py  what can be run on a drive                   scores.py    one drive and one estimate become a row of numbers
peers.py       Kalman filters beside it                     summary.py   rows become tables: of all studies, and of one
engine.py      all runs: processes, Dask, resuming          pictures.py  pictures, and the files that a study leaves
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
