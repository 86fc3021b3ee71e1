"""Effects that can be hidden in the car: one row each, with sizes, change and true value.

`value` of an effect is the catalogue's parameter. Some effects have another form in this
model than in the catalogue. Then `measure` computes the parameter of the catalogue's form
that fits this model's component best, and `apply` sizes the component until this is
`value`.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .car import GRAVITY, NOMINAL, PARTS
from .model import LATERAL_C, load_factor, magic_formula, side_force_weight, trail_weight
from .sensors import BESSEL

Car = dict[str, float]
DEGREE = np.pi / 180
SPRUNG = 0.9  # share of the mass that rolls and pitches
CATALOGUE_SIDE = 2.8  # kg/m: half rho times side area times slope, as the catalogue has it
HERTZ = np.linspace(0.2, 3.0, 29)  # where steering has power
WARM_UP = 1 / 1.5  # time constant of the warming tyres over the length of the log
STEER_CURVE = 0.15  # how much less a wrong steering ratio is at 0.25 rad
CURVE_ANGLE = 0.25  # rad


@dataclass(frozen=True)
class Effect:
    """One physical effect. Sizes are drawn between `low` and `high` of `parameter`."""

    id: str
    parameter: str
    unit: str
    low: float
    high: float
    signed: bool
    apply: Callable[[Car, float, np.random.Generator], None]
    measure: Callable[[Car], dict[str, float]]
    how: str
    outside: bool = False


def _solve(
    car: Car, key: str, target: float, measure: Callable[[Car], float], low: float, high: float
) -> None:
    """Set car[key] such that measure(car) = target, by bisection on its logarithm.

    The value lies between low and high.
    """
    rising = measure({**car, key: high}) > measure({**car, key: low})
    for _ in range(45):
        middle = np.sqrt(low * high)
        if (measure({**car, key: middle}) < target) == rising:
            low = middle
        else:
            high = middle
    car[key] = float(np.sqrt(low * high))


def _best(error: Callable[[float], float], low: float, high: float) -> float:
    """Where error is least: golden section."""
    g = (np.sqrt(5) - 1) / 2
    for _ in range(60):
        a, b = high - g * (high - low), low + g * (high - low)
        low, high = (low, b) if error(a) < error(b) else (a, high)
    return 0.5 * (low + high)


# ---- what this model's components amount to in the catalogue's parameters


def axle_load(car: Car) -> np.ndarray:
    """Static load, front and rear."""
    return car["mass"] * GRAVITY / (car["lf"] + car["lr"]) * np.array([car["lr"], car["lf"]])


def axle_stiffness(car: Car) -> np.ndarray:
    return np.array([car["cornering_stiffness_front"], car["cornering_stiffness_rear"]])


def brush_of_magic_formula(car: Car, most: float = 5.5) -> dict[str, float]:
    """Return 1/mu of the brush C a (1 - z + z^2/3) that fits the tyre best.

    It is fitted up to `most` m/s2 (or 0.85 of the peak), with C free as in any fit.
    """
    inverse = []
    for load, stiffness in zip(axle_load(car), axle_stiffness(car), strict=True):
        angle = np.linspace(0, 4 * car["mu"] * load / stiffness, 600)
        force = magic_formula(angle, stiffness, car["mu"] * load, LATERAL_C, car["shape_y"])
        end = np.argmax(force > min(most / GRAVITY, 0.85 * car["mu"]) * load) or len(angle)
        angle, force = angle[:end], force[:end]
        c, d = (
            stiffness,
            stiffness**2 / (3 * car["mu"] * load),
        )  # force = c a - d a^2 + d^2/c a^3/3, d = c^2/(3 mu load)
        for _ in range(12):  # Gauss-Newton
            off = force - (c * angle - d * angle**2 + d**2 / c * angle**3 / 3)
            by_c, by_d = angle - (d / c) ** 2 * angle**3 / 3, -(angle**2) + 2 * d / c * angle**3 / 3
            step = np.linalg.lstsq(np.stack([by_c, by_d], 1) * [stiffness, d], off, rcond=None)[0] * [
                stiffness,
                d,
            ]
            c, d = c + step[0], max(d + step[1], 0.3 * d)
        inverse.append(float(3 * load * d / c**2))
    return {
        "inv_mu": float(np.mean(inverse)),
        "inv_mu_front": inverse[0],
        "inv_mu_rear": inverse[1],
        "inv_mu_peak": 1 / car["mu"],
    }


def combined_k(car: Car) -> dict[str, float]:
    slip = np.linspace(0, 0.035, 36)
    weight = side_force_weight(slip, np.array(car["combined"]))
    return {"k": _best(lambda k: float(((weight - 1 / np.sqrt(1 + k * slip**2)) ** 2).sum()), 0.0, 1000.0)}


def lateral_transfer_k(car: Car) -> dict[str, float]:
    """Least squares of C(ay)/C(0) = 1 - k ay^2 up to 5 m/s2."""
    ay = np.linspace(0, 5.0, 26)
    share = np.array([car["roll_front"], 1 - car["roll_front"]])
    track = np.array([car["track_front"], car["track_rear"]])
    moved = car["mass"] * car["h_lateral"] * share / track / (0.5 * axle_load(car))  # relative, per m/s2
    k = []
    for m in moved:
        both = 0.5 * (load_factor(np.maximum(1 - m * ay, 0)) + load_factor(1 + m * ay))
        k.append(float(car["load_sensitive"] * ((1 - both) * ay**2).sum() / (ay**4).sum()))
    return {"k": float(np.mean(k)), "k_front": k[0], "k_rear": k[1]}


def longitudinal_transfer_k(car: Car) -> dict[str, float]:
    """Least squares of C(ax)/C(0) = 1 -+ k ax within 4 m/s2."""
    ax = np.linspace(-4.0, 4.0, 41)
    moved = car["mass"] * car["h_longitudinal"] / (car["lf"] + car["lr"]) / axle_load(car)
    k = [
        float(
            car["load_sensitive"] * sign * ((load_factor(1 + sign * m * ax) - 1) * ax).sum() / (ax**2).sum()
        )
        for m, sign in zip(moved, (-1, 1), strict=True)
    ]
    return {"k": float(np.mean(k)), "k_front": k[0], "k_rear": k[1]}


def _apparent(car: Car, which: str) -> dict[str, float]:
    """Return the mode from the specific force at the centre of gravity to the angle.

    It is the mode of the axis with the car's mass swinging along: u'' (1 - c w^2) + 2 z w
    u' + w^2 u = w^2 f.
    """
    w, z = 2 * np.pi * car[f"f_{which}"], car[f"z_{which}"]
    free = np.sqrt(1 - car[f"{which}_coupling"] * w**2)
    return {"k": car[f"{which}_gain"], "f": w / free / (2 * np.pi), "zeta": z / free}


def trail_tp(car: Car) -> dict[str, float]:
    """Least squares of moment = tp Fy up to 4 m/s2."""
    part = []
    for load, stiffness in zip(axle_load(car), axle_stiffness(car), strict=True):
        angle = np.linspace(0, 4.0 / GRAVITY * load / stiffness, 41)
        part.append(car["trail"] * (trail_weight(angle) * angle**2).sum() / (angle**2).sum())
    return {"tp": float(np.mean(part))}


def wind_w(car: Car) -> dict[str, float]:
    """Return w of the catalogue's side force 2.8 w sqrt(v^2 + w^2).

    It is the mean over 12 .. 32 m/s of this model's side force across the road.
    """
    side, head = car["wind_y"], car["wind_x"]
    found = []
    for v in np.linspace(12, 32, 11):
        flow = np.hypot(v - head, side)
        force = car["side_area"] * flow * abs(side) * (1 - 0.3 * (side / flow) ** 2)
        found.append(_best(lambda w, v=v, f=force: abs(CATALOGUE_SIDE * w * np.hypot(v, w) - f), 0.0, 40.0))
    return {
        "w": float(np.sign(side) * np.mean(found)),
        "arm": car["wind_arm"],
        "direction": float(np.arctan2(side, head)),
    }


def warmth(time: np.ndarray, duration: float) -> np.ndarray:
    """Return the progress of warming tyres: exponential, from 0 to 1 over the log."""
    return (1 - np.exp(-np.clip(time / duration, 0, 1) / WARM_UP)) / (1 - np.exp(-1 / WARM_UP))


def drift_kappa(car: Car) -> dict[str, float]:
    """Least squares of C = c (1 + kappa t/T) over the log, c free."""
    t = np.linspace(0, 1, 101)
    slope, start = np.polyfit(t, 1 + car["drift"] * warmth(t, 1.0), 1)
    return {"kappa": float(slope / start)}


def steering_lag_tau(car: Car) -> dict[str, float]:
    """tau of the first-order lag nearest to the second-order one from 0.2 to 3 Hz."""
    s = 2j * np.pi * HERTZ
    w, z = 2 * car["steer_lag_z"] / car["steer_lag"], car["steer_lag_z"]
    h = w**2 / (s**2 + 2 * z * w * s + w**2)
    return {"tau": _best(lambda tau: float((np.abs(h - 1 / (1 + s * tau)) ** 2).sum()), 1e-4, 0.5)}


def imu_delay_tau(car: Car) -> dict[str, float]:
    """Pure delay nearest to the Bessel filter from 0.2 to 3 Hz."""
    s = 2j * np.pi * HERTZ * car["imu_delay"]
    h = BESSEL[1] / (s**2 + BESSEL[0] * s + BESSEL[1])
    s = 2j * np.pi * HERTZ
    return {"tau": _best(lambda tau: float((np.abs(h - np.exp(-s * tau)) ** 2).sum()), 1e-4, 0.2)}


def steering_eps(car: Car) -> dict[str, float]:
    angle = np.linspace(0, 0.08, 41)
    real = curved_ratio(car, angle)
    return {"eps": float((real * angle).sum() / (angle**2).sum() - 1)}


def curved_ratio(car: Car, angle: np.ndarray) -> np.ndarray:
    """Return the road-wheel angle of a steering gear whose ratio is wrong.

    The error decreases with the angle.
    """
    return angle * (1 + car["steer_ratio"] * (1 - STEER_CURVE * (angle / CURVE_ANGLE) ** 2))


def rolling_fr(car: Car) -> dict[str, float]:
    v = np.linspace(10, 32, 23)
    return {"fr": float(car["rolling"] * np.mean(1 + 0.3 * (v / 40.0) ** 2))}


# ---- how each changes the car


def _set(key: str, factor: float = 1.0) -> Callable[[Car, float, np.random.Generator], None]:
    def apply(car: Car, value: float, rng: np.random.Generator) -> None:
        car[key] = value * factor

    return apply


def _scaled(*keys: str) -> Callable[[Car, float, np.random.Generator], None]:
    def apply(car: Car, value: float, rng: np.random.Generator) -> None:
        for key in keys:
            car[key] *= 1 + value

    return apply


def _read(name: str, key: str) -> Callable[[Car], dict[str, float]]:
    return lambda car: {name: car[key]}


def _saturate(car: Car, value: float, rng: np.random.Generator) -> None:
    _solve(car, "mu", value, lambda c: brush_of_magic_formula(c)["inv_mu"], 0.25, 8.0)


def _combine(car: Car, value: float, rng: np.random.Generator) -> None:
    _solve(car, "combined", value, lambda c: combined_k(c)["k"], 0.5, 40.0)


def _transfer(
    key: str, measure: Callable[[Car], dict[str, float]]
) -> Callable[[Car, float, np.random.Generator], None]:
    def apply(car: Car, value: float, rng: np.random.Generator) -> None:
        car["load_sensitive"] = 1.0
        _solve(car, key, value, lambda c: measure(c)["k"], 0.02, 3.0)

    return apply


def _hang(which: str, arm: tuple[float, float], f: tuple[float, float], z: tuple[float, float]):
    def apply(car: Car, value: float, rng: np.random.Generator) -> None:
        """Set the mode by `f` and `z`, as it appears at the centre of gravity.

        A wider angle of the same car is a softer spring.
        """
        coupling = SPRUNG * rng.uniform(*arm) * value
        w = 2 * np.pi * rng.uniform(*f)
        free = 1 / np.sqrt(1 + coupling * w**2)  # sqrt(1 - coupling w_axis^2) with w_axis = w free
        car[f"{which}_gain"], car[f"{which}_coupling"] = value, coupling
        car[f"f_{which}"], car[f"z_{which}"] = w * free / (2 * np.pi), rng.uniform(*z) * free

    return apply


def _relax(car: Car, value: float, rng: np.random.Generator) -> None:
    apart = rng.uniform(-0.15, 0.15)
    car["sigma_front"], car["sigma_rear"] = value * (1 + apart), value * (1 - apart)


def _relaxation(car: Car) -> dict[str, float]:
    front, rear = car["sigma_front"], car["sigma_rear"]
    return {"sigma": 0.5 * (front + rear), "sigma_front": front, "sigma_rear": rear}


def _lag(car: Car, value: float, rng: np.random.Generator) -> None:
    car["steer_lag_z"] = rng.uniform(0.7, 0.95)
    _solve(car, "steer_lag", value, lambda c: steering_lag_tau(c)["tau"], 1e-3, 0.4)


def _misalign(car: Car, value: float, rng: np.random.Generator) -> None:
    car["imu_yaw"] = value
    car["imu_roll"], car["imu_pitch"] = abs(value) / 3 * rng.uniform(-1, 1, 2)


def _lever(car: Car, value: float, rng: np.random.Generator) -> None:
    car["imu_x"], car["imu_y"] = value, rng.uniform(-0.5, 0.5) * value


def _shift(car: Car, value: float, rng: np.random.Generator) -> None:
    car["lf"], car["lr"] = car["lf"] + value, car["lr"] - value


def _wind(car: Car, value: float, rng: np.random.Generator) -> None:
    car["side_area"], car["wind_arm"] = rng.uniform(2.5, 3.1), rng.uniform(0.35, 0.55)
    slant = np.tan(rng.uniform(-0.35, 0.35))

    def sized(c: Car) -> float:
        c["wind_y"], c["wind_x"] = np.sign(value) * c["w"], slant * c["w"]
        return abs(wind_w(c)["w"])

    sized_car = dict(car)
    _solve(sized_car, "w", abs(value), sized, 0.2, 60.0)
    car["wind_y"], car["wind_x"] = float(np.sign(value)) * sized_car["w"], float(slant) * sized_car["w"]


def _cone(car: Car, value: float, rng: np.random.Generator) -> None:
    car["conicity_front"], car["conicity_rear"] = value, value * rng.uniform(0.4, 1.0)


def _roll_steer(car: Car, value: float, rng: np.random.Generator) -> None:
    """Steer the rear axle with the body's roll, also where the IMU does not roll."""
    car["rear_roll_steer"] = value * (car["roll_gain"] or rng.uniform(4.0, 5.0) * DEGREE / GRAVITY)


def _slopes(car: Car, value: float, rng: np.random.Generator) -> None:
    car["bank"], car["bank_wander"] = value, 0.35 * abs(value)


def _cg(car: Car) -> dict[str, float]:
    return {"d": car["lf"] - NOMINAL["lf"]}


def _relative(name: str, key: str) -> Callable[[Car], dict[str, float]]:
    return lambda car: {name: car[key] / NOMINAL[key] - 1}


def _mode(which: str) -> Callable[[Car], dict[str, float]]:
    return lambda car: _apparent(car, which)


SAME = "same form as the catalogue"
_ROWS = (
    Effect("aero_drag", "kd", "kg/m", 0.35, 0.45, False, _set("drag"), _read("kd", "drag"), "kd v^2 of the flow the car feels"),
    Effect("rolling_resistance", "fr", "1", 0.008, 0.015, False, _set("rolling"), rolling_fr,
           "on each wheel's own load, 30 % more at 40 m/s; fr: mean over 10 .. 32 m/s"),
    Effect("grade", "rms", "rad", 0.012, 0.025, False, _set("grade"), _read("rms", "grade"),
           "six sines over distance, 120 .. 900 m, another road in each log; size: their rms"),
    Effect("bank", "mean", "rad", 0.015, 0.03, True, _slopes,
           lambda c: {"mean": c["bank"], "rms_wander": c["bank_wander"]},
           "mean, and six sines of 80 .. 500 m with an rms of 0.35 of it; the sign is that of the case, the road that of the log"),
    Effect("body_roll", "k", "rad s2/m", 3 * DEGREE / GRAVITY, 6 * DEGREE / GRAVITY, False,
           _hang("roll", (0.30, 0.45), (1.2, 2.0), (0.2, 0.4)), _mode("roll"),
           "sprung mass on its roll axis, inertia force included; k: angle per m/s2; f, zeta: of the mode as seen from accel_y"),
    Effect("pitch_leak", "k", "rad s2/m", 1.5 * DEGREE / GRAVITY, 3 * DEGREE / GRAVITY, False,
           _hang("pitch", (0.10, 0.25), (1.4, 2.0), (0.25, 0.4)), _mode("pitch"), "as body_roll, about the pitch axis"),
    Effect("tyre_saturation", "inv_mu", "1", 0.9, 1.0, False, _saturate, brush_of_magic_formula,
           "magic formula; inv_mu: brush with free stiffness fitted to the axle's curve up to 5.5 m/s2; inv_mu_peak: of its peak"),
    Effect("combined_slip", "k", "1", 50, 100, False, _combine, combined_k,
           "cosine weighting; k: least squares of 1/sqrt(1 + k s^2) up to 3.5 % slip"),
    Effect("relaxation", "sigma", "m", 0.3, 0.7, False, _relax, _relaxation,
           "deflection of each contact patch, front and rear up to 15 % apart; sigma: their mean"),
    Effect("lateral_load_transfer", "k", "s4/m2", 0.002, 0.005, False,
           _transfer("h_lateral", lateral_transfer_k), lateral_transfer_k,
           "each tyre's load and degressive stiffness, through the roll mode; k: least squares up to 5 m/s2, mean of the axles"),
    Effect("longitudinal_load_transfer", "k", "s2/m", 0.02, 0.04, False,
           _transfer("h_longitudinal", longitudinal_transfer_k), longitudinal_transfer_k,
           "own load of the tyres, through the pitch mode; k: least squares within 4 m/s2, mean of the axles"),
    Effect("steering_offset", "delta0", "rad", 0.1 * DEGREE, 0.5 * DEGREE, True, _set("steer_offset"),
           _read("delta0", "steer_offset"), SAME),
    Effect("steering_ratio", "eps", "1", 0.02, 0.06, True, _set("steer_ratio"), steering_eps,
           "eps falls by 15 % to 0.25 rad; eps: least squares up to 0.08 rad"),
    Effect("steering_lag", "tau", "s", 0.020, 0.060, False, _lag, steering_lag_tau,
           "second order, damping 0.7 .. 0.95; tau: nearest first-order lag from 0.2 to 3 Hz"),
    Effect("steering_delay", "tau", "s", 0.010, 0.040, False, _set("steer_delay"), _read("tau", "steer_delay"), SAME),
    Effect("steering_compliance", "c", "rad/N", 0.2 * DEGREE / 100 * 0.04, 0.5 * DEGREE / 100 * 0.04, False, _set("compliance"),
           lambda c: {"c": c["compliance"], "cyf_share": 1 / (1 + c["compliance"] * c["cornering_stiffness_front"])},
           "rack of 10 ms; c: per N of front side force, trail of 40 mm included; cyf_share: what Cyf reads instead"),
    Effect("wheel_radius", "eps", "1", 0.010, 0.025, True, _scaled("wheel_radius_front", "wheel_radius_rear"),
           _relative("eps", "wheel_radius_front"), SAME),
    Effect("imu_lever_arm", "lx", "m", 0.2, 0.8, True, _lever, lambda c: {"lx": c["imu_x"], "ly": c["imu_y"]},
           "exact; ly is up to half of lx"),
    Effect("imu_scale_ax", "s", "1", 0.01, 0.05, True, _set("scale_x"), _read("s", "scale_x"), SAME),
    Effect("imu_scale_ay", "s", "1", 0.01, 0.05, True, _set("scale_y"), _read("s", "scale_y"), SAME),
    Effect("gyro_scale", "s", "1", 0.01, 0.03, True, _set("scale_r"), _read("s", "scale_r"), SAME),
    Effect("imu_misalignment", "psi", "rad", 1 * DEGREE, 3 * DEGREE, True, _misalign, _read("psi", "imu_yaw"),
           "exact rotation about three axes; psi > 0: axes turned left, ax reads ay sin(psi); roll and pitch up to a third of psi"),
    Effect("imu_delay", "tau", "s", 0.010, 0.030, False, _set("imu_delay"), imu_delay_tau,
           "two-pole Bessel filter; tau: nearest pure delay from 0.2 to 3 Hz"),
    Effect("mass", "eps", "1", 0.10, 0.20, False, _scaled("mass"), _relative("eps", "mass"), "yaw inertia stays"),
    Effect("yaw_inertia", "eps", "1", 0.10, 0.20, False, _scaled("yaw_inertia"), _relative("eps", "yaw_inertia"), SAME),
    Effect("cg_shift", "d", "m", 0.05, 0.15, True, _shift, _cg,
           "to the rear for d > 0; static loads follow; the IMU moves along unless imu_x = d is given too"),
    Effect("crosswind", "w", "m/s", 3, 10, True, _wind, wind_w,
           "side force by the flow the car feels; w: that of 2.8 w sqrt(v^2 + w^2), mean over 12 .. 32 m/s; every log starts "
           "in the same direction, the wind 70 .. 110 degrees to it"),
    Effect("conicity", "front", "N", 50, 150, True, _cone,
           lambda c: {"front": c["conicity_front"], "rear": c["conicity_rear"]},
           "in proportion to wheel load; rear: 0.4 .. 1 of the front"),
    Effect("rear_roll_steer", "k", "rad/rad", 0.03, 0.1, False, _roll_steer,
           lambda c: {"k_per_mps2": c["rear_roll_steer"], "f": c["f_roll"], "zeta": c["z_roll"]},
           "rear wheels steered by the roll mode; k: per rad of roll; k_per_mps2: per m/s2 of steady lateral acceleration"),
    Effect("aligning_moment", "tp", "m", 0.020, 0.040, False,
           lambda car, value, rng: _solve(car, "trail", value, lambda c: trail_tp(c)["tp"], 1e-3, 0.3), trail_tp,
           "pneumatic trail that falls with slip angle; tp: least squares of the moment up to 4 m/s2"),
    Effect("longitudinal_relaxation", "sigma_x", "m", 0.1, 0.4, False, _set("sigma_x"), _read("sigma_x", "sigma_x"),
           "deflection of each contact patch"),
    Effect("stiffness_drift", "kappa", "1", 0.05, 0.15, True,
           lambda car, value, rng: car.update(drift=value * _per_kappa(value)), drift_kappa,
           "exponential over each log, time constant T/1.5; kappa: least squares of c (1 + kappa t/T), c free"),
    # outside the catalogue
    Effect("steering_play", "half", "rad", 0.05 * DEGREE, 0.12 * DEGREE, False, _set("play"), _read("half", "play"),
           "backlash", True),
    Effect("gust_train", "peak", "N", 500, 1000, True, _set("gust"), _read("peak", "gust"),
           "side force in gusts of 0.4 .. 1 s at random times, 0.45 m ahead of the centre of gravity", True),
    Effect("axle_resonance", "gain", "1", 0.08, 0.16, False,
           lambda car, value, rng: car.update(resonance=value, f_resonance=rng.uniform(4.0, 5.5)), _read("gain", "resonance"),
           "rear axle's side force of a 4 .. 5.5 Hz mode of damping 0.06 that road and lateral acceleration shake", True),
    Effect("low_grip_patch", "loss", "1", 0.4, 0.65, False, _set("patch"), _read("loss", "patch"),
           "share of stiffness lost on 25 m of road, once a log", True),
    Effect("sticking_steering_sensor", "step", "rad", 0.1 * DEGREE, 0.3 * DEGREE, False, _set("stick"), _read("step", "stick"),
           "the logged angle stays until it is off by the step", True),
    Effect("speed_dependent_ratio", "eps", "1", 0.08, 0.15, True, _set("ratio_v"), _read("eps", "ratio_v"),
           "angle times 1 + eps (v - 20)/20", True),
    Effect("active_front_steering", "gain", "s", 0.06, 0.12, False, _set("active"), _read("gain", "active"),
           "angle less gain times the yaw rate's difference from that of the nominal car in steady state", True),
)  # fmt: skip


def _per_kappa(value: float) -> float:
    """Drift over kappa; it depends a little on kappa because c is free."""
    drift = value
    for _ in range(20):
        drift *= value / drift_kappa({"drift": drift})["kappa"]
    return drift / value


EFFECTS: dict[str, Effect] = {row.id: row for row in _ROWS}
CATALOGUE = tuple(row.id for row in _ROWS if not row.outside)
OUTSIDE = tuple(row.id for row in _ROWS if row.outside)
_ORDER = {key: i for i, key in enumerate(EFFECTS)}


def hide(
    car: Car, effects: dict[str, float | dict[str, float]], rng: np.random.Generator, size: float = 1.0
) -> list[dict]:
    """Change the car by all effects, and return the truth of each.

    A number is a size: 1 is what the seed draws from the typical range, 2 twice that.
    {"value": x} gives the parameter itself. Other keys are numbers of the car (car.py),
    which are set last: {"value": 0.008, "roll_coupling": 0}.
    """
    asked = {}
    for key in sorted(effects, key=_ORDER.__getitem__):  # so that roll comes before what steers by it
        e, wish = EFFECTS[key], effects[key]
        typical = rng.uniform(e.low, e.high) * (rng.choice([-1.0, 1.0]) if e.signed else 1.0)
        given = isinstance(wish, dict)
        value = wish.get("value", typical * size) if given else typical * size * wish
        asked[key] = value = 1.0 if e.low == e.high else float(value)  # a switch has no size
        e.apply(car, value, rng)
        if given:
            extra = {k: v for k, v in wish.items() if k != "value"}
            if unknown := sorted(set(extra) - set(NOMINAL) - set(PARTS)):
                raise ValueError(f"{key}: {unknown} is no number of the car; see car.py")
            car.update(extra)
    truth = []
    for key, value in asked.items():
        e = EFFECTS[key]
        truth.append({
            "id": key, "parameter": e.parameter, "value": value, "unit": e.unit,
            "parameters": {e.parameter: value, **e.measure(car)}, "how": e.how,
            "typical": [e.low, e.high], "outside": e.outside,
        })  # fmt: skip
    return truth
