// SPDX-License-Identifier: MIT
#include "common/viewer.h"

#include "common/cli.h"
#include "common/image.h"
#include "common/report.h"
#include "common/viewer_window.h"

#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

enum { COMMON_OPTIONS = 10, HELP_SIZE = 256 };

struct options {
    bool help, version, headless;
    const char *scene, *terrain, *backend, *snapshot;
    int size[2], frames;
    double cache_mib;
    const char *knobs[RENDERER_MAX_KNOBS]; // as written; NULL: not given
    char knob_help[RENDERER_MAX_KNOBS][HELP_SIZE];
    struct cli_option table[COMMON_OPTIONS + RENDERER_MAX_KNOBS + 1];
};

// ---- the command line ------------------------------------------------------

static void describe_knob(const struct renderer_knob *knob, char text[HELP_SIZE])
{
    char fallback[64];
    renderer_format_knob(knob, knob->fallback, fallback);
    if (knob->choices)
        snprintf(text, HELP_SIZE, "%s (%s; default %s)", knob->help, knob->choices, fallback);
    else
        snprintf(text, HELP_SIZE, "%s (%g to %g; default %s)", knob->help, knob->min, knob->max, fallback);
}

static void fill_table(struct options *o, const struct renderer_type *type)
{
    const struct cli_option common[COMMON_OPTIONS] = {
        {.name = "help", .help = "print this and end", .kind = CLI_FLAG, .value = &o->help},
        {.name = "version", .help = "print the version and end", .kind = CLI_FLAG, .value = &o->version},
        {.name = "scene",
         .metavar = "FILE",
         .help = "scene to fly (JSON; default: the one carried along)",
         .kind = CLI_TEXT,
         .value = &o->scene},
        {.name = "terrain",
         .metavar = "FILE",
         .help = "elevation file instead of the scene's; a path is made for it",
         .kind = CLI_TEXT,
         .value = &o->terrain},
        {.name = "cache-mib",
         .metavar = "MIB",
         .help = "of a .relief file, which stays on disk: most that is kept decoded (default: the scene's, "
                 "or 64)",
         .kind = CLI_NUMBER,
         .value = &o->cache_mib,
         .min = 0.001,
         .max = 1 << 20},
        {.name = "backend",
         .metavar = "WORD",
         .help = "way to OpenGL (auto: a window where there is a display)",
         .kind = CLI_TEXT,
         .value = &o->backend,
         .choices = "auto|glfw|egl|osmesa"},
        {.name = "size",
         .metavar = "WxH",
         .help = "pixels of the picture (default: the scene's)",
         .kind = CLI_SIZE,
         .value = o->size,
         .min = 1,
         .max = 16384},
        {.name = "headless",
         .help = "fly the path without a window",
         .kind = CLI_FLAG,
         .value = &o->headless},
        {.name = "frames",
         .metavar = "N",
         .help = "fly the whole path in N frames, then end (headless: the path's own)",
         .kind = CLI_INT,
         .value = &o->frames,
         .min = 1,
         .max = 1000000},
        {.name = "snapshot",
         .metavar = "F.png",
         .help = "write the last frame drawn",
         .kind = CLI_TEXT,
         .value = &o->snapshot},
    };
    int n = 0;
    for (; n < COMMON_OPTIONS; n++) o->table[n] = common[n];
    for (int k = 0; type->knobs[k].name; k++) {
        describe_knob(&type->knobs[k], o->knob_help[k]);
        o->table[n++] = (struct cli_option){.name = type->knobs[k].name,
                                            .metavar = type->knobs[k].choices ? "WORD" : "NUMBER",
                                            .help = o->knob_help[k],
                                            .kind = CLI_TEXT,
                                            .value = &o->knobs[k]};
    }
}

static void print_help(const struct options *o, const struct renderer_type *type)
{
    printf("%s: %s\nusage: %s [options]\n", type->name, type->summary, type->name);
    cli_print_options(o->table);
    printf("\nIn the window: W A S D move, Q E down and up, arrows or dragging look, Shift faster, wheel "
           "sets the speed,\n"
           "P path, F wireframe, + - quality, V vertical sync, F12 picture, Esc quit.\n");
}

// ---- one frame -------------------------------------------------------------

bool viewer_make_renderer(struct viewer *viewer)
{
    viewer->type->destroy(viewer->renderer);
    struct renderer_desc desc = {.gpu = viewer->gpu,
                                 .terrain = viewer->scene->terrain,
                                 .effects = &viewer->scene->effects,
                                 .width = viewer->scene->width,
                                 .height = viewer->scene->height,
                                 .realtime = true};
    for (int k = 0; k < RENDERER_MAX_KNOBS; k++) desc.knobs[k] = viewer->knobs[k];
    viewer->largest[0] = desc.width;
    viewer->largest[1] = desc.height;
    const char *unsupported = renderer_unsupported(viewer->type, desc.terrain);
    if (unsupported)
        return fail("%s: unsupported: %s; the clipmap renderer draws it", viewer->type->name, unsupported);
    viewer->renderer = viewer->type->create(&desc);
    return viewer->renderer != NULL;
}

bool viewer_draw(struct viewer *viewer, const struct view *view)
{
    const struct renderer_type *type = viewer->type;
    type->begin_frame(viewer->renderer, viewer->frame++);
    if (!type->update(viewer->renderer, view, 1)) return false;
    gpu_set_view(viewer->gpu, viewer->scene->terrain, view);
    gpu_target_begin(viewer->gpu, &viewer->target);
    if (viewer->wireframe) glPolygonMode(GL_FRONT_AND_BACK, GL_LINE);
    type->draw(viewer->renderer, 0, PASS_SHADED);
    if (viewer->wireframe) glPolygonMode(GL_FRONT_AND_BACK, GL_FILL);
    return !terrain_failed(viewer->scene->terrain); // told where it was found
}

void viewer_show(const struct viewer *viewer)
{
    GLFWwindow *window = gpu_window(viewer->gpu);
    if (!window) return;
    const struct gpu_target *target = &viewer->target;
    int width, height;
    glfwGetFramebufferSize(window, &width, &height);
    glBindFramebuffer(GL_READ_FRAMEBUFFER, target->framebuffer);
    glBindFramebuffer(GL_DRAW_FRAMEBUFFER, 0);
    glBlitFramebuffer(0, 0, target->width, target->height, 0, 0, width, height, GL_COLOR_BUFFER_BIT,
                      GL_NEAREST);
    glfwSwapBuffers(window);
}

bool viewer_save(const struct viewer *viewer, const char *path)
{
    const struct gpu_target *target = &viewer->target;
    uint8_t *pixels = malloc((size_t)target->width * (size_t)target->height * 4);
    if (!pixels) return fail("%s: out of memory", path);
    gpu_target_read(viewer->gpu, target, pixels);
    bool good = image_write_png(path, target->width, target->height, 4, pixels);
    free(pixels);
    return good;
}

// ---- the path, frame by frame ----------------------------------------------

static double seconds_now(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + (double)now.tv_nsec * 1e-9;
}

static bool window_closed(const struct viewer *viewer)
{
    GLFWwindow *window = gpu_window(viewer->gpu);
    if (!window) return false;
    glfwPollEvents();
    return glfwWindowShouldClose(window);
}

static bool fly_path(struct viewer *viewer, int frames)
{
    double triangles = 0, begin = seconds_now();
    while (viewer->frame < frames && !window_closed(viewer)) {
        struct view view;
        struct renderer_stats stats = {0};
        scene_view(viewer->scene, viewer->frame, frames, &view);
        if (!viewer_draw(viewer, &view)) return false;
        gpu_finish(viewer->gpu);
        viewer_show(viewer);
        viewer->type->stats(viewer->renderer, &stats);
        triangles += (double)stats.triangles;
    }
    double ms = 1e3 * (seconds_now() - begin) / (viewer->frame ? viewer->frame : 1);
    printf("%s: %d frames of %dx%d, %.2f ms and %.0f triangles a frame on average (%s, %s)\n",
           viewer->type->name, viewer->frame, viewer->scene->width, viewer->scene->height, ms,
           triangles / (viewer->frame ? viewer->frame : 1), gpu_info(viewer->gpu)->backend,
           gpu_info(viewer->gpu)->renderer);
    return true;
}

// ---- the program -----------------------------------------------------------

static bool open_viewer(struct viewer *viewer, const struct options *o)
{
    enum gpu_backend backend = GPU_AUTO;
    if (o->backend) gpu_backend_parse(o->backend, &backend);
    if (backend == GPU_AUTO && o->headless) backend = GPU_OFFSCREEN;
    viewer->scene =
        scene_open(&(struct scene_request){o->scene, o->terrain, o->size[0], o->size[1], o->cache_mib});
    if (!viewer->scene) return false;
    int width = viewer->scene->width, height = viewer->scene->height;
    viewer->gpu = gpu_create(backend, width, height, viewer->type->name, -1);
    return viewer->gpu && gpu_target_init(viewer->gpu, &viewer->target, width, height, GL_RGBA8) &&
           viewer_make_renderer(viewer);
}

static bool run_viewer(struct viewer *viewer, const struct options *o)
{
    bool by_hand = gpu_window(viewer->gpu) && !o->headless && !o->frames;
    if (!gpu_window(viewer->gpu) && !o->headless)
        note("there is no display: flying the path without a window");
    int frames = o->frames ? o->frames : path_frames(viewer->scene->path);
    if (!(by_hand ? viewer_fly(viewer) : fly_path(viewer, frames))) return false;
    return !o->snapshot || viewer_save(viewer, o->snapshot);
}

static void close_viewer(struct viewer *viewer)
{
    viewer->type->destroy(viewer->renderer);
    if (viewer->gpu) gpu_target_finish(&viewer->target);
    gpu_destroy(viewer->gpu);
    scene_destroy(viewer->scene);
}

int viewer_main(int argc, char **argv, const struct renderer_type *type)
{
    struct options o = {0};
    struct viewer viewer = {.type = type};
    int words = 0;
    fill_table(&o, type);
    if (!cli_parse(argc, argv, o.table, NULL, &words)) return EXIT_COMMAND_LINE;
    if (o.help) return print_help(&o, type), EXIT_GOOD;
    if (o.version) return printf("%s (Relief %s)\n", type->name, RELIEF_VERSION), EXIT_GOOD;
    renderer_default_knobs(type, viewer.knobs);
    for (int k = 0; type->knobs[k].name; k++)
        if (o.knobs[k] && !renderer_parse_knob(type, type->knobs[k].name, o.knobs[k], viewer.knobs))
            return EXIT_COMMAND_LINE;
    bool good = open_viewer(&viewer, &o) && run_viewer(&viewer, &o);
    close_viewer(&viewer);
    return good ? EXIT_GOOD : EXIT_WORLD;
}
