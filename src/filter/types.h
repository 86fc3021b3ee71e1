/* filter/types.h - types that the files of the default filter share. Start reading at
 * step.c. Internal. */
#ifndef TSE_FILTER_TYPES_H
#define TSE_FILTER_TYPES_H

#include "estimator/stages.h"
#include "filter/limits.h"
#include "filter/ud.h"

/* Prevent inlining of a function that processes a part of a log row. If these functions
 * were inlined, the stack would hold all their frames at once, up to 1 kB on a Cortex-M4,
 * although only one of them is in use at a time. */
#if defined(__GNUC__)
#define STAGE __attribute__((noinline))
#else
#define STAGE
#endif

/* Axle that rolls freely: no torque acts on it, so that its wheels measure the speed of
 * the car. ROLLS_UNKNOWN: it is not known whether an axle rolls freely. ROLLS_NONE: no
 * axle rolls freely, because the car brakes or both axles are driven. */
enum { ROLLS_UNKNOWN, ROLLS_NONE, ROLLS_FRONT, ROLLS_REAR };

/* A checked log row. Arrays of TSE_SENSORS elements are in the order ACCEL_X, ACCEL_Y,
 * YAW_RATE, WHEEL_FRONT, WHEEL_REAR. */
typedef struct decoded {
  tse_real dt;              /* [s] time since the previous row */
  tse_real steer;           /* [rad] steering angle of the row or, if it is missing, of an earlier row */
  tse_real z[TSE_SENSORS];  /* measurements, SI; wheel speeds times wheel radius [m/s]; 0 if not used */
  tse_real axle[2];         /* [m/s] front and rear wheel speed as logged, times wheel radius */
  int32_t use[TSE_SENSORS]; /* 1: the measurement is used */
  int32_t has_steer;        /* 1: the steering angle is given */
  int32_t used;             /* number of IMU channels used */
  int32_t equal;            /* 1: both wheel speeds are equal */
  int32_t same;             /* 1: wheel speeds equal, or in the ratio of earlier rows (tse_filter.ratio) */
  int32_t off[2];           /* 1: the wheel speed of this axle has changed since the previous row, and is
                             * not a copy of the wheel speed of the other axle */
  int32_t one_speed;        /* 1: both wheel speeds are copies of one signal */
  int32_t no_second;        /* 1: the wheel speeds of the two axles cannot be compared: one_speed is 1, or
                             * an axle has had no wheel speed for USUAL_TIME and no velocity is measured.
                             * The slips are then computed from the longitudinal force */
  tse_real optional[TSE_OPTIONALS]; /* optional channels; 0 if not given */
  uint32_t given;                   /* bits TSE_GIVEN_* of the optional channels */
  int32_t rolls;                    /* freely rolling axle: ROLLS_* */
  int32_t no_slip;                  /* 1: the longitudinal stiffness is not estimated from this row */
} decoded;

/* Kinds of events. The table in events.c describes each of them. A TSE_SMALL build has
 * only EVENT_ROAD and EVENT_ROAD_AXLE_DIFF. */
enum {
  EVENT_NONE,
  EVENT_ROAD,           /* a different road surface, which acts on all tyres */
  EVENT_ROAD_AXLE_DIFF, /* part of EVENT_ROAD: difference of the change between front and rear axle */
  EVENT_ROAD_RETURN,    /* return to the road surface before the last change */
  EVENT_FRONT,          /* change of the front tyres */
  EVENT_REAR,           /* change of the rear tyres */
  EVENT_SLIP_FRONT,     /* front wheels lock or spin */
  EVENT_SLIP_REAR,      /* rear wheels lock or spin */
  EVENT_STEER,          /* faulty steering angle */
  EVENT_SENSOR,         /* faulty ACCEL_X. EVENT_SENSOR + i: faulty sensor i = ACCEL_X .. WHEEL_REAR */
  EVENT_KINDS = HAS_SLIP ? EVENT_SENSOR + TSE_SENSORS : EVENT_ROAD_RETURN
};

/* Number of the channel at fault, as in tse_output.fault_channel: 1 + TSE_CHANNEL_* for a
 * channel of the log, FAULT_VELOCITY + index for a measured velocity. */
enum { NO_FAULT, FAULT_STEER = 1 + TSE_CHANNEL_steer_angle, FAULT_VELOCITY = 1 + TSE_CHANNELS };

/* Index of the steering angle in arrays of TSE_SENSORS + 1 elements, such as
 * tse_kalman.frozen. The sensors come first. */
enum { STEERING = TSE_SENSORS };

/* Values of the argument `channel` of use_scalar() for a measurement that is not made by
 * one of the TSE_SENSORS. NO_SENSOR_LONGITUDINAL: the measurement depends on the
 * longitudinal motion. NO_SENSOR_LATERAL: it depends on the lateral motion. */
enum { NO_SENSOR_LONGITUDINAL = -1, NO_SENSOR_LATERAL = -2 };

/* A scalar measurement. h and consider are partial derivatives of its prediction. */
typedef struct scalar {
  int32_t along;                     /* 1: no braking, so that longitudinal channels show tyre changes */
  tse_real h[TSE_ALL];               /* partial derivatives with respect to state / state_unit */
  tse_real consider[TSE_CONSIDERED]; /* partial derivatives with respect to consider parameter / its sd */
  tse_real e;                        /* innovation */
  tse_real r;                        /* variance of noise and model discrepancy together */
  tse_real white;                    /* variance of the noise alone */
  tse_real dt;                       /* [s] time since the previous measurement of this channel */
} scalar;

/* Return whether one of the axles rolls freely. */
static inline int is_rolling_axle(int32_t rolls) { return rolls == ROLLS_FRONT || rolls == ROLLS_REAR; }

/* Return whether a sensor is a wheel speed. */
static inline int is_wheel(int channel) { return channel == WHEEL_FRONT || channel == WHEEL_REAR; }

/* Return the axle that is not driven. It rolls freely while the car does not brake. If
 * both axles are driven, or the driven axle is unknown, return ROLLS_UNKNOWN. */
static inline int32_t find_undriven_axle(const tse_car *c)
{
  if (c->driven == 1) return ROLLS_REAR;
  return c->driven == 2 ? ROLLS_FRONT : ROLLS_UNKNOWN;
}

/* Return the number that sensor a (ACCEL_X ...) has in tse_output.fault_channel. */
static inline int32_t fault_of(int32_t a)
{
  return 1
      + (is_wheel(a) ? a - WHEEL_FRONT + (int32_t)TSE_CHANNEL_wheel_speed_front
                     : a + (int32_t)TSE_CHANNEL_accel_x);
}

#endif
