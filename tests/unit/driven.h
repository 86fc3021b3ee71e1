/* tests/unit/driven.h - drive the simulator as in Sec. IV-A of the paper: square waves of
 * 4 s in steering and of 5 s in front torque. Include it once, after unit_support.h. */
#ifndef DRIVEN_H
#define DRIVEN_H

#include "unit_support.h"

typedef struct drive {
  tse_sim sim;
  double t, dt, road, steer, torque;
} drive;

static inline void set_off_with(drive *d, const tse_config *c, const tse_sim_config *s)
{
  d->t = 0.0, d->dt = 0.01, d->road = 1.0, d->steer = 0.02, d->torque = 700.0;
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_sim_reset(&d->sim, c, s, NULL));
}

static inline void set_off(drive *d, const tse_config *c, double speed)
{
  tse_sim_config s;
  tse_sim_config_default(&s);
  s.speed = setting(speed), s.seed = 5;
  set_off_with(d, c, &s);
}

static inline tse_input next_row(drive *d)
{
  tse_sim_input u = blank_sim_input();
  tse_sim_output y;
  u.dt = real(d->dt);
  u.steer_angle = real(fmod(d->t, 4.0) < 2.0 ? d->steer : -d->steer);
  u.wheel_torque_front = real(fmod(d->t, 5.0) < 2.5 ? d->torque : -d->torque);
  u.road_level = real(d->road);
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_sim_step(&d->sim, &u, &y));
  d->t += d->dt;
  return y.row;
}

static inline tse_output run(const tse_params *p, tse_filter_paper *filter, drive *d, int rows)
{
  tse_output y = blank_output();
  for (int i = 0; i < rows; i++) {
    const tse_input u = next_row(d);
    TEST_ASSERT_TRUE(tse_step(p, &filter->filter, &u, &y) >= 0);
  }
  return y;
}

#endif
