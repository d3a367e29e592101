// The heights about a viewer over a sphere, level by level (Clasen & Hege 2006, sections 4.1 and 4.3).  PURE.
//
// Level l keeps a window of the terrain's level l about the viewer's nadir in size x size toroidal texels, as
// far as the rings reach that draw it.  Towards the poles columns crowd, and a ring spans more of them: a
// texel then stands for 2^p columns, filtered over as many, so that its kernel is about as wide as it is high
// on the ground.  p and the window change in steps, so that a small move reads little.  Where rings reach
// over a pole the window holds the whole turn.  Where the terrain's finest level takes columns together,
// levels beyond it, whose rows are its rows, take fewer, down to single columns near the viewer.
// SPDX-License-Identifier: MIT
#ifndef CLIPMAP_SPHERE_LEVELS_H
#define CLIPMAP_SPHERE_LEVELS_H

#include "clipmap/clipmap_levels.h"
#include "common/terrain/detail.h"
#include "common/terrain/reader.h"

enum { SPHERE_MAX_LEVELS = 32, SPHERE_LONGITUDE_LEVELS = 6 };

struct sphere_shape {
    int azimuths;
    double texture;       // texels across what a level serves, as a share of the azimuths
    int sampled;          // the terrain's finest level
    int finest, coarsest; // levels; those finer than `sampled` are so in longitude only
    int size;             // texels on a side of a level's texture
    int whole;            // of the coarsest's, which holds the planet
    double radius_m;
    double spacing_m[2];    // of level 0
    double offset;          // sample i stands at (i + offset) spacings: 0, or 1/2 for the middles of cells
    int64_t columns, first; // of level 0
    int64_t pole;
    // First row north of the equator whose cells are bilinear, of level -k; the same south of it.
    int64_t bilinear[DETAIL_MAX_FINER + 1];
};

// texture: 1/8 to 1/4 as published (section 4.2); 1/2 samples the terrain about as densely as rings do.
void sphere_shape_init(struct sphere_shape *shape, const struct terrain *terrain, int azimuths,
                       double texture);

void sphere_shape_size(struct sphere_shape *shape); // sets `size` and `whole` by the rest
int sphere_level_size(const struct sphere_shape *shape, int level);
// The level, a real number, that a ring samples: level l from where its window has half of its width to where
// it has all of it, level l + 1.
double sphere_level_at(const struct sphere_shape *shape, double angle);

// Distance of a level's texels in metres of arc, along x and y, when no columns are taken together.
double sphere_spacing(const struct sphere_shape *shape, int level, int axis);

struct sphere_window {
    int decimation;         // p
    bool around;            // holds the whole turn: columns 0 .. period - 1, taken modulo the period
    int period;             // of its texels along x: size, or the texels of a turn
    struct clipmap_box box; // texels: x in 2^p columns, y in rows of the level; any int64
};
// What level l wants to hold for a viewer at a place (longitude, latitude in metres of arc).
struct sphere_window sphere_window_wanted(const struct sphere_shape *shape, int level,
                                          const double place_m[2]);

// Whether a window holds all that rings sample of level l; it wants to hold a few texels more.
bool sphere_window_serves(const struct sphere_shape *shape, int level, const struct sphere_window *window,
                          const double place_m[2]);

// The finest level that a viewer needs whose innermost ring stands at an angle (section 4.5).  Levels finer
// than the terrain's are needed where those before take columns together.
int sphere_finest_wanted(const struct sphere_shape *shape, const double place_m[2], double innermost_angle);

// The viewer's texel and fraction in a window's grid.
void sphere_window_origin(const struct sphere_shape *shape, int level, const struct sphere_window *window,
                          const double place_m[2], int64_t texel[2], float fraction[2]);

// The same for shaders: slots of the viewer's texel, period, 0; texels per radian, fractions.  Nothing is set
// for a window that was never held.
void sphere_window_uniforms(const struct sphere_shape *shape, int level, const struct sphere_window *window,
                            const double place_m[2], int32_t slots[4], float grid[4]);

// The rows of cells, counted from the viewer's, up to the first and from the second of which cells are
// bilinear: those at the poles, and those several columns wide (terrain.h).  One farther away than an int can
// tell comes nearer, where no window reaches.
void sphere_bilinear_rows(const struct sphere_shape *shape, int level, const double place_m[2],
                          int32_t rows[2]);

struct sphere_store { // one level in memory
    struct sphere_window held;
};

// Where a level's texels come from.
struct sphere_source {
    // Reads a box that does not wrap to its slots.
    void (*read)(void *user, int level, int decimation, const struct clipmap_box *box, int slot_x,
                 int slot_y);
    // Whether a box is there; asks for it if not.  NULL: everything is.
    bool (*there)(void *user, int level, int decimation, const struct clipmap_box *box);
    void *user;
};

// Reads what of `wanted` is missing, no more than `budget` texels and, unless it waits, than is there, and
// forgets what it does not hold.  Returns how many were read.
uint64_t sphere_store_move(struct sphere_store *store, int size, int level,
                           const struct sphere_window *wanted, uint64_t budget, bool wait,
                           const struct sphere_source *source);

// The heights of a box's texels, row by row northwards: samples, or means over the columns they stand for.
// columns: room for size * size + 1.
void sphere_read_texels(const struct sphere_shape *shape, const struct terrain *terrain, int level,
                        int decimation, const struct clipmap_box *box, float *heights, int32_t *columns);
// What heights a level's texels have: by squares of SPHERE_TILE x SPHERE_TILE texels, at their toroidal
// slots.
enum { SPHERE_TILE = 16 };
struct sphere_ranges {
    struct sphere_tile {
        int64_t x, y; // which square
        float low, high;
    } * tiles;
    int across; // slots on a side
};
bool sphere_ranges_init(struct sphere_ranges *ranges, int size); // false after one line on stderr
void sphere_ranges_finish(struct sphere_ranges *ranges);
void sphere_ranges_clear(struct sphere_ranges *ranges); // columns are taken together in another way
void sphere_ranges_add(struct sphere_ranges *ranges, const struct clipmap_box *box, const float *heights);
// Widens low .. high to hold every height that a window's texels give within an angle of a viewer.
void sphere_ranges_within(const struct sphere_ranges *ranges, const struct sphere_shape *shape, int level,
                          const struct sphere_window *window, const double place_m[2], double angle,
                          float *low, float *high);

// Whether a reader has all that they are made of; it is asked for what is not there.
bool sphere_texels_there(const struct sphere_shape *shape, struct terrain_reader *reader, int level,
                         int decimation, const struct clipmap_box *box);

#endif
