// Heights, or colours, of all levels on the GPU: in one texture, each level's tile in a slot of its own, so
// that one draw may read any level.  Livny et al. 2008, sections 4 and 5.  What does not fit is held as
// nested tiles about the viewer (pgm_windows.h). SPDX-License-Identifier: MIT
#ifndef PGM_PGM_ATLAS_H
#define PGM_PGM_ATLAS_H

#include "common/gl/gpu.h"
#include "common/terrain/reader.h"
#include "pgm/pgm_picture.h"
#include "pgm/pgm_sampler.h"
#include "pgm/pgm_windows.h"

#include <stdbool.h>
#include <stddef.h>

// What a texel of heights holds.  Of colours and of shading it is always the words of a cell's four corners,
// but for MIPMAP: then it is the sample's own, and the hardware filters.
enum pgm_fetch {
    PGM_FETCH_PLAIN,  // a height, 16 or 32 bits: one fetch for each corner that a filter reads, up to eight
    PGM_FETCH_PACKED, // the four corners of a cell and of its parent's: one fetch for the whole footprint
                      // (two where heights span more than 16 bits), eight times the memory
    PGM_FETCH_MIPMAP, // naive: the finest level in a mipmapped float texture, filtered by the hardware
    PGM_FETCH_LINEAR, // naive: floats, filtered by the hardware across the rims of tiles
};

struct pgm_storage { // what a user chooses
    enum pgm_fetch fetch;
    bool shaded;                       // more textures, laid out alike, hold shading
    bool many;                         // a texture for each level, chosen by branching, instead of one atlas
    const struct pgm_picture *picture; // colours of this instead of heights; borrowed; NULL: heights
    size_t memory_bytes;               // that tiles may take; 0: no limit
    size_t budget_bytes;               // uploaded a frame, at least
    int most_texels;                   // a side of a texture
};

enum { PGM_TEXTURES_MAX = 16 }; // that a vertex program, and a fragment program, may bind everywhere

struct pgm_slot {
    struct pgm_window window;
    int x, y; // texel of the tile's corner in the texture
};

struct pgm_atlas {
    struct pgm_storage storage;
    GLuint textures[PGM_TEXTURES_MAX]; // one, or one a level
    GLuint shading[PGM_TEXTURES_MAX];  // likewise; 0: none
    int width, height;                 // texels of the one texture
    int finest;                        // level of slot 0; slot k holds level finest + k
    int levels;
    int base_q;  // plain and packed: height in quanta = texel + base_q; floats: 0
    bool narrow; // heights in 16 bits, else 32
    int side;    // largest tile, texels
    struct pgm_slot slots[PGM_LEVELS_MAX];
    struct terrain_reader *reader; // of the frame; NULL: terrain is waited for
    int32_t *heights, *parents;    // room for one piece of an upload
    void *texels;
};

// Sizes the tiles and places them: whole levels if they fit, else the largest tiles that do.  False after one
// line on stderr where not even small ones do.  PURE.
bool pgm_atlas_layout(struct pgm_atlas *atlas, const struct terrain *terrain,
                      const struct pgm_storage *storage);

// Lays out, allocates and fills what is held whole, but for large levels of terrain that is not in memory:
// these arrive as tiles do.  The atlas starts zeroed.  False after one line on stderr.
bool pgm_atlas_init(struct pgm_atlas *atlas, struct gpu *gpu, const struct terrain *terrain,
                    const struct pgm_storage *storage);
void pgm_atlas_finish(struct pgm_atlas *atlas); // accepts a zeroed struct

// Moves the tiles to a viewer and uploads within the budget of a frame what the reader has; NULL: terrain is
// waited for.
void pgm_atlas_follow(struct pgm_atlas *atlas, struct gpu *gpu, const struct terrain *terrain,
                      struct terrain_reader *reader, const struct view *view);

// Where slot k's samples lie: the cell that a viewer is in, in samples, the viewer's place in it, and metres
// from sample to sample, x and y.
struct pgm_place {
    int64_t cell[2];
    float fraction[2];
    double spacing_m[2];
};
struct pgm_place pgm_atlas_place(const struct pgm_atlas *atlas, const struct terrain *terrain,
                                 const struct view *view, int k);

int pgm_atlas_textures(const struct pgm_atlas *atlas);  // how many; as many again for shading
bool pgm_atlas_is_whole(const struct pgm_atlas *atlas); // every level has room for all of it
bool pgm_atlas_is_full(const struct pgm_atlas *atlas);  // and all of it is in memory
size_t pgm_atlas_bytes(const struct pgm_atlas *atlas);
// All samples of all levels, as this storage would hold them whole.  PURE.
size_t pgm_atlas_whole_bytes(const struct terrain *terrain, const struct pgm_storage *storage);

// The texels of a box of samples of slot k as they are uploaded, row by row northwards, into atlas->texels.
// PURE.
void pgm_atlas_texels(const struct pgm_atlas *atlas, const struct terrain *terrain, int k,
                      const struct terrain_extent *box);

// The texels of shading of a box of samples, likewise: words, each the x and y of a unit normal as two signed
// 16-bit shares of 1, by central differences in the level.  PURE.
void pgm_atlas_shading(const struct pgm_atlas *atlas, const struct terrain *terrain, int k,
                       const struct terrain_extent *box);

#endif
