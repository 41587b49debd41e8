/* SPDX-License-Identifier: Apache-2.0 */
/* Steps of an image up its total variation. The buffers of the losses hold what they need: the
 * photo and two images where the maps of SSIM are, the bounds and the gradient of the anisotropy
 * where the targets are. */
#include <math.h>

#include "engine.h"
#include "spectral/anisotropy.h"

_Static_assert(VK_TV_VERTICAL2 == (int) SG_ATTACK_TV_VERTICAL2 &&
                   VK_TV_ANISO == (int) SG_ATTACK_TV_ANISO && VK_TV_ISO == (int) SG_ATTACK_TV_ISO,
               "as shaders/args.h says");

struct steps {
    uint32_t width, height;
    float epsilon, size;
    enum sg_attack_tv form;
    bool bounded;
    const struct sg_anisotropy_params *spectral; /* or NULL */
    float spectral_weight;
};

static int reserve(struct vulkan_engine *e, const struct steps *s)
{
    const uint64_t pixels = (uint64_t) s->width * s->height, bytes = 12 * pixels;
    int code = sg_gpu_reserve(e->gpu, SG_MEM_FRAME, &e->maps, 3 * bytes);
    if (s->bounded && !code)
        code = sg_gpu_reserve(e->gpu, SG_MEM_FRAME, &e->target, 4 * pixels);
    return code ? code : sg_gpu_reserve(e->gpu, SG_MEM_FRAME, &e->given, bytes);
}

/* From image `from`, 1 or 2, to the other one. */
static int step_up(struct vulkan_engine *e, const struct steps *s, uint32_t from)
{
    struct gpu *g = e->gpu;
    const uint64_t values = 3 * (uint64_t) s->width * s->height;
    const VkDeviceAddress at = e->maps.address + 4 * values * from,
                          to = e->maps.address + 4 * values * (3 - from);
    VkDeviceAddress magnitude = g->none.address;
    const int code = s->spectral ? sg_vulkan_spectral_gradient(e, s->spectral, at, s->width,
                                                               s->height, &magnitude)
                                 : SG_OK;
    return code ? code
                : GPU_RUN(g, ascend, 0, FOR_EACH(values), .photo = e->maps.address, .from = at,
                          .bound = sg_gpu_at(g, &e->target), .extra = sg_gpu_at(g, &e->given),
                          .magnitude = magnitude, .to = to, .width = s->width, .height = s->height,
                          .form = (uint32_t) s->form, .bounded = s->bounded,
                          .more = s->spectral != NULL,
                          .epsilon = fminf(s->epsilon, 1e30f), /* no infinities in kernels */
                          .size = s->size, .weight = s->spectral_weight * (float) values);
}

int sg_vulkan_ascend(struct sg_engine *base, const struct sg_ascend *a)
{
    struct vulkan_engine *e = vulkan_of(base);
    struct gpu *g = e->gpu;
    const uint64_t pixels = (uint64_t) a->width * (uint64_t) a->height, bytes = 12 * pixels;
    const struct steps s = {.width = (uint32_t) a->width,
                            .height = (uint32_t) a->height,
                            .epsilon = a->epsilon,
                            .size = a->step,
                            .form = a->form,
                            .bounded = a->bound != NULL,
                            .spectral = a->spectral ? sg_anisotropy_params_of(a->spectral) : NULL,
                            .spectral_weight = a->spectral_weight};
    int code = reserve(e, &s);
    if (code)
        return code;
    e->ascended = a->continues ? 3 - e->ascended : 2;
    if (!a->continues &&
        ((code = sg_gpu_write(g, &e->maps, 0, a->photo, bytes)) ||
         (code = sg_gpu_write(g, &e->maps, bytes, a->from, bytes)) ||
         (a->bound && (code = sg_gpu_write(g, &e->target, 0, a->bound, 4 * pixels)))))
        return code;
    if ((code = step_up(e, &s, 3 - e->ascended)))
        return code;
    return a->continued ? sg_gpu_submit(g)
                        : sg_gpu_read(g, &e->maps, e->ascended * bytes, a->to, bytes);
}

int sg_vulkan_ascend_view(struct vulkan_engine *e, const struct sg_view_ascent *a)
{
    static const struct sg_anisotropy_params spectral = {SG_ANISOTROPY_DEFAULTS};
    struct gpu *g = e->gpu;
    const uint64_t pixels = (uint64_t) e->width * e->height, values = 3 * pixels;
    const struct steps s = {.width = e->width,
                            .height = e->height,
                            .epsilon = a->epsilon,
                            .size = a->step,
                            .form = a->form,
                            .spectral = a->spectral_weight > 0 ? &spectral : NULL,
                            .spectral_weight = a->spectral_weight};
    int code = reserve(e, &s);
    uint32_t at = 1;
    if (!code)
        code = GPU_RUN(g, ascent_begin, 0, FOR_EACH(pixels),
                       .photo = sg_vulkan_photo_at(e, a->photo), .image = e->image.address,
                       .values = e->maps.address, .to = e->maps.address + 4 * values,
                       .pixels = (uint32_t) pixels, .clamped = isfinite(a->epsilon) != 0);
    for (int k = 0; k < a->steps && !code; k++, at = 3 - at)
        code = step_up(e, &s, at);
    if (!code) /* where losses find given planes */
        code = sg_gpu_copy(g, &e->maps, 4 * values * at, &e->given, 0, 4 * values);
    if (!code)
        code = sg_gpu_reserve(g, SG_MEM_FRAME, &e->sums, 4 * FOR_EACH(values));
    if (!code)
        code = GPU_RUN(g, variation, 0, FOR_EACH(values), .image = e->given.address,
                       .sums = e->sums.address, .width = e->width, .height = e->height,
                       .form = (uint32_t) a->form);
    e->terms.ascended = !code;
    return code ? code : sg_vulkan_add_up(e, FOR_EACH(values), 1, VK_RESULT_VARIATION);
}
