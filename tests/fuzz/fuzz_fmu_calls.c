/* tests/fuzz/fuzz_fmu_calls.c - call FMI functions in any order, with any values, on two
 * instances. Every call succeeds, or is refused with one message and changes nothing.
 * Outputs are finite. */
#include "fuzz_fmu.h"

typedef struct slot {
  fmi2Component c;
  fmi2FMUstate kept;
} slot;
static fmi2Byte before[MOST_BYTES], after[MOST_BYTES], kept_bytes[MOST_BYTES];
static size_t kept_count;

/* Take a saved state: own, of the other instance, NULL, or an invalid pointer. */
static fmi2FMUstate take_state(bytes *b, slot *s, slot *other)
{
  static int nothing;
  switch (take(b, 1) & 7u) {
    case 0: return NULL;
    case 1: return &nothing;
    case 2: return other->kept;
    default: return s->kept;
  }
}

static fmi2Status call(bytes *b, slot *s, slot *other)
{
  static const double sizes[] = { 0.01, 0.01, 0.01, 0.001, 0.1, 0.5, 7.0, 0.0 };
  fmi2Component const c = s->c;
  const uint32_t what = take(b, 1);
  switch (what & 31u) {
    case 0: return fmi2EnterInitializationMode(c);
    case 1: return fmi2ExitInitializationMode(c);
    case 2: return what & 32u ? fmi2Terminate(c) : fmi2OK;
    case 3: return what & 32u ? fmi2Reset(c) : fmi2OK;
    case 4:
      return fmi2SetupExperiment(c, (what >> 5 & 1) != 0, take_between(b, -1, 1), 10 * take_share(b),
          (what >> 6 & 1) != 0, 10 * take_share(b));
    case 5: return fmi2SetupExperiment(c, fmi2True, take_odd(b), take_odd(b), fmi2True, take_odd(b));
    case 6: return fmi2GetFMUstate(c, &s->kept);
    case 7: return fmi2SetFMUstate(c, take_state(b, s, other));
    case 8: {
      fmi2FMUstate state = take_state(b, s, other);
      const int own = state == s->kept, others = state == other->kept;
      const fmi2Status status = fmi2FreeFMUstate(c, &state);
      if (status == fmi2OK && own) s->kept = NULL;
      if (status == fmi2OK && others) other->kept = NULL;
      return status;
    }
    case 9: {
      const fmi2ValueReference vr = (fmi2ValueReference)(take(b, 2) % (uint32_t)(fmu_variable_count + 2));
      const fmi2Integer order = (fmi2Integer)(take(b, 1) % 4) - 1;
      const fmi2Real rate = what & 32u ? take_odd(b) : take_between(b, -1, 1);
      return fmi2SetRealInputDerivatives(c, &vr, 1, &order, &rate);
    }
    case 10: {
      const fmi2ValueReference vr[2] = { take(b, 4), take(b, 1) };
      fmi2Real x[2];
      fmi2Integer k[2];
      return what & 32u ? fmi2GetReal(c, vr, 2, x) : fmi2GetInteger(c, vr, 2, k);
    }
    case 11: {
      const fmi2ValueReference vr = take(b, 2);
      fmi2Boolean flag;
      fmi2String text = NULL;
      return what & 32u ? fmi2GetBoolean(c, &vr, 1, &flag) : fmi2GetString(c, &vr, 1, &text);
    }
    case 12: {
      const fmi2ValueReference vr = take(b, 2);
      const fmi2Integer k = (fmi2Integer)(take(b, 2)) - 32768;
      return what & 32u ? fmi2SetBoolean(c, &vr, 1, &k) : fmi2SetInteger(c, &vr, 1, &k);
    }
    case 13: { /* if one value is refused, none may be set */
      const fmi2ValueReference vr[2] = { take(b, 1), take(b, 2) };
      const fmi2Real x[2] = { take_share(b), take_odd(b) };
      return fmi2SetReal(c, vr, 2, x);
    }
    case 14: kept_count = serialized(c, kept_bytes, sizeof kept_bytes); return fmi2OK;
    case 15: { /* deserialize, with some bytes changed */
      fmi2FMUstate state = NULL;
      if (!kept_count) return fmi2OK;
      for (uint32_t n = what >> 5; n > 0; n--) kept_bytes[take(b, 3) % kept_count] ^= (fmi2Byte)take(b, 1);
      const fmi2Status status = fmi2DeSerializeFMUstate(
          c, kept_bytes, kept_count - (take(b, 1) == 7), &state);
      if (status != fmi2OK) return status;
      const fmi2Status set = fmi2SetFMUstate(c, state);
      MUST(fmi2FreeFMUstate(c, &state) == fmi2OK, "a state is not freed: %s", last_text);
      return set;
    }
    case 16: return fmi2DoStep(c, take_odd(b), 0.01, fmi2True);
    case 17: return fmi2DoStep(c, clock_of(c), take_odd(b), fmi2True);
    case 18: return fmi2CancelStep(c);
    case 19: {
      fmi2Integer k;
      return fmi2GetIntegerStatus(c, (fmi2StatusKind)(take(b, 1) % 4), &k);
    }
    case 20:
    case 21:
    case 22: return set_one(c, b, take(b, 2));
    default: { /* set inputs, then run some steps */
      fmi2Status status = fmi2OK;
      for (int32_t i = 0; i < fmu_variable_count; i++)
        if (fmu_variables[i].role == 'i' && fmu_variables[i].kind == 'r' && (take(b, 1) & 3u) == 0)
          (void)set_one(c, b, (uint32_t)i);
      for (uint32_t k = 0; k < 1 + (what >> 6) && status <= fmi2Warning; k++) {
        said = 0;
        (void)bytes_of(c, before, sizeof before);
        status = fmi2DoStep(c, clock_of(c), sizes[what >> 5], fmi2True);
      }
      return status;
    }
  }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
  bytes b = { data, size };
  slot slots[2] = { { NULL, NULL }, { NULL, NULL } };
  kept_count = 0;
  odd_lines = 0;
  for (int i = 0; i < 2; i++) slots[i].c = made();
  for (uint32_t n = take(&b, 1) & 15u; n > 0; n--) (void)set_one(slots[0].c, &b, take(&b, 2));
  (void)fmi2EnterInitializationMode(slots[0].c);
  (void)fmi2ExitInitializationMode(slots[0].c);
  for (int calls = 0; b.left > 0 && calls < 60; calls++) {
    const int which = (take(&b, 1) & 15u) == 1;
    slot *const s = &slots[which], *const other = &slots[!which];
    const size_t count = bytes_of(s->c, before, sizeof before);
    said = 0;
    const fmi2Status status = call(&b, s, other);
    MUST(status == fmi2OK || status == fmi2Warning || status == fmi2Error || status == fmi2Discard,
        "status %d", (int)status);
    if (status == fmi2Error || status == fmi2Discard) {
      MUST(said == 1, "%d sentences for a refusal: %s", said, last_text);
      MUST(bytes_of(s->c, after, sizeof after) == count && memcmp(before, after, count) == 0,
          "a refused call changed the instance: %s", last_text);
    }
    must_put_out_numbers(s->c, last_text);
  }
  for (int i = 0; i < 2; i++) fmi2FreeInstance(slots[i].c);
  MUST(odd_lines == 0, "a line with a format in it");
  return 0;
}
