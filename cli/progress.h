/* SPDX-License-Identifier: Apache-2.0 */
/* One line that rewrites itself on a terminal, plain lines elsewhere. */
#ifndef CLI_PROGRESS_H
#define CLI_PROGRESS_H

#include "splatguard/splatguard.h"

struct progress {
    bool quiet, terminal;
    int first, iterations, line_every;
    double start, shown; /* seconds */
    double loss, psnr;   /* exponential means */
    bool any;
};

void progress_begin(struct progress *p, bool quiet, int done, int iterations);
void progress_step(struct progress *p, const struct sg_train_step *step);
/* Leaves the terminal's line, so that other output starts on its own. */
void progress_break(struct progress *p);

#endif
