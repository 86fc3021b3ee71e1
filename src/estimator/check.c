/* estimator/check.c - check of the settings: ranges, formula of the user, latencies. */
#include "estimator/latencies.h"
#include "estimator/settings.h"

#if !defined(TSE_NO_EFFECTS)
/* Return whether the user's formula is valid: each operation is known and finds its
 * operands on the stack, exactly one value is left at the end, and the numbers of values
 * on the stack, of operations with memory and of delays are within their limits. */
static int is_formula_valid(const tse_config *c)
{
#if defined(TSE_FORMULA) /* the formula is compiled in: the settings must not contain one */
  return !(c->formula_code_1 || c->formula_place);
#else
  uint8_t code[TSE_FORMULA_OPS];
  int depth = 0, memories = 0, late = 0;
  unpack_formula(c, code);
  for (int k = 0; k < TSE_FORMULA_OPS && code[k]; k++) {
    int takes = -1;
    for (size_t i = 0; i < sizeof formula_operations / sizeof formula_operations[0]; i++)
      if (formula_operations[i].code == code[k]) {
        takes = formula_operations[i].takes;
        memories += formula_operations[i].memory;
      }
    late += code[k] == FORMULA_OP_late;
    if (takes < 0 || takes > depth) return 0;
    depth += 1 - takes;
    if (depth > FORMULA_STACK) return 0;
  }
  return depth == 1 && memories <= TSE_FORMULA_MEMORIES && late <= FORMULA_LATE;
#endif
}
#endif

/* Make a copy of the settings in which mass, yaw inertia and stiffnesses that are 0 ("not
 * set") have the values of an ordinary car. Return the name of the first setting of the
 * copy that is out of range, or NULL if all are in range. */
static const char *find_outside_of_class(const tse_config *c)
{
  tse_config whole = *c;
  tse_config_complete(&whole);
  return first_outside(&whole, setting_reals, REALS, setting_wholes, WHOLES);
}

tse_status tse_config_check(const tse_config *c, const char **wrong)
{
  if (!c) return TSE_E_NULL;
  const char *name = first_outside(c, setting_reals, REALS, setting_wholes, WHOLES);
  if (!name) name = find_outside_of_class(c);
  if (name) {
    if (wrong) *wrong = name;
    return TSE_E_CONFIG;
  }
  const int formula_is_active = (int)(find_active_effects(c) >> TSE_BIT_FORMULA & 1u);
#if defined(TSE_NO_EFFECTS)
  const int formula_fine = !formula_is_active; /* such a build has no formulas */
#else
  const int formula_fine = !formula_is_active || is_formula_valid(c);
#endif
  if (!formula_fine) {
    if (wrong) *wrong = "formula_code_1";
    return TSE_E_CONFIG;
  }
  return check_latencies(c, wrong);
}
