/* SPDX-License-Identifier: Apache-2.0 */
/* What an engine implements. Only src/engine includes this; everybody else calls the functions of
 * engine.h, which check their arguments and the order of the stages, run the clocks and stand in
 * for optional operations. */
#ifndef SG_ENGINE_OPS_H
#define SG_ENGINE_OPS_H

#include "engine.h"
#include "registry.h"
#include "splatguard/engine.h"

/* The photo behind a handle. */
struct sg_photo_entry {
    int width, height;
    const uint8_t *rgb, *mask; /* host; rgb NULL: the handle is free */
    bool passing;              /* the engine got it by photo_pass */
};

/* A target with its handle looked up. Either rgb or planes. */
struct sg_target_pixels {
    sg_photo photo;
    const uint8_t *rgb;  /* host, height x width x 3 */
    const uint8_t *mask; /* host, height x width, or NULL */
    const float *planes; /* host, 3 planes */
    /* The photo's exposure: host memory, or 1 + its number on a device that learns them. */
    const float *exposure;
    size_t device_exposure;
    bool ascended; /* neither: see struct sg_target */
};

/* The beginning of every engine's own structure. */
struct sg_engine {
    const struct sg_engine_ops *ops;
    sg_ctx *ctx;
    /* of the front end */
    unsigned ready; /* what the stages have left: enum sg_ready in engine.c */
    int sh_degree;  /* of the model, as stored */
    int width, height;
    const struct sg_shape *shape; /* or NULL */
    enum sg_gradient_statistic statistic;
    int each;                      /* Gaussians that one of the model can be drawn as; 0: 1 */
    float volume;                  /* see sg_engine_set_volume */
    struct sg_photo_entry *photos; /* of handle k + 1 */
    size_t photo_count, photo_capacity;
    float *exposures; /* host; see sg_engine_set_exposures */
    size_t exposure_count;
    size_t exposed; /* 1 + the number of that of the newest losses, or 0 */
    bool clocks_stopped;
    /* NULL: the host's clock runs during each call. Else the engine adds to *sum, one of `times` or
     * NULL, what its device takes for the work of the calls from now on. */
    void (*clock)(struct sg_engine *, double *sum);
    struct sg_engine_times times;
    bool optimised;          /* the newest view */
    uint64_t views;          /* that were optimised */
    uint64_t most_instances; /* of such views, without ops->read_most */
    struct sg_step learned;  /* of the newest one, without ops->read_arrived */
    struct sg_step step; /* stages that are done when their call returns leave their results here */
};

/* Anchors of Scaffold-GS and their networks, where the engine that draws them is: see
 * scaffold/scaffold.h. make_view, pull, optimise and learn are stages; the others come after
 * `finish`. */
struct sg_anchor_ops {
    /* With networks; a column that is NULL is zeros. After an error the engine has none. */
    int (*upload)(struct sg_engine *, const struct sg_model *, const struct sg_columns *);
    /* All three have room; columns that are NULL are left out. */
    int (*download)(struct sg_engine *, struct sg_model *, struct sg_columns *);
    /* The view's Gaussians become the model that is drawn, SG_ANCHOR_GAUSSIANS of each anchor,
     * without statistics. appearance: as of struct sg_render_params. */
    int (*make_view)(struct sg_engine *, const struct sg_camera *, int appearance);
    /* Of each anchor, a bit for each of its Gaussians that the view makes. */
    int (*read_exists)(struct sg_engine *, uint32_t *exists);
    /* From their gradients to those of anchors and weights. */
    int (*pull)(struct sg_engine *, bool statistics, float volume);
    /* Ends the view of the engine that draws, with a step of Adam if there is one. */
    int (*optimise)(struct sg_engine *, const struct sg_update *);
    int (*learn)(struct sg_engine *, const struct sg_network_update *);
    int (*read_gradients)(struct sg_engine *, struct sg_model *);
};

/* A mark "optional" means that the pointer may be NULL; the comment says what happens then. Stages
 * may return before their work is done; read_step and what brings memory to the host wait for
 * it. */
struct sg_engine_ops {
    const char *name;
    bool absolute;   /* it counts SG_GRADIENT_ABSOLUTE */
    bool exposure;   /* its photometric loss knows exposures */
    bool mip_kernel; /* of struct sg_render_params */
    void (*destroy)(struct sg_engine *);
    const char *(*variant)(const struct sg_engine *);

    int (*upload)(struct sg_engine *, const struct sg_model *, const struct sg_columns *);
    int (*adopt)(struct sg_engine *, struct sg_model *,
                 struct sg_columns *); /* optional: upload, and free both */
    int (*download)(struct sg_engine *, struct sg_model *, struct sg_columns *);
    /* The model of an engine in host memory. Who fills it in for a view reads gradients and
     * statistics there too. NULL for an engine that has `anchors`. */
    struct sg_host_model *(*host_model)(struct sg_engine *);
    size_t (*count)(const struct sg_engine *);
    int (*read_statistics)(struct sg_engine *, const struct sg_statistics *);
    int (*edit)(struct sg_engine *, const struct sg_edit *);
    int (*floor_scale)(struct sg_engine *, float smallest);
    int (*reset_opacity)(struct sg_engine *, float limit);

    /* Optional: there are no such operations. */
    int (*count_radii)(struct sg_engine *);
    int (*relocate)(struct sg_engine *, const struct sg_relocation *);
    int (*filter)(struct sg_engine *, const struct sg_camera *const *, size_t n,
                  const struct sg_mip_filter *);
    int (*explore)(struct sg_engine *, const struct sg_exploration *);
    int (*settle)(struct sg_engine *, const struct sg_settling *);
    int (*hide)(struct sg_engine *, const uint32_t *hidden);
    int (*learn_networks)(struct sg_engine *, const struct sg_network_update *);

    /* Optional: an engine in host memory reads the photos where they are. */
    int (*photo_add)(struct sg_engine *, sg_photo, const struct sg_photo_entry *);
    void (*photo_drop)(struct sg_engine *, sg_photo);
    /* Optional, without `finish` before it: see sg_engine_photo_pass. Not dropped by photo_drop. */
    int (*photo_pass)(struct sg_engine *, sg_photo, const struct sg_photo_entry *);

    /* Optional, all three of them: the front end learns exposures in host memory. n may be 0.
     * read_exposures: the values and moments of all. number: that of the target. */
    int (*set_exposures)(struct sg_engine *, const float *values, size_t n);
    int (*read_exposures)(struct sg_engine *, float *values);
    int (*learn_exposures)(struct sg_engine *, size_t number, const struct sg_exposure_update *);

    /* Optional: there is no such stage. */
    int (*shape)(struct sg_engine *, const struct sg_shape *);
    int (*shape_backward)(struct sg_engine *, const struct sg_shape *);

    int (*project)(struct sg_engine *, const struct sg_camera *, int sh_degree,
                   const struct sg_render_params *);
    int (*bin)(struct sg_engine *);
    int (*raster)(struct sg_engine *, bool auxiliary);
    int (*read_image)(struct sg_engine *, float *rgb, float *alpha, float *depth);
    /* One of the list. A photometric loss replaces dL/dimage; the others add to it and leave 0
     * where the mask is 0. */
    int (*loss)(struct sg_engine *, const struct sg_target_pixels *, const struct sg_loss *);
    int (*ascend_view)(struct sg_engine *, const struct sg_view_ascent *); /* optional: no stage */
    int (*write_image_gradient)(struct sg_engine *, const float *gradient);
    int (*raster_backward)(struct sg_engine *);
    int (*project_backward)(struct sg_engine *, bool statistics);
    int (*optimise)(struct sg_engine *, const struct sg_update *);
    /* Optional: both of them. Not used with a shape. */
    int (*project_backward_optimise)(struct sg_engine *, const struct sg_update *);
    int (*read_gradients)(struct sg_engine *, struct sg_model *); /* after project_backward */
    int (*read_step)(struct sg_engine *); /* optional: all results are in `step` already */
    /* Optional, all three of them: stages are done when they return. finish: waits until they are,
     * before any operation but adopt, photo_pass, explore, count_radii, learn_exposures,
     * learn_networks, a further step of ascend, and the stages from shape to
     * project_backward_optimise.
     * read_arrived: results that are known without waiting, of the optimised view with that number
     * or, for 0, of the newest one there is; or false.
     * read_most: see sg_engine_most_instances. */
    int (*finish)(struct sg_engine *);
    bool (*read_arrived)(struct sg_engine *, uint64_t number, struct sg_step *);
    int (*read_most)(struct sg_engine *, uint64_t *);

    /* Adds the hits of a view. */
    int (*count_hits)(struct sg_engine *, const struct sg_camera *, const struct sg_render_params *,
                      enum sg_hit, double *hits);
    /* Adds the values of a view, or takes the largest. made: of each anchor, the values so far;
     * NULL: nobody asks. Optional: there is no such operation. */
    int (*weigh_hits)(struct sg_engine *, const struct sg_camera *, const struct sg_render_params *,
                      const struct sg_weighing *, double *hits, uint32_t *made);
    int (*ascend)(struct sg_engine *, const struct sg_ascend *); /* optional: the oracle's */
    bool ascends_spectrum; /* it computes `extra` too; else the front end does before it */
    const struct sg_anchor_ops *anchors; /* NULL: they are in host memory */
};

/* An engine that this build has. */
struct sg_engine_kind {
    const char *name;
    /* It runs on devices: in place of a variant it is given what follows "name:", or NULL. */
    bool devices;
    int (*create)(sg_ctx *ctx, const char *variant, struct sg_engine **out);
    /* SG_ERR_USAGE for a variant that is not known or does not run here; NULL is the best one. */
    int (*check)(sg_ctx *ctx, const char *variant);
    /* Names of the variants that run here, slowest first; returns their number. */
    int (*variants)(const char *out[SG_ENGINE_VARIANTS]);
    struct sg_footprint (*footprint)(const struct sg_work *); /* in host memory */
    struct sg_footprint (*on_device)(const struct sg_work *); /* optional: it has no device */
    /* Optional. Whether a device that nobody names is possible, without a look at drivers. */
    bool (*may_run)(void);
    /* For sg_engine_list: fills in all but the engine's name. Returns false after the last one. out
     * NULL: only this. */
    bool (*describe)(size_t index, struct sg_engine_info *out);
};
extern const struct sg_engine_kind sg_engine_cpu, sg_engine_vulkan, sg_engine_ref;

/* The scalar step, over the context's threads. */
void sg_ref_ascend(sg_ctx *ctx, const struct sg_ascend *a);

#endif
