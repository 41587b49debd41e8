/* SPDX-License-Identifier: Apache-2.0 */
/* audit SCENE: tells poisoned photos from clean ones. Exit status 5: the scene is poisoned. */
#include <stdio.h>

#include <splatguard/splatguard.h>

static void print(const struct sg_audit *audit)
{
    for (size_t i = 0; i < audit->count; i++) {
        const struct sg_audit_image *image = &audit->images[i];
        if (image->verdict == SG_AUDIT_CLEAN)
            continue;
        printf("%s: %s, score %.3f, amplitude %.1f +- %.1f grey levels\n", image->name,
               sg_audit_verdict_name(image->verdict), image->score, image->tau, image->tau_error);
    }
    printf("scene: %s, score %.3f, %zu of %zu photos poisoned\n",
           sg_audit_verdict_name(audit->verdict), audit->score, audit->verdicts[SG_AUDIT_POISONED],
           audit->count);
    for (size_t i = 0; i < audit->count_reasons; i++)
        printf("  %s\n", audit->reasons[i]);
}

int main(int argc, char **argv)
{
    if (argc != 2) {
        fprintf(stderr, "usage: audit SCENE\n");
        return 1;
    }
    sg_ctx *ctx = NULL;
    struct sg_scene *scene = NULL;
    struct sg_audit *audit = NULL;

    int code = sg_ctx_create(&ctx, NULL);
    if (!code)
        code = sg_scene_load(ctx, argv[1], NULL, &scene);
    if (!code)
        code = sg_audit_scene(ctx, scene, &audit);
    if (!code)
        print(audit);
    else
        fprintf(stderr, "%s\n", ctx ? sg_last_error(ctx) : "cannot create a context");
    const int status = code ? 1 : audit->verdict == SG_AUDIT_POISONED ? 5 : 0;

    sg_audit_destroy(&audit);
    sg_scene_destroy(&scene);
    sg_ctx_destroy(&ctx);
    return status;
}
