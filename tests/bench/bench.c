/* tests/bench/bench.c - measure the time per row, for the rows of the paper's study
 * (square waves).
 *   bench robust           a line per number of particles of the robust filter:
 *   particles, ns per particle and step (fastest repetition)
 *   bench default          ns per row of the Kalman filter
 *   bench ekf              ns per row of a plain extended Kalman filter (ekf.h)
 *   bench ratio            both in turn: default, ekf, default over ekf
 * Without a clock, for tools that count instructions:
 *   bench PARTICLES ROWS   run the robust filter
 *   bench default ROWS     run the Kalman filter
 *   bench ekf ROWS         run the plain extended Kalman filter */
#if !defined(_POSIX_C_SOURCE)
#define _POSIX_C_SOURCE 199309L
#endif
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "ekf.h"
#include "tse/simulate.h"

#define ROWS 400
#define DRIVE 2000 /* rows: both square waves are at their start again */
#define REPETITIONS 7
#define CHUNK 50 /* rows */

static tse_input rows[DRIVE];
static tse_filter_paper memory; /* large enough for all filters */
static tse_params params;
static ekf kalman;

static void record(void)
{
  static tse_sim sim;
  tse_config c;
  tse_sim_config s;
  tse_config_exact(&c);
  tse_sim_config_default(&s);
  tse_sim_reset(&sim, &c, &s, NULL);
  for (int i = 0; i < DRIVE; i++) {
    tse_sim_input u = { 0 };
    tse_sim_output y;
    u.dt = TSE_R(0.01), u.road_level = TSE_R(1);
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
  tse_reset(&params, &memory.filter, sizeof memory);
  for (int i = 0; i < count; i++) tse_step(&params, &memory.filter, &rows[i % ROWS], &y);
}

/* Run rows from .. to - 1. The drive starts over at its end. */
static void run_default(int from, int to)
{
  tse_output y;
  for (int i = from; i < to; i++) {
    if (i % DRIVE == 0) {
      tse_config c;
      tse_config_exact(&c);
      tse_prepare(&c, &params, NULL);
      tse_reset(&params, &memory.filter, sizeof memory);
    }
    tse_step(&params, &memory.filter, &rows[i % DRIVE], &y);
  }
}

static void run_ekf(int from, int to)
{
  for (int i = from; i < to; i++) {
    const int first = i % DRIVE == 0;
    if (first) {
      tse_config c;
      tse_config_exact(&c);
      ekf_start(&kalman, &c, TSE_R(0.05), &rows[0]);
    }
    ekf_step(&kalman, &rows[i % DRIVE], first);
  }
}

static double seconds(void)
{
  struct timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

/* Measure the time per row [ns] over the whole drive: for each chunk the fastest
 * repetition. Interruptions on a busy machine affect long runs more than short ones, and
 * would bias a ratio. */
static void time_rows(void (*run_rows)(int from, int to), double best[DRIVE / CHUNK])
{
  for (int k = 0; k < DRIVE / CHUNK; k++) {
    const double start = seconds();
    run_rows(k * CHUNK, (k + 1) * CHUNK);
    const double t = 1e9 * (seconds() - start) / DRIVE;
    if (t < best[k]) best[k] = t;
  }
}

static double sum(const double best[DRIVE / CHUNK])
{
  double total = 0;
  for (int k = 0; k < DRIVE / CHUNK; k++) total += best[k];
  return total;
}

/* Print the result that `which` selects; both filters run in turn. */
static void rows_of(const char *which)
{
  double of_ekf[DRIVE / CHUNK], of_default[DRIVE / CHUNK];
  for (int k = 0; k < DRIVE / CHUNK; k++) of_ekf[k] = of_default[k] = 1e18;
  for (int k = 0; k < REPETITIONS; k++) {
    if (strcmp(which, "default") != 0) time_rows(run_ekf, of_ekf);
    if (strcmp(which, "ekf") != 0) time_rows(run_default, of_default);
  }
  if (strcmp(which, "ratio") == 0)
    printf("%.0f %.0f %.1f\n", sum(of_default), sum(of_ekf), sum(of_default) / sum(of_ekf));
  else printf("%.0f\n", sum(strcmp(which, "ekf") == 0 ? of_ekf : of_default));
}

static void particle_steps(void (*settings)(tse_config *c))
{
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
}

int main(int argc, char **argv)
{
  const char *const what = argc > 1 ? argv[1] : "";
  const int of_rows = strcmp(what, "default") == 0 || strcmp(what, "ekf") == 0;
  record();
  if (argc == 3 && of_rows) (strcmp(what, "ekf") == 0 ? run_ekf : run_default)(0, atoi(argv[2]));
  else if (argc == 3) run(tse_config_robust, atoi(argv[1]), atoi(argv[2]));
  else if (of_rows || strcmp(what, "ratio") == 0) rows_of(what);
  else particle_steps(tse_config_robust);
  return 0;
}
