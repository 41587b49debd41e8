/* SPDX-License-Identifier: Apache-2.0 */
/* A column that only the test has: two values of each Gaussian, in an array of their own and in PLY
 * files. Included before everything else. */
#ifndef TESTS_TOY_COLUMN_H
#define TESTS_TOY_COLUMN_H

#define SG_COLUMNS_MORE(C)                                                                         \
    C(TOY, .name = "toy", .planes = 2, .bits = SG_COLUMN_SAVED,                                    \
      .fate = {[SG_EDIT_COPY] = SG_FATE_COPY, [SG_EDIT_KEEP] = SG_FATE_COPY}, .place = 8,          \
      .property = "toy_")

#endif
