/* SPDX-License-Identifier: Apache-2.0 */
/* Which Vulkan device a name chooses, of lists that no machine at hand has. */
#include "engine/vulkan/devices.h"
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

static char said[256];

static void keep_line(void *priv, enum sg_log_level level, const char *line)
{
    (void) priv;
    if (level == SG_LOG_INFO)
        snprintf(said, sizeof(said), "%s", line);
}

/* `auto` takes what is listed as available, and says what it has taken. */
static void test_auto(void **state)
{
    (void) state;
    const struct sg_ctx_params params = {.threads = 1, .log = keep_line, .log_level = SG_LOG_INFO};
    struct sg_engine_info e = {0};
    struct sg_engine *engine;
    sg_ctx *ctx;
    for (size_t i = 0; sg_engine_list(i, &e); i++)
        if (!strcmp(e.engine, "vulkan"))
            break;
    assert_non_null(e.engine);
    assert_int_equal(sg_ctx_create(&ctx, &params), SG_OK);
    assert_int_equal(sg_engine_check(ctx, "auto", NULL), SG_OK);
    assert_int_equal(sg_engine_create(ctx, "auto", NULL, &engine), SG_OK);
    assert_non_null(strstr(said, e.available ? "auto takes vulkan: " : "auto takes cpu: "));
    assert_true(e.available || sg_engine_check(ctx, "auto", "nonsense") == SG_ERR_USAGE);
    sg_engine_destroy(&engine);
    sg_ctx_destroy(&ctx);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_choice),
        cmocka_unit_test(test_auto),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
