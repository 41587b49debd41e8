/* SPDX-License-Identifier: Apache-2.0 */
/* The synthetic scene: same bytes for the same seed, exact cameras, points on the surfaces, clear
 * refusals. */
#include "scene_files.h"

#include <errno.h>
#include <math.h>
#include <unistd.h>

#include "synth/solids.h"
#include "image/stroke_font.h"
#include "splatguard/synth.h"

static const struct sg_synth_params tiny = {.width = 32,
                                            .height = 24,
                                            .train_views = 4,
                                            .test_views = 2,
                                            .points = 40,
                                            .samples = 2,
                                            .seed = 7};

static const char *const tiny_files[] = {
    "blender/transforms_train.json", "blender/transforms_test.json", "blender/train/r_0.png",
    "blender/train/r_3.png",         "blender/test/r_0.png",         "blender/test/r_1.png",
    "colmap/sparse/0/cameras.bin",   "colmap/sparse/0/images.bin",   "colmap/sparse/0/points3D.bin",
    "colmap/images/view_0000.png",   "colmap/images/view_0004.png",
};

static char *joined(char *buffer, const struct fixture *f, const char *name)
{
    snprintf(buffer, 256, "%s/%s", f->dir, name);
    return buffer;
}

static void write_scene(struct fixture *f, sg_ctx *ctx, const char *name,
                        const struct sg_synth_params *p)
{
    char dir[256];
    if (sg_synth_write(ctx, joined(dir, f, name), p))
        fail_msg("%s", sg_last_error(ctx));
}

/* Whether every file of the two folders has the same bytes. */
static bool same(struct fixture *f, const char *a, const char *b)
{
    bool equal = true;
    for (size_t i = 0; i < sizeof(tiny_files) / sizeof(*tiny_files); i++) {
        char path[2][300], *data[2];
        size_t size[2];
        snprintf(path[0], sizeof(path[0]), "%s/%s/%s", f->dir, a, tiny_files[i]);
        snprintf(path[1], sizeof(path[1]), "%s/%s/%s", f->dir, b, tiny_files[i]);
        for (int k = 0; k < 2; k++)
            if (sg_file_read(f->ctx, path[k], 1 << 20, &data[k], &size[k]))
                fail_msg("%s", sg_last_error(f->ctx));
        equal = equal && size[0] == size[1] && !memcmp(data[0], data[1], size[0]);
        sg_free(data[0]);
        sg_free(data[1]);
    }
    return equal;
}

static void bytes_depend_on_the_seed_alone(void **state)
{
    struct fixture *f = *state;
    sg_ctx *single;
    assert_int_equal(sg_ctx_create(&single, &(struct sg_ctx_params){.threads = 1}), 0);
    struct sg_synth_params other = tiny;
    other.seed = 8;
    write_scene(f, f->ctx, "a", &tiny);
    write_scene(f, f->ctx, "b", &tiny);
    write_scene(f, single, "c", &tiny);
    write_scene(f, f->ctx, "d", &other);
    assert_true(same(f, "a", "b"));
    assert_true(same(f, "a", "c"));
    assert_false(same(f, "a", "d"));
    sg_ctx_destroy(&single);
}

static struct sg_scene *load_layout(struct fixture *f, const char *name)
{
    struct sg_scene *scene;
    char dir[256];
    if (sg_scene_load(f->ctx, joined(dir, f, name), sg_scene_params(.eval = true), &scene))
        fail_msg("%s", sg_last_error(f->ctx));
    return scene;
}

static void check_camera(const struct sg_camera *c)
{
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            double d = 0;
            for (int k = 0; k < 3; k++)
                d += c->R[3 * i + k] * c->R[3 * j + k];
            assert_true(fabs(d - (i == j)) < 1e-12);
        }
    /* the origin lies 4 in front of every camera */
    assert_true(fabs(c->t[0]) < 1e-9 && fabs(c->t[1]) < 1e-9 && fabs(c->t[2] - 4) < 1e-9);
}

static void same_view(const struct sg_view *a, const struct sg_view *b)
{
    for (int i = 0; i < 9; i++)
        assert_true(fabs(a->camera.R[i] - b->camera.R[i]) < 1e-9);
    assert_true(fabs(a->camera.fx - b->camera.fx) < 1e-9);
    assert_memory_equal(a->rgb, b->rgb, (size_t) a->camera.width * (size_t) a->camera.height * 3);
    check_camera(&a->camera);
    check_camera(&b->camera);
}

static void both_layouts_agree(void **state)
{
    struct fixture *f = *state;
    struct sg_synth_params p = tiny;
    p.train_views = 15; /* three test views in the COLMAP layout, one more than asked for */
    write_scene(f, f->ctx, "s", &p);
    struct sg_scene *blender = load_layout(f, "s/blender"), *colmap = load_layout(f, "s/colmap");
    assert_int_equal(blender->n_train, 15);
    assert_int_equal(blender->n_test, 2);
    assert_int_equal(colmap->n_train, 15);
    assert_int_equal(colmap->n_test, 3);
    assert_int_equal(colmap->n_points, 40);
    assert_int_equal(colmap->train[0].camera.width, 32);
    assert_int_equal(colmap->train[0].camera.height, 24);
    for (size_t i = 0; i < 15; i++)
        same_view(&blender->train[i], &colmap->train[i]);
    for (size_t i = 0; i < 2; i++)
        same_view(&blender->test[i], &colmap->test[i]);
    assert_int_equal(f->warnings, 0);
    sg_scene_destroy(&blender);
    sg_scene_destroy(&colmap);
}

static int rising(const void *a, const void *b)
{
    return *(const int *) a - *(const int *) b;
}

/* Median over the points of the largest difference between a point's colour and the pixel of a view
 * it falls on. */
static int median_error(const struct sg_scene *s, size_t shift)
{
    int *error = calloc(s->n_points, sizeof(*error));
    for (size_t i = 0; i < s->n_points; i++) {
        const struct sg_view *v = &s->train[(i + shift) % s->n_train];
        const struct sg_camera *c = &v->camera;
        const float *p = &s->points[3 * i];
        double q[3];
        for (int r = 0; r < 3; r++)
            q[r] = c->R[3 * r] * p[0] + c->R[3 * r + 1] * p[1] + c->R[3 * r + 2] * p[2] + c->t[r];
        assert_true(q[2] > 1);
        const int x = (int) floor(c->fx * q[0] / q[2] + c->cx),
                  y = (int) floor(c->fy * q[1] / q[2] + c->cy);
        assert_true(shift || (x >= 0 && y >= 0 && x < c->width && y < c->height));
        for (int k = 0; k < 3 && x >= 0 && y >= 0 && x < c->width && y < c->height; k++) {
            const int d =
                abs(v->rgb[3 * (y * c->width + x) + k] - s->point_colors[3 * i + (size_t) k]);
            error[i] = d > error[i] ? d : error[i];
        }
    }
    qsort(error, s->n_points, sizeof(*error), rising);
    const int median = error[s->n_points / 2];
    free(error);
    return median;
}

static void points_have_the_colour_of_their_pixel(void **state)
{
    struct fixture *f = *state;
    struct sg_synth_params p = tiny;
    p.width = p.height = 128;
    p.points = 2000;
    write_scene(f, f->ctx, "s", &p);
    struct sg_scene *s = load_layout(f, "s/colmap");
    const int own = median_error(s, 0), others = median_error(s, 1);
    assert_in_range(own, 0, 16);
    assert_in_range(others, 3 * own, 255); /* hidden or lit otherwise from the next camera */
    sg_scene_destroy(&s);
}

static void bad_parameters_are_refused(void **state)
{
    struct fixture *f = *state;
    const struct {
        size_t field;
        int low, high;
    } fields[] = {
        {offsetof(struct sg_synth_params, width), 16, 4096},
        {offsetof(struct sg_synth_params, height), 16, 4096},
        {offsetof(struct sg_synth_params, train_views), 4, 4096},
        {offsetof(struct sg_synth_params, test_views), 1, 4096},
        {offsetof(struct sg_synth_params, points), 4, 10000000},
        {offsetof(struct sg_synth_params, samples), 1, 8},
    };
    char dir[256];
    joined(dir, f, "none");
    for (size_t i = 0; i < sizeof(fields) / sizeof(*fields); i++)
        for (int k = 0; k < 2; k++) {
            struct sg_synth_params p = tiny;
            *(int *) ((char *) &p + fields[i].field) = k ? fields[i].high + 1 : fields[i].low - 1;
            assert_int_equal(sg_synth_write(f->ctx, dir, &p), SG_ERR_USAGE);
            assert_non_null(strstr(sg_last_error(f->ctx), "expected"));
            assert_false(sg_dir_exists(dir));
        }
    assert_int_equal(sg_synth_write(f->ctx, "", &tiny), SG_ERR_USAGE); /* not the root */
    assert_non_null(strstr(sg_last_error(f->ctx), "found an empty path"));
}

static void other_folders_stay_untouched(void **state)
{
    struct fixture *f = *state;
    char path[256];
    assert_int_equal(sg_file_write(f->ctx, joined(path, f, "photo"), "x", 1), 0);
    assert_int_equal(sg_synth_write(f->ctx, f->dir, &tiny), SG_ERR_INPUT);
    assert_non_null(strstr(sg_last_error(f->ctx), "photo"));
    assert_false(sg_dir_exists(joined(path, f, "blender")));
    assert_int_equal(sg_synth_write(f->ctx, joined(path, f, "photo"), &tiny),
                     SG_ERR_INPUT); /* a file */
}

/* Wherever memory ends, nothing is left, so that the caller can try again. */
static void a_failed_run_leaves_nothing(void **state)
{
    struct fixture *f = *state;
    char dir[256];
    int failed = 0, code = SG_ERR_BUDGET;
    joined(dir, f, "s");
    for (uint64_t limit = 64; code; limit += limit < 20000 ? 64 : limit / 4) {
        sg_ctx *poor;
        assert_int_equal(
            sg_ctx_create(&poor, &(struct sg_ctx_params){.threads = 2, .max_memory = limit}), 0);
        code = sg_synth_write(poor, dir, &tiny);
        assert_int_equal(sg_mem_current(poor, SG_MEM_TAGS), 0);
        if (code) {
            failed++;
            assert_int_equal(code, SG_ERR_BUDGET);
            assert_true(sg_last_error(poor)[0]);
            if (rmdir(dir) && errno != ENOENT) /* it is empty, or was not made */
                fail_msg("limit %llu: %s", (unsigned long long) limit, strerror(errno));
        }
        sg_ctx_destroy(&poor);
    }
    assert_true(failed > 100);
}

/* Degenerate forms of every solid are the unit sphere, which has a closed form. */
static void solids_meet_rays_where_a_sphere_does(void **state)
{
    (void) state;
    const struct vec o = {0.1, -0.2, 0.3}, cube = {1, 1, 1};
    const struct solid sphere = sg_solid_sphere(o, 1, 0);
    const struct solid others[] = {
        sg_solid_capsule(o, vec(o.x, o.y, o.z + 1e-9), 1, 0),
        sg_solid_box(o, cube, 1, 0),
        sg_solid_cylinder(o, 1, 1, 1, 0),
        sg_solid_torus(o, 0, 1, 0),
    };
    int hits = 0;
    for (int i = 0; i < 2000; i++) {
        const double a = 2.4 * i, z = 1 - (i + 0.5) / 1000, r = sqrt(1 - z * z), b = 0.7 * i;
        const struct vec from = scale(vec(r * cos(a), r * sin(a), z), 3);
        const struct vec d =
            normalise(sub(vec(1.3 * cos(b), 1.3 * sin(b), 0.4 * cos(3 * b)), from));
        const double t = sg_solid_hit(&sphere, from, d, 9), far = length(cross(sub(o, from), d));
        assert_true(t == 9 ? far > 1 - 1e-9 : far < 1 + 1e-9);
        hits += t < 9;
        for (size_t k = 0; k < 4 && fabs(far - 1) > 1e-2;
             k++) { /* a march may pass where the ray only grazes */
            const double other = sg_solid_hit(&others[k], from, d, 9);
            if (!(fabs(other - t) < 2e-3))
                fail_msg("solid %zu, far %g: %g is not %g", k, far, other, t);
            if (t < 9) {
                const struct vec p = along(from, d, other);
                assert_true(length(sub(sg_solid_normal(&others[k], p),
                                       sg_solid_normal(&sphere, p))) < 1e-2);
                assert_true(sg_solid_hit(&others[k], from, d, 0.5 * t) ==
                            0.5 * t); /* out of reach */
            }
        }
    }
    assert_in_range(hits, 300, 1900);
}

static void print_is_where_the_strokes_are(void **state)
{
    (void) state;
    assert_true(sg_stroke_ink("I", 0, 0.5, 1, 0.08));  /* a stem in the middle */
    assert_false(sg_stroke_ink("O", 0, 0.5, 1, 0.08)); /* a hole */
    assert_true(sg_stroke_ink("O", -1.0 / 3, 0.5, 1, 0.08));
    assert_true(sg_stroke_ink("IOI", -1, 0.5, 1, 0.08)); /* glyphs are one size apart */
    assert_false(sg_stroke_ink("IOI", 0, 0.5, 1, 0.08));
    assert_true(sg_stroke_ink("L", 0, 0, 1, 0.08) &&
                !sg_stroke_ink("L", 0, 1, 1, 0.08)); /* upright */
    assert_true(sg_stroke_ink(".", 0, 0, 1, 0.08));
    for (int c = 0; c < 128; c++) { /* characters without a glyph are blank */
        const char text[2] = {(char) c, 0};
        int inked = 0;
        for (int i = 0; i < 40 * 60; i++)
            inked += sg_stroke_ink(text, (i % 40 - 20) / 20.0, (i / 40 - 15) / 30.0, 1, 0.08);
        const bool known =
            (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || (c && strchr(".-/+", c));
        assert_int_equal(inked > 0, known);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        scene_test(bytes_depend_on_the_seed_alone),
        scene_test(both_layouts_agree),
        scene_test(points_have_the_colour_of_their_pixel),
        scene_test(bad_parameters_are_refused),
        scene_test(other_folders_stay_untouched),
        scene_test(a_failed_run_leaves_nothing),
        cmocka_unit_test(solids_meet_rays_where_a_sphere_does),
        cmocka_unit_test(print_is_where_the_strokes_are),
    };
    return cmocka_run_group_tests_name("synth", tests, NULL, NULL);
}
