/* tests/embedded/wasm.c - implement port.h in WebAssembly, which wasm.js runs. There is
 * no C library: wasm/string.h has the functions that compilers call. */
#define WASM_STRING
#include <string.h>

#include "port.h"

__attribute__((import_module("port"), import_name("say"))) void page_say(const char *text);

void port_say(const char *text) { page_say(text); }
uint32_t port_instructions(void) { return 0; }
uint32_t port_stack(void) { return 0; }

__attribute__((export_name("run"))) int run(void) { return program(); }
