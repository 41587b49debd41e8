/* SPDX-License-Identifier: Apache-2.0 */
/* A Vulkan device as the engine sees it: buffers with a ledger, kernels, and commands that are
 * recorded and submitted, a few submissions ahead of the device. Kernels that find out that what
 * follows must not be done write a number other than 0 to gpu.stop, and stop what follows; who
 * waits next is told. Thread safety: unsafe. */
#ifndef SG_VULKAN_GPU_H
#define SG_VULKAN_GPU_H

#include "device.h"

/* ---- kernels ---- */

/* Arguments of each kernel: struct args_project and so on. */
#define ARG_POINTER(type, name) VkDeviceAddress name;
#define ARG_UINT(name) uint32_t name;
#define ARG_FLOAT(name) float name;
#define K(kernel)                                                                                  \
    struct args_##kernel {                                                                         \
        ARGS_##kernel(ARG_POINTER, ARG_UINT, ARG_FLOAT)                                            \
    };                                                                                             \
    _Static_assert(sizeof(struct args_##kernel) <= GPU_ARGUMENTS, "what all devices have");
VK_KERNELS(K)
#undef K
#undef ARG_POINTER
#undef ARG_UINT
#undef ARG_FLOAT

/* ---- buffers ---- */

struct gpu_buffer {
    VkBuffer buffer; /* 0: none */
    VkDeviceMemory memory;
    VkDeviceAddress address;
    uint64_t bytes, charged; /* what fits, and what the ledger counts */
    enum sg_mem_tag tag;
    void *mapped; /* of one that the host sees, else NULL */
};

#define GPU_MARKS 128 /* timestamps of a submission */
#define GPU_FLIGHTS 3 /* submissions that the device has at once */
#define GPU_STOPPED 1 /* beside codes, which are 0 or negative: the device has stopped */

struct gpu_flight {
    VkCommandBuffer commands;
    VkFence fence;
    bool busy;                 /* submitted, and not waited for */
    uint64_t number;           /* of the submission, from 1 */
    VkQueryPool timestamps;    /* 0: the device has none */
    uint32_t marks;            /* timestamps so far */
    double *clocks[GPU_MARKS]; /* of what follows each mark */
};

/* What each kernel takes, in seconds, and how often it was recorded. */
struct gpu_profile {
    double seconds[GPU_KERNELS];
    uint64_t dispatches[GPU_KERNELS];
};

struct gpu {
    sg_ctx *ctx;
    struct gpu_device *shared;
    struct vk_functions vk;
    struct vk_device_choice chosen;
    VkDevice device; /* of `shared` */
    VkCommandPool pool;
    struct gpu_flight flights[GPU_FLIGHTS]; /* in turns */
    uint32_t depth;                         /* how many of them are used */
    uint32_t now;                           /* the one that is recorded next, or just now */
    bool recording, lost;
    bool goes_on;                /* no submission has cleared `stop` yet since sg_gpu_go_on */
    double *clock;               /* of what is recorded next, or NULL */
    struct gpu_profile *profile; /* NULL, or in place of the clock; the benchmark's */
    struct gpu_buffer stop;      /* a word; 0: go on */
    struct gpu_buffer told;      /* a copy of it after each flight, for the host */
    uint64_t finished;           /* number of the newest submission that is done */
    uint64_t stopped;            /* number of the first submission that found it set, or 0 */
    struct gpu_buffer staging;   /* the host's window on device memory */
    struct gpu_buffer none;      /* what unused arguments point to */
    uint32_t lanes;              /* invocations of a block of pixels */
    uint64_t dispatches, submissions;
};

/* Workgroups for so many items. */
static inline uint64_t gpu_groups(uint64_t items, uint64_t each)
{
    return (items + each - 1) / each;
}
#define FOR_EACH(n) gpu_groups(n, VK_GROUP) /* of the kernels without a tile */

/* selector: see sg_vk_choose_device. SG_ERR_USAGE, SG_ERR_BUDGET, SG_ERR_INTERNAL. */
int sg_gpu_open(sg_ctx *ctx, const char *selector, struct gpu **out);
void sg_gpu_close(struct gpu **gpu);

/* Makes room for at least `bytes`. Where the buffer has to grow, it may become half as large again
 * as it was, as long as most of the memory is free, and what it held is lost. After an error it
 * holds nothing. SG_ERR_BUDGET; where commands that use the buffer fail SG_ERR_INTERNAL, or
 * GPU_STOPPED, after which it is as it was. */
int sg_gpu_reserve(struct gpu *g, enum sg_mem_tag tag, struct gpu_buffer *b, uint64_t bytes);
/* The same of one that the host sees, which is made once. */
int sg_gpu_window(struct gpu *g, struct gpu_buffer *b, uint64_t bytes);
/* Submits what is recorded and waits for it. Nobody is told where that fails: who has recorded
 * something flushes before. */
void sg_gpu_release(struct gpu *g, struct gpu_buffer *b);

/* Address of a buffer, or of one that nobody uses. */
VkDeviceAddress sg_gpu_at(const struct gpu *g, const struct gpu_buffer *b);

/* ---- commands: recorded, in order ---- */

/* variant: the SH degree, the parts of networks, or 1 for sums of absolute gradients and for lines
 * of a spectrum in memory of the device; else 0. */
int sg_gpu_dispatch(struct gpu *g, enum gpu_kernel kernel, int variant, const void *args,
                    size_t size, uint64_t groups);
/* The workgroups are in item `item` of `work` (VK_WORK_WORDS each), from an earlier kernel. */
int sg_gpu_dispatch_work(struct gpu *g, enum gpu_kernel kernel, int variant, const void *args,
                         size_t size, const struct gpu_buffer *work, uint32_t item);
#define GPU_RUN(g, kernel, variant, groups, ...)                                                   \
    sg_gpu_dispatch(g, GPU_##kernel, variant, &(struct args_##kernel){__VA_ARGS__},                \
                    sizeof(struct args_##kernel), groups)
#define GPU_RUN_WORK(g, kernel, variant, work, item, ...)                                          \
    sg_gpu_dispatch_work(g, GPU_##kernel, variant, &(struct args_##kernel){__VA_ARGS__},           \
                         sizeof(struct args_##kernel), work, item)
/* A pipeline of the caller's, with the layout of all kernels. */
int sg_gpu_dispatch_pipeline(struct gpu *g, VkPipeline pipeline, const void *args, size_t size,
                             uint64_t groups);
int sg_gpu_fill(struct gpu *g, const struct gpu_buffer *b, uint64_t offset, uint64_t bytes,
                uint32_t value);
/* At most 65536 bytes, in words. */
int sg_gpu_update(struct gpu *g, const struct gpu_buffer *b, uint64_t offset, const void *from,
                  uint64_t bytes);
int sg_gpu_copy(struct gpu *g, const struct gpu_buffer *from, uint64_t from_offset,
                const struct gpu_buffer *to, uint64_t to_offset, uint64_t bytes);

/* What the device takes for the commands from here on is added to *sum (NULL: to nothing) once it
 * is known. Without timestamps nothing is. */
void sg_gpu_clock(struct gpu *g, double *sum);

/* Submits what is recorded. Waits only where the device would have more than `depth` submissions.
 * SG_ERR_INTERNAL: the device is lost. */
int sg_gpu_submit(struct gpu *g);
/* Submits what is recorded and waits for all. GPU_STOPPED where the device has stopped, until
 * sg_gpu_go_on. */
int sg_gpu_flush(struct gpu *g);
/* After GPU_STOPPED. */
int sg_gpu_go_on(struct gpu *g);
/* Number of the submission that what is recorded next belongs to. */
static inline uint64_t gpu_next(const struct gpu *g)
{
    return g->submissions + 1;
}
/* Waits. Offsets and sizes are multiples of 4. */
int sg_gpu_write(struct gpu *g, const struct gpu_buffer *to, uint64_t offset, const void *from,
                 uint64_t bytes);
int sg_gpu_read(struct gpu *g, const struct gpu_buffer *from, uint64_t offset, void *to,
                uint64_t bytes);

#endif
