/* model/effects/relaxation.h - the tyre holds a slip angle a that follows the kinematic one: a' = (v/length)(alpha - a),
 * v = max(|vx|, low). Typical length 0.3 .. 0.7 m. The state is integrated by effects_step(). */
static inline void relaxation_slip(const tse_real lag[4], point *pt)
{
  pt->s.a_front = lag[0];
  pt->s.a_rear = lag[1];
}

/* [1/s] */
static inline tse_real relaxation_rate(const tse_effects *e, const point *pt)
{
  return r_div(TSE_R(1), r_mul(e->relaxation_length, pt->s.inv_body));
}
