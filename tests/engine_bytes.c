/* SPDX-License-Identifier: Apache-2.0 */
/* Linked into the tests of engines: the linker sends every call that brings results of an engine to
 * the host through here, and at the end the program prints a hash of all of them. bench/gpu
 * compares it from run to run, so that every test is one of equal bytes. Calls of several threads
 * come in any order: their hashes are added. */
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>

#include "engine/ops.h"

/* Each declares the function that stands in, and the one that it stands in for, both of the type
 * that the header gives. */
#define WRAPPED(name, ...)                                                                         \
    extern __typeof__(name) __real_##name, __wrap_##name;                                          \
    int __wrap_##name(__VA_ARGS__)

static _Atomic uint64_t sum, calls;

static void print_sum(void)
{
    printf("bytes %016llx of %llu results\n", (unsigned long long) sum, (unsigned long long) calls);
}

/* FNV-1a over words. */
static uint64_t mix(uint64_t hash, const void *from, size_t bytes)
{
    for (const uint8_t *p = from; bytes-- > 0; p++)
        hash = (hash ^ *p) * 0x100000001b3u;
    return hash;
}

static uint64_t begin(const char *what)
{
    return mix(0xcbf29ce484222325u, what, 4);
}

static void end(uint64_t hash)
{
    if (!atomic_fetch_add(&calls, 1))
        atexit(print_sum);
    atomic_fetch_add(&sum, hash);
}

/* Without the places behind the last row of a block. */
static uint64_t mix_rows(uint64_t hash, const float *from, size_t count, int planes)
{
    for (size_t i = 0; i < count; i++)
        for (int p = 0; p < planes; p++)
            hash = mix(hash, &from[sg_param_index(planes, i, p)], sizeof(*from));
    return hash;
}

static uint64_t mix_model(uint64_t hash, const struct sg_model *m, const struct sg_columns *columns)
{
    if (m)
        hash = mix_rows(hash, m->params, m->count, sg_param_count(m->sh_degree));
    for (int c = 0; m && columns && c < SG_COLUMNS; c++)
        if (columns->at[c] && !sg_column_is_parameter(c))
            hash =
                mix_rows(hash, columns->at[c], m->count, sg_column_array_planes(c, m->sh_degree));
    if (columns && columns->networks)
        hash = mix(hash, &columns->networks->value, sizeof(columns->networks->value));
    return hash;
}

static uint64_t mix_floats(uint64_t hash, const float *from, size_t n)
{
    return from ? mix(hash, from, n * sizeof(*from)) : hash;
}

WRAPPED(sg_engine_download, struct sg_engine *e, struct sg_model *m, struct sg_columns *columns)
{
    const int code = __real_sg_engine_download(e, m, columns);
    if (!code)
        end(mix_model(begin("mode"), m, columns));
    return code;
}

WRAPPED(sg_engine_read_gradients, struct sg_engine *e, struct sg_model *out)
{
    const int code = __real_sg_engine_read_gradients(e, out);
    if (!code)
        end(mix_model(begin("grad"), out, NULL));
    return code;
}

WRAPPED(sg_engine_read_image, struct sg_engine *e, float *rgb, float *alpha, float *depth)
{
    const int code = __real_sg_engine_read_image(e, rgb, alpha, depth);
    const size_t n = (size_t) e->width * (size_t) e->height;
    if (!code)
        end(mix_floats(mix_floats(mix_floats(begin("imag"), rgb, 3 * n), alpha, n), depth, n));
    return code;
}

WRAPPED(sg_engine_read_statistics, struct sg_engine *e, const struct sg_statistics *out)
{
    const int code = __real_sg_engine_read_statistics(e, out);
    const size_t n = sg_engine_count(e);
    const float *const all[] = {out->gradient,     out->opacity, out->largest,
                                out->log_smallest, out->radius,  out->absolute};
    uint64_t hash = begin("stat");
    for (size_t k = 0; k < sizeof(all) / sizeof(all[0]) && !code; k++)
        hash = mix_floats(hash, all[k], n);
    if (!code)
        end(hash);
    return code;
}

WRAPPED(sg_engine_count_hits, struct sg_engine *e, const struct sg_camera *const *views, size_t n,
        const struct sg_render_params *params, enum sg_hit kind, double *hits)
{
    const int code = __real_sg_engine_count_hits(e, views, n, params, kind, hits);
    if (!code)
        end(mix(begin("hits"), hits, sg_engine_count(e) * sizeof(*hits)));
    return code;
}

WRAPPED(sg_engine_weigh_hits, struct sg_engine *e, const struct sg_camera *const *views, size_t n,
        const struct sg_render_params *params, const struct sg_weighing *how, double *hits)
{
    const int code = __real_sg_engine_weigh_hits(e, views, n, params, how, hits);
    if (!code)
        end(mix(begin("weig"), hits, sg_engine_count(e) * sizeof(*hits)));
    return code;
}

WRAPPED(sg_engine_ascend, struct sg_engine *e, const struct sg_ascend *a)
{
    const int code = __real_sg_engine_ascend(e, a);
    if (!code && !a->continued)
        end(mix_floats(begin("asce"), a->to, 3 * (size_t) a->width * (size_t) a->height));
    return code;
}

WRAPPED(sg_engine_read_exposures, struct sg_engine *e)
{
    const int code = __real_sg_engine_read_exposures(e);
    if (!code && e->exposures)
        end(mix_floats(begin("expo"), e->exposures, SG_EXPOSURE_FLOATS * e->exposure_count));
    return code;
}

WRAPPED(sg_engine_read_step, struct sg_engine *e, struct sg_step *out)
{
    const int code = __real_sg_engine_read_step(e, out);
    if (code)
        return code;
    const struct sg_render_stats s = out->stats;
    const uint64_t counts[] = {s.visible, s.instances, s.pairs, s.max_tile, s.bands};
    const struct sg_photometric_value v = out->photometric;
    const double values[] = {v.l1, v.ssim, v.mse, v.total, out->variation};
    uint64_t hash = mix(mix(begin("step"), counts, sizeof(counts)), values, sizeof(values));
    hash = mix(hash, out->loss, sizeof(out->loss));
    end(mix(hash, out->exposure, sizeof(out->exposure)));
    return code;
}
