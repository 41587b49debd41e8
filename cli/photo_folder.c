/* SPDX-License-Identifier: Apache-2.0 */
#include "photo_folder.h"

#include <dirent.h>
#include <limits.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>
#include <unistd.h>

#include "interrupt.h"

struct photo {
    struct photo_folder *folder;
    char *name;
    int width, height;
    struct sg_picture first; /* what was read for its size, until the builder has asked for it */
};

struct photo_folder {
    sg_ctx *ctx; /* its own: the library's may not be used while it asks for pixels */
    const char *path;
    uint64_t max_pixels;
    struct photo *photos;
    size_t n;
};

static bool is_photo_name(const char *name)
{
    static const char *const endings[] = {".png", ".jpg", ".jpeg", ".webp"};
    const char *dot = strrchr(name, '.');
    bool is = false;
    for (size_t i = 0; i < sizeof(endings) / sizeof(endings[0]) && dot; i++)
        is |= dot > name && !strcasecmp(dot, endings[i]);
    return is;
}

bool is_photo(const char *path)
{
    struct stat st;
    return is_photo_name(path) && !stat(path, &st) && S_ISREG(st.st_mode);
}

static bool has(const char *folder, const char *name)
{
    char path[PATH_MAX];
    return snprintf(path, sizeof(path), "%s/%s", folder, name) < (int) sizeof(path) &&
           !access(path, F_OK);
}

bool is_photo_folder(const char *path)
{
    static const char *const scene[] = {"sparse", "transforms_train.json", "transforms.json"};
    bool any = false;
    for (size_t i = 0; i < sizeof(scene) / sizeof(scene[0]); i++)
        if (has(path, scene[i]))
            return false;
    DIR *d = opendir(path);
    for (struct dirent *e; d && !any && (e = readdir(d));)
        any = is_photo_name(e->d_name);
    if (d)
        closedir(d);
    return any;
}

static int compare_names(const void *a, const void *b)
{
    return strcmp(((const struct photo *) a)->name, ((const struct photo *) b)->name);
}

static bool leads_out(const char *folder, const char *path)
{
    char *above = realpath(folder, NULL), *place = realpath(path, NULL);
    const bool inside = above && place && strcmp(place, above) != 0 && is_below(place, above);
    free(above);
    free(place);
    return !inside;
}

enum entry { ENTRY_PHOTO, ENTRY_OTHER, ENTRY_UNSEEN };

/* What an entry of a folder is. *what: of one that may hide photos, but is not looked at. */
static enum entry look_at(const char *folder, const char *name, bool follow_links,
                          const char **what)
{
    char path[PATH_MAX];
    struct stat st, own;
    const bool known = snprintf(path, sizeof(path), "%s/%s", folder, name) < (int) sizeof(path) &&
                       !lstat(path, &own) && !stat(path, &st);
    *what = NULL;
    if (known && S_ISDIR(st.st_mode))
        *what = *name == '.' ? NULL : "a folder";
    else if (!is_photo_name(name))
        return ENTRY_OTHER;
    else if (!known)
        *what = "no file";
    else if (!S_ISREG(st.st_mode))
        *what = "a device or pipe";
    else if (!follow_links && S_ISLNK(own.st_mode) && leads_out(folder, path))
        *what = "a link out of the folder";
    else
        return ENTRY_PHOTO;
    return *what ? ENTRY_UNSEEN : ENTRY_OTHER;
}

int photo_folder_check(const char *path, const struct sg_scene_params *params)
{
    DIR *d = opendir(path);
    size_t unseen = 0;
    char first[NAME_MAX + 1];
    const char *what, *first_what = NULL;
    for (struct dirent *e; d && (e = readdir(d));) {
        if (look_at(path, e->d_name, params->follow_links, &what) != ENTRY_UNSEEN)
            continue;
        if (!unseen++ || strcmp(e->d_name, first) < 0) {
            snprintf(first, sizeof(first), "%s", e->d_name);
            first_what = what;
        }
    }
    if (d)
        closedir(d);
    if (!unseen)
        return STATUS_DONE;
    if (params->strict) {
        say(stderr, "splatguard audit: %s/%s: found %s, expected photos alone\n", path, first,
            first_what);
        return STATUS_INPUT;
    }
    say(stderr, "warning: %s: %zu of its entries %s not looked at; the first is %s, %s\n", path,
        unseen, unseen == 1 ? "is" : "are", first, first_what);
    return STATUS_DONE;
}

/* Its photos by name. Returns whether there was memory for them. */
static bool list(struct photo_folder *f, bool follow_links)
{
    DIR *d = opendir(f->path);
    bool good = true;
    const char *what;
    for (struct dirent *e; d && good && (e = readdir(d));) {
        if (look_at(f->path, e->d_name, follow_links, &what) != ENTRY_PHOTO)
            continue;
        struct photo *more = realloc(f->photos, (f->n + 1) * sizeof(*more));
        good = more != NULL;
        if (good) {
            f->photos = more;
            f->photos[f->n] = (struct photo){.folder = f, .name = strdup(e->d_name)};
            good = f->photos[f->n].name != NULL;
            f->n += good;
        }
    }
    if (d)
        closedir(d);
    if (f->n)
        qsort(f->photos, f->n, sizeof(*f->photos), compare_names);
    return good;
}

static int read_picture(sg_ctx *ctx, const struct photo *p, struct sg_picture *out)
{
    char path[PATH_MAX];
    snprintf(path, sizeof(path), "%s/%s", p->folder->path, p->name);
    return sg_picture_read(ctx, path, p->folder->max_pixels, out);
}

/* sg_view_desc.read. A photo that has another size than before has changed. */
static int read_photo(void *priv, uint8_t *rgb)
{
    struct photo *p = priv;
    struct sg_picture picture = p->first;
    p->first = (struct sg_picture){0};
    const bool good = (picture.rgb || !read_picture(p->folder->ctx, p, &picture)) &&
                      picture.width == p->width && picture.height == p->height;
    if (good)
        memcpy(rgb, picture.rgb, 3 * (size_t) p->width * (size_t) p->height);
    sg_picture_clear(&picture);
    return !good;
}

static int add_photo(sg_ctx *ctx, sg_scene_builder *builder, struct photo *p, size_t place)
{
    int code = read_picture(ctx, p, &p->first);
    if (code)
        return code;
    p->width = p->first.width, p->height = p->first.height;
    code = sg_scene_builder_add_view(
        builder, &(struct sg_view_desc){.name = p->name,
                                        .camera = {.width = p->width,
                                                   .height = p->height,
                                                   .fx = p->width,
                                                   .fy = p->width,
                                                   .cx = 0.5 * p->width,
                                                   .cy = 0.5 * p->height,
                                                   .R = {1, 0, 0, 0, 1, 0, 0, 0, 1},
                                                   .t = {(double) place, 0, 0}},
                                        .read = read_photo,
                                        .read_priv = p});
    sg_picture_clear(&p->first); /* where it has not asked */
    return code;
}

/* Leaves photos out that cannot be used, as scenes do. */
static int add_photos(sg_ctx *ctx, sg_scene_builder *builder, struct photo_folder *f, bool strict)
{
    size_t broken = 0;
    char *first = NULL;
    int code = SG_OK;
    for (size_t i = 0; i < f->n && !code; i++) {
        code = interrupted() ? SG_ERR_INTERRUPTED : add_photo(ctx, builder, &f->photos[i], i);
        if (code == SG_ERR_USAGE) /* its name, which is input here */
            code = SG_ERR_INPUT;
        if (code != SG_ERR_INPUT || strict)
            continue;
        if (!broken++)
            first = strdup(sg_last_error(ctx));
        code = broken == f->n ? SG_ERR_INPUT : SG_OK;
    }
    if (!code && broken)
        say(stderr,
            "warning: %s: %zu of %zu photos cannot be used and are skipped; the first: %s\n",
            f->path, broken, f->n, first ? first : "");
    free(first);
    return code;
}

int photo_folder_load(sg_ctx *ctx, const char *path, const struct sg_scene_params *params,
                      struct photo_folder **folder, struct sg_scene **scene)
{
    struct photo_folder *f = *folder = calloc(1, sizeof(*f));
    sg_scene_builder *builder = NULL;
    *scene = NULL;
    if (!f)
        return SG_ERR_BUDGET;
    f->path = path, f->max_pixels = params->max_pixels;
    /* The rest is for the pixels that a decoded photo becomes, less than half as many bytes. */
    const uint64_t most = sg_mem_limit(ctx) / 3 * 2;
    int code = sg_ctx_create(&f->ctx, &(struct sg_ctx_params){.threads = 1, .max_memory = most});
    if (!code)
        code = list(f, params->follow_links) ? sg_scene_builder_create(ctx, params, &builder)
                                             : SG_ERR_BUDGET;
    if (!code)
        code = sg_scene_builder_set_name(builder, path);
    if (!code)
        sg_scene_builder_keep_photos(builder, 0);
    if (!code)
        code = add_photos(ctx, builder, f, params->strict);
    hold_log(true); /* it says what cameras and points there are, and are not */
    if (!code)
        code = sg_scene_builder_finish(&builder, scene);
    hold_log(false);
    sg_scene_builder_destroy(&builder);
    return code;
}

void photo_folder_clear(struct photo_folder **folder)
{
    struct photo_folder *f = *folder;
    for (size_t i = 0; f && i < f->n; i++)
        free(f->photos[i].name);
    if (f) {
        free(f->photos);
        sg_ctx_destroy(&f->ctx);
    }
    free(f);
    *folder = NULL;
}
