// Image coders of other people, run on heights for comparison: OpenJPEG (JPEG 2000), CharLS (JPEG-LS), LERC
// and zlib.  The first three are there when their libraries were there at build time (pkg-config); nothing
// else hangs on those. SPDX-License-Identifier: MIT
#ifndef COMMON_TERRAIN_RELIEF_PEER_CODERS_H
#define COMMON_TERRAIN_RELIEF_PEER_CODERS_H

#include "common/terrain/heightfield.h"

#include <stdbool.h>
#include <stddef.h>

struct coder_aim { // one of these; both 0: lossless
    double rms_m, max_m;
};

struct coder_run { // what a coder made of a map
    const char *coder;
    const char *reason; // NULL, or why nothing was measured
    double bytes, rms_m, max_m;
    double encode_s, decode_s; // CPU time of all threads, one encoding at the parameter that was found
};

int peer_coder_count(void);
const char *peer_coder_name(int number);

// Runs coder `number` at the coarsest setting that keeps the aim, found by bisection, on a map without voids.
struct coder_run peer_coder_run(int number, const struct heightfield *field, const struct coder_aim *aim);

double coder_cpu_seconds(void); // of the process

// rms and largest difference of two maps of one size, in metres.
void coder_errors(const struct heightfield *a, const struct heightfield *b, double *rms_m, double *max_m);

#endif
