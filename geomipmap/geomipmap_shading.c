// SPDX-License-Identifier: MIT
#include "geomipmap/geomipmap_shading.h"

#include "common/report.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

enum { LIGHT_UNIT = 3, COLOUR_UNIT = 4, MOST_LIGHT_SAMPLES = 1 << 24 };

static const double to_sun[3] = {-0.58, 0.58, 0.57}; // that of terrain.frag

static double now_ms(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec * 1e3 + (double)t.tv_nsec * 1e-6;
}

// ---- life ---------------------------------------------------------------------------------------

// The finest level that is not too large for a light map in memory.
static int light_level(const struct terrain *terrain)
{
    for (int n = terrain_info(terrain)->finest; n < terrain_info(terrain)->coarsest; n++) {
        struct terrain_extent e = terrain_level(terrain, n).extent;
        if ((e.x1 - e.x0) * (e.y1 - e.y0) <= MOST_LIGHT_SAMPLES) return n;
    }
    return terrain_info(terrain)->coarsest;
}

static void cut_blocks(struct geomipmap_shading *shading, const struct geomipmap_tiles *tiles,
                       const struct geomipmap_colour *colour, int most_px)
{
    const struct geomipmap_grid *grid = &tiles->grid[0];
    double pixels_a_tile = ldexp(1, tiles->bits - (light_level(tiles->terrain) - tiles->finest));
    if (colour->pixels) pixels_a_tile = fmax(pixels_a_tile, (double)colour->width / grid->columns);
    int height = tiles->merge;
    while (2 * pixels_a_tile * (1 << height) + 3 <= most_px && 1 << height < grid->columns) height++;
    shading->block_height = height;
    shading->blocks = (struct geomipmap_blocks){.columns = ((grid->columns - 1) >> height) + 1,
                                                .rows = ((grid->rows - 1) >> height) + 1};
    for (int axis = 0; axis < 2; axis++) {
        shading->blocks.origin_m[axis] = (double)(axis ? tiles->y0 : tiles->x0) * tiles->spacing_m[axis];
        shading->blocks.size_m[axis] = tiles->spacing_m[axis] * (1 << (tiles->bits + height));
    }
}

// Lowest and highest sample of each block.
static void range_blocks(struct geomipmap_shading *shading, const struct geomipmap_tiles *tiles)
{
    for (int b = 0; b < shading->blocks.columns * shading->blocks.rows; b++)
        shading->ranges[b] = geomipmap_tiles_bounds(
            tiles, (struct geomipmap_place){shading->block_height, b % shading->blocks.columns,
                                            b / shading->blocks.columns});
}

// Makes the light map.  Its pixels stand on samples, so that it reaches half a pixel beyond them.
static bool make_light(struct geomipmap_shading *shading, const struct geomipmap_tiles *tiles,
                       double area_m[4])
{
    int width, height, n = light_level(tiles->terrain);
    struct terrain_level level = terrain_level(tiles->terrain, n);
    double start = now_ms();
    shading->light_pixels = geomipmap_light_map(tiles->terrain, n, to_sun, &width, &height);
    if (!shading->light_pixels ||
        !geomipmap_picture_init(&shading->light_picture, width, height, 1, shading->light_pixels))
        return false;
    shading->light_ms = now_ms() - start;
    area_m[0] = ((double)level.extent.x0 - 0.5) * level.spacing_m[0];
    area_m[1] = ((double)level.extent.y0 - 0.5) * level.spacing_m[1];
    area_m[2] = ((double)level.extent.x1 - 0.5) * level.spacing_m[0];
    area_m[3] = ((double)level.extent.y1 - 0.5) * level.spacing_m[1];
    return true;
}

bool geomipmap_shading_init(struct geomipmap_shading *shading, struct gpu *gpu,
                            const struct geomipmap_tiles *tiles, const struct geomipmap_colour *colour,
                            int most_px, size_t ceiling_bytes)
{
    *shading = (struct geomipmap_shading){.need_count = 0};
    cut_blocks(shading, tiles, colour, most_px);
    size_t count = (size_t)shading->blocks.columns * (size_t)shading->blocks.rows;
    shading->need_of = malloc(count * sizeof *shading->need_of);
    shading->needs = malloc(count * sizeof *shading->needs);
    shading->starts = malloc(count * sizeof *shading->starts);
    shading->ranges = malloc(count * sizeof *shading->ranges);
    shading->coming = malloc(count * sizeof *shading->coming);
    if (!shading->need_of || !shading->needs || !shading->starts || !shading->ranges || !shading->coming)
        return fail("geomipmap: no memory for %zu map blocks", count);
    range_blocks(shading, tiles);
    for (size_t b = 0; b < count; b++) shading->need_of[b] = -1;
    double area_m[4];
    if (!make_light(shading, tiles, area_m)) return false;
    size_t light_ceiling = ceiling_bytes;
    if (colour->pixels) {
        double light = (double)shading->light_picture.level[0].width * shading->light_picture.level[0].height;
        double colours = 4.0 * colour->width * colour->height;
        light_ceiling = (size_t)((double)ceiling_bytes * light / (light + colours));
        if (!geomipmap_picture_init(&shading->colour_picture, colour->width, colour->height, 4,
                                    colour->pixels) ||
            !geomipmap_drape_init(&shading->colour, gpu, &shading->colour_picture,
                                  terrain_info(tiles->terrain)->outline_m, &shading->blocks, most_px,
                                  ceiling_bytes - light_ceiling))
            return false;
    }
    return geomipmap_drape_init(&shading->light, gpu, &shading->light_picture, area_m, &shading->blocks,
                                most_px, light_ceiling);
}

void geomipmap_shading_finish(struct geomipmap_shading *shading)
{
    geomipmap_drape_finish(&shading->light);
    geomipmap_drape_finish(&shading->colour);
    geomipmap_picture_finish(&shading->light_picture);
    geomipmap_picture_finish(&shading->colour_picture);
    free(shading->light_pixels);
    free(shading->need_of);
    free(shading->needs);
    free(shading->starts);
    free(shading->ordered);
    free(shading->ranges);
    free(shading->coming);
    *shading = (struct geomipmap_shading){0};
}

size_t geomipmap_shading_bytes(const struct geomipmap_shading *shading)
{
    size_t blocks = (size_t)shading->blocks.columns * (size_t)shading->blocks.rows, bytes = 0;
    for (int level = 0; level < shading->light_picture.levels; level++)
        bytes += (size_t)shading->light_picture.level[level].width *
                 (size_t)shading->light_picture.level[level].height;
    return bytes + (size_t)shading->ordered_room * sizeof *shading->ordered +
           blocks * (sizeof *shading->need_of + sizeof *shading->needs + sizeof *shading->starts +
                     sizeof *shading->ranges + sizeof *shading->coming) +
           geomipmap_drape_bytes(&shading->light) + geomipmap_drape_bytes(&shading->colour);
}

void geomipmap_shading_use_program(struct geomipmap_shading *shading, GLuint program)
{
    shading->light_unit = glGetUniformLocation(program, "block_light");
    shading->light_place = glGetUniformLocation(program, "light_place");
    shading->colour_unit = glGetUniformLocation(program, "block_colour");
    shading->colour_place = glGetUniformLocation(program, "colour_place");
}

// ---- the frame ----------------------------------------------------------------------------------

int geomipmap_shading_block(const struct geomipmap_shading *shading, struct geomipmap_place place)
{
    int shift = shading->block_height - place.height;
    return (place.row >> shift) * shading->blocks.columns + (place.column >> shift);
}

void geomipmap_shading_begin(struct geomipmap_shading *shading)
{
    for (int i = 0; i < shading->need_count; i++) shading->need_of[shading->needs[i].block] = -1;
    shading->need_count = 0;
    shading->pixels_per_tangent = 0;
}

static void need_block(struct geomipmap_shading *shading, const struct geomipmap_pick *pick)
{
    int block = geomipmap_shading_block(shading, pick->place), *number = &shading->need_of[block];
    if (*number < 0) {
        *number = shading->need_count++;
        shading->needs[*number] = (struct geomipmap_need){block, INFINITY};
    }
    struct geomipmap_need *need = &shading->needs[*number];
    if (pick->seen) need->depth_m = fmin(need->depth_m, (double)pick->depth_m);
}

static bool reserve_ordered(struct geomipmap_shading *shading, int room)
{
    if (shading->ordered_room >= room) return true;
    struct geomipmap_pick *ordered = realloc(shading->ordered, (size_t)room * sizeof *ordered);
    if (!ordered) return fail("geomipmap: no memory to put %d tiles in order", room);
    shading->ordered = ordered;
    shading->ordered_room = room;
    return true;
}

// Counts picks by block and deals them out again.
static void order_by_block(struct geomipmap_shading *shading, struct geomipmap_selection *selection,
                           int first, int end)
{
    int *starts = shading->starts, place = first;
    for (int n = 0; n < shading->need_count; n++) starts[n] = 0;
    for (int i = first; i < end; i++)
        starts[shading->need_of[geomipmap_shading_block(shading, selection->picks[i].place)]]++;
    for (int n = 0; n < shading->need_count; n++) {
        int count = starts[n];
        starts[n] = place;
        place += count;
    }
    for (int i = first; i < end; i++) {
        int n = shading->need_of[geomipmap_shading_block(shading, selection->picks[i].place)];
        shading->ordered[starts[n]++] = selection->picks[i];
    }
    memcpy(selection->picks + first, shading->ordered + first,
           (size_t)(end - first) * sizeof *selection->picks);
}

bool geomipmap_shading_add(struct geomipmap_shading *shading, struct geomipmap_selection *selection,
                           int drawn, double pixels_per_tangent)
{
    if (!reserve_ordered(shading, selection->room)) return false;
    for (int i = 0; i < drawn; i++) need_block(shading, &selection->picks[i]);
    order_by_block(shading, selection, 0, selection->seen);
    order_by_block(shading, selection, selection->seen, drawn);
    shading->pixels_per_tangent = fmax(shading->pixels_per_tangent, pixels_per_tangent);
    return true;
}

bool geomipmap_shading_end(struct geomipmap_shading *shading)
{
    return geomipmap_drape_ask(&shading->light, shading->needs, shading->need_count,
                               shading->pixels_per_tangent) &&
           (!shading->colour.subs || geomipmap_drape_ask(&shading->colour, shading->needs,
                                                         shading->need_count, shading->pixels_per_tangent));
}

void geomipmap_shading_foresee(struct geomipmap_shading *shading, const struct geomipmap_tiles *tiles,
                               const struct view *view, const double step_m[3])
{
    const struct geomipmap_blocks *blocks = &shading->blocks;
    struct frustum frustum;
    int count = 0;
    frustum_init(&frustum, view); // planes are relative to the eye
    for (int b = 0; b < blocks->columns * blocks->rows; b++) {
        const int cell[2] = {b % blocks->columns, b / blocks->columns};
        double low[3], high[3], depth = 0;
        unsigned mask = FRUSTUM_ALL;
        for (int axis = 0; axis < 3; axis++) {
            double eye = view->eye_m[axis] + step_m[axis];
            low[axis] = axis < 2 ? blocks->origin_m[axis] + cell[axis] * blocks->size_m[axis] - eye
                                 : shading->ranges[b].low * tiles->quantum_m + tiles->offset_m - eye;
            high[axis] = axis < 2 ? low[axis] + blocks->size_m[axis]
                                  : shading->ranges[b].high * tiles->quantum_m + tiles->offset_m - eye;
            depth += view->forward[axis] * (view->forward[axis] > 0 ? low[axis] : high[axis]);
        }
        if (frustum_test_box(&frustum, low, high, &mask) == FRUSTUM_OUTSIDE) continue;
        shading->coming[count++] = (struct geomipmap_need){b, fmax(depth, view->near_m)};
    }
    geomipmap_drape_foresee(&shading->light, shading->coming, count, view->pixels_per_tangent);
    if (shading->colour.subs)
        geomipmap_drape_foresee(&shading->colour, shading->coming, count, view->pixels_per_tangent);
}

static void bind_drape(const struct geomipmap_drape *drape, int block, const double eye_m[3], GLint unit,
                       GLint place_at, int number)
{
    float place[4];
    glActiveTexture((GLenum)(GL_TEXTURE0 + number));
    geomipmap_drape_bind(drape, block, eye_m, place);
    glUniform1i(unit, number);
    glUniform4fv(place_at, 1, place);
}

void geomipmap_shading_bind(const struct geomipmap_shading *shading, int block, const double eye_m[3])
{
    bind_drape(&shading->light, block, eye_m, shading->light_unit, shading->light_place, LIGHT_UNIT);
    if (shading->colour.subs)
        bind_drape(&shading->colour, block, eye_m, shading->colour_unit, shading->colour_place, COLOUR_UNIT);
}
