/* SPDX-License-Identifier: Apache-2.0 */
#include "source.h"

#include <errno.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "file.h"

int sg_source_open(sg_ctx *ctx, struct sg_source *s, const char *path, uint64_t max_bytes)
{
    FILE *file;
    *s = (struct sg_source){.path = path, .failed = true};
    int code = sg_file_open(ctx, path, &file);
    if (!code) {
        code = sg_source_of_file(ctx, s, file, path, max_bytes);
        s->owned = true;
    }
    return code;
}

/* Of the system, by errno. */
static int failed(struct sg_source *s)
{
    s->failed = true;
    return sg_fail(s->ctx, SG_ERR_INPUT, "%s: cannot read: %s", s->path, strerror(errno));
}

static int make_window(sg_ctx *ctx, struct sg_source *s)
{
    s->room = s->size < SG_SOURCE_WINDOW ? (size_t) s->size : SG_SOURCE_WINDOW;
    s->window = s->buffer = sg_alloc_raw(ctx, SG_MEM_MISC, s->room, 1);
    return s->buffer ? SG_OK : SG_ERR_BUDGET;
}

int sg_source_of_file(sg_ctx *ctx, struct sg_source *s, FILE *file, const char *path,
                      uint64_t max_bytes)
{
    struct stat st;
    *s = (struct sg_source){.ctx = ctx, .path = path, .file = file};
    if (fstat(fileno(file), &st))
        return failed(s);
    s->size = (uint64_t) st.st_size;
    if (s->size > max_bytes)
        return sg_fail(ctx, SG_ERR_INPUT, "%s: found %llu bytes, the limit is %llu", path,
                       (unsigned long long) s->size, (unsigned long long) max_bytes);
    return make_window(ctx, s);
}

int sg_source_of_unpacker(sg_ctx *ctx, struct sg_source *s, const char *path,
                          struct sg_unpacker *unpacker, uint64_t size)
{
    *s = (struct sg_source){.ctx = ctx, .path = path, .unpacker = unpacker, .size = size};
    return make_window(ctx, s);
}

void sg_source_of_memory(struct sg_source *s, const char *path, const void *data, size_t size)
{
    *s = (struct sg_source){.path = path, .size = size, .window = data, .ready = size};
}

void sg_source_close(struct sg_source *s)
{
    if (s->owned)
        fclose(s->file);
    if (s->unpacker)
        s->unpacker->close(s->unpacker);
    sg_free(s->buffer);
    *s = (struct sg_source){0};
}

static size_t unpack(struct sg_source *s, char *to, size_t n)
{
    const size_t got = s->unpacker->read(s->unpacker, to, n);
    s->unpacked += got;
    s->failed |= s->unpacker->failed;
    return got;
}

/* Up to n bytes from the place where the window ends. 0: the end, or the file was cut in the
 * meantime, or damage, or an error of the system. In each case the caller finds too few bytes. */
static size_t read_on(struct sg_source *s, char *to, size_t n)
{
    const uint64_t from = s->at + s->ready;
    while (s->unpacker && s->unpacked < from) { /* what was passed over */
        const uint64_t passed = from - s->unpacked;
        if (!unpack(s, to, passed < n ? (size_t) passed : n))
            return 0;
    }
    if (s->unpacker)
        return unpack(s, to, n);
    ssize_t got;
    do
        got = pread(fileno(s->file), to, n, (off_t) from);
    while (got < 0 && errno == EINTR);
    if (got < 0)
        failed(s);
    return got > 0 ? (size_t) got : 0;
}

size_t sg_source_fill(struct sg_source *s, size_t n)
{
    if (!s->buffer || s->ready >= n)
        return s->ready;
    if (s->window != s->buffer) {
        memmove(s->buffer, s->window, s->ready);
        s->window = s->buffer;
    }
    while (s->ready < n) {
        const uint64_t unread = sg_source_left(s) - s->ready;
        const size_t room = s->room - s->ready, most = unread < room ? (size_t) unread : room,
                     got = most ? read_on(s, s->buffer + s->ready, most) : 0;
        if (!got)
            break;
        s->ready += got;
    }
    return s->ready;
}

int sg_source_read(sg_ctx *ctx, struct sg_source *s, char **data, size_t *size)
{
    const uint64_t left = sg_source_left(s);
    *size = 0;
    *data = left < SIZE_MAX ? sg_alloc_raw(ctx, SG_MEM_MISC, (size_t) left + 1, 1) : NULL;
    if (!*data && sg_mem_limit(ctx)) { /* say which file */
        sg_clear_error(ctx);
        sg_fail(ctx, SG_ERR_BUDGET, "%s: memory: found %llu bytes, the limit for all is %llu",
                s->path, (unsigned long long) left, (unsigned long long) sg_mem_limit(ctx));
    }
    if (!*data)
        return SG_ERR_BUDGET;
    while (*size < left) {
        const size_t n = sg_source_fill(s, 1);
        if (!n) {
            sg_free(*data);
            *data = NULL;
            return sg_fail(ctx, SG_ERR_INPUT, "%s: found %zu bytes, expected %llu: cannot read on",
                           s->path, *size, (unsigned long long) left);
        }
        memcpy(*data + *size, s->window, n);
        sg_source_skip(s, n);
        *size += n;
    }
    (*data)[*size] = 0;
    return SG_OK;
}

void sg_source_skip(struct sg_source *s, uint64_t n)
{
    const size_t held = n < s->ready ? (size_t) n : s->ready;
    s->window += held;
    s->ready -= held;
    s->at += n;
    if (!s->ready && s->buffer)
        s->window = s->buffer;
}

int sg_source_skip_mark(sg_ctx *ctx, struct sg_source *s)
{
    const size_t n = sg_source_fill(s, 4);
    if (n >= 3 && !memcmp(s->window, "\xef\xbb\xbf", 3))
        sg_source_skip(s, 3);
    else if (n >= 2 && (!memcmp(s->window, "\xff\xfe", 2) || !memcmp(s->window, "\xfe\xff", 2)))
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: byte 0: found the byte-order mark of UTF-16 or UTF-32, expected UTF-8",
                       s->path);
    else if (n >= 4 && !memcmp(s->window, "\0\0\xfe\xff", 4))
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: byte 0: found the byte-order mark of UTF-32, expected UTF-8", s->path);
    return SG_OK;
}
