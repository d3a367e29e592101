// SPDX-License-Identifier: MIT
#include "bench/progress.h"
#include "bench/machine.h"

#include <stdio.h>
#include <string.h>
#include <unistd.h>

enum { BAR = 32 };

void progress_start(struct progress *progress)
{
    *progress = (struct progress){.start_ms = clock_wall_ms(), .terminal = isatty(STDERR_FILENO)};
}

static void show(struct progress *progress)
{
    double share = progress->total > 0 ? progress->done / progress->total : 0, now = clock_wall_ms();
    if (share > 1) share = 1;
    double left_s = share > 0.01 ? (now - progress->start_ms) / share * (1 - share) / 1e3 : -1;
    char left[48] = "";
    if (left_s >= 0) snprintf(left, sizeof left, ", about %d:%02d left", (int)left_s / 60, (int)left_s % 60);
    if (progress->terminal) {
        char bar[BAR + 1];
        for (int i = 0; i < BAR; i++) bar[i] = i < share * BAR ? '#' : '.';
        bar[BAR] = 0;
        fprintf(stderr, "\r[%s] %3d %%  %s%s\033[K", bar, (int)(100 * share), progress->phase, left);
    } else {
        fprintf(stderr, "%3d %%  %s%s\n", (int)(100 * share), progress->phase, left);
    }
    fflush(stderr);
    progress->shown_ms = now;
}

void progress_expect(struct progress *progress, double work_ms)
{
    progress->total += work_ms;
}

void progress_phase(struct progress *progress, const char *phase)
{
    snprintf(progress->phase, sizeof progress->phase, "%s", phase);
    show(progress);
}

void progress_add(struct progress *progress, double work_ms)
{
    progress->done += work_ms;
    if (clock_wall_ms() - progress->shown_ms > (progress->terminal ? 200 : 15000)) show(progress);
}

void progress_end(struct progress *progress)
{
    if (progress->terminal) fprintf(stderr, "\r\033[K");
}
