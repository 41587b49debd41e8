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
    *s = (struct sg_source){.path = path};
    int code = sg_file_open(ctx, path, &file);
    if (!code) {
        code = sg_source_of_file(ctx, s, file, path, max_bytes);
        s->owned = true;
    }
    return code;
}

int sg_source_of_file(sg_ctx *ctx, struct sg_source *s, FILE *file, const char *path,
                      uint64_t max_bytes)
{
    struct stat st;
    *s = (struct sg_source){.path = path, .file = file};
    if (fstat(fileno(file), &st))
        return sg_fail(ctx, SG_ERR_INPUT, "%s: cannot read: %s", path, strerror(errno));
    s->size = (uint64_t) st.st_size;
    if (s->size > max_bytes)
        return sg_fail(ctx, SG_ERR_INPUT, "%s: found %llu bytes, the limit is %llu", path,
                       (unsigned long long) s->size, (unsigned long long) max_bytes);
    s->room = s->size < SG_SOURCE_WINDOW ? (size_t) s->size : SG_SOURCE_WINDOW;
    s->window = s->buffer = sg_alloc_raw(ctx, SG_MEM_MISC, s->room, 1);
    return s->buffer ? SG_OK : SG_ERR_BUDGET;
}

void sg_source_of_memory(struct sg_source *s, const char *path, const void *data, size_t size)
{
    *s = (struct sg_source){.path = path, .size = size, .window = data, .ready = size};
}

void sg_source_close(struct sg_source *s)
{
    if (s->owned)
        fclose(s->file);
    sg_free(s->buffer);
    *s = (struct sg_source){0};
}

size_t sg_source_fill(struct sg_source *s, size_t n)
{
    if (!s->file)
        return s->ready;
    if (s->window != s->buffer) {
        memmove(s->buffer, s->window, s->ready);
        s->window = s->buffer;
    }
    while (s->ready < n) {
        const uint64_t unread = sg_source_left(s) - s->ready;
        const size_t room = s->room - s->ready, most = unread < room ? (size_t) unread : room;
        const ssize_t got =
            most ? pread(fileno(s->file), s->buffer + s->ready, most, (off_t) (s->at + s->ready))
                 : 0;
        if (got < 0 && errno == EINTR)
            continue;
        if (got <= 0) /* the end, or the file was cut in the meantime: in both cases the caller
                         finds too few bytes */
            break;
        s->ready += (size_t) got;
    }
    return s->ready;
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
