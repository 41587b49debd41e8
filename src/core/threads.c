/* SPDX-License-Identifier: Apache-2.0 */
#include "threads.h"

#include <pthread.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stdlib.h>
#include <unistd.h>

struct worker {
    sg_pool *pool;
    int index;
    pthread_t thread;
};

struct sg_pool {
    int threads;   /* the calling thread is number 0 */
    pid_t process; /* that has them: a forked one has a copy of the pool without its threads */
    struct worker *workers;
    pthread_mutex_t lock;
    pthread_cond_t start, done;
    atomic_ulong generation; /* of the job; written under lock, as are the next four */
    atomic_bool quit;
    void (*fn)(void *, size_t, int);
    void *arg;
    size_t n;
    atomic_size_t next;
    atomic_int running;
};

/* An iteration has about twenty jobs in quick succession, and sleeping and waking costs as much as
 * a small job. So a worker spins for some ten microseconds before it sleeps: a pause is 140 cycles
 * on most x86-64. Longer would take the core from others where there are more threads than cores.
 */
#define LOOKS 200

static void pause_core(void)
{
#if defined(__x86_64__)
    __builtin_ia32_pause();
#elif defined(__aarch64__)
    __asm__ volatile("isb");
#endif
}

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
    for (unsigned long seen = 0;; seen++) {
        for (int i = 0;
             i < LOOKS && atomic_load(&pool->generation) == seen && !atomic_load(&pool->quit); i++)
            pause_core();
        pthread_mutex_lock(&pool->lock);
        while (atomic_load(&pool->generation) == seen && !atomic_load(&pool->quit))
            pthread_cond_wait(&pool->start, &pool->lock);
        pthread_mutex_unlock(&pool->lock);
        if (atomic_load(&pool->quit))
            return NULL;
        work(pool, w->index);
        if (atomic_fetch_sub(&pool->running, 1) ==
            1) { /* under the lock, or the waiter could miss it */
            pthread_mutex_lock(&pool->lock);
            pthread_cond_signal(&pool->done);
            pthread_mutex_unlock(&pool->lock);
        }
    }
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
    pool->process = getpid();
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
    if (pool->process == getpid()) {
        pthread_mutex_lock(&pool->lock);
        atomic_store(&pool->quit, true);
        pthread_cond_broadcast(&pool->start);
        pthread_mutex_unlock(&pool->lock);
        for (int i = 1; i < pool->threads; i++)
            pthread_join(pool->workers[i].thread, NULL);
        pthread_cond_destroy(&pool->done);
        pthread_cond_destroy(&pool->start);
        pthread_mutex_destroy(&pool->lock);
    }
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
    if (pool->threads == 1 || n < 2 || pool->process != getpid()) {
        for (size_t i = 0; i < n; i++)
            fn(arg, i, 0);
        return;
    }
    pthread_mutex_lock(&pool->lock);
    pool->fn = fn;
    pool->arg = arg;
    pool->n = n;
    atomic_store_explicit(&pool->next, 0, memory_order_relaxed);
    atomic_store(&pool->running, pool->threads - 1);
    atomic_fetch_add(&pool->generation, 1);
    pthread_cond_broadcast(&pool->start);
    pthread_mutex_unlock(&pool->lock);
    work(pool, 0);
    for (int i = 0; i < LOOKS && atomic_load(&pool->running); i++)
        pause_core();
    if (!atomic_load(&pool->running))
        return;
    pthread_mutex_lock(&pool->lock);
    while (atomic_load(&pool->running))
        pthread_cond_wait(&pool->done, &pool->lock);
    pthread_mutex_unlock(&pool->lock);
}
