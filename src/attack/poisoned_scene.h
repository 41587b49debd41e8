/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SG_POISONED_SCENE_H
#define SG_POISONED_SCENE_H

#include "splatguard/attack.h"

/* What sg_poisoned_scene_begin refuses of a scene wherever its copy goes: SG_ERR_INPUT for photos
 * that would have one file, and for file names that are too long. For whom the images cost time. */
int sg_poisoned_scene_check(sg_ctx *ctx, const struct sg_scene *scene,
                            const struct sg_poison_files *files);

/* Whether the images of two views are one file of the copy. Others can be written by several
 * threads at once. */
bool sg_poisoned_scene_shares_file(const struct sg_scene *scene, const struct sg_view *one,
                                   const struct sg_view *other);

#endif
