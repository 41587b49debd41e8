/* SPDX-License-Identifier: Apache-2.0 */
#include "gzip.h"

#ifdef SG_ZLIB
#include <string.h>

#include "core/zlib_stream.h"

#define PIECE ((size_t) 1 << 16)
#define GZIP_WRAPPER 16 /* of inflateInit2 and deflateInit2: added to the size of the window */

struct sg_gunzip {
    sg_ctx *ctx;
    struct sg_source *in;
    z_stream z;
    bool ended;
    size_t ready, at; /* in out */
    unsigned char out[PIECE];
};

int sg_gunzip_open(sg_ctx *ctx, struct sg_source *in, struct sg_gunzip **out)
{
    struct sg_gunzip *g = *out = sg_alloc(ctx, SG_MEM_MISC, 1, sizeof(*g));
    if (!g)
        return SG_ERR_BUDGET;
    g->ctx = ctx, g->in = in;
    g->z = sg_zlib_stream(ctx);
    if (inflateInit2(&g->z, MAX_WBITS + GZIP_WRAPPER) == Z_OK)
        return SG_OK;
    sg_free(g);
    *out = NULL;
    return sg_fail(ctx, SG_ERR_BUDGET, "%s: no memory to decompress", in->path);
}

static int damaged(struct sg_gunzip *g, const char *found)
{
    return sg_fail(g->ctx, SG_ERR_INPUT, "%s: byte %llu: found %s, expected a whole gzip stream",
                   g->in->path, (unsigned long long) g->in->at, found);
}

/* Fills the buffer, which is empty. */
static int inflate_piece(struct sg_gunzip *g)
{
    g->ready = g->at = 0;
    while (!g->ready && !g->ended) {
        const size_t n = sg_source_fill(g->in, 1);
        g->z.next_in = (unsigned char *) (uintptr_t) g->in->window;
        g->z.avail_in = (unsigned) n;
        g->z.next_out = g->out;
        g->z.avail_out = PIECE;
        const int result = inflate(&g->z, Z_NO_FLUSH);
        if (result != Z_OK && result != Z_STREAM_END)
            return n ? damaged(g, "damaged data") : damaged(g, "the end of the file");
        sg_source_skip(g->in, n - g->z.avail_in);
        g->ready = PIECE - g->z.avail_out;
        g->ended = result == Z_STREAM_END;
    }
    return SG_OK;
}

int sg_gunzip_read(struct sg_gunzip *g, void *to, size_t n)
{
    while (n) {
        const int code = g->at == g->ready ? inflate_piece(g) : SG_OK;
        if (code)
            return code;
        if (g->at == g->ready)
            return damaged(g, "too little data");
        const size_t some = n < g->ready - g->at ? n : g->ready - g->at;
        memcpy(to, g->out + g->at, some);
        g->at += some, n -= some, to = (char *) to + some;
    }
    return SG_OK;
}

int sg_gunzip_finish(struct sg_gunzip *g)
{
    const int code = g->at == g->ready ? inflate_piece(g) : SG_OK;
    if (code)
        return code;
    if (g->at != g->ready || sg_source_left(g->in))
        return damaged(g, "data behind the last Gaussian");
    return SG_OK;
}

void sg_gunzip_close(struct sg_gunzip **g)
{
    if (*g)
        inflateEnd(&(*g)->z);
    sg_free(*g);
    *g = NULL;
}

struct sg_gzip {
    FILE *to;
    z_stream z;
    unsigned char out[PIECE];
};

int sg_gzip_open(sg_ctx *ctx, const char *path, FILE *to, struct sg_gzip **out)
{
    struct sg_gzip *g = *out = sg_alloc(ctx, SG_MEM_MISC, 1, sizeof(*g));
    if (!g)
        return SG_ERR_BUDGET;
    g->to = to;
    g->z = sg_zlib_stream(ctx);
    if (deflateInit2(&g->z, Z_DEFAULT_COMPRESSION, Z_DEFLATED, MAX_WBITS + GZIP_WRAPPER,
                     MAX_MEM_LEVEL, Z_DEFAULT_STRATEGY) == Z_OK)
        return SG_OK;
    sg_free(g);
    *out = NULL;
    return sg_fail(ctx, SG_ERR_BUDGET, "%s: no memory to compress", path);
}

static void deflate_all(struct sg_gzip *g, int flush)
{
    do {
        g->z.next_out = g->out;
        g->z.avail_out = PIECE;
        deflate(&g->z, flush);
        fwrite(g->out, 1, PIECE - g->z.avail_out, g->to);
    } while (!g->z.avail_out);
}

void sg_gzip_write(struct sg_gzip *g, const void *bytes, size_t n)
{
    g->z.next_in = (unsigned char *) (uintptr_t) bytes;
    g->z.avail_in = (unsigned) n;
    deflate_all(g, Z_NO_FLUSH);
}

void sg_gzip_finish(struct sg_gzip **g)
{
    if (*g) {
        (*g)->z.avail_in = 0;
        deflate_all(*g, Z_FINISH);
        deflateEnd(&(*g)->z);
    }
    sg_free(*g);
    *g = NULL;
}

#else

static int missing(sg_ctx *ctx, const char *path)
{
    return sg_fail(ctx, SG_ERR_USAGE, "%s: .spz needs zlib, which this build lacks", path);
}

int sg_gunzip_open(sg_ctx *ctx, struct sg_source *in, struct sg_gunzip **out)
{
    *out = NULL;
    return missing(ctx, in->path);
}

int sg_gunzip_read(struct sg_gunzip *g, void *to, size_t n)
{
    (void) g, (void) to, (void) n;
    return SG_ERR_USAGE;
}

int sg_gunzip_finish(struct sg_gunzip *g)
{
    (void) g;
    return SG_ERR_USAGE;
}

void sg_gunzip_close(struct sg_gunzip **g)
{
    (void) g;
}

int sg_gzip_open(sg_ctx *ctx, const char *path, FILE *to, struct sg_gzip **out)
{
    (void) to;
    *out = NULL;
    return missing(ctx, path);
}

void sg_gzip_write(struct sg_gzip *g, const void *bytes, size_t n)
{
    (void) g, (void) bytes, (void) n;
}

void sg_gzip_finish(struct sg_gzip **g)
{
    (void) g;
}
#endif
