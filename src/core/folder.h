/* SPDX-License-Identifier: Apache-2.0 */
/* A folder that is not trusted. Its files are opened beneath it: symbolic links are followed only
 * as long as they stay inside, even if somebody changes the folder in the meantime. */
#ifndef SG_CORE_FOLDER_H
#define SG_CORE_FOLDER_H

#include "file.h"

struct sg_folder {
    char *path;        /* as given: its own last part may be a link */
    char *real;        /* absolute, without links: absolute links that begin with it stay inside */
    int fd;            /* -1 = not open */
    bool follow_links; /* also those that lead out of it */
};

/* SG_ERR_INPUT where there is no such folder. After a failure *out is closed. */
int sg_folder_open(sg_ctx *ctx, const char *path, bool follow_links, struct sg_folder *out);
void sg_folder_close(struct sg_folder *folder);

/* In all of these, path is PATH/NAME, as messages have it. Thread safe. */

/* Opens once, so that the file that was checked is the file that is read. */
int sg_folder_file(sg_ctx *ctx, const struct sg_folder *folder, const char *path, FILE **out);

/* As sg_file_read. */
int sg_folder_read(sg_ctx *ctx, const struct sg_folder *folder, const char *path,
                   uint64_t max_bytes, char **data, size_t *size);

/* Whether there is such a file or folder. A link that leads out counts as one: opening it reports
 * the error. */
bool sg_folder_has(const struct sg_folder *folder, const char *path);
bool sg_folder_has_folder(const struct sg_folder *folder, const char *path);
bool sg_folder_leads_out(const struct sg_folder *folder, const char *path);

#endif
