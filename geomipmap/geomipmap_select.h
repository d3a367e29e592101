// What to draw of a view: tiles inside the frustum, their levels and their index sets (Brodersen 2005,
// sections 4 and 5).  No GL.
//
// A tree is made anew for each view, from the one tile that covers the map down: what the frustum does not
// meet is left whole (n- and p-vertex test with plane masking).  A tile is drawn where one of its two
// coarsest levels will do; else the four smaller tiles in its place are looked at.  The smallest are drawn at
// whatever level they need.  Tiles come front to back.
//
// Two tiles draw the same vertices along the border that they share: those of the finer side; where a
// merged tile meets several smaller ones, those of the finest of all along that side.  A merged tile has
// every 2^height-th sample; beside a tile that draws more it is split.  Tiles outside the frustum take part
// in this, so that what is seen does not depend on culling: the largest that may be drawn stand outside the
// frustum, and where those are small, whole blocks of them that touch nothing that is seen or finer.  Only
// GEOMIPMAP_REMOVE, which knows tiles of one size alone (merge 0), draws the vertices of the coarser side
// instead.
//
// Of terrain that is read on demand, a tile is drawn at the finest level that is there, and is not divided
// before its parts are there at their coarsest: until then it counts as late.  Borders and corners, a few
// samples a tile, and the coarsest level of the largest tiles are waited for.
//
// With morphing, the vertices that the next coarser level lacks move towards it as it comes near, and are
// there when the level changes.  A tile's inside moves with its own error, each side with the least of the
// tiles that meet there at the finest level.
//
// With hysteresis, a tile grows coarser than it was when last seen only where the error stays within (1 -
// hysteresis) tau; it grows finer at tau, so that the claim holds.
// SPDX-License-Identifier: MIT
#ifndef GEOMIPMAP_GEOMIPMAP_SELECT_H
#define GEOMIPMAP_GEOMIPMAP_SELECT_H

#include "common/view/frustum.h"
#include "geomipmap/geomipmap_tiles.h"

enum geomipmap_way {           // how a tile may be drawn
    GEOMIPMAP_WITHIN_MAP = 1,  // view_inside_outline holds
    GEOMIPMAP_WITHIN_VIEW = 2, // its box lies inside the frustum: no triangle is clipped
    GEOMIPMAP_WAYS = 4,
};

struct geomipmap_pick { // there may be one for every tile of the map: small
    struct geomipmap_place place;
    float depth_m; // of what is seen of its box, the least, or less
    uint16_t set;  // geomipmap_mesh_set
    uint8_t level;
    bool seen;             // the frustum meets it
    uint8_t way;           // of enum geomipmap_way
    uint8_t morph;         // way from its level to the next coarser, in steps of 1 / GEOMIPMAP_MORPHED
    struct geomipmap_hem { // a side as drawn
        uint8_t level;     // whose vertices it has, counted as the tile's own
        uint8_t morph;     // of that level
    } hem[GEOMIPMAP_SIDES];
    uint8_t larger[GEOMIPMAP_SIDES]; // height of the larger tile beyond a side, or 0
    uint8_t corner[GEOMIPMAP_SIDES]; // of filtered tiles: geomipmap_form
};

// Of a pick of filtered tiles.
struct geomipmap_form geomipmap_pick_form(const struct geomipmap_pick *pick);

struct geomipmap_choice { // how to select; the same for all frames
    enum geomipmap_metric metric;
    double tau_px;
    bool cull; // leave out unseen tiles that concern no other; false: list them all
    enum geomipmap_borders borders;
    double hysteresis; // 0: off; below 1
    bool morph;
    struct terrain_reader *reader; // NULL: all is in memory
};

enum { GEOMIPMAP_NOTHING = 255, GEOMIPMAP_MORPHED = 255 };

struct geomipmap_node { // of the tree of one view
    struct geomipmap_place place;
    int first; // of its four parts, south-west, south-east, north-west, north-east; 0: it has none
    float depth_m;
    // of a leaf; kind: of enum in geomipmap_select.c
    unsigned kind : 2, level : 4, way : 2, seen : 1, morph : 8;
};

struct geomipmap_corner {           // where tiles meet
    uint64_t column : 28, row : 28; // in tiles of height 0
    uint64_t step : 8;              // of the vertex there; GEOMIPMAP_NOTHING: no corner
};

struct geomipmap_memory { // of frames before: what was drawn of a tile
    int step, inner;      // as a tile itself; the finest in tiles within it
    uint64_t when, inner_when;
};

struct geomipmap_selection {
    struct geomipmap_pick *picks; // those seen first
    int count, seen;              // of all; of those seen
    int late;                     // tiles that are coarser than they should be
    int room;
    struct geomipmap_node *nodes;
    int node_count, node_room;
    struct geomipmap_corner *corners; // of filtered tiles: a hash, 1 << corner_bits
    int corner_bits, corner_count;
    struct geomipmap_cache remembered; // tiles, with hysteresis
    struct geomipmap_memory *memory;   // by slot of the cache
    int memory_room;
    uint64_t now, since; // number of this selection; of the first that this one continues
};

bool geomipmap_selection_init(struct geomipmap_selection *selection);
void geomipmap_selection_finish(struct geomipmap_selection *selection); // accepts a zeroed selection

size_t geomipmap_selection_bytes(const struct geomipmap_selection *selection);

// Forgets the frames so far: what comes next does not continue them.
void geomipmap_selection_restart(struct geomipmap_selection *selection);

// Replaces the selection by that of a view, and measures tiles that are looked at for the first time.
// Allocates only then, and when there are more picks than ever before.  False after one line on stderr.
bool geomipmap_select(struct geomipmap_selection *selection, struct geomipmap_tiles *tiles,
                      const struct geomipmap_choice *choice, const struct view *view);

#endif
