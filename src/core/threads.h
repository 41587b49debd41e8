/* SPDX-License-Identifier: Apache-2.0 */
/* A pool of worker threads. Not OpenMP, because each context has its own number of threads, and
 * because ThreadSanitizer can check this code. */
#ifndef SG_CORE_THREADS_H
#define SG_CORE_THREADS_H

#include <stddef.h>

typedef struct sg_pool sg_pool;

int sg_pool_create(sg_pool **out, int threads); /* 0, or -1 if the system refuses */
void sg_pool_destroy(sg_pool **pool);
int sg_pool_threads(const sg_pool *pool);
void sg_pool_run(sg_pool *pool, size_t n, void (*fn)(void *arg, size_t i, int thread), void *arg);

#endif
