/* SPDX-License-Identifier: Apache-2.0 */
/* Properties of the table of columns that every loop over it relies on. */
#include "model/columns.h"

#include "engine/host/host_model.h"
#include "models.h"

/* Parameters come first, without gaps, as enum sg_param and sg_param_count have them. */
static void test_parameters(void **state)
{
    (void) state;
    for (int degree = 0; degree <= 3; degree++) {
        const int planes = sg_param_count(degree);
        int next = 0, c = 0;
        for (; c < SG_COLUMNS && sg_column_is_parameter(c); c++) {
            assert_int_equal(sg_columns[c].first, next);
            next += sg_column_planes(c, degree);
            assert_int_equal(sg_column_end(c, planes), next);
            assert_int_equal(sg_column_array_planes(c, degree), planes);
            assert_int_equal(sg_column_has_array(c), c == SG_C_PARAMETERS);
            assert_true(sg_columns[c].group < SG_GROUPS);
        }
        assert_int_equal(next, planes);
        for (; c < SG_COLUMNS; c++) {
            assert_false(sg_column_is_parameter(c));
            assert_true(sg_column_has_array(c));
            assert_int_equal(sg_columns[c].first, 0);
            assert_int_equal(sg_column_array_planes(c, degree), sg_column_planes(c, degree));
        }
    }
    assert_int_equal(sg_columns[SG_C_OPACITY].first, SG_P_OPACITY);
    assert_int_equal(sg_columns[SG_C_SCALE].first, SG_P_SCALE);
    assert_int_equal(sg_columns[SG_C_ROTATION].first, SG_P_ROT);
    assert_int_equal(sg_columns[SG_C_SH_DC].first, SG_P_SH);
}

static void test_rows(void **state)
{
    (void) state;
    bool place[SG_COLUMNS + 1] = {true};
    int exported = 0;
    for (int c = 0; c < SG_COLUMNS; c++) {
        const struct sg_column *column = &sg_columns[c];
        assert_in_range(strlen(column->name), 1, 23); /* a section's title with its NUL */
        for (int other = 0; other < c; other++)
            assert_string_not_equal(column->name, sg_columns[other].name);
        /* Only parameters are drawn or shrunk, and only they and anchors' values set by rows; an
         * inserted row is no copy. */
        for (int kind = 0; kind < SG_EDIT_KINDS; kind++)
            assert_true(column->fate[kind] < SG_FATE_DRAW || sg_column_is_parameter(c));
        assert_true(column->fate[SG_EDIT_INSERT] ==
                    (sg_column_is_parameter(c) || c == SG_C_ANCHOR || c == SG_C_BORN
                         ? SG_FATE_ROW
                         : SG_FATE_ZERO));
        assert_true(column->fate[SG_EDIT_CHILD] != SG_FATE_ROW);
        assert_true(!(column->bits & SG_COLUMN_SAVED) != !(column->bits & SG_COLUMN_LOST));
        /* Parameters are in a PLY file, at places 1, 2, ..., and other columns may be. */
        assert_true(column->place > 0 || !sg_column_is_parameter(c));
        assert_int_equal(column->place > 0, column->property != NULL);
        assert_in_range(column->place, 0, SG_COLUMNS);
        assert_false(column->place && place[column->place]);
        place[column->place] = true;
        exported += column->place > 0;
    }
    for (int k = 1; k <= exported; k++)
        assert_true(place[k]);
}

/* Arrays of the columns that are asked for, zeroed, with whole blocks. */
static void test_create(void **state)
{
    (void) state;
    sg_ctx *ctx = make_context(1);
    struct sg_columns o;
    assert_int_equal(sg_columns_create(ctx, 17, 1, SG_COLUMN_SAVED, &o), SG_OK);
    assert_int_equal(o.capacity, 32);
    for (int c = 0; c < SG_COLUMNS; c++) {
        const bool expected = !sg_column_is_parameter(c) && sg_column_of(c, SG_COLUMN_SAVED);
        assert_int_equal(o.at[c] != NULL, expected);
        for (size_t i = 0; expected && i < 32 * (size_t) sg_column_planes(c, 1); i++)
            assert_true(o.at[c][i] == 0);
    }
    sg_columns_clear(&o);
    assert_int_equal(sg_mem_current(ctx, SG_MEM_TAGS), 0);
    sg_ctx_destroy(&ctx);
}

/* The plan counts each column that a run has in host memory. */
static void test_footprint(void **state)
{
    (void) state;
    static const struct {
        struct sg_work work;
        unsigned bits;
    } cases[] = {
        {{.sh_degree = 2}, SG_COLUMN_SAVED},
        {{.sh_degree = 3, .radii = true}, SG_COLUMN_SAVED | SG_COLUMN_RADII},
        {{.anchors = true}, SG_COLUMN_SAVED | SG_COLUMN_ANCHORS},
        {{.anchors = true, .grace = true}, SG_COLUMN_SAVED | SG_COLUMN_ANCHORS | SG_COLUMN_GRACE},
    };
    for (size_t k = 0; k < sizeof(cases) / sizeof(cases[0]); k++) {
        uint64_t sum = 0, largest = 0;
        for (int c = 0; c < SG_COLUMNS; c++)
            if (sg_column_of(c, cases[k].bits) && sg_column_has_array(c)) {
                const uint64_t bytes =
                    (uint64_t) sg_column_array_planes(c, cases[k].work.sh_degree) * sizeof(float);
                sum += bytes;
                largest = bytes > largest ? bytes : largest;
            }
        assert_true(sg_host_footprint(&cases[k].work, false) >= sum + largest);
        assert_true(sg_host_footprint(&cases[k].work, false) < sum + largest + 16);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_parameters),
        cmocka_unit_test(test_rows),
        cmocka_unit_test(test_create),
        cmocka_unit_test(test_footprint),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
