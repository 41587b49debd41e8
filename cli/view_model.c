/* SPDX-License-Identifier: Apache-2.0 */
#include "view_model.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "commands.h"

bool view_model_fits(const struct sg_model *model, const struct sg_render_params *render)
{
    /* Columns are of variants of 3DGS, which a viewer of 3DGS would draw otherwise. */
    return model && model->count <= VIEW_BROWSER_GAUSSIANS && !model->columns &&
           render->mip_kernel == 0;
}

int view_model_write(sg_ctx *ctx, const struct sg_model *model)
{
    const char *tmp = getenv("TMPDIR");
    char *folder = NULL, *path = NULL;
    int fd = -1, error = SG_OK;
    if (asprintf(&folder, "%s/splatguard-XXXXXX", tmp && tmp[0] ? tmp : "/tmp") < 0)
        return -1;
    const bool made = mkdtemp(folder);
    if (!made)
        say(stderr, "warning: %s: %s; the browser gets pictures of the model\n", folder,
            strerror(errno));
    else if (asprintf(&path, "%s/model.compressed.ply", folder) < 0)
        path = NULL;
    else {
        error = sg_model_write(ctx, model, path, NULL);
        if (!error)
            fd = open(path, O_RDONLY | O_CLOEXEC);
    }
    if (error && error != SG_ERR_INTERRUPTED)
        say(stderr, "warning: %s; the browser gets pictures of the model\n", sg_last_error(ctx));
    if (path)
        unlink(path);
    if (made)
        rmdir(folder);
    free(path);
    free(folder);
    return fd;
}
