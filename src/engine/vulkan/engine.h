/* SPDX-License-Identifier: Apache-2.0 */
/* The parts of the Vulkan engine. */
#ifndef SG_VULKAN_ENGINE_H
#define SG_VULKAN_ENGINE_H

#include "engine/host/host_model.h"
#include "engine/ops.h"
#include "lists.h"
#include "spectral/plans.h"

/* The anisotropy loss. */
struct vulkan_spectrum {
    struct vulkan_transform { /* of the newest few image sizes */
        int width, height;
        unsigned used;
        uint32_t w, h, columns; /* the transform's size; columns with coefficients in the band */
        uint32_t longest;       /* points of a line while it is transformed */
        struct gpu_buffer across, down; /* plans of a row and of a column */
        struct gpu_buffer directions;
    } sizes[SG_PLANS];
    unsigned clock;
    struct gpu_buffer coefficients, factors, room;
    struct gpu_buffer energies; /* of sg_vulkan_spectral_gradient, and the magnitude */
};

/* What the values of a view's losses are made of, beside its results. */
struct vulkan_terms {
    uint32_t width, height, bands;
    uint64_t longest;             /* list of a tile, of an image in bands */
    float lambda_dssim, low_pass; /* of the photometric loss that ran */
    bool ran[SG_LOSSES];          /* of the kinds whose values are on the device */
    bool exposed;                 /* and the exposure's gradient */
    bool ascended;                /* and the variation of the ascended image */
    struct sg_anisotropy_params anisotropy;
    double coefficients; /* of its spectrum */
};

/* ---- flow: see vulkan_flow.c ---- */

enum vulkan_stage {
    STAGE_SHAPE,
    STAGE_ANCHORS,
    STAGE_PROJECT,
    STAGE_BIN,
    STAGE_RASTER,
    STAGE_LOSS,
    STAGE_ASCEND_VIEW,
    STAGE_LEARN_EXPOSURES,
    STAGE_COUNT_RADII,
    STAGE_RASTER_BACKWARD,
    STAGE_PROJECT_BACKWARD,
    STAGE_SHAPE_BACKWARD,
    STAGE_OPTIMISE,
    STAGE_BACKWARD_OPTIMISE,
    STAGE_ANCHORS_PULL,
    STAGE_ANCHORS_OPTIMISE,
    STAGE_NETWORKS_LEARN,
    STAGE_EXPLORE
};

/* A call of a stage, with its arguments. */
struct vulkan_call {
    enum vulkan_stage stage;
    union {
        struct {
            struct sg_camera camera;
            int sh_degree;
            struct sg_render_params params;
        } project;
        struct {
            struct sg_target_pixels target;
            struct sg_loss loss;
            float exposure[SG_EXPOSURE];
        } loss;
        struct {
            size_t number;
            struct sg_exposure_update update;
        } exposures;
        struct {
            struct sg_camera camera;
            int appearance;
        } anchors;
        struct {
            bool statistics;
            float volume;
        } pull;
        struct sg_view_ascent ascent;
        struct sg_update update;
        struct sg_network_update networks;
        struct sg_exploration explore;
        const struct sg_shape *shape;
        bool flag;
    };
};

/* Room for a photo that comes and goes, which the device copies from what the host sees. */
struct vulkan_passing {
    struct gpu_buffer seen, photo;
    uint64_t used; /* number of the newest submission that needs it */
};
#define VK_PASSING 0x80000000u /* in the photo of a call: the number of such a room follows */

#define VK_MAPS (3 * 3) /* floats of a pixel: three maps of SSIM of each channel */
#define VK_MAPS_BYTES (4 * VK_MAPS)
#define VK_CALLS 16                /* of a step */
#define VK_STEPS (GPU_FLIGHTS + 3) /* that are remembered */

struct vulkan_flow {
    struct vulkan_step {
        struct vulkan_call calls[VK_CALLS];
        int count;
        uint64_t view;   /* the number of its view, once that is optimised */
        uint64_t number; /* of the submission at its end; 0: it has not ended */
    } steps[VK_STEPS];   /* the oldest first; the last one may be open */
    int count;
    bool again;       /* they are run again */
    bool lost;        /* some could not be, and the model lacks what they learned */
    uint64_t repeats; /* how often that was */
    /* Results of the newest views that were optimised, at their number's place. */
    struct gpu_buffer arrived;
    struct vulkan_arrival {
        uint64_t number, view; /* of the submission, and of the view */
        struct vulkan_terms terms;
    } arrivals[GPU_FLIGHTS + 1];
};

/* Models of anchors: see vulkan_anchors.c. */
struct vulkan_anchors {
    size_t count;
    unsigned parts;                              /* as of struct sg_networks */
    uint32_t photo, photos;                      /* photo: whose appearance the view has */
    struct gpu_buffer at[SG_COLUMNS];            /* of the anchors */
    struct gpu_buffer weights, moment1, moment2; /* as of struct sg_networks */
    struct gpu_buffer networks;                  /* the number of its rate, of each weight */
    struct gpu_buffer looks, look, own;          /* appearances; of a view, with its weights */
    struct gpu_buffer view, exists, opacities;   /* see ARGS_neural */
    struct gpu_buffer drawn;                     /* and behind it the number of anchors */
    struct gpu_buffer places, seen, scan_sums;   /* see ARGS_anchors_list */
    struct gpu_buffer gradient, sums, weight_gradient;
};

struct vulkan_engine {
    struct sg_engine base;
    struct gpu *gpu;
    struct vulkan_flow flow;
    size_t count;
    int planes;
    struct gpu_buffer at[SG_COLUMNS]; /* as sg_host_model.at; without a buffer: zeros */
    struct vulkan_anchors anchors;
    struct gpu_buffer *photos; /* of handle k + 1 */
    size_t cap_photos;
    struct vulkan_passing passing[GPU_FLIGHTS]; /* in turns */
    uint32_t turn;                              /* of the newest photo there */
    sg_photo passed;                            /* its handle, or 0 */
    /* of a view */
    struct sg_camera camera;
    struct sg_render_params params;
    int degree;
    uint32_t width, height;
    struct gpu_lists lists;
    struct gpu_buffer view; /* struct pinhole, and what learn adds to it */
    struct gpu_buffer splats, image, alpha, depth, units, reached, checkpoints;
    struct gpu_buffer gradient, slots, band_sums;
    /* of losses */
    struct gpu_buffer given, target, maps, sums, exposed, exposures, given_exposure;
    struct vulkan_spectrum spectrum;
    struct vulkan_terms terms;
    uint32_t ascended; /* where the last step of sg_vulkan_ascend left its image: 1, 2 */
};

static inline struct vulkan_engine *vulkan_of(struct sg_engine *base)
{
    return (struct vulkan_engine *) base;
}

/* engine_vulkan.c: the stages themselves */
int sg_vulkan_project(struct vulkan_engine *, const struct sg_camera *, int sh_degree,
                      const struct sg_render_params *);
int sg_vulkan_bin(struct vulkan_engine *);
int sg_vulkan_raster(struct vulkan_engine *, bool auxiliary);
int sg_vulkan_raster_backward(struct vulkan_engine *);
int sg_vulkan_project_backward(struct vulkan_engine *, bool statistics);
int sg_vulkan_optimise(struct vulkan_engine *, const struct sg_update *);
int sg_vulkan_backward_optimise(struct vulkan_engine *, const struct sg_update *);
/* Of the view with these terms and results. */
void sg_vulkan_read_results(const struct vulkan_terms *, const uint32_t results[VK_RESULTS],
                            struct sg_step *);

/* vulkan_flow.c */
/* Runs a stage: records it, and remembers the call until what it does is certain. */
int sg_flow_run(struct vulkan_engine *, const struct vulkan_call *);
/* Waits until nothing is left to do, also again. */
int sg_flow_finish(struct sg_engine *);
/* Results that have arrived, of the view with that number or, for 0, of the newest; or false. */
bool sg_flow_arrived(struct vulkan_engine *, uint64_t view, struct sg_step *);

/* vulkan_model.c */
int sg_vulkan_upload(struct sg_engine *, const struct sg_model *, const struct sg_columns *);
int sg_vulkan_download(struct sg_engine *, struct sg_model *, struct sg_columns *);
int sg_vulkan_read_statistics(struct sg_engine *, const struct sg_statistics *);
int sg_vulkan_relocate(struct sg_engine *, const struct sg_relocation *);
int sg_vulkan_explore(struct vulkan_engine *, const struct sg_exploration *);
int sg_vulkan_filter(struct sg_engine *, const struct sg_camera *const *cameras, size_t n,
                     const struct sg_mip_filter *filter);
int sg_vulkan_count_radii(struct vulkan_engine *);
int sg_vulkan_floor_scale(struct sg_engine *, float smallest);
int sg_vulkan_reset_opacity(struct sg_engine *, float limit);
int sg_vulkan_shape(struct sg_engine *, const struct sg_shape *);
int sg_vulkan_shape_backward(struct sg_engine *, const struct sg_shape *);
/* Gaussians whose arrays kernels can index. */
uint64_t sg_vulkan_most(int planes);
int sg_vulkan_check_size(sg_ctx *, size_t count, int planes);
/* The first `planes` planes of the parameters, as the parameters of a host model of that many
 * planes, which is to be cleared, also after an error. */
int sg_vulkan_read_planes(struct vulkan_engine *, int planes, struct sg_host_model *);
/* Makes room for a column, zeroed, unless there is some. */
int sg_vulkan_alloc(struct vulkan_engine *, int column);
/* For all that a checkpoint saves. */
int sg_vulkan_alloc_saved(struct vulkan_engine *);
uint64_t sg_vulkan_column_bytes(const struct vulkan_engine *, int column);
void sg_vulkan_drop_columns(struct vulkan_engine *, unsigned bits); /* but not the parameters */

/* vulkan_anchors.c */
extern const struct sg_anchor_ops sg_vulkan_anchors;
int sg_vulkan_make_view(struct vulkan_engine *, const struct sg_camera *, int appearance);
int sg_vulkan_anchors_pull(struct vulkan_engine *, bool statistics, float volume);
int sg_vulkan_anchors_optimise(struct vulkan_engine *, const struct sg_update *);
int sg_vulkan_networks_learn(struct vulkan_engine *, const struct sg_network_update *);
void sg_vulkan_anchors_clear(struct vulkan_engine *);
/* drawn: of the Gaussians, as of 3DGS. */
struct sg_footprint sg_vulkan_anchors_footprint(const struct sg_work *, struct sg_footprint drawn);

/* vulkan_edit.c */
int sg_vulkan_edit(struct sg_engine *, const struct sg_edit *);

/* vulkan_losses.c */
int sg_vulkan_photo_add(struct sg_engine *, sg_photo, const struct sg_photo_entry *);
void sg_vulkan_photo_drop(struct sg_engine *, sg_photo);
int sg_vulkan_photo_pass(struct sg_engine *, sg_photo, const struct sg_photo_entry *);
int sg_vulkan_loss(struct sg_engine *, const struct sg_target_pixels *, const struct sg_loss *);
int sg_vulkan_set_exposures(struct sg_engine *, const float *values, size_t n);
int sg_vulkan_read_exposures(struct sg_engine *, float *values);
int sg_vulkan_learn_exposures(struct vulkan_engine *, size_t number,
                              const struct sg_exposure_update *);
/* Of the photo. 0: of the image, which is as large, for kernels that load words before they know
 * that they do not need them. */
VkDeviceAddress sg_vulkan_photo_at(const struct vulkan_engine *, sg_photo);
/* The sums of `width` floats over groups of e->sums. */
int sg_vulkan_add_up_to(struct vulkan_engine *, uint64_t groups, uint32_t width,
                        VkDeviceAddress to);
/* The same, to the results. */
int sg_vulkan_add_up(struct vulkan_engine *, uint64_t groups, uint32_t width, uint32_t result);
/* Values of the losses from the results. */
void sg_vulkan_read_losses(const struct vulkan_terms *, const uint32_t results[VK_RESULTS],
                           struct sg_step *);

/* vulkan_ascend.c */
int sg_vulkan_ascend(struct sg_engine *, const struct sg_ascend *);
int sg_vulkan_ascend_view(struct vulkan_engine *, const struct sg_view_ascent *);

/* vulkan_spectrum.c */
int sg_vulkan_anisotropy(struct vulkan_engine *, const struct sg_target_pixels *,
                         const struct sg_loss *);
/* The gradient of the loss of an image of 3 planes, to e->given, which has room for it. *magnitude:
 * the sum of its absolute values. */
int sg_vulkan_spectral_gradient(struct vulkan_engine *, const struct sg_anisotropy_params *,
                                VkDeviceAddress image, uint32_t width, uint32_t height,
                                VkDeviceAddress *magnitude);
/* The loss, from the results. */
double sg_vulkan_anisotropy_of(const struct vulkan_terms *, const uint32_t results[VK_RESULTS]);
void sg_vulkan_spectrum_clear(struct vulkan_engine *);
/* Bytes on the device for a view. */
uint64_t sg_vulkan_spectrum_bytes(uint64_t width, uint64_t height);

#endif
