/* tests/unit/model/test_effect_linear.c <-> effects of src/model/catalogue.h that are
 * linear for small motions.
 *
 * Reference: transfer functions of the linear single-track model with the effect, in the
 * frequency domain, with complex numbers and in newtons, independent of the library's
 * equations of motion. Steering (or wheel speed) is a small sine. The outputs of replay
 * and simulator are projected onto sine and cosine over whole periods, after the start
 * has decayed.
 *
 * Tolerance: integration and linear interpolation between rows have errors of (w dt)^2/12
 * of the amplitude, below 2e-4 at 3 Hz and 2 ms. Second-order terms are at most the
 * amplitude, 1e-3 rad. Together 1e-3 of the channel's gain without effects. In float, yaw
 * rates at 1e-3 rad of steering have errors of 1e-3 themselves: larger steering,
 * tolerance 5e-3. */
#include "unit_support.h"
#include "effect_support.h"

#define TOLERANCE BY_FORMAT(1e-3, 8e-3)
#define AMPLITUDE BY_FORMAT(1e-3, 4e-3) /* rad */
#define DT 0.002
#define G 9.81
#define PI 3.14159265358979323846

typedef struct cplx {
  double re, im;
} cplx;

static cplx of(double re, double im)
{
  cplx z;
  z.re = re, z.im = im;
  return z;
}
static cplx add(cplx a, cplx b) { return of(a.re + b.re, a.im + b.im); }
static cplx mul(cplx a, cplx b) { return of(a.re * b.re - a.im * b.im, a.re * b.im + a.im * b.re); }
static cplx times(double k, cplx a) { return of(k * a.re, k * a.im); }
static cplx over(cplx a, cplx b)
{
  const double n = b.re * b.re + b.im * b.im;
  return of((a.re * b.re + a.im * b.im) / n, (a.im * b.re - a.re * b.im) / n);
}
static cplx expi(double phase) { return of(cos(phase), sin(phase)); }

/* The linear car in SI units, with its effects. */
typedef struct linear {
  double m, inertia, lf, lr, cf, cr, v;
  double sigma;                      /* relaxation length                    */
  double trail;                      /* aligning moment                      */
  double rear_steer, roll_f, roll_d; /* rear angle per accel_y, through a roll mode */
  double ratio, lag, lag2, delay;    /* steering                             */
  double leak_height, coupling;      /* of an IMU, and of the body mass above the roll axis */
  double arm_x, leak, leak_f, leak_d, scale_y, scale_r, turned, imu_delay;
} linear;

static linear linear_of(const tse_config *c, double v)
{
  linear l = { 0 };
  l.m = number(c->mass), l.inertia = number(c->yaw_inertia), l.lf = number(c->lf), l.lr = number(c->lr);
  l.cf = number(c->cornering_stiffness_front), l.cr = number(c->cornering_stiffness_rear), l.v = v;
  l.roll_f = l.leak_f = 1.5, l.roll_d = l.leak_d = 0.3;
  return l;
}

static cplx mode_at(double w, double f, double damping)
{
  const double wn = 2 * PI * f;
  return over(of(wn * wn, 0), of(wn * wn - w * w, 2 * damping * wn * w));
}

/* Response of the readings accel_y and yaw_rate to the steering angle at w rad/s. The
 * unknowns vy, r, Ff, Fr follow from
 *   m (s vy + v r) = (Ff + Fr) (1 + coupling leak s^2 H),
 *   I s r = lf Ff - lr Fr - trail (Ff + Fr),
 *   Ff (1 + s sigma/v) = cf (delta - (vy + lf r)/v),
 *   Fr (1 + s sigma/v) = cr ((lr r - vy)/v + k H (Ff + Fr)/m). */
static void respond(const linear *l, double w, cplx *ay, cplx *r)
{
  const cplx s = of(0, w), lagged = add(of(1, 0), times(l->sigma / l->v, s));
  const cplx roll = times(l->rear_steer / l->m, mode_at(w, l->roll_f, l->roll_d));
  const cplx one = of(1, 0), zero = of(0, 0), leak = mode_at(w, l->leak_f, l->leak_d);
  const cplx push = times(-1, add(one, times(-l->coupling * l->leak * w * w, leak)));
  cplx a[4][5] = {
    { times(l->m, s), of(l->m * l->v, 0), push, push, zero },
    { zero, times(l->inertia, s), of(l->trail - l->lf, 0), of(l->trail + l->lr, 0), zero },
    { of(l->cf / l->v, 0), of(l->cf * l->lf / l->v, 0), lagged, zero, of(l->cf, 0) },
    { of(l->cr / l->v, 0), of(-l->cr * l->lr / l->v, 0), times(-l->cr, roll),
        add(lagged, times(-l->cr, roll)), zero },
  };
  for (int i = 0; i < 4; i++) /* Gauss-Jordan with the largest pivot */
  {
    int best = i;
    for (int j = i; j < 4; j++)
      if (hypot(a[j][i].re, a[j][i].im) > hypot(a[best][i].re, a[best][i].im)) best = j;
    for (int k = 0; k < 5; k++) {
      const cplx was = a[i][k];
      a[i][k] = a[best][k];
      a[best][k] = was;
    }
    const cplx pivot = over(one, a[i][i]);
    for (int k = 0; k < 5; k++) a[i][k] = mul(pivot, a[i][k]);
    for (int j = 0; j < 4; j++) {
      const cplx f = a[j][i];
      for (int k = 0; k < 5 && j != i; k++) a[j][k] = add(a[j][k], times(-1, mul(f, a[i][k])));
    }
  }
  const cplx side = times(1 / l->m, add(a[2][4], a[3][4]));
  cplx steer = mul(times(1 + l->ratio, expi(-w * l->delay)),
      over(one, mul(add(one, times(l->lag, s)), add(one, times(l->lag2, s)))));
  cplx read = add(side, times(l->arm_x, mul(s, a[1][4])));
  read = add(read, times((G + l->leak_height * w * w) * l->leak, mul(leak, side)));
  read = times((1 + l->scale_y) * cos(l->turned), read);
  *ay = mul(mul(steer, expi(-w * l->imu_delay)), read);
  *r = mul(mul(steer, expi(-w * l->imu_delay)), times(1 + l->scale_r, a[1][4]));
}

/* Complex amplitude of y with respect to sin(w t), over the last `periods` periods: re by
 * the sine, im by the cosine. */
static cplx projected(const tse_real *y, int rows, double w, int per_period, int periods)
{
  double re = 0, im = 0, mean = 0;
  const int n = per_period * periods;
  for (int i = rows - n; i < rows; i++) mean += number(y[i]) / n;
  for (int i = rows - n; i < rows; i++) {
    re += 2 * (number(y[i]) - mean) * sin(w * i * DT) / n;
    im += 2 * (number(y[i]) - mean) * cos(w * i * DT) / n;
  }
  return of(re, im);
}

static void expect_response(cplx expected, cplx actual, double plain, const char *what, int index)
{
  expect_near(expected.re, actual.re, TOLERANCE * plain, what, index);
  expect_near(expected.im, actual.im, TOLERANCE * plain, what, index);
}

static void simulate_log(const tse_config *c, double v, int rows)
{
  static tse_sim sim;
  tse_sim_config s = still_sim(v);
  tse_sim_input u = blank_sim_input();
  tse_sim_output y;
  s.substep = setting(DT);
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_sim_reset(&sim, c, &s, NULL));
  u.dt = real(DT), u.road_level = real(1);
  for (int i = 0; i < rows; i++) {
    u.steer_angle = log_steer[i];
    TEST_ASSERT_EQUAL_INT(TSE_OK, tse_sim_step(&sim, &u, &y));
    got_y[i] = y.row.accel_y;
    got_r[i] = y.row.yaw_rate;
  }
}

/* Replay and simulator respond to steering like the linear car, at three frequencies. */
static void expect_linear(const tse_config *c, const linear *l, const char *what)
{
  static const int per_period[3] = { 1000, 333, 167 }; /* 0.5, 1.5, 3 Hz */
  const tse_config plain = default_car();
  for (int k = 0; k < 3; k++) {
    const int n = per_period[k], periods = 3, rows = 2500 + n * periods;
    const double w = 2 * PI / (n * DT);
    cplx ay, r, ay0, r0;
    const linear l0 = linear_of(&plain, l->v);
    respond(l, w, &ay, &r);
    respond(&l0, w, &ay0, &r0);
    const double most_y = hypot(ay0.re, ay0.im), most_r = hypot(r0.re, r0.im);
    straight(&plain, l->v, DT, rows);
    for (int i = 0; i < rows; i++) log_steer[i] = real(AMPLITUDE * sin(w * i * DT));
    if (number(c->wheel_radius_change) > 0) /* the log is unchanged; the car is faster than logged */
      for (int i = 0; i < rows; i++) log_front[i] = log_rear[i] = real(20 / number(plain.wheel_radius_front));
    replay(c, rows);
    expect_response(ay, times(1 / AMPLITUDE, projected(got_y, rows, w, n, periods)), most_y, what, 10 * k);
    expect_response(r, times(1 / AMPLITUDE, projected(got_r, rows, w, n, periods)), most_r, what, 10 * k + 1);
    simulate_log(c, l->v, rows);
    expect_response(
        ay, times(1 / AMPLITUDE, projected(got_y, rows, w, n, periods)), most_y, what, 10 * k + 2);
    expect_response(r, times(1 / AMPLITUDE, projected(got_r, rows, w, n, periods)), most_r, what, 10 * k + 3);
  }
}

#define CAR tse_config c = default_car(); linear l = linear_of(&c, 20)

static void test_without_effects_the_car_is_the_linear_one(void)
{
  CAR;
  expect_linear(&c, &l, "plain");
}

static void test_mass_changes_the_car_but_not_its_yaw_inertia(void)
{
  CAR;
  c.mass_change = setting(0.2);
  l.m *= 1.2;
  expect_linear(&c, &l, "mass");
}

static void test_yaw_inertia_changes_as_set(void)
{
  CAR;
  c.yaw_inertia_change = setting(-0.15);
  l.inertia *= 0.85;
  expect_linear(&c, &l, "yaw_inertia");
}

static void test_cg_shift_moves_the_centre_back(void)
{
  CAR;
  c.cg_shift_distance = setting(0.12);
  l.lf += 0.12;
  l.lr -= 0.12;
  expect_linear(&c, &l, "cg_shift");
}

static void test_wheel_radius_makes_the_car_faster_than_its_log(void)
{
  CAR;
  c.wheel_radius_change = setting(0.025);
  l.v = 20 * 1.025;
  expect_linear(&c, &l, "wheel_radius");
}

static void test_steering_ratio_scales_the_angle(void)
{
  CAR;
  c.steering_ratio_change = setting(-0.06);
  l.ratio = -0.06;
  expect_linear(&c, &l, "steering_ratio");
}

static void test_steering_delay_turns_the_phase_only(void)
{
  CAR;
  c.steering_delay_time = setting(0.035); /* more than 9 rows: samples are thinned */
  l.delay = 0.035;
  expect_linear(&c, &l, "steering_delay");
  c.steering_delay_time = setting(0.0111); /* between rows */
  l.delay = 0.0111;
  expect_linear(&c, &l, "steering_delay between rows");
}

static void test_steering_lag_is_of_first_or_second_order(void)
{
  CAR;
  c.steering_lag_time = setting(0.05);
  l.lag = 0.05;
  expect_linear(&c, &l, "steering_lag");
  c.steering_lag_second = setting(0.6); /* 0.05 is the sum of both */
  l.lag = 0.05 / 1.6, l.lag2 = 0.6 * l.lag;
  expect_linear(&c, &l, "steering_lag, second");
}

static void test_steering_compliance_is_a_softer_front_axle(void)
{
  CAR;
  c.steering_compliance_angle_per_moment = setting(6e-5), c.steering_compliance_trail = setting(0.04);
  l.cf = 1 / (1 / l.cf + 6e-5 * 0.04); /* two springs in series */
  expect_linear(&c, &l, "steering_compliance");
}

static void test_rear_roll_steer_follows_the_roll_mode(void)
{
  CAR;
  c.rear_roll_steer_gain = setting(0.1), c.rear_roll_steer_roll = setting(0.01);
  c.rear_roll_steer_frequency = setting(1.7), c.rear_roll_steer_damping = setting(0.25);
  l.rear_steer = 0.1 * 0.01, l.roll_f = 1.7, l.roll_d = 0.25;
  expect_linear(&c, &l, "rear_roll_steer");
}

static void test_relaxation_is_of_first_order_over_the_way(void)
{
  CAR;
  c.relaxation_length = setting(0.6);
  l.sigma = 0.6;
  expect_linear(&c, &l, "relaxation");
  l = linear_of(&c, 9);
  l.sigma = 0.6;
  expect_linear(&c, &l, "relaxation at 9 m/s");
}

static void test_stiffness_that_has_drifted_is_another_stiffness(void)
{
  CAR;
  c.stiffness_drift_change = setting(-0.15), c.stiffness_drift_time = setting(1);
  c.stiffness_drift_start = setting(0.5);
  l.cf *= 0.85;
  l.cr *= 0.85;
  expect_linear(&c, &l, "stiffness_drift");
}

static void test_aligning_moment_shifts_where_lateral_forces_act(void)
{
  CAR;
  c.aligning_moment_trail = setting(0.04);
  l.trail = 0.04;
  expect_linear(&c, &l, "aligning_moment");
}

static void test_lever_arm_reads_the_yaw_acceleration(void)
{
  CAR;
  c.imu_lever_arm_x = setting(-0.7);
  l.arm_x = -0.7;
  expect_linear(&c, &l, "imu_lever_arm");
}

static void test_body_roll_is_a_mode_of_the_lateral_acceleration(void)
{
  CAR;
  c.body_roll_gain = setting(0.0107), c.body_roll_frequency = setting(1.4),
  c.body_roll_damping = setting(0.22);
  l.leak = 0.0107, l.leak_f = 1.4, l.leak_d = 0.22;
  expect_linear(&c, &l, "body_roll");
  c.body_roll_height = setting(0.45);
  l.leak_height = 0.45;
  expect_linear(&c, &l, "body_roll, IMU above the roll axis");
  c.body_roll_coupling = setting(0.35);
  l.coupling = 0.35;
  expect_linear(&c, &l, "body_roll, mass above the roll axis");
}

static void test_scales_and_misalignment_scale_what_is_read(void)
{
  CAR;
  c.imu_scale_ay_error = setting(0.05), c.gyro_scale_error = setting(-0.03);
  c.imu_misalignment_angle = setting(0.15);
  l.scale_y = 0.05, l.scale_r = -0.03, l.turned = 0.15;
  expect_linear(&c, &l, "scales");
}

static void test_imu_delay_turns_the_phase_of_what_is_read(void)
{
  CAR;
  c.imu_delay_time = setting(0.03);
  l.imu_delay = 0.03;
  expect_linear(&c, &l, "imu_delay");
}

static void test_effects_of_different_places_add_up(void)
{
  CAR;
  c.relaxation_length = setting(0.4), c.steering_lag_time = setting(0.03), c.body_roll_gain = setting(0.008);
  c.imu_lever_arm_x = setting(0.5), c.imu_delay_time = setting(0.02), c.aligning_moment_trail = setting(0.03);
  l.sigma = 0.4, l.lag = 0.03, l.leak = 0.008, l.arm_x = 0.5, l.imu_delay = 0.02, l.trail = 0.03;
  expect_linear(&c, &l, "six effects");
}

/* ---------------------------------------------------------------------------------- longitudinal */

/* Compare the response of accel_x to the wheel speed u of both axles [m/s]:
 *   F = C/v (u - vx) G,  m s vx = F,  G = 1/(1 + s sigma/v),
 *   a = K G u s/(s + K G),  K = C/(m v),
 *   reading: a (1 + scale)(1 + (g - height s^2) k H) exp(-s delay). */
static void expect_along(const tse_config *c, double sigma, double leak, double leak_f, double leak_d,
    double height, double scale, double delay, const char *what)
{
  static const int per_period[2] = { 500, 167 }; /* 1, 3 Hz */
  const double v = 20, amplitude = BY_FORMAT(0.005, 0.05), k = 2 * 1.6e5 / 1900 / v;
  for (int j = 0; j < 2; j++) {
    const int n = per_period[j], periods = 3, rows = 2500 + n * periods;
    const double w = 2 * PI / (n * DT);
    const cplx s = of(0, w), kg = over(of(k, 0), add(of(1, 0), times(sigma / v, s)));
    const cplx a = over(mul(kg, s), add(s, kg));
    const cplx read = mul(times(1 + scale, mul(a, expi(-w * delay))),
        add(of(1, 0), times((G + height * w * w) * leak, mode_at(w, leak_f, leak_d))));
    const tse_config plain = default_car();
    straight(&plain, v, DT, rows);
    for (int i = 0; i < rows; i++)
      log_front[i] = log_rear[i] = real((v + amplitude * sin(w * i * DT)) / number(plain.wheel_radius_front));
    replay(c, rows);
    expect_response(read, times(1 / amplitude, projected(got_x, rows, w, n, periods)), w, what, j);
  }
}

static void test_effects_along_the_car_have_their_transfer_functions(void)
{
  tse_config c = default_car();
  expect_along(&c, 0, 0, 1, 1, 0, 0, 0, "plain");
  c.longitudinal_relaxation_length = setting(0.4);
  expect_along(&c, 0.4, 0, 1, 1, 0, 0, 0, "longitudinal_relaxation");
  c = default_car();
  c.pitch_leak_gain = setting(0.005), c.pitch_leak_frequency = setting(2.2);
  c.pitch_leak_damping = setting(0.35);
  expect_along(&c, 0, 0.005, 2.2, 0.35, 0, 0, 0, "pitch_leak");
  c.pitch_leak_height = setting(0.5);
  expect_along(&c, 0, 0.005, 2.2, 0.35, 0.5, 0, 0, "pitch_leak, IMU above the pitch axis");
  c = default_car();
  c.imu_scale_ax_error = setting(0.05), c.imu_delay_time = setting(0.02);
  expect_along(&c, 0, 0, 1, 1, 0, 0.05, 0.02, "imu_scale_ax, imu_delay");
}

/* A car drives straight at 20 m/s with given wheel speeds. Then its speed is changed by d
 * and the slip of each axle by `lag`.
 *   Returned:  what remains of d after one step of h */
static double left_of_a_step(const tse_config *c, double d, const double lag[2], double h)
{
  const tse_params p = prepared(*c);
  const stiffness k = vehicle_stiffness(&p, TSE_R(0), TSE_R(0), TSE_R(0));
  tse_effect_memory m;
  point at;
  acting to;
  memset(&m, 0, sizeof m);
  memset(&at, 0, sizeof at);
  memset(&to, 0, sizeof to);
  at.vx = at.u.v_front = at.u.v_rear = real(20);
  effects_settle(&p, &m, k, &at);
  at.vx = real(20 + d);
  for (int a = 0; a < 2; a++) m.lag[2 + a] = real(lag[a]);
  effects_at(&p, &m, m.lag, k, &at);
  to.u = at.u;
  effects_advance(&p, &m, k, &to, real(h), 1, &at);
  return number(at.vx) - 20;
}

/* A linear system y' = A y is multiplied by R(hA) in a step of ROS2, with R(z) = (1 + (1
 * - 2g) z)/(1 - g z)^2, for any step length, if and only if the Jacobian is the whole A.
 * For speed and lagging slip A is d' = K s, s' = v/sigma (-d/v - s), with K = 2 C/m and s
 * the mean of both axles. */
static void test_a_step_along_the_car_is_that_of_a_linear_system_however_long(void)
{
  static const double step[4] = { 0.005, 0.03, 0.1, 0.5 },
                      start[3][3] = { { -0.01, 0, 0 }, { -0.01, 4e-4, 0 }, { 0, 0, -3e-4 } };
  const double v = 20, sigma = 0.4, K = 2 * 1.6e5 / 1900, g = 1 - sqrt(0.5);
  tse_config c = default_car();
  c.longitudinal_relaxation_length = setting(sigma);
  for (int i = 0; i < 4; i++)
    for (int j = 0; j < 3; j++) {
      const double h = step[i], a[2][2] = { { 0, h * K }, { -h / sigma, -h * v / sigma } };
      double y[2] = { start[j][0], 0.5 * (start[j][1] + start[j][2]) }, x[2];
      for (int r = 0; r < 2; r++) x[r] = y[r] + (1 - 2 * g) * (a[r][0] * y[0] + a[r][1] * y[1]);
      for (int twice = 0; twice < 2; twice++) { /* Cramer's rule for 1 - g A */
        const double det = (1 - g * a[0][0]) * (1 - g * a[1][1]) - g * g * a[0][1] * a[1][0];
        y[0] = (x[0] * (1 - g * a[1][1]) + x[1] * g * a[0][1]) / det;
        y[1] = (x[1] * (1 - g * a[0][0]) + x[0] * g * a[1][0]) / det;
        memcpy(x, y, sizeof x);
      }
      expect_near(y[0], left_of_a_step(&c, start[j][0], &start[j][1], h), BY_NUMBER(2e-5, 3e-5, 3e-5),
          "speed", 10 * i + j); /* slip is linear to 0.05 % */
    }
}

/* A lateral lag does not affect longitudinal motion, with and without it: the same test
 * with d' = -K/v d, where A is a number. (For speeds near 20 m/s slip is linear to
 * 0.05 %.) */
static void test_a_step_along_the_car_knows_nothing_of_a_lag_across(void)
{
  static const double step[4] = { 0.005, 0.03, 0.1, 0.5 }, none[2] = { 0, 0 };
  const double g = 1 - sqrt(0.5);
  for (int lags = 0; lags < 2; lags++) {
    tse_config c = default_car();
    c.relaxation_length = setting(lags ? 0.4 : 0);
    for (int i = 0; i < 4; i++) {
      const double z = -step[i] * 2 * 1.6e5 / 1900 / 20, d = -0.01;
      expect_near(d * (1 + (1 - 2 * g) * z) / pow(1 - g * z, 2), left_of_a_step(&c, d, none, step[i]),
          BY_NUMBER(5e-6, 2e-5, 2e-5), "speed", 10 * lags + i);
    }
  }
}
