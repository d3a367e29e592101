// Error samples of many frames, and their percentiles (numerics.md, E8).  PURE.
//
// A run has hundreds of millions of samples.  The mean and the share are running sums; percentiles from p99
// up need only the largest hundredth, which is kept as it is, so they are exact.  The median is exact while
// every sample is kept (SAMPLES_KEPT of them at least); beyond that it is the middle of a bin of a histogram
// over the samples' leading bits, at most 2^-11 (0.05 %) off. SPDX-License-Identifier: MIT
#ifndef BENCH_ERROR_SAMPLES_H
#define BENCH_ERROR_SAMPLES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum { SAMPLES_KEPT = 65536 };

struct error_summary { // results.json: error_px{...}
    double mean, rms, p50, p99, p999, max, share_over_1px;
    uint64_t samples;
};

struct error_samples { // starts zeroed, but for `most`
    uint64_t most;     // never more samples than this will come; 0: nobody knows, and all are kept
    uint64_t count, over_1px;
    double sum, squares;
    float *kept; // every sample, or once `histogram` is there at least the largest hundredth of `most`; owned
    size_t kept_count, capacity;
    uint64_t *histogram; // of all samples; owned
};

// Passes NANs over.  values: not negative.  False after one line on stderr.
bool error_samples_add(struct error_samples *samples, const float *values, size_t count);
// Nearest ranks, k = (999 N + 999) / 1000.  Reorders what is kept; all 0 when there are no samples.
struct error_summary error_samples_summary(struct error_samples *samples);
void error_samples_finish(struct error_samples *samples);

// Bytes that the samples of one list need at most, `most` of them to come.
double error_samples_bytes(double most);

#endif
