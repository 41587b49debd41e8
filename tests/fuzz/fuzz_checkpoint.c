/* SPDX-License-Identifier: Apache-2.0 */
/* Checkpoints: a sound one with edits, under a right checksum. Each edit of the input has 8 bytes:
 * where (4), how (1) and what (3). What resumes must be able to train on and to be saved. */
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

enum { SIDE = 16, VIEWS = 2, GAUSSIANS = 20, EDIT = 8, MOST = 1 << 16 };

static uint8_t sound[MOST], changed[MOST];
static size_t sound_size;
static char path[] = "/tmp/sg-fuzz-checkpoint-XXXXXX";
static struct sg_view views[VIEWS];
static uint8_t photo[3 * SIDE * SIDE];
static struct sg_scene scene = {
    .path = (char *) "memory", .train = views, .n_train = VIEWS, .extent = 3};

static sg_ctx *make_context(void)
{
    sg_ctx *ctx;
    if (sg_ctx_create(&ctx, &(struct sg_ctx_params){.threads = 1, .max_memory = 64 << 20}))
        abort();
    return ctx;
}

/* Every state that a checkpoint can have but those of other models. */
static struct sg_train_params parameters(void)
{
    static const float tolerances[VIEWS] = {3, 0};
    struct sg_train_params p = sg_train_params_default();
    p.engine = "cpu";
    p.iterations = 9;
    p.sh_degree = 1;
    p.densify_from_iter = 0;
    p.tolerances = tolerances;
    p.exposure = true;
    return p;
}

static void remove_file(void)
{
    unlink(path);
}

static void make_sound(void)
{
    for (size_t i = 0; i < sizeof(photo); i++)
        photo[i] = (uint8_t) sg_rng_u64(1, SG_RNG_SYNTH, 0, i);
    for (int v = 0; v < VIEWS; v++)
        views[v] = (struct sg_view){
            .name = (char *) "view", .rgb = photo, .camera = front_camera(SIDE, 3 + v)};
    struct sg_train_params p = parameters();
    struct sg_model *m;
    sg_trainer *t;
    sg_ctx *ctx = make_context();
    if (sg_model_create(ctx, GAUSSIANS, 0, &m))
        abort();
    for (size_t i = 0; i < GAUSSIANS; i++)
        for (int k = 0; k < 14; k++)
            *sg_model_at(m, i, k) = 2 * sg_rng_uniform(2, SG_RNG_SYNTH, i, (uint64_t) k) - 1;
    if (close(mkstemp(path)) || sg_trainer_create(ctx, &scene, m, &p, &t))
        abort();
    atexit(remove_file);
    for (int i = 0; i < 3; i++)
        if (sg_trainer_step(t, NULL))
            abort();
    if (sg_trainer_save(t, path))
        abort();
    FILE *f = fopen(path, "rb");
    sound_size = f ? fread(sound, 1, sizeof(sound), f) : 0;
    if (!f || fclose(f) || sound_size < 64 || sound_size == sizeof(sound))
        abort();
    sg_trainer_destroy(&t);
    sg_model_destroy(&m);
    sg_ctx_destroy(&ctx);
}

/* The checkpoint with the edits; returns its size. */
static size_t edit(const uint8_t *data, size_t size)
{
    size_t n = sound_size - sizeof(XXH64_hash_t);
    memcpy(changed, sound, n);
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
    if (!sound_size)
        make_sound();
    struct sg_train_params p = parameters();
    sg_trainer *t;
    sg_ctx *ctx = make_context();
    spill(path, changed, edit(data, size));
    if (!sg_trainer_resume(ctx, &scene, path, &p, &t)) {
        const int code = sg_trainer_step(t, NULL);
        if ((code && code != SG_ERR_INPUT && code != SG_ERR_BUDGET) ||
            (!code && sg_trainer_save(t, path)))
            __builtin_trap();
        sg_trainer_destroy(&t);
    } else if (!strstr(sg_last_error(ctx), path))
        __builtin_trap(); /* the message names the file */
    if (sg_mem_current(ctx, SG_MEM_TAGS))
        __builtin_trap();
    sg_ctx_destroy(&ctx);
    return 0;
}
