"""The single-track model, linearised about straight driving at the speed of each moment: what a force or a moment does, where
that is asked of many at once (localise/where.py, localise/latent.py, infer/formula/respond.py). Else the library simulates."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from tselab.core import Config
from tselab.gap.data import SLOWEST


@dataclass(frozen=True)
class SingleTrack:
    """A car. States: vel_y, yaw rate, and what drives them."""

    mass: float
    inertia: float
    lf: float
    lr: float
    front: float  # N/rad, of the axle
    rear: float

    @classmethod
    def of(cls, c: Config, stiffness: Mapping[Any, float]) -> SingleTrack:
        """`stiffness`: over the settings', 1 where it is not given."""
        front = c.cornering_stiffness_front * stiffness.get("cy_front", 1.0)
        rear = c.cornering_stiffness_rear * stiffness.get("cy_rear", 1.0)
        return cls(c.mass, c.yaw_inertia, c.lf, c.lr, front, rear)

    def side(self, speed: Any) -> tuple[Any, Any]:
        """accel_y per m/s of vel_y and per rad/s of yaw rate. `speed`: m/s, one or many; below SLOWEST it is that."""
        mv = self.mass * np.maximum(speed, SLOWEST)
        return -(self.front + self.rear) / mv, -(self.lf * self.front - self.lr * self.rear) / mv

    def pushed(self, force: float, lever: float = 0.0, moment: float = 0.0) -> tuple[float, float]:
        """m/s2 and rad/s2 by a force [N] so far before the centre of gravity, and a moment [N m]."""
        return force / self.mass, (force * lever + moment) / self.inertia

    def fill(self, a: np.ndarray, speed: Any, across: Any, turning: Any) -> None:
        """d(vel_y, yaw rate)/dt as the first two rows of matrices (..., 3, 3). `across`, `turning`: m/s2 and rad/s2 by one of what
        drives them."""
        v = np.maximum(speed, SLOWEST)
        yv, yr = self.side(v)
        iv = self.inertia * v
        a[..., 0, 0], a[..., 0, 1], a[..., 0, 2] = yv, yr - v, across
        a[..., 1, 0] = -(self.lf * self.front - self.lr * self.rear) / iv
        a[..., 1, 1] = -(self.lf**2 * self.front + self.lr**2 * self.rear) / iv
        a[..., 1, 2] = turning
