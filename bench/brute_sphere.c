// brute over a planet: its triangles are made anew for each view (facets.h) and drawn as they are.
// SPDX-License-Identifier: MIT
#include "bench/facets.h"
#include "bench/registry.h"
#include "common/report.h"

#include <math.h>
#include <stdlib.h>

enum { TRIANGLES_A_DRAW = 16384, CORNERS_A_DRAW = 3 * TRIANGLES_A_DRAW }; // 16-bit indices reach so far

struct planet_view {
    struct facets facets;
    GLuint vertex_array, corners;
    size_t uploaded_bytes; // room of the buffer
    GLsizei *counts;
    size_t *first_index; // all 0
    GLint *base_vertices;
    int draws, room;
};

struct planet_renderer {
    struct renderer base;
    struct gpu *gpu;
    const struct terrain *terrain;
    bool cull;
    struct facet_rises rises;
    GLuint indices;
    struct gpu_program programs[PASS_COUNT];
    struct planet_view views[RENDERER_MAX_VIEWS];
};

static void planet_destroy(struct renderer *renderer)
{
    struct planet_renderer *planet = (struct planet_renderer *)renderer;
    if (!planet) return;
    for (int pass = 0; pass < PASS_COUNT; pass++) gpu_program_finish(&planet->programs[pass]);
    for (int v = 0; v < RENDERER_MAX_VIEWS; v++) {
        struct planet_view *own = &planet->views[v];
        if (own->vertex_array) glDeleteVertexArrays(1, &own->vertex_array);
        if (own->corners) glDeleteBuffers(1, &own->corners);
        facets_finish(&own->facets);
        free(own->counts);
        free(own->first_index);
        free(own->base_vertices);
    }
    if (planet->indices) glDeleteBuffers(1, &planet->indices);
    facet_rises_finish(&planet->rises);
    free(planet);
}

// Corners are drawn in their order: the indices only serve draws that are counted and captured.
static void upload_indices(struct planet_renderer *planet)
{
    static uint16_t indices[CORNERS_A_DRAW];
    for (int k = 0; k < CORNERS_A_DRAW; k++) indices[k] = (uint16_t)k;
    glGenBuffers(1, &planet->indices);
    glBindBuffer(GL_ELEMENT_ARRAY_BUFFER, planet->indices);
    gpu_buffer_data(planet->gpu, GL_ELEMENT_ARRAY_BUFFER, sizeof indices, indices, GL_STATIC_DRAW);
}

static struct renderer *planet_create(const struct renderer_desc *desc)
{
    struct planet_renderer *planet = calloc(1, sizeof *planet);
    if (!planet) return fail("out of memory"), NULL;
    struct scene_effects common = scene_effects_common(desc->effects);
    planet->base.type = &brute_sphere_renderer;
    planet->gpu = desc->gpu;
    planet->terrain = desc->terrain;
    planet->cull = desc->knobs[0] > 0;
    glBindVertexArray(0);
    upload_indices(planet);
    bool good = facet_rises_init(&planet->rises, desc->terrain);
    for (int pass = 0; pass < PASS_COUNT; pass++)
        good = good && gpu_program_build(planet->gpu, &planet->programs[pass], "common/gl/plain.vert",
                                         GPU_SPHERE, &common, pass);
    if (good) return &planet->base;
    planet_destroy(&planet->base);
    return NULL;
}

static bool lay_draws(struct planet_view *own)
{
    own->draws = (int)((own->facets.triangles + TRIANGLES_A_DRAW - 1) / TRIANGLES_A_DRAW);
    if (own->draws > own->room) {
        int room = 2 * own->draws;
        GLsizei *counts = realloc(own->counts, (size_t)room * sizeof *counts);
        if (counts) own->counts = counts;
        GLint *base = realloc(own->base_vertices, (size_t)room * sizeof *base);
        if (base) own->base_vertices = base;
        free(own->first_index);
        own->first_index = calloc((size_t)room, sizeof *own->first_index);
        if (!counts || !base || !own->first_index) return fail("out of memory");
        own->room = room;
    }
    for (int d = 0; d < own->draws; d++) {
        size_t left = own->facets.triangles - (size_t)d * TRIANGLES_A_DRAW;
        own->counts[d] = 3 * (GLsizei)(left < TRIANGLES_A_DRAW ? left : TRIANGLES_A_DRAW);
        own->base_vertices[d] = d * CORNERS_A_DRAW;
    }
    return true;
}

static void upload_corners(struct planet_renderer *planet, struct planet_view *own)
{
    size_t size = own->facets.triangles * 3 * sizeof *own->facets.corners;
    if (!own->vertex_array) {
        glGenVertexArrays(1, &own->vertex_array);
        glGenBuffers(1, &own->corners);
    }
    glBindVertexArray(own->vertex_array);
    glBindBuffer(GL_ARRAY_BUFFER, own->corners);
    glBindBuffer(GL_ELEMENT_ARRAY_BUFFER, planet->indices);
    glEnableVertexAttribArray(0);
    glVertexAttribPointer(0, 3, GL_FLOAT, GL_FALSE, 3 * sizeof(float), NULL);
    if (size > own->uploaded_bytes) {
        own->uploaded_bytes = own->facets.room * 3 * sizeof *own->facets.corners;
        gpu_buffer_data(planet->gpu, GL_ARRAY_BUFFER, own->uploaded_bytes, NULL, GL_STREAM_DRAW);
    }
    if (size) gpu_buffer_sub_data(planet->gpu, GL_ARRAY_BUFFER, 0, size, own->facets.corners);
    glBindVertexArray(0);
}

static bool planet_update(struct renderer *renderer, const struct view *views, int count)
{
    struct planet_renderer *planet = (struct planet_renderer *)renderer;
    double half = 0.5 * baselines_bytes_present() / RENDERER_MAX_VIEWS / 2; // held here and by the buffer
    size_t most_bytes = (size_t)fmin(half, 36.0 * INT32_MAX / 3);
    for (int v = 0; v < count; v++) {
        struct planet_view *own = &planet->views[v];
        if (!facets_make(&own->facets, &planet->rises, planet->terrain, &views[v], planet->cull,
                         FACETS_SAG_PX, most_bytes) ||
            !lay_draws(own))
            return false;
        upload_corners(planet, own);
    }
    return true;
}

static void planet_draw(struct renderer *renderer, int view_index, enum render_pass pass)
{
    struct planet_renderer *planet = (struct planet_renderer *)renderer;
    const struct planet_view *own = &planet->views[view_index];
    if (!own->draws) return;
    gpu_use_program(planet->gpu, &planet->programs[pass]);
    glBindVertexArray(own->vertex_array);
    gpu_multi_draw_elements(planet->gpu, GL_TRIANGLES, own->counts, GL_UNSIGNED_SHORT, own->first_index,
                            own->base_vertices, own->draws, own->facets.triangles);
    glBindVertexArray(0);
}

static void planet_begin_frame(struct renderer *renderer, int frame)
{
    (void)renderer, (void)frame;
}

static void planet_stats(const struct renderer *renderer, struct renderer_stats *stats)
{
    const struct planet_renderer *planet = (const struct planet_renderer *)renderer;
    const struct facets *facets = &planet->views[0].facets;
    uint64_t resident = CORNERS_A_DRAW * sizeof(uint16_t);
    for (int v = 0; v < RENDERER_MAX_VIEWS; v++) resident += planet->views[v].uploaded_bytes;
    *stats = (struct renderer_stats){
        .triangles = facets->triangles,
        .claimed_error_px = NAN,
        .resident_bytes = resident,
        .counters = {{"blocks drawn", facets->blocks_drawn}, {"blocks", facets->blocks}},
    };
}

const struct renderer_type brute_sphere_renderer = {
    .name = "brute",
    .create = planet_create,
    .begin_frame = planet_begin_frame,
    .update = planet_update,
    .draw = planet_draw,
    .stats = planet_stats,
    .destroy = planet_destroy,
};
