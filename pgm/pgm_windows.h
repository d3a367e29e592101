// Which samples of each level are in texture memory: nested tiles about the viewer, refilled at their rims as
// the viewer moves, within a budget.  PURE: no GL.  Livny et al. 2008, section 4.
//
// A level that fits its tile is held whole and is loaded once.  Any other has a tile of width x height texels
// about the viewer, moved inwards where the map ends.  Tiles are toroidal: sample i of a level that begins at
// extent.x0 has texel (i - extent.x0) mod width, so a move changes only what it exposes: an L in each tile,
// and an F in tiles that stand side by side.  What is in memory is always a rectangle.  It grows outwards
// from the viewer, coarse levels first; rows of the grid read the finest level that holds all they need.
// Samples that are not there yet are passed over and asked for again until they are.
// SPDX-License-Identifier: MIT
#ifndef PGM_PGM_WINDOWS_H
#define PGM_PGM_WINDOWS_H

#include "common/terrain/terrain.h"

#include <stdbool.h>
#include <stdint.h>

enum { PGM_SLACK = 2 }; // a viewer who swings about a sample reads nothing again

struct pgm_window {
    struct terrain_extent extent; // samples of the level
    int width, height;            // of the tile, at most those of the extent
    struct terrain_extent tile;   // where it lies; follows the viewer with PGM_SLACK samples of slack
    struct terrain_extent held;   // samples in memory, within the tile; empty where x0 >= x1
};

bool pgm_window_is_whole(const struct pgm_window *window);

// True where the samples from x0, y0 to x1, y1 (ends included), as far as the level has them, are in memory.
bool pgm_window_holds(const struct pgm_window *window, const int64_t from[2], const int64_t to[2]);

bool pgm_window_is_full(const struct pgm_window *window); // all of the level is in memory

struct pgm_loader {
    void *user;
    // True where all of a rectangle of samples can be loaded now; else they are asked for.  NULL: always.
    bool (*is_there)(void *user, const struct terrain_extent *samples);
    // Loads a rectangle that does not cross a seam of the tile, whose south-west corner has texel x, y of the
    // tile.
    void (*load)(void *user, const struct terrain_extent *samples, int x, int y);
};

// Moves the tile to a viewer who stands in cell `eye` of the level, drops what it no longer covers and loads
// at most *budget samples of what it newly covers and what is there, nearest first; *budget is lowered by
// what was loaded.
void pgm_window_follow(struct pgm_window *window, const int64_t eye[2], uint64_t *budget,
                       const struct pgm_loader *loader);

// Least of the samples that have one texel each: the tile's window of `held` counts from here, and texels of
// what it holds are below 2 * width, 2 * height from it, to be wrapped once.
void pgm_window_origin(const struct pgm_window *window, int64_t origin[2]);

#endif
