// The subcommand `run`: options, then plan, time, measure, write.
// SPDX-License-Identifier: MIT
#include "bench/run.h"
#include "bench/report/report.h"
#include "bench/result_files.h"
#include "common/cli.h"
#include "common/report.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static volatile sig_atomic_t interrupted;

static void on_interrupt(int signal_number)
{
    (void)signal_number;
    if (interrupted) _exit(EXIT_INTERRUPTED); // a second Ctrl-C does not wait
    interrupted = 1;
}

static void note_command(struct run *run, int argc, char **argv)
{
    size_t length = 0;
    for (int i = 0; i < argc && length < sizeof run->command; i++)
        length += (size_t)snprintf(run->command + length, sizeof run->command - length, "%s%s", i ? " " : "",
                                   argv[i]);
}

void run_finish(struct run *run)
{
    for (int s = 0; s < run->setting_count; s++) setting_finish(&run->settings[s]);
    if (run->gpu) {
        gpu_target_finish(&run->shaded);
        gpu_target_finish(&run->position);
    }
    gpu_destroy(run->gpu);
    scene_destroy(run->scene);
    terrain_destroy(run->truth);
    free(run->order);
    free(run);
}

// Timed flights with one rasteriser thread, in the GL thread itself: its CPU time is then the whole cost of a
// frame.
static bool open_gpu(struct run *run)
{
    enum gpu_backend backend = GPU_AUTO;
    gpu_backend_parse(run->options.backend, &backend);
    run->gpu = gpu_create(backend, run->scene->width, run->scene->height, "Relief", 0);
    if (!run->gpu) return false;
    run->cpu_times = gpu_info(run->gpu)->software;
    return gpu_target_init(run->gpu, &run->shaded, run->scene->width, run->scene->height, GL_RGBA8) &&
           gpu_target_init(run->gpu, &run->position, run->scene->width, run->scene->height, GL_RGBA32F);
}

// A run that cannot hold its error samples says so before it has measured for an hour.
static bool check_memory(const struct run *run)
{
    double needed = 0;
    for (int s = 0; s < run->setting_count; s++)
        needed += 2 * error_samples_bytes((double)run->settings[s].error_px.most); // and as many plane_px
    double present = (double)sysconf(_SC_PHYS_PAGES) * (double)sysconf(_SC_PAGESIZE);
    if (needed <= 0.75 * present) return true;
    return fail("--frames %d: the error samples need %.1f GiB, this machine has %.1f; fewer frames, settings "
                "(--renderers) or pixels "
                "(--size) are accepted",
                run->frames, needed / 0x1p30, present / 0x1p30);
}

static void print_summary(const struct run *run)
{
    for (int i = 0; i < run->unsupported_count; i++)
        printf("%s: unsupported: %s\n", run->unsupported[i]->name,
               renderer_unsupported(run->unsupported[i], run->scene->terrain));
    printf("report: %s/index.html\n", run->options.out);
    if (!run->complete) printf("interrupted: what was measured is kept, marked \"complete\": false\n");
}

// Errors against the source of a packed terrain hold what the coder and what the levels of detail did,
// together; `brute`, which draws every sample, then shows the coder's alone, and a run without --truth the
// levels' alone.
static bool open_truth(struct run *run)
{
    const char *path = run->options.truth;
    const struct terrain_info *flown = terrain_info(run->scene->terrain), *truth;
    run->truth = terrain_load(path, NULL);
    if (!run->truth) return false;
    truth = terrain_info(run->truth);
    bool alike = truth->datum == flown->datum;
    for (int i = 0; i < 4; i++)
        alike &= fabs(truth->outline_m[i] - flown->outline_m[i]) <= 1e-9 * fabs(flown->outline_m[i]);
    return alike ||
           fail("--truth %s: lies elsewhere than the terrain that is flown; a map of the same outline and "
                "spacing is accepted",
                path);
}

static int fly_and_write(struct run *run)
{
    const struct run_options *options = &run->options;
    char default_out[256];
    if (options->renderers && !plan_settings(run)) return EXIT_COMMAND_LINE;
    run->scene = scene_open(&(struct scene_request){options->scene, options->terrain, options->size[0],
                                                    options->size[1], options->cache_mib});
    if (!run->scene || (!options->renderers && !plan_settings(run)) || !leave_out_unsupported(run))
        return EXIT_WORLD;
    if (options->truth && !open_truth(run)) return EXIT_WORLD;
    if (!options->out) {
        snprintf(default_out, sizeof default_out, "reports/%s", run->scene->name);
        run->options.out = default_out;
    }
    if (!result_prepare_folder(run->options.out)) return EXIT_WORLD;
    run->frames = options->frames > 0 ? options->frames : path_frames(run->scene->path);
    if (!open_gpu(run)) return EXIT_WORLD;
    progress_start(&run->progress);
    progress_phase(&run->progress, "preparing the renderers");
    bool good = create_renderers(run) && check_memory(run);
    if (good && !interrupted) good = fly_timed(run);
    if (good && run->order_count) good = measure_errors(run);
    progress_end(&run->progress);
    if (!good) return EXIT_WORLD;
    if (!run->order_count) return EXIT_INTERRUPTED; // nothing was measured yet
    run->complete = !interrupted;
    if (!write_results(run, run->options.out) || !report_write(run->options.out)) return EXIT_WORLD;
    print_summary(run);
    return run->complete ? EXIT_GOOD : EXIT_INTERRUPTED;
}

int run_main(int argc, char **argv)
{
    struct run *run = calloc(1, sizeof *run);
    if (!run) return fail("out of memory"), EXIT_WORLD;
    run->options = (struct run_options){.sweep = "quick", .backend = "auto", .repeats = 5, .seed = 1};
    run->interrupted = &interrupted;
    struct run_options *o = &run->options;
    bool help = false;
    const struct cli_option options[] = {
        {"scene", "FILE", "scene to fly (default: the one that the program carries)", CLI_TEXT, &o->scene, 0,
         0, NULL},
        {"terrain", "FILE", "any elevation file; replaces the scene's terrain, and a path is made to suit it",
         CLI_TEXT, &o->terrain, 0, 0, NULL},
        {"truth", "FILE", "the map that errors are measured against: the source of a .relief file, say",
         CLI_TEXT, &o->truth, 0, 0, NULL},
        {"cache-mib", "MIB",
         "of a .relief file, which stays on disk: most that is kept decoded (default: 64)", CLI_NUMBER,
         &o->cache_mib, 0.001, 1 << 20, NULL},
        {"renderers", "LIST", "name[:knob=value...],...; a name alone is swept (default: all)", CLI_TEXT,
         &o->renderers, 0, 0, NULL},
        {"sweep", "quick|full", "how many settings a quality knob is given", CLI_TEXT, &o->sweep, 0, 0,
         "quick|full"},
        {"frames", "N", "resample the whole path to N frames (default: the path's own)", CLI_INT, &o->frames,
         1, 100000, NULL},
        {"repeats", "N", "timed flights of each setting", CLI_INT, &o->repeats, 1, 1000, NULL},
        {"out", "DIR", "folder of the results (default: reports/<scene>)", CLI_TEXT, &o->out, 0, 0, NULL},
        {"backend", "NAME", "auto, glfw, egl or osmesa", CLI_TEXT, &o->backend, 0, 0, "auto|glfw|egl|osmesa"},
        {"size", "WxH", "picture in pixels (default: the scene's)", CLI_SIZE, o->size, 1, 16384, NULL},
        {"threads", "N", "threads of the measures (default: every processor); changes no result", CLI_INT,
         &o->threads, 1, 64, NULL},
        {"seed", "N", "seed of the order of flights and of the intervals", CLI_INT, &o->seed, 0, 1e9, NULL},
        {"help", NULL, "this list", CLI_FLAG, &help, 0, 0, NULL},
        {0},
    };
    const char *words[1];
    int word_count = 1, code = EXIT_COMMAND_LINE;
    note_command(run, argc, argv);
    if (!cli_parse(argc - 1, argv + 1, options, words, &word_count)) goto done;
    if (help) {
        printf("usage: bench run [options]\nFlies one path through every renderer; leaves results.json and "
               "index.html.\n");
        cli_print_options(options);
        code = EXIT_GOOD;
        goto done;
    }
    if (word_count > 0) {
        fail("run: '%s' is not an option; see bench run --help", words[0]);
        goto done;
    }
    signal(SIGINT, on_interrupt);
    signal(SIGTERM, on_interrupt);
    code = fly_and_write(run);
done:
    run_finish(run);
    return code;
}
