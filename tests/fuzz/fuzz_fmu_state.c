/* tests/fuzz/fuzz_fmu_state.c - deserialize a forged state with a correct checksum. It is
 * refused with one message and changes nothing, or the FMU continues with finite
 * outputs. */
#include "fuzz_fmu.h"

static fmi2Byte saved[MOST_BYTES], before[MOST_BYTES], after[MOST_BYTES];

/* Write the checksum. */
static void seal(fmi2Byte *at, size_t count)
{
  const uint64_t sum = mixed(FRESH, at + FRAME, count - FRAME);
  memcpy(at + SUM, &sum, sizeof sum);
}

/* Replace up to 8 numbers of a state. */
static void forge(bytes *b, fmi2Byte *at, size_t count)
{
  for (uint32_t n = 1 + (take(b, 1) & 7u); n > 0; n--) {
    const uint32_t how = take(b, 1);
    fmi2Byte *const where = at + take(b, 3) % (count / 4) * 4;
    double x;
    int32_t whole = (int32_t)take(b, 1);
    if (where + sizeof x > at + count) continue;
    memcpy(&x, where, sizeof x);
    switch (how & 7u) {
      case 0: memcpy(where, &whole, sizeof whole); break;
      case 1:
        whole = -whole;
        memcpy(where, &whole, sizeof whole);
        break;
      case 6:
        for (size_t i = 0; i < 4; i++) where[i] = (fmi2Byte)take(b, 1);
        break;
      default: x = forged(b, how, x); memcpy(where, &x, sizeof x);
    }
  }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
  bytes b = { data, size };
  fmi2Component const c = made();
  const uint32_t first = take(&b, 1);
  for (uint32_t n = first & 7u; n > 0; n--) (void)set_one(c, &b, take(&b, 2));
  const int started = fmi2EnterInitializationMode(c) == fmi2OK && fmi2ExitInitializationMode(c) == fmi2OK;
  for (uint32_t k = 0; started && k < first >> 3; k++) {
    for (int32_t i = 0; i < fmu_variable_count; i++)
      if (fmu_variables[i].role == 'i' && fmu_variables[i].kind == 'r' && k % 8 == 0)
        (void)set_one(c, &b, (uint32_t)i);
    (void)fmi2DoStep(c, clock_of(c), 0.01, fmi2True);
  }
  const size_t count = serialized(c, saved, sizeof saved);
  forge(&b, saved + FRAME, count - FRAME);
  seal(saved, count);
  const size_t held = bytes_of(c, before, sizeof before);
  fmi2FMUstate state = NULL;
  said = 0;
  const fmi2Status status = fmi2DeSerializeFMUstate(c, saved, count, &state);
  if (status != fmi2OK) {
    MUST(status == fmi2Error && said == 1 && !state, "%d sentences for a refusal", said);
    MUST(bytes_of(c, after, sizeof after) == held && memcmp(before, after, held) == 0,
        "a refused state changed the instance");
  } else {
    MUST(fmi2SetFMUstate(c, state) == fmi2OK, "what was accepted is not set: %s", last_text);
    (void)fmi2EnterInitializationMode(c);
    (void)fmi2ExitInitializationMode(c);
    for (int k = 0; k < 20; k++)
      if (fmi2DoStep(c, clock_of(c), 0.01, fmi2True) <= fmi2Warning)
        must_put_out_numbers(c, "after a forged state");
  }
  fmi2FreeInstance(c);
  return 0;
}
