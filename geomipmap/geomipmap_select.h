// What to draw of a view: tiles inside the frustum, their levels and their index sets (Brodersen 2005,
// sections 4 and 5).  No GL.
//
// Culling works on the terrain, its map blocks and its tiles, with the n- and p-vertex test and plane
// masking.  A tile that is not drawn asks nothing of its neighbours, so what is drawn depends on this view
// alone.  Tiles come front to back. SPDX-License-Identifier: MIT
#ifndef GEOMIPMAP_GEOMIPMAP_SELECT_H
#define GEOMIPMAP_GEOMIPMAP_SELECT_H

#include "common/view/frustum.h"
#include "geomipmap/geomipmap_tiles.h"

struct geomipmap_pick {
    int tile;
    int level;
    int set; // geomipmap_mesh_set
};

struct geomipmap_choice { // how to select; the same for all frames
    enum geomipmap_metric metric;
    double tau_px;
    bool cull; // false: tiles outside the frustum are drawn as well, at their coarsest level
};

struct geomipmap_selection {
    struct geomipmap_pick *picks; // room for every tile
    int count;
    uint8_t *level; // by tile: its level, or GEOMIPMAP_NOT_DRAWN
    int tile_count;
};

enum { GEOMIPMAP_NOT_DRAWN = 255 };

bool geomipmap_selection_init(struct geomipmap_selection *selection, const struct geomipmap_tiles *tiles);
void geomipmap_selection_finish(struct geomipmap_selection *selection); // accepts a zeroed selection

// Replaces the selection by that of a view.  Allocates nothing.
void geomipmap_select(struct geomipmap_selection *selection, const struct geomipmap_tiles *tiles,
                      const struct geomipmap_choice *choice, const struct view *view);

#endif
