/* SPDX-License-Identifier: Apache-2.0 */
/* What a driver makes of the kernels of the Vulkan engine: registers, spills, shared memory and
 * instructions of each, without running one. Mesa's driver for AMD compiles for GPUs that are not
 * there: RADV_FORCE_FAMILY=navi21 build/registers. Prints one tab-separated line a pipeline:
 * kernel, variant, and the driver's statistics as NAME=VALUE. Exit status 1: a kernel spills
 * registers, or does not compile; 77: no driver tells. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "engine/vulkan/gpu.h"

#define STATISTICS 64

static struct vk_functions vk;
static PFN_vkGetPipelineExecutableStatisticsKHR get_statistics;

/* Variants of a kernel, as the engine asks for them. */
static int variants_of(enum gpu_kernel kernel)
{
    switch (kernel) {
    case GPU_project:
    case GPU_learn:
        return 4;             /* SH degrees */
    case GPU_raster_backward: /* with absolute gradients */
    case GPU_spectrum_rows:   /* these four: with lines in device memory */
    case GPU_spectrum_columns:
    case GPU_spectrum_columns_back:
    case GPU_spectrum_rows_back:
        return 2;
    default:
        return 1;
    }
}

static bool spills(const VkPipelineExecutableStatisticKHR *s)
{
    return (strstr(s->name, "pill") || strstr(s->name, "Scratch")) &&
           s->format == VK_PIPELINE_EXECUTABLE_STATISTIC_FORMAT_UINT64_KHR && s->value.u64 > 0;
}

/* Returns whether the kernel compiles and keeps all in registers. */
static bool report(VkDevice device, VkPipelineLayout layout, uint32_t lanes, enum gpu_kernel kernel,
                   int variant)
{
    static const char *const names[] = {
#define K(name) #name,
        VK_KERNELS(K)
#undef K
    };
    VkPipeline pipeline;
    const VkResult result =
        sg_gpu_compile(&vk, device, layout, kernel, variant, lanes,
                       VK_PIPELINE_CREATE_CAPTURE_STATISTICS_BIT_KHR, &pipeline);
    if (result) {
        fprintf(stderr, "%s %d: does not compile, error %d\n", names[kernel], variant,
                (int) result);
        return false;
    }
    VkPipelineExecutableStatisticKHR s[STATISTICS];
    uint32_t n = STATISTICS;
    bool good = true;
    for (int i = 0; i < STATISTICS; i++)
        s[i] = (VkPipelineExecutableStatisticKHR){
            .sType = VK_STRUCTURE_TYPE_PIPELINE_EXECUTABLE_STATISTIC_KHR};
    const VkPipelineExecutableInfoKHR info = {
        .sType = VK_STRUCTURE_TYPE_PIPELINE_EXECUTABLE_INFO_KHR, .pipeline = pipeline};
    if (get_statistics(device, &info, &n, s) < 0)
        n = 0;
    printf("%s\t%d", names[kernel], variant);
    for (uint32_t i = 0; i < n; i++) {
        if (s[i].format == VK_PIPELINE_EXECUTABLE_STATISTIC_FORMAT_UINT64_KHR)
            printf("\t%s=%llu", s[i].name, (unsigned long long) s[i].value.u64);
        good = good && !spills(&s[i]);
    }
    printf("\n");
    if (!good)
        fprintf(stderr, "%s %d: spills registers\n", names[kernel], variant);
    vk.DestroyPipeline(device, pipeline, NULL);
    return good && n > 0;
}

static VkDevice open_device(const struct vk_device_choice *d)
{
    static const char *const extension = VK_KHR_PIPELINE_EXECUTABLE_PROPERTIES_EXTENSION_NAME;
    const float priority = 1;
    VkDevice device = VK_NULL_HANDLE;
    VkPhysicalDevicePipelineExecutablePropertiesFeaturesKHR executable = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_PIPELINE_EXECUTABLE_PROPERTIES_FEATURES_KHR,
        .pipelineExecutableInfo = VK_TRUE};
    VkPhysicalDeviceVulkan12Features features = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_2_FEATURES,
        .pNext = &executable,
        .bufferDeviceAddress = VK_TRUE};
    const VkDeviceQueueCreateInfo queue = {.sType = VK_STRUCTURE_TYPE_DEVICE_QUEUE_CREATE_INFO,
                                           .queueFamilyIndex = d->queue_family,
                                           .queueCount = 1,
                                           .pQueuePriorities = &priority};
    const VkDeviceCreateInfo info = {.sType = VK_STRUCTURE_TYPE_DEVICE_CREATE_INFO,
                                     .pNext = &features,
                                     .queueCreateInfoCount = 1,
                                     .pQueueCreateInfos = &queue,
                                     .enabledExtensionCount = 1,
                                     .ppEnabledExtensionNames = &extension};
    return vk.CreateDevice(d->physical, &info, NULL, &device) ? VK_NULL_HANDLE : device;
}

int main(void)
{
    struct vk_device_choice devices[VK_DEVICES];
    const char *missing = sg_vk_open(&vk);
    const int n = missing ? 0 : sg_vk_devices(&vk, devices);
    const VkDevice device = n > 0 ? open_device(&devices[0]) : VK_NULL_HANDLE;
    if (!device) {
        fprintf(stderr, "skipped: no driver that tells statistics of pipelines\n");
        if (!missing)
            sg_vk_close(&vk);
        return 77;
    }
    sg_vk_open_device(&vk, device);
    const PFN_vkVoidFunction found =
        vk.GetDeviceProcAddr(device, "vkGetPipelineExecutableStatisticsKHR");
    memcpy(&get_statistics, &found, sizeof(found));
    const VkPushConstantRange range = {VK_SHADER_STAGE_COMPUTE_BIT, 0, GPU_ARGUMENTS};
    const VkPipelineLayoutCreateInfo info = {.sType = VK_STRUCTURE_TYPE_PIPELINE_LAYOUT_CREATE_INFO,
                                             .pushConstantRangeCount = 1,
                                             .pPushConstantRanges = &range};
    VkPipelineLayout layout = VK_NULL_HANDLE;
    bool good = get_statistics && !vk.CreatePipelineLayout(device, &info, NULL, &layout);
    printf("# %s, driver %s, subgroups of %u\n", devices[0].info.name, devices[0].info.driver,
           devices[0].lanes);
    for (int k = 0; k < GPU_KERNELS && layout; k++)
        for (int v = 0; v < variants_of((enum gpu_kernel) k); v++)
            good = report(device, layout, sg_gpu_lanes(devices[0].lanes), (enum gpu_kernel) k, v) &&
                   good;
    vk.DestroyPipelineLayout(device, layout, NULL);
    vk.DestroyDevice(device, NULL);
    sg_vk_close(&vk);
    return good ? EXIT_SUCCESS : EXIT_FAILURE;
}
