/* SPDX-License-Identifier: Apache-2.0 */
/* Published captures, where this machine has them. */
#include "nearness.h"
#include "scene_files.h"

#include <math.h>

static void load_capture(struct fixture *f, const char *name, const struct sg_scene_params *params,
                         struct sg_scene **scene)
{
    char dir[512];
    snprintf(dir, sizeof(dir), "%s/../shared/data/%s", SG_SOURCE_DIR, name);
    if (!sg_dir_exists(dir)) {
        print_message("no capture in %s\n", dir);
        skip();
    }
    if (sg_scene_load(f->ctx, dir, params, scene))
        fail_msg("%s", sg_last_error(f->ctx));
}

/* Rotations are rotations. */
static void check_views(const struct sg_view *views, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        const double *R = views[i].camera.R;
        for (int a = 0; a < 3; a++)
            for (int b = 0; b < 3; b++) {
                double dot =
                    R[3 * a] * R[3 * b] + R[3 * a + 1] * R[3 * b + 1] + R[3 * a + 2] * R[3 * b + 2];
                assert_true(fabs(dot - (a == b)) < 1e-4);
            }
        assert_non_null(views[i].rgb);
    }
}

#define CELL 16

/* Points have the colours of the photos where they project. Of every cell of the image only the
 * nearest point counts, the others are likely hidden. Returns the median difference in grey levels
 * with all projections moved by (dx, dy). */
static int colour_error(const struct sg_scene *s, double dx, double dy)
{
    static struct {
        double z, x, y;
        const uint8_t *rgb;
    } cells[100][100];
    size_t counts[256] = {0}, n = 0;
    for (size_t v = 0; v < s->n_train; v += 20) {
        const struct sg_camera *c = &s->train[v].camera;
        memset(cells, 0, sizeof(cells));
        for (size_t i = 0; i < s->n_points; i++) {
            double p[3];
            for (int k = 0; k < 3; k++)
                p[k] = c->R[3 * k] * s->points[3 * i] + c->R[3 * k + 1] * s->points[3 * i + 1] +
                       c->R[3 * k + 2] * s->points[3 * i + 2] + c->t[k];
            double x = c->fx * p[0] / p[2] + c->cx + dx, y = c->fy * p[1] / p[2] + c->cy + dy;
            if (p[2] < 0.1 || !(x >= 0 && x < c->width && y >= 0 && y < c->height))
                continue;
            int row = (int) y / CELL, column = (int) x / CELL;
            if (cells[row][column].rgb && cells[row][column].z < p[2])
                continue;
            cells[row][column].z = p[2];
            cells[row][column].x = x;
            cells[row][column].y = y;
            cells[row][column].rgb = s->point_colors + 3 * i;
        }
        for (int i = 0; i < 100 * 100; i++) {
            const uint8_t *rgb = cells[i / 100][i % 100].rgb;
            size_t x = (size_t) cells[i / 100][i % 100].x, y = (size_t) cells[i / 100][i % 100].y;
            for (size_t k = 0; k < 3 && rgb; k++, n++)
                counts[abs(rgb[k] - s->train[v].rgb[3 * (y * (size_t) c->width + x) + k])]++;
        }
    }
    assert_true(n > 1000);
    int median = 0;
    for (size_t below = counts[0]; below < n / 2; below += counts[++median])
        ;
    return median;
}

/* The colours fit best where the cameras say, to two pixels: wrong axes, pose order or pixel origin
 * would move it. */
static void check_colours(const struct sg_scene *s)
{
    int here = colour_error(s, 0, 0);
    assert_true(here < colour_error(s, 2, 0));
    assert_true(here < colour_error(s, -2, 0));
    assert_true(here < colour_error(s, 0, 2));
    assert_true(here < colour_error(s, 0, -2));
}

/* The spectra of photos whose sides are continued: 800 x 533 and 760 x 423. */
static void check_spectra(struct fixture *f, const struct sg_scene *s)
{
    for (size_t i = 0; i < s->n_train; i += 12) {
        const int w = s->train[i].camera.width, h = s->train[i].camera.height, n = w * h;
        float *planes = malloc(3 * (size_t) n * sizeof(*planes));
        for (int j = 0; j < 3 * n; j++)
            planes[j] = (float) s->train[i].rgb[3 * (j % n) + j / n] / 255;
        const struct nearness near = against_exact(f->ctx, w, h, planes);
        if (!(fabs(near.loss - 1) < 0.15 && near.cosine > 0.85 && fabs(near.length - 1) < 0.15))
            fail_msg("%s: of the exact loss %g, cosine %g, of the exact length %g",
                     s->train[i].name, near.loss, near.cosine, near.length);
        free(planes);
    }
}

static void lego(void **state)
{
    struct fixture *f = *state;
    struct sg_scene *s;
    load_capture(f, "lego", sg_scene_params(.eval = true, .white_background = true), &s);
    assert_int_equal(s->n_train, 100);
    assert_int_equal(s->n_test, 25);
    assert_int_equal(s->train[0].camera.width, 800);
    assert_true(fabs(s->train[0].camera.fx - 1111.111) < 0.01);
    assert_true(s->train[0].rgb[0] == 255);
    check_views(s->train, s->n_train);
    sg_scene_destroy(&s);
}

static void bonsai(void **state)
{
    struct fixture *f = *state;
    struct sg_scene *s;
    load_capture(f, "bonsai", sg_scene_params(.eval = true), &s);
    assert_int_equal(s->n_test, 37);
    assert_int_equal(s->n_train, 254);
    assert_int_equal(s->n_points, 109323);
    check_views(s->train, s->n_train);
    check_colours(s);
    check_spectra(f, s);
    sg_scene_destroy(&s);
}

static void train(void **state)
{
    struct fixture *f = *state;
    struct sg_scene *s;
    load_capture(f, "train", NULL, &s);
    assert_int_equal(s->n_train, 151);
    assert_int_equal(s->n_points, 107775);
    assert_true(s->train[0].camera.fx != s->train[0].camera.fy);
    check_views(s->train, s->n_train);
    check_colours(s);
    check_spectra(f, s);
    sg_scene_destroy(&s);
}

static void fox(void **state)
{
    struct fixture *f = *state;
    struct sg_scene *s;
    load_capture(f, "fox", sg_scene_params(.eval = true, .downscale = 8), &s);
    assert_int_equal(s->n_train + s->n_test, 50);
    assert_int_equal(s->n_test, 7);
    assert_int_equal(f->warnings, 1); /* missing photos */
    assert_int_equal(s->train[0].camera.width, 135);
    assert_int_equal(s->train[0].file_height, 1920);
    check_views(s->train, s->n_train);
    sg_scene_destroy(&s);
}

int main(void)
{
    const struct CMUnitTest tests[] = {scene_test(lego), scene_test(bonsai), scene_test(train),
                                       scene_test(fox)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
