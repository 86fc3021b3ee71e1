/* The functions of string.h that the library uses, without a C library. Define
 * WASM_STRING in one file of a program. */
#include <stddef.h>
void *memset(void *to, int byte, size_t count);
void *memcpy(void *restrict to, const void *restrict from, size_t count);
void *memmove(void *to, const void *from, size_t count);
int memcmp(const void *a, const void *b, size_t count);
size_t strlen(const char *text);

#if defined(WASM_STRING)
void *memset(void *to, int byte, size_t count)
{
  unsigned char *const at = to;
  for (size_t i = 0; i < count; i++)
    ((volatile unsigned char *)at)[i] = (unsigned char)
        byte; /* volatile: the compiler must not replace the loop by memset */
  return to;
}

void *memcpy(void *restrict to, const void *restrict from, size_t count)
{
  for (size_t i = 0; i < count; i++) ((volatile unsigned char *)to)[i] = ((const unsigned char *)from)[i];
  return to;
}

void *memmove(void *to, const void *from, size_t count)
{
  if ((const char *)from >= (char *)to) return memcpy(to, from, count);
  for (size_t i = count; i-- > 0;) ((volatile unsigned char *)to)[i] = ((const unsigned char *)from)[i];
  return to;
}

int memcmp(const void *a, const void *b, size_t count)
{
  for (size_t i = 0; i < count; i++) {
    const int less = ((const unsigned char *)a)[i] - ((const unsigned char *)b)[i];
    if (less) return less;
  }
  return 0;
}

size_t strlen(const char *text)
{
  size_t n = 0;
  while (((const volatile char *)text)[n]) n++;
  return n;
}
#endif
