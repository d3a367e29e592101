// SPDX-License-Identifier: MIT
#include "pgm/pgm_tiles.h"

#include "common/view/frustum.h"

#include <math.h>
#include <stdlib.h>

static const double guard_share = 1e-6; // of a point's distance: float32 rounds vertices by less

static int corner_lines(int quads) // between tiles, both ends included
{
    return (quads + PGM_TILE - 1) / PGM_TILE + 1;
}

// Tiles are counted from the nearest row.
static int row_of_line(const struct pgm_tiles *tiles, int line)
{
    int row = tiles->most_rows - line * PGM_TILE;
    return row > 0 ? row : 0;
}

bool pgm_tiles_init(struct pgm_tiles *tiles, int rows, int columns, double focus, double width)
{
    *tiles = (struct pgm_tiles){.most_rows = rows,
                                .most_columns = columns,
                                .lines = corner_lines(rows),
                                .across = corner_lines(columns)};
    tiles->across_x = malloc((size_t)tiles->across * sizeof *tiles->across_x);
    tiles->corners = malloc((size_t)tiles->lines * (size_t)tiles->across * sizeof *tiles->corners);
    if (!tiles->across_x || !tiles->corners) return false;
    for (int i = 0; i < tiles->across; i++) {
        int column = i * PGM_TILE < columns ? i * PGM_TILE : columns;
        tiles->across_x[i] = pgm_mesh_across(columns, focus, width, column);
    }
    return true;
}

void pgm_tiles_finish(struct pgm_tiles *tiles)
{
    free(tiles->across_x);
    free(tiles->corners);
    *tiles = (struct pgm_tiles){0};
}

static void look_at_corner(struct pgm_corner *corner, const struct frustum *frustum, const double heights[2])
{
    double far = fmax(fabs(heights[0]), fabs(heights[1]));
    double guard = guard_share * (fabs(corner->place[0]) + fabs(corner->place[1]) + far);
    corner->outside = corner->inside = 0;
    for (int plane = 0; plane < FRUSTUM_PLANES; plane++) {
        const double *normal = frustum->normal[plane];
        double level = normal[0] * corner->place[0] + normal[1] * corner->place[1] + frustum->offset[plane];
        double low = level + normal[2] * heights[0], high = level + normal[2] * heights[1];
        if (fmax(low, high) < -guard) corner->outside |= (uint8_t)(1u << plane);
        if (fmin(low, high) >= guard) corner->inside |= (uint8_t)(1u << plane);
    }
}

void pgm_tiles_look(struct pgm_tiles *tiles, const struct view *view, const struct pgm_world *world,
                    const struct pgm_sampler *sampler, const struct pgm_settings *used,
                    const struct pgm_row *rows)
{
    struct frustum frustum;
    frustum_init(&frustum, view);
    const double heights[2] = {world->lowest_m - view->eye_m[2], world->highest_m - view->eye_m[2]};
    double stretch = (double)tiles->most_columns / used->columns; // the columns in use span the view
    for (int line = (tiles->most_rows - used->rows) / PGM_TILE; line < tiles->lines; line++) {
        const struct pgm_row *row = &rows[row_of_line(tiles, line)];
        for (int i = 0; i < corner_lines(used->columns); i++) {
            struct pgm_corner *corner = &tiles->corners[line * tiles->across + i];
            double aside = row->half_width_m * (stretch * tiles->across_x[i] + stretch - 1);
            for (int axis = 0; axis < 2; axis++)
                corner->place[axis] = sampler->forward[axis] * row->forward_m + sampler->right[axis] * aside;
            look_at_corner(corner, &frustum, heights);
        }
    }
}

int pgm_tiles_way(const struct pgm_tiles *tiles, const struct view *view, const struct terrain *terrain,
                  const struct pgm_tile *tile)
{
    int line = (tiles->most_rows - tile->row - tile->rows) / PGM_TILE;
    const struct pgm_corner *near = &tiles->corners[line * tiles->across + tile->column / PGM_TILE];
    const struct pgm_corner *corners[4] = {near, near + 1, near + tiles->across, near + tiles->across + 1};
    unsigned outside = FRUSTUM_ALL, inside = FRUSTUM_ALL;
    double low[2] = {INFINITY, INFINITY}, high[2] = {-INFINITY, -INFINITY};
    for (int i = 0; i < 4; i++) {
        outside &= corners[i]->outside;
        inside &= corners[i]->inside;
        for (int axis = 0; axis < 2; axis++) {
            low[axis] = fmin(low[axis], corners[i]->place[axis]);
            high[axis] = fmax(high[axis], corners[i]->place[axis]);
        }
    }
    if (outside) return PGM_UNSEEN;
    return (view_inside_outline(view, terrain, low, high) ? PGM_WITHIN_MAP : 0) |
           (inside == FRUSTUM_ALL ? PGM_WITHIN_VIEW : 0);
}
