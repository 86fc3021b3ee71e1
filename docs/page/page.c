/* docs/page/page.c - the library as WebAssembly for a page, with static memory.
 *
 * tests/embedded/wasm/string.h replaces the C library. JavaScript finds the members of
 * structs by tse_describe(). page_layout() returns the offsets of tse_field itself and of
 * structs without a table.
 *
 * Two independent desks hold settings, filter, rows and a simulation each. The page
 * estimates a log on one desk and drives on the other. */
#define WASM_STRING
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include "tse.h"

#define EXPORT(name) __attribute__((export_name(#name))) name

enum { DESKS = 2, ROWS = 256 }; /* rows per call: few, to keep the page responsive */

typedef struct desk {
  tse_config config;
  tse_params params;
  tse_filter filter;
  tse_input row[ROWS];
  tse_output out[ROWS];
  tse_sim_config sim_config;
  tse_sim sim;
  tse_sim_input sim_input;
  tse_sim_output sim_output;
} desk;

static desk desks[DESKS];
static const char *wrong; /* name of the last refused setting */

/* ---- tables */

static const char *const vehicle_rows[] = {
  // clang-format off: table vehicle_names
  "mass", "yaw_inertia", "lf", "lr", "wheel_radius_front", "wheel_radius_rear",
  "longitudinal_stiffness_front", "longitudinal_stiffness_rear", "cornering_stiffness_front",
  "cornering_stiffness_rear", "rear_longitudinal_follows_front",
  // clang-format on: end of table
  NULL
};
static const char *const uncertainty_rows[] = {
  // clang-format off: table uncertainty_names
  "mass_sd", "yaw_inertia_sd", "cg_sd", "steer_ratio_sd", "steer_offset_sd", "accel_y_scale_sd",
  "wheel_delay_sd", "accel_delay_sd", "relaxation_sd", "lean_sd", "gyro_scale_sd", "trail_sd",
  "roll_steer_sd", "wheel_radius_sd", "model_sd", "grade_sd",
  // clang-format on: end of table
  NULL
};
static const char *const sensor_rows[] = {
  // clang-format off: table sensor_names
  "accel_x_sd", "accel_y_sd", "yaw_rate_sd", "wheel_noise_sd", "steer_lag_sd", "accel_x_bias_sd",
  "accel_y_bias_sd", "yaw_rate_bias_sd", "accel_x_bias_walk", "accel_y_bias_walk", "yaw_rate_bias_walk",
  // clang-format on: end of table
  NULL
};
static const char *const *const groups[] = { vehicle_rows, uncertainty_rows, sensor_rows };

/* Return the setting names of a group, with NULL at the end: 0 vehicle, 1 uncertainty,
 * 2 sensors. */
const char *const *EXPORT(page_group)(int32_t group) { return groups[group]; }

/* Offsets in tse_field: name, kind, offset, default, min, max, unit, text; its size. Rows
 * per call; bytes of an input and of an output row. Offsets in a desk: config, row, out,
 * sim_config, sim_input, sim_output. */
static const int32_t layout[] = { (int32_t)offsetof(tse_field, name), (int32_t)offsetof(tse_field, kind),
  (int32_t)offsetof(tse_field, offset), (int32_t)offsetof(tse_field, def), (int32_t)offsetof(tse_field, lo),
  (int32_t)offsetof(tse_field, hi), (int32_t)offsetof(tse_field, unit), (int32_t)offsetof(tse_field, text),
  (int32_t)sizeof(tse_field), ROWS, (int32_t)sizeof(tse_input), (int32_t)sizeof(tse_output),
  (int32_t)offsetof(desk, config), (int32_t)offsetof(desk, row), (int32_t)offsetof(desk, out),
  (int32_t)offsetof(desk, sim_config), (int32_t)offsetof(desk, sim_input),
  (int32_t)offsetof(desk, sim_output) };
const int32_t *EXPORT(page_layout)(void) { return layout; }

static int32_t count; /* fields of the last table */
static int32_t size;  /* bytes of its struct */

/* Return the fields of a struct (tse_struct). */
const tse_field *EXPORT(page_fields)(int32_t which) { return tse_describe((tse_struct)which, &count, &size); }
/* Return the number of fields that the last page_fields() returned. */
int32_t EXPORT(page_count)(void) { return count; }
const char *EXPORT(page_version)(void)
{
  static tse_build build;
  tse_describe_build(&build);
  return build.version;
}
/* Return the name of the last refused setting. */
const char *EXPORT(page_wrong)(void) { return wrong; }
int32_t EXPORT(page_self_test)(void) { return tse_self_test(&wrong); }

/* ---- a desk */

desk *EXPORT(page_desk)(int32_t k) { return &desks[k]; }

/* Set the defaults: an ordinary car of unknown mass. */
void EXPORT(page_defaults)(desk *d)
{
  tse_config_default(&d->config);
  tse_sim_config_default(&d->sim_config);
}

/* Set the defaults: the car of the simulator, known exactly. */
void EXPORT(page_exact)(desk *d)
{
  tse_config_exact(&d->config);
  tse_sim_config_default(&d->sim_config);
}

/* Replace unset settings by the values that the filter uses. */
void EXPORT(page_complete)(desk *d) { tse_config_complete(&d->config); }

/* Prepare a filter for its first row.   Returned: tse_status; < 0: see page_wrong() */
int32_t EXPORT(page_start)(desk *d)
{
  wrong = NULL;
  const tse_status prepared = tse_prepare(&d->config, &d->params, &wrong);
  return prepared < 0 ? prepared : tse_reset(&d->params, &d->filter, sizeof d->filter);
}

/* Run rows 0 .. n - 1 of the desk. For a refused row, only the status is set, as in
 * `tselab estimate`. */
void EXPORT(page_step)(desk *d, int32_t n)
{
  for (int32_t i = 0; i < n; i++) {
    const tse_status status = tse_step(&d->params, &d->filter, &d->row[i], &d->out[i]);
    if (status < 0) d->out[i].status = status;
  }
}

/* Start a simulated car with the settings of the desk.   Returned: tse_status */
int32_t EXPORT(page_sim_start)(desk *d)
{
  wrong = NULL;
  return tse_sim_reset(&d->sim, &d->config, &d->sim_config, &wrong);
}

/* Simulate a row and store it as row 0 of the desk.   Returned: tse_status */
int32_t EXPORT(page_sim_step)(desk *d)
{
  const tse_status status = tse_sim_step(&d->sim, &d->sim_input, &d->sim_output);
  if (status >= 0) {
    d->row[0] = d->sim_output.row;
    d->row[0].dt = d->sim_input.dt;
  }
  return status;
}
