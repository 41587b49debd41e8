/* SPDX-License-Identifier: Apache-2.0 */
#ifndef CLI_ATTACK_CONFIG_H
#define CLI_ATTACK_CONFIG_H

#include "commands.h"

enum attack_method { METHOD_POISON_SPLAT, METHOD_NOISE, METHOD_TV_PER_VIEW, METHOD_DRIFT };
enum attack_preset { PRESET_AUTO, PRESET_NS, PRESET_MIP, PRESET_TT };
enum attack_views { VIEWS_ALL, VIEWS_TRAIN };

struct attack_config {
    const char *output, *proxy, *epsilon;
    const char *source;
    struct scene_options scene;
    struct sg_attack_params attack;
    struct sg_poison_files files;
    float grey_step;                                     /* of the ascent, in grey levels */
    int iterations, inner, update_interval;              /* 0 = the preset's */
    int method, preset, tv, save, chroma, views, engine; /* indices of choices */
    int proxy_iterations, save_every, threads;
    float ratio, spare;
    uint64_t max_memory;
    bool keep_decoy, resume, force, quiet;
};

#endif
