/* SPDX-License-Identifier: Apache-2.0 */
/* The tables of options: each row sets, prints and checks its field. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "option/option.h"
#include "option/quantities.h"
#include "splatguard/splatguard.h"
#include "train/identity.h"

/* Every table with the defaults of its struct. */
union params {
    struct sg_train_params train;
    struct sg_attack_params attack;
    struct sg_scene_params scene;
    struct sg_synth_params synth;
    struct sg_render_params render;
    struct sg_run_params run;
    struct sg_attack_run_params attack_run;
};
#define TABLES 7

static const struct sg_option *table(int i, union params *p)
{
    memset(p, 0, sizeof(*p));
    switch (i) {
    case 0:
        p->train = sg_train_params_default();
        return sg_train_options();
    case 1:
        p->attack = sg_attack_params_default();
        return sg_attack_options();
    case 2:
        p->scene = sg_scene_params_default();
        return sg_scene_options();
    case 3:
        p->synth = sg_synth_params_default();
        return sg_synth_options();
    case 4:
        p->render = sg_render_params_default();
        return sg_render_options();
    case 5:
        p->run = sg_run_params_default();
        return sg_run_options();
    default:
        p->attack_run = sg_attack_run_params_default();
        return sg_attack_run_options();
    }
}

static bool is_number(const struct sg_option *o)
{
    return o->type != SG_OPTION_FLAG && o->type != SG_OPTION_SWITCH && o->type != SG_OPTION_TEXT &&
           o->type != SG_OPTION_CHOICE;
}

static void test_rows_are_whole(void **state)
{
    (void) state;
    union params p;
    for (int t = 0; t < TABLES; t++) {
        const struct sg_option *rows = table(t, &p);
        for (const struct sg_option *o = rows; o->name; o++) {
            if (!o->field || !o->help || !o->group || (o->type != SG_OPTION_FLAG && !o->unit))
                fail_msg("table %d, %s: a member is missing", t, o->name);
            if (is_number(o) && !(o->low < o->high))
                fail_msg("%s: from %g to %g", o->name, o->low, o->high);
            if ((o->type == SG_OPTION_CHOICE || o->type == SG_OPTION_SWITCH) && !o->choices)
                fail_msg("%s has no choices", o->name);
            if (sg_option_find(rows, o->name) != o)
                fail_msg("%s is there twice", o->name);
            if (strchr(o->name, '_') || strchr(o->field, '-'))
                fail_msg("%s, %s: dashes in names, underscores in fields", o->name, o->field);
        }
    }
    assert_null(sg_option_find(sg_train_options(), "densify"));
    assert_string_equal(sg_option_find(sg_train_options(), "densify_grad_threshold")->name,
                        "densify-grad-threshold");
    assert_string_equal(sg_option_find(sg_train_options(), "backend")->name, "engine");
}

/* Defaults are within their ranges, and what is printed reads back to the same bytes. */
static void test_defaults_read_back(void **state)
{
    (void) state;
    sg_ctx *ctx;
    assert_int_equal(sg_ctx_create(&ctx, NULL), SG_OK);
    for (int t = 0; t < TABLES; t++) {
        union params p, q;
        const struct sg_option *rows = table(t, &p);
        table(t, &q);
        if (t != 6)
            assert_int_equal(sg_check_options(ctx, rows, &p), SG_OK);
        for (const struct sg_option *o = rows; o->name; o++) {
            char text[64], expected[256];
            if (!sg_option_get(o, &p, text, sizeof(text)))
                continue;
            if (!sg_option_set(o, &q, text, expected, sizeof(expected)))
                fail_msg("%s: %s is refused, expected %s", o->name, text, expected);
            if (o->type != SG_OPTION_TEXT && memcmp(&p, &q, sizeof(p)))
                fail_msg("%s: %s does not read back the same", o->name, text);
            sg_option_copy(o, &q, &p); /* texts are other pointers now */
            assert_memory_equal(&p, &q, sizeof(p));
        }
    }
    sg_ctx_destroy(&ctx);
}

/* Both ends of a range are accepted, and what is beyond them by sg_option_set and by the library's
 * check alike not. */
static void test_ranges(void **state)
{
    (void) state;
    sg_ctx *ctx;
    assert_int_equal(sg_ctx_create(&ctx, NULL), SG_OK);
    for (int t = 0; t < TABLES; t++) {
        union params p;
        const struct sg_option *rows = table(t, &p);
        for (const struct sg_option *o = rows; o->name; o++) {
            char text[64], expected[256] = "";
            const double ends[] = {o->low, o->high};
            for (int k = 0; k < 2 && is_number(o); k++) {
                const double step = k ? 1 : -1, beyond = ends[k] + step * (5 + fabs(ends[k]));
                table(t, &p);
                snprintf(text, sizeof(text), "%.17g", ends[k]);
                if (o->type == SG_OPTION_INT || o->type == SG_OPTION_U64 ||
                    o->type == SG_OPTION_BYTES)
                    snprintf(text, sizeof(text), "%.0f", ends[k]);
                if (!sg_option_set(o, &p, text, NULL, 0))
                    fail_msg("%s: %s is refused", o->name, text);
                snprintf(text, sizeof(text), "%.0f", beyond);
                if (sg_option_set(o, &p, text, expected, sizeof(expected)) || !expected[0])
                    fail_msg("%s: %s is accepted", o->name, text);
                if (o->type == SG_OPTION_DOUBLE && !o->words) {
                    memcpy((char *) &p + o->offset, &beyond, sizeof(beyond));
                    assert_int_equal(sg_check_options(ctx, rows, &p), SG_ERR_USAGE);
                    if (strncmp(sg_last_error(ctx), o->field, strlen(o->field)))
                        fail_msg("%s: the message is %s", o->name, sg_last_error(ctx));
                    sg_clear_error(ctx);
                }
            }
            table(t, &p);
            if (o->type != SG_OPTION_TEXT || o->choices) {
                assert_false(sg_option_set(o, &p, "of no kind", expected, sizeof(expected)));
                assert_true(expected[0]);
            }
            assert_false(sg_option_set(o, &p, "", NULL, 0));
        }
    }
    sg_ctx_destroy(&ctx);
}

/* What a message says is expected in place of "x". */
static void check_refusal(const struct sg_option *options, const char *name, const char *expected)
{
    union params p = {0};
    char found[256] = "";
    assert_false(sg_option_set(sg_option_find(options, name), &p, "x", found, sizeof(found)));
    assert_string_equal(found, expected);
}

static void test_refusals(void **state)
{
    (void) state;
    check_refusal(sg_train_options(), "sh-degree", "a whole number from 0 to 3");
    check_refusal(sg_train_options(), "max-gaussians", "a whole number from 4 to 4000000000, or 0");
    check_refusal(sg_attack_options(), "iterations",
                  "a whole number from 1 to 10000000 or \"preset\"");
    check_refusal(sg_render_options(), "appearance",
                  "a whole number from -3 to 1000000 or one of index|mean|zero");
    check_refusal(sg_train_options(), "lambda-dssim", "a number from 0 to 1");
    check_refusal(sg_train_options(), "rho-least", "a number from 0 to 0.5 or \"preset\"");
    check_refusal(sg_train_options(), "tolerance", "a number from 0 to 255 or one of auto|preset");
    check_refusal(sg_train_options(), "rho",
                  "a number from 0 to 0.5, growth:X with X up to 0.9, or preset");
}

/* A number in place of a word is for fields; in texts only where the help names it. */
static void test_numbers(void **state)
{
    (void) state;
    for (int t = 0; t < TABLES; t++) {
        union params p;
        for (const struct sg_option *o = table(t, &p); o->name; o++) {
            char text[32], named[64];
            snprintf(text, sizeof(text), "%g", o->first_word);
            snprintf(named, sizeof(named), "%s = the preset's", text);
            const bool allowed = o->first_word >= o->low || strstr(o->help, named);
            if (o->words && sg_option_set(o, &p, text, NULL, 0) != allowed)
                fail_msg("%s: %s: the help is: %s", o->name, text, o->help);
        }
    }
}

static void check_text(const char *name, const char *text, const char *printed)
{
    char back[64] = "";
    struct sg_run_params p = sg_run_params_default();
    const struct sg_option *o = sg_option_find(sg_train_options(), name);
    if (sg_option_set(o, &p.train, text, NULL, 0))
        sg_option_get(o, &p.train, back, sizeof(back));
    assert_string_equal(back, printed);
}

static void test_texts(void **state)
{
    (void) state;
    check_text("rho", "preset", "preset");
    check_text("rho", "-1", "preset");
    check_text("rho", "-0.9", "-0.9");
    check_text("rho", "growth:0.9", "-0.9");
    check_text("rho", "growth:3e-1", "-0.3");
    check_text("rho", "growth:1", "");
    check_text("rho", "growth:0", "");
    check_text("rho", "growth:-0.3", "");
    check_text("rho", "growth", "");
    check_text("rho-least", "growth:0.1", "");
    check_text("filter-frequency", "0", "preset");
    check_text("tolerance", "auto", "auto");
    check_text("tolerance", "2.5", "2.5");
    check_text("tolerance", "-1", ""); /* auto, of which no help says so */
    check_text("max-gaussians", "0", "0");
    check_text("max-gaussians", "3", "");
    check_text("max-time", "1h30m", "5400");
    check_text("engine", "ref", "ref");
    check_text("engine", "gpu", "");
    check_text("engine", "vulkan", "vulkan");
    check_text("engine", "auto", "auto");
    check_text("engine", "vulkan:0", "vulkan:0");
    check_text("engine", "vulkan:a b", "vulkan:a b");
    check_text("engine", "vulkan:", "");
    check_text("engine", "vulkan|0", "");
    check_text("engine", "vulkanic", "");
    check_text("engine", "vulkan[:DEVICE]x", "");
    check_text("engine", "cpu:0", "");
    check_text("engine", ":", "");
    check_text("defense", "spectral", "spectral");
    check_text("sh-degree", "2.5", "");
    check_text("lambda-dssim", "nan", "");
    check_text("position-lr-init", "1e-12", "1e-12"); /* an end of its range, rounded to a float */
    check_text("position-lr-init", "9e-13", "");
    struct sg_attack_params a = sg_attack_params_default();
    const struct sg_option *epsilon = sg_option_find(sg_attack_options(), "epsilon");
    for (int level = 0; level <= 255; level++) {
        char text[16], back[16];
        snprintf(text, sizeof(text), "%d", level);
        assert_true(sg_option_set(epsilon, &a, text, NULL, 0));
        assert_true(a.epsilon == (float) (level / 255.0));
        assert_true(sg_option_get(epsilon, &a, back, sizeof(back)));
        assert_string_equal(back, text);
    }
    assert_true(sg_option_set(epsilon, &a, "inf", NULL, 0) && isinf(a.epsilon));
    assert_false(sg_option_set(epsilon, &a, "1e999", NULL, 0));
    assert_false(sg_option_set(epsilon, &a, "7.5", NULL, 0));
    assert_false(sg_option_set(epsilon, &a, "256", NULL, 0));
}

/* Published values: a change here is a change of the experiments. */
static void test_presets(void **state)
{
    (void) state;
    struct sg_defense_params d = sg_defense_params_default();
    assert_true(sg_defense_preset("tt", &d));
    assert_true(d.rho == 0.045 && d.lambda == 4 && d.rho_least == 0 && d.frequency == 8 && !d.on);
    assert_false(sg_defense_preset("auto", &d));
    assert_true(sg_defense_preset("mip", &d) && d.rho == 0.05 && d.lambda == 5);
    struct sg_attack_params a = sg_attack_params_default();
    assert_true(sg_attack_preset("auto", SG_FORMAT_COLMAP, &a));
    assert_true(a.iterations == 12000 && a.inner == 25 && a.update_interval == 1);
    assert_true(sg_attack_preset("auto", SG_FORMAT_BLENDER, &a));
    assert_true(a.iterations == 36000 && a.inner == 15 && a.update_interval == 1);
    a.epsilon = INFINITY;
    assert_true(sg_attack_preset("tt", SG_FORMAT_BLENDER, &a));
    assert_true(a.iterations == 6000 && a.inner == 25 && a.update_interval == 10);
    assert_false(sg_attack_preset("NS", SG_FORMAT_BLENDER, &a));
    /* What is set stays. */
    a.inner = 3, a.iterations = a.update_interval = SG_ATTACK_BY_PRESET;
    assert_false(sg_attack_complete("", SG_FORMAT_BLENDER, &a));
    assert_true(a.iterations == SG_ATTACK_BY_PRESET);
    assert_true(sg_attack_complete("ns", SG_FORMAT_COLMAP, &a));
    assert_true(a.iterations == 6000 && a.inner == 3 && a.update_interval == 10);
}

/* Sets the field to another value of its range. */
static void change(const struct sg_option *o, struct sg_train_params *p)
{
    char before[256], after[256], text[64];
    sg_option_get(o, p, before, sizeof(before));
    const char *word = o->choices ? strchr(o->choices, '|') : NULL;
    const double values[] = {o->low, o->high, (o->low + o->high) / 2};
    for (int i = 0; i < 4; i++) {
        if (i < 3 && is_number(o))
            snprintf(text, sizeof(text), "%.17g", values[i]);
        else if (o->type == SG_OPTION_FLAG)
            snprintf(text, sizeof(text), strcmp(before, "true") ? "true" : "false");
        else if (i)
            snprintf(text, sizeof(text), "%.*s", (int) strcspn(word + 1, "|"), word + 1);
        else
            snprintf(text, sizeof(text), "%.*s", (int) strcspn(o->choices, "|"), o->choices);
        if (sg_option_set(o, p, text, NULL, 0) && sg_option_get(o, p, after, sizeof(after)) &&
            strcmp(before, after))
            return;
    }
    fail_msg("--%s: no other value than %s was found", o->name, before);
}

static bool is_listed(const char *list, const char *name)
{
    return strstr(list, name) && sg_word_index(list, name) >= 0;
}

/* A checkpoint is refused by a run with another value of any option that decides the result. The
 * exceptions are written here, so that a new option is not forgotten in src/train/identity.c. */
static void test_identity(void **state)
{
    (void) state;
    static const char free_to_change[] =
        /* where and how long it runs, and limits, which the run says when they bind */
        "iterations|engine|cpu|max-gaussians|max-time|max-instances|at-limit|"
        /* what has no effect after the beginning, or on the training */
        "init-points|random-points|random-extent|mcmc-init-opacity|mcmc-init-scale|"
        "keep-filter|"
        /* what the checkpoint has in fields and sections of its own */
        "seed|sh-degree|strategy";
    int checked = 0;
    for (const struct sg_option *o = sg_train_options(); o->name; o++) {
        struct sg_train_params p = sg_train_params_default();
        if (!strncmp(o->field, "mcmc.", 5))
            p.strategy = SG_STRATEGY_MCMC;
        if (!strncmp(o->field, "scaffold.", 9) || strstr(o->help, "With --model scaffold"))
            p.model = SG_MODEL_SCAFFOLD;
        if (!strncmp(o->field, "mip.", 4))
            p.model = SG_MODEL_MIP;
        p.exposure = !strncmp(o->field, "exposure_", 9);
        p.scaffold.bank = !strncmp(o->field, "scaffold.bank_", 14);
        p.scaffold.appearance = !strncmp(o->field, "scaffold.appearance_", 20);
        const struct sg_identity before = sg_train_identity(&p, 1);
        if (is_listed(free_to_change, o->name))
            continue;
        change(o, &p);
        const struct sg_identity after = sg_train_identity(&p, 1);
        if (before.parameters == after.parameters && before.strength == after.strength)
            fail_msg("--%s is not in the identity of a run", o->name);
        checked++;
    }
    assert_true(checked > 40);
}

/* Why an option has no effect, or NULL. */
static const char *unused(const struct sg_run_params *p, const char *name)
{
    const struct sg_option *tables[] = {sg_run_options(), sg_scene_options(), sg_train_options()};
    const struct sg_option *row = NULL;
    for (int i = 0; i < 3 && !row; i++)
        row = sg_option_find(tables[i], name);
    assert_non_null(row);
    return sg_run_option_unused(p, row);
}

static void assert_unused(const struct sg_run_params *p, const char *name, const char *expected)
{
    const char *found = unused(p, name);
    if (!found || !strstr(found, expected))
        fail_msg("%s: \"%s\", expected \"%s\"", name, found ? found : "used", expected);
}

static void test_unused(void **state)
{
    (void) state;
    const struct sg_run_params plain = sg_run_params_default();
    struct sg_run_params p;
    const char *const free_of_it[] = {"defense", "audit",   "tolerance", "smooth",  "iterations",
                                      "eval",    "absgrad", "max-time",  "strategy"};
    for (size_t i = 0; i < sizeof(free_of_it) / sizeof(free_of_it[0]); i++)
        assert_null(unused(&plain, free_of_it[i]));
    assert_unused(&plain, "rho", "--defense spectral or --audit defend");
    assert_unused(&plain, "preset", "without a defense");
    assert_unused(&plain, "filter-hits", "without a defense");
    assert_unused(&plain, "tolerance-tv", "--tolerance or");
    assert_unused(&plain, "mip-kernel", "--model mip");
    assert_unused(&plain, "keep-filter", "--model mip");
    assert_unused(&plain, "voxel-size", "--model scaffold");
    assert_unused(&plain, "cap-max", "--strategy mcmc");

    p = plain, p.train.defense.on = true;
    assert_null(unused(&p, "rho"));
    assert_unused(&p, "filter-grace", "--model scaffold");
    p.train.model = SG_MODEL_SCAFFOLD;
    assert_null(unused(&p, "filter-grace"));
    p = plain, p.audit = SG_RUN_AUDIT_DEFEND;
    assert_null(unused(&p, "rho"));
    p = plain, p.audit = SG_RUN_AUDIT_REFUSE;
    assert_unused(&p, "rho", "without a defense");

    const float tolerances[] = {0};
    p = plain, p.train.tolerance = 3;
    assert_null(unused(&p, "tolerance-tv"));
    assert_unused(&p, "rho", "without a defense");
    assert_unused(&p, "tolerance-smooth", "--tolerance auto");
    p = plain, p.train.tolerance = SG_TOLERANCE_AUTO;
    assert_null(unused(&p, "tolerance-tv"));
    assert_null(unused(&p, "tolerance-smooth"));
    p = plain, p.train.tolerances = tolerances;
    assert_null(unused(&p, "tolerance-tv"));

    for (int limit = 0; limit < 3; limit++) { /* which the filter's score decides at */
        p = plain;
        *(limit == 0 ? &p.max_memory : limit == 1 ? &p.max_vram : &p.train.max_gaussians) = 1 << 20;
        assert_null(unused(&p, "filter-hits"));
        assert_unused(&p, "filter-interval", "without a defense");
        p.train.at_limit = SG_AT_LIMIT_STOP;
        assert_unused(&p, "filter-hits", "without a defense");
        p.train.at_limit = SG_AT_LIMIT_SCORE, p.train.model = SG_MODEL_SCAFFOLD;
        assert_unused(&p, "filter-hits", "without a defense");
    }

    p = plain, p.train.model = SG_MODEL_MIP;
    assert_null(unused(&p, "mip-kernel"));
    p = plain, p.train.model = SG_MODEL_SCAFFOLD;
    assert_null(unused(&p, "voxel-size"));
    assert_unused(&p, "appearance-numbers", "--photo-appearance");
    assert_unused(&p, "appearance-lr-init", "--photo-appearance");
    assert_unused(&p, "feature-bank-lr-final", "--feature-bank");
    p.train.scaffold.appearance = p.train.scaffold.bank = true;
    assert_null(unused(&p, "appearance-numbers"));
    assert_null(unused(&p, "feature-bank-lr-final"));
    assert_null(unused(&p, "position-lr-max-steps"));
    assert_null(unused(&p, "densify-grad-threshold"));
    const char *const of_gaussians[] = {"sh-degree",     "position-lr-init", "position-lr-final",
                                        "percent-dense", "feature-lr",       "tolerance-low-pass"};
    for (size_t i = 0; i < sizeof(of_gaussians) / sizeof(of_gaussians[0]); i++)
        assert_unused(&p, of_gaussians[i], "another model than scaffold");
    p = plain, p.train.strategy = SG_STRATEGY_MCMC;
    assert_null(unused(&p, "cap-max"));
    assert_unused(&p, "absgrad", "another strategy");
    p.train.max_gaussians = 1000, p.train.tolerance = 3, p.train.defense.on = true;
    assert_null(unused(&p, "lambda"));
    const char *const of_filter[] = {"at-limit", "tolerance-growth", "filter-views", "rho-least"};
    for (size_t i = 0; i < sizeof(of_filter) / sizeof(of_filter[0]); i++)
        assert_unused(&p, of_filter[i], "another strategy");
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_rows_are_whole), cmocka_unit_test(test_defaults_read_back),
        cmocka_unit_test(test_ranges),         cmocka_unit_test(test_texts),
        cmocka_unit_test(test_refusals),       cmocka_unit_test(test_presets),
        cmocka_unit_test(test_identity),       cmocka_unit_test(test_unused),
        cmocka_unit_test(test_numbers),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
