/* SPDX-License-Identifier: Apache-2.0 */
/* The live view of a training: what it says and shows, and the buttons of its page. */
#ifndef CLI_TRAIN_VIEW_H
#define CLI_TRAIN_VIEW_H

#include "progress.h"

struct train_view;

/* Opens the page and prints its address. Returns an exit code. */
int train_view_open(int port, struct train_view **out);

/* From here on it shows the run, which must outlive it. ctx, params: the run's. */
int train_view_begin(struct train_view *v, sg_ctx *ctx, sg_run *run,
                     const struct sg_run_params *params);

/* After each iteration. Waits while the page says so, which the progress does not count. Returns
 * whether the page wants the training to stop. */
bool train_view_step(struct train_view *v, struct progress *progress,
                     const struct sg_train_step *step);

/* NULL-safe; sets *v to NULL. */
void train_view_close(struct train_view **v);

#endif
