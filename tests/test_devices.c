/* SPDX-License-Identifier: Apache-2.0 */
/* Which Vulkan device a name chooses, of lists that no machine at hand has; and what devices and
 * loaders that lack something are said to lack. Calls of dlopen, dlsym and dlclose by the library
 * come here (cmake/tests.cmake). */
#include <dlfcn.h>

#include "engine/vulkan/devices.h"
#include "core/vram.h"
#include "engine/vulkan/engine.h"
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
    assert_string_equal(choose(ctx, list, 6, "15"), "llvmpipe (LLVM 15)");
    assert_string_equal(choose(ctx, list, 6, "geforce"), "GeForce One");
    assert_string_equal(choose(ctx, list, 6, "4"), "GeForce Three");
    assert_non_null(strstr(choose(ctx, list, 6, "old"), "Old lacks Vulkan 1.2"));
    assert_non_null(strstr(choose(ctx, list, 6, "6"), "no device \"6\" among 6"));
    assert_non_null(strstr(choose(ctx, list, 6, "radeon"), "no device \"radeon\" among 6"));
    assert_non_null(strstr(choose(ctx, list, 6, ""), "no device \"\" among 6"));
    sg_ctx_destroy(&ctx);
}

/* ---- devices that lack something ---- */

/* A driver of devices, of which each handle is a number from 1. */
#define FAKES 9
struct fake {
    VkPhysicalDeviceProperties properties;
    bool addresses, budget;
    VkQueueFlags queues[3]; /* of its families; 0: it has no more */
};
static struct fake fakes[FAKES];
static VkResult fakes_found;

static struct fake *fake_of(VkPhysicalDevice device)
{
    return &fakes[(uintptr_t) device - 1];
}

static VkResult VKAPI_CALL list_fakes(VkInstance instance, uint32_t *n, VkPhysicalDevice *out)
{
    (void) instance;
    for (*n = 0; *n < FAKES; (*n)++)
        out[*n] = (VkPhysicalDevice) (uintptr_t) (*n + 1);
    return fakes_found;
}

static void VKAPI_CALL tell_properties(VkPhysicalDevice device, VkPhysicalDeviceProperties2 *out)
{
    out->properties = fake_of(device)->properties;
    for (VkBaseOutStructure *more = out->pNext; more; more = more->pNext)
        if (more->sType == VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_SUBGROUP_PROPERTIES)
            ((VkPhysicalDeviceSubgroupProperties *) (void *) more)->subgroupSize = 32;
}

static void VKAPI_CALL tell_features(VkPhysicalDevice device, VkPhysicalDeviceFeatures2 *out)
{
    for (VkBaseOutStructure *more = out->pNext; more; more = more->pNext)
        if (more->sType == VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_2_FEATURES)
            ((VkPhysicalDeviceVulkan12Features *) (void *) more)->bufferDeviceAddress =
                fake_of(device)->addresses;
}

/* The host's memory, and two heaps of its own, of which the larger one is half full. */
static void VKAPI_CALL tell_memory(VkPhysicalDevice device, VkPhysicalDeviceMemoryProperties2 *out)
{
    VkPhysicalDeviceMemoryProperties *m = &out->memoryProperties;
    m->memoryHeapCount = 3;
    m->memoryHeaps[0] = (VkMemoryHeap){64u << 20, 0};
    m->memoryHeaps[1] = (VkMemoryHeap){1u << 20, VK_MEMORY_HEAP_DEVICE_LOCAL_BIT};
    m->memoryHeaps[2] = (VkMemoryHeap){8u << 20, VK_MEMORY_HEAP_DEVICE_LOCAL_BIT};
    VkPhysicalDeviceMemoryBudgetPropertiesEXT *budget = out->pNext;
    assert_int_equal(budget != NULL, fake_of(device)->budget);
    if (budget)
        budget->heapBudget[2] = 6u << 20, budget->heapUsage[2] = 4u << 20;
}

static void VKAPI_CALL tell_queues(VkPhysicalDevice device, uint32_t *n,
                                   VkQueueFamilyProperties *out)
{
    for (*n = 0; *n < 3 && fake_of(device)->queues[*n]; (*n)++)
        out[*n] = (VkQueueFamilyProperties){.queueFlags = fake_of(device)->queues[*n],
                                            .timestampValidBits = 30 + *n};
}

static VkResult VKAPI_CALL tell_extensions(VkPhysicalDevice device, const char *layer, uint32_t *n,
                                           VkExtensionProperties *out)
{
    (void) layer;
    *n = fake_of(device)->budget ? 2 : 1;
    for (uint32_t i = 0; i < *n && out; i++)
        snprintf(out[i].extensionName, sizeof(out[i].extensionName), "%s",
                 i ? VK_EXT_MEMORY_BUDGET_EXTENSION_NAME : "VK_KHR_nothing");
    return VK_SUCCESS;
}

static const struct vk_functions fake_driver = {
    .EnumeratePhysicalDevices = list_fakes,
    .GetPhysicalDeviceProperties2 = tell_properties,
    .GetPhysicalDeviceFeatures2 = tell_features,
    .GetPhysicalDeviceMemoryProperties2 = tell_memory,
    .GetPhysicalDeviceQueueFamilyProperties = tell_queues,
    .EnumerateDeviceExtensionProperties = tell_extensions};

/* Each lacks one thing, but for the last two. They are listed with what it is, are refused by name,
 * and nothing but the first of those two is chosen. */
static void test_lacking(void **state)
{
    (void) state;
    static const char *const missing[FAKES] = {"Vulkan 1.2",
                                               "a queue that computes",
                                               "a queue that computes",
                                               "buffer device addresses",
                                               "workgroups of 256 invocations",
                                               "workgroups of 256 invocations",
                                               "32 KiB of shared memory a workgroup"};
    struct vk_device_choice found[VK_DEVICES];
    sg_ctx *ctx = make_context(1);
    for (int i = 0; i < FAKES; i++) {
        fakes[i] = (struct fake){
            .properties = {.apiVersion = VK_API_VERSION_1_2,
                           .deviceType = VK_PHYSICAL_DEVICE_TYPE_DISCRETE_GPU,
                           .limits = {.maxComputeWorkGroupInvocations = 256,
                                      .maxComputeWorkGroupSize = {256},
                                      .maxComputeSharedMemorySize = 32768,
                                      .timestampPeriod = 2}},
            .addresses = true,
            .queues = {VK_QUEUE_GRAPHICS_BIT | VK_QUEUE_COMPUTE_BIT, VK_QUEUE_COMPUTE_BIT}};
        snprintf(fakes[i].properties.deviceName, sizeof(fakes[i].properties.deviceName), "card %c",
                 'A' + i);
    }
    fakes[0].properties.apiVersion = VK_MAKE_API_VERSION(0, 1, 1, 300);
    fakes[1].queues[0] = 0;
    fakes[2].queues[0] = VK_QUEUE_GRAPHICS_BIT, fakes[2].queues[1] = VK_QUEUE_TRANSFER_BIT;
    fakes[3].addresses = false;
    fakes[4].properties.limits.maxComputeWorkGroupInvocations = 255;
    fakes[5].properties.limits.maxComputeWorkGroupSize[0] = 128;
    fakes[6].properties.limits.maxComputeSharedMemorySize = 32767;
    fakes[7].budget = true;
    fakes[8].queues[1] = 0;
    fakes_found = VK_INCOMPLETE; /* there may be more */
    assert_int_equal(sg_vk_devices(&fake_driver, found), FAKES);
    for (int i = 0; i < FAKES; i++) {
        char expected[100];
        if (missing[i]) {
            assert_non_null(found[i].info.missing);
            assert_string_equal(found[i].info.missing, missing[i]);
        } else {
            assert_null(found[i].info.missing);
        }
        snprintf(expected, sizeof(expected), missing[i] ? "card %c lacks %s" : "card %c", 'A' + i,
                 missing[i]);
        assert_non_null(
            strstr(choose(ctx, found, FAKES, fakes[i].properties.deviceName), expected));
        assert_int_equal(found[i].info.memory, 8 << 20);
        assert_int_equal(found[i].info.memory_free, fakes[i].budget ? 2 << 20 : 8 << 20);
    }
    assert_string_equal(choose(ctx, found, FAKES, NULL), "card H");
    assert_non_null(strstr(choose(ctx, found, 7, NULL), "found no GPU among 7 devices"));
    assert_int_equal(found[7].queue_family, 1); /* that of computations alone */
    assert_int_equal(found[7].timestamp_bits, 31);
    assert_int_equal(found[8].queue_family, 0);
    assert_true(found[7].lanes == 32 && found[7].tick == 2e-9);
    fakes_found = VK_ERROR_INITIALIZATION_FAILED;
    assert_int_equal(sg_vk_devices(&fake_driver, found), 0);
    sg_ctx_destroy(&ctx);
}

/* ---- loaders that lack something ---- */

enum loader { REAL, NO_LIBRARY, NO_ENTRY, VERSION_1_0, VERSION_1_1, NO_DRIVER, LOADERS };
static enum loader loader;
static int libraries_open;

void *__real_dlopen(const char *name, int flags);
void *__real_dlsym(void *library, const char *name);
int __real_dlclose(void *library);
void *__wrap_dlopen(const char *name, int flags);
void *__wrap_dlsym(void *library, const char *name);
int __wrap_dlclose(void *library);

static VkResult VKAPI_CALL tell_version(uint32_t *version)
{
    *version = loader == VERSION_1_1 ? VK_API_VERSION_1_1 : VK_API_VERSION_1_3;
    return VK_SUCCESS;
}

static VkResult VKAPI_CALL find_no_driver(const VkInstanceCreateInfo *info,
                                          const VkAllocationCallbacks *allocator,
                                          VkInstance *instance)
{
    (void) info, (void) allocator, (void) instance;
    return VK_ERROR_INCOMPATIBLE_DRIVER;
}

static PFN_vkVoidFunction VKAPI_CALL find_function(VkInstance instance, const char *name)
{
    assert_null(instance);
    if (!strcmp(name, "vkCreateInstance"))
        return (PFN_vkVoidFunction) find_no_driver;
    if (!strcmp(name, "vkEnumerateInstanceVersion") && loader != VERSION_1_0)
        return (PFN_vkVoidFunction) tell_version;
    return NULL;
}

void *__wrap_dlopen(const char *name, int flags)
{
    if (loader == REAL)
        return __real_dlopen(name, flags);
    libraries_open += loader != NO_LIBRARY;
    return loader == NO_LIBRARY ? NULL : &loader;
}

void *__wrap_dlsym(void *library, const char *name)
{
    if (loader == REAL)
        return __real_dlsym(library, name);
    const PFN_vkGetInstanceProcAddr entry = find_function;
    void *found = NULL;
    assert_string_equal(name, "vkGetInstanceProcAddr");
    if (loader != NO_ENTRY)
        memcpy(&found, &entry, sizeof(found));
    return found;
}

int __wrap_dlclose(void *library)
{
    libraries_open -= loader != REAL;
    return loader == REAL ? __real_dlclose(library) : 0;
}

/* Each is named where devices are listed, where the engine is, and where it is asked for; the
 * library is closed. Then auto is the CPU. */
static void test_loaders(void **state)
{
    (void) state;
    static const char *const expected[LOADERS] = {
        [NO_LIBRARY] = "the Vulkan loader (libvulkan.so.1, package libvulkan1; see docs/gpu.md)",
        [NO_ENTRY] = "a working Vulkan loader",
        [VERSION_1_0] = "a Vulkan loader of version 1.2 or newer",
        [VERSION_1_1] = "a Vulkan loader of version 1.2 or newer",
        [NO_DRIVER] =
            "a Vulkan driver that starts (mesa-vulkan-drivers; or NVIDIA's with libegl1, in a "
            "container with the capability graphics; see docs/gpu.md)"};
    struct sg_device_info devices[VK_DEVICES];
    const char *missing;
    assert_null(kept_engine); /* nobody may have opened the loader yet: it stays open */
    for (loader = NO_LIBRARY; loader < LOADERS; loader++) {
        sg_ctx *ctx = make_context(1);
        struct sg_engine_info info = {0};
        struct sg_engine *e = NULL;
        assert_int_equal(sg_device_list(devices, VK_DEVICES, &missing), 0);
        assert_string_equal(missing, expected[loader]);
        for (size_t i = 0; sg_engine_list(i, &info) && strcmp(info.engine, "vulkan"); i++)
            continue;
        assert_false(info.available);
        assert_string_equal(info.missing, expected[loader]);
        assert_int_equal(sg_engine_create(ctx, "vulkan", NULL, &e), SG_ERR_USAGE);
        assert_null(e);
        assert_non_null(strstr(sg_last_error(ctx), "this machine lacks "));
        assert_non_null(strstr(sg_last_error(ctx), expected[loader]));
        sg_clear_error(ctx);
        assert_int_equal(sg_engine_check(ctx, "auto", NULL), SG_OK);
        assert_string_equal(sg_engine_find(ctx, "auto", NULL)->name, "cpu");
        assert_int_equal(libraries_open, 0);
        sg_ctx_destroy(&ctx);
    }
    loader = REAL;
    sg_device_list(NULL, 0, &missing); /* what it says is remembered */
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
    /* Also beside an engine that has none. */
    struct sg_engine *engine;
    static const char *const names[] = {"auto", "cpu", "ref", "vulkan"};
    for (size_t i = 0; i < sizeof(names) / sizeof(names[0]); i++) {
        assert_int_equal(sg_engine_check(ctx, names[i], "nonsense"), SG_ERR_USAGE);
        assert_non_null(strstr(sg_last_error(ctx), "cpu: found \"nonsense\""));
        sg_clear_error(ctx);
    }
    assert_int_equal(sg_engine_create(ctx, "ref", "nonsense", &engine), SG_ERR_USAGE);
    sg_clear_error(ctx);
    assert_int_equal(sg_engine_check(ctx, "ref", "baseline"), SG_OK);
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

/* Charges what it cannot give. */
static int takes_too_much(sg_ctx *ctx, const char *variant, struct sg_engine **out)
{
    assert_int_equal(sg_vram_take(ctx, SG_MEM_MODEL, 1000), SG_OK);
    sg_vram_give(ctx, SG_MEM_MODEL, 1000);
    return too_small(ctx, variant, out);
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

/* Whatever the work is, it is done, and no peak is left of a device that did not do it. */
static void test_all_give_way(void **state)
{
    (void) state;
    const struct sg_engine_kind gpu = {.name = "gpu", .devices = true, .create = takes_too_much};
    uint8_t pixels[3 * 16 * 16] = {7}, rgb[3 * 16 * 16];
    struct sg_view photo = {
        .name = (char *) "photo", .camera = make_camera(16, 16, 3), .rgb = pixels};
    struct sg_scene scene = {.train = &photo, .n_train = 1, .path = (char *) "scene", .extent = 3};
    struct sg_prune_params prune = sg_prune_params_default();
    prune.method = SG_PRUNER_SPECTRAL;
    for (int work = 0; work < 4; work++) {
        double scores[50];
        sg_trainer *t = NULL;
        sg_renderer *r = NULL;
        sg_ctx *ctx = listening_context();
        struct sg_model *m = make_model(ctx, 50, 1, 7);
        *sg_ctx_auto_engine(ctx) = &gpu;
        const int code = work == 0   ? sg_trainer_create(ctx, &scene, m, NULL, &t)
                         : work == 1 ? sg_renderer_create(ctx, NULL, NULL, m, NULL, &r)
                         : work == 2 ? sg_prune_scores(ctx, &scene, m, &prune, scores)
                                     : sg_attack_naive(ctx, &photo, 0, NULL, SG_NAIVE_TV, rgb);
        if (code || sg_vram_peak(ctx, SG_MEM_TAGS))
            fail_msg("work %d: %d, %s", work, code, sg_last_error(ctx));
        assert_string_equal(said, "engine: auto takes cpu: the GPU of a test is too small");
        sg_trainer_destroy(&t);
        sg_renderer_destroy(&r);
        sg_model_destroy(&m);
        sg_ctx_destroy(&ctx);
    }
}

/* Where this suite asks the driver for a vector width, its subgroups are as wide. */
static void test_subgroup(void **state)
{
    (void) state;
    const char *width = getenv("LP_NATIVE_VECTOR_WIDTH");
    if (!width || strncmp(main_engine(), "vulkan", 6))
        return;
    const struct gpu *g = vulkan_of(kept_engine)->gpu;
    assert_int_equal(g->chosen.lanes, strtoul(width, NULL, 10) / 32);
    assert_int_equal(g->lanes, g->chosen.lanes);
}

/* ---- kernels ---- */

/* Of SPIR-V. */
#define HEADER_WORDS 5
enum { OP_DECORATE = 71, OP_ADD = 129, OP_SUBTRACT = 131, OP_MULTIPLY = 133, NO_CONTRACTION = 42 };

static bool contracts(const struct gpu_code *code, uint32_t result)
{
    for (size_t at = HEADER_WORDS; at < code->bytes / 4; at += code->words[at] >> 16) {
        const uint32_t *op = code->words + at;
        if ((op[0] & 0xffff) == OP_DECORATE && op[1] == result && op[2] == NO_CONTRACTION)
            return false;
    }
    return true;
}

/* What counts tiles and what emits them round alike: no driver may make one operation of two. */
static void test_rounding(void **state)
{
    (void) state;
    static const enum gpu_kernel kernels[] = {GPU_count, GPU_tile_totals, GPU_emit};
    for (size_t k = 0; k < sizeof(kernels) / sizeof(kernels[0]); k++) {
        const struct gpu_code *code = &sg_vulkan_code[kernels[k]];
        int found = 0;
        for (size_t at = HEADER_WORDS; at < code->bytes / 4; at += code->words[at] >> 16) {
            const uint32_t *op = code->words + at, kind = op[0] & 0xffff;
            if (kind != OP_ADD && kind != OP_SUBTRACT && kind != OP_MULTIPLY)
                continue;
            found++;
            if (contracts(code, op[2]))
                fail_msg("kernel %d: operation %d of floats may be contracted", (int) kernels[k],
                         found);
        }
        assert_true(found > 10);
    }
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
        cmocka_unit_test(test_choice),       cmocka_unit_test(test_lacking),
        cmocka_unit_test(test_loaders),      cmocka_unit_test(test_auto),
        cmocka_unit_test(test_trial),        cmocka_unit_test(test_gives_way),
        cmocka_unit_test(test_all_give_way), cmocka_unit_test(test_subgroup),
        cmocka_unit_test(test_tried_engine), cmocka_unit_test(test_rounding),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
