/* tse/replay.h - the single-track model driven by what a log says of steering and wheels: what the other channels should read.
 *
 * Deterministic: constant stiffness, constant biases, no noise; with all effects of tse/effects.def that the settings switch on.
 * For fits, which call it thousands of times. Same rules as tse/tse.h. */
#ifndef TSE_REPLAY_H
#define TSE_REPLAY_H

#include "tse/tse.h"

#define tse_replay_start_default TSE_NAME(tse_replay_start_default)
#define tse_replay               TSE_NAME(tse_replay)

#ifdef __cplusplus
extern "C" {
#endif

/* Arrays of `rows` values; what they are: tse/replay.def. */
typedef struct tse_replay_log {
#define REPLAY_LOG(name, needed, unit, text) const tse_real *name;
#include "tse/replay.def"
} tse_replay_log;

typedef struct tse_replay_start {
#define REPLAY_START(name, def, unit, text) tse_real name;
#include "tse/replay.def"
} tse_replay_start;

typedef struct tse_replay_out {
#define REPLAY_OUT(name, unit, text) tse_real *name;
#include "tse/replay.def"
} tse_replay_out;

/* Fill with the defaults of tse/replay.def. s NULL: nothing happens. */
void tse_replay_start_default(tse_replay_start *s);

/* Run a whole log. Inputs are linear between rows; the steps are those of the estimator (vehicle_steps() in src/model/vehicle.h).
 *   Given:     p     from tse_prepare(), with its effects     log    arrays of `rows` values, steer_angle and speeds finite
 *              s     stiffness, biases, start
 *   Updated:   out   what the car and its sensors do at each row; nothing when a row is refused; the rows before, when the model leaves the numbers
 *   Returned:  TSE_OK; TSE_E_NULL; TSE_E_STATE (p not prepared); TSE_E_TIME, TSE_E_INPUT: a row is out of range, *wrong
 *              (if not NULL) its index. TSE_E_INPUT also where the start (then row 0) or a profile is not finite, and where what the
 *              car does is no number of this format any more
 *   Cost:      two evaluations of the model a row: 0.1 us without effects. Source: (1)-(4), (7), src/EQUATIONS.md. */
tse_status tse_replay(const tse_params *p, const tse_replay_log *log, int32_t rows, const tse_replay_start *s,
                      const tse_replay_out *out, int32_t *wrong);

#ifdef __cplusplus
}
#endif
#endif
