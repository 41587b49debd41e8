/* SPDX-License-Identifier: Apache-2.0 */
/* The anisotropy loss of views of any size, on every engine and variant: sides with small and with
 * large prime factors, sides that are continued, and lines that need more room than others. */
#include "operations.h"

#define SIZES 5

/* An engine is given the same parameters in all calls. */
struct spectrum_case {
    struct sg_anisotropy_params params;
    bool masked;
    struct {
        int width, height;
    } sizes[SIZES];
};

#define MOST 9000 /* pixels */

static double anisotropy_of(struct sg_engine *e, const struct sg_model *m,
                            const struct spectrum_case *c, int width, int height)
{
    static uint8_t photo[3 * MOST], mask[MOST];
    struct sg_camera camera = make_camera(width, height, 3);
    const struct sg_loss losses[] = {
        {SG_LOSS_PHOTOMETRIC, 1, {.photometric = {.lambda_dssim = 0.2f}}},
        {SG_LOSS_ANISOTROPY, 40, {.anisotropy = c->params}},
    };
    struct sg_target target = {0};
    assert_true(width * height <= MOST);
    /* With a long lens the gradients of what is large beside a strip cancel. */
    camera.fx = 0.9 * sqrt(width * height) + 5, camera.fy = 0.9 * sqrt(width * height) + 9;
    /* The last column and row have the gradients of all that continues them. */
    camera.cx = width - 3, camera.cy = height - 3;
    for (int i = 0; i < 3 * width * height; i++) {
        photo[i] = (uint8_t) draw(14, (size_t) i, 0, 255.9f);
        mask[i / 3] = i / 3 % 5 ? 255 : 0;
    }
    assert_int_equal(
        sg_engine_photo_add(e, width, height, photo, c->masked ? mask : NULL, &target.photo),
        SG_OK);
    return step_against(e, m, &camera, &target, losses, 2).loss[SG_LOSS_ANISOTROPY];
}

/* The oracle's value and gradients; the same bytes the second time. */
static void test_sizes(void **state)
{
    (void) state;
    static const struct spectrum_case of[] = {
        /* 263 is continued to 264 or 266. Engines keep the transforms of four sizes. */
        {{SG_ANISOTROPY_DEFAULTS}, true, {{64, 48}, {263, 30}, {30, 263}, {2060, 3}, {90, 50}}},
        {{SG_ANISOTROPY_DEFAULTS, .energy = SG_ENERGY_AMPLITUDE}, false, {{45, 14}}},
        {{SG_ANISOTROPY_DEFAULTS, .channels = SG_CHANNELS_LUMA}, true, {{101, 37}}}, /* a chirp */
        {{SG_ANISOTROPY_DEFAULTS, .exact_size = true}, false, {{1021, 4}}}, /* one of 2048 points */
    };
    sg_ctx *ctx = make_context(2);
    struct sg_model *m = make_model(ctx, GAUSSIANS, DEGREE, 43);
    for (size_t c = 0; c < sizeof(of) / sizeof(of[0]); c++) {
        struct sg_model *right[SIZES] = {0};
        double expected[SIZES] = {0};
        for (int k = case_count - 1; k >= 0; k--) { /* the oracle is the last */
            struct sg_engine *e = begin(ctx, k, m, NULL);
            for (int i = 0; i < SIZES && of[c].sizes[i].width; i++) {
                const int width = of[c].sizes[i].width, height = of[c].sizes[i].height;
                const double found = anisotropy_of(e, m, &of[c], width, height);
                struct sg_model *g = gradients_of(ctx, e, m);
                const double again = anisotropy_of(e, m, &of[c], width, height);
                struct sg_model *h = gradients_of(ctx, e, m);
                assert_true(found == again);
                assert_memory_equal(g->params, h->params, values_of(g) * sizeof(float));
                sg_model_destroy(&h);
                if (!right[i]) {
                    expected[i] = found, right[i] = g;
                    continue;
                }
                if (!(fabs(found - expected[i]) < 2e-5 * expected[i]))
                    fail_msg("%s: %d x %d: found %g, expected %g", case_name(cases[k]), width,
                             height, found, expected[i]);
                assert_gradients(case_name(cases[k]), "gradient with anisotropy", g, right[i],
                                 1e-4);
                sg_model_destroy(&g);
            }
            sg_engine_destroy(&e);
        }
        for (int i = 0; i < SIZES; i++)
            sg_model_destroy(&right[i]);
    }
    sg_model_destroy(&m);
    sg_ctx_destroy(&ctx);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_sizes),
    };
    return cmocka_run_group_tests(tests, find_cases, NULL);
}
