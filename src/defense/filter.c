/* SPDX-License-Identifier: Apache-2.0 */
#include "filter.h"

#include <math.h>
#include <string.h>

#include "core/rng.h"
#include "math/real_f32.h"
#include "scene/cameras.h"

#include "math/neural.h"

double sg_filter_log_weight(const struct sg_defense_params *p, float log_smallest)
{
    const double pi = 3.14159265358979323846, power = p->sigma == SG_SIGMA_EIGEN ? 4 : 2;
    const double u = 2 * pi * pi * p->frequency * p->frequency * exp(power * (double) log_smallest);
    return u > 0 ? p->exponent * log(-expm1(-u)) : -INFINITY;
}

/* The views to count in: all, or a sample without replacement that depends on seed and iteration
 * only. */
static size_t sample_views(const struct sg_scene *scene, const struct sg_defense_params *p,
                           uint64_t seed, int it, const struct sg_camera **views)
{
    const size_t n = scene->n_train, wanted = (size_t) p->views;
    if (p->sample == SG_VIEWS_ALL || wanted >= n)
        return n;
    for (size_t i = 0; i < wanted; i++) {
        const size_t j =
            i + (size_t) (sg_rng_u64(seed, SG_RNG_COUNTED, (uint64_t) it, i) % (n - i));
        const struct sg_camera *swap = views[i];
        views[i] = views[j], views[j] = swap;
    }
    return wanted;
}

struct score_job {
    const struct sg_defense_params *p;
    struct sg_scores *s;
    bool weighed; /* hits have their weight already */
};

#define CHUNK 4096

static void score_chunk(void *arg, size_t chunk, int thread)
{
    (void) thread;
    const struct score_job *j = arg;
    const size_t end = (chunk + 1) * CHUNK < j->s->count ? (chunk + 1) * CHUNK : j->s->count;
    for (size_t i = chunk * CHUNK; i < end; i++) {
        const double hits = j->s->score[i],
                     weight = j->weighed ? 0 : sg_filter_log_weight(j->p, j->s->log_smallest[i]);
        j->s->score[i] = hits > 0 ? weight + log(hits) : -INFINITY;
    }
}

static double weight_of(const void *params, float log_smallest)
{
    return exp(sg_filter_log_weight(params, log_smallest));
}

int sg_scores_create(sg_ctx *ctx, size_t n, struct sg_scores *out)
{
    *out = (struct sg_scores){
        .count = n,
        .score = sg_alloc_raw(ctx, SG_MEM_OPTIMISER, n, sizeof(*out->score)),
        .log_smallest = sg_alloc_raw(ctx, SG_MEM_OPTIMISER, n, sizeof(*out->log_smallest)),
        .keys = sg_alloc_raw(ctx, SG_MEM_OPTIMISER, n, sizeof(*out->keys))};
    if (out->score && out->log_smallest && out->keys)
        return SG_OK;
    sg_scores_clear(out);
    return SG_ERR_BUDGET;
}

size_t sg_filter_each(const struct sg_engine *engine, const struct sg_defense_params *p)
{
    return p->unit == SG_UNIT_GAUSSIAN ? sg_engine_each(engine) : 1;
}

int sg_score(struct sg_engine *engine, const struct sg_scene *scene,
             const struct sg_defense_params *p, const struct sg_render_params *render,
             uint64_t seed, int it, struct sg_scores *out)
{
    sg_ctx *ctx = sg_engine_ctx(engine);
    const size_t each = sg_filter_each(engine, p), rows = sg_engine_count(engine), n = each * rows;
    const struct sg_camera **views = sg_training_cameras(ctx, scene);
    const bool anchors = sg_engine_each(engine) > 1,
               weighed = anchors && p->anchor_sigma == SG_ANCHOR_SIGMA_NEURAL;
    int code = sg_scores_create(ctx, n, out);
    if (!views)
        code = SG_ERR_BUDGET;
    const size_t counted = code ? 0 : sample_views(scene, p, seed, it, views);
    const struct sg_weighing how = {.kind = p->hit,
                                    .shared = p->anchor_hits == SG_ANCHOR_HITS_ANCHOR,
                                    .weight = weighed ? weight_of : NULL,
                                    .arg = p,
                                    .combine = p->anchor_score,
                                    .single = each > 1};
    if (!code)
        code = anchors ? sg_engine_weigh_hits(engine, views, counted, render, &how, out->score)
                       : sg_engine_count_hits(engine, views, counted, render, p->hit, out->score);
    if (!code)
        code = sg_engine_read_statistics(
            engine, &(struct sg_statistics){.log_smallest = out->log_smallest});
    sg_free(views);
    if (code) {
        sg_scores_clear(out);
        return code;
    }
    for (size_t i = n; i-- > 0 && each > 1;) /* from anchors to their Gaussians, in place */
        out->log_smallest[i] = out->log_smallest[i / each];
    for (size_t i = 0; i < n; i++)
        out->unseen += !(out->score[i] > 0);
    out->sampled = counted < scene->n_train;
    sg_parallel_for(ctx, (n + CHUNK - 1) / CHUNK, score_chunk,
                    &(struct score_job){p, out, weighed});
    return SG_OK;
}

void sg_scores_clear(struct sg_scores *s)
{
    sg_free(s->score);
    sg_free(s->log_smallest);
    sg_free(s->keys);
    *s = (struct sg_scores){0};
}

/* An integer key with the order of the number. */
static uint64_t key_of(double v)
{
    uint64_t bits;
    v += 0.0; /* one zero */
    memcpy(&bits, &v, sizeof(bits));
    return bits >> 63 ? ~bits : bits | UINT64_C(1) << 63;
}

static double of_key(uint64_t key)
{
    const uint64_t bits = key >> 63 ? key & ~(UINT64_C(1) << 63) : ~key;
    double v;
    memcpy(&v, &bits, sizeof(v));
    return v;
}

/* The key at rank k: eight bits at a time, from the highest. */
static uint64_t select_key(const uint64_t *keys, size_t n, size_t k)
{
    size_t count[256];
    uint64_t found = 0;
    for (int shift = 56; shift >= 0; shift -= 8) {
        const uint64_t above = shift == 56 ? 0 : ~UINT64_C(0) << (shift + 8);
        memset(count, 0, sizeof(count));
        for (size_t i = 0; i < n; i++)
            if ((keys[i] & above) == found)
                count[keys[i] >> shift & 0xff]++;
        size_t digit = 0;
        while (k >= count[digit])
            k -= count[digit++];
        found |= (uint64_t) digit << shift;
    }
    return found;
}

/* The score at rank k of those that are set in `of`; NULL: of all. */
static double rank_of(const struct sg_scores *s, const uint8_t *of, size_t k)
{
    size_t n = 0;
    for (size_t i = 0; i < s->count; i++)
        if (!of || of[i])
            s->keys[n++] = key_of(s->score[i]);
    return of_key(select_key(s->keys, n, k));
}

double sg_scores_rank(const struct sg_scores *s, size_t k)
{
    return rank_of(s, NULL, k);
}

void sg_scores_remove(const struct sg_scores *s, size_t k, uint8_t *keep)
{
    if (!k)
        return;
    /* First all entries below the score at rank k, then as many equal ones as are left over. */
    size_t n = 0;
    for (size_t i = 0; i < s->count; i++)
        if (keep[i])
            s->keys[n++] = key_of(s->score[i]);
    const double last = of_key(select_key(s->keys, n, k - 1));
    n = 0;
    for (size_t i = 0; i < s->count; i++) {
        if (!keep[i])
            continue;
        if (s->score[i] < last)
            keep[i] = 0, k--;
        else if (s->score[i] == last)
            s->keys[n++] = key_of((double) s->log_smallest[i]);
    }
    /* Then the equals, by thickness and index. */
    const uint64_t thickness = select_key(s->keys, n, k - 1);
    for (size_t i = 0; i < s->count; i++)
        if (keep[i] && s->score[i] == last && key_of((double) s->log_smallest[i]) < thickness)
            keep[i] = 0, k--;
    for (size_t i = 0; i < s->count && k; i++)
        if (keep[i] && s->score[i] == last && key_of((double) s->log_smallest[i]) == thickness)
            keep[i] = 0, k--;
}

/* What a pass knows of every entry beside its score. */
struct pass {
    bool spares_unseen;
    size_t each;   /* entries of a row of the model */
    float *born;   /* of anchors that have grown, else 0; NULL: of no interest */
    int since;     /* those born later stay */
    uint8_t *gone; /* has been hidden before; NULL: there are no such */
    size_t hidden; /* the number of those */
    uint8_t *keep; /* what stays */
};

static bool is_gone(const struct pass *pass, size_t i)
{
    return pass->gone && pass->gone[i];
}

/* Whether it stays, however low its score is. */
static bool is_spared(const struct pass *pass, const struct sg_defense_params *p,
                      const struct sg_scores *s, size_t i)
{
    /* Without thickness the score is that of the unseen. */
    const bool unseen = pass->spares_unseen && s->score[i] == -INFINITY &&
                        sg_filter_log_weight(p, s->log_smallest[i]) > -INFINITY;
    const float born = pass->born ? pass->born[i / pass->each] : 0;
    return unseen || (born > 0 && born > (float) pass->since);
}

/* The number of the lowest of `all` that go, of those set in `keep`. */
static size_t share_of(const struct sg_scores *s, size_t all, enum sg_prune_rule rule, double rho,
                       const uint8_t *keep)
{
    size_t n = 0, lowest = (size_t) (rho * (double) all);
    for (size_t i = 0; i < s->count; i++)
        n += keep[i];
    if (rule == SG_PRUNE_THRESHOLD && rho > 0 && n) {
        const double limit = rank_of(s, keep, (size_t) (rho * (double) (n - 1)));
        lowest = 0;
        for (size_t i = 0; i < s->count; i++)
            lowest += keep[i] && s->score[i] <= limit;
    }
    lowest = lowest < n ? lowest : n;
    return lowest < all ? lowest : all ? all - 1 : 0; /* a model keeps at least one Gaussian */
}

/* Places of a column of the model. */
static size_t whole_blocks(const struct sg_engine *engine)
{
    return (sg_engine_count(engine) + SG_LANES - 1) / SG_LANES * SG_LANES;
}

/* Of every entry, whether it has been hidden before; adds how many have. */
static int find_hidden(struct sg_engine *engine, uint8_t *hidden, size_t *count)
{
    const size_t n = sg_engine_count(engine), each = sg_engine_each(engine);
    float *anchor = sg_alloc_raw(sg_engine_ctx(engine), SG_MEM_OPTIMISER, whole_blocks(engine),
                                 SG_A_PLANES * sizeof(*anchor));
    const int code =
        anchor ? sg_engine_download(engine, NULL, &(struct sg_columns){.at[SG_C_ANCHOR] = anchor})
               : SG_ERR_BUDGET;
    for (size_t i = 0; i < n * each && !code; i++) {
        const int plane = SG_A_OFFSET + 3 * (int) (i % each);
        hidden[i] = !neural_shown(anchor[sg_param_index(SG_A_PLANES, i / each, plane)]);
        *count += hidden[i];
    }
    sg_free(anchor);
    return code;
}

/* Hides the entries that are not kept, and removes the anchors that have no other. */
static int remove_single(struct sg_engine *engine, const uint8_t *keep)
{
    sg_ctx *ctx = sg_engine_ctx(engine);
    const size_t n = sg_engine_count(engine), each = sg_engine_each(engine);
    uint32_t *bits = sg_alloc(ctx, SG_MEM_OPTIMISER, n, sizeof(*bits));
    uint8_t *stays = sg_alloc(ctx, SG_MEM_OPTIMISER, n, 1);
    int code = bits && stays ? SG_OK : SG_ERR_BUDGET;
    size_t kept = 0;
    for (size_t i = 0; i < n * each && !code; i++) {
        bits[i / each] |= (uint32_t) !keep[i] << i % each;
        stays[i / each] |= keep[i];
    }
    for (size_t i = 0; i < n && !code; i++)
        kept += stays[i];
    if (!code)
        code = sg_engine_hide(engine, bits);
    if (!code && kept < n)
        code = sg_engine_edit(engine,
                              &(struct sg_edit){.keep = stays, .kept = kept, .statistics = true});
    sg_free(bits);
    sg_free(stays);
    return code;
}

static int begin_pass(struct sg_engine *engine, const struct sg_defense_params *p,
                      const struct sg_scores *s, int it, struct pass *out)
{
    sg_ctx *ctx = sg_engine_ctx(engine);
    const bool dated = p->grace && sg_engine_each(engine) > 1;
    *out = (struct pass){.spares_unseen = p->unseen == SG_UNSEEN_KEEP && s->sampled,
                         .each = sg_filter_each(engine, p),
                         .since = it - p->grace,
                         .keep = sg_alloc_raw(ctx, SG_MEM_OPTIMISER, s->count, 1)};
    const bool single = out->each > 1;
    if (dated)
        out->born = sg_alloc_raw(ctx, SG_MEM_OPTIMISER, whole_blocks(engine), sizeof(*out->born));
    if (single)
        out->gone = sg_alloc_raw(ctx, SG_MEM_OPTIMISER, s->count, 1);
    if (!out->keep || (dated && !out->born) || (single && !out->gone))
        return SG_ERR_BUDGET;
    int code = SG_OK;
    if (dated)
        code = sg_engine_download(engine, NULL, &(struct sg_columns){.at[SG_C_BORN] = out->born});
    if (!code && single)
        code = find_hidden(engine, out->gone, &out->hidden);
    return code;
}

/* Marks what stays. Returns how many go. */
static size_t choose(const struct pass *pass, const struct sg_defense_params *p, double rho,
                     const struct sg_scores *s)
{
    const size_t n = s->count;
    for (size_t i = 0; i < n; i++)
        pass->keep[i] = !is_gone(pass, i) && !is_spared(pass, p, s, i);
    const size_t lowest = share_of(s, n - pass->hidden, p->rule, rho, pass->keep);
    sg_scores_remove(s, lowest, pass->keep);
    for (size_t i = 0; i < n; i++)
        pass->keep[i] |= !is_gone(pass, i) && is_spared(pass, p, s, i);
    return lowest;
}

static void end_pass(struct pass *pass)
{
    sg_free(pass->keep);
    sg_free(pass->gone);
    sg_free(pass->born);
}

int sg_filter_choose(struct sg_engine *engine, const struct sg_defense_params *p,
                     const struct sg_scores *s, double rho, int it, uint8_t *keep)
{
    struct pass pass;
    const int code = begin_pass(engine, p, s, it, &pass);
    if (!code) {
        choose(&pass, p, rho, s);
        memcpy(keep, pass.keep, s->count);
    }
    end_pass(&pass);
    return code;
}

int sg_filter(struct sg_engine *engine, const struct sg_scene *scene,
              const struct sg_defense_params *p, const struct sg_render_params *render, double rho,
              uint64_t seed, int it, struct sg_defense_step *out)
{
    struct sg_scores s;
    int code = sg_score(engine, scene, p, render, seed, it, &s);
    if (code)
        return code;
    const size_t n = s.count, seen = n - s.unseen;
    struct pass pass;
    if (!(code = begin_pass(engine, p, &s, it, &pass))) {
        const size_t lowest = choose(&pass, p, rho, &s);
        out->filtered = true;
        out->rho = rho;
        out->scored = n - pass.hidden, out->removed = lowest, out->unseen = s.unseen - pass.hidden;
        for (int k = 0; k < 3 && seen; k++)
            out->score[k] = sg_scores_rank(
                &s, s.unseen + (size_t) ((double) (seen - 1) * (double[]){0.1, 0.5, 0.9}[k]));
        if (lowest && pass.gone)
            code = remove_single(engine, pass.keep);
        else if (lowest)
            code = sg_engine_edit(
                engine,
                &(struct sg_edit){.keep = pass.keep, .kept = n - lowest, .statistics = true});
    }
    end_pass(&pass);
    sg_scores_clear(&s);
    return code;
}
