/* tests/replay/update.c - write the reference of tests/unit/estimator/test_replay.c.
 * tests/replay/update.py compiles and runs it.
 *   update drive          print a new drive of the simulator as CSV
 *   update golden DRIVE   print the estimates of that drive, in the number format that
 *                         this program is compiled for */
#include "replay.h"
#include "tse/describe.h"
#include "tse/simulate.h"

/* Torque of a drive of 30 s: standstill, acceleration with torque steps, two lane
 * changes, braking to a stop, a short reverse. */
static double torque_at(double t)
{
  if (t < 1.5) return 0.0;
  if (t < 9.0) return 1500.0 + (fmod(t, 1.5) < 0.75 ? 500.0 : -500.0);
  if (t < 21.0) return fmod(t, 2.0) < 1.0 ? 500.0 : -300.0;
  return t > 27.5 && t < 28.5 ? -600.0 : 0.0;
}

static double brake_at(double t)
{
  return t < 1.5 ? 500.0 : t > 21.0 && t < 27.5 ? 2200.0 : t > 28.5 ? 800.0 : 0.0;
}

static double steer_at(double t)
{
  const double pi = 3.14159265358979;
  if (t > 9.5 && t < 12.5) return 0.025 * sin(2.0 * pi * (t - 9.5) / 3.0);
  if (t > 14.0 && t < 20.0) return 0.02 * sin(2.0 * pi * (t - 14.0) / 2.0);
  return t > 5.0 && t < 7.0 ? 0.03 * sin(2.0 * pi * (t - 5.0) / 2.0) : 0.0;
}

static int within(double t, double from, double to) { return t > from - 0.005 && t < to - 0.005; }

static int write_drive(void)
{
  static tse_sim sim;
  tse_config config;
  tse_sim_config truth;
  tse_config_exact(&config);
  tse_sim_config_default(&truth);
  truth.speed = tse_setting_of(0);
  truth.true_cx_front = tse_setting_of(0.9);
  truth.true_cy_front = tse_setting_of(1.15);
  truth.true_cy_rear = tse_setting_of(0.85);
  truth.true_bias_accel_x = tse_setting_of(0.03);
  truth.true_bias_yaw_rate = tse_setting_of(-0.002);
  truth.bias_walk = tse_setting_of(1);
  truth.wheel_speed_sd = tse_setting_of(0.01);
  if (tse_sim_reset(&sim, &config, &truth, NULL) < 0) return 1;

  printf("# recorded from the simulator (update.c); an empty field is missing\ndt");
  for (int k = 0; k < TSE_CHANNELS; k++)
    printf(",%s", tse_describe(TSE_STRUCT_INPUT, NULL, NULL)[1 + k].name); /* after dt */
  printf("\n");
  double gap = 0.0;
  for (int i = 0; i <= 3000; i++) {
    const double t = 0.01 * i;
    tse_sim_input u;
    tse_sim_output y;
    memset(&u, 0, sizeof u);
    u.dt = tse_real_of(0.01);
    u.steer_angle = tse_real_of(steer_at(t));
    u.wheel_torque_front = tse_real_of(torque_at(t));
    u.brake_torque_front = tse_real_of(0.6 * brake_at(t));
    u.brake_torque_rear = tse_real_of(0.4 * brake_at(t));
    u.road_level = tse_real_of(1);
    if (tse_sim_step(&sim, &u, &y) < 0) return 1;
    gap += 0.01;
    /* lost rows: steps up to 0.41 s */
    if (within(t, 13.1, 13.5) || within(t, 16.0, 16.03) || within(t, 18.0, 18.06)) continue;
    const double channel[6] = { tse_double_of(y.row.steer_angle), tse_double_of(y.row.wheel_speed_front),
      tse_double_of(y.row.wheel_speed_rear), tse_double_of(y.row.accel_x), tse_double_of(y.row.accel_y),
      tse_double_of(y.row.yaw_rate) };
    int lost[6] = { within(t, 7.5, 7.53), within(t, 12.0, 12.05), within(t, 15.0, 15.2), 0, 0, 0 };
    lost[3] = within(t, 10.0, 10.1) || within(t, 17.0, 17.2) || i % 97 == 0;
    lost[4] = within(t, 10.5, 10.6) || within(t, 17.0, 17.2) || i % 89 == 0;
    lost[5] = within(t, 11.0, 11.2) || within(t, 17.0, 17.2) || i % 2 == 1; /* a gyro at half the rate */
    printf("%.2f", gap);
    for (int k = 0; k < 6; k++)
      if (lost[k]) printf(",");
      else if (k == 4 && within(t, 19.0, 19.01)) printf(",99"); /* out of range: counts as missing */
      else printf(k == 0 || k == 5 ? ",%.5f" : ",%.3f", channel[k]);
    printf("\n");
    gap = 0.0;
  }
  return 0;
}

static int write_golden(const char *drive)
{
  static tse_input rows[REPLAY_ROWS_MOST];
  static double table[REPLAY_ROWS_MOST / REPLAY_EVERY + 1][REPLAY_COLUMNS];
  const int n = replay_read(drive, rows), digits = sizeof(tse_real) == 4 ? 9 : 12;
  if (n == 0) return 1;
  printf("# written by update.py: hash of all outputs per form and resampling scheme; every %dth row with "
         "the first\n",
      REPLAY_EVERY);
  for (int k = 0; k < REPLAY_HASHES; k++) {
    const int form = k / REPLAY_SCHEMES, scheme = k % REPLAY_SCHEMES;
    const uint64_t hash = replay_run(rows, n, form, scheme, k == 0 ? table : NULL, NULL);
    if (hash == 0) return 1;
    printf("# hash %08lx%08lx %s, scheme %d\n", (unsigned long)(hash >> 32),
        (unsigned long)(hash & 0xffffffffu), replay_forms[form].name, scheme);
  }
  printf("row");
  for (int k = 0; k < REPLAY_COLUMNS; k++) printf(",%s", replay_outputs[k].name);
  printf("\n");
  for (int i = 0; i < n; i += REPLAY_EVERY) {
    printf("%d", i);
    for (int k = 0; k < REPLAY_COLUMNS; k++) printf(",%.*g", digits, table[i / REPLAY_EVERY][k]);
    printf("\n");
  }
  return 0;
}

int main(int argc, char **argv)
{
  if (argc == 2 && strcmp(argv[1], "drive") == 0) return write_drive();
  if (argc == 3 && strcmp(argv[1], "golden") == 0) return write_golden(argv[2]);
  (void)fprintf(stderr, "update drive | update golden DRIVE\n");
  return 2;
}
