/* SPDX-License-Identifier: Apache-2.0 */
/* A checkpoint can be continued only by a run of the same identity: its kind, and a hash of the
 * parameters that decide its result. Limits, iterations, engine and threads are not among them. */
#ifndef SG_TRAIN_IDENTITY_H
#define SG_TRAIN_IDENTITY_H

#include <stddef.h>
#include <stdint.h>

#include "splatguard/train.h"

enum sg_run_kind { SG_RUN_TRAINING, SG_RUN_ATTACK };

struct sg_identity {
    enum sg_run_kind kind;
    uint64_t parameters;
    /* of the defense: what an audit of the photos may have set, and follows them; with the numbers
     * of each photo */
    uint64_t strength;
};

uint64_t sg_hash_numbers(const double *numbers, size_t n);

/* Of parameters that have this hash, with those of anchors if the model is SG_MODEL_SCAFFOLD. */
uint64_t sg_hash_anchors(const struct sg_train_params *params, uint64_t hash);

/* n_views: of the scene for training. */
struct sg_identity sg_train_identity(const struct sg_train_params *params, size_t n_views);

#endif
