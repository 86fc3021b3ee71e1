/* tables/config_rows.h - contents of the arrays that config.h declares; typical values
 * for settings that are not set; and the settings of tse_config_exact(), which describes
 * a car whose parameters are known exactly. Included by estimator/settings.c only. */
#include <stddef.h>

#define CONFIG_REAL(fmu, name, def, exact, lo, hi, unit, text) \
  { #name, (uint16_t)offsetof(tse_config, name), TSE_S(def), TSE_S(lo), TSE_S(hi) },
#define CONFIG_WHOLE(fmu, name, def, exact, lo, hi, unit, text) \
  { #name, (uint16_t)offsetof(tse_config, name), def, lo, hi },
#define EFFECT_OF(REAL, effect, parameter, def, exact, lo, hi, unit, text, strength, ...) \
  { TSE_EFFECT_##effect, (strength) > 0 },

/* Typical values of a passenger car (the vehicle class). tse_prepare() uses them in place
 * of settings that are 0 ("not set"). The table is generated from uncalibrated.toml. */
// clang-format off: table car_class
#define CLASS_CORNERING_FRONT 12.5 /* [1/rad] front cornering stiffness / load of the axle; the compliance
                                    * of the steering is included */
#define CLASS_CORNERING_REAR 16.0 /* [1/rad] rear cornering stiffness / load of the axle */
#define CLASS_LONGITUDINAL 22.0 /* [1] slip stiffness / load of the axle; both axles have the same value
                                 * because they have the same tyres */
#define CLASS_MASS 1500.0 /* [kg] mass if it is not set */
#define CLASS_MASS_SD 0.3 /* [1] relative sd of mass if mass is not set; so large that no estimated
                           * stiffness is reported as valid */
// clang-format on: end of table

/* Settings whose values in tse_config_exact() differ from those in
 * tse_config_default(). */
#define SET(name, value) { (uint16_t)offsetof(tse_config, name), TSE_S(value) }
static const struct {
  uint16_t at;
  tse_setting value;
} exact[] = {
  // clang-format off: table exact
  SET(mass, 1900.0), SET(yaw_inertia, 3000.0), SET(longitudinal_stiffness_front, 160000.0),
  SET(longitudinal_stiffness_rear, 160000.0), SET(cornering_stiffness_front, 120000.0),
  SET(cornering_stiffness_rear, 140000.0), SET(mass_sd, 0.0), SET(yaw_inertia_sd, 0.0), SET(cg_sd, 0.0),
  SET(steer_ratio_sd, 0.0), SET(steer_offset_sd, 0.0), SET(accel_y_scale_sd, 0.0), SET(wheel_delay_sd, 0.0),
  SET(accel_delay_sd, 0.0), SET(relaxation_sd, 0.0), SET(lean_sd, 0.0), SET(gyro_scale_sd, 0.0),
  SET(trail_sd, 0.0), SET(roll_steer_sd, 0.0), SET(wheel_radius_sd, 0.0), SET(model_sd, 0.0),
  SET(grade_sd, 0.0), SET(accel_x_sd, 0.15), SET(accel_y_sd, 0.15), SET(yaw_rate_sd, 0.0034906585039887),
  SET(wheel_noise_sd, 0.0), SET(steer_lag_sd, 0.02), SET(accel_x_bias_sd, 0.05), SET(accel_y_bias_sd, 0.05),
  SET(yaw_rate_bias_sd, 0.002), SET(steering_lag_time, 0.0), SET(relaxation_length, 0.0),
  SET(tyre_saturation_shape, 0.0), SET(longitudinal_load_transfer_gain, 0.0),
  SET(lateral_load_transfer_gain, 0.0), SET(aero_drag_coefficient, 0.0),
  SET(rolling_resistance_coefficient, 0.0), SET(bank_superelevation, 0.0), SET(aligning_moment_trail, 0.0),
  SET(body_roll_gain, 0.0), SET(body_roll_frequency, 1.5), SET(body_roll_coupling, 0.0),
  SET(initial_cy_front_sd, 0.3), SET(initial_cy_rear_sd, 0.3), SET(grip, 0.0), SET(grip_sd, 0.0),
  SET(cg_height, 0.0),
  // clang-format on: end of table
};
