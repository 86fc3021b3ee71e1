/* estimator/told.c - an estimator that is told of effects (tse/effects.def).
 *
 * Filters know the plain model only. Once a row, the effects are evaluated at what is believed on average, by the model that
 * simulator and replay use, and what they make of it is common to all particles or hypotheses:
 *   inputs     the steering angle becomes that of the wheels
 *   constants  kx, ky of this row are those of the mean's slips (secants), accelerometers read as the IMU does
 *   motion     everything moves by what the mean moves more with the effects than without
 *   sample     is corrected by what the mean reads more with the effects than without
 * So the mean follows the model with effects, exactly; only how the rest differs from it is the plain model's.
 * While wheels slide, inputs are missing or rows are far apart there is no correction; memory then starts anew. */
#include "estimator/stages.h"

#if defined(TSE_NO_EFFECTS) /* tse_prepare() has refused all effects that have a say here */

sample told_inputs(const tse_params *p, tse_filter *f, const sample *y, tse_params *row)
{
  (void)f;
  *row = *p;
  return *y;
}

void told_motion(const tse_params *p, const tse_params *row, tse_filter *f, const sample *y, const tse_real at[6], tse_real push[3])
{
  (void)p;
  (void)row;
  (void)f;
  (void)y;
  (void)at;
  push[0] = push[1] = push[2] = TSE_R(0);
}

sample told_sample(const tse_params *p, tse_params *row, tse_filter *f, const sample *y, const tse_real at[6], int moved, int known)
{
  (void)p;
  (void)row;
  (void)f;
  (void)at;
  (void)moved;
  (void)known;
  return *y;
}

#else

#include "model/effects.h"

#define MOST_PUSH TSE_R(2)     /* m/s, rad/s in a row: more is no effect but a state that is lost */
#define LONGEST_LOSS TSE_R(3600) /* s: an angle that was lost for longer is a new one */

static void scale(const tse_params *p, const tse_real level[4], tse_params *row)
{
  row->kx_front = r_mul(p->kx_front, level[0]);
  row->kx_rear = r_mul(p->kx_rear, level[1]);
  row->ky_front = r_mul(p->ky_front, level[2]);
  row->ky_rear = r_mul(p->ky_rear, level[3]);
}

/* NaN becomes LEAST_LEVEL. */
static tse_real level_of(tse_real with, tse_real without) { return r_min(r_max(r_div(with, without), LEAST_LEVEL), MOST_LEVEL); }

static void begin_at(point *pt, const tse_real at[6], inputs u)
{
  memset(pt, 0, sizeof *pt);
  pt->vx = at[0];
  pt->vy = at[1];
  pt->r = at[2];
  pt->u = u;
}

sample told_inputs(const tse_params *p, tse_filter *f, const sample *y, tse_params *row)
{
  sample at_wheels = *y;
  *row = *p;
  if (f->effects.settled) scale(p, f->effect_level, row);
  if (y->has_steer) at_wheels.u.steer = effects_steer(&p->effects, &f->effects, y->u.steer, y->dt + f->effects.steer_lost);
  f->effects.steer_lost = y->has_steer ? TSE_R(0) : r_min(f->effects.steer_lost + y->dt, LONGEST_LOSS);
  return at_wheels;
}

void told_motion(const tse_params *p, const tse_params *row, tse_filter *f, const sample *y, const tse_real at[6], tse_real push[3])
{
  const inputs from = { f->steer, f->v_front, f->v_rear };
  tse_real plain[3] = { at[0], at[1], at[2] };
  point pt;
  begin_at(&pt, at, from);
  const given none = pt.g;
  const stiffness k = vehicle_stiffness(p, at[3], at[4], at[5]);
  if (f->effects.settled) effects_at(p, &f->effects, f->effects.lag, k, &pt);
  else effects_settle(p, &f->effects, k, &pt);
  effects_advance(p, &f->effects, k, y->u, &none, y->dt, &pt);
  vehicle_advance(row, plain, vehicle_stiffness(row, at[3], at[4], at[5]), from, y->u, y->dt);
  push[0] = pt.vx - plain[0];
  push[1] = pt.vy - plain[1];
  push[2] = pt.r - plain[2];
  for (int a = 0; a < 3; a++)
    if (!(r_abs(push[a]) < MOST_PUSH)) { /* NaN, too */
      push[0] = push[1] = push[2] = TSE_R(0);
      effects_unsettle(&f->effects);
    }
}

sample told_sample(const tse_params *p, tse_params *row, tse_filter *f, const sample *y, const tse_real at[6], int moved, int known)
{
  sample corrected = *y;
  tse_real read[3];
  point pt;
  if (!moved || !known) effects_unsettle(&f->effects);
  if (!known) return corrected;
  begin_at(&pt, at, y->u);
  const stiffness k = vehicle_stiffness(p, at[3], at[4], at[5]);
  if (f->effects.settled) effects_at(p, &f->effects, f->effects.lag, k, &pt);
  else effects_settle(p, &f->effects, k, &pt);
  effects_sense(&p->effects, &f->effects, &pt, y->dt, read);

  f->effect_level[0] = level_of(pt.k.x_front, k.x_front);
  f->effect_level[1] = level_of(pt.k.x_rear, k.x_rear);
  f->effect_level[2] = level_of(pt.k.y_front, k.y_front);
  f->effect_level[3] = level_of(pt.k.y_rear, k.y_rear);
  scale(p, f->effect_level, row);

  const observation o = vehicle_observation(vehicle_observation_gains(row, TSE_R(1), TSE_R(1)),
                                            vehicle_slips(row, at[0], at[1], at[2], y->u), y->u.steer);
  const tse_real plain[3] = { o.h1 + r_mul(o.d11, at[3]) + r_mul(o.d12, at[4]),
                              o.h2 + r_mul(o.d21, at[3]) + r_mul(o.d22, at[4]) + r_mul(o.d23, at[5]),
                              r_mul(at[2], p->inv_sd[2]) };
  for (int a = 0; a < 3; a++) {
    const tse_real more = r_mul(read[a], p->inv_sd[a]) - plain[a];
    if (r_is_finite(more)) corrected.y[a] = r_mul(y->use[a], y->y[a] - more);
    else effects_unsettle(&f->effects);
  }
  return corrected;
}

#endif
