/* tests/replay/replay_hash.h - hash all bits of the outputs. Runs without files and
 * without a C library (tests/embedded). */
#ifndef REPLAY_HASH_H
#define REPLAY_HASH_H

#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include "tse/tse.h"

#define REPLAY_HASH_EMPTY 14695981039346656037u

/* Update an FNV-1a hash of 64 bits by the bytes of a value, low byte first on all
 * machines. */
static inline uint64_t replay_mix(uint64_t hash, uint64_t bits, int bytes)
{
  for (int i = 0; i < bytes; i++) hash = (hash ^ (bits >> (8 * i) & 255u)) * 1099511628211u;
  return hash;
}

static inline uint64_t replay_mix_real(uint64_t hash, tse_real x)
{
  uint64_t wide = 0;
  uint32_t narrow = 0;
  if (sizeof x == sizeof wide) {
    memcpy(&wide, &x, sizeof x);
    return replay_mix(hash, wide, 8);
  }
  memcpy(&narrow, &x, sizeof narrow);
  return replay_mix(hash, narrow, 4);
}

/* The outputs, except estimate_age: no channel is late in the recorded drive. */
static const struct {
  const char *name;
  size_t at;
  int whole;
} replay_outputs[] = {
  // clang-format off: table hashed_outputs
  { "vel_x", offsetof(tse_output, vel_x), 0 },
  { "vel_x_sd", offsetof(tse_output, vel_x_sd), 0 },
  { "vel_y", offsetof(tse_output, vel_y), 0 },
  { "vel_y_sd", offsetof(tse_output, vel_y_sd), 0 },
  { "yaw_rate", offsetof(tse_output, yaw_rate), 0 },
  { "yaw_rate_sd", offsetof(tse_output, yaw_rate_sd), 0 },
  { "sideslip", offsetof(tse_output, sideslip), 0 },
  { "sideslip_sd", offsetof(tse_output, sideslip_sd), 0 },
  { "grip", offsetof(tse_output, grip), 0 },
  { "grip_sd", offsetof(tse_output, grip_sd), 0 },
  { "grip_valid", offsetof(tse_output, grip_reason), 1 },
  { "cx_front", offsetof(tse_output, stiffness[0]), 0 },
  { "cx_front_sd", offsetof(tse_output, stiffness_sd[0]), 0 },
  { "cx_front_spread", offsetof(tse_output, stiffness_spread[0]), 0 },
  { "cx_front_spread_seen", offsetof(tse_output, spread_seen[0]), 1 },
  { "cx_front_valid", offsetof(tse_output, reason[0]), 1 },
  { "cy_front", offsetof(tse_output, stiffness[1]), 0 },
  { "cy_front_sd", offsetof(tse_output, stiffness_sd[1]), 0 },
  { "cy_front_spread", offsetof(tse_output, stiffness_spread[1]), 0 },
  { "cy_front_spread_seen", offsetof(tse_output, spread_seen[1]), 1 },
  { "cy_front_valid", offsetof(tse_output, reason[1]), 1 },
  { "cy_rear", offsetof(tse_output, stiffness[2]), 0 },
  { "cy_rear_sd", offsetof(tse_output, stiffness_sd[2]), 0 },
  { "cy_rear_spread", offsetof(tse_output, stiffness_spread[2]), 0 },
  { "cy_rear_spread_seen", offsetof(tse_output, spread_seen[2]), 1 },
  { "cy_rear_valid", offsetof(tse_output, reason[2]), 1 },
  { "bias_accel_x", offsetof(tse_output, bias[0]), 0 },
  { "bias_accel_x_sd", offsetof(tse_output, bias_sd[0]), 0 },
  { "bias_accel_y", offsetof(tse_output, bias[1]), 0 },
  { "bias_accel_y_sd", offsetof(tse_output, bias_sd[1]), 0 },
  { "bias_yaw_rate", offsetof(tse_output, bias[2]), 0 },
  { "bias_yaw_rate_sd", offsetof(tse_output, bias_sd[2]), 0 },
  { "noise_accel_x", offsetof(tse_output, noise[0]), 0 },
  { "noise_accel_y", offsetof(tse_output, noise[1]), 0 },
  { "noise_yaw_rate", offsetof(tse_output, noise[2]), 0 },
  { "noise_wheel_front", offsetof(tse_output, noise[3]), 0 },
  { "noise_wheel_rear", offsetof(tse_output, noise[4]), 0 },
  { "p_steady", offsetof(tse_output, regime[TSE_REGIME_STEADY]), 0 },
  { "p_changed", offsetof(tse_output, regime[TSE_REGIME_CHANGED]), 0 },
  { "p_axle", offsetof(tse_output, regime[TSE_REGIME_AXLE]), 0 },
  { "p_fault", offsetof(tse_output, regime[TSE_REGIME_FAULT]), 0 },
  { "p_sliding", offsetof(tse_output, regime[TSE_REGIME_SLIDING]), 0 },
  { "p_restarted", offsetof(tse_output, regime[TSE_REGIME_RESTARTED]), 0 },
  { "change_age", offsetof(tse_output, change_age), 0 },
  { "change_probability", offsetof(tse_output, change_probability), 0 },
  { "change_kind", offsetof(tse_output, change_kind), 1 },
  { "change_cx_front", offsetof(tse_output, change_ratio[0]), 0 },
  { "change_cy_front", offsetof(tse_output, change_ratio[1]), 0 },
  { "change_cy_rear", offsetof(tse_output, change_ratio[2]), 0 },
  { "fault_channel", offsetof(tse_output, fault_channel), 1 },
  { "discrepancy_accel_x", offsetof(tse_output, discrepancy[0]), 0 },
  { "discrepancy_accel_y", offsetof(tse_output, discrepancy[1]), 0 },
  { "discrepancy_yaw_rate", offsetof(tse_output, discrepancy[2]), 0 },
  { "innovation_accel_x", offsetof(tse_output, innovation[0]), 0 },
  { "innovation_accel_y", offsetof(tse_output, innovation[1]), 0 },
  { "innovation_yaw_rate", offsetof(tse_output, innovation[2]), 0 },
  { "innovation_wheel_front", offsetof(tse_output, innovation[3]), 0 },
  { "innovation_wheel_rear", offsetof(tse_output, innovation[4]), 0 },
  { "nis_accel_x", offsetof(tse_output, nis[0]), 0 },
  { "nis_accel_y", offsetof(tse_output, nis[1]), 0 },
  { "nis_yaw_rate", offsetof(tse_output, nis[2]), 0 },
  { "nis_wheel_front", offsetof(tse_output, nis[3]), 0 },
  { "nis_wheel_rear", offsetof(tse_output, nis[4]), 0 },
  { "lag_steer", offsetof(tse_output, lag_steer), 0 },
  { "lag_steer_sd", offsetof(tse_output, lag_steer_sd), 0 },
  { "n_eff", offsetof(tse_output, n_eff), 0 },
  { "log_evidence", offsetof(tse_output, log_evidence), 0 },
  { "status", offsetof(tse_output, status), 1 },
  { "cx_front_secant", offsetof(tse_output, stiffness_secant[0]), 0 },
  { "cy_front_secant", offsetof(tse_output, stiffness_secant[1]), 0 },
  { "cy_rear_secant", offsetof(tse_output, stiffness_secant[2]), 0 },
  { "fault_factor", offsetof(tse_output, fault_factor), 0 },
  // clang-format on: end of table
};
enum { REPLAY_OUTPUTS = sizeof replay_outputs / sizeof replay_outputs[0] };

static inline uint64_t replay_mix_output(uint64_t hash, const tse_output *y)
{
  for (int k = 0; k < REPLAY_OUTPUTS; k++) {
    const uint8_t *const at = (const uint8_t *)y + replay_outputs[k].at;
    uint32_t whole;
    tse_real x;
    memcpy(&whole, at, sizeof whole);
    memcpy(&x, at, replay_outputs[k].whole ? sizeof whole : sizeof x);
    hash = replay_outputs[k].whole ? replay_mix(hash, whole, 4) : replay_mix_real(hash, x);
  }
  return hash;
}

#endif
