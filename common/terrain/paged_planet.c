// A planet out of a .relief file: windows over the seam and the poles, in pieces of the file's own map, which
// goes on a little beyond them (relief_format.h). SPDX-License-Identifier: MIT
#include "common/terrain/paged_parts.h"

#include <string.h>

const struct sphere_grid *paged_planet(const struct paged *p)
{
    return p->header->radius_m > 0 ? &p->planet.grid : NULL;
}

struct piece { // of a window: `rect` of the file, northwards from (x, y) of the window, or southwards from
               // there
    struct rect rect;
    int x, y;
    bool southwards;
};

static int64_t floor_mod(int64_t a, int64_t b)
{
    int64_t rest = a % b;
    return rest < 0 ? rest + b : rest;
}

// The piece that begins at (x, y) of a window, as long as neither seam nor pole is crossed.
static struct piece piece_at(const struct paged *p, int level, int64_t x0, int64_t y0, int width, int height,
                             int x, int y)
{
    struct sphere_grid grid = sphere_level(&p->planet.grid, level);
    int64_t margin = p->planet.margin >> level, i = x0 + x, j = y0 + y;
    int64_t row = floor_mod(j + grid.pole, 4 * grid.pole); // on a way around the planet
    bool southwards = row > 2 * grid.pole;
    sphere_fold(&grid, &i, &j);
    int64_t columns = smaller(width - x, grid.first + grid.columns - i);
    int64_t rows = smaller(height - y, (southwards ? 4 * grid.pole : 2 * grid.pole + 1) - row);
    struct piece piece = {.x = x, .y = y, .southwards = southwards};
    piece.rect.x0 = i - grid.first + margin;
    piece.rect.x1 = piece.rect.x0 + columns;
    piece.rect.y0 = j + grid.pole + margin - (southwards ? rows - 1 : 0);
    piece.rect.y1 = piece.rect.y0 + rows;
    return piece;
}

typedef bool each_piece_fn(void *user, const struct piece *piece);

static bool for_each_piece(const struct paged *p, int level, int64_t x0, int64_t y0, int width, int height,
                           each_piece_fn *each, void *user)
{
    for (int y = 0, rows; y < height; y += rows) {
        rows = height - y;
        for (int x = 0; x < width;) {
            struct piece piece = piece_at(p, level, x0, y0, width, height, x, y);
            if (!each(user, &piece)) return false;
            rows = (int)rect_height(&piece.rect);
            x += (int)rect_width(&piece.rect);
        }
    }
    return true;
}

// ---- windows ---------------------------------------------------------------

struct reading {
    struct paged *paged;
    int level, width;
    int32_t *out;
};

static bool ask_piece(void *user, const struct piece *piece)
{
    const struct reading *reading = user;
    return paged_ask(reading->paged, reading->level, &piece->rect);
}

// A pole is one height, which the tiles are only near to.
static void put_poles(const struct reading *reading, const struct piece *piece, int32_t *south_row,
                      int64_t stride)
{
    const struct paged *p = reading->paged;
    struct sphere_grid grid = sphere_level(&p->planet.grid, reading->level);
    int64_t margin = p->planet.margin >> reading->level;
    for (int end = 0; end < 2; end++) {
        int64_t row = margin + end * 2 * grid.pole;
        if (row < piece->rect.y0 || row >= piece->rect.y1) continue;
        int32_t *to = south_row + (row - piece->rect.y0) * stride;
        int32_t q = paged_limit((int64_t)relief_poles(p->relief, reading->level)[end] * (1 << p->bits));
        for (int64_t i = 0; i < rect_width(&piece->rect); i++) to[i] = q;
    }
}

static bool read_piece(void *user, const struct piece *piece)
{
    const struct reading *reading = user;
    int64_t stride = piece->southwards ? -reading->width : reading->width;
    int64_t south = piece->y + (piece->southwards ? rect_height(&piece->rect) - 1 : 0);
    int32_t *out = reading->out + south * reading->width + piece->x;
    if (!paged_rect(reading->paged, reading->level, &piece->rect, out, stride)) return false;
    put_poles(reading, piece, out, stride);
    return true;
}

bool paged_planet_window(struct paged *p, int level, int64_t x0, int64_t y0, int width, int height,
                         int32_t *out, enum terrain_wait wait)
{
    struct reading reading = {p, level, width, out};
    if (wait == TERRAIN_TRY && !for_each_piece(p, level, x0, y0, width, height, ask_piece, &reading))
        return false;
    if (out && !for_each_piece(p, level, x0, y0, width, height, read_piece, &reading)) {
        atomic_store(&p->failed, true); // told where it was found; what is read since is made up
        memset(out, 0, (size_t)width * (size_t)height * sizeof *out);
    }
    return true;
}

// ---- pieces for others -------------------------------------------------------

struct handing {
    int level;
    paged_piece_fn *each;
    void *user;
};

static bool hand_on(void *user, const struct piece *piece)
{
    const struct handing *handing = user;
    return handing->each(handing->user, handing->level, piece->rect.x0, piece->rect.y0,
                         (int)rect_width(&piece->rect), (int)rect_height(&piece->rect));
}

bool paged_planet_pieces(const struct paged *p, int level, int64_t x0, int64_t y0, int width, int height,
                         paged_piece_fn *each, void *user)
{
    struct handing handing = {level, each, user};
    return for_each_piece(p, level, x0, y0, width, height, hand_on, &handing);
}

struct bounding {
    const struct paged *paged;
    int32_t *min_q, *max_q;
};

static bool widen(void *user, int level, int64_t x0, int64_t y0, int width, int height)
{
    const struct bounding *bounding = user;
    int32_t low, high;
    paged_bounds(bounding->paged, level, x0, y0, x0 + width - 1, y0 + height - 1, &low, &high);
    *bounding->min_q = low < *bounding->min_q ? low : *bounding->min_q;
    *bounding->max_q = high > *bounding->max_q ? high : *bounding->max_q;
    return true;
}

void paged_planet_bounds(const struct paged *p, int level, int64_t x0, int64_t y0, int64_t x1, int64_t y1,
                         int32_t *min_q, int32_t *max_q)
{
    struct sphere_grid grid = sphere_level(&p->planet.grid, level);
    struct bounding bounding = {p, min_q, max_q};
    *min_q = INT32_MAX, *max_q = INT32_MIN;
    // A turn is enough, and so is the way from pole to pole and back.
    paged_planet_pieces(p, level, x0, y0, (int)smaller(x1 - x0 + 1, grid.columns),
                        (int)smaller(y1 - y0 + 1, 4 * grid.pole), widen, &bounding);
}
