/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SG_TRAIN_CHECKPOINT_H
#define SG_TRAIN_CHECKPOINT_H

#include <stdio.h>

#include "engine/engine.h"

/* Then follow the sections, and 8 bytes: XXH3-64 of everything before. */
struct sg_checkpoint_header {
    char magic[8];
    uint64_t count;
    int32_t sh_degree, iteration;
    int32_t adam_steps[SG_GROUPS];
    int32_t start_degree;
    uint32_t cameras; /* hash of the training views' names and cameras */
    uint64_t seed, views;
    double extent;
    uint64_t steps;
    double spent;         /* seconds */
    double noise, beyond; /* see struct sg_trainer */
    uint32_t gaussians_bound, time_bound;
    uint32_t photos; /* hash of the training views' pixels and masks */
    uint32_t kind;
    uint64_t parameters, strength; /* struct sg_identity */
    uint32_t sections, smooths;
    uint32_t ended, zero; /* whether the iteration was the last of a training */
};

/* Before the bytes of a section, once each and in any order: of a column that is saved, blocks of
 * SG_LANES Gaussians with `planes` planes each, the last block cut off; of the state of the
 * strategy (title "strategy:" and its name), numbers of photos, and networks, where a run has
 * them. */
struct sg_checkpoint_section {
    char title[24]; /* filled up with zeros */
    uint32_t planes, zero;
    uint64_t bytes;
};

struct sg_checkpoint {
    const char *path;
    FILE *file;
    struct sg_checkpoint_header header;
};

struct sg_trainer;
struct sg_scene;

/* Of the training views' pixels and masks; reads only those without a hash of their own. */
uint32_t sg_photos_hash(const struct sg_scene *scene);

/* Opens the file and checks its header against this run and the file's length. To be closed. */
int sg_checkpoint_open(const struct sg_trainer *t, const char *path, struct sg_checkpoint *out);
/* The state, to a trainer with an empty engine. */
int sg_checkpoint_read(struct sg_trainer *t, const struct sg_checkpoint *c);
void sg_checkpoint_close(struct sg_checkpoint *c);

#endif
