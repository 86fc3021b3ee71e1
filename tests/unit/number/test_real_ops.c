/* tests/unit/number/test_real_ops.c <-> src/number/real_ops.h, in the number format of
 * the build.
 *
 * Reference values: libm in double, whose error (1 ulp, 2.2e-16) is small compared with
 * the tolerances. Arguments are exact in every format. Fixed point skips those outside
 * its range. */
#include "number/real_ops.h"
#include "unit_support.h"

#define TURN 6.283185307179586

#if defined(TSE_REAL_FIXED)
#define TSE_BITS TSE_FRACTION_BITS
#else
#define TSE_BITS 32
#endif

/* Tolerance of an elementary function: fixed + relative * |expected|. The values are the
 * errors documented in real_ops.h: bounds of the polynomials plus rounding of their
 * evaluation. */
#if defined(TSE_REAL_FLOAT)
#define FIXED_LOG2   0.0
#define REL_LOG2     2.3e-7
#define REL_EXP2     2.0e-7
#define FIXED_SINCOS 3.4e-7
#define FIXED_ATAN2  0.0
#define REL_ATAN2    2.0e-7
#define REL_SQRT     6.0e-8          /* half an ulp: 2^-24 */
#define FIXED_HALF   0.0
#elif defined(TSE_REAL_FIXED)
#define LSB          ldexp(1.0, -TSE_FRACTION_BITS)
#define FIXED_LOG2   (2.5e-9 + 0.5 * LSB)
#define REL_LOG2     0.0
#define REL_EXP2     1.6e-9
#define FIXED_SINCOS (3.0e-9 + 0.5 * LSB)
#define FIXED_ATAN2  (1.8e-9 + 0.5 * LSB)
#define REL_ATAN2    0.0
#define REL_SQRT     0.0
#define FIXED_HALF   (0.5 * LSB)     /* nearest */
#else
#define FIXED_LOG2   0.0
#define REL_LOG2     2.7e-14
#define REL_EXP2     1.55e-14
#define FIXED_SINCOS 8.4e-14
#define FIXED_ATAN2  0.0
#define REL_ATAN2    2.7e-14
#define REL_SQRT     2.3e-16         /* half an ulp of the result and of the reference: 2^-52 */
#define FIXED_HALF   0.0
#endif

static int held_exactly(double x) { return number(real(x)) - x == 0.0; }

static void expect_of(double expected, tse_real actual, double tolerance, const char *what, double argument)
{
  if (fabs(number(actual) - expected) <= tolerance) return; /* false for NaN */
  printf("of %.17g:\n", argument);
  expect_near(expected, number(actual), tolerance, what, 0);
}

static void expect_same(double expected, tse_real actual, const char *what)
{
  expect_of(expected, actual, 0.0, what, expected);
}

/* ----------------------------------------------------------------------- arguments of the functions */

#define STEP ldexp(1.0, -20) /* the coarsest resolution of fixed point in the tests */

/* Return x with 24 bits, and a multiple of STEP where possible: exact in every format. */
static double held(double x)
{
  return (float)(fabs(x) >= STEP && fabs(x) < 2048 ? floor(x / STEP + 0.5) * STEP : x);
}

static void check(void (*expect)(double), double x)
{
  if (held_exactly(held(x))) expect(held(x));
}

static void check_positive(
    void (*expect)(double)) /* near 1, at the seams of log2, powers of two, and random */
{
  uint32_t state = 20;
  for (int k = -20; k <= 10; k++) check(expect, ldexp(1.0, k));
  for (int k = -10000; k <= 10000; k += k >= -20 && k < 20 ? 1 : 499) check(expect, 1 + k * STEP);
  for (int k = -2; k <= 2; k++) check(expect, sqrt(0.5) + k * STEP), check(expect, sqrt(2.0) + k * STEP);
  for (int i = 0; i < 200; i++) {
    check(expect, exp2(next_between(&state, -1, 1)));
    check(expect, exp2(next_between(&state, -19, 10.99)));
    check(expect, exp2(next_between(&state, -120, 120)));
  }
}

static void check_octaves(void (*expect)(double)) /* integers, near 0, at the seams of exp2, and random */
{
  uint32_t state = 21;
  for (int k = -24; k <= 12; k++)
    check(expect, k), check(expect, k + 0.5 - STEP), check(expect, k + 0.5), check(expect, k + 0.5 + STEP);
  for (int k = -3; k <= 3; k++) check(expect, k * STEP);
  for (int i = 0; i < 200; i++) {
    check(expect, next_between(&state, -1, 1));
    check(expect, next_between(&state, -22, 11));
    check(expect, next_between(&state, -120, 120));
  }
}

/* ------------------------------------------------------------------------ elementary functions */

static void expect_log2(double x)
{
  expect_of(log2(x), r_log2(real(x)), FIXED_LOG2 + REL_LOG2 * fabs(log2(x)), "log2", x);
}

static void test_log2_matches_the_reference(void) { check_positive(expect_log2); }

static void test_log2_of_a_power_of_two_is_exact(void)
{
#if defined(TSE_REAL_FIXED)
  const int lowest = -TSE_FRACTION_BITS, highest = 58 - TSE_FRACTION_BITS;
#else
  const int lowest = -126, highest = 127; /* the normal numbers of float */
#endif
  for (int k = lowest; k <= highest; k++) { expect_same(k, r_log2(real(ldexp(1.0, k))), "log2(2^k)"); }
}

static void test_log2_of_a_broken_argument_is_defined(void)
{
#if defined(TSE_REAL_FIXED)
  expect_same(-TSE_FRACTION_BITS, r_log2(0), "log2(0)");
  expect_same(-TSE_FRACTION_BITS, r_log2(-1), "log2(-LSB)");
  expect_same(-TSE_FRACTION_BITS, r_log2(FIXED_NAN), "log2(NaN)");
#else
  const double huge = sizeof(tse_real) == 4 ? 128.0 : 1024.0;
  expect_same(1.0 - huge, r_log2(real(0.0)), "log2(0)");
  TEST_ASSERT_TRUE(r_is_finite(r_log2((tse_real)NAN)));
  TEST_ASSERT_TRUE((double)r_log2((tse_real)NAN) >= huge);
  TEST_ASSERT_TRUE((double)r_log2(-(tse_real)NAN) >= huge);
  expect_same(huge, r_log2((tse_real)INFINITY), "log2(inf)");
  expect_same(3.0, r_log2(real(-8.0)), "log2(-8) ignores the sign");
#endif
}

static void expect_exp2(double x)
{
#if defined(TSE_REAL_FIXED)
  if (x >= 59 - TSE_FRACTION_BITS) return;
  expect_of(exp2(x), r_exp2(real(x)), 0.6 * LSB + REL_EXP2 * exp2(x), "exp2", x);
#else
  expect_of(exp2(x), r_exp2(real(x)), REL_EXP2 * exp2(x), "exp2", x);
#endif
}

static void test_exp2_matches_the_reference(void) { check_octaves(expect_exp2); }

static void test_exp2_of_a_whole_number_is_exact(void)
{
#if defined(TSE_REAL_FIXED)
  const int lowest = -TSE_FRACTION_BITS, highest = 58 - TSE_FRACTION_BITS;
#else
  const int lowest = -120, highest = 120;
#endif
  for (int k = lowest; k <= highest; k++) { expect_same(ldexp(1.0, k), r_exp2(r_from_int(k)), "exp2(k)"); }
}

static void test_exp2_saturates_instead_of_overflowing(void)
{
#if defined(TSE_REAL_FIXED)
  const tse_real above = r_from_int(59 - TSE_FRACTION_BITS), below = r_from_int(-TSE_FRACTION_BITS - 1);
  TEST_ASSERT_EQUAL_INT64(FIXED_MOST, r_exp2(above));
  TEST_ASSERT_EQUAL_INT64(FIXED_MOST, r_exp2(INT64_MAX));
  TEST_ASSERT_TRUE(r_exp2(above - 8) < FIXED_MOST);
  TEST_ASSERT_EQUAL_INT64(1, r_exp2(below));
  TEST_ASSERT_EQUAL_INT64(0, r_exp2(below - 1));
  TEST_ASSERT_EQUAL_INT64(0, r_exp2(INT64_MIN));
#else
  const double far[] = { 120.0, 121.0, 1e4, 1e10, 1e38 };
  for (int i = 0; i < ROWS(far); i++) {
    expect_same(ldexp(1.0, 120), r_exp2(real(far[i])), "exp2 of a large argument");
    expect_same(ldexp(1.0, -120), r_exp2(real(-far[i])), "exp2 of a large negative argument");
  }
  TEST_ASSERT_TRUE(r_is_nan(r_exp2((tse_real)NAN)));
#endif
}

static void expect_sine_and_cosine(double t)
{
  tse_real s, c;
  r_sincos_turn(real(t), &s, &c);
  expect_of(sin(TURN * t), s, FIXED_SINCOS, "sin", t);
  expect_of(cos(TURN * t), c, FIXED_SINCOS, "cos", t);
}

static void test_sine_and_cosine_match_the_reference(void)
{
  uint32_t state = 22;
  for (int k = 0; k <= 8; k++)
    for (int e = -1; e <= 1; e++) check(expect_sine_and_cosine, fmin(1, fmax(0, k / 8.0 + e * STEP)));
  for (int i = 0; i < 400; i++) check(expect_sine_and_cosine, next_between(&state, 0, 1));
}

static void test_sine_and_cosine_vanish_exactly_at_quarter_turns(void)
{
  for (int k = 0; k <= 4; k++) {
    tse_real s, c;
    r_sincos_turn(real(0.25 * k), &s, &c);
    expect_same(0.0, k % 2 == 0 ? s : c, "zero of sine or cosine");
  }
}

static void expect_atan2(double any_y, double any_x)
{
  const double y = held(any_y), x = held(any_x), expected = atan2(y, x);
  if (held_exactly(y) && held_exactly(x)) {
    expect_of(expected, r_atan2(real(y), real(x)), FIXED_ATAN2 + REL_ATAN2 * fabs(expected), "atan2", y);
  }
}

static void test_atan2_matches_the_reference_in_every_quadrant(void)
{
  uint32_t state = 23;
  expect_atan2(0, 1), expect_atan2(0, -1), expect_atan2(1, 0), expect_atan2(-1, 0);
  for (int quadrant = 0; quadrant < 4; quadrant++) {
    const double y = quadrant & 1 ? -1 : 1, x = quadrant & 2 ? -1 : 1;
    expect_atan2(3 * y, 3 * x);
    for (int e = -1; e <= 1; e++)
      expect_atan2(0.41421356 * y + e * STEP, x); /* the seam: an eighth of a half turn */
    for (int i = 0; i < 100; i++)
      expect_atan2(y * next_between(&state, 0, 1) * exp2(next_between(&state, -8, 10)),
          x * next_between(&state, 0, 1) * exp2(next_between(&state, -8, 10)));
  }
}

static void test_atan2_of_nothing_is_zero(void)
{
  expect_same(0.0, r_atan2(TSE_R(0), TSE_R(0)), "atan2(0, 0)");
}

static void expect_root(double x)
{
  expect_of(sqrt(x), r_sqrt(real(x)), FIXED_HALF + REL_SQRT * sqrt(x), "sqrt", x);
}

static void test_square_root_is_the_nearest_number(void)
{
  check_positive(expect_root);
  expect_same(0.0, r_sqrt(TSE_R(0)), "sqrt(0)");
}

/* ------------------------------------------------------------------------------ small functions */

static void test_uniform_is_open_at_both_ends_and_symmetric(void)
{
  uint32_t state = 3;
  TEST_ASSERT_TRUE(TSE_R(0) < r_uniform(0u));
  TEST_ASSERT_TRUE(r_uniform(UINT32_MAX) < TSE_R(1));
  for (int i = 0; i < 20000; i++) {
    const uint32_t word = next_word(&state);
    const tse_real u = r_uniform(word);
    TEST_ASSERT_TRUE(TSE_R(0) < u && u < TSE_R(1));
    expect_same(1.0, u + r_uniform(~word), "u(word) + u(~word)");
  }
}

static void test_uniform_follows_the_upper_bits_of_the_word(void)
{
  uint32_t state = 4;
  for (int i = 0; i < 20000; i++) {
    const uint32_t word = next_word(&state);
    /* The middle of the cell of 2^-31 (fixed point, of any resolution) or 2^-23 that
     * contains word / 2^32. */
    const double cell = sizeof(tse_real) == 8
        ? (held_exactly(ldexp(1.0, -33)) && !held_exactly(ldexp(1.0, -50))
                  ? ldexp(1.0, -32)
                  : ldexp(1.0, held_exactly(ldexp(1.0, -50)) ? -31 : 1 - TSE_BITS))
        : ldexp(1.0, -23);
    const double expected = (floor(word * ldexp(1.0, -32) / cell) + 0.5) * cell;
    expect_same(expected, r_uniform(word), "uniform");
  }
}

static void test_floor_rounds_down_on_both_sides_of_zero(void)
{
  const double x[] = { -3.0, -2.5, -0.0009765625, 0.0, 0.0009765625, 0.75, 1.0, 1023.999, -1023.001 };
  for (int i = 0; i < ROWS(x); i++) {
    TEST_ASSERT_EQUAL_INT32((int32_t)floor(x[i]), r_floor_to_int(real(x[i])));
  }
#if defined(TSE_REAL_FIXED)
  TEST_ASSERT_EQUAL_INT32(
      INT64_MIN >> TSE_FRACTION_BITS < INT32_MIN ? INT32_MIN : INT64_MIN >> TSE_FRACTION_BITS,
      r_floor_to_int(INT64_MIN));
  TEST_ASSERT_EQUAL_INT32(
      INT64_MAX >> TSE_FRACTION_BITS > INT32_MAX ? INT32_MAX : INT64_MAX >> TSE_FRACTION_BITS,
      r_floor_to_int(INT64_MAX));
#else
  TEST_ASSERT_EQUAL_INT32(INT32_MIN, r_floor_to_int(real(-1e30)));
  TEST_ASSERT_TRUE(r_floor_to_int(real(1e30)) >= 2147483520);
  TEST_ASSERT_EQUAL_INT32(INT32_MIN, r_floor_to_int((tse_real)NAN));
#endif
}

static void test_min_max_abs_and_clamp_select_values(void)
{
  expect_same(-1.5, r_min(TSE_R(-1.5), TSE_R(2)), "min");
  expect_same(2.0, r_max(TSE_R(-1.5), TSE_R(2)), "max");
  expect_same(1.5, r_abs(TSE_R(-1.5)), "abs");
  expect_same(1.5, r_abs(TSE_R(1.5)), "abs");
  expect_same(0.5, r_clamp(TSE_R(-1.5), TSE_R(0.5), TSE_R(2)), "clamp");
  expect_same(2.0, r_clamp(TSE_R(3), TSE_R(0.5), TSE_R(2)), "clamp");
  expect_same(1.0, r_clamp(TSE_R(1), TSE_R(0.5), TSE_R(2)), "clamp");
  expect_same(6.25, r_sqr(TSE_R(-2.5)), "sqr");
#if !defined(TSE_REAL_FIXED)
  TEST_ASSERT_TRUE(r_is_nan(r_clamp((tse_real)NAN, 0, 1)));
#endif
}

static void test_broken_numbers_are_recognised_by_their_bits(void)
{
  TEST_ASSERT_TRUE(r_is_finite(TSE_R(0)) && r_is_finite(TSE_R(-1000)));
  TEST_ASSERT_FALSE(r_is_nan(TSE_R(1)));
#if !defined(TSE_REAL_FIXED)
  TEST_ASSERT_TRUE(r_is_nan((tse_real)NAN) && r_is_nan(-(tse_real)NAN));
  TEST_ASSERT_FALSE(r_is_nan((tse_real)INFINITY) || r_is_nan((tse_real)-INFINITY));
  TEST_ASSERT_FALSE(r_is_finite((tse_real)NAN) || r_is_finite((tse_real)-INFINITY));
  TEST_ASSERT_TRUE(r_is_finite(real(3e38)) && r_is_finite(real(1e-40)));
#endif
}

static void test_settings_survive_the_way_there_and_back(void)
{
  const double x[] = { 0.0, 1.0, -1.0, 0.25, -1023.5, 2047.0 };
  for (int i = 0; i < ROWS(x); i++) {
    expect_same(x[i], real(x[i]), "setting");
    TEST_ASSERT_TRUE(held_exactly(x[i]));
  }
  for (int32_t n = -2047; n <= 2047; n++) { expect_same(n, r_from_int(n), "from_int"); }
}

/* --------------------------------------------------------------------------------- accumulators */

static void test_numbers_leave_the_machine_in_units_of_2_to_the_minus_24(void)
{
  const double exact[] = { 0, 1, -1, 0.5, -0.25, 126.5, -126.5, 1.0 / 1048576, -3.0 / 1048576 };
  for (int i = 0; i < ROWS(exact); i++) {
    TEST_ASSERT_EQUAL_INT32((int32_t)(exact[i] * 16777216), r_to_q24(real(exact[i])));
    expect_same(exact[i], r_from_q24((int32_t)(exact[i] * 16777216)), "there and back");
  }
  TEST_ASSERT_EQUAL_INT32(127 * 16777216, r_to_q24(real(1000)));
  TEST_ASSERT_EQUAL_INT32(-127 * 16777216, r_to_q24(real(-1000)));
  uint32_t state = 1;
  for (int i = 0; i < 1000; i++) {
    const tse_real x = r_mul(TSE_R(8), r_uniform(next_word(&state))) - TSE_R(4);
    const double n = (double)r_to_q24(x);
    TEST_ASSERT_TRUE(fabs(n - number(x) * 16777216) <= 0.5);
    expect_of(n / 16777216, r_from_q24((int32_t)n), FIXED_HALF + 6.0e-8 * fabs(n / 16777216), "back", n);
  }
  TEST_ASSERT_EQUAL_INT32(INT32_MIN, r_to_q24(real((double)NAN)));
  TEST_ASSERT_EQUAL_INT32(1, r_to_q24(real(0.6 / 16777216)));
  TEST_ASSERT_EQUAL_INT32(-1, r_to_q24(real(-0.6 / 16777216)));
}

static void test_a_share_is_the_quotient_by_a_whole_number(void)
{
  uint32_t state = 5;
  for (int32_t n = 1; n <= 512; n++) {
    const tse_real x = r_mul(TSE_R(1000), r_uniform(next_word(&state)));
    const double share = number(x) / n;
    expect_of(share, r_share(x, n), 2 * FIXED_HALF + REL_SQRT * share, "share", n);
  }
  TEST_ASSERT_TRUE(r_share(TSE_R(512), 512) == TSE_R(1));
}

/* ---------------------------------------------------------------------------------------- fixed */
#if defined(TSE_REAL_FIXED)

static const int64_t extreme[] = { INT64_MIN, INT64_MIN + 1, -INT64_MAX / 2, -FIXED_MOST - 1, -FIXED_MOST,
  -FIXED_ONE - 1, -FIXED_ONE, -((int64_t)1 << 32), -3, -2, -1, 0, 1, 2, 3, FIXED_ONE / 2, FIXED_ONE - 1,
  FIXED_ONE, FIXED_ONE + 1, ((int64_t)1 << 32) - 1, (int64_t)1 << 32, FIXED_MOST - 1, FIXED_MOST,
  INT64_MAX / 2, 15 * FIXED_MOST, -15 * FIXED_MOST, INT64_MAX - 1, INT64_MAX };

/* Products and quotients from 128 bits. */
__extension__ typedef __int128 wide;

static int64_t limited(wide x)
{
  return (int64_t)(x > FIXED_MOST ? FIXED_MOST : x < -FIXED_MOST ? -FIXED_MOST : x);
}

static int64_t nearest_up(wide n) /* n / FIXED_ONE, ties towards +infinity */
{
  const wide x = n + FIXED_ONE / 2;
  return limited(x / FIXED_ONE - (x % FIXED_ONE < 0 ? 1 : 0));
}

static int64_t nearest_away(wide n, wide d) /* n / d, ties away from zero, d != 0 */
{
  const wide an = n < 0 ? -n : n, ad = d < 0 ? -d : d, q = (2 * an + ad) / (2 * ad);
  return limited((n < 0) != (d < 0) ? -q : q);
}

static int64_t any_size(uint32_t *state) /* words of all magnitudes */
{
  const uint64_t word = (uint64_t)next_word(state) << 32 | next_word(state);
  return (int64_t)(word - ((uint64_t)1 << 63)) / ((int64_t)1 << (next_word(state) >> 26 & 62u));
}

/* Return 1 if a sum of fifteen results can be as large: no larger numbers are
 * multiplied. */
static int is_sum(int64_t x) { return x <= 15 * FIXED_MOST && x >= -15 * FIXED_MOST; }

static void expect_product_and_quotient(int64_t a, int64_t b)
{
#if defined(__SIZEOF_INT128__) && !defined(TSE_FIXED_HALVES)
  TEST_ASSERT_EQUAL_INT64(nearest_up((wide)a * b), r_mul(a, b));
#endif
  if (is_sum(a) && is_sum(b)) { /* code for processors without 128 bits */
    TEST_ASSERT_EQUAL_INT64(nearest_up((wide)a * b), fixed_mul_halves(a, b));
  }
  if (b != 0) { TEST_ASSERT_EQUAL_INT64(nearest_away((wide)a * FIXED_ONE, b), r_div(a, b)); }
  TEST_ASSERT_EQUAL_INT64(limited((wide)a + b), r_add_sat(a, b));
}

static void test_fixed_products_and_quotients_round_to_nearest_and_saturate(void)
{
  uint32_t state = 6;
  for (int i = 0; i < ROWS(extreme); i++) {
    for (int j = 0; j < ROWS(extreme); j++) { expect_product_and_quotient(extreme[i], extreme[j]); }
  }
  for (int i = 0; i < 300000; i++) {
    const int64_t a = any_size(&state);
    expect_product_and_quotient(a, any_size(&state));
  }
  TEST_ASSERT_EQUAL_INT64(1, r_mul(1, TSE_R(0.5)));  /* a tie goes up ... */
  TEST_ASSERT_EQUAL_INT64(0, r_mul(-1, TSE_R(0.5))); /* ... also below zero */
}

/* Every divisor, with dividends at both ends of a quotient and of the range. */
static void test_fixed_digits_are_quotients_rounded_down(void)
{
  for (uint32_t d = 32768; d <= 65537; d++) {
    const uint32_t over = fixed_over(d), most = d > 65535 ? UINT32_MAX : (d << 16) + 65535u;
    for (uint32_t k = 0; k < 64; k++) {
      const uint32_t n = k < 2 ? most - k : (uint32_t)((uint64_t)most * k / 64) / d * d - (k & 1u);
      TEST_ASSERT_EQUAL_UINT32(n / d, fixed_digit(n, d, over));
    }
  }
}

static void test_fixed_products_of_words_are_exact(void)
{
  const uint32_t word[] = { 0, 1, 2, 0x7fff, 0x8000, 0xffff, 0x10000, 0x7fff7fff, 0x7fffffff, 0x80000000u,
    0x80008000u, 0xffff0000u, 0xffff8000u, 0xffffffffu };
  uint32_t state = 9;
  for (int i = 0; i < 200000; i++) {
    const uint32_t a = i < ROWS(word) * ROWS(word) ? word[i / ROWS(word)] : next_word(&state),
                   b = i < ROWS(word) * ROWS(word) ? word[i % ROWS(word)] : next_word(&state);
    const int64_t product = (int64_t)(int32_t)a * (int32_t)b;
    TEST_ASSERT_TRUE(fixed_product((int32_t)a, (int32_t)b) == product);
    TEST_ASSERT_EQUAL_INT32(
        (int32_t)((product + ((int64_t)1 << 31)) >> 32), fixed_product_upper((int32_t)a, (int32_t)b));
    TEST_ASSERT_TRUE(fixed_product_unsigned(a, b) == (uint64_t)a * b);
  }
}

static void test_fixed_division_by_zero_saturates_with_the_sign_of_the_numerator(void)
{
  TEST_ASSERT_EQUAL_INT64(FIXED_MOST, r_div(1, 0));
  TEST_ASSERT_EQUAL_INT64(-FIXED_MOST, r_div(-1, 0));
  TEST_ASSERT_EQUAL_INT64(-FIXED_MOST, r_div(INT64_MIN, 0));
  TEST_ASSERT_EQUAL_INT64(0, r_div(0, 0));
}

/* Fifteen results of any operation can be added natively. */
static void test_fixed_results_leave_room_for_sums(void)
{
  for (int i = 0; i < ROWS(extreme); i++) {
    for (int j = 0; j < ROWS(extreme); j++) {
      const int64_t a = extreme[i], b = extreme[j];
      tse_real s, c;
      r_sincos_turn(a, &s, &c); /* also checks for undefined behaviour */
      const tse_real result[] = { r_mul(a, b), r_div(a, b), r_add_sat(a, b), r_atan2(a, b), r_sqrt(a),
        r_log2(a), r_exp2(a), s, c, r_sqr(a), r_from_int(r_floor_to_int(a)), r_from_q24(r_to_q24(a)) };
      for (int k = 0; k < ROWS(result); k++) {
        TEST_ASSERT_TRUE(result[k] <= INT64_MAX / 15 && result[k] >= -(INT64_MAX / 15));
      }
    }
  }
}

static void test_fixed_square_root_is_nearest_for_every_kind_of_argument(void)
{
  uint32_t state = 7;
  for (int i = 0; i < 300000; i++) {
    const int64_t x = i < 100000 ? i : any_size(&state);
    const wide root = r_sqrt(x), square = (wide)(x < 0 ? 0 : x) * FIXED_ONE;
    /* root - 1/2 <= sqrt(square) <= root + 1/2, squared, without the quarter that
     * integers cannot represent. */
    TEST_ASSERT_TRUE(square <= root * root + root);
    TEST_ASSERT_TRUE(root == 0 || square > root * root - root);
  }
  TEST_ASSERT_EQUAL_INT64(0, r_sqrt(INT64_MIN));
}

static void test_fixed_log2_and_exp2_stay_near_double_everywhere(void)
{
  uint32_t state = 12;
  for (int i = 0; i < 300000; i++) {
    const int64_t x = any_size(&state);
    if (x > 0) { expect_of(log2((double)x) - TSE_FRACTION_BITS, r_log2(x), FIXED_LOG2, "log2", number(x)); }
  }
  for (int i = 0; i < 300000; i++) {
    const tse_real x = r_mul(TSE_R(60), r_uniform(next_word(&state))) - TSE_R(34);
    const double expected = exp2(number(x));
    expect_of(expected, r_exp2(x), 0.5 * LSB + REL_EXP2 * expected, "exp2", number(x));
  }
}

/* In steps that a Q30 polynomial resolves. Single steps of the format are monotonic
 * within its error. */
static void test_fixed_log2_and_exp2_do_not_decrease(void)
{
  int64_t last = r_log2(1);
  for (int64_t x = 1; x < FIXED_MOST / 2; x += 1 + x / 10000) {
    const int64_t value = r_log2(x);
    TEST_ASSERT_TRUE(last <= value);
    last = value;
  }
  last = 0;
  for (int64_t x = TSE_R(-34); x <= TSE_R(26); x += FIXED_ONE / 7919) {
    const int64_t value = r_exp2(x);
    TEST_ASSERT_TRUE(last <= value);
    last = value;
  }
}

static void test_fixed_sine_cosine_and_arc_stay_near_double_everywhere(void)
{
  const double pi = 3.14159265358979323846;
  uint32_t state = 8;
  for (int i = 0; i < 300000; i++) {
    const tse_real t = r_uniform(next_word(&state));
    tse_real s, c, s1, c1;
    r_sincos_turn(t, &s, &c);
    expect_of(sin(2 * pi * number(t)), s, FIXED_SINCOS, "sin", number(t));
    expect_of(cos(2 * pi * number(t)), c, FIXED_SINCOS, "cos", number(t));
    r_sincos_turn(t - TSE_R(3), &s1, &c1);
    TEST_ASSERT_TRUE(s == s1 && c == c1); /* whole turns do not matter */
    const int64_t y = any_size(&state), x = any_size(&state);
    if (y != 0 || x != 0) {
      expect_of(atan2((double)y, (double)x), r_atan2(y, x), FIXED_ATAN2, "atan2", number(y));
    }
  }
}

static void test_fixed_numbers_go_in_and_out_by_the_nearest(void)
{
  TEST_ASSERT_EQUAL_INT64(1, tse_real_of(0.5 * LSB));
  TEST_ASSERT_EQUAL_INT64(-1, tse_real_of(-0.5 * LSB));
  TEST_ASSERT_EQUAL_INT64(0, tse_real_of(0.49 * LSB));
  TEST_ASSERT_FALSE(r_is_finite(tse_real_of(1e300)) || r_is_finite(tse_real_of((double)-INFINITY)));
  TEST_ASSERT_TRUE(r_is_nan(tse_real_of((double)NAN)) && isnan(tse_double_of(FIXED_NAN)));
  TEST_ASSERT_FALSE(r_is_finite(FIXED_NAN) || r_abs(FIXED_NAN) < FIXED_MOST);
  TEST_ASSERT_EQUAL_INT64(FIXED_MOST, r_from_int(INT32_MAX));
  TEST_ASSERT_EQUAL_INT64(TSE_S(0.1), tse_setting_of(0.1));
}

/* Numbers of all sizes, and at the limits of rounding: the same bits as a conversion to
 * float. */
static void test_fixed_settings_have_the_single_precision_bits_of_other_formats(void)
{
  uint32_t state = 13;
  for (int i = 0; i < 300000; i++) {
    const int64_t x = any_size(&state);
    const float single = (float)x; /* rounds once; scaling is exact */
    uint32_t bits;
    memcpy(&bits, &single, sizeof bits);
    TEST_ASSERT_EQUAL_HEX32(x == 0 ? 0 : bits - ((uint32_t)TSE_FRACTION_BITS << 23), r_single_bits(x));
  }
}
#endif

/* ------------------------------------------------------------------------------- reproducibility */

/* FNV-1a over the values, low byte first on all machines. */
static uint32_t digest(uint32_t hash, tse_real x)
{
  uint64_t bits = 0;
#if defined(TSE_REAL_FIXED)
  bits = (uint64_t)x;
#else
  bits = bits_of(x);
#endif
  for (size_t i = 0; i < sizeof x; i++) { hash = (hash ^ (uint32_t)(bits >> (8 * i) & 255u)) * 16777619u; }
  return hash;
}

static void test_every_machine_and_compiler_gives_the_same_bits(void)
{
#if defined(TSE_REAL_FIXED)
  const uint32_t recorded = 0xa1cf33d5u;
#elif defined(TSE_REAL_FLOAT)
  const uint32_t recorded = 0x4f89ae71u;
#else
  const uint32_t recorded = 0x1840ff11u;
#endif
  uint32_t state = 11, hash = 2166136261u;
  for (int i = 0; i < 20000; i++) {
    const tse_real u = r_uniform(next_word(&state)), x = r_div(u, r_uniform(next_word(&state)));
    tse_real s, c;
    r_sincos_turn(u, &s, &c);
    hash = digest(digest(hash, s), c);
    hash = digest(digest(hash, r_log2(x)), r_exp2(r_mul(TSE_R(20), s)));
    hash = digest(digest(hash, r_sqrt(x)), r_atan2(s, c));
  }
  TEST_ASSERT_EQUAL_HEX32(recorded, hash);
}
