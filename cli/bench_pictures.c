/* SPDX-License-Identifier: Apache-2.0 */
/* What a model's views look like: the middle one, and spectra of all, beside those of the photos.
 */
#include <dirent.h>
#include <limits.h>
#include <stdlib.h>
#include <string.h>

#include "bench_work.h"

#define SIDE_MAX 256            /* of the part that is kept, pixels */
#define PIXELS_MAX (1ull << 28) /* of a picture */
#define PHOTO "_photo.png"

const char *const picture_kinds[PICTURE_KINDS] = {
    [PICTURE_PHOTO] = "photo", [PICTURE_RENDER] = "render"};

/* Whether the file is a view's photo: that view's render is beside it. ("a_photo.png" may also be
 * the render of a view "a_photo".) */
static bool is_photo(const char *folder, const char *file)
{
    const size_t length = strlen(file), tail = strlen(PHOTO);
    char render[PATH_MAX];
    if (length <= tail || strcmp(file + length - tail, PHOTO))
        return false;
    snprintf(render, sizeof(render), "%s/%.*s.png", folder, (int) (length - tail), file);
    return file_exists(render);
}

/* The names of the views in the folder, of which each has a photo beside it. */
static int list_views(const char *folder, char ***names)
{
    struct dirent **entries;
    const int found = scandir(folder, &entries, NULL, alphasort);
    int n = 0;
    *names = found > 0 ? calloc((size_t) found, sizeof(**names)) : NULL;
    for (int i = 0; i < found; i++) {
        const char *file = entries[i]->d_name;
        if (*names && is_photo(folder, file) &&
            ((*names)[n] = strndup(file, strlen(file) - strlen(PHOTO))))
            n++;
        free(entries[i]);
    }
    if (found >= 0)
        free(entries);
    return n;
}

static void crop(const struct sg_picture *p, struct sg_picture *out)
{
    const int w = p->width < SIDE_MAX ? p->width : SIDE_MAX,
              h = p->height < SIDE_MAX ? p->height : SIDE_MAX;
    const int x = (p->width - w) / 2, y = (p->height - h) / 2;
    *out = (struct sg_picture){w, h, malloc((size_t) w * (size_t) h * 3)};
    for (int i = 0; i < h && out->rgb; i++)
        memcpy(out->rgb + (size_t) i * (size_t) w * 3,
               p->rgb + ((size_t) (y + i) * (size_t) p->width + (size_t) x) * 3, (size_t) w * 3);
}

/* Keeps the middle of a picture as PNG. */
static int keep(sg_ctx *ctx, const struct sg_picture *p, struct picture *out)
{
    struct sg_picture part;
    void *png = NULL;
    crop(p, &part);
    int error = part.rgb ? sg_picture_encode(ctx, SG_PICTURE_PNG, part.rgb, part.width, part.height,
                                             &png, &out->size)
                         : SG_ERR_BUDGET;
    out->png = error ? NULL : malloc(out->size); /* longer than the context */
    if (out->png)
        memcpy(out->png, png, out->size);
    sg_mem_free(png);
    free(part.rgb);
    return error || out->png ? error : SG_ERR_BUDGET;
}

/* Adds a picture's spectrum to the sums, and keeps the picture where it is the one to show. */
static int add(sg_ctx *ctx, const char *path, bool shown, struct picture *out)
{
    struct sg_picture p = {0};
    struct sg_spectrum s;
    const struct sg_spectrum_params params = {.low = 0.3, .high = 0.9, .bins = PICTURE_DIRECTIONS};
    int error = sg_picture_read(ctx, path, PIXELS_MAX, &p);
    if (!error)
        error = sg_spectrum_measure(ctx, p.rgb, p.width, p.height, &params, &s, NULL);
    if (!error && shown)
        error = keep(ctx, &p, out);
    for (int i = 0; i < SG_SPECTRUM_RINGS && !error; i++)
        out->radial[i] += s.radial[i];
    for (int i = 0; i < PICTURE_DIRECTIONS && !error; i++)
        out->angular[i] += s.angular[i];
    sg_picture_clear(&p);
    return error;
}

int pictures_read(const char *folder, struct pictures *out)
{
    static const char *const endings[PICTURE_KINDS] = {
        [PICTURE_PHOTO] = PHOTO, [PICTURE_RENDER] = ".png"};
    sg_ctx *ctx;
    char **names, path[PATH_MAX];
    *out = (struct pictures){0};
    int error = open_context(&ctx, 1, 0, true);
    if (error)
        return error;
    const int n = list_views(folder, &names);
    for (int i = 0; i < n && !error; i++)
        for (int k = 0; k < PICTURE_KINDS && !error; k++) {
            snprintf(path, sizeof(path), "%s/%s%s", folder, names[i], endings[k]);
            error = add(ctx, path, i == n / 2, &out->kinds[k]);
        }
    for (int k = 0; k < PICTURE_KINDS; k++) {
        for (int i = 0; i < SG_SPECTRUM_RINGS; i++)
            out->kinds[k].radial[i] /= n ? n : 1;
        for (int i = 0; i < PICTURE_DIRECTIONS; i++)
            out->kinds[k].angular[i] /= n ? n : 1;
    }
    if (n)
        snprintf(out->view, sizeof(out->view), "%s", names[n / 2]);
    const int code = n ? report(ctx, error) : STATUS_INPUT;
    for (int i = 0; i < n; i++)
        free(names[i]);
    free(names);
    sg_ctx_destroy(&ctx);
    return code;
}

void pictures_clear(struct pictures *p)
{
    for (int k = 0; k < PICTURE_KINDS; k++)
        free(p->kinds[k].png);
    *p = (struct pictures){0};
}
