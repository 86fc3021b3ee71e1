/* tables/columns.h - lists of all channels, outputs, status and reason codes, as macros
 * whose arguments are macros: CHANNELS(ROW) expands to ROW(...) for each channel. Range
 * checks, texts, tse_describe() and the FMUs each define their own ROW. The lists, with
 * the macros that they take as arguments:
 *   CHANNELS, VELOCITIES, PEDALS, ROADS
 *                 columns of a log. ROW(name, drives, min, max, unit, text); drives is 1
 *                 if the channel is an input of the model of the car, and 0 if it is a
 *                 measurement
 *   DRIVER        ROW(name, default, min, max, unit, text); inputs of the simulator
 *   OUTPUTS       NUMBER(name, member, unit, text)
 *                 FLAG(name, member, text)
 *                 CODE(name, member, enumeration, text)
 *                 STIFFNESS(name, member, member of an FMU, unit, text); `member` is
 *                 relative to the nominal stiffness, the member of an FMU in N or N/rad
 *                 REASON(name, member, member of an FMU that is 1 if the estimate is
 *                 valid, estimated quantity to which the reason code belongs)
 *   STATUSES, REASON_CODES
 *                 ROW(name, word, text)
 *   REPLAY_START  stiffness, biases and initial motion with which the model replays a
 *                 log. ROW(name, default, unit, text)
 *   TRUTHS        true values that the simulator logs: NUMBER and STIFFNESS as above, but
 *                 with an additional first argument, the prefix of the column. The prefix
 *                 is `drawn` for the stiffness that the simulator draws at random for each
 *                 row, and `true` for all other values
 * Internal to the sources. */
#ifndef TABLES_COLUMNS_H
#define TABLES_COLUMNS_H

// clang-format off: table columns
#define CHANNELS(ROW) \
  ROW(steer_angle, 1, -1.2, 1.2, "rad", "mean road-wheel angle of the front axle, positive left") \
  ROW(wheel_speed_front, 1, -400.0, 400.0, "rad/s", \
      "mean rotation rate of the front wheels, positive forward") \
  ROW(wheel_speed_rear, 1, -400.0, 400.0, "rad/s", \
      "mean rotation rate of the rear wheels, positive forward") \
  ROW(accel_x, 0, -50.0, 50.0, "m/s2", "specific force at the centre of gravity, positive forward") \
  ROW(accel_y, 0, -50.0, 50.0, "m/s2", "specific force at the centre of gravity, positive left") \
  ROW(yaw_rate, 0, -6.0, 6.0, "rad/s", "yaw rate, positive left (counter-clockwise from above)")
#define VELOCITIES(ROW) \
  ROW(ins_vel_x, 0, -120.0, 120.0, "m/s", \
      "longitudinal velocity of the reference point of an INS or an optical sensor (settings " \
      "velocity_lever_...)") \
  ROW(ins_vel_y, 0, -60.0, 60.0, "m/s", \
      "lateral velocity of the reference point of an INS or an optical sensor, positive left") \
  ROW(gnss_speed, 0, 0.0, 120.0, "m/s", "speed over ground") \
  ROW(gnss_course, 0, -7.0, 7.0, "rad", \
      "direction of the motion over ground, positive left (counter-clockwise from above), relative to any" \
      " fixed direction")
#define PEDALS(ROW) \
  ROW(brake, 0, 0.0, 1.0, "1", \
      "1: the car brakes, 0: it does not; a value counts as 1 from 0.5 on; if missing, accel_x decides " \
      "whether the car brakes") \
  ROW(wheel_torque_front, 0, -20000.0, 20000.0, "Nm", \
      "drive torque minus brake torque, sum of both front wheels") \
  ROW(wheel_torque_rear, 0, -20000.0, 20000.0, "Nm", \
      "drive torque minus brake torque, sum of both rear wheels")
#define ROADS(ROW) \
  ROW(bank, 0, -0.35, 0.35, "rad", \
      "bank of the road, positive if the left side is higher. It includes the superelevation of a curve, " \
      "and is used in place of the settings bank_angle and bank_superelevation") \
  ROW(grade, 0, -0.35, 0.35, "rad", \
      "grade of the road, positive uphill, used in place of the setting grade_angle")
#define DRIVER(ROW) \
  ROW(steer_angle, 0.0, -1.2, 1.2, "rad", "road-wheel angle of the front axle, positive left") \
  ROW(wheel_torque_front, 0.0, -100000.0, 100000.0, "Nm", \
      "drive torque of the front axle, positive forward; unlike a brake torque, a negative drive torque " \
      "can make the wheels rotate backwards") \
  ROW(wheel_torque_rear, 0.0, -100000.0, 100000.0, "Nm", \
      "drive torque of the rear axle, positive forward; unlike a brake torque, a negative drive torque " \
      "can make the wheels rotate backwards") \
  ROW(brake_torque_front, 0.0, 0.0, 100000.0, "Nm", \
      "brake torque of the front axle; it opposes the rotation and holds the wheels at standstill") \
  ROW(brake_torque_rear, 0.0, 0.0, 100000.0, "Nm", \
      "brake torque of the rear axle; it opposes the rotation and holds the wheels at standstill") \
  ROW(road_level, 1.0, 0.02, 10.0, "1", \
      "factor by which this road surface changes the mean stiffness of all tyres; 1: dry road") \
  ROW(road_friction, 0.0, 0.0, 2.0, "1", \
      "friction coefficient at which the tyre forces of an axle saturate; 0: value of the setting friction") \
  ROW(bank, 0.0, -0.35, 0.35, "rad", \
      "bank of the road, positive if the left side is higher, added to the setting bank_angle") \
  ROW(grade, 0.0, -0.35, 0.35, "rad", \
      "grade of the road, positive uphill, added to the setting grade_angle")
#define OUTPUTS(NUMBER, FLAG, CODE, STIFFNESS, REASON) \
  NUMBER(vel_x, vel_x, "m/s", "longitudinal velocity of the centre of gravity") \
  NUMBER(vel_x_sd, vel_x_sd, "m/s", "standard deviation of vel_x") \
  NUMBER(vel_y, vel_y, "m/s", "lateral velocity of the centre of gravity") \
  NUMBER(vel_y_sd, vel_y_sd, "m/s", "standard deviation of vel_y") \
  NUMBER(yaw_rate, yaw_rate, "rad/s", "yaw rate") \
  NUMBER(yaw_rate_sd, yaw_rate_sd, "rad/s", "standard deviation of yaw_rate") \
  NUMBER(sideslip, sideslip, "rad", \
      "sideslip angle atan2(vel_y, vel_x) at the centre of gravity; 0 at standstill") \
  NUMBER(sideslip_sd, sideslip_sd, "rad", "standard deviation of sideslip") \
  NUMBER(grip, grip, "1", \
      "friction coefficient of the tyres: max lateral force of an axle / its load. If the setting " \
      "tyre_saturation_balance is not 0, the axles have different coefficients, and grip is their " \
      "harmonic mean; default filter only") \
  NUMBER(grip_sd, grip_sd, "1", "standard deviation of grip") \
  REASON(grip, grip_reason, grip_valid, "the grip") \
  STIFFNESS(cx_front, stiffness[0], mean[0], "N", "mean longitudinal stiffness of the front axle") \
  STIFFNESS(cx_front_sd, stiffness_sd[0], sd[0], "N", "standard deviation of cx_front") \
  STIFFNESS(cx_front_spread, stiffness_spread[0], spread[0], "N", \
      "default filter: setting model_sd times the stiffness; paper's filter: sample-to-sample sd of the " \
      "stiffness, sqrt(Sigma), where Sigma is the covariance of the process noise") \
  FLAG(cx_front_spread_seen, spread_seen[0], \
      "1: the spread is learnt. 0 in the default filter, where the spread follows from the setting " \
      "model_sd, and in the paper's filter while the stiffness is not valid") \
  REASON(cx_front, reason[0], valid[0], "the stiffness") \
  STIFFNESS(cy_front, stiffness[1], mean[1], "N/rad", "mean cornering stiffness of the front axle") \
  STIFFNESS(cy_front_sd, stiffness_sd[1], sd[1], "N/rad", "standard deviation of cy_front") \
  STIFFNESS(cy_front_spread, stiffness_spread[1], spread[1], "N/rad", \
      "default filter: setting model_sd times the stiffness; paper's filter: sample-to-sample sd of the " \
      "stiffness, sqrt(Sigma), where Sigma is the covariance of the process noise") \
  FLAG(cy_front_spread_seen, spread_seen[1], \
      "1: the spread is learnt. 0 in the default filter, where the spread follows from the setting " \
      "model_sd, and in the paper's filter while the stiffness is not valid") \
  REASON(cy_front, reason[1], valid[1], "the stiffness") \
  STIFFNESS(cy_rear, stiffness[2], mean[2], "N/rad", "mean cornering stiffness of the rear axle") \
  STIFFNESS(cy_rear_sd, stiffness_sd[2], sd[2], "N/rad", "standard deviation of cy_rear") \
  STIFFNESS(cy_rear_spread, stiffness_spread[2], spread[2], "N/rad", \
      "default filter: setting model_sd times the stiffness; paper's filter: sample-to-sample sd of the " \
      "stiffness, sqrt(Sigma), where Sigma is the covariance of the process noise") \
  FLAG(cy_rear_spread_seen, spread_seen[2], \
      "1: the spread is learnt. 0 in the default filter, where the spread follows from the setting " \
      "model_sd, and in the paper's filter while the stiffness is not valid") \
  REASON(cy_rear, reason[2], valid[2], "the stiffness") \
  NUMBER(bias_accel_x, bias[0], "m/s2", "bias of accel_x: measured minus true value") \
  NUMBER(bias_accel_x_sd, bias_sd[0], "m/s2", "standard deviation of bias_accel_x") \
  NUMBER(bias_accel_y, bias[1], "m/s2", "bias of accel_y: measured minus true value") \
  NUMBER(bias_accel_y_sd, bias_sd[1], "m/s2", "standard deviation of bias_accel_y") \
  NUMBER(bias_yaw_rate, bias[2], "rad/s", "bias of yaw_rate: measured minus true value") \
  NUMBER(bias_yaw_rate_sd, bias_sd[2], "rad/s", "standard deviation of bias_yaw_rate") \
  NUMBER(noise_accel_x, noise[0], "1", "estimated noise sd of accel_x / its setting; default filter only") \
  NUMBER(noise_accel_y, noise[1], "1", "estimated noise sd of accel_y / its setting") \
  NUMBER(noise_yaw_rate, noise[2], "1", "estimated noise sd of yaw_rate / its setting") \
  NUMBER(noise_wheel_front, noise[3], "1", "estimated noise sd of wheel_speed_front / its setting") \
  NUMBER(noise_wheel_rear, noise[4], "1", "estimated noise sd of wheel_speed_rear / its setting") \
  NUMBER(p_steady, regime[TSE_REGIME_STEADY], "1", \
      "probability that no channel is faulty, no wheel locks or spins, and within the last 2 s neither " \
      "has a stiffness changed nor has the filter started over") \
  NUMBER(p_changed, regime[TSE_REGIME_CHANGED], "1", \
      "probability that the stiffness of all tyres has changed within the last 2 s: a different road " \
      "surface") \
  NUMBER(p_axle, regime[TSE_REGIME_AXLE], "1", \
      "probability that the stiffness of one axle has changed within the last 2 s") \
  NUMBER(p_fault, regime[TSE_REGIME_FAULT], "1", \
      "probability that a channel has an offset, is frozen or noisy") \
  NUMBER(p_sliding, regime[TSE_REGIME_SLIDING], "1", "probability that wheels lock or spin") \
  NUMBER(p_restarted, regime[TSE_REGIME_RESTARTED], "1", \
      "probability that the filter started over within the last 2 s") \
  NUMBER(change_age, change_age, "s", "time since the last change (change_kind); 0 before the first change") \
  NUMBER(change_probability, change_probability, "1", \
      "probability that since the last change (change_kind) no further change, sliding or sensor fault " \
      "has begun; 0 before the first change") \
  CODE(change_kind, change_kind, "ChangeKind", \
      "kind of the last change: 0 none yet, 1 road (all tyres), 2 front axle, 3 rear axle, 4 the filter " \
      "started over") \
  NUMBER(change_cx_front, change_ratio[0], "1", \
      "longitudinal stiffness now / before the last change; 1 before the first change") \
  NUMBER(change_cy_front, change_ratio[1], "1", \
      "front cornering stiffness now / before the last change; 1 before the first change") \
  NUMBER(change_cy_rear, change_ratio[2], "1", \
      "rear cornering stiffness now / before the last change; 1 before the first change") \
  CODE(fault_channel, fault_channel, "FaultChannel", \
      "number of the channel that contradicts the other channels or, if there is none, of the channel " \
      "that most probably has a fault: 1 steer_angle, 2 wheel_speed_front, 3 wheel_speed_rear, 4 accel_x," \
      " 5 accel_y, 6 yaw_rate; from 7 on the optional channels in the order of the constants " \
      "TSE_OPTIONAL_...; 0: no such channel") \
  NUMBER(discrepancy_accel_x, discrepancy[0], "m/s2", \
      "sd of the model discrepancy of accel_x, the part that the model does not explain: setting model_sd" \
      " times the recent rms of accel_x") \
  NUMBER(discrepancy_accel_y, discrepancy[1], "m/s2", "sd of the model discrepancy of accel_y") \
  NUMBER(discrepancy_yaw_rate, discrepancy[2], "rad/s", "sd of the model discrepancy of yaw_rate") \
  NUMBER(innovation_accel_x, innovation[0], "m/s2", \
      "innovation of accel_x: measured minus predicted value; 0 if accel_x was not used; default filter " \
      "only") \
  NUMBER(innovation_accel_y, innovation[1], "m/s2", "innovation of accel_y") \
  NUMBER(innovation_yaw_rate, innovation[2], "rad/s", "innovation of yaw_rate") \
  NUMBER(innovation_wheel_front, innovation[3], "m/s", \
      "innovation of the circumferential speed (wheel speed times radius) of the front wheels") \
  NUMBER(innovation_wheel_rear, innovation[4], "m/s", \
      "innovation of the circumferential speed (wheel speed times radius) of the rear wheels") \
  NUMBER(nis_accel_x, nis[0], "1", \
      "normalised innovation squared of accel_x. Model errors cause a slowly varying part of the " \
      "innovation, which is estimated and subtracted first. The mean of nis over many rows is 1 if model " \
      "and settings fit. 0: accel_x was not used in this row; default filter only") \
  NUMBER(nis_accel_y, nis[1], "1", "normalised innovation squared of accel_y") \
  NUMBER(nis_yaw_rate, nis[2], "1", "normalised innovation squared of yaw_rate") \
  NUMBER(nis_wheel_front, nis[3], "1", "normalised innovation squared of the front wheel speed") \
  NUMBER(nis_wheel_rear, nis[4], "1", "normalised innovation squared of the rear wheel speed") \
  NUMBER(lag_steer, lag_steer, "s", \
      "estimated time from the logged steering angle to its effect in the IMU, caused by bus, steering " \
      "and tyres together; negative: the angle is logged late; default filter only") \
  NUMBER(lag_steer_sd, lag_steer_sd, "s", "standard deviation of lag_steer") \
  NUMBER(estimate_age, estimate_age, "s", \
      "age of the estimates: time of this row minus the time to which they refer; above 0 if the filter " \
      "waits for channels with a latency (settings ..._latency)") \
  NUMBER(n_eff, n_eff, "1", \
      "effective number of particles, 1/sum q^2 of their weights q; default filter: 1") \
  NUMBER(log_evidence, log_evidence, "nat", \
      "log likelihood of the measurements of this row, given all earlier rows; 0 if no measurement was " \
      "used") \
  CODE(status, status, "Status", \
      "0: ok; positive: the code of a warning (tse_status); use a stiffness only if it is valid") \
  STIFFNESS(cx_front_secant, stiffness_secant[0], secant[0], "N", \
      "secant longitudinal stiffness of the front axle: force / slip at the slip and load of this row") \
  STIFFNESS(cy_front_secant, stiffness_secant[1], secant[1], "N/rad", \
      "secant cornering stiffness of the front axle: force / slip angle at the slip and load of this row") \
  STIFFNESS(cy_rear_secant, stiffness_secant[2], secant[2], "N/rad", \
      "secant cornering stiffness of the rear axle: force / slip angle at the slip and load of this row") \
  NUMBER(fault_factor, fault_factor, "1", \
      "factor by which the channel that contradicts the others (fault_channel) is too large, such as 57.3" \
      " for degrees in place of radians, or -1 for a wrong sign; 0: no channel contradicts the others, or" \
      " its error is not a factor: front and rear wheel speeds are exchanged, or the channel is constant " \
      "or late")
#define TRUTHS(NUMBER, STIFFNESS) \
  NUMBER(true, vel_x, vel_x, "m/s", "longitudinal velocity of the centre of gravity") \
  NUMBER(true, vel_y, vel_y, "m/s", "lateral velocity of the centre of gravity") \
  NUMBER(true, yaw_rate, yaw_rate, "rad/s", "yaw rate") \
  NUMBER(true, accel_x, accel_x, "m/s2", "longitudinal specific force without noise and bias") \
  NUMBER(true, accel_y, accel_y, "m/s2", "lateral specific force without noise and bias") \
  NUMBER(true, wheel_speed_front, wheel_speed_front, "rad/s", "rotation rate of the front wheels") \
  NUMBER(true, wheel_speed_rear, wheel_speed_rear, "rad/s", "rotation rate of the rear wheels") \
  STIFFNESS(true, cx_front, stiffness[0], mean_si[0], "N", "mean longitudinal stiffness, front") \
  STIFFNESS(true, cy_front, stiffness[1], mean_si[1], "N/rad", "mean cornering stiffness, front") \
  STIFFNESS(true, cy_rear, stiffness[2], mean_si[2], "N/rad", "mean cornering stiffness, rear") \
  STIFFNESS(drawn, cx_front, drawn[0], drawn_si[0], "N", \
      "longitudinal stiffness, front, drawn for this row") \
  STIFFNESS(drawn, cy_front, drawn[1], drawn_si[1], "N/rad", \
      "cornering stiffness, front, drawn for this row") \
  STIFFNESS(drawn, cy_rear, drawn[2], drawn_si[2], "N/rad", "cornering stiffness, rear, drawn for this row") \
  NUMBER(true, bias_accel_x, bias[0], "m/s2", "bias of accel_x") \
  NUMBER(true, bias_accel_y, bias[1], "m/s2", "bias of accel_y") \
  NUMBER(true, bias_yaw_rate, bias[2], "rad/s", "bias of yaw_rate")
#define STATUSES(ROW) \
  ROW(TSE_E_BUILD, "TSE_E_BUILD", \
      "this build rounds differently from the tested ones: compile without -ffast-math, with -ffp-" \
      "contract=off") \
  ROW(TSE_E_FORMAT, "TSE_E_FORMAT", \
      "a setting leads to numbers that do not fit the fixed-point format of this build; use double or " \
      "float") \
  ROW(TSE_E_OLD, "TSE_E_OLD", \
      "the learnt state (estimates of an earlier drive) was written by an older version of this library; " \
      "learn anew") \
  ROW(TSE_E_VEHICLE, "TSE_E_VEHICLE", \
      "the learnt state belongs to another vehicle: it was saved with other settings of the vehicle, of " \
      "effects or of the formula") \
  ROW(TSE_E_VERSION, "TSE_E_VERSION", "the learnt state was written by a newer version of this library") \
  ROW(TSE_E_LEARNT, "TSE_E_LEARNT", "this is not a learnt state of this library, or it is damaged") \
  ROW(TSE_E_SIZE, "TSE_E_SIZE", \
      "the memory of the filter has a different size than the library expects (other number of particles " \
      "or number format)") \
  ROW(TSE_E_STATE, "TSE_E_STATE", \
      "the parameters are not from tse_prepare(), the filter was not reset with these parameters, or the " \
      "filter or simulation is in a state that the called function does not allow (see its comment)") \
  ROW(TSE_E_TIME, "TSE_E_TIME", \
      "the time step dt is not finite, not positive, or too long (max 3600 s; replay and simulator: 1 s)") \
  ROW(TSE_E_INPUT, "TSE_E_INPUT", \
      "an input of the model, such as steering angle or wheel speed, is outside its range, or the row has" \
      " an optional channel that this filter or build does not use") \
  ROW(TSE_E_CONFIG, "TSE_E_CONFIG", "a setting is outside its range") \
  ROW(TSE_E_NULL, "TSE_E_NULL", "a required argument is NULL") \
  ROW(TSE_OK, "TSE_OK", "ok") \
  ROW(TSE_W_NOT_VALID, "TSE_W_NOT_VALID", "at least one stiffness is not valid; see its reason") \
  ROW(TSE_W_STARTING, "TSE_W_STARTING", \
      "too few informative rows since the start: no stiffness is valid yet") \
  ROW(TSE_W_MISSING_CHANNEL, "TSE_W_MISSING_CHANNEL", "a measurement is missing; the others are used") \
  ROW(TSE_W_HELD, "TSE_W_HELD", \
      "standstill, low speed, reverse or large steering angle: stiffness is not updated") \
  ROW(TSE_W_PREDICTED, "TSE_W_PREDICTED", \
      "the steering angle (paper's filter: or a wheel speed) or all measurements are missing: the filter " \
      "only predicts") \
  ROW(TSE_W_GAP, "TSE_W_GAP", \
      "long gap between rows or in the steering angle, or jump of the wheel speeds: the motion is set " \
      "from the sensors, all other estimates are kept") \
  ROW(TSE_W_RECOVERED, "TSE_W_RECOVERED", \
      "the filter started over, because its state was not finite (memory fault or overflow)") \
  ROW(TSE_W_WAITING, "TSE_W_WAITING", \
      "no step in this row: the filter waits for channels with a latency; the estimates are those of the " \
      "last step, or of the start") \
  ROW(TSE_W_RANGE, "TSE_W_RANGE", \
      "a number of the filter is near the limit of the fixed-point format, at which it saturates") \
  ROW(TSE_W_IMPLAUSIBLE, "TSE_W_IMPLAUSIBLE", \
      "the channels contradict each other: one has a wrong unit or sign, front and rear wheel speeds are " \
      "exchanged, or one is late; fault_channel names the channel, fault_factor is the factor by which it" \
      " is too large (0: its error is not a factor)")
#define REASON_CODES(ROW) \
  ROW(TSE_VALID, "valid", "usable") \
  ROW(TSE_STARTING, "starting", "too little data since the start") \
  ROW(TSE_NOT_EXCITED, "not excited", "the recent inputs do not excite this stiffness") \
  ROW(TSE_UNCERTAIN, "uncertain", \
      "excited, but the sd of the estimate is above the limit (setting valid_sd)") \
  ROW(TSE_SENSOR_FAULT, "sensor fault", "a channel is probably at fault") \
  ROW(TSE_HELD, "held", \
      "standstill, low speed, reverse, large steering angle or sliding wheels: the last value is held") \
  ROW(TSE_INPUT_INVALID, "input invalid", "inputs or measurements are missing") \
  ROW(TSE_PARAMETERS_UNCERTAIN, "parameters uncertain", \
      "the parameters of the car are too uncertain (their sds are the settings from mass_sd to grade_sd):" \
      " calibrate, or measure the parameters better") \
  ROW(TSE_MISFIT, "does not fit", \
      "the model does not explain the measurements: calibrate, or search for a missing effect (tselab gap)") \
  ROW(TSE_IMPLAUSIBLE, "implausible", \
      "the channels contradict each other: one has a wrong unit or sign, front and rear wheel speeds are " \
      "exchanged, or one is late; fault_channel names the channel, fault_factor is the factor by which it" \
      " is too large (0: its error is not a factor)")
#define REPLAY_START(ROW) \
  ROW(cx_front, 1.0, "1", \
      "front longitudinal stiffness, relative to nominal. The rear longitudinal stiffness, relative to " \
      "nominal, is 1 + f (cx_front - 1), where f is the setting rear_longitudinal_follows_front") \
  ROW(cy_front, 1.0, "1", "front cornering stiffness, relative to nominal") \
  ROW(cy_rear, 1.0, "1", "rear cornering stiffness, relative to nominal") \
  ROW(bias_accel_x, 0.0, "m/s2", "bias of accel_x") \
  ROW(bias_accel_y, 0.0, "m/s2", "bias of accel_y") \
  ROW(bias_yaw_rate, 0.0, "rad/s", "bias of yaw_rate") \
  ROW(vel_x_from_wheels, 1.0, "1", \
      "not 0: the initial vel_x is wheel speed times wheel radius, mean of both axles, in the first row") \
  ROW(vel_x, 0.0, "m/s", "initial vel_x if vel_x_from_wheels is 0") \
  ROW(vel_y, 0.0, "m/s", "initial vel_y") \
  ROW(yaw_rate, 0.0, "rad/s", "initial yaw rate") \
  ROW(time, 0.0, "s", "time at the first row; used by the effect stiffness_drift") \
  ROW(heading, 0.0, "rad", "heading at the first row; used by the effect crosswind") \
  ROW(wheel_inertia_front, 2.4, "kg m2", \
      "rotational inertia of both front wheels; used for output wheel_torque_front") \
  ROW(wheel_inertia_rear, 2.4, "kg m2", \
      "rotational inertia of both rear wheels; used for output wheel_torque_rear")
#define REASONS \
    "0 valid, 1 starting, 2 not excited, 3 uncertain, 4 sensor fault, 5 held, 6 input invalid, 7 " \
    "parameters uncertain, 8 does not fit, 9 implausible, see documentation"
// clang-format on: end of table

#define NO_COLUMN(...) /* in place of NUMBER, FLAG ... of a list above: omits the rows of this kind */

#endif
