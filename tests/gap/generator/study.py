"""The cases of the study: every effect, in sizes, in pairs, and none."""

from __future__ import annotations

from .case import Spec
from .effects import CATALOGUE, OUTSIDE

SEEDS = (1, 2, 3)
CLEAN_SEEDS = tuple(range(101, 121))
PAIRS = (
    ("body_roll", "tyre_saturation"), ("body_roll", "steering_ratio"), ("tyre_saturation", "relaxation"),
    ("grade", "pitch_leak"), ("bank", "steering_lag"), ("lateral_load_transfer", "longitudinal_load_transfer"),
    ("gyro_scale", "imu_lever_arm"), ("wheel_radius", "combined_slip"), ("crosswind", "body_roll"),
    ("imu_misalignment", "yaw_inertia"), ("steering_offset", "relaxation"), ("longitudinal_load_transfer", "imu_scale_ay"),
)  # fmt: skip


def study() -> list[Spec]:
    """All cases. Names are unique: effect or clean, size, seed."""
    specs = [Spec(f"clean-{seed}", {}, seed) for seed in CLEAN_SEEDS]
    for size, label in ((1.0, "1x"), (0.5, "0.5x"), (2.0, "2x")):
        for key in CATALOGUE:
            specs += [Spec(f"{key}-{label}-{seed}", {key: 1.0}, seed, size) for seed in SEEDS]
    specs += [Spec(f"{key}-1x-{seed}", {key: 1.0}, seed) for key in OUTSIDE for seed in SEEDS]
    specs += [Spec(f"{a}+{b}-1x-{seed}", {a: 1.0, b: 1.0}, seed) for seed, (a, b) in enumerate(PAIRS, start=1)]
    return specs
