/* tests/unit/paper/test_start.c <-> src/paper/start.c
 *
 * Statistics are over STEPS starts of COUNT particles each, seeded. Means must lie within
 * 4.42 sd/sqrt(n) of the settings, standard deviations within 4.42 sd/sqrt(2 n),
 * correlations within 4.42/sqrt(n). A correct start misses each limit with probability
 * 1e-5. */
#include "paper/paper.h"
#include "unit_support.h"

#define COUNT 509 /* padded to 512 */
#define PADDED 512
#define STEPS 60
#define SAMPLES (COUNT * STEPS)

static tse_filter_paper filter, before;
static double sample_of[6][SAMPLES];

static tse_config settings(void)
{
  tse_config c = config_by(tse_config_paper);
  c.particles = COUNT, c.initial_vel_x_sd = setting(0.3), c.initial_vel_y_sd = setting(0.2);
  c.initial_yaw_rate_sd = setting(0.05), c.yaw_rate_sd = setting(0.005), c.initial_cx_front = setting(0.7);
  c.initial_cy_front = setting(0.8), c.initial_cy_rear = setting(1.25), c.initial_mean_sd = setting(0.125);
  c.initial_spread = setting(0.2), c.initial_dof = setting(12), c.stiffness_max = setting(20);
  c.stiffness_min = setting(0.02);
  return c;
}

static sample row(double v_front, double v_rear, double yaw_rate, int has_gyro)
{
  sample y = { 0 };
  y.u.steer = real(0.1), y.u.v_front = real(v_front), y.u.v_rear = real(v_rear), y.dt = real(0.01);
  y.use[0] = y.use[1] = real(1), y.use[2] = real(has_gyro);
  y.y[2] = real(has_gyro ? yaw_rate / 0.005 : 0);
  y.used = 2 + has_gyro, y.has_inputs = 1;
  return y;
}

/* The filter after its start with a row at 20 m/s. */
static void started_with(const tse_params *p)
{
  const sample y = row(20, 20, 0, 1);
  memset(&filter, 0x3c, sizeof filter);
  filter.filter.start.loaded = filter.filter.step = 0;
  paper_start(p, &filter, &y);
}

static void collect(int step)
{
  for (int a = 0; a < 3; a++)
    for (int i = 0; i < COUNT; i++) sample_of[a][step * COUNT + i] = number(filter.p.x[a][i]);
}

/* --------------------------------------------------------------------------------------- paper_start */

static void test_states_start_around_wheel_speed_and_gyro_with_the_sd_of_the_settings(void)
{
  const tse_params p = prepared(settings());
  const sample y = row(20.5, 19.5, 0.25, 1);
  memset(&filter, 0, sizeof filter);
  for (int step = 0; step < STEPS; step++) {
    filter.filter.step = (uint32_t)step;
    paper_start(&p, &filter, &y);
    collect(step);
  }
  expect_moments(sample_of[0], SAMPLES, 20.0, 0.3, "vel_x");
  expect_moments(sample_of[1], SAMPLES, 0.0, 0.2, "vel_y");
  expect_moments(sample_of[2], SAMPLES, 0.25, 0.05, "yaw rate");
  expect_uncorrelated(sample_of[0], sample_of[1], SAMPLES, "vel_x, vel_y");
  expect_uncorrelated(sample_of[0], sample_of[2], SAMPLES, "vel_x, yaw rate");
  expect_uncorrelated(sample_of[1], sample_of[2], SAMPLES, "vel_y, yaw rate");
}

static void expect_start(
    const tse_config *c, const sample *y, double vel_x, double yaw_rate, const char *what)
{
  tse_config certain = *c;
  certain.initial_vel_x_sd = certain.initial_vel_y_sd = certain.initial_yaw_rate_sd = setting(0);
  const tse_params p = prepared(certain);
  memset(&filter, 0, sizeof filter);
  paper_start(&p, &filter, y);
  for (int i = 0; i < PADDED; i++) {
    expect_near(vel_x, number(filter.p.x[0][i]), 0, what, i);
    expect_near(0, number(filter.p.x[1][i]), 0, what, i);
    expect_near(yaw_rate, number(filter.p.x[2][i]), BY_FORMAT(1e-16, 3e-8), what, i);
  }
}

static void test_velocity_starts_at_the_wheels_or_at_the_setting_and_yaw_rate_at_the_gyro_or_zero(void)
{
  tse_config c = settings();
  c.initial_vel_x = setting(17);
  const sample with_gyro = row(20.5, 19.5, 0.25, 1), without = row(20.5, 19.5, 0.25, 0),
               backwards = row(-3, -3, 0, 1);
  expect_start(&c, &with_gyro, 20, 0.25, "from the wheels");
  expect_start(&c, &without, 20, 0, "no gyro");
  expect_start(&c, &backwards, -3, 0, "reverse");
  c.initial_vel_x_from_wheels = 0;
  expect_start(&c, &with_gyro, 17, 0.25, "from the settings");
}

static void test_statistics_start_as_the_settings_say_and_are_common_to_all_particles(void)
{
  const tse_params p = prepared(settings());
  const double start[3] = { -0.3, -0.2, 0.25 }, tiny = BY_FORMAT(1e-15, 1e-7);
  started_with(&p);
  expect_near(12, number(filter.nu), 0, "nu", 0);
  for (int i = 0; i < PADDED; i++) {
    for (int a = 0; a < 3; a++) {
      expect_near(start[a], number(filter.p.mu[a][i]), tiny, "mu", i);
      expect_near(start[a], number(filter.p.w[a][i]), tiny, "w", i);
      expect_near(0, number(filter.p.bias[a][i]), 0, "bias", i);
    }
    expect_near(0, number(filter.p.lam[1][i]), 0, "off the diagonal", i);
    expect_near(0, number(filter.p.lam[2][i]), 0, "off the diagonal", i);
    expect_near(0, number(filter.p.lam[4][i]), 0, "off the diagonal", i);
    for (int k = 0; k < 6; k += k == 0 ? 3 : 2) /* 0, 3, 5: the diagonal; Sigma = Lambda/(nu - 4) */
      expect_near(0.2, sqrt(number(filter.p.lam[k][i]) * 12 / 8), tiny, "spread", k);
  }
  expect_near(0.125 / 0.2, sqrt(number(filter.gamma)), tiny, "sd of the mean over spread", 0);
}

static void test_biases_start_with_the_variance_of_the_settings(void)
{
  tse_config c = settings();
  c.accel_x_sd = setting(0.1), c.accel_y_sd = setting(0.2);
  c.accel_x_bias_sd = c.accel_y_bias_sd = setting(0.05), c.yaw_rate_bias_sd = setting(0.01);
  const tse_params p = prepared(c);
  const double expected[3] = { 0.25, 0.0625, 4 };
  started_with(&p);
  for (int a = 0; a < 3; a++)
    expect_near(expected[a], number(filter.bias_var[a]), BY_FORMAT(1e-14, 1e-6), "variance", a);
}

static void test_all_particles_in_use_start_with_the_same_weight_and_the_padding_with_none(void)
{
  const tse_params p = prepared(settings());
  started_with(&p);
  for (int i = 0; i < PADDED; i++) {
    expect_near(i < COUNT ? 1 : 0, number(filter.weight[i]), 0, "weight", i);
    expect_near(0, number(filter.p.logw[0][i]), 0, "log-weight", i);
  }
  expect_near(log(COUNT) / log(2.0), number(filter.log_total), BY_FORMAT(1e-12, 3e-6), "log of the sum", 0);
}

static void test_start_outside_the_bounds_of_the_stiffness_is_moved_to_the_bound(void)
{
  tse_config c = settings();
  c.initial_cx_front = setting(0.25), c.initial_cy_front = setting(4), c.initial_cy_rear = setting(1);
  c.stiffness_min = setting(0.5), c.stiffness_max = setting(2);
  const tse_params p = prepared(c);
  started_with(&p);
  for (int i = 0; i < PADDED; i++) {
    expect_near(-0.5, number(filter.p.mu[0][i]), 0, "lower bound", i);
    expect_near(1, number(filter.p.mu[1][i]), 0, "upper bound", i);
    expect_near(0, number(filter.p.mu[2][i]), 0, "inside", i);
    expect_near(-0.5, number(filter.p.w[0][i]), 0, "lower bound", i);
    expect_near(1, number(filter.p.w[1][i]), 0, "upper bound", i);
  }
}

/* The start of a particle depends on seed, step and its own index: with fewer particles
 * the first ones are the same. */
static void test_a_start_is_a_function_of_seed_step_and_place_alone(void)
{
  tse_config c = settings();
  const sample y = row(20, 20, 0, 1);
  tse_params p = prepared(c);
  started_with(&p);
  before = filter;
  started_with(&p);
  TEST_ASSERT_EQUAL_MEMORY(&before, &filter, sizeof filter);
  for (int k = 0; k < 2; k++) { /* another step, another seed */
    filter.filter.step = k ? 0 : 1, c.seed = k ? 2 : c.seed;
    p = prepared(c);
    paper_start(&p, &filter, &y);
    int equal = 0;
    for (int i = 0; i < COUNT; i++) equal += !(filter.p.x[0][i] != before.p.x[0][i]);
    TEST_ASSERT_TRUE(equal < 2);
  }
  c = settings(), c.particles = 40;
  p = prepared(c);
  started_with(&p);
  for (int a = 0; a < 3; a++) TEST_ASSERT_EQUAL_MEMORY(before.p.x[a], filter.p.x[a], 40 * sizeof(tse_real));
}

/* ------------------------------------------------------------------------------- paper_place */

/* A filter that has learnt, with different values in every particle. */
static void experienced(void)
{
  uint32_t state = 1;
  memset(&filter, 0, sizeof filter);
  filter.filter.step = 1234, filter.filter.started = 1, filter.gamma = real(0.01), filter.nu = real(99);
  filter.log_total = real(5);
  for (int a = 0; a < 3; a++) filter.bias_var[a] = real(0.1 * (a + 1));
  for (int i = 0; i < TSE_STRIDE; i++) {
    for (int a = 0; a < 3; a++) {
      filter.p.x[a][i] = real(next_between(&state, 5, 6));
      filter.p.mu[a][i] = real(next_between(&state, 5, 6));
      filter.p.w[a][i] = real(next_between(&state, 5, 6));
      filter.p.bias[a][i] = real(next_between(&state, -1, 1));
    }
    for (int k = 0; k < 6; k++) filter.p.lam[k][i] = real(next_between(&state, 1, 2));
    filter.p.logw[0][i] = real(next_between(&state, -5, 0));
    filter.weight[i] = real(next_uniform(&state));
  }
  before = filter;
}

static void test_restart_moves_states_to_wheels_and_gyro_less_its_bias(void)
{
  tse_config c = settings();
  c.initial_vel_x_from_wheels = 0; /* a restart uses the wheels nevertheless */
  const tse_params p = prepared(c);
  const sample y = row(30.5, 29.5, 0.25, 1);
  for (int step = 0; step < STEPS; step++) {
    experienced();
    filter.filter.step = (uint32_t)step;
    paper_place(&p, &filter, &y);
    collect(step);
    for (int i = 0; i < COUNT; i++) sample_of[2][step * COUNT + i] += 0.005 * number(filter.p.bias[2][i]);
  }
  expect_moments(sample_of[0], SAMPLES, 30.0, 0.3, "vel_x");
  expect_moments(sample_of[1], SAMPLES, 0.0, 0.2, "vel_y");
  expect_moments(sample_of[2], SAMPLES, 0.25, 0.05, "yaw rate plus its bias");
}

static void test_restart_subtracts_each_particles_own_gyro_bias(void)
{
  tse_config c = settings();
  c.initial_yaw_rate_sd = setting(0);
  const tse_params p = prepared(c);
  const sample y = row(30, 30, 0.25, 1), none = row(30, 30, 0.25, 0);
  experienced();
  paper_place(&p, &filter, &y);
  for (int i = 0; i < PADDED; i++)
    expect_near(0.25 - 0.005 * number(before.p.bias[2][i]), number(filter.p.x[2][i]), BY_FORMAT(1e-15, 1e-7),
        "yaw rate", i);
  paper_place(&p, &filter, &none);
  for (int i = 0; i < PADDED; i++) expect_near(0, number(filter.p.x[2][i]), 0, "yaw rate without gyro", i);
}

/* An impossible gyro reading, or a large error of the bias: the states start within the
 * limits of a car. */
static void test_states_start_within_what_a_car_can_do(void)
{
  tse_config c = settings();
  c.initial_yaw_rate_sd = setting(2);
  const tse_params p = prepared(c);
  const sample y = row(250, 250, 88, 1);
  for (int how = 0; how < 2; how++) {
    experienced();
    if (how == 0) paper_start(&p, &filter, &y);
    else paper_place(&p, &filter, &y);
    for (int i = 0; i < PADDED; i++) {
      expect_near(200.0, number(filter.p.x[0][i]), 0.0, "vel_x", i);
      expect_near(20.0, number(filter.p.x[2][i]), 0.0, "yaw rate", i);
    }
  }
}

static void test_restart_keeps_everything_but_the_states_bit_for_bit(void)
{
  const tse_params p = prepared(settings());
  const sample y = row(30, 30, 0.25, 1);
  experienced();
  paper_place(&p, &filter, &y);
  for (int i = 0; i < PADDED; i++)
    TEST_ASSERT_TRUE(filter.p.x[0][i] > TSE_R(20)); /* all particles were moved */
  memcpy(filter.p.x, before.p.x, sizeof before.p.x);
  TEST_ASSERT_EQUAL_MEMORY(&before, &filter, sizeof filter);
}
