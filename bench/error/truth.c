// SPDX-License-Identifier: MIT
#include "bench/error/truth.h"

#include "bench/error/truth_sphere.h"
#include "common/parallel.h"
#include "common/report.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { ROWS_A_BLOCK = 4 };

// Instead of an infinite 1 / direction: the next line comes later than any end, a line the ray runs on is
// behind it.
static const double NEVER = 1e300;

struct truth_surface {
    const struct terrain *terrain;
    struct truth_sphere *sphere;    // owned; then nothing below is used
    struct terrain_extrema extrema; // borrowed nodes; of a terrain read on demand only their numbers
    const int32_t *samples;         // of the finest level, row 0 south; NULL: read in pages
    size_t stride;
    int finest, coarser; // read in pages: of so many levels over the finest, too
    int64_t first[2];    // index of the south-west sample
    int64_t cells[2];
    double clip[4]; // the map's outline in cells from the south-west sample: u, v lowest, u, v highest
    double spacing_m[2], quantum_m, offset_m;
    double min_q, max_q;
};

// What one thread holds of a terrain that is read on demand.  Below, `cells` is NULL for samples in memory;
// it is a constant wherever it is looked at often.
struct cells {
    const struct terrain *terrain;
    struct terrain_page pages[TERRAIN_PAGE_HEIGHT]; // of the finest level and those above it
};

static inline const struct terrain_page *page_at(struct cells *cells, const struct truth_surface *surface,
                                                 int above, int64_t x, int64_t y)
{
    struct terrain_page *page = &cells->pages[above];
    if (!page->samples || page->x != x || page->y != y)
        terrain_page(cells->terrain, surface->finest + above, x, y, page);
    return page;
}

static void release_pages(struct cells *cells)
{
    for (int k = 0; k < TERRAIN_PAGE_HEIGHT; k++) terrain_page_release(cells->terrain, &cells->pages[k]);
}

// ---- a ray, and what the walk asks of a datum ---------------------------------------------------

// Axes 0 and 1 are cells from the south-west sample (u east, v north), axis 2 is the height in quanta.
struct ray {
    double origin[3], direction[3]; // at t: origin + t * direction
    double inverse[2];              // 1 / direction; NEVER along the grid lines
    bool backward[2];               // towards lower cells
    double across, across_inverse;  // u - v at t = 0, and 1 / its change
};

// Every time at which a ray crosses something is computed from that something alone, so the two cells on its
// sides agree on it bitwise.  A constant table is inlined into the walk; a sphere brings another table
// (meridian half planes and cones for lines), and cuts its rays where latitude or height turns.
struct datum {
    double (*line)(const struct ray *ray, int axis, int64_t k);    // t of the crossing of grid line k
    double (*diagonal)(const struct ray *ray, int64_t k);          // t of the crossing of u - v = k
    double (*place)(const struct ray *ray, int axis, double t);    // u, v in cells, or the height in quanta
    double (*lowest)(const struct ray *ray, double t0, double t1); // lowest height in an interval
};

static inline double plane_line(const struct ray *ray, int axis, int64_t k)
{
    return ((double)k - ray->origin[axis]) * ray->inverse[axis];
}

static inline double plane_diagonal(const struct ray *ray, int64_t k)
{
    return ((double)k - ray->across) * ray->across_inverse;
}

static inline double plane_place(const struct ray *ray, int axis, double t)
{
    return ray->origin[axis] + t * ray->direction[axis];
}

static inline double plane_lowest(const struct ray *ray, double t0, double t1)
{
    return plane_place(ray, 2, ray->direction[2] < 0 ? t1 : t0);
}

static const struct datum plane = {plane_line, plane_diagonal, plane_place, plane_lowest};

// ---- one cell -----------------------------------------------------------------------------------

struct cell {
    int64_t at[2];
    double corner[2][2]; // heights in quanta, [north][east]
};

static inline double clamp(double value, double low, double high)
{
    return value < low ? low : value > high ? high : value;
}

// Never outside [a, b] for s in [0, 1]: heights are integers, so b - a is exact and rounding is monotone.
static inline double between(double a, double b, double s)
{
    return a + (b - a) * s;
}

static inline struct cell read_cell(const struct truth_surface *surface, struct cells *cells,
                                    const int64_t at[2])
{
    enum { IN_PAGE = TERRAIN_PAGE - 1 };
    const int32_t *samples = surface->samples;
    size_t stride = surface->stride, x = (size_t)at[0], y = (size_t)at[1];
    if (cells) {
        samples = page_at(cells, surface, 0, at[0] / TERRAIN_PAGE, at[1] / TERRAIN_PAGE)->samples;
        stride = TERRAIN_PAGE + 1, x &= IN_PAGE, y &= IN_PAGE;
    }
    const int32_t *south = samples + y * stride + x;
    const int32_t *north = south + stride;
    return (struct cell){{at[0], at[1]}, {{south[0], south[1]}, {north[0], north[1]}}};
}

// Height of the edge on grid line `line` of `axis`; the same bits from both of its cells.
static inline double edge_height(const struct cell *cell, int axis, int64_t line, double other)
{
    double s = clamp(other - (double)cell->at[!axis], 0, 1);
    bool side = line > cell->at[axis];
    return axis == 0 ? between(cell->corner[0][side], cell->corner[1][side], s)
                     : between(cell->corner[side][0], cell->corner[side][1], s);
}

static inline double diagonal_height(const struct cell *cell, double u)
{
    return between(cell->corner[0][0], cell->corner[1][1], clamp(u - (double)cell->at[0], 0, 1));
}

// Slopes of one of the two triangles, quanta a cell.
static inline void triangle_slope(const struct cell *cell, bool south_east, double slope[2])
{
    slope[0] = cell->corner[!south_east][1] - cell->corner[!south_east][0];
    slope[1] = cell->corner[1][south_east] - cell->corner[0][south_east];
}

static inline double triangle_height(const struct cell *cell, bool south_east, double u, double v)
{
    double slope[2], east = clamp(u - (double)cell->at[0], 0, 1),
                     north = clamp(v - (double)cell->at[1], 0, 1);
    triangle_slope(cell, south_east, slope);
    return cell->corner[0][0] + (slope[0] * east + slope[1] * north);
}

static inline double cell_height(const struct cell *cell, double u, double v)
{
    return triangle_height(cell, u - (double)cell->at[0] >= v - (double)cell->at[1], u, v);
}

// ---- the walk -----------------------------------------------------------------------------------

struct hit {
    double t;
    double height_q;
    double slope_q[2]; // quanta a cell
};

// Where the ray is.  `line` says how it came there: over grid line `line` of `axis`, or not over one (axis <
// 0).
struct place {
    double t;
    int axis;
    int64_t line;
};

// Height of the ray over the surface at a place on the rim of the cell, or inside it where the walk begins
// and ends.
static inline double clearance(const struct datum *datum, const struct ray *ray, const struct cell *cell,
                               const struct place *place)
{
    double z = datum->place(ray, 2, place->t);
    if (place->axis >= 0)
        return z - edge_height(cell, place->axis, place->line, datum->place(ray, !place->axis, place->t));
    return z - cell_height(cell, datum->place(ray, 0, place->t), datum->place(ray, 1, place->t));
}

// The ray comes down from `above` >= 0 at t0 to `below` <= 0 at t1, inside one triangle.
static inline void set_hit(struct hit *hit, const struct datum *datum, const struct ray *ray,
                           const struct cell *cell, double t0, double t1, double above, double below)
{
    double middle = 0.5 * (t0 + t1), across = datum->place(ray, 0, middle) - datum->place(ray, 1, middle);
    bool south_east = across >= (double)(cell->at[0] - cell->at[1]);
    hit->t = above > 0 ? t0 + (t1 - t0) * (above / (above - below)) : t0;
    hit->height_q =
        triangle_height(cell, south_east, datum->place(ray, 0, hit->t), datum->place(ray, 1, hit->t));
    triangle_slope(cell, south_east, hit->slope_q);
}

static inline bool comes_down(double from, double to)
{
    return (from > 0 && to <= 0) || (from == 0 && to < 0);
}

// Clearance is linear in each triangle and every rim value is shared with the neighbour, so no ray slips
// through an edge or a vertex: the chain of clearances along a ray has no gap for a change of sign to hide
// in.
static inline bool cell_hit(const struct datum *datum, const struct truth_surface *surface,
                            struct cells *cells, const struct ray *ray, const int64_t at[2],
                            const struct place *from, const struct place *to, struct hit *hit)
{
    struct cell cell = read_cell(surface, cells, at);
    double first = clearance(datum, ray, &cell, from), last = clearance(datum, ray, &cell, to);
    double t = datum->diagonal(ray, at[0] - at[1]), t0 = from->t;
    if (first < 0) { // rounding where the walk changed cells at a vertex: the surface is here
        set_hit(hit, datum, ray, &cell, t0, t0, 0, 0);
        return true;
    }
    if (t > t0 && t < to->t) {
        double middle = datum->place(ray, 2, t) - diagonal_height(&cell, datum->place(ray, 0, t));
        if (comes_down(first, middle)) {
            set_hit(hit, datum, ray, &cell, t0, t, first, middle);
            return true;
        }
        first = middle, t0 = t;
    }
    if (!comes_down(first, last)) return false;
    set_hit(hit, datum, ray, &cell, t0, to->t, first, last);
    return true;
}

// A node of the extrema pyramid that the ray is in, and when it leaves it over the far line of each axis.
struct node {
    int64_t at[2];
    double leave[2];
};

// Down into the child that the ray is in at time t.  A ray along the map's far border is in the last one.
static inline void descend(const struct datum *datum, const struct ray *ray, struct node *node, int height,
                           double t, const struct terrain_extrema_nodes *children)
{
    const int64_t count[2] = {children->width, children->height};
    for (int k = 0; k < 2; k++) {
        double middle = datum->line(ray, k, (2 * node->at[k] + 1) << height);
        bool beyond = middle <= t;
        node->at[k] = 2 * node->at[k] + (beyond != ray->backward[k]);
        if (!beyond) node->leave[k] = middle;
        if (node->at[k] >= count[k]) node->at[k] = count[k] - 1;
    }
}

static inline int64_t far_line(const struct ray *ray, const struct node *node, int axis, int height)
{
    return (node->at[axis] + !ray->backward[axis]) << height;
}

// On to the next node along an axis; true when that one has another parent.
static inline bool advance(const struct datum *datum, const struct ray *ray, struct node *node, int axis,
                           int height)
{
    int64_t before = node->at[axis];
    node->at[axis] += ray->backward[axis] ? -1 : 1;
    node->leave[axis] = datum->line(ray, axis, far_line(ray, node, axis, height));
    return (before ^ node->at[axis]) >> 1;
}

static inline void ascend(const struct datum *datum, const struct ray *ray, struct node *node, int height)
{
    for (int k = 0; k < 2; k++) {
        node->at[k] >>= 1;
        node->leave[k] = datum->line(ray, k, far_line(ray, node, k, height));
    }
}

// At least the highest sample of a node.  Read on demand, the nodes of a tile are bounded by ever finer
// levels: where a coarse one and its error tell that the ray passes above, the finer ones need not be
// decoded.
static inline int32_t highest(const struct truth_surface *surface, struct cells *cells, int height,
                              const int64_t at[2])
{
    const struct terrain_extrema_nodes *nodes = &surface->extrema.nodes[height];
    if (!cells) return nodes->max_q[at[1] * nodes->width + at[0]];
    if (height >= TERRAIN_PAGE_HEIGHT) return terrain_node_max(surface->terrain, height, at[0], at[1]);
    int level = height - 1 < surface->coarser ? height - 1 : surface->coarser; // cells there: half a node
    if (level < 0) level = 0;
    int in_level = height - level, above = TERRAIN_PAGE_HEIGHT - in_level;
    const struct terrain_page *page = page_at(cells, surface, level, at[0] >> above, at[1] >> above);
    int64_t in_page = ((int64_t)1 << above) - 1;
    return page->max_q[in_level][((at[1] & in_page) << above) + (at[0] & in_page)];
}

// Walks t0..t1 over the nodes of the extrema pyramid: down where the ray may touch what a node holds, on to
// the next node where it cannot, up when that has another parent.
static inline __attribute__((always_inline)) bool walk(const struct datum *datum,
                                                       const struct truth_surface *surface,
                                                       struct cells *cells, const struct ray *ray, double t0,
                                                       double t1, struct hit *hit)
{
    const struct terrain_extrema *extrema = &surface->extrema;
    int height = extrema->heights - 1;
    struct node node = {{0, 0}, {0, 0}};
    ascend(datum, ray, &node, height); // from below the root
    struct place at = {t0, -1, 0};
    for (;;) {
        const struct terrain_extrema_nodes *nodes = &extrema->nodes[height];
        if ((uint64_t)node.at[0] >= (uint64_t)nodes->width || (uint64_t)node.at[1] >= (uint64_t)nodes->height)
            return false;
        int axis = node.leave[1] < node.leave[0];
        double leave = axis ? node.leave[1] : node.leave[0];
        bool last = !(leave < t1);
        leave = last ? t1 : leave > at.t ? leave : at.t;
        if (datum->lowest(ray, at.t, leave) <= highest(surface, cells, height, node.at)) {
            if (height > 0) {
                descend(datum, ray, &node, --height, at.t, nodes - 1);
                continue;
            }
            struct place to = {leave, last ? -1 : axis, far_line(ray, &node, axis, 0)};
            if (cell_hit(datum, surface, cells, ray, node.at, &at, &to, hit)) return true;
        }
        if (last) return false;
        at = (struct place){leave, axis, far_line(ray, &node, axis, height)};
        if (axis ? advance(datum, ray, &node, 1, height) : advance(datum, ray, &node, 0, height))
            ascend(datum, ray, &node, ++height);
    }
}

// ---- one ray on the plane -----------------------------------------------------------------------

static double inverse_of(double direction)
{
    return fabs(direction) > 1 / NEVER ? 1 / direction : NEVER;
}

static struct ray make_ray(const double origin[3], const double direction[3])
{
    struct ray ray = {.across = origin[0] - origin[1]};
    memcpy(ray.origin, origin, sizeof ray.origin);
    memcpy(ray.direction, direction, sizeof ray.direction);
    for (int k = 0; k < 2; k++) {
        ray.inverse[k] = inverse_of(direction[k]);
        if (ray.inverse[k] >= NEVER && origin[k] > 0) ray.inverse[k] = -NEVER; // along the far border: inside
        ray.backward[k] = ray.inverse[k] < 0;
    }
    ray.across_inverse = inverse_of(direction[0] - direction[1]);
    return ray;
}

// Narrows t0..t1 to where low <= origin + t * direction <= high; false when nothing is left.
static bool narrow(double origin, double direction, double low, double high, double *t0, double *t1)
{
    double inverse = inverse_of(direction);
    if (inverse >= NEVER) return origin >= low && origin <= high;
    double enter = ((direction < 0 ? high : low) - origin) * inverse;
    double leave = ((direction < 0 ? low : high) - origin) * inverse;
    if (enter > *t0) *t0 = enter;
    if (leave < *t1) *t1 = leave;
    return *t0 <= *t1;
}

// Height over the surface where the ray begins.
static double first_clearance(const struct truth_surface *surface, struct cells *cells, const struct ray *ray,
                              double t0)
{
    double place[2];
    int64_t at[2];
    for (int k = 0; k < 2; k++) {
        place[k] = clamp(plane_place(ray, k, t0), surface->clip[k], surface->clip[k + 2]);
        at[k] = (int64_t)place[k];
        if (at[k] >= surface->cells[k]) at[k] = surface->cells[k] - 1;
    }
    struct cell cell = read_cell(surface, cells, at);
    return plane_place(ray, 2, t0) - cell_height(&cell, place[0], place[1]);
}

static inline __attribute__((always_inline)) bool cast_plane(const struct truth_surface *surface,
                                                             struct cells *cells, const double origin[3],
                                                             const double direction[3], double t0,
                                                             struct hit *hit)
{
    double t1 = HUGE_VAL;
    if (surface->cells[0] < 1 || surface->cells[1] < 1) return false; // a line of samples has no triangles
    // One quantum to spare: a ray that is cut here is above all ground where it begins and below all where it
    // ends.
    if (!narrow(origin[2], direction[2], surface->min_q - 1, surface->max_q + 1, &t0, &t1)) return false;
    for (int k = 0; k < 2; k++)
        if (!narrow(origin[k], direction[k], surface->clip[k], surface->clip[k + 2], &t0, &t1)) return false;
    if (!(t1 < HUGE_VAL)) return false; // no direction at all
    struct ray ray = make_ray(origin, direction);
    if (first_clearance(surface, cells, &ray, t0) < 0) return false;
    return walk(&plane, surface, cells, &ray, t0, t1, hit);
}

// Two functions, so that the one over samples in memory is as lean as if it were alone.
static bool cast_samples(const struct truth_surface *surface, const double origin[3],
                         const double direction[3], double t0, struct hit *hit)
{
    return cast_plane(surface, NULL, origin, direction, t0, hit);
}

static bool cast_pages(const struct truth_surface *surface, struct cells *cells, const double origin[3],
                       const double direction[3], double t0, struct hit *hit)
{
    return cast_plane(surface, cells, origin, direction, t0, hit);
}

// In cells and quanta, from t0 on.
static inline bool cast(const struct truth_surface *surface, struct cells *cells, const double origin[3],
                        const double direction[3], double t0, struct hit *hit)
{
    return surface->samples ? cast_samples(surface, origin, direction, t0, hit)
                            : cast_pages(surface, cells, origin, direction, t0, hit);
}

// ---- the surface --------------------------------------------------------------------------------

// A place of the outline in cells.  Where it is a grid line up to rounding it is that line.
static double clip_cells(double place_m, double spacing_m, int64_t first, int64_t cells)
{
    double index = place_m / spacing_m, line = nearbyint(index);
    if (fabs(index - line) <= 4 * DBL_EPSILON * fabs(index)) index = line;
    return clamp(index - (double)first, 0, (double)cells);
}

// How many nodes there are; the root is the first height with a single one.
static void count_nodes(struct terrain_extrema *extrema, const struct terrain_extent *extent)
{
    int64_t cells[2] = {extent->x1 - extent->x0 - 1, extent->y1 - extent->y0 - 1};
    for (int k = 0; k < 2; k++) cells[k] = cells[k] < 1 ? 1 : cells[k];
    for (int height = 0;; height++) {
        struct terrain_extrema_nodes *nodes = &extrema->nodes[height];
        nodes->width = (cells[0] + ((int64_t)1 << height) - 1) >> height;
        nodes->height = (cells[1] + ((int64_t)1 << height) - 1) >> height;
        extrema->heights = height + 1;
        if (nodes->width == 1 && nodes->height == 1) return;
    }
}

static struct truth_surface *create_sphere(const struct terrain *terrain)
{
    struct truth_surface *surface = calloc(1, sizeof *surface);
    if (!surface) return fail("no memory for the ray caster"), NULL;
    surface->terrain = terrain;
    surface->sphere = truth_sphere_create(terrain);
    if (surface->sphere) return surface;
    free(surface);
    return NULL;
}

struct truth_surface *truth_surface_create(const struct terrain *terrain)
{
    const struct terrain_info *info = terrain_info(terrain);
    if (info->datum == TERRAIN_SPHERE) return create_sphere(terrain);
    struct terrain_level level = terrain_level(terrain, info->finest);
    const struct terrain_extent *extent = &level.extent;
    struct truth_surface *surface = calloc(1, sizeof *surface);
    if (!surface) {
        fail("terrain %s: no memory for the ray caster", info->name);
        return NULL;
    }
    surface->terrain = terrain;
    surface->finest = info->finest;
    surface->samples = terrain_samples(terrain, info->finest, &surface->stride);
    if (surface->samples)
        surface->extrema = *terrain_extrema(terrain);
    else {
        count_nodes(&surface->extrema, extent);
        surface->coarser = terrain_coarsest_page(terrain) - info->finest;
    }
    for (int k = 0; k < 2; k++) {
        surface->first[k] = k ? extent->y0 : extent->x0;
        surface->cells[k] = (k ? extent->y1 : extent->x1) - surface->first[k] - 1;
        surface->spacing_m[k] = level.spacing_m[k];
        for (int end = 0; end < 4; end += 2)
            surface->clip[end + k] = clip_cells(info->outline_m[end + k], level.spacing_m[k],
                                                surface->first[k], surface->cells[k]);
    }
    surface->quantum_m = info->quantum_m;
    surface->offset_m = info->offset_m;
    surface->min_q = level.min_q;
    surface->max_q = level.max_q;
    return surface;
}

void truth_surface_destroy(struct truth_surface *surface)
{
    if (!surface) return;
    truth_sphere_destroy(surface->sphere);
    free(surface);
}

// ---- a picture ----------------------------------------------------------------------------------

bool truth_init(struct truth *truth, int width, int height)
{
    *truth = (struct truth){.width = width, .height = height};
    truth->pixels = calloc((size_t)width * (size_t)height, sizeof *truth->pixels);
    truth->row_first = calloc((size_t)height + 1, sizeof *truth->row_first);
    if (truth->pixels && truth->row_first) return true;
    truth_finish(truth);
    return fail("--size %dx%d: no memory for a picture of this size", width, height);
}

void truth_finish(struct truth *truth)
{
    free(truth->pixels);
    free(truth->row_first);
    *truth = (struct truth){0};
}

struct casting {
    struct truth *truth;
    const struct truth_surface *surface;
    const struct view *view;
    const uint8_t *wanted; // NULL: all pixels
    bool marks;            // skylines of pixels that have been cast
    double origin[3];      // the eye, in cells and quanta
};

// What one thread holds while it casts.
struct hand {
    struct cells cells;        // on the plane
    struct truth_tiles *tiles; // on a sphere
};

static bool meets_plane(const struct casting *c, struct cells *cells, const double ray_m[3],
                        struct truth_pixel *pixel)
{
    const struct truth_surface *s = c->surface;
    const double ray[3] = {ray_m[0] / s->spacing_m[0], ray_m[1] / s->spacing_m[1], ray_m[2] / s->quantum_m};
    struct hit hit;
    if (!cast(s, cells, c->origin, ray, c->view->near_m, &hit)) return false;
    pixel->depth = hit.t;
    pixel->relative[0] = hit.t * ray_m[0];
    pixel->relative[1] = hit.t * ray_m[1];
    pixel->relative[2] = (hit.height_q - c->origin[2]) * s->quantum_m;
    for (int k = 0; k < 2; k++) pixel->slope[k] = (float)(hit.slope_q[k] * s->quantum_m / s->spacing_m[k]);
    return true;
}

// Slopes of the facet along the axes at the eye: where it stands upright there, as steep as a float can say.
static void set_slope(const double normal[3], const struct view *view, float slope[2])
{
    double local[3];
    for (int k = 0; k < 3; k++)
        local[k] = normal[0] * view->axes[k][0] + normal[1] * view->axes[k][1] + normal[2] * view->axes[k][2];
    double up = copysign(fmax(fabs(local[2]), 1e-9), local[2]);
    for (int k = 0; k < 2; k++) slope[k] = (float)(-local[k] / up);
}

static bool meets_sphere(const struct casting *c, struct truth_tiles *tiles, const double ray_m[3],
                         struct truth_pixel *pixel)
{
    double direction[3];
    struct truth_sphere_hit hit;
    view_world_direction(c->view, ray_m, direction);
    if (!truth_sphere_cast(c->surface->sphere, tiles, c->view->eye_m, direction, c->view->near_m, &hit))
        return false;
    pixel->depth = hit.t;
    for (int k = 0; k < 3; k++) pixel->relative[k] = hit.t * ray_m[k];
    set_slope(hit.normal, c->view, pixel->slope);
    return true;
}

// False, and nothing of the pixel is set: sky.
static bool meets(const struct casting *c, struct hand *hand, const double ray_m[3],
                  struct truth_pixel *pixel)
{
    return c->surface->sphere ? meets_sphere(c, hand->tiles, ray_m, pixel)
                              : meets_plane(c, &hand->cells, ray_m, pixel);
}

void truth_snap_ray(const struct view *view, int x, int y, int ray, double direction[3])
{
    static const double around[TRUTH_SNAP_RAYS][2] = {{1, 0},   {-1, 0},   {0, 1},    {0, -1},
                                                      {.7, .7}, {-.7, .7}, {.7, -.7}, {-.7, -.7}};
    view_ray(view, x, y, direction);
    for (int axis = 0; axis < 3; axis++)
        direction[axis] += TRUTH_SNAP_PX / view->pixels_per_tangent *
                           (around[ray][0] * view->right[axis] + around[ray][1] * view->up[axis]);
}

static bool borders_other(const struct truth *truth, int x, int y)
{
    bool ground = truth->pixels[(size_t)y * (size_t)truth->width + (size_t)x].depth > 0;
    for (int j = y > 0 ? y - 1 : y; j <= y + 1 && j < truth->height; j++)
        for (int i = x > 0 ? x - 1 : x; i <= x + 1 && i < truth->width; i++)
            if ((truth->pixels[(size_t)j * (size_t)truth->width + (size_t)i].depth > 0) != ground)
                return true;
    return false;
}

// Whether a ray next to the centre sees the other of ground and sky.
static bool sees_other(const struct casting *c, struct hand *hand, int x, int y, bool ground)
{
    for (int k = 0; k < TRUTH_SNAP_RAYS; k++) {
        double ray_m[3];
        struct truth_pixel seen;
        truth_snap_ray(c->view, x, y, k, ray_m);
        if (meets(c, hand, ray_m, &seen) != ground) return true;
    }
    return false;
}

static void cast_pixel(const struct casting *c, struct hand *hand, int x, int y, struct truth_pixel *pixel)
{
    double ray_m[3];
    if (c->marks) {
        if (borders_other(c->truth, x, y)) pixel->skyline = sees_other(c, hand, x, y, pixel->depth > 0);
        return;
    }
    view_ray(c->view, x, y, ray_m);
    *pixel = (struct truth_pixel){0};
    meets(c, hand, ray_m, pixel);
}

static void cast_rows(int block, void *user)
{
    const struct casting *c = user;
    struct truth *truth = c->truth;
    struct hand hand = {.cells = {.terrain = c->surface->terrain}};
    int end = (block + 1) * ROWS_A_BLOCK < truth->height ? (block + 1) * ROWS_A_BLOCK : truth->height;
    if (c->surface->sphere && !(hand.tiles = truth_tiles_take(c->surface->sphere))) return;
    for (int y = block * ROWS_A_BLOCK; y < end && !(truth->interrupted && *truth->interrupted); y++)
        for (int x = 0; x < truth->width; x++) {
            size_t pixel = (size_t)y * (size_t)truth->width + (size_t)x;
            if (!c->wanted || c->wanted[pixel]) cast_pixel(c, &hand, x, y, &truth->pixels[pixel]);
        }
    release_pages(&hand.cells);
    truth_tiles_give(c->surface->sphere, hand.tiles);
}

static void cast_blocks(struct truth *truth, const struct truth_surface *surface, const struct view *view,
                        const uint8_t *wanted, bool marks, int threads)
{
    struct casting casting = {truth, surface, view, wanted, marks, {0}};
    truth->radius_m = view->radius_m;
    if (!surface->sphere) { // the lattice gives the eye exactly, however far from the origin the map lies
        struct view_origin origin = view_level_origin(view, surface->finest);
        for (int k = 0; k < 2; k++)
            casting.origin[k] = (double)(origin.base[k] - surface->first[k]) + (double)origin.fraction[k];
        casting.origin[2] = ldexp((double)view->eye_height, -VIEW_HEIGHT_BITS);
    }
    parallel_blocks((truth->height + ROWS_A_BLOCK - 1) / ROWS_A_BLOCK, threads, cast_rows, &casting);
}

static void count_rows(struct truth *truth)
{
    truth->row_first[0] = 0;
    for (int y = 0; y < truth->height; y++) {
        const struct truth_pixel *row = truth->pixels + (size_t)y * (size_t)truth->width;
        truth->row_first[y + 1] = truth->row_first[y];
        for (int x = 0; x < truth->width; x++) truth->row_first[y + 1] += row[x].depth > 0;
    }
    truth->ground = truth->row_first[truth->height];
}

void truth_cast_some(struct truth *truth, const struct truth_surface *surface, const struct view *view,
                     const uint8_t *wanted, int threads)
{
    cast_blocks(truth, surface, view, wanted, false, threads);
}

void truth_mark_some(struct truth *truth, const struct truth_surface *surface, const struct view *view,
                     const uint8_t *wanted, int threads)
{
    cast_blocks(truth, surface, view, wanted, true, threads);
}

void truth_cast(struct truth *truth, const struct truth_surface *surface, const struct view *view,
                int threads)
{
    truth_cast_some(truth, surface, view, NULL, threads);
    truth_mark_some(truth, surface, view, NULL, threads);
    count_rows(truth);
}

// Slopes along the world's axes have no meaning on a sphere: 0.
static bool cast_sphere_ray(const struct truth_surface *surface, const double eye_m[3],
                            const double direction[3], double *t, float slope[2])
{
    struct truth_tiles *tiles = truth_tiles_take(surface->sphere);
    struct truth_sphere_hit hit;
    bool ground = tiles && truth_sphere_cast(surface->sphere, tiles, eye_m, direction, 0, &hit);
    truth_tiles_give(surface->sphere, tiles);
    if (!ground) return false;
    *t = hit.t;
    slope[0] = slope[1] = 0;
    return true;
}

bool truth_cast_ray(const struct truth_surface *surface, const double eye_m[3], const double direction[3],
                    double *t, float slope[2])
{
    const double unit_m[3] = {surface->spacing_m[0], surface->spacing_m[1], surface->quantum_m};
    double origin[3], ray[3];
    struct hit hit;
    if (surface->sphere) return cast_sphere_ray(surface, eye_m, direction, t, slope);
    for (int k = 0; k < 3; k++) {
        origin[k] = k < 2 ? eye_m[k] / unit_m[k] - (double)surface->first[k]
                          : (eye_m[2] - surface->offset_m) / unit_m[2];
        ray[k] = direction[k] / unit_m[k];
    }
    struct cells cells = {.terrain = surface->terrain};
    bool met = cast(surface, &cells, origin, ray, 0, &hit);
    release_pages(&cells);
    if (!met) return false;
    *t = hit.t;
    for (int k = 0; k < 2; k++) slope[k] = (float)(hit.slope_q[k] * surface->quantum_m / unit_m[k]);
    return true;
}
