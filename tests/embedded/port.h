/* tests/embedded/port.h - what a machine has to offer so that a program says what it
 * found: host.c, cortex_m.c, wasm.c. */
#ifndef PORT_H
#define PORT_H

#include <stdint.h>

/* Text goes to whoever started the machine. */
void port_say(const char *text);

/* Instructions executed since the start, modulo 2^32; 0 where they are not counted. */
uint32_t port_instructions(void);

/* Bytes of stack that have been written since the last call, below the caller; 0 where it
 * cannot be seen. */
uint32_t port_stack(void);

/* Only cortex_m.c with PERIOD_MS: who is called in the timer's interrupt, and how many
 * instructions there are between two. */
void port_period(void);
uint32_t port_period_instructions(void);

/* What the program is.   Returned: 0 when it went well */
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
