// SPDX-License-Identifier: MIT
#include "common/view/frustum.h"

#include <math.h>
#include <string.h>

static const double guard_share = 1e-6; // of the distance to the box's farthest corner

enum { PLANE_NEAR = 4, POLYGON_MAX = 16 };

static double dot(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void set_plane(struct frustum *frustum, int plane, const double side[3], double sign,
                      const double forward[3], double slope)
{
    // cppcheck-suppress ctuuninitvar ; the address of what is to be filled in
    double *normal = frustum->normal[plane], scale = 1 / sqrt(1 + slope * slope);
    for (int axis = 0; axis < 3; axis++) normal[axis] = (sign * side[axis] + slope * forward[axis]) * scale;
    frustum->offset[plane] = 0;
}

void frustum_init(struct frustum *frustum, const struct view *view)
{
    set_plane(frustum, 0, view->right, 1, view->forward, view->tan_half[0]);
    set_plane(frustum, 1, view->right, -1, view->forward, view->tan_half[0]);
    set_plane(frustum, 2, view->up, 1, view->forward, view->tan_half[1]);
    set_plane(frustum, 3, view->up, -1, view->forward, view->tan_half[1]);
    memcpy(frustum->normal[PLANE_NEAR], view->forward, sizeof view->forward);
    frustum->offset[PLANE_NEAR] = -view->near_m;
}

static double box_guard(const double low[3], const double high[3])
{
    double sum = 0;
    for (int axis = 0; axis < 3; axis++) {
        double far = fmax(fabs(low[axis]), fabs(high[axis]));
        sum += far * far;
    }
    return guard_share * sqrt(sum);
}

enum frustum_side frustum_test_box(const struct frustum *frustum, const double low[3], const double high[3],
                                   unsigned *mask)
{
    double guard = box_guard(low, high);
    for (int plane = 0; plane < FRUSTUM_PLANES; plane++) {
        if (!(*mask & (1u << plane))) continue;
        const double *normal = frustum->normal[plane];
        double nearest = frustum->offset[plane],
               farthest = nearest; // of the corners, along the inward normal
        for (int axis = 0; axis < 3; axis++) {
            bool positive = normal[axis] >= 0;
            nearest += normal[axis] * (positive ? low[axis] : high[axis]);
            farthest += normal[axis] * (positive ? high[axis] : low[axis]);
        }
        if (farthest < -guard) return FRUSTUM_OUTSIDE;
        if (nearest >= guard) *mask &= ~(1u << plane);
    }
    return *mask ? FRUSTUM_CROSSING : FRUSTUM_INSIDE;
}

struct polygon {
    double points[POLYGON_MAX][3];
    int count;
};

// Keeps the part with distance >= 0 (Sutherland-Hodgman); points on the plane stay.
static void clip_polygon(struct polygon *polygon, const double normal[3], double offset)
{
    struct polygon kept = {.count = 0};
    for (int i = 0; i < polygon->count; i++) {
        const double *a = polygon->points[i], *b = polygon->points[(i + 1) % polygon->count];
        double da = dot(normal, a) + offset, db = dot(normal, b) + offset;
        if (da >= 0 && kept.count < POLYGON_MAX) memcpy(kept.points[kept.count++], a, sizeof kept.points[0]);
        if ((da >= 0) == (db >= 0) || kept.count == POLYGON_MAX) continue;
        double t = da / (da - db), *point = kept.points[kept.count++];
        for (int axis = 0; axis < 3; axis++) point[axis] = a[axis] + t * (b[axis] - a[axis]);
    }
    *polygon = kept;
}

// Face 0..5 of a box: one axis held at its low or high end, corners in order round the face.
static void box_face(const double low[3], const double high[3], int face, struct polygon *polygon)
{
    int held = face / 2, first = (held + 1) % 3, second = (held + 2) % 3;
    polygon->count = 4;
    for (int corner = 0; corner < 4; corner++) {
        double *point = polygon->points[corner];
        point[held] = face % 2 ? high[held] : low[held];
        point[first] = corner == 1 || corner == 2 ? high[first] : low[first];
        point[second] = corner >= 2 ? high[second] : low[second];
    }
}

struct bounds {
    double rect[4], min_depth;
    bool any;
};

static void bounds_add(struct bounds *bounds, const double forward[3], const double point[3])
{
    if (!bounds->any) *bounds = (struct bounds){{INFINITY, INFINITY, -INFINITY, -INFINITY}, INFINITY, true};
    for (int axis = 0; axis < 2; axis++) {
        bounds->rect[axis] = fmin(bounds->rect[axis], point[axis]);
        bounds->rect[axis + 2] = fmax(bounds->rect[axis + 2], point[axis]);
    }
    bounds->min_depth = fmin(bounds->min_depth, dot(forward, point));
}

static bool box_holds(const double low[3], const double high[3], const double point[3])
{
    for (int axis = 0; axis < 3; axis++)
        if (!(low[axis] <= point[axis] && point[axis] <= high[axis])) return false;
    return true;
}

// Corners of the part that no face of the box passes through: those of the near rectangle, and the apex
// behind it.
static void add_frustum_corners(struct bounds *bounds, const struct view *view, const double low[3],
                                const double high[3])
{
    for (int corner = 0; corner < 4; corner++) {
        double across = (corner & 1 ? 1 : -1) * view->tan_half[0],
               along = (corner & 2 ? 1 : -1) * view->tan_half[1];
        double point[3];
        for (int axis = 0; axis < 3; axis++)
            point[axis] =
                view->near_m * (view->forward[axis] + across * view->right[axis] + along * view->up[axis]);
        if (box_holds(low, high, point)) bounds_add(bounds, view->forward, point);
    }
    const double apex[3] = {0, 0, 0};
    if (box_holds(low, high, apex)) bounds_add(bounds, view->forward, apex);
}

bool frustum_clip_box(const struct view *view, const double low[3], const double high[3], double rect[4],
                      double *min_depth)
{
    struct frustum frustum = {0};
    frustum_init(&frustum, view);
    double guard = box_guard(low, high);
    struct bounds bounds = {.any = false};
    for (int face = 0; face < 6; face++) {
        struct polygon polygon;
        box_face(low, high, face, &polygon);
        for (int plane = 0; plane < FRUSTUM_PLANES && polygon.count; plane++)
            clip_polygon(&polygon, frustum.normal[plane], frustum.offset[plane] + guard);
        for (int i = 0; i < polygon.count; i++) bounds_add(&bounds, view->forward, polygon.points[i]);
    }
    add_frustum_corners(&bounds, view, low, high);
    if (!bounds.any) return false;
    memcpy(rect, bounds.rect, sizeof bounds.rect);
    if (min_depth) *min_depth = fmax(bounds.min_depth, view->near_m);
    return true;
}
