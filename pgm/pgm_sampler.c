// SPDX-License-Identifier: MIT
#include "pgm/pgm_sampler.h"

#include <math.h>

enum { SLICES = 12, STRIPS = 4 }; // of the ground that is searched for what hides the lower edge

static const double half_pi = 1.57079632679489661923;
static const double infinitesimal = 1e-9; // sine of a ray to the sky; only the published camera sends one

static double clamp(double value, double low, double high)
{
    return fmin(fmax(value, low), high);
}

// ---- the visible slab, seen from the side ----------------------------------

// The view from the side: all points whose elevation lies between two rays, at heights low .. high over the
// eye.
struct wedge {
    double upper, lower; // elevation of the rays, radians; may pass the zenith and the nadir
    double low, high;    // of the slab, relative to the eye
};

static void include(double q, double *nearest, double *farthest)
{
    *nearest = fmin(*nearest, q);
    *farthest = fmax(*farthest, q);
}

static void include_ray(const struct wedge *wedge, double elevation, double *nearest, double *farthest)
{
    double sine = sin(elevation), cosine = cos(elevation);
    const double heights[2] = {wedge->low, wedge->high};
    for (int i = 0; i < 2; i++)
        if (heights[i] / sine > 0) include(heights[i] / sine * cosine, nearest, farthest);
}

// Range of forward distances of wedge and slab together; false when they do not meet.
static bool wedge_range(const struct wedge *wedge, double *nearest, double *farthest)
{
    *nearest = INFINITY;
    *farthest = -INFINITY;
    include_ray(wedge, wedge->upper, nearest, farthest);
    include_ray(wedge, wedge->lower, nearest, farthest);
    if (wedge->low <= 0 && wedge->high >= 0) include(0, nearest, farthest);
    if ((wedge->lower < 0 && wedge->upper >= 0 && wedge->low < 0) ||
        (wedge->lower <= 0 && wedge->upper > 0 && wedge->high > 0))
        *farthest = INFINITY;
    return *nearest <= *farthest;
}

// ---- Equation 3 ------------------------------------------------------------

double pgm_extension_published(double height, double distance, double highest)
{
    double h = height, r = distance, m = highest;
    return atan(r * h * m / (h * h * h + r * r * (h - m)));
}

double pgm_extension_stable(double height, double distance, double highest)
{
    if (!(distance > 0) || !(height > 0)) return 0;
    double mu = clamp(highest / height, 0, 1), rho = distance / height;
    // Divided by rho where it is large, so that its square cannot overflow.
    if (rho > 1) return atan2(mu, 1 / rho + rho * (1 - mu));
    return atan2(rho * mu, 1 + rho * rho * (1 - mu));
}

// ---- aiming ----------------------------------------------------------------

static void set_axes(struct pgm_sampler *sampler, const struct view *view)
{
    double sine = sin(view->yaw), cosine = cos(view->yaw);
    sampler->forward[0] = cosine;
    sampler->forward[1] = sine;
    sampler->right[0] = sine;
    sampler->right[1] = -cosine;
}

// The upright view that encloses the rolled one (numerics.md, PG3).
static void set_angles(struct pgm_sampler *sampler, const struct view *view, enum pgm_camera camera)
{
    double sine = camera == PGM_CAMERA_STABLE ? fabs(sin(view->roll)) : 0;
    double cosine = camera == PGM_CAMERA_STABLE ? fabs(cos(view->roll)) : 1;
    sampler->tan_half[0] = view->tan_half[0] * cosine + view->tan_half[1] * sine;
    sampler->tan_half[1] = view->tan_half[0] * sine + view->tan_half[1] * cosine;
}

// How far ahead the map begins and ends.
static void map_reach(const struct pgm_sampler *sampler, const struct view *view, const double outline_m[4],
                      double *begins, double *ends)
{
    *begins = INFINITY;
    *ends = -INFINITY;
    for (int corner = 0; corner < 4; corner++) {
        double x = outline_m[corner & 1 ? 2 : 0] - view->eye_m[0];
        double y = outline_m[corner & 2 ? 3 : 1] - view->eye_m[1];
        include(x * sampler->forward[0] + y * sampler->forward[1], begins, ends);
    }
}

// Height over the sampling plane.  A plane at or above the eye cannot be sampled (numerics.md, A6).
static double sampling_height(const struct view *view, const struct pgm_world *world, enum pgm_plane plane)
{
    if (plane == PGM_PLANE_GROUND) // rows closer than the cells they read would be wasted
        return fmax(view->eye_m[2] - world->ground_m, world->spacing_m);
    double height = view->eye_m[2] - world->lowest_m;
    return height > 0 ? height : world->spacing_m / 4;
}

// Equation 2.
static double sampling_depression(const struct pgm_sampler *sampler, double depression,
                                  enum pgm_camera camera)
{
    double half = atan(sampler->tan_half[1]);
    if (camera == PGM_CAMERA_PUBLISHED) return fabs(depression) > half ? depression : half + 1e-6;
    double epsilon = sampler->reach_m > 0 ? atan(sampler->height_m / sampler->reach_m) : half_pi;
    return fmin(fmax(depression, half + epsilon), half_pi);
}

// Width of what is visible at each forward distance: at depth s the view is tan s wide, and s = q cos A - z
// sin A is largest at the bottom of the slab when looking down, at its top when looking up (numerics.md,
// PG2).
static void set_width(struct pgm_sampler *sampler, const struct view *view, const struct wedge *wedge,
                      bool widening)
{
    const double guard = 1 + 1e-5; // the table is rounded to float
    double across = sampler->tan_half[0] * guard;
    double depression = widening ? -view->pitch : sampler->depression;
    double lowest = widening ? (depression >= 0 ? wedge->low : wedge->high) : -sampler->height_m;
    sampler->width[0] = -across * lowest * sin(depression);
    sampler->width[1] = across * cos(depression);
    sampler->width[2] = across * view->near_m;
}

double pgm_sampler_half_width(const struct pgm_sampler *sampler, double forward_m)
{
    return fmax(sampler->width[0] + sampler->width[1] * forward_m, sampler->width[2]);
}

// Taken in strips along the view, whose upright rectangles hold less ground beside the trapezoid.
double pgm_sampler_highest(const struct pgm_sampler *sampler, const struct view *view,
                           const struct pgm_world *world, double from, double to)
{
    double highest = -(double)INFINITY;
    for (int strip = 0; strip < STRIPS; strip++) {
        double rect[4] = {INFINITY, INFINITY, -INFINITY, -INFINITY};
        for (int corner = 0; corner < 4; corner++) {
            double q = corner & 1 ? to : from, side = 2.0 * (strip + (corner >> 1)) / STRIPS - 1;
            double p = pgm_sampler_half_width(sampler, q) * side;
            for (int axis = 0; axis < 2; axis++) {
                double x = view->eye_m[axis] + sampler->forward[axis] * q + sampler->right[axis] * p;
                include(x, &rect[axis], &rect[axis + 2]);
            }
        }
        highest = fmax(highest, world->highest_in(world->user, rect));
    }
    return highest - view->eye_m[2];
}

// Near end by the viewing camera: that of the first slice, going ahead, whose terrain is high enough to be
// seen.  At `cut` the view's lower edge leaves the slab.
static double tight_near(const struct pgm_sampler *sampler, const struct view *view,
                         const struct pgm_world *world, const struct wedge *wedge, double nearest,
                         double farthest)
{
    double cut = farthest;
    if (wedge->lower < 0 && wedge->low < 0)
        cut = fmin(cut, wedge->low * cos(wedge->lower) / sin(wedge->lower));
    for (int slice = 0; slice < SLICES && nearest < cut; slice++) {
        double from = nearest + (cut - nearest) * slice / SLICES;
        double to = nearest + (cut - nearest) * (slice + 1) / SLICES;
        struct wedge seen = *wedge;
        seen.high = clamp(pgm_sampler_highest(sampler, view, world, from, to), wedge->low, wedge->high);
        double begins, ends;
        if (wedge_range(&seen, &begins, &ends) && begins <= to && ends >= from) return fmax(from, begins);
    }
    return fmax(nearest, cut);
}

// Near end by the sampling camera: where its lower edge meets the plane, extended by gamma.
static double sampled_near(struct pgm_sampler *sampler, const struct view *view,
                           const struct pgm_world *world, enum pgm_extension extension)
{
    double half = atan(sampler->tan_half[1]), h = sampler->height_m;
    double lower = sampler->depression + half;
    double distance = h * cos(lower) / fmax(sin(lower), infinitesimal), alpha = half_pi - lower;
    if (extension == PGM_EXTENSION_NONE || !(distance > 0)) return distance;
    double highest = pgm_sampler_highest(sampler, view, world, 0, distance) + h;
    double gamma = extension == PGM_EXTENSION_STABLE ? pgm_extension_stable(h, distance, highest)
                                                     : pgm_extension_published(h, distance, highest);
    return h * tan(clamp(alpha - gamma, -1.5, 1.5));
}

static double sampled_far(const struct pgm_sampler *sampler)
{
    double upper = sampler->depression - atan(sampler->tan_half[1]);
    return sampler->height_m * cos(upper) / fmax(sin(upper), infinitesimal);
}

static void set_ends(struct pgm_sampler *sampler, const struct view *view, const struct pgm_world *world,
                     const struct pgm_settings *settings, const struct wedge *wedge, double begins)
{
    const double guard = 2e-4; // row 0 lies just beyond the last terrain
    double nearest, farthest;
    bool seen = wedge_range(wedge, &nearest, &farthest);
    // The published camera, looking up: all its rays go to the sky.
    sampler->empty = sampler->depression + atan(sampler->tan_half[1]) <= 0;
    if (sampler->empty) return;
    double edge = sampler->screen_m; // where the rows of the window itself end
    if (settings->extension == PGM_EXTENSION_TIGHT) {
        farthest = fmin(farthest, sampler->reach_m);
        nearest = fmax(nearest, begins);
        sampler->empty = !seen || !(nearest < farthest);
        if (sampler->empty) return;
        nearest = tight_near(sampler, view, world, wedge, nearest, farthest);
        // A sliver of ground at the very edge of the map or the picture still gets rows with room between
        // them.
        nearest = fmin(nearest, farthest - guard * fabs(farthest));
    } else {
        double behind = fmin(nearest, 0); // terrain overhead when looking up steeply
        farthest = sampled_far(sampler);
        if (settings->camera == PGM_CAMERA_STABLE) farthest = fmin(farthest, sampler->reach_m);
        edge = sampled_near(sampler, view, world, PGM_EXTENSION_NONE);
        nearest = sampled_near(sampler, view, world, settings->extension);
        if (settings->extension == PGM_EXTENSION_STABLE) nearest = fmin(nearest, behind);
        bool to_sky =
            sampler->depression + atan(sampler->tan_half[1]) <= 0; // every ray: the published camera
        sampler->empty = to_sky || !(nearest < farthest);
        if (sampler->empty) return;
    }
    sampler->far_m = farthest + guard * fabs(farthest);
    sampler->near_m = nearest - guard * fabs(nearest);
    sampler->edge_m = edge > sampler->near_m && edge < sampler->far_m ? edge : sampler->near_m;
}

// Rows behind the viewer must still be in front of the sampling camera, and not at the rim of its image
// plane.
static void face_near_end(struct pgm_sampler *sampler)
{
    const double margin = half_pi / 6;
    if (sampler->near_m >= 0) return;
    double behind = atan2(-sampler->near_m, sampler->height_m);
    sampler->depression = fmax(sampler->depression, fmin(behind + margin, half_pi));
}

void pgm_sampler_aim(struct pgm_sampler *sampler, const struct view *view, const struct pgm_world *world,
                     const struct pgm_settings *settings)
{
    *sampler = (struct pgm_sampler){.empty = false};
    set_axes(sampler, view);
    set_angles(sampler, view, settings->camera);
    double begins, half = atan(sampler->tan_half[1]);
    map_reach(sampler, view, world->outline_m, &begins, &sampler->reach_m);
    sampler->below_base = view->eye_m[2] <= world->lowest_m;
    sampler->height_m = sampling_height(view, world, settings->plane);
    sampler->depression = sampling_depression(sampler, -view->pitch, settings->camera);
    struct wedge wedge = {view->pitch + half, view->pitch - half, world->lowest_m - view->eye_m[2],
                          world->highest_m - view->eye_m[2]};
    set_width(sampler, view, &wedge, settings->widening);
    sampler->screen_m = (double)INFINITY;
    if (wedge.lower < 0) sampler->screen_m = -sampler->height_m * cos(wedge.lower) / sin(wedge.lower);
    double lower_edge = sampler->depression + half;
    set_ends(sampler, view, world, settings, &wedge, begins);
    if (sampler->empty) return;
    double near_depression = half_pi - atan2(sampler->near_m, sampler->height_m);
    sampler->extension = near_depression - lower_edge;
    face_near_end(sampler);
}
