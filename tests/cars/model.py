"""Simulate cars of 14 degrees of freedom: body 6, wheel travel 4, wheel spin 4.

Axes of ISO 8855: x forward, y left, z up; yaw, roll (right side down) and pitch (nose
down) are positive about them. The last axis of an array is the car: (cars,), by axle
(2, cars), by wheel (2 axles, 2 sides, cars) with front, rear and left, right.

vx, vy and the yaw rate are those of a frame in the plane of the road; at rest the centre
of gravity is above its origin. The body heaves, pitches and rolls by small angles, and
wheels travel vertically. Forces reach the body through springs, dampers, anti-roll bars,
and through links, which meet at a roll centre for each axle and a pitch centre. Tyres:
magic formula in normalised slip (Radt & Milliken's similarity, Pacejka ch. 4.2), with one
curve for both directions; see README.md for the equations.

A step costs about 150 calls of numpy, for one car as for twenty. So operands have one
shape (body states are spread over the wheels once a step), constants are computed
beforehand, and workspace is kept.

The step is semi-implicit: first velocities, then positions with them. Slips of the
carcasses are implicit, because their rate grows with speed beyond 1/step. Brakes and
rolling resistance act as friction that can hold a wheel and never turns it back.
"""

from types import SimpleNamespace

import numpy as np

from .cars import AIR, GRAVITY, Car, compute_roll_arm, compute_sprung_mass

STEP = 0.00125  # s
LOW_SPEED = 2.5  # m/s: below, the carcass is damped, as rolling does at speed
CARCASS_DAMPING = 0.5  # share of the critical damping of a quarter car on its carcass
MAX_CARCASS_SLIP = 0.6  # of a carcass: on the flat of the curve, so that it recovers soon
MIN_WHEEL_LOAD = 10.0  # N, avoids a division by 0 for a wheel in the air
STATES = 9  # of the body: vx, vy, r, and heave, roll, pitch, each followed by its rate
# sums over the wheels: force along, across, yaw moment, springs, their roll and pitch
# moments, moment about kingpins
SUMS = 7


def spread_over_wheels(front: np.ndarray, rear: np.ndarray) -> np.ndarray:
    """Spread values by axle over the wheels: (2, 2, cars)."""
    return np.array([[front, front], [rear, rear]])


class Fleet:
    """Cars side by side: parameters, states, and advance(). Units of the states:
    __init__."""

    def __init__(self, cars: list[Car], speed: np.ndarray) -> None:
        """Start cars straight and steady at a speed, m/s (cars,)."""
        p = SimpleNamespace(**{k: np.array([c.parameters[k] for c in cars]) for k in cars[0].parameters})
        self.p, self.n = p, len(cars)
        self._derive([c.parameters for c in cars])
        n = self.n
        self.state = np.zeros((STATES, n))
        self.vx, self.vy, self.r = self.state[:3]  # m/s, m/s, rad/s
        # m, rad, 1/s: away from rest
        self.heave, self.dheave, self.roll, self.droll, self.pitch, self.dpitch = self.state[3:]
        self.vx[:] = speed
        self.travel = np.zeros((2, 2, 2, n))  # m, m/s: of the wheels' centres and its rate
        self.spin = speed / (self.radius + p.radius_by_speed * speed**2)  # rad/s
        self.slip = np.zeros((2, 2, 2, n))  # along, across: slip that the carcasses have taken up, 1
        self.steer, self.dsteer = np.zeros(n), np.zeros(n)  # rad, rad/s: mean angle of the road wheels
        self.steering_wheel = np.zeros(n)  # rad
        # of the last step, for reference and the driver: forces along and across the
        # wheels, load, N; rolling radius, m
        self.force, self.load = np.zeros((2, 2, 2, n)), self.static.copy()
        self.rolling_radius = self.radius.copy()
        # N m, of the front tyres about their kingpins; N, of the rear axle
        self.moment, self.side_rear = (np.zeros(n), np.zeros(n))
        self._spread = np.empty((STATES, 2, 2, n))
        self._sums = np.empty((SUMS, 2, 2, n))
        self._sliding, self._rolled = np.empty((2, 2, 2, n)), np.empty((2, 2, 2, n))
        # the road: friction, stiffness along and across, rolling radius, relative to what
        # they are on a dry road
        self.set_road(*(np.ones((2, 2, n)) for _ in range(4)))

    def _full(self, values: np.ndarray | float) -> np.ndarray:
        """Spread values by car, or by axle or side and car, over the wheels: (2, 2,
        cars)."""
        return np.array(np.broadcast_to(values, (2, 2, self.n)))

    def _derive(self, cars: list[dict[str, float]]) -> None:
        p, h, full = self.p, STEP, self._full
        wheelbase = p.lf + p.lr
        self.x = spread_over_wheels(p.lf, -p.lr)
        self.y = 0.5 * np.array([[p.track_front, -p.track_front], [p.track_rear, -p.track_rear]])
        self.static = 0.5 * p.mass * GRAVITY / wheelbase * spread_over_wheels(p.lr, p.lf)
        self.radius = spread_over_wheels(p.radius_front, p.radius_rear)

        # body: it swings on its roll axis, and its inertia force is part of what the side
        # forces accelerate
        mass, height, ahead = np.array([compute_sprung_mass(c) for c in cars]).T
        roll, pitch = np.array([compute_roll_arm(c) for c in cars]), height - p.pitch_centre
        self.body_mass, self.body_roll, self.body_pitch = mass, mass * roll, mass * pitch
        self.inv_roll = 1 / (p.roll_inertia + mass * roll**2 * (1 - mass / p.mass))
        self.inv_pitch = 1 / (p.pitch_inertia + mass * pitch**2 * (1 - mass / p.mass))
        self.inv_mass, self.inv_yaw, self.inv_body = 1 / p.mass, 1 / p.yaw_inertia, 1 / mass
        self.drag = 0.5 * AIR * p.drag_area

        # suspension: position and rate at once, (2, 2, 2, cars)
        x_body = self.x - ahead
        self.x_body = x_body
        self.y_pair, self.x_pair = np.array([self.y, self.y]), np.array([x_body, x_body])
        self.spring = -np.array(
            [
                spread_over_wheels(p.spring_front, p.spring_rear),
                spread_over_wheels(p.damper_front, p.damper_rear),
            ]
        )
        track = np.array([p.track_front, p.track_rear])
        # N per m between both sides
        self.bar = full((np.array([p.bar_front, p.bar_rear]) / track**2)[:, None])
        unsprung = spread_over_wheels(p.unsprung_front, p.unsprung_rear)
        self.h_unsprung, self.h_static = h / unsprung, h * self.static / unsprung
        self.tyre_spring = full(p.tyre_spring)

        # what links and the wheels' own inertia move from left to right and from front to
        # rear, per N of the axle's, the car's force
        radius = np.array([p.radius_front, p.radius_rear])
        own = 2 * np.array([p.unsprung_front, p.unsprung_rear]) / (2 * self.static[:, 0] / GRAVITY)
        self.link_roll = (
            np.array([p.roll_centre_front, p.roll_centre_rear]) * (1 - own) + own * radius
        ) / track
        wheels = 2 * (p.unsprung_front * p.radius_front + p.unsprung_rear * p.radius_rear)
        link = (mass * p.pitch_centre + wheels) / p.mass / (2 * wheelbase)
        self.link_pitch = spread_over_wheels(-link, link)

        # wheels
        inertia = spread_over_wheels(p.wheel_inertia_front, p.wheel_inertia_rear)
        self.inertia, self.h_spin = inertia, h / inertia
        self.drive_share = 0.5 * spread_over_wheels(p.drive_front, 1 - p.drive_front)
        self.brake_share = 0.5 * spread_over_wheels(p.brake_front, 1 - p.brake_front)
        self.resistance = p.rolling_resistance * self.static * self.radius
        self.roll_steer = spread_over_wheels(-p.roll_steer_front, p.roll_steer_rear)
        # inwards: the left wheel to the right
        self.toe = np.array([[-p.toe_front, p.toe_front], [-p.toe_rear, p.toe_rear]])
        self.ackermann = p.ackermann * p.track_front / (2 * wheelbase)
        self.by_wheel = 1 / p.steering_ratio
        self.keep_dsteer = 1 - 2 * h * p.steering_damping * p.steering_frequency
        self.pull_steer = h * p.steering_frequency**2

        # tyres
        self.relax = h / np.array([full(p.relaxation_x), full(p.relaxation_y)])
        stiffness = np.array(
            [
                spread_over_wheels(p.slip_stiffness_front, p.slip_stiffness_rear),
                spread_over_wheels(p.cornering_front, p.cornering_rear),
            ]
        )
        carcass = stiffness / np.array([p.relaxation_x, p.relaxation_y])[:, None, None]  # N/m
        damping = 2 * CARCASS_DAMPING * np.sqrt(carcass * p.mass / 4)
        self.slip_by_damping = damping / stiffness  # s/m: as slip, per m/s of the contact patch
        self.spin_damping = h * self.radius**2 * damping[0]  # kg m2: makes the damping implicit for the spin
        self.deflection = full(p.radius_by_deflection / p.tyre_spring)  # m/N
        self.by_peak_load = full(1 / p.cornering_peak_load)
        # cornering stiffness 2 c u/(1 + u^2), u = load/peak load, through its value at
        # static load; along, per load
        self.cornering_per_load = (
            spread_over_wheels(p.cornering_front, p.cornering_rear)
            * (1 + (self.static * self.by_peak_load) ** 2)
            / self.static
        )
        self.slip_per_load = spread_over_wheels(p.slip_stiffness_front, p.slip_stiffness_rear) / self.static
        self.ratio = full(p.mu_x_ratio)
        self.shape, self.shape_x = full(p.shape_y), full(p.shape_x - p.shape_y)
        self.bend, self.bend_x = full(p.curvature_y), full(p.curvature_x - p.curvature_y)
        self.trail, self.trail_mechanical = full(p.trail_pneumatic), full(p.trail_mechanical)

    def set_road(
        self, friction: np.ndarray, along: np.ndarray, across: np.ndarray, radius: np.ndarray
    ) -> None:
        """Set the factors of road and pressure: friction, both stiffnesses, radius (2,
        2, cars)."""
        p = self.p
        # stiffness along over load is linear in load, so is friction; what is normalised
        # by friction is folded in
        self.stiff_x0 = along * self.slip_per_load * (1 - p.slip_stiffness_by_load) / p.mu_x_ratio
        self.stiff_x1 = along * self.slip_per_load * p.slip_stiffness_by_load / self.static / p.mu_x_ratio
        self.stiff_y = across * self.cornering_per_load
        self.mu0 = friction * p.mu_y * (1 + p.mu_by_load)
        self.mu1 = friction * p.mu_y * p.mu_by_load / self.static
        self.radius_now = radius * self.radius

    def advance(
        self,
        steps: int,
        steering_wheel: np.ndarray,
        drive: np.ndarray,
        brake: np.ndarray,
        gravity: np.ndarray,
        uneven: np.ndarray | None,
    ) -> None:
        """Advance by steps of STEP.

        Parameters
        ----------
        steering_wheel
            rad, reached linearly at the end.
        drive, brake
            N m a wheel, (2, 2, cars); brake > 0.
        gravity
            (3, cars), m/s2, along x, y of the road's plane and into it, with crests and
            dips.
        uneven
            Height of the road under each wheel at each step, m, (steps, 2, 2, cars).
        """
        p, h, n = self.p, STEP, self.n
        state, spread, sums, sliding, rolled = (
            self.state,
            self._spread,
            self._sums,
            self._sliding,
            self._rolled,
        )
        vx, vy, r, _, _, roll, _, pitch, _ = state
        u_vx, u_vy, u_r, _, _, u_roll, _, _, _ = spread
        u_heaves, u_rolls, u_pitches = spread[3:5], spread[5:7], spread[7:9]
        travel, dtravel = self.travel
        bx, by, yaw, springs, spring_roll, spring_pitch, kingpin = sums
        accel = np.empty((3, n))
        swing = np.empty((3, n))  # accelerations of heave, roll, pitch
        turn = (steering_wheel - self.steering_wheel) / steps
        slow = bool((np.abs(vx) < LOW_SPEED + 1).any())
        weight = gravity[2] - GRAVITY
        held_back = self.h_static + h * weight
        ground = self.static if uneven is None else self.static + self.tyre_spring * uneven
        free_radius = self.radius_now + p.radius_by_speed * vx * vx + self.deflection * self.static
        friction = brake + self.resistance
        h_spin, held = self.h_spin, self.h_spin * friction
        for k in range(steps):
            np.copyto(spread, state[:, None, None])
            # -- angles of the wheels
            self.steering_wheel = self.steering_wheel + turn
            wanted = self.steering_wheel * self.by_wheel - p.steering_compliance * self.moment
            self.dsteer = self.keep_dsteer * self.dsteer + self.pull_steer * (wanted - self.steer)
            self.steer = self.steer + h * self.dsteer
            angle = self.roll_steer * u_roll
            angle += self.toe
            outer = self.ackermann * self.steer * self.steer  # the inner wheel turns more
            angle[0, 0] += self.steer + outer
            angle[0, 1] += self.steer - outer
            angle[1] -= p.compliance_rear * self.side_rear
            sin = np.sin(angle)
            cos = np.sqrt(1.0 - sin * sin)
            # -- velocity of the wheels along and across themselves, loads, rolling radii
            u, v = u_vx - self.y * u_r, u_vy + self.x * u_r
            along = u * cos + v * sin
            load = np.maximum(
                (ground if uneven is None else ground[k]) - self.tyre_spring * travel, MIN_WHEEL_LOAD
            )
            radius = free_radius - self.deflection * load
            # -- slips: first-order relaxation over the distance rolled
            np.subtract(radius * self.spin, along, out=sliding[0])
            np.subtract(u * sin, v * cos, out=sliding[1])
            np.copyto(rolled, np.abs(along))
            slip = (self.slip + self.relax * sliding) / (self.relax * rolled + 1.0)
            slip = np.minimum(np.maximum(slip, -MAX_CARCASS_SLIP), MAX_CARCASS_SLIP)
            self.slip = slip
            if slow:
                fade = np.maximum(1 - rolled[0] / LOW_SPEED, 0)
                slip = slip + fade * self.slip_by_damping * sliding
            # -- forces: magic formula of the slip normalised by stiffness and friction
            mu = self.mu0 - self.mu1 * load
            relative = load * self.by_peak_load
            nx = (self.stiff_x0 + self.stiff_x1 * load) * slip[0] / mu
            ny = self.stiff_y * slip[1] / (mu + mu * relative * relative)
            nx2 = nx * nx
            square = nx2 + ny * ny
            square += 1e-12
            lengthwise = nx2 / square
            size = np.sqrt(square)
            shape = self.shape + self.shape_x * lengthwise
            bend = size / shape
            bend -= (self.bend + self.bend_x * lengthwise) * (bend - np.arctan(bend))
            share = load * mu * np.sin(shape * np.arctan(bend)) / size
            force = np.empty((2, 2, 2, n))
            fx = np.multiply(self.ratio * nx, share, out=force[0])
            fy = np.multiply(ny, share, out=force[1])
            square += 1.0
            aligning = self.trail * fy / square
            # -- what adds up over the wheels
            np.subtract(fx * cos, fy * sin, out=bx)
            np.add(fx * sin, fy * cos, out=by)
            np.subtract(self.x * by - self.y * bx, aligning, out=yaw)
            np.add(aligning, self.trail_mechanical * fy, out=kingpin)
            lift = u_heaves + self.y_pair * u_rolls - self.x_pair * u_pitches - self.travel
            strut = self.spring * lift
            across = lift[0]
            np.subtract(strut[0] + strut[1], self.bar * (across - across[:, ::-1]), out=springs)
            np.multiply(self.y, springs, out=spring_roll)
            np.multiply(self.x_body, springs, out=spring_pitch)
            axles = sums[:, :, 0] + sums[:, :, 1]
            total = axles[:, 0] + axles[:, 1]
            self.moment, self.side_rear = axles[6, 0], axles[1, 1]
            # -- accelerations
            fx_all = total[0] - self.drag * vx * np.abs(vx)
            side, push = total[1] * self.inv_mass, fx_all * self.inv_mass
            np.multiply(total[3], self.inv_body, out=swing[0])
            swing[0] -= weight
            np.multiply(total[4] + self.body_roll * (GRAVITY * roll + side), self.inv_roll, out=swing[1])
            np.multiply(self.body_pitch * (GRAVITY * pitch - push) - total[5], self.inv_pitch, out=swing[2])
            np.add(push - self.body_pitch * swing[2] * self.inv_mass, gravity[0] + r * vy, out=accel[0])
            np.add(side + self.body_roll * swing[1] * self.inv_mass, gravity[1] - r * vx, out=accel[1])
            np.multiply(total[2], self.inv_yaw, out=accel[2])
            links = self.link_pitch * fx_all
            across = self.link_roll * axles[1]
            links[:, 0] -= across
            links[:, 1] += across
            # -- velocities, then positions
            state[:3] += h * accel
            state[4::2] += h * swing
            state[3::2] += h * state[4::2]
            dtravel += self.h_unsprung * (load - springs - links) - held_back
            travel += h * dtravel
            # -- spin: free of brakes first, then as far towards standing still as they
            # can
            if slow:
                h_spin = h / (self.inertia + fade * self.spin_damping)
                held = h_spin * friction
            spin = self.spin + h_spin * (drive - radius * fx)
            self.spin = np.copysign(np.maximum(np.abs(spin) - held, 0.0), spin)
            self.force, self.load, self.rolling_radius = force, load, radius
