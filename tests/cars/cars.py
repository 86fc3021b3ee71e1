"""Draw passenger cars at random, with the vehicle files that their engineers would write.

A car is a flat dictionary of numbers in SI units; PARAMETERS has their meaning. The
engineer knows (Car.vehicle) mass and axles exactly unless an error is asked for, wheel
radii of new tyres, and the nominal steering ratio. These are keys of a vehicle file.

Definitions of "the true stiffness" of a car with nonlinear tyres:

    linear stiffness    slope of an axle at zero slip, both tyres at static load
                        (linear_stiffness)
    effective           that of the front axle from the steering wheel, with the
                        compliance of the steering in series, 1/C_eff = 1/C + c, and
                        that of the rear axle with the compliance of its suspension;
                        without roll steer
    secant              by row: force over slip of the axle at the time (columns of the
                        reference file):
                        cx_front = F_x,f / s_f
                        s_f = (R w_f - v_f)/max(|v_f|, |R w_f|, 1 m/s)
                        cy_front = F_y,f / a_f,  a_f = delta - atan2(vy + lf r, vx)
                        cy_rear  = F_y,r / a_r,  a_r =       - atan2(vy - lr r, vx)
                        F: sum of both tyres' forces along and across their own wheels.
                        w_f: mean rotation rate of both wheels. R: mean of their
                        effective rolling radii at the time. v_f: velocity of the middle
                        of the axle along delta. delta: mean angle of both road wheels,
                        after compliant steering without play; toe of left and right
                        cancels. NaN for |s| < 0.0005, |a| < 0.002 rad, or below 2 m/s.
                        a is ISO 8855's slip angle with the opposite sign, so stiffness
                        is positive, as in tse. The rear wheels of a single track do not
                        steer: their angle by compliance and roll is part of cy_rear.
                        cx_front_tyre, cy_front_tyre, cy_rear_tyre: the same force over
                        the mean slip of both carcasses. The lag of the relaxation is
                        not in them, so they stay finite when the slip changes its sign.
                        cy_front_steered: over the slip angle with delta = steering
                        wheel / true ratio. Compliance, lag and roll steer are part of
                        this "tyre", as for a single track driven by the steering wheel.
                        cy_rear_axle: cy_rear_tyre in series with the compliance of the
                        suspension, 1/C = 1/C_tyre + c: the rear axle of a single track.
                        No sensor separates tyres from a suspension that yields with the
                        same force.
"""

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

GRAVITY = 9.81  # m/s2
AIR = 1.2  # kg/m3
CHANNELS = ("steer_angle", "wheel_speed_front", "wheel_speed_rear", "accel_x", "accel_y", "yaw_rate")

# unit and meaning by name; stiffness and masses of wheels are those of one wheel
PARAMETERS = {
    "mass": "kg, as driven",
    "yaw_inertia": "kg m2, whole car",
    "roll_inertia": "kg m2, body about its centre of gravity",
    "pitch_inertia": "kg m2, body about its centre of gravity",
    "lf": "m, centre of gravity to front axle",
    "lr": "m, centre of gravity to rear axle",
    "track_front": "m",
    "track_rear": "m",
    "cg_height": "m, of the whole car above the road",
    "unsprung_front": "kg",
    "unsprung_rear": "kg",
    "spring_front": "N/m at the wheel",
    "spring_rear": "N/m at the wheel",
    "damper_front": "N s/m at the wheel",
    "damper_rear": "N s/m at the wheel",
    "bar_front": "N m/rad, anti-roll bar, of body roll",
    "bar_rear": "N m/rad",
    "tyre_spring": "N/m, vertical",
    "roll_centre_front": "m above the road",
    "roll_centre_rear": "m above the road",
    "pitch_centre": (
        "m above the road: what links, not springs, carry of the longitudinal transfer "
        "(anti-dive, anti-squat)"
    ),
    "radius_front": "m, effective rolling radius at static load and low speed, worn",
    "radius_rear": "m",
    "radius_by_deflection": "1, loss of rolling radius per vertical deflection",
    "radius_by_speed": "s2/m, growth of the rolling radius over speed squared",
    "wheel_inertia_front": "kg m2, of one wheel with what of the engine turns with it",
    "wheel_inertia_rear": "kg m2",
    "cornering_front": "N/rad, one tyre at static load, at zero slip",
    "cornering_rear": "N/rad",
    "slip_stiffness_front": "N, one tyre at static load, at zero slip",
    "slip_stiffness_rear": "N",
    "cornering_peak_load": "N, load at which cornering stiffness is largest",
    "slip_stiffness_by_load": "1, of its coefficient per relative change of load",
    "mu_y": "1, peak friction across, static load",
    "mu_x_ratio": "1, peak friction along over across",
    "mu_by_load": "1, loss of friction per relative change of load",
    "shape_x": "1, shape factor C of the magic formula",
    "shape_y": "1",
    "curvature_x": "1, curvature factor E",
    "curvature_y": "1",
    "relaxation_y": "m",
    "relaxation_x": "m",
    "trail_pneumatic": "m, at zero slip",
    "trail_mechanical": "m, of the front's kingpins",
    "rolling_resistance": "1",
    "steering_ratio": "1, true",
    "steering_compliance": "rad/(N m), mean road wheel angle over moment of the front tyres about kingpins",
    "steering_frequency": "rad/s, of the second-order lag from steering wheel to road wheels",
    "steering_damping": "1",
    "ackermann": "1, share of the full difference between both angles",
    "compliance_rear": (
        "rad/N, turn of the rear wheels out of the bend per side force of the axle; negative: into it"
    ),
    "roll_steer_front": "rad/rad, front wheels turn against the turn (understeer)",
    "roll_steer_rear": "rad/rad, rear wheels turn into the turn (understeer)",
    "toe_front": "rad, of one wheel, inwards",
    "toe_rear": "rad",
    "drag_area": "m2, cd A",
    "drive_front": "1, share of the drive torque: 1 front, 0 rear",
    "brake_front": "1, share of the brake torque",
    "engine_drag": "N, at the wheels, foot off the pedal",
    "power": "W, at the wheels",
    "gearbox_gap": "s, torque gap of a gear change; 0: none",
}


@dataclass
class Car:
    """A car: parameters (PARAMETERS), sensors (draw_sensors), and the engineer's
    vehicle file."""

    parameters: dict[str, float]
    sensors: dict[str, Any]
    vehicle: dict[str, Any]
    driven_axle: str = field(default="front")

    def linear_stiffness(self) -> dict[str, float]:
        """Return the stiffness of the axles at zero slip and static load, N and N/rad."""
        p = self.parameters
        trail = p["trail_pneumatic"] + p["trail_mechanical"]
        front, rear = 2 * p["cornering_front"], 2 * p["cornering_rear"]
        return {
            "cx_front": 2 * p["slip_stiffness_front"],
            "cx_rear": 2 * p["slip_stiffness_rear"],
            "cy_front": front,
            "cy_rear": rear,
            "cy_front_effective": 1 / (1 / front + p["steering_compliance"] * trail),
            "cy_rear_effective": 1 / (1 / rear + p["compliance_rear"]),
        }

    def understeer(self) -> float:
        """Return the understeer gradient of the linear car, rad s2/m.

        Steering angle beyond wheelbase/radius over lateral acceleration, with compliance
        and roll steer.
        """
        p, c = self.parameters, self.linear_stiffness()
        wheelbase = p["lf"] + p["lr"]
        loads = p["mass"] * p["lr"] / wheelbase, p["mass"] * p["lf"] / wheelbase
        # the tyres' aligning moments turn the car out of the bend: front carries more,
        # rear less
        twist = p["mass"] * p["trail_pneumatic"] / wheelbase
        bend = (loads[0] + twist) / c["cy_front_effective"] - (loads[1] - twist) / c["cy_rear_effective"]
        roll = (p["roll_steer_front"] + p["roll_steer_rear"]) * compute_roll_gradient(p)
        return bend + roll


def compute_sprung_mass(p: dict[str, float]) -> tuple[float, float, float]:
    """Return mass of the body, kg, height of its centre of gravity, m, and its offset, m.

    The offset is ahead of the centre of gravity of the whole car.
    """
    front, rear = 2 * p["unsprung_front"], 2 * p["unsprung_rear"]
    mass = p["mass"] - front - rear
    height = (p["mass"] * p["cg_height"] - front * p["radius_front"] - rear * p["radius_rear"]) / mass
    return mass, height, (rear * p["lr"] - front * p["lf"]) / mass


def compute_roll_arm(p: dict[str, float]) -> float:
    """Return the height of the body's centre of gravity above the roll axis, m."""
    _, height, ahead = compute_sprung_mass(p)
    wheelbase = p["lf"] + p["lr"]
    axis = (
        p["roll_centre_rear"]
        + (p["roll_centre_front"] - p["roll_centre_rear"]) * (p["lr"] + ahead) / wheelbase
    )
    return height - axis


def compute_roll_gradient(p: dict[str, float]) -> float:
    """Return the roll of the body over lateral acceleration, rad s2/m, approximately.

    Springs, and the tyres of each axle in series.
    """
    mass, _, _ = compute_sprung_mass(p)
    arm, stiffness = compute_roll_arm(p), 0.0
    for axle in ("front", "rear"):
        suspension = 0.5 * p[f"spring_{axle}"] * p[f"track_{axle}"] ** 2 + p[f"bar_{axle}"]
        tyres = 0.5 * p["tyre_spring"] * p[f"track_{axle}"] ** 2
        stiffness += suspension * tyres / (suspension + tyres)
    return mass * arm / (stiffness - mass * GRAVITY * arm)


def draw_car(
    rng: np.random.Generator,
    mass_error: float = 0.0,
    cg_error: float = 0.0,
    tell_inertia: bool = False,
    name: str = "car",
) -> Car:
    """Draw a plausible passenger car.

    Parameters
    ----------
    mass_error
        Relative error of the mass in the vehicle file.
    cg_error
        Distance, m, of the file's centre of gravity behind the true one.
    tell_inertia
        The file has the true yaw inertia.
    """
    u = rng.uniform
    p: dict[str, float] = {}
    size = u(0.0, 1.0)  # small car .. large car; other sizes follow it
    p["mass"] = float(np.clip(1100 + 1100 * size + u(-100, 200), 1100, 2300))
    wheelbase = 2.42 + 0.52 * size + u(-0.06, 0.06)
    driven = str(rng.choice(["front", "rear", "both"], p=[0.6, 0.22, 0.18]))
    rearward = u(0.37, 0.45) if driven == "front" else u(0.44, 0.52)
    p["lf"], p["lr"] = rearward * wheelbase, (1 - rearward) * wheelbase
    p["yaw_inertia"] = p["mass"] * p["lf"] * p["lr"] * float(np.clip(rng.normal(0.97, 0.08), 0.8, 1.2))
    p["track_front"] = 1.44 + 0.17 * size + u(-0.03, 0.03)
    p["track_rear"] = p["track_front"] + u(-0.03, 0.02)
    p["cg_height"] = u(0.50, 0.60) + (u(0.05, 0.12) if rng.random() < 0.35 else 0.0)  # a third are tall
    p["unsprung_front"] = 30 + 14 * size + u(-3, 3)
    p["unsprung_rear"] = 28 + 14 * size + u(-3, 3)
    nominal_radius = round(0.292 + 0.052 * size + u(-0.008, 0.008), 3)
    wear = u(0.0, 0.01, 2)
    p["radius_front"], p["radius_rear"] = nominal_radius * (1 - wear[0]), nominal_radius * (1 - wear[1])
    p["radius_by_deflection"], p["radius_by_speed"] = u(0.04, 0.12), u(2e-7, 8e-7)
    p["tyre_spring"] = u(1.8e5, 2.5e5)
    p["roll_centre_front"], p["roll_centre_rear"] = u(0.02, 0.08), u(0.06, 0.15)
    p["pitch_centre"] = u(0.1, 0.3) * p["cg_height"]
    _draw_suspension(p, rng)
    p["drive_front"] = {"front": 1.0, "rear": 0.0, "both": u(0.35, 0.6)}[driven]
    for axle, share in (("front", p["drive_front"]), ("rear", 1 - p["drive_front"])):
        p[f"wheel_inertia_{axle}"] = u(0.8, 1.0) + 0.6 * size + share * u(0.6, 2.0)
    p["brake_front"] = u(0.62, 0.74)
    _draw_tyres(p, rng, wheelbase)
    nominal_ratio = round(u(13.0, 17.5), 1)
    p["steering_ratio"] = nominal_ratio * (1 + u(-0.03, 0.03))
    p["steering_frequency"], p["steering_damping"] = 2 * math.pi * u(8, 18), u(0.6, 0.9)
    p["ackermann"] = u(0.4, 0.9)
    p["roll_steer_front"], p["roll_steer_rear"] = u(0.0, 0.06), u(0.0, 0.04)
    p["toe_front"], p["toe_rear"] = math.radians(u(0.0, 0.1)), math.radians(u(0.02, 0.15))
    p["rolling_resistance"], p["drag_area"] = u(0.008, 0.013), 0.5 + 0.2 * size + u(0.0, 0.15)
    p["engine_drag"] = p["mass"] * u(0.12, 0.3)
    p["power"] = p["mass"] * u(45, 85)
    p["gearbox_gap"] = u(0.2, 0.5) if rng.random() < 0.6 else 0.0
    p["trail_mechanical"] = u(0.015, 0.03)
    _share_flexibility(p, rng, wheelbase)
    assert p.keys() == PARAMETERS.keys(), p.keys() ^ PARAMETERS.keys()
    p = {key: float(p[key]) for key in PARAMETERS}
    vehicle: dict[str, Any] = {
        "name": name,
        "mass": round(p["mass"] * (1 + mass_error), 1),
        "lf": round(p["lf"] + cg_error, 4),
        "lr": round(p["lr"] - cg_error, 4),
        "wheelbase": round(wheelbase, 4),
        "wheel_radius_front": nominal_radius,
        "wheel_radius_rear": nominal_radius,
        "steering_ratio": nominal_ratio,
        "track_front": round(p["track_front"], 3),
        "track_rear": round(p["track_rear"], 3),
        "driven_axle": driven,
    }
    if tell_inertia:
        vehicle["yaw_inertia"] = round(p["yaw_inertia"], 1)
    return Car(p, draw_sensors(rng), vehicle, driven)


def _draw_suspension(p: dict[str, float], rng: np.random.Generator) -> None:
    """Derive springs from ride frequencies, and anti-roll bars from the wanted roll
    gradient."""
    u = rng.uniform
    mass, _, ahead = compute_sprung_mass(p)
    wheelbase = p["lf"] + p["lr"]
    corner = {
        "front": 0.5 * mass * (p["lr"] + ahead) / wheelbase,
        "rear": 0.5 * mass * (p["lf"] - ahead) / wheelbase,
    }
    frequency = u(1.15, 1.45)
    damping = u(0.26, 0.4)
    for axle, f in (("front", frequency), ("rear", frequency * u(1.05, 1.2))):
        p[f"spring_{axle}"] = corner[axle] * (2 * math.pi * f) ** 2
        p[f"damper_{axle}"] = 2 * damping * math.sqrt(p[f"spring_{axle}"] * corner[axle])
    p["roll_inertia"] = mass * (u(0.36, 0.41) * p["track_front"]) ** 2
    p["pitch_inertia"] = u(0.88, 0.96) * p["yaw_inertia"]
    gradient = math.radians(u(2.8, 5.5)) / GRAVITY
    arm = compute_roll_arm(p)
    total = mass * arm / gradient + mass * GRAVITY * arm
    front = u(0.52, 0.63)
    for axle, share in (("front", front), ("rear", 1 - front)):
        springs = 0.5 * p[f"spring_{axle}"] * p[f"track_{axle}"] ** 2
        p[f"bar_{axle}"] = max(share * total - springs, 0.0)


def _draw_tyres(p: dict[str, float], rng: np.random.Generator, wheelbase: float) -> None:
    u = rng.uniform
    p["slip_stiffness_by_load"] = u(-0.15, 0.1)
    p["mu_y"], p["mu_x_ratio"], p["mu_by_load"] = u(0.9, 1.08), u(1.0, 1.12), u(0.06, 0.14)
    p["shape_x"], p["shape_y"] = u(1.5, 1.7), u(1.25, 1.45)
    p["curvature_x"], p["curvature_y"] = u(-0.5, 0.4), u(-1.0, 0.2)
    p["cornering_peak_load"] = u(1.7, 2.5) * p["mass"] * GRAVITY / 4
    p["relaxation_y"], p["relaxation_x"] = u(0.25, 0.65), u(0.06, 0.22)
    p["trail_pneumatic"] = u(0.02, 0.035)
    slope = u(17.0, 32.0)
    for axle, arm in (("front", p["lr"]), ("rear", p["lf"])):
        p[f"slip_stiffness_{axle}"] = slope * 0.5 * p["mass"] * GRAVITY * arm / wheelbase


def _share_flexibility(p: dict[str, float], rng: np.random.Generator, wheelbase: float) -> None:
    """Set cornering stiffness and compliance for a usual understeer gradient.

    The front axle yields by the slip angle of the rear one plus the understeer gradient.
    Steering and tyres share this.
    """
    u = rng.uniform
    weight = p["mass"] * GRAVITY
    front, rear = weight * p["lr"] / wheelbase, weight * p["lf"] / wheelbase
    per_g_rear = 1 / u(12.0, 19.0)  # slip angle per g of the rear axle with its suspension, rad
    per_g_front = per_g_rear + math.radians(u(0.8, 3.2))
    suspension, steering = u(-0.05, 0.1), u(0.12, 0.32)  # shares of the flexibility beside the tyre
    p["cornering_rear"] = 0.5 * rear / (per_g_rear * (1 - suspension))
    p["compliance_rear"] = suspension * per_g_rear / rear
    p["cornering_front"] = 0.5 * front / (per_g_front * (1 - steering))
    p["steering_compliance"] = steering * per_g_front / front / (p["trail_pneumatic"] + p["trail_mechanical"])


def draw_sensors(rng: np.random.Generator) -> dict[str, Any]:
    """Draw sensors and bus of a production car.

    SI units; latency in s, by channel; steps of the wheel speeds in m/s.
    """
    u = rng.uniform
    degree = math.pi / 180

    def off(sd: float) -> float:
        return float(np.clip(rng.normal(0, sd), -2.5 * sd, 2.5 * sd))

    wheels = float(rng.choice([0.01, 0.02]))  # 100 or 50 Hz
    wheel_latency = u(0.0, 0.06)
    # of a tooth's place, in teeth x 100 %: repeats itself every turn
    return {
        "latency": {c: float(u(0.0, 0.06)) for c in CHANNELS}
        # both axles' wheels come from the same controller, in messages of their own
        | {
            "wheel_speed_front": float(wheel_latency),
            "wheel_speed_rear": float(np.clip(wheel_latency + u(-0.01, 0.01), 0, 0.06)),
        },
        "jitter": 0.003,  # s, uniform, either side
        "late": 0.005,  # share of the rows with a missing message: the last one is held
        "period": {c: wheels if c.startswith("wheel") else 0.01 for c in CHANNELS},
        "steering_wheel_step": float(rng.choice([0.1, 0.1, 0.04])) * degree,
        "steering_wheel_offset": float(u(-1.0, 1.0)) * degree,
        "wheel_step": float(rng.choice([0.01, 0.01, 0.03125, 0.05625, 0.06])) / 3.6,
        "wheel_pulses": int(rng.choice([0, 43, 48, 96])),  # teeth; 0: a continuous speed with noise
        "wheel_pitch_sd": float(u(0.0005, 0.002)),
        "wheel_noise_sd": float(u(0.003, 0.02)),  # m/s, of one wheel, where there are no pulses
        "accel_step": float(rng.choice([0.01, 0.02, 0.0271267])),
        "accel_sd": float(u(0.015, 0.06)),
        "accel_x_bias": off(0.1),
        "accel_y_bias": off(0.1),
        "accel_x_scale": off(0.006),
        "accel_y_scale": off(0.006),
        "accel_walk": float(u(0.0, 0.002)),  # m/s2 per root second
        "yaw_rate_step": 0.01 * degree,
        "yaw_rate_sd": float(u(0.02, 0.08)) * degree,
        "yaw_rate_bias": off(0.12) * degree,
        "yaw_rate_scale": off(0.005),
        "yaw_rate_walk": float(u(0.0, 0.002)) * degree,
        "imu_bandwidth": float(u(15.0, 45.0)),  # Hz, two poles; its delay is part of the latency
        "imu_x": float(u(-0.6, 0.5)),  # m ahead of the centre of gravity
        "imu_y": float(u(-0.25, 0.25)),
        "imu_z": float(u(-0.25, 0.1)),  # above it
        "imu_roll": off(0.7) * degree,
        "imu_pitch": off(0.7) * degree,
        "imu_yaw": off(0.7) * degree,
        "torque_latency": float(u(0.0, 0.06)),  # s
        "drive_scale": off(0.07),  # of the wheel torques by a model of the engine
        "brake_scale_front": off(0.1),  # by the brakes' pressure: pads
        "brake_scale_rear": off(0.1),
        "torque_sd": float(u(5.0, 20.0)),  # N m
    }


def make_clean_sensors(sensors: dict[str, Any]) -> dict[str, Any]:
    """Return the sensors without noise, bias, steps and mounting errors.

    Latency, rates and bandwidth stay.
    """
    zero = dict.fromkeys((k for k, v in sensors.items() if isinstance(v, float)), 0.0)
    return {**sensors, **zero, "imu_bandwidth": sensors["imu_bandwidth"], "wheel_pulses": 0}
