/* tests/unit/filter/test_sensitivities.c <-> src/filter/sensitivities.c: each sensitivity
 * moves like the state, whatever the number of them. */
#include "filter/sensitivities.h"
#include "filter_support.h"

/* Fill all sensitivities with different numbers. */
static void fill(tse_kalman *k, uint32_t *seed)
{
  for (int n = 0; n < TSE_EVENTS; n++)
    for (int i = 0; i < TSE_ALL; i++) k->event[n].v[i] = short_of(next_between(seed, -1, 1));
  for (int q = 0; q < TSE_CONSIDERED; q++)
    for (int i = 0; i < TSE_ALL; i++) k->consider[q][i] = short_of(next_between(seed, -1, 1));
}

/* Any number of open events and of uncertain parameters. */
static void test_each_sensitivity_moves_as_the_state_does(void)
{
  uint32_t seed = 2;
  for (int run = 0; run < 40; run++) {
    static tse_kalman k, before;
    static tse_params p;
    tse_short M[MOTION][PLACES];
    memset(&k, 0, sizeof k);
    memset(&p, 0, sizeof p);
    fill(&k, &seed);
    for (int n = 0; n < TSE_EVENTS; n++) {
      k.event[n].kind = run > 0 && next_uniform(&seed) < 0.5 ? EVENT_ROAD : EVENT_NONE;
      k.event[n].age = TSE_R(1);
    }
    for (int q = 0; q < TSE_CONSIDERED; q++)
      p.uncertain[q] = real(run > 1 && next_uniform(&seed) < 0.5 ? 0.5 + 0.1 * q : 0);
    for (int i = 0; i < MOTION; i++)
      for (int j = 0; j < PLACES; j++) { /* as r_slope() and r_short() return them */
        const double x = next_between(&seed, -0.5, 0.5);
        M[i][j] = j < STATES ? slope_of(x) : short_of(x);
      }
    before = k;
    sensitivities_move(&p, &k, M, real(0.25));
    for (int s = 0; s < TSE_EVENTS + TSE_CONSIDERED; s++) {
      const int q = s - TSE_EVENTS, moves = q < 0 ? k.event[s].kind != EVENT_NONE : p.uncertain[q] > TSE_R(0);
      const tse_short *const from = q < 0 ? before.event[s].v : before.consider[q],
                             *const to = q < 0 ? k.event[s].v : k.consider[q];
      if (q < 0) expect_near(moves ? 1.25 : 1, number(k.event[s].age), 1e-6, "age", s);
      for (int i = 0; i < TSE_ALL; i++) {
        double expected = number_of(from[i]);
        if (moves && i < MOTION) {
          expected = q >= 0 && q < COLUMNS - STATES ? number_of(M[i][STATES + q]) * number(p.uncertain[q])
                                                    : 0;
          for (int j = 0; j < STATES; j++) expected += number_of_slope(M[i][j]) * number_of(from[j]);
        }
        expect_near(expected, number_of(to[i]), BY_NUMBER(1e-9, 1e-5, 1e-4), q < 0 ? "event" : "parameter",
            100 * s + i);
      }
    }
  }
}

/* The squares of all of them count, of open events and of every parameter, but not of the
 * slow states. In fixed point none becomes so large. */
static void test_the_motion_is_unknown_where_one_sensitivity_is_huge(void)
{
  static tse_kalman k;
  for (int s = 0; s < TSE_EVENTS + TSE_CONSIDERED && BY_NUMBER(1, 1, 0); s++)
    for (int i = 0; i < STATES; i++)
      for (int is_open = 0; is_open < 2; is_open++) {
        memset(&k, 0, sizeof k);
        tse_short *const v = s < TSE_EVENTS ? k.event[s].v : k.consider[s - TSE_EVENTS];
        if (s < TSE_EVENTS && is_open) k.event[s].kind = EVENT_ROAD;
        v[i] = short_of(-999);
        TEST_ASSERT_TRUE(are_sensitivities_known(&k));
        v[i] = short_of(-1001);
        TEST_ASSERT_EQUAL_INT(
            i < MOTION && (is_open || s >= TSE_EVENTS) ? 0 : 1, are_sensitivities_known(&k));
      }
}

/* Fading is of one state, in all sensitivities. Parts of the variance that parameters
 * cause are added to its own. */
static void test_a_state_fades_and_is_uncertain_in_all_sensitivities(void)
{
  static tse_kalman k, before;
  uint32_t seed = 4;
  for (int at = 0; at < STATES; at++) {
    memset(&k, 0, sizeof k);
    fill(&k, &seed);
    for (int i = 0; i < STATES; i++) k.ud.d[i] = TSE_R(2);
    double var = 2;
    for (int q = 0; q < TSE_CONSIDERED; q++) var += pow(number_of(k.consider[q][at]), 2);
    expect_near(var, number(compute_total_variance(&k, at)), BY_NUMBER(1e-9, 1e-4, 1e-3), "variance", at);
    before = k;
    sensitivities_fade(&k, at, real(0.25));
    for (int i = 0; i < TSE_ALL; i++) {
      const double left = i == at ? 0.25 : 1;
      for (int n = 0; n < TSE_EVENTS; n++)
        expect_near(left * number_of(before.event[n].v[i]), number_of(k.event[n].v[i]),
            BY_NUMBER(1e-9, 1e-6, 1e-4), "event", i);
      for (int q = 0; q < TSE_CONSIDERED; q++)
        expect_near(left * number_of(before.consider[q][i]), number_of(k.consider[q][i]),
            BY_NUMBER(1e-9, 1e-6, 1e-4), "parameter", i);
    }
  }
}
