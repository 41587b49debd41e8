/* SPDX-License-Identifier: Apache-2.0 */
/* A strategy of its own, beside the default: it inserts Gaussians on a schedule, remembers what it
 * did, and rests when it says so. */
#include <unistd.h>

#include "train/trainer.h"
#include "training.h"

struct state {
    uint64_t begun, inserted;
};

static bool sound(const void *state, int iteration)
{
    const struct state *s = state;
    return s->begun == 1 && s->inserted <= (uint64_t) iteration;
}

static int begin(sg_trainer *t)
{
    ((struct state *) t->strategy_state)->begun++;
    return sg_engine_floor_scale(t->engine, 0.02f);
}

static struct sg_strategy_plan plan(const sg_trainer *t, int before, int it)
{
    (void) t, (void) before;
    return (struct sg_strategy_plan){.rests = it == 2, .rests_opacity = it == 4};
}

/* Every third iteration one more, where the newest state puts it. */
static int after_step(sg_trainer *t, const struct sg_strategy_plan *planned, int before, int it,
                      const struct sg_render_params *render, struct sg_train_step *out)
{
    (void) before, (void) render;
    struct state *s = t->strategy_state;
    assert_true(planned->rests == (it == 2) && planned->rests_opacity == (it == 4));
    if (it % 3)
        return SG_OK;
    const size_t n = sg_engine_count(t->engine);
    struct sg_model *row;
    uint8_t *keep = malloc(n);
    const uint32_t source = 0;
    const uint8_t kind = SG_EDIT_INSERT;
    memset(keep, 1, n);
    int code = sg_model_create(t->ctx, 1, t->sh_degree, &row);
    if (!code) {
        *sg_model_at(row, 0, SG_P_XYZ) = 0.1f * (float) ++s->inserted;
        *sg_model_at(row, 0, SG_P_SCALE) = *sg_model_at(row, 0, SG_P_SCALE + 1) = -3;
        *sg_model_at(row, 0, SG_P_ROT) = 1;
        code = sg_engine_edit(t->engine, &(struct sg_edit){.keep = keep,
                                                           .kept = n,
                                                           .appended = 1,
                                                           .source = &source,
                                                           .kind = &kind,
                                                           .rows = row,
                                                           .statistics = true});
        out->cloned = 1;
    }
    sg_model_destroy(&row);
    free(keep);
    return code;
}

static const struct sg_strategy inserting = {.name = "inserting",
                                             .state_bytes = sizeof(struct state),
                                             .sound = sound,
                                             .begin = begin,
                                             .plan = plan,
                                             .after_step = after_step};
/* Nothing to remember, nothing to begin with. */
static const struct sg_strategy forgetful = {
    .name = "forgetful", .plan = plan, .after_step = after_step};

static sg_trainer *open_with(struct fixture *f, const struct sg_strategy *strategy,
                             const char *checkpoint, int expected)
{
    const struct sg_trainer_start start = {
        .initial = checkpoint ? NULL : f->start, .checkpoint = checkpoint, .strategy = strategy};
    const struct sg_train_params p = short_params();
    sg_trainer *t;
    f->scene.train = f->views;
    assert_int_equal(sg_trainer_open(f->ctx, &f->scene, &start, &p, &t), expected);
    return t;
}

static struct sg_model *model_of(sg_trainer *t)
{
    struct sg_model *m;
    assert_int_equal(sg_trainer_model(t, &m), SG_OK);
    return m;
}

/* The trainer does what the strategy says, and no growth of the default's. */
static void test_called(void **state)
{
    (void) state;
    struct fixture f = make_fixture(2);
    sg_trainer *t = open_with(&f, &inserting, NULL, SG_OK);
    const struct state *s = t->strategy_state;
    assert_int_equal(s->begun, 1);
    struct sg_model *before = model_of(t);
    for (size_t i = 0; i < before->count; i++)
        for (int k = 0; k < 3; k++)
            assert_true(*sg_model_at(before, i, SG_P_SCALE + k) >= logf(0.02f));
    for (int it = 1; it <= 12; it++) {
        struct sg_train_step step;
        assert_int_equal(sg_trainer_step(t, &step), SG_OK);
        assert_int_equal(step.cloned, it % 3 == 0);
        assert_int_equal(step.gaussians, f.start->count + (size_t) it / 3);
        struct sg_model *after = model_of(t);
        const size_t values = before->count;
        size_t moved = 0, opacities = 0;
        for (size_t i = 0; i < values; i++) {
            moved += *sg_model_at(after, i, SG_P_XYZ) != *sg_model_at(before, i, SG_P_XYZ);
            opacities +=
                *sg_model_at(after, i, SG_P_OPACITY) != *sg_model_at(before, i, SG_P_OPACITY);
        }
        assert_int_equal(moved > 0, it != 2);
        assert_int_equal(opacities > 0, it != 2 && it != 4);
        if (it % 3 == 0) /* the new one comes last and as it was given */
            assert_true(*sg_model_at(after, after->count - 1, SG_P_XYZ) == 0.1f * (float) (it / 3));
        sg_model_destroy(&before);
        before = after;
    }
    assert_int_equal(s->inserted, 4);
    sg_model_destroy(&before);
    sg_trainer_destroy(&t);
    clear_fixture(&f);
}

/* What it remembers goes through a checkpoint, which no other strategy takes. */
static void test_checkpoint(void **state)
{
    (void) state;
    struct fixture f = make_fixture(1);
    char path[] = "/tmp/sg_strategy_XXXXXX";
    close(mkstemp(path));
    sg_trainer *t = open_with(&f, &inserting, NULL, SG_OK);
    for (int it = 1; it <= 10; it++) {
        if (it == 8)
            assert_int_equal(sg_trainer_save(t, path), SG_OK);
        assert_int_equal(sg_trainer_step(t, NULL), SG_OK);
    }
    struct sg_model *expected = model_of(t);
    sg_trainer_destroy(&t);

    t = open_with(&f, &inserting, path, SG_OK);
    assert_int_equal(((struct state *) t->strategy_state)->begun, 1);
    assert_int_equal(((struct state *) t->strategy_state)->inserted, 2);
    for (int it = 8; it <= 10; it++)
        assert_int_equal(sg_trainer_step(t, NULL), SG_OK);
    struct sg_model *found = model_of(t);
    assert_same(found, expected);
    sg_trainer_destroy(&t);

    const struct sg_strategy *others[] = {NULL, &forgetful};
    for (int k = 0; k < 2; k++) {
        assert_null(open_with(&f, others[k], path, SG_ERR_INPUT));
        assert_non_null(strstr(sg_last_error(f.ctx), "strategy:inserting"));
        t = open_with(&f, others[k], NULL, SG_OK);
        assert_int_equal(sg_trainer_step(t, NULL), SG_OK);
        char other[] = "/tmp/sg_strategy_XXXXXX";
        close(mkstemp(other));
        assert_int_equal(sg_trainer_save(t, other), SG_OK);
        sg_trainer_destroy(&t);
        assert_null(open_with(&f, &inserting, other, SG_ERR_INPUT));
        assert_non_null(strstr(sg_last_error(f.ctx), other));
        t = open_with(&f, others[k], other, SG_OK);
        sg_trainer_destroy(&t);
        unlink(other);
    }
    unlink(path);
    sg_model_destroy(&expected);
    sg_model_destroy(&found);
    clear_fixture(&f);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_called),
        cmocka_unit_test(test_checkpoint),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
