/* tests/unit/number/test_real_ops.c <-> src/number/real_ops.h, in the format it is compiled for.
 *
 * Reference values: tests/reference/real_ops_table.h (mpmath, 40 digits). Its arguments are exact in every
 * format, except that q20 skips those it cannot hold. */
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include "number/real_ops.h"
#include "unity.h"
#include "real_ops_table.h"

void setUp(void);
void tearDown(void);
void setUp(void) {}
void tearDown(void) {}

#define ROWS(table) (sizeof(table) / sizeof((table)[0]))

/* Tolerance of an elementary function: fixed + relative * |expected|. The figures are the errors documented
 * in real_ops.h, which are bounds of the polynomials plus the rounding of their evaluation. */
#if defined(TSE_REAL_FLOAT)
#define FIXED_LOG2   0.0
#define REL_LOG2     2.3e-7
#define REL_EXP2     2.0e-7
#define FIXED_SINCOS 3.4e-7
#define FIXED_ATAN2  0.0
#define REL_ATAN2    2.0e-7
#define REL_SQRT     6.0e-8          /* half an ulp: 2^-24 */
#define FIXED_HALF   0.0
#elif defined(TSE_REAL_Q20)
#define LSB          (1.0 / 1048576.0)
#define FIXED_LOG2   (0.56 * LSB)
#define REL_LOG2     0.0
#define REL_EXP2     3.3e-9
#define FIXED_SINCOS (0.51 * LSB)
#define FIXED_ATAN2  (0.52 * LSB)
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

static tse_real real(double x) { return r_from_setting((tse_setting)x); }
static double number(tse_real x) { return (double)r_to_setting(x); }
static int held_exactly(double x) { return number(real(x)) - x == 0.0; }

static void expect_near(double expected, tse_real actual, double tolerance, const char *what, double argument)
{
  char text[160];
  const double error = fabs(number(actual) - expected);
  if (error <= tolerance) {                       /* false for NaN */
    return;
  }
  (void)snprintf(text, sizeof text, "%s(%.17g) is %.17g, expected %.17g, error %.3g > %.3g", what, argument,
                 number(actual), expected, error, tolerance);
  TEST_FAIL_MESSAGE(text);
}

static void expect_same(double expected, tse_real actual, const char *what)
{
  expect_near(expected, actual, 0.0, what, expected);
}

/* Full-period generator of test words; the library's own is tested elsewhere. */
static uint32_t next_word(uint32_t *state)
{
  *state = *state * 1664525u + 1013904223u;
  return *state ^ (*state >> 15);
}

/* ------------------------------------------------------------------------ elementary functions */

static void test_log2_matches_the_reference(void)
{
  for (size_t i = 0; i < ROWS(log2_table); i++) {
    const double x = log2_table[i][0], expected = log2_table[i][1];
    if (held_exactly(x)) {
      expect_near(expected, r_log2(real(x)), FIXED_LOG2 + REL_LOG2 * fabs(expected), "log2", x);
    }
  }
}

static void test_log2_of_a_power_of_two_is_exact(void)
{
#if defined(TSE_REAL_Q20)
  const int lowest = -20, highest = 10;
#else
  const int lowest = -126, highest = 127;         /* the normal numbers of float */
#endif
  for (int k = lowest; k <= highest; k++) {
    expect_same(k, r_log2(real(ldexp(1.0, k))), "log2(2^k)");
  }
}

static void test_log2_never_decreases_over_the_seams_of_its_octaves(void)
{
  /* Each octave ends at sqrt(2) 2^k. A relative step of 2^-19 raises log2 by 2.8e-6, far more than the error of
   * double and float; q20 rounds it to 2 or 3 LSB at most, hence "never decreases". */
  for (int k = -8; k < 10; k++) {
    const double seam = ldexp(sqrt(2.0), k);
    for (int j = -200; j < 200; j++) {
      const double x = number(real(seam)) * (1.0 + j * ldexp(1.0, -19));
      const tse_real below = r_log2(real(x)), above = r_log2(real(x * (1.0 + ldexp(1.0, -19))));
      TEST_ASSERT_TRUE(below <= above);
    }
  }
}

static void test_log2_of_a_broken_argument_is_defined(void)
{
#if defined(TSE_REAL_Q20)
  expect_same(-20.0, r_log2(0), "log2(0)");
  expect_same(-20.0, r_log2(-1), "log2(-LSB)");
  expect_same(-20.0, r_log2(INT32_MIN), "log2(min)");
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

static void test_exp2_matches_the_reference(void)
{
  for (size_t i = 0; i < ROWS(exp2_table); i++) {
    const double x = exp2_table[i][0], expected = exp2_table[i][1];
#if defined(TSE_REAL_Q20)
    if (x >= 11.0) {
      continue;
    }
    if (held_exactly(x)) {
      expect_near(expected, r_exp2(real(x)), (x < 5.0 ? 0.6 : 0.5) * LSB + REL_EXP2 * expected, "exp2", x);
    }
#else
    expect_near(expected, r_exp2(real(x)), REL_EXP2 * expected, "exp2", x);
#endif
  }
}

static void test_exp2_of_a_whole_number_is_exact(void)
{
#if defined(TSE_REAL_Q20)
  const int lowest = -20, highest = 10;
#else
  const int lowest = -120, highest = 120;
#endif
  for (int k = lowest; k <= highest; k++) {
    expect_same(ldexp(1.0, k), r_exp2(r_from_int(k)), "exp2(k)");
  }
}

static void test_exp2_saturates_instead_of_overflowing(void)
{
#if defined(TSE_REAL_Q20)
  TEST_ASSERT_EQUAL_INT32(INT32_MAX, r_exp2(TSE_R(11)));
  TEST_ASSERT_EQUAL_INT32(INT32_MAX, r_exp2(INT32_MAX));
  TEST_ASSERT_TRUE(r_exp2(TSE_R(11) - 1) < INT32_MAX);
  TEST_ASSERT_EQUAL_INT32(1, r_exp2(TSE_R(-21)));
  TEST_ASSERT_EQUAL_INT32(0, r_exp2(TSE_R(-21) - 1));
  TEST_ASSERT_EQUAL_INT32(0, r_exp2(INT32_MIN));
#else
  const double far[] = { 120.0, 121.0, 1e4, 1e10, 1e38 };
  for (size_t i = 0; i < ROWS(far); i++) {
    expect_same(ldexp(1.0, 120), r_exp2(real(far[i])), "exp2 of a large argument");
    expect_same(ldexp(1.0, -120), r_exp2(real(-far[i])), "exp2 of a large negative argument");
  }
  TEST_ASSERT_TRUE(r_is_nan(r_exp2((tse_real)NAN)));
#endif
}

static void test_exp2_undoes_log2(void)
{
  uint32_t state = 1;
  for (int i = 0; i < 20000; i++) {
    const tse_real x = TSE_R(1) + r_mul(TSE_R(63), r_uniform(next_word(&state)));
    /* An error e of log2 becomes a relative error ln(2) e. |log2 x| <= 6. */
    const double tolerance = 0.7 * (FIXED_LOG2 + 2 * FIXED_HALF + 6 * REL_LOG2) + REL_EXP2;
    expect_near(number(x), r_exp2(r_log2(x)), tolerance * number(x) + 1.2 * FIXED_HALF, "exp2(log2)", number(x));
  }
}

static void test_sine_and_cosine_match_the_reference(void)
{
  for (size_t i = 0; i < ROWS(turn_table); i++) {
    const double t = turn_table[i][0];
    tse_real s, c;
    if (held_exactly(t)) {
      r_sincos_turn(real(t), &s, &c);
      expect_near(turn_table[i][1], s, FIXED_SINCOS, "sin", t);
      expect_near(turn_table[i][2], c, FIXED_SINCOS, "cos", t);
    }
  }
}

static void test_sine_and_cosine_vanish_exactly_at_quarter_turns(void)
{
  for (int k = 0; k <= 4; k++) {
    tse_real s, c;
    r_sincos_turn(real(0.25 * k), &s, &c);
    expect_same(0.0, k % 2 == 0 ? s : c, "zero of sine or cosine");
  }
}

static void test_sine_and_cosine_lie_on_the_unit_circle(void)
{
  uint32_t state = 2;
  for (int i = 0; i < 20000; i++) {
    tse_real s, c;
    r_sincos_turn(r_uniform(next_word(&state)), &s, &c);
    /* d(s^2 + c^2) = 2 (s ds + c dc) <= 2 sqrt(2) max(ds, dc) */
    TEST_ASSERT_TRUE(fabs(number(s) * number(s) + number(c) * number(c) - 1.0) < 2.83 * FIXED_SINCOS + 1e-15);
  }
}

static void test_atan2_matches_the_reference_in_every_quadrant(void)
{
  for (size_t i = 0; i < ROWS(atan2_table); i++) {
    const double y = atan2_table[i][0], x = atan2_table[i][1], expected = atan2_table[i][2];
    if (held_exactly(y) && held_exactly(x)) {
      expect_near(expected, r_atan2(real(y), real(x)), FIXED_ATAN2 + REL_ATAN2 * fabs(expected), "atan2", y);
    }
  }
}

static void test_atan2_of_nothing_is_zero(void)
{
  expect_same(0.0, r_atan2(TSE_R(0), TSE_R(0)), "atan2(0, 0)");
}

static void test_square_root_is_the_nearest_number(void)
{
  for (size_t i = 0; i < ROWS(log2_table); i++) {
    const double x = log2_table[i][0], expected = log2_table[i][2];
    if (held_exactly(x)) {
      expect_near(expected, r_sqrt(real(x)), FIXED_HALF + REL_SQRT * expected, "sqrt", x);
    }
  }
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
    /* The middle of the cell of 2^-19 (q20), 2^-23 or 2^-31 into which word / 2^32 falls. */
    const double cell = sizeof(tse_real) == 8 ? ldexp(1.0, -31) : held_exactly(ldexp(1.0, -23)) ? ldexp(1.0, -23)
                                                                                               : ldexp(1.0, -19);
    const double expected = (floor(word * ldexp(1.0, -32) / cell) + 0.5) * cell;
    expect_same(expected, r_uniform(word), "uniform");
  }
}

static void test_floor_rounds_down_on_both_sides_of_zero(void)
{
  const double x[] = { -3.0, -2.5, -0.0009765625, 0.0, 0.0009765625, 0.75, 1.0, 1023.999, -1023.001 };
  for (size_t i = 0; i < ROWS(x); i++) {
    TEST_ASSERT_EQUAL_INT32((int32_t)floor(x[i]), r_floor_to_int(real(x[i])));
  }
#if defined(TSE_REAL_Q20)
  TEST_ASSERT_EQUAL_INT32(-2048, r_floor_to_int(INT32_MIN));
  TEST_ASSERT_EQUAL_INT32(2047, r_floor_to_int(INT32_MAX));
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
#if !defined(TSE_REAL_Q20)
  TEST_ASSERT_TRUE(r_is_nan(r_clamp((tse_real)NAN, 0, 1)));
#endif
}

static void test_broken_numbers_are_recognised_by_their_bits(void)
{
  TEST_ASSERT_TRUE(r_is_finite(TSE_R(0)) && r_is_finite(TSE_R(-1000)));
  TEST_ASSERT_FALSE(r_is_nan(TSE_R(1)));
#if !defined(TSE_REAL_Q20)
  TEST_ASSERT_TRUE(r_is_nan((tse_real)NAN) && r_is_nan(-(tse_real)NAN));
  TEST_ASSERT_FALSE(r_is_nan((tse_real)INFINITY) || r_is_nan((tse_real)-INFINITY));
  TEST_ASSERT_FALSE(r_is_finite((tse_real)NAN) || r_is_finite((tse_real)-INFINITY));
  TEST_ASSERT_TRUE(r_is_finite(real(3e38)) && r_is_finite(real(1e-40)));
#endif
}

static void test_settings_survive_the_way_there_and_back(void)
{
  const double x[] = { 0.0, 1.0, -1.0, 0.25, -1023.5, 2047.0 };
  for (size_t i = 0; i < ROWS(x); i++) {
    expect_same(x[i], real(x[i]), "setting");
    TEST_ASSERT_TRUE(held_exactly(x[i]));
  }
  for (int32_t n = -2047; n <= 2047; n++) {
    expect_same(n, r_from_int(n), "from_int");
  }
}

/* --------------------------------------------------------------------------------- accumulators */

static void test_numbers_leave_the_machine_in_units_of_2_to_the_minus_24(void)
{
  const double exact[] = { 0, 1, -1, 0.5, -0.25, 126.5, -126.5, 1.0 / 1048576, -3.0 / 1048576 };
  for (size_t i = 0; i < ROWS(exact); i++) {
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
    expect_near(n / 16777216, r_from_q24((int32_t)n), FIXED_HALF + 6.0e-8 * fabs(n / 16777216), "back", n);
  }
#if !defined(TSE_REAL_Q20)
  TEST_ASSERT_EQUAL_INT32(INT32_MIN, r_to_q24((tse_real)NAN));
  TEST_ASSERT_EQUAL_INT32(1, r_to_q24(real(0.6 / 16777216)));
  TEST_ASSERT_EQUAL_INT32(-1, r_to_q24(real(-0.6 / 16777216)));
#endif
}

static void test_sums_over_particles_equal_the_sum_in_double(void)
{
  enum { COUNT = 512 };
  uint32_t state = 5;
  tse_acc sum = acc_zero(), products = acc_zero(), halves[2];
  double expected = 0.0, expected_products = 0.0, magnitude = 0.0;
  halves[0] = halves[1] = acc_zero();
  for (int i = 0; i < COUNT; i++) {
    const tse_real w = r_uniform(next_word(&state)), x = r_mul(TSE_R(40), r_uniform(next_word(&state))) - TSE_R(20);
    sum = acc_add(sum, w);
    products = acc_add_mul(products, w, x);
    halves[i % 2] = acc_add_mul(halves[i % 2], w, x);
    expected += number(w);
    expected_products += number(w) * number(x);
    magnitude += fabs(number(w) * number(x));
  }
  /* n roundings, each half an ulp of a partial sum. q20 sums exactly and rounds once. */
#if defined(TSE_REAL_Q20)
  const double ulp = 0.0, round_once = 0.5 * LSB;
#else
  const double ulp = (sizeof(tse_real) == 4 ? ldexp(1.0, -24) : ldexp(1.0, -53)) * COUNT, round_once = 0.0;
#endif
  expect_near(expected, acc_to_real(sum), 2 * ulp * expected + round_once, "sum", COUNT);
  expect_near(expected_products, acc_to_real(products), 2 * ulp * magnitude + round_once, "sum of products", COUNT);
  expect_near(expected_products, acc_to_real(acc_merge(halves[0], halves[1])), 2 * ulp * magnitude + round_once,
              "merged sum", COUNT);
  expect_near(expected_products / expected, acc_div(products, sum), 4 * ulp * magnitude / expected + round_once,
              "weighted mean", COUNT);
  TEST_ASSERT_TRUE(acc_zero() < sum);
}

/* ------------------------------------------------------------------------------------------ q20 */
#if defined(TSE_REAL_Q20)

static const int32_t extreme[] = { INT32_MIN, INT32_MIN + 1, -1073741824, -1048577, -1048576, -3, -2, -1, 0, 1, 2, 3,
                                   524287, 524288, 1048575, 1048576, 1048577, 1073741824, INT32_MAX - 1, INT32_MAX };

/* Products and quotients of two int32 in long-hand: floor((2 n + d) / (2 d)) for d > 0, from 128 bits. */
__extension__ typedef __int128 wide;

static wide floor_div(wide n, wide d) { return n / d - (n % d < 0 ? 1 : 0); }

static int32_t limited(wide x) { return (int32_t)(x > INT32_MAX ? INT32_MAX : x < -INT32_MAX ? -INT32_MAX : x); }

static int32_t nearest_away(wide n, wide d)      /* n / d, ties away from zero, d != 0 */
{
  const wide an = n < 0 ? -n : n, ad = d < 0 ? -d : d, q = (2 * an + ad) / (2 * ad);
  return limited((n < 0) != (d < 0) ? -q : q);
}

static int32_t any_size(uint32_t *state)         /* words of all magnitudes */
{
  const int32_t word = (int32_t)(next_word(state) - 2147483648u);
  return word / ((int32_t)1 << (next_word(state) >> 27 & 30u));
}

static void expect_product_and_quotient(int32_t a, int32_t b)
{
  TEST_ASSERT_EQUAL_INT32(limited(floor_div((wide)a * b + 524288, 1048576)), r_mul(a, b));
  if (b != 0) {
    TEST_ASSERT_EQUAL_INT32(nearest_away((wide)a * 1048576, b), r_div(a, b));
  }
  TEST_ASSERT_EQUAL_INT32(limited((wide)a + b), r_add_sat(a, b));
  TEST_ASSERT_EQUAL_INT32(limited((wide)a - b), r_sub_sat(a, b));
}

static void test_q20_products_and_quotients_round_to_nearest_and_saturate(void)
{
  uint32_t state = 6;
  for (size_t i = 0; i < ROWS(extreme); i++) {
    for (size_t j = 0; j < ROWS(extreme); j++) {
      expect_product_and_quotient(extreme[i], extreme[j]);
    }
  }
  for (int i = 0; i < 300000; i++) {
    const int32_t a = any_size(&state);
    expect_product_and_quotient(a, any_size(&state));
  }
  TEST_ASSERT_EQUAL_INT32(1, r_mul(1, TSE_R(0.5)));            /* a tie goes up ... */
  TEST_ASSERT_EQUAL_INT32(0, r_mul(-1, TSE_R(0.5)));           /* ... also below zero */
}

static void test_q20_division_by_zero_saturates_with_the_sign_of_the_numerator(void)
{
  TEST_ASSERT_EQUAL_INT32(INT32_MAX, r_div(1, 0));
  TEST_ASSERT_EQUAL_INT32(-INT32_MAX, r_div(-1, 0));
  TEST_ASSERT_EQUAL_INT32(-INT32_MAX, r_div(INT32_MIN, 0));
  TEST_ASSERT_EQUAL_INT32(0, r_div(0, 0));
  TEST_ASSERT_EQUAL_INT32(0, acc_div(0, 0));
  TEST_ASSERT_EQUAL_INT32(INT32_MAX, acc_div(1, 0));
  TEST_ASSERT_EQUAL_INT32(-INT32_MAX, acc_div(-1, 0));
}

static void test_q20_results_can_always_be_negated(void)
{
  for (size_t i = 0; i < ROWS(extreme); i++) {
    for (size_t j = 0; j < ROWS(extreme); j++) {
      const int32_t a = extreme[i], b = extreme[j];
      tse_real s, c;
      r_sincos_turn(a, &s, &c);                              /* also: no undefined behaviour anywhere */
      const tse_real result[] = { r_mul(a, b), r_div(a, b), r_add_sat(a, b), r_sub_sat(a, b), r_atan2(a, b), r_abs(a),
                                  r_sqrt(a), r_log2(a), r_exp2(a), s, c, r_sqr(a), r_from_int(a),
                                  acc_to_real(acc_add_mul(acc_zero(), a, b)), acc_div(a, b) };
      for (size_t k = 0; k < ROWS(result); k++) {
        TEST_ASSERT_TRUE(result[k] > INT32_MIN);
      }
    }
  }
}

static void test_q20_square_root_is_nearest_for_every_kind_of_argument(void)
{
  uint32_t state = 7;
  for (int i = 0; i < 300000; i++) {
    const int32_t x = i < 100000 ? i : any_size(&state);
    const int64_t root = r_sqrt(x), square = (int64_t)(x < 0 ? 0 : x) * 1048576;
    /* root - 1/2 <= sqrt(square) <= root + 1/2, squared, without the quarter that integers cannot reach */
    TEST_ASSERT_TRUE(square <= root * root + root);
    TEST_ASSERT_TRUE(root == 0 || square > root * root - root);
  }
  TEST_ASSERT_EQUAL_INT32(0, r_sqrt(INT32_MIN));
}

static void test_q20_log2_never_decreases(void)
{
  int32_t last = r_log2(1);
  for (int64_t x = 1; x < 4194304; x++) {                     /* every number below 4 */
    const int32_t value = r_log2((int32_t)x);
    TEST_ASSERT_TRUE(last <= value);
    last = value;
  }
  for (int64_t x = 4194304; x <= INT32_MAX; x += 997) {
    const int32_t value = r_log2((int32_t)x);
    TEST_ASSERT_TRUE(last <= value);
    last = value;
  }
}

static void test_q20_log2_stays_near_double_everywhere(void)
{
  for (int64_t x = 1; x <= INT32_MAX; x += 1 + x / 100000) {
    expect_near(log2((double)x) - 20.0, r_log2((int32_t)x), FIXED_LOG2, "log2", (double)x * LSB);
  }
}

static void test_q20_exp2_never_decreases(void)
{
  int32_t last = 0;
  for (int32_t x = TSE_R(-22); x <= TSE_R(11); x += 7) {      /* 7 is odd: all residues of the octave occur */
    const int32_t value = r_exp2(x);
    TEST_ASSERT_TRUE(last <= value);
    last = value;
  }
  for (int32_t k = -22; k <= 10; k++) {
    for (int32_t j = -300; j < 300; j++) {
      TEST_ASSERT_TRUE(r_exp2(r_from_int(k) + j) <= r_exp2(r_from_int(k) + j + 1));
    }
  }
}

static void test_q20_exp2_stays_near_double_everywhere(void)
{
  for (int32_t x = TSE_R(-22); x < TSE_R(11); x += 101) {
    const double expected = exp2(x * LSB);
    expect_near(expected, r_exp2(x), 0.5 * LSB + REL_EXP2 * expected, "exp2", x * LSB);
  }
}

static void test_q20_sine_and_cosine_repeat_every_turn(void)
{
  for (int32_t t = 0; t < 1048576; t += 4099) {
    tse_real s0, c0, s1, c1;
    r_sincos_turn(t, &s0, &c0);
    r_sincos_turn(t - TSE_R(3), &s1, &c1);
    TEST_ASSERT_EQUAL_INT32(s0, s1);
    TEST_ASSERT_EQUAL_INT32(c0, c1);
  }
}

static void test_q20_sine_and_cosine_stay_near_double_everywhere(void)
{
  const double pi = 3.14159265358979323846;
  for (int32_t t = 0; t <= 1048576; t += 3) {
    tse_real s, c;
    r_sincos_turn(t, &s, &c);
    expect_near(sin(2 * pi * t * LSB), s, FIXED_SINCOS, "sin", t * LSB);
    expect_near(cos(2 * pi * t * LSB), c, FIXED_SINCOS, "cos", t * LSB);
  }
}

static void test_q20_atan2_stays_near_double_everywhere(void)
{
  uint32_t state = 8;
  for (int i = 0; i < 300000; i++) {
    const int32_t y = any_size(&state), x = any_size(&state);
    if (y != 0 || x != 0) {
      expect_near(atan2(y, x), r_atan2(y, x), FIXED_ATAN2, "atan2", y);
    }
  }
}

static void test_q20_settings_round_saturate_and_refuse_nan(void)
{
  TEST_ASSERT_EQUAL_INT32(1, r_from_setting(0.5 * LSB));
  TEST_ASSERT_EQUAL_INT32(-1, r_from_setting(-0.5 * LSB));
  TEST_ASSERT_EQUAL_INT32(0, r_from_setting(0.49 * LSB));
  TEST_ASSERT_EQUAL_INT32(INT32_MAX, r_from_setting(1e300));
  TEST_ASSERT_EQUAL_INT32(-INT32_MAX, r_from_setting(-1e300));
  TEST_ASSERT_EQUAL_INT32(0, r_from_setting((double)NAN));
  TEST_ASSERT_EQUAL_INT32(INT32_MAX, r_from_int(2048));
  TEST_ASSERT_EQUAL_INT32(-INT32_MAX, r_from_int(-2048));
}

static void test_q20_sums_are_exact_until_they_saturate(void)
{
  uint32_t state = 9;
  for (int round = 0; round < 2000; round++) {
    tse_acc sum = acc_zero();
    wide expected = 0;
    for (int i = 0; i < 20; i++) {
      const int32_t a = any_size(&state), b = any_size(&state);
      if (i % 3 == 0) {
        sum = acc_add(sum, a);
        expected += (wide)a * 1048576;
      } else {
        sum = acc_add_mul(sum, a, b);
        expected += (wide)a * b;
      }
      expected = expected > INT64_MAX ? INT64_MAX : expected < -INT64_MAX ? -INT64_MAX : expected;
    }
    TEST_ASSERT_EQUAL_INT64((int64_t)expected, sum);
    TEST_ASSERT_EQUAL_INT32(limited(floor_div(expected + 524288, 1048576)), acc_to_real(sum));
  }
  TEST_ASSERT_EQUAL_INT64(INT64_MAX, acc_merge(INT64_MAX, 1));
  TEST_ASSERT_EQUAL_INT64(-INT64_MAX, acc_merge(-INT64_MAX, -1));
  TEST_ASSERT_EQUAL_INT64(-INT64_MAX, acc_merge(INT64_MIN, INT64_MIN));
}

static void test_q20_quotient_of_sums_is_within_one_bit_of_nearest_at_any_size(void)
{
  uint32_t state = 10;
  for (int i = 0; i < 300000; i++) {
    const int64_t num = (int64_t)any_size(&state) * any_size(&state) * 2;
    const int64_t den = (int64_t)any_size(&state) * any_size(&state);
    const int32_t got = acc_div(num, den);
    if (den != 0) {
      const int32_t expected = nearest_away((wide)num * 1048576, den);
      /* The dropped digits of the denominator move the quotient by less than a quarter LSB. */
      TEST_ASSERT_TRUE(got - (int64_t)expected <= 1 && (int64_t)expected - got <= 1);
    }
  }
  TEST_ASSERT_EQUAL_INT32(TSE_R(1), acc_div(INT64_MAX, INT64_MAX));
  TEST_ASSERT_EQUAL_INT32(TSE_R(-1), acc_div(INT64_MIN, INT64_MAX));
  TEST_ASSERT_EQUAL_INT32(TSE_R(0.5), acc_div(1, 2));
  TEST_ASSERT_EQUAL_INT32(1, acc_div(1, 2097152));            /* a tie goes away from zero */
  TEST_ASSERT_EQUAL_INT32(-1, acc_div(-1, 2097152));
}
#endif

/* ------------------------------------------------------------------------------- reproducibility */

/* FNV-1a over the values, low byte first whatever the machine's order. */
static uint32_t digest(uint32_t hash, tse_real x)
{
  uint64_t bits = 0;
#if defined(TSE_REAL_Q20)
  bits = (uint32_t)x;
#elif defined(TSE_REAL_FLOAT)
  bits = f32_bits(x);
#else
  bits = f64_bits(x);
#endif
  for (size_t i = 0; i < sizeof x; i++) {
    hash = (hash ^ (uint32_t)(bits >> (8 * i) & 255u)) * 16777619u;
  }
  return hash;
}

static void test_every_machine_and_compiler_gives_the_same_bits(void)
{
#if defined(TSE_REAL_Q20)
  const uint32_t recorded = 0xa5fdfd18u;
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

int main(void)
{
  UNITY_BEGIN();
  RUN_TEST(test_log2_matches_the_reference);
  RUN_TEST(test_log2_of_a_power_of_two_is_exact);
  RUN_TEST(test_log2_never_decreases_over_the_seams_of_its_octaves);
  RUN_TEST(test_log2_of_a_broken_argument_is_defined);
  RUN_TEST(test_exp2_matches_the_reference);
  RUN_TEST(test_exp2_of_a_whole_number_is_exact);
  RUN_TEST(test_exp2_saturates_instead_of_overflowing);
  RUN_TEST(test_exp2_undoes_log2);
  RUN_TEST(test_sine_and_cosine_match_the_reference);
  RUN_TEST(test_sine_and_cosine_vanish_exactly_at_quarter_turns);
  RUN_TEST(test_sine_and_cosine_lie_on_the_unit_circle);
  RUN_TEST(test_atan2_matches_the_reference_in_every_quadrant);
  RUN_TEST(test_atan2_of_nothing_is_zero);
  RUN_TEST(test_square_root_is_the_nearest_number);
  RUN_TEST(test_uniform_is_open_at_both_ends_and_symmetric);
  RUN_TEST(test_uniform_follows_the_upper_bits_of_the_word);
  RUN_TEST(test_floor_rounds_down_on_both_sides_of_zero);
  RUN_TEST(test_min_max_abs_and_clamp_select_values);
  RUN_TEST(test_broken_numbers_are_recognised_by_their_bits);
  RUN_TEST(test_settings_survive_the_way_there_and_back);
  RUN_TEST(test_numbers_leave_the_machine_in_units_of_2_to_the_minus_24);
  RUN_TEST(test_sums_over_particles_equal_the_sum_in_double);
#if defined(TSE_REAL_Q20)
  RUN_TEST(test_q20_products_and_quotients_round_to_nearest_and_saturate);
  RUN_TEST(test_q20_division_by_zero_saturates_with_the_sign_of_the_numerator);
  RUN_TEST(test_q20_results_can_always_be_negated);
  RUN_TEST(test_q20_square_root_is_nearest_for_every_kind_of_argument);
  RUN_TEST(test_q20_log2_never_decreases);
  RUN_TEST(test_q20_log2_stays_near_double_everywhere);
  RUN_TEST(test_q20_exp2_never_decreases);
  RUN_TEST(test_q20_exp2_stays_near_double_everywhere);
  RUN_TEST(test_q20_sine_and_cosine_repeat_every_turn);
  RUN_TEST(test_q20_sine_and_cosine_stay_near_double_everywhere);
  RUN_TEST(test_q20_atan2_stays_near_double_everywhere);
  RUN_TEST(test_q20_settings_round_saturate_and_refuse_nan);
  RUN_TEST(test_q20_sums_are_exact_until_they_saturate);
  RUN_TEST(test_q20_quotient_of_sums_is_within_one_bit_of_nearest_at_any_size);
#endif
  RUN_TEST(test_every_machine_and_compiler_gives_the_same_bits);
  return UNITY_END();
}
