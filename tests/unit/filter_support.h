/* tests/unit/filter_support.h - shared by the tests of src/filter: dense matrices in
 * double, and a simulated car of the filter's own model. Include it once, after
 * unit_support.h. */
#ifndef FILTER_SUPPORT_H
#define FILTER_SUPPORT_H

#include "filter/units.h"
#include "unit_support.h"

/* ------------------------------------------------------------------------------ dense, in double */

typedef struct dense {
  double p[STATES][STATES];
} dense;

static inline tse_short short_of(double x) { return r_short(real(x)); }
static inline double number_of(tse_short x) { return number(r_long(x)); }

/* Slopes of a transition, r_slope(). */
static inline tse_short slope_of(double x) { return r_slope(real(x)); }
#if defined(TSE_REAL_FIXED)
static inline double number_of_slope(tse_short x) { return ldexp(x, -SLOPE_BITS); }
#else
static inline double number_of_slope(tse_short x) { return number(x); }
#endif

/* Multiply out U D U'. */
static inline dense dense_of(const tse_ud *p)
{
  dense m;
  double u[STATES][STATES];
  for (int i = 0; i < STATES; i++)
    for (int j = 0; j < STATES; j++) u[i][j] = i == j ? 1 : i < j ? number_of(p->u[ud_column(j) + i]) : 0;
  for (int i = 0; i < STATES; i++)
    for (int k = 0; k < STATES; k++) {
      m.p[i][k] = 0;
      for (int j = 0; j < STATES; j++) m.p[i][k] += u[i][j] * number(p->d[j]) * u[k][j];
    }
  return m;
}

static inline void expect_dense(
    const dense *expected, const tse_ud *actual, double tolerance, const char *what)
{
  const dense m = dense_of(actual);
  for (int i = 0; i < STATES; i++)
    for (int k = 0; k < STATES; k++) expect_near(expected->p[i][k], m.p[i][k], tolerance, what, 100 * i + k);
}

/* Fill a matrix with numbers of the size of a covariance in units of the state. */
static inline void any_covariance(tse_ud *p, uint32_t *seed)
{
  for (int i = 0; i < STATES * (STATES - 1) / 2; i++) p->u[i] = short_of(next_between(seed, -0.5, 0.5));
  for (int i = 0; i < STATES; i++) p->d[i] = real(next_between(seed, 0.1, 2));
  p->extras = 0;
}

/* Slopes with respect to a stiffness: of its slip or slip angle, squared, the share that
 * is not estimation error. */
static inline void weaken(tse_real (*slopes)[PLACES], int rows, const tse_kalman *k)
{
  const dense m = dense_of(&k->ud);
  static const int of[3][2] = { { SF, SR }, { AF, -1 }, { AR, -1 } };
  for (int a = HAS_SLIP ? 0 : 1; a < 3; a++) {
    double signal = 0, error = 1e-6; /* as in compute_signal_shares(): never 0 over 0 */
    for (int n = 0; n < 2 && of[a][n] >= 0; n++) {
      signal += pow(number(k->x[of[a][n]]) / number(state_unit[of[a][n]]), 2);
      error += m.p[of[a][n]][of[a][n]];
    }
    for (int i = 0; i < rows; i++)
      slopes[i][stiffness_at(a)] = real(number(slopes[i][stiffness_at(a)]) * signal / (signal + error));
  }
}

/* ------------------------------------------------------------------- a car of the filter's own model */

typedef struct truth {
  tse_params p;
  tse_real x[TSE_VALUES];
  double t, steer, amplitude, frequency, throttle; /* [s] [rad] [rad] [Hz] [1] of slip */
  double noise;                                    /* [1] over that of the settings */
  uint32_t seed;
} truth;

/* A car drawn from the prior, with all states and parameters.
 *   Given:  spread  factor on the sd of the prior */
static inline void truth_start(truth *w, tse_config c, double speed, double spread, uint32_t seed)
{
  memset(w, 0, sizeof *w);
  w->p = prepared(c), w->seed = seed, w->noise = 1, w->amplitude = 0.03, w->frequency = 0.4;
  w->throttle = 0.012;
  for (int i = 0; i < 100; i++) (void)next_word(&w->seed);
  for (int i = STATES; i < TSE_VALUES; i++) w->x[i] = w->p.prior[i];
  for (int i = FAST; i < STATES; i++) {
    const double drawn = fmax(-2, fmin(2, next_normal(&w->seed)));
    w->x[i] = real(number(w->p.prior[i]) + spread * drawn * number(w->p.prior_sd[i]));
  }
  w->x[VX] = real(speed);
}

static inline double truth_noise(truth *w, double sd) { return w->noise * sd * next_normal(&w->seed); }

/* Return the row after dt. The driver holds the speed by braking and accelerating in
 * turn. */
static inline tse_input truth_row(truth *w, double dt)
{
  tse_short M[MOTION][PLACES];
  tse_real z[TSE_SENSORS], H[TSE_SENSORS][PLACES];
  forces f;
  tse_input u = blank_row();
  double left = dt, reading[TSE_SENSORS];
  steering last;
  memset(&last, 0, sizeof last);
  while (left > 1e-9) { /* in steps of a row, until the filter gets a row */
    const double h = fmin(left, 0.01), from = w->steer;
    w->t += h;
    w->steer = w->amplitude * sin(6.283185307179586 * w->frequency * w->t);
    const double slip = w->throttle * sin(2.2 * w->t);
    w->x[SF] = real(slip), w->x[SR] = real(0.5 * slip);
    last.from = real(from), last.to = real(w->steer), last.dt = real(h);
    car_move(&w->p.car, w->x, last, M);
    left -= h;
  }
  car_forces(&w->p.car, w->x, last, TSE_R(1), &f);
  car_measure(&w->p.car, w->x, &f, TSE_R(0), z, H);
  for (int a = 0; a < TSE_SENSORS; a++) reading[a] = number(z[a]) + truth_noise(w, number(w->p.sensor_sd[a]));
  u.dt = real(dt), u.steer_angle = real(w->steer), u.accel_x = real(reading[0]), u.accel_y = real(reading[1]);
  u.yaw_rate = real(reading[2]);
  u.wheel_speed_front = real(reading[3] / number(w->p.radius_front));
  u.wheel_speed_rear = real(reading[4] / number(w->p.radius_rear));
  return u;
}

static inline double truth_stiffness(const truth *w, int a) { return exp(number(w->x[stiffness_at(a)])); }

/* Check that every output is finite. */
static inline void expect_estimates_are_numbers(const tse_output *y, const char *what)
{
  TEST_ASSERT_TRUE_MESSAGE(outputs_are_finite(y), what);
}

#endif
