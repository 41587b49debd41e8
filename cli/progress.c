/* SPDX-License-Identifier: Apache-2.0 */
#include "progress.h"

#include <stdio.h>
#include <unistd.h>

#include "commands.h"

void progress_begin(struct progress *p, bool quiet, int done, int iterations)
{
    *p = (struct progress){
        .quiet = quiet, .terminal = isatty(STDERR_FILENO), .first = done, .iterations = iterations};
    p->start = p->shown = clock_seconds();
    p->line_every = iterations >= 5000 ? 500 : iterations >= 20 ? iterations / 10 : 1;
}

void progress_step(struct progress *p, const struct sg_train_step *s)
{
    const double keep = p->any ? 0.98 : 0;
    p->loss = keep * p->loss + (1 - keep) * s->loss;
    p->psnr = keep * p->psnr + (1 - keep) * s->psnr;
    p->any = true;
    const double now = clock_seconds();
    const bool last = s->iteration == p->iterations;
    if (p->quiet || s->iteration <= p->first ||
        !(last || (p->terminal ? now - p->shown > 0.1 : s->iteration % p->line_every == 0)))
        return;
    p->shown = now;
    const double rate = (s->iteration - p->first) / (now > p->start ? now - p->start : 1e-9);
    const double left = (p->iterations - s->iteration) / rate;
    const int eta = left < 3.6e6 ? (int) (left + 0.5) : 3600000;
    fprintf(stderr, "%s%d/%d %.1f it/s, ETA %d:%02d:%02d, %zu Gaussians, loss %.4f, PSNR %.2f%s",
            p->terminal ? "\r" : "", s->iteration, p->iterations, rate, eta / 3600, eta / 60 % 60,
            eta % 60, s->gaussians, p->loss, p->psnr, p->terminal ? "\033[K" : "\n");
    if (last)
        progress_break(p);
    fflush(stderr);
}

void progress_break(struct progress *p)
{
    if (p->terminal && !p->quiet)
        fputc('\n', stderr);
}
