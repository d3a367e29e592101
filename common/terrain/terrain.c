// SPDX-License-Identifier: MIT
#include "common/terrain/terrain.h"

#include "common/embedded.h"
#include "common/report.h"
#include "common/terrain/extrema.h"
#include "common/terrain/heightfield.h"
#include "common/terrain/pyramid.h"
#include "common/terrain/upsample.h"
#include "common/terrain/voids.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

struct terrain {
    struct terrain_info info;
    struct pyramid pyramid;
};

// ---- from samples to a terrain ---------------------------------------------

// U and D may overshoot by 28.1 % of the range on each side (numerics.md, B11): half of the range of quanta
// leaves room.
enum { MOST_REFINE_BITS = 8, REFINED_LIMIT = 1 << 21 };

// Bits that samples of at most `magnitude` gain when the quantum is refined.
static int refine_bits(const struct terrain_options *options, int32_t magnitude)
{
    int wanted = options->refine_bits > 0         ? options->refine_bits
                 : options->synthesize_levels > 0 ? MOST_REFINE_BITS
                                                  : 0;
    int bits = 0;
    while (bits < wanted && ((int64_t)magnitude << (bits + 1)) <= REFINED_LIMIT) bits++;
    return bits;
}

static bool check_grid(const struct terrain_grid *grid, const struct terrain_options *options,
                       int32_t *magnitude)
{
    const int64_t most = (int64_t)1 << 31; // samples of the finest level that are kept in memory
    int finer = options->synthesize_levels;
    if (finer < 0 || finer > PYRAMID_MAX_FINER)
        return fail("%s: synthesize_levels is %d; 0 to %d is accepted", grid->name, finer, PYRAMID_MAX_FINER);
    if (grid->width < 1 || grid->height < 1)
        return fail("%s: has no samples; at least 1x1 is expected", grid->name);
    if (grid->width > most || grid->height > most || (grid->width << finer) > most / (grid->height << finer))
        return fail("%s: %lld x %lld samples and %d finer levels are more than memory serves; at most %lld "
                    "are accepted",
                    grid->name, (long long)grid->width, (long long)grid->height, finer, (long long)most);
    for (int axis = 0; axis < 2; axis++)
        if (!(grid->spacing_m[axis] > 0) || !isfinite(grid->spacing_m[axis]))
            return fail("%s: the spacing is %g; a positive number of metres is expected", grid->name,
                        grid->spacing_m[axis]);
    if (!(grid->quantum_m > 0) || !isfinite(grid->quantum_m) || !isfinite(grid->offset_m))
        return fail(
            "%s: the height scale is %g and the offset %g; a positive and a finite number are expected",
            grid->name, grid->quantum_m, grid->offset_m);
    *magnitude = 0;
    for (int64_t i = 0; i < grid->width * grid->height; i++) {
        int32_t q = grid->samples[i];
        if (q != HEIGHTFIELD_VOID && abs(q) > *magnitude) *magnitude = abs(q);
    }
    if (*magnitude > QUANTA_LIMIT)
        return fail("%s: a height of %d quanta; at most %d are accepted", grid->name, *magnitude,
                    QUANTA_LIMIT);
    return true;
}

static void describe(struct terrain *terrain, const struct terrain_grid *grid, int bits, uint64_t voids)
{
    struct terrain_info *info = &terrain->info;
    const struct pyramid *pyramid = &terrain->pyramid;
    const struct pyramid_level *finest = pyramid_level(pyramid, pyramid->finest);
    const struct terrain_extent *stored = &pyramid_level(pyramid, 0)->extent;
    *info = (struct terrain_info){.datum = TERRAIN_PLANE,
                                  .spacing_m = {grid->spacing_m[0], grid->spacing_m[1]},
                                  .quantum_m = ldexp(grid->quantum_m, -bits),
                                  .offset_m = grid->offset_m,
                                  .finest = pyramid->finest,
                                  .coarsest = pyramid->coarsest,
                                  .min_q = finest->min_q,
                                  .max_q = finest->max_q,
                                  .voids_filled = voids,
                                  .samples = (uint64_t)(pyramid_width(finest) * pyramid_height(finest))};
    strncpy(info->name, grid->name, sizeof info->name - 1);
    info->outline_m[0] = (double)stored->x0 * grid->spacing_m[0];
    info->outline_m[1] = (double)stored->y0 * grid->spacing_m[1];
    info->outline_m[2] = (double)(stored->x1 - 1) * grid->spacing_m[0];
    info->outline_m[3] = (double)(stored->y1 - 1) * grid->spacing_m[1];
}

struct terrain *terrain_from_grid(const struct terrain_grid *grid, const struct terrain_options *options)
{
    static const struct terrain_options DEFAULTS = {0};
    if (!options) options = &DEFAULTS;
    int32_t magnitude = 0;
    if (!check_grid(grid, options, &magnitude)) return NULL;
    size_t count = (size_t)(grid->width * grid->height);
    struct terrain *terrain = calloc(1, sizeof *terrain);
    int32_t *samples = malloc(count * sizeof *samples);
    if (!terrain || !samples) goto out_of_memory;
    memcpy(samples, grid->samples, count * sizeof *samples);
    uint64_t voids = voids_count(samples, count);
    if (voids == count) {
        fail("%s: every sample is void; at least one height is expected", grid->name);
        goto failed;
    }
    if (voids > 0 && !voids_fill(samples, grid->width, grid->height)) goto out_of_memory;
    int bits = refine_bits(options, magnitude);
    for (size_t i = 0; i < count; i++) samples[i] *= 1 << bits;
    struct terrain_extent extent = {grid->first[0], grid->first[1], grid->first[0] + grid->width,
                                    grid->first[1] + grid->height};
    bool built = pyramid_init(&terrain->pyramid, samples, &extent, options);
    samples = NULL; // the pyramid's
    if (!built) goto out_of_memory;
    describe(terrain, grid, bits, voids);
    return terrain;
out_of_memory:
    fail("%s: %lld x %lld samples do not fit in memory", grid->name, (long long)grid->width,
         (long long)grid->height);
failed:
    free(samples);
    terrain_destroy(terrain);
    return NULL;
}

static struct terrain *from_heightfield(struct heightfield *field, const struct terrain_options *options)
{
    struct terrain_grid grid = {.name = field->name,
                                .samples = field->samples,
                                .width = field->width,
                                .height = field->height,
                                .spacing_m = {field->spacing_m[0], field->spacing_m[1]},
                                .quantum_m = field->quantum_m,
                                .offset_m = field->offset_m};
    struct terrain *terrain = terrain_from_grid(&grid, options);
    heightfield_finish(field);
    return terrain;
}

struct terrain *terrain_load(const char *path, const struct terrain_options *options)
{
    struct heightfield field;
    if (!heightfield_load(&field, path)) return NULL;
    struct terrain *terrain = from_heightfield(&field, options);
    if (terrain && terrain->info.voids_filled > 0)
        note("%s: %llu void samples were filled from their neighbours", path,
             (unsigned long long)terrain->info.voids_filled);
    return terrain;
}

struct terrain *terrain_builtin(const struct terrain_options *options)
{
    const struct embedded_file *png = embedded_find("common/terrain/jacksboro_403x344.png");
    const struct embedded_file *json = embedded_find("common/terrain/jacksboro_403x344.json");
    if (!png || !json) {
        fail("common/terrain/jacksboro_403x344: is not in this program");
        return NULL;
    }
    struct heightfield field;
    if (!heightfield_load_memory(&field, png->path, png->data, (size_t)(png->end - png->data),
                                 (const char *)json->data, (size_t)(json->end - json->data)))
        return NULL;
    return from_heightfield(&field, options);
}

void terrain_destroy(struct terrain *terrain)
{
    if (!terrain) return;
    pyramid_finish(&terrain->pyramid);
    free(terrain);
}

// ---- reading ---------------------------------------------------------------

const struct terrain_info *terrain_info(const struct terrain *terrain)
{
    return &terrain->info;
}

struct terrain_level terrain_level(const struct terrain *terrain, int level)
{
    const struct pyramid_level *l = pyramid_level(&terrain->pyramid, level);
    return (struct terrain_level){
        .extent = l->extent,
        .spacing_m = {ldexp(terrain->info.spacing_m[0], level), ldexp(terrain->info.spacing_m[1], level)},
        .min_q = l->min_q,
        .max_q = l->max_q,
        .rms_error_m = l->rms_error_q * terrain->info.quantum_m,
        .max_error_m = l->max_error_q * terrain->info.quantum_m,
        .noise_q = l->sigma_q};
}

static int64_t clamp(int64_t value, int64_t low, int64_t high)
{
    return value < low ? low : value > high ? high : value;
}

bool terrain_window(const struct terrain *terrain, int level, int64_t x0, int64_t y0, int width, int height,
                    int32_t *out, enum terrain_wait wait)
{
    (void)wait; // every level is in memory
    const struct pyramid_level *l = pyramid_level(&terrain->pyramid, level);
    const struct terrain_extent *e = &l->extent;
    const int64_t far = (int64_t)1 << 62; // beyond any extent; keeps the sums below from overflowing
    x0 = clamp(x0, -far, far);
    y0 = clamp(y0, -far, far);
    int64_t west = clamp(e->x0 - x0, 0, width), east = clamp(e->x1 - x0, west, width); // columns inside
    for (int64_t j = 0; j < height; j++) {
        const int32_t *row = l->samples + (clamp(y0 + j, e->y0, e->y1 - 1) - e->y0) * pyramid_width(l);
        int32_t *to = out + j * width;
        for (int64_t i = 0; i < west; i++) to[i] = row[0];
        if (east > west) memcpy(to + west, row + (x0 + west - e->x0), (size_t)(east - west) * sizeof *to);
        for (int64_t i = east; i < width; i++) to[i] = row[pyramid_width(l) - 1];
    }
    return true;
}

void terrain_bounds(const struct terrain *terrain, int level, int64_t x0, int64_t y0, int64_t x1, int64_t y1,
                    int32_t *min_q, int32_t *max_q)
{
    const struct pyramid_level *l = pyramid_level(&terrain->pyramid, level);
    const struct terrain_extent *e = &l->extent;
    int64_t from[2] = {clamp(x0, e->x0, e->x1 - 1) - e->x0, clamp(y0, e->y0, e->y1 - 1) - e->y0};
    int64_t to[2] = {clamp(x1, e->x0, e->x1 - 1) - e->x0, clamp(y1, e->y0, e->y1 - 1) - e->y0};
    extrema_bounds(&l->extrema, l->samples, pyramid_width(l), from, to, min_q, max_q);
}

const int32_t *terrain_samples(const struct terrain *terrain, int level, size_t *stride)
{
    const struct pyramid_level *l = pyramid_level(&terrain->pyramid, level);
    *stride = (size_t)pyramid_width(l);
    return l->samples;
}

const struct terrain_extrema *terrain_extrema(const struct terrain *terrain)
{
    return &pyramid_level(&terrain->pyramid, terrain->pyramid.finest)->extrema;
}

// Cell and fraction of a place along one axis; a place on the last sample belongs to the cell before it.
static int64_t cell_of(double place_m, double spacing_m, int64_t first, int64_t end, double *fraction)
{
    double position = place_m / spacing_m, floored = floor(position);
    int64_t cell = clamp((int64_t)floored, first, end - 2 > first ? end - 2 : first);
    double rest = position - (double)cell;
    *fraction = rest < 0 ? 0 : rest > 1 ? 1 : rest;
    return cell - first;
}

bool terrain_truth_at(const struct terrain *terrain, double x_m, double y_m, double *height_q,
                      double slope[2])
{
    const struct terrain_info *info = &terrain->info;
    if (!(x_m >= info->outline_m[0] && x_m <= info->outline_m[2] && y_m >= info->outline_m[1] &&
          y_m <= info->outline_m[3]))
        return false;
    const struct pyramid_level *l = pyramid_level(&terrain->pyramid, info->finest);
    double spacing[2] = {ldexp(info->spacing_m[0], info->finest), ldexp(info->spacing_m[1], info->finest)}, u,
           v;
    int64_t width = pyramid_width(l);
    int64_t i = cell_of(x_m, spacing[0], l->extent.x0, l->extent.x1, &u);
    int64_t j = cell_of(y_m, spacing[1], l->extent.y0, l->extent.y1, &v);
    int64_t east = width > 1,
            north = pyramid_height(l) > 1 ? width : 0; // a single column or row repeats itself
    const int32_t *sw = l->samples + j * width + i;
    double z = *sw, z_se = sw[east], z_nw = sw[north], z_ne = sw[north + east];
    double along_x = u >= v ? z_se - z : z_ne - z_nw, along_y = u >= v ? z_ne - z_se : z_nw - z;
    *height_q = z + u * along_x + v * along_y;
    if (slope) {
        slope[0] = along_x / spacing[0];
        slope[1] = along_y / spacing[1];
    }
    return true;
}

// ---- place and world: on the plane they are the same -----------------------

void terrain_world_from_place(const struct terrain *terrain, const double place[3], double world_m[3])
{
    (void)terrain;
    memmove(world_m, place, 3 * sizeof *place);
}

void terrain_place_from_world(const struct terrain *terrain, const double world_m[3], double place[3])
{
    (void)terrain;
    memmove(place, world_m, 3 * sizeof *world_m);
}

void terrain_up(const struct terrain *terrain, const double world_m[3], double up[3])
{
    (void)terrain, (void)world_m;
    up[0] = 0, up[1] = 0, up[2] = 1;
}

size_t terrain_resident_bytes(const struct terrain *terrain)
{
    return sizeof *terrain + pyramid_bytes(&terrain->pyramid);
}
