/* tests/unit/estimator/test_replay.c - a recorded drive gives the golden estimates, bit
 * for bit, for all compilers, options and vector widths. To change them on purpose:
 * tests/replay/update.py. */
#include "unit_support.h"
#include "replay.h"

#if defined(TSE_REAL_FLOAT)
#define GOLDEN "replay/golden_float.csv"
#elif defined(TSE_REAL_FIXED)
#define GOLDEN "replay/golden_fixed.csv"
#else
#define GOLDEN "replay/golden_double.csv"
#endif

static tse_input rows[REPLAY_ROWS_MOST];
static double table[REPLAY_ROWS_MOST / REPLAY_EVERY + 1][REPLAY_COLUMNS];
static double golden[REPLAY_ROWS_MOST / REPLAY_EVERY + 1][REPLAY_COLUMNS];
static uint64_t golden_hash[REPLAY_HASHES];
static int row_count, golden_rows, hashes;

static void read_golden(void)
{
  char line[2048];
  FILE *const file = fopen(GOLDEN, "r");
  hashes = golden_rows = 0;
  TEST_ASSERT_NOT_NULL_MESSAGE(file, "the test runs in the directory tests");
  while (fgets(line, sizeof line, file)) {
    if (strncmp(line, "# hash ", 7) == 0 && hashes < REPLAY_HASHES) {
      char high[9] = { 0 };
      memcpy(high, line + 7, 8);
      golden_hash[hashes++] = (uint64_t)strtoul(high, NULL, 16) << 32
          | (uint64_t)strtoul(line + 15, NULL, 16);
    } else if (line[0] >= '0' && line[0] <= '9' && golden_rows < ROWS(golden)) {
      char *at = strchr(line, ',');
      for (int k = 0; at && k < REPLAY_COLUMNS; k++) golden[golden_rows][k] = strtod(at + 1, &at);
      golden_rows++;
    }
  }
  (void)fclose(file);
}

static void test_the_drive_holds_what_it_should(void)
{
  double seconds = 0.0, longest = 0.0;
  int lost[TSE_CHANNELS] = { 0 };
  for (int i = 0; i < row_count; i++) {
    const tse_input *const u = &rows[i];
    const double channel[TSE_CHANNELS] = { number(u->steer_angle), number(u->wheel_speed_front),
      number(u->wheel_speed_rear), number(u->accel_x), number(u->accel_y), number(u->yaw_rate) };
    seconds += number(u->dt);
    longest = fmax(longest, number(u->dt));
    for (int k = 0; k < TSE_CHANNELS; k++) lost[k] += isnan(channel[k]) != 0;
  }
  TEST_ASSERT_TRUE(seconds > 29.0 && longest > 0.3);
  for (int k = 0; k < TSE_CHANNELS; k++) TEST_ASSERT_TRUE(lost[k] > 0 && lost[k] < row_count);
}

static void test_estimates_are_the_golden_ones_in_all_printed_digits(void)
{
  TEST_ASSERT_TRUE(replay_run(rows, row_count, 0, 0, table, NULL) != 0);
  TEST_ASSERT_EQUAL_INT((row_count + REPLAY_EVERY - 1) / REPLAY_EVERY, golden_rows);
  for (int i = 0; i < golden_rows; i++)
    for (int k = 0; k < REPLAY_COLUMNS; k++)
      expect_near(golden[i][k], table[i][k], BY_FORMAT(1e-11, 1e-8) * fabs(golden[i][k]),
          replay_outputs[k].name, i * REPLAY_EVERY);
}

static void test_all_outputs_have_the_golden_bits_with_every_resampling_scheme(void)
{
  TEST_ASSERT_EQUAL_INT(REPLAY_HASHES, hashes);
  for (int k = 0; k < REPLAY_HASHES; k++) {
    const int form = k / REPLAY_SCHEMES, scheme = k % REPLAY_SCHEMES;
    TEST_ASSERT_EQUAL_HEX64_MESSAGE(
        golden_hash[k], replay_run(rows, row_count, form, scheme, NULL, NULL), replay_forms[form].name);
  }
}

/* The golden bits must cover all paths through a step. No row of this drive diverges. */
static void test_every_warning_but_recovery_is_met_on_the_way(void)
{
  int of_any[REPLAY_STATUSES] = { 0 };
  for (int form = 0; form < REPLAY_FORMS; form++) {
    int met[REPLAY_STATUSES] = { 0 };
    TEST_ASSERT_TRUE(replay_run(rows, row_count, form, 0, NULL, met) != 0);
    for (int status = TSE_W_STARTING; status <= TSE_W_GAP; status++)
      TEST_ASSERT_TRUE_MESSAGE(met[status] > 0, tse_status_text(status));
    for (int status = 0; status < REPLAY_STATUSES; status++) of_any[status] += met[status];
    TEST_ASSERT_EQUAL_INT(0, met[TSE_W_RECOVERED]);
  }
  /* Rows with all stiffnesses valid, and rows with an invalid one: few filters have
   * both. */
  TEST_ASSERT_TRUE(of_any[TSE_OK] > 0 && of_any[TSE_W_NOT_VALID] > 0);
}

/* A missing channel has no effect, whatever its field holds: here its previous value, as
 * on a bus. */
static void test_a_bit_says_missing_as_well_as_nan(void)
{
  static tse_input told[REPLAY_ROWS_MOST];
  tse_input last = { 0 };
  for (int i = 0; i < row_count; i++) {
    told[i] = rows[i];
    for (int k = 0; k < TSE_CHANNELS; k++) { /* neighbouring members */
      const tse_real *const now = &rows[i].steer_angle + k;
      if (*now == *now) continue;
      (&told[i].steer_angle)[k] = (&last.steer_angle)[k];
      told[i].missing |= 1u << k;
    }
    last = told[i];
  }
  for (int form = 0; form < REPLAY_FORMS; form++)
    TEST_ASSERT_EQUAL_HEX64_MESSAGE(golden_hash[form * REPLAY_SCHEMES],
        replay_run(told, row_count, form, 0, NULL, NULL), replay_forms[form].name);
}

void suiteSetUp(void)
{
  row_count = replay_read("replay/drive.csv", rows);
  read_golden();
}
