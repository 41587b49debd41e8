/* SPDX-License-Identifier: Apache-2.0 */
/* The anisotropy loss on the device: rows of the image to half spectra, columns, energies by
 * direction, a factor each, columns and rows back. Only the columns with coefficients in the band
 * are kept. Plans are made on the host, with the tables of the CPU's transforms. */
#include <string.h>

#include "engine.h"
#include "math/spectrum.h"
#include "spectral/anisotropy.h"
#include "spectral/fft.h"
#include "spectral/frequency.h"

/* A buffer with these words. */
static int put(struct vulkan_engine *e, struct gpu_buffer *b, const void *words, uint64_t bytes)
{
    const int code = sg_gpu_reserve(e->gpu, SG_MEM_FRAME, b, bytes);
    return code ? code : sg_gpu_write(e->gpu, b, 0, words, bytes);
}

/* The plan of lines of n points; their points while they are transformed raise `longest`. */
static int put_plan(struct vulkan_engine *e, int n, struct gpu_buffer *to, uint32_t *longest)
{
    sg_ctx *ctx = e->base.ctx;
    struct sg_fft *fft;
    int code = sg_fft_create(ctx, n, &fft);
    if (code)
        return code;
    const struct sg_fft *of = fft->longer ? fft->longer : fft;
    const size_t header = VK_FFT_HEADER + 4 * (size_t) of->stages;
    const size_t floats = of->floats, chirp = fft->longer ? fft->floats : 0,
                 all = header + floats + chirp;
    uint32_t *words = sg_alloc_raw(ctx, SG_MEM_FRAME, all, sizeof(*words));
    if (!words) {
        sg_fft_destroy(&fft);
        return SG_ERR_BUDGET;
    }
    words[VK_FFT_POINTS] = (uint32_t) of->n, words[VK_FFT_STAGES] = (uint32_t) of->stages;
    words[VK_FFT_CHIRP] = chirp ? (uint32_t) (header + floats) : 0;
    words[VK_FFT_FILTER] =
        chirp ? (uint32_t) (header + floats + (size_t) (fft->filter - fft->tables)) : 0;
    for (int i = 0; i < of->stages; i++) {
        const struct sg_fft_stage *s = &of->stage[i];
        const uint32_t values[4] = {(uint32_t) s->radix, (uint32_t) s->rest,
                                    (uint32_t) (header + (size_t) (s->twiddles - of->tables)),
                                    (uint32_t) (header + (size_t) (s->roots - of->tables))};
        memcpy(words + VK_FFT_HEADER + 4 * i, values, sizeof(values));
    }
    memcpy(words + header, of->tables, floats * sizeof(float));
    if (chirp)
        memcpy(words + header + floats, fft->tables, chirp * sizeof(float));
    *longest = (uint32_t) of->n > *longest ? (uint32_t) of->n : *longest;
    code = put(e, to, words, all * sizeof(*words));
    sg_free(words);
    sg_fft_destroy(&fft);
    return code;
}

/* A byte for each coefficient of the stored columns. */
static int put_directions(struct vulkan_engine *e, struct vulkan_transform *t,
                          const struct sg_spectrum_params *band)
{
    const size_t step = ((size_t) t->h + 3) / 4 * 4, bytes = step * t->columns;
    uint8_t *bins = sg_alloc(e->base.ctx, SG_MEM_FRAME, bytes, 1);
    if (!bins)
        return SG_ERR_BUDGET;
    for (uint32_t v = 0; v < t->columns; v++)
        for (uint32_t u = 0; u < t->h; u++)
            bins[v * step + u] = (uint8_t) sg_spectrum_bin((int) u, (int) v, (int) t->w, (int) t->h,
                                                           band, SG_OUTSIDE);
    const int code = put(e, &t->directions, bins, bytes);
    sg_free(bins);
    return code;
}

static void clear_transform(struct gpu *g, struct vulkan_transform *t)
{
    sg_gpu_release(g, &t->across);
    sg_gpu_release(g, &t->down);
    sg_gpu_release(g, &t->directions);
    *t = (struct vulkan_transform){0};
}

void sg_vulkan_spectrum_clear(struct vulkan_engine *e)
{
    struct vulkan_spectrum *s = &e->spectrum;
    for (int i = 0; i < SG_PLANS; i++)
        clear_transform(e->gpu, &s->sizes[i]);
    sg_gpu_release(e->gpu, &s->coefficients);
    sg_gpu_release(e->gpu, &s->factors);
    sg_gpu_release(e->gpu, &s->room);
    sg_gpu_release(e->gpu, &s->energies);
}

/* The transform of images of a size; a new one replaces the one whose last use is the longest ago.
 * params: the same in all calls. */
static int find_transform(struct vulkan_engine *e, const struct sg_anisotropy_params *params,
                          int width, int height, struct vulkan_transform **out)
{
    struct vulkan_spectrum *s = &e->spectrum;
    struct vulkan_transform *oldest = s->sizes;
    for (struct vulkan_transform *t = s->sizes; t < s->sizes + SG_PLANS; t++) {
        if (t->width == width && t->height == height) {
            t->used = ++s->clock;
            *out = t;
            return SG_OK;
        }
        if (t->used < oldest->used)
            oldest = t;
    }
    int code = oldest->across.buffer ? sg_gpu_flush(e->gpu) : SG_OK;
    if (code)
        return code;
    clear_transform(e->gpu, oldest);
    const int w = sg_anisotropy_width(width, params->exact_size),
              h = sg_anisotropy_height(height, params->exact_size);
    oldest->w = (uint32_t) w, oldest->h = (uint32_t) h;
    oldest->columns = (uint32_t) sg_spectrum_columns(w, h, &params->band);
    code = put_plan(e, w, &oldest->across, &oldest->longest);
    if (!code)
        code = put_plan(e, h, &oldest->down, &oldest->longest);
    if (!code)
        code = put_directions(e, oldest, &params->band);
    if (code) {
        clear_transform(e->gpu, oldest);
        return code;
    }
    oldest->width = width, oldest->height = height, oldest->used = ++s->clock;
    *out = oldest;
    return SG_OK;
}

/* Bytes of the room of lines that do not fit into shared memory. */
static uint64_t room_bytes(uint64_t longest)
{
    return longest > VK_LINE ? VK_LINE_GROUPS * longest * 2 * 2 * sizeof(float) : 0;
}

/* An image whose loss is taken. */
struct transformed {
    VkDeviceAddress image, gradient; /* the latter is added to */
    VkDeviceAddress photo;           /* whose mask counts, if masked */
    VkDeviceAddress energy;          /* of the directions: what comes out */
    uint32_t width, height;
    bool masked;
    float weight;
};

/* coefficients: of the spectrum; or NULL. */
static int run(struct vulkan_engine *e, const struct sg_anisotropy_params *p,
               const struct transformed *o, double *coefficients)
{
    struct gpu *g = e->gpu;
    struct vulkan_spectrum *s = &e->spectrum;
    const uint32_t planes = p->channels == SG_CHANNELS_LUMA ? 1 : 3, bins = (uint32_t) p->band.bins,
                   pairs = planes * ((o->height + 1) / 2);
    const bool power = p->energy == SG_ENERGY_POWER;
    struct vulkan_transform *t;
    int code = find_transform(e, p, (int) o->width, (int) o->height, &t);
    if (code)
        return code;
    const uint64_t lines = (uint64_t) planes * t->columns;
    const int is_far = t->longest > VK_LINE;
    const uint32_t groups = is_far ? VK_LINE_GROUPS : (uint32_t) (pairs > lines ? pairs : lines);
    const double all = (double) planes * t->w * t->h;
    if (coefficients)
        *coefficients = all;
    if ((code = sg_gpu_reserve(g, SG_MEM_FRAME, &s->coefficients, 8 * lines * t->h)) ||
        (code = sg_gpu_reserve(g, SG_MEM_FRAME, &e->sums, 4 * lines * bins)) ||
        (code = sg_gpu_reserve(g, SG_MEM_FRAME, &s->factors, 4 * VK_GROUP)) ||
        (code = sg_gpu_reserve(g, SG_MEM_FRAME, &s->room, room_bytes(t->longest))))
        return code;
    code = GPU_RUN(g, spectrum_rows, is_far, groups, .image = o->image,
                   .spectrum = s->coefficients.address, .plan = t->across.address,
                   .tables = t->across.address, .room = s->room.address, .width = o->width,
                   .height = o->height, .points = t->w, .rows = t->h, .columns = t->columns,
                   .planes = planes, .groups = groups, .longest = t->longest);
    if (!code)
        code = GPU_RUN(g, spectrum_columns, is_far, groups, .spectrum = s->coefficients.address,
                       .directions = t->directions.address, .energy = e->sums.address,
                       .plan = t->down.address, .tables = t->down.address, .room = s->room.address,
                       .height = o->height, .points = t->h, .columns = t->columns, .planes = planes,
                       .bins = bins, .amplitude = !power, .groups = groups, .longest = t->longest);
    if (!code)
        code = sg_vulkan_add_up_to(e, lines, bins, o->energy);
    if (!code)
        code =
            GPU_RUN(g, spectrum_factors, 0, 1, .energy = o->energy, .factors = s->factors.address,
                    .bins = bins,
                    .least = (float) (power ? SG_FLAT_POWER * all * all : SG_FLAT_AMPLITUDE * all),
                    .weight = o->weight * (power ? 2 : 1));
    if (!code)
        code =
            GPU_RUN(g, spectrum_columns_back, is_far, groups, .spectrum = s->coefficients.address,
                    .directions = t->directions.address, .factors = s->factors.address,
                    .plan = t->down.address, .tables = t->down.address, .room = s->room.address,
                    .height = o->height, .points = t->h, .columns = t->columns, .planes = planes,
                    .amplitude = !power, .groups = groups, .longest = t->longest);
    if (!code)
        code = GPU_RUN(g, spectrum_rows_back, is_far, groups, .gradient = o->gradient,
                       .photo = o->photo, .spectrum = s->coefficients.address,
                       .plan = t->across.address, .tables = t->across.address,
                       .room = s->room.address, .width = o->width, .height = o->height,
                       .points = t->w, .rows = t->h, .columns = t->columns, .planes = planes,
                       .masked = o->masked, .groups = groups, .longest = t->longest);
    return code;
}

int sg_vulkan_anisotropy(struct vulkan_engine *e, const struct sg_target_pixels *target,
                         const struct sg_loss *loss)
{
    const struct transformed o = {
        .image = e->image.address,
        .gradient = e->gradient.address,
        .photo = sg_vulkan_photo_at(e, target->photo),
        .energy = e->lists.results.address + 4 * VK_RESULT_ENERGY,
        .width = e->width,
        .height = e->height,
        .masked = target->mask != NULL,
        .weight = (float) loss->weight,
    };
    const int code = run(e, &loss->anisotropy, &o, &e->terms.coefficients);
    e->terms.anisotropy = loss->anisotropy;
    e->terms.ran[SG_LOSS_ANISOTROPY] = !code;
    return code;
}

int sg_vulkan_spectral_gradient(struct vulkan_engine *e, const struct sg_anisotropy_params *p,
                                VkDeviceAddress image, uint32_t width, uint32_t height,
                                VkDeviceAddress *magnitude)
{
    struct gpu *g = e->gpu;
    struct gpu_buffer *energies = &e->spectrum.energies;
    const uint64_t values = 3 * (uint64_t) width * height;
    int code = sg_gpu_reserve(g, SG_MEM_FRAME, energies, 4 * (SG_SPECTRUM_BINS_MAX + 1));
    if (!code)
        code = sg_gpu_fill(g, &e->given, 0, 4 * values, 0);
    if (code)
        return code;
    *magnitude = energies->address + 4 * SG_SPECTRUM_BINS_MAX;
    const struct transformed o = {.image = image,
                                  .gradient = e->given.address,
                                  .photo = image, /* as large, and not read */
                                  .energy = energies->address,
                                  .width = width,
                                  .height = height,
                                  .weight = 1};
    if (!(code = run(e, p, &o, NULL)))
        code = sg_gpu_reserve(g, SG_MEM_FRAME, &e->sums, 4 * FOR_EACH(values));
    if (!code)
        code = GPU_RUN(g, magnitudes, 0, FOR_EACH(values), .from = e->given.address,
                       .sums = e->sums.address, .count = (uint32_t) values);
    return code ? code : sg_vulkan_add_up_to(e, FOR_EACH(values), 1, *magnitude);
}

double sg_vulkan_anisotropy_of(const struct vulkan_terms *t, const uint32_t results[VK_RESULTS])
{
    float found[SG_SPECTRUM_BINS_MAX];
    double energy[SG_SPECTRUM_BINS_MAX];
    _Static_assert(VK_RESULT_ENERGY + SG_SPECTRUM_BINS_MAX <= VK_RESULTS, "a float each");
    memcpy(found, results + VK_RESULT_ENERGY, sizeof(found));
    for (int b = 0; b < t->anisotropy.band.bins; b++)
        energy[b] = (double) found[b];
    return sg_anisotropy_of_bins(&t->anisotropy, t->coefficients, energy, NULL);
}

/* Half spectra of three planes, energies of their columns, directions of the newest sizes, plans,
 * and the room of long lines. A side with a large prime factor is transformed with more than twice
 * its points. */
uint64_t sg_vulkan_spectrum_bytes(uint64_t width, uint64_t height)
{
    const uint64_t w = width + width / 8 + 16, h = height + height / 8 + 16, columns = w / 2 + 1,
                   side = w > h ? w : h;
    return 3 * columns * (8 * h + 4 * SG_SPECTRUM_BINS_MAX) +
           SG_PLANS * (columns * (h + 4) + 32 * (w + h)) + room_bytes(5 * side / 2) + (64u << 10);
}
