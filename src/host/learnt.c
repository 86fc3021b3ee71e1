/* host/learnt.c - what a drive taught, as bytes for the next: written, checked, read, aged. Layout: tse/learnt.h. */
#include "tse/learnt.h"
#include "estimator/hypotheses/hypothesis.h"
#include "estimator/hypotheses/report.h"

#define MAGIC 0x6c657374u         /* "tsel", first byte first                       */
#define BYTES_OF_1 96
#define FRAME 12                  /* magic, format, bytes; CRC: what all formats share */
#define LEAST_SPREAD TSE_R(0.01)  /* as initial_spread's                            */
#define MOST_CORRELATION TSE_R(0.95)
#define DAY 86400u                /* s */

/* What is written is inside these bounds, and what is read is refused outside: the widest that settings (config.def) and sensors
 * (input.def) allow. In q24; sd and noise may be anything that is not negative. */
#define LEAST_MEAN (-16441672) /* 0.02 - 1: stiffness_min */
#define MOST_MEAN 318767104    /* 20 - 1: stiffness_max   */
#define MOST_ONE 16777216
#define MOST_NU 1000000u
static const int32_t most_bias[3] = { 50 * MOST_ONE, 50 * MOST_ONE, 6 * MOST_ONE };
#define LAST_LEVEL 3u

typedef struct content { /* of format 2, after the frame; q24 as in the file */
  uint32_t vehicle, known, nu;
  int32_t mean[3], mean_sd[3], spread[3], correlation[3], bias[3], bias_sd[3], noise[3];
  uint32_t of_car;       /* bits 0-1, 2-3, 4-5: levels; 6: steering is held */
} content;

static const int diagonal[3] = { 0, 3, 5 };                /* of a triangle by rows: 11 12 13 22 23 33 */
static const int off_diagonal[3] = { 1, 2, 4 };
static const int pair[3][2] = { { 0, 1 }, { 0, 2 }, { 1, 2 } };

/* ------------------------------------------------------------------------------------------ bytes */

/* CRC-32 of IEEE 802.3, bit by bit: 112 bytes a drive are not worth a table. */
uint32_t crc32_of(const uint8_t *bytes, size_t count)
{
  uint32_t crc = 0xffffffffu;
  for (size_t i = 0; i < count; i++) {
    crc ^= bytes[i];
    for (int k = 0; k < 8; k++) crc = (crc >> 1) ^ (0xedb88320u & (0u - (crc & 1u)));
  }
  return ~crc;
}

static uint8_t *put(uint8_t *at, uint32_t word)
{
  for (int i = 0; i < 4; i++) at[i] = (uint8_t)(word >> (8 * i) & 0xffu);
  return at + 4;
}

static uint8_t *put3(uint8_t *at, const int32_t x[3])
{
  for (int a = 0; a < 3; a++) at = put(at, (uint32_t)x[a]);
  return at;
}

static uint32_t get(const uint8_t *at)
{
  return (uint32_t)at[0] | (uint32_t)at[1] << 8 | (uint32_t)at[2] << 16 | (uint32_t)at[3] << 24;
}

static const uint8_t *get3(const uint8_t *at, int32_t x[3])
{
  for (int a = 0; a < 3; a++, at += 4) {
    const uint32_t word = get(at);
    x[a] = word <= (uint32_t)INT32_MAX ? (int32_t)word : -(int32_t)(UINT32_MAX - word) - 1;
  }
  return at;
}

static void encode(const content *c, uint8_t out[TSE_LEARNT_BYTES])
{
  uint8_t *at = put(out, MAGIC);
  at = put(at, TSE_LEARNT_FORMAT | (uint32_t)TSE_LEARNT_BYTES << 16);
  at = put(at, c->vehicle);
  at = put(at, c->known);
  at = put(at, c->nu);
  at = put3(at, c->mean);
  at = put3(at, c->mean_sd);
  at = put3(at, c->spread);
  at = put3(at, c->correlation);
  at = put3(at, c->bias);
  at = put3(at, c->bias_sd);
  at = put3(at, c->noise);
  at = put(at, c->of_car);
  (void)put(at, crc32_of(out, TSE_LEARNT_BYTES - 4));
}

static int none_negative(const int32_t x[3]) { return x[0] >= 0 && x[1] >= 0 && x[2] >= 0; }

static int within(int32_t x, int32_t lo, int32_t hi) { return x >= lo && x <= hi; }

/* Whoever wrote it: nothing but what a drive may have taught. */
static int plausible(const content *c)
{
  int fine = c->known <= 7 && c->nu <= MOST_NU && c->of_car >> 7 == 0;
  for (int a = 0; a < 3; a++)
    fine = fine && within(c->mean[a], LEAST_MEAN, MOST_MEAN) && within(c->correlation[a], -MOST_ONE, MOST_ONE) &&
           within(c->bias[a], -most_bias[a], most_bias[a]);
  return fine && none_negative(c->mean_sd) && none_negative(c->spread) && none_negative(c->bias_sd) && none_negative(c->noise);
}

static tse_status decode(const uint8_t *in, size_t bytes, uint32_t vehicle, content *c)
{
  if (bytes < FRAME || get(in) != MAGIC || get(in + 4) >> 16 != bytes) return TSE_E_LEARNT;
  if (get(in + bytes - 4) != crc32_of(in, bytes - 4)) return TSE_E_LEARNT;
  const uint32_t format = get(in + 4) & 0xffffu;
  if (format > TSE_LEARNT_FORMAT) return TSE_E_VERSION;
  if (format == 1 && bytes == BYTES_OF_1) return TSE_E_OLD;
  if (format != TSE_LEARNT_FORMAT || bytes != TSE_LEARNT_BYTES) return TSE_E_LEARNT;
  c->vehicle = get(in + 8);
  c->known = get(in + 12);
  c->nu = get(in + 16);
  const uint8_t *at = get3(in + 20, c->mean);
  at = get3(at, c->mean_sd);
  at = get3(at, c->spread);
  at = get3(at, c->correlation);
  at = get3(at, c->bias);
  at = get3(at, c->bias_sd);
  at = get3(at, c->noise);
  c->of_car = get(at);
  return c->vehicle != vehicle ? TSE_E_VEHICLE : plausible(c) ? TSE_OK : TSE_E_LEARNT;
}

/* ------------------------------------------------------------------------------------------- save */

static int belong(const tse_params *p, const tse_filter *f)
{
  return p->magic == TSE_PARAMS_MAGIC && f->magic == TSE_FILTER_MAGIC && f->fingerprint == p->fingerprint;
}

static int32_t between(int32_t x, int32_t lo, int32_t hi) { return x < lo ? lo : x > hi ? hi : x; }

/* What the likeliest hypothesis says of the car itself; particles know nothing of it. */
static void write_car(const tse_bank *b, content *c)
{
  const tse_hypothesis *const best = &b->h[b->likeliest];
  for (int a = 0; a < 3; a++) {
    c->noise[a] = r_to_q24(r_sqrt(best->noise_var[a]));
    c->of_car |= (uint32_t)best->level[a] << (2 * a);
  }
  c->of_car |= (uint32_t)best->held << 6;
}

tse_status tse_learnt_save(const tse_params *p, const tse_filter *f, uint8_t out[TSE_LEARNT_BYTES])
{
  if (!p || !f || !out) return TSE_E_NULL;
  if (!belong(p, f) || !f->started) return TSE_E_STATE;
  tse_output now;
  tse_real lam[6] = { TSE_R(1), TSE_R(0), TSE_R(0), TSE_R(1), TSE_R(0), TSE_R(1) }, nu = p->nu0;
  content c;
  memset(&now, 0, sizeof now);
  memset(&c, 0, sizeof c);
#if !defined(TSE_NO_PARTICLES)
  if (p->form != 0) report_particles(p, f, &now, lam, &nu);
#endif
  if (p->form == 0) bank_report(p, &f->bank, &now); /* it knows no correlation of spreads, and counts no samples */
  if (p->form == 0) write_car(&f->bank, &c);
  c.vehicle = p->vehicle;
  c.nu = (uint32_t)r_floor_to_int(nu + TSE_R(0.5));
  for (int a = 0; a < 3; a++) {
    const tse_real var = p->form == 0 ? bank_stiffness_var(p, &f->bank, a) : r_mul(now.stiffness_sd[a], now.stiffness_sd[a]);
    const tse_real sd = r_sqrt(f->known[a] == TSE_KNOWN_BEFORE ? r_max(var, f->start.mean_var[a]) : var);
    const int i = pair[a][0], j = pair[a][1];
    const tse_real scale = r_mul(r_sqrt(lam[diagonal[i]]), r_sqrt(lam[diagonal[j]]));
    if (f->known[a]) c.known |= 1u << a;
    const int32_t mean = r_to_q24(now.stiffness[a] - TSE_R(1)), bias = r_to_q24(now.bias[a]);
    const tse_real correlation = scale > TSE_R(0) ? r_div(lam[off_diagonal[a]], scale) : TSE_R(0);
    if (mean == INT32_MIN || bias == INT32_MIN) return TSE_E_STATE; /* not numbers */
    c.mean[a] = between(mean, LEAST_MEAN, MOST_MEAN); /* the paper's form knows no bounds */
    c.mean_sd[a] = r_to_q24(sd);
    c.spread[a] = r_to_q24(now.stiffness_spread[a]);
    c.correlation[a] = between(r_to_q24(correlation), -MOST_ONE, MOST_ONE);
    c.bias[a] = between(bias, -most_bias[a], most_bias[a]);
    c.bias_sd[a] = r_to_q24(now.bias_sd[a]);
  }
  if (!none_negative(c.mean_sd) || !none_negative(c.spread) || !none_negative(c.bias_sd) || !none_negative(c.noise))
    return TSE_E_STATE; /* not numbers */
  encode(&c, out);
  return TSE_OK;
}

/* ------------------------------------------------------------------------------------------- load */

/* rate times n in any format: digit by digit to the base of 1024, so that no factor leaves the range of q20. */
static tse_real grown(tse_real rate, uint32_t n)
{
  tse_real sum = TSE_R(0);
  for (; n > 0; n >>= 10) {
    sum = r_add_sat(sum, r_mul(rate, r_from_int((int32_t)(n & 1023u))));
    rate = r_mul(rate, TSE_R(1024));
  }
  return sum;
}

/* Variance of a mean after `age_s` seconds; `walk` is per day. */
static tse_real aged(const tse_params *p, tse_real sd, uint32_t age_s)
{
  const tse_real minutes = r_from_int((int32_t)(age_s % DAY / 60u));
  const tse_real grow = r_add_sat(grown(p->learnt_walk, age_s / DAY), r_mul(p->learnt_walk, r_div(minutes, TSE_R(1440))));
  return r_min(r_add_sat(r_max(r_mul(sd, sd), p->learnt_floor), grow), p->mean_var0);
}

/* The variance of the mean is mean_var. With particles it is gamma Sigma in each of them plus, where one gamma does not fit all
 * three, their scatter; and a spread that includes it, trusted no more than initial_spread is, lets them follow a road that has changed: 10 .. 20 s after the start on 60 %, 8 drives, rms errors
 * of 5.2, 5.2, 10.9 % become 3.3, 4.0, 7.7 %. */
static void load_stiffness(const tse_params *p, const content *c, uint32_t age_s, tse_start *s)
{
  tse_real spread[3], var[3];
  for (int a = 0; a < 3; a++) {
    const int known = (c->known >> a & 1u) != 0;
    const tse_real most = r_sqrt(p->spread_max_var);
    spread[a] = known ? r_min(r_max(r_from_q24(c->spread[a]), LEAST_SPREAD), most) : r_sqrt(p->spread_var);
    var[a] = r_mul(spread[a], spread[a]);
    if (!known) continue;
    s->mu[a] = r_clamp(r_from_q24(c->mean[a]), p->w_min, p->w_max);
    s->mean_var[a] = aged(p, r_from_q24(c->mean_sd[a]), age_s);
    if (p->form == 0) continue;
    const tse_real doubt = r_mul(TSE_R(1) + s->mu[a], doubt_by_levels(p, s->level, a)); /* which only hypotheses keep apart */
    s->mean_var[a] = r_min(r_add_sat(s->mean_var[a], r_mul(doubt, doubt)), p->mean_var0);
    var[a] = r_min(var[a] + s->mean_var[a], p->spread_max_var);
  }
  const tse_real per_nu = r_div(s->nu - TSE_R(4), s->nu); /* Sigma = lam nu/(nu - 4) */
  for (int a = 0; a < 3; a++) {
    const int i = pair[a][0], j = pair[a][1], both = (c->known >> i & c->known >> j & 1u) != 0;
    const tse_real r = r_clamp(r_from_q24(c->correlation[a]), -MOST_CORRELATION, MOST_CORRELATION);
    s->lam[diagonal[a]] = r_mul(per_nu, var[a]);
    s->lam[off_diagonal[a]] = both ? r_mul(per_nu, r_mul(r, r_mul(spread[i], spread[j]))) : TSE_R(0);
  }
  if (p->form == 0) return;
  s->gamma = r_div(s->mean_var[0], var[0]);
  for (int a = 1; a < 3; a++) s->gamma = r_min(s->gamma, r_div(s->mean_var[a], var[a]));
  for (int a = 0; a < 3; a++) s->mu_sd[a] = r_sqrt(r_max(s->mean_var[a] - r_mul(s->gamma, var[a]), TSE_R(0)));
}

/* Biases: a stationary process with the variance of the settings, that starts to forget at their walk. */
static void load_biases(const tse_params *p, const content *c, uint32_t age_s, tse_start *s)
{
  for (int a = 0; a < 3; a++) {
    const tse_real most = p->bias_var0[a], sd = r_mul(p->inv_sd[a], r_from_q24(c->bias_sd[a])), var = r_mul(sd, sd);
    if (!(var < most)) continue; /* knows no more than the settings do */
    s->bias_var[a] = r_min(r_add_sat(var, grown(p->bias_walk[a], age_s)), most);
    const tse_real kept = r_sqrt(r_div(most - s->bias_var[a], most - var));
    s->bias[a] = r_mul(kept, r_mul(p->inv_sd[a], r_from_q24(c->bias[a])));
  }
}

/* What start_hypothesis() reads: spread and noise as of a hypothesis, relative; the settings' where nothing is known. Fixed point has
 * no hypotheses, and could not hold the squares. */
static void load_car(const tse_params *p, const content *c, tse_start *s)
{
  for (int a = 0; a < 3; a++) {
    const tse_real level = r_max(TSE_R(1) + r_from_q24(c->mean[a]), TSE_R(1) + p->w_min);
    const tse_real spread = r_div(r_from_q24(c->spread[a]), level), noise = r_from_q24(c->noise[a]);
    const int known = (c->known >> a & 1u) != 0 && c->spread[a] > 0;
    s->spread_var[a] = known ? r_mul(spread, spread) : p->initial_spread_var;
    s->noise_var[a] = c->noise[a] > 0 ? r_mul(noise, noise) : TSE_R(1);
  }
  s->held = (int32_t)(c->of_car >> 6 & 1u);
}

tse_status tse_learnt_load(const tse_params *p, tse_filter *f, const uint8_t *in, size_t bytes, uint32_t age_s)
{
  if (!p || !f || !in) return TSE_E_NULL;
  if (!belong(p, f) || f->step > 0 || f->waiting.count > 0) return TSE_E_STATE;
  content c;
  const tse_status refused = decode(in, bytes, p->vehicle, &c);
  if (refused < 0) return refused; /* nothing has changed yet */
  start_of_settings(p, &f->start);
  f->start.loaded = 1;
  for (int a = 0; a < 3; a++) f->start.level[a] = (int32_t)(c.of_car >> (2 * a) & LAST_LEVEL);
  if (c.known) load_stiffness(p, &c, age_s, &f->start);
  load_biases(p, &c, age_s, &f->start);
  if (p->form == 0) load_car(p, &c, &f->start);
  for (int a = 0; a < 3; a++) f->known[a] = (c.known >> a & 1u) != 0 ? TSE_KNOWN_BEFORE : TSE_UNKNOWN;
  return TSE_OK;
}
