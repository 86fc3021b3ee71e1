/* tables/columns.h - lists of all channels, outputs, status and reason codes. Range checks,
 * texts, tse_describe() and the FMUs generate their rows from them.
 *   CHANNELS, VELOCITIES, PEDALS, ROADS
 *                 ROW(name, 1 if it drives, min, max, unit, text)
 *   DRIVER        ROW(name, default, min, max, unit, text): inputs of the simulator
 *   OUTPUTS       NUMBER(name, member, unit, text)
 *                 FLAG(name, member, text)
 *                 CODE(name, member, enumeration, text)
 *                 STIFFNESS(name, member, index of its N or N/rad output in an FMU, unit, text)
 *                 REASON(name, member, index of "valid", subject)
 *   STATUSES, REASON_CODES
 *                 ROW(name, word, text)
 *   REPLAY_START  ROW(name, default, unit, text)
 *   TRUTHS        NUMBER, STIFFNESS as above; first argument: group of the simulator's column
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
  ROW(ins_vel_x, 0, -120.0, 120.0, "m/s", "velocity along the car, of an INS or an optical sensor") \
  ROW(ins_vel_y, 0, -60.0, 60.0, "m/s", "velocity across the car, positive left") \
  ROW(gnss_speed, 0, 0.0, 120.0, "m/s", "speed over ground") \
  ROW(gnss_course, 0, -7.0, 7.0, "rad", \
      "direction over ground, positive left (counter-clockwise from above), from any zero")
#define PEDALS(ROW) \
  ROW(brake, 0, 0.0, 1.0, "1", \
      "1: the car brakes, 0: it does not (from 0.5 on it does); if missing, accel_x decides") \
  ROW(wheel_torque_front, 0, -20000.0, 20000.0, "Nm", "drive minus brake torque of both front wheels") \
  ROW(wheel_torque_rear, 0, -20000.0, 20000.0, "Nm", "drive minus brake torque of both rear wheels")
#define ROADS(ROW) \
  ROW(bank, 0, -0.35, 0.35, "rad", \
      "whole bank of the road, left side high > 0, in place of the bank in the settings") \
  ROW(grade, 0, -0.35, 0.35, "rad", "whole slope of the road, uphill > 0, in place of grade_angle")
#define DRIVER(ROW) \
  ROW(steer_angle, 0.0, -1.2, 1.2, "rad", "road-wheel angle of the front axle, positive left") \
  ROW(wheel_torque_front, 0.0, -100000.0, 100000.0, "Nm", \
      "drive torque of the front axle; negative turns the wheels backwards") \
  ROW(wheel_torque_rear, 0.0, -100000.0, 100000.0, "Nm", \
      "drive torque of the rear axle; negative turns the wheels backwards") \
  ROW(brake_torque_front, 0.0, 0.0, 100000.0, "Nm", \
      "brake torque of the front axle, against the rotation; holds at standstill") \
  ROW(brake_torque_rear, 0.0, 0.0, 100000.0, "Nm", \
      "brake torque of the rear axle, against the rotation; holds at standstill") \
  ROW(road_level, 1.0, 0.02, 10.0, "1", "stiffness of all tyres relative to dry road") \
  ROW(road_friction, 0.0, 0.0, 2.0, "1", \
      "friction coefficient at which the tyre forces of an axle saturate; 0: that of the settings") \
  ROW(bank, 0.0, -0.35, 0.35, "rad", "bank of the road, left side high > 0, besides the setting bank_angle") \
  ROW(grade, 0.0, -0.35, 0.35, "rad", "slope of the road, uphill > 0, besides the setting grade_angle")
#define OUTPUTS(NUMBER, FLAG, CODE, STIFFNESS, REASON) \
  NUMBER(vel_x, vel_x, "m/s", "longitudinal velocity of the centre of gravity") \
  NUMBER(vel_x_sd, vel_x_sd, "m/s", "its standard deviation") \
  NUMBER(vel_y, vel_y, "m/s", "lateral velocity of the centre of gravity") \
  NUMBER(vel_y_sd, vel_y_sd, "m/s", "its standard deviation") \
  NUMBER(yaw_rate, yaw_rate, "rad/s", "yaw rate") \
  NUMBER(yaw_rate_sd, yaw_rate_sd, "rad/s", "its standard deviation") \
  NUMBER(sideslip, sideslip, "rad", \
      "sideslip angle atan2(vel_y, vel_x) at the centre of gravity; 0 at standstill") \
  NUMBER(sideslip_sd, sideslip_sd, "rad", "its standard deviation") \
  NUMBER(grip, grip, "1", "friction of the tyres: largest lateral force of an axle over its load; with a " \
      "tyre_saturation_balance, 1 over the mean of 1/friction of both axles; default filter only") \
  NUMBER(grip_sd, grip_sd, "1", "its standard deviation") \
  REASON(grip, grip_reason, grip_valid, "the grip") \
  STIFFNESS(cx_front, stiffness[0], mean[0], "N", "longitudinal stiffness, front axle, mean") \
  STIFFNESS(cx_front_sd, stiffness_sd[0], sd[0], "N", "sd of that mean") \
  STIFFNESS(cx_front_spread, stiffness_spread[0], spread[0], "N", \
      "default filter: model discrepancy, model_sd times the stiffness; paper's filter: process sd, " \
      "sqrt(Sigma)") \
  FLAG(cx_front_spread_seen, spread_seen[0], \
      "1: the spread is learnt (paper's filter); 0: it is the setting, or too small for these sensors and" \
      " this excitation") \
  REASON(cx_front, reason[0], valid[0], "the stiffness") \
  STIFFNESS(cy_front, stiffness[1], mean[1], "N/rad", "cornering stiffness, front axle, mean") \
  STIFFNESS(cy_front_sd, stiffness_sd[1], sd[1], "N/rad", "sd of that mean") \
  STIFFNESS(cy_front_spread, stiffness_spread[1], spread[1], "N/rad", \
      "default filter: model discrepancy, model_sd times the stiffness; paper's filter: process sd, " \
      "sqrt(Sigma)") \
  FLAG(cy_front_spread_seen, spread_seen[1], \
      "1: the spread is learnt (paper's filter); 0: it is the setting, or too small for these sensors and" \
      " this excitation") \
  REASON(cy_front, reason[1], valid[1], "the stiffness") \
  STIFFNESS(cy_rear, stiffness[2], mean[2], "N/rad", "cornering stiffness, rear axle, mean") \
  STIFFNESS(cy_rear_sd, stiffness_sd[2], sd[2], "N/rad", "sd of that mean") \
  STIFFNESS(cy_rear_spread, stiffness_spread[2], spread[2], "N/rad", \
      "default filter: model discrepancy, model_sd times the stiffness; paper's filter: process sd, " \
      "sqrt(Sigma)") \
  FLAG(cy_rear_spread_seen, spread_seen[2], \
      "1: the spread is learnt (paper's filter); 0: it is the setting, or too small for these sensors and" \
      " this excitation") \
  REASON(cy_rear, reason[2], valid[2], "the stiffness") \
  NUMBER(bias_accel_x, bias[0], "m/s2", "bias of accel_x: measured minus true value") \
  NUMBER(bias_accel_x_sd, bias_sd[0], "m/s2", "its standard deviation") \
  NUMBER(bias_accel_y, bias[1], "m/s2", "bias of accel_y: measured minus true value") \
  NUMBER(bias_accel_y_sd, bias_sd[1], "m/s2", "its standard deviation") \
  NUMBER(bias_yaw_rate, bias[2], "rad/s", "bias of yaw_rate: measured minus true value") \
  NUMBER(bias_yaw_rate_sd, bias_sd[2], "rad/s", "its standard deviation") \
  NUMBER(noise_accel_x, noise[0], "1", \
      "estimated noise sd of accel_x over the setting, default filter only") \
  NUMBER(noise_accel_y, noise[1], "1", "estimated noise sd of accel_y over the setting") \
  NUMBER(noise_yaw_rate, noise[2], "1", "estimated noise sd of yaw_rate over the setting") \
  NUMBER(noise_wheel_front, noise[3], "1", "estimated noise sd of wheel_speed_front over the setting") \
  NUMBER(noise_wheel_rear, noise[4], "1", "estimated noise sd of wheel_speed_rear over the setting") \
  NUMBER(p_steady, regime[TSE_REGIME_STEADY], "1", "probability: tyres as before") \
  NUMBER(p_changed, regime[TSE_REGIME_CHANGED], "1", \
      "probability: all tyres changed within the last 2 s, another road") \
  NUMBER(p_axle, regime[TSE_REGIME_AXLE], "1", \
      "probability: the tyres of one axle changed within the last 2 s") \
  NUMBER(p_fault, regime[TSE_REGIME_FAULT], "1", "probability: a channel has an offset, is frozen or noisy") \
  NUMBER(p_sliding, regime[TSE_REGIME_SLIDING], "1", "probability: wheels lock or spin") \
  NUMBER(p_restarted, regime[TSE_REGIME_RESTARTED], "1", \
      "probability: the filter started over within the last 2 s") \
  NUMBER(change_age, change_age, "s", "time since the last change; 0 before the first one") \
  NUMBER(change_probability, change_probability, "1", "probability that nothing has changed since then") \
  CODE(change_kind, change_kind, "ChangeKind", \
      "0 none yet, 1 road (all tyres), 2 front axle, 3 rear axle, 4 started over") \
  NUMBER(change_cx_front, change_ratio[0], "1", "longitudinal stiffness now over that before the change") \
  NUMBER(change_cy_front, change_ratio[1], "1", "front cornering stiffness now over that before the change") \
  NUMBER(change_cy_rear, change_ratio[2], "1", "rear cornering stiffness now over that before the change") \
  CODE(fault_channel, fault_channel, "FaultChannel", \
      "0: none; else 1 + index of the channel that is most probably at fault") \
  NUMBER(discrepancy_accel_x, discrepancy[0], "m/s2", \
      "model discrepancy of accel_x: sd of the part that the model does not explain") \
  NUMBER(discrepancy_accel_y, discrepancy[1], "m/s2", "model discrepancy of accel_y") \
  NUMBER(discrepancy_yaw_rate, discrepancy[2], "rad/s", "model discrepancy of yaw_rate") \
  NUMBER(innovation_accel_x, innovation[0], "m/s2", \
      "innovation of accel_x: measured minus predicted value; 0 where it was not used; default filter only") \
  NUMBER(innovation_accel_y, innovation[1], "m/s2", "innovation of accel_y") \
  NUMBER(innovation_yaw_rate, innovation[2], "rad/s", "innovation of yaw_rate") \
  NUMBER(innovation_wheel_front, innovation[3], "m/s", "innovation of the front wheel speed times radius") \
  NUMBER(innovation_wheel_rear, innovation[4], "m/s", "innovation of the rear wheel speed times radius") \
  NUMBER(nis_accel_x, nis[0], "1", \
      "normalised innovation squared of accel_x, without lasting errors: 1 on average where model and " \
      "settings fit; 0 where it was not used; default filter only") \
  NUMBER(nis_accel_y, nis[1], "1", "normalised innovation squared of accel_y") \
  NUMBER(nis_yaw_rate, nis[2], "1", "normalised innovation squared of yaw_rate") \
  NUMBER(nis_wheel_front, nis[3], "1", "normalised innovation squared of the front wheel speed") \
  NUMBER(nis_wheel_rear, nis[4], "1", "normalised innovation squared of the rear wheel speed") \
  NUMBER(lag_steer, lag_steer, "s", \
      "estimated lag of the steering behind the IMU, of bus, steering and tyres together; below 0: it " \
      "leads; default filter only") \
  NUMBER(lag_steer_sd, lag_steer_sd, "s", "its standard deviation") \
  NUMBER(estimate_age, estimate_age, "s", \
      "age of the estimates: time of this row minus the time they refer to (settings ..._latency)") \
  NUMBER(n_eff, n_eff, "1", "effective number of particles, 1/sum q^2 of their weights; default filter: 1") \
  NUMBER(log_evidence, log_evidence, "nat", \
      "log density of this row's measurements given the rows before; 0 where none was used") \
  CODE(status, status, "Status", \
      "0: ok; above: the code of a caution (tse_status); use a stiffness only if it is valid") \
  STIFFNESS(cx_front_secant, stiffness_secant[0], secant[0], "N", \
      "longitudinal stiffness in effect, front axle: force over slip at this row's slip and load") \
  STIFFNESS(cy_front_secant, stiffness_secant[1], secant[1], "N/rad", \
      "cornering stiffness in effect, front axle: force over slip at this row's slip and load") \
  STIFFNESS(cy_rear_secant, stiffness_secant[2], secant[2], "N/rad", \
      "cornering stiffness in effect, rear axle: force over slip at this row's slip and load") \
  NUMBER(fault_factor, fault_factor, "1", \
      "factor by which the implausible channel is too large: 57.3 degrees for radians, -1 a sign; 0: " \
      "none, or it is exchanged, stuck or late")
#define TRUTHS(NUMBER, STIFFNESS) \
  NUMBER(true, vel_x, vel_x, "m/s", "longitudinal velocity of the centre of gravity") \
  NUMBER(true, vel_y, vel_y, "m/s", "lateral velocity of the centre of gravity") \
  NUMBER(true, yaw_rate, yaw_rate, "rad/s", "yaw rate") \
  NUMBER(true, accel_x, accel_x, "m/s2", "specific force without noise and bias") \
  NUMBER(true, accel_y, accel_y, "m/s2", "specific force without noise and bias") \
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
      "the learnt state was written by an older version of this library; learn anew") \
  ROW(TSE_E_VEHICLE, "TSE_E_VEHICLE", "the learnt state belongs to another vehicle") \
  ROW(TSE_E_VERSION, "TSE_E_VERSION", "the learnt state was written by a newer version of this library") \
  ROW(TSE_E_LEARNT, "TSE_E_LEARNT", "not a learnt state of this library, or damaged") \
  ROW(TSE_E_SIZE, "TSE_E_SIZE", \
      "the filter's memory has another size than the library expects (other capacity or format)") \
  ROW(TSE_E_STATE, "TSE_E_STATE", \
      "the filter was not reset with these parameters, or is not a filter of this library") \
  ROW(TSE_E_TIME, "TSE_E_TIME", "time step not finite, not positive, or too long") \
  ROW(TSE_E_INPUT, "TSE_E_INPUT", "an input that drives the model is outside its range") \
  ROW(TSE_E_CONFIG, "TSE_E_CONFIG", "a setting is outside its range") \
  ROW(TSE_E_NULL, "TSE_E_NULL", "a required argument is NULL") \
  ROW(TSE_OK, "TSE_OK", "ok") \
  ROW(TSE_W_NOT_VALID, "TSE_W_NOT_VALID", "at least one stiffness is not valid; its reason says why") \
  ROW(TSE_W_STARTING, "TSE_W_STARTING", \
      "too few informative rows since the start; spread and validity are not settled") \
  ROW(TSE_W_MISSING_CHANNEL, "TSE_W_MISSING_CHANNEL", "a measurement was missing; the others were used") \
  ROW(TSE_W_HELD, "TSE_W_HELD", \
      "standstill, low speed, reverse or large steering angle: nothing is learnt of the stiffness") \
  ROW(TSE_W_PREDICTED, "TSE_W_PREDICTED", "no measurement, or inputs missing: predicted only") \
  ROW(TSE_W_GAP, "TSE_W_GAP", \
      "a step too long to bridge, or sensors that jump: states restarted from the sensors, what was " \
      "learnt is kept") \
  ROW(TSE_W_RECOVERED, "TSE_W_RECOVERED", \
      "the state was not finite, by a fault of the memory or an overflow: the filter started over") \
  ROW(TSE_W_WAITING, "TSE_W_WAITING", \
      "no step yet: the filter waits for channels that are logged later; estimates are those of the last " \
      "step, or of the start") \
  ROW(TSE_W_RANGE, "TSE_W_RANGE", \
      "a number reached the end of the range of the number format: it stops there, or the sample was " \
      "dropped") \
  ROW(TSE_W_IMPLAUSIBLE, "TSE_W_IMPLAUSIBLE", \
      "the channels contradict each other: a wrong unit, sign or axle, or one comes late; fault_channel " \
      "says which, fault_factor how many times too large it is")
#define REASON_CODES(ROW) \
  ROW(TSE_VALID, "valid", "usable") \
  ROW(TSE_STARTING, "starting", "too little seen since the start") \
  ROW(TSE_NOT_EXCITED, "not excited", "the recent inputs do not show this stiffness") \
  ROW(TSE_UNCERTAIN, "uncertain", "excited, but the sd of the mean is above the limit") \
  ROW(TSE_SENSOR_FAULT, "sensor fault", "a channel is probably at fault") \
  ROW(TSE_HELD, "held", \
      "standstill, low speed, reverse, large steering angle or sliding wheels: value from before") \
  ROW(TSE_INPUT_INVALID, "input invalid", "inputs or measurements are missing") \
  ROW(TSE_PARAMETERS_UNCERTAIN, "parameters uncertain", \
      "the parameters of the car are too uncertain (settings mass_sd to grade_sd): calibrate, or measure " \
      "them better") \
  ROW(TSE_MISFIT, "does not fit", \
      "the model does not explain the measurements: calibrate, or look for what is missing") \
  ROW(TSE_IMPLAUSIBLE, "implausible", \
      "the channels contradict each other: a wrong unit, sign or axle, or one comes late (fault_channel, " \
      "fault_factor)")
#define REPLAY_START(ROW) \
  ROW(cx_front, 1.0, "1", "longitudinal stiffness, share of nominal (rear follows as the settings say)") \
  ROW(cy_front, 1.0, "1", "front cornering stiffness, share of nominal") \
  ROW(cy_rear, 1.0, "1", "rear cornering stiffness, share of nominal") \
  ROW(bias_accel_x, 0.0, "m/s2", "bias of accel_x") \
  ROW(bias_accel_y, 0.0, "m/s2", "bias of accel_y") \
  ROW(bias_yaw_rate, 0.0, "rad/s", "bias of yaw_rate") \
  ROW(vel_x_from_wheels, 1.0, "1", "not 0: vel_x starts at the mean of the wheel speeds") \
  ROW(vel_x, 0.0, "m/s", "start of vel_x, when not from the wheels") \
  ROW(vel_y, 0.0, "m/s", "start of vel_y") \
  ROW(yaw_rate, 0.0, "rad/s", "start of the yaw rate") \
  ROW(time, 0.0, "s", "clock of stiffness_drift at the first row") \
  ROW(heading, 0.0, "rad", "heading at the first row, for crosswind") \
  ROW(wheel_inertia_front, 2.4, "kg m2", "rotational inertia of both front wheels, for wheel_torque_front") \
  ROW(wheel_inertia_rear, 2.4, "kg m2", "rotational inertia of both rear wheels, for wheel_torque_rear")
#define REASONS \
    "0 valid, 1 starting, 2 not excited, 3 uncertain, 4 sensor fault, 5 held, 6 input invalid, 7 " \
    "parameters uncertain, 8 does not fit, 9 implausible, see documentation"
// clang-format on: end of table

#define NO_COLUMN(...) /* skips a row */

#endif
