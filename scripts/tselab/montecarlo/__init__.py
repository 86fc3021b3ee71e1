"""Monte-Carlo studies: scores of estimators on simulated drives, whose true stiffness is
known.

A study is a list of cases. A case is a manoeuvre with settings of car, simulator and
estimator, and possibly faults of the log, such as lost values. A drive of each case is
simulated with each of many seeds of the random numbers. All estimators of the case run on
the same drives.

case.py        a case of a study, and the simulation of one of its drives
studies.py     manoeuvres, faults of logs, and the cases of all studies
estimators.py  the estimators that run on a drive
peers.py       extended Kalman filters for comparison
scores.py      scores of one estimator on one drive
summary.py     tables of the scores
engine.py      runs of a study, in processes or on a Dask cluster; resumes a stopped study
pictures.py    pictures and files of a study

The studies are part of the package, so that `tselab paper` also works without a checkout.
The commands `tselab montecarlo` and `tselab paper` are in tselab/studies.py.
"""

STUDIES = {  # name: (default number of runs of each case, title)
    "accuracy": (24, "Accuracy in the paper's set-up (Sec. IV-A)"),
    "paper": (
        200,
        "The paper's figures: its filter as printed, the same made robust, and the default filter",
    ),
    "robust": (16, "What keeps the paper's filter from diverging, and what else was tried"),
    "peers": (100, "tse compared with an EKF that has the true covariances"),
    "stress": (200, "What can go wrong, with the default settings"),
    "regimes": (100, "Changes of the road: detection, settling time, false alarms"),
    "false-alarms": (
        600,
        "Ordinary driving with exactly known parameters, ten minutes a run: every change is a false alarm",
    ),
}
