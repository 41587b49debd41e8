/* SPDX-License-Identifier: Apache-2.0 */
/* Solid textures on lattice value noise (Peachey 1985, Perlin 1985): a colour for every point of
 * space, hence no seams. Colours are linear. */
#include "materials.h"

#include <stdbool.h>
#include <stddef.h>

#include "core/rng.h"
#include "image/stroke_font.h"

static double lattice(int64_t x, int64_t y, int64_t z)
{
    const uint64_t h = sg_rng_mix((uint64_t) x * 0x8da6b343u ^ (uint64_t) y * 0xd8163841u ^
                                  (uint64_t) z * 0xcb1ab31fu);
    return (double) (h >> 11) * 0x1p-53;
}

static double lerp(double a, double b, double t)
{
    return a + (b - a) * t;
}

/* In [0, 1]. */
static double noise(struct vec p)
{
    const double x = floor(p.x), y = floor(p.y), z = floor(p.z);
    const int64_t i = (int64_t) x, j = (int64_t) y, k = (int64_t) z;
    const double u = smooth_step(0, 1, p.x - x), v = smooth_step(0, 1, p.y - y),
                 w = smooth_step(0, 1, p.z - z);
    const double low = lerp(lerp(lattice(i, j, k), lattice(i + 1, j, k), u),
                            lerp(lattice(i, j + 1, k), lattice(i + 1, j + 1, k), u), v);
    const double high = lerp(lerp(lattice(i, j, k + 1), lattice(i + 1, j, k + 1), u),
                             lerp(lattice(i, j + 1, k + 1), lattice(i + 1, j + 1, k + 1), u), v);
    return lerp(low, high, w);
}

static double turbulence(struct vec p, int octaves)
{
    double sum = 0, weight = 0.5;
    for (int i = 0; i < octaves; i++, weight *= 0.5) {
        sum += weight * noise(p);
        p = add(scale(p, 2.03), vec(17.1, 5.7, 9.3));
    }
    return sum;
}

static struct vec marble(struct vec p, struct vec stone, struct vec vein)
{
    const double warp = turbulence(scale(p, 4), 4);
    const double wave = fabs(sin(6 * (p.x + 0.6 * p.y + 0.8 * p.z) + 9 * warp));
    const struct vec c = mix(vein, stone, smooth_step(0, 0.55, wave));
    return scale(c, 0.9 + 0.2 * turbulence(scale(p, 19), 2));
}

/* Growth rings around the x axis, drawn out along it. */
static struct vec wood(struct vec p, struct vec early, struct vec late)
{
    const struct vec q = vec(p.x * 0.35, p.y, p.z);
    const double radius = hypot(q.y + 0.37, q.z + 0.21) + 0.10 * turbulence(scale(q, 5), 3);
    const double ring = radius * 26 - floor(radius * 26);
    const double grain = noise(vec(p.x * 9, p.y * 130, p.z * 130));
    return scale(mix(early, late, smooth_step(0.2, 0.9, ring) * (1 - smooth_step(0.93, 1, ring))),
                 0.86 + 0.24 * grain);
}

static const struct vec oak = {0.50, 0.28, 0.115}, oak_late = {0.27, 0.125, 0.042};
static const struct vec walnut = {0.16, 0.070, 0.030}, walnut_late = {0.060, 0.024, 0.011};
static const struct vec ink = {0.012, 0.013, 0.018};

static struct surface matte(struct vec albedo)
{
    return (struct surface){albedo, {0, 0, 0}, 1, 0};
}

static struct surface glossy(struct vec albedo, double reflectance, double shininess, double mirror)
{
    return (struct surface){albedo, {reflectance, reflectance, reflectance}, shininess, mirror};
}

static struct surface metal(struct vec colour, double shininess, double mirror)
{
    return (struct surface){scale(colour, 0.22 * (1 - mirror)), colour, shininess, mirror};
}

static struct surface floor_surface(struct vec p, struct vec n)
{
    const double r = hypot(p.x, p.y);
    if (r > 1.06 || n.z < 0.7) {
        const double angle = atan2(p.y, p.x), stave = floor(angle * 24 / 6.283185307179586);
        const double centre = (stave + 0.5) * 6.283185307179586 / 24, c = cos(centre),
                     s = sin(centre);
        const struct vec q = vec(-s * p.x + c * p.y + stave * 1.7, c * p.x + s * p.y,
                                 p.z); /* grain across the radius */
        const double joint =
            fabs(q.x - stave * 1.7) - (c * p.x + s * p.y) * 0.13165; /* tan(pi / 24) */
        struct vec colour = wood(q, walnut, walnut_late);
        if (joint > -0.004)
            colour = scale(colour, 0.35);
        return glossy(colour, 0.03, 60, 0);
    }
    if (r > 1.03)
        return metal(vec(0.78, 0.54, 0.22), 90, 0);
    const double side = 0.2;
    const int64_t i = (int64_t) floor(p.x / side + 0.5), j = (int64_t) floor(p.y / side + 0.5);
    const double edge = larger(fabs(p.x / side - (double) i), fabs(p.y / side - (double) j));
    const struct vec q = add(p, vec((double) i * 3.1, (double) j * 2.3, (double) (i * j)));
    struct vec colour = (i + j) & 1 ? marble(q, vec(0.050, 0.115, 0.090), vec(0.20, 0.30, 0.25))
                                    : marble(q, vec(0.70, 0.66, 0.58), vec(0.42, 0.38, 0.33));
    if (edge > 0.488)
        colour = scale(colour, 0.45);
    return glossy(colour, 0.03, 120, 0);
}

static struct surface planks(struct vec p, struct vec n)
{
    const bool top = fabs(n.z) > 0.7;
    const double across = top ? p.y : p.z, width = 0.105, board = floor(across / width + 0.5);
    const double gap = 0.5 - fabs(across / width - board);
    const bool end = fabs(n.x) > 0.7;
    const struct vec turned = end ? vec(p.y, p.x, p.z) : p;
    const struct vec q =
        add(turned, vec(board * 2.7 + (end ? 5 : 0), top ? 0 : board * 0.9, board * 1.3));
    struct vec colour =
        scale(wood(q, oak, oak_late), 0.85 + 0.3 * lattice((int64_t) board, end, top));
    if (gap < 0.035)
        colour = scale(colour, 0.25);
    const double u = end ? p.y : p.x, nail = hypot(fabs(u) - 0.17, across - board * width);
    if (!top && nail < 0.009)
        colour = vec(0.05, 0.05, 0.055);
    return glossy(colour, 0.02, 20, 0);
}

static struct surface plaque(struct vec p, struct vec n)
{
    const struct surface frame_brass = metal(vec(0.82, 0.58, 0.25), 70, 0.25);
    if (n.y > -0.9)
        return frame_brass;
    const double border = larger(fabs(p.x) - PLAQUE_WIDE, fabs(p.z) - PLAQUE_HIGH);
    if (border > -0.016 || (border < -0.024 && border > -0.030))
        return frame_brass;
    const bool printed =
        sg_stroke_ink("SPLATGUARD", p.x, p.z - 0.012, 0.095, 0.075) ||
        sg_stroke_ink("3D GAUSSIAN SPLATTING", p.x, p.z + 0.057, 0.036, 0.07) ||
        sg_stroke_ink("0123456789 - EVERY RAY ACCOUNTED FOR", p.x, p.z + 0.1, 0.020, 0.075);
    if (printed)
        return glossy(vec(0.86, 0.70, 0.38), 0.04, 60, 0);
    return glossy(scale(vec(0.012, 0.022, 0.060), 0.8 + 0.4 * noise(scale(p, 60))), 0.04, 60, 0);
}

static struct surface chart(struct vec p, struct vec n)
{
    static const struct {
        const char *text;
        double row, size;
    } lines[] = {
        {"E F P", 0.140, 0.085},
        {"T O Z L", 0.055, 0.060},
        {"P E C F D 4", -0.005, 0.040},
        {"E D F C Z P 7", -0.055, 0.030},
        {"F E L O P Z D 2", -0.096, 0.022},
        {"D E F P O T E C 9", -0.128, 0.016},
    };
    if (n.y > -0.9)
        return glossy(wood(p, oak, oak_late), 0.02, 20, 0);
    if (larger(fabs(p.x) - CHART_WIDE, fabs(p.z) - CHART_HIGH) > -0.02)
        return glossy(wood(p, walnut, walnut_late), 0.03, 40, 0);
    for (size_t i = 0; i < sizeof(lines) / sizeof(*lines); i++)
        if (sg_stroke_ink(lines[i].text, p.x, p.z - lines[i].row, lines[i].size, 0.08))
            return matte(ink);
    /* a colour ramp and a line pattern of rising frequency */
    if (p.z < -0.165 && p.z > -0.20 && fabs(p.x) < 0.28) {
        const double hue = (p.x + 0.28) / 0.56 * 6.283185307179586;
        return matte(vec(0.38 + 0.34 * cos(hue), 0.38 + 0.34 * cos(hue - 2.0944),
                         0.38 + 0.34 * cos(hue + 2.0944)));
    }
    if (p.z < -0.205 && p.z > -0.235 && fabs(p.x) < 0.28) {
        const double u = (p.x + 0.28) / 0.56;
        return matte(
            scale(vec(1, 1, 1), sin(6.283185307179586 * (4 * u + 10 * u * u)) > 0 ? 0.75 : 0.02));
    }
    return matte(vec(0.78, 0.75, 0.66));
}

struct surface sg_synth_surface(enum material material, struct vec p, struct vec n)
{
    switch (material) {
    case MATERIAL_FLOOR:
        return floor_surface(p, n);
    case MATERIAL_MARBLE:
        return glossy(marble(p, vec(0.74, 0.70, 0.66), vec(0.20, 0.16, 0.17)), 0.04, 150, 0);
    case MATERIAL_PLANKS:
        return planks(p, n);
    case MATERIAL_TIMBER:
        return glossy(wood(vec(p.z, p.x, p.y), oak, oak_late), 0.02, 20, 0);
    case MATERIAL_PAINT:
        return glossy(vec(0.80, 0.78, 0.72), 0.03, 40, 0);
    case MATERIAL_BRASS:
        return metal(vec(0.86, 0.60, 0.24), 80, 0.3);
    case MATERIAL_STEEL:
        return metal(vec(0.52, 0.54, 0.58), 60, 0.3);
    case MATERIAL_CHROME:
        return metal(vec(0.86, 0.88, 0.90), 900, 1);
    case MATERIAL_LACQUER:
        return glossy(vec(0.52, 0.018, 0.022), 0.05, 700, 1);
    case MATERIAL_CERAMIC:
        return glossy(
            mix(vec(0.010, 0.155, 0.20), vec(0.020, 0.33, 0.30), turbulence(scale(p, 11), 3)), 0.05,
            400, 1);
    case MATERIAL_MATTE:
        return matte(mix(vec(0.78, 0.30, 0.075), vec(0.16, 0.19, 0.62),
                         smooth_step(-0.16, 0.16, p.z - 0.59 + 0.35 * p.x)));
    case MATERIAL_TERRACOTTA:
        return matte(scale(vec(0.50, 0.18, 0.085), 0.75 + 0.5 * turbulence(scale(p, 40), 3)));
    case MATERIAL_RUBBER:
        return glossy(vec(0.022, 0.022, 0.024), 0.03, 12, 0);
    case MATERIAL_PLAQUE:
        return plaque(p, n);
    case MATERIAL_CHART:
        return chart(p, n);
    }
    return matte(vec(0, 0, 0));
}
