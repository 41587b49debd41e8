/* SPDX-License-Identifier: Apache-2.0 */
/* A file read from front to back through a window of fixed size: memory does not grow with the
 * file. */
#ifndef SG_CORE_SOURCE_H
#define SG_CORE_SOURCE_H

#include <stdio.h>

#include "context.h"

#define SG_SOURCE_WINDOW ((size_t) 1 << 18) /* the most bytes that one call returns */

/* What a source may read from in place of a file, from front to back. */
struct sg_unpacker {
    /* 1 to n bytes; 0 at the end, or after an error of the context. */
    size_t (*read)(struct sg_unpacker *unpacker, void *to, size_t n);
    void (*close)(struct sg_unpacker *unpacker);
    bool failed; /* as below */
};

struct sg_source {
    sg_ctx *ctx;      /* for errors of the system; NULL for memory */
    const char *path; /* for messages */
    FILE *file;       /* without this and the next, the window holds everything */
    struct sg_unpacker *unpacker;
    uint64_t unpacked; /* bytes that it has been asked for */
    bool owned;        /* the file is closed with the source */
    uint64_t size, at;
    char *buffer;       /* NULL for memory */
    size_t room;        /* in it */
    const char *window; /* holds the bytes from `at` on: `ready` of them */
    size_t ready;
    bool failed; /* the system could not open or read it: what it holds is not to blame */
};

/* path must outlive s. More than max_bytes: SG_ERR_INPUT. To be closed, after a failure too. Errors
 * of the system while it is read are recorded in the context, and then it seems to end early. */
int sg_source_open(sg_ctx *ctx, struct sg_source *s, const char *path, uint64_t max_bytes);
/* The same of a file that the caller has opened and closes, and of bytes in memory. */
int sg_source_of_file(sg_ctx *ctx, struct sg_source *s, FILE *file, const char *path,
                      uint64_t max_bytes);
void sg_source_of_memory(struct sg_source *s, const char *path, const void *data, size_t size);
/* The same of `size` bytes that an unpacker gives. Takes it, also where this fails. */
int sg_source_of_unpacker(sg_ctx *ctx, struct sg_source *s, const char *path,
                          struct sg_unpacker *unpacker, uint64_t size);
void sg_source_close(struct sg_source *s);

/* Bytes that are left, by the size that the file had when it was opened. */
static inline uint64_t sg_source_left(const struct sg_source *s)
{
    return s->size - s->at;
}

/* Reads on until the window holds n bytes or the rest of the file. Returns how many it holds. */
size_t sg_source_fill(struct sg_source *s, size_t n);

/* The next n bytes, at most SG_SOURCE_WINDOW; NULL if fewer are left. Valid until the next call. */
static inline const char *sg_source_peek(struct sg_source *s, size_t n)
{
    return s->ready >= n || sg_source_fill(s, n) >= n ? s->window : NULL;
}

/* Passes over bytes, at most those that are left. */
void sg_source_skip(struct sg_source *s, uint64_t n);

/* All that is left, with a zero byte after it: sg_free(*data). */
int sg_source_read(sg_ctx *ctx, struct sg_source *s, char **data, size_t *size);

/* Passes over the byte-order mark that some editors put before a text. SG_ERR_INPUT for text that
 * is UTF-16 or UTF-32, by its mark. */
int sg_source_skip_mark(sg_ctx *ctx, struct sg_source *s);

#endif
