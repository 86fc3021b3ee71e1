/* estimator/settings.c - settings: defaults, values of an ordinary car for settings that
 * are 0 ("not set"), active effects. */
#include "estimator/settings.h"
#include "tables/config_rows.h"

const real_row setting_reals[REALS] = { SETTINGS(CONFIG_REAL, NO_ROW) };
const whole_row setting_wholes[WHOLES] = { SETTINGS(NO_ROW, CONFIG_WHOLE) };
const effect_row setting_effects[COUNT_EFFECTS] = { EFFECT_PARAMETERS(EFFECT_OF, ) };

void tse_config_default(tse_config *c)
{
  if (c) set_defaults(c, setting_reals, REALS, setting_wholes, WHOLES);
}

void tse_config_exact(tse_config *c)
{
  if (!c) return;
  tse_config_default(c);
  for (size_t i = 0; i < sizeof exact / sizeof exact[0]; i++)
    memcpy((uint8_t *)c + exact[i].at, &exact[i].value, sizeof exact[i].value);
}

/* Return the stiffness of an axle: the setting or, if the setting is 0, the stiffness of
 * an ordinary car with the same load of this axle.
 *   Given:  as_set      the setting
 *           share       ratio of stiffness to load of this axle in an ordinary car:
 *                       [1/rad] cornering, [1] longitudinal
 *           other_axle  [m] distance of the other axle from the centre of gravity */
static tse_setting choose_stiffness(
    const tse_config *c, tse_setting as_set, tse_setting share, tse_setting other_axle)
{
  const tse_setting mass = c->mass > 0 ? c->mass : TSE_S(CLASS_MASS);
  const tse_setting weight = r_mul(STANDARD_GRAVITY, r_div(mass, c->lf + c->lr));
  return as_set > 0 ? as_set : r_mul(share, r_mul(weight, other_axle));
}

static tse_setting get_cornering_front(const tse_config *c)
{
  return choose_stiffness(c, c->cornering_stiffness_front, TSE_S(CLASS_CORNERING_FRONT), c->lr);
}
static tse_setting get_cornering_rear(const tse_config *c)
{
  return choose_stiffness(c, c->cornering_stiffness_rear, TSE_S(CLASS_CORNERING_REAR), c->lf);
}
static tse_setting get_longitudinal_front(const tse_config *c)
{
  return choose_stiffness(c, c->longitudinal_stiffness_front, TSE_S(CLASS_LONGITUDINAL), c->lr);
}
static tse_setting get_longitudinal_rear(const tse_config *c)
{
  return choose_stiffness(c, c->longitudinal_stiffness_rear, TSE_S(CLASS_LONGITUDINAL), c->lf);
}

void tse_config_complete(tse_config *c)
{
  if (!c) return;
  c->longitudinal_stiffness_front = get_longitudinal_front(c);
  c->longitudinal_stiffness_rear = get_longitudinal_rear(c);
  c->cornering_stiffness_front = get_cornering_front(c);
  c->cornering_stiffness_rear = get_cornering_rear(c);
  if (!(c->mass > 0)) {
    c->mass = TSE_S(CLASS_MASS);
    if (c->mass_sd < TSE_S(CLASS_MASS_SD)) c->mass_sd = TSE_S(CLASS_MASS_SD);
  }
  if (!(c->yaw_inertia > 0)) c->yaw_inertia = r_mul(c->mass, r_mul(c->lf, c->lr));
}

void tse_config_paper(tse_config *c)
{
  if (!c) return;
  tse_config_exact(c);
  c->form = 1;
  c->exact_kinematics_share = TSE_S(0); /* small angles: equations (1) to (4) of the paper */
  /* the paper's "30 %" is both the spread (sd of the stiffness from sample to sample),
   * set here, and the sd of the initial mean, initial_mean_sd, whose default is 0.3 */
  c->initial_spread = TSE_S(0.3);
  c->initial_vel_x_sd = c->initial_vel_y_sd = TSE_S(1);
  c->initial_yaw_rate_sd = TSE_S(0.017453292519943295);
  c->stiffness_max = TSE_S(20); /* largest allowed value: in effect no limit */
}

void tse_config_robust(tse_config *c)
{
  if (!c) return;
  tse_config_exact(c);
  c->form = 1;
  c->exact_kinematics_share = TSE_S(0);
  c->integration = 1;
  c->initial_vel_y_sd = TSE_S(1);
  c->initial_yaw_rate_sd = TSE_S(0.017453292519943295);
  c->reflect_draws = 1;
  c->forgetting = TSE_S(0.998);
  c->forgetting_mean = TSE_S(0.98);
  c->forgetting_change = TSE_S(0.9);
  c->initial_spread = TSE_S(0.15);
  c->spread_max = TSE_S(0.7);
  c->spread_kernel = TSE_S(0.03);
}

void tse_stiffness_si(
    const tse_config *c, const tse_output *y, tse_setting mean[3], tse_setting sd[3], tse_setting spread[3])
{
  if (!c || !y) return;
  const tse_setting nominal[3] = { get_longitudinal_front(c), get_cornering_front(c), get_cornering_rear(c) };
  for (int i = 0; i < 3; i++) {
    if (mean) mean[i] = r_mul(nominal[i], r_to_setting(y->stiffness[i]));
    if (sd) sd[i] = r_mul(nominal[i], r_to_setting(y->stiffness_sd[i]));
    if (spread) spread[i] = r_mul(nominal[i], r_to_setting(y->stiffness_spread[i]));
  }
}

/* Return whether the user's formula is active: it has a program,
 * and its gain is not 0. */
static int has_formula(const tse_config *c)
{
#if defined(TSE_FORMULA)
  const int there = 1;
#else
  const int there = (c->formula_code_1 & 0xff) != 0;
#endif
  return there && (c->formula_gain < 0 || c->formula_gain > 0);
}

uint64_t find_active_effects(const tse_config *c)
{
  uint64_t mask = 0;
  for (int i = 0; i < COUNT_EFFECTS; i++) {
    const tse_setting x = real_at(c, &setting_reals[FIRST_EFFECTS + i]);
    if (setting_effects[i].strength && (x < 0 || x > 0)) mask |= (uint64_t)1 << setting_effects[i].effect;
  }
  if (has_formula(c)) mask |= (uint64_t)1 << TSE_BIT_FORMULA;
  return mask;
}

#if !defined(TSE_NO_EFFECTS)
void unpack_formula(const tse_config *c, uint8_t code[TSE_FORMULA_OPS])
{
  for (int k = 0; k < TSE_FORMULA_OPS; k++)
    code[k] = (uint8_t)(((uint32_t)whole_at(c, &setting_wholes[FIRST_WHOLE_FORMULA + 1 + k / 3])
                            >> (8 * (k % 3)))
        & 0xffu);
}
#endif
