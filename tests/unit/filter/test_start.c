/* tests/unit/filter/test_start.c <-> src/filter/start.c: the prior, and the motion of a
 * steady turn from wheel speeds and gyro, by the balance of forces and moments. */
#include "filter/start.h"
#include "filter_support.h"

/* Without data all is as in the settings: a channel is expected to repeat its value, no
 * event has happened, and the model error is that of the settings. */
static void test_the_filter_starts_at_its_settings(void)
{
  static const double model[] = { 0, 2 }; /* model_sd / USUAL_MODEL_SD */
  for (int n = 0; n < ROWS(model); n++) {
    static tse_filter f;
    tse_config c = config_by(tse_config_exact);
    c.model_sd = setting(model[n] * number(USUAL_MODEL_SD));
    const tse_params p = prepared(c);
    memset(&f, 0, sizeof f);
    start_state(&p, &f);
    for (int i = 0; i < TSE_VALUES; i++) expect_near(number(p.prior[i]), number(f.k.x[i]), 0, "mean", i);
    for (int i = 0; i < STATES; i++) {
      const double sd = number(p.prior_sd[i]) / number(state_unit[i]);
      expect_near(
          sd * sd, number(ud_variance(&f.k.ud, i)), BY_NUMBER(1e-9, 1e-5, 1e-5) * (1 + sd * sd), "var", i);
    }
    for (int a = 0; a <= STEERING; a++) expect_near(1, number(f.k.repeats[a]), 0, "share of repeats", a);
    for (int a = 0; a < TSE_SENSORS; a++) {
      expect_near(1, number(f.k.noise[a]), 0, "noise", a);
      expect_near(1 + model[n] * model[n], number(f.k.usual[a]), 1e-4, "usual", a);
    }
    for (int g = 0; g < TSE_GROUPS; g++) expect_near(1, number(f.k.none[g]), 0, "no event", g);
  }
}

enum { WORKS, MISSING, FROZEN, FAULTY }; /* gyro */

typedef struct placing {
  const char *what;
  int driven, front, rear, gyro; /* driven axle; 1: the row has this wheel speed; state of the gyro */
  double axle[2], steer, read;   /* [m/s] [rad] [rad/s] of the row */
  double v, r;                   /* [m/s] [rad/s] the motion that follows; gyro bias 0.01 */
} placing;

/* The speed of the car is that of an axle that rolls freely, if the row has it. */
static void test_the_motion_is_that_of_a_steady_turn(void)
{
  static const placing cases[] = {
    { "front driven", 1, 1, 1, WORKS, { 21, 20 }, 0.02, 0.16, 20, 0.15 },
    { "rear driven", 2, 1, 1, WORKS, { 20, 21 }, 0.3, 0.16, 20 * 0.95534, 0.15 },
    { "rear driven, to the right", 2, 1, 1, WORKS, { 20, 21 }, -0.3, -0.14, 20 * 0.95534, -0.15 },
    { "both driven", 0, 1, 1, WORKS, { 21, 20 }, 0.3, 0.16, 20, 0.15 },
    { "rear driven, rear speed alone", 2, 0, 1, WORKS, { 0, 20 }, 0.3, 0.16, 20, 0.15 },
    { "front driven, front speed alone", 1, 1, 0, WORKS, { 20, 0 }, 0.3, 0.16, 20 * 0.95534, 0.15 },
    { "no wheel speed", 1, 0, 0, WORKS, { 0, 0 }, 0.02, 0.16, 15, 0.15 },
    { "no gyro", 1, 1, 1, MISSING, { 20, 20 }, 0.02, 0, 20, 0 },
    { "frozen gyro", 1, 1, 1, FROZEN, { 20, 20 }, 0.02, 0.16, 20, 0 },
    { "gyro at fault", 1, 1, 1, FAULTY, { 20, 20 }, 0.02, 0.16, 20, 0 },
    { "at the limit of the tyres", 1, 1, 1, WORKS, { 40, 40 }, 0.02, 0.81, 40, 0.8 },
    { "the same to the right", 1, 1, 1, WORKS, { 40, 40 }, -0.02, -0.79, 40, -0.8 },
    { "hardly rolling", 1, 1, 1, WORKS, { 0.5, 0.5 }, 0.3, 2.01, 0.5, 2 },
  };
  for (int n = 0; n < ROWS(cases); n++) {
    const placing *const t = &cases[n];
    static tse_kalman k;
    uint32_t seed = 3;
    tse_config c = config_by(tse_config_exact);
    c.driven_axle = t->driven, c.body_roll_gain = setting(0.005);
    const tse_params p = prepared(c);
    decoded z = { 0 };
    memset(&k, 0, sizeof k);
    any_covariance(&k.ud, &seed);
    for (int i = 0; i < STATES; i++) k.x[i] = real(0.1);
    k.x[VX] = TSE_R(15), k.x[BR] = real(0.01), k.x[LCF] = real(0.3), k.x[LCR] = real(-0.2);
    z.has_steer = 1, z.steer = real(t->steer);
    z.use[WHEEL_FRONT] = t->front, z.use[WHEEL_REAR] = t->rear, z.use[YAW_RATE] = t->gyro != MISSING;
    z.z[WHEEL_FRONT] = real(t->axle[0]), z.z[WHEEL_REAR] = real(t->axle[1]), z.z[YAW_RATE] = real(t->read);
    if (t->gyro == FROZEN) k.frozen[YAW_RATE] = TSE_R(500);
    if (t->gyro == FAULTY) k.fault = fault_of(YAW_RATE);
    start_motion(&p, &k, &z);

    /* forces per mass: F_f + F_r = v r, l_f F_f = l_r F_r */
    const double lf = number(p.car.lf), lr = number(p.car.lr), rear = t->v * t->r / (1 + lr / lf),
                 front = t->v * t->r - rear;
    const double max = number(MAX_TURN_SLIP_ANGLE), close = BY_NUMBER(2e-5, 3e-5, 1e-4);
    const double slip[2] = { fmax(-max, fmin(max, front / (number(p.car.ky_front) * exp(0.3)))),
      fmax(-max, fmin(max, rear / (number(p.car.ky_rear) * exp(-0.2)))) };
    const double speed = fmax(t->v, 1); /* of slip angles of a car that hardly rolls */
    expect_near(t->v, number(k.x[VX]), 0.01, t->what, VX);
    expect_near(t->r, number(k.x[YAW]), 1e-6, t->what, YAW);
    expect_near(slip[0], number(k.x[AF]), close, t->what, AF);
    expect_near(slip[1], number(k.x[AR]), close, t->what, AR);
    expect_near(lr * t->r - speed * slip[1], number(k.x[VY]), 1e-3, t->what, VY);
    expect_near(0.005 * t->v * t->r, number(k.x[PHI]), 1e-4, t->what, PHI);
    for (int i = PHI + 1; i < PLACED; i++) expect_near(0, number(k.x[i]), 0, t->what, i);

    const double sd[] = { 0.1 + 0.02 * t->v, 0.1 + t->v * fabs(slip[1]),
      (t->gyro == WORKS ? 0.02 : 0.2) + 0.05 * fabs(t->r), 0.01 + fabs(slip[0]), 0.01 + fabs(slip[1]), 0.01,
      0.05, 0.02, 0.02 };
    for (int i = 0; i < PLACED; i++) {
      expect_near(sd[i], sqrt(number(ud_variance(&k.ud, i))) * number(state_unit[i]),
          0.01 * sd[i] + BY_NUMBER(0, 0, 1e-4), t->what, 100 + i);
      for (int j = 0; j < STATES; j++)
        if (j != i) expect_near(0, number(ud_covariance(&k.ud, i, j)), 0, t->what, 200 + i);
    }
  }
}

/* What the filter keeps of earlier rows beside the state - steering lags, pitch, lateral
 * acceleration, sensitivities - is that of a steady turn, too. */
static void test_nothing_of_the_motion_before_remains(void)
{
  static tse_kalman k;
  const tse_params p = prepared(config_by(tse_config_exact));
  decoded z = { 0 };
  memset(&k, 0, sizeof k);
  for (int i = 0; i < 2; i++) k.pitch[i] = TSE_R(3);
  for (int i = 0; i < 3; i++) k.steer[i] = real(0.5), k.before[i] = TSE_R(7);
  for (int i = 0; i < STATES; i++) {
    for (int n = 0; n < TSE_EVENTS; n++) k.event[n].v[i] = short_of(1);
    for (int q = 0; q < TSE_CONSIDERED; q++) k.consider[q][i] = short_of(1);
  }
  z.use[WHEEL_FRONT] = z.use[WHEEL_REAR] = z.use[YAW_RATE] = 1, z.has_steer = 1;
  z.steer = real(0.02), z.z[WHEEL_FRONT] = z.z[WHEEL_REAR] = TSE_R(20), z.z[YAW_RATE] = real(0.15);
  start_motion(&p, &k, &z);
  for (int i = 0; i < 2; i++) expect_near(0, number(k.pitch[i]), 0, "pitch and its rate", i);
  for (int i = 0; i < 3; i++) expect_near(0.02, number(k.steer[i]), 1e-6, "angle, after each lag", i);
  const double row[] = { 0, 20 * 0.15, 20 };
  for (int i = 0; i < 3; i++) expect_near(row[i], number(k.before[i]), 1e-5, "previous row", i);
  for (int i = 0; i < STATES; i++) {
    for (int n = 0; n < TSE_EVENTS; n++) expect_near(i >= PLACED, number_of(k.event[n].v[i]), 0, "event", i);
    for (int q = 0; q < TSE_CONSIDERED; q++)
      expect_near(i >= PLACED, number_of(k.consider[q][i]), 0, "uncertain", i);
  }
}
