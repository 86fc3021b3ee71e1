/* tests/unit/test_consistency.c <-> src/consistency.c: is a sample as likely as it should be, and what follows.
 *
 * Innovations are drawn here and handed over in a forecast made by hand, so that what the filter should find is known in
 * closed form. Intervals are of 4.5 standard errors, over independent runs. */
#include "unit_support.h"

enum { PARTICLES = 19 };
#define DT 0.01

static tse_filter f, before;
static uint32_t words;

static tse_config settings(void)
{
  tse_config c;
  tse_config_default(&c);
  c.particles = PARTICLES;
  c.outlier_gate = 4; /* binary fractions where a formula is checked */
  c.contradiction = 5;
  c.noise_max = 30;
  c.spread_max = (tse_setting)0.25;
  return c;
}

static double spread_lam(int k) { return k == 0 || k == 3 || k == 5 ? 0.01 + 0.001 * k : 0.0005 * k; }

/* A filter in the middle of a drive: particles differ, so do the levels. */
static void start(const tse_params *p, uint32_t seed)
{
  memset(&f, 0, sizeof f);
  words = seed * 7919u + 1u;
  gaussian_start(p, &f);
  consistency_start(&f);
  f.nu = TSE_R(20);
  for (int32_t i = 0; i < padded(PARTICLES); i++) {
    f.weight[i] = real(i < PARTICLES ? 0.5 + 0.02 * i : 0.0);
    for (int a = 0; a < 3; a++) {
      f.p.mu[a][i] = real(0.1 * a + 0.001 * (i % 5));
      f.p.bias[a][i] = real(0.2 - 0.1 * a + 0.002 * (i % 3));
    }
    for (int k = 0; k < 6; k++) f.p.lam[k][i] = real(spread_lam(k) * (1.0 + 0.01 * (i % 4)));
  }
}

static double normal(void)
{
  const double u = next_uniform(&words), v = next_uniform(&words);
  return sqrt(-2.0 * log(u)) * cos(6.283185307179586 * v);
}

static sample row(int mask)
{
  sample y;
  memset(&y, 0, sizeof y);
  y.dt = real(DT);
  y.has_inputs = 1;
  for (int a = 0; a < 3; a++) {
    y.use[a] = mask >> a & 1 ? TSE_R(1) : TSE_R(0);
    y.y[a] = y.use[a];
    y.used += mask >> a & 1;
  }
  return y;
}

/* d: forces in the accelerometers per unit of stiffness [sigma]; of them the spread's share of the variance. */
static forecast forecast_of(const double z[3], double force, double spread, double hph)
{
  forecast c;
  memset(&c, 0, sizeof c);
  c.o.d11 = real(force);
  c.o.d22 = real(force);
  c.o.d23 = real(0.5 * force);
  for (int a = 0; a < 3; a++) {
    c.z[a] = real(z[a]);
    c.hph[a][a] = real(hph);
    c.level[a] = TSE_R(1);
    if (a == 0) c.spread[a][a] = real(spread * spread * force * force);
    if (a == 1) c.spread[a][a] = real(spread * spread * 1.25 * force * force);
  }
  return c;
}

/* One sample as tse_step() has it.   Returned: consistency()'s. */
static int step(const tse_params *p, const double z[3], double force, double spread, double hph, tse_real noise[3])
{
  sample y = row(7);
  const forecast c = forecast_of(z, force, spread, hph);
  const int changed = consistency(p, &f, &y, &c, noise);
  f.seen = r_min(f.seen + TSE_R(1), r_mul(TSE_R(5), p->memory));
  return changed;
}

static void run_quiet(const tse_params *p, int rows)
{
  static const double none[3] = { 0.0, 0.0, 0.0 };
  tse_real noise[3];
  for (int i = 0; i < rows; i++) TEST_ASSERT_FALSE(step(p, none, 0.0, 0.0, 0.0, noise));
}

/* White innovations of as many sigma as `noise`, and what spread and the filter's own doubt add. */
static void draw(double noise, double force, double spread, double hph, double z[3])
{
  const double forces[3] = { force * force, 1.25 * force * force, 0.0 };
  for (int a = 0; a < 3; a++) z[a] = sqrt(noise * noise + spread * spread * forces[a] + hph) * normal();
}

/* ----------------------------------------------------------------------------------------- outliers */

/* Beyond the gate the noise is what brings the sample back to it: z^2 = gate^2 (S - white + noise). */
static void test_an_outlier_gets_the_noise_that_brings_it_back_to_the_gate(void)
{
  static const double sigmas[] = { 0.0, 1.0, -3.0, 3.9, -3.999, 4.001, -5.0, 10.0, -100.0, 3000.0 };
  tse_config c = settings();
  for (int gated = 0; gated < 2; gated++) {
    c.outlier_gate = gated ? 4 : 0;
    const tse_params p = prepared(&c);
    for (int k = 0; k < ROWS(sigmas); k++)
      for (int a = 0; a < 3; a++) {
        const double hph = 0.5, force = 4.0, spread = 0.1;
        const double own[3] = { 0.16, 0.2, 0.0 }, s = 1.0 + hph + own[a];
        double z[3] = { 0.0, 0.0, 0.0 };
        tse_real noise[3];
        start(&p, 1);
        z[a] = sigmas[k] * sqrt(s);
        (void)step(&p, z, force, spread, hph, noise);
        for (int b = 0; b < 3; b++)
          if (b != a || !gated || fabs(sigmas[k]) < 4.0) expect_near(1.0, number(noise[b]), 0.0, "noise", 10 * k + b);
          else {
            const double back = z[a] * z[a] / (hph + own[a] + number(noise[a]));
            expect_near(16.0, back, BY_FORMAT(1e-12, 1e-4), "z^2/S with that noise", 10 * k + a);
          }
      }
  }
}

static void test_a_missing_channel_has_no_noise_no_statistics_and_no_contradiction(void)
{
  const tse_config c = settings();
  const tse_params p = prepared(&c);
  static const double z[3] = { 50.0, 50.0, 50.0 };
  start(&p, 1);
  run_quiet(&p, 200);
  before = f;
  for (int i = 0; i < 100; i++) {
    sample y = row(0);
    tse_real noise[3];
    const forecast fc = forecast_of(z, 1.0, 0.1, 0.0);
    TEST_ASSERT_FALSE(consistency(&p, &f, &y, &fc, noise));
    for (int a = 0; a < 3; a++) expect_near(1.0, number(noise[a]), 0.0, "noise", a);
  }
  TEST_ASSERT_EQUAL_MEMORY(before.noise, f.noise, sizeof f.noise);
  TEST_ASSERT_EQUAL_MEMORY(before.smooth, f.smooth, sizeof f.smooth);
  TEST_ASSERT_EQUAL_MEMORY(before.colour, f.colour, sizeof f.colour);
  TEST_ASSERT_EQUAL_MEMORY(before.misfit, f.misfit, sizeof f.misfit);
  TEST_ASSERT_EQUAL_MEMORY(before.shows, f.shows, sizeof f.shows);
  TEST_ASSERT_FALSE(is_trying(&f));
}

static void test_a_stuck_channel_counts_as_missing_once_it_is_off_by_a_sigma(void)
{
  const tse_config c = settings();
  const tse_params p = prepared(&c);
  for (int a = 0; a < 3; a++)
    for (int k = 0; k < 3; k++) { /* off by less than a sigma, by more, by more and not stuck */
      double z[3] = { 0.0, 0.0, 0.0 };
      sample y = row(7);
      tse_real noise[3];
      start(&p, 1);
      z[a] = k == 0 ? 1.2 : 1.3; /* S = 1.5625 = 1.25^2 */
      f.stuck[a] = k < 2;
      const forecast fc = forecast_of(z, 0.0, 0.0, 0.5625);
      TEST_ASSERT_EQUAL_INT(k == 1, consistency(&p, &f, &y, &fc, noise));
      TEST_ASSERT_EQUAL_INT(k == 1 ? 2 : 3, y.used);
      for (int b = 0; b < 3; b++) {
        const double is = b == a && k == 1 ? 0.0 : 1.0;
        expect_near(is, number(y.use[b]), 0.0, "use", b);
        expect_near(is, number(y.y[b]), 0.0, "y", b);
      }
    }
}

/* -------------------------------------------------------------------------------------------- noise */

enum { SEEDS = 40 };

/* The running mean of z^2 reaches back 5.1 s: one value has the relative sd sqrt(2/(2 510 - 1)), a mean over SEEDS runs that
 * over sqrt(SEEDS). z^2 counts up to 20.25 S: of white noise that takes 1e-4 away. */
static void expect_noise_found(double sd, double force, double spread, double hph, int rows)
{
  const tse_config c = settings();
  const tse_params p = prepared(&c);
  double mean[3] = { 0 };
  const double forces[3] = { force * force, 1.25 * force * force, 0.0 };
  for (uint32_t seed = 0; seed < SEEDS; seed++) {
    start(&p, seed);
    run_quiet(&p, 100);
    for (int i = 0; i < rows; i++) {
      double z[3];
      tse_real noise[3];
      draw(sd, force, spread, hph, z);
      (void)step(&p, z, force, spread, hph, noise);
    }
    for (int a = 0; a < 3; a++) mean[a] += number(f.noise[a]) / SEEDS;
    TEST_ASSERT_FALSE(is_trying(&f)); /* white noise is no contradiction once it is known */
  }
  for (int a = 0; a < 3; a++) {
    const double all = sd * sd + spread * spread * forces[a] + hph;
    /* what the spread is above 5 % counts as noise: the two are not told apart */
    const double expected = sd * sd + (spread * spread - 0.0025) * forces[a];
    expect_near(expected, mean[a], 4.5 * all * sqrt(2.0 / 1019.0 / SEEDS) + 3e-4 * all, "variance found", a);
  }
}

static void test_white_noise_above_what_was_told_is_found(void)
{
  expect_noise_found(3.0, 0.0, 0.0, 0.0, 2500);
  expect_noise_found(3.0, 2.0, 0.05, 0.3, 2500);
  expect_noise_found(2.0, 1.0, 0.10, 0.1, 2500);
  expect_noise_found(10.0, 4.0, 0.05, 1.0, 2500);
}

/* Sensors noisier than told from the start: spread and trust were learnt from noise. */
static void test_noise_from_the_start_is_found_within_a_second_and_undoes_what_was_learnt_from_it(void)
{
  const tse_config c = settings();
  const tse_params p = prepared(&c);
  start(&p, 5);
  for (int a = 0; a < TSE_GAUSS; a++) f.cov[a][a] = f.err[a][a] = TSE_R(1e-4);
  f.level[0] = TSE_R(0.5);
  f.level[1] = TSE_R(1);
  f.level[2] = TSE_R(2);
  int found = -1;
  for (int i = 0; i < 100 && found < 0; i++) {
    double z[3];
    tse_real noise[3];
    draw(3.0, 0.0, 0.0, 0.0, z);
    if (step(&p, z, 0.0, 0.0, 0.0, noise)) found = i;
  }
  TEST_ASSERT_TRUE(found >= 18); /* twenty samples: fewer do not decide */
  TEST_ASSERT_FALSE(is_trying(&f));
  static const int axis[6] = { 0, -1, -1, 1, -1, 2 };
  for (int a = 0; a < 3; a++) {
    expect_near(number(p.mean_var0), number(f.cov[3 + a][3 + a]), BY_FORMAT(1e-15, 1e-8), "variance of a mean", a);
    expect_near(number(p.mean_var0), number(f.err[3 + a][3 + a]), BY_FORMAT(1e-15, 1e-8), "of its error", a);
    if (f.noise[a] > TSE_R(1)) expect_near(1.0, number(f.misfit[a]), 0.5, "misfit starts anew", a);
    expect_near(number(p.bias_var0[a]), number(f.cov[6 + a][6 + a]), BY_FORMAT(1e-15, 1e-8), "of a bias", a);
  }
  static const double of_level[3] = { 0.5, 1.0, 2.0 };
  for (int k = 0; k < 6; k++)
    for (int i = 0; i < PARTICLES; i++) {
      const double l = axis[k] < 0 ? 0.0 : of_level[axis[k]];
      expect_near(0.0025 * l * l * 16.0 / 20.0, number(f.p.lam[k][i]), BY_FORMAT(1e-15, 1e-8), "Lambda/nu: a spread of 5 %", k);
    }
}

/* The limit of the setting, and what is less than a fifth above it is none. */
static void test_noise_ends_at_its_limit_and_at_the_settings(void)
{
  tse_config c = settings();
  c.noise_max = 2;
  const tse_params p = prepared(&c);
  start(&p, 3);
  run_quiet(&p, 100);
  for (int i = 0; i < 2000; i++) {
    double z[3];
    tse_real noise[3];
    draw(5.0, 0.0, 0.0, 0.0, z);
    (void)step(&p, z, 0.0, 0.0, 0.0, noise);
    for (int a = 0; a < 3; a++) TEST_ASSERT_TRUE(number(f.noise[a]) >= 1.0 && number(f.noise[a]) <= 4.0);
  }
  for (int a = 0; a < 3; a++) expect_near(4.0, number(f.noise[a]), 0.0, "noise at its limit", a);
  f.stance = 0;
  f.contradicted = TSE_R(0);
  for (int i = 0; i < 4000; i++) { /* the sensor recovers, nearly: the settings are right again, exactly */
    const double off = (i % 2 ? 1.0 : -1.0) * sqrt(1.15);
    const double z[3] = { off, off, off };
    tse_real noise[3];
    (void)step(&p, z, 0.0, 0.0, 0.0, noise);
  }
  for (int a = 0; a < 3; a++) expect_near(1.0, number(f.noise[a]), 0.0, "noise of the settings", a);
}

/* A spread of 20 % where 5 % have been learnt may be that of the tyre: up to spread_max, 25 % here, it is no noise. */
static void test_what_the_widest_spread_explains_is_no_noise(void)
{
  tse_config c = settings();
  c.contradiction = 0;
  const tse_params p = prepared(&c);
  for (uint32_t seed = 0; seed < 10; seed++) {
    start(&p, seed);
    for (int i = 0; i < 2000; i++) {
      double z[3];
      tse_real noise[3];
      draw(1.0, 8.0, 0.2, 0.0, z);
      (void)step(&p, z, 8.0, 0.05, 0.0, noise);
      for (int a = 0; a < 3; a++) expect_near(1.0, number(f.noise[a]), 0.0, "noise found", a);
    }
  }
}

/* Where the sensors are as told and the spread as learnt, hardly ever is anything found or contradicted. Of 4000 drives of 20 s
 * 7 had a try, 5 noise, 18 a colour that counts: expected here 0.4, 0.3, 0.9. */
static void test_at_nominal_the_settings_are_believed(void)
{
  const tse_config c = settings();
  const tse_params p = prepared(&c);
  static const double force[4] = { 0.0, 3.0, 0.0, 8.0 }, spread[4] = { 0.0, 0.1, 0.0, 0.2 }, hph[4] = { 0.0, 0.2, 2.0, 0.0 };
  int tries = 0, noisy = 0, slow = 0;
  for (uint32_t seed = 0; seed < 200; seed++) {
    const int k = (int)(seed % 4u);
    int tried = 0, found = 0, coloured = 0;
    start(&p, seed);
    for (int i = 0; i < 2000; i++) {
      double z[3];
      tse_real noise[3];
      draw(1.0, force[k], spread[k], hph[k], z);
      (void)step(&p, z, force[k], spread[k], hph[k], noise);
      tried = tried || is_trying(&f);
      for (int a = 0; a < 3; a++) {
        found = found || f.noise[a] > TSE_R(1);
        coloured = coloured || slow_factor(&f, a) > TSE_R(1);
      }
    }
    tries += tried;
    noisy += found;
    slow += coloured;
  }
  TEST_ASSERT_TRUE(tries <= 3 && noisy <= 3 && slow <= 5);
}

/* ------------------------------------------------------------------------------------------- colour */

/* E min(ratio chi^2, most) with one degree of freedom. */
static double clipped(double ratio, double most)
{
  const double t = sqrt(most / ratio), tail = 1.0 - erf(t / sqrt(2.0)), density = exp(-0.5 * t * t) / sqrt(6.283185307179586);
  return ratio * (1.0 - tail - 2.0 * t * density) + most * tail;
}

/* z = rho z + ..., of one sigma: smoothed by gain g its variance is (1 + rho (1 - g))/(1 - rho (1 - g)) that of white noise. */
static void test_the_colour_of_an_autoregressive_disturbance_is_its_ratio_of_smoothed_variances(void)
{
  static const double rho[] = { 0.0, 0.3, 0.6, 0.9, -0.5 };
  const double g = DT / (DT + 0.15);
  tse_config c = settings();
  c.contradiction = 0;
  c.outlier_gate = 0;
  const tse_params p = prepared(&c);
  for (int k = 0; k < ROWS(rho); k++) {
    const double ratio = (1.0 + rho[k] * (1.0 - g)) / (1.0 - rho[k] * (1.0 - g)), expected = clipped(ratio, 25.0);
    double sum = 0.0, squares = 0.0;
    for (uint32_t seed = 0; seed < SEEDS; seed++) {
      double z[3] = { normal(), normal(), normal() };
      start(&p, seed);
      for (int i = 0; i < 4000; i++) {
        tse_real noise[3];
        for (int a = 0; a < 3; a++) z[a] = rho[k] * z[a] + sqrt(1.0 - rho[k] * rho[k]) * normal();
        (void)step(&p, z, 0.0, 0.0, 0.0, noise);
        if (i == 3999) /* noise is told more, by the colour */
          for (int a = 0; a < 3; a++)
            expect_near(number(f.noise[a]) * number(slow_factor(&f, a)), number(noise[a]), 0.02 * number(noise[a]), "noise", a);
      }
      for (int a = 0; a < 3; a++) {
        const double colour = number(f.colour[a]);
        expect_near(fmax(1.0, colour - 1.0), number(slow_factor(&f, a)), BY_FORMAT(1e-15, 1e-6), "slow factor", a);
        sum += colour / (3 * SEEDS);
        squares += colour * colour / (3 * SEEDS);
      }
    }
    const double se = sqrt((squares - sum * sum) / (3 * SEEDS - 1));
    expect_near(expected, sum, 4.5 * se, "colour", k);
    TEST_ASSERT_TRUE(se < 0.06 * expected);
  }
}

/* ------------------------------------------------------------------------------------ contradiction */

/* A step of k sigma in one channel. Smoothed it is k (1 - (1 - g)^n), which counts as contradicting beyond 5 of its own sd,
 * sqrt(g/(2 - g)); while it grows the colour grows a little, so it may take a few samples more. */
static int samples_until_try(const tse_params *p, int channel, double k, int most)
{
  for (int i = 1; i <= most; i++) {
    double z[3] = { 0.0, 0.0, 0.0 };
    tse_real noise[3];
    z[channel] = k;
    before = f;
    (void)step(p, z, 0.0, 0.0, 0.0, noise);
    if (is_trying(&f)) return i;
  }
  return 0;
}

static void test_a_step_contradicts_when_its_smoothed_value_is_five_of_its_sds(void)
{
  static const double k[] = { 1.5, 2.0, 2.9 };
  const double g = DT / (DT + 0.15), share = g / (2.0 - g);
  const tse_config c = settings();
  const tse_params p = prepared(&c);
  for (int i = 0; i < ROWS(k); i++)
    for (int a = 0; a < 3; a++) {
      const double first = log(1.0 - 5.0 * sqrt(share) / k[i]) / log(1.0 - g);
      start(&p, 1);
      for (int j = 0; j < 1200; j++) {
        double z[3];
        tse_real noise[3];
        draw(1.0, 0.0, 0.0, 0.0, z);
        (void)step(&p, z, 0.0, 0.0, 0.0, noise);
      }
      for (int b = 0; b < 3; b++) { /* no head start, and colour and misfit of noise as told */
        f.smooth[b] = TSE_R(0);
        f.colour[b] = f.misfit[b] = TSE_R(1);
      }
      const int n = samples_until_try(&p, a, k[i], 200);
      TEST_ASSERT_TRUE(n >= (int)ceil(first));
      TEST_ASSERT_TRUE(n <= (int)ceil(1.5 * first) + 1);
    }
  start(&p, 1); /* less than five of its sds never does */
  run_quiet(&p, 300);
  TEST_ASSERT_EQUAL_INT(0, samples_until_try(&p, 1, 0.85, 3000));
}

/* Smoothing takes noise and spread off, but not what the mean itself may be off: with H P H' = 1/2 two sigma are nothing. */
static void test_the_doubt_about_the_mean_is_not_smoothed_away(void)
{
  static const double z[3] = { 0.0, 2.0, 0.0 };
  const tse_config c = settings();
  const tse_params p = prepared(&c);
  for (int doubted = 0; doubted < 2; doubted++) {
    tse_real noise[3];
    int tried = 0;
    start(&p, 1);
    run_quiet(&p, 300);
    for (int i = 0; i < 300; i++) {
      (void)step(&p, z, 0.0, 0.0, doubted ? 0.5 : 0.0, noise);
      tried = tried || is_trying(&f);
    }
    TEST_ASSERT_EQUAL_INT(!doubted, tried);
  }
}

/* What the wheel speeds' noise does to accel_x is noise of that channel: told, expected, and no outlier. */
static void test_noise_of_the_wheels_counts_as_noise_of_accel_x_only(void)
{
  const tse_config c = settings();
  const tse_params p = prepared(&c);
  const double z[3] = { 7.0, 1.0, 1.0 };
  const sample every = row(7);
  for (int told = 0; told < 2; told++) {
    sample y = every;
    tse_real noise[3];
    start(&p, 1);
    forecast fc = forecast_of(z, 0.0, 0.0, 0.0);
    fc.input_var = real(told ? 3.0 : 0.0);
    (void)consistency(&p, &f, &y, &fc, noise);
    expect_near(told ? 4.0 : 49.0 / 16.0, number(noise[0]), BY_FORMAT(1e-14, 1e-6), "noise of accel_x", told);
    for (int a = 1; a < 3; a++) expect_near(1.0, number(noise[a]), 0.0, "noise", a);
  }
  start(&p, 2); /* and none is found that was told */
  for (int i = 0; i < 2000; i++) {
    double drawn[3];
    sample y = every;
    tse_real noise[3];
    draw(1.0, 0.0, 0.0, 0.0, drawn);
    drawn[0] *= 2.0;
    forecast fc = forecast_of(drawn, 0.0, 0.0, 0.0);
    fc.input_var = TSE_R(3);
    (void)consistency(&p, &f, &y, &fc, noise);
    f.seen = f.seen + TSE_R(1);
    expect_near(1.0, number(f.noise[0]), 0.0, "noise found", i);
  }
}

/* Twice as much where the innovations are known to be coloured. */
static void test_a_contradiction_is_judged_by_the_colour_and_the_misfit_of_what_was_before(void)
{
  const tse_config c = settings();
  const tse_params p = prepared(&c);
  int plain = 0;
  for (int k = 0; k < 3; k++) {
    start(&p, 1);
    run_quiet(&p, 1200);
    for (int b = 0; b < 3; b++) f.colour[b] = f.misfit[b] = TSE_R(1);
    if (k == 1) f.colour[1] = TSE_R(1.5);
    if (k == 2) f.misfit[1] = TSE_R(1.5);
    const int n = samples_until_try(&p, 1, 2.0, 200);
    TEST_ASSERT_TRUE(n > 0);
    if (k == 0) plain = n;
    else TEST_ASSERT_TRUE(n >= plain + 2);
  }
}

static void test_a_lone_outlier_does_not_contradict(void)
{
  const tse_config c = settings();
  const tse_params p = prepared(&c);
  start(&p, 1);
  run_quiet(&p, 300);
  for (int i = 0; i < 20; i++) {
    static const double z[3] = { 1000.0, -1000.0, 1000.0 };
    tse_real noise[3];
    TEST_ASSERT_FALSE(step(&p, z, 0.0, 0.0, 0.0, noise));
    run_quiet(&p, 50);
  }
}

/* The means may be another road's: 40 % together, 10 % each, of their level. And where the car is, is as at the start. */
static void test_a_contradiction_opens_the_covariances_by_what_another_road_would_change(void)
{
  static const double level[3] = { 0.5, 1.0, 2.0 };
  const tse_config c = settings();
  const tse_params p = prepared(&c);
  start(&p, 1);
  for (int a = 0; a < TSE_GAUSS; a++)
    for (int b = 0; b < TSE_GAUSS; b++) {
      f.cov[a][b] = real(a == b ? 0.01 * (a + 1) : 1e-4 * (a + b));
      f.err[a][b] = real(a == b ? 0.005 * (a + 1) : 1e-5 * (a + b));
    }
  for (int a = 0; a < 3; a++) f.level[a] = real(level[a]);
  run_quiet(&p, 300);
  TEST_ASSERT_TRUE(samples_until_try(&p, 0, 3.0, 100) > 0);
  for (int a = 0; a < TSE_ERROR; a++)
    for (int b = 0; b < TSE_ERROR; b++) {
      double more = 0.0;
      if (a / 3 == 1 && b / 3 == 1) more = level[a - 3] * level[b - 3] * (a == b ? 0.17 : 0.16);
      if (a < 3 && a == b) more = number(p.x_sd0[a]) * number(p.x_sd0[a]);
      expect_near(number(before.err[a][b]) + more, number(f.err[a][b]), BY_FORMAT(1e-15, 1e-7), "E", 20 * a + b);
      if (a < TSE_GAUSS && b < TSE_GAUSS)
        expect_near(number(before.cov[a][b]) + more, number(f.cov[a][b]), BY_FORMAT(1e-15, 1e-7), "P", 20 * a + b);
    }
  for (int a = 0; a < 3; a++) expect_near(number(f.cov[3 + a][3 + a]), number(f.mean_var[a]), 0.0, "mean_var", a);
  TEST_ASSERT_EQUAL_MEMORY(&before.p, &f.p, sizeof f.p); /* the particles are where they were */
}

static void test_nothing_contradicts_before_a_memory_is_full_or_before_anything_was_saved(void)
{
  static const double z[3] = { 3.0, 3.0, 3.0 };
  tse_config c = settings();
  tse_params p = prepared(&c);
  tse_real noise[3];
  start(&p, 1);
  for (int i = 0; i < 100; i++) {
    (void)step(&p, z, 0.0, 0.0, 0.0, noise);
    TEST_ASSERT_FALSE(is_trying(&f));
  }
  c.forgetting = (tse_setting)0.9; /* a memory of ten samples is full before half a second is over */
  p = prepared(&c);
  start(&p, 1);
  for (int i = 0; i < 40; i++) {
    (void)step(&p, z, 0.0, 0.0, 0.0, noise);
    TEST_ASSERT_FALSE(is_trying(&f));
  }
}

/* ------------------------------------------------------------------------------- trying, recalling, holding */

/* The weighted mean, in another order of summation than the library's. */
static double mean_of(const tse_real *row_of)
{
  double sum = 0.0, total = 0.0;
  for (int i = PARTICLES - 1; i >= 0; i--) {
    sum += number(f.weight[i]) * number(row_of[i]);
    total += number(f.weight[i]);
  }
  return sum / total;
}

static double at_time(int i) { return 1.0 + i / 1024.0; } /* what is believed, and so what is saved, changes with every sample */

static void believe(int i)
{
  for (int a = 0; a < 3; a++)
    for (int j = 0; j < PARTICLES; j++) {
      f.p.mu[a][j] = real(0.1 * at_time(i) + 0.05 * a + 0.001 * (j % 5));
      f.p.bias[a][j] = real(0.3 * at_time(i) - 0.05 * a + 0.002 * (j % 3));
    }
  for (int k = 0; k < 6; k++)
    for (int j = 0; j < PARTICLES; j++) f.p.lam[k][j] = real(spread_lam(k) * at_time(i) * (1.0 + 0.01 * (j % 4)));
  for (int a = 0; a < TSE_GAUSS; a++)
    for (int b = 0; b < TSE_GAUSS; b++) {
      f.cov[a][b] = real(at_time(i) * (a == b ? 0.01 * (a + 1) : 1e-4 * (a + b)));
      f.err[a][b] = real(at_time(i) * (a == b ? 0.005 * (a + 1) : 1e-5 * (a + b)));
    }
}

static void ruin(void)
{
  for (int a = 0; a < 3; a++)
    for (int j = 0; j < padded(PARTICLES); j++) {
      f.p.mu[a][j] = r_mul(TSE_R(0.5), f.p.mu[a][j]) - TSE_R(0.4);
      f.p.bias[a][j] = f.p.bias[a][j] + TSE_R(5);
    }
  for (int k = 0; k < 6; k++)
    for (int j = 0; j < padded(PARTICLES); j++) f.p.lam[k][j] = real(0.04 + 0.001 * j);
  for (int a = 0; a < TSE_GAUSS; a++)
    for (int b = 0; b < TSE_GAUSS; b++) f.cov[a][b] = f.err[a][b] = real(a == b ? 1.0 : 0.25);
}

/* Means around a weighted mean of 1 or less, in sums over 19 of them. */
#define ROUNDING BY_FORMAT(1e-14, 2e-6)

static void test_a_try_that_explains_nothing_brings_back_what_was_believed_before(void)
{
  static const double z[3] = { 3.0, 3.0, 3.0 };
  const tse_config c = settings();
  const tse_params p = prepared(&c);
  for (int rows = 260; rows < 360; rows += 33) {
    tse_real noise[3];
    start(&p, 1);
    for (int i = 0; i < rows; i++) {
      believe(i);
      run_quiet(&p, 1);
    }
    const int began = rows + samples_until_try(&p, 0, 3.0, 100);
    int i = began;
    for (; f.stance == 1 && i < began + 400; i++) {
      ruin();
      if (step(&p, z, 0.0, 0.0, 0.0, noise)) break;
    }
    TEST_ASSERT_TRUE(i - began >= 148 && i - began <= 151); /* a try lasts 1.5 s */
    TEST_ASSERT_TRUE(is_holding(&f));
    /* what came back is half a second to a second older than the try, and all of one moment */
    const double then = number(f.cov[4][4]) / 0.05;
    const int moment = (int)floor((then - 1.0) * 1024.0 + 0.5);
    TEST_ASSERT_TRUE(moment <= rows - 50 && moment >= rows - 101);
    believe(moment);
    before = f;
    double mean[6], lam[6];
    for (int a = 0; a < 3; a++) {
      mean[a] = mean_of(f.p.mu[a]);
      mean[3 + a] = mean_of(f.p.bias[a]);
    }
    for (int k = 0; k < 6; k++) lam[k] = mean_of(f.p.lam[k]);
    /* once more, to look at what a recall leaves */
    f.stance = 1;
    ruin();
    f.stance_for = TSE_R(2);
    TEST_ASSERT_TRUE(step(&p, z, 0.0, 0.0, 0.0, noise));
    for (int a = 0; a < 3; a++) {
      expect_near(mean[a], mean_of(f.p.mu[a]), ROUNDING, "mean stiffness", a);
      expect_near(mean[3 + a], mean_of(f.p.bias[a]), 20.0 * ROUNDING, "bias", a);
      expect_near(1.0 + mean[a], number(f.level[a]), ROUNDING, "level", a);
      expect_near(number(f.cov[3 + a][3 + a]), number(f.mean_var[a]), 0.0, "mean_var", a);
    }
    for (int k = 0; k < 6; k++)
      for (int j = 0; j < PARTICLES; j++) expect_near(lam[k], number(f.p.lam[k][j]), ROUNDING, "Lambda/nu", k);
    for (int a = 0; a < TSE_GAUSS; a++)
      for (int b = 0; b < TSE_GAUSS; b++) {
        const int mine = a >= 3 && b >= 3, cross = (a >= 3) != (b >= 3); /* the states are another matter */
        if (mine) TEST_ASSERT_EQUAL_MEMORY(&before.cov[a][b], &f.cov[a][b], sizeof(tse_real));
        if (mine) TEST_ASSERT_EQUAL_MEMORY(&before.err[a][b], &f.err[a][b], sizeof(tse_real));
        if (cross) expect_near(0.0, number(f.cov[a][b]), 0.0, "states and means", 20 * a + b);
        if (cross) expect_near(0.0, number(f.err[a][b]), 0.0, "states and means, E", 20 * a + b);
      }
  }
}

static void fail_a_try(const tse_params *p)
{
  static const double z[3] = { 3.0, 3.0, 3.0 };
  tse_real noise[3];
  start(p, 1);
  run_quiet(p, 300);
  for (int i = 0; i < 400 && !is_holding(&f); i++) (void)step(p, z, 0.0, 0.0, 0.0, noise);
  TEST_ASSERT_TRUE(is_holding(&f));
}

static void test_a_try_that_explains_the_samples_is_learnt_from(void)
{
  const tse_config c = settings();
  const tse_params p = prepared(&c);
  start(&p, 1);
  run_quiet(&p, 300);
  TEST_ASSERT_TRUE(samples_until_try(&p, 1, 3.0, 100) > 0);
  before = f;
  int i = 0;
  for (; i < 200 && is_trying(&f); i++) run_quiet(&p, 1);
  TEST_ASSERT_TRUE(i >= 149 && i <= 152);
  TEST_ASSERT_EQUAL_MEMORY(before.cov, f.cov, sizeof f.cov); /* what the try made of it stays */
  TEST_ASSERT_EQUAL_MEMORY(&before.p, &f.p, sizeof f.p);
}

/* Smoothed innovations of three sigma in each channel fall below five of their sds together in 28 samples, the share of samples
 * that contradict then from one to 5 % in 31. A colour that has grown shortens the first. */
static void test_holding_ends_when_the_contradiction_does(void)
{
  const tse_config c = settings();
  const tse_params p = prepared(&c);
  fail_a_try(&p);
  before = f;
  int i = 0;
  for (; i < 100 && is_holding(&f); i++) run_quiet(&p, 1);
  TEST_ASSERT_TRUE(i > 52 && i < 63);
  TEST_ASSERT_FALSE(is_trying(&f));
  TEST_ASSERT_EQUAL_MEMORY(before.cov, f.cov, sizeof f.cov);
}

static void test_after_five_seconds_of_holding_there_is_another_try(void)
{
  static const double z[3] = { 3.0, 3.0, 3.0 };
  const tse_config c = settings();
  const tse_params p = prepared(&c);
  tse_real noise[3];
  fail_a_try(&p);
  before = f;
  for (int i = 0; i < 496; i++) {
    TEST_ASSERT_FALSE(step(&p, z, 0.0, 0.0, 0.0, noise));
    TEST_ASSERT_TRUE(is_holding(&f));
  }
  TEST_ASSERT_EQUAL_MEMORY(before.cov, f.cov, sizeof f.cov);
  int i = 0;
  for (; i < 8 && is_holding(&f); i++) (void)step(&p, z, 0.0, 0.0, 0.0, noise);
  TEST_ASSERT_TRUE(is_trying(&f) && !is_holding(&f));
  TEST_ASSERT_TRUE(number(f.cov[3][3]) > number(before.cov[3][3]) + 0.1);
}

/* What happens while the filter doubts says nothing about noise or colour. */
static void test_noise_and_colour_are_learnt_only_while_all_is_calm(void)
{
  static const double z[3] = { 3.0, 3.0, 3.0 };
  const tse_config c = settings();
  const tse_params p = prepared(&c);
  tse_real noise[3];
  start(&p, 1);
  run_quiet(&p, 300);
  TEST_ASSERT_TRUE(samples_until_try(&p, 1, 3.0, 100) > 0);
  before = f;
  for (int i = 0; i < 400; i++) (void)step(&p, z, 0.0, 0.0, 0.0, noise);
  TEST_ASSERT_EQUAL_MEMORY(before.noise, f.noise, sizeof f.noise);
  TEST_ASSERT_EQUAL_MEMORY(before.colour, f.colour, sizeof f.colour);
  TEST_ASSERT_EQUAL_MEMORY(before.surprise, f.surprise, sizeof f.surprise);
}

/* ------------------------------------------------------------------------------------------ switches */

static void test_each_setting_switches_its_part_off(void)
{
  tse_config c = settings();
  c.noise_max = 1;
  c.contradiction = 0;
  c.outlier_gate = 0;
  const tse_params p = prepared(&c);
  start(&p, 1);
  before = f;
  for (int i = 0; i < 3000; i++) {
    double z[3];
    tse_real noise[3];
    draw(i < 1500 ? 3.0 : 30.0, 0.0, 0.0, 0.0, z);
    z[0] += i > 500 ? 10.0 : 0.0;
    TEST_ASSERT_FALSE(step(&p, z, 0.0, 0.0, 0.0, noise));
    for (int a = 0; a < 3; a++) {
      expect_near(1.0, number(noise[a]), 0.0, "noise", a);
      expect_near(1.0, number(f.noise[a]), 0.0, "noise found", a);
      expect_near(1.0, number(slow_factor(&f, a)), 0.0, "slow factor", a);
    }
    TEST_ASSERT_FALSE(is_trying(&f));
  }
  TEST_ASSERT_EQUAL_MEMORY(before.cov, f.cov, sizeof f.cov);
  TEST_ASSERT_EQUAL_MEMORY(&before.p, &f.p, sizeof f.p);
}

/* ---------------------------------------------------------------------------------- is a spread seen? */

/* Sigma > 1.5 sqrt(2/n)/rms(d^2/S), n: samples, up to five memories. */
static void test_a_spread_is_seen_when_it_is_one_and_a_half_of_its_sds_from_zero(void)
{
  tse_config c = settings();
  c.forgetting = (tse_setting)0.98; /* 250 samples */
  const tse_params p = prepared(&c);
  static const double none[3] = { 0.0, 0.0, 0.0 };
  for (int rows = 10; rows <= 160; rows *= 4)
    for (int lively = 0; lively < 2; lively++) {
      tse_real noise[3];
      double square[3] = { 0.0, 0.0, 0.0 };
      start(&p, 1);
      for (int i = 0; i < rows; i++) {
        const double force = lively ? i % 2 * 6.0 : 2.0, hph = 0.25;
        const double d[3] = { force, force, 0.5 * force }, s[3] = { 1.25 + 0.01 * force * force, 1.25 + 0.0125 * force * force,
                                                                      1.25 + 0.0125 * force * force };
        (void)step(&p, none, force, 0.1, hph, noise);
        for (int a = 0; a < 3; a++) square[a] += pow(d[a] * d[a] / s[a], 2.0) / rows;
      }
      for (int a = 0; a < 3; a++) {
        const double least = sqrt(1.5 * sqrt(2.0 / rows) / sqrt(square[a]));
        expect_near(square[a], number(f.shows[a]), BY_FORMAT(1e-12, 1e-4) * square[a], "mean square of d^2/S", a);
        TEST_ASSERT_FALSE(spread_is_seen(&f, a, real(0.999 * least)));
        TEST_ASSERT_TRUE(spread_is_seen(&f, a, real(1.001 * least)));
      }
    }
  start(&p, 1);
  for (int a = 0; a < 3; a++) TEST_ASSERT_FALSE(spread_is_seen(&f, a, TSE_R(2))); /* nothing has shown anything yet */
}

int main(void)
{
  UNITY_BEGIN();
  RUN_TEST(test_an_outlier_gets_the_noise_that_brings_it_back_to_the_gate);
  RUN_TEST(test_a_missing_channel_has_no_noise_no_statistics_and_no_contradiction);
  RUN_TEST(test_a_stuck_channel_counts_as_missing_once_it_is_off_by_a_sigma);
  RUN_TEST(test_white_noise_above_what_was_told_is_found);
  RUN_TEST(test_noise_from_the_start_is_found_within_a_second_and_undoes_what_was_learnt_from_it);
  RUN_TEST(test_noise_ends_at_its_limit_and_at_the_settings);
  RUN_TEST(test_what_the_widest_spread_explains_is_no_noise);
  RUN_TEST(test_at_nominal_the_settings_are_believed);
  RUN_TEST(test_the_colour_of_an_autoregressive_disturbance_is_its_ratio_of_smoothed_variances);
  RUN_TEST(test_a_step_contradicts_when_its_smoothed_value_is_five_of_its_sds);
  RUN_TEST(test_a_contradiction_is_judged_by_the_colour_and_the_misfit_of_what_was_before);
  RUN_TEST(test_the_doubt_about_the_mean_is_not_smoothed_away);
  RUN_TEST(test_noise_of_the_wheels_counts_as_noise_of_accel_x_only);
  RUN_TEST(test_a_lone_outlier_does_not_contradict);
  RUN_TEST(test_a_contradiction_opens_the_covariances_by_what_another_road_would_change);
  RUN_TEST(test_nothing_contradicts_before_a_memory_is_full_or_before_anything_was_saved);
  RUN_TEST(test_a_try_that_explains_nothing_brings_back_what_was_believed_before);
  RUN_TEST(test_a_try_that_explains_the_samples_is_learnt_from);
  RUN_TEST(test_holding_ends_when_the_contradiction_does);
  RUN_TEST(test_after_five_seconds_of_holding_there_is_another_try);
  RUN_TEST(test_noise_and_colour_are_learnt_only_while_all_is_calm);
  RUN_TEST(test_each_setting_switches_its_part_off);
  RUN_TEST(test_a_spread_is_seen_when_it_is_one_and_a_half_of_its_sds_from_zero);
  return UNITY_END();
}
