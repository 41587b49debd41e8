/* SPDX-License-Identifier: Apache-2.0 */
#include "threads.h"

#include <pthread.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stdlib.h>

struct worker {
    sg_pool *pool;
    int index;
    pthread_t thread;
};

struct sg_pool {
    int threads; /* the calling thread is number 0 */
    struct worker *workers;
    pthread_mutex_t lock;
    pthread_cond_t start, done;
    unsigned long generation; /* of the job; all below guarded by lock */
    int running;
    bool quit;
    void (*fn)(void *, size_t, int);
    void *arg;
    size_t n;
    atomic_size_t next;
};

static void work(sg_pool *pool, int index)
{
    for (;;) {
        size_t i = atomic_fetch_add_explicit(&pool->next, 1, memory_order_relaxed);
        if (i >= pool->n)
            return;
        pool->fn(pool->arg, i, index);
    }
}

static void *worker_main(void *arg)
{
    struct worker *w = arg;
    sg_pool *pool = w->pool;
    unsigned long seen = 0;
    pthread_mutex_lock(&pool->lock);
    for (;;) {
        while (pool->generation == seen && !pool->quit)
            pthread_cond_wait(&pool->start, &pool->lock);
        if (pool->quit)
            break;
        seen = pool->generation;
        pthread_mutex_unlock(&pool->lock);
        work(pool, w->index);
        pthread_mutex_lock(&pool->lock);
        if (--pool->running == 0)
            pthread_cond_signal(&pool->done);
    }
    pthread_mutex_unlock(&pool->lock);
    return NULL;
}

int sg_pool_create(sg_pool **out, int threads)
{
    sg_pool *pool = calloc(1, sizeof(*pool));
    if (!pool)
        return -1;
    pthread_mutex_init(&pool->lock, NULL);
    pthread_cond_init(&pool->start, NULL);
    pthread_cond_init(&pool->done, NULL);
    pool->threads = 1;
    pool->workers = calloc((size_t) threads, sizeof(*pool->workers));
    if (!pool->workers)
        goto fail;
    for (int i = 1; i < threads; i++) {
        pool->workers[i] = (struct worker){.pool = pool, .index = i};
        if (pthread_create(&pool->workers[i].thread, NULL, worker_main, &pool->workers[i]))
            goto fail;
        pool->threads++;
    }
    *out = pool;
    return 0;
fail:
    sg_pool_destroy(&pool);
    return -1;
}

void sg_pool_destroy(sg_pool **p)
{
    sg_pool *pool = *p;
    if (!pool)
        return;
    pthread_mutex_lock(&pool->lock);
    pool->quit = true;
    pthread_cond_broadcast(&pool->start);
    pthread_mutex_unlock(&pool->lock);
    for (int i = 1; i < pool->threads; i++)
        pthread_join(pool->workers[i].thread, NULL);
    pthread_cond_destroy(&pool->done);
    pthread_cond_destroy(&pool->start);
    pthread_mutex_destroy(&pool->lock);
    free(pool->workers);
    free(pool);
    *p = NULL;
}

int sg_pool_threads(const sg_pool *pool)
{
    return pool->threads;
}

void sg_pool_run(sg_pool *pool, size_t n, void (*fn)(void *, size_t, int), void *arg)
{
    if (pool->threads == 1 || n < 2) {
        for (size_t i = 0; i < n; i++)
            fn(arg, i, 0);
        return;
    }
    pthread_mutex_lock(&pool->lock);
    pool->fn = fn;
    pool->arg = arg;
    pool->n = n;
    atomic_store_explicit(&pool->next, 0, memory_order_relaxed);
    pool->running = pool->threads - 1;
    pool->generation++;
    pthread_cond_broadcast(&pool->start);
    pthread_mutex_unlock(&pool->lock);
    work(pool, 0);
    pthread_mutex_lock(&pool->lock);
    while (pool->running)
        pthread_cond_wait(&pool->done, &pool->lock);
    pthread_mutex_unlock(&pool->lock);
}
