// Inside the OpenGL layer: what struct gpu holds, and the three ways to a context.  Only common/gl and its
// tests include this. SPDX-License-Identifier: MIT
#ifndef COMMON_GL_CONTEXT_H
#define COMMON_GL_CONTEXT_H

#include "common/gl/gpu.h"

enum { CONTEXT_REASON = 256 };

// A way to a context.  open() makes an OpenGL 3.3 core context (or newer) current on this thread; on failure
// it leaves nothing behind, says why in `reason` in a few words and returns false.  It prints nothing: the
// caller may have another way.
struct context_type {
    const char *name; // the word that --backend takes
    bool (*open)(struct gpu *gpu, int width, int height, const char *title, char reason[CONTEXT_REASON]);
    void (*close)(struct gpu *gpu);
};
extern const struct context_type context_egl; // a hardware device, else surfaceless, else a software device
extern const struct context_type context_egl_device; // a device, hardware or software
extern const struct context_type context_osmesa, context_glfw;

// The uniform block `frame` of frame.glsl, std140.
struct gpu_frame {
    float clip_from_relative[16];
    float outline[4], height[4], shade[4], axes[3][4];
};
_Static_assert(offsetof(struct gpu_frame, outline) == 64, "std140");
_Static_assert(offsetof(struct gpu_frame, height) == 80, "std140");
_Static_assert(offsetof(struct gpu_frame, shade) == 96, "std140");
_Static_assert(offsetof(struct gpu_frame, axes) == 112, "std140");
_Static_assert(sizeof(struct gpu_frame) == 160, "std140");
enum { GPU_FRAME_BINDING = 0 };

// An open capture.  Draws are gathered in one transform feedback session until the buffer might overflow or
// the program changes.
struct gpu_capture {
    GLuint buffer, query;
    size_t capacity; // triangles that the buffer holds
    size_t bound;    // at most this many were written in the current session
    bool open;       // between gpu_capture_begin and gpu_capture_end
    bool session;    // between glBeginTransformFeedback and glEndTransformFeedback
    gpu_capture_fn *receive;
    void *user;
};

// The scene's colour image, bound to its unit for good once a program was built that reads it.
enum { GPU_COLOUR_UNIT = 15 }; // the last that every OpenGL 3.3 has
struct gpu_colour {
    GLuint texture;
    char sha256[65]; // of the pixels that it holds
    bool planet;     // levels as planet_image.h has them
};

struct gpu {
    const struct context_type *type;
    struct gpu_info info;
    uint64_t debug_errors;
    bool debug_output; // KHR_debug reports errors; without it glGetError is asked now and then
    struct gpu_counters counters;
    struct gpu_capture capture;
    GLuint frame_buffer; // the uniform block
    struct gpu_colour colour;
    GLuint program;       // last given to gpu_use_program
    const void **offsets; // scratch of gpu_multi_draw_elements
    int offsets_size;
    // The window system's handles; each way to a context uses its own.
    void *library, *display, *context, *surface;
    struct GLFWwindow *window;
};

// gpu_create with the ways to try given, in order; `word` is what --backend was given.
struct gpu *gpu_create_by(const struct context_type *const *ways, int count, const char *word, int width,
                          int height, const char *title, int threads);

// Under the address sanitizer, keeps the driver in memory until leaks have been looked for; else nothing.
void gpu_keep_driver_loaded(void);

// Uploads a frame block as it is and makes it current (gpu_set_view fills one from a view).
void gpu_set_frame(struct gpu *gpu, const struct gpu_frame *frame);

// Without glClipControl the hardware maps z from [-w, w]: turns z into 2 z - w, which comes out as the same
// depth, near 1, far 0, though with fewer good digits.
void gpu_frame_without_clip_control(struct gpu_frame *frame);

// Capture of one draw: gpu_capture_reserve before it says how many triangles it may write, so that the
// session has room. gpu_capture_flush hands over what was gathered.  Both do nothing without an open capture.
void gpu_capture_reserve(struct gpu *gpu, size_t triangles);
void gpu_capture_flush(struct gpu *gpu);

#endif
