/* SPDX-License-Identifier: Apache-2.0 */
/* Untrusted checkpoints: whatever the file contains, loading refuses it by name and changes
 * nothing. */
#include <limits.h>
#include <unistd.h>

#define XXH_INLINE_ALL
#include <xxhash.h>

#include "model/anchors.h"
#include "models.h"
#include "train/trainer.h"
#include "whole_file.h"

#define SIDE 20
#define HEADER ((size_t) 160) /* bytes of the format before its sections */
#define AT_COUNT 8
#define AT_DEGREE 16
#define AT_ITERATION 20
#define AT_STEPS 24
#define AT_START 48
#define AT_SEED 56
#define AT_VIEWS 64
#define AT_EXTENT 72
#define AT_VISITED 80
#define AT_SPENT 88
#define AT_NOISE 96
#define AT_BEYOND 104
#define AT_KIND 124
#define AT_PARAMETERS 128
#define AT_STRENGTH 136
#define AT_SECTIONS 144
#define AT_ENDED 152

#define SECTION ((size_t) 40) /* bytes of a section's head */
#define AT_PLANES 24
#define AT_BYTES 32
#define MOST_SECTIONS 16

struct fixture {
    sg_ctx *ctx;
    struct sg_view views[2];
    struct sg_scene scene;
    struct sg_train_params params;
    struct sg_model *start; /* NULL: the trainer makes it */
    sg_trainer *trainer;
    char path[32];
    char *data; /* a sound checkpoint after 3 iterations */
    size_t size;
    int sections;                 /* columns, then the strategy, and of anchors the networks */
    size_t at[MOST_SECTIONS + 1]; /* where its sections begin; where the last one ends */
};

static int begin(void **state, struct sg_train_params params, int sections)
{
    struct fixture *f = calloc(1, sizeof(*f));
    f->params = params;
    f->sections = sections;
    f->ctx = make_context(1);
    for (int v = 0; v < 2; v++) {
        f->views[v].name = (char *) "view";
        f->views[v].camera = make_camera(SIDE, SIDE, 3 + v);
        f->views[v].rgb = malloc(3 * SIDE * SIDE);
        for (size_t i = 0; i < 3 * SIDE * SIDE; i++)
            f->views[v].rgb[i] = (uint8_t) draw(1, i, 0, 255.9f);
    }
    f->scene =
        (struct sg_scene){.path = (char *) "memory", .train = f->views, .n_train = 2, .extent = 3};
    if (params.model != SG_MODEL_SCAFFOLD)
        f->start = make_model(f->ctx, 37, 1, 2);
    assert_int_equal(sg_trainer_create(f->ctx, &f->scene, f->start, &f->params, &f->trainer),
                     SG_OK);
    for (int i = 0; i < 3; i++)
        assert_int_equal(sg_trainer_step(f->trainer, NULL), SG_OK);
    strcpy(f->path, "/tmp/sg_ckpt_XXXXXX");
    close(mkstemp(f->path));
    assert_int_equal(sg_trainer_save(f->trainer, f->path), SG_OK);
    f->data = slurp(f->path, &f->size);
    f->at[0] = HEADER;
    for (int s = 0; s < sections; s++) {
        uint64_t bytes;
        memcpy(&bytes, f->data + f->at[s] + AT_BYTES, sizeof(bytes));
        f->at[s + 1] = f->at[s] + SECTION + (size_t) bytes;
    }
    assert_int_equal(f->at[sections], f->size - 8);
    *state = f;
    return 0;
}

static int setup(void **state)
{
    return begin(state, sg_train_params_default(), 11);
}

static int setup_tolerances(void **state)
{
    static const float tolerances[2] = {3, 0};
    struct sg_train_params p = sg_train_params_default();
    p.tolerances = tolerances;
    return begin(state, p, 12);
}

static int setup_mip(void **state)
{
    struct sg_train_params p = sg_train_params_default();
    p.model = SG_MODEL_MIP;
    p.densify_from_iter = 0; /* statistics are there */
    return begin(state, p, 13);
}

static int setup_mcmc(void **state)
{
    struct sg_train_params p = sg_train_params_default();
    p.strategy = SG_STRATEGY_MCMC;
    return begin(state, p, 10);
}

static int setup_exposures(void **state)
{
    struct sg_train_params p = sg_train_params_default();
    p.exposure = true;
    return begin(state, p, 12);
}

static int setup_radii(void **state)
{
    struct sg_train_params p = sg_train_params_default();
    p.at_limit = SG_AT_LIMIT_UNIVERSAL;
    p.max_gaussians = 100;
    p.densify_from_iter = 0;
    return begin(state, p, 12);
}

static int setup_anchors(void **state)
{
    struct sg_train_params p = sg_train_params_default();
    p.model = SG_MODEL_SCAFFOLD;
    p.init_points = 40;
    p.densify_from_iter = 0;
    p.scaffold.voxel = 0.05f;
    p.scaffold.appearance = true;
    return begin(state, p, MOST_SECTIONS);
}

static int teardown(void **state)
{
    struct fixture *f = *state;
    unlink(f->path);
    free(f->data);
    sg_trainer_destroy(&f->trainer);
    sg_model_destroy(&f->start);
    assert_int_equal(sg_mem_current(f->ctx, SG_MEM_TAGS), 0);
    sg_ctx_destroy(&f->ctx);
    for (int v = 0; v < 2; v++)
        free(f->views[v].rgb);
    free(f);
    return 0;
}

static void seal(char *data, size_t size)
{
    const uint64_t digest = XXH3_64bits(data, size - 8);
    memcpy(data + size - 8, &digest, 8);
}

static int resume(struct fixture *f, const char *path, sg_trainer **out)
{
    return sg_trainer_resume(f->ctx, &f->scene, path, &f->params, out);
}

/* The file must be refused with a message that names it, and nothing may leak. */
static void expect_refusal(struct fixture *f, const char *what)
{
    sg_trainer *t;
    const uint64_t before = sg_mem_current(f->ctx, SG_MEM_TAGS);
    const int code = resume(f, f->path, &t);
    if (code != SG_ERR_INPUT)
        fail_msg("%s: loading returned %d, expected SG_ERR_INPUT", what, code);
    if (!strstr(sg_last_error(f->ctx), f->path))
        fail_msg("%s: message \"%s\" does not name the file", what, sg_last_error(f->ctx));
    assert_null(t);
    assert_int_equal(sg_mem_current(f->ctx, SG_MEM_TAGS), before);
}

static void test_every_cut(void **state)
{
    struct fixture *f = *state;
    char what[64];
    for (size_t n = 0; n < f->size; n += n < 100 ? 1 : 997) {
        spill(f->path, f->data, n);
        snprintf(what, sizeof(what), "cut to %zu bytes", n);
        expect_refusal(f, what);
    }
    spill(f->path, f->data, f->size - 1);
    expect_refusal(f, "last byte missing");
}

static void test_every_flip(void **state)
{
    struct fixture *f = *state;
    char what[64];
    for (size_t n = 0; n < f->size; n += n < HEADER ? 1 : 211) {
        f->data[n] ^= 0x10;
        spill(f->path, f->data, f->size);
        f->data[n] ^= 0x10;
        snprintf(what, sizeof(what), "byte %zu altered", n);
        expect_refusal(f, what);
    }
}

/* The checksum protects from accidents, not from attackers: each field is checked although it
 * matches. */
static void test_sealed_lies(void **state)
{
    struct fixture *f = *state;
    const struct {
        const char *what;
        size_t at;
        uint64_t value;
        size_t bytes;
    } lies[] = {
        {"no Gaussians", AT_COUNT, 0, 8},
        {"more Gaussians than bytes", AT_COUNT, 38, 8},
        {"Gaussians that overflow a size", AT_COUNT, UINT64_MAX / 16, 8},
        {"most Gaussians", AT_COUNT, UINT64_MAX, 8},
        {"Gaussians past 32 bits", AT_COUNT, (uint64_t) 1 << 32, 8},
        {"negative degree", AT_DEGREE, (uint32_t) -1, 4},
        {"other degree", AT_DEGREE, 2, 4},
        {"absurd degree", AT_DEGREE, INT_MAX, 4},
        {"negative iteration", AT_ITERATION, (uint32_t) -5, 4},
        {"last iteration an int holds", AT_ITERATION, INT_MAX, 4},
        {"negative step counter", AT_STEPS, (uint32_t) -1, 4},
        {"more steps than iterations", AT_STEPS + 4, 4, 4},
        {"last step an int holds", AT_STEPS + 20, INT_MAX, 4},
        {"negative start degree", AT_START, (uint32_t) -1, 4},
        {"absurd start degree", AT_START, 4, 4},
        {"start degree beyond what is stored", AT_START, 3, 4},
        {"other cameras", AT_START + 4, 7, 4},
        {"other seed", AT_SEED, 43, 8},
        {"other scene", AT_VIEWS, 3, 8},
        {"more visits than iterations", AT_VISITED, 4, 8},
        {"neither ended nor not", AT_ENDED, 2, 4},
        {"a step in a last iteration", AT_ENDED, 1, 4},
        {"negative time", AT_SPENT, 0xbff0000000000000u, 8},
        {"NaN time", AT_SPENT, 0x7ff8000000000000u, 8},
        {"negative noise", AT_NOISE, 0xbff0000000000000u, 8},
        {"noise above 255 levels", AT_NOISE, 0x4070000000000000u, 8},
        {"NaN noise", AT_NOISE, 0x7ff8000000000000u, 8},
        {"a negative share", AT_BEYOND, 0xbff0000000000000u, 8},
        {"a share above 1", AT_BEYOND, 0x4000000000000000u, 8},
        {"a NaN share", AT_BEYOND, 0x7ff8000000000000u, 8},
        {"other parameters", AT_PARAMETERS, 1, 8},
        {"another strength of the defense", AT_STRENGTH, 1, 8},
        {"a checkpoint of an attack", AT_KIND, 1, 4},
        {"an unknown kind", AT_KIND, 2, 4},
        {"NaN extent", AT_EXTENT, 0x7ff8000000000000u, 8},
        {"photos smoothed without noise", AT_SECTIONS + 4, 1, 4},
        {"no sections", AT_SECTIONS, 0, 4},
        {"a section less", AT_SECTIONS, 10, 4},
        {"a section more", AT_SECTIONS, 12, 4},
        {"most sections", AT_SECTIONS, UINT32_MAX, 4},
    };
    for (size_t i = 0; i < sizeof(lies) / sizeof(lies[0]); i++) {
        char *bad = malloc(f->size);
        memcpy(bad, f->data, f->size);
        memcpy(bad + lies[i].at, &lies[i].value, lies[i].bytes); /* little endian, as the file */
        seal(bad, f->size);
        spill(f->path, bad, f->size);
        free(bad);
        expect_refusal(f, lies[i].what);
    }
}

/* Of another run or scene, or of none: the message has what differs, and nothing else. */
static void test_what_differs(void **state)
{
    struct fixture *f = *state;
    const struct {
        size_t at;
        uint64_t value;
        size_t bytes;
        const char *message;
    } others[] = {
        {AT_SEED, 43, 8, ": seed: found 43, expected 42, that of this run"},
        {AT_VIEWS, 3, 8,
         ": training views: found 3, expected the 2 that the scene has now: photos are missing or "
         "new"},
        {AT_EXTENT, 0x4010000000000000u, 8, ": extent: found 4, expected 3, that of this scene"},
        {AT_DEGREE, 4, 4, ": SH degree: found 4, expected 0 to 3"},
        {AT_START, 2, 4, ": first SH degree: found 2, expected 0 to 1"},
        {AT_COUNT, 0, 8, ": found no Gaussians, expected some"},
        {AT_ITERATION, 10000001, 4,
         ": byte 20: found iteration 10000001 with 3 steps of positions, expected 0 to 10000000 "
         "and no more steps than iterations, none in a last one"},
        {AT_ENDED, 1, 4,
         ": byte 20: found iteration 3, the last one, with 3 steps of positions, expected 0 to "
         "10000000 and no more steps than iterations, none in a last one"},
        {AT_NOISE, 0x4070000000000000u, 8,
         ": found 0 seconds, noise of 256 levels, a share of 1 and 0 for smoothing, expected 0 to "
         "1e12, 0 to 255, 0 to 1 and 0, or 1 with noise"},
    };
    for (size_t i = 0; i < sizeof(others) / sizeof(others[0]); i++) {
        char *bad = malloc(f->size), message[300];
        memcpy(bad, f->data, f->size);
        memcpy(bad + others[i].at, &others[i].value, others[i].bytes);
        seal(bad, f->size);
        spill(f->path, bad, f->size);
        free(bad);
        expect_refusal(f, others[i].message);
        snprintf(message, sizeof(message), "%s%s", f->path, others[i].message);
        assert_string_equal(sg_last_error(f->ctx), message);
    }
}

/* The sections as they are in the file, those of `order` only; sealed. */
static void spill_sections(struct fixture *f, const char *data, const int *order, uint32_t n)
{
    char *bad = malloc(2 * f->size);
    size_t size = HEADER;
    memcpy(bad, data, HEADER);
    memcpy(bad + AT_SECTIONS, &n, sizeof(n));
    for (uint32_t s = 0; s < n; s++) {
        memcpy(bad + size, data + f->at[order[s]], f->at[order[s] + 1] - f->at[order[s]]);
        size += f->at[order[s] + 1] - f->at[order[s]];
    }
    seal(bad, size + 8);
    spill(f->path, bad, size + 8);
    free(bad);
}

/* The number of the section with this title. */
static int find_section(const struct fixture *f, const char *title)
{
    int s = 0;
    while (s < f->sections && strcmp(f->data + f->at[s], title))
        s++;
    assert_true(s < f->sections);
    return s;
}

/* Each section is needed, but for the radii, which follow the limits; none may be there twice or be
 * cut. */
static void test_sections(void **state)
{
    struct fixture *f = *state;
    for (int s = 0; s < f->sections; s++) {
        int order[MOST_SECTIONS + 1], n = 0;
        char title[24];
        memcpy(title, f->data + f->at[s], sizeof(title));
        for (int k = 0; k < f->sections; k++)
            if (k != s)
                order[n++] = k;
        if (strcmp(title, "largest_radius")) {
            spill_sections(f, f->data, order, (uint32_t) n);
            expect_refusal(f, "a section is missing");
            assert_non_null(strstr(sg_last_error(f->ctx), title));
            assert_non_null(strstr(sg_last_error(f->ctx), "found no section"));
        }
        for (n = 0; n < f->sections; n++)
            order[n] = n;
        order[n++] = s;
        spill_sections(f, f->data, order, (uint32_t) n);
        expect_refusal(f, "a section comes twice");
        assert_non_null(strstr(sg_last_error(f->ctx), title));
        const size_t step = 1 + SECTION / 2, content = f->at[s + 1] - f->at[s];
        for (size_t size = f->at[s] + 1; size < f->at[s + 1];
             size += size < f->at[s] + 1000 ? step : step + content / 9) {
            char *cut = malloc(size + 8);
            memcpy(cut, f->data, size);
            seal(cut, size + 8);
            spill(f->path, cut, size + 8);
            free(cut);
            expect_refusal(f, "a section is cut off");
        }
    }
}

static void test_section_heads(void **state)
{
    struct fixture *f = *state;
    const struct {
        const char *what, *message;
        size_t section, at;
        uint64_t value;
        size_t bytes;
    } lies[] = {
        {"an unknown column", "osspacity", 1, 1, 0x7974696361707373, 8},
        {"an empty title", "\"\"", 1, 0, 0, 8},
        {"a title without an end", "position", 0, 8, UINT64_MAX, 8},
        {"a column that is not saved", "gradient\"", 8, 8, 0, 8},
        {"a plane less", "2 planes", 0, AT_PLANES, 2, 4},
        {"no planes", "0 planes", 2, AT_PLANES, 0, 4},
        {"most planes", "4294967295 planes", 5, AT_PLANES, UINT32_MAX, 4},
        {"planes of another degree", "45 planes", 5, AT_PLANES, 45, 4},
        {"a byte more", "445 bytes", 0, AT_BYTES, 445, 8},
        {"no bytes", "0 bytes", 6, AT_BYTES, 0, 8},
        {"most bytes", "18446744073709551615 bytes", 7, AT_BYTES, UINT64_MAX, 8},
        {"another strategy", "strategy:Xefault", 10, 8, 0x746c756166655800 | ':', 8},
        {"a smaller state", "16 bytes", 10, AT_BYTES, 16, 8},
        {"negative growth", "strategy:default", 10, SECTION, 0xbff0000000000000u, 8},
        {"NaN growth", "strategy:default", 10, SECTION, 0x7ff8000000000000u, 8},
        {"more growths than iterations", "strategy:default", 10, SECTION + 8, 4, 8},
        {"most growths", "strategy:default", 10, SECTION + 8, UINT64_MAX, 8},
    };
    for (size_t i = 0; i < sizeof(lies) / sizeof(lies[0]); i++) {
        char *bad = malloc(f->size);
        memcpy(bad, f->data, f->size);
        memcpy(bad + f->at[lies[i].section] + lies[i].at, &lies[i].value, lies[i].bytes);
        seal(bad, f->size);
        spill(f->path, bad, f->size);
        free(bad);
        expect_refusal(f, lies[i].what);
        if (!strstr(sg_last_error(f->ctx), lies[i].message))
            fail_msg("%s: \"%s\" does not have \"%s\"", lies[i].what, sg_last_error(f->ctx),
                     lies[i].message);
    }
}

/* Sections may come in any order. */
static void test_section_order(void **state)
{
    struct fixture *f = *state;
    int order[MOST_SECTIONS];
    size_t size;
    sg_trainer *t;
    for (int s = 0; s < f->sections; s++)
        order[s] = f->sections - 1 - s;
    spill_sections(f, f->data, order, (uint32_t) f->sections);
    assert_int_equal(resume(f, f->path, &t), SG_OK);
    assert_int_equal(sg_trainer_save(t, f->path), SG_OK);
    sg_trainer_destroy(&t);
    char *again = slurp(f->path, &size);
    assert_int_equal(size, f->size);
    assert_memory_equal(again, f->data, size);
    free(again);
}

/* An earlier version is named. */
static void test_version(void **state)
{
    struct fixture *f = *state;
    f->data[7] = 7;
    seal(f->data, f->size);
    spill(f->path, f->data, f->size);
    expect_refusal(f, "version 7");
    assert_non_null(strstr(sg_last_error(f->ctx), "found version 7, expected version 12"));
}

/* Of some sections no run can write values below 0, and of some of these all are finite. */
static const struct {
    const char *title;
    bool finite;
} bounded[] = {{"moment2", false},        {"gradient_sum", false},     {"gradient_count", true},
               {"largest_radius", true},  {"filter_3d", true},         {"gradient_absolute", false},
               {"anchor_moment2", false}, {"anchor_statistics", false}};

/* The least that a section's top bytes can be masked with, so that its values are possible. */
static int possible(const char *title)
{
    for (size_t i = 0; i < sizeof(bounded) / sizeof(bounded[0]); i++)
        if (!strcmp(title, bounded[i].title))
            return bounded[i].finite ? 0x3f : 0x7f;
    return 0xff;
}

/* Of Gaussians in whole blocks and in the last one: refused, with the file, the section, what was
 * found and what is possible. */
static void test_impossible(void **state)
{
    struct fixture *f = *state;
    static const float lies[] = {-1e-30f, -INFINITY, NAN, INFINITY};
    int tried = 0;
    uint64_t n;
    memcpy(&n, f->data + AT_COUNT, sizeof(n));
    for (int s = 0; s < f->sections; s++) {
        const char *title = f->data + f->at[s];
        const int mask = possible(title);
        uint32_t planes;
        memcpy(&planes, title + AT_PLANES, sizeof(planes));
        const bool finite = mask == 0x3f || (!f->start && mask != 0xff);
        for (int k = 0; k < 2 * (mask == 0xff ? 0 : finite ? 4 : 2); k++) {
            const size_t last = (size_t) n - 1, first = last / SG_LANES * SG_LANES;
            const size_t i = k % 2 ? last : 5, plane = planes / 2;
            const size_t at = k % 2 ? first * planes + plane * (last - first + 1) + last - first
                                    : plane * SG_LANES + 5;
            char *bad = malloc(f->size), what[128];
            memcpy(bad, f->data, f->size);
            memcpy(bad + f->at[s] + SECTION + at * sizeof(float), &lies[k / 2], sizeof(float));
            seal(bad, f->size);
            spill(f->path, bad, f->size);
            free(bad);
            expect_refusal(f, title);
            snprintf(what, sizeof(what), "section \"%s\": %s %zu: found %g, expected a %snumber of",
                     title, f->start ? "Gaussian" : "anchor", i, (double) lies[k / 2],
                     finite ? "finite " : "");
            if (!strstr(sg_last_error(f->ctx), what))
                fail_msg("\"%s\" does not have \"%s\"", sg_last_error(f->ctx), what);
        }
        tried += mask != 0xff;
    }
    /* second moments and both statistics, and what the variant has */
    assert_int_equal(tried, f->params.model != SG_MODEL_3DGS
                                ? 5
                                : 3 + (f->params.at_limit == SG_AT_LIMIT_UNIVERSAL));
}

/* Exposures and their moments: finite, and no square below 0. */
static void test_exposures(void **state)
{
    struct fixture *f = *state;
    static const struct {
        size_t i;
        float value;
    } lies[] = {{0, NAN}, {23, INFINITY}, {30, -INFINITY}, {48, -1e-30f}, {71, -1}, {60, NAN}};
    static const float sound[] = {-1, 1e30f};
    sg_trainer *t;
    const int s = find_section(f, "exposure");
    for (size_t k = 0; k < sizeof(lies) / sizeof(lies[0]) + 2; k++) {
        const bool lie = k >= 2;
        const size_t i = lie ? lies[k - 2].i : 40; /* a first moment */
        char *bad = malloc(f->size), message[96];
        memcpy(bad, f->data, f->size);
        memcpy(bad + f->at[s] + SECTION + i * sizeof(float), lie ? &lies[k - 2].value : &sound[k],
               sizeof(float));
        seal(bad, f->size);
        spill(f->path, bad, f->size);
        free(bad);
        if (!lie) {
            assert_int_equal(resume(f, f->path, &t), SG_OK);
            sg_trainer_destroy(&t);
            continue;
        }
        expect_refusal(f, "an exposure");
        snprintf(message, sizeof(message),
                 "section \"exposure\": found value %zu of %g, expected finite numbers, second", i,
                 (double) lies[k - 2].value);
        if (!strstr(sg_last_error(f->ctx), message))
            fail_msg("\"%s\" does not have \"%s\"", sg_last_error(f->ctx), message);
    }
}

/* Parameters may be any float, and other values any that a run can write: training continues
 * without harm to the process. */
static void test_sealed_garbage(void **state)
{
    struct fixture *f = *state;
    char *bad = malloc(f->size);
    memcpy(bad, f->data, f->size);
    for (int s = 0; s < f->sections; s++) {
        const char *title = f->data + f->at[s];
        /* Anchors stay where views see them. */
        const bool seen = !f->start && (!strcmp(title, "position") || !strcmp(title, "scale"));
        if (seen || !strncmp(title, "strategy", 8) || !strcmp(title, "networks") ||
            !strcmp(title, "exposure"))
            continue;
        for (size_t i = f->at[s] + SECTION; i < f->at[s + 1]; i++) {
            bad[i] = (char) (int) draw(5, i, -128, 127.9f);
            if ((i - f->at[s] - SECTION) % sizeof(float) == 3) { /* sign and exponent */
                float value;
                bad[i] = (char) (bad[i] & possible(title));
                memcpy(&value, bad + i - 3, sizeof(value));
                if (!f->start && !isfinite(value)) /* anchors are finite */
                    bad[i] = (char) (bad[i] & 0xbf);
            }
        }
    }
    seal(bad, f->size);
    spill(f->path, bad, f->size);
    free(bad);
    sg_trainer *t;
    assert_int_equal(resume(f, f->path, &t), SG_OK);
    for (int i = 0; i < 3; i++) {
        struct sg_train_step step;
        assert_int_equal(sg_trainer_step(t, &step), SG_OK);
        assert_true(isfinite(step.loss));
    }
    sg_trainer_destroy(&t);
}

/* A run continues with its own parameters, except for limits. */
static void test_other_parameters(void **state)
{
    struct fixture *f = *state;
    sg_trainer *t;
    for (int i = 0; i < 8; i++) {
        struct sg_train_params p = sg_train_params_default();
        const bool same = i >= 5;
        p.lambda_dssim = i == 0 ? 0.5f : p.lambda_dssim;
        p.feature_lr = i == 1 ? 0.01f : p.feature_lr;
        p.defense.on = i == 2;
        p.defense.lambda = i == 3 ? 1 : p.defense.lambda;
        p.tolerance = i == 4 ? 2 : 0;
        p.iterations = i == 5 ? 100 : p.iterations;
        p.max_gaussians = i == 6 ? 50 : 0;
        p.engine = i == 7 ? "ref" : p.engine;
        const int code = sg_trainer_resume(f->ctx, &f->scene, f->path, &p, &t);
        if (code != (same ? SG_OK : SG_ERR_INPUT))
            fail_msg("case %d: resuming returned %d", i, code);
        if (!same)
            assert_non_null(strstr(sg_last_error(f->ctx), f->path));
        sg_trainer_destroy(&t);
    }
    /* Values that an audit derived from the photos may change with the photos. */
    struct sg_train_params p = sg_train_params_default();
    p.defense.lambda = 1;
    f->views[0].rgb[0] ^= 1;
    assert_int_equal(sg_trainer_resume(f->ctx, &f->scene, f->path, &p, &t), SG_OK);
    sg_trainer_destroy(&t);
}

static void test_other_files(void **state)
{
    struct fixture *f = *state;
    sg_trainer *t;
    assert_int_equal(resume(f, "/nonexistent/file", &t), SG_ERR_INPUT);
    assert_int_equal(resume(f, "/tmp", &t), SG_ERR_INPUT);
    spill(f->path, "ply\nformat binary", 17);
    expect_refusal(f, "a PLY file");
    assert_int_equal(sg_trainer_save(f->trainer, "/nonexistent/file"), SG_ERR_INPUT);
    assert_int_equal(sg_trainer_step(f->trainer, NULL), SG_OK);
}

/* The hash of the photos is taken once, when the run begins: saving reads none of them again. */
static void test_photos_hashed_once(void **state)
{
    struct fixture *f = *state;
    size_t size;
    f->views[1].rgb[7] ^= 255;
    assert_int_equal(sg_trainer_save(f->trainer, f->path), SG_OK);
    char *again = slurp(f->path, &size);
    f->views[1].rgb[7] ^= 255;
    assert_int_equal(size, f->size);
    assert_memory_equal(again, f->data, size);
    free(again);
}

/* Networks are finite numbers, without squares below 0, and have a voxel above 0. */
static void test_networks(void **state)
{
    struct fixture *f = *state;
    const size_t first = f->at[MOST_SECTIONS - 1] + SECTION, voxel = f->size - 8 - sizeof(float);
    const struct {
        size_t at;
        float value;
        const char *message;
    } lies[] = {{first, NAN, "value 0 of nan"},
                {first + 2 * 123 * sizeof(float), -INFINITY, "value 246 of -inf"},
                {voxel - sizeof(float), INFINITY, "of inf"},
                {voxel - sizeof(float), -1e-30f, "of -1e-30"}, /* second moments: of a photo */
                {first + 2 * SG_WEIGHTS * sizeof(float), -1e-30f, "of -1e-30"},
                {first + 3 * SG_WEIGHTS * sizeof(float) - sizeof(float), -1, "of -1"},
                {voxel, 0, "of 0"},
                {voxel, -1, "of -1"},
                {voxel, NAN, "of nan"}};
    for (size_t i = 0; i < sizeof(lies) / sizeof(lies[0]); i++) {
        char *bad = malloc(f->size);
        memcpy(bad, f->data, f->size);
        memcpy(bad + lies[i].at, &lies[i].value, sizeof(float));
        seal(bad, f->size);
        spill(f->path, bad, f->size);
        free(bad);
        expect_refusal(f, lies[i].message);
        if (!strstr(sg_last_error(f->ctx), "section \"networks\"") ||
            !strstr(sg_last_error(f->ctx), lies[i].message))
            fail_msg("\"%s\" does not have \"%s\"", sg_last_error(f->ctx), lies[i].message);
    }
}

/* One anchor that is no number would make all networks so; SH that anchors do not have would be
 * copied beyond their arrays. */
static void test_anchors(void **state)
{
    struct fixture *f = *state;
    for (int degree = 1; degree <= 3; degree++) {
        char *bad = malloc(f->size);
        memcpy(bad, f->data, f->size);
        memcpy(bad + AT_DEGREE, &degree, sizeof(degree));
        seal(bad, f->size);
        spill(f->path, bad, f->size);
        free(bad);
        expect_refusal(f, "SH of anchors");
        assert_non_null(strstr(sg_last_error(f->ctx), "expected 0"));
    }
    static const char *const titles[] = {"position", "scale", "anchor", "anchor_moment1"};
    for (size_t k = 0; k < sizeof(titles) / sizeof(titles[0]); k++) {
        const int s = find_section(f, titles[k]);
        const float lies[] = {NAN, INFINITY};
        for (int i = 0; i < 2; i++) {
            char *bad = malloc(f->size), message[64];
            memcpy(bad, f->data, f->size);
            memcpy(bad + f->at[s] + SECTION, &lies[i], sizeof(float));
            seal(bad, f->size);
            spill(f->path, bad, f->size);
            free(bad);
            expect_refusal(f, titles[k]);
            snprintf(message, sizeof(message), "section \"%s\": anchor 0: found", titles[k]);
            if (!strstr(sg_last_error(f->ctx), message))
                fail_msg("\"%s\" does not have \"%s\"", sg_last_error(f->ctx), message);
        }
    }
}

/* Resumes the checkpoint at f->path with this limit, saves it again, and reads that. */
static char *pass_on(struct fixture *f, uint64_t max_gaussians, size_t *size)
{
    sg_trainer *t;
    struct sg_train_params p = f->params;
    p.max_gaussians = max_gaussians;
    assert_int_equal(sg_trainer_resume(f->ctx, &f->scene, f->path, &p, &t), SG_OK);
    assert_int_equal(sg_trainer_save(t, f->path), SG_OK);
    sg_trainer_destroy(&t);
    return slurp(f->path, size);
}

/* Limits may change, and with them whether radii count. Those of a run that did not count them are
 * 0. */
static void test_other_limits(void **state)
{
    struct fixture *f = *state;
    const int radii = find_section(f, "largest_radius");
    int order[MOST_SECTIONS], n = 0;
    size_t size, expected_size;
    for (int s = 0; s < f->sections; s++)
        if (s != radii)
            order[n++] = s;
    char *without = pass_on(f, 0, &size);
    spill_sections(f, f->data, order, (uint32_t) n);
    char *expected = slurp(f->path, &expected_size);
    assert_int_equal(size, expected_size);
    assert_memory_equal(without, expected, size);
    free(without);
    free(expected);
    char *with = pass_on(f, f->params.max_gaussians, &size);
    const size_t from = f->at[radii] + SECTION, bytes = f->at[radii + 1] - from;
    assert_int_equal(size, f->size);
    assert_memory_not_equal(with, f->data, size); /* some radius was seen */
    memset(f->data + from, 0, bytes);
    seal(f->data, f->size);
    assert_memory_equal(with, f->data, size);
    free(with);
}

/* Tolerances, the last section here, are grey levels. */
static void test_tolerances(void **state)
{
    struct fixture *f = *state;
    const size_t first = f->at[11] + SECTION;
    static const float lies[] = {NAN, -1, 256, INFINITY};
    for (size_t i = 0; i < 2 * sizeof(lies) / sizeof(lies[0]); i++) {
        char *bad = malloc(f->size), message[64];
        memcpy(bad, f->data, f->size);
        memcpy(bad + first + i % 2 * sizeof(float), &lies[i / 2], sizeof(float));
        seal(bad, f->size);
        spill(f->path, bad, f->size);
        free(bad);
        expect_refusal(f, "a tolerance");
        snprintf(message, sizeof(message), "section \"tolerances\": found value %zu of", i % 2);
        assert_non_null(strstr(sg_last_error(f->ctx), message));
    }
}

int main(void)
{
#define ONE(test) cmocka_unit_test_setup_teardown(test, setup, teardown)
#define OF(kind, test)                                                                             \
    {                                                                                              \
#test " (" #kind ")", test, setup_##kind, teardown, NULL                                   \
    }
#define HOSTILE(kind)                                                                              \
    OF(kind, test_every_cut), OF(kind, test_every_flip), OF(kind, test_sections),                  \
        OF(kind, test_section_order), OF(kind, test_sealed_garbage), OF(kind, test_impossible)
    const struct CMUnitTest tests[] = {
        ONE(test_every_cut),
        ONE(test_every_flip),
        ONE(test_sealed_lies),
        ONE(test_what_differs),
        ONE(test_sections),
        ONE(test_section_heads),
        ONE(test_section_order),
        ONE(test_version),
        {"test_tolerances", test_tolerances, setup_tolerances, teardown, NULL},
        {"test_section_order (tolerances)", test_section_order, setup_tolerances, teardown, NULL},
        ONE(test_sealed_garbage),
        ONE(test_impossible),
        ONE(test_other_files),
        ONE(test_photos_hashed_once),
        ONE(test_other_parameters),
        HOSTILE(mip),
        HOSTILE(mcmc),
        HOSTILE(exposures),
        OF(exposures, test_exposures),
        HOSTILE(radii),
        OF(radii, test_other_limits),
        HOSTILE(anchors),
        OF(anchors, test_networks),
        OF(anchors, test_anchors),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
