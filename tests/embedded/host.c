/* tests/embedded/host.c - port.h on a system with a C library. */
#include <stdio.h>

#include "port.h"

void port_say(const char *text) { (void)fputs(text, stdout); }
uint32_t port_instructions(void) { return 0; }
uint32_t port_stack(void) { return 0; }
int main(void) { return program(); }
