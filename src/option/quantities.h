/* SPDX-License-Identifier: Apache-2.0 */
/* Sizes and times as people write them. */
#ifndef SG_OPTION_QUANTITIES_H
#define SG_OPTION_QUANTITIES_H

#include <stdbool.h>
#include <stdint.h>

/* 1000, 500MB, 1.5G, 2GiB. K, M, G, T and KiB, MiB, GiB, TiB are powers of 1024; KB, MB, GB, TB and
 * B are of 1000. A part of a byte is dropped. Returns false for any other text, or more than 64
 * bits. */
bool sg_quantity_bytes(const char *text, uint64_t *bytes);

/* A number of seconds, or numbers with d, h, m and s, each at most once and in this order:
 * 90, 1.5h, 1h30m. */
bool sg_quantity_seconds(const char *text, double *seconds);

#endif
