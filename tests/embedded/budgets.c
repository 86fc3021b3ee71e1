/* tests/embedded/budgets.c - instructions that every row of the recorded drive takes, and those of rows which no drive has: the longest
 * that are accepted. And stack. On a port that counts: cortex_m.c.
 *
 *   HYPOTHESES   in use; else as the settings come */
#include "drive.h"
#include "port.h"

static tse_filter filter;
static tse_params params;
static uint32_t calibration, overhead;

/* Two instructions a turn, and two to come and go. */
static __attribute__((noinline)) void turns(uint32_t n)
{
  __asm__ volatile(".syntax unified\n1: subs %0, #1\n bne 1b" : "+r"(n));
}

static uint32_t since(uint32_t start) { return port_instructions() - start - overhead; }

static void calibrate(void)
{
  uint32_t start = port_instructions();
  overhead = port_instructions() - start;
  start = port_instructions();
  turns(100000);
  calibration = since(start);
}

typedef struct tally { uint32_t rows, longest, longest_at, shortest; uint64_t sum; } tally;

static int step(const tse_input *u, tally *t)
{
  static tse_output y;
  const uint32_t start = port_instructions();
  const tse_status status = tse_step(&params, &filter, u, &y);
  const uint32_t took = since(start);
  if (status < 0) {
    port_say("refused: ");
    port_say(tse_status_text(status));
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

static int start_over(void)
{
  tse_config c;
  tse_config_default(&c);
#if defined(HYPOTHESES)
  c.hypotheses = HYPOTHESES;
#endif
  return tse_prepare(&c, &params, NULL) < 0 || tse_reset(&params, &filter, sizeof filter) < 0;
}

int program(void)
{
  tse_input u;
  tally drive = { 0, 0, 0, 0, 0 };
  calibrate();
  say_number("calibration ", calibration);
  say_number("\nbytes filter ", sizeof filter);
  say_number("\nbytes params ", sizeof params);
  say_number("\nbytes output ", sizeof(tse_output));
  port_say("\n");
  (void)port_stack();
  if (start_over()) {
    port_say("refused: the settings\n");
    return 1;
  }
  say_number("stack prepare ", port_stack());
  port_say("\n");
  for (int i = 0; i < DRIVE_ROWS; i++) {
    drive_at(i, &u);
    if (step(&u, &drive)) return 1;
  }
  say_number("stack step ", port_stack());
  port_say("\n");
  say_tally("drive", &drive);
  return 0;
}
