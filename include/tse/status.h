/* tse/status.h - status of a call, and reason of each stiffness. Codes and texts:
 * src/tables/status.toml.
 *
 *   negative  refused; nothing has changed, bit for bit
 *   zero      done
 *   positive  done, with a warning; of several the largest
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
  TSE_E_OLD = -10,              /* the learnt state was written by an older version of this library; learn
                                 * anew */
  TSE_E_VEHICLE = -9,           /* the learnt state belongs to another vehicle */
  TSE_E_VERSION = -8,           /* the learnt state was written by a newer version of this library */
  TSE_E_LEARNT = -7,            /* not a learnt state of this library, or damaged */
  TSE_E_SIZE = -6,              /* the filter's memory has another size than the library expects (other
                                 * capacity or format) */
  TSE_E_STATE = -5,             /* the filter was not reset with these parameters, or is not a filter of
                                 * this library */
  TSE_E_TIME = -4,              /* time step not finite, not positive, or too long */
  TSE_E_INPUT = -3,             /* an input that drives the model is outside its range */
  TSE_E_CONFIG = -2,            /* a setting is outside its range */
  TSE_E_NULL = -1,              /* a required argument is NULL */
  TSE_OK = 0,                   /* ok */
  TSE_W_NOT_VALID = 1,          /* at least one stiffness is not valid; its reason says why */
  TSE_W_STARTING = 2,           /* too few informative rows since the start; spread and validity are not
                                 * settled */
  TSE_W_MISSING_CHANNEL = 3,    /* a measurement was missing; the others were used */
  TSE_W_HELD = 4,               /* standstill, low speed, reverse or large steering angle: nothing is
                                 * learnt of the stiffness */
  TSE_W_PREDICTED = 5,          /* no measurement, or inputs missing: predicted only */
  TSE_W_GAP = 6,                /* a step too long to bridge, or sensors that jump: states restarted from
                                 * the sensors, what was learnt is kept */
  TSE_W_RECOVERED = 7,          /* the state was not finite, by a fault of the memory or an overflow: the
                                 * filter started over */
  TSE_W_WAITING = 8,            /* no step yet: the filter waits for channels that are logged later;
                                 * estimates are those of the last step, or of the start */
  TSE_W_RANGE = 9,              /* a number reached the end of the range of the number format: it stops
                                 * there, or the sample was dropped */
  TSE_W_IMPLAUSIBLE = 10,       /* the channels contradict each other: a wrong unit, sign or axle, or one
                                 * comes late; fault_channel says which, fault_factor how many times too
                                 * large it is */
  // clang-format on: end of table
  TSE_STATUS_END_
} tse_status;

/* Why a stiffness is not valid. An estimate is valid when its reason is TSE_VALID. */
typedef enum tse_reason {
  // clang-format off: table reason_codes
  TSE_VALID = 0,                /* usable */
  TSE_STARTING = 1,             /* too little seen since the start */
  TSE_NOT_EXCITED = 2,          /* the recent inputs do not show this stiffness */
  TSE_UNCERTAIN = 3,            /* excited, but the sd of the mean is above the limit */
  TSE_SENSOR_FAULT = 4,         /* a channel is probably at fault */
  TSE_HELD = 5,                 /* standstill, low speed, reverse, large steering angle or sliding wheels:
                                 * value from before */
  TSE_INPUT_INVALID = 6,        /* inputs or measurements are missing */
  TSE_PARAMETERS_UNCERTAIN = 7, /* the parameters of the car are too uncertain (settings mass_sd to
                                 * grade_sd): calibrate, or measure them better */
  TSE_MISFIT = 8,               /* the model does not explain the measurements: calibrate, or look for what
                                 * is missing */
  TSE_IMPLAUSIBLE = 9,          /* the channels contradict each other: a wrong unit, sign or axle, or one
                                 * comes late (fault_channel, fault_factor) */
  // clang-format on: end of table
  TSE_REASON_END_
} tse_reason;

#endif
