// SPDX-License-Identifier: MIT
#include "pgm/pgm_windows.h"

#include "common/integer.h"

// Lines that a side grows by at once, at least, where so many are missing; samples beyond which no more.
enum { LINES_AT_LEAST = 8, SAMPLES_AT_ONCE = 1 << 16 };

static int64_t between(int64_t value, int64_t low, int64_t high)
{
    return larger(low, smaller(value, high));
}

static bool is_empty(const struct terrain_extent *box)
{
    return box->x0 >= box->x1 || box->y0 >= box->y1;
}

bool pgm_window_is_whole(const struct pgm_window *window)
{
    const struct terrain_extent *extent = &window->extent;
    return window->width == extent->x1 - extent->x0 && window->height == extent->y1 - extent->y0;
}

bool pgm_window_is_full(const struct pgm_window *window)
{
    const struct terrain_extent *e = &window->extent, *held = &window->held;
    return held->x0 == e->x0 && held->y0 == e->y0 && held->x1 == e->x1 && held->y1 == e->y1;
}

bool pgm_window_holds(const struct pgm_window *window, const int64_t from[2], const int64_t to[2])
{
    const struct terrain_extent *e = &window->extent, *held = &window->held;
    if (is_empty(held)) return false;
    return between(from[0], e->x0, e->x1 - 1) >= held->x0 && between(to[0], e->x0, e->x1 - 1) < held->x1 &&
           between(from[1], e->y0, e->y1 - 1) >= held->y0 && between(to[1], e->y0, e->y1 - 1) < held->y1;
}

static int64_t follow_axis(int64_t placed, bool anew, int64_t eye, int size, int64_t first, int64_t end)
{
    int64_t centred = eye - size / 2;
    int64_t moved = anew ? centred : between(placed, centred - PGM_SLACK, centred + PGM_SLACK);
    return between(moved, first, end - size);
}

static void move_tile(struct pgm_window *window, const int64_t eye[2])
{
    const struct terrain_extent *e = &window->extent;
    struct terrain_extent *tile = &window->tile;
    bool anew = is_empty(tile);
    tile->x0 = follow_axis(tile->x0, anew, eye[0], window->width, e->x0, e->x1);
    tile->y0 = follow_axis(tile->y0, anew, eye[1], window->height, e->y0, e->y1);
    tile->x1 = tile->x0 + window->width;
    tile->y1 = tile->y0 + window->height;
}

// Loads a box, cut where the tile's texels wrap; false: not there yet.
static bool load_box(const struct pgm_window *window, const struct terrain_extent *box,
                     const struct pgm_loader *loader)
{
    if (loader->is_there && !loader->is_there(loader->user, box)) return false;
    for (int64_t y = box->y0; y < box->y1;) {
        int row = (int)((y - window->extent.y0) % window->height);
        int64_t y_end = smaller(box->y1, y + window->height - row);
        for (int64_t x = box->x0; x < box->x1;) {
            int column = (int)((x - window->extent.x0) % window->width);
            int64_t x_end = smaller(box->x1, x + window->width - column);
            loader->load(loader->user, &(struct terrain_extent){x, y, x_end, y_end}, column, row);
            x = x_end;
        }
        y = y_end;
    }
    return true;
}

enum side { WEST, SOUTH, EAST, NORTH, SIDES };

// Lines of samples that are missing at a side, and how many samples one has.
static int64_t missing_lines(const struct terrain_extent *held, const struct terrain_extent *tile, int side,
                             int64_t *line)
{
    *line = side == WEST || side == EAST ? held->y1 - held->y0 : held->x1 - held->x0;
    return side == WEST    ? held->x0 - tile->x0
           : side == SOUTH ? held->y0 - tile->y0
           : side == EAST  ? tile->x1 - held->x1
                           : tile->y1 - held->y1;
}

static int64_t distance_to(const struct terrain_extent *held, const int64_t eye[2], int side)
{
    return side == WEST    ? eye[0] - held->x0
           : side == SOUTH ? eye[1] - held->y0
           : side == EAST  ? held->x1 - eye[0]
                           : held->y1 - eye[1];
}

// The side that is nearest to the viewer of those that can grow; SIDES: none can.  late: bits of sides whose
// samples are not there yet.
static int side_to_grow(const struct terrain_extent *held, const struct terrain_extent *tile,
                        const int64_t eye[2], uint64_t budget, unsigned late)
{
    int chosen = SIDES;
    for (int side = 0; side < SIDES; side++) {
        int64_t line;
        if (late & 1u << side) continue;
        if (missing_lines(held, tile, side, &line) <= 0 || (uint64_t)line > budget) continue;
        if (chosen == SIDES || distance_to(held, eye, side) < distance_to(held, eye, chosen)) chosen = side;
    }
    return chosen;
}

static struct terrain_extent beside(const struct terrain_extent *held, int side, int64_t lines)
{
    struct terrain_extent strip = *held;
    if (side == WEST) strip.x1 = held->x0, strip.x0 = held->x0 - lines;
    if (side == SOUTH) strip.y1 = held->y0, strip.y0 = held->y0 - lines;
    if (side == EAST) strip.x0 = held->x1, strip.x1 = held->x1 + lines;
    if (side == NORTH) strip.y0 = held->y1, strip.y1 = held->y1 + lines;
    return strip;
}

static bool grow(struct pgm_window *window, const struct terrain_extent *tile, int side, uint64_t *budget,
                 const struct pgm_loader *loader)
{
    struct terrain_extent *held = &window->held;
    int64_t line, missing = missing_lines(held, tile, side, &line);
    int64_t across = side == WEST || side == EAST ? held->x1 - held->x0 : held->y1 - held->y0;
    int64_t affordable =
        *budget / (uint64_t)line < (uint64_t)missing ? (int64_t)(*budget / (uint64_t)line) : missing;
    int64_t at_once = larger(smaller(across / 2, SAMPLES_AT_ONCE / line), LINES_AT_LEAST);
    int64_t lines = smaller(affordable, at_once);
    struct terrain_extent strip = beside(held, side, lines);
    if (!load_box(window, &strip, loader)) return false;
    *budget -= (uint64_t)(lines * line);
    held->x0 = smaller(held->x0, strip.x0);
    held->y0 = smaller(held->y0, strip.y0);
    held->x1 = larger(held->x1, strip.x1);
    held->y1 = larger(held->y1, strip.y1);
    return true;
}

// The first sample of an empty tile: the one nearest to the viewer.
static bool begin(struct pgm_window *window, const struct terrain_extent *tile, const int64_t eye[2],
                  uint64_t *budget, const struct pgm_loader *loader)
{
    if (*budget == 0) return false;
    int64_t x = between(eye[0], tile->x0, tile->x1 - 1), y = between(eye[1], tile->y0, tile->y1 - 1);
    struct terrain_extent first = {x, y, x + 1, y + 1};
    if (!load_box(window, &first, loader)) return false;
    --*budget;
    window->held = first;
    return true;
}

void pgm_window_follow(struct pgm_window *window, const int64_t eye[2], uint64_t *budget,
                       const struct pgm_loader *loader)
{
    struct terrain_extent *held = &window->held;
    move_tile(window, eye);
    held->x0 = larger(held->x0, window->tile.x0);
    held->y0 = larger(held->y0, window->tile.y0);
    held->x1 = smaller(held->x1, window->tile.x1);
    held->y1 = smaller(held->y1, window->tile.y1);
    if (is_empty(held)) {
        *held = (struct terrain_extent){0, 0, 0, 0};
        if (!begin(window, &window->tile, eye, budget, loader)) return;
    }
    unsigned late = 0;
    for (int side; (side = side_to_grow(held, &window->tile, eye, *budget, late)) != SIDES;)
        if (!grow(window, &window->tile, side, budget, loader)) late |= 1u << side;
}

void pgm_window_origin(const struct pgm_window *window, int64_t origin[2])
{
    const struct terrain_extent *e = &window->extent;
    bool empty = is_empty(&window->held);
    int64_t x = empty ? 0 : window->held.x0 - e->x0, y = empty ? 0 : window->held.y0 - e->y0;
    origin[0] = e->x0 + x - x % window->width;
    origin[1] = e->y0 + y - y % window->height;
}
