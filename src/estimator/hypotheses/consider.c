/* estimator/hypotheses/consider.c - errors by what is told, as linear recursions: off+ = F off + B dt, off - K (H off + D). */
#include "estimator/hypotheses/consider.h"

#define MOST_OFF TSE_R(1e6) /* of any part of X: more says no more, and what is no number becomes it */

static tse_real kept(tse_real off) { return r_abs(off) < MOST_OFF ? off : MOST_OFF; }

/* What one unit of a quantity adds: accelerations of vel_x, vel_y and of the yaw rate; forces over mass, as accelerometers feel them;
 * forces that they feel and that do not move the car; to what accel_y reads beside [sigma]. */
typedef struct addition { tse_real motion[3], x, front, rear, late[3], scale; } addition;

/* Forces by an input that is off: column c of the slopes, so much. */
static void by_input(const slopes *s, int c, tse_real by, addition *a)
{
  a->x += r_mul(by, s->dx[c]);
  a->front += r_mul(by, s->dfront[c]);
  a->rear += r_mul(by, s->drear[c]);
}

static void add(const tse_params *p, const tse_bank *b, int k, inputs u, const innovation *o, const slopes *s, addition *a)
{
  const tse_hypothesis *const h = &b->h[b->likeliest];
  const tse_real r = h->x[2];
  tse_real turn = TSE_R(0);
  memset(a, 0, sizeof *a);
  switch (k) {
    case TSE_CONSIDER_INERTIA: turn = -(r_mul(p->jf, s->front) - r_mul(p->jr, s->rear)); break;
    case TSE_CONSIDER_CENTRE: /* further in front: lf shorter, lr longer */
      a->x = -r_mul(s->dx[1], r);
      a->front = -r_mul(s->dfront[1], r);
      a->rear = -r_mul(s->drear[1], r);
      turn = -r_div(r_mul(p->jf, s->front), p->lf) - r_div(r_mul(p->jr, s->rear), p->lr);
      break;
    case TSE_CONSIDER_RATIO: by_input(s, BY_STEER, u.steer, a); break;
    case TSE_CONSIDER_OFFSET: by_input(s, BY_STEER, TSE_R(1), a); break;
    case TSE_CONSIDER_SCALE: a->scale = o ? o->forecast[1] : TSE_R(0); break;
    case TSE_CONSIDER_WHEELS_LATE:
      by_input(s, BY_FRONT_WHEELS, b->rate[3], a);
      by_input(s, BY_REAR_WHEELS, b->rate[4], a);
      break;
    case TSE_CONSIDER_ACCEL_LATE:
      a->late[0] = -b->rate[0];
      a->late[1] = -b->rate[1];
      a->late[2] = -b->rate[2];
      break;
    case TSE_CONSIDER_RELAXATION: {
      const tse_real per = -r_div(TSE_R(1), r_max(r_abs(h->x[0]), LOW_SPEED));
      a->front = r_mul(per, b->rate[1]);
      a->rear = r_mul(per, b->rate[2]);
      break;
    }
    default: by_input(s, BY_REAR_WHEELS, u.v_rear, a); break;
  }
  a->motion[0] += a->x;
  a->motion[1] += a->front + a->rear;
  a->motion[2] += r_mul(p->jf, a->front) - r_mul(p->jr, a->rear) + turn;
}

static void slopes_of(const tse_params *p, const tse_bank *b, inputs u, slopes *s)
{
  const tse_hypothesis *const h = &b->h[b->likeliest];
  vehicle_slopes(p, h->x, u, slips_for_slopes(p, h), s);
}

void consider_begin(const tse_params *p, tse_bank *b, inputs from)
{
  slopes s;
  slopes_of(p, b, from, &s);
  const tse_real at[5] = { s.x, s.front, s.rear, from.v_front, from.v_rear };
  memcpy(b->rate, at, sizeof at);
}

void consider_passage(const tse_params *p, tse_bank *b, const transition *t, inputs u, tse_real dt)
{
  slopes s;
  slopes_of(p, b, u, &s);
  const tse_real at[5] = { s.x, s.front, s.rear, u.v_front, u.v_rear };
  const tse_real time = r_max(dt, p->least_step); /* over next to no time a difference is noise */
  for (int i = 0; i < 5; i++) b->rate[i] = r_div(at[i] - b->rate[i], time);
  const tse_real half = r_mul(TSE_R(0.5), dt), keep = r_exp2(-r_mul(LOG2_E, r_div(dt, DISTURBANCE_TIME)));
  for (int k = 0; k < TSE_CONSIDERED; k++) {
    tse_real *const off = b->off[k];
    tse_real moved[3];
    addition a;
    if (!(p->consider_sd[k] > TSE_R(0))) continue;
    add(p, b, k, u, NULL, &s, &a);
    for (int i = 0; i < 3; i++) {
      moved[i] = r_mul(t->L[i], off[X_LAG]) + r_mul(r_mul(half, p->consider_sd[k]), a.motion[i]);
      for (int j = 0; j < 3; j++) {
        const tse_real before = off[j] + r_mul(r_mul(half, p->consider_sd[k]), a.motion[j]);
        moved[i] += r_mul(t->F[i][j], before) + r_mul(t->G[i][j], off[X_STIFFNESS + j]);
      }
    }
    for (int i = 0; i < 3; i++) {
      off[i] = kept(moved[i]);
      off[X_SLOW + i] = r_mul(keep, off[X_SLOW + i]);
    }
  }
}

void consider_sample(const tse_params *p, tse_bank *b, const sample *y, const innovation *o)
{
  const tse_hypothesis *const h = &b->h[b->likeliest];
  const tse_real trust = trust_of(o);
  const tse_real gain[3] = { r_mul(o->use[0], r_mul(p->inv_sd[0], p->read_x)), r_mul(o->use[1], r_mul(p->inv_sd[1], p->read_y_front)),
                             r_mul(o->use[1], r_mul(p->inv_sd[1], p->read_y_rear)) };
  const int learns = !(h->fault > FAULT_NONE && h->fault < FAULT_MEASURED);
  const course c = { y->u, y->late_steer };
  const inputs u = acting(h, c);
  slopes s;
  slopes_of(p, b, u, &s);
  for (int k = 0; k < TSE_CONSIDERED; k++) {
    tse_real *const off = b->off[k];
    tse_real e[3], se[3];
    addition a;
    if (!(p->consider_sd[k] > TSE_R(0))) continue;
    add(p, b, k, u, o, &s, &a);
    const tse_real read[3] = { r_mul(gain[0], a.x + a.late[0]),
                               r_mul(gain[1], a.front + a.late[1]) + r_mul(gain[2], a.rear + a.late[2]) + in_units(o, 1, a.scale), TSE_R(0) };
    for (int i = 0; i < 3; i++) {
      e[i] = r_mul(o->use[i], off[X_BIAS + i] + off[X_SLOW + i]) + r_mul(o->lag[i], off[X_LAG]) + r_mul(p->consider_sd[k], read[i]);
      for (int j = 0; j < 6; j++) e[i] += r_mul(o->h[i][j], off[j]);
    }
    for (int i = 0; i < 3; i++) se[i] = r_mul(trust, r_mul(o->inv[i][0], e[0]) + r_mul(o->inv[i][1], e[1]) + r_mul(o->inv[i][2], e[2]));
    for (int i = 0; i < TSE_X; i++)
      if (learns || i < X_STIFFNESS || i >= X_BIAS)
        off[i] = kept(off[i] - (r_mul(o->ph[0][i], se[0]) + r_mul(o->ph[1][i], se[1]) + r_mul(o->ph[2][i], se[2])));
  }
}

void consider_restart(tse_bank *b, int with_tyres)
{
  memset(b->rate, 0, sizeof b->rate);
  for (int k = 0; k < TSE_CONSIDERED; k++)
    for (int i = 0; i < (with_tyres ? TSE_X : X_STIFFNESS); i++) b->off[k][i] = TSE_R(0);
}

tse_real considered_var(const tse_params *p, const tse_bank *b, int i)
{
  tse_real sum = TSE_R(0);
  for (int k = 0; k < TSE_CONSIDERED; k++) sum = r_add_sat(sum, p->consider_sd[k] > TSE_R(0) ? r_sqr(b->off[k][i]) : TSE_R(0));
  return sum;
}

tse_status tse_told_sd(const tse_params *p, const tse_filter *f, int32_t k, tse_real sd[3])
{
  if (!p || !f || !sd) return TSE_E_NULL;
  if (k < 0 || k >= TSE_TOLD) return TSE_E_SIZE;
  if (p->magic != TSE_PARAMS_MAGIC || f->magic != TSE_FILTER_MAGIC || f->fingerprint != p->fingerprint || p->form != 0) return TSE_E_STATE;
  for (int a = 0; a < 3; a++) {
    const int c = X_STIFFNESS + a;
    const tse_real level = f->bank.h[f->bank.likeliest].x[c];
    if (k == 0) sd[a] = r_mul(r_sqrt(p->mass_var), level);
    else if (k == TSE_CONSIDERED + 1) sd[a] = r_mul(r_sqrt(p->model_var), level);
    else sd[a] = r_abs(f->bank.off[k - 1][c]);
  }
  return TSE_OK;
}
