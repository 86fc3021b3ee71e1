/* tests/unit/number/test_vector.c <-> src/number/vector.h: rows, compared with double. */
#include "number/vector.h"
#include "unit_support.h"

enum { N = 23 };
#if defined(TSE_REAL_FIXED)
#define STEP ldexp(1, -SHORT_BITS) /* of a number of a row */
#else
#define STEP 0.0
#endif
#define RELATIVE BY_NUMBER(1e-14, 1e-6, ldexp(1, -29))

static tse_short short_of(double x) { return r_short(real(x)); }
static double number_of(tse_short x) { return number(r_long(x)); }

static void any_row(tse_short *x, double most, uint32_t *seed)
{
  for (int i = 0; i < N; i++) x[i] = short_of(next_between(seed, -most, most));
}

static void any_numbers(tse_real *x, double most, uint32_t *seed)
{
  for (int i = 0; i < N; i++)
    x[i] = next_uniform(seed) < 0.3 ? TSE_R(0) : real(next_between(seed, -most, most));
}

/* Return a number of 2^-28 .. 2^5, of either sign. */
static double any_factor(uint32_t *seed)
{
  return ldexp(next_between(seed, -1, 1), 5 - (int)(next_word(seed) % 34));
}

static void test_a_number_of_a_row_is_the_nearest_and_stops(void)
{
  uint32_t seed = 1;
  for (int n = 0; n < 1000; n++) {
    const double x = any_factor(&seed);
    expect_near(x, number_of(short_of(x)), 0.5 * STEP + RELATIVE * fabs(x), "nearest", n);
    if (fabs(x) < 16)
      expect_near(x, number(r_long_scaled(r_short_scaled(real(x), ROW_UP), ROW_UP)),
          STEP / 16 + RELATIVE * fabs(x), "scaled", n);
  }
#if defined(TSE_REAL_FIXED)
  const double most = number_of(MAX_SHORT - 1);
  expect_near(most, number_of(short_of(1e5)), 1, "stops, with any digits behind the point", 0);
  expect_near(-most, number_of(short_of(-1e5)), 1, "stops below", 0);
  expect_near(most, number_of(r_short_sum(MAX_SHORT - 1, MAX_SHORT - 1)), 0, "a sum stops", 0);
#endif
}

static void test_a_row_more_is_that_of_each_number(void)
{
  uint32_t seed = 2;
  for (int n = 0; n < 2000; n++) {
    tse_short x[N], y[N], was[N];
    const double a = any_factor(&seed);
    any_row(x, 3, &seed);
    any_row(y, 3, &seed);
    memcpy(was, y, sizeof y);
    r_add_row(y, x, r_factor(real(a), 0), N);
    for (int i = 0; i < N; i++)
      expect_near(number_of(was[i]) + a * number_of(x[i]), number_of(y[i]),
          (0.51 + 2 * fabs(a)) * STEP + 10 * RELATIVE * (3 + fabs(a)), "y + a x", i);
  }
}

static void test_two_rows_that_change_each_other_do_so_in_the_order_that_is_said(void)
{
  uint32_t seed = 3;
  for (int n = 0; n < 2000; n++) {
    tse_short x[N], y[N], u[N], w[N];
    const double a = next_between(&seed, -2, 2),
                 b = n % 3 ? next_between(&seed, -0.4, 0.4) : next_between(&seed, -2, 2),
                 near = 8 * STEP + 40 * RELATIVE;
    any_row(x, 3, &seed);
    any_row(y, 3, &seed);
    memcpy(u, y, sizeof y);
    memcpy(w, x, sizeof x);
    r_add_both(u, w, r_factor(real(a), 0), r_factor(real(b), 0), N);
    for (int i = 0; i < N; i++) {
      expect_near(number_of(y[i]) + a * number_of(x[i]), number_of(u[i]), near, "y + a x", i);
      expect_near(number_of(x[i]) + b * number_of(y[i]), number_of(w[i]), near, "x + b y", i);
    }
    memcpy(u, y, sizeof y);
    memcpy(w, x, sizeof x);
    r_add_in_turn(u, w, r_factor(real(a), 0), r_factor(real(b), 0), N);
    for (int i = 0; i < N; i++) {
      const double then = number_of(x[i]) + b * number_of(y[i]);
      expect_near(then, number_of(w[i]), near, "x + b y first", i);
      expect_near(number_of(y[i]) + a * then, number_of(u[i]), near, "y + a x then", i);
    }
  }
}

/* Operations on two rows at once give the same bits as one after the other. */
static void test_two_rows_together_are_two_in_turn(void)
{
  uint32_t seed = 13;
  for (int n = 0; n < 500; n++) {
    tse_short x[2][N], y[2][2][N], sum[2][4], *const once[2] = { y[0][0], y[0][1] };
    r_factored a[2], b[2];
    for (int c = 0; c < 2; c++) {
      a[c] = r_factor(real(next_between(&seed, -0.4, 0.4)), 0);
      b[c] = r_factor(real(next_between(&seed, -0.4, 0.4)), 0);
      any_row(y[0][c], 3, &seed);
    }
    any_row(x[0], 3, &seed);
    memcpy(x[1], x[0], sizeof x[0]);
    memcpy(y[1], y[0], sizeof y[0]);
    if (n % 2) r_add_both_twice(once, x[0], a, b, N);
    else r_add_in_turn_twice(once, x[0], a, b, N);
    for (int c = 0; c < 2; c++) {
      if (n % 2) r_add_both(y[1][c], x[1], a[c], b[c], N);
      else r_add_in_turn(y[1][c], x[1], a[c], b[c], N);
    }
    TEST_ASSERT_EQUAL_MEMORY(x[1], x[0], sizeof x[0]);
    TEST_ASSERT_EQUAL_MEMORY(y[1], y[0], sizeof y[0]);
    for (int i = 0; i < 4; i++) sum[0][i] = sum[1][i] = short_of(0.25 * i);
    r_slope_sums(sum[0], 2, y[0][0], N, once, 2, N);
    for (int i = 0; i < 4; i++) r_slope_sums(&sum[1][i], 1, y[0][i / 2], N, &once[i % 2], 1, N);
    TEST_ASSERT_EQUAL_MEMORY(sum[1], sum[0], sizeof sum[0]);
  }
}

static void test_rows_that_are_scaled_are_multiplied_as_if_they_were_not(void)
{
  uint32_t seed = 4;
  for (int n = 0; n < 500; n++) {
    tse_real x[N];
    tse_short room[N], y[N];
    const double size = ldexp(1, 4 - n % 20), a = next_between(&seed, -0.3, 0.3) / size;
    any_numbers(x, size, &seed);
    for (int i = 0; i < N; i++) y[i] = short_of(0.25);
    const r_scaled scaled = r_scaled_of(x, N, room);
    r_add_row(y, scaled.m, r_factor(real(a), scaled.up), N);
    for (int i = 0; i < N; i++)
      expect_near(0.25 + a * number(x[i]), number_of(y[i]),
          STEP + 10 * RELATIVE + fabs(number(x[i])) * BY_NUMBER(0, 0, QUANTUM), "y + a x", i);
  }
}

static void test_a_sum_of_products_is_rounded_once(void)
{
  uint32_t seed = 5;
  for (int n = 0; n < 1000; n++) {
    tse_real h[N];
    tse_short x[N], room[N];
    r_sparse s;
    int32_t right;
    const double most = ldexp(1, 6 - n % 20);
    double sum = 0.125, size = 0.125;
    any_numbers(h, most, &seed);
    any_row(x, 4, &seed);
    for (int i = 0; i < N; i++) {
      sum += number(h[i]) * number_of(x[i]);
      size += fabs(number(h[i]) * number_of(x[i]));
    }
    const tse_short *const row = r_row(h, N, room, &right);
    const double near = BY_NUMBER(1e-14, 1e-6, ldexp(1, -26)) * size
        + 4 * most * BY_NUMBER(0, 0, N * ldexp(1, -27)) + BY_NUMBER(0, 0, QUANTUM);
    expect_near(sum, number(r_sum(TSE_R(0.125), x, row, right, N)), near, "row", n);
    r_sparse_of(h, N, &s);
    expect_near(sum, number(r_sum_sparse(TSE_R(0.125), x, &s, s.count)), near, "what is not 0 of it", n);
  }
}

static void test_quotients_by_one_number_share_its_reciprocal(void)
{
  uint32_t seed = 6;
  for (int n = 0; n < 5000; n++) {
    const tse_real d = real(fabs(ldexp(next_between(&seed, 0.5, 1), 10 - (int)(next_word(&seed) % 30)))),
                   x = real(any_factor(&seed));
    const r_divided over = r_divisor(d);
    const double q = number(x) / number(d);
    if (fabs(q) > 1e6) continue;
    expect_near(q, number(r_by(x, over)), RELATIVE * fabs(q) + BY_NUMBER(0, 0, QUANTUM), "x/d", n);
    const tse_short one = r_short(TSE_R(1));
    expect_near(q, number(r_times(one, r_quotient(x, over, 0))),
        RELATIVE * fabs(q) + BY_NUMBER(0, 0, QUANTUM), "as a factor", n);
    const tse_real more = real(number(d) * next_uniform(&seed)), was = d - more, x0 = real(fabs(number(x)));
    if (!(was > TSE_R(0))) continue;
    expect_near(number(x0) * number(was) / number(d), number(r_left(x0, was, more, over)),
        4 * RELATIVE * number(x0) + BY_NUMBER(0, 0, 2 * QUANTUM), "what is left", n);
    TEST_ASSERT_TRUE(!(r_left(x0, d, TSE_R(0), over) != x0)); /* unchanged */
  }
}

static tse_short slope_sum(tse_short from, const tse_short *slope, tse_short *x, int n)
{
  r_slope_sums(&from, 1, slope, n, &x, 1, n);
  return from;
}

/* Slopes: x to/over equals r_short() for a row, within the resolution of a slope. Sums of
 * them are rounded once. */
static void test_slopes_are_brought_into_units_and_multiply_rows(void)
{
  uint32_t seed = 8;
  const double step = BY_NUMBER(0, 0, ldexp(1, -23)), most = 1e4;
  for (int n = 0; n < 2000; n++) {
    const double to = next_between(&seed, 0.005, 0.5), over = next_between(&seed, 0.01, 0.5),
                 x = next_between(&seed, -3, 3) * (n % 2 ? 0.01 : 1);
    const double ratio = number(real(x)) * number(real(to)) / number(real(over)),
                 held = BY_NUMBER(ratio, ratio, fmax(-16, fmin(16, ratio)));
    const r_factored unit = r_unit(real(to)), own = r_over_unit(real(over));
    const tse_short slope = r_slope_in_units(r_short_scaled(real(x), ROW_UP), unit, own, real(most));
    tse_short one = short_of(1);
    /* resolution 2^-26 after scaling by 2^ROW_UP, times 1/over */
    const double near = 2 * RELATIVE * fabs(ratio) + step + BY_NUMBER(0, 0, ldexp(1.5, -25)) / over;
    if (fabs(ratio) < 15.9)
      expect_near(held, number_of(slope_sum(short_of(0), &slope, &one, 1)), near + 0.5 * STEP, "in units", n);
    else TEST_ASSERT_TRUE(fabs(number_of(slope_sum(short_of(0), &slope, &one, 1))) > 15);
    if (fabs(x / over) < 250)
      expect_near(number(real(x)) / number(real(over)),
          number_of(r_short_over(r_short_scaled(real(x), ROW_UP), own, real(most))),
          near + 0.5 * STEP + RELATIVE * fabs(x / over), "of a row", n);
  }
  for (int n = 0; n < 500; n++) {
    tse_short slope[N], x[N];
    double sum = 0;
    any_row(x, 4, &seed);
    for (int i = 0; i < N; i++) {
      const double s = next_between(&seed, -15, 15);
      slope[i] = r_slope(real(s));
      sum += number(real(s)) * number_of(x[i]);
    }
    const tse_short from = r_slope(real(0.75));
    if (fabs(sum) < 200)
      expect_near(0.75 + sum, number_of(slope_sum(from, slope, x, N)),
          0.5 * STEP + N * 4 * step + 400 * RELATIVE, "a sum", n);
  }
}

static void test_the_product_of_two_of_rows_is_that_of_their_numbers(void)
{
  uint32_t seed = 12;
  for (int n = 0; n < 2000; n++) {
    const tse_short a = short_of(next_between(&seed, -250, 250) * (n % 3 ? 0.001 : 1)),
                    b = short_of(next_between(&seed, -250, 250) * (n % 2 ? 0.01 : 1));
    const tse_real product = r_mul_short(a, b), same = r_mul(r_long(a), r_long(b));
    TEST_ASSERT_EQUAL_MEMORY(&same, &product, sizeof same);
  }
}

static void test_a_factor_knows_its_number(void)
{
  uint32_t seed = 9;
  for (int n = 0; n < 5000; n++) {
    const double x = n % 10 ? any_factor(&seed) : ldexp(any_factor(&seed), -30);
    for (int up = -4; up < 8; up += 4) {
      const double scaled = x * BY_NUMBER(1, 1, ldexp(1, up));
      if (fabs(scaled) < 200)
        expect_near(scaled, number_of(r_short_of(r_factor(real(x), up), real(x), up)),
            0.5 * STEP + 2 * RELATIVE * fabs(scaled) + BY_NUMBER(0, 0, ldexp(QUANTUM, up)),
            "as a number of a row", n);
    }
  }
}

static void test_sums_element_by_element(void)
{
  uint32_t seed = 7;
  for (int n = 0; n < 2000; n++) {
    double a[3], m[3], sum = 0;
    r_coefficient c[3];
    tse_short x[3];
    for (int i = 0; i < 3; i++) {
      c[i] = r_coef(real(a[i] = next_between(&seed, -60, 60)));
      x[i] = r_short_scaled(real(m[i] = next_between(&seed, -0.5, 0.5)), ROW_UP);
      sum += (i == 2 ? -a[i] : a[i]) * m[i];
    }
    const double near = BY_NUMBER(1e-12, 1e-4, 1e-6);
    const tse_short rate = r_end_rate(r_minus(r_plus(r_product(c[0], x[0]), c[1], x[1]), c[2], x[2]));
    expect_near(sum, number_of(rate), BY_NUMBER(near, near, 1e-5), "rate", n);
    expect_near(m[0] + 0.01 * sum,
        number(r_long_scaled(r_plus_times(x[0], r_factor(real(0.01), ROW_UP), rate), ROW_UP)), near,
        "x + h rate", n);
    const double least = m[0] + a[1] * m[1] / 60;
    expect_near(least,
        number(r_long_scaled(r_end(r_plus(r_start(x[0]), r_coef(real(a[1] / 60)), x[1])), ROW_UP)), near,
        "x + a y", n);
  }
}
