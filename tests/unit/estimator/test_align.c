/* tests/unit/estimator/test_align.c <-> src/estimator/align.c, and its use in tse_step().
 * Expected rows are interpolated in double from a whole log with absolute times. Expected
 * estimates are those of a log without delays. */
#include "model/car.h"
#include "unit_support.h"
#include "tables/constants.h"
#include "tse/learnt.h"

enum { LOG = 1200 };

static tse_filter_paper late_one, plain_one;
static tse_params p;

static size_t bytes_of_form(int32_t form) { return form ? sizeof late_one : sizeof late_one.filter; }

static tse_config settings(int32_t form)
{
  tse_config c;
  if (form == 2) tse_config_robust(&c); /* the particle filter, too */
  else if (form == 1) tse_config_paper(&c);
  else tse_config_exact(&c);
  c.particles = 60;
  return c;
}

/* Set the latencies of steering angle, wheels and accelerometers [s]. */
static void tell(tse_config *c, const double late[5])
{
  c->steer_angle_latency = setting(late[0]), c->wheel_speed_front_latency = setting(late[1]);
  c->wheel_speed_rear_latency = setting(late[2]), c->accel_x_latency = setting(late[3]);
  c->accel_y_latency = setting(late[4]);
}

static tse_real *channel(tse_input *u, int k)
{
  tse_real *const at[6] = { &u->steer_angle, &u->wheel_speed_front, &u->wheel_speed_rear, &u->accel_x,
    &u->accel_y, &u->yaw_rate };
  return at[k];
}

/* Return the true value of a channel at a time. It is smooth and curved, so that
 * interpolated values differ from neighbouring ones. */
static double truth(int k, double t)
{
  switch (k) {
    case 0: return 0.02 * sin(5 * t) + 0.01 * sin(2.1 * t);
    case 1: return 61 + 2 * sin(0.9 * t);
    case 2: return 60 + 2 * sin(0.9 * t - 0.01);
    case 3: return 0.8 * cos(0.9 * t);
    case 4: return 2 * sin(5 * t - 0.3) + sin(2.1 * t);
    default: return 0.1 * sin(5 * t - 0.2) + 0.05 * sin(2.1 * t);
  }
}

/* Return a row of a noisy drive, with some channels missing now and then. */
static tse_input noisy_row(int k)
{
  static const double sd[6] = { 0, 0.01, 0.01, 0.15, 0.15, 0.0035 };
  uint32_t seed = 77u + 7919u * (uint32_t)k;
  tse_input u = blank_row();
  u.dt = real(0.01);
  for (int c = 0; c < 6; c++) {
    const double noise = 2 * (next_uniform(&seed) + next_uniform(&seed) + next_uniform(&seed) - 1.5);
    *channel(&u, c) = real(truth(c, 0.01 * k) + sd[c] * noise);
    if (next_uniform(&seed) < 0.02) u.missing |= 1u << c;
  }
  return u;
}

static void start(const tse_config *c, tse_filter_paper *f)
{
  p = prepared(*c);
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_reset(&p, &f->filter, bytes_of_form(c->form)));
}

static void start_late(tse_config c, const double late[5])
{
  tell(&c, late);
  start(&c, &late_one);
}

/* ------------------------------------------------------------------------------------------- whole rows */

/* Log each channel `rows[c]` rows late.
 *   Returned:  number of rows compared */
static int compare_shifted(tse_config c, const int rows[6], double sample_time)
{
  double late[5];
  int latest = 0, earliest = 0, compared = 0;
  for (int k = 0; k < 5; k++) {
    late[k] = sample_time * rows[k];
    latest = rows[k] > latest ? rows[k] : latest;
    earliest = rows[k] < earliest ? rows[k] : earliest;
  }
  c.sample_time = setting(sample_time);
  start(&c, &plain_one);
  const tse_params plain = p;
  start_late(c, late);
  for (int k = 0; k < LOG; k++) {
    tse_input u, v = noisy_row(k - latest); /* row of the filter without delays */
    tse_output y, x;
    memset(&u, 0, sizeof u);
    u.dt = v.dt = real(sample_time);
    for (int i = 0; i < 6; i++) {
      tse_input was = noisy_row(k - rows[i]);
      *channel(&u, i) = *channel(&was, i);
      u.missing |= was.missing & 1u << i;
    }
    memset(&y, 0, sizeof y);
    memset(&x, 0, sizeof x);
    const tse_status got = tse_step(&p, &late_one.filter, &u, &y);
    if (k < latest - earliest) {
      TEST_ASSERT_EQUAL_INT(TSE_W_WAITING, got);
      continue;
    }
    TEST_ASSERT_EQUAL_INT(tse_step(&plain, &plain_one.filter, &v, &x), got);
    expect_near(sample_time * latest, number(y.estimate_age), 1e-6, "age in row", k);
    x.estimate_age = y.estimate_age;
    TEST_ASSERT_EQUAL_MEMORY_MESSAGE(&x, &y, sizeof x, "estimates of the same rows");
    compared++;
  }
  return compared;
}

static void test_channels_late_by_whole_rows_give_the_same_bits_later(void)
{
  static const int cases[][6] = { { 3, 0, 0, 0, 0, 0 }, { 0, 6, 6, 0, 0, 0 }, { -2, -2, -2, -2, -2, 0 },
    { 5, -4, 1, 2, -1, 0 }, { 20, -8, -8, 0, 3, 0 }, { 0, 0, 0, -7, 0, 0 }, { 1, 2, 3, 4, 5, 0 } };
  for (int i = 0; i < ROWS(cases); i++)
    for (int32_t form = i < 4 ? MOST_FORM : 0; form >= 0; form--)
      TEST_ASSERT_TRUE(compare_shifted(settings(form), cases[i], 0.01) > LOG - 40);
  TEST_ASSERT_TRUE(compare_shifted(settings(0), cases[3], 0.007) > LOG - 40);
}

/* ------------------------------------------------------------------------------------------- any time */

typedef struct book {
  double t[LOG], value[LOG][6];
  int missing[LOG][6], rows;
} book; /* times of the logged rows */

/* Interpolate a channel of the whole log at a time.
 *   Returned:  1 known; 0 missing; -1 so near to a row that both are correct
 *              lost  reduction of the variance of white noise by interpolation */
static int read_book(const book *b, int k, double t, double *value, double *lost)
{
  const int from = 0;
  int i = b->rows - 1;
  while (i > from && b->t[i - 1] > t) i--;
  if (i == from || fabs(b->t[i] - t) < 3e-5 || fabs(b->t[i - 1] - t) < 3e-5) {
    const int at = i > from && fabs(b->t[i - 1] - t) < fabs(b->t[i] - t) ? i - 1 : i;
    *value = b->value[at][k];
    return -1;
  }
  /* Use the rows on both sides. If one of them lacks the channel, use the nearer one and
   * the next beyond it that has it, up to 0.1 s away. */
  int before = i - 1, after = i;
  const int oldest = b->rows - TSE_LATENCY_ROWS > 0 ? b->rows - TSE_LATENCY_ROWS : 0;
  const int is_after = t - b->t[before] > b->t[after] - t, here = is_after ? after : before;
  if (b->missing[here][k]) return 0;
  while (before >= oldest && b->missing[before][k]) before--;
  while (after < b->rows && b->missing[after][k]) after++;
  *value = b->value[here][k];
  if (before < oldest || after >= b->rows || (i - before > 1 && b->t[after] - b->t[before] > 0.1)
      || (after > i && b->t[after] - b->t[before] > 0.1))
    return 1;
  const double share = (t - b->t[before]) / (b->t[after] - b->t[before]);
  *lost = 1 - share * share - (1 - share) * (1 - share);
  *value = b->value[before][k] + share * (b->value[after][k] - b->value[before][k]);
  return 1;
}

/* Return the delay with which a row is read: the smallest that suffices for all channels
 * and differs from the latency of accel_x by whole rows. */
static double age_of(const double late[5], double sample_time)
{
  double least = 0, age = late[3] - 40 * sample_time;
  for (int k = 0; k < 5; k++) least = fmax(least, late[k]);
  while (age < least - 1e-5) age += sample_time;
  return age;
}

/* Log irregular rows, 0.6 .. 1.6 sample times apart, with these latencies. No rows are
 * close enough to be left out. */
static void compare_interpolated(const double late[5], uint32_t seed)
{
  static book b;
  const double latest = age_of(late, 0.01);
  double tau_before = -1;
  int steps = 0;
  start_late(settings(0), late);
  b.rows = 0;
  double t = 0;
  for (int n = 0; n < 400; n++) {
    tse_input u, row;
    memset(&u, 0, sizeof u);
    u.dt = real(next_between(&seed, 0.006, 0.016));
    t += n > 0 ? number(u.dt) : 0;
    b.t[n] = t, b.rows = n + 1;
    for (int k = 0; k < 6; k++) {
      *channel(&u, k) = real(truth(k, t));
      b.value[n][k] = number(*channel(&u, k));
      b.missing[n][k] = next_uniform(&seed) < 0.05;
      if (b.missing[n][k]) u.missing |= 1u << k;
    }
    const tse_status got = align_row(&p, &late_one.filter, &u, &row);
    TEST_ASSERT_TRUE(got == TSE_OK || (got == TSE_W_WAITING && steps == 0));
    if (got != TSE_OK) continue;
    if (steps++ > 0)
      expect_near(t - latest - tau_before, number(row.dt), BY_FORMAT(1e-12, 1e-6), "dt of step", n);
    tau_before = t - latest;
    for (int k = 0; k < 6; k++) {
      double expected, lost = 0;
      const int known = read_book(&b, k, tau_before + (k < 5 ? late[k] : 0), &expected, &lost);
      const int has = (row.missing >> k & 1u) == 0;
      if (known >= 0) TEST_ASSERT_EQUAL_INT(known, has);
      if (known > 0 && k >= 3)
        expect_near(lost, number(late_one.filter.waiting.lost[k - 3]), BY_FORMAT(1e-9, 5e-4), "lost", k);
      if (known && has)
        expect_near(
            expected, number(*channel(&row, k)), known < 0 ? 6e-4 : BY_FORMAT(1e-11, 2e-4), "channel", k);
    }
  }
  TEST_ASSERT_TRUE(steps > 340);
}

/* With rows at the sample time, accel_x is used as logged, for any latencies. */
static void test_accel_x_is_not_interpolated_in_even_rows(void)
{
  static const double cases[][5] = { { 0.013, 0, 0, 0, 0 }, { 0, 0.0271, 0.02, -0.0037, 0 },
    { 0, 0, 0, 0.0041, 0.0141 }, { 0, 0, 0, -0.005, 0 } };
  for (int i = 0; i < ROWS(cases); i++) {
    const double age = age_of(cases[i], 0.01);
    const int back = (int)floor((age - cases[i][3]) / 0.01 + 0.5);
    start_late(settings(0), cases[i]);
    expect_near(age, number(p.latency), 1e-8, "age", i);
    for (int k = 0; k < 60; k++) {
      tse_input row, u = noisy_row(k), was = noisy_row(k - back);
      if (align_row(&p, &late_one.filter, &u, &row) != TSE_OK) continue;
      TEST_ASSERT_EQUAL_INT(was.missing & TSE_MISSING_accel_x, row.missing & TSE_MISSING_accel_x);
      if (!(row.missing & TSE_MISSING_accel_x))
        TEST_ASSERT_EQUAL_MEMORY(&was.accel_x, &row.accel_x, sizeof was.accel_x);
      expect_near(0, number(late_one.filter.waiting.lost[0]), 0, "lost", k);
    }
  }
}

static void test_random_latencies_are_interpolated(void)
{
  uint32_t seed = 99;
  for (int i = 0; i < 40; i++) {
    double late[5];
    for (int k = 0; k < 5; k++) late[k] = next_between(&seed, -0.07, 0.07);
    compare_interpolated(late, next_word(&seed));
  }
}

static void test_a_value_is_missing_where_the_nearer_row_lacks_it(void)
{
  static const double half[5] = { 0.006, 0, 0.006, 0.006, 0 }, whole[5] = { 0.01, 0, 0.01, 0, 0 };
  for (int whole_rows = 0; whole_rows < 2; whole_rows++) {
    tse_input u, row;
    start_late(settings(0), whole_rows ? whole : half);
    for (int k = 0; k < 20; k++) {
      memset(&u, 0, sizeof u);
      u.dt = real(0.01);
      u.yaw_rate = k == 10 ? real(7) : real(0.1); /* out of range */
      u.missing = k == 15 ? TSE_MISSING_wheel_speed_rear : 0;
      if (align_row(&p, &late_one.filter, &u, &row) != TSE_OK) continue;
      const int gyro = (row.missing & TSE_MISSING_yaw_rate) == 0,
                wheel = (row.missing & TSE_MISSING_wheel_speed_rear) == 0;
      TEST_ASSERT_EQUAL_INT(k != 11, gyro);  /* 6 ms late: the previous row is nearer */
      TEST_ASSERT_EQUAL_INT(k != 15, wheel); /* the latest value is used as logged */
    }
  }
}

/* A slow message: its channel is known at its own rate and time, for any latency. */
static void test_a_channel_in_every_second_or_fifth_row_is_known_as_often(void)
{
  for (int every = 2; every <= 5; every += 3)
    for (int i = 0; i < 8; i++) {
      const double late[5] = { 0.013, -0.0068 + 0.0021 * i, 0.0068 - 0.0017 * i, 0.002, 0 };
      int known = 0, rows = 0;
      start_late(settings(0), late);
      for (int k = 0; k < 400; k++) {
        tse_input row, u = noisy_row(k);
        u.missing = k % every ? TSE_MISSING_wheel_speed_front | TSE_MISSING_wheel_speed_rear : 0;
        for (int c = 0; c < 6; c++) *channel(&u, c) = real(truth(c, 0.01 * k));
        if (align_row(&p, &late_one.filter, &u, &row) != TSE_OK) continue;
        rows++;
        if (row.missing & TSE_MISSING_wheel_speed_front) continue;
        known++; /* at most half a row off where the memory lacks the value before: 2 m/s at 0.9 rad/s */
        expect_near(truth(1, 0.01 * k - age_of(late, 0.01) + late[1]), number(row.wheel_speed_front), 0.01,
            "wheel speed", k);
      }
      TEST_ASSERT_TRUE(known > rows / every - 2 && known < rows / every + 2);
    }
}

static void test_a_value_that_repeats_itself_does_so_when_interpolated(void)
{
  static const double late[5] = { 0.0033, 0.0177, 0.0177, 0.0041, -0.0129 };
  tse_input u, row;
  start_late(settings(0), late);
  memset(&u, 0, sizeof u);
  for (int k = 0; k < 200; k++) {
    u.dt = real(k % 3 ? 0.0091 : 0.0113);
    for (int i = 0; i < 6; i++) *channel(&u, i) = real(truth(i, 0.77));
    if (align_row(&p, &late_one.filter, &u, &row) != TSE_OK) continue;
    for (int i = 0; i < 6; i++) TEST_ASSERT_EQUAL_MEMORY(channel(&u, i), channel(&row, i), sizeof(tse_real));
  }
}

/* ------------------------------------------------------------------------------------------- odd rows */

/* An initial stiffness outside the limits of the filter is reported at the limit. */
static void test_a_start_beyond_a_bound_is_reported_at_it(void)
{
  static const double late[5] = { 0.04, 0.04, 0, 0, -0.02 };
  for (int32_t form = 0; form <= MOST_FORM; form++) {
    tse_config c = settings(form);
    tse_output y;
    c.initial_cy_front = setting(1.5), c.initial_cy_rear = setting(0.5), c.stiffness_min = setting(0.75),
    c.stiffness_max = setting(1.25);
    start_late(c, late);
    for (int k = 0; k < 6; k++) {
      const tse_input u = noisy_row(k);
      TEST_ASSERT_EQUAL_INT(TSE_W_WAITING, tse_step(&p, &late_one.filter, &u, &y));
      expect_near(
          1.25, number(y.stiffness[TSE_CY_FRONT]), 1e-6, "at the upper bound", k); /* exp(log(x)) in float */
      expect_near(0.75, number(y.stiffness[TSE_CY_REAR]), 1e-6, "at the lower bound", k);
    }
  }
}

static void test_until_all_channels_are_known_the_start_is_reported(void)
{
  static const double late[5] = { 0.04, 0.04, 0, 0, -0.02 };
  for (int32_t form = 0; form <= MOST_FORM; form++) {
    tse_config c = settings(form);
    uint8_t bytes[TSE_LEARNT_BYTES];
    tse_output y;
    c.initial_cy_front = setting(0.8);
    start_late(c, late);
    for (int k = 0; k < 8; k++) {
      const tse_input u = noisy_row(k);
      const tse_status got = tse_step(&p, &late_one.filter, &u, &y);
      TEST_ASSERT_EQUAL_INT(y.status, got);
      expect_near(0.04, number(y.estimate_age), 1e-6, "age", k);
      TEST_ASSERT_EQUAL_INT(k < 6, got == TSE_W_WAITING);
      for (int a = 0; a < 3; a++)
        TEST_ASSERT_TRUE(y.reason[a] == TSE_STARTING || y.reason[a] == TSE_INPUT_INVALID);
      if (k >= 6) continue;
      expect_near(0.8, number(y.stiffness[TSE_CY_FRONT]), 1e-6, "stiffness", k);
      const double floor = number(MODEL_FLOOR), own = number(p.prior_sd[LCF]),
                   sd = form ? number(c.initial_mean_sd) : 0.8 * sqrt(own * own + floor * floor);
      expect_near(sd, number(y.stiffness_sd[TSE_CY_FRONT]), 1e-6, "its sd", k);
      if (form)
        expect_near(
            number(c.initial_spread), number(y.stiffness_spread[TSE_CY_FRONT]), 1e-6, "its spread", k);
      expect_near(number(c.accel_y_bias_sd), number(y.bias_sd[1]), 1e-6, "sd of a bias", k);
      expect_near(form == 0, number(y.regime[TSE_REGIME_STEADY]), 0, "steady", k);
      TEST_ASSERT_EQUAL_INT(TSE_E_STATE, tse_learnt_save(&p, &late_one.filter, bytes));
      TEST_ASSERT_EQUAL_INT(TSE_E_STATE,
          tse_learnt_load(&p, &late_one.filter, bytes, sizeof bytes, 0)); /* after the first row */
    }
  }
}

static void test_nothing_is_read_across_a_gap(void)
{
  static const double late[5] = { 0.035, 0, 0, 0, -0.01 };
  enum { GAP = 600 };
  for (int32_t form = 0; form <= MOST_FORM; form += 2) {
    tse_output y;
    double waited = 0.04; /* [s] whole rows */
    tse_real last = TSE_R(0);
    start_late(settings(form), late);
    for (int k = 0; k < GAP + 20; k++) {
      tse_input u = noisy_row(k);
      u.missing = 0;
      u.dt = real(k == GAP ? 0.5 : 0.01);
      const tse_status got = tse_step(&p, &late_one.filter, &u, &y);
      if (k < GAP) {
        last = y.stiffness[1];
        continue;
      }
      waited += number(u.dt);
      if (k < GAP + 5) { /* from -0.01 to 0.04: 5 rows */
        TEST_ASSERT_EQUAL_INT(TSE_W_WAITING, got);
        TEST_ASSERT_EQUAL_INT(TSE_INPUT_INVALID, y.reason[1]);
        expect_near(waited, number(y.estimate_age), 1e-5, "age", k - GAP);
        expect_near(number(last), number(y.stiffness[1]), 0.02, "stiffness", k - GAP);
      } else {
        /* fixed point: an event of a noisy channel reaches the limit of its row, which
         * has the larger status */
        const int stops = BY_NUMBER(0, 0, 1) && got == TSE_W_RANGE;
        if (!stops) TEST_ASSERT_EQUAL_INT(k == GAP + 5, got == TSE_W_GAP);
        TEST_ASSERT_TRUE(got != TSE_W_WAITING);
        expect_near(0.04, number(y.estimate_age), 1e-6, "age", k - GAP);
      }
    }
  }
}

static void test_a_step_takes_the_whole_time_since_the_last_one(void)
{
  static const double late[5] = { 0.03, 0, 0, 0, 0 };
  tse_input u = noisy_row(0), row;
  double given = 0, taken = 0;
  uint32_t seed = 3;
  int steps = 0;
  start_late(settings(0), late);
  for (int k = 0; k < 3000; k++) {
    u.dt = real(next_uniform(&seed) < 0.02 ? next_between(&seed, 0.1, 2) : next_between(&seed, 0.001, 0.03));
    const tse_status got = align_row(&p, &late_one.filter, &u, &row);
    given += k > 0 ? number(u.dt) : 0;
    if (got == TSE_OK) taken += number(row.dt);
    if (got == TSE_OK) expect_near(given, taken, 1e-9 + BY_FORMAT(0, 2e-3), "time", k);
    steps += got == TSE_OK;
  }
  TEST_ASSERT_TRUE(steps > 1500);
  for (int k = 0; k < 8; k++) { /* longer than the max dt: limited here, refused elsewhere */
    u.dt = real(3600);
    TEST_ASSERT_EQUAL_INT(TSE_W_WAITING, align_row(&p, &late_one.filter, &u, &row));
  }
  for (int k = 0; k < 5; k++) {
    u.dt = real(0.01);
    if (align_row(&p, &late_one.filter, &u, &row) == TSE_OK) break;
  }
  expect_near(3600, number(row.dt), 0, "longest dt", 0);
}

static void test_refused_rows_change_nothing(void)
{
  static const double late[5] = { 0.033, 0.02, 0.02, -0.01, 0 };
  const tse_real none = real((double)NAN), bad_dt[4] = { TSE_R(0), TSE_R(-0.01), TSE_R(3601), none };
  start_late(settings(0), late);
  for (int k = 0; k < 60; k++) {
    const tse_input fine = noisy_row(k);
    tse_output y, before;
    memset(&y, 17, sizeof y);
    memcpy(&before, &y, sizeof y);
    memcpy(&plain_one, &late_one, sizeof plain_one);
    for (int i = 0; i < 4 && k > 0; i++) {
      tse_input u = fine;
      u.dt = bad_dt[i];
      TEST_ASSERT_EQUAL_INT(TSE_E_TIME, tse_step(&p, &late_one.filter, &u, &y));
    }
    tse_input u = fine;
    u.missing = 0, u.steer_angle = TSE_R(2);
    TEST_ASSERT_EQUAL_INT(TSE_E_INPUT, tse_step(&p, &late_one.filter, &u, &y));
    TEST_ASSERT_EQUAL_MEMORY(&plain_one, &late_one, sizeof late_one);
    TEST_ASSERT_EQUAL_MEMORY(&before, &y, sizeof y);
    TEST_ASSERT_TRUE(tse_step(&p, &late_one.filter, &fine, &y) >= 0);
    TEST_ASSERT_TRUE(tse_step(&p, &late_one.filter, &fine, NULL) >= 0);
  }
}

#if defined(TSE_REAL_DOUBLE) || defined(TSE_REAL_FLOAT)
/* A missing channel may be marked by its bit or by NaN: both give the same rows. */
static void test_a_channel_that_is_no_number_is_missing(void)
{
  static const double late[5] = { 0.033, 0.02, 0.02, -0.01, 0 };
  start_late(settings(0), late);
  memcpy(&plain_one, &late_one, sizeof plain_one);
  for (int k = 0; k < 100; k++) {
    const tse_input by_bit = noisy_row(k);
    tse_input by_value = by_bit;
    tse_output y, z;
    for (int i = 0; i < 6; i++)
      if (by_bit.missing >> i & 1u) *channel(&by_value, i) = TSE_R(0) / number(TSE_R(0));
    by_value.missing = 0;
    memset(&y, 0, sizeof y);
    memset(&z, 0, sizeof z);
    TEST_ASSERT_EQUAL_INT(
        tse_step(&p, &late_one.filter, &by_bit, &y), tse_step(&p, &plain_one.filter, &by_value, &z));
    TEST_ASSERT_EQUAL_MEMORY(&y, &z, sizeof y);
  }
}
#endif

/* Latencies below the rounding of times: no row waits, not even the first. */
static void test_channels_late_by_a_microsecond_wait_for_nothing(void)
{
  static const double late[5] = { 1e-6, 1e-6, 1e-6, 1e-6, 1e-6 };
  tse_config c = settings(0), d = c;
  tell(&c, late);
  const tse_params plain = prepared(d);
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_reset(&plain, &plain_one.filter, bytes_of_form(0)));
  start(&c, &late_one);
  for (int k = 0; k < 50; k++) {
    const tse_input u = noisy_row(k);
    tse_output y, z;
    memset(&y, 0, sizeof y);
    memset(&z, 0, sizeof z);
    TEST_ASSERT_EQUAL_INT(
        tse_step(&plain, &plain_one.filter, &u, &z), tse_step(&p, &late_one.filter, &u, &y));
    expect_near(1e-6, number(y.estimate_age), 1e-9, "age", k);
    y.estimate_age = z.estimate_age;
    TEST_ASSERT_EQUAL_MEMORY(&z, &y, sizeof y);
  }
}

/* A channel later than accel_x by less than a thousandth of a row counts as equally late:
 * the row is read when the later one is known. */
static void test_a_row_is_read_when_its_latest_channel_is_known(void)
{
  static const double late[5] = { 5e-6, 0, 0, 0, 0 };
  tse_config c = settings(0);
  tell(&c, late);
  const tse_params q = prepared(c);
  expect_near(5e-6, number(q.latency), 1e-10, "latency", 0);
}

/* A loaded state may hold as many rows as there are places, more than its own rows would
 * fill. */
static void test_a_full_memory_goes_on(void)
{
  static const double late[5] = { 0.033, 0.02, 0.02, -0.01, 0 };
  start_late(settings(0), late);
  for (int k = 0; k < 40; k++) {
    const tse_input u = noisy_row(k);
    TEST_ASSERT_TRUE(tse_step(&p, &late_one.filter, &u, NULL) >= 0);
  }
  late_one.filter.waiting.count = TSE_LATENCY_ROWS;
  for (int i = 0; i < TSE_LATENCY_ROWS; i++) late_one.filter.waiting.before[i] = TSE_R(0);
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_filter_check(&p, &late_one.filter, sizeof late_one.filter));
  for (int k = 40; k < 80; k++) {
    const tse_input u = noisy_row(k);
    TEST_ASSERT_TRUE(tse_step(&p, &late_one.filter, &u, NULL) >= 0);
    TEST_ASSERT_TRUE(late_one.filter.waiting.count <= TSE_LATENCY_ROWS);
  }
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_filter_check(&p, &late_one.filter, sizeof late_one.filter));
}

/* ------------------------------------------------------------------------------------------- memory */

static void test_latencies_that_do_not_fit_the_memory_are_refused_by_name(void)
{
  const double most = 0.01 * (TSE_LATENCY_ROWS - 4);
  tse_config c = settings(0);
  const char *wrong = NULL;
  c.steer_angle_latency = setting(most - 0.1), c.accel_x_latency = setting(-0.1);
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_prepare(&c, &p, &wrong));
  c.accel_x_latency = setting(-0.101);
  TEST_ASSERT_EQUAL_INT(TSE_E_CONFIG, tse_prepare(&c, &p, &wrong));
  TEST_ASSERT_EQUAL_STRING("steer_angle_latency", wrong);
  TEST_ASSERT_EQUAL_INT(TSE_E_CONFIG, tse_config_check(&c, NULL));
  c.sample_time = setting(0.001), c.steer_angle_latency = setting(0);
  TEST_ASSERT_EQUAL_INT(TSE_E_CONFIG, tse_config_check(&c, &wrong));
  TEST_ASSERT_EQUAL_STRING("accel_x_latency", wrong);
  c.sample_time = setting(0.01);
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_prepare(&c, &p, NULL));
  c.wheel_speed_rear_latency = setting(0.21);
  TEST_ASSERT_EQUAL_INT(TSE_E_CONFIG, tse_config_check(&c, &wrong));
  TEST_ASSERT_EQUAL_STRING("wheel_speed_rear_latency", wrong);
}

/* Rows at a seventh of the sample time, with the longest possible latencies: some rows
 * are left out, and the times are correct. */
static void test_rows_that_come_faster_than_set_are_left_out(void)
{
  static const double late[5] = { 0.2, 0, 0, -0.08, 0 };
  tse_input u, row;
  double t = 0, tau = -1, taken = 0;
  int steps = 0, longest = 0, since = 0;
  start_late(settings(0), late);
  for (int k = 0; k < 4000; k++) {
    memset(&u, 0, sizeof u);
    u.dt = real(0.01 / 7);
    t += k > 0 ? number(u.dt) : 0;
    for (int i = 0; i < 6; i++) *channel(&u, i) = real(truth(i, t));
    const tse_status got = align_row(&p, &late_one.filter, &u, &row);
    TEST_ASSERT_TRUE(late_one.filter.waiting.count <= TSE_LATENCY_ROWS);
    since++;
    if (got != TSE_OK) continue;
    longest = steps > 0 && since > longest ? since : longest;
    since = 0;
    if (steps++ > 0) taken += number(row.dt);
    else tau = t - 0.2;
    expect_near(t - 0.2, tau + taken, BY_FORMAT(1e-9, 1e-3), "time", k);
    for (int i = 0; i < 6;
        i++) /* interpolation error between rows 0.01 s apart: h^2/8 of the second derivative */
      expect_near(truth(i, t - 0.2 + (i < 5 ? late[i] : 0)), number(*channel(&row, i)), BY_FORMAT(1e-3, 3e-3),
          "channel", i);
  }
  TEST_ASSERT_TRUE(steps > 450);
  TEST_ASSERT_EQUAL_INT(7, longest);
}

static void test_any_latencies_and_rows_leave_numbers_and_a_sound_filter(void)
{
  uint32_t seed = 11;
  for (int run = 0; run < 60; run++) {
    const int32_t form = run % 4 ? 0 : MOST_FORM;
    tse_config c = settings(form);
    c.sample_time = setting(next_between(&seed, 0.002, 0.05));
    c.max_gap = setting(next_between(&seed, 0.05, 0.5));
    const double reach = fmin(0.2, number(c.sample_time) * (TSE_LATENCY_ROWS - 5) / 2.01);
    double late[5];
    for (int k = 0; k < 5; k++) late[k] = next_uniform(&seed) < 0.3 ? 0 : next_between(&seed, -reach, reach);
    start_late(c, late);
    for (int k = 0; k < 300; k++) {
      const double kind = next_uniform(&seed);
      tse_input u = noisy_row(k);
      tse_output y;
      const double dt = next_between(&seed, 0.5, 1.5) * number(c.sample_time);
      u.dt = real(kind < 0.02 ? next_between(&seed, 0.1, 3600)
              : kind < 0.3    ? next_between(&seed, 1e-6, 0.02)
                              : dt);
      if (kind > 0.95) *channel(&u, (int)(6 * next_uniform(&seed))) = real(next_between(&seed, -60, 60));
      const tse_status got = tse_step(&p, &late_one.filter, &u, &y);
      TEST_ASSERT_EQUAL_INT(TSE_OK, tse_filter_check(&p, &late_one.filter, bytes_of_form(form)));
      if (got < 0) continue;
      TEST_ASSERT_TRUE(outputs_are_finite(&y));
      TEST_ASSERT_TRUE(y.estimate_age >= TSE_R(0) && y.estimate_age <= TSE_R(3601));
    }
  }
}

/* A filter with effects: rows are aligned before effects apply. */
static void test_effects_act_on_the_row_that_was_put_together(void)
{
  static const int rows[6] = { 3, -1, -1, 0, 1, 0 };
  tse_config c = settings(0);
  c.steering_delay_time = setting(0.02), c.imu_delay_time = setting(0.01);
  TEST_ASSERT_TRUE(compare_shifted(c, rows, 0.01) > LOG - 40);
}

/* A row without a step reports the estimates of the previous step, bit for bit; before
 * the first step, those of the start. The particle filter reports its estimate before
 * learning from the row. It has no estimates of noise and changes: both are 1. */
static void test_a_row_that_waits_reports_what_the_step_before_it_did(void)
{
  static const double late[5] = { 0.2, 0, 0, -0.08, 0 };
  static const char *const of_the_row[] = { "status", "estimate_age" };
  for (int32_t form = 0; form <= MOST_FORM; form++) {
    tse_output y, step = blank_output();
    int waited = 0, steps = 0;
    start_late(settings(form), late);
    for (int k = 0; k < 900; k++) {
      tse_input u = noisy_row(k / 3);
      u.dt = real(0.01 / 3), u.missing = 0;
      const tse_status got = tse_step(&p, &late_one.filter, &u, &y);
      TEST_ASSERT_TRUE(got >= 0);
      for (int a = 0; a < 3 && (form > 0 || steps == 0); a++) {
        expect_near(1, number(y.noise[a]), 0, "noise", a);
        expect_near(1, number(y.change_ratio[a]), 0, "change", a);
        if (got == TSE_W_WAITING && steps > 0)
          TEST_ASSERT_EQUAL_MEMORY(&step.stiffness[a], &y.stiffness[a], sizeof y.stiffness[a]);
      }
      if (got == TSE_W_WAITING && steps > 0) TEST_ASSERT_EQUAL_MEMORY(step.noise, y.noise, sizeof y.noise);
      waited += got == TSE_W_WAITING;
      if (got != TSE_W_WAITING) step = y, steps++;
      if (got != TSE_W_WAITING || steps == 0 || form > 0) continue;
      EACH_FIELD(f, TSE_STRUCT_OUTPUT)
      {
        int own = 0;
        for (int i = 0; i < ROWS(of_the_row); i++) own = own || strcmp(f->name, of_the_row[i]) == 0;
        if (!own && !same_at(&step, &y, f)) TEST_FAIL_MESSAGE(f->name);
      }
    }
    TEST_ASSERT_TRUE(steps > 200 && waited > 400);
  }
}
