/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SPLATGUARD_VERSION_H
#define SPLATGUARD_VERSION_H

/* Marks what the shared library exports; everything else is hidden. */
#if defined(__GNUC__)
#define SG_API __attribute__((visibility("default")))
#else
#define SG_API
#endif

#ifdef __cplusplus
extern "C" {
#endif

/* Of these headers. Structs and functions keep their layout within a minor version; before 1.0 each
 * minor version may change them, and the shared library's name changes with it
 * (libsplatguard.so.0.1). */
#define SG_VERSION_MAJOR 0
#define SG_VERSION_MINOR 1
#define SG_VERSION_PATCH 0

/* "0.1.0" of the library that is linked. */
SG_API const char *sg_version(void);

#ifdef __cplusplus
}
#endif

#endif
