/* tests/embedded/budgets.c - count the instructions per row of the recorded drive and of
 * extreme rows, and the stack. Needs a port that counts instructions: cortex_m.c.
 *
 *   ROWS   number of rows of the drive; default: all */
#include <string.h>

#include "drive.h"
#include "port.h"

#if !defined(ROWS)
#define ROWS DRIVE_ROWS
#endif
enum { ROWS_LATE = 600 };

#if !defined(TSE_S)
#define TSE_S(x) ((tse_setting)(x))
#endif

static tse_filter filter;
static tse_params params;
static uint32_t calibration, overhead;

/* Execute n loop passes of two instructions each, plus two for call and return. */
static __attribute__((noinline)) void turns(uint32_t n)
{
  __asm__ volatile(".syntax unified\n1: subs %0, #1\n bne 1b" : "+r"(n));
}

static uint32_t since(uint32_t start) { return port_instructions() - start - overhead; }

/* Measure the overhead of counting, and the instructions of a known loop. */
static void calibrate(void)
{
  uint32_t start = port_instructions();
  overhead = port_instructions() - start;
  start = port_instructions();
  turns(100000);
  calibration = since(start);
}

typedef struct tally {
  uint32_t rows, longest, longest_at, shortest;
  uint64_t sum;
} tally;

/* Run a row and count its instructions.   Returned: 1 if the row is refused */
static int step(const tse_input *u, tally *t)
{
  static tse_output y;
  const uint32_t start = port_instructions();
  const tse_status status = tse_step(&params, &filter, u, &y);
  const uint32_t took = since(start);
  if (status < 0) {
    say_number("row ", t->rows);
    port_say(" is refused: ");
    port_say(tse_status_text(status));
    port_say("\n");
    return 1;
  }
  if (took > t->longest) {
    t->longest = took;
    t->longest_at = t->rows;
  }
  if (t->rows == 0 || took < t->shortest) t->shortest = took;
  t->sum += took;
  t->rows++;
#if defined(SAY_ROWS)
  say_number("row ", took);
  port_say("\n");
#endif
  return 0;
}

static void say_tally(const char *name, const tally *t)
{
  port_say("tally ");
  port_say(name);
  say_number(" rows ", t->rows);
  say_number(" mean ", (uint32_t)(t->sum / t->rows));
  say_number(" longest ", t->longest);
  say_number(" at ", t->longest_at);
  port_say("\n");
}

static int start_over(int is_late)
{
  tse_config c;
  tse_config_default(&c);
  c.mass = TSE_S(1900); /* an ordinary car, with tyre saturation, roll and relaxation */
  if (is_late) {
    c.steer_angle_latency = TSE_S(0.02);
    c.accel_x_latency = TSE_S(0.015);
  }
  return tse_prepare(&c, &params, NULL) < 0 || tse_reset(&params, &filter, sizeof filter) < 0;
}

/* ---- extreme rows, which the recorded drive does not contain */

static uint32_t state = 1;

/* Return a uniform random number in -n .. n (generator of Numerical Recipes). */
static int32_t noise(int32_t n)
{
  state = state * 1664525u + 1013904223u;
  return (int32_t)(state >> 16) % (2 * n + 1) - n;
}

static tse_real thousandths(int32_t n) { return (tse_real)(n * TSE_R(0.001)); }

enum { LONG, SLOW, ABSURD, BREAKS, MISSING, KINDS };
static const char *const kind_names[KINDS] = { "long", "slow", "absurd", "breaks", "missing" };
enum { OF_EACH = 250 };

/* Make row k of a kind: at walking pace or in town, every 0.1 s or 0.01 s. Sensor values
 * are consistent, except for the disturbance of the kind. */
static void odd_row(int kind, int k, tse_input *u)
{
  const int32_t speed = kind == SLOW || (kind == LONG && k % 100 < 50) ? 2200 : 9000; /* mm/s */
  const int32_t steer = k % 40 < 20 ? 60 : -60, ms = kind == LONG || kind == ABSURD ? 100 : 10;
  memset(u, 0, sizeof *u);
  u->dt = thousandths(ms);
  u->steer_angle = thousandths(steer);
  u->wheel_speed_front = thousandths(speed / 300 * 1000 + noise(90));
  u->wheel_speed_rear = thousandths(speed / 300 * 1000 + noise(90));
  u->accel_x = thousandths(noise(200));
  u->accel_y = thousandths(speed / 1000 * (speed / 1000) * steer / 3 + noise(200));
  u->yaw_rate = thousandths(speed * steer / 3000 + noise(5));
  if (kind == ABSURD) {
    if (k % 30 > 20) u->steer_angle = thousandths(250); /* faults that make an input unusable */
    if (k % 50 > 40) u->wheel_speed_front = thousandths(90000);
    if (k % 70 > 60) u->accel_y = thousandths(noise(30000));
  }
  if (kind == BREAKS) u->dt = k % 9 == 0 ? TSE_R(100) : k % 5 == 0 ? TSE_R(0.11) : thousandths(100);
  if (kind == MISSING) u->missing = (uint32_t)(noise(31) + 31) & 63u;
}

static int odd_rows(void)
{
  tse_input u;
  for (int kind = 0; kind < KINDS; kind++) {
    tally t = { 0, 0, 0, 0, 0 };
    for (int k = 0; k < OF_EACH; k++) {
      odd_row(kind, k, &u);
      if (step(&u, &t)) return 1;
    }
    say_tally(kind_names[kind], &t);
  }
  return 0;
}

/* Run rows from .. to - 1 of the recorded drive. */
static int rows_of_drive(const char *name, int from, int to)
{
  tally t = { 0, 0, 0, 0, 0 };
  for (int i = from; i < to; i++) {
    tse_input u;
    drive_at(i, &u);
    if (step(&u, &t)) return 1;
  }
  say_tally(name, &t);
  return 0;
}

static void say_bytes(const char *what, size_t bytes)
{
  port_say("bytes ");
  say_number(what, (uint32_t)bytes);
  port_say("\n");
}

int program(void)
{
  calibrate();
  say_number("calibration ", calibration);
  port_say("\n");
  say_bytes("filter ", sizeof(tse_filter));
  say_bytes("params ", sizeof(tse_params));
  (void)port_stack();
  int failed = start_over(0);
  say_bytes("stack_prepare ", port_stack());
  failed = failed || rows_of_drive("drive", 0, ROWS) || odd_rows();
  say_bytes("stack_step ", port_stack());
  failed = failed || start_over(1) || rows_of_drive("late", 0, ROWS_LATE < ROWS ? ROWS_LATE : ROWS);
  if (failed) port_say("failed: settings or rows are refused\n");
  return failed;
}
