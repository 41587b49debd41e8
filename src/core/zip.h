/* SPDX-License-Identifier: Apache-2.0 */
/* Zip archives. Those that are read are not trusted: entries are stored or deflated, without zip64,
 * encryption and parts, and no name is there twice. Entries that are written are stored. */
#ifndef SG_CORE_ZIP_H
#define SG_CORE_ZIP_H

#include <stdio.h>

#include "source.h"

/* The largest archive whose places all fit in 32 bits. */
#define SG_ZIP_MAX ((uint64_t) UINT32_MAX)
/* The most that one byte of deflate can stand for: a claim beyond is refused before memory is
 * taken. */
#define SG_DEFLATE_RATIO 1032

struct sg_zip_entry {
    const char *name;
    uint32_t at, packed, size, crc;
    unsigned method, flags;
};

struct sg_zip {
    sg_ctx *ctx;
    const char *path;             /* for messages */
    int fd;                       /* the caller's */
    uint64_t directory;           /* where it begins: entries are before it */
    struct sg_zip_entry *entries; /* by name */
    size_t count;
    char *names;
};

/* Reads the directory of an archive of `size` bytes. fd and path must outlive *out, which is to be
 * closed after a failure too. SG_ERR_INPUT for what is no archive; SG_ERR_USAGE: built without
 * zlib. */
int sg_zip_open(sg_ctx *ctx, const char *path, int fd, uint64_t size, struct sg_zip *out);
void sg_zip_close(struct sg_zip *zip);

/* In these, nothing of the archive changes: they are thread safe. */

/* The first entry whose name is not below a text; `count` if there is none. */
size_t sg_zip_from(const struct sg_zip *zip, const char *name);
/* NULL if there is none. */
const struct sg_zip_entry *sg_zip_find(const struct sg_zip *zip, const char *name);
/* A source that unpacks an entry as it is read. path, for messages, must outlive it. More than
 * max_bytes: SG_ERR_INPUT. Damage is an error of the context and an early end. To be closed, after
 * a failure too. */
int sg_zip_source(const struct sg_zip *zip, const struct sg_zip_entry *entry, const char *path,
                  uint64_t max_bytes, struct sg_source *out);

#define SG_ZIP_ENTRIES 16 /* of an archive that is written */
#define SG_ZIP_NAME 32    /* of a name in one, with its zero */

struct sg_zip_writer {
    sg_ctx *ctx;
    FILE *to;
    const char *path; /* for messages */
    uint64_t at;      /* bytes that are written */
    unsigned count;
    struct {
        char name[SG_ZIP_NAME];
        uint32_t crc, size, at;
    } entry[SG_ZIP_ENTRIES];
};

/* For a writer with ctx, to and path set, the rest zero. SG_ERR_INPUT where the archive would be
 * larger than SG_ZIP_MAX. What cannot be written is noticed where the file is committed. */
int sg_zip_add(struct sg_zip_writer *w, const char *name, const void *data, size_t size);
void sg_zip_finish(struct sg_zip_writer *w);

#endif
