"""Naming schemes: what the signals of a car are called, in which units, with which signs, among which others. Drawn from a seed;
no word of it is from tselab."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from tests.cars.logs import make_logs
from tse.impl.logs.propose import propose
from tse.impl.logs.recording import Channel, Recording

DEG, G = 180 / np.pi, 9.80665
STEER = ["SteeringWheelAngle", "Steering_Wheel_Angle", "StrgWhlAng", "SWA", "LWI_Lenkradwinkel", "LRW", "Lenkradwinkel",
    "SteerWhlAng", "steeringAngleDeg",
         "STEER_ANGLE", "SAS_Angle", "steering_wheel_angle", "EPS_SteeringAngle", "str_ang", "StWhl_Ang", "AngleVolant",
         "delta_H", "DeltaSW", "Angolo_Sterzo",
         "LW_Winkel", "HandwheelAngle", "SteeringAngle", "StgAng", "Delta_SW", "lenkwinkel", "vehicle.steering.angle",
         "WheelAngle_Steering"]  # fmt: skip
YAW = ["YawRate", "Yaw_Rate", "ESP_Gierrate", "YAW_RATE", "GierRate", "yawRate", "VehYawRate", "psi_dot", "PsiPunkt_Gierrate",
    "omega_z", "gyro_z", "GyroZ", "wz",
       "Gierwinkelgeschwindigkeit", "YawVelocity", "angular_velocity.z", "IMU_RateZ", "VSA_YawRt", "Vitesse_Lacet", "dPsi",
       "Giergeschwindigkeit", "RotRateZ",
       "yaw_rate_dps", "Drehrate_z", "YawSpeed", "imu.gyr.z"]  # fmt: skip
AY = ["LatAccel", "Lateral_Acceleration", "ESP_Querbeschleunigung", "Querbeschl", "LAT_ACC", "ay", "AccelY", "acc_y",
    "VehLatAcc", "aLat", "linear_acceleration.y",
      "LatAcc", "a_quer", "Acc_Lat", "AccLateral", "IMU_AccelY", "LateralG", "a_y", "AyVeh", "Acceleration_Laterale",
      "LatAccelSensor", "imu.acc.y", "VehAccY"]  # fmt: skip
AX = ["LonAccel", "Longitudinal_Acceleration", "ESP_Laengsbeschl", "Laengsbeschl", "LONG_ACC", "ax", "AccelX", "acc_x",
    "VehLgtAcc", "aLon",
      "linear_acceleration.x", "LongAcc", "a_laengs", "Acc_Lon", "AccLongitudinal", "IMU_AccelX", "LongitudinalG", "a_x",
      "AxVeh", "Acceleration_Longitudinale",
      "LongAccelSensor", "imu.acc.x", "VehAccX"]  # fmt: skip
WHEELS = [  # what stands before, the four, what stands after
    ("WheelSpeed_", ("FL", "FR", "RL", "RR"), ""), ("WheelSpeed", ("FL", "FR", "RL", "RR"), ""), ("ESP_", ("VL", "VR", "HL",
    "HR"), "_Radgeschw"),
    ("Rad_", ("VL", "VR", "HL", "HR"), ""), ("v_Rad_", ("VL", "VR", "HL", "HR"), ""), ("WHEEL_SPEED_", ("FL", "FR", "RL", "RR"),
    ""),
    ("wheelSpeeds.", ("fl", "fr", "rl", "rr"), ""), ("WhlSpd", ("FrntLft", "FrntRght", "RrLft", "RrRght"), ""), ("WSS_", ("LF",
    "RF", "LR", "RR"), ""),
    ("WhlAngVel_", ("LF", "RF", "LR", "RR"), ""), ("n_", ("FL", "FR", "RL", "RR"), "_rpm"), ("wheel_speed_", ("front_left",
    "front_right", "rear_left", "rear_right"), ""),
    ("VitesseRoue_", ("AVG", "AVD", "ARG", "ARD"), ""), ("vWheel", ("FL", "FR", "RL", "RR"), ""), ("wheel.", ("left_front",
    "right_front", "left_rear", "right_rear"), ".speed"),
    ("Raddrehzahl_", ("vorne_links", "vorne_rechts", "hinten_links", "hinten_rechts"), ""), ("ABS_WS_", ("fl", "fr", "rl",
    "rr"), ""),
    ("omega_", ("fl", "fr", "rl", "rr"), ""), ("", ("fl", "fr", "rl", "rr"), "_wheel_speed"), ("WS", ("FL", "FR", "RL", "RR"),
    "_kmh"),
]  # fmt: skip
PREFIXES = ["", "", "", "ESP_01.", "CAN1.", "/vehicle/imu.", "Chassis.", "VDY_", "bus2::", "Sig_"]


@dataclass(frozen=True)
class Scheme:
    """What was drawn: by channel the true names, sign; and all columns with units as the log says them."""

    names: dict[str, tuple[str, ...]]
    sign: dict[str, float]
    si: dict[str, float]  # SI per unit of the log
    ratio: float
    columns: dict[str, np.ndarray]
    units: dict[str, str]


def draw(seed: int, clean: pd.DataFrame, radius: float, track: float, ratio: float) -> Scheme:
    """A scheme of a seed over a drive in SI units, as tse's own columns."""
    rng = np.random.default_rng(seed)

    def pick(of: list):
        return of[int(rng.integers(len(of)))]

    columns: dict[str, np.ndarray] = {}
    units: dict[str, str] = {}
    names: dict[str, tuple[str, ...]] = {}
    sign: dict[str, float] = {}
    si: dict[str, float] = {}
    told = rng.random() < 0.6  # does the log say units
    prefix = pick(PREFIXES)

    def put(channel: str, name: str, value: np.ndarray, unit: str, per: float, way: float) -> None:
        full = prefix + name
        while full in columns:
            full += "_2"
        columns[full], units[full] = way * value / per, unit if told and rng.random() < 0.95 else ""
        names[channel] = (full,)
        sign[channel], si[channel] = way, per

    flip = (
        1.0 if rng.random() < 0.7 else -1.0
    )  # a maker who has right positive has it in all of the lateral ones, mostly
    n = len(clean)
    deg = rng.random() < 0.8
    way = flip if rng.random() < 0.9 else -flip
    put(
        "steer_angle",
        pick(STEER),
        clean.steer_angle.to_numpy() * ratio,
        "deg" if deg else "rad",
        1 / DEG if deg else 1.0,
        way,
    )
    deg = rng.random() < 0.6
    put("yaw_rate", pick([y for y in YAW if deg or not y.endswith("dps")]), clean.yaw_rate.to_numpy(), pick(["deg/s",
    "°/s"]) if deg else "rad/s",
        1 / DEG if deg else 1.0, flip)  # fmt: skip
    in_g = rng.random() < 0.35
    at = int(rng.integers(len(AY)))
    for channel, name, x in (("accel_y", AY[at], clean.accel_y), ("accel_x", AX[at], clean.accel_x)):
        way = (flip if rng.random() < 0.9 else -flip) if channel == "accel_y" else (1.0 if rng.random() < 0.9 else -1.0)
        put(channel, name, x.to_numpy(), "g" if in_g else pick(["m/s2", "m/s^2", "m/s²"]), G if in_g else 1.0, way)
    before, places, after = pick(WHEELS)
    unit, per = (("rpm", np.pi / 30 * radius) if "rpm" in after or "zahl" in before else ("km/h", 1 / 3.6) if "kmh" in after else
                 pick([("km/h", 1 / 3.6), ("km/h", 1 / 3.6), ("rad/s", radius), ("m/s", 1.0), ("rpm",
                 np.pi / 30 * radius)]))  # fmt: skip
    for axle, sides in (("front", places[:2]), ("rear", places[2:])):
        mine = []
        for side, s in zip((-1, 1), sides, strict=True):
            speed = clean[f"wheel_speed_{axle}"].to_numpy() * radius + side * 0.5 * track * clean.yaw_rate.to_numpy()
            full = f"{prefix}{before}{s}{after}"
            columns[full], units[full] = speed / per, unit if told else ""
            mine.append(full)
        names[f"wheel_speed_{axle}"], si[f"wheel_speed_{axle}"] = tuple(mine), per
    _others(rng, clean, columns, units, prefix, told, n, radius, ratio)
    order = [str(k) for k in rng.permutation(list(columns))]
    return Scheme(names, sign, si, ratio, {k: columns[k] for k in order}, {k: units[k] for k in order})


def _others(rng, clean, columns, units, prefix, told, n, radius, ratio) -> None:
    """What else is on a bus, some of it much like what is sought."""
    v = clean.wheel_speed_rear.to_numpy() * radius
    slow = np.cumsum(rng.standard_normal(n)) * 0.01
    steer = clean.steer_angle.to_numpy() * ratio * DEG
    others = {
        "EngineSpeed": (800 + 90 * v + 20 * rng.standard_normal(n), "rpm"),
        "SteeringWheelSpeed": (np.gradient(steer) * 100, "deg/s"),
        "BrakePressure": (np.maximum(-clean.accel_x.to_numpy() * 12, 0), "bar"),
        "AccPedalPos": (np.maximum(clean.accel_x.to_numpy(), 0) * 20, "%"),
        "VehicleSpeed": (3.6 * v, "km/h"), "SteeringTorque": (0.05 * steer + 0.3 * rng.standard_normal(n), "Nm"),
        "OutsideTemp": (20 + slow, "degC"),
        "YawRate_Offset": (0.01 * np.ones(n) + 1e-5 * slow, "deg/s"), "Gear": (np.clip(np.round(v / 6), 1, 6), ""),
        "Counter": (np.arange(n) % 16.0, ""),
        "LatAccel_Quality": (np.ones(n), ""), "VerticalAccel": (9.81 + 0.2 * rng.standard_normal(n), "m/s2"),
        "RollRate": (2 * rng.standard_normal(n), "deg/s"),
        "PitchRate": (2 * rng.standard_normal(n), "deg/s"), "BatteryVoltage": (13.5 + 0.05 * rng.standard_normal(n), "V"),
        "SetSpeed": (np.full(n, 90.0) + (np.arange(n) > n / 2) * 10, "km/h"),
        "SteerAngleTarget": (steer + rng.standard_normal(n), "deg"),
    }  # fmt: skip
    for name in rng.permutation(list(others))[: int(rng.integers(3, len(others) + 1))]:
        value, unit = others[str(name)]
        if prefix + str(name) not in columns:
            columns[prefix + str(name)], units[prefix + str(name)] = value, unit if told else ""


def wrong(scheme: Scheme, proposal, radius: float) -> list[str]:
    """What a proposal has wrong: names, units by more than 1 %, signs, the ratio by more than 15 %."""
    from tse.impl.units import factor

    found = []
    for channel, names in scheme.names.items():
        g = proposal[channel]
        if g is None:
            found.append(f"{channel}: not found")
            continue
        if set(g.name) != set(names):
            found.append(f"{channel}: {g.name} for {names}")
            continue
        if len(names) == 2 and g.name != names:
            found.append(f"{channel}: left and right")
        wanted = {"steer_angle": "rad", "yaw_rate": "rad/s"}.get(channel, "m/s2" if "accel" in channel else "rad/s")
        per = factor(g.unit, wanted, radius)
        true = scheme.si[channel] / (radius if "wheel" in channel else 1.0)
        if per is None or abs(per / true - 1) > 0.01:
            found.append(f"{channel}: unit {g.unit}")
        if channel in scheme.sign and g.sign != scheme.sign[channel]:
            found.append(f"{channel}: sign")
        if channel == "steer_angle" and (g.ratio is None or abs(g.ratio / scheme.ratio - 1) > 0.15):
            found.append(f"steer_angle: ratio {g.ratio}")
    return found


# ---- `tselab signals` finds the right mapping in drawn naming schemes. Seeds below 1000 were looked at while it was made;
# those here were not, and if one fails, nothing is tuned to it: other ones are taken, and the rate is said anew.


FRESH = range(2000, 2020)
RIGHT = 19  # of 20
RADIUS, TRACK, RATIO = 0.31, 1.52, 14.8


@pytest.fixture(scope="module")
def clean():
    """Three minutes of a mountain road in a car that tse's model did not make."""
    return pd.DataFrame(make_logs("mountain", minutes=3, cars=1, seed=11)[0].log)


def test_the_right_mapping_in_19_of_20_fresh_schemes(clean):
    found = {}
    for seed in FRESH:
        scheme = draw(seed, clean, RADIUS, TRACK, RATIO)
        channels = {n: Channel(n, clean.time.to_numpy(), x, scheme.units[n]) for n, x in scheme.columns.items()}
        found[seed] = wrong(scheme, propose(Recording(Path("log"), "drawn", channels)), RADIUS)
    bad = {seed: w for seed, w in found.items() if w}
    assert len(FRESH) - len(bad) >= RIGHT, bad
