/* SPDX-License-Identifier: Apache-2.0 */
/* Gaussians to splats, LANES at a time. */
#include "kernels.h"

#include <math.h>

#include "math/projection.h"
#include "math/sh.h"
#include "math/tiles.h"

#define LOG2E 1.4426950408889634f

/* Activated values and colour of the Gaussians at p (first lane of the first plane). */
void KERNEL(project)(const struct cpu_project_args *a, size_t first, size_t end)
{
    const struct view v = view_make(a->camera);
    const int coefficients = (a->degree + 1) * (a->degree + 1);
    for (size_t block = first; block < end; block++)
        for (int half = 0; half < SG_LANES; half += LANES) {
            const float *p = a->params + block * (size_t) a->planes * SG_LANES + half;
            const size_t base = block * SG_LANES + (size_t) half;
            if (base >= a->count)
                break;
            real planes[SG_P_SH];
            for (int i = 0; i < SG_P_SH; i++)
                planes[i] = r_load(p + i * SG_LANES);
            struct splat s;
            struct projection pr;
            project(&v, planes + SG_P_XYZ, planes + SG_P_SCALE, planes + SG_P_ROT, &s, &pr);
            const real opacity = 1 / (1 + r_exp(-planes[SG_P_OPACITY]));

            real d[3], basis[16], rgb[3];
            for (int i = 0; i < 3; i++)
                d[i] = planes[i] - v.centre[i];
            const real inv = 1 / r_sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
            sh_basis(a->degree, d[0] * inv, d[1] * inv, d[2] * inv, basis);
            for (int ch = 0; ch < 3; ch++)
                rgb[ch] = r_set(0.5f);
            for (int k = 0; k < coefficients; k++)
                for (int ch = 0; ch < 3; ch++)
                    rgb[ch] += basis[k] * r_load(p + (SG_P_SH + 3 * k + ch) * SG_LANES);
            /* NaN fails every comparison. */
            mask good = r_and(s.visible, r_le(opacity, r_set(1)));
            for (int ch = 0; ch < 3; ch++) {
                good = r_and(good, r_and(r_lt(rgb[ch], r_set(SG_COLOUR_MAX)), r_lt(r_set(-SG_COLOUR_MAX), rgb[ch])));
                rgb[ch] = r_max(rgb[ch], r_set(0));
            }
            const mask drawn = r_and(good, r_le(r_set(SG_ALPHA_MIN), opacity));
            const real safe = r_sel(drawn, opacity, r_set(1));
            const real k = ellipse_border(safe, s.a, s.c, s.det);

            float out[16][LANES];
            r_store(out[0], s.x);
            r_store(out[1], s.y);
            r_store(out[2], s.A * (-0.5f * LOG2E));
            r_store(out[3], s.B * -LOG2E);
            r_store(out[4], s.C * (-0.5f * LOG2E));
            r_store(out[5], r_keep(drawn, opacity));
            for (int ch = 0; ch < 3; ch++)
                r_store(out[6 + ch], rgb[ch]);
            r_store(out[9], s.z);
            r_store(out[10], k);
            const real ic = 1 / s.c;
            r_store(out[11], s.b * ic);
            r_store(out[12], 1 / s.A);
            r_store(out[13], ic);
            r_store(out[14], r_keep(good, s.sigma));
            for (int lane = 0; lane < LANES && base + (size_t) lane < a->count; lane++) {
                float *to = (float *) &a->splats[base + (size_t) lane];
                for (int i = 0; i < 15; i++)
                    to[i] = out[i][lane];
                to[15] = to[5] > 0 ? log2f(to[5]) : 0;
            }
        }
}
