// SPDX-License-Identifier: MIT
#include "common/terrain/relief/planet_source.h"

#include "common/report.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

// Rows of a window that follow each other on the map, northwards or, beyond a pole, southwards.
struct rows {
    int64_t i, j; // on the planet, of the first one
    int64_t count;
    bool turned;
};

static struct rows rows_at(const struct planet_source *s, int64_t x, int64_t y, int64_t most)
{
    const struct sphere_grid *grid = &s->planet.grid;
    struct rows rows = {x + grid->first - s->planet.margin, y - grid->pole - s->planet.margin, 1, false};
    int64_t pole = grid->pole, j = rows.j, until = j < -pole ? -pole : j < pole ? pole : j + most;
    rows.turned = j < -pole || j > pole;
    sphere_fold(grid, &rows.i, &rows.j);
    if (rows.j == pole || rows.j == -pole) return rows; // a pole is a row of its own
    rows.count = until - j < most ? until - j : most;
    return rows;
}

// `count` columns of them from column i, no seam between.
static bool read_block(const struct planet_source *s, const struct rows *rows, int64_t i, int64_t count,
                       const struct patch *to, int64_t x, int64_t y)
{
    const struct sphere_grid *grid = &s->planet.grid;
    int64_t west = i - grid->first, south = rows->j + grid->pole - (rows->turned ? rows->count - 1 : 0);
    struct patch block = {{west, south, west + count, south + rows->count}, patch_at(to, x, y)};
    if (!rows->turned && count == rect_width(&to->rect)) return s->from->window(s->from, &block);
    block.samples = malloc((size_t)(count * rows->count) * sizeof *block.samples);
    if (!block.samples) return fail("%s: out of memory", s->map.name);
    bool good = s->from->window(s->from, &block);
    for (int64_t k = 0; good && k < rows->count; k++)
        memcpy(patch_at(to, x, y + k),
               patch_at(&block, west, south + (rows->turned ? rows->count - 1 - k : k)),
               (size_t)count * sizeof(int32_t));
    free(block.samples);
    return good;
}

static bool read_rows(const struct planet_source *s, const struct rows *rows, const struct patch *to,
                      int64_t y)
{
    const struct sphere_grid *grid = &s->planet.grid;
    bool good = true;
    for (int64_t x = to->rect.x0, i = rows->i; good && x < to->rect.x1; i = grid->first) {
        int64_t left = grid->first + grid->columns - i, wanted = to->rect.x1 - x;
        int64_t count = left < wanted ? left : wanted;
        good = read_block(s, rows, i, count, to, x, y);
        x += count;
    }
    return good;
}

static bool planet_window(const struct relief_source *source, const struct patch *to)
{
    const struct planet_source *s = source->data;
    const struct rect *r = &to->rect;
    bool good = true;
    for (int64_t y = r->y0; good && y < r->y1;) {
        struct rows rows = rows_at(s, r->x0, y, r->y1 - y);
        if (llabs(rows.j) == s->planet.grid.pole)
            for (int64_t x = r->x0; x < r->x1; x++) *patch_at(to, x, y) = s->pole_q[rows.j > 0];
        else
            good = read_rows(s, &rows, to, y);
        y += rows.count;
    }
    return good;
}

static bool read_poles(struct planet_source *s)
{
    const struct relief_source *from = s->from;
    int64_t columns = from->size[0];
    int32_t *row = malloc((size_t)columns * sizeof *row);
    bool good = row != NULL;
    if (!good) fail("%s: out of memory", from->name);
    for (int end = 0; good && end < 2; end++) {
        int64_t y = end ? from->size[1] - 1 : 0;
        const struct patch pole = {{0, y, columns, y + 1}, row};
        good = from->window(from, &pole);
        const struct sphere_grid alone = {0, columns, 0};
        if (good) sphere_level_poles(&alone, row);
        if (good) s->pole_q[end] = row[0];
    }
    free(row);
    return good;
}

bool planet_source_init(struct planet_source *s, const struct relief_source *from, int reach)
{
    memset(s, 0, sizeof *s);
    if (!relief_is_planet(from->name, from->size[0], from->size[1])) return false;
    s->from = from;
    s->planet = relief_planet_plan(from->size[0], from->size[1], reach);
    s->map = *from;
    for (int axis = 0; axis < 2; axis++) s->map.size[axis] += 2 * s->planet.margin;
    s->map.spacing_m[0] = 2 * M_PI * from->radius_m / (double)from->size[0];
    s->map.spacing_m[1] = M_PI * from->radius_m / (double)(from->size[1] - 1);
    s->map.window = planet_window;
    s->map.finish = NULL;
    s->map.data = s;
    return read_poles(s);
}
