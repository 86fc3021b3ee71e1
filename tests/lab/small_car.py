"""A car and a row for tests of single functions."""

from tse.library.core import REASON, library

CAR = {
    "mass": 1650,
    "lf": 1.2,
    "lr": 1.5,
    "wheel_radius_front": 0.32,
    "wheel_radius_rear": 0.32,
    "cornering_stiffness_front": 100e3,
    "cornering_stiffness_rear": 150e3,
    "longitudinal_stiffness_front": 80e3,
    "longitudinal_stiffness_rear": 90e3,
}
ROW = {
    "steer_angle": 0.01,
    "wheel_speed_front": 60.0,
    "wheel_speed_rear": 60.0,
    "accel_x": 0.0,
    "accel_y": 1.0,
    "yaw_rate": 0.05,
}
CODE = {f.name: code for code, f in library().codes(REASON).items()}
