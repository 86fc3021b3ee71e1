/* tables/settings.h - lists of all settings, as macros whose arguments are macros. A list
 * calls one of its arguments for each setting:
 *   SETTINGS_...       calls REAL for a real setting and WHOLE for an integer setting, with
 *                      (name in an FMU, member, default, exact, min, max, unit, text)
 *   EFFECT_PARAMETERS  calls ROW for each parameter of an effect (effects.toml), with (REAL,
 *                      effect, parameter, default, exact, min, max, unit, text, strength,
 *                      sign, typical min, typical max, negligible). The last five are
 *                      explained at tse_effect_parameter (tse/describe.h)
 * settings.c, tse_describe() and the FMUs pass macros that make a table row of a setting.
 * default is the value in tse_config_default(), and exact that in tse_config_exact().
 * Internal to the sources. */
#ifndef TABLES_SETTINGS_H
#define TABLES_SETTINGS_H

// clang-format off: table effect_parameters
#define EFFECT_PARAMETERS(ROW, REAL) \
  ROW(REAL, mass, change, 0.0, 0.0, -0.5, 1.0, "1", "true mass / setting - 1", 1, 0, 0.1, 0.2, 0.03) \
  ROW(REAL, yaw_inertia, change, 0.0, 0.0, -0.5, 1.0, "1", "true yaw inertia / setting - 1", 1, 0, 0.1, 0.2, \
      0.03) \
  ROW(REAL, cg_shift, distance, 0.0, 0.0, -0.6, 0.6, "m", \
      "distance that is added to lf and subtracted from lr, limited so that lf and lr stay at least a " \
      "tenth of their settings", 1, 0, 0.05, 0.15, 0.02) \
  ROW(REAL, wheel_radius, change, 0.0, 0.0, -0.1, 0.1, "1", \
      "true rolling radius / setting - 1, the same for both axles", 1, 0, 0.01, 0.025, 0.002) \
  ROW(REAL, steering_ratio, change, 0.0, 0.0, -0.3, 0.3, "1", "true road-wheel angle / logged angle - 1", 1, \
      0, 0.02, 0.06, 0.005) \
  ROW(REAL, steering_offset, angle, 0.0, 0.0, -0.05, 0.05, "rad", \
      "true road-wheel angle minus logged angle", 1, 0, 0.0017, 0.0087, 0.0003) \
  ROW(REAL, steering_delay, time, 0.0, 0.0, 0.0, 0.2, "s", "delay from the logged angle to the wheels", 1, \
      1, 0.01, 0.04, 0.002) \
  ROW(REAL, steering_lag, time, 0.02, 0.0, 0.0, 0.5, "s", \
      "sum of the time constants of two first-order lags in series from the logged angle to the wheels", 1, \
      1, 0.02, 0.06, 0.003) \
  ROW(REAL, steering_lag, second, 0.0, 0.0, 0.0, 1.0, "1", \
      "time constant of the second lag / time constant of the first lag; 0: one lag only", 0, 1, 0.0, 1.0, \
      0.0) \
  ROW(REAL, exact_kinematics, share, 1.0, 1.0, 0.0, 1.0, "1", \
      "0: equations (1) to (4) of the paper, with small angles; 1: exact equations; in between: linear " \
      "interpolation", 1, 1, 1.0, 1.0, 0.2) \
  ROW(REAL, steering_compliance, angle_per_moment, 0.0, 0.0, 0.0, 0.001, "rad/(N m)", \
      "decrease of the road-wheel angle / moment of the front lateral force about the steering axis", 1, 1, \
      3.5e-05, 8.7e-05, 1e-05) \
  ROW(REAL, steering_compliance, trail, 0.03, 0.03, 0.001, 0.2, "m", \
      "lever arm of the lateral force about the steering axis", -1, 1, 0.02, 0.05, 0.0) \
  ROW(REAL, rear_roll_steer, gain, 0.0, 0.0, -0.5, 0.5, "1", \
      "ratio of the steering angle of the rear wheels to the roll angle; positive: roll turns the rear " \
      "wheels into the curve", 1, 1, 0.03, 0.1, 0.01) \
  ROW(REAL, rear_roll_steer, roll, 0.0075, 0.0075, 0.0005, 0.03, "rad s2/m", \
      "roll angle / lateral acceleration", -1, 1, 0.0053, 0.0107, 0.0) \
  ROW(REAL, rear_roll_steer, frequency, 1.5, 1.5, 0.3, 6.0, "Hz", "natural frequency of the roll", 0, 1, \
      1.2, 2.0, 0.0) \
  ROW(REAL, rear_roll_steer, damping, 0.3, 0.3, 0.05, 2.0, "1", "damping ratio of the roll", 0, 1, 0.2, 0.4, \
      0.0) \
  ROW(REAL, relaxation, length, 0.4, 0.0, 0.0, 3.0, "m", \
      "relaxation length of the lateral force: after a step, the slip angle reaches 63 % of its final " \
      "value over this distance", 1, 1, 0.3, 0.7, 0.05) \
  ROW(REAL, longitudinal_relaxation, length, 0.0, 0.0, 0.0, 2.0, "m", \
      "relaxation length of the longitudinal force: after a step, the slip reaches 63 % of its final " \
      "value over this distance", 1, 1, 0.1, 0.4, 0.02) \
  ROW(REAL, stiffness_drift, change, 0.0, 0.0, -0.6, 1.0, "1", \
      "relative change of all stiffnesses at the end of a drift that is linear in time", 1, 0, 0.05, 0.15, \
      0.01) \
  ROW(REAL, stiffness_drift, time, 600.0, 600.0, 0.001, 36000.0, "s", \
      "duration of the drift of all stiffnesses; a short duration makes the drift a step", -1, 1, 30.0, \
      3600.0, 0.0) \
  ROW(REAL, stiffness_drift, start, 0.0, 0.0, 0.0, 36000.0, "s", \
      "time from the first row to the beginning of the drift of all stiffnesses", -1, 1, 0.0, 600.0, 0.0) \
  ROW(REAL, combined_slip, factor, 0.0, 0.0, 0.0, 2000.0, "1", \
      "k: the lateral force of an axle is multiplied by 1/sqrt(1 + k s^2), where s is the longitudinal " \
      "slip of this axle", 1, 1, 50.0, 100.0, 10.0) \
  ROW(REAL, tyre_saturation, inverse_friction, 0.0, 0.0, 0.0, 5.0, "1", \
      "1/friction coefficient: load of an axle / max lateral force of this axle; 0: no saturation", 1, 1, \
      0.9, 1.0, 0.2) \
  ROW(REAL, tyre_saturation, shape, 1.0, 0.0, 0.0, 1.0, "1", \
      "0: brush model with parabolic pressure distribution; 1: magic-formula tyre, which saturates later " \
      "and more abruptly than the brush model; in between: linear interpolation", 0, 1, 0.0, 1.0, 0.0) \
  ROW(REAL, tyre_saturation, balance, 0.0, 0.0, -0.5, 0.5, "1", \
      "1/friction is multiplied by 1 + balance in front and by 1 - balance in the rear; positive: the " \
      "front axle saturates first", 0, 0, -0.15, 0.15, 0.0) \
  ROW(REAL, longitudinal_load_transfer, gain, 0.02, 0.0, -0.08, 0.08, "s2/m", \
      "k in the cornering stiffness Cf (1 - k ax) of the front axle and Cr (1 + k ax) of the rear axle; " \
      "ax: acceleration by the longitudinal tyre forces", 1, 1, 0.02, 0.04, 0.004) \
  ROW(REAL, longitudinal_load_transfer, balance, 0.0, 0.0, -1.0, 1.0, "1", \
      "the gain k of the load transfer is multiplied by 1 + balance in front and by 1 - balance in the " \
      "rear; negative if the front axle has the higher load: the load transfer is then a smaller share of" \
      " its load", 0, 0, -0.3, 0.3, 0.0) \
  ROW(REAL, lateral_load_transfer, gain, 0.002, 0.0, -0.003, 0.03, "s4/m2", \
      "k in the cornering stiffness C (1 - k accel_y^2) of both axles", 1, 1, 0.002, 0.005, 0.0004) \
  ROW(REAL, lateral_load_transfer, balance, 0.0, 0.0, -1.0, 1.0, "1", \
      "the gain k of the load transfer is multiplied by 1 + balance in front and by 1 - balance in the " \
      "rear; positive if the front axle takes the larger part of the roll moment", 0, 0, -0.3, 0.3, 0.0) \
  ROW(REAL, aero_drag, coefficient, 0.4, 0.0, 0.0, 5.0, "kg/m", "force / speed squared: 1/2 rho cd A", 1, 1, \
      0.35, 0.45, 0.1) \
  ROW(REAL, rolling_resistance, coefficient, 0.01, 0.0, 0.0, 0.2, "1", "force against the motion / weight", \
      1, 1, 0.008, 0.015, 0.003) \
  ROW(REAL, grade, angle, 0.0, 0.0, -0.35, 0.35, "rad", \
      "grade of the road, positive uphill; if a log row contains a grade, simulator and replay use the " \
      "sum of this setting and that grade, and the filter uses that grade alone", 1, 0, 0.01, 0.06, 0.005) \
  ROW(REAL, bank, angle, 0.0, 0.0, -0.35, 0.35, "rad", \
      "bank of the road, positive if the left side is higher; if a log row contains a bank, simulator and" \
      " replay use the sum of this setting and that bank, and the filter uses that bank alone, without " \
      "bank_superelevation", 1, 0, 0.015, 0.03, 0.003) \
  ROW(REAL, bank, superelevation, 0.1, 0.0, -0.5, 0.5, "1", \
      "share of the lateral acceleration in a curve (speed times yaw rate) that the bank of the road " \
      "provides", 1, 1, 0.05, 0.2, 0.03) \
  ROW(REAL, crosswind, speed, 0.0, 0.0, -30.0, 30.0, "m/s", \
      "speed of a steady wind; positive: with crosswind_heading = 0 it pushes the car to the left at the " \
      "start", 1, 0, 3.0, 10.0, 1.0) \
  ROW(REAL, crosswind, heading, 0.0, 0.0, -3.2, 3.2, "rad", \
      "heading of the car at the start, relative to the heading at which the wind is a pure side wind", -1, \
      0, -3.2, 3.2, 0.0) \
  ROW(REAL, crosswind, coefficient, 2.8, 2.8, 0.1, 30.0, "kg/m", \
      "c in the side force c w sqrt(v^2 + w^2) of a pure side wind of speed w on a car of speed v", -1, 1, \
      2.0, 4.0, 0.0) \
  ROW(REAL, crosswind, arm, 0.45, 0.45, -3.0, 3.0, "m", \
      "distance of the centre of pressure in front of the centre of gravity", 0, 0, 0.3, 0.6, 0.0) \
  ROW(REAL, conicity, front, 0.0, 0.0, -2000.0, 2000.0, "N", \
      "lateral force of the front axle at zero slip angle, positive left", 1, 0, 50.0, 150.0, 20.0) \
  ROW(REAL, conicity, rear, 0.0, 0.0, -2000.0, 2000.0, "N", \
      "lateral force of the rear axle at zero slip angle, positive left", 1, 0, 50.0, 150.0, 20.0) \
  ROW(REAL, aligning_moment, trail, 0.03, 0.0, -0.2, 0.2, "m", \
      "distance behind an axle at which its lateral force acts", 1, 1, 0.02, 0.04, 0.005) \
  ROW(REAL, imu_lever_arm, x, 0.0, 0.0, -4.0, 4.0, "m", \
      "position of the IMU in front of the centre of gravity", 1, 0, 0.2, 0.8, 0.05) \
  ROW(REAL, imu_lever_arm, y, 0.0, 0.0, -2.0, 2.0, "m", \
      "position of the IMU to the left of the centre of gravity", 1, 0, 0.2, 0.8, 0.05) \
  ROW(REAL, body_roll, gain, 0.006, 0.0, -0.02, 0.04, "rad s2/m", \
      "roll angle / lateral acceleration; positive: the body leans out of the curve", 1, 1, 0.0053, 0.0107, \
      0.0008) \
  ROW(REAL, body_roll, frequency, 1.6, 1.5, 0.3, 6.0, "Hz", "natural frequency of the roll", 0, 1, 1.2, 2.0, \
      0.0) \
  ROW(REAL, body_roll, damping, 0.3, 0.3, 0.05, 2.0, "1", "damping ratio of the roll", 0, 1, 0.2, 0.4, 0.0) \
  ROW(REAL, body_roll, height, 0.0, 0.0, -1.0, 1.5, "m", \
      "height of the IMU above the roll axis minus body_roll_coupling, i.e. about the height of the IMU " \
      "above the centre of gravity", 0, 0, 0.0, 0.6, 0.0) \
  ROW(REAL, body_roll, coupling, 0.4, 0.0, -0.5, 1.0, "m", \
      "(sprung mass / mass of the car) times (height of the centre of gravity of the sprung mass above " \
      "the roll axis); this length times the roll acceleration is added to the lateral acceleration of " \
      "the car", 0, 1, 0.0, 0.5, 0.0) \
  ROW(REAL, pitch_leak, gain, 0.0, 0.0, -0.01, 0.03, "rad s2/m", \
      "pitch angle / longitudinal acceleration, positive: the nose rises when the car accelerates", 1, 1, \
      0.0027, 0.0053, 0.0006) \
  ROW(REAL, pitch_leak, frequency, 1.8, 1.8, 0.3, 6.0, "Hz", "natural frequency of the pitch", 0, 1, 1.4, \
      2.2, 0.0) \
  ROW(REAL, pitch_leak, damping, 0.4, 0.4, 0.05, 2.0, "1", "damping ratio of the pitch", 0, 1, 0.2, 0.5, \
      0.0) \
  ROW(REAL, pitch_leak, height, 0.0, 0.0, -1.0, 1.5, "m", "height of the IMU above the pitch axis", 0, 0, \
      0.0, 0.6, 0.0) \
  ROW(REAL, imu_misalignment, angle, 0.0, 0.0, -0.2, 0.2, "rad", \
      "angle from the axes of the car to those of the IMU; positive: the IMU is turned to the left", 1, 0, \
      0.017, 0.052, 0.004) \
  ROW(REAL, imu_scale_ax, error, 0.0, 0.0, -0.3, 0.3, "1", "reading of accel_x / true value - 1", 1, 0, \
      0.01, 0.05, 0.005) \
  ROW(REAL, imu_scale_ay, error, 0.0, 0.0, -0.3, 0.3, "1", "reading of accel_y / true value - 1", 1, 0, \
      0.01, 0.05, 0.005) \
  ROW(REAL, gyro_scale, error, 0.0, 0.0, -0.3, 0.3, "1", "reading of yaw_rate / true value - 1", 1, 0, 0.01, \
      0.03, 0.003) \
  ROW(REAL, imu_delay, time, 0.0, 0.0, 0.0, 0.2, "s", \
      "delay of the readings of accelerometers and gyro relative to steering angle and wheel speeds", 1, 1, \
      0.01, 0.03, 0.002)
// clang-format on: end of table
#define EFFECT_SETTING(REAL, effect, parameter, def, exact, lo, hi, unit, text, ...) \
  REAL("effects." #effect "." #parameter, effect##_##parameter, def, exact, lo, hi, unit, text)
#define SETTINGS_EFFECTS(REAL, WHOLE) EFFECT_PARAMETERS(EFFECT_SETTING, REAL)

// clang-format off: table settings_lists
#define SETTINGS_VEHICLE(REAL, WHOLE) \
  REAL("vehicle.mass", mass, 0.0, 1900.0, 50.0, 50000.0, "kg", \
      "mass of the car; 0: unknown, and no estimated stiffness becomes valid") \
  REAL("vehicle.yaw_inertia", yaw_inertia, 0.0, 3000.0, 10.0, 1000000.0, "kg m2", \
      "yaw moment of inertia about the centre of gravity; 0: mass times lf times lr is used") \
  REAL("vehicle.lf", lf, 1.25, 1.25, 0.1, 10.0, "m", \
      "distance from the centre of gravity to the front axle") \
  REAL("vehicle.lr", lr, 1.5, 1.5, 0.1, 10.0, "m", "distance from the centre of gravity to the rear axle") \
  REAL("vehicle.wheel_radius_front", wheel_radius_front, 0.33, 0.33, 0.05, 2.0, "m", \
      "effective rolling radius of the front wheels") \
  REAL("vehicle.wheel_radius_rear", wheel_radius_rear, 0.33, 0.33, 0.05, 2.0, "m", \
      "effective rolling radius of the rear wheels") \
  REAL("vehicle.longitudinal_stiffness_front", longitudinal_stiffness_front, 0.0, 160000.0, 1000.0, \
      10000000.0, "N", \
      "nominal longitudinal (slip) stiffness of the front axle; 0: typical value for the static axle load") \
  REAL("vehicle.longitudinal_stiffness_rear", longitudinal_stiffness_rear, 0.0, 160000.0, 1000.0, \
      10000000.0, "N", \
      "nominal longitudinal (slip) stiffness of the rear axle; 0: typical value for the static axle load") \
  REAL("vehicle.cornering_stiffness_front", cornering_stiffness_front, 0.0, 120000.0, 1000.0, 10000000.0, \
      "N/rad", "nominal cornering stiffness of the front axle; 0: typical value for the static axle load") \
  REAL("vehicle.cornering_stiffness_rear", cornering_stiffness_rear, 0.0, 140000.0, 1000.0, 10000000.0, \
      "N/rad", "nominal cornering stiffness of the rear axle; 0: typical value for the static axle load") \
  REAL("vehicle.rear_longitudinal_follows_front", rear_longitudinal_follows_front, 1.0, 1.0, 0.0, 1.0, "1", \
      "factor f: the longitudinal stiffness, relative to nominal, is w in front and 1 + f (w - 1) in the " \
      "rear; no effect in the default filter")
#define SETTINGS_UNCERTAINTY(REAL, WHOLE) \
  REAL("uncertainty.mass_sd", mass_sd, 0.05, 0.0, 0.0, 0.5, "1", \
      "relative sd of mass; an error of the mass is assumed to change the yaw inertia in the same ratio") \
  REAL("uncertainty.yaw_inertia_sd", yaw_inertia_sd, 0.1, 0.0, 0.0, 0.5, "1", \
      "relative sd of the ratio yaw_inertia / mass") \
  REAL("uncertainty.cg_sd", cg_sd, 0.03, 0.0, 0.0, 1.0, "m", \
      "sd of the longitudinal position of the centre of gravity") \
  REAL("uncertainty.steer_ratio_sd", steer_ratio_sd, 0.03, 0.0, 0.0, 0.5, "1", \
      "relative sd of the scale factor of steer_angle, due to errors of the steering ratio and to " \
      "compliance of the steering") \
  REAL("uncertainty.steer_offset_sd", steer_offset_sd, 0.006, 0.0, 0.0, 0.1, "rad", \
      "sd of a constant offset of steer_angle") \
  REAL("uncertainty.accel_y_scale_sd", accel_y_scale_sd, 0.03, 0.0, 0.0, 0.5, "1", \
      "relative sd of the scale factor of accel_y, including the effect of an error of body_roll_gain: " \
      "body roll adds gravity to accel_y in proportion to the lateral acceleration, as a scale error does") \
  REAL("uncertainty.wheel_delay_sd", wheel_delay_sd, 0.02, 0.0, 0.0, 0.2, "s", \
      "sd of the delay of the wheel speeds relative to the IMU") \
  REAL("uncertainty.accel_delay_sd", accel_delay_sd, 0.003, 0.0, 0.0, 0.2, "s", \
      "sd of the delay of the accelerometers relative to the gyro") \
  REAL("uncertainty.relaxation_sd", relaxation_sd, 0.2, 0.0, 0.0, 2.0, "m", \
      "sd of the relaxation length of each axle") \
  REAL("uncertainty.lean_sd", lean_sd, 0.1, 0.0, 0.0, 0.5, "1", \
      "sd of bank_superelevation, the share of the lateral acceleration that the bank of a curve " \
      "provides; the share differs from road to road") \
  REAL("uncertainty.gyro_scale_sd", gyro_scale_sd, 0.01, 0.0, 0.0, 0.2, "1", \
      "relative sd of the scale factor of yaw_rate") \
  REAL("uncertainty.trail_sd", trail_sd, 0.03, 0.0, 0.0, 0.2, "m", \
      "sd of aligning_moment_trail, the distance behind an axle at which its lateral force acts") \
  REAL("uncertainty.roll_steer_sd", roll_steer_sd, 0.04, 0.0, 0.0, 0.5, "1", \
      "sd of rear_roll_steer_gain, the ratio of the steering angle of the rear wheels to the roll angle") \
  REAL("uncertainty.wheel_radius_sd", wheel_radius_sd, 0.005, 0.0, 0.0, 0.2, "1", \
      "relative sd of the ratio of the rear to the front wheel radius") \
  REAL("uncertainty.model_sd", model_sd, 0.12, 0.0, 0.0, 0.5, "1", \
      "sd of the discrepancy of an IMU channel, i.e. of the part of the signal that the model does not " \
      "explain, divided by the recent rms of the signal; the correlation time of the discrepancy is 1 s") \
  REAL("uncertainty.grade_sd", grade_sd, 0.03, 0.0, 0.0, 0.3, "rad", \
      "sd of the road grade about its mean, the setting grade_angle; the filter estimates the grade as a " \
      "state, because gravity along the road accelerates the car without a contribution to accel_x")
#define SETTINGS_SENSORS(REAL, WHOLE) \
  REAL("sensors.accel_x_sd", accel_x_sd, 0.1, 0.15, 0.001, 10.0, "m/s2", \
      "noise sd of one sample of accel_x") \
  REAL("sensors.accel_y_sd", accel_y_sd, 0.1, 0.15, 0.001, 10.0, "m/s2", \
      "noise sd of one sample of accel_y") \
  REAL("sensors.yaw_rate_sd", yaw_rate_sd, 0.0025, 0.0034906585039887, 1e-05, 1.0, "rad/s", \
      "noise sd of one sample of yaw_rate") \
  REAL("sensors.wheel_noise_sd", wheel_noise_sd, 0.04, 0.0, 0.0, 5.0, "rad/s", \
      "noise sd of one sample of a wheel speed (mean of the two wheels of an axle); no effect in the " \
      "paper's filter") \
  REAL("sensors.steer_lag_sd", steer_lag_sd, 0.025, 0.02, 0.0, 0.2, "s", \
      "sd of the delay of the steering angle relative to the IMU, caused by bus, steering and tyres; 0: " \
      "the delay is known exactly; no effect in the paper's filter") \
  REAL("sensors.accel_x_bias_sd", accel_x_bias_sd, 0.2, 0.05, 0.0, 5.0, "m/s2", \
      "sd of the bias of accel_x at the start") \
  REAL("sensors.accel_y_bias_sd", accel_y_bias_sd, 0.2, 0.05, 0.0, 5.0, "m/s2", \
      "sd of the bias of accel_y at the start") \
  REAL("sensors.yaw_rate_bias_sd", yaw_rate_bias_sd, 0.01, 0.002, 0.0, 0.5, "rad/s", \
      "sd of the bias of yaw_rate at the start") \
  REAL("sensors.accel_x_bias_walk", accel_x_bias_walk, 0.002, 0.002, 0.0, 1.0, "m/s2/sqrt(s)", \
      "sd of the change of the accel_x bias in 1 s; the bias is a random walk, equations (8) and (18) of " \
      "the paper") \
  REAL("sensors.accel_y_bias_walk", accel_y_bias_walk, 0.002, 0.002, 0.0, 1.0, "m/s2/sqrt(s)", \
      "sd of the change of the accel_y bias in 1 s; the bias is a random walk, equations (8) and (18) of " \
      "the paper") \
  REAL("sensors.yaw_rate_bias_walk", yaw_rate_bias_walk, 0.0001, 0.0001, 0.0, 0.1, "rad/s/sqrt(s)", \
      "sd of the change of the yaw_rate bias in 1 s; the bias is a random walk, equations (8) and (18) of" \
      " the paper")
#define SETTINGS_LATENCY(REAL, WHOLE) \
  REAL("latency.steer_angle_latency", steer_angle_latency, 0.0, 0.0, -0.2, 0.2, "s", \
      "latency of steer_angle in the log relative to yaw_rate; negative: steer_angle is logged earlier " \
      "than a yaw rate that was measured at the same time") \
  REAL("latency.wheel_speed_front_latency", wheel_speed_front_latency, 0.0, 0.0, -0.2, 0.2, "s", \
      "latency of wheel_speed_front in the log relative to yaw_rate") \
  REAL("latency.wheel_speed_rear_latency", wheel_speed_rear_latency, 0.0, 0.0, -0.2, 0.2, "s", \
      "latency of wheel_speed_rear in the log relative to yaw_rate") \
  REAL("latency.accel_x_latency", accel_x_latency, 0.0, 0.0, -0.2, 0.2, "s", \
      "latency of accel_x in the log relative to yaw_rate") \
  REAL("latency.accel_y_latency", accel_y_latency, 0.0, 0.0, -0.2, 0.2, "s", \
      "latency of accel_y in the log relative to yaw_rate")
#define SETTINGS_VELOCITY(REAL, WHOLE) \
  REAL("velocity.ins_velocity_sd", ins_velocity_sd, 0.1, 0.1, 0.001, 10.0, "m/s", \
      "initial value of the noise sd of one value of ins_vel_x or ins_vel_y; the filter estimates this " \
      "noise sd") \
  REAL("velocity.gnss_speed_sd", gnss_speed_sd, 0.1, 0.1, 0.001, 10.0, "m/s", \
      "initial value of the noise sd of one value of gnss_speed; the filter estimates this noise sd") \
  REAL("velocity.gnss_course_sd", gnss_course_sd, 0.01, 0.01, 0.0001, 1.0, "rad", \
      "initial value of the noise sd of one value of gnss_course above 10 m/s; the filter estimates this " \
      "noise sd; below 10 m/s, the noise sd is inversely proportional to the speed") \
  REAL("velocity.velocity_latency", velocity_latency, 0.0, 0.0, -0.2, 0.2, "s", \
      "latency of measured velocities relative to yaw_rate") \
  REAL("velocity.velocity_latency_sd", velocity_latency_sd, 0.03, 0.03, 0.0, 0.2, "s", \
      "sd of velocity_latency") \
  REAL("velocity.velocity_lever_x", velocity_lever_x, 0.0, 0.0, -20.0, 20.0, "m", \
      "position of the antenna, or of the reference point of the INS, in front of the centre of gravity") \
  REAL("velocity.velocity_lever_y", velocity_lever_y, 0.0, 0.0, -20.0, 20.0, "m", \
      "position of the antenna, or of the reference point of the INS, to the left of the centre of gravity") \
  REAL("velocity.velocity_lever_sd", velocity_lever_sd, 0.1, 0.1, 0.0, 5.0, "m", \
      "sd of velocity_lever_x and of velocity_lever_y") \
  REAL("velocity.velocity_heading", velocity_heading, 0.0, 0.0, -0.5, 0.5, "rad", \
      "angle from the axes of the car to those of the INS; positive: the INS is turned to the left") \
  REAL("velocity.velocity_heading_sd", velocity_heading_sd, 0.02, 0.02, 0.0, 0.5, "rad", \
      "sd of velocity_heading") \
  REAL("velocity.velocity_scale_sd", velocity_scale_sd, 0.02, 0.02, 0.0, 0.2, "1", \
      "relative sd of the ratio of a measured speed to the speed computed from the wheel speeds; wrong " \
      "wheel radii change this ratio")
#define SETTINGS_PEDALS(REAL, WHOLE) \
  REAL("pedals.wheel_torque_least", wheel_torque_least, 60.0, 60.0, 1.0, 2000.0, "Nm", \
      "an axle whose |torque| is smaller than this limit counts as rolling freely; recommended: twice the" \
      " sd of offset and noise of the torque signal")
#define SETTINGS_ROAD(REAL, WHOLE) \
  REAL("road.road_sd", road_sd, 0.005, 0.005, 0.0, 0.3, "rad", \
      "sd of the error of bank and grade, if the log row contains them; the default is about the " \
      "difference between bank or grade estimates from different laps of one road")
#define SETTINGS_FORMULA(REAL, WHOLE) \
  REAL("effects.formula_gain", formula_gain, 0.0, 0.0, -10.0, 10.0, "1", \
      "factor of the value of the user's formula, a term that is added to the vehicle model; 0: no formula") \
  REAL("effects.formula_a", formula_a, 0.0, 0.0, -1000000.0, 1000000.0, "1", \
      "constant a of the user's formula; its unit is not 1 but the one that the formula requires") \
  REAL("effects.formula_b", formula_b, 0.0, 0.0, -1000000.0, 1000000.0, "1", \
      "constant b of the user's formula; its unit is not 1 but the one that the formula requires") \
  REAL("effects.formula_c", formula_c, 0.0, 0.0, -1000000.0, 1000000.0, "1", \
      "constant c of the user's formula; its unit is not 1 but the one that the formula requires") \
  REAL("effects.formula_d", formula_d, 0.0, 0.0, -1000000.0, 1000000.0, "1", \
      "constant d of the user's formula; its unit is not 1 but the one that the formula requires") \
  REAL("effects.formula_e", formula_e, 0.0, 0.0, -1000000.0, 1000000.0, "1", \
      "constant e of the user's formula; its unit is not 1 but the one that the formula requires") \
  REAL("effects.formula_f", formula_f, 0.0, 0.0, -1000000.0, 1000000.0, "1", \
      "constant f of the user's formula; its unit is not 1 but the one that the formula requires") \
  REAL("effects.formula_g", formula_g, 0.0, 0.0, -1000000.0, 1000000.0, "1", \
      "constant g of the user's formula; its unit is not 1 but the one that the formula requires") \
  REAL("effects.formula_h", formula_h, 0.0, 0.0, -1000000.0, 1000000.0, "1", \
      "constant h of the user's formula; its unit is not 1 but the one that the formula requires") \
  WHOLE("effects.formula_place", formula_place, 0, 0, 0, 9, "", \
      "quantity of the vehicle model to which the value of the user's formula is added, from 0, slip " \
      "angle of the front axle, to 9, reading of the gyro ([place] in src/tables/formula.toml)") \
  WHOLE("effects.formula_code_1", formula_code_1, 0, 0, 0, 16777215, "", \
      "operations 1 .. 3 of the user's formula, one byte each, operation 1 in the lowest byte") \
  WHOLE("effects.formula_code_2", formula_code_2, 0, 0, 0, 16777215, "", \
      "operations 4 .. 6 of the user's formula") \
  WHOLE("effects.formula_code_3", formula_code_3, 0, 0, 0, 16777215, "", \
      "operations 7 .. 9 of the user's formula") \
  WHOLE("effects.formula_code_4", formula_code_4, 0, 0, 0, 16777215, "", \
      "operations 10 .. 12 of the user's formula") \
  WHOLE("effects.formula_code_5", formula_code_5, 0, 0, 0, 16777215, "", \
      "operations 13 .. 15 of the user's formula") \
  WHOLE("effects.formula_code_6", formula_code_6, 0, 0, 0, 16777215, "", \
      "operations 16 .. 18 of the user's formula") \
  WHOLE("effects.formula_code_7", formula_code_7, 0, 0, 0, 16777215, "", \
      "operations 19 .. 21 of the user's formula") \
  WHOLE("effects.formula_code_8", formula_code_8, 0, 0, 0, 16777215, "", \
      "operations 22 .. 24 of the user's formula") \
  WHOLE("effects.formula_code_9", formula_code_9, 0, 0, 0, 16777215, "", \
      "operations 25 .. 27 of the user's formula") \
  WHOLE("effects.formula_code_10", formula_code_10, 0, 0, 0, 16777215, "", \
      "operations 28 .. 30 of the user's formula") \
  WHOLE("effects.formula_code_11", formula_code_11, 0, 0, 0, 16777215, "", \
      "operations 31 .. 33 of the user's formula")
#define SETTINGS_FILTER(REAL, WHOLE) \
  REAL("filter.sample_time", sample_time, 0.01, 0.01, 0.001, 0.1, "s", "nominal time between rows") \
  REAL("filter.forgetting", forgetting, 0.99, 0.99, 0.9, 0.9999, "1", \
      "forgetting factor lambda of equation (17) of the paper per sample_time; the memory is 1/(1 - " \
      "lambda) samples; no effect in the default filter") \
  REAL("filter.forgetting_mean", forgetting_mean, 0.0, 0.0, 0.0, 0.9999, "1", \
      "forgetting factor, per sample_time, of the mean of the stiffness: gamma is divided by this factor " \
      "in equation (17) of the paper; 0 .. 0.5: the setting forgetting is used (the paper); no effect in " \
      "the default filter") \
  REAL("filter.forgetting_change", forgetting_change, 1.0, 1.0, 0.5, 1.0, "1", \
      "min forgetting factor of the mean stiffness; while innovations are correlated, for example after a" \
      " change of the road surface, the forgetting factor is reduced down to this min; 1: no reduction " \
      "(the paper); no effect in the default filter") \
  REAL("filter.resample_threshold", resample_threshold, 0.5, 0.5, 0.0, 1.0, "1", \
      "resample when the effective number of particles N_eff falls to this share of all particles; no " \
      "effect in the default filter") \
  REAL("filter.initial_cx_front", initial_cx_front, 1.0, 1.0, 0.2, 4.0, "1", \
      "initial front longitudinal stiffness, relative to nominal") \
  REAL("filter.initial_cy_front", initial_cy_front, 1.0, 1.0, 0.2, 4.0, "1", \
      "initial front cornering stiffness, relative to nominal") \
  REAL("filter.initial_cy_rear", initial_cy_rear, 1.0, 1.0, 0.2, 4.0, "1", \
      "initial rear cornering stiffness, relative to nominal") \
  REAL("filter.initial_mean_sd", initial_mean_sd, 0.3, 0.3, 0.0, 2.0, "1", \
      "sd of the initial mean of a stiffness / nominal stiffness; sqrt(gamma Sigma) in the symbols of the" \
      " paper; no effect in the default filter") \
  REAL("filter.initial_cx_sd", initial_cx_sd, 0.3, 0.3, 0.0, 2.0, "1", \
      "relative sd of the initial longitudinal stiffness; no effect in the paper's filter") \
  REAL("filter.initial_cy_front_sd", initial_cy_front_sd, 0.25, 0.3, 0.0, 2.0, "1", \
      "relative sd of the initial front cornering stiffness; no effect in the paper's filter") \
  REAL("filter.initial_cy_rear_sd", initial_cy_rear_sd, 0.25, 0.3, 0.0, 2.0, "1", \
      "relative sd of the initial rear cornering stiffness; no effect in the paper's filter") \
  REAL("filter.grip", grip, 1.0, 0.0, 0.0, 50.0, "1", \
      "initial friction coefficient mu of the tyres: mu/(1 + b) in front and mu/(1 - b) in the rear, " \
      "where b is tyre_saturation_balance; 0: mu is 1/tyre_saturation_inverse_friction; if both settings " \
      "are 0, the tyres do not saturate; no effect in the paper's filter") \
  REAL("filter.grip_sd", grip_sd, 0.25, 0.0, 0.0, 1.0, "1", \
      "relative sd of grip; no effect in the paper's filter") \
  REAL("filter.initial_spread", initial_spread, 0.07, 0.07, 0.01, 2.0, "1", \
      "initial sample-to-sample sd of a stiffness, relative to nominal: sqrt(Sigma); no effect in the " \
      "default filter") \
  REAL("filter.spread_max", spread_max, 2.0, 2.0, 0.01, 2.0, "1", \
      "max estimated sample-to-sample sd of a stiffness, relative to nominal; a larger estimate would be " \
      "due to sensor noise; 2: no limit (the paper); no effect in the default filter") \
  REAL("filter.spread_kernel", spread_kernel, 0.0, 0.0, 0.0, 0.5, "1", \
      "relative sd of a random factor of mean 1. This factor multiplies the scale matrix Lambda of the " \
      "stiffness covariance of each particle after resampling, so that copies of a particle differ; 0: no" \
      " factor (the paper); no effect in the default filter") \
  REAL("filter.initial_dof", initial_dof, 7.0, 7.0, 6.0, 1000.0, "1", \
      "initial degrees of freedom nu: initial_spread has the weight of this many samples; no effect in " \
      "the default filter") \
  REAL("filter.learnt_floor", learnt_floor, 0.1, 0.1, 0.0, 2.0, "1", \
      "min sd of a mean stiffness that is loaded from an earlier drive, relative to nominal, because the " \
      "road surface may have changed since") \
  REAL("filter.learnt_walk_day", learnt_walk_day, 0.02, 0.02, 0.0, 1.0, "1/sqrt(day)", \
      "random walk of a mean stiffness between drives: sd of its change in one day, relative to nominal, " \
      "caused by wear, pressure, temperature, other tyres") \
  REAL("filter.initial_vel_x", initial_vel_x, 0.0, 0.0, -70.0, 70.0, "m/s", \
      "initial vel_x if initial_vel_x_from_wheels is 0; no effect in the default filter") \
  REAL("filter.initial_vel_x_sd", initial_vel_x_sd, 0.1, 0.1, 0.0, 20.0, "m/s", \
      "sd of the initial vel_x; no effect in the default filter") \
  REAL("filter.initial_vel_y_sd", initial_vel_y_sd, 0.1, 0.1, 0.0, 10.0, "m/s", \
      "sd of the initial vel_y, whose mean is 0; no effect in the default filter") \
  REAL("filter.initial_yaw_rate_sd", initial_yaw_rate_sd, 0.01, 0.01, 0.0, 2.0, "rad/s", \
      "sd of the initial yaw rate; its mean is the first sample of yaw_rate, or 0 if this sample is " \
      "missing; no effect in the default filter") \
  REAL("filter.stiffness_min", stiffness_min, 0.1, 0.1, 0.02, 0.9, "1", \
      "min stiffness, relative to nominal; in the paper's filter with reflect_draws = 0, this limit " \
      "applies only to the initial stiffness") \
  REAL("filter.stiffness_max", stiffness_max, 5.0, 5.0, 1.1, 20.0, "1", \
      "max stiffness, relative to nominal") \
  REAL("filter.hold_speed", hold_speed, 3.0, 3.0, 0.5, 20.0, "m/s", \
      "min wheel speed for learning; below it, and in reverse, stiffness is not updated") \
  REAL("filter.max_steer", max_steer, 0.7, 0.7, 0.05, 1.2, "rad", \
      "max steering angle for learning; beyond it, stiffness is not updated") \
  REAL("filter.max_slip", max_slip, 0.05, 0.05, 0.01, 1.0, "1", \
      "max slip of an axle whose wheels neither lock nor spin; above this limit, the filter reports that " \
      "wheels slide; no effect in the paper's filter") \
  REAL("filter.noise_max", noise_max, 30.0, 30.0, 1.0, 1000.0, "1", \
      "max ratio of the estimated noise sd of a sensor to its setting; a larger estimate is limited to " \
      "this ratio; no effect in the paper's filter") \
  REAL("filter.max_gap", max_gap, 0.25, 0.25, 0.01, 1.0, "s", \
      "max time between rows; after a longer gap, velocities and yaw rate are initialised from the " \
      "sensors again") \
  REAL("filter.valid_sd", valid_sd, 0.1, 0.1, 0.01, 1.0, "1", \
      "max sd of a valid stiffness, relative to its mean (paper's filter: relative to nominal)") \
  REAL("filter.steady_walk", steady_walk, 0.0005, 0.0005, 0.0, 0.1, "1/sqrt(s)", \
      "sd of the relative change of a stiffness in 1 s by wear and temperature (random walk); abrupt " \
      "changes of road or tyres are modelled separately; no effect in the paper's filter") \
  WHOLE("filter.form", form, TSE_DEFAULT_FORM < TSE_LAST_FORM ? TSE_DEFAULT_FORM : TSE_LAST_FORM, \
      TSE_DEFAULT_FORM < TSE_LAST_FORM ? TSE_DEFAULT_FORM : TSE_LAST_FORM, TSE_FIRST_FORM, TSE_LAST_FORM, \
      "", "filter: 0 the default Kalman filter, 1 the paper's particle filter; form 2 of older versions is " \
      "now tse_config_robust()") \
  REAL("filter.cg_height", cg_height, 0.55, 0.0, 0.0, 3.0, "m", \
      "height of the centre of gravity, for the load transfer between the axles; no effect in the paper's" \
      " filter") \
  WHOLE("filter.wheel_signals", wheel_signals, 2, 2, 1, 2, "", \
      "1: both wheel speed channels carry the same signal, the speed of the vehicle, from which no slip " \
      "can be estimated; 2: the channels carry two signals, unless the filter finds that both signals are" \
      " equal; no effect in the paper's filter") \
  WHOLE("filter.driven_axle", driven_axle, 0, 0, 0, 2, "", \
      "driven axle: 0 both or unknown, 1 front, 2 rear; with 1 or 2, the filter assumes that the axle " \
      "that is not driven rolls freely while the car does not brake; no effect in the paper's filter") \
  WHOLE("filter.particles", particles, 500 < TSE_MAX_PARTICLES ? 500 : TSE_MAX_PARTICLES, 500 < \
      TSE_MAX_PARTICLES ? 500 : TSE_MAX_PARTICLES, 16, TSE_MAX_PARTICLES, "", \
      "number of particles; no effect in the default filter") \
  WHOLE("filter.resampling", resampling, 0, 0, 0, 3, "", \
      "method of resampling: 0 systematic, 1 stratified, 2 residual, 3 multinomial; no effect in the " \
      "default filter") \
  WHOLE("filter.integration", integration, 0, 0, 0, 2, "", \
      "integration of equation (7) of the paper between rows: 0 Euler's method with the inputs of the " \
      "previous row (the paper), 1 a second-order method with inputs that change linearly from row to " \
      "row, 2 as 1, but with the steering angle of the previous row; no effect in the default filter") \
  WHOLE("filter.reflect_draws", reflect_draws, 0, 0, 0, 1, "", \
      "1: a stiffness that is drawn below stiffness_min in equation (25) of the paper is reflected at " \
      "stiffness_min; 0: the stiffness is used as drawn (the paper); no effect in the default filter") \
  WHOLE("filter.initial_vel_x_from_wheels", initial_vel_x_from_wheels, 1, 1, 0, 1, "", \
      "1: the initial vel_x is wheel speed times wheel radius, mean of both axles, in the first row; 0: " \
      "the initial vel_x is the setting initial_vel_x; no effect in the default filter") \
  WHOLE("filter.seed", seed, 1, 1, 0, 2147483647, "", \
      "seed of the random numbers; no effect in the default filter")
#define SETTINGS_SIM(REAL, WHOLE) \
  REAL("simulation.wheel_inertia_front", wheel_inertia_front, 2.4, 2.4, 0.05, 500.0, "kg m2", \
      "rotational inertia of both front wheels") \
  REAL("simulation.wheel_inertia_rear", wheel_inertia_rear, 2.4, 2.4, 0.05, 500.0, "kg m2", \
      "rotational inertia of both rear wheels") \
  REAL("simulation.true_cx_front", true_cx_front, 1.0, 1.0, 0.02, 10.0, "1", \
      "mean over time of the front longitudinal stiffness, relative to nominal. The rear longitudinal " \
      "stiffness, relative to nominal, is 1 + f (true_cx_front - 1), where f is the setting " \
      "rear_longitudinal_follows_front") \
  REAL("simulation.true_cy_front", true_cy_front, 1.0, 1.0, 0.02, 10.0, "1", \
      "mean over time of the front cornering stiffness, relative to nominal") \
  REAL("simulation.true_cy_rear", true_cy_rear, 1.0, 1.0, 0.02, 10.0, "1", \
      "mean over time of the rear cornering stiffness, relative to nominal") \
  REAL("simulation.spread_cx_front", spread_cx_front, 0.05, 0.05, 0.0, 0.3, "1", \
      "sd of the front longitudinal stiffness about its mean, relative to this mean; drawn anew in each " \
      "row") \
  REAL("simulation.spread_cy_front", spread_cy_front, 0.05, 0.05, 0.0, 0.3, "1", \
      "sd of the front cornering stiffness about its mean, relative to this mean; drawn anew in each row") \
  REAL("simulation.spread_cy_rear", spread_cy_rear, 0.05, 0.05, 0.0, 0.3, "1", \
      "sd of the rear cornering stiffness about its mean, relative to this mean; drawn anew in each row") \
  REAL("simulation.noise", noise, 1.0, 1.0, 0.0, 100.0, "1", \
      "factor on the noise sds of the IMU in the vehicle settings (accel_x_sd, accel_y_sd, yaw_rate_sd); " \
      "1: the simulated noise has these sds") \
  REAL("simulation.steer_angle_sd", steer_angle_sd, 0.0, 0.0, 0.0, 0.1, "rad", \
      "noise sd of the logged steering angle") \
  REAL("simulation.wheel_speed_sd", wheel_speed_sd, 0.0, 0.0, 0.0, 10.0, "rad/s", \
      "noise sd of the logged wheel speeds") \
  REAL("simulation.true_bias_accel_x", true_bias_accel_x, 0.0, 0.0, -5.0, 5.0, "m/s2", \
      "accel_x bias at the start") \
  REAL("simulation.true_bias_accel_y", true_bias_accel_y, 0.0, 0.0, -5.0, 5.0, "m/s2", \
      "accel_y bias at the start") \
  REAL("simulation.true_bias_yaw_rate", true_bias_yaw_rate, 0.0, 0.0, -0.5, 0.5, "rad/s", \
      "yaw_rate bias at the start") \
  REAL("simulation.bias_walk", bias_walk, 0.0, 0.0, 0.0, 100.0, "1", \
      "factor on the sds of the random walks of the biases in the vehicle settings (accel_x_bias_walk " \
      "...); 0: the simulated biases are constant") \
  REAL("simulation.speed", speed, 20.0, 20.0, 0.0, 70.0, "m/s", \
      "vel_x at the start; the wheels then roll freely") \
  REAL("simulation.vel_y", vel_y, 0.0, 0.0, -20.0, 20.0, "m/s", \
      "vel_y at the start; positive: the car slides to the left") \
  REAL("simulation.friction", friction, 0.0, 0.0, 0.0, 2.0, "1", \
      "friction coefficient at which the tyre forces of an axle saturate; 0: linear tyres") \
  REAL("simulation.substep", substep, 0.001, 0.001, 0.0001, 0.005, "s", "max step of the integration") \
  WHOLE("simulation.hold_inputs", hold_inputs, 0, 0, 0, 1, "", \
      "1: the inputs of a row stay constant until the next row; 0: the inputs change linearly from row to" \
      " row") \
  WHOLE("simulation.seed", seed, 1, 1, 0, 2147483647, "", "seed of the random numbers")
// clang-format on: end of table

/* Settings of tse_config, in the order of its members. */
#define SETTINGS(REAL, WHOLE)                                                                           \
  SETTINGS_VEHICLE(REAL, WHOLE) SETTINGS_UNCERTAINTY(REAL, WHOLE) SETTINGS_SENSORS(REAL, WHOLE)         \
  SETTINGS_LATENCY(REAL, WHOLE) SETTINGS_VELOCITY(REAL, WHOLE) SETTINGS_PEDALS(REAL, WHOLE)             \
  SETTINGS_ROAD(REAL, WHOLE)                                                                            \
  SETTINGS_EFFECTS(REAL, WHOLE) SETTINGS_FORMULA(REAL, WHOLE) SETTINGS_FILTER(REAL, WHOLE)

#define NO_ROW(fmu, name, def, exact, lo, hi, unit, text) /* for REAL or WHOLE: omits the row */

#endif
