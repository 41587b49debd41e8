/* SPDX-License-Identifier: Apache-2.0 */
/* A zip archive in memory, for reading: entries that are stored or deflated, without zip64,
 * encryption and parts. And one that is written: its entries are stored. */
#ifndef SG_FORMAT_ZIP_H
#define SG_FORMAT_ZIP_H

#include <stdio.h>

#include "core/internal.h"

/* The largest archive whose places all fit in 32 bits. */
#define SG_ZIP_MAX ((uint64_t) UINT32_MAX)

struct sg_zip {
    sg_ctx *ctx;
    const char *path; /* for messages */
    const uint8_t *data;
    size_t size;
    size_t directory, directory_end; /* bytes of it */
    unsigned entries;
};

/* data must outlive *out. SG_ERR_INPUT for what is no archive; SG_ERR_USAGE: built without zlib. */
int sg_zip_open(sg_ctx *ctx, const char *path, const uint8_t *data, size_t size,
                struct sg_zip *out);
/* The first entry of a name, in memory of its own: sg_free(*data). SG_ERR_INPUT if there is none,
 * if it is damaged, or has more than `most` bytes, which is known before memory is taken. */
int sg_zip_read(const struct sg_zip *zip, const char *name, size_t most, uint8_t **data,
                size_t *size);

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
