/* tests/unit/paper/test_move.c <-> src/paper/move.c: (7)
 *
 * particle_step() is tested in test_vehicle.c. Here: which particles move, in how many
 * steps, between which inputs. */
#include "paper/paper.h"
#include "unit_support.h"
#include "single_track.h"

#define COUNT 21
#define PADDED 24

static tse_filter_paper filter, other;

static tse_params params(double sample_time)
{
  tse_config c = config_by(tse_config_exact);
  c.particles = COUNT, c.sample_time = setting(sample_time), c.max_gap = setting(1), c.integration = 1;
  return prepared(c);
}

static void propagate(const tse_params *p, tse_filter_paper *f, inputs u, tse_real dt)
{
  sample y = { 0 };
  y.u = u, y.dt = dt;
  paper_predict_state(p, f, &y);
}

static inputs inputs_of(double steer, double v_front, double v_rear)
{
  inputs u;
  u.steer = real(steer), u.v_front = real(v_front), u.v_rear = real(v_rear);
  return u;
}

static void set_inputs(tse_filter_paper *f, inputs u)
{
  f->filter.steer = u.steer, f->filter.v_front = u.v_front, f->filter.v_rear = u.v_rear;
}

static inputs mix(inputs a, inputs b, double share)
{
  return inputs_of(number(a.steer) + share * (number(b.steer) - number(a.steer)),
      number(a.v_front) + share * (number(b.v_front) - number(a.v_front)),
      number(a.v_rear) + share * (number(b.v_rear) - number(a.v_rear)));
}

/* All particles differ, and no byte of the filter is 0. */
static void scatter(tse_filter_paper *f)
{
  uint32_t state = 1;
  memset(f, 0x3c, sizeof *f);
  for (int i = 0; i < TSE_STRIDE; i++) {
    f->p.x[0][i] = real(next_between(&state, 18.0, 22.0));
    f->p.x[1][i] = real(next_between(&state, -1.0, 1.0));
    f->p.x[2][i] = real(next_between(&state, -0.3, 0.3));
    for (int a = 0; a < 3; a++) f->p.w[a][i] = real(next_between(&state, -0.5, 0.8));
  }
}

/* Move particle i of f in the given number of equal steps. */
static void expected_end(const tse_params *p, const tse_filter_paper *f, int i, inputs u0, inputs u1,
    double dt, int steps, double end[3])
{
  tse_real x = f->p.x[0][i], y = f->p.x[1][i], r = f->p.x[2][i];
  const stiffness k = vehicle_stiffness(p, f->p.w[0][i], f->p.w[1][i], f->p.w[2][i]);
  for (int s = 0; s < steps; s++)
    particle_step(p, &x, &y, &r, k, mix(u0, u1, (double)s / steps), mix(u0, u1, (double)(s + 1) / steps),
        real(dt / steps));
  end[0] = number(x);
  end[1] = number(y);
  end[2] = number(r);
}

static double distance(const tse_filter_paper *f, int i, const double end[3])
{
  double d = 0;
  for (int a = 0; a < 3; a++) d = fmax(d, fabs(number(f->p.x[a][i]) - end[a]));
  return d;
}

/* Steps of at most 1.5 sample times: ceil(dt/(1.5 Ts)). One step more or fewer gives a
 * difference above rounding. */
static void test_long_time_steps_are_divided_into_equal_steps_of_at_most_one_and_a_half_samples(void)
{
  static const struct {
    double sample_time, dt;
    int steps;
  } row[] = {
    { 0.01, 0.002, 1 },
    { 0.01, 0.01, 1 },
    { 0.01, 0.0149, 1 },
    { 0.01, 0.0151, 2 },
    { 0.01, 0.0299, 2 },
    { 0.01, 0.0301, 3 },
    { 0.01, 0.1, 7 },
    { 0.02, 0.0299, 1 },
    { 0.02, 0.0301, 2 },
    { 0.04, 0.0299, 1 },
  };
  const inputs u0 = inputs_of(0.02, 20.1, 20.2), u1 = inputs_of(0.05, 20.9, 20.7);
  for (int j = 0; j < ROWS(row); j++) {
    const tse_params p = params(row[j].sample_time);
    double end[3], fewer[3], more[3];
    scatter(&filter);
    set_inputs(&filter, u0);
    other = filter;
    propagate(&p, &filter, u1, real(row[j].dt));
    for (int i = 0; i < COUNT; i++) {
      const double rounding = BY_NUMBER(1e-14, 1e-6, QUANTUM) * row[j].steps * 20;
      expected_end(&p, &other, i, u0, u1, row[j].dt, row[j].steps, end);
      expect_near(0, distance(&filter, i, end), rounding, "distance", i);
      expected_end(&p, &other, i, u0, u1, row[j].dt, row[j].steps + 1, more);
      if (row[j].steps > 1) expected_end(&p, &other, i, u0, u1, row[j].dt, row[j].steps - 1, fewer);
#if !defined(TSE_REAL_FLOAT) /* in float, rounding hides the difference between 6 and 7 steps */
      TEST_ASSERT_TRUE(distance(&filter, i, more) > 4 * rounding);
      if (row[j].steps > 1) TEST_ASSERT_TRUE(distance(&filter, i, fewer) > 4 * rounding);
#else
      (void)more;
      (void)fewer;
#endif
    }
  }
}

/* A step is at most the time constant of the tyres' damping v/(4 D), D = max(Cx/m, Cy/m,
 * (lf^2 Cyf + lr^2 Cyr)/I) = 168.4 m/s2 here, 29.7 ms at 20 m/s. v is at least
 * hold_speed, and there are at most eight steps per 1.5 sample times. v: mean of both
 * axles and both rows. */
static void test_steps_shorten_with_the_speed_down_to_hold_speed(void)
{
  static const struct {
    double front, rear, sample_time, dt, stiffer;
    int steps;
  } row[] = {
    { 20, 20, 0.1, 0.1, 1, 4 },
    { 40, 40, 0.1, 0.1, 1, 2 },
    { 5, 5, 0.01, 0.0074, 1, 1 },
    { 5, 5, 0.01, 0.0075, 1, 2 },
    { 4, 6, 0.01, 0.0075, 1, 2 },
    { -5, -5, 0.01, 0.0075, 1, 2 },
    { 2.5, 2.5, 0.01, 0.01, 1, 3 },
    { 2, 2, 0.01, 0.01, 1, 4 },
    { 1, 1, 0.01, 0.01, 1, 4 },
    { 0, 0, 0.01, 0.01, 1, 4 },
    { 0, 0, 0.01, 0.003, 1, 2 },
    { 0, 0, 0.01, 0.0029, 1, 1 },
    { 0, 0, 0.01, 0.0075, 10, 4 },
    { 2, 2, 0.01, 0.0074, 10, 4 },
    { 20, 20, 0.01, 0.01, 10, 4 },
  };
  for (int j = 0; j < ROWS(row); j++) {
    tse_config c = config_by(tse_config_exact);
    c.sample_time = setting(row[j].sample_time), c.hold_speed = setting(2);
    c.longitudinal_stiffness_front = setting(of_setting(c.longitudinal_stiffness_front) * row[j].stiffer);
    c.longitudinal_stiffness_rear = setting(of_setting(c.longitudinal_stiffness_rear) * row[j].stiffer);
    const tse_params p = prepared(c);
    const inputs u0 = inputs_of(0.0, row[j].front, row[j].rear - 0.25),
                 u1 = inputs_of(0.0, row[j].front, row[j].rear + 0.25);
    TEST_ASSERT_EQUAL_INT32(row[j].steps, vehicle_steps(&p, real(row[j].dt), u0, u1));
  }
}

/* Sample time 7 ms: 30 ms take three steps of 10 ms, 10 ms take one. The results are
 * equal up to the rounding of the inputs in between. */
static void test_row_of_30_ms_equals_three_rows_of_10_ms_whose_inputs_lie_on_a_line(void)
{
  const tse_params p = params(0.007);
  const inputs u0 = inputs_of(-0.02, 20.0, 20.2), u1 = inputs_of(0.07, 20.9, 19.9);
  scatter(&filter);
  set_inputs(&filter, u0);
  other = filter;
  propagate(&p, &filter, u1, real(0.03));
  for (int k = 1; k <= 3; k++) {
    propagate(&p, &other, mix(u0, u1, k / 3.0), real(0.01));
    set_inputs(&other, mix(u0, u1, k / 3.0));
  }
  for (int i = 0; i < COUNT; i++)
    for (int a = 0; a < 3; a++)
      expect_near(number(other.p.x[a][i]), number(filter.p.x[a][i]), BY_FORMAT(1e-13, 2e-5), "state", a);
}

/* Long rows and short ones give the same motion: the difference decreases with the square
 * of the step. */
static void test_result_depends_on_the_row_length_in_second_order_only(void)
{
  const inputs u0 = inputs_of(0.0, 20.1, 20.2), u1 = inputs_of(0.06, 20.8, 20.9);
  double distances[3] = { 0, 0, 0 };
  for (int j = 0; j < 3; j++) {
    const tse_params coarse = params(0.02 / (1 << j)), fine = params(0.001);
    scatter(&filter);
    set_inputs(&filter, u0);
    other = filter;
    propagate(&coarse, &filter, u1, real(0.24));
    propagate(&fine, &other, u1, real(0.24));
    for (int i = 0; i < COUNT; i++) {
      const double end[3] = { number(other.p.x[0][i]), number(other.p.x[1][i]), number(other.p.x[2][i]) };
      distances[j] += distance(&filter, i, end);
    }
  }
  /* nearly four; float rounds 20 m/s by 2e-6 in each of 240 steps */
  expect_near(4.0, distances[0] / distances[1], BY_FORMAT(0.5, 0.8), "30 ms over 15 ms", 0);
#if !defined(TSE_REAL_FLOAT)
  expect_near(4.0, distances[1] / distances[2], 0.3, "15 ms over 7.5 ms", 0);
#endif
}

/* Up to 1 s in up to 667 steps, compared with a fine integration. */
static void test_bridging_a_second_matches_a_fine_integration(void)
{
  for (int j = 0; j < DRIVES; j++) {
    const double *const t = single_track_drive(j);
    tse_config c = config_of_table((int)t[0]);
    c.particles = COUNT, c.sample_time = setting(0.001), c.integration = 1;
    const tse_params p = prepared(c);
    memset(&filter, 0, sizeof filter);
    set_inputs(&filter, inputs_of(t[5], t[6], t[7]));
    for (int i = 0; i < PADDED; i++)
      for (int a = 0; a < 3; a++) { filter.p.x[a][i] = real(t[2 + a]), filter.p.w[a][i] = real(t[11 + a]); }
    propagate(&p, &filter, inputs_of(t[8], t[9], t[10]), real(t[1]));
    /* (step/time constant)^2/12 of the change, see test_vehicle.c; float: rounding of 667
     * steps */
    const double change = fabs(t[14] - t[2]) + fabs(t[15] - t[3]) + fabs(t[16] - t[4]);
    const double tol = change * (0.0015 / t[17]) * (0.0015 / t[17])
        + BY_FORMAT(1e-9, 4e-6 * (10 + fabs(t[14])));
    expect_near(0, distance(&filter, COUNT - 1, t + 14), tol, "distance", j);
  }
}

/* As in the paper: x + Ts (f + g w) at the last row's state and inputs, from forces in
 * newtons. */
static void test_as_printed_a_step_is_eulers_with_the_inputs_of_the_last_row(void)
{
  tse_config c = config_by(tse_config_paper);
  c.particles = COUNT;
  const tse_params p = prepared(c);
  const double steer = 0.03, front = 20.4, rear = 20.2, h = 0.01;
  scatter(&filter);
  set_inputs(&filter, inputs_of(steer, front, rear));
  other = filter;
  propagate(&p, &filter, inputs_of(-0.2, 10, 30), real(h));
  for (int i = 0; i < COUNT; i++) {
    double x[3], w[3];
    for (int a = 0; a < 3; a++) {
      x[a] = number(other.p.x[a][i]);
      w[a] = number(other.p.w[a][i]);
    }
    const double fx_front = 1.6e5 * (1 + w[0]) * (front - x[0]) / fmax(front, x[0]),
                 fx_rear = 1.6e5 * (1 + w[0]) * (rear - x[0]) / fmax(rear, x[0]);
    const double fy_front = 1.2e5 * (1 + w[1]) * (steer - (x[1] + 1.25 * x[2]) / x[0]),
                 fy_rear = 1.4e5 * (1 + w[2]) * (1.5 * x[2] - x[1]) / x[0];
    const double end[3] = { x[0] + h * ((fx_front + fx_rear - fy_front * steer) / 1900 + x[1] * x[2]),
      x[1] + h * ((fy_front + fy_rear + fx_front * steer) / 1900 - x[0] * x[2]),
      x[2] + h * (1.25 * (fy_front + fx_front * steer) - 1.5 * fy_rear) / 3000 };
    expect_near(0, distance(&filter, i, end), BY_FORMAT(1e-11, 2e-5), "distance", i);
  }
}

/* The steering angle of the last row acts until this one. Wheel speeds are linear. */
static void test_a_held_steering_angle_is_that_of_the_last_row(void)
{
  tse_params p = params(0.01);
  const inputs u0 = inputs_of(0.02, 20.1, 20.2), u1 = inputs_of(0.05, 20.9, 20.7);
  scatter(&filter);
  set_inputs(&filter, u0);
  other = filter;
  propagate(&p, &other, inputs_of(0.02, 20.9, 20.7), real(0.01));
  p.integration = 2;
  propagate(&p, &filter, u1, real(0.01));
  TEST_ASSERT_EQUAL_MEMORY(other.p.x, filter.p.x, sizeof filter.p.x);
}

static void test_every_particle_moves_none_beyond_the_padding_and_nothing_but_the_states_changes(void)
{
  const tse_params p = params(0.01);
  scatter(&filter);
  set_inputs(&filter, inputs_of(0.02, 20.1, 20.2));
  other = filter;
  propagate(&p, &filter, inputs_of(0.05, 20.9, 20.7), real(0.05));
  for (int a = 0; a < 3; a++) {
    for (int i = 0; i < COUNT; i++) TEST_ASSERT_TRUE(filter.p.x[a][i] != other.p.x[a][i]);
    TEST_ASSERT_EQUAL_MEMORY(
        &other.p.x[a][PADDED], &filter.p.x[a][PADDED], (TSE_STRIDE - PADDED) * sizeof(tse_real));
  }
  memcpy(filter.p.x, other.p.x, sizeof other.p.x);
  TEST_ASSERT_EQUAL_MEMORY(&other, &filter, sizeof filter);
}

static void test_order_of_the_particles_does_not_matter_bit_for_bit(void)
{
  const tse_params p = params(0.01);
  scatter(&filter);
  set_inputs(&filter, inputs_of(0.02, 20.1, 20.2));
  other = filter;
  for (int i = 0; i < PADDED; i++)
    for (int a = 0; a < 3; a++) {
      other.p.x[a][i] = filter.p.x[a][(5 * i + 7) % PADDED]; /* 5 and 24 are coprime */
      other.p.w[a][i] = filter.p.w[a][(5 * i + 7) % PADDED];
    }
  propagate(&p, &filter, inputs_of(0.05, 20.9, 20.7), real(0.05));
  propagate(&p, &other, inputs_of(0.05, 20.9, 20.7), real(0.05));
  for (int i = 0; i < PADDED; i++)
    for (int a = 0; a < 3; a++)
      TEST_ASSERT_EQUAL_MEMORY(&filter.p.x[a][(5 * i + 7) % PADDED], &other.p.x[a][i], sizeof(tse_real));
}

/* Jumping wheels, extremely stiff tyres, a particle that is not finite: all end within
 * the limits of a car. */
static void test_no_particle_leaves_the_speeds_of_a_car(void)
{
  static const double start[][3] = { { 1e30, -1e30, 1e30 }, { NAN, NAN, NAN },
    { INFINITY, -INFINITY, INFINITY }, { 150, 190, -19 } };
  const tse_params p = params(0.01);
  scatter(&filter);
  set_inputs(&filter, inputs_of(0.5, 130, -130));
  for (int i = 0; i < PADDED; i++)
    for (int a = 0; a < 3; a++) {
      filter.p.x[a][i] = real(start[i % ROWS(start)][a]), filter.p.w[a][i] = real(19);
    }
  propagate(&p, &filter, inputs_of(-0.5, -130, 130), real(0.1));
  for (int i = 0; i < PADDED; i++) {
    TEST_ASSERT_TRUE(
        fabs(number(filter.p.x[0][i])) <= 200 && fabs(number(filter.p.x[1][i])) <= 200); /* false for NaN */
    TEST_ASSERT_TRUE(fabs(number(filter.p.x[2][i])) <= 20);
  }
}

/* Decay ends in zero, not in denormal numbers; in fixed point, which has none, within the
 * last steps of the format. */
static void test_decaying_states_become_zero(void)
{
  const tse_params p = params(0.01);
  const inputs u = inputs_of(0, 20, 20);
  scatter(&filter);
  set_inputs(&filter, u);
  for (int i = 0; i < PADDED; i++) {
    filter.p.x[0][i] = real(20), filter.p.x[1][i] = real(1e-3 * (i - 10));
    filter.p.x[2][i] = real(1e-4 * (7 - i));
    for (int a = 0; a < 3; a++) filter.p.w[a][i] = TSE_R(0); /* some cars spin when scattered */
  }
  for (int k = 0; k < 1000; k++) propagate(&p, &filter, u, real(0.01));
  for (int i = 0; i < PADDED; i++)
    for (int a = 1; a < 3; a++) expect_near(0, number(filter.p.x[a][i]), 16 * QUANTUM, "state", a);
}
