/* SPDX-License-Identifier: Apache-2.0 */
/* scene_from_memory MODEL.ply: photos are computed, never written; a model is trained on them. */
#include <math.h>
#include <stdio.h>

#include <splatguard/splatguard.h>

enum { SIDE = 64, VIEWS = 12 };

/* At a distance of 4 from the origin, looking at it, turned by an angle. */
static struct sg_camera make_camera(double angle)
{
    const double s = sin(angle), c = cos(angle), x = SIDE / 2.0;
    const struct sg_camera camera = {SIDE,     SIDE, SIDE, SIDE, x, x, {c, 0, s, 0, 1, 0, -s, 0, c},
                                     {0, 0, 4}};
    return camera;
}

/* A ball of radius 1 with stripes of longitude. */
static void take_photo(double angle, uint8_t *rgb)
{
    for (int i = 0; i < SIDE * SIDE; i++, rgb += 3) {
        const double x = (i % SIDE + 0.5) / SIDE - 0.5, y = (i / SIDE + 0.5) / SIDE - 0.5;
        const double a = x * x + y * y + 1, root = 16 - 15 * a;
        const double t = root > 0 ? (4 - sqrt(root)) / a : 0; /* where the ray meets the ball */
        rgb[0] = root > 0 ? (uint8_t) (127 + 120 * sin(4 * (atan2(t - 4, t * x) + angle))) : 0;
        rgb[1] = root > 0 ? (uint8_t) (127 + 100 * t * y) : 0;
        rgb[2] = root > 0 ? 200 : 0;
    }
}

static int make_scene(sg_ctx *ctx, struct sg_scene **scene)
{
    static uint8_t rgb[3 * SIDE * SIDE];
    sg_scene_builder *builder = NULL;
    int code = sg_scene_builder_create(ctx, NULL, &builder);
    for (int k = 0; k < VIEWS && !code; k++) {
        char name[24];
        struct sg_view_desc view = {0};
        snprintf(name, sizeof(name), "view_%d", k);
        view.name = name, view.rgb = rgb, view.camera = make_camera(k * 6.2831853 / VIEWS);
        take_photo(k * 6.2831853 / VIEWS, rgb);
        code = sg_scene_builder_add_view(builder, &view); /* copies name and pixels */
    }
    if (!code)
        code = sg_scene_builder_finish(&builder, scene);
    sg_scene_builder_destroy(&builder); /* one that was not finished */
    return code;
}

int main(int argc, char **argv)
{
    sg_ctx *ctx = NULL;
    struct sg_scene *scene = NULL;
    sg_trainer *trainer = NULL;
    struct sg_model *model = NULL;
    struct sg_train_step step = {0};
    struct sg_train_params params = sg_train_params_default();
    params.iterations = 600, params.init_points = 500;
    int code = argc == 2 ? sg_ctx_create(&ctx, NULL) : SG_ERR_USAGE;
    if (!code)
        code = make_scene(ctx, &scene);
    if (!code)
        code = sg_trainer_create(ctx, scene, NULL, &params, &trainer);
    while (!code && sg_trainer_iteration(trainer) < params.iterations)
        code = sg_trainer_step(trainer, &step);
    if (!code)
        code = sg_trainer_model(trainer, &model);
    if (!code)
        code = sg_model_write_ply(ctx, model, argv[1]);
    if (code)
        fprintf(stderr, "%s\n", ctx ? sg_last_error(ctx) : "usage: scene_from_memory MODEL.ply");
    else
        printf("%s: %zu Gaussians, PSNR %.1f dB\n", argv[1], step.gaussians, step.psnr);
    sg_model_destroy(&model);
    sg_trainer_destroy(&trainer);
    sg_scene_destroy(&scene);
    sg_ctx_destroy(&ctx);
    return code ? 1 : 0;
}
