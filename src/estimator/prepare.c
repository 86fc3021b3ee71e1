/* estimator/prepare.c - compute the constants of a filter (tse_params)
 * from its settings. */
#include "estimator/latencies.h"
#include "estimator/settings.h"
#include "model/car.h"
#include "model/effects_constant.h"
#include "tables/constants.h"
#include "tables/copies.h"

/* [1] Max variance of the process noise of (stiffness/nominal) in the particle filter, if
 * the setting spread_max is 2, its largest value, which means no limit. */
#define MAX_SPREAD_VAR TSE_R(1000000)
/* [m/s] Min sd of the noise of a wheel speed: 0.04 rad/s at a wheel radius of 0.3 m.
 * It is used if the setting wheel_noise_sd gives a smaller sd, as its default, 0,
 * does. */
#define MIN_WHEEL_SD TSE_S(0.012)
/* [m] Min relaxation length. At 10 m/s it delays the slip angle by 0.05/10 = 5 ms, half
 * the usual sample time (10 ms). A shorter length would hardly change the result. */
#define MIN_RELAXATION TSE_S(0.05)
/* [1] Min prior relative sd of the ratio of the rear to the front wheel radius, used if
 * the setting wheel_radius_sd is smaller, as its default, 0, is. The ratio changes with
 * tyre pressure and temperature, and its errors look like slip: an error of 0.0005, a
 * quarter of this sd, equals half the slip of steady driving. */
#define MIN_RADIUS_SD TSE_R(0.002)
/* [1] Coefficient of the rolling resistance that brakes a freely rolling axle, if the
 * setting rolling_resistance_coefficient is 0: a usual value of car tyres. */
#define DEFAULT_ROLLING TSE_S(0.01)

/* Mix a word into the FNV-1a fingerprint h (a hash). A filter stores the fingerprint of
 * the parameters with which it was reset, and a step with other parameters is refused. */
static uint32_t mix_word(uint32_t h, uint32_t word)
{
  for (int i = 0; i < 4; i++) {
    h = (h ^ (word & 0xffu)) * 16777619u;
    word >>= 8;
  }
  return h;
}

/* Mix the bytes of a setting into the fingerprint. */
static uint32_t mix_setting(uint32_t h, tse_setting x)
{
  uint32_t words[(sizeof(tse_setting) + 3) / 4];
  memcpy(words, &x, sizeof x);
  for (size_t i = 0; i < sizeof words / sizeof words[0]; i++) h = mix_word(h, words[i]);
  return h;
}

/* Return the fingerprint of all settings and of TSE_MAX_PARTICLES, a constant of the
 * build that determines the size of a filter. */
static uint32_t compute_fingerprint(const tse_config *c)
{
  uint32_t h = 2166136261u;
  for (int i = 0; i < REALS; i++) h = mix_setting(h, real_at(c, &setting_reals[i]));
  for (int i = 0; i < WHOLES; i++) h = mix_word(h, (uint32_t)whole_at(c, &setting_wholes[i]));
  return mix_word(h, TSE_MAX_PARTICLES);
}

/* If an effect is active (on), mix the name and value of one of its settings into the
 * fingerprint h. An inactive effect does not change the fingerprint, so that learnt
 * states saved before the effect existed stay valid. The value is mixed in single
 * precision, because builds of different number formats round decimal numbers
 * differently. */
static uint32_t mix_effect(uint32_t h, int on, const char *name, tse_setting value)
{
  if (!on) return h;
  for (; *name; name++) h = mix_word(h, (uint32_t)(unsigned char)*name);
  return mix_word(h, r_single_bits(value));
}

/* Return the fingerprint of the settings on which the meaning of a relative stiffness
 * depends: vehicle, effects and formula. A learnt state is valid only for the same
 * fingerprint. */
static uint32_t compute_vehicle_fingerprint(const tse_config *c)
{
  uint32_t h = 2166136261u;
  for (int i = 0; i < COUNT_VEHICLE; i++) h = mix_word(h, r_single_bits(real_at(c, &setting_reals[i])));
  const uint64_t on = find_active_effects(c)
      /* exact_kinematics is left out: it has no influence on the default filter, whose
       * kinematics are always exact */
      & ~((uint64_t)1 << TSE_EFFECT_exact_kinematics);
  for (int i = 0; i < COUNT_EFFECTS; i++) {
    const real_row *const row = &setting_reals[FIRST_EFFECTS + i];
    const tse_setting value = real_at(c, row);
    /* tyre_saturation_balance is newer than the first saved learnt states. If it is 0,
     * it does not change the fingerprint, so that learnt states saved by older
     * versions stay valid */
    const int counts = row->at != offsetof(tse_config, tyre_saturation_balance) || value != 0;
    h = mix_effect(h, counts && (on >> setting_effects[i].effect & 1u), row->name, value);
  }
  const int formula = (int)(on >> TSE_BIT_FORMULA & 1u);
  for (int i = 0; i < COUNT_FORMULA; i++)
    h = mix_effect(
        h, formula, setting_reals[FIRST_FORMULA + i].name, real_at(c, &setting_reals[FIRST_FORMULA + i]));
  for (int i = 0; i < COUNT_WHOLE_FORMULA; i++)
    h = mix_effect(h, formula, setting_wholes[FIRST_WHOLE_FORMULA + i].name,
        r_from_int(whole_at(c, &setting_wholes[FIRST_WHOLE_FORMULA + i])));
  return h;
}

static tse_setting compute_square(tse_setting x) { return r_mul(x, x); }

/* Apply the active effects that only change settings of the car, before the filter starts
 * (hook CONSTANT in src/tables/effects.toml). */
static void apply_constant_effects(uint64_t mask, tse_config *car)
{
#define CONSTANT_ON(id) if (mask >> TSE_EFFECT_##id & 1u) id##_constant(car);
  EFFECTS_CONSTANT(CONSTANT_ON)
}

/* Copy the parameters of all effects and of the user's formula. */
static void prepare_effects(const tse_config *c, uint64_t mask, tse_params *p)
{
  p->effects.mask = mask;
#if defined(TSE_NO_EFFECTS)
  (void)c;
#else
  tse_effects *const e = &p->effects;
  for (int i = 0; i < COUNT_EFFECTS; i++) { /* members after the mask are in the order of the settings */
    const tse_real x = real_of(real_at(c, &setting_reals[FIRST_EFFECTS + i]));
    memcpy((uint8_t *)e + sizeof e->mask + (size_t)i * sizeof x, &x, sizeof x);
  }
  e->mass = real_of(c->mass);
  e->formula_gain = real_of(c->formula_gain);
  for (int k = 0; k < TSE_FORMULA_NUMBERS; k++)
    e->formula[k] = real_of(
        real_at(c, &setting_reals[FIRST_FORMULA + 1 + k])); /* the first one is the gain */
  e->formula_place = c->formula_place;
  unpack_formula(c, e->formula_code);
#endif
}

#if defined(TSE_REAL_FIXED)
/* Limits of the constants of a filter in fixed point (check_range()). They keep all
 * numbers below FIXED_MOST, 2^27 (1.3e8), at which numbers saturate. The particle filter
 * divides each measurement by the noise sd of its sensor (unit sigma), and its variances
 * are in sigma^2: an error of 10000 sigma already has a square of 1e8.
 *
 * The smallest positive number is 2^-32 (2e-10). A smaller increase of a variance in a
 * log row would be rounded to 0 (is_below_step()). */

/* [sigma per unit of slip] Max of (longitudinal stiffness of both axles/mass)/accel_x_sd,
 * 117 times the value of the default car, and of (cornering stiffness of an
 * axle/mass)/accel_y_sd [sigma/rad]. At this limit a slip of 0.1 and a stiffness error of
 * 30 % cause an error of 131072 * 0.1 * 0.3 = 3900 sigma, whose square is below
 * FIXED_MOST. The same number is the max of the product of tse_params.damping [m/s2] and
 * tse_params.max_step [s], in m/s. */
#define MAX_SIGNAL_GAIN TSE_R(131072)
/* [sigma] Max initial sd of the yaw rate, in noise sds of the gyro; its square is below
 * FIXED_MOST. The number also limits m l_f/I_z and m l_r/I_z [1/m] (m: mass; l_f, l_r:
 * distances of the axles from the centre of gravity; I_z: yaw inertia). */
#define MAX_START TSE_R(4096)
/* [sigma^2] Max initial variance of a bias, and max increase of this variance per
 * second. */
#define MAX_BIAS_VAR TSE_R(16777216)
/* [1] Max of noise_max^2. The setting noise_max is the max ratio of the estimated noise
 * sd of a sensor to its setting. */
#define MAX_NOISE TSE_R(65536)

/* Return whether a variance does not grow although its rate is positive, because rate
 * times dt, its increase in one row, is rounded to 0. */
static int is_below_step(tse_real rate, tse_real dt) { return rate > 0 && r_mul(rate, dt) == 0; }

/* Check that the constants of a filter are within the limits MAX_SIGNAL_GAIN ... above.
 *   Returned:  TSE_OK; or TSE_E_FORMAT and *wrong, the name of a setting to change */
static tse_status check_range(const tse_params *p, const tse_config *c, const char **wrong)
{
  /* In the last two rows, FIXED_MOST > 1 marks a value that is too small. 64 is a raw
   * number in units of 2^-32 */
  const struct {
    tse_real value, max;
    const char *name;
  } row[] = {
    { r_mul(p->car.kx_front + p->car.kx_rear, p->inv_sd[0]), MAX_SIGNAL_GAIN, "accel_x_sd" },
    { r_mul(r_max(p->car.ky_front, p->car.ky_rear), p->inv_sd[1]), MAX_SIGNAL_GAIN, "accel_y_sd" },
    { r_mul(p->x_sd0[2], p->inv_sd[2]), MAX_START, "yaw_rate_sd" },
    { p->bias_var0[0], MAX_BIAS_VAR, "accel_x_bias_sd" },
    { p->bias_var0[1], MAX_BIAS_VAR, "accel_y_bias_sd" },
    { p->bias_var0[2], MAX_BIAS_VAR, "yaw_rate_bias_sd" },
    { p->bias_walk[0], MAX_BIAS_VAR, "accel_x_bias_walk" },
    { p->bias_walk[1], MAX_BIAS_VAR, "accel_y_bias_walk" },
    { p->bias_walk[2], MAX_BIAS_VAR, "yaw_rate_bias_walk" },
    { p->noise_max_var, MAX_NOISE, "noise_max" },
    { r_mul(p->damping, p->max_step), MAX_SIGNAL_GAIN, "yaw_inertia" },
    { r_max(p->car.jf, p->car.jr), MAX_START, "yaw_inertia" },
    { is_below_step(p->steady_walk, c->sample_time) ? FIXED_MOST : 0, TSE_R(1), "steady_walk" },
    { p->spread_var < (tse_real)64 ? FIXED_MOST : 0, TSE_R(1), "initial_spread" },
  };
  for (size_t i = 0; i < sizeof row / sizeof row[0]; i++)
    if (row[i].value > row[i].max) {
      if (wrong) *wrong = row[i].name;
      return TSE_E_FORMAT;
    }
  return TSE_OK;
}
#endif

/* Copy the settings that are constants of the filter without any computation. */
static void prepare_copies(const tse_config *c, tse_params *p)
{
  for (size_t i = 0; i < sizeof copied / sizeof copied[0]; i++) {
    tse_setting x;
    memcpy(&x, (const uint8_t *)c + copied[i].from, sizeof x);
    const tse_real constant = real_of(x);
    memcpy((uint8_t *)p + copied[i].to, &constant, sizeof constant);
  }
#if !defined(TSE_NO_VELOCITY)
  /* prior sd of the heading. Any value will do: the first measured course sets heading
   * and sd (set_heading() in velocity.c) */
  p->extra_sd[0] = TSE_R(1);
#endif
}

/* Compute loads, grip and load transfer of the tyres. */
static void prepare_tyres(const tse_config *c, tse_params *p)
{
  tse_car *const car = &p->car;
  const tse_setting one = TSE_S(1), span = c->lf + c->lr, balance = c->tyre_saturation_balance;
  const tse_setting load_front = r_div(r_mul(STANDARD_GRAVITY, c->lr), span),
                    load_rear = r_div(r_mul(STANDARD_GRAVITY, c->lf), span);
  /* friction is at most 50, the max of `grip`: the tyres are then practically linear */
  const tse_setting friction = c->grip > 0
      ? c->grip
      : (c->tyre_saturation_inverse_friction > TSE_S(0.02) ? r_div(one, c->tyre_saturation_inverse_friction)
                                                           : TSE_S(50));
  const tse_setting rolling = c->rolling_resistance_coefficient > 0 ? c->rolling_resistance_coefficient
                                                                    : DEFAULT_ROLLING;
  car->load_front = real_of(load_front);
  car->load_rear = real_of(load_rear);
  car->end_front = real_of(r_div(load_front, one + balance));
  car->end_rear = real_of(r_div(load_rear, one - balance));
  car->grip = real_of(friction);
  car->along_front = real_of(
      r_mul(c->longitudinal_load_transfer_gain, one + c->longitudinal_load_transfer_balance));
  car->along_rear = real_of(
      r_mul(c->longitudinal_load_transfer_gain, one - c->longitudinal_load_transfer_balance));
  car->side_front = real_of(r_mul(c->lateral_load_transfer_gain, one + c->lateral_load_transfer_balance));
  car->side_rear = real_of(r_mul(c->lateral_load_transfer_gain, one - c->lateral_load_transfer_balance));
  car->height_front = real_of(r_div(c->cg_height, r_mul(STANDARD_GRAVITY, c->lr)));
  car->height_rear = real_of(r_div(c->cg_height, r_mul(STANDARD_GRAVITY, c->lf)));
  car->relaxation = real_of(c->relaxation_length > MIN_RELAXATION ? c->relaxation_length : MIN_RELAXATION);
  car->free_front = real_of(r_div(r_mul(r_mul(rolling, STANDARD_GRAVITY), r_mul(c->mass, r_div(c->lr, span))),
      c->longitudinal_stiffness_front));
  car->free_rear = real_of(r_div(r_mul(r_mul(rolling, STANDARD_GRAVITY), r_mul(c->mass, r_div(c->lf, span))),
      c->longitudinal_stiffness_rear));
  car->driven = c->driven_axle;
}

/* Compute inertia, drag, steering and body roll. */
static void prepare_body(const tse_config *c, tse_params *p)
{
  tse_car *const car = &p->car;
  const tse_setting one = TSE_S(1), over = r_div(one, c->mass), yaw = r_div(one, c->yaw_inertia);
  const int rolls = c->body_roll_gain != 0;
  car->m_inertia = real_of(r_mul(c->mass, yaw));
  car->trail = real_of(r_mul(r_mul(c->mass, yaw), c->aligning_moment_trail));
  car->drag = real_of(r_mul(c->aero_drag_coefficient, over));
  car->rolling = real_of(r_mul(STANDARD_GRAVITY, c->rolling_resistance_coefficient));
  car->pull_front = real_of(r_mul(c->conicity_front, over));
  car->pull_rear = real_of(r_mul(c->conicity_rear, over));
  car->compliance = real_of(
      r_mul(r_mul(c->steering_compliance_angle_per_moment, c->steering_compliance_trail), c->mass));
  car->roll_gain = real_of(rolls ? c->body_roll_gain : c->rear_roll_steer_roll);
  car->roll_omega = real_of(
      r_mul(TSE_S(6.2831853071795865), rolls ? c->body_roll_frequency : c->rear_roll_steer_frequency));
  car->roll_damping = real_of(rolls ? c->body_roll_damping : c->rear_roll_steer_damping);
  car->roll_leak = real_of(rolls ? STANDARD_GRAVITY : 0);
  car->roll_height = real_of(rolls ? c->body_roll_height : 0);
  car->roll_coupling = real_of(rolls ? c->body_roll_coupling : 0);
  p->steer_lag = real_of(r_div(c->steering_lag_time, one + c->steering_lag_second));
  p->steer_lag_second = r_mul(p->steer_lag, real_of(c->steering_lag_second));
}

/* Compute the effect of body pitch on accel_x, the mounting angle and scale factors of
 * the IMU, and the noise sds of all sensors. */
static void prepare_readings(const tse_config *c, tse_params *p)
{
  tse_car *const car = &p->car;
  const tse_setting one = TSE_S(1), wheel = r_mul(c->wheel_noise_sd, c->wheel_radius_front),
                    speed_sd = wheel > MIN_WHEEL_SD ? wheel : MIN_WHEEL_SD;
  car->pitch_leak = real_of(r_mul(STANDARD_GRAVITY, c->pitch_leak_gain));
  car->pitch_height = real_of(r_mul(c->pitch_leak_gain, c->pitch_leak_height));
  sin_cos(real_of(c->imu_misalignment_angle), &car->mount_sin, &car->mount_cos);
  car->scale_x = real_of(one + c->imu_scale_ax_error);
  car->scale_y = real_of(one + c->imu_scale_ay_error);
  car->scale_r = real_of(one + c->gyro_scale_error);
  for (int i = 0; i < TSE_SENSORS; i++) p->sensor_sd[i] = i < IMU_CHANNELS ? p->sd[i] : real_of(speed_sd);
}

/* Compute means and sds of the initial state from the settings. Means and sds that are
 * equal to a setting have already been copied by prepare_copies(). */
static void prepare_prior(const tse_config *c, tse_params *p)
{
  const tse_setting initial[3] = { c->initial_cx_front, c->initial_cy_front, c->initial_cy_rear };
  p->prior_sd[GX] = real_of(r_mul(STANDARD_GRAVITY, c->grade_sd));
  p->prior_sd[GY] = BANK_SD;
  p->road_sd = real_of(r_mul(STANDARD_GRAVITY, c->road_sd));
  p->prior_sd[RAD] = r_max(p->prior_sd[RAD], MIN_RADIUS_SD);
  for (int i = 0; i < 3; i++) {
    p->prior[stiffness_at(i)] = logarithm(real_of(initial[i]));
    p->mu0[i] = real_of(initial[i] - TSE_S(1));
  }
  p->prior[LATE] = real_of(c->steering_delay_time + c->imu_delay_time);
#if defined(TSE_SMALL)
  p->uncertain[CONSIDER_LATE] = p->prior_sd[LATE];
#endif
  p->prior[GX] = gravity_along(real_of(c->grade_angle));
  p->prior[GY] = -gravity_along(real_of(c->bank_angle));
  p->log_min = logarithm(real_of(c->stiffness_min));
  p->log_max = logarithm(real_of(c->stiffness_max));
}

/* Compute the car model and the prior of the default filter, the Kalman filter.
 *   Given:    c  settings, changed by the effects of hook CONSTANT
 *                (apply_constant_effects())
 *   Updated:  p  already has nominal stiffness and geometry */
static void prepare_car(const tse_config *c, tse_params *p)
{
  prepare_tyres(c, p);
  prepare_body(c, p);
  prepare_readings(c, p);
  prepare_prior(c, p);
}

/* Compute the ratios stiffness/mass and (mass times distance of the axle)/(yaw inertia),
 * and the relative variance of the mass. */
static void prepare_vehicle(const tse_config *c, tse_params *p)
{
  tse_car *const car = &p->car;
  car->kx_front = real_of(r_div(c->longitudinal_stiffness_front, c->mass));
  car->kx_rear = real_of(r_div(c->longitudinal_stiffness_rear, c->mass));
  car->ky_front = real_of(r_div(c->cornering_stiffness_front, c->mass));
  car->ky_rear = real_of(r_div(c->cornering_stiffness_rear, c->mass));
  car->jf = real_of(r_div(r_mul(c->mass, c->lf), c->yaw_inertia));
  car->jr = real_of(r_div(r_mul(c->mass, c->lr), c->yaw_inertia));
  p->mass_var = real_of(compute_square(c->mass_sd));
}

/* Compute the constants of each IMU channel in sigma, the noise sd of the channel:
 * variance of the initial bias [sigma^2] and its growth rate [sigma^2/s]. Also compute
 * 1/sd and log2(sd) of the noise.
 *   Updated:  p  already has the sds of noise, bias and bias walk, in SI units */
static void prepare_imu(tse_params *p)
{
  for (int i = 0; i < 3; i++) {
    p->inv_sd[i] = r_div(TSE_R(1), p->sd[i]);
    p->bias_var0[i] = r_sqr(r_div(p->prior_sd[bias_at(i)], p->sd[i]));
    p->bias_walk[i] = r_sqr(r_div(p->bias_sd_walk[i], p->sd[i]));
    p->log_sd[i] = r_log2(p->sd[i]);
  }
}

/* Compute 1/sample_time and the squares of the settings noise_max and valid_sd. Also
 * compute three numbers from which the particle filter (form 1) chooses its integration
 * step in each row (vehicle_steps()): the longest step, the shortest step, and
 * p->damping, which is 4 times speed times the fastest rate at which the tyres damp the
 * motion. */
static void prepare_rows(const tse_config *c, tse_params *p)
{
  p->inv_sample_time = real_of(r_div(TSE_S(1), c->sample_time));
  p->max_step = real_of(r_mul(c->sample_time, TSE_S(1.5)));
  /* damping rates of v_x (due to the longitudinal stiffness), of v_y and of the yaw
   * rate (both due to the cornering stiffness), each times speed. The damping rates
   * are proportional to 1/speed, so that these products are constants of the car */
  const tse_setting cy_f = c->cornering_stiffness_front, cy_r = c->cornering_stiffness_rear;
  tse_setting damping = r_div(c->longitudinal_stiffness_front + c->longitudinal_stiffness_rear, c->mass);
  const tse_setting lateral = r_div(cy_f + cy_r, c->mass);
  const tse_setting yaw = r_div(
      r_mul(compute_square(c->lf), cy_f) + r_mul(compute_square(c->lr), cy_r), c->yaw_inertia);
  damping = lateral > damping ? lateral : damping;
  damping = yaw > damping ? yaw : damping;
  p->damping = real_of(r_mul(TSE_S(4), damping));
  p->least_step = r_max(
      real_of(r_div(c->hold_speed, r_mul(TSE_S(4), damping))), r_mul(TSE_R(0.125), p->max_step));
  p->noise_max_var = real_of(compute_square(c->noise_max));
  p->valid_var = real_of(compute_square(c->valid_sd));
}

/* Compute the constants with which the particle filter (form 1) estimates the stiffness:
 * prior, forgetting factors, min and max stiffness. For both filters compute learnt_floor
 * and learnt_walk, which determine the variance of a stiffness that is loaded from a
 * learnt state. */
static void prepare_statistics(const tse_config *c, tse_params *p)
{
  const tse_setting one = TSE_S(1), spread_var = compute_square(c->initial_spread);
  p->log2_forgetting = r_log2(real_of(c->forgetting));
  p->forgetting_mean = real_of(c->forgetting_mean > TSE_S(0.5) ? c->forgetting_mean : c->forgetting);
  p->log2_forgetting_mean = r_log2(p->forgetting_mean);
  p->memory = real_of(r_div(one, one - c->forgetting));
  p->resample_at = real_of(r_mul(c->resample_threshold, r_from_int(c->particles)));
  /* the setting initial_spread gives the sd of the stiffness from sample to sample. In
   * symbols of the paper its square is Sigma = Lambda/(nu - d_w - 1), and the variance
   * of the mean stiffness is gamma Sigma; d_w = 3 is the number of stiffnesses. lam0
   * is Lambda/nu, gamma0 is gamma */
  p->lam0 = real_of(r_div(r_mul(spread_var, c->initial_dof - TSE_S(4)), c->initial_dof));
  p->gamma0 = real_of(r_div(compute_square(c->initial_mean_sd), spread_var));
  p->mean_var0 = real_of(compute_square(c->initial_mean_sd));
  p->spread_var = real_of(spread_var);
  p->spread_max_var = c->spread_max < TSE_S(2) ? real_of(compute_square(c->spread_max)) : MAX_SPREAD_VAR;
  p->kernel = real_of(r_mul(c->spread_kernel, TSE_S(1.4426950408889634)));
  p->learnt_floor = real_of(compute_square(c->learnt_floor));
  p->learnt_walk = real_of(compute_square(c->learnt_walk_day));
  p->w_min = real_of(c->stiffness_min - one);
  p->w_max = real_of(c->stiffness_max - one);
  /* lower limit of a drawn w = stiffness/nominal - 1. Without reflect_draws it only
   * prevents very large magnitudes: as in the paper, a stiffness may then be negative */
  p->w_low = c->reflect_draws ? p->w_min : r_min(-p->w_max, p->w_min);
  p->steady_walk = real_of(compute_square(c->steady_walk));
}

/* Compute all constants of a filter. The order of the calls matters: some functions use
 * constants that an earlier function has computed.
 *   Given:  settings  checked by tse_config_check() */
static void make_params(const tse_config *settings, tse_params *p)
{
  const uint64_t mask = find_active_effects(settings);
  tse_config car = *settings;
  memset(p, 0, sizeof *p);
  p->magic = TSE_PARAMS_MAGIC;
  tse_config_complete(&car);
  p->fingerprint = compute_fingerprint(&car);
  p->vehicle = compute_vehicle_fingerprint(&car);
  apply_constant_effects(mask, &car);
  p->particles = settings->particles;
  p->resampling = settings->resampling;
  p->form = settings->form;
  p->wheel_signals = settings->wheel_signals;
  p->vel_x_from_wheels = settings->initial_vel_x_from_wheels;
  p->integration = settings->integration;
  p->seed[0] = (uint32_t)settings->seed;
  p->seed[1] = 0x7473650au; /* not 0: the key of the random generator is never all zeros */
  prepare_copies(&car, p);
  prepare_vehicle(&car, p);
  prepare_imu(p);
  prepare_rows(&car, p);
  prepare_statistics(&car, p);
  prepare_latencies(&car, p);
  prepare_effects(&car, mask, p);
  prepare_car(&car, p);
}

tse_status tse_prepare(const tse_config *settings, tse_params *p, const char **wrong)
{
  const tse_status status = tse_config_check(settings, wrong);
  if (status < 0) return status;
  if (!p) return TSE_E_NULL;
#if defined(TSE_REAL_FIXED)
  tse_params made;
  make_params(settings, &made);
  const tse_status fit = check_range(&made, settings, wrong);
  if (fit < 0) return fit; /* p is unchanged */
  *p = made;
#else
  make_params(settings, p);
#endif
  return TSE_OK;
}
