/* SPDX-License-Identifier: Apache-2.0 */
/* From a shot to a view: decode, composite, undistort, resample, and the camera that belongs to the
 * result. */
#include <math.h>
#include <pthread.h>
#include <stdatomic.h>
#include <string.h>

#include "image/image.h"
#include "image/smooth.h"
#include "scene/photo.h"
#include "scene/reader.h"
#include "scene/used.h"

struct job {
    sg_ctx *ctx;
    const struct sg_scene_files *files;
    struct sg_lazy_photos *lazy; /* or NULL */
    struct sg_view *views;
    atomic_int code;     /* the first error of a photo; the other threads then stop */
    atomic_bool crowded; /* there was no memory to decode another photo at the same time */
    pthread_mutex_t lock;
    bool *left_out;        /* of each photo: it cannot be decoded */
    bool *blank;           /* of each photo: it has no used pixel */
    size_t first;          /* of them */
    struct sg_failure why; /* of the first */
};

/* The reference's resolution rule, in double precision and with its roundings, then the
 * downscale. */
static int target_size(sg_ctx *ctx, const struct sg_scene_params *p, const char *path, int width,
                       int height, int *w, int *h)
{
    double tw, th;
    int r = p->resolution;
    if (r == 1 || r == 2 || r == 4 || r == 8) {
        tw = rint((double) width / r); /* half to even */
        th = rint((double) height / r);
    } else {
        double factor = r > 0 ? (double) width / r : width > 1600 ? width / 1600.0 : 1;
        tw = trunc(width / factor);
        th = trunc(height / factor);
    }
    if (p->downscale != 1) {
        tw = rint(tw / p->downscale);
        th = rint(th / p->downscale);
    }
    tw = tw < 1 ? 1 : tw;
    th = th < 1 ? 1 : th;
    if (tw > SG_SIDE_MAX || th > SG_SIDE_MAX || tw * th > (double) p->max_pixels)
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: resampled size: found %.0f x %.0f pixels, expected sides up to %d and "
                       "at most %llu pixels",
                       path, tw, th, SG_SIDE_MAX, (unsigned long long) p->max_pixels);
    *w = (int) tw;
    *h = (int) th;
    return SG_OK;
}

/* Whether one size is the other's, reduced: up to what rounding twice makes of the sides, first to
 * a reduced size and then to a part of it. */
static bool is_reduced(int width, int height, int of_width, int of_height)
{
    const double off = 1.5;
    const double low = fmax((width - off) / of_width, (height - off) / of_height);
    return low <= fmin((width + off) / of_width, (height + off) / of_height);
}

static bool has_same_shape(int width, int height, int other_width, int other_height)
{
    return is_reduced(width, height, other_width, other_height) ||
           is_reduced(other_width, other_height, width, height);
}

/* The lens for a photo of width x height: same field of view, whatever size the numbers were given
 * for. */
static int fit_lens(sg_ctx *ctx, const struct sg_shot *shot, int width, int height,
                    struct sg_lens *lens)
{
    *lens = shot->lens;
    if (lens->width && lens->height && !has_same_shape(width, height, lens->width, lens->height))
        return sg_fail(
            ctx, SG_ERR_INPUT,
            "%s: found %d x %d pixels, expected the shape of its camera, %d x %d pixels (%s)",
            shot->path, width, height, lens->width, lens->height, shot->camera);
    double sx = lens->width ? (double) width / lens->width : 1,
           sy = lens->height ? (double) height / lens->height : 1;
    if (!lens->width) /* one side says how much smaller the photo is */
        sx = sy;
    if (!lens->height)
        sy = sx;
    const double own = lens->width ? lens->width : width / sx,
                 own_y = lens->height ? lens->height : height / sy;
    if (!(lens->fx > 0))
        lens->fx = own / (2 * tan(lens->angle_x / 2));
    if (!(lens->fy > 0))
        lens->fy =
            lens->angle_y > 0 ? own_y / (2 * tan(lens->angle_y / 2)) : lens->fx; /* square pixels */
    lens->fx *= sx;
    lens->fy *= sy;
    lens->cx = lens->has_principal ? lens->cx * sx : width / 2.0;
    lens->cy = lens->has_principal ? lens->cy * sy : height / 2.0;
    lens->width = width;
    lens->height = height;
    if (!(lens->fx > SG_FOCAL_MIN) || !(lens->fy > SG_FOCAL_MIN) || !(lens->fx < 1e12) ||
        !(lens->fy < 1e12))
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: found focal lengths %g, %g pixels, expected usable ones", shot->path,
                       lens->fx, lens->fy);
    return SG_OK;
}

/* Opened once, in the scene's folder, and decoded from that. *broken: set if it cannot be decoded,
 * which is not where the system cannot read it. */
static int read_image(sg_ctx *ctx, const struct sg_scene_files *files, const char *path,
                      struct sg_image *out, bool *broken)
{
    struct sg_source in;
    int code = sg_folder_source(ctx, &files->dir, path, UINT64_MAX, &in);
    if (!code)
        code = sg_image_read_source(ctx, &in, files->params.max_pixels, out);
    *broken |= code == SG_ERR_INPUT && !in.failed;
    sg_source_close(&in);
    return code;
}

/* The mask of the view's shot at the photo's size, 0 or 255. */
static int load_mask(sg_ctx *ctx, const struct sg_scene_files *files, const struct sg_shot *shot,
                     struct sg_view *view, bool *broken)
{
    const int width = view->file_width, height = view->file_height;
    struct sg_image image = {0};
    size_t pixels = (size_t) width * (size_t) height;
    uint8_t *grey = NULL;
    int code = read_image(ctx, files, shot->mask, &image, broken);
    if (code)
        return code;
    size_t n = (size_t) image.width * (size_t) image.height, step = (size_t) image.channels;
    for (size_t i = 0; i < n && step > 1;
         i++) { /* in place, since reading is never behind writing */
        const uint8_t *p = image.pixels + i * step;
        image.pixels[i] = (uint8_t) ((p[0] + p[1] + p[2]) / 3);
    }
    for (size_t i = 0; i < n && shot->mask_any; i++)
        image.pixels[i] = image.pixels[i] ? 255 : 0;
    if (!has_same_shape(image.width, image.height, width, height)) {
        code =
            sg_fail(ctx, SG_ERR_INPUT,
                    "%s: found a mask of %d x %d pixels, expected the shape of its photo, %d x %d",
                    shot->mask, image.width, image.height, width, height);
        sg_image_clear(&image);
        return code;
    }
    grey = sg_alloc_raw(ctx, SG_MEM_IMAGES, pixels, 1);
    code = grey ? sg_resample(ctx, image.pixels, image.width, image.height, 1, grey, width, height)
                : SG_ERR_BUDGET;
    sg_image_clear(&image);
    for (size_t i = 0; i < pixels && !code; i++)
        grey[i] = grey[i] > 127 ? 255 : 0;
    view->mask = grey;
    return code;
}

/* Masks the columns that are not of the half. */
static int mask_half(sg_ctx *ctx, enum sg_half half, struct sg_view *view)
{
    const size_t width = (size_t) view->camera.width, height = (size_t) view->camera.height,
                 left = width / 2;
    if (half == SG_HALF_BOTH)
        return SG_OK;
    if (!view->mask) {
        view->mask = sg_alloc_raw(ctx, SG_MEM_IMAGES, width * height, 1);
        if (!view->mask)
            return SG_ERR_BUDGET;
        memset(view->mask, 255, width * height);
    }
    for (size_t y = 0; y < height; y++) {
        uint8_t *row = view->mask + y * width;
        if (half == SG_HALF_LEFT)
            memset(row + left, 0, width - left);
        else
            memset(row, 0, left);
    }
    return SG_OK;
}

/* Resamples *plane in place of itself if the size differs. */
static int resize(sg_ctx *ctx, uint8_t **plane, int width, int height, int channels, int w, int h)
{
    if (!*plane || (w == width && h == height))
        return SG_OK;
    uint8_t *small = sg_alloc_raw(ctx, SG_MEM_IMAGES, (size_t) w * (size_t) h, (size_t) channels);
    int code =
        small ? sg_resample(ctx, *plane, width, height, channels, small, w, h) : SG_ERR_BUDGET;
    sg_free(*plane);
    *plane = small;
    return code;
}

/* Takes the lens distortion out of the view's pixels and mask. *valid: which pixels the photo has,
 * NULL if all. */
static int undistort_view(sg_ctx *ctx, const struct sg_shot *shot, const struct sg_lens *lens,
                          struct sg_view *view, uint8_t **valid)
{
    size_t pixels = (size_t) lens->width * (size_t) lens->height, lost;
    uint8_t *pinhole = sg_alloc_raw(ctx, SG_MEM_IMAGES, pixels, 3);
    *valid = sg_alloc_raw(ctx, SG_MEM_IMAGES, pixels, 1);
    int code = SG_ERR_BUDGET;
    if (pinhole && *valid)
        code = sg_undistort(ctx, lens, lens->width, lens->height, view->rgb, pinhole, *valid,
                            view->mask, &lost);
    if (code) {
        sg_free(pinhole);
        return code;
    }
    sg_free(view->rgb);
    view->rgb = pinhole;
    if (pixels - lost < pixels / 100 || lost == pixels)
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: found distortion k1 = %g, k2 = %g, p1 = %g, p2 = %g ... that leaves "
                       "%zu of %zu pixels of the photo, expected that of a real lens (%s)",
                       shot->path, lens->k1, lens->k2, lens->p1, lens->p2, pixels - lost, pixels,
                       shot->camera);
    if (!lost) {
        sg_free(*valid);
        *valid = NULL;
    }
    return SG_OK;
}

/* Of a photo of the lens' size that becomes w x h pixels. */
static int set_camera(sg_ctx *ctx, const struct sg_scene_params *params, const struct sg_shot *shot,
                      const struct sg_lens *lens, int w, int h, struct sg_camera *c)
{
    const double sx = (double) w / lens->width, sy = (double) h / lens->height;
    *c = (struct sg_camera){.width = w, .height = h, .fx = lens->fx * sx, .fy = lens->fy * sy};
    c->cx = params->centred_principal ? w / 2.0 : lens->cx * sx;
    c->cy = params->centred_principal ? h / 2.0 : lens->cy * sy;
    memcpy(c->R, shot->R, sizeof(shot->R));
    memcpy(c->t, shot->t, sizeof(shot->t));
    return sg_camera_check(ctx, c, SG_ERR_INPUT, shot->path);
}

/* The lens and camera of a shot whose photo is width x height. */
static int place(sg_ctx *ctx, const struct sg_scene_params *params, const struct sg_shot *shot,
                 int width, int height, struct sg_lens *lens, struct sg_camera *camera)
{
    int w = 0, h = 0, code = target_size(ctx, params, shot->path, width, height, &w, &h);
    if (!code)
        code = fit_lens(ctx, shot, width, height, lens);
    return code ? code : set_camera(ctx, params, shot, lens, w, h, camera);
}

int sg_view_place(sg_ctx *ctx, const struct sg_scene_params *params, const struct sg_shot *shot,
                  struct sg_view *view)
{
    struct sg_lens lens;
    return place(ctx, params, shot, shot->lens.width, shot->lens.height, &lens, &view->camera);
}

static int smooth(sg_ctx *ctx, enum sg_smooth kind, struct sg_view *view)
{
    const int w = view->camera.width, h = view->camera.height;
    uint8_t *smoothed = sg_alloc_raw(ctx, SG_MEM_IMAGES, (size_t) w * (size_t) h, 3);
    const int code =
        smoothed ? sg_smooth(ctx, kind, view->rgb, view->mask, w, h, smoothed) : SG_ERR_BUDGET;
    sg_free(view->rgb);
    view->rgb = smoothed;
    return code;
}

/* The photo as RGB. What of the image need not change is taken over. */
static int take_pixels(sg_ctx *ctx, const struct sg_scene_params *params,
                       const struct sg_shot *shot, struct sg_image *image, struct sg_view *view)
{
    view->file_width = image->width;
    view->file_height = image->height;
    view->lossless = image->lossless;
    if (image->channels == 3) {
        view->rgb = image->pixels;
        image->pixels = NULL;
    } else {
        view->rgb =
            sg_alloc_raw(ctx, SG_MEM_IMAGES, (size_t) image->width * (size_t) image->height, 3);
        if (!view->rgb)
            return SG_ERR_BUDGET;
        sg_image_flatten(image,
                         shot->drop_alpha           ? SG_ALPHA_DROP
                         : params->white_background ? SG_ALPHA_ON_WHITE
                                                    : SG_ALPHA_ON_BLACK,
                         view->rgb);
    }
    return SG_OK;
}

/* Makes photo and mask the camera's. */
static int fit_to_camera(sg_ctx *ctx, const struct sg_shot *shot, const struct sg_lens *lens,
                         struct sg_view *view)
{
    const int width = view->file_width, height = view->file_height;
    const int w = view->camera.width, h = view->camera.height;
    uint8_t *valid = NULL; /* 255: pixels that the photo shows, once it is undistorted */
    int code = SG_OK;
    view->in_pixels = shot->lens.width || shot->lens.height || shot->lens.fx > 0 ||
                      shot->lens.fy > 0 || shot->lens.has_principal;
    view->undistorted = sg_lens_is_distorted(lens);
    if (view->undistorted)
        code = undistort_view(ctx, shot, lens, view, &valid);
    if (!code)
        code = resize(ctx, &view->rgb, width, height, 3, w, h);
    if (!code)
        code = resize(ctx, &view->mask, width, height, 1, w, h);
    if (!code)
        code = resize(ctx, &valid, width, height, 1, w, h);
    const size_t n = code ? 0 : (size_t) w * (size_t) h;
    for (size_t i = 0; i < n && view->mask; i++)
        view->mask[i] = view->mask[i] > 127 ? 255 : 0;
    /* A pixel that is partly outside the photo would be a wrong target. */
    for (size_t i = 0; i < n && valid; i++)
        valid[i] = valid[i] == 255 && (!view->mask || view->mask[i]) ? 255 : 0;
    if (code || !valid) {
        sg_free(valid);
    } else {
        sg_free(view->mask);
        view->mask = valid;
    }
    return code;
}

int sg_view_load(sg_ctx *ctx, const struct sg_scene_files *files, const struct sg_shot *shot,
                 struct sg_view *view, bool *broken)
{
    const struct sg_scene_params *params = &files->params;
    struct sg_image image = {0};
    struct sg_lens lens;
    view->name = sg_strdup(ctx, shot->name);
    view->file = sg_strdup(ctx, shot->file);
    view->path = sg_strdup(ctx, shot->path);
    if (!view->name || !view->file || !view->path)
        return SG_ERR_BUDGET;
    int code = read_image(ctx, files, shot->path, &image, broken);
    if (code)
        return code;
    code = take_pixels(ctx, params, shot, &image, view);
    sg_image_clear(&image);
    if (!code)
        code = place(ctx, params, shot, view->file_width, view->file_height, &lens, &view->camera);
    if (!code && shot->mask)
        code = load_mask(ctx, files, shot, view, broken);
    if (!code)
        code = fit_to_camera(ctx, shot, &lens, view);
    if (!code)
        code = mask_half(ctx, shot->half, view);
    if (!code && params->smooth && shot->split != SG_SPLIT_TEST)
        code = smooth(ctx, params->smooth, view);
    if (!code)
        view->hash = sg_view_hash(view);
    return code;
}

/* Remembers a photo that is left out. */
static void leave_out(struct job *job, size_t i, const struct sg_failure *why)
{
    pthread_mutex_lock(&job->lock);
    if (i < job->first)
        job->first = i, job->why = *why;
    pthread_mutex_unlock(&job->lock);
    job->left_out[i] = true;
}

/* After an error the view is empty, and where its photo is left out. */
static int load_view(struct job *job, size_t i)
{
    const struct sg_shot *shot = &job->files->shots.items[i];
    struct sg_view *view = &job->views[i];
    struct sg_meter meter;
    struct sg_failure failure = {.code = SG_OK};
    bool broken = false;
    sg_failures_apart(&failure);
    sg_meter_begin(&meter);
    int code = sg_view_load(job->ctx, job->files, shot, view, &broken);
    sg_meter_end(&meter);
    if (!code)
        job->blank[i] = !sg_views_used(view, 1);
    if (!code && job->lazy)
        code = sg_lazy_photo_keep(job->ctx, job->lazy, shot, (uint64_t) meter.peak, view);
    sg_failures_apart(NULL);
    if (code)
        sg_view_clear(view);
    const bool skip = broken && !job->files->params.strict;
    if (skip && !job->files->counted) {
        leave_out(job, i, &failure);
        return SG_OK;
    }
    return code ? sg_fail(job->ctx, code, "%s%s", failure.text,
                          skip ? "; with test views (eval) it is not skipped, since that would "
                                 "change which views they are"
                               : "")
                : SG_OK;
}

static void load_one(void *arg, size_t i, int thread)
{
    struct job *job = arg;
    (void) thread;
    if (atomic_load(&job->code))
        return;
    const int code = load_view(job, i);
    if (code == SG_ERR_BUDGET)
        atomic_store(&job->crowded, true);
    else if (code)
        atomic_store(&job->code, code);
}

/* Where memory was short with all threads at once, the rest is loaded one photo at a time. */
static int load_rest(struct job *job, size_t n)
{
    sg_ctx *ctx = job->ctx;
    for (size_t i = 0; i < n; i++) {
        sg_clear_error(ctx);
        int code = sg_progress(ctx, SG_STAGE_LOAD, i, n);
        if (!code && !job->views[i].name && !job->left_out[i])
            code = load_view(job, i);
        if (code == SG_ERR_BUDGET && sg_mem_limit(ctx)) {
            sg_clear_error(ctx);
            return sg_fail(ctx, code,
                           "%s: memory: found a limit of %llu bytes, expected at least %llu to "
                           "read this photo",
                           job->files->shots.items[i].path, (unsigned long long) sg_mem_limit(ctx),
                           (unsigned long long) sg_mem_wanted(ctx));
        }
        if (code)
            return code;
    }
    return SG_OK;
}

/* With --images, photos of another size than their camera's are expected; otherwise they may be a
 * mistake. */
static int check_scale(sg_ctx *ctx, const struct sg_scene_params *params,
                       const struct sg_shots *shots, const struct sg_view *views)
{
    size_t scaled = 0, first = 0, photos = 0;
    for (size_t i = 0; i < shots->count && !params->images; i++) {
        const struct sg_lens *lens = &shots->items[i].lens;
        if (shots->items[i].half == SG_HALF_LEFT || !views[i].name)
            continue; /* its right half counts; left out */
        photos++;
        if (((lens->width && lens->width != views[i].file_width) ||
             (lens->height && lens->height != views[i].file_height)) &&
            !scaled++)
            first = i;
    }
    if (!scaled)
        return SG_OK;
    const struct sg_shot *shot = &shots->items[first];
    if (params->strict)
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: found %d x %d pixels, expected the %d x %d of its camera (%s)",
                       shot->path, views[first].file_width, views[first].file_height,
                       shot->lens.width, shot->lens.height, shot->camera);
    sg_log(ctx, SG_LOG_WARN,
           "%zu of %zu photos have another size than their camera, whose focal lengths are scaled; "
           "the first is %s: %d x %d pixels, camera %d x %d (%s)",
           scaled, photos, shot->path, views[first].file_width, views[first].file_height,
           shot->lens.width, shot->lens.height, shot->camera);
    return SG_OK;
}

static int say_left_out(const struct job *job, size_t n)
{
    size_t left_out = 0, photos = 0;
    for (size_t i = 0; i < n; i++) {
        const bool counts = job->files->shots.items[i].half != SG_HALF_LEFT; /* its right half */
        photos += counts;
        left_out += counts && job->left_out[i];
    }
    if (photos && left_out == photos)
        return sg_fail(job->ctx, SG_ERR_INPUT, "%zu of %zu photos cannot be decoded; the first: %s",
                       left_out, photos, job->why.text);
    if (left_out)
        sg_log(job->ctx, SG_LOG_WARN,
               "%zu of %zu photos cannot be decoded and are skipped; the first: %s", left_out,
               photos, job->why.text);
    return SG_OK;
}

/* A mask that is the wrong way round, or of other values than its readers expect, looks like this.
 */
static void say_blank(const struct job *job, size_t n)
{
    size_t blank = 0, photos = 0, first = 0;
    for (size_t i = 0; i < n; i++) {
        const enum sg_half half = job->files->shots.items[i].half;
        if (half == SG_HALF_LEFT || job->left_out[i])
            continue; /* it is behind its right half */
        photos++;
        if (job->blank[i] && (half == SG_HALF_BOTH || job->blank[i + 1]) && !blank++)
            first = i;
    }
    const struct sg_shot *shot = &job->files->shots.items[first];
    if (blank)
        sg_log(job->ctx, SG_LOG_WARN,
               "%zu of %zu photos have no used pixel and no effect; the first is %s%s%s", blank,
               photos, shot->path, shot->mask ? ", with the mask " : "",
               shot->mask ? shot->mask : "");
}

int sg_views_load(sg_ctx *ctx, const struct sg_scene_params *params,
                  const struct sg_scene_files *files, struct sg_lazy_photos *lazy,
                  struct sg_view *views)
{
    const size_t n = files->shots.count;
    struct job job = {.ctx = ctx,
                      .files = files,
                      .lazy = lazy,
                      .views = views,
                      .lock = PTHREAD_MUTEX_INITIALIZER,
                      .first = SIZE_MAX,
                      .left_out = sg_alloc(ctx, SG_MEM_MISC, n, sizeof(*job.left_out)),
                      .blank = sg_alloc(ctx, SG_MEM_MISC, n, sizeof(*job.blank))};
    int code = job.left_out && job.blank ? sg_parallel_stage(ctx, SG_STAGE_LOAD, n, load_one, &job)
                                         : SG_ERR_BUDGET;
    if (!code)
        code = atomic_load(&job.crowded) ? load_rest(&job, n) : atomic_load(&job.code);
    if (!code)
        code = say_left_out(&job, n);
    if (!code)
        say_blank(&job, n);
    sg_free(job.left_out);
    sg_free(job.blank);
    if (!code && lazy)
        sg_lazy_photos_settle(ctx, lazy);
    return code ? code : check_scale(ctx, params, &files->shots, views);
}

void sg_view_clear(struct sg_view *view)
{
    sg_free(view->name);
    sg_free(view->file);
    sg_free(view->path);
    sg_free(view->rgb);
    sg_free(view->mask);
    sg_lazy_photo_destroy(view->lazy);
    *view = (struct sg_view){0};
}
