/* SPDX-License-Identifier: Apache-2.0 */
/* Models of anchors: their start and their files. */
#ifndef SG_MODEL_ANCHORS_H
#define SG_MODEL_ANCHORS_H

#include "columns.h"
#include "core/source.h"

/* Whether a model is one of anchors. */
static inline bool sg_model_has_anchors(const struct sg_model *m)
{
    return m->columns && m->columns->networks;
}

/* SG_ERR_INPUT for a model of anchors: what works on stored Gaussians cannot take it. */
int sg_model_refuse_anchors(sg_ctx *ctx, const struct sg_model *model);
/* SG_ERR_INPUT for all but anchors whose networks have these parts (enum sg_network_part), and the
 * appearances of so many photos. name: of the model, for the message. */
int sg_model_expect_anchors(sg_ctx *ctx, const struct sg_model *model, const char *name,
                            unsigned parts, size_t photos);

/* Networks with the appearances of some photos, all zeros; NULL: SG_ERR_BUDGET. */
struct sg_networks *sg_networks_create(sg_ctx *ctx, size_t photos);
/* All but the appearances that the other has no room for. */
void sg_networks_copy(struct sg_networks *to, const struct sg_networks *from);
/* Moments of Adam become 0: a model that learns anew begins without. */
void sg_networks_forget(struct sg_networks *networks);

/* Gives a model of SH degree 0 the values of anchors beside its parameters, and networks with the
 * appearances of some photos, all zeros. SG_ERR_BUDGET. */
int sg_anchors_add(sg_ctx *ctx, struct sg_model *model, size_t photos);

/* Row i of such a model becomes an anchor. log_unit: of its offsets, on all axes, natural log;
 * log_size: of its Gaussians. */
void sg_anchor_set(struct sg_model *model, size_t i, const float position[3], float log_unit,
                   float log_size);

/* How much of an anchor and its networks is in use. The rest has no effect and does not learn:
 * weights that lead to or from it are 0, and a Gaussian beyond has an opacity of -1, so that no
 * view makes it. 0 = all. */
struct sg_anchor_sizes {
    int offsets, features, hidden, appearance;
};

struct sg_anchor_start {
    float voxel;    /* side of the cells that get an anchor, scene units; 0: the median of the mean
                       squared distances to the 3 nearest points, as the released code does */
    size_t limit;   /* at most so many anchors, at least 4; 0 = any number */
    unsigned parts; /* of the networks: bits of enum sg_network_part */
    size_t photos;  /* of which appearances are learned */
    struct sg_anchor_sizes sizes;
    uint64_t seed; /* of the networks */
};
/* Anchors in the cells that hold a point. *cells: that there are. SG_ERR_INPUT for fewer than 4
 * cells and points that are not finite or beyond all cells; SG_ERR_BUDGET. */
int sg_anchors_init(sg_ctx *ctx, const float *xyz, size_t n, const struct sg_anchor_start *start,
                    size_t *cells, struct sg_model **out);

/* Networks with their moments as numbers, which checkpoints save: weights of parts that are not
 * there are left out if none is. unpack: into networks whose `parts` are set, the rest zeroed. */
size_t sg_networks_floats(unsigned parts, size_t photos);
void sg_networks_pack(const struct sg_networks *networks, float *out);
void sg_networks_unpack(const float *values, struct sg_networks *networks);
/* Whether one of these numbers is a second moment of Adam. */
bool sg_networks_square(unsigned parts, size_t i);
/* Whether all values are. One anchor that is not makes them so: they learn from all. */
bool sg_networks_finite(const struct sg_networks *networks);

/* The cell of a position along an axis, rounded half to even; false: it is not finite or beyond
 * 2^62 cells. */
bool sg_anchor_cell(float position, float size, int64_t *cell);

/* Anchors as the released code writes them, and NETWORKS_FILE beside them. Each file appears whole
 * or not at all, that of the networks first, and none before both are written. SG_ERR_INPUT where
 * the networks are those of other anchors in the folder. */
#define SG_NETWORKS_FILE "networks.safetensors"
int sg_anchors_write(sg_ctx *ctx, const struct sg_model *model, const char *path);
/* SG_ERR_INPUT also for more than max_anchors. */
int sg_anchors_read(sg_ctx *ctx, const char *path, uint64_t max_anchors, struct sg_model **out);
/* Whether a file is a PLY file with anchors, by its header. Errors: as of sg_model_read_ply. */
int sg_anchors_recognise(sg_ctx *ctx, const char *path, bool *found);

#endif
