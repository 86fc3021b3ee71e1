/* model/catalogue.h - the effects of src/tables/effects.toml that act in the model, in
 * the order of that table. The comment of an effect gives its equation and its typical
 * size. delta is the steering angle, g gravity, m the mass, I the yaw inertia.
 *
 * The functions of an effect are named <effect>_<hook>(). A hook is the place in
 * effects.h at which a function is called. The effects of hook CONSTANT change only
 * settings, before the model runs, and are in effects_constant.h. */
#ifndef TSE_SRC_CATALOGUE_H
#define TSE_SRC_CATALOGUE_H

#include "model/point.h"

#if !defined(TSE_NO_EFFECTS)

/* steering_ratio: the wheels have the angle delta (1 + change). Typical 0.02 .. 0.06. */
static inline tse_real steering_ratio_input(
    const tse_effects *e, tse_effect_memory *m, tse_real steer, tse_real dt)
{
  (void)m;
  (void)dt;
  return steer + r_mul(e->steering_ratio_change, steer);
}

/* steering_offset: the wheels have the angle delta + angle. Typical 0.1 .. 0.5
 * degrees. */
static inline tse_real steering_offset_input(
    const tse_effects *e, tse_effect_memory *m, tse_real steer, tse_real dt)
{
  (void)m;
  (void)dt;
  return steer + e->steering_offset_angle;
}

/* steering_delay: the wheels have the angle delta(t - time), interpolated linearly
 * between rows. Typical 10 .. 40 ms. */
static inline tse_real steering_delay_input(
    const tse_effects *e, tse_effect_memory *m, tse_real steer, tse_real dt)
{
  effects_delay_put(&m->steer, m->steer_was, e->steering_delay_time, dt, &steer, 1);
  return effects_delay_get(&m->steer, m->steer_was[0], e->steering_delay_time);
}

/* steering_lag: two first-order lags in series between the logged angle and the wheels.
 * The time constant of the first lag is T = time/(1 + second), that of the second lag is
 * `second` times T. Their sum is `time`. If `second` is 0, there is one lag. The first
 * lag is T delta_e' = delta - delta_e (`lagged` in laws.h). Typical time 20 .. 60 ms. */
static inline tse_real steering_lag_input(
    const tse_effects *e, tse_effect_memory *m, tse_real steer, tse_real dt)
{
  const tse_real first = r_div(e->steering_lag_time, TSE_R(1) + e->steering_lag_second),
                 second = r_mul(first, e->steering_lag_second);
  if (m->steered) lag_steering(first, second, steer, dt, m->steered_by);
  else m->steered_by[0] = m->steered_by[1] = m->steered_by[2] = steer;
  return m->steered_by[2];
}

/* exact_kinematics: equations (1) to (4) of the paper, without small-angle approximations
 * (vehicle_slips in vehicle.h). In its own axes the front wheel has the velocity
 *   v_x = vx cos d + (vy + lf r) sin d,  v_y = (vy + lf r) cos d - vx sin d,  d = delta
 * The front slip is (R omega - v_x)/max(|v_x|, |R omega|, 1 m/s). The front slip angle is
 * atan(-v_y/|v_x|). The rear slip angle is atan((lr r - vy)/|vx|). The front forces are
 * turned by d. With share = 0 the model has the small-angle approximations, with
 * share = 1 it is exact. A share between 0 and 1 interpolates linearly between these two
 * models. */
static inline void exact_kinematics_slip(point *pt)
{
  /* linear in share, because tests of this effect need the derivative at share = 0 */
  const tse_params *const p = pt->p;
  const tse_real share = p->effects.exact_kinematics_share;
  tse_real sine, cosine;
  sin_cos(pt->u.steer, &sine, &cosine);
  const planar wheel = turn_axes(pt->vx, pt->vy + r_mul(p->car.lf, pt->r), sine, cosine);
  const tse_real s_front = r_div(
      pt->u.v_front - wheel.x, r_max(rolling_speed(wheel.x), r_abs(pt->u.v_front)));
  const tse_real a_front = slip_angle(wheel.y, wheel.x),
                 a_rear = slip_angle(pt->vy - r_mul(p->car.lr, pt->r), pt->vx);
  pt->s.s_front += r_mul(share, s_front - pt->s.s_front);
  pt->s.a_front += r_mul(share, a_front - pt->s.a_front);
  pt->s.a_rear += r_mul(share, a_rear - pt->s.a_rear);
  pt->sin_steer += r_mul(share, sine - pt->sin_steer);
  pt->cos_steer += r_mul(share, cosine - pt->cos_steer);
}

/* steering_compliance: the moment of the front lateral force turns the wheels back by the
 * angle c n C alpha, where c is `angle_per_moment`, n is `trail`, C the front cornering
 * stiffness and alpha the front slip angle. If the steering were rigid, the slip angle
 * would be alpha_0. Then alpha = alpha_0 - c n C alpha, and therefore
 * alpha = alpha_0/(1 + c n C). C is taken before load transfer, combined slip and
 * saturation, so that they do not reduce the moment. A linear compliance has the same
 * effect as a softer tyre. Typical c 0.2 .. 0.5 degrees per 100 Nm. */
static inline void steering_compliance_slip(point *pt)
{
  pt->s.a_front = r_div(pt->s.a_front, TSE_R(1) + r_mul(pt->p->car.compliance, pt->k.y_front));
}

/* rear_roll_steer: the roll of the body steers the rear wheels into the turn. This adds
 * `gain` times the roll angle to the slip angle alpha_r. The roll angle is `roll` times
 * x, and x is the lateral specific force after a second-order lag (mode_step in laws.h).
 * Typical gain 0.03 .. 0.1. */
static inline void rear_roll_steer_slip(point *pt)
{
  const tse_effects *const e = &pt->p->effects;
  const tse_real *const x = pt->m->mode[MODE_ROLL_STEER];
  pt->s.a_rear += r_mul(
      r_mul(e->rear_roll_steer_gain, e->rear_roll_steer_roll), x[0] + r_mul(pt->ahead, x[1]));
}

static inline void rear_roll_steer_remember(
    const tse_effects *e, tse_effect_memory *m, const point *a, const point *b, tse_real h)
{
  mode_step(m->mode[MODE_ROLL_STEER], e->rear_roll_steer_frequency, e->rear_roll_steer_damping, a->force.y,
      b->force.y, h);
}

/* relaxation: the slip angle a of a tyre follows the kinematic slip angle alpha over a
 * length: a' = (v/length)(alpha - a), v = max(|vx|, 1 m/s). The slip angle a is a state,
 * integrated with the motion (LAG state in effects.h). Typical length 0.3 .. 0.7 m. */
static inline void relaxation_slip(const tse_real lag[4], point *pt)
{
  pt->s.a_front = lag[0];
  pt->s.a_rear = lag[1];
}

/* Return the rate of relaxation v/length [1/s], v = max(|vx|, LOW_SPEED). */
static inline tse_real relaxation_rate(const tse_effects *e, const point *pt)
{
  return r_div(TSE_R(1), r_mul(e->relaxation_length, pt->s.inv_body));
}

/* longitudinal_relaxation: the slip s of a tyre follows the kinematic slip k over a
 * length: s' = (v/length)(k - s), v = max(|vx|, |R omega|, 1 m/s). Typical length
 * 0.1 .. 0.4 m, which includes the lag of the driveline. */
static inline void longitudinal_relaxation_slip(const tse_real lag[4], point *pt)
{
  pt->s.s_front = lag[2];
  pt->s.s_rear = lag[3];
}

/* Return the rate v/length of longitudinal relaxation [1/s].
 *   Given:  inv  [s/m] 1/v: inv_front or inv_rear of struct slips */
static inline tse_real longitudinal_relaxation_rate(const tse_effects *e, tse_real inv)
{
  return r_div(TSE_R(1), r_mul(e->longitudinal_relaxation_length, inv));
}

/* stiffness_drift: all stiffnesses are multiplied by 1 + change * share. share increases
 * linearly from 0 at `start` to 1 at `start + time`. With a short `time` the stiffness
 * steps. Typical change 5 .. 15 %, caused by temperature, wear or a different road. */
static inline void stiffness_drift_stiffness(point *pt)
{
  const tse_effects *const e = &pt->p->effects;
  const tse_real since = pt->m->time + pt->ahead - e->stiffness_drift_start;
  const tse_real share = r_clamp(r_div(since, e->stiffness_drift_time), TSE_R(0), TSE_R(1));
  const tse_real factor = TSE_R(1) + r_mul(e->stiffness_drift_change, share);
  pt->k.x_front = r_mul(pt->k.x_front, factor);
  pt->k.x_rear = r_mul(pt->k.x_rear, factor);
  pt->k.y_front = r_mul(pt->k.y_front, factor);
  pt->k.y_rear = r_mul(pt->k.y_rear, factor);
}

/* combined_slip: the lateral force of an axle is divided by sqrt(1 + k slip^2), with the
 * slip of the same axle. Typical k 50 .. 100. */
static inline void combined_slip_stiffness(point *pt)
{
  const tse_real k = pt->p->effects.combined_slip_factor;
  pt->k.y_front = r_div(pt->k.y_front, r_sqrt(TSE_R(1) + r_mul(k, r_mul(pt->s.s_front, pt->s.s_front))));
  pt->k.y_rear = r_div(pt->k.y_rear, r_sqrt(TSE_R(1) + r_mul(k, r_mul(pt->s.s_rear, pt->s.s_rear))));
}

/* tyre_saturation: the lateral force of an axle is limited to friction times the static
 * load of the axle. The secant stiffness (force / slip angle) becomes
 *   C c(q),  q = C |alpha|/(friction load)
 * c is (1 + q^2 + q^4)^(-1/4) for shape = 1. For shape = 0 it is 1 - q/3 + q^2/27 up to
 * q = 3, then 1/q (tyre_secant in laws.h). C is the stiffness after load transfer. Load
 * transfer therefore reduces the force at small slip angles, but not the max force.
 * 1/friction is multiplied by 1 + balance in front and by 1 - balance in the rear.
 * Typical friction 1 .. 1.1, balance -0.15 .. 0.15. */
static inline void tyre_saturation_grip(point *pt)
{
  const tse_effects *const e = &pt->p->effects;
  const tse_car *const c = &pt->p->car;
  const tse_real inv = e->tyre_saturation_inverse_friction, shape = e->tyre_saturation_shape;
  const tse_real front = r_abs(r_mul(pt->k.y_front, pt->s.a_front)),
                 rear = r_abs(r_mul(pt->k.y_rear, pt->s.a_rear));
  tse_real slope;
  pt->k.y_front = r_mul(pt->k.y_front, tyre_secant(r_div(r_mul(inv, front), c->end_front), shape, &slope));
  pt->k.y_rear = r_mul(pt->k.y_rear, tyre_secant(r_div(r_mul(inv, rear), c->end_rear), shape, &slope));
}

/* longitudinal_load_transfer: the cornering stiffness is Cf (1 - k (1 + balance) ax) in
 * front and Cr (1 + k (1 - balance) ax) in the rear, at least a tenth of Cf and Cr. ax is
 * the acceleration due to the longitudinal tyre forces. The longitudinal stiffness is
 * unchanged, because load transfer would not change its sum over both axles. Typical k
 * 0.02 .. 0.04 s2/m. */
static inline void longitudinal_load_transfer_stiffness(point *pt)
{
  const tse_real ax = tyre_pull(r_mul(pt->k.x_front, pt->s.s_front) + r_mul(pt->k.x_rear, pt->s.s_rear));
  pt->k.y_front = r_mul(pt->k.y_front, compute_load_share(-r_mul(pt->p->car.along_front, ax)));
  pt->k.y_rear = r_mul(pt->k.y_rear, compute_load_share(r_mul(pt->p->car.along_rear, ax)));
}

/* lateral_load_transfer: the cornering stiffness is C (1 - k a^2), at least a tenth of C.
 * a is the lateral acceleration with this reduced stiffness. It follows from a0, the
 * acceleration without reduction (compute_lateral_square() in laws.h). k is multiplied by
 * 1 + balance in front and by 1 - balance in the rear. Typical k 0.002 .. 0.005 s4/m2,
 * which is -5 .. -12 % at 5 m/s2. */
static inline void lateral_load_transfer_stiffness(point *pt)
{
  const tse_car *const c = &pt->p->car;
  const tse_real a0 = r_mul(pt->k.y_front, pt->s.a_front) + r_mul(pt->k.y_rear, pt->s.a_rear);
  const tse_real square = compute_lateral_square(pt->p->effects.lateral_load_transfer_gain, tyre_pull(a0));
  pt->k.y_front = r_mul(pt->k.y_front, compute_side_share(c->side_front, square));
  pt->k.y_rear = r_mul(pt->k.y_rear, compute_side_share(c->side_rear, square));
}

/* aero_drag: the force -kd vx |vx| is added to m vx', with kd = 1/2 rho cd A. Typical kd
 * 0.35 .. 0.45 kg/m. */
static inline void aero_drag_body(point *pt) { pt->force.x = pt->force.x - drag_of(pt->p->car.drag, pt->vx); }

/* rolling_resistance: the force f m g opposes the motion. Below 0.5 m/s it is
 * proportional to the speed. Typical f 0.008 .. 0.015. */
static inline void rolling_resistance_body(point *pt)
{
  pt->force.x = pt->force.x - rolling_of(pt->p->car.rolling, pt->vx);
}

/* grade: gravity adds -g sin(angle + grade of the row) to vx'. It accelerates the car,
 * and accelerometers do not measure it. Typical 1 .. 6 %, positive uphill. */
static inline void grade_body(point *pt)
{
  pt->gravity_x = -gravity_along(pt->p->effects.grade_angle + pt->g.grade);
}

/* bank: gravity adds -g sin(angle + bank of the row) + superelevation vx r to vy'. It
 * accelerates the car, and accelerometers do not measure it. superelevation is the share
 * of the lateral acceleration in a curve that the bank of the curve provides. Typical
 * angle 1.5 .. 3 %, positive if the left side is higher. Typical superelevation 0.05 ..
 * 0.2. */
static inline void bank_body(point *pt)
{
  const tse_effects *const e = &pt->p->effects;
  pt->gravity_y = r_mul(e->bank_superelevation, r_mul(pt->vx, pt->r))
      - gravity_along(e->bank_angle + pt->g.bank);
}

/* crosswind: a wind of constant speed w and constant direction adds the lateral force
 * c w sqrt(vx^2 + w^2) cos(psi). psi is the heading of the car relative to the heading at
 * which the wind pushes it straight to the left. At the start psi is the setting
 * crosswind_heading. Later psi changes with the heading of the car. The force acts at the
 * distance `arm` in front of the centre of gravity. Typical: w = 3 .. 10 m/s,
 * coefficient c = 2.8 kg/m, arm = 0.45 m. */
static inline void crosswind_body(point *pt)
{
  const tse_effects *const e = &pt->p->effects;
  const tse_real w = e->crosswind_speed, turns = pt->m->heading + r_mul(PER_TURN, r_mul(pt->ahead, pt->r));
  tse_real sine, cosine;
  sin_cos(e->crosswind_heading + r_mul(TWO_PI, turns), &sine, &cosine);
  const tse_real air = r_sqrt(r_mul(pt->vx, pt->vx) + r_mul(w, w));
  const tse_real push = r_div(r_mul(r_mul(e->crosswind_coefficient, w), r_mul(air, cosine)), e->mass);
  pt->force.y += push;
  pt->force.yaw += r_mul(r_mul(push, e->crosswind_arm), pt->p->car.m_inertia);
}

static inline void crosswind_remember(tse_effect_memory *m, const point *a, const point *b, tse_real h)
{
  const tse_real turns = m->heading + r_mul(TSE_R(0.5 * 0.15915494309189535), r_mul(h, a->r + b->r));
  m->heading = turns - r_from_int(r_floor_to_int(turns));
}

/* conicity: each axle has a lateral force at zero slip angle, due to conicity and ply
 * steer of its tyres. Typical 50 .. 150 N. */
static inline void conicity_body(point *pt)
{
  const tse_car *const c = &pt->p->car;
  pt->force.y += c->pull_front + c->pull_rear;
  pt->force.yaw += r_mul(c->jf, c->pull_front) - r_mul(c->jr, c->pull_rear);
}

/* aligning_moment: the lateral forces act behind the wheel centres, which adds -trail
 * (Fy_f + Fy_r) to I r'. Typical trail 20 .. 40 mm. */
static inline void aligning_moment_body(point *pt)
{
  pt->force.yaw = pt->force.yaw - r_mul(pt->p->car.trail, pt->fy_front + pt->fy_rear);
}

/* imu_lever_arm: an IMU at (x, y) from the centre of gravity measures ax - r^2 x - r' y
 * and ay + r' x - r^2 y. Typical 0.2 .. 0.8 m. */
static inline void imu_lever_arm_sensor(reading *z)
{
  const tse_car *const c = &z->pt->p->car;
  const planar there = compute_force_at(z->y[0], z->y[1], c->lever_x, c->lever_y, z->pt->r, z->pt->force.yaw);
  z->y[0] = there.x;
  z->y[1] = there.y;
}

/* body_roll: the body rolls out of the turn by phi = gain x. x is the lateral specific
 * force after a second-order lag (mode_step in laws.h).
 *
 * The acceleration of the rolling mass acts on the car. vy is the lateral speed of the
 * roll axis, F the sum of the lateral tyre forces:
 *   m (vy' + vx r) = F + m coupling phi''
 * `coupling` is the height of the centre of gravity of the sprung mass above the roll
 * axis, times sprung mass / m.
 *
 * An IMU at the height h above the roll axis measures its acceleration and a component of
 * gravity. With the equation above:
 *   vy' + vx r - h phi'' + g phi = F/m + g phi - (h - coupling) phi''
 * The model therefore adds g phi - height phi'' to accel_y. `height` is h - coupling.
 *
 * Typical gain 3 .. 6 degrees per g, frequency 1.2 .. 2 Hz, damping 0.2 .. 0.4. */

/* Return x'', the second time derivative of the x of body_roll (see above).
 *   Given:  x, and its time derivative `speed` */
static inline tse_real body_roll_swing(const point *pt, tse_real x, tse_real speed)
{
  return compute_mode_swing(x, speed, pt->p->car.roll_omega, pt->p->car.roll_damping, pt->force.y);
}

static inline void body_roll_body(point *pt)
{
  const tse_effects *const e = &pt->p->effects;
  const tse_real *const x = pt->m->mode[MODE_ROLL], h = pt->ahead;
  const tse_real then = x[0] + r_mul(h, x[1]),
                 before = body_roll_swing(pt, then, x[1]); /* `then` is x, extrapolated by `ahead` */
  const tse_real swing = body_roll_swing(
      pt, then + r_mul(r_mul(TSE_R(0.5), r_mul(h, h)), before), x[1] + r_mul(h, before));
  pt->gravity_y += r_mul(r_mul(e->body_roll_coupling, e->body_roll_gain), swing);
}

static inline void body_roll_sensor(reading *z)
{
  const tse_effects *const e = &z->pt->p->effects;
  const tse_real *const x = z->m->mode[MODE_ROLL],
                        swing = r_mul(e->body_roll_height, body_roll_swing(z->pt, x[0], x[1]));
  z->y[1] += r_mul(e->body_roll_gain, r_mul(GRAVITY, x[0]) - swing);
}

static inline void body_roll_remember(
    const tse_effects *e, tse_effect_memory *m, const point *a, const point *b, tse_real h)
{
  mode_step(m->mode[MODE_ROLL], e->body_roll_frequency, e->body_roll_damping, a->force.y, b->force.y, h);
}

/* pitch_leak: the nose rises by gain x. x is the longitudinal specific force after a
 * second-order lag (mode_step in laws.h). `height` is the height of the IMU above the
 * pitch axis. Gravity and the pitch acceleration add gain (g x - height x'') to accel_x.
 * Typical gain 1.5 .. 3 degrees per g. */
static inline void pitch_leak_sensor(reading *z)
{
  z->y[0] += pitch_read(&z->pt->p->car, z->m->mode[MODE_PITCH], z->pt->force.x);
}

static inline void pitch_leak_remember(
    const tse_effects *e, tse_effect_memory *m, const point *a, const point *b, tse_real h)
{
  mode_step(m->mode[MODE_PITCH], e->pitch_leak_frequency, e->pitch_leak_damping, a->force.x, b->force.x, h);
}

/* imu_misalignment: the IMU is turned to the left by `angle` and measures ax cos(angle) +
 * ay sin(angle) and ay cos(angle) - ax sin(angle). Typical 1 .. 3 degrees. */
static inline void imu_misalignment_sensor(reading *z)
{
  const planar read = turn_axes(z->y[0], z->y[1], z->pt->p->car.mount_sin, z->pt->p->car.mount_cos);
  z->y[0] = read.x;
  z->y[1] = read.y;
}

/* imu_scale_ax: the reading is accel_x (1 + error). Typical 1 .. 5 %. */
static inline void imu_scale_ax_sensor(reading *z) { z->y[0] = r_mul(z->pt->p->car.scale_x, z->y[0]); }

/* imu_scale_ay: the reading is accel_y (1 + error). Typical 1 .. 5 %. */
static inline void imu_scale_ay_sensor(reading *z) { z->y[1] = r_mul(z->pt->p->car.scale_y, z->y[1]); }

/* gyro_scale: the reading is yaw_rate (1 + error). Typical 1 .. 3 %. */
static inline void gyro_scale_sensor(reading *z) { z->y[2] = r_mul(z->pt->p->car.scale_r, z->y[2]); }

/* imu_delay: the readings of accelerometers and gyro are delayed by `time`, interpolated
 * linearly between rows. Typical 10 .. 30 ms. */
static inline void imu_delay_sensor(reading *z)
{
  const tse_real time = z->pt->p->effects.imu_delay_time;
  effects_delay_put(&z->m->imu, z->m->imu_was, time, z->dt, z->y, 3);
  for (int i = 0; i < 3; i++) z->y[i] = effects_delay_get(&z->m->imu, z->m->imu_was[i], time);
}

// clang-format off: table acting_effects
#define EFFECTS_INPUT(X) X(steering_ratio) X(steering_offset) X(steering_delay) X(steering_lag)
#define EFFECTS_SLIP(X) X(exact_kinematics) X(steering_compliance) X(rear_roll_steer)
#define EFFECTS_LAG(X) X(relaxation) X(longitudinal_relaxation)
#define EFFECTS_STIFFNESS(X) X(stiffness_drift) X(combined_slip) X(longitudinal_load_transfer) \
    X(lateral_load_transfer)
#define EFFECTS_GRIP(X) X(tyre_saturation)
#define EFFECTS_BODY(X) X(aero_drag) X(rolling_resistance) X(grade) X(bank) X(crosswind) X(conicity) \
    X(aligning_moment)
#define EFFECTS_SENSOR(X) X(imu_lever_arm) X(body_roll) X(pitch_leak) X(imu_misalignment) X(imu_scale_ax) \
    X(imu_scale_ay) X(gyro_scale) X(imu_delay)
// clang-format on: end of table

#endif
#endif
