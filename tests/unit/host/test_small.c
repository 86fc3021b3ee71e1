/* tests/unit/host/test_small.c <-> the effects of TSE_SMALL in src/host, src/filter,
 * src/estimator: lateral motion only. Everything else is refused or reported as
 * unknown. */
#include "filter/predict.h"
#include "filter/start.h"
#include "filter_support.h"
#include "tse/learnt.h"

/* Places in the bytes of a learnt state, of 11 numbers each: src/host/learnt.c. */
enum {
  AT_MEAN = 20,
  AT_SD = 64,
  AT_CRC = TSE_LEARNT_BYTES - 4,
  GAP_ACCEL_X = 0,
  GAP_CX = 3,
  GAP_LATE = 9,
  GAP_RADIUS = 10
};

static tse_filter f;
static truth w;

static tse_config settings(void)
{
  tse_config c = config_by(tse_config_exact);
  c.grip = setting(1), c.grip_sd = setting(0.2), c.body_roll_gain = setting(0.005),
  c.relaxation_length = setting(0.4);
  c.initial_cx_sd = setting(0.05), c.initial_cy_front_sd = c.initial_cy_rear_sd = setting(0.2),
  c.steer_offset_sd = setting(0.004), c.steer_ratio_sd = setting(0.02);
  c.accel_y_bias_sd = setting(0.1), c.yaw_rate_bias_sd = setting(0.005);
  return c;
}

static tse_output drive(int rows)
{
  tse_output y;
  memset(&y, 0, sizeof y);
  for (int n = 0; n < rows; n++) {
    const tse_input u = truth_row(&w, 0.01);
    TEST_ASSERT_TRUE(tse_step(&w.p, &f, &u, &y) >= 0);
    TEST_ASSERT_TRUE(outputs_are_finite(&y));
    TEST_ASSERT_EQUAL_INT(TSE_OK, tse_filter_check(&w.p, &f, sizeof f));
  }
  return y;
}

static void start(uint32_t seed)
{
  truth_start(&w, settings(), 20, 0.5, seed);
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_reset(&w.p, &f, sizeof f));
}

static void test_what_the_build_does_not_have_is_refused_or_not_known(void)
{
  tse_config c = settings();
  tse_params p;
  const char *wrong = "";
  c.form = 1;
  TEST_ASSERT_TRUE(tse_prepare(&c, &p, &wrong) < 0);
  TEST_ASSERT_EQUAL_STRING("form", wrong);
  start(1);
  tse_input u = truth_row(&w, 0.01);
  u.given = TSE_GIVEN_gnss_speed, u.gnss_speed = TSE_R(20);
  TEST_ASSERT_EQUAL_INT(TSE_E_INPUT, tse_step(&w.p, &f, &u, NULL));
  const tse_output y = drive(3000);
  TEST_ASSERT_EQUAL_INT(TSE_NOT_EXCITED, y.reason[TSE_CX_FRONT]);
  expect_near(1, number(y.stiffness[TSE_CX_FRONT]), 1e-6, "longitudinal stiffness: the setting", 0);
  TEST_ASSERT_TRUE(number(y.stiffness_sd[TSE_CX_FRONT]) >= number(w.p.prior_sd[LCX]));
  expect_near(number(w.p.prior_sd[LATE]), number(y.lag_steer_sd), 1e-6,
      "lateness of the steering: as the setting has it", 0);
}

/* A row reads and writes the number of states that the filter has in use. There are none
 * of a measured velocity. */
static void test_states_of_a_velocity_that_a_file_claims_are_refused(void)
{
  start(1);
  (void)drive(10);
  f.k.ud.extras = TSE_EXTRAS;
  TEST_ASSERT_EQUAL_INT(TSE_E_STATE, tse_filter_check(&w.p, &f, sizeof f));
}

/* For any car, both cornering stiffnesses are within three sd, and more accurate than at
 * the start. */
static void test_cornering_stiffness_is_found(void)
{
  for (uint32_t seed = 1; seed <= 6; seed++) {
    start(seed);
    const tse_output y = drive(4000);
    for (int a = TSE_CY_FRONT; a <= TSE_CY_REAR; a++) {
      const double off = number(y.stiffness[a]) - truth_stiffness(&w, a), sd = number(y.stiffness_sd[a]);
      TEST_ASSERT_TRUE(fabs(off) < 3 * sd && sd < 0.1 * number(y.stiffness[a]));
      TEST_ASSERT_EQUAL_INT(TSE_VALID, y.reason[a]);
    }
    TEST_ASSERT_EQUAL_INT(TSE_CHANGE_NONE, y.change_kind);
  }
}

/* Another road is accepted within three seconds, and no stiffness is valid before. */
static void test_another_road_is_found(void)
{
  for (uint32_t seed = 1; seed <= 3; seed++) {
    start(seed);
    (void)drive(4000);
    for (int a = 0; a < 4; a++) w.x[stiffness_at(a)] += real(log(0.4));
    const tse_output y = drive(300);
    TEST_ASSERT_EQUAL_INT(TSE_CHANGE_ROAD, y.change_kind);
    const tse_output later = drive(2000);
    for (int a = TSE_CY_FRONT; a <= TSE_CY_REAR; a++)
      TEST_ASSERT_TRUE(
          fabs(number(later.stiffness[a]) - truth_stiffness(&w, a)) < 3 * number(later.stiffness_sd[a]));
  }
}

/* No event names a faulty channel: after a misfit, the stiffness is not valid. From 4 s
 * on, few rows are valid with an error above 20 %. For some of them an offset of accel_y
 * looks like a bank and another road, one of the steering angle like another road. */
static void test_a_channel_at_fault_leaves_little_valid_that_is_off(void)
{
  for (int what = 0; what < 3; what++) {
    start(4);
    TEST_ASSERT_EQUAL_INT(TSE_VALID, drive(4000).reason[TSE_CY_FRONT]);
    int valid = 0;
    for (int n = 0; n < 2000; n++) {
      tse_output y;
      tse_input u = truth_row(&w, 0.01);
      if (what == 0) u.accel_y += TSE_R(2);
      if (what == 1) u.yaw_rate += real(0.06);
      if (what == 2) u.steer_angle += real(0.03);
      TEST_ASSERT_TRUE(tse_step(&w.p, &f, &u, &y) >= 0);
      for (int a = TSE_CY_FRONT; a <= TSE_CY_REAR; a++)
        valid += n >= 400 && y.reason[a] == TSE_VALID
            && fabs(number(y.stiffness[a]) - truth_stiffness(&w, a)) > 0.2;
    }
    TEST_ASSERT_TRUE_MESSAGE(valid < (what == 0          ? 0.25
                                             : what == 2 ? 0.08
                                                         : 0.02)
                * 2 * 1600,
        what == 0       ? "accel_y"
            : what == 1 ? "yaw_rate"
                        : "steer_angle");
  }
}

/* Slip is no state: it follows from the force in accel_x, and from resistance, on the
 * axles that do not roll freely. */
static void test_slip_is_that_of_the_force(void)
{
  static const struct {
    int rolls, front_free, rear_free;
    double along;
  } cases[] = { { ROLLS_UNKNOWN, 0, 1, 1 }, { ROLLS_UNKNOWN, 0, 0, -1 }, { ROLLS_NONE, 0, 0, 1 },
    { ROLLS_FRONT, 1, 0, 1 }, { ROLLS_REAR, 0, 1, -1 } };
  start(1);
  w.p.car.driven = 1;
  const tse_car *const c = &w.p.car;
  for (int n = 0; n < ROWS(cases); n++) {
    static tse_kalman k;
    decoded z;
    memset(&k, 0, sizeof k);
    memset(&z, 0, sizeof z);
    z.dt = real(0.01), z.has_steer = z.use[ACCEL_X] = 1, z.z[ACCEL_X] = real(cases[n].along),
    z.rolls = cases[n].rolls;
    for (int row = 0; row < 300; row++) {
      k.x[VX] = TSE_R(20);
      (void)predict_row(&w.p, &k, &z);
    }
    const double force = cases[n].along / number(c->scale_x) + number(c->drag) * 20 * 20 + number(c->rolling);
    const double slip = force
        / ((cases[n].front_free ? 0 : number(c->kx_front)) + (cases[n].rear_free ? 0 : number(c->kx_rear)));
    expect_near(cases[n].front_free ? 0 : slip, number(k.x[SF]), 1e-6, "slip in front", n);
    expect_near(cases[n].rear_free ? 0 : slip, number(k.x[SR]), 1e-6, "slip behind", n);
  }
}

static uint32_t crc_of(const uint8_t *bytes, int count)
{
  uint32_t crc = 0xffffffffu;
  for (int i = 0; i < count; i++) {
    crc ^= bytes[i];
    for (int k = 0; k < 8; k++) crc = crc & 1u ? crc >> 1 ^ 0xedb88320u : crc >> 1;
  }
  return ~crc;
}

/* The next drive starts where this one ended. Learnt values of further states, from a
 * filter with all states, are skipped. */
static void test_what_was_learnt_is_kept(void)
{
  static const int gaps[] = { GAP_ACCEL_X, GAP_CX, GAP_LATE, GAP_RADIUS };
  uint8_t bytes[TSE_LEARNT_BYTES];
  start(2);
  (void)drive(4000);
  const tse_kalman was = f.k;
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_learnt_save(&w.p, &f, bytes));
  for (int i = 0; i < (int)(sizeof gaps / sizeof gaps[0]); i++)
    for (int b = 0; b < 4; b++) TEST_ASSERT_EQUAL_INT(0, bytes[AT_SD + 4 * gaps[i] + b]);
  for (int full = 0; full < 2; full++) {
    for (int i = 0; full && i < (int)(sizeof gaps / sizeof gaps[0]); i++)
      bytes[AT_SD + 4 * gaps[i] + 1] = 7, bytes[AT_MEAN + 4 * gaps[i]] = 3;
    const uint32_t crc = crc_of(bytes, AT_CRC);
    for (int b = 0; b < 4; b++) bytes[AT_CRC + b] = (uint8_t)(crc >> 8 * b & 0xffu);
    TEST_ASSERT_EQUAL_INT(TSE_OK, tse_reset(&w.p, &f, sizeof f));
    TEST_ASSERT_EQUAL_INT(TSE_OK, tse_learnt_load(&w.p, &f, bytes, sizeof bytes, 0));
    start_state(&w.p, &f);
    for (int i = FAST; i < FAST + TSE_KEPT; i++)
      expect_near(number(was.x[i]), number(f.k.x[i]), 2e-7, "mean", i);
    for (int i = STATES; i < TSE_VALUES; i++)
      expect_near(number(w.p.prior[i]), number(f.k.x[i]), 0, "no state", i);
    for (int i = LCF; i <= LCR; i++) {
      double var = number(ud_variance(&was.ud, i));
      for (int q = 0; q < TSE_CONSIDERED; q++) var += pow(number_of(was.consider[q][i]), 2);
      const double least = pow(number(r_sqrt(w.p.learnt_floor)) / number(state_unit[i]), 2);
      expect_near(fmax(var, least), number(ud_variance(&f.k.ud, i)), 1e-3 * var, "variance", i);
    }
  }
}
