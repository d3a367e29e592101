// SPDX-License-Identifier: MIT
#include "common/gl/context.h"
#include "common/report.h"

#include <stdlib.h>

static size_t index_size(GLenum index_type)
{
    return index_type == GL_UNSIGNED_SHORT ? 2 : 4;
}

static const void *index_offset(size_t first_index, GLenum index_type)
{
    return (const void *)(uintptr_t)(first_index * index_size(index_type));
}

static void count_draws(struct gpu *gpu, uint64_t draws, uint64_t triangles)
{
    gpu->counters.draw_calls += draws;
    gpu->counters.triangles += triangles;
}

// Most triangles that a draw can write: fewer come out of a strip that primitive restart breaks.
static size_t most_triangles(GLenum mode, size_t count)
{
    if (mode == GL_TRIANGLES) return count / 3;
    return count < 3 ? 0 : count - 2;
}

static void draw_captured(struct gpu *gpu, GLenum mode, size_t count, GLenum index_type, size_t first_index,
                          int base_vertex)
{
    // A list is split where the buffer is full; a strip could not be without losing its winding.
    size_t step = mode == GL_TRIANGLES && gpu->capture.capacity ? 3 * gpu->capture.capacity : count;
    for (size_t done = 0; done < count; done += step) {
        size_t part = count - done < step ? count - done : step;
        gpu_capture_reserve(gpu, most_triangles(mode, part));
        glDrawElementsBaseVertex(mode, (GLsizei)part, index_type,
                                 index_offset(first_index + done, index_type), base_vertex);
    }
}

void gpu_draw_elements(struct gpu *gpu, GLenum mode, size_t count, GLenum index_type, size_t first_index,
                       int base_vertex, uint64_t triangles)
{
    count_draws(gpu, 1, triangles);
    if (gpu->capture.open)
        draw_captured(gpu, mode, count, index_type, first_index, base_vertex);
    else
        glDrawElementsBaseVertex(mode, (GLsizei)count, index_type, index_offset(first_index, index_type),
                                 base_vertex);
}

void gpu_draw_elements_instanced(struct gpu *gpu, GLenum mode, size_t count, GLenum index_type,
                                 size_t first_index, int base_vertex, int instances, uint64_t triangles)
{
    count_draws(gpu, 1, triangles);
    // Not split when captured: gl_InstanceID counts from 0 in every draw.
    if (instances > 0) gpu_capture_reserve(gpu, most_triangles(mode, count) * (size_t)instances);
    glDrawElementsInstancedBaseVertex(mode, (GLsizei)count, index_type, index_offset(first_index, index_type),
                                      instances, base_vertex);
}

static bool reserve_offsets(struct gpu *gpu, int draws)
{
    if (draws <= gpu->offsets_size) return true;
    int size = draws + draws / 2;
    const void **offsets = realloc(gpu->offsets, (size_t)size * sizeof *offsets);
    if (!offsets) return false;
    gpu->offsets = offsets;
    gpu->offsets_size = size;
    return true;
}

void gpu_multi_draw_elements(struct gpu *gpu, GLenum mode, const GLsizei *counts, GLenum index_type,
                             const size_t *first_index, const GLint *base_vertex, int draws,
                             uint64_t triangles)
{
    count_draws(gpu, (uint64_t)draws, triangles);
    if (gpu->capture.open || !reserve_offsets(gpu, draws)) {
        for (int i = 0; i < draws; i++)
            draw_captured(gpu, mode, (size_t)counts[i], index_type, first_index[i], base_vertex[i]);
        return;
    }
    for (int i = 0; i < draws; i++) gpu->offsets[i] = index_offset(first_index[i], index_type);
    glMultiDrawElementsBaseVertex(mode, counts, index_type, gpu->offsets, draws, base_vertex);
}

void gpu_buffer_data(struct gpu *gpu, GLenum target, size_t size, const void *data, GLenum usage)
{
    if (data) gpu->counters.upload_bytes += size;
    glBufferData(target, (GLsizeiptr)size, data, usage);
}

void gpu_buffer_sub_data(struct gpu *gpu, GLenum target, size_t offset, size_t size, const void *data)
{
    gpu->counters.upload_bytes += size;
    glBufferSubData(target, (GLintptr)offset, (GLsizeiptr)size, data);
}

static size_t pixel_size(GLenum format, GLenum type)
{
    size_t channels = format == GL_RED || format == GL_RED_INTEGER || format == GL_DEPTH_COMPONENT ? 1
                      : format == GL_RG || format == GL_RG_INTEGER                                 ? 2
                      : format == GL_RGB || format == GL_RGB_INTEGER                               ? 3
                                                                                                   : 4;
    switch (type) {
    case GL_UNSIGNED_BYTE:
    case GL_BYTE:
        return channels;
    case GL_UNSIGNED_SHORT:
    case GL_SHORT:
    case GL_HALF_FLOAT:
        return 2 * channels;
    default:
        return 4 * channels;
    }
}

void gpu_texture_sub_image(struct gpu *gpu, GLenum target, int layer, int x, int y, int width, int height,
                           GLenum format, GLenum type, const void *data)
{
    gpu->counters.upload_bytes += (size_t)width * (size_t)height * pixel_size(format, type);
    glPixelStorei(GL_UNPACK_ALIGNMENT, 1); // rows follow each other without gaps
    if (layer < 0)
        glTexSubImage2D(target, 0, x, y, width, height, format, type, data);
    else
        glTexSubImage3D(target, 0, x, y, layer, width, height, 1, format, type, data);
}
