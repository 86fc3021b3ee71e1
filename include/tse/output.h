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
  TSE_REGIME_RESTARTED, /* all was started over within the last 2 s */
  // clang-format on: end of table
  TSE_REGIMES
};

enum { TSE_CHANGE_NONE, TSE_CHANGE_ROAD, TSE_CHANGE_FRONT, TSE_CHANGE_REAR, TSE_CHANGE_RESTART };

/* Stiffness is relative to the settings' nominal value, because N/rad exceeds the range of some number
 * formats. tse_stiffness_si() converts. */
typedef struct tse_output {
  // clang-format off: table output_members
  tse_real stiffness[3];         /* [1] mean stiffness over the settings' nominal one, by TSE_CX_FRONT,
                                  * TSE_CY_FRONT, TSE_CY_REAR: of an axle, force over slip, or over its
                                  * kinematic slip angle, in steady driving at static load and no slip
                                  * (src/EQUATIONS.md) */
  tse_real stiffness_sd[3];      /* [1] sd of that mean */
  int32_t reason[3];             /* TSE_VALID: the stiffness may be used; else why not, a tse_reason */
  int32_t status;                /* TSE_OK; above: done, with the caution of this code, a tse_status;
                                  * whether to use a stiffness says its reason */
  tse_real sideslip;             /* [rad] sideslip angle atan2(vel_y, vel_x) at the centre of gravity; 0 at
                                  * standstill */
  tse_real sideslip_sd;          /* [rad] its sd */
  tse_real grip;                 /* [1] friction of the tyres: the most lateral force of an axle over its
                                  * load; with a tyre_saturation_balance, 1 over the mean of 1/friction of
                                  * both axles; form 0 */
  tse_real grip_sd;              /* [1] its sd */
  tse_real vel_x;                /* [m/s] longitudinal velocity of the centre of gravity */
  tse_real vel_x_sd;             /* [m/s] its sd */
  tse_real vel_y;                /* [m/s] lateral velocity of the centre of gravity */
  tse_real vel_y_sd;             /* [m/s] its sd */
  tse_real yaw_rate;             /* [rad/s] yaw rate */
  tse_real yaw_rate_sd;          /* [rad/s] its sd */
  tse_real stiffness_secant[3];  /* [1] stiffness in effect: force over slip, or slip angle, at the slip
                                  * and the load of this row; sd: the same share of it */
  tse_real stiffness_spread[3];  /* [1] form 0: model discrepancy, model_sd times the stiffness; form 1:
                                  * process sd, sqrt(Sigma) */
  tse_real bias[3];              /* [m/s2 m/s2 rad/s] bias of accel_x, accel_y, yaw_rate: what the channel
                                  * reads too much */
  tse_real bias_sd[3];           /* [m/s2 m/s2 rad/s] its sd */
  tse_real noise[5];             /* [1] noise as found, over the setting: accel_x, accel_y, yaw_rate, wheel
                                  * speeds front and rear; form 0 */
  tse_real innovation[5];        /* [m/s2 m/s2 rad/s m/s m/s] what each of them read less what was
                                  * predicted; 0 where it was not used; form 0 */
  tse_real nis[5];               /* [1] normalised innovation squared of each of them, without what lasts:
                                  * 1 on average where model and settings fit; 0 where it was not used;
                                  * form 0 */
  tse_real fault_factor;         /* [1] how many times too large the implausible channel is: 57.3 degrees
                                  * for radians, -1 a sign, 0 no factor: exchanged, stuck, late; form 0 */
  tse_real regime[TSE_REGIMES];  /* [1] probability of each regime, by TSE_REGIME_STEADY ... */
  tse_real change_age;           /* [s] time since the last change; 0 while there was none */
  tse_real change_probability;   /* [1] probability that nothing has happened since that change */
  tse_real change_ratio[3];      /* [1] each stiffness now over that before the change */
  tse_real discrepancy[3];       /* [m/s2 m/s2 rad/s] sd of what the model does not explain of accel_x,
                                  * accel_y, yaw_rate */
  tse_real lag_steer;            /* [s] how late the steering acts behind the IMU as found; below 0: how
                                  * early; form 0 */
  tse_real lag_steer_sd;         /* [s] its sd */
  tse_real estimate_age;         /* [s] how long before this row the time lies that the estimates speak of */
  tse_real n_eff;                /* [1] effective number of particles; 1 in form 0 */
  tse_real log_evidence;         /* [nat] log density of this row's measurements given the rows before; 0
                                  * where none was used */
  int32_t grip_reason;           /* TSE_VALID: the grip may be used; else why not */
  int32_t change_kind;           /* TSE_CHANGE_NONE, _ROAD (all tyres), _FRONT, _REAR, _RESTART */
  int32_t fault_channel;         /* 0 none, else 1 + TSE_CHANNEL_ of the channel that is likeliest at fault
                                  * or implausible, behind them TSE_OPTIONAL_ */
  int32_t spread_seen[3];        /* 1: the spread is learnt, form 1; 0: the setting, or below what sensors
                                  * and excitation can show */
  // clang-format on: end of table
} tse_output;

#endif
