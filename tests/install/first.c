/* SPDX-License-Identifier: Apache-2.0 */
#include <splatguard/splatguard.h>
#include <stdio.h>
#include <string.h>

int main(void)
{
    char version[32]; /* of the headers: the library's is another where they do not belong
                       * together */
    snprintf(version, sizeof(version), "%d.%d.%d", SG_VERSION_MAJOR, SG_VERSION_MINOR,
             SG_VERSION_PATCH);
    if (strcmp(version, sg_version()))
        return 2;
    sg_ctx *ctx = NULL;
    struct sg_model *model = NULL;
    int rc = sg_ctx_create(&ctx, NULL);
    if (rc == SG_OK)
        rc = sg_model_init_random(ctx, 1000, 1.3f, 1, 3, &model);
    printf("splatguard %s: %zu Gaussians\n", sg_version(), model ? model->count : (size_t) 0);
    sg_model_destroy(&model);
    sg_ctx_destroy(&ctx);
    return rc == SG_OK ? 0 : 1;
}
