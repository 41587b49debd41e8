/* SPDX-License-Identifier: Apache-2.0 */
/* Which defense a run gets: what was asked for, and with preset auto what the photos look like. */
#include <math.h>

#include "train_run.h"

/* suspicion: 0..1, of the photos; decides only with preset auto. Its rho has few digits, so that config.json gives a
 * resumed run the same number. */
static void settle_defense(struct train_config *c, double suspicion)
{
    const struct {
        double rho, lambda;
    } presets[] = {[DEFENSE_AUTO] = {-round(1e6 * (0.1 + 0.35 * suspicion)) / 1e6, 6},
                   [DEFENSE_NS] = {0.03, 4},
                   [DEFENSE_TT] = {0.045, 4},
                   [DEFENSE_MIP] = {0.05, 5}};
    struct sg_defense_params *d = &c->train.defense;
    d->on = c->defense;
    d->rho = d->rho <= -1 ? presets[c->preset].rho : d->rho;
    d->lambda = d->lambda < 0 ? presets[c->preset].lambda : d->lambda;
}

/* With preset auto each photo is smoothed as much as it looks poisoned, and rho follows from all. */
static int settle_automatic(struct train_run *r, const struct sg_audit *found)
{
    double sum = 0;
    if (!(r->shares = malloc(found->count * sizeof(*r->shares)))) {
        say(stderr, "splatguard: out of memory\n");
        return 3;
    }
    for (size_t i = 0; i < found->count; i++) {
        const double suspicion = fmin(fmax((found->images[i].score - 0.3) / 0.6, 0), 1);
        r->shares[i] = (float) suspicion;
        sum += suspicion;
    }
    settle_defense(r->config, sum / (double) found->count);
    r->config->train.defense.shares = r->shares;
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
    if (c->audit == AUDIT_OFF && !(c->defense && c->preset == DEFENSE_AUTO)) {
        settle_defense(c, 1);
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
        settle_defense(c, 1);
    sg_audit_destroy(r->ctx, &found);
    return code;
}
