/* SPDX-License-Identifier: Apache-2.0 */
#include "published.h"

#include <string.h>

#include "exit_status.h"

enum set { OFF, NS, MIP_OUTDOOR, MIP_INDOOR, TT, DB, BUNGEE, POISON_SPLAT };

static const char *const set_names[] = {[NS] = "NeRF-Synthetic",
                                        [MIP_OUTDOOR] = "outdoor scenes of Mip-NeRF 360",
                                        [MIP_INDOOR] = "indoor scenes of Mip-NeRF 360",
                                        [TT] = "Tanks and Temples",
                                        [DB] = "Deep Blending",
                                        [BUNGEE] = "BungeeNeRF",
                                        [POISON_SPLAT] = "the benchmark of Poison-splat"};

/* By the names of the options; option NULL: the defaults were published. */
static const struct setting {
    const char *method; /* a model, or a strategy of the model 3dgs */
    enum set set;
    const char *option, *value;
} settings[] = {
    {"3dgs", NS, "white-background", "true"},
    {"3dgs", MIP_OUTDOOR, "resolution", "4"},
    {"3dgs", MIP_INDOOR, "resolution", "2"},
    {"3dgs", TT, NULL, NULL},
    {"3dgs", DB, NULL, NULL},
    {"mcmc", NS, "white-background", "true"},
    {"mcmc", MIP_OUTDOOR, "resolution", "4"},
    {"mcmc", MIP_INDOOR, "resolution", "2"},
    {"mcmc", TT, NULL, NULL},
    {"mcmc", DB, "opacity-reg", "0.001"},
    {"mip", MIP_OUTDOOR, "resolution", "4"},
    {"mip", MIP_INDOOR, "resolution", "2"},
    {"scaffold", NS, "anchor-cells", "4"},
    {"scaffold", NS, "init-points", "10000"},
    {"scaffold", MIP_OUTDOOR, NULL, NULL},
    {"scaffold", MIP_INDOOR, NULL, NULL},
    {"scaffold", TT, "voxel-size", "0.01"},
    {"scaffold", DB, "voxel-size", "0.005"},
    {"scaffold", BUNGEE, "voxel-size", "0"},
    {"scaffold", BUNGEE, "anchor-cells", "128"},
    {"scaffold", POISON_SPLAT, "photo-appearance", "true"},
    {"scaffold", POISON_SPLAT, "init-points", "10000"},
};

static const char *method_of(enum sg_train_model model, enum sg_train_strategy strategy)
{
    return model == SG_MODEL_MIP                   ? "mip"
           : model == SG_MODEL_SCAFFOLD            ? "scaffold"
           : strategy == SG_STRATEGY_MCMC          ? "mcmc"
           : strategy == SG_STRATEGY_LIGHTGAUSSIAN ? "lightgaussian"
                                                   : "3dgs";
}

int published_apply(const struct command *c, int set, enum sg_train_model model,
                    enum sg_train_strategy strategy, const bool *given, void *config)
{
    const char *method = method_of(model, strategy);
    bool known = set == OFF;
    for (size_t i = 0; i < sizeof(settings) / sizeof(settings[0]); i++) {
        const struct setting *s = &settings[i];
        if ((int) s->set != set || strcmp(s->method, method) != 0)
            continue;
        known = true;
        if (s->option)
            options_preset(c, given, config, s->option, s->value);
    }
    if (known)
        return STATUS_DONE;
    say(stderr, "splatguard %s: --published: found no published settings of %s for %s\n", c->name,
        method, set_names[set]);
    return STATUS_USAGE;
}
