"""Naming schemes: names, units and signs of a car's signals among other signals.

They are drawn by a seed. Their words were not taken from tselab."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from conftest import tselab_here
from tests.cars.cache import make_logs_once
from tse.car.vehicle import read_vehicle
from tse.channels.log import read_log
from tse.channels.proposal import Proposal, propose
from tse.log.rows import Reading
from tse.log.units import unit_factor
from tse.readers.recording import Channel, Recording

DEG, G = 180 / np.pi, 9.80665


def split_names(text: str) -> list[str]:
    """Return the names in a text."""
    return text.split()


STEER = split_names("""
    SteeringWheelAngle Steering_Wheel_Angle StrgWhlAng SWA LWI_Lenkradwinkel LRW
    Lenkradwinkel SteerWhlAng steeringAngleDeg STEER_ANGLE SAS_Angle steering_wheel_angle
    EPS_SteeringAngle str_ang StWhl_Ang AngleVolant delta_H DeltaSW Angolo_Sterzo
    LW_Winkel HandwheelAngle SteeringAngle StgAng Delta_SW lenkwinkel
    vehicle.steering.angle WheelAngle_Steering
""")
YAW = split_names("""
    YawRate Yaw_Rate ESP_Gierrate YAW_RATE GierRate yawRate VehYawRate psi_dot
    PsiPunkt_Gierrate omega_z gyro_z GyroZ wz Gierwinkelgeschwindigkeit YawVelocity
    angular_velocity.z IMU_RateZ VSA_YawRt Vitesse_Lacet dPsi Giergeschwindigkeit RotRateZ
    yaw_rate_dps Drehrate_z YawSpeed imu.gyr.z
""")
AY = split_names("""
    LatAccel Lateral_Acceleration ESP_Querbeschleunigung Querbeschl LAT_ACC ay AccelY
    acc_y VehLatAcc aLat linear_acceleration.y LatAcc a_quer Acc_Lat AccLateral IMU_AccelY
    LateralG a_y AyVeh Acceleration_Laterale LatAccelSensor imu.acc.y VehAccY
""")
AX = split_names("""
    LonAccel Longitudinal_Acceleration ESP_Laengsbeschl Laengsbeschl LONG_ACC ax AccelX
    acc_x VehLgtAcc aLon linear_acceleration.x LongAcc a_laengs Acc_Lon AccLongitudinal
    IMU_AccelX LongitudinalG a_x AxVeh Acceleration_Longitudinale LongAccelSensor
    imu.acc.x VehAccX
""")
WHEELS = [  # text before the name of the wheel, names of the wheels, text after them
    ("WheelSpeed_", ("FL", "FR", "RL", "RR"), ""),
    ("WheelSpeed", ("FL", "FR", "RL", "RR"), ""),
    ("ESP_", ("VL", "VR", "HL", "HR"), "_Radgeschw"),
    ("Rad_", ("VL", "VR", "HL", "HR"), ""),
    ("v_Rad_", ("VL", "VR", "HL", "HR"), ""),
    ("WHEEL_SPEED_", ("FL", "FR", "RL", "RR"), ""),
    ("wheelSpeeds.", ("fl", "fr", "rl", "rr"), ""),
    ("WhlSpd", ("FrntLft", "FrntRght", "RrLft", "RrRght"), ""),
    ("WSS_", ("LF", "RF", "LR", "RR"), ""),
    ("WhlAngVel_", ("LF", "RF", "LR", "RR"), ""),
    ("n_", ("FL", "FR", "RL", "RR"), "_rpm"),
    ("wheel_speed_", ("front_left", "front_right", "rear_left", "rear_right"), ""),
    ("VitesseRoue_", ("AVG", "AVD", "ARG", "ARD"), ""),
    ("vWheel", ("FL", "FR", "RL", "RR"), ""),
    ("wheel.", ("left_front", "right_front", "left_rear", "right_rear"), ".speed"),
    ("Raddrehzahl_", ("vorne_links", "vorne_rechts", "hinten_links", "hinten_rechts"), ""),
    ("ABS_WS_", ("fl", "fr", "rl", "rr"), ""),
    ("omega_", ("fl", "fr", "rl", "rr"), ""),
    ("", ("fl", "fr", "rl", "rr"), "_wheel_speed"),
    ("WS", ("FL", "FR", "RL", "RR"), "_kmh"),
]
PREFIXES = ["", "", "", "ESP_01.", "CAN1.", "/vehicle/imu.", "Chassis.", "VDY_", "bus2::", "Sig_"]


@dataclass(frozen=True)
class Scheme:
    """A drawn scheme: names and signs by channel, and all columns with their units."""

    names: dict[str, tuple[str, ...]]
    sign: dict[str, float]
    si: dict[str, float]  # SI units per unit of the log
    ratio: float
    columns: dict[str, np.ndarray]
    units: dict[str, str]


def draw(seed: int, clean: pd.DataFrame, radius: float, track: float, ratio: float) -> Scheme:
    """Draw a scheme for a drive in SI units with tse's own columns."""
    rng = np.random.default_rng(seed)

    def pick(of: list):
        return of[int(rng.integers(len(of)))]

    columns: dict[str, np.ndarray] = {}
    units: dict[str, str] = {}
    names: dict[str, tuple[str, ...]] = {}
    sign: dict[str, float] = {}
    si: dict[str, float] = {}
    told = rng.random() < 0.6  # the log gives units
    prefix = pick(PREFIXES)

    def put(channel: str, name: str, value: np.ndarray, unit: str, per: float, way: float) -> None:
        full = prefix + name
        while full in columns:
            full += "_2"
        columns[full], units[full] = way * value / per, unit if told and rng.random() < 0.95 else ""
        names[channel] = (full,)
        sign[channel], si[channel] = way, per

    # mostly, a manufacturer has the same sign in all lateral signals
    flip = 1.0 if rng.random() < 0.7 else -1.0
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
    put(
        "yaw_rate",
        pick([y for y in YAW if deg or not y.endswith("dps")]),
        clean.yaw_rate.to_numpy(),
        pick(["deg/s", "°/s"]) if deg else "rad/s",
        1 / DEG if deg else 1.0,
        flip,
    )
    in_g = rng.random() < 0.35
    at = int(rng.integers(len(AY)))
    for channel, name, x in (("accel_y", AY[at], clean.accel_y), ("accel_x", AX[at], clean.accel_x)):
        way = (
            (flip if rng.random() < 0.9 else -flip)
            if channel == "accel_y"
            else (1.0 if rng.random() < 0.9 else -1.0)
        )
        put(
            channel,
            name,
            x.to_numpy(),
            "g" if in_g else pick(["m/s2", "m/s^2", "m/s²"]),
            G if in_g else 1.0,
            way,
        )
    before, places, after = pick(WHEELS)
    unit, per = (
        ("rpm", np.pi / 30 * radius)
        if "rpm" in after or "zahl" in before
        else ("km/h", 1 / 3.6)
        if "kmh" in after
        else pick(
            [
                ("km/h", 1 / 3.6),
                ("km/h", 1 / 3.6),
                ("rad/s", radius),
                ("m/s", 1.0),
                ("rpm", np.pi / 30 * radius),
            ]
        )
    )
    for axle, sides in (("front", places[:2]), ("rear", places[2:])):
        mine = []
        for side, s in zip((-1, 1), sides, strict=True):
            speed = (
                clean[f"wheel_speed_{axle}"].to_numpy() * radius
                + side * 0.5 * track * clean.yaw_rate.to_numpy()
            )
            full = f"{prefix}{before}{s}{after}"
            columns[full], units[full] = speed / per, unit if told else ""
            mine.append(full)
        names[f"wheel_speed_{axle}"], si[f"wheel_speed_{axle}"] = tuple(mine), per
    add_others(rng, clean, columns, units, prefix, told, n, radius, ratio)
    order = [str(k) for k in rng.permutation(list(columns))]
    return Scheme(names, sign, si, ratio, {k: columns[k] for k in order}, {k: units[k] for k in order})


def add_others(rng, clean, columns, units, prefix, told, n, radius, ratio) -> None:
    """Add other signals of a bus, some of them similar to the channels."""
    v = clean.wheel_speed_rear.to_numpy() * radius
    slow = np.cumsum(rng.standard_normal(n)) * 0.01
    steer = clean.steer_angle.to_numpy() * ratio * DEG
    others = {
        "EngineSpeed": (800 + 90 * v + 20 * rng.standard_normal(n), "rpm"),
        "SteeringWheelSpeed": (np.gradient(steer) * 100, "deg/s"),
        "BrakePressure": (np.maximum(-clean.accel_x.to_numpy() * 12, 0), "bar"),
        "AccPedalPos": (np.maximum(clean.accel_x.to_numpy(), 0) * 20, "%"),
        "VehicleSpeed": (3.6 * v, "km/h"),
        "SteeringTorque": (0.05 * steer + 0.3 * rng.standard_normal(n), "Nm"),
        "OutsideTemp": (20 + slow, "degC"),
        "YawRate_Offset": (0.01 * np.ones(n) + 1e-5 * slow, "deg/s"),
        "Gear": (np.clip(np.round(v / 6), 1, 6), ""),
        "Counter": (np.arange(n) % 16.0, ""),
        "LatAccel_Quality": (np.ones(n), ""),
        "VerticalAccel": (9.81 + 0.2 * rng.standard_normal(n), "m/s2"),
        "RollRate": (2 * rng.standard_normal(n), "deg/s"),
        "PitchRate": (2 * rng.standard_normal(n), "deg/s"),
        "BatteryVoltage": (13.5 + 0.05 * rng.standard_normal(n), "V"),
        "SetSpeed": (np.full(n, 90.0) + (np.arange(n) > n / 2) * 10, "km/h"),
        "SteerAngleTarget": (steer + rng.standard_normal(n), "deg"),
    }
    for name in rng.permutation(list(others))[: int(rng.integers(3, len(others) + 1))]:
        value, unit = others[str(name)]
        if prefix + str(name) not in columns:
            columns[prefix + str(name)], units[prefix + str(name)] = value, unit if told else ""


def list_errors(scheme: Scheme, proposal, radius: float) -> list[str]:
    """Return the errors of a proposal: names, signs, units (> 1 %), ratio (> 15 %)."""
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
        wanted = {"steer_angle": "rad", "yaw_rate": "rad/s"}.get(
            channel, "m/s2" if "accel" in channel else "rad/s"
        )
        per = unit_factor(g.unit, wanted, radius)
        true = scheme.si[channel] / (radius if "wheel" in channel else 1.0)
        if per is None or abs(per / true - 1) > 0.01:
            found.append(f"{channel}: unit {g.unit}")
        if channel in scheme.sign and g.sign != scheme.sign[channel]:
            found.append(f"{channel}: sign")
        if channel == "steer_angle" and (g.ratio is None or abs(g.ratio / scheme.ratio - 1) > 0.15):
            found.append(f"steer_angle: ratio {g.ratio}")
    return found


# ---- `tselab signals` maps drawn schemes correctly. Seeds below 1000 were inspected
# during the development; those here were not. If one fails, do not tune to it: take other
# seeds and state the rate again.


FRESH = range(2000, 2020)
RIGHT = 19  # of 20
RADIUS, TRACK, RATIO = 0.31, 1.52, 14.8


@pytest.fixture(scope="module")
def clean():
    """Return three minutes of a mountain road, not simulated by tse's model."""
    return pd.DataFrame(make_logs_once("mountain", minutes=3, cars=1, seed=11)[0].log)


@pytest.mark.slow
def test_the_right_mapping_in_19_of_20_fresh_schemes(clean):
    found = {}
    for seed in FRESH:
        scheme = draw(seed, clean, RADIUS, TRACK, RATIO)
        channels = {
            n: Channel(n, clean.time.to_numpy(), x, scheme.units[n]) for n, x in scheme.columns.items()
        }
        found[seed] = list_errors(scheme, propose(Recording(Path("log"), "drawn", channels)), RADIUS)
    bad = {seed: w for seed, w in found.items() if w}
    assert len(FRESH) - len(bad) >= RIGHT, bad


# ---- Basis of a proposed signals.toml: missing names, units by size, a turned IMU,
# exchanged sides, flags, counters, codes for "not available", fractions of an angle.
# Every run names what was not tested.

GEAR = 15.0
CAR = f"mass = 1600\nlf = 1.2\nlr = 1.5\nwheel_radius_front = {RADIUS}\nwheel_radius_rear = {RADIUS}\n"


@pytest.fixture(scope="module")
def drive() -> pd.DataFrame:
    """Return two minutes of a mountain road, wheels by the track of the car.

    tse's model did not simulate the car."""
    log = pd.DataFrame(make_logs_once("mountain", minutes=2, cars=1, seed=21)[0].log)
    for axle in ("front", "rear"):
        for side, way in (("left", -1), ("right", 1)):
            name = f"wheel_speed_{axle}_{side}"
            if name not in log:
                log[name] = log[f"wheel_speed_{axle}"] + way * 0.76 * log.yaw_rate / RADIUS
    return log


def propose_for(
    time: pd.Series, columns: dict[str, np.ndarray], units: dict[str, str] | None = None
) -> Proposal:
    made = {
        n: Channel(n, time.to_numpy(), np.asarray(x, float), (units or {}).get(n, ""))
        for n, x in columns.items()
    }
    return propose(Recording(Path("log"), "drawn", made))


def name_signals(log: pd.DataFrame, **more: np.ndarray) -> dict[str, np.ndarray]:
    wheels = {n: log[f"wheel_speed_{a}_{s}"] * RADIUS * 3.6
              for n, a, s in (("whl_fl_kmh", "front", "left"), ("whl_fr_kmh", "front", "right"),
                              ("whl_rl_kmh", "rear", "left"), ("whl_rr_kmh", "rear", "right"))}  # fmt: skip
    return {
        "steering_wheel_angle_deg": log.steer_angle * DEG * GEAR,
        **wheels,
        "accel_x": log.accel_x,
        "accel_y": log.accel_y,
        "yaw_rate_deg_s": log.yaw_rate * DEG,
        **more,
    }


@pytest.mark.slow
def test_signals_without_names_are_found_by_physics_and_said_to_be(drive):
    mph = {
        s: drive[f"wheel_speed_{s}"] * RADIUS * 2.23694
        for s in ("rear_right", "front_left", "rear_left", "front_right")
    }
    noise = np.random.default_rng(0).normal(size=len(drive))
    columns = [
        noise,
        -drive.accel_y,
        mph["rear_right"],
        mph["front_left"],
        drive.yaw_rate * DEG,
        mph["rear_left"],
        drive.steer_angle * DEG * GEAR,
        mph["front_right"],
        drive.accel_x,
    ]
    found = propose_for(drive.time, {f"ch{i:02d}": x for i, x in enumerate(columns)})
    assert (
        found["yaw_rate"].name == ("ch04",)
        and found["yaw_rate"].unit == "deg/s"
        and found["yaw_rate"].sign == 1
    )
    assert found["accel_y"].name == ("ch01",) and found["accel_y"].sign == -1
    assert found["steer_angle"].name == ("ch06",) and found["accel_x"].name == ("ch08",)
    # the left wheels stand first
    assert found["wheel_speed_front"].name[0] == "ch03" and found["wheel_speed_rear"].name[0] == "ch05"
    assert found["wheel_speed_front"].unit == found["wheel_speed_rear"].unit == "mph"
    for c in ("wheel_speed_front", "wheel_speed_rear", "accel_x", "accel_y", "yaw_rate"):
        assert found[c].unsure and found[c].confidence != "sure", c


@pytest.mark.slow
def test_what_the_log_cannot_test_is_unsure(drive):
    straight = drive.iloc[:400].assign(
        yaw_rate=1e-4 * np.random.default_rng(1).normal(size=400), steer_angle=0.05
    )
    noise = np.random.default_rng(2).normal(size=(4, 400))
    wheels = {f"whl_{p}_kmh": 60.0 + 0.01 * x for p, x in zip(("fl", "fr", "rl", "rr"), noise, strict=True)}
    found = propose_for(straight.time, {**name_signals(straight), **wheels, "accel_y": straight.accel_y})
    assert "sure" not in {found[c].confidence for c in ("accel_y", "yaw_rate", "steer_angle") if found[c]}
    assert all(found[c].unsure for c in ("accel_y", "yaw_rate", "steer_angle") if found[c])


@pytest.mark.parametrize(
    ("unit", "si", "per"),
    [
        ("kN", "m/s", None),
        ("kN", "rad/s", None),
        ("kn", "m/s", 0.514444),
        ("KM/H", "m/s", 1 / 3.6),
        ("S", "s", 1.0),
        ("Hz", "rad/s", 2 * np.pi),
        ("rev/s", "rad/s", 2 * np.pi),
        ("1/s", "rad/s", 1.0),
        ("%", "rad", None),
        ("%", "1", 0.01),
        ("mrad", "rad", 1e-3),
        ("turn", "rad", 2 * np.pi),
        ("-", "rad", 1.0),
    ],
)
def test_a_unit_is_what_its_spelling_means(unit, si, per):
    assert unit_factor(unit, si, 0.3) == (per if per is None else pytest.approx(per, rel=1e-5))


@pytest.mark.slow
def test_a_unit_with_which_no_car_could_turn_is_not_proposed(drive):
    found = propose_for(
        drive.time[:500],
        {"wz": 15 * np.sin(np.arange(500) / 80), "yaw_rate": 14 * np.sin(np.arange(500) / 70)},
    )
    assert found["yaw_rate"].unit == "deg/s" and found["yaw_rate"].confidence == "unsure"


@pytest.mark.slow
def test_the_unit_of_an_angle_that_cannot_be_tested_is_by_its_size(drive):
    for size, unit, ratio in ((0.05, "rad", False), (60.0, "deg", True)):
        found = propose_for(drive.time[:500], {"steer_angle": size * np.sin(np.arange(500) / 80)})[
            "steer_angle"
        ]
        assert (found.unit, bool(found.ratio)) == (unit, ratio) and "unit" in found.unsure


@pytest.mark.slow
@pytest.mark.parametrize("turned", [25.0, -15.0, 0.0])
def test_an_imu_that_is_mounted_turned_is_said_with_its_angle(drive, turned):
    c, s = np.cos(turned / DEG), np.sin(turned / DEG)
    more = {
        "accel_x": c * drive.accel_x + s * drive.accel_y,
        "accel_y": c * drive.accel_y - s * drive.accel_x,
    }
    said = [w for w in propose_for(drive.time, name_signals(drive, **more)).warnings if "mounted turned" in w]
    if turned:
        angle = float(said[0].split("turned by ")[1].split()[0])
        assert angle == pytest.approx(turned, abs=4)
    else:
        assert not said


@pytest.mark.slow
def test_left_and_right_exchanged_or_axes_of_sae_is_said_to_be_either(drive):
    log = name_signals(drive)
    exchanged = {
        **log,
        "whl_fl_kmh": log["whl_fr_kmh"],
        "whl_fr_kmh": log["whl_fl_kmh"],
        "whl_rl_kmh": log["whl_rr_kmh"],
        "whl_rr_kmh": log["whl_rl_kmh"],
    }
    found = propose_for(drive.time, exchanged)
    assert any("left and right wheels are exchanged" in w for w in found.warnings)
    assert all(
        found[c].confidence == "likely" and found[c].unsure for c in ("steer_angle", "accel_y", "yaw_rate")
    )
    right = propose_for(drive.time, log)
    assert not any("exchanged" in w for w in right.warnings) and right["steer_angle"].confidence == "sure"


@pytest.mark.slow
def test_flags_counters_and_numbers_for_no_value(drive):
    """1 % of the angles are the largest number of the field, and a flag marks them.

    The yaw rate has such numbers, too, without a flag."""
    rng = np.random.default_rng(3)
    bad = rng.random(len(drive)) < 0.01
    angle = np.where(bad, 819.1, drive.steer_angle * DEG * GEAR)
    log = name_signals(drive)
    bus = {
        "LWI.LWI_Lenkradwinkel": angle,
        "LWI.LWI_QBit_Lenkradwinkel": bad,
        "LWI.LWI_BZ": np.arange(len(drive)) % 16,
        "LWI.LWI_Reserve": rng.integers(0, 2, len(drive)),
        "ESP.Gierrate": np.where(rng.random(len(drive)) < 0.005, 163.8, drive.yaw_rate * DEG),
        "ESP.Querbeschleunigung": drive.accel_y,
        **{n: x for n, x in log.items() if n.startswith("whl") or n == "accel_x"},
    }
    units = {"LWI.LWI_Lenkradwinkel": "deg", "ESP.Gierrate": "deg/s", "ESP.Querbeschleunigung": "m/s2"}
    found = propose_for(drive.time, bus, units)
    steer = found["steer_angle"]
    assert steer.name == ("LWI.LWI_Lenkradwinkel",) and steer.confidence == "sure"
    assert steer.valid == ("LWI.LWI_QBit_Lenkradwinkel", 0.0) and steer.counter == ("LWI.LWI_BZ", 16)
    assert found["yaw_rate"].name == ("ESP.Gierrate",) and any(
        "163.8" in f for f in found["yaw_rate"].figures
    )
    assert found["yaw_rate"].valid is None and found["yaw_rate"].counter is None


@pytest.mark.slow
def test_the_rest_of_a_coarse_angle_is_added(drive, tmp_path):
    """Toyota sends steps of 1.5 degrees, and the rest in steps of 0.1 degrees."""
    angle = drive.steer_angle * DEG * GEAR
    coarse = np.round(angle / 1.5) * 1.5
    log = {
        **name_signals(drive),
        "steering_wheel_angle_deg": coarse,
        "steer_fraction": np.round((angle - coarse) / 0.1) * 0.1,
    }
    found = propose_for(drive.time, log)["steer_angle"]
    assert found.add == "steer_fraction"
    pd.DataFrame({"time": drive.time, **log}).to_csv(tmp_path / "log.csv", index=False)
    (tmp_path / "car.toml").write_text(f"{CAR}steering_ratio = {GEAR}\n")
    done = tselab_here("signals", "log.csv", "--vehicle", "car.toml", "--write", "signals.toml", cwd=tmp_path)
    assert done.code == 0 and 'add = "steer_fraction"' in (tmp_path / "signals.toml").read_text()

    how = Reading(tmp_path / "signals.toml", car=read_vehicle(tmp_path / "car.toml"))
    read = read_log(tmp_path / "log.csv", reading=how)
    off = read.data["steer_angle"].to_numpy() * DEG * GEAR - np.interp(read.time, drive.time, angle)
    assert np.nanpercentile(np.abs(off), 95) < 0.2  # steps of 1.5 alone leave up to 0.75


@pytest.mark.slow
def test_what_is_unsure_is_said_by_every_run_until_it_is_taken_out(drive, tmp_path):
    pd.DataFrame(
        {
            "time": drive.time,
            **{c: drive[c] for c in ("steer_angle", "wheel_speed_front", "wheel_speed_rear", "accel_x")},
            "ay": drive.accel_y,
            "wz": drive.yaw_rate,
        }
    ).to_csv(tmp_path / "log.csv", index=False)
    names = {
        "steer_angle": "steer_angle",
        "wheel_speed_front": "wheel_speed_front",
        "wheel_speed_rear": "wheel_speed_rear",
        "accel_x": "accel_x",
        "accel_y": "ay",
        "yaw_rate": "wz",
    }
    sure = "".join(f'[signals.{c}]\nname = "{n}"\n' for c, n in names.items())
    (tmp_path / "car.toml").write_text(CAR)
    run = ("log.csv", "--vehicle", "car.toml", "--signals", "s.toml")
    (tmp_path / "s.toml").write_text(sure + 'unsure = "its sign"\n')
    done = tselab_here("estimate", "--verbose", *run, "--table", "t.parquet", cwd=tmp_path)
    assert "warning: guessed, not tested: yaw_rate (its sign): check them in s.toml" in done.err
    assert pd.read_parquet(tmp_path / "t.parquet").warnings.str.contains("its sign").all()
    strict = tselab_here("estimate", "--verbose", *run, "--strict", cwd=tmp_path)
    assert strict.code == 2 and "yaw_rate (its sign)" in strict.err
    assert "guessed, not tested" in tselab_here("gap", "check", *run, cwd=tmp_path).out
    (tmp_path / "s.toml").write_text(sure)
    assert "guessed" not in tselab_here("estimate", "--verbose", *run, "--strict", cwd=tmp_path).err
    (tmp_path / "s.toml").write_text(sure + "unsure = true\n")
    wrong = tselab_here("estimate", "--verbose", *run, cwd=tmp_path)
    assert wrong.code == 2 and "unsure: must state what is unsure" in wrong.err
