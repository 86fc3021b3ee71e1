/* tse/version.h - semantic version of the project. CMakeLists.txt and pyproject.toml read
 * it from this file. */
#ifndef TSE_VERSION_H
#define TSE_VERSION_H
#define TSE_VERSION_MAJOR 0
#define TSE_VERSION_MINOR 2
#define TSE_VERSION_PATCH 0
#define TSE_VERSION "0.2.0"
#endif
