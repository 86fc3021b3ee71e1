/* fmu/TireStiffnessEstimator/variables.h - every variable of the FMU, in the order of its value references. Part of model.c. */
#define PARAMETER(group, kind, name, def, lo, hi, unit, text) \
  { group "." #name, kind, 'p', (int32_t)offsetof(model, config.name), FMU_NO_RATE, def, lo, hi, unit, text },

const fmu_variable fmu_variables[] = {
#define INPUT(name, lo, hi, unit, kind, text) \
  { #name, 'r', 'i', (int32_t)offsetof(model, row.name), FMU_NO_RATE, 0.0, lo, hi, unit, text "; not a number: missing" },
#include "tse/input.def"
#undef INPUT
  { "missing", 'i', 'i', (int32_t)offsetof(model, row.missing), FMU_NO_RATE, 0.0, 0.0, (1 << TSE_CHANNELS) - 1, "",
    "channels that are missing, for importers that cannot send NaN: sum of 1 steer_angle, 2 wheel_speed_front, 4 wheel_speed_rear, "
    "8 accel_x, 16 accel_y, 32 yaw_rate" },
  { "velocity.given", 'i', 'i', (int32_t)offsetof(model, row.given), FMU_NO_RATE, 0.0, 0.0, (1 << TSE_VELOCITIES) - 1, "",
    "velocities that are measured; 0: none, then they are not read: sum of 1 ins_vel_x, 2 ins_vel_y, 4 gnss_speed, 8 gnss_course" },
#define VELOCITY(name, lo, hi, unit, text) \
  { "velocity." #name, 'r', 'i', (int32_t)offsetof(model, row.name), FMU_NO_RATE, 0.0, lo, hi, unit, text "; counts where its bit of given is set" },
#include "tse/optional.def"
  { "pedals.given", 'i', 'i', (int32_t)offsetof(model, pedals_given), FMU_NO_RATE, 0.0, 0.0, (1 << (TSE_OPTIONALS - TSE_VELOCITIES)) - 1, "",
    "what of the pedals is known; 0: nothing, then they are not read: sum of 1 brake, 2 wheel_torque_front, 4 wheel_torque_rear" },
#define PEDAL(name, lo, hi, unit, text) \
  { "pedals." #name, 'r', 'i', (int32_t)offsetof(model, row.name), FMU_NO_RATE, 0.0, lo, hi, unit, text "; counts where its bit of given is set" },
#include "tse/optional.def"

  { "vehicle.calibrated", 'b', 'p', (int32_t)offsetof(model, calibrated), FMU_NO_RATE, 0.0, 1.0, -1.0, "",
    "false: an ordinary car of its class, and what is set of it wins: stiffness and yaw inertia that are not set follow from mass, lf "
    "and lr, with the uncertainties of such a car; true: every parameter as it is, an uncertainty of 0 is none" },
#define REAL(name, def, lo, hi, unit, text) PARAMETER("vehicle", 'r', name, def, lo, hi, unit, text)
#define INT(name, def, lo, hi, text) PARAMETER("vehicle", 'i', name, def, lo, hi, "", text)
#include "tse/vehicle.def"
#undef REAL
#undef INT
#define REAL(name, def, lo, hi, unit, text) PARAMETER("uncertainty", 'r', name, def, lo, hi, unit, text)
#include "tse/uncertainty.def"
#undef REAL
#define REAL(name, def, lo, hi, unit, text) PARAMETER("sensors", 'r', name, def, lo, hi, unit, text)
#define INT(name, def, lo, hi, text) PARAMETER("sensors", 'i', name, def, lo, hi, "", text)
#include "tse/sensors.def"
#undef REAL
#undef INT
#define REAL(name, def, lo, hi, unit, text) PARAMETER("latency", 'r', name, def, lo, hi, unit, text)
#include "tse/latency.def"
#undef REAL
#define REAL(name, def, lo, hi, unit, text) PARAMETER("velocity", 'r', name, def, lo, hi, unit, text)
#include "tse/velocity.def"
#undef REAL
#define REAL(name, def, lo, hi, unit, text) PARAMETER("pedals", 'r', name, def, lo, hi, unit, text)
#include "tse/pedals.def"
#undef REAL
#define EFFECT_PARAMETER(id, parameter, role, unit, def, lo, hi, typical_lo, typical_hi, negligible, sign, text) \
  { "effects." #id "." #parameter, 'r', 'p', (int32_t)offsetof(model, config.id##_##parameter), FMU_NO_RATE, def, lo, hi, unit, text },
#include "tse/effects.def"
#define REAL(name, def, lo, hi, unit, text) PARAMETER("effects", 'r', name, def, lo, hi, unit, text)
#define INT(name, def, lo, hi, text) PARAMETER("effects", 'i', name, def, lo, hi, "", text)
#include "tse/formula.def"
#undef REAL
#undef INT
#define REAL(name, def, lo, hi, unit, text) PARAMETER("filter", 'r', name, def, lo, hi, unit, text)
#define INT(name, def, lo, hi, text) PARAMETER("filter", 'i', name, (def) < (hi) ? (def) : (hi), lo, hi, "", text)
#include "tse/filter.def"
#undef REAL
#undef INT

  /* table: estimator_outputs */
  { "estimate.vel_x", 'r', 'o', (int32_t)offsetof(model, y.vel_x), FMU_NO_RATE, 0.0, 1.0, -1.0, "m/s", "longitudinal velocity of the centre of gravity" },
  { "estimate.vel_x_sd", 'r', 'o', (int32_t)offsetof(model, y.vel_x_sd), FMU_NO_RATE, 0.0, 1.0, -1.0, "m/s", "its standard deviation" },
  { "estimate.vel_y", 'r', 'o', (int32_t)offsetof(model, y.vel_y), FMU_NO_RATE, 0.0, 1.0, -1.0, "m/s", "lateral velocity of the centre of gravity" },
  { "estimate.vel_y_sd", 'r', 'o', (int32_t)offsetof(model, y.vel_y_sd), FMU_NO_RATE, 0.0, 1.0, -1.0, "m/s", "its standard deviation" },
  { "estimate.yaw_rate", 'r', 'o', (int32_t)offsetof(model, y.yaw_rate), FMU_NO_RATE, 0.0, 1.0, -1.0, "rad/s", "yaw rate" },
  { "estimate.yaw_rate_sd", 'r', 'o', (int32_t)offsetof(model, y.yaw_rate_sd), FMU_NO_RATE, 0.0, 1.0, -1.0, "rad/s", "its standard deviation" },
  { "estimate.sideslip", 'r', 'o', (int32_t)offsetof(model, y.sideslip), FMU_NO_RATE, 0.0, 1.0, -1.0, "rad", "sideslip angle atan2(vel_y, vel_x) at the centre of gravity; 0 at standstill" },
  { "estimate.sideslip_sd", 'r', 'o', (int32_t)offsetof(model, y.sideslip_sd), FMU_NO_RATE, 0.0, 1.0, -1.0, "rad", "its standard deviation" },
  { "estimate.grip", 'r', 'o', (int32_t)offsetof(model, y.grip), FMU_NO_RATE, 0.0, 1.0, -1.0, "1", "friction of the tyres: the most lateral force of an axle over its load; form 0" },
  { "estimate.grip_sd", 'r', 'o', (int32_t)offsetof(model, y.grip_sd), FMU_NO_RATE, 0.0, 1.0, -1.0, "1", "its standard deviation" },
  { "estimate.grip_valid", 'b', 'o', (int32_t)offsetof(model, grip_valid), FMU_NO_RATE, 0.0, 1.0, -1.0, "", "the grip may be used" },
  { "estimate.grip_reason", 'i', 'o', (int32_t)offsetof(model, y.grip_reason), FMU_NO_RATE, 0.0, 1.0, -1.0, "", "0 valid, 1 starting, 2 not excited, 3 uncertain, 4 diverging, 5 held, 6 input invalid, 7 parameters uncertain, 8 does not fit, see documentation" },
  { "estimate.cx_front", 'r', 'o', (int32_t)offsetof(model, mean[0]), FMU_NO_RATE, 0.0, 1.0, -1.0, "N", "longitudinal stiffness, front axle, mean" },
  { "estimate.cx_front_sd", 'r', 'o', (int32_t)offsetof(model, sd[0]), FMU_NO_RATE, 0.0, 1.0, -1.0, "N", "sd of that mean" },
  { "estimate.cx_front_spread", 'r', 'o', (int32_t)offsetof(model, spread[0]), FMU_NO_RATE, 0.0, 1.0, -1.0, "N", "process sd: form 0 model_sd times the stiffness; form 1 learnt from sample to sample" },
  { "estimate.cx_front_spread_seen", 'b', 'o', (int32_t)offsetof(model, y.spread_seen[0]), FMU_NO_RATE, 0.0, 1.0, -1.0, "", "1: the spread is learnt, form 1; 0: the setting, or below what sensors and excitation can show" },
  { "estimate.cx_front_valid", 'b', 'o', (int32_t)offsetof(model, valid[0]), FMU_NO_RATE, 0.0, 1.0, -1.0, "", "the stiffness may be used" },
  { "estimate.cx_front_reason", 'i', 'o', (int32_t)offsetof(model, y.reason[0]), FMU_NO_RATE, 0.0, 1.0, -1.0, "", "0 valid, 1 starting, 2 not excited, 3 uncertain, 4 diverging, 5 held, 6 input invalid, 7 parameters uncertain, 8 does not fit, see documentation" },
  { "estimate.cy_front", 'r', 'o', (int32_t)offsetof(model, mean[1]), FMU_NO_RATE, 0.0, 1.0, -1.0, "N/rad", "cornering stiffness, front axle, mean" },
  { "estimate.cy_front_sd", 'r', 'o', (int32_t)offsetof(model, sd[1]), FMU_NO_RATE, 0.0, 1.0, -1.0, "N/rad", "sd of that mean" },
  { "estimate.cy_front_spread", 'r', 'o', (int32_t)offsetof(model, spread[1]), FMU_NO_RATE, 0.0, 1.0, -1.0, "N/rad", "process sd: form 0 model_sd times the stiffness; form 1 learnt from sample to sample" },
  { "estimate.cy_front_spread_seen", 'b', 'o', (int32_t)offsetof(model, y.spread_seen[1]), FMU_NO_RATE, 0.0, 1.0, -1.0, "", "1: the spread is learnt, form 1; 0: the setting, or below what sensors and excitation can show" },
  { "estimate.cy_front_valid", 'b', 'o', (int32_t)offsetof(model, valid[1]), FMU_NO_RATE, 0.0, 1.0, -1.0, "", "the stiffness may be used" },
  { "estimate.cy_front_reason", 'i', 'o', (int32_t)offsetof(model, y.reason[1]), FMU_NO_RATE, 0.0, 1.0, -1.0, "", "0 valid, 1 starting, 2 not excited, 3 uncertain, 4 diverging, 5 held, 6 input invalid, 7 parameters uncertain, 8 does not fit, see documentation" },
  { "estimate.cy_rear", 'r', 'o', (int32_t)offsetof(model, mean[2]), FMU_NO_RATE, 0.0, 1.0, -1.0, "N/rad", "cornering stiffness, rear axle, mean" },
  { "estimate.cy_rear_sd", 'r', 'o', (int32_t)offsetof(model, sd[2]), FMU_NO_RATE, 0.0, 1.0, -1.0, "N/rad", "sd of that mean" },
  { "estimate.cy_rear_spread", 'r', 'o', (int32_t)offsetof(model, spread[2]), FMU_NO_RATE, 0.0, 1.0, -1.0, "N/rad", "process sd: form 0 model_sd times the stiffness; form 1 learnt from sample to sample" },
  { "estimate.cy_rear_spread_seen", 'b', 'o', (int32_t)offsetof(model, y.spread_seen[2]), FMU_NO_RATE, 0.0, 1.0, -1.0, "", "1: the spread is learnt, form 1; 0: the setting, or below what sensors and excitation can show" },
  { "estimate.cy_rear_valid", 'b', 'o', (int32_t)offsetof(model, valid[2]), FMU_NO_RATE, 0.0, 1.0, -1.0, "", "the stiffness may be used" },
  { "estimate.cy_rear_reason", 'i', 'o', (int32_t)offsetof(model, y.reason[2]), FMU_NO_RATE, 0.0, 1.0, -1.0, "", "0 valid, 1 starting, 2 not excited, 3 uncertain, 4 diverging, 5 held, 6 input invalid, 7 parameters uncertain, 8 does not fit, see documentation" },
  { "estimate.bias_accel_x", 'r', 'o', (int32_t)offsetof(model, y.bias[0]), FMU_NO_RATE, 0.0, 1.0, -1.0, "m/s2", "bias of accel_x" },
  { "estimate.bias_accel_x_sd", 'r', 'o', (int32_t)offsetof(model, y.bias_sd[0]), FMU_NO_RATE, 0.0, 1.0, -1.0, "m/s2", "its standard deviation" },
  { "estimate.bias_accel_y", 'r', 'o', (int32_t)offsetof(model, y.bias[1]), FMU_NO_RATE, 0.0, 1.0, -1.0, "m/s2", "bias of accel_y" },
  { "estimate.bias_accel_y_sd", 'r', 'o', (int32_t)offsetof(model, y.bias_sd[1]), FMU_NO_RATE, 0.0, 1.0, -1.0, "m/s2", "its standard deviation" },
  { "estimate.bias_yaw_rate", 'r', 'o', (int32_t)offsetof(model, y.bias[2]), FMU_NO_RATE, 0.0, 1.0, -1.0, "rad/s", "bias of yaw_rate" },
  { "estimate.bias_yaw_rate_sd", 'r', 'o', (int32_t)offsetof(model, y.bias_sd[2]), FMU_NO_RATE, 0.0, 1.0, -1.0, "rad/s", "its standard deviation" },
  { "estimate.noise_accel_x", 'r', 'o', (int32_t)offsetof(model, y.noise[0]), FMU_NO_RATE, 0.0, 1.0, -1.0, "1", "noise of accel_x as found: its sd over the setting, form 0" },
  { "estimate.noise_accel_y", 'r', 'o', (int32_t)offsetof(model, y.noise[1]), FMU_NO_RATE, 0.0, 1.0, -1.0, "1", "noise of accel_y as found" },
  { "estimate.noise_yaw_rate", 'r', 'o', (int32_t)offsetof(model, y.noise[2]), FMU_NO_RATE, 0.0, 1.0, -1.0, "1", "noise of yaw_rate as found" },
  { "estimate.noise_wheel_front", 'r', 'o', (int32_t)offsetof(model, y.noise[3]), FMU_NO_RATE, 0.0, 1.0, -1.0, "1", "noise of wheel_speed_front as found" },
  { "estimate.noise_wheel_rear", 'r', 'o', (int32_t)offsetof(model, y.noise[4]), FMU_NO_RATE, 0.0, 1.0, -1.0, "1", "noise of wheel_speed_rear as found" },
  { "estimate.p_steady", 'r', 'o', (int32_t)offsetof(model, y.regime[TSE_REGIME_STEADY]), FMU_NO_RATE, 0.0, 1.0, -1.0, "1", "probability: tyres as before" },
  { "estimate.p_changed", 'r', 'o', (int32_t)offsetof(model, y.regime[TSE_REGIME_CHANGED]), FMU_NO_RATE, 0.0, 1.0, -1.0, "1", "probability: all tyres changed within the last 2 s, another road" },
  { "estimate.p_axle", 'r', 'o', (int32_t)offsetof(model, y.regime[TSE_REGIME_AXLE]), FMU_NO_RATE, 0.0, 1.0, -1.0, "1", "probability: the tyres of one axle changed within the last 2 s" },
  { "estimate.p_fault", 'r', 'o', (int32_t)offsetof(model, y.regime[TSE_REGIME_FAULT]), FMU_NO_RATE, 0.0, 1.0, -1.0, "1", "probability: a channel has an offset, is frozen or noisy" },
  { "estimate.p_sliding", 'r', 'o', (int32_t)offsetof(model, y.regime[TSE_REGIME_SLIDING]), FMU_NO_RATE, 0.0, 1.0, -1.0, "1", "probability: wheels lock or spin" },
  { "estimate.p_restarted", 'r', 'o', (int32_t)offsetof(model, y.regime[TSE_REGIME_RESTARTED]), FMU_NO_RATE, 0.0, 1.0, -1.0, "1", "probability: all was started over within the last 2 s" },
  { "estimate.change_age", 'r', 'o', (int32_t)offsetof(model, y.change_age), FMU_NO_RATE, 0.0, 1.0, -1.0, "s", "time since the last change ; 0 while there was none" },
  { "estimate.change_probability", 'r', 'o', (int32_t)offsetof(model, y.change_probability), FMU_NO_RATE, 0.0, 1.0, -1.0, "1", "probability that there was that change" },
  { "estimate.change_kind", 'i', 'o', (int32_t)offsetof(model, y.change_kind), FMU_NO_RATE, 0.0, 1.0, -1.0, "", "0 none yet, 1 road (all tyres), 2 front axle, 3 rear axle, 4 started over" },
  { "estimate.change_cx_front", 'r', 'o', (int32_t)offsetof(model, y.change_ratio[0]), FMU_NO_RATE, 0.0, 1.0, -1.0, "1", "longitudinal stiffness now over that before the change" },
  { "estimate.change_cy_front", 'r', 'o', (int32_t)offsetof(model, y.change_ratio[1]), FMU_NO_RATE, 0.0, 1.0, -1.0, "1", "front cornering stiffness now over that before the change" },
  { "estimate.change_cy_rear", 'r', 'o', (int32_t)offsetof(model, y.change_ratio[2]), FMU_NO_RATE, 0.0, 1.0, -1.0, "1", "rear cornering stiffness now over that before the change" },
  { "estimate.fault_channel", 'i', 'o', (int32_t)offsetof(model, y.fault_channel), FMU_NO_RATE, 0.0, 1.0, -1.0, "", "0 none, else 1 + place in tse/input.def of the channel that is likeliest at fault" },
  { "estimate.discrepancy_accel_x", 'r', 'o', (int32_t)offsetof(model, y.discrepancy[0]), FMU_NO_RATE, 0.0, 1.0, -1.0, "m/s2", "model discrepancy of accel_x: sd of what the model does not explain" },
  { "estimate.discrepancy_accel_y", 'r', 'o', (int32_t)offsetof(model, y.discrepancy[1]), FMU_NO_RATE, 0.0, 1.0, -1.0, "m/s2", "model discrepancy of accel_y" },
  { "estimate.discrepancy_yaw_rate", 'r', 'o', (int32_t)offsetof(model, y.discrepancy[2]), FMU_NO_RATE, 0.0, 1.0, -1.0, "rad/s", "model discrepancy of yaw_rate" },
  { "estimate.innovation_accel_x", 'r', 'o', (int32_t)offsetof(model, y.innovation[0]), FMU_NO_RATE, 0.0, 1.0, -1.0, "m/s2", "innovation: what accel_x read less what was predicted; 0 where it was not used; form 0" },
  { "estimate.innovation_accel_y", 'r', 'o', (int32_t)offsetof(model, y.innovation[1]), FMU_NO_RATE, 0.0, 1.0, -1.0, "m/s2", "innovation of accel_y" },
  { "estimate.innovation_yaw_rate", 'r', 'o', (int32_t)offsetof(model, y.innovation[2]), FMU_NO_RATE, 0.0, 1.0, -1.0, "rad/s", "innovation of yaw_rate" },
  { "estimate.innovation_wheel_front", 'r', 'o', (int32_t)offsetof(model, y.innovation[3]), FMU_NO_RATE, 0.0, 1.0, -1.0, "m/s", "innovation of the front wheel speed times radius" },
  { "estimate.innovation_wheel_rear", 'r', 'o', (int32_t)offsetof(model, y.innovation[4]), FMU_NO_RATE, 0.0, 1.0, -1.0, "m/s", "innovation of the rear wheel speed times radius" },
  { "estimate.nis", 'r', 'o', (int32_t)offsetof(model, y.nis), FMU_NO_RATE, 0.0, 1.0, -1.0, "1", "normalised innovation squared, summed over the channels used; their number where all fits; form 0" },
  { "estimate.lag_steer", 'r', 'o', (int32_t)offsetof(model, y.lag_steer), FMU_NO_RATE, 0.0, 1.0, -1.0, "s", "how late the steering acts behind the IMU as found: bus, steering, tyres; below 0: how early; form 0" },
  { "estimate.lag_steer_sd", 'r', 'o', (int32_t)offsetof(model, y.lag_steer_sd), FMU_NO_RATE, 0.0, 1.0, -1.0, "s", "its standard deviation" },
  { "estimate.estimate_age", 'r', 'o', (int32_t)offsetof(model, y.estimate_age), FMU_NO_RATE, 0.0, 1.0, -1.0, "s", "how long before this row the time lies that the estimates speak of (tse/latency.def)" },
  { "estimate.n_eff", 'r', 'o', (int32_t)offsetof(model, y.n_eff), FMU_NO_RATE, 0.0, 1.0, -1.0, "1", "effective number of particles, 1/sum q^2 of their weights; 1 in form 0" },
  { "estimate.log_evidence", 'r', 'o', (int32_t)offsetof(model, y.log_evidence), FMU_NO_RATE, 0.0, 1.0, -1.0, "nat", "log density of this row's measurements given the rows before; 0 where none was used" },
  { "estimate.status", 'i', 'o', (int32_t)offsetof(model, y.status), FMU_NO_RATE, 0.0, 1.0, -1.0, "", "0 ok; above: usable, with the caution of this code (tse_status)" },
  /* end of table */
  OUTPUT("estimate.nominal.cx_front", 'r', nominal[0], "N",
         "nominal longitudinal stiffness of the front axle, of which estimate.relative.cx_front is a share")
  OUTPUT("estimate.nominal.cy_front", 'r', nominal[1], "N/rad",
         "nominal cornering stiffness of the front axle, of which estimate.relative.cy_front is a share")
  OUTPUT("estimate.nominal.cy_rear", 'r', nominal[2], "N/rad",
         "nominal cornering stiffness of the rear axle, of which estimate.relative.cy_rear is a share")
  OUTPUT("estimate.valid", 'b', all_valid, "", "all three stiffnesses may be used")
  /* table: estimator_shares */
  { "estimate.relative.cx_front", 'r', 'o', (int32_t)offsetof(model, y.stiffness[0]), FMU_NO_RATE, 0.0, 1.0, -1.0, "1", "longitudinal stiffness, front axle, mean, relative to nominal" },
  { "estimate.relative.cx_front_sd", 'r', 'o', (int32_t)offsetof(model, y.stiffness_sd[0]), FMU_NO_RATE, 0.0, 1.0, -1.0, "1", "sd of that mean, relative to nominal" },
  { "estimate.relative.cx_front_spread", 'r', 'o', (int32_t)offsetof(model, y.stiffness_spread[0]), FMU_NO_RATE, 0.0, 1.0, -1.0, "1", "process sd: form 0 model_sd times the stiffness; form 1 learnt from sample to sample, relative to nominal" },
  { "estimate.relative.cy_front", 'r', 'o', (int32_t)offsetof(model, y.stiffness[1]), FMU_NO_RATE, 0.0, 1.0, -1.0, "1", "cornering stiffness, front axle, mean, relative to nominal" },
  { "estimate.relative.cy_front_sd", 'r', 'o', (int32_t)offsetof(model, y.stiffness_sd[1]), FMU_NO_RATE, 0.0, 1.0, -1.0, "1", "sd of that mean, relative to nominal" },
  { "estimate.relative.cy_front_spread", 'r', 'o', (int32_t)offsetof(model, y.stiffness_spread[1]), FMU_NO_RATE, 0.0, 1.0, -1.0, "1", "process sd: form 0 model_sd times the stiffness; form 1 learnt from sample to sample, relative to nominal" },
  { "estimate.relative.cy_rear", 'r', 'o', (int32_t)offsetof(model, y.stiffness[2]), FMU_NO_RATE, 0.0, 1.0, -1.0, "1", "cornering stiffness, rear axle, mean, relative to nominal" },
  { "estimate.relative.cy_rear_sd", 'r', 'o', (int32_t)offsetof(model, y.stiffness_sd[2]), FMU_NO_RATE, 0.0, 1.0, -1.0, "1", "sd of that mean, relative to nominal" },
  { "estimate.relative.cy_rear_spread", 'r', 'o', (int32_t)offsetof(model, y.stiffness_spread[2]), FMU_NO_RATE, 0.0, 1.0, -1.0, "1", "process sd: form 0 model_sd times the stiffness; form 1 learnt from sample to sample, relative to nominal" },
  /* end of table */
};
const int32_t fmu_variable_count = (int32_t)(sizeof fmu_variables / sizeof fmu_variables[0]);

