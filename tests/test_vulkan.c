/* SPDX-License-Identifier: Apache-2.0 */
/* Training on a Vulkan device against the CPU engine: SG_TEST_ENGINE names the device. */
#include <unistd.h>

#include "core/vram.h"
#include "training_anchors.h"

static double mean(const double *v, int first, int end)
{
    double sum = 0;
    for (int i = first; i < end; i++)
        sum += v[i];
    return sum / (end - first);
}

/* FNV-1a, continued. */
static uint64_t hash_value(uint64_t hash, const float *value)
{
    uint8_t bytes[sizeof(*value)];
    memcpy(bytes, value, sizeof(bytes));
    for (size_t k = 0; k < sizeof(bytes); k++)
        hash = (hash ^ bytes[k]) * 0x100000001b3u;
    return hash;
}

/* Of a model's values, and of its anchors and networks. */
static uint64_t hash_of(const struct sg_model *m)
{
    uint64_t hash = 0xcbf29ce484222325u;
    const bool anchors = sg_model_has_anchors(m);
    for (size_t i = 0; i < m->count; i++) {
        for (int p = 0; p < sg_param_count(m->sh_degree); p++)
            hash = hash_value(hash, sg_model_at(m, i, p));
        for (int p = 0; p < SG_A_PLANES && anchors; p++)
            hash =
                hash_value(hash, &m->columns->at[SG_C_ANCHOR][sg_param_index(SG_A_PLANES, i, p)]);
    }
    for (size_t i = 0; i < SG_WEIGHTS && anchors; i++)
        hash = hash_value(hash, (const float *) &m->columns->networks->value + i);
    return hash;
}

/* The same losses as the CPU's as long as both make the same decisions, and nearly the same at the
 * end; the same bytes from run to run. Prints a hash, which tests/vulkan.cmake compares. */
static void test_training(void **state)
{
    (void) state;
    struct sg_train_params p = short_params();
    struct fixture f = make_fixture(2);
    double expected[40], found[40];
    struct sg_model *cpu = train(&f, &p, 40, NULL, NULL, expected);
    p.engine = main_engine();
    struct sg_model *one = train(&f, &p, 40, NULL, NULL, found);
    struct sg_model *two = train(&f, &p, 40, NULL, NULL, NULL);
    assert_same(one, two);
    printf("hash of model %016llx\n", (unsigned long long) hash_of(one));
    for (int i = 0; i < 20; i++)
        if (!(fabs(found[i] - expected[i]) < 1e-3 * expected[i]))
            fail_msg("loss %d: found %.9f, expected %.9f", i + 1, found[i], expected[i]);
    assert_float_equal(mean(found, 30, 40), mean(expected, 30, 40), 0.01 * mean(expected, 30, 40));
    assert_true(one->count > f.start->count); /* it did densify */
    assert_true(fabs((double) one->count - (double) cpu->count) < 0.02 * (double) cpu->count + 2);
    sg_model_destroy(&cpu);
    sg_model_destroy(&one);
    sg_model_destroy(&two);
    clear_fixture(&f);
}

/* Mip-Splatting, growth by absolute gradients, a limit that looks at radii on the screen, and mcmc:
 * the same losses as the CPU's as long as both make the same decisions. Prints hashes, as above. */
static void test_variants(void **state)
{
    (void) state;
    for (int k = 0; k < 4; k++) {
        struct sg_train_params p = short_params();
        p.model = k == 0 ? SG_MODEL_MIP : SG_MODEL_3DGS;
        p.absgrad = k == 1;
        p.at_limit = k == 2 ? SG_AT_LIMIT_UNIVERSAL : p.at_limit;
        p.max_gaussians = k == 2 ? 130 : 0;
        p.strategy = k == 3 ? SG_STRATEGY_MCMC : SG_STRATEGY_DEFAULT;
        struct fixture f = make_fixture(2);
        double expected[15], found[15];
        struct sg_model *cpu = train(&f, &p, 15, NULL, NULL, expected);
        p.engine = main_engine();
        struct sg_model *device = train(&f, &p, 15, NULL, NULL, found);
        printf("hash of model %d %016llx\n", k, (unsigned long long) hash_of(device));
        for (int i = 0; i < 15; i++)
            if (!(fabs(found[i] - expected[i]) < (i < 8 ? 1e-3 : 2e-2) * expected[i]))
                fail_msg("variant %d, loss %d: found %.9f, expected %.9f", k, i + 1, found[i],
                         expected[i]);
        assert_true(fabs((double) device->count - (double) cpu->count) <
                    0.02 * (double) cpu->count + 2);
        sg_model_destroy(&cpu);
        sg_model_destroy(&device);
        clear_fixture(&f);
    }
}

/* One format of checkpoints for all engines: a run that begins on the CPU continues on the device,
 * and back. On one engine a resumed run is the same as one that was not interrupted. */
static void test_resume(void **state)
{
    (void) state;
    struct sg_train_params p = short_params(), other = p;
    char path[] = "/tmp/sg_checkpoint_XXXXXX";
    close(mkstemp(path));
    struct fixture f = make_fixture(2);
    double whole[40], resumed[40];
    other.engine = main_engine();
    for (int back = 0; back < 2; back++) {
        struct sg_model *a = train(&f, back ? &other : &p, 40, path, NULL, whole);
        struct sg_model *b = train(&f, back ? &p : &other, 40, NULL, path, resumed);
        assert_true(fabs((double) a->count - (double) b->count) < 0.02 * (double) a->count + 2);
        assert_float_equal(mean(resumed, 30, 40), mean(whole, 30, 40), 0.01 * mean(whole, 30, 40));
        sg_model_destroy(&b);
        if (back) {
            b = train(&f, &other, 40, NULL, path, NULL);
            assert_same(a, b);
            sg_model_destroy(&b);
        }
        sg_model_destroy(&a);
    }
    unlink(path);
    clear_fixture(&f);
}

/* Anchors, to an iteration, from a checkpoint or anew. */
static struct sg_model *train_anchors(struct fixture *f, const struct sg_train_params *p, int until,
                                      const char *load, const char *save, double *losses)
{
    sg_trainer *t;
    struct sg_train_step step;
    struct sg_model *m;
    f->scene.train = f->views;
    if (load ? sg_trainer_resume(f->ctx, &f->scene, load, p, &t)
             : sg_trainer_create(f->ctx, &f->scene, NULL, p, &t))
        fail_msg("%s", sg_last_error(f->ctx));
    while (sg_trainer_iteration(t) < until) {
        assert_int_equal(sg_trainer_step(t, &step), SG_OK);
        losses[step.iteration - 1] = step.loss;
    }
    assert_int_equal(sg_trainer_model(t, &m), SG_OK);
    if (save)
        assert_int_equal(sg_trainer_save(t, save), SG_OK);
    sg_trainer_destroy(&t);
    return m;
}

/* Scaffold-GS, with and without the optional parts of its networks: the same losses as the CPU's as
 * long as both make the same decisions; a run that is cut and resumed has the bytes of one that is
 * not; it goes on from the CPU's checkpoint, and back. Prints hashes, as above. */
static void test_anchors(void **state)
{
    (void) state;
    char path[] = "/tmp/sg_checkpoint_XXXXXX";
    close(mkstemp(path));
    for (int parts = 0; parts < 2; parts++) {
        struct sg_train_params cpu = scaffold_params(), device;
        struct fixture f = make_points(2);
        double expected[24], found[24], resumed[24];
        cpu.scaffold.distance = cpu.scaffold.bank = cpu.scaffold.appearance = parts > 0;
        device = cpu;
        device.engine = main_engine();
        struct sg_model *m[5];
        m[0] = train_anchors(&f, &cpu, 24, NULL, NULL, expected);
        m[1] = train_anchors(&f, &device, 24, NULL, NULL, found);
        m[2] = train_anchors(&f, &device, 14, NULL, path, resumed);
        m[3] = train_anchors(&f, &device, 24, path, NULL, resumed);
        m[4] = train_anchors(&f, &cpu, 16, path, path, resumed);
        assert_same_anchors(m[1], m[3]);
        printf("hash of model anchors %d %016llx\n", parts, (unsigned long long) hash_of(m[1]));
        for (int i = 0; i < 16; i++)
            if (!(fabs(found[i] - expected[i]) < 1e-3 * expected[i]))
                fail_msg("loss %d: found %.9f, expected %.9f", i + 1, found[i], expected[i]);
        assert_true(m[1]->count > m[2]->count); /* it did grow */
        assert_true(fabs((double) m[1]->count - (double) m[0]->count) <
                    0.02 * (double) m[0]->count + 2);
        assert_float_equal(mean(found, 18, 24), mean(expected, 18, 24),
                           0.01 * mean(expected, 18, 24));
        sg_model_destroy(&m[4]);
        m[4] =
            train_anchors(&f, &device, 24, path, NULL, resumed); /* two iterations were the CPU's */
        assert_float_equal(mean(resumed, 18, 24), mean(expected, 18, 24),
                           0.01 * mean(expected, 18, 24));
        for (int i = 0; i < 5; i++)
            sg_model_destroy(&m[i]);
        clear_points(&f);
    }
    unlink(path);
}

/* Stages are timed by the device: known once somebody has waited, and not while clocks are stopped.
 * Without timestamps they are timed by the host, at once; the bytes are the same. */
static void test_clocks(void **state)
{
    (void) state;
    const struct sg_render_params render = {SG_RENDER_DEFAULTS};
    const struct sg_camera camera = make_camera(SIDE, SIDE, 3);
    float images[2][3 * SIDE * SIDE];
    for (int host = 0; host < 2; host++) {
        sg_ctx *ctx = make_context(1);
        struct sg_model *m = make_model(ctx, 500, 1, 3);
        struct sg_engine *e;
        sg_fail_device(ctx, SG_DEVICE_TIMESTAMPS, (uint64_t) host);
        assert_int_equal(sg_engine_create(ctx, main_engine(), NULL, &e), SG_OK);
        assert_true(sg_fail_device(ctx, SG_DEVICE_TIMESTAMPS, 0)); /* it was asked for */
        assert_int_equal(sg_engine_upload(e, m, NULL), SG_OK);
        assert_int_equal(sg_engine_draw(e, &camera, 1, &render, false), SG_OK);
        assert_int_equal(sg_engine_times(e).raster > 0, host);
        assert_int_equal(sg_engine_read_image(e, images[host], NULL, NULL), SG_OK);
        const struct sg_engine_times t = sg_engine_times(e);
        assert_true(t.project > 0 && t.bin > 0 && t.raster > 0);
        assert_true(t.optimise == 0 && t.shape == 0 && t.count == 0);
        sg_engine_stop_clocks(e, true);
        assert_int_equal(sg_engine_draw(e, &camera, 1, &render, false), SG_OK);
        assert_int_equal(sg_engine_read_image(e, images[host], NULL, NULL), SG_OK);
        assert_true(sg_engine_times(e).project == t.project);
        assert_true(sg_engine_times(e).raster == t.raster);
        sg_engine_destroy(&e);
        sg_model_destroy(&m);
        sg_ctx_destroy(&ctx);
    }
    assert_memory_equal(images[0], images[1], sizeof(images[0]));
}

/* Names and numbers that no device has are refused, with what there is to do. */
static void test_choice(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(1);
    struct sg_device_info devices[16];
    struct sg_engine *e;
    const char *missing;
    char name[300];
    const size_t n = sg_device_list(devices, 16, &missing);
    assert_true(n > 0 && !missing);
    assert_int_equal(sg_engine_create(ctx, "vulkan:nonsense", NULL, &e), SG_ERR_USAGE);
    assert_non_null(strstr(sg_last_error(ctx), "no device \"nonsense\""));
    assert_int_equal(sg_engine_create(ctx, "vulkan:99", NULL, &e), SG_ERR_USAGE);
    assert_null(e);
    for (size_t i = 0; i < n; i++) {
        snprintf(name, sizeof(name), "vulkan:%zu", i);
        assert_int_equal(sg_engine_check(ctx, name, NULL),
                         devices[i].missing ? SG_ERR_USAGE : SG_OK);
        assert_true(devices[i].name[0] && devices[i].memory > 0);
    }
    assert_int_equal(sg_mem_current(ctx, SG_MEM_TAGS), 0);
    sg_ctx_destroy(&ctx);
}

int main(void)
{
    if (!getenv("SG_TEST_ENGINE")) {
        printf("skipped: SG_TEST_ENGINE names no device\n");
        return 77;
    }
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_choice),   cmocka_unit_test(test_clocks),
        cmocka_unit_test(test_training), cmocka_unit_test(test_variants),
        cmocka_unit_test(test_resume),   cmocka_unit_test(test_anchors),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
