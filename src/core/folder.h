/* SPDX-License-Identifier: Apache-2.0 */
/* A folder that is not trusted. Its files are opened beneath it: symbolic links are followed only
 * as long as they stay inside, even if somebody changes the folder in the meantime. Or a zip
 * archive, whose entries are its files; where all are in one folder, that one stands for it. */
#ifndef SG_CORE_FOLDER_H
#define SG_CORE_FOLDER_H

#include "file.h"
#include "source.h"
#include "zip.h"

bool sg_path_is_inside(const char *path); /* relative and without ".." */

struct sg_folder {
    char *path;         /* as given: its own last part may be a link */
    char *real;         /* absolute, without links: absolute links that begin with it stay inside */
    int fd;             /* of the folder or archive; -1 = not open */
    struct sg_zip *zip; /* NULL: a folder */
    char *top;          /* the folder of all of the archive's files, with its slash, or "" */
    bool follow_links;  /* also those that lead out of it */
};

/* SG_ERR_INPUT where there is no such folder, or an archive that is damaged, has a name that leads
 * out of it, or claims far more bytes than it has. After a failure *out is closed. */
int sg_folder_open(sg_ctx *ctx, const char *path, bool follow_links, struct sg_folder *out);
void sg_folder_close(struct sg_folder *folder);

/* In all of these, path is PATH/NAME, as messages have it. Thread safe. */

/* Opens once, so that the file that was checked is the file that is read. path must outlive *out,
 * which is to be closed, after a failure too. More than max_bytes: SG_ERR_INPUT. */
int sg_folder_source(sg_ctx *ctx, const struct sg_folder *folder, const char *path,
                     uint64_t max_bytes, struct sg_source *out);

/* As sg_file_read. */
int sg_folder_read(sg_ctx *ctx, const struct sg_folder *folder, const char *path,
                   uint64_t max_bytes, char **data, size_t *size);

/* Whether there is such a file or folder. A link that leads out counts as one: opening it reports
 * the error. */
bool sg_folder_has(const struct sg_folder *folder, const char *path);
bool sg_folder_has_folder(const struct sg_folder *folder, const char *path);
bool sg_folder_leads_out(const struct sg_folder *folder, const char *path);

/* Calls entry with each name in the folder itself, without "." and "..", in no order, until it
 * returns an error, which is returned. An archive's names are those below its top folder. */
int sg_folder_each(sg_ctx *ctx, const struct sg_folder *folder,
                   int (*entry)(void *arg, const char *name), void *arg);

#endif
