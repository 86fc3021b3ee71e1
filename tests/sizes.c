/* tests/sizes.c - print the memory that a caller provides, for README. Compiled once per
 * capacity. */
#include <stdio.h>

#include "tse/tse.h"

int main(void)
{
  printf("sizeof, %s, %4d particles: tse_filter %7zu, tse_filter_paper %7zu, tse_params %4zu bytes\n",
      TSE_FORMAT_NAME, TSE_MAX_PARTICLES, sizeof(tse_filter), sizeof(tse_filter_paper), sizeof(tse_params));
  return 0;
}
