/* tests/unit/model/test_effect_forces.c <-> effects of src/model/catalogue.h that are
 * forces, tyre laws or geometry, compared with force and moment balances in newtons,
 * closed forms and rigid-body kinematics that are not taken from the library. */
#include "unit_support.h"
#include "effect_support.h"

#define G 9.81

typedef struct steady {
  double r, ay;
} steady;

/* Return the steady cornering of the linear car at speed v and steering angle d, with a
 * lateral force `push` that the accelerometer measures, a force `pull` that it does not
 * measure (gravity), and a yaw moment N:
 *   Ff = (lr (m v r - Y) - N)/L,  Fr = (lf (m v r - Y) + N)/L,  Y = push + pull,
 *   d - Ff/Cf + Fr/Cr = L r/v. */
static steady cornering(const tse_config *c, double v, double d, double push, double pull, double moment)
{
  const double m = number(c->mass), lf = number(c->lf), lr = number(c->lr), length = lf + lr,
               side = push + pull;
  const double cf = number(c->cornering_stiffness_front), cr = number(c->cornering_stiffness_rear);
  steady s;
  s.r = v * (d + (lr * side + moment) / (length * cf) - (lf * side - moment) / (length * cr))
      / (length + m * v * v / length * (lr / cf - lf / cr));
  s.ay = v * s.r - pull / m;
  return s;
}

/* In replay, and in the simulator with freely rolling wheels.
 *   Given:  share  tolerance: second-order terms, and speed that the wheels do not hold
 *                  exactly */
static void expect_cornering(
    const tse_config *c, double v, double d, steady s, double share, const char *what)
{
  static tse_sim sim;
  const tse_sim_config quiet = still_sim(v);
  tse_sim_input u = blank_sim_input();
  tse_sim_output y;
  const int rows = 600;
  straight(c, v, 0.01, rows);
  for (int i = 0; i < rows; i++) log_steer[i] = real(d);
  replay(c, rows);
  expect_near(s.r, number(got_r[rows - 1]), share * fabs(s.r), what, 0);
  expect_near(s.ay, number(got_y[rows - 1]), share * fabs(s.ay), what, 1);
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_sim_reset(&sim, c, &quiet, NULL));
  u.dt = real(0.01), u.steer_angle = real(d), u.road_level = real(1);
  for (int i = 0; i < rows; i++) TEST_ASSERT_EQUAL_INT(TSE_OK, tse_sim_step(&sim, &u, &y));
  expect_near(s.r, number(y.row.yaw_rate), share * fabs(s.r), what, 2);
  expect_near(s.ay, number(y.row.accel_y), share * fabs(s.ay), what, 3);
}

static void test_steering_offset_turns_the_car_that_is_steered_straight(void)
{
  tse_config c = default_car();
  c.steering_offset_angle = setting(0.004);
  expect_cornering(&c, 20, 0, cornering(&c, 20, 0.004, 0, 0, 0), 2e-3, "steering_offset");
  expect_cornering(&c, 8, 0, cornering(&c, 8, 0.004, 0, 0, 0), 2e-3, "steering_offset, slow");
}

static void test_bank_pulls_the_car_to_its_low_side_and_the_sensor_does_not_see_it(void)
{
  tse_config c = default_car();
  c.bank_angle = setting(0.03); /* left side high: to the right */
  expect_cornering(&c, 20, 0, cornering(&c, 20, 0, 0, -1900 * G * sin(0.03), 0), 3e-3, "bank");
}

/* In a steady turn the tyres provide m (1 - share) v r: the balance is that of a lighter
 * car, and accel_y measures it. */
static void test_superelevation_takes_a_share_of_the_side_force(void)
{
  const double share = 0.15;
  tse_config c = default_car(), light = default_car();
  c.bank_superelevation = setting(share);
  light.mass = setting(number(c.mass) * (1 - share));
  steady s = cornering(&light, 20, 0.005, 0, 0, 0);
  s.ay = (1 - share) * 20 * s.r;
  expect_cornering(&c, 20, 0.005, s, 3e-3, "superelevation");
}

static void test_conicity_is_a_side_force_at_each_axle(void)
{
  tse_config c = default_car();
  c.conicity_front = setting(150);
  expect_cornering(&c, 20, 0, cornering(&c, 20, 0, 150, 0, 1.25 * 150), 2e-3, "conicity, front");
  c.conicity_rear = setting(-100);
  expect_cornering(&c, 20, 0, cornering(&c, 20, 0, 50, 0, 1.25 * 150 + 1.5 * 100), 2e-3, "conicity, rear");
}

static void test_crosswind_pushes_at_its_arm(void)
{
  tse_config c = default_car();
  c.crosswind_speed = setting(6), c.crosswind_coefficient = setting(3), c.crosswind_arm = setting(0.4);
  const double force = 3 * 6 * sqrt(400 + 36.0);
  /* The heading changes by up to 0.13 rad in 6 s: 0.8 % of the cosine. */
  expect_cornering(&c, 20, 0, cornering(&c, 20, 0, force, 0, 0.4 * force), 1.5e-2, "crosswind");
  c.crosswind_heading = setting(2.0943951023931953);
  expect_cornering(&c, 20, 0, cornering(&c, 20, 0, -force / 2, 0, -0.2 * force), 8e-2,
      "crosswind from behind"); /* d cos/cos = 0.06 */
}

/* On a circle the wind comes from all sides. Its part in accel_y follows the cosine of
 * the heading, integrated by the trapezoidal rule. */
static void test_crosswind_turns_with_the_heading(void)
{
  tse_config c = default_car();
  const int rows = 8000;
  const tse_replay_log log = the_log();
  tse_replay_start s = the_start();
  double heading = 0, worst = 0, smallest = 1;
  straight(&c, 10, 0.01, rows);
  for (int i = 0; i < rows; i++) log_steer[i] = real(0.03);
  replay(&c, rows);
  keep_readings();
  c.crosswind_speed = setting(3);
  s.heading = real(0.5);
  replay_with(&c, &log, rows, &s);
  const double force = 2.8 * 3 * sqrt(100 + 9.0), gain = cornering(&c, 10, 0, force, 0, 0.45 * force).ay;
  for (int i = 1; i < rows; i++) {
    heading += 0.005 * (number(got_r[i]) + number(got_r[i - 1]));
    if (i < 300) continue; /* the start has decayed */
    worst = fmax(worst, fabs(number(got_y[i]) - number(kept_y[i]) - gain * cos(0.5 + heading)));
    smallest = fmin(smallest, cos(0.5 + heading));
  }
  TEST_ASSERT_TRUE(smallest < -0.99); /* it has come from all sides */
  /* Quasi-static: 0.1 rad/s, while the yaw rate settles at 8/s. The circle is not
   * exact. */
  expect_near(0, worst, 0.04 * gain, "crosswind", 0);
}

static void test_aligning_moment_in_steady_cornering(void)
{
  tse_config c = default_car();
  c.aligning_moment_trail = setting(0.04);
  /* forces balance as if both axles stood further back by the trail; the wheels' paths
   * are those of the axles */
  const double m = 1900, v = 20, k = m / 2.75 * (1.54 / 1.2e5 - 1.21 / 1.4e5);
  steady s;
  s.r = v * 0.002 / (2.75 + k * v * v), s.ay = v * s.r;
  expect_cornering(&c, 20, 0.002, s, 2e-3, "aligning_moment");
}

/* A stage of a step is later than the memory: effects with memory are evaluated at its
 * time. */
static void test_a_point_ahead_of_the_memory_is_where_time_has_brought_it(void)
{
  for (int k = 0; k < 3; k++) {
    tse_config c = default_car();
    c.crosswind_speed = setting(k == 0 ? 8 : 0);
    c.stiffness_drift_change = setting(k == 1 ? 0.5 : 0);
    c.stiffness_drift_time = setting(2);
    c.rear_roll_steer_gain = setting(k == 2 ? 0.2 : 0);
    const tse_params p = prepared(c);
    tse_effect_memory now, then;
    point ahead, at;
    memset(&now, 0, sizeof now);
    memset(&ahead, 0, sizeof ahead);
    now.time = real(0.5), now.heading = real(0.1), now.mode[MODE_ROLL_STEER][0] = real(1);
    now.mode[MODE_ROLL_STEER][1] = real(3);
    ahead.vx = ahead.u.v_front = ahead.u.v_rear = real(20), ahead.vy = real(0.5), ahead.r = real(0.4);
    ahead.u.steer = real(0.05);
    at = ahead;
    ahead.ahead = real(0.25);
    then = now;
    then.time = real(0.75), then.heading = real(0.1 + 0.4 * 0.25 / 6.283185307179586);
    then.mode[MODE_ROLL_STEER][0] = real(1.75);
    const stiffness s = vehicle_stiffness(&p, real(0), real(0), real(0));
    effects_at(&p, &now, now.lag, s, &ahead);
    effects_at(&p, &then, then.lag, s, &at);
    expect_near(number(at.force.y), number(ahead.force.y), BY_FORMAT(1e-12, 1e-5), "force", k);
    expect_near(number(at.force.yaw), number(ahead.force.yaw), BY_FORMAT(1e-12, 1e-5), "moment", k);
    ahead.ahead = real(0);
    effects_at(&p, &now, now.lag, s, &ahead);
    TEST_ASSERT_TRUE(fabs(number(at.force.y) - number(ahead.force.y)) > 1e-3); /* and it does move */
  }
}

/* ------------------------------------------------------------------------------------- laws of the tyre */

/* Steady cornering in replay. The tyre law, applied to the velocities put out, must
 * balance mass and moment:
 *     m accel_y = Fyf + Fyr + Fxf d,   lf (Fyf + Fxf d) = lr Fyr. */
typedef struct tyre {
  double c, angle, slip, load, ax, ay; /* stiffness; of the axle; accelerations by the tyres */
  int rear;
} tyre;
typedef double (*law)(tyre t);

static void expect_balance(const tse_config *c, double d, double extra_front, law f, const char *what)
{
  const int rows = 1500, last = rows - 1;
  straight(c, 20, 0.01, rows);
  for (int i = 0; i < rows; i++) {
    log_steer[i] = real(d * (i < 500 ? i / 500.0 : 1)); /* a ramp: a step could make the car spin */
    log_front[i] = real(number(log_front[i]) * (1 + extra_front));
  }
  replay(c, rows);
  const double vx = number(got_vx[last]), vy = number(got_vy[last]), r = number(got_yaw[last]);
  const double ay = number(got_y[last]), lf = 1.25, lr = 1.5, m = 1900;
  const double front = d - (vy + lf * r) / vx, rear = (lr * r - vy) / vx;
  const double wf = 0.33 * number(log_front[last]), wr = 0.33 * number(log_rear[last]);
  const double sf = (wf - vx) / fmax(wf, vx), sr = (wr - vx) / fmax(wr, vx);
  const double fxf = 1.6e5 * sf, drive = (fxf + 1.6e5 * sr) / m;
  const double side = ay - fxf * d / m; /* by lateral forces */
  const double fyf = f((tyre){ 1.2e5, front, sf, m * G * lr / 2.75, drive, side, 0 });
  const double fyr = f((tyre){ 1.4e5, rear, sr, m * G * lf / 2.75, drive, side, 1 });
  TEST_ASSERT_TRUE_MESSAGE(fabs(ay) > 2.5, what); /* where the law differs from the linear one */
  expect_near(m * ay, fyf + fyr + fxf * d, BY_FORMAT(1e-3, 4), what, 0);         /* N */
  expect_near(0, lf * (fyf + fxf * d) - lr * fyr, BY_FORMAT(1e-2, 60), what, 1); /* Nm; settled to rounding */
}

static double brush(tyre t) /* friction 1.05 */
{
  const double z = t.c * fabs(t.angle) / (3 * 1.05 * t.load);
  return (t.angle < 0 ? -1 : 1) * 1.05 * t.load * (z < 1 ? 1 - pow(1 - z, 3) : 1);
}
static double root(tyre t)
{
  const double q = t.c * t.angle / (1.05 * t.load);
  return t.c * t.angle * pow(1 + q * q + pow(q, 4), -0.25);
}
/* Friction of the axles: 1.05/1.25 in front, 1.05/0.75 at the rear. */
static double unlike(tyre t)
{
  t.load /= t.rear ? 0.75 : 1.25; /* both laws depend on friction times load only */
  return brush(t);
}
static double half_root(tyre t) { return 0.5 * (brush(t) + root(t)); }
static double combined(tyre t) { return t.c * t.angle / sqrt(1 + 300 * t.slip * t.slip); }
static double leaning(tyre t) { return t.c * (1 - 0.005 * t.ay * t.ay) * t.angle; }
static double pitching(tyre t) { return t.c * (1 + (t.rear ? 0.04 : -0.04) * t.ax) * t.angle; }
static double pitching_front(tyre t) { return t.c * (1 + (t.rear ? 0.02 : -0.06) * t.ax) * t.angle; }

static void test_saturation_is_the_brush_model(void)
{
  tse_config c = default_car();
  c.tyre_saturation_inverse_friction = setting(1 / 1.05);
  expect_balance(&c, 0.045, 0, brush, "brush");
  expect_balance(&c, -0.045, 0, brush, "brush, to the right");
  c.tyre_saturation_shape = setting(1);
  expect_balance(&c, 0.05, 0, root, "root");
  c.tyre_saturation_shape = setting(0.5);
  expect_balance(&c, 0.05, 0, half_root, "half of each");
  c.tyre_saturation_shape = setting(0), c.tyre_saturation_balance = setting(0.25);
  expect_balance(&c, 0.045, 0, unlike, "the front ends earlier");
}

/* Axle by axle, also beyond stable states: both laws saturate at friction times load. */
static void test_saturation_ends_at_friction_times_load(void)
{
  tse_config c = default_car();
  const double load[2] = { 1900 * G * 1.5 / 2.75, 1900 * G * 1.25 / 2.75 };
  c.tyre_saturation_inverse_friction = setting(1 / 1.05);
  for (int shape = 0; shape <= 1; shape++) {
    c.tyre_saturation_shape = setting(shape);
    const tse_params p = prepared(c);
    const law of_shape = shape ? root : brush;
    for (int i = -60; i <= 60; i++) {
      tse_effect_memory m = { 0 };
      point pt = { 0 };
      pt.vx = pt.u.v_front = pt.u.v_rear = real(20), pt.g.slip_front = pt.g.slip_rear = real(0.05 * i);
      effects_at(&p, &m, m.lag, vehicle_stiffness(&p, real(0), real(0), real(0)), &pt);
      expect_near(of_shape((tyre){ .c = 1.2e5, .angle = 0.05 * i, .load = load[0] }),
          1900 * number(pt.fy_front), BY_FORMAT(1e-9, 1e-6) * load[0], "front", i);
      expect_near(of_shape((tyre){ .c = 1.4e5, .angle = 0.05 * i, .load = load[1] }),
          1900 * number(pt.fy_rear), BY_FORMAT(1e-9, 1e-6) * load[1], "rear", i);
    }
  }
  expect_near(1.05 * load[0], brush((tyre){ .c = 1.2e5, .angle = 3, .load = load[0] }), 1e-9,
      "the limit of the reference", 0);
}

/* A car of 1900 kg with friction 1.0 in front and 1.3 at the rear, by hand:
 *     inverse friction  (1/1.0 + 1/1.3)/2 = 0.884615
 *     balance           (1/1.0 - 1/1.3)/(1/1.0 + 1/1.3) = 0.130435
 *     loads             1900 kg 9.81 m/s2 1.5 m/2.75 m = 10166.7 N and 8472.3 N */
static void test_a_balance_makes_the_friction_of_the_axles_differ(void)
{
  static const double end[2] = { 10166.7, 11014.0 }; /* [N] 1.0 and 1.3 times the load */
  for (int mirror = 0; mirror < 2; mirror++) {       /* 1: friction 1.3 in front, 1.0 at the rear */
    const double ends[2] = { end[0] * (mirror ? 1.3 : 1), end[1] / (mirror ? 1.3 : 1) };
    tse_config c = default_car();
    c.tyre_saturation_inverse_friction = setting(0.8846154);
    c.tyre_saturation_balance = setting(mirror ? -0.1304348 : 0.1304348);
    const tse_params p = prepared(c);
    for (int sign = -1; sign <= 1; sign += 2) {
      tse_effect_memory m = { 0 };
      point pt = { 0 };
      pt.vx = pt.u.v_front = pt.u.v_rear = real(20);
      pt.g.slip_front = pt.g.slip_rear = real(sign * 1.0); /* both slide */
      effects_at(&p, &m, m.lag, vehicle_stiffness(&p, real(0), real(0), real(0)), &pt);
      expect_near(sign * ends[0], 1900 * number(pt.fy_front), 0.1, "front", mirror); /* digits by hand */
      expect_near(sign * ends[1], 1900 * number(pt.fy_rear), 0.1, "rear", mirror);
      pt.g.slip_front = pt.g.slip_rear = real(sign * 0.06); /* C alpha: 7200 N and 8400 N */
      effects_at(&p, &m, m.lag, vehicle_stiffness(&p, real(0), real(0), real(0)), &pt);
      const double q[2] = { 7200 / ends[0], 8400 / ends[1] };
      expect_near(sign * 7200 * (1 - q[0] / 3 + q[0] * q[0] / 27), 1900 * number(pt.fy_front), 0.1,
          "front bends", mirror);
      expect_near(sign * 8400 * (1 - q[1] / 3 + q[1] * q[1] / 27), 1900 * number(pt.fy_rear), 0.1,
          "rear bends", mirror);
    }
  }
}

static void test_combined_slip_takes_from_the_lateral_force(void)
{
  tse_config c = default_car();
  c.combined_slip_factor = setting(300);
  expect_balance(&c, 0.04, 0.05, combined, "combined_slip, driven");
  expect_balance(&c, 0.04, -0.05, combined, "combined_slip, braked");
}

static void test_lateral_load_transfer_takes_with_the_square_of_the_acceleration_that_remains(void)
{
  tse_config c = default_car();
  c.lateral_load_transfer_gain = setting(0.005);
  expect_balance(&c, 0.05, 0, leaning, "lateral_load_transfer");
  const double even = number(got_yaw[1499]);
  c.lateral_load_transfer_balance = setting(0.5); /* all roll moment at the front: understeer */
  straight(&c, 20, 0.01, 1500);
  for (int i = 0; i < 1500; i++) log_steer[i] = real(0.05 * fmin(i / 500.0, 1));
  replay(&c, 1500);
  TEST_ASSERT_TRUE(number(got_yaw[1499]) < 0.97 * even);
  /* Forces of the axles, from the moment balance, over C alpha: 1 -+ as set, where a
   * solves the even equation. */
  const double vx = number(got_vx[1499]), vy = number(got_vy[1499]), r = number(got_yaw[1499]),
               ay = number(got_y[1499]);
  const double fxf = 1.6e5 * (20 - vx) / 20, front = 0.05 - (vy + 1.25 * r) / vx, rear = (1.5 * r - vy) / vx;
  const double left_front = (1900 * ay * 1.5 / 2.75 - fxf * 0.05) / (1.2e5 * front),
               left_rear = 1900 * ay * 1.25 / 2.75 / (1.4e5 * rear);
  expect_near(3, (1 - left_front) / (1 - left_rear), 0.01, "front loses three times what the rear does", 0);
}

static void test_longitudinal_load_transfer_takes_in_front_what_it_gives_behind(void)
{
  tse_config c = default_car();
  c.longitudinal_load_transfer_gain = setting(0.04);
  expect_balance(&c, 0.04, 0.05, pitching, "longitudinal_load_transfer, driven");
  expect_balance(&c, 0.04, -0.05, pitching, "longitudinal_load_transfer, braked");
  c.longitudinal_load_transfer_balance = setting(0.5);
  expect_balance(&c, 0.04, -0.05, pitching_front, "longitudinal_load_transfer, more in front");
}

static void test_stiffness_drifts_between_two_times(void)
{
  tse_config c = default_car();
  c.stiffness_drift_change = setting(0.2), c.stiffness_drift_start = setting(4);
  c.stiffness_drift_time = setting(22);
  const int rows = 1500, last = rows - 1;
  straight(&c, 20, 0.01, rows);
  for (int i = 0; i < rows; i++) log_steer[i] = real(0.04 * fmin(i / 500.0, 1));
  replay(&c, rows);
  const double vx = number(got_vx[last]), vy = number(got_vy[last]), r = number(got_yaw[last]),
               ay = number(got_y[last]);
  const double drifted = 1 + 0.2 * (14.99 - 4) / 22; /* at 15 s: half of 4 .. 26 s */
  const double fyf = 1.2e5 * drifted * (0.04 - (vy + 1.25 * r) / vx),
               fyr = 1.4e5 * drifted * (1.5 * r - vy) / vx;
  const double fxf = 1.6e5 * drifted * (20 - vx) / 20;
  expect_near(1900 * ay, fyf + fyr + fxf * 0.04, BY_FORMAT(1e-2, 8), "force", 0);
  expect_near(0.33 * fxf, number(got_tf[last]), BY_FORMAT(1e-2, 8), "longitudinal, front", 0);
  expect_near(0.33 * fxf, number(got_tr[last]), BY_FORMAT(1e-2, 8), "longitudinal, rear", 0);
  const tse_real before[2] = { got_y[400], got_y[410] };
  c.stiffness_drift_change = setting(0);
  replay(&c, rows);
  TEST_ASSERT_TRUE(
      !(before[0] != got_y[400]) && before[1] != got_y[410]); /* nothing has happened before 4 s */
}

/* --------------------------------------------------------------------------------------- along the car */

/* Coast with all wheels free: v' (m + 2 J/R^2) = F, J per axle. Returned: [m/s] speed
 * after 20 s of the simulator */
static double coasted(const tse_config *c)
{
  static tse_sim sim;
  const tse_sim_config quiet = still_sim(30);
  tse_sim_input u = blank_sim_input();
  tse_sim_output y;
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_sim_reset(&sim, c, &quiet, NULL));
  u.dt = real(0.01), u.road_level = real(1);
  for (int i = 0; i <= 2000; i++) TEST_ASSERT_EQUAL_INT(TSE_OK, tse_sim_step(&sim, &u, &y));
  return number(y.vel_x);
}

#define EFFECTIVE_MASS (1900 + 2 * 2.4 / (0.33 * 0.33))

static void test_drag_slows_a_coasting_car_by_its_square(void)
{
  tse_config c = default_car();
  expect_near(30, coasted(&c), BY_FORMAT(1e-9, 1e-3), "without", 0);
  c.aero_drag_coefficient = setting(0.45);
  expect_near(30 / (1 + 0.45 * 30 * 20 / EFFECTIVE_MASS), coasted(&c), BY_FORMAT(2e-3, 0.03), "aero_drag",
      0); /* the wheels start at rolling speed */
}

static void test_drag_acts_against_the_motion_backwards_too(void)
{
  tse_config c = default_car();
  c.aero_drag_coefficient = setting(0.45);
  const tse_params p = prepared(c);
  point at = { 0 };
  at.p = &p;
  for (int way = -1; way <= 1; way += 2) {
    at.vx = real(30 * way), at.force.x = real(0.1);
    aero_drag_body(&at);
    expect_near(
        0.1 - 0.45 * 900 * way / of_setting(c.mass), number(at.force.x), 1e-6, "force over mass", way);
  }
}

static void test_rolling_resistance_slows_a_coasting_car_evenly_and_stops_with_it(void)
{
  tse_config c = default_car();
  c.rolling_resistance_coefficient = setting(0.015);
  expect_near(30 - 0.015 * G * 1900 * 20 / EFFECTIVE_MASS, coasted(&c), BY_FORMAT(2e-3, 0.03),
      "rolling_resistance", 0);
  c.rolling_resistance_coefficient = setting(0.2);
  expect_near(0, coasted(&c), 0.02, "standing", 0); /* below 0.5 m/s it fades with the speed */
}

static void test_grade_slows_a_coasting_car_and_the_sensor_does_not_see_it(void)
{
  tse_config c = default_car();
  c.grade_angle = setting(0.06);
  expect_near(
      30 - sin(0.06) * G * 1900 * 20 / EFFECTIVE_MASS, coasted(&c), BY_FORMAT(2e-3, 0.03), "grade", 0);
  straight(&c, 20, 0.01, 600); /* at constant speed accel_x measures the tyres' force against it */
  replay(&c, 600);
  expect_near(G * sin(0.06), number(got_x[599]), BY_FORMAT(1e-6, 1e-4), "accel_x", 0);
}

/* Constant wheel speeds: drag and rolling resistance appear in slip and wheel torque, not
 * in accel_x. */
static void test_drag_and_rolling_resistance_show_in_slip_and_torque(void)
{
  tse_config c = default_car();
  c.aero_drag_coefficient = setting(0.4), c.rolling_resistance_coefficient = setting(0.012);
  straight(&c, 30, 0.01, 800);
  replay(&c, 800);
  const double vx = number(got_vx[799]), force = 0.4 * vx * vx + 0.012 * 1900 * G;
  expect_near(0, number(got_x[799]), BY_FORMAT(1e-6, 1e-3), "accel_x", 0);
  expect_near(30 * (1 - force / 3.2e5), vx, BY_FORMAT(1e-6, 1e-3), "vel_x", 0);
  expect_near(0.33 * force, number(got_tf[799]) + number(got_tr[799]), BY_FORMAT(1e-3, 0.5), "torque", 0);
  expect_near(number(got_tf[799]), number(got_tr[799]), BY_FORMAT(1e-6, 1e-3), "both axles", 0);
}

/* Constant acceleration: m a R for the tyres, J a/R for the wheels. */
static void test_wheel_torque_holds_the_inertia_of_the_wheels(void)
{
  const tse_config c = default_car();
  const tse_replay_log log = the_log();
  tse_replay_start s = the_start();
  straight(&c, 10, 0.01, 800);
  for (int i = 0; i < 800; i++) log_front[i] = log_rear[i] = real((10 + 0.02 * i) / 0.33); /* 2 m/s2 */
  s.wheel_inertia_front = real(5);
  replay_with(&c, &log, 800, &s);
  const double slip = 1 - number(got_vx[700]) / (10 + 0.02 * 700), a = 3.2e5 * slip / 1900;
  expect_near(2 * (1 - slip), a, BY_FORMAT(1e-3, 2e-3), "acceleration: v = w (1 - slip), slip constant", 0);
  expect_near(0.33 * 1.6e5 * slip + 5 * 2 / 0.33, number(got_tf[700]), BY_FORMAT(1e-6, 0.05), "front", 0);
  expect_near(0.33 * 1.6e5 * slip + 2.4 * 2 / 0.33, number(got_tr[700]), BY_FORMAT(1e-6, 0.05), "rear", 0);
}

/* ---------------------------------------------------------------------------------------------- geometry */

/* Tyres with little slip: the car rolls about a point. The rear axle's speed w gives r =
 * w tan(d)/L; for small angles r = w d/L. */
static void test_exact_kinematics_roll_about_the_turning_centre(void)
{
  tse_config c = default_car();
  const double d = 0.5, w = 3, length = 2.75;
  c.longitudinal_stiffness_front = c.longitudinal_stiffness_rear = c.cornering_stiffness_front =
      c.cornering_stiffness_rear = setting(1e7);
  c.max_steer = setting(0.6), c.exact_kinematics_share = setting(1);
  straight(&c, w, 0.01, 600);
  for (int i = 0; i < 600; i++) {
    const double now = d * fmin(i / 200.0, 1);
    log_steer[i] = real(now);
    log_front[i] = real(w / cos(now) / 0.33);
  }
  replay(&c, 600);
  expect_near(
      w * tan(d) / length, number(got_yaw[599]), 1e-3 * w, "yaw rate", 0); /* slip angles of 1e-3 remain */
  expect_near(w * tan(d) / length * 1.5, number(got_vy[599]), 2e-3 * w, "vy = lr r", 0);
  expect_near(w, number(got_vx[599]), 2e-3 * w, "vx", 0);
}

/* Compare with vectors, point by point: the velocity of the front wheel in its own axes,
 * and the force turned back, by libm. */
static void test_exact_kinematics_are_those_of_vectors(void)
{
  uint32_t seed = 5;
  tse_config c = default_car();
  for (int i = 0; i < 200; i++) {
    const double share = i % 2 ? 1 : 0.25, d = next_between(&seed, -0.6, 0.6),
                 vx = next_between(&seed, 3, 40);
    const double vy = next_between(&seed, -3, 3), r = next_between(&seed, -0.8, 0.8),
                 wf = next_between(&seed, 0.9, 1.1) * vx;
    c.exact_kinematics_share = setting(share);
    const tse_params p = prepared(c);
    tse_effect_memory m = { 0 };
    point pt = { 0 };
    pt.vx = real(vx), pt.vy = real(vy), pt.r = real(r), pt.u.steer = real(d), pt.u.v_front = real(wf);
    pt.u.v_rear = real(vx);
    effects_at(&p, &m, m.lag, vehicle_stiffness(&p, real(0), real(0), real(0)), &pt);
    const double across = vy + 1.25 * r, direction = atan2(across, vx), speed = hypot(vx, across);
    const double along = speed * cos(direction - d);
    const double exact[3] = { d - direction, atan2(1.5 * r - vy, vx), (wf - along) / fmax(wf, along) };
    const double plain[3] = { d - across / vx, (1.5 * r - vy) / vx, (wf - vx) / fmax(wf, vx) };
    double s[3];
    for (int k = 0; k < 3; k++) s[k] = plain[k] + share * (exact[k] - plain[k]);
    const double tolerance = BY_FORMAT(1e-12, 3e-6);
    expect_near(s[0], number(pt.s.a_front), tolerance, "front angle", i);
    expect_near(s[1], number(pt.s.a_rear), tolerance, "rear angle", i);
    expect_near(s[2], number(pt.s.s_front), tolerance, "front slip", i);
    const double fx = 1.6e5 * s[2] / 1900, fy = 1.2e5 * s[0] / 1900, fr = 1.4e5 * s[1] / 1900;
    const double co = 1 + share * (cos(d) - 1), si = d + share * (sin(d) - d);
    expect_near(fx * co - fy * si, number(pt.force.x), BY_FORMAT(1e-9, 1e-3), "force along", i);
    expect_near(fx * si + fy * co + fr, number(pt.force.y), BY_FORMAT(1e-9, 1e-3), "force across", i);
    expect_near(1900 * (1.25 * (fx * si + fy * co) - 1.5 * fr) / 3000, number(pt.force.yaw),
        BY_FORMAT(1e-9, 1e-3), "moment", i);
  }
}

/* Rigid-body velocity at the IMU, differentiated in the rotating axes. */
static void test_lever_arm_is_the_acceleration_of_its_place_on_a_rigid_body(void)
{
  tse_config c = default_car();
  const double dt = 0.002, ax = 0.7, ay = -0.4;
  const int rows = 2000;
  straight(&c, 15, dt, rows);
  for (int i = 0; i < rows; i++) {
    log_steer[i] = real(0.04 * sin(6 * i * dt) + 0.02);
    log_front[i] = real((15 + sin(2 * i * dt)) / 0.33);
  }
  replay(&c, rows);
  keep_readings();
  c.imu_lever_arm_x = setting(ax), c.imu_lever_arm_y = setting(ay);
  replay(&c, rows);
  for (int i = 200; i < rows - 1; i++) {
    const double r = number(got_yaw[i]), turn = (number(got_yaw[i + 1]) - number(got_yaw[i - 1])) / (2 * dt);
    const double px = -r * ay, py = r * ax; /* velocity of the IMU minus that of the centre */
    expect_near(-turn * ay - r * py, number(got_x[i]) - number(kept_x[i]), BY_FORMAT(1e-4, 3e-3), "x", i);
    expect_near(turn * ax + r * px, number(got_y[i]) - number(kept_y[i]), BY_FORMAT(1e-4, 3e-3), "y", i);
  }
}

/* A rotated IMU measures the same magnitude of the acceleration, and its direction
 * rotated back. */
static void test_misalignment_turns_the_acceleration_and_keeps_its_length(void)
{
  tse_config c = default_car();
  straight(&c, 15, 0.01, 500);
  for (int i = 0; i < 500; i++) {
    log_steer[i] = real(0.04 * sin(0.05 * i) + 0.02);
    log_front[i] = real((15 + sin(0.02 * i)) / 0.33);
  }
  replay(&c, 500);
  keep_readings();
  c.imu_misalignment_angle = setting(0.1);
  replay(&c, 500);
  for (int i = 50; i < 500; i++) {
    const double x0 = number(kept_x[i]), y0 = number(kept_y[i]), length = hypot(x0, y0);
    expect_near(length, hypot(number(got_x[i]), number(got_y[i])), BY_FORMAT(1e-12, 1e-5), "length", i);
    if (length < 0.5) continue;
    const double turned = atan2(y0, x0) - atan2(number(got_y[i]), number(got_x[i]));
    expect_near(0, sin(turned - 0.1), BY_FORMAT(1e-11, 1e-5), "direction", i);
  }
}

/* Let a car roll straight at 20 m/s on free wheels. In a single step of 20 ms a brake
 * acts on each axle.
 *   Updated:   at
 *   Returned:  its memory */
static tse_effect_memory brake_a_step(const tse_config *c, const double brake[2], double friction, point *at)
{
  const tse_params p = prepared(*c);
  const stiffness k = vehicle_stiffness(&p, TSE_R(0), TSE_R(0), TSE_R(0));
  tse_effect_memory m;
  acting to;
  memset(&m, 0, sizeof m);
  memset(at, 0, sizeof *at);
  memset(&to, 0, sizeof to);
  at->vx = at->u.v_front = at->u.v_rear = real(20);
  at->friction = real(friction);
  at->w.turning = 1;
  for (int a = 0; a < 2; a++) at->w.load[a] = real(1900 * 0.33 * 0.33 / 2.4), at->w.still[a] = real(0.06);
  effects_settle(&p, &m, k, at);
  to.w = at->w; /* free wheels: their speeds are states, and the inputs, 0 here, are ignored */
  for (int a = 0; a < 2; a++) to.w.brake[a] = real(brake[a]);
  effects_advance(&p, &m, k, &to, real(0.02), 1, at);
  at->p = NULL, at->m = NULL;
  return m;
}

/* An extremely strong brake stops its wheel within a step, except for the rotation by the
 * road, never into reverse, and on its own axle only. */
static void test_a_brake_stops_the_wheels_of_its_axle_within_a_step_and_no_others(void)
{
  for (int braked = 1; braked <= 3; braked++) {
    const double brake[2] = { braked & 1 ? 1e6 : 0, braked & 2 ? 1e6 : 0 };
    const tse_config c = default_car();
    point at;
    (void)brake_a_step(&c, brake, 0.8, &at);
    const tse_real speed[2] = { at.u.v_front, at.u.v_rear };
    for (int a = 0; a < 2; a++) {
      if (brake[a] > 0) TEST_ASSERT_TRUE(number(speed[a]) >= 0 && number(speed[a]) < 0.5);
      else expect_near(number(at.vx), number(speed[a]), 1, "rolls with the car", a);
    }
    TEST_ASSERT_TRUE(number(at.vx) < 20 && number(at.vx) > 10);
  }
}

/* Tyres with a relaxation length, however short, have no slip without drive. */
static void test_a_lag_along_the_car_moves_no_wheel_that_no_torque_turns(void)
{
  static const double length[] = { 1e-3, 0.02, 0.4 }, none[2] = { 0, 0 };
  for (int i = 0; i < ROWS(length); i++) {
    tse_config c = default_car();
    point at;
    c.longitudinal_relaxation_length = setting(length[i]);
    const tse_effect_memory m = brake_a_step(&c, none, 0, &at);
    expect_near(20, number(at.vx), BY_FORMAT(1e-9, 1e-4), "speed", i);
    expect_near(20, number(at.u.v_front), BY_FORMAT(1e-9, 1e-4), "front", i);
    expect_near(20, number(at.u.v_rear), BY_FORMAT(1e-9, 1e-4), "rear", i);
    for (int a = 2; a < 4; a++)
      expect_near(0, number(m.lag[a]), BY_FORMAT(1e-12, 1e-6), "held slip", 10 * i + a);
  }
}

/* Longitudinal and lateral force of an axle saturate together: the magnitude is that of a
 * brush, the direction that of linear tyres. */
static void test_an_axle_that_pulls_along_and_across_has_the_friction_for_both_together(void)
{
  const tse_params p = prepared(default_car());
  const double vx = 20, lf = 1.25, lr = 1.5, m = 1900, c_x = 1.6e5, c_y[2] = { 1.2e5, 1.4e5 };
  const double load[2] = { m * G * lr / 2.75, m * G * lf / 2.75 };
  uint32_t seed = 6;
  int slid = 0, gripped = 0;
  for (int n = 0; n < 200; n++) {
    const double mu = 0.3 * (n % 4), vy = n % 5 ? next_between(&seed, -2, 2) : 0,
                 r = n % 5 ? next_between(&seed, -0.5, 0.5) : 0;
    const double d = n % 5 ? next_between(&seed, -0.1, 0.1) : 0,
                 wheel[2] = { vx * next_between(&seed, 0.9, 1.1),
                   vx * (n % 3 ? next_between(&seed, 0.9, 1.1) : 1) };
    const double angle[2] = { d - (vy + lf * r) / vx, (lr * r - vy) / vx };
    double along[2], across[2];
    for (int a = 0; a < 2; a++) {
      along[a] = c_x * (wheel[a] - vx) / fmax(wheel[a], vx), across[a] = c_y[a] * angle[a];
      const double pull = hypot(along[a], across[a]), z = mu > 0 ? pull / (3 * mu * load[a]) : 0;
      const double left = !(pull > 0 && mu > 0) ? 1 : mu * load[a] * (z < 1 ? 1 - pow(1 - z, 3) : 1) / pull;
      slid += z >= 1, gripped += z > 0.1 && z < 0.9;
      along[a] *= left, across[a] *= left;
    }
    tse_effect_memory memory = { 0 };
    point pt = { 0 };
    pt.vx = real(vx), pt.vy = real(vy), pt.r = real(r), pt.friction = real(mu);
    pt.u.steer = real(d), pt.u.v_front = real(wheel[0]), pt.u.v_rear = real(wheel[1]);
    effects_at(&p, &memory, memory.lag, vehicle_stiffness(&p, real(0), real(0), real(0)), &pt);
    const double close = BY_FORMAT(1e-8, 2);
    expect_near(along[0], m * number(pt.fx_front), close, "front, along [N]", n);
    expect_near(along[1], m * number(pt.fx_rear), close, "rear, along [N]", n);
    expect_near(across[0] + along[0] * d + across[1], m * number(pt.force.y), close * 3, "across [N]", n);
    expect_near(lf * (across[0] + along[0] * d) - lr * across[1], 3000 * number(pt.force.yaw), close * 6,
        "moment [Nm]", n);
  }
  TEST_ASSERT_TRUE(slid > 20 && gripped > 20);
}

/* ---------------------------------------------------------------------- integrator.c */

/* A car of 20 m/s, or in reverse, in its steady state. Its wheels turn freely, or their
 * speeds are inputs.
 *   Updated:  m, at */
static void roll(
    const tse_params *p, double speed, double friction, int turning, tse_effect_memory *m, point *at)
{
  memset(m, 0, sizeof *m);
  memset(at, 0, sizeof *at);
  at->vx = at->u.v_front = at->u.v_rear = real(speed);
  at->friction = real(friction);
  at->w.turning = turning;
  at->w.load[0] = real(60), at->w.load[1] = real(90);
  at->w.still[0] = at->w.still[1] = real(0.06);
  effects_settle(p, m, vehicle_stiffness(p, TSE_R(0), TSE_R(0), TSE_R(0)), at);
}

/* An effect is on, so that the given disturbances count. It is too weak to matter. */
static tse_config with_effects(void)
{
  tse_config c = default_car();
  c.steering_offset_angle = setting(1e-5);
  return c;
}

/* All inputs change linearly within a row: two steps of one row are two rows of one step,
 * with the mean of the inputs between them. */
static void test_a_row_of_two_steps_is_two_rows_with_the_mean_of_the_inputs_between(void)
{
  for (int turning = 0; turning < 2; turning++) {
    tse_config c = with_effects();
    c.grade_angle = setting(0.01), c.bank_angle = setting(0.01);
    const tse_params p = prepared(c);
    const stiffness k = vehicle_stiffness(&p, TSE_R(0), TSE_R(0), TSE_R(0));
    tse_effect_memory m[2];
    point at[2];
    for (int halves = 0; halves < 2; halves++) {
      roll(&p, 20, 0.9, turning, &m[halves], &at[halves]);
      for (int n = halves ? 1 : 2; n <= 2; n++) {
        const double share = 0.5 * n;
        acting to;
        memset(&to, 0, sizeof to);
        to.w = at[halves].w;
        to.u.steer = real(0.01 * share), to.u.v_front = real(20 + 0.1 * share);
        to.u.v_rear = real(20 - 0.2 * share);
        to.g.grade = real(0.03 * share), to.g.bank = real(-0.02 * share);
        to.g.slip_front = real(0.01 * share), to.g.slip_rear = real(0.006 * share);
        to.g.x = real(0.2 * share), to.g.y = real(0.3 * share), to.g.yaw = real(0.1 * share);
        for (int a = 0; a < 2; a++)
          to.w.drive[a] = real((3 - a) * share), to.w.brake[a] = real((2 + a) * share);
        effects_advance(&p, &m[halves], k, &to, real(halves ? 0.005 : 0.01), halves ? 1 : 2, &at[halves]);
      }
    }
    const double close = BY_NUMBER(1e-12, 1e-5, 1e-7);
    expect_near(number(at[1].vx), number(at[0].vx), close, "vel_x", turning);
    expect_near(number(at[1].vy), number(at[0].vy), close, "vel_y", turning);
    expect_near(number(at[1].r), number(at[0].r), close, "yaw rate", turning);
    expect_near(number(at[1].u.v_front), number(at[0].u.v_front), close, "front", turning);
    expect_near(number(at[1].u.v_rear), number(at[0].u.v_rear), close, "rear", turning);
  }
}

/* What the tyres give the car they take from the wheels: without brakes, v_x plus the sum
 * of wheel speed / load changes by the sum of drive / load, for each axle its own
 * load. */
static void test_the_car_has_the_momentum_that_its_wheels_lose(void)
{
  for (int n = 0; n < 2; n++) {
    tse_config c = default_car();
    if (n) c.longitudinal_relaxation_length = setting(0.1);
    const tse_params p = prepared(c);
    tse_effect_memory m;
    point at;
    acting to;
    roll(&p, 20, 0, 1, &m, &at);
    memset(&to, 0, sizeof to);
    to.w = at.w;
    to.w.drive[0] = real(60), to.w.drive[1] = real(45);
    for (int i = 0; i < 100; i++)
      effects_advance(&p, &m, vehicle_stiffness(&p, TSE_R(0), TSE_R(0), TSE_R(0)), &to, real(0.01), 5, &at);
    const double momentum = number(at.vx) + number(at.u.v_front) / 60 + number(at.u.v_rear) / 90;
    /* the drive rises from 0 within the first row */
    expect_near(20 * (1 + 1.0 / 60 + 1.0 / 90) + (60 / 60.0 + 45 / 90.0) * (1 - 0.005), momentum,
        BY_FORMAT(1e-4, 1e-3), "momentum", n);
    TEST_ASSERT_TRUE(number(at.u.v_front) > number(at.vx) && number(at.u.v_rear) > number(at.vx));
  }
}

/* A brake acts against the rotation of its wheel in both directions, from a light touch
 * to a locked wheel. */
static void test_a_brake_in_reverse_is_the_mirror_of_a_brake_forwards(void)
{
  static const double brake[] = { 0, 2, 40, 300, 3000 }, speed[] = { 12, 0.5, 0.05 };
  for (int n = 0; n < 2 * ROWS(brake) * ROWS(speed); n++) {
    const tse_params p = prepared(default_car());
    tse_effect_memory m[2];
    point at[2];
    for (int back = 0; back < 2; back++) {
      acting to;
      const double v = speed[n / 2 % ROWS(speed)], b = brake[n / 2 / ROWS(speed)];
      roll(&p, back ? -v : v, n % 2 ? 0.8 : 0, 1, &m[back], &at[back]);
      memset(&to, 0, sizeof to);
      to.w = at[back].w;
      to.w.brake[0] = real(b), to.w.brake[1] = real(0.5 * b);
      for (int i = 0; i < 10; i++)
        effects_advance(
            &p, &m[back], vehicle_stiffness(&p, TSE_R(0), TSE_R(0), TSE_R(0)), &to, real(0.01), 1, &at[back]);
    }
    expect_near(-number(at[0].vx), number(at[1].vx), BY_NUMBER(1e-12, 1e-5, 1e-6), "vel_x", n);
    expect_near(-number(at[0].u.v_front), number(at[1].u.v_front), BY_NUMBER(1e-11, 1e-4, 1e-5), "front", n);
    expect_near(-number(at[0].u.v_rear), number(at[1].u.v_rear), BY_NUMBER(1e-11, 1e-4, 1e-5), "rear", n);
    if (n % 2) TEST_ASSERT_TRUE(number(at[0].vx) >= -1e-6 && number(at[0].vx) <= number(real(12)));
  }
}

/* A brake does not move a wheel that stands. */
static void test_a_brake_holds_a_car_that_stands(void)
{
  for (int n = 0; n < 2; n++) {
    const tse_params p = prepared(default_car());
    tse_effect_memory m;
    point at;
    acting to;
    roll(&p, 0, n ? 0.8 : 0, 1, &m, &at);
    memset(&to, 0, sizeof to);
    to.w = at.w;
    to.w.brake[0] = real(100), to.w.brake[1] = real(60);
    for (int i = 0; i < 10; i++)
      effects_advance(&p, &m, vehicle_stiffness(&p, TSE_R(0), TSE_R(0), TSE_R(0)), &to, real(0.01), 1, &at);
    expect_near(0, number(at.vx), 0, "car", n);
    expect_near(0, number(at.u.v_front), 0, "front", n);
    expect_near(0, number(at.u.v_rear), 0, "rear", n);
  }
}

/* At rest the lagged slips are the slips of their axle, and the modes are the
 * accelerations that excite them, whatever the memory was. A lag of slip has the rate of
 * its own axle, v/length with the v of the slip. */
static void test_a_settled_memory_is_in_steady_state(void)
{
  tse_config c = default_car();
  c.relaxation_length = setting(0.4), c.longitudinal_relaxation_length = setting(0.2);
  c.body_roll_gain = setting(0.006), c.body_roll_frequency = setting(1.5);
  c.pitch_leak_gain = setting(0.02);
  const tse_params p = prepared(c);
  tse_effect_memory m;
  point at;
  memset(&m, 0, sizeof m);
  memset(&at, 0, sizeof at);
  for (int i = 0; i < 3; i++) m.mode[i][0] = real(3), m.mode[i][1] = real(5);
  for (int i = 0; i < 4; i++) m.lag[i] = real(0.3);
  at.vx = real(20), at.r = real(0.2), at.vy = real(-0.3);
  at.u.steer = real(0.03), at.u.v_front = real(20.25), at.u.v_rear = real(22);
  effects_settle(&p, &m, vehicle_stiffness(&p, TSE_R(0), TSE_R(0), TSE_R(0)), &at);
  const double close = BY_NUMBER(1e-6, 1e-4, 1e-4);
  expect_near(number(at.s.s_front), number(m.lag[2]), 1e-6, "slip, front", 0);
  expect_near(number(at.s.s_rear), number(m.lag[3]), 1e-6, "slip, rear", 0);
  expect_near(0.25 / 20.25, number(m.lag[2]), 1e-6, "slip of the front wheels", 0);
  expect_near(2 / 22.0, number(m.lag[3]), 1e-6, "slip of the rear wheels", 0);
  expect_near(20.25 / 0.2, number(at.rate[2]), 1e-3, "rate, front", 0);
  expect_near(22 / 0.2, number(at.rate[3]), 1e-3, "rate, rear", 0);
  for (int i = 0; i < 3; i++) expect_near(0, number(m.mode[i][1]), 0, "the modes stand still", i);
  expect_near(number(at.force.y), number(m.mode[MODE_ROLL][0]), close, "roll", 0);
  expect_near(number(at.force.x), number(m.mode[MODE_PITCH][0]), close, "pitch", 0);
  TEST_ASSERT_EQUAL_INT32(1, m.settled);
}

/* A roll that steers the rear axle changes the force that causes it. The settled roll is
 * within 1 % of this change. */
static void test_a_settled_roll_is_that_of_the_force_that_it_causes(void)
{
  tse_config c = default_car();
  point at;
  tse_effect_memory m;
  c.rear_roll_steer_gain = setting(0.02);
  const tse_params p = prepared(c);
  memset(&m, 0, sizeof m);
  memset(&at, 0, sizeof at);
  at.vx = at.u.v_front = at.u.v_rear = real(20), at.r = real(0.2), at.u.steer = real(0.03);
  effects_settle(&p, &m, vehicle_stiffness(&p, TSE_R(0), TSE_R(0), TSE_R(0)), &at);
  expect_near(number(at.force.y), number(m.mode[MODE_ROLL_STEER][0]), 0.005, "roll", 0);
  TEST_ASSERT_TRUE(number(at.force.y) > 1);
}

/* After a row the point is the one at the state and memory of its end. */
static void test_after_a_row_the_point_belongs_to_its_memory(void)
{
  for (int n = 0; n < 2; n++) {
    tse_config c = default_car();
    c.rear_roll_steer_gain = setting(n ? 0 : 0.5);
    if (n) {
      c.formula_code_1 = 21 | 1 << 8 | 34 << 16; /* accel_y a mul */
      c.formula_a = setting(0.05), c.formula_gain = setting(1), c.formula_place = 1;
    }
    const tse_params p = prepared(c);
    const stiffness k = vehicle_stiffness(&p, TSE_R(0), TSE_R(0), TSE_R(0));
    tse_effect_memory m;
    point at;
    acting to;
    roll(&p, 20, 0, 0, &m, &at);
    memset(&to, 0, sizeof to);
    to.u.steer = real(0.04), to.u.v_front = to.u.v_rear = real(20);
    effects_advance(&p, &m, k, &to, real(0.02), 2, &at);
    point again = at;
    TEST_ASSERT_EQUAL_INT(1, at.ahead == TSE_R(0));
    effects_at(&p, &m, m.lag, k, &again);
    expect_near(number(again.force.y), number(at.force.y), 0, "across", n);
    expect_near(number(again.force.yaw), number(at.force.yaw), 0, "yaw", n);
    TEST_ASSERT_TRUE(number(at.force.y) > 0.1);
  }
}

/* A relaxation length of a millimetre is as none, also for inputs and disturbances that
 * change within a row, and for wheels that turn freely. */
static void test_a_relaxation_of_hardly_any_length_changes_nothing(void)
{
  for (int turning = 0; turning < 2; turning++) {
    tse_effect_memory m[2];
    point at[2];
    for (int lags = 0; lags < 2; lags++) {
      tse_config c = with_effects();
      if (lags) c.relaxation_length = c.longitudinal_relaxation_length = setting(0.001);
      const tse_params p = prepared(c);
      roll(&p, 20, 0, turning, &m[lags], &at[lags]);
      for (int i = 1; i <= 60; i++) {
        acting to;
        const double t = 0.01 * i;
        memset(&to, 0, sizeof to);
        to.w = at[lags].w;
        to.u.steer = real(0.02 * sin(3 * t)), to.u.v_front = real(20 + t), to.u.v_rear = real(20 + 0.5 * t);
        to.g.slip_front = real(0.02 * sin(5 * t)), to.g.slip_rear = real(0.03 * sin(4 * t));
        to.w.drive[0] = real(200 * t), to.w.drive[1] = real(100 * t);
        effects_advance(
            &p, &m[lags], vehicle_stiffness(&p, TSE_R(0), TSE_R(0), TSE_R(0)), &to, real(0.01), 1, &at[lags]);
      }
    }
    expect_near(number(at[0].vx), number(at[1].vx), BY_FORMAT(1e-3, 2e-3), "vel_x", turning);
    expect_near(number(at[0].vy), number(at[1].vy), BY_FORMAT(1e-3, 2e-3), "vel_y", turning);
    expect_near(number(at[0].r), number(at[1].r), BY_FORMAT(1e-3, 2e-3), "yaw rate", turning);
    expect_near(number(at[0].force.y), number(at[1].force.y), 10 * BY_FORMAT(1e-3, 2e-3), "accel_y", turning);
    expect_near(number(at[0].force.x), number(at[1].force.x), 10 * BY_FORMAT(1e-3, 2e-3), "accel_x", turning);
    expect_near(number(at[0].force.yaw), number(at[1].force.yaw), 10 * BY_FORMAT(1e-3, 2e-3), "yaw", turning);
  }
}

/* However many rows a delay has, the stored samples span it: a line in time is delayed
 * exactly. */
static void test_stored_samples_always_span_the_delay(void)
{
  static const double dt[] = { 0.1 / 8.9, 0.1 / 9.1, 0.1 / 10.5, 0.1 / 11, 0.1 / 30, 0.03 };
  for (int n = 0; n < ROWS(dt); n++) {
    tse_delay d;
    tse_real was[1][TSE_DELAY_ROWS];
    memset(&d, 0, sizeof d);
    memset(was, 0, sizeof was);
    for (int i = 0; i < 150; i++) {
      const tse_real value = real(0.5 * dt[n] * i);
      effects_delay_put(&d, was, real(0.1), i ? real(dt[n]) : real(0), &value, 1);
      if (dt[n] * i < 0.15) continue;
      expect_near(0.5 * (dt[n] * i - 0.1), number(effects_delay_get(&d, was[0], real(0.1))),
          BY_NUMBER(1e-12, 1e-6, 1e-7), "delayed", 1000 * n + i);
    }
  }
}
