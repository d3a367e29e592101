// SPDX-License-Identifier: MIT
#include "common/view/path_sphere.h"

#include "common/report.h"
#include "common/terrain/sphere.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

// Components of a key: the direction, log height over ground, and the quaternion (w, x, y, z).
enum { DIRECTION = 0, HEIGHT = 3, TURN = 4, COMPONENTS = 8, NODES_A_SEGMENT = 1024 };
static const int GROUPS[4] = {DIRECTION, HEIGHT, TURN, COMPONENTS};

struct knot {
    double value[COMPONENTS], tangent[COMPONENTS]; // tangents by the parameter, which runs `span` a segment
    double span;
    double swell; // of the log height on the segment that starts here
};

struct node { // of the fine polyline that even steps are measured on
    double place[3], at;
};

struct path_sphere {
    const struct terrain *terrain; // borrowed
    double radius_m, fov_vertical, clearance_m;
    struct knot *knots;
    struct node *nodes; // NODES_A_SEGMENT a segment, and the last
    int count;          // of knots
};

// ---- the ground ------------------------------------------------------------

static double level_height(const struct terrain *terrain, int level, const double place[2])
{
    struct terrain_level l = terrain_level(terrain, level);
    const struct terrain_info *info = terrain_info(terrain);
    double x = place[0] / l.spacing_m[0], y = place[1] / l.spacing_m[1], u = x - floor(x), v = y - floor(y);
    int32_t z[4];
    terrain_window(terrain, level, (int64_t)floor(x), (int64_t)floor(y), 2, 2, z, TERRAIN_WAIT);
    double q =
        u >= v ? z[0] + u * (z[1] - z[0]) + v * (z[3] - z[1]) : z[0] + u * (z[3] - z[2]) + v * (z[2] - z[0]);
    return q * info->quantum_m + info->offset_m;
}

// Height of the ground as it is seen from `above_m`: between the two levels whose spacings enclose that.
static double ground_seen(const struct terrain *terrain, const double place[2], double above_m)
{
    const struct terrain_info *info = terrain_info(terrain);
    double level = log2(fmax(above_m, 1e-3) / info->spacing_m[1]);
    level = fmin(fmax(level, info->finest), info->coarsest);
    int fine = (int)floor(level) < info->coarsest ? (int)floor(level) : info->coarsest;
    double t = level - fine, low = level_height(terrain, fine, place);
    return t > 0 ? low + t * (level_height(terrain, fine + 1, place) - low) : low;
}

static double ground_at(const struct terrain *terrain, const double place[2])
{
    const struct terrain_info *info = terrain_info(terrain);
    double q = info->max_q;
    terrain_truth_at(terrain, place[0], place[1], &q, NULL);
    return q * info->quantum_m + info->offset_m;
}

// ---- orientation -----------------------------------------------------------

// Columns: the camera's right, up and forward in the world.
static void quaternion_from_axes(const double right[3], const double up[3], const double forward[3],
                                 double q[4])
{
    // Camera axes x = right, y = up, z = -forward.
    double m[3][3];
    for (int k = 0; k < 3; k++) m[k][0] = right[k], m[k][1] = up[k], m[k][2] = -forward[k];
    double w = 1 + m[0][0] + m[1][1] + m[2][2], x = 1 + m[0][0] - m[1][1] - m[2][2];
    double y = 1 - m[0][0] + m[1][1] - m[2][2], z = 1 - m[0][0] - m[1][1] + m[2][2];
    if (w >= x && w >= y && w >= z)
        q[0] = w, q[1] = m[2][1] - m[1][2], q[2] = m[0][2] - m[2][0], q[3] = m[1][0] - m[0][1];
    else if (x >= y && x >= z)
        q[0] = m[2][1] - m[1][2], q[1] = x, q[2] = m[1][0] + m[0][1], q[3] = m[0][2] + m[2][0];
    else if (y >= z)
        q[0] = m[0][2] - m[2][0], q[1] = m[1][0] + m[0][1], q[2] = y, q[3] = m[2][1] + m[1][2];
    else
        q[0] = m[1][0] - m[0][1], q[1] = m[0][2] + m[2][0], q[2] = m[2][1] + m[1][2], q[3] = z;
    double length = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    for (int k = 0; k < 4; k++) q[k] /= length;
}

static void rotate(const double q[4], const double v[3], double out[3])
{
    const double *u = q + 1;
    double t[3] = {2 * (u[1] * v[2] - u[2] * v[1]), 2 * (u[2] * v[0] - u[0] * v[2]),
                   2 * (u[0] * v[1] - u[1] * v[0])};
    out[0] = v[0] + q[0] * t[0] + (u[1] * t[2] - u[2] * t[1]);
    out[1] = v[1] + q[0] * t[1] + (u[2] * t[0] - u[0] * t[2]);
    out[2] = v[2] + q[0] * t[2] + (u[0] * t[1] - u[1] * t[0]);
}

static void to_world(double axes[3][3], const double local[3], double world[3])
{
    for (int k = 0; k < 3; k++)
        world[k] = local[0] * axes[0][k] + local[1] * axes[1][k] + local[2] * axes[2][k];
}

static double dot(const double *a, const double *b, int count)
{
    double sum = 0;
    for (int k = 0; k < count; k++) sum += a[k] * b[k];
    return sum;
}

static void quaternion_at(double axes[3][3], const struct path_key *key, double q[4])
{
    double sy = sin(key->yaw), cy = cos(key->yaw), sp = sin(key->pitch), cp = cos(key->pitch);
    double sr = sin(key->roll), cr = cos(key->roll), right[3] = {sy, -cy, 0},
           up[3] = {-cy * sp, -sy * sp, cp};
    double forward[3] = {cy * cp, sy * cp, sp}, world[3][3], rolled[2][3];
    for (int k = 0; k < 3; k++) {
        rolled[0][k] = right[k] * cr - up[k] * sr;
        rolled[1][k] = up[k] * cr + right[k] * sr;
    }
    to_world(axes, rolled[0], world[0]);
    to_world(axes, rolled[1], world[1]);
    to_world(axes, forward, world[2]);
    quaternion_from_axes(world[0], world[1], world[2], q);
}

// Angles of a world orientation over a place; looking straight up or down, what yaw loses roll holds.
static void angles_at(double axes[3][3], const double q[4], struct camera *camera)
{
    static const double RIGHT[3] = {1, 0, 0}, AHEAD[3] = {0, 0, -1};
    double forward[3], right[3], local[3];
    rotate(q, AHEAD, forward);
    rotate(q, RIGHT, right);
    for (int k = 0; k < 3; k++) local[k] = dot(forward, axes[k], 3);
    camera->pitch = atan2(local[2], hypot(local[0], local[1]));
    camera->yaw = atan2(local[1], local[0]);
    double sy = sin(camera->yaw), cy = cos(camera->yaw), sp = sin(camera->pitch), cp = cos(camera->pitch);
    double level[3] = {sy, -cy, 0}, upright[3] = {-cy * sp, -sy * sp, cp};
    for (int k = 0; k < 3; k++) local[k] = dot(right, axes[k], 3);
    camera->roll = atan2(-dot(local, upright, 3), dot(local, level, 3));
}

// ---- the spline ------------------------------------------------------------

static void knot_from_key(const struct terrain *terrain, const struct path_key *key, double clearance_m,
                          struct knot *knot)
{
    const double place[3] = {key->x_m, key->y_m, 0};
    double axes[3][3], above = key->height_m - (key->above_ground ? 0 : ground_at(terrain, place));
    terrain_axes(terrain, place, axes);
    memcpy(knot->value + DIRECTION, axes[2], sizeof axes[2]);
    knot->value[HEIGHT] = log(fmax(above, fmax(clearance_m, 0.1)));
    quaternion_at(axes, key, knot->value + TURN);
}

// Length of a segment as the eye sees it: log of the way in heights, the climb and the turn.
static double span_of(const struct knot *a, const struct knot *b, double radius_m)
{
    double way = acos(fmin(fmax(dot(a->value, b->value, 3), -1), 1)) * radius_m;
    double turn = 2 * acos(fmin(fabs(dot(a->value + TURN, b->value + TURN, 4)), 1));
    double above = exp(0.5 * (a->value[HEIGHT] + b->value[HEIGHT]));
    return fmax(1e-3, log1p(way / above) + fabs(b->value[HEIGHT] - a->value[HEIGHT]) + turn);
}

// How far along its way a segment is at u, and how fast at its ends: speed goes with the height over ground,
// whose logarithm swells evenly.
static double way_at(double swell, double u)
{
    return fabs(swell) > 1e-6 ? expm1(swell * u) / expm1(swell) : u;
}

static double way_speed(double swell, bool at_end)
{
    return fabs(swell) > 1e-6 ? swell * (at_end ? exp(swell) : 1) / expm1(swell) : 1;
}

// Tangents of one group of components at a key, at most twice as steep as the gentler neighbour.
static void set_tangent(struct knot *knot, const struct knot *before, const struct knot *after, int from,
                        int end)
{
    double slope0[4] = {0}, slope1[4] = {0}, *tangent = knot->tangent + from;
    double speed0 = from == HEIGHT ? 1 : way_speed(before->swell, true);
    double speed1 = from == HEIGHT ? 1 : way_speed(knot->swell, false);
    int size = end - from;
    for (int k = 0; k < size; k++) {
        slope0[k] = speed0 * (knot->value[from + k] - before->value[from + k]) / before->span;
        slope1[k] = speed1 * (after->value[from + k] - knot->value[from + k]) / knot->span;
        tangent[k] = (slope0[k] * knot->span + slope1[k] * before->span) / (before->span + knot->span);
    }
    double length = sqrt(dot(tangent, tangent, size));
    double most = 2 * sqrt(fmin(dot(slope0, slope0, size), dot(slope1, slope1, size)));
    if (size == 1 && slope0[0] * slope1[0] <= 0) most = 0; // a height that turns does so at its key
    if (length > most)
        for (int k = 0; k < size; k++) tangent[k] *= most / length;
}

static void set_tangents(struct path_sphere *path)
{
    for (int i = 0; i < path->count; i++) {
        struct knot *knot = &path->knots[i];
        bool first = i == 0, last = i == path->count - 1;
        for (int g = 0; g < 3; g++) {
            if (!first && !last) {
                set_tangent(knot, knot - 1, knot + 1, GROUPS[g], GROUPS[g + 1]);
                continue;
            }
            const struct knot *a = last ? knot - 1 : knot, *b = a + 1;
            double speed = GROUPS[g] == HEIGHT ? 1 : way_speed(a->swell, last);
            for (int k = GROUPS[g]; k < GROUPS[g + 1]; k++)
                knot->tangent[k] = speed * (b->value[k] - a->value[k]) / a->span;
        }
    }
}

static void blend(const struct knot *knot, double u, double value[COMPONENTS])
{
    double way = way_at(knot->swell, u);
    if (u <= 0) {
        memcpy(value, knot->value, sizeof knot->value);
        return;
    }
    for (int k = 0; k < COMPONENTS; k++) {
        double t = k == HEIGHT ? u : way, v = 1 - t;
        double speed0 = k == HEIGHT ? 1 : way_speed(knot->swell, false);
        double speed1 = k == HEIGHT ? 1 : way_speed(knot->swell, true);
        double bend = v * knot[0].tangent[k] / speed0 - t * knot[1].tangent[k] / speed1;
        value[k] = v * v * (1 + 2 * t) * knot[0].value[k] + t * t * (1 + 2 * v) * knot[1].value[k] +
                   t * v * knot->span * bend;
    }
    double direction = sqrt(dot(value, value, 3)), turn = sqrt(dot(value + TURN, value + TURN, 4));
    for (int k = 0; k < 3; k++) value[DIRECTION + k] /= direction;
    for (int k = 0; k < 4; k++) value[TURN + k] /= turn;
}

static void place_under(double radius_m, const double direction[3], double place[3])
{
    place[0] = radius_m * atan2(direction[1], direction[0]);
    place[1] = radius_m * atan2(direction[2], hypot(direction[0], direction[1]));
}

static double height_over(const struct terrain *terrain, const double place[2], double above_m,
                          double clearance_m)
{
    return fmax(ground_seen(terrain, place, above_m) + above_m, ground_at(terrain, place) + clearance_m);
}

static void fill_nodes(struct path_sphere *path, const struct terrain *terrain, double clearance_m)
{
    int total = (path->count - 1) * NODES_A_SEGMENT + 1;
    double last[COMPONENTS];
    for (int i = 0; i < total; i++) {
        struct node *node = &path->nodes[i];
        double value[COMPONENTS];
        blend(&path->knots[i / NODES_A_SEGMENT], (double)(i % NODES_A_SEGMENT) / NODES_A_SEGMENT, value);
        place_under(path->radius_m, value, node->place);
        double above = exp(value[HEIGHT]);
        node->place[2] = height_over(terrain, node->place, above, clearance_m);
        if (i) {
            double chord[3], turn[4], climb = node->place[2] - node[-1].place[2];
            for (int k = 0; k < 3; k++) chord[k] = value[k] - last[k];
            double same = dot(value + TURN, last + TURN, 4) < 0 ? -1 : 1;
            for (int k = 0; k < 4; k++) turn[k] = value[TURN + k] - same * last[TURN + k];
            double way = hypot(sqrt(dot(chord, chord, 3)) * (path->radius_m + node->place[2]), climb);
            node->at = node[-1].at + way / above + 2 * sqrt(dot(turn, turn, 4));
        }
        memcpy(last, value, sizeof last);
    }
}

// ---- the contract ----------------------------------------------------------

struct path_sphere *path_sphere_from_keys(const struct terrain *terrain, const struct path_key *keys,
                                          int count, double clearance_m, double fov_vertical)
{
    struct path_sphere *path = calloc(1, sizeof *path);
    if (!path) return fail("path: out of memory"), NULL;
    path->radius_m = terrain_info(terrain)->radius_m;
    path->terrain = terrain;
    path->clearance_m = clearance_m;
    path->fov_vertical = fov_vertical;
    path->count = count;
    path->knots = calloc((size_t)count + 1, sizeof *path->knots);
    path->nodes = calloc((size_t)(count - 1) * NODES_A_SEGMENT + 1, sizeof *path->nodes);
    if (!path->knots || !path->nodes) {
        path_sphere_destroy(path);
        return fail("path: out of memory"), NULL;
    }
    for (int i = 0; i < count; i++) {
        struct knot *knot = &path->knots[i];
        knot_from_key(terrain, &keys[i], clearance_m, knot);
        if (i == 0) continue;
        if (dot(knot->value + TURN, knot[-1].value + TURN, 4) < 0) // the shorter way round
            for (int k = 0; k < 4; k++) knot->value[TURN + k] *= -1;
        knot[-1].span = span_of(knot - 1, knot, path->radius_m);
        knot[-1].swell = knot->value[HEIGHT] - knot[-1].value[HEIGHT];
    }
    if (count > 1) set_tangents(path);
    fill_nodes(path, terrain, clearance_m);
    return path;
}

void path_sphere_destroy(struct path_sphere *path)
{
    if (!path) return;
    free(path->knots);
    free(path->nodes);
    free(path);
}

struct camera path_sphere_camera(const struct path_sphere *path, int frame, int frames)
{
    int last = (path->count - 1) * NODES_A_SEGMENT, low = 0, high = last;
    double at = frames < 2 || frame <= 0
                    ? 0
                    : path->nodes[last].at * (frame < frames - 1 ? frame : frames - 1) / (frames - 1);
    while (high - low > 1) {
        int middle = low + (high - low) / 2;
        *(path->nodes[middle].at <= at ? &low : &high) = middle;
    }
    const struct node *a = &path->nodes[low], *b = &path->nodes[high];
    double length = b->at - a->at, t = length > 0 ? fmin((at - a->at) / length, 1) : 0;
    double value[COMPONENTS], axes[3][3];
    struct camera camera = {.fov_vertical = path->fov_vertical};
    int segment = low / NODES_A_SEGMENT;
    if (high > low)
        blend(&path->knots[segment], (low - segment * NODES_A_SEGMENT + t) / NODES_A_SEGMENT, value);
    else
        memcpy(value, path->knots[0].value, sizeof value);
    place_under(path->radius_m, value, camera.eye_m);
    camera.eye_m[2] = height_over(path->terrain, camera.eye_m, exp(value[HEIGHT]), path->clearance_m);
    sphere_axes(path->radius_m, camera.eye_m, axes);
    angles_at(axes, value + TURN, &camera);
    return camera;
}

int path_sphere_tour(const struct terrain *terrain, struct path_key keys[], int room)
{
    static const struct {
        double longitude, latitude, share, yaw, pitch; // degrees; height over ground in radii, 0: a man's
    } STOPS[] = {
        {86.6, 27.7, 0, 90, -2},         {86.6, 27.7001, 0, 90, -2},    {86.6, 27.72, 2e-4, 90, -12},
        {86.6, 27.95, 1.6e-3, 90, -20},  {86.6, 35, 0.03, 90, -30},     {86.6, 85, 0.2, 90, -45},
        {-93.4, 60, 1, -90, -75},        {-93.4, 0, 3, -90, -90},       {-93.4, -60, 1, -90, -75},
        {86.6, -85, 0.2, 90, -45},       {150, -60, 0.03, 60, -30},     {172, -45, 0.01, 40, -20},
        {178, -42, 1.6e-3, 10, -15},     {179.9, -41.6, 4e-4, 10, -10}, {-179.98, -41.55, 1e-4, 20, -10},
        {-179.9795, -41.5495, 0, 45, -2}};
    const double degree = M_PI / 180, radius_m = terrain_info(terrain)->radius_m;
    int count = (int)(sizeof STOPS / sizeof *STOPS);
    if (count > room) count = room;
    for (int i = 0; i < count; i++)
        keys[i] = (struct path_key){.x_m = STOPS[i].longitude * degree * radius_m,
                                    .y_m = STOPS[i].latitude * degree * radius_m,
                                    .height_m = fmax(1.7, STOPS[i].share * radius_m),
                                    .above_ground = true,
                                    .yaw = STOPS[i].yaw * degree,
                                    .pitch = STOPS[i].pitch * degree};
    return count;
}
