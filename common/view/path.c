// SPDX-License-Identifier: MIT
#include "common/view/path.h"

#include "common/report.h"
#include "common/view/path_sphere.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

// A flight is a polyline of cameras, each at its distance from the start.  Keys become a fine polyline first,
// are lifted where the ground asks for it, and are measured last: so speed is even along what is really
// flown.
struct path {
    struct camera *cameras;
    double *at; // distance from the start
    int count, frames;
    struct path_sphere *sphere; // instead of the polyline
};

enum { AXES = 6, NODES_MIN = 2048, NODES_MAX = 1 << 18, LIFT_SHARE = 24 };

// ---- the spline ------------------------------------------------------------

struct knot {
    double value[AXES];   // x, y, z, yaw, pitch, roll
    double tangent[AXES]; // by the centripetal parameter
    double pace; // length of the segment that starts here, metres; one that only turns counts its angle
    double span; // its parameter interval: sqrt(pace)
    bool moves;
};

static double ground_at(const struct terrain *terrain, double x_m, double y_m)
{
    const struct terrain_info *info = terrain_info(terrain);
    const double *outline = info->outline_m;
    double q = info->max_q;
    terrain_truth_at(terrain, fmin(fmax(x_m, outline[0]), outline[2]),
                     fmin(fmax(y_m, outline[1]), outline[3]), &q, NULL);
    return q * info->quantum_m + info->offset_m;
}

static double nearest_turn(double from, double to)
{
    return from + remainder(to - from, 2 * M_PI);
}

static double distance(const double *a, const double *b, int axes)
{
    double sum = 0;
    for (int axis = 0; axis < axes; axis++) sum += (b[axis] - a[axis]) * (b[axis] - a[axis]);
    return sqrt(sum);
}

// Keys as knots: heights above the datum, angles along the shorter arc, keys that repeat the last one left
// out.
static int knots_from_keys(const struct terrain *terrain, const struct path_key *keys, int count,
                           struct knot *knots)
{
    int kept = 0;
    for (int i = 0; i < count; i++) {
        const struct path_key *key = &keys[i];
        double z = key->height_m + (key->above_ground ? ground_at(terrain, key->x_m, key->y_m) : 0);
        struct knot knot = {.value = {key->x_m, key->y_m, z, key->yaw, key->pitch, key->roll}};
        const double *last = kept ? knots[kept - 1].value : knot.value;
        knot.value[3] = nearest_turn(last[3], knot.value[3]);
        knot.value[5] = nearest_turn(last[5], knot.value[5]);
        if (kept && memcmp(last, knot.value, sizeof knot.value) == 0) continue;
        knots[kept++] = knot;
    }
    return kept;
}

static void measure_segments(struct knot *knots, int count)
{
    double total = 0;
    for (int i = 0; i + 1 < count; i++) total += distance(knots[i].value, knots[i + 1].value, 3);
    double turn_m = total > 0 ? total / (2 * M_PI) : 1; // a full turn on the spot lasts as long as the flight
    for (int i = 0; i + 1 < count; i++) {
        const double *a = knots[i].value, *b = knots[i + 1].value;
        double length = distance(a, b, 3);
        knots[i].moves = length > 1e-9 * total;
        knots[i].pace = knots[i].moves ? length : fmax(turn_m * distance(a + 3, b + 3, 3), 1e-9 * turn_m);
        knots[i].span = sqrt(knots[i].pace);
    }
}

// Catmull-Rom tangents for uneven intervals; at the ends those that leave no curvature.  A camera that turns
// on the spot stands still while it does.
static void set_tangents(struct knot *knots, int count)
{
    for (int axis = 0; axis < AXES; axis++) {
        for (int i = 1; i + 1 < count; i++) {
            double before = knots[i].value[axis] - knots[i - 1].value[axis], span0 = knots[i - 1].span;
            double after = knots[i + 1].value[axis] - knots[i].value[axis], span1 = knots[i].span;
            bool still = axis < 3 && !(knots[i - 1].moves && knots[i].moves);
            knots[i].tangent[axis] =
                still ? 0 : before / span0 + after / span1 - (before + after) / (span0 + span1);
        }
        struct knot *first = &knots[0], *last = &knots[count - 1];
        double start = (first[1].value[axis] - first->value[axis]) / first->span;
        double end = (last->value[axis] - last[-1].value[axis]) / last[-1].span;
        first->tangent[axis] = count > 2 ? 1.5 * start - 0.5 * first[1].tangent[axis] : start;
        last->tangent[axis] = count > 2 ? 1.5 * end - 0.5 * last[-1].tangent[axis] : end;
        if (axis < 3 && !first->moves) first->tangent[axis] = 0;
        if (axis < 3 && !last[-1].moves) last->tangent[axis] = 0;
    }
}

static struct camera spline_camera(const struct knot *knot, double u, double fov_vertical)
{
    double value[AXES], v = 1 - u;
    for (int axis = 0; axis < AXES; axis++) {
        double a = knot[0].value[axis], b = knot[1].value[axis];
        double bend = v * knot[0].tangent[axis] - u * knot[1].tangent[axis];
        value[axis] = v * v * (1 + 2 * u) * a + u * u * (1 + 2 * v) * b + u * v * knot->span * bend;
    }
    return (struct camera){{value[0], value[1], value[2]}, value[3], value[4], value[5], fov_vertical};
}

static struct path *path_allocate(int count, int frames)
{
    struct path *path = calloc(1, sizeof *path);
    if (!path) return fail("path: out of memory"), NULL;
    path->cameras = calloc((size_t)count, sizeof *path->cameras);
    path->at = calloc((size_t)count, sizeof *path->at);
    path->count = count;
    path->frames = frames < 1 ? 1 : frames;
    if (path->cameras && path->at) return path;
    path_destroy(path);
    return fail("path: out of memory"), NULL;
}

static int segment_steps(const struct knot *knot, double step)
{
    return (int)fmax(8, ceil(knot->pace / step));
}

// The fine polyline: steps of about half a cell of the finest level, so that its segments can be held against
// the ground cell by cell.
static struct path *path_from_knots(const struct knot *knots, int count, int frames, double cell_m,
                                    double fov)
{
    double total = 0, step;
    for (int i = 0; i + 1 < count; i++) total += knots[i].pace;
    double wanted = fmax(fmax(NODES_MIN, 8.0 * frames), 2 * total / cell_m);
    step = total / fmin(wanted, NODES_MAX);
    int nodes = 1;
    for (int i = 0; i + 1 < count; i++) nodes += segment_steps(&knots[i], step);
    struct path *path = path_allocate(nodes, frames);
    if (!path) return NULL;
    const double *v = knots[0].value;
    path->cameras[0] = (struct camera){{v[0], v[1], v[2]}, v[3], v[4], v[5], fov};
    int node = 1;
    for (int i = 0; i + 1 < count; i++) {
        int steps = segment_steps(&knots[i], step);
        for (int k = 1; k <= steps; k++, node++) {
            path->cameras[node] = spline_camera(&knots[i], (double)k / steps, fov);
            path->at[node] =
                knots[i].moves ? 0 : knots[i].pace / steps; // for the time being: pace of turning
        }
    }
    return path;
}

// ---- the ground ------------------------------------------------------------

// No lower than the ground anywhere under the segment: the bounds of the cells it may touch.
static double segment_ground(const struct terrain *terrain, const double a[3], const double b[3])
{
    const struct terrain_info *info = terrain_info(terrain);
    int64_t low[2], high[2];
    int32_t min_q, max_q;
    for (int axis = 0; axis < 2; axis++) {
        const double *outline = info->outline_m;
        double cell = ldexp(info->spacing_m[axis], info->finest), from = fmin(a[axis], b[axis]);
        double to = fmax(a[axis], b[axis]);
        low[axis] = (int64_t)floor(fmin(fmax(from, outline[axis]), outline[axis + 2]) / cell);
        high[axis] = (int64_t)ceil(fmin(fmax(to, outline[axis]), outline[axis + 2]) / cell);
    }
    terrain_bounds(terrain, info->finest, low[0], low[1], high[0], high[1], &min_q, &max_q);
    return max_q * info->quantum_m + info->offset_m;
}

// Largest value within `reach` places of each place.
static void spread_maximum(const double *in, double *out, int *queue, int count, int reach)
{
    int head = 0, tail = 0, next = 0;
    for (int i = 0; i < count; i++) {
        for (; next < count && next <= i + reach; next++) {
            while (tail > head && in[queue[tail - 1]] <= in[next]) tail--;
            queue[tail++] = next;
        }
        while (queue[head] < i - reach) head++;
        out[i] = in[queue[head]];
    }
}

// Mean over `reach` places to either side; the ends repeat.
static void blur(const double *in, double *out, int count, int reach)
{
    double sum = 0;
    for (int i = -reach; i <= reach; i++) sum += in[i < 0 ? 0 : i >= count ? count - 1 : i];
    for (int i = 0; i < count; i++) {
        out[i] = sum / (2 * reach + 1);
        int enters = i + reach + 1, leaves = i - reach;
        sum += in[enters >= count ? count - 1 : enters] - in[leaves < 0 ? 0 : leaves];
    }
}

// Raises the flight to `clearance_m` over the ground.  What is missing is spread as far as the three means
// after it reach, so the smoothed rise is nowhere less than what is missing.
static bool lift(struct path *path, const struct terrain *terrain, double clearance_m)
{
    int count = path->count, reach = count / LIFT_SHARE / 3;
    double *least = calloc((size_t)count * 3, sizeof *least);
    int *queue = calloc((size_t)count, sizeof *queue);
    if (!least || !queue) {
        free(least), free(queue);
        return fail("path: out of memory");
    }
    double *rise = least + count, *spare = rise + count;
    least[0] = ground_at(terrain, path->cameras[0].eye_m[0], path->cameras[0].eye_m[1]) + clearance_m;
    for (int i = 1; i < count; i++) {
        double ground =
            segment_ground(terrain, path->cameras[i - 1].eye_m, path->cameras[i].eye_m) + clearance_m;
        least[i - 1] = fmax(least[i - 1], ground);
        least[i] = ground;
    }
    for (int i = 0; i < count; i++) spare[i] = fmax(0, least[i] - path->cameras[i].eye_m[2]);
    spread_maximum(spare, rise, queue, count, 3 * reach);
    blur(rise, spare, count, reach);
    blur(spare, rise, count, reach);
    blur(rise, spare, count, reach);
    for (int i = 0; i < count; i++)
        path->cameras[i].eye_m[2] = fmax(path->cameras[i].eye_m[2] + spare[i], least[i]);
    free(least), free(queue);
    return true;
}

static void measure(struct path *path)
{
    for (int i = 1; i < path->count; i++) {
        double moved = distance(path->cameras[i - 1].eye_m, path->cameras[i].eye_m, 3);
        path->at[i] = path->at[i - 1] + (path->at[i] > 0 ? path->at[i] : moved);
    }
}

// ---- the contract ----------------------------------------------------------

static struct path *path_over_sphere(const struct terrain *terrain, const struct path_key *keys, int count,
                                     int frames, double clearance_m, double fov_vertical)
{
    struct path *path = path_allocate(1, frames);
    if (!path) return NULL;
    path->sphere = path_sphere_from_keys(terrain, keys, count, clearance_m, fov_vertical);
    if (path->sphere) return path;
    path_destroy(path);
    return NULL;
}

struct path *path_from_keys(const struct terrain *terrain, const struct path_key *keys, int count, int frames,
                            double clearance_m, double fov_vertical)
{
    if (count < 1) return fail("path: no key frames; at least one is needed"), NULL;
    if (terrain_info(terrain)->datum == TERRAIN_SPHERE)
        return path_over_sphere(terrain, keys, count, frames, clearance_m, fov_vertical);
    struct knot *knots = calloc((size_t)count, sizeof *knots);
    if (!knots) return fail("path: out of memory"), NULL;
    count = knots_from_keys(terrain, keys, count, knots);
    if (count > 1) {
        measure_segments(knots, count);
        set_tangents(knots, count);
    }
    const struct terrain_info *info = terrain_info(terrain);
    double cell_m = ldexp(fmin(info->spacing_m[0], info->spacing_m[1]), info->finest);
    struct path *path = path_from_knots(knots, count, frames, cell_m, fov_vertical);
    free(knots);
    if (path && !lift(path, terrain, clearance_m)) {
        path_destroy(path);
        return NULL;
    }
    if (path) measure(path);
    return path;
}

struct path *path_from_cameras(const struct camera *cameras, int count)
{
    if (count < 1) return fail("path: no cameras; at least one is needed"), NULL;
    struct path *path = path_allocate(count, count);
    if (!path) return NULL;
    memcpy(path->cameras, cameras, (size_t)count * sizeof *cameras);
    for (int i = 1; i < count; i++) {
        struct camera *camera = &path->cameras[i];
        camera->yaw = nearest_turn(camera[-1].yaw, camera->yaw);
        camera->roll = nearest_turn(camera[-1].roll, camera->roll);
        path->at[i] = i;
    }
    return path;
}

void path_destroy(struct path *path)
{
    if (!path) return;
    path_sphere_destroy(path->sphere);
    free(path->cameras);
    free(path->at);
    free(path);
}

int path_frames(const struct path *path)
{
    return path->frames;
}

static double mix(double a, double b, double t)
{
    return a * (1 - t) + b * t;
}

struct camera path_camera(const struct path *path, int frame, int frames)
{
    int last = path->count - 1, low = 0, high = last;
    if (path->sphere) return path_sphere_camera(path->sphere, frame, frames);
    if (frames < 2 || frame <= 0 || last == 0) return path->cameras[0];
    if (frame >= frames - 1) return path->cameras[last];
    double at = path->at[last] * frame / (frames - 1);
    while (high - low > 1) {
        int middle = low + (high - low) / 2;
        *(path->at[middle] <= at ? &low : &high) = middle;
    }
    struct camera a = path->cameras[low], b = path->cameras[high];
    double length = path->at[high] - path->at[low], t = length > 0 ? (at - path->at[low]) / length : 0;
    for (int axis = 0; axis < 3; axis++) a.eye_m[axis] = mix(a.eye_m[axis], b.eye_m[axis], t);
    a.yaw = mix(a.yaw, b.yaw, t);
    a.pitch = mix(a.pitch, b.pitch, t);
    a.roll = mix(a.roll, b.roll, t);
    a.fov_vertical = mix(a.fov_vertical, b.fov_vertical, t);
    return a;
}
