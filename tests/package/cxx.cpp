// Use the headers in a C++ program: complete types, extern "C" functions,
// the number format of the installed library.
#include <iostream>

#include "tse/describe.h"
#include "tse/simulate.h"

int main()
{
  static tse_filter filter;
  tse_config config;
  tse_params params;
  tse_config_exact(&config);
  if (tse_prepare(&config, &params, nullptr) < 0 || tse_reset(&params, &filter, sizeof filter) < 0) return 1;

  tse_build build;
  tse_describe_build(&build);
  std::cout << "tse " << build.version << ", " << build.format << ", up to " << build.capacity
            << " particles\n";
  const bool same = sizeof(tse_filter) == static_cast<size_t>(build.filter_bytes)
                    && sizeof(tse_filter_paper) == static_cast<size_t>(build.filter_paper_bytes)
                    && build.capacity == TSE_MAX_PARTICLES
                    && sizeof(tse_sim) == static_cast<size_t>(build.sim_bytes);
  return same ? 0 : 2;
}
