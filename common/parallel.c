// SPDX-License-Identifier: MIT
#define _GNU_SOURCE
#include "common/parallel.h"

#include <pthread.h>
#include <sched.h>
#include <stdatomic.h>

enum { MAX_THREADS = 64 };

struct job {
    atomic_int next;
    int count;
    void (*work)(int block, void *user);
    void *user;
};

static void *run_blocks(void *argument)
{
    struct job *job = argument;
    for (int block; (block = atomic_fetch_add(&job->next, 1)) < job->count;) job->work(block, job->user);
    return NULL;
}

int parallel_processors(void)
{
    cpu_set_t set;
    if (sched_getaffinity(0, sizeof set, &set) != 0) return 1;
    int count = CPU_COUNT(&set);
    return count < 1 ? 1 : count > MAX_THREADS ? MAX_THREADS : count;
}

void parallel_blocks(int count, int threads, void (*work)(int block, void *user), void *user)
{
    struct job job = {.next = 0, .count = count, .work = work, .user = user};
    if (threads <= 0) threads = parallel_processors();
    if (threads > MAX_THREADS) threads = MAX_THREADS;
    if (threads > count) threads = count;
    pthread_t helpers[MAX_THREADS];
    int started = 0;
    for (; started < threads - 1; started++)
        if (pthread_create(&helpers[started], NULL, run_blocks, &job) != 0)
            break; // fewer threads, same result
    run_blocks(&job);
    for (int i = 0; i < started; i++) pthread_join(helpers[i], NULL);
}
