/* SPDX-License-Identifier: Apache-2.0 */
/* A folder of photos without cameras, for what looks at pixels alone. Whatever could become a photo
 * of a training is looked at or named, whatever its name. */
#include <limits.h>
#include <stdio.h>
#include <string.h>

#include "image/image.h"
#include "scene/reader.h"

/* COLMAP and the readers of scenes go by what a file begins with. */
static bool begins_as_photo(sg_ctx *ctx, const struct sg_folder *dir, const char *path)
{
    struct sg_source in;
    struct sg_failure failure = {.code = SG_OK};
    sg_failures_apart(&failure); /* one that cannot be read is none */
    const bool is = !sg_folder_source(ctx, dir, path, UINT64_MAX, &in) && sg_image_recognised(&in);
    sg_source_close(&in);
    sg_failures_apart(NULL);
    if (failure.code == SG_ERR_BUDGET)
        sg_fail(ctx, SG_ERR_BUDGET, "%s", failure.text);
    return is;
}

enum entry { ENTRY_PHOTO, ENTRY_OTHER, ENTRY_UNSEEN };

/* What an entry of the folder is. *what: of one that may hide photos, but is not looked at. */
static enum entry look_at(sg_ctx *ctx, const struct sg_folder *dir, const char *name,
                          const char *path, const char **what)
{
    const bool hidden = *name == '.', named = !hidden && sg_photo_ending(name);
    *what = NULL;
    if (!dir->follow_links && sg_folder_leads_out(dir, path))
        *what = hidden ? NULL : "a link out of the folder";
    else if (sg_folder_has_folder(dir, path))
        *what = hidden ? NULL : "a folder";
    else if (!sg_folder_has(dir, path))
        *what = named ? "no file" : NULL;
    else if (named || begins_as_photo(ctx, dir, path)) {
        *what = hidden ? "a hidden photo" : NULL;
        return hidden ? ENTRY_UNSEEN : ENTRY_PHOTO;
    }
    return *what ? ENTRY_UNSEEN : ENTRY_OTHER;
}

struct listing {
    sg_ctx *ctx;
    const struct sg_folder *dir;
    const struct sg_scene_params *params;
    struct sg_shots *shots;
    bool found; /* any photo */
    size_t unseen;
    char first[NAME_MAX + 1]; /* of those, by name */
    const char *first_what;
};

static int add_shot(struct listing *l, const char *name, char **path)
{
    struct sg_shot *shot;
    int code = sg_shots_add(l->ctx, l->shots, l->params->max_images, l->dir->path, name, &shot);
    if (code)
        return code;
    shot->path = *path;
    *path = NULL;
    sg_free(shot->name); /* names of whole files differ */
    shot->name = sg_strdup(l->ctx, name);
    shot->drop_alpha = true; /* as for COLMAP, which will have to find the cameras */
    shot->lens.angle_x = 1;
    shot->R[0] = shot->R[4] = shot->R[8] = 1;
    return shot->name ? SG_OK : SG_ERR_BUDGET;
}

static int list_entry(void *arg, const char *name)
{
    struct listing *l = arg;
    const char *what;
    char *path = sg_strf(l->ctx, "%s/%s", l->dir->path, name);
    if (!path)
        return SG_ERR_BUDGET;
    const enum entry entry = look_at(l->ctx, l->dir, name, path, &what);
    int code = sg_failed(l->ctx) ? SG_ERR_BUDGET : SG_OK;
    if (!code && entry == ENTRY_PHOTO)
        code = add_shot(l, name, &path);
    const bool masks = l->params->masks && !strcmp(name, l->params->masks);
    if (entry == ENTRY_UNSEEN && !masks && (!l->unseen++ || strcmp(name, l->first) < 0)) {
        snprintf(l->first, sizeof(l->first), "%s", name);
        l->first_what = what;
    }
    sg_free(path);
    return code;
}

static int find_photo(void *arg, const char *name)
{
    struct listing *l = arg;
    const char *what;
    char *path = l->found ? NULL : sg_strf(l->ctx, "%s/%s", l->dir->path, name);
    l->found |= path && look_at(l->ctx, l->dir, name, path, &what) == ENTRY_PHOTO;
    sg_free(path);
    return sg_failed(l->ctx) ? SG_ERR_BUDGET : SG_OK;
}

int sg_is_photos(sg_ctx *ctx, const struct sg_folder *dir, bool *is)
{
    struct listing l = {.ctx = ctx, .dir = dir};
    const int code = sg_folder_each(ctx, dir, find_photo, &l);
    *is = !code && l.found;
    return code;
}

int sg_read_photos(sg_ctx *ctx, const struct sg_folder *dir, const struct sg_scene_params *params,
                   struct sg_shots *shots, struct sg_points *points)
{
    (void) points;
    struct listing l = {.ctx = ctx, .dir = dir, .params = params, .shots = shots};
    const int code = sg_folder_each(ctx, dir, list_entry, &l);
    if (code)
        return code;
    sg_shots_sort(shots);
    if (!l.unseen)
        return SG_OK;
    if (params->strict)
        return sg_fail(ctx, SG_ERR_INPUT, "%s/%s: found %s, expected photos alone", dir->path,
                       l.first, l.first_what);
    sg_log(ctx, SG_LOG_WARN, "%s: %zu of its entries %s not looked at; the first is %s, %s",
           dir->path, l.unseen, l.unseen == 1 ? "is" : "are", l.first, l.first_what);
    return SG_OK;
}
