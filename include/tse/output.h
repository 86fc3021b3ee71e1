/* tse/output.h - estimates after one row. The members follow from
 * src/tables/output.toml. */
#ifndef TSE_OUTPUT_H
#define TSE_OUTPUT_H

#include <stdint.h>

#include "tse/real.h"

/* Index of a stiffness in tse_output and everywhere else. */
enum { TSE_CX_FRONT = 0, TSE_CY_FRONT = 1, TSE_CY_REAR = 2 };

/* Regimes: index of the probability of each in tse_output.regime. */
enum {
  // clang-format off: table regimes
  TSE_REGIME_STEADY,    /* tyres as before */
  TSE_REGIME_CHANGED,   /* all tyres changed within the last 2 s: another road */
  TSE_REGIME_AXLE,      /* the tyres of one axle changed within the last 2 s */
  TSE_REGIME_FAULT,     /* a channel has an offset, is frozen or noisy */
  TSE_REGIME_SLIDING,   /* wheels lock or spin */
  TSE_REGIME_RESTARTED, /* the filter started over within the last 2 s */
  // clang-format on: end of table
  TSE_REGIMES
};

enum { TSE_CHANGE_NONE, TSE_CHANGE_ROAD, TSE_CHANGE_FRONT, TSE_CHANGE_REAR, TSE_CHANGE_RESTART };

/* Stiffness is relative to the settings' nominal value, because N/rad exceeds the range of some number
 * formats. tse_stiffness_si() converts. */
typedef struct tse_output {
  // clang-format off: table output_members
  tse_real stiffness[3];         /* [1] mean stiffness over its nominal value in the settings, by
                                  * TSE_CX_FRONT, TSE_CY_FRONT, TSE_CY_REAR: of an axle, force over slip,
                                  * or over its kinematic slip angle, in steady driving at static load and
                                  * no slip (src/EQUATIONS.md) */
  tse_real stiffness_sd[3];      /* [1] sd of that mean */
  int32_t reason[3];             /* TSE_VALID: the stiffness is usable; else the reason why not
                                  * (tse_reason) */
  int32_t status;                /* TSE_OK, or the code of a caution (tse_status); use a stiffness only if
                                  * its reason is TSE_VALID */
  tse_real sideslip;             /* [rad] sideslip angle atan2(vel_y, vel_x) at the centre of gravity; 0 at
                                  * standstill */
  tse_real sideslip_sd;          /* [rad] its sd */
  tse_real grip;                 /* [1] friction of the tyres: largest lateral force of an axle over its
                                  * load; with a tyre_saturation_balance, 1 over the mean of 1/friction of
                                  * both axles; default filter only */
  tse_real grip_sd;              /* [1] its sd */
  tse_real vel_x;                /* [m/s] longitudinal velocity of the centre of gravity */
  tse_real vel_x_sd;             /* [m/s] its sd */
  tse_real vel_y;                /* [m/s] lateral velocity of the centre of gravity */
  tse_real vel_y_sd;             /* [m/s] its sd */
  tse_real yaw_rate;             /* [rad/s] yaw rate */
  tse_real yaw_rate_sd;          /* [rad/s] its sd */
  tse_real stiffness_secant[3];  /* [1] stiffness in effect: force over slip, or slip angle, at the slip
                                  * and the load of this row; sd: the same share of it */
  tse_real stiffness_spread[3];  /* [1] default filter: model discrepancy, model_sd times the stiffness;
                                  * paper's filter: process sd, sqrt(Sigma) */
  tse_real bias[3];              /* [m/s2 m/s2 rad/s] bias of accel_x, accel_y, yaw_rate: measured minus
                                  * true value */
  tse_real bias_sd[3];           /* [m/s2 m/s2 rad/s] its sd */
  tse_real noise[5];             /* [1] estimated noise sd over the setting: accel_x, accel_y, yaw_rate,
                                  * wheel speeds front and rear; default filter only */
  tse_real innovation[5];        /* [m/s2 m/s2 rad/s m/s m/s] measured minus predicted value of each of
                                  * these channels; 0 where it was not used; default filter only */
  tse_real nis[5];               /* [1] normalised innovation squared of each of these channels, without
                                  * lasting errors: 1 on average where model and settings fit; 0 where it
                                  * was not used; default filter only */
  tse_real fault_factor;         /* [1] factor by which the implausible channel is too large: 57.3 degrees
                                  * for radians, -1 a sign; 0: no factor, the channel is exchanged, stuck
                                  * or late; default filter only */
  tse_real regime[TSE_REGIMES];  /* [1] probability of each regime, by TSE_REGIME_STEADY ... */
  tse_real change_age;           /* [s] time since the last change; 0 before the first one */
  tse_real change_probability;   /* [1] probability that nothing has changed since then */
  tse_real change_ratio[3];      /* [1] each stiffness now over that before the change */
  tse_real discrepancy[3];       /* [m/s2 m/s2 rad/s] sd of the part of accel_x, accel_y, yaw_rate that the
                                  * model does not explain */
  tse_real lag_steer;            /* [s] estimated lag of the steering behind the IMU; below 0: it leads;
                                  * default filter only */
  tse_real lag_steer_sd;         /* [s] its sd */
  tse_real estimate_age;         /* [s] age of the estimates: time of this row minus the time they refer to */
  tse_real n_eff;                /* [1] effective number of particles; default filter: 1 */
  tse_real log_evidence;         /* [nat] log density of this row's measurements given the rows before; 0
                                  * where none was used */
  int32_t grip_reason;           /* TSE_VALID: the grip is usable; else the reason why not (tse_reason) */
  int32_t change_kind;           /* TSE_CHANGE_NONE, _ROAD (all tyres), _FRONT, _REAR, _RESTART */
  int32_t fault_channel;         /* 0: none; else 1 + TSE_CHANNEL_ (after these TSE_OPTIONAL_) of the
                                  * channel that is most probably at fault or implausible */
  int32_t spread_seen[3];        /* 1: the spread is learnt (paper's filter); 0: it is the setting, or too
                                  * small for these sensors and this excitation */
  // clang-format on: end of table
} tse_output;

#endif
