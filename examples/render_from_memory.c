/* SPDX-License-Identifier: Apache-2.0 */
/* render_from_memory OUT.ppm: a model is made from arrays, rendered, and written as a picture. */
#include <stdio.h>

#include <splatguard/splatguard.h>

enum { WIDTH = 160, HEIGHT = 120, SPOTS = 3 };

/* Three fat Gaussians: red, green and blue. Values are as stored, before activation. */
static int make_model(sg_ctx *ctx, struct sg_model **model)
{
    static const float position[] = {-0.8f, 0, 0, 0, 0.6f, 0.3f, 0.8f, -0.3f, 0};
    static const float scale[] = {-1, -1.5f, -1, -1, -1, -1.5f, -1.5f, -1, -1}; /* natural log */
    static const float rotation[] = {1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0};       /* w x y z */
    static const float opacity[] = {3, 3, 3};                                   /* logit */
    static const float colour[] = {1.5f, -1.5f, -1.5f, -1.5f, 1.5f, -1.5f, -1.5f, -1.5f, 1.5f};
    int code = sg_model_create(ctx, SPOTS, 0, model);
    if (!code)
        code = sg_model_set_array(ctx, *model, "position", position, 0);
    if (!code)
        code = sg_model_set_array(ctx, *model, "scale", scale, 0);
    if (!code)
        code = sg_model_set_array(ctx, *model, "rotation", rotation, 0);
    if (!code)
        code = sg_model_set_array(ctx, *model, "opacity", opacity, 0);
    return code ? code : sg_model_set_array(ctx, *model, "sh_dc", colour, 0);
}

static int write_ppm(const char *path, const uint8_t *rgb)
{
    FILE *f = fopen(path, "wb");
    if (!f)
        return -1;
    fprintf(f, "P6\n%d %d\n255\n", WIDTH, HEIGHT);
    fwrite(rgb, 3, (size_t) WIDTH * HEIGHT, f);
    const int failed = ferror(f);
    return fclose(f) || failed ? -1 : 0;
}

int main(int argc, char **argv)
{
    static float planes[3 * WIDTH * HEIGHT];
    static uint8_t rgb[3 * WIDTH * HEIGHT];
    if (argc != 2) {
        fprintf(stderr, "usage: render_from_memory OUT.ppm\n");
        return 1;
    }
    sg_ctx *ctx = NULL;
    struct sg_model *model = NULL;
    sg_renderer *renderer = NULL;
    struct sg_camera camera = {
        WIDTH, HEIGHT, 140, 140, WIDTH / 2, HEIGHT / 2, {1, 0, 0, 0, 1, 0, 0, 0, 1}, {0, 0, 4}};

    int code = sg_ctx_create(&ctx, NULL);
    if (!code)
        code = make_model(ctx, &model);
    if (!code)
        code = sg_renderer_create(ctx, NULL, NULL, model, NULL, &renderer);
    if (!code)
        code = sg_render(renderer, &camera, planes, NULL, NULL, NULL);
    if (code) {
        fprintf(stderr, "%s\n", ctx ? sg_last_error(ctx) : "cannot create a context");
    } else {
        sg_quantise(planes, WIDTH, HEIGHT, rgb);
        if ((code = write_ppm(argv[1], rgb)))
            perror(argv[1]);
    }
    sg_renderer_destroy(&renderer);
    sg_model_destroy(&model);
    sg_ctx_destroy(&ctx);
    return code ? 1 : 0;
}
