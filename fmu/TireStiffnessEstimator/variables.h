/* fmu/TireStiffnessEstimator/variables.h - every variable of the FMU, in the order of its value references. Part of model.c. */
#include "tables/columns.h"
#include "tables/settings.h"

#define CHANNEL(name, drives, lo, hi, unit, text) INPUT(#name, name, lo, hi, unit, text "; not a number: missing")
#define VELOCITY(name, drives, lo, hi, unit, text) INPUT("velocity." #name, name, lo, hi, unit, text COUNTS)
#define PEDAL(name, drives, lo, hi, unit, text) INPUT("pedals." #name, name, lo, hi, unit, text COUNTS)
#define INPUT(name, member, lo, hi, unit, text) { name, 'r', 'i', (int32_t)offsetof(model, row.member), FMU_NO_RATE, 0.0, lo, hi, unit, text },
#define COUNTS "; counts where its bit of given is set"
#define NUMBER(name, member, unit, text) OUTPUT("estimate." #name, 'r', y.member, unit, text)
#define FLAG(name, member, text) OUTPUT("estimate." #name, 'b', y.member, "", text)
#define CODE(name, member, type, text) OUTPUT("estimate." #name, 'e', y.member, type, text)
#define STIFFNESS(name, member, si, unit, text) OUTPUT("estimate." #name, 'r', si, unit, text)
#define SHARE(name, member, si, unit, text) OUTPUT("estimate.relative." #name, 'r', y.member, "1", text ", relative to nominal")
#define REASON(name, member, valid, what) \
  OUTPUT("estimate." #name "_valid", 'b', valid, "", what " may be used") OUTPUT("estimate." #name "_reason", 'e', y.member, "Reason", REASONS)

const fmu_variable fmu_variables[] = {
  CHANNELS(CHANNEL)
  { "missing", 'i', 'i', (int32_t)offsetof(model, row.missing), FMU_NO_RATE, 0.0, 0.0, (1 << TSE_CHANNELS) - 1, "",
    "channels that are missing, for importers that cannot send NaN: sum of 1 steer_angle, 2 wheel_speed_front, 4 wheel_speed_rear, "
    "8 accel_x, 16 accel_y, 32 yaw_rate" },
  { "velocity.given", 'i', 'i', (int32_t)offsetof(model, row.given), FMU_NO_RATE, 0.0, 0.0, (1 << TSE_VELOCITIES) - 1, "",
    "velocities that are measured; 0: none, then they are not read: sum of 1 ins_vel_x, 2 ins_vel_y, 4 gnss_speed, 8 gnss_course" },
  VELOCITIES(VELOCITY)
  { "pedals.given", 'i', 'i', (int32_t)offsetof(model, pedals_given), FMU_NO_RATE, 0.0, 0.0, (1 << (TSE_OPTIONALS - TSE_VELOCITIES)) - 1, "",
    "what of the pedals is known; 0: nothing, then they are not read: sum of 1 brake, 2 wheel_torque_front, 4 wheel_torque_rear" },
  PEDALS(PEDAL)

  { "vehicle.calibrated", 'b', 'p', (int32_t)offsetof(model, calibrated), FMU_NO_RATE, 0.0, 1.0, -1.0, "",
    "false: an ordinary car of its class, and what is set of it wins: stiffness and yaw inertia that are not set follow from mass, lf "
    "and lr, with the uncertainties of such a car; true: every parameter as it is, an uncertainty of 0 is none" },
  SETTINGS(PARAMETER, WHOLE_PARAMETER)

  OUTPUTS(NUMBER, FLAG, CODE, STIFFNESS, REASON)
  OUTPUT("estimate.nominal.cx_front", 'r', nominal[0], "N",
         "nominal longitudinal stiffness of the front axle, of which estimate.relative.cx_front is a share")
  OUTPUT("estimate.nominal.cy_front", 'r', nominal[1], "N/rad",
         "nominal cornering stiffness of the front axle, of which estimate.relative.cy_front is a share")
  OUTPUT("estimate.nominal.cy_rear", 'r', nominal[2], "N/rad",
         "nominal cornering stiffness of the rear axle, of which estimate.relative.cy_rear is a share")
  OUTPUT("estimate.valid", 'b', all_valid, "", "all three stiffnesses may be used")
  OUTPUTS(NO_COLUMN, NO_COLUMN, NO_COLUMN, SHARE, NO_COLUMN)
};
const int32_t fmu_variable_count = (int32_t)(sizeof fmu_variables / sizeof fmu_variables[0]);

