/* SPDX-License-Identifier: Apache-2.0 */
/* The trainer's whole state in one file: a header, a section for each column that is saved (little
 * endian float32) and for the state of the strategy, then a checksum of everything before it. */
#include <float.h>
#include <math.h>
#include <string.h>

#define XXH_INLINE_ALL
#include <xxhash.h>

#include "begin.h"
#include "checkpoint.h"
#include "core/file.h"
#include "exposure.h"
#include "model/anchors.h"
#include "scene/reader.h"
#include "schedule.h"
#include "trainer.h"

#define MAGIC "SGCKPT\0\14" /* the last byte is the version */

/* of struct sg_train_params; counting beyond it does not overflow */
#define MAX_ITERATION 10000000

static bool counters_sound(const struct sg_checkpoint_header *h)
{
    bool sound = h->iteration >= 0 && h->iteration <= MAX_ITERATION && h->ended <= (h->steps > 0);
    for (int g = 0; g < SG_GROUPS; g++)
        sound = sound && h->adam_steps[g] >= 0 && h->adam_steps[g] <= h->iteration - (h->ended > 0);
    return sound && h->steps <= (uint64_t) h->iteration;
}

static bool measures_sound(const struct sg_checkpoint_header *h)
{
    return h->spent >= 0 && h->spent < 1e12 && h->noise >= 0 && h->noise <= 255 && h->beyond >= 0 &&
           h->beyond <= 1 && h->smooths <= (h->noise > 0);
}

static uint32_t cameras_hash(const struct sg_scene *scene)
{
    XXH3_state_t hash;
    XXH3_64bits_reset(&hash);
    for (size_t i = 0; i < scene->n_train; i++) {
        const struct sg_view *v = &scene->train[i];
        const struct sg_camera *c = &v->camera;
        const double numbers[] = {c->width, c->height, c->fx, c->fy, c->cx, c->cy};
        XXH3_64bits_update(&hash, v->name, strlen(v->name) + 1);
        XXH3_64bits_update(&hash, numbers, sizeof(numbers));
        XXH3_64bits_update(&hash, c->R, sizeof(c->R));
        XXH3_64bits_update(&hash, c->t, sizeof(c->t));
    }
    return (uint32_t) XXH3_64bits_digest(&hash);
}

uint32_t sg_photos_hash(const struct sg_scene *scene)
{
    XXH3_state_t hash;
    XXH3_64bits_reset(&hash);
    for (size_t i = 0; i < scene->n_train; i++) {
        const struct sg_view *v = &scene->train[i];
        const uint64_t own = v->hash ? v->hash : sg_view_hash(v);
        XXH3_64bits_update(&hash, &own, sizeof(own));
    }
    return (uint32_t) XXH3_64bits_digest(&hash);
}

/* A file and the hash of the bytes written to it or read from it. */
struct hashed {
    FILE *stream;
    XXH3_state_t hash;
};

static void put(struct hashed *s, const void *data, size_t bytes)
{
    XXH3_64bits_update(&s->hash, data, bytes);
    fwrite(data, 1, bytes, s->stream); /* errors are reported when the file is committed */
}

#define STRATEGY "strategy:"

static void title_of_strategy(const struct sg_strategy *strategy, char title[24])
{
    snprintf(title, 24, STRATEGY "%s", strategy->name);
}

static uint64_t column_bytes(int c, size_t n, int sh_degree)
{
    return n * (uint64_t) sg_column_planes(c, sh_degree) * sizeof(float);
}

static unsigned saved_bits(const sg_trainer *t)
{
    return SG_COLUMN_SAVED | (t->params.model == SG_MODEL_MIP ? SG_COLUMN_MIP : 0) |
           (t->params.model == SG_MODEL_SCAFFOLD ? SG_COLUMN_ANCHORS : 0) |
           (sg_counts_radii(&t->params) ? SG_COLUMN_RADII : 0) |
           (sg_spares_anchors(&t->params) ? SG_COLUMN_GRACE : 0);
}

static bool is_saved(const sg_trainer *t, int c)
{
    return sg_column_of(c, saved_bits(t));
}

/* Whether a run has it depends on its limits, which may be others when it is resumed. */
static bool follows_limits(int c)
{
    return sg_columns[c].bits & SG_COLUMN_RADII;
}

/* How many of n Gaussians are in the block that begins with this one. */
static size_t block_rows(size_t n, size_t first)
{
    return n - first < SG_LANES ? n - first : SG_LANES;
}

/* A column's section, from the array that it lies in. */
static void put_column(struct hashed *s, int c, int sh_degree, size_t n, const float *array)
{
    struct sg_checkpoint_section head = {.planes = (uint32_t) sg_column_planes(c, sh_degree),
                                         .bytes = column_bytes(c, n, sh_degree)};
    float block[SG_COLUMN_PLANES_MAX * SG_LANES];
    const int stride = sg_column_array_planes(c, sh_degree);
    snprintf(head.title, sizeof(head.title), "%s", sg_columns[c].name);
    put(s, &head, sizeof(head));
    for (size_t first = 0; first < n; first += SG_LANES) {
        const size_t rows = block_rows(n, first);
        for (size_t p = 0; p < head.planes; p++)
            memcpy(block + p * rows,
                   array + sg_param_index(stride, first, sg_columns[c].first + (int) p),
                   rows * sizeof(float));
        put(s, block, head.planes * rows * sizeof(float));
    }
}

/* One array at a time through `scratch`: a second copy of all arrays would be the largest
 * allocation of a run. */
static int put_columns(sg_trainer *t, struct hashed *sink, struct sg_model *scratch)
{
    for (int c = 0; c < SG_COLUMNS; c++) {
        struct sg_columns one = {0};
        int code = SG_OK;
        one.at[c] = scratch->params;
        if (!is_saved(t, c))
            continue;
        if (c == SG_C_PARAMETERS)
            code = sg_engine_download(t->engine, scratch, NULL);
        else if (sg_column_has_array(c))
            code = sg_engine_download(t->engine, NULL, &one);
        if (code)
            return code;
        put_column(sink, c, t->sh_degree, scratch->count, scratch->params);
    }
    return SG_OK;
}

/* A section that is no column. */
static void put_numbers(struct hashed *sink, const char *title, const void *numbers, uint64_t bytes)
{
    struct sg_checkpoint_section head = {.bytes = bytes};
    snprintf(head.title, sizeof(head.title), "%s", title);
    put(sink, &head, sizeof(head));
    put(sink, numbers, bytes);
}

/* Sections: columns, then these. */
enum { EXPOSURES = SG_COLUMNS, TOLERANCES, STRATEGY_STATE, NETWORK_WEIGHTS, SECTIONS };
#define OF_PHOTOS EXPOSURES /* up to STRATEGY_STATE: numbers of each photo */

/* What is saved of each training photo. */
struct photo_numbers {
    const char *title, *expected;
    float *at; /* NULL: this run has none */
    size_t count;
    float least, most; /* of each number */
    size_t squares;    /* so many at the end are never below 0: Adam's second moments */
};

static struct photo_numbers numbers_of_photos(const sg_trainer *t, int section)
{
    const size_t n = t->scene->n_train;
    return section == EXPOSURES
               ? (struct photo_numbers){"exposure",
                                        "finite numbers, second moments of at least 0",
                                        t->exposures,
                                        n * SG_EXPOSURE_FLOATS,
                                        -FLT_MAX,
                                        FLT_MAX,
                                        n * SG_EXPOSURE}
               : (struct photo_numbers){"tolerances", "0 to 255", t->tolerances, n, 0, 255, 0};
}

static uint64_t photos_bytes(const sg_trainer *t, int section)
{
    const struct photo_numbers p = numbers_of_photos(t, section);
    return p.at ? p.count * sizeof(*p.at) : 0;
}

#define NETWORKS "networks"

static uint64_t networks_bytes(const sg_trainer *t)
{
    return t->params.model == SG_MODEL_SCAFFOLD
               ? sg_networks_floats(sg_network_parts(&t->params.scaffold),
                                    sg_trainer_appearances(t)) *
                     sizeof(float)
               : 0;
}

static int put_networks(const sg_trainer *t, struct hashed *sink)
{
    if (!networks_bytes(t))
        return SG_OK;
    struct sg_columns own = {.networks = sg_networks_create(t->ctx, sg_trainer_appearances(t))};
    float *numbers = sg_alloc_raw(t->ctx, SG_MEM_MISC, 1, (size_t) networks_bytes(t));
    const int code =
        own.networks && numbers ? sg_engine_download(t->engine, NULL, &own) : SG_ERR_BUDGET;
    if (!code) {
        sg_networks_pack(own.networks, numbers);
        put_numbers(sink, NETWORKS, numbers, networks_bytes(t));
    }
    sg_free(numbers);
    sg_free(own.networks);
    return code;
}

static void put_state(const sg_trainer *t, struct hashed *sink)
{
    char title[24];
    title_of_strategy(t->strategy, title);
    if (t->strategy->state_bytes)
        put_numbers(sink, title, t->strategy_state, t->strategy->state_bytes);
    for (int c = OF_PHOTOS; c < STRATEGY_STATE; c++) {
        const struct photo_numbers p = numbers_of_photos(t, c);
        if (p.at)
            put_numbers(sink, p.title, p.at, photos_bytes(t, c));
    }
}

/* A buffer in the form of a model, large enough for the array of any column. */
static int alloc_scratch(const sg_trainer *t, struct sg_model *out)
{
    const size_t n = sg_engine_count(t->engine), blocks = (n + SG_LANES - 1) / SG_LANES;
    int most = 0;
    for (int c = 0; c < SG_COLUMNS; c++) {
        const int planes = sg_column_array_planes(c, t->sh_degree);
        most = is_saved(t, c) && planes > most ? planes : most;
    }
    *out = (struct sg_model){.count = n, .capacity = blocks * SG_LANES, .sh_degree = t->sh_degree};
    out->params = sg_alloc_raw(t->ctx, SG_MEM_MODEL, out->capacity, (size_t) most * sizeof(float));
    return out->params ? SG_OK : SG_ERR_BUDGET;
}

int sg_trainer_save(sg_trainer *t, const char *path)
{
    sg_ctx *ctx = t->ctx;
    sg_clear_error(ctx);
    struct sg_model m = {0};
    struct sg_file_writer w = {0};
    struct hashed sink;
    int code = alloc_scratch(t, &m);
    if (code || (code = sg_engine_read_exposures(t->engine)) ||
        (code = sg_file_create(ctx, &w, path)))
        goto done;
    /* Of the steps that changed nothing the first is the end; each after it is one iteration. */
    const uint64_t beyond = t->idle > 0 ? t->idle - 1 : 0;
    struct sg_checkpoint_header h = {
        .count = m.count,
        .sh_degree = m.sh_degree,
        .iteration = t->iteration - (int) beyond,
        .start_degree = t->start_degree,
        .cameras = cameras_hash(t->scene),
        .seed = t->params.seed,
        .views = t->scene->n_train,
        .extent = t->extent,
        .steps = t->steps - beyond,
        .spent =
            t->params.max_seconds > 0 ? sg_trainer_elapsed(t) : 0, /* else the same bytes always */
        .noise = t->noise,
        .beyond = t->beyond,
        .smooths = t->smooths,
        .gaussians_bound = t->gaussians_bound,
        .time_bound = t->time_bound,
        .photos = t->photos_hash,
        .parameters = t->identity.parameters,
        .strength = t->identity.strength,
        .kind = t->identity.kind,
        .ended = t->idle > 0,
        .sections = (t->strategy->state_bytes > 0) + (networks_bytes(t) > 0)};
    for (int c = 0; c < SG_COLUMNS; c++)
        h.sections += is_saved(t, c);
    for (int c = OF_PHOTOS; c < STRATEGY_STATE; c++)
        h.sections += photos_bytes(t, c) > 0;
    memcpy(h.magic, MAGIC, sizeof(h.magic));
    for (int g = 0; g < SG_GROUPS; g++)
        h.adam_steps[g] = t->adam_steps[g];
    sink.stream = w.stream;
    XXH3_64bits_reset(&sink.hash);
    put(&sink, &h, sizeof(h));
    if ((code = put_columns(t, &sink, &m)))
        goto done;
    put_state(t, &sink);
    if ((code = put_networks(t, &sink)))
        goto done;
    const uint64_t digest = XXH3_64bits_digest(&sink.hash);
    fwrite(&digest, sizeof(digest), 1, w.stream);
    code = sg_file_commit(ctx, &w);
done:
    sg_file_abandon(&w);
    sg_free(m.params);
    return code;
}

/* What a file has of its own run and scene; names the first that is not as in this one. */
static int check_numbers(const sg_trainer *t, const char *path,
                         const struct sg_checkpoint_header *h)
{
    sg_ctx *ctx = t->ctx;
    if (!h->count)
        return sg_fail(ctx, SG_ERR_INPUT, "%s: found no Gaussians, expected some", path);
    if (h->sh_degree < 0 || h->sh_degree > 3)
        return sg_fail(ctx, SG_ERR_INPUT, "%s: SH degree: found %d, expected 0 to 3", path,
                       h->sh_degree);
    if (h->start_degree < 0 || h->start_degree > h->sh_degree)
        return sg_fail(ctx, SG_ERR_INPUT, "%s: first SH degree: found %d, expected 0 to %d", path,
                       h->start_degree, h->sh_degree);
    if (h->views != t->scene->n_train)
        return sg_fail(
            ctx, SG_ERR_INPUT,
            "%s: training views: found %llu, expected the %zu that the scene has now: photos are "
            "missing or new",
            path, (unsigned long long) h->views, t->scene->n_train);
    if (h->seed != t->params.seed)
        return sg_fail(ctx, SG_ERR_INPUT, "%s: seed: found %llu, expected %llu, that of this run",
                       path, (unsigned long long) h->seed, (unsigned long long) t->params.seed);
    if (h->extent != t->extent)
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: extent: found %.17g, expected %.17g, that of this scene", path,
                       h->extent, t->extent);
    return SG_OK;
}

static int check_header(const sg_trainer *t, FILE *f, const char *path,
                        const struct sg_checkpoint_header *h)
{
    sg_ctx *ctx = t->ctx;
    static const char *const kinds[] = {
        [SG_RUN_TRAINING] = "a training", [SG_RUN_ATTACK] = "an attack"};
    if (h->kind > SG_RUN_ATTACK || h->kind != t->identity.kind)
        return sg_fail(ctx, SG_ERR_INPUT, "%s: found a checkpoint of %s, expected one of %s", path,
                       h->kind > SG_RUN_ATTACK ? "an unknown kind" : kinds[h->kind],
                       kinds[t->identity.kind]);
    int code = check_numbers(t, path, h);
    if (code)
        return code;

    /* Anchors have no spherical harmonics, and room for none. */
    if (t->params.model == SG_MODEL_SCAFFOLD && h->sh_degree)
        return sg_fail(ctx, SG_ERR_INPUT, "%s: found anchors with SH degree %d, expected 0", path,
                       h->sh_degree);

    if (h->cameras != cameras_hash(t->scene))
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: found a run on other training views, expected those of %s", path,
                       t->scene->path);

    if (h->parameters != t->identity.parameters)
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: found a run with other parameters, expected those of this run", path);

    /* Photos that another decoder changed are not refused, nor is a defense that an audit adapted
     * to them. */
    if (h->photos != t->photos_hash)
        sg_log(ctx, SG_LOG_WARN, "%s: the run began with other photos than %s has now", path,
               t->scene->path);
    else if (h->strength != t->identity.strength)
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: found a run with another tolerance or strength of the defense, "
                       "expected those of this run",
                       path);

    if (!counters_sound(h))
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: byte %zu: found iteration %d%s with %d steps of positions, expected 0 "
                       "to %d and no more steps than iterations, none in a last one",
                       path, offsetof(struct sg_checkpoint_header, iteration), h->iteration,
                       h->ended ? ", the last one," : "", h->adam_steps[SG_G_XYZ], MAX_ITERATION);
    if (!measures_sound(h))
        return sg_fail(
            ctx, SG_ERR_INPUT,
            "%s: found %g seconds, noise of %g levels, a share of %g and %u for smoothing, "
            "expected 0 to 1e12, 0 to 255, 0 to 1 and 0, or 1 with noise",
            path, h->spent, h->noise, h->beyond, h->smooths);

    /* Checks the count against the file's length before anything is allocated for it. */
    const long long at = ftell(f);
    fseek(f, 0, SEEK_END);
    const long long size = ftell(f);
    fseek(f, (long) at, SEEK_SET);
    const uint64_t per_gaussian = (uint64_t) sg_param_count(h->sh_degree) * sizeof(float);
    if (size < at || h->count > (uint64_t) (size - at) / per_gaussian)
        return sg_fail(ctx, SG_ERR_INPUT, "%s: found %lld bytes, expected room for %llu Gaussians",
                       path, size, (unsigned long long) h->count);

    return SG_OK;
}

int sg_checkpoint_open(const sg_trainer *t, const char *path, struct sg_checkpoint *out)
{
    *out = (struct sg_checkpoint){.path = path};
    int code = sg_file_open(t->ctx, path, &out->file);
    if (code)
        return code;
    char first[sizeof(MAGIC)];
    struct sg_checkpoint_header *h = &out->header;
    const bool read = fread(h, sizeof(*h), 1, out->file) == 1;
    sg_show_bytes(h->magic, read ? sizeof(h->magic) - 1 : 0, first);
    if (!read)
        code = sg_fail(t->ctx, SG_ERR_INPUT, "%s: found less than %zu bytes, expected a checkpoint",
                       path, sizeof(*h));
    else if (memcmp(h->magic, MAGIC, sizeof(h->magic) - 1))
        code =
            sg_fail(t->ctx, SG_ERR_INPUT, "%s: byte 0: found \"%s\", expected \"%s\": a checkpoint",
                    path, first, MAGIC);
    else if (h->magic[7] != MAGIC[7])
        code = sg_fail(t->ctx, SG_ERR_INPUT,
                       "%s: byte 7: found version %d, expected version %d of a checkpoint", path,
                       h->magic[7], MAGIC[7]);
    else
        code = check_header(t, out->file, path, h);
    if (code)
        sg_checkpoint_close(out);
    return code;
}

void sg_checkpoint_close(struct sg_checkpoint *c)
{
    if (c->file)
        fclose(c->file);
    c->file = NULL;
}

static bool get(struct hashed *s, void *to, size_t bytes)
{
    if (fread(to, 1, bytes, s->stream) != bytes)
        return false;
    XXH3_64bits_update(&s->hash, to, bytes);
    return true;
}

static int torn(sg_ctx *ctx, const char *path)
{
    return sg_fail(ctx, SG_ERR_INPUT,
                   "%s: found a truncated or altered checkpoint: the checksum does not match",
                   path);
}

/* A checkpoint while it is read. */
struct reading {
    const sg_trainer *t;
    const struct sg_checkpoint *c;
    struct hashed in;
    size_t n, kept; /* Gaussians in the file, and how many are kept */
    struct sg_model *m;
    struct sg_columns columns;
    float *networks; /* as numbers */
    void *state;     /* of the strategy */
    bool found[SECTIONS];
};

/* Of a column of n Gaussians those `kept` of them that stay; nothing where this run has no such
 * column. */
static bool get_column(struct reading *r, int c)
{
    const int degree = r->m->sh_degree, stride = sg_column_array_planes(c, degree);
    const size_t planes = (size_t) sg_column_planes(c, degree);
    float block[SG_COLUMN_PLANES_MAX * SG_LANES];
    float *to = sg_column_is_parameter(c) ? r->m->params : r->columns.at[c];
    size_t k = 0;
    for (size_t first = 0; first < r->n; first += SG_LANES) {
        const size_t rows = block_rows(r->n, first);
        if (!get(&r->in, block, planes * rows * sizeof(float)))
            return false;
        for (size_t i; k < r->kept && (i = sg_evenly(r->n, k, r->kept)) < first + rows; k++)
            for (size_t p = 0; to && p < planes; p++)
                to[sg_param_index(stride, k, sg_columns[c].first + (int) p)] =
                    block[p * rows + i - first];
    }
    return true;
}

static uint64_t section_bytes(const struct reading *r, int c)
{
    return c == STRATEGY_STATE    ? r->t->strategy->state_bytes
           : c == NETWORK_WEIGHTS ? networks_bytes(r->t)
           : c >= OF_PHOTOS       ? photos_bytes(r->t, c)
                                  : column_bytes(c, r->n, r->m->sh_degree);
}

static void section_title(const struct reading *r, int c, char title[24])
{
    if (c == STRATEGY_STATE)
        title_of_strategy(r->t->strategy, title);
    else
        snprintf(title, 24, "%s",
                 c == NETWORK_WEIGHTS ? NETWORKS
                 : c >= OF_PHOTOS     ? numbers_of_photos(r->t, c).title
                                      : sg_columns[c].name);
}

/* A section that this run reads. sh_rest of degree 0 exists, with 0 bytes. */
static bool is_known(const struct reading *r, int c)
{
    return c < SG_COLUMNS ? is_saved(r->t, c) || follows_limits(c) : section_bytes(r, c) > 0;
}

static bool is_needed(const struct reading *r, int c)
{
    return is_known(r, c) && !(c < SG_COLUMNS && follows_limits(c));
}

/* Which one it is; -1: none that this run reads. */
static int find_section(const struct reading *r, const struct sg_checkpoint_section *s)
{
    char title[sizeof(s->title)];
    for (int c = 0; c < SECTIONS; c++) {
        section_title(r, c, title);
        if (is_known(r, c) && !strncmp(s->title, title, sizeof(title)))
            return c;
    }
    return -1;
}

static int get_section(struct reading *r)
{
    sg_ctx *ctx = r->t->ctx;
    const char *path = r->c->path;
    struct sg_checkpoint_section s;
    char title[sizeof(s.title) + 1];
    const long long at = ftell(r->in.stream);
    if (!get(&r->in, &s, sizeof(s)))
        return torn(ctx, path);
    const int c = find_section(r, &s);
    sg_show_bytes(s.title, strnlen(s.title, sizeof(s.title)), title);
    if (c < 0)
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: byte %lld: found section \"%s\", expected a column of this version, "
                       "what this training has of each photo, or the state of strategy %s",
                       path, at, title, r->t->strategy->name);
    if (r->found[c])
        return sg_fail(ctx, SG_ERR_INPUT, "%s: byte %lld: found section \"%s\" twice", path, at,
                       title);
    r->found[c] = true;
    const int degree = r->m->sh_degree;
    const uint32_t planes = c < SG_COLUMNS ? (uint32_t) sg_column_planes(c, degree) : 0;
    const uint64_t bytes = section_bytes(r, c);
    if (s.planes != planes || s.bytes != bytes)
        return sg_fail(
            ctx, SG_ERR_INPUT,
            "%s: byte %lld: found section \"%s\" with %u planes and %llu bytes, expected "
            "%u and %llu",
            path, at, title, s.planes, (unsigned long long) s.bytes, planes,
            (unsigned long long) bytes);
    void *numbers = c == NETWORK_WEIGHTS  ? (void *) r->networks
                    : c == STRATEGY_STATE ? r->state
                                          : (void *) numbers_of_photos(r->t, c).at;
    const bool whole = c < SG_COLUMNS ? get_column(r, c) : get(&r->in, numbers, (size_t) bytes);
    return whole ? SG_OK : torn(ctx, path);
}

static int check_numbers_of_photos(const struct reading *r, int section)
{
    const struct photo_numbers p = numbers_of_photos(r->t, section);
    for (size_t i = 0; p.at && i < p.count; i++)
        if (!(p.at[i] >= (i + p.squares < p.count ? p.least : 0) && p.at[i] <= p.most))
            return sg_fail(r->t->ctx, SG_ERR_INPUT,
                           "%s: section \"%s\": found value %zu of %g, expected %s", r->c->path,
                           p.title, i, (double) p.at[i], p.expected);
    return SG_OK;
}

static int check_networks(const struct reading *r)
{
    const unsigned parts = sg_network_parts(&r->t->params.scaffold);
    const float *values = r->networks;
    const size_t n = (size_t) networks_bytes(r->t) / sizeof(float);
    for (size_t i = 0; i < n; i++)
        if (!isfinite(values[i]) || (i + 1 == n && !(values[i] > 0)) ||
            (values[i] < 0 && sg_networks_square(parts, i)))
            return sg_fail(r->t->ctx, SG_ERR_INPUT,
                           "%s: section \"" NETWORKS "\": found value %zu of %g, expected finite "
                           "numbers, second moments of at least 0, and a voxel above 0",
                           r->c->path, i, (double) values[i]);
    return SG_OK;
}

/* Parameters and first moments of Gaussians may be any numbers: training goes on without such a
 * Gaussian. Those of anchors may not, since the networks learn from all. */
static int check_column(const struct reading *r, int c)
{
    const bool measure = sg_columns[c].bits & SG_COLUMN_MEASURE, finite = measure || r->networks,
               positive = measure || sg_columns[c].bits & SG_COLUMN_SUM;
    const int planes = sg_column_planes(c, r->m->sh_degree),
              stride = sg_column_array_planes(c, r->m->sh_degree);
    const float *from = sg_column_is_parameter(c) ? r->m->params : r->columns.at[c];
    for (size_t k = 0; k < r->kept && (positive || finite) && is_saved(r->t, c); k++)
        for (int p = 0; p < planes; p++) {
            const float value = from[sg_param_index(stride, k, sg_columns[c].first + p)];
            if ((positive && value < 0) || (finite && !isfinite(value)))
                return sg_fail(r->t->ctx, SG_ERR_INPUT,
                               "%s: section \"%s\": %s %zu: found %g, expected a %snumber%s",
                               r->c->path, sg_columns[c].name, r->networks ? "anchor" : "Gaussian",
                               sg_evenly(r->n, k, r->kept), (double) value, finite ? "finite " : "",
                               positive ? " of at least 0" : "");
        }
    return SG_OK;
}

/* Each section is there, and the file is as it was written. */
static int check_end(struct reading *r)
{
    sg_ctx *ctx = r->t->ctx;
    const struct sg_strategy *strategy = r->t->strategy;
    char title[24];
    for (int c = 0; c < SECTIONS; c++) {
        section_title(r, c, title);
        if (!r->found[c] && is_needed(r, c))
            return sg_fail(ctx, SG_ERR_INPUT, "%s: found no section \"%s\", expected one",
                           r->c->path, title);
    }
    title_of_strategy(strategy, title);
    uint64_t digest = 0;
    if (fread(&digest, sizeof(digest), 1, r->in.stream) != 1 || fgetc(r->in.stream) != EOF ||
        digest != XXH3_64bits_digest(&r->in.hash))
        return torn(ctx, r->c->path);
    if (strategy->sound &&
        !strategy->sound(r->state, r->c->header.iteration - (r->c->header.ended > 0)))
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: section \"%s\": found a state that iteration %d cannot have",
                       r->c->path, title, r->c->header.iteration);
    for (int c = 0; c < STRATEGY_STATE; c++) {
        const int code = c < OF_PHOTOS ? check_column(r, c) : check_numbers_of_photos(r, c);
        if (code)
            return code;
    }
    return networks_bytes(r->t) ? check_networks(r) : SG_OK;
}

int sg_checkpoint_read(sg_trainer *t, const struct sg_checkpoint *c)
{
    sg_ctx *ctx = t->ctx;
    const struct sg_checkpoint_header *h = &c->header;
    struct reading r = {
        .t = t, .c = c, .in.stream = c->file, .n = (size_t) h->count, .state = t->strategy_state};
    int code;
    r.kept = sg_trainer_fit_count(t, r.n);
    XXH3_64bits_reset(&r.in.hash);
    XXH3_64bits_update(&r.in.hash, h, sizeof(*h));
    if ((code = sg_model_create(ctx, r.kept, h->sh_degree, &r.m)) ||
        (code = sg_columns_create(ctx, r.kept, h->sh_degree, saved_bits(t), &r.columns)))
        goto done;
    if (networks_bytes(t) &&
        (!(r.networks = sg_alloc_raw(ctx, SG_MEM_MISC, 1, (size_t) networks_bytes(t))) ||
         !(r.columns.networks = sg_networks_create(ctx, sg_trainer_appearances(t))))) {
        code = SG_ERR_BUDGET;
        goto done;
    }
    for (uint32_t s = 0; s < h->sections; s++)
        if ((code = get_section(&r)))
            goto done;
    if ((code = check_end(&r)))
        goto done;
    if (r.networks) {
        r.columns.networks->parts = sg_network_parts(&t->params.scaffold);
        sg_networks_unpack(r.networks, r.columns.networks);
    }
    if ((code = sg_engine_adopt(t->engine, r.m, &r.columns)))
        goto done;
    /* The last iteration changes nothing. In a longer run it is another one, and is done again. */
    const bool again = h->ended && t->params.iterations > h->iteration;
    t->start_degree = h->start_degree;
    t->resumed = h->iteration;
    t->iteration = h->iteration - again;
    t->steps = h->steps - again;
    t->idle = h->ended && !again;
    t->spent += h->spent;
    t->noise = h->noise, t->beyond = h->beyond;
    t->smooths = h->smooths && t->tolerances;
    t->gaussians_bound = h->gaussians_bound || r.kept < r.n, t->time_bound = h->time_bound;
    for (int g = 0; g < SG_GROUPS; g++)
        t->adam_steps[g] = h->adam_steps[g];
done:
    sg_free(r.networks);
    sg_columns_clear(&r.columns);
    sg_model_destroy(&r.m);
    return code;
}
