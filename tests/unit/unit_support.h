/* tests/unit/unit_support.h - shared by the unit tests. Each test file includes it once,
 * after the headers of src/. */
#ifndef UNIT_SUPPORT_H
#define UNIT_SUPPORT_H

#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include "model/state.h"
#include "estimator/stages.h"
#include "tse/convert.h"
#include "tse/describe.h"
#include "tse/simulate.h"
#include "unity.h"

void setUp(void);
void tearDown(void);
void setUp(void) {}
void tearDown(void) {}

#define ROWS(table) ((int)(sizeof(table) / sizeof((table)[0])))

/* Select a value for the number format. */
#if defined(TSE_REAL_FLOAT) \
    || defined(TSE_REAL_FIXED) /* its absolute resolution is a thousandth of float's at 1 */
#define BY_FORMAT(in_double, in_float) (in_float)
#else
#define BY_FORMAT(in_double, in_float) (in_double)
#endif
#if defined(TSE_REAL_FIXED)
#define BY_NUMBER(in_double, in_float, in_fixed) (in_fixed)
#define QUANTUM ldexp(1, -TSE_FRACTION_BITS) /* resolution of a number of any size */
#else
#define BY_NUMBER(in_double, in_float, in_fixed) BY_FORMAT(in_double, in_float)
#define QUANTUM 0.0 /* the relative tolerance replaces it */
#endif

static inline tse_real real(double x) { return tse_real_of(x); }
static inline double number(tse_real x) { return tse_double_of(x); }
static inline tse_setting setting(double x) { return tse_setting_of(x); }
static inline double of_setting(tse_setting x) { return tse_double_of_setting(x); }

/* Result of an invalid computation: NaN; in fixed point the largest number. */
static inline tse_real broken(void) { return BY_NUMBER(real((double)NAN), real((double)NAN), real(1e30)); }

/* Return the neighbour of x in the number format; of a setting. */
static inline tse_real neighbour(double x, double direction)
{
#if defined(TSE_REAL_FLOAT)
  return nextafterf((float)x, (float)direction);
#elif defined(TSE_REAL_FIXED)
  return real(x) + (direction > x ? 1 : -1);
#else
  return nextafter(x, direction);
#endif
}

static inline tse_setting towards(tse_setting x, double direction)
{
#if defined(TSE_REAL_FLOAT)
  return nextafterf(x, (float)direction);
#elif defined(TSE_REAL_FIXED)
  return x + (direction > 0 ? 1 : -1);
#else
  return nextafter(x, direction);
#endif
}

static inline void expect_near(double expected, double actual, double tolerance, const char *what, int index)
{
  char text[160];
  const double error = fabs(actual - expected);
  if (error <= tolerance) return; /* false for NaN */
  (void)snprintf(text, sizeof text, "%s [%d] is %.17g, expected %.17g, error %.3g > %.3g", what, index,
      actual, expected, error, tolerance);
  TEST_FAIL_MESSAGE(text);
}

/* Moments of n samples must lie within so many standard errors of their nominal values:
 * missed by chance with probability 1e-5. */
#define SIGMAS 4.42

static inline double mean_of(const double *x, int n)
{
  double sum = 0;
  for (int i = 0; i < n; i++) sum += x[i];
  return sum / n;
}

static inline double covariance(const double *x, const double *y, int n)
{
  const double mx = mean_of(x, n), my = mean_of(y, n);
  double sum = 0;
  for (int i = 0; i < n; i++) sum += (x[i] - mx) * (y[i] - my);
  return sum / (n - 1);
}

static inline void expect_moments(const double *x, int n, double mean, double sd, const char *what)
{
  expect_near(mean, mean_of(x, n), SIGMAS * sd / sqrt(n), what, 0);
  expect_near(sd, sqrt(covariance(x, x, n)), SIGMAS * sd / sqrt(2.0 * n), what, 1);
}

static inline void expect_uncorrelated(const double *x, const double *y, int n, const char *what)
{
  expect_near(
      0, covariance(x, y, n) / sqrt(covariance(x, x, n) * covariance(y, y, n)), SIGMAS / sqrt(n), what, 0);
}

/* Distributions of Student's t and of F. Regularised incomplete beta function I_x(a, b),
 * by its continued fraction (NIST DLMF 8.17.22), evaluated from its end. */
static inline double beta_share(double x, double a, double b)
{
  if (x > (a + 1) / (a + b + 2)) return 1 - beta_share(1 - x, b, a);
  double fraction = 1;
  for (int m = 200; m > 0; m--) {
    const int k = m / 2;
    const double d = m % 2 == 0 ? k * (b - k) / ((a + 2 * k - 1) * (a + 2 * k))
                                : -(a + k) * (a + b + k) / ((a + 2 * k) * (a + 2 * k + 1));
    fraction = 1 + d * x / fraction;
  }
  return exp(a * log(x) + b * log1p(-x) + lgamma(a + b) - lgamma(a) - lgamma(b)) / (a * fraction);
}

static inline double student_cdf(double x, double nu)
{
  const double tail = 0.5 * beta_share(nu / (nu + x * x), nu / 2, 0.5);
  return x < 0 ? tail : 1 - tail;
}

/* The squared radius of n jointly spherical t, over n: F(n, nu). */
static inline double radius2_cdf(double x, double nu) { return beta_share(2 * x / (2 * x + nu), 1, nu / 2); }
static inline double radius3_cdf(double x, double nu)
{
  return beta_share(3 * x / (3 * x + nu), 1.5, nu / 2);
}

static inline double quantile_of(double (*cdf)(double, double), double nu, double p)
{
  double low = cdf == student_cdf ? -1000 : 1e-12, high = 1000;
  for (int i = 0; i < 50; i++) *(cdf(0.5 * (low + high), nu) < p ? &low : &high) = 0.5 * (low + high);
  return high;
}

/* Compare bit for bit. In fixed point, products halfway between two numbers are rounded
 * up for both signs: tolerance of some hundred steps, amplified by forces. */
static inline void expect_mirrored(tse_real left, tse_real right, const char *what)
{
  if (BY_NUMBER(0, 0, 1)) expect_near(number(left), number(right), 4096 * QUANTUM, what, 0);
  else TEST_ASSERT_EQUAL_MEMORY_MESSAGE(&left, &right, sizeof left, what);
}

/* Full-period generator of test words. The library's generator has its own tests. */
static inline uint32_t next_word(uint32_t *state)
{
  *state = *state * 1664525u + 1013904223u;
  return *state ^ (*state >> 15);
}

static inline double next_uniform(uint32_t *state) /* in (0, 1) */
{
  return (next_word(state) + 0.5) / 4294967296.0;
}

static inline double next_between(uint32_t *state, double lo, double hi)
{
  return lo + (hi - lo) * next_uniform(state);
}

static inline double next_normal(uint32_t *seed)
{
  const double r = sqrt(-2 * log(next_uniform(seed)));
  return r * cos(6.283185307179586 * next_uniform(seed));
}

/* Return x with 24 bits, exact in every format. */
static inline double single(double x)
{
  volatile float y = (float)x; /* gcc 12 with -O3 -mavx2 omits some of several conversions in a row */
  return y;
}

/* Lower triangle of the Cholesky factorisation; solve l x = b. */
static inline void cholesky(double l[3][3], int n)
{
  for (int i = 0; i < n; i++)
    for (int j = 0; j <= i; j++) {
      for (int k = 0; k < j; k++) l[i][j] -= l[i][k] * l[j][k];
      l[i][j] = j == i ? sqrt(l[i][i]) : l[i][j] / l[j][j];
    }
}

static inline void forward(double l[3][3], int n, const double *b, double *x)
{
  for (int i = 0; i < n; i++) {
    x[i] = b[i];
    for (int k = 0; k < i; k++) x[i] -= l[i][k] * x[k];
    x[i] /= l[i][i];
  }
}

/* Compute to = F P F', all n x n by rows; `to` may be P. */
static inline void conjugate(int n, const double *F, const double *P, double *to)
{
  static double half[64 * 64];
  TEST_ASSERT_TRUE(n <= 64);
  for (int pass = 0; pass < 2; pass++)
    for (int i = 0; i < n; i++)
      for (int j = 0; j < n; j++) {
        double sum = 0;
        for (int k = 0; k < n; k++)
          sum += pass ? half[n * i + k] * F[n * j + k] : F[n * i + k] * P[n * k + j];
        (pass ? to : half)[n * i + j] = sum;
      }
}

/* Check that every real output is finite. They are neighbouring members between the
 * integers. */
static inline int outputs_are_finite(const tse_output *y)
{
  int fine = 1;
  for (const tse_real *x = y->stiffness; x < y->stiffness_sd + 3; x++) fine = fine && r_is_finite(*x);
  for (const tse_real *x = &y->sideslip; x <= &y->log_evidence; x++) fine = fine && r_is_finite(*x);
  return fine;
}

/* Return the description of a member by its name (tse_describe()); the test fails without
 * one. */
static inline const tse_field *field_of(tse_struct which, const char *name)
{
  int32_t count;
  const tse_field *const row = tse_describe(which, &count, NULL);
  for (int32_t i = 0; i < count; i++)
    if (strcmp(row[i].name, name) == 0) return &row[i];
  TEST_FAIL_MESSAGE(name);
  return NULL;
}

/* Loop over the members of a struct; f: description. */
#define EACH_FIELD(f, which)                                                  \
  for (int32_t count_##f, end_##f = (tse_describe(which, &count_##f, NULL), count_##f), i_##f = 0; \
       i_##f < end_##f; i_##f++) \
    for (const tse_field *f = tse_describe(which, NULL, NULL) + i_##f; f; f = NULL)

/* Loop over the parameters of effects; over the settings of tse_config. */
#define EACH_PARAMETER(e) \
  for (int32_t count_##e, end_##e = (tse_describe_effect_parameters(&count_##e), count_##e), i_##e = 0; \
       i_##e < end_##e; i_##e++) \
    for (const tse_effect_parameter *e = tse_describe_effect_parameters(NULL) + i_##e; e; e = NULL)
#define EACH_SETTING(f) EACH_FIELD(f, TSE_STRUCT_CONFIG)

static inline void put_field(void *to, const tse_field *f, double x)
{
  const tse_setting as_setting = setting(f->kind == 's' ? x : 0);
  const tse_real as_real = real(f->kind == 'r' ? x : 0);
  const int32_t whole = f->kind == 'i' ? (int32_t)x : 0;
  if (f->kind == 's') memcpy((char *)to + f->offset, &as_setting, sizeof as_setting);
  else if (f->kind == 'r') memcpy((char *)to + f->offset, &as_real, sizeof as_real);
  else memcpy((char *)to + f->offset, &whole, sizeof whole);
}

static inline void put_setting(void *to, const tse_field *f, tse_setting x)
{
  memcpy((char *)to + f->offset, &x, sizeof x);
}

static inline tse_setting setting_field(const void *from, const tse_field *f)
{
  tse_setting x;
  memcpy(&x, (const char *)from + f->offset, sizeof x);
  return x;
}

static inline int32_t whole_field(const void *from, const tse_field *f)
{
  int32_t x;
  memcpy(&x, (const char *)from + f->offset, sizeof x);
  return x;
}

static inline tse_real real_field(const void *from, const tse_field *f)
{
  tse_real x;
  memcpy(&x, (const char *)from + f->offset, sizeof x);
  return x;
}

/* Integers: within one step. Others: bit for bit. */
static inline int same_at(const void *a, const void *b, const tse_field *f)
{
  const size_t bytes = f->kind == 's' ? sizeof(tse_setting)
      : f->kind == 'r'                ? sizeof(tse_real)
                                      : sizeof(int32_t);
  return memcmp((const char *)a + f->offset, (const char *)b + f->offset, bytes) == 0;
}

static inline void put_parameter(tse_config *c, const tse_effect_parameter *e, double x)
{
  put_field(c, field_of(TSE_STRUCT_CONFIG, e->setting), x);
}

/* Role of a setting in an effect: 0 none, 1 shape, 2 strength. */
static inline int kind_of_effect_setting(const char *name)
{
  EACH_PARAMETER(e)
  if (strcmp(e->setting, name) == 0) return e->strength == 1 ? 2 : 1;
  return 0;
}

/* Limit latencies to the memory of a filter at its sample_time, for random settings. */
static inline void fit_together(tse_config *c)
{
  const tse_setting most = setting((TSE_LATENCY_ROWS - 5) * of_setting(c->sample_time) / 2.001);
  tse_setting *const latency[] = { &c->steer_angle_latency, &c->wheel_speed_front_latency,
    &c->wheel_speed_rear_latency, &c->accel_x_latency, &c->accel_y_latency };
  for (int k = 0; k < 5; k++) {
    if (*latency[k] > most) *latency[k] = most;
    if (*latency[k] < -most) *latency[k] = -most;
  }
  int32_t *const codes[] = { &c->formula_code_1, &c->formula_code_2, &c->formula_code_3, &c->formula_code_4,
    &c->formula_code_5, &c->formula_code_6, &c->formula_code_7, &c->formula_code_8, &c->formula_code_9,
    &c->formula_code_10, &c->formula_code_11 };
  for (int k = 0; k < 11; k++) *codes[k] = 0;
  *codes[0] = 1 | 16 << 8 | 34 << 16; /* a steer_angle mul */
}

/* Return the settings of tse_config_exact(), tse_config_paper() etc. */
static inline tse_config config_by(void (*make)(tse_config *))
{
  tse_config c;
  make(&c);
  return c;
}

/* The default car with the kinematics of (1)-(4), the reference of most tests. Tests add
 * effects. */
static inline tse_config default_car(void)
{
  tse_config c = config_by(tse_config_exact);
  c.exact_kinematics_share = setting(0);
  return c;
}

static inline tse_sim_config still_sim(double speed) /* no noise, no spread */
{
  tse_sim_config s;
  tse_sim_config_default(&s);
  s.noise = s.spread_cx_front = s.spread_cy_front = s.spread_cy_rear = setting(0);
  s.speed = setting(speed);
  return s;
}

/* Rows and outputs of zeros, including padding. */
#define BLANK(type, name)                               \
  static inline type name(void)                         \
  {                                                     \
    type zeros;                                         \
    memset(&zeros, 0, sizeof zeros);                    \
    return zeros;                                       \
  }
BLANK(tse_input, blank_row)
BLANK(tse_sim_input, blank_sim_input)
BLANK(tse_output, blank_output)

/* Filters in this build: 0 .. MOST_FORM. */
#if defined(TSE_NO_PARTICLES)
#define MOST_FORM 0
#else
#define MOST_FORM 2
#endif

/* Prepare settings that must be accepted. */
static inline tse_params prepared(tse_config c)
{
  tse_params p;
  const char *wrong = "";
  if (tse_prepare(&c, &p, &wrong) != TSE_OK) TEST_FAIL_MESSAGE(wrong);
  return p;
}

/* Prepare settings if the number format can represent them.
 *   Returned:  0 if tse_prepare() refuses them for the number format, and only for
 *   that */
static inline int prepared_if_held(const tse_config *c, tse_params *p)
{
  const char *wrong = NULL;
  const tse_status status = tse_prepare(c, p, &wrong);
#if defined(TSE_REAL_FIXED)
  if (status == TSE_E_FORMAT) {
    TEST_ASSERT_NOT_NULL(wrong);
    return 0;
  }
#endif
  TEST_ASSERT_EQUAL_INT_MESSAGE(TSE_OK, status, wrong ? wrong : "");
  return 1;
}

/* Make a row of these inputs and measurements.
 *   Given:  mask  bits of the channels that are used */
static inline sample sample_of_row(const tse_params *p, const double u[3], const double y[3], int mask)
{
  sample s;
  memset(&s, 0, sizeof s);
  s.dt = p->sample_time, s.has_inputs = 1, s.u.steer = real(u[0]);
  s.u.v_front = r_mul(p->radius_front, real(u[1]));
  s.u.v_rear = r_mul(p->radius_rear, real(u[2]));
  for (int a = 0; a < 3; a++) {
    const int use = mask >> a & 1;
    s.use[a] = use ? TSE_R(1) : TSE_R(0);
    s.y[a] = use ? r_mul(real(y[a]), p->inv_sd[a]) : TSE_R(0);
    s.used += use;
  }
  return s;
}

#endif
