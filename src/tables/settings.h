/* tables/settings.h - lists of all settings. Settings, tse_describe() and the FMUs generate
 * their rows from them.
 *   REAL, WHOLE(name in an FMU, member, default, exact, min, max, unit, text)
 *   EFFECT_PARAMETERS  ROW(REAL, effect, parameter, default, exact, min, max, unit, text,
 *                      strength, sign, typical min, typical max, negligible);
 *                      the last five as in tse_effect_parameter
 * default: of an ordinary car; exact: of a car whose parameters are known exactly, without
 * effects (tse_config_exact()). Internal to the sources. */
#ifndef TABLES_SETTINGS_H
#define TABLES_SETTINGS_H

// clang-format off: table effect_parameters
#define EFFECT_PARAMETERS(ROW, REAL) \
  ROW(REAL, mass, change, 0.0, 0.0, -0.5, 1.0, "1", "true mass over the setting's, less one", 1, 0, 0.1, \
      0.2, 0.03) \
  ROW(REAL, yaw_inertia, change, 0.0, 0.0, -0.5, 1.0, "1", "true yaw inertia over the setting's, less one", \
      1, 0, 0.1, 0.2, 0.03) \
  ROW(REAL, cg_shift, distance, 0.0, 0.0, -0.6, 0.6, "m", \
      "added to lf, taken from lr; at most 9/10 of either", 1, 0, 0.05, 0.15, 0.02) \
  ROW(REAL, wheel_radius, change, 0.0, 0.0, -0.1, 0.1, "1", \
      "true rolling radius over the setting's, less one; both axles", 1, 0, 0.01, 0.025, 0.002) \
  ROW(REAL, steering_ratio, change, 0.0, 0.0, -0.3, 0.3, "1", \
      "true road-wheel angle over the logged one, less one", 1, 0, 0.02, 0.06, 0.005) \
  ROW(REAL, steering_offset, angle, 0.0, 0.0, -0.05, 0.05, "rad", \
      "true road-wheel angle less the logged one", 1, 0, 0.0017, 0.0087, 0.0003) \
  ROW(REAL, steering_delay, time, 0.0, 0.0, 0.0, 0.2, "s", "the wheels turn this much later than logged", 1, \
      1, 0.01, 0.04, 0.002) \
  ROW(REAL, steering_lag, time, 0.02, 0.0, 0.0, 0.5, "s", \
      "time constant from the logged angle to the wheels, of both lags together", 1, 1, 0.02, 0.06, 0.003) \
  ROW(REAL, steering_lag, second, 0.0, 0.0, 0.0, 1.0, "1", "second lag over the first; 0: one lag only", 0, \
      1, 0.0, 1.0, 0.0) \
  ROW(REAL, exact_kinematics, share, 1.0, 1.0, 0.0, 1.0, "1", \
      "0: (1)-(4) with small angles, 1: exact, between: a mixture", 1, 1, 1.0, 1.0, 0.2) \
  ROW(REAL, steering_compliance, angle_per_moment, 0.0, 0.0, 0.0, 0.001, "rad/(N m)", \
      "steering angle lost per moment about the steering axis", 1, 1, 3.5e-05, 8.7e-05, 1e-05) \
  ROW(REAL, steering_compliance, trail, 0.03, 0.03, 0.001, 0.2, "m", \
      "lever of the lateral force about the steering axis", -1, 1, 0.02, 0.05, 0.0) \
  ROW(REAL, rear_roll_steer, gain, 0.0, 0.0, -0.5, 0.5, "1", \
      "rear steering angle per roll angle, into the turn", 1, 1, 0.03, 0.1, 0.01) \
  ROW(REAL, rear_roll_steer, roll, 0.0075, 0.0075, 0.0005, 0.03, "rad s2/m", \
      "roll angle per lateral acceleration", -1, 1, 0.0053, 0.0107, 0.0) \
  ROW(REAL, rear_roll_steer, frequency, 1.5, 1.5, 0.3, 6.0, "Hz", "natural frequency of the roll", 0, 1, \
      1.2, 2.0, 0.0) \
  ROW(REAL, rear_roll_steer, damping, 0.3, 0.3, 0.05, 2.0, "1", "damping ratio of the roll", 0, 1, 0.2, 0.4, \
      0.0) \
  ROW(REAL, relaxation, length, 0.4, 0.0, 0.0, 3.0, "m", "way that the slip angle takes to build up", 1, 1, \
      0.3, 0.7, 0.05) \
  ROW(REAL, longitudinal_relaxation, length, 0.0, 0.0, 0.0, 2.0, "m", "way that the slip takes to build up", \
      1, 1, 0.1, 0.4, 0.02) \
  ROW(REAL, stiffness_drift, change, 0.0, 0.0, -0.6, 1.0, "1", \
      "of all stiffnesses, when the drift has ended", 1, 0, 0.05, 0.15, 0.01) \
  ROW(REAL, stiffness_drift, time, 600.0, 600.0, 0.001, 36000.0, "s", "how long it drifts; short: a step", \
      -1, 1, 30.0, 3600.0, 0.0) \
  ROW(REAL, stiffness_drift, start, 0.0, 0.0, 0.0, 36000.0, "s", "when it begins, from the start", -1, 1, \
      0.0, 600.0, 0.0) \
  ROW(REAL, combined_slip, factor, 0.0, 0.0, 0.0, 2000.0, "1", "k of 1/sqrt(1 + k slip^2)", 1, 1, 50.0, \
      100.0, 10.0) \
  ROW(REAL, tyre_saturation, inverse_friction, 0.0, 0.0, 0.0, 5.0, "1", \
      "1/friction: axle load over the most lateral force", 1, 1, 0.9, 1.0, 0.2) \
  ROW(REAL, tyre_saturation, shape, 1.0, 0.0, 0.0, 1.0, "1", \
      "0: brush model with parabolic pressure, 1: as magic-formula tyres, which saturate later and harder", \
      0, 1, 0.0, 1.0, 0.0) \
  ROW(REAL, tyre_saturation, balance, 0.0, 0.0, -0.5, 0.5, "1", \
      "front 1/friction (1 + balance), rear 1/friction (1 - balance): which axle ends first", 0, 0, -0.15, \
      0.15, 0.0) \
  ROW(REAL, longitudinal_load_transfer, gain, 0.02, 0.0, -0.08, 0.08, "s2/m", \
      "k: cornering stiffness per accel_x, less in front, more in the rear", 1, 1, 0.02, 0.04, 0.004) \
  ROW(REAL, longitudinal_load_transfer, balance, 0.0, 0.0, -1.0, 1.0, "1", \
      "front k (1 + balance), rear k (1 - balance): tyres of the axle that carries more gain less by a " \
      "load", 0, 0, -0.3, 0.3, 0.0) \
  ROW(REAL, lateral_load_transfer, gain, 0.002, 0.0, -0.003, 0.03, "s4/m2", "k of C (1 - k accel_y^2)", 1, \
      1, 0.002, 0.005, 0.0004) \
  ROW(REAL, lateral_load_transfer, balance, 0.0, 0.0, -1.0, 1.0, "1", \
      "front k (1 + balance), rear k (1 - balance): which axle carries the roll", 0, 0, -0.3, 0.3, 0.0) \
  ROW(REAL, aero_drag, coefficient, 0.4, 0.0, 0.0, 5.0, "kg/m", "force per speed squared: 1/2 rho cd A", 1, \
      1, 0.35, 0.45, 0.1) \
  ROW(REAL, rolling_resistance, coefficient, 0.01, 0.0, 0.0, 0.2, "1", \
      "force per weight, against the motion", 1, 1, 0.008, 0.015, 0.003) \
  ROW(REAL, grade, angle, 0.0, 0.0, -0.35, 0.35, "rad", \
      "slope of the road, uphill > 0; replay adds a profile", 1, 0, 0.01, 0.06, 0.005) \
  ROW(REAL, bank, angle, 0.0, 0.0, -0.35, 0.35, "rad", \
      "left side of the road high > 0; replay adds a profile", 1, 0, 0.015, 0.03, 0.003) \
  ROW(REAL, bank, superelevation, 0.1, 0.0, -0.5, 0.5, "1", \
      "share of speed times yaw rate that the road's lean into its curves takes over", 1, 1, 0.05, 0.2, \
      0.03) \
  ROW(REAL, crosswind, speed, 0.0, 0.0, -30.0, 30.0, "m/s", \
      "steady wind, pushing to the left at the heading of the start > 0", 1, 0, 3.0, 10.0, 1.0) \
  ROW(REAL, crosswind, heading, 0.0, 0.0, -3.2, 3.2, "rad", \
      "heading at the start from where the wind is a side wind", -1, 0, -3.2, 3.2, 0.0) \
  ROW(REAL, crosswind, coefficient, 2.8, 2.8, 0.1, 30.0, "kg/m", "side force per wind times air speed", -1, \
      1, 2.0, 4.0, 0.0) \
  ROW(REAL, crosswind, arm, 0.45, 0.45, -3.0, 3.0, "m", "centre of pressure before the centre of gravity", \
      0, 0, 0.3, 0.6, 0.0) \
  ROW(REAL, conicity, front, 0.0, 0.0, -2000.0, 2000.0, "N", "side force of the front axle without slip", 1, \
      0, 50.0, 150.0, 20.0) \
  ROW(REAL, conicity, rear, 0.0, 0.0, -2000.0, 2000.0, "N", "side force of the rear axle without slip", 1, \
      0, 50.0, 150.0, 20.0) \
  ROW(REAL, aligning_moment, trail, 0.03, 0.0, -0.2, 0.2, "m", \
      "lateral forces act this far behind the axles", 1, 1, 0.02, 0.04, 0.005) \
  ROW(REAL, imu_lever_arm, x, 0.0, 0.0, -4.0, 4.0, "m", "IMU before the centre of gravity", 1, 0, 0.2, 0.8, \
      0.05) \
  ROW(REAL, imu_lever_arm, y, 0.0, 0.0, -2.0, 2.0, "m", "IMU left of the centre of gravity", 1, 0, 0.2, 0.8, \
      0.05) \
  ROW(REAL, body_roll, gain, 0.006, 0.0, -0.02, 0.04, "rad s2/m", "roll angle per lateral acceleration", 1, \
      1, 0.0053, 0.0107, 0.0008) \
  ROW(REAL, body_roll, frequency, 1.6, 1.5, 0.3, 6.0, "Hz", "natural frequency", 0, 1, 1.2, 2.0, 0.0) \
  ROW(REAL, body_roll, damping, 0.3, 0.3, 0.05, 2.0, "1", "damping ratio", 0, 1, 0.2, 0.4, 0.0) \
  ROW(REAL, body_roll, height, 0.0, 0.0, -1.0, 1.5, "m", \
      "IMU above the roll axis, less coupling: above the centre of gravity", 0, 0, 0.0, 0.6, 0.0) \
  ROW(REAL, body_roll, coupling, 0.4, 0.0, -0.5, 1.0, "m", \
      "sprung mass over mass times height of its centre of gravity above the roll axis: it pushes the car", \
      0, 1, 0.0, 0.5, 0.0) \
  ROW(REAL, pitch_leak, gain, 0.0, 0.0, -0.01, 0.03, "rad s2/m", \
      "pitch angle per longitudinal acceleration, nose up > 0", 1, 1, 0.0027, 0.0053, 0.0006) \
  ROW(REAL, pitch_leak, frequency, 1.8, 1.8, 0.3, 6.0, "Hz", "natural frequency", 0, 1, 1.4, 2.2, 0.0) \
  ROW(REAL, pitch_leak, damping, 0.4, 0.4, 0.05, 2.0, "1", "damping ratio", 0, 1, 0.2, 0.5, 0.0) \
  ROW(REAL, pitch_leak, height, 0.0, 0.0, -1.0, 1.5, "m", "IMU above the pitch axis", 0, 0, 0.0, 0.6, 0.0) \
  ROW(REAL, imu_misalignment, angle, 0.0, 0.0, -0.2, 0.2, "rad", "IMU turned to the left > 0", 1, 0, 0.017, \
      0.052, 0.004) \
  ROW(REAL, imu_scale_ax, error, 0.0, 0.0, -0.3, 0.3, "1", "reading over true, less one", 1, 0, 0.01, 0.05, \
      0.005) \
  ROW(REAL, imu_scale_ay, error, 0.0, 0.0, -0.3, 0.3, "1", "reading over true, less one", 1, 0, 0.01, 0.05, \
      0.005) \
  ROW(REAL, gyro_scale, error, 0.0, 0.0, -0.3, 0.3, "1", "reading over true, less one", 1, 0, 0.01, 0.03, \
      0.003) \
  ROW(REAL, imu_delay, time, 0.0, 0.0, 0.0, 0.2, "s", "readings are this much older than inputs", 1, 1, \
      0.01, 0.03, 0.002)
// clang-format on: end of table
#define EFFECT_SETTING(REAL, effect, parameter, def, exact, lo, hi, unit, text, ...) \
  REAL("effects." #effect "." #parameter, effect##_##parameter, def, exact, lo, hi, unit, text)
#define SETTINGS_EFFECTS(REAL, WHOLE) EFFECT_PARAMETERS(EFFECT_SETTING, REAL)

// clang-format off: table settings_lists
#define SETTINGS_VEHICLE(REAL, WHOLE) \
  REAL("vehicle.mass", mass, 0.0, 1900.0, 50.0, 50000.0, "kg", \
      "vehicle mass; 0: not known, then no stiffness is valid") \
  REAL("vehicle.yaw_inertia", yaw_inertia, 0.0, 3000.0, 10.0, 1000000.0, "kg m2", \
      "yaw moment of inertia about the centre of gravity; 0: mass lf lr") \
  REAL("vehicle.lf", lf, 1.25, 1.25, 0.1, 10.0, "m", "centre of gravity to front axle") \
  REAL("vehicle.lr", lr, 1.5, 1.5, 0.1, 10.0, "m", "centre of gravity to rear axle") \
  REAL("vehicle.wheel_radius_front", wheel_radius_front, 0.33, 0.33, 0.05, 2.0, "m", \
      "effective rolling radius, front") \
  REAL("vehicle.wheel_radius_rear", wheel_radius_rear, 0.33, 0.33, 0.05, 2.0, "m", \
      "effective rolling radius, rear") \
  REAL("vehicle.longitudinal_stiffness_front", longitudinal_stiffness_front, 0.0, 160000.0, 1000.0, \
      10000000.0, "N", \
      "nominal longitudinal (slip) stiffness of the front axle; 0: of its class, by its load") \
  REAL("vehicle.longitudinal_stiffness_rear", longitudinal_stiffness_rear, 0.0, 160000.0, 1000.0, \
      10000000.0, "N", \
      "nominal longitudinal (slip) stiffness of the rear axle; 0: of its class, by its load") \
  REAL("vehicle.cornering_stiffness_front", cornering_stiffness_front, 0.0, 120000.0, 1000.0, 10000000.0, \
      "N/rad", "nominal cornering stiffness of the front axle; 0: of its class, by its load") \
  REAL("vehicle.cornering_stiffness_rear", cornering_stiffness_rear, 0.0, 140000.0, 1000.0, 10000000.0, \
      "N/rad", "nominal cornering stiffness of the rear axle; 0: of its class, by its load") \
  REAL("vehicle.rear_longitudinal_follows_front", rear_longitudinal_follows_front, 1.0, 1.0, 0.0, 1.0, "1", \
      "share of the front's relative deviation that the rear longitudinal stiffness takes; paper's filter")
#define SETTINGS_UNCERTAINTY(REAL, WHOLE) \
  REAL("uncertainty.mass_sd", mass_sd, 0.05, 0.0, 0.0, 0.5, "1", \
      "sd of mass, relative, yaw_inertia with it") \
  REAL("uncertainty.yaw_inertia_sd", yaw_inertia_sd, 0.1, 0.0, 0.0, 0.5, "1", "sd of yaw_inertia, relative") \
  REAL("uncertainty.cg_sd", cg_sd, 0.03, 0.0, 0.0, 1.0, "m", \
      "sd of where the centre of gravity lies between the axles") \
  REAL("uncertainty.steer_ratio_sd", steer_ratio_sd, 0.03, 0.0, 0.0, 0.5, "1", \
      "sd of the scale of steer_angle: steering ratio, compliance") \
  REAL("uncertainty.steer_offset_sd", steer_offset_sd, 0.006, 0.0, 0.0, 0.1, "rad", \
      "sd of a constant offset of steer_angle") \
  REAL("uncertainty.accel_y_scale_sd", accel_y_scale_sd, 0.03, 0.0, 0.0, 0.5, "1", \
      "sd of the scale of accel_y: body roll adds to it") \
  REAL("uncertainty.wheel_delay_sd", wheel_delay_sd, 0.02, 0.0, 0.0, 0.2, "s", \
      "sd of how late the wheel speeds are behind the IMU") \
  REAL("uncertainty.accel_delay_sd", accel_delay_sd, 0.003, 0.0, 0.0, 0.2, "s", \
      "sd of how late the accelerometers are behind the gyro") \
  REAL("uncertainty.relaxation_sd", relaxation_sd, 0.2, 0.0, 0.0, 2.0, "m", \
      "sd of the relaxation length of each axle") \
  REAL("uncertainty.lean_sd", lean_sd, 0.1, 0.0, 0.0, 0.5, "1", \
      "sd of the share of speed times yaw rate by which roads lean into their curves") \
  REAL("uncertainty.gyro_scale_sd", gyro_scale_sd, 0.01, 0.0, 0.0, 0.2, "1", "sd of the scale of yaw_rate") \
  REAL("uncertainty.trail_sd", trail_sd, 0.03, 0.0, 0.0, 0.2, "m", \
      "sd of how far the lateral forces act behind the axles") \
  REAL("uncertainty.roll_steer_sd", roll_steer_sd, 0.04, 0.0, 0.0, 0.5, "1", \
      "sd of the rear axle's roll steer") \
  REAL("uncertainty.wheel_radius_sd", wheel_radius_sd, 0.005, 0.0, 0.0, 0.2, "1", \
      "sd of the wheel radius rear over front, relative") \
  REAL("uncertainty.model_sd", model_sd, 0.12, 0.0, 0.0, 0.5, "1", \
      "model discrepancy: sd of what the model does not explain of a channel, as a share of what happens," \
      " lasting about a second") \
  REAL("uncertainty.grade_sd", grade_sd, 0.03, 0.0, 0.0, 0.3, "rad", \
      "sd of road grade, a state: v_x' = a_x - g grade, accel_x reads a_x")
#define SETTINGS_SENSORS(REAL, WHOLE) \
  REAL("sensors.accel_x_sd", accel_x_sd, 0.1, 0.15, 0.001, 10.0, "m/s2", "noise of accel_x, one sample") \
  REAL("sensors.accel_y_sd", accel_y_sd, 0.1, 0.15, 0.001, 10.0, "m/s2", "noise of accel_y, one sample") \
  REAL("sensors.yaw_rate_sd", yaw_rate_sd, 0.0025, 0.0034906585039887, 1e-05, 1.0, "rad/s", \
      "noise of yaw_rate, one sample") \
  REAL("sensors.wheel_noise_sd", wheel_noise_sd, 0.04, 0.0, 0.0, 5.0, "rad/s", \
      "noise of the wheel speeds (mean of an axle's two wheels), one sample; default filter") \
  REAL("sensors.steer_lag_sd", steer_lag_sd, 0.025, 0.02, 0.0, 0.2, "s", \
      "how late the steering acts behind the IMU (bus, steering, tyres), or how early: sd of what is not " \
      "known; 0: not at all; default filter") \
  REAL("sensors.accel_x_bias_sd", accel_x_bias_sd, 0.2, 0.05, 0.0, 5.0, "m/s2", \
      "bias of accel_x at the start") \
  REAL("sensors.accel_y_bias_sd", accel_y_bias_sd, 0.2, 0.05, 0.0, 5.0, "m/s2", \
      "bias of accel_y at the start") \
  REAL("sensors.yaw_rate_bias_sd", yaw_rate_bias_sd, 0.01, 0.002, 0.0, 0.5, "rad/s", \
      "bias of yaw_rate at the start") \
  REAL("sensors.accel_x_bias_walk", accel_x_bias_walk, 0.002, 0.002, 0.0, 1.0, "m/s2/sqrt(s)", \
      "random walk of the accel_x bias (8), (18)") \
  REAL("sensors.accel_y_bias_walk", accel_y_bias_walk, 0.002, 0.002, 0.0, 1.0, "m/s2/sqrt(s)", \
      "random walk of the accel_y bias (8), (18)") \
  REAL("sensors.yaw_rate_bias_walk", yaw_rate_bias_walk, 0.0001, 0.0001, 0.0, 0.1, "rad/s/sqrt(s)", \
      "random walk of the yaw_rate bias (8), (18)")
#define SETTINGS_LATENCY(REAL, WHOLE) \
  REAL("latency.steer_angle_latency", steer_angle_latency, 0.0, 0.0, -0.2, 0.2, "s", \
      "how much later than yaw_rate steer_angle is logged; below 0: earlier") \
  REAL("latency.wheel_speed_front_latency", wheel_speed_front_latency, 0.0, 0.0, -0.2, 0.2, "s", \
      "how much later than yaw_rate wheel_speed_front is logged") \
  REAL("latency.wheel_speed_rear_latency", wheel_speed_rear_latency, 0.0, 0.0, -0.2, 0.2, "s", \
      "how much later than yaw_rate wheel_speed_rear is logged") \
  REAL("latency.accel_x_latency", accel_x_latency, 0.0, 0.0, -0.2, 0.2, "s", \
      "how much later than yaw_rate accel_x is logged") \
  REAL("latency.accel_y_latency", accel_y_latency, 0.0, 0.0, -0.2, 0.2, "s", \
      "how much later than yaw_rate accel_y is logged")
#define SETTINGS_VELOCITY(REAL, WHOLE) \
  REAL("velocity.ins_velocity_sd", ins_velocity_sd, 0.1, 0.1, 0.001, 10.0, "m/s", \
      "error of ins_vel_x and ins_vel_y, one value; the noise is found while driving") \
  REAL("velocity.gnss_speed_sd", gnss_speed_sd, 0.1, 0.1, 0.001, 10.0, "m/s", \
      "error of gnss_speed, one value") \
  REAL("velocity.gnss_course_sd", gnss_course_sd, 0.01, 0.01, 0.0001, 1.0, "rad", \
      "error of gnss_course, one value, above 10 m/s; below in inverse proportion to the speed") \
  REAL("velocity.velocity_latency", velocity_latency, 0.0, 0.0, -0.2, 0.2, "s", \
      "latency of measured velocities behind yaw_rate") \
  REAL("velocity.velocity_latency_sd", velocity_latency_sd, 0.03, 0.03, 0.0, 0.2, "s", "its sd") \
  REAL("velocity.velocity_lever_x", velocity_lever_x, 0.0, 0.0, -20.0, 20.0, "m", \
      "where the antenna, or the place that the INS speaks of, is before the centre of gravity") \
  REAL("velocity.velocity_lever_y", velocity_lever_y, 0.0, 0.0, -20.0, 20.0, "m", \
      "the same, to the left of it") \
  REAL("velocity.velocity_lever_sd", velocity_lever_sd, 0.1, 0.1, 0.0, 5.0, "m", "sd of both") \
  REAL("velocity.velocity_heading", velocity_heading, 0.0, 0.0, -0.5, 0.5, "rad", \
      "how far the axes of the INS are turned to the left of the car's") \
  REAL("velocity.velocity_heading_sd", velocity_heading_sd, 0.02, 0.02, 0.0, 0.5, "rad", "its sd") \
  REAL("velocity.velocity_scale_sd", velocity_scale_sd, 0.02, 0.02, 0.0, 0.2, "1", \
      "sd of the scale of a measured speed over that of the wheels: both wheel radii")
#define SETTINGS_PEDALS(REAL, WHOLE) \
  REAL("pedals.wheel_torque_least", wheel_torque_least, 60.0, 60.0, 1.0, 2000.0, "Nm", \
      "an axle with less torque than this rolls freely: two sd of its offset and noise")
#define SETTINGS_ROAD(REAL, WHOLE) \
  REAL("road.road_sd", road_sd, 0.005, 0.005, 0.0, 0.3, "rad", \
      "sd of a given bank and grade: laps of one road agree that well")
#define SETTINGS_FORMULA(REAL, WHOLE) \
  REAL("effects.formula_gain", formula_gain, 0.0, 0.0, -10.0, 10.0, "1", \
      "times a formula of the user; 0: none") \
  REAL("effects.formula_a", formula_a, 0.0, 0.0, -1000000.0, 1000000.0, "1", \
      "number a of the formula, in its own unit") \
  REAL("effects.formula_b", formula_b, 0.0, 0.0, -1000000.0, 1000000.0, "1", \
      "number b of the formula, in its own unit") \
  REAL("effects.formula_c", formula_c, 0.0, 0.0, -1000000.0, 1000000.0, "1", \
      "number c of the formula, in its own unit") \
  REAL("effects.formula_d", formula_d, 0.0, 0.0, -1000000.0, 1000000.0, "1", \
      "number d of the formula, in its own unit") \
  REAL("effects.formula_e", formula_e, 0.0, 0.0, -1000000.0, 1000000.0, "1", \
      "number e of the formula, in its own unit") \
  REAL("effects.formula_f", formula_f, 0.0, 0.0, -1000000.0, 1000000.0, "1", \
      "number f of the formula, in its own unit") \
  REAL("effects.formula_g", formula_g, 0.0, 0.0, -1000000.0, 1000000.0, "1", \
      "number g of the formula, in its own unit") \
  REAL("effects.formula_h", formula_h, 0.0, 0.0, -1000000.0, 1000000.0, "1", \
      "number h of the formula, in its own unit") \
  WHOLE("effects.formula_place", formula_place, 0, 0, 0, 9, "", "where it is added: code of a place") \
  WHOLE("effects.formula_code_1", formula_code_1, 0, 0, 0, 16777215, "", \
      "operations 1 .. 3 of the formula, a byte each, the lowest first") \
  WHOLE("effects.formula_code_2", formula_code_2, 0, 0, 0, 16777215, "", "operations 4 .. 6") \
  WHOLE("effects.formula_code_3", formula_code_3, 0, 0, 0, 16777215, "", "operations 7 .. 9") \
  WHOLE("effects.formula_code_4", formula_code_4, 0, 0, 0, 16777215, "", "operations 10 .. 12") \
  WHOLE("effects.formula_code_5", formula_code_5, 0, 0, 0, 16777215, "", "operations 13 .. 15") \
  WHOLE("effects.formula_code_6", formula_code_6, 0, 0, 0, 16777215, "", "operations 16 .. 18") \
  WHOLE("effects.formula_code_7", formula_code_7, 0, 0, 0, 16777215, "", "operations 19 .. 21") \
  WHOLE("effects.formula_code_8", formula_code_8, 0, 0, 0, 16777215, "", "operations 22 .. 24") \
  WHOLE("effects.formula_code_9", formula_code_9, 0, 0, 0, 16777215, "", "operations 25 .. 27") \
  WHOLE("effects.formula_code_10", formula_code_10, 0, 0, 0, 16777215, "", "operations 28 .. 30") \
  WHOLE("effects.formula_code_11", formula_code_11, 0, 0, 0, 16777215, "", "operations 31 .. 33")
#define SETTINGS_FILTER(REAL, WHOLE) \
  REAL("filter.sample_time", sample_time, 0.01, 0.01, 0.001, 0.1, "s", "nominal time between rows") \
  REAL("filter.forgetting", forgetting, 0.99, 0.99, 0.9, 0.9999, "1", \
      "lambda of (17) per nominal sample; memory 1/(1 - lambda) samples; paper's filter") \
  REAL("filter.forgetting_mean", forgetting_mean, 0.0, 0.0, 0.0, 0.9999, "1", \
      "lambda of the mean, of gamma in (17), per nominal sample; 0: forgetting (the paper); paper's filter") \
  REAL("filter.forgetting_change", forgetting_change, 1.0, 1.0, 0.5, 1.0, "1", \
      "what lambda of the mean falls to where innovations last, as after a change of road; 1: it does not" \
      " (the paper); paper's filter") \
  REAL("filter.resample_threshold", resample_threshold, 0.5, 0.5, 0.0, 1.0, "1", \
      "resample when N_eff falls to this share of the particles; paper's filter") \
  REAL("filter.initial_cx_front", initial_cx_front, 1.0, 1.0, 0.2, 4.0, "1", \
      "start of the front longitudinal stiffness, share of nominal") \
  REAL("filter.initial_cy_front", initial_cy_front, 1.0, 1.0, 0.2, 4.0, "1", \
      "start of the front cornering stiffness, share of nominal") \
  REAL("filter.initial_cy_rear", initial_cy_rear, 1.0, 1.0, 0.2, 4.0, "1", \
      "start of the rear cornering stiffness, share of nominal") \
  REAL("filter.initial_mean_sd", initial_mean_sd, 0.3, 0.3, 0.0, 2.0, "1", \
      "how uncertain the start of the mean is: sqrt(gamma Sigma), relative to nominal; paper's filter") \
  REAL("filter.initial_cx_sd", initial_cx_sd, 0.3, 0.3, 0.0, 2.0, "1", \
      "sd of the start of the longitudinal stiffness, relative; default filter") \
  REAL("filter.initial_cy_front_sd", initial_cy_front_sd, 0.25, 0.3, 0.0, 2.0, "1", \
      "sd of the start of the front cornering stiffness, relative; default filter") \
  REAL("filter.initial_cy_rear_sd", initial_cy_rear_sd, 0.25, 0.3, 0.0, 2.0, "1", \
      "sd of the start of the rear cornering stiffness, relative; default filter") \
  REAL("filter.grip", grip, 1.0, 0.0, 0.0, 50.0, "1", \
      "friction of the tyres at the start; 0: 1/tyre_saturation_inverse_friction, or tyres without an end" \
      " where that is 0; of each axle by tyre_saturation_balance; default filter") \
  REAL("filter.grip_sd", grip_sd, 0.25, 0.0, 0.0, 1.0, "1", "its sd, relative; default filter") \
  REAL("filter.initial_spread", initial_spread, 0.07, 0.07, 0.01, 2.0, "1", \
      "sample-to-sample sd assumed at the start: sqrt(Sigma), relative to nominal; paper's filter") \
  REAL("filter.spread_max", spread_max, 2.0, 2.0, 0.01, 2.0, "1", \
      "the learnt spread is kept at or below this, relative to nominal: what exceeds it is sensor noise, " \
      "not tyre; 2: no limit (the paper); paper's filter") \
  REAL("filter.spread_kernel", spread_kernel, 0.0, 0.0, 0.0, 0.5, "1", \
      "Lambda of a particle that was resampled is scaled by a random factor of this relative sd and mean " \
      "one, so that copies differ; 0: it is not (the paper); paper's filter") \
  REAL("filter.initial_dof", initial_dof, 7.0, 7.0, 6.0, 1000.0, "1", \
      "degrees of freedom nu at the start: samples' worth of trust in initial_spread; paper's filter") \
  REAL("filter.learnt_floor", learnt_floor, 0.1, 0.1, 0.0, 2.0, "1", \
      "no mean stiffness learnt in an earlier drive is trusted more than this (sd, relative to nominal): " \
      "the road may be another") \
  REAL("filter.learnt_walk_day", learnt_walk_day, 0.02, 0.02, 0.0, 1.0, "1/sqrt(day)", \
      "random walk of a mean stiffness between drives, relative to nominal: wear, pressure, temperature, " \
      "other tyres") \
  REAL("filter.initial_vel_x", initial_vel_x, 0.0, 0.0, -70.0, 70.0, "m/s", \
      "start of vel_x, used when initial_vel_x_from_wheels is 0; paper's filter") \
  REAL("filter.initial_vel_x_sd", initial_vel_x_sd, 0.1, 0.1, 0.0, 20.0, "m/s", \
      "how uncertain the start of vel_x is; paper's filter") \
  REAL("filter.initial_vel_y_sd", initial_vel_y_sd, 0.1, 0.1, 0.0, 10.0, "m/s", \
      "how uncertain the start of vel_y is (mean 0); paper's filter") \
  REAL("filter.initial_yaw_rate_sd", initial_yaw_rate_sd, 0.01, 0.01, 0.0, 2.0, "rad/s", \
      "how uncertain the start of yaw_rate is (mean: first sample, else 0); paper's filter") \
  REAL("filter.stiffness_min", stiffness_min, 0.1, 0.1, 0.02, 0.9, "1", \
      "no stiffness falls below this share of nominal; paper's filter without reflect_draws: only at its " \
      "start") \
  REAL("filter.stiffness_max", stiffness_max, 5.0, 5.0, 1.1, 20.0, "1", \
      "no stiffness rises above this share of nominal") \
  REAL("filter.hold_speed", hold_speed, 3.0, 3.0, 0.5, 20.0, "m/s", \
      "below this wheel speed, and in reverse, statistics are held") \
  REAL("filter.max_steer", max_steer, 0.7, 0.7, 0.05, 1.2, "rad", \
      "beyond this steering angle nothing is learnt") \
  REAL("filter.max_slip", max_slip, 0.05, 0.05, 0.01, 1.0, "1", \
      "beyond this slip of an axle its wheels lock or spin; default filter") \
  REAL("filter.noise_max", noise_max, 30.0, 30.0, 1.0, 1000.0, "1", \
      "what the sensors' sd as found may be over the setting's; 1: the settings are believed; default " \
      "filter") \
  REAL("filter.max_gap", max_gap, 0.25, 0.25, 0.01, 1.0, "s", "longer gaps between rows restart the states") \
  REAL("filter.valid_sd", valid_sd, 0.1, 0.1, 0.01, 1.0, "1", \
      "a stiffness is valid up to this sd of the mean, relative to the mean (paper's filter: to nominal)") \
  REAL("filter.steady_walk", steady_walk, 0.0005, 0.0005, 0.0, 0.1, "1/sqrt(s)", \
      "random walk of a stiffness that nothing changes, relative: wear, warmth; default filter") \
  WHOLE("filter.form", form, TSE_DEFAULT_FORM < TSE_LAST_FORM ? TSE_DEFAULT_FORM : TSE_LAST_FORM, \
      TSE_DEFAULT_FORM < TSE_LAST_FORM ? TSE_DEFAULT_FORM : TSE_LAST_FORM, TSE_FIRST_FORM, TSE_LAST_FORM, \
      "", \
      "0: the car's Kalman filter; 1: the paper's particle filter. 2, the same with a watchdog, is gone: " \
      "see tse_config_robust()") \
  REAL("filter.cg_height", cg_height, 0.55, 0.0, 0.0, 3.0, "m", \
      "height of the centre of gravity: load goes from axle to axle with the acceleration; default filter") \
  WHOLE("filter.wheel_signals", wheel_signals, 2, 2, 1, 2, "", \
      "1: both wheel speeds are one signal, the speed of the vehicle, which does not show slip; default " \
      "filter") \
  WHOLE("filter.driven_axle", driven_axle, 0, 0, 0, 2, "", \
      "0 both or unknown, 1 front, 2 rear: the other rolls freely while the car does not brake; default " \
      "filter") \
  WHOLE("filter.particles", particles, 500 < TSE_MAX_PARTICLES ? 500 : TSE_MAX_PARTICLES, 500 < \
      TSE_MAX_PARTICLES ? 500 : TSE_MAX_PARTICLES, 16, TSE_MAX_PARTICLES, "", \
      "particles in use; paper's filter") \
  WHOLE("filter.resampling", resampling, 0, 0, 0, 3, "", \
      "0 systematic, 1 stratified, 2 residual, 3 multinomial; paper's filter") \
  WHOLE("filter.integration", integration, 0, 0, 0, 2, "", \
      "of (7) between rows: 0 Euler, inputs held (the paper); 1 second order, inputs linear; 2 second " \
      "order, the steering angle held; paper's filter") \
  WHOLE("filter.reflect_draws", reflect_draws, 0, 0, 0, 1, "", \
      "1: a draw of (25) below stiffness_min is reflected at it; 0: it is not (the paper); paper's filter") \
  WHOLE("filter.initial_vel_x_from_wheels", initial_vel_x_from_wheels, 1, 1, 0, 1, "", \
      "1: vel_x starts at the mean of the wheel speeds; paper's filter") \
  WHOLE("filter.seed", seed, 1, 1, 0, 2147483647, "", "seed of the random numbers; paper's filter")
#define SETTINGS_SIM(REAL, WHOLE) \
  REAL("simulation.wheel_inertia_front", wheel_inertia_front, 2.4, 2.4, 0.05, 500.0, "kg m2", \
      "rotational inertia of both front wheels") \
  REAL("simulation.wheel_inertia_rear", wheel_inertia_rear, 2.4, 2.4, 0.05, 500.0, "kg m2", \
      "rotational inertia of both rear wheels") \
  REAL("simulation.true_cx_front", true_cx_front, 1.0, 1.0, 0.02, 10.0, "1", \
      "mean longitudinal stiffness, share of nominal (rear follows as the settings say)") \
  REAL("simulation.true_cy_front", true_cy_front, 1.0, 1.0, 0.02, 10.0, "1", \
      "mean front cornering stiffness, share of nominal") \
  REAL("simulation.true_cy_rear", true_cy_rear, 1.0, 1.0, 0.02, 10.0, "1", \
      "mean rear cornering stiffness, share of nominal") \
  REAL("simulation.spread_cx_front", spread_cx_front, 0.05, 0.05, 0.0, 0.3, "1", \
      "sample-to-sample sd of the stiffness, share of its mean") \
  REAL("simulation.spread_cy_front", spread_cy_front, 0.05, 0.05, 0.0, 0.3, "1", \
      "sample-to-sample sd of the stiffness, share of its mean") \
  REAL("simulation.spread_cy_rear", spread_cy_rear, 0.05, 0.05, 0.0, 0.3, "1", \
      "sample-to-sample sd of the stiffness, share of its mean") \
  REAL("simulation.noise", noise, 1.0, 1.0, 0.0, 100.0, "1", \
      "true sensor noise over the sd in the settings") \
  REAL("simulation.steer_angle_sd", steer_angle_sd, 0.0, 0.0, 0.0, 0.1, "rad", \
      "noise of the logged steering angle") \
  REAL("simulation.wheel_speed_sd", wheel_speed_sd, 0.0, 0.0, 0.0, 10.0, "rad/s", \
      "noise of the logged wheel speeds") \
  REAL("simulation.true_bias_accel_x", true_bias_accel_x, 0.0, 0.0, -5.0, 5.0, "m/s2", \
      "accel_x bias at the start") \
  REAL("simulation.true_bias_accel_y", true_bias_accel_y, 0.0, 0.0, -5.0, 5.0, "m/s2", \
      "accel_y bias at the start") \
  REAL("simulation.true_bias_yaw_rate", true_bias_yaw_rate, 0.0, 0.0, -0.5, 0.5, "rad/s", \
      "yaw_rate bias at the start") \
  REAL("simulation.bias_walk", bias_walk, 0.0, 0.0, 0.0, 100.0, "1", \
      "random walk of the true biases over the walk in the settings") \
  REAL("simulation.speed", speed, 20.0, 20.0, 0.0, 70.0, "m/s", "vel_x at the start; wheels roll freely") \
  REAL("simulation.vel_y", vel_y, 0.0, 0.0, -20.0, 20.0, "m/s", \
      "vel_y at the start: above 0 the car slides to the left") \
  REAL("simulation.friction", friction, 0.0, 0.0, 0.0, 2.0, "1", \
      "friction coefficient at which the tyre forces of an axle saturate; 0: linear tyres") \
  REAL("simulation.substep", substep, 0.001, 0.001, 0.0001, 0.005, "s", "longest integration step") \
  WHOLE("simulation.hold_inputs", hold_inputs, 0, 0, 0, 1, "", \
      "1: the driver's inputs are held from row to row; 0: they change linearly between rows") \
  WHOLE("simulation.seed", seed, 1, 1, 0, 2147483647, "", "seed of the random numbers")
// clang-format on: end of table

/* tse_config, in the order of its members */
#define SETTINGS(REAL, WHOLE)                                                                           \
  SETTINGS_VEHICLE(REAL, WHOLE) SETTINGS_UNCERTAINTY(REAL, WHOLE) SETTINGS_SENSORS(REAL, WHOLE)         \
  SETTINGS_LATENCY(REAL, WHOLE) SETTINGS_VELOCITY(REAL, WHOLE) SETTINGS_PEDALS(REAL, WHOLE)             \
  SETTINGS_ROAD(REAL, WHOLE)                                                                            \
  SETTINGS_EFFECTS(REAL, WHOLE) SETTINGS_FORMULA(REAL, WHOLE) SETTINGS_FILTER(REAL, WHOLE)

#define NO_ROW(fmu, name, def, exact, lo, hi, unit, text) /* skips a row */

#endif
