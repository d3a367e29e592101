// Timed flights.  The whole path is flown once untimed by every setting (shaders are compiled, caches fill),
// then repeat after repeat in a seeded random order.  A flight begins with its first frame drawn once
// untimed, so that no frame pays for the jump back to the start.  Nothing but the frame stands between the
// clock readings. SPDX-License-Identifier: MIT
#include "bench/machine.h"
#include "bench/run.h"
#include "common/report.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

enum { FRAMES_IN_FLIGHT = 2, SAMPLES_PER_QUERY = 2 };

struct clocks {
    double thread, process, wall;
};

static struct clocks read_clocks(void)
{
    return (struct clocks){clock_thread_ms(), clock_process_ms(), clock_wall_ms()};
}

static double primary(const struct run *run, struct clocks from, struct clocks to)
{
    return run->cpu_times ? to.thread - from.thread : to.wall - from.wall;
}

static void draw_frame(struct run *run, struct setting *setting, const struct view *view)
{
    gpu_set_view(run->gpu, run->scene->terrain, view);
    gpu_target_begin(run->gpu, &run->shaded);
    setting->type->draw(setting->renderer, 0, PASS_SHADED);
}

// Latency: the pipeline is drained before and after each frame.
static bool fly_latency(struct run *run, struct setting *setting, int repeat, GLuint *queries)
{
    for (int i = -1; i < setting->frame_count && !*run->interrupted; i++) { // -1: the untimed first frame
        struct view view;
        int frame = setting->frames[i < 0 ? 0 : i];
        scene_view(run->scene, frame, run->frames, &view);
        gpu_finish(run->gpu);
        struct clocks start = read_clocks();
        if (queries && i >= 0) glQueryCounter(queries[SAMPLES_PER_QUERY * i], GL_TIMESTAMP);
        setting->type->begin_frame(setting->renderer, frame);
        if (!setting->type->update(setting->renderer, &view, 1) || terrain_failed(run->scene->terrain))
            return false;
        struct clocks updated = read_clocks();
        draw_frame(run, setting, &view);
        if (queries && i >= 0) glQueryCounter(queries[SAMPLES_PER_QUERY * i + 1], GL_TIMESTAMP);
        gpu_finish(run->gpu);
        struct clocks end = read_clocks();
        double frame_ms = primary(run, start, end);
        if (i >= 0 && repeat >= 0) {
            size_t at = (size_t)repeat * (size_t)setting->frame_count + (size_t)i;
            setting->times[TIME_FRAME][at] = frame_ms;
            setting->times[TIME_UPDATE][at] = primary(run, start, updated);
            setting->times[TIME_DRAW][at] = primary(run, updated, end);
            setting->times[TIME_WALL][at] = end.wall - start.wall;
            setting->times[TIME_WORKER][at] = (end.process - start.process) - (end.thread - start.thread);
        }
        if (repeat < 0) setting->expected_ms += frame_ms / (setting->frame_count + 1);
        progress_add(&run->progress, repeat < 0 ? 1 : setting->expected_ms);
    }
    return true;
}

// GPU time of each frame, read after the flight so that nothing waits for it.
static void read_queries(struct setting *setting, int repeat, GLuint *queries)
{
    for (int i = 0; i < setting->frame_count; i++) {
        GLuint64 start = 0, end = 0;
        glGetQueryObjectui64v(queries[SAMPLES_PER_QUERY * i], GL_QUERY_RESULT, &start);
        glGetQueryObjectui64v(queries[SAMPLES_PER_QUERY * i + 1], GL_QUERY_RESULT, &end);
        setting->times[TIME_GPU][(size_t)repeat * (size_t)setting->frame_count + (size_t)i] =
            (double)(end - start) * 1e-6;
    }
}

// Throughput: two frames in flight; a frame's time is the interval between the moments at which its slot and
// the next came free.
static bool fly_throughput(struct run *run, struct setting *setting, int repeat)
{
    GLsync fences[FRAMES_IN_FLIGHT] = {0};
    double last_ms = clock_wall_ms();
    for (int i = 0; i < setting->frame_count && !*run->interrupted; i++) {
        struct view view;
        scene_view(run->scene, setting->frames[i], run->frames, &view);
        setting->type->begin_frame(setting->renderer, setting->frames[i]);
        if (!setting->type->update(setting->renderer, &view, 1) || terrain_failed(run->scene->terrain))
            return false;
        draw_frame(run, setting, &view);
        GLsync *fence = &fences[i % FRAMES_IN_FLIGHT];
        if (*fence) {
            glClientWaitSync(*fence, GL_SYNC_FLUSH_COMMANDS_BIT, GL_TIMEOUT_IGNORED);
            glDeleteSync(*fence);
        }
        *fence = glFenceSync(GL_SYNC_GPU_COMMANDS_COMPLETE, 0);
        double now_ms = clock_wall_ms();
        setting->times[TIME_THROUGHPUT][(size_t)repeat * (size_t)setting->frame_count + (size_t)i] =
            now_ms - last_ms;
        last_ms = now_ms;
    }
    for (int k = 0; k < FRAMES_IN_FLIGHT; k++)
        if (fences[k]) glDeleteSync(fences[k]);
    gpu_finish(run->gpu);
    return true;
}

// One flight of one setting; repeat < 0: the untimed one.
static bool fly(struct run *run, struct setting *setting, int repeat)
{
    GLuint *queries = NULL;
    int count = SAMPLES_PER_QUERY * setting->frame_count;
    if (repeat >= 0 && gpu_info(run->gpu)->timer_query) {
        queries = malloc((size_t)count * sizeof *queries);
        if (!queries) return fail("out of memory");
        glGenQueries(count, queries);
    }
    bool good = fly_latency(run, setting, repeat, queries);
    if (queries) {
        if (good && !*run->interrupted) read_queries(setting, repeat, queries);
        glDeleteQueries(count, queries);
        free(queries);
    }
    if (good && repeat >= 0 && !run->cpu_times) good = fly_throughput(run, setting, repeat);
    if (repeat >= 0 && !*run->interrupted) setting->repeats_done = repeat + 1;
    return good;
}

static void keep_minima(struct setting *setting)
{
    double *least = malloc((size_t)setting->frame_count * sizeof *least);
    for (int column = 0; least && column < TIME_COLUMNS; column++) {
        minimum_over_repeats(setting->times[column], setting->repeats_done, setting->frame_count, least);
        for (int i = 0; i < setting->frame_count; i++) {
            struct frame_record *record = &setting->records[i];
            double *const fields[TIME_COLUMNS] = {&record->frame_ms,     &record->update_ms, &record->draw_ms,
                                                  &record->wall_ms,      &record->worker_ms, &record->gpu_ms,
                                                  &record->throughput_ms};
            *fields[column] = setting->repeats_done ? least[i] : (double)NAN;
        }
    }
    free(least);
}

bool fly_timed(struct run *run)
{
    struct random_state random = {(uint64_t)run->options.seed};
    int order[MAX_SETTINGS];
    run->order = malloc((size_t)run->options.repeats * MAX_SETTINGS * sizeof *run->order);
    if (!run->order) return fail("out of memory");
    progress_phase(&run->progress, "warming up");
    for (int s = 0; s < run->setting_count; s++) {
        if (!fly(run, &run->settings[s], -1)) return false;
        progress_expect(&run->progress, run->settings[s].expected_ms *
                                            (run->options.repeats * (run->settings[s].frame_count + 1)));
        order[s] = s;
    }
    for (int repeat = 0; repeat < run->options.repeats && !*run->interrupted; repeat++) {
        char phase[64];
        snprintf(phase, sizeof phase, "timing, flight %d of %d", repeat + 1, run->options.repeats);
        progress_phase(&run->progress, phase);
        random_shuffle(&random, order, run->setting_count);
        for (int k = 0; k < run->setting_count && !*run->interrupted; k++) {
            run->order[run->order_count++] = order[k];
            if (!fly(run, &run->settings[order[k]], repeat)) return false;
        }
    }
    for (int s = 0; s < run->setting_count; s++) keep_minima(&run->settings[s]);
    return true;
}
