/* tests/embedded/smallest.c - the functions that a control unit links: settings, reset,
 * step, and the learnt state saved over a stop. Its size is the flash of the library
 * (scripts/dev/budgets.py). */
#include <string.h>

#include "port.h"
#include "tse.h"

static tse_filter filter;
static tse_params params;

int program(void)
{
  static uint8_t kept[TSE_LEARNT_BYTES];
  static tse_output y;
  tse_config c;
  tse_input u;
  tse_config_default(&c);
  c.mass = TSE_S(1650);
  if (tse_prepare(&c, &params, NULL) < 0 || tse_reset(&params, &filter, sizeof filter) < 0) return 1;
  (void)tse_learnt_load(&params, &filter, kept, sizeof kept, 0);
  memset(&u, 0, sizeof u);
  u.dt = TSE_R(0.01);
  const tse_status status = tse_step(&params, &filter, &u, &y);
  (void)tse_learnt_save(&params, &filter, kept);
  return status < 0;
}
