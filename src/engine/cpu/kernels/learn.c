/* SPDX-License-Identifier: Apache-2.0 */
/* Splat gradients to parameter gradients to Adam, LANES Gaussians at a time. In
 * project_backward_optimise parameters and moments are touched once, and parameter gradients live
 * in registers and L1 only. */
#include "kernels.h"

#include "filter.h"

#include "math/adam.h"
#include "math/projection.h"
#include "math/sh.h"

struct lanes {
    float sums[CPU_SLOT_ABSOLUTE][LANES], r[LANES], g[LANES], b[LANES], visible[LANES];
};

/* Adds up the slots of each Gaussian in tile order: the same order for any number of threads or
 * bands. False: none is visible. */
SIMD bool gather(const struct cpu_learn_args *a, size_t base, struct lanes *l)
{
    const size_t left = a->count - base, n = left < LANES ? left : LANES;
    bool any = false;
    for (size_t lane = 0; lane < n; lane++)
        any |= a->extents[base + lane].x1 > 0;
    if (!any)
        return false;
    memset(l, 0, sizeof(*l));
    for (size_t lane = 0; lane < n; lane++) {
        const size_t i = base + lane;
        const struct cpu_splat *s = &a->splats[i];
        if (!a->extents[i].x1)
            continue;
        l->r[lane] = s->r, l->g[lane] = s->g, l->b[lane] = s->b;
        l->visible[lane] = 1;
        const size_t first = a->slot_start ? a->slot_start[i] : i,
                     end = a->slot_start ? a->slot_start[i + 1] : i + 1;
        float sum[CPU_SLOT_USED] = {0};
        for (size_t k = first; k < end; k++)
            for (int j = 0; j < CPU_SLOT_USED; j++)
                sum[j] += a->slots[k * CPU_SLOT_FLOATS + (size_t) j];
        for (int j = 0; j < CPU_SLOT_USED; j++)
            l->sums[j][lane] = sum[j];
        for (int j = CPU_SLOT_USED; a->absolute && j < CPU_SLOT_ABSOLUTE; j++)
            for (size_t k = first; k < end; k++)
                l->sums[j][lane] += a->slots[k * CPU_SLOT_FLOATS + (size_t) j];
    }
    return true;
}

/* Gradients of the parameters, and the statistics of densification. */
SIMD void pull(const struct cpu_learn_args *a, const struct pinhole *view, size_t base,
               const float *params, const struct lanes *l, real *out)
{
    const int coefficients = (a->degree + 1) * (a->degree + 1);
    const mask visible = r_lt(r_set(0), r_load(l->visible));
    real sums[9], planes[SG_P_SH];
    for (int j = 0; j < 9; j++)
        sums[j] = r_load(l->sums[j]);
    for (int i = 0; i < SG_P_SH; i++)
        planes[i] = r_load(params + i * SG_LANES);
    struct splat s;
    struct projection pr;
    project(view, planes + SG_P_XYZ, planes + SG_P_SCALE, planes + SG_P_ROT, &s, &pr);
    const struct splat_grad g =
        splat_pull(&s, sums[0], sums[1], sums[2], sums[3], sums[4], sums[5]);
    if (a->update->statistics) {
#ifdef SG_MIP
        const bool absolute = a->absolute && !a->grad_absolute;
        float sum[LANES];
        r_store(sum, r_load(l->sums[9]) * view->half_w + r_load(l->sums[10]) * view->half_h);
        for (int lane = 0; lane < LANES && a->grad_absolute; lane++)
            if (l->visible[lane] > 0)
                a->grad_absolute[base + (size_t) lane] += sum[lane];
#else
        const bool absolute = a->absolute;
#endif
        const real gx = (absolute ? r_load(l->sums[9]) : g.x) * view->half_w,
                   gy = (absolute ? r_load(l->sums[10]) : g.y) * view->half_h;
        float norm[LANES];
        r_store(norm, r_sqrt(gx * gx + gy * gy));
        for (int lane = 0; lane < LANES; lane++)
            if (l->visible[lane] > 0) {
                const size_t i = base + (size_t) lane;
                a->grad_sum[i] += norm[lane];
                a->grad_count[i] += 1;
            }
    }
    if (!a->update->adam && !a->gradients && !a->accumulated)
        return;

    project_backward(view, &pr, &s, &g, out + SG_P_XYZ, out + SG_P_SCALE, out + SG_P_ROT);
    out[SG_P_OPACITY] = logit_pull(sums[0], planes[SG_P_OPACITY]);
    real dir[3], basis[16], weight[16], d[3], rgb[3];
    const real inv = sh_direction(planes, view->centre, dir);
    sh_basis(a->degree, dir[0], dir[1], dir[2], basis);
    rgb[0] = colour_pull(r_load(l->r), sums[6]);
    rgb[1] = colour_pull(r_load(l->g), sums[7]);
    rgb[2] = colour_pull(r_load(l->b), sums[8]);
    for (int k = 0; k < coefficients; k++) {
        weight[k] = r_set(0);
        for (int ch = 0; ch < 3; ch++) {
            weight[k] += rgb[ch] * r_load(params + (SG_P_SH + 3 * k + ch) * SG_LANES);
            out[SG_P_SH + 3 * k + ch] = basis[k] * rgb[ch];
        }
    }
    sh_direction_gradient(a->degree, dir[0], dir[1], dir[2], weight, d);
    sh_direction_pull(d, dir, inv, out + SG_P_XYZ);
    for (int plane = 0; plane < SG_P_SH + 3 * coefficients; plane++)
        out[plane] = r_keep(visible, out[plane]); /* culled lanes hold garbage */
}

SIMD void adam(const struct cpu_learn_args *a, float *p, float *m, float *v, const real *gradient,
               int planes)
{
    for (int c = 0; c < SG_COLUMNS && sg_column_is_parameter(c); c++) {
        const enum sg_group group = sg_columns[c].group;
        const float rate = a->update->rate[group], root = a->update->root[group];
        if (!(rate > 0))
            continue;
        for (int plane = sg_columns[c].first; plane < sg_column_end(c, planes); plane++) {
            const int at = plane * SG_LANES;
            const struct adam_state old = {r_load(p + at), r_load(m + at), r_load(v + at)},
                                    new = adam_step(old, gradient[plane], rate, root);
            r_store(p + at, new.p);
            r_store(m + at, new.m);
            r_store(v + at, new.v);
        }
    }
}

/* Planes of SH degrees not yet active have zero gradient and zero moments: nothing to do. */
SIMD int active_planes(const struct cpu_learn_args *a)
{
    return SG_P_SH + 3 * (a->degree + 1) * (a->degree + 1);
}

/* Adds `accumulated`, if there is one, to the gradients. Without a step the sum is stored there. */
SIMD void accumulate(const struct cpu_learn_args *a, size_t offset, int planes, real *out)
{
    for (int plane = 0; a->accumulated && plane < planes; plane++) {
        float *sum = a->accumulated + offset + plane * SG_LANES;
        out[plane] += r_load(sum);
        r_store(sum, a->update->adam ? r_set(0) : out[plane]);
    }
}

/* Adds the gradients of the weighted means of opacities and scales. base: the first of the lanes;
 * lanes past the end have none. */
SIMD void regularise(const struct cpu_learn_args *a, size_t base, const float *params, real *out)
{
    const struct sg_update *u = a->update;
    if (!(u->mean_opacity > 0 || u->mean_scale > 0))
        return;
    const float n = (float) a->count;
    const mask there = r_lt(r_lane(), r_set((float) (a->count - base)));
    const real o = 1 / (1 + r_exp(-r_load(params + SG_P_OPACITY * SG_LANES)));
    out[SG_P_OPACITY] += r_keep(there, u->mean_opacity / n * (o * (1 - o)));
    for (int p = SG_P_SCALE; p < SG_P_SCALE + 3; p++)
        out[p] += r_keep(there, u->mean_scale / (3 * n) * r_exp(r_load(params + p * SG_LANES)));
}

void FILTERED(project_backward_optimise)(const struct cpu_learn_args *a, size_t first, size_t end)
{
    const struct pinhole view = VIEW(a);
    const int planes = active_planes(a);
    for (size_t block = first; block < end; block++)
        for (int half = 0; half < SG_LANES; half += LANES) {
            const size_t base = block * SG_LANES + (size_t) half;
            if (base >= a->count)
                break;
            const size_t offset = block * (size_t) a->planes * SG_LANES + (size_t) half;
            struct lanes l;
            real out[SG_PARAMS_MAX];
            if (gather(a, base, &l))
                pull(a, &view, base, a->shaped + offset, &l, out);
            else
                for (int plane = 0; plane < planes; plane++)
                    out[plane] = r_set(0);
            accumulate(a, offset, planes, out);
            for (int plane = 0; a->gradients && plane < planes; plane++)
                r_store(a->gradients + offset + plane * SG_LANES, out[plane]);
            if (a->update->adam) {
                regularise(a, base, a->params + offset, out);
                adam(a, a->params + offset, a->m + offset, a->v + offset, out, planes);
            }
        }
}

#ifndef SG_MIP
void KERNEL(optimise)(const struct cpu_learn_args *a, size_t first, size_t end)
{
    const int planes = active_planes(a);
    for (size_t block = first; block < end; block++)
        for (int half = 0; half < SG_LANES; half += LANES) {
            const size_t base = block * SG_LANES + (size_t) half;
            if (base >= a->count)
                break;
            const size_t offset = block * (size_t) a->planes * SG_LANES + (size_t) half;
            real out[SG_PARAMS_MAX];
            for (int plane = 0; plane < planes; plane++)
                out[plane] = r_load(a->gradients + offset + plane * SG_LANES);
            accumulate(a, offset, planes, out);
            if (a->update->adam) {
                regularise(a, base, a->params + offset, out);
                adam(a, a->params + offset, a->m + offset, a->v + offset, out, planes);
            }
        }
}
#endif
