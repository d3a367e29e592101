// SPDX-License-Identifier: MIT
#include "geomipmap/geomipmap_lod.h"

#include "common/report.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

// Sums of four products of doubles that are exact to 2^-53 each lie within range * 2^-48 of the true
// distance; the guard is wider than that, and 0 for a flat tile.
static const double ROUNDING = 0x1p-44;

// ---- which triangles can be drawn ---------------------------------------------------------------

// A triangle as one number, the same whichever vertex comes first, so that a sort finds those drawn twice.
static uint64_t pack_triangle(const uint16_t v[3])
{
    int first = v[0] < v[1] ? (v[0] < v[2] ? 0 : 2) : (v[1] < v[2] ? 1 : 2);
    return (uint64_t)v[first] << 32 | (uint64_t)v[(first + 1) % 3] << 16 | v[(first + 2) % 3];
}

static uint64_t pack_edge(uint16_t a, uint16_t b)
{
    return a < b ? (uint64_t)a << 16 | b : (uint64_t)b << 16 | a;
}

static int compare_keys(const void *a, const void *b)
{
    uint64_t x = *(const uint64_t *)a, y = *(const uint64_t *)b;
    return (x > y) - (x < y);
}

static size_t sort_unique(uint64_t *keys, size_t count)
{
    size_t kept = 0;
    qsort(keys, count, sizeof *keys, compare_keys);
    for (size_t i = 0; i < count; i++)
        if (kept == 0 || keys[i] != keys[kept - 1]) keys[kept++] = keys[i];
    return kept;
}

// Removes from sorted `keys` those that stand in sorted `others`.
static size_t subtract(uint64_t *keys, size_t count, const uint64_t *others, size_t other_count)
{
    size_t kept = 0, j = 0;
    for (size_t i = 0; i < count; i++) {
        while (j < other_count && others[j] < keys[i]) j++;
        if (j == other_count || others[j] != keys[i]) keys[kept++] = keys[i];
    }
    return kept;
}

// ---- the plan -----------------------------------------------------------------------------------

static void add_configuration(struct geomipmap_drawn *drawn, const struct geomipmap_plan *plan, int level,
                              const int neighbours[GEOMIPMAP_SIDES], uint16_t *scratch)
{
    int count = geomipmap_mesh_write(plan->bits, level, neighbours, scratch);
    int vertices = (1 << plan->bits) + 1, samples = (1 << (plan->bits + plan->height)) + 1;
    for (int i = 0; i < count; i++) // from the tile's vertices to samples of the finest level
        scratch[i] = (uint16_t)((scratch[i] / vertices << plan->height) * samples +
                                (scratch[i] % vertices << plan->height));
    for (int i = 0; i < count; i += 3) {
        const uint16_t *v = scratch + i;
        drawn->triangles[drawn->triangle_count++] = pack_triangle(v);
        for (int k = 0; k < 3; k++) drawn->edges[drawn->edge_count++] = pack_edge(v[k], v[(k + 1) % 3]);
    }
    drawn->triangle_count = sort_unique(drawn->triangles, drawn->triangle_count);
    drawn->edge_count = sort_unique(drawn->edges, drawn->edge_count);
}

static bool drawn_init(struct geomipmap_drawn *drawn, size_t room)
{
    *drawn = (struct geomipmap_drawn){malloc(room * sizeof(uint64_t)), malloc(room * sizeof(uint64_t)), 0, 0};
    return drawn->triangles && drawn->edges;
}

static void drawn_finish(struct geomipmap_drawn *drawn)
{
    free(drawn->triangles);
    free(drawn->edges);
    *drawn = (struct geomipmap_drawn){0};
}

static bool drawn_copy(struct geomipmap_drawn *copy, const struct geomipmap_drawn *drawn)
{
    if (!drawn_init(copy, drawn->triangle_count + drawn->edge_count + 1)) return false;
    copy->triangle_count = drawn->triangle_count;
    copy->edge_count = drawn->edge_count;
    memcpy(copy->triangles, drawn->triangles, drawn->triangle_count * sizeof *copy->triangles);
    memcpy(copy->edges, drawn->edges, drawn->edge_count * sizeof *copy->edges);
    return true;
}

// Only cells at the south-east and north-west corners have a triangle on two sides; all pairs of (south,
// east) and (west, north) therefore draw every triangle that any combination draws.
static bool plan_level(struct geomipmap_plan *plan, int level, struct geomipmap_drawn *plain,
                       struct geomipmap_drawn *all, uint16_t *scratch)
{
    int same[GEOMIPMAP_SIDES] = {level, level, level, level};
    plain->triangle_count = plain->edge_count = all->triangle_count = all->edge_count = 0;
    if (level == 0 && plan->height == 0) return true; // every sample: exact
    add_configuration(plain, plan, level, same, scratch);
    for (int i = 0; i <= level; i++)
        for (int j = 0; j <= level; j++) add_configuration(all, plan, level, (int[4]){i, j, j, i}, scratch);
    all->triangle_count =
        subtract(all->triangles, all->triangle_count, plain->triangles, plain->triangle_count);
    all->edge_count = subtract(all->edges, all->edge_count, plain->edges, plain->edge_count);
    return drawn_copy(&plan->plain[level], plain) && drawn_copy(&plan->border[level], all);
}

bool geomipmap_plan_init(struct geomipmap_plan *plan, int bits, int height)
{
    *plan = (struct geomipmap_plan){.bits = bits, .height = height};
    size_t bound = geomipmap_mesh_bound(bits); // indices of one configuration
    // Besides one whole configuration, unique triangles are those of the border strips: fewer than a
    // configuration for each of the levels squared, and that many again while one is being added.
    struct geomipmap_drawn plain, all;
    bool good = drawn_init(&plain, bound);
    good = drawn_init(&all, bound * (2 + (size_t)bits * (size_t)bits)) && good;
    uint16_t *scratch = malloc(bound * sizeof *scratch);
    good = good && scratch;
    for (int level = 0; level < bits && good; level++) good = plan_level(plan, level, &plain, &all, scratch);
    drawn_finish(&plain);
    drawn_finish(&all);
    free(scratch);
    if (good) return true;
    geomipmap_plan_finish(plan);
    return fail("geomipmap: no memory to list the triangles of a tile");
}

void geomipmap_plan_finish(struct geomipmap_plan *plan)
{
    for (int level = 0; level < GEOMIPMAP_MAX_LEVELS; level++) {
        drawn_finish(&plan->plain[level]);
        drawn_finish(&plan->border[level]);
    }
    *plan = (struct geomipmap_plan){0};
}

size_t geomipmap_plan_bytes(const struct geomipmap_plan *plan)
{
    size_t count = 0;
    for (int level = 0; level < plan->bits; level++)
        count += plan->plain[level].triangle_count + plan->plain[level].edge_count +
                 plan->border[level].triangle_count + plan->border[level].edge_count;
    return 2 * count * sizeof(uint64_t);
}

// ---- probes -------------------------------------------------------------------------------------

// Distance between the two surfaces at one point: |sum of weight x height|.  Weights of the finest surface
// are not negative, those of the drawn one are.
struct probe {
    uint16_t vertex[4];
    double weight[4];
};

enum { BATCH = 128 };

struct batch { // probes on their way, and what they found
    const struct geomipmap_heights *heights;
    int row; // samples of the finest level in a row
    int count;
    struct probe probes[BATCH];
    double largest[GEOMIPMAP_LANES];
};

static void measure_fixed(struct batch *b)
{
    const double *heights = b->heights->finest;
    for (const struct probe *probe = b->probes; probe < b->probes + b->count; probe++) {
        const double *z0 = heights + probe->vertex[0] * GEOMIPMAP_LANES, w0 = probe->weight[0];
        const double *z1 = heights + probe->vertex[1] * GEOMIPMAP_LANES, w1 = probe->weight[1];
        const double *z2 = heights + probe->vertex[2] * GEOMIPMAP_LANES, w2 = probe->weight[2];
        const double *z3 = heights + probe->vertex[3] * GEOMIPMAP_LANES, w3 = probe->weight[3];
        for (int lane = 0; lane < GEOMIPMAP_LANES; lane++) {
            double distance = fabs((z0[lane] * w0 + z1[lane] * w1) + (z2[lane] * w2 + z3[lane] * w3));
            b->largest[lane] = distance > b->largest[lane] ? distance : b->largest[lane];
        }
    }
}

// The same over all places of the vertices.
static void measure_places(struct batch *b)
{
    const struct geomipmap_heights *heights = b->heights;
    for (const struct probe *probe = b->probes; probe < b->probes + b->count; probe++) {
        double above[GEOMIPMAP_LANES] = {0},
               below[GEOMIPMAP_LANES] = {0}; // the finest surface over the drawn
        for (int n = 0; n < 4; n++) {
            size_t at = (size_t)probe->vertex[n] * GEOMIPMAP_LANES;
            bool finest = probe->weight[n] >= 0;
            const double *low = (finest ? heights->finest : heights->low) + at;
            const double *high = (finest ? heights->finest : heights->high) + at;
            for (int lane = 0; lane < GEOMIPMAP_LANES; lane++) {
                above[lane] += probe->weight[n] * low[lane];
                below[lane] -= probe->weight[n] * high[lane];
            }
        }
        for (int lane = 0; lane < GEOMIPMAP_LANES; lane++) {
            double distance = above[lane] > below[lane] ? above[lane] : below[lane];
            b->largest[lane] = distance > b->largest[lane] ? distance : b->largest[lane];
        }
    }
}

static void flush(struct batch *b)
{
    if (b->heights->drawn)
        measure_places(b);
    else
        measure_fixed(b);
    b->count = 0;
}

static void add_probe(struct batch *b, const int vertex[4], const double weight[4])
{
    struct probe *probe = &b->probes[b->count++];
    for (int k = 0; k < 4; k++) {
        probe->vertex[k] = (uint16_t)vertex[k];
        probe->weight[k] = weight[k];
    }
    if (b->count == BATCH) flush(b);
}

// Vertices of the finest level strictly inside a triangle: there the finest surface is that vertex.
static void probe_inside(struct batch *b, uint64_t triangle)
{
    int v[3] = {(int)(triangle >> 32), (int)(triangle >> 16 & 0xffff), (int)(triangle & 0xffff)};
    int x[3], y[3], low_x = INT32_MAX, low_y = INT32_MAX, high_x = 0, high_y = 0;
    for (int k = 0; k < 3; k++) {
        x[k] = v[k] % b->row, y[k] = v[k] / b->row;
        low_x = x[k] < low_x ? x[k] : low_x, high_x = x[k] > high_x ? x[k] : high_x;
        low_y = y[k] < low_y ? y[k] : low_y, high_y = y[k] > high_y ? y[k] : high_y;
    }
    int area = (x[1] - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (y[1] - y[0]);
    for (int j = low_y; j <= high_y; j++)
        for (int i = low_x; i <= high_x; i++) {
            int part1 = (i - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (j - y[0]);
            int part2 = (x[1] - x[0]) * (j - y[0]) - (i - x[0]) * (y[1] - y[0]);
            int part0 = area - part1 - part2;
            if (part0 <= 0 || part1 <= 0 || part2 <= 0) continue;
            add_probe(b, (int[4]){j * b->row + i, v[0], v[1], v[2]},
                      (double[4]){1.0, -(double)part0 / area, -(double)part1 / area, -(double)part2 / area});
        }
}

// One crossing at k / m of the way along the edge p-q, on a grid line where the finest surface has an edge.
// (fx, fy): the crossing times m; (ux, uy): direction of the fine edge that it lies on.
static void probe_crossing(struct batch *b, int p, int q, int k, int m, int fx, int fy, int ux, int uy)
{
    int x = fx / m, y = fy / m, part = ux ? fx % m : fy % m;
    int here = y * b->row + x, next = part ? (y + uy) * b->row + x + ux : here;
    add_probe(b, (int[4]){here, next, p, q},
              (double[4]){(double)(m - part) / m, (double)part / m, -(double)(m - k) / m, -(double)k / m});
}

// Points of an edge where it meets the edges of the finest surface: those run along x, along y and along
// the diagonal.
static void probe_edge(struct batch *b, uint64_t edge)
{
    int p = (int)(edge >> 16), q = (int)(edge & 0xffff);
    int px = p % b->row, py = p / b->row, dx = q % b->row - px, dy = q / b->row - py;
    int across = abs(dx), up = abs(dy), diagonal = abs(dx - dy);
    for (int k = 1; k < across; k++)
        probe_crossing(b, p, q, k, across, px * across + k * dx, py * across + k * dy, 0, 1);
    // A vertex of the finest level lies on all three kinds of line; one of them suffices.
    for (int k = 1; k < up; k++)
        if (across == 0 || k * across % up != 0)
            probe_crossing(b, p, q, k, up, px * up + k * dx, py * up + k * dy, 1, 0);
    for (int k = 1; k < diagonal; k++)
        if (k * across % diagonal != 0 && k * up % diagonal != 0)
            probe_crossing(b, p, q, k, diagonal, px * diagonal + k * dx, py * diagonal + k * dy, 1, 1);
}

static void probe_drawn(struct batch *b, const struct geomipmap_drawn *drawn)
{
    for (size_t i = 0; i < drawn->triangle_count; i++) probe_inside(b, drawn->triangles[i]);
    for (size_t i = 0; i < drawn->edge_count; i++) probe_edge(b, drawn->edges[i]);
    flush(b);
}

size_t geomipmap_level_first(int bits, int level)
{
    size_t first = 0;
    for (int l = 0; l < level; l++) {
        size_t row = ((size_t)1 << (bits - l)) + 1;
        first += row * row;
    }
    return first;
}

// ---- vertices off their samples -----------------------------------------------------------------

// Makes low .. high cover z_low .. z_high.
static void widen(const double *z_low, const double *z_high, double *low, double *high)
{
    for (int lane = 0; lane < GEOMIPMAP_LANES; lane++) {
        low[lane] = z_low[lane] < low[lane] ? z_low[lane] : low[lane];
        high[lane] = z_high[lane] > high[lane] ? z_high[lane] : high[lane];
    }
}

// Lowest and highest place of one vertex of a level, numbered (a, b) in the tile.  borders: finer levels,
// too.
static void bound_vertex(const struct geomipmap_plan *plan, const struct geomipmap_heights *heights, int a,
                         int b, bool borders, int level, double largest[GEOMIPMAP_LANES])
{
    size_t row = ((size_t)1 << (plan->bits + plan->height)) + 1;
    size_t at = (((size_t)b << plan->height) * row + ((size_t)a << plan->height)) * GEOMIPMAP_LANES;
    double *low = heights->low + at, *high = heights->high + at;
    for (int lane = 0; lane < GEOMIPMAP_LANES; lane++) low[lane] = INFINITY, high[lane] = -INFINITY;
    for (int l = borders ? 0 : level; l <= level && ((a | b) & ((1 << l) - 1)) == 0; l++) {
        size_t across = ((size_t)1 << (plan->bits - l)) + 1;
        size_t vertex = geomipmap_level_first(plan->bits, l) + (size_t)(b >> l) * across + (size_t)(a >> l);
        const double *z = heights->drawn + vertex * GEOMIPMAP_LANES;
        widen(z, z, low, high);
    }
    int last = (1 << plan->bits) - 1;
    if (borders && (a & last) == 0 && (b & last) == 0) {
        size_t corner = (size_t)((a > 0) + 2 * (b > 0)) * GEOMIPMAP_LANES;
        widen(heights->corner_low + corner, heights->corner_high + corner, low, high);
    }
    for (int lane = 0; lane < GEOMIPMAP_LANES; lane++) {
        double z = heights->finest[at + (size_t)lane], below = z - low[lane], above = high[lane] - z;
        double distance = below > above ? below : above; // NAN is larger than nothing
        largest[lane] = distance > largest[lane] ? distance : largest[lane];
    }
}

static void bound_vertices(const struct geomipmap_plan *plan, const struct geomipmap_heights *heights,
                           int level, bool borders, double largest[GEOMIPMAP_LANES])
{
    int last = 1 << plan->bits, step = 1 << level;
    for (int b = 0; b <= last; b++)
        for (int a = 0; a <= last; a++) {
            bool border = a == 0 || b == 0 || a == last || b == last;
            if (borders && border)
                bound_vertex(plan, heights, a, b, true, level, largest);
            else if (((a | b) & (step - 1)) == 0)
                bound_vertex(plan, heights, a, b, false, level, largest);
        }
}

// ---- mean distance ------------------------------------------------------------------------------

struct drawn { // every 2^shift-th sample of a tile, `row` in a row
    const double *heights;
    int row, shift;
};

// Mean distance of both surfaces over the samples of each tile, where every 2^shift-th sample is drawn.
static void mean_distance(const struct geomipmap_plan *plan, int shift, const double *finest,
                          struct drawn drawn, double mean[GEOMIPMAP_LANES])
{
    int side = 1 << (plan->bits + plan->height), step = 1 << shift;
    double sum[GEOMIPMAP_LANES] = {0};
    int next = (step >> drawn.shift) * GEOMIPMAP_LANES, up = next * drawn.row;
    for (int j = 0; j < side; j++)
        for (int i = 0; i < side; i++) {
            int u = i & (step - 1), v = j & (step - 1), least = u < v ? u : v;
            const double *h = finest + (j * (side + 1) + i) * GEOMIPMAP_LANES;
            const double *sw =
                drawn.heights +
                (((j - v) >> drawn.shift) * drawn.row + ((i - u) >> drawn.shift)) * GEOMIPMAP_LANES;
            const double *ne = sw + next + up, *third = sw + (u > v ? next : up);
            double w_ne = (double)least / step, w_third = (double)abs(u - v) / step,
                   w_sw = 1 - w_ne - w_third;
            for (int lane = 0; lane < GEOMIPMAP_LANES; lane++) {
                double d = fabs(w_sw * sw[lane] + w_ne * ne[lane] + w_third * third[lane] - h[lane]);
                sum[lane] += d == d ? d : 0; // outside the map
            }
        }
    for (int lane = 0; lane < GEOMIPMAP_LANES; lane++) mean[lane] = sum[lane] / ((double)side * side);
}

static void measure_savings(const struct geomipmap_plan *plan, const struct geomipmap_heights *heights,
                            float saving[GEOMIPMAP_LANES][GEOMIPMAP_MAX_LEVELS])
{
    double finer[GEOMIPMAP_LANES] = {0}, mean[GEOMIPMAP_LANES];
    struct drawn drawn = {heights->finest, (1 << (plan->bits + plan->height)) + 1, 0};
    if (plan->height > 0 && !heights->drawn)
        mean_distance(plan, plan->height - 1, heights->finest, drawn, finer);
    for (int level = 0; level < plan->bits; level++) {
        int shift = plan->height + level;
        if (heights->drawn)
            drawn =
                (struct drawn){heights->drawn + geomipmap_level_first(plan->bits, level) * GEOMIPMAP_LANES,
                               (1 << (plan->bits - level)) + 1, shift};
        mean_distance(plan, shift, heights->finest, drawn, mean);
        for (int lane = 0; lane < GEOMIPMAP_LANES; lane++) {
            saving[lane][level] = (float)ldexp(mean[lane] - finer[lane], 2 * shift);
            finer[lane] = mean[lane];
        }
    }
}

// ---- errors of all levels -----------------------------------------------------------------------

// The least float that is not below a non-negative number.
static float round_up(double value)
{
    float rounded = (float)value;
    return (double)rounded < value ? nextafterf(rounded, FLT_MAX) : rounded;
}

void geomipmap_plan_measure(const struct geomipmap_plan *plan, enum geomipmap_delta delta,
                            const struct geomipmap_heights *heights, const double range[GEOMIPMAP_LANES],
                            float error[GEOMIPMAP_LANES][GEOMIPMAP_MAX_LEVELS])
{
    if (delta == GEOMIPMAP_SAVING) {
        measure_savings(plan, heights, error);
        return;
    }
    bool borders = delta == GEOMIPMAP_STABLE;
    struct batch batch = {.heights = heights, .row = (1 << (plan->bits + plan->height)) + 1};
    for (int level = 0; level < plan->bits; level++) {
        bool exact = level == 0 && plan->height == 0;
        memset(batch.largest, 0, sizeof batch.largest);
        if (heights->drawn && !exact) bound_vertices(plan, heights, level, borders, batch.largest);
        probe_drawn(&batch, &plan->plain[level]);
        if (borders) probe_drawn(&batch, &plan->border[level]);
        for (int lane = 0; lane < GEOMIPMAP_LANES; lane++)
            error[lane][level] = exact ? 0.0f : round_up(batch.largest[lane] + range[lane] * ROUNDING);
    }
}

// ---- what is allowed ----------------------------------------------------------------------------

// A vertical segment of length d from p to q shows as exactly  K d |v_xy - t v_w| / w_q  pixels, where v is
// the unit vertical in the camera's axes and t the tangents of p (numerics.md, C1 bounds the same by sqrt(1
// + T^2)).  If p is the end that is seen, t lies in the window, over which the factor is largest at a
// corner, and w_q >= w_p - d |v_w|.
void geomipmap_judge_init(struct geomipmap_judge *judge, enum geomipmap_metric metric, double tau_px,
                          const struct view *view, double spacing_m)
{
    double vertical[3] = {view->right[2], view->up[2], view->forward[2]}, most = 0;
    for (int corner = 0; corner < 4; corner++) {
        double tx = corner & 1 ? view->tan_half[0] : -view->tan_half[0];
        double ty = corner & 2 ? view->tan_half[1] : -view->tan_half[1];
        most = fmax(most, hypot(vertical[0] - tx * vertical[2], vertical[1] - ty * vertical[2]));
    }
    bool safe = metric == GEOMIPMAP_SAFE;
    *judge = (struct geomipmap_judge){
        .metric = metric,
        .tau_px = tau_px,
        .pixels_per_tangent = view->pixels_per_tangent,
        .spacing_m = spacing_m,
        .near_m = view->near_m,
        .vertical_px = view->pixels_per_tangent * (safe ? most : 1),
        .vertical_sink = safe ? fabs(vertical[2]) : 0,
    };
}

double geomipmap_allowed(const struct geomipmap_judge *judge, double depth_m, double distance_m)
{
    if (judge->metric == GEOMIPMAP_MEAN) {
        double metres_px = depth_m / judge->pixels_per_tangent, samples_px = metres_px / judge->spacing_m;
        return pow(judge->tau_px, 3) * metres_px * pow(samples_px, 2.5);
    }
    if (judge->metric == GEOMIPMAP_PAPER) return judge->tau_px * distance_m / judge->pixels_per_tangent;
    // Solved for d:  vertical_px d <= tau max(near, depth - sink d); what is nearer than near is clipped to
    // it.
    double near = judge->tau_px * judge->near_m / judge->vertical_px;
    double deep = judge->tau_px * depth_m / (judge->vertical_px + judge->tau_px * judge->vertical_sink);
    return deep > near ? deep : near;
}

int geomipmap_choose(const float *error, int levels, double allowed, int kept, double coarser)
{
    for (int level = levels - 1; level > 0; level--)
        if ((double)error[level] <= (level > kept ? coarser : allowed)) return level;
    return 0;
}
