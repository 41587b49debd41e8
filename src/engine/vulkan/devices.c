/* SPDX-License-Identifier: Apache-2.0 */
#include "devices.h"

#include <glob.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#define SHARED_MEMORY 32768 /* bytes that a workgroup of our kernels has at most */

/* A queue family that computes; one that cannot draw is the device's own for that. */
static bool find_queue(const struct vk_functions *vk, struct vk_device_choice *d)
{
    VkQueueFamilyProperties families[16];
    uint32_t n = sizeof(families) / sizeof(families[0]);
    int best = -1;
    vk->GetPhysicalDeviceQueueFamilyProperties(d->physical, &n, families);
    for (uint32_t i = 0; i < n; i++)
        if (families[i].queueFlags & VK_QUEUE_COMPUTE_BIT &&
            (best < 0 || !(families[i].queueFlags & VK_QUEUE_GRAPHICS_BIT)))
            best = (int) i;
    d->queue_family = best < 0 ? 0 : (uint32_t) best;
    d->timestamp_bits = best < 0 ? 0 : families[best].timestampValidBits;
    return best >= 0;
}

static bool has_extension(const struct vk_functions *vk, VkPhysicalDevice device, const char *name)
{
    uint32_t n = 0;
    bool found = false;
    vk->EnumerateDeviceExtensionProperties(device, NULL, &n, NULL);
    VkExtensionProperties *list = malloc((n ? n : 1) * sizeof(*list));
    if (list && vk->EnumerateDeviceExtensionProperties(device, NULL, &n, list) == VK_SUCCESS)
        for (uint32_t i = 0; i < n && !found; i++)
            found = !strcmp(list[i].extensionName, name);
    free(list);
    return found;
}

static void read_memory(const struct vk_functions *vk, struct vk_device_choice *d)
{
    VkPhysicalDeviceMemoryBudgetPropertiesEXT budget = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_MEMORY_BUDGET_PROPERTIES_EXT};
    VkPhysicalDeviceMemoryProperties2 memory = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_MEMORY_PROPERTIES_2,
        .pNext = d->memory_budget ? &budget : NULL};
    vk->GetPhysicalDeviceMemoryProperties2(d->physical, &memory);
    const VkPhysicalDeviceMemoryProperties *m = &memory.memoryProperties;
    for (uint32_t i = 0; i < m->memoryHeapCount; i++) {
        if (!(m->memoryHeaps[i].flags & VK_MEMORY_HEAP_DEVICE_LOCAL_BIT) ||
            m->memoryHeaps[i].size <= d->info.memory)
            continue;
        const uint64_t size = m->memoryHeaps[i].size;
        const uint64_t used = d->memory_budget ? budget.heapUsage[i] : 0,
                       most = d->memory_budget ? budget.heapBudget[i] : size;
        d->info.memory = size;
        d->info.memory_free = most > used ? most - used : 0;
    }
}

static void look_at(const struct vk_functions *vk, struct vk_device_choice *d)
{
    VkPhysicalDeviceVulkan12Properties more = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_2_PROPERTIES};
    VkPhysicalDeviceMaintenance3Properties allocation = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_MAINTENANCE_3_PROPERTIES, .pNext = &more};
    VkPhysicalDeviceSubgroupProperties subgroup = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_SUBGROUP_PROPERTIES, .pNext = &allocation};
    VkPhysicalDeviceProperties2 properties = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_PROPERTIES_2, .pNext = &subgroup};
    VkPhysicalDeviceVulkan12Features features12 = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_2_FEATURES};
    VkPhysicalDeviceFeatures2 features = {.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_FEATURES_2,
                                          .pNext = &features12};
    vk->GetPhysicalDeviceProperties2(d->physical, &properties);
    vk->GetPhysicalDeviceFeatures2(d->physical, &features);
    const VkPhysicalDeviceProperties *p = &properties.properties;
    d->type = p->deviceType;
    d->lanes = subgroup.subgroupSize;
    d->largest = allocation.maxMemoryAllocationSize;
    d->allocations = p->limits.maxMemoryAllocationCount;
    d->tick = 1e-9 * (double) p->limits.timestampPeriod;
    d->memory_budget = has_extension(vk, d->physical, VK_EXT_MEMORY_BUDGET_EXTENSION_NAME);
    snprintf(d->info.name, sizeof(d->info.name), "%s", p->deviceName);
    snprintf(d->info.driver, sizeof(d->info.driver), "%.100s %.100s", more.driverName,
             more.driverInfo);
    d->info.cpu = p->deviceType == VK_PHYSICAL_DEVICE_TYPE_CPU;
    read_memory(vk, d);
    if (p->apiVersion < VK_API_VERSION_1_2)
        d->info.missing = "Vulkan 1.2";
    else if (!find_queue(vk, d))
        d->info.missing = "a queue that computes";
    else if (!features12.bufferDeviceAddress)
        d->info.missing = "buffer device addresses";
    else if (p->limits.maxComputeWorkGroupInvocations < 256 ||
             p->limits.maxComputeWorkGroupSize[0] < 256)
        d->info.missing = "workgroups of 256 invocations";
    else if (p->limits.maxComputeSharedMemorySize < SHARED_MEMORY)
        d->info.missing = "32 KiB of shared memory a workgroup";
}

int sg_vk_devices(const struct vk_functions *vk, struct vk_device_choice out[VK_DEVICES])
{
    VkPhysicalDevice found[VK_DEVICES];
    uint32_t n = VK_DEVICES;
    const VkResult result = vk->EnumeratePhysicalDevices(vk->instance, &n, found);
    if (result != VK_SUCCESS && result != VK_INCOMPLETE)
        return 0;
    for (uint32_t i = 0; i < n; i++) {
        out[i] = (struct vk_device_choice){.physical = found[i]};
        look_at(vk, &out[i]);
    }
    return (int) n;
}

/* Of devices that nobody has named: the greater is better, 0 is not taken. */
static int rank(const struct vk_device_choice *d)
{
    if (d->info.missing || d->info.cpu)
        return 0;
    return d->type == VK_PHYSICAL_DEVICE_TYPE_DISCRETE_GPU     ? 4
           : d->type == VK_PHYSICAL_DEVICE_TYPE_VIRTUAL_GPU    ? 3
           : d->type == VK_PHYSICAL_DEVICE_TYPE_INTEGRATED_GPU ? 2
                                                               : 1;
}

/* In any case. Nothing is part of no text. */
static bool contains(const char *text, const char *part)
{
    for (; *text && *part; text++)
        if (!strncasecmp(text, part, strlen(part)))
            return true;
    return false;
}

/* The device that is taken where nobody has named one. */
static const struct vk_device_choice *best_of(const struct vk_device_choice *devices, int n)
{
    const struct vk_device_choice *best = NULL;
    for (int i = 0; i < n; i++) {
        const struct vk_device_choice *d = &devices[i];
        if (rank(d) > 0 && (!best || rank(d) > rank(best) ||
                            (rank(d) == rank(best) && d->info.memory > best->info.memory)))
            best = d;
    }
    return best;
}

int sg_vk_choose_device(sg_ctx *ctx, const struct vk_device_choice *devices, int n,
                        const char *selector, const struct vk_device_choice **out)
{
    *out = selector ? NULL : best_of(devices, n);
    char *end = NULL;
    const long number = selector && *selector ? strtol(selector, &end, 10) : -1;
    const bool by_number = end && !*end && number < n; /* else part of a name, such as 4090 */
    for (int i = 0; i < n && !*out && selector; i++)
        if (by_number ? number == i : contains(devices[i].info.name, selector))
            *out = &devices[i];
    if (*out && !(*out)->info.missing)
        return SG_OK;
    if (*out)
        return sg_fail(ctx, SG_ERR_USAGE, "vulkan: %s lacks %s", (*out)->info.name,
                       (*out)->info.missing);
    if (!selector)
        return sg_fail(ctx, SG_ERR_USAGE,
                       "vulkan: found no GPU among %d devices; a driver on the CPU is used by name "
                       "only (vulkan:NAME), `splatguard info --devices` lists all, docs/gpu.md "
                       "says what a GPU "
                       "needs",
                       n);
    return sg_fail(ctx, SG_ERR_USAGE,
                   "vulkan: found no device \"%s\" among %d; `splatguard info --devices` lists "
                   "their names and numbers",
                   selector, n);
}

bool sg_vulkan_may_have_gpu(void)
{
#ifdef __linux__
    static const char *const files[] = {
        "/dev/dri/renderD*",          /* drivers of the kernel, for AMD, Intel, NVIDIA and others */
        "/dev/nvidia[0-9]*",          /* NVIDIA's own driver */
        "/proc/driver/nvidia/gpus/*", /* the same before its first use */
        "/dev/dxg",                   /* Windows' GPU in WSL */
        "/dev/mali*",                 /* the makers' own drivers of phones' and boards' GPUs */
        "/dev/kgsl-3d*",
        "/dev/pvr*",
    };
    bool found = false;
    for (size_t i = 0; i < sizeof(files) / sizeof(files[0]) && !found; i++) {
        glob_t list = {0};
        found = !glob(files[i], GLOB_NOSORT, NULL, &list);
        globfree(&list);
    }
    return found;
#else
    return true;
#endif
}

/* What this process lacks to run on a GPU, once somebody has looked: engines are listed one by one,
 * and `auto` asks several times. */
static struct {
    pthread_mutex_t lock;
    bool known;
    const char *missing;
} seen = {.lock = PTHREAD_MUTEX_INITIALIZER};

size_t sg_device_list(struct sg_device_info *out, size_t most, const char **missing)
{
    struct vk_functions vk;
    struct vk_device_choice devices[VK_DEVICES];
    size_t n = 0;
    const char *lacks = sg_vk_open(&vk);
    if (missing)
        *missing = lacks;
    if (!lacks) {
        const int found = sg_vk_devices(&vk, devices);
        for (int i = 0; i < found && n < most; i++)
            out[n++] = devices[i].info;
        lacks = best_of(devices, found) ? NULL : "a GPU with Vulkan 1.2 (see docs/gpu.md)";
    }
    pthread_mutex_lock(&seen.lock);
    seen.known = true;
    seen.missing = lacks;
    pthread_mutex_unlock(&seen.lock);
    return n;
}

bool sg_vulkan_describe(size_t index, struct sg_engine_info *out)
{
    if (index > 0 || !out)
        return index == 0;
    pthread_mutex_lock(&seen.lock);
    const bool known = seen.known;
    pthread_mutex_unlock(&seen.lock);
    if (!known)
        sg_device_list(NULL, 0, &out->missing);
    pthread_mutex_lock(&seen.lock);
    out->missing = seen.missing;
    pthread_mutex_unlock(&seen.lock);
    out->description = "Vulkan compute";
    out->available = out->chosen = !out->missing;
    return true;
}
