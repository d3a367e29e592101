// Tiles of the persistent grid against the view and the map: whatever heights their vertices take, one that
// is left out shows nothing, and one that is said to lie within has every vertex within.
// SPDX-License-Identifier: MIT
#include "tests/test.h"

#include "pgm/pgm_tiles.h"

static const double degree = 0.017453292519943295;
static const double lowest_m = 100, highest_m = 1900;

static double highest_in(const void *user, const double rect_m[4])
{
    (void)user, (void)rect_m;
    return highest_m;
}

static struct terrain *make_terrain(void)
{
    enum { SIDE = 257 };
    int32_t *samples = malloc((size_t)SIDE * SIDE * sizeof *samples);
    assert_non_null(samples);
    for (int i = 0; i < SIDE * SIDE; i++) samples[i] = i % 3 == 0 ? 100 : 1900;
    struct terrain_grid grid = {.name = "made",
                                .samples = samples,
                                .width = SIDE,
                                .height = SIDE,
                                .first = {-100, 40},
                                .spacing_m = {90, 90},
                                .quantum_m = 1};
    struct terrain *terrain = terrain_from_grid(&grid, NULL);
    assert_non_null(terrain);
    free(samples);
    return terrain;
}

static struct pgm_world make_world(const struct terrain *terrain)
{
    struct pgm_world world = {.lowest_m = lowest_m,
                              .highest_m = highest_m,
                              .ground_m = lowest_m,
                              .spacing_m = 90,
                              .levels = 6,
                              .highest_in = highest_in};
    for (int edge = 0; edge < 4; edge++) world.outline_m[edge] = terrain_info(terrain)->outline_m[edge];
    return world;
}

static struct view some_view(const struct terrain *terrain, uint64_t *seed)
{
    const double *outline = terrain_info(terrain)->outline_m;
    struct camera camera = {.yaw = test_uniform(seed, -4, 4),
                            .pitch = test_uniform(seed, -90, 30) * degree,
                            .roll = test_uniform(seed, -180, 180) * degree,
                            .fov_vertical = test_uniform(seed, 10, 110) * degree};
    for (int axis = 0; axis < 2; axis++)
        camera.eye_m[axis] = test_uniform(seed, outline[axis] - 3000, outline[axis + 2] + 3000);
    camera.eye_m[2] = test_uniform(seed, lowest_m + 10, 9000);
    struct view view;
    view_init(&view, terrain, &camera, 96, 64, 0);
    return view;
}

static bool is_seen(const struct view *view, const double relative[3])
{
    double pixel[2];
    return view_project(view, relative, pixel) && pixel[0] >= 0 && pixel[1] >= 0 && pixel[0] <= view->width &&
           pixel[1] <= view->height;
}

struct count {
    uint64_t tiles, unseen, within_map, within_view;
};

static void check_tile(const struct pgm_tiles *tiles, const struct view *view, const struct terrain *terrain,
                       const struct pgm_sampler *sampler, const struct pgm_settings *settings,
                       const struct pgm_settings *used, const struct pgm_row *rows,
                       const struct pgm_tile *tile, uint64_t *seed, struct count *count)
{
    const double *outline = terrain_info(terrain)->outline_m;
    int way = pgm_tiles_way(tiles, view, terrain, tile);
    count->tiles++;
    count->unseen += way == PGM_UNSEEN;
    count->within_map += way != PGM_UNSEEN && way & PGM_WITHIN_MAP;
    count->within_view += way != PGM_UNSEEN && way & PGM_WITHIN_VIEW;
    double width = settings->law == PGM_LAW_FOCUS ? settings->focus_width / 2 : 0;
    for (int j = tile->row; j <= tile->row + tile->rows; j++)
        for (int i = tile->column; i <= tile->column + tile->columns; i++) {
            double x = pgm_mesh_across(settings->columns, 0.5 + 0.5 * settings->focus[0], width, i);
            x = (x + 1) * settings->columns / used->columns - 1; // the columns in use span the view
            double place[3] = {0, 0, test_uniform(seed, lowest_m, highest_m) - view->eye_m[2]};
            for (int axis = 0; axis < 2; axis++)
                place[axis] = sampler->forward[axis] * rows[j].forward_m +
                              sampler->right[axis] * rows[j].half_width_m * x;
            if (way == PGM_UNSEEN) {
                assert_false(is_seen(view, place));
                continue;
            }
            if (way & PGM_WITHIN_VIEW) assert_true(is_seen(view, place));
            if (way & PGM_WITHIN_MAP)
                for (int axis = 0; axis < 2; axis++) {
                    double at = place[axis] + view->eye_m[axis];
                    assert_true(at > outline[axis] && at < outline[axis + 2]);
                }
        }
}

static void test_ways_hold_for_every_vertex(void **state)
{
    (void)state;
    struct terrain *terrain = make_terrain();
    struct pgm_world world = make_world(terrain);
    uint64_t seed = 3;
    struct count count = {0};
    for (int k = 0; k < test_size(300, 20000); k++) {
        struct pgm_settings settings = {.rows = 1 + (int)(test_random(&seed) % 100),
                                        .columns = 1 + (int)(test_random(&seed) % 100),
                                        .camera = PGM_CAMERA_STABLE,
                                        .extension = PGM_EXTENSION_TIGHT,
                                        .law = (enum pgm_law)(test_random(&seed) % 4),
                                        .fall = PGM_FALL_STABLE,
                                        .lod = PGM_LOD_FLOOR,
                                        .widening = true,
                                        .focus = {0.3, -0.4},
                                        .focus_width = 0.3,
                                        .share = test_uniform(&seed, 0.2, 1),
                                        .strips = k % 2};
        static struct pgm_row rows[PGM_ROWS_MAX + 1];
        int mesh_rows = settings.strips ? 2 * settings.rows : settings.rows;
        struct view view = some_view(terrain, &seed);
        struct pgm_sampler sampler;
        struct pgm_settings used;
        struct pgm_tiles tiles;
        pgm_sampler_aim(&sampler, &view, &world, &settings);
        if (sampler.empty) continue;
        pgm_rows_fit(&sampler, &view, &world, &settings, mesh_rows, &used);
        pgm_rows_lay(&sampler, &view, &world, &used, rows);
        double width = settings.law == PGM_LAW_FOCUS ? settings.focus_width / 2 : 0;
        assert_true(
            pgm_tiles_init(&tiles, mesh_rows, settings.columns, 0.5 + 0.5 * settings.focus[0], width));
        pgm_tiles_look(&tiles, &view, &world, &sampler, &used, rows);
        for (int t = 0; t < pgm_mesh_tile_count(mesh_rows, settings.columns); t++) {
            struct pgm_tile tile = pgm_mesh_tile(mesh_rows, settings.columns, t);
            if (tile.row >= used.rows || tile.column >= used.columns) continue;
            check_tile(&tiles, &view, terrain, &sampler, &settings, &used, rows, &tile, &seed, &count);
        }
        pgm_tiles_finish(&tiles);
    }
    FIGURE("of %lu tiles %lu are outside the view, %lu wholly inside it, %lu wholly on the map", count.tiles,
           count.unseen, count.within_view, count.within_map);
    assert_true(count.unseen > 50 && count.within_view > 50 && count.within_map > 50);
    terrain_destroy(terrain);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_ways_hold_for_every_vertex)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
