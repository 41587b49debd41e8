/* SPDX-License-Identifier: Apache-2.0 */
/* The oracle: rendering and its gradient as plainly as the equations of Kerbl et al. 2023 allow.
 * Include real_f32.h or real_f64.h first. No tricks: one pixel at a time, lists sorted by qsort,
 * gradients back to front as in the paper. */
#ifndef SG_REF_RENDER_H
#define SG_REF_RENDER_H

#include <stdint.h>
#include <stdlib.h>

#include "math/projection.h"
#include "math/sh.h"
#include "math/tile_rect.h"
#include "splatguard/model.h"
#include "splatguard/render.h"

struct ref_splat {
    struct splat s;
    struct projection p;
    real o;   /* as it is drawn: with the view's compensation */
    real own; /* without */
    real rgb[3], dir[3], dist;
    bool clamped[3];
    bool visible;
    struct tile_rect rect;
    /* gradients of the loss */
    struct splat_grad g;
    real g_o, g_rgb[3];
    real absolute[2]; /* sums over pixels of |dL/dx|, |dL/dy| */
    double hits;      /* of this view */
};

struct ref_entry {
    float depth;
    uint32_t id;
};

struct ref_image {
    int width, height;
    real *rgb;   /* 3 planes */
    real *t;     /* final transmittance */
    real *depth; /* alpha-weighted sum */
    int *last;   /* 1-based position of the last blended entry in the tile's list */
};

static int ref_entry_compare(const void *a, const void *b)
{
    const struct ref_entry *x = a, *y = b;
    if (x->depth != y->depth)
        return x->depth < y->depth ? -1 : 1;
    return x->id < y->id ? -1 : 1;
}

/* params: one Gaussian's planes. degree: SH degree to use. */
static inline void ref_project(const struct pinhole *v, const real *params, int degree, int grid_x,
                               int grid_y, struct ref_splat *o)
{
    *o = (struct ref_splat){0};
    project(v, params + SG_P_XYZ, params + SG_P_SCALE, params + SG_P_ROT, &o->s, &o->p);
    o->own = 1 / (1 + r_exp(-params[SG_P_OPACITY]));
    o->o = o->own * o->s.gain;
    real d[3], basis[16];
    for (int i = 0; i < 3; i++)
        d[i] = params[i] - v->centre[i];
    o->dist = r_sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
    for (int i = 0; i < 3; i++)
        o->dir[i] = d[i] / o->dist;
    sh_basis(degree, o->dir[0], o->dir[1], o->dir[2], basis);
    bool finite = o->o == o->o;
    for (int ch = 0; ch < 3; ch++) {
        real c = (real) 0.5;
        for (int k = 0; k < (degree + 1) * (degree + 1); k++)
            c += basis[k] * params[SG_P_SH + 3 * k + ch];
        finite = finite && c < (real) SG_COLOUR_MAX && c > (real) -SG_COLOUR_MAX;
        o->clamped[ch] = c < 0;
        o->rgb[ch] = o->clamped[ch] ? 0 : c;
    }
    o->rect = tile_rect_make((float) o->s.x, (float) o->s.y, (float) o->s.sigma, grid_x, grid_y);
    o->visible = o->s.visible && finite && o->rect.radius > 0 && o->rect.x0 < o->rect.x1 &&
                 o->rect.y0 < o->rect.y1;
}

/* Entries of one tile in drawing order; list holds up to n. */
static inline size_t ref_tile_list(const struct ref_splat *splats, size_t n, int tx, int ty,
                                   struct ref_entry *list)
{
    size_t m = 0;
    for (size_t i = 0; i < n; i++) {
        const struct ref_splat *s = &splats[i];
        if (s->visible && tx >= s->rect.x0 && tx < s->rect.x1 && ty >= s->rect.y0 &&
            ty < s->rect.y1)
            list[m++] = (struct ref_entry){(float) s->s.z, (uint32_t) i};
    }
    if (m) /* of no Gaussians there is no list */
        qsort(list, m, sizeof(*list), ref_entry_compare);
    return m;
}

/* Alpha of a pair; false: the pair is skipped. */
static inline bool ref_pair(const struct ref_splat *s, int ix, int iy, real *dx, real *dy,
                            real *gauss, real *alpha)
{
    *dx = s->s.x - (real) ix, *dy = s->s.y - (real) iy;
    const real power = (real) -0.5 * (s->s.A * *dx * *dx + s->s.C * *dy * *dy) - s->s.B * *dx * *dy;
    if (power > 0)
        return false;
    *gauss = r_exp(power);
    *alpha = r_min((real) SG_ALPHA_MAX, s->o * *gauss);
    return !(*alpha < (real) SG_ALPHA_MIN);
}

static inline void ref_pixel_forward(const struct ref_splat *splats, const struct ref_entry *list,
                                     size_t m, int ix, int iy, const float *background,
                                     struct ref_image *image)
{
    real t = 1, out[3] = {0}, depth = 0;
    int last = 0;
    for (size_t k = 0; k < m; k++) {
        const struct ref_splat *s = &splats[list[k].id];
        real dx, dy, gauss, alpha;
        if (!ref_pair(s, ix, iy, &dx, &dy, &gauss, &alpha))
            continue;
        const real next = t * (1 - alpha);
        if (next < (real) SG_T_MIN)
            break;
        for (int ch = 0; ch < 3; ch++)
            out[ch] += s->rgb[ch] * alpha * t;
        depth += s->s.z * alpha * t;
        t = next;
        last = (int) k + 1;
    }
    const size_t plane = (size_t) image->width * (size_t) image->height;
    const size_t at = (size_t) iy * (size_t) image->width + (size_t) ix;
    for (int ch = 0; ch < 3; ch++)
        image->rgb[(size_t) ch * plane + at] = out[ch] + t * (real) background[ch];
    image->t[at] = t;
    image->depth[at] = depth;
    image->last[at] = last;
}

/* Adds what the kind of hit counts to each splat that is blended. */
static inline void ref_pixel_count(struct ref_splat *splats, const struct ref_entry *list, size_t m,
                                   int ix, int iy, enum sg_hit hit)
{
    real t = 1;
    for (size_t k = 0; k < m; k++) {
        real dx, dy, gauss, alpha;
        if (!ref_pair(&splats[list[k].id], ix, iy, &dx, &dy, &gauss, &alpha))
            continue;
        const real next = t * (1 - alpha);
        if (next < (real) SG_T_MIN)
            break;
        splats[list[k].id].hits += hit == SG_HIT_WEIGHT          ? (double) (alpha * t)
                                   : hit == SG_HIT_TRANSMITTANCE ? (double) t
                                                                 : 1;
        t = next;
    }
}

/* gradient: dL/dimage, 3 planes. Adds to the splats' gradients. */
static inline void ref_pixel_backward(struct ref_splat *splats, const struct ref_entry *list,
                                      int ix, int iy, const float *background,
                                      const struct ref_image *image, const real *gradient)
{
    const size_t plane = (size_t) image->width * (size_t) image->height;
    const size_t at = (size_t) iy * (size_t) image->width + (size_t) ix;
    const real g[3] = {gradient[at], gradient[plane + at], gradient[2 * plane + at]};
    const real t_final = image->t[at];
    real t = t_final, acc[3] = {0}, alpha_prev = 0, colour_prev[3] = {0};
    for (int k = image->last[at] - 1; k >= 0; k--) {
        struct ref_splat *s = &splats[list[k].id];
        real dx, dy, gauss, alpha;
        if (!ref_pair(s, ix, iy, &dx, &dy, &gauss, &alpha))
            continue;
        t = t / (1 - alpha);
        real dalpha = 0, bg = 0;
        for (int ch = 0; ch < 3; ch++) {
            acc[ch] = alpha_prev * colour_prev[ch] + (1 - alpha_prev) * acc[ch];
            s->g_rgb[ch] += alpha * t * g[ch];
            dalpha += (s->rgb[ch] - acc[ch]) * g[ch];
            bg += (real) background[ch] * g[ch];
            colour_prev[ch] = s->rgb[ch];
        }
        dalpha = t * dalpha - t_final / (1 - alpha) * bg;
        alpha_prev = alpha;
        const real dgauss =
            s->o * dalpha; /* the 0.99 clamp passes the gradient, as in the reference */
        s->g_o += gauss * dalpha;
        const real hx = gauss * dx, hy = gauss * dy;
        const real gx = dgauss * (-hx * s->s.A - hy * s->s.B);
        const real gy = dgauss * (-hy * s->s.C - hx * s->s.B);
        s->g.x += gx;
        s->g.y += gy;
        s->absolute[0] += gx < 0 ? -gx : gx;
        s->absolute[1] += gy < 0 ? -gy : gy;
        s->g.A += (real) -0.5 * hx * dx * dgauss;
        s->g.Bh += (real) -0.5 * hx * dy * dgauss;
        s->g.C += (real) -0.5 * hy * dy * dgauss;
    }
}

/* Splat gradients to the gradients of one Gaussian's planes (assigned; all sg_param_count(3) of
 * them). */
static inline void ref_parameter_gradient(const struct pinhole *v, const struct ref_splat *s,
                                          const real *params, int degree, real *out)
{
    for (int p = 0; p < SG_PARAMS_MAX; p++)
        out[p] = 0;
    if (!s->visible)
        return;
    struct splat_grad splat = s->g;
    splat.opacity = s->g_o * s->o;
    project_backward(v, &s->p, &s->s, &splat, out + SG_P_XYZ, out + SG_P_SCALE, out + SG_P_ROT);
    out[SG_P_OPACITY] = s->g_o * s->o * (1 - s->own);
    real basis[16], weight[16], d[3];
    sh_basis(degree, s->dir[0], s->dir[1], s->dir[2], basis);
    for (int k = 0; k < (degree + 1) * (degree + 1); k++) {
        weight[k] = 0;
        for (int ch = 0; ch < 3; ch++) {
            const real g = s->clamped[ch] ? 0 : s->g_rgb[ch];
            out[SG_P_SH + 3 * k + ch] = basis[k] * g;
            weight[k] += params[SG_P_SH + 3 * k + ch] * g;
        }
    }
    sh_direction_gradient(degree, s->dir[0], s->dir[1], s->dir[2], weight, d);
    const real dot = d[0] * s->dir[0] + d[1] * s->dir[1] + d[2] * s->dir[2];
    for (int i = 0; i < 3; i++)
        out[SG_P_XYZ + i] += (d[i] - s->dir[i] * dot) / s->dist;
}

#endif
