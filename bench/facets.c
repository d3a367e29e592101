// SPDX-License-Identifier: MIT
#include "bench/facets.h"
#include "common/report.h"
#include "common/terrain/detail.h"
#include "common/terrain/sphere.h"
#include "common/view/frustum.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { BLOCK = 32, SMALLEST_BLOCK = 4, CORNERS = BLOCK + 1 };

struct corner {
    double place[2], height_m;    // columns and rows from the map's south-west sample
    double relative[3], parallel; // cosine of latitude
};

struct making {
    struct facets *facets;
    const struct terrain_info *info;
    const struct detail *detail; // NULL: no level is synthesised
    const struct view *view;
    double step[2];  // radians between samples
    int64_t size[2]; // cells
    int64_t first;   // column
    double sag;      // metres a metre of distance
    const struct facet_rises *rises;
    // West and east corners of a cell that is bilinear: at a pole, or several columns wide (terrain.h); else
    // NULL.
    const struct corner *south, *north;
    size_t most_bytes;
    bool failed;
};

static int32_t larger(int32_t a, int32_t b)
{
    return a > b ? a : b;
}

static double length_of(const double v[3])
{
    return sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
}

static double distance_between(const struct corner *a, const struct corner *b)
{
    double chord[3];
    for (int axis = 0; axis < 3; axis++) chord[axis] = b->relative[axis] - a->relative[axis];
    return length_of(chord);
}

static bool is_pole(const struct making *m, const struct corner *corner)
{
    return corner->place[1] == 0 || corner->place[1] == (double)m->size[1];
}

// Column 0 stands for the last, too, so that corners at the seam are the same numbers from both sides.
static void set_relative(const struct making *m, struct corner *corner)
{
    double column =
        corner->place[0] >= (double)m->size[0] ? corner->place[0] - (double)m->size[0] : corner->place[0];
    double longitude = (column + (double)m->first) * m->step[0];
    double latitude = (corner->place[1] - 0.5 * (double)m->size[1]) * m->step[1];
    bool pole = is_pole(m, corner);
    double across = pole ? 0 : cos(latitude), distance_m = m->info->radius_m + corner->height_m;
    corner->parallel = across;
    double world[3] = {across * cos(longitude), across * sin(longitude),
                       pole ? copysign(1, latitude) : sin(latitude)};
    const struct view *view = m->view;
    for (int axis = 0; axis < 3; axis++) {
        corner->relative[axis] = 0;
        for (int k = 0; k < 3; k++)
            corner->relative[axis] += (world[k] * distance_m - view->eye_m[k]) * view->axes[axis][k];
    }
}

// ---- splitting -------------------------------------------------------------

// Whatever lies nearer than the near plane is not drawn.
static double sag_allowed(const struct making *m, double distance_m)
{
    return m->sag * fmax(distance_m, m->view->near_m);
}

// The steepest slope of the facets beside an edge.
static double slope_beside(const struct making *m, const struct corner *a, const struct corner *b)
{
    int64_t south = (int64_t)ceil(fmin(a->place[1], b->place[1])) - 1,
            north = (int64_t)floor(fmax(a->place[1], b->place[1]));
    double east = 0, along = 0, r = m->info->radius_m;
    for (int64_t j = south < 0 ? 0 : south; j <= north && j < m->size[1]; j++) {
        bool at_pole = j == 0 || j == m->size[1] - 1; // as steep all the way as at the other side
        double parallel = at_pole ? sin(m->step[1]) : fmin(a->parallel, b->parallel);
        east = fmax(east, m->rises->east_m[j] / parallel);
        along = fmax(along, m->rises->north_m[j]);
    }
    return hypot(east / (0.9 * r * m->step[0]), along / (0.9 * r * m->step[1]));
}

// How far the middle of an edge is off its facets: what points up counts, and what points along the ground
// by their slope.
static double sag_of(const struct making *m, const struct corner *a, const struct corner *b,
                     const struct corner *middle)
{
    double off[3], up[3], out = 0;
    for (int axis = 0; axis < 3; axis++) {
        off[axis] = middle->relative[axis] - 0.5 * (a->relative[axis] + b->relative[axis]);
        up[axis] = middle->relative[axis] + (axis == 2 ? m->view->radius_m : 0);
    }
    for (int axis = 0; axis < 3; axis++) out += off[axis] * up[axis] / length_of(up);
    double all = length_of(off), aside = sqrt(fmax(all * all - out * out, 0));
    return fmin(all, fabs(out) + aside * slope_beside(m, a, b));
}

// Height of a bilinear cell over a place, in columns and rows.
static double bilinear_height(const struct making *m, const double place[2])
{
    const struct corner *south = m->south, *north = m->north;
    double u = (place[0] - south[0].place[0]) / (south[1].place[0] - south[0].place[0]),
           v = place[1] - south->place[1];
    return (1 - v) * ((1 - u) * south[0].height_m + u * south[1].height_m) +
           v * ((1 - u) * north[0].height_m + u * north[1].height_m);
}

static bool is_side(const struct making *m, const struct corner *a, const struct corner *b)
{
    return a->place[1] == b->place[1] &&
           (a->place[1] == m->south->place[1] || a->place[1] == m->north->place[1]);
}

// Only the cell itself has such an edge: it is neither a meridian nor on the rows that bound it.
static bool is_inside_bilinear(const struct making *m, const struct corner *a, const struct corner *b)
{
    return m->south && !is_pole(m, a) && !is_pole(m, b) && a->place[0] != b->place[0] && !is_side(m, a, b);
}

// How far the middle of an edge inside a bilinear cell is above or below it.  A bound of slopes would split
// edges along the parallel, again and again, and leave slivers metres long and millimetres wide, inside which
// rasterisers interpolate badly.
static double bilinear_gap(const struct making *m, const struct corner *a, const struct corner *b,
                           const struct corner *middle)
{
    double relative[3], world[3], turn = (double)m->size[0];
    for (int axis = 0; axis < 3; axis++) relative[axis] = 0.5 * (a->relative[axis] + b->relative[axis]);
    view_world(m->view, relative, world);
    double across = hypot(world[0], world[1]);
    double place[2] = {atan2(world[1], world[0]) / m->step[0] - (double)m->first,
                       atan2(world[2], across) / m->step[1] + 0.5 * (double)m->size[1]};
    place[0] += turn * round((middle->place[0] - place[0]) / turn);
    return fabs(hypot(across, world[2]) - m->info->radius_m - bilinear_height(m, place));
}

// Heights are linear along an edge, but not across a bilinear cell.  What such cells share is the same number
// from both sides: u is 0 or 1 there, or it is on a row that bounds them.
static double middle_height(const struct making *m, const struct corner *a, const struct corner *b,
                            const struct corner *middle)
{
    if (!m->south || is_side(m, a, b)) return 0.5 * (a->height_m + b->height_m);
    return bilinear_height(m, middle->place);
}

// The triangles at an edge that is their longest reach no farther from its middle than it is long; those
// with a longer one are bounded by that one.
static bool is_split(const struct making *m, const struct corner *a, const struct corner *b,
                     struct corner *middle)
{
    for (int axis = 0; axis < 2; axis++) middle->place[axis] = 0.5 * (a->place[axis] + b->place[axis]);
    if (is_pole(m, a)) middle->place[0] = b->place[0]; // meridians lead there
    if (is_pole(m, b)) middle->place[0] = a->place[0];
    middle->height_m = middle_height(m, a, b, middle);
    set_relative(m, middle);
    double sag = is_inside_bilinear(m, a, b) ? bilinear_gap(m, a, b, middle) : sag_of(m, a, b, middle);
    return sag > sag_allowed(m, length_of(middle->relative) - distance_between(a, b));
}

static bool reserve(struct making *m, size_t more)
{
    struct facets *facets = m->facets;
    if (facets->triangles + more <= facets->room) return true;
    size_t room = 2 * facets->room > 65536 ? 2 * facets->room : 65536, most = m->most_bytes / 36;
    if (room > most) room = most;
    float(*corners)[3] =
        facets->triangles + more > room ? NULL : realloc(facets->corners, room * 3 * sizeof *corners);
    if (!corners) {
        m->failed = true;
        return false;
    }
    facets->corners = corners;
    facets->room = room;
    return true;
}

static void add_triangle(struct making *m, const struct corner *a, const struct corner *b,
                         const struct corner *c)
{
    const struct corner *all[3] = {a, b, c};
    if (m->failed || !reserve(m, 1)) return;
    float(*to)[3] = m->facets->corners + 3 * m->facets->triangles++;
    for (int k = 0; k < 3; k++)
        for (int axis = 0; axis < 3; axis++) to[k][axis] = (float)all[k]->relative[axis];
}

static void add_facet(struct making *m, const struct corner *a, const struct corner *b,
                      const struct corner *c)
{
    const struct corner *all[3] = {a, b, c};
    struct corner middles[3]; // of edges k, k + 1
    bool split[3];
    int count = 0;
    for (int k = 0; k < 3; k++) count += split[k] = is_split(m, all[k], all[(k + 1) % 3], &middles[k]);
    if (m->failed) return;
    if (count == 0) {
        add_triangle(m, a, b, c);
        return;
    }
    // Turned so that edge 0 is split, and with two of them edges 0 and 1.
    int turn = count == 1 ? (split[0] ? 0 : split[1] ? 1 : 2) : !split[0] ? 1 : !split[1] ? 2 : 0;
    const struct corner *p = all[turn], *q = all[(turn + 1) % 3], *r = all[(turn + 2) % 3];
    const struct corner *pq = &middles[turn], *qr = &middles[(turn + 1) % 3], *rp = &middles[(turn + 2) % 3];
    if (count == 1) {
        add_facet(m, p, pq, r);
        add_facet(m, pq, q, r);
        return;
    }
    add_facet(m, pq, q, qr);
    if (count == 2) {
        add_facet(m, p, pq, qr);
        add_facet(m, p, qr, r);
        return;
    }
    add_facet(m, p, pq, rp);
    add_facet(m, rp, qr, r);
    add_facet(m, pq, qr, rp);
}

// What lies between two rows, its south or north side possibly a point.  It is cut across while both its east
// and its west ask for it, and else from south to north, so that where a cell is much longer than wide each
// goes as far as what it leaves out asks for.  Triangles split by edges would keep the cell's shape, since
// the long edge between them is cut in half again and again.
static void add_piece(struct making *m, const struct corner *sw, const struct corner *se,
                      const struct corner *ne, const struct corner *nw)
{
    struct corner south, east, north, west;
    bool south_split = sw != se && is_split(m, sw, se, &south),
         north_split = ne != nw && is_split(m, ne, nw, &north);
    bool across = is_split(m, se, ne, &east) && is_split(m, nw, sw, &west);
    if (m->failed) return;
    if (across) {
        add_piece(m, sw, se, &east, &west);
        add_piece(m, &west, &east, ne, nw);
    } else if ((sw == se || south_split) && (ne == nw || north_split)) {
        const struct corner *below = sw == se ? sw : &south, *above = ne == nw ? ne : &north;
        add_piece(m, sw, below, above, nw);
        add_piece(m, below, se, ne, above);
    } else if (sw == se || ne == nw)
        add_facet(m, sw, sw == se ? ne : se, sw == se ? nw : ne);
    else if (distance_between(sw, ne) <= distance_between(se, nw)) {
        add_facet(m, sw, se, ne);
        add_facet(m, sw, ne, nw);
    } else {
        add_facet(m, sw, se, nw);
        add_facet(m, se, ne, nw);
    }
}

// ---- blocks ----------------------------------------------------------------

struct block {
    int64_t from[2], to[2]; // corners
    int64_t wide;           // columns of its widest cells; those that begin in it are its own
    double low_m, high_m;
    double middle[3], reach_m; // a ball around it, relative to the eye
    double reach;              // the same as an angle from the planet's centre
    double parallel;           // largest cosine of latitude
};

// The widest cells about some rows of corners, in columns (detail.h).
static int64_t widest_cell(const struct making *m, int64_t south, int64_t north)
{
    if (!m->detail) return 1;
    int a = detail_exponent(m->detail, m->info->finest, south - m->size[1] / 2),
        b = detail_exponent(m->detail, m->info->finest, north - m->size[1] / 2);
    return (int64_t)1 << (a > b ? a : b);
}

static struct block block_at(const struct making *m, const struct terrain *terrain, int level,
                             const int64_t from[2], int cells)
{
    struct block block = {.from = {from[0], from[1]}};
    int32_t low_q, high_q;
    for (int axis = 0; axis < 2; axis++)
        block.to[axis] = from[axis] + cells < m->size[axis] ? from[axis] + cells : m->size[axis];
    int64_t south = from[1] - m->size[1] / 2, north = block.to[1] - m->size[1] / 2;
    block.wide = widest_cell(m, from[1], block.to[1]);
    int64_t east = (block.to[0] + block.wide - 1) / block.wide * block.wide;
    terrain_bounds(terrain, level, from[0] + m->first, south, east + m->first, north, &low_q, &high_q);
    block.low_m = m->info->offset_m + m->info->quantum_m * low_q;
    block.high_m = m->info->offset_m + m->info->quantum_m * high_q;
    block.parallel = south <= 0 && north >= 0 ? 1 : cos((double)(south > 0 ? south : north) * m->step[1]);
    block.reach = 0.5 * (double)(block.to[1] - from[1]) * m->step[1] +
                  0.5 * (double)(east - from[0]) * m->step[0] * block.parallel;
    struct corner middle = {.place = {0.5 * (double)(from[0] + east), 0.5 * (double)(from[1] + block.to[1])},
                            .height_m = 0.5 * (block.low_m + block.high_m)};
    set_relative(m, &middle);
    memcpy(block.middle, middle.relative, sizeof block.middle);
    block.reach_m = block.reach * (m->info->radius_m + block.high_m) + 0.5 * (block.high_m - block.low_m);
    return block;
}

// Angle at the planet's centre from the eye to the horizon of the lowest ground; and how far below it a
// height still shows.
static double horizon(const struct making *m, double radius_m)
{
    double lowest_m = m->info->radius_m + m->info->offset_m + m->info->quantum_m * m->info->min_q;
    return radius_m > lowest_m ? acos(lowest_m / radius_m) : 0;
}

static bool is_seen(const struct making *m, const struct block *block, const struct frustum *frustum)
{
    const double *p = block->middle;
    double radius_m = m->view->radius_m, away = atan2(hypot(p[0], p[1]), radius_m + p[2]);
    double seen = horizon(m, radius_m) + horizon(m, m->info->radius_m + block->high_m);
    if (away - block->reach > seen + 1e-6) return false;
    for (int k = 0; frustum && k < FRUSTUM_PLANES; k++) {
        const double *n = frustum->normal[k];
        double inside_m = n[0] * p[0] + n[1] * p[1] + n[2] * p[2] + frustum->offset[k];
        if (inside_m < -block->reach_m - 1e-6 * length_of(p)) return false;
    }
    return true;
}

// Whether no edge in the block can ask for a split, by bounds of the second derivatives of a facet's place
// along a cell's sides and of both together; an edge leaves out an eighth of that along it.
static bool is_whole(const struct making *m, const struct block *block)
{
    double r = m->info->radius_m + block->high_m, rise_m = block->high_m - block->low_m;
    double turn = m->step[0] * (double)block->wide, east = turn * block->parallel, north = m->step[1];
    double along_east = r * turn * east + 2 * rise_m * east,
           along_north = r * north * north + 2 * rise_m * north;
    double both = rise_m * (north + east) + r * turn * north;
    if (block->wide > 1) both += 2 * rise_m; // the corners of a bilinear cell against each other
    if (block->from[1] == 0 || block->to[1] == m->size[1]) both += rise_m; // of a fan two are one
    double cell_m = 1.5 * (r * hypot(east, north) + rise_m);
    double most = 1.01 / 8 * (along_east + 2 * both + along_north);
    return most < sag_allowed(m, length_of(block->middle) - block->reach_m - cell_m);
}

// Triangles between two rows, whose south or north side is a point.
static void add_part(struct making *m, bool whole, const struct corner *sw, const struct corner *se,
                     const struct corner *ne, const struct corner *nw)
{
    if (whole)
        add_triangle(m, sw, sw == se ? ne : se, sw == se ? nw : ne);
    else
        add_piece(m, sw, se, ne, nw);
}

static struct corner middle_of(const struct making *m, const struct corner *row)
{
    struct corner middle = {.place = {0.5 * (row[0].place[0] + row[1].place[0]), row->place[1]},
                            .height_m = 0.5 * (row[0].height_m + row[1].height_m)};
    set_relative(m, &middle);
    return middle;
}

// From the west and east corners of its two sides; `halved`: beyond the side, cells are half as wide.
static void add_cell(struct making *m, bool whole, const bool halved[2], const struct corner south[2],
                     const struct corner north[2])
{
    bool south_pole = is_pole(m, south), north_pole = is_pole(m, north);
    bool bilinear = south_pole || north_pole || south[1].place[0] - south[0].place[0] > 1;
    m->south = bilinear ? south : NULL;
    m->north = bilinear ? north : NULL;
    const struct corner *sw = south, *se = south + 1, *nw = north, *ne = north_pole ? north : north + 1;
    if (!south_pole && halved[0]) {
        struct corner middle = middle_of(m, south);
        add_part(m, whole, sw, &middle, ne, ne);
        add_part(m, whole, &middle, se, ne, ne);
    } else if (!south_pole)
        add_part(m, whole, sw, se, ne, ne);
    if (!north_pole && halved[1]) {
        struct corner middle = middle_of(m, north);
        add_part(m, whole, sw, sw, ne, &middle);
        add_part(m, whole, sw, sw, &middle, nw);
    } else if (!north_pole)
        add_part(m, whole, sw, sw, ne, nw);
}

// Those cells of row j that begin in a block where cells may be wider than a column.
static void add_wide_row(struct making *m, const struct block *block, int64_t j, bool whole)
{
    int32_t around[2 * (BLOCK + DETAIL_CELL)];
    int64_t y = j - m->size[1] / 2, beside = y >= 0 ? y - 1 : y + 1;
    int level = m->info->finest, e = detail_cell_exponent(m->detail, level, y);
    bool wider[2], halved[2] = {false, false};
    halved[y < 0] = detail_cell_exponent(m->detail, level, beside) < e;
    for (int k = 0; k < 2; k++) wider[k] = detail_exponent(m->detail, level, y + k) > e;
    int64_t scale = (int64_t)1 << e, first = (block->from[0] + scale - 1) >> e;
    int count = (int)(((block->to[0] + scale - 1) >> e) - first), width = count + DETAIL_CELL - 1;
    if (count > 0) detail_posts(m->detail, level, e, first - 1, y, width, 2, around);
    for (int i = 0; i < count; i++) {
        struct corner c[2][2];
        double z[2][2];
        detail_corners(first + i, wider, around + i, width, z);
        for (int k = 0; k < 4; k++) {
            struct corner *corner = &c[k / 2][k % 2];
            *corner = (struct corner){.place = {(double)((first + i + k % 2) * scale), (double)(j + k / 2)},
                                      .height_m = m->info->offset_m + m->info->quantum_m * z[k / 2][k % 2]};
            set_relative(m, corner);
        }
        add_cell(m, whole, halved, c[0], c[1]);
    }
}

static void add_block(struct making *m, const struct terrain *terrain, int level, const struct block *block,
                      bool whole, struct corner *corners)
{
    int width = (int)(block->to[0] - block->from[0]) + 1, height = (int)(block->to[1] - block->from[1]) + 1;
    int32_t samples[CORNERS * CORNERS];
    for (int64_t j = block->from[1]; block->wide > 1 && j < block->to[1]; j++)
        add_wide_row(m, block, j, whole);
    if (block->wide > 1) return;
    terrain_window(terrain, level, block->from[0] + m->first, block->from[1] - m->size[1] / 2, width, height,
                   samples, TERRAIN_WAIT);
    for (int k = 0; k < width * height; k++) {
        corners[k] = (struct corner){
            .place = {(double)(block->from[0] + k % width), (double)(block->from[1] + k / width)},
            .height_m = m->info->offset_m + m->info->quantum_m * samples[k]};
        set_relative(m, &corners[k]);
    }
    for (int j = 0; j < height - 1; j++)
        for (int i = 0; i < width - 1; i++) {
            static const bool HALVED[2] = {false, false};
            const struct corner *south = corners + j * width + i;
            add_cell(m, whole, HALVED, south, south + width);
        }
}

// What is split is looked at in smaller blocks, of which fewer are seen.  Whether anything is.
static bool add_seen(struct making *m, const struct terrain *terrain, const struct frustum *frustum,
                     const int64_t from[2], int cells, struct corner *corners)
{
    if (m->failed || from[0] >= m->size[0] || from[1] >= m->size[1]) return false;
    int level = m->info->finest;
    struct block block = block_at(m, terrain, level, from, cells);
    if (!is_seen(m, &block, frustum)) return false;
    bool whole = is_whole(m, &block), any = false;
    if (whole || cells == SMALLEST_BLOCK) {
        add_block(m, terrain, level, &block, whole, corners);
        return true;
    }
    for (int quarter = 0; quarter < 4; quarter++) {
        int64_t corner[2] = {from[0] + (quarter % 2) * cells / 2, from[1] + (quarter / 2) * cells / 2};
        any |= add_seen(m, terrain, frustum, corner, cells / 2, corners);
    }
    return any;
}

static struct making begin(struct facets *facets, const struct terrain *terrain, const struct view *view,
                           double sag_px, size_t most_bytes)
{
    const struct terrain_info *info = terrain_info(terrain);
    struct terrain_level level = terrain_level(terrain, info->finest);
    double slant = sqrt(1 + view->tan_half[0] * view->tan_half[0] + view->tan_half[1] * view->tan_half[1]);
    struct making m = {.facets = facets,
                       .info = info,
                       .detail = info->finest < 0 ? terrain_detail(terrain) : NULL,
                       .view = view,
                       .first = level.extent.x0,
                       // A triangle's inside is off by at most 4/3 of its edges' sag.
                       .sag = 0.75 * sag_px / (view->pixels_per_tangent * slant),
                       .most_bytes = most_bytes};
    m.size[0] = level.extent.x1 - level.extent.x0;
    m.size[1] = level.extent.y1 - level.extent.y0 - 1;
    for (int axis = 0; axis < 2; axis++) m.step[axis] = level.spacing_m[axis] / info->radius_m;
    return m;
}

// ---- the contract ----------------------------------------------------------

bool facet_rises_init(struct facet_rises *rises, const struct terrain *terrain)
{
    const struct terrain_info *info = terrain_info(terrain);
    struct terrain_extent e = terrain_level(terrain, info->finest).extent;
    int width = (int)(e.x1 - e.x0) + 1, bands = (int)(e.y1 - e.y0) - 1;
    int32_t *rows = malloc(2 * (size_t)width * sizeof *rows);
    rises->east_m = calloc((size_t)bands, sizeof *rises->east_m);
    rises->north_m = calloc((size_t)bands, sizeof *rises->north_m);
    bool good = rows && rises->east_m && rises->north_m;
    for (int j = 0; j < bands && good; j++) {
        int32_t east_q = 0, north_q = 0;
        terrain_window(terrain, info->finest, e.x0, e.y0 + j, width, 2, rows, TERRAIN_WAIT);
        for (int i = 0; i < width; i++) {
            for (int k = 0; i && k < 2; k++)
                east_q = larger(east_q, abs(rows[k * width + i] - rows[k * width + i - 1]));
            north_q = larger(north_q, abs(rows[width + i] - rows[i]));
        }
        rises->east_m[j] = info->quantum_m * east_q;
        rises->north_m[j] = info->quantum_m * north_q;
    }
    free(rows);
    return good || fail("terrain %s: out of memory", info->name);
}

void facet_rises_finish(struct facet_rises *rises)
{
    free(rises->east_m);
    free(rises->north_m);
    *rises = (struct facet_rises){0};
}

bool facets_make(struct facets *facets, const struct facet_rises *rises, const struct terrain *terrain,
                 const struct view *view, bool cull, double sag_px, size_t most_bytes)
{
    struct making m = begin(facets, terrain, view, sag_px, most_bytes);
    m.rises = rises;
    struct corner corners[CORNERS * CORNERS];
    struct frustum frustum;
    int64_t from[2];
    frustum_init(&frustum, view);
    facets->triangles = 0;
    facets->blocks = facets->blocks_drawn = 0;
    for (from[1] = 0; from[1] < m.size[1] && !m.failed; from[1] += BLOCK)
        for (from[0] = 0; from[0] < m.size[0] && !m.failed; from[0] += BLOCK) {
            facets->blocks++;
            facets->blocks_drawn += add_seen(&m, terrain, cull ? &frustum : NULL, from, BLOCK, corners);
        }
    return !m.failed || fail("terrain %s: more than %zu triangles in a view are more than brute holds",
                             m.info->name, most_bytes / 36);
}

void facets_finish(struct facets *facets)
{
    free(facets->corners);
    *facets = (struct facets){0};
}
