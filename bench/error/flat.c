// SPDX-License-Identifier: MIT
#include "bench/error/flat.h"

#include <math.h>
#include <string.h>

void flat_from_relative(double radius_m, const double relative[3], double flat[3])
{
    double share = 1, distance = radius_m + relative[2];
    if (radius_m > 0) share = distance > 0 ? radius_m / distance : (double)NAN;
    for (int axis = 0; axis < 3; axis++) flat[axis] = relative[axis] * share;
}

double flat_rise(double radius_m, const double flat[3])
{
    double r = radius_m;
    if (!(r > 0)) return flat[2];
    return r / (r - flat[2]) * sqrt(flat[0] * flat[0] + flat[1] * flat[1] + r * r) - r;
}

void flat_up(double radius_m, const double place[2], double up[3])
{
    double r = radius_m, length = sqrt(place[0] * place[0] + place[1] * place[1] + r * r);
    up[0] = r > 0 ? place[0] / length : 0;
    up[1] = r > 0 ? place[1] / length : 0;
    up[2] = r > 0 ? r / length : 1;
}

void flat_point(double radius_m, const double place[2], double rise_m, double relative[3])
{
    double up[3], r = radius_m;
    flat_up(radius_m, place, up);
    for (int axis = 0; axis < 3; axis++)
        relative[axis] = r > 0       ? (r + rise_m) * up[axis] - (axis == 2 ? r : 0)
                         : axis == 2 ? rise_m
                                     : place[axis];
}

void flat_feed(double radius_m, const float *triangles, size_t count, struct places *places)
{
    enum { CHUNK = 512 };
    float chunk[CHUNK * 9];
    if (!(radius_m > 0)) {
        places_feed(triangles, count, places);
        return;
    }
    for (size_t done = 0; done < count; done += CHUNK) {
        size_t size = count - done < CHUNK ? count - done : CHUNK;
        for (size_t corner = 0; corner < 3 * size; corner++) {
            const float *from = triangles + 9 * done + 3 * corner;
            double flat[3], relative[3] = {(double)from[0], (double)from[1], (double)from[2]};
            flat_from_relative(radius_m, relative, flat);
            for (int axis = 0; axis < 3; axis++) chunk[3 * corner + (size_t)axis] = (float)flat[axis];
        }
        places_feed(chunk, size, places);
    }
}

void flat_receive(const float *triangles, size_t count, void *user)
{
    const struct flat_feeding *feeding = user;
    flat_feed(feeding->radius_m, triangles, count, feeding->places);
}
