/* host/learnt.c - save, check, load and age the learnt state. Layout of its bytes:
 * tse/learnt.h. */
#include "filter/slip_stiffness.h"
#include "filter/units.h"
#include "tse/learnt.h"

#define MAGIC 0x6c657374u                 /* "tsel" as a little-endian word */
#define FRAME 12                          /* [bytes] size of magic, format, size and CRC, in all formats */
#define MIN_SAVED_SPREAD TSE_R(0.01)      /* [1] lower limit of a loaded process sd of a stiffness, relative
                                           * to nominal: the min of the setting initial_spread */
#define MAX_SAVED_CORRELATION TSE_R(0.95) /* [1] max saved correlation: the covariance stays invertible */
#define DAY 86400u                        /* [s] */
#define PLACES_KEPT 11                    /* number of means in a file: 3 biases, 3 stiffnesses, grip,
                                           * 3 quantities of the steering, wheel radius */
#define PAIRS (PLACES_KEPT * (PLACES_KEPT - 1) / 2)
#define ONE_14 16384                      /* the number 1 in units of 2^-14 */
#define ONE_24 16777216                   /* the number 1 in units of 2^-24 */
#define MAX_NU 1000000u                   /* [1] max saved degrees of freedom nu: about the number of samples
                                           * from which the process sd of a stiffness was estimated */

/* Content of a file of format 3 (tse/learnt.h), without its frame, in the units of the
 * file. */
typedef struct content {
  uint32_t vehicle, known, nu;
  int32_t mean[PLACES_KEPT], sd[PLACES_KEPT], pair[PAIRS], noise[TSE_SENSORS], spread[3], correlation[3];
} content;

#if !defined(TSE_NO_PARTICLES)
/* Indices of the diagonal in an upper triangle that is stored by rows: 11 12 13 22 23
 * 33. */
static const int diagonal[3] = { 0, 3, 5 };
/* Indices of the off-diagonal elements in this triangle; pair[n] has the row and the
 * column of off_diagonal[n]. */
static const int off_diagonal[3] = { 1, 2, 4 };
static const int pair[3][2] = { { 0, 1 }, { 0, 2 }, { 1, 2 } };
#endif

/* Indices of the first bias and of the first stiffness among the means of a file. */
enum {
  K_BIAS = 0,
  K_STIFFNESS = 3,
};

/* Return the index of state FAST + i among the means of a file. FAST is the index of the
 * first slow state. */
#if defined(TSE_SMALL)
/* A file has four means that this build has no states for. The bias of accel_x (index 0)
 * and cx_front (index 3) each move the states after them up by 1. The latency of the
 * steering and the wheel radius come last and move no state. */
static int get_place(int i) { return i + (FAST + i < LCF ? 1 : 2); }
#else
static int get_place(int i) { return i; }
#endif
/* Return the index of the correlation of states FAST + i and FAST + j, i < j, among the
 * correlations of a file (content.pair). */
static int get_pair_index(int i, int j)
{
  const int low = get_place(i), high = get_place(j);
  return low * (2 * PLACES_KEPT - low - 1) / 2 + high - low - 1;
}

/* ----------------------------------------------------- write and read bytes of a file */

/* Compute the CRC-32 of IEEE 802.3, bit by bit. A table would be faster, but needs
 * memory, and only one file is read or written per drive. */
uint32_t crc32_of(const uint8_t *bytes, size_t count)
{
  uint32_t crc = 0xffffffffu;
  for (size_t i = 0; i < count; i++) {
    crc ^= bytes[i];
    for (int k = 0; k < 8; k++) crc = (crc >> 1) ^ (0xedb88320u & (0u - (crc & 1u)));
  }
  return ~crc;
}

/* Write a word of 32 bits, little-endian. Returned: the address after the word */
static uint8_t *put(uint8_t *at, uint32_t word)
{
  for (int i = 0; i < 4; i++) at[i] = (uint8_t)(word >> (8 * i) & 0xffu);
  return at + 4;
}

/* Write n numbers of 32 bits. Returned: the address after the numbers */
static uint8_t *put_all(uint8_t *at, const int32_t *x, int n)
{
  for (int a = 0; a < n; a++) at = put(at, (uint32_t)x[a]);
  return at;
}

/* Return the little-endian word of 32 bits at the address `at`. */
static uint32_t get(const uint8_t *at)
{
  return (uint32_t)at[0] | (uint32_t)at[1] << 8 | (uint32_t)at[2] << 16 | (uint32_t)at[3] << 24;
}

/* Convert a word in two's complement to a signed number. */
static int32_t to_signed(uint32_t word)
{
  return word <= (uint32_t)INT32_MAX ? (int32_t)word : -(int32_t)(UINT32_MAX - word) - 1;
}

/* Read n signed numbers of 32 bits into x. Returned: the address after the numbers */
static const uint8_t *get_all(const uint8_t *at, int32_t *x, int n)
{
  for (int a = 0; a < n; a++, at += 4) x[a] = to_signed(get(at));
  return at;
}

/* Write a content as a file: add magic, format, size and CRC. */
static void encode(const content *c, uint8_t out[TSE_LEARNT_BYTES])
{
  uint8_t *at = put(out, MAGIC);
  at = put(at, TSE_LEARNT_FORMAT | (uint32_t)TSE_LEARNT_BYTES << 16);
  at = put(at, c->vehicle);
  at = put(at, c->known);
  at = put(at, c->nu);
  at = put_all(at, c->mean, PLACES_KEPT);
  at = put_all(at, c->sd, PLACES_KEPT);
  for (int i = 0; i < PAIRS; i++, at += 2) {
    at[0] = (uint8_t)((uint32_t)c->pair[i] & 0xffu);
    at[1] = (uint8_t)((uint32_t)c->pair[i] >> 8 & 0xffu);
  }
  at[0] = at[1] = 0;
  at = put_all(at + 2, c->noise, TSE_SENSORS);
  at = put_all(at, c->spread, 3);
  at = put_all(at, c->correlation, 3);
  (void)put(at, crc32_of(out, TSE_LEARNT_BYTES - 4));
}

/* Return whether the magnitude of x is at most `limit`. */
static int is_within(int32_t x, int32_t limit) { return x >= -limit && x <= limit; }

/* Return the max magnitude, in units of 2^-24, of the mean with index `place` in a file:
 * the max magnitude of the same state in the filter. */
static int32_t get_max_code(int place)
{
  for (int i = 0; i < TSE_KEPT; i++)
    if (get_place(i) == place) return r_to_q24(state_max[FAST + i]);
  return INT32_MAX; /* this build does not have the state */
}

/* Check all values against their ranges.
 *   Returned:  name of the first value out of range, or NULL */
static const char *find_wrong_value(const content *c)
{
  static const char *const of[PLACES_KEPT] = { "bias of accel_x", "bias of accel_y", "bias of yaw_rate",
    "mean of cx_front", "mean of cy_front", "mean of cy_rear", "mean of grip", "steering offset",
    "steering ratio", "latency of the steering", "wheel radius" };
  static const char *const of_sd[PLACES_KEPT] = { "sd of the bias of accel_x", "sd of the bias of accel_y",
    "sd of the bias of yaw_rate", "sd of cx_front", "sd of cy_front", "sd of cy_rear", "sd of grip",
    "sd of the steering offset", "sd of the steering ratio", "sd of the latency of the steering",
    "sd of the wheel radius" };
  if (c->known > 7) return "bits of the learnt stiffnesses";
  if (c->nu > MAX_NU) return "degrees of freedom of the process sd";
  for (int i = 0; i < PLACES_KEPT; i++) {
    if (!is_within(c->mean[i], get_max_code(i))) return of[i];
    if (c->sd[i] < 0) return of_sd[i];
  }
  for (int i = 0; i < PAIRS; i++)
    if (!is_within(c->pair[i], ONE_14)) return "a correlation";
  for (int i = 0; i < TSE_SENSORS; i++)
    if (c->noise[i] < 0) return "noise of a channel";
  for (int a = 0; a < 3; a++) {
    if (c->spread[a] < 0) return "process sd";
    if (!is_within(c->correlation[a], ONE_24)) return "a correlation";
  }
  return NULL;
}

/* Return the given status. If wrong is not NULL, set *wrong to `what`, the name of the
 * part of the file that is wrong. */
static tse_status refuse(tse_status status, const char *what, const char **wrong)
{
  if (wrong) *wrong = what;
  return status;
}

/* Read and check a file. Return TSE_OK, or a negative status.
 *   Given:     vehicle  fingerprint of the vehicle settings; the file must contain the
 *                       same fingerprint
 *   Returned:  *c       content of the file
 *              *wrong   name of the wrong part, if the status is negative */
static tse_status decode(const uint8_t *in, size_t bytes, uint32_t vehicle, content *c, const char **wrong)
{
  if (bytes < FRAME || get(in) != MAGIC) return refuse(TSE_E_LEARNT, "its mark", wrong);
  if (get(in + 4) >> 16 != bytes) return refuse(TSE_E_LEARNT, "its length", wrong);
  if (get(in + bytes - 4) != crc32_of(in, bytes - 4)) return refuse(TSE_E_LEARNT, "its checksum", wrong);
  const uint32_t format = get(in + 4) & 0xffffu;
  if (format > TSE_LEARNT_FORMAT) return refuse(TSE_E_VERSION, "its format", wrong);
  if (format >= 1 && format < TSE_LEARNT_FORMAT) return refuse(TSE_E_OLD, "its format", wrong);
  if (format != TSE_LEARNT_FORMAT || bytes != TSE_LEARNT_BYTES)
    return refuse(TSE_E_LEARNT, "its format", wrong);
  c->vehicle = get(in + 8);
  c->known = get(in + 12);
  c->nu = get(in + 16);
  const uint8_t *at = get_all(in + 20, c->mean, PLACES_KEPT);
  at = get_all(at, c->sd, PLACES_KEPT);
  for (int i = 0; i < PAIRS; i++, at += 2) {
    const int32_t word = (int32_t)at[0] | (int32_t)at[1] << 8;
    c->pair[i] = word < 32768 ? word : word - 65536;
  }
  at = get_all(at + 2, c->noise, TSE_SENSORS);
  at = get_all(at, c->spread, 3);
  (void)get_all(at, c->correlation, 3);
  if (c->vehicle != vehicle) return refuse(TSE_E_VEHICLE, "its vehicle", wrong);
  const char *const what = find_wrong_value(c);
  return what ? refuse(TSE_E_LEARNT, what, wrong) : TSE_OK;
}

tse_status tse_learnt_check(const tse_params *p, const uint8_t *in, size_t bytes, const char **wrong)
{
  content c;
  if (!p || !in) return TSE_E_NULL;
  return p->magic == TSE_PARAMS_MAGIC ? decode(in, bytes, p->vehicle, &c, wrong) : TSE_E_STATE;
}

/* ------------------------------------------------------------------------------ save */

/* Limit x to -limit .. limit. */
static int32_t clamp_code(int32_t x, int32_t limit) { return x < -limit ? -limit : (x > limit ? limit : x); }

/* Set the content to means, sds, correlations and noise of the default filter.
 *   Returned:  1; 0 if one of them is NaN */
static int write_kalman(const tse_params *p, const tse_filter *f, content *c)
{
  const tse_kalman *const k = &f->k;
  tse_real sd[TSE_KEPT], share = TSE_R(1), itself;
  for (int i = 0; i < TSE_KEPT; i++) {
    tse_real var = ud_variance(&k->ud, FAST + i), mean = k->x[FAST + i];
    for (int q = 0; q < TSE_CONSIDERED; q++)
      var += r_mul_short(k->consider[q][FAST + i], k->consider[q][FAST + i]);
    const int place = get_place(i);
    if (HAS_SLIP && place == K_STIFFNESS) { /* LCX includes a model error: remove it */
      share = along_share(p, k, var, &itself);
      var = r_div(itself, r_sqr(state_unit[LCX]));
      mean = k->along.mean + r_mul(share, mean - k->along.mean);
    }
    sd[i] = r_sqrt(var);
    c->sd[place] = r_to_q24(r_mul(sd[i], state_unit[FAST + i]));
    const int32_t code = r_to_q24(mean);
    if (code == INT32_MIN || c->sd[place] < 0) return 0;
    c->mean[place] = clamp_code(code, get_max_code(place));
  }
  for (int i = 0; i < TSE_KEPT; i++)
    for (int j = i + 1; j < TSE_KEPT; j++) {
      tse_real both = ud_covariance(&k->ud, FAST + i, FAST + j);
      for (int q = 0; q < TSE_CONSIDERED; q++)
        both += r_mul_short(k->consider[q][FAST + i], k->consider[q][FAST + j]);
      if (HAS_SLIP && (i == K_STIFFNESS || j == K_STIFFNESS)) both = r_mul(share, both);
      const tse_real scale = r_mul(sd[i], sd[j]), r = scale > TSE_R(0) ? r_div(both, scale) : TSE_R(0);
      c->pair[get_pair_index(i, j)] = r_floor_to_int(
          r_mul(r_clamp(r, -MAX_SAVED_CORRELATION, MAX_SAVED_CORRELATION), TSE_R(ONE_14)) + TSE_R(0.5));
    }
  for (int i = 0; i < TSE_SENSORS; i++) {
    c->noise[i] = r_to_q24(r_sqrt(k->noise[i]));
    if (c->noise[i] < 0) return 0;
  }
  return 1;
}

#if !defined(TSE_NO_PARTICLES)
/* Set the content to stiffness, process sd and biases of the particles.
 *   Returned:  1; 0 if one of them is NaN */
static int write_particles(const tse_params *p, const tse_filter *f, content *c)
{
  tse_output now;
  tse_real lam[6], nu = p->nu0;
  memset(&now, 0, sizeof now);
  report_particles(p, f, &now, lam, &nu);
  c->nu = (uint32_t)r_floor_to_int(nu + TSE_R(0.5));
  for (int a = 0; a < 3; a++) {
    const tse_real mean = r_max(now.stiffness[a], TSE_R(0.02)), var = r_sqr(r_div(now.stiffness_sd[a], mean));
    const tse_real scale = r_mul(r_sqrt(lam[diagonal[pair[a][0]]]), r_sqrt(lam[diagonal[pair[a][1]]]));
    const int32_t log = r_to_q24(logarithm(mean)), bias = r_to_q24(now.bias[a]);
    if (bias == INT32_MIN) return 0; /* NaN */
    c->mean[K_STIFFNESS + a] = clamp_code(log, get_max_code(K_STIFFNESS + a));
    c->sd[K_STIFFNESS + a] = r_to_q24(
        r_sqrt(f->known[a] == TSE_KNOWN_BEFORE ? r_max(var, r_div(f->start.mean_var[a], r_sqr(mean))) : var));
    c->mean[K_BIAS + a] = clamp_code(bias, get_max_code(K_BIAS + a));
    c->sd[K_BIAS + a] = r_to_q24(now.bias_sd[a]);
    c->spread[a] = r_to_q24(now.stiffness_spread[a]);
    c->correlation[a] = clamp_code(
        scale > TSE_R(0) ? r_to_q24(r_div(lam[off_diagonal[a]], scale)) : 0, ONE_24);
    if (c->sd[K_STIFFNESS + a] < 0 || c->sd[K_BIAS + a] < 0 || c->spread[a] < 0) return 0; /* NaN */
  }
  return 1;
}
#endif

tse_status tse_learnt_save(const tse_params *p, const tse_filter *f, uint8_t out[TSE_LEARNT_BYTES])
{
  if (!p || !f || !out) return TSE_E_NULL;
  if (!params_match(p, f) || !f->started) return TSE_E_STATE;
  content c;
  memset(&c, 0, sizeof c);
  c.vehicle = p->vehicle;
  for (int a = 0; a < 3; a++)
    if (f->known[a]) c.known |= 1u << a;
#if !defined(TSE_NO_PARTICLES)
  const int fine = p->form == 0 ? write_kalman(p, f, &c) : write_particles(p, f, &c);
#else
  const int fine = write_kalman(p, f, &c);
#endif
  if (!fine) return TSE_E_STATE;
  encode(&c, out);
  return TSE_OK;
}

/* ------------------------------------------------------------------------------ load */

/* Return rate times n. A large n does not fit a fixed-point number. n is therefore split
 * into digits to the base 1024, and rate times digit times power of 1024 is added for
 * each digit. */
static tse_real compute_growth(tse_real rate, uint32_t n)
{
  tse_real sum = TSE_R(0);
  for (; n > 0; n >>= 10) {
    sum = r_add_sat(sum, r_mul(rate, r_from_int((int32_t)(n & 1023u))));
    rate = r_mul(rate, TSE_R(1024));
  }
  return sum;
}

/* Return the variance of the mean of a stiffness, age_s seconds after it was saved.
 *   Given:  sd       sd when it was saved: of ln(stiffness) in the default filter, of
 *                    stiffness/nominal in the particle filter
 *           max_var  upper limit of the result: variance of the prior in the settings */
static tse_real aged(const tse_params *p, tse_real sd, uint32_t age_s, tse_real max_var)
{
  const tse_real minutes = r_from_int((int32_t)(age_s % DAY / 60u));
  const tse_real grow = r_add_sat(
      compute_growth(p->learnt_walk, age_s / DAY), r_mul(p->learnt_walk, r_div(minutes, TSE_R(1440))));
  return r_min(r_add_sat(r_max(r_mul(sd, sd), p->learnt_floor), grow), max_var);
}

/* Age an estimated bias by age_s seconds. A bias is a stationary process whose mean is 0
 * and whose variance is set by the settings. The variance of the estimate grows up to
 * this stationary variance. Meanwhile the estimate decays to 0.
 *   Given:    walk        variance of the random walk of the bias in 1 s
 *             stationary  variance in the settings
 *   Updated:  mean, var   estimate and its variance */
static void age_bias(tse_real *mean, tse_real *var, tse_real walk, tse_real stationary, uint32_t age_s)
{
  if (!(*var < stationary)) {
    *mean = TSE_R(0);
    *var = stationary;
    return;
  }
  const tse_real now = r_min(r_add_sat(*var, compute_growth(walk, age_s)), stationary),
                 kept = r_sqrt(r_div(stationary - now, stationary - *var));
  *mean = r_mul(kept, *mean);
  *var = now;
}

/* Set the prior of the default filter to the saved means, covariances and noise, with
 * aged variances. */
static void load_kalman(const tse_params *p, const content *c, uint32_t age_s, tse_start *s)
{
  tse_real was[TSE_KEPT];
  for (int i = 0; i < TSE_KEPT; i++) {
    const int at = FAST + i, place = get_place(i), stiff = place >= K_STIFFNESS && place < K_STIFFNESS + 3;
    const tse_real prior = p->prior_sd[at], sd = r_from_q24(c->sd[place]);
    tse_real mean = r_from_q24(c->mean[place]), var = r_sqr(sd);
    const int known = c->sd[place] > 0 && (!stiff || (c->known >> (place - K_STIFFNESS) & 1u));
    if (!known) {
      mean = p->prior[at];
      var = r_sqr(prior);
    } else if (stiff) var = aged(p, sd, age_s, r_sqr(prior));
    else if (at <= BR) age_bias(&mean, &var, r_sqr(p->bias_sd_walk[place]), r_sqr(prior), age_s);
    else var = r_min(r_max(var, r_sqr(r_mul(TSE_R(0.1), prior))), r_sqr(prior));
    s->kept[i] = mean;
    was[i] = known ? r_div(r_min(sd, r_sqrt(var)), state_unit[at]) : TSE_R(0);
    s->kept_cov[i][i] = r_sqr(r_div(known ? r_sqrt(var) : prior, state_unit[at]));
  }
  for (int i = 0; i < TSE_KEPT; i++)
    for (int j = i + 1; j < TSE_KEPT; j++) {
      const tse_real r = r_div(r_from_int(c->pair[get_pair_index(i, j)]), TSE_R(ONE_14));
      s->kept_cov[i][j] = s->kept_cov[j][i] = r_mul(r, r_mul(was[i], was[j]));
    }
  for (int i = 0; i < TSE_SENSORS; i++)
    s->noise[i] = c->noise[i] > 0 ? r_clamp(r_sqr(r_from_q24(c->noise[i])), MIN_NOISE, p->noise_max_var)
                                  : TSE_R(1);
}

#if !defined(TSE_NO_PARTICLES)
/* Set the prior of the particle filter to the saved state, aged by age_s seconds.
 *
 * In this filter the stiffnesses are white noise. The filter estimates their mean and
 * their covariance Sigma. In each particle the variance of the estimated mean is gamma
 * Sigma, with the same factor gamma for all three stiffnesses. For some stiffnesses
 * gamma Sigma is smaller than the aged variance of the saved mean. The means of the
 * particles are then drawn at random. The variance of the draw, mu_sd^2, is the aged
 * variance minus gamma Sigma.
 *
 * The road may have changed since the state was saved. Two measures let the particles
 * follow the change: the aged variance of each mean is also added to Sigma, and this
 * Sigma has only the weight of initial_dof samples. In 8 drives that start on a road with
 * 60 % of the learnt stiffness, after 10 .. 20 s the rms errors of the stiffnesses (front
 * longitudinal, front cornering, rear cornering) are 3.3, 4.0, 7.7 % with both measures,
 * and 5.2, 5.2, 10.9 % without them. */
static void load_particles(const tse_params *p, const content *c, uint32_t age_s, tse_start *s)
{
  tse_real spread[3], var[3];
  for (int a = 0; a < 3; a++) {
    const int known = (c->known >> a & 1u) != 0;
    const tse_real max_spread = r_sqrt(p->spread_max_var),
                   level = exponential(r_from_q24(c->mean[K_STIFFNESS + a]));
    spread[a] = known && c->spread[a] > 0
        ? r_min(r_max(r_from_q24(c->spread[a]), MIN_SAVED_SPREAD), max_spread)
        : r_sqrt(p->spread_var);
    var[a] = r_sqr(spread[a]);
    if (known) {
      s->mu[a] = r_clamp(level - TSE_R(1), p->w_min, p->w_max);
      s->mean_var[a] = aged(p, r_mul(level, r_from_q24(c->sd[K_STIFFNESS + a])), age_s, p->mean_var0);
      var[a] = r_min(var[a] + s->mean_var[a], p->spread_max_var);
    }
    tse_real mean = r_from_q24(c->mean[K_BIAS + a]),
             bias_var = r_sqr(r_mul(p->inv_sd[a], r_from_q24(c->sd[K_BIAS + a])));
    mean = r_mul(p->inv_sd[a], mean);
    if (c->sd[K_BIAS + a] == 0 || !(bias_var < p->bias_var0[a]))
      continue; /* the saved value is not more accurate than the setting */
    age_bias(&mean, &bias_var, p->bias_walk[a], p->bias_var0[a], age_s);
    s->bias[a] = mean;
    s->bias_var[a] = bias_var;
  }
  if (c->known == 0) return; /* no stiffness has been learnt: keep the prior of the settings, bit for bit */
  const tse_real per_nu = r_div(s->nu - TSE_R(4), s->nu); /* lam = Lambda/nu, Sigma = Lambda/(nu - 4) */
  for (int a = 0; a < 3; a++) {
    const int i = pair[a][0], j = pair[a][1], both = (c->known >> i & c->known >> j & 1u) != 0;
    const tse_real r = r_clamp(r_from_q24(c->correlation[a]), -MAX_SAVED_CORRELATION, MAX_SAVED_CORRELATION);
    s->lam[diagonal[a]] = r_mul(per_nu, var[a]);
    s->lam[off_diagonal[a]] = both ? r_mul(per_nu, r_mul(r, r_mul(spread[i], spread[j]))) : TSE_R(0);
  }
  s->gamma = r_div(s->mean_var[0], var[0]);
  for (int a = 1; a < 3; a++) s->gamma = r_min(s->gamma, r_div(s->mean_var[a], var[a]));
  for (int a = 0; a < 3; a++) s->mu_sd[a] = r_sqrt(r_max(s->mean_var[a] - r_mul(s->gamma, var[a]), TSE_R(0)));
}
#endif

tse_status tse_learnt_load(
    const tse_params *p, tse_filter *f, const uint8_t *in, size_t bytes, uint32_t age_s)
{
  if (!p || !f || !in) return TSE_E_NULL;
  if (!params_match(p, f) || f->step > 0 || f->waiting.count > 0) return TSE_E_STATE;
  content c;
  const tse_status refused = decode(in, bytes, p->vehicle, &c, NULL);
  if (refused < 0) return refused; /* nothing has changed yet */
  start_of_settings(p, &f->start);
  f->start.loaded = 1;
  load_kalman(p, &c, age_s, &f->start);
#if !defined(TSE_NO_PARTICLES)
  if (p->form != 0) load_particles(p, &c, age_s, &f->start);
#endif
  for (int a = HAS_SLIP || p->form != 0 ? 0 : 1; a < 3; a++)
    f->known[a] = (c.known >> a & 1u) != 0 ? TSE_KNOWN_BEFORE : TSE_UNKNOWN;
  return TSE_OK;
}
