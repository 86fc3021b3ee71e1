/* tests/fuzz/run.c - run a fuzz target on stored inputs, without a fuzzer. Each line of
 * the file is an input: target, name, bytes in hexadecimal. */
#include "fuzz.h"

enum { MOST_BYTES = 1 << 16 };

/* Return the value of a hexadecimal digit; -1 for other characters. */
static int digit(char c)
{
  static const char digits[] = "0123456789abcdef";
  const char *const at = c ? strchr(digits, c) : NULL;
  return at ? (int)(at - digits) : -1;
}

/* Run the target on the rest of a line, name and bytes. Returned: 0 if it is no input */
static int through(const char *line)
{
  static uint8_t data[MOST_BYTES];
  size_t count = 0;
  const char *at = strchr(line, ' ');
  if (!at) return 0;
  for (at++; *at; at += 2) {
    const int high = digit(at[0]), low = high < 0 ? -1 : digit(at[1]);
    if (low < 0) return 0;
    data[count++] = (uint8_t)(16 * high + low);
  }
  (void)LLVMFuzzerTestOneInput(data, count);
  return 1;
}

int main(int argc, char **argv)
{
  static char line[2 * MOST_BYTES];
  int done = 0;
  FILE *const file = argc == 3 ? fopen(argv[1], "r") : NULL;
  const size_t name = file ? strlen(argv[2]) : 0;
  if (!file) return 1;
  while (fgets(line, sizeof line, file)) {
    if (strncmp(line, argv[2], name) || line[name] != ' ') continue;
    line[strcspn(line, "\r\n")] = '\0';
    (void)fprintf(stderr, "%d: %.60s\n", done + 1, line); /* after a failure, the last line names the input */
    if (!through(line + name + 1)) return 1;
    done++;
  }
  (void)fclose(file);
  (void)printf("%d inputs\n", done);
  return done == 0; /* fail without inputs */
}
