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
from .model import (
    LATERAL_C,
    compute_load_factor,
    compute_magic_formula,
    compute_side_force_weight,
    compute_trail_weight,
)
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


def find_minimum(error: Callable[[float], float], low: float, high: float) -> float:
    """Return the place of the minimum of `error`, by golden section."""
    g = (np.sqrt(5) - 1) / 2
    for _ in range(60):
        a, b = high - g * (high - low), low + g * (high - low)
        low, high = (low, b) if error(a) < error(b) else (a, high)
    return 0.5 * (low + high)


# ---- what this model's components amount to in the catalogue's parameters


def compute_axle_load(car: Car) -> np.ndarray:
    """Return the static load, front and rear."""
    return car["mass"] * GRAVITY / (car["lf"] + car["lr"]) * np.array([car["lr"], car["lf"]])


def compute_axle_stiffness(car: Car) -> np.ndarray:
    return np.array([car["cornering_stiffness_front"], car["cornering_stiffness_rear"]])


def fit_brush(car: Car, most: float = 5.5) -> dict[str, float]:
    """Return 1/mu of the brush C a (1 - z + z^2/3) that fits the tyre best.

    It is fitted up to `most` m/s2 (or 0.85 of the peak), with C free as in any fit.
    """
    inverse = []
    for load, stiffness in zip(compute_axle_load(car), compute_axle_stiffness(car), strict=True):
        angle = np.linspace(0, 4 * car["mu"] * load / stiffness, 600)
        force = compute_magic_formula(angle, stiffness, car["mu"] * load, LATERAL_C, car["shape_y"])
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


def fit_combined_k(car: Car) -> dict[str, float]:
    slip = np.linspace(0, 0.035, 36)
    weight = compute_side_force_weight(slip, np.array(car["combined"]))
    return {
        "k": find_minimum(lambda k: float(((weight - 1 / np.sqrt(1 + k * slip**2)) ** 2).sum()), 0.0, 1000.0)
    }


def fit_lateral_transfer_k(car: Car) -> dict[str, float]:
    """Fit C(ay)/C(0) = 1 - k ay^2 by least squares up to 5 m/s2."""
    ay = np.linspace(0, 5.0, 26)
    share = np.array([car["roll_front"], 1 - car["roll_front"]])
    track = np.array([car["track_front"], car["track_rear"]])
    moved = (
        car["mass"] * car["h_lateral"] * share / track / (0.5 * compute_axle_load(car))
    )  # relative, per m/s2
    k = []
    for m in moved:
        both = 0.5 * (compute_load_factor(np.maximum(1 - m * ay, 0)) + compute_load_factor(1 + m * ay))
        k.append(float(car["load_sensitive"] * ((1 - both) * ay**2).sum() / (ay**4).sum()))
    return {"k": float(np.mean(k)), "k_front": k[0], "k_rear": k[1]}


def fit_longitudinal_transfer_k(car: Car) -> dict[str, float]:
    """Fit C(ax)/C(0) = 1 -+ k ax by least squares within 4 m/s2."""
    ax = np.linspace(-4.0, 4.0, 41)
    moved = car["mass"] * car["h_longitudinal"] / (car["lf"] + car["lr"]) / compute_axle_load(car)
    k = [
        float(
            car["load_sensitive"]
            * sign
            * ((compute_load_factor(1 + sign * m * ax) - 1) * ax).sum()
            / (ax**2).sum()
        )
        for m, sign in zip(moved, (-1, 1), strict=True)
    ]
    return {"k": float(np.mean(k)), "k_front": k[0], "k_rear": k[1]}


def compute_apparent_mode(car: Car, which: str) -> dict[str, float]:
    """Return the mode from the specific force at the centre of gravity to the angle.

    It is the mode of the axis with the car's mass swinging along: u'' (1 - c w^2) + 2 z w
    u' + w^2 u = w^2 f.
    """
    w, z = 2 * np.pi * car[f"f_{which}"], car[f"z_{which}"]
    free = np.sqrt(1 - car[f"{which}_coupling"] * w**2)
    return {"k": car[f"{which}_gain"], "f": w / free / (2 * np.pi), "zeta": z / free}


def fit_trail_tp(car: Car) -> dict[str, float]:
    """Fit moment = tp Fy by least squares up to 4 m/s2."""
    part = []
    for load, stiffness in zip(compute_axle_load(car), compute_axle_stiffness(car), strict=True):
        angle = np.linspace(0, 4.0 / GRAVITY * load / stiffness, 41)
        part.append(car["trail"] * (compute_trail_weight(angle) * angle**2).sum() / (angle**2).sum())
    return {"tp": float(np.mean(part))}


def fit_wind_w(car: Car) -> dict[str, float]:
    """Return w of the catalogue's side force 2.8 w sqrt(v^2 + w^2).

    It is the mean over 12 .. 32 m/s of this model's side force across the road.
    """
    side, head = car["wind_y"], car["wind_x"]
    found = []
    for v in np.linspace(12, 32, 11):
        flow = np.hypot(v - head, side)
        force = car["side_area"] * flow * abs(side) * (1 - 0.3 * (side / flow) ** 2)
        found.append(
            find_minimum(lambda w, v=v, f=force: abs(CATALOGUE_SIDE * w * np.hypot(v, w) - f), 0.0, 40.0)
        )
    return {
        "w": float(np.sign(side) * np.mean(found)),
        "arm": car["wind_arm"],
        "direction": float(np.arctan2(side, head)),
    }


def compute_warmth(time: np.ndarray, duration: float) -> np.ndarray:
    """Return the progress of warming tyres: exponential, from 0 to 1 over the log."""
    return (1 - np.exp(-np.clip(time / duration, 0, 1) / WARM_UP)) / (1 - np.exp(-1 / WARM_UP))


def fit_drift_kappa(car: Car) -> dict[str, float]:
    """Fit C = c (1 + kappa t/T) by least squares over the log, c free."""
    t = np.linspace(0, 1, 101)
    slope, start = np.polyfit(t, 1 + car["drift"] * compute_warmth(t, 1.0), 1)
    return {"kappa": float(slope / start)}


def fit_steering_lag_tau(car: Car) -> dict[str, float]:
    """Return tau of the first-order lag nearest to the second-order lag, 0.2 to 3 Hz."""
    s = 2j * np.pi * HERTZ
    w, z = 2 * car["steer_lag_z"] / car["steer_lag"], car["steer_lag_z"]
    h = w**2 / (s**2 + 2 * z * w * s + w**2)
    return {"tau": find_minimum(lambda tau: float((np.abs(h - 1 / (1 + s * tau)) ** 2).sum()), 1e-4, 0.5)}


def fit_imu_delay_tau(car: Car) -> dict[str, float]:
    """Return the pure delay nearest to the Bessel filter from 0.2 to 3 Hz."""
    s = 2j * np.pi * HERTZ * car["imu_delay"]
    h = BESSEL[1] / (s**2 + BESSEL[0] * s + BESSEL[1])
    s = 2j * np.pi * HERTZ
    return {"tau": find_minimum(lambda tau: float((np.abs(h - np.exp(-s * tau)) ** 2).sum()), 1e-4, 0.2)}


def fit_steering_eps(car: Car) -> dict[str, float]:
    angle = np.linspace(0, 0.08, 41)
    real = compute_curved_ratio(car, angle)
    return {"eps": float((real * angle).sum() / (angle**2).sum() - 1)}


def compute_curved_ratio(car: Car, angle: np.ndarray) -> np.ndarray:
    """Return the road-wheel angle of a steering gear whose ratio is wrong.

    The error decreases with the angle.
    """
    return angle * (1 + car["steer_ratio"] * (1 - STEER_CURVE * (angle / CURVE_ANGLE) ** 2))


def compute_rolling_fr(car: Car) -> dict[str, float]:
    v = np.linspace(10, 32, 23)
    return {"fr": float(car["rolling"] * np.mean(1 + 0.3 * (v / 40.0) ** 2))}


# ---- how each changes the car


def set_number(key: str, factor: float = 1.0) -> Callable[[Car, float, np.random.Generator], None]:
    def apply(car: Car, value: float, rng: np.random.Generator) -> None:
        car[key] = value * factor

    return apply


def scale_number(*keys: str) -> Callable[[Car, float, np.random.Generator], None]:
    def apply(car: Car, value: float, rng: np.random.Generator) -> None:
        for key in keys:
            car[key] *= 1 + value

    return apply


def read_number(name: str, key: str) -> Callable[[Car], dict[str, float]]:
    return lambda car: {name: car[key]}


def saturate_tyres(car: Car, value: float, rng: np.random.Generator) -> None:
    _solve(car, "mu", value, lambda c: fit_brush(c)["inv_mu"], 0.25, 8.0)


def combine_slips(car: Car, value: float, rng: np.random.Generator) -> None:
    _solve(car, "combined", value, lambda c: fit_combined_k(c)["k"], 0.5, 40.0)


def transfer_load(
    key: str, measure: Callable[[Car], dict[str, float]]
) -> Callable[[Car, float, np.random.Generator], None]:
    def apply(car: Car, value: float, rng: np.random.Generator) -> None:
        car["load_sensitive"] = 1.0
        _solve(car, key, value, lambda c: measure(c)["k"], 0.02, 3.0)

    return apply


def hang_body(which: str, arm: tuple[float, float], f: tuple[float, float], z: tuple[float, float]):
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


def relax_tyres(car: Car, value: float, rng: np.random.Generator) -> None:
    apart = rng.uniform(-0.15, 0.15)
    car["sigma_front"], car["sigma_rear"] = value * (1 + apart), value * (1 - apart)


def read_relaxation(car: Car) -> dict[str, float]:
    front, rear = car["sigma_front"], car["sigma_rear"]
    return {"sigma": 0.5 * (front + rear), "sigma_front": front, "sigma_rear": rear}


def lag_steering(car: Car, value: float, rng: np.random.Generator) -> None:
    car["steer_lag_z"] = rng.uniform(0.7, 0.95)
    _solve(car, "steer_lag", value, lambda c: fit_steering_lag_tau(c)["tau"], 1e-3, 0.4)


def misalign_imu(car: Car, value: float, rng: np.random.Generator) -> None:
    car["imu_yaw"] = value
    car["imu_roll"], car["imu_pitch"] = abs(value) / 3 * rng.uniform(-1, 1, 2)


def move_imu(car: Car, value: float, rng: np.random.Generator) -> None:
    car["imu_x"], car["imu_y"] = value, rng.uniform(-0.5, 0.5) * value


def shift_mass(car: Car, value: float, rng: np.random.Generator) -> None:
    car["lf"], car["lr"] = car["lf"] + value, car["lr"] - value


def add_wind(car: Car, value: float, rng: np.random.Generator) -> None:
    car["side_area"], car["wind_arm"] = rng.uniform(2.5, 3.1), rng.uniform(0.35, 0.55)
    slant = np.tan(rng.uniform(-0.35, 0.35))

    def sized(c: Car) -> float:
        c["wind_y"], c["wind_x"] = np.sign(value) * c["w"], slant * c["w"]
        return abs(fit_wind_w(c)["w"])

    sized_car = dict(car)
    _solve(sized_car, "w", abs(value), sized, 0.2, 60.0)
    car["wind_y"], car["wind_x"] = float(np.sign(value)) * sized_car["w"], float(slant) * sized_car["w"]


def add_conicity(car: Car, value: float, rng: np.random.Generator) -> None:
    car["conicity_front"], car["conicity_rear"] = value, value * rng.uniform(0.4, 1.0)


def add_roll_steer(car: Car, value: float, rng: np.random.Generator) -> None:
    """Steer the rear axle with the body's roll, also where the IMU does not roll."""
    car["rear_roll_steer"] = value * (car["roll_gain"] or rng.uniform(4.0, 5.0) * DEGREE / GRAVITY)


def add_bank(car: Car, value: float, rng: np.random.Generator) -> None:
    car["bank"], car["bank_wander"] = value, 0.35 * abs(value)


def read_cg(car: Car) -> dict[str, float]:
    return {"d": car["lf"] - NOMINAL["lf"]}


def read_relative(name: str, key: str) -> Callable[[Car], dict[str, float]]:
    return lambda car: {name: car[key] / NOMINAL[key] - 1}


def read_mode(which: str) -> Callable[[Car], dict[str, float]]:
    return lambda car: compute_apparent_mode(car, which)


SAME = "same form as the catalogue"
_ROWS = (
    Effect(
        id="aero_drag",
        parameter="kd",
        unit="kg/m",
        low=0.35,
        high=0.45,
        signed=False,
        apply=set_number("drag"),
        measure=read_number("kd", "drag"),
        how="kd v^2 of the flow the car feels",
    ),
    Effect(
        id="rolling_resistance",
        parameter="fr",
        unit="1",
        low=0.008,
        high=0.015,
        signed=False,
        apply=set_number("rolling"),
        measure=compute_rolling_fr,
        how="on each wheel's own load, 30 % more at 40 m/s; fr: mean over 10 .. 32 m/s",
    ),
    Effect(
        id="grade",
        parameter="rms",
        unit="rad",
        low=0.012,
        high=0.025,
        signed=False,
        apply=set_number("grade"),
        measure=read_number("rms", "grade"),
        how="six sines over distance, 120 .. 900 m, another road in each log; size: their rms",
    ),
    Effect(
        id="bank",
        parameter="mean",
        unit="rad",
        low=0.015,
        high=0.03,
        signed=True,
        apply=add_bank,
        measure=lambda c: {"mean": c["bank"], "rms_wander": c["bank_wander"]},
        how=(
            "mean, and six sines of 80 .. 500 m with an rms of 0.35 of it; "
            "the sign is that of the case, the road that of the log"
        ),
    ),
    Effect(
        id="body_roll",
        parameter="k",
        unit="rad s2/m",
        low=3 * DEGREE / GRAVITY,
        high=6 * DEGREE / GRAVITY,
        signed=False,
        apply=hang_body("roll", (0.30, 0.45), (1.2, 2.0), (0.2, 0.4)),
        measure=read_mode("roll"),
        how=(
            "sprung mass on its roll axis, inertia force included; k: angle per m/s2; "
            "f, zeta: of the mode as seen from accel_y"
        ),
    ),
    Effect(
        id="pitch_leak",
        parameter="k",
        unit="rad s2/m",
        low=1.5 * DEGREE / GRAVITY,
        high=3 * DEGREE / GRAVITY,
        signed=False,
        apply=hang_body("pitch", (0.10, 0.25), (1.4, 2.0), (0.25, 0.4)),
        measure=read_mode("pitch"),
        how="as body_roll, about the pitch axis",
    ),
    Effect(
        id="tyre_saturation",
        parameter="inv_mu",
        unit="1",
        low=0.9,
        high=1.0,
        signed=False,
        apply=saturate_tyres,
        measure=fit_brush,
        how=(
            "magic formula; inv_mu: brush with free stiffness fitted to the axle's curve up "
            "to 5.5 m/s2; inv_mu_peak: of its peak"
        ),
    ),
    Effect(
        id="combined_slip",
        parameter="k",
        unit="1",
        low=50,
        high=100,
        signed=False,
        apply=combine_slips,
        measure=fit_combined_k,
        how="cosine weighting; k: least squares of 1/sqrt(1 + k s^2) up to 3.5 % slip",
    ),
    Effect(
        id="relaxation",
        parameter="sigma",
        unit="m",
        low=0.3,
        high=0.7,
        signed=False,
        apply=relax_tyres,
        measure=read_relaxation,
        how="deflection of each contact patch, front and rear up to 15 % apart; sigma: their mean",
    ),
    Effect(
        id="lateral_load_transfer",
        parameter="k",
        unit="s4/m2",
        low=0.002,
        high=0.005,
        signed=False,
        apply=transfer_load("h_lateral", fit_lateral_transfer_k),
        measure=fit_lateral_transfer_k,
        how=(
            "each tyre's load and degressive stiffness, through the roll mode; "
            "k: least squares up to 5 m/s2, mean of the axles"
        ),
    ),
    Effect(
        id="longitudinal_load_transfer",
        parameter="k",
        unit="s2/m",
        low=0.02,
        high=0.04,
        signed=False,
        apply=transfer_load("h_longitudinal", fit_longitudinal_transfer_k),
        measure=fit_longitudinal_transfer_k,
        how=(
            "own load of the tyres, through the pitch mode; k: least squares within 4 m/s2, mean of the axles"
        ),
    ),
    Effect(
        id="steering_offset",
        parameter="delta0",
        unit="rad",
        low=0.1 * DEGREE,
        high=0.5 * DEGREE,
        signed=True,
        apply=set_number("steer_offset"),
        measure=read_number("delta0", "steer_offset"),
        how=SAME,
    ),
    Effect(
        id="steering_ratio",
        parameter="eps",
        unit="1",
        low=0.02,
        high=0.06,
        signed=True,
        apply=set_number("steer_ratio"),
        measure=fit_steering_eps,
        how="eps falls by 15 % to 0.25 rad; eps: least squares up to 0.08 rad",
    ),
    Effect(
        id="steering_lag",
        parameter="tau",
        unit="s",
        low=0.020,
        high=0.060,
        signed=False,
        apply=lag_steering,
        measure=fit_steering_lag_tau,
        how="second order, damping 0.7 .. 0.95; tau: nearest first-order lag from 0.2 to 3 Hz",
    ),
    Effect(
        id="steering_delay",
        parameter="tau",
        unit="s",
        low=0.010,
        high=0.040,
        signed=False,
        apply=set_number("steer_delay"),
        measure=read_number("tau", "steer_delay"),
        how=SAME,
    ),
    Effect(
        id="steering_compliance",
        parameter="c",
        unit="rad/N",
        low=0.2 * DEGREE / 100 * 0.04,
        high=0.5 * DEGREE / 100 * 0.04,
        signed=False,
        apply=set_number("compliance"),
        measure=lambda c: {
            "c": c["compliance"],
            "cyf_share": 1 / (1 + c["compliance"] * c["cornering_stiffness_front"]),
        },
        how=(
            "rack of 10 ms; c: per N of front side force, trail of 40 mm included; "
            "cyf_share: what Cyf reads instead"
        ),
    ),
    Effect(
        id="wheel_radius",
        parameter="eps",
        unit="1",
        low=0.010,
        high=0.025,
        signed=True,
        apply=scale_number("wheel_radius_front", "wheel_radius_rear"),
        measure=read_relative("eps", "wheel_radius_front"),
        how=SAME,
    ),
    Effect(
        id="imu_lever_arm",
        parameter="lx",
        unit="m",
        low=0.2,
        high=0.8,
        signed=True,
        apply=move_imu,
        measure=lambda c: {"lx": c["imu_x"], "ly": c["imu_y"]},
        how="exact; ly is up to half of lx",
    ),
    Effect(
        id="imu_scale_ax",
        parameter="s",
        unit="1",
        low=0.01,
        high=0.05,
        signed=True,
        apply=set_number("scale_x"),
        measure=read_number("s", "scale_x"),
        how=SAME,
    ),
    Effect(
        id="imu_scale_ay",
        parameter="s",
        unit="1",
        low=0.01,
        high=0.05,
        signed=True,
        apply=set_number("scale_y"),
        measure=read_number("s", "scale_y"),
        how=SAME,
    ),
    Effect(
        id="gyro_scale",
        parameter="s",
        unit="1",
        low=0.01,
        high=0.03,
        signed=True,
        apply=set_number("scale_r"),
        measure=read_number("s", "scale_r"),
        how=SAME,
    ),
    Effect(
        id="imu_misalignment",
        parameter="psi",
        unit="rad",
        low=1 * DEGREE,
        high=3 * DEGREE,
        signed=True,
        apply=misalign_imu,
        measure=read_number("psi", "imu_yaw"),
        how=(
            "exact rotation about three axes; psi > 0: axes turned left, ax reads ay sin(psi); "
            "roll and pitch up to a third of psi"
        ),
    ),
    Effect(
        id="imu_delay",
        parameter="tau",
        unit="s",
        low=0.010,
        high=0.030,
        signed=False,
        apply=set_number("imu_delay"),
        measure=fit_imu_delay_tau,
        how="two-pole Bessel filter; tau: nearest pure delay from 0.2 to 3 Hz",
    ),
    Effect(
        id="mass",
        parameter="eps",
        unit="1",
        low=0.10,
        high=0.20,
        signed=False,
        apply=scale_number("mass"),
        measure=read_relative("eps", "mass"),
        how="yaw inertia stays",
    ),
    Effect(
        id="yaw_inertia",
        parameter="eps",
        unit="1",
        low=0.10,
        high=0.20,
        signed=False,
        apply=scale_number("yaw_inertia"),
        measure=read_relative("eps", "yaw_inertia"),
        how=SAME,
    ),
    Effect(
        id="cg_shift",
        parameter="d",
        unit="m",
        low=0.05,
        high=0.15,
        signed=True,
        apply=shift_mass,
        measure=read_cg,
        how=("to the rear for d > 0; static loads follow; the IMU moves along unless imu_x = d is given too"),
    ),
    Effect(
        id="crosswind",
        parameter="w",
        unit="m/s",
        low=3,
        high=10,
        signed=True,
        apply=add_wind,
        measure=fit_wind_w,
        how=(
            "side force by the flow the car feels; "
            "w: that of 2.8 w sqrt(v^2 + w^2), mean over 12 .. 32 m/s; "
            "every log starts in the same direction, the wind 70 .. 110 degrees to it"
        ),
    ),
    Effect(
        id="conicity",
        parameter="front",
        unit="N",
        low=50,
        high=150,
        signed=True,
        apply=add_conicity,
        measure=lambda c: {"front": c["conicity_front"], "rear": c["conicity_rear"]},
        how="in proportion to wheel load; rear: 0.4 .. 1 of the front",
    ),
    Effect(
        id="rear_roll_steer",
        parameter="k",
        unit="rad/rad",
        low=0.03,
        high=0.1,
        signed=False,
        apply=add_roll_steer,
        measure=lambda c: {"k_per_mps2": c["rear_roll_steer"], "f": c["f_roll"], "zeta": c["z_roll"]},
        how=(
            "rear wheels steered by the roll mode; k: per rad of roll; "
            "k_per_mps2: per m/s2 of steady lateral acceleration"
        ),
    ),
    Effect(
        id="aligning_moment",
        parameter="tp",
        unit="m",
        low=0.020,
        high=0.040,
        signed=False,
        apply=lambda car, value, rng: _solve(car, "trail", value, lambda c: fit_trail_tp(c)["tp"], 1e-3, 0.3),
        measure=fit_trail_tp,
        how=("pneumatic trail that falls with slip angle; tp: least squares of the moment up to 4 m/s2"),
    ),
    Effect(
        id="longitudinal_relaxation",
        parameter="sigma_x",
        unit="m",
        low=0.1,
        high=0.4,
        signed=False,
        apply=set_number("sigma_x"),
        measure=read_number("sigma_x", "sigma_x"),
        how="deflection of each contact patch",
    ),
    Effect(
        id="stiffness_drift",
        parameter="kappa",
        unit="1",
        low=0.05,
        high=0.15,
        signed=True,
        apply=lambda car, value, rng: car.update(drift=value * compute_drift_per_kappa(value)),
        measure=fit_drift_kappa,
        how=(
            "exponential over each log, time constant T/1.5; "
            "kappa: least squares of c (1 + kappa t/T), c free"
        ),
    ),
    # outside the catalogue
    Effect(
        id="steering_play",
        parameter="half",
        unit="rad",
        low=0.05 * DEGREE,
        high=0.12 * DEGREE,
        signed=False,
        apply=set_number("play"),
        measure=read_number("half", "play"),
        how="backlash",
        outside=True,
    ),
    Effect(
        id="gust_train",
        parameter="peak",
        unit="N",
        low=500,
        high=1000,
        signed=True,
        apply=set_number("gust"),
        measure=read_number("peak", "gust"),
        how=("side force in gusts of 0.4 .. 1 s at random times, 0.45 m ahead of the centre of gravity"),
        outside=True,
    ),
    Effect(
        id="axle_resonance",
        parameter="gain",
        unit="1",
        low=0.08,
        high=0.16,
        signed=False,
        apply=lambda car, value, rng: car.update(resonance=value, f_resonance=rng.uniform(4.0, 5.5)),
        measure=read_number("gain", "resonance"),
        how=(
            "rear axle's side force of a 4 .. 5.5 Hz mode of damping 0.06 that road and "
            "lateral acceleration shake"
        ),
        outside=True,
    ),
    Effect(
        id="low_grip_patch",
        parameter="loss",
        unit="1",
        low=0.4,
        high=0.65,
        signed=False,
        apply=set_number("patch"),
        measure=read_number("loss", "patch"),
        how="share of stiffness lost on 25 m of road, once a log",
        outside=True,
    ),
    Effect(
        id="sticking_steering_sensor",
        parameter="step",
        unit="rad",
        low=0.1 * DEGREE,
        high=0.3 * DEGREE,
        signed=False,
        apply=set_number("stick"),
        measure=read_number("step", "stick"),
        how="the logged angle stays until it is off by the step",
        outside=True,
    ),
    Effect(
        id="speed_dependent_ratio",
        parameter="eps",
        unit="1",
        low=0.08,
        high=0.15,
        signed=True,
        apply=set_number("ratio_v"),
        measure=read_number("eps", "ratio_v"),
        how="angle times 1 + eps (v - 20)/20",
        outside=True,
    ),
    Effect(
        id="active_front_steering",
        parameter="gain",
        unit="s",
        low=0.06,
        high=0.12,
        signed=False,
        apply=set_number("active"),
        measure=read_number("gain", "active"),
        how=("angle less gain times the yaw rate's difference from that of the nominal car in steady state"),
        outside=True,
    ),
)


def compute_drift_per_kappa(value: float) -> float:
    """Return drift over kappa, which depends a little on kappa because c is free."""
    drift = value
    for _ in range(20):
        drift *= value / fit_drift_kappa({"drift": drift})["kappa"]
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
