/* fmu/SingleTrackVehicle/variables.h - every variable of the FMU, in the order of its value references. Part of model.c. */
#include "tables/settings.h"

#define SIM_PARAMETER(fmu, name, def, lo, hi, unit, text) \
  { fmu, 'r', 'p', (int32_t)offsetof(model, sim_config.name), FMU_NO_RATE, def, lo, hi, unit, text },
#define WHOLE_SIM_PARAMETER(fmu, name, def, lo, hi, unit, text) \
  { fmu, 'i', 'p', (int32_t)offsetof(model, sim_config.name), FMU_NO_RATE, def, lo, hi, "", text },
const fmu_variable fmu_variables[] = {
  /* table: vehicle_inputs */
  { "steer_angle", 'r', 'i', (int32_t)offsetof(model, u.steer_angle), (int32_t)offsetof(model, rate.steer_angle), 0.0, -1.2, 1.2, "rad", "road-wheel angle of the front axle, positive left" },
  { "wheel_torque_front", 'r', 'i', (int32_t)offsetof(model, u.wheel_torque_front), (int32_t)offsetof(model, rate.wheel_torque_front), 0.0, -100000.0, 100000.0, "Nm", "drive torque of the front axle; negative turns the wheels backwards" },
  { "wheel_torque_rear", 'r', 'i', (int32_t)offsetof(model, u.wheel_torque_rear), (int32_t)offsetof(model, rate.wheel_torque_rear), 0.0, -100000.0, 100000.0, "Nm", "drive torque of the rear axle; negative turns the wheels backwards" },
  { "brake_torque_front", 'r', 'i', (int32_t)offsetof(model, u.brake_torque_front), (int32_t)offsetof(model, rate.brake_torque_front), 0.0, 0.0, 100000.0, "Nm", "brake torque of the front axle, against the rotation; holds at standstill" },
  { "brake_torque_rear", 'r', 'i', (int32_t)offsetof(model, u.brake_torque_rear), (int32_t)offsetof(model, rate.brake_torque_rear), 0.0, 0.0, 100000.0, "Nm", "brake torque of the rear axle, against the rotation; holds at standstill" },
  { "road_level", 'r', 'i', (int32_t)offsetof(model, u.road_level), (int32_t)offsetof(model, rate.road_level), 1.0, 0.02, 10.0, "1", "stiffness of all tyres relative to dry road" },
  { "road_friction", 'r', 'i', (int32_t)offsetof(model, u.road_friction), (int32_t)offsetof(model, rate.road_friction), 0.0, 0.0, 2.0, "1", "friction coefficient at which the tyre forces of an axle saturate; 0: that of the settings" },
  /* end of table */
  { "ramp", 'b', 'p', (int32_t)offsetof(model, ramp), FMU_NO_RATE, 1.0, 1.0, -1.0, "",
    "true: during a step inputs change linearly from where they were, as a driver's do; false: at its start they jump to what was set" },

  SETTINGS_VEHICLE(PARAMETER, WHOLE_PARAMETER) SETTINGS_SENSORS(PARAMETER, WHOLE_PARAMETER)
  SETTINGS_EFFECTS(PARAMETER, WHOLE_PARAMETER) SETTINGS_FORMULA(PARAMETER, WHOLE_PARAMETER)
  SETTINGS_SIM(SIM_PARAMETER, WHOLE_SIM_PARAMETER)
  /* table: vehicle_sensors */
  { "sensor.steer_angle", 'r', 'o', (int32_t)offsetof(model, y.row.steer_angle), FMU_NO_RATE, 0.0, 1.0, -1.0, "rad", "mean road-wheel angle of the front axle, positive left, as logged" },
  { "sensor.wheel_speed_front", 'r', 'o', (int32_t)offsetof(model, y.row.wheel_speed_front), FMU_NO_RATE, 0.0, 1.0, -1.0, "rad/s", "mean rotation rate of the front wheels, positive forward, as logged" },
  { "sensor.wheel_speed_rear", 'r', 'o', (int32_t)offsetof(model, y.row.wheel_speed_rear), FMU_NO_RATE, 0.0, 1.0, -1.0, "rad/s", "mean rotation rate of the rear wheels, positive forward, as logged" },
  { "sensor.accel_x", 'r', 'o', (int32_t)offsetof(model, y.row.accel_x), FMU_NO_RATE, 0.0, 1.0, -1.0, "m/s2", "specific force at the centre of gravity, positive forward, as logged" },
  { "sensor.accel_y", 'r', 'o', (int32_t)offsetof(model, y.row.accel_y), FMU_NO_RATE, 0.0, 1.0, -1.0, "m/s2", "specific force at the centre of gravity, positive left, as logged" },
  { "sensor.yaw_rate", 'r', 'o', (int32_t)offsetof(model, y.row.yaw_rate), FMU_NO_RATE, 0.0, 1.0, -1.0, "rad/s", "yaw rate, positive left (counter-clockwise from above), as logged" },
  /* end of table */
  /* table: vehicle_outputs */
  { "true.vel_x", 'r', 'o', (int32_t)offsetof(model, y.vel_x), FMU_NO_RATE, 0.0, 1.0, -1.0, "m/s", "longitudinal velocity of the centre of gravity" },
  { "true.vel_y", 'r', 'o', (int32_t)offsetof(model, y.vel_y), FMU_NO_RATE, 0.0, 1.0, -1.0, "m/s", "lateral velocity of the centre of gravity" },
  { "true.yaw_rate", 'r', 'o', (int32_t)offsetof(model, y.yaw_rate), FMU_NO_RATE, 0.0, 1.0, -1.0, "rad/s", "yaw rate" },
  { "true.accel_x", 'r', 'o', (int32_t)offsetof(model, y.accel_x), FMU_NO_RATE, 0.0, 1.0, -1.0, "m/s2", "specific force without noise and bias" },
  { "true.accel_y", 'r', 'o', (int32_t)offsetof(model, y.accel_y), FMU_NO_RATE, 0.0, 1.0, -1.0, "m/s2", "specific force without noise and bias" },
  { "true.wheel_speed_front", 'r', 'o', (int32_t)offsetof(model, y.wheel_speed_front), FMU_NO_RATE, 0.0, 1.0, -1.0, "rad/s", "rotation rate of the front wheels" },
  { "true.wheel_speed_rear", 'r', 'o', (int32_t)offsetof(model, y.wheel_speed_rear), FMU_NO_RATE, 0.0, 1.0, -1.0, "rad/s", "rotation rate of the rear wheels" },
  { "true.cx_front", 'r', 'o', (int32_t)offsetof(model, mean_si[0]), FMU_NO_RATE, 0.0, 1.0, -1.0, "N", "mean longitudinal stiffness, front" },
  { "true.cy_front", 'r', 'o', (int32_t)offsetof(model, mean_si[1]), FMU_NO_RATE, 0.0, 1.0, -1.0, "N/rad", "mean cornering stiffness, front" },
  { "true.cy_rear", 'r', 'o', (int32_t)offsetof(model, mean_si[2]), FMU_NO_RATE, 0.0, 1.0, -1.0, "N/rad", "mean cornering stiffness, rear" },
  { "drawn.cx_front", 'r', 'o', (int32_t)offsetof(model, drawn_si[0]), FMU_NO_RATE, 0.0, 1.0, -1.0, "N", "longitudinal stiffness, front, drawn for this row" },
  { "drawn.cy_front", 'r', 'o', (int32_t)offsetof(model, drawn_si[1]), FMU_NO_RATE, 0.0, 1.0, -1.0, "N/rad", "cornering stiffness, front, drawn for this row" },
  { "drawn.cy_rear", 'r', 'o', (int32_t)offsetof(model, drawn_si[2]), FMU_NO_RATE, 0.0, 1.0, -1.0, "N/rad", "cornering stiffness, rear, drawn for this row" },
  { "true.bias_accel_x", 'r', 'o', (int32_t)offsetof(model, y.bias[0]), FMU_NO_RATE, 0.0, 1.0, -1.0, "m/s2", "bias of accel_x" },
  { "true.bias_accel_y", 'r', 'o', (int32_t)offsetof(model, y.bias[1]), FMU_NO_RATE, 0.0, 1.0, -1.0, "m/s2", "bias of accel_y" },
  { "true.bias_yaw_rate", 'r', 'o', (int32_t)offsetof(model, y.bias[2]), FMU_NO_RATE, 0.0, 1.0, -1.0, "rad/s", "bias of yaw_rate" },
  { "true.relative.cx_front", 'r', 'o', (int32_t)offsetof(model, y.stiffness[0]), FMU_NO_RATE, 0.0, 1.0, -1.0, "1", "mean longitudinal stiffness, front, relative to nominal" },
  { "true.relative.cy_front", 'r', 'o', (int32_t)offsetof(model, y.stiffness[1]), FMU_NO_RATE, 0.0, 1.0, -1.0, "1", "mean cornering stiffness, front, relative to nominal" },
  { "true.relative.cy_rear", 'r', 'o', (int32_t)offsetof(model, y.stiffness[2]), FMU_NO_RATE, 0.0, 1.0, -1.0, "1", "mean cornering stiffness, rear, relative to nominal" },
  { "drawn.relative.cx_front", 'r', 'o', (int32_t)offsetof(model, y.drawn[0]), FMU_NO_RATE, 0.0, 1.0, -1.0, "1", "longitudinal stiffness, front, drawn for this row, relative to nominal" },
  { "drawn.relative.cy_front", 'r', 'o', (int32_t)offsetof(model, y.drawn[1]), FMU_NO_RATE, 0.0, 1.0, -1.0, "1", "cornering stiffness, front, drawn for this row, relative to nominal" },
  { "drawn.relative.cy_rear", 'r', 'o', (int32_t)offsetof(model, y.drawn[2]), FMU_NO_RATE, 0.0, 1.0, -1.0, "1", "cornering stiffness, rear, drawn for this row, relative to nominal" },
  /* end of table */
};
const int32_t fmu_variable_count = (int32_t)(sizeof fmu_variables / sizeof fmu_variables[0]);

