// A terrain that is read on demand from a .relief file, behind struct terrain: memory stays under a ceiling
// whatever the size of the map.  Its levels are the file's own and synthesised ones over them (Losasso &
// Hoppe 2004, sections 5, 7 and 8).  Thread-safe; what is read does not depend on what is kept or on threads.
//
// Decoded samples are kept in blocks of PAGED_BLOCK x PAGED_BLOCK, three quarters of the ceiling; the ray
// caster's pages have the rest.  Beside the ceiling there are the file's index and side section, bounds of
// the nodes over its tiles (together about 14 bytes a tile), and at most 1 MiB a thread while it decodes.
//
// A level of the file has floor(cells / 2^level) cells along an axis; where they end before the map does, one
// more column or row continues the line through the last two (U's extrapolation), so that every level covers
// the map.
// SPDX-License-Identifier: MIT
#ifndef COMMON_TERRAIN_PAGED_H
#define COMMON_TERRAIN_PAGED_H

#include "common/terrain/slots.h"
#include "common/terrain/terrain.h"

struct paged;

enum {
    PAGED_BLOCK = 128,
    PAGED_NODE_HEIGHT = TERRAIN_PAGE_HEIGHT + 1, // nodes from here up are kept; those below are the tiles'
};

// NULL after one line on stderr.
struct paged *paged_open(const char *path, const struct terrain_options *options);
void paged_close(struct paged *paged); // accepts NULL

void paged_info(const struct paged *paged, struct terrain_info *info); // all but the name
struct terrain_level paged_level(const struct paged *paged, int level);

// As terrain_window (out NULL: only asks), terrain_bounds, terrain_error and terrain_failed.
bool paged_window(struct paged *paged, int level, int64_t x0, int64_t y0, int width, int height, int32_t *out,
                  enum terrain_wait wait);
void paged_bounds(const struct paged *paged, int level, int64_t x0, int64_t y0, int64_t x1, int64_t y1,
                  int32_t *min_q, int32_t *max_q);
double paged_error(const struct paged *paged, int level, int64_t x0, int64_t y0, int64_t x1, int64_t y1);
bool paged_failed(const struct paged *paged);
size_t paged_resident_bytes(struct paged *paged);

double paged_noise_q(const struct paged *paged, int level); // standard deviation that detail of a level has

// ---- planets ---------------------------------------------------------------

struct sphere_grid;
// The grid of a planet's level 0; NULL: the map is a plane.
const struct sphere_grid *paged_planet(const struct paged *paged);
// As terrain_window and terrain_bounds, of the planet that the file holds: over the seam and the poles.
bool paged_planet_window(struct paged *paged, int level, int64_t x0, int64_t y0, int width, int height,
                         int32_t *out, enum terrain_wait wait);
void paged_planet_bounds(const struct paged *paged, int level, int64_t x0, int64_t y0, int64_t x1, int64_t y1,
                         int32_t *min_q, int32_t *max_q);
// The windows of the file that a planet's window is made of, one after the other; false once `each` says so.
typedef bool paged_piece_fn(void *user, int level, int64_t x0, int64_t y0, int width, int height);
bool paged_planet_pieces(const struct paged *paged, int level, int64_t x0, int64_t y0, int width, int height,
                         paged_piece_fn *each, void *user);

// ---- blocks ----------------------------------------------------------------

// Blocks along both axes that a window touches: x0 <= x < x1, y0 <= y < y1.
struct terrain_extent paged_blocks(const struct paged *paged, int level, int64_t x0, int64_t y0, int width,
                                   int height);
// Lets a worker decode a block.  A hint: it may be forgotten, and nothing waits for it.  False: there are no
// workers.
bool paged_request(struct paged *paged, struct slot_key key);
// Drops what no worker has begun.
void paged_forget_requests(struct paged *paged);
bool paged_holds(struct paged *paged, struct slot_key key);

int32_t paged_block_count(const struct paged *paged); // blocks that the ceiling has room for
int paged_latency(const struct paged *paged);         // frames from asking to arrival
int64_t paged_frame_samples(const struct paged *paged);

// ---- the ray caster's pages ------------------------------------------------

// As terrain_page, terrain_node_max and terrain_coarsest_page.
void paged_page(struct paged *paged, int level, int64_t x, int64_t y, struct terrain_page *page);
void paged_page_release(struct paged *paged, struct terrain_page *page);
int32_t paged_node_max(const struct paged *paged, int height, int64_t i, int64_t j);
int paged_coarsest_page(const struct paged *paged);

#endif
