/* SPDX-License-Identifier: Apache-2.0 */
/* Which Vulkan device a name chooses, of lists that no machine at hand has. */
#include "engine/vulkan/devices.h"
#include "core/vram.h"
#include "engine/engine.h"
#include "models.h"

static struct vk_device_choice device(const char *name, VkPhysicalDeviceType type, uint64_t memory)
{
    struct vk_device_choice d = {.type = type, .info.memory = memory};
    snprintf(d.info.name, sizeof(d.info.name), "%s", name);
    d.info.cpu = type == VK_PHYSICAL_DEVICE_TYPE_CPU;
    return d;
}

/* The name of the device that is chosen, or the error. */
static const char *choose(sg_ctx *ctx, const struct vk_device_choice *devices, int n,
                          const char *selector)
{
    const struct vk_device_choice *out;
    sg_clear_error(ctx);
    if (!sg_vk_choose_device(ctx, devices, n, selector, &out))
        return out->info.name;
    return sg_last_error(ctx);
}

/* A card before the host's own GPU, the larger card before the smaller one, the first of two that
 * are alike; what lacks something and what runs on the CPU only by name. */
static void test_choice(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(1);
    struct vk_device_choice list[] = {
        device("llvmpipe (LLVM 15)", VK_PHYSICAL_DEVICE_TYPE_CPU, 64u << 20),
        device("Iris", VK_PHYSICAL_DEVICE_TYPE_INTEGRATED_GPU, 32u << 20),
        device("GeForce One", VK_PHYSICAL_DEVICE_TYPE_DISCRETE_GPU, 8u << 20),
        device("GeForce Two", VK_PHYSICAL_DEVICE_TYPE_DISCRETE_GPU, 16u << 20),
        device("GeForce Three", VK_PHYSICAL_DEVICE_TYPE_DISCRETE_GPU, 16u << 20),
        device("Old", VK_PHYSICAL_DEVICE_TYPE_DISCRETE_GPU, 24u << 20),
    };
    list[5].info.missing = "Vulkan 1.2";
    assert_string_equal(choose(ctx, list, 6, NULL), "GeForce Two");
    assert_string_equal(choose(ctx, list, 3, NULL), "GeForce One");
    assert_string_equal(choose(ctx, list, 2, NULL), "Iris");
    assert_non_null(strstr(choose(ctx, list, 1, NULL), "found no GPU among 1 devices"));
    assert_non_null(strstr(choose(ctx, list, 0, NULL), "found no GPU among 0 devices"));
    assert_non_null(strstr(choose(ctx, list + 5, 1, NULL), "found no GPU"));
    assert_string_equal(choose(ctx, list, 6, "LLVM"), "llvmpipe (LLVM 15)");
    assert_string_equal(choose(ctx, list, 6, "0"), "llvmpipe (LLVM 15)");
    assert_string_equal(choose(ctx, list, 6, "geforce"), "GeForce One");
    assert_string_equal(choose(ctx, list, 6, "4"), "GeForce Three");
    assert_non_null(strstr(choose(ctx, list, 6, "old"), "Old lacks Vulkan 1.2"));
    assert_non_null(strstr(choose(ctx, list, 6, "6"), "no device \"6\" among 6"));
    assert_non_null(strstr(choose(ctx, list, 6, "radeon"), "no device \"radeon\" among 6"));
    sg_ctx_destroy(&ctx);
}

static char said[1024];

static void keep_line(void *priv, enum sg_log_level level, const char *line)
{
    (void) priv;
    if (level <= SG_LOG_INFO)
        snprintf(said, sizeof(said), "%s", line);
}

static sg_ctx *listening_context(void)
{
    const struct sg_ctx_params params = {.threads = 1, .log = keep_line, .log_level = SG_LOG_INFO};
    sg_ctx *ctx;
    said[0] = 0;
    assert_int_equal(sg_ctx_create(&ctx, &params), SG_OK);
    return ctx;
}

static const char *engine_of(sg_ctx *ctx, const char *name, const char *variant)
{
    return sg_engine_find(ctx, name, variant)->name;
}

/* Where drivers are hidden, as from this suite: the CPU, without a word. A variant is one of the
 * CPU's. */
static void test_auto(void **state)
{
    (void) state;
    struct sg_engine_info e = {0};
    sg_ctx *ctx = listening_context();
    for (size_t i = 0; sg_engine_list(i, &e); i++)
        if (!strcmp(e.engine, "vulkan"))
            break;
    assert_non_null(e.engine);
    assert_int_equal(sg_engine_check(ctx, "auto", NULL), SG_OK);
    assert_string_equal(engine_of(ctx, "auto", "baseline"), "cpu");
    assert_string_equal(engine_of(ctx, NULL, "baseline"), "cpu");
    assert_int_equal(sg_engine_check(ctx, "auto", "nonsense"), SG_ERR_USAGE);
    sg_clear_error(ctx);
    if (!e.available) {
        assert_string_equal(engine_of(ctx, "auto", NULL), "cpu");
        assert_string_equal(engine_of(ctx, NULL, NULL), "cpu");
        assert_string_equal(said, "");
    }
    sg_ctx_destroy(&ctx);
}

/* Engines for machines that no machine at hand is: the CPU's, with one operation exchanged. */
static struct sg_engine_ops cpu, changed;

static int create_changed(sg_ctx *ctx, const char *variant, struct sg_engine **out)
{
    assert_null(variant);
    const int code = sg_engine_cpu.create(ctx, NULL, out);
    if (!code)
        (*out)->ops = &changed;
    return code;
}

static const char *name_of_gpu(const struct sg_engine *e)
{
    (void) e;
    return "GPU of a test";
}

static int wrong_image(struct sg_engine *e, float *rgb, float *alpha, float *depth)
{
    const int code = cpu.read_image(e, rgb, alpha, depth);
    rgb[e->width + 3] = NAN;
    return code;
}

static int wrong_gradients(struct sg_engine *e, struct sg_model *out)
{
    const int code = cpu.read_gradients(e, out);
    for (size_t i = 0; i < out->count; i++)
        *sg_model_at(out, i, SG_P_OPACITY) *= 1.5f;
    return code;
}

static int lost(struct sg_engine *e)
{
    return sg_fail(e->ctx, SG_ERR_INTERNAL, "the GPU of a test is lost");
}

static int too_small(sg_ctx *ctx, const char *variant, struct sg_engine **out)
{
    (void) variant;
    *out = NULL;
    return sg_fail(ctx, SG_ERR_BUDGET, "the GPU of a test is too small");
}

/* What is chosen, and leaves neither memory nor an error behind. */
static const char *choice(const struct sg_engine_kind *candidate)
{
    static char text[64];
    sg_ctx *ctx = listening_context();
    snprintf(text, sizeof(text), "%s", sg_engine_choose(ctx, candidate)->name);
    assert_int_equal(sg_mem_current(ctx, SG_MEM_TAGS), 0);
    assert_false(sg_failed(ctx));
    sg_ctx_destroy(&ctx);
    return text;
}

static void test_trial(void **state)
{
    (void) state;
    struct sg_engine_kind gpu = {.name = "gpu", .devices = true, .create = create_changed};
    sg_ctx *ctx = make_context(1);
    struct sg_engine *e;
    assert_int_equal(sg_engine_create(ctx, "cpu", NULL, &e), SG_OK);
    changed = cpu = *e->ops;
    sg_engine_destroy(&e);
    sg_ctx_destroy(&ctx);
    changed.variant = name_of_gpu;
    assert_string_equal(choice(&gpu), "gpu");
    assert_string_equal(said, "");
    changed.read_image = wrong_image;
    assert_string_equal(choice(&gpu), "cpu");
    assert_non_null(strstr(said, "auto takes cpu: GPU of a test: found nan as value 53 of a test"));
    changed.read_image = cpu.read_image;
    changed.read_gradients = wrong_gradients;
    assert_string_equal(choice(&gpu), "cpu");
    assert_non_null(strstr(said, "as gradient of parameter 3 of Gaussian"));
    changed.read_gradients = cpu.read_gradients;
    changed.raster_backward = lost;
    assert_string_equal(choice(&gpu), "cpu");
    assert_non_null(strstr(said, "auto takes cpu: the GPU of a test is lost"));
    gpu.create = too_small;
    assert_string_equal(choice(&gpu), "cpu");
    assert_non_null(strstr(said, "auto takes cpu: the GPU of a test is too small"));
}

/* A device that has no room for the work gives way once; an engine with a name never does. */
static void test_gives_way(void **state)
{
    (void) state;
    const struct sg_engine_kind gpu = {.name = "gpu", .devices = true, .create = create_changed};
    sg_ctx *ctx = listening_context();
    *sg_ctx_auto_engine(ctx) = &gpu;
    assert_string_equal(engine_of(ctx, "auto", NULL), "gpu");
    assert_string_equal(engine_of(ctx, "auto", "baseline"), "cpu");
    sg_fail(ctx, SG_ERR_BUDGET, "memory of the device: no room");
    assert_false(sg_engine_give_way(ctx, "vulkan", NULL, SG_ERR_BUDGET));
    assert_false(sg_engine_give_way(ctx, "auto", "baseline", SG_ERR_BUDGET));
    assert_false(sg_engine_give_way(ctx, "auto", NULL, SG_ERR_INPUT));
    assert_true(sg_engine_give_way(ctx, "auto", NULL, SG_ERR_BUDGET));
    assert_string_equal(said, "engine: auto takes cpu: memory of the device: no room");
    assert_false(sg_failed(ctx));
    assert_string_equal(engine_of(ctx, NULL, NULL), "cpu");
    assert_false(sg_engine_give_way(ctx, "auto", NULL, SG_ERR_BUDGET));
    sg_ctx_destroy(&ctx);
}

/* The engine that this suite is for passes; a device that is lost during the trial does not. */
static void test_tried_engine(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(1);
    struct sg_engine *e;
    assert_int_equal(sg_engine_create(ctx, main_engine(), NULL, &e), SG_OK);
    assert_int_equal(sg_engine_try(e), SG_OK);
    sg_engine_destroy(&e);
    if (!strncmp(main_engine(), "vulkan", 6)) {
        assert_int_equal(sg_engine_create(ctx, main_engine(), NULL, &e), SG_OK);
        sg_fail_device(ctx, SG_DEVICE_SUBMISSION, 1);
        assert_int_not_equal(sg_engine_try(e), SG_OK);
        assert_true(sg_fail_device(ctx, SG_DEVICE_SUBMISSION, 0));
        sg_engine_destroy(&e);
    }
    assert_int_equal(sg_mem_current(ctx, SG_MEM_TAGS), 0);
    sg_ctx_destroy(&ctx);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_choice),       cmocka_unit_test(test_auto),
        cmocka_unit_test(test_trial),        cmocka_unit_test(test_gives_way),
        cmocka_unit_test(test_tried_engine),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
