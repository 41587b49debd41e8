/* SPDX-License-Identifier: Apache-2.0 */
/* transforms.json as nerfstudio (Tancik et al. 2023) and instant-ngp (Mueller et al. 2022) write
 * it. "applied_transform" is not undone: the writer applied it to poses and points alike, so both
 * are in one frame. */
#include <stdio.h>
#include <string.h>

#include "core/json_text.h"
#include "scene/transforms.h"

bool sg_is_nerfstudio(sg_ctx *ctx, const struct sg_folder *dir)
{
    (void) ctx;
    return sg_has_file(dir, "transforms.json");
}

/* The names of the list called key as an object, for quick look-up; NULL if there is no such
 * list. */
static int get_list(sg_ctx *ctx, const json_t *root, const char *key, const char *file,
                    json_t **set)
{
    size_t i;
    json_t *entry;
    const json_t *list = json_object_get(root, key);
    *set = NULL;
    if (!list || json_is_null(list))
        return SG_OK;
    *set = json_object();
    if (!json_is_array(list))
        return sg_fail(ctx, SG_ERR_INPUT, "%s: \"%s\": found %s, expected an array of names", file,
                       key, sg_json_show(list, (char[SG_JSON_SHOWN]){0}));
    json_array_foreach(list, i, entry)
    {
        const char *name = json_string_value(entry);
        if (!name)
            return sg_fail(ctx, SG_ERR_INPUT, "%s: %s[%zu]: found %s, expected a string", file, key,
                           i, sg_json_show(entry, (char[SG_JSON_SHOWN]){0}));
        while (name[0] == '.' && name[1] == '/')
            name += 2;
        if (json_object_set_new(*set, name, json_true()))
            return sg_fail(ctx, SG_ERR_BUDGET, "%s: %s: no memory for the list", file, key);
    }
    return SG_OK;
}

#define NAME_ROOM 128 /* of a name in a set, besides its text */

/* What sets of all names take. */
static uint64_t bytes_of(const json_t *list)
{
    uint64_t bytes = 0;
    for (size_t i = 0; i < json_array_size(list); i++)
        bytes += NAME_ROOM + json_string_length(json_array_get(list, i));
    return bytes;
}

void sg_split_lists_clear(struct sg_split_lists *l)
{
    json_decref(l->train);
    json_decref(l->test);
    sg_free(l->room);
    *l = (struct sg_split_lists){0};
}

/* The split of the file itself: the frames of its test list, or else of its validation list, are
 * held out. */
static int get_lists(sg_ctx *ctx, const json_t *root, const char *file, struct sg_split_lists *out)
{
    static const char *const keys[] = {"train_filenames", "test_filenames", "val_filenames"};
    uint64_t bytes = 0;
    *out = (struct sg_split_lists){0};
    for (int k = 0; k < 3; k++)
        bytes += bytes_of(json_object_get(root, keys[k]));
    int code = sg_reserve(ctx, SG_MEM_MISC, bytes, &out->room);
    if (!code)
        code = get_list(ctx, root, keys[0], file, &out->train);
    for (int k = 1; k < 3 && !code && !out->test; k++) {
        out->test_key = keys[k];
        code = get_list(ctx, root, out->test_key, file, &out->test);
    }
    return code;
}

int sg_nerfstudio_lists(sg_ctx *ctx, const struct sg_folder *dir, struct sg_split_lists *out)
{
    struct sg_transforms doc = {0};
    char *data = NULL;
    size_t size;
    *out = (struct sg_split_lists){0};
    char *file = sg_strf(ctx, "%s/transforms.json", dir->path);
    int code = file ? sg_transforms_read(ctx, dir, file, &data, &size) : SG_ERR_BUDGET;
    if (!code)
        code = sg_transforms_load(ctx, file, data, size, UINT64_MAX, &doc);
    if (!code)
        code = get_lists(ctx, doc.root, file, out);
    sg_transforms_clear(&doc);
    sg_free(data);
    sg_free(file);
    return code;
}

/* Each name of the test list must be a frame's, else the photo that it means would be learned. */
static int check_test(sg_ctx *ctx, const struct sg_split_lists *l, const char *file)
{
    const char *name;
    json_t *unmatched;
    json_object_foreach(l->test, name, unmatched)
    {
        if (json_is_true(unmatched))
            return sg_fail(ctx, SG_ERR_INPUT,
                           "%s: \"%s\": found \"%s\", expected the \"file_path\" of a frame", file,
                           l->test_key, name);
    }
    return SG_OK;
}

/* Frames in no list are left out. */
static int split_by_lists(sg_ctx *ctx, const json_t *root, const char *file, struct sg_shots *shots)
{
    struct sg_split_lists l;
    int code = get_lists(ctx, root, file, &l);
    size_t unused = 0;
    for (size_t i = 0; i < shots->count && (l.train || l.test) && !code; i++) {
        struct sg_shot *shot = &shots->items[i];
        const bool held_out = json_object_get(l.test, shot->file) != NULL;
        if (held_out) /* in the place of true: it takes no memory */
            json_object_set_new(l.test, shot->file, json_false());
        shot->split = held_out ? SG_SPLIT_TEST : SG_SPLIT_TRAIN;
        shot->unused = !held_out && l.train && !json_object_get(l.train, shot->file);
        unused += shot->unused;
    }
    if (!code)
        code = check_test(ctx, &l, file);
    if (unused && !code)
        sg_log(ctx, SG_LOG_WARN, "%s: %zu of %zu frames are in no split and stay unused", file,
               unused, shots->count);
    sg_split_lists_clear(&l);
    return code;
}

/* Relative to the scene until the photos are looked for. */
static int read_mask_path(sg_ctx *ctx, const json_t *frame, const char *where, struct sg_shot *shot)
{
    const char *mask = NULL;
    const int code = sg_json_text(ctx, frame, "mask_path", where, &mask);
    if (code || !mask)
        return code;
    if (!sg_path_is_inside(mask))
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: \"mask_path\": found \"%s\", expected a path inside the scene", where,
                       mask);
    shot->mask_any = true;
    shot->mask = sg_strdup(ctx, mask);
    return shot->mask ? SG_OK : SG_ERR_BUDGET;
}

int sg_nerfstudio_parse(sg_ctx *ctx, const char *file, const char *data, size_t size,
                        const struct sg_scene_params *params, struct sg_shots *shots,
                        char **points_file)
{
    struct sg_transforms doc;
    *points_file = NULL;
    int code = sg_transforms_load(ctx, file, data, size, params->max_images, &doc);
    if (code)
        return code;
    struct sg_lens common = {0};
    const char *points = NULL;
    code = sg_json_lens(ctx, doc.root, file, &common);
    for (size_t i = 0; i < json_array_size(doc.frames) && !code; i++) {
        char where[512];
        struct sg_shot *shot;
        struct sg_lens lens = common;
        const json_t *frame = json_array_get(doc.frames, i);
        snprintf(where, sizeof(where), "%s: frame %zu", file, i);
        code = sg_json_lens(ctx, frame, where, &lens); /* a frame may have its own camera */
        if (!code)
            code = sg_transforms_frame(ctx, frame, where, &lens, params->max_images, shots, &shot);
        if (!code)
            code = read_mask_path(ctx, frame, where, shot);
    }
    if (!code && params->eval)
        code = split_by_lists(ctx, doc.root, file, shots);
    if (!code)
        code = sg_json_text(ctx, doc.root, "ply_file_path", file, &points);
    if (!code && points) {
        if (!sg_path_is_inside(points))
            code = sg_fail(ctx, SG_ERR_INPUT,
                           "%s: \"ply_file_path\": found \"%s\", expected a path inside the scene",
                           file, points);
        else if (!(*points_file = sg_strdup(ctx, points)))
            code = SG_ERR_BUDGET;
    }
    sg_transforms_clear(&doc);
    return code;
}

static int find_photos(sg_ctx *ctx, const struct sg_folder *dir, const char *file,
                       struct sg_shots *shots)
{
    for (size_t i = 0; i < shots->count; i++) {
        struct sg_shot *shot = &shots->items[i];
        if (shot->unused)
            continue;
        int code = sg_find_photo(ctx, dir, shot->file, &shot->path);
        if (code)
            return code;
        if (!shot->mask)
            continue;
        char *mask = sg_strf(ctx, "%s/%s", dir->path, shot->mask);
        if (!mask)
            return SG_ERR_BUDGET;
        sg_free(shot->mask);
        shot->mask = mask;
        if (shot->path && !sg_folder_has(dir, mask))
            return sg_fail(ctx, SG_ERR_INPUT, "%s: frame of %s: found no mask %s", file, shot->file,
                           mask);
    }
    return SG_OK;
}

int sg_read_nerfstudio(sg_ctx *ctx, const struct sg_folder *dir,
                       const struct sg_scene_params *params, struct sg_shots *shots,
                       struct sg_points *points)
{
    char *data = NULL, *points_file = NULL, *path = NULL;
    size_t size;
    char *file = sg_strf(ctx, "%s/transforms.json", dir->path);
    int code = file ? sg_transforms_read(ctx, dir, file, &data, &size) : SG_ERR_BUDGET;
    if (!code)
        code = sg_nerfstudio_parse(ctx, file, data, size, params, shots, &points_file);
    if (!code)
        code = find_photos(ctx, dir, file, shots);
    if (!code)
        code = sg_shots_drop_missing(ctx, params, shots, file);
    if (!code)
        code = sg_shots_check_names(ctx, shots, 0, file);
    if (!code && points_file) {
        path = sg_strf(ctx, "%s/%s", dir->path, points_file);
        code = path ? sg_read_points(ctx, dir, path, params->max_points, points) : SG_ERR_BUDGET;
    }
    if (code)
        goto done;
    sg_shots_sort(shots);
done:
    sg_free(path);
    sg_free(points_file);
    sg_free(data);
    sg_free(file);
    return code;
}
