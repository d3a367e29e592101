// SPDX-License-Identifier: MIT
#include "common/gl/context.h"
#include "common/report.h"

enum { CAPTURE_TRIANGLES = 1 << 18, TRIANGLE_BYTES = 9 * sizeof(float) };

static bool resize(struct gpu_capture *capture, size_t triangles)
{
    if (!capture->buffer) glGenBuffers(1, &capture->buffer);
    if (!capture->query) glGenQueries(1, &capture->query);
    glBindBuffer(GL_TRANSFORM_FEEDBACK_BUFFER, capture->buffer);
    glBufferData(GL_TRANSFORM_FEEDBACK_BUFFER, (GLsizeiptr)(triangles * TRIANGLE_BYTES), NULL,
                 GL_STREAM_READ);
    GLint64 size = 0; // smaller than asked for when memory is short
    glGetBufferParameteri64v(GL_TRANSFORM_FEEDBACK_BUFFER, GL_BUFFER_SIZE, &size);
    capture->capacity = (size_t)size / TRIANGLE_BYTES;
    if (capture->capacity >= triangles) return true;
    return fail("capture of %zu triangles in one draw: the OpenGL driver has not %zu bytes for it", triangles,
                triangles * TRIANGLE_BYTES);
}

bool gpu_capture_begin(struct gpu *gpu, gpu_capture_fn *receive, void *user)
{
    struct gpu_capture *capture = &gpu->capture;
    if (capture->capacity < CAPTURE_TRIANGLES && !resize(capture, CAPTURE_TRIANGLES)) return false;
    capture->open = true;
    capture->receive = receive;
    capture->user = user;
    glEnable(GL_RASTERIZER_DISCARD);
    return true;
}

void gpu_capture_end(struct gpu *gpu)
{
    gpu_capture_flush(gpu);
    gpu->capture.open = false;
    glDisable(GL_RASTERIZER_DISCARD);
}

void gpu_capture_reserve(struct gpu *gpu, size_t triangles)
{
    struct gpu_capture *capture = &gpu->capture;
    if (!capture->open) return;
    if (capture->bound + triangles > capture->capacity) gpu_capture_flush(gpu);
    if (triangles > capture->capacity) resize(capture, triangles);
    if (!capture->session) {
        glBindBufferBase(GL_TRANSFORM_FEEDBACK_BUFFER, 0, capture->buffer);
        glBeginQuery(GL_TRANSFORM_FEEDBACK_PRIMITIVES_WRITTEN, capture->query);
        glBeginTransformFeedback(GL_TRIANGLES);
        capture->session = true;
    }
    capture->bound += triangles;
}

void gpu_capture_flush(struct gpu *gpu)
{
    struct gpu_capture *capture = &gpu->capture;
    if (!capture->session) return;
    glEndTransformFeedback();
    glEndQuery(GL_TRANSFORM_FEEDBACK_PRIMITIVES_WRITTEN);
    capture->session = false;
    capture->bound = 0;
    GLuint written = 0;
    glGetQueryObjectuiv(capture->query, GL_QUERY_RESULT, &written);
    if (!written) return;
    glBindBuffer(GL_TRANSFORM_FEEDBACK_BUFFER, capture->buffer);
    const float *triangles = glMapBufferRange(
        GL_TRANSFORM_FEEDBACK_BUFFER, 0, (GLsizeiptr)(written * (size_t)TRIANGLE_BYTES), GL_MAP_READ_BIT);
    if (triangles) {
        capture->receive(triangles, written, capture->user);
        glUnmapBuffer(GL_TRANSFORM_FEEDBACK_BUFFER);
    } else {
        gpu->debug_errors++;
    }
}

void gpu_transform_vertices(struct gpu *gpu, GLuint buffer, size_t first, size_t count)
{
    const size_t size = 3 * sizeof(float);
    gpu_capture_flush(gpu); // one transform feedback at a time
    glBindBufferRange(GL_TRANSFORM_FEEDBACK_BUFFER, 0, buffer, (GLintptr)(first * size),
                      (GLsizeiptr)(count * size));
    glEnable(GL_RASTERIZER_DISCARD);
    glBeginTransformFeedback(GL_POINTS);
    glDrawArrays(GL_POINTS, (GLint)first, (GLsizei)count);
    glEndTransformFeedback();
    if (!gpu->capture.open) glDisable(GL_RASTERIZER_DISCARD);
    glBindBufferBase(GL_TRANSFORM_FEEDBACK_BUFFER, 0, 0);
}
