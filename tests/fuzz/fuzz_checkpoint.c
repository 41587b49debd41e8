/* SPDX-License-Identifier: Apache-2.0 */
/* Checkpoints: a sound one with edits, under a right checksum. Each edit of the input has 8 bytes:
 * where (4), how (1) and what (3). A byte behind the last edit says which run it is of. What
 * resumes must be able to train on and to be saved. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define XXH_INLINE_ALL
#include <xxhash.h>

#include "core/rng.h"
#include "splatguard/scene.h"
#include "splatguard/train.h"

#include "camera.h"
#include "spill.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

enum { SIDE = 16, VIEWS = 2, GAUSSIANS = 20, EDIT = 8, MOST = 1 << 18 };
enum run { PLAIN, MIP, MCMC, ANCHORS, RUNS };

static uint8_t sound[RUNS][MOST], changed[MOST];
static size_t sound_size[RUNS];
static char path[] = "/tmp/sg-fuzz-checkpoint-XXXXXX";
static struct sg_view views[VIEWS];
static uint8_t photo[3 * SIDE * SIDE];
static float points[3 * GAUSSIANS];
static uint8_t point_colors[3 * GAUSSIANS];
static struct sg_scene scene = {.path = (char *) "memory",
                                .train = views,
                                .n_train = VIEWS,
                                .extent = 3,
                                .points = points,
                                .point_colors = point_colors,
                                .n_points = GAUSSIANS};

static sg_ctx *make_context(void)
{
    sg_ctx *ctx;
    if (sg_ctx_create(&ctx, &(struct sg_ctx_params){.threads = 1, .max_memory = 64 << 20}))
        abort();
    return ctx;
}

/* Together every state that a checkpoint can have. The step after resuming, the fourth, edits the
 * models of MCMC and of anchors. */
static struct sg_train_params parameters(enum run run)
{
    static const float tolerances[VIEWS] = {3, 0};
    struct sg_train_params p = sg_train_params_default();
    p.engine = "cpu";
    p.iterations = 9;
    p.sh_degree = 1;
    p.densify_from_iter = 0;
    p.tolerances = tolerances;
    p.exposure = true;
    switch (run) {
    case MIP:
        p.model = SG_MODEL_MIP;
        break;
    case MCMC:
        p.strategy = SG_STRATEGY_MCMC;
        p.max_gaussians = 2 * GAUSSIANS;
        p.densification_interval = 2;
        break;
    case ANCHORS: /* with a filter of single Gaussians */
        p.model = SG_MODEL_SCAFFOLD;
        p.sh_degree = 0;
        p.scaffold.voxel = 0.3f;
        p.scaffold.cells = 4;
        p.scaffold.from = 1;
        p.densification_interval = 2;
        p.defense.on = true;
        p.defense.unit = SG_UNIT_GAUSSIAN;
        p.defense.interval = 2;
        p.defense.from = 2, p.defense.until = 9;
        break;
    default:;
    }
    return p;
}

static void remove_file(void)
{
    unlink(path);
}

static void make_scene(void)
{
    for (size_t i = 0; i < sizeof(photo); i++)
        photo[i] = (uint8_t) sg_rng_u64(1, SG_RNG_SYNTH, 0, i);
    for (int v = 0; v < VIEWS; v++)
        views[v] = (struct sg_view){
            .name = (char *) "view", .rgb = photo, .camera = front_camera(SIDE, 3 + v)};
    for (size_t i = 0; i < 3 * GAUSSIANS; i++)
        points[i] = 2 * sg_rng_uniform(3, SG_RNG_SYNTH, i, 0) - 1;
    if (close(mkstemp(path)))
        abort();
    atexit(remove_file);
}

static void make_sound(enum run run)
{
    const struct sg_train_params p = parameters(run);
    struct sg_model *m;
    sg_trainer *t;
    sg_ctx *ctx = make_context();
    if (sg_model_create(ctx, GAUSSIANS, 0, &m))
        abort();
    for (size_t i = 0; i < GAUSSIANS; i++)
        for (int k = 0; k < 14; k++)
            *sg_model_at(m, i, k) = 2 * sg_rng_uniform(2, SG_RNG_SYNTH, i, (uint64_t) k) - 1;
    if (sg_trainer_create(ctx, &scene, run == ANCHORS ? NULL : m, &p, &t))
        abort();
    for (int i = 0; i < 3; i++)
        if (sg_trainer_step(t, NULL))
            abort();
    if (sg_trainer_save(t, path))
        abort();
    FILE *f = fopen(path, "rb");
    sound_size[run] = f ? fread(sound[run], 1, MOST, f) : 0;
    if (!f || fclose(f) || sound_size[run] < 64 || sound_size[run] == MOST)
        abort();
    sg_trainer_destroy(&t);
    sg_model_destroy(&m);
    sg_ctx_destroy(&ctx);
}

/* The checkpoint with the edits; returns its size. */
static size_t edit(enum run run, const uint8_t *data, size_t size)
{
    size_t n = sound_size[run] - sizeof(XXH64_hash_t);
    memcpy(changed, sound[run], n);
    for (; size >= EDIT && n; data += EDIT, size -= EDIT) {
        uint32_t where;
        memcpy(&where, data, sizeof(where));
        const size_t at = where % n;
        switch (data[4] % 4) {
        case 0:
            changed[at] = data[5];
            break;
        case 1: /* a number */
            for (size_t k = 0; k < 4 && (at & ~(size_t) 3) + k < n; k++)
                changed[(at & ~(size_t) 3) + k] = k < 2 ? data[5] : data[4 + k];
            break;
        case 2: /* the end */
            n = data[5] ? at : n;
            break;
        default: { /* more of it */
            const size_t more = data[5] % 64u, from = at + more <= n ? at : 0;
            if (n + more < sizeof(changed) - sizeof(XXH64_hash_t) && from + more <= n) {
                memcpy(changed + n, changed + from, more);
                n += more;
            }
        }
        }
    }
    const XXH64_hash_t sum = XXH3_64bits(changed, n);
    memcpy(changed + n, &sum, sizeof(sum));
    return n + sizeof(sum);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    const enum run run = size % EDIT ? data[size - 1] % RUNS : PLAIN;
    if (!views[0].rgb)
        make_scene();
    if (!sound_size[run])
        make_sound(run);
    const struct sg_train_params p = parameters(run);
    sg_trainer *t;
    sg_ctx *ctx = make_context();
    spill(path, changed, edit(run, data, size));
    if (!sg_trainer_resume(ctx, &scene, path, &p, &t)) {
        const int code = sg_trainer_step(t, NULL);
        if ((code && code != SG_ERR_INPUT && code != SG_ERR_BUDGET) ||
            (!code && sg_trainer_save(t, path)))
            __builtin_trap();
        sg_trainer_destroy(&t);
    } else if (size < EDIT || !strstr(sg_last_error(ctx), path))
        __builtin_trap(); /* one without edits resumes; the message names the file */
    if (sg_mem_current(ctx, SG_MEM_TAGS))
        __builtin_trap();
    sg_ctx_destroy(&ctx);
    return 0;
}
