/* SPDX-License-Identifier: Apache-2.0 */
/* What is wrong with a plan file. */
#include <limits.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include "bench_plan.h"

int plan_wrong(const struct reader *r, const char *format, ...)
{
    char text[512];
    va_list args;
    va_start(args, format);
    vsnprintf(text, sizeof(text), format, args);
    va_end(args);
    say(stderr, "splatguard bench: %s: %s\n", r->path, text);
    return STATUS_INPUT;
}

const json_t *plan_at(const json_t *object, const char *a, const char *b)
{
    return json_object_get(json_object_get(object, a), b);
}

const json_t *plan_scene_options(const struct reader *r, const char *scene, const char *list)
{
    return json_object_get(plan_at(r->plan->root, "scenes", scene), list);
}

bool plan_is_on(const struct reader *r, const char *what)
{
    return json_is_true(json_object_get(r->plan->root, what));
}

/* An object's keys are those of the list "one|two". */
static int check_keys(const struct reader *r, const json_t *object, const char *where,
                      const char *known)
{
    const char *key;
    json_t *value;
    if (!json_is_object(object))
        return plan_wrong(r, "%s: expected an object", where);
    json_object_foreach((json_t *) object, key, value)
    {
        if (!is_in(known, key))
            return plan_wrong(r, "%s: found \"%s\", expected one of %s", where, key, known);
    }
    return STATUS_DONE;
}

/* {clean} or {clean*X}, X above 0. */
static bool is_limit(const json_t *option)
{
    double factor;
    return plan_limit(json_string_value(option), &factor);
}

bool is_option(const char *word)
{
    return word[0] == '-' && !(word[1] >= '0' && word[1] <= '9') && word[1] != '.' && word[1];
}

/* Replaces an option by its only form: "--backend=ref" by "--engine" and "ref", "-w" by
 * "--white-background". text: its value in the word, which becomes one of the list, or NULL. */
static void unify_option(json_t *list, size_t i, const struct sg_option *option, const char *text)
{
    char name[128];
    snprintf(name, sizeof(name), "--%s", option->name);
    if (text)
        json_array_insert_new(list, i + 1, json_string(text));
    json_array_set_new(list, i, json_string(name)); /* which frees the word */
}

/* Whether a command takes a value, which is set nowhere. expected: what it would take. Without
 * memory nothing is refused. */
static bool takes_value(const struct command *command, const struct sg_option *option,
                        const char *text, char *expected, size_t size)
{
    void *config = calloc(1, command->config_size);
    const bool takes = !config || sg_option_set(option, config, text, expected, size);
    free(config);
    return takes;
}

int plan_check_preset(const struct reader *r, const char *scene, const struct command *command,
                      const char *word, const char *preset)
{
    char expected[256];
    const char *text, *near;
    const struct sg_option *option = options_find(command, word, &text, &near);
    return !option || takes_value(command, option, preset, expected, sizeof(expected))
               ? STATUS_DONE
               : plan_wrong(r,
                            "scenes.%s.preset: found \"%.80s\", which %s --%s does not take, "
                            "expected %s",
                            scene, preset, command->name, option->name, expected);
}

/* Whether a list of options makes a scene or belongs to all of its jobs. */
static bool is_of_scene(const char *where)
{
    static const char *const lists[] = {".synth", ".size", ".options"};
    const char *list = strrchr(where, '.');
    bool found = false;
    for (size_t i = 0; i < sizeof(lists) / sizeof(lists[0]); i++)
        found |= !strncmp(where, "scenes.", strlen("scenes.")) && !strcmp(list, lists[i]);
    return found;
}

/* The value of the option that is text `at` of its list, or the next text. A plan can take weeks:
 * it is refused before it begins, not by the job that has the option. */
static int check_value(const struct reader *r, const json_t *value, const char *where, size_t at,
                       bool inside, const struct command *command, const struct sg_option *option)
{
    char expected[256];
    const char *text = json_string_value(value);
    if (!value || (text && is_option(text)))
        return plan_wrong(r, "%s[%zu]: --%s: found no value, expected %s", where, at, option->name,
                          option->unit);
    at += !inside;
    if (!text)
        return plan_wrong(r, "%s[%zu]: expected a text", where, at);
    if (text[0] != '{')
        return takes_value(command, option, text, expected, sizeof(expected))
                   ? STATUS_DONE
                   : plan_wrong(r, "%s[%zu]: --%s: found \"%.80s\", expected %s", where, at,
                                option->name, text, expected);
    if (!is_limit(value) && strcmp(text, "{preset}") != 0)
        return plan_wrong(
            r, "%s[%zu]: found %s, expected {clean}, {clean*X} with X from 0 to 1000, or {preset}",
            where, at, text);
    if (is_limit(value) && strncmp(where, DEFENSES ".", strlen(DEFENSES ".")))
        return plan_wrong(r, "%s[%zu]: found %s, which only defenses can have", where, at, text);
    if (!is_limit(value) && is_of_scene(where))
        return plan_wrong(r,
                          "%s[%zu]: found {preset}, expected a value: options of all jobs of a "
                          "scene are as they stand",
                          where, at);
    return STATUS_DONE;
}

/* Whether bench decides on the option: a second one would be refused, by each job. */
static bool is_own(const struct command *command, const struct sg_option *option)
{
    static const struct {
        const struct command *command; /* NULL: all */
        const char *options;
    } own[] = {{NULL, "threads|quiet|output|model-path|source-path|resume|force|help"},
               {&command_train, "seed|eval"},
               {&command_attack, "proxy"},
               {&command_prune, "seed|json|scene"}};
    bool is = false;
    for (size_t i = 0; i < sizeof(own) / sizeof(own[0]); i++)
        is |= (!own[i].command || own[i].command == command) && is_in(own[i].options, option->name);
    return is;
}

/* Options of a command, which are in their only form from here on. */
static int read_options(const struct reader *r, json_t *list, const char *where,
                        const struct command *command)
{
    int code = STATUS_DONE;
    if (list && !json_is_array(list))
        return plan_wrong(r, "%s: expected a list of options", where);
    for (size_t i = 0, at = 0; i < json_array_size(list) && !code; i++, at++) {
        const char *word = json_string_value(json_array_get(list, i)), *near = NULL, *text;
        if (!word)
            return plan_wrong(r, "%s[%zu]: expected a text", where, at);
        const struct sg_option *known =
            is_option(word) ? options_find(command, word, &text, &near) : NULL;
        if (!known)
            return plan_wrong(r, "%s[%zu]: found %.*s, expected an option of %s%s%s%s", where, at,
                              (int) strcspn(word, "="), word, command->name,
                              near ? "; did you mean --" : "", near ? near : "", near ? "?" : "");
        if (is_own(command, known))
            return plan_wrong(r, "%s[%zu]: found --%s, which is for bench itself to give", where,
                              at, known->name);
        const bool inside = text;
        if (known->type == SG_OPTION_FLAG && inside)
            return plan_wrong(r, "%s[%zu]: --%s takes no value", where, at, known->name);
        unify_option(list, i, known, text);
        if (known->type == SG_OPTION_FLAG)
            continue;
        code = check_value(r, json_array_get(list, ++i), where, at, inside, command, known);
        at += !inside;
    }
    return code;
}

/* The options in a list of an object of the plan. */
static int read_list(const struct reader *r, const json_t *object, const char *where,
                     const char *list, const struct command *command)
{
    char inside[160];
    snprintf(inside, sizeof(inside), "%s.%s", where, list);
    return read_options(r, json_object_get(object, list), inside, command);
}

/* A list of names in a block of runs: of entries of the table of the same name. */
static int check_names(const struct reader *r, const json_t *block, size_t index, const char *list)
{
    const json_t *names = json_object_get(block, list);
    if (!json_array_size(names))
        return plan_wrong(r, "runs[%zu].%s: expected a list of names of %s", index, list, list);
    for (size_t i = 0; i < json_array_size(names); i++) {
        const char *name = json_string_value(json_array_get(names, i));
        if (!name || !plan_at(r->plan->root, list, name))
            return plan_wrong(r, "runs[%zu].%s[%zu]: found %s, expected a name of %s", index, list,
                              i, name ? name : "no text", list);
    }
    return STATUS_DONE;
}

static int check_scene_options(const struct reader *r, const char *scene,
                               const struct command *command)
{
    static const char *const lists[] = {"size", "options"};
    for (int l = 0; l < 2; l++) {
        const json_t *options = plan_scene_options(r, scene, lists[l]);
        for (size_t i = 0; i < json_array_size(options); i++) {
            const char *word = json_string_value(json_array_get(options, i)), *near, *text;
            if (is_option(word) && !options_find(command, word, &text, &near))
                return plan_wrong(r, "scenes.%s.%s: found %s, expected an option of %s too", scene,
                                  lists[l], word, command->name);
        }
    }
    return STATUS_DONE;
}

/* Options of a scene go to all commands of its jobs, not only to `train`, which has them. */
static int check_commands_of_scenes(const struct reader *r, const json_t *block)
{
    bool poisons = false;
    EACH(p, "photos")
    poisons |= json_array_size(plan_at(r->plan->root, "photos", NAME(p, "photos"))) > 0;
    const struct {
        const struct command *command;
        bool runs;
    } readers[] = {{&command_eval, true},
                   {&command_attack, poisons},
                   {&command_audit, plan_is_on(r, "audit")},
                   {&command_render, plan_is_on(r, "pictures")}};
    int code = STATUS_DONE;
    EACH(s, "scenes")
    for (size_t i = 0; i < sizeof(readers) / sizeof(readers[0]) && !code; i++)
        if (readers[i].runs)
            code = check_scene_options(r, NAME(s, "scenes"), readers[i].command);
    return code;
}

/* A block of runs: names of the tables, and seeds. */
static int check_block(const struct reader *r, const json_t *block, size_t index)
{
    static const char *const lists[] = {"scenes", "photos", "defenses", "models"};
    char where[32];
    snprintf(where, sizeof(where), "runs[%zu]", index);
    int code = check_keys(r, block, where, "scenes|photos|defenses|models|seeds");
    for (int i = 0; i < 4 && !code; i++)
        code = check_names(r, block, index, lists[i]);
    if (!code)
        code = check_commands_of_scenes(r, block);
    if (code)
        return code;
    const json_t *seeds = json_object_get(block, "seeds");
    if (!json_array_size(seeds))
        return plan_wrong(r, "%s.seeds: expected a list of numbers", where);
    for (size_t i = 0; i < json_array_size(seeds); i++) {
        const json_t *seed = json_array_get(seeds, i);
        if (!json_is_integer(seed) || json_integer_value(seed) < 0 ||
            json_integer_value(seed) > INT_MAX)
            return plan_wrong(r, "%s.seeds[%zu]: expected a whole number from 0 to %d", where, i,
                              INT_MAX);
    }
    return STATUS_DONE;
}

static int check_scenes(const struct reader *r)
{
    const char *name;
    json_t *scene;
    char where[128];
    int code = STATUS_DONE;
    if (!json_is_object(json_object_get(r->plan->root, "scenes")))
        return plan_wrong(r, "scenes: expected an object");
    json_object_foreach(json_object_get(r->plan->root, "scenes"), name, scene)
    {
        snprintf(where, sizeof(where), "scenes.%.80s", name);
        if ((code =
                 check_keys(r, scene, where, "path|synth|layout|size|options|train|attack|preset")))
            return code;
        static const struct {
            const char *list;
            const struct command *command;
        } lists[] = {{"synth", &command_synth},
                     {"size", &command_train},
                     {"options", &command_train},
                     {"train", &command_train},
                     {"attack", &command_attack}};
        for (int i = 0; i < 5 && !code; i++)
            code = read_list(r, scene, where, lists[i].list, lists[i].command);
        if (code)
            return code;
        if (json_object_get(scene, "preset") && !json_is_string(json_object_get(scene, "preset")))
            return plan_wrong(r, "%s.preset: expected a text", where);
        if (!json_object_get(scene, "synth") == !json_is_string(json_object_get(scene, "path")))
            return plan_wrong(r, "%s: expected either path or synth", where);
        const json_t *layout = json_object_get(scene, "layout");
        const char *word = json_string_value(layout);
        if (layout && !(word && (!strcmp(word, "blender") || !strcmp(word, "colmap"))))
            return plan_wrong(r, "%s.layout: expected \"blender\" or \"colmap\"", where);
        if (layout && !json_object_get(scene, "synth"))
            return plan_wrong(r, "%s.layout: found it with path, expected it with synth only",
                              where);
    }
    return STATUS_DONE;
}

static int check_lists(const struct reader *r, const char *table)
{
    const char *name;
    json_t *value, *object = json_object_get(r->plan->root, table);
    char where[128];
    if (!json_is_object(object))
        return plan_wrong(r, "%s: expected an object", table);
    json_object_foreach(object, name, value)
    {
        int code = STATUS_DONE;
        snprintf(where, sizeof(where), "%s.%.80s", table, name);
        if (json_is_object(value) && !strcmp(table, DEFENSES)) {
            code = check_keys(r, value, where, "train|prune|from");
            if (!code)
                code = read_list(r, value, where, "train", &command_train);
            if (!code)
                code = read_list(r, value, where, "prune", &command_prune);
            const json_t *from = json_object_get(value, "from");
            if (!code && !json_object_get(value, "train") == !json_object_get(value, "prune"))
                code = plan_wrong(
                    r, "%s: expected either train or prune; prune has the run of `from`", where);
            if (!code && from && !json_object_get(value, "prune"))
                code = plan_wrong(r, "%s.from: found without prune, expected it with one", where);
            if (!code && from &&
                (!json_is_string(from) || !plan_at(r->plan->root, table, json_string_value(from)) ||
                 json_object_get(plan_at(r->plan->root, table, json_string_value(from)), "prune")))
                code = plan_wrong(r, "%s.from: expected the name of a defense that trains", where);
        } else
            code = read_options(r, value, where,
                                strcmp(table, "photos") ? &command_train : &command_attack);
        if (code)
            return code;
    }
    return STATUS_DONE;
}

static int read_settings(const struct reader *r)
{
    struct plan *p = r->plan;
    const json_t *threads = json_object_get(p->root, "threads"),
                 *timeout = json_object_get(p->root, "timeout"),
                 *memory = json_object_get(p->root, "memory");
    static const struct sg_option time = {.name = "timeout",
                                          .type = SG_OPTION_TIME,
                                          .offset = offsetof(struct plan, timeout),
                                          .high = 1e9},
                                  bytes = {.name = "memory",
                                           .type = SG_OPTION_BYTES,
                                           .offset = offsetof(struct plan, memory),
                                           .high = 9e15};
    char expected[128] = "a text";
    const json_int_t count = threads ? json_integer_value(threads) : 1;
    const json_t *engine = json_object_get(p->root, "engine");
    const char *text, *near;
    const struct sg_option *row = options_find(&command_train, "--engine", &text, &near);
    p->alone = json_is_true(json_object_get(p->root, "alone"));
    p->engine = json_string_value(engine);
    if (engine && !p->engine)
        return plan_wrong(r, "engine: expected a text");
    if (engine && !takes_value(&command_train, row, p->engine, expected, sizeof(expected)))
        return plan_wrong(r, "engine: found \"%.80s\", expected %s", p->engine, expected);
    if (count < 1 || count > 256)
        return plan_wrong(r, "threads: expected a whole number from 1 to 256");
    p->threads = (int) count;
    if (timeout && !(json_is_string(timeout) && sg_option_set(&time, p, json_string_value(timeout),
                                                              expected, sizeof(expected))))
        return plan_wrong(r, "timeout: expected %s", expected);
    if (memory && !(json_is_string(memory) && sg_option_set(&bytes, p, json_string_value(memory),
                                                            expected, sizeof(expected))))
        return plan_wrong(r, "memory: expected %s", expected);
    return STATUS_DONE;
}

int plan_check(const struct reader *r)
{
    struct plan *p = r->plan;
    int code =
        check_keys(r, p->root, "plan",
                   "about|threads|engine|timeout|memory|alone|train|proxy|scenes|photos|defenses|"
                   "models|runs|pictures|audit");
    if (!code)
        code = read_settings(r);
    if (!code)
        code = read_options(r, json_object_get(p->root, "train"), "train", &command_train);
    if (!code)
        code = read_options(r, json_object_get(p->root, "proxy"), "proxy", &command_train);
    if (!code)
        code = check_scenes(r);
    static const char *const switches[] = {"pictures", "audit", "alone"};
    for (int i = 0; i < 3 && !code; i++) {
        const json_t *on = json_object_get(p->root, switches[i]);
        if (on && !json_is_boolean(on))
            code = plan_wrong(r, "%s: expected true or false", switches[i]);
    }
    static const char *const tables[] = {"photos", DEFENSES, "models"};
    for (int i = 0; i < 3 && !code; i++)
        code = check_lists(r, tables[i]);
    if (!code && !plan_at(p->root, "photos", CLEAN))
        code = plan_wrong(r, "photos: found no " CLEAN ", expected [] for photos as they are");
    if (!code && json_array_size(plan_at(p->root, "photos", CLEAN)))
        code = plan_wrong(r, "photos." CLEAN ": expected []");
    const json_t *off = plan_at(p->root, DEFENSES, OFF);
    if (!code && !off)
        code = plan_wrong(r, "defenses: found no " OFF ", expected [] for no defense");
    if (!code && (!json_is_array(off) || json_array_size(off)))
        code = plan_wrong(r, "defenses." OFF ": expected []");
    const json_t *runs = json_object_get(p->root, "runs");
    if (!code && !json_array_size(runs))
        code = plan_wrong(r, "runs: expected a list of blocks");
    for (size_t i = 0; i < json_array_size(runs) && !code; i++)
        code = check_block(r, json_array_get(runs, i), i);
    return code;
}
