/* SPDX-License-Identifier: Apache-2.0 */
#ifndef CLI_TRAIN_CONFIG_H
#define CLI_TRAIN_CONFIG_H

#include "commands.h"

enum defense_preset { DEFENSE_AUTO, DEFENSE_NS, DEFENSE_TT, DEFENSE_MIP };

/* What stands for "the preset's". */
#define PRESET_RHO (-1.0)
#define PRESET_RHO_LEAST (-1.0)
#define PRESET_LAMBDA (-1.0)
#define PRESET_FREQUENCY 0.0
#define TOLERANCE_AUTO (-1.0f)
#define TOLERANCE_PRESET (-2.0f) /* auto with preset auto, else 0 */

enum audit_mode { AUDIT_OFF, AUDIT_WARN, AUDIT_REFUSE, AUDIT_DEFEND };

struct train_config {
    const char *source, *output, *init;
    const char *proxy_of; /* the folder of the attack that this run is for, or NULL */
    struct scene_options scene;
    struct sg_train_params train;
    int engine, defense, preset, audit; /* indices of choices */
    bool resume, force, quiet, eval;
    float tolerance; /* grey levels, or one of the two above */
    uint64_t max_memory;
    int threads, save_every, eval_every, log_every;
};

#endif
