// SPDX-License-Identifier: MIT
#include "clipmap/sphere_rings.h"

#include <math.h>

// ---- geometry --------------------------------------------------------------

struct sphere_rings sphere_rings_make(int n)
{
    struct sphere_rings rings = {.azimuths =
                                     (2 * n + 2 + SPHERE_SECTORS / 2) / SPHERE_SECTORS * SPHERE_SECTORS};
    rings.an_octave = (int)fmax(1, lround(rings.azimuths * M_LN2 / (2 * M_PI) / 16)) * 16;
    while (rings.azimuths / SPHERE_SECTORS % (2 << rings.halvings) == 0) rings.halvings++;
    rings.count = rings.an_octave * SPHERE_OCTAVES + 1;
    return rings;
}

double sphere_ring_angle(const struct sphere_rings *rings, int ring)
{
    return ring >= rings->count - 1 ? 0 : M_PI * exp2(-(double)ring / rings->an_octave);
}

void sphere_ring_vertex(const struct sphere_rings *rings, int ring, int azimuth, float vertex[4])
{
    double angle = sphere_ring_angle(rings, ring);
    double turn = 2 * M_PI * (azimuth % rings->azimuths) / rings->azimuths, half = sin(0.5 * angle);
    vertex[0] = (float)(cos(turn) * sin(angle));
    vertex[1] = (float)(sin(turn) * sin(angle));
    vertex[2] = (float)(2 * half * half);
    vertex[3] = (float)ring;
}

// ---- what is seen ----------------------------------------------------------

double sphere_horizon(double height_m, double radius_m)
{
    return height_m > 0 ? atan2(sqrt(height_m * (2 * radius_m + height_m)), radius_m) : 0;
}

struct sphere_ring_range sphere_ring_visible(const struct sphere_rings *rings, const struct terrain *terrain,
                                             const struct view *view, double over_ground_m)
{
    const struct terrain_info *info = terrain_info(terrain);
    double low_m = info->offset_m + info->quantum_m * info->min_q,
           high_m = info->offset_m + info->quantum_m * info->max_q;
    double radius_m = info->radius_m + low_m;
    double farthest =
        sphere_horizon(view->eye_place[2] - low_m, radius_m) + sphere_horizon(high_m - low_m, radius_m);
    double pixel_m = fmax(over_ground_m, 0.05) / view->pixels_per_tangent;
    double nearest = rings->azimuths * pixel_m / (2 * M_PI * radius_m);
    struct sphere_ring_range range = {(int)floor(rings->an_octave * log2(M_PI / fmin(farthest, M_PI))),
                                      (int)floor(rings->an_octave * log2(M_PI / fmin(nearest, 0.5)))};
    int last = rings->count - 2 - (rings->halvings + 1) * rings->an_octave;
    range.inner = range.inner > last ? last : range.inner;
    if (range.outer > range.inner) range.outer = range.inner;
    return range;
}

static void widen(double value, double *low, double *high)
{
    *low = fmin(*low, value);
    *high = fmax(*high, value);
}

void sphere_block_box(const struct sphere_rings *rings, const struct view *view, double turn,
                      const int ring[2], const int azimuth[2], double low_m, double high_m, double low[3],
                      double high[3])
{
    double angle[2] = {sphere_ring_angle(rings, ring[0]), sphere_ring_angle(rings, ring[1])};
    double planet_m = view->radius_m - view->eye_place[2],
           radius_m[2] = {planet_m + low_m, planet_m + high_m};
    double from = turn + 2 * M_PI * azimuth[0] / rings->azimuths,
           to = turn + 2 * M_PI * azimuth[1] / rings->azimuths;
    double across_low = HUGE_VAL, across_high = 0;
    for (int a = 0; a < 2; a++)
        for (int r = 0; r < 2; r++) widen(radius_m[r] * sin(angle[a]), &across_low, &across_high);
    if (angle[0] > M_PI / 2 && angle[1] < M_PI / 2) across_high = radius_m[1];
    for (int axis = 0; axis < 2; axis++) {
        low[axis] = HUGE_VAL, high[axis] = -HUGE_VAL;
        double offset = axis * M_PI / 2, least = HUGE_VAL, most = -HUGE_VAL; // of the cosine towards the axis
        widen(cos(from - offset), &least, &most);
        widen(cos(to - offset), &least, &most);
        double begin = (from - offset) / M_PI, end = (to - offset) / M_PI; // extremes at whole numbers
        for (double k = ceil(begin); k <= end; k++) widen(fmod(fabs(k), 2) == 0 ? 1 : -1, &least, &most);
        widen(least * across_low, &low[axis], &high[axis]);
        widen(least * across_high, &low[axis], &high[axis]);
        widen(most * across_low, &low[axis], &high[axis]);
        widen(most * across_high, &low[axis], &high[axis]);
    }
    low[2] = HUGE_VAL, high[2] = -HUGE_VAL;
    for (int a = 0; a < 2; a++)
        for (int r = 0; r < 2; r++) {
            double half = sin(0.5 * angle[a]);
            widen((r ? high_m : low_m) - view->eye_place[2] - radius_m[r] * 2 * half * half, &low[2],
                  &high[2]);
        }
}

double sphere_transport(const struct view *last, double turn, const struct view *now)
{
    const double *from = last->axes[2], *to = now->axes[2];
    double pattern[3], along = 0, same = 1, east = 0, north = 0;
    for (int k = 0; k < 3; k++) {
        pattern[k] = cos(turn) * last->axes[0][k] + sin(turn) * last->axes[1][k];
        along += pattern[k] * to[k];
        same += from[k] * to[k];
    }
    if (same < 1e-6) return turn; // to the antipode there is no shortest way
    for (int k = 0; k < 3; k++) {
        double carried = pattern[k] - along / same * (from[k] + to[k]);
        east += carried * now->axes[0][k];
        north += carried * now->axes[1][k];
    }
    return atan2(north, east);
}

// ---- where a vertex samples ------------------------------------------------

// South is the way of growing polar angles: px~ = -north, py~ = east.
static void stable_angles(float sine, float cosine, const float v[3], float angles[2])
{
    float a = sine * -v[1] + cosine * v[2], x = cosine * -v[1] + sine * (1.0f - v[2]);
    float across = sqrtf(x * x + v[0] * v[0]);
    angles[0] = x == 0 && v[0] == 0 ? 0 : atan2f(v[0], x);
    angles[1] = -2.0f * atan2f(a, sine + across);
}

static void acos_angles(float sine, float cosine, float polar, bool printed, const float v[3],
                        float angles[2])
{
    float px = -v[1], pz = 1.0f - v[2], x = cosine * px + (printed ? -sine : sine) * pz;
    float y = v[0], z = -sine * px + cosine * pz;
    angles[0] = x == 0 && y == 0 ? 0 : atan2f(y, x);
    angles[1] = -(acosf(fminf(fmaxf(z, -1.0f), 1.0f)) - polar);
}

void sphere_angles(enum sphere_form form, double latitude, const float v[3], float angles[2])
{
    float polar = (float)(M_PI / 2 - latitude), sine = (float)cos(latitude), cosine = (float)sin(latitude);
    if (form == SPHERE_STABLE) {
        stable_angles(sine, cosine, v, angles);
        return;
    }
    acos_angles(sine, cosine, polar, form == SPHERE_PUBLISHED, v, angles);
    if (form == SPHERE_CORRECTED) return;
    const float pi = 3.14159265f;
    float t = polar / pi - 0.5f, stretch = 1.0f + 1.0f / pi / (0.25f - t * t) - t * t / 6.0f - 4.0f / pi;
    float angle = sqrtf(v[0] * v[0] + v[1] * v[1]); // the sine, this near to the viewer
    float near[2] = {v[0] * stretch, -angle};       // Equations 11 and 14
    float w = fminf(fmaxf((angle * 1024.0f / pi - 1.0f), 0.0f), 1.0f);
    for (int k = 0; k < 2; k++) angles[k] = near[k] * (1.0f - w) + angles[k] * w;
}
