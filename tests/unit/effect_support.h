/* tests/unit/effect_support.h - shared by the tests of effects. Include it once, after
 * unit_support.h. */
#ifndef EFFECT_SUPPORT_H
#define EFFECT_SUPPORT_H

#include <stdlib.h>

#include "model/effects.h"
#include "tse/replay.h"

enum { LOG_MOST = 20000 };

/* Rows of a log, and the results of their replay. */
static tse_real log_dt[LOG_MOST], log_steer[LOG_MOST], log_front[LOG_MOST], log_rear[LOG_MOST];
static tse_real got_x[LOG_MOST], got_y[LOG_MOST], got_r[LOG_MOST], got_vx[LOG_MOST], got_vy[LOG_MOST],
    got_yaw[LOG_MOST];
static tse_real got_tf[LOG_MOST], got_tr[LOG_MOST];

static inline tse_replay_log the_log(void)
{
  tse_replay_log log = { 0 };
  log.dt = log_dt, log.steer_angle = log_steer, log.wheel_speed_front = log_front;
  log.wheel_speed_rear = log_rear;
  return log;
}

static inline tse_replay_out the_out(void)
{
  tse_replay_out out = { 0 };
  out.accel_x = got_x, out.accel_y = got_y, out.yaw_rate = got_r, out.vel_x = got_vx, out.vel_y = got_vy;
  out.true_yaw_rate = got_yaw, out.wheel_torque_front = got_tf, out.wheel_torque_rear = got_tr;
  return out;
}

static inline tse_replay_start the_start(void)
{
  tse_replay_start s;
  tse_replay_start_default(&s);
  return s;
}

/* Run a replay that must succeed. */
static inline void replay_with(
    const tse_config *c, const tse_replay_log *log, int rows, const tse_replay_start *s)
{
  const tse_params p = prepared(*c);
  const tse_replay_out out = the_out();
  int32_t wrong = -1;
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_replay(&p, log, rows, s, &out, &wrong));
}

static inline void replay(const tse_config *c, int rows)
{
  const tse_replay_log log = the_log();
  const tse_replay_start s = the_start();
  replay_with(c, &log, rows, &s);
}

/* Keep the results of a replay, to compare them with the next one. */
static tse_real kept_x[LOG_MOST], kept_y[LOG_MOST], kept_r[LOG_MOST];

static inline void keep_readings(void)
{
  memcpy(kept_x, got_x, sizeof got_x);
  memcpy(kept_y, got_y, sizeof got_y);
  memcpy(kept_r, got_r, sizeof got_r);
}

/* Make a log of straight driving at this speed, with wheels rolling at their nominal
 * radius. */
static inline void straight(const tse_config *c, double speed, double dt, int rows)
{
  for (int i = 0; i < rows; i++) {
    log_dt[i] = real(dt);
    log_steer[i] = real(0);
    log_front[i] = real(speed / number(c->wheel_radius_front));
    log_rear[i] = real(speed / number(c->wheel_radius_rear));
  }
}

#endif
