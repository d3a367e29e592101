// `bench run`: flies one path through every setting, measures time and error apart, leaves results and a
// report.
//
//   plan     which renderers at which settings, and which frames each flies          plan.c
//   time     whole flights, interleaved in random order, repeated                    timing.c
//   measure  frame by frame: truth once, then every setting against it               measure.c
//   results  results.json, frames/*.csv, pictures/*.png, then the report             results.c, result_*.c
// SPDX-License-Identifier: MIT
#ifndef BENCH_RUN_H
#define BENCH_RUN_H

#include "bench/error/error.h"
#include "bench/error/samples.h"
#include "bench/progress.h"
#include "bench/registry.h"
#include "bench/roofline.h"
#include "bench/statistics.h"
#include "common/scene/scene.h"

#include <signal.h>

enum { MAX_SETTINGS = 64 };

struct run_options {
    const char *scene, *terrain, *truth, *renderers, *sweep, *out, *backend;
    int frames, repeats, size[2], threads, seed;
    double cache_mib;
};

enum moment { MOMENT_START, MOMENT_MIDDLE, MOMENT_WORST, MOMENT_COUNT };

struct snapshot { // what one frame looked like
    int frame;    // -1: none taken
    double error_px_p999;
    uint8_t *picture; // RGBA, bottom row first
    uint8_t *error;   // RGB heat map, bottom row first
};

// One frame of one setting.  NAN: not measured.
struct frame_record {
    double frame_ms, update_ms, draw_ms, wall_ms, worker_ms, gpu_ms, throughput_ms,
        roofline_ms; // times: minimum over repeats
    double triangles, visible_triangles, draw_calls, upload_bytes;
    double generated_triangles,
        clipped_triangles; // as the pipeline counted: submitted, and left after clipping
    double error_px_mean, error_px_p999, error_px_max, temporal_px_p999;
    double claimed_px;       // what the method promised for this frame; NAN: nothing
    double error_px_certain; // the largest error that pixel centres can prove: what a claim is held against
    double ground, holes, misses, spills, order_mismatches, order_beyond_grid;
};

// One column of times: repeat after repeat, frame after frame.
enum clock_column {
    TIME_FRAME,
    TIME_UPDATE,
    TIME_DRAW,
    TIME_WALL,
    TIME_WORKER,
    TIME_GPU,
    TIME_THROUGHPUT,
    TIME_COLUMNS
};

struct setting { // a renderer at one setting: a row of the report
    const struct renderer_type *type;
    double knobs[RENDERER_MAX_KNOBS];
    char id[128];   // "clipmap n=127"
    char slug[128]; // the same as a file name
    struct renderer *renderer;
    int *frames; // frames of the path that it flies, ascending
    int frame_count;
    bool few_frames; // fewer than the path has
    int repeats_done;
    double *times[TIME_COLUMNS];
    double expected_ms;           // a frame of the warm-up: for the progress bar
    struct frame_record *records; // one for each of `frames`
    bool measured;                // every frame has its errors
    struct error_samples error_px, plane_px, temporal_px;
    double claimed_px; // largest claim over the frames; NAN: none
    int claim_broken_frames;
    uint64_t resident_bytes;
    struct renderer_counter counters[RENDERER_MAX_COUNTERS]; // sums over frames
    double *previous_height; // at the temporal places of the frame before; NAN: not drawn there
    struct snapshot snapshots[MOMENT_COUNT];
    char pictures_sha256[65]; // over the shaded pictures of all frames, in order
    unsigned char *picture_digests;
};

struct run {
    struct run_options options;
    struct scene *scene;
    struct terrain *truth; // what errors are measured against; NULL: the finest level of what is flown
    struct gpu *gpu;
    struct gpu_target shaded, position;
    bool cpu_times; // software rasteriser: times are CPU time of the GL thread
    int frames;     // of the path as flown
    struct setting settings[MAX_SETTINGS];
    int setting_count;
    const struct renderer_type *unsupported[16]; // asked for, but they cannot draw this terrain
    int unsupported_count;
    int *order; // flights in the order flown: setting numbers
    int order_count;
    struct progress progress;
    volatile sig_atomic_t *interrupted;
    bool complete;
    char command[1024];
};

// Each returns false after one line on stderr; an interruption is no failure.
bool plan_settings(struct run *run);
bool leave_out_unsupported(struct run *run); // settings of renderers that cannot draw the scene's terrain
bool create_renderers(struct run *run);
bool fly_timed(struct run *run);
bool measure_errors(struct run *run);
bool write_results(struct run *run, const char *folder);
void run_finish(struct run *run); // with all that it holds; accepts one that is only zeroed

int run_main(int argc, char **argv); // the subcommand; returns the exit code

void setting_finish(struct setting *setting);

#endif
