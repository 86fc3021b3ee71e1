/* tests/unit/host/test_describe.c <-> src/host/describe.c, self_test.c. Builds that fail
 * the self-test: tests/test_build.py. */
#include "model/state.h"
#include "tse/describe.h"
#include "tse/learnt.h"
#include "tse/replay.h"
#include "tse/simulate.h"

#include "unit_support.h"

#define STRUCT_BYTES 2048

static const tse_field *rows_of(tse_struct which, int32_t *count, int32_t *size)
{
  const tse_field *const f = tse_describe(which, count, size);
  TEST_ASSERT_NOT_NULL(f);
  TEST_ASSERT_TRUE(*count > 0);
  return f;
}

static size_t bytes_of(char kind)
{
  if (kind == 's') return sizeof(tse_setting);
  if (kind == 'r') return sizeof(tse_real);
  if (kind == 'p' || kind == 'o') return sizeof(tse_real *);
  TEST_ASSERT_TRUE(kind == 'i' || kind == 'u');
  return 4;
}

/* ------------------------------------------------------------------------------------------- layout */

/* Mark the bytes that the rows describe. Returned: number of bytes without a row */
static int undescribed(tse_struct which, size_t expected_size, unsigned char covered[STRUCT_BYTES])
{
  int32_t count, size;
  const tse_field *const f = rows_of(which, &count, &size);
  TEST_ASSERT_EQUAL_INT32((int32_t)expected_size, size);
  TEST_ASSERT_TRUE(expected_size <= STRUCT_BYTES);
  memset(covered, 0, STRUCT_BYTES);
  for (int32_t i = 0; i < count; i++) {
    const size_t bytes = bytes_of(f[i].kind);
    TEST_ASSERT_TRUE_MESSAGE(f[i].offset >= 0 && (size_t)f[i].offset + bytes <= expected_size, f[i].name);
    TEST_ASSERT_TRUE_MESSAGE((size_t)f[i].offset % bytes == 0, f[i].name);
    for (size_t b = 0; b < bytes; b++) {
      TEST_ASSERT_TRUE_MESSAGE(!covered[(size_t)f[i].offset + b], f[i].name); /* no shared bytes */
      covered[(size_t)f[i].offset + b] = 1;
    }
  }
  int left = 0;
  for (size_t b = 0; b < expected_size; b++) left += !covered[b];
  return left;
}

/* Return the number of bytes from the end of the last member to the end of the struct. */
#define TAIL(type, last) ((int)(sizeof(type) - offsetof(type, last) - sizeof(((type *)0)->last)))

static void test_rows_describe_every_byte_of_the_structs_but_padding(void)
{
  unsigned char covered[STRUCT_BYTES];
  size_t settings = 0; /* integers are in several groups, with padding behind an odd number of them */
  EACH_SETTING(row)
  settings += row->kind == 's' ? sizeof(tse_setting) : sizeof(int32_t);
  TEST_ASSERT_EQUAL_INT(
      (int)(sizeof(tse_config) - settings), undescribed(TSE_STRUCT_CONFIG, sizeof(tse_config), covered));
  TEST_ASSERT_EQUAL_INT(TAIL(tse_input, grade), undescribed(TSE_STRUCT_INPUT, sizeof(tse_input), covered));
  TEST_ASSERT_EQUAL_INT(
      TAIL(tse_output, spread_seen), undescribed(TSE_STRUCT_OUTPUT, sizeof(tse_output), covered));
  TEST_ASSERT_EQUAL_INT(
      TAIL(tse_sim_config, seed), undescribed(TSE_STRUCT_SIM_CONFIG, sizeof(tse_sim_config), covered));
  TEST_ASSERT_EQUAL_INT(0, undescribed(TSE_STRUCT_REPLAY_LOG, sizeof(tse_replay_log), covered));
  TEST_ASSERT_EQUAL_INT(0, undescribed(TSE_STRUCT_REPLAY_START, sizeof(tse_replay_start), covered));
  TEST_ASSERT_EQUAL_INT(0, undescribed(TSE_STRUCT_REPLAY_OUT, sizeof(tse_replay_out), covered));
  TEST_ASSERT_EQUAL_INT(
      TAIL(tse_sim_input, grade), undescribed(TSE_STRUCT_SIM_INPUT, sizeof(tse_sim_input), covered));
}

/* The simulator's log row contains dt, which the caller sets (0 in the first row),
 * `missing` and measured velocities, which are always 0. */
static void test_rows_describe_every_byte_of_the_simulators_output_but_dt_and_missing(void)
{
  unsigned char covered[STRUCT_BYTES];
  const int row_tail = (int)sizeof(tse_input) - (int)offsetof(tse_input, missing);
  TEST_ASSERT_EQUAL_INT(
      (int)sizeof(tse_real) + row_tail, undescribed(TSE_STRUCT_SIM_OUTPUT, sizeof(tse_sim_output), covered));
  TEST_ASSERT_FALSE(covered[offsetof(tse_sim_output, row.dt)]);
  TEST_ASSERT_FALSE(covered[offsetof(tse_sim_output, row.missing)]);
}

static void test_names_are_unique_and_texts_are_there(void)
{
  for (int which = 0; which < TSE_STRUCTS; which++) {
    int32_t count, size;
    const tse_field *const f = rows_of((tse_struct)which, &count, &size);
    for (int32_t i = 0; i < count; i++) {
      TEST_ASSERT_TRUE_MESSAGE(f[i].name[0] != 0 && f[i].unit != NULL, f[i].name);
      TEST_ASSERT_TRUE_MESSAGE(strlen(f[i].text) > 1, f[i].name);
      for (int32_t j = 0; j < i; j++) TEST_ASSERT_TRUE_MESSAGE(strcmp(f[i].name, f[j].name) != 0, f[i].name);
    }
  }
}

static void test_inputs_are_the_columns_of_a_log(void)
{
  static const char *const names[] = { "dt", "steer_angle", "wheel_speed_front", "wheel_speed_rear",
    "accel_x", "accel_y", "yaw_rate", "missing", "given", "ins_vel_x", "ins_vel_y", "gnss_speed",
    "gnss_course", "brake", "wheel_torque_front", "wheel_torque_rear", "bank", "grade" };
  static const char *const units[] = { "s", "rad", "rad/s", "rad/s", "m/s2", "m/s2", "rad/s", "", "", "m/s",
    "m/s", "m/s", "rad", "1", "Nm", "Nm", "rad", "rad" };
  int32_t count, size;
  const tse_field *const f = rows_of(TSE_STRUCT_INPUT, &count, &size);
  TEST_ASSERT_EQUAL_INT(ROWS(names), count);
  for (int i = 0; i < ROWS(units); i++) {
    TEST_ASSERT_EQUAL_STRING(names[i], f[i].name);
    TEST_ASSERT_EQUAL_STRING(units[i], f[i].unit);
    TEST_ASSERT_EQUAL_INT("rrrrrrruurrrrrrrrr"[i], f[i].kind);
  }
}

/* -------------- a name leads to its member; a member outside arrays has the same name in src/tables */

static double at(const void *object, tse_struct which, const char *name)
{
  const tse_field *const f = field_of(which, name);
  return f->kind == 's' ? of_setting(setting_field(object, f))
      : f->kind == 'r'  ? number(real_field(object, f))
                        : (double)whole_field(object, f);
}

#define EXPECT_AT(object, which, name, value) \
  do { \
    (object)->value = real(41); \
    expect_near(41, at(object, which, name), 0, name, 0); \
    (object)->value = real(0); \
  } while (0)
#define EXPECT_WHOLE_AT(object, which, name, value) \
  do { \
    (object)->value = 41; \
    expect_near(41, at(object, which, name), 0, name, 0); \
    (object)->value = 0; \
  } while (0)

static void test_output_names_lead_to_their_members(void)
{
  tse_output y = blank_output();
  static const struct {
    const char *name, *sd, *secant, *spread, *seen, *valid;
    int index;
  } stiffness_rows[] = {
    { "cx_front", "cx_front_sd", "cx_front_secant", "cx_front_spread", "cx_front_spread_seen",
        "cx_front_valid", TSE_CX_FRONT },
    { "cy_front", "cy_front_sd", "cy_front_secant", "cy_front_spread", "cy_front_spread_seen",
        "cy_front_valid", TSE_CY_FRONT },
    { "cy_rear", "cy_rear_sd", "cy_rear_secant", "cy_rear_spread", "cy_rear_spread_seen", "cy_rear_valid",
        TSE_CY_REAR },
  };
  static const char *const noise[3] = { "noise_accel_x", "noise_accel_y", "noise_yaw_rate" };
  static const char *const bias[3][2] = { { "bias_accel_x", "bias_accel_x_sd" },
    { "bias_accel_y", "bias_accel_y_sd" }, { "bias_yaw_rate", "bias_yaw_rate_sd" } };
  for (int i = 0; i < 3; i++) {
    EXPECT_AT(&y, TSE_STRUCT_OUTPUT, stiffness_rows[i].name, stiffness[stiffness_rows[i].index]);
    EXPECT_AT(&y, TSE_STRUCT_OUTPUT, stiffness_rows[i].sd, stiffness_sd[stiffness_rows[i].index]);
    EXPECT_AT(&y, TSE_STRUCT_OUTPUT, stiffness_rows[i].secant, stiffness_secant[stiffness_rows[i].index]);
    EXPECT_AT(&y, TSE_STRUCT_OUTPUT, stiffness_rows[i].spread, stiffness_spread[stiffness_rows[i].index]);
    EXPECT_WHOLE_AT(&y, TSE_STRUCT_OUTPUT, stiffness_rows[i].seen, spread_seen[stiffness_rows[i].index]);
    EXPECT_AT(&y, TSE_STRUCT_OUTPUT, noise[i], noise[i]);
    EXPECT_WHOLE_AT(&y, TSE_STRUCT_OUTPUT, stiffness_rows[i].valid, reason[stiffness_rows[i].index]);
    EXPECT_AT(&y, TSE_STRUCT_OUTPUT, bias[i][0], bias[i]);
    EXPECT_AT(&y, TSE_STRUCT_OUTPUT, bias[i][1], bias_sd[i]);
  }
}

static void test_simulator_names_lead_to_their_members(void)
{
  static const char *const mean[3] = { "true_cx_front", "true_cy_front", "true_cy_rear" },
                           *const drawn[3] = { "drawn_cx_front", "drawn_cy_front", "drawn_cy_rear" };
  static const char *const bias[3] = { "true_bias_accel_x", "true_bias_accel_y", "true_bias_yaw_rate" };
  static const int which[3] = { TSE_CX_FRONT, TSE_CY_FRONT, TSE_CY_REAR };
  tse_sim_output y = { 0 };
  EXPECT_AT(&y, TSE_STRUCT_SIM_OUTPUT, "true_vel_x", vel_x);
  EXPECT_AT(&y, TSE_STRUCT_SIM_OUTPUT, "accel_x", row.accel_x);
  EXPECT_AT(&y, TSE_STRUCT_SIM_OUTPUT, "true_accel_x", accel_x);
  for (int i = 0; i < 3; i++) {
    EXPECT_AT(&y, TSE_STRUCT_SIM_OUTPUT, mean[i], stiffness[which[i]]);
    EXPECT_AT(&y, TSE_STRUCT_SIM_OUTPUT, drawn[i], drawn[which[i]]);
    EXPECT_AT(&y, TSE_STRUCT_SIM_OUTPUT, bias[i], bias[i]);
  }
}

/* Ranges are those that the library enforces. For settings test_settings.c and
 * test_simulate.c check this, for rows test_input.c and test_simulate.c. */

/* --------------------------------------------------------------------------------- statuses and reasons */

static void test_statuses_are_complete_and_tell_the_sentence_of_tse_status_text(void)
{
  static const struct {
    const char *name;
    int code;
  } expected[] = {
    { "TSE_E_BUILD", -12 },
    { "TSE_E_FORMAT", -11 },
    { "TSE_E_OLD", -10 },
    { "TSE_E_VEHICLE", -9 },
    { "TSE_E_VERSION", -8 },
    { "TSE_E_LEARNT", -7 },
    { "TSE_E_SIZE", -6 },
    { "TSE_E_STATE", -5 },
    { "TSE_E_TIME", -4 },
    { "TSE_E_INPUT", -3 },
    { "TSE_E_CONFIG", -2 },
    { "TSE_E_NULL", -1 },
    { "TSE_OK", 0 },
    { "TSE_W_NOT_VALID", 1 },
    { "TSE_W_STARTING", 2 },
    { "TSE_W_MISSING_CHANNEL", 3 },
    { "TSE_W_HELD", 4 },
    { "TSE_W_PREDICTED", 5 },
    { "TSE_W_GAP", 6 },
    { "TSE_W_RECOVERED", 7 },
    { "TSE_W_WAITING", 8 },
    { "TSE_W_RANGE", 9 },
    { "TSE_W_IMPLAUSIBLE", 10 },
  };
  int32_t count, size;
  const tse_field *const f = rows_of(TSE_STRUCT_STATUS, &count, &size);
  TEST_ASSERT_EQUAL_INT(ROWS(expected), count);
  TEST_ASSERT_EQUAL_INT(TSE_STATUS_END_, expected[ROWS(expected) - 1].code + 1);
  for (int i = 0; i < count; i++) {
    TEST_ASSERT_EQUAL_STRING(expected[i].name, f[i].name);
    TEST_ASSERT_EQUAL_INT(expected[i].code, f[i].offset);
    TEST_ASSERT_EQUAL_INT('c', f[i].kind);
    TEST_ASSERT_EQUAL_STRING(tse_status_text(f[i].offset), f[i].text);
  }
  TEST_ASSERT_EQUAL_STRING("unknown status", tse_status_text(TSE_STATUS_END_));
  TEST_ASSERT_EQUAL_STRING("unknown status", tse_status_text(expected[0].code - 1));
}

static void test_reasons_are_complete_and_tell_the_sentence_of_tse_reason_text(void)
{
  static const char *const words[] = { "valid", "starting", "not excited", "uncertain", "sensor fault",
    "held", "input invalid", "parameters uncertain", "does not fit", "implausible" };
  int32_t count, size;
  const tse_field *const f = rows_of(TSE_STRUCT_REASON, &count, &size);
  TEST_ASSERT_EQUAL_INT(ROWS(words), count);
  TEST_ASSERT_EQUAL_INT(TSE_REASON_END_, count);
  for (int i = 0; i < count; i++) {
    TEST_ASSERT_EQUAL_STRING(words[i], f[i].name);
    TEST_ASSERT_EQUAL_INT(i, f[i].offset);
    TEST_ASSERT_EQUAL_INT('c', f[i].kind);
    TEST_ASSERT_EQUAL_STRING(tse_reason_text(i), f[i].text);
  }
  TEST_ASSERT_EQUAL_STRING("unknown reason", tse_reason_text(TSE_REASON_END_));
  TEST_ASSERT_EQUAL_STRING("unknown reason", tse_reason_text(-1));
}

/* ------------------------------------------------------------------- unknown structs, and the build */

static void test_unknown_struct_is_null_with_no_rows_and_nobody_need_ask_how_many(void)
{
  const int unknown[] = { TSE_STRUCTS, TSE_STRUCTS + 1, 1000, -1 };
  for (int i = 0; i < ROWS(unknown); i++) {
    int32_t count = 7, size = 7;
    TEST_ASSERT_NULL(tse_describe((tse_struct)unknown[i], &count, &size));
    TEST_ASSERT_EQUAL_INT32(0, count);
    TEST_ASSERT_EQUAL_INT32(0, size);
    TEST_ASSERT_NULL(tse_describe((tse_struct)unknown[i], NULL, NULL));
  }
  int32_t count, size;
  for (int which = 0; which < TSE_STRUCTS; which++)
    TEST_ASSERT_EQUAL_PTR(
        tse_describe((tse_struct)which, &count, &size), tse_describe((tse_struct)which, NULL, NULL));
}

static void test_build_tells_version_format_capacity_and_sizes(void)
{
  char version[32];
  tse_build b = { 0 };
  tse_describe_build(&b);
  (void)snprintf(
      version, sizeof version, "%d.%d.%d", TSE_VERSION_MAJOR, TSE_VERSION_MINOR, TSE_VERSION_PATCH);
  TEST_ASSERT_EQUAL_STRING(version, b.version);
#if defined(TSE_REAL_FIXED)
  TEST_ASSERT_EQUAL_STRING("fixed", b.format);
  TEST_ASSERT_EQUAL_INT32(TSE_FRACTION_BITS, b.fraction_bits);
#else
  TEST_ASSERT_EQUAL_STRING(BY_FORMAT("double", "float"), b.format);
  TEST_ASSERT_EQUAL_INT32(0, b.fraction_bits);
#endif
  TEST_ASSERT_EQUAL_INT32(TSE_MAX_PARTICLES, b.capacity);
  TEST_ASSERT_EQUAL_INT32((int32_t)sizeof(tse_filter), b.filter_bytes);
  TEST_ASSERT_EQUAL_INT32((int32_t)sizeof(tse_filter_paper), b.filter_paper_bytes);
  TEST_ASSERT_EQUAL_INT32((int32_t)sizeof(tse_params), b.params_bytes);
  TEST_ASSERT_EQUAL_INT32((int32_t)sizeof(tse_sim), b.sim_bytes);
  TEST_ASSERT_EQUAL_INT32(TSE_LEARNT_BYTES, b.learnt_bytes);
  tse_describe_build(NULL);
}

/* ----------------------------------------------------------------------------------------- the effects */

/* These ids are part of vehicle files and verdicts. They must not change. */
static void test_effects_that_were_once_there_stay(void)
{
  static const char *const ids[] = {
    "exact_kinematics",
    "aero_drag",
    "rolling_resistance",
    "grade",
    "bank",
    "body_roll",
    "pitch_leak",
    "tyre_saturation",
    "combined_slip",
    "relaxation",
    "lateral_load_transfer",
    "longitudinal_load_transfer",
    "steering_offset",
    "steering_ratio",
    "steering_lag",
    "steering_delay",
    "steering_compliance",
    "wheel_radius",
    "imu_lever_arm",
    "imu_scale_ax",
    "imu_scale_ay",
    "gyro_scale",
    "imu_misalignment",
    "imu_delay",
    "mass",
    "yaw_inertia",
    "cg_shift",
    "crosswind",
    "conicity",
    "rear_roll_steer",
    "aligning_moment",
    "longitudinal_relaxation",
    "stiffness_drift",
  };
  int32_t count;
  const tse_effect_row *const e = tse_describe_effects(&count);
  TEST_ASSERT_TRUE(count >= ROWS(ids));
  TEST_ASSERT_EQUAL_INT32(TSE_EFFECTS, count);
  TEST_ASSERT_TRUE(tse_describe_effects(NULL) == e);
  for (int k = 0; k < ROWS(ids); k++) {
    int found = 0;
    for (int32_t i = 0; i < count; i++) found += strcmp(e[i].id, ids[k]) == 0;
    TEST_ASSERT_EQUAL_INT_MESSAGE(1, found, ids[k]);
  }
  for (int32_t i = 0; i < count; i++) {
    TEST_ASSERT_EQUAL_INT32(i, e[i].bit);
    TEST_ASSERT_TRUE(strlen(e[i].title) > 3 && strlen(e[i].entry_point) > 3 && strlen(e[i].channels) > 3);
    TEST_ASSERT_TRUE(strlen(e[i].look_alikes) > 3 && strlen(e[i].estimator) > 3 && strlen(e[i].hook) > 2);
  }
}

/* Each parameter is a setting with the same default and range. The off value is 0, and so
 * are all defaults except kinematics. Typical and negligible strengths are within the
 * range. */
static void test_parameters_of_effects_are_settings_with_sizes_that_make_sense(void)
{
  int32_t count, effects;
  const tse_effect_parameter *const p = tse_describe_effect_parameters(&count);
  const tse_effect_row *const e = tse_describe_effects(&effects);
  const tse_config known = config_by(tse_config_exact);
  TEST_ASSERT_TRUE(tse_describe_effect_parameters(NULL) == p);
  for (int32_t i = 0; i < count; i++) {
    char name[80];
    const tse_field *const f = field_of(TSE_STRUCT_CONFIG, p[i].setting);
    (void)snprintf(name, sizeof name, "%s_%s", p[i].effect, p[i].parameter);
    TEST_ASSERT_EQUAL_STRING(name, p[i].setting);
    TEST_ASSERT_EQUAL_STRING(f->unit, p[i].unit);
    TEST_ASSERT_EQUAL_STRING(f->text, p[i].text);
    TEST_ASSERT_TRUE_MESSAGE(setting_field(&known, f) == setting(p[i].def), name);
    TEST_ASSERT_TRUE(!(f->lo < p[i].lo) && !(f->lo > p[i].lo) && !(f->hi < p[i].hi) && !(f->hi > p[i].hi));
    TEST_ASSERT_TRUE_MESSAGE(
        p[i].lo <= p[i].typical_lo && p[i].typical_lo <= p[i].typical_hi && p[i].typical_hi <= p[i].hi, name);
    const double usual = strcmp(name, "exact_kinematics_share") ? 0 : 1;
    if (p[i].strength > 0)
      TEST_ASSERT_TRUE_MESSAGE(!(p[i].def < usual) && !(p[i].def > usual) && p[i].negligible > 0
              && p[i].negligible < p[i].typical_lo,
          name);
    else TEST_ASSERT_TRUE_MESSAGE(!(p[i].negligible > 0), name);
  }
  for (int32_t k = 0; k < effects; k++) {
    int strengths = 0;
    for (int32_t i = 0; i < count; i++) strengths += strcmp(p[i].effect, e[k].id) == 0 && p[i].strength > 0;
    TEST_ASSERT_TRUE_MESSAGE(strengths > 0, e[k].id);
  }
}

/* A row for every setting, in the order of tse_config; one that takes its place is a setting, too. */
static void test_the_use_of_every_setting_is_described(void)
{
  int32_t count, fields;
  const tse_setting_row *const row = tse_describe_settings(&count);
  const tse_field *const f = tse_describe(TSE_STRUCT_CONFIG, &fields, NULL);
  TEST_ASSERT_EQUAL_INT32(fields, count);
  TEST_ASSERT_TRUE(tse_describe_settings(NULL) == row);
  for (int32_t i = 0; i < count; i++) {
    TEST_ASSERT_EQUAL_STRING(f[i].name, row[i].name);
    TEST_ASSERT_TRUE_MESSAGE(strlen(row[i].table) > 2 && strlen(row[i].filter) > 3, row[i].name);
    if (*row[i].replaced_by) (void)field_of(TSE_STRUCT_CONFIG, row[i].replaced_by);
  }
}

/* The mask of tse_prepare() consists of these bits. */
static void test_a_strength_sets_the_bit_of_its_effect(void)
{
  int32_t count, effects;
  const tse_effect_parameter *const p = tse_describe_effect_parameters(&count);
  const tse_effect_row *const e = tse_describe_effects(&effects);
  for (int32_t i = 0; i < count; i++) {
    tse_config c = config_by(tse_config_exact);
    int32_t bit = -1;
    c.exact_kinematics_share = setting(0);
    const tse_setting value = setting(0.5 * (p[i].def + p[i].hi));
    memcpy((char *)&c + field_of(TSE_STRUCT_CONFIG, p[i].setting)->offset, &value, sizeof value);
    for (int32_t k = 0; k < effects; k++)
      if (strcmp(e[k].id, p[i].effect) == 0) bit = e[k].bit;
    TEST_ASSERT_TRUE_MESSAGE(
        prepared(c).effects.mask == (p[i].strength > 0 ? (uint64_t)1 << bit : 0), p[i].setting);
  }
}

static void test_this_build_computes_as_it_is_tested(void)
{
  const char *wrong = "nothing";
  TEST_ASSERT_EQUAL_INT_MESSAGE(TSE_OK, tse_self_test(&wrong), wrong);
  TEST_ASSERT_EQUAL_STRING("nothing", wrong);
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_self_test(NULL));
}
