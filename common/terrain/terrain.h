// The one terrain that every renderer, the ray caster and the error measures read.
//
// A terrain is a pyramid of height grids.  Level 0 is the finest *stored* level; levels -1, -2, ... are
// synthesised detail, levels 1, 2, ... are filtered.  Sample (i, j) of level l lies at
//     x = i * spacing_x * 2^l,   y = j * spacing_y * 2^l        (i east, j north)
// so sample (i, j) of level l+1 stands on sample (2i, 2j) of level l, at every level and for any integers.
// On a sphere, x is longitude and y latitude, both in metres of arc on the datum (angle * radius); a map goes
// all around, from pole to pole, and its levels do (sphere.h).
// Heights are integers, "quanta":  height_m = quantum_m * q + offset_m,  |q| < 2^22, so that float32 holds
// every height, and every mean of four, exactly.
//
// The surface of a level is piecewise linear: each cell is split along its diagonal (i, j)-(i+1, j+1).  The
// truth that errors are measured against is the surface of the finest level.  On a sphere the two corners of
// a cell that lie on a pole are one point.  Split in longitude and latitude, such a cell would be level along
// the parallel but for a step at one side, the narrower and steeper the nearer to the pole.  So it is
// bilinear there: one facet, straight along each meridian, and as steep along the parallel as where it
// begins.  Towards the poles, synthesised levels have cells several columns wide, so that they are about as
// wide as high in the world (detail.h).  They are bilinear, too: so they are one surface however many of the
// columns inside them are drawn.
//
// The pyramid follows Losasso & Hoppe 2004, sections 5, 7 and 8: T_{l+1} = D(T_l); finer levels are
// U(T) + noise, with U the 4-point interpolatory scheme in integers, one rounding (numerics.md, section 5).
// SPDX-License-Identifier: MIT
#ifndef COMMON_TERRAIN_TERRAIN_H
#define COMMON_TERRAIN_TERRAIN_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct terrain;
struct detail;

enum terrain_datum { TERRAIN_PLANE, TERRAIN_SPHERE };
enum terrain_wait { TERRAIN_WAIT, TERRAIN_TRY };

// Linear filter D from a level to the next coarser one, a tensor product of
enum terrain_filter {
    TERRAIN_FILTER_LINEAR, // (-1 2 6 2 -1)/8: the dual of linear interpolation (Cohen, Daubechies, Feauveau
                           // 1992, 5/3), nearly the least-squares fit by the surface that a level draws; the
                           // default
    TERRAIN_FILTER_HALFBAND, // (-1 0 9 16 9 0 -1)/32: the adjoint of U (Losasso & Hoppe 2004)
    TERRAIN_FILTER_TENT,     // (1 2 1)/4
    TERRAIN_FILTER_DECIMATE, // (1): every other sample
    TERRAIN_FILTER_OPTIMAL, // 11 taps, the least squares fit by U (Losasso & Hoppe 2004, section 7, footnote;
                            // filter_fit.h)
    TERRAIN_FILTERS
};

// Where the noise of synthesised levels comes from.
enum terrain_noise {
    TERRAIN_NOISE_HASH,  // of the absolute sample and level: it never repeats; the default
    TERRAIN_NOISE_TABLE, // as published: a table of 50 x 50 deviates, repeated, the same for every level
};

struct terrain_extent { // samples of one level: x0 <= i < x1, y0 <= j < y1
    int64_t x0, y0, x1, y1;
};

struct terrain_info {
    char name[64];
    struct terrain_packed { // of a .relief file: what packing lost, and what a sample takes
        char codec[16];     // empty for other sources
        double bits_per_sample, rms_m, max_m;
    } packed;
    enum terrain_datum datum;
    double radius_m;     // sphere only
    double spacing_m[2]; // of level 0; x and y need not be equal
    bool wraps_x; // sphere: column x1 is column x0 again, and beyond a pole rows come back half a turn away
    double quantum_m, offset_m; // height_m = quantum_m * q + offset_m
    int finest, coarsest;       // level numbers, finest <= 0 <= coarsest
    double outline_m[4];        // exact outline of the map: x_min, y_min, x_max, y_max
    int32_t min_q, max_q;  // of the finest level, voids filled; bounds where it is a planet's and synthesised
    uint64_t voids_filled; // samples of the source that were void
    uint64_t samples;      // of the finest level
};

struct terrain_level {
    struct terrain_extent extent; // covers the map, rounded outward
    double spacing_m[2];
    int32_t min_q, max_q;
    double rms_error_m,
        max_error_m;    // PL(this level) - PL(finest level) at the finest samples; 0 at the finest.  NAN over
                        // the synthesised levels of a planet, which nobody made as a whole
    bool rms_estimated; // rms_error_m is that of a few blocks spread over a large map on disk: its file does
                        // not tell it, or finer levels are made up
    bool max_estimated; // so is max_error_m, and terrain_error with it: finer levels are made up
    double noise_q;     // standard deviation of the noise of a synthesised level, quanta; 0 for the others
};

// What to make of a source.  A zeroed struct gives the defaults.
struct terrain_options {
    enum terrain_filter filter;
    int synthesize_levels; // finer levels to add, 0..8; on a sphere 0..18: made on demand (detail.h)
    uint64_t seed;         // of the noise
    enum terrain_noise noise;
    // The source quantum is divided by 2^this, or by as much as keeps |q| <= 2^21; 0: 8 bits when levels are
    // synthesised, so that their noise is not flattened, else none.
    int refine_bits;
    int min_size;       // levels are added until neither side has more samples than this; 0: 8, at least 3
    double radius_m;    // of the planet that the samples cover; 0: a plane (files know their own)
    bool pixel_centred; // planet: samples are the centres of cells

    // Of a .relief file, which is read on demand; filter does not apply, its levels are the file's own.
    uint64_t cache_bytes; // ceiling of what is kept decoded; 0: 64 MiB
    int64_t
        frame_samples;  // samples that arrive a frame at most (reader.h); 0: 2^19; < 0: readers wait instead
    int latency_frames; // from asking to arrival (reader.h); 0: 2
    int workers;        // threads that decode; 0: one less than there are processors, at least one
};

// Reads any elevation file: 16-bit PNG with a JSON sidecar, SRTM .hgt, raw 16-bit or float with a sidecar,
// and what GDAL reads when built with it (heightfield.h says how).  Voids are filled, with a note.  NULL
// after one line on stderr.  A .relief file stays on disk and is read on demand, whatever its size (paged.h),
// that of a planet, too.
struct terrain *terrain_load(const char *path, const struct terrain_options *options);

// The grid that the program carries: Jacksboro fault, 403 x 344 samples, U.S. Geological Survey, public
// domain.
struct terrain *terrain_builtin(const struct terrain_options *options);

// Builds from samples in memory: row 0 is the SOUTH row, values in quanta, |q| < 2^22; INT32_MIN is a void.
// `first` is the index of the sample in the south-west corner (any int64: tests put terrain 1e10 samples from
// the origin).  Copies the samples; options may be NULL.  NULL after one line on stderr.
// options->radius_m makes it a whole planet: `width`, even, samples a turn, first[0] the index of the first
// column (longitude 0 is column 0), `height`, odd, rows from pole to pole; each pole is made one height.  Or,
// pixel_centred, `height`, even, rows of the centres of cells, which are interpolated onto such a grid.  The
// spacing follows from it.
struct terrain_grid {
    const char *name;
    const int32_t *samples;
    int64_t width, height;
    int64_t first[2];
    double spacing_m[2], quantum_m, offset_m;
};
struct terrain *terrain_from_grid(const struct terrain_grid *grid, const struct terrain_options *options);

void terrain_destroy(struct terrain *terrain); // accepts NULL

const struct terrain_info *terrain_info(const struct terrain *terrain);
struct terrain_level terrain_level(const struct terrain *terrain, int level);

// Copies a window of `width` x `height` samples of `level`, south-west corner (x0, y0), row by row
// northwards. Samples outside the level's extent repeat the nearest sample inside it, and on a sphere are
// those that are met on going on.  TERRAIN_TRY may return false: not here yet, now requested; TERRAIN_WAIT
// always returns true.  Thread-safe.
bool terrain_window(const struct terrain *terrain, int level, int64_t x0, int64_t y0, int width, int height,
                    int32_t *out, enum terrain_wait wait);

// Lowest and highest sample of the window's rectangle (both ends included, clamped to the extent);
// conservative: never tighter than the samples, at most one node of the extrema pyramid looser on each side
// (read on demand: one tile of 64 samples, from the side section; looser still for synthesised levels).
void terrain_bounds(const struct terrain *terrain, int level, int64_t x0, int64_t y0, int64_t x1, int64_t y1,
                    int32_t *min_q, int32_t *max_q);

// At least the largest difference in metres between the level's surface and that of the finest, over a
// rectangle of samples of the level (both ends included).  Read on demand: that of the tiles under it, from
// the side section.  In memory, on a sphere, and over made-up levels of a file: the level's max_error_m,
// which may be NAN or an estimate (terrain_level.max_estimated) and then bounds nothing.
double terrain_error(const struct terrain *terrain, int level, int64_t x0, int64_t y0, int64_t x1,
                     int64_t y1);

// The file has proved harmed while it was read: one line was printed, and samples read since are made up.
// Programs look after each frame and end with EXIT_WORLD.
bool terrain_failed(const struct terrain *terrain);

// The samples of a level when it is in memory, row 0 south, `*stride` samples a row; else NULL, as for the
// synthesised levels of a sphere.
const int32_t *terrain_samples(const struct terrain *terrain, int level, size_t *stride);

// Extrema pyramid over the cells of the finest level: node (i, j) of height k covers the cells
// 2^k i <= x < 2^k (i+1) (counted from the extent's south-west corner) and bounds their four corners'
// heights.  On a sphere: of level 0, nodes of 8 x 8 cells and up, as its samples bound them.
struct terrain_extrema {
    int heights; // number of node levels; the last has one node
    struct terrain_extrema_nodes {
        int64_t width, height;
        const int32_t *min_q, *max_q; // row by row, row 0 south
    } nodes[40];
};
// NULL for a terrain that is read on demand; then there are pages.
const struct terrain_extrema *terrain_extrema(const struct terrain *terrain);

// A page of a terrain that is read on demand: TERRAIN_PAGE x TERRAIN_PAGE cells of a level and the nodes of
// heights 0..TERRAIN_PAGE_HEIGHT over them.  Beyond the map's edge the last samples repeat.  Nodes of a
// coarser level bound the surface of the finest all the same: they are the level's, raised by terrain_error.
enum { TERRAIN_PAGE = 64, TERRAIN_PAGE_HEIGHT = 6 };
struct terrain_page {
    int level;
    int64_t x, y;           // cells x * TERRAIN_PAGE ... from the extent's south-west corner
    const int32_t *samples; // TERRAIN_PAGE + 1 a row; NULL: nothing is held
    const int32_t *max_q[TERRAIN_PAGE_HEIGHT + 1]; // node (i, j) of height k: [j * (TERRAIN_PAGE >> k) + i]
    void *slot;                                    // the cache's, until released
    int32_t *own;                                  // when the cache has no room left
};
// Reads page (x, y) of a level in place of what `page`, zeroed at first, held.  Any thread, each with pages
// of its own.
void terrain_page(const struct terrain *terrain, int level, int64_t x, int64_t y, struct terrain_page *page);
void terrain_page_release(const struct terrain *terrain, struct terrain_page *page);
// At least the highest sample of node (i, j) of a height from TERRAIN_PAGE_HEIGHT up, as terrain_extrema
// counts them.
int32_t terrain_node_max(const struct terrain *terrain, int height, int64_t i, int64_t j);
// Levels finest .. this one have pages; those of levels over the finest cost less and bound nearly as well.
int terrain_coarsest_page(const struct terrain *terrain);

// What the synthesised levels of a sphere are made of (detail.h); NULL on the plane.
const struct detail *terrain_detail(const struct terrain *terrain);

// Height in quanta of the truth (finest level, piecewise linear, double) at a place in metres.
// False outside the outline.  `slope` (may be NULL) receives dz/dx and dz/dy of the triangle, in quanta per
// metre.
bool terrain_truth_at(const struct terrain *terrain, double x_m, double y_m, double *height_q,
                      double slope[2]);

// Place <-> world.  On the plane (x, y, height) is the world position; on a sphere x is longitude and y
// latitude, in metres of arc, and the world is planet-centred (z to the north pole, x to longitude 0).
// Everything that measures goes through these, so that a sphere is not a rewrite.
void terrain_world_from_place(const struct terrain *terrain, const double place[3], double world_m[3]);
void terrain_place_from_world(const struct terrain *terrain, const double world_m[3], double place[3]);
void terrain_up(const struct terrain *terrain, const double world_m[3], double up[3]);
// Unit vectors at a place in the world: rows east, north, up.  At a pole the place's x tells which way is
// east.
void terrain_axes(const struct terrain *terrain, const double place[3], double axes[3][3]);

size_t terrain_resident_bytes(const struct terrain *terrain);

#endif
