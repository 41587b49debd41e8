/* SPDX-License-Identifier: Apache-2.0 */
/* Which defense a run gets: what was asked for, and with preset auto what the photos look like. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "option/option.h"
#include "train_run.h"

void train_settle_defense(struct train_config *c, const struct sg_defense_params *preset)
{
    struct sg_defense_params *d = &c->run.train.defense;
    if (d->rho_least == SG_PRESET_RHO) /* a rho of one's own comes without */
        d->rho_least = d->rho == SG_PRESET_RHO ? sg_round_digits(preset->rho_least) : 0;
    d->rho = d->rho == SG_PRESET_RHO ? sg_round_digits(preset->rho) : d->rho;
    d->lambda = d->lambda == SG_PRESET_LAMBDA ? sg_round_digits(preset->lambda) : d->lambda;
    d->frequency =
        d->frequency == SG_PRESET_FREQUENCY ? sg_round_digits(preset->frequency) : d->frequency;
    d->view_weights = preset->view_weights;
    if (c->run.train.tolerance == SG_TOLERANCE_PRESET)
        c->run.train.tolerance =
            d->on && c->run.preset == SG_RUN_PRESET_AUTO ? SG_TOLERANCE_AUTO : 0;
}

/* The published rho and lambda; for auto, what holds without photos. */
static struct sg_defense_params published(enum sg_run_preset preset)
{
    static const char *const names[] = {"auto", "ns", "tt", "mip"};
    struct sg_defense_params p = sg_defense_params_default();
    sg_defense_preset(names[preset], &p);
    return p;
}

/* An option of the defense that has no effect, or NULL. */
static const char *vain_option(const struct train_config *c, const bool *given)
{
    /* At a limit these decide who stays. */
    static const char *const ranking[] = {"filter-frequency", "filter-exponent", "filter-views",
                                          "filter-sigma",     "filter-hits",     "filter-sample"};
    struct option_place list[OPTIONS_MAX];
    const size_t n = options_list(&command_train, list);
    const bool limited = c->run.train.max_gaussians || c->run.max_memory;
    if (c->run.train.defense.on || c->run.audit == SG_RUN_AUDIT_DEFEND)
        return NULL;
    for (size_t i = 0; i < n; i++) {
        const struct sg_option *o = list[i].row;
        bool counts = !strcmp(o->name, "defense") || !strcmp(o->name, "audit") ||
                      !strcmp(o->name, "tolerance") || !strcmp(o->name, "smooth");
        for (size_t k = 0; k < sizeof(ranking) / sizeof(ranking[0]); k++)
            counts |= limited && !strcmp(o->name, ranking[k]);
        if (!strcmp(o->group, "Defense") && given[i] && !counts)
            return o->name;
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
    if (c.run.audit == SG_RUN_AUDIT_DEFEND && !c.run.train.defense.on &&
        options_given(&command_train, given, offsetof(struct train_config, run.train.defense.on))) {
        say(stderr, "splatguard train: --defense off and --audit defend exclude each other\n");
        return 1;
    }
    const struct sg_defense_params *d = &c.run.train.defense;
    if (d->rho_least > 0 &&
        (d->rho == SG_PRESET_RHO ? c.run.preset != SG_RUN_PRESET_AUTO : d->rho >= 0)) {
        say(stderr, "splatguard train: --rho-least: found with a fixed rho, expected --preset auto "
                    "or a --rho below 0\n");
        return 1;
    }
    const struct sg_defense_params preset = published(c.run.preset);
    train_settle_defense(&c, &preset);
    c.run.train.tolerance = fmaxf(c.run.train.tolerance, 0);
    return report_option(r->ctx, &command_train, sg_train_check(r->ctx, &c.run.train));
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
    if (c->run.audit == SG_RUN_AUDIT_REFUSE && found->verdict == SG_AUDIT_POISONED) {
        say(stderr, "splatguard: %s: found poisoned photos, expected clean ones (--audit refuse)\n",
            c->run.source);
        return STATUS_POISONED;
    }
    if (c->run.audit == SG_RUN_AUDIT_DEFEND && !clean &&
        !c->resume) /* a run keeps the defense that it has */
        c->run.train.defense.on = true;
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
    const bool automatic = c->run.train.defense.on && c->run.preset == SG_RUN_PRESET_AUTO;
    if (!code && (automatic || c->run.train.tolerance == SG_TOLERANCE_AUTO)) {
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
    struct sg_defense_params preset = published(c->run.preset);
    int code = 0;
    if (c->run.preset == SG_RUN_PRESET_AUTO)
        preset.frequency = sg_defense_frequency(r->scene->extent);
    if (c->run.audit != SG_RUN_AUDIT_OFF || c->run.train.tolerance == SG_TOLERANCE_AUTO ||
        (c->run.train.defense.on && c->run.preset == SG_RUN_PRESET_AUTO))
        code = audit(r, &preset);
    train_settle_defense(c, &preset);
    r->train = c->run.train;
    r->train.tolerances = c->run.train.tolerance == SG_TOLERANCE_AUTO ? r->tolerances : NULL;
    r->train.tolerance = fmaxf(c->run.train.tolerance, 0);
    r->train.white_background = c->run.scene.white_background;
    return code;
}
