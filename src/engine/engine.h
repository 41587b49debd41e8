/* SPDX-License-Identifier: Apache-2.0 */
/* The seam between what training does and where it is computed. A engine holds the model, its optimiser state and the
 * buffers of one view; host memory crosses only where a function says so. Inputs are validated by the callers.
 *
 * One view goes project -> rasterize -> loss -> rasterize_backward -> update; each uses what the one before left. */
#ifndef SG_ENGINE_H
#define SG_ENGINE_H

#include "core/internal.h"
#include "spectral/regulariser.h"
#include "splatguard/camera.h"
#include "splatguard/model.h"
#include "splatguard/render.h"
#include "splatguard/train.h"

/* Host copy of what training knows beside the parameters. All arrays belong to it; see sg_optimiser_create. */
struct sg_optimiser {
    size_t capacity;
    float *m, *v;      /* Adam moments, laid out as sg_model.params */
    float *grad_sum;   /* per Gaussian: sum of view-space gradient norms (NDC) */
    float *grad_count; /* views it was visible in */
};
int sg_optimiser_create(sg_ctx *ctx, size_t count, int sh_degree, struct sg_optimiser *out);
void sg_optimiser_clear(struct sg_optimiser *optimiser);

enum sg_group { SG_G_XYZ, SG_G_OPACITY, SG_G_SCALE, SG_G_ROT, SG_G_DC, SG_G_REST, SG_GROUPS };

/* One Adam step per group: p -= rate m / (sqrt(v) root + eps), rate = lr / (1 - beta1^t), root = 1 / sqrt(1 - beta2^t).
 * A group with rate 0 keeps its parameters and its moments. */
struct sg_update {
    bool adam; /* false: no group moves */
    float rate[SG_GROUPS], root[SG_GROUPS];
    bool statistics; /* add this view to grad_sum and grad_count */
    bool accumulate; /* gradients add up over the updates without adam; the next one with adam takes the sum. Lost when
                        the model is edited. */
};

/* The target of a value is the nearest to the render within `tolerance` of the photo, for L1 and SSIM alike. It counts
 * as a constant, and a value that is its own target has no gradient. So a change of the photo by at most `tolerance`
 * has no gradient at a model that shows the unchanged photo. */
struct sg_loss_params {
    float lambda_dssim;
    float tolerance;       /* 0..1, of the value range; 0: the target is the photo */
    const uint8_t *target; /* host, height x width x 3 */
    const uint8_t *mask;   /* host, height x width, or NULL */
    const float *planes;   /* host, 3 planes: a target that is no photo, instead of `target`; or NULL */
};

struct sg_loss_value {
    double l1, ssim; /* means over all values; masked-out pixels count as equal */
    double mse;      /* on unclamped values */
    double total;    /* (1 - lambda) l1 + lambda (1 - ssim) */
};

/* Of grey levels; a little more, so that photos exactly that far apart agree however both are rounded. */
static inline float sg_loss_tolerance(float levels)
{
    return levels > 0 ? levels / 255 + 0x1p-20f : 0;
}

/* Equal images have an SSIM of 1, which its sum reaches up to rounding only. */
static inline struct sg_loss_value sg_loss_value_of(double l1, double mse, double ssim, float lambda_dssim)
{
    const double s = l1 == 0 ? 1 : ssim, lambda = (double) lambda_dssim;
    return (struct sg_loss_value){.l1 = l1, .ssim = s, .mse = mse, .total = (1 - lambda) * l1 + lambda * (1 - s)};
}

/* What decides about Gaussians: where to put `count` values of each; any may be NULL. */
struct sg_statistics {
    float *gradient;     /* mean view-space gradient since the last edit */
    float *opacity;      /* activated */
    float *largest;      /* of the three scales, activated */
    float *log_smallest; /* of the three scales, its logarithm: as stored */
};

enum sg_edit_kind { SG_EDIT_COPY, SG_EDIT_CHILD };

/* A change of the set of Gaussians: survivors in their order, then the appended ones in theirs; from a few thousand on,
 * the engine puts them all into an order of its own that nothing but the model and the edit decides. */
struct sg_edit {
    const uint8_t *keep; /* one byte per present Gaussian */
    size_t kept;         /* number of non-zero bytes */
    size_t appended;
    const uint32_t *source; /* appended entries: index before the edit */
    const uint8_t *kind;    /* enum sg_edit_kind */
    bool statistics;        /* the survivors keep theirs, else all are cleared */
    uint64_t seed, stream;  /* of the children's positions: normal (seed, SG_RNG_SPLIT, stream, 3 entry + axis) */
};

struct sg_engine {
    const struct sg_engine_ops *ops;
    sg_ctx *ctx;
    struct sg_train_times times; /* wall seconds per stage, summed */
};

struct sg_engine_ops {
    const char *name;
    void (*destroy)(struct sg_engine *);
    const char *(*variant)(const struct sg_engine *);

    /* Host to device. optimiser NULL: zeros. */
    int (*upload)(struct sg_engine *, const struct sg_model *, const struct sg_optimiser *);
    /* The same, and takes the arrays of both, so that a host never holds them twice. */
    int (*adopt)(struct sg_engine *, struct sg_model *, struct sg_optimiser *);
    /* Device to host, objects of the present count and SH degree. What is NULL, an object or an array of the
     * optimiser, is left out. */
    int (*download)(struct sg_engine *, struct sg_model *, struct sg_optimiser *);
    size_t (*count)(const struct sg_engine *);

    /* Projects every Gaussian; colours of SH degree sh_degree. */
    int (*project)(struct sg_engine *, const struct sg_camera *, int sh_degree, const struct sg_render_params *);
    /* Tile lists and image. auxiliary: alpha and depth too. */
    int (*rasterize)(struct sg_engine *, bool auxiliary, struct sg_render_stats *);
    /* Device to host: 3 planes, 1 plane, 1 plane; alpha and depth may be NULL. */
    int (*read_image)(struct sg_engine *, float *rgb, float *alpha, float *depth);

    /* Photometric loss of the image and dL/dimage. */
    int (*loss)(struct sg_engine *, const struct sg_loss_params *, struct sg_loss_value *);
    /* Adds the gradients of the defense's losses to dL/dimage. */
    int (*regularise)(struct sg_engine *, const struct sg_regulariser_params *, struct sg_regulariser_value *);
    /* Host to device: replaces dL/dimage (3 planes). */
    int (*write_image_gradient)(struct sg_engine *, const float *gradient);
    /* dL/dimage to gradients of the splats. */
    int (*rasterize_backward)(struct sg_engine *);
    /* Gradients of the splats to parameters, fused with Adam: parameter gradients are never stored. */
    int (*update)(struct sg_engine *, const struct sg_update *);
    /* Device to host: dL/d parameters of the last view, in a model-shaped object. For tests and sensitivities. */
    int (*read_gradients)(struct sg_engine *, struct sg_model *);

    /* Device to host: hits over n views, one value per Gaussian. No colour is computed; the view that was being
     * processed is lost. */
    int (*count_hits)(struct sg_engine *, const struct sg_camera *const *views, size_t n,
                      const struct sg_render_params *, enum sg_hit, double *hits);

    /* Device to host. */
    int (*read_statistics)(struct sg_engine *, const struct sg_statistics *);
    /* Applies the edit to parameters, moments (appended: zero) and statistics. Where memory runs out the model is as
     * it was, or edited and without moments. */
    int (*edit)(struct sg_engine *, const struct sg_edit *);
    /* Scales = max(scales, smallest), activated; for attacks. */
    int (*floor_scale)(struct sg_engine *, float smallest);
    /* opacity = min(opacity, limit); zeroes the opacity moments. */
    int (*reset_opacity)(struct sg_engine *, float limit);
};

struct cpu_kernels;

/* The kernels of an engine and variant, as below; *out: NULL with "ref". */
int sg_engine_kernels(sg_ctx *ctx, const char *name, const char *cpu, const struct cpu_kernels **out);
/* name: "cpu" or "ref", NULL = cpu; cpu: variant or NULL. Unknown or unsupported: SG_ERR_USAGE. */
int sg_engine_create(sg_ctx *ctx, const char *name, const char *cpu, struct sg_engine **out);
void sg_engine_destroy(struct sg_engine **engine);

int sg_engine_create_cpu(sg_ctx *ctx, const char *cpu, struct sg_engine **out);
int sg_engine_create_ref(sg_ctx *ctx, struct sg_engine **out);

/* Screen radius in whole pixels and the reference's tile rectangle [x0, x1) x [y0, y1) of it. Integer-exact on every
 * engine. False: the rectangle is empty. */
struct sg_tile_rect {
    int x0, y0, x1, y1;
};
static inline bool sg_tile_rect(float x, float y, float sigma, int grid_x, int grid_y, int *radius,
                                struct sg_tile_rect *r)
{
    float rad = 3.0f * sigma;
    rad = rad < 1e6f ? rad : 1e6f;
    *radius = (int) rad + ((float) (int) rad < rad);
    /* Clamped before the conversion: an int cannot hold every float. Truncation toward zero as in the reference. */
    const float px = x < -1e8f ? -1e8f : x > 1e8f ? 1e8f : x, py = y < -1e8f ? -1e8f : y > 1e8f ? 1e8f : y;
    const float fr = (float) *radius;
#define SG_CLAMP_TILE(v, n) ((v) < 0 ? 0 : (v) > (n) ? (n) : (v))
    r->x0 = SG_CLAMP_TILE((int) ((px - fr) / 16.0f), grid_x);
    r->x1 = SG_CLAMP_TILE((int) ((px + fr + 15.0f) / 16.0f), grid_x);
    r->y0 = SG_CLAMP_TILE((int) ((py - fr) / 16.0f), grid_y);
    r->y1 = SG_CLAMP_TILE((int) ((py + fr + 15.0f) / 16.0f), grid_y);
#undef SG_CLAMP_TILE
    return r->x0 < r->x1 && r->y0 < r->y1;
}

#endif
