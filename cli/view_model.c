/* SPDX-License-Identifier: Apache-2.0 */
#include "view_model.h"

#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "commands.h"

bool view_model_fits(const struct sg_model *model, const struct sg_render_params *render)
{
    /* Columns are of variants of 3DGS, which a viewer of 3DGS would draw otherwise. */
    return model && model->count <= VIEW_BROWSER_GAUSSIANS && !model->columns &&
           !render->mip_filter;
}

struct place {
    uint64_t key;
    size_t at;
};

static int by_key(const void *a, const void *b)
{
    const struct place *x = a, *y = b;
    return x->key != y->key ? (x->key > y->key) - (x->key < y->key)
                            : (x->at > y->at) - (x->at < y->at);
}

/* 21 bits, with two zeros between each and the next. */
static uint64_t spread(uint64_t v)
{
    v = (v | v << 32) & 0x1f00000000ffff;
    v = (v | v << 16) & 0x1f0000ff0000ff;
    v = (v | v << 8) & 0x100f00f00f00f00f;
    v = (v | v << 4) & 0x10c30c30c30c30c3;
    return (v | v << 2) & 0x1249249249249249;
}

/* Along a curve through all of space (Morton 1966): the file has one range of positions for 256
 * Gaussians, and the smaller it is the finer are the positions. */
static void sort_places(const struct sg_model *m, struct place *places)
{
    double low[3], step[3];
    for (int k = 0; k < 3; k++) {
        double high = -INFINITY;
        low[k] = INFINITY;
        for (size_t i = 0; i < m->count; i++) {
            const double x = (double) *sg_model_at(m, i, SG_P_XYZ + k);
            low[k] = fmin(low[k], x), high = fmax(high, x);
        }
        step[k] = high > low[k] ? (high - low[k]) / ((1 << 21) - 1) : 1;
    }
    for (size_t i = 0; i < m->count; i++) {
        places[i] = (struct place){.at = i};
        for (int k = 0; k < 3; k++) {
            const double x = (double) *sg_model_at(m, i, SG_P_XYZ + k);
            places[i].key |= spread((uint64_t) ((x - low[k]) / step[k])) << k;
        }
    }
    qsort(places, m->count, sizeof(*places), by_key);
}

static int sorted(sg_ctx *ctx, const struct sg_model *m, struct sg_model **out)
{
    struct place *places = sg_mem_alloc(ctx, SG_MEM_MISC, m->count, sizeof(*places));
    int error = places ? sg_model_create(ctx, m->count, m->sh_degree, out) : SG_ERR_BUDGET;
    if (!error) {
        const int planes = sg_param_count(m->sh_degree);
        sort_places(m, places);
        for (size_t i = 0; i < m->count; i++)
            for (int p = 0; p < planes; p++)
                *sg_model_at(*out, i, p) = *sg_model_at(m, places[i].at, p);
    }
    sg_mem_free(places);
    return error;
}

int view_model_write(sg_ctx *ctx, const struct sg_model *model)
{
    const char *tmp = getenv("TMPDIR");
    struct sg_model *copy = NULL;
    char *folder = NULL, *path = NULL;
    int fd = -1;
    if (asprintf(&folder, "%s/splatguard-XXXXXX", tmp && tmp[0] ? tmp : "/tmp") < 0)
        return -1;
    const bool made = mkdtemp(folder);
    if (!made)
        say(stderr, "warning: %s: %s; the browser gets pictures of the model\n", folder,
            strerror(errno));
    else if (asprintf(&path, "%s/model.compressed.ply", folder) < 0)
        path = NULL;
    else if (sorted(ctx, model, &copy) || sg_model_write(ctx, copy, path, NULL))
        say(stderr, "warning: %s; the browser gets pictures of the model\n", sg_last_error(ctx));
    else
        fd = open(path, O_RDONLY | O_CLOEXEC);
    if (path)
        unlink(path);
    if (made)
        rmdir(folder);
    sg_model_destroy(&copy);
    free(path);
    free(folder);
    return fd;
}
