// SPDX-License-Identifier: MIT
#include "common/gl/context.h"
#include "common/report.h"

#include <limits.h>
#include <malloc.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const char *const backend_words[] = {"auto", "glfw", "egl", "osmesa", "auto"};

bool gpu_backend_parse(const char *text, enum gpu_backend *backend)
{
    for (int i = GPU_AUTO; i <= GPU_OSMESA; i++)
        if (strcmp(text, backend_words[i]) == 0) {
            *backend = (enum gpu_backend)i;
            return true;
        }
    return false;
}

static void GLAPIENTRY count_error(GLenum source, GLenum type, GLuint id, GLenum severity, GLsizei length,
                                   const GLchar *message, const void *user)
{
    (void)source, (void)type, (void)id, (void)severity, (void)length;
    struct gpu *gpu = (struct gpu *)user;
    if (gpu->debug_errors++ < 10) note("OpenGL: %s", message);
}

static void listen_to_errors(struct gpu *gpu)
{
    gpu->debug_output = epoxy_gl_version() >= 43 || epoxy_has_gl_extension("GL_KHR_debug");
    if (!gpu->debug_output) return;
    glEnable(GL_DEBUG_OUTPUT);
    glEnable(GL_DEBUG_OUTPUT_SYNCHRONOUS);
    glDebugMessageControl(GL_DONT_CARE, GL_DONT_CARE, GL_DONT_CARE, 0, NULL, GL_FALSE);
    // Errors of calls only: what the shader compiler says is reported, with file and line, where it is asked.
    glDebugMessageControl(GL_DEBUG_SOURCE_API, GL_DEBUG_TYPE_ERROR, GL_DONT_CARE, 0, NULL, GL_TRUE);
    glDebugMessageCallback(count_error, gpu);
}

static bool is_software(const char *renderer)
{
    static const char *const names[] = {"llvmpipe",   "softpipe", "swrast", "SWR", "Software Rasterizer",
                                        "SwiftShader"};
    for (size_t i = 0; i < sizeof names / sizeof *names; i++)
        if (strstr(renderer, names[i])) return true;
    return false;
}

static void fill_info(struct gpu *gpu)
{
    struct gpu_info *info = &gpu->info;
    int version = epoxy_gl_version();
    snprintf(info->vendor, sizeof info->vendor, "%s", (const char *)glGetString(GL_VENDOR));
    snprintf(info->renderer, sizeof info->renderer, "%s", (const char *)glGetString(GL_RENDERER));
    snprintf(info->version, sizeof info->version, "%s", (const char *)glGetString(GL_VERSION));
    info->software = is_software(info->renderer);
    info->clip_control = version >= 45 || epoxy_has_gl_extension("GL_ARB_clip_control");
    info->pipeline_statistics = version >= 46 || epoxy_has_gl_extension("GL_ARB_pipeline_statistics_query");
    info->timer_query = !info->software;
    glGetIntegerv(GL_MAX_TEXTURE_SIZE, &info->max_texture_size);
}

// What every context starts with, whoever made it.
static bool settle(struct gpu *gpu, char reason[CONTEXT_REASON])
{
    int version = epoxy_gl_version();
    if (version < 33 || !glGetString(GL_RENDERER)) {
        snprintf(reason, CONTEXT_REASON, "gives OpenGL %d.%d, not 3.3", version / 10, version % 10);
        return false;
    }
    gpu_keep_driver_loaded();
    fill_info(gpu);
    listen_to_errors(gpu);
    if (gpu->info.clip_control) glClipControl(GL_LOWER_LEFT, GL_ZERO_TO_ONE);
    glGenBuffers(1, &gpu->frame_buffer);
    glBindBuffer(GL_UNIFORM_BUFFER, gpu->frame_buffer);
    glBufferData(GL_UNIFORM_BUFFER, sizeof(struct gpu_frame), NULL, GL_DYNAMIC_DRAW);
    return true;
}

static bool open_context(struct gpu *gpu, const struct context_type *type, int width, int height,
                         const char *title, char reason[CONTEXT_REASON])
{
    if (!type->open(gpu, width, height, title, reason)) return false;
    gpu->type = type;
    if (settle(gpu, reason)) return true;
    type->close(gpu);
    gpu->type = NULL;
    return false;
}

// The ways to try, in order; a window only where there is a display.
static int list_ways(enum gpu_backend backend, const struct context_type *ways[3])
{
    int count = 0;
    bool display = getenv("DISPLAY") || getenv("WAYLAND_DISPLAY");
    bool any = backend == GPU_AUTO || backend == GPU_OFFSCREEN;
    if (backend == GPU_GLFW || (backend == GPU_AUTO && display)) ways[count++] = &context_glfw;
    if (backend == GPU_EGL || any) ways[count++] = &context_egl;
    if (backend == GPU_OSMESA || any) ways[count++] = &context_osmesa;
    return count;
}

static void prepare_process(int threads)
{
#ifdef M_TRIM_THRESHOLD
    mallopt(M_TRIM_THRESHOLD,
            INT_MAX); // else the rasteriser's heap is given back and faulted in again each frame
#endif
    // Mesa's own warnings would stand beside the one line that says what is wrong.
    setenv("EGL_LOG_LEVEL", "fatal", 0);
    setenv("LIBGL_DEBUG", "quiet", 0);
    if (threads < 0) return;
    char text[16];
    snprintf(text, sizeof text, "%d", threads);
    setenv("LP_NUM_THREADS", text, 1);
}

struct gpu *gpu_create_by(const struct context_type *const *ways, int count, const char *word, int width,
                          int height, const char *title, int threads)
{
    prepare_process(threads);
    struct gpu *gpu = calloc(1, sizeof *gpu);
    if (!gpu) {
        fail("out of memory");
        return NULL;
    }
    char reasons[3 * (CONTEXT_REASON + 16)] = "";
    for (int i = 0; i < count; i++) {
        char reason[CONTEXT_REASON] = "unknown reason";
        if (open_context(gpu, ways[i], width, height, title, reason)) return gpu;
        size_t used = strlen(reasons);
        snprintf(reasons + used, sizeof reasons - used, "%s%s: %s", i ? "; " : "", ways[i]->name, reason);
    }
    free(gpu);
    fail("--backend %s: no usable OpenGL, 3.3 core or newer is needed (%s)", word, reasons);
    return NULL;
}

struct gpu *gpu_create(enum gpu_backend backend, int width, int height, const char *title, int threads)
{
    const struct context_type *ways[3];
    int count = list_ways(backend, ways);
    return gpu_create_by(ways, count, backend_words[backend], width, height, title, threads);
}

void gpu_destroy(struct gpu *gpu)
{
    if (!gpu) return;
    glDeleteBuffers(1, &gpu->frame_buffer);
    if (gpu->colour.texture) glDeleteTextures(1, &gpu->colour.texture);
    glDeleteBuffers(1, &gpu->capture.buffer);
    if (gpu->capture.query) glDeleteQueries(1, &gpu->capture.query);
    free(gpu->offsets);
    gpu->type->close(gpu);
    free(gpu);
}

const struct gpu_info *gpu_info(const struct gpu *gpu)
{
    return &gpu->info;
}

struct GLFWwindow *gpu_window(const struct gpu *gpu)
{
    return gpu->window;
}

uint64_t gpu_debug_errors(const struct gpu *gpu)
{
    return gpu->debug_errors;
}

void gpu_reset_counters(struct gpu *gpu)
{
    gpu->counters = (struct gpu_counters){0};
}

struct gpu_counters gpu_counters(const struct gpu *gpu)
{
    return gpu->counters;
}

void gpu_finish(struct gpu *gpu)
{
    glFinish();
    if (gpu->debug_output) return;
    for (GLenum error; (error = glGetError()) != GL_NO_ERROR; gpu->debug_errors++)
        note("OpenGL: error 0x%04x", error);
}
