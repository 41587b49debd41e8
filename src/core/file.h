/* SPDX-License-Identifier: Apache-2.0 */
/* Files that appear whole, and files that are read with a limit. */
#ifndef SG_CORE_FILE_H
#define SG_CORE_FILE_H

#include <dirent.h>
#include <stdbool.h>
#include <stdio.h>

#include "context.h"

/* What follows the last slash. */
const char *sg_base_name(const char *path);

/* Takes over a descriptor that was opened to read. NULL: see errno, EINVAL for a pipe or folder. */
FILE *sg_regular_stream(int fd);
/* What errno says after a file was not opened, as an error. */
int sg_open_failed(sg_ctx *ctx, const char *path);

/* Writes go to a temporary name beside the target; commit syncs and renames, abandon removes. */
struct sg_file_writer {
    FILE *stream;
    char *path, *temporary;
};
int sg_file_create(sg_ctx *ctx, struct sg_file_writer *w, const char *path);
/* Both check every earlier write of the stream: one place to report a full disk. sync: before the
 * commit of a file that must not appear without this one. */
int sg_file_sync(sg_ctx *ctx, const struct sg_file_writer *w);
int sg_file_commit(sg_ctx *ctx, struct sg_file_writer *w);
void sg_file_abandon(struct sg_file_writer *w); /* safe after commit, and on a zeroed writer */

/* For reading, from a regular file: pipes and devices are refused without waiting for them. */
int sg_file_open(sg_ctx *ctx, const char *path, FILE **out);

/* Whole file into memory with a zero byte after it. Larger than max_bytes: SG_ERR_INPUT. Free with
 * sg_free. */
int sg_file_read(sg_ctx *ctx, const char *path, uint64_t max_bytes, char **data, size_t *size);
int sg_file_write(sg_ctx *ctx, const char *path, const void *data, size_t size);

/* Removes the temporary files of a killed process from a folder: of those that were to get a name
 * of its own. */
void sg_remove_temporary(DIR *folder, bool (*is_own)(const char *name));

/* Numbers as bytes, the lowest first on every machine. Errors are those of the stream. */
void sg_put_int(FILE *to, uint64_t value, int bytes);
void sg_put_real(FILE *to, double value);

bool sg_file_exists(const char *path);
bool sg_dir_exists(const char *path);
/* mkdir -p, also while other processes remove empty folders. made: length of the path of the first
 * folder that was made, or 0. After an error none is left of those. */
int sg_dir_make(sg_ctx *ctx, const char *path, size_t *made);
/* Removes what sg_dir_make made, as far as it is empty. Cuts the path. */
void sg_dir_unmake(char *path, size_t made);
int sg_dir_create(sg_ctx *ctx, const char *path);

/* FOLDER/NAME. SG_ERR_INPUT where a folder in NAME is a link: nothing is written or removed through
 * one. The caller frees *out with sg_free, also after that. */
int sg_path_below(sg_ctx *ctx, const char *folder, const char *name, char **out);

#endif
