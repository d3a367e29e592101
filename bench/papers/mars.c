// Geometry clipmapping for Mars, Table 3: handing over every vertex each frame, one vertex buffer, clipmaps.
// SPDX-License-Identifier: MIT
#include "bench/papers/papers.h"
#include "bench/registry.h"
#include "clipmap/clipmap.h"
#include "common/report.h"
#include "common/terrain/generate.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

// ---- "GL draw primitives": the application hands every vertex over anew ------------------------

struct immediate {
    struct renderer base;
    struct gpu *gpu;
    const struct terrain *terrain;
    struct terrain_level level;
    int width, height;
    struct gpu_program programs[PASS_COUNT];
    GLuint vertex_array, vertices, indices;
    float (*strip)[3]; // of one row of cells
    struct view views[RENDERER_MAX_VIEWS];
};

static void immediate_destroy(struct renderer *renderer)
{
    struct immediate *m = (struct immediate *)renderer;
    if (!m) return;
    for (int pass = 0; pass < PASS_COUNT; pass++) gpu_program_finish(&m->programs[pass]);
    if (m->vertex_array) glDeleteVertexArrays(1, &m->vertex_array);
    if (m->vertices) glDeleteBuffers(1, &m->vertices);
    if (m->indices) glDeleteBuffers(1, &m->indices);
    free(m->strip);
    free(m);
}

static bool create_buffers(struct immediate *m)
{
    size_t count = 2 * (size_t)m->width;
    uint32_t *indices = malloc(count * sizeof *indices);
    m->strip = malloc(count * sizeof *m->strip);
    if (!indices || !m->strip) return free(indices), fail("immediate: out of memory");
    for (size_t i = 0; i < count; i++) indices[i] = (uint32_t)i;
    glGenVertexArrays(1, &m->vertex_array);
    glGenBuffers(1, &m->vertices);
    glGenBuffers(1, &m->indices);
    glBindVertexArray(m->vertex_array);
    glBindBuffer(GL_ELEMENT_ARRAY_BUFFER, m->indices);
    gpu_buffer_data(m->gpu, GL_ELEMENT_ARRAY_BUFFER, count * sizeof *indices, indices, GL_STATIC_DRAW);
    glBindBuffer(GL_ARRAY_BUFFER, m->vertices);
    glEnableVertexAttribArray(0);
    glVertexAttribPointer(0, 3, GL_FLOAT, GL_FALSE, 0, NULL);
    glBindVertexArray(0);
    free(indices);
    return true;
}

static struct renderer *immediate_create(const struct renderer_desc *desc)
{
    struct immediate *m = calloc(1, sizeof *m);
    if (!m) return fail("immediate: out of memory"), NULL;
    m->base.type = &immediate_renderer;
    m->gpu = desc->gpu;
    m->terrain = desc->terrain;
    m->level = terrain_level(desc->terrain, terrain_info(desc->terrain)->finest);
    m->width = (int)(m->level.extent.x1 - m->level.extent.x0);
    m->height = (int)(m->level.extent.y1 - m->level.extent.y0);
    bool good = create_buffers(m);
    for (int pass = 0; pass < PASS_COUNT && good; pass++)
        good = gpu_program_build(m->gpu, &m->programs[pass], "bench/roofline.vert", "", desc->effects,
                                 (enum render_pass)pass);
    if (good) return &m->base;
    immediate_destroy(&m->base);
    return NULL;
}

static void immediate_begin_frame(struct renderer *renderer, int frame)
{
    (void)renderer, (void)frame;
}

static bool immediate_update(struct renderer *renderer, const struct view *views, int count)
{
    for (int v = 0; v < count; v++) ((struct immediate *)renderer)->views[v] = views[v];
    return true;
}

// Camera-relative places of one row of samples, every other vertex of the strip, as bench/grid.vert makes
// them.
static void fill_row(const struct immediate *m, const struct view *view, const struct view_origin *origin,
                     int row, int first)
{
    size_t stride;
    int32_t eye_base;
    float eye_fraction, quantum = (float)terrain_info(m->terrain)->quantum_m;
    const float spacing[2] = {(float)m->level.spacing_m[0], (float)m->level.spacing_m[1]};
    const int32_t *samples =
        terrain_samples(m->terrain, terrain_info(m->terrain)->finest, &stride) + (size_t)row * stride;
    view_eye_quanta(view, &eye_base, &eye_fraction);
    float y = ((float)(m->level.extent.y0 + row - origin->base[1]) - origin->fraction[1]) * spacing[1];
    for (int i = 0; i < m->width; i++) {
        float *vertex = m->strip[2 * i + first];
        vertex[0] = ((float)(m->level.extent.x0 + i - origin->base[0]) - origin->fraction[0]) * spacing[0];
        vertex[1] = y;
        vertex[2] = (((float)samples[i] - (float)eye_base) - eye_fraction) * quantum;
    }
}

// A strip for each row of cells; north before south, so that cells are split along (i, j)-(i+1, j+1).
static void immediate_draw(struct renderer *renderer, int view_index, enum render_pass pass)
{
    struct immediate *m = (struct immediate *)renderer;
    const struct view *view = &m->views[view_index];
    struct view_origin origin = view_level_origin(view, terrain_info(m->terrain)->finest);
    gpu_use_program(m->gpu, &m->programs[pass]);
    glBindVertexArray(m->vertex_array);
    glBindBuffer(GL_ARRAY_BUFFER, m->vertices);
    for (int j = 0; j + 1 < m->height; j++) {
        fill_row(m, view, &origin, j + 1, 0);
        fill_row(m, view, &origin, j, 1);
        size_t count = 2 * (size_t)m->width;
        gpu_buffer_data(m->gpu, GL_ARRAY_BUFFER, count * sizeof *m->strip, m->strip, GL_STREAM_DRAW);
        gpu_draw_elements(m->gpu, GL_TRIANGLE_STRIP, count, GL_UNSIGNED_INT, 0, 0, count - 2);
    }
    glBindVertexArray(0);
}

static void immediate_stats(const struct renderer *renderer, struct renderer_stats *stats)
{
    const struct immediate *m = (const struct immediate *)renderer;
    *stats = (struct renderer_stats){.triangles = 2 * (uint64_t)(m->width - 1) * (uint64_t)(m->height - 1),
                                     .claimed_error_px = NAN};
}

static const struct renderer_knob no_knobs[] = {{0}};

const struct renderer_type immediate_renderer = {
    .name = "immediate",
    .summary = "every triangle, its vertices handed over anew each frame",
    .knobs = no_knobs,
    .create = immediate_create,
    .begin_frame = immediate_begin_frame,
    .update = immediate_update,
    .draw = immediate_draw,
    .stats = immediate_stats,
    .destroy = immediate_destroy,
};

// ---- Table 3 -----------------------------------------------------------------------------------

enum { SIDE = 675, FRAMES = 24, COMPARED = 9, ONE_BUFFER = 2 };

static struct terrain *made_terrain(void)
{
    struct heightfield field;
    struct generate_options options = {
        .kind = "fractal", .width = SIDE, .height = SIDE, .spacing_m = 30, .seed = PAPERS_SEED};
    if (!generate(&field, &options)) return NULL;
    struct terrain_grid grid = {"fractal", field.samples,   SIDE,          SIDE, {0, 0},
                                {30, 30},  field.quantum_m, field.offset_m};
    struct terrain *terrain = terrain_from_grid(&grid, NULL);
    heightfield_finish(&field);
    return terrain;
}

static const struct {
    const char *label;
    double printed_fps;
    struct papers_flight flight;
} compared[COMPARED] = {
    {"nothing: an empty frame", NAN, {.type = &null_renderer}},
    {"draw primitives", 8, {.type = &immediate_renderer}},
    {"one vertex buffer", 150, {.type = &brute_renderer, .knobs = {"cull", "off"}}},
    {"clipmap n = 15", 450, {.type = &clipmap_renderer, .knobs = {"n", "15"}}},
    {"clipmap n = 31", 400, {.type = &clipmap_renderer, .knobs = {"n", "31"}}},
    {"clipmap n = 63", 300, {.type = &clipmap_renderer, .knobs = {"n", "63"}}},
    {"clipmap n = 15, full rebuild",
     NAN,
     {.type = &clipmap_renderer, .knobs = {"n", "15", "refill", "whole"}}},
    {"clipmap n = 31, full rebuild",
     NAN,
     {.type = &clipmap_renderer, .knobs = {"n", "31", "refill", "whole"}}},
    {"clipmap n = 63, full rebuild",
     NAN,
     {.type = &clipmap_renderer, .knobs = {"n", "63", "refill", "whole"}}},
};

static void fill_rows(struct papers_table *table, const struct papers_flight *flights)
{
    int printed = papers_column(table, "frames", "1/s", true),
        fps = papers_column(table, "frames", "1/s", false);
    int printed_ratio = papers_column(table, "to one buffer", "x", true);
    int ratio = papers_column(table, "to one buffer", "x", false);
    int frame = papers_column(table, "frame", "ms", false),
        update = papers_column(table, "update", "ms", false);
    int triangles = papers_column(table, "triangles", "a frame", false);
    for (int k = 0; k < COMPARED; k++) {
        double *values = papers_row(table, "%s", compared[k].label);
        values[printed] = compared[k].printed_fps;
        values[printed_ratio] = compared[k].printed_fps / compared[ONE_BUFFER].printed_fps;
        values[fps] = 1000 / flights[k].frame_ms;
        values[ratio] = flights[ONE_BUFFER].frame_ms / flights[k].frame_ms;
        values[frame] = flights[k].frame_ms;
        values[update] = flights[k].update_ms;
        values[triangles] = round(flights[k].triangles);
    }
}

bool papers_mars_rendering(struct papers *papers, struct papers_table *table)
{
    struct papers_flight flights[COMPARED];
    struct scene *scene = papers_scene(papers, made_terrain());
    for (int k = 0; k < COMPARED; k++) flights[k] = compared[k].flight;
    snprintf(table->title, sizeof table->title, "Clipmaps against drawing everything, %d x %d samples", SIDE,
             SIDE);
    snprintf(table->row_name, sizeof table->row_name, "way of drawing");
    bool good = scene && papers_fly(papers, scene, FRAMES, flights, COMPARED);
    scene_destroy(scene);
    if (!good) return false;
    fill_rows(table, flights);
    papers_note(table, "Printed: GeForce 7900 GS or 6800, clipmaps as lower bounds (+450, +400, +300), n = "
                       "16, 32, 64, 5 levels, no stitching, no culling. An even n puts the right perimeter "
                       "on odd vertices, so n is odd here. Five levels of n = 16 span 256 of the 675 "
                       "samples: here there are as many levels as cover the map.");
    papers_note(
        table,
        "Here a made fractal of the same size (the paper's part of Mars is not known), %d x %d pixels, %s.",
        papers->width, papers->height, gpu_info(papers->gpu)->renderer);
    papers_note(table, "Draw primitives: the paper's glBegin and glEnd are gone from OpenGL; here the "
                       "program computes every vertex anew and hands over a strip for each row, each frame.");
    if (papers->cpu_times)
        papers_note(table, "On a software rasteriser handing vertices over is a copy in memory, small beside "
                           "setting up 900 thousand triangles: so it costs no more than one buffer, where "
                           "the paper's bus and its calls for each vertex made it 19 times slower.");
    papers_note(table,
                "Full rebuild: every level is read and uploaded whole each frame, as the paper's first "
                "version did; the other clipmaps read what the motion exposes, and draw the same picture.");
    return true;
}
