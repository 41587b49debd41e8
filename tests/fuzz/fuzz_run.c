/* SPDX-License-Identifier: Apache-2.0 */
/* JSON files of a run and of an attack: config.json, exposure.json, summary.json and cameras.json,
 * all of them the input. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "splatguard/model.h"
#include "splatguard/run.h"

#include "spill.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static const char *const names[] = {"config.json", "exposure.json",      "summary.json",
                                    "cfg_args",    "attack/config.json", "cameras.json"};
#define CAMERAS 5 /* its place */
#define FILES (sizeof(names) / sizeof(names[0]))
static char folder[64], paths[FILES][96];

static void remove_folder(void)
{
    char attack[96];
    for (size_t k = 0; k < FILES; k++)
        unlink(paths[k]);
    snprintf(attack, sizeof(attack), "%s/attack", folder);
    rmdir(attack);
    rmdir(folder);
}

static void make_folder(void)
{
    char attack[96];
    snprintf(folder, sizeof(folder), "/tmp/sg-fuzz-run-XXXXXX");
    if (!mkdtemp(folder))
        abort();
    snprintf(attack, sizeof(attack), "%s/attack", folder);
    if (mkdir(attack, 0700))
        abort();
    for (size_t k = 0; k < FILES; k++)
        snprintf(paths[k], sizeof(paths[k]), "%s/%s", folder, names[k]);
    atexit(remove_folder);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static const struct sg_view views[2] = {{.name = (char *) "a"}, {.name = (char *) "b\xff"}};
    struct sg_run_params run;
    struct sg_attack_run_params attack;
    sg_run_summary *summary;
    float exposures[24];
    sg_ctx *ctx;
    if (!folder[0])
        make_folder();
    if (sg_ctx_create(&ctx, &(struct sg_ctx_params){.threads = 1, .max_memory = 64 << 20}))
        return 0;
    for (size_t k = 0; k < FILES; k++)
        spill(paths[k], data, size);
    if (!sg_run_read_params(ctx, folder, &run))
        sg_run_check(ctx, &run);
    sg_run_params_clear(&run);
    sg_run_read_scene(ctx, folder, &run);
    sg_run_params_clear(&run);
    unlink(paths[0]); /* then cfg_args is read */
    sg_run_read_scene(ctx, folder, &run);
    sg_run_params_clear(&run);
    sg_attack_run_read_params(ctx, folder, &attack);
    sg_attack_run_params_clear(&attack);
    sg_run_read_exposures(ctx, folder, views, 2, exposures);
    struct sg_view *cameras;
    size_t n;
    sg_cameras_read_json(ctx, paths[CAMERAS], NULL, &cameras, &n);
    sg_cameras_destroy(&cameras, &n);
    if (!sg_run_summary_read(ctx, folder, &summary)) {
        sg_run_summary_number(summary, "stage_seconds.loss");
        sg_run_summary_destroy(&summary);
    }
    if (sg_mem_current(ctx, SG_MEM_TAGS))
        __builtin_trap();
    sg_ctx_destroy(&ctx);
    return 0;
}
