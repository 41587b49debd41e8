/* SPDX-License-Identifier: Apache-2.0 */
/* The format of the NeRF synthetic scenes (Mildenhall et al. 2020): transforms_train.json and
 * transforms_test.json. */
#include <stdio.h>

#include "scene/transforms.h"

bool sg_is_blender(sg_ctx *ctx, const struct sg_folder *dir)
{
    (void) ctx;
    return sg_has_file(dir, "transforms_train.json");
}

int sg_blender_parse(sg_ctx *ctx, const char *file, const char *data, size_t size,
                     uint64_t max_images, bool test, struct sg_shots *shots)
{
    struct sg_transforms doc;
    size_t first = shots->count;
    int code = sg_transforms_load(ctx, file, data, size, max_images, &doc);
    if (code)
        return code;
    struct sg_lens lens = {0};
    code = sg_json_lens(ctx, doc.root, file, &lens);
    if (!code && !(lens.angle_x > 0) && !(lens.fx > 0))
        code =
            sg_fail(ctx, SG_ERR_INPUT,
                    "%s: found no usable \"camera_angle_x\", expected an angle in radians", file);
    for (size_t i = 0; i < json_array_size(doc.frames) && !code; i++) {
        char where[512];
        struct sg_shot *shot;
        snprintf(where, sizeof(where), "%s: frame %zu", file, i);
        code = sg_transforms_frame(ctx, json_array_get(doc.frames, i), where, &lens, max_images,
                                   shots, &shot);
        if (!code)
            shot->split = test ? SG_SPLIT_TEST : SG_SPLIT_TRAIN;
    }
    if (!code)
        code = sg_shots_check_names(ctx, shots, first, file);
    sg_transforms_clear(&doc);
    return code;
}

static int read_split(sg_ctx *ctx, const struct sg_folder *dir, const char *name,
                      const struct sg_scene_params *params, bool test, struct sg_shots *shots)
{
    char *data = NULL;
    size_t size, first = shots->count;
    char *file = sg_strf(ctx, "%s/%s", dir->path, name);
    int code = file ? sg_transforms_read(ctx, dir, file, &data, &size) : SG_ERR_BUDGET;
    if (!code)
        code = sg_blender_parse(ctx, file, data, size, params->max_images, test, shots);
    for (size_t i = first; i < shots->count && !code; i++)
        code = sg_find_photo(ctx, dir, shots->items[i].file, &shots->items[i].path);
    sg_free(data);
    sg_free(file);
    return code;
}

int sg_read_blender(sg_ctx *ctx, const struct sg_folder *dir, const struct sg_scene_params *params,
                    struct sg_shots *shots, struct sg_points *points)
{
    int code = read_split(ctx, dir, "transforms_train.json", params, false, shots);
    if (!code && params->eval && !sg_has_file(dir, "transforms_test.json"))
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: found no transforms_test.json, expected one with the test views",
                       dir->path);
    if (!code && params->eval)
        code = read_split(ctx, dir, "transforms_test.json", params, true, shots);
    if (!code)
        code = sg_shots_drop_missing(ctx, params, shots, dir->path);
    if (code || !sg_has_file(dir, "points3d.ply")) /* the file that the reference reads, and where
                                                      it saves its random points */
        return code;
    char *path = sg_strf(ctx, "%s/points3d.ply", dir->path);
    code = path ? sg_read_points(ctx, dir, path, params->max_points, points) : SG_ERR_BUDGET;
    sg_free(path);
    return code;
}
