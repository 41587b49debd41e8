/* SPDX-License-Identifier: Apache-2.0 */
/* Gaussians to splats. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "math/sh.h"
#include "math/tile_rect.h"
#include "splat.glsl"
#include "view.glsl"

layout(local_size_x = VK_GROUP) in;
layout(constant_id = 1) const int DEGREE = 3;
ARGUMENTS(project);

shared uint visible_here;

/* NaN and infinities, by their bits: comparisons of NaN are not promised. */
bool finite(float v)
{
    return (floatBitsToUint(v) & 0x7f800000) != 0x7f800000;
}

void main()
{
    const uint i = thread_index();
    if (gl_LocalInvocationID.x == 0)
        visible_here = 0;
    barrier(); /* before anybody adds to it */
    if (i < a.count) {
        float xyz[3], scales[3], rot[4], dir[3], basis[16], rgb[3];
        for (uint k = 0; k < 3; k++) {
            xyz[k] = a.params.v[param_at(a.planes, i, k)];
            scales[k] = a.params.v[param_at(a.planes, i, P_SCALE + k)];
        }
        for (uint k = 0; k < 4; k++)
            rot[k] = a.params.v[param_at(a.planes, i, P_ROT + k)];
        const float logit = a.params.v[param_at(a.planes, i, P_OPACITY)];
        const pinhole v = view_load(a.view);
        splat s;
        projection p;
        project(v, xyz, scales, rot, s, p);
        bool good = s.visible && finite(s.x) && finite(s.y) && finite(s.z) && finite(s.det) &&
                    finite(s.sigma) && finite(s.gain) && finite(s.A) && finite(s.B) &&
                    finite(s.C) && (floatBitsToUint(logit) & 0x7fffffff) <= 0x7f800000;
        const tile_rect t = tile_rect_make(s.x, s.y, s.sigma, int(a.grid_x), int(a.grid_y));
        good = good && t.x0 < t.x1 && t.y0 < t.y1;
        const float opacity = opacity_drawn(logit, s.gain);
        for (int k = 0; k < 3; k++)
            rgb[k] = 0.5;
        if (with_part(VK_WITHOUT_COLOURS)) {
            sh_direction(xyz, v.centre, dir);
            sh_basis(DEGREE, dir[0], dir[1], dir[2], basis);
            for (int k = 0; k < (DEGREE + 1) * (DEGREE + 1); k++)
                for (int ch = 0; ch < 3; ch++)
                    rgb[ch] += basis[k] * a.params.v[param_at(a.planes, i, P_SH + 3 * k + ch)];
        }
        for (int ch = 0; ch < 3; ch++) {
            good = good && finite(rgb[ch]) && colour_sound(rgb[ch]);
            rgb[ch] = colour_drawn(rgb[ch]);
        }
        const bool drawn = good && opacity >= SG_ALPHA_MIN;
        if (good)
            atomicAdd(visible_here, 1);
        a.flags.v[i] = drawn ? 1 : 0;
        a.keys.v[i] = drawn ? floatBitsToUint(s.z) - floatBitsToUint(SG_Z_MIN) : 0;
        a.rects.v[2 * i] = drawn ? t.x0 | t.y0 << 16 : good ? 1 : 0;
        a.rects.v[2 * i + 1] = drawn ? t.x1 | t.y1 << 16 : good ? 1 : 0;
        const bool kept = with_part_of(VK_WITHOUT_SPLATS, rgb[0] + rgb[1] + rgb[2] + s.x);
        if (drawn && kept) {
            const float var = 1.0 / s.A;
            const ellipse e =
                ellipse_make(ellipse_border(opacity, s.a, s.c, s.det), s.b / s.c, var, s.c);
            const float across = conic_across(s.A);
            const uint to = i * SPLAT;
            a.splats.v[to + S_X] = s.x;
            a.splats.v[to + S_Y] = s.y;
            a.splats.v[to + S_SLOPE] = e.slope;
            a.splats.v[to + S_REACH] = e.reach;
            a.splats.v[to + S_TAPER] = e.taper;
            a.splats.v[to + S_YMAX] = e.ymax;
            a.splats.v[to + S_YRIGHT] = e.yright;
            a.splats.v[to + 7] = 0.0;
            a.splats.v[to + S_ACROSS] = across;
            a.splats.v[to + S_SHEAR] = across * e.slope;
            a.splats.v[to + S_DOWN] = conic_down(s.c);
            a.splats.v[to + S_PEAK] = log2(opacity);
            a.splats.v[to + S_Z] = s.z;
        }
        if (good && kept) { /* colours of faint ones too: the backward pass reads them */
            a.splats.v[i * SPLAT + S_R] = rgb[0];
            a.splats.v[i * SPLAT + S_G] = rgb[1];
            a.splats.v[i * SPLAT + S_B] = rgb[2];
        }
    }
    barrier(); /* all have added */
    if (gl_LocalInvocationID.x == 0 && visible_here > 0)
        atomicAdd(a.results.v[VK_RESULT_VISIBLE], visible_here);
}
