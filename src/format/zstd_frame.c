/* SPDX-License-Identifier: Apache-2.0 */
#include "zstd_frame.h"

#ifdef SG_ZSTD
#include <zstd.h>

#define LEVEL 9
/* Memory of libzstd beside the frames: it has 160 KB to unpack; 13 MB were measured to pack. */
#define UNPACKER_BYTES (1 << 18)
#define PACKER_BYTES (16 << 20)

int sg_zstd_unpack(sg_ctx *ctx, const char *path, const void *packed, size_t size, void *to,
                   size_t n)
{
    void *room;
    const int code = sg_reserve(ctx, SG_MEM_MISC, UNPACKER_BYTES, &room);
    if (code)
        return code;
    /* The first frame must be all: zstd would go on with a next one. */
    const bool whole = ZSTD_findFrameCompressedSize(packed, size) == size &&
                       ZSTD_decompress(to, n, packed, size) == n;
    sg_free(room);
    return whole ? SG_OK
                 : sg_fail(ctx, SG_ERR_INPUT, "%s: found damaged data, expected %zu bytes of zstd",
                           path, n);
}

int sg_zstd_pack(sg_ctx *ctx, const char *path, const void *from, size_t n, void **packed,
                 size_t *size)
{
    const size_t most = ZSTD_compressBound(n);
    void *room;
    int code = sg_reserve(ctx, SG_MEM_MISC, PACKER_BYTES, &room);
    *packed = code ? NULL : sg_alloc_raw(ctx, SG_MEM_MISC, most, 1);
    if (!*packed)
        code = SG_ERR_BUDGET;
    if (!code) {
        *size = ZSTD_compress(*packed, most, from, n, LEVEL);
        if (ZSTD_isError(*size))
            code = sg_fail(ctx, SG_ERR_BUDGET, "%s: cannot compress: %s", path,
                           ZSTD_getErrorName(*size));
    }
    sg_free(room);
    if (code) {
        sg_free(*packed);
        *packed = NULL, *size = 0;
    }
    return code;
}

#else

static int missing(sg_ctx *ctx, const char *path)
{
    return sg_fail(ctx, SG_ERR_USAGE, "%s: .spz of version 4 needs zstd, which this build lacks",
                   path);
}

int sg_zstd_unpack(sg_ctx *ctx, const char *path, const void *packed, size_t size, void *to,
                   size_t n)
{
    (void) packed, (void) size, (void) to, (void) n;
    return missing(ctx, path);
}

int sg_zstd_pack(sg_ctx *ctx, const char *path, const void *from, size_t n, void **packed,
                 size_t *size)
{
    (void) from, (void) n;
    *packed = NULL, *size = 0;
    return missing(ctx, path);
}

#endif
