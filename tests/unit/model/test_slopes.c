/* tests/unit/model/test_slopes.c <-> src/model/slopes.h: against central differences of the forces by their definition. */
#include "unit_support.h"
#include "hypotheses_support.h"

static tse_params a_car(double follows)
{
  tse_config c;
  tse_config_default(&c);
  c.mass = setting(1500);
  c.lf = setting(1.1);
  c.longitudinal_stiffness_rear = setting(1.2e5);
  c.rear_longitudinal_follows_front = setting(follows);
  return prepared(&c);
}

static void force_at(const tse_params *p, const double at[9], double force[3])
{
  const double u[3] = { at[6], at[7], at[8] };
  ref_forces(p, at, u, force);
}

static void expect_slopes(const tse_params *p, double at[9], int index)
{
  tse_real x[6];
  slopes s;
  for (int i = 0; i < 6; i++) at[i] = number(x[i] = real(at[i]));
  const inputs u = inputs_of(at[6], at[7], at[8]);
  at[6] = number(u.steer);
  at[7] = number(u.v_front);
  at[8] = number(u.v_rear);
  vehicle_slopes(p, x, u, NULL, &s);
  double force[3];
  force_at(p, at, force);
  const double got[3] = { number(s.x), number(s.front), number(s.rear) };
  for (int k = 0; k < 3; k++) expect_near(force[k], got[k], BY_FORMAT(1e-11, 2e-4) * (1 + fabs(force[k])), "force", index);
  for (int c = 0; c < SLOPES; c++) {
    double lo[9], hi[9], below[3], above[3];
    memcpy(lo, at, sizeof lo);
    memcpy(hi, at, sizeof hi);
    lo[c] -= 1e-6;
    hi[c] += 1e-6;
    force_at(p, lo, below);
    force_at(p, hi, above);
    const double slope[3] = { number(s.dx[c]), number(s.dfront[c]), number(s.drear[c]) };
    for (int k = 0; k < 3; k++) {
      const double expected = (above[k] - below[k]) / 2e-6;
      expect_near(expected, slope[k], BY_FORMAT(1e-6, 2e-4) * (1 + fabs(expected)), "slope", 1000 * index + 10 * c + k);
    }
  }
}

static void test_slopes_are_those_of_the_forces_at_any_speed_and_slip(void)
{
  const tse_params p[2] = { a_car(1), a_car(0.3) };
  uint32_t seed = 7;
  for (int i = 0; i < 400; i++) {
    double v = next_between(&seed, -5, 40);
    if (i % 5 == 0) v = next_between(&seed, -0.9, 0.9); /* slip over LOW_SPEED */
    double at[9] = { v, next_between(&seed, -2, 2), next_between(&seed, -0.6, 0.6), next_between(&seed, 0.3, 2), next_between(&seed, 0.3, 2),
                     next_between(&seed, 0.3, 2), next_between(&seed, -0.3, 0.3), v + next_between(&seed, -2, 2), v + next_between(&seed, -2, 2) };
    if (fabs(fabs(at[0]) - 1) < 0.01 || fabs(fabs(at[7]) - fabs(at[0])) < 0.01 || fabs(fabs(at[8]) - fabs(at[0])) < 0.01 ||
        fabs(fabs(at[7]) - 1) < 0.01 || fabs(fabs(at[8]) - 1) < 0.01) continue; /* kinks */
    expect_slopes(&p[i % 2], at, i);
  }
}

static void test_smoothed_slips_are_in_the_slopes_by_the_longitudinal_stiffness_alone(void)
{
  const tse_params p = a_car(0.5);
  const tse_real x[6] = { real(20), real(0.2), real(0.1), real(1), real(1), real(1) }, smooth[2] = { real(0.004), real(-0.003) };
  const inputs u = inputs_of(0.05, 20.3, 19.9);
  slopes own, smoothed;
  vehicle_slopes(&p, x, u, NULL, &own);
  vehicle_slopes(&p, x, u, smooth, &smoothed);
  expect_near(number(p.kx_front) * 0.004 - 0.5 * number(p.kx_rear) * 0.003, number(smoothed.dx[3]), BY_FORMAT(1e-12, 1e-5), "dx", 3);
  expect_near(number(p.kx_front) * 0.004 * 0.05, number(smoothed.dfront[3]), BY_FORMAT(1e-12, 1e-5), "dfront", 3);
  TEST_ASSERT_TRUE(fabs(number(own.dx[3]) - number(smoothed.dx[3])) > 0.1);
  smoothed.dx[3] = own.dx[3];
  smoothed.dfront[3] = own.dfront[3];
  TEST_ASSERT_EQUAL_MEMORY(&own, &smoothed, sizeof own);
}

int main(void)
{
  UNITY_BEGIN();
  RUN_TEST(test_slopes_are_those_of_the_forces_at_any_speed_and_slip);
  RUN_TEST(test_smoothed_slips_are_in_the_slopes_by_the_longitudinal_stiffness_alone);
  return UNITY_END();
}
