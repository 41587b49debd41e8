/* SPDX-License-Identifier: Apache-2.0 */
#include "zip.h"

#include <stdarg.h>
#include <stdio.h>
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

/* Little-endian bytes of numbers of 2 bytes (w) and 4 (u), as a format's letters say. */
static uint8_t *put(uint8_t *to, const char *format, ...)
{
    va_list list;
    va_start(list, format);
    for (; *format; format++) {
        const uint32_t v = va_arg(list, uint32_t);
        for (int k = 0; k < (*format == 'u' ? 4 : 2); k++)
            *to++ = (uint8_t) (v >> 8 * k);
    }
    va_end(list);
    return to;
}

#define VERSION 10  /* of zip that a reader needs: 1.0 */
#define UTF8 2048   /* of the flags: names are UTF-8 */
#define EARLIEST 33 /* date: 1 January 1980, so that equal models are equal files */
#define WRITTEN_BYTES (ENTRY_BYTES + SG_ZIP_NAME)

/* What both headers of an entry have in common: versions, flags, method, time, date, sizes. */
static uint8_t *put_entry(const struct sg_zip_writer *w, unsigned i, uint8_t *to)
{
    const uint32_t size = w->entry[i].size;
    return put(to, "wwwwwuuuww", VERSION, UTF8, STORED, 0, EARLIEST, w->entry[i].crc, size, size,
               (uint32_t) strlen(w->entry[i].name), 0);
}

int sg_zip_add(struct sg_zip_writer *w, const char *name, const void *data, size_t size)
{
    uint8_t header[WRITTEN_BYTES];
    const unsigned i = w->count;
    const size_t most = SG_ZIP_MAX - (uint64_t) SG_ZIP_ENTRIES * 2 * WRITTEN_BYTES;
    if (w->at > most || size > most - w->at)
        return sg_fail(w->ctx, SG_ERR_INPUT,
                       "%s: found %llu bytes, expected a zip archive below 4 GB", w->path,
                       (unsigned long long) w->at + size);
    snprintf(w->entry[i].name, sizeof(w->entry[i].name), "%s", name);
    w->entry[i].size = (uint32_t) size, w->entry[i].at = (uint32_t) w->at;
    w->entry[i].crc = (uint32_t) crc32(0, data, (unsigned) size);
    const size_t n = (size_t) (put_entry(w, i, put(header, "u", 0x04034b50)) - header);
    fwrite(header, 1, n, w->to);
    fputs(w->entry[i].name, w->to);
    fwrite(data, 1, size, w->to);
    w->at += n + strlen(w->entry[i].name) + size;
    w->count++;
    return SG_OK;
}

void sg_zip_finish(struct sg_zip_writer *w)
{
    uint8_t header[WRITTEN_BYTES];
    uint32_t bytes = 0;
    for (unsigned i = 0; i < w->count; i++) {
        uint8_t *to = put_entry(w, i, put(header, "uw", 0x02014b50, VERSION));
        to = put(to, "wwwuu", 0, 0, 0, 0, w->entry[i].at);
        fwrite(header, 1, (size_t) (to - header), w->to);
        fputs(w->entry[i].name, w->to);
        bytes += (uint32_t) ((size_t) (to - header) + strlen(w->entry[i].name));
    }
    uint8_t *to =
        put(header, "uwwwwuuw", 0x06054b50, 0, 0, w->count, w->count, bytes, (uint32_t) w->at, 0);
    fwrite(header, 1, (size_t) (to - header), w->to);
}

#else

static int missing(sg_ctx *ctx, const char *path)
{
    return sg_fail(ctx, SG_ERR_USAGE, "%s: zip archives need zlib, which this build lacks", path);
}

int sg_zip_open(sg_ctx *ctx, const char *path, const uint8_t *data, size_t size, struct sg_zip *out)
{
    (void) data, (void) size, (void) out;
    return missing(ctx, path);
}

int sg_zip_read(const struct sg_zip *z, const char *name, size_t most, uint8_t **data, size_t *size)
{
    (void) z, (void) name, (void) most;
    *data = NULL, *size = 0;
    return SG_ERR_USAGE;
}

int sg_zip_add(struct sg_zip_writer *w, const char *name, const void *data, size_t size)
{
    (void) name, (void) data, (void) size;
    return missing(w->ctx, w->path);
}

void sg_zip_finish(struct sg_zip_writer *w)
{
    (void) w;
}

#endif
