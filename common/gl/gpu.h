// The OpenGL layer: contexts, programs, targets, and draws and uploads that are counted.
//
// One backend a process.  Everything is drawn to a target (framebuffer object) of ours, by default with
// reversed 32-bit float depth (glClipControl where the driver has it).  OpenGL 3.3 core is enough; newer
// entry points are used only after asking gpu->info.  Only the functions below count and capture: renderers
// draw and upload through them. SPDX-License-Identifier: MIT
#ifndef COMMON_GL_GPU_H
#define COMMON_GL_GPU_H

#include "common/scene/scene.h"
#include "common/view/view.h"

#include <epoxy/gl.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

// ---- contexts --------------------------------------------------------------

enum gpu_backend {
    GPU_AUTO, // a window where there is a display, else as GPU_OFFSCREEN
    GPU_GLFW,
    GPU_EGL,      // a hardware device, else surfaceless, else a software device
    GPU_OSMESA,   // opened at run time
    GPU_OFFSCREEN // EGL, else OSMesa: never a window; no word of its own
};
bool gpu_backend_parse(const char *text, enum gpu_backend *backend); // false: unknown word

struct gpu_info {
    const char *backend; // "egl-surfaceless", "egl-device", "osmesa", "glfw"
    char vendor[128], renderer[256], version[128];
    bool software;     // llvmpipe, softpipe, swrast: timer queries mean nothing (gl-rooflines.md, section 7)
    bool clip_control; // reversed depth is in force
    bool pipeline_statistics; // ARB_pipeline_statistics_query
    bool timer_query;         // and not software
    int max_texture_size;
};

struct gpu_counters {                             // since gpu_reset_counters
    uint64_t draw_calls, triangles, upload_bytes; // triangles as submitted, degenerate ones included
};

// Receives captured triangles: 9 floats each, camera-relative metres, in drawing order.
typedef void gpu_capture_fn(const float *triangles, size_t count, void *user);

struct gpu; // one context

// First call of a process that draws: sets mallopt(M_TRIM_THRESHOLD) and, for software rasterisers,
// LP_NUM_THREADS (threads < 0: leave the environment's, else that many) before the context exists.  NULL
// after one line on stderr. width, height: size of the window for GLFW; others ignore it.
struct gpu *gpu_create(enum gpu_backend backend, int width, int height, const char *title, int threads);
void gpu_destroy(struct gpu *gpu);
const struct gpu_info *gpu_info(const struct gpu *gpu);
struct GLFWwindow *gpu_window(const struct gpu *gpu); // NULL unless the backend is GLFW
uint64_t gpu_debug_errors(const struct gpu *gpu);     // GL errors that KHR_debug reported; tests demand 0

void gpu_reset_counters(struct gpu *gpu);
struct gpu_counters gpu_counters(const struct gpu *gpu);

// ---- passes and programs ---------------------------------------------------

enum render_pass {
    PASS_SHADED,   // colour, with the scene's shading
    PASS_POSITION, // RGBA32F: xyz camera-relative position, w = +1 front facing (seen from above), -1 back
                   // facing by more than the sub-pixel grid can turn around; cleared to 0
    PASS_DEPTH,    // depth only
    PASS_COUNT
};

// A program is assembled from (effects, pass) by one function.  The renderer brings a vertex file (embedded,
// e.g. "clipmap/clipmap.vert") that defines
//     vec3 relative_position();            camera-relative position of this vertex, metres
// and may use the helpers and uniforms of common/gl/frame.glsl.  The common part writes gl_Position
// (invariant) and the varying v_relative, which transform feedback captures.  Fragments are common to all
// renderers, but for shading `own`: then SHADING_OWN is defined in the shaded pass, and the file beside the
// vertex file with the ending .frag defines
//     vec3 surface_normal();               unit normal at this fragment; called before any discard
// and, where the renderer's own defines say OWN_COLOUR, in place of the scene's colour image
//     vec3 ground_colour();
// A renderer without such a file has no shading of its own, and says so in one line.
//
// Fragments outside the map's outline are discarded, which costs each of them a test and the hardware its
// early depth test.  With GPU_INSIDE_OUTLINE among the defines they are not: the same picture where
// view_inside_outline holds for all that is drawn, at less cost.  So a renderer builds both and draws with
// the other what is at the rim.
#define GPU_INSIDE_OUTLINE "#define MAP_UNBOUNDED\n"
// Of programs that draw a whole planet: it has no outline, and height and colour follow its curve.
#define GPU_SPHERE "#define SPHERE\n#define MAP_UNBOUNDED\n"
struct gpu_program {
    GLuint name;
    enum render_pass pass;
};
bool gpu_program_build(struct gpu *gpu, struct gpu_program *program, const char *vertex_file,
                       const char *defines, const struct scene_effects *effects,
                       enum render_pass pass); // false after one line on stderr
void gpu_program_finish(struct gpu_program *program);

// Fills the frame uniform block for a view (transform, eye height, outline, shading) and makes it current.
// Once a view and frame, by the harness or the viewer, before draw().
void gpu_set_view(struct gpu *gpu, const struct terrain *terrain, const struct view *view);

void gpu_use_program(struct gpu *gpu, const struct gpu_program *program); // instead of glUseProgram

// ---- draws (counted; captured while a capture is open) ---------------------

// Indexed draws, `mode` GL_TRIANGLES or GL_TRIANGLE_STRIP, 16- or 32-bit indices from the bound element
// array.  first in indices.
void gpu_draw_elements(struct gpu *gpu, GLenum mode, size_t count, GLenum index_type, size_t first_index,
                       int base_vertex, uint64_t triangles);
void gpu_draw_elements_instanced(struct gpu *gpu, GLenum mode, size_t count, GLenum index_type,
                                 size_t first_index, int base_vertex, int instances, uint64_t triangles);
// Many draws from one index buffer; counts as `draws` draw calls.
void gpu_multi_draw_elements(struct gpu *gpu, GLenum mode, const GLsizei *counts, GLenum index_type,
                             const size_t *first_index, const GLint *base_vertex, int draws,
                             uint64_t triangles);

// ---- uploads (counted) -----------------------------------------------------

void gpu_buffer_data(struct gpu *gpu, GLenum target, size_t size, const void *data, GLenum usage);
void gpu_buffer_sub_data(struct gpu *gpu, GLenum target, size_t offset, size_t size, const void *data);
void gpu_texture_sub_image(struct gpu *gpu, GLenum target, int layer /* <0: 2D */, int x, int y, int width,
                           int height, GLenum format, GLenum type, const void *data);

// ---- targets ---------------------------------------------------------------

struct gpu_target {
    GLuint framebuffer, colour, depth;
    int width, height;
    GLenum colour_format; // GL_RGBA8, GL_RGBA32F, or 0 for depth only
};
bool gpu_target_init(struct gpu *gpu, struct gpu_target *target, int width, int height, GLenum colour_format);
// The same with several samples a pixel, at most GL_MAX_SAMPLES: to be resolved into a plain target before it
// is read.
bool gpu_target_init_multisampled(struct gpu *gpu, struct gpu_target *target, int width, int height,
                                  GLenum colour_format, int samples);
// Averages the samples of each pixel's colour into a target of the same size and format.
void gpu_target_resolve(struct gpu *gpu, const struct gpu_target *from, const struct gpu_target *to);
void gpu_target_finish(struct gpu_target *target);
// Binds, sets viewport and depth state, clears colour (sky for RGBA8, 0 for RGBA32F) and depth.
void gpu_target_begin(struct gpu *gpu, const struct gpu_target *target);
// Reads all pixels, bottom row first: 4 bytes or 4 floats each.
// (a depth-only target: one float each, its depth).
void gpu_target_read(struct gpu *gpu, const struct gpu_target *target, void *pixels);
// Reads the depths of any target, one float each, bottom row first: near / depth along forward; 0 is the sky.
void gpu_target_read_depth(struct gpu *gpu, const struct gpu_target *target, float *depth);

// ---- capture (transform feedback of the renderer's own vertex program) -----

// Between begin and end, draws feed the callback in pieces and nothing is rasterised.  Works with any program
// that gpu_program_build made; draws larger than the buffer are split.
bool gpu_capture_begin(struct gpu *gpu, gpu_capture_fn *receive, void *user);
void gpu_capture_end(struct gpu *gpu);

// Runs the vertex stage of the program in use, which must not be one of the position pass, over vertices of
// the bound vertex array, and writes where it puts them to the same vertices of `buffer`, 3 floats each.
void gpu_transform_vertices(struct gpu *gpu, GLuint buffer, size_t first, size_t count);

void gpu_finish(struct gpu *gpu); // glFinish

#endif
