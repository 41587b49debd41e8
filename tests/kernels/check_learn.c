/* SPDX-License-Identifier: Apache-2.0 */
/* project_backward_optimise and optimise: gradients of the parameters from those of the splats,
 * sums over views, statistics and Adam. */
#include "screen.h"

#include "math/adam.h"
#include "model/columns.h"

#define DEGREE 3

/* A model with the state of its optimiser in memory of the kernels' layout, and slots: of each
 * Gaussian none to three. */
struct state {
    struct screen s;
    size_t values; /* of the model, padding included */
    float *params, *m, *v, *accumulated, *gradients, *slots, *grad_sum, *grad_count;
    uint32_t *slot_start;
    double *expected; /* gradients by the oracle, laid out as params */
    double *norm;     /* of the view-space gradient, or of the absolute ones */
    bool absolute;
};

/* Slots whose sums are the gradient `g` of a splat, cut into n parts. */
static void write_slots(float *slots, size_t n, const double sums[CPU_SLOT_ABSOLUTE])
{
    for (size_t k = 0; k < n; k++)
        for (size_t j = 0; j < CPU_SLOT_ABSOLUTE; j++)
            slots[k * CPU_SLOT_FLOATS + j] = (float) (sums[j] / (double) n);
}

/* absolute: the statistic is of absolute gradients. mip: with the filter of Mip-Splatting. */
static struct state make_state(size_t count, int degree, bool absolute, bool mip)
{
    sg_ctx *ctx = make_context(1);
    struct state o = {.s = make_filtered_screen(ctx, make_model(ctx, count, DEGREE, 60),
                                                make_camera(70, 50, 3), degree, mip),
                      .absolute = absolute};
    const struct screen *s = &o.s;
    const size_t n = s->model->capacity * (size_t) s->planes;
    o.values = n;
    o.params = must(n, sizeof(float));
    memcpy(o.params, s->model->params, n * sizeof(float));
    o.m = random_floats(n, 61, -1, 1), o.v = random_floats(n, 62, 0.01f, 1);
    o.accumulated = random_floats(n, 63, -1, 1), o.gradients = random_floats(n, 64, -1, 1);
    o.grad_sum = random_floats(count, 65, 0, 1), o.grad_count = random_floats(count, 66, 1, 4);
    o.slots = must(3 * count * CPU_SLOT_FLOATS, sizeof(float));
    o.slot_start = must(count + 1, sizeof(*o.slot_start));
    o.expected = calloc(n, sizeof(double)), o.norm = calloc(count + 1, sizeof(double));
    assert_true(o.expected && o.norm);
    size_t slot = 0;
    for (size_t i = 0; i < count; i++) {
        double sums[CPU_SLOT_ABSOLUTE] = {0}, gradient[SG_PARAMS_MAX];
        struct ref_splat *r = &s->splats[i];
        const size_t parts = i % 4;
        o.slot_start[i] = (uint32_t) slot;
        for (size_t j = 0; j < CPU_SLOT_ABSOLUTE; j++)
            sums[j] =
                parts ? (double) draw(67, CPU_SLOT_ABSOLUTE * i + j, j < CPU_SLOT_USED ? -1 : 0, 1)
                      : 0;
        write_slots(o.slots + slot * CPU_SLOT_FLOATS, parts, sums);
        slot += parts;
        if (!r->visible)
            continue;
        r->g = (struct splat_grad){.x = r->s.A * sums[1] + r->s.B * sums[2],
                                   .y = r->s.C * sums[2] + r->s.B * sums[1],
                                   .A = -0.5 * sums[3],
                                   .Bh = -0.5 * sums[4],
                                   .C = -0.5 * sums[5]};
        r->g_o = sums[0] / r->o;
        for (int ch = 0; ch < 3; ch++)
            r->g_rgb[ch] = sums[6 + ch];
        o.norm[i] = hypot((absolute ? sums[9] : r->g.x) * s->view.half_w,
                          (absolute ? sums[10] : r->g.y) * s->view.half_h);
        ref_parameter_gradient(&s->view, r, s->params[i], degree, gradient);
        for (int p = 0; p < s->planes; p++)
            o.expected[sg_param_index(s->planes, i, p)] = gradient[p];
    }
    o.slot_start[count] = (uint32_t) slot;
    return o;
}

static void clear_state(struct state *o)
{
    void *owned[] = {o->params,     o->m,        o->v,        o->accumulated,
                     o->gradients,  o->slots,    o->grad_sum, o->grad_count,
                     o->slot_start, o->expected, o->norm};
    for (size_t i = 0; i < sizeof(owned) / sizeof(owned[0]); i++)
        free(owned[i]);
    clear_screen(&o->s);
}

static struct cpu_learn_args args_of(const struct state *o, const struct sg_update *u)
{
    return (struct cpu_learn_args){.camera = &o->s.camera,
                                   .mip_kernel = o->s.mip ? 0.1f : 0,
                                   .shaped = o->params,
                                   .params = o->params,
                                   .m = o->m,
                                   .v = o->v,
                                   .grad_sum = o->grad_sum,
                                   .grad_count = o->grad_count,
                                   .count = o->s.count,
                                   .planes = o->s.planes,
                                   .degree = o->s.degree,
                                   .splats = o->s.records,
                                   .extents = o->s.extents,
                                   .absolute = o->absolute,
                                   .slots = o->slots,
                                   .slot_start = o->slot_start,
                                   .accumulated = u->accumulate ? o->accumulated : NULL,
                                   .gradients = o->gradients,
                                   .update = u};
}

/* What a kernel must leave. */
struct outcome {
    double *gradients, *accumulated, *params, *m, *v;
};

static double *doubles(const float *from, size_t n)
{
    double *to = must(n, sizeof(double));
    for (size_t i = 0; i < n; i++)
        to[i] = (double) from[i];
    return to;
}

/* Adam on the active planes, with or without what earlier views have left. */
static struct outcome outcome_of(const struct state *o, const struct sg_update *u,
                                 const double *gradients)
{
    struct outcome x = {doubles(o->gradients, o->values), doubles(o->accumulated, o->values),
                        doubles(o->params, o->values), doubles(o->m, o->values),
                        doubles(o->v, o->values)};
    const int active = SG_P_SH + 3 * (o->s.degree + 1) * (o->s.degree + 1);
    for (size_t i = 0; i < o->s.count; i++)
        for (int p = 0; p < active; p++) {
            const size_t at = sg_param_index(o->s.planes, i, p);
            double g = gradients[at];
            if (u->accumulate) {
                g += x.accumulated[at];
                x.accumulated[at] = u->adam ? 0 : g;
            }
            x.gradients[at] = g;
            int column = 0;
            while (p >= sg_column_end(column, o->s.planes))
                column++;
            const enum sg_group group = sg_columns[column].group;
            /* the means of all opacities and of all scales */
            if (p == SG_P_OPACITY)
                g += (double) u->mean_opacity / (double) o->s.count /
                     (2 + exp(x.params[at]) + exp(-x.params[at]));
            else if (p >= SG_P_SCALE && p < SG_P_ROT)
                g += (double) u->mean_scale / (3 * (double) o->s.count) * exp(x.params[at]);
            if (!u->adam || !(u->rate[group] > 0))
                continue;
            const struct adam_state old = {x.params[at], x.m[at], x.v[at]},
                                    new = adam_step(old, g, (double) u->rate[group],
                                                    (double) u->root[group]);
            x.params[at] = new.p, x.m[at] = new.m, x.v[at] = new.v;
        }
    return x;
}

/* The values of the Gaussians that exist, plane by plane: gradients of a plane are of one size. */
static void compare(const struct cpu_kernels *k, const struct state *o, const char *what,
                    const float *found, const double *expected, double tolerance)
{
    const size_t n = o->s.count;
    double *a = must(n, sizeof(double)), *b = must(n, sizeof(double));
    for (int p = 0; p < o->s.planes; p++) {
        double largest = 0;
        char name[64];
        for (size_t i = 0; i < n; i++) {
            const size_t at = sg_param_index(o->s.planes, i, p);
            a[i] = (double) found[at], b[i] = expected[at];
            largest = fmax(largest, fabs(b[i]));
        }
        snprintf(name, sizeof(name), "%s of plane %d, degree %d", what, p, o->s.degree);
        assert_close(k->name, name, a, b, n, tolerance * largest + 1e-12, tolerance, 0);
    }
    free(a);
    free(b);
}

/* tolerance: of the gradients, relative. */
static void compare_all(const struct cpu_kernels *k, const struct state *o,
                        const struct sg_update *u, struct outcome *x, bool stored, double tolerance)
{
    if (stored)
        compare(k, o, "gradient", o->gradients, x->gradients, tolerance);
    if (u->accumulate)
        compare(k, o, "sum of gradients", o->accumulated, x->accumulated, tolerance);
    compare(k, o, "parameter", o->params, x->params, fmax(1e-5, tolerance / 10));
    compare(k, o, "first moment", o->m, x->m, fmax(1e-6, tolerance));
    compare(k, o, "second moment", o->v, x->v, fmax(1e-6, tolerance));
    void *owned[] = {x->gradients, x->accumulated, x->params, x->m, x->v};
    for (size_t i = 0; i < sizeof(owned) / sizeof(owned[0]); i++)
        free(owned[i]);
}

/* Step k of 4: nothing but gradients, with Adam, summed, summed and Adam with
 * the weights of mean opacity and scale. The second holds a group. */
static struct sg_update update_of(int k)
{
    struct sg_update u = {.adam = k & 1, .accumulate = k & 2, .statistics = k == 1};
    if (k == 3)
        u.mean_opacity = 5, u.mean_scale = 70;
    for (int g = 0; g < SG_GROUPS; g++)
        u.rate[g] = k == 1 && g == SG_G_SCALE ? 0 : 0.001f * (float) (g + 1), u.root[g] = 3;
    return u;
}

static const size_t counts[] = {1, 16, 37, 200};
#define COUNTS (sizeof(counts) / sizeof(counts[0]))

typedef void (*learn_kernel)(const struct cpu_learn_args *, size_t, size_t);

static learn_kernel both_by(const struct cpu_kernels *k, bool mip)
{
    return mip ? k->project_backward_optimise_mip : k->project_backward_optimise;
}

static void compare_both_by(const struct cpu_kernels *k, bool mip)
{
    for (size_t c = 0; c < COUNTS; c++)
        for (int step = 0; step < 32; step++) {
            struct state o = make_state(counts[c], step / 8, step / 4 % 2, mip);
            const struct sg_update u = update_of(step % 4);
            struct outcome x = outcome_of(&o, &u, o.expected);
            const struct cpu_learn_args a = args_of(&o, &u);
            float *sum = must(counts[c], sizeof(float)), *number = must(counts[c], sizeof(float));
            memcpy(sum, o.grad_sum, counts[c] * sizeof(float));
            memcpy(number, o.grad_count, counts[c] * sizeof(float));
            const size_t blocks = (counts[c] + SG_LANES - 1) / SG_LANES;
            both_by(k, mip)(&a, blocks / 2, blocks);
            both_by(k, mip)(&a, 0, blocks / 2);
            compare_all(k, &o, &u, &x, true, 2e-3);
            for (size_t i = 0; i < counts[c]; i++) {
                const bool counted = u.statistics && o.s.splats[i].visible;
                const double expected = (double) sum[i] + (counted ? o.norm[i] : 0);
                if (o.grad_count[i] != number[i] + (counted ? 1 : 0) ||
                    !(fabs((double) o.grad_sum[i] - expected) <= 1e-4 * (1 + expected)))
                    fail_msg("%s: statistics of Gaussian %zu: found %g, expected %g", k->name, i,
                             (double) o.grad_sum[i], expected);
            }
            free(sum);
            free(number);
            clear_state(&o);
        }
}

static void compare_both(const struct cpu_kernels *k)
{
    compare_both_by(k, false);
}

static void compare_both_mip(const struct cpu_kernels *k)
{
    compare_both_by(k, true);
}

static void compare_optimise(const struct cpu_kernels *k)
{
    for (size_t c = 0; c < COUNTS; c++)
        for (int step = 0; step < 16; step++) {
            struct state o = make_state(counts[c], step / 4, false, false);
            const struct sg_update u = update_of(step % 4);
            double *gradients = doubles(o.gradients, o.values);
            struct outcome x = outcome_of(&o, &u, gradients);
            const struct cpu_learn_args a = args_of(&o, &u);
            const size_t blocks = (counts[c] + SG_LANES - 1) / SG_LANES;
            k->optimise(&a, blocks / 2, blocks);
            k->optimise(&a, 0, blocks / 2);
            compare_all(k, &o, &u, &x, false, 1e-6);
            free(gradients);
            clear_state(&o);
        }
}

#define BENCH 4096

static double bench_both_by(const struct cpu_kernels *k, bool mip)
{
    struct state o = make_state(BENCH, DEGREE, false, mip);
    const struct sg_update u = update_of(1);
    const struct cpu_learn_args a = args_of(&o, &u);
    struct timing t = {0};
    double gradient[SG_PARAMS_MAX];
    struct adam_state adam = {0};
    volatile double sink = 0;
    while (timing_again(&t))
        if (k)
            both_by(k, mip)(&a, 0, BENCH / SG_LANES);
        else
            for (size_t i = 0; i < BENCH; i++) {
                struct ref_splat *r = &o.s.splats[i];
                ref_project(&o.s.view, o.s.params[i], DEGREE, o.s.grid_x, o.s.grid_y, r);
                ref_parameter_gradient(&o.s.view, r, o.s.params[i], DEGREE, gradient);
                for (int p = 0; p < o.s.planes; p++)
                    adam = adam_step(adam, gradient[p], 1e-3, 3), sink = adam.p;
            }
    (void) sink;
    clear_state(&o);
    return timing_result(&t, BENCH);
}

static double bench_both(const struct cpu_kernels *k)
{
    return bench_both_by(k, false);
}

static double bench_both_mip(const struct cpu_kernels *k)
{
    return bench_both_by(k, true);
}

static double bench_optimise(const struct cpu_kernels *k)
{
    struct state o = make_state(BENCH, DEGREE, false, false);
    const struct sg_update u = update_of(1);
    const struct cpu_learn_args a = args_of(&o, &u);
    struct timing t = {0};
    volatile double sink = 0;
    while (timing_again(&t))
        if (k)
            k->optimise(&a, 0, BENCH / SG_LANES);
        else
            for (size_t i = 0; i < o.values; i++) {
                const struct adam_state old = {(double) o.params[i], (double) o.m[i],
                                               (double) o.v[i]};
                sink = adam_step(old, (double) o.gradients[i], 1e-3, 3).p;
            }
    (void) sink;
    clear_state(&o);
    return timing_result(&t, BENCH);
}

const struct kernel_check check_project_backward_optimise = {
    "project_backward_optimise", "Gaussian", false, compare_both, bench_both};
const struct kernel_check check_optimise = {"optimise", "Gaussian", false, compare_optimise,
                                            bench_optimise};
const struct kernel_check check_project_backward_optimise_mip = {
    "project_backward_optimise_mip", "Gaussian", false, compare_both_mip, bench_both_mip};
