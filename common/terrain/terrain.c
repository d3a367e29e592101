// SPDX-License-Identifier: MIT
#include "common/terrain/terrain.h"

#include "common/embedded.h"
#include "common/report.h"
#include "common/terrain/extrema.h"
#include "common/terrain/heightfield.h"
#include "common/terrain/paged.h"
#include "common/terrain/relief/relief_program.h"
#include "common/terrain/sphere.h"
#include "common/terrain/terrain_parts.h"
#include "common/terrain/upsample.h"
#include "common/terrain/voids.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static bool is_sphere(const struct terrain *terrain)
{
    return terrain->info.datum == TERRAIN_SPHERE;
}

static int64_t clamp(int64_t value, int64_t low, int64_t high)
{
    return value < low ? low : value > high ? high : value;
}

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
    int most_finer = options->radius_m > 0 ? DETAIL_MAX_FINER : PYRAMID_MAX_FINER;
    if (finer < 0 || finer > most_finer)
        return fail("%s: synthesize_levels is %d; 0 to %d is accepted", grid->name, finer, most_finer);
    if (options->radius_m > 0) finer = 0; // made on demand
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

// Whether a grid with a radius can be a whole planet.
static bool check_sphere(const struct terrain_grid *grid, const struct terrain_options *options)
{
    int64_t most = (int64_t)1 << 40;
    if (!(options->radius_m > 0)) return true;
    if (!isfinite(options->radius_m) || grid->width < 4 || grid->width % 2 || grid->height < 2 ||
        (options->pixel_centred ? grid->height % 2 != 0 : grid->height % 2 != 1))
        return fail(
            "%s: %lld x %lld samples are not a whole planet; an even number of columns is accepted, and "
            "an odd number of rows from pole to pole, or an even one of the centres of cells",
            grid->name, (long long)grid->width, (long long)grid->height);
    return llabs(grid->first[0]) < most || fail("%s: column %lld; at most %lld is accepted", grid->name,
                                                (long long)grid->first[0], (long long)most);
}

// Widens the bounds by those of a rectangle inside the extent, counted from its south-west sample.
static void widen_bounds(const struct pyramid_level *l, int64_t x0, int64_t y0, int64_t x1, int64_t y1,
                         int32_t *min_q, int32_t *max_q)
{
    int64_t from[2] = {x0, y0}, to[2] = {x1, y1};
    int32_t low, high;
    extrema_bounds(&l->extrema, l->samples, pyramid_width(l), from, to, &low, &high);
    *min_q = low < *min_q ? low : *min_q;
    *max_q = high > *max_q ? high : *max_q;
}

// Of a stored level.  Beyond a pole the whole rows up to it are taken.
static void sphere_bounds(const struct terrain *terrain, int level, int64_t x0, int64_t y0, int64_t x1,
                          int64_t y1, int32_t *min_q, int32_t *max_q)
{
    if (terrain->paged) {
        paged_planet_bounds(terrain->paged, level, x0, y0, x1, y1, min_q, max_q);
        return;
    }
    const struct pyramid_level *l = pyramid_level(&terrain->pyramid, level);
    struct sphere_grid grid = sphere_level(&terrain->detail.grid, level);
    int64_t rows = 2 * grid.pole, south = y0 + grid.pole, north = y1 + grid.pole;
    bool around = x1 - x0 >= grid.columns - 1 || south < 0 || north > rows;
    int64_t low = clamp(south < 0 ? 0 : north > rows ? 2 * rows - north : south, 0, rows);
    low = clamp(south, 0, low);
    int64_t high = clamp(south < 0 && -south > north ? -south : north, 0, rows);
    int64_t i = x0, j = 0;
    sphere_fold(&grid, &i, &j);
    int64_t west = i - grid.first, east = west + (x1 - x0);
    *min_q = INT32_MAX, *max_q = INT32_MIN;
    if (around) {
        widen_bounds(l, 0, low, grid.columns - 1, high, min_q, max_q);
        return;
    }
    widen_bounds(l, west, low, east < grid.columns ? east : grid.columns - 1, high, min_q, max_q);
    if (east >= grid.columns) widen_bounds(l, 0, low, east - grid.columns, high, min_q, max_q);
}

// What U may make of cells of level 0 in finer levels, and the norm that says so.
static double bound_cells(const struct terrain *terrain, int64_t x0, int64_t y0, int64_t x1, int64_t y1,
                          double bounds[2])
{
    int64_t south = y0 - DETAIL_REACH, north = y1 + DETAIL_REACH,
            more = detail_aside(&terrain->detail, south, north), aside = DETAIL_REACH + more;
    double norm = more ? DETAIL_NORM_MIXED : DETAIL_NORM;
    int32_t low = 0, high = 0;
    sphere_bounds(terrain, 0, x0 - aside, south, x1 + aside, north, &low, &high);
    double over = DETAIL_OVERSHOOT(norm) * ((double)high - low);
    bounds[0] = low - over;
    bounds[1] = high + over;
    return norm;
}

// Block by block: U leaves the range of what it reads by a share of that range, which for the whole map would
// promise mountains as high as its trenches are deep.
static void bound_detail(struct terrain *terrain)
{
    const int block = terrain->paged ? TERRAIN_PAGE : 8;
    const struct sphere_grid *grid = &terrain->detail.grid;
    double *bounds = terrain->without_noise_q, here[2];
    bounds[0] = HUGE_VAL, bounds[1] = -HUGE_VAL;
    for (int64_t y = -grid->pole; y < grid->pole; y += block)
        for (int64_t x = grid->first; x < grid->first + grid->columns; x += block) {
            bound_cells(terrain, x, y, x + block, y + block, here);
            bounds[0] = fmin(bounds[0], here[0]);
            bounds[1] = fmax(bounds[1], here[1]);
        }
}

// What a planet is, given its grid and what its detail is made from.
static void describe_sphere(struct terrain *terrain, double radius_m, const struct terrain_options *options)
{
    struct terrain_info *info = &terrain->info;
    struct detail *detail = &terrain->detail;
    info->datum = TERRAIN_SPHERE;
    info->radius_m = radius_m;
    info->wraps_x = true;
    info->spacing_m[0] = 2 * M_PI * radius_m / (double)detail->grid.columns;
    info->spacing_m[1] = M_PI * radius_m / (double)(2 * detail->grid.pole);
    info->outline_m[0] = (double)detail->grid.first * info->spacing_m[0];
    info->outline_m[1] = -M_PI / 2 * radius_m;
    info->outline_m[2] = (double)(detail->grid.first + detail->grid.columns) * info->spacing_m[0];
    info->outline_m[3] = M_PI / 2 * radius_m;
    info->finest = -options->synthesize_levels;
    detail->seed = options->seed;
    for (int level = -1; level >= info->finest; level--)
        detail->sigma_q[-level] =
            terrain->paged ? paged_noise_q(terrain->paged, level) : pyramid_noise_q(&terrain->pyramid, level);
    if (info->finest < 0) bound_detail(terrain);
    struct terrain_level finest = terrain_level(terrain, info->finest);
    info->min_q = finest.min_q;
    info->max_q = finest.max_q;
    info->samples =
        (uint64_t)(finest.extent.x1 - finest.extent.x0) * (uint64_t)(finest.extent.y1 - finest.extent.y0);
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

static bool build_pyramid(struct terrain *terrain, int32_t *samples, const struct terrain_grid *grid,
                          const struct terrain_options *options)
{
    if (options->radius_m > 0) {
        struct sphere_grid *sphere = &terrain->detail.grid;
        *sphere = sphere_grid(grid->first[0], grid->width, grid->height + options->pixel_centred);
        sphere_level_poles(sphere, samples);
        return pyramid_init_sphere(&terrain->pyramid, samples, sphere, options);
    }
    struct terrain_extent extent = {grid->first[0], grid->first[1], grid->first[0] + grid->width,
                                    grid->first[1] + grid->height};
    return pyramid_init(&terrain->pyramid, samples, &extent, options);
}

struct terrain *terrain_from_grid(const struct terrain_grid *grid, const struct terrain_options *options)
{
    static const struct terrain_options DEFAULTS = {0};
    if (!options) options = &DEFAULTS;
    int32_t magnitude = 0;
    if (!check_grid(grid, options, &magnitude) || !check_sphere(grid, options)) return NULL;
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
    if (options->radius_m > 0 && options->pixel_centred) {
        int32_t *pixels = samples;
        samples = sphere_from_pixels(pixels, grid->width, grid->height);
        free(pixels);
        if (!samples) goto out_of_memory;
    }
    bool built = build_pyramid(terrain, samples, grid, options);
    samples = NULL; // the pyramid's
    if (!built) goto out_of_memory;
    describe(terrain, grid, bits, voids);
    if (options->radius_m > 0) {
        terrain->detail.samples = pyramid_level(&terrain->pyramid, 0)->samples;
        describe_sphere(terrain, options->radius_m, options);
    }
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
    struct terrain_options own = options ? *options : (struct terrain_options){0};
    if (field->radius_m > 0) {
        own.radius_m = field->radius_m;
        own.pixel_centred = field->pixel_centred;
        grid.first[0] = -field->width / 2; // the first column is the 180th meridian
    }
    struct terrain *terrain = terrain_from_grid(&grid, &own);
    heightfield_finish(field);
    return terrain;
}

// What a file is called in reports: its name without folder and ending.
static void name_after(struct terrain_info *info, const char *path)
{
    const char *slash = strrchr(path, '/'), *name = slash ? slash + 1 : path, *dot = strrchr(name, '.');
    size_t length = dot && dot > name ? (size_t)(dot - name) : strlen(name);
    if (length >= sizeof info->name) length = sizeof info->name - 1;
    memcpy(info->name, name, length);
    info->name[length] = '\0';
}

static void read_stored(void *user, int64_t x0, int64_t y0, int width, int height, int32_t *out)
{
    paged_planet_window(user, 0, x0, y0, width, height, out, TERRAIN_WAIT);
}

static struct terrain *open_relief(const char *path, const struct terrain_options *options)
{
    static const struct terrain_options DEFAULTS = {0};
    struct terrain *terrain = calloc(1, sizeof *terrain);
    if (!terrain) return fail("%s: out of memory", path), NULL;
    terrain->paged = paged_open(path, options ? options : &DEFAULTS);
    if (terrain->paged) {
        const struct sphere_grid *planet = paged_planet(terrain->paged);
        paged_info(terrain->paged, &terrain->info);
        name_after(&terrain->info, path);
        if (planet) {
            terrain->detail = (struct detail){.grid = *planet, .read = read_stored, .user = terrain->paged};
            describe_sphere(terrain, terrain->info.radius_m, options ? options : &DEFAULTS);
        }
        return terrain;
    }
    terrain_destroy(terrain);
    return NULL;
}

struct terrain *terrain_load(const char *path, const struct terrain_options *options)
{
    if (relief_is_name(path)) return open_relief(path, options);
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
    paged_close(terrain->paged);
    pyramid_finish(&terrain->pyramid);
    free(terrain);
}

// ---- reading ---------------------------------------------------------------

const struct terrain_info *terrain_info(const struct terrain *terrain)
{
    return &terrain->info;
}

// A level that is made on demand: what can be told without making it.
static struct terrain_level detail_level(const struct terrain *terrain, int level)
{
    struct sphere_grid grid = sphere_level(&terrain->detail.grid, level);
    double noise_q = detail_noise_limit(&terrain->detail, -level, DETAIL_NORM_MIXED);
    return (struct terrain_level){
        .extent = sphere_extent(&grid),
        .spacing_m = {ldexp(terrain->info.spacing_m[0], level), ldexp(terrain->info.spacing_m[1], level)},
        .min_q = (int32_t)floor(terrain->without_noise_q[0] - noise_q),
        .max_q = (int32_t)ceil(terrain->without_noise_q[1] + noise_q),
        .noise_q = terrain->detail.sigma_q[-level]};
}

static struct terrain_level stored_level(const struct terrain *terrain, int level)
{
    if (terrain->paged) {
        struct terrain_level stored = paged_level(terrain->paged, level);
        struct sphere_grid grid = sphere_level(&terrain->detail.grid, level);
        if (is_sphere(terrain)) stored.extent = sphere_extent(&grid);
        for (int axis = 0; is_sphere(terrain) && axis < 2; axis++)
            stored.spacing_m[axis] = ldexp(terrain->info.spacing_m[axis], level);
        return stored;
    }
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

struct terrain_level terrain_level(const struct terrain *terrain, int level)
{
    bool made = is_sphere(terrain) && level < 0;
    struct terrain_level of = made ? detail_level(terrain, level) : stored_level(terrain, level);
    // The levels that are made are too large to be compared with any other.
    if (is_sphere(terrain) && level > terrain->info.finest && terrain->info.finest < 0)
        of.rms_error_m = of.max_error_m = (double)NAN;
    return of;
}

bool terrain_window(const struct terrain *terrain, int level, int64_t x0, int64_t y0, int width, int height,
                    int32_t *out, enum terrain_wait wait)
{
    if (is_sphere(terrain) && level < 0) {
        struct terrain_extent e = detail_under(&terrain->detail, level, x0, y0, width, height);
        if (terrain->paged && wait == TERRAIN_TRY &&
            !paged_planet_window(terrain->paged, 0, e.x0, e.y0, (int)(e.x1 - e.x0), (int)(e.y1 - e.y0), NULL,
                                 wait))
            return false;
        detail_window(&terrain->detail, level, x0, y0, width, height, out);
        return true;
    }
    if (terrain->paged)
        return (is_sphere(terrain) ? paged_planet_window : paged_window)(terrain->paged, level, x0, y0, width,
                                                                         height, out, wait);
    if (is_sphere(terrain)) {
        struct sphere_grid grid = sphere_level(&terrain->detail.grid, level);
        sphere_window(&grid, pyramid_level(&terrain->pyramid, level)->samples, x0, y0, width, height, out);
        return true;
    }
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

// Of a level made on demand: the stored samples that it is made of, and how far it may leave their range.
static void detail_bounds(const struct terrain *terrain, int level, int64_t x0, int64_t y0, int64_t x1,
                          int64_t y1, int32_t *min_q, int32_t *max_q)
{
    double bounds[2], norm = bound_cells(terrain, x0 >> -level, y0 >> -level, (x1 >> -level) + 1,
                                         (y1 >> -level) + 1, bounds);
    double noise_q = detail_noise_limit(&terrain->detail, -level, norm);
    *min_q = (int32_t)floor(bounds[0] - noise_q);
    *max_q = (int32_t)ceil(bounds[1] + noise_q);
}

void terrain_bounds(const struct terrain *terrain, int level, int64_t x0, int64_t y0, int64_t x1, int64_t y1,
                    int32_t *min_q, int32_t *max_q)
{
    if (is_sphere(terrain)) {
        (level < 0 ? detail_bounds : sphere_bounds)(terrain, level, x0, y0, x1, y1, min_q, max_q);
        return;
    }
    if (terrain->paged) {
        paged_bounds(terrain->paged, level, x0, y0, x1, y1, min_q, max_q);
        return;
    }
    const struct pyramid_level *l = pyramid_level(&terrain->pyramid, level);
    const struct terrain_extent *e = &l->extent;
    int64_t from[2] = {clamp(x0, e->x0, e->x1 - 1) - e->x0, clamp(y0, e->y0, e->y1 - 1) - e->y0};
    int64_t to[2] = {clamp(x1, e->x0, e->x1 - 1) - e->x0, clamp(y1, e->y0, e->y1 - 1) - e->y0};
    extrema_bounds(&l->extrema, l->samples, pyramid_width(l), from, to, min_q, max_q);
}

double terrain_error(const struct terrain *terrain, int level, int64_t x0, int64_t y0, int64_t x1, int64_t y1)
{
    if (terrain->paged && !is_sphere(terrain)) return paged_error(terrain->paged, level, x0, y0, x1, y1);
    return terrain_level(terrain, level).max_error_m;
}

bool terrain_failed(const struct terrain *terrain)
{
    return terrain->paged && paged_failed(terrain->paged);
}

const int32_t *terrain_samples(const struct terrain *terrain, int level, size_t *stride)
{
    if (terrain->paged || level < terrain->pyramid.finest) return NULL;
    const struct pyramid_level *l = pyramid_level(&terrain->pyramid, level);
    *stride = (size_t)pyramid_width(l);
    return l->samples;
}

const struct terrain_extrema *terrain_extrema(const struct terrain *terrain)
{
    return terrain->paged ? NULL : &pyramid_level(&terrain->pyramid, terrain->pyramid.finest)->extrema;
}

void terrain_page(const struct terrain *terrain, int level, int64_t x, int64_t y, struct terrain_page *page)
{
    paged_page(terrain->paged, level, x, y, page);
}

void terrain_page_release(const struct terrain *terrain, struct terrain_page *page)
{
    if (terrain->paged) paged_page_release(terrain->paged, page);
}

int32_t terrain_node_max(const struct terrain *terrain, int height, int64_t i, int64_t j)
{
    return paged_node_max(terrain->paged, height, i, j);
}

int terrain_coarsest_page(const struct terrain *terrain)
{
    return paged_coarsest_page(terrain->paged);
}

const struct detail *terrain_detail(const struct terrain *terrain)
{
    return is_sphere(terrain) ? &terrain->detail : NULL;
}

// Cell and fraction of a place along one axis; a place on the last sample belongs to the cell before it.
static int64_t cell_of(double place_m, double spacing_m, int64_t first, int64_t end, double *fraction)
{
    double position = place_m / spacing_m, floored = floor(position);
    int64_t cell = clamp((int64_t)floored, first, end - 2 > first ? end - 2 : first);
    double rest = position - (double)cell;
    *fraction = rest < 0 ? 0 : rest > 1 ? 1 : rest;
    return cell;
}

// On a sphere: any longitude; a latitude that rounding put beyond a pole is the pole's.
static bool sphere_truth_at(const struct terrain *terrain, double x_m, double y_m, double *height_q,
                            double slope[2])
{
    const struct terrain_info *info = &terrain->info;
    struct sphere_grid grid = sphere_level(&terrain->detail.grid, info->finest);
    double spacing[2] = {ldexp(info->spacing_m[0], info->finest), ldexp(info->spacing_m[1], info->finest)};
    double pole = (double)grid.pole, place[2] = {x_m / spacing[0], y_m / spacing[1]};
    if (!isfinite(place[0]) || !(fabs(place[1]) <= pole + 1e-6 * pole)) return false;
    place[1] = fmin(fmax(place[1], -pole), pole);
    int64_t i = (int64_t)floor(place[0]), j = clamp((int64_t)floor(place[1]), -grid.pole, grid.pole - 1);
    double u = place[0] - (double)i, v = place[1] - (double)j, z[2][2]; // [north][east]
    bool bilinear = j == -grid.pole || j == grid.pole - 1;
    if (info->finest < 0) {
        int e = detail_cell_exponent(&terrain->detail, info->finest, j);
        int64_t post = (i - grid.first) >> e;
        double west = (double)(post * ((int64_t)1 << e) + grid.first);
        int32_t around[2 * DETAIL_CELL];
        detail_posts(&terrain->detail, info->finest, e, post - 1, j, DETAIL_CELL, 2, around);
        const bool wider[2] = {detail_exponent(&terrain->detail, info->finest, j) > e,
                               detail_exponent(&terrain->detail, info->finest, j + 1) > e};
        detail_corners(post, wider, around, DETAIL_CELL, z);
        bilinear = bilinear || e > 0;
        spacing[0] = ldexp(spacing[0], e);
        u = ldexp(place[0] - west, -e);
    } else {
        int32_t corners[4];
        terrain_window(terrain, 0, i, j, 2, 2, corners, TERRAIN_WAIT);
        for (int k = 0; k < 4; k++) z[k / 2][k % 2] = corners[k];
    }
    double across = bilinear ? v : u < v, along = bilinear ? u : u >= v; // of the edges whose slopes count
    double along_x = (1 - across) * (z[0][1] - z[0][0]) + across * (z[1][1] - z[1][0]),
           along_y = (1 - along) * (z[1][0] - z[0][0]) + along * (z[1][1] - z[0][1]);
    *height_q = z[0][0] + u * (bilinear ? z[0][1] - z[0][0] : along_x) + v * along_y;
    if (slope) {
        slope[0] = along_x / spacing[0];
        slope[1] = along_y / spacing[1];
    }
    return true;
}

// The four samples around cell (i, j) of the finest level, south row first; a single column or row repeats
// itself.
static void read_corners(const struct terrain *terrain, int64_t i, int64_t j, int32_t corners[4])
{
    if (terrain->paged) {
        struct terrain_page page = {0};
        paged_page(terrain->paged, terrain->info.finest, i / TERRAIN_PAGE, j / TERRAIN_PAGE, &page);
        const int32_t *at = page.samples + j % TERRAIN_PAGE * (TERRAIN_PAGE + 1) + i % TERRAIN_PAGE;
        for (int k = 0; k < 4; k++) corners[k] = at[(k >> 1) * (TERRAIN_PAGE + 1) + (k & 1)];
        paged_page_release(terrain->paged, &page);
        return;
    }
    const struct pyramid_level *l = pyramid_level(&terrain->pyramid, terrain->info.finest);
    int64_t width = pyramid_width(l), east = width > 1, north = pyramid_height(l) > 1 ? width : 0;
    const int32_t *sw = l->samples + (j - l->extent.y0) * width + (i - l->extent.x0);
    corners[0] = sw[0], corners[1] = sw[east], corners[2] = sw[north], corners[3] = sw[north + east];
}

bool terrain_truth_at(const struct terrain *terrain, double x_m, double y_m, double *height_q,
                      double slope[2])
{
    const struct terrain_info *info = &terrain->info;
    if (is_sphere(terrain)) return sphere_truth_at(terrain, x_m, y_m, height_q, slope);
    if (!(x_m >= info->outline_m[0] && x_m <= info->outline_m[2] && y_m >= info->outline_m[1] &&
          y_m <= info->outline_m[3]))
        return false;
    const struct terrain_level level = terrain_level(terrain, info->finest);
    const struct terrain_extent *e = &level.extent;
    double u, v;
    int32_t corners[4];
    int64_t i = cell_of(x_m, level.spacing_m[0], e->x0, e->x1, &u);
    int64_t j = cell_of(y_m, level.spacing_m[1], e->y0, e->y1, &v);
    read_corners(terrain, i, j, corners);
    double z = corners[0], z_se = corners[1], z_nw = corners[2], z_ne = corners[3];
    double along_x = u >= v ? z_se - z : z_ne - z_nw, along_y = u >= v ? z_ne - z_se : z_nw - z;
    *height_q = z + u * along_x + v * along_y;
    if (slope) {
        slope[0] = along_x / level.spacing_m[0];
        slope[1] = along_y / level.spacing_m[1];
    }
    return true;
}

// ---- place and world: on the plane they are the same -----------------------

void terrain_world_from_place(const struct terrain *terrain, const double place[3], double world_m[3])
{
    if (is_sphere(terrain))
        sphere_world_from_place(terrain->info.radius_m, place, world_m);
    else
        memmove(world_m, place, 3 * sizeof *place);
}

void terrain_place_from_world(const struct terrain *terrain, const double world_m[3], double place[3])
{
    if (is_sphere(terrain))
        sphere_place_from_world(terrain->info.radius_m, world_m, place);
    else
        memmove(place, world_m, 3 * sizeof *world_m);
}

void terrain_up(const struct terrain *terrain, const double world_m[3], double up[3])
{
    double place[3], axes[3][3];
    terrain_place_from_world(terrain, world_m, place);
    terrain_axes(terrain, place, axes);
    memcpy(up, axes[2], sizeof axes[2]);
}

void terrain_axes(const struct terrain *terrain, const double place[3], double axes[3][3])
{
    static const double PLANE[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    if (is_sphere(terrain))
        sphere_axes(terrain->info.radius_m, place, axes);
    else
        memcpy(axes, PLANE, sizeof PLANE);
}

size_t terrain_resident_bytes(const struct terrain *terrain)
{
    if (terrain->paged) return sizeof *terrain + paged_resident_bytes(terrain->paged);
    return sizeof *terrain + pyramid_bytes(&terrain->pyramid);
}
