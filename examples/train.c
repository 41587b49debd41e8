/* SPDX-License-Identifier: Apache-2.0 */
/* train SCENE MODEL.ply [ITERATIONS]: trains a model, and stops at Ctrl-C with what there is. */
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>

#include <splatguard/splatguard.h>

static volatile sig_atomic_t stop;

static void on_signal(int signal)
{
    (void) signal;
    stop = 1;
}

/* Called on the thread that called the library; what it returns cancels the call. */
static int progress(void *priv, enum sg_stage stage, uint64_t done, uint64_t total)
{
    (void) priv;
    if (stage != SG_STAGE_TRAIN || done % 100 == 0)
        fprintf(stderr, "\r%-8s %llu of %llu ", sg_stage_name(stage), (unsigned long long) done,
                (unsigned long long) total);
    return stop;
}

static void log_line(void *priv, enum sg_log_level level, const char *message)
{
    (void) priv;
    fprintf(stderr, "\r%s%s\n", level == SG_LOG_WARN ? "warning: " : "", message);
}

int main(int argc, char **argv)
{
    if (argc < 3) {
        fprintf(stderr, "usage: train SCENE MODEL.ply [ITERATIONS]\n");
        return 1;
    }
    sg_ctx *ctx = NULL;
    struct sg_scene *scene = NULL;
    sg_trainer *trainer = NULL;
    struct sg_model *model = NULL;
    struct sg_ctx_params options = {0}; /* every default is 0 */
    options.max_memory = UINT64_C(4) << 30;
    options.log = log_line;
    options.log_level = SG_LOG_INFO;
    options.progress = progress;
    struct sg_train_params params = sg_train_params_default();
    params.iterations = argc > 3 ? atoi(argv[3]) : 7000;

    signal(SIGINT, on_signal);
    int code = sg_ctx_create(&ctx, &options);
    if (!code)
        code = sg_scene_load(ctx, argv[1], NULL, &scene);
    if (!code)
        code = sg_trainer_create(ctx, scene, NULL, &params, &trainer);
    while (!code && sg_trainer_iteration(trainer) < params.iterations)
        code = sg_trainer_step(trainer, NULL);
    if (code == SG_ERR_INTERRUPTED && trainer) /* the model so far is a sound one */
        code = SG_OK;
    if (!code)
        code = sg_trainer_model(trainer, &model);
    if (!code)
        code = sg_model_write_ply(ctx, model, argv[2]);
    if (code)
        fprintf(stderr, "\n%s\n", ctx ? sg_last_error(ctx) : "cannot create a context");
    else
        printf("\n%s: %zu Gaussians\n", argv[2], model->count);

    sg_model_destroy(&model);
    sg_trainer_destroy(&trainer);
    sg_scene_destroy(&scene);
    sg_ctx_destroy(&ctx);
    return code ? 1 : 0;
}
