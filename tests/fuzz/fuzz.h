/* tests/fuzz/fuzz.h - shared by the fuzz targets: make settings and rows from bytes, and
 * check the estimates.
 *
 * A target is a function of bytes (LLVMFuzzerTestOneInput). libFuzzer searches for bytes
 * that fail a check. run.c runs the stored ones in every preset. A target aborts at the
 * first failure. */
#ifndef FUZZ_H
#define FUZZ_H

#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "tse/convert.h"
#include "tse/describe.h"
#include "tse/learnt.h"
#include "tse/tse.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

/* Abort with a message unless a condition holds. */
#define MUST(what, ...)                       \
  do {                                        \
    if (!(what)) {                            \
      (void)fprintf(stderr, "fuzz: " __VA_ARGS__); \
      (void)fprintf(stderr, " (" #what ")\n");     \
      abort();                                \
    }                                         \
  } while (0)

/* ---- bytes, with zeros after the last */

typedef struct bytes {
  const uint8_t *at;
  size_t left;
} bytes;

/* Take `count` bytes as an unsigned integer. */
static inline uint32_t take(bytes *b, int count)
{
  uint32_t word = 0;
  for (int i = 0; i < count && b->left > 0; i++, b->at++, b->left--) word |= (uint32_t)*b->at << (8 * i);
  return word;
}

static inline double take_share(bytes *b) { return take(b, 2) / 65535.0; } /* 0 .. 1 */

static inline double take_between(bytes *b, double lo, double hi) { return lo + (hi - lo) * take_share(b); }

/* Take a special number: NaN, infinity, denormal, limits of types ... */
static inline double take_odd(bytes *b)
{
  const double zero = 0,
               odd[] = { zero / zero, 1 / zero, -1 / zero, 0.0, -0.0, 1e-320, 1e-30, -1e-30, 1e30, -1e30,
                 1e300, -1e300, 1.7976931348623157e308, 3.4028234e38, 2147483648.0, -1.0 };
  return odd[take(b, 1) & 15u];
}

/* Return a forged number in place of x. */
static inline double forged(bytes *b, uint32_t how, double x)
{
  switch (how & 7u) {
    case 2: return take_odd(b);
    case 3: return -x;
    case 4: return (how & 8u ? -1 : 1) * pow(10, take_between(b, -20, 20));
    case 5: return x * pow(10, take_between(b, -9, 9));
    default: return take_between(b, -3, 3);
  }
}

/* Convert a double. Overflow gives infinity in float, and the largest number in fixed
 * point. */
static inline tse_real real_of(double x) { return tse_real_of(x); }
static inline double number(tse_real x) { return tse_double_of(x); }

/* ---- settings */

typedef tse_field setting;

static inline const setting *settings_of(uint32_t *count)
{
  int32_t rows;
  const tse_field *const all = tse_describe(TSE_STRUCT_CONFIG, &rows, NULL);
  *count = (uint32_t)rows;
  return all;
}

static inline void put_setting(tse_config *c, const setting *s, double x)
{
  const tse_setting value = tse_setting_of(x);
  const int32_t whole = x >= -2147483648.0 && x <= 2147483647.0 ? (int32_t)x : INT32_MIN;
  if (s->kind == 'i') memcpy((char *)c + s->offset, &whole, sizeof whole);
  else memcpy((char *)c + s->offset, &value, sizeof value);
}

static inline double get_setting(const tse_config *c, const setting *s)
{
  tse_setting value;
  int32_t whole;
  memcpy(&whole, (const char *)c + s->offset, sizeof whole);
  if (s->kind == 'i') return whole;
  memcpy(&value, (const char *)c + s->offset, sizeof value);
  return tse_double_of_setting(value);
}

/* Take settings: those of tse_config_exact() with up to 15 changed.
 *   Given:  hostile  1: also values out of range */
static inline void take_settings(bytes *b, tse_config *c, int hostile)
{
  uint32_t count;
  const setting *const all = settings_of(&count);
  tse_config_exact(c);
  for (uint32_t left = take(b, 1) & 15u; left > 0; left--) {
    const setting *const s = &all[take(b, 2) % count];
    switch (take(b, 1) & 7u) {
      case 0: put_setting(c, s, s->lo); break;
      case 1: put_setting(c, s, s->hi); break;
      case 2: put_setting(c, s, s->def); break;
      case 3: put_setting(c, s, hostile ? take_odd(b) : take_between(b, s->lo, s->hi)); break;
      case 4:
        put_setting(c, s,
            hostile ? s->hi + (s->hi - s->lo) * 1e-3 * (1 + take_share(b)) : take_between(b, s->lo, s->hi));
        break;
      case 5: {
        const double share = take_share(b), from = get_setting(c, s);
        put_setting(c, s, from + (s->hi - from) * share * share * share);
        break;
      }
      case 6: {
        const double share = take_share(b), from = get_setting(c, s);
        put_setting(c, s, from - (from - s->lo) * share * share * share);
        break;
      }
      default: put_setting(c, s, take_between(b, s->lo, s->hi)); break;
    }
  }
}

/* ---- rows: a plausible drive, and disturbances */

typedef struct road {
  double time, speed, steer, pace, slip, yaw_offset, noise;
  uint32_t word;
} road;

static inline road road_of(bytes *b)
{
  road r;
  r.time = 0;
  r.speed = take_between(b, -5, 60);
  r.steer = take_between(b, 0, 0.2);
  r.pace = take_between(b, 0.2, 8);
  r.slip = take_between(b, 0, 0.04);
  r.yaw_offset = 0;
  r.noise = take_between(b, 0, 3);
  r.word = take(b, 2);
  return r;
}

static inline double road_noise(road *r)
{
  r->word = r->word * 1664525u + 1013904223u;
  return r->noise * (((r->word ^ (r->word >> 15)) & 0xffffu) / 32768.0 - 1);
}

/* Return the next row of a plausible drive. */
static inline tse_input road_row(road *r, double dt)
{
  tse_input u;
  memset(&u, 0, sizeof u);
  r->time += dt < 1 ? dt : 1;
  const double steer = r->steer * sin(r->pace * r->time),
               turn = r->speed * steer / (2.75 + 0.0025 * r->speed * r->speed);
  u.dt = real_of(dt);
  u.steer_angle = real_of(steer);
  u.wheel_speed_front = real_of(r->speed / 0.33 * (1 + r->slip * cos(0.7 * r->time)));
  u.wheel_speed_rear = real_of(r->speed / 0.33);
  u.accel_x = real_of(9 * r->slip * cos(0.7 * r->time) + 0.15 * road_noise(r));
  u.accel_y = real_of(turn * r->speed + 0.15 * road_noise(r));
  u.yaw_rate = real_of(turn + r->yaw_offset + 0.0035 * road_noise(r));
  return u;
}

/* Return the description of a channel. The channels follow dt. */
static inline const tse_field *channel_field(uint32_t k)
{
  return tse_describe(TSE_STRUCT_INPUT, NULL, NULL) + 1 + k % TSE_CHANNELS;
}

/* Return the place of a channel in a row. The channels are neighbouring members. */
static inline tse_real *channel_of(tse_input *u, uint32_t k) { return &u->steer_angle + k % TSE_CHANNELS; }

/* Take a row with random channels.
 *   Given:  beyond  factor on the ranges of the channels */
static inline tse_input wild_row(bytes *b, double beyond)
{
  tse_input u;
  memset(&u, 0, sizeof u);
  u.dt = real_of(0.01);
  for (uint32_t k = 0; k < TSE_CHANNELS; k++)
    *channel_of(&u, k) = real_of(
        take_between(b, channel_field(k)->lo * beyond, channel_field(k)->hi * beyond));
  return u;
}

/* ---- checks */

/* Return 1 if a result is finite. In fixed point, a result at the limit of its range
 * counts as infinite (src/number/fixed.h). */
#if defined(TSE_REAL_FIXED)
#define END_OF_RANGE ((tse_real)1 << 59)
static inline int is_number(tse_real x) { return x < END_OF_RANGE && x > -END_OF_RANGE; }
#else
static inline int is_number(tse_real x) { return x - x == 0; }
#endif

#define FASTEST 200.0001      /* [m/s] max speed (src/model/vehicle.h), plus rounding of a mean */
#define FASTEST_TURN 20.00001 /* [rad/s] max yaw rate, plus rounding */

/* Check that the estimates are finite and within their ranges. */

static inline void must_be_estimates(const tse_config *c, const tse_output *y, int status)
{
  const tse_real *const positive[] = { y->stiffness_sd, y->stiffness_spread, y->bias_sd, y->noise,
    y->discrepancy };
  const double most = 1.001 * tse_double_of_setting(c->stiffness_max);
  /* The start is limited below. Draws without reflection are limited at -w_max only, to
   * keep w finite (src/EQUATIONS.md, reflection). */
  const double start = 0.999 * tse_double_of_setting(c->stiffness_min);
  const double least = c->form == 1 && !c->reflect_draws && 2.0 - most < start ? 2.0 - most : start;
  for (const tse_real *x = &y->sideslip; x <= &y->log_evidence; x++) /* all of one type */
    MUST(is_number(*x), "real %u of the estimates is %g, status %d", (unsigned)(x - &y->sideslip), number(*x),
        status);
  MUST(fabs(number(y->yaw_rate)) <= FASTEST_TURN, "yaw rate %g, status %d", number(y->yaw_rate), status);
  MUST(fabs(number(y->vel_x)) <= FASTEST && fabs(number(y->vel_y)) <= FASTEST, "speed %g, %g",
      number(y->vel_x), number(y->vel_y));
  MUST(y->vel_x_sd >= 0 && y->vel_y_sd >= 0 && y->yaw_rate_sd >= 0 && y->lag_steer_sd >= 0
          && y->estimate_age >= 0,
      "sd of a state");
  for (int a = 0; a < 3; a++) {
    MUST(number(y->stiffness[a]) >= least && number(y->stiffness[a]) <= most, "stiffness %d is %g, status %d",
        a, number(y->stiffness[a]), status);
    for (int k = 0; k < 5; k++) MUST(positive[k][a] >= 0, "sd %d of %d is %g", k, a, number(positive[k][a]));
    MUST(y->reason[a] >= TSE_VALID && y->reason[a] <= TSE_IMPLAUSIBLE, "reason %d", (int)y->reason[a]);
    MUST(y->spread_seen[a] == 0 || y->spread_seen[a] == 1, "spread_seen %d", (int)y->spread_seen[a]);
  }
  for (int k = 0; k < TSE_REGIMES; k++)
    MUST(y->regime[k] >= 0 && number(y->regime[k]) <= 1.00001, "regime %d: %g", k, number(y->regime[k]));
  MUST(y->change_probability >= 0 && number(y->change_probability) <= 1.00001, "p of a change %g",
      number(y->change_probability));
  MUST(y->change_kind >= TSE_CHANGE_NONE && y->change_kind <= TSE_CHANGE_RESTART, "change_kind %d",
      (int)y->change_kind);
  MUST(y->fault_channel >= 0 && y->fault_channel <= (int)TSE_CHANNELS, "fault_channel %d",
      (int)y->fault_channel);
  MUST(y->status == status && status <= TSE_W_IMPLAUSIBLE, "status %d in the estimates, %d returned",
      (int)y->status, status);
}

/* Update an FNV-1a hash. Two runs with the same rows must have the same hash. */
static inline uint64_t mixed(uint64_t h, const void *at, size_t count)
{
  for (size_t i = 0; i < count; i++) h = (h ^ ((const uint8_t *)at)[i]) * 1099511628211u;
  return h;
}
#define FRESH 14695981039346656037u

#endif
