"""Simulate a manoeuvre: return a log like that of a car, and the true values."""

import sys
from dataclasses import dataclass

import numpy as np
import pandas as pd
from tqdm import tqdm

from tse.library.core import NOMINAL, SIM_OUTPUT, STIFFNESS, Config, SimConfig, Simulator, library
from tse.log.rows import ROAD_COLUMNS, list_columns
from tse.roads.road import Road
from tse.simulation.maneuvers import Maneuver

SPEED_GAIN = 2.0  # [1/s] gain of the speed controller: acceleration per error of the speed
BRAKE_FRONT = 0.6  # [1] share of the front axle in the brake force
HOLD_TORQUE = 300.0  # [Nm] brake torque of an axle at standstill
# [rad/s] sd of the noise that is added to simulated wheel speeds, as large as that of
# real ones. Without noise, values would repeat exactly, and the filter would take the
# channel for frozen, i.e. for a sensor that has stopped measuring
WHEEL_NOISE = 0.02
POSITIONS = {  # kind of coordinates -> (column of a log -> column of a road)
    "global": {"gnss_latitude": "latitude", "gnss_longitude": "longitude"},
    "local": {"ref_east": "x", "ref_north": "y"},
}
# inputs of the simulator that are copied from members of Maneuver with the same names;
# all but the first are also columns of TRUTH.csv
HISTORIES = (
    "steer_angle",
    "wheel_torque_front",
    "wheel_torque_rear",
    "brake_torque_front",
    "brake_torque_rear",
    "road_level",
)


@dataclass
class Simulation:
    """Contents of LOG.csv and TRUTH.csv: a log, and the true values in its rows."""

    log: pd.DataFrame
    truth: pd.DataFrame


def simulate(
    maneuver: Maneuver,
    config: Config,
    sim_config: SimConfig,
    driven_axle: str = "front",
    progress: bool = False,
    road: Road | None = None,
) -> Simulation:
    """Simulate a manoeuvre and return the contents of LOG.csv and TRUTH.csv.

    Parameters as in drive(). If `road` is given and has positions, the log has columns
    with positions of the car. They are the points of the road at the travelled distance,
    even if the steering of the manoeuvre does not follow the road.
    """
    inputs, outputs = drive(maneuver, config, sim_config, driven_axle, progress, road)
    log, truth = _make_log(maneuver.time, outputs), _make_truth(maneuver, inputs, outputs, config)
    if road is not None:
        s = compute_travelled(inputs, outputs)
        names = POSITIONS["global" if road.latitude is not None else "local"]
        places = {
            name: road.interpolate(column, road.distance[0] + s)
            for name, column in names.items()
            if road.x is not None
        }
        log = log.assign(**places)
        truth = truth.assign(true_distance=s, true_bank=inputs["bank"], true_grade=inputs["grade"])
    return Simulation(log, truth)


def compute_travelled(inputs: np.ndarray, outputs: np.ndarray) -> np.ndarray:
    """Return the distance [m] travelled up to each row."""
    return np.concatenate([[0.0], np.cumsum(outputs["true_vel_x"][:-1] * inputs["dt"][1:])])


def drive(
    maneuver: Maneuver,
    config: Config,
    sim_config: SimConfig,
    driven_axle: str = "front",
    progress: bool = False,
    road: Road | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Simulate a manoeuvre and return inputs and outputs of the simulator.

    Parameters
    ----------
    maneuver, config, sim_config
        Time histories of the driver's inputs, settings of the car, and settings of the
        simulator.
    driven_axle
        "front", "rear" or "both".
    progress
        True: show a progress bar.
    road
        Road whose bank and grade at the travelled distance are inputs of the simulator.
        Bank and grade are 0 where the road has no value, and beyond the end of the road.
        None: bank and grade are 0 everywhere.
    """
    sim_config.speed = maneuver.speed
    simulator = Simulator(config, sim_config)
    n = len(maneuver.time)
    inputs, outputs = simulator.inputs(n), simulator.outputs(n)
    inputs["dt"] = np.diff(maneuver.time, prepend=maneuver.time[0] - config.sample_time)
    for name in (*HISTORIES, "road_friction"):
        if (history := getattr(maneuver, name)) is not None:
            inputs[name] = history
    at = float(road.distance[0]) if road is not None else 0.0
    front = {"front": 1.0, "rear": 0.0, "both": 0.5}[driven_axle]
    for i in tqdm(range(n), unit="row", disable=not progress, file=sys.stderr, leave=False, desc="simulate"):
        if maneuver.target_speed is not None:
            now = outputs["true_vel_x"][i - 1] if i else maneuver.speed
            _follow_speed(inputs, i, maneuver, float(now), config, front)
        if road is not None:
            at += float(outputs["true_vel_x"][i - 1] * inputs["dt"][i]) if i else 0.0
            for name in ROAD_COLUMNS:
                inputs[name][i] = np.nan_to_num(road.interpolate(name, np.array([at]))[0])
        simulator.step_into(inputs, outputs, i)
    return inputs, outputs


def _follow_speed(
    inputs: np.ndarray, i: int, maneuver: Maneuver, now: float, config: Config, front: float
) -> None:
    """Set the drive and brake torques of row i, so that the car follows the target speed.

    The demanded acceleration is the time derivative of the target speed, plus SPEED_GAIN
    times the speed error (target minus present speed). `now`: present speed [m/s].
    `front`: share of the front axle in the drive force."""
    target = maneuver.target_speed
    ahead = min(i + 1, len(target) - 1)
    rate = (target[ahead] - target[i]) / (maneuver.time[ahead] - maneuver.time[i]) if ahead > i else 0.0
    force = config.mass * float(np.clip(rate + SPEED_GAIN * (target[i] - now), -6.0, 4.0))
    drive, brake = max(force, 0.0), max(-force, 0.0)
    hold = HOLD_TORQUE if target[i] < 0.05 and now < 0.5 else 0.0
    inputs["wheel_torque_front"][i] = drive * front * config.wheel_radius_front
    inputs["wheel_torque_rear"][i] = drive * (1 - front) * config.wheel_radius_rear
    inputs["brake_torque_front"][i] = brake * BRAKE_FRONT * config.wheel_radius_front + hold
    inputs["brake_torque_rear"][i] = brake * (1 - BRAKE_FRONT) * config.wheel_radius_rear + hold


def _make_log(time: np.ndarray, outputs: np.ndarray) -> pd.DataFrame:
    """Return the columns of a log from the outputs of the simulator."""
    return pd.DataFrame({"time": time, **{name: outputs[name] for name in list_columns()[1:]}})


def _make_truth(maneuver: Maneuver, inputs: np.ndarray, outputs: np.ndarray, config: Config) -> pd.DataFrame:
    """Return the contents of TRUTH.csv: quantities of the simulation that the log lacks.
    These are outputs of the simulator, e.g. true velocities and stiffnesses, and inputs
    of the simulator: wheel torques, brake torques, and road_level.

    Stiffnesses are in N (longitudinal) and N/rad (cornering)."""
    log_columns = set(list_columns())
    table = {"time": maneuver.time}
    for f in library().fields(SIM_OUTPUT):
        if f.name in log_columns:
            continue
        stiffness = next((s for s in STIFFNESS if f.name.endswith(s)), None)
        table[f.name] = outputs[f.name] * (getattr(config, NOMINAL[stiffness]) if stiffness else 1.0)
    for name in HISTORIES[1:]:
        table[name] = inputs[name]
    return pd.DataFrame(table)


# Key: reference column that add_references() adds to a log, so that the report draws it
# beside the estimate. Value: column of TRUTH.csv from which the values are copied
REFERENCE_COLUMNS = {
    "ref_vel_x": "true_vel_x",
    "ref_vel_y": "true_vel_y",
    "ref_yaw_rate": "true_yaw_rate",
    **{f"ref_{s}": f"true_{s}" for s in STIFFNESS},
}


def add_references(simulation: Simulation) -> pd.DataFrame:
    """Return the log with true values in columns ref_..., which the report draws."""
    return simulation.log.assign(**{ref: simulation.truth[true] for ref, true in REFERENCE_COLUMNS.items()})
