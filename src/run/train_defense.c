/* SPDX-License-Identifier: Apache-2.0 */
/* Which defense a run gets: what was asked for, and with preset auto what the photos look like. */
#include <math.h>

#include "config.h"
#include "core/clock.h"
#include "option/option.h"
#include "train.h"

/* What the preset decides where the parameters leave it to that, as config.json keeps it. */
static void apply_preset(struct sg_run_params *p, const struct sg_defense_params *preset)
{
    struct sg_defense_params *d = &p->train.defense;
    /* MCMC moves the Gaussians that the filter would remove. */
    const double rho = p->train.strategy == SG_STRATEGY_MCMC ? 0 : preset->rho;
    if (d->rho_least == SG_PRESET_RHO) /* a rho of one's own comes without */
        d->rho_least = d->rho == SG_PRESET_RHO && rho ? sg_round_digits(preset->rho_least) : 0;
    d->rho = d->rho == SG_PRESET_RHO ? sg_round_digits(rho) : d->rho;
    d->lambda = d->lambda == SG_PRESET_LAMBDA ? sg_round_digits(preset->lambda) : d->lambda;
    d->frequency =
        d->frequency == SG_PRESET_FREQUENCY ? sg_round_digits(preset->frequency) : d->frequency;
    d->view_weights = preset->view_weights;
    if (p->train.tolerance == SG_TOLERANCE_PRESET)
        p->train.tolerance = d->on && p->preset == SG_RUN_PRESET_AUTO ? SG_TOLERANCE_AUTO : 0;
}

static const char *const presets[] = {"auto", "ns", "tt", "mip"};

/* The published rho and lambda; for auto, what holds without photos. */
static struct sg_defense_params published(enum sg_run_preset preset)
{
    struct sg_defense_params p = sg_defense_params_default();
    sg_defense_preset(presets[preset], &p);
    return p;
}

int sg_run_check(sg_ctx *ctx, const struct sg_run_params *params)
{
    sg_clear_error(ctx);
    struct sg_run_params p = *params;
    int code = sg_check_options(ctx, sg_run_options(), &p);
    if (!code)
        code = sg_check_options(ctx, sg_scene_options(), &p.scene);
    if (!code)
        code = sg_config_check(ctx, sg_run_config, &p);
    if (code)
        return code;
    p.train.defense.on |= p.audit == SG_RUN_AUDIT_DEFEND; /* which the photos decide */
    const struct sg_defense_params *d = &p.train.defense;
    struct sg_defense_params preset = published(p.preset);
    if (p.preset == SG_RUN_PRESET_AUTO)
        preset.rho = -0.1; /* a share of growth, however large the photos make it */
    if (d->rho_least > 0 &&
        (d->rho == SG_PRESET_RHO ? p.preset != SG_RUN_PRESET_AUTO : d->rho >= 0))
        return sg_fail(
            ctx, SG_ERR_USAGE,
            "defense.rho_least: found %g with a fixed rho, expected preset auto or a rho "
            "below 0",
            d->rho_least);
    apply_preset(&p, &preset);
    p.train.tolerance = p.train.tolerance == SG_TOLERANCE_AUTO ? 0 : p.train.tolerance;
    return sg_train_check(ctx, &p.train);
}

/* Logs what was found, and does what the parameters ask for. */
static int apply_verdict(sg_run *r, const struct sg_audit *found)
{
    struct sg_run_params *p = &r->params;
    const bool clean = found->verdict == SG_AUDIT_CLEAN;
    sg_log(r->ctx, clean ? SG_LOG_INFO : SG_LOG_WARN, "audit: the photos look %s, score %.3f",
           sg_audit_verdict_name(found->verdict), found->score);
    for (size_t i = 0; i < found->count_reasons && !clean; i++)
        sg_log(r->ctx, SG_LOG_WARN, "audit: %s", found->reasons[i]);
    if (p->audit == SG_RUN_AUDIT_REFUSE && found->verdict == SG_AUDIT_POISONED)
        return sg_fail(r->ctx, SG_ERR_POISONED,
                       "%s: found poisoned photos, expected clean ones, which the run asks for",
                       p->source);
    if (p->audit == SG_RUN_AUDIT_DEFEND && !clean && !r->resume) /* a run keeps its own defense */
        p->train.defense.on = true;
    return SG_OK;
}

/* Looks at the photos; preset auto follows from them. */
static int audit(sg_run *r, struct sg_defense_params *preset)
{
    struct sg_run_params *p = &r->params;
    struct sg_audit *found = NULL;
    int code = sg_audit_scene(r->ctx, r->scene, &found);
    if (code)
        return code;
    r->audit = sg_audit_verdict_name(found->verdict), r->audit_score = found->score;
    code = apply_verdict(r, found);
    const bool automatic = p->train.defense.on && p->preset == SG_RUN_PRESET_AUTO;
    if (!code && (automatic || p->train.tolerance == SG_TOLERANCE_AUTO)) {
        struct sg_defense_params d = *preset;
        const size_t n = found->count + 1;
        r->view_weights = sg_alloc(r->ctx, SG_MEM_MISC, n, sizeof(*r->view_weights));
        r->tolerances = sg_alloc(r->ctx, SG_MEM_MISC, n, sizeof(*r->tolerances));
        if (!r->view_weights || !r->tolerances)
            code = SG_ERR_BUDGET;
        else if (!automatic)
            sg_defense_tolerances(found, r->tolerances);
        else
            sg_defense_automatic(found, r->scene->extent, (double) p->train.tolerance,
                                 r->view_weights, r->tolerances, &d);
        *preset = automatic ? d : *preset;
    }
    sg_audit_destroy(&found);
    return code;
}

/* What the photos decided is said, as the command line may not have it. */
static void say_defense(const sg_run *r)
{
    const struct sg_run_params *p = &r->params;
    const struct sg_defense_params *d = &p->train.defense;
    size_t tolerated = 0;
    float most = 0;
    for (size_t i = 0; r->train.tolerances && i < r->scene->n_train; i++) {
        tolerated += r->tolerances[i] > 0;
        most = fmaxf(most, r->tolerances[i]);
    }
    if (d->on)
        sg_log(r->ctx, SG_LOG_INFO, "defense: preset %s, rho %s%g, lambda %g", presets[p->preset],
               d->rho < 0 ? "growth:" : "", fabs(d->rho), d->lambda);
    else if (p->audit == SG_RUN_AUDIT_DEFEND)
        sg_log(r->ctx, SG_LOG_INFO, "defense: none, as the photos look clean");
    if (r->train.tolerances)
        sg_log(r->ctx, SG_LOG_INFO, "tolerance: %zu of %zu photos, at most %.1f grey levels",
               tolerated, r->scene->n_train, (double) most);
}

int sg_run_decide_defense(sg_run *r)
{
    struct sg_run_params *p = &r->params;
    struct sg_defense_params preset = published(p->preset);
    int code = SG_OK;
    if (p->preset == SG_RUN_PRESET_AUTO)
        preset.frequency = sg_defense_frequency(r->scene->extent);
    if (p->audit != SG_RUN_AUDIT_OFF || p->train.tolerance == SG_TOLERANCE_AUTO ||
        (p->train.defense.on && p->preset == SG_RUN_PRESET_AUTO))
        code = audit(r, &preset);
    apply_preset(p, &preset);
    r->train = p->train;
    r->train.tolerances = p->train.tolerance == SG_TOLERANCE_AUTO ? r->tolerances : NULL;
    r->train.tolerance = fmaxf(p->train.tolerance, 0);
    r->train.white_background = p->scene.white_background;
    if (!code && !r->resume) /* a run keeps what it has */
        say_defense(r);
    return code;
}
