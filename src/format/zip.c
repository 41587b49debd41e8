/* SPDX-License-Identifier: Apache-2.0 */
#include "zip.h"

#include <string.h>

#include "codec.h"
#include "gzip.h"

#ifdef SG_ZLIB
#include "zlib_stream.h"

#define END_BYTES 22 /* of the record at the end, before its comment */
#define COMMENT_MAX 65535
#define ENTRY_BYTES 46 /* of an entry of the directory, before its name */
#define LOCAL_BYTES 30 /* of an entry before its data, likewise */
#define STORED 0
#define DEFLATED 8
#define ENCRYPTED 1 /* of its flags */

static uint32_t u32(const uint8_t *b)
{
    return sg_u32((const char *) b);
}

static unsigned u16(const uint8_t *b)
{
    return sg_u16((const char *) b);
}

static int damaged(const struct sg_zip *z, const char *found)
{
    return sg_fail(z->ctx, SG_ERR_INPUT, "%s: zip: found %s, expected a whole archive", z->path,
                   found);
}

int sg_zip_open(sg_ctx *ctx, const char *path, const uint8_t *data, size_t size, struct sg_zip *out)
{
    *out = (struct sg_zip){.ctx = ctx, .path = path, .data = data, .size = size};
    for (size_t back = END_BYTES; back <= size && back <= END_BYTES + COMMENT_MAX; back++) {
        const uint8_t *end = data + size - back;
        if (memcmp(end, "PK\5\6", 4) || u16(end + 20) != back - END_BYTES)
            continue;
        const size_t bytes = u32(end + 12), at = u32(end + 16), here = size - back;
        if (u16(end + 4) || u16(end + 6) || u16(end + 8) != u16(end + 10))
            return damaged(out, "one of several parts");
        if (at > here || bytes > here - at)
            return damaged(out, "a directory beyond the file");
        out->entries = u16(end + 10);
        out->directory = at, out->directory_end = at + bytes;
        return SG_OK;
    }
    return damaged(out, "no directory at its end");
}

/* The entry of a name in the directory, or NULL; SG_ERR_INPUT for a damaged directory. */
static int find(const struct sg_zip *z, const char *name, const uint8_t **found)
{
    const size_t length = strlen(name);
    size_t at = z->directory;
    *found = NULL;
    for (unsigned i = 0; i < z->entries && !*found; i++) {
        const uint8_t *e = z->data + at;
        if (z->directory_end - at < ENTRY_BYTES || memcmp(e, "PK\1\2", 4))
            return damaged(z, "a torn directory");
        const size_t named = u16(e + 28), all = ENTRY_BYTES + named + u16(e + 30) + u16(e + 32);
        if (z->directory_end - at < all)
            return damaged(z, "a torn directory");
        if (named == length && !memcmp(e + ENTRY_BYTES, name, length))
            *found = e;
        at += all;
    }
    return SG_OK;
}

/* Whether exactly n bytes come of the data, which has no wrapper. */
static bool inflate_all(const struct sg_zip *z, const uint8_t *from, size_t packed, uint8_t *to,
                        size_t n)
{
    z_stream s = sg_zlib_stream(z->ctx);
    if (inflateInit2(&s, -MAX_WBITS) != Z_OK)
        return false;
    s.next_in = (uint8_t *) (uintptr_t) from, s.avail_in = (unsigned) packed;
    s.next_out = to, s.avail_out = (unsigned) n;
    const bool whole = inflate(&s, Z_FINISH) == Z_STREAM_END && !s.avail_out && !s.avail_in;
    inflateEnd(&s);
    return whole;
}

int sg_zip_read(const struct sg_zip *z, const char *name, size_t most, uint8_t **data, size_t *size)
{
    const uint8_t *e;
    *data = NULL;
    *size = 0;
    int code = find(z, name, &e);
    if (code)
        return code;
    if (!e)
        return sg_fail(z->ctx, SG_ERR_INPUT, "%s: zip: found no %s", z->path, name);
    const size_t packed = u32(e + 20), n = u32(e + 24), at = u32(e + 42);
    const unsigned method = u16(e + 10);
    if ((u16(e + 8) & ENCRYPTED) || (method != STORED && method != DEFLATED) ||
        (method == STORED && packed != n))
        return sg_fail(z->ctx, SG_ERR_INPUT,
                       "%s: zip: %s: found method %u, expected one that is stored or deflated and "
                       "not encrypted",
                       z->path, name, method);
    if (n > most || n / SG_DEFLATE_RATIO > packed)
        return sg_fail(z->ctx, SG_ERR_INPUT,
                       "%s: zip: %s: found %zu bytes packed in %zu, expected at most %zu", z->path,
                       name, n, packed, most);
    if (at > z->directory || z->directory - at < LOCAL_BYTES || memcmp(z->data + at, "PK\3\4", 4))
        return damaged(z, "an entry that is not where the directory says");
    const uint8_t *local = z->data + at;
    const size_t skip = LOCAL_BYTES + (size_t) u16(local + 26) + u16(local + 28);
    if (z->directory - at < skip || z->directory - at - skip < packed)
        return damaged(z, "an entry beyond the file");
    *data = sg_alloc_raw(z->ctx, SG_MEM_MISC, n, 1);
    if (!*data)
        return SG_ERR_BUDGET;
    *size = n;
    if (method == STORED)
        memcpy(*data, local + skip, n);
    if ((method == DEFLATED && !inflate_all(z, local + skip, packed, *data, n)) ||
        crc32(0, *data, (unsigned) n) != u32(e + 16)) {
        code = sg_fail(z->ctx, SG_ERR_INPUT, "%s: zip: %s: found damaged data", z->path, name);
        sg_free(*data);
        *data = NULL, *size = 0;
    }
    return code;
}

#else

int sg_zip_open(sg_ctx *ctx, const char *path, const uint8_t *data, size_t size, struct sg_zip *out)
{
    (void) data, (void) size, (void) out;
    return sg_fail(ctx, SG_ERR_USAGE, "%s: found a zip archive, but this build has no zlib", path);
}

int sg_zip_read(const struct sg_zip *z, const char *name, size_t most, uint8_t **data, size_t *size)
{
    (void) z, (void) name, (void) most;
    *data = NULL, *size = 0;
    return SG_ERR_USAGE;
}

#endif
