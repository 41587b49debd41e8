/* SPDX-License-Identifier: Apache-2.0 */
/* Parameters with some fields set and defaults elsewhere, in one expression. Overridden
 * initialisers, which compilers warn of and C++ refuses, are for the tests only: programs set
 * fields of what the functions return. */
#ifndef TESTS_PARAMS_H
#define TESTS_PARAMS_H

#include "splatguard/splatguard.h"

#define sg_scene_params(...) (&(struct sg_scene_params){SG_SCENE_DEFAULTS, __VA_ARGS__})
#define sg_synth_params(...) (&(struct sg_synth_params){SG_SYNTH_DEFAULTS, __VA_ARGS__})
#define sg_render_params(...) (&(struct sg_render_params){SG_RENDER_DEFAULTS, __VA_ARGS__})
#define sg_attack_params(...) (&(struct sg_attack_params){SG_ATTACK_DEFAULTS, __VA_ARGS__})
#define sg_spectrum_params(...) (&(struct sg_spectrum_params){SG_SPECTRUM_DEFAULTS, __VA_ARGS__})
#define sg_anisotropy_params(...)                                                                  \
    (&(struct sg_anisotropy_params){SG_ANISOTROPY_DEFAULTS, __VA_ARGS__})

#endif
