// SPDX-License-Identifier: MIT
#include "clipmap/sphere_levels.h"

#include "common/report.h"
#include "common/terrain/detail.h"

#include <math.h>
#include <stdlib.h>

enum { MARGIN = 4, SNAP = 4 }; // texels beyond what rings reach; windows begin on multiples of SNAP

// Rows get no narrower cells towards the pole.
static int64_t first_bilinear(const struct detail *detail, int level)
{
    int64_t low = 0, high = (detail->grid.pole << -level) - 1;
    while (low < high) {
        int64_t middle = low + (high - low) / 2;
        if (detail_cell_exponent(detail, level, middle) > 0)
            high = middle;
        else
            low = middle + 1;
    }
    return low;
}

void sphere_shape_init(struct sphere_shape *shape, const struct terrain *terrain, int azimuths,
                       double texture)
{
    const struct terrain_info *info = terrain_info(terrain);
    struct terrain_extent e = terrain_level(terrain, 0).extent;
    *shape = (struct sphere_shape){.azimuths = azimuths,
                                   .texture = texture,
                                   .sampled = info->finest,
                                   .finest = info->finest - SPHERE_LONGITUDE_LEVELS,
                                   .coarsest = info->coarsest,
                                   .radius_m = info->radius_m,
                                   .spacing_m = {info->spacing_m[0], info->spacing_m[1]},
                                   .columns = e.x1 - e.x0,
                                   .first = e.x0,
                                   .pole = e.y1 - 1};
    if (shape->finest < shape->coarsest - SPHERE_MAX_LEVELS + 1)
        shape->finest = shape->coarsest - SPHERE_MAX_LEVELS + 1;
    if (shape->sampled < shape->finest) shape->sampled = shape->finest;
    for (int level = -1; level >= shape->sampled; level--)
        shape->bilinear[-level] = first_bilinear(terrain_detail(terrain), level);
    sphere_shape_size(shape);
}

void sphere_shape_size(struct sphere_shape *shape)
{
    // Twice what rows need, for columns crowd; a turn must fit when no more columns can be taken together.
    int64_t columns = shape->columns >> shape->coarsest, rows = 2 * (shape->pole >> shape->coarsest) + 1;
    int64_t size = (int64_t)ceil(2 * shape->texture * shape->azimuths), turn = columns;
    while (turn % 2 == 0 && turn > size) turn /= 2;
    size = size > turn ? size : turn;
    shape->size = (int)(size > 4 * (MARGIN + SNAP) ? size : 4 * (MARGIN + SNAP));
    shape->whole = (int)((columns > rows ? columns : rows) + 2 * MARGIN);
}

int sphere_level_size(const struct sphere_shape *shape, int level)
{
    return level == shape->coarsest ? shape->whole : shape->size;
}

static int sampled_level(const struct sphere_shape *shape, int level)
{
    return level < shape->sampled ? shape->sampled : level;
}

double sphere_spacing(const struct sphere_shape *shape, int level, int axis)
{
    return ldexp(shape->spacing_m[axis], sampled_level(shape, level));
}

// How far from the viewer rings sample a level: where they sample the next one alone.
static double reach_of(const struct sphere_shape *shape, int level)
{
    if (level == shape->coarsest) return M_PI;
    return 0.5 * shape->texture * shape->azimuths * ldexp(shape->spacing_m[1], level) / shape->radius_m;
}

double sphere_level_at(const struct sphere_shape *shape, double angle)
{
    return log2(4 / shape->texture * angle * shape->radius_m / (shape->azimuths * shape->spacing_m[1]));
}

static int64_t turn_of(const struct sphere_shape *shape, int level)
{
    level = sampled_level(shape, level);
    return level > 0 ? shape->columns >> level : shape->columns << -level;
}

// Half the longitudes that a cap of an angle spans; NAN when it holds a pole (section 4.1, corrected: SC7).
static double half_longitude(double angle, double latitude)
{
    double share = sin(angle) / cos(latitude);
    return angle < M_PI / 2 - fabs(latitude) && share < 1 ? asin(share) : (double)NAN;
}

static int64_t snap_down(double value)
{
    return (int64_t)floor(value / SNAP) * SNAP;
}

struct sphere_window sphere_window_wanted(const struct sphere_shape *shape, int level,
                                          const double place_m[2])
{
    double spacing_m = sphere_spacing(shape, level, 1), column_m = sphere_spacing(shape, level, 0);
    double angle = reach_of(shape, level);
    double half = half_longitude(angle, place_m[1] / shape->radius_m) * shape->radius_m / column_m;
    int64_t turn = turn_of(shape, level);
    int size = sphere_level_size(shape, level);
    struct sphere_window window = {.period = size};
    bool fits = !isnan(half);
    // All levels' reaches have about as many columns: the latitudes where they take more together, and are
    // read anew for it, are spread, that no frame has to read them all.
    double room = (1 - 0.02 * clipmap_slot(level, 8)) * size / 2;
    while (fits && half / (1 << window.decimation) + MARGIN + SNAP > room) {
        window.decimation++;
        fits = turn % ((int64_t)1 << window.decimation) == 0 && window.decimation < 30;
    }
    if (!fits || turn >> window.decimation <= size) { // then the turn is no larger than a window
        for (window.decimation = 0; turn >> window.decimation > size; window.decimation++) continue;
        window.around = true;
        window.period = (int)(turn >> window.decimation);
    }
    double x = place_m[0] / ldexp(column_m, window.decimation), y = place_m[1] / spacing_m;
    double rows = fmin(angle * shape->radius_m / spacing_m, size / 2.0 - SNAP - MARGIN) + MARGIN;
    window.box.lo[1] = snap_down(y - rows);
    window.box.hi[1] = snap_down(y + rows) + SNAP;
    if (level == shape->coarsest) { // all rows there are, wherever the viewer is
        window.box.lo[1] = -(shape->pole >> level) - 1;
        window.box.hi[1] = (shape->pole >> level) + 1;
    }
    if (window.around) {
        window.box.hi[0] = window.period - 1;
        return window;
    }
    double reach = half / (1 << window.decimation) + MARGIN;
    window.box.lo[0] = snap_down(x - reach);
    window.box.hi[0] = snap_down(x + reach) + SNAP;
    return window;
}

bool sphere_window_serves(const struct sphere_shape *shape, int level, const struct sphere_window *window,
                          const double place_m[2])
{
    if (clipmap_box_is_empty(&window->box)) return false;
    double angle = reach_of(shape, level), spacing_m[2] = {0, sphere_spacing(shape, level, 1)};
    spacing_m[0] = ldexp(sphere_spacing(shape, level, 0), window->decimation);
    double reach[2] = {half_longitude(angle, place_m[1] / shape->radius_m) * shape->radius_m / spacing_m[0],
                       angle * shape->radius_m / spacing_m[1]};
    for (int axis = 0; axis < 2; axis++) {
        if (axis == 0 ? window->around : level == shape->coarsest) continue; // all there are
        double at = place_m[axis] / spacing_m[axis];                         // reach may be NAN: never held
        if (!(floor(at - reach[axis]) >= (double)window->box.lo[axis] &&
              floor(at + reach[axis]) + 1 <= (double)window->box.hi[axis]))
            return false;
    }
    return true;
}

int sphere_finest_wanted(const struct sphere_shape *shape, const double place_m[2], double innermost_angle)
{
    int least = innermost_angle > 0 ? (int)floor(sphere_level_at(shape, innermost_angle)) : shape->finest;
    least = least < shape->finest ? shape->finest : least > shape->coarsest ? shape->coarsest : least;
    int level = least > shape->sampled ? least : shape->sampled;
    while (level > least && sphere_window_wanted(shape, level, place_m).decimation > 0) level--;
    return level;
}

void sphere_window_origin(const struct sphere_shape *shape, int level, const struct sphere_window *window,
                          const double place_m[2], int64_t texel[2], float fraction[2])
{
    for (int axis = 0; axis < 2; axis++) {
        double spacing_m = ldexp(sphere_spacing(shape, level, axis), axis ? 0 : window->decimation);
        double at = place_m[axis] / spacing_m - shape->offset, whole = floor(at);
        texel[axis] = (int64_t)whole;
        fraction[axis] = (float)(at - whole);
    }
}

void sphere_window_uniforms(const struct sphere_shape *shape, int level, const struct sphere_window *window,
                            const double place_m[2], int32_t slots[4], float grid[4])
{
    int64_t texel[2];
    if (!window->period) return;
    sphere_window_origin(shape, level, window, place_m, texel, grid + 2);
    slots[0] = clipmap_slot(texel[0], window->period);
    slots[1] = clipmap_slot(texel[1], sphere_level_size(shape, level));
    slots[2] = window->period;
    for (int axis = 0; axis < 2; axis++)
        grid[axis] = (float)(shape->radius_m /
                             ldexp(sphere_spacing(shape, level, axis), axis ? 0 : window->decimation));
}

void sphere_bilinear_rows(const struct sphere_shape *shape, int level, const double place_m[2],
                          int32_t rows[2])
{
    level = sampled_level(shape, level);
    int64_t first = level < 0 ? shape->bilinear[-level] : (shape->pole >> level) - 1;
    double viewer = floor(place_m[1] / sphere_spacing(shape, level, 1) - shape->offset);
    rows[0] = (int32_t)fmax((double)(-first - 1) - viewer, INT32_MIN);
    rows[1] = (int32_t)fmin((double)first - viewer, INT32_MAX);
}

// ---- ranges ----------------------------------------------------------------

bool sphere_ranges_init(struct sphere_ranges *ranges, int size)
{
    ranges->across = size / SPHERE_TILE + 2;
    ranges->tiles = malloc((size_t)ranges->across * (size_t)ranges->across * sizeof *ranges->tiles);
    if (!ranges->tiles) return fail("clipmap: no memory for %d x %d ranges", ranges->across, ranges->across);
    sphere_ranges_clear(ranges);
    return true;
}

void sphere_ranges_finish(struct sphere_ranges *ranges)
{
    free(ranges->tiles);
}

void sphere_ranges_clear(struct sphere_ranges *ranges)
{
    for (int k = 0; k < ranges->across * ranges->across; k++)
        ranges->tiles[k] = (struct sphere_tile){INT64_MIN, INT64_MIN, 0, 0};
}

static struct sphere_tile *tile_at(const struct sphere_ranges *ranges, int64_t x, int64_t y)
{
    return &ranges->tiles[clipmap_slot(y, ranges->across) * ranges->across + clipmap_slot(x, ranges->across)];
}

void sphere_ranges_add(struct sphere_ranges *ranges, const struct clipmap_box *box, const float *heights)
{
    for (int64_t y = box->lo[1]; y <= box->hi[1]; y++)
        for (int64_t x = box->lo[0]; x <= box->hi[0]; x++, heights++) {
            int64_t at[2] = {clipmap_floor_div(x, SPHERE_TILE), clipmap_floor_div(y, SPHERE_TILE)};
            struct sphere_tile *tile = tile_at(ranges, at[0], at[1]);
            if (tile->x != at[0] || tile->y != at[1])
                *tile = (struct sphere_tile){at[0], at[1], *heights, *heights};
            tile->low = fminf(tile->low, *heights);
            tile->high = fmaxf(tile->high, *heights);
        }
}

// Texels of a window within an angle of a viewer, and those beyond that their cells have.
static struct clipmap_box cap_box(const struct sphere_shape *shape, int level,
                                  const struct sphere_window *window, const double place_m[2], double angle)
{
    double spacing_m[2] = {ldexp(sphere_spacing(shape, level, 0), window->decimation),
                           sphere_spacing(shape, level, 1)};
    double reach[2] = {half_longitude(angle, place_m[1] / shape->radius_m) * shape->radius_m / spacing_m[0],
                       angle * shape->radius_m / spacing_m[1]};
    struct clipmap_box box = window->box;
    for (int axis = window->around || isnan(reach[0]) ? 1 : 0; axis < 2; axis++) {
        double at = place_m[axis] / spacing_m[axis] - shape->offset;
        struct clipmap_box all = box;
        box.lo[axis] = (int64_t)floor(fmax(at - reach[axis] - 1, (double)all.lo[axis]));
        box.hi[axis] = (int64_t)ceil(fmin(at + reach[axis] + 2, (double)all.hi[axis]));
    }
    return box;
}

void sphere_ranges_within(const struct sphere_ranges *ranges, const struct sphere_shape *shape, int level,
                          const struct sphere_window *window, const double place_m[2], double angle,
                          float *low, float *high)
{
    struct clipmap_box box = cap_box(shape, level, window, place_m, angle);
    for (int axis = 0; axis < 2; axis++) {
        box.lo[axis] = clipmap_floor_div(box.lo[axis], SPHERE_TILE);
        box.hi[axis] = clipmap_floor_div(box.hi[axis], SPHERE_TILE);
    }
    for (int64_t y = box.lo[1]; y <= box.hi[1]; y++)
        for (int64_t x = box.lo[0]; x <= box.hi[0]; x++) {
            const struct sphere_tile *tile = tile_at(ranges, x, y);
            if (tile->x != x || tile->y != y) continue;
            *low = fminf(*low, tile->low);
            *high = fmaxf(*high, tile->high);
        }
}

// ---- reading ---------------------------------------------------------------

// The mean of 2^p columns and half of the one beyond them on either side.
static float mean_of(const int32_t *columns, int count)
{
    double sum = 0.5 * columns[0] + 0.5 * columns[count];
    for (int k = 1; k < count; k++) sum += columns[k];
    return (float)(sum / count);
}

// Stored levels are filtered; synthesised ones, which are linear over columns as far apart as rows, are not.
static bool is_filtered(const struct sphere_shape *shape, int level, int count)
{
    return level >= 0 && count + 1 <= shape->size * shape->size;
}

// Of a synthesised level, whose rounded samples between posts would be stairs under the viewer's feet.  False
// when no column of the box is a first one.
static bool read_detail(const struct detail *detail, int level, int decimation, const struct clipmap_box *box,
                        float *heights)
{
    int width = (int)(box->hi[0] - box->lo[0] + 1), height = (int)(box->hi[1] - box->lo[1] + 1);
    int64_t scale = (int64_t)1 << decimation, first = sphere_level(&detail->grid, level).first;
    if (first % scale != 0) return false;
    detail_heights(detail, level, decimation, box->lo[0] - first / scale, box->lo[1], width, height, heights);
    return true;
}

void sphere_read_texels(const struct sphere_shape *shape, const struct terrain *terrain, int level,
                        int decimation, const struct clipmap_box *box, float *heights, int32_t *columns)
{
    int width = (int)(box->hi[0] - box->lo[0] + 1), height = (int)(box->hi[1] - box->lo[1] + 1);
    int count = 1 << decimation;
    level = sampled_level(shape, level);
    if (level < 0 && read_detail(terrain_detail(terrain), level, decimation, box, heights)) return;
    if (decimation == 0) {
        terrain_window(terrain, level, box->lo[0], box->lo[1], width, height, columns, TERRAIN_WAIT);
        for (int64_t k = 0; k < (int64_t)width * height; k++) heights[k] = (float)columns[k];
        return;
    }
    bool filter = is_filtered(shape, level, count);
    for (int i = 0; i < width; i++) {
        int64_t x = (box->lo[0] + i) << decimation;
        for (int j = 0; j < height && filter; j++) {
            terrain_window(terrain, level, x - count / 2, box->lo[1] + j, count + 1, 1, columns,
                           TERRAIN_WAIT);
            heights[(int64_t)j * width + i] = mean_of(columns, count);
        }
        if (filter) continue;
        terrain_window(terrain, level, x, box->lo[1], 1, height, columns, TERRAIN_WAIT);
        for (int j = 0; j < height; j++) heights[(int64_t)j * width + i] = (float)columns[j];
    }
}

bool sphere_texels_there(const struct sphere_shape *shape, struct terrain_reader *reader, int level,
                         int decimation, const struct clipmap_box *box)
{
    int width = (int)(box->hi[0] - box->lo[0] + 1), height = (int)(box->hi[1] - box->lo[1] + 1);
    int count = 1 << decimation;
    level = sampled_level(shape, level);
    if (decimation == 0)
        return terrain_reader_window(reader, level, box->lo[0], box->lo[1], width, height, NULL);
    // Column by column: all at once might be more than a reader may keep.
    bool filter = is_filtered(shape, level, count), there = true;
    for (int i = 0; i < width; i++) {
        int64_t x = ((box->lo[0] + i) << decimation) - (filter ? count / 2 : 0);
        there = terrain_reader_window(reader, level, x, box->lo[1], filter ? count + 1 : 1, height, NULL) &&
                there;
    }
    return there;
}

// ---- moves -----------------------------------------------------------------

struct asking {
    const struct sphere_source *source;
    int level, decimation;
};

static bool box_there(void *user, const struct clipmap_box *box)
{
    const struct asking *asking = user;
    const struct sphere_source *source = asking->source;
    return source->there(source->user, asking->level, asking->decimation, box);
}

static void read_box(int size, int level, int decimation, const struct clipmap_box *box,
                     const struct sphere_source *source)
{
    struct clipmap_box pieces[4];
    int count = clipmap_unwrap(box, size, pieces);
    for (int k = 0; k < count; k++)
        source->read(source->user, level, decimation, &pieces[k], clipmap_slot(pieces[k].lo[0], size),
                     clipmap_slot(pieces[k].lo[1], size));
}

uint64_t sphere_store_move(struct sphere_store *store, int size, int level,
                           const struct sphere_window *wanted, uint64_t budget, bool wait,
                           const struct sphere_source *source)
{
    struct clipmap_box kept = store->held.box, exposed[4];
    bool same = store->held.decimation == wanted->decimation && store->held.around == wanted->around;
    kept = same ? clipmap_box_common(&kept, &wanted->box) : clipmap_empty;
    if (source->there && !wait) {
        struct asking asking = {source, level, wanted->decimation};
        budget = clipmap_budget_there(&kept, &wanted->box, budget, box_there, &asking);
    }
    store->held = *wanted;
    store->held.box = clipmap_grown(&kept, &wanted->box, budget);
    uint64_t read = 0;
    int count = clipmap_exposed(&kept, &store->held.box, exposed);
    for (int k = 0; k < count; k++) {
        read_box(size, level, wanted->decimation, &exposed[k], source);
        read += clipmap_box_samples(&exposed[k]);
    }
    return read;
}
