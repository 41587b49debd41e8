/* SPDX-License-Identifier: Apache-2.0 */
/* Which defense a run gets: what was asked for, and with preset auto what the photos look like. */
#include <stdlib.h>
#include <string.h>

#include "train_run.h"

/* What the preset decides, where the options do not. */
static void settle_defense(struct train_config *c, const struct sg_defense_params *preset)
{
    struct sg_defense_params *d = &c->train.defense;
    d->on = c->defense;
    d->rho = d->rho == PRESET_RHO ? preset->rho : d->rho;
    d->lambda = d->lambda == PRESET_LAMBDA ? preset->lambda : d->lambda;
    d->frequency = d->frequency == PRESET_FREQUENCY ? preset->frequency : d->frequency;
    d->shares = preset->shares;
}

/* The paper's rho and lambda for its datasets; for auto, what holds without photos. */
static struct sg_defense_params published(int preset)
{
    const struct {
        double rho, lambda;
    } of[] = {[DEFENSE_NS] = {0.03, 4}, [DEFENSE_TT] = {0.045, 4}, [DEFENSE_MIP] = {0.05, 5}};
    struct sg_defense_params p = {SG_DEFENSE_DEFAULTS};
    if (preset != DEFENSE_AUTO)
        p.rho = of[preset].rho, p.lambda = of[preset].lambda;
    return p;
}

int train_check(const struct train_run *r, const bool *given)
{
    struct train_config c = *r->config;
    const struct option *o = command_train.options;
    static const char *const ranking[] = {"filter-frequency", "filter-exponent", "filter-views",
                                          "filter-sigma",     "filter-hits",     "filter-sample"};
    const bool defends = c.defense || c.audit == AUDIT_DEFEND, limited = c.train.max_gaussians || c.max_memory;
    bool inside = false;
    for (size_t i = 0; o[i].name && !defends && !c.resume; i++) {
        inside = o[i].type == OPT_GROUP ? !strcmp(o[i].name, "Defense") : inside;
        const bool decides = !strcmp(o[i].name, "defense") || !strcmp(o[i].name, "audit");
        bool ranks = false; /* those that stay at the limit */
        for (size_t k = 0; k < sizeof(ranking) / sizeof(ranking[0]); k++)
            ranks |= limited && !strcmp(o[i].name, ranking[k]);
        if (inside && given[i] && !decides && !ranks) {
            say(stderr, "splatguard train: --%s: found without a defense, expected --defense spectral with it\n",
                o[i].name);
            return 1;
        }
    }
    const struct sg_defense_params preset = published(c.preset);
    settle_defense(&c, &preset);
    const int error = sg_train_check(r->ctx, &c.train);
    return error ? report(r->ctx, error) : 0;
}

static int settle_automatic(struct train_run *r, const struct sg_audit *found)
{
    struct sg_defense_params preset = {SG_DEFENSE_DEFAULTS};
    if (!(r->shares = malloc((found->count + 1) * sizeof(*r->shares)))) {
        say(stderr, "splatguard: out of memory\n");
        return 3;
    }
    sg_defense_automatic(found, r->scene->extent, r->shares, &preset);
    preset.rho = options_number(preset.rho), preset.frequency = options_number(preset.frequency);
    settle_defense(r->config, &preset);
    return 0;
}

/* Says what was found, and does what --audit asks for. */
static int heed(struct train_config *c, const struct sg_audit *found)
{
    const bool clean = found->verdict == SG_AUDIT_CLEAN;
    if (!clean || !c->quiet)
        say(stderr, "%saudit: the photos look %s, score %.3f\n",
            clean ? "" : "warning: ", sg_audit_verdict_name(found->verdict), found->score);
    for (size_t i = 0; i < found->count_reasons && !clean; i++)
        say(stderr, "  %s\n", found->reasons[i]);
    if (c->audit == AUDIT_REFUSE && found->verdict == SG_AUDIT_POISONED) {
        say(stderr, "splatguard: %s: found poisoned photos, expected clean ones (--audit refuse)\n", c->source);
        return 2;
    }
    if (c->audit == AUDIT_DEFEND && !clean)
        c->defense = 1;
    return 0;
}

int train_decide(struct train_run *r)
{
    struct train_config *c = r->config;
    struct sg_audit *found = NULL;
    struct sg_defense_params preset = published(c->preset);
    if (c->preset == DEFENSE_AUTO)
        preset.frequency = options_number(sg_defense_frequency(r->scene->extent));
    if (c->audit == AUDIT_OFF && !(c->defense && c->preset == DEFENSE_AUTO)) {
        settle_defense(c, &preset);
        return 0;
    }
    const int error = sg_audit_scene(r->ctx, r->scene, &found);
    if (error)
        return report(r->ctx, error);
    r->audit = sg_audit_verdict_name(found->verdict), r->audit_score = found->score;
    int code = c->resume ? 0 : heed(c, found);
    if (!code && c->defense && c->preset == DEFENSE_AUTO)
        code = settle_automatic(r, found);
    else
        settle_defense(c, &preset);
    sg_audit_destroy(r->ctx, &found);
    return code;
}
