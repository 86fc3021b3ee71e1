/* tests/fmu/unit/test_estimator.c - TireStiffnessEstimator beside tse_step(), and what it does with sensors that fail. */
#include "fmu_case.h"
#include "replay.h"

static tse_input rows[REPLAY_ROWS_MOST];

static void put_row(fmi2Component c, const tse_input *u)
{
#define INPUT(name, lo, hi, unit, kind, text) OK(put_real(c, #name, u->name));
#include "tse/input.def"
#undef INPUT
  OK(put_integer(c, "missing", (int)u->missing));
}

static void expect_outputs(fmi2Component c, const tse_config *config, const tse_output *y, int row)
{
  char what[80];
  tse_setting mean[3], sd[3], spread[3];
  tse_stiffness_si(config, y, mean, sd, spread);
  (void)snprintf(what, sizeof what, "row %d", row);
#define EXPECT_REAL(name, value)                                                                                                 \
  TEST_ASSERT_EQUAL_HEX64_ARRAY_MESSAGE(&(double[]){ value }, &(double[]){ real_of(c, name) }, 1, what);
#define EXPECT_INT(name, value) TEST_ASSERT_EQUAL_INT_MESSAGE((int)(value), integer_of(c, name), what);
#define OUT_REAL(name, member, unit, text) EXPECT_REAL("estimate." #name, y->member)
#define OUT_INT(name, member, text) EXPECT_INT("estimate." #name, y->member)
#define OUT_STIFFNESS(name, member, si, unit, text)                                                                              \
  EXPECT_REAL("estimate." #name, si) EXPECT_REAL("estimate.relative." #name, y->member)
#define OUT_FLAG(name, member, text) TEST_ASSERT_EQUAL_INT_MESSAGE(y->member, boolean_of(c, "estimate." #name), what);
#define OUT_REASON(stiffness, member, text)                                                                      \
  EXPECT_INT("estimate." #stiffness "_reason", y->member)                                                        \
  TEST_ASSERT_EQUAL_INT_MESSAGE(y->member == TSE_VALID, boolean_of(c, "estimate." #stiffness "_valid"), what);
#include "tse/output.def"
#undef OUT_REAL
#undef OUT_INT
  TEST_ASSERT_EQUAL_INT_MESSAGE(y->reason[0] == TSE_VALID && y->reason[1] == TSE_VALID && y->reason[2] == TSE_VALID,
                                boolean_of(c, "estimate.valid"), what);
}

/* The recorded drive, with lost channels, lost rows, standstill and reverse: every output has the bits of tse_step(). */
static void test_a_recorded_drive_gives_the_bits_of_tse_step(void)
{
  static tse_filter_paper memory;
  tse_filter *const filter = &memory.filter;
  static tse_params p;
  tse_config config;
  tse_output y;
  int warned = 0, valid = 0;
  const int n = replay_read("replay/drive.csv", rows);
  TEST_ASSERT_TRUE_MESSAGE(n > 2000, "the test runs in the directory tests");
  tse_config_default(&config);
  config.particles = 60;
  config.mass = 1800;
  config.seed = 5;
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_prepare(&config, &p, NULL));
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_reset(&p, filter, sizeof memory));
  fmi2Component const c = instantiated();
  OK(put_real(c, "vehicle.mass", 1800));
  OK(put_integer(c, "filter.seed", 5));
  initialized(c);
  double time = 0.0;
  for (int i = 0; i < n; i++) {
    const double next = i + 1 < n ? time + rows[i + 1].dt : time + STEP;
    tse_input u = rows[i];
    if (i > 0) u.dt = rows[i].dt;
    put_row(c, &u);
    const fmi2Status status = fmi2DoStep(c, time, next - time, fmi2True);
    TEST_ASSERT_TRUE_MESSAGE(status == fmi2OK || status == fmi2Warning, last_line());
    static double last;
    u.dt = i > 0 ? time - last : 0.0; /* as the FMU can know it: from communication points */
    last = time;
    TEST_ASSERT_TRUE(tse_step(&p, filter, &u, &y) >= 0);
    expect_outputs(c, &config, &y, i);
    warned += status == fmi2Warning;
    valid += boolean_of(c, "estimate.valid");
    time = next;
  }
  TEST_ASSERT_TRUE(warned > 100 && warned < n && valid > 100);
  said = 0;
}

static void test_before_the_first_sample_outputs_say_what_the_settings_say(void)
{
  fmi2Component const c = instantiated();
  OK(put_real(c, "filter.initial_cx_front", 0.8));
  OK(put_real(c, "filter.initial_cy_front", 0.9));
  OK(put_real(c, "filter.initial_cy_rear", 1.1));
  OK(put_real(c, "filter.initial_mean_sd", 0.25));
  OK(put_real(c, "filter.initial_spread", 0.06));
  OK(fmi2EnterInitializationMode(c));
  TEST_ASSERT_TRUE(real_of(c, "estimate.relative.cx_front") == 0.8 && real_of(c, "estimate.cx_front") == 0.8 * 1.6e5);
  TEST_ASSERT_TRUE(real_of(c, "estimate.relative.cy_front") == 0.9 && real_of(c, "estimate.cy_front") == 0.9 * 1.2e5);
  TEST_ASSERT_TRUE(real_of(c, "estimate.relative.cy_rear") == 1.1 && real_of(c, "estimate.cy_rear") == 1.1 * 1.4e5);
  TEST_ASSERT_TRUE(real_of(c, "estimate.relative.cy_rear_sd") == 0.25 && real_of(c, "estimate.cy_rear_sd") == 0.25 * 1.4e5);
  TEST_ASSERT_TRUE(real_of(c, "estimate.relative.cx_front_spread") == 0.06);
  TEST_ASSERT_TRUE(real_of(c, "estimate.noise_accel_y") == 1.0);
  TEST_ASSERT_EQUAL_INT(TSE_W_STARTING, integer_of(c, "estimate.status"));
  TEST_ASSERT_EQUAL_INT(TSE_STARTING, integer_of(c, "estimate.cy_rear_reason"));
  TEST_ASSERT_EQUAL_INT(0, boolean_of(c, "estimate.cx_front_valid"));
  TEST_ASSERT_EQUAL_INT(0, boolean_of(c, "estimate.valid"));
}

/* Which inputs are wrong in step k of a fault; the text that must be said. */
typedef struct fault { const char *name; double value; int held; } fault;
static const fault faults[] = {
  { "steer_angle", (double)NAN, 1 }, { "steer_angle", 1.3, 1 }, { "wheel_speed_front", (double)NAN, 1 },
  { "wheel_speed_front", 401.0, 1 }, { "wheel_speed_rear", -(double)INFINITY, 1 }, { "accel_x", (double)NAN, 0 },
  { "accel_x", 50.1, 0 }, { "accel_y", (double)INFINITY, 0 }, { "yaw_rate", -6.1, 0 }, { "yaw_rate", (double)NAN, 0 },
};

static void test_a_failing_sensor_is_a_warning_said_once_and_the_estimate_is_held(void)
{
  for (int f = 0; f < COUNT(faults); f++) {
    fmi2Component const c = stepping();
    stepped(c, 0, 30);
    const double before = real_of(c, "estimate.cx_front");
    said = 0;
    for (int k = 30; k < 36; k++) {
      set_inputs(c, k);
      OK(put_real(c, faults[f].name, faults[f].value));
      TEST_ASSERT_EQUAL_INT_MESSAGE(fmi2Warning, fmi2DoStep(c, k * STEP, STEP, fmi2True), faults[f].name);
      TEST_ASSERT_TRUE(integer_of(c, "estimate.status") >= TSE_W_MISSING_CHANNEL);
      if (!faults[f].held) continue;
      TEST_ASSERT_TRUE(real_of(c, "estimate.cx_front") == before);
      TEST_ASSERT_EQUAL_INT(TSE_INPUT_INVALID, integer_of(c, "estimate.cx_front_reason"));
      TEST_ASSERT_EQUAL_INT(0, boolean_of(c, "estimate.valid"));
    }
    TEST_ASSERT_EQUAL_INT_MESSAGE(1, said, faults[f].name);
    TEST_ASSERT_EQUAL_INT(fmi2Warning, lines[0].status);
    TEST_ASSERT_EQUAL_STRING("logStatusWarning", lines[0].category);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(lines[0].text, faults[f].name), lines[0].text);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(lines[0].text, "at 0.3 s"), lines[0].text);
    stepped(c, 36, 38); /* well again */
    set_inputs(c, 38);
    OK(put_real(c, faults[f].name, faults[f].value));
    TEST_ASSERT_EQUAL_INT(fmi2Warning, fmi2DoStep(c, 38 * STEP, STEP, fmi2True));
    TEST_ASSERT_EQUAL_INT_MESSAGE(2, said, "a fault that comes back is said again");
    fmi2FreeInstance(c);
    made_count--;
  }
}

static void test_of_several_missing_channels_the_first_is_named(void)
{
  fmi2Component const c = stepping();
  set_inputs(c, 0);
  OK(put_real(c, "accel_y", (double)NAN));
  OK(put_real(c, "yaw_rate", 7.0));
  TEST_ASSERT_EQUAL_INT(fmi2Warning, fmi2DoStep(c, 0.0, STEP, fmi2True));
  TEST_ASSERT_EQUAL_INT(1, said);
  TEST_ASSERT_NOT_NULL(strstr(last_line(), "accel_y is missing"));
}

/* Who comes after it, in the same place or after a reset, has not been told yet. */
static void test_a_fault_is_said_anew_to_a_new_run_and_a_new_instance(void)
{
  fmi2Component c = instantiated();
  for (int run = 1; run <= 3; run++) {
    initialized(c);
    OK(put_real(c, "accel_x", (double)NAN));
    TEST_ASSERT_EQUAL_INT(fmi2Warning, fmi2DoStep(c, 0.0, STEP, fmi2True));
    TEST_ASSERT_EQUAL_INT(run, said);
    if (run == 1) {
      OK(fmi2Reset(c));
    } else if (run == 2) {
      fmi2Component const old = c;
      fmi2FreeInstance(c);
      made_count--;
      c = instantiated();
      TEST_ASSERT_EQUAL_PTR(old, c);
    }
  }
}

/* At a limit of the range a channel is still used. */
static void test_the_ends_of_a_range_belong_to_it(void)
{
  static const struct { const char *name; double lo, hi; } channels[] = {
#define INPUT(name, lo, hi, unit, kind, text) { #name, lo, hi },
#include "tse/input.def"
#undef INPUT
  };
  for (int i = 0; i < COUNT(channels); i++)
    for (int k = 0; k < 2; k++) {
      fmi2Component const c = stepping();
      set_inputs(c, 0);
      OK(put_real(c, channels[i].name, k ? channels[i].hi : channels[i].lo));
      OK(fmi2DoStep(c, 0.0, STEP, fmi2True));
      fmi2FreeInstance(c);
      made_count--;
    }
}

/* The mask says the same as NaN, bit for bit; bits beyond the channels say nothing. */
static void test_the_mask_of_missing_channels_is_as_good_as_nan(void)
{
  static const char *const names[] = {
#define INPUT(name, lo, hi, unit, kind, text) #name,
#include "tse/input.def"
#undef INPUT
  };
  for (int i = 0; i < COUNT(names); i++) {
    fmi2Component const a = stepping(), b = stepping();
    for (int k = 0; k < 30; k++) {
      const int lost = k > 10 && k < 15;
      set_inputs(a, k);
      set_inputs(b, k);
      if (lost) OK(put_real(a, names[i], (double)NAN));
      OK(put_integer(b, "missing", (lost ? 1 << i : 0) | (k % 2 ? 64 << k % 20 : 0)));
      const fmi2Status x = fmi2DoStep(a, k * STEP, STEP, fmi2True), y = fmi2DoStep(b, k * STEP, STEP, fmi2True);
      TEST_ASSERT_EQUAL_INT(lost ? fmi2Warning : fmi2OK, x);
      TEST_ASSERT_EQUAL_INT(x, y);
      for (int32_t v = 0; v < fmu_variable_count; v++)
        if (fmu_variables[v].role == 'o' && fmu_variables[v].kind == 'r') {
          const double got_a = real_of(a, fmu_variables[v].name), got_b = real_of(b, fmu_variables[v].name);
          TEST_ASSERT_EQUAL_INT_MESSAGE(0, memcmp(&got_a, &got_b, sizeof got_a), fmu_variables[v].name);
        }
    }
    fmi2FreeInstance(a);
    fmi2FreeInstance(b);
    made_count -= 2;
  }
}

static void test_a_sensor_missing_at_standstill_is_said_too(void)
{
  fmi2Component const c = stepping();
  for (int k = 0; k < 20; k++) {
    OK(put_real(c, "accel_x", k < 5 ? 0.0 : (double)NAN));
    TEST_ASSERT_EQUAL_INT(k < 5 ? fmi2OK : fmi2Warning, fmi2DoStep(c, k * STEP, STEP, fmi2True));
  }
  TEST_ASSERT_EQUAL_INT(1, said);
  TEST_ASSERT_NOT_NULL(strstr(lines[0].text, "accel_x"));
}

/* A wheel speed that is missing while the car stops and starts is one fault, not one for every status on the way. */
static void test_a_fault_that_lasts_is_said_once_whatever_the_car_does_meanwhile(void)
{
  fmi2Component const c = stepping();
  for (int k = 0; k < 200; k++) {
    const double speed = 7.0 + 3.0 * cos(0.05 * k); /* rad/s: above and below hold_speed, 2 m/s */
    OK(put_real(c, "wheel_speed_front", speed + 0.001 * (k % 7)));
    OK(put_real(c, "wheel_speed_rear", speed + 0.001 * (k % 5)));
    OK(put_real(c, "accel_y", (double)NAN));
    OK(put_real(c, "accel_x", 0.1 * sin(7.0 * k)));
    OK(put_real(c, "yaw_rate", 0.003 * sin(9.0 * k)));
    TEST_ASSERT_EQUAL_INT(fmi2Warning, fmi2DoStep(c, k * STEP, STEP, fmi2True));
  }
  int about = 0;
  for (int i = 0; i < said && i < COUNT(lines); i++) about += strstr(lines[i].text, "accel_y") != NULL;
  TEST_ASSERT_EQUAL_INT_MESSAGE(1, about, last_line());
}

static void test_a_gap_is_bridged_or_restarts_and_a_longer_one_than_an_hour_is_refused(void)
{
  fmi2Component const c = stepping();
  stepped(c, 0, 3);
  set_inputs(c, 3);
  saved_bytes before = bytes_of(c);
  REFUSED(fmi2DoStep(c, 3 * STEP, 3601.0, fmi2True), "communicationStepSize", "3601", "longer than 3600 s");
  expect_unchanged(c, &before, "after a refused step");
  free(before.at);
  OK(fmi2DoStep(c, 3 * STEP, 3599.0, fmi2True)); /* the sample of 0.03 s */
  set_inputs(c, 4);
  TEST_ASSERT_EQUAL_INT(fmi2Warning, fmi2DoStep(c, 3 * STEP + 3599.0, STEP, fmi2True)); /* the next is not refused for it */

  fmi2Component const d = stepping();
  stepped(d, 0, 3);
  set_inputs(d, 3);
  OK(fmi2DoStep(d, 3 * STEP, 2.0, fmi2True));
  set_inputs(d, 4);
  TEST_ASSERT_EQUAL_INT(fmi2Warning, fmi2DoStep(d, 3 * STEP + 2.0, STEP, fmi2True));
  TEST_ASSERT_EQUAL_INT(TSE_W_GAP, integer_of(d, "estimate.status"));
}

static void test_inputs_take_no_derivatives(void)
{
  fmi2Component const c = stepping();
  const fmi2ValueReference vr = ref("accel_x");
  const fmi2Integer order = 1;
  const fmi2Real value = 0.5;
  REFUSED(fmi2SetRealInputDerivatives(c, &vr, 1, &order, &value), "accel_x takes no derivative");
}

int main(void)
{
  UNITY_BEGIN();
  RUN_TEST(test_a_recorded_drive_gives_the_bits_of_tse_step);
  RUN_TEST(test_before_the_first_sample_outputs_say_what_the_settings_say);
  RUN_TEST(test_a_failing_sensor_is_a_warning_said_once_and_the_estimate_is_held);
  RUN_TEST(test_of_several_missing_channels_the_first_is_named);
  RUN_TEST(test_a_fault_is_said_anew_to_a_new_run_and_a_new_instance);
  RUN_TEST(test_the_ends_of_a_range_belong_to_it);
  RUN_TEST(test_the_mask_of_missing_channels_is_as_good_as_nan);
  RUN_TEST(test_a_sensor_missing_at_standstill_is_said_too);
  RUN_TEST(test_a_fault_that_lasts_is_said_once_whatever_the_car_does_meanwhile);
  RUN_TEST(test_a_gap_is_bridged_or_restarts_and_a_longer_one_than_an_hour_is_refused);
  RUN_TEST(test_inputs_take_no_derivatives);
  return UNITY_END();
}
