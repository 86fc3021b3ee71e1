/* model/effects_acting.h - effects that act in the model, in the order of effects.toml: scripts/tables.py. */
/* table: acting_effects */
#include "model/effects/steering_ratio.h"
#include "model/effects/steering_offset.h"
#include "model/effects/steering_delay.h"
#include "model/effects/steering_lag.h"
#include "model/effects/exact_kinematics.h"
#include "model/effects/steering_compliance.h"
#include "model/effects/rear_roll_steer.h"
#include "model/effects/relaxation.h"
#include "model/effects/longitudinal_relaxation.h"
#include "model/effects/stiffness_drift.h"
#include "model/effects/combined_slip.h"
#include "model/effects/tyre_saturation.h"
#include "model/effects/longitudinal_load_transfer.h"
#include "model/effects/lateral_load_transfer.h"
#include "model/effects/aero_drag.h"
#include "model/effects/rolling_resistance.h"
#include "model/effects/grade.h"
#include "model/effects/bank.h"
#include "model/effects/crosswind.h"
#include "model/effects/conicity.h"
#include "model/effects/aligning_moment.h"
#include "model/effects/imu_lever_arm.h"
#include "model/effects/body_roll.h"
#include "model/effects/pitch_leak.h"
#include "model/effects/imu_misalignment.h"
#include "model/effects/imu_scale_ax.h"
#include "model/effects/imu_scale_ay.h"
#include "model/effects/gyro_scale.h"
#include "model/effects/imu_delay.h"
#define EFFECTS_INPUT(X) X(steering_ratio) X(steering_offset) X(steering_delay) X(steering_lag)
#define EFFECTS_SLIP(X) X(exact_kinematics) X(steering_compliance) X(rear_roll_steer)
#define EFFECTS_LAG(X) X(relaxation) X(longitudinal_relaxation)
#define EFFECTS_STIFFNESS(X) X(stiffness_drift) X(combined_slip) X(longitudinal_load_transfer) X(lateral_load_transfer)
#define EFFECTS_GRIP(X) X(tyre_saturation)
#define EFFECTS_BODY(X) X(aero_drag) X(rolling_resistance) X(grade) X(bank) X(crosswind) X(conicity) X(aligning_moment)
#define EFFECTS_SENSOR(X) X(imu_lever_arm) X(body_roll) X(pitch_leak) X(imu_misalignment) X(imu_scale_ax) X(imu_scale_ay) X(gyro_scale) X(imu_delay)
/* end of table */
