// A flight made from the terrain itself: it weaves along the map's longer side, low over the lowest ground at
// hand, climbs over everything for a look at the whole and dives back.
// SPDX-License-Identifier: MIT
#include "common/view/path_sphere.h"

#include <math.h>

enum { TOUR_KEYS = 9, SEEK = 4 };

struct land {
    const struct terrain *terrain;
    const struct terrain_info *info;
    double size_m; // geometric mean of the sides
    double low_m;  // height over ground of the low flight
    double
        deepest_m; // height over the datum that the flight keeps: near the summits of a map taller than wide
    double overview_m; // height over the datum of the look at the whole
};

static double land_ground(const struct land *land, double x_m, double y_m)
{
    const double *outline = land->info->outline_m;
    double q = land->info->max_q;
    terrain_truth_at(land->terrain, fmin(fmax(x_m, outline[0]), outline[2]),
                     fmin(fmax(y_m, outline[1]), outline[3]), &q, NULL);
    return q * land->info->quantum_m + land->info->offset_m;
}

static struct land survey(const struct terrain *terrain)
{
    const struct terrain_info *info = terrain_info(terrain);
    struct land land = {.terrain = terrain, .info = info};
    double spacing = fmin(info->spacing_m[0], info->spacing_m[1]);
    double width = info->outline_m[2] - info->outline_m[0], height = info->outline_m[3] - info->outline_m[1];
    double least = fmax(fmax(width, height) / 64, spacing); // a map may be one sample wide
    land.size_m = sqrt(fmax(width, least) * fmax(height, least));
    double summit_m = info->max_q * info->quantum_m + info->offset_m;
    double relief = (info->max_q - info->min_q) * info->quantum_m;
    land.low_m = fmax(fmin(fmax(0.001 * land.size_m, 0.03 * relief), 0.02 * land.size_m), 0.25 * spacing);
    land.deepest_m = summit_m + land.low_m - 0.15 * land.size_m;
    land.overview_m = summit_m + land.low_m + 0.1 * land.size_m;
    return land;
}

// Moves a place to low ground to its left or right; far is dear, so that flat land leaves the place where it
// is.
static void seek_valley(const struct land *land, double place[2], int across)
{
    double reach = 0.03 * land->size_m, best = INFINITY, from = place[across], found = from;
    for (int i = -SEEK; i <= SEEK; i++) {
        place[across] = from + reach * i / SEEK;
        double far = (double)(i * i) / (SEEK * SEEK);
        double cost = land_ground(land, place[0], place[1]) + 4 * land->low_m * far;
        if (cost < best) best = cost, found = place[across];
    }
    place[across] = found;
}

// Height of the flight between low (0) and overview (1), along its way.
static double climb_at(double way)
{
    double t = fmin(fmax((0.26 - fabs(way - 0.68)) / 0.26, 0), 1);
    return t * t * (3 - 2 * t);
}

static void place_key(const struct land *land, double way, struct path_key *key, double climb)
{
    const double *outline = land->info->outline_m;
    double side[2] = {outline[2] - outline[0], outline[3] - outline[1]};
    int along = side[0] >= side[1] ? 0 : 1, across = 1 - along;
    double place[2];
    place[along] = outline[along] + (0.12 + 0.76 * way) * side[along];
    double swing = fmin(0.1 * land->size_m, 0.25 * side[across]);
    place[across] = outline[across] + 0.5 * side[across] - swing * sin(2 * M_PI * way);
    if (climb == 0) seek_valley(land, place, across);
    double low = fmax(land_ground(land, place[0], place[1]) + land->low_m, land->deepest_m);
    *key = (struct path_key){
        .x_m = place[0], .y_m = place[1], .height_m = low + climb * (land->overview_m - low)};
}

// Looks where the flight goes, a little less restless than the flight itself.
static void look_ahead(struct path_key *keys)
{
    double course[TOUR_KEYS];
    for (int i = 0; i < TOUR_KEYS; i++) {
        const struct path_key *from = &keys[i ? i - 1 : 0], *to = &keys[i + 1 < TOUR_KEYS ? i + 1 : i];
        course[i] = atan2(to->y_m - from->y_m, to->x_m - from->x_m);
    }
    for (int i = 0; i < TOUR_KEYS;
         i++) // a flight along one axis never turns back: courses need no unwrapping
        keys[i].yaw =
            0.25 * course[i ? i - 1 : 0] + 0.5 * course[i] + 0.25 * course[i + 1 < TOUR_KEYS ? i + 1 : i];
}

struct path *path_for_terrain(const struct terrain *terrain, int frames, double fov_vertical)
{
    if (terrain_info(terrain)->datum == TERRAIN_SPHERE) {
        struct path_key stops[32];
        int count = path_sphere_tour(terrain, stops, 32);
        return path_from_keys(terrain, stops, count, frames, 1.2, fov_vertical);
    }
    struct land land = survey(terrain);
    struct path_key keys[TOUR_KEYS];
    const double level_pitch = -4 * M_PI / 180, down_pitch = -28 * M_PI / 180;
    for (int i = 0; i < TOUR_KEYS; i++) {
        double way = (double)i / (TOUR_KEYS - 1), climb = climb_at(way);
        place_key(&land, way, &keys[i], climb);
        keys[i].pitch = level_pitch + climb * (down_pitch - level_pitch);
    }
    look_ahead(keys);
    return path_from_keys(terrain, keys, TOUR_KEYS, frames, 0.6 * land.low_m, fov_vertical);
}
