/* SPDX-License-Identifier: Apache-2.0 */
#include "zip.h"

#include <errno.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#ifdef SG_ZLIB
#include "zlib_stream.h"

#define END_BYTES 22 /* of the record at the end, before its comment */
#define COMMENT_MAX 65535
#define ENTRY_BYTES 46 /* of an entry of the directory, before its name */
#define LOCAL_BYTES 30 /* of an entry before its data, likewise */
#define STORED 0
#define DEFLATED 8
#define ENCRYPTED 1 /* of its flags */
#define PIECE ((size_t) 1 << 16)

static unsigned u16(const uint8_t *b)
{
    return b[0] | (unsigned) b[1] << 8;
}

static uint32_t u32(const uint8_t *b)
{
    return u16(b) | (uint32_t) u16(b + 2) << 16;
}

static int damaged(const struct sg_zip *z, const char *found)
{
    return sg_fail(z->ctx, SG_ERR_INPUT, "%s: zip: found %s, expected a whole archive", z->path,
                   found);
}

/* False: an error of the context; *failed: of the system, not by what the archive holds. */
static bool read_at(const struct sg_zip *z, uint64_t at, void *to, size_t n, bool *failed)
{
    while (n) {
        const ssize_t got = pread(z->fd, to, n, (off_t) at);
        if (got < 0 && errno == EINTR)
            continue;
        *failed = got < 0;
        if (got < 0)
            sg_fail(z->ctx, SG_ERR_INPUT, "%s: cannot read: %s", z->path, strerror(errno));
        else if (!got)
            damaged(z, "fewer bytes than its size");
        if (got <= 0)
            return false;
        at += (uint64_t) got, n -= (size_t) got, to = (char *) to + got;
    }
    return true;
}

/* ---- the directory ---- */

/* The record at the end: how many entries, and where the directory is. */
static int find_directory(struct sg_zip *z, uint64_t size, const uint8_t *tail, size_t n,
                          size_t *bytes)
{
    for (size_t back = END_BYTES; back <= n; back++) {
        const uint8_t *end = tail + n - back;
        if (memcmp(end, "PK\5\6", 4) || u16(end + 20) != back - END_BYTES)
            continue;
        if (u16(end + 10) == UINT16_MAX || u32(end + 12) == UINT32_MAX ||
            u32(end + 16) == UINT32_MAX)
            return sg_fail(z->ctx, SG_ERR_INPUT,
                           "%s: zip: found zip64, expected at most 65534 files and 4 GB", z->path);
        *bytes = u32(end + 12);
        z->directory = u32(end + 16);
        z->count = u16(end + 10);
        if (u16(end + 4) || u16(end + 6) || u16(end + 8) != z->count)
            return damaged(z, "one of several parts");
        if (z->directory > size - back || *bytes > size - back - z->directory)
            return damaged(z, "a directory beyond the file");
        return SG_OK;
    }
    return damaged(z, "no directory at its end");
}

static int by_name(const void *a, const void *b)
{
    const struct sg_zip_entry *x = a, *y = b;
    return strcmp(x->name, y->name);
}

/* The entries of the directory, whose names end with a zero in place of their headers. */
static int list_entries(struct sg_zip *z, size_t bytes)
{
    uint8_t *at = (uint8_t *) z->names, *end = at + bytes;
    for (size_t i = 0; i < z->count; i++) {
        struct sg_zip_entry *e = &z->entries[i];
        if (end - at < ENTRY_BYTES || memcmp(at, "PK\1\2", 4))
            return damaged(z, "a torn directory");
        const size_t named = u16(at + 28), all = ENTRY_BYTES + named + u16(at + 30) + u16(at + 32);
        if ((size_t) (end - at) < all)
            return damaged(z, "a torn directory");
        *e = (struct sg_zip_entry){.name = (char *) at,
                                   .flags = u16(at + 8),
                                   .method = u16(at + 10),
                                   .crc = u32(at + 16),
                                   .packed = u32(at + 20),
                                   .size = u32(at + 24),
                                   .at = u32(at + 42)};
        memmove(at, at + ENTRY_BYTES, named);
        at[named] = 0;
        if (strlen(e->name) != named)
            return damaged(z, "a name with a zero byte");
        at += all;
    }
    qsort(z->entries, z->count, sizeof(*z->entries), by_name);
    for (size_t i = 1; i < z->count; i++)
        if (!strcmp(z->entries[i - 1].name, z->entries[i].name))
            return sg_fail(z->ctx, SG_ERR_INPUT, "%s: zip: found %s twice, expected distinct names",
                           z->path, z->entries[i].name);
    return SG_OK;
}

int sg_zip_open(sg_ctx *ctx, const char *path, int fd, uint64_t size, struct sg_zip *out)
{
    const size_t n = size < END_BYTES + COMMENT_MAX ? (size_t) size : END_BYTES + COMMENT_MAX;
    size_t bytes = 0;
    bool failed;
    *out = (struct sg_zip){.ctx = ctx, .path = path, .fd = fd};
    if (size > SG_ZIP_MAX)
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: found %llu bytes, expected a zip archive of at most %llu", path,
                       (unsigned long long) size, (unsigned long long) SG_ZIP_MAX);
    uint8_t *tail = sg_alloc_raw(ctx, SG_MEM_MISC, n + 1, 1);
    if (!tail)
        return SG_ERR_BUDGET;
    int code = read_at(out, size - n, tail, n, &failed) ? find_directory(out, size, tail, n, &bytes)
                                                        : SG_ERR_INPUT;
    sg_free(tail);
    if (code)
        return code;
    out->names = sg_alloc_raw(ctx, SG_MEM_MISC, bytes + 1, 1);
    out->entries = sg_alloc(ctx, SG_MEM_MISC, out->count + 1, sizeof(*out->entries));
    if (!out->names || !out->entries)
        return SG_ERR_BUDGET;
    return read_at(out, out->directory, out->names, bytes, &failed) ? list_entries(out, bytes)
                                                                    : SG_ERR_INPUT;
}

void sg_zip_close(struct sg_zip *z)
{
    sg_free(z->entries);
    sg_free(z->names);
    *z = (struct sg_zip){.fd = -1};
}

size_t sg_zip_from(const struct sg_zip *z, const char *name)
{
    size_t from = 0, to = z->count;
    while (from < to) {
        const size_t middle = from + (to - from) / 2;
        if (strcmp(z->entries[middle].name, name) < 0)
            from = middle + 1;
        else
            to = middle;
    }
    return from;
}

const struct sg_zip_entry *sg_zip_find(const struct sg_zip *z, const char *name)
{
    const size_t at = sg_zip_from(z, name);
    return at < z->count && !strcmp(z->entries[at].name, name) ? &z->entries[at] : NULL;
}

/* ---- an entry ---- */

struct unzip {
    struct sg_unpacker unpacker;
    const struct sg_zip *zip;
    const struct sg_zip_entry *entry;
    const char *path;
    uint64_t at;   /* of the next packed byte */
    size_t packed; /* bytes that are not in `in` yet */
    uint64_t left; /* unpacked bytes */
    uint32_t crc;
    bool inflates, failed;
    z_stream z;
    uint8_t in[PIECE];
};

static bool read_piece(struct unzip *u)
{
    const size_t n = u->packed < PIECE ? u->packed : PIECE;
    if (!read_at(u->zip, u->at, u->in, n, &u->unpacker.failed))
        return false;
    u->z.next_in = u->in, u->z.avail_in = (unsigned) n;
    u->at += n, u->packed -= n;
    return true;
}

/* Exactly n more bytes, as many as are left at most. */
static bool inflate_some(struct unzip *u, uint8_t *to, size_t n)
{
    u->z.next_out = to, u->z.avail_out = (unsigned) n;
    int result = Z_OK;
    /* After the last byte there may be input without output, to the end of the stream. */
    while (u->z.avail_out || (n == u->left && result != Z_STREAM_END)) {
        if (!u->z.avail_in && u->packed && !read_piece(u))
            return false;
        const unsigned in = u->z.avail_in, out = u->z.avail_out;
        result = inflate(&u->z, Z_NO_FLUSH);
        if (result == Z_STREAM_END)
            break;
        if ((result != Z_OK && result != Z_BUF_ERROR) ||
            (in == u->z.avail_in && out == u->z.avail_out))
            return false;
    }
    return !u->z.avail_out && (n < u->left || (!u->z.avail_in && !u->packed));
}

static size_t unzip_some(struct sg_unpacker *unpacker, void *to, size_t n)
{
    struct unzip *u = (struct unzip *) unpacker;
    n = n < u->left ? n : (size_t) u->left;
    n = n < PIECE ? n : PIECE;
    if (u->failed || !n)
        return 0;
    bool good =
        u->inflates ? inflate_some(u, to, n) : read_at(u->zip, u->at, to, n, &u->unpacker.failed);
    if (!u->inflates)
        u->at += n;
    u->left -= n;
    if (good)
        u->crc = (uint32_t) crc32(u->crc, to, (unsigned) n);
    if (good && (u->left || u->crc == u->entry->crc))
        return n;
    u->failed = true;
    sg_fail(u->zip->ctx, SG_ERR_INPUT, "%s: zip: found damaged data, expected that of its checksum",
            u->path);
    return 0;
}

static void unzip_close(struct sg_unpacker *unpacker)
{
    struct unzip *u = (struct unzip *) unpacker;
    if (u->inflates)
        inflateEnd(&u->z);
    sg_free(u);
}

/* Where the data of an entry begin. */
static int find_data(const struct sg_zip *z, const struct sg_zip_entry *e, uint64_t *at,
                     bool *failed)
{
    uint8_t local[LOCAL_BYTES];
    if (e->at > z->directory || z->directory - e->at < LOCAL_BYTES ||
        !read_at(z, e->at, local, LOCAL_BYTES, failed) || memcmp(local, "PK\3\4", 4))
        return damaged(z, "an entry that is not where the directory says");
    const uint64_t skip = LOCAL_BYTES + (uint64_t) u16(local + 26) + u16(local + 28);
    if (z->directory - e->at < skip || z->directory - e->at - skip < e->packed)
        return damaged(z, "an entry beyond the file");
    *at = e->at + skip;
    return SG_OK;
}

int sg_zip_source(const struct sg_zip *z, const struct sg_zip_entry *e, const char *path,
                  uint64_t max_bytes, struct sg_source *out)
{
    uint64_t at = 0;
    *out = (struct sg_source){0};
    if ((e->flags & ENCRYPTED) || (e->method != STORED && e->method != DEFLATED) ||
        (e->method == STORED && e->packed != e->size))
        return sg_fail(z->ctx, SG_ERR_INPUT,
                       "%s: zip: found %smethod %u, expected one that is stored or deflated and "
                       "not encrypted",
                       path, e->flags & ENCRYPTED ? "encryption and " : "", e->method);
    if (e->size > max_bytes)
        return sg_fail(z->ctx, SG_ERR_INPUT, "%s: zip: found %u bytes, expected at most %llu", path,
                       e->size, (unsigned long long) max_bytes);
    if (e->size / SG_DEFLATE_RATIO > e->packed)
        return sg_fail(z->ctx, SG_ERR_INPUT,
                       "%s: zip: found %u bytes packed in %u, expected at most %d times as many",
                       path, e->size, e->packed, SG_DEFLATE_RATIO);
    int code = find_data(z, e, &at, &out->failed);
    struct unzip *u = code ? NULL : sg_alloc(z->ctx, SG_MEM_MISC, 1, sizeof(*u));
    if (!u)
        return code ? code : SG_ERR_BUDGET;
    u->unpacker = (struct sg_unpacker){.read = unzip_some, .close = unzip_close};
    u->zip = z, u->entry = e, u->path = path;
    u->at = at, u->packed = e->packed, u->left = e->size;
    u->z = sg_zlib_stream(z->ctx);
    u->inflates = e->method == DEFLATED && inflateInit2(&u->z, -MAX_WBITS) == Z_OK;
    if (e->method == DEFLATED && !u->inflates) {
        sg_free(u);
        return sg_fail(z->ctx, SG_ERR_BUDGET, "%s: no memory to decompress", path);
    }
    return sg_source_of_unpacker(z->ctx, out, path, &u->unpacker, e->size);
}

/* ---- writing ---- */

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

int sg_zip_open(sg_ctx *ctx, const char *path, int fd, uint64_t size, struct sg_zip *out)
{
    (void) fd, (void) size;
    *out = (struct sg_zip){.fd = -1};
    return missing(ctx, path);
}

void sg_zip_close(struct sg_zip *z)
{
    (void) z;
}

size_t sg_zip_from(const struct sg_zip *z, const char *name)
{
    (void) name;
    return z->count;
}

const struct sg_zip_entry *sg_zip_find(const struct sg_zip *z, const char *name)
{
    (void) z, (void) name;
    return NULL;
}

int sg_zip_source(const struct sg_zip *z, const struct sg_zip_entry *e, const char *path,
                  uint64_t max_bytes, struct sg_source *out)
{
    (void) e, (void) max_bytes;
    *out = (struct sg_source){0};
    return missing(z->ctx, path);
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
