/* tests/unit/model/test_vehicle.c <-> src/model/vehicle.h, src/paper/particle.h
 *
 * Reference: single_track.h, the model written with forces in newtons. */
#include "paper/particle.h"

#include "unit_support.h"
#include "single_track.h"

static tse_params car(int k) { return prepared(config_of_table(k)); }

static inputs inputs_from(const double *u)
{
  inputs in;
  in.steer = real(u[0]), in.v_front = real(u[1]), in.v_rear = real(u[2]);
  return in;
}

static inputs mix_inputs(inputs a, inputs b, double share)
{
  inputs u;
  u.steer = real(number(a.steer) + share * (number(b.steer) - number(a.steer)));
  u.v_front = real(number(a.v_front) + share * (number(b.v_front) - number(a.v_front)));
  u.v_rear = real(number(a.v_rear) + share * (number(b.v_rear) - number(a.v_rear)));
  return u;
}

typedef struct motion {
  tse_real x, y, r;
} motion;

static motion motion_from(const double *x)
{
  motion m;
  m.x = real(x[0]), m.y = real(x[1]), m.r = real(x[2]);
  return m;
}

static void step(const tse_params *p, motion *m, stiffness k, inputs u0, inputs u1, double h)
{
  particle_step(p, &m->x, &m->y, &m->r, k, u0, u1, real(h));
}

static motion drive(
    const tse_params *p, motion m, stiffness k, inputs u0, inputs u1, double duration, int steps)
{
  for (int i = 0; i < steps; i++)
    step(p, &m, k, mix_inputs(u0, u1, (double)i / steps), mix_inputs(u0, u1, (double)(i + 1) / steps),
        duration / steps);
  return m;
}

static stiffness stiffness_at(const tse_params *p, double w0, double w1, double w2)
{
  return vehicle_stiffness(p, real(w0), real(w1), real(w2));
}

static void expect_bits(tse_real expected, tse_real actual, const char *what)
{
  TEST_ASSERT_EQUAL_MEMORY_MESSAGE(&expected, &actual, sizeof expected, what);
}

/* Ordinary states: forward, backward, walking pace; not at a corner of max(). */
typedef struct situation {
  motion m;
  inputs u;
} situation;

static situation any_situation(uint32_t *state, double lowest, double fastest)
{
  situation s;
  const double v = next_between(state, lowest, fastest);
  s.m.x = real(v);
  s.m.y = real(next_between(state, -1.0, 1.0));
  s.m.r = real(next_between(state, -0.5, 0.5));
  s.u.steer = real(next_between(state, -0.4, 0.4));
  s.u.v_front = real(v + next_between(state, -0.5, 0.5));
  s.u.v_rear = real(v + next_between(state, -0.5, 0.5));
  return s;
}

static slips slips_of(const tse_params *p, situation s) { return vehicle_slips(p, s.m.x, s.m.y, s.m.r, s.u); }

/* ------------------------------------------------------------------------- (1)-(4): slips and forces */

/* About ten roundings of numbers up to 72 m/s, divided by at least 1 m/s. Accelerations:
 * times k of up to 400 m/s2. */
#define SLIP_TOL BY_FORMAT(1e-13, 6e-5)
#define ACCEL_TOL(expected) (BY_FORMAT(1e-13, 6e-6) * (400.0 + fabs(expected)))

/* Situation i of car i % 3, and the results of the reference. */
typedef struct referred {
  double x[3], u[3], w[3], slip[4], accel[3];
} referred;

static referred referred_situation(int i, uint32_t *state)
{
  static const double speeds[] = { 0, 0.3, 1, 3, 20, 70 };
  const double speed = speeds[i / 3 % 6] * (i % 5 == 4 ? -1 : 1), wheel = 0.3 + 0.1 * fabs(speed);
  referred t = { { speed, next_between(state, -1, 1), next_between(state, -0.8, 0.8) },
    { next_between(state, -0.3, 0.3), speed, speed }, { 0, 0, 0 }, { 0 }, { 0 } };
  for (int a = 1; a < 3; a++) t.u[a] += next_between(state, -wheel, wheel);
  for (int a = 0; a < 3 && i % 4; a++) t.w[a] = next_between(state, -0.8, 1.5);
  single_track(car_table[i % 3], t.x, t.u, t.w, t.slip, t.accel);
  return t;
}

static slips slips_at(const tse_params *p, const referred *t)
{
  const motion m = motion_from(t->x);
  return vehicle_slips(p, m.x, m.y, m.r, inputs_from(t->u));
}

static void test_slips_match_the_reference_from_standstill_to_70_ms_and_in_reverse(void)
{
  uint32_t state = 2;
  for (int i = 0; i < 600; i++) {
    const referred t = referred_situation(i, &state);
    const tse_params p = car(i % 3);
    const slips s = slips_at(&p, &t);
    expect_near(t.slip[0], number(s.s_front), SLIP_TOL, "front slip", i);
    expect_near(t.slip[1], number(s.s_rear), SLIP_TOL, "rear slip", i);
    expect_near(t.slip[2], number(s.a_front), SLIP_TOL, "front slip angle", i);
    expect_near(t.slip[3], number(s.a_rear), SLIP_TOL, "rear slip angle", i);
  }
}

static void test_accelerations_match_forces_in_newtons_over_mass_and_inertia(void)
{
  uint32_t state = 2;
  for (int i = 0; i < 600; i++) {
    const referred t = referred_situation(i, &state);
    const tse_params p = car(i % 3);
    const accels a = vehicle_accels(
        &p, stiffness_at(&p, t.w[0], t.w[1], t.w[2]), slips_at(&p, &t), real(t.u[0]));
    expect_near(t.accel[0], number(a.x), ACCEL_TOL(t.accel[0]), "accel_x", i);
    expect_near(t.accel[1], number(a.y), ACCEL_TOL(t.accel[1]), "accel_y", i);
    expect_near(t.accel[2], number(a.yaw), ACCEL_TOL(t.accel[2]), "yaw acceleration", i);
  }
}

static void test_driving_wheels_push_and_braked_wheels_drag(void)
{
  const tse_params p = car(0);
  const stiffness k = stiffness_at(&p, 0, 0, 0);
  situation s = { { real(20), real(0), real(0) }, { real(0), real(20.2), real(20.2) } };
  TEST_ASSERT_TRUE(vehicle_accels(&p, k, slips_of(&p, s), s.u.steer).x > TSE_R(0));
  s.u.v_front = s.u.v_rear = real(19.8);
  TEST_ASSERT_TRUE(vehicle_accels(&p, k, slips_of(&p, s), s.u.steer).x < TSE_R(0));
}

static void test_rear_longitudinal_stiffness_follows_the_front_by_its_share(void)
{
  for (int i = 0; i < 3; i++) {
    const double *const c = car_table[i];
    const tse_params p = car(i);
    const stiffness k = stiffness_at(&p, 0.4, 0.0, 0.0);
    expect_near(1.4 * c[4] / c[0], number(k.x_front), BY_FORMAT(1e-12, 1e-4), "front", i);
    expect_near((1.0 + 0.4 * c[8]) * c[5] / c[0], number(k.x_rear), BY_FORMAT(1e-12, 1e-4), "rear", i);
  }
}

/* In reverse, at walking pace and forward: the power of each tyre force over the sliding
 * velocity of the contact is <= 0. */
static void test_tyre_forces_oppose_the_velocity_of_their_contact_in_both_directions(void)
{
  uint32_t state = 3;
  const tse_params p = car(0);
  for (int i = 0; i < 3000; i++) {
    const situation s = any_situation(&state, -20.0, 20.0);
    const slips l = slips_of(&p, s);
    TEST_ASSERT_TRUE(l.s_front * (s.u.v_front - s.m.x) >= TSE_R(0));
    TEST_ASSERT_TRUE(l.s_rear * (s.u.v_rear - s.m.x) >= TSE_R(0));
    const double front = number(s.m.y) + number(p.car.lf) * number(s.m.r) - number(s.u.steer) * number(s.m.x);
    const double rear = number(s.m.y) - number(p.car.lr) * number(s.m.r);
    if (fabs(front) > 1e-3) TEST_ASSERT_TRUE(number(l.a_front) * front < 0);
    if (fabs(rear) > 1e-3) TEST_ASSERT_TRUE(number(l.a_rear) * rear < 0);
  }
}

static void test_driving_backwards_mirrors_the_forces_exactly(void)
{
  uint32_t state = 4;
  const tse_params p = car(2);
  const stiffness k = stiffness_at(&p, 0.2, -0.3, 0.1);
  for (int i = 0; i < 1000; i++) {
    situation s = any_situation(&state, -30.0, 30.0);
    const accels a = vehicle_accels(&p, k, slips_of(&p, s), s.u.steer);
    s.m.x = -s.m.x, s.u.v_front = -s.u.v_front, s.u.v_rear = -s.u.v_rear, s.u.steer = -s.u.steer;
    const accels b = vehicle_accels(&p, k, slips_of(&p, s), s.u.steer);
    expect_bits(a.x, -b.x, "accel_x");
    expect_bits(a.y, b.y, "accel_y");
    expect_bits(a.yaw, b.yaw, "yaw acceleration");
  }
}

/* |d slip/d vx| <= 2/low speed everywhere: there is no division by a small number. */
static void test_slips_stay_bounded_and_continuous_through_standstill(void)
{
  const tse_params p = car(0);
  situation s = { { real(0), real(0.1), real(0.1) }, { real(0.1), real(0.02), real(-0.02) } };
  slips before = slips_of(&p, s);
  for (int i = -2000; i <= 2000; i++) {
    s.m.x = real(i * 0.001);
    const slips l = slips_of(&p, s);
    if (i > -2000) {
      TEST_ASSERT_TRUE(fabs(number(l.s_front) - number(before.s_front)) < 0.00201);
      TEST_ASSERT_TRUE(fabs(number(l.a_front) - number(before.a_front)) < 0.00201);
      TEST_ASSERT_TRUE(fabs(number(l.a_rear) - number(before.a_rear)) < 0.00201);
    }
    before = l;
  }
}

/* ------------------------------------------------------------------- (6), (7), (9): the estimation form */

/* The accelerations are linear in w, so a wide difference is exact except for rounding.
 * In units of the sensor's sd. */
static void test_observation_rows_are_the_derivatives_of_the_accelerations(void)
{
  uint32_t state = 5;
  for (int i = 0; i < 600; i++) {
    const tse_config c = config_of_table(i % 3);
    const tse_params p = prepared(c);
    const situation s = any_situation(&state, -5.0, 70.0);
    const slips l = slips_of(&p, s);
    const observation o = particle_observation(
        particle_observation_gains(&p, TSE_R(1), TSE_R(1)), l, s.u.steer);
    const accels at0 = vehicle_accels(&p, stiffness_at(&p, 0, 0, 0), l, s.u.steer);
    const double sd[2] = { number(c.accel_x_sd), number(c.accel_y_sd) };
    const double d[2][3] = { { number(o.d11), number(o.d12), 0.0 },
      { number(o.d21), number(o.d22), number(o.d23) } };
    const double scale = 400.0 / 0.15;
    for (int b = 0; b < 3; b++) {
      const accels up = vehicle_accels(&p, stiffness_at(&p, b == 0, b == 1, b == 2), l, s.u.steer);
      const accels down = vehicle_accels(&p, stiffness_at(&p, -(b == 0), -(b == 1), -(b == 2)), l, s.u.steer);
      expect_near(
          (number(up.x) - number(down.x)) / 2 / sd[0], d[0][b], BY_FORMAT(1e-14, 1e-6) * scale, "d1", b);
      expect_near(
          (number(up.y) - number(down.y)) / 2 / sd[1], d[1][b], BY_FORMAT(1e-14, 1e-6) * scale, "d2", b);
    }
    expect_near(number(at0.x) / sd[0], number(o.h1), BY_FORMAT(1e-14, 1e-6) * scale, "h1", i);
    expect_near(number(at0.y) / sd[1], number(o.h2), BY_FORMAT(1e-14, 1e-6) * scale, "h2", i);
  }
}

static void test_row_of_a_missing_measurement_vanishes_and_the_other_stays(void)
{
  uint32_t state = 6;
  const tse_params p = car(1);
  for (int i = 0; i < 50; i++) {
    const situation s = any_situation(&state, 0.0, 40.0);
    const slips l = slips_of(&p, s);
    const observation both = particle_observation(
        particle_observation_gains(&p, TSE_R(1), TSE_R(1)), l, s.u.steer);
    const observation only_y = particle_observation(
        particle_observation_gains(&p, TSE_R(0), TSE_R(1)), l, s.u.steer);
    const observation only_x = particle_observation(
        particle_observation_gains(&p, TSE_R(1), TSE_R(0)), l, s.u.steer);
    TEST_ASSERT_TRUE(both.d11 != TSE_R(0) && both.d23 != TSE_R(0));
    TEST_ASSERT_TRUE(!(only_y.d11 != TSE_R(0)) && !(only_y.d12 != TSE_R(0)) && !(only_y.h1 != TSE_R(0)));
    TEST_ASSERT_TRUE(!(only_x.d21 != TSE_R(0)) && !(only_x.d22 != TSE_R(0)) && !(only_x.d23 != TSE_R(0))
        && !(only_x.h2 != TSE_R(0)));
    expect_bits(both.d21, only_y.d21, "d21");
    expect_bits(both.d22, only_y.d22, "d22");
    expect_bits(both.d23, only_y.d23, "d23");
    expect_bits(both.h2, only_y.h2, "h2");
    expect_bits(both.d11, only_x.d11, "d11");
    expect_bits(both.d12, only_x.d12, "d12");
    expect_bits(both.h1, only_x.h1, "h1");
  }
}

/* g = Ts [daX/dw; daY/dw; dr'/dw], as in algorithm.md section 1, compared with the
 * derivative of the step in w. Truncation: h times the tyres' rates (up to 30/s at 10
 * m/s). Rounding: 20 m/s 2^-24 over h in float. */
static void test_state_prediction_depends_on_w_as_g_says(void)
{
  uint32_t state = 7;
  const double h = BY_FORMAT(1e-6, 1e-3);
  for (int i = 0; i < 200; i++) {
    const int which = i % 3;
    const double *const c = car_table[which];
    const tse_params p = car(which);
    const situation s = any_situation(&state, 10.0, 20.0);
    const slips l = slips_of(&p, s);
    const double delta = number(s.u.steer);
    const double xf = c[4] * number(l.s_front), xr = c[8] * c[5] * number(l.s_rear);
    const double yf = c[6] * number(l.a_front), yr = c[7] * number(l.a_rear);
    const double g[3][3] = { { (xf + xr) / c[0], -yf * delta / c[0], 0 },
      { xf * delta / c[0], yf / c[0], yr / c[0] },
      { c[2] * xf * delta / c[1], c[2] * yf / c[1], -c[3] * yr / c[1] } };
    for (int b = 0; b < 3; b++) {
      motion up = s.m, down = s.m;
      step(&p, &up, stiffness_at(&p, 0.5 * (b == 0), 0.5 * (b == 1), 0.5 * (b == 2)), s.u, s.u, h);
      step(&p, &down, stiffness_at(&p, -0.5 * (b == 0), -0.5 * (b == 1), -0.5 * (b == 2)), s.u, s.u, h);
      const double tol = BY_FORMAT(2e-3, 0.2);
      expect_near(g[0][b], (number(up.x) - number(down.x)) / h, tol * (1 + fabs(g[0][b])), "g1", b);
      expect_near(g[1][b], (number(up.y) - number(down.y)) / h, tol * (1 + fabs(g[1][b])), "g2", b);
      expect_near(g[2][b], (number(up.r) - number(down.r)) / h, tol * (1 + fabs(g[2][b])), "g3", b);
    }
  }
}

/* ------------------------------------------------------------------------------ (7): the integrator */

static double distance(motion m, const double *end)
{
  return fabs(number(m.x) - end[0]) + fabs(number(m.y) - end[1]) + fabs(number(m.r) - end[2]);
}

/* Step: 1/16 of the time constant of the fastest tyre mode, so the leading error term
 * dominates: at most 1e-3 of the change. */
static void test_trajectories_match_a_fine_integration_of_the_same_equations(void)
{
  for (int i = 0; i < DRIVES; i++) {
    const double *const t = single_track_drive(i);
    const tse_params p = car((int)t[0]);
    const int steps = (int)ceil(16 * t[1] / t[17]);
    const motion m = drive(&p, motion_from(t + 2), stiffness_at(&p, t[11], t[12], t[13]), inputs_from(t + 5),
        inputs_from(t + 8), t[1], steps);
    /* Rounding in float: one unit in the last place of the speed per step, at random. A
     * systematic one would give 3e-2. */
    const double rounding = BY_FORMAT(0, 3e-7 * (1 + fabs(t[14])) * sqrt(steps));
    expect_near(0, distance(m, t + 14), 1e-3 * distance(motion_from(t + 2), t + 14) + rounding,
        "distance to the end", i);
  }
}

static void test_halving_the_step_divides_the_error_by_four(void)
{
#if defined(TSE_REAL_FLOAT) || defined(TSE_REAL_FIXED)
  TEST_IGNORE_MESSAGE("rounding hides the order of convergence; shown in double");
#endif
  for (int i = 0; i < DRIVES; i++) {
    const double *const t = single_track_drive(i);
    const tse_params p = car((int)t[0]);
    const stiffness k = stiffness_at(&p, t[11], t[12], t[13]);
    const int steps = (int)ceil(16 * t[1] / t[17]);
    double error[4];
    for (int j = 0; j < 4; j++)
      error[j] = distance(
          drive(&p, motion_from(t + 2), k, inputs_from(t + 5), inputs_from(t + 8), t[1], steps << j), t + 14);
    /* The leading error term is h^2, the next one h^3: the ratio tends to 4. */
    expect_near(4.0, error[1] / error[2], 0.5, "error at h/2 over error at h/4", i);
    expect_near(4.0, error[2] / error[3], 0.25, "error at h/4 over error at h/8", i);
  }
}

static const double lateral_speeds[] = { 0.5, 1.5, 4, 10, 20, 40, 70 };

/* Rates of vel_y and yaw rate alone, linear at constant speed. */
static void lateral_matrix(const double *c, double v, double A[2][2])
{
  const double over = fmax(v, 1), mass = c[0] * over, inertia = c[1] * over,
               moment = c[3] * c[7] - c[2] * c[6];
  A[0][0] = -(c[6] + c[7]) / mass, A[0][1] = moment / mass - v;
  A[1][0] = moment / inertia, A[1][1] = -(c[2] * c[2] * c[6] + c[3] * c[3] * c[7]) / inertia;
}

/* Amplitudes of 1e-6 make nonlinear terms 1e-6 times as large. In fixed point 1e-3, of
 * which a step of the format is 2e-7. A time step of 0.25 ms, with a smallest part of
 * 1/60000, rounds by as much. Tolerance: (h rate)^2 with rates to 250/s. */
static void test_lateral_motion_at_constant_speed_matches_the_matrix_exponential(void)
{
  const double small = BY_NUMBER(1e-6, 1e-6, 1e-3), h = 1e-4;
  uint32_t state = 3;
  for (int i = 0; i < 3 * ROWS(lateral_speeds); i++) {
    const double *const c = car_table[i % 3], v = lateral_speeds[i / 3], over = fmax(v, 1),
                        duration = v < 3 ? 0.2 : 0.6;
    const double from = next_between(&state, -1, 1), to = next_between(&state, -1, 1);
    const double x[2] = { next_between(&state, -1, 1), next_between(&state, -1, 1) };
    const tse_params p = car(i % 3);
    const double start[3] = { v, small * x[0], small * x[1] }, u0[3] = { small * from, v, v },
                 u1[3] = { small * to, v, v };
    double A[2][2], end[2] = { x[0], x[1] };
    lateral_matrix(c, v, A);
    for (int k = 0; k < (int)(duration / h + 0.5);
        k++) { /* exp(A h) as a series, with the steering angle of the middle */
      const double delta = (from + (to - from) * (k + 0.5) * h / duration) * v / over;
      const double b[2] = { A[0][0] * end[0] + A[0][1] * end[1] + c[6] / c[0] * delta,
        A[1][0] * end[0] + A[1][1] * end[1] + c[2] * c[6] / c[1] * delta };
      double term[2] = { h * b[0], h * b[1] };
      for (int n = 2; n < 8; n++) {
        const double next[2] = { h / n * (A[0][0] * term[0] + A[0][1] * term[1]),
          h / n * (A[1][0] * term[0] + A[1][1] * term[1]) };
        for (int a = 0; a < 2; a++) end[a] += term[a], term[a] = next[a];
      }
    }
    const motion m = drive(&p, motion_from(start), stiffness_at(&p, 0, 0, 0), inputs_from(u0),
        inputs_from(u1), duration, (int)(duration / 0.00025));
    const double size = fabs(end[0]) + fabs(end[1]) + 0.1;
    expect_near(end[0], number(m.y) / small, BY_FORMAT(1e-4, 5e-4) * size, "vel_y", i);
    expect_near(end[1], number(m.r) / small, BY_FORMAT(1e-4, 5e-4) * size, "yaw rate", i);
  }
}

/* r/delta = v/(L + K v^2), K = m (lr/Cf - lf/Cr)/L; vy = r (lr - m lf v^2/(L Cr)). With
 * steps of 10 ms: the stationary point of the method is that of the model. */
static void test_steady_cornering_has_the_yaw_gain_and_sideslip_of_the_handbook(void)
{
  const double speeds[] = { 0.5, 1.0, 3.0, 10.0, 20.0, 40.0, 70.0 };
  for (int k = 0; k < 3; k++) {
    const double *const c = car_table[k];
    const tse_params p = car(k);
    for (int i = 0; i < ROWS(speeds); i++) {
      const double v = speeds[i], angle = BY_NUMBER(1e-6, 1e-6, 1e-4), wheelbase = c[2] + c[3];
      /* Below 1 m/s slip is relative to 1 m/s: the tyres' part is proportional to v * 1
       * instead of v^2. */
      const double vv = v < 1.0 ? v : v * v;
      const double understeer = c[0] / wheelbase * (c[3] / c[6] - c[2] / c[7]);
      const double gain = v / (wheelbase + understeer * vv),
                   vel_y = gain * (c[3] - c[0] * c[2] * vv / (wheelbase * c[7]));
      const double u[3] = { angle, v, v }, start[3] = { v, 0, 0 };
      const motion m = drive(
          &p, motion_from(start), stiffness_at(&p, 0, 0, 0), inputs_from(u), inputs_from(u), 60.0, 6000);
      expect_near(gain, number(m.r) / angle, BY_FORMAT(1e-8, 1e-4) * fabs(gain), "yaw gain", i);
      expect_near(
          vel_y, number(m.y) / angle, BY_FORMAT(1e-8, 1e-4) * (fabs(vel_y) + fabs(gain)), "vel_y gain", i);
    }
  }
}

/* The linearised step is the stability function of the method, so the Jacobian contains
 * all stiff terms: lateral motion at amplitudes of 1e-6, and longitudinal motion, which
 * is linear below 1 m/s, and above it while the wheels are faster, also in the inner
 * stage. */
static void test_one_step_is_the_stability_function_of_an_l_stable_method_of_order_two(void)
{
  const double small = BY_NUMBER(1e-6, 1e-6, 1e-3), gamma = 1 - sqrt(0.5);
  uint32_t state = 4;
  for (int i = 0; i < 6 * ROWS(lateral_speeds); i++) {
    const double *const c = car_table[i % 3], v = lateral_speeds[i / 6], h = i % 6 < 3 ? 0.01 : 0.05;
    const double x[2] = { next_between(&state, -1, 1), next_between(&state, -1, 1) };
    const tse_params p = car(i % 3);
    const double start[3] = { v, small * x[0], small * x[1] }, u[3] = { 0, v, v };
    double A[2][2], end[2]; /* (1 - gamma z)^-2 (1 + (1 - 2 gamma) z) x, z = h A */
    lateral_matrix(c, v, A);
    for (int a = 0; a < 2; a++) end[a] = x[a] + (1 - 2 * gamma) * h * (A[a][0] * x[0] + A[a][1] * x[1]);
    for (int n = 0; n < 2; n++) {
      const double a = 1 - gamma * h * A[0][0], b = -gamma * h * A[0][1], d = -gamma * h * A[1][0],
                   e = 1 - gamma * h * A[1][1];
      const double y = (e * end[0] - b * end[1]) / (a * e - b * d);
      end[1] = (a * end[1] - d * end[0]) / (a * e - b * d);
      end[0] = y;
    }
    motion m = motion_from(start);
    step(&p, &m, stiffness_at(&p, 0, 0, 0), inputs_from(u), inputs_from(u), h);
    expect_near(end[0], number(m.y) / small, BY_FORMAT(2e-5, 2e-5), "vel_y", i);
    expect_near(end[1], number(m.r) / small, BY_FORMAT(2e-5, 2e-5), "yaw rate", i);

    motion slow = { real(v - 0.25), real(0), real(0) };
    const double z = -h * (c[4] + c[5]) / c[0] / fmax(v, 1);
    if (v >= 1 && z < -1) continue;
    step(&p, &slow, stiffness_at(&p, 0, 0, 0), inputs_from(u), inputs_from(u), h);
    expect_near(v - 0.25 * (1 + (1 - 2 * gamma) * z) / (1 - gamma * z) / (1 - gamma * z), number(slow.x),
        BY_FORMAT(1e-13, 1e-5), "vel_x", i);
  }
}

/* Squared distance from rolling with the wheels, with yaw weighted by I/m.
 *   Returned:  its value at the end
 *              largest  maximum on the way */
static double settle(const tse_params *p, stiffness k, double v, double h, double duration, double *largest)
{
  const double u[3] = { 0, v, v };
  motion m = { real(v + 0.1), real(0.3), real(-0.2) };
  double energy = 0;
  *largest = 0;
  for (int i = 0; i < (int)(duration / h + 0.5); i++) {
    step(p, &m, k, inputs_from(u), inputs_from(u), h);
    const double dv = number(m.x) - v;
    energy = dv * dv + number(m.y) * number(m.y) + 3000.0 / 1900.0 * number(m.r) * number(m.r);
    if (!(energy <= *largest)) *largest = energy;
  }
  return energy;
}

/* From standstill to 70 m/s, steps of 10 to 50 ms, tyres from 0.1 to 20 times nominal
 * (rates to 6000/s). A car at speed swings before the tyres stabilise it. A step of 0.5
 * ms gives the amplitude, and a coarse step may exceed it by at most 5 %. */
static void test_disturbances_never_grow_and_die_out_at_any_speed_and_step(void)
{
  const double speeds[] = { 0.0, 0.05, 0.3, 0.8, 1.0, 1.4, 2.0, 5.0, 20.0, 70.0 };
  const double steps[] = { 0.01, 0.02, 0.05 };
  const double levels[] = { -0.9, 0.0, 4.0, 19.0 };
  const tse_params p = car(0);
  const double start = 0.1 * 0.1 + 0.3 * 0.3 + 3000.0 / 1900.0 * 0.2 * 0.2;
  for (int a = 0; a < ROWS(speeds); a++)
    for (int c = 0; c < ROWS(levels); c++) {
      const stiffness k = stiffness_at(&p, levels[c], levels[c], levels[c]);
      double allowed, largest;
      (void)settle(&p, k, speeds[a], 0.0005, 3.0, &allowed);
      if (allowed < start) allowed = start;
      for (int b = 0; b < ROWS(steps); b++) {
        const double left = settle(&p, k, speeds[a], steps[b], 60.0, &largest);
        TEST_ASSERT_TRUE_MESSAGE(largest < 1.05 * allowed, "grows");
        TEST_ASSERT_TRUE_MESSAGE(left < 1e-4 * start, "does not die out");
      }
    }
}

static void test_car_at_rest_stays_at_rest_exactly(void)
{
  const tse_params p = car(0);
  const tse_real zero = 0;
  motion m = { 0, 0, 0 };
  const double u0[3] = { -0.5, 0, 0 }, u1[3] = { 0.5, 0, 0 };
  for (int i = 0; i < 1000; i++)
    step(&p, &m, stiffness_at(&p, 0.3, -0.2, 0.1), inputs_from(u0), inputs_from(u1), 0.05);
  TEST_ASSERT_TRUE(!(m.x != zero) && !(m.y != zero) && !(m.r != zero));
}

static void test_free_rolling_straight_ahead_is_kept_exactly(void)
{
  const tse_params p = car(0);
  const double start[3] = { 31.25, 0, 0 }, u[3] = { 0, 31.25, 31.25 };
  const motion m = drive(
      &p, motion_from(start), stiffness_at(&p, 0.3, -0.2, 0.1), inputs_from(u), inputs_from(u), 10.0, 1000);
  expect_bits(real(31.25), m.x, "vel_x");
  TEST_ASSERT_TRUE(!(m.y != TSE_R(0)) && !(m.r != TSE_R(0)));
}

static void test_turning_right_is_turning_left_mirrored_bit_for_bit(void)
{
  const tse_params p = car(2);
  const stiffness k = stiffness_at(&p, 0.3, -0.2, 0.1);
  for (int i = 0; i < DRIVES; i++) {
    const double *const t = single_track_drive(i);
    const double start[3] = { t[2], -t[3], -t[4] }, u0[3] = { -t[5], t[6], t[7] },
                 u1[3] = { -t[8], t[9], t[10] };
    const motion left = drive(&p, motion_from(t + 2), k, inputs_from(t + 5), inputs_from(t + 8), t[1], 100);
    const motion right = drive(&p, motion_from(start), k, inputs_from(u0), inputs_from(u1), t[1], 100);
    expect_mirrored(left.x, right.x, "vel_x");
    expect_mirrored(left.y, -right.y, "vel_y");
    expect_mirrored(left.r, -right.r, "yaw rate");
    TEST_ASSERT_TRUE(left.y != TSE_R(0));
  }
}

/* ------------------------------------------------------------------------- limits, steps, inputs */

/* The limits of a particle act on both signs, and what is nearly 0 becomes 0. */
static void test_a_motion_is_limited_to_both_sides_and_a_tiny_one_is_none(void)
{
  static const double at[][2] = { { 300, 200 }, { -300, -200 }, { 150, 150 }, { -150, -150 }, { 1e-6, 1e-6 },
    { -1e-6, -1e-6 }, { 1e-13, 0 }, { -1e-13, 0 } };
  for (int n = 0; n < ROWS(at); n++)
    expect_near(number(real(at[n][1])), number(vehicle_limit(real(at[n][0]), MAX_SPEED)), 0, "limited", n);
}

/* A step is a quarter of the time constant of the tyres, speed/damping, where the speed
 * is the mean of both wheels before and after the row; at most max_step, and at least
 * least_step. A row that is a whole number of steps has this number. */
static void test_the_steps_of_a_row_follow_the_time_constant_of_the_tyres(void)
{
  static const struct {
    double from[2], to[2];
    int steps;
  } cases[] = { { { 32, 32 }, { 32, 32 }, 4 }, { { 8, 8 }, { 8, 8 }, 8 }, { { -8, -8 }, { -8, -8 }, 8 },
    { { 0.5, 0.5 }, { 0.5, 0.5 }, 32 }, { { 0, 0 }, { 0, 0 }, 32 }, { { 0, 0 }, { 16, 16 }, 8 },
    { { 16, 16 }, { 0, 0 }, 8 }, { { 8, 8 }, { 4, 4 }, 11 }, { { 6, 10 }, { 8, 8 }, 8 },
    { { 8, 8 }, { 0, 16 }, 8 } };
  tse_params p = car(0);
  p.max_step = real(1.0 / 64), p.least_step = real(1.0 / 512), p.damping = real(1024);
  for (int n = 0; n < ROWS(cases); n++) {
    const double from[3] = { 0, cases[n].from[0], cases[n].from[1] },
                 to[3] = { 0, cases[n].to[0], cases[n].to[1] };
    const int32_t steps = vehicle_steps(&p, real(1.0 / 16), inputs_from(from), inputs_from(to));
    expect_near(cases[n].steps, steps, 0, "steps", n);
  }
}

static void test_inputs_change_evenly_within_a_row(void)
{
  const double from[3] = { 0.25, 10, 30 }, to[3] = { -0.25, 14, 20 };
  for (int k = 0; k <= 4; k++) {
    const inputs u = vehicle_between(inputs_from(from), inputs_from(to), k, 4);
    expect_near(0.25 - 0.125 * k, number(u.steer), 1e-6, "steer", k);
    expect_near(10 + k, number(u.v_front), 1e-6, "front", k);
    expect_near(30 - 2.5 * k, number(u.v_rear), 1e-6, "rear", k);
  }
}
