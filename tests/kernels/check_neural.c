/* SPDX-License-Identifier: Apache-2.0 */
/* The networks of Scaffold-GS against the oracle in double precision. */
#include "math/real_f64.h"

#include "screen.h"

#include "engine/ref/ref_neural.h"
#include "engine/scaffold/neural.h"

struct fixture {
    struct sg_weights weights;
    struct sg_anchor_block block;
    sg_drawn_block gradient;
    struct sg_neural_args args;
};

static struct fixture *make_fixture(unsigned parts)
{
    struct fixture *f = must(1, sizeof(*f));
    memset(f, 0, sizeof(*f));
    float *w = (float *) &f->weights, *g = (float *) f->gradient;
    for (size_t i = 0; i < SG_WEIGHTS; i++)
        w[i] = draw(91, i, -0.25f, 0.25f);
    for (int h = 0; h < SG_HIDDEN; h++) /* of inputs that are larger than the others */
        f->weights.distance[h] /= 8;
    for (size_t i = 0; i < sizeof(f->gradient) / sizeof(*g); i++)
        g[i] = draw(92, i, -1, 1);
    for (int k = 0; parts && k < SG_ANCHOR_GAUSSIANS; k++) /* large where an opacity is near 0 */
        for (int lane = 0; lane < SG_LANES; lane++)
            f->gradient[k][SG_P_OPACITY][lane] /= 50;
    for (size_t lane = 0; lane < SG_LANES; lane++) {
        for (size_t k = 0; k < 3; k++) {
            f->block.position[k][lane] = draw(93, 3 * lane + k, -1, 1);
            f->block.reach[k][lane] = draw(94, 3 * lane + k, -5, -1);
        }
        for (size_t p = 0; p < SG_A_PLANES; p++)
            f->block.anchor[p][lane] =
                draw(95, SG_A_PLANES * lane + p, -2, p < SG_A_SIZE ? 2.0f : 0.0f);
    }
    f->args = (struct sg_neural_args){
        .weights = &f->weights, .centre = {0.3f, -2, 4}, .parts = parts, .volume = 0.02f};
    return f;
}

/* A fixture in which some Gaussians exist in no lane. */
static struct fixture *make_sparse(unsigned parts)
{
    struct fixture *f = make_fixture(parts);
    for (int k = 7; k < SG_ANCHOR_GAUSSIANS; k++)
        f->weights.bias[SG_O_OPACITY + k] = -100;
    return f;
}

/* What the oracle makes of a lane. */
struct expected {
    double drawn[SG_ANCHOR_GAUSSIANS][SG_NEURAL_PLANES];
    bool exists[SG_ANCHOR_GAUSSIANS];
    struct ref_anchor gradient;
};

static void expect(const struct fixture *f, struct expected out[SG_LANES], struct ref_weights *sum)
{
    static struct ref_weights w;
    const float *from = (const float *) &f->weights;
    double *to = (double *) &w;
    const float *centre = f->args.centre;
    const struct ref_view view = {
        {(double) centre[0], (double) centre[1], (double) centre[2]}, f->args.parts, {0}};
    for (size_t i = 0; i < SG_WEIGHTS; i++)
        to[i] = (double) from[i];
    memset(sum, 0, sizeof(*sum));
    for (int lane = 0; lane < SG_LANES; lane++) {
        struct ref_anchor a;
        double gradient[SG_ANCHOR_GAUSSIANS][SG_NEURAL_PLANES];
        for (int k = 0; k < 3; k++) {
            a.position[k] = (double) f->block.position[k][lane];
            a.reach[k] = (double) f->block.reach[k][lane];
        }
        for (int p = 0; p < SG_A_PLANES; p++)
            a.anchor[p] = (double) f->block.anchor[p][lane];
        for (int k = 0; k < SG_ANCHOR_GAUSSIANS; k++)
            for (int p = 0; p < SG_NEURAL_PLANES; p++)
                gradient[k][p] = (double) f->gradient[k][p][lane];
        ref_neural_forward(&w, &a, &view, out[lane].drawn, out[lane].exists);
        ref_neural_backward(&w, &a, &view, gradient, (double) f->args.volume, &out[lane].gradient,
                            sum, NULL);
    }
}

static void check_forward_of(const struct cpu_kernels *k, unsigned parts)
{
    struct fixture *f = make_sparse(parts);
    static struct expected expected[SG_LANES];
    static struct ref_weights sum;
    sg_drawn_block drawn;
    size_t exist = 0;
    expect(f, expected, &sum);
    k->neural(&f->args, &f->block, drawn);
    for (int lane = 0; lane < SG_LANES; lane++)
        for (int g = 0; g < SG_ANCHOR_GAUSSIANS; g++)
            for (int p = 0; p < SG_DRAWN_PLANES; p++) {
                const double found = (double) drawn[g][p][lane], want = expected[lane].drawn[g][p];
                if (p == SG_P_OPACITY && expected[lane].exists[g] != (found > -INFINITY))
                    fail_msg("%s: lane %d, Gaussian %d: opacity %g, expected %g", k->name, lane, g,
                             found, want);
                if (!expected[lane].exists[g])
                    continue;
                exist += p == 0;
                if (!(fabs(found - want) < 1e-4 + 2e-5 * fabs(want)))
                    fail_msg("%s: lane %d, Gaussian %d, plane %d: found %g, expected %g", k->name,
                             lane, g, p, found, want);
            }
    assert_true(exist >= 20 && exist <= SG_LANES * SG_ANCHOR_GAUSSIANS - 20);
    free(f);
}

#define ALL_PARTS (SG_PART_DISTANCE | SG_PART_BANK)

static void check_forward(const struct cpu_kernels *k)
{
    check_forward_of(k, 0);
    check_forward_of(k, ALL_PARTS);
}

/* A relative error for each value would be too much to ask where terms cancel. */
static void compare(const char *name, const char *what, const double *found, const double *want,
                    size_t n)
{
    double most = 0;
    for (size_t i = 0; i < n; i++)
        most = fmax(most, fabs(want[i]));
    assert_close(name, what, found, want, n, 3e-5 * most, 1e-4, 0);
}

/* Of optional parts; `found` has every sum twice. */
static void compare_parts(const char *name, const struct sg_weight_sums *found,
                          const struct ref_weights *want)
{
    double a[SG_HIDDEN], bias[SG_BANK_OUTPUTS] = {0};
    for (int h = 0; h < SG_HIDDEN; h++)
        a[h] = (double) found->distance[h] / 2;
    compare(name, "distance", a, want->distance, SG_HIDDEN);
    for (int i = 0; i <= SG_BANK_INPUTS; i++) {
        for (int h = 0; h < SG_NETWORK_HIDDEN; h++)
            a[h] = (double) found->bank_input[i][h] / 2;
        compare(name, "feature bank, inputs", a, want->bank_input[i], SG_NETWORK_HIDDEN);
    }
    for (int j = 0; j < SG_BANK_OUTPUTS; j++) {
        for (int h = 0; h < SG_NETWORK_HIDDEN; h++)
            a[h] = (double) found->bank_output[j][h] / 2;
        compare(name, "feature bank, outputs", a, want->bank_output[j], SG_NETWORK_HIDDEN);
        for (int lane = 0; lane < SG_LANES; lane++)
            bias[j] += (double) found->bank_bias[j][lane] / 2;
    }
    compare(name, "feature bank, biases", bias, want->bank_bias, SG_BANK_OUTPUTS);
}

static void check_backward_of(const struct cpu_kernels *k, unsigned parts)
{
    struct fixture *f = make_sparse(parts);
    static struct expected expected[SG_LANES];
    static struct ref_weights sum;
    static struct sg_weight_sums sums;
    struct sg_anchor_gradient out;
    double found[SG_LANES], want[SG_LANES];
    static double weights[2][SG_WEIGHTS];
    size_t n = 0;
    expect(f, expected, &sum);
    memset(&sums, 0, sizeof(sums));
    for (int twice = 0; twice < 2; twice++) /* it adds */
        k->neural_backward(&f->args, &f->block, f->gradient, &out, &sums);
    for (int p = 0; p < 3 + SG_A_PLANES; p++) {
        for (int lane = 0; lane < SG_LANES; lane++) {
            const struct ref_anchor *g = &expected[lane].gradient;
            found[lane] = (double) (p < 3 ? out.reach[p][lane] : out.anchor[p - 3][lane]);
            want[lane] = p < 3 ? g->reach[p] : g->anchor[p - 3];
        }
        compare(k->name, "anchor", found, want, SG_LANES);
    }
    for (int i = 0; i <= SG_NETWORK_INPUTS; i++)
        for (int h = 0; h < SG_HIDDEN; h++, n++)
            weights[0][n] = (double) sums.input[i][h] / 2, weights[1][n] = sum.input[i][h];
    compare(k->name, "hidden weights", weights[0], weights[1], n);
    n = 0;
    for (int o = 0; o < SG_OUTPUTS; o++)
        for (int h = 0; h < SG_NETWORK_HIDDEN; h++, n++)
            weights[0][n] = (double) sums.output[o][h] / 2, weights[1][n] = sum.output[o][h];
    compare(k->name, "output weights", weights[0], weights[1], n);
    for (int o = 0; o < SG_OUTPUTS; o++) {
        weights[0][o] = 0, weights[1][o] = sum.bias[o];
        for (int lane = 0; lane < SG_LANES; lane++)
            weights[0][o] += (double) sums.bias[o][lane] / 2;
    }
    compare(k->name, "biases", weights[0], weights[1], SG_OUTPUTS);
    if (parts)
        compare_parts(k->name, &sums, &sum);
    free(f);
}

static void check_backward(const struct cpu_kernels *k)
{
    check_backward_of(k, 0);
    check_backward_of(k, ALL_PARTS);
}

static double bench_forward(const struct cpu_kernels *k)
{
    struct fixture *f = make_fixture(0);
    sg_drawn_block drawn;
    struct timing t = {0};
    while (timing_again(&t))
        for (int i = 0; i < 20; i++)
            (k ? k->neural : sg_ref_neural)(&f->args, &f->block, drawn);
    free(f);
    return timing_result(&t, 20 * SG_LANES);
}

static double bench_backward(const struct cpu_kernels *k)
{
    struct fixture *f = make_fixture(0);
    static struct sg_weight_sums sums;
    struct sg_anchor_gradient out;
    struct timing t = {0};
    while (timing_again(&t))
        for (int i = 0; i < 20; i++)
            (k ? k->neural_backward : sg_ref_neural_backward)(&f->args, &f->block, f->gradient,
                                                              &out, &sums);
    free(f);
    return timing_result(&t, 20 * SG_LANES);
}

/* Items of a column: together, apart, twice, of one block, in no order, nowhere. */
static void check_items(const struct cpu_kernels *k)
{
    enum { PLANES = 7, FIRST = 2, COUNT = 4, BLOCKS = 20 };
    static const uint32_t items[][SG_LANES] = {
        {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15},
        {9, 10, 12, 13, 15, 16, 17, 18, 19, 21, 22, 23, 25, 29, 30, 31},
        {9, 10, 15, 16, 17, 19, 31, 32, 33, 40, 41, 41, 41, 41, 41, 41},
        {0, 19, 35, 50, 70, 95, 96, 115, 130, 149, 165, 180, 200, 220, 239, 319},
        {40, 3, 41, 2, 40, 39, 319, 0, 8, 7, 6, 5, 4, 3, 2, 1},
        {SG_NOWHERE, 33, 34, SG_NOWHERE, 47, SG_NOWHERE, SG_NOWHERE, 48, 49, 50, 51, 52, 53, 54, 55,
         SG_NOWHERE},
        {SG_NOWHERE, SG_NOWHERE, SG_NOWHERE, SG_NOWHERE, SG_NOWHERE, SG_NOWHERE, SG_NOWHERE,
         SG_NOWHERE, SG_NOWHERE, SG_NOWHERE, SG_NOWHERE, SG_NOWHERE, SG_NOWHERE, SG_NOWHERE,
         SG_NOWHERE, SG_NOWHERE}};
    float *column = random_floats(BLOCKS * PLANES * SG_LANES, 96, -1, 1);
    for (size_t i = 0; i < sizeof(items) / sizeof(items[0]); i++) {
        float found[COUNT + 1][SG_LANES], expected[COUNT + 1][SG_LANES];
        memset(found, 3, sizeof(found)), memset(expected, 3, sizeof(expected));
        sg_ref_pick(column, PLANES, FIRST, COUNT, items[i], expected);
        k->pick(column, PLANES, FIRST, COUNT, items[i], found);
        assert_memory_equal(found, expected, sizeof(found));
    }
    free(column);
}

static double bench_items(const struct cpu_kernels *k)
{
    enum { BLOCKS = 64 };
    float *column = random_floats(BLOCKS * SG_A_PLANES * SG_LANES, 96, -1, 1);
    static uint32_t item[BLOCKS * SG_LANES];
    float out[SG_A_PLANES][SG_LANES];
    size_t n = 0;
    for (uint32_t i = 0; i < BLOCKS * SG_LANES; i++)
        if (i % 7)
            item[n++] = i;
    struct timing t = {0};
    while (timing_again(&t))
        for (size_t i = 0; i + SG_LANES <= n; i += SG_LANES)
            (k ? k->pick : sg_ref_pick)(column, SG_A_PLANES, 0, SG_A_PLANES, item + i, out);
    free(column);
    return timing_result(&t, n);
}

const struct kernel_check check_pick = {"pick", "anchor", false, check_items, bench_items};
const struct kernel_check check_neural = {"neural", "anchor", false, check_forward, bench_forward};
const struct kernel_check check_neural_backward = {"neural_backward", "anchor", false,
                                                   check_backward, bench_backward};
