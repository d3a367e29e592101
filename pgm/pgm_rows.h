// The rows of the grid: how many there are, how they are spread between the sampling camera's ends, and which
// level each reads.  Livny et al. 2008, sections 3.2 to 3.5 and 6.3.  PURE: no GL.
// SPDX-License-Identifier: MIT
#ifndef PGM_PGM_ROWS_H
#define PGM_PGM_ROWS_H

#include "pgm/pgm_sampler.h"

struct pgm_row {
    double fall;         // b
    double forward_m;    // q
    double half_width_m; // w
    double spacing_m;    // r: distance to the neighbour that picks the level
    int level;           // above the finest, 0 .. levels - 1
    double weight;       // of the next coarser level, 0 at the coarsest
    double range_m; // PGM_LOD_PUBLISHED: the vertex's weight is distance / range - 1, unclamped as printed;
                    // else 0
};

// How much of a grid of rows x columns quads this frame takes: `used` is `settings` with fewer rows and
// columns where the law, sky or share ask for fewer, and with extra rows where strips are asked for.  rows
// and columns are cut by whole tiles; most_rows: those of the grid as it was uploaded, room for strips
// included.
void pgm_rows_fit(const struct pgm_sampler *sampler, const struct view *view, const struct pgm_world *world,
                  const struct pgm_settings *settings, int most_rows, struct pgm_settings *used);

// Fills settings->rows + 1 rows, far to near.  Not for an empty sampler.
void pgm_rows_lay(const struct pgm_sampler *sampler, const struct view *view, const struct pgm_world *world,
                  const struct pgm_settings *settings, struct pgm_row *rows);

// The share of the grid that is to hold a frame time, from the share that took frame_ms: a step towards it,
// none within 5 %.  Time need not be proportional to the share, nor free of a fixed part.
double pgm_hold_share(double share, double frame_ms, double hold_ms);

// p99.9 of an error of which the rms and the largest of `samples` are known, taken to be distributed as
// log P(|error| > x) = -(x / s)^b, s and b such that both come out right: heavy tails have a small b.
double pgm_error_p999(double rms, double largest, double samples);

// Rms of a mesh as fine as a level whose vertices stand anywhere in the level's cells.  A crease of slope c
// leaves c^2 / 12 of mean square where every other sample is dropped, which is what the parent lacks, and
// c^2 E[d^2 (1 - d)^2] / 3 = c^2 / 90 where the samples are read d aside.
double pgm_error_unaligned(double rms, double parent_rms);

// Equations 6 and 7: level and parent's weight for a sampling distance in finest cells.  Zero and NaN give
// level 0, weight 0.
void pgm_level_for(double cells, enum pgm_lod lod, int levels, int *level, double *weight);

#endif
