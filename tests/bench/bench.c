/* tests/bench/bench.c - time per particle and step, over the rows of the paper's study (square waves).
 *   bench                    a line per particle count: particles, ns per particle-step (fastest of the repetitions)
 *   bench sampled            the same in the sampled form
 *   bench PARTICLES ROWS     run once without a clock, for a tool that counts instructions */
#if !defined(_POSIX_C_SOURCE)
#define _POSIX_C_SOURCE 199309L
#endif
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "tse/simulate.h"

#define ROWS 400
#define REPETITIONS 7

static tse_input rows[ROWS];
static tse_filter filter;
static tse_params params;

static void record(void)
{
  static tse_sim sim;
  tse_config c;
  tse_sim_config s;
  tse_config_default(&c);
  tse_sim_config_default(&s);
  tse_sim_reset(&sim, &c, &s, NULL);
  for (int i = 0; i < ROWS; i++) {
    tse_sim_input u;
    tse_sim_output y;
    memset(&u, 0, sizeof u);
    u.dt = TSE_R(0.01);
    u.road_level = TSE_R(1);
    u.steer_angle = i % 400 < 200 ? TSE_R(0.02) : TSE_R(-0.02);
    u.wheel_torque_front = i % 500 < 250 ? TSE_R(700) : TSE_R(-700);
    tse_sim_step(&sim, &u, &y);
    rows[i] = y.row;
  }
}

static void run(void (*settings)(tse_config *c), int particles, int count)
{
  tse_config c;
  tse_output y;
  settings(&c);
  c.particles = particles;
  tse_prepare(&c, &params, NULL);
  tse_reset(&params, &filter, sizeof filter);
  for (int i = 0; i < count; i++) tse_step(&params, &filter, &rows[i % ROWS], &y);
}

static double seconds(void)
{
  struct timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

int main(int argc, char **argv)
{
  void (*const settings)(tse_config *c) = argc == 2 && strcmp(argv[1], "sampled") == 0 ? tse_config_sampled : tse_config_default;
  record();
  if (argc == 3) {
    run(settings, atoi(argv[1]), atoi(argv[2]));
    return 0;
  }
  for (int n = 64; n <= TSE_MAX_PARTICLES; n *= 2) {
    const int count = n < 1024 ? ROWS : ROWS / 4;
    double best = 1e9;
    for (int k = 0; k < REPETITIONS; k++) {
      const double start = seconds();
      run(settings, n, count);
      const double t = (seconds() - start) / count / n;
      if (t < best) best = t;
    }
    printf("%d %.1f\n", n, best * 1e9);
  }
  return 0;
}
