/* tests/embedded/host.c - implement port.h on a system with a C library.
 *   FLUSH_DENORMALS   treat denormal numbers as zero (FTZ, DAZ), as some processors and
 *                     threads of audio software do */
#include <stdio.h>
#if defined(FLUSH_DENORMALS)
#include <xmmintrin.h>
#endif

#include "port.h"

void port_say(const char *text) { (void)fputs(text, stdout); }
uint32_t port_instructions(void) { return 0; }
uint32_t port_stack(void) { return 0; }

int main(void)
{
#if defined(FLUSH_DENORMALS)
  _mm_setcsr(_mm_getcsr() | 0x8040u);
#endif
  return program();
}
