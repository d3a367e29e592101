// What the rooms of results.json share: a run's row and the curves made of rows.  Inside bench/result*.c
// only. SPDX-License-Identifier: MIT
#ifndef BENCH_RESULT_PARTS_H
#define BENCH_RESULT_PARTS_H

#include "bench/run.h"

#include <cjson/cJSON.h>

struct result_summary { // what curves and pictures are chosen by; NAN: not measured
    struct error_summary error_px;
    double frame_ms;          // median
    double visible_triangles; // mean
};

void result_add_number(cJSON *object, const char *key, double value); // null when it is not finite

// ---- result_run.c: one setting's row, to be deleted by the caller -------------------------------

cJSON *result_run(const struct run *run, struct setting *setting, struct result_summary *summary);
cJSON *result_pictures(const struct setting *setting); // the row's `pictures`

// ---- result_curves.c: frontier, sweeps, equal_error, equal_time, against_brute ------------------

// summaries: one for each of the run's settings.
bool result_add_curves(cJSON *root, const struct run *run, const struct result_summary *summaries);

#endif
