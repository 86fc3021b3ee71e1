/* tests/embedded/port.h - functions that a machine provides to the test programs:
 * host.c, cortex_m.c, wasm.c. */
#ifndef PORT_H
#define PORT_H

#include <stdint.h>

/* Print a text. */
void port_say(const char *text);

/* Return the number of instructions since the start, modulo 2^32; 0 if not counted. */
uint32_t port_instructions(void);

/* Return the bytes of stack written since the last call, below the caller; 0 if not
 * measured. */
uint32_t port_stack(void);

/* With PERIOD_MS, in cortex_m.c only: the program's function for the timer interrupt, and
 * the number of instructions between two interrupts. */
void port_period(void);
uint32_t port_period_instructions(void);

/* Run the test program.   Returned: 0 on success */
int program(void);

static inline void say_number(const char *before, uint32_t n)
{
  char text[12], *at = text + sizeof text - 1;
  *at = 0;
  do *--at = (char)('0' + n % 10u);
  while ((n /= 10u) != 0);
  port_say(before);
  port_say(at);
}

static inline void say_hash(const char *before, uint64_t hash)
{
  char text[17];
  for (int i = 0; i < 16; i++) text[i] = "0123456789abcdef"[hash >> (60 - 4 * i) & 15u];
  text[16] = 0;
  port_say(before);
  port_say(text);
}

#endif
