/* SPDX-License-Identifier: Apache-2.0 */
/* One ray through the middle of each pixel finds the edges; only pixels that differ from a
 * neighbour get the full grid of samples (Whitted 1980), and samples of a pixel on one surface
 * share their shadow and occlusion rays. */
#include "render.h"

#include "light.h"

#define CONTRAST 0.024 /* of display values, below which neighbours count as equal */
#define SHARED 6       /* surfaces of one pixel whose exposure is kept */

struct sample {
    int solid; /* -1: nothing */
    struct vec n, colour;
    struct vec display; /* colour in display values, to measure contrast */
    struct synth_exposure exposure;
};

struct shared {
    struct sample surface[SHARED];
    int count;
};

struct synth_camera sg_synth_camera_at(struct vec centre, struct vec target, int width, int height,
                                       double angle_x)
{
    struct synth_camera c = {.centre = centre, .width = width, .height = height};
    c.forward = normalise(sub(target, centre));
    c.right = normalise(cross(c.forward, vec(0, 0, 1)));
    c.up = cross(c.right, c.forward);
    c.focal = width / (2 * tan(angle_x / 2));
    return c;
}

static double encode(double c) /* IEC 61966-2-1 */
{
    return c <= 0.0031308 ? 12.92 * c : 1.055 * pow(c, 1 / 2.4) - 0.055;
}

static uint8_t to_byte(double c)
{
    return (uint8_t) (255 * clamp01(encode(c)) + 0.5);
}

static struct vec ray(const struct synth_camera *c, double x, double y)
{
    const double right = (x - 0.5 * c->width) / c->focal, up = (0.5 * c->height - y) / c->focal;
    return normalise(add(c->forward, add(scale(c->right, right), scale(c->up, up))));
}

static struct sample take(const struct synth_scene *scene, const struct synth_camera *camera,
                          double x, double y, struct shared *shared)
{
    const struct vec d = ray(camera, x, y);
    const struct synth_hit hit = sg_synth_trace(scene, camera->centre, d);
    struct sample s = {.solid = hit.solid, .n = hit.n};
    if (hit.solid < 0)
        return s;
    int i = 0;
    while (i < shared->count &&
           (shared->surface[i].solid != hit.solid || dot(shared->surface[i].n, hit.n) < 0.9))
        i++;
    s.exposure = i < shared->count ? shared->surface[i].exposure : sg_synth_expose(scene, &hit);
    if (i == shared->count && i < SHARED)
        shared->surface[shared->count++] = s;
    s.colour = sg_synth_shade(scene, &hit, d, s.exposure);
    return s;
}

static bool differ(const struct sample *a, const struct sample *b)
{
    if (a->solid != b->solid)
        return true;
    return a->solid >= 0 && (fabs(a->display.x - b->display.x) > CONTRAST ||
                             fabs(a->display.y - b->display.y) > CONTRAST ||
                             fabs(a->display.z - b->display.z) > CONTRAST);
}

static void probe_row(const struct synth_scene *scene, const struct synth_camera *camera, int y,
                      struct sample *row)
{
    for (int x = 0; x < camera->width; x++) {
        struct shared none = {.count = 0};
        row[x] = take(scene, camera, x + 0.5, y + 0.5, &none);
        row[x].display =
            vec(encode(row[x].colour.x), encode(row[x].colour.y), encode(row[x].colour.z));
    }
}

static void put(uint8_t *rgba, struct vec sum, int hits, int count)
{
    const double s = hits ? 1.0 / hits : 0;
    rgba[0] = to_byte(sum.x * s);
    rgba[1] = to_byte(sum.y * s);
    rgba[2] = to_byte(sum.z * s);
    rgba[3] = (uint8_t) ((255 * hits + count / 2) / count);
}

/* rows: the probes of y - 1, y, y + 1 */
static void resolve_row(const struct synth_scene *scene, const struct synth_camera *camera,
                        int samples, int y, struct sample *const rows[3], uint8_t *rgba)
{
    const int from = y > 0 ? 0 : 1, to = y + 1 < camera->height ? 2 : 1;
    for (int x = 0; x < camera->width; x++, rgba += 4) {
        const struct sample *probe = &rows[1][x];
        bool edge = false;
        for (int j = from; j <= to && !edge; j++)
            for (int i = x > 0 ? x - 1 : x; i <= x + 1 && i < camera->width && !edge; i++)
                edge = differ(probe, &rows[j][i]);
        if (!edge || samples == 1) {
            put(rgba, probe->colour, probe->solid >= 0, 1);
            continue;
        }
        struct shared shared = {.count = 0};
        if (probe->solid >= 0)
            shared.surface[shared.count++] = *probe;
        struct vec sum = vec(0, 0, 0);
        int hits = 0;
        for (int i = 0; i < samples * samples; i++) {
            const double sx = x + (i % samples + 0.5) / samples,
                         sy = y + (i / samples + 0.5) / samples;
            const struct sample s = take(scene, camera, sx, sy, &shared);
            sum = add(sum, s.colour);
            hits += s.solid >= 0;
        }
        put(rgba, sum, hits, samples * samples);
    }
}

int sg_synth_render(sg_ctx *ctx, const struct synth_scene *scene, const struct synth_camera *camera,
                    int samples, uint8_t *rgba)
{
    const size_t width = (size_t) camera->width;
    struct sample *probes = sg_alloc(ctx, SG_MEM_FRAME, 3 * width, sizeof(*probes));
    if (!probes)
        return SG_ERR_BUDGET;
    struct sample *rows[3] = {probes, probes + width, probes + 2 * width};
    probe_row(scene, camera, 0, rows[1]);
    for (int y = 0; y < camera->height; y++) {
        if (y + 1 < camera->height)
            probe_row(scene, camera, y + 1, rows[2]);
        resolve_row(scene, camera, samples, y, rows, rgba + (size_t) y * width * 4);
        struct sample *first = rows[0];
        rows[0] = rows[1];
        rows[1] = rows[2];
        rows[2] = first;
    }
    sg_free(probes);
    return SG_OK;
}

bool sg_synth_pick(const struct synth_scene *scene, const struct synth_camera *camera, double x,
                   double y, struct vec *point, uint8_t rgb[3])
{
    const struct vec d = ray(camera, x, y);
    const struct synth_hit hit = sg_synth_trace(scene, camera->centre, d);
    if (hit.solid < 0)
        return false;
    const struct vec c = sg_synth_shade(scene, &hit, d, sg_synth_expose(scene, &hit));
    *point = hit.p;
    rgb[0] = to_byte(c.x);
    rgb[1] = to_byte(c.y);
    rgb[2] = to_byte(c.z);
    return true;
}
