/* SPDX-License-Identifier: Apache-2.0 */
/* Attacks whose decoy is Scaffold-GS. */
#include <unistd.h>

#include "splatguard/attack.h"

#include "races.h"
#include "training_anchors.h"

/* A scene and a proxy of it. */
struct target {
    struct fixture f;
    struct sg_model *proxy;
};

static void make_target(struct target *a, int threads, bool appearance)
{
    struct sg_train_params p = scaffold_params();
    sg_trainer *t;
    a->f = make_points(threads);
    a->f.scene.train = a->f.views;
    p.iterations = 60;
    p.scaffold.appearance = appearance;
    assert_int_equal(sg_trainer_create(a->f.ctx, &a->f.scene, NULL, &p, &t), SG_OK);
    while (sg_trainer_iteration(t) < p.iterations)
        assert_int_equal(sg_trainer_step(t, NULL), SG_OK);
    assert_int_equal(sg_trainer_model(t, &a->proxy), SG_OK);
    sg_trainer_destroy(&t);
}

static void clear_target(struct target *a)
{
    sg_model_destroy(&a->proxy);
    clear_points(&a->f);
}

/* The decoy grows at 10, 20, ... */
static struct sg_attack_params attack_params(void)
{
    struct sg_attack_params p = {SG_ATTACK_DEFAULTS, .iterations = 100};
    p.model = SG_ATTACK_SCAFFOLD;
    p.scaffold = scaffold_params().scaffold;
    p.densification_interval = 10;
    p.densify_grad_threshold = 1e-6f;
    return p;
}

static sg_attack *begin(struct target *a, const struct sg_attack_params *p)
{
    sg_attack *attack;
    if (sg_attack_create(a->f.ctx, &a->f.scene, a->proxy, p, &attack))
        fail_msg("%s", sg_last_error(a->f.ctx));
    return attack;
}

static size_t advance(struct target *a, sg_attack *attack, int steps, size_t limit)
{
    struct sg_attack_step s = {0};
    for (int i = 0; i < steps; i++) {
        if (sg_attack_step(attack, &s))
            fail_msg("%s", sg_last_error(a->f.ctx));
        assert_true(isfinite(s.loss) && s.gaussians <= limit);
        assert_int_equal(s.gaussians % SG_ANCHOR_GAUSSIANS, 0);
    }
    return s.gaussians;
}

/* The decoy grows, and poisons within the bound vary more than the photos. */
static void test_grows(void **state)
{
    (void) state;
    skip_without_races();
    struct target a;
    make_target(&a, 2, false);
    const struct sg_attack_params p = attack_params();
    const size_t before = a.proxy->count * SG_ANCHOR_GAUSSIANS;
    const struct sg_weights none = {0};
    assert_memory_equal(&a.proxy->columns->networks->moment1, &none, sizeof(none));
    sg_attack *attack = begin(&a, &p);
    assert_int_equal(advance(&a, attack, 9, SIZE_MAX), before);
    const size_t after = advance(&a, attack, 91, SIZE_MAX);
    if (!(after > before * 5 / 4))
        fail_msg("%zu Gaussians from %zu", after, before);
    for (size_t v = 0; v < VIEWS; v++) {
        uint8_t poison[3 * SIDE * SIDE];
        const uint8_t *photo = a.f.views[v].rgb;
        int most = 0;
        assert_int_equal(sg_attack_poison(attack, v, poison), SG_OK);
        for (int i = 0; i < 3 * SIDE * SIDE; i++)
            most = abs(poison[i] - photo[i]) > most ? abs(poison[i] - photo[i]) : most;
        assert_in_range(most, 12, 16);
        assert_true(sg_total_variation(poison, SIDE, SIDE, p.tv) >
                    1.1 * sg_total_variation(photo, SIDE, SIDE, p.tv));
    }
    sg_attack_destroy(&attack);
    clear_target(&a);
}

/* The same bytes for any number of threads, and saved and restored, also with appearances. */
static void test_resume(void **state)
{
    (void) state;
    char path[] = "/tmp/sg-attack-XXXXXX";
    close(mkstemp(path));
    for (int appearance = 0; appearance < 2; appearance++) {
        struct target a, b;
        make_target(&a, 1, appearance);
        make_target(&b, 3, appearance);
        struct sg_attack_params p = attack_params();
        p.scaffold.appearance = appearance;
        sg_attack *whole = begin(&a, &p), *first = begin(&b, &p), *second;
        struct sg_model *decoy[2];
        advance(&a, whole, 40, SIZE_MAX);
        advance(&b, first, 25, SIZE_MAX);
        assert_int_equal(sg_attack_save(first, path), SG_OK);
        assert_int_equal(sg_attack_resume(b.f.ctx, &b.f.scene, path, &p, &second), SG_OK);
        assert_int_equal(sg_attack_iteration(second), 25);
        advance(&b, second, 15, SIZE_MAX);
        assert_int_equal(sg_attack_decoy(whole, &decoy[0]), SG_OK);
        assert_int_equal(sg_attack_decoy(second, &decoy[1]), SG_OK);
        assert_same_anchors(decoy[0], decoy[1]);
        for (size_t v = 0; v < VIEWS; v++) {
            uint8_t poison[2][3 * SIDE * SIDE];
            assert_int_equal(sg_attack_poison(whole, v, poison[0]), SG_OK);
            assert_int_equal(sg_attack_poison(second, v, poison[1]), SG_OK);
            assert_memory_equal(poison[0], poison[1], sizeof(poison[0]));
        }
        struct sg_attack_params other = p;
        sg_attack *none;
        other.scaffold.feature_lr = 0.5f;
        assert_int_equal(sg_attack_resume(b.f.ctx, &b.f.scene, path, &other, &none), SG_ERR_INPUT);
        assert_non_null(strstr(sg_last_error(b.f.ctx), "other parameters"));
        other = p, other.model = SG_ATTACK_3DGS;
        assert_int_equal(sg_attack_resume(b.f.ctx, &b.f.scene, path, &other, &none), SG_ERR_INPUT);
        for (int i = 0; i < 2; i++)
            sg_model_destroy(&decoy[i]);
        sg_attack_destroy(&whole);
        sg_attack_destroy(&first);
        sg_attack_destroy(&second);
        clear_target(&a);
        clear_target(&b);
    }
    unlink(path);
}

/* The decoy reaches its limit and does not exceed it. One that is larger is thinned out. */
static void test_limit(void **state)
{
    (void) state;
    struct target a;
    make_target(&a, 2, false);
    struct sg_attack_params p = attack_params();
    const size_t whole = a.proxy->count * SG_ANCHOR_GAUSSIANS;
    const size_t limits[] = {whole + 3 * SG_ANCHOR_GAUSSIANS, whole / 2};
    for (int i = 0; i < 2; i++) {
        const size_t most = limits[i] / SG_ANCHOR_GAUSSIANS * SG_ANCHOR_GAUSSIANS;
        p.max_gaussians = limits[i];
        sg_attack *attack = begin(&a, &p);
        assert_int_equal(advance(&a, attack, 40, most), most);
        sg_attack_destroy(&attack);
    }
    clear_target(&a);
}

static void refuse(struct target *a, const struct sg_model *proxy, const struct sg_attack_params *p,
                   int code, const char *text)
{
    sg_attack *attack = (void *) a;
    assert_int_equal(sg_attack_create(a->f.ctx, &a->f.scene, proxy, p, &attack), code);
    assert_null(attack);
    if (!strstr(sg_last_error(a->f.ctx), text))
        fail_msg("%s, expected %s", sg_last_error(a->f.ctx), text);
}

static void test_refusals(void **state)
{
    (void) state;
    skip_without_races();
    struct target a, looks;
    make_target(&a, 1, false);
    const struct sg_attack_params good = attack_params();
    struct sg_attack_params p = good;
    p.move_positions = true;
    refuse(&a, a.proxy, &p, SG_ERR_USAGE, "move_positions: found");
    p = good, p.scale_floor = 0.1f;
    refuse(&a, a.proxy, &p, SG_ERR_USAGE, "scale_floor: found 0.1");
    p = good, p.update_interval = 2;
    refuse(&a, a.proxy, &p, SG_ERR_USAGE, "update_interval: found 2");
    p = good, p.max_gaussians = 30;
    refuse(&a, a.proxy, &p, SG_ERR_USAGE, "max_gaussians: found 30");
    p = good, p.scaffold.cells = 0;
    refuse(&a, a.proxy, &p, SG_ERR_USAGE, "scaffold.cells: found 0");
    p = good, p.scaffold.bank = p.scaffold.distance = true;
    refuse(&a, a.proxy, &p, SG_ERR_INPUT,
           "networks with no optional part, expected distances and the feature bank");
    p = good, p.model = SG_ATTACK_3DGS;
    refuse(&a, a.proxy, &p, SG_ERR_INPUT, "found anchors of Scaffold-GS");
    refuse(&a, a.f.truth, &good, SG_ERR_INPUT, "expected anchors of Scaffold-GS");
    make_target(&looks, 1, true);
    p = good, p.scaffold.appearance = true;
    looks.f.scene.n_train--;
    refuse(&looks, looks.proxy, &p, SG_ERR_INPUT, "the appearances of 6 photos, expected those of");
    clear_target(&looks);
    clear_target(&a);
    p = good, p.epsilon = INFINITY;
    assert_true(sg_attack_preset("ns", SG_FORMAT_BLENDER, &p));
    assert_int_equal(p.update_interval, 1);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_grows),
        cmocka_unit_test(test_resume),
        cmocka_unit_test(test_limit),
        cmocka_unit_test(test_refusals),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
