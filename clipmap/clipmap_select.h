// The blocks and stitches that a view draws, after view-frustum culling (Losasso & Hoppe 2004, section 6.4).
// PURE. As published, each of a level's four rectangles is cropped to the rectangle round what the frustum
// holds of its box; by default each block is tested with the bounds of its own heights.
// SPDX-License-Identifier: MIT
#ifndef CLIPMAP_CLIPMAP_SELECT_H
#define CLIPMAP_CLIPMAP_SELECT_H

#include "clipmap/clipmap_mesh.h"
#include "clipmap/clipmap_store.h"
#include "common/view/frustum.h"

// How a piece may be drawn: without looking at the map's outline (view_inside_outline), and without back
// faces (enum renderer_faces: it lies wholly inside the frustum).
enum { CLIPMAP_WITHIN_MAP = 1, CLIPMAP_WITHIN_VIEW = 2, CLIPMAP_WAYS = 4 };

struct clipmap_choice {
    bool cull;
    enum clipmap_layout layout;
    enum clipmap_stitch stitch;
};

struct clipmap_selection {
    int32_t (*corners)[2]; // of each piece, in cells from floor(eye / g) of its level; those of one draw side
                           // by side
    int corner_count;
    struct clipmap_draw { // one list, drawn `count` times at corners[first ..]
        int level, first, count;
        int way;
        bool strip; // else a list of triangles
        struct clipmap_list list;
    } * draws;                    // blocks of all levels, fine to coarse, then stitches likewise
    int draw_count, stitch_draws; // the last `stitch_draws` draws are stitches
    int levels, blocks, culled;   // levels drawn, blocks or columns drawn, and those that culling saved
    uint64_t triangles;

    int capacity;
    struct clipmap_chosen { // of the level in work
        struct clipmap_piece piece;
        int way;
    } * pieces;
    int piece_count;
};

// Whether the eye is above the surface that is drawn where it stands: of the finest level there, morphed,
// which may be above the ground and the eye.  Off the map: nothing is drawn there, true.
bool clipmap_eye_above(const struct clipmap_shape *shape, const struct clipmap_region *regions,
                       const struct clipmap_store *stores, const struct clipmap_scratch *scratch,
                       const struct view_origin *eyes, const struct view *view);

bool clipmap_selection_init(struct clipmap_selection *selection, const struct clipmap_shape *shape);
void clipmap_selection_finish(struct clipmap_selection *selection);

// regions, stores and eyes: one a level.
void clipmap_select(struct clipmap_selection *selection, const struct clipmap_shape *shape,
                    const struct clipmap_choice *choice, const struct clipmap_mesh *mesh,
                    const struct clipmap_region *regions, const struct clipmap_store *stores,
                    const struct view_origin *eyes, const struct view *view);

#endif
