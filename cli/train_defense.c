/* SPDX-License-Identifier: Apache-2.0 */
/* Which defense a run gets: what was asked for, and with preset auto what the photos look like. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "train_run.h"

void train_settle_defense(struct train_config *c, const struct sg_defense_params *preset)
{
    struct sg_defense_params *d = &c->train.defense;
    d->on = c->defense;
    if (d->rho_least == PRESET_RHO_LEAST) /* a rho of one's own comes without */
        d->rho_least = d->rho == PRESET_RHO ? options_number(preset->rho_least) : 0;
    d->rho = d->rho == PRESET_RHO ? options_number(preset->rho) : d->rho;
    d->lambda = d->lambda == PRESET_LAMBDA ? options_number(preset->lambda) : d->lambda;
    d->frequency =
        d->frequency == PRESET_FREQUENCY ? options_number(preset->frequency) : d->frequency;
    d->view_weights = preset->view_weights;
    if (c->tolerance == TOLERANCE_PRESET)
        c->tolerance = c->defense && c->preset == DEFENSE_AUTO ? TOLERANCE_AUTO : 0;
    c->train.tolerance = fmaxf(c->tolerance, 0);
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

/* An option of the defense that has no effect, or NULL. */
static const char *vain_option(const struct train_config *c, const bool *given)
{
    /* At a limit these decide who stays. */
    static const char *const ranking[] = {"filter-frequency", "filter-exponent", "filter-views",
                                          "filter-sigma",     "filter-hits",     "filter-sample"};
    const struct option *o = command_train.options;
    const bool limited = c->train.max_gaussians || c->max_memory;
    bool inside = false;
    if (c->defense || c->audit == AUDIT_DEFEND)
        return NULL;
    for (size_t i = 0; o[i].name; i++) {
        if (o[i].type == OPT_GROUP)
            inside = !strcmp(o[i].name, "Defense");
        bool counts = !strcmp(o[i].name, "defense") || !strcmp(o[i].name, "audit") ||
                      !strcmp(o[i].name, "tolerance");
        for (size_t k = 0; k < sizeof(ranking) / sizeof(ranking[0]); k++)
            counts |= limited && !strcmp(o[i].name, ranking[k]);
        if (inside && given[i] && !counts)
            return o[i].name;
    }
    return NULL;
}

int train_check(const struct train_run *r, const bool *given)
{
    struct train_config c = *r->config;
    const char *vain = c.resume ? NULL : vain_option(&c, given);
    if (vain) {
        say(stderr,
            "splatguard train: --%s: found without a defense, expected --defense spectral or "
            "--audit defend with it\n",
            vain);
        return 1;
    }
    if (c.audit == AUDIT_DEFEND && !c.defense &&
        options_given(&command_train, given, offsetof(struct train_config, defense))) {
        say(stderr, "splatguard train: --defense off and --audit defend exclude each other\n");
        return 1;
    }
    const struct sg_defense_params *d = &c.train.defense;
    if (d->rho_least > 0 && (d->rho == PRESET_RHO ? c.preset != DEFENSE_AUTO : d->rho >= 0)) {
        say(stderr, "splatguard train: --rho-least: found with a fixed rho, expected --preset auto "
                    "or a --rho below 0\n");
        return 1;
    }
    const struct sg_defense_params preset = published(c.preset);
    train_settle_defense(&c, &preset);
    const int error = sg_train_check(r->ctx, &c.train);
    return report_option(r->ctx, "train", error);
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
        say(stderr, "splatguard: %s: found poisoned photos, expected clean ones (--audit refuse)\n",
            c->source);
        return STATUS_POISONED;
    }
    if (c->audit == AUDIT_DEFEND && !clean && !c->resume) /* a run keeps the defense that it has */
        c->defense = 1;
    return 0;
}

/* Looks at the photos; preset auto follows from them. */
static int audit(struct train_run *r, struct sg_defense_params *preset)
{
    struct train_config *c = r->config;
    struct sg_audit *found = NULL;
    const int error = sg_audit_scene(r->ctx, r->scene, &found);
    if (error)
        return report(r->ctx, error);
    r->audit = sg_audit_verdict_name(found->verdict), r->audit_score = found->score;
    warn_small_photos(r->scene);
    int code = heed(c, found);
    const bool automatic = c->defense && c->preset == DEFENSE_AUTO;
    if (!code && (automatic || c->tolerance == TOLERANCE_AUTO)) {
        struct sg_defense_params p = *preset;
        r->view_weights = malloc((found->count + 1) * sizeof(*r->view_weights));
        r->tolerances = malloc((found->count + 1) * sizeof(*r->tolerances));
        if (!r->view_weights || !r->tolerances)
            code = no_memory();
        else
            sg_defense_automatic(found, r->scene->extent, r->view_weights, r->tolerances, &p);
        *preset = automatic ? p : *preset;
    }
    sg_audit_destroy(&found);
    return code;
}

int train_decide(struct train_run *r)
{
    struct train_config *c = r->config;
    struct sg_defense_params preset = published(c->preset);
    int code = 0;
    if (c->preset == DEFENSE_AUTO)
        preset.frequency = sg_defense_frequency(r->scene->extent);
    if (c->audit != AUDIT_OFF || c->tolerance == TOLERANCE_AUTO ||
        (c->defense && c->preset == DEFENSE_AUTO))
        code = audit(r, &preset);
    train_settle_defense(c, &preset);
    c->train.tolerances = c->tolerance == TOLERANCE_AUTO ? r->tolerances : NULL;
    return code;
}
