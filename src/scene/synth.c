/* SPDX-License-Identifier: Apache-2.0 */
/* Views of the synthetic scene: cameras, images, and the two folder layouts. */
#include "splatguard/synth.h"

#include <dirent.h>
#include <math.h>
#include <string.h>

#include "core/file.h"
#include "core/rng.h"
#include "image.h"
#include "splatguard/camera.h"
#include "synth_scene.h"

#define ANGLE_X 0.6911112070083618 /* horizontal field of view, as NeRF-Synthetic */
#define RADIUS 4.0

struct synth {
    sg_ctx *ctx;
    const char *dir;
    struct sg_synth_params p;
    struct synth_scene scene;
    int views; /* train, then test */
    double focal;
    /* COLMAP order: names rise with the index, every 8th is a test view while there are any. */
    int *colmap_order, colmap_count;
};

struct pose {
    struct vec at, right, down, forward;
};

/* Train views spiral over the upper hemisphere, test views run a ring of their own through it. */
static struct pose pose_of(const struct synth *s, int view)
{
    double azimuth, elevation;
    if (view < s->p.train_views) {
        const double u = (view + 0.5) / s->p.train_views;
        azimuth = 2.399963229728653 * view; /* golden angle */
        elevation = asin(0.03 + 0.92 * u);
    } else {
        const double u = (view - s->p.train_views + 0.5) / s->p.test_views;
        azimuth = 6.283185307179586 * u + 0.4;
        elevation = 0.55 + 0.30 * sin(12.566370614359172 * u);
    }
    struct pose p;
    p.forward = (struct vec){-cos(elevation) * cos(azimuth), -cos(elevation) * sin(azimuth), -sin(elevation)};
    p.at = vec_add(vec_scale(p.forward, -RADIUS), (struct vec){0, 0, -0.12});
    p.right = vec_unit(vec_cross(p.forward, (struct vec){0, 0, 1}));
    p.down = vec_cross(p.forward, p.right);
    return p;
}

static struct vec ray(const struct synth *s, const struct pose *p, double x, double y)
{
    const struct vec d = vec_add(p->forward, vec_add(vec_scale(p->right, (x - 0.5 * s->p.width) / s->focal),
                                                     vec_scale(p->down, (y - 0.5 * s->p.height) / s->focal)));
    return vec_unit(d);
}

static uint8_t encode(double linear) /* sRGB */
{
    const double v = linear <= 0 ? 0 : linear >= 1 ? 1 : linear;
    const double c = v <= 0.0031308 ? 12.92 * v : 1.055 * pow(v, 1 / 2.4) - 0.055;
    return (uint8_t) (255 * c + 0.5);
}

/* Straight alpha: the mean colour of the samples that hit, and their share. */
static void pixel(const struct synth *s, const struct pose *pose, int x, int y, uint8_t *rgba)
{
    const int n = s->p.samples;
    struct vec sum = {0};
    int hits = 0;
    for (int k = 0; k < n * n; k++) {
        const double jx = (k % n + 0.5) / n, jy = (k / n + 0.5) / n;
        const struct vec d = ray(s, pose, x + jx, y + jy);
        struct hit hit;
        if (!synth_trace(&s->scene, pose->at, d, &hit))
            continue;
        const int light = (k * 5 + 3) % (n * n); /* another cell of the light than of the pixel */
        const double jitter[2] = {(light % n + 0.5) / n, (light / n + 0.5) / n};
        sum = vec_add(sum, synth_shade(&s->scene, d, &hit, jitter));
        hits++;
    }
    memset(rgba, 0, 4);
    if (!hits)
        return;
    sum = vec_scale(sum, 1.0 / hits);
    rgba[0] = encode(sum.x), rgba[1] = encode(sum.y), rgba[2] = encode(sum.z);
    rgba[3] = (uint8_t) ((255 * hits + n * n / 2) / (n * n));
}

static int write_view(struct synth *s, int view, const uint8_t *rgba, uint8_t *rgb)
{
    const bool train = view < s->p.train_views;
    char *path = sg_strf(s->ctx, "%s/blender/%s/r_%d.png", s->dir, train ? "train" : "test",
                         train ? view : view - s->p.train_views);
    int code = path ? sg_image_write_png(s->ctx, path, rgba, s->p.width, s->p.height, 4) : SG_ERR_BUDGET;
    sg_free(s->ctx, path);
    for (int i = 0; i < s->colmap_count && !code; i++) {
        if (s->colmap_order[i] != view)
            continue;
        const size_t n = (size_t) s->p.width * (size_t) s->p.height;
        for (size_t k = 0; k < 3 * n; k++) /* on black */
            rgb[k] = (uint8_t) ((rgba[4 * (k / 3) + k % 3] * rgba[4 * (k / 3) + 3] + 127) / 255);
        path = sg_strf(s->ctx, "%s/colmap/images/%05d.png", s->dir, i);
        code = path ? sg_image_write_png(s->ctx, path, rgb, s->p.width, s->p.height, 3) : SG_ERR_BUDGET;
        sg_free(s->ctx, path);
    }
    return code;
}

static void render_view(void *arg, size_t view, int thread)
{
    (void) thread;
    struct synth *s = arg;
    const size_t n = (size_t) s->p.width * (size_t) s->p.height;
    if (sg_last_error(s->ctx)[0])
        return; /* another view failed */
    uint8_t *rgba = sg_alloc_raw(s->ctx, SG_MEM_IMAGES, n, 4), *rgb = sg_alloc_raw(s->ctx, SG_MEM_IMAGES, n, 3);
    if (rgba && rgb) {
        const struct pose pose = pose_of(s, (int) view);
        for (size_t i = 0; i < n; i++)
            pixel(s, &pose, (int) (i % (size_t) s->p.width), (int) (i / (size_t) s->p.width), rgba + 4 * i);
        write_view(s, (int) view, rgba, rgb);
    }
    sg_free(s->ctx, rgba);
    sg_free(s->ctx, rgb);
}

static int write_transforms(struct synth *s, bool train)
{
    char *path = sg_strf(s->ctx, "%s/blender/transforms_%s.json", s->dir, train ? "train" : "test");
    struct sg_file_writer w = {0};
    int code = path ? sg_file_create(s->ctx, &w, path) : SG_ERR_BUDGET;
    if (!code) {
        const int first = train ? 0 : s->p.train_views, count = train ? s->p.train_views : s->p.test_views;
        fprintf(w.stream, "{\n \"camera_angle_x\": %.17g,\n \"frames\": [", ANGLE_X);
        for (int i = 0; i < count; i++) {
            const struct pose p = pose_of(s, first + i);
            /* OpenGL camera axes: x right, y up, z backwards. */
            const double m[3][4] = {{p.right.x, -p.down.x, -p.forward.x, p.at.x},
                                    {p.right.y, -p.down.y, -p.forward.y, p.at.y},
                                    {p.right.z, -p.down.z, -p.forward.z, p.at.z}};
            fprintf(w.stream, "%s\n  {\"file_path\": \"./%s/r_%d\", \"transform_matrix\": [", i ? "," : "",
                    train ? "train" : "test", i);
            for (int r = 0; r < 3; r++)
                fprintf(w.stream, "[%.17g, %.17g, %.17g, %.17g], ", m[r][0], m[r][1], m[r][2], m[r][3]);
            fprintf(w.stream, "[0, 0, 0, 1]]}");
        }
        fprintf(w.stream, "\n ]\n}\n");
        code = sg_file_commit(s->ctx, &w);
    }
    sg_free(s->ctx, path);
    return code;
}

static void put_i32(FILE *f, int32_t v)
{
    fwrite(&v, sizeof(v), 1, f);
}
static void put_u64(FILE *f, uint64_t v)
{
    fwrite(&v, sizeof(v), 1, f);
}
static void put_f64(FILE *f, double v)
{
    fwrite(&v, sizeof(v), 1, f);
}

/* Rows right, down, forward are the world-to-camera rotation; Shepperd's method (1978). */
static void quaternion(const struct pose *p, double q[4])
{
    const double m[3][3] = {{p->right.x, p->right.y, p->right.z},
                            {p->down.x, p->down.y, p->down.z},
                            {p->forward.x, p->forward.y, p->forward.z}};
    const double trace = m[0][0] + m[1][1] + m[2][2];
    int i = 0;
    if (trace > 0) {
        const double r = sqrt(1 + trace);
        q[0] = 0.5 * r;
        q[1] = 0.5 * (m[2][1] - m[1][2]) / r, q[2] = 0.5 * (m[0][2] - m[2][0]) / r;
        q[3] = 0.5 * (m[1][0] - m[0][1]) / r;
        return;
    }
    i = m[1][1] > m[i][i] ? 1 : i;
    i = m[2][2] > m[i][i] ? 2 : i;
    const int j = (i + 1) % 3, k = (i + 2) % 3;
    const double r = sqrt(1 + m[i][i] - m[j][j] - m[k][k]);
    q[0] = 0.5 * (m[k][j] - m[j][k]) / r;
    q[1 + i] = 0.5 * r;
    q[1 + j] = 0.5 * (m[j][i] + m[i][j]) / r;
    q[1 + k] = 0.5 * (m[k][i] + m[i][k]) / r;
}

static void put_cameras(struct synth *s, FILE *f)
{
    put_u64(f, 1);
    put_i32(f, 1);
    put_i32(f, 1); /* PINHOLE */
    put_u64(f, (uint64_t) s->p.width);
    put_u64(f, (uint64_t) s->p.height);
    put_f64(f, s->focal);
    put_f64(f, s->focal);
    put_f64(f, 0.5 * s->p.width);
    put_f64(f, 0.5 * s->p.height);
}

static void put_images(struct synth *s, FILE *f)
{
    put_u64(f, (uint64_t) s->colmap_count);
    for (int i = 0; i < s->colmap_count; i++) {
        const struct pose p = pose_of(s, s->colmap_order[i]);
        double q[4];
        quaternion(&p, q);
        put_i32(f, i + 1);
        for (int k = 0; k < 4; k++)
            put_f64(f, q[k]);
        put_f64(f, -vec_dot(p.right, p.at));
        put_f64(f, -vec_dot(p.down, p.at));
        put_f64(f, -vec_dot(p.forward, p.at));
        put_i32(f, 1);
        char name[32];
        snprintf(name, sizeof(name), "%05d.png", i);
        fwrite(name, strlen(name) + 1, 1, f);
        put_u64(f, 0);
    }
}

/* Points where random rays of the views meet the surface, with the colour seen there. */
static void put_points(struct synth *s, FILE *f)
{
    put_u64(f, (uint64_t) s->p.points);
    uint64_t draw = 0;
    for (int i = 0; i < s->p.points;) {
        const int view = (int) (sg_rng_u64(s->p.seed, SG_RNG_SYNTH, 2, draw++) % (uint64_t) s->p.train_views);
        const double x = (double) sg_rng_uniform(s->p.seed, SG_RNG_SYNTH, 2, draw++) * s->p.width;
        const double y = (double) sg_rng_uniform(s->p.seed, SG_RNG_SYNTH, 2, draw++) * s->p.height;
        const struct pose p = pose_of(s, view);
        const struct vec d = ray(s, &p, x, y);
        struct hit hit;
        if (!synth_trace(&s->scene, p.at, d, &hit))
            continue;
        const struct vec c = synth_shade(&s->scene, d, &hit, (const double[2]){0.5, 0.5});
        put_u64(f, (uint64_t) ++i);
        put_f64(f, hit.point.x);
        put_f64(f, hit.point.y);
        put_f64(f, hit.point.z);
        const uint8_t rgb[3] = {encode(c.x), encode(c.y), encode(c.z)};
        fwrite(rgb, 3, 1, f);
        put_f64(f, 0);
        put_u64(f, 0);
    }
}

static int write_colmap(struct synth *s, const char *name, void (*put)(struct synth *, FILE *))
{
    char *path = sg_strf(s->ctx, "%s/colmap/sparse/0/%s", s->dir, name);
    struct sg_file_writer w = {0};
    int code = path ? sg_file_create(s->ctx, &w, path) : SG_ERR_BUDGET;
    if (!code) {
        put(s, w.stream);
        code = sg_file_commit(s->ctx, &w);
    }
    sg_free(s->ctx, path);
    return code;
}

static int make_dirs(struct synth *s)
{
    static const char *const names[] = {"blender/train", "blender/test", "colmap/images", "colmap/sparse/0"};
    DIR *d = opendir(s->dir);
    int entries = 0;
    while (d && readdir(d))
        entries++;
    if (d)
        closedir(d);
    if (entries > 2)
        return sg_fail(s->ctx, SG_ERR_INPUT, "%s: found a folder with content, expected a new or empty one", s->dir);
    int code = SG_OK;
    for (size_t i = 0; i < sizeof(names) / sizeof(names[0]) && !code; i++) {
        char *path = sg_strf(s->ctx, "%s/%s", s->dir, names[i]);
        code = path ? sg_dir_create(s->ctx, path) : SG_ERR_BUDGET;
        sg_free(s->ctx, path);
    }
    return code;
}

static int check(sg_ctx *ctx, const struct sg_synth_params *p)
{
    const struct {
        const char *name;
        int value, low, high;
    } ranges[] = {{"width", p->width, 16, 4096},
                  {"height", p->height, 16, 4096},
                  {"train-views", p->train_views, 4, 4096},
                  {"test-views", p->test_views, 1, 4096},
                  {"points", p->points, 4, 10000000},
                  {"samples", p->samples, 1, 8}};
    for (size_t i = 0; i < sizeof(ranges) / sizeof(ranges[0]); i++)
        if (ranges[i].value < ranges[i].low || ranges[i].value > ranges[i].high)
            return sg_fail(ctx, SG_ERR_USAGE, "synth: %s: found %d, expected %d to %d", ranges[i].name, ranges[i].value,
                           ranges[i].low, ranges[i].high);
    return SG_OK;
}

static void order_colmap(struct synth *s)
{
    int train = 0, test = s->p.train_views;
    while (train < s->p.train_views || test < s->views) {
        const bool wants_test = s->colmap_count % 8 == 0;
        if (wants_test ? test == s->views : train == s->p.train_views)
            break; /* what is left would land in the wrong split */
        s->colmap_order[s->colmap_count++] = wants_test ? test++ : train++;
    }
}

int sg_synth_write(sg_ctx *ctx, const char *dir, const struct sg_synth_params *params)
{
    sg_clear_error(ctx);
    struct synth s = {.ctx = ctx, .dir = dir, .p = params ? *params : (struct sg_synth_params){SG_SYNTH_DEFAULTS}};
    int code = check(ctx, &s.p);
    if (code)
        return code;
    s.views = s.p.train_views + s.p.test_views;
    s.focal = 0.5 * s.p.width / tan(0.5 * ANGLE_X);
    s.colmap_order = sg_alloc(ctx, SG_MEM_MISC, (size_t) s.views, sizeof(int));
    if (!s.colmap_order)
        return SG_ERR_BUDGET;
    order_colmap(&s);
    synth_scene_build(&s.scene, s.p.seed);
    if ((code = make_dirs(&s)))
        goto done;
    sg_parallel_for(ctx, (size_t) s.views, render_view, &s);
    if (sg_last_error(ctx)[0]) {
        code = SG_ERR_INPUT;
        goto done;
    }
    /* What makes the folders scenes comes last: an interrupted run leaves none. */
    if ((code = write_colmap(&s, "points3D.bin", put_points)) || (code = write_colmap(&s, "images.bin", put_images)) ||
        (code = write_colmap(&s, "cameras.bin", put_cameras)) || (code = write_transforms(&s, false)))
        goto done;
    code = write_transforms(&s, true);
done:
    sg_free(ctx, s.colmap_order);
    return code;
}
