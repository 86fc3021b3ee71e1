"""Write small logs of a car that has an effect, by the replay of planned manoeuvres.

Steering and wheel speeds are those of the planning manoeuvres. The sensors' readings have
noise and biases. All is seeded.
"""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd

from tse.car.vehicle import read_vehicle
from tse.channels.log import read_log
from tse.gaps.catalogue import CatalogueParameter
from tse.gaps.drives import Candidate, make_candidates, prepare_candidate
from tse.gaps.problem import Problem, Rows
from tse.identify.data import COMPARED_CHANNELS, FitStretch, PreparedLog, prepare
from tse.library.core import Config, Replay
from tse.log.rows import MEASURES

CAR = """name = "small case"
driven_axle = "both"
mass = 1600.0
yaw_inertia = 2500.0
lf = 1.2
lr = 1.5
wheel_radius_front = 0.32
wheel_radius_rear = 0.32
longitudinal_stiffness_front = 180000.0
longitudinal_stiffness_rear = 160000.0
cornering_stiffness_front = 110000.0
cornering_stiffness_rear = 130000.0

[uncertainty]
mass_sd = 0.0
yaw_inertia_sd = 0.0
cg_sd = 0.0
steer_ratio_sd = 0.0
steer_offset_sd = 0.0
accel_y_scale_sd = 0.0
wheel_delay_sd = 0.0
accel_delay_sd = 0.0
relaxation_sd = 0.0
lean_sd = 0.0
gyro_scale_sd = 0.0
trail_sd = 0.0
roll_steer_sd = 0.0
wheel_radius_sd = 0.0
model_sd = 0.0
grade_sd = 0.0

[sensors]
accel_x_sd = 0.06
accel_y_sd = 0.06
yaw_rate_sd = 0.002
accel_x_bias_sd = 0.05
accel_y_bias_sd = 0.05
yaw_rate_bias_sd = 0.002
"""
DRIVES = {
    "sweep": "steering sine sweep 0.2 .. 3 Hz, 4 m/s2, at 20 m/s",
    "steps": "steering steps to 3 m/s2, at 10 m/s",
    "brakes": "brake and throttle of 3 m/s2 in turns of 3 m/s2, about 20 m/s",
}
STIFFNESS = {"cx_front": 1.1, "cy_front": 0.92, "cy_rear": 1.06}  # over the vehicle file's


def write_car(folder: Path) -> Path:
    path = folder / "car.toml"
    path.write_text(CAR, encoding="utf-8")
    return path


def make_problem(vehicle: Path, *logs: Path) -> Problem:
    """Return the problem of these logs, with the settings of the vehicle file."""
    config = Config.exact(read_vehicle(vehicle).values)
    return Problem([prepare(read_log(p), config) for p in logs], config)


def make_parameter(
    name: str = "x",
    typical: tuple[float, float] = (0.1, 0.3),
    limits: tuple[float, float] = (-1.0, 1.0),
    negligible: float = 0.01,
    **more: object,
) -> CatalogueParameter:
    """Return a parameter that is in no catalogue: a strength, unless stated."""
    rest = {"key": name, "strength": True, "unit": "1", "default": 0.0, "sign": 0, "text": ""} | more
    return CatalogueParameter(
        name=name,
        low=limits[0],
        high=limits[1],
        typical_low=typical[0],
        typical_high=typical[1],
        negligible=negligible,
        **rest,
    )


NOISE = {"accel_x": 0.1, "accel_y": 0.2, "yaw_rate": 0.01}  # of a row, in make_prepared()


def make_prepared(
    name: str = "log",
    rows: int = 300,
    speed: float = 20.0,
    steer: np.ndarray | float = 0.0,
    measured: dict[str, np.ndarray | float] | None = None,
    **more: object,
) -> PreparedLog:
    """Return a log with rows of 10 ms in blocks of 4, without a file.

    Wheels of 0.33 m roll at `speed`, and the first second is not compared. `measured`: of
    the sensors that the log has; each reads 0 unless stated.
    """
    time = 0.01 * np.arange(rows)
    wheels = dict.fromkeys(("wheel_speed_front", "wheel_speed_rear"), np.full(rows, speed / 0.33))
    sensors = dict.fromkeys(MEASURES, 0.0) if measured is None else measured
    rest = {"stretches": [FitStretch(0, rows, time >= 1.0)], "noise": NOISE} | more
    return PreparedLog(
        path=Path(f"{name}.csv"),
        time=time,
        inputs={"steer_angle": np.zeros(rows) + steer} | wheels,
        measured={c: np.zeros(rows) + x for c, x in sensors.items()},
        rows_per_block=4,
        distance=speed * time,
        **rest,
    )


def make_groups(*parts: tuple[str, list[float]]) -> tuple[SimpleNamespace, np.ndarray]:
    """Return a problem with a log for each pair of channel and residuals, and these."""
    sizes = [len(x) for _, x in parts]
    channel = np.repeat([COMPARED_CHANNELS.index(c) for c, _ in parts], sizes)
    group, time = (
        np.repeat(np.arange(len(parts)), sizes),
        np.concatenate([0.04 * np.arange(n) for n in sizes]),
    )
    rows = Rows(group, channel, time, np.arange(sum(sizes)), group)
    problem = SimpleNamespace(rows=rows, weight=np.ones(sum(sizes)), noise_energy=np.ones(sum(sizes)))
    problem.used = lambda: (
        (COMPARED_CHANNELS[c], (channel == c) & (problem.weight > 0)) for c in np.unique(channel)
    )
    return problem, np.concatenate([x for _, x in parts]).astype(float)


def find_candidate(config: Config, name: str) -> Candidate:
    return next(c for c in make_candidates(config) if c.name == name)


def write_log(
    path: Path,
    vehicle: Path,
    drive: str,
    effects: dict[str, float],
    seed: int,
    seconds: float = 24.0,
    **extra: float,
) -> Path:
    """Write one log of a car with these settings of effects.

    `drive`: a key of DRIVES, or a manoeuvre by its full name. `extra`: optional channels
    with the noise they have.
    """
    config = Config.exact(read_vehicle(vehicle).values)
    log = prepare_candidate(find_candidate(config, DRIVES.get(drive, drive)), config)[0]
    n = int(seconds / 0.01)
    rng = np.random.default_rng(seed)
    inputs = {k: x[:n] for k, x in log.inputs.items()}
    names = {"vehicle_speed": "vel_x"}
    replay = Replay((*MEASURES, *(names.get(e, e) for e in extra)), dt=np.full(n, 0.01), **inputs)
    out = replay.run(Config.exact(config.as_dict() | effects), **STIFFNESS)
    columns = {"time": log.time[:n]}
    columns |= {k: x + {"steer_angle": 2e-4}.get(k, 0.02) * rng.standard_normal(n) for k, x in inputs.items()}
    for c in MEASURES:
        bias = getattr(config, f"{c}_bias_sd") * rng.standard_normal()
        columns[c] = out[c] + bias + getattr(config, f"{c}_sd") * rng.standard_normal(n)
    for c, sd in extra.items():
        columns[c] = out[names.get(c, c)] + sd * rng.standard_normal(n)
    pd.DataFrame(columns).to_csv(path, index=False, float_format="%.9g")
    return path
