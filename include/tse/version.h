/* tse/version.h - semantic version; CMakeLists.txt and the Python package read it from
 * here. */
#ifndef TSE_VERSION_H
#define TSE_VERSION_H
#define TSE_VERSION_MAJOR 0
#define TSE_VERSION_MINOR 2
#define TSE_VERSION_PATCH 0
#define TSE_VERSION "0.2.0"
#endif
