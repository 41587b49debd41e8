/* SPDX-License-Identifier: Apache-2.0 */
/* Photos on the device, and what a render is compared with. */
#include <string.h>

#include "engine.h"

/* Red, green, blue, and whether the pixel counts. */
static void pack(const struct sg_photo_entry *p, uint32_t *words)
{
    const size_t pixels = (size_t) p->width * (size_t) p->height;
    for (size_t i = 0; i < pixels; i++)
        words[i] = p->rgb[3 * i] | (uint32_t) p->rgb[3 * i + 1] << 8 |
                   (uint32_t) p->rgb[3 * i + 2] << 16 | (p->mask && !p->mask[i] ? 0 : 0xff000000u);
}

int sg_vulkan_photo_add(struct sg_engine *base, sg_photo photo, const struct sg_photo_entry *p)
{
    struct vulkan_engine *e = vulkan_of(base);
    const size_t pixels = (size_t) p->width * (size_t) p->height, before = e->cap_photos;
    if (sg_grow(base->ctx, SG_MEM_MISC, &e->photos, &e->cap_photos, photo, before,
                sizeof(*e->photos)))
        return SG_ERR_BUDGET;
    memset(e->photos + before, 0, (e->cap_photos - before) * sizeof(*e->photos));
    e->passed = e->passed == photo ? 0 : e->passed;
    uint32_t *words = sg_alloc_raw(base->ctx, SG_MEM_IMAGES, pixels, sizeof(*words));
    if (!words)
        return SG_ERR_BUDGET;
    pack(p, words);
    int code = sg_gpu_reserve(e->gpu, SG_MEM_IMAGES, &e->photos[photo - 1], 4 * (uint64_t) pixels);
    if (!code)
        code = sg_gpu_write(e->gpu, &e->photos[photo - 1], 0, words, 4 * (uint64_t) pixels);
    sg_free(words);
    if (code)
        sg_vulkan_photo_drop(base, photo);
    return code;
}

void sg_vulkan_photo_drop(struct sg_engine *base, sg_photo photo)
{
    struct vulkan_engine *e = vulkan_of(base);
    if (photo <= e->cap_photos)
        sg_gpu_release(e->gpu, &e->photos[photo - 1]);
}

int sg_vulkan_photo_pass(struct sg_engine *base, sg_photo photo, const struct sg_photo_entry *p)
{
    struct vulkan_engine *e = vulkan_of(base);
    struct gpu *g = e->gpu;
    const uint64_t bytes = 4 * (uint64_t) p->width * (uint64_t) p->height;
    e->passed = 0;
    e->turn = (e->turn + 1) % GPU_FLIGHTS;
    struct vulkan_passing *room = &e->passing[e->turn];
    /* A step that may be run again needs what is there. There are as many rooms as submissions, so
     * that the oldest one is done with its room once a step's view is drawn. */
    int code = SG_OK;
    if (g->stopped || room->used > g->finished || room->photo.bytes < bytes ||
        room->seen.bytes < bytes)
        code = sg_flow_finish(base);
    if (!code && room->seen.bytes < bytes) {
        sg_gpu_release(g, &room->seen);
        code = sg_gpu_window(g, &room->seen, bytes);
    }
    if (code || (code = sg_gpu_reserve(g, SG_MEM_IMAGES, &room->photo, bytes)))
        return code;
    pack(p, room->seen.mapped);
    if ((code = sg_gpu_copy(g, &room->seen, 0, &room->photo, 0, bytes)))
        return code;
    room->used = gpu_next(g);
    e->passed = photo;
    return SG_OK;
}

VkDeviceAddress sg_vulkan_photo_at(const struct vulkan_engine *e, sg_photo photo)
{
    if (photo & VK_PASSING)
        return e->passing[photo - VK_PASSING].photo.address;
    return photo ? sg_gpu_at(e->gpu, &e->photos[photo - 1]) : e->image.address;
}

int sg_vulkan_add_up_to(struct vulkan_engine *e, uint64_t groups, uint32_t width,
                        VkDeviceAddress to)
{
    return GPU_RUN(e->gpu, loss_sums, 0, width, .from = e->sums.address, .to = to,
                   .count = (uint32_t) groups, .width = width);
}

int sg_vulkan_add_up(struct vulkan_engine *e, uint64_t groups, uint32_t width, uint32_t result)
{
    return sg_vulkan_add_up_to(e, groups, width, e->lists.results.address + 4 * (uint64_t) result);
}

/* Whether the target is in e->given, and not a photo. */
static bool is_given(const struct sg_target_pixels *t)
{
    return t->planes || t->ascended;
}

/* L1 and SSIM of an image and their gradient, on the device. */
static int compare(struct vulkan_engine *e, const struct gpu_buffer *image,
                   const struct sg_target_pixels *t, const struct sg_photometric *p)
{
    struct gpu *g = e->gpu;
    const uint64_t pixels = (uint64_t) e->width * e->height, values = 3 * pixels;
    const uint64_t groups = 3 * gpu_groups(e->width, 16) * gpu_groups(e->height, 16);
    const float unit = 1 / (3 * (float) e->width * (float) e->height);
    const bool given = is_given(t);
    int code;
    if (pixels > VK_MOST_INDEX / VK_MAPS)
        return sg_fail(e->base.ctx, SG_ERR_BUDGET,
                       "vulkan: found an image of %llu pixels, at most %d are supported",
                       (unsigned long long) pixels, VK_MOST_INDEX / VK_MAPS);
    if ((code = sg_gpu_reserve(g, SG_MEM_FRAME, &e->target, 4 * values)) ||
        (code = sg_gpu_reserve(g, SG_MEM_FRAME, &e->maps, VK_MAPS_BYTES * pixels)) ||
        (code = sg_gpu_reserve(g, SG_MEM_FRAME, &e->sums, 3 * 4 * groups)) ||
        (t->planes && (code = sg_gpu_reserve(g, SG_MEM_FRAME, &e->given, 4 * values))) ||
        (t->planes && (code = sg_gpu_write(g, &e->given, 0, t->planes, 4 * values))))
        return code;
    const VkDeviceAddress photo = sg_vulkan_photo_at(e, t->photo);
    code = GPU_RUN(g, target, 0, FOR_EACH(pixels), .photo = photo,
                   .given = given ? e->given.address : image->address, .image = image->address,
                   .target = e->target.address, .pixels = (uint32_t) pixels, .planes = given,
                   .masked = t->mask != NULL, .tolerance = p->tolerance);
    if (!code)
        code = GPU_RUN(g, ssim, 0, groups, .image = image->address, .target = e->target.address,
                       .maps = e->maps.address, .sums = e->sums.address, .width = e->width,
                       .height = e->height);
    if (!code)
        code = sg_vulkan_add_up(e, groups, 3, VK_RESULT_LOSSES);
    e->terms.lambda_dssim = p->lambda_dssim;
    e->terms.ran[SG_LOSS_PHOTOMETRIC] = !code;
    return code ? code
                : GPU_RUN(g, ssim_gradient, 0, groups, .image = image->address,
                          .target = e->target.address, .maps = e->maps.address, .photo = photo,
                          .gradient = e->gradient.address, .width = e->width, .height = e->height,
                          .masked = t->mask != NULL, .tolerant = p->tolerance > 0,
                          .l1 = (1 - p->lambda_dssim) * unit, .dssim = -p->lambda_dssim * unit);
}

/* Adds the low-pass term of an image. Its target is at hand from `compare`. */
static int low_pass(struct vulkan_engine *e, const struct gpu_buffer *image,
                    const struct sg_target_pixels *t, const struct sg_photometric *p)
{
    struct gpu *g = e->gpu;
    const uint64_t values = 3 * (uint64_t) e->width * e->height;
    const uint64_t groups = 3 * gpu_groups(e->width, 16) * gpu_groups(e->height, 16);
    const VkDeviceAddress photo = sg_vulkan_photo_at(e, t->photo);
    const bool given = is_given(t);
    /* The maps of SSIM are not needed any more. */
    int code =
        GPU_RUN(g, low_pass, 0, groups, .image = image->address, .photo = photo,
                .given = given ? e->given.address : image->address, .passed = e->maps.address,
                .sums = e->sums.address, .width = e->width, .height = e->height, .planes = given,
                .masked = t->mask != NULL, .tolerance = p->tolerance);
    if (!code)
        code = sg_vulkan_add_up(e, groups, 1, VK_RESULT_LOSSES + 4);
    e->terms.low_pass = p->low_pass;
    return code ? code
                : GPU_RUN(g, low_pass_gradient, 0, groups, .image = image->address, .photo = photo,
                          .given = given ? e->given.address : image->address,
                          .passed = e->maps.address, .gradient = e->gradient.address,
                          .width = e->width, .height = e->height, .planes = given,
                          .masked = t->mask != NULL, .tolerance = p->tolerance,
                          .scale = 2 * p->low_pass / (float) values);
}

/* ---- exposures ---- */

int sg_vulkan_set_exposures(struct sg_engine *base, const float *values, size_t n)
{
    struct vulkan_engine *e = vulkan_of(base);
    const uint64_t bytes = 4 * SG_EXPOSURE_FLOATS * (uint64_t) n;
    sg_gpu_release(e->gpu, &e->exposures);
    if (!n)
        return SG_OK;
    const int code = sg_gpu_reserve(e->gpu, SG_MEM_OPTIMISER, &e->exposures, bytes);
    return code ? code : sg_gpu_write(e->gpu, &e->exposures, 0, values, bytes);
}

int sg_vulkan_read_exposures(struct sg_engine *base, float *values)
{
    struct vulkan_engine *e = vulkan_of(base);
    return sg_gpu_read(e->gpu, &e->exposures, 0, values,
                       4 * SG_EXPOSURE_FLOATS * (uint64_t) base->exposure_count);
}

int sg_vulkan_learn_exposures(struct vulkan_engine *e, size_t number,
                              const struct sg_exposure_update *u)
{
    const uint64_t count = e->base.exposure_count;
    return GPU_RUN(e->gpu, learn_exposures, 0, FOR_EACH(count * SG_EXPOSURE),
                   .exposures = e->exposures.address,
                   .gradient = e->lists.results.address + 4 * VK_RESULT_EXPOSURE,
                   .stop = e->gpu->stop.address, .count = (uint32_t) count,
                   .number = (uint32_t) number, .rate = (float) u->rate, .root = (float) u->root);
}

/* Where the target's exposure is: on the device, or the host's, which is copied there. */
static int find_exposure(struct vulkan_engine *e, const struct sg_target_pixels *t,
                         VkDeviceAddress *out)
{
    const uint64_t bytes = 4 * SG_EXPOSURE;
    int code = SG_OK;
    if (t->exposure && !(code = sg_gpu_reserve(e->gpu, SG_MEM_MISC, &e->given_exposure, bytes)))
        code = sg_gpu_update(e->gpu, &e->given_exposure, 0, t->exposure, bytes);
    *out = t->exposure ? e->given_exposure.address
                       : e->exposures.address + bytes * (t->device_exposure - 1);
    return code;
}

static int photometric(struct vulkan_engine *e, const struct sg_target_pixels *t,
                       const struct sg_photometric *p)
{
    struct gpu *g = e->gpu;
    const uint64_t pixels = (uint64_t) e->width * e->height, groups = FOR_EACH(pixels);
    const bool exposed = t->exposure || t->device_exposure;
    const struct gpu_buffer *shown = exposed ? &e->exposed : &e->image;
    VkDeviceAddress exposure = 0;
    int code = exposed ? find_exposure(e, t, &exposure) : SG_OK;
    e->terms.low_pass = 0;
    e->terms.exposed = false;
    if (exposed && !code && !(code = sg_gpu_reserve(g, SG_MEM_FRAME, &e->exposed, 12 * pixels)))
        code =
            GPU_RUN(g, expose, 0, groups, .image = e->image.address, .exposed = e->exposed.address,
                    .exposure = exposure, .pixels = (uint32_t) pixels);
    if (!code)
        code = compare(e, shown, t, p);
    if (p->low_pass > 0 && !code)
        code = low_pass(e, shown, t, p);
    if (!exposed || code ||
        (code = sg_gpu_reserve(g, SG_MEM_FRAME, &e->sums, 4 * SG_EXPOSURE * groups)))
        return code;
    code = GPU_RUN(g, expose_backward, 0, groups, .image = e->image.address,
                   .gradient = e->gradient.address, .sums = e->sums.address, .exposure = exposure,
                   .pixels = (uint32_t) pixels);
    e->terms.exposed = true;
    return code ? code : sg_vulkan_add_up(e, groups, SG_EXPOSURE, VK_RESULT_EXPOSURE);
}

static int total_variation(struct vulkan_engine *e, const struct sg_target_pixels *t,
                           const struct sg_loss *l)
{
    struct gpu *g = e->gpu;
    const uint64_t groups = gpu_groups(3 * (uint64_t) e->width * e->height, VK_GROUP);
    const double down = 3.0 * (e->height - 1) * e->width, across = 3.0 * e->height * (e->width - 1);
    int code = sg_gpu_reserve(g, SG_MEM_FRAME, &e->sums, 4 * groups);
    if (!code)
        code = GPU_RUN(g, total_variation, 0, groups, .image = e->image.address,
                       .photo = sg_vulkan_photo_at(e, t->photo), .gradient = e->gradient.address,
                       .sums = e->sums.address, .width = e->width, .height = e->height,
                       .masked = t->mask != NULL, .norm = (uint32_t) l->total_variation,
                       .across = across > 0 ? (float) (1 / across) : 0,
                       .down = down > 0 ? (float) (1 / down) : 0, .weight = (float) l->weight,
                       .edge = SG_TV_EDGE);
    e->terms.ran[SG_LOSS_TOTAL_VARIATION] = !code;
    return code ? code : sg_vulkan_add_up(e, groups, 1, VK_RESULT_LOSSES + 3);
}

int sg_vulkan_loss(struct sg_engine *base, const struct sg_target_pixels *target,
                   const struct sg_loss *l)
{
    struct vulkan_engine *e = vulkan_of(base);
    if (target->photo & VK_PASSING)
        e->passing[target->photo - VK_PASSING].used = gpu_next(e->gpu);
    switch (l->kind) {
    case SG_LOSS_PHOTOMETRIC:
        return photometric(e, target, &l->photometric);
    case SG_LOSS_TOTAL_VARIATION:
        return total_variation(e, target, l);
    default:
        return sg_vulkan_anisotropy(e, target, l);
    }
}

void sg_vulkan_read_losses(const struct vulkan_terms *t, const uint32_t results[VK_RESULTS],
                           struct sg_step *step)
{
    float sums[5], exposure[SG_EXPOSURE];
    memcpy(sums, results + VK_RESULT_LOSSES, sizeof(sums));
    memcpy(exposure, results + VK_RESULT_EXPOSURE, sizeof(exposure));
    const double values = 3.0 * t->width * t->height;
    if (t->ran[SG_LOSS_PHOTOMETRIC]) {
        step->photometric =
            sg_photometric_value_of((double) sums[0] / values, (double) sums[1] / values,
                                    (double) sums[2] / values, t->lambda_dssim);
        if (t->low_pass > 0)
            step->photometric.total += (double) t->low_pass * (double) sums[4] / values;
        step->loss[SG_LOSS_PHOTOMETRIC] = step->photometric.total;
    }
    if (t->ascended) {
        float variation;
        memcpy(&variation, results + VK_RESULT_VARIATION, sizeof(variation));
        step->variation = (double) variation / values;
    }
    for (int k = 0; k < SG_EXPOSURE && t->exposed; k++)
        step->exposure[k] = (double) exposure[k];
    if (t->ran[SG_LOSS_ANISOTROPY])
        step->loss[SG_LOSS_ANISOTROPY] = sg_vulkan_anisotropy_of(t, results);
    if (t->ran[SG_LOSS_TOTAL_VARIATION])
        step->loss[SG_LOSS_TOTAL_VARIATION] = (double) sums[3];
}
