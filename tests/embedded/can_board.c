/* tests/embedded/can_board.c - run scripts/dropin/can on an emulated board. The timer
 * interrupt delivers the frames of a recorded drive, like a CAN controller, and calls the
 * loop. The main program waits for interrupts and processes rows. scripts/dev/machines.py
 * writes frames.h from tests/replay/drive.csv: FRAME(period, id, bytes ...). */
#include "control_loop.h"
#include "port.h"
#include "replay_hash.h"

static const struct {
  uint16_t period;
  can_frame frame;
} bus[] = {
#define FRAME(period, id, a, b, c, d, e, f, g, h) { period, { id, { a, b, c, d, e, f, g, h } } },
#include "frames.h"
#undef FRAME
};
enum { FRAMES = sizeof bus / sizeof *bus };

static control_loop loop;
static volatile uint32_t next, period, is_on;

void port_period(void)
{
  if (!is_on) return;
  period++;
  while (next < FRAMES && bus[next].period <= period) loop_received(&loop, &bus[next++].frame);
  loop_period(&loop);
}

/* Wait for the next interrupt. Interrupts are masked between check and wfi, so that none
 * is missed: a masked interrupt also ends wfi. */
static void wait(void)
{
  __asm__ volatile("cpsid i" ::: "memory");
  if (!loop.is_ready) __asm__ volatile("wfi");
  __asm__ volatile("cpsie i" ::: "memory");
}

int program(void)
{
  tse_config c;
  uint64_t hash = REPLAY_HASH_EMPTY;
  uint32_t longest = 0;
  const char *wrong = "";
  tse_config_exact(&c);
  if (loop_start(&loop, &c, &wrong) < 0) {
    port_say(wrong);
    port_say(": refused\n");
    return 1;
  }
  is_on = 1;
  while (next < FRAMES || loop.is_ready) {
    const uint32_t start = port_instructions();
    if (loop_work(&loop)) {
      const uint32_t took = port_instructions() - start;
      if (took > longest) longest = took;
      hash = replay_mix_output(hash, &loop.estimate);
    } else wait();
  }
  say_hash("hash ", hash);
  say_number("\nrows ", loop.rows);
  say_number("\nrefused ", loop.refused);
  say_number("\noverruns ", loop.overruns);
  say_number("\nperiods ", period);
  say_number("\nlongest ", longest);
  say_number("\nof ", port_period_instructions());
  port_say("\n");
  return loop.refused != 0 || loop.overruns != 0;
}
