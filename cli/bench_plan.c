/* SPDX-License-Identifier: Apache-2.0 */
/* A plan file: scenes x photos x defenses x models x seeds, as jobs with what they need. */
#define XXH_INLINE_ALL
#include <dirent.h>
#include <limits.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <xxhash.h>

#include "bench_plan.h"

const char *const job_kinds[] = {"scene", "proxy", "poison", "train", "prune", "pictures", "audit"};

bool plan_limit(const char *text, double *factor)
{
    int end = 0;
    *factor = 1;
    if (!strcmp(text, "{clean}"))
        return true;
    return sscanf(text, "{clean*%lf}%n", factor, &end) == 1 && end && !text[end] && *factor > 0 &&
           *factor <= 1000;
}

bool options_limited(const json_t *options)
{
    double factor;
    for (size_t i = 0; i < json_array_size(options); i++)
        if (plan_limit(json_string_value(json_array_get(options, i)), &factor))
            return true;
    return false;
}

size_t options_place(const json_t *options, const char *text)
{
    size_t i = 0;
    while (i < json_array_size(options) &&
           strcmp(json_string_value(json_array_get(options, i)), text) != 0)
        i++;
    return i;
}

json_t *options_merge(const json_t *const *lists, int n)
{
    json_t *merged = json_object(), *out = json_array();
    for (int l = 0; l < n; l++)
        for (size_t i = 0; i < json_array_size(lists[l]); i++) {
            const char *name = json_string_value(json_array_get(lists[l], i)),
                       *value = json_string_value(json_array_get(lists[l], i + 1));
            const bool has = value && !is_option(value);
            json_object_set_new(merged, name, has ? json_string(value) : json_null());
            i += has;
        }
    const char *key;
    json_t *value;
    json_object_foreach(merged, key, value)
    {
        json_array_append_new(out, json_string(key));
        if (!json_is_null(value))
            json_array_append(out, value);
    }
    json_decref(merged);
    return out;
}

/* Anywhere in a value. */
static bool has_text(const json_t *value, const char *text)
{
    const char *key, *own = json_string_value(value);
    const json_t *inner;
    bool has = own && !strcmp(own, text);
    for (size_t i = 0; i < json_array_size(value); i++)
        has = has || has_text(json_array_get(value, i), text);
    json_object_foreach((json_t *) (uintptr_t) value, key, inner)
    {
        has = has || has_text(inner, text);
    }
    return has;
}

uint64_t splitmix(uint64_t x)
{
    x = (x ^ x >> 30) * 0xbf58476d1ce4e5b9u;
    x = (x ^ x >> 27) * 0x94d049bb133111ebu;
    return x ^ x >> 31;
}

/* 128 bits that name a configuration. */
static void make_key(const json_t *config, char key[33])
{
    uint64_t a = 1, b = 2;
    char *text = json_dumps(config, JSON_SORT_KEYS | JSON_COMPACT);
    for (const char *c = text ? text : ""; *c; c++) {
        a = splitmix(a + (unsigned char) *c + 0x9e3779b97f4a7c15u);
        b = splitmix(b + (unsigned char) *c + 0xd1b54a32d192ed03u);
    }
    free(text);
    snprintf(key, 33, "%016llx%016llx", (unsigned long long) a, (unsigned long long) b);
}

/* Of a scene's files: how many, and a checksum of their names and contents. A scene whose photos
 * change is another scene; one that is copied anew is not. */
struct print {
    long long files;
    uint64_t sum;     /* of each file's checksum: files come in any order */
    const char *root; /* of the scene, without links */
    size_t length;    /* of root */
    bool leaves;      /* also reads what links out of the scene lead to */
    char **behind;    /* folders that only links lead to */
    size_t n_behind;
    bool no_memory;
};

/* path: without links. */
static const char *name_of(const struct print *p, const char *path)
{
    return is_below(path, p->root) ? path + p->length : path;
}

/* One that cannot be read counts with its name, and so does what is no file of a disk: /proc tells
 * no sizes, or ones that no disk has. st: or NULL. */
static void add_file(const char *path, const char *name, const struct stat *st, struct print *p)
{
    static char part[1 << 16];
    const bool readable = st && S_ISREG(st->st_mode) && st->st_size > 0 && st->st_size >> 40 == 0;
    XXH3_state_t hash;
    XXH3_64bits_reset(&hash);
    XXH3_64bits_update(&hash, name, strlen(name) + 1);
    FILE *f = readable ? fopen(path, "rb") : NULL;
    for (size_t n; f && (n = fread(part, 1, sizeof(part), f));)
        XXH3_64bits_update(&hash, part, n);
    if (f)
        fclose(f);
    p->files++;
    p->sum += XXH3_64bits_digest(&hash);
}

#define DEEPEST 8 /* folders below a scene, or below one that a link leads to */

/* there: a name below the scene. */
static bool is_come_to(const char *there)
{
    int folders = 0;
    for (const char *c = there; *c; c++)
        folders += *c == '/';
    return folders < DEEPEST && !strstr(there, "/.");
}

/* A link to a folder counts with both names. What is in the folder counts once, under the names
 * that it has without links, so that links may lead around in circles. */
static void add_link(const char *path, const char *name, struct print *p)
{
    char target[PATH_MAX];
    struct stat st;
    if (!realpath(path, target) || stat(target, &st))
        return;
    const bool inside = is_below(target, p->root), reads = inside || p->leaves;
    if (!S_ISDIR(st.st_mode)) {
        add_file(target, name, reads ? &st : NULL, p);
        return;
    }
    const char *there = name_of(p, target);
    XXH3_state_t hash;
    XXH3_64bits_reset(&hash);
    XXH3_64bits_update(&hash, name, strlen(name) + 1);
    XXH3_64bits_update(&hash, there, strlen(there) + 1);
    p->sum += XXH3_64bits_digest(&hash);
    if (!reads || is_below(p->root, target) || (inside && is_come_to(there)))
        return; /* the folders around the scene are not its own */
    for (size_t i = 0; i < p->n_behind; i++)
        if (!strcmp(p->behind[i], target))
            return;
    char **more = realloc(p->behind, (p->n_behind + 1) * sizeof(*more)), *copy = strdup(target);
    p->behind = more ? more : p->behind;
    p->no_memory |= !more || !copy;
    if (more && copy)
        more[p->n_behind++] = copy;
    else
        free(copy);
}

/* path: without links. */
static void add_folder(const char *path, int depth, struct print *p)
{
    DIR *d = depth < DEEPEST ? opendir(path) : NULL;
    for (struct dirent *e; d && (e = readdir(d));) {
        char child[PATH_MAX];
        struct stat st;
        if (e->d_name[0] == '.' ||
            snprintf(child, sizeof(child), "%s/%s", path, e->d_name) >= (int) sizeof(child) ||
            lstat(child, &st))
            continue;
        if (S_ISLNK(st.st_mode))
            add_link(child, name_of(p, child), p);
        else if (S_ISDIR(st.st_mode))
            add_folder(child, depth + 1, p);
        else
            add_file(child, name_of(p, child), &st, p);
    }
    if (d)
        closedir(d);
}

/* Reads the scene at p->root, a folder or an archive. places: gets what it reads. */
static void add_files(struct print *p, const char *scene, json_t *places)
{
    struct stat st;
    p->length = strlen(p->root);
    if (!stat(p->root, &st) && S_ISREG(st.st_mode))
        add_file(p->root, "", &st, p);
    else
        add_folder(p->root, 0, p);
    for (size_t i = 0; i < p->n_behind; i++)
        add_folder(p->behind[i], 0, p);
    json_object_set_new_nocheck(places, p->root, json_string(scene)); /* paths in any encoding */
    for (size_t i = 0; i < p->n_behind; i++) {
        json_object_set_new_nocheck(places, p->behind[i], json_string(scene));
        free(p->behind[i]);
    }
    free(p->behind);
}

/* The index of a job with this configuration, which is taken over, or -1: see reader.code. */
static int add_job(struct reader *r, struct job job)
{
    struct plan *p = r->plan;
    for (int i = 0; i < job.n_needs; i++) {
        char name[24];
        snprintf(name, sizeof(name), "needs_%d", i);
        json_object_set_new(job.config, name, json_string(p->jobs[job.needs[i]].key));
    }
    make_key(job.config, job.key);
    for (int i = 0; i < p->n; i++)
        if (!strcmp(p->jobs[i].key, job.key)) {
            json_decref(job.config);
            return i;
        }
    if (p->n == r->capacity) {
        const int capacity = r->capacity ? 2 * r->capacity : 64;
        struct job *more = realloc(p->jobs, (size_t) capacity * sizeof(*more));
        if (!more) {
            json_decref(job.config);
            r->code = no_memory();
            return -1;
        }
        p->jobs = more, r->capacity = capacity;
    }
    p->jobs[p->n] = job;
    return p->n++;
}

#define MERGE(lists) options_merge(lists, sizeof(lists) / sizeof((lists)[0]))

/* Options of the photos for commands that only read them. */
static json_t *photo_options(const struct reader *r, const char *scene, bool clean)
{
    const json_t *const lists[] = {clean ? plan_scene_options(r, scene, "size") : NULL,
                                   plan_scene_options(r, scene, "options")};
    return MERGE(lists);
}

/* The scene: made by synth, or a folder. A folder is what is in it, and how that is read: neither
 * its place, which is in the configuration, nor its name counts for the key. */
static int add_scene(struct reader *r, const char *name)
{
    const json_t *known = json_object_get(r->scenes, name),
                 *scene = plan_at(r->plan->root, "scenes", name),
                 *synth = json_object_get(scene, "synth");
    if (known)
        return (int) json_integer_value(known);
    json_t *config = json_pack("{s:s}", "kind", "scene"), *place = NULL;
    if (synth) {
        json_object_set_new(config, "name", json_string(name));
        json_object_set(config, "synth", (json_t *) synth);
        json_object_set(config, "layout", json_object_get(scene, "layout"));
    } else {
        char path[PATH_MAX];
        char whole[PATH_MAX]; /* one scene is one configuration, however its path is spelled */
        struct print p = {.root = whole, .leaves = r->follows_links};
        const char *at = json_string_value(json_object_get(scene, "path"));
        snprintf(path, sizeof(path), "%s%s%s", *at == '/' ? "" : r->data, *at == '/' ? "" : "/",
                 at);
        if (realpath(path, whole))
            add_files(&p, name, r->plan->places);
        place = p.files ? json_string(whole) : NULL;
        if (p.no_memory)
            r->code = no_memory();
        else if (!p.files)
            r->code = plan_wrong(
                r,
                "scenes.%s: found no file in %s, expected the scene below the plan's folder or "
                "that of --data",
                name, path);
        else if (!place) /* the database has it in JSON */
            r->code = plan_wrong(r, "scenes.%s: %s: expected a path in UTF-8", name, whole);
        if (r->code) {
            json_decref(place);
            json_decref(config);
            return -1;
        }
        json_object_set_new(config, "options", photo_options(r, name, true));
        json_object_set_new(config, "print", json_pack("[I,I]", p.files, (json_int_t) p.sum));
    }
    const int job = add_job(r, (struct job){.kind = JOB_SCENE,
                                            .scene = name,
                                            .photos = "",
                                            .defense = "",
                                            .model = "",
                                            .config = config,
                                            .from = scene});
    if (job >= 0 && place) {
        json_object_set(r->plan->jobs[job].config, "path", place);
        json_object_set_new(r->plan->jobs[job].config, "name", json_string(name));
    }
    json_decref(place);
    json_object_set_new(r->scenes, name, json_integer(job));
    return job;
}

/* Which reads the options of a job. */
static const struct command *command_of(enum job_kind kind)
{
    return kind == JOB_POISON     ? &command_attack
           : kind == JOB_PRUNE    ? &command_prune
           : kind == JOB_PICTURES ? &command_render
           : kind == JOB_AUDIT    ? &command_audit
                                  : &command_train;
}

/* {preset} stands for the scene's. Returns whether it has one, which the command takes, where it is
 * asked for. */
static bool name_preset(struct reader *r, const char *scene, const struct command *command,
                        json_t *options)
{
    json_t *preset = json_object_get(plan_at(r->plan->root, "scenes", scene), "preset");
    for (size_t i = 0; i < json_array_size(options); i++) {
        if (strcmp(json_string_value(json_array_get(options, i)), "{preset}"))
            continue;
        if (!preset) {
            r->code = plan_wrong(
                r, "scenes.%s: found no preset, expected one for {preset} in its options", scene);
            return false;
        }
        r->code =
            plan_check_preset(r, scene, command, json_string_value(json_array_get(options, i - 1)),
                              json_string_value(preset));
        if (r->code)
            return false;
        json_array_set(options, i, preset);
    }
    return true;
}

/* Of what draws, unless its options name one. */
static void add_engine(const struct plan *p, json_t *options)
{
    if (p->engine && !has_text(options, "--engine")) {
        json_array_append_new(options, json_string("--engine"));
        json_array_append_new(options, json_string(p->engine));
    }
}

static int make_job(struct reader *r, enum job_kind kind, const struct cell *c, json_t *options,
                    const int *needs, int n_needs)
{
    struct job job = {.kind = kind,
                      .scene = c->scene,
                      .photos = c->photos,
                      .defense = c->defense,
                      .model = c->model,
                      .seed = c->seed,
                      .config = json_pack("{s:s,s:i,s:o}", "kind", job_kinds[kind], "seed", c->seed,
                                          "options", options),
                      .from = plan_at(r->plan->root, "scenes", c->scene)};
    if (!name_preset(r, c->scene, command_of(kind), options)) {
        json_decref(job.config);
        return -1;
    }
    if (kind != JOB_AUDIT)
        add_engine(r->plan, options);
    memcpy(job.needs, needs, (size_t) n_needs * sizeof(*needs));
    job.n_needs = n_needs;
    return add_job(r, job);
}

/* The value of an option, or NULL. */
static const char *value_of(const json_t *options, const char *name)
{
    const size_t i = options_place(options, name);
    return json_string_value(json_array_get(options, i + 1)); /* beyond the end there is none */
}

/* attack: its options. The proxy sees the photos that the attack poisons. */
static int add_proxy(struct reader *r, const char *scene, int at, const json_t *attack)
{
    const char *views = value_of(attack, "--views");
    json_t *of_attack = views && !strcmp(views, "train") ? json_pack("[s]", "--eval") : NULL;
    const json_t *const lists[] = {
        plan_scene_options(r, scene, "size"),    plan_scene_options(r, scene, "options"),
        json_object_get(r->plan->root, "train"), plan_scene_options(r, scene, "train"),
        json_object_get(r->plan->root, "proxy"), of_attack};
    const struct cell c = {scene, CLEAN, "proxy", "", 42, 0};
    json_t *options = MERGE(lists);
    json_decref(of_attack);
    return make_job(r, JOB_PROXY, &c, options, &at, 1);
}

static bool uses_proxy(const json_t *options)
{
    const char *method = value_of(options, "--method");
    return !method || !strcmp(method, "poison-splat");
}

/* The photos of a cell: the scene itself, or a poison of it. */
static int add_photos(struct reader *r, const char *scene, const char *photos, int at)
{
    const json_t *attack = plan_at(r->plan->root, "photos", photos);
    if (!json_array_size(attack))
        return at;
    const json_t *const lists[] = {plan_scene_options(r, scene, "size"),
                                   plan_scene_options(r, scene, "options"),
                                   plan_scene_options(r, scene, "attack"), attack};
    int needs[2] = {at};
    json_t *options = MERGE(lists);
    const bool proxy = uses_proxy(options);
    if (proxy && (needs[1] = add_proxy(r, scene, at, options)) < 0) {
        json_decref(options);
        return -1;
    }
    const struct cell c = {scene, photos, "", "", 42, 0};
    return make_job(r, JOB_POISON, &c, options, needs, 1 + proxy);
}

static const json_t *train_options(const json_t *defense)
{
    return json_is_array(defense) ? defense : json_object_get(defense, "train");
}

static int add_cell(struct reader *r, const struct cell *c)
{
    const json_t *defense = plan_at(r->plan->root, DEFENSES, c->defense),
                 *prune = json_is_object(defense) ? json_object_get(defense, "prune") : NULL;
    const int at = add_scene(r, c->scene),
              photos = at < 0 ? -1 : add_photos(r, c->scene, c->photos, at);
    int needs[JOB_NEEDS] = {at, photos}, n = 2;
    if (photos < 0)
        return -1;
    const json_t *own = prune ? prune : train_options(defense);
    if (options_limited(own)) {
        const struct cell clean = {c->scene, CLEAN, OFF, c->model, c->seed, 0};
        if ((needs[n++] = add_cell(r, &clean)) < 0)
            return -1;
    }
    if (prune) {
        const char *from = json_string_value(json_object_get(defense, "from"));
        const struct cell base = {c->scene, c->photos, from ? from : OFF, c->model, c->seed, 0};
        if ((needs[1] = add_cell(r, &base)) < 0)
            return -1;
        return make_job(r, JOB_PRUNE, c, options_merge(&prune, 1), needs, n);
    }
    /* Poisons have the size that is trained already. */
    const json_t *const lists[] = {photos == at ? plan_scene_options(r, c->scene, "size") : NULL,
                                   plan_scene_options(r, c->scene, "options"),
                                   json_object_get(r->plan->root, "train"),
                                   plan_scene_options(r, c->scene, "train"),
                                   plan_at(r->plan->root, "models", c->model),
                                   own};
    return make_job(r, JOB_TRAIN, c, MERGE(lists), needs, n);
}

/* Renders of the cell's model from the cameras of its photos: of the first seed. */
static int add_pictures(struct reader *r, const struct cell *c, int job)
{
    for (int i = 0; i < r->plan->n; i++) {
        const struct job *j = &r->plan->jobs[i];
        if (j->kind == JOB_PICTURES && !strcmp(j->scene, c->scene) &&
            !strcmp(j->photos, c->photos) && !strcmp(j->defense, c->defense) &&
            !strcmp(j->model, c->model))
            return i;
    }
    const int at = add_scene(r, c->scene), photos = add_photos(r, c->scene, c->photos, at);
    return make_job(r, JOB_PICTURES, c, photo_options(r, c->scene, photos == at),
                    (const int[]){at, job, photos}, 3);
}

/* Cells of one poison are of one shard. Shards take turns in the order of the plan; poisons, which
 * take longer, have turns of their own, and clean photos begin at the other end. */
static bool in_shard(struct reader *r, const struct cell *c)
{
    char key[33];
    json_t *name = json_pack("[s,s]", c->scene, c->photos);
    make_key(name, key);
    json_decref(name);
    const json_t *part = json_object_get(r->parts, key);
    if (part)
        return json_integer_value(part) == r->shard;
    const int turn = strcmp(c->photos, CLEAN) ? r->poisons++ % r->shards
                                              : r->shards - 1 - r->cleans++ % r->shards;
    json_object_set_new(r->parts, key, json_integer(turn));
    return turn == r->shard;
}

static int add_to_cells(struct reader *r, const struct cell *c, int job)
{
    struct plan *p = r->plan;
    for (int i = 0; i < p->n_cells; i++)
        if (p->cells[i].job == job && !strcmp(p->cells[i].scene, c->scene) &&
            !strcmp(p->cells[i].defense, c->defense) && !strcmp(p->cells[i].photos, c->photos) &&
            !strcmp(p->cells[i].model, c->model))
            return 0;
    struct cell *more = realloc(p->cells, (size_t) (p->n_cells + 1) * sizeof(*more));
    if (!more) {
        r->code = no_memory();
        return -1;
    }
    p->cells = more;
    p->cells[p->n_cells] = *c;
    p->cells[p->n_cells++].job = job;
    return 0;
}

/* An audit of the cell's photos. */
static int add_audit(struct reader *r, const struct cell *c)
{
    const int at = add_scene(r, c->scene), photos = add_photos(r, c->scene, c->photos, at);
    const struct cell audit = {c->scene, c->photos, "", "", 0, 0};
    const int job = make_job(r, JOB_AUDIT, &audit, photo_options(r, c->scene, photos == at),
                             (const int[]){photos}, 1);
    return job < 0 ? -1 : add_to_cells(r, &audit, job);
}

static int add_block(struct reader *r, const json_t *block)
{
    /* Seeds last: what is to be compared runs close together. */
    EACH(k, "seeds")
    EACH(s, "scenes")
    EACH(p, "photos")
    EACH(m, "models")
    EACH(d, "defenses")
    {
        const json_t *seeds = json_object_get(block, "seeds");
        const struct cell c = {NAME(s, "scenes"),
                               NAME(p, "photos"),
                               NAME(d, "defenses"),
                               NAME(m, "models"),
                               (int) json_integer_value(json_array_get(seeds, k)),
                               0};
        if (!in_shard(r, &c))
            continue;
        const int job = add_cell(r, &c);
        if (job < 0 || add_to_cells(r, &c, job) ||
            (plan_is_on(r, "pictures") && add_pictures(r, &c, job) < 0) ||
            (plan_is_on(r, "audit") && add_audit(r, &c)))
            return r->code;
    }
    return STATUS_DONE;
}

int plan_read(struct plan *p, const char *path, const char *data, int shard, int shards)
{
    json_error_t error;
    *p = (struct plan){.places = json_object()};
    if (is_folder(path)) {
        say(stderr, "splatguard bench: %s: found a folder, expected the file of a plan\n", path);
        return STATUS_INPUT;
    }
    p->root = json_load_file(path, JSON_REJECT_DUPLICATES, &error);
    if (!p->root) {
        if (error.line > 0)
            say(stderr, "splatguard bench: %s: line %d, column %d: %s\n", path, error.line,
                error.column, error.text);
        else
            say(stderr, "splatguard bench: %s\n", error.text);
        return STATUS_INPUT;
    }
    const char *slash = strrchr(path, '/'), *base = slash ? slash + 1 : path;
    const size_t length = strlen(base), ending = strlen(".json");
    p->name =
        strndup(base, length > ending && !strcmp(base + length - ending, ".json") ? length - ending
                                                                                  : length);
    p->folder = slash ? strndup(path, (size_t) (slash - path)) : strdup(".");
    if (!p->name || !p->folder)
        return no_memory();
    struct reader r = {.plan = p,
                       .path = path,
                       .data = data ? data : p->folder,
                       .shard = shard,
                       .shards = shards,
                       .scenes = json_object(),
                       .parts = json_object()};
    int code = plan_check(&r);
    r.follows_links = has_text(p->root, "--follow-links");
    const json_t *runs = json_object_get(p->root, "runs");
    for (size_t i = 0; i < json_array_size(runs) && !code; i++)
        code = add_block(&r, json_array_get(runs, i));
    json_decref(r.scenes);
    json_decref(r.parts);
    return code;
}

void plan_clear(struct plan *p)
{
    for (int i = 0; i < p->n; i++)
        json_decref(p->jobs[i].config);
    free(p->jobs);
    free(p->cells);
    free(p->name);
    free(p->folder);
    json_decref(p->root);
    json_decref(p->places);
    *p = (struct plan){0};
}
