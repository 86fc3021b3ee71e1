/* tests/fuzz/run.c - a fuzz target without a fuzzer: through its inputs in a file, a line
 * each: target, name, bytes in hexadecimal. */
#include "fuzz.h"

enum { MOST_BYTES = 1 << 16 };

/* Return the value of a hexadecimal digit; -1 if it is none. */
static int digit(char c)
{
  static const char digits[] = "0123456789abcdef";
  const char *const at = c ? strchr(digits, c) : NULL;
  return at ? (int)(at - digits) : -1;
}

/* Return 1 if the rest of a line, name and bytes, was an input and the target has gone
 * through it. */
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
    (void)fprintf(stderr, "%d: %.60s\n", done + 1, line); /* the last one is that which breaks it */
    if (!through(line + name + 1)) return 1;
    done++;
  }
  (void)fclose(file);
  (void)printf("%d inputs\n", done);
  return done == 0; /* nothing to go through is no test */
}
