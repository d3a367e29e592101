// Which tiles of the grid are seen, and which of them need no look at the map's outline or at back faces.
// PURE: no GL.
//
// A tile lies between two rows and two columns.  Rows are lines across the view, as wide as a convex function
// of their distance, so it stands on the hull of its four corners; its heights are somewhere between the
// lowest and the highest terrain. SPDX-License-Identifier: MIT
#ifndef PGM_PGM_TILES_H
#define PGM_PGM_TILES_H

#include "pgm/pgm_mesh.h"
#include "pgm/pgm_rows.h"

// How a tile may be drawn, by bits: by the program that does not look at the map's outline
// (view_inside_outline); without back faces, as no triangle of it is clipped by the frustum.
enum { PGM_WITHIN_MAP = 1, PGM_WITHIN_VIEW = 2, PGM_WAYS = 4, PGM_UNSEEN = PGM_WAYS };

struct pgm_tiles {               // starts zeroed
    int most_rows, most_columns; // quads of the grid as it was made
    int lines, across;           // of corners, from near to far and from left to right
    double *across_x;            // X of the corners' columns
    struct pgm_corner {
        double place[2];         // relative to the eye
        uint8_t outside, inside; // frustum planes that all of its heights are outside, or well inside of
    } * corners;
};

// focus, width: of pgm_mesh_vertices.  False when out of memory.
bool pgm_tiles_init(struct pgm_tiles *tiles, int rows, int columns, double focus, double width);
void pgm_tiles_finish(struct pgm_tiles *tiles); // accepts a zeroed struct

// Looks at the grid as it lies: `used` of its rows and columns, `rows` from far to near.
void pgm_tiles_look(struct pgm_tiles *tiles, const struct view *view, const struct pgm_world *world,
                    const struct pgm_sampler *sampler, const struct pgm_settings *used,
                    const struct pgm_row *rows);

// Of a tile in use: bits, or PGM_UNSEEN where all of it is outside the view.
int pgm_tiles_way(const struct pgm_tiles *tiles, const struct view *view, const struct terrain *terrain,
                  const struct pgm_tile *tile);

#endif
