// The baselines: null, brute and decimated.  brute and decimated are one uniform grid over the samples of the
// finest level, every sample or every step-th; the copy-me example of a renderer. SPDX-License-Identifier:
// MIT
#include "bench/registry.h"
#include "common/report.h"
#include "common/view/frustum.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

// ---- null ------------------------------------------------------------------

static struct renderer *null_create(const struct renderer_desc *desc)
{
    (void)desc;
    struct renderer *renderer = calloc(1, sizeof *renderer);
    if (!renderer) return fail("out of memory"), NULL;
    renderer->type = &null_renderer;
    return renderer;
}

static void null_begin_frame(struct renderer *renderer, int frame)
{
    (void)renderer, (void)frame;
}

static bool null_update(struct renderer *renderer, const struct view *views, int count)
{
    (void)renderer, (void)views, (void)count;
    return true;
}

static void null_draw(struct renderer *renderer, int view_index, enum render_pass pass)
{
    (void)renderer, (void)view_index, (void)pass;
}

static void null_stats(const struct renderer *renderer, struct renderer_stats *stats)
{
    (void)renderer;
    *stats = (struct renderer_stats){.claimed_error_px = NAN};
}

static void null_destroy(struct renderer *renderer)
{
    free(renderer);
}

static const struct renderer_knob no_knobs[] = {{0}};

const struct renderer_type null_renderer = {
    .name = "null",
    .summary = "clears and draws nothing: the cost of the harness",
    .knobs = no_knobs,
    .spheres = true,
    .create = null_create,
    .begin_frame = null_begin_frame,
    .update = null_update,
    .draw = null_draw,
    .stats = null_stats,
    .destroy = null_destroy,
};

// ---- the uniform grid ------------------------------------------------------

enum { KNOB_STEP, KNOB_CULL, KNOB_COUNT };
enum { BLOCK = 32 }; // quads along a culled block: small enough to cull well, large enough for few draws

struct grid_block {
    size_t first_index;
    GLsizei count;
    int64_t low[2], high[2]; // samples relative to the extent's first
    int32_t min_q, max_q;
};

struct grid_selection { // what update() chose for one view
    int draws;
    uint64_t triangles;
    GLsizei *counts;
    size_t *first_index;
    struct view view;
};

struct grid_renderer {
    struct renderer base;
    struct gpu *gpu;
    const struct terrain *terrain;
    bool cull;
    int step;
    int64_t columns, rows, stride; // vertices; stride >= columns
    struct terrain_level level;
    struct gpu_program programs[PASS_COUNT];
    struct grid_uniforms {
        GLint grid, first, fraction, spacing;
    } uniforms[PASS_COUNT];
    GLuint vertex_array, heights, indices;
    size_t index_count, resident_bytes;
    struct grid_block *blocks;
    int block_count;
    GLint *base_vertices; // all 0
    struct grid_selection selections[RENDERER_MAX_VIEWS];
};

static void grid_destroy(struct renderer *renderer)
{
    struct grid_renderer *grid = (struct grid_renderer *)renderer;
    if (!grid) return;
    for (int pass = 0; pass < PASS_COUNT; pass++) gpu_program_finish(&grid->programs[pass]);
    if (grid->vertex_array) glDeleteVertexArrays(1, &grid->vertex_array);
    if (grid->heights) glDeleteBuffers(1, &grid->heights);
    if (grid->indices) glDeleteBuffers(1, &grid->indices);
    for (int v = 0; v < RENDERER_MAX_VIEWS; v++) {
        free(grid->selections[v].counts);
        free(grid->selections[v].first_index);
    }
    free(grid->base_vertices);
    free(grid->blocks);
    free(grid);
}

// Sample under vertex k of an axis: the last vertex stands on the map's edge even when step does not divide
// its size.
static int64_t vertex_sample(int64_t vertex, int step, int64_t samples)
{
    int64_t sample = vertex * step;
    return sample < samples - 1 ? sample : samples - 1;
}

static int64_t vertex_count(int64_t samples, int step)
{
    return (samples - 1 + step - 1) / step + 1;
}

static bool upload_heights(struct grid_renderer *grid)
{
    const struct terrain_extent *extent = &grid->level.extent;
    int level = terrain_info(grid->terrain)->finest;
    int64_t width = extent->x1 - extent->x0, height = extent->y1 - extent->y0;
    int32_t *row = malloc((size_t)width * sizeof *row);
    float *vertices = calloc((size_t)(grid->stride * grid->rows), sizeof *vertices);
    bool good = row && vertices;
    for (int64_t j = 0; good && j < grid->rows; j++) {
        terrain_window(grid->terrain, level, extent->x0, extent->y0 + vertex_sample(j, grid->step, height),
                       (int)width, 1, row, TERRAIN_WAIT);
        for (int64_t i = 0; i < grid->columns; i++)
            vertices[j * grid->stride + i] = (float)row[vertex_sample(i, grid->step, width)];
    }
    if (good) {
        size_t size = (size_t)(grid->stride * grid->rows) * sizeof *vertices;
        glBindBuffer(GL_ARRAY_BUFFER, grid->heights);
        gpu_buffer_data(grid->gpu, GL_ARRAY_BUFFER, size, vertices, GL_STATIC_DRAW);
        grid->resident_bytes += size;
    }
    free(row);
    free(vertices);
    return good ||
           fail("out of memory for %lld x %lld heights", (long long)grid->columns, (long long)grid->rows);
}

// Two triangles a quad, counter-clockwise from above, split along (i, j)-(i+1, j+1).
static uint32_t *quad_indices(uint32_t *out, int64_t i, int64_t j, int64_t stride)
{
    uint32_t sw = (uint32_t)(j * stride + i), se = sw + 1, nw = sw + (uint32_t)stride, ne = nw + 1;
    const uint32_t corners[6] = {sw, se, ne, sw, ne, nw};
    memcpy(out, corners, sizeof corners);
    return out + 6;
}

// Without culling one block holds the whole map: one row-major list, one draw.
static void lay_block(struct grid_renderer *grid, struct grid_block *block, int64_t i0, int64_t j0,
                      int64_t i1, int64_t j1, uint32_t *all, uint32_t **next)
{
    const struct terrain_extent *extent = &grid->level.extent;
    int64_t width = extent->x1 - extent->x0, height = extent->y1 - extent->y0;
    block->first_index = (size_t)(*next - all);
    for (int64_t j = j0; j < j1; j++)
        for (int64_t i = i0; i < i1; i++) *next = quad_indices(*next, i, j, grid->stride);
    block->count = (GLsizei)((size_t)(*next - all) - block->first_index);
    block->low[0] = vertex_sample(i0, grid->step, width),
    block->low[1] = vertex_sample(j0, grid->step, height);
    block->high[0] = vertex_sample(i1, grid->step, width),
    block->high[1] = vertex_sample(j1, grid->step, height);
    terrain_bounds(grid->terrain, terrain_info(grid->terrain)->finest, extent->x0 + block->low[0],
                   extent->y0 + block->low[1], extent->x0 + block->high[0], extent->y0 + block->high[1],
                   &block->min_q, &block->max_q);
}

static bool upload_indices(struct grid_renderer *grid)
{
    int64_t quads_x = grid->columns - 1, quads_y = grid->rows - 1;
    int64_t size = grid->cull ? BLOCK : quads_x > quads_y ? quads_x : quads_y;
    if (size < 1) size = 1;
    int64_t across = (quads_x + size - 1) / size, along = (quads_y + size - 1) / size;
    grid->index_count = (size_t)(6 * quads_x * quads_y);
    grid->blocks = calloc((size_t)(across * along) + 1, sizeof *grid->blocks);
    uint32_t *indices = malloc(grid->index_count * sizeof *indices + 1), *next = indices;
    if (!grid->blocks || !indices)
        return free(indices), fail("out of memory for %zu indices", grid->index_count);
    for (int64_t b = 0; b < across * along; b++) {
        int64_t i0 = b % across * size, j0 = b / across * size;
        int64_t i1 = i0 + size < quads_x ? i0 + size : quads_x,
                j1 = j0 + size < quads_y ? j0 + size : quads_y;
        lay_block(grid, &grid->blocks[grid->block_count++], i0, j0, i1, j1, indices, &next);
    }
    glBindBuffer(GL_ELEMENT_ARRAY_BUFFER, grid->indices);
    gpu_buffer_data(grid->gpu, GL_ELEMENT_ARRAY_BUFFER, grid->index_count * sizeof *indices, indices,
                    GL_STATIC_DRAW);
    grid->resident_bytes += grid->index_count * sizeof *indices;
    free(indices);
    return true;
}

static bool build_programs(struct grid_renderer *grid, const struct scene_effects *effects)
{
    struct scene_effects common = scene_effects_common(effects);
    for (int pass = 0; pass < PASS_COUNT; pass++) {
        if (!gpu_program_build(grid->gpu, &grid->programs[pass], "bench/grid.vert", "", &common, pass))
            return false;
        GLuint name = grid->programs[pass].name;
        grid->uniforms[pass] = (struct grid_uniforms){
            glGetUniformLocation(name, "grid"), glGetUniformLocation(name, "first"),
            glGetUniformLocation(name, "fraction"), glGetUniformLocation(name, "spacing")};
    }
    return true;
}

static bool allocate_selections(struct grid_renderer *grid)
{
    size_t count = (size_t)grid->block_count + 1;
    grid->base_vertices = calloc(count, sizeof *grid->base_vertices);
    bool good = grid->base_vertices != NULL;
    for (int v = 0; v < RENDERER_MAX_VIEWS; v++) {
        grid->selections[v].counts = calloc(count, sizeof *grid->selections[v].counts);
        grid->selections[v].first_index = calloc(count, sizeof *grid->selections[v].first_index);
        good = good && grid->selections[v].counts && grid->selections[v].first_index;
    }
    return good || fail("out of memory");
}

static void bind_attributes(struct grid_renderer *grid)
{
    glBindVertexArray(grid->vertex_array);
    glBindBuffer(GL_ARRAY_BUFFER, grid->heights);
    glBindBuffer(GL_ELEMENT_ARRAY_BUFFER, grid->indices);
    glEnableVertexAttribArray(0);
    glVertexAttribPointer(0, 1, GL_FLOAT, GL_FALSE, sizeof(float), NULL);
    glBindVertexArray(0);
}

// llvmpipe's vertex cache has 256 direct-mapped entries: a row stride of 0 or 1 mod 256 would defeat it, so
// the row is padded (gl-rooflines.md, section 3); other hardware does not mind.
static int64_t padded_stride(int64_t columns)
{
    int64_t rest = columns % 256;
    return rest > 24 && rest < 232 ? columns : columns + 48;
}

// Heights and indices are held whole, and once more while they are made.
static double bytes_needed(double vertices)
{
    return 2 * (sizeof(float) + 6 * sizeof(uint32_t)) * vertices;
}

double baselines_bytes_present(void)
{
    return (double)sysconf(_SC_PHYS_PAGES) * (double)sysconf(_SC_PAGESIZE);
}

bool baselines_fit(const struct terrain *terrain)
{
    double samples = (double)terrain_info(terrain)->samples;
    return samples <= INT32_MAX && bytes_needed(samples) <= 0.5 * baselines_bytes_present();
}

static bool check_size(const struct grid_renderer *grid, const char *name)
{
    double vertices = (double)grid->stride * (double)grid->rows, needed = bytes_needed(vertices);
    double present = baselines_bytes_present();
    if (vertices > INT32_MAX)
        return fail("%s: %lld x %lld vertices are more than one buffer takes", name, (long long)grid->columns,
                    (long long)grid->rows);
    return needed <= 0.5 * present ||
           fail(
               "%s: %lld x %lld vertices need %.1f GiB, this machine has %.1f; a smaller terrain or a larger "
               "step is accepted",
               name, (long long)grid->columns, (long long)grid->rows, needed / 0x1p30, present / 0x1p30);
}

static struct renderer *grid_create(const struct renderer_desc *desc, const struct renderer_type *type)
{
    struct grid_renderer *grid = calloc(1, sizeof *grid);
    if (!grid) return fail("out of memory"), NULL;
    grid->base.type = type;
    grid->gpu = desc->gpu;
    grid->terrain = desc->terrain;
    grid->step = (int)desc->knobs[KNOB_STEP];
    grid->cull = desc->knobs[KNOB_CULL] > 0;
    grid->level = terrain_level(desc->terrain, terrain_info(desc->terrain)->finest);
    grid->columns = vertex_count(grid->level.extent.x1 - grid->level.extent.x0, grid->step);
    grid->rows = vertex_count(grid->level.extent.y1 - grid->level.extent.y0, grid->step);
    grid->stride = padded_stride(grid->columns);
    if (!check_size(grid, type->name)) goto failed;
    glGenVertexArrays(1, &grid->vertex_array);
    glGenBuffers(1, &grid->heights);
    glGenBuffers(1, &grid->indices);
    glBindVertexArray(grid->vertex_array);
    if (!upload_heights(grid) || !upload_indices(grid) || !allocate_selections(grid) ||
        !build_programs(grid, desc->effects))
        goto failed;
    bind_attributes(grid);
    return &grid->base;
failed:
    grid_destroy(&grid->base);
    return NULL;
}

static const struct renderer_type brute_grid; // brute over a plane

static struct renderer *brute_create(const struct renderer_desc *desc)
{
    if (terrain_info(desc->terrain)->datum == TERRAIN_SPHERE) return brute_sphere_renderer.create(desc);
    struct renderer_desc whole = *desc;
    whole.knobs[KNOB_CULL] = desc->knobs[0]; // brute has the one knob
    whole.knobs[KNOB_STEP] = 1;
    return grid_create(&whole, &brute_grid);
}

static struct renderer *decimated_create(const struct renderer_desc *desc)
{
    return grid_create(desc, &decimated_renderer);
}

static bool block_visible(const struct grid_renderer *grid, const struct grid_block *block,
                          const struct frustum *frustum, const struct view *view)
{
    const struct terrain_info *info = terrain_info(grid->terrain);
    const int64_t origin[2] = {grid->level.extent.x0, grid->level.extent.y0};
    double low[3], high[3];
    for (int axis = 0; axis < 2; axis++) {
        low[axis] =
            (double)(origin[axis] + block->low[axis]) * grid->level.spacing_m[axis] - view->eye_m[axis];
        high[axis] =
            (double)(origin[axis] + block->high[axis]) * grid->level.spacing_m[axis] - view->eye_m[axis];
    }
    low[2] = info->offset_m + info->quantum_m * block->min_q - view->eye_m[2];
    high[2] = info->offset_m + info->quantum_m * block->max_q - view->eye_m[2];
    unsigned mask = FRUSTUM_ALL;
    return frustum_test_box(frustum, low, high, &mask) != FRUSTUM_OUTSIDE;
}

static bool grid_update(struct renderer *renderer, const struct view *views, int count)
{
    struct grid_renderer *grid = (struct grid_renderer *)renderer;
    for (int v = 0; v < count; v++) {
        struct grid_selection *selection = &grid->selections[v];
        struct frustum frustum;
        frustum_init(&frustum, &views[v]);
        selection->view = views[v];
        selection->draws = 0;
        selection->triangles = 0;
        for (int b = 0; b < grid->block_count; b++) {
            const struct grid_block *block = &grid->blocks[b];
            if (grid->cull && !block_visible(grid, block, &frustum, &views[v])) continue;
            selection->counts[selection->draws] = block->count;
            selection->first_index[selection->draws++] = block->first_index;
            selection->triangles += (uint64_t)block->count / 3;
        }
    }
    return true;
}

static void grid_draw(struct renderer *renderer, int view_index, enum render_pass pass)
{
    struct grid_renderer *grid = (struct grid_renderer *)renderer;
    const struct grid_selection *selection = &grid->selections[view_index];
    const struct terrain_extent *extent = &grid->level.extent;
    const struct grid_uniforms *at = &grid->uniforms[pass];
    struct view_origin origin = view_level_origin(&selection->view, terrain_info(grid->terrain)->finest);
    if (!selection->draws) return;
    gpu_use_program(grid->gpu, &grid->programs[pass]);
    glUniform4i(at->grid, (GLint)grid->stride, grid->step, (GLint)(extent->x1 - extent->x0 - 1),
                (GLint)(extent->y1 - extent->y0 - 1));
    glUniform2i(at->first, (GLint)(extent->x0 - origin.base[0]), (GLint)(extent->y0 - origin.base[1]));
    glUniform2fv(at->fraction, 1, origin.fraction);
    glUniform2f(at->spacing, (float)grid->level.spacing_m[0], (float)grid->level.spacing_m[1]);
    glBindVertexArray(grid->vertex_array);
    if (selection->draws == 1)
        gpu_draw_elements(grid->gpu, GL_TRIANGLES, (size_t)selection->counts[0], GL_UNSIGNED_INT,
                          selection->first_index[0], 0, selection->triangles);
    else
        gpu_multi_draw_elements(grid->gpu, GL_TRIANGLES, selection->counts, GL_UNSIGNED_INT,
                                selection->first_index, grid->base_vertices, selection->draws,
                                selection->triangles);
    glBindVertexArray(0);
}

static void grid_stats(const struct renderer *renderer, struct renderer_stats *stats)
{
    const struct grid_renderer *grid = (const struct grid_renderer *)renderer;
    *stats = (struct renderer_stats){
        .triangles = grid->selections[0].triangles,
        .claimed_error_px = NAN,
        .resident_bytes = grid->resident_bytes,
        .counters = {{"blocks drawn", grid->selections[0].draws}, {"blocks", grid->block_count}},
    };
}

static const struct renderer_knob brute_knobs[] = {
    {"cull", "draw only blocks of 32 x 32 quads that the frustum touches", 0, 0, 1, "off|on"},
    {0},
};

static const struct renderer_knob decimated_knobs[] = {
    {"step", "draw every step-th sample of the finest level", 8, 1, 1024, NULL},
    {"cull", "draw only blocks of 32 x 32 quads that the frustum touches", 1, 0, 1, "off|on"},
    {0},
};

static const double decimated_quick[] = {12, 8, 4, 2, NAN};
static const double decimated_full[] = {32, 16, 12, 8, 6, 4, 3, 2, NAN};

static const struct renderer_type brute_grid = {
    .name = "brute",
    .begin_frame = null_begin_frame,
    .update = grid_update,
    .draw = grid_draw,
    .stats = grid_stats,
    .destroy = grid_destroy,
};

// On plane and sphere by the type that create() chose.
static bool brute_update(struct renderer *renderer, const struct view *views, int count)
{
    return renderer->type->update(renderer, views, count);
}

static void brute_draw(struct renderer *renderer, int view_index, enum render_pass pass)
{
    renderer->type->draw(renderer, view_index, pass);
}

static void brute_stats(const struct renderer *renderer, struct renderer_stats *stats)
{
    renderer->type->stats(renderer, stats);
}

static void brute_destroy(struct renderer *renderer)
{
    if (renderer) renderer->type->destroy(renderer);
}

const struct renderer_type brute_renderer = {
    .name = "brute",
    .summary = "every triangle of the finest level: truth, and the cost of no level of detail",
    .knobs = brute_knobs,
    .spheres = true,
    .create = brute_create,
    .begin_frame = null_begin_frame,
    .update = brute_update,
    .draw = brute_draw,
    .stats = brute_stats,
    .destroy = brute_destroy,
};

const struct renderer_type decimated_renderer = {
    .name = "decimated",
    .summary = "every step-th sample, culled: what no level of detail gives for fewer triangles",
    .knobs = decimated_knobs,
    .quality_knob = "step",
    .quick = decimated_quick,
    .full = decimated_full,
    .create = decimated_create,
    .begin_frame = null_begin_frame,
    .update = grid_update,
    .draw = grid_draw,
    .stats = grid_stats,
    .destroy = grid_destroy,
};
