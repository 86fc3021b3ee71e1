/* tests/fuzz/soak.c - millions of rows of simulated drives through the Kalman filter,
 * with disturbances of cars and sensors. Counts estimates that are not finite, and
 * recoveries (states started over) without a cause.
 *
 *   soak ROWS [FIRST_DRIVE]   print a Markdown table; exit code 1 if a count that must be
 *                             0 is not */
#include "fuzz.h"
#include "tse/simulate.h"

enum { DRIVE_ROWS = 6000 }; /* rows of a drive: one minute */
#define DT 0.01             /* [s] */
#define AFTERMATH 15.0      /* [s] a recovery within this time after an event is caused by it */
#define SETTLED 5.0         /* [s] before this time, stiffness and noise are those of the settings */

/* Disturbances: name, description. */

#define EVENTS(X)                                                                         \
  X(calm,       "nothing: 0.6 .. 1.2 of nominal stiffness, up to 6 m/s2 sideways")         \
  X(road,       "another road: all tyres at once to 0.4 .. 1.4")                           \
  X(slide,      "a patch of friction 0.15 .. 0.4: wheels lock or spin")                    \
  X(offset,     "a channel is off by up to its range")                                     \
  X(stuck,      "a channel repeats its last value")                                        \
  X(loud,       "noise of a channel times 3 .. 30")                                        \
  X(missing,    "NaN in channels, each row anew")                                          \
  X(blackout,   "all channels missing for up to 10 s")                                     \
  X(gap,        "a pause of 0.2 s .. an hour")                                             \
  X(jitter,     "dt of 0.2 .. 3 sample times")                                             \
  X(late_1,     "1 % of the rows come 0.12 s after the one before")                        \
  X(late_10,    "10 % of the rows come 0.12 s after the one before")                       \
  X(late_30,    "30 % of the rows come 0.12 s after the one before")                       \
  X(standstill, "brakes to a stop, and on")                                                \
  X(nonsense,   "rows of anything inside the ranges, and of what is no number")
enum {
#define X(name, text) EVENT_##name,
  EVENTS(X)
#undef X
      KINDS,
};
static const char *const names[] = {
#define X(name, text) #name,
  EVENTS(X)
#undef X
};
static const char *const texts[] = {
#define X(name, text) text,
  EVENTS(X)
#undef X
};

static uint32_t word;
/* Return a uniform random number in 0 .. 1. */
static double uniform(void)
{
  word = word * 1664525u + 1013904223u;
  return ((word ^ (word >> 15)) + 0.5) / 4294967296.0;
}
static double between(double lo, double hi) { return lo + (hi - lo) * uniform(); }

static uint64_t regimes[TSE_REGIMES]; /* number of rows in which each was the most probable */
static uint64_t out_of_range;         /* number of rows in which a number left its range */

static void count_regime(const tse_output *y, tse_status status)
{
  int most = 0;
  for (int k = 1; k < TSE_REGIMES; k++)
    if (y->regime[k] > y->regime[most]) most = k;
  regimes[most]++;
  out_of_range += status == TSE_W_RANGE;
}

typedef struct tally {
  uint64_t rows, refused, valid, no_number, unsound, recoveries, false_recoveries;
  struct {
    uint64_t rows, holds; /* number of rows; of those with the true value in the 95 % interval */
    double error, half;   /* sums, relative to the true value: error, half the 95 % interval */
  } cornering[2];         /* front, rear: valid rows of the first 0.12 s of each second since the event */
} tally;
static tally all[KINDS];

typedef struct event {
  int kind;
  double from, to, size;
  uint32_t channel;
} event;

static event any_event(uint32_t drive)
{
  event e;
  e.kind = (int)(drive % KINDS);
  e.from = between(15, 30);
  e.to = e.from + between(0.5, 10);
  e.size = uniform();
  e.channel = (uint32_t)(uniform() * TSE_CHANNELS) % TSE_CHANNELS;
  return e;
}

/* Return the share of rows that are late. */
static double late_share(int kind)
{
  return kind == EVENT_late_1 ? 0.01 : kind == EVENT_late_10 ? 0.1 : kind == EVENT_late_30 ? 0.3 : 0;
}

/* Compare valid cornering stiffnesses with their true values. */
static void compare(tally *n, const tse_output *y, const tse_sim_config *s)
{
  const double truth[2] = { tse_double_of_setting(s->true_cy_front), tse_double_of_setting(s->true_cy_rear) };
  for (int a = 0; a < 2; a++) {
    if (y->reason[TSE_CY_FRONT + a] != TSE_VALID) continue;
    const double off = number(y->stiffness[TSE_CY_FRONT + a]) / truth[a] - 1,
                 half = 1.96 * number(y->stiffness_sd[TSE_CY_FRONT + a]) / truth[a];
    n->cornering[a].rows++;
    n->cornering[a].holds += fabs(off) <= half;
    n->cornering[a].error += off;
    n->cornering[a].half += half;
  }
}

/* Return the inputs of a driver who holds a speed and steers by a sum of sines with
 * limited lateral acceleration. */
static tse_sim_input drive_on(
    const event *e, double t, double speed, const double pace[3], double sideways, double now)
{
  tse_sim_input u = { 0 };
  const int active = t >= e->from && t < e->to, stops = e->kind == EVENT_standstill && active;
  const double wanted = stops ? 0 : speed * (1 + 0.15 * sin(0.2 * t)), torque = 1500 * (wanted - now);
  const double most = sideways * 2.75 / fmax(now * now, 25.0);
  u.dt = real_of(DT);
  u.steer_angle = real_of(fmin(
      fmax(most * (sin(pace[0] * t) + 0.5 * sin(pace[1] * t) + 0.3 * sin(pace[2] * t)) / 1.8, -0.25), 0.25));
  if (torque > 0) u.wheel_torque_front = real_of(fmin(torque, 2500));
  else u.brake_torque_front = u.brake_torque_rear = real_of(fmin(-0.5 * torque, 2500));
  u.road_level = real_of(e->kind == EVENT_road && t >= e->from ? 0.4 + e->size : 1);
  u.road_friction = real_of(e->kind == EVENT_slide && active ? 0.15 + 0.25 * e->size : 0);
  return u;
}

/* Disturb a row.
 *   Given:  hold  last row before the event */
static void spoil(const event *e, double t, tse_input *u, const tse_input *hold)
{
  static const double ranges[] = { 0.2, 20, 20, 5, 5, 1 }, noise[] = { 0.002, 0.1, 0.1, 0.15, 0.15, 0.0035 };
  tse_input held = *hold;
  tse_real *const x = channel_of(u, e->channel);
  if (t < e->from || t >= e->to) return;
  switch (e->kind) {
    case EVENT_offset: *x += real_of((e->size - 0.5) * ranges[e->channel]); break;
    case EVENT_stuck: *x = *channel_of(&held, e->channel); break;
    case EVENT_loud:
      *x += real_of(noise[e->channel] * (3 + 27 * e->size) * (uniform() + uniform() + uniform() - 1.5) * 2);
      break;
    case EVENT_missing: u->missing = (uint32_t)(uniform() * 64) & (uint32_t)(uniform() * 64); break;
    case EVENT_blackout: u->missing = 63; break;
    case EVENT_nonsense:
      if (uniform() < 0.3)
        *channel_of(u, (uint32_t)(uniform() * 6)) = real_of(uniform() < 0.5 ? NAN : INFINITY);
      for (uint32_t k = 0; k < TSE_CHANNELS; k++)
        if (uniform() < 0.3) *channel_of(u, k) = real_of(between(channel_field(k)->lo, channel_field(k)->hi));
      break;
    default: break;
  }
}

/* Return 1 if the estimates are finite. */
static int is_whole(const tse_output *y)
{
  for (int a = 0; a < 3; a++)
    if (!is_number(y->stiffness[a]) || !is_number(y->stiffness_sd[a])) return 0;
  for (const tse_real *x = &y->sideslip; x <= &y->log_evidence; x++) /* all of one type */
    if (!is_number(*x)) return 0;
  return fabs(number(y->yaw_rate)) <= FASTEST_TURN;
}

static void drive_once(uint32_t drive)
{
  static tse_filter f;
  static tse_sim sim;
  tse_config c;
  tse_sim_config s;
  tse_params p;
  tse_sim_output now = { 0 };
  tse_input hold = { 0 };
  word = 2654435761u * (drive + 1);
  tse_config_exact(&c);
  tse_sim_config_default(&s);
  const event e = any_event(drive);
  const double speed = between(8, 40), sideways = between(1, 6),
               pace[3] = { between(0.3, 1.5), between(1.5, 4), between(4, 9) };
  s.speed = tse_setting_of(speed);
  s.seed = (int32_t)(drive + 1);
  s.substep = tse_setting_of(0.002);
  s.true_cx_front = tse_setting_of(between(0.6, 1.2));
  s.true_cy_front = tse_setting_of(between(0.6, 1.2));
  s.true_cy_rear = tse_setting_of(between(0.6, 1.2));
  MUST(tse_sim_reset(&sim, &c, &s, NULL) == TSE_OK && tse_prepare(&c, &p, NULL) == TSE_OK, "settings");
  MUST(tse_reset(&p, &f, sizeof f) == TSE_OK, "reset");
  now.vel_x = real_of(speed);
  tally *const n = &all[e.kind];
  int was = 0;
  double pause = 0;
  double behind = 0; /* [s] time since the last row */
  for (int k = 0; k < DRIVE_ROWS; k++) {
    const double t = k * DT;
    const tse_sim_input u = drive_on(&e, t, speed, pace, sideways, number(now.vel_x));
    if (tse_sim_step(&sim, &u, &now) < 0) continue; /* the simulated car has diverged */
    tse_input row = now.row;
    behind += DT;
    if (t >= e.from && late_share(e.kind) > 0) {
      if (behind < 0.115 && (behind > 1.5 * DT || uniform() < late_share(e.kind))) continue;
      row.dt = real_of(behind);
    }
    behind = 0;
    if (e.kind == EVENT_jitter && t >= e.from && t < e.to) row.dt = real_of(DT * between(0.2, 3));
    if (e.kind == EVENT_gap && t >= e.from && pause < 1) {
      pause = 1;
      row.dt = real_of(pow(10, -0.7 + 4.25 * e.size));
    }
    spoil(&e, t, &row, &hold);
    if (t < e.from) hold = now.row;
    tse_output y;
    const tse_status status = tse_step(&p, &f, &row, &y);
    n->rows++;
    if (status < 0) {
      n->refused++;
      continue;
    }
    count_regime(&y, status);
    if (!is_whole(&y)) n->no_number++;
    if (k % 16 == 0 && tse_filter_check(&p, &f, sizeof f) != TSE_OK) n->unsound++;
    for (int a = 0; a < 3; a++) n->valid += y.reason[a] == TSE_VALID;
    if (k % 100 < 12 && t >= e.from && e.kind != EVENT_road && e.kind != EVENT_slide) compare(n, &y, &s);
    const int recovered = status == TSE_W_RECOVERED;
    if (recovered && !was) {
      const int of_the_event = e.kind != EVENT_calm && t >= e.from && t < e.to + AFTERMATH;
      n->recoveries++;
      if (!of_the_event && t > SETTLED) {
        n->false_recoveries++;
        (void)fprintf(stderr, "false recovery: drive %u (%s) at %.2f s, event %.2f .. %.2f s\n",
            (unsigned)drive, names[e.kind], t, e.from, e.to);
      }
    }
    was = recovered;
  }
}

int main(int argc, char **argv)
{
  const uint64_t rows = argc > 1 ? strtoull(argv[1], NULL, 10) : 600000;
  const uint32_t first = argc > 2 ? (uint32_t)strtoul(argv[2], NULL, 10) : 0;
  tally sum = { 0 };
  for (uint32_t d = 0; d < (rows + DRIVE_ROWS - 1) / DRIVE_ROWS; d++) drive_once(first + d);
  (void)printf("| event | rows | rows refused | valid stiffnesses | outputs not finite | states refused | "
               "restarts | false restarts |\n"
               "|---|---:|---:|---:|---:|---:|---:|---:|\n");
  for (int k = 0; k < KINDS; k++) {
    const tally *const n = &all[k];
    (void)printf("| %s: %s | %llu | %llu | %.1f %% | %llu | %llu | %llu | %llu |\n", names[k], texts[k],
        (unsigned long long)n->rows, (unsigned long long)n->refused,
        n->rows ? 100.0 * (double)n->valid / (3.0 * (double)n->rows) : 0.0, (unsigned long long)n->no_number,
        (unsigned long long)n->unsound, (unsigned long long)n->recoveries,
        (unsigned long long)n->false_recoveries);
    sum.rows += n->rows;
    sum.refused += n->refused;
    sum.valid += n->valid;
    sum.no_number += n->no_number;
    sum.unsound += n->unsound;
    sum.recoveries += n->recoveries;
    sum.false_recoveries += n->false_recoveries;
  }
  (void)printf("| all | %llu | %llu | %.1f %% | %llu | %llu | %llu | %llu |\n", (unsigned long long)sum.rows,
      (unsigned long long)sum.refused, 100.0 * (double)sum.valid / (3.0 * (double)(sum.rows ? sum.rows : 1)),
      (unsigned long long)sum.no_number, (unsigned long long)sum.unsound, (unsigned long long)sum.recoveries,
      (unsigned long long)sum.false_recoveries);
  (void)printf("\n| event | valid values, front / rear | mean error [%%] | mean half of the 95 %% interval "
               "[%%] | 95 %% interval contains truth [%%] |\n|---|---:|---:|---:|---:|\n");
  int biased = 0;
  for (int k = 0; k < KINDS; k++) {
    double x[2][4] = { { 0 } };
    for (int a = 0; a < 2; a++) {
      const double rows_ = (double)(all[k].cornering[a].rows ? all[k].cornering[a].rows : 1);
      x[a][0] = (double)all[k].cornering[a].rows;
      x[a][1] = 100 * all[k].cornering[a].error / rows_;
      x[a][2] = 100 * all[k].cornering[a].half / rows_;
      x[a][3] = 100 * (double)all[k].cornering[a].holds / rows_;
      /* undisturbed, or only the times of rows: with other events a single drive may be
       * far off */
      const int ordinary = k == EVENT_calm || late_share(k) > 0;
      biased = biased || (ordinary && fabs(x[a][1]) > x[a][2]);
    }
    if (x[0][0] + x[1][0] > 0)
      (void)printf("| %s | %.0f / %.0f | %+.1f / %+.1f | %.1f / %.1f | %.1f / %.1f |\n", names[k], x[0][0],
          x[1][0], x[0][1], x[1][1], x[0][2], x[1][2], x[0][3], x[1][3]);
  }
  (void)printf("\n| most probable regime | rows | share |\n|---|---:|---:|\n");
  static const char *const regime_names[TSE_REGIMES] = { "steady", "changed", "axle", "fault", "sliding",
    "restarted" };
  for (int r = 0; r < TSE_REGIMES; r++)
    (void)printf("| %s | %llu | %.3f %% |\n", regime_names[r], (unsigned long long)regimes[r],
        100.0 * (double)regimes[r] / (double)(sum.rows ? sum.rows : 1));
  (void)printf("\nRows with status TSE_W_RANGE (a number reached the limit of the format): %llu.\n",
      (unsigned long long)out_of_range);
  return sum.rows == 0 || sum.no_number > 0 || sum.unsound > 0 || sum.false_recoveries > 0 || biased;
}
