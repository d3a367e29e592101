// `bench fly`: a long flight of each renderer, one after the other, for maps that only fit on disk.  Every
// frame is drawn and timed and searched for holes, memory is watched, and some frames are held against the
// truth.
// SPDX-License-Identifier: MIT
#include "bench/fly.h"

#include "bench/error/flat.h"
#include "bench/error/ridges.h"
#include "bench/machine.h"
#include "bench/run.h"
#include "common/cli.h"
#include "common/report.h"

#include <fcntl.h>
#include <malloc.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

struct look { // what a frame is held against the truth with
    struct truth_surface *surface;
    struct truth truth;
    struct frame_error error;
    struct places *hits;
    struct ridges ridges;
    float *positions;
};

struct flight {       // what came of one renderer
    double *frame_ms; // wall clock
    double cpu_ms;    // of the whole process, all frames
    int frames, looks, searches;
    uint64_t ground, holes, misses, spills;                  // of the looks
    uint64_t drawn, open_holes, open_misses;                 // of the searches
    double error_px;                                         // largest p99.9 of a frame
    size_t resident, terrain_resident, renderer_resident;    // most, bytes
    struct renderer_counter counters[RENDERER_MAX_COUNTERS]; // sums
};

static volatile sig_atomic_t interrupted, flying;

static void on_interrupt(int signal_number)
{
    (void)signal_number;
    if (interrupted || !flying) _exit(EXIT_INTERRUPTED); // nothing to tell, or it takes too long
    interrupted = 1;
}

// ---- memory ----------------------------------------------------------------

// Most memory that the process has had since forget_peak, bytes; 0 where the system does not tell.
static size_t peak_resident(void)
{
    char line[256];
    size_t kib = 0;
    FILE *status = fopen("/proc/self/status", "r");
    while (status && fgets(line, sizeof line, status))
        if (sscanf(line, "VmHWM: %zu kB", &kib) == 1) break;
    if (status) fclose(status);
    return kib * 1024;
}

// The heap is not trimmed while it flies (gpu.h): what one renderer has freed would count as the next one's.
static void forget_peak(void)
{
#ifdef __GLIBC__
    malloc_trim(0);
#endif
    int file = open("/proc/self/clear_refs", O_WRONLY | O_CLOEXEC);
    if (file < 0) return;
    if (write(file, "5", 1) != 1) note("the peak of memory is that of the whole process");
    close(file);
}

// ---- looking ---------------------------------------------------------------

static void look_finish(struct look *look)
{
    truth_surface_destroy(look->surface);
    truth_finish(&look->truth);
    frame_error_finish(&look->error);
    ridges_finish(&look->ridges);
    places_destroy(look->hits);
    free(look->positions);
}

static bool look_init(struct look *look, const struct run *run)
{
    int width = run->scene->width, height = run->scene->height;
    *look = (struct look){.surface = truth_surface_create(run->scene->terrain)};
    look->positions = malloc((size_t)width * (size_t)height * 4 * sizeof *look->positions);
    if (!look->surface) return false;
    if (!look->positions) return fail("out of memory");
    if (!truth_init(&look->truth, width, height)) return false;
    look->truth.interrupted = &interrupted;
    return frame_error_init(&look->error, width, height);
}

static void receive_triangles(const float *triangles, size_t count, void *user)
{
    struct look *look = user;
    flat_feed(look->truth.radius_m, triangles, count, look->hits);
    ridges_feed(&look->ridges, triangles, count);
}

static void receive_ridges(const float *triangles, size_t count, void *user)
{
    ridges_feed(user, triangles, count);
}

static void read_positions(struct look *look, struct run *run, const struct setting *setting)
{
    gpu_target_begin(run->gpu, &run->position);
    setting->type->draw(setting->renderer, 0, PASS_POSITION);
    gpu_target_read(run->gpu, &run->position, look->positions);
}

// Where to look for what is wrong: a flight is repeated up to this frame.
static void tell_holes(const struct frame_error *error, const struct setting *setting, int frame)
{
    int p = 0;
    if (error->holes == 0) return;
    while (error->kind[p] != PIXEL_HOLE) p++;
    printf("%s: frame %d has %llu holes, the first at column %d, row %d from below\n", setting->id, frame,
           (unsigned long long)error->holes, p % error->width, p / error->width);
    fflush(stdout);
}

// Searches what was drawn last for holes.
static bool search(struct look *look, struct run *run, const struct setting *setting, const struct view *view,
                   struct flight *flight)
{
    read_positions(look, run, setting);
    if (!ridges_begin(&look->ridges, view, look->positions)) return false;
    if (look->ridges.count > 0) {
        if (!gpu_capture_begin(run->gpu, receive_ridges, &look->ridges)) return false;
        setting->type->draw(setting->renderer, 0, PASS_DEPTH);
        gpu_capture_end(run->gpu);
    }
    frame_error_holes(&look->error, &look->truth, look->surface, view, look->positions, run->options.threads);
    if (interrupted) return true;
    tell_holes(&look->error, setting, flight->frames - 1);
    flight->searches++;
    flight->drawn += look->error.ground + look->error.spills;
    flight->open_holes += look->error.holes;
    flight->open_misses += look->error.misses;
    return true;
}

// Holds what was drawn last against the truth.
static bool look_at(struct look *look, struct run *run, const struct setting *setting,
                    const struct view *view, struct flight *flight)
{
    truth_cast(&look->truth, look->surface, view, run->options.threads);
    if (interrupted) return true;
    places_destroy(look->hits);
    look->hits = truth_places(&look->truth, run->options.threads);
    if (!look->hits) return false;
    read_positions(look, run, setting);
    if (!ridges_begin(&look->ridges, view, look->positions) ||
        !gpu_capture_begin(run->gpu, receive_triangles, look))
        return false;
    setting->type->draw(setting->renderer, 0, PASS_DEPTH);
    gpu_capture_end(run->gpu);
    frame_error_measure(&look->error, run->scene->terrain, view, &look->truth, look->positions, look->hits,
                        run->options.threads);
    struct error_samples samples = {.most = (uint64_t)view->width * (uint64_t)view->height};
    if (!error_samples_add(&samples, look->error.error_px, (size_t)samples.most))
        return fail("out of memory");
    double p999 = samples.count ? error_samples_summary(&samples).p999 : 0;
    error_samples_finish(&samples);
    tell_holes(&look->error, setting, flight->frames - 1);
    flight->looks++;
    flight->ground += look->error.ground;
    flight->holes += look->error.holes;
    flight->misses += look->error.misses;
    flight->spills += look->error.spills;
    flight->error_px = fmax(flight->error_px, p999);
    return true;
}

// ---- flying ----------------------------------------------------------------

static size_t larger(size_t a, size_t b)
{
    return a > b ? a : b;
}

static bool draw_frame(struct run *run, struct setting *setting, int frame, struct view *view,
                       struct flight *flight)
{
    struct renderer_stats stats;
    double start = clock_wall_ms(), cpu = clock_process_ms();
    scene_view(run->scene, frame, run->frames, view);
    setting->type->begin_frame(setting->renderer, frame);
    if (!setting->type->update(setting->renderer, view, 1)) return false;
    gpu_set_view(run->gpu, run->scene->terrain, view);
    gpu_target_begin(run->gpu, &run->shaded);
    setting->type->draw(setting->renderer, 0, PASS_SHADED);
    gpu_finish(run->gpu);
    flight->frame_ms[flight->frames++] = clock_wall_ms() - start;
    flight->cpu_ms += clock_process_ms() - cpu;
    setting->type->stats(setting->renderer, &stats);
    for (int c = 0; c < RENDERER_MAX_COUNTERS && stats.counters[c].name; c++) {
        flight->counters[c].name = stats.counters[c].name;
        flight->counters[c].value += stats.counters[c].value;
    }
    flight->renderer_resident = larger(flight->renderer_resident, (size_t)stats.resident_bytes);
    flight->terrain_resident = larger(flight->terrain_resident, terrain_resident_bytes(run->scene->terrain));
    return !terrain_failed(run->scene->terrain); // told where it was found
}

static int ascending(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static void print_flight(const struct setting *setting, struct flight *f)
{
    int last = f->frames - 1;
    double mean_ms = 0;
    for (int i = 0; i <= last; i++) mean_ms += f->frame_ms[i] / f->frames;
    qsort(f->frame_ms, (size_t)f->frames, sizeof *f->frame_ms, ascending);
    printf(
        "%s: %d frames; %.1f ms a frame on average, median %.1f, p99 %.1f, most %.1f (wall clock; %.1f ms of "
        "CPU time a frame, workers included)\n",
        setting->id, f->frames, mean_ms, f->frame_ms[last / 2], f->frame_ms[last * 99 / 100],
        f->frame_ms[last], f->cpu_ms / f->frames);
    printf("  memory: process at most %.0f MiB, terrain %.0f, renderer %.0f\n", (double)f->resident / 0x1p20,
           (double)f->terrain_resident / 0x1p20, (double)f->renderer_resident / 0x1p20);
    printf("  %d frames searched: %llu pixels drawn, holes %llu, misses %llu\n", f->searches,
           (unsigned long long)f->drawn, (unsigned long long)f->open_holes,
           (unsigned long long)f->open_misses);
    printf("  %d frames held against the truth: %llu pixels of ground, holes %llu, misses %llu, spills %llu; "
           "error p99.9 at most %.2f px\n ",
           f->looks, (unsigned long long)f->ground, (unsigned long long)f->holes,
           (unsigned long long)f->misses, (unsigned long long)f->spills, f->error_px);
    for (int c = 0; c < RENDERER_MAX_COUNTERS && f->counters[c].name; c++)
        printf(" %s %.6g;", f->counters[c].name, f->counters[c].value / f->frames);
    printf(" a frame\n");
    fflush(stdout);
}

struct every { // so many frames, 0: none
    int search, look;
};

static bool is_due(int frame, int every)
{
    return every > 0 && frame % every == 0 && !interrupted;
}

static bool fly_setting(struct run *run, struct setting *setting, const struct every *every)
{
    struct renderer_desc desc = {.gpu = run->gpu,
                                 .terrain = run->scene->terrain,
                                 .effects = &run->scene->effects,
                                 .width = run->scene->width,
                                 .height = run->scene->height};
    struct flight flight = {.frame_ms = malloc((size_t)run->frames * sizeof(double))};
    struct look look = {0};
    memcpy(desc.knobs, setting->knobs, sizeof desc.knobs);
    forget_peak();
    bool good = flight.frame_ms != NULL || fail("out of memory");
    if (good) setting->renderer = setting->type->create(&desc);
    bool looks = every->search > 0 || every->look > 0; // the caster's bounds take memory
    good = good && setting->renderer && (!looks || look_init(&look, run));
    for (int frame = 0; frame < run->frames && good && !interrupted; frame++) {
        struct view view;
        good = draw_frame(run, setting, frame, &view, &flight);
        flying = 1; // there is something to tell
        if (setting->type == &null_renderer) continue;
        if (good && is_due(frame, every->search)) good = search(&look, run, setting, &view, &flight);
        if (good && is_due(frame, every->look)) good = look_at(&look, run, setting, &view, &flight);
    }
    flight.resident = peak_resident();
    if (good && flight.frames) print_flight(setting, &flight);
    look_finish(&look);
    free(flight.frame_ms);
    setting->type->destroy(setting->renderer);
    setting->renderer = NULL;
    return good;
}

// ---- the command -----------------------------------------------------------

static int fly_all(struct run *run, const struct every *every)
{
    const struct run_options *o = &run->options;
    enum gpu_backend backend = GPU_OFFSCREEN;
    if (!plan_settings(run)) return EXIT_COMMAND_LINE;
    run->scene =
        scene_open(&(struct scene_request){o->scene, o->terrain, o->size[0], o->size[1], o->cache_mib});
    if (!run->scene) return EXIT_WORLD;
    run->frames = o->frames > 0 ? o->frames : path_frames(run->scene->path);
    int width = run->scene->width, height = run->scene->height;
    bool good = true;
    // A context each: drivers hold on to deleted textures until others are drawn with, and memory is
    // measured.
    for (int s = 0; s < run->setting_count && good && !interrupted; s++) {
        run->gpu = gpu_create(backend, width, height, "Relief", 0);
        good = run->gpu && gpu_target_init(run->gpu, &run->shaded, width, height, GL_RGBA8) &&
               gpu_target_init(run->gpu, &run->position, width, height, GL_RGBA32F) &&
               fly_setting(run, &run->settings[s], every);
        gpu_target_finish(&run->shaded);
        gpu_target_finish(&run->position);
        gpu_destroy(run->gpu);
        run->gpu = NULL;
    }
    return !good ? EXIT_WORLD : interrupted ? EXIT_INTERRUPTED : EXIT_GOOD;
}

int fly_main(int argc, char **argv)
{
    struct run *run = calloc(1, sizeof *run);
    if (!run) return fail("out of memory"), EXIT_WORLD;
    run->options =
        (struct run_options){.sweep = "quick", .renderers = "clipmap:n=127,geomipmap:tau=2,pgm:rows=300"};
    struct run_options *o = &run->options;
    bool help = false;
    struct every every = {1, 50};
    const struct cli_option options[] = {
        {"scene", "FILE", "scene to fly (default: the one that the program carries)", CLI_TEXT, &o->scene, 0,
         0, NULL},
        {"terrain", "FILE", "any elevation file; replaces the scene's terrain, and a path is made to suit it",
         CLI_TEXT, &o->terrain, 0, 0, NULL},
        {"cache-mib", "MIB",
         "of a .relief file, which stays on disk: most that is kept decoded (default: 64)", CLI_NUMBER,
         &o->cache_mib, 0.001, 1 << 20, NULL},
        {"renderers", "LIST", "name[:knob=value...],...; flown one after the other", CLI_TEXT, &o->renderers,
         0, 0, NULL},
        {"frames", "N", "resample the whole path to N frames (default: the path's own)", CLI_INT, &o->frames,
         1, 100000, NULL},
        {"search", "N", "every N-th frame is searched for holes; 0: none (default: 1)", CLI_INT,
         &every.search, 0, 100000, NULL},
        {"look", "N", "every N-th frame is held against the truth, pixel by pixel; 0: none (default: 50)",
         CLI_INT, &every.look, 0, 100000, NULL},
        {"size", "WxH", "picture in pixels (default: the scene's)", CLI_SIZE, o->size, 1, 16384, NULL},
        {"threads", "N", "threads of the measures (default: every processor); changes no result", CLI_INT,
         &o->threads, 1, 64, NULL},
        {"help", NULL, "this list", CLI_FLAG, &help, 0, 0, NULL},
        {0},
    };
    int words = 0, code = EXIT_COMMAND_LINE;
    if (cli_parse(argc - 1, argv + 1, options, NULL, &words)) {
        if (help) {
            printf("usage: bench fly [options]\nA long flight of each renderer: times, memory, holes.\n");
            cli_print_options(options);
            code = EXIT_GOOD;
        } else {
            signal(SIGINT, on_interrupt);
            signal(SIGTERM, on_interrupt);
            code = fly_all(run, &every);
        }
    }
    run_finish(run);
    return code;
}
