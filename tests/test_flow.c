/* SPDX-License-Identifier: Apache-2.0 */
/* Iterations in flight on a Vulkan device: however many there are, and whatever has no room, the
 * bytes are the same. SG_TEST_ENGINE names the device. */
#include <unistd.h>

#include "attack/attack.h"
#include "core/vram.h"
#include "engine/scaffold/state.h"
#include "engine/vulkan/engine.h"
#include "train/trainer.h"
#define SIDE 32 /* four tiles: a driver for the CPU takes milliseconds for one */
#include "training_anchors.h"

#define ITERATIONS 16
#define TINY 5 /* instances: no view has so few */

enum look { NOTHING, VALUES, SAVED, MODEL, IMAGE, RESET, LOOKS };

/* A training that never waits unless it has to. */
struct flight {
    uint32_t depth;            /* submissions at once */
    uint64_t room;             /* instances at first, or 0 */
    int tight, until;          /* no instance has room when iterations tight to until - 1 begin */
    enum look looks;           /* after such an iteration */
    bool settles;              /* the last half of the iterations, as where time is short */
    bool passing;              /* photos come and go, as where the device has no room for all */
    uint64_t repeats;          /* out */
    uint64_t instances;        /* out: the most */
    int in_flight;             /* out: the most */
    double losses[ITERATIONS]; /* out: of each step, as they arrive */
    uint64_t most[ITERATIONS]; /* out: instances up to it */
    double seen;               /* out: how often views have seen anchors, since they grew */
    struct sg_train_step last;
    float exposures[VIEWS * SG_EXPOSURE_FLOATS]; /* out */
};

/* Of anchors, the engine that draws them. */
static struct vulkan_engine *device_of(sg_trainer *t)
{
    struct sg_engine *e = t->engine;
    return vulkan_of(sg_engine_each(e) > 1 ? ((struct scaffold_engine *) e)->inner : e);
}

/* Of all anchors of a training whose model has been asked for. */
static double sum_seen(const sg_trainer *t)
{
    const struct sg_host_model *h = &((const struct scaffold_engine *) t->engine)->anchors;
    double sum = 0;
    for (size_t i = 0; i < h->count; i++)
        sum +=
            (double) h->at[SG_C_ANCHOR_STATISTICS][sg_param_index(SG_A_STATISTICS, i, SG_A_SEEN)];
    return sum;
}

static int busy(const struct gpu *g)
{
    int n = 0;
    for (int i = 0; i < GPU_FLIGHTS; i++)
        n += g->flights[i].busy;
    return n;
}

/* Asks for something that waits. */
static void look(const struct fixture *f, sg_trainer *t, enum look what)
{
    struct sg_train_step s;
    struct sg_model *m;
    sg_renderer *r;
    float pixels[3 * SIDE * SIDE];
    char path[] = "/tmp/sg_flow_XXXXXX";
    switch (what) {
    case VALUES:
        assert_int_equal(sg_trainer_values(t, &s), SG_OK);
        break;
    case SAVED:
        close(mkstemp(path));
        assert_int_equal(sg_trainer_save(t, path), SG_OK);
        unlink(path);
        break;
    case MODEL:
        assert_int_equal(sg_trainer_model(t, &m), SG_OK);
        sg_model_destroy(&m);
        break;
    case IMAGE:
        assert_int_equal(sg_trainer_renderer(t, &r), SG_OK);
        assert_int_equal(sg_render(r, &f->views[0].camera, pixels, NULL, NULL, NULL), SG_OK);
        sg_renderer_destroy(&r);
        break;
    case RESET:
        assert_int_equal(sg_engine_floor_scale(t->engine, 0.02f), SG_OK);
        break;
    default:
        break;
    }
}

/* Takes the values of the steps after the first `n` that have arrived, in order: returns how many
 * steps have. Those of a step stay until the fourth one after it. */
static uint64_t take_arrived(sg_trainer *t, struct flight *how, uint64_t n, bool wait)
{
    const uint64_t steps = sg_trainer_view(t);
    assert_in_range(steps - n, 0, GPU_FLIGHTS + 1);
    for (bool known = true; n < steps && known;) {
        struct sg_train_step s;
        uint64_t most;
        assert_int_equal(sg_trainer_arrived(t, n + 1, wait, &s, &most, &known), SG_OK);
        if (known)
            how->losses[n] = s.loss, how->most[n++] = most;
    }
    return n;
}

static struct sg_model *fly(struct fixture *f, const struct sg_train_params *p, struct flight *how)
{
    sg_trainer *t = begin_training(f, p);
    struct vulkan_engine *e = device_of(t);
    struct sg_model *m;
    e->gpu->depth = how->depth ? how->depth : GPU_FLIGHTS;
    e->lists.capacity = how->room;
    how->in_flight = 0;
    uint64_t arrived = 0;
    if (how->settles)
        t->settles_from = p->iterations / 2;
    for (size_t i = 0; i < VIEWS && how->passing; i++) {
        assert_int_equal(sg_engine_photo_drop(t->engine, t->photos[i]), SG_OK);
        t->photos[i] = 0;
    }
    while (sg_trainer_iteration(t) < p->iterations) {
        const int it = sg_trainer_iteration(t) + 1;
        if (it >= how->tight && it < how->until && !how->room)
            e->lists.capacity = TINY;
        if (sg_trainer_advance(t, NULL))
            fail_msg("iteration %d: %s", it, sg_last_error(f->ctx));
        how->in_flight = busy(e->gpu) > how->in_flight ? busy(e->gpu) : how->in_flight;
        arrived = take_arrived(t, how, arrived, false);
        if (it >= how->tight && it < how->until)
            look(f, t, how->looks);
    }
    assert_int_equal(take_arrived(t, how, arrived, true), p->iterations);
    assert_int_equal(sg_trainer_values(t, &how->last), SG_OK);
    assert_int_equal(sg_trainer_most_instances(t, &how->instances), SG_OK);
    assert_int_equal(busy(e->gpu), 0);
    assert_int_equal(sg_trainer_model(t, &m), SG_OK);
    how->seen = p->model == SG_MODEL_SCAFFOLD ? sum_seen(t) : 0;
    how->repeats = e->flow.repeats;
    memset(how->exposures, 0, sizeof(how->exposures));
    const float *exposures;
    assert_int_equal(sg_trainer_exposures(t, &exposures), SG_OK);
    if (exposures)
        memcpy(how->exposures, exposures, sizeof(how->exposures));
    sg_trainer_destroy(&t);
    return m;
}

static struct sg_train_params flow_params(void)
{
    struct sg_train_params p = short_params();
    p.engine = main_engine();
    p.iterations = ITERATIONS;
    p.densification_interval = 8, p.densify_until_iter = 15;
    return p;
}

static void assert_same_models(const struct sg_model *a, const struct sg_model *b)
{
    (a->columns && a->columns->networks ? assert_same_anchors : assert_same)(a, b);
}

/* The model and all numbers of `how` are those of a training that waits after each step. */
static void assert_as_waiting(struct fixture *f, const struct sg_train_params *p,
                              const struct sg_model *expected, const struct flight *waited,
                              struct flight *how)
{
    struct sg_model *found = fly(f, p, how);
    assert_same_models(expected, found);
    assert_memory_equal(how->exposures, waited->exposures, sizeof(how->exposures));
    assert_int_equal(how->instances, waited->instances);
    assert_true(how->seen == waited->seen);
    assert_memory_equal(how->losses, waited->losses, sizeof(how->losses));
    assert_memory_equal(how->most, waited->most, sizeof(how->most));
    assert_true(how->last.loss == waited->last.loss && how->last.psnr == waited->last.psnr);
    assert_int_equal(how->last.render.pairs, waited->last.render.pairs);
    assert_int_equal(how->last.render.instances, waited->last.render.instances);
    assert_int_equal(how->last.render.max_tile, waited->last.render.max_tile);
    sg_model_destroy(&found);
}

/* One, two or three submissions at once; and steps that are asked for their values. */
static void test_depths(void **state)
{
    (void) state;
    const struct sg_train_params p = flow_params();
    struct fixture f = make_fixture(1);
    struct flight one = {.depth = 1};
    struct sg_model *expected = fly(&f, &p, &one);
    assert_int_equal(one.in_flight, 0);
    assert_true(one.instances > one.last.render.instances);
    for (uint32_t depth = 2; depth <= GPU_FLIGHTS; depth++) {
        struct flight more = {.depth = depth};
        assert_as_waiting(&f, &p, expected, &one, &more);
        assert_int_equal(more.in_flight, depth);
    }
    double losses[ITERATIONS];
    struct sg_model *asked = train(&f, &p, ITERATIONS, NULL, NULL, losses);
    assert_same(expected, asked);
    assert_true(losses[ITERATIONS - 1] == one.last.loss);
    assert_memory_equal(losses, one.losses, sizeof(losses));
    assert_int_equal(one.most[ITERATIONS - 1], one.instances);
    sg_model_destroy(&asked);
    sg_model_destroy(&expected);
    clear_fixture(&f);
}

/* Lists that have no room in one iteration, wherever it lies between two edits, in all of them, and
 * whatever finds out. */
static void test_overflow(void **state)
{
    (void) state;
    const struct sg_train_params p = flow_params();
    struct fixture f = make_fixture(1);
    struct flight ample = {.room = 100000};
    struct sg_model *expected = fly(&f, &p, &ample);
    assert_int_equal(ample.repeats, 0);
    for (int it = 9; it <= 13; it++) {
        struct flight tight = {.depth = it == 13 ? 1 : GPU_FLIGHTS, .tight = it, .until = it + 1};
        assert_as_waiting(&f, &p, expected, &ample, &tight);
        assert_true(tight.repeats > 0);
    }
    struct flight always = {.tight = 2, .until = ITERATIONS + 1};
    assert_as_waiting(&f, &p, expected, &ample, &always);
    assert_true(always.repeats >= ITERATIONS / (GPU_FLIGHTS + 1));
    for (enum look what = VALUES; what < LOOKS; what++) {
        struct flight asked = {.tight = 11, .until = 12, .looks = what}, plain = asked;
        if (what == RESET) { /* which changes the model */
            plain.room = 100000;
            sg_model_destroy(&expected);
            expected = fly(&f, &p, &plain);
        } else
            plain = ample;
        assert_as_waiting(&f, &p, expected, &plain, &asked);
        assert_true(asked.repeats > plain.repeats);
    }
    sg_model_destroy(&expected);
    clear_fixture(&f);
}

/* Stages beside those of the plain training: the shape of Mip-Splatting, exposures, a limit that
 * looks at radii, the defense with its losses and hits, noise and relocations, and an image in
 * bands. */
static void test_variants(void **state)
{
    (void) state;
    struct fixture f = make_fixture(1);
    for (int k = 0; k < 6; k++) {
        struct sg_train_params p = flow_params();
        p.iterations = 12;
        p.model = k == 0 ? SG_MODEL_MIP : SG_MODEL_3DGS;
        p.exposure = k == 1;
        p.at_limit = k == 2 ? SG_AT_LIMIT_UNIVERSAL : p.at_limit;
        p.max_gaussians = k == 2 || k == 4 ? 130 : 0;
        p.defense.on = k == 3;
        p.defense.interval = 5, p.defense.views = 2, p.defense.from = 4;
        p.strategy = k == 4 ? SG_STRATEGY_MCMC : SG_STRATEGY_DEFAULT;
        p.max_instances = k == 5 ? 100 : p.max_instances;
        struct flight one = {.depth = 1}, three = {0}, tight = {.tight = 2, .until = 12};
        struct sg_model *expected = fly(&f, &p, &one);
        assert_as_waiting(&f, &p, expected, &one, &tight);
        assert_true(k == 5 ? one.last.render.bands > 1 : tight.repeats > 2);
        assert_true((one.exposures[0] != 0) == (k == 1));
        if (k == 1 || k == 2) { /* they do not wait */
            assert_as_waiting(&f, &p, expected, &one, &three);
            assert_int_equal(three.in_flight, GPU_FLIGHTS);
        }
        sg_model_destroy(&expected);
    }
    clear_fixture(&f);
}

/* Anchors and their networks: nobody waits between two iterations that grow, also with exposures
 * and appearances, photos that come and go, and the defense. The last case settles. */
static void test_anchors(void **state)
{
    (void) state;
    struct fixture f = make_points(1);
    sg_model_destroy(&f.start); /* they begin with the points */
    for (int k = 0; k < 4; k++) {
        struct sg_train_params p = scaffold_params();
        p.engine = main_engine();
        p.iterations = ITERATIONS;
        p.scaffold.from = 4, p.densification_interval = 8, p.densify_until_iter = 15;
        p.exposure = p.scaffold.appearance = k == 1;
        p.defense.on = k == 2;
        p.defense.interval = 5, p.defense.views = 2, p.defense.from = 4;
        struct flight one = {.depth = 1, .room = 100000, .settles = k == 3},
                      three = {.passing = k == 1, .settles = k == 3}, tight = three, once = three;
        tight.tight = 2, tight.until = ITERATIONS + 1;
        once.tight = 12, once.until = 13;
        struct sg_model *expected = fly(&f, &p, &one);
        assert_int_equal(one.repeats, 0);
        assert_true((one.exposures[0] != 0) == (k == 1) && one.seen > 0);
        assert_as_waiting(&f, &p, expected, &one, &three);
        assert_int_equal(three.in_flight, GPU_FLIGHTS);
        assert_as_waiting(&f, &p, expected, &one, &tight);
        assert_true(tight.repeats >= ITERATIONS / (GPU_FLIGHTS + 1));
        assert_as_waiting(&f, &p, expected, &one, &once);
        assert_true(once.repeats > 0);
        sg_model_destroy(&expected);
    }
    clear_points(&f);
}

/* Photos that come and go: none waits for the device. Their sizes differ, so that their rooms grow
 * on the way, also in iterations that are run again. */
static void test_passing(void **state)
{
    (void) state;
    const struct sg_train_params p = flow_params();
    struct fixture f = make_fixture(1);
    for (int k = 0; k < VIEWS; k++) /* upper rows only, but for the last views */
        f.views[k].camera.height = k < VIEWS - 2 ? SIDE / 2 + k : SIDE;
    struct flight one = {.depth = 1};
    struct sg_model *expected = fly(&f, &p, &one);
    for (uint32_t depth = 1; depth <= GPU_FLIGHTS; depth++) {
        struct flight passing = {.depth = depth, .passing = true},
                      tight = {.depth = depth, .passing = true, .tight = 2, .until = 17};
        assert_as_waiting(&f, &p, expected, &one, &passing);
        assert_int_equal(passing.in_flight, depth > 1 ? depth : 0);
        assert_as_waiting(&f, &p, expected, &one, &tight);
        assert_true(tight.repeats >= ITERATIONS / (GPU_FLIGHTS + 1));
    }
    struct flight once = {.passing = true, .tight = 11, .until = 12};
    assert_as_waiting(&f, &p, expected, &one, &once);
    assert_true(once.repeats > 0);
    sg_model_destroy(&expected);
    clear_fixture(&f);
}

/* An attack whose decoy is `how` far ahead of the device. out: the decoy, and its last step. */
static struct sg_model *raid(struct fixture *f, const struct sg_attack_params *p,
                             struct flight *how, struct sg_attack_step *last)
{
    sg_attack *a;
    struct sg_model *decoy;
    assert_int_equal(sg_attack_create(f->ctx, &f->scene, f->start, p, &a), SG_OK);
    struct vulkan_engine *e = device_of(a->trainer);
    e->gpu->depth = how->depth ? how->depth : GPU_FLIGHTS;
    how->in_flight = 0;
    while (sg_attack_iteration(a) < p->iterations) {
        const int it = sg_attack_iteration(a) + 1;
        if (it >= how->tight && it < how->until)
            e->lists.capacity = TINY;
        if (sg_attack_advance(a, last))
            fail_msg("iteration %d: %s", it, sg_last_error(f->ctx));
        assert_true(a->on_device);
        how->in_flight = busy(e->gpu) > how->in_flight ? busy(e->gpu) : how->in_flight;
    }
    assert_int_equal(sg_attack_values(a, last), SG_OK);
    assert_int_equal(sg_attack_decoy(a, &decoy), SG_OK);
    how->repeats = e->flow.repeats;
    sg_attack_destroy(&a);
    return decoy;
}

/* Anchors to begin an attack with, in place of the fixture's Gaussians. */
static void make_anchor_proxy(struct fixture *f)
{
    struct sg_train_params p = scaffold_params();
    sg_trainer *t;
    p.engine = "cpu";
    p.scaffold.appearance = true;
    sg_model_destroy(&f->start);
    t = begin_training(f, &p);
    for (int it = 0; it < 8; it++)
        assert_int_equal(sg_trainer_step(t, NULL), SG_OK);
    assert_int_equal(sg_trainer_model(t, &f->start), SG_OK);
    sg_trainer_destroy(&t);
}

/* The decoy of an attack: the same bytes however far ahead and whatever has no room, and the values
 * of the CPU's at first. */
static void test_attack(void **state)
{
    (void) state;
    struct fixture f = make_points(1);
    f.scene.train = f.views;
    for (int k = 0; k < 4; k++) {
        struct sg_attack_params p = sg_attack_params_default();
        struct sg_attack_step one, found;
        sg_attack *a;
        p.engine = main_engine();
        p.iterations = 12, p.inner = 3, p.densification_interval = 8;
        p.spectral_weight = k == 1 ? 2 : 0;
        p.epsilon = k == 2 ? INFINITY : p.epsilon;
        if (k == 3) {
            make_anchor_proxy(&f);
            p.model = SG_ATTACK_SCAFFOLD;
            p.scaffold = scaffold_params().scaffold;
            p.scaffold.appearance = true;
        }
        p.update_interval = k == 2 ? 3 : 1;
        p.tv = k == 0 ? SG_ATTACK_TV_ANISO : k == 1 ? SG_ATTACK_TV_VERTICAL2 : SG_ATTACK_TV_ISO;
        struct flight alone = {.depth = 1}, more = {0}, tight = {.tight = 2, .until = 13};
        struct flight *others[] = {&more, &tight};
        struct sg_model *expected = raid(&f, &p, &alone, &one);
        for (int i = 0; i < 2; i++) {
            struct sg_model *decoy = raid(&f, &p, others[i], &found);
            assert_same_models(expected, decoy);
            assert_true(found.loss == one.loss && found.psnr == one.psnr && found.tv == one.tv);
            sg_model_destroy(&decoy);
        }
        assert_int_equal(more.in_flight, GPU_FLIGHTS);
        assert_true(tight.repeats > 1);
        sg_model_destroy(&expected);
        for (int i = 0; i < 2; i++) { /* the first step, by both engines */
            p.engine = i ? "cpu" : main_engine();
            assert_int_equal(sg_attack_create(f.ctx, &f.scene, f.start, &p, &a), SG_OK);
            assert_int_equal(sg_attack_step(a, i ? &found : &one), SG_OK);
            sg_attack_destroy(&a);
        }
        if (fabs(one.loss / found.loss - 1) > 1e-3 || fabs(one.tv / found.tv - 1) > 1e-3 ||
            !(found.tv > 0))
            fail_msg("case %d: loss %g, variation %g, expected %g and %g", k, one.loss, one.tv,
                     found.loss, found.tv);
    }
    clear_points(&f);
}

/* An attack of which the device holds every other photo. The variation of each step is its own,
 * whether it is waited for or arrives while a step of the other kind is the newest. */
static void test_attack_on_both(void **state)
{
    (void) state;
    enum { STEPS = 12 };
    struct fixture f = make_points(1);
    struct sg_attack_params p = sg_attack_params_default();
    struct sg_attack_step expected[STEPS], logged[STEPS];
    bool on_device[STEPS];
    int kinds[2] = {0};
    f.scene.train = f.views;
    p.engine = main_engine();
    p.iterations = STEPS, p.inner = 3;
    for (int waits = 1; waits >= 0; waits--) {
        sg_attack *a;
        assert_int_equal(sg_attack_create(f.ctx, &f.scene, f.start, &p, &a), SG_OK);
        for (size_t v = 0; v < f.scene.n_train; v += 2) {
            assert_int_equal(sg_engine_photo_drop(a->trainer->engine, a->trainer->photos[v]),
                             SG_OK);
            a->trainer->photos[v] = 0;
        }
        for (int k = 0; k < STEPS; k++) {
            assert_int_equal(
                (waits ? sg_attack_step : sg_attack_advance)(a, waits ? &expected[k] : &logged[k]),
                SG_OK);
            on_device[k] = a->on_device;
            kinds[on_device[k]]++;
            if (waits || !k)
                continue;
            bool known;
            assert_int_equal(
                sg_attack_arrived(a, sg_attack_view(a) - 1, true, &logged[k - 1], &known), SG_OK);
            assert_true(known);
            if (logged[k - 1].tv != expected[k - 1].tv)
                fail_msg("step %d: variation %g, expected %g", k, logged[k - 1].tv,
                         expected[k - 1].tv);
        }
        sg_attack_destroy(&a);
    }
    assert_true(kinds[0] > 4 && kinds[1] > 4);
    clear_points(&f);
}

/* What a view that is left before the optimiser has changed, or what comes after it. */
enum change { RADII, EXPOSURES, STATISTICS, NOISE, CHANGES };
struct changed {
    float radius[120], gradient[120], exposures[VIEWS * SG_EXPOSURE_FLOATS];
    float image[3 * SIDE * SIDE]; /* of the view, where the next call is not another one */
};

static void leave_view(struct fixture *f, enum change what, bool tight, struct changed *out)
{
    struct sg_train_params p = flow_params();
    p.exposure = true;
    sg_trainer *t = begin_training(f, &p);
    struct sg_engine *base = t->engine;
    struct vulkan_engine *e = vulkan_of(base);
    const struct sg_render_params render = sg_trainer_render(t);
    const struct sg_target target = {.photo = t->photos[0], .exposure = 1};
    const struct sg_loss loss = {SG_LOSS_PHOTOMETRIC, 1, {.photometric = {.lambda_dssim = 0.2f}}};
    const float *exposures;
    assert_int_equal(sg_engine_count(base), 120);
    e->lists.capacity = tight ? TINY : 100000;
    assert_int_equal(sg_engine_draw(base, &f->views[0].camera, 0, &render, false), SG_OK);
    assert_int_equal(sg_engine_losses(base, &target, &loss, 1), SG_OK);
    if (what == RADII) {
        assert_int_equal(sg_engine_count_radii(base), SG_OK);
    } else if (what == EXPOSURES) {
        const struct sg_exposure_update update = {.rate = 0.1, .root = 1};
        assert_int_equal(sg_engine_learn_exposures(base, &update), SG_OK);
    } else if (what == STATISTICS) {
        assert_int_equal(sg_engine_raster_backward(base), SG_OK);
        assert_int_equal(sg_engine_project_backward(base, true), SG_OK);
    } else {
        const struct sg_exploration noise = {.amount = 0.1f, .gate = 100, .dead = 0.005f};
        assert_int_equal(sg_engine_explore(base, &noise), SG_OK);
        assert_int_equal(sg_engine_read_image(base, out->image, NULL, NULL), SG_OK);
    }
    if (what != NOISE)
        assert_int_equal(sg_engine_draw(base, &f->views[1].camera, 0, &render, false), SG_OK);
    assert_int_equal(
        sg_engine_read_statistics(
            base, &(struct sg_statistics){.radius = out->radius, .gradient = out->gradient}),
        SG_OK);
    assert_int_equal(sg_trainer_exposures(t, &exposures), SG_OK);
    memcpy(out->exposures, exposures, sizeof(out->exposures));
    assert_true((e->flow.repeats > 0) == tight);
    sg_trainer_destroy(&t);
}

/* A view is drawn, has no room, and is left before the optimiser: what it has changed counts all
 * the same. After an exploration its image can still be read. */
static void test_left_view(void **state)
{
    (void) state;
    struct fixture f = make_fixture(1);
    for (enum change what = 0; what < CHANGES; what++) {
        struct changed expected = {0}, found = {0};
        float radius = 0, gradient = 0;
        leave_view(&f, what, false, &expected);
        leave_view(&f, what, true, &found);
        assert_memory_equal(&found, &expected, sizeof(found));
        for (size_t i = 0; i < f.start->count; i++) {
            radius = fmaxf(radius, found.radius[i]);
            gradient = fmaxf(gradient, found.gradient[i]);
        }
        assert_true((radius > 0) == (what == RADII) && (gradient > 0) == (what == STATISTICS));
        assert_true((found.exposures[0] != 1) == (what == EXPOSURES));
    }
    clear_fixture(&f);
}

/* Iterations that have no room, and for which there is no memory: nobody gets a model that lacks
 * them, also where there is memory again. */
static void test_no_memory(void **state)
{
    (void) state;
    const struct sg_train_params p = flow_params();
    struct fixture f = make_fixture(1);
    sg_trainer *t = begin_training(&f, &p);
    struct vulkan_engine *e = vulkan_of(t->engine);
    struct sg_vram *memory = sg_ctx_vram(f.ctx);
    struct sg_train_step s;
    struct sg_model *m = NULL;
    for (int it = 1; it <= 3; it++) {
        e->lists.capacity = it == 3 ? TINY : e->lists.capacity;
        assert_int_equal(sg_trainer_advance(t, NULL), SG_OK);
    }
    const uint64_t limit = memory->limit;
    memory->limit = 1;
    e->lists.emitted.bytes = 4 * TINY; /* it has been larger, which would do */
    assert_int_equal(sg_trainer_values(t, &s), SG_ERR_BUDGET);
    assert_true(e->flow.repeats > 0);
    memory->limit = limit;
    sg_clear_error(f.ctx);
    uint64_t most;
    bool known = true;
    assert_int_equal(sg_trainer_arrived(t, 3, false, &s, &most, &known), SG_OK);
    assert_false(known); /* what the device left of it is nothing */
    assert_int_equal(sg_trainer_model(t, &m), SG_ERR_BUDGET);
    assert_non_null(strstr(sg_last_error(f.ctx), "iterations are lost"));
    assert_int_equal(sg_trainer_save(t, "/dev/null"), SG_ERR_BUDGET);
    assert_int_equal(sg_trainer_advance(t, NULL), SG_ERR_BUDGET);
    assert_null(m);
    sg_trainer_destroy(&t);
    clear_fixture(&f);
}

/* A device that is lost with work in flight, at each submission of some. */
static void test_loss(void **state)
{
    (void) state;
    const struct sg_train_params p = flow_params();
    struct fixture f = make_fixture(1);
    for (uint64_t n = 1; n <= 12; n++) {
        sg_trainer *t = begin_training(&f, &p);
        int code = SG_OK;
        sg_fail_device(f.ctx, SG_DEVICE_SUBMISSION, n);
        for (int i = 0; i < 10 && !code; i++)
            code = sg_trainer_advance(t, NULL);
        assert_true(sg_fail_device(f.ctx, SG_DEVICE_SUBMISSION, 0));
        assert_int_equal(code, SG_ERR_INTERNAL);
        assert_non_null(strstr(sg_last_error(f.ctx), "the device is lost"));
        struct sg_train_step s;
        assert_int_equal(sg_trainer_values(t, &s), SG_ERR_INTERNAL);
        assert_int_equal(sg_trainer_advance(t, NULL), SG_ERR_INTERNAL);
        sg_trainer_destroy(&t);
        assert_int_equal(sg_vram_current(f.ctx, SG_MEM_TAGS), 0);
    }
    clear_fixture(&f);
}

/* ---- engines beside each other ---- */

static const struct vulkan_engine *opened(sg_ctx *ctx, struct sg_engine **e)
{
    assert_int_equal(sg_engine_create(ctx, main_engine(), NULL, e), SG_OK);
    return vulkan_of(*e);
}

/* Engines share a device, whatever their contexts; one that is lost is left to those that have it.
 */
static void test_shared(void **state)
{
    (void) state;
    sg_ctx *one = make_context(1), *two = make_context(1);
    struct sg_engine *a, *b, *c, *d;
    struct gpu_device *first = opened(one, &a)->gpu->shared;
    assert_ptr_equal(opened(two, &b)->gpu->shared, first);
    sg_gpu_lose_device(first);
    struct gpu_device *second = opened(one, &c)->gpu->shared;
    assert_ptr_not_equal(second, first);
    sg_engine_destroy(&a);
    sg_engine_destroy(&b);
    assert_ptr_equal(opened(two, &d)->gpu->shared, second);
    sg_engine_destroy(&c);
    sg_engine_destroy(&d);
    assert_int_equal(sg_vram_current(one, SG_MEM_TAGS) + sg_vram_current(two, SG_MEM_TAGS), 0);
    sg_ctx_destroy(&one);
    sg_ctx_destroy(&two);
}

struct painter {
    const char *engine;
    const struct fixture *f;
    float pixels[3 * SIDE * SIDE];
};

static void *paint(void *arg)
{
    struct painter *p = arg;
    for (int i = 0; i < 4; i++) {
        sg_ctx *ctx = make_context(1);
        sg_renderer *r;
        assert_int_equal(sg_renderer_create(ctx, p->engine, NULL, p->f->truth, NULL, &r), SG_OK);
        assert_int_equal(sg_render(r, &p->f->views[0].camera, p->pixels, NULL, NULL, NULL), SG_OK);
        sg_renderer_destroy(&r);
        sg_ctx_destroy(&ctx);
    }
    return NULL;
}

/* Contexts of several threads draw at once. */
static void test_threads(void **state)
{
    (void) state;
    struct fixture f = make_fixture(1);
    static struct painter painters[3];
    pthread_t threads[3];
    for (int i = 0; i < 3; i++) {
        painters[i] = (struct painter){.engine = main_engine(), .f = &f};
        assert_int_equal(pthread_create(&threads[i], NULL, paint, &painters[i]), 0);
    }
    for (int i = 0; i < 3; i++)
        pthread_join(threads[i], NULL);
    for (int i = 1; i < 3; i++)
        assert_memory_equal(painters[i].pixels, painters[0].pixels, sizeof(painters[0].pixels));
    clear_fixture(&f);
}

int main(void)
{
    if (!getenv("SG_TEST_ENGINE")) {
        printf("skipped: SG_TEST_ENGINE names no device\n");
        return 77;
    }
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_depths),         cmocka_unit_test(test_overflow),
        cmocka_unit_test(test_no_memory),      cmocka_unit_test(test_variants),
        cmocka_unit_test(test_passing),        cmocka_unit_test(test_attack),
        cmocka_unit_test(test_attack_on_both), cmocka_unit_test(test_anchors),
        cmocka_unit_test(test_left_view),      cmocka_unit_test(test_threads),
        cmocka_unit_test(test_shared),         cmocka_unit_test(test_loss),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
