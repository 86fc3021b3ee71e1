/* tests/fuzz/drives.c - long random drives through the Kalman filter and the particle
 * filter: random settings, thousands of rows, faults, pauses, optional channels, learnt
 * states. Checks for every row: the estimates are finite and within their ranges; the sd
 * of a valid stiffness is below its limit; tse_filter_check() accepts the state; a
 * refused row changes nothing; the age of a change grows by the time that has passed. For
 * every sixteenth row: a filter that was asked for no output estimates the same bits from
 * then on.
 *
 *   drives ROWS [FIRST_DRIVE]   exit code 1 on failures, with drive and row of the first
 *                               ten. The number of a drive reproduces it. */
#include "fuzz.h"

enum { MOST_FOUND = 10 };

/* The drive in progress. */
static struct {
  tse_config c;
  tse_params p;
  tse_filter_paper f, before, twin; /* twin: steps a row without output, and the next with it */
  size_t bytes;
  uint64_t word;
  uint32_t drive, row;
  int found;
  int twin_runs; /* 1: the twin has stepped one row */
  double time;   /* [s] of the rows since the reset */
  double at;     /* [s] time of the last estimate */
  double age;    /* [s] change_age of the last estimate */
  int kind;      /* change_kind of the last estimate */
  int changed;   /* number of consecutive estimates at which something has just changed */
} d;

/* Return a uniform random number in 0 .. 1 (xorshift64). */
static double uniform(void)
{
  d.word ^= d.word << 13;
  d.word ^= d.word >> 7;
  d.word ^= d.word << 17;
  return (double)(d.word >> 11) / 9007199254740992.0;
}
static double between(double lo, double hi) { return lo + (hi - lo) * uniform(); }
static int chance(double share) { return uniform() < share; }
static uint32_t below(uint32_t n) { return (uint32_t)(uniform() * n) % n; }

/* Report a failed check. */
static void found(const char *what, double value, const tse_input *u)
{
  d.found++;
  (void)printf("drive %u, row %u, form %d: %s is %g; dt %g, missing %x, given %x, steer %g, wheels %g %g, ax "
               "%g, ay %g, r %g\n",
      (unsigned)d.drive, (unsigned)d.row, (int)d.c.form, what, value, number(u->dt), (unsigned)u->missing,
      (unsigned)u->given, number(u->steer_angle), number(u->wheel_speed_front), number(u->wheel_speed_rear),
      number(u->accel_x), number(u->accel_y), number(u->yaw_rate));
}

/* ---- settings */

/* Choose settings: default or exact, with up to 20 of them changed at random. */
static void any_settings(void)
{
  uint32_t count;
  const setting *const all = settings_of(&count);
  const uint32_t how = below(4);
  if (how == 1) tse_config_default(&d.c);
  else tse_config_exact(&d.c);
  for (uint32_t left = how < 2 ? 0 : 1 + below(how == 2 ? 4 : 20); left > 0; left--) {
    const setting *const s = &all[below(count)];
    const double share = uniform(), cube = share * share * share, from = get_setting(&d.c, s),
                 sign = chance(0.5) ? s->hi - from : s->lo - from;
    put_setting(&d.c, s, chance(0.2) ? s->hi : chance(0.2) ? s->lo : from + sign * cube);
  }
  d.c.form = TSE_LAST_FORM && chance(0.1) ? 1 : 0;
  d.c.particles = 16 + (int32_t)below(48);
}

/* ---- rows: a car that follows its steering, and disturbances of its log */

typedef struct car {
  double t, v, yaw, steer, pace, along, noise;
} car;

static car any_car(void)
{
  const car c = { 0, between(-3, 60), 0, between(0, 0.15), between(0.2, 6), between(0, 6), between(0, 2) };
  return c;
}

static double noise(const car *c, double sd)
{
  return c->noise * sd * (uniform() + uniform() + uniform() - 1.5) * 2;
}

/* Return the next row of the car. */
static tse_input car_row(car *c, double dt)
{
  const double h = dt < 1 ? dt : 1, steer = c->steer * sin(c->pace * c->t),
               along = c->along * sin(0.7 * c->t);
  tse_input u;
  c->t += h;
  c->v = fmax(-5, fmin(80, c->v + h * along));
  const double turn = fmax(
      -9 / fmax(fabs(c->v), 3), fmin(9 / fmax(fabs(c->v), 3), c->v * steer / (2.75 + 0.0025 * c->v * c->v)));
  c->yaw += (turn - c->yaw) * h / (h + 0.1);
  tse_input_default(&u);
  u.dt = real_of(dt);
  u.steer_angle = real_of(steer);
  u.wheel_speed_front = real_of(c->v / 0.33 * (1 + 0.006 * along) + noise(c, 0.1));
  u.wheel_speed_rear = real_of(c->v / 0.33 + noise(c, 0.1));
  u.accel_x = real_of(along + noise(c, 0.15));
  u.accel_y = real_of(c->yaw * c->v + noise(c, 0.15));
  u.yaw_rate = real_of(c->yaw + noise(c, 0.004));
  return u;
}

/* Add these optional channels to a row, consistent with the car. */
static void give(tse_input *u, const car *c, uint32_t given)
{
#if defined(TSE_NO_VELOCITY)
  given &= ~TSE_GIVEN_VELOCITIES;
#endif
  if (d.c.form) given = 0;
  u->given = given;
  u->ins_vel_x = real_of(c->v + noise(c, 0.1));
  u->ins_vel_y = real_of(noise(c, 0.3));
  u->gnss_speed = real_of(fabs(c->v) + noise(c, 0.1));
  u->gnss_course = real_of(6.28 * (uniform() - 0.5) * (chance(0.01) ? 1 : 0.01));
  u->brake = real_of(c->v < 10);
  u->wheel_torque_front = real_of(between(-100, 100));
  u->wheel_torque_rear = real_of(between(-100, 3000));
  u->bank = real_of(0.05 * sin(0.1 * c->t));
  u->grade = real_of(0.05 * cos(0.1 * c->t));
}

/* Kinds of disturbances, each for a number of rows. */
enum {
  NOTHING,
  STUCK,
  OFFSET,
  LOUD,
  MISSING,
  OUT_OF_RANGE,
  JUMPING,
  WILD,
  PAUSES,
  STANDING,
  NO_STEERING,
  NO_WHEELS,
  ONE_SPEED,
  ODD,
  EVENTS
};

typedef struct event {
  uint32_t kind, channel, rows, mask;
  double size;
} event;

static event any_event(void)
{
  const event e = { chance(0.4) ? (uint32_t)NOTHING : below(EVENTS), below(TSE_CHANNELS),
    1 + below(chance(0.2) ? 2000 : 200), below(64), uniform() };
  return e;
}

/* Disturb a row. */
static void spoil(const event *e, tse_input *u, const tse_input *last)
{
  static const double sizes[] = { 0.5, 100, 100, 20, 20, 3 };
  tse_input held = *last;
  const tse_field *const range = channel_field(e->channel);
  tse_real *const x = channel_of(u, e->channel);
  switch (e->kind) {
    case STUCK: *x = *channel_of(&held, e->channel); break;
    case OFFSET: *x = real_of(number(*x) + (e->size - 0.5) * sizes[e->channel]); break;
    case LOUD: *x = real_of(number(*x) + (uniform() - 0.5) * e->size * sizes[e->channel]); break;
    case MISSING: u->missing = chance(0.5) ? e->mask : below(64); break;
    case OUT_OF_RANGE: *x = real_of(range->hi * between(1.001, 1 + 10 * e->size)); break;
    case JUMPING: *x = real_of(chance(0.5) ? range->lo : range->hi); break;
    case WILD:
      for (uint32_t k = 0; k < TSE_CHANNELS; k++)
        if (chance(e->size)) *channel_of(u, k) = real_of(between(channel_field(k)->lo, channel_field(k)->hi));
      break;
    case PAUSES:
      if (chance(0.5)) u->dt = real_of(pow(10, between(-4, 3.55)));
      if (chance(0.3)) u->missing = below(64);
      break;
    case STANDING: u->wheel_speed_front = u->wheel_speed_rear = real_of(0); break;
    case NO_STEERING: u->missing |= TSE_MISSING_steer_angle; break;
    case NO_WHEELS: u->missing |= TSE_MISSING_wheel_speed_front | TSE_MISSING_wheel_speed_rear; break;
    case ONE_SPEED: u->wheel_speed_front = u->wheel_speed_rear; break;
    case ODD: {
      uint8_t any[1] = { (uint8_t)below(256) };
      bytes b = { any, 1 };
      *x = real_of(take_odd(&b));
      break;
    }
    default: break;
  }
}

/* Replace channels by random values within their ranges. */
static void any_row(tse_input *u, int pause)
{
  for (uint32_t k = 0; k < TSE_CHANNELS; k++)
    if (chance(0.9)) *channel_of(u, k) = real_of(between(channel_field(k)->lo, channel_field(k)->hi));
  if (pause) u->dt = real_of(pow(10, between(-4, 3.55)));
  if (chance(0.2)) u->missing = below(64);
}

/* ---- checks */

static void expect(int true_of_it, const char *what, double value, const tse_input *u)
{
  if (!true_of_it && d.found < MOST_FOUND) found(what, value, u);
}

static void expect_within(tse_real x, double lo, double hi, const char *what, const tse_input *u)
{
  expect(is_number(x) && number(x) >= lo && number(x) <= hi, what, number(x), u);
}

#define MOST_SD 1e9 /* largest sd, of a lost state; its square fits in float */

static void check_estimates(const tse_output *y, int status, const tse_input *u)
{
  const double most = 1.001 * tse_double_of_setting(d.c.stiffness_max),
               start = 0.999 * tse_double_of_setting(d.c.stiffness_min);
  const double least = d.c.form == 1 && !d.c.reflect_draws && 2.0 - most < start ? 2.0 - most : start;
  const double most_ratio = 1.01 * most / (start > 1e-3 ? start : 1e-3); /* from one limit to the other */
  const double valid = tse_double_of_setting(d.c.valid_sd);
  for (const tse_real *x = &y->sideslip; x <= &y->log_evidence; x++)
    expect(is_number(*x), "an estimate", (double)(x - &y->sideslip), u);
  expect_within(y->sideslip, -3.1416, 3.1416, "sideslip", u);
  expect_within(y->sideslip_sd, 0, 1000, "sideslip_sd", u);
  expect_within(y->vel_x, -FASTEST, FASTEST, "vel_x", u);
  expect_within(y->vel_y, -FASTEST, FASTEST, "vel_y", u);
  expect_within(y->yaw_rate, -FASTEST_TURN, FASTEST_TURN, "yaw_rate", u);
  expect_within(y->vel_x_sd, 0, d.c.form ? MOST_SD : FASTEST, "vel_x_sd", u);
  expect_within(y->vel_y_sd, 0, d.c.form ? MOST_SD : FASTEST, "vel_y_sd", u);
  expect_within(y->yaw_rate_sd, 0, d.c.form ? MOST_SD : FASTEST_TURN, "yaw_rate_sd", u);
  expect_within(y->grip, 0, 3000, "grip", u);
  expect_within(y->grip_sd, 0, MOST_SD, "grip_sd", u);
  for (int c = 0; c < 5; c++) expect_within(y->nis[c], 0, 1e9, "nis", u);
  expect_within(y->lag_steer, -0.4, 0.4, "lag_steer", u); /* state 0.2, settings 0.4 */
  expect_within(y->lag_steer_sd, 0, 1000, "lag_steer_sd", u);
  expect_within(y->change_age, 0, 1e6 + 1, "change_age", u);
  expect_within(y->change_probability, 0, 1.00001, "change_probability", u);
  expect_within(y->estimate_age, 0, TSE_LONGEST_DT + 1, "estimate_age", u);
  for (int a = 0; a < 3; a++) {
    const double max_bias = 1.001 * channel_field(TSE_CHANNEL_accel_x + (uint32_t)a)->hi;
    expect_within(y->stiffness[a], least, most, "stiffness", u);
    expect_within(y->stiffness_sd[a], 0, MOST_SD, "stiffness_sd", u);
    expect_within(y->stiffness_spread[a], 0, MOST_SD, "stiffness_spread", u);
    expect_within(y->stiffness_secant[a], least < 0 ? 4 * least : 0, 4 * most, "stiffness_secant", u);
    expect_within(y->bias[a], -max_bias, max_bias, "bias", u);
    expect_within(y->bias_sd[a], 0, MOST_SD, "bias_sd", u);
    expect_within(y->discrepancy[a], 0, 1e6, "discrepancy", u);
    expect_within(y->change_ratio[a], 0, most_ratio, "change_ratio", u);
    expect(y->reason[a] >= TSE_VALID && y->reason[a] <= TSE_IMPLAUSIBLE, "reason", y->reason[a], u);
    if (d.c.form == 0 && y->reason[a] == TSE_VALID)
      expect(number(y->stiffness_sd[a]) <= 1.001 * valid * number(y->stiffness[a]), "sd of a valid stiffness",
          number(y->stiffness_sd[a]), u);
  }
  for (int k = 0; k < 5; k++) {
    expect_within(y->noise[k], 0, 1e6, "noise", u);
    expect_within(y->innovation[k], -1e6, 1e6, "innovation", u);
  }
  for (int k = 0; k < TSE_REGIMES; k++) expect_within(y->regime[k], 0, 1.00001, "regime", u);
  expect(y->change_kind >= TSE_CHANGE_NONE && y->change_kind <= TSE_CHANGE_RESTART, "change_kind",
      y->change_kind, u);
  expect(y->fault_channel >= 0 && y->fault_channel <= (int)(TSE_CHANNELS + TSE_VELOCITIES), "fault_channel",
      y->fault_channel, u);
  expect(y->grip_reason >= TSE_VALID && y->grip_reason <= TSE_IMPLAUSIBLE, "grip_reason", y->grip_reason, u);
  expect(y->status == status && status <= TSE_W_IMPLAUSIBLE, "status", status, u);
}

#define OLDEST 1e4          /* [s] beyond this age a short row is below the resolution of float */
#define SHORTEST 1e-3       /* [s] shorter times are below the resolution at the oldest age */
enum { MOST_CHANGES = 20 }; /* at consecutive estimates; restarts are not counted */

/* Check that the age of a change has grown by the time since the last estimate, or that
 * something changed within this time, which cannot happen at every estimate (a restart
 * can, with odd settings). Pauses in which the rows waited for a late channel are one
 * step, of at most TSE_LONGEST_DT. */
static void check_age(const tse_output *y, const tse_input *u)
{
  const double age = number(y->change_age), at = d.time - number(y->estimate_age);
  const double passed = fmin(at - d.at, TSE_LONGEST_DT), grown = age - d.age;
  const double tolerance = SHORTEST + 1e-4 * (age + passed);
  const int had_change = d.kind != TSE_CHANGE_NONE && y->change_kind != TSE_CHANGE_NONE;
  if (had_change && d.age < OLDEST && passed > 2 * SHORTEST) {
    const int grew = fabs(grown - passed) <= tolerance;
    d.changed = grew || y->change_kind == TSE_CHANGE_RESTART ? 0 : d.changed + 1;
    expect(grew || age <= passed + tolerance, "growth of change_age", grown - passed, u);
    expect(d.changed <= MOST_CHANGES, "number of changes at consecutive estimates", d.changed, u);
  }
  d.at = at;
  d.age = age;
  d.kind = y->change_kind;
}

/* Check that a filter that was asked for no output in the row before gives the same. */
static void check_twin(const tse_input *u, const tse_output *y, tse_status status)
{
  if (d.twin_runs) {
    tse_output same;
    memset(&same, 0x5a, sizeof same);
    const tse_status said = tse_step(&d.p, &d.twin.filter, u, &same);
    expect(said == status, "status after a row without output", said, u);
    expect(memcmp(&same, y, sizeof same) == 0, "an estimate after a row without output, other", said, u);
  }
  d.twin_runs = d.row % 16 == 0;
  if (!d.twin_runs) return;
  memcpy(&d.twin, &d.before, d.bytes);
  const tse_status said = tse_step(&d.p, &d.twin.filter, u, NULL);
  expect(said == status, "status without output", said, u);
}

/* Run a row and check the results. */
static void step(const tse_input *u)
{
  tse_output y, untouched;
  memset(&y, 0x5a, sizeof y);
  memcpy(&untouched, &y, sizeof y);
  memcpy(&d.before, &d.f, d.bytes);
  const tse_status status = tse_step(&d.p, &d.f.filter, u, &y);
  d.row++;
  check_twin(u, &y, status);
  if (status < 0) {
    expect(memcmp(&d.before, &d.f, d.bytes) == 0, "a filter that refused, changed", status, u);
    expect(memcmp(&untouched, &y, sizeof y) == 0, "an output that was refused, changed", status, u);
    return;
  }
  check_estimates(&y, (int)status, u);
  d.time += number(u->dt);
  if (d.c.form == 0 && status != TSE_W_WAITING) check_age(&y, u);
  expect(tse_filter_check(&d.p, &d.f.filter, d.bytes) == TSE_OK, "its own state, refused", status, u);
}

/* Start the filter over. */
static void reset(void)
{
  (void)tse_reset(&d.p, &d.f.filter, d.bytes);
  d.twin_runs = 0;
  d.time = d.at = d.age = 0;
  d.kind = TSE_CHANGE_NONE;
  d.changed = 0;
}

/* Save the learnt state and load it into a new drive. */
static void to_the_next_drive(const tse_input *u)
{
  uint8_t learnt[TSE_LEARNT_BYTES];
  const tse_status saved = tse_learnt_save(&d.p, &d.f.filter, learnt);
  expect(saved == TSE_OK || saved == TSE_E_STATE, "saving", saved, u);
  reset();
  if (saved != TSE_OK) return;
  const tse_status loaded = tse_learnt_load(
      &d.p, &d.f.filter, learnt, sizeof learnt, chance(0.3) ? 0xffffffffu : (uint32_t)pow(10, between(0, 8)));
  expect(loaded == TSE_OK, "loading what was saved", loaded, u);
  expect(tse_filter_check(&d.p, &d.f.filter, d.bytes) == TSE_OK, "a loaded state, refused", loaded, u);
}

/* Run a random drive.   Returned: number of rows */
static uint32_t drive_once(uint32_t drive)
{
  const int had = d.found;
  d.word = 88172645463325252u ^ ((uint64_t)drive * 0x9e3779b97f4a7c15u);
  if (d.word == 0) d.word = 1;
  for (int i = 0; i < 20; i++) (void)uniform();
  d.drive = drive;
  d.row = 0;
  any_settings();
  if (tse_prepare(&d.c, &d.p, NULL) < 0) return 0; /* latencies, a formula, overflow in fixed point */
  d.bytes = d.c.form ? sizeof(tse_filter_paper) : sizeof(tse_filter);
  reset();
  const double dt = tse_double_of_setting(d.c.sample_time);
  const uint32_t rows = 1000 + below(4000);
  car c = any_car();
  event e = any_event();
  uint32_t given = chance(0.5) ? 0 : below(1u << TSE_OPTIONALS);
  tse_input last = car_row(&c, dt);
  /* shares of random rows and of pauses in them, for the whole drive */
  const double wild = chance(0.3) ? between(0, 1) : 0;
  const double pauses = chance(0.5) ? 0 : between(0, 0.5);
  for (uint32_t n = 0, left = e.rows; n < rows && d.found == had; n++, left--) {
    if (left == 0) {
      e = any_event();
      left = e.rows;
      if (chance(0.1)) c = any_car();
      if (chance(0.1)) given = chance(0.5) ? 0 : below(1u << TSE_OPTIONALS);
      if (chance(0.03)) to_the_next_drive(&last);
    }
    tse_input u = car_row(&c, dt);
    give(&u, &c, given & (chance(0.1) ? ~0u : ~TSE_GIVEN_VELOCITIES));
    spoil(&e, &u, &last);
    if (wild > 0 && chance(wild)) any_row(&u, chance(pauses));
    step(&u);
    last = u;
  }
  return d.row;
}

int main(int argc, char **argv)
{
  const uint64_t rows = argc > 1 ? strtoull(argv[1], NULL, 10) : 50000;
  const uint32_t first = argc > 2 ? (uint32_t)strtoul(argv[2], NULL, 10) : 1;
  uint64_t done = 0;
  uint32_t drive = first;
  for (; done < rows && d.found < MOST_FOUND; drive++) done += drive_once(drive);
  (void)printf("%s: %llu rows of %u drives, found %d\n", TSE_FORMAT_NAME, (unsigned long long)done,
      (unsigned)(drive - first), d.found);
  return d.found > 0;
}
