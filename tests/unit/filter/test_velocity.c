/* tests/unit/filter/test_velocity.c <-> src/filter/velocity.c, and its functions in ud.c
 * and car.c: U D U' with the extra states, compared with a dense matrix in double;
 * slopes, with differences of the model's motion; a row, with a dense Schmidt-Kalman
 * filter; the whole filter, on a car of its own model with a velocity sensor that is
 * displaced, turned and late. */
#include "filter/faults.h"
#include "filter/velocity.h"
#include "filter_support.h"

#define CLOSE BY_NUMBER(1e-10, 1e-3, 1e-5)

/* --------------------------------------------------- dense, with the extra states behind the others */

enum { N = TSE_ALL };

typedef struct full {
  double p[N][N];
} full;

static full full_of(const tse_ud *p)
{
  static double u[N][N];
  double d[N];
  full m;
  memset(u, 0, sizeof u);
  for (int i = 0; i < N; i++) u[i][i] = 1;
  for (int j = 0; j < STATES; j++) {
    d[j] = number(p->d[j]);
    for (int i = 0; i < j; i++) u[i][j] = number_of(p->u[ud_column(j) + i]);
  }
  for (int e = 0; e < TSE_EXTRAS; e++) {
    d[STATES + e] = number(p->e[e]);
    for (int j = 0; j < STATES; j++) u[STATES + e][j] = number_of(p->w[e][j]);
    for (int j = e + 1; j < TSE_EXTRAS; j++) u[STATES + e][STATES + j] = number_of(p->w[e][STATES + j]);
  }
  for (int i = 0; i < N; i++)
    for (int k = 0; k < N; k++) {
      m.p[i][k] = 0;
      for (int j = 0; j < N; j++) m.p[i][k] += u[i][j] * d[j] * u[k][j];
    }
  return m;
}

static void expect_full(const full *expected, const tse_ud *actual, const char *what)
{
  const full m = full_of(actual);
  for (int i = 0; i < N; i++)
    for (int k = 0; k < N; k++)
      expect_near(expected->p[i][k], m.p[i][k], CLOSE * fmax(1, fabs(expected->p[i][k])), what, 100 * i + k);
}

static void any_full(tse_ud *p, uint32_t *seed)
{
  tse_real variance[TSE_EXTRAS];
  any_covariance(p, seed);
  for (int e = 0; e < TSE_EXTRAS; e++) variance[e] = real(next_between(seed, 0.1, 2));
  ud_open(p, variance);
  for (int e = 0; e < TSE_EXTRAS; e++)
    for (int j = 0; j < TSE_ALL; j++)
      if (j < STATES || j > STATES + e) p->w[e][j] = short_of(next_between(seed, -0.4, 0.4));
}

/* F m F' */
static full moved(const full *m, double F[N][N])
{
  full to;
  conjugate(N, F[0], m->p[0], to.p[0]);
  return to;
}

static void identity(double F[N][N])
{
  for (int i = 0; i < N; i++)
    for (int j = 0; j < N; j++) F[i][j] = i == j;
}

static void test_opened_extra_states_are_their_variances_and_the_others_stay(void)
{
  uint32_t seed = 1;
  tse_ud p;
  tse_real variance[TSE_EXTRAS];
  any_covariance(&p, &seed);
  const dense before = dense_of(&p);
  for (int e = 0; e < TSE_EXTRAS; e++) variance[e] = real(0.5 + e);
  ud_open(&p, variance);
  const full m = full_of(&p);
  for (int i = 0; i < N; i++)
    for (int k = 0; k < N; k++)
      expect_near(i < STATES && k < STATES ? before.p[i][k]
              : i == k                     ? 0.5 + (i - STATES)
                                           : 0,
          m.p[i][k], CLOSE, "opened", 100 * i + k);
}

static void test_what_moves_the_others_keeps_what_they_share_with_the_extra_states(void)
{
  static double F[N][N];
  uint32_t seed = 3;
  for (int n = 0; n < 40; n++) {
    tse_ud p;
    tse_short M[MOTION][PLACES];
    tse_real noise[MOTION];
    any_full(&p, &seed);
    full m = full_of(&p);
    identity(F);
    for (int i = 0; i < MOTION; i++) {
      noise[i] = real(next_between(&seed, 0, 0.1));
      for (int j = 0; j < COLUMNS; j++) M[i][j] = slope_of((i == j) + next_between(&seed, -0.2, 0.2));
      for (int j = 0; j < STATES; j++) F[i][j] = number_of_slope(M[i][j]);
    }
    m = moved(&m, F);
    for (int i = 0; i < MOTION; i++) m.p[i][i] += number(noise[i]);
    ud_move(&p, M, noise);
    expect_full(&m, &p, "moved");
  }
}

static void test_sums_fading_ties_and_what_is_forgotten_are_those_of_the_matrix(void)
{
  static double F[N][N];
  uint32_t seed = 4;
  for (int n = 0; n < 40; n++) {
    tse_ud p;
    tse_real a[N], variance[STATES];
    const int at = (int)(next_uniform(&seed) * STATES), extra = (int)(next_uniform(&seed) * TSE_EXTRAS),
              count = 1 + (int)(next_uniform(&seed) * GX);
    const double share = next_between(&seed, 0.2, 1), c = next_between(&seed, 0, 2);
    any_full(&p, &seed);
    full m = full_of(&p);
    for (int i = 0; i < N; i++) a[i] = real(n % 3 == 0 && i < STATES ? 0 : next_between(&seed, -1, 1));
    for (int i = 0; i < N; i++)
      for (int k = 0; k < N; k++) m.p[i][k] += c * number(a[i]) * number(a[k]);
    ud_add(&p, a, n % 3 == 0 ? -1 : STATES - 1, real(c));
    expect_full(&m, &p, "c a a'");
    m.p[at][at] += c;
    ud_add_at(&p, at, real(c));
    expect_full(&m, &p, "more variance");
    identity(F);
    F[at][at] = number(real(share));
    m = moved(&m, F);
    ud_fade(&p, at, real(share));
    expect_full(&m, &p, "faded");
    identity(F);
    F[STATES + extra][STATES + extra] = number(real(share));
    m = moved(&m, F);
    ud_fade_extra(&p, extra, real(share));
    expect_full(&m, &p, "extra state faded");
    identity(F);
    F[STATES][at] = number(real(share));
    m = moved(&m, F);
    ud_tie(&p, at, real(share));
    expect_full(&m, &p, "tied");
    for (int i = 0; i < count; i++) {
      variance[i] = real(0.3 + i);
      for (int k = 0; k < N; k++) m.p[i][k] = m.p[k][i] = 0;
    }
    for (int i = 0; i < count; i++) m.p[i][i] = 0.3 + i;
    ud_forget(&p, variance, count);
    expect_full(&m, &p, "forgotten");
    for (int k = 0; k < N; k++) m.p[STATES][k] = m.p[k][STATES] = 0;
    m.p[STATES][STATES] = 7;
    ud_renew(&p, TSE_R(7));
    expect_full(&m, &p, "renewed");
  }
}

/* ------------------------------------------------------------------------------- slopes */

static tse_config a_config(void)
{
  tse_config c = config_by(tse_config_default);
  c.mass = TSE_S(1900);
  return c;
}

/* In a turn, with all states away from rest. */
static void any_motion(tse_real x[TSE_ALL], uint32_t *seed)
{
  for (int i = 0; i < TSE_ALL; i++) x[i] = TSE_R(0);
  x[VX] = real(next_between(seed, 12, 30));
  x[VY] = real(next_between(seed, -0.5, 0.5));
  x[YAW] = real(next_between(seed, -0.4, 0.4));
  x[AF] = real(next_between(seed, -0.05, 0.05));
  x[AR] = real(next_between(seed, -0.05, 0.05));
  x[PHI] = real(next_between(seed, -0.03, 0.03));
  x[DPHI] = real(next_between(seed, -0.1, 0.1));
  x[SF] = real(next_between(seed, -0.01, 0.01));
  x[SR] = real(next_between(seed, -0.01, 0.01));
  x[GX] = real(next_between(seed, -0.3, 0.3));
  x[GY] = real(next_between(seed, -0.3, 0.3));
  x[LEAN] = real(0.1);
  x[LCF] = real(next_between(seed, -0.2, 0.2));
  x[LCR] = real(next_between(seed, -0.2, 0.2));
}

static void rates(
    const tse_params *p, const tse_real x[TSE_VALUES], steering u, tse_real rate[3], tse_real by[3][PLACES])
{
  forces f;
  car_forces(&p->car, x, u, TSE_R(1), &f);
  car_rates(&p->car, x, &f, rate, by);
}

/* Rates of speeds and yaw rate are those of car_move() in a short time. Slopes are their
 * differences. */
static void test_rates_are_those_of_the_motion_and_slopes_are_their_differences(void)
{
  tse_config c = a_config();
  c.cg_height = c.longitudinal_load_transfer_gain = c.lateral_load_transfer_gain = setting(
      0); /* slopes neglect load transfer: car.c */
  const tse_params p = prepared(c);
  uint32_t seed = 5;
  for (int n = 0; n < 30; n++) {
    tse_short M[MOTION][PLACES];
    tse_real x[TSE_ALL], to[TSE_ALL], rate[3], by[3][PLACES], up[3], down[3], none[3][PLACES];
    any_motion(x, &seed);
    const double h = BY_NUMBER(2e-7, 1e-3, 1e-3);
    const tse_real angle = real(next_between(&seed, -0.03, 0.03));
    const steering still = { angle, angle, real(h) };
    rates(&p, x, still, rate, by);
    memcpy(to, x, sizeof to);
    car_move(&p.car, to, still, M);
    for (int i = 0; i < 3; i++)
      expect_near((number(to[VX + i]) - number(x[VX + i])) / h, number(rate[i]), BY_NUMBER(1e-4, 0.4, 0.4),
          "rate", i);
    for (int j = 0; j < STATES; j++) {
      const double d = BY_NUMBER(1e-6, 1e-3, 1e-4);
      memcpy(to, x, sizeof to);
      to[j] = real(number(x[j]) + d);
      rates(&p, to, still, up, none);
      to[j] = real(number(x[j]) - d);
      rates(&p, to, still, down, none);
      if (j == LMU) continue; /* longitudinal saturation does not measure the grip: car.c */
      for (int i = 0; i < 3; i++) {
        const double slope = (number(up[i]) - number(down[i]))
            / (number(real(number(x[j]) + d)) - number(real(number(x[j]) - d)));
        expect_near(slope, number(by[i][j]),
            BY_NUMBER(1e-5, 1e-2, 1e-3) * fmax(1, fabs(slope)) + BY_NUMBER(0, 0.05, 0.01), "slope",
            100 * i + j);
      }
    }
  }
}

/* ------------------------------------------------------- a row beside a dense Schmidt-Kalman filter */

/* Return the reading of a channel, written out.
 *   Given:  s                all states, in SI units
 *           motion, heading  at the time of the measurement */
static double reads(int channel, const double s[N], const double motion[3], double heading)
{
  const double vx = motion[0] - motion[2] * s[V_LEVER_Y],
               vy = motion[1] + s[V_DISCREPANCY] + motion[2] * s[V_LEVER_X], scale = 1 + s[V_SCALE];
  switch (channel) {
    case 0: return scale * (vx + s[V_TURN] * vy);
    case 1: return scale * (vy - s[V_TURN] * vx);
    case 2: return scale * hypot(vx, vy);
    default: return heading + atan2(vy, vx);
  }
}

static double state_of(const tse_kalman *k, int i) { return number(k->x[i]); }

/* One velocity of a channel: x and P are those of a dense filter with slopes from
 * differences of the function above. A latency moves the motion back along the rates of
 * the model. */
static void test_a_row_is_that_of_a_dense_schmidt_kalman_filter(void)
{
  enum { D = TSE_CONSIDERED, ALL = N + D };
  static double P[ALL][ALL], A[ALL][ALL], next[ALL][ALL];
  uint32_t seed = 6;
  for (int n = 0; n < 40; n++) {
    static tse_kalman k;
    tse_config c = a_config();
    const int channel = n % TSE_VELOCITIES;
    c.velocity_latency = setting(n % 3 ? 0.06 : 0);
    c.velocity_latency_sd = setting(0.003), c.ins_velocity_sd = c.gnss_speed_sd = setting(0.01);
    c.gnss_course_sd = setting(
        0.001); /* uncertain parameters matter here: without them Schmidt's gain is omitted */
    const tse_params p = prepared(c);
    tse_real rate[3], by[3][PLACES], change[TSE_ALL];
    const tse_real angle = real(0.01);
    const steering still = { angle, angle, real(0.01) };
    forces f;
    decoded z = { 0 };
    memset(&k, 0, sizeof k);
    any_full(&k.ud, &seed);
    for (int j = 0; j < STATES; j++) k.ud.d[j] = real(0.01 * number(k.ud.d[j])); /* the linear part */
    for (int e = 0; e < TSE_EXTRAS; e++) k.ud.e[e] = real(0.01 * number(k.ud.e[e]));
    any_motion(k.x, &seed);
    const int slow = n / TSE_VELOCITIES % 2; /* below 10 m/s a course has sd ~ 1/speed */
    if (slow) k.x[VX] = TSE_R(8);
    k.x[PSI] = real(3.1); /* near the wrap of angles */
    k.x[V_SCALE] = real(0.01), k.x[V_DISCREPANCY] = real(0.05), k.x[V_TURN] = real(-0.02),
    k.x[V_LEVER_X] = real(1.2);
    k.x[V_LEVER_Y] = real(-0.3);
    for (int q = 0; q < TSE_CONSIDERED; q++)
      for (int i = 0; i < TSE_ALL; i++)
        k.consider[q][i] = short_of(p.uncertain[q] > TSE_R(0) ? next_between(&seed, -0.1, 0.1) : 0);
    for (int v = 0; v < TSE_VELOCITIES; v++) k.velocity.noise[v] = k.velocity.mean_nis[v] = TSE_R(1);
    for (int a = 0; a < TSE_SENSORS; a++) k.noise[a] = k.usual[a] = TSE_R(1);
    k.velocity.has_heading = k.velocity.has_gyro = 1, k.velocity.gyro = k.x[YAW];
    k.velocity.kept = 2; /* a straight past, by the rates */
    car_forces(&p.car, k.x, still, TSE_R(1), &f);
    car_rates(&p.car, k.x, &f, rate, by);
    for (int m = 0; m < 2; m++) {
      k.velocity.age[m] = real(0.04 * m);
      for (int i = 0; i < 4; i++)
        k.velocity.past[m][i] = real(-0.04 * m * (i < 3 ? number(rate[i]) : number(k.velocity.gyro)));
    }
    k.velocity.age[1] = real(0.2);
    for (int i = 0; i < 4; i++)
      k.velocity.past[1][i] = real(-0.2 * (i < 3 ? number(rate[i]) : number(k.velocity.gyro)));
    for (int i = 0; i < 3; i++) k.velocity.motion[i] = k.x[VX + i];
    k.velocity.turned = TSE_R(0);
    z.dt = real(1e-7); /* the past hardly moves */

    /* dense */
    const double late = n % 3 ? 0.06 : 0, r0 = number(rate[0]), r1 = number(rate[1]), r2 = number(rate[2]),
                 g = number(k.velocity.gyro);
    double s[N], h[ALL], ph[ALL], gain[ALL], predicted = 0;
    for (int i = 0; i < N; i++) s[i] = state_of(&k, i);
    const double then[3] = { s[VX] - late * r0, s[VY] - late * r1, s[YAW] - late * r2 };
    predicted = reads(channel, s, then, s[PSI] - late * g);
    for (int j = 0; j < N;
        j++) { /* slopes: the state at the time of the row moves the past one by 1 - late d rate/dx */
      double value[2];
      for (int side = 0; side < 2; side++) {
        const double d = side ? -1e-5 : 1e-5;
        double t[N], m[3], heading = s[PSI] - late * g;
        memcpy(t, s, sizeof t);
        t[j] += d;
        for (int i = 0; i < 3; i++)
          m[i] = then[i] + (j == VX + i ? d : 0) - (j < STATES ? late * number(by[i][j]) * d : 0);
        if (j == PSI) heading += d;
        if (j == BR) heading += late * d;
        if (j == V_LATE) {
          m[0] -= d * r0;
          m[1] -= d * r1;
          m[2] -= d * r2;
          heading -= d * g;
        }
        value[side] = reads(channel, t, m, heading);
      }
      h[j] = (value[0] - value[1]) / 2e-5 * number(state_unit[j]);
    }
    const double along = h[V_LATE] / number(state_unit[V_LATE]);
    if (channel == 0 || channel == 2) h[V_LATE] = 0; /* latency is considered there, not learnt */
    for (int q = 0; q < D; q++) {
      h[N + q] = 0;
      for (int i = 0; i < 3 && q < COLUMNS - STATES; i++) {
        double t[3] = { then[0], then[1], then[2] };
        t[i] += 1e-5;
        const double slope = (reads(channel, s, t, s[PSI] - late * g) - predicted) / 1e-5;
        h[N + q] -= slope * late * number(by[i][STATES + q]) * number(p.uncertain[q]);
      }
    }
    const full own = full_of(&k.ud);
    memset(P, 0, sizeof P);
    for (int i = 0; i < N; i++) {
      for (int j = 0; j < N; j++) {
        P[i][j] = own.p[i][j];
        for (int q = 0; q < D; q++) P[i][j] += number_of(k.consider[q][i]) * number_of(k.consider[q][j]);
      }
      for (int q = 0; q < D; q++) P[i][N + q] = P[N + q][i] = number_of(k.consider[q][i]);
    }
    for (int q = 0; q < D; q++) P[N + q][N + q] = 1;
    double var = 0;
    for (int i = 0; i < ALL; i++) {
      ph[i] = 0;
      for (int j = 0; j < ALL; j++) ph[i] += P[i][j] * h[j];
    }
    for (int i = 0; i < ALL; i++) var += h[i] * ph[i];
    /* Noise: white, from the setting, and a persistent share that lasts a second, as
     * white noise with the same density at low frequencies. */
    const double sd = number(p.velocity_sd[channel]) * (slow && channel == 3 ? 10.0 / 8 : 1),
                 r = sd * sd * (1 + 0.25 * (1 + 2.0 / 0.1))
        + (channel == 0 || channel == 2 ? pow(along * number(p.extra_sd[V_LATE - STATES]), 2) : 0);
    const double e = next_between(&seed, -1, 1) * sqrt(var + r);
    for (int i = 0; i < ALL; i++) gain[i] = i < N ? ph[i] / (var + r) : 0;
    for (int i = 0; i < ALL; i++)
      for (int j = 0; j < ALL; j++) A[i][j] = (i == j) - gain[i] * h[j];
    conjugate(ALL, A[0], P[0], next[0]);
    for (int i = 0; i < ALL; i++)
      for (int j = 0; j < ALL; j++) next[i][j] += gain[i] * r * gain[j];

    /* of the filter */
    double value = predicted + e;
    if (channel == 3 && value > 3.14159) value -= 6.283185307179586;
    z.given = 1u << channel, z.optional[channel] = real(value);
    k.velocity.since[channel] = real(0.1);
    for (int i = 0; i < TSE_ALL; i++) change[i] = TSE_R(0);
    velocity_update(&p, &k, &z, &f, change);
    const full mine = full_of(&k.ud);
    const double close = BY_NUMBER(2e-6, 2e-2, 2e-2); /* differences, and a past that has moved by 0.1 us */
    for (int i = 0; i < N; i++) {
      expect_near(
          gain[i] * e, number(change[i]), close * fmax(1, fabs(gain[i] * e)), "state", 1000 * channel + i);
      for (int j = 0; j < N; j++) {
        double is = mine.p[i][j];
        for (int q = 0; q < D; q++) is += number_of(k.consider[q][i]) * number_of(k.consider[q][j]);
        expect_near(next[i][j], is, close * fmax(1, fabs(next[i][j])), "covariance", 100 * i + j);
      }
      for (int q = 0; q < D; q++)
        expect_near(next[i][N + q], number_of(k.consider[q][i]), close, "uncertain quantity", 100 * i + q);
    }
  }
}

/* A state with any covariance, in a turn, with all extra states in use. */
static void any_kalman(const tse_params *p, tse_kalman *k, uint32_t *seed)
{
  memset(k, 0, sizeof *k);
  any_full(&k->ud, seed);
  any_motion(k->x, seed);
  for (int q = 0; q < TSE_CONSIDERED; q++)
    for (int i = 0; i < TSE_ALL; i++)
      k->consider[q][i] = short_of(p->uncertain[q] > TSE_R(0) ? next_between(seed, -0.2, 0.2) : 0);
  for (int n = 0; n < TSE_EVENTS; n++)
    for (int i = 0; i < TSE_ALL; i++) k->event[n].v[i] = short_of(next_between(seed, -0.2, 0.2));
  for (int c = 0; c < TSE_VELOCITIES; c++) k->velocity.noise[c] = k->velocity.mean_nis[c] = TSE_R(1);
  for (int a = 0; a < TSE_SENSORS; a++) k->noise[a] = k->usual[a] = TSE_R(1);
}

static double heading_after(const tse_params *p, const tse_kalman *from, const decoded *z)
{
  static tse_kalman k;
  k = *from;
  velocity_move(p, &k, z);
  return number(k.x[PSI]);
}

/* Error of the heading by each considered parameter and each event: the additional turn
 * in a row from a state with the corresponding error. A gyro with a scale error reads the
 * yaw rate times that scale. */
static void test_the_heading_is_off_by_what_turns_it_otherwise(void)
{
  tse_config config = a_config();
  config.gyro_scale_sd = setting(0.02), config.cg_sd = setting(0.03), config.relaxation_sd = setting(0.2);
  const tse_params p = prepared(config);
  uint32_t seed = 8;
  for (int n = 0; n < 12; n++) {
    static tse_kalman k, off, moved;
    decoded z = { 0 };
    const int measured = n % 2;
    const double unit = number(state_unit[PSI]), close = BY_NUMBER(1e-9, 2e-4, 1e-5);
    any_kalman(&p, &k, &seed);
    z.dt = real(0.25), z.use[YAW_RATE] = measured, z.z[YAW_RATE] = real(next_between(&seed, -0.4, 0.4));
    k.velocity.has_gyro = !measured; /* the previous row was of the other kind: no rate to start from */
    moved = k;
    velocity_move(&p, &moved, &z);
    const double plain = number(moved.x[PSI]);
    for (int q = -TSE_EVENTS; q < TSE_CONSIDERED; q++) {
      const tse_short *const was = q < 0 ? k.event[-1 - q].v : k.consider[q],
                             *const is = q < 0 ? moved.event[-1 - q].v : moved.consider[q];
      decoded other_z = z;
      off = k;
      for (int i = 0; i < TSE_ALL; i++) off.x[i] += real(number_of(was[i]) * number(state_unit[i]));
      if (q == CONSIDER_GYRO) other_z.z[YAW_RATE] -= r_mul(p.uncertain[q], z.z[YAW_RATE] - k.x[BR]);
      expect_near((heading_after(&p, &off, &other_z) - plain) / unit, number_of(is[PSI]), close, "heading",
          100 * n + q);
    }
  }
}

/* The zero of a course is arbitrary: if heading and course are turned by the same angle,
 * a row has the same effect on everything else. */
static void test_the_zero_of_a_course_changes_nothing_but_the_heading(void)
{
  tse_config config = a_config();
  config.gnss_course_sd = setting(0.05);
  const tse_params p = prepared(config);
  uint32_t seed = 9;
  int across = 0;
  for (int n = 0; n < 20; n++) {
    static tse_kalman k, turned;
    decoded z = { 0 };
    forces f;
    tse_real plain[TSE_ALL], change[TSE_ALL];
    const steering still = { real(0.01), real(0.01), real(0.01) };
    const double pi = 3.14159265358979323846, off = next_between(&seed, -0.1, 0.1);
    any_kalman(&p, &k, &seed);
    k.velocity.has_heading = 1;
    k.velocity.since[3] = real(0.1), k.velocity.last[3] = TSE_R(7);
    car_forces(&p.car, k.x, still, TSE_R(1), &f);
    z.given = 1u << 3, z.dt = real(0.01);
    for (int m = -4; m <= 4; m++) {
      const double angle = m == 0
          ? 0
          : (m < 0 ? 0.02 * (-m - 1) - pi : pi - 0.02 * (m - 1)); /* 0; near the wrap of angles */
      const double course = angle + atan2(number(k.x[VY]), number(k.x[VX])) + off,
                   wraps = course >= pi ? 1
          : course < -pi                ? -1
                                        : 0;
      turned = k;
      turned.x[PSI] = real(angle);
      z.optional[3] = real(course - 2 * pi * wraps);
      across += wraps != 0;
      for (int i = 0; i < TSE_ALL; i++) change[i] = TSE_R(0);
      velocity_update(&p, &turned, &z, &f, change);
      if (m == -4) memcpy(plain, change, sizeof plain);
      for (int i = 0; i < TSE_ALL; i++)
        expect_near(number(plain[i]), number(change[i]),
            BY_NUMBER(1e-9, 1e-3, 1e-5) * (1 + fabs(number(plain[i]))), "state", 1000 * m + i);
      TEST_ASSERT_TRUE(fabs(number(change[PSI])) > 1e-3 && turned.velocity.rejected_for[3] == TSE_R(0));
    }
  }
  TEST_ASSERT_TRUE(across > 20);
}

/* The lateral speed is that of the model plus its error: the variance of a sum, from the
 * covariance matrix and the considered parameters. */
static void test_the_variance_of_the_speed_across_is_that_of_a_sum(void)
{
  const tse_params p = prepared(a_config());
  uint32_t seed = 10;
  for (int n = 0; n < 20; n++) {
    static tse_kalman k;
    any_kalman(&p, &k, &seed);
    const full m = full_of(&k.ud);
    const double a = number(state_unit[VY]), b = number(state_unit[V_DISCREPANCY]);
    double var = a * a * m.p[VY][VY] + 2 * a * b * m.p[VY][V_DISCREPANCY]
        + b * b * m.p[V_DISCREPANCY][V_DISCREPANCY];
    for (int q = 0; q < TSE_CONSIDERED; q++)
      var += pow(a * number_of(k.consider[q][VY]) + b * number_of(k.consider[q][V_DISCREPANCY]), 2);
    expect_near(var, number(velocity_across_var(&k)), CLOSE * fmax(1, var), "variance", n);
  }
}

/* The extra states begin with their prior, and nothing else is known of them: neither
 * parameters nor events have moved them. A velocity that is not used starts them, too. */
static void test_extra_states_begin_with_what_the_settings_say(void)
{
  static tse_kalman k;
  tse_params p = prepared(a_config());
  uint32_t seed = 21;
  decoded z = { 0 };
  forces f;
  tse_real change[TSE_ALL];
  const steering still = { real(0.01), real(0.01), real(0.01) };
  any_kalman(&p, &k, &seed);
  k.ud.extras = 0;
  for (int e = 0; e < TSE_EXTRAS; e++) p.extra[e] = real(0.01 * (e + 1));
  for (int q = 0; q < TSE_CONSIDERED; q++)
    for (int e = STATES; e < TSE_ALL; e++) k.consider[q][e] = short_of(0.5);
  for (int n = 0; n < TSE_EVENTS; n++)
    for (int e = STATES; e < TSE_ALL; e++) k.event[n].v[e] = short_of(0.5);
  for (int i = 0; i < TSE_ALL; i++) change[i] = TSE_R(0);
  car_forces(&p.car, k.x, still, TSE_R(1), &f);
  z.given = TSE_GIVEN_ins_vel_x, z.dt = real(0.01), z.one_speed = 1, z.optional[0] = real(20);
  velocity_update(&p, &k, &z, &f, change);
  TEST_ASSERT_EQUAL_INT(TSE_EXTRAS, k.ud.extras);
  for (int e = 0; e < TSE_EXTRAS; e++) {
    expect_near(0.01 * (e + 1), number(k.x[STATES + e]), 1e-7, "mean", e);
    for (int q = 0; q < TSE_CONSIDERED; q++)
      expect_near(0, number_of(k.consider[q][STATES + e]), 0, "parameter", e);
    for (int n = 0; n < TSE_EVENTS; n++) expect_near(0, number_of(k.event[n].v[STATES + e]), 0, "event", e);
  }
}

/* The heading turns by the mean of the rates before and after the row, without the bias,
 * and stays within a half turn. The model discrepancy is as active as the rear axle moves
 * sideways, at least as MIN_SIDEWAYS_SPEED. */
static void test_a_heading_turns_by_the_mean_rate_and_stays_within_half_a_turn(void)
{
  static const struct {
    double heading, before, now, r, vy;
    int had, measured;
  } cases[] = { { 0.5, 0.2, 0.4, 0.1, 0.5, 1, 1 }, { 3.13, 0.4, 0.5, 0.3, -0.5, 1, 1 },
    { -3.13, -0.4, -0.5, -0.3, 0.5, 1, 1 }, { 0.5, 9, 0.4, 0, 0, 0, 1 }, { 0.5, 0.25, 9, 0.35, 0.5, 0, 0 },
    { 3.13, 9, 9, 0.35, 0.1, 1, 0 } };
  const tse_params p = prepared(a_config());
  for (int n = 0; n < ROWS(cases); n++) {
    static tse_kalman k;
    uint32_t seed = 22;
    decoded z = { 0 };
    any_kalman(&p, &k, &seed);
    k.x[PSI] = real(cases[n].heading), k.x[YAW] = real(cases[n].r), k.x[VY] = real(cases[n].vy);
    k.x[BR] = real(0.02), k.velocity.has_gyro = cases[n].had, k.velocity.gyro = real(cases[n].before);
    k.velocity.activity = real(0.75);
    z.dt = real(0.1), z.use[YAW_RATE] = cases[n].measured, z.z[YAW_RATE] = real(cases[n].now);
    for (int c = 0; c < TSE_VELOCITIES; c++) k.velocity.since[c] = MAX_SINCE;
    velocity_move(&p, &k, &z);
    const double rate = cases[n].measured ? cases[n].now - 0.02 : cases[n].r;
    const double before = cases[n].had == cases[n].measured ? cases[n].before : rate;
    const double to = cases[n].heading + 0.05 * (before + rate), pi = 3.14159265358979323846;
    expect_near(to > pi ? to - 2 * pi : to < -pi ? to + 2 * pi : to, number(k.x[PSI]), 1e-6, "heading", n);
    const double sideways = number(p.car.lr) * cases[n].r - cases[n].vy,
                 square = fmax(sideways * sideways, pow(number(MIN_SIDEWAYS_SPEED), 2));
    expect_near(0.75 + 0.1 / (0.1 + number(MODEL_TIME)) * (square - 0.75), number(k.velocity.activity), 1e-6,
        "activity", n);
    for (int c = 0; c < TSE_VELOCITIES; c++)
      expect_near(number(MAX_SINCE), number(k.velocity.since[c]), 0, "limited", n);
  }
}

/* ------------------------------------------------------------------------------- drives */

typedef struct sensor { /* velocity sensor and its errors */
  double late, lever_x, lever_y, turn, zero, sd, course_sd;
  int every;
  double past[64][4]; /* ring of past rows: longitudinal, lateral speed, yaw rate, heading */
  int rows;
  double heading;
} sensor;

/* Set by begin(): filter and settings, car, velocity sensor, noise. */
static tse_filter f, other;
static tse_config c;
static truth w;
static sensor s;
static uint32_t seed;

/* A row with the velocities in `which`, read at t - late. */
static tse_input measured_row(uint32_t which)
{
  const double before = number(w.x[YAW]);
  tse_input u = truth_row(&w, 0.01);
  s.heading += 0.005 * (before + number(w.x[YAW]));
  double *const now = s.past[s.rows % 64];
  for (int i = 0; i < 3; i++) now[i] = number(w.x[VX + i]);
  now[3] = s.heading;
  const int late = (int)(s.late / 0.01 + 0.5);
  s.rows++;
  if (s.rows <= late || s.rows % s.every) return u;
  const double *const then = s.past[(s.rows - 1 - late) % 64];
  const double vx = then[0] - then[2] * s.lever_y, vy = then[1] + then[2] * s.lever_x;
  u.given = which;
  u.ins_vel_x = real(vx + s.turn * vy + s.sd * next_normal(&seed));
  u.ins_vel_y = real(vy - s.turn * vx + s.sd * next_normal(&seed));
  u.gnss_speed = real(hypot(vx, vy) + s.sd * next_normal(&seed));
  const double course = s.zero + then[3] + atan2(vy, vx) + s.course_sd * next_normal(&seed);
  u.gnss_course = real(course - 6.283185307179586 * floor(course / 6.283185307179586 + 0.5));
  return u;
}

static const uint32_t ins = TSE_GIVEN_ins_vel_x | TSE_GIVEN_ins_vel_y,
                      gnss = TSE_GIVEN_gnss_speed | TSE_GIVEN_gnss_course;

static tse_output stepped(const tse_params *p, tse_filter *to, const tse_input *u)
{
  tse_output y = blank_output();
  TEST_ASSERT_TRUE(tse_step(p, to, u, &y) >= 0);
  expect_estimates_are_numbers(&y, "a row");
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_filter_check(p, to, sizeof *to));
  return y;
}

/* Run a drive from its start, with a velocity every so many rows. */
static void begin_with(const tse_config *config, int every)
{
  c = *config;
  memset(&s, 0, sizeof s);
  s.every = every, s.sd = 0.03, s.course_sd = 0.004, s.zero = 2.9;
  seed = 5;
  truth_start(&w, c, 20, 0.7, 12);
  w.amplitude = 0.025;
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_reset(&w.p, &f, sizeof f));
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_reset(&w.p, &other, sizeof other));
}

static tse_config a_drive(void)
{
  tse_config config = config_by(tse_config_exact);
  config.grip = setting(1), config.grip_sd = setting(0.15), config.relaxation_length = setting(0.4);
  config.initial_cx_sd = config.initial_cy_front_sd = config.initial_cy_rear_sd = setting(0.2);
  config.accel_x_sd = config.accel_y_sd = setting(0.1), config.model_sd = setting(0.05);
  config.steer_ratio_sd = setting(0.02);
  return config;
}

static void begin(int every)
{
  const tse_config config = a_drive();
  begin_with(&config, every);
}

/* Return the rms error of vel_y after `from` rows. */
static double off_across(uint32_t which, int rows, int from)
{
  double sum = 0;
  seed = 77;
  for (int n = 0; n < rows; n++) {
    const tse_input u = measured_row(which);
    const tse_output y = stepped(&w.p, &f, &u);
    if (n >= from) sum += pow(number(y.vel_y) - number(w.x[VY]), 2);
  }
  return sqrt(sum / (rows - from));
}

static void test_what_is_not_given_is_not_read_and_changes_no_bit(void)
{
  begin(1);
  for (int n = 0; n < 300; n++) {
    tse_input u = measured_row(0), zero = u;
    zero.given = 0;
    zero.ins_vel_x = zero.ins_vel_y = zero.gnss_speed = zero.gnss_course = TSE_R(0);
    (void)stepped(&w.p, &f, &u);
    (void)stepped(&w.p, &other, &zero);
  }
  TEST_ASSERT_EQUAL_INT(0, f.k.ud.extras);
  TEST_ASSERT_EQUAL_MEMORY(&f, &other, sizeof f);
}

/* Without a steering angle nothing is measured: a velocity would change the stiffness to
 * compensate for the unknown angle. */
static void test_a_velocity_moves_no_stiffness_while_there_is_no_steering_angle(void)
{
  begin(1);
  for (int n = 0; n < 1500; n++) {
    tse_input u = measured_row(ins);
    const int missing = n > 1000 && n % 50 < 20;
    const tse_real was[3] = { f.k.x[LCX], f.k.x[LCF], f.k.x[LCR] };
    if (missing) {
      u.missing |= TSE_MISSING_steer_angle;
      u.ins_vel_y += TSE_R(0.5);
    }
    (void)stepped(&w.p, &f, &u);
    if (missing) TEST_ASSERT_EQUAL_MEMORY(was, &f.k.x[LCX], sizeof was);
  }
}

/* The difference of a velocity to one speed of the vehicle need not be slip. With one
 * speed, a longitudinal velocity gives no information, a lateral one does. */
static void test_beside_one_speed_a_velocity_along_is_not_used(void)
{
  begin(1);
  for (int n = 0; n < 500; n++) {
    tse_input u = measured_row(ins | gnss), v = u;
    u.wheel_speed_front = v.wheel_speed_front = u.wheel_speed_rear;
    if (n == 400) v.ins_vel_x += TSE_R(1), v.gnss_speed += TSE_R(1);
    (void)stepped(&w.p, &f, &u);
    (void)stepped(&w.p, &other, &v);
  }
  TEST_ASSERT_TRUE(f.k.innovation_var[WHEEL_FRONT] == TSE_R(0) && f.k.ud.extras > 0);
  TEST_ASSERT_EQUAL_MEMORY(&f, &other, sizeof f);
  tse_input u = measured_row(ins | gnss), v = u;
  u.wheel_speed_front = v.wheel_speed_front = u.wheel_speed_rear;
  v.ins_vel_y += real(0.02);
  TEST_ASSERT_TRUE(number(stepped(&w.p, &other, &v).vel_y) > number(stepped(&w.p, &f, &u).vel_y));
}

/* A frozen gyro does not turn the heading, whatever other channel is named as faulty. */
static void test_a_frozen_gyro_turns_no_heading(void)
{
  begin(1);
  for (int n = 0; n < 500; n++) {
    const tse_input u = measured_row(ins | gnss);
    (void)stepped(&w.p, &f, &u);
  }
  TEST_ASSERT_EQUAL_INT(1, f.k.velocity.has_gyro);
  tse_input u = measured_row(ins | gnss);
  u.yaw_rate = f.k.reading[YAW_RATE];
  f.k.fault = fault_of(ACCEL_Y);
  f.k.frozen[YAW_RATE] = MAX_FROZEN;
  (void)stepped(&w.p, &f, &u);
  TEST_ASSERT_TRUE(is_frozen(&f.k, YAW_RATE));
  TEST_ASSERT_EQUAL_INT(0, f.k.velocity.has_gyro);
}

/* A value out of range or NaN is missing. The first valid one starts the extra states. In
 * the prediction of that row, the other states are unchanged bit for bit. */
static void test_what_cannot_be_a_velocity_is_not_there(void)
{
  begin(1);
  for (int n = 0; n < 100; n++) {
    tse_input u = measured_row(ins | gnss);
    u.ins_vel_x = TSE_R(121), u.ins_vel_y = TSE_R(-61), u.gnss_speed = TSE_R(-1), u.gnss_course = TSE_R(7.1);
    (void)stepped(&w.p, &f, &u);
  }
  TEST_ASSERT_EQUAL_INT(0, f.k.ud.extras);
}

/* A bank of 12 %, eight times the expected one, moves the car sideways, and only a
 * velocity shows it. */
static void test_an_ins_that_is_mounted_straight_shows_the_speed_across(void)
{
  tse_config config = a_drive();
  config.velocity_heading_sd = setting(0.0005);
  begin_with(&config, 1);
  w.x[GY] = real(1.2);
  const double without = off_across(0, 3000, 1000);
  begin_with(&config, 1);
  w.x[GY] = real(1.2);
  const double with = off_across(ins, 3000, 1000);
  TEST_ASSERT_TRUE(with < 0.8 * without);
}

/* Position and scale of an INS may be known exactly: then no drive changes them. */
static void test_what_is_known_of_an_ins_stays(void)
{
  tse_config config = a_drive();
  config.velocity_lever_sd = config.velocity_scale_sd = setting(0);
  begin_with(&config, 1);
  s.lever_x = 0.6;
  (void)off_across(ins, 1000, 0);
  TEST_ASSERT_TRUE(f.k.ud.extras > 0);
  const int known[3] = { V_LEVER_X, V_LEVER_Y, V_SCALE };
  for (int i = 0; i < 3; i++) expect_near(0, number(f.k.x[known[i]]), 1e-5, "known", known[i]);
}

static void test_where_an_ins_sits_and_looks_is_found(void)
{
  tse_config config = a_drive();
  config.velocity_latency_sd = setting(0.05), config.velocity_lever_sd = setting(0.5);
  begin_with(&config, 1);
  const double without = off_across(0, 3000, 1000);
  begin_with(&config, 1);
  s.late = 0.04, s.lever_x = 0.6, s.turn = 0.02;
  const double with = off_across(ins, 3000, 1000);
  TEST_ASSERT_TRUE(without < 0.02 && with < 0.02); /* an exact model needs no velocity */
  expect_near(0.02, number(f.k.x[V_TURN]), 0.005, "heading offset", 0);
  expect_near(0.04, number(f.k.x[V_LATE]), 0.025, "latency", 0);
  expect_near(0.6, number(f.k.x[V_LEVER_X]), 0.25, "lever", 0);
  TEST_ASSERT_EQUAL_INT(0, velocity_fault(&f.k));
}

/* Ten values a second, 0.1 s late, with a course from any zero and with wraps. */
static void test_course_and_speed_show_the_speed_across(void)
{
  tse_config config = a_drive();
  config.velocity_latency = setting(0.1);
  begin_with(&config, 10);
  w.x[GY] = real(1.2);
  const double without = off_across(0, 4000, 1500);
  begin_with(&config, 10);
  w.x[GY] = real(1.2);
  s.late = 0.1;
  const double with = off_across(gnss, 4000, 1500);
  TEST_ASSERT_TRUE(with < 0.9 * without);
  TEST_ASSERT_EQUAL_INT(0, velocity_fault(&f.k));
  double off = number(f.k.x[PSI]) - s.heading - s.zero;
  off -= 6.283185307179586 * floor(off / 6.283185307179586 + 0.5);
  expect_near(0, off, 0.01, "heading", 0);
}

/* 0.2 s late, without a set latency: the effect is small. */
static void test_a_velocity_that_is_late_and_nobody_says_so_does_little_harm(void)
{
  begin(10);
  const double without = off_across(0, 4000, 1500);
  begin(10);
  s.late = 0.2;
  const double with = off_across(gnss | ins, 4000, 1500);
  TEST_ASSERT_TRUE(with < 1.5 * without + 0.03);
}

/* A repeated value is a held value: a frozen channel has no effect except for the states
 * that it has started. */
static void test_a_frozen_velocity_is_none(void)
{
  begin(1);
  tse_input last = blank_row();
  for (int n = 0; n < 800; n++) {
    tse_input u = measured_row(ins | gnss), none = u;
    if (n > 400) {
      u.ins_vel_x = last.ins_vel_x, u.ins_vel_y = last.ins_vel_y, u.gnss_speed = last.gnss_speed;
      u.gnss_course = last.gnss_course;
      none.given = 0;
    } else last = u;
    (void)stepped(&w.p, &f, &u);
    (void)stepped(&w.p, &other, &none);
  }
  TEST_ASSERT_EQUAL_MEMORY(&f, &other, sizeof f);
}

/* The noise of a velocity that comes in every row has its variance once a row: the time
 * since the last value, over which the noise is averaged, starts over at every value. */
static void test_the_time_since_a_velocity_starts_over_at_every_value(void)
{
  for (int every = 1; every <= 4; every += 3) {
    double since = 0;
    begin(every);
    for (int n = 0; n < 40; n++) {
      const tse_input u = measured_row(ins);
      const int given = (u.given & TSE_GIVEN_ins_vel_x) != 0;
      (void)stepped(&w.p, &f, &u);
      since = given ? 0 : since + number(u.dt);
      if (n < 8) continue; /* the filter starts */
      expect_near(since, number(f.k.velocity.since[0]), BY_FORMAT(1e-9, 1e-6), "ins_vel_x", n);
      expect_near(since, number(f.k.velocity.since[1]), BY_FORMAT(1e-9, 1e-6), "ins_vel_y", n);
    }
  }
}

static void test_an_outlier_pulls_no_further_than_three_sd(void)
{
  begin(1);
  for (int n = 0; n < 800; n++) {
    const tse_input u = measured_row(ins | gnss);
    (void)stepped(&w.p, &f, &u);
  }
  tse_input u = measured_row(ins | gnss), bad = u;
  other = f;
  bad.ins_vel_y = real(20);
  bad.gnss_course = real(number(u.gnss_course) > 0 ? -1.2 : 1.2);
  const tse_output plain = stepped(&w.p, &f, &u), pulled = stepped(&w.p, &other, &bad);
  TEST_ASSERT_TRUE(fabs(number(pulled.vel_y) - number(plain.vel_y)) < 6 * number(plain.vel_y_sd));
  for (int a = 1; a < 3; a++)
    TEST_ASSERT_TRUE(
        fabs(number(pulled.stiffness[a]) - number(plain.stiffness[a])) < 2 * number(plain.stiffness_sd[a]));
}

/* A velocity that does not fit is left out, named, and used again when it fits. The
 * estimate stays valid. */
static void test_a_jump_is_left_out_and_named_until_it_fits(void)
{
  int named = 0, restored = 0;
  double most = 0;
  begin(1);
  for (int n = 0; n < 3000; n++) {
    tse_input u = measured_row(ins);
    const int wrong = n >= 1500 && n < 2000;
    if (wrong) u.ins_vel_y = real(number(u.ins_vel_y) + 3);
    const tse_output y = stepped(&w.p, &f, &u);
    named += wrong && y.fault_channel == 1 + TSE_CHANNELS + TSE_OPTIONAL_ins_vel_y;
    restored += n > 2600 && y.fault_channel == 0;
    if (n > 1000) most = fmax(most, fabs(number(y.vel_y) - number(w.x[VY])));
  }
  TEST_ASSERT_TRUE(named > 350);
  TEST_ASSERT_EQUAL_INT(399, restored);
  TEST_ASSERT_TRUE(most < 1);
}

/* A receiver restarts with another zero of the course: the heading follows. */
static void test_a_course_with_another_zero_is_found_again(void)
{
  int used = 0;
  begin(10);
  for (int n = 0; n < 4500; n++) {
    if (n == 1500) s.zero -= 1.3;
    const tse_input u = measured_row(gnss);
    const tse_output y = stepped(&w.p, &f, &u);
    used += n > 3500 && y.fault_channel == 0;
    TEST_ASSERT_TRUE(fabs(number(y.vel_y) - number(w.x[VY])) < 1);
  }
  TEST_ASSERT_EQUAL_INT(999, used);
}

/* Standstill and gaps restart the motion. The heading is found again. Velocities may
 * start and stop. */
static void test_velocities_come_and_go_and_gaps_are_survived(void)
{
  begin(10);
  tse_output y;
  for (int n = 0; n < 4000; n++) {
    tse_input u = measured_row(n % 900 < 500 ? gnss : n % 700 < 300 ? ins : 0);
    if (n == 2000) u.dt = TSE_R(3);
    if (n % 50 == 7) u.missing = TSE_MISSING_yaw_rate;
    if (n % 50 == 9) u.missing = TSE_MISSING_steer_angle;
    y = stepped(&w.p, &f, &u);
    if (n == 1999) TEST_ASSERT_TRUE(f.k.velocity.kept > 0 && f.k.velocity.has_gyro);
    if (n == 2000)
      TEST_ASSERT_TRUE(f.k.velocity.kept == 0 && !f.k.velocity.has_gyro
          && !f.k.velocity.has_heading); /* of the motion before the gap */
  }
  TEST_ASSERT_TRUE(fabs(number(y.vel_y) - number(w.x[VY])) < 0.5);
  TEST_ASSERT_EQUAL_INT(0, y.fault_channel);
}

/* Late channels make rows wait. A velocity does not wait, and its latency is reduced
 * accordingly. */
static void test_a_velocity_beside_channels_that_are_late(void)
{
  tse_config config = a_drive();
  config.velocity_latency = setting(0.1);
  begin_with(&config, 1);
  s.late = 0.1;
  tse_config waits = config;
  waits.steer_angle_latency = setting(0.05);
  const tse_params p = prepared(waits);
  expect_near(0.05, number(p.velocity_late), 1e-6, "late behind the row that is stepped to", 0);
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_reset(&p, &f, sizeof f));
  double steer[8] = { 0 }, sum = 0, truth_then[8] = { 0 };
  for (int n = 0; n < 3000; n++) {
    tse_input u = measured_row(ins);
    steer[n % 8] = number(u.steer_angle);
    truth_then[n % 8] = number(w.x[VY]);
    u.steer_angle = real(steer[(n + 3) % 8]); /* five rows ago */
    const tse_output y = stepped(&p, &f, &u);
    if (n > 1500) sum += pow(number(y.vel_y) - truth_then[(n + 3) % 8], 2);
  }
  TEST_ASSERT_TRUE(sqrt(sum / 1499) < 0.05);
  expect_near(0, number(f.k.x[V_LATE]), 0.02, "nothing left of the latency", 0);
}

/* A flipped bit in memory, in the states of velocities or beside them: learning starts
 * over. */
static void test_a_state_of_velocities_that_is_no_number_is_started_over(void)
{
  for (int k = 0; k < 4; k++) {
    tse_kalman *const kalman = &f.k;
    begin(1);
    for (int n = 0; n < 200; n++) {
      const tse_input u = measured_row(ins);
      (void)stepped(&w.p, &f, &u);
    }
    TEST_ASSERT_TRUE(kalman->ud.extras > 0);
    *(k == 0         ? &kalman->x[V_LEVER_Y]
            : k == 1 ? &kalman->ud.e[2]
            : k == 2 ? &kalman->ud.e[0]
                     : &kalman->x[LCF]) = k == 2 ? TSE_R(-1) : broken();
    const tse_input u = measured_row(0);
    TEST_ASSERT_EQUAL_INT(TSE_W_RECOVERED, stepped(&w.p, &f, &u).status);
    TEST_ASSERT_EQUAL_INT(0, kalman->ud.extras);
  }
}

/* Any values in their ranges: finite estimates, an accepted state, and the car's own
 * velocity again before long. */
static void test_no_velocity_whatever_breaks_the_filter(void)
{
  begin(1);
  tse_output y;
  for (int n = 0; n < 4000; n++) {
    tse_input u = measured_row(ins | gnss);
    if (n < 2000) {
      u.given = next_word(&seed) & 15u;
      u.ins_vel_x = real(next_between(&seed, -120, 120));
      u.ins_vel_y = real(next_between(&seed, -60, 60));
      u.gnss_speed = real(next_between(&seed, 0, 120));
      u.gnss_course = real(next_between(&seed, -7, 7));
    }
    y = stepped(&w.p, &f, &u);
  }
  TEST_ASSERT_TRUE(
      fabs(number(y.vel_y) - number(w.x[VY])) < 1 && fabs(number(y.vel_x) - number(w.x[VX])) < 2);
}

static void test_forms_with_particles_refuse_a_velocity_as_one_without_effect(void)
{
  static tse_filter_paper paper;
  tse_config config = config_by(tse_config_paper);
  tse_input u = blank_row();
  config.particles = 60;
  const tse_params p = prepared(config);
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_reset(&p, &paper.filter, sizeof paper));
  u.dt = real(0.01), u.wheel_speed_front = u.wheel_speed_rear = real(60);
  TEST_ASSERT_TRUE(tse_step(&p, &paper.filter, &u, NULL) >= 0);
  u.given = TSE_GIVEN_ins_vel_x;
  TEST_ASSERT_EQUAL_INT(TSE_E_INPUT, tse_step(&p, &paper.filter, &u, NULL));
}
