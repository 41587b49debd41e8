/* SPDX-License-Identifier: Apache-2.0 */
/* What a driver makes of the kernels of the Vulkan engine: registers, spills, shared memory and
 * instructions of each, without running one. Of the kernels that draw tiles, also the instructions
 * of a row, which is a Gaussian in a block of 32 pixels. Mesa's driver for AMD compiles for GPUs
 * that are not there: RADV_FORCE_FAMILY=navi21 build/registers. Prints one tab-separated line a
 * pipeline: kernel, variant, and the driver's statistics as NAME=VALUE. Exit status 1: a kernel
 * spills registers, or does not compile; 77: no driver tells. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "engine/vulkan/gpu.h"

#define STATISTICS 64

static struct vk_functions vk;
static PFN_vkGetPipelineExecutableStatisticsKHR get_statistics;
static PFN_vkGetPipelineExecutableInternalRepresentationsKHR get_texts;

/* Variants of a kernel, as the engine asks for them. */
static int variants_of(enum gpu_kernel kernel)
{
    switch (kernel) {
    case GPU_project:
    case GPU_learn:
        return 4; /* SH degrees */
    case GPU_neural:
    case GPU_neural_backward:
        return 4;             /* parts of networks */
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

/* ---- instructions of a row ---- */

#define LINES 4096
#define LOOPS 256

static bool has_rows(enum gpu_kernel kernel)
{
    return kernel == GPU_raster || kernel == GPU_raster_backward || kernel == GPU_raster_count;
}

/* Of an assembly text: instructions, numbered from 0, and loops, which are jumps backwards. */
struct listing {
    int count, rows, loops;
    int row[LINES];               /* instructions that every row has once */
    int begin[LOOPS], end[LOOPS]; /* first instruction of a loop, and one behind its jump */
};

/* Every row has one exponential, and nothing else has any. */
#define OF_A_ROW "v_exp_f32"

/* Instructions are lines that begin with a tab; labels are BB and a number. */
static bool read_listing(const char *text, struct listing *l)
{
    static int label[LINES];
    *l = (struct listing){0};
    for (int i = 0; i < LINES; i++)
        label[i] = -1;
    for (const char *line = text, *next; *line; line = next) {
        const size_t length = strcspn(line, "\n");
        char words[128];
        unsigned number;
        next = line + length + (line[length] == '\n');
        snprintf(words, sizeof(words), "%.*s", (int) length, line);
        if (sscanf(words, "BB%u:", &number) == 1 && number < LINES)
            label[number] = l->count;
        if (words[0] != '\t')
            continue;
        const char *target = strstr(words, " BB");
        if (strstr(words, "branch") && target && sscanf(target, " BB%u", &number) == 1 &&
            number < LINES && label[number] >= 0 && l->loops < LOOPS) {
            l->begin[l->loops] = label[number];
            l->end[l->loops++] = l->count + 1;
        }
        if (strstr(words, OF_A_ROW) && l->rows < LINES)
            l->row[l->rows++] = l->count;
        l->count++;
    }
    return l->rows > 0 && l->loops > 0;
}

static bool within(const struct listing *l, int inner, int outer)
{
    return inner != outer && l->begin[inner] >= l->begin[outer] && l->end[inner] <= l->end[outer];
}

/* The innermost loop with a row runs over rows. It may take several in one pass, whose number of
 * exponentials tells, and may have loops within. Those that begin after the last row sum what the
 * rows left, in raster_backward one after the other: over the pixels of parts of blocks, where each
 * half of the invocations takes one of two branches; where absolute gradients are summed, over the
 * same pixels with one half; then over the parts, VK_BLOCKS x ROWS x SLOT sums in passes of 256,
 * which is 9 or 11 eighths of a pass. In raster_count an eighth sums. All other loops are counted
 * once. Returns the instructions of a row, rounded up; 0: the text is not understood. */
static int of_a_row(enum gpu_kernel kernel, bool absolute, const char *text)
{
    static struct listing l;
    if (!read_listing(text, &l))
        return 0;
    int loop = -1, rows = 0, last = 0, eighths = 0, sums = 0;
    for (int i = 0; i < l.loops; i++) {
        int here = 0, newest = 0;
        for (int k = 0; k < l.rows; k++)
            if (l.row[k] >= l.begin[i] && l.row[k] < l.end[i])
                here++, newest = l.row[k];
        if (here > 0 && (loop < 0 || within(&l, i, loop)))
            loop = i, rows = here, last = newest;
    }
    if (loop < 0)
        return 0;
    for (int at = l.begin[loop]; at < l.end[loop]; at++) {
        int outermost = -1;
        for (int i = 0; i < l.loops; i++)
            if (within(&l, i, loop) && l.begin[i] > last && at >= l.begin[i] && at < l.end[i] &&
                (outermost < 0 || within(&l, outermost, i)))
                outermost = i;
        sums += outermost >= 0 && at == l.begin[outermost];
        eighths += outermost < 0                   ? 8
                   : kernel != GPU_raster_backward ? 1
                   : sums <= (absolute ? 2 : 1)    ? 4
                                                   : (absolute ? 11 : 9);
    }
    return (eighths + 8 * rows - 1) / (8 * rows);
}

/* The newest text of a pipeline, which is the assembly; to be freed. */
static char *assembly_of(VkDevice device, const VkPipelineExecutableInfoKHR *info)
{
    VkPipelineExecutableInternalRepresentationKHR texts[16];
    uint32_t n = sizeof(texts) / sizeof(texts[0]);
    char *text = NULL;
    for (uint32_t i = 0; i < n; i++)
        texts[i] = (VkPipelineExecutableInternalRepresentationKHR){
            .sType = VK_STRUCTURE_TYPE_PIPELINE_EXECUTABLE_INTERNAL_REPRESENTATION_KHR};
    if (!get_texts || get_texts(device, info, &n, texts) < 0 || !n || !texts[n - 1].isText)
        return NULL;
    for (uint32_t i = 0; i < n; i++)
        texts[i].pData = i == n - 1 ? (text = calloc(1, texts[i].dataSize + 1)) : NULL;
    if (!text || get_texts(device, info, &n, texts) < 0) {
        free(text);
        return NULL;
    }
    return text;
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
    struct gpu_build build = sg_gpu_build(kernel, variant, lanes);
    build.flags = VK_PIPELINE_CREATE_CAPTURE_STATISTICS_BIT_KHR |
                  (has_rows(kernel) /* with it, drivers read nothing from their cache */
                       ? VK_PIPELINE_CREATE_CAPTURE_INTERNAL_REPRESENTATIONS_BIT_KHR
                       : 0);
    const VkResult result = sg_gpu_compile(&vk, device, layout, &build, &pipeline);
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
    if (has_rows(kernel)) {
        char *text = assembly_of(device, &info);
        if (text)
            printf("\tInstructions of a row=%d", of_a_row(kernel, variant > 0, text));
        free(text);
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
        return 77;
    }
    sg_vk_open_device(&vk, device);
    const PFN_vkVoidFunction found =
        vk.GetDeviceProcAddr(device, "vkGetPipelineExecutableStatisticsKHR");
    const PFN_vkVoidFunction found_texts =
        vk.GetDeviceProcAddr(device, "vkGetPipelineExecutableInternalRepresentationsKHR");
    memcpy(&get_statistics, &found, sizeof(found));
    memcpy(&get_texts, &found_texts, sizeof(found_texts));
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
    return good ? EXIT_SUCCESS : EXIT_FAILURE;
}
