// The machine that the figures were measured on.
// SPDX-License-Identifier: MIT
#ifndef BENCH_MACHINE_H
#define BENCH_MACHINE_H

#include <stdint.h>

struct machine {
    char cpu[128], system[256], memory_gib[16];
    int cores;
};
void machine_describe(struct machine *machine);

// Clocks in milliseconds: CPU of the calling thread, CPU of the whole process, monotonic wall clock.
double clock_thread_ms(void);
double clock_process_ms(void);
double clock_wall_ms(void);

#endif
