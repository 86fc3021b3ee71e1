/* model/effects/lateral_load_transfer.h - cornering stiffness C (1 - k a^2), a: lateral acceleration by the tyres with that very
 * stiffness. With a0 the one before: a = a0 (1 - k a^2), so a = 2 a0/(1 + sqrt(1 + 4 k a0^2)). Front k (1 + balance), rear
 * k (1 - balance); nothing below a tenth. Typical k 0.002 .. 0.005 s4/m2: -8 % at 5 m/s2. */
static inline void lateral_load_transfer_stiffness(point *pt)
{
  const tse_car *const c = &pt->p->car;
  const tse_real a0 = r_mul(pt->k.y_front, pt->s.a_front) + r_mul(pt->k.y_rear, pt->s.a_rear);
  const tse_real square = lateral_square(pt->p->effects.lateral_load_transfer_gain, tyre_pull(a0));
  pt->k.y_front = r_mul(pt->k.y_front, side_left(c->side_front, square));
  pt->k.y_rear = r_mul(pt->k.y_rear, side_left(c->side_rear, square));
}
