/* tests/unit/host/test_learnt.c <-> src/host/learnt.c, and its functions in start.c and
 * filter.c.
 *
 * Reference: bytes that the test writes one by one. The CRC has its published check
 * value. */
#include "filter/units.h"
#include "paper/paper.h"
#include "driven.h"

#include "tse/learnt.h"

#define DAY 86400u
#define UNIT (1.0 / 16777216) /* unit of numbers in the bytes */

/* Places of numbers in the bytes. */
enum {
  AT_KNOWN = 12,
  AT_NU = 16,
  AT_MEAN = 20,
  AT_SD = 64,
  AT_PAIR = 108,
  AT_NOISE = 220,
  AT_SPREAD = 240,
  AT_CORRELATION = 252
};

/* A learnt state of the built-in car. Binary fractions are exact in double, float and
 * fixed point. */
enum { LEARNT_KNOWN = 5, LEARNT_NU = 64, LEARNT_SIZE = 268 };
#define LEARNT_VEHICLE 0x6e6ba1d6u /* as in test_prepare.c */
static const double learnt_mean[11] = { -0.125, 0.0625, 0.0078125, -0.25, 0.125, 0.5, 0.0625, 0.00390625,
  0.015625, 0.0078125, 0.001953125 };
static const double learnt_sd[11] = { 0.03125, 0.015625, 0.00390625, 0.03125, 0.25, 0.0625, 0.125,
  0.0009765625, 0.0078125, 0.0078125, 0.001953125 };
static const double learnt_common[11] = { 0.5, -0.5, 0.25, 0.5, 0.75, -0.25, 0.125, 0.5, 0.25, -0.125,
  0.5 }; /* correlations are products of these */
static const double learnt_noise[5] = { 0.5, 2.0, 1.25, 1.0, 0.75 };
static const double learnt_particle_mean[3] = { -0.25, 0.125, 0.5 },
                    learnt_particle_sd[3] = { 0.03125, 0.25, 0.0625 }; /* stiffness over nominal, minus 1 */
static const double learnt_spread[3] = { 0.0625, 0.25, 0.125 }, learnt_correlation[3] = { 0.0, -0.5, 0.25 };
static uint8_t learnt_bytes[LEARNT_SIZE],
    learnt_by_particles[LEARNT_SIZE]; /* by a particle filter: stiffness, biases and process sd only */

static tse_filter_paper f, other, before; /* large enough for all filters */

static tse_config settings(int32_t form) /* the first form of this build, or 1 */
{
  tse_config c;
  if (form) tse_config_robust(&c);
  else tse_config_exact(&c);
  c.initial_spread = setting(0.3), c.spread_max = setting(0.4), c.particles = 64;
  return c;
}

/* Settings of the Kalman filter with a prior wider than the learnt sd, for all learnt
 * states. */
static tse_config open_settings(void)
{
  tse_config c = settings(0);
  c.accel_x_bias_sd = c.accel_y_bias_sd = setting(0.1), c.yaw_rate_bias_sd = setting(0.01);
  c.initial_cx_sd = c.initial_cy_front_sd = c.initial_cy_rear_sd = setting(0.4);
  c.grip_sd = setting(0.25), c.steer_offset_sd = setting(0.006), c.steer_ratio_sd = setting(0.03);
  c.steer_lag_sd = setting(0.03), c.wheel_radius_sd = setting(0.01), c.learnt_floor = setting(0);
  return c;
}

static void reset(const tse_params *p, tse_filter_paper *filter)
{
  memset(filter, 0x3c, sizeof *filter);
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_reset(p, &filter->filter, sizeof *filter));
}

static tse_status load(const tse_params *p, const uint8_t *bytes, size_t count, uint32_t age_s)
{
  reset(p, &f);
  return tse_learnt_load(p, &f.filter, bytes, count, age_s);
}

static void expect_refused(
    const tse_params *p, const uint8_t *bytes, size_t count, tse_status status, const char *what)
{
  before = f;
  TEST_ASSERT_EQUAL_INT_MESSAGE(status, tse_learnt_load(p, &f.filter, bytes, count, 0), what);
  TEST_ASSERT_EQUAL_MEMORY_MESSAGE(&before, &f, sizeof f, what);
}

/* A filter with the values of the table. */
static void know(const tse_params *p, tse_filter_paper *filter)
{
  reset(p, filter);
  filter->filter.started = 1, filter->filter.step = 1000, filter->nu = real(LEARNT_NU);
  for (int a = 0; a < 3; a++) {
    filter->filter.known[a] = LEARNT_KNOWN >> a & 1u ? TSE_KNOWN : TSE_UNKNOWN;
    filter->bias_var[a] = real(pow(learnt_sd[a] / number(p->sd[a]), 2));
  }
  for (int i = 0; i < 64; i++) {
    filter->weight[i] = TSE_R(1);
    for (int a = 0; a < 3; a++) {
      const int diagonal[3] = { 0, 3, 5 }, off[3] = { 1, 2, 4 },
                pairs[3][2] = { { 0, 1 }, { 0, 2 }, { 1, 2 } };
      const double lam = (LEARNT_NU - 4.0) / LEARNT_NU, u = learnt_spread[pairs[a][0]],
                   v = learnt_spread[pairs[a][1]];
      filter->p.mu[a][i] = real(learnt_particle_mean[a]
          + (i % 2 ? -1 : 1) * learnt_particle_sd[a]); /* gamma is 0: only their scatter counts */
      filter->p.lam[diagonal[a]][i] = real(lam * learnt_spread[a] * learnt_spread[a]);
      filter->p.lam[off[a]][i] = real(lam * learnt_correlation[a] * u * v);
      filter->p.bias[a][i] = real(learnt_mean[a] / number(p->sd[a]));
    }
  }
}

static uint32_t word(const uint8_t *at)
{
  return (uint32_t)at[0] | (uint32_t)at[1] << 8 | (uint32_t)at[2] << 16 | (uint32_t)at[3] << 24;
}

static double q24(const uint8_t *at) { return (int32_t)word(at) * UNIT; }

static void put(uint8_t *at, uint32_t value, int count)
{
  for (int i = 0; i < count; i++) at[i] = (uint8_t)(value >> (8 * i) & 255u);
}

static void put_q24(uint8_t *at, const double *x, int count)
{
  for (int i = 0; i < count; i++) put(at + 4 * i, (uint32_t)(int32_t)lround(x[i] * 16777216), 4);
}

static void write_learnt(
    uint8_t *out, const double mean[11], const double sd[11], const double shared[11], const double noise[5])
{
  memcpy(out, "tsel", 4);
  put(out + 4, 3u | (uint32_t)LEARNT_SIZE << 16, 4); /* format, length */
  put(out + 8, LEARNT_VEHICLE, 4);
  put(out + AT_KNOWN, LEARNT_KNOWN, 4);
  put(out + AT_NU, LEARNT_NU, 4);
  put_q24(out + AT_MEAN, mean, 11);
  put_q24(out + AT_SD, sd, 11);
  for (int i = 0, at = AT_PAIR; i < 11; i++)
    for (int j = i + 1; j < 11; j++, at += 2)
      put(out + at, (uint32_t)(int32_t)lround(shared[i] * shared[j] * 16384), 2);
  put_q24(out + AT_NOISE, noise, 5);
  put_q24(out + AT_SPREAD, learnt_spread, 3);
  put_q24(out + AT_CORRELATION, learnt_correlation, 3);
  put(out + LEARNT_SIZE - 4, crc32_of(out, LEARNT_SIZE - 4), 4);
}

static void write_both(void)
{
  const double none[11] = { 0 };
  double mean[11] = { 0 }, sd[11] = { 0 };
  for (int a = 0; a < 3; a++) {
    mean[a] = learnt_mean[a], mean[3 + a] = log(1 + learnt_particle_mean[a]);
    sd[a] = learnt_sd[a], sd[3 + a] = learnt_particle_sd[a] / (1 + learnt_particle_mean[a]);
  }
  write_learnt(learnt_bytes, learnt_mean, learnt_sd, learnt_common, learnt_noise);
  write_learnt(learnt_by_particles, mean, sd, none, none);
}

static void set_bytes(uint8_t *bytes, int at, uint32_t value, int count)
{
  put(bytes + at, value, count);
  put(bytes + TSE_LEARNT_BYTES - 4, crc32_of(bytes, TSE_LEARNT_BYTES - 4), 4);
}

/* Write these bytes, cut off or padded with zeros, with another mark, format and length
 * and a correct CRC. */
static size_t framed(uint8_t *out, const char *mark, uint32_t format, size_t count)
{
  const size_t body = TSE_LEARNT_BYTES - 4;
  memset(out, 0, count);
  memcpy(out, learnt_bytes, count - 4 < body ? count - 4 : body);
  memcpy(out, mark, 4);
  put(out + 4, format | (uint32_t)count << 16, 4);
  put(out + count - 4, crc32_of(out, count - 4), 4);
  return count;
}

static void set_word(uint8_t *bytes, int at, uint32_t value) { set_bytes(bytes, at, value, 4); }

/* Write the bytes of the table with another word and a correct CRC. */
static void learnt_with(uint8_t *bytes, int at, uint32_t value)
{
  memcpy(bytes, learnt_bytes, sizeof learnt_bytes);
  set_word(bytes, at, value);
}

/* -------------------------------------------------------------------------------------------- bytes */

static void test_crc_has_the_published_check_value(void)
{
  static const uint8_t digits[] = { '1', '2', '3', '4', '5', '6', '7', '8', '9' };
  TEST_ASSERT_EQUAL_HEX32(0xcbf43926u, crc32_of(digits, sizeof digits));
  TEST_ASSERT_EQUAL_HEX32(0u, crc32_of(digits, 0));
}

/* The same bytes in every format, except for rounding. Float: a relative 2^-24 is one
 * unit of 2^-24 at 1. Fixed point squares and divides numbers of a few thousand steps.
 * Double: a logarithm may round to the other side of a half. */
static void test_saved_bytes_are_those_of_the_format(void)
{
  const tse_params p = prepared(settings(1));
  uint8_t out[TSE_LEARNT_BYTES];
  know(&p, &f);
  before = f;
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_learnt_save(&p, &f.filter, out));
  TEST_ASSERT_EQUAL_MEMORY(&before, &f, sizeof f);
  TEST_ASSERT_EQUAL_MEMORY(learnt_by_particles, out, AT_MEAN);
  for (int i = AT_MEAN; i < TSE_LEARNT_BYTES - 4; i += 4) {
    if (i >= AT_PAIR && i < AT_NOISE) TEST_ASSERT_EQUAL_HEX32(0, word(out + i));
    else
      expect_near(q24(learnt_by_particles + i), q24(out + i),
          BY_NUMBER(1.01 * UNIT, 4 * UNIT, i < AT_CORRELATION ? 1e-4 : 5e-3), "number at byte", i);
  }
  TEST_ASSERT_EQUAL_HEX32(crc32_of(out, TSE_LEARNT_BYTES - 4), word(out + TSE_LEARNT_BYTES - 4));
}

static void test_any_damaged_byte_is_detected_and_changes_nothing(void)
{
  const tse_params p = prepared(settings(1));
  uint8_t bytes[TSE_LEARNT_BYTES];
  reset(&p, &f);
  before = f;
  for (int i = 0; i < TSE_LEARNT_BYTES; i++)
    for (int flip = 1; flip < 256; flip++) {
      memcpy(bytes, learnt_bytes, sizeof bytes);
      bytes[i] = (uint8_t)(bytes[i] ^ flip);
      TEST_ASSERT_EQUAL_INT(TSE_E_LEARNT, tse_learnt_load(&p, &f.filter, bytes, sizeof bytes, 0));
    }
  TEST_ASSERT_EQUAL_MEMORY(&before, &f, sizeof f);
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_learnt_load(&p, &f.filter, learnt_bytes, sizeof learnt_bytes, 0));
}

static void test_what_is_too_short_too_long_or_something_else_is_refused(void)
{
  const tse_params p = prepared(settings(1));
  static uint8_t longer[70000];
  memcpy(longer, learnt_bytes, sizeof learnt_bytes);
  reset(&p, &f);
  for (size_t n = 0; n < sizeof learnt_bytes; n++)
    expect_refused(&p, learnt_bytes, n, TSE_E_LEARNT, "too short");
  expect_refused(&p, longer, sizeof learnt_bytes + 1, TSE_E_LEARNT, "something behind it");
  expect_refused(
      &p, longer, 65536 + sizeof learnt_bytes, TSE_E_LEARNT, "the length fits in its lower 16 bits");
  expect_refused(&p, longer, framed(longer, "tsel", TSE_LEARNT_FORMAT, sizeof learnt_bytes + 4), TSE_E_LEARNT,
      "another length");
  expect_refused(&p, longer, framed(longer, "tsep", TSE_LEARNT_FORMAT, sizeof learnt_bytes), TSE_E_LEARNT,
      "another mark");
  expect_refused(&p, longer, framed(longer, "tsel", 0, sizeof learnt_bytes), TSE_E_LEARNT,
      "format 0, as long as format 3");
  TEST_ASSERT_EQUAL_INT(
      TSE_OK, load(&p, longer, framed(longer, "tsel", TSE_LEARNT_FORMAT, sizeof learnt_bytes), 0));
}

static void test_other_formats_differ_from_damage(void)
{
  static const struct {
    uint32_t format, length;
    tse_status status;
  } cases[] = { { 1, 96, TSE_E_OLD }, { 2, 112, TSE_E_OLD }, { 4, TSE_LEARNT_BYTES + 13, TSE_E_VERSION } };
  const tse_params p = prepared(settings(1));
  uint8_t bytes[TSE_LEARNT_BYTES + 13];
  TEST_ASSERT_EQUAL_STRING(
      "the learnt state (estimates of an earlier drive) was written by an older version of this library; "
      "learn anew",
      tse_status_text(TSE_E_OLD));
  reset(&p, &f);
  for (int i = 0; i < ROWS(cases); i++) {
    expect_refused(&p, bytes, framed(bytes, "tsel", cases[i].format, cases[i].length), cases[i].status,
        "another format");
    bytes[30] ^= 1;
    expect_refused(&p, bytes, cases[i].length, TSE_E_LEARNT, "another format, damaged");
  }
}

/* From any source, with a correct CRC. */
static void test_numbers_that_cannot_be_are_refused_by_name(void)
{
  static const struct {
    int at;
    uint32_t value;
    const char *what;
  } bad[] = {
    /* below and above the limit; resulting status */
    { AT_KNOWN, 8, "bits of the learnt stiffnesses" },
    { AT_NU, 1000001, "degrees of freedom of the process sd" },
    { AT_MEAN, 0x32000001u, "bias of accel_x" },
    { AT_MEAN + 4, 0xcdffffffu, "bias of accel_y" },
    { AT_MEAN + 8, 0x06000001u, "bias of yaw_rate" },
    { AT_MEAN + 12, 0x04000001u, "mean of cx_front" },
    { AT_MEAN + 16, 0xfbffffffu, "mean of cy_front" },
    { AT_MEAN + 20, 0x80000000u, "mean of cy_rear" },
    { AT_MEAN + 24, 0x7fffffffu, "mean of grip" },
    { AT_MEAN + 28, 0x00400000u, "steering offset" },
    { AT_MEAN + 32, 0x00800001u, "steering ratio" },
    { AT_MEAN + 36, 0xffc00000u, "latency of the steering" },
    { AT_MEAN + 40, 0x00400000u, "wheel radius" },
    { AT_SD, 0x80000000u, "sd of the bias of accel_x" },
    { AT_SD + 8, 0xffffffffu, "sd of the bias of yaw_rate" },
    { AT_SD + 12, 0xffffffffu, "sd of cx_front" },
    { AT_SD + 24, 0xffffffffu, "sd of grip" },
    { AT_SD + 40, 0xffffffffu, "sd of the wheel radius" },
    { AT_NOISE, 0xffffffffu, "noise of a channel" },
    { AT_NOISE + 16, 0x80000000u, "noise of a channel" },
    { AT_SPREAD + 4, 0x80000000u, "process sd" },
    { AT_CORRELATION, 0x01000001u, "a correlation" },
    { AT_CORRELATION + 8, 0xfeffffffu, "a correlation" },
  };
  static const struct {
    int at;
    uint32_t value;
  } good[] = {
    { AT_NU, 1000000 },
    { AT_MEAN, 0x32000000u },
    { AT_MEAN + 4, 0xce000000u },
    { AT_MEAN + 8, 0x06000000u },
    { AT_MEAN + 12, 0x04000000u },
    { AT_MEAN + 16, 0xfc000000u },
    { AT_MEAN + 32, 0x00800000u },
    { AT_SD, 0x7fffffffu },
    { AT_SD + 16, 0 },
    { AT_NOISE, 0 },
    { AT_NOISE + 8, 0x7fffffffu },
    { AT_CORRELATION, 0x01000000u },
    { AT_CORRELATION + 8, 0xff000000u },
  };
  const tse_params p = prepared(settings(1));
  uint8_t bytes[TSE_LEARNT_BYTES];
  const char *wrong = "";
  reset(&p, &f);
  for (int i = 0; i < ROWS(bad); i++) {
    learnt_with(bytes, bad[i].at, bad[i].value);
    expect_refused(&p, bytes, sizeof bytes, TSE_E_LEARNT, bad[i].what);
    TEST_ASSERT_EQUAL_INT(TSE_E_LEARNT, tse_learnt_check(&p, bytes, sizeof bytes, &wrong));
    TEST_ASSERT_EQUAL_STRING(bad[i].what, wrong);
    TEST_ASSERT_EQUAL_INT(TSE_E_LEARNT, tse_learnt_check(&p, bytes, sizeof bytes, NULL));
  }
  for (int i = 0; i < 55; i++) { /* correlations, 2^-14 */
    const uint32_t values[4] = { 0x4000, 0xc000, 0x4001, 0xbfff };
    for (int k = 0; k < 4; k++) {
      memcpy(bytes, learnt_bytes, sizeof bytes);
      set_bytes(bytes, AT_PAIR + 2 * i, values[k], 2);
      TEST_ASSERT_EQUAL_INT(k < 2 ? TSE_OK : TSE_E_LEARNT, tse_learnt_check(&p, bytes, sizeof bytes, &wrong));
    }
    TEST_ASSERT_EQUAL_STRING("a correlation", wrong);
  }
  for (int i = 0; i < ROWS(good); i++) {
    learnt_with(bytes, good[i].at, good[i].value);
    expect_near(TSE_OK, load(&p, bytes, sizeof bytes, 0), 0, "inside the bounds, byte", good[i].at);
  }
}

static void test_what_is_wrong_with_the_frame_is_said(void)
{
  const tse_params p = prepared(settings(1));
  tse_params strange = p;
  const char *wrong = "";
  uint8_t bytes[TSE_LEARNT_BYTES];
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_learnt_check(&p, learnt_bytes, sizeof learnt_bytes, &wrong));
  TEST_ASSERT_EQUAL_STRING("", wrong);
#define SAID(status, p, at, count, text)                                            \
  TEST_ASSERT_EQUAL_INT(status, tse_learnt_check(p, at, count, &wrong));            \
  TEST_ASSERT_EQUAL_STRING(text, wrong)
  SAID(TSE_E_LEARNT, &p, learnt_bytes, 3, "its mark");
  SAID(TSE_E_LEARNT, &p, learnt_bytes, sizeof learnt_bytes - 1, "its length");
  memcpy(bytes, learnt_bytes, sizeof bytes);
  bytes[40] ^= 1;
  SAID(TSE_E_LEARNT, &p, bytes, sizeof bytes, "its checksum");
  learnt_with(bytes, 4, (TSE_LEARNT_FORMAT + 1) | (uint32_t)TSE_LEARNT_BYTES << 16);
  SAID(TSE_E_VERSION, &p, bytes, sizeof bytes, "its format");
  strange.vehicle ^= 1;
  SAID(TSE_E_VEHICLE, &strange, learnt_bytes, sizeof learnt_bytes, "its vehicle");
  strange.magic = 0;
  TEST_ASSERT_EQUAL_INT(TSE_E_STATE, tse_learnt_check(&strange, learnt_bytes, sizeof learnt_bytes, &wrong));
  TEST_ASSERT_EQUAL_INT(TSE_E_NULL, tse_learnt_check(NULL, learnt_bytes, sizeof learnt_bytes, &wrong));
  TEST_ASSERT_EQUAL_INT(TSE_E_NULL, tse_learnt_check(&p, NULL, sizeof learnt_bytes, &wrong));
}

/* The first row, without measurements: the outputs are the start of the filter. */
static tse_output first_row(const tse_params *p)
{
  tse_input u = blank_row();
  tse_output y;
  u.wheel_speed_front = u.wheel_speed_rear = real(60);
  u.missing = TSE_MISSING_accel_x | TSE_MISSING_accel_y | TSE_MISSING_yaw_rate;
  TEST_ASSERT_EQUAL_INT(TSE_W_PREDICTED, tse_step(p, &f.filter, &u, &y));
  return y;
}

/* After this first row the estimates are finite and within their limits. */
static void expect_a_start_of_numbers(const tse_params *p, int32_t form)
{
  tse_input u = blank_row();
  tse_output y;
  u.wheel_speed_front = u.wheel_speed_rear = real(60);
  for (int i = 0; i < 3; i++) {
    u.dt = real(0.01);
    TEST_ASSERT_TRUE(tse_step(p, &f.filter, &u, &y) >= 0);
    for (int a = 0; a < 3; a++) {
      TEST_ASSERT_TRUE(
          r_is_finite(y.stiffness[a]) && r_is_finite(y.stiffness_sd[a]) && r_is_finite(y.bias[a]));
      if (form) TEST_ASSERT_TRUE(y.stiffness_spread[a] > TSE_R(0) && number(y.stiffness_spread[a]) < 0.45);
      if (form || i) TEST_ASSERT_TRUE(number(y.stiffness[a]) > 0.09 && number(y.stiffness[a]) < 5.01);
    }
    TEST_ASSERT_EQUAL_INT(TSE_OK, tse_filter_check(p, &f.filter, sizeof f));
  }
}

/* Extreme values of every number: the start is finite. */
static void test_extreme_numbers_make_a_start_of_numbers(void)
{
  for (int32_t form = TSE_DEFAULT_FORM; form <= 1; form++)
    for (int i = AT_NU; i < TSE_LEARNT_BYTES - 4; i += 4)
      for (int k = 0; k < 3; k++) {
        const uint32_t extreme[3] = { 0, 0x7fffffffu, 0x80000000u };
        const tse_params p = prepared(form ? settings(form) : open_settings());
        uint8_t bytes[TSE_LEARNT_BYTES];
        learnt_with(bytes, i, extreme[k]);
        if (load(&p, bytes, sizeof bytes, 0) == TSE_OK) expect_a_start_of_numbers(&p, form);
      }
}

/* Correlations that are valid one by one, but not as a covariance: a forged file. */
static void test_correlations_that_contradict_each_other_make_a_start_of_numbers(void)
{
  const tse_params p = prepared(open_settings());
  uint32_t seed = 1;
  for (int n = 0; n < 60; n++) {
    uint8_t bytes[TSE_LEARNT_BYTES];
    memcpy(bytes, learnt_bytes, sizeof bytes);
    for (int i = 0; i < 55; i++)
      set_bytes(bytes, AT_PAIR + 2 * i, n == 0 || next_uniform(&seed) < 0.5 ? 0xc000 : 0x4000, 2);
    set_word(bytes, AT_KNOWN, 7);
    TEST_ASSERT_EQUAL_INT(TSE_OK, load(&p, bytes, sizeof bytes, 0));
    (void)first_row(&p);
    for (int i = 0; i < TSE_KEPT; i++) { /* the variances are those of the file */
      const double var = number(f.filter.start.kept_cov[i][i]);
      expect_near(var, number(ud_variance(&f.filter.k.ud, FAST + i)),
          BY_NUMBER(1e-10, 1e-4, 1e-4) * var + 1e-6, "variance", i);
    }
    TEST_ASSERT_EQUAL_INT(TSE_OK, load(&p, bytes, sizeof bytes, 0));
    expect_a_start_of_numbers(&p, 0);
  }
}

/* --------------------------------------------------------------------------------- vehicle and calls */

static void test_another_vehicle_is_refused_and_other_sensors_or_filters_are_not(void)
{
  tse_params p;
  EACH_SETTING(row)
  {
    tse_config c = settings(1);
    const double was = row->kind == 's' ? of_setting(setting_field(&c, row)) : whole_field(&c, row);
    if (row->kind == 's')
      put_field(&c, row, setting_field(&c, row) < setting(row->hi) ? was + (row->hi - was) / 16 : row->lo);
    else put_field(&c, row, was < row->hi ? was + 1 : was - 1);
    p = prepared(c);
    const int acts = kind_of_effect_setting(row->name) == 2
        && strcmp(row->name, "exact_kinematics_share") != 0;
    if (row->kind == 's' && ((size_t)row->offset < offsetof(tse_config, mass_sd) || acts)) {
      reset(&p, &f);
      expect_refused(&p, learnt_bytes, sizeof learnt_bytes, TSE_E_VEHICLE, row->name);
    } else {
      TEST_ASSERT_EQUAL_INT_MESSAGE(TSE_OK, load(&p, learnt_bytes, sizeof learnt_bytes, 0), row->name);
    }
  }
}

static void test_calls_out_of_order_are_refused_and_change_nothing(void)
{
  const tse_config c = settings(1);
  tse_config d = c;
  d.seed = 77;
  const tse_params p = prepared(c), q = prepared(d);
  uint8_t out[TSE_LEARNT_BYTES], untouched[TSE_LEARNT_BYTES];
  tse_input u = blank_row();
  u.wheel_speed_front = u.wheel_speed_rear = real(60);
  memset(out, 0x5a, sizeof out);
  memcpy(untouched, out, sizeof out);

  memset(&f, 0, sizeof f);
  expect_refused(&p, learnt_bytes, sizeof learnt_bytes, TSE_E_STATE, "load before reset");
  TEST_ASSERT_EQUAL_INT(TSE_E_STATE, tse_learnt_save(&p, &f.filter, out));
  reset(&p, &f);
  TEST_ASSERT_EQUAL_INT_MESSAGE(
      TSE_E_STATE, tse_learnt_save(&p, &f.filter, out), "save before the first row");
  expect_refused(&q, learnt_bytes, sizeof learnt_bytes, TSE_E_STATE, "parameters of another filter");
  expect_refused(NULL, learnt_bytes, sizeof learnt_bytes, TSE_E_NULL, "p");
  expect_refused(&p, NULL, sizeof learnt_bytes, TSE_E_NULL, "in");
  TEST_ASSERT_EQUAL_INT(TSE_E_NULL, tse_learnt_load(&p, NULL, learnt_bytes, sizeof learnt_bytes, 0));

  TEST_ASSERT_TRUE(tse_step(&p, &f.filter, &u, NULL) >= 0);
  expect_refused(&p, learnt_bytes, sizeof learnt_bytes, TSE_E_STATE, "load after the first row");
  TEST_ASSERT_EQUAL_INT(TSE_E_STATE, tse_learnt_save(&q, &f.filter, out));
  TEST_ASSERT_EQUAL_INT(TSE_E_NULL, tse_learnt_save(NULL, &f.filter, out));
  TEST_ASSERT_EQUAL_INT(TSE_E_NULL, tse_learnt_save(&p, NULL, out));
  TEST_ASSERT_EQUAL_INT(TSE_E_NULL, tse_learnt_save(&p, &f.filter, NULL));
  TEST_ASSERT_EQUAL_MEMORY(untouched, out, sizeof out);
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_learnt_save(&p, &f.filter, out));
}

static void test_a_filter_without_a_mark_or_with_rows_that_wait_is_refused(void)
{
  const tse_params p = prepared(settings(1));
  tse_params unmarked = p;
  uint8_t out[TSE_LEARNT_BYTES];
  unmarked.magic = 0;
  know(&p, &f);
  TEST_ASSERT_EQUAL_INT(TSE_E_STATE, tse_learnt_save(&unmarked, &f.filter, out));
  reset(&p, &f);
  f.filter.waiting.count = 1;
  expect_refused(&p, learnt_bytes, sizeof learnt_bytes, TSE_E_STATE, "rows wait");
}

#if defined(TSE_REAL_DOUBLE) || defined(TSE_REAL_FLOAT)
/* The particle filter has no such limits, and the caller may have changed the filter. */
static void test_what_is_saved_lies_inside_what_may_be_loaded(void)
{
  const tse_params p = prepared(settings(1));
  uint8_t out[TSE_LEARNT_BYTES];
  know(&p, &f);
  for (int i = 0; i < 64; i++) {
    f.p.mu[0][i] = real(50), f.p.mu[1][i] = real(-3), f.p.bias[0][i] = real(60 / number(p.sd[0]));
    f.p.bias[1][i] = real(-60 / number(p.sd[1]));
    f.p.lam[0][i] = f.p.lam[1][i] = TSE_R(0); /* no spread: no correlation */
  }
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_learnt_save(&p, &f.filter, out));
  expect_near(log(51), q24(out + AT_MEAN + 12), 1e-5, "logarithm of 51", 0);
  expect_near(log(0.02), q24(out + AT_MEAN + 16), 1e-5, "no less than 0.02", 0);
  TEST_ASSERT_EQUAL_INT32(0, (int32_t)word(out + AT_CORRELATION)); /* of the first two */
  TEST_ASSERT_EQUAL_INT32(50 * 16777216, (int32_t)word(out + AT_MEAN));
  TEST_ASSERT_EQUAL_INT32(-50 * 16777216, (int32_t)word(out + AT_MEAN + 4));
  reset(&p, &f);
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_learnt_load(&p, &f.filter, out, sizeof out, 0));
}

/* A state without variance has no correlations. */
static void test_what_is_known_exactly_is_saved_without_a_correlation(void)
{
  const tse_params p = prepared(settings(0));
  uint8_t out[TSE_LEARNT_BYTES];
  know(&p, &f);
  memset(&f.filter.k, 0, sizeof f.filter.k);
  for (int i = 0; i < TSE_STATES * (TSE_STATES - 1) / 2; i++) f.filter.k.ud.u[i] = r_short(TSE_R(0.25));
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_learnt_save(&p, &f.filter, out));
  for (int at = AT_PAIR; at < AT_NOISE; at++) TEST_ASSERT_EQUAL_INT(0, out[at]);
}

static void test_what_is_no_number_is_not_saved(void)
{
  const tse_real none = TSE_R(0) / number(TSE_R(0));
  uint8_t out[TSE_LEARNT_BYTES], untouched[TSE_LEARNT_BYTES];
  memset(out, 0x5a, sizeof out);
  memcpy(untouched, out, sizeof out);
  for (int what = 0; what < 8; what++) {
    const tse_config c = settings(what < 4 ? 2 : 0);
    const tse_params p = prepared(c);
    know(&p, &f);
    for (int i = 0; i < 64; i++) {
      if (what == 0) f.p.mu[1][i] = none;
      if (what == 1) f.p.bias[1][i] = none;
      if (what == 2) f.p.lam[3][i] = none;
    }
    if (what == 3) f.bias_var[2] = none;
    if (what >= 4) { /* a filter just started, with one number not finite */
      for (int i = 0; i < TSE_SENSORS; i++) f.filter.k.noise[i] = TSE_R(1);
      for (int i = 0; i < TSE_STATES; i++) f.filter.k.ud.d[i] = TSE_R(1);
      uint8_t fine[TSE_LEARNT_BYTES];
      memset(f.filter.k.ud.u, 0, sizeof f.filter.k.ud.u);
      memset(f.filter.k.x, 0, sizeof f.filter.k.x);
      memset(f.filter.k.consider, 0, sizeof f.filter.k.consider);
      TEST_ASSERT_EQUAL_INT(TSE_OK, tse_learnt_save(&p, &f.filter, fine));
      if (what == 4) f.filter.k.noise[3] = none;
      if (what == 5) f.filter.k.x[RAD] = none;
      if (what == 6) f.filter.k.ud.d[LCF] = none;
      if (what == 7) f.filter.k.ud.d[BX] = none; /* considered parameters, too, where a row may be NaN */
#if !defined(TSE_REAL_FIXED)
      if (what == 7) f.filter.k.ud.d[BX] = TSE_R(1), f.filter.k.consider[1][BX] = none;
#endif
    }
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        TSE_E_STATE, tse_learnt_save(&p, &f.filter, out), what < 4 ? "particles" : "the car's filter");
    TEST_ASSERT_EQUAL_MEMORY(untouched, out, sizeof out);
  }
  for (int a = 0; a < 3; a++) { /* of each channel, each stiffness */
    const tse_config c = settings(1);
    const tse_params p = prepared(c);
    know(&p, &f);
    f.bias_var[a] = none;
    TEST_ASSERT_EQUAL_INT(TSE_E_STATE, tse_learnt_save(&p, &f.filter, out));
    know(&p, &f);
    for (int i = 0; i < 64; i++) f.p.lam[a == 0 ? 0 : a == 1 ? 3 : 5][i] = none;
    TEST_ASSERT_EQUAL_INT(TSE_E_STATE, tse_learnt_save(&p, &f.filter, out));
  }
}
#endif

static void test_reset_forgets_what_was_loaded(void)
{
  const tse_params p = prepared(settings(1));
  reset(&p, &other);
  TEST_ASSERT_EQUAL_INT(TSE_OK, load(&p, learnt_bytes, sizeof learnt_bytes, 0));
  TEST_ASSERT_TRUE(memcmp(&f, &other, sizeof f) != 0);
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_reset(&p, &f.filter, sizeof f));
  TEST_ASSERT_EQUAL_MEMORY(&other, &f, sizeof f);
}

/* ------------------------------------------------------------------------------------------- ageing */

static double of_bias(double var, double most, double walk, uint32_t age_s, double *kept)
{
  const double now = var < most ? fmin(var + walk * walk * age_s, most) : most;
  *kept = var < most ? sqrt((most - now) / (most - var)) : 0;
  return now;
}

static double of_mean(const tse_config *c, double sd, double most, uint32_t age_s)
{
  const double floor = of_setting(c->learnt_floor), walk = of_setting(c->learnt_walk_day);
  return fmin(fmax(sd, floor) * fmax(sd, floor) + walk * walk * age_s / DAY, most * most);
}

/* Expected stiffnesses 0 and 2 and biases of the table after `age_s`. */
static void expect_aged(const tse_config *c, const tse_params *p, uint32_t age_s)
{
  /* below this age: unchanged */
  const double prior = of_setting(c->initial_mean_sd), walk_day = of_setting(c->learnt_walk_day),
               minute = 60 * walk_day * walk_day / DAY;
  const double bias_sd[3] = { of_setting(c->accel_x_bias_sd), of_setting(c->accel_y_bias_sd),
    of_setting(c->yaw_rate_bias_sd) };
  const double bias_walk[3] = { of_setting(c->accel_x_bias_walk), of_setting(c->accel_y_bias_walk),
    of_setting(c->yaw_rate_bias_walk) };
  const double initial[3] = { of_setting(c->initial_cx_sd), of_setting(c->initial_cy_front_sd),
    of_setting(c->initial_cy_rear_sd) };
  const tse_start *const s = &f.filter.start;
  double kept;
  TEST_ASSERT_EQUAL_INT(TSE_OK, load(p, learnt_bytes, sizeof learnt_bytes, age_s));
  for (int a = 0; a < 3; a++) {
    if (c->form) { /* particles: relative to nominal, and to the sensor's sd */
      const double level = exp(learnt_mean[3 + a]),
                   var = a == 1 ? prior * prior : of_mean(c, level * learnt_sd[3 + a], prior, age_s),
                   sd = number(p->sd[a]);
      const double now = of_bias(
          learnt_sd[a] * learnt_sd[a], bias_sd[a] * bias_sd[a], bias_walk[a], age_s, &kept);
      expect_near(a == 1 ? 0 : level - 1, number(s->mu[a]), BY_NUMBER(1e-13, 1e-6, 1e-6), "mean", a);
      expect_near(var, number(s->mean_var[a]), minute + BY_NUMBER(1e-13, 1e-6, 3e-6 + 2e-3 * var),
          "variance of the mean", (int)age_s);
      expect_near(now / sd / sd, number(s->bias_var[a]), BY_NUMBER(1e-13, 1e-6, 2e-3 + 2e-2 * now / sd / sd),
          "variance of the bias", a);
      expect_near(kept * learnt_mean[a] / sd, number(s->bias[a]), BY_NUMBER(1e-7, 1e-3, 0.05), "bias",
          a); /* root of a difference */
      continue;
    }
    const int at = 3 + a;
    const double unit = number(state_unit[FAST + at]), bias_unit = number(state_unit[FAST + a]);
    const double var = a == 1 ? initial[a] * initial[a] : of_mean(c, learnt_sd[at], initial[a], age_s);
    const double now = of_bias(
        learnt_sd[a] * learnt_sd[a], bias_sd[a] * bias_sd[a], bias_walk[a], age_s, &kept);
    expect_near(a == 1 ? 0 : learnt_mean[at], number(s->kept[at]), BY_NUMBER(1e-15, 1e-7, 1e-6), "mean", a);
    /* Fixed point: a random walk of 1e-8 per second is 43 steps. Half a step is 1 %,
     * after any time. */
    expect_near(var / unit / unit, number(s->kept_cov[at][at]),
        minute / unit / unit + BY_NUMBER(1e-13, 1e-5, 1e-4 + 2e-3 * var / unit / unit),
        "variance of the mean", (int)age_s);
    expect_near(now / bias_unit / bias_unit, number(s->kept_cov[a][a]),
        BY_NUMBER(1e-12, 1e-5, 2e-3 + 0.03 * now / bias_unit / bias_unit), "variance of the bias", a);
    expect_near(kept * learnt_mean[a], number(s->kept[a]), BY_NUMBER(1e-7, 1e-4, 0.02 * fabs(learnt_mean[a])),
        "bias", a);
  }
}

static void test_variances_grow_with_age_as_the_settings_say(void)
{
  const uint32_t ages[] = { 0, 60, 100, 3600, 10000, DAY, 36 * 3600u, 4 * DAY, 100 * DAY, 3000 * DAY,
    UINT32_MAX };
  for (int32_t form = TSE_DEFAULT_FORM; form <= 1; form++) {
    tse_config c = form ? settings(form) : open_settings();
    c.accel_y_bias_sd = setting(0.01); /* less accurate in the table */
    const tse_params p = prepared(c);
    for (int i = 0; i < ROWS(ages); i++) expect_aged(&c, &p, ages[i]);
    c.learnt_floor = setting(0.02), c.learnt_walk_day = setting(0.05), c.accel_x_bias_walk = setting(0.0001);
    const tse_params q = prepared(c);
    for (int i = 0; i < ROWS(ages); i++) expect_aged(&c, &q, ages[i]);
  }
}

/* -------------------------------------------------------------------------------------------- start */

/* With particles, one gamma serves all three. The remainder is scatter of 500 particles,
 * +- 4.42/sqrt(1000). */
static void test_particles_start_at_the_learnt_means_as_uncertain_as_they_are(void)
{
  tse_config c = settings(1);
  c.particles = TSE_MAX_PARTICLES < 500 ? TSE_MAX_PARTICLES : 500;
  c.accel_x_bias_sd = c.accel_y_bias_sd = setting(0.1), c.yaw_rate_bias_sd = setting(0.01);
  const double chance = 4.42 / sqrt(2.0 * c.particles);
  const tse_params p = prepared(c);
  TEST_ASSERT_EQUAL_INT(TSE_OK, load(&p, learnt_bytes, sizeof learnt_bytes, 0));
  const tse_output y = first_row(&p);
  for (int a = 0; a < 3; a++) {
    const int known = a != 1;
    const double level = exp(learnt_mean[3 + a]),
                 sd = known ? fmax(level * learnt_sd[3 + a], of_setting(c.learnt_floor))
                            : of_setting(c.initial_mean_sd);
    /* uncertainty of the mean has no other place */
    const double spread = known ? sqrt(learnt_spread[a] * learnt_spread[a] + sd * sd)
                                : of_setting(c.initial_spread);
    expect_near(known ? level : 1, number(y.stiffness[a]), chance * sd * 1.5 + BY_NUMBER(1e-13, 1e-6, 1e-4),
        "mean", a);
    expect_near(sd, number(y.stiffness_sd[a]), chance * sd + BY_NUMBER(1e-13, 1e-6, 1e-3), "sd", a);
    expect_near(spread, number(y.stiffness_spread[a]), BY_NUMBER(1e-13, 1e-6, 1e-3), "spread", a);
    expect_near(learnt_mean[a], number(y.bias[a]), BY_NUMBER(1e-13, 1e-6, 2e-3), "bias", a);
    expect_near(learnt_sd[a], number(y.bias_sd[a]), BY_NUMBER(1e-13, 1e-6, 2e-3), "sd of the bias", a);
  }
}

/* The sd of learnt states is that of the table; for steering and radius, at least a tenth
 * of the prior's. */
static double kept_sd(const tse_params *p, int i)
{
  const double prior = number(p->prior_sd[FAST + i]), least = i > 5 ? 0.1 * prior : 0;
  return i == 4 ? prior : fmin(fmax(learnt_sd[i], least), prior); /* cy_front was not learnt */
}

static double kept_correlation(int i, int j)
{
  return i == 4 || j == 4 ? 0 : learnt_common[i] * learnt_common[j];
}

static void expect_kept(const tse_params *p, const tse_kalman *k, const char *what)
{
  for (int i = 0; i < TSE_KEPT; i++) {
    const double unit = number(state_unit[FAST + i]), sd = sqrt(number(ud_variance(&k->ud, FAST + i)));
    expect_near(
        i == 4 ? 0 : learnt_mean[i], number(k->x[FAST + i]), BY_NUMBER(2 * UNIT, 2 * UNIT, 1e-6), what, i);
    expect_near(kept_sd(p, i), sd * unit, BY_NUMBER(2 * UNIT, 1e-6, 1e-5), what, 100 + i);
    for (int j = 0; j < i; j++) {
      const double sd_j = sqrt(number(ud_variance(&k->ud, FAST + j)));
      /* 2^-14 */
      expect_near(kept_correlation(i, j), number(ud_covariance(&k->ud, FAST + i, FAST + j)) / sd / sd_j,
          BY_NUMBER(2e-4, 2e-4, 1e-3), what, 100 * i + j);
    }
  }
}

static void test_the_filter_starts_at_the_learnt_means_with_their_covariance(void)
{
  const tse_config c = open_settings();
  const tse_params p = prepared(c);
  TEST_ASSERT_EQUAL_INT(TSE_OK, load(&p, learnt_bytes, sizeof learnt_bytes, 0));
  const tse_output y = first_row(&p);
  expect_kept(&p, &f.filter.k, "start");
  for (int i = 0; i < TSE_SENSORS; i++)
    expect_near(learnt_noise[i], number(y.noise[i]), BY_NUMBER(1e-13, 1e-6, 1e-6), "noise", i);
  for (int a = 0; a < 3; a++)
    expect_near(a == 1 ? 1 : exp(learnt_mean[3 + a]), number(y.stiffness[a]), BY_NUMBER(1e-13, 1e-6, 1e-6),
        "stiffness", a);
  tse_config d = c;
  d.noise_max = setting(1.5);
  const tse_params q = prepared(d);
  TEST_ASSERT_EQUAL_INT(TSE_OK, load(&q, learnt_bytes, sizeof learnt_bytes, 0));
  expect_near(
      1.5, number(first_row(&q).noise[1]), BY_NUMBER(1e-13, 1e-6, 1e-6), "noise as far as it may be", 1);
  TEST_ASSERT_EQUAL_INT(TSE_OK, load(&p, learnt_by_particles, sizeof learnt_by_particles, 0));
  expect_near(1, number(first_row(&p).noise[1]), 0, "noise as told: particles know none", 1);
}

/* However exactly steering and radius were known, they may have changed since. */
static void test_steering_and_radius_are_loaded_with_at_least_a_tenth_of_the_sd_of_the_settings(void)
{
  const tse_params p = prepared(open_settings());
  uint8_t bytes[TSE_LEARNT_BYTES];
  for (int i = 6; i < TSE_KEPT; i++) {
    learnt_with(bytes, AT_SD + 4 * i, 1);
    TEST_ASSERT_EQUAL_INT(TSE_OK, load(&p, bytes, sizeof bytes, 0));
    const double sd = sqrt(number(f.filter.start.kept_cov[i][i])) * number(state_unit[FAST + i]);
    const double least = 0.1 * number(p.prior_sd[FAST + i]);
    expect_near(least, sd, BY_NUMBER(1e-12, 1e-6, 1e-2) * least, "sd", i);
  }
}

static void test_saved_and_loaded_and_saved_again_is_the_same_knowledge(void)
{
  const tse_params p = prepared(open_settings());
  uint8_t out[2][TSE_LEARNT_BYTES];
  TEST_ASSERT_EQUAL_INT(TSE_OK, load(&p, learnt_bytes, sizeof learnt_bytes, 0));
  for (int n = 0; n < 2; n++) {
    (void)first_row(&p);
    TEST_ASSERT_EQUAL_INT(TSE_OK, tse_learnt_save(&p, &f.filter, out[n]));
    TEST_ASSERT_EQUAL_INT(TSE_OK, load(&p, out[n], TSE_LEARNT_BYTES, 0));
  }
  (void)first_row(&p);
  expect_kept(&p, &f.filter.k, "after two drives of a row");
  TEST_ASSERT_EQUAL_MEMORY(learnt_bytes, out[1], AT_NU);
  for (int i = 0; i < 2 * TSE_KEPT; i++)
    if (i % TSE_KEPT != 4)
      expect_near(q24(learnt_bytes + AT_MEAN + 4 * i), q24(out[1] + AT_MEAN + 4 * i),
          BY_NUMBER(3 * UNIT, 1e-6, 2e-5), "number", i);
  for (int i = 0; i < TSE_SENSORS; i++)
    expect_near(learnt_noise[i], q24(out[1] + AT_NOISE + 4 * i), BY_NUMBER(3 * UNIT, 1e-6, 1e-6), "noise", i);
}

/* While the first rows wait for a late channel. */
static void test_before_the_first_step_what_was_learnt_is_reported(void)
{
  for (int32_t form = TSE_DEFAULT_FORM; form <= 1; form++) {
    tse_config c = open_settings();
    c.form = form, c.steer_angle_latency = setting(0.05);
    const tse_params p = prepared(c);
    tse_input u = blank_row();
    tse_output y;
    u.dt = real(0.01);
    TEST_ASSERT_EQUAL_INT(TSE_OK, load(&p, learnt_bytes, sizeof learnt_bytes, 0));
    TEST_ASSERT_EQUAL_INT(TSE_W_WAITING, tse_step(&p, &f.filter, &u, &y));
    for (int a = 0; a < 3; a++) {
      expect_near(a == 1 ? 1 : exp(learnt_mean[3 + a]), number(y.stiffness[a]), BY_NUMBER(1e-13, 1e-6, 1e-4),
          "mean", a);
      TEST_ASSERT_TRUE(
          number(y.stiffness_sd[a]) > 0.9 * (a == 1 ? 0.3 : learnt_sd[3 + a] * exp(learnt_mean[3 + a])));
      expect_near(learnt_mean[a], number(y.bias[a]), BY_NUMBER(1e-13, 1e-6, 2e-3), "bias", a);
    }
  }
}

/* An sd of 0 in a file means that the bias is not known. */
static void test_a_bias_that_is_not_known_starts_as_the_settings_say(void)
{
  const tse_params p = prepared(settings(1));
  uint8_t bytes[TSE_LEARNT_BYTES];
  for (int a = 0; a < 3; a++) {
    learnt_with(bytes, AT_SD + 4 * a, 0);
    TEST_ASSERT_EQUAL_INT(TSE_OK, load(&p, bytes, sizeof bytes, 0));
    expect_near(0, number(f.filter.start.bias[a]), 0, "bias", a);
    expect_near(number(p.bias_var0[a]), number(f.filter.start.bias_var[a]), 0, "variance", a);
  }
}

/* Also correlations of the spread, which has no more weight than that of the settings. */
static void test_spread_is_as_correlated_as_it_was_and_trusted_as_little_as_at_the_start(void)
{
  const tse_params p = prepared(settings(1));
  const double per_nu = 3.0 / 7.0;
  uint8_t bytes[TSE_LEARNT_BYTES];
  TEST_ASSERT_EQUAL_INT(TSE_OK, load(&p, learnt_bytes, sizeof learnt_bytes, 0));
  expect_near(0, number(f.filter.start.lam[1]), 0, "covariance with the unknown", 0);
  learnt_with(bytes, 12, 7);
  TEST_ASSERT_EQUAL_INT(TSE_OK, load(&p, bytes, sizeof bytes, 0));
  expect_near(number(p.nu0), number(f.filter.start.nu), 0, "nu", 0);
  expect_near(
      -0.5 * 0.0625 * 0.125 * per_nu, number(f.filter.start.lam[2]), BY_NUMBER(1e-15, 1e-9, 5e-6), "02", 0);
  expect_near(
      0.25 * 0.25 * 0.125 * per_nu, number(f.filter.start.lam[4]), BY_NUMBER(1e-15, 1e-9, 5e-6), "12", 0);
}

static void test_nothing_learnt_starts_as_the_settings_say_bit_for_bit(void)
{
  for (int32_t form = TSE_DEFAULT_FORM; form <= 1; form++) {
    const tse_params p = prepared(settings(form));
    uint8_t bytes[TSE_LEARNT_BYTES];
    learnt_with(bytes, 12, 0);
    for (int i = AT_SD; i < TSE_LEARNT_BYTES - 4; i += 4) set_word(bytes, i, 0); /* sd 0: unknown */
    reset(&p, &f);
    const tse_output expected = first_row(&p);
    TEST_ASSERT_EQUAL_INT(TSE_OK, load(&p, bytes, sizeof bytes, UINT32_MAX));
    const tse_output y = first_row(&p);
    TEST_ASSERT_EQUAL_MEMORY(&expected, &y, sizeof y);
  }
}

/* -------------------------------------------------------------------------------------------- drives */

static void depart(drive *d, const tse_config *c, int32_t seed, double steer, double torque)
{
  tse_sim_config s;
  tse_sim_config_default(&s);
  s.true_cx_front = setting(0.75), s.true_cy_front = setting(0.8), s.true_cy_rear = setting(1.2),
  s.seed = seed;
  set_off_with(d, c, &s);
  d->steer = steer, d->torque = torque;
}

static uint32_t known_of(const uint8_t *bytes) { return word(bytes + 12); }

static void forms(int32_t form, tse_config *c)
{
  if (form) tse_config_robust(c);
  else tse_config_exact(c);
  c->particles = 200;
}

/* The mean of a stiffness that is saved is the one that was reported. The longitudinal
 * stiffness, and its sd, are not those of the state of the filter, which includes a
 * model error. */
static void test_the_reported_stiffness_is_saved(void)
{
  tse_config c;
  drive d;
  uint8_t bytes[TSE_LEARNT_BYTES];
  forms(0, &c);
  const tse_params p = prepared(c);
  depart(&d, &c, 1, 0.02, 700);
  reset(&p, &f);
  const tse_output y = run(&p, &f, &d, 1000);
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_learnt_save(&p, &f.filter, bytes));
  for (int a = 0; a < 3; a++) {
    const double mean = log(number(y.stiffness[a])), sd = number(y.stiffness_sd[a]) / number(y.stiffness[a]);
    expect_near(mean, q24(bytes + AT_MEAN + 12 + 4 * a), 2e-3, "mean", a);
    if (a == TSE_CX_FRONT) expect_near(sd, q24(bytes + AT_SD + 12), 0.05 * sd, "sd", a);
  }
  TEST_ASSERT_TRUE(fabs(number(f.filter.k.x[LCX]) - log(number(y.stiffness[0]))) > 0.01);
}

/* A drive without excitation must not save its estimates as learnt. Values loaded before
 * are saved again, not more accurate than before. */
static void test_only_what_was_once_valid_counts_as_learnt_and_what_was_loaded_stays(void)
{
  for (int32_t form = 0; form < 2; form++) {
    tse_config c;
    forms(form, &c);
    const tse_params p = prepared(c);
    uint8_t lively[TSE_LEARNT_BYTES], quiet[TSE_LEARNT_BYTES], later[TSE_LEARNT_BYTES];
    drive d;
    depart(&d, &c, 1, 0.02, 700);
    reset(&p, &f);
    (void)run(&p, &f, &d, 2000);
    TEST_ASSERT_EQUAL_INT(TSE_OK, tse_learnt_save(&p, &f.filter, lively));
    TEST_ASSERT_EQUAL_HEX32(7, known_of(lively));

    depart(&d, &c, 2, 0, 0);
    reset(&p, &f);
    (void)run(&p, &f, &d, 1000);
    TEST_ASSERT_EQUAL_INT(TSE_OK, tse_learnt_save(&p, &f.filter, quiet));
    TEST_ASSERT_EQUAL_HEX32(0, known_of(quiet));

    depart(&d, &c, 2, 0, 0);
    TEST_ASSERT_EQUAL_INT(TSE_OK, load(&p, lively, sizeof lively, 9 * DAY));
    (void)run(&p, &f, &d, 1000);
    TEST_ASSERT_EQUAL_INT(TSE_OK, tse_learnt_save(&p, &f.filter, later));
    TEST_ASSERT_EQUAL_HEX32(7, known_of(later));
    for (int a = 0; a < 3; a++) {
      const double sd = q24(later + AT_SD + 12 + 4 * a), mean = q24(later + AT_MEAN + 12 + 4 * a);
      const double loaded = sqrt(
          0.1 * 0.1 + 9 * 0.02 * 0.02); /* relative for the Kalman filter, to nominal for particles */
      if (form == 0 && a == TSE_CX_FRONT) continue; /* straight drives: tests/unit/filter/test_step.c */
      TEST_ASSERT_TRUE(
          sd > (form ? 0.998 / exp(mean) : 0.8) * loaded); /* Kalman filter: a quiet drive teaches a little */
      expect_near(q24(lively + AT_MEAN + 12 + 4 * a), mean, 0.1, "mean", a);
    }
  }
}

static void test_the_next_drive_starts_where_the_last_one_ended(void)
{
  for (int32_t form = 0; form < 2; form++) {
    const double truth[3] = { 0.75, 0.8, 1.2 };
    tse_config c;
    forms(form, &c);
    const tse_params p = prepared(c);
    uint8_t bytes[TSE_LEARNT_BYTES];
    drive d;
    depart(&d, &c, 1, 0.02, 700);
    reset(&p, &f);
    (void)run(&p, &f, &d, 4000);
    TEST_ASSERT_EQUAL_INT(TSE_OK, tse_learnt_save(&p, &f.filter, bytes));
    depart(&d, &c, 2, 0.02, 700);
    TEST_ASSERT_EQUAL_INT(TSE_OK, load(&p, bytes, sizeof bytes, DAY));
    for (int i = 0; i < 10; i++) {
      const tse_output y = run(&p, &f, &d, 20);
      for (int a = 0; a < 3; a++)
        expect_near(truth[a], number(y.stiffness[a]), fmax(0.12 * truth[a], 3 * number(y.stiffness_sd[a])),
            "stiffness", a);
    }
  }
}

void suiteSetUp(void) { write_both(); }
