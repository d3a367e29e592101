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

void sphere_block_make(struct sphere_block *block, const struct sphere_rings *rings, const struct view *view,
                       double turn, const int ring[2], const int azimuth[2], double low_m, double high_m)
{
    for (int k = 0; k < 2; k++) {
        double angle = sphere_ring_angle(rings, ring[k]), half = sin(0.5 * angle);
        double side = turn + 2 * M_PI * azimuth[k] / rings->azimuths, height_m = k ? high_m : low_m;
        block->sine[k] = sin(angle);
        block->fall[k] = 2 * half * half;
        block->side[k][0] = cos(side);
        block->side[k][1] = sin(side);
        block->above_m[k] = height_m - view->eye_place[2];
        block->radius_m[k] = view->radius_m - view->eye_place[2] + height_m;
    }
}

// The farthest point stands at the azimuth nearest to the direction's, then at a ring's end or where the
// direction stands upright on the sphere, then at the highest or the lowest ground.
double sphere_block_reach(const struct sphere_block *block, const double direction[3])
{
    const double *d = direction, *from = block->side[0], *to = block->side[1];
    double along = fmax(d[0] * from[0] + d[1] * from[1], d[0] * to[0] + d[1] * to[1]);
    bool between = from[0] * d[1] - from[1] * d[0] >= 0 && d[0] * to[1] - d[1] * to[0] >= 0;
    if (between) along = hypot(d[0], d[1]);
    double length = hypot(along, d[2]), fall = length > 0 ? 1 - d[2] / length : 0;
    double sine[3] = {block->sine[0], block->sine[1], length > 0 ? along / length : 0};
    double falls[3] = {block->fall[0], block->fall[1], fall}, reach = -HUGE_VAL, distance = 0;
    int count = along >= 0 && fall >= block->fall[1] && fall <= block->fall[0] ? 3 : 2;
    for (int a = 0; a < count; a++)
        for (int r = 0; r < 2; r++) {
            double across = block->radius_m[r] * sine[a],
                   up = block->above_m[r] - block->radius_m[r] * falls[a];
            reach = fmax(reach, across * along + up * d[2]);
            distance = fmax(distance, across + fabs(up));
        }
    return reach + 1e-6 * distance * (fabs(d[0]) + fabs(d[1]) + fabs(d[2]));
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
