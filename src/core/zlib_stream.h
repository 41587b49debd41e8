/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SG_CORE_ZLIB_STREAM_H
#define SG_CORE_ZLIB_STREAM_H

#include <zlib.h>

#include "context.h"

static inline void *sg_zlib_alloc(void *ctx, unsigned count, unsigned size)
{
    return sg_alloc_raw(ctx, SG_MEM_MISC, count, size);
}

static inline void sg_zlib_free(void *ctx, void *memory)
{
    (void) ctx;
    sg_free(memory);
}

/* For inflateInit2 and deflateInit2: a stream that takes its memory from the context. */
static inline z_stream sg_zlib_stream(sg_ctx *ctx)
{
    return (z_stream){.zalloc = sg_zlib_alloc, .zfree = sg_zlib_free, .opaque = ctx};
}

#endif
