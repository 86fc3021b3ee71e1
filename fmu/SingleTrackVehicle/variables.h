/* fmu/SingleTrackVehicle/variables.h - every variable of the FMU, in the order of its value references. Part of model.c. */
#define PARAMETER(group, kind, member, name, def, lo, hi, unit, text) \
  { group "." #name, kind, 'p', (int32_t)offsetof(model, member.name), FMU_NO_RATE, def, lo, hi, unit, text },

const fmu_variable fmu_variables[] = {
#define SIM_INPUT(name, def, lo, hi, unit, text) \
  { #name, 'r', 'i', (int32_t)offsetof(model, u.name), (int32_t)offsetof(model, rate.name), def, lo, hi, unit, text },
#include "tse/sim_input.def"
#undef SIM_INPUT
  { "ramp", 'b', 'p', (int32_t)offsetof(model, ramp), FMU_NO_RATE, 1.0, 1.0, -1.0, "",
    "true: during a step inputs change linearly from where they were, as a driver's do; false: at its start they jump to what was set" },

  /* table: vehicle_parameters */
  { "vehicle.mass", 'r', 'p', (int32_t)offsetof(model, config.mass), FMU_NO_RATE, 1900.0, 50.0, 50000.0, "kg", "vehicle mass" },
  { "vehicle.yaw_inertia", 'r', 'p', (int32_t)offsetof(model, config.yaw_inertia), FMU_NO_RATE, 3000.0, 10.0, 1000000.0, "kg m2", "yaw moment of inertia about the centre of gravity" },
  { "vehicle.lf", 'r', 'p', (int32_t)offsetof(model, config.lf), FMU_NO_RATE, 1.25, 0.1, 10.0, "m", "centre of gravity to front axle" },
  { "vehicle.lr", 'r', 'p', (int32_t)offsetof(model, config.lr), FMU_NO_RATE, 1.5, 0.1, 10.0, "m", "centre of gravity to rear axle" },
  { "vehicle.wheel_radius_front", 'r', 'p', (int32_t)offsetof(model, config.wheel_radius_front), FMU_NO_RATE, 0.33, 0.05, 2.0, "m", "effective rolling radius, front" },
  { "vehicle.wheel_radius_rear", 'r', 'p', (int32_t)offsetof(model, config.wheel_radius_rear), FMU_NO_RATE, 0.33, 0.05, 2.0, "m", "effective rolling radius, rear" },
  { "vehicle.longitudinal_stiffness_front", 'r', 'p', (int32_t)offsetof(model, config.longitudinal_stiffness_front), FMU_NO_RATE, 160000.0, 1000.0, 10000000.0, "N", "nominal longitudinal (slip) stiffness of the front axle" },
  { "vehicle.longitudinal_stiffness_rear", 'r', 'p', (int32_t)offsetof(model, config.longitudinal_stiffness_rear), FMU_NO_RATE, 160000.0, 1000.0, 10000000.0, "N", "nominal longitudinal (slip) stiffness of the rear axle" },
  { "vehicle.cornering_stiffness_front", 'r', 'p', (int32_t)offsetof(model, config.cornering_stiffness_front), FMU_NO_RATE, 120000.0, 1000.0, 10000000.0, "N/rad", "nominal cornering stiffness of the front axle" },
  { "vehicle.cornering_stiffness_rear", 'r', 'p', (int32_t)offsetof(model, config.cornering_stiffness_rear), FMU_NO_RATE, 140000.0, 1000.0, 10000000.0, "N/rad", "nominal cornering stiffness of the rear axle" },
  { "vehicle.rear_longitudinal_follows_front", 'r', 'p', (int32_t)offsetof(model, config.rear_longitudinal_follows_front), FMU_NO_RATE, 1.0, 0.0, 1.0, "1", "share of the front's relative deviation that the rear longitudinal stiffness takes" },
  { "sensors.accel_x_sd", 'r', 'p', (int32_t)offsetof(model, config.accel_x_sd), FMU_NO_RATE, 0.15, 0.001, 10.0, "m/s2", "noise of accel_x, one sample" },
  { "sensors.accel_y_sd", 'r', 'p', (int32_t)offsetof(model, config.accel_y_sd), FMU_NO_RATE, 0.15, 0.001, 10.0, "m/s2", "noise of accel_y, one sample" },
  { "sensors.yaw_rate_sd", 'r', 'p', (int32_t)offsetof(model, config.yaw_rate_sd), FMU_NO_RATE, 0.0034906585039887, 1e-05, 1.0, "rad/s", "noise of yaw_rate, one sample" },
  { "sensors.wheel_noise_sd", 'r', 'p', (int32_t)offsetof(model, config.wheel_noise_sd), FMU_NO_RATE, 0.0, 0.0, 5.0, "rad/s", "noise of the wheel speeds (mean of an axle's two wheels), one sample; form 0" },
  { "sensors.steer_lag_sd", 'r', 'p', (int32_t)offsetof(model, config.steer_lag_sd), FMU_NO_RATE, 0.02, 0.0, 0.2, "s", "how late the steering acts behind the IMU (bus, steering, tyres), or how early: sd of what is not known; 0: not at all; form 0" },
  { "sensors.accel_x_bias_sd", 'r', 'p', (int32_t)offsetof(model, config.accel_x_bias_sd), FMU_NO_RATE, 0.05, 0.0, 5.0, "m/s2", "bias of accel_x at the start" },
  { "sensors.accel_y_bias_sd", 'r', 'p', (int32_t)offsetof(model, config.accel_y_bias_sd), FMU_NO_RATE, 0.05, 0.0, 5.0, "m/s2", "bias of accel_y at the start" },
  { "sensors.yaw_rate_bias_sd", 'r', 'p', (int32_t)offsetof(model, config.yaw_rate_bias_sd), FMU_NO_RATE, 0.002, 0.0, 0.5, "rad/s", "bias of yaw_rate at the start" },
  { "sensors.accel_x_bias_walk", 'r', 'p', (int32_t)offsetof(model, config.accel_x_bias_walk), FMU_NO_RATE, 0.002, 0.0, 1.0, "m/s2/sqrt(s)", "random walk of the accel_x bias (8), (18)" },
  { "sensors.accel_y_bias_walk", 'r', 'p', (int32_t)offsetof(model, config.accel_y_bias_walk), FMU_NO_RATE, 0.002, 0.0, 1.0, "m/s2/sqrt(s)", "random walk of the accel_y bias (8), (18)" },
  { "sensors.yaw_rate_bias_walk", 'r', 'p', (int32_t)offsetof(model, config.yaw_rate_bias_walk), FMU_NO_RATE, 0.0001, 0.0, 0.1, "rad/s/sqrt(s)", "random walk of the yaw_rate bias (8), (18)" },
  { "effects.mass.change", 'r', 'p', (int32_t)offsetof(model, config.mass_change), FMU_NO_RATE, 0.0, -0.5, 1.0, "1", "true mass over the setting's, less one" },
  { "effects.yaw_inertia.change", 'r', 'p', (int32_t)offsetof(model, config.yaw_inertia_change), FMU_NO_RATE, 0.0, -0.5, 1.0, "1", "true yaw inertia over the setting's, less one" },
  { "effects.cg_shift.distance", 'r', 'p', (int32_t)offsetof(model, config.cg_shift_distance), FMU_NO_RATE, 0.0, -0.6, 0.6, "m", "added to lf, taken from lr; at most 9/10 of either" },
  { "effects.wheel_radius.change", 'r', 'p', (int32_t)offsetof(model, config.wheel_radius_change), FMU_NO_RATE, 0.0, -0.1, 0.1, "1", "true rolling radius over the setting's, less one; both axles" },
  { "effects.steering_ratio.change", 'r', 'p', (int32_t)offsetof(model, config.steering_ratio_change), FMU_NO_RATE, 0.0, -0.3, 0.3, "1", "true road-wheel angle over the logged one, less one" },
  { "effects.steering_offset.angle", 'r', 'p', (int32_t)offsetof(model, config.steering_offset_angle), FMU_NO_RATE, 0.0, -0.05, 0.05, "rad", "true road-wheel angle less the logged one" },
  { "effects.steering_delay.time", 'r', 'p', (int32_t)offsetof(model, config.steering_delay_time), FMU_NO_RATE, 0.0, 0.0, 0.2, "s", "the wheels turn this much later than logged" },
  { "effects.steering_lag.time", 'r', 'p', (int32_t)offsetof(model, config.steering_lag_time), FMU_NO_RATE, 0.0, 0.0, 0.5, "s", "time constant from the logged angle to the wheels, of both lags together" },
  { "effects.steering_lag.second", 'r', 'p', (int32_t)offsetof(model, config.steering_lag_second), FMU_NO_RATE, 0.0, 0.0, 1.0, "1", "second lag over the first; 0: one lag only" },
  { "effects.exact_kinematics.share", 'r', 'p', (int32_t)offsetof(model, config.exact_kinematics_share), FMU_NO_RATE, 0.0, 0.0, 1.0, "1", "0: (1)-(4) with small angles, 1: exact, between: a mixture" },
  { "effects.steering_compliance.angle_per_moment", 'r', 'p', (int32_t)offsetof(model, config.steering_compliance_angle_per_moment), FMU_NO_RATE, 0.0, 0.0, 0.001, "rad/(N m)", "steering angle lost per moment about the steering axis" },
  { "effects.steering_compliance.trail", 'r', 'p', (int32_t)offsetof(model, config.steering_compliance_trail), FMU_NO_RATE, 0.03, 0.001, 0.2, "m", "lever of the lateral force about the steering axis" },
  { "effects.rear_roll_steer.gain", 'r', 'p', (int32_t)offsetof(model, config.rear_roll_steer_gain), FMU_NO_RATE, 0.0, -0.5, 0.5, "1", "rear steering angle per roll angle, into the turn" },
  { "effects.rear_roll_steer.roll", 'r', 'p', (int32_t)offsetof(model, config.rear_roll_steer_roll), FMU_NO_RATE, 0.0075, 0.0005, 0.03, "rad s2/m", "roll angle per lateral acceleration" },
  { "effects.rear_roll_steer.frequency", 'r', 'p', (int32_t)offsetof(model, config.rear_roll_steer_frequency), FMU_NO_RATE, 1.5, 0.3, 6.0, "Hz", "natural frequency of the roll" },
  { "effects.rear_roll_steer.damping", 'r', 'p', (int32_t)offsetof(model, config.rear_roll_steer_damping), FMU_NO_RATE, 0.3, 0.05, 2.0, "1", "damping ratio of the roll" },
  { "effects.relaxation.length", 'r', 'p', (int32_t)offsetof(model, config.relaxation_length), FMU_NO_RATE, 0.0, 0.0, 3.0, "m", "way that the slip angle takes to build up" },
  { "effects.longitudinal_relaxation.length", 'r', 'p', (int32_t)offsetof(model, config.longitudinal_relaxation_length), FMU_NO_RATE, 0.0, 0.0, 2.0, "m", "way that the slip takes to build up" },
  { "effects.stiffness_drift.change", 'r', 'p', (int32_t)offsetof(model, config.stiffness_drift_change), FMU_NO_RATE, 0.0, -0.6, 1.0, "1", "of all stiffnesses, when the drift has ended" },
  { "effects.stiffness_drift.time", 'r', 'p', (int32_t)offsetof(model, config.stiffness_drift_time), FMU_NO_RATE, 600.0, 0.001, 36000.0, "s", "how long it drifts; short: a step" },
  { "effects.stiffness_drift.start", 'r', 'p', (int32_t)offsetof(model, config.stiffness_drift_start), FMU_NO_RATE, 0.0, 0.0, 36000.0, "s", "when it begins, from the start" },
  { "effects.combined_slip.factor", 'r', 'p', (int32_t)offsetof(model, config.combined_slip_factor), FMU_NO_RATE, 0.0, 0.0, 2000.0, "1", "k of 1/sqrt(1 + k slip^2)" },
  { "effects.tyre_saturation.inverse_friction", 'r', 'p', (int32_t)offsetof(model, config.tyre_saturation_inverse_friction), FMU_NO_RATE, 0.0, 0.0, 5.0, "1", "1/friction: axle load over the most lateral force" },
  { "effects.tyre_saturation.shape", 'r', 'p', (int32_t)offsetof(model, config.tyre_saturation_shape), FMU_NO_RATE, 0.0, 0.0, 1.0, "1", "0: brush model with parabolic pressure, 1: root, which saturates later and harder" },
  { "effects.longitudinal_load_transfer.gain", 'r', 'p', (int32_t)offsetof(model, config.longitudinal_load_transfer_gain), FMU_NO_RATE, 0.0, -0.08, 0.08, "s2/m", "cornering stiffness per accel_x: less in front, more in the rear" },
  { "effects.lateral_load_transfer.gain", 'r', 'p', (int32_t)offsetof(model, config.lateral_load_transfer_gain), FMU_NO_RATE, 0.0, -0.003, 0.03, "s4/m2", "k of C (1 - k accel_y^2)" },
  { "effects.lateral_load_transfer.balance", 'r', 'p', (int32_t)offsetof(model, config.lateral_load_transfer_balance), FMU_NO_RATE, 0.0, -1.0, 1.0, "1", "front k (1 + balance), rear k (1 - balance): which axle carries the roll" },
  { "effects.aero_drag.coefficient", 'r', 'p', (int32_t)offsetof(model, config.aero_drag_coefficient), FMU_NO_RATE, 0.0, 0.0, 5.0, "kg/m", "force per speed squared: 1/2 rho cd A" },
  { "effects.rolling_resistance.coefficient", 'r', 'p', (int32_t)offsetof(model, config.rolling_resistance_coefficient), FMU_NO_RATE, 0.0, 0.0, 0.2, "1", "force per weight, against the motion" },
  { "effects.grade.angle", 'r', 'p', (int32_t)offsetof(model, config.grade_angle), FMU_NO_RATE, 0.0, -0.35, 0.35, "rad", "slope of the road, uphill > 0; replay adds a profile" },
  { "effects.bank.angle", 'r', 'p', (int32_t)offsetof(model, config.bank_angle), FMU_NO_RATE, 0.0, -0.35, 0.35, "rad", "left side of the road high > 0; replay adds a profile" },
  { "effects.bank.superelevation", 'r', 'p', (int32_t)offsetof(model, config.bank_superelevation), FMU_NO_RATE, 0.0, -0.5, 0.5, "1", "share of speed times yaw rate that the road's lean into its curves takes over" },
  { "effects.crosswind.speed", 'r', 'p', (int32_t)offsetof(model, config.crosswind_speed), FMU_NO_RATE, 0.0, -30.0, 30.0, "m/s", "steady wind, pushing to the left at the heading of the start > 0" },
  { "effects.crosswind.heading", 'r', 'p', (int32_t)offsetof(model, config.crosswind_heading), FMU_NO_RATE, 0.0, -3.2, 3.2, "rad", "heading at the start from where the wind is a side wind" },
  { "effects.crosswind.coefficient", 'r', 'p', (int32_t)offsetof(model, config.crosswind_coefficient), FMU_NO_RATE, 2.8, 0.1, 30.0, "kg/m", "side force per wind times air speed" },
  { "effects.crosswind.arm", 'r', 'p', (int32_t)offsetof(model, config.crosswind_arm), FMU_NO_RATE, 0.45, -3.0, 3.0, "m", "centre of pressure before the centre of gravity" },
  { "effects.conicity.front", 'r', 'p', (int32_t)offsetof(model, config.conicity_front), FMU_NO_RATE, 0.0, -2000.0, 2000.0, "N", "side force of the front axle without slip" },
  { "effects.conicity.rear", 'r', 'p', (int32_t)offsetof(model, config.conicity_rear), FMU_NO_RATE, 0.0, -2000.0, 2000.0, "N", "side force of the rear axle without slip" },
  { "effects.aligning_moment.trail", 'r', 'p', (int32_t)offsetof(model, config.aligning_moment_trail), FMU_NO_RATE, 0.0, -0.2, 0.2, "m", "lateral forces act this far behind the axles" },
  { "effects.imu_lever_arm.x", 'r', 'p', (int32_t)offsetof(model, config.imu_lever_arm_x), FMU_NO_RATE, 0.0, -4.0, 4.0, "m", "IMU before the centre of gravity" },
  { "effects.imu_lever_arm.y", 'r', 'p', (int32_t)offsetof(model, config.imu_lever_arm_y), FMU_NO_RATE, 0.0, -2.0, 2.0, "m", "IMU left of the centre of gravity" },
  { "effects.body_roll.gain", 'r', 'p', (int32_t)offsetof(model, config.body_roll_gain), FMU_NO_RATE, 0.0, -0.02, 0.04, "rad s2/m", "roll angle per lateral acceleration" },
  { "effects.body_roll.frequency", 'r', 'p', (int32_t)offsetof(model, config.body_roll_frequency), FMU_NO_RATE, 1.5, 0.3, 6.0, "Hz", "natural frequency" },
  { "effects.body_roll.damping", 'r', 'p', (int32_t)offsetof(model, config.body_roll_damping), FMU_NO_RATE, 0.3, 0.05, 2.0, "1", "damping ratio" },
  { "effects.body_roll.height", 'r', 'p', (int32_t)offsetof(model, config.body_roll_height), FMU_NO_RATE, 0.0, -1.0, 1.5, "m", "IMU above the roll axis" },
  { "effects.body_roll.coupling", 'r', 'p', (int32_t)offsetof(model, config.body_roll_coupling), FMU_NO_RATE, 0.0, -0.5, 1.0, "m", "sprung mass over mass times height of its centre of gravity above the roll axis: it pushes the car" },
  { "effects.pitch_leak.gain", 'r', 'p', (int32_t)offsetof(model, config.pitch_leak_gain), FMU_NO_RATE, 0.0, -0.01, 0.03, "rad s2/m", "pitch angle per longitudinal acceleration, nose up > 0" },
  { "effects.pitch_leak.frequency", 'r', 'p', (int32_t)offsetof(model, config.pitch_leak_frequency), FMU_NO_RATE, 1.8, 0.3, 6.0, "Hz", "natural frequency" },
  { "effects.pitch_leak.damping", 'r', 'p', (int32_t)offsetof(model, config.pitch_leak_damping), FMU_NO_RATE, 0.4, 0.05, 2.0, "1", "damping ratio" },
  { "effects.pitch_leak.height", 'r', 'p', (int32_t)offsetof(model, config.pitch_leak_height), FMU_NO_RATE, 0.0, -1.0, 1.5, "m", "IMU above the pitch axis" },
  { "effects.imu_misalignment.angle", 'r', 'p', (int32_t)offsetof(model, config.imu_misalignment_angle), FMU_NO_RATE, 0.0, -0.2, 0.2, "rad", "IMU turned to the left > 0" },
  { "effects.imu_scale_ax.error", 'r', 'p', (int32_t)offsetof(model, config.imu_scale_ax_error), FMU_NO_RATE, 0.0, -0.3, 0.3, "1", "reading over true, less one" },
  { "effects.imu_scale_ay.error", 'r', 'p', (int32_t)offsetof(model, config.imu_scale_ay_error), FMU_NO_RATE, 0.0, -0.3, 0.3, "1", "reading over true, less one" },
  { "effects.gyro_scale.error", 'r', 'p', (int32_t)offsetof(model, config.gyro_scale_error), FMU_NO_RATE, 0.0, -0.3, 0.3, "1", "reading over true, less one" },
  { "effects.imu_delay.time", 'r', 'p', (int32_t)offsetof(model, config.imu_delay_time), FMU_NO_RATE, 0.0, 0.0, 0.2, "s", "readings are this much older than inputs" },
  { "effects.formula_gain", 'r', 'p', (int32_t)offsetof(model, config.formula_gain), FMU_NO_RATE, 0.0, -10.0, 10.0, "1", "times a formula of the user (tse/formula.def); 0: none" },
  { "effects.formula_a", 'r', 'p', (int32_t)offsetof(model, config.formula_a), FMU_NO_RATE, 0.0, -1000000.0, 1000000.0, "1", "number a of the formula, in its own unit" },
  { "effects.formula_b", 'r', 'p', (int32_t)offsetof(model, config.formula_b), FMU_NO_RATE, 0.0, -1000000.0, 1000000.0, "1", "number b of the formula, in its own unit" },
  { "effects.formula_c", 'r', 'p', (int32_t)offsetof(model, config.formula_c), FMU_NO_RATE, 0.0, -1000000.0, 1000000.0, "1", "number c of the formula, in its own unit" },
  { "effects.formula_d", 'r', 'p', (int32_t)offsetof(model, config.formula_d), FMU_NO_RATE, 0.0, -1000000.0, 1000000.0, "1", "number d of the formula, in its own unit" },
  { "effects.formula_e", 'r', 'p', (int32_t)offsetof(model, config.formula_e), FMU_NO_RATE, 0.0, -1000000.0, 1000000.0, "1", "number e of the formula, in its own unit" },
  { "effects.formula_f", 'r', 'p', (int32_t)offsetof(model, config.formula_f), FMU_NO_RATE, 0.0, -1000000.0, 1000000.0, "1", "number f of the formula, in its own unit" },
  { "effects.formula_g", 'r', 'p', (int32_t)offsetof(model, config.formula_g), FMU_NO_RATE, 0.0, -1000000.0, 1000000.0, "1", "number g of the formula, in its own unit" },
  { "effects.formula_h", 'r', 'p', (int32_t)offsetof(model, config.formula_h), FMU_NO_RATE, 0.0, -1000000.0, 1000000.0, "1", "number h of the formula, in its own unit" },
  { "effects.formula_place", 'i', 'p', (int32_t)offsetof(model, config.formula_place), FMU_NO_RATE, 0, 0, 9, "", "where it is added: code of FORMULA_PLACE in tse/formula.def" },
  { "effects.formula_code_1", 'i', 'p', (int32_t)offsetof(model, config.formula_code_1), FMU_NO_RATE, 0, 0, 16777215, "", "operations 1 .. 3 of the formula, a byte each, the lowest first" },
  { "effects.formula_code_2", 'i', 'p', (int32_t)offsetof(model, config.formula_code_2), FMU_NO_RATE, 0, 0, 16777215, "", "operations 4 .. 6" },
  { "effects.formula_code_3", 'i', 'p', (int32_t)offsetof(model, config.formula_code_3), FMU_NO_RATE, 0, 0, 16777215, "", "operations 7 .. 9" },
  { "effects.formula_code_4", 'i', 'p', (int32_t)offsetof(model, config.formula_code_4), FMU_NO_RATE, 0, 0, 16777215, "", "operations 10 .. 12" },
  { "effects.formula_code_5", 'i', 'p', (int32_t)offsetof(model, config.formula_code_5), FMU_NO_RATE, 0, 0, 16777215, "", "operations 13 .. 15" },
  { "effects.formula_code_6", 'i', 'p', (int32_t)offsetof(model, config.formula_code_6), FMU_NO_RATE, 0, 0, 16777215, "", "operations 16 .. 18" },
  { "effects.formula_code_7", 'i', 'p', (int32_t)offsetof(model, config.formula_code_7), FMU_NO_RATE, 0, 0, 16777215, "", "operations 19 .. 21" },
  { "effects.formula_code_8", 'i', 'p', (int32_t)offsetof(model, config.formula_code_8), FMU_NO_RATE, 0, 0, 16777215, "", "operations 22 .. 24" },
  { "effects.formula_code_9", 'i', 'p', (int32_t)offsetof(model, config.formula_code_9), FMU_NO_RATE, 0, 0, 16777215, "", "operations 25 .. 27" },
  { "effects.formula_code_10", 'i', 'p', (int32_t)offsetof(model, config.formula_code_10), FMU_NO_RATE, 0, 0, 16777215, "", "operations 28 .. 30" },
  { "effects.formula_code_11", 'i', 'p', (int32_t)offsetof(model, config.formula_code_11), FMU_NO_RATE, 0, 0, 16777215, "", "operations 31 .. 33" },
  /* end of table */
#define REAL(name, def, lo, hi, unit, text) PARAMETER("simulation", 'r', sim_config, name, def, lo, hi, unit, text)
#define INT(name, def, lo, hi, text) PARAMETER("simulation", 'i', sim_config, name, def, lo, hi, "", text)
#include "tse/sim.def"
#undef REAL
#undef INT

#define INPUT(name, lo, hi, unit, kind, text) OUTPUT("sensor." #name, 'r', y.row.name, unit, text ", as logged")
#include "tse/input.def"
#undef INPUT
#define SIM_OUTPUT(group, name, member, unit, text) OUTPUT(#group "." #name, 'r', y.member, unit, text)
#define SIM_STIFFNESS(group, name, member, si, unit, text) OUTPUT(#group "." #name, 'r', si, unit, text)
#include "tse/sim_output.def"
#undef SIM_OUTPUT
#define SIM_OUTPUT(group, name, member, unit, text)
#define SIM_STIFFNESS(group, name, member, si, unit, text) \
  OUTPUT(#group ".relative." #name, 'r', y.member, "1", text ", relative to nominal")
#include "tse/sim_output.def"
#undef SIM_OUTPUT
};
const int32_t fmu_variable_count = (int32_t)(sizeof fmu_variables / sizeof fmu_variables[0]);

