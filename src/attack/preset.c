/* SPDX-License-Identifier: Apache-2.0 */
/* The published schedules by experiment: see docs/attack.md. */
#include <math.h>
#include <string.h>

#include "splatguard/attack.h"

bool sg_attack_preset(const char *name, enum sg_scene_format format, struct sg_attack_params *p)
{
    struct schedule {
        int iterations, inner, update_interval;
    } s;
    const bool bounded = isfinite(p->epsilon), strong = p->epsilon > 20 / 255.0f;
    if (!strcmp(name, "auto"))
        name = format == SG_FORMAT_BLENDER ? "ns" : "mip";
    if (!strcmp(name, "ns"))
        s = !bounded ? (struct schedule){6000, 25, 10}
            : strong ? (struct schedule){24000, 25, 1}
                     : (struct schedule){36000, 15, 1};
    else if (!strcmp(name, "mip"))
        s = bounded ? (struct schedule){12000, 25, 1} : (struct schedule){6000, 25, 1};
    else if (!strcmp(name, "tt"))
        s = bounded ? (struct schedule){36000, 25, 1} : (struct schedule){6000, 25, 10};
    else
        return false;
    if (p->model == SG_ATTACK_SCAFFOLD)
        s.update_interval = 1;
    p->iterations = s.iterations, p->inner = s.inner, p->update_interval = s.update_interval;
    return true;
}

bool sg_attack_complete(const char *name, enum sg_scene_format format, struct sg_attack_params *p)
{
    struct sg_attack_params preset = *p;
    if (!sg_attack_preset(name, format, &preset))
        return false;
    if (p->iterations == SG_ATTACK_BY_PRESET)
        p->iterations = preset.iterations;
    if (p->inner == SG_ATTACK_BY_PRESET)
        p->inner = preset.inner;
    if (p->update_interval == SG_ATTACK_BY_PRESET)
        p->update_interval = preset.update_interval;
    return true;
}
