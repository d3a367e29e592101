// SPDX-License-Identifier: MIT
#include "common/view/view.h"

#include <math.h>
#include <string.h>

enum { LATTICE_BITS_MAX = 12, LATTICE_BITS_SPHERE = 23, FRACTION_BITS = 23 };
static const double OUTLINE_MARGIN = 1e-4; // interpolated float32 positions are right to about 1e-5

static double dot(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static double clamp(double value, double low, double high)
{
    return fmin(fmax(value, low), high);
}

// The nearest lattice point; far beyond any terrain the count is held where doubles and shifts stay exact.
static int64_t snap(double value, double unit)
{
    return llround(clamp(value / unit, -0x1p52, 0x1p52));
}

static int64_t shift_floor(int64_t value, int bits)
{
    int64_t divisor = (int64_t)1 << bits, quotient = value / divisor;
    return quotient - (value % divisor < 0);
}

static void snap_eye(struct view *view, const struct terrain *terrain, const double eye_m[3])
{
    const struct terrain_info *info = terrain_info(terrain);
    int levels = info->coarsest - info->finest + 1;
    view->finest = info->finest;
    view->lattice_bits = info->datum == TERRAIN_SPHERE
                             ? LATTICE_BITS_SPHERE
                             : (int)clamp(FRACTION_BITS + 1 - levels, 0, LATTICE_BITS_MAX);
    for (int axis = 0; axis < 2; axis++) {
        double unit = ldexp(info->spacing_m[axis], info->finest - view->lattice_bits);
        view->eye_lattice[axis] = snap(eye_m[axis], unit);
        view->eye_place[axis] = (double)view->eye_lattice[axis] * unit;
    }
    double unit = ldexp(info->quantum_m, -VIEW_HEIGHT_BITS);
    // On the plane the whole quanta fit an int32; over a sphere a double holds them.
    double limit = ldexp(1, (info->datum == TERRAIN_SPHERE ? 44 : 30) + VIEW_HEIGHT_BITS);
    view->eye_height = snap(clamp(eye_m[2] - info->offset_m, -limit * unit, limit * unit), unit);
    view->eye_place[2] = (double)view->eye_height * unit + info->offset_m;
    terrain_world_from_place(terrain, view->eye_place, view->eye_m);
    terrain_axes(terrain, view->eye_place, view->axes);
    if (info->datum == TERRAIN_SPHERE) view->radius_m = info->radius_m + view->eye_place[2];
}

// Right, up and forward from the angles alone, so that looking straight up or down is nothing special.
static void set_axes(struct view *view)
{
    double sy = sin(view->yaw), cy = cos(view->yaw);
    double sp = sin(view->pitch), cp = cos(view->pitch);
    double sr = sin(view->roll), cr = cos(view->roll);
    double right[3] = {sy, -cy, 0}, up[3] = {-cy * sp, -sy * sp, cp};
    double forward[3] = {cy * cp, sy * cp, sp};
    for (int axis = 0; axis < 3; axis++) {
        view->right[axis] = right[axis] * cr - up[axis] * sr;
        view->up[axis] = up[axis] * cr + right[axis] * sr;
        view->forward[axis] = forward[axis];
    }
}

static void set_clip_from_relative(struct view *view)
{
    float *m = view->clip_from_relative;
    memset(m, 0, sizeof view->clip_from_relative);
    for (int axis = 0; axis < 3; axis++) {
        m[axis * 4 + 0] = (float)(view->right[axis] / view->tan_half[0]);
        m[axis * 4 + 1] = (float)(view->up[axis] / view->tan_half[1]);
        m[axis * 4 + 3] = (float)view->forward[axis];
    }
    m[3 * 4 + 2] = (float)view->near_m;
}

static double near_by_height(const struct terrain *terrain, const double place[3])
{
    const struct terrain_info *info = terrain_info(terrain);
    double ground_q = 0;
    const double *outline = info->outline_m;
    double x = clamp(place[0], outline[0], outline[2]), y = clamp(place[1], outline[1], outline[3]);
    if (!terrain_truth_at(terrain, x, y, &ground_q, NULL)) return 0.05;
    return fmax(0.05, 0.1 * (place[2] - (ground_q * info->quantum_m + info->offset_m)));
}

void view_init(struct view *view, const struct terrain *terrain, const struct camera *camera, int width,
               int height, double near_m)
{
    memset(view, 0, sizeof *view);
    snap_eye(view, terrain, camera->eye_m);
    view->yaw = camera->yaw;
    view->pitch = camera->pitch;
    view->roll = camera->roll;
    set_axes(view);
    view->width = width;
    view->height = height;
    view->tan_half[1] = tan(0.5 * camera->fov_vertical);
    view->tan_half[0] = view->tan_half[1] * width / height;
    view->pixels_per_tangent = height / (2 * view->tan_half[1]);
    view->near_m = near_m > 0 ? near_m : near_by_height(terrain, view->eye_place);
    set_clip_from_relative(view);
}

struct view_origin view_level_origin(const struct view *view, int level)
{
    struct view_origin origin;
    int bits = view->lattice_bits + level - view->finest; // lattice steps in one cell: 2^bits
    for (int axis = 0; axis < 2; axis++) {
        int64_t eye = view->eye_lattice[axis];
        if (bits <= 0) {
            origin.base[axis] = eye * ((int64_t)1 << -bits);
            origin.fraction[axis] = 0;
            continue;
        }
        origin.base[axis] = shift_floor(eye, bits);
        int64_t rest = eye - origin.base[axis] * ((int64_t)1 << bits);
        origin.fraction[axis] = fminf((float)ldexp((double)rest, -bits), 0x1.fffffep-1f);
    }
    return origin;
}

void view_eye_quanta(const struct view *view, int32_t *base, float *fraction)
{
    int64_t whole = shift_floor(view->eye_height, VIEW_HEIGHT_BITS);
    *base = (int32_t)whole;
    *fraction = ldexpf((float)(view->eye_height - whole * (1 << VIEW_HEIGHT_BITS)), -VIEW_HEIGHT_BITS);
}

bool view_inside_outline(const struct view *view, const struct terrain *terrain, const double low[2],
                         const double high[2])
{
    const double *outline_m = terrain_info(terrain)->outline_m;
    for (int axis = 0; axis < 2; axis++) {
        double margin_m = OUTLINE_MARGIN * fmax(fabs(low[axis]), fabs(high[axis]));
        if (view->eye_m[axis] + low[axis] - margin_m < outline_m[axis] ||
            view->eye_m[axis] + high[axis] + margin_m > outline_m[axis + 2])
            return false;
    }
    return true;
}

void view_world_direction(const struct view *view, const double relative[3], double world[3])
{
    for (int axis = 0; axis < 3; axis++)
        world[axis] = relative[0] * view->axes[0][axis] + relative[1] * view->axes[1][axis] +
                      relative[2] * view->axes[2][axis];
}

void view_world(const struct view *view, const double relative[3], double world_m[3])
{
    view_world_direction(view, relative, world_m);
    for (int axis = 0; axis < 3; axis++) world_m[axis] += view->eye_m[axis];
}

void view_ray(const struct view *view, int x, int y, double direction[3])
{
    double right = view->tan_half[0] * (2 * (x + 0.5) / view->width - 1);
    double up = view->tan_half[1] * (2 * (y + 0.5) / view->height - 1);
    for (int axis = 0; axis < 3; axis++)
        direction[axis] = view->forward[axis] + right * view->right[axis] + up * view->up[axis];
}

bool view_project(const struct view *view, const double relative[3], double pixel[2])
{
    double depth = dot(view->forward, relative);
    if (!(depth >= view->near_m)) return false;
    pixel[0] = 0.5 * view->width + view->pixels_per_tangent * dot(view->right, relative) / depth;
    pixel[1] = 0.5 * view->height + view->pixels_per_tangent * dot(view->up, relative) / depth;
    return true;
}

bool view_project_vertical(const struct view *view, double x_relative, double y_relative, double z0_relative,
                           double z1_relative, double *length_px)
{
    *length_px = 0;
    double slope = view->forward[2]; // depth gained per metre of height
    double base = view->forward[0] * x_relative + view->forward[1] * y_relative;
    double depth0 = base + slope * z0_relative, depth1 = base + slope * z1_relative, near = view->near_m;
    if (!(depth0 >= near || depth1 >= near)) return false;
    if (depth0 < near) z0_relative = (near - base) / slope, depth0 = near;
    if (depth1 < near) z1_relative = (near - base) / slope, depth1 = near;
    // The difference of the two projections with z1 - z0 taken out: no cancellation for tiny errors.
    double lower[3] = {x_relative, y_relative, z0_relative};
    double across = view->right[2] * depth0 - slope * dot(view->right, lower);
    double along = view->up[2] * depth0 - slope * dot(view->up, lower);
    double height = fabs(z1_relative - z0_relative);
    *length_px = view->pixels_per_tangent * height * hypot(across, along) / (depth0 * depth1);
    return true;
}

bool view_project_segment(const struct view *view, const double from[3], const double step[3],
                          double *length_px)
{
    double near = view->near_m, gain = dot(view->forward, step);
    double depth0 = dot(view->forward, from), depth1 = depth0 + gain, t0 = 0, t1 = 1;
    *length_px = 0;
    if (!(depth0 >= near || depth1 >= near)) return false;
    if (depth0 < near) t0 = (near - depth0) / gain;
    if (depth1 < near) t1 = (near - depth0) / gain;
    double start[3], share = t1 - t0;
    for (int axis = 0; axis < 3; axis++) start[axis] = from[axis] + t0 * step[axis];
    depth0 = fmax(depth0, near), depth1 = fmax(depth1, near);
    // As above: the step stands for the difference of the ends.
    double across = dot(view->right, step) * depth0 - gain * dot(view->right, start);
    double along = dot(view->up, step) * depth0 - gain * dot(view->up, start);
    *length_px = view->pixels_per_tangent * share * hypot(across, along) / (depth0 * depth1);
    return true;
}
