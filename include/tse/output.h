/* tse/output.h - estimates after one row of the log, i.e. one sample of all channels.
 * src/tables/output.toml defines the members of tse_output. */
#ifndef TSE_OUTPUT_H
#define TSE_OUTPUT_H

#include <stdint.h>

#include "tse/real.h"

/* Index of a stiffness in every array of three: longitudinal stiffness of the front axle,
 * cornering stiffness of the front axle, cornering stiffness of the rear axle. */
enum { TSE_CX_FRONT = 0, TSE_CY_FRONT = 1, TSE_CY_REAR = 2 };

/* Regimes, i.e. situations of road, tyres and sensors that the filter distinguishes. Each
 * value is the index of the probability of the regime in tse_output.regime. */
enum {
  // clang-format off: table regimes
  TSE_REGIME_STEADY,    /* none of the other regimes: no channel is faulty, no wheel locks or spins, and
                         * within the last 2 s neither has a stiffness changed nor has the filter started
                         * over */
  TSE_REGIME_CHANGED,   /* the stiffness of all tyres has changed within the last 2 s: a different road
                         * surface */
  TSE_REGIME_AXLE,      /* the stiffness of one axle has changed within the last 2 s */
  TSE_REGIME_FAULT,     /* a channel has an offset, is frozen or noisy */
  TSE_REGIME_SLIDING,   /* wheels lock or spin */
  TSE_REGIME_RESTARTED, /* the filter started over within the last 2 s */
  // clang-format on: end of table
  TSE_REGIMES
};

/* Kinds of the last change, values of tse_output.change_kind: none yet; the stiffness of
 * all tyres, of the front axle or of the rear axle changed; the filter started over. */
enum { TSE_CHANGE_NONE, TSE_CHANGE_ROAD, TSE_CHANGE_FRONT, TSE_CHANGE_REAR, TSE_CHANGE_RESTART };

/* Estimates after one row. A stiffness is relative to its nominal value in the settings,
 * because variances in (N/rad)^2 would exceed the range of the fixed-point format.
 * tse_stiffness_si() converts a stiffness to N and N/rad. */
typedef struct tse_output {
  // clang-format off: table output_members
  tse_real stiffness[3];         /* [1] estimated mean over time of the stiffness of an axle (both wheels
                                  * together), relative to its nominal value in the settings, in the order
                                  * TSE_CX_FRONT, TSE_CY_FRONT, TSE_CY_REAR. Stiffness is longitudinal
                                  * force / slip, or lateral force / slip angle, in the limit of zero slip,
                                  * in steady driving and at static wheel load. The slip angle follows from
                                  * the motion of the car and the logged steering angle (src/EQUATIONS.md) */
  tse_real stiffness_sd[3];      /* [1] sd of the mean stiffness, relative to nominal */
  int32_t reason[3];             /* TSE_VALID: the stiffness is usable; otherwise the reason why it is not
                                  * (tse_reason) */
  int32_t status;                /* TSE_OK, or the code of a warning about this row (tse_status). Whether a
                                  * stiffness is usable depends on its reason alone, not on the status */
  tse_real sideslip;             /* [rad] sideslip angle atan2(vel_y, vel_x) at the centre of gravity; 0 at
                                  * standstill */
  tse_real sideslip_sd;          /* [rad] sd of sideslip */
  tse_real grip;                 /* [1] friction coefficient of the tyres: max lateral force of an axle /
                                  * its load. If the setting tyre_saturation_balance is not 0, the axles
                                  * have different coefficients, and grip is their harmonic mean; default
                                  * filter only */
  tse_real grip_sd;              /* [1] sd of grip */
  tse_real vel_x;                /* [m/s] longitudinal velocity of the centre of gravity */
  tse_real vel_x_sd;             /* [m/s] sd of vel_x */
  tse_real vel_y;                /* [m/s] lateral velocity of the centre of gravity */
  tse_real vel_y_sd;             /* [m/s] sd of vel_y */
  tse_real yaw_rate;             /* [rad/s] yaw rate */
  tse_real yaw_rate_sd;          /* [rad/s] sd of yaw_rate */
  tse_real stiffness_secant[3];  /* [1] secant stiffness, relative to nominal: force / slip, or force /
                                  * slip angle, at the slip and load of this row. Its relative sd equals
                                  * that of stiffness */
  tse_real stiffness_spread[3];  /* [1] default filter: setting model_sd times the stiffness; paper's
                                  * filter: sample-to-sample sd of the stiffness, sqrt(Sigma), where Sigma
                                  * is the covariance of the process noise */
  tse_real bias[3];              /* [m/s2 m/s2 rad/s] bias of accel_x, accel_y, yaw_rate: measured minus
                                  * true value */
  tse_real bias_sd[3];           /* [m/s2 m/s2 rad/s] sd of bias */
  tse_real noise[5];             /* [1] estimated noise sd of accel_x, accel_y, yaw_rate, front and rear
                                  * wheel speed, each divided by the noise sd in the settings; default
                                  * filter only */
  tse_real innovation[5];        /* [m/s2 m/s2 rad/s m/s m/s] innovation (measured minus predicted value)
                                  * of accel_x, accel_y, yaw_rate, and of the circumferential speeds (wheel
                                  * speed times radius) of the front and rear wheels; 0 if the channel was
                                  * not used; default filter only */
  tse_real nis[5];               /* [1] normalised innovation squared of the five channels of `innovation`.
                                  * Model errors cause a slowly varying part of the innovation, which is
                                  * estimated and subtracted first. The mean of nis over many rows is 1 if
                                  * model and settings fit. 0: the channel was not used in this row;
                                  * default filter only */
  tse_real fault_factor;         /* [1] factor by which the channel that contradicts the others
                                  * (fault_channel) is too large, such as 57.3 for degrees in place of
                                  * radians, or -1 for a wrong sign; 0: no channel contradicts the others,
                                  * or its error is not a factor: front and rear wheel speeds are
                                  * exchanged, or the channel is constant or late; default filter only */
  tse_real regime[TSE_REGIMES];  /* [1] probability of each regime; the index is TSE_REGIME_STEADY ... */
  tse_real change_age;           /* [s] time since the last change (change_kind); 0 before the first change */
  tse_real change_probability;   /* [1] probability that since the last change (change_kind) no further
                                  * change, sliding or sensor fault has begun; 0 before the first change */
  tse_real change_ratio[3];      /* [1] stiffness now / stiffness before the last change; 1 before the
                                  * first change */
  tse_real discrepancy[3];       /* [m/s2 m/s2 rad/s] sd of the model discrepancy, the part of accel_x,
                                  * accel_y, yaw_rate that the model does not explain: setting model_sd
                                  * times the recent rms of the channel */
  tse_real lag_steer;            /* [s] estimated time from the logged steering angle to its effect in the
                                  * IMU, caused by bus, steering and tyres together; negative: the angle is
                                  * logged late; default filter only */
  tse_real lag_steer_sd;         /* [s] sd of lag_steer */
  tse_real estimate_age;         /* [s] age of the estimates: time of this row minus the time to which they
                                  * refer; above 0 if the filter waits for channels with a latency
                                  * (settings ..._latency) */
  tse_real n_eff;                /* [1] effective number of particles; default filter: 1 */
  tse_real log_evidence;         /* [nat] log likelihood of the measurements of this row, given all earlier
                                  * rows; 0 if no measurement was used */
  int32_t grip_reason;           /* TSE_VALID: the grip is usable; otherwise the reason why it is not
                                  * (tse_reason) */
  int32_t change_kind;           /* kind of the last change: TSE_CHANGE_NONE, _ROAD (the stiffness of all
                                  * tyres: a different road surface), _FRONT or _REAR (the stiffness of
                                  * that axle alone), _RESTART (the filter started over) */
  int32_t fault_channel;         /* the channel that contradicts the other channels (wrong unit, sign or
                                  * axle, or late) or, if there is none, the channel that most probably has
                                  * a fault (offset, frozen or noisy): 1 + TSE_CHANNEL_... or, for an
                                  * optional channel, 1 + TSE_CHANNELS + TSE_OPTIONAL_...; 0: no such
                                  * channel */
  int32_t spread_seen[3];        /* 1: stiffness_spread is learnt. 0 in the default filter, where
                                  * stiffness_spread follows from the setting model_sd, and in the paper's
                                  * filter while the stiffness is not valid */
  // clang-format on: end of table
} tse_output;

#endif
