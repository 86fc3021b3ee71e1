/* tests/fmu/unit/test_estimator.c - TireStiffnessEstimator, compared with tse_step(), and
 * its response to sensor faults. */
#include "fmu_case.h"
#include "replay.h"
#include "tse/describe.h"

#define CONTENT (32 + 24) /* of a serialized state, before the model: its frame; phase, outputs' age, start
                           * time and time */

static tse_input rows[REPLAY_ROWS_MOST];

static void put_row(fmi2Component c, const tse_input *u)
{
  for (int k = 0; k < TSE_CHANNELS; k++)
    OK(put_real(c, fmu_variables[k].name, (&u->steer_angle)[k])); /* neighbouring members */
  OK(put_integer(c, "missing", (int)u->missing));
  const tse_field *const given = tse_describe(TSE_STRUCT_INPUT, NULL, NULL) + 1 + TSE_CHANNELS
      + 2; /* after dt, channels, missing and given */
  for (int k = 0; k < TSE_OPTIONALS; k++) {
    char name[40];
    const char *const group = k < TSE_VELOCITIES ? "velocity"
        : k < TSE_VELOCITIES + TSE_PEDALS        ? "pedals"
                                                 : "road";
    (void)snprintf(name, sizeof name, "%s.%s", group, given[k].name);
    OK(put_real(c, name, (&u->ins_vel_x)[k]));
  }
  SET(c, { "velocity.given", (int)(u->given & TSE_GIVEN_VELOCITIES) },
      { "pedals.given", (int)((u->given & TSE_GIVEN_PEDALS) >> TSE_VELOCITIES) },
      { "road.given", (int)(u->given >> (TSE_VELOCITIES + TSE_PEDALS)) });
}

/* A velocity in every tenth row, from the wheels, and pedals in some rows. Values that
 * are not given are random. */
static void measure(tse_input *u, int row, const tse_config *config)
{
  const tse_real v = (tse_real)(config->wheel_radius_rear * u->wheel_speed_rear);
  u->ins_vel_x = u->gnss_speed = v > 0 ? v : 0;
  u->ins_vel_y = (tse_real)0.01 * (tse_real)(row % 7);
  u->gnss_course = (tse_real)0.001 * (tse_real)(row % 6000);
  u->given = row % 10 == 0 && v > 0
      ? TSE_GIVEN_ins_vel_y | TSE_GIVEN_gnss_speed | (row % 20 ? TSE_GIVEN_gnss_course : 0)
      : 0;
  u->brake = (tse_real)(row / 300 % 2), u->wheel_torque_front = (tse_real)(row % 500);
  u->wheel_torque_rear = (tse_real)(row % 90 - 10);
  u->given |= row / 200 % 4 ? TSE_GIVEN_brake : 0;
  u->bank = (tse_real)0.0001 * (tse_real)(row % 300), u->grade = (tse_real)-0.0001 * (tse_real)(row % 200);
  u->given |= (row / 400 % 3 ? TSE_GIVEN_bank : 0) | (row / 250 % 2 ? TSE_GIVEN_grade : 0);
  u->given |= row / 700 % 3 ? TSE_GIVEN_wheel_torque_front | TSE_GIVEN_wheel_torque_rear : 0;
}

static void expect_outputs(fmi2Component c, const tse_config *config, const tse_output *y, int row)
{
  char what[80];
  tse_setting mean[3], sd[3], spread[3], secant[3];
  tse_stiffness_si(config, y, mean, sd, spread);
  for (int a = 0; a < 3; a++)
    secant[a] = (tse_setting[]){ config->longitudinal_stiffness_front, config->cornering_stiffness_front,
      config->cornering_stiffness_rear }[a]
        * y->stiffness_secant[a];
  (void)snprintf(what, sizeof what, "row %d", row);
#define EXPECT_REAL(name, value) \
  TEST_ASSERT_EQUAL_HEX64_ARRAY_MESSAGE(&(double[]){ value }, &(double[]){ real_of(c, name) }, 1, what);
  int32_t count;
  const tse_field *const rows_of_y = tse_describe(TSE_STRUCT_OUTPUT, &count, NULL);
  for (int32_t k = 0; k < count; k++) {
    static const char *const stiffness[3] = { "cx_front", "cy_front", "cy_rear" };
    const char *const own = rows_of_y[k].name, *const at = (const char *)y + rows_of_y[k].offset;
    char name[80], relative[80];
    int32_t whole;
    double x;
    (void)snprintf(name, sizeof name, "estimate.%s", own);
    (void)snprintf(relative, sizeof relative, "estimate.relative.%s", own);
    memcpy(&whole, at, sizeof whole);
    if (rows_of_y[k].kind == 'r') {
      int share = 0;
      memcpy(&x, at, sizeof x);
      for (int a = 0; a < 3; a++) {
        const size_t length = strlen(stiffness[a]);
        if (strncmp(own, stiffness[a], length) != 0) continue;
        share = 1;
        EXPECT_REAL(name,
            strcmp(own + length, "_sd") == 0           ? sd[a]
                : strcmp(own + length, "_spread") == 0 ? spread[a]
                : strcmp(own + length, "_secant") == 0 ? secant[a]
                                                       : mean[a])
        EXPECT_REAL(relative, x)
      }
      if (!share) EXPECT_REAL(name, x)
    } else if (strstr(own, "_valid")) {
      TEST_ASSERT_EQUAL_INT_MESSAGE(whole == TSE_VALID, boolean_of(c, name), what);
      (void)snprintf(strstr(name, "_valid"), 8, "_reason");
      TEST_ASSERT_EQUAL_INT_MESSAGE(whole, integer_of(c, name), what);
    } else if (strstr(own, "_seen")) TEST_ASSERT_EQUAL_INT_MESSAGE(whole, boolean_of(c, name), what);
    else TEST_ASSERT_EQUAL_INT_MESSAGE(whole, integer_of(c, name), what);
  }
  TEST_ASSERT_EQUAL_INT_MESSAGE(
      y->reason[0] == TSE_VALID && y->reason[1] == TSE_VALID && y->reason[2] == TSE_VALID,
      boolean_of(c, "estimate.valid"), what);
  EXPECT_REAL("estimate.nominal.cx_front", config->longitudinal_stiffness_front)
  EXPECT_REAL("estimate.nominal.cy_front", config->cornering_stiffness_front)
  EXPECT_REAL("estimate.nominal.cy_rear", config->cornering_stiffness_rear)
}

/* Run the recorded drive, with lost channels, lost rows, standstill and reverse, through
 * an instance with its parameters set, and through a filter of this configuration: every
 * output has the bits of tse_step(). */
static void drive_measured(fmi2Component c, const tse_config *config, int measured)
{
  static tse_filter_paper memory;
  tse_filter *const filter = &memory.filter;
  static tse_params p;
  tse_output y;
  int warned = 0;
  const int n = replay_read("replay/drive.csv", rows);
  TEST_ASSERT_TRUE_MESSAGE(n > 2000, "the test runs in the directory tests");
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_prepare(config, &p, NULL));
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_reset(&p, filter, sizeof memory));
  initialized(c);
  double time = 0.0;
  for (int i = 0; i < n; i++) {
    const double next = i + 1 < n ? time + rows[i + 1].dt : time + STEP;
    tse_input u = rows[i];
    if (i > 0) u.dt = rows[i].dt;
    if (measured) measure(&u, i, config);
    put_row(c, &u);
    const fmi2Status status = fmi2DoStep(c, time, next - time, fmi2True);
    TEST_ASSERT_TRUE_MESSAGE(status == fmi2OK || status == fmi2Warning, last_line());
    static double last;
    u.dt = i > 0 ? time - last : 0.0; /* as the FMU determines it: from communication points */
    last = time;
    TEST_ASSERT_TRUE(tse_step(&p, filter, &u, &y) >= 0);
    expect_outputs(c, config, &y, i);
    warned += status == fmi2Warning;
    time = next;
  }
  TEST_ASSERT_TRUE(warned > 100 && warned < n);
  TEST_ASSERT_TRUE(filter->step > 2000
      && y.stiffness[1] != (tse_real)config->initial_cy_front); /* the estimate has changed */
  said = 0;
}

static void drive_beside(fmi2Component c, const tse_config *config) { drive_measured(c, config, 0); }

static tse_config small_config(void) /* as in initialized() */
{
  tse_config config;
  tse_config_exact(&config);
  config.particles = 60;
  return config;
}

static void test_a_recorded_drive_of_a_car_known_exactly_gives_the_bits_of_tse_step(void)
{
  tse_config config = small_config();
  config.mass = 1800, config.seed = 5;
  fmi2Component const c = instantiated();
  SET(c, { "vehicle.exact", 1 }, { "vehicle.mass", 1800 }, { "filter.seed", 5 });
  drive_beside(c, &config);
}

static void test_a_drive_with_velocities_and_pedals_gives_the_bits_of_tse_step(void)
{
  tse_config config = small_config();
  config.mass = 1800, config.velocity_latency = TSE_S(0.05), config.velocity_lever_x = TSE_S(-0.5);
  config.driven_axle = 1, config.wheel_torque_least = TSE_S(50);
  fmi2Component const c = instantiated();
  SET(c, { "vehicle.exact", 1 }, { "vehicle.mass", 1800 }, { "velocity.velocity_latency", 0.05 },
      { "velocity.velocity_lever_x", -0.5 }, { "filter.driven_axle", 1 },
      { "pedals.wheel_torque_least", 50 });
  drive_measured(c, &config, 1);
}

static void test_a_recorded_drive_of_an_ordinary_car_gives_the_bits_of_tse_step(void)
{
  tse_config config;
  tse_config_default(&config);
  config.particles = 60;
  config.mass = 1650, config.lf = 1.2, config.cornering_stiffness_rear = 140000, config.cg_sd = 0,
  config.initial_cy_front = 0.9;
  tse_config_complete(&config); /* for the output of its values */
  fmi2Component const c = instantiated();
  OK(put_real(c, "uncertainty.cg_sd", 0.0)); /* in any order */
  SET(c, { "vehicle.cornering_stiffness_rear", 140000 }, { "vehicle.lf", 1.2 }, { "vehicle.mass", 1650 },
      { "filter.initial_cy_front", 0.9 });
  drive_beside(c, &config);
}

/* ---- an uncalibrated car */

static tse_config used_by(fmi2Component c)
{
  const saved_bytes b = bytes_of(c);
  tse_config used;
  memcpy(&used, b.at + CONTENT + offsetof(model, used), sizeof used);
  free(b.at);
  return used;
}

static void expect_config(const tse_config *expected, const tse_config *got)
{
  int32_t count;
  const tse_field *const f = tse_describe(TSE_STRUCT_CONFIG, &count, NULL);
  for (int32_t i = 0; i < count; i++)
    TEST_ASSERT_EQUAL_MEMORY_MESSAGE((const char *)expected + f[i].offset, (const char *)got + f[i].offset,
        f[i].kind == 's' ? sizeof(tse_setting) : sizeof(int32_t), f[i].name);
}

static void set_every_parameter_to_its_start(fmi2Component c)
{
  for (int32_t i = 0; i < fmu_variable_count; i++) {
    const fmu_variable *const v = &fmu_variables[i];
    if (v->role == 'p') SET(c, { v->name, v->start });
  }
}

static void test_what_is_not_set_is_that_of_an_ordinary_car_and_what_is_set_wins(void)
{
  tse_config known, ordinary, got;
  tse_config_exact(&known);
  tse_config_default(&ordinary);
  tse_config_complete(&ordinary);
  TEST_ASSERT_TRUE(ordinary.mass_sd > 0.2 && known.mass_sd == 0
      && ordinary.cornering_stiffness_front != known.cornering_stiffness_front);

  fmi2Component const c = instantiated();
  OK(fmi2EnterInitializationMode(c));
  (void)real_of(c, "estimate.cy_front");
  got = used_by(c);
  expect_config(&ordinary, &got);
  TEST_ASSERT_TRUE(
      real_of(c, "vehicle.cornering_stiffness_front") == 0); /* a parameter reads as it was set */
  TEST_ASSERT_TRUE(real_of(c, "estimate.nominal.cy_front") == (double)ordinary.cornering_stiffness_front);

  OK(put_boolean(c, "vehicle.exact", fmi2True)); /* and back: nothing is lost */
  (void)real_of(c, "estimate.cy_front");
  got = used_by(c);
  expect_config(&known, &got);
  SET(c, { "vehicle.mass", 1650 }, { "vehicle.cornering_stiffness_front", 9e4 },
      { "uncertainty.mass_sd", 0.02 });
  (void)real_of(c, "estimate.cy_front");
  got = used_by(c);
  known.mass = 1650, known.cornering_stiffness_front = 9e4, known.mass_sd = TSE_S(0.02);
  expect_config(&known, &got);
  SET(c, { "vehicle.exact", 0 }, { "filter.driven_axle", 2 });
  (void)real_of(c, "estimate.cy_front");
  got = used_by(c);
  tse_config_default(&ordinary);
  ordinary.driven_axle = 2, ordinary.mass = 1650, ordinary.cornering_stiffness_front = 9e4,
  ordinary.mass_sd = TSE_S(0.02);
  tse_config_complete(&ordinary);
  expect_config(&ordinary, &got);

  OK(fmi2ExitInitializationMode(c));
  OK(fmi2Terminate(c));
  OK(fmi2Reset(c)); /* clears the marks of parameters that were set */
  begin(c);
  tse_config_default(&ordinary);
  tse_config_complete(&ordinary);
  got = used_by(c);
  expect_config(&ordinary, &got);
}

/* Some importers first set all parameters. */
static void test_an_importer_that_sets_every_parameter_to_its_start_has_set_none(void)
{
  tse_config ordinary, got;
  tse_config_default(&ordinary);
  ordinary.mass = 1650, ordinary.yaw_inertia = 2500, ordinary.cg_sd = TSE_S(0.01);
  tse_config_complete(&ordinary);
  fmi2Component const c = instantiated();
  set_every_parameter_to_its_start(c);
  SET(c, { "vehicle.mass", 1650 }, { "vehicle.yaw_inertia", 2500 }, { "uncertainty.cg_sd", 0.01 });
  initialized(c);
  got = used_by(c);
  ordinary.particles = 60;
  expect_config(&ordinary, &got);
}

/* Of an exact car, a parameter that is set to its start value keeps it, unless all
 * parameters are set: then those with their start values count as not set. */
static void test_a_start_value_counts_as_set_unless_every_parameter_is_set(void)
{
  tse_config exact, ordinary, got;
  tse_config_exact(&exact);
  tse_config_default(&ordinary);
  TEST_ASSERT_TRUE(ordinary.mass_sd > exact.mass_sd && ordinary.cg_sd > exact.cg_sd);

  fmi2Component const one = instantiated();
  SET(one, { "vehicle.exact", 1 }, { "uncertainty.mass_sd", ordinary.mass_sd });
  initialized(one);
  got = used_by(one);
  TEST_ASSERT_TRUE(got.mass_sd == ordinary.mass_sd);
  TEST_ASSERT_TRUE(got.cg_sd == exact.cg_sd && got.mass == exact.mass);

  fmi2Component const all = instantiated();
  set_every_parameter_to_its_start(all);
  SET(all, { "vehicle.exact", 1 }, { "uncertainty.cg_sd", 0.5 * ordinary.cg_sd }, { "vehicle.mass", 1650 });
  initialized(all);
  got = used_by(all);
  exact.cg_sd = 0.5 * ordinary.cg_sd; /* below and above the start value */
  exact.mass = 1650;
  exact.particles = 60;
  expect_config(&exact, &got);
}

static void test_a_car_that_cannot_be_is_refused_and_the_parameter_named(void)
{
  fmi2Component const c = instantiated();
  SET(c, { "vehicle.mass", 50.0 }, { "vehicle.lf", 0.1 }, { "vehicle.lr", 10.0 });
  OK(fmi2EnterInitializationMode(c));
  saved_bytes before = bytes_of(c);
  REFUSED(fmi2ExitInitializationMode(c), "vehicle.longitudinal_stiffness_rear",
      "a parameter of 0 follows from vehicle.mass, lf and lr");
  expect_unchanged_and_free(c, &before, "after a refused start");
  OK(put_boolean(c, "vehicle.exact", fmi2True));
  OK(fmi2ExitInitializationMode(c));
  OK(fmi2Reset(c));
  REFUSED(put_real(c, "vehicle.mass", 1.65), "vehicle.mass",
      "50 .. 50000 kg"); /* tonnes: 0 means not set; values near 0 are refused */
}

/* The prior: the start values, with at least the set uncertainty. */
static void test_before_the_first_sample_outputs_say_what_the_settings_say(void)
{
  fmi2Component const c = instantiated();
  SET(c, { "vehicle.exact", 1 }, { "filter.initial_cx_front", 0.8 }, { "filter.initial_cy_front", 0.9 },
      { "filter.initial_cy_rear", 1.1 }, { "filter.initial_cy_rear_sd", 0.25 }, { "filter.grip", 0.9 },
      { "filter.grip_sd", 0.2 });
  OK(fmi2EnterInitializationMode(c));
  TEST_ASSERT_DOUBLE_WITHIN(1e-9, 0.8, real_of(c, "estimate.relative.cx_front"));
  TEST_ASSERT_DOUBLE_WITHIN(1e-9, 0.9, real_of(c, "estimate.relative.cy_front"));
  TEST_ASSERT_DOUBLE_WITHIN(1e-9, 1.1, real_of(c, "estimate.relative.cy_rear"));
  TEST_ASSERT_DOUBLE_WITHIN(1e-3, 0.8 * 1.6e5, real_of(c, "estimate.cx_front"));
  TEST_ASSERT_DOUBLE_WITHIN(1e-3, 0.9 * 1.2e5, real_of(c, "estimate.cy_front"));
  TEST_ASSERT_DOUBLE_WITHIN(1e-3, 1.1 * 1.4e5, real_of(c, "estimate.cy_rear"));
  const double sd = real_of(c, "estimate.relative.cy_rear_sd");
  TEST_ASSERT_TRUE(sd > 0.999 * 1.1 * 0.25 && sd < 1.3 * 1.1 * 0.25);
  TEST_ASSERT_DOUBLE_WITHIN(1e-9, 0.9, real_of(c, "estimate.grip"));
  TEST_ASSERT_TRUE(
      real_of(c, "estimate.grip_sd") > 0.999 * 0.9 * 0.2 && real_of(c, "estimate.grip_sd") < 1.3 * 0.9 * 0.2);
  TEST_ASSERT_TRUE(
      real_of(c, "estimate.noise_accel_y") == 1.0 && real_of(c, "estimate.change_cy_rear") == 1.0);
  TEST_ASSERT_TRUE(real_of(c, "estimate.p_steady") > 0.99);
  TEST_ASSERT_EQUAL_INT(TSE_W_STARTING, integer_of(c, "estimate.status"));
  TEST_ASSERT_EQUAL_INT(TSE_STARTING, integer_of(c, "estimate.cy_rear_reason"));
  TEST_ASSERT_EQUAL_INT(TSE_STARTING, integer_of(c, "estimate.grip_reason"));
  TEST_ASSERT_EQUAL_INT(0, boolean_of(c, "estimate.cx_front_valid"));
  TEST_ASSERT_EQUAL_INT(0, boolean_of(c, "estimate.grip_valid"));
  TEST_ASSERT_EQUAL_INT(0, boolean_of(c, "estimate.valid"));
}

/* Wrong inputs in step k of a fault, and the expected message. */
typedef struct fault {
  const char *name;
  double value;
} fault;
static const fault faults[] = {
  { "steer_angle", (double)NAN },
  { "steer_angle", 1.3 },
  { "wheel_speed_front", (double)NAN },
  { "wheel_speed_front", 401.0 },
  { "wheel_speed_rear", -(double)INFINITY },
  { "accel_x", (double)NAN },
  { "accel_x", 50.1 },
  { "accel_y", (double)INFINITY },
  { "yaw_rate", -6.1 },
  { "yaw_rate", (double)NAN },
};

static void test_a_failing_sensor_is_a_warning_said_once(void)
{
  for (int f = 0; f < COUNT(faults); f++) {
    fmi2Component const c = stepping();
    stepped(c, 0, 30);
    said = 0;
    for (int k = 30; k < 36; k++) {
      set_inputs(c, k);
      OK(put_real(c, faults[f].name, faults[f].value));
      TEST_ASSERT_EQUAL_INT_MESSAGE(fmi2Warning, fmi2DoStep(c, k * STEP, STEP, fmi2True), faults[f].name);
      if (!strstr("steer_angle wheel_speed_front wheel_speed_rear", faults[f].name))
        TEST_ASSERT_TRUE_MESSAGE(integer_of(c, "estimate.status") >= TSE_W_MISSING_CHANNEL, faults[f].name);
    }
    TEST_ASSERT_EQUAL_INT_MESSAGE(1, said, faults[f].name);
    TEST_ASSERT_EQUAL_INT(fmi2Warning, lines[0].status);
    TEST_ASSERT_EQUAL_STRING("logStatusWarning", lines[0].category);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(lines[0].text, faults[f].name), lines[0].text);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(lines[0].text, "at 0.3 s"), lines[0].text);
    stepped(c, 36, 38); /* without fault again */
    set_inputs(c, 38);
    OK(put_real(c, faults[f].name, faults[f].value));
    TEST_ASSERT_EQUAL_INT(fmi2Warning, fmi2DoStep(c, 38 * STEP, STEP, fmi2True));
    TEST_ASSERT_EQUAL_INT_MESSAGE(2, said, "a fault that comes back is said again");
    drop(c);
  }
}

/* After max_gap the steering angle is unknown: nothing is learnt, and the reason reports
 * it. */
static void test_a_steering_angle_that_is_gone_is_not_guessed(void)
{
  fmi2Component const c = stepping();
  stepped(c, 0, 300);
  double mean[3] = { 0 };
  for (int k = 300; k < 360; k++) {
    set_inputs(c, k);
    OK(put_real(c, "steer_angle", (double)NAN));
    TEST_ASSERT_EQUAL_INT(fmi2Warning, fmi2DoStep(c, k * STEP, STEP, fmi2True));
    if (k < 330) continue; /* max_gap is 0.25 s */
    TEST_ASSERT_EQUAL_INT(TSE_INPUT_INVALID, integer_of(c, "estimate.cy_front_reason"));
    TEST_ASSERT_EQUAL_INT(0, boolean_of(c, "estimate.valid"));
    TEST_ASSERT_TRUE(integer_of(c, "estimate.status") >= TSE_W_PREDICTED);
    const double now[3] = { real_of(c, "estimate.cx_front"), real_of(c, "estimate.cy_front"),
      real_of(c, "estimate.cy_rear") };
    if (k > 330) TEST_ASSERT_EQUAL_INT(0, memcmp(mean + 1, now + 1, 2 * sizeof now[0]));
    /* The stiffness is a random walk meanwhile. The larger its possible change, the
     * larger its share of the earlier longitudinal estimate. */
    if (k > 330) TEST_ASSERT_TRUE(fabs(mean[0] - now[0]) < 1e-5 * now[0]);
    memcpy(mean, now, sizeof now);
  }
  set_inputs(c, 360);
  (void)fmi2DoStep(c, 360 * STEP, STEP, fmi2True);
  stepped(c, 361, 365);
  TEST_ASSERT_TRUE(integer_of(c, "estimate.cy_front_reason") != TSE_INPUT_INVALID);
  TEST_ASSERT_TRUE(real_of(c, "estimate.cy_front") != mean[1]);
}

static void test_of_several_missing_channels_the_first_is_named(void)
{
  fmi2Component const c = stepping();
  set_inputs(c, 0);
  SET(c, { "accel_y", (double)NAN }, { "yaw_rate", 7.0 });
  TEST_ASSERT_EQUAL_INT(fmi2Warning, fmi2DoStep(c, 0.0, STEP, fmi2True));
  TEST_ASSERT_EQUAL_INT(1, said);
  TEST_ASSERT_NOT_NULL(strstr(last_line(), "accel_y is missing"));
}

/* A new instance in the same place, or a reset, has to warn again, at standstill, too. */
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
      drop(c);
      c = instantiated();
      TEST_ASSERT_EQUAL_PTR(old, c);
    }
  }
}

/* At a limit of its range a channel is still used. */
static void test_the_ends_of_a_range_belong_to_it(void)
{
  const tse_field *const channels = tse_describe(TSE_STRUCT_INPUT, NULL, NULL) + 1;
  for (int i = 0; i < TSE_CHANNELS; i++)
    for (int k = 0; k < 2; k++) {
      fmi2Component const c = stepping();
      set_inputs(c, 0);
      OK(put_real(c, channels[i].name, k ? channels[i].hi : channels[i].lo));
      OK(fmi2DoStep(c, 0.0, STEP, fmi2True));
      drop(c);
    }
}

/* The mask is equivalent to NaN, bit for bit. Bits beyond the channels are ignored. */
static void test_the_mask_of_missing_channels_is_as_good_as_nan(void)
{
  const tse_field *const channels = tse_describe(TSE_STRUCT_INPUT, NULL, NULL) + 1;
  for (int i = 0; i < TSE_CHANNELS; i++) {
    fmi2Component const a = stepping(), b = stepping();
    for (int k = 0; k < 30; k++) {
      const int lost = k > 10 && k < 15;
      set_inputs(a, k);
      set_inputs(b, k);
      if (lost) OK(put_real(a, channels[i].name, (double)NAN));
      OK(put_integer(b, "missing", (lost ? 1 << i : 0) | (k % 2 ? 64 << k % 20 : 0)));
      const fmi2Status x = fmi2DoStep(a, k * STEP, STEP, fmi2True),
                       y = fmi2DoStep(b, k * STEP, STEP, fmi2True);
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

/* A wheel speed that is missing while the car stops and starts is one fault. It is not
 * logged again for every status in between. */
static void test_a_fault_that_lasts_is_said_once_whatever_the_car_does_meanwhile(void)
{
  fmi2Component const c = stepping();
  for (int k = 0; k < 200; k++) {
    const double speed = 7.0 + 3.0 * cos(0.05 * k); /* rad/s: above and below hold_speed, 2 m/s */
    SET(c, { "wheel_speed_front", speed + 0.001 * (k % 7) }, { "wheel_speed_rear", speed + 0.001 * (k % 5) },
        { "accel_y", (double)NAN }, { "accel_x", 0.1 * sin(7.0 * k) }, { "yaw_rate", 0.003 * sin(9.0 * k) });
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
  expect_unchanged_and_free(c, &before, "after a refused step");
  OK(fmi2DoStep(c, 3 * STEP, 3599.0, fmi2True)); /* the sample of 0.03 s */
  set_inputs(c, 4);
  TEST_ASSERT_EQUAL_INT(fmi2Warning,
      fmi2DoStep(c, 3 * STEP + 3599.0, STEP, fmi2True)); /* the next is not refused because of it */

  fmi2Component const hour = stepping();
  set_inputs(hour, 0);
  OK(fmi2DoStep(hour, 0.0, 3600.0, fmi2True)); /* the limit itself */
  TEST_ASSERT_EQUAL_INT(fmi2Warning, fmi2DoStep(hour, 3600.0, STEP, fmi2True));

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

/* After a gap the text describes the gap, though a channel is missing, too. */
static void test_a_gap_is_reported_rather_than_a_missing_channel(void)
{
  fmi2Component const c = stepping();
  stepped(c, 0, 3);
  set_inputs(c, 3);
  OK(fmi2DoStep(c, 3 * STEP, 2.0, fmi2True));
  set_inputs(c, 4);
  OK(put_real(c, "accel_y", (double)NAN));
  TEST_ASSERT_EQUAL_INT(fmi2Warning, fmi2DoStep(c, 3 * STEP + 2.0, STEP, fmi2True));
  TEST_ASSERT_EQUAL_INT(TSE_W_GAP, integer_of(c, "estimate.status"));
  TEST_ASSERT_NOT_NULL_MESSAGE(strstr(last_line(), tse_status_text(TSE_W_GAP)), last_line());
  TEST_ASSERT_NULL_MESSAGE(strstr(last_line(), "accel_y"), last_line());
}

static fmi2Component start_late(void)
{
  fmi2Component const c = instantiated();
  SET(c, { "latency.steer_angle_latency", 3 * STEP }, { "vehicle.exact", 1 });
  initialized(c);
  return c;
}

/* Waiting for a late channel is no fault: no warning, and nothing is logged. */
static void test_rows_that_wait_for_a_late_channel_are_no_warning(void)
{
  fmi2Component const c = start_late();
  for (int k = 0; k < 3; k++) {
    stepped(c, k, k + 1);
    TEST_ASSERT_EQUAL_INT(TSE_W_WAITING, integer_of(c, "estimate.status"));
  }
  stepped(c, 3, 6);
  TEST_ASSERT_TRUE(integer_of(c, "estimate.status") != TSE_W_WAITING);
  TEST_ASSERT_EQUAL_INT(0, said);
}

/* The filter processes a row three steps later, when the inputs are complete again. */
static void test_a_channel_that_was_missing_is_a_warning_in_the_step_that_processes_its_row(void)
{
  fmi2Component const c = start_late();
  for (int k = 0; k < 40; k++) {
    set_inputs(c, k);
    if (k == 30) OK(put_real(c, "accel_y", (double)NAN));
    const fmi2Status status = fmi2DoStep(c, k * STEP, STEP, fmi2True);
    TEST_ASSERT_EQUAL_INT_MESSAGE(k == 30 || k == 33 ? fmi2Warning : fmi2OK, status, last_line());
  }
  TEST_ASSERT_EQUAL_INT(2, said);
  TEST_ASSERT_NOT_NULL_MESSAGE(strstr(last_line(), tse_status_text(TSE_W_MISSING_CHANNEL)), last_line());
}

static void test_rows_without_inputs_are_a_warning_in_the_steps_that_only_predict_them(void)
{
  fmi2Component const c = start_late();
  for (int k = 0; k < 100; k++) {
    set_inputs(c, k);
    if (k >= 30 && k < 90)
      SET(c, { "wheel_speed_front", (double)NAN }, { "wheel_speed_rear", (double)NAN },
          { "accel_x", (double)NAN }, { "accel_y", (double)NAN }, { "yaw_rate", (double)NAN });
    const fmi2Status status = fmi2DoStep(c, k * STEP, STEP, fmi2True);
    if (k < 90) continue;
    TEST_ASSERT_EQUAL_INT(k < 93, integer_of(c, "estimate.status") == TSE_W_PREDICTED);
    if (k < 93) TEST_ASSERT_EQUAL_INT_MESSAGE(fmi2Warning, status, last_line());
  }
}

/* Each mask has bits for its own channels only. Further bits give no channel of another
 * group. */
static void test_bits_beyond_a_group_of_optional_channels_are_ignored(void)
{
  fmi2Component const a = stepping(), b = stepping();
  for (int k = 0; k < 200; k++) {
    set_inputs(a, k);
    set_inputs(b, k);
    for (int n = 0; n < 2; n++)
      SET(n ? a : b, { "pedals.brake", 1 }, { "pedals.wheel_torque_front", -900 },
          { "pedals.wheel_torque_rear", -400 }, { "road.bank", 0.1 }, { "road.grade", -0.1 },
          { "velocity.gnss_speed", 20 }, { "velocity.given", n ? ~15 : 0 }, { "pedals.given", n ? ~7 : 0 },
          { "road.given", n ? ~3 : 0 });
    OK(fmi2DoStep(a, k * STEP, STEP, fmi2True));
    OK(fmi2DoStep(b, k * STEP, STEP, fmi2True));
  }
  for (int32_t v = 0; v < fmu_variable_count; v++)
    if (fmu_variables[v].role == 'o')
      TEST_ASSERT_TRUE_MESSAGE(
          value_of(a, &fmu_variables[v]) == value_of(b, &fmu_variables[v]), fmu_variables[v].name);
}

/* The codes that the model description lists: those that an output can have, each type
 * from 0 on. */
typedef struct code_list {
  int32_t last; /* last code of the current type */
  char type[40];
  int types;
} code_list;

static void note_code(void *to, const char *type, int32_t code, const char *name, const char *text)
{
  code_list *const l = to;
  if (strcmp(l->type, type) != 0) {
    (void)snprintf(l->type, sizeof l->type, "%s", type);
    TEST_ASSERT_EQUAL_INT32_MESSAGE(0, code, type);
    l->types++;
  } else TEST_ASSERT_EQUAL_INT32_MESSAGE(l->last + 1, code, name);
  l->last = code;
  TEST_ASSERT_TRUE_MESSAGE(name[0] && text[0], type);
}

static void test_listed_codes_are_those_that_an_output_can_have(void)
{
  code_list l = { 0, "", 0 };
  model_list_codes(note_code, &l);
  TEST_ASSERT_EQUAL_INT(4, l.types);
  TEST_ASSERT_EQUAL_STRING("FaultChannel", l.type);
  TEST_ASSERT_EQUAL_INT32(TSE_CHANNELS + TSE_VELOCITIES, l.last); /* and 0, none */
}
