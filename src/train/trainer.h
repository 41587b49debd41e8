/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SG_TRAINER_H
#define SG_TRAINER_H

#include "engine/engine.h"
#include "budget.h"
#include "identity.h"
#include "splatguard/train.h"
#include "strategy.h"

/* All of a run's state is here and in the engine; random draws depend on the iteration only. */
struct sg_trainer {
    sg_ctx *ctx;
    const struct sg_scene *scene;
    struct sg_train_params params;
    struct sg_identity identity;
    struct sg_engine *engine;
    double extent;
    int sh_degree;    /* stored */
    int start_degree; /* active at iteration 0 */
    int iteration;
    int resumed;    /* iteration of the checkpoint that it goes on from; the last is done again */
    uint64_t steps; /* equal to `iteration`, unless time is short */
    uint64_t idle;  /* of them, the newest: those from the last iteration on, which move nothing */
    double spent;   /* seconds of the steps before the clock's `started` */
    double started, step_begun;
    double first_begun; /* the first step of this process */
    int first_after;    /* the iteration that it follows */
    double gap;         /* between the beginnings of the newest two steps; 0 = not known */
    bool steps_here;    /* step_begun is known */
    bool from_points;   /* the initial model was made of points, not given */
    const struct sg_strategy *strategy;
    void *strategy_state;
    struct sg_budget budget;
    bool gaussians_bound, time_bound;
    double noise, beyond; /* of the newest look, see struct sg_noise; 0 and 1 before it */
    bool smooths;         /* photos with a tolerance are smoothed, and have none in force */
    /* After this iteration rates fall and no Gaussian comes or goes; INT_MAX: never. */
    int settles_from;
    int adam_steps[SG_GROUPS];
    sg_photo *photos;                      /* of the training views */
    uint8_t **smoothed;                    /* of those that the engine has smoothed, else NULL */
    float *tolerances;                     /* of each photo; NULL = params.tolerance */
    float *exposures;                      /* that the engine learns, see exposure.h; or NULL */
    uint32_t photos_hash;                  /* of their pixels as this process began with them */
    double densify_seconds, prune_seconds; /* of the strategy */
    bool reads_ahead;                      /* photos from their files, before they are used */
    uint64_t epoch;                        /* that `order` is for */
    uint32_t *order;
};

/* What a trainer begins with. */
struct sg_trainer_start {
    const struct sg_model *initial;     /* NULL: the scene's points, or random ones */
    const char *checkpoint;             /* instead, unless NULL */
    const struct sg_identity *identity; /* of the run; NULL: a training with these parameters */
    const struct sg_strategy *strategy; /* NULL: that of the parameters */
    bool sums;     /* gradients will be summed over views (struct sg_update, accumulate) */
    bool spectral; /* steps will be taken up images with a spectral term (struct sg_ascend) */
};

int sg_trainer_open(sg_ctx *ctx, const struct sg_scene *scene, const struct sg_trainer_start *start,
                    const struct sg_train_params *params, sg_trainer **out);

/* sg_trainer_step without waiting for a device: what the engine measures (loss to psnr, render, the
 * losses of the defense) is of a step of a few iterations ago. out: or NULL. */
int sg_trainer_advance(sg_trainer *t, struct sg_train_step *out);
/* Waits, and fills that in for the newest step. */
int sg_trainer_values(sg_trainer *t, struct sg_train_step *step);
/* The largest number of instances of all steps. Waits. */
int sg_trainer_most_instances(sg_trainer *t, uint64_t *out);
/* The same of a step whose number sg_trainer_view has said after it: see sg_engine_read_view.
 * *most: the largest number of instances up to it. */
uint64_t sg_trainer_view(const sg_trainer *t);
int sg_trainer_arrived(sg_trainer *t, uint64_t view, bool wait, struct sg_train_step *step,
                       uint64_t *most, bool *known);

/* The view of the it-th step (from 1): every epoch visits all views in a random order. */
size_t sg_trainer_pick_view(sg_trainer *t, uint64_t step);
/* Once the photo of that step is in use: has the photo of the next step read, unless iteration `it`
 * is the last one. */
void sg_trainer_read_ahead(sg_trainer *t, uint64_t step, int it, int iterations);

/* Seconds of all steps, those before a checkpoint included. */
double sg_trainer_elapsed(const sg_trainer *t);

/* Seconds since a fixed moment, without those of counting hits, which is a stage of its own. */
double sg_trainer_seconds_not_counting(const sg_trainer *t);

/* The tolerances of a run that has them of each view, measured anew after iteration `it`. Draws
 * other views. Where memory runs out some of them stay as they were. */
int sg_trainer_measure_noise(sg_trainer *t, int it, struct sg_noise *out);

/* Hands the photo of a view to the engine, smoothed where it has to be: for the whole run, or for
 * the next losses. */
int sg_trainer_hold_photo(sg_trainer *t, size_t view, bool stays);
/* Releases the photo of a view that the engine does not have any more. */
void sg_trainer_let_go(sg_trainer *t, size_t view);

/* Whether the next iteration adds or removes Gaussians or resets opacities. False where time is
 * limited, and the next step may be one of several iterations. */
bool sg_trainer_changes(const sg_trainer *t);

/* Photos with a tolerance are smoothed from now on. After an error the trainer cannot go on. */
int sg_trainer_smooth(sg_trainer *t);
bool sg_trainer_smooths(const sg_trainer *t, size_t view);

/* How its views are drawn, on black. */
struct sg_render_params sg_trainer_render(const sg_trainer *t);
/* Photos of which the networks of anchors learn the appearance. */
size_t sg_trainer_appearances(const sg_trainer *t);

/* densify_grad_threshold, made lower by tolerance_growth. */
float sg_trainer_growth_threshold(const sg_trainer *t);

/* Of SG_MODEL_MIP: the 3D filter, from all training views; of others nothing. */
int sg_trainer_renew_filter(sg_trainer *t);

/* Of SG_MODEL_SCAFFOLD, for its strategies, in the order of the released code: a step of the
 * networks, with the gradients of the view that was optimised last; anchors that grow and go. */
int sg_trainer_learn_networks(sg_trainer *t, int it);
int sg_trainer_grow_anchors(sg_trainer *t, int it, struct sg_train_step *out);

/* The engine's update, with an Adam step at these rates unless lr is NULL. The step counters
 * advance with it, and stay unchanged if it fails. hold_opacity: that group does not move. */
int sg_trainer_update(sg_trainer *t, const double *lr, bool hold_opacity, struct sg_update u);

#endif
