/* SPDX-License-Identifier: Apache-2.0 */
/* A device whose memory is limited. SG_TEST_ENGINE names the device. */
#include <unistd.h>

#include "core/vram.h"
#include "engine/registry.h"
#include "engine/vulkan/engine.h"
#include "train/budget.h"
#include "training_anchors.h"
#include "driver_calls.h"

static void assert_nothing_held(const sg_ctx *ctx, const char *what, uint64_t n)
{
    const unsigned long long device = sg_vram_current(ctx, SG_MEM_TAGS),
                             host = sg_mem_current(ctx, SG_MEM_TAGS);
    if (device || host)
        fail_msg("%s %llu: %llu bytes of the device and %llu of the host are left", what,
                 (unsigned long long) n, device, host);
}

/* ---- limits ---- */

#define LOWEST (6u << 20)
#define STEP (300u << 10)

/* By the ledger, and by what the driver was asked for, of which the ledger must miss nothing. */
static void assert_below(const sg_ctx *ctx, uint64_t limit)
{
    const uint64_t counted = sg_vram_peak(ctx, SG_MEM_TAGS), asked = peak_of_calls();
    if (asked > limit || asked != counted)
        fail_msg("limit %llu: the driver gave %llu bytes at once, the ledger counts %llu",
                 (unsigned long long) limit, (unsigned long long) asked,
                 (unsigned long long) counted);
}

/* With rising limits: refused at first, then trained to the end below the limit, with fewer
 * Gaussians, or lists in bands, where it is near. Returns how many the last limit allows. */
static uint64_t check_limits(struct sg_train_params p, int tried, uint64_t apart)
{
    p.engine = main_engine();
    p.iterations = 6, p.densify_from_iter = 2, p.densification_interval = 4;
    p.densify_grad_threshold = 1e-6f;
    int refused = 0, smaller = 0, whole = 0;
    uint64_t most = 0;
    for (int i = 0; i < tried; i++) {
        const uint64_t limit = LOWEST + (uint64_t) i * apart;
        struct sg_ctx_params params = {.threads = 1, .max_vram = limit};
        struct fixture f = make_fixture(1);
        sg_ctx *ctx;
        sg_trainer *t = NULL;
        struct sg_model *start;
        struct sg_train_limits limits;
        assert_int_equal(sg_ctx_create(&ctx, &params), SG_OK);
        forget_peak();
        f.scene.train = f.views;
        start = make_model(ctx, 1200, 1, 3);
        const int code = sg_trainer_create(ctx, &f.scene, start, &p, &t);
        if (code) {
            assert_int_equal(code, SG_ERR_BUDGET);
            assert_non_null(strstr(sg_last_error(ctx), "memory of the device: found a limit of"));
            assert_int_equal(smaller + whole, 0); /* more memory is never worse */
            refused++;
        } else {
            while (sg_trainer_iteration(t) < p.iterations)
                if (sg_trainer_step(t, NULL))
                    fail_msg("limit %llu: %s", (unsigned long long) limit, sg_last_error(ctx));
            sg_trainer_limits(t, &limits);
            assert_true(limits.by_memory && sg_trainer_gaussians(t) <= limits.max_gaussians);
            most = limits.max_gaussians;
            *(limits.gaussians_bound ? &smaller : &whole) += 1;
        }
        assert_below(ctx, limit);
        sg_trainer_destroy(&t);
        sg_model_destroy(&start);
        assert_nothing_held(ctx, "limit", limit);
        sg_ctx_destroy(&ctx);
        clear_fixture(&f);
    }
    printf("%d limits refused, %d with a smaller model, %d with the whole\n", refused, smaller,
           whole);
    assert_true(refused > 0 && smaller > 0 && whole > 0);
    return most;
}

static void test_limits(void **state)
{
    (void) state;
    check_limits(short_params(), 20, STEP);
}

/* The same of what has arrays of its own. */
static void test_variant_limits(void **state)
{
    (void) state;
    struct sg_train_params mip = short_params(), mcmc = mip, exposure = mip, defended = mip;
    mip.model = SG_MODEL_MIP, mcmc.strategy = SG_STRATEGY_MCMC, exposure.exposure = true;
    mcmc.mcmc.growth = 2;
    const uint64_t filtered = check_limits(mip, 6, 2 * STEP),
                   plain = check_limits(exposure, 6, 2 * STEP);
    assert_true(10 * filtered < 9 * plain); /* its columns are counted */
    check_limits(mcmc, 6, 2 * STEP);
    defended.defense.on = true, defended.defense.interval = 5, defended.tolerance = 8;
    check_limits(defended, 20, STEP);
}

/* A driver that gives only so much at once, and only so many times. */
static void test_driver_limits(void **state)
{
    (void) state;
    struct sg_train_params p = short_params();
    p.engine = main_engine();
    struct fixture f = make_fixture(1);
    struct sg_engine *e;
    struct sg_budget limits = {.instances = 1 << 30};
    f.scene.train = f.views;
    assert_int_equal(sg_engine_create(f.ctx, p.engine, NULL, &e), SG_OK);
    struct gpu *g = vulkan_of(e)->gpu;
    assert_true(g->chosen.largest >= 1 << 30 && g->chosen.allocations >= 4096); /* of Vulkan */
    sg_ctx_vram(f.ctx)->largest = 1 << 20;
    assert_int_equal(sg_budget_plan_device(f.ctx, &f.scene, &p, 3, false, false, &limits), SG_OK);
    assert_true(limits.by_memory);
    assert_int_equal(limits.gaussians, (1 << 20) / (4 * sg_param_count(3)));
    assert_true(limits.instances > 1000 && limits.instances < (1 << 20) / 4);
    for (int room = 0; room <= 1; room++) {
        limits.photos_stay = true;
        sg_ctx_vram(f.ctx)->most = 1024 + VIEWS - 1 + (uint64_t) room;
        assert_int_equal(sg_budget_plan_device(f.ctx, &f.scene, &p, 3, false, false, &limits),
                         SG_OK);
        assert_int_equal(limits.photos_stay, room);
    }

    /* Memory for more than the engine can index. */
    const struct sg_vram told = *sg_ctx_vram(f.ctx);
    sg_ctx_vram(f.ctx)->limit = UINT64_C(1) << 40, sg_ctx_vram(f.ctx)->largest = 0;
    for (int degree = 0; degree <= 3; degree += 3) {
        const int planes = sg_param_count(degree);
        limits = (struct sg_budget){.instances = 1 << 30};
        assert_int_equal(sg_budget_plan_device(f.ctx, &f.scene, &p, degree, false, false, &limits),
                         SG_OK);
        assert_int_equal(sg_vulkan_check_size(f.ctx, limits.gaussians, planes), SG_OK);
        assert_int_equal(sg_vulkan_check_size(f.ctx, limits.gaussians + 1, planes), SG_ERR_BUDGET);
        sg_clear_error(f.ctx);
    }
    struct sg_train_params anchors = scaffold_params();
    anchors.engine = p.engine;
    limits = (struct sg_budget){.instances = 1 << 30};
    assert_int_equal(sg_budget_plan_device(f.ctx, &f.scene, &anchors, 0, false, false, &limits),
                     SG_OK);
    assert_int_equal(limits.gaussians, sg_vulkan_most(sg_param_count(0)));
    sg_ctx_vram(f.ctx)->limit = told.limit, sg_ctx_vram(f.ctx)->largest = told.largest;

    struct gpu_buffer b = {0};
    assert_int_equal(sg_gpu_reserve(g, SG_MEM_MISC, &b, (1 << 20) + 1), SG_ERR_BUDGET);
    assert_non_null(strstr(sg_last_error(f.ctx), "its driver gives at most 1048576 at once"));
    sg_clear_error(f.ctx);
    assert_int_equal(sg_gpu_reserve(g, SG_MEM_MISC, &b, 1 << 20), SG_OK);
    sg_gpu_release(g, &b);

    const uint32_t before = g->shared->chosen.allocations;
    g->shared->chosen.allocations = g->shared->allocations;
    assert_int_equal(sg_gpu_reserve(g, SG_MEM_MISC, &b, 1000), SG_ERR_BUDGET);
    assert_non_null(strstr(sg_last_error(f.ctx), "allocations at once"));
    sg_clear_error(f.ctx);
    g->shared->chosen.allocations = before;
    assert_int_equal(sg_gpu_reserve(g, SG_MEM_MISC, &b, 1000), SG_OK);
    sg_gpu_release(g, &b);
    sg_engine_destroy(&e);
    sg_vram_forget(f.ctx);
    assert_int_equal(sg_vram_peak(f.ctx, SG_MEM_TAGS), 0);
    clear_fixture(&f);
}

/* The same of anchors: refused, or trained to the end below the limit, with as many as planned. */
static void test_anchor_limits(void **state)
{
    (void) state;
    struct sg_train_params p = scaffold_params();
    int refused = 0, smaller = 0, whole = 0;
    p.engine = main_engine();
    p.scaffold.from = 2, p.scaffold.voxel = 0.01f, p.densify_grad_threshold = 1e-9f;
    p.scaffold.appearance = true;
    for (uint64_t limit = 10 << 20; limit <= 22 << 20; limit += 2 << 20) {
        struct fixture f = make_points(1);
        sg_ctx *ctx;
        sg_trainer *t = NULL;
        struct sg_train_limits limits;
        assert_int_equal(
            sg_ctx_create(&ctx, &(struct sg_ctx_params){.threads = 1, .max_vram = limit}), SG_OK);
        forget_peak();
        f.scene.train = f.views;
        const int code = sg_trainer_create(ctx, &f.scene, NULL, &p, &t);
        if (code) {
            assert_int_equal(code, SG_ERR_BUDGET);
            assert_int_equal(smaller + whole, 0);
            refused++;
        } else {
            while (sg_trainer_iteration(t) < 18)
                if (sg_trainer_step(t, NULL))
                    fail_msg("limit %llu: %s", (unsigned long long) limit, sg_last_error(ctx));
            sg_trainer_limits(t, &limits);
            assert_true(limits.by_memory && sg_trainer_gaussians(t) <= limits.max_gaussians);
            *(limits.gaussians_bound ? &smaller : &whole) += 1;
        }
        assert_below(ctx, limit);
        printf("limit %llu: %llu used, %zu Gaussians\n", (unsigned long long) limit,
               (unsigned long long) sg_vram_peak(ctx, SG_MEM_TAGS),
               t ? sg_trainer_gaussians(t) : 0);
        sg_trainer_destroy(&t);
        assert_nothing_held(ctx, "limit", limit);
        sg_ctx_destroy(&ctx);
        clear_points(&f);
    }
    assert_true(refused > 0 && smaller > 0 && whole > 0);
}

/* What a Gaussian takes in the memory of the host: as much as planned while a run is resumed, and
 * no more while it edits its model and saves it. */
static void test_host(void **state)
{
    (void) state;
    enum { N = 8000, REST = 512 << 10, PLANNED = 64 };
    struct sg_train_params p = short_params();
    struct sg_work work = {.sh_degree = 1, .threads = 1, .width = SIDE, .height = SIDE};
    struct fixture f = make_fixture(1);
    struct sg_model *start = make_model(f.ctx, N, 1, 3);
    char path[] = "/tmp/sg_checkpoint_XXXXXX";
    uint64_t n = 0;
    p.engine = main_engine();
    p.iterations = 5, p.densify_from_iter = 1, p.densification_interval = 2;
    p.densify_grad_threshold = 1e-5f;
    close(mkstemp(path));
    f.scene.train = f.views;
    for (int resumed = 0; resumed < 2; resumed++) {
        sg_ctx *ctx = make_context(1);
        sg_trainer *t;
        const struct sg_engine_kind *kind = sg_engine_find(ctx, p.engine, NULL);
        const uint64_t each = sg_engine_footprint(kind, &work).gaussian;
        if (resumed ? sg_trainer_resume(ctx, &f.scene, path, &p, &t)
                    : sg_trainer_create(ctx, &f.scene, start, &p, &t))
            fail_msg("%s", sg_last_error(ctx));
        for (int i = 0; i < 2 && !resumed; i++)
            assert_int_equal(sg_trainer_step(t, NULL), SG_OK);
        n = sg_trainer_gaussians(t);
        assert_int_equal(sg_trainer_save(t, path), SG_OK);
        const uint64_t peak = sg_mem_peak(ctx, SG_MEM_TAGS);
        if (peak > n * (each + (resumed ? 0 : PLANNED)) + REST || (resumed && peak < n * each))
            fail_msg("%s: found %llu bytes for %llu Gaussians of %llu",
                     resumed ? "resumed" : "trained", (unsigned long long) peak,
                     (unsigned long long) n, (unsigned long long) each);
        sg_trainer_destroy(&t);
        assert_nothing_held(ctx, "run", (uint64_t) resumed);
        sg_ctx_destroy(&ctx);
    }
    assert_true(n > N); /* it did edit */
    unlink(path);
    sg_model_destroy(&start);
    clear_fixture(&f);
}

/* The default: nine tenths of what is free, of which each engine of a context counts its share. */
static void test_default(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(1);
    struct sg_engine *one, *two;
    assert_int_equal(sg_engine_create(ctx, main_engine(), NULL, &one), SG_OK);
    const uint64_t limit = sg_ctx_vram(ctx)->limit, held = sg_vram_current(ctx, SG_MEM_TAGS);
    assert_true(held > 0 && held < limit && limit < UINT64_MAX / 2);
    struct gpu *g = vulkan_of(one)->gpu; /* what it holds is not free for the second */
    struct gpu_buffer b = {0};
    const uint64_t room = (limit - held) / 2, largest = sg_ctx_vram(ctx)->largest;
    assert_int_equal(sg_gpu_reserve(g, SG_MEM_MISC, &b, largest && largest < room ? largest : room),
                     SG_OK);
    const uint64_t before = sg_vram_current(ctx, SG_MEM_TAGS);
    assert_int_equal(sg_engine_create(ctx, main_engine(), NULL, &two), SG_OK);
    assert_int_equal(sg_vram_current(ctx, SG_MEM_TAGS), before + held);
    assert_true(g->chosen.memory_budget || sg_ctx_vram(ctx)->limit <= g->chosen.info.memory);
    sg_gpu_release(g, &b);
    sg_engine_destroy(&one);
    sg_engine_destroy(&two);
    assert_nothing_held(ctx, "engines", 2);
    sg_ctx_destroy(&ctx);
}

/* A view that has no memory, for its lists or for what goes with them, takes none of that of the
 * views after it. */
static void test_refused_view(void **state)
{
    (void) state;
    static float image[3 * SIDE * SIDE];
    const struct sg_camera few = make_camera(SIDE, SIDE, 60), many = make_camera(SIDE, SIDE, 3);
    int refused = 0, whole = 0;
    for (uint64_t limit = 5 << 20; whole < 3; limit += 200 << 10) {
        sg_ctx *ctx;
        sg_renderer *r;
        assert_int_equal(
            sg_ctx_create(&ctx, &(struct sg_ctx_params){.threads = 1, .max_vram = limit}), SG_OK);
        struct sg_model *m = make_model(ctx, 3000, 0, 5);
        for (size_t i = 0; i < m->count; i++)
            for (int p = SG_P_SCALE; p < SG_P_ROT; p++)
                *sg_model_at(m, i, p) = -0.5f;
        if (!sg_renderer_create(ctx, main_engine(), NULL, m, NULL, &r) &&
            !sg_render(r, &few, image, NULL, NULL, NULL)) {
            const int code = sg_render(r, &many, image, NULL, NULL, NULL);
            assert_true(code == SG_OK || code == SG_ERR_BUDGET);
            refused += code != SG_OK, whole += code == SG_OK;
            if (sg_render(r, &few, image, NULL, NULL, NULL))
                fail_msg("limit %llu, second view %s: %s", (unsigned long long) limit,
                         code ? "refused" : "drawn", sg_last_error(ctx));
        }
        sg_renderer_destroy(&r);
        sg_model_destroy(&m);
        assert_nothing_held(ctx, "limit", limit);
        sg_ctx_destroy(&ctx);
    }
    printf("second view: refused at %d limits\n", refused);
    assert_true(refused > 2);
}

/* A model for which there is no memory leaves the one before, also where its SH degree is another.
 */
static void test_refused_model(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(1);
    struct sg_model *first = make_model(ctx, 100, 1, 3), *large = make_model(ctx, 5000, 3, 3),
                    *found;
    struct sg_engine *e = make_engine(ctx, main_engine(), NULL, first, NULL);
    struct sg_vram *memory = sg_ctx_vram(ctx);
    memory->limit = memory->current[SG_MEM_TAGS] + 1000;
    assert_int_equal(sg_engine_upload(e, large, NULL), SG_ERR_BUDGET);
    assert_non_null(strstr(sg_last_error(ctx), "bytes for model refused"));
    sg_clear_error(ctx);
    assert_int_equal(sg_engine_count(e), 100);
    assert_int_equal(e->sh_degree, 1);
    assert_int_equal(sg_model_create(ctx, 100, 1, &found), SG_OK);
    assert_int_equal(sg_engine_download(e, found, NULL), SG_OK);
    assert_memory_equal(found->params, first->params,
                        first->capacity * (size_t) sg_param_count(1) * sizeof(float));
    sg_model_destroy(&first);
    sg_model_destroy(&large);
    sg_model_destroy(&found);
    sg_engine_destroy(&e);
    assert_nothing_held(ctx, "model", 2);
    sg_ctx_destroy(&ctx);
}

/* An edit of which an allocation fails leaves the model before it or after it, whole. Moments for
 * which there was no memory are zeros. */
static void test_refused_edit(void **state)
{
    (void) state;
    enum { N = 100 };
    sg_ctx *ctx = make_context(1);
    struct sg_model *m = make_model(ctx, N, 1, 3);
    struct sg_columns o;
    struct held before, after;
    uint8_t keep[N], kind[N];
    uint32_t source[N];
    int unedited = 0, dropped = 0;
    assert_int_equal(sg_columns_create(ctx, N, 1, SG_COLUMN_SAVED, &o), SG_OK);
    for (int c = SG_C_MOMENT1; c <= SG_C_MOMENT2; c++)
        for (size_t i = 0; i < m->capacity * (size_t) sg_param_count(1); i++)
            o.at[c][i] = draw(5, i, 0.1f, 1);
    for (uint32_t i = 0; i < N; i++)
        keep[i] = i % 2, source[i] = i, kind[i] = SG_EDIT_COPY;
    const struct sg_edit edit = {
        .keep = keep, .kept = N / 2, .appended = N, .source = source, .kind = kind};
    bool failed = true;
    for (uint64_t nth = 0; failed; nth++) { /* 0: none */
        struct sg_engine *e = make_engine(ctx, main_engine(), NULL, m, &o);
        if (!nth)
            before = held_by(ctx, e, 1);
        fail_call(CALL_AllocateMemory, nth, VK_ERROR_OUT_OF_DEVICE_MEMORY);
        const int code = sg_engine_edit(e, &edit);
        failed = call_failed();
        assert_int_equal(code, failed ? SG_ERR_BUDGET : SG_OK);
        sg_clear_error(ctx);
        struct held found = held_by(ctx, e, 1);
        if (!nth)
            after = found, failed = true;
        const size_t count = found.m->count;
        const struct held *right = count == N ? &before : &after;
        const size_t floats = right->m->capacity * (size_t) sg_param_count(1);
        assert_int_equal(count, right->m->count);
        assert_memory_equal(found.m->params, right->m->params, floats * sizeof(float));
        for (int c = SG_C_MOMENT1; c <= SG_C_MOMENT2; c++) {
            const bool zeros = found.o.at[c][0] == 0;
            for (size_t i = 0; i < floats; i++)
                assert_true(found.o.at[c][i] == (zeros ? 0 : right->o.at[c][i]));
            assert_true(!zeros || (code && count != N));
            dropped += zeros;
        }
        unedited += code && count == N;
        if (nth)
            forget(&found);
        sg_engine_destroy(&e);
    }
    assert_true(unedited > 2 && dropped > 2);
    forget(&before);
    forget(&after);
    sg_columns_clear(&o);
    sg_model_destroy(&m);
    assert_nothing_held(ctx, "edit", N);
    sg_ctx_destroy(&ctx);
}

/* Indices of kernels are signed numbers of 32 bits: of a Gaussian's parameters, and at least its
 * splat; of the maps of an image that is compared. */
static void test_sizes(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(1);
    assert_int_equal(sg_vulkan_check_size(ctx, 134217000, 14), SG_OK);
    assert_int_equal(sg_vulkan_check_size(ctx, 134217728, 14), SG_ERR_BUDGET);
    assert_int_equal(sg_vulkan_check_size(ctx, 36398000, 59), SG_OK);
    assert_int_equal(sg_vulkan_check_size(ctx, 36398028, 59), SG_ERR_BUDGET);
    sg_clear_error(ctx);
    struct sg_engine *e;
    assert_int_equal(sg_engine_create(ctx, main_engine(), NULL, &e), SG_OK);
    vulkan_of(e)->width = vulkan_of(e)->height = SG_SIDE_MAX;
    const struct sg_loss loss = {.kind = SG_LOSS_PHOTOMETRIC, .weight = 1};
    assert_int_equal(sg_vulkan_loss(e, &(struct sg_target_pixels){0}, &loss), SG_ERR_BUDGET);
    assert_non_null(strstr(sg_last_error(ctx), "at most 238609294 are supported"));
    sg_engine_destroy(&e);
    sg_ctx_destroy(&ctx);
}

int main(void)
{
    if (!getenv("SG_TEST_ENGINE")) {
        printf("skipped: SG_TEST_ENGINE names no device\n");
        return 77;
    }
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_sizes),          cmocka_unit_test(test_default),
        cmocka_unit_test(test_driver_limits),  cmocka_unit_test(test_limits),
        cmocka_unit_test(test_variant_limits), cmocka_unit_test(test_anchor_limits),
        cmocka_unit_test(test_host),           cmocka_unit_test(test_refused_view),
        cmocka_unit_test(test_refused_model),  cmocka_unit_test(test_refused_edit),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
