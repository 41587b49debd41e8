/* SPDX-License-Identifier: Apache-2.0 */
/* The engine: it draws a model of Gaussians and learns it. Where that is computed is decided when
 * one is created.
 *
 * One iteration calls project, bin, raster, losses, raster_backward, project_backward and optimise,
 * in this order; then read_step waits for its results. The engine holds the model, the state of its
 * optimiser and the buffers of one view. Host memory crosses only where a function says so. Calls
 * that come out of order fail with SG_ERR_INTERNAL and change nothing. All other errors are
 * SG_ERR_BUDGET, unless a function says more. Thread safety: unsafe. */
#ifndef SG_ENGINE_H
#define SG_ENGINE_H

#include "core/context.h"
#include "losses.h"
#include "math/exposure.h"
#include "model/columns.h"
#include "splatguard/camera.h"
#include "splatguard/model.h"
#include "splatguard/render.h"

struct sg_engine;
struct sg_anisotropy; /* spectral/anisotropy.h */

/* ---- creation ---- */

/* name: of an engine ("cpu", "vulkan", "ref") or "auto", NULL = "auto"; variant: of the CPU's
 * kernels, NULL = the best this machine runs. "auto" with a variant is "cpu". SG_ERR_USAGE for one
 * that is not known or does not run here. */
int sg_engine_check(sg_ctx *ctx, const char *name, const char *variant);
int sg_engine_create(sg_ctx *ctx, const char *name, const char *variant, struct sg_engine **out);
/* Whether these two leave the choice between the CPU and a device to the library. */
bool sg_engine_is_auto(const char *name, const char *variant);
/* After a failure with this code, when the engine is destroyed: whether the library has chosen a
 * device that has too little memory. Then "auto" means the CPU from here on, the log says so, and
 * the error is cleared: try again. */
bool sg_engine_give_way(sg_ctx *ctx, const char *name, const char *variant, int code);
void sg_engine_destroy(struct sg_engine **engine);
sg_ctx *sg_engine_ctx(const struct sg_engine *e);
const char *
sg_engine_variant(const struct sg_engine *e); /* "avx512", "ref", ...: what really runs */

/* The host memory that an engine needs for a shape of work: bytes at the worst moment of an
 * iteration or an edit. */
struct sg_work {
    int sh_degree;
    bool accumulate; /* see sg_update */
    bool anisotropy; /* the losses have one */
    bool exposure;   /* targets have one */
    bool mip;        /* with the filters of Mip-Splatting */
    bool anchors;    /* Gaussians are made of anchors, in each view anew */
    bool low_pass;   /* the photometric loss has that term */
    bool radii;      /* the largest radii on the screen count */
    bool grace;      /* anchors know when they were made */
    int width, height, threads;
};
/* The work of the engine that draws: anchors are drawn as Gaussians of SH degree 0. */
static inline struct sg_work sg_work_drawn(const struct sg_work *work)
{
    struct sg_work drawn = *work;
    drawn.sh_degree = work->anchors ? 0 : work->sh_degree;
    drawn.anchors = false;
    return drawn;
}
struct sg_footprint {
    uint64_t gaussian; /* one of the model: parameters, optimiser, projection */
    uint64_t instance; /* one (Gaussian, tile) pair held at once */
    uint64_t largest;  /* of a device: of a Gaussian in the array that has most of it */
    uint64_t most;     /* of a device: Gaussians that kernels can index */
    uint64_t view;     /* the buffers of an image of this size */
    uint64_t map;      /* of a device: the largest of these */
    uint64_t photo;    /* a photo of this size, beside the pixels that the scene holds */
    uint64_t passing;  /* all photos of this size that come and go, see sg_engine_photo_pass */
};
struct sg_engine_kind; /* see registry.h */
struct sg_footprint sg_engine_footprint(const struct sg_engine_kind *engine,
                                        const struct sg_work *work);
/* The same in the memory of its device, whose limit and use are in the context's ledger
 * (core/vram.h) once the engine is created. Returns false for an engine without a device. */
bool sg_engine_on_device(const struct sg_engine_kind *engine, const struct sg_work *work,
                         struct sg_footprint *out);

/* ---- the model ---- */

/* Host to engine. columns: what there is beside the parameters; a column without an array, or all
 * where it is NULL, is zeros. */
int sg_engine_upload(struct sg_engine *e, const struct sg_model *model,
                     const struct sg_columns *columns);
/* The same, and takes the arrays of both, so that a host never holds them twice. */
int sg_engine_adopt(struct sg_engine *e, struct sg_model *model, struct sg_columns *columns);
/* Engine to host, objects of the present count and SH degree. What is NULL, an object or an array,
 * is left out. SG_ERR_INPUT for networks with weights that are not finite. */
int sg_engine_download(struct sg_engine *e, struct sg_model *model, struct sg_columns *columns);
size_t sg_engine_count(const struct sg_engine *e);
/* Gaussians that one of the model can be drawn as: more than 1, if it is an anchor. */
size_t sg_engine_each(const struct sg_engine *e);

/* Statistics of the Gaussians. Each pointer that is not NULL receives `count` floats. */
struct sg_statistics {
    float *gradient;     /* mean of the statistic since the last edit */
    float *opacity;      /* activated */
    float *largest;      /* of the three scales, activated */
    float *log_smallest; /* of the three scales, its logarithm: as stored */
    float *radius;       /* largest on the screen, as sg_engine_count_radii has counted, pixels */
    float *absolute;     /* with SG_GRADIENT_MIP: mean of the sums of absolute gradients */
};
/* What densification counts of a view: the norm of the gradient of a splat's position (NDC), or of
 * its sums over the pixels of absolute gradients along x and y (Ye et al. 2024), in which noise
 * does not cancel. */
enum sg_gradient_statistic {
    SG_GRADIENT_NORM,
    SG_GRADIENT_ABSOLUTE,
    /* The norm, and beside it the sums of absolute gradients along x and y, added. Only for views
     * with mip_kernel. */
    SG_GRADIENT_MIP
};
/* From the next raster_backward on; SG_GRADIENT_NORM by default. SG_ERR_USAGE for an engine that
 * does not count absolute gradients. */
int sg_engine_set_statistic(struct sg_engine *e, enum sg_gradient_statistic statistic);
/* Engine to host. */
int sg_engine_read_statistics(struct sg_engine *e, const struct sg_statistics *out);

/* Of a model of anchors: weight in the loss of the mean product of the drawn Gaussians' scales,
 * SG_ANCHOR_VOLUME by default. */
void sg_engine_set_volume(struct sg_engine *e, float weight);

/* A change of the set of Gaussians: survivors in their order, then appended Gaussians in theirs.
 * The engine reorders models of a few thousand Gaussians or more; the new order depends on the
 * model and the edit only. The table of columns (model/columns.h) says what becomes of each. */
struct sg_edit {
    const uint8_t *keep; /* one byte per present Gaussian */
    size_t kept;         /* number of non-zero bytes */
    size_t appended;
    const uint32_t *source; /* appended entries: index before the edit, or of a row to insert */
    const uint8_t *kind;    /* enum sg_edit_kind: copy, child or insert */
    const struct sg_model *rows; /* parameters of inserted ones; of the SH degree of the model */
    bool statistics;             /* survivors keep their statistics; false: all are cleared */
    uint64_t seed, stream; /* of the children's positions: normal (seed, SG_RNG_SPLIT, stream, 3
                              entry + axis) */
};
/* Applies the edit to all columns. Where memory runs out the model is as it was, or edited and left
 * with the columns that it needs (sg_column_is_needed). SG_ERR_USAGE for an appended entry that
 * names no Gaussian and no row. */
int sg_engine_edit(struct sg_engine *e, const struct sg_edit *edit);
/* Scales = max(scales, smallest), activated. */
int sg_engine_floor_scale(struct sg_engine *e, float smallest);
/* opacity = min(opacity, limit), as it is drawn with the shape; zeroes the opacity moments. */
int sg_engine_reset_opacity(struct sg_engine *e, float limit);

/* Gaussians that change in place, one entry after the other: number `to` takes all parameters of
 * number `from`, which may be itself, then the opacity, and `scale` is added to its scales, as
 * stored. fresh: its moments become 0. */
struct sg_relocation {
    size_t count;
    const uint32_t *to, *from;
    const float *opacity, *scale;
    const uint8_t *fresh;
};
/* SG_ERR_USAGE for a number that no Gaussian has, or an engine that has no such operation. */
int sg_engine_relocate(struct sg_engine *e, const struct sg_relocation *relocation);

/* Noise on the positions that explores where a Gaussian is nearly transparent (Kheradmand et al.
 * 2024): position += amount / (1 + exp(gate (opacity - dead))) covariance n, with n normal (seed,
 * SG_RNG_EXPLORE, stream, 3 index + axis). */
struct sg_exploration {
    float amount, gate, dead;
    uint64_t seed, stream;
};
/* SG_ERR_USAGE for an engine that has no such operation. */
int sg_engine_explore(struct sg_engine *e, const struct sg_exploration *exploration);

/* The 3D filter of Mip-Splatting (Yu et al. 2024, section 5.1), in SG_C_FILTER: no Gaussian is
 * drawn with details that none of these cameras could see. SG_ERR_USAGE for an engine that has
 * none. */
struct sg_mip_filter {
    double variance, margin; /* of struct sg_mip_params */
};
int sg_engine_filter(struct sg_engine *e, const struct sg_camera *const *cameras, size_t n,
                     const struct sg_mip_filter *filter);

/* Of a model of anchors (Scaffold-GS, Lu et al. 2024), after its growth: statistics of Gaussians
 * that were drawn in more than `drawn` views begin anew, and those of anchors that were seen in
 * more than `seen`. No size of an anchor, as stored, is larger than `log_largest`. SG_ERR_USAGE for
 * an engine that has none. */
struct sg_settling {
    float drawn, seen, log_largest;
};
int sg_engine_settle(struct sg_engine *e, const struct sg_settling *settling);

/* Hides Gaussians of anchors for good: no view makes them any more. hidden: of each anchor a bit
 * for each of its Gaussians. SG_ERR_USAGE for an engine that has none. */
int sg_engine_hide(struct sg_engine *e, const uint32_t *hidden);

/* One Adam step of the weights of each network, by the gradients of the view that was optimised
 * last, before the model is edited: see struct sg_update. SG_ERR_USAGE for an engine without
 * networks. */
struct sg_network_update {
    float rate[SG_NETWORK_RATES], root;
};
int sg_engine_learn_networks(struct sg_engine *e, const struct sg_network_update *update);

/* A step between parameters and projection: it computes what is drawn in place of the parameters of
 * SG_LANES Gaussians. params, shaped and gradients are blocks of `planes` planes, laid out as in
 * sg_model.params. */
struct sg_shape {
    const char *name;
    const void *arg; /* of the functions */
    int column;      /* of one plane, whose values the functions get; SG_COLUMNS: none */
    void (*forward)(const void *arg, const float *params, const float *column, int planes,
                    float *shaped);
    /* gradients: of the output of `forward`; replaced by those of the parameters. */
    void (*backward)(const void *arg, const float *params, const float *column, int planes,
                     float *gradients);
};
/* Until it is called the parameters are drawn as they are; it cannot be undone. shape: borrowed.
 * SG_ERR_USAGE for an engine that has no such stage. */
int sg_engine_set_shape(struct sg_engine *e, const struct sg_shape *shape);

/* ---- photos ---- */

/* Targets are handed over once and named by a handle; 0 is none. rgb: height x width x 3; mask:
 * height x width, where 0 is a pixel that does not count, or NULL. Both must stay as they are until
 * photo_drop. */
typedef uint32_t sg_photo;
int sg_engine_photo_add(struct sg_engine *e, int width, int height, const uint8_t *rgb,
                        const uint8_t *mask, sg_photo *out);
/* The same of a photo that is compared with the next view and then dropped: neither waits for a
 * device that has room for such photos. */
int sg_engine_photo_pass(struct sg_engine *e, int width, int height, const uint8_t *rgb,
                         const uint8_t *mask, sg_photo *out);
/* The photo is gone also after an error, which is that of an earlier stage. 0: nothing. */
int sg_engine_photo_drop(struct sg_engine *e, sg_photo photo);

/* The exposures of n photos (math/exposure.h), then their first moments, then their second. An
 * engine in host memory learns them where they are; a device has a copy. They must stay until the
 * engine is destroyed or has others. n = 0: none. SG_ERR_USAGE for an engine without exposures. */
#define SG_EXPOSURE_FLOATS (3 * SG_EXPOSURE) /* of a photo */
int sg_engine_set_exposures(struct sg_engine *e, float *values, size_t n);
/* Engine to host: what they are now, to where they were given. */
int sg_engine_read_exposures(struct sg_engine *e);

/* ---- the stages ---- */

/* Every Gaussian on the screen; colours of SH degree sh_degree. */
int sg_engine_project(struct sg_engine *e, const struct sg_camera *camera, int sh_degree,
                      const struct sg_render_params *params);
/* Which Gaussians each tile draws, front to back. */
int sg_engine_bin(struct sg_engine *e);
/* The image. auxiliary: alpha and depth too. */
int sg_engine_raster(struct sg_engine *e, bool auxiliary);
/* Project, bin, raster. */
int sg_engine_draw(struct sg_engine *e, const struct sg_camera *camera, int sh_degree,
                   const struct sg_render_params *params, bool auxiliary);
/* Engine to host: 3 planes, 1 plane, 1 plane; alpha and depth may be NULL. */
int sg_engine_read_image(struct sg_engine *e, float *rgb, float *alpha, float *depth);

/* dL/dimage of the weighted sum of losses; see losses.h. The photo has the view's size. A
 * photometric loss comes first. SG_ERR_USAGE where the list or the target is not as described. */
int sg_engine_losses(struct sg_engine *e, const struct sg_target *target,
                     const struct sg_loss *losses, size_t n);
/* Steps up the total variation of the image that was drawn, as sg_engine_ascend takes them, on a
 * device. Where epsilon is finite the image is clamped to [0, 1] first. The result is a target of
 * losses. SG_ERR_USAGE for an engine that has no such stage. */
struct sg_view_ascent {
    sg_photo photo;
    float epsilon, step;
    int steps;
    enum sg_attack_tv form;
    float spectral_weight; /* 0: without a spectral term; else one with the default parameters */
};
int sg_engine_ascend_view(struct sg_engine *e, const struct sg_view_ascent *ascent);
bool sg_engine_ascends_views(const struct sg_engine *e);
/* Host to engine: replaces dL/dimage (3 planes). */
int sg_engine_write_image_gradient(struct sg_engine *e, const float *gradient);

/* dL/dimage to gradients of the projected Gaussians. */
int sg_engine_raster_backward(struct sg_engine *e);

/* One Adam step per group: p -= rate m / (sqrt(v) root + eps), rate = lr / (1 - beta1^t), root = 1
 * / sqrt(1 - beta2^t). A group with rate 0 keeps its parameters, and its moments too unless it is
 * of anchors. */
struct sg_update {
    bool adam; /* false: no group moves */
    float rate[SG_GROUPS], root[SG_GROUPS];
    bool statistics; /* count this view in the statistics of densification */
    /* Weights in the loss of the mean opacity of all Gaussians and of the mean of their scales.
     * Only a step with adam has these terms. */
    float mean_opacity, mean_scale;
    bool accumulate; /* gradients add up over the updates without adam; the next one with adam takes
                        the sum. Lost when the model is edited. */
};
/* Gradients of the projected Gaussians to those of the parameters. statistics: counts
 * this view in the statistics of densification. */
int sg_engine_project_backward(struct sg_engine *e, bool statistics);
/* Raises the largest radius of each Gaussian to that in the view that was projected, before it
 * moves. SG_ERR_USAGE for an engine that has no such operation. */
int sg_engine_count_radii(struct sg_engine *e);
/* One Adam step of all exposures, after the losses and before optimise: that of the target by its
 * gradient, the others by their momentum alone. See struct sg_update. */
struct sg_exposure_update {
    double rate, root;
};
int sg_engine_learn_exposures(struct sg_engine *e, const struct sg_exposure_update *update);
/* A step of the optimiser. Without project_backward before, it does that too, as fast as it can:
 * gradients of the parameters need not be stored. With it, update->statistics has no effect. */
int sg_engine_optimise(struct sg_engine *e, const struct sg_update *update);
/* Engine to host: dL/d parameters of the view, in a model-shaped object. Before optimise. For tests
 * and sensitivities. */
int sg_engine_read_gradients(struct sg_engine *e, struct sg_model *out);

/* Of the newest view and its losses, as far as its stages have run. */
struct sg_step {
    struct sg_render_stats stats;
    struct sg_photometric_value photometric;
    double loss[SG_LOSSES];       /* without their weights; NAN = not in the list */
    double exposure[SG_EXPOSURE]; /* dL/dexposure of the photometric loss, if the target has one */
    double variation;             /* mean over the image of sg_engine_ascend_view; NAN without it */
    uint64_t number;              /* of a view that was optimised: which one, from 1; else 0 */
    uint64_t most;                /* and the largest number of instances up to it */
};
/* Waits for all stages that were called, as calls do that bring memory to the host or change the
 * model. */
int sg_engine_read_step(struct sg_engine *e, struct sg_step *out);
/* Of the newest view that was optimised. Without `wait` it is one of a few iterations ago, on a
 * device, if the results of any are known. */
int sg_engine_read_arrived(struct sg_engine *e, bool wait, struct sg_step *out);
/* The number of the newest view that was optimised; what the engine knows of one of the newest four
 * after the call that optimised it, and may forget after the fourth. Without `wait` *known may be
 * false on a device. */
uint64_t sg_engine_views(const struct sg_engine *e);
int sg_engine_read_view(struct sg_engine *e, uint64_t number, bool wait, struct sg_step *out,
                        bool *known);
/* The largest number of instances of all views that were optimised. Waits. */
int sg_engine_most_instances(struct sg_engine *e, uint64_t *out);

/* Engine to host: hits over n views, one value per Gaussian. No colour is computed; the view that
 * was being processed is lost. */
int sg_engine_count_hits(struct sg_engine *e, const struct sg_camera *const *views, size_t n,
                         const struct sg_render_params *params, enum sg_hit kind, double *hits);

/* Hits of anchors: in each view, each Gaussian that is made has a value. */
struct sg_weighing {
    enum sg_hit kind;
    bool shared; /* a Gaussian has all hits of its anchor in the view */
    /* The value is the hits times this of the natural log of its smallest scale. NULL: the hits. */
    double (*weight)(const void *arg, float log_smallest);
    const void *arg;
    /* The values of an anchor, over Gaussians and views. In a sum of SG_HIT_VIEWS that are neither
     * shared nor weighted a view counts once. */
    enum sg_combine combine;
    /* Values stay with the Gaussians: `hits` has SG_ANCHOR_GAUSSIANS of each anchor. */
    bool single;
};
/* The same of a model of anchors. SG_ERR_USAGE for an engine of other models. */
int sg_engine_weigh_hits(struct sg_engine *e, const struct sg_camera *const *views, size_t n,
                         const struct sg_render_params *params, const struct sg_weighing *how,
                         double *hits);

/* ---- images on their own ---- */

/* One step up the total variation of an image, all in host memory, 3 planes each:
 * to = clamp(photo + clamp(from + step sgn(dTV/dfrom + extra) - photo, -epsilon, epsilon), 0,
 * 1), where dTV is half of its value in SG_ATTACK_TV_VERTICAL2: in every form a neighbour adds at
 * most 1. extra is 0, or goes down the anisotropy: its gradient, scaled so that the mean of its
 * absolute values is spectral_weight. */
struct sg_ascend {
    float epsilon, step;
    enum sg_attack_tv form;
    int width, height;
    const float *photo, *from;
    const float *bound;             /* NULL, or a plane: the epsilon of each pixel */
    struct sg_anisotropy *spectral; /* NULL, or the loss, of this size */
    float spectral_weight;
    float *extra; /* with spectral: room for 3 planes, which an engine in host memory needs */
    float *to;    /* not `from` */
    /* Of a run of steps: this one goes on from the image of the last one, with the
     * same photo, bounds and size; and the next one does, so that a device need not copy the image
     * to the host. No other call comes between. */
    bool continues, continued;
};
int sg_engine_ascend(struct sg_engine *e, const struct sg_ascend *a);

/* ---- clocks ---- */

/* Seconds (wall clock) per stage since creation. */
struct sg_engine_times {
    double shape, project, bin, raster, raster_backward, project_backward, optimise, count,
        ascend; /* shape: both ways; ascend: of views */
    double loss[SG_LOSSES];
};
struct sg_engine_times sg_engine_times(const struct sg_engine *e);
/* Stopped clocks count nothing until they go on. */
void sg_engine_stop_clocks(struct sg_engine *e, bool stop);

#endif
