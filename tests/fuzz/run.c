/* tests/fuzz/run.c - a fuzz target without a fuzzer: through the files that it is given, or a list of them (@FILE, a line each). */
#include "fuzz.h"

static int through(const char *path)
{
  static uint8_t data[1 << 20];
  FILE *const file = fopen(path, "rb");
  if (!file) {
    (void)fprintf(stderr, "fuzz: %s cannot be read\n", path);
    return 0;
  }
  const size_t count = fread(data, 1, sizeof data, file);
  (void)fclose(file);
  (void)fprintf(stderr, "%s\n", path); /* the last one is that which breaks it */
  (void)LLVMFuzzerTestOneInput(data, count);
  return 1;
}

int main(int argc, char **argv)
{
  int done = 0;
  for (int i = 1; i < argc; i++) {
    char line[4096];
    FILE *const list = argv[i][0] == '@' ? fopen(argv[i] + 1, "r") : NULL;
    if (argv[i][0] != '@') {
      if (!through(argv[i])) return 1;
      done++;
    } else if (!list) return 1;
    while (list && fgets(line, sizeof line, list)) {
      line[strcspn(line, "\r\n")] = '\0';
      if (!line[0]) continue;
      if (!through(line)) return 1;
      done++;
    }
    if (list) (void)fclose(list);
  }
  (void)printf("%d inputs\n", done);
  return done == 0; /* nothing to go through is no test */
}
