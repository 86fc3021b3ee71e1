/* tests/fmu/unit/test_vehicle.c - SingleTrackVehicle, compared with tse_sim_step();
 * ramps, derivatives of inputs, wrong inputs. */
#include "fmu_case.h"
#include "tse/describe.h"

static tse_config config;
static tse_sim_config sim_config;
static tse_sim sim;

static void put_inputs(fmi2Component c, const tse_sim_input *u)
{
  for (const fmu_variable *v = fmu_variables; v->role == 'i'; v++)
    OK(put_real(c, v->name, (&u->steer_angle)[v - fmu_variables])); /* neighbouring members */
}

static tse_sim_input input_of(int k)
{
  tse_sim_input u = { 0 };
  u.dt = STEP, u.steer_angle = 0.02 * sin(0.13 * k);
  u.wheel_torque_front = k % 50 < 25 ? 700.0 : -700.0;
  u.wheel_torque_rear = 100.0 * cos(0.3 * k);
  u.brake_torque_front = k % 10 == 3 ? 200.0 : 0.0;
  u.brake_torque_rear = 5.0 * (k % 4);
  u.road_level = k < 60 ? 1.0 : 0.7;
  u.road_friction = k < 40 ? 0.0 : 0.3;
  return u;
}

static void expect_real(fmi2Component c, const char *name, double expected, int k)
{
  char what[160];
  const double value = real_of(c, name);
  (void)snprintf(what, sizeof what, "%s, step %d: %.17g, expected %.17g", name, k, value, expected);
  TEST_ASSERT_TRUE_MESSAGE(memcmp(&value, &expected, sizeof value) == 0, what);
}

static void expect_outputs(fmi2Component c, const tse_sim_output *y, int k)
{
  const double nominal[3] = { config.longitudinal_stiffness_front, config.cornering_stiffness_front,
    config.cornering_stiffness_rear };
#define mean_si(i) nominal[i] * y->stiffness[i]
#define drawn_si(i) nominal[i] * y->drawn[i]
  for (int i = 0; i < TSE_CHANNELS; i++) {
    char name[40];
    (void)snprintf(name, sizeof name, "sensor.%s", tse_describe(TSE_STRUCT_INPUT, NULL, NULL)[1 + i].name);
    expect_real(c, name, (&y->row.steer_angle)[i], k);
  }
  int32_t count;
  const tse_field *const row = tse_describe(TSE_STRUCT_SIM_OUTPUT, &count, NULL);
  for (int32_t i = TSE_CHANNELS; i < count; i++) { /* after the sensors: true_vel_x, drawn_cx_front ... */
    const size_t group = strcspn(row[i].name, "_");
    const char *const own = row[i].name + group + 1;
    const int share = strcmp(own, "cx_front") == 0 || strcmp(own, "cy_front") == 0
        || strcmp(own, "cy_rear") == 0;
    char name[60];
    double x;
    memcpy(&x, (const char *)y + row[i].offset, sizeof x);
    (void)snprintf(name, sizeof name, "%.*s%s.%s", (int)group, row[i].name, share ? ".relative" : "", own);
    expect_real(c, name, x, k);
  }
  expect_real(c, "true.cx_front", mean_si(0), k);
  expect_real(c, "true.cy_front", mean_si(1), k);
  expect_real(c, "true.cy_rear", mean_si(2), k);
  expect_real(c, "drawn.cx_front", drawn_si(0), k);
  expect_real(c, "drawn.cy_front", drawn_si(1), k);
  expect_real(c, "drawn.cy_rear", drawn_si(2), k);
}

/* Both with settings that differ from the defaults, at the start with the inputs of row
 * 0. */
static fmi2Component start_both(tse_sim_output *y)
{
  const tse_sim_input u = input_of(0);
  fmi2Component const c = instantiated();
  tse_config_exact(&config);
  tse_sim_config_default(&sim_config);
  config.mass = 1700, config.accel_x_sd = 0.2;
  config.rear_longitudinal_follows_front = 0.4; /* otherwise the road under the rear axle has no effect */
  sim_config.seed = 9, sim_config.speed = 15, sim_config.bias_walk = 2, sim_config.true_bias_accel_y = 0.1;
  sim_config.true_cy_rear = 0.9;
  SET(c, { "vehicle.mass", 1700 }, { "sensors.accel_x_sd", 0.2 },
      { "vehicle.rear_longitudinal_follows_front", 0.4 }, { "simulation.seed", 9 },
      { "simulation.speed", 15 }, { "simulation.bias_walk", 2 }, { "simulation.true_bias_accel_y", 0.1 },
      { "simulation.true_cy_rear", 0.9 });
  put_inputs(c, &u);
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_sim_reset(&sim, &config, &sim_config, NULL));
  TEST_ASSERT_EQUAL_INT(TSE_OK, tse_sim_step(&sim, &u, y));
  return c;
}

static void go(fmi2Component c)
{
  OK(fmi2SetupExperiment(c, fmi2False, 0, 0, fmi2False, 0));
  begin(c);
}

/* An importer sets the inputs at t and steps to t + h. With ramp, they change linearly
 * from the previous inputs and reach these values at t + h. */
static void test_with_ramp_every_output_has_the_bits_of_the_simulator(void)
{
  tse_sim_output y;
  fmi2Component const c = start_both(&y);
  go(c);
  expect_outputs(c, &y, -1);
  double time = 0;
  for (int k = 0; k < 120; k++) {
    tse_sim_input u = input_of(k + 1);
    u.dt = k % 3 == 2 ? 0.025 : STEP; /* variable communication steps */
    put_inputs(c, &u);
    OK(fmi2DoStep(c, time, u.dt, fmi2True));
    TEST_ASSERT_EQUAL_INT(TSE_OK, tse_sim_step(&sim, &u, &y));
    expect_outputs(c, &y, k);
    time += u.dt;
  }
}

/* The driver jumps at the start of a step. The road of a step is that for which its
 * stiffness was drawn. */
static void jump(const tse_sim_input *u)
{
  const tse_real level = sim.last.road_level, friction = sim.last.road_friction;
  sim.last = *u, sim.last.road_level = level, sim.last.road_friction = friction;
}

/* Held inputs: the inputs set at t act during the whole step, as in a simulator that gets
 * them twice. */
static void test_without_ramp_inputs_are_held_during_the_step(void)
{
  tse_sim_output y;
  fmi2Component const c = start_both(&y);
  OK(put_boolean(c, "ramp", fmi2False));
  go(c);
  expect_outputs(c, &y, -1);
  for (int k = 0; k < 120; k++) {
    const tse_sim_input u = input_of(k + 1);
    put_inputs(c, &u);
    OK(fmi2DoStep(c, k * STEP, STEP, fmi2True));
    jump(&u);
    TEST_ASSERT_EQUAL_INT(TSE_OK, tse_sim_step(&sim, &u, &y));
    expect_outputs(c, &y, k);
  }
}

/* The friction of the road changes at a row: the step that ends there is not affected,
 * but the forces at the row are, and with them the next step. Other than of the road, the
 * new value of the steering angle acts on this step. */
static void test_a_new_friction_of_the_road_acts_from_its_row_on(void)
{
  for (int ramp = 0; ramp < 2; ramp++) {
    fmi2Component const dry = instantiated(), wet = instantiated();
    for (int n = 0; n < 2; n++) {
      SET(n ? wet : dry, { "ramp", ramp }, { "simulation.noise", 0 }, { "steer_angle", 0.05 },
          { "road_friction", 1.0 });
      go(n ? wet : dry);
    }
    for (int k = 0; k < 100; k++) {
      OK(fmi2DoStep(dry, k * STEP, STEP, fmi2True));
      OK(fmi2DoStep(wet, k * STEP, STEP, fmi2True));
    }
    OK(put_real(wet, "road_friction", 0.3));
    OK(fmi2DoStep(dry, 1.0, STEP, fmi2True));
    OK(fmi2DoStep(wet, 1.0, STEP, fmi2True));
    TEST_ASSERT_TRUE(real_of(wet, "true.vel_y") == real_of(dry, "true.vel_y"));
    TEST_ASSERT_TRUE(real_of(wet, "true.yaw_rate") == real_of(dry, "true.yaw_rate"));
    TEST_ASSERT_TRUE(real_of(wet, "sensor.accel_y") < real_of(dry, "sensor.accel_y") - 1.0);
    OK(fmi2DoStep(dry, 1.01, STEP, fmi2True));
    OK(fmi2DoStep(wet, 1.01, STEP, fmi2True));
    TEST_ASSERT_TRUE(real_of(wet, "true.vel_y") < real_of(dry, "true.vel_y") - 0.01);
    drop(wet);
    drop(dry);
  }
}

/* A car rolls straight, with a constant torque on wheels of known inertia: its total mass
 * is accelerated by T/R. Held, a torque set at t acts from t on: after n steps for n
 * steps. As a ramp from zero, the first step has half of it. */
static void test_a_held_torque_acts_from_its_communication_point_on(void)
{
  const double torque = 330.0, radius = 0.33, mass = 1900.0, inertia = 2 * 2.4;
  const double gain = torque / radius / (mass + inertia / (radius * radius));
  double speed[2];
  for (int ramp = 0; ramp < 2; ramp++) {
    fmi2Component const c = instantiated();
    SET(c, { "ramp", ramp ? fmi2True : fmi2False }, { "simulation.spread_cx_front", 0 });
    go(c);
    for (int k = 0; k < 200; k++) {
      OK(put_real(c, "wheel_torque_front", torque));
      OK(fmi2DoStep(c, k * STEP, STEP, fmi2True));
    }
    speed[ramp] = real_of(c, "true.vel_x") - 20.0;
  }
  const double expected = gain * 200 * STEP;
  TEST_ASSERT_TRUE(fabs(speed[0] - expected) < 0.01 * expected); /* slip builds up in the first steps */
  TEST_ASSERT_TRUE(fabs((speed[0] - speed[1]) - 0.5 * STEP * gain) < 0.02 * STEP * gain);
}

/* ---- derivatives of inputs */

static fmi2Status put_rate(fmi2Component c, const char *name, double rate)
{
  const fmi2ValueReference vr = ref(name);
  const fmi2Integer order = 1;
  return fmi2SetRealInputDerivatives(c, &vr, 1, &order, &rate);
}

static void test_a_derivative_says_where_an_input_is_at_the_end_of_the_step(void)
{
  static const double rates[] = { 0.3, -5000.0, 250.0, 20.0, 40.0, 0.1 };
  tse_sim_output y;
  fmi2Component const c = start_both(&y);
  double time = 0;
  OK(put_boolean(c, "ramp", fmi2False));
  go(c);
  for (int k = 0; k < 60; k++) {
    tse_sim_input u = input_of(k + 1);
    u.dt = k % 3 == 2 ? 0.025 : STEP; /* variable communication steps */
    tse_sim_input to = u;
    put_inputs(c, &u);
    jump(&u);
    if (k % 4
        != 3) { /* without a derivative an input is held; a derivative holds for one communication point */
      for (int n = 0; n < COUNT(rates); n++) { /* neighbouring members */
        OK(put_rate(c, fmu_variables[n].name, rates[n]));
        (&to.steer_angle)[n] += u.dt * rates[n];
      }
    }
    OK(fmi2DoStep(c, time, u.dt, fmi2True));
    time += u.dt;
    TEST_ASSERT_EQUAL_INT(TSE_OK, tse_sim_step(&sim, &to, &y));
    expect_outputs(c, &y, k);
    expect_real(c, "steer_angle", u.steer_angle, k); /* the value set is unchanged */
  }
}

static void test_derivatives_that_are_none_are_refused_and_none_of_several_is_set(void)
{
  fmi2Component const c = instantiated();
  go(c);
  OK(put_rate(c, "steer_angle", 0.1));
  saved_bytes before = bytes_of(c);
  const fmi2ValueReference vr[] = { ref("wheel_torque_front"), ref("steer_angle") };
  const fmi2Integer orders[] = { 1, 2 }, first[] = { 1, 1 };
  const fmi2Real values[] = { 100.0, 0.2 }, nan_value[] = { 100.0, (double)NAN };
  REFUSED(
      fmi2SetRealInputDerivatives(c, vr, 2, orders, values), "steer_angle takes no derivative of order 2");
  REFUSED(fmi2SetRealInputDerivatives(c, vr, 2, first, nan_value), "steer_angle");
  const fmi2ValueReference output[] = { ref("wheel_torque_front"), ref("true.vel_x") },
                           integer[] = { ref("steer_angle"), ref("simulation.seed") };
  REFUSED(fmi2SetRealInputDerivatives(c, output, 2, first, values), "true.vel_x takes no derivative");
  REFUSED(fmi2SetRealInputDerivatives(c, integer, 2, first, values), "simulation.seed", "is of type Integer");
  REFUSED(put_rate(c, "vehicle.mass", 1.0), "vehicle.mass takes no derivative");
  const fmi2Integer zero = 0;
  REFUSED(fmi2SetRealInputDerivatives(c, vr, 1, &zero, values), "order 0");
  expect_unchanged_and_free(c, &before, "after refused derivatives");
}

/* ---- wrong inputs */

static void test_a_wrong_input_is_an_error_that_names_it_and_changes_nothing(void)
{
  static const struct {
    const char *name;
    double value;
  } wrong[] = {
    { "steer_angle", (double)NAN },
    { "steer_angle", 1.21 },
    { "wheel_torque_front", (double)INFINITY },
    { "wheel_torque_rear", -1.1e5 },
    { "brake_torque_front", -1.0 },
    { "brake_torque_rear", (double)NAN },
    { "road_level", 0.0 },
    { "road_level", (double)NAN },
    { "road_level", 11.0 },
  };
  fmi2Component const c = stepping(), twin = stepping();
  stepped(c, 0, 5);
  stepped(twin, 0, 10);
  for (int i = 0; i < COUNT(wrong); i++) {
    set_inputs(c, 5);
    const fmi2ValueReference vr = ref(wrong[i].name);
    fmi2Real was;
    OK(fmi2GetReal(c, &vr, 1, &was));
    OK(put_real(c, wrong[i].name, wrong[i].value));
    saved_bytes before = bytes_of(c);
    REFUSED(fmi2DoStep(c, 5 * STEP, STEP, fmi2True), "fmi2DoStep", wrong[i].name, "outside its range");
    expect_unchanged_and_free(c, &before, wrong[i].name);
    OK(put_real(c, wrong[i].name, was));
  }
  stepped(c, 5, 10);
  expect_same_and_free(bytes_of(c), bytes_of(twin), "went on after refusals");
}

static void test_a_derivative_that_leads_out_of_range_is_an_error_too(void)
{
  fmi2Component const c = stepping();
  stepped(c, 0, 5);
  set_inputs(c, 5);
  OK(put_rate(c, "steer_angle", 1e3));
  saved_bytes before = bytes_of(c);
  REFUSED(fmi2DoStep(c, 5 * STEP, STEP, fmi2True), "steer_angle");
  expect_unchanged_and_free(c, &before, "a derivative out of range");
  OK(put_real(c, "steer_angle", 1.25)); /* a derivative that leads back into the range does not help */
  OK(put_rate(c, "steer_angle", -20.0));
  REFUSED(fmi2DoStep(c, 5 * STEP, STEP, fmi2True), "steer_angle");
  OK(put_real(c, "steer_angle", 0.0));
  OK(put_rate(c, "steer_angle", 0.0));
  OK(fmi2DoStep(c, 5 * STEP, STEP, fmi2True));
}

static void test_ends_of_ranges_are_taken_and_steps_up_to_a_second(void)
{
  fmi2Component const c = stepping();
  SET(c, { "steer_angle", 1.2 }, { "wheel_torque_front", -1e5 }, { "brake_torque_rear", 1e5 },
      { "road_level", 0.02 });
  OK(fmi2DoStep(c, 0.0, 1.0, fmi2True));
  saved_bytes before = bytes_of(c);
  REFUSED(fmi2DoStep(c, 1.0, nextafter(1.0, 2.0), fmi2True), "communicationStepSize", "longer than 1 s");
  expect_unchanged_and_free(c, &before, "too long a step");
  OK(fmi2DoStep(c, 1.0, 1e-5, fmi2True));
}

static void test_wrong_inputs_and_settings_at_the_start_are_refused_by_name(void)
{
  fmi2Component const c = instantiated();
  OK(put_real(c, "road_level", (double)NAN));
  OK(fmi2EnterInitializationMode(c));
  REFUSED(fmi2ExitInitializationMode(c), "fmi2ExitInitializationMode", "road_level", "0.02 .. 10");
  TEST_ASSERT_NULL(strstr(last_line(), "10 1")); /* ranges of ratios have no unit */
  fmi2Real value;
  const fmi2ValueReference vr = ref(AN_OUTPUT);
  REFUSED(fmi2GetReal(c, &vr, 1, &value), "fmi2GetReal", "road_level");
  OK(put_real(c, "road_level", 1.0));
  OK(fmi2ExitInitializationMode(c));
}

/* Each parameter is in its range, but together they are no formula: operation 255 does
 * not exist. */
static void test_parameters_that_do_not_fit_together_are_refused_by_name_at_the_start(void)
{
  fmi2Component const c = instantiated();
  SET(c, { "effects.formula_gain", 1 }, { "effects.formula_code_1", 255 });
  OK(fmi2EnterInitializationMode(c));
  saved_bytes before = bytes_of(c);
  REFUSED(fmi2ExitInitializationMode(c), "fmi2ExitInitializationMode", "effects.formula_code_1",
      tse_status_text(TSE_E_CONFIG));
  expect_unchanged_and_free(c, &before, "after a refused start");
  OK(put_integer(c, "effects.formula_code_1", 0));
  OK(put_real(c, "effects.formula_gain", 0));
  OK(fmi2ExitInitializationMode(c));
}
