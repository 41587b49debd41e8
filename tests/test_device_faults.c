/* SPDX-License-Identifier: Apache-2.0 */
/* A driver whose calls fail: memory that runs out, work that is refused, a device that is lost.
 * Each ends with an error that says so, or with nothing worse than a smaller model; and nothing is
 * left behind. SG_TEST_ENGINE names the device. */
#include "core/vram.h"
#include "driver_calls.h"
#include "engine/vulkan/engine.h"
#include "splatguard/attack.h"
#include "splatguard/run.h"
#include "synth_scene.h"
#include "training_anchors.h"

static char folder[] = "/tmp/sg_device_XXXXXX", scene_path[64], checkpoint[64], run_folder[64],
            proxy_path[64];
static const char *device;

/* One tile: a driver for the CPU takes milliseconds for each. */
static int make_scene(void **state)
{
    (void) state;
    const int code =
        make_synth_scene(folder, sg_synth_params(.width = 16, .height = 16, .train_views = 4,
                                                 .test_views = 1, .points = 40, .samples = 1));
    snprintf(scene_path, sizeof(scene_path), "%s/scene/colmap", folder);
    snprintf(checkpoint, sizeof(checkpoint), "%s/checkpoint", folder);
    snprintf(run_folder, sizeof(run_folder), "%s/run", folder);
    snprintf(proxy_path, sizeof(proxy_path), "%s/proxy.ply", folder);
    return code;
}

static int remove_scene(void **state)
{
    (void) state;
    return remove_synth_scene(folder);
}

/* ---- work that meets all of the engine ---- */

enum work { DEFENDED, ANCHORS, EXPLORED, ATTACKED, WORKS };
static const char *const work_names[WORKS] = {"defense", "anchors", "mcmc", "attack"};

static struct sg_train_params params_of(enum work work)
{
    struct sg_train_params p = sg_train_params_default();
    p.engine = device;
    p.iterations = 5, p.densify_from_iter = 1, p.densification_interval = 2;
    p.densify_until_iter = 5, p.sh_degree = 0, p.densify_grad_threshold = 1e-6f;
    p.scaffold.from = 1, p.scaffold.voxel = 0.05f, p.scaffold.appearance = true;
    p.model = work == ANCHORS ? SG_MODEL_SCAFFOLD : SG_MODEL_3DGS;
    p.defense.on = work != EXPLORED, p.defense.interval = 2, p.defense.views = 1;
    if (work == EXPLORED) { /* the last iteration has the low-pass term */
        p.iterations = 10;
        p.strategy = SG_STRATEGY_MCMC;
        p.exposure = true;
        p.tolerance = 8;
    }
    return p;
}

/* Creation, steps, saving, resuming, model, renderer. */
static int train_all(sg_ctx *ctx, enum work work)
{
    struct sg_scene *scene = NULL;
    sg_trainer *trainer = NULL, *resumed = NULL;
    sg_renderer *renderer = NULL;
    struct sg_model *model = NULL;
    struct sg_eval eval = {0};
    const struct sg_train_params p = params_of(work);
    const int end = work == EXPLORED ? 10 : 4;
    int code = sg_scene_load(ctx, scene_path, NULL, &scene);
    if (!code)
        code = sg_trainer_create(ctx, scene, NULL, &p, &trainer);
    for (int i = 0; i < 3 && !code; i++)
        code = sg_trainer_step(trainer, NULL);
    if (!code)
        code = sg_trainer_save(trainer, checkpoint);
    if (!code)
        code = sg_trainer_resume(ctx, scene, checkpoint, &p, &resumed);
    sg_trainer_destroy(&trainer);
    while (!code && sg_trainer_iteration(resumed) < end)
        code = sg_trainer_step(resumed, NULL);
    if (!code)
        code = sg_trainer_model(resumed, &model);
    sg_trainer_destroy(&resumed);
    if (!code)
        code = sg_renderer_create(ctx, device, NULL, model, NULL, &renderer);
    if (!code)
        code = sg_evaluate(ctx, renderer, scene->train, 1, NULL, &eval);
    sg_eval_clear(&eval);
    sg_renderer_destroy(&renderer);
    sg_model_destroy(&model);
    sg_scene_destroy(&scene);
    return code;
}

/* An attack whose ascent is on the device's views, or on images that are given. */
static int attack(sg_ctx *ctx, const struct sg_scene *scene, bool given)
{
    struct sg_attack_params p = sg_attack_params_default();
    sg_ctx *own = make_context(1); /* whose allocations do not fail */
    struct sg_model *proxy = make_model(own, 60, 0, 3), *decoy = NULL;
    sg_attack *a = NULL, *resumed = NULL;
    uint8_t poison[3 * 16 * 16];
    p.engine = device;
    p.iterations = 3, p.inner = 2, p.densification_interval = 2, p.densify_grad_threshold = 1e-6f;
    p.spectral_weight = 2;
    p.texture = given ? 4 : 0;
    int code = sg_attack_create(ctx, scene, proxy, &p, &a);
    sg_model_destroy(&proxy);
    sg_ctx_destroy(&own);
    for (int i = 0; i < (given ? 1 : 2) && !code; i++)
        code = sg_attack_step(a, NULL);
    if (!code && !given)
        code = sg_attack_save(a, checkpoint);
    if (!code && !given)
        code = sg_attack_resume(ctx, scene, checkpoint, &p, &resumed);
    if (!code && !given)
        code = sg_attack_step(resumed, NULL);
    if (!code)
        code = sg_attack_poison(a, 0, poison);
    if (!code)
        code = sg_attack_decoy(a, &decoy);
    sg_model_destroy(&decoy);
    sg_attack_destroy(&a);
    sg_attack_destroy(&resumed);
    return code;
}

static int do_work(sg_ctx *ctx, enum work work)
{
    struct sg_scene *scene = NULL;
    if (work != ATTACKED)
        return train_all(ctx, work);
    int code = sg_scene_load(ctx, scene_path, NULL, &scene);
    for (int given = 0; given < 2 && !code; given++)
        code = attack(ctx, scene, given);
    sg_scene_destroy(&scene);
    return code;
}

/* ---- one call that fails ---- */

struct fault {
    enum driver_call call;
    const char *name;
    VkResult result;
    int code;         /* what comes of it; SG_OK: nothing */
    const char *says; /* with an error */
};
#define FAULT(call, ...)                                                                           \
    {                                                                                              \
        CALL_##call, #call, __VA_ARGS__                                                            \
    }

/* A call that is made once for a device that is opened, or once for each of its kernels. */
static bool is_of_opening(enum driver_call call)
{
    return call == CALL_CreateDevice || call == CALL_CreatePipelineLayout ||
           call == CALL_CreateShaderModule || call == CALL_CreateComputePipelines;
}

/* Which call fails next: each at the beginning and every few later on, where most are repeated; or
 * very few. SG_TEST_EACH: each, which takes minutes. */
enum choice { SOME, FEW };

static uint64_t next(uint64_t n, enum choice choice)
{
    if (getenv("SG_TEST_EACH"))
        return n + 1;
    return choice == SOME ? n + 1 + n / 10 : n ? 2 * n : 1;
}

/* The device that all engines share is there, or none is. */
static void share_device(bool shared)
{
    if (!shared)
        drop_kept_engine();
    else
        keep_engine(device);
}

/* The context's ledgers are empty, and the driver has what it had before. Kernels stay with a
 * device that is open. */
static void assert_nothing_left(const sg_ctx *ctx, const struct fault *f, uint64_t n,
                                const long before[CALLS])
{
    const unsigned long long on_device = sg_vram_current(ctx, SG_MEM_TAGS),
                             host = sg_mem_current(ctx, SG_MEM_TAGS);
    if (on_device || host)
        fail_msg("%s %llu: %llu bytes of the device and %llu of the host are left", f->name,
                 (unsigned long long) n, on_device, host);
    for (int c = 0; c < CALLS; c++)
        if (calls.objects[c] != before[c] && (c != CALL_CreateComputePipelines || !kept_engine))
            fail_msg("%s %llu: %ld objects of call %d are left, there were %ld", f->name,
                     (unsigned long long) n, calls.objects[c], c, before[c]);
}

static void check_fault(enum work work, const struct fault *f, enum choice choice)
{
    sg_ctx *ctx = make_context(1);
    long before[CALLS];
    uint64_t n = 0, made;
    int tried = 0, refused = 0;
    bool failed;
    share_device(!is_of_opening(f->call));
    memcpy(before, calls.objects, sizeof(before));
    do {
        n = next(n, choice);
        made = calls.made[f->call];
        fail_call(f->call, n, f->result);
        const int code = do_work(ctx, work);
        failed = call_failed();
        tried += failed;
        refused += code != SG_OK;
        if (code != SG_OK && (code != f->code || !failed))
            fail_msg("%s: %s %llu: found code %d (%s), expected %d", work_names[work], f->name,
                     (unsigned long long) n, code, sg_last_error(ctx), f->code);
        if (code && !strstr(sg_last_error(ctx), f->says))
            fail_msg("%s: %s %llu: found \"%s\", expected \"%s\"", work_names[work], f->name,
                     (unsigned long long) n, sg_last_error(ctx), f->says);
        if (kept_engine) /* it was not, really */
            vulkan_of(kept_engine)->gpu->shared->lost = false;
        assert_nothing_left(ctx, f, n, before);
    } while (failed);
    printf("%s: %s: %d of %llu failed, %d of them for good\n", work_names[work], f->name, tried,
           (unsigned long long) (calls.made[f->call] - made), refused);
    assert_true(tried > 0 && (refused > 0) == (f->code != SG_OK));
    sg_ctx_destroy(&ctx);
}

/* Allocations of memory of the device. */
static void test_allocations(void **state)
{
    (void) state;
    static const struct fault f =
        FAULT(AllocateMemory, VK_ERROR_OUT_OF_DEVICE_MEMORY, SG_ERR_BUDGET, "out of memory on ");
    for (enum work work = 0; work < WORKS; work++)
        check_fault(work, &f, SOME);
}

/* What is short of memory, at any call. */
static void test_short(void **state)
{
    (void) state;
    static const char says[] = "out of memory on ";
    static const struct fault faults[] = {
        FAULT(CreateBuffer, VK_ERROR_OUT_OF_DEVICE_MEMORY, SG_ERR_BUDGET, says),
        FAULT(BindBufferMemory, VK_ERROR_OUT_OF_DEVICE_MEMORY, SG_ERR_BUDGET, says),
        FAULT(AllocateMemory, VK_ERROR_TOO_MANY_OBJECTS, SG_ERR_BUDGET, "allocations at once"),
        FAULT(MapMemory, VK_ERROR_OUT_OF_HOST_MEMORY, SG_ERR_BUDGET, says),
        FAULT(CreateCommandPool, VK_ERROR_OUT_OF_HOST_MEMORY, SG_ERR_BUDGET, says),
        FAULT(CreateQueryPool, VK_ERROR_OUT_OF_HOST_MEMORY, SG_ERR_BUDGET, says),
        FAULT(CreateFence, VK_ERROR_OUT_OF_HOST_MEMORY, SG_ERR_BUDGET, says),
        FAULT(AllocateCommandBuffers, VK_ERROR_OUT_OF_HOST_MEMORY, SG_ERR_BUDGET, says),
        FAULT(BeginCommandBuffer, VK_ERROR_OUT_OF_HOST_MEMORY, SG_ERR_BUDGET, says),
        FAULT(EndCommandBuffer, VK_ERROR_OUT_OF_DEVICE_MEMORY, SG_ERR_BUDGET, says),
        FAULT(ResetFences, VK_ERROR_OUT_OF_DEVICE_MEMORY, SG_ERR_BUDGET, says),
        FAULT(QueueSubmit, VK_ERROR_OUT_OF_HOST_MEMORY, SG_ERR_BUDGET, says),
        FAULT(CreatePipelineLayout, VK_ERROR_OUT_OF_HOST_MEMORY, SG_ERR_BUDGET, says),
        FAULT(CreateShaderModule, VK_ERROR_OUT_OF_HOST_MEMORY, SG_ERR_BUDGET, says),
        FAULT(CreateComputePipelines, VK_ERROR_OUT_OF_DEVICE_MEMORY, SG_ERR_BUDGET, says),
        /* another way leads on, or nobody needs it */
        FAULT(WaitForFences, VK_ERROR_OUT_OF_HOST_MEMORY, SG_OK, says),
        FAULT(GetQueryPoolResults, VK_ERROR_OUT_OF_HOST_MEMORY, SG_OK, says),
    };
    for (size_t i = 0; i < sizeof(faults) / sizeof(faults[0]); i++)
        check_fault(DEFENDED, &faults[i], FEW);
    share_device(true);
}

/* Allocations in host memory, likewise. */
static void test_host_memory(void **state)
{
    (void) state;
    share_device(true);
    for (enum work work = 0; work < WORKS; work++) {
        sg_ctx *ctx = make_context(1);
        int tried = 0, refused = 0;
        uint64_t n = 0;
        bool failed;
        do {
            n = next(n, SOME);
            sg_fail_allocation(ctx, n);
            const int code = do_work(ctx, work);
            failed = sg_fail_allocation(ctx, 0);
            tried += failed;
            refused += code != SG_OK;
            if (code && (code != SG_ERR_BUDGET || !failed || !sg_last_error(ctx)[0]))
                fail_msg("%s: allocation %llu: found code %d (%s), expected %d", work_names[work],
                         (unsigned long long) n, code, sg_last_error(ctx), SG_ERR_BUDGET);
            if (sg_vram_current(ctx, SG_MEM_TAGS) || sg_mem_current(ctx, SG_MEM_TAGS))
                fail_msg("%s: allocation %llu: something is left", work_names[work],
                         (unsigned long long) n);
        } while (failed);
        printf("%s: %d of %llu allocations in host memory failed, %d of them for good\n",
               work_names[work], tried, (unsigned long long) n, refused);
        assert_true(refused > 10);
        sg_ctx_destroy(&ctx);
    }
}

/* What fails otherwise. Before a device is lost, work is in flight. */
static void test_failures(void **state)
{
    (void) state;
    static const char lost[] = "the device is lost";
    static const struct fault faults[] = {
        FAULT(QueueSubmit, VK_ERROR_DEVICE_LOST, SG_ERR_INTERNAL, lost),
        FAULT(WaitForFences, VK_ERROR_DEVICE_LOST, SG_ERR_INTERNAL, lost),
        FAULT(MapMemory, VK_ERROR_MEMORY_MAP_FAILED, SG_ERR_INTERNAL, "failed (error -5 of "),
        FAULT(CreateDevice, VK_ERROR_INITIALIZATION_FAILED, SG_ERR_INTERNAL,
              "failed (error -3 of "),
        FAULT(CreateComputePipelines, VK_ERROR_INITIALIZATION_FAILED, SG_ERR_INTERNAL,
              "failed (error -3 of "),
    };
    for (size_t i = 0; i < sizeof(faults) / sizeof(faults[0]); i++)
        check_fault(DEFENDED, &faults[i], i < 2 ? SOME : FEW);
    share_device(true);
}

/* ---- the order of commands ---- */

/* Kernels find their buffers by addresses, which the validation layer does not follow: so each
 * command is followed by a barrier for all. */
static void test_barriers(void **state)
{
    (void) state;
    for (enum work work = 0; work < WORKS; work++) {
        sg_ctx *ctx = make_context(1);
        const uint64_t before = calls.commands;
        calls.unordered = 0;
        assert_int_equal(do_work(ctx, work), SG_OK);
        assert_true(calls.commands > before + 500);
        if (calls.unordered)
            fail_msg("%s: %llu of %llu commands have no barrier", work_names[work],
                     (unsigned long long) calls.unordered,
                     (unsigned long long) (calls.commands - before));
        sg_ctx_destroy(&ctx);
    }
}

/* Entries of a relocation that meet are run one after the other. A driver for the CPU may take them
 * in order anyway, so that their bytes need not show it. */
static void test_relocations(void **state)
{
    (void) state;
    static const struct {
        uint32_t to[2], from[2];
        uint64_t runs;
    } tried[] = {{{1, 2}, {0, 0}, 1},  /* both read one */
                 {{1, 2}, {0, 1}, 2},  /* the second reads what the first writes, */
                 {{1, 1}, {0, 2}, 2},  /* writes it too, */
                 {{1, 0}, {0, 2}, 2}}; /* or writes what that reads */
    static const float zeros[2];
    static const uint8_t fresh[2];
    sg_ctx *ctx = make_context(1);
    struct sg_model *m = make_model(ctx, 3, 0, 3);
    struct sg_engine *e = make_engine(ctx, device, NULL, m, NULL);
    const struct gpu *g = vulkan_of(e)->gpu;
    for (size_t k = 0; k < sizeof(tried) / sizeof(tried[0]); k++) {
        const uint64_t before = g->dispatches;
        const struct sg_relocation r = {2, tried[k].to, tried[k].from, zeros, zeros, fresh};
        assert_int_equal(sg_engine_relocate(e, &r), SG_OK);
        assert_int_equal(g->dispatches - before, tried[k].runs);
    }
    sg_engine_destroy(&e);
    sg_model_destroy(&m);
    sg_ctx_destroy(&ctx);
}

/* ---- runs ---- */

static enum sg_train_model trained; /* by the runs */
static enum sg_train_strategy strategy;
static bool defended;

static int train_run(sg_ctx *ctx, enum sg_run_start start)
{
    sg_run *r = NULL;
    struct sg_run_params p = sg_run_params_default();
    p.train.model = trained, p.train.strategy = strategy, p.train.scaffold.voxel = 0.05f,
    p.train.scaffold.from = 1;
    p.train.defense.on = defended, p.train.defense.views = 1, p.train.defense.from = 1;
    p.train.defense.interval = 2;
    p.source = scene_path, p.folder = run_folder, p.save_every = 2, p.train.engine = device;
    p.train.iterations = 5, p.train.sh_degree = 0, p.train.densify_from_iter = 1;
    p.train.densification_interval = 2, p.train.densify_until_iter = 5;
    p.train.opacity_reset_interval = 3;
    int code = sg_run_open(ctx, &p, start, &r);
    if (!code)
        code = sg_run_train(r);
    sg_run_close(&r);
    return code;
}

static void remove_run(void)
{
    char command[80];
    snprintf(command, sizeof(command), "rm -rf %s", run_folder);
    assert_int_equal(system(command), 0);
}

/* The newest model of a training's run, or the file of this name in the folder. */
static struct sg_model *read_model(sg_ctx *ctx, const char *name)
{
    struct sg_model *m;
    char path[128];
    snprintf(path, sizeof(path), "%s/%s", run_folder, name ? name : "");
    if (!name)
        assert_int_equal(sg_run_find_model(ctx, run_folder, 0, path, sizeof(path)), SG_OK);
    assert_int_equal(sg_model_read_drawable(ctx, path, 100000, &m), SG_OK);
    return m;
}

static void assert_model(sg_ctx *ctx, const char *name, const struct sg_model *expected)
{
    struct sg_model *found = read_model(ctx, name);
    if (trained == SG_MODEL_SCAFFOLD)
        assert_same_anchors(expected, found);
    else
        assert_same(expected, found);
    sg_model_destroy(&found);
}

/* With a proxy that is a file, and a decoy that is kept, as read_model reads it. */
static int attack_run(sg_ctx *ctx, enum sg_run_start start)
{
    struct sg_attack_run_params p = sg_attack_run_params_default();
    p.source = scene_path, p.folder = run_folder, p.proxy = proxy_path, p.save_every = 1;
    p.keep_decoy = true;
    p.attack.engine = device;
    p.attack.iterations = 4, p.attack.inner = 2, p.attack.update_interval = 1;
    p.attack.densification_interval = 2, p.attack.densify_grad_threshold = 1e-6f;
    return sg_attack_run(ctx, &p, start, NULL);
}

/* At submissions of a run, and where it waits for them: the error says so and names the checkpoint,
 * if there is one yet; from there the run ends with the same bytes as one without the loss. */
static void check_loss(int (*run)(sg_ctx *, enum sg_run_start), const char *result)
{
    sg_ctx *ctx = make_context(1);
    remove_run();
    assert_int_equal(run(ctx, SG_RUN_NEW), SG_OK);
    struct sg_model *expected = read_model(ctx, result);
    int early = 0, late = 0;
    for (uint64_t n = 1;; n = next(n, SOME)) {
        fail_call(n % 2 ? CALL_QueueSubmit : CALL_WaitForFences, n, VK_ERROR_DEVICE_LOST);
        int code = run(ctx, SG_RUN_REPLACE);
        if (!call_failed())
            break;
        if (code != SG_ERR_INTERNAL || !strstr(sg_last_error(ctx), "the device is lost"))
            fail_msg("submission %llu: found code %d (%s), expected a lost device",
                     (unsigned long long) n, code, sg_last_error(ctx));
        const bool kept = strstr(sg_last_error(ctx), "checkpoint.bin of iteration ") != NULL;
        assert_int_equal(sg_vram_current(ctx, SG_MEM_TAGS), 0);
        if (late && !kept)
            fail_msg("submission %llu: \"%s\" names no checkpoint, but an earlier one did",
                     (unsigned long long) n, sg_last_error(ctx));
        *(kept ? &late : &early) += 1;
        if (kept && late % 4 == 1) {
            assert_int_equal(run(ctx, SG_RUN_RESUME), SG_OK);
            assert_model(ctx, result, expected);
        }
    }
    printf("lost at %d submissions without a checkpoint, %d with one\n", early, late);
    assert_true(early > 8 && late > 4);
    sg_model_destroy(&expected);
    assert_int_equal(sg_mem_current(ctx, SG_MEM_TAGS), 0);
    sg_ctx_destroy(&ctx);
}

static void test_loss(void **state)
{
    (void) state;
    check_loss(train_run, NULL);
    trained = SG_MODEL_SCAFFOLD;
    check_loss(train_run, NULL);
    trained = SG_MODEL_3DGS;
    sg_ctx *ctx = make_context(1);
    struct sg_model *proxy = make_model(ctx, 60, 0, 3);
    assert_int_equal(sg_model_write_ply(ctx, proxy, proxy_path), SG_OK);
    sg_model_destroy(&proxy);
    sg_ctx_destroy(&ctx);
    check_loss(attack_run, "attack/decoy.ply");
    remove_run();
}

/* A submission that is refused, for lack of memory: the run ends early, with what it has, or goes
 * on without what nobody needs. No step is left out: what it ends with, or a run that is resumed,
 * has the bytes of one with memory. */
static void check_refused(sg_ctx *ctx)
{
    char path[128];
    assert_int_equal(train_run(ctx, SG_RUN_REPLACE), SG_OK);
    struct sg_model *expected = read_model(ctx, NULL);
    int ended = 0, whole = 0, none = 0;
    for (uint64_t n = 1;; n = next(n, SOME)) {
        fail_call(n % 2 ? CALL_QueueSubmit : CALL_EndCommandBuffer, n,
                  VK_ERROR_OUT_OF_DEVICE_MEMORY);
        remove_run();
        const int code = train_run(ctx, SG_RUN_REPLACE);
        if (!call_failed())
            break;
        if (code && (code != SG_ERR_BUDGET || !strstr(sg_last_error(ctx), "out of memory on ")))
            fail_msg("submission %llu: found code %d (%s)", (unsigned long long) n, code,
                     sg_last_error(ctx));
        assert_int_equal(sg_vram_current(ctx, SG_MEM_TAGS), 0);
        snprintf(path, sizeof(path), "%s/point_cloud/iteration_5/point_cloud.ply", run_folder);
        const bool has_ended = !access(path, F_OK);
        snprintf(path, sizeof(path), "%s/checkpoint.bin", run_folder);
        if (has_ended) {
            assert_int_equal(code, SG_OK);
            whole++;
        } else if (!access(path, F_OK)) {
            assert_int_equal(train_run(ctx, SG_RUN_RESUME), SG_OK);
            ended++;
        } else {
            none++;
            continue;
        }
        assert_model(ctx, NULL, expected);
    }
    printf("refused: %d ended early with a checkpoint, %d without, %d did not\n", ended, none,
           whole);
    assert_true(ended > 2 && none > 2);
    sg_model_destroy(&expected);
    assert_int_equal(sg_mem_current(ctx, SG_MEM_TAGS), 0);
}

/* Also of what is done between iterations: the 3D filter, relocations, and the hits of a view that
 * the device has stopped at and begins again. */
static void test_refused(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(1);
    share_device(false); /* it was lost */
    share_device(true);
    check_refused(ctx);
    trained = SG_MODEL_MIP;
    check_refused(ctx);
    trained = SG_MODEL_3DGS, strategy = SG_STRATEGY_MCMC;
    check_refused(ctx);
    strategy = SG_STRATEGY_DEFAULT, defended = true;
    check_refused(ctx);
    defended = false;
    sg_ctx_destroy(&ctx);
}

int main(void)
{
    device = getenv("SG_TEST_ENGINE");
    if (!device) {
        printf("skipped: SG_TEST_ENGINE names no device\n");
        return 77;
    }
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_barriers),    cmocka_unit_test(test_relocations),
        cmocka_unit_test(test_allocations), cmocka_unit_test(test_short),
        cmocka_unit_test(test_failures),    cmocka_unit_test(test_host_memory),
        cmocka_unit_test(test_loss),        cmocka_unit_test(test_refused),
    };
    return cmocka_run_group_tests(tests, make_scene, remove_scene);
}
