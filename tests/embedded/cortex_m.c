/* tests/embedded/cortex_m.c - implement port.h for a Cortex-M under qemu-system-arm:
 * startup, semihosting, SysTick. All code is in this folder, without a board support
 * package. Memory layout: cortex_m.ld. */
#include <stddef.h>

#include "port.h"

extern uint32_t stack_top[], stack_bottom[], data_from[], data_start[], data_end[], bss_start[], bss_end[];

enum { SYS_WRITE0 = 4, SYS_EXIT = 0x18 }; /* Arm: Semihosting for AArch32 and AArch64 */
#define EXIT_WELL 0x20026u                /* ADP_Stopped_ApplicationExit    */
#define EXIT_BADLY 0x20024u               /* ADP_Stopped_InternalError      */

static void semihost(uint32_t what, uint32_t with)
{
  register uint32_t r0 __asm__("r0") = what;
  register uint32_t r1 __asm__("r1") = with;
  __asm__ volatile("bkpt 0xab" : "+r"(r0) : "r"(r1) : "memory");
}

void port_say(const char *text) { semihost(SYS_WRITE0, (uint32_t)text); }

/* ---- instructions. With -icount shift=6, each takes 64 ns of emulated time. SysTick
 * counts this time in cycles of the processor's clock. */

#define SYST_CSR (*(volatile uint32_t *)0xe000e010u)
#define SYST_RVR (*(volatile uint32_t *)0xe000e014u)
#define SYST_CVR (*(volatile uint32_t *)0xe000e018u)
#define NS_OF_INSTRUCTION (1u << ICOUNT_SHIFT)
#ifndef ICOUNT_SHIFT
#define ICOUNT_SHIFT 6
#endif
#ifndef NS_OF_TICK /* [0.25 ns] period of the processor's clock; 160: 25 MHz */
#define NS_OF_TICK 160u
#endif

#if defined(PERIOD_MS) /* the program has a timer; the period must fit the 24 bits of SysTick */
#define SYST_FULL (PERIOD_MS * 4000000u / NS_OF_TICK - 1u)
#else
#define SYST_FULL 0xffffffu
void port_period(void) {}
#endif

static volatile uint32_t wraps;

static void on_systick(void)
{
  wraps++;
  port_period();
}

uint32_t port_period_instructions(void) { return (SYST_FULL + 1u) / 4u * NS_OF_TICK / NS_OF_INSTRUCTION; }

uint32_t port_instructions(void)
{
  uint32_t before, now;
  do {
    before = wraps;
    now = SYST_CVR;
  } while (before != wraps);
  const uint64_t ticks = (uint64_t)before * (SYST_FULL + 1u) + (SYST_FULL - now);
  return (uint32_t)(ticks * NS_OF_TICK / (4u * NS_OF_INSTRUCTION));
}

/* ---- stack */

#define PAINT 0xa5a5a5a5u

uint32_t port_stack(void)
{
  uint32_t *const here = (uint32_t *)__builtin_frame_address(0), *at = stack_bottom;
  while (at < here && *at == PAINT) at++;
  const uint32_t used = (uint32_t)((const char *)here - (const char *)at);
  for (uint32_t *paint = stack_bottom; paint < here - 16; paint++) *(volatile uint32_t *)paint = PAINT;
  return used;
}

/* Place of errno, which newlib's sqrt sets for negative arguments. newlib's own would
 * link 1 kB of other code. */
int *__errno(void);
int *__errno(void)
{
  static int nobody_asks;
  return &nobody_asks;
}

/* ---- start */

static void failed(void)
{
  port_say("fault: the processor took an exception\n");
  semihost(SYS_EXIT, EXIT_BADLY);
  for (;;) {}
}

static void start(void)
{
  const uint32_t *from = data_from;
  for (uint32_t *to = data_start; to < data_end; to++) *to = *from++;
  for (uint32_t *to = bss_start; to < bss_end; to++) *to = 0;
#if defined(__ARM_FP)
  *(volatile uint32_t *)0xe000ed88u |= 0xfu << 20; /* CPACR: enable the floating-point unit */
  __asm__ volatile("dsb\n isb");
#endif
  SYST_RVR = SYST_FULL;
  SYST_CVR = 0;
  SYST_CSR = 7; /* enable, with interrupt, processor clock */
  semihost(SYS_EXIT, program() == 0 ? EXIT_WELL : EXIT_BADLY);
  for (;;) {}
}

__attribute__((section(".vectors"), used)) static const void *const vectors[16] = {
  stack_top,
  (const void *)start,
  (const void *)failed,
  (const void *)failed,
  (const void *)failed,
  (const void *)failed,
  (const void *)failed,
  (const void *)failed,
  NULL,
  NULL,
  NULL,
  (const void *)failed,
  (const void *)failed,
  NULL,
  (const void *)failed,
  (const void *)on_systick,
};
