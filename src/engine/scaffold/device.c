/* SPDX-License-Identifier: Apache-2.0 */
/* Anchors and networks that learn where the engine is that draws. The host has a copy, which it
 * reads and edits: it plans growth. */
#include "model/anchors.h"
#include "state.h"

/* The copy. */
static struct sg_columns columns_of(const struct scaffold_engine *b, struct sg_model *m)
{
    const struct sg_host_model *h = &b->anchors;
    struct sg_columns c = {.networks = b->networks};
    for (int k = 0; k < SG_COLUMNS; k++)
        c.at[k] = k == SG_C_PARAMETERS ? NULL : h->at[k];
    *m = (struct sg_model){
        .count = h->count, .capacity = h->capacity, .params = h->at[SG_C_PARAMETERS]};
    return c;
}

int sg_scaffold_fetch(struct scaffold_engine *b)
{
    const int learned[] = {SG_C_MOMENT1, SG_C_MOMENT2, SG_C_ANCHOR_MOMENT1, SG_C_ANCHOR_MOMENT2,
                           SG_C_ANCHOR_STATISTICS};
    struct sg_model m;
    if (!b->device_newer)
        return SG_OK;
    for (size_t k = 0; k < sizeof(learned) / sizeof(learned[0]); k++)
        if (sg_host_alloc(b->base.ctx, &b->anchors, learned[k]))
            return SG_ERR_BUDGET;
    struct sg_columns c = columns_of(b, &m);
    int code = sg_scaffold_wait(b);
    if (!code)
        code = b->device->download(b->inner, &m, &c);
    b->device_newer = code != SG_OK;
    return code;
}

int sg_scaffold_device_view(struct scaffold_engine *b, const struct sg_camera *camera,
                            int appearance)
{
    if (b->host_newer) {
        struct sg_model m;
        const struct sg_columns c = columns_of(b, &m);
        int code = sg_scaffold_wait(b);
        if (!code)
            code = b->device->upload(b->inner, &m, &c);
        if (code)
            return code;
        b->host_newer = false;
    }
    return b->device->make_view(b->inner, camera, appearance);
}

int sg_scaffold_device_pull(struct scaffold_engine *b, bool statistics)
{
    struct sg_engine *inner = b->inner;
    int code = inner->ops->project_backward(inner, statistics);
    if (!code)
        code = b->device->pull(inner, statistics, b->base.volume);
    b->device_newer |= statistics;
    return code;
}

int sg_scaffold_device_optimise(struct scaffold_engine *b, const struct sg_update *u)
{
    b->device_newer |= u->adam;
    return b->device->optimise(b->inner, u);
}

int sg_scaffold_device_learn(struct scaffold_engine *b, const struct sg_network_update *u)
{
    b->device_newer = true;
    return b->device->learn(b->inner, u);
}
