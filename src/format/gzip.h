/* SPDX-License-Identifier: Apache-2.0 */
/* gzip streams through fixed buffers. zlib's memory is taken from the context. */
#ifndef SG_FORMAT_GZIP_H
#define SG_FORMAT_GZIP_H

#include <stdio.h>

#include "core/zip.h"

struct sg_gunzip;
/* in: at the first byte of a gzip stream; must outlive *out. SG_ERR_USAGE: built without zlib. */
int sg_gunzip_open(sg_ctx *ctx, struct sg_source *in, struct sg_gunzip **out);
/* Exactly n bytes; SG_ERR_INPUT where there are fewer or the stream is damaged. */
int sg_gunzip_read(struct sg_gunzip *g, void *to, size_t n);
/* SG_ERR_INPUT unless the stream ends here, with the right checksum, and the file with it. */
int sg_gunzip_finish(struct sg_gunzip *g);
void sg_gunzip_close(struct sg_gunzip **g); /* NULL-safe */

struct sg_gzip;
/* path: of the file that is written, for messages. */
int sg_gzip_open(sg_ctx *ctx, const char *path, FILE *to, struct sg_gzip **out);
/* What cannot be written is noticed where the file is committed. */
void sg_gzip_write(struct sg_gzip *g, const void *bytes, size_t n);
void sg_gzip_finish(struct sg_gzip **g); /* writes the rest and closes; NULL-safe */

#endif
