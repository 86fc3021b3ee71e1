/* model/effects/tyre_saturation.h - secant of the lateral force over its stiffness, with x = C |alpha|/(friction load):
 *   brush model with parabolic pressure: 1 - x/3 + x^2/27 up to x = 3, then 1/x        root: 1/sqrt(1 + x^2)
 * Both have slope C at 0 and end at friction times load; `shape` mixes them, for a tyre is neither. Typical friction 1 .. 1.1. */
static inline tse_real tyre_saturation_secant(tse_real x, tse_real shape)
{
  const tse_real z = r_mul(TSE_R(1.0 / 3), x);
  const tse_real brush = z < TSE_R(1) ? TSE_R(1) - z + r_mul(TSE_R(1.0 / 3), r_mul(z, z)) : r_div(TSE_R(1), x);
  if (!(shape > TSE_R(0))) return brush;
  return brush + r_mul(shape, r_div(TSE_R(1), r_sqrt(TSE_R(1) + r_mul(x, x))) - brush);
}

static inline void tyre_saturation_stiffness(const tse_params *p, const tse_effect_memory *m, point *pt)
{
  const tse_effects *const e = &p->effects;
  const tse_real inv = e->tyre_saturation_inverse_friction;
  (void)m;
  const tse_real front = r_div(r_mul(inv, r_mul(pt->k.y_front, r_abs(pt->s.a_front))), e->load_front);
  const tse_real rear = r_div(r_mul(inv, r_mul(pt->k.y_rear, r_abs(pt->s.a_rear))), e->load_rear);
  pt->k.y_front = r_mul(pt->k.y_front, tyre_saturation_secant(front, e->tyre_saturation_shape));
  pt->k.y_rear = r_mul(pt->k.y_rear, tyre_saturation_secant(rear, e->tyre_saturation_shape));
}
