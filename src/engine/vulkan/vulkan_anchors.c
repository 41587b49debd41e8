/* SPDX-License-Identifier: Apache-2.0 */
/* Anchors and networks of Scaffold-GS on the device (engine/scaffold has the rest). Gaussian k of
 * anchor i is number 10 i + k of the model that is drawn, whether a view makes it or not: so the
 * host knows how many there are. Those that do not exist are left out by the projection, like any
 * that no pixel sees. */
#include <string.h>

#include "engine.h"
#include "math/real_f32.h"

#include "math/projection.h"
#include "model/anchors.h"

_Static_assert(VK_ANCHOR == SG_ANCHOR_GAUSSIANS && VK_A_FEATURES == SG_ANCHOR_FEATURES &&
                   VK_A_FEATURE == SG_A_FEATURE && VK_A_SIZE == SG_A_SIZE &&
                   VK_A_PLANES == SG_A_PLANES && VK_A_STATISTICS == SG_A_STATISTICS &&
                   SG_A_OFFSET == 0 && SG_A_GRADIENT == 0 && SG_A_DRAWN == VK_ANCHOR &&
                   SG_A_OPACITY == 2 * VK_ANCHOR && SG_A_SEEN == 2 * VK_ANCHOR + 1,
               "as shaders/args.h says");
_Static_assert(VK_N_INPUTS == SG_NETWORK_INPUTS && VK_N_HIDDEN == SG_NETWORK_HIDDEN &&
                   VK_N_ALL == SG_HIDDEN && VK_N_OUTPUTS == SG_OUTPUTS &&
                   VK_N_COVARIANCE == SG_O_COVARIANCE && VK_N_COLOUR == SG_O_COLOUR &&
                   VK_N_LOOK == SG_APPEARANCE && SG_BANK_INPUTS == 4 && SG_BANK_OUTPUTS == 3 &&
                   VK_N_PART_DISTANCE == (int) SG_PART_DISTANCE &&
                   VK_N_PART_BANK == (int) SG_PART_BANK,
               "as shaders/args.h says");
_Static_assert(VK_W_OUTPUT == SG_WEIGHT_AT(output) && VK_W_BIAS == SG_WEIGHT_AT(bias) &&
                   VK_W_DISTANCE == SG_WEIGHT_AT(distance) &&
                   VK_W_BANK_INPUT == SG_WEIGHT_AT(bank_input) &&
                   VK_W_BANK_OUTPUT == SG_WEIGHT_AT(bank_output) &&
                   VK_W_BANK_BIAS == SG_WEIGHT_AT(bank_bias) &&
                   VK_W_LOOK == SG_WEIGHT_AT(appearance) && VK_W_ALL == SG_WEIGHTS,
               "as shaders/args.h says");
_Static_assert(sizeof(struct sg_appearance) == 3 * VK_N_LOOK * sizeof(float), "value and moments");

#define WEIGHTS_BYTES (4 * (uint64_t) VK_W_ALL)

static uint64_t column_bytes(const struct vulkan_anchors *a, int column)
{
    return 4 * (uint64_t) sg_blocks(a->count) * SG_LANES *
           (uint64_t) sg_column_array_planes(column, 0);
}

/* A buffer with these bytes, or zeros where `from` is NULL. */
static int put(struct gpu *g, enum sg_mem_tag tag, struct gpu_buffer *b, const void *from,
               uint64_t bytes)
{
    const int code = sg_gpu_reserve(g, tag, b, bytes);
    if (code)
        return code;
    return from ? sg_gpu_write(g, b, 0, from, bytes) : sg_gpu_fill(g, b, 0, bytes, 0);
}

/* A column, zeroed, unless there is one. */
static int need(struct vulkan_engine *e, int column)
{
    struct gpu_buffer *b = &e->anchors.at[column];
    return b->buffer
               ? SG_OK
               : put(e->gpu, sg_column_tag(column), b, NULL, column_bytes(&e->anchors, column));
}

void sg_vulkan_anchors_clear(struct vulkan_engine *e)
{
    struct vulkan_anchors *a = &e->anchors;
    struct gpu_buffer *owned[] = {
        &a->weights, &a->moment1,   &a->moment2,  &a->networks,  &a->looks,          &a->look,
        &a->own,     &a->view,      &a->exists,   &a->opacities, &a->drawn,          &a->places,
        &a->seen,    &a->scan_sums, &a->gradient, &a->sums,      &a->weight_gradient};
    for (size_t i = 0; i < sizeof(owned) / sizeof(owned[0]); i++)
        sg_gpu_release(e->gpu, owned[i]);
    for (int c = 0; c < SG_COLUMNS; c++)
        sg_gpu_release(e->gpu, &a->at[c]);
    a->count = 0;
}

static int put_networks(struct vulkan_engine *e, const struct sg_networks *n)
{
    struct gpu *g = e->gpu;
    struct vulkan_anchors *a = &e->anchors;
    uint32_t networks[VK_W_ALL];
    for (uint32_t i = 0; i < VK_W_ALL; i++)
        networks[i] = (uint32_t) sg_weight_network(i);
    int code;
    a->parts = n->parts, a->photos = (uint32_t) n->photos;
    if ((code = put(g, SG_MEM_MODEL, &a->weights, &n->value, WEIGHTS_BYTES)) ||
        (code = put(g, SG_MEM_OPTIMISER, &a->moment1, &n->moment1, WEIGHTS_BYTES)) ||
        (code = put(g, SG_MEM_OPTIMISER, &a->moment2, &n->moment2, WEIGHTS_BYTES)) ||
        (code = put(g, SG_MEM_OPTIMISER, &a->networks, networks, sizeof(networks))) ||
        (code = put(g, SG_MEM_SPLATS, &a->weight_gradient, NULL, WEIGHTS_BYTES + 4 * VK_N_LOOK)))
        return code;
    if (n->photos && ((code = put(g, SG_MEM_MODEL, &a->looks, n->appearance,
                                  n->photos * sizeof(struct sg_appearance))) ||
                      (code = sg_gpu_reserve(g, SG_MEM_SPLATS, &a->look, 4 * VK_N_LOOK)) ||
                      (code = sg_gpu_reserve(g, SG_MEM_SPLATS, &a->own, WEIGHTS_BYTES))))
        return code;
    return SG_OK;
}

static int upload(struct sg_engine *base, const struct sg_model *m,
                  const struct sg_columns *columns)
{
    struct vulkan_engine *e = vulkan_of(base);
    struct gpu *g = e->gpu;
    struct vulkan_anchors *a = &e->anchors;
    const int planes = sg_param_count(0);
    _Static_assert(VK_A_VALUES <= VK_ANCHOR * VK_SPLAT, "anchors take no more than what is drawn");
    int code = sg_vulkan_check_size(base->ctx, m->count * VK_ANCHOR, planes);
    if (code)
        return code;
    sg_vulkan_anchors_clear(e);
    sg_vulkan_drop_columns(e, ~0u);
    sg_gpu_release(g, &e->at[SG_C_PARAMETERS]);
    a->count = m->count;
    e->count = m->count * VK_ANCHOR;
    e->planes = planes;
    base->sh_degree = 0;
    if ((code = put_networks(e, columns->networks)) ||
        (code = put(g, SG_MEM_MODEL, &e->at[SG_C_PARAMETERS], NULL,
                    sg_vulkan_column_bytes(e, SG_C_PARAMETERS))) ||
        (code = sg_gpu_reserve(g, SG_MEM_MISC, &a->view, 4 * VK_VIEW)) ||
        (code = sg_gpu_reserve(g, SG_MEM_MISC, &a->drawn, 8)) ||
        (code = sg_gpu_reserve(g, SG_MEM_SPLATS, &a->places, 4 * ((uint64_t) a->count + 1))) ||
        (code = sg_gpu_reserve(g, SG_MEM_SPLATS, &a->seen, 4 * (uint64_t) a->count)) ||
        (code = sg_gpu_reserve(g, SG_MEM_SPLATS, &a->exists, 4 * (uint64_t) a->count)) ||
        (code = sg_gpu_reserve(g, SG_MEM_SPLATS, &a->opacities, 4 * (uint64_t) a->count)))
        return code;
    for (int c = 0; c < SG_COLUMNS && !code; c++) {
        const float *from = c == SG_C_PARAMETERS ? m->params : columns->at[c];
        if (from && sg_column_has_array(c))
            code = put(g, sg_column_tag(c), &a->at[c], from, column_bytes(a, c));
    }
    return code ? code : need(e, SG_C_ANCHOR);
}

static int download(struct sg_engine *base, struct sg_model *m, struct sg_columns *columns)
{
    struct vulkan_engine *e = vulkan_of(base);
    struct gpu *g = e->gpu;
    const struct vulkan_anchors *a = &e->anchors;
    struct sg_networks *n = columns->networks;
    int code;
    if ((code = sg_gpu_read(g, &a->weights, 0, &n->value, WEIGHTS_BYTES)) ||
        (code = sg_gpu_read(g, &a->moment1, 0, &n->moment1, WEIGHTS_BYTES)) ||
        (code = sg_gpu_read(g, &a->moment2, 0, &n->moment2, WEIGHTS_BYTES)) ||
        (a->photos && (code = sg_gpu_read(g, &a->looks, 0, n->appearance,
                                          a->photos * sizeof(struct sg_appearance)))))
        return code;
    for (int c = 0; c < SG_COLUMNS && !code; c++) {
        float *to = c == SG_C_PARAMETERS ? m->params : columns->at[c];
        if (to && a->at[c].buffer)
            code = sg_gpu_read(g, &a->at[c], 0, to, column_bytes(a, c));
    }
    return code;
}

/* The weights that a view is drawn with. */
static const struct gpu_buffer *weights_of(const struct vulkan_anchors *a)
{
    return a->parts & SG_PART_APPEARANCE ? &a->own : &a->weights;
}

static int look(struct vulkan_engine *e, const struct gpu_buffer *to, uint32_t back)
{
    const struct vulkan_anchors *a = &e->anchors;
    return GPU_RUN(e->gpu, neural_look, 0, 1, .looks = a->looks.address,
                   .weights = a->weights.address, .look = a->look.address, .to = to->address,
                   .photo = a->photo, .photos = a->photos, .back = back);
}

/* Of the kernels with networks: the parts that they know. The appearance is among the weights. */
static int networks_variant(const struct vulkan_anchors *a)
{
    return (int) (a->parts & (VK_N_PART_DISTANCE | VK_N_PART_BANK));
}

/* Where the length of the list of seen anchors is. */
static VkDeviceAddress seen_count(const struct vulkan_anchors *a)
{
    return a->places.address + 4 * (uint64_t) a->count;
}

/* The list of anchors that the view sees: the networks run on those alone. */
static int list_seen(struct vulkan_engine *e, const struct sg_camera *camera)
{
    struct gpu *g = e->gpu;
    struct vulkan_anchors *a = &e->anchors;
    const uint32_t count = (uint32_t) a->count, numbers[] = {0, count};
    int code = sg_gpu_update(g, &a->drawn, 0, numbers, sizeof(numbers));
    if (!code)
        code = GPU_RUN(g, anchors_see, 0, FOR_EACH(count), .params = a->at[SG_C_PARAMETERS].address,
                       .view = a->view.address, .to = e->at[SG_C_PARAMETERS].address,
                       .exists = a->exists.address, .opacities = a->opacities.address,
                       .places = a->places.address, .count = count,
                       .grid_x = ((uint32_t) camera->width + 15) / 16,
                       .grid_y = ((uint32_t) camera->height + 15) / 16);
    if (!code)
        code = sg_gpu_scan(g, &a->scan_sums, &a->places, &a->places, a->drawn.address + 4, count);
    return code ? code
                : GPU_RUN(g, anchors_list, 0, FOR_EACH(count), .exists = a->exists.address,
                          .places = a->places.address, .seen = a->seen.address, .count = count);
}

int sg_vulkan_make_view(struct vulkan_engine *e, const struct sg_camera *camera, int appearance)
{
    struct gpu *g = e->gpu;
    struct vulkan_anchors *a = &e->anchors;
    const struct pinhole view = view_make(camera);
    int code = sg_gpu_update(g, &a->view, 0, &view, sizeof(view));
    a->photo = appearance >= 0 && (uint32_t) appearance < a->photos ? (uint32_t) appearance
               : appearance == SG_APPEARANCE_ZERO                   ? VK_NO_LOOK
                                                                    : UINT32_MAX;
    for (int c = SG_C_GRAD_SUM; c <= SG_C_GRAD_COUNT && !code; c++)
        if (e->at[c].buffer)
            code = sg_gpu_fill(g, &e->at[c], 0, sg_vulkan_column_bytes(e, c), 0);
    if (!code && a->parts & SG_PART_APPEARANCE &&
        !(code = sg_gpu_copy(g, &a->weights, 0, &a->own, 0, WEIGHTS_BYTES)))
        code = look(e, &a->own, 0);
    if (!code)
        code = list_seen(e, camera);
    return code ? code
                : GPU_RUN(g, neural, networks_variant(a), sg_blocks(a->count),
                          .params = a->at[SG_C_PARAMETERS].address,
                          .anchors = a->at[SG_C_ANCHOR].address, .weights = weights_of(a)->address,
                          .view = a->view.address, .to = e->at[SG_C_PARAMETERS].address,
                          .seen = a->seen.address, .seen_count = seen_count(a),
                          .exists = a->exists.address, .opacities = a->opacities.address,
                          .drawn = a->drawn.address, .count = (uint32_t) a->count);
}

static int read_exists(struct sg_engine *base, uint32_t *exists)
{
    struct vulkan_engine *e = vulkan_of(base);
    return sg_gpu_read(e->gpu, &e->anchors.exists, 0, exists, 4 * (uint64_t) e->anchors.count);
}

/* Invocations of a kernel with one for each of `values` values of an anchor. */
static uint64_t each_value(const struct vulkan_anchors *a, uint64_t values)
{
    return FOR_EACH(sg_blocks(a->count) * SG_LANES * values);
}

int sg_vulkan_anchors_pull(struct vulkan_engine *e, bool statistics, float volume)
{
    struct gpu *g = e->gpu;
    struct vulkan_anchors *a = &e->anchors;
    const uint64_t blocks = sg_blocks(a->count),
                   pieces = blocks < VK_A_PIECES ? blocks : VK_A_PIECES;
    int code;
    if ((code =
             sg_gpu_reserve(g, SG_MEM_SPLATS, &a->gradient, 4 * blocks * SG_LANES * VK_A_VALUES)) ||
        (code = sg_gpu_reserve(g, SG_MEM_SPLATS, &a->sums, 4 * pieces * VK_W_LOOK)))
        return code;
    code =
        GPU_RUN(g, neural_backward, networks_variant(a), pieces,
                .params = a->at[SG_C_PARAMETERS].address, .anchors = a->at[SG_C_ANCHOR].address,
                .weights = weights_of(a)->address, .view = a->view.address,
                .made = e->at[SG_C_PARAMETERS].address, .from = e->at[SG_C_GRADIENT].address,
                .seen = a->seen.address, .seen_count = seen_count(a), .exists = a->exists.address,
                .drawn = a->drawn.address, .gradient = a->gradient.address, .sums = a->sums.address,
                .count = (uint32_t) a->count, .pieces = (uint32_t) pieces, .volume = volume);
    if (!code)
        code = GPU_RUN(g, piece_sums, 0, FOR_EACH(VK_W_LOOK), .from = a->sums.address,
                       .to = a->weight_gradient.address, .count = (uint32_t) pieces,
                       .width = VK_W_LOOK);
    if (!code && a->parts & SG_PART_APPEARANCE)
        code = look(e, &a->weight_gradient, 1);
    if (!code && statistics && !(code = need(e, SG_C_ANCHOR_STATISTICS)))
        code = GPU_RUN(g, anchors_count, 0, each_value(a, VK_A_STATISTICS),
                       .exists = a->exists.address, .opacities = a->opacities.address,
                       .grad_sum = e->at[SG_C_GRAD_SUM].address,
                       .grad_count = e->at[SG_C_GRAD_COUNT].address,
                       .statistics = a->at[SG_C_ANCHOR_STATISTICS].address, .stop = g->stop.address,
                       .count = (uint32_t) a->count);
    return code;
}

int sg_vulkan_anchors_optimise(struct vulkan_engine *e, const struct sg_update *u)
{
    const struct vulkan_anchors *a = &e->anchors;
    int code;
    if (!u->adam)
        return SG_OK;
    if ((code = need(e, SG_C_MOMENT1)) || (code = need(e, SG_C_MOMENT2)) ||
        (code = need(e, SG_C_ANCHOR_MOMENT1)) || (code = need(e, SG_C_ANCHOR_MOMENT2)))
        return code;
    return GPU_RUN(e->gpu, anchors_learn, 0, each_value(a, VK_A_VALUES),
                   .exists = a->exists.address, .gradient = a->gradient.address,
                   .params = a->at[SG_C_PARAMETERS].address, .m = a->at[SG_C_MOMENT1].address,
                   .v = a->at[SG_C_MOMENT2].address, .anchors = a->at[SG_C_ANCHOR].address,
                   .anchor_m = a->at[SG_C_ANCHOR_MOMENT1].address,
                   .anchor_v = a->at[SG_C_ANCHOR_MOMENT2].address, .stop = e->gpu->stop.address,
                   .count = (uint32_t) a->count, .rate_scale = u->rate[SG_G_SCALE],
                   .rate_offset = u->rate[SG_G_OFFSET], .rate_feature = u->rate[SG_G_FEATURE],
                   .root_scale = u->root[SG_G_SCALE], .root_offset = u->root[SG_G_OFFSET],
                   .root_feature = u->root[SG_G_FEATURE]);
}

int sg_vulkan_networks_learn(struct vulkan_engine *e, const struct sg_network_update *u)
{
    const struct vulkan_anchors *a = &e->anchors;
    return GPU_RUN(e->gpu, networks_learn, 0, FOR_EACH(VK_W_ALL + (uint64_t) a->photos * VK_N_LOOK),
                   .networks = a->networks.address, .gradient = a->weight_gradient.address,
                   .weights = a->weights.address, .m = a->moment1.address, .v = a->moment2.address,
                   .looks = sg_gpu_at(e->gpu, &a->looks), .stop = e->gpu->stop.address,
                   .photo = a->photo, .photos = a->photos, .rate0 = u->rate[SG_N_OPACITY],
                   .rate1 = u->rate[SG_N_COVARIANCE], .rate2 = u->rate[SG_N_COLOUR],
                   .rate3 = u->rate[SG_N_BANK], .rate4 = u->rate[SG_N_APPEARANCE], .root = u->root);
}

/* Of the anchors that have a Gaussian, from blocks of VK_A_VALUES planes. */
static void spread(const struct vulkan_anchors *a, const uint32_t *exists, const float *values,
                   struct sg_model *out, float *anchor)
{
    for (size_t i = 0; i < a->count; i++)
        for (int p = 0; p < VK_A_VALUES && exists[i] & (VK_A_SEEN - 1); p++) {
            const float v = values[sg_param_index(VK_A_VALUES, i, p)];
            if (p < 3)
                *sg_model_at(out, i, SG_P_SCALE + p) = v;
            else if (anchor)
                anchor[sg_param_index(SG_A_PLANES, i, p - 3)] = v;
        }
}

static int read_gradients(struct sg_engine *base, struct sg_model *out)
{
    struct vulkan_engine *e = vulkan_of(base);
    struct gpu *g = e->gpu;
    const struct vulkan_anchors *a = &e->anchors;
    const size_t blocks = sg_blocks(a->count);
    float *anchor = out->columns ? out->columns->at[SG_C_ANCHOR] : NULL, look_gradient[VK_N_LOOK];
    struct sg_networks *n = out->columns ? out->columns->networks : NULL;
    uint32_t *exists = sg_alloc_raw(base->ctx, SG_MEM_SPLATS, a->count, sizeof(*exists));
    float *values =
        sg_alloc_raw(base->ctx, SG_MEM_SPLATS, blocks, VK_A_VALUES * SG_LANES * sizeof(*values));
    int code = exists && values ? SG_OK : SG_ERR_BUDGET;
    memset(out->params, 0, blocks * SG_LANES * (size_t) e->planes * sizeof(float));
    if (anchor)
        memset(anchor, 0, column_bytes(a, SG_C_ANCHOR));
    if (!code)
        code = sg_gpu_read(g, &a->exists, 0, exists, 4 * (uint64_t) a->count);
    if (!code)
        code = sg_gpu_read(g, &a->gradient, 0, values, 4 * blocks * SG_LANES * VK_A_VALUES);
    if (!code)
        spread(a, exists, values, out, anchor);
    if (!code && n)
        code = sg_gpu_read(g, &a->weight_gradient, 0, &n->value, WEIGHTS_BYTES);
    if (!code && n)
        code = sg_gpu_read(g, &a->weight_gradient, WEIGHTS_BYTES, look_gradient,
                           sizeof(look_gradient));
    for (size_t photo = 0; !code && n && photo < n->photos; photo++)
        for (int k = 0; k < SG_APPEARANCE; k++)
            n->appearance[photo].value[k] = photo == a->photo ? look_gradient[k] : 0;
    sg_free(exists);
    sg_free(values);
    return code;
}

/* ---- the stages, as callers run them ---- */

static int make_view(struct sg_engine *base, const struct sg_camera *camera, int appearance)
{
    return sg_flow_run(vulkan_of(base), &(struct vulkan_call){.stage = STAGE_ANCHORS,
                                                              .anchors = {*camera, appearance}});
}

static int pull(struct sg_engine *base, bool statistics, float volume)
{
    return sg_flow_run(vulkan_of(base), &(struct vulkan_call){.stage = STAGE_ANCHORS_PULL,
                                                              .pull = {statistics, volume}});
}

static int optimise(struct sg_engine *base, const struct sg_update *u)
{
    return sg_flow_run(vulkan_of(base),
                       &(struct vulkan_call){.stage = STAGE_ANCHORS_OPTIMISE, .update = *u});
}

static int learn(struct sg_engine *base, const struct sg_network_update *u)
{
    return sg_flow_run(vulkan_of(base),
                       &(struct vulkan_call){.stage = STAGE_NETWORKS_LEARN, .networks = *u});
}

const struct sg_anchor_ops sg_vulkan_anchors = {.upload = upload,
                                                .download = download,
                                                .make_view = make_view,
                                                .read_exists = read_exists,
                                                .pull = pull,
                                                .optimise = optimise,
                                                .learn = learn,
                                                .read_gradients = read_gradients};

/* The columns of an anchor, shared by its Gaussians, with its gradient and what a view makes of it;
 * the drawn ones themselves have no moments, which `drawn` counts. */
struct sg_footprint sg_vulkan_anchors_footprint(const struct sg_work *w, struct sg_footprint drawn)
{
    struct sg_work own = *w;
    own.sh_degree = 0;
    const uint64_t anchor = sg_host_footprint(&own, false) + 4 * (VK_A_VALUES + 4);
    drawn.gaussian += (anchor + VK_ANCHOR - 1) / VK_ANCHOR;
    drawn.view += 4 * (uint64_t) VK_A_PIECES * VK_W_LOOK + 8 * WEIGHTS_BYTES;
    drawn.photo += sizeof(struct sg_appearance); /* also where none is learned */
    return drawn;
}
