/* tests/fmu/unit/test_state.c - saved, restored and serialized states. */
#include "fmu_case.h"

#define FRAME 32 /* bytes of the header: magic, format, bytes, model, sum */

static void test_a_restored_state_goes_on_as_if_nothing_had_happened(void)
{
  fmi2Component const a = stepping(), b = stepping();
  fmi2FMUstate state = NULL;
  stepped(a, 0, 15);
  OK(fmi2GetFMUstate(a, &state));
  stepped(a, 15, 30);
  const saved_bytes first = bytes_of(a);
  OK(fmi2SetFMUstate(a, state));
  stepped(a, 15, 30);
  const saved_bytes again = bytes_of(a);
  OK(fmi2Terminate(a));
  OK(fmi2Reset(a));
  OK(fmi2SetFMUstate(a, state)); /* the phase is part of the state */
  stepped(a, 15, 30);
  expect_same_and_free(bytes_of(a), again, "restored after a reset");
  stepped(b, 0, 30);
  expect_same_and_free(bytes_of(b), first, "without saving");
  fmi2Component const other = instantiated();
  OK(fmi2SetFMUstate(other, state));
  stepped(other, 15, 30);
  expect_same_and_free(bytes_of(other), bytes_of(b), "restored in another instance");
}

static void test_a_state_of_every_phase_brings_that_phase_back(void)
{
  fmi2Component const c = instantiated();
  fmi2FMUstate before = NULL, init = NULL, ended = NULL;
  OK(put_real(c, ANOTHER_PARAMETER, 1700.0));
  OK(fmi2SetupExperiment(c, fmi2False, 0, 2.0, fmi2False, 0));
  OK(fmi2GetFMUstate(c, &before));
  OK(fmi2EnterInitializationMode(c));
  OK(put_real(c, AN_INPUT, 5.0));
  OK(fmi2GetFMUstate(c, &init));
  OK(fmi2ExitInitializationMode(c));
  OK(fmi2Terminate(c));
  OK(fmi2GetFMUstate(c, &ended));

  OK(fmi2SetFMUstate(c, before));
  TEST_ASSERT_TRUE(real_of(c, ANOTHER_PARAMETER) == 1700.0 && real_of(c, AN_INPUT) != 5.0);
  OK(put_real(c, ANOTHER_PARAMETER, 1500.0));
  OK(fmi2EnterInitializationMode(c));
  OK(fmi2SetFMUstate(c, init));
  TEST_ASSERT_TRUE(real_of(c, ANOTHER_PARAMETER) == 1700.0 && real_of(c, AN_INPUT) == 5.0);
  OK(fmi2ExitInitializationMode(c));
  OK(fmi2DoStep(c, 2.0, STEP, fmi2True) == fmi2Error ? fmi2Error : fmi2OK);
  OK(fmi2SetFMUstate(c, ended));
  REFUSED(fmi2DoStep(c, 2.0, STEP, fmi2True), "after fmi2Terminate");
}

static void test_a_state_is_overwritten_in_place_and_freed_once(void)
{
  fmi2Component const c = stepping();
  fmi2FMUstate state = NULL, again;
  OK(fmi2GetFMUstate(c, &state));
  again = state;
  stepped(c, 0, 5);
  const saved_bytes five = bytes_of(c);
  OK(fmi2GetFMUstate(c, &again));
  TEST_ASSERT_EQUAL_PTR(state, again);
  stepped(c, 5, 7);
  OK(fmi2SetFMUstate(c, state));
  expect_same_and_free(bytes_of(c), five, "overwritten");
  OK(fmi2FreeFMUstate(c, &state));
  TEST_ASSERT_NULL(state);
  OK(fmi2FreeFMUstate(c, &state));
  saved_bytes before = bytes_of(c);
  fmi2Byte byte[8];
  size_t size;
  REFUSED(fmi2SetFMUstate(c, again), "fmi2SetFMUstate", "not a state");
  REFUSED(fmi2GetFMUstate(c, &again), "fmi2GetFMUstate", "not a state");
  REFUSED(fmi2SerializedFMUstateSize(c, again, &size), "fmi2SerializedFMUstateSize", "not a state");
  REFUSED(fmi2SerializeFMUstate(c, again, byte, sizeof byte), "fmi2SerializeFMUstate", "not a state");
  REFUSED(fmi2FreeFMUstate(c, &again), "fmi2FreeFMUstate", "not a state");
  again = byte;
  REFUSED(fmi2SetFMUstate(c, again), "not a state");
  expect_unchanged_and_free(c, &before, "after refusals");
}

static void test_the_pool_of_states_says_when_it_is_exhausted_and_is_whole_after_freeing(void)
{
  fmi2Component const c = stepping(), d = stepping();
  fmi2FMUstate all[FMU_STATES] = { NULL }, more = NULL;
  const saved_bytes b = bytes_of(c);
  for (int round = 0; round < 2; round++) {
    for (int i = 0; i < FMU_STATES; i++) {
      all[i] = NULL;
      OK(fmi2GetFMUstate(i % 2 ? c : d, &all[i]));
      for (int k = 0; k < i; k++) TEST_ASSERT_TRUE(all[i] != all[k]);
    }
    REFUSED(fmi2GetFMUstate(c, &more), "fmi2GetFMUstate", "all 6 saved states are in use", "FMU_STATES");
    REFUSED(fmi2DeSerializeFMUstate(c, b.at, b.count, &more), "fmi2DeSerializeFMUstate", "FMU_STATES");
    TEST_ASSERT_NULL(more);
    OK(fmi2GetFMUstate(c, &all[2])); /* overwriting needs no place */
    for (int i = 0; i < FMU_STATES; i++) OK(fmi2FreeFMUstate(d, &all[i]));
  }
  free(b.at);
}

static void test_freeing_an_instance_frees_its_states_and_no_others(void)
{
  fmi2Component const keeper = stepping();
  fmi2FMUstate kept = NULL;
  OK(fmi2GetFMUstate(keeper, &kept));
  for (int round = 0; round < 3 * FMU_STATES; round++) {
    fmi2Component const c = stepping();
    fmi2FMUstate state = NULL, second = NULL;
    OK(fmi2GetFMUstate(c, &state));
    OK(fmi2GetFMUstate(c, &second));
    drop(c);
    REFUSED(fmi2SetFMUstate(keeper, state), "not a state");
  }
  OK(fmi2SetFMUstate(keeper, kept));
}

/* ---- serialized */

static void test_bytes_become_the_same_state(void)
{
  fmi2Component const a = stepping(), b = instantiated();
  stepped(a, 0, 15);
  const saved_bytes saved = bytes_of(a);
  fmi2FMUstate state = NULL;
  OK(fmi2DeSerializeFMUstate(b, saved.at, saved.count, &state));
  OK(fmi2SetFMUstate(b, state));
  expect_same_and_free(bytes_of(b), saved, "bytes of the bytes' state");
  stepped(a, 15, 30);
  stepped(b, 15, 30);
  expect_same_and_free(bytes_of(a), bytes_of(b), "went on");
}

static void test_equal_histories_have_equal_bytes(void)
{
  fmi2Component const a = stepping();
  stepped(a, 0, 10);
  char dirt[4096];
  memset(dirt, 0x5a, sizeof dirt); /* uninitialised stack must not show */
  TEST_ASSERT_EQUAL_INT(0x5a, dirt[said % 100]);
  fmi2Component const b = stepping();
  stepped(b, 0, 10);
  expect_same_and_free(bytes_of(a), bytes_of(b), "the same run twice");
}

/* Check that a call is refused with one message and uses no place of the pool. */
static void expect_bytes_refused(fmi2Component c, const fmi2Byte *at, size_t count, const char *words)
{
  fmi2FMUstate state = NULL;
  said = 0;
  REFUSED(fmi2DeSerializeFMUstate(c, at, count, &state), "fmi2DeSerializeFMUstate", words);
  TEST_ASSERT_NULL(state);
}

static void test_every_changed_byte_is_noticed(void)
{
  fmi2Component const c = stepping();
  stepped(c, 0, 5);
  saved_bytes b = bytes_of(c), before = bytes_of(c);
  static const int flips[] = { 0x01, 0x10, 0x80, 0xff };
  for (size_t i = 0; i < FRAME; i++)
    for (int k = 0; k < COUNT(flips); k++) {
      b.at[i] = (fmi2Byte)(b.at[i] ^ flips[k]);
      expect_bytes_refused(c, b.at, b.count, "");
      b.at[i] = (fmi2Byte)(b.at[i] ^ flips[k]);
    }
  const size_t stride = b.count / 300 + 1;
  for (size_t i = FRAME; i < b.count; i += stride) {
    b.at[i] = (fmi2Byte)(b.at[i] ^ flips[i % 4]);
    expect_bytes_refused(c, b.at, b.count, "checksum");
    b.at[i] = (fmi2Byte)(b.at[i] ^ flips[i % 4]);
  }
  b.at[b.count - 1] = (fmi2Byte)(b.at[b.count - 1] ^ 1);
  expect_bytes_refused(c, b.at, b.count, "checksum");
  b.at[b.count - 1] = (fmi2Byte)(b.at[b.count - 1] ^ 1);

  fmi2FMUstate all[FMU_STATES];
  for (int i = 0; i < FMU_STATES; i++) {
    all[i] = NULL;
    OK(fmi2DeSerializeFMUstate(
        c, b.at, b.count, &all[i])); /* original again; the refusals have used no place */
  }
  for (int i = 0; i < FMU_STATES; i++) OK(fmi2FreeFMUstate(c, &all[i]));
  expect_unchanged(c, &before, "after refused bytes");
  free(b.at);
  free(before.at);
}

static void test_what_is_wrong_with_the_bytes_is_said(void)
{
  fmi2Component const c = stepping();
  const saved_bytes b = bytes_of(c);
  static const struct {
    size_t at;
    const char *words;
  } parts[] = {
    { 0, "another byte order" },
    { 4, "another version" },
    { 8, "another size" },
    { 16, "another FMU" },
    { 24, "checksum" },
    { FRAME, "checksum" },
  };
  for (int i = 0; i < COUNT(parts); i++) {
    b.at[parts[i].at]++;
    expect_bytes_refused(c, b.at, b.count, parts[i].words);
    b.at[parts[i].at]--;
  }
  free(b.at);
}

static void test_truncated_bytes_are_refused_and_not_read_beyond(void)
{
  fmi2Component const c = stepping();
  const saved_bytes b = bytes_of(c);
  const size_t counts[] = { 0, 1, 7, FRAME - 1, FRAME, FRAME + 1, b.count / 2, b.count - 1 };
  for (int i = 0; i < COUNT(counts); i++) {
    fmi2Byte *const part = malloc(
        counts[i] + (counts[i] == 0)); /* exact size: sanitizers detect reads beyond it */
    TEST_ASSERT_NOT_NULL(part);
    memcpy(part, b.at, counts[i]);
    expect_bytes_refused(c, part, counts[i], counts[i] < FRAME ? "too short" : "size");
    free(part);
  }
  free(b.at);
}

/* An importer may keep states in larger buffers. */
static void test_a_larger_buffer_is_fine_a_smaller_one_is_refused_and_untouched(void)
{
  fmi2Component const c = stepping();
  fmi2FMUstate state = NULL, back = NULL;
  size_t size = 0;
  OK(fmi2GetFMUstate(c, &state));
  OK(fmi2SerializedFMUstateSize(c, state, &size));
  TEST_ASSERT_TRUE(size > sizeof(model));
  fmi2Byte *const buffer = malloc(size + 100);
  TEST_ASSERT_NOT_NULL(buffer);
  memset(buffer, 0x33, size + 100);
  REFUSED(fmi2SerializeFMUstate(c, state, buffer, size - 1), "fmi2SerializeFMUstate", "smaller");
  for (size_t i = 0; i < size + 100; i++) TEST_ASSERT_EQUAL_INT(0x33, buffer[i]);
  OK(fmi2SerializeFMUstate(c, state, buffer, size + 100));
  for (size_t i = size; i < size + 100; i++) TEST_ASSERT_EQUAL_INT(0x33, buffer[i]);
  OK(fmi2DeSerializeFMUstate(c, buffer, size + 100, &back));
  OK(fmi2SetFMUstate(c, back));
  free(buffer);
}

/* ---- forged: changed content with a correct checksum */

#define MODEL (FRAME + 24) /* after phase, age of the outputs, start time and time of the content */

static void sign(saved_bytes b)
{
  uint64_t h = 14695981039346656037u;
  for (size_t i = FRAME; i < b.count; i++) h = (h ^ (unsigned char)b.at[i]) * 1099511628211u;
  memcpy(b.at + 24, &h, sizeof h);
}

static void test_a_forged_state_is_refused_whatever_its_checksum_says(void)
{
  fmi2Component const c = stepping();
  stepped(c, 0, 5);
  const saved_bytes b = bytes_of(c);
  saved_bytes before = bytes_of(c);
  const double none = 1e300 * 1e300 - 1e300 * 1e300;
  const struct {
    size_t at;
    size_t count;
    const void *value;
  } parts[] = {
    { FRAME, 4, (const int32_t[]){ 3 } },
    { FRAME, 4, (const int32_t[]){ 16 } },
    { FRAME + 4, 4, (const int32_t[]){ 1 } },
    { FRAME + 4, 4, (const int32_t[]){ -1 } },
    { FRAME, 8, (const int32_t[]){ 1, 0 } }, /* instantiated, with outputs that are up to date */
    { FRAME + 8, 8, &none },
    { FRAME + 16, 8, &none },
    { MODEL + (size_t)fmu_variables[ref(ANOTHER_PARAMETER)].offset, 8, (const double[]){ 1e9 } },
    { MODEL + (size_t)fmu_variables[ref(ANOTHER_PARAMETER)].offset, 8,
        (const double[]){ 1234.5 } }, /* in range, but inconsistent with the rest */
    { MODEL + (size_t)fmu_variables[ref(ANOTHER_PARAMETER)].offset, 8, &none },
#if defined(CASE_ESTIMATOR)
    { MODEL + offsetof(model, config.particles), 4, (const int32_t[]){ 100000 } },
    { MODEL + offsetof(model, params.particles), 4, (const int32_t[]){ 100000 } },
    { MODEL + offsetof(model, set), 1, (const uint8_t[]){ SET_TO_ANOTHER + 1 } },
    { MODEL + offsetof(model, exact), 4, (const int32_t[]){ 2 } },
    { MODEL + offsetof(model, exact), 4, (const int32_t[]){ 1 } }, /* the settings in use depend on it */
    { MODEL + offsetof(model, used.mass), 8, (const double[]){ 1234.5 } },
    { MODEL + offsetof(model, params.fingerprint), 4, (const int32_t[]){ 1 } },
    { MODEL + offsetof(model, memory.filter.fingerprint), 4, (const int32_t[]){ 1 } },
    { MODEL + offsetof(model, memory.filter.k.fault), 4, (const int32_t[]){ TSE_CHANNELS + 1 } },
    { MODEL + offsetof(model, memory.filter.k.change_kind), 4, (const int32_t[]){ TSE_CHANGE_RESTART + 1 } },
    { MODEL + offsetof(model, memory.filter.k.event[0].kind), 4, (const int32_t[]){ 100 } },
    { MODEL + offsetof(model, memory.filter.k.event[0].kind), 4, (const int32_t[]){ -1 } },
    { MODEL + offsetof(model, memory.filter.k.slow_turn), 4, (const int32_t[]){ -1 } },
    { MODEL + offsetof(model, memory.filter.k.ud.d), 8, (const double[]){ -1.0 } },
    { MODEL + offsetof(model, memory.filter.k.x), 8, &none },
    { MODEL + offsetof(model, time), 8, &none },
    { MODEL + offsetof(model, rows), 4, (const int32_t[]){ 2 } },
#else
    { MODEL + offsetof(model, sim.params.radius_front), 8, (const double[]){ 1.0 } },
    { MODEL + offsetof(model, sim.x), 8, &none },
    { MODEL + offsetof(model, sim.last.steer_angle), 8, (const double[]){ 100.0 } },
    { MODEL + offsetof(model, sim.effects.steer.count), 4, (const int32_t[]){ 13 } },
    { MODEL + offsetof(model, ramp), 4, (const int32_t[]){ 2 } },
    { MODEL + offsetof(model, rate), 8, &none },
    { MODEL + offsetof(model, rate) + sizeof(tse_sim_input) - 8, 8, &none }, /* of the last input */
#endif
  };
  for (int i = 0; i < COUNT(parts); i++) {
    memcpy(b.at + parts[i].at, parts[i].value, parts[i].count);
    sign(b);
    expect_bytes_refused(c, b.at, b.count, "outside its range");
    memcpy(b.at, before.at, b.count);
  }
  const fmu_variable *const v = &fmu_variables[ref(ANOTHER_PARAMETER)];
  char range[FMU_RANGE];
  memcpy(b.at + MODEL + (size_t)v->offset, (const double[]){ 1e9 }, 8);
  sign(b);
  expect_bytes_refused(c, b.at, b.count, v->name);
  expect_bytes_refused(c, b.at, b.count, fmu_write_range(v, range));
  memcpy(b.at, before.at, b.count);
  expect_unchanged(c, &before, "after forged states");
  fmi2FMUstate state = NULL;
  OK(fmi2DeSerializeFMUstate(c, b.at, b.count, &state));
  free(b.at);
  free(before.at);
}

/* The limits of a range belong to it, in a saved state, too. */
static void test_a_state_with_parameters_at_their_limits_is_accepted(void)
{
  for (int high = 0; high < 2; high++) {
    fmi2Component const c = instantiated();
    fmi2FMUstate state = NULL;
    for (int32_t i = 0; i < fmu_variable_count; i++) {
      const fmu_variable *const v = &fmu_variables[i];
      if (v->role == 'p' && v->kind != 'b') SET(c, { v->name, high ? v->hi : v->lo });
    }
    const saved_bytes b = bytes_of(c);
    const fmi2Status status = fmi2DeSerializeFMUstate(c, b.at, b.count, &state);
    free(b.at);
    OK(status);
    OK(fmi2SetFMUstate(c, state));
    OK(fmi2FreeFMUstate(c, &state));
    drop(c);
  }
}

/* The FMU continues from an accepted state. Under the sanitizers, a forged word may only
 * make an estimate wrong. */
static void go_on_with_forged_words(int form)
{
  fmi2Component const c = instantiated();
#if defined(CASE_ESTIMATOR)
  OK(put_integer(c, "filter.form", form));
#else
  TEST_ASSERT_EQUAL_INT(0, form);
#endif
  initialized(c);
  stepped(c, 0, 20);
  const saved_bytes b = bytes_of(c), good = bytes_of(c);
  static const double reals[] = { 0.0, -1.0, 1e30, -1e30, 1e9, -1e9, 1e-300, 0.5 };
  static const int32_t words[] = { 0, 1, -1, 7, 255, 100000, 2147483647, -2147483647 - 1 };
  uint32_t chance = 1;
  int accepted = 0, refused = 0;
  for (int i = 0; i < 1500; i++) {
    fmi2FMUstate state = NULL;
    memcpy(b.at, good.at, b.count);
    for (int n = 0; n < 1 + i % 3; n++) {
      chance = chance * 1664525u + 1013904223u;
      const size_t at = FRAME + (size_t)(chance >> 8) % ((b.count - FRAME) / 8) * 8;
      if (i % 2) memcpy(b.at + at, &reals[chance >> 4 & 7u], 8);
      else memcpy(b.at + at + (chance >> 3 & 1u) * 4, &words[chance >> 4 & 7u], 4);
    }
    sign(b);
    said = 0;
    if (fmi2DeSerializeFMUstate(c, b.at, b.count, &state) != fmi2OK) {
      refused++;
      continue;
    }
    OK(fmi2SetFMUstate(c, state));
    OK(fmi2FreeFMUstate(c, &state));
    for (int k = 20; k < 23; k++) (void)fmi2DoStep(c, k * STEP, STEP, fmi2True);
    accepted++;
  }
  said = 0;
  TEST_ASSERT_TRUE(accepted > 20 && refused > 20);
  free(b.at);
  free(good.at);
}

static void test_no_forged_word_leaves_the_memory_of_the_model(void)
{
  go_on_with_forged_words(0);
#if defined(CASE_ESTIMATOR)
  go_on_with_forged_words(1);
#endif
}
