/* SPDX-License-Identifier: Apache-2.0 */
/* A folder of photos without cameras, for commands that look at pixels alone. */
#ifndef CLI_PHOTO_FOLDER_H
#define CLI_PHOTO_FOLDER_H

#include "commands.h"

/* Whether a folder has photos itself, and no file or folder by which a scene is recognised. */
bool is_photo_folder(const char *path);

/* Whether a path is that of a file with the name of a photo. */
bool is_photo(const char *path);

/* Warns of what may hide photos and is not looked at: sub-folders, links that lead out, unless they
 * are followed, and what is no file. With params->strict it is refused. Returns an exit code. */
int photo_folder_check(const char *path, const struct sg_scene_params *params);

struct photo_folder;

/* Its photos by name as training views, at their own size; their cameras say nothing. Photos are
 * read again when they are needed, so that few are in memory at once. Of params only eval,
 * test_every, max_images, max_pixels and follow_links are used. Clear *folder after *scene, in any
 * case. Returns an error of the library. */
int photo_folder_load(sg_ctx *ctx, const char *path, const struct sg_scene_params *params,
                      struct photo_folder **folder, struct sg_scene **scene);
void photo_folder_clear(struct photo_folder **folder);

#endif
