/* tse/simulate.h - the truth for studies: the single-track model of the estimator, driven by wheel torques with wheel
 * dynamics at 1 ms or finer, a stiffness that is redrawn every row, sensor noise and drifting biases; with `friction`
 * tyre forces saturate, so that wheels lock and spin.
 * With every effect that the settings of its vehicle switch on (tse/effects.def); an estimator may know them or not.
 * Same rules as tse/tse.h: the caller owns the memory, no globals, one pointer-free state. */
#ifndef TSE_SIMULATE_H
#define TSE_SIMULATE_H

#include "tse/tse.h"

#define tse_sim_config_default TSE_NAME(tse_sim_config_default)
#define tse_sim_config_check   TSE_NAME(tse_sim_config_check)
#define tse_sim_reset          TSE_NAME(tse_sim_reset)
#define tse_sim_step           TSE_NAME(tse_sim_step)
#define tse_sim_check          TSE_NAME(tse_sim_check)

#ifdef __cplusplus
extern "C" {
#endif

/* Settings of the simulator; rows, ranges, units: tse/sim.def. */
typedef struct tse_sim_config {
#define REAL(name, def, lo, hi, unit, text) tse_setting name;
#define INT(name, def, lo, hi, text) int32_t name;
#include "tse/sim.def"
} tse_sim_config;

/* What the driver does at this row; between rows it changes linearly, or is held until the next row with `hold_inputs`. Road
 * level and friction are held from this row to the next.
 * Rows, ranges, units: tse/sim_input.def. */
typedef struct tse_sim_input {
  tse_real dt;                         /* [s] since the previous row, (0, 1]; ignored at the first row */
#define SIM_INPUT(name, def, lo, hi, unit, text) tse_real name;
#include "tse/sim_input.def"
} tse_sim_input;

typedef struct tse_sim_output {
  tse_input row;                       /* what the car logs                                                       */
  tse_real vel_x, vel_y, yaw_rate;     /* truth                                                                   */
  tse_real accel_x, accel_y;           /* specific force with the stiffness drawn for this row, no noise, no bias */
  tse_real wheel_speed_front, wheel_speed_rear;
  tse_real stiffness[3];               /* mean stiffness now, relative to nominal                                 */
  tse_real drawn[3];                   /* stiffness drawn for this row, relative to nominal                       */
  tse_real bias[3];                    /* m/s2, m/s2, rad/s                                                       */
} tse_sim_output;

typedef struct tse_sim {
  tse_sim_config config;
  tse_params params;
  uint32_t step;
  tse_real x[9];                       /* vel_x, vel_y, yaw rate, wheel speeds front and rear; slips that lag (tse/effects.h) */
  tse_real bias[3], drawn[3];
  tse_real steer, steer_logged;        /* with effects: the wheels' angle at the last row, and the logged one that led to it */
  tse_effect_memory effects;
  tse_sim_input last;                  /* the last member: what holds inputs (fmu/SingleTrackVehicle) sets it */
} tse_sim;

void tse_sim_config_default(tse_sim_config *s);

/* As tse_config_check(), for the simulator's settings. */
tse_status tse_sim_config_check(const tse_sim_config *s, const char **wrong);

/* Start a simulation.  Updated: sim, unchanged when the result is negative.  Returned: as tse_config_check(). */
tse_status tse_sim_reset(tse_sim *sim, const tse_config *c, const tse_sim_config *s, const char **wrong);

/* Advance to the next row and log it; the first call logs the start without advancing.
 *   Returned:  y  TSE_OK, TSE_E_NULL, TSE_E_TIME or TSE_E_INPUT (outside the range of tse/sim_input.def, or not finite; or what
 *              they do to this car leaves what a car can do: 1000 m/s, 200 rad/s): nothing has changed then
 *   Cost:      dt/substep right-hand sides times two. */
tse_status tse_sim_step(tse_sim *sim, const tse_sim_input *u, tse_sim_output *y);

/* Say whether a simulation that was copied from somewhere is one of these settings to go on with, as tse_filter_check().
 *   Returned:  TSE_OK, TSE_E_NULL, TSE_E_CONFIG, or TSE_E_STATE: something in it is outside its range, or not of c and s */
tse_status tse_sim_check(const tse_sim *sim, const tse_config *c, const tse_sim_config *s);

#ifdef __cplusplus
}
#endif
#endif
