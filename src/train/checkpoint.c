/* SPDX-License-Identifier: Apache-2.0 */
/* The trainer's whole state in one file: a header, then parameters, moments and statistics as they
 * lie in memory (little endian float32), then a checksum of everything before it. */
#include <string.h>

#define XXH_INLINE_ALL
#include <xxhash.h>

#include "begin.h"
#include "checkpoint.h"
#include "core/file.h"
#include "scene/reader.h"
#include "trainer.h"

#define MAGIC "SGCKPT\0\10" /* the last byte is the version */

/* of struct sg_train_params; counting on from it overflows nothing */
#define MAX_ITERATION 10000000

static bool counters_sound(const struct sg_checkpoint_header *h)
{
    bool sound = h->iteration >= 0 && h->iteration <= MAX_ITERATION;
    for (int g = 0; g < SG_GROUPS; g++)
        sound = sound && h->adam_steps[g] >= 0 && h->adam_steps[g] <= h->iteration;
    return sound && h->steps <= (uint64_t) h->iteration && h->spent >= 0 && h->spent < 1e12 &&
           h->growth >= 0 && h->growth <= 1 && h->growths >= 0 && h->growths <= h->iteration;
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

/* A file and the hash of what went to it or came from it. */
struct hashed {
    FILE *stream;
    XXH3_state_t hash;
};

static void put(struct hashed *s, const void *data, size_t bytes)
{
    XXH3_64bits_update(&s->hash, data, bytes);
    fwrite(data, 1, bytes, s->stream); /* errors surface when the file is committed */
}

#define PARTS 5

/* Bytes of each array of a checkpoint in file order: parameters, two moments, two statistics. */
static void sizes_of(size_t n, int sh_degree, size_t bytes[PARTS])
{
    const size_t blocks = (n + SG_LANES - 1) / SG_LANES;
    for (int i = 0; i < PARTS; i++)
        bytes[i] = i < 3 ? blocks * SG_LANES * (size_t) sg_param_count(sh_degree) * sizeof(float)
                         : n * sizeof(float);
}

int sg_trainer_save(sg_trainer *t, const char *path)
{
    sg_ctx *ctx = t->ctx;
    sg_clear_error(ctx);
    struct sg_model *m = NULL;
    struct sg_file_writer w = {0};
    struct hashed sink;
    int code = sg_model_create(ctx, sg_trainer_gaussians(t), t->sh_degree, &m);
    if (code || (code = sg_file_create(ctx, &w, path)))
        goto done;
    struct sg_checkpoint_header h = {.count = m->count,
                                     .sh_degree = m->sh_degree,
                                     .iteration = t->iteration,
                                     .start_degree = t->start_degree,
                                     .cameras = cameras_hash(t->scene),
                                     .seed = t->params.seed,
                                     .views = t->scene->n_train,
                                     .extent = t->extent,
                                     .steps = t->steps,
                                     .spent = t->params.max_seconds > 0
                                                  ? sg_trainer_elapsed(t)
                                                  : 0, /* else the same bytes always */
                                     .growth = t->growth,
                                     .gaussians_bound = t->gaussians_bound,
                                     .time_bound = t->time_bound,
                                     .growths = t->growths,
                                     .photos = t->photos_hash,
                                     .filter_first = t->filter_first,
                                     .parameters = t->identity.parameters,
                                     .strength = t->identity.strength,
                                     .kind = t->identity.kind};
    memcpy(h.magic, MAGIC, sizeof(h.magic));
    for (int g = 0; g < SG_GROUPS; g++)
        h.adam_steps[g] = t->adam_steps[g];
    sink.stream = w.stream;
    XXH3_64bits_reset(&sink.hash);
    put(&sink, &h, sizeof(h));
    /* One array at a time through the model's own: a second copy of all would be the largest thing
     * that a run holds. */
    struct sg_columns parts[PARTS] = {[1].at[SG_C_MOMENT1] = m->params,
                                      [2].at[SG_C_MOMENT2] = m->params,
                                      [3].at[SG_C_GRAD_SUM] = m->params,
                                      [4].at[SG_C_GRAD_COUNT] = m->params};
    size_t bytes[PARTS];
    sizes_of(m->count, m->sh_degree, bytes);
    for (int i = 0; i < PARTS; i++) {
        if ((code = sg_engine_download(t->engine, i == 0 ? m : NULL, &parts[i])))
            goto done;
        put(&sink, m->params, bytes[i]);
    }
    const uint64_t digest = XXH3_64bits_digest(&sink.hash);
    fwrite(&digest, sizeof(digest), 1, w.stream);
    code = sg_file_commit(ctx, &w);
done:
    sg_file_abandon(&w);
    sg_model_destroy(&m);
    return code;
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
    if (h->sh_degree < 0 || h->sh_degree > 3 || h->start_degree < 0 ||
        h->start_degree > h->sh_degree || h->views != t->scene->n_train ||
        h->seed != t->params.seed || h->extent != t->extent || !h->count)
        return sg_fail(
            ctx, SG_ERR_INPUT,
            "%s: found SH degree %d, %d to begin with, %llu views, seed %llu, extent %.17g; "
            "expected 0 to 3, no more than that, and those of this scene and run: %zu, %llu, %.17g",
            path, h->sh_degree, h->start_degree, (unsigned long long) h->views,
            (unsigned long long) h->seed, h->extent, t->scene->n_train,
            (unsigned long long) t->params.seed, t->extent);

    if (h->cameras != cameras_hash(t->scene))
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: found a run on other training views, expected those of %s", path,
                       t->scene->path);

    if (h->parameters != t->identity.parameters)
        return sg_fail(ctx, SG_ERR_INPUT,
                       "%s: found a run with other parameters, expected those of this run", path);

    /* Another decoder is no reason to refuse, nor is a defense that an audit adapted to what it
     * decodes. */
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
                       "%s: byte %zu: found iteration %d with %d steps of positions, expected 0 to "
                       "%d and no more steps than iterations",
                       path, offsetof(struct sg_checkpoint_header, iteration), h->iteration,
                       h->adam_steps[SG_G_XYZ], MAX_ITERATION);

    /* The file's own length says whether the count can be true before anything is allocated for
     * it. */
    const long long at = ftell(f);
    fseek(f, 0, SEEK_END);
    const long long size = ftell(f);
    fseek(f, (long) at, SEEK_SET);
    const uint64_t per_gaussian =
        (uint64_t) sg_param_count(h->sh_degree) * 3 * sizeof(float) + 2 * sizeof(float);
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

/* Of an array for n Gaussians that lies in the file as blocks of SG_LANES, those `kept` of them
 * that stay. */
static bool take(struct hashed *s, size_t planes, size_t bytes, size_t n, size_t kept, float *to)
{
    float block[SG_PARAMS_MAX * SG_LANES];
    size_t k = 0;
    for (size_t first = 0; first < n; first += SG_LANES) {
        const size_t whole = planes * SG_LANES * sizeof(float),
                     size = bytes < whole ? bytes : whole;
        if (fread(block, 1, size, s->stream) != size)
            return false;
        XXH3_64bits_update(&s->hash, block, size);
        bytes -= size;
        for (size_t i; k < kept && (i = sg_evenly(n, k, kept)) < first + SG_LANES; k++)
            for (size_t p = 0; p < planes; p++)
                to[sg_param_index((int) planes, k, (int) p)] = block[p * SG_LANES + i - first];
    }
    return true;
}

int sg_checkpoint_read(sg_trainer *t, const struct sg_checkpoint *c)
{
    sg_ctx *ctx = t->ctx;
    const struct sg_checkpoint_header *h = &c->header;
    const size_t n = (size_t) h->count, kept = sg_begin_again(t, n),
                 planes = (size_t) sg_param_count(h->sh_degree);
    struct sg_model *m = NULL;
    struct sg_columns o = {0};
    int code;
    if ((code = sg_model_create(ctx, kept, h->sh_degree, &m)) ||
        (code = sg_columns_create(ctx, kept, h->sh_degree, SG_COLUMN_SAVED, &o)))
        goto done;
    struct hashed s = {.stream = c->file};
    XXH3_64bits_reset(&s.hash);
    XXH3_64bits_update(&s.hash, h, sizeof(*h));
    float *const parts[PARTS] = {m->params, o.at[SG_C_MOMENT1], o.at[SG_C_MOMENT2],
                                 o.at[SG_C_GRAD_SUM], o.at[SG_C_GRAD_COUNT]};
    size_t bytes[PARTS];
    sizes_of(n, h->sh_degree, bytes);
    uint64_t digest = 0;
    bool whole = true;
    for (int i = 0; i < PARTS && whole; i++)
        whole = take(&s, i < 3 ? planes : 1, bytes[i], n, kept, parts[i]);
    whole = whole && fread(&digest, sizeof(digest), 1, c->file) == 1 && fgetc(c->file) == EOF;
    if (!whole || digest != XXH3_64bits_digest(&s.hash)) {
        code = sg_fail(ctx, SG_ERR_INPUT,
                       "%s: found a truncated or altered checkpoint: the checksum does not match",
                       c->path);
        goto done;
    }
    if ((code = sg_engine_adopt(t->engine, m, &o)))
        goto done;
    t->start_degree = h->start_degree;
    t->iteration = h->iteration;
    t->steps = h->steps;
    t->spent += h->spent;
    t->growth = h->growth, t->growths = h->growths, t->filter_first = h->filter_first;
    t->gaussians_bound = h->gaussians_bound || kept < n, t->time_bound = h->time_bound;
    for (int g = 0; g < SG_GROUPS; g++)
        t->adam_steps[g] = h->adam_steps[g];
done:
    sg_columns_clear(&o);
    sg_model_destroy(&m);
    return code;
}
