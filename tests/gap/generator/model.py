"""Equations of motion of a car on four wheels; arrays are (states or wheels, cars).

Axes are those of ISO 8855. Wheels are in the order front left, front right, rear left,
rear right. The body's roll and pitch are normalised second-order modes u: in a steady
turn u_roll is the lateral and u_pitch the longitudinal specific force. Angles are gains
times u. With `exact` = 0 the kinematics are those of small angles. With 1 they are
trigonometric, with the wheels' own velocities and steering angles.
"""

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np

from .car import GRAVITY, NOMINAL, RIGID, compute_understeer

STEP = 0.001  # s
DRIVE_LAG, BRAKE_LAG, RACK_LAG = 0.08, 0.04, 0.01  # s
ENGINE_DRAG = -60.0  # N m on the driven wheels when coasting
SPEED_GAIN = 1.2  # 1/s, driver
RESONANCE_DAMPING = 0.06
SINGLE = (
    "vx",
    "vy",
    "r",
    "psi",
    "s",
    "roll",
    "droll",
    "pitch",
    "dpitch",
    "drive",
    "brake",
    "rack",
    "q",
    "dq",
)
STATES = (
    len(SINGLE) + 12
)  # and per wheel: rotation rate, lateral and longitudinal deflection over relaxation length
OUTPUTS = ("fx", "fy", "yaw_acc", "r", "roll", "pitch")  # at every step, for the IMU
SLOW = ("vx", "vy", "r", "psi", "s", "wf", "wr", "tf", "tr", "steer")  # at every sample


# ---- tyres of one wheel each: Pacejka, Tire and Vehicle Dynamics, ch. 4


LATERAL_C, LONGITUDINAL_C = 1.35, 1.6  # shape factors of the magic formula
COMBINED_C = 1.1  # of the weighting of side force by longitudinal slip
TRAIL_B, TRAIL_C = 8.0, 1.1  # of the pneumatic trail
DEGRESSIVE = 0.5  # static load over the load at which cornering stiffness is largest


def compute_magic_formula(
    slip: np.ndarray, stiffness: np.ndarray, peak: np.ndarray, c: float, e: np.ndarray
) -> np.ndarray:
    """Return the force at a slip; `stiffness`: its slope at zero, `peak`: its maximum."""
    x = stiffness / (c * peak) * slip
    return peak * np.sin(c * np.arctan(x - e * (x - np.arctan(x))))


def compute_load_factor(load: np.ndarray, ratio: float = DEGRESSIVE) -> np.ndarray:
    """Return the cornering stiffness relative to that at static load.

    `load` is relative to static. The law: sin(2 atan(Fz/Fz_max)), normalised.
    """
    return load * (1 + ratio**2) / (1 + (ratio * load) ** 2)


def compute_side_force_weight(slip: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the share of the side force that remains at a longitudinal slip."""
    return np.cos(COMBINED_C * np.arctan(b * slip))


def compute_trail_weight(slip_angle: np.ndarray) -> np.ndarray:
    """Return the pneumatic trail over that at zero slip angle."""
    return np.cos(TRAIL_C * np.arctan(TRAIL_B * slip_angle))


# ---- slope of the road over distance: sums of sines with random phases, hence smooth and
# without a period in a log


WAVES = 6
LENGTHS = {"grade": (120.0, 900.0), "bank": (80.0, 500.0)}  # m, wave lengths


def draw_profile(
    rng: np.random.Generator, rms: float, mean: float, lengths: tuple[float, float]
) -> np.ndarray:
    """Return rows of amplitude, wave number and phase of one profile.

    The constant is a wave of wave number 0.
    """
    amplitude = rng.uniform(0.5, 1.5, WAVES)
    amplitude *= rms * np.sqrt(2) / np.sqrt((amplitude**2).sum())
    number = 2 * np.pi / np.exp(rng.uniform(*np.log(lengths), WAVES))
    phase = rng.uniform(0, 2 * np.pi, WAVES)
    return np.array([[*amplitude, mean], [*number, 0.0], [*phase, 0.5 * np.pi]])


def compute_slope(waves: np.ndarray, s: np.ndarray) -> np.ndarray:
    """Return the angle of the slope at distance s, rad. `waves`: (3, waves, cars)."""
    return (waves[0] * np.sin(waves[1] * s + waves[2])).sum(0)


# ---- motion


@dataclass
class Drive:
    """What drives one car: a car, its road, and signals at every step."""

    car: dict[str, float]
    steer: np.ndarray  # rad, road wheel, after the steering system
    speed: np.ndarray  # m/s, wanted
    accel: np.ndarray  # m/s2, wanted
    coast: np.ndarray  # 1: foot off the pedals
    road: dict[str, np.ndarray]  # profiles: rows amplitude, wave number, phase
    gust: np.ndarray  # N, side force
    shake: np.ndarray  # m/s2, excitation of the axle's resonance
    warmth: np.ndarray  # 0 .. 1, how far the drift of stiffness has got
    patch_at: float = 1e9  # m, where the low-grip patch begins


@dataclass
class Motion:
    """Motion of cars: `fast` is (steps, OUTPUTS, cars), `slow` (samples, SLOW, cars)."""

    fast: np.ndarray
    slow: np.ndarray


def stack_parameters(drives: list[Drive]) -> SimpleNamespace:
    cars = [d.car for d in drives]
    p = SimpleNamespace(**{k: np.array([c[k] for c in cars]) for k in cars[0]})
    p.wheelbase = p.lf + p.lr
    p.x = np.array([p.lf, p.lf, -p.lr, -p.lr])
    p.y = 0.5 * np.array([p.track_front, -p.track_front, p.track_rear, -p.track_rear])
    p.radius = np.array([p.wheel_radius_front] * 2 + [p.wheel_radius_rear] * 2)
    p.cx = 0.5 * np.array([p.longitudinal_stiffness_front] * 2 + [p.longitudinal_stiffness_rear] * 2)
    p.cy = 0.5 * np.array([p.cornering_stiffness_front] * 2 + [p.cornering_stiffness_rear] * 2)
    p.sigma_y = np.array([p.sigma_front] * 2 + [p.sigma_rear] * 2)
    p.conicity = 0.5 * np.array([p.conicity_front] * 2 + [p.conicity_rear] * 2)
    p.static = 0.5 * p.mass * GRAVITY / p.wheelbase * np.array([p.lr, p.lr, p.lf, p.lf])
    # per m/s2 of u: a turn moves load from the inner to the outer wheels, a positive
    # acceleration moves load from the front to the rear
    share = np.array([p.roll_front / p.track_front, (1 - p.roll_front) / p.track_rear])
    p.load_roll = p.mass * p.h_lateral * np.array([-share[0], share[0], -share[1], share[1]])
    p.load_pitch = 0.5 * p.mass * p.h_longitudinal / p.wheelbase * np.array([-1.0, -1, 1, 1])[:, None]
    p.body_inertia = p.yaw_inertia - (p.wheel_inertia * (p.y / p.radius) ** 2).sum(
        0
    )  # the rest is in the spinning wheels
    p.w_roll, p.w_pitch, p.w_res = (2 * np.pi * f for f in (p.f_roll, p.f_pitch, p.f_resonance))
    p.drive_share = 0.5 * np.array([p.drive_front] * 2 + [1 - p.drive_front] * 2)
    p.brake_share = 0.5 * np.array([p.brake_front] * 2 + [1 - p.brake_front] * 2)
    p.driver_mass = NOMINAL["mass"]
    p.patch_at = np.array([d.patch_at for d in drives])
    p.driver_understeer = compute_understeer(NOMINAL)
    p.grade_profile, p.bank_profile = (np.stack([d.road[k] for d in drives], -1) for k in ("grade", "bank"))
    # what no car of this batch has need not be computed
    p.has = SimpleNamespace(
        road=bool(p.grade_profile[0].any() or p.bank_profile[0].any()),
        mu=bool((p.mu < RIGID).any()),
        air=bool(np.any([p.drag, p.wind_x, p.wind_y])),
        exact=bool(p.exact.any()),
        load=bool(p.load_sensitive.any()),
        combined=bool(p.combined.any()),
        sigma_y=bool(p.sigma_y.any()),
        sigma_x=bool(p.sigma_x.any()),
        trail=bool(p.trail.any()),
        patch=bool(p.patch.any()),
        rolling=bool(p.rolling.any()),
        drift=bool(p.drift.any()),
        steering=bool(np.any([p.ratio_v, p.active, p.compliance])),
        conicity=bool(p.conicity.any()),
        gust=bool(p.gust.any()),
        resonance=bool(p.resonance.any()),
    )
    return p


def compute_slips(p: SimpleNamespace, v: SimpleNamespace, steer: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return slip angle, longitudinal slip, speed, cos and sin of the wheel."""
    wheel = np.empty_like(v.omega)
    wheel[:2] = steer
    wheel[2:] = p.rear_roll_steer * v.roll
    vx, vy = v.vx - p.y * v.r, v.vy + p.x * v.r
    along, cos, sin, angle = vx, np.ones_like(wheel), wheel, wheel - vy / v.vx
    if p.has.exact:
        toe = (
            p.exact * p.ackermann * steer**2 * p.track_front / (2 * p.wheelbase)
        )  # the inner wheel turns more
        wheel = wheel + np.array([toe, -toe, 0 * toe, 0 * toe])
        c, s = np.cos(wheel), np.sin(wheel)
        exact_along = vx * c + vy * s
        angle = angle + p.exact * (np.arctan2(vx * s - vy * c, np.abs(exact_along)) - angle)
        along = vx + p.exact * (exact_along - vx)
        cos, sin = 1 + p.exact * (c - 1), wheel + p.exact * (s - wheel)
    rolling = p.radius * v.omega
    return angle, (rolling - along) / np.maximum(np.abs(along), np.abs(rolling)), along, cos, sin


def compute_rates(
    p: SimpleNamespace, state: np.ndarray, u: np.ndarray
) -> tuple[np.ndarray, tuple[np.ndarray, ...]]:
    """Return the states' derivative, the specific force x, y and the yaw acceleration.

    `u`: signals of Drive at this time.
    """
    steer0, speed, accel, coast, gust, shake, warmth = u
    v = SimpleNamespace(**dict(zip(SINGLE, state, strict=False)))
    v.omega, bent_y, bent_x = state[14:18], state[18:22], state[22:26]
    has = p.has

    steer = steer0
    if has.steering:
        steer = steer0 * (1 + p.ratio_v * (v.vx - 20.0) / 20.0) - v.rack
        steer = steer - p.active * (v.r - v.vx * steer0 / (p.wheelbase + p.driver_understeer * v.vx**2))
    angle, slip, along, cos, sin = compute_slips(p, v, steer)

    load, cx, cy = p.static, p.cx, p.cy
    if has.load:
        load = np.maximum(p.static + p.load_roll * v.roll + p.load_pitch * v.pitch, 1.0)
        relative = load / p.static
        cy = cy * (1 + p.load_sensitive * (compute_load_factor(relative) - 1))
        cx = cx * (1 + p.load_sensitive * (relative - 1))
    if has.drift:
        level = 1 + p.drift * warmth
        cx, cy = cx * level, cy * level
    if has.patch:
        place = v.s + p.x - p.patch_at
        level = 1 - p.patch * ((place > 0) & (place < 25.0))
        cx, cy = cx * level, cy * level

    felt_y = np.where(p.sigma_y > 0, bent_y, angle) if has.sigma_y else angle
    felt_x = np.where(p.sigma_x > 0, bent_x, slip) if has.sigma_x else slip
    if has.mu:
        fy = compute_magic_formula(felt_y, cy, p.mu * load, LATERAL_C, p.shape_y)
        fx = compute_magic_formula(felt_x, cx, p.mu * load, LONGITUDINAL_C, p.shape_x)
    else:
        fy, fx = cy * felt_y, cx * felt_x
    if has.combined:
        fy = fy * compute_side_force_weight(felt_x, p.combined)
    if has.conicity:
        fy = fy + p.conicity * load / p.static
    # Rolling resistance shifts the wheel load forward: a force on the car without a
    # torque on the wheel.
    contact = fx - p.rolling * load * (1 + 0.3 * (v.vx / 40.0) ** 2) if has.rolling else fx

    body_x, body_y = contact * cos - fy * sin, fy * cos + contact * sin
    moment = (p.x * body_y - p.y * body_x).sum(0)
    if has.trail:
        moment = moment - (p.trail * compute_trail_weight(felt_y) * fy).sum(0)
    force_x, force_y = body_x.sum(0), body_y.sum(0)
    if has.gust:
        force_y, moment = force_y + gust, moment + p.wind_arm * gust
    if has.resonance:
        shaking = p.resonance * p.mass * v.dq / p.w_res
        force_y, moment = force_y + shaking, moment - p.lr * shaking
    if has.air:
        c, s = np.cos(v.psi), np.sin(v.psi)
        head, side = v.vx - (p.wind_x * c + p.wind_y * s), p.wind_y * c - p.wind_x * s - v.vy
        flow = np.hypot(head, side)
        push = p.side_area * flow * side * (1 - 0.3 * (side / flow) ** 2)
        force_x, force_y = force_x - p.drag * flow * head, force_y + push
        moment = moment + p.wind_arm * push

    # The body hangs over its roll and pitch axes: the centre of gravity accelerates by
    # f_axis - coupling u''.
    def body(
        f: np.ndarray, x: np.ndarray, dx: np.ndarray, w: np.ndarray, z: np.ndarray, coupling: np.ndarray
    ):
        spring = w**2 * x + 2 * z * w * dx
        axis = (f - coupling * spring) / (1 - coupling * w**2)
        return axis, w**2 * axis - spring

    fx_cg, fy_cg = force_x / p.mass, force_y / p.mass
    axis_x, ddpitch = body(fx_cg, v.pitch, v.dpitch, p.w_pitch, p.z_pitch, p.pitch_coupling)
    axis_y, ddroll = body(fy_cg, v.roll, v.droll, p.w_roll, p.z_roll, p.roll_coupling)
    yaw_acc = moment / p.body_inertia
    if has.road:
        axis_x = axis_x - GRAVITY * np.sin(compute_slope(p.grade_profile, v.s))
        axis_y = axis_y - GRAVITY * np.sin(compute_slope(p.bank_profile, v.s))

    wanted = p.driver_mass * (accel + SPEED_GAIN * (speed - v.vx)) * p.radius[0]
    wanted = np.where(coast > 0.5, ENGINE_DRAG, wanted)
    rate = np.zeros_like(state)
    rate[0] = axis_x + v.vy * v.r
    rate[1] = axis_y - v.vx * v.r
    rate[2] = yaw_acc
    rate[3], rate[4] = v.r, v.vx
    rate[5], rate[6], rate[7], rate[8] = v.droll, ddroll, v.dpitch, ddpitch
    rate[9] = (np.maximum(wanted, ENGINE_DRAG) - v.drive) / DRIVE_LAG
    rate[10] = (np.maximum(ENGINE_DRAG - wanted, 0) - v.brake) / BRAKE_LAG
    if has.steering:
        rate[11] = (p.compliance * fy[:2].sum(0) - v.rack) / RACK_LAG
    if has.resonance:
        rate[12] = v.dq
        rate[13] = (
            p.w_res**2 * (fy_cg - shaking / p.mass + shake - v.q) - 2 * RESONANCE_DAMPING * p.w_res * v.dq
        )
    rate[14:18] = (p.drive_share * v.drive - p.brake_share * v.brake - p.radius * fx) / p.wheel_inertia
    # Deflection y of a contact patch: dy/dt = sliding speed - |v| y/sigma; state y/sigma.
    if has.sigma_y:
        rate[18:22] = np.abs(along) * (angle - bent_y) / np.where(p.sigma_y > 0, p.sigma_y, 1.0)
    if has.sigma_x:
        rate[22:26] = np.abs(along) * (slip - bent_x) / np.where(p.sigma_x > 0, p.sigma_x, 1.0)
    return rate, (fx_cg, fy_cg, yaw_acc)


def simulate(drives: list[Drive], every: int = 10) -> Motion:
    """Drive all cars at once: RK4, signals linear within a step.

    `every`: steps from sample to sample.
    """
    p = stack_parameters(drives)
    names = ("steer", "speed", "accel", "coast", "gust", "shake", "warmth")
    u = np.stack([np.stack([getattr(d, k) for d in drives], -1) for k in names], 1)  # (steps, signals, cars)
    steps, cars = len(u), len(drives)
    state = np.zeros((STATES, cars))
    state[0] = u[0, 1]
    state[14:18] = u[0, 1] / p.radius
    fast = np.empty((steps, len(OUTPUTS), cars))
    slow = np.empty(((steps - 1) // every + 1, len(SLOW), cars))
    for i in range(steps):
        k1, (fx, fy, yaw_acc) = compute_rates(p, state, u[i])
        fast[i] = fx, fy, yaw_acc, state[2], state[5], state[7]
        if i % every == 0:
            drive, brake = state[9], state[10]
            slow[i // every] = (
                *state[:5],
                0.5 * (state[14] + state[15]),
                0.5 * (state[16] + state[17]),
                drive * p.drive_front - brake * p.brake_front,
                drive * (1 - p.drive_front) - brake * (1 - p.brake_front),
                u[i, 0] - state[11],
            )
        if i + 1 == steps:
            break
        middle = 0.5 * (u[i] + u[i + 1])
        k2, _ = compute_rates(p, state + 0.5 * STEP * k1, middle)
        k3, _ = compute_rates(p, state + 0.5 * STEP * k2, middle)
        k4, _ = compute_rates(p, state + STEP * k3, u[i + 1])
        state = state + STEP / 6 * (k1 + 2 * (k2 + k3) + k4)
    return Motion(fast, slow)
