// SPDX-License-Identifier: MIT
#include "pgm/pgm.h"

#include "common/report.h"
#include "common/view/frustum.h"
#include "pgm/pgm_atlas.h"
#include "pgm/pgm_mesh.h"
#include "pgm/pgm_sampler.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { SAMPLING_BINDING = 1, HEIGHTS_UNIT = 0 };

enum knob {
    KNOB_ROWS,
    KNOB_ASPECT,
    KNOB_LAW,
    KNOB_CAMERA,
    KNOB_EXTENSION,
    KNOB_WIDENING,
    KNOB_PLANE,
    KNOB_LOD,
    KNOB_SPREAD,
    KNOB_BIAS,
    KNOB_FILTER,
    KNOB_CULL,
    KNOB_FACES,
};

static const struct renderer_knob knobs[] = {
    {"rows", "rows of the grid: triangles for error", 300, 1, PGM_ROWS_MAX, NULL},
    {"aspect", "columns of the grid for each row: the published grids have 1 to 4", 0.5, 0.05, 16, NULL},
    {"law",
     "how rows are spread: even on the sampling camera's screen, half of them even in log distance, or all",
     PGM_LAW_HALF_LOG, 0, 2, "uniform|half-log|log"},
    {"camera",
     "how the sampling camera follows the view: Equation 2 as printed, or signed, rolled and finite",
     PGM_CAMERA_STABLE, 0, 1, "published|stable"},
    {"extension",
     "where rows end near the viewer: lower edge, Equation 3 as printed or stable, or the visible ground",
     PGM_EXTENSION_TIGHT, 0, 3, "none|published|stable|tight"},
    {"widening", "rows as wide as the view, or as the sampling camera, which narrows when it tilts", 1, 0, 1,
     "off|on"},
    {"plane", "sampling plane: through the lowest terrain, or through the ground at the eye",
     PGM_PLANE_LOWEST, 0, 1, "lowest|ground"},
    {"lod", "level and its parent's weight: Equations 6 and 7 as printed, or put right, rounding up or down",
     PGM_LOD_FLOOR, 0, 2, "published|ceil|floor"},
    {"spread", "the sampling distance: to the far neighbour as published, the mean, or to the near one",
     PGM_SPREAD_NEAR, 0, 2, "far|mean|near"},
    {"bias", "levels added to the level of detail: blur for aliasing", 0, -8, 8, NULL},
    {"filter", "how a level is read between samples", 2, 0, 2, "nearest|bilinear|triangle"},
    {"cull", "leave out tiles of the grid outside the view: few, as the rows fit the view already", 0, 0, 1,
     "off|on"},
    {"faces",
     "triangles drawn: both sides of the surface, or only those that face the eye (may drop a pixel)", 0, 0,
     1, "both|front"},
    {0},
};

// Fewer than 150 rows step over whole ridges of rugged ground, which then lack more than 8 px of skyline.
static const double quick[] = {150, 210, 300, 424, 600, NAN};
static const double full[] = {150, 180, 210, 250, 300, 360, 424, 500, 600, 768, NAN};

// The uniform block `sampling`, std140.
struct sampling_block {
    float axes[4];
    int32_t base[4];
    float cells[PGM_LEVELS_MAX][4];
    int32_t slots[PGM_LEVELS_MAX][4];
    int32_t eyes[PGM_LEVELS_MAX][4];
    float rows[PGM_ROWS_MAX + 1][4];
};
_Static_assert(sizeof(struct sampling_block) <= 16384, "what OpenGL 3.3 grants a uniform block");

// What update() chose for a view.
struct selection {
    struct pgm_sampler sampler;
    GLuint buffer; // its uniform block
    int draws;     // runs of tiles
    uint64_t triangles;
    double share_below; // of rows that lie below the screen's lower edge on the sampling plane
    GLsizei *counts;
    size_t *firsts;
};

struct pgm {
    struct renderer renderer;
    struct renderer_desc desc;
    struct pgm_settings settings;
    struct pgm_world world;
    bool cull, front_only;
    struct pgm_atlas atlas;
    struct gpu_program programs[PASS_COUNT];
    GLuint vertex_array, vertex_buffer, index_buffer;
    size_t grid_bytes;
    int tiles;
    GLint *base_vertices; // zeros, one for each tile
    struct pgm_row rows[PGM_ROWS_MAX + 1];
    struct sampling_block block;
    struct selection selections[RENDERER_MAX_VIEWS];
};

// ---- create ----------------------------------------------------------------

static void read_settings(struct pgm *pgm)
{
    const double *k = pgm->desc.knobs;
    struct pgm_settings *s = &pgm->settings;
    s->rows = (int)k[KNOB_ROWS];
    s->columns = (int)fmax(1, rint(k[KNOB_ROWS] * k[KNOB_ASPECT]));
    s->law = (enum pgm_law)k[KNOB_LAW];
    s->camera = (enum pgm_camera)k[KNOB_CAMERA];
    s->extension = (enum pgm_extension)k[KNOB_EXTENSION];
    s->widening = k[KNOB_WIDENING] > 0;
    s->plane = (enum pgm_plane)k[KNOB_PLANE];
    s->lod = (enum pgm_lod)k[KNOB_LOD];
    s->spread = (enum pgm_spread)k[KNOB_SPREAD];
    s->lod_bias = k[KNOB_BIAS];
    pgm->cull = k[KNOB_CULL] > 0;
    pgm->front_only = k[KNOB_FACES] > 0;
}

// Highest of all levels in a rectangle: where filtering overshoots, a coarser level stands higher than the
// finest.
static double highest_in(const void *user, const double rect_m[4])
{
    const struct terrain *terrain = user;
    const struct terrain_info *info = terrain_info(terrain);
    int32_t highest = INT32_MIN;
    for (int level = info->finest; level <= info->coarsest; level++) {
        int64_t cells[4];
        for (int edge = 0; edge < 4; edge++) {
            double at = rect_m[edge] / ldexp(info->spacing_m[edge & 1], level);
            at = fmin(fmax(at, -0x1p60), 0x1p60);
            cells[edge] = (int64_t)(edge < 2 ? floor(at) : ceil(at));
        }
        int32_t low, high;
        terrain_bounds(terrain, level, cells[0], cells[1], cells[2], cells[3], &low, &high);
        if (high > highest) highest = high;
    }
    return info->quantum_m * highest + info->offset_m;
}

static void describe_world(struct pgm *pgm)
{
    const struct terrain_info *info = terrain_info(pgm->desc.terrain);
    struct pgm_world *world = &pgm->world;
    int32_t low = info->min_q, high = info->max_q;
    for (int k = 0; k < pgm->atlas.levels; k++) {
        struct terrain_level level = terrain_level(pgm->desc.terrain, pgm->atlas.finest + k);
        if (level.min_q < low) low = level.min_q;
        if (level.max_q > high) high = level.max_q;
    }
    memcpy(world->outline_m, info->outline_m, sizeof world->outline_m);
    world->lowest_m = info->quantum_m * low + info->offset_m;
    world->highest_m = info->quantum_m * high + info->offset_m;
    world->spacing_m = ldexp(sqrt(info->spacing_m[0] * info->spacing_m[1]), info->finest);
    world->levels = pgm->atlas.levels;
    world->highest_in = highest_in;
    world->user = pgm->desc.terrain;
}

static bool build_programs(struct pgm *pgm)
{
    static const char *const filters[] = {"FILTER_NEAREST", "FILTER_BILINEAR", "FILTER_TRIANGLE"};
    char defines[256];
    snprintf(defines, sizeof defines, "#define LEVELS_MAX %d\n#define ROWS_MAX %d\n#define %s\n%s",
             PGM_LEVELS_MAX, PGM_ROWS_MAX, filters[(int)pgm->desc.knobs[KNOB_FILTER]],
             pgm->settings.lod == PGM_LOD_PUBLISHED ? "#define WEIGHT_PUBLISHED\n" : "");
    for (int pass = 0; pass < PASS_COUNT; pass++) {
        struct gpu_program *program = &pgm->programs[pass];
        if (!gpu_program_build(pgm->desc.gpu, program, "pgm/pgm.vert", defines, pgm->desc.effects,
                               (enum render_pass)pass))
            return false;
        glUniformBlockBinding(program->name, glGetUniformBlockIndex(program->name, "sampling"),
                              SAMPLING_BINDING);
        gpu_use_program(pgm->desc.gpu, program);
        glUniform1i(glGetUniformLocation(program->name, "heights"), HEIGHTS_UNIT);
    }
    return true;
}

static bool upload_grid(struct pgm *pgm)
{
    int rows = pgm->settings.rows, columns = pgm->settings.columns;
    size_t vertex_bytes = pgm_mesh_vertex_count(rows, columns) * sizeof(float[2]);
    size_t index_bytes = pgm_mesh_index_count(rows, columns) * sizeof(uint32_t);
    void *vertices = malloc(vertex_bytes), *indices = malloc(index_bytes);
    if (vertices && indices) {
        pgm_mesh_vertices(rows, columns, vertices);
        pgm_mesh_indices(rows, columns, indices);
        glGenVertexArrays(1, &pgm->vertex_array);
        glBindVertexArray(pgm->vertex_array);
        glGenBuffers(1, &pgm->vertex_buffer);
        glBindBuffer(GL_ARRAY_BUFFER, pgm->vertex_buffer);
        gpu_buffer_data(pgm->desc.gpu, GL_ARRAY_BUFFER, vertex_bytes, vertices, GL_STATIC_DRAW);
        glEnableVertexAttribArray(0);
        glVertexAttribPointer(0, 2, GL_FLOAT, GL_FALSE, 0, NULL);
        glGenBuffers(1, &pgm->index_buffer);
        glBindBuffer(GL_ELEMENT_ARRAY_BUFFER, pgm->index_buffer);
        gpu_buffer_data(pgm->desc.gpu, GL_ELEMENT_ARRAY_BUFFER, index_bytes, indices, GL_STATIC_DRAW);
        glBindVertexArray(0);
        pgm->grid_bytes = vertex_bytes + index_bytes;
    }
    free(vertices);
    free(indices);
    return pgm->grid_bytes > 0 || fail("pgm: out of memory for a grid of %d x %d", rows, columns);
}

static bool init_selections(struct pgm *pgm)
{
    pgm->tiles = pgm_mesh_tile_count(pgm->settings.rows, pgm->settings.columns);
    size_t tiles = (size_t)pgm->tiles;
    pgm->base_vertices = calloc(tiles, sizeof *pgm->base_vertices);
    bool good = pgm->base_vertices != NULL;
    for (int i = 0; i < RENDERER_MAX_VIEWS; i++) {
        struct selection *selection = &pgm->selections[i];
        selection->counts = malloc(tiles * sizeof *selection->counts);
        selection->firsts = malloc(tiles * sizeof *selection->firsts);
        good = good && selection->counts && selection->firsts;
        glGenBuffers(1, &selection->buffer);
        glBindBuffer(GL_UNIFORM_BUFFER, selection->buffer);
        gpu_buffer_data(pgm->desc.gpu, GL_UNIFORM_BUFFER, sizeof pgm->block, NULL, GL_DYNAMIC_DRAW);
    }
    return good || fail("pgm: out of memory for %d tiles", pgm->tiles);
}

static void pgm_destroy(struct renderer *renderer)
{
    struct pgm *pgm = (struct pgm *)renderer;
    if (!pgm) return;
    for (int i = 0; i < RENDERER_MAX_VIEWS; i++) {
        free(pgm->selections[i].counts);
        free(pgm->selections[i].firsts);
        if (pgm->selections[i].buffer) glDeleteBuffers(1, &pgm->selections[i].buffer);
    }
    free(pgm->base_vertices);
    if (pgm->vertex_array) glDeleteVertexArrays(1, &pgm->vertex_array);
    if (pgm->vertex_buffer) glDeleteBuffers(1, &pgm->vertex_buffer);
    if (pgm->index_buffer) glDeleteBuffers(1, &pgm->index_buffer);
    for (int pass = 0; pass < PASS_COUNT; pass++) gpu_program_finish(&pgm->programs[pass]);
    pgm_atlas_finish(&pgm->atlas);
    free(pgm);
}

static struct renderer *pgm_create(const struct renderer_desc *desc)
{
    struct pgm *pgm = calloc(1, sizeof *pgm);
    if (!pgm) return fail("pgm: out of memory"), NULL;
    pgm->renderer.type = &pgm_renderer;
    pgm->desc = *desc;
    read_settings(pgm);
    if (!pgm_atlas_init(&pgm->atlas, desc->gpu, desc->terrain) || !build_programs(pgm) || !upload_grid(pgm) ||
        !init_selections(pgm)) {
        pgm_destroy(&pgm->renderer);
        return NULL;
    }
    describe_world(pgm);
    return &pgm->renderer;
}

// ---- update ----------------------------------------------------------------

static void pgm_begin_frame(struct renderer *renderer, int frame)
{
    (void)renderer, (void)frame; // each frame stands by itself
}

static double ground_under(const struct terrain *terrain, const double eye_m[3])
{
    const struct terrain_info *info = terrain_info(terrain);
    const double *outline = info->outline_m;
    double x = fmin(fmax(eye_m[0], outline[0]), outline[2]), y = fmin(fmax(eye_m[1], outline[1]), outline[3]);
    double height_q = info->min_q;
    terrain_truth_at(terrain, x, y, &height_q, NULL);
    return info->quantum_m * height_q + info->offset_m;
}

static int32_t texel_of(int64_t sample, int64_t first, int slot)
{
    const int64_t far = (int64_t)1 << 30; // an eye far off the map; the program clamps anyway
    int64_t texel = sample - first;
    return (int32_t)(texel < -far ? -far : texel > far ? far : texel) + slot;
}

static void fill_levels(struct pgm *pgm, const struct view *view)
{
    const struct terrain_info *info = terrain_info(pgm->desc.terrain);
    struct sampling_block *block = &pgm->block;
    for (int k = 0; k < pgm->atlas.levels; k++) {
        const struct pgm_slot *slot = &pgm->atlas.slots[k];
        struct view_origin origin = view_level_origin(view, pgm->atlas.finest + k);
        const int corner[2] = {slot->x, slot->y};
        const int64_t first[2] = {slot->extent.x0, slot->extent.y0},
                      end[2] = {slot->extent.x1, slot->extent.y1};
        for (int axis = 0; axis < 2; axis++) {
            block->cells[k][axis] = (float)(1 / ldexp(info->spacing_m[axis], pgm->atlas.finest + k));
            block->cells[k][axis + 2] = origin.fraction[axis];
            block->slots[k][axis] = corner[axis];
            block->slots[k][axis + 2] = corner[axis] + (int32_t)(end[axis] - first[axis] - 1);
            block->eyes[k][axis] = texel_of(origin.base[axis], first[axis], corner[axis]);
        }
    }
}

static void fill_block(struct pgm *pgm, const struct pgm_sampler *sampler, const struct view *view)
{
    struct sampling_block *block = &pgm->block;
    for (int axis = 0; axis < 2; axis++) {
        block->axes[axis] = (float)sampler->forward[axis];
        block->axes[axis + 2] = (float)sampler->right[axis];
    }
    block->base[0] = pgm->atlas.base_q;
    block->base[1] = pgm->atlas.levels - 1;
    fill_levels(pgm, view);
    for (int j = 0; j <= pgm->settings.rows; j++) {
        const struct pgm_row *row = &pgm->rows[j];
        double weight = pgm->settings.lod != PGM_LOD_PUBLISHED ? row->weight
                        : row->range_m > 0                     ? 1 / row->range_m
                                                               : 0;
        const double values[4] = {row->forward_m, row->half_width_m, row->level, weight};
        for (int i = 0; i < 4; i++) block->rows[j][i] = (float)values[i];
    }
}

// Box of a tile relative to the eye, over all heights that it may have.
static void tile_box(const struct pgm *pgm, const struct pgm_sampler *sampler, const struct view *view,
                     const struct pgm_tile *tile, double low[3], double high[3])
{
    int columns = pgm->settings.columns;
    double left = (2.0 * tile->column - columns) / columns;
    double right = (2.0 * (tile->column + tile->columns) - columns) / columns;
    for (int axis = 0; axis < 2; axis++) low[axis] = (double)INFINITY, high[axis] = -(double)INFINITY;
    for (int j = tile->row; j <= tile->row + tile->rows; j++)
        for (int side = 0; side < 2; side++)
            for (int axis = 0; axis < 2; axis++) {
                double x = sampler->forward[axis] * pgm->rows[j].forward_m +
                           sampler->right[axis] * pgm->rows[j].half_width_m * (side ? right : left);
                low[axis] = fmin(low[axis], x);
                high[axis] = fmax(high[axis], x);
            }
    low[2] = pgm->world.lowest_m - view->eye_m[2];
    high[2] = pgm->world.highest_m - view->eye_m[2];
}

static void select_tiles(const struct pgm *pgm, struct selection *selection, const struct view *view)
{
    int rows = pgm->settings.rows, columns = pgm->settings.columns;
    struct frustum frustum;
    frustum_init(&frustum, view);
    size_t end = SIZE_MAX; // of the last run
    for (int k = 0; k < pgm->tiles; k++) {
        struct pgm_tile tile = pgm_mesh_tile(rows, columns, k);
        double low[3], high[3];
        unsigned mask = FRUSTUM_ALL;
        tile_box(pgm, &selection->sampler, view, &tile, low, high);
        if (frustum_test_box(&frustum, low, high, &mask) == FRUSTUM_OUTSIDE) continue;
        if (tile.first != end) {
            selection->firsts[selection->draws] = tile.first;
            selection->counts[selection->draws++] = 0;
        }
        selection->counts[selection->draws - 1] += (GLsizei)tile.count;
        selection->triangles += tile.count / 3;
        end = tile.first + tile.count;
    }
}

static void select_all(const struct pgm *pgm, struct selection *selection)
{
    size_t count = pgm_mesh_index_count(pgm->settings.rows, pgm->settings.columns);
    selection->draws = 1;
    selection->firsts[0] = 0;
    selection->counts[0] = (GLsizei)count;
    selection->triangles = count / 3;
}

static double share_below(const struct pgm *pgm, const struct pgm_sampler *sampler)
{
    int below = 0;
    for (int j = 0; j <= pgm->settings.rows; j++) below += pgm->rows[j].forward_m < sampler->screen_m;
    return below / (pgm->settings.rows + 1.0);
}

static void update_view(struct pgm *pgm, struct selection *selection, const struct view *view)
{
    struct pgm_sampler *sampler = &selection->sampler;
    selection->draws = 0;
    selection->triangles = 0;
    selection->share_below = 0;
    pgm->world.ground_m = ground_under(pgm->desc.terrain, view->eye_m);
    pgm_sampler_aim(sampler, view, &pgm->world, &pgm->settings);
    if (sampler->empty) return;
    pgm_sampler_rows(sampler, &pgm->world, &pgm->settings, pgm->rows);
    fill_block(pgm, sampler, view);
    glBindBuffer(GL_UNIFORM_BUFFER, selection->buffer);
    size_t used =
        offsetof(struct sampling_block, rows) + sizeof pgm->block.rows[0] * (size_t)(pgm->settings.rows + 1);
    gpu_buffer_sub_data(pgm->desc.gpu, GL_UNIFORM_BUFFER, 0, used, &pgm->block);
    selection->share_below = share_below(pgm, sampler);
    if (pgm->cull)
        select_tiles(pgm, selection, view);
    else
        select_all(pgm, selection);
}

static bool pgm_update(struct renderer *renderer, const struct view *views, int count)
{
    struct pgm *pgm = (struct pgm *)renderer;
    for (int i = 0; i < count; i++) update_view(pgm, &pgm->selections[i], &views[i]);
    return true;
}

// ---- draw ------------------------------------------------------------------

static void pgm_draw(struct renderer *renderer, int view_index, enum render_pass pass)
{
    struct pgm *pgm = (struct pgm *)renderer;
    const struct selection *selection = &pgm->selections[view_index];
    if (selection->draws == 0) return;
    gpu_use_program(pgm->desc.gpu, &pgm->programs[pass]);
    glBindBufferBase(GL_UNIFORM_BUFFER, SAMPLING_BINDING, selection->buffer);
    glActiveTexture(GL_TEXTURE0 + HEIGHTS_UNIT);
    glBindTexture(GL_TEXTURE_2D, pgm->atlas.texture);
    glBindVertexArray(pgm->vertex_array);
    if (pgm->front_only && pass != PASS_POSITION)
        glEnable(GL_CULL_FACE); // measuring looks for faces seen from below
    if (selection->draws == 1)
        gpu_draw_elements(pgm->desc.gpu, GL_TRIANGLES, (size_t)selection->counts[0], GL_UNSIGNED_INT,
                          selection->firsts[0], 0, selection->triangles);
    else
        gpu_multi_draw_elements(pgm->desc.gpu, GL_TRIANGLES, selection->counts, GL_UNSIGNED_INT,
                                selection->firsts, pgm->base_vertices, selection->draws,
                                selection->triangles);
    glDisable(GL_CULL_FACE);
}

static void pgm_stats(const struct renderer *renderer, struct renderer_stats *stats)
{
    const struct pgm *pgm = (const struct pgm *)renderer;
    const struct selection *selection = &pgm->selections[0];
    const double degrees = 57.29577951308232;
    *stats = (struct renderer_stats){
        .triangles = selection->triangles,
        .claimed_error_px = (double)NAN,
        .resident_bytes = pgm_atlas_bytes(&pgm->atlas) + pgm->grid_bytes +
                          RENDERER_MAX_VIEWS * sizeof(struct sampling_block),
        .counters = {{"rows", pgm->settings.rows},
                     {"columns", pgm->settings.columns},
                     {"extension_degrees", selection->sampler.extension * degrees},
                     {"rows_below_screen", selection->share_below},
                     {"below_base", selection->sampler.below_base}},
    };
}

const struct renderer_type pgm_renderer = {
    .name = "pgm",
    .summary = "persistent grid mapping with a sampling camera",
    .knobs = knobs,
    .quality_knob = "rows",
    .quick = quick,
    .full = full,
    .create = pgm_create,
    .begin_frame = pgm_begin_frame,
    .update = pgm_update,
    .draw = pgm_draw,
    .stats = pgm_stats,
    .destroy = pgm_destroy,
};
