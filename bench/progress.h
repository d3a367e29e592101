// Progress of a long job: a bar with the time left on a terminal, a plain line now and then elsewhere.
// SPDX-License-Identifier: MIT
#ifndef BENCH_PROGRESS_H
#define BENCH_PROGRESS_H

#include <stdbool.h>

struct progress {
    double total, done; // milliseconds of expected work
    double start_ms, shown_ms;
    bool terminal;
    char phase[64];
};

void progress_start(struct progress *progress);
void progress_expect(struct progress *progress, double work_ms); // more work is known
void progress_phase(struct progress *progress, const char *phase);
void progress_add(struct progress *progress, double work_ms); // that much of the expected work is done
void progress_end(struct progress *progress);

#endif
