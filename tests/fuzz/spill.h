/* SPDX-License-Identifier: Apache-2.0 */
/* Bytes to a file, for readers that take a path. */
#ifndef FUZZ_SPILL_H
#define FUZZ_SPILL_H

#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

static inline void spill(const char *path, const uint8_t *data, size_t size)
{
    FILE *f = fopen(path, "wb");
    if (!f || fwrite(data, 1, size, f) != size || fclose(f))
        abort();
}

#endif
