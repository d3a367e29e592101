// SPDX-License-Identifier: MIT
#include "pgm/pgm.h"

#include "common/embedded.h"
#include "common/report.h"
#include "pgm/pgm_atlas.h"
#include "pgm/pgm_mesh.h"
#include "pgm/pgm_rows.h"
#include "pgm/pgm_sampler.h"
#include "pgm/pgm_tiles.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

enum {
    SAMPLING_BINDING = 1,
    ROWS_BINDING = 2,
    // Texture units; those below 16 may be bound by others for good, and every OpenGL 3.3 has 48.
    HEIGHTS_UNIT = 16,   // as many as there are levels; likewise
    FRAGMENTS_UNIT = 32, // shading, then colours
};

enum knob {
    KNOB_ROWS,
    KNOB_ASPECT,
    KNOB_GRID,
    KNOB_LAW,
    KNOB_FOCUS_X,
    KNOB_FOCUS_Y,
    KNOB_FOCUS_WIDTH,
    KNOB_TARGET,
    KNOB_SHRINK,
    KNOB_STRIPS,
    KNOB_HOLD,
    KNOB_CAMERA,
    KNOB_EXTENSION,
    KNOB_WIDENING,
    KNOB_PLANE,
    KNOB_LOD,
    KNOB_SPREAD,
    KNOB_BIAS,
    KNOB_FILTER,
    KNOB_FETCH,
    KNOB_TEXTURES,
    KNOB_MEMORY,
    KNOB_BUDGET,
    KNOB_MAPPING,
    KNOB_COORDINATES,
    KNOB_FRAGMENT,
    KNOB_WORDS,
    KNOB_CULL,
    KNOB_FACES,
    KNOB_FALL,
    KNOB_EDGE,
};

static const struct renderer_knob knobs[] = {
    {"rows", "rows of the grid: triangles for error", 300, 1, PGM_ROWS_MAX, NULL},
    {"aspect", "columns of the grid for each row: the published grids have 1 to 4", 0.5, 0.05, 16, NULL},
    {"grid", "one of the published grids, rows x columns, instead of rows and aspect", 0, 0, 6,
     "free|150x600|200x800|430x430|300x900|600x600|400x1600"},
    {"law",
     "how rows are spread: even on the sampling camera's screen, half of them even in log distance, or all; "
     "half-log about a focus; or by a target error",
     PGM_LAW_HALF_LOG, 0, 4, "uniform|half-log|log|focus|target"},
    {"focus_x", "law=focus: where on the window, left to right", 0, -1, 1, NULL},
    {"focus_y", "law=focus: where on the window, bottom to top", -0.3, -1, 1, NULL},
    {"focus_width", "law=focus: reach in halves of the window; small is strong", 0.5, 0.01, 10, NULL},
    {"target",
     "law=target: p99.9 of the error aimed at, pixels: was 0.7 to 1 of it where rows and columns sufficed; "
     "no promise",
     1, 0.01, 100, NULL},
    {"shrink", "leave out rows in proportion to the sky in the window", 0, 0, 1, "off|on"},
    {"strips", "ground below the window's lower edge: stretch the grid over it, or add rows", 0, 0, 1,
     "off|on"},
    {"hold", "in a viewer, ms a frame that the grid's size is to hold; 0: do not", 0, 0, 1000, NULL},
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
    {"fetch",
     "what a texel holds: one height, or all that a vertex blends; or the hardware filters: mipmaps that it "
     "makes, or the atlas, whose tiles then bleed into each other",
     PGM_FETCH_PLAIN, 0, 3, "plain|packed|mipmap|linear"},
    {"textures", "all levels in one texture, or one texture each, chosen by branching", 0, 0, 1,
     "atlas|many"},
    {"memory",
     "MiB of textures on the GPU, beyond which levels are tiles about the viewer; 0: no limit; -1: 256, or "
     "32 "
     "over terrain that is read on demand",
     -1, -1, 65536, NULL},
    {"budget", "KiB of textures uploaded a frame at most, once flying", 1024, 64, 1048576, NULL},
    {"mapping", "grid to ground: Equation 1 as printed in world coordinates, or relative to the eye", 1, 0, 1,
     "published|stable"},
    {"coordinates",
     "own shading: texels of a fragment interpolated between vertices (wrong where they read different "
     "levels), or found by itself",
     1, 0, 1, "automatic|explicit"},
    {"fragment", "own shading: fetches a fragment, of its level or of its parent too; none shows cells", 1, 0,
     2, "one|two|none"},
    {"words", "own shading: of the four in a texel, the nearest or a blend", 1, 0, 1, "nearest|blended"},
    {"cull", "leave out tiles of the grid outside the view: few, as the rows fit the view already", 0, 0, 1,
     "off|on"},
    {"faces", RENDERER_FACES_HELP, RENDERER_FACES_SAFE, 0, 2, RENDERER_FACES_CHOICES},
    {"fall",
     "how far a row's ray sinks: sin A - y cos A as printed, which cancels at the horizon, or a sum from the "
     "far end",
     PGM_FALL_STABLE, 0, 1, "published|stable"},
    {"edge", "beyond the map: its border's heights go on like curtains, or nothing is drawn", 1, 0, 1,
     "clamped|exact"},
    {0},
};

// Fewer than 150 rows step over whole ridges of rugged ground, which then lack more than 8 px of skyline.
static const double quick[] = {150, 210, 300, 424, 600, NAN};
static const double full[] = {150, 180, 210, 250, 300, 360, 424, 500, 600, 768, NAN};

enum { SLOTS_MAX = PGM_LEVELS_MAX + PGM_PICTURE_LEVELS_MAX }; // heights, then colours

// The uniform blocks `sampling` and `grid_rows`, std140.
struct sampling_block {
    float ground_axes[4];
    float across[4];
    float eye[4];
    int32_t base[4];
    float cells[SLOTS_MAX][4];
    int32_t slots[SLOTS_MAX][4];
    int32_t eyes[SLOTS_MAX][4];
    int32_t tiles[SLOTS_MAX][4];
};
struct rows_block {
    float rows[PGM_ROWS_MAX + 1][4];
};
_Static_assert(sizeof(struct sampling_block) <= 16384 && sizeof(struct rows_block) <= 16384,
               "what OpenGL 3.3 grants a uniform block");

// What update() chose for a view.
struct selection {
    struct pgm_sampler sampler;
    struct pgm_settings used; // of the grid
    GLuint sampling, rows;    // its uniform blocks
    int coarsened;            // rows that read a coarser level than their own, which is not in memory here
    int draws[PGM_WAYS];      // runs of tiles, the last ways' first
    uint64_t way_triangles[PGM_WAYS], triangles;
    bool below_ground;  // the viewer is
    double share_below; // of rows that lie below the screen's lower edge on the sampling plane
    GLsizei *counts;
    size_t *firsts;
};

struct pgm {
    struct renderer renderer;
    struct renderer_desc desc;
    struct pgm_settings settings;
    struct pgm_world world;
    int mesh_rows;                     // of the grid as it was uploaded
    double column_focus, column_width; // pgm_focus of its columns
    bool cull;
    enum renderer_faces faces;
    struct terrain_reader *reader;
    int frame;
    struct scene_colour *held; // whose pixels the picture needs; NULL: none
    struct pgm_picture picture;
    struct pgm_atlas atlas,
        colours; // colours: of the picture, which shading of its own may have; else zeroed
    struct gpu_program programs[PASS_COUNT][2]; // 1: within the map
    struct pgm_tiles grid_tiles;
    GLuint vertex_array, vertex_buffer, index_buffer;
    size_t grid_bytes;
    uint64_t refilled_bytes; // of textures, this frame
    double begun_ms;         // the last frame, in real time
    int tiles;
    GLint *base_vertices; // zeros, one for each tile
    uint8_t *ways;        // of the tiles
    struct pgm_row rows[PGM_ROWS_MAX + 1];
    struct sampling_block block;
    struct rows_block rows_block;
    struct selection selections[RENDERER_MAX_VIEWS];
};

// ---- create ----------------------------------------------------------------

static void read_settings(struct pgm *pgm)
{
    const double *k = pgm->desc.knobs;
    struct pgm_settings *s = &pgm->settings;
    static const int published[][2] = {{150, 600}, {200, 800}, {430, 430},
                                       {300, 900}, {600, 600}, {400, 1600}};
    int grid = (int)k[KNOB_GRID];
    s->rows = grid > 0 ? published[grid - 1][0] : (int)k[KNOB_ROWS];
    s->columns = grid > 0 ? published[grid - 1][1] : (int)fmax(1, rint(k[KNOB_ROWS] * k[KNOB_ASPECT]));
    s->law = (enum pgm_law)k[KNOB_LAW];
    s->camera = (enum pgm_camera)k[KNOB_CAMERA];
    s->extension = (enum pgm_extension)k[KNOB_EXTENSION];
    s->widening = k[KNOB_WIDENING] > 0;
    s->plane = (enum pgm_plane)k[KNOB_PLANE];
    s->fall = (enum pgm_fall)k[KNOB_FALL];
    s->lod = (enum pgm_lod)k[KNOB_LOD];
    s->spread = (enum pgm_spread)k[KNOB_SPREAD];
    s->lod_bias = k[KNOB_BIAS];
    s->focus[0] = k[KNOB_FOCUS_X];
    s->focus[1] = k[KNOB_FOCUS_Y];
    s->focus_width = k[KNOB_FOCUS_WIDTH];
    s->target_px = k[KNOB_TARGET];
    s->shrink = k[KNOB_SHRINK] > 0;
    s->strips = k[KNOB_STRIPS] > 0;
    s->share = 1;
    // Strips at most double the rows.
    pgm->mesh_rows = s->strips ? (int)fmin(2 * s->rows, PGM_ROWS_MAX) : s->rows;
    pgm->column_focus = 0.5 + 0.5 * s->focus[0];
    pgm->column_width = s->law == PGM_LAW_FOCUS ? s->focus_width / 2 : 0;
    pgm->cull = k[KNOB_CULL] > 0;
    pgm->faces = (enum renderer_faces)k[KNOB_FACES];
}

// Of a map that is never held whole, levels are tiles whatever the memory; larger ones take longer to be
// there.
static double memory_mib(const struct pgm *pgm)
{
    const struct terrain *terrain = pgm->desc.terrain;
    double mib = pgm->desc.knobs[KNOB_MEMORY];
    return mib >= 0 ? mib : terrain_extrema(terrain) ? 256 : 32;
}

static struct pgm_storage read_storage(const struct pgm *pgm)
{
    const double *k = pgm->desc.knobs;
    return (struct pgm_storage){.fetch = (enum pgm_fetch)k[KNOB_FETCH],
                                .shaded = pgm->desc.effects->shading == SCENE_SHADING_OWN,
                                .many = k[KNOB_TEXTURES] > 0,
                                .memory_bytes = (size_t)(memory_mib(pgm) * 1048576),
                                .budget_bytes = (size_t)(k[KNOB_BUDGET] * 1024),
                                .most_texels = gpu_info(pgm->desc.gpu)->max_texture_size};
}

static bool is_readable(const struct pgm_storage *storage) // by the programs
{
    return !storage->many || storage->fetch == PGM_FETCH_PLAIN ||
           fail("pgm: textures=many takes fetch=plain");
}

// Colours get as much of memory and budget as they would take of it if everything were held whole.
static bool init_textures(struct pgm *pgm)
{
    const struct renderer_desc *desc = &pgm->desc;
    const struct terrain_info *info = terrain_info(desc->terrain);
    struct scene_colour *image = desc->effects->colour;
    struct pgm_storage heights = read_storage(pgm), colours = heights;
    if (!is_readable(&heights)) return false;
    if (heights.shaded && image) {
        int levels = info->coarsest - info->finest + 1;
        int most = heights.many ? PGM_TEXTURES_MAX - levels : PGM_PICTURE_LEVELS_MAX;
        if (most < 1)
            return fail("pgm: textures=many takes a colour image with at most %d levels of heights, but "
                        "terrain %s has %d",
                        PGM_TEXTURES_MAX - 1, info->name, levels);
        if (!scene_colour_hold(image)) return false;
        pgm->held = image;
        if (!pgm_picture_init(&pgm->picture, image, most))
            return fail("pgm: out of memory for %s", image->name);
        colours.picture = &pgm->picture;
        colours.shaded = false;
        if (colours.fetch != PGM_FETCH_MIPMAP) colours.fetch = PGM_FETCH_PLAIN;
        double of_heights = (double)pgm_atlas_whole_bytes(desc->terrain, &heights),
               of_colours = (double)pgm_atlas_whole_bytes(desc->terrain, &colours);
        double share = of_colours / (of_heights + of_colours);
        colours.memory_bytes = (size_t)(share * (double)heights.memory_bytes);
        colours.budget_bytes = (size_t)(share * (double)heights.budget_bytes);
        heights.memory_bytes -= colours.memory_bytes;
        heights.budget_bytes -= colours.budget_bytes;
    }
    pgm->reader = terrain_reader_create(desc->terrain, desc->realtime);
    return pgm->reader && pgm_atlas_init(&pgm->atlas, desc->gpu, desc->terrain, &heights) &&
           (!colours.picture || pgm_atlas_init(&pgm->colours, desc->gpu, desc->terrain, &colours));
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

// For law=target, from the errors that the terrain keeps of its levels.
static void describe_errors(struct pgm *pgm)
{
    const struct terrain_info *info = terrain_info(pgm->desc.terrain);
    int levels = pgm->atlas.levels, finest = pgm->atlas.finest;
    for (int k = 0; k < levels; k++) {
        int parent = k + 1 < levels ? k + 1 : k;
        struct terrain_level own = terrain_level(pgm->desc.terrain, finest + k),
                             next = terrain_level(pgm->desc.terrain, finest + parent),
                             *shape = k > 0 ? &own : &next; // the finest has no error to tell by
        double ratio = shape->rms_error_m > 0
                           ? pgm_error_p999(shape->rms_error_m, shape->max_error_m, (double)info->samples) /
                                 shape->rms_error_m
                           : 0;
        pgm->world.error_m[k] = ratio * pgm_error_unaligned(own.rms_error_m, next.rms_error_m);
    }
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
    describe_errors(pgm);
    world->highest_in = highest_in;
    world->user = pgm->desc.terrain;
}

// Statements that set `found`: a texture for each level, and a branch to each.
static size_t write_branches(const char *name, const char *array, const char *part, int levels, char *out,
                             size_t size)
{
    size_t used = (size_t)snprintf(out, size, "#define %s ", name);
    for (int k = 0; k < levels && used < size; k++)
        used += (size_t)snprintf(out + used, size - used,
                                 "%sif (level == %d) found = texelFetch(%s[%d], texel, 0)%s;",
                                 k ? " else " : "", k, array, k, part);
    if (used < size) used += (size_t)snprintf(out + used, size - used, "\n");
    return used;
}

static void write_many(const struct pgm *pgm, char *out, size_t size)
{
    int heights = pgm->atlas.levels, colours = pgm->colours.levels;
    size_t used =
        (size_t)snprintf(out, size, "#define HEIGHT_LEVELS %d\n#define COLOUR_LEVELS %d\n", heights, colours);
    used += write_branches("MANY_HEIGHTS", "heights", ".r", heights, out + used, size - used);
    if (used < size) used += write_branches("MANY_SHADING", "shading", "", heights, out + used, size - used);
    if (used < size) write_branches("MANY_COLOURS", "colours", "", colours, out + used, size - used);
}

static bool is_full(const struct pgm *pgm) // colours, too
{
    return pgm_atlas_is_full(&pgm->atlas) && pgm_atlas_is_full(&pgm->colours);
}

// Choices, and the levels' tiles, which vertices and fragments share.
static void write_defines(const struct pgm *pgm, char *out, size_t size)
{
    static const char *const filters[] = {"FILTER_NEAREST", "FILTER_BILINEAR", "FILTER_TRIANGLE"};
    static const char *const fetches[] = {"FETCH_PLAIN", "FETCH_PACKED", "FETCH_MIPMAP", "FETCH_LINEAR"};
    static const char *const fragments[] = {"#define ONE_FETCH\n", "", "#define NO_FETCH\n"};
    const double *knob = pgm->desc.knobs;
    const struct embedded_file *levels = embedded_find("pgm/pgm_levels.glsl");
    size_t used = (size_t)snprintf(
        out, size,
        "#define SLOTS_MAX %d\n#define ROWS_MAX %d\n#define %s\n#define %s\n%s%s%s%s%s%s%s%s%s%.*s\n",
        SLOTS_MAX, PGM_ROWS_MAX, filters[(int)knob[KNOB_FILTER]], fetches[(int)knob[KNOB_FETCH]],
        pgm->atlas.narrow ? "" : "#define WIDE\n", is_full(pgm) ? "" : "#define TILED\n",
        pgm->settings.lod == PGM_LOD_PUBLISHED ? "#define WEIGHT_PUBLISHED\n" : "",
        knob[KNOB_MAPPING] > 0 ? "" : "#define MAPPING_PUBLISHED\n",
        knob[KNOB_COORDINATES] > 0 ? "" : "#define COORDINATES_AUTOMATIC\n",
        fragments[(int)knob[KNOB_FRAGMENT]], knob[KNOB_WORDS] > 0 ? "" : "#define NEAREST_WORD\n",
        knob[KNOB_EDGE] > 0 ? "" : "#define EDGE_CLAMPED\n" GPU_INSIDE_OUTLINE,
        pgm->colours.levels ? "#define OWN_COLOUR\n" : "", (int)(levels->end - levels->data),
        (const char *)levels->data);
    if (pgm->atlas.storage.many && used < size) write_many(pgm, out + used, size - used);
}

static void bind_units(GLuint program, const char *name, int first, int count)
{
    GLint units[PGM_TEXTURES_MAX];
    for (int i = 0; i < count; i++) units[i] = first + i;
    glUniform1iv(glGetUniformLocation(program, name), count, units);
}

static void bind_names(struct pgm *pgm, GLuint program)
{
    glUniformBlockBinding(program, glGetUniformBlockIndex(program, "sampling"), SAMPLING_BINDING);
    glUniformBlockBinding(program, glGetUniformBlockIndex(program, "grid_rows"), ROWS_BINDING);
    int count = pgm_atlas_textures(&pgm->atlas);
    bind_units(program, "heights", HEIGHTS_UNIT, count);
    bind_units(program, "shading", FRAGMENTS_UNIT, count);
    bind_units(program, "colours", FRAGMENTS_UNIT + count, pgm_atlas_textures(&pgm->colours));
}

static bool build_programs(struct pgm *pgm)
{
    char defines[16384] = GPU_INSIDE_OUTLINE;
    const size_t inside = sizeof GPU_INSIDE_OUTLINE - 1;
    write_defines(pgm, defines + inside, sizeof defines - inside);
    for (int pass = 0; pass < PASS_COUNT; pass++)
        for (int k = 0; k < 2; k++) {
            struct gpu_program *program = &pgm->programs[pass][k];
            if (!gpu_program_build(pgm->desc.gpu, program, "pgm/pgm.vert", k ? defines : defines + inside,
                                   pgm->desc.effects, (enum render_pass)pass))
                return false;
            gpu_use_program(pgm->desc.gpu, program);
            bind_names(pgm, program->name);
        }
    return true;
}

static bool upload_grid(struct pgm *pgm)
{
    int rows = pgm->mesh_rows, columns = pgm->settings.columns;
    size_t vertex_bytes = pgm_mesh_vertex_count(rows, columns) * sizeof(float[2]);
    size_t index_bytes = pgm_mesh_index_count(rows, columns) * sizeof(uint32_t);
    void *vertices = malloc(vertex_bytes), *indices = malloc(index_bytes);
    if (vertices && indices) {
        pgm_mesh_vertices(rows, columns, pgm->column_focus, pgm->column_width, vertices);
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
    pgm->tiles = pgm_mesh_tile_count(pgm->mesh_rows, pgm->settings.columns);
    size_t tiles = (size_t)pgm->tiles;
    pgm->base_vertices = calloc(tiles, sizeof *pgm->base_vertices);
    pgm->ways = malloc(tiles);
    bool good = pgm->base_vertices && pgm->ways &&
                pgm_tiles_init(&pgm->grid_tiles, pgm->mesh_rows, pgm->settings.columns, pgm->column_focus,
                               pgm->column_width);
    for (int i = 0; i < RENDERER_MAX_VIEWS; i++) {
        struct selection *selection = &pgm->selections[i];
        selection->counts = malloc(tiles * sizeof *selection->counts);
        selection->firsts = malloc(tiles * sizeof *selection->firsts);
        good = good && selection->counts && selection->firsts;
        glGenBuffers(1, &selection->sampling);
        glBindBuffer(GL_UNIFORM_BUFFER, selection->sampling);
        gpu_buffer_data(pgm->desc.gpu, GL_UNIFORM_BUFFER, sizeof pgm->block, NULL, GL_DYNAMIC_DRAW);
        glGenBuffers(1, &selection->rows);
        glBindBuffer(GL_UNIFORM_BUFFER, selection->rows);
        gpu_buffer_data(pgm->desc.gpu, GL_UNIFORM_BUFFER, sizeof pgm->rows_block, NULL, GL_DYNAMIC_DRAW);
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
        if (pgm->selections[i].sampling) glDeleteBuffers(1, &pgm->selections[i].sampling);
        if (pgm->selections[i].rows) glDeleteBuffers(1, &pgm->selections[i].rows);
    }
    free(pgm->base_vertices);
    free(pgm->ways);
    pgm_tiles_finish(&pgm->grid_tiles);
    if (pgm->vertex_array) glDeleteVertexArrays(1, &pgm->vertex_array);
    if (pgm->vertex_buffer) glDeleteBuffers(1, &pgm->vertex_buffer);
    if (pgm->index_buffer) glDeleteBuffers(1, &pgm->index_buffer);
    for (int pass = 0; pass < PASS_COUNT; pass++)
        for (int k = 0; k < 2; k++) gpu_program_finish(&pgm->programs[pass][k]);
    pgm_atlas_finish(&pgm->atlas);
    pgm_atlas_finish(&pgm->colours);
    terrain_reader_destroy(pgm->reader);
    pgm_picture_finish(&pgm->picture);
    scene_colour_release(pgm->held);
    free(pgm);
}

static struct renderer *pgm_create(const struct renderer_desc *desc)
{
    const struct terrain_info *info = terrain_info(desc->terrain);
    if (info->datum != TERRAIN_PLANE)
        return fail("pgm: terrain %s is a sphere; accepted are planes", info->name), NULL;
    struct pgm *pgm = calloc(1, sizeof *pgm);
    if (!pgm) return fail("pgm: out of memory"), NULL;
    pgm->renderer.type = &pgm_renderer;
    pgm->desc = *desc;
    read_settings(pgm);
    if (!init_textures(pgm) || !build_programs(pgm) || !upload_grid(pgm) || !init_selections(pgm)) {
        pgm_destroy(&pgm->renderer);
        return NULL;
    }
    describe_world(pgm);
    return &pgm->renderer;
}

// ---- update ----------------------------------------------------------------

static double now_ms(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return 1e3 * (double)now.tv_sec + 1e-6 * (double)now.tv_nsec;
}

static void pgm_begin_frame(struct renderer *renderer, int frame)
{
    struct pgm *pgm = (struct pgm *)renderer;
    pgm->frame = frame;
    double hold_ms = pgm->desc.knobs[KNOB_HOLD];
    if (!pgm->desc.realtime || !(hold_ms > 0)) return;
    double now = now_ms();
    if (pgm->begun_ms > 0)
        pgm->settings.share = pgm_hold_share(pgm->settings.share, now - pgm->begun_ms, hold_ms);
    pgm->begun_ms = now;
}

// Height of the ground under the eye, or at the map's edge; false: not read yet, and no lower than this.
static bool ground_under(const struct pgm *pgm, const double eye_m[3], double *ground_m)
{
    const struct terrain_info *info = terrain_info(pgm->desc.terrain);
    double place_m[2], height_q = info->min_q;
    int64_t cell[2];
    for (int axis = 0; axis < 2; axis++) {
        place_m[axis] = fmin(fmax(eye_m[axis], info->outline_m[axis]), info->outline_m[axis + 2]);
        cell[axis] = (int64_t)floor(place_m[axis] / ldexp(info->spacing_m[axis], info->finest));
    }
    bool known = terrain_reader_window(pgm->reader, info->finest, cell[0], cell[1], 2, 2, NULL);
    int32_t low = info->min_q, high;
    if (known)
        terrain_truth_at(pgm->desc.terrain, place_m[0], place_m[1], &height_q, NULL);
    else
        terrain_bounds(pgm->desc.terrain, info->finest, cell[0], cell[1], cell[0] + 1, cell[1] + 1, &low,
                       &high);
    *ground_m = info->quantum_m * (known ? height_q : low) + info->offset_m;
    return known;
}

static int32_t near_zero(int64_t cells)
{
    const int64_t far = (int64_t)1 << 30; // an eye far off the map; the program clamps anyway
    return (int32_t)(cells < -far ? -far : cells > far ? far : cells);
}

static void fill_slot(struct sampling_block *block, int slot, const struct pgm_atlas *atlas,
                      const struct terrain *terrain, const struct view *view, int k)
{
    const struct pgm_window *window = &atlas->slots[k].window;
    struct pgm_place eye = pgm_atlas_place(atlas, terrain, view, k);
    int64_t origin[2];
    pgm_window_origin(window, origin);
    const int64_t first[2] = {window->held.x0, window->held.y0}, end[2] = {window->held.x1, window->held.y1};
    const int corner[2] = {atlas->slots[k].x, atlas->slots[k].y}, sides[2] = {window->width, window->height};
    for (int axis = 0; axis < 2; axis++) {
        block->cells[slot][axis] = (float)(1 / eye.spacing_m[axis]);
        block->cells[slot][axis + 2] = eye.fraction[axis];
        block->slots[slot][axis] = near_zero(first[axis] - origin[axis]);
        block->slots[slot][axis + 2] = near_zero(end[axis] - 1 - origin[axis]);
        block->eyes[slot][axis] = near_zero(eye.cell[axis] - origin[axis]);
        block->eyes[slot][axis + 2] = corner[axis];
        block->tiles[slot][axis] = sides[axis];
        block->tiles[slot][axis + 2] = (int32_t)(origin[axis] & 1);
    }
}

static void fill_slots(struct pgm *pgm, const struct view *view)
{
    const struct terrain *terrain = pgm->desc.terrain;
    struct sampling_block *block = &pgm->block;
    int heights = pgm->atlas.levels, colours = pgm->colours.levels;
    for (int k = 0; k < heights; k++) fill_slot(block, k, &pgm->atlas, terrain, view, k);
    for (int k = 0; k < colours; k++) fill_slot(block, heights + k, &pgm->colours, terrain, view, k);
    block->base[0] = pgm->atlas.base_q;
    block->base[1] = heights - 1;
    block->base[2] = heights + colours - 1;
    if (colours == 0) return;
    struct pgm_place pixel = pgm_atlas_place(&pgm->colours, terrain, view, 0);
    block->across[2] = (float)log2(pgm->world.spacing_m / sqrt(pixel.spacing_m[0] * pixel.spacing_m[1]));
}

static void fill_block(struct pgm *pgm, const struct selection *selection, const struct view *view)
{
    struct sampling_block *block = &pgm->block;
    const struct pgm_sampler *sampler = &selection->sampler;
    // The columns in use span the view; 1 and 0 where all are.
    block->across[0] = (float)((double)pgm->settings.columns / selection->used.columns);
    block->across[1] = block->across[0] - 1;
    for (int axis = 0; axis < 2; axis++) {
        block->ground_axes[axis] = (float)sampler->forward[axis];
        block->ground_axes[axis + 2] = (float)sampler->right[axis];
    }
    for (int axis = 0; axis < 3; axis++) block->eye[axis] = (float)view->eye_m[axis];
    block->eye[3] = (float)sampler->height_m;
    fill_slots(pgm, view);
    for (int j = 0; j <= selection->used.rows; j++) {
        const struct pgm_row *row = &pgm->rows[j];
        double weight = pgm->settings.lod != PGM_LOD_PUBLISHED ? row->weight
                        : row->range_m > 0                     ? 1 / row->range_m
                                                               : 0;
        const double values[4] = {row->forward_m, row->half_width_m, row->level, weight};
        for (int i = 0; i < 4; i++) pgm->rows_block.rows[j][i] = (float)values[i];
    }
}

// True where level k is in memory at all samples that a row reads.
static bool row_is_held(const struct pgm *pgm, int k, const double low_m[2], const double high_m[2])
{
    const struct terrain_info *info = terrain_info(pgm->desc.terrain);
    int64_t from[2], to[2];
    for (int axis = 0; axis < 2; axis++) {
        double spacing = ldexp(info->spacing_m[axis], pgm->atlas.finest + k);
        from[axis] = (int64_t)fmin(fmax(floor(low_m[axis] / spacing) - 1, -0x1p60), 0x1p60);
        to[axis] = (int64_t)fmin(fmax(floor(high_m[axis] / spacing) + 2, -0x1p60), 0x1p60);
    }
    return pgm_window_holds(&pgm->atlas.slots[k].window, from, to);
}

// Sends a row whose level is not in memory all along it to the finest level that is.
static bool coarsen_row(const struct pgm *pgm, struct pgm_row *row, const struct pgm_sampler *sampler,
                        const struct view *view)
{
    double low[2], high[2];
    for (int axis = 0; axis < 2; axis++) {
        double middle = view->eye_m[axis] + sampler->forward[axis] * row->forward_m;
        double half = fabs(sampler->right[axis]) * row->half_width_m;
        low[axis] = middle - half;
        high[axis] = middle + half;
    }
    int level = row->level;
    while (!row_is_held(pgm, row->level, low, high)) row->level++; // the coarsest is whole
    bool parent = row->weight > 0 || row->range_m > 0;
    bool blends = row->level == level && (!parent || pgm->atlas.storage.fetch == PGM_FETCH_PACKED ||
                                          row_is_held(pgm, level + 1, low, high));
    if (!blends) row->weight = row->range_m = 0;
    return !blends;
}

// How each tile is drawn: those in use are the far and the left ones.
static void look_at_tiles(struct pgm *pgm, const struct selection *selection, const struct view *view)
{
    const struct pgm_settings *used = &selection->used;
    pgm_tiles_look(&pgm->grid_tiles, view, &pgm->world, &selection->sampler, used, pgm->rows);
    for (int k = 0; k < pgm->tiles; k++) {
        struct pgm_tile tile = pgm_mesh_tile(pgm->mesh_rows, pgm->settings.columns, k);
        pgm->ways[k] = PGM_UNSEEN;
        if (tile.row >= used->rows || tile.column >= used->columns) continue;
        int way = pgm_tiles_way(&pgm->grid_tiles, view, pgm->desc.terrain, &tile);
        pgm->ways[k] = (uint8_t)(way == PGM_UNSEEN && !pgm->cull ? 0 : way);
    }
}

// The tiles of a way, joined to runs of the index list from run `first` on.
static void select_way(const struct pgm *pgm, struct selection *selection, int way, int first)
{
    int draws = first;
    size_t end = SIZE_MAX, triangles = 0; // end: of the last run
    for (int k = 0; k < pgm->tiles; k++) {
        if (pgm->ways[k] != way) continue;
        struct pgm_tile tile = pgm_mesh_tile(pgm->mesh_rows, pgm->settings.columns, k);
        if (tile.first != end) {
            selection->firsts[draws] = tile.first;
            selection->counts[draws++] = 0;
        }
        selection->counts[draws - 1] += (GLsizei)tile.count;
        triangles += tile.count / 3;
        end = tile.first + tile.count;
    }
    selection->draws[way] = draws - first;
    selection->way_triangles[way] = triangles;
    selection->triangles += triangles;
}

static void select_tiles(struct pgm *pgm, struct selection *selection, const struct view *view)
{
    int draws = 0;
    look_at_tiles(pgm, selection, view);
    for (int way = PGM_WAYS - 1; way >= 0; way--) { // what lies inside first: most of it
        select_way(pgm, selection, way, draws);
        draws += selection->draws[way];
    }
}

static double share_below(const struct pgm *pgm, const struct selection *selection)
{
    int below = 0;
    for (int j = 0; j <= selection->used.rows; j++)
        below += pgm->rows[j].forward_m < selection->sampler.screen_m;
    return below / (selection->used.rows + 1.0);
}

static void update_view(struct pgm *pgm, struct selection *selection, const struct view *view)
{
    struct pgm_sampler *sampler = &selection->sampler;
    memset(selection->draws, 0, sizeof selection->draws);
    selection->triangles = 0;
    selection->share_below = 0;
    selection->coarsened = 0;
    bool known = ground_under(pgm, view->eye_m, &pgm->world.ground_m);
    selection->below_ground = !known || view->eye_m[2] < pgm->world.ground_m;
    pgm_sampler_aim(sampler, view, &pgm->world, &pgm->settings);
    if (sampler->empty) return;
    struct pgm_settings *used = &selection->used;
    pgm_rows_fit(sampler, view, &pgm->world, &pgm->settings, pgm->mesh_rows, used);
    pgm_rows_lay(sampler, view, &pgm->world, used, pgm->rows);
    if (!pgm_atlas_is_full(&pgm->atlas))
        for (int j = 0; j <= used->rows; j++)
            selection->coarsened += coarsen_row(pgm, &pgm->rows[j], sampler, view);
    fill_block(pgm, selection, view);
    glBindBuffer(GL_UNIFORM_BUFFER, selection->sampling);
    gpu_buffer_sub_data(pgm->desc.gpu, GL_UNIFORM_BUFFER, 0, sizeof pgm->block, &pgm->block);
    glBindBuffer(GL_UNIFORM_BUFFER, selection->rows);
    gpu_buffer_sub_data(pgm->desc.gpu, GL_UNIFORM_BUFFER, 0,
                        sizeof pgm->rows_block.rows[0] * (size_t)(used->rows + 1), &pgm->rows_block);
    selection->share_below = share_below(pgm, selection);
    select_tiles(pgm, selection, view);
}

static bool pgm_update(struct renderer *renderer, const struct view *views, int count)
{
    struct pgm *pgm = (struct pgm *)renderer;
    // Tiles follow the first viewer; another makes do with what it finds there: coarser, but without holes.
    uint64_t before = gpu_counters(pgm->desc.gpu).upload_bytes;
    if (count > 0) {
        terrain_reader_begin_frame(pgm->reader, pgm->frame, views[0].eye_m);
        pgm_atlas_follow(&pgm->atlas, pgm->desc.gpu, pgm->desc.terrain, pgm->reader, &views[0]);
        pgm_atlas_follow(&pgm->colours, pgm->desc.gpu, pgm->desc.terrain, NULL, &views[0]);
    }
    pgm->refilled_bytes = gpu_counters(pgm->desc.gpu).upload_bytes - before;
    for (int i = 0; i < count; i++) update_view(pgm, &pgm->selections[i], &views[i]);
    return true;
}

// ---- draw ------------------------------------------------------------------

static void bind_textures(const GLuint *textures, int count, int unit)
{
    for (int i = 0; i < count && textures[i]; i++) {
        glActiveTexture(GL_TEXTURE0 + (GLenum)(unit + i));
        glBindTexture(GL_TEXTURE_2D, textures[i]);
    }
}

static bool shows_front_only(const struct pgm *pgm, const struct selection *selection, enum render_pass pass,
                             int way)
{
    if (pass == PASS_POSITION) return false; // measuring looks for faces seen from below
    if (pgm->faces == RENDERER_FACES_SAFE) return way & PGM_WITHIN_VIEW && !selection->below_ground;
    return pgm->faces == RENDERER_FACES_FRONT;
}

static void draw_way(const struct pgm *pgm, const struct selection *selection, enum render_pass pass, int way,
                     int first)
{
    int draws = selection->draws[way];
    uint64_t triangles = selection->way_triangles[way];
    gpu_use_program(pgm->desc.gpu, &pgm->programs[pass][way & PGM_WITHIN_MAP ? 1 : 0]);
    if (shows_front_only(pgm, selection, pass, way))
        glEnable(GL_CULL_FACE);
    else
        glDisable(GL_CULL_FACE);
    if (draws == 1)
        gpu_draw_elements(pgm->desc.gpu, GL_TRIANGLES, (size_t)selection->counts[first], GL_UNSIGNED_INT,
                          selection->firsts[first], 0, triangles);
    else
        gpu_multi_draw_elements(pgm->desc.gpu, GL_TRIANGLES, selection->counts + first, GL_UNSIGNED_INT,
                                selection->firsts + first, pgm->base_vertices, draws, triangles);
}

static void pgm_draw(struct renderer *renderer, int view_index, enum render_pass pass)
{
    struct pgm *pgm = (struct pgm *)renderer;
    const struct selection *selection = &pgm->selections[view_index];
    int count = pgm_atlas_textures(&pgm->atlas), first = 0;
    glBindBufferBase(GL_UNIFORM_BUFFER, SAMPLING_BINDING, selection->sampling);
    glBindBufferBase(GL_UNIFORM_BUFFER, ROWS_BINDING, selection->rows);
    bind_textures(pgm->atlas.textures, count, HEIGHTS_UNIT);
    bind_textures(pgm->atlas.shading, count, FRAGMENTS_UNIT);
    bind_textures(pgm->colours.textures, pgm_atlas_textures(&pgm->colours), FRAGMENTS_UNIT + count);
    glBindVertexArray(pgm->vertex_array);
    for (int way = PGM_WAYS - 1; way >= 0; way--) {
        if (selection->draws[way] > 0) draw_way(pgm, selection, pass, way, first);
        first += selection->draws[way];
    }
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
        .resident_bytes = pgm_atlas_bytes(&pgm->atlas) + pgm_atlas_bytes(&pgm->colours) + pgm->grid_bytes +
                          RENDERER_MAX_VIEWS * (sizeof pgm->block + sizeof pgm->rows_block),
        .counters = {{"rows", selection->sampler.empty ? 0 : selection->used.rows},
                     {"columns", selection->sampler.empty ? 0 : selection->used.columns},
                     {"extra_rows", selection->sampler.empty ? 0 : selection->used.extra_rows},
                     {"extension_degrees", selection->sampler.extension * degrees},
                     {"rows_below_screen", selection->share_below},
                     {"below_base", selection->sampler.below_base},
                     {"tile_side", pgm->atlas.side},
                     {"atlas_bytes", (double)pgm_atlas_bytes(&pgm->atlas)},
                     {"colour_side", pgm->colours.side},
                     {"colour_bytes", (double)pgm_atlas_bytes(&pgm->colours)},
                     {"refilled_bytes", (double)pgm->refilled_bytes},
                     {"rows_coarsened", selection->coarsened},
                     {"windows_late", (double)terrain_reader_counters(pgm->reader).missed}},
    };
}

const struct renderer_type pgm_renderer = {
    .name = "pgm",
    .summary = "persistent grid mapping with a sampling camera",
    .knobs = knobs,
    .quality_knob = "rows",
    .preset_knob = "grid",
    .quick = quick,
    .full = full,
    .create = pgm_create,
    .begin_frame = pgm_begin_frame,
    .update = pgm_update,
    .draw = pgm_draw,
    .stats = pgm_stats,
    .destroy = pgm_destroy,
};
