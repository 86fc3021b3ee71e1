"""A case: a car with a hidden effect, its logs, its vehicle file and the truth."""

import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from .car import GRAVITY, NOMINAL, SENSORS, compute_understeer, draw_car
from .effects import CATALOGUE, OUTSIDE, compute_curved_ratio, compute_warmth, hide
from .manoeuvres import CORE, HOLD_OUT, SETTLE, SIXTH, Program, drive_program
from .model import LENGTHS, STEP, Drive, draw_profile, simulate
from .sensors import COLUMNS, apply_backlash, delay_signal, filter_second_order, make_log

BATCH = 72  # logs simulated at once: more cost memory, fewer cost time
Wish = float | dict[str, float]


@dataclass(frozen=True)
class Spec:
    """What a case is made from."""

    name: str
    effects: dict[str, Wish]
    seed: int
    size: float = 1.0
    manoeuvres: tuple[str, ...] | None = None  # None: the five of CORE and one of SIXTH
    hold_out: tuple[str, ...] = HOLD_OUT
    duration: float = 30.0
    noise: float = 1.0  # of all sensors; 0: none, and no bias


@dataclass
class Case:
    """A case, simulated. `logs` and `hold_out`: name -> column -> values."""

    spec: Spec
    car: dict[str, float]
    effects: list[dict]
    logs: dict[str, dict[str, np.ndarray]] = field(default_factory=dict)
    hold_out: dict[str, dict[str, np.ndarray]] = field(default_factory=dict)
    biases: dict[str, dict[str, float]] = field(default_factory=dict)

    @property
    def truth(self) -> dict:
        """What is hidden."""
        return {
            "name": self.spec.name,
            "seed": self.spec.seed,
            "size": self.spec.size,
            "effects": [e for e in self.effects if not e["outside"]],
            "outside": [e for e in self.effects if e["outside"]],
            "vehicle": {k: self.car[k] for k in NOMINAL},
            "biases": self.biases,
            "changed": {k: v for k, v in self.car.items() if k not in NOMINAL},
        }

    def vehicle_toml(self) -> str:
        """Return the vehicle file: nominal values, small angles, no hidden effects."""
        lines = [
            'name = "gap study car"',
            'driven_axle = "front"',
            f"wheelbase = {NOMINAL['lf'] + NOMINAL['lr']:.6g}",
        ]
        lines += [f"{k} = {v:.6g}" for k, v in NOMINAL.items()]
        lines += ["", "[sensors]", *(f"{k} = {v:.6g}" for k, v in SENSORS.items())]
        return "\n".join([*lines, "", "[effects.exact_kinematics]", "share = 0.0", ""])

    def write(self, folder: Path | str, optional: bool = False) -> Path:
        """Write log_*.csv, hold_out_*.csv, car.toml and truth.json.

        `optional`: with speed and torques.
        """
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        columns = COLUMNS if optional else COLUMNS[:7]
        for kind, logs in (("log", self.logs), ("hold_out", self.hold_out)):
            for name, log in logs.items():
                rows = np.column_stack([log[c] for c in columns])
                path = folder / f"{kind}_{name}.csv"
                np.savetxt(path, rows, fmt="%.7g", delimiter=",", header=",".join(columns), comments="")
        (folder / "car.toml").write_text(self.vehicle_toml(), encoding="utf-8")
        (folder / "truth.json").write_text(json.dumps(self.truth, indent=1) + "\n", encoding="utf-8")
        return folder


def make_stream(seed: int, what: str) -> np.random.Generator:
    """Return random numbers of the seed and the purpose, whatever else is drawn."""
    return np.random.default_rng([seed, *what.encode()])


def compute_careful_share(car: dict[str, float]) -> float:
    """Return the share of the usual steering angle that a careful driver uses.

    Limit of grip: 5.6 m/s2 is 0.7 of a peak of 0.82. Limit of oversteer: at 26 m/s no
    more than 1.25 times the usual gain.
    """
    turn = (NOMINAL["lf"] + NOMINAL["lr"]) / 26.0**2
    angle = max(0.0, turn + compute_understeer(car)) / (
        turn + compute_understeer(NOMINAL)
    )  # for the same turn, over the usual one
    return min(1.0, 0.7 * car["mu"] * GRAVITY / 5.6, max(0.4, 1.25 * angle))


def compute_road_wheel_angle(car: dict[str, float], wheel: np.ndarray) -> np.ndarray:
    """Return the road wheels' angle for the steering wheel's over its nominal ratio."""
    x = apply_backlash(wheel, car["play"]) if car["play"] > 0 else wheel
    if car["steer_lag"] > 0:
        x = filter_second_order(x, 2 * car["steer_lag_z"] / car["steer_lag"], car["steer_lag_z"])
    if car["steer_delay"] > 0:
        x = delay_signal(x, car["steer_delay"])
    return compute_curved_ratio(car, x) + car["steer_offset"]


def drive_of(car: dict[str, float], program: Program, rng: np.random.Generator) -> Drive:
    """Return a program driven with a car, on a road and in gusts drawn by `rng`."""
    n = len(program.steer)
    time = np.arange(n) * STEP - SETTLE
    gust = np.zeros(n)
    start = rng.uniform(1, 3)
    while start < time[-1] - 2:
        length = rng.uniform(0.4, 1.0)
        strength = rng.uniform(0.5, 1.0)
        gust += strength * np.sin(np.pi * np.clip((time - start) / length, 0, 1)) ** 2
        start += length + rng.uniform(0.5, 4.0)
    road = {
        "grade": draw_profile(rng, car["grade"], 0.0, LENGTHS["grade"]),
        "bank": draw_profile(rng, car["bank_wander"], car["bank"], LENGTHS["bank"]),
    }
    place = np.cumsum(program.speed) * STEP
    patch_at = place[np.searchsorted(time, rng.uniform(0.25, 0.75) * time[-1])]
    shake = 3.0 * rng.standard_normal(n) if car["resonance"] > 0 else np.zeros(n)
    return Drive(
        car, compute_road_wheel_angle(car, program.steer), program.speed, program.accel, program.coast, road,
        car["gust"] * gust, shake, compute_warmth(time, time[-1]), float(patch_at),
    )  # fmt: skip


def make_cases(specs: Iterable[Spec], batch: int = BATCH) -> Iterator[Case]:
    """Simulate cases, many logs at once, and yield them in order.

    The result does not depend on the batch.
    """
    waiting: list[tuple[Case, list]] = []
    for spec in specs:
        case, jobs = _prepare(spec)
        if waiting and (
            sum(len(j) for _, j in waiting) + len(jobs) > batch
            or spec.duration != waiting[0][0].spec.duration
        ):
            yield from _finish(waiting)
            waiting = []
        waiting.append((case, jobs))
    yield from _finish(waiting)


def make_case(
    effects: dict[str, Wish], seed: int, manoeuvres: tuple[str, ...] | None = None, size: float = 1.0, **more
) -> Case:
    """Simulate one case.

    `effects`: id -> size (1: typical) or {"value": parameter}. `more`: other fields of
    Spec.
    """
    return next(make_cases([Spec("+".join(effects) or "clean", effects, seed, size, manoeuvres, **more)]))


def _prepare(spec: Spec) -> tuple[Case, list]:
    car = draw_car(make_stream(spec.seed, "car"))
    truth = hide(
        car, spec.effects, make_stream(spec.seed, "effects " + " ".join(sorted(spec.effects))), spec.size
    )
    names = spec.manoeuvres or (*CORE, SIXTH[spec.seed % len(SIXTH)])
    jobs = []
    for kind, chosen in (("log", names), ("hold_out", spec.hold_out)):
        for name in chosen:
            program = drive_program(
                name, make_stream(spec.seed, f"{kind} {name}"), spec.duration, compute_careful_share(car)
            )
            jobs.append(
                (kind, name, program, drive_of(car, program, make_stream(spec.seed, f"{kind} {name} road")))
            )
    return Case(spec, car, truth), jobs


def _finish(waiting: list[tuple[Case, list]]) -> Iterator[Case]:
    drives = [drive for _, jobs in waiting for _, _, _, drive in jobs]
    if not drives:
        return
    motion, i = simulate(drives), 0
    for case, jobs in waiting:
        for kind, name, program, _ in jobs:
            noise = make_stream(case.spec.seed, f"{kind} {name} noise")
            log, bias = make_log(case.car, motion, i, program, noise, case.spec.noise)
            (case.logs if kind == "log" else case.hold_out)[name] = log
            case.biases[f"{kind}_{name}"] = bias
            i += 1
        yield case


# ---- the cases of the study: every effect, in sizes, in pairs, and none


SEEDS = (1, 2, 3)
CLEAN_SEEDS = tuple(range(101, 121))
PAIRS = (
    ("body_roll", "tyre_saturation"),
    ("body_roll", "steering_ratio"),
    ("tyre_saturation", "relaxation"),
    ("grade", "pitch_leak"),
    ("bank", "steering_lag"),
    ("lateral_load_transfer", "longitudinal_load_transfer"),
    ("gyro_scale", "imu_lever_arm"),
    ("wheel_radius", "combined_slip"),
    ("crosswind", "body_roll"),
    ("imu_misalignment", "yaw_inertia"),
    ("steering_offset", "relaxation"),
    ("longitudinal_load_transfer", "imu_scale_ay"),
)


def study() -> list[Spec]:
    """Return all cases; their unique names have effect or clean, size and seed."""
    specs = [Spec(f"clean-{seed}", {}, seed) for seed in CLEAN_SEEDS]
    for size, label in ((1.0, "1x"), (0.5, "0.5x"), (2.0, "2x")):
        for key in CATALOGUE:
            specs += [Spec(f"{key}-{label}-{seed}", {key: 1.0}, seed, size) for seed in SEEDS]
    specs += [Spec(f"{key}-1x-{seed}", {key: 1.0}, seed) for key in OUTSIDE for seed in SEEDS]
    specs += [
        Spec(f"{a}+{b}-1x-{seed}", {a: 1.0, b: 1.0}, seed) for seed, (a, b) in enumerate(PAIRS, start=1)
    ]
    return specs
