/* tests/dropin/same.c - print hashes of the results of the library. They must be the same
 * with its sources and with the two files of scripts/dev/amalgamate.py.
 *   same DRIVE      run tests/replay/drive.csv through all filters; hash outputs, learnt
 *                   state, tables, sizes and simulator */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#if defined(ONE_FILE)
#include "tse.h"
#else
#include "tse/describe.h"
#include "tse/learnt.h"
#if !defined(TSE_NO_EFFECTS)
#include "tse/simulate.h"
#endif
#endif

enum { ROWS_MOST = 4000 };

static uint64_t mixed(uint64_t hash, const void *bytes, size_t count)
{
  for (size_t i = 0; i < count; i++) hash = (hash ^ ((const unsigned char *)bytes)[i]) * 1099511628211u;
  return hash;
}

static void say(const char *what, uint64_t hash)
{
  printf("%s %08lx%08lx\n", what, (unsigned long)(hash >> 32), (unsigned long)(hash & 0xffffffffu));
}

static int rows_of(const char *path, tse_input *rows)
{
  char line[256];
  int n = 0;
  FILE *const file = fopen(path, "r");
  if (!file) return 0;
  while (n < ROWS_MOST && fgets(line, sizeof line, file)) {
    const char *at = line;
    tse_real value[1 + TSE_CHANNELS];
    if (line[0] < '0' || line[0] > '9') continue; /* comment or header */
    memset(&rows[n], 0, sizeof rows[n]);
    for (int k = 0; k < 1 + TSE_CHANNELS; k++) {
      char *end;
      const double x = strtod(at, &end);
      value[k] = TSE_R(x);
      if (end == at && k > 0) rows[n].missing |= 1u << (k - 1);
      at = *end == ',' ? end + 1 : end;
    }
    rows[n].dt = value[0];
    rows[n].steer_angle = value[1 + TSE_CHANNEL_steer_angle];
    rows[n].wheel_speed_front = value[1 + TSE_CHANNEL_wheel_speed_front];
    rows[n].wheel_speed_rear = value[1 + TSE_CHANNEL_wheel_speed_rear];
    rows[n].accel_x = value[1 + TSE_CHANNEL_accel_x];
    rows[n].accel_y = value[1 + TSE_CHANNEL_accel_y];
    rows[n].yaw_rate = value[1 + TSE_CHANNEL_yaw_rate];
    n++;
  }
  (void)fclose(file);
  return n;
}

/* Run a drive and print the hash of all outputs.
 *   Given:  told  1: with effects of the car, to cover the model with effects */
static void drive(const char *name, void (*settings)(tse_config *c), const tse_input *rows, int n, int told)
{
  static tse_filter_paper memory;
  static tse_params p;
  tse_config c;
  tse_output y;
  uint8_t learnt[TSE_LEARNT_BYTES];
  uint64_t hash = 14695981039346656037u;
  memset(&p, 0, sizeof p);
  memset(&memory, 0, sizeof memory);
  settings(&c);
  c.particles = 50;
#if !defined(TSE_NO_EFFECTS)
  if (told) {
    c.body_roll_gain = TSE_S(0.01);
    c.relaxation_length = TSE_S(0.3);
  }
#else
  (void)told;
#endif
  const tse_status ready = tse_prepare(&c, &p, NULL);
  if (ready >= 0) {
    (void)tse_reset(&p, &memory.filter, sizeof memory);
    for (int i = 0; i < n; i++) {
      memset(&y, 0, sizeof y);
      const tse_status status = tse_step(&p, &memory.filter, &rows[i], &y);
      hash = mixed(mixed(hash, &status, sizeof status), &y, sizeof y);
    }
    if (tse_learnt_save(&p, &memory.filter, learnt) >= 0) hash = mixed(hash, learnt, sizeof learnt);
  }
  printf("%d ", (int)ready);
  say(name, hash);
}

static uint64_t mixed_text(uint64_t hash, const char *text) { return mixed(hash, text, strlen(text) + 1); }

static void tables(void)
{
  for (int which = 0; which < 32; which++) {
    int32_t count = 0, size = 0;
    uint64_t hash = 14695981039346656037u;
    const tse_field *const f = tse_describe((tse_struct)which, &count, &size);
    for (int32_t i = 0; f && i < count; i++) {
      hash = mixed_text(mixed_text(mixed_text(hash, f[i].name), f[i].unit), f[i].text);
      hash = mixed(hash, &f[i].kind, sizeof f[i].kind);
      hash = mixed(hash, &f[i].offset, sizeof f[i].offset);
    }
    printf("table %d: %d rows of %d bytes ", which, (int)count, (int)size);
    say("", hash);
  }
}

int main(int argc, char **argv)
{
  static tse_input rows[ROWS_MOST];
  const int n = argc == 2 ? rows_of(argv[1], rows) : 0;
  if (n == 0) return 2;
  tse_build b;
  tse_describe_build(&b);
  printf("%s %s %d, bytes %d %d %d %d\n", b.version, b.format, (int)b.capacity, (int)b.filter_bytes,
      (int)b.filter_paper_bytes, (int)b.params_bytes, (int)b.sim_bytes);
  drive("default", tse_config_exact, rows, n, 0);
  drive("told of effects", tse_config_exact, rows, n, 1);
  drive("robust", tse_config_robust, rows, n, 0);
  drive("paper", tse_config_paper, rows, n, 0);
  tables();
#if !defined(TSE_NO_EFFECTS)
  static tse_sim car;
  static tse_sim_output log;
  tse_config c;
  tse_sim_config truth;
  tse_sim_input u;
  uint64_t hash = 14695981039346656037u;
  memset(&u, 0, sizeof u);
  tse_config_exact(&c);
  tse_sim_config_default(&truth);
  c.body_roll_gain = TSE_S(0.01);
  if (tse_sim_reset(&car, &c, &truth, NULL) < 0) return 1;
  u.dt = TSE_R(0.01);
  u.road_level = TSE_R(1);
  for (int k = 0; k < 500; k++) {
    u.steer_angle = k / 100 % 2 ? TSE_R(0.03) : TSE_R(-0.03);
    u.wheel_torque_front = k / 150 % 2 ? TSE_R(-600) : TSE_R(700);
    memset(&log, 0, sizeof log);
    if (tse_sim_step(&car, &u, &log) < 0) return 1;
    hash = mixed(hash, &log, sizeof log);
  }
  say("simulator", hash);
#endif
  return 0;
}
