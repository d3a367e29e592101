// Planets for tests: smooth hills that are functions of the place in space, so that the 180th meridian and
// the poles are places like others. SPDX-License-Identifier: MIT
#ifndef TESTS_PLANET_H
#define TESTS_PLANET_H

#include "common/terrain/relief/relief_pack.h"
#include "common/view/view.h"
#include "tests/test.h"

static const double RADIUS = 6371007, DEGREE = M_PI / 180;

// Columns: a multiple of 4; half as many rows and one.  Hills of up to 1.3 relief_m, the higher ones `waves`
// radians of an octant apart.  heightfield_finish frees it.
static inline struct heightfield test_planet_field(int columns, double relief_m, double waves)
{
    int rows = columns / 2 + 1;
    struct heightfield field = {.name = "planet",
                                .width = columns,
                                .height = rows,
                                .spacing_m = {2 * M_PI * RADIUS / columns, 2 * M_PI * RADIUS / columns},
                                .quantum_m = 1,
                                .radius_m = RADIUS,
                                .samples = malloc((size_t)columns * (size_t)rows * sizeof(int32_t))};
    assert_non_null(field.samples);
    for (int k = 0; k < columns * rows; k++) {
        double longitude = 2 * M_PI * (k % columns) / columns,
               latitude = M_PI * (k / columns) / (rows - 1) - M_PI / 2, w = waves;
        double x = cos(latitude) * cos(longitude), y = cos(latitude) * sin(longitude), z = sin(latitude);
        field.samples[k] =
            (int32_t)lrint(relief_m * (sin(w * x + 2 * y) * cos(0.7 * w * z - y) +
                                       0.3 * sin(5 * w * x * y + 4 * w * z) * cos(4 * w * z - 2 * w * x)));
    }
    return field;
}

static inline struct terrain *test_planet(int columns, double relief_m, double waves, int finer)
{
    struct heightfield field = test_planet_field(columns, relief_m, waves);
    struct terrain_grid grid = {.name = "planet",
                                .samples = field.samples,
                                .width = field.width,
                                .height = field.height,
                                .first = {-columns / 2, 0},
                                .spacing_m = {1, 1},
                                .quantum_m = 1};
    struct terrain_options options = {.radius_m = RADIUS, .synthesize_levels = finer, .seed = 2};
    struct terrain *terrain = terrain_from_grid(&grid, &options);
    heightfield_finish(&field);
    assert_non_null(terrain);
    return terrain;
}

// The same planet in a file, no sample off by more than max_m.
static inline void test_planet_pack(int columns, double relief_m, double waves, double max_m,
                                    const char *path)
{
    struct heightfield field = test_planet_field(columns, relief_m, waves);
    const struct relief_pack_options options = {.layout = LAYOUT_BOUNDED, .max_m = max_m};
    struct relief_header header;
    assert_true(relief_pack(&field, &options, path, &header));
    heightfield_finish(&field);
}

// A camera at longitude, latitude (degrees) and a height over ground.
static inline struct camera test_camera(const struct terrain *terrain, double longitude, double latitude,
                                        double height_m, double yaw, double pitch)
{
    double q = 0, x = longitude * DEGREE * RADIUS, y = latitude * DEGREE * RADIUS;
    const struct terrain_info *info = terrain_info(terrain);
    assert_true(terrain_truth_at(terrain, x, y, &q, NULL));
    return (struct camera){
        {x, y, q * info->quantum_m + info->offset_m + height_m}, yaw, pitch, 0, 60 * DEGREE};
}

// Longitude and latitude, relative to a viewer's, of what it sees at an angle from its nadir and an azimuth
// from east; in long double (numerics.md, D2).
static inline void test_exact_angles(double latitude, double angle, double azimuth, double exact[2])
{
    long double s = sinl(angle), half = sinl((long double)angle / 2), c = 2 * half * half;
    long double px = -s * sinl(azimuth), py = s * cosl(azimuth), sine = cosl(latitude),
                cosine = sinl(latitude);
    long double x = cosine * px + sine * (1 - c), a = sine * px + cosine * c, across = hypotl(x, py);
    exact[0] = (double)atan2l(py, x);
    exact[1] = (double)(-2 * atan2l(a, sine + across));
}

#endif
