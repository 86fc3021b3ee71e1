/* tests/embedded/profile.c - plugin of qemu (interface version 1): count how often each
 * block of instructions is executed, for `scripts/dev/budgets.py --profile`. Counts only
 * between passes FROM and TO, from 0, of the instruction at MARK, the start of a row.
 *   -plugin profile.so,mark=ADDRESS,from=N,to=N,out=FILE
 *   FILE: a line per block with its address, number of instructions, executions */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* The part of qemu's plugin interface that is used. */
typedef uint64_t plugin_id;
struct qemu_plugin_tb;
typedef void (*on_translation)(plugin_id id, struct qemu_plugin_tb *tb);
typedef void (*on_execution)(unsigned int processor, void *which);
typedef void (*at_end)(plugin_id id, void *data);
extern void qemu_plugin_register_vcpu_tb_trans_cb(plugin_id id, on_translation f);
extern void qemu_plugin_register_vcpu_tb_exec_cb(
    struct qemu_plugin_tb *tb, on_execution f, int flags, void *data);
extern void qemu_plugin_register_atexit_cb(plugin_id id, at_end f, void *data);
extern size_t qemu_plugin_tb_n_insns(const struct qemu_plugin_tb *tb);
extern uint64_t qemu_plugin_tb_vaddr(const struct qemu_plugin_tb *tb);

int qemu_plugin_version = 1;

enum { BLOCKS = 1 << 16 };
typedef struct block {
  uint64_t at, instructions, times;
} block;
static block blocks[BLOCKS];
static uint64_t mark, from, to, passes;
static char out[4096];

static void executed(unsigned int processor, void *which)
{
  block *const b = which;
  (void)processor;
  if (b->at == mark) passes++;
  if (passes > from && passes <= to) b->times++;
}

static void translated(plugin_id id, struct qemu_plugin_tb *tb)
{
  const uint64_t at = qemu_plugin_tb_vaddr(tb), count = qemu_plugin_tb_n_insns(tb);
  (void)id;
  for (uint64_t k = at * 2654435761u % BLOCKS, n = 0; n < BLOCKS; k = (k + 1) % BLOCKS, n++) {
    block *const b = &blocks[k];
    if (b->instructions == 0) {
      b->at = at;
      b->instructions = count;
    }
    if (b->at != at || b->instructions != count) continue;
    qemu_plugin_register_vcpu_tb_exec_cb(tb, executed, 0, b);
    return;
  }
  (void)fprintf(stderr, "profile: more than %d blocks\n", BLOCKS);
  exit(1);
}

static void write_all(plugin_id id, void *data)
{
  FILE *const file = fopen(out, "w");
  (void)id;
  (void)data;
  if (!file) return;
  for (int k = 0; k < BLOCKS; k++)
    if (blocks[k].times)
      (void)fprintf(file, "%" PRIu64 " %" PRIu64 " %" PRIu64 "\n", blocks[k].at, blocks[k].instructions,
          blocks[k].times);
  (void)fclose(file);
}

__attribute__((visibility("default"))) int qemu_plugin_install(
    plugin_id id, const void *info, int count, char **options)
{
  (void)info;
  for (int i = 0; i < count; i++) {
    char *const value = strchr(options[i], '=');
    if (!value) return -1;
    if (strncmp(options[i], "mark=", 5) == 0) mark = strtoull(value + 1, NULL, 0);
    else if (strncmp(options[i], "from=", 5) == 0) from = strtoull(value + 1, NULL, 0);
    else if (strncmp(options[i], "to=", 3) == 0) to = strtoull(value + 1, NULL, 0);
    else if (strncmp(options[i], "out=", 4) == 0) (void)snprintf(out, sizeof out, "%s", value + 1);
    else return -1;
  }
  qemu_plugin_register_vcpu_tb_trans_cb(id, translated);
  qemu_plugin_register_atexit_cb(id, write_all, NULL);
  return 0;
}
