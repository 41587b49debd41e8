/* SPDX-License-Identifier: Apache-2.0 */
/* Flights: where their cameras are, what they look at, and what is refused. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <string.h>

#include "core/context.h"
#include "core/rng.h"
#include "scene/cameras.h"
#include "scene/reader.h"
#include "splatguard/path.h"

enum { CAMERAS = 24, FRAMES = 90 };

static struct sg_camera cameras[CAMERAS], frames[FRAMES];

static double dot(const double *a, const double *b)
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static double random_between(double low, double high, uint64_t k)
{
    const double unit = (double) (sg_rng_u64(5, SG_RNG_SYNTH, 0, k) >> 11) / (double) (1ull << 53);
    return low + unit * (high - low);
}

/* A camera at a place that looks at another, z up. */
static struct sg_camera looking(const double from[3], const double at[3], const double up[3])
{
    struct sg_camera c = {.width = 64, .height = 48, .fx = 50, .fy = 51, .cx = 31, .cy = 23};
    double *x = c.R, *y = c.R + 3, *z = c.R + 6;
    for (int k = 0; k < 3; k++)
        z[k] = (at[k] - from[k]) /
               sqrt(pow(at[0] - from[0], 2) + pow(at[1] - from[1], 2) + pow(at[2] - from[2], 2));
    const double across[3] = {z[1] * up[2] - z[2] * up[1], z[2] * up[0] - z[0] * up[2],
                              z[0] * up[1] - z[1] * up[0]};
    for (int k = 0; k < 3; k++)
        x[k] = across[k] / sqrt(dot(across, across));
    y[0] = z[1] * x[2] - z[2] * x[1];
    y[1] = z[2] * x[0] - z[0] * x[2];
    y[2] = z[0] * x[1] - z[1] * x[0];
    for (int k = 0; k < 3; k++)
        c.t[k] = -dot(c.R + 3 * k, from);
    return c;
}

static const double above[3] = {0, 0, 1};

static void fly(sg_ctx *ctx, enum sg_path_kind kind)
{
    if (sg_camera_path(ctx, kind, cameras, CAMERAS, FRAMES, frames))
        fail_msg("%s", sg_last_error(ctx));
    for (int i = 0; i < FRAMES; i++) {
        double determinant;
        assert_true(sg_rotation_error(frames[i].R, &determinant) < 1e-9 && determinant > 0);
        assert_int_equal(frames[i].width, 64);
        assert_true(frames[i].fy == 51 && frames[i].cx == 31);
    }
}

/* No frame is far from the one before, in place or direction; the longest step and the shortest. */
static void steps(double *shortest, double *longest)
{
    *shortest = INFINITY, *longest = 0;
    for (int i = 0; i < FRAMES; i++) {
        const struct sg_camera *a = &frames[i], *b = &frames[(i + 1) % FRAMES];
        double p[3], q[3], d[3];
        sg_camera_centre(a, p);
        sg_camera_centre(b, q);
        for (int k = 0; k < 3; k++)
            d[k] = q[k] - p[k];
        *shortest = fmin(*shortest, sqrt(dot(d, d)));
        *longest = fmax(*longest, sqrt(dot(d, d)));
        for (int k = 0; k < 9; k += 3)
            assert_true(dot(a->R + k, b->R + k) > 0.8);
    }
}

static void test_around(void **state)
{
    sg_ctx *ctx = *state;
    const double focus[3] = {1, 2, 0.5};
    double shortest, longest;
    for (int outwards = 0; outwards < 2; outwards++) {
        for (int i = 0; i < CAMERAS; i++) {
            const double a = 2 * M_PI * i / CAMERAS,
                         from[3] = {1 + 4 * cos(a), 2 + 2 * sin(a), 1.5},
                         away[3] = {1 + 9 * cos(a), 2 + 4.5 * sin(a), 2.5};
            cameras[i] = looking(from, outwards ? away : focus, above);
        }
        fly(ctx, SG_PATH_ELLIPSE);
        for (int i = 0; i < FRAMES; i++) {
            double c[3], to[3];
            sg_camera_centre(&frames[i], c);
            for (int k = 0; k < 3; k++)
                to[k] = focus[k] - c[k];
            assert_float_equal(c[2], 1.5, 1e-6);
            /* Of half axes that nine tenths of the cameras' offsets do not exceed. */
            const double at = pow((c[0] - 1) / 4, 2) + pow((c[1] - 2) / 2, 2);
            assert_true(at > 0.75 && at < 1.01);
            const double towards = dot(to, frames[i].R + 6) / sqrt(dot(to, to));
            assert_true(outwards ? towards < -0.9 : towards > 0.999);
            assert_true(frames[i].R[5] < -0.8); /* down is down */
        }
        steps(&shortest, &longest);
        assert_true(longest < 1.01 * shortest);
    }
}

/* Cameras in a line on both sides of what they see: the flight does not pass over it. */
static void test_line(void **state)
{
    sg_ctx *ctx = *state;
    double shortest, longest;
    for (int i = 0; i < CAMERAS; i++) {
        const double from[3] = {i < CAMERAS / 2 ? -3 - 0.1 * i : 2 + 0.1 * i, 0, 1};
        cameras[i] = looking(from, (double[3]){0, 0, 0}, above);
    }
    fly(ctx, SG_PATH_ELLIPSE);
    steps(&shortest, &longest);
    for (int i = 0; i < FRAMES; i++)
        assert_true(frames[i].R[5] < -0.7);
}

/* Cameras that look one way, among them those from above with any side up. */
static void test_one_way(void **state)
{
    sg_ctx *ctx = *state;
    double shortest, longest;
    for (int down = 0; down < 3; down++) {
        for (int i = 0; i < CAMERAS; i++) {
            const double x = random_between(-3, 3, 3 * (uint64_t) i),
                         y = random_between(-2, 2, 3 * (uint64_t) i + 1),
                         wide = random_between(-1, 1, 3 * (uint64_t) i + 2),
                         turn = 2 * M_PI * i / CAMERAS;
            if (down) /* with a heading that is the same, or each its own */
                cameras[i] = looking((double[3]){x, y, 9}, (double[3]){x, y, 0},
                                     down == 1 ? (double[3]){0, 1, 0}
                                               : (double[3]){cos(turn), sin(turn), 0});
            else
                cameras[i] = looking((double[3]){x, -8, y + 3}, (double[3]){wide, 0, 3}, above);
        }
        fly(ctx, SG_PATH_ELLIPSE);
        steps(&shortest, &longest);
        for (int i = 0; i < FRAMES; i++) {
            double c[3];
            sg_camera_centre(&frames[i], c);
            assert_float_equal(c[down ? 2 : 1], down ? 9 : -8, 0.5);
            assert_true(fabs(c[0]) < 4);
            assert_true(down ? frames[i].R[8] < -0.7 : frames[i].R[7] > 0.7);
        }
    }
}

static void test_interpolate(void **state)
{
    sg_ctx *ctx = *state;
    enum { BETWEEN = 4, N = 12, ALL = (N - 1) * BETWEEN + 1 };
    struct sg_camera path[ALL];
    for (int i = 0; i < N; i++) {
        double at[3], from[3], up[3];
        for (int k = 0; k < 3; k++) {
            at[k] = random_between(-1, 1, 100 + 9 * (uint64_t) i + (uint64_t) k);
            from[k] = random_between(-5, 5, 103 + 9 * (uint64_t) i + (uint64_t) k);
            up[k] = random_between(-1, 1, 106 + 9 * (uint64_t) i + (uint64_t) k);
        }
        cameras[i] = looking(from, at, up);
    }
    assert_int_equal(sg_camera_path(ctx, SG_PATH_INTERPOLATE, cameras, N, ALL, path), SG_OK);
    double centre[N][3];
    for (int i = 0; i < N; i++)
        sg_camera_centre(&cameras[i], centre[i]);
    for (int i = 0; i < ALL; i++) {
        double determinant;
        assert_true(sg_rotation_error(path[i].R, &determinant) < 1e-9 && determinant > 0);
        const struct sg_camera *key = &cameras[i / BETWEEN];
        double a[3], b[3];
        sg_camera_centre(&path[i], a);
        sg_camera_centre(key, b);
        for (int k = 0; k < 9 && i % BETWEEN == 0; k++)
            assert_float_equal(path[i].R[k], key->R[k], 1e-9);
        for (int k = 0; k < 3 && i % BETWEEN == 0; k++)
            assert_float_equal(a[k], b[k], 1e-9);
        /* Half way the uniform spline of Catmull and Rom has the weights -1, 9, 9, -1 over 16; the
         * first and the last key are their own neighbours. */
        const int k1 = i / BETWEEN, k0 = k1 > 0 ? k1 - 1 : 0, k3 = k1 + 2 < N ? k1 + 2 : N - 1;
        for (int k = 0; k < 3 && i % BETWEEN == BETWEEN / 2; k++)
            assert_float_equal(
                a[k],
                (9 * (centre[k1][k] + centre[k1 + 1][k]) - centre[k0][k] - centre[k3][k]) / 16,
                1e-9);
    }
    /* Half a turn in steps, of which the quaternions change their sign on the way. */
    for (int i = 0; i < CAMERAS; i++) {
        const double a = 3 * M_PI * i / CAMERAS;
        cameras[i] = looking((double[3]){0, 0, 0}, (double[3]){cos(a), sin(a), 0}, above);
    }
    fly(ctx, SG_PATH_INTERPOLATE);
    for (int i = 1; i < FRAMES; i++)
        assert_true(dot(frames[i].R + 6, frames[i - 1].R + 6) > 0.98);
    assert_int_equal(sg_camera_path(ctx, SG_PATH_INTERPOLATE, cameras, 1, 3, frames), SG_OK);
    for (int k = 0; k < 9; k++)
        assert_float_equal(frames[2].R[k], cameras[0].R[k], 1e-12);
    assert_int_equal(sg_camera_path(ctx, SG_PATH_INTERPOLATE, cameras, 5, 1, frames), SG_OK);
    assert_float_equal(frames[0].R[6], cameras[0].R[6], 1e-12);
}

static void refused(sg_ctx *ctx, enum sg_path_kind kind, size_t n, size_t count, int code,
                    const char *why)
{
    assert_int_equal(sg_camera_path(ctx, kind, cameras, n, count, frames), code);
    if (!strstr(sg_last_error(ctx), why))
        fail_msg("found \"%s\", expected \"%s\"", sg_last_error(ctx), why);
    assert_int_equal(sg_mem_current(ctx, SG_MEM_TAGS), 0);
}

static void test_refused(void **state)
{
    sg_ctx *ctx = *state;
    for (int i = 0; i < CAMERAS; i++)
        cameras[i] = looking((double[3]){5, 0, 1}, (double[3]){0, i, 0}, above);
    refused(ctx, SG_PATH_ELLIPSE, CAMERAS, FRAMES, SG_ERR_INPUT, "all at one place");
    refused(ctx, SG_PATH_ELLIPSE, 1, FRAMES, SG_ERR_INPUT, "all at one place");
    refused(ctx, SG_PATH_ELLIPSE, 0, FRAMES, SG_ERR_USAGE, "0 cameras");
    refused(ctx, SG_PATH_ELLIPSE, CAMERAS, 0, SG_ERR_USAGE, "0 frames");
    refused(ctx, (enum sg_path_kind) 2, CAMERAS, FRAMES, SG_ERR_USAGE, "kind 2");
    double *const numbers[] = {&cameras[3].t[1], &cameras[3].R[4], &cameras[3].fx, &cameras[3].cy};
    for (size_t k = 0; k < sizeof(numbers) / sizeof(*numbers); k++) {
        const double kept = *numbers[k];
        *numbers[k] = k % 2 ? (double) NAN : (double) INFINITY;
        refused(ctx, SG_PATH_INTERPOLATE, CAMERAS, FRAMES, SG_ERR_USAGE, "camera 3");
        *numbers[k] = kept;
    }
    for (int k = 0; k < 3; k++) /* a mirror */
        cameras[3].R[k] *= -1;
    refused(ctx, SG_PATH_INTERPOLATE, CAMERAS, FRAMES, SG_ERR_USAGE, "camera 3");
}

static int set_up(void **state)
{
    return sg_ctx_create((sg_ctx **) state, NULL);
}

static int tear_down(void **state)
{
    sg_ctx_destroy((sg_ctx **) state);
    return 0;
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_around),  cmocka_unit_test(test_line),
        cmocka_unit_test(test_one_way), cmocka_unit_test(test_interpolate),
        cmocka_unit_test(test_refused),
    };
    return cmocka_run_group_tests(tests, set_up, tear_down);
}
