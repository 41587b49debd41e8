/* SPDX-License-Identifier: Apache-2.0 */
/* The amplitude of noise in a photo, from its difference to a render. */
#include <math.h>

#include "scene_files.h"

#include "defense/residual.h"

#define W 96
#define H 80

enum noise { NONE, TWO_VALUES, EVEN, NORMAL };

struct picture {
    uint8_t photo[W * H * 3], mask[W * H];
    float render[3 * W * H];
};

static double draw(uint32_t *state)
{
    *state = *state * 1664525 + 1013904223;
    return (double) (*state >> 8) / (1 << 24);
}

/* A smooth scene, its photo with noise of an amplitude in grey levels. */
static struct picture *make(enum noise noise, double amplitude)
{
    struct picture *p = test_malloc(sizeof(*p));
    uint32_t random = 7;
    for (int i = 0; i < W * H; i++)
        for (int c = 0; c < 3; c++) {
            const double truth = 128 + 60 * sin(i % W / 15.0 + c) * cos(i / W / 20.0);
            const double u = draw(&random), v = draw(&random);
            const double n = noise == TWO_VALUES ? (u < 0.5 ? -1 : 1)
                             : noise == EVEN     ? 2 * u - 1
                             : noise == NORMAL   ? sqrt(-2 * log(u + 1e-9)) * cos(6.2831853 * v)
                                                 : 0;
            p->photo[3 * i + c] = (uint8_t) lrint(fmin(fmax(truth + amplitude * n, 0), 255));
            p->render[c * W * H + i] = (float) (truth / 255);
        }
    memset(p->mask, 255, sizeof(p->mask));
    return p;
}

static struct sg_residual measure(struct fixture *f, const struct picture *p)
{
    struct sg_residual r;
    assert_int_equal(sg_residual_measure(f->ctx, p->photo, p->mask, p->render, W, H, &r), SG_OK);
    return r;
}

static void bounded_noise(void **state)
{
    const double amplitudes[] = {8, 16, 24};
    for (int i = 0; i < 3; i++)
        for (enum noise noise = TWO_VALUES; noise <= EVEN; noise++) {
            struct picture *p = make(noise, amplitudes[i]);
            const struct sg_residual r = measure(*state, p);
            assert_int_equal(r.blocks, W / 8 * (H / 8) / 10);
            assert_true(r.level > 0.75 * amplitudes[i] && r.level < 1.25 * amplitudes[i]);
            assert_true(r.kurtosis < 2.5);
            test_free(p);
        }
    struct picture *p = make(NORMAL, 6);
    assert_true(measure(*state, p).kurtosis > 2.6);
    test_free(p);
}

static void photos_without_noise(void **state)
{
    struct picture *p = make(NONE, 0);
    assert_true(measure(*state, p).level < 1); /* rounding */
    test_free(p);
}

/* Texture that the model has not learned is in the difference too, but not in its quietest tenth.
 */
static void texture_does_not_count(void **state)
{
    struct picture *p = make(NONE, 0);
    for (int i = 0; i < W * H; i++)
        for (int c = 0; i / W >= H / 5 && c < 3; c++)
            p->photo[3 * i + c] =
                (uint8_t) (p->photo[3 * i + c] + ((i / 2 + i / W) % 2 ? 30 : -30));
    assert_true(measure(*state, p).level < 1);
    test_free(p);
}

static void pixels_that_do_not_count(void **state)
{
    struct picture *p = make(TWO_VALUES, 16);
    for (int i = 0; i < W * H; i++) { /* the noise is where the mask is 0, or on black, or white */
        const int third = i % W / (W / 4);
        p->mask[i] = third != 0;
        for (int c = 0; c < 3; c++) {
            float *r = &p->render[c * W * H + i];
            *r = third == 1 ? 0 : third == 2 ? 1 : *r;
            if (third == 3)
                p->photo[3 * i + c] = (uint8_t) lrintf(255 * *r);
        }
    }
    assert_int_equal(measure(*state, p).blocks, 0); /* 30 whole blocks are too few */
    test_free(p);
}

enum ground { BLACK, WHITE };

/* A picture whose right half is black or white in the render; the photo has noise everywhere. */
static struct picture *make_ground(enum noise noise, double amplitude, enum ground ground)
{
    struct picture *p = make(noise, amplitude);
    for (int i = 0; i < W * H; i++)
        for (int c = 0; i % W >= W / 2 && c < 3; c++) {
            const int change = p->photo[3 * i + c] - (int) lrintf(255 * p->render[c * W * H + i]);
            const int value = ground == BLACK ? change : 255 + change;
            p->photo[3 * i + c] = (uint8_t) (value < 0 ? 0 : value > 255 ? 255 : value);
            p->render[c * W * H + i] = ground == BLACK ? 0.01f : 1;
        }
    return p;
}

static double bound(void **state, struct picture *p)
{
    struct fixture *f = *state;
    double bound;
    assert_int_equal(sg_residual_bound(f->ctx, p->photo, p->mask, p->render, W, H, &bound), SG_OK);
    test_free(p);
    return bound;
}

static void bound_on_black_and_white(void **state)
{
    for (enum ground ground = BLACK; ground <= WHITE; ground++) {
        for (int amplitude = 3; amplitude <= 24; amplitude += 7) {
            assert_true(bound(state, make_ground(TWO_VALUES, amplitude, ground)) == amplitude);
            assert_true(bound(state, make_ground(EVEN, amplitude, ground)) == amplitude);
        }
        assert_true(bound(state, make_ground(NONE, 0, ground)) == 0);
        assert_true(bound(state, make_ground(TWO_VALUES, 2, ground)) == 0);
        assert_true(bound(state, make_ground(NORMAL, 8, ground)) == 0); /* none is sharp */
        struct picture *p = make_ground(NONE, 0, ground); /* a little grey everywhere */
        for (int i = 0; i < 3 * W * H; i++)
            p->photo[i] =
                (uint8_t) (ground == BLACK ? fmax(p->photo[i], 4) : fmin(p->photo[i], 251));
        assert_true(bound(state, p) == 0);
    }
    assert_true(bound(state, make(TWO_VALUES, 16)) == 0);
}

/* Pixels next to others, what masks leave out and small areas show no bound. */
static void bound_needs_even_ground(void **state)
{
    for (int which = 0; which < 5; which++) {
        struct picture *p = make_ground(TWO_VALUES, 16, BLACK);
        for (int i = 0; i < W * H; i++) {
            const int x = i % W, y = i / W;
            if (which == 0 && x >= W / 2 && x < W / 2 + 3) /* the edge of the object */
                p->photo[3 * i] = 200;
            else if (which == 1 && x >= 3 * W / 4)
                p->mask[i] = 0, p->photo[3 * i] = 200;
            else if (which == 2) /* 20 x 19 pixels */
                p->mask[i] = x >= W - 20 && y < 19;
            else if (which == 3 && x >= W / 2 && x % 7 == 0) /* stripes */
                p->render[W * H + i] = 0.5f;
            else if (which == 4 && x >= W - 10) /* detail that the model does not have yet */
                p->photo[3 * i] = (uint8_t) (7 * (y % 30));
        }
        assert_true(bound(state, p) == (which < 2 ? 16 : 0));
    }
}

static void hostile_sizes_and_values(void **state)
{
    struct fixture *f = *state;
    struct sg_residual r;
    const uint8_t photo[3 * 7] = {0};
    const float render[3 * 7] = {NAN, INFINITY, -INFINITY};
    double none = 1;
    assert_int_equal(sg_residual_measure(f->ctx, photo, NULL, render, 7, 1, &r), SG_OK);
    assert_int_equal(r.blocks, 0);
    assert_int_equal(sg_residual_bound(f->ctx, photo, NULL, render, 7, 1, &none), SG_OK);
    assert_true(none == 0);
    struct picture *p = make(TWO_VALUES, 16);
    p->render[0] = NAN;
    p->render[W * H / 2] = INFINITY;
    r = measure(f, p);
    assert_true(r.blocks > 0 && isfinite(r.level) && isfinite(r.kurtosis));
    test_free(p);
    p = make_ground(TWO_VALUES, 16, BLACK);
    for (int i = 0; i < 3 * W * H; i++)
        p->render[i] = p->render[i] < 0.1f ? NAN : p->render[i];
    assert_true(bound(state, p) == 0);
}

static void out_of_memory(void **state)
{
    (void) state;
    struct picture *p = make(EVEN, 16);
    struct sg_residual r;
    double bound;
    int code = SG_ERR_BUDGET;
    for (uint64_t limit = 1000; code == SG_ERR_BUDGET; limit += 20000) {
        sg_ctx *ctx;
        assert_int_equal(
            sg_ctx_create(&ctx, &(struct sg_ctx_params){.threads = 1, .max_memory = limit}), SG_OK);
        assert_int_equal(sg_residual_bound(ctx, p->photo, NULL, p->render, W, H, &bound),
                         limit < W * H ? SG_ERR_BUDGET : SG_OK);
        code = sg_residual_measure(ctx, p->photo, NULL, p->render, W, H, &r);
        assert_int_equal(sg_mem_current(ctx, SG_MEM_TAGS), 0);
        sg_ctx_destroy(&ctx);
    }
    assert_int_equal(code, SG_OK);
    test_free(p);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        scene_test(bounded_noise),
        scene_test(photos_without_noise),
        scene_test(texture_does_not_count),
        scene_test(pixels_that_do_not_count),
        scene_test(bound_on_black_and_white),
        scene_test(bound_needs_even_ground),
        scene_test(hostile_sizes_and_values),
        scene_test(out_of_memory),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
