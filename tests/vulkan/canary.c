/* SPDX-License-Identifier: Apache-2.0 */
/* What the validation layer must object to, on the device that SG_TEST_ENGINE names: a size that is
 * no multiple of 4 (call), or a fill and a copy without a barrier between them (barriers); or
 * neither. canary.sh looks for what it says. */
#include "driver_calls.h"
#include "engine/vulkan/engine.h"

int main(int argc, char **argv)
{
    sg_ctx *ctx;
    struct sg_engine *e;
    struct gpu_buffer buffer = {0};
    if (argc < 2 || sg_ctx_create(&ctx, NULL) ||
        sg_engine_create(ctx, getenv("SG_TEST_ENGINE"), NULL, &e))
        return EXIT_FAILURE;
    struct gpu *g = vulkan_of(e)->gpu;
    int code = sg_gpu_reserve(g, SG_MEM_MISC, &buffer, 256);
    calls.no_barriers = !strcmp(argv[1], "barriers");
    if (!code)
        code = sg_gpu_fill(g, &buffer, 0, strcmp(argv[1], "call") ? 256 : 6, 1);
    if (!code)
        code = sg_gpu_copy(g, &buffer, 0, &g->none, 0, 256);
    if (!code)
        code = sg_gpu_flush(g);
    sg_gpu_release(g, &buffer);
    sg_engine_destroy(&e);
    sg_ctx_destroy(&ctx);
    return code ? EXIT_FAILURE : EXIT_SUCCESS;
}
