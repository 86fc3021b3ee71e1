"""The studies: every case of every study, in one place."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from tse.impl.core import Config, SimConfig
from tse.impl.errors import UserError
from tse.impl.rows import DRIVES, MEASURES
from tselab.montecarlo import STUDIES, drives
from tselab.montecarlo.case import Case
from tselab.montecarlo.estimators import PEERS, VARIANTS, overrides

SPREADS = ("spread_cx_front", "spread_cy_front", "spread_cy_rear")
DEGREE = np.pi / 180


@dataclass(frozen=True)
class Study:
    """A list of cases, and how many runs of each are usual. The name may add estimators to all of them: "stress+ekf"."""

    name: str
    title: str
    runs: int
    cases: tuple[Case, ...]

    @property
    def base(self) -> str:
        return self.name.partition("+")[0]

    def case(self, name: str) -> Case:
        return next(c for c in self.cases if c.name == name)


def _waves(duration: float = 30.0, **more: object) -> partial:
    return partial(drives.square_waves, duration=duration, **more)


def _paper_prior(config: Config, sim: SimConfig, rng: np.random.Generator) -> Mapping[str, float]:
    return {"initial_vel_x": sim.speed + rng.standard_normal()}


NOMINAL = Case("nominal", "square waves, all as assumed", _waves())
NOISE_3X = Case("noise-3x", "sensor noise 3 times the setting", _waves(), sim={"noise": 3.0})
NOISE_THIRD = Case("noise-third", "sensor noise a third of the setting", _waves(), sim={"noise": 1 / 3})
LOW = Case("low-excitation", "slip 0.5 %, steering 0.005 rad", _waves(steer=drives.LOW_STEER, torque=None))
OUTLIERS = Case("outliers", "1 % of the inertial samples 10 sigma off", _waves(),
                corrupt=partial(drives.outliers, share=0.01, sigmas=10.0))  # fmt: skip
ROAD = Case("road-change", "all stiffness to 70 % at 20 s", _waves(40.0, road=((20.0, 0.7),)), events=(20.0,))

ROAD_03 = Case("road-0.3", "road to 30 % at 20 s and back at 40 s", _waves(60.0, road=((20.0, 0.3), (40.0, 1.0))),
               events=(20.0, 40.0), windows=((30.0, 39.99), (50.0, 60.0)))  # fmt: skip


def _stress() -> tuple[Case, ...]:
    imu_bias = {
        "true_bias_accel_x": 0.1,
        "true_bias_accel_y": 0.1,
        "true_bias_yaw_rate": 0.2 * DEGREE,
        "bias_walk": 1.0,
    }
    after_15 = ((drives.FIRST, drives.SLOTS_END),)
    pulses = ((drives.PULSES[0] - 5, drives.PULSES[0]), (drives.PULSES_END - 15, drives.PULSES_END))
    friction = {"sim": {"friction": 0.9}, "windows": pulses}
    slots = _waves(drives.SLOTS_END)
    return (
        NOMINAL,
        Case("paper-prior", "vx starts 1 m/s sd off", _waves(), draw=_paper_prior,
             config={"initial_vel_x_from_wheels": 0, "initial_vel_x_sd": 1.0}),
        Case("vy-start", "vy starts 10 sigma off", _waves(), sim={"vel_y": 1.0}),
        NOISE_3X,
        NOISE_THIRD,
        Case("wheel-noise-known", "wheel speeds noisy by 0.05 rad/s, in the settings", _waves(), sim={"wheel_speed_sd": 0.05},
             config={"wheel_noise_sd": 0.05}),
        Case("wheel-noise-unknown", "wheel speeds noisy by 0.05 rad/s, not in the settings", _waves(),
             sim={"wheel_speed_sd": 0.05}),
        OUTLIERS,
        Case("imu-bias", "biases of 0.1, 0.1 m/s2, 0.2 deg/s that walk", _waves(), sim=imu_bias),
        LOW,
        replace(LOW, name="low-excitation-250", title="torque 250 Nm, steering 0.005 rad",
                build=_waves(steer=drives.LOW_STEER, torque=250.0)),
        Case("highway", "5 min straight, then a lane change", drives.highway,
             windows=((drives.LANE_CHANGE[0] + drives.LANE_CHANGE[1], drives.HIGHWAY_END),)),
        replace(ROAD_03, windows=((30.0, 40.0), (50.0, 60.0))),
        *(Case(f"spread-{s:g}", f"stiffness scatters by {s:g} %", _waves(), sim=dict.fromkeys(SPREADS, s / 100))
          for s in (1, 5, 15)),
        *(Case(f"forgetting-{f:g}", f"forgetting {f:g}", _waves(), config={"forgetting": f}) for f in (0.98, 0.99, 0.995)),
        Case("forgetting-0.999", "forgetting 0.999, judged after two memories", _waves(40.0), config={"forgetting": 0.999},
             windows=((20.0, 40.0),)),
        *(Case(f"dropout-{c}", f"{c} missing for 0.1 .. 5 s", slots, corrupt=partial(drives.dropout, channel=c),
               windows=after_15) for c in (*DRIVES, *MEASURES)),
        *(Case(f"stuck-{c}", f"{c} stuck for 0.1 .. 5 s", slots, corrupt=partial(drives.stuck, channel=c),
               windows=after_15) for c in (*DRIVES, *MEASURES)),
        Case("stop-and-go", "standstill, launch, stop, four times", partial(drives.listed, name="stop-and-go", duration=80.0),
             windows=((20.0, 80.0),)),
        Case("reverse", "backwards from standstill, launch, square waves", drives.reverse,
             windows=((45.0, drives.REVERSE_END),)),
        Case("wheel-lock", "front wheels lock for 1 s, twice; against the secant", drives.wheel_lock, **friction),
        Case("wheel-spin", "front wheels spin for 1 s, twice; against the secant", drives.wheel_spin, **friction),
        Case("mass+10", "10 % heavier than assumed", _waves(), car={"mass": 1.1, "yaw_inertia": 1.1}),
        Case("mass-10", "10 % lighter than assumed", _waves(), car={"mass": 0.9, "yaw_inertia": 0.9}),
        *(Case(f"sample-{ms}ms", f"a row every {ms} ms", _waves(), config={"sample_time": ms / 1000})
          for ms in (5, 10, 20, 40)),
    )  # fmt: skip


SLOW, SLOW_START, SLOW_AFTER = 20.0, 20.0, 20.0  # s


def _regimes() -> tuple[Case, ...]:
    """What `_stress` does not have. Windows end before an event: its row already has another truth."""
    two = ("tse", "known")
    return (
        Case("road-0.7", "square waves, road to 70 % at 30 s", _waves(60.0, road=((30.0, 0.7),)), events=(30.0,),
             windows=((15.0, 29.99), (45.0, 60.0)), estimators=two),
        replace(ROAD_03, estimators=two),
        Case("slow-20", f"stiffness to 70 % within {SLOW:g} s",
             partial(drives.slow_change, start=SLOW_START, length=SLOW, level=0.7, after=SLOW_AFTER), events=(SLOW_START,),
             lasts=SLOW, windows=((SLOW_START, SLOW_START + SLOW + SLOW_AFTER),)),
    )  # fmt: skip


TEN_MINUTES = 600.0  # s


def _false_alarms() -> tuple[Case, ...]:
    known = Case("false-alarms", "ordinary driving", partial(drives.ordinary, duration=TEN_MINUTES),
                windows=((30.0, TEN_MINUTES),))  # fmt: skip
    return known, replace(
        known, name="false-alarms-held", title="ordinary driving; inputs held", sim={"hold_inputs": 1}
    )


def _with(estimators: tuple[str, ...], *cases: Case) -> tuple[Case, ...]:
    return tuple(replace(c, estimators=estimators) for c in cases)


def _paper() -> tuple[Case, ...]:
    """Sec. IV-A with inputs that change linearly between rows, and with inputs that are held; and a twin of the experiment of
    IV-B, with a prior that is wrong by 20 % on either side."""
    waves = Case(
        "iv-a",
        "square waves, road to 70 % at 30 s",
        partial(drives.paper_waves, duration=60.0, road=((30.0, 0.7),)),
        events=(30.0,),
        windows=((15.0, 29.99), (45.0, 60.0)),
        estimators=PAPER,
    )
    lanes = Case(
        "iv-b-20",
        "acceleration, double lane changes, prior 20 % too low",
        drives.paper_lanes,
        config=_prior(0.8),
        windows=((0.0, 48.0), (44.0, 48.0)),
        estimators=("paper", "robust", "tse"),
    )
    return (
        waves,
        replace(waves, name="iv-a-held", title=f"{waves.title}; inputs held", sim={"hold_inputs": 1}, config={"integration": 2}),
        lanes,
        replace(lanes, name="iv-b+20", title="the same, prior 20 % too high", config=_prior(1.2)),
    )  # fmt: skip


PAPER = ("printed", "robust", "tse")


def _prior(level: float) -> dict[str, float]:
    return {f"initial_{s}": level for s in ("cx_front", "cy_front", "cy_rear")} | {"forgetting": 0.995}


def _cases() -> dict[str, tuple[Case, ...]]:
    return {
        "accuracy": (Case("accuracy", "square waves, start at 70 %", _waves(40.0), windows=((20.0, 40.0),)),),
        "paper": _paper(),
        "robust": _with(("robust", *(f"robust-{name}" for name in VARIANTS)),
                        *(c for c in _paper() if c.name == "iv-a"), ROAD_03, NOISE_3X),
        "peers": _with(("tse", "robust", "robust-100", *PEERS), NOMINAL, LOW, NOISE_3X, NOISE_THIRD, ROAD),
        "stress": _stress(),
        "regimes": _regimes(),
        "false-alarms": _false_alarms(),
    }  # fmt: skip


def study(name: str, cases: tuple[str, ...] = ()) -> Study:
    """A study, or only some of its cases."""
    base, *beside = name.split("+")
    if base not in STUDIES:
        raise UserError(f"option --study: there is no study '{base}'; known: {', '.join(STUDIES)}")
    for other in beside:
        overrides(other)  # refuses what there is not
    every = [replace(c, estimators=tuple(dict.fromkeys((*c.estimators, *beside)))) for c in _cases()[base]]
    names = [c.name for c in every]
    if missing := [case for case in cases if case not in names]:
        raise UserError(f"option --cases: study {base} has no case '{missing[0]}'; known: {', '.join(names)}")
    runs, title = STUDIES[base]
    return Study(name, title, runs, tuple(c for c in every if not cases or c.name in cases))
