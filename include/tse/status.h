/* tse/status.h - status codes of calls, and reasons why a stiffness is not valid.
 * src/tables/status.toml defines codes and texts.
 *
 *   negative  The call was refused. Nothing has changed, bit for bit.
 *   zero      The call has succeeded.
 *   positive  The call has succeeded, with a warning. If there are several warnings, only
 *             the one with the largest code is returned.
 *
 * Use a stiffness only if its reason is TSE_VALID. */
#ifndef TSE_STATUS_H
#define TSE_STATUS_H

typedef enum tse_status {
  // clang-format off: table status_codes
  TSE_E_BUILD = -12,            /* this build rounds differently from the tested ones: compile without
                                 * -ffast-math, with -ffp-contract=off */
  TSE_E_FORMAT = -11,           /* a setting leads to numbers that do not fit the fixed-point format of
                                 * this build; use double or float */
  TSE_E_OLD = -10,              /* the learnt state (estimates of an earlier drive) was written by an older
                                 * version of this library; learn anew */
  TSE_E_VEHICLE = -9,           /* the learnt state belongs to another vehicle: it was saved with other
                                 * settings of the vehicle, of effects or of the formula */
  TSE_E_VERSION = -8,           /* the learnt state was written by a newer version of this library */
  TSE_E_LEARNT = -7,            /* this is not a learnt state of this library, or it is damaged */
  TSE_E_SIZE = -6,              /* the memory of the filter has a different size than the library expects
                                 * (other number of particles or number format) */
  TSE_E_STATE = -5,             /* the parameters are not from tse_prepare(), the filter was not reset with
                                 * these parameters, or the filter or simulation is in a state that the
                                 * called function does not allow (see its comment) */
  TSE_E_TIME = -4,              /* the time step dt is not finite, not positive, or too long (max 3600 s;
                                 * replay and simulator: 1 s) */
  TSE_E_INPUT = -3,             /* an input of the model, such as steering angle or wheel speed, is outside
                                 * its range, or the row has an optional channel that this filter or build
                                 * does not use */
  TSE_E_CONFIG = -2,            /* a setting is outside its range */
  TSE_E_NULL = -1,              /* a required argument is NULL */
  TSE_OK = 0,                   /* ok */
  TSE_W_NOT_VALID = 1,          /* at least one stiffness is not valid; see its reason */
  TSE_W_STARTING = 2,           /* too few informative rows since the start: no stiffness is valid yet */
  TSE_W_MISSING_CHANNEL = 3,    /* a measurement is missing; the others are used */
  TSE_W_HELD = 4,               /* standstill, low speed, reverse or large steering angle: stiffness is not
                                 * updated */
  TSE_W_PREDICTED = 5,          /* the steering angle (paper's filter: or a wheel speed) or all
                                 * measurements are missing: the filter only predicts */
  TSE_W_GAP = 6,                /* long gap between rows or in the steering angle, or jump of the wheel
                                 * speeds: the motion is set from the sensors, all other estimates are kept */
  TSE_W_RECOVERED = 7,          /* the filter started over, because its state was not finite (memory fault
                                 * or overflow) */
  TSE_W_WAITING = 8,            /* no step in this row: the filter waits for channels with a latency; the
                                 * estimates are those of the last step, or of the start */
  TSE_W_RANGE = 9,              /* a number of the filter is near the limit of the fixed-point format, at
                                 * which it saturates */
  TSE_W_IMPLAUSIBLE = 10,       /* the channels contradict each other: one has a wrong unit or sign, front
                                 * and rear wheel speeds are exchanged, or one is late; fault_channel names
                                 * the channel, fault_factor is the factor by which it is too large (0: its
                                 * error is not a factor) */
  // clang-format on: end of table
  TSE_STATUS_END_
} tse_status;

/* Reason why a stiffness, or the grip, is not valid; TSE_VALID if it is valid. */
typedef enum tse_reason {
  // clang-format off: table reason_codes
  TSE_VALID = 0,                /* usable */
  TSE_STARTING = 1,             /* too little data since the start */
  TSE_NOT_EXCITED = 2,          /* the recent inputs do not excite this stiffness */
  TSE_UNCERTAIN = 3,            /* excited, but the sd of the estimate is above the limit (setting
                                 * valid_sd) */
  TSE_SENSOR_FAULT = 4,         /* a channel is probably at fault */
  TSE_HELD = 5,                 /* standstill, low speed, reverse, large steering angle or sliding wheels:
                                 * the last value is held */
  TSE_INPUT_INVALID = 6,        /* inputs or measurements are missing */
  TSE_PARAMETERS_UNCERTAIN = 7, /* the parameters of the car are too uncertain (their sds are the settings
                                 * from mass_sd to grade_sd): calibrate, or measure the parameters better */
  TSE_MISFIT = 8,               /* the model does not explain the measurements: calibrate, or search for a
                                 * missing effect (tselab gap) */
  TSE_IMPLAUSIBLE = 9,          /* the channels contradict each other: one has a wrong unit or sign, front
                                 * and rear wheel speeds are exchanged, or one is late; fault_channel names
                                 * the channel, fault_factor is the factor by which it is too large (0: its
                                 * error is not a factor) */
  // clang-format on: end of table
  TSE_REASON_END_
} tse_reason;

#endif
