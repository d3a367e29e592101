// What is selected of a view: nothing visible is missing, borders agree, and the claim holds for everything
// that is seen. SPDX-License-Identifier: MIT
#include "geomipmap/geomipmap_select.h"
#include "tests/test.h"

#include <string.h>

enum { SIDE = 257 };

// Midpoint displacement over a square map.
static struct terrain *make_fractal(uint64_t seed, double height_m)
{
    static double z[SIDE * SIDE];
    static int32_t samples[SIDE * SIDE];
    double amplitude = height_m;
    memset(z, 0, sizeof z);
    for (int step = SIDE - 1; step >= 1; step /= 2, amplitude *= 0.55)
        for (int j = 0; j < SIDE; j += step)
            for (int i = 0; i < SIDE; i += step) {
                int a = i / (2 * step) * 2 * step, b = j / (2 * step) * 2 * step;
                int c = i == a ? a : a + 2 * step, d = j == b ? b : b + 2 * step;
                if (step < SIDE - 1 && i == a && j == b) continue;
                double mean =
                    step == SIDE - 1
                        ? 0
                        : (z[b * SIDE + a] + z[b * SIDE + c] + z[d * SIDE + a] + z[d * SIDE + c]) / 4;
                z[j * SIDE + i] = mean + test_uniform(&seed, -amplitude, amplitude);
            }
    for (int k = 0; k < SIDE * SIDE; k++) samples[k] = (int32_t)lround(z[k] / 0.1);
    const struct terrain_grid grid = {.name = "fractal",
                                      .samples = samples,
                                      .width = SIDE,
                                      .height = SIDE - 20,
                                      .first = {-100, -30},
                                      .spacing_m = {30, 20},
                                      .quantum_m = 0.1,
                                      .offset_m = 12};
    struct terrain *terrain = terrain_from_grid(&grid, &(struct terrain_options){0});
    assert_non_null(terrain);
    return terrain;
}

static struct view random_view(const struct terrain *terrain, uint64_t *seed)
{
    const struct terrain_info *info = terrain_info(terrain);
    const double *outline = info->outline_m;
    double x = test_uniform(seed, outline[0] - 500, outline[2] + 500);
    double y = test_uniform(seed, outline[1] - 500, outline[3] + 500), ground = 0;
    terrain_truth_at(terrain, x, y, &ground, NULL);
    const struct camera camera = {
        {x, y, ground * info->quantum_m + info->offset_m + exp(test_uniform(seed, 0, 7))},
        test_uniform(seed, -3.2, 3.2),
        test_uniform(seed, -1.5, 0.5),
        test_uniform(seed, -1, 1),
        test_uniform(seed, 0.3, 2)};
    struct view view;
    view_init(&view, terrain, &camera, 640, 480, 0);
    return view;
}

// Sample (i, j) of a tile, relative to the eye.
static void vertex_relative(const struct geomipmap_tiles *tiles, const struct view *view, int tile, int i,
                            int j, double height_q, double out[3])
{
    int cells = 1 << tiles->bits;
    int64_t x = tiles->x0 + (int64_t)(tile % tiles->tiles.columns) * cells + i;
    int64_t y = tiles->y0 + (int64_t)(tile / tiles->tiles.columns) * cells + j;
    out[0] = (double)x * tiles->spacing_m[0] - view->eye_m[0];
    out[1] = (double)y * tiles->spacing_m[1] - view->eye_m[1];
    out[2] = height_q * tiles->quantum_m + tiles->offset_m - view->eye_m[2];
}

static bool in_window(const struct view *view, const double relative[3])
{
    double pixel[2];
    return view_project(view, relative, pixel) && pixel[0] >= 0 && pixel[1] >= 0 && pixel[0] <= view->width &&
           pixel[1] <= view->height;
}

static void nothing_visible_is_missing(void **state)
{
    (void)state;
    struct terrain *terrain = make_fractal(1, 1500);
    struct geomipmap_tiles tiles;
    struct geomipmap_selection selection;
    assert_true(geomipmap_tiles_init(&tiles, terrain, 4, GEOMIPMAP_STABLE, 1));
    assert_true(geomipmap_selection_init(&selection, &tiles));
    const struct geomipmap_choice choice = {GEOMIPMAP_SAFE, 1, true};
    uint64_t seed = 2, drawn = 0, hidden = 0;
    int32_t heights[17 * 17];
    for (int k = 0; k < test_size(60, 600); k++) {
        struct view view = random_view(terrain, &seed);
        geomipmap_select(&selection, &tiles, &choice, &view);
        drawn += (uint64_t)selection.count;
        for (int tile = 0; tile < selection.tile_count; tile++) {
            if (selection.level[tile] != GEOMIPMAP_NOT_DRAWN) continue;
            hidden++;
            geomipmap_tiles_read(&tiles, tile, heights);
            for (int v = 0; v < 17 * 17; v++) {
                double relative[3];
                vertex_relative(&tiles, &view, tile, v % 17, v / 17, heights[v], relative);
                assert_false(in_window(&view, relative));
            }
        }
    }
    FIGURE("%llu tiles drawn, %llu culled, no visible vertex among these", (unsigned long long)drawn,
           (unsigned long long)hidden);
    assert_true(drawn > 0 && hidden > 0);
    geomipmap_selection_finish(&selection);
    geomipmap_tiles_finish(&tiles);
    terrain_destroy(terrain);
}

// ---- borders and order
// ----------------------------------------------------------------------------------------------

// The levels that a set was made for.
static void decode_set(int level, int set, int neighbours[GEOMIPMAP_SIDES])
{
    const int zero[GEOMIPMAP_SIDES] = {0};
    int code = set - geomipmap_mesh_set(level, zero);
    for (int side = 0; side < GEOMIPMAP_SIDES; side++, code /= level + 1)
        neighbours[side] = code % (level + 1);
}

static void drawn_neighbours_agree_on_their_border(void **state)
{
    (void)state;
    struct terrain *terrain = make_fractal(3, 1500);
    struct geomipmap_tiles tiles;
    struct geomipmap_selection selection;
    assert_true(geomipmap_tiles_init(&tiles, terrain, 4, GEOMIPMAP_STABLE, 1));
    assert_true(geomipmap_selection_init(&selection, &tiles));
    uint64_t seed = 5, borders = 0, differing = 0;
    static int set_of[100000];
    for (int k = 0; k < test_size(60, 600); k++) {
        struct view view = random_view(terrain, &seed);
        const struct geomipmap_choice choice = {GEOMIPMAP_SAFE, 2, k % 2 == 0};
        geomipmap_select(&selection, &tiles, &choice, &view);
        if (!choice.cull) assert_int_equal(selection.count, selection.tile_count);
        for (int i = 0; i < selection.count; i++) set_of[selection.picks[i].tile] = selection.picks[i].set;
        for (int i = 0; i < selection.count; i++) {
            int tile = selection.picks[i].tile, level = selection.picks[i].level, own[4];
            const int beside[4] = {-tiles.tiles.columns, 1, tiles.tiles.columns, -1};
            decode_set(level, set_of[tile], own);
            for (int side = 0; side < GEOMIPMAP_SIDES; side++) {
                int other = tile + beside[side], theirs[4];
                bool edge = side == GEOMIPMAP_EAST   ? tile % tiles.tiles.columns == tiles.tiles.columns - 1
                            : side == GEOMIPMAP_WEST ? tile % tiles.tiles.columns == 0
                                                     : other < 0 || other >= selection.tile_count;
                if (edge || selection.level[other] == GEOMIPMAP_NOT_DRAWN) {
                    assert_int_equal(own[side], level);
                    continue;
                }
                decode_set(selection.level[other], set_of[other], theirs);
                assert_int_equal(own[side], theirs[(side + 2) % 4]); // both draw the finer level's vertices
                borders++;
                differing += selection.level[other] != level;
            }
        }
    }
    FIGURE("%llu borders, %llu between different levels", (unsigned long long)borders,
           (unsigned long long)differing);
    assert_true(differing > 0);
    geomipmap_selection_finish(&selection);
    geomipmap_tiles_finish(&tiles);
    terrain_destroy(terrain);
}

// A tile may hide another only if it comes before it: along both axes it lies between the eye and that tile.
static void tiles_come_front_to_back(void **state)
{
    (void)state;
    struct terrain *terrain = make_fractal(4, 1500);
    struct geomipmap_tiles tiles;
    struct geomipmap_selection selection;
    assert_true(geomipmap_tiles_init(&tiles, terrain, 4, GEOMIPMAP_STABLE, 1));
    assert_true(geomipmap_selection_init(&selection, &tiles));
    const struct geomipmap_choice choice = {GEOMIPMAP_SAFE, 2, true};
    uint64_t seed = 7;
    static int order[100000];
    for (int k = 0; k < 30; k++) {
        struct view view = random_view(terrain, &seed);
        geomipmap_select(&selection, &tiles, &choice, &view);
        for (int i = 0; i < selection.count; i++) order[selection.picks[i].tile] = i;
        double eye[2];
        for (int axis = 0; axis < 2; axis++)
            eye[axis] =
                floor((view.eye_m[axis] / tiles.spacing_m[axis] - (double)(axis ? tiles.y0 : tiles.x0)) /
                      (1 << tiles.bits));
        for (int i = 0; i < selection.count; i++) {
            int tile = selection.picks[i].tile, columns = tiles.tiles.columns;
            int x = tile % columns, y = tile / columns;
            int dx = x > eye[0] ? -1 : x < eye[0] ? 1 : 0, dy = y > eye[1] ? -1 : y < eye[1] ? 1 : 0;
            int steps[3][2] = {{dx, 0}, {0, dy}, {dx, dy}};
            for (int s = 0; s < 3; s++) {
                int nx = x + steps[s][0], ny = y + steps[s][1], nearer = ny * columns + nx;
                if (nearer == tile || nx < 0 || ny < 0 || nx >= columns || ny >= tiles.tiles.rows) continue;
                if (selection.level[nearer] == GEOMIPMAP_NOT_DRAWN) continue;
                assert_true(order[nearer] < order[tile]);
            }
        }
    }
    geomipmap_selection_finish(&selection);
    geomipmap_tiles_finish(&tiles);
    terrain_destroy(terrain);
}

// ---- the claim
// ------------------------------------------------------------------------------------------------------

// Error on the screen at the fine vertices under one drawn triangle, where either surface is seen.
static double triangle_error(const struct geomipmap_tiles *tiles, const struct view *view, int tile,
                             const int32_t *heights, const uint16_t v[3])
{
    int row = (1 << tiles->bits) + 1, x[3], y[3], low[2] = {row, row}, high[2] = {0, 0};
    for (int k = 0; k < 3; k++) {
        x[k] = v[k] % row, y[k] = v[k] / row;
        low[0] = x[k] < low[0] ? x[k] : low[0], high[0] = x[k] > high[0] ? x[k] : high[0];
        low[1] = y[k] < low[1] ? y[k] : low[1], high[1] = y[k] > high[1] ? y[k] : high[1];
    }
    double worst = 0, area = (x[1] - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (y[1] - y[0]);
    for (int j = low[1]; j <= high[1]; j++)
        for (int i = low[0]; i <= high[0]; i++) {
            double b = ((i - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (j - y[0])) / area;
            double c = ((x[1] - x[0]) * (j - y[0]) - (i - x[0]) * (y[1] - y[0])) / area;
            if (b < 0 || c < 0 || b + c > 1) continue;
            double truth[3], drawn[3], length;
            double height = (1 - b - c) * heights[v[0]] + b * heights[v[1]] + c * heights[v[2]];
            vertex_relative(tiles, view, tile, i, j, heights[j * row + i], truth);
            vertex_relative(tiles, view, tile, i, j, height, drawn);
            if (!in_window(view, truth) && !in_window(view, drawn)) continue;
            view_project_vertical(view, truth[0], truth[1], truth[2], drawn[2], &length);
            worst = fmax(worst, length);
        }
    return worst;
}

static double worst_error(const struct geomipmap_tiles *tiles, const struct geomipmap_mesh *mesh,
                          const struct geomipmap_selection *selection, const struct view *view)
{
    static int32_t heights[65 * 65];
    double worst = 0;
    for (int k = 0; k < selection->count; k++) {
        const struct geomipmap_pick *pick = &selection->picks[k];
        const struct geomipmap_set *set = &mesh->sets[pick->set];
        if (pick->level == 0) continue; // exact
        geomipmap_tiles_read(tiles, pick->tile, heights);
        for (int i = 0; i < set->count; i += 3)
            worst =
                fmax(worst, triangle_error(tiles, view, pick->tile, heights, mesh->indices + set->first + i));
    }
    return worst;
}

static void safe_claim_holds_and_paper_breaks(void **state)
{
    (void)state;
    static const char *const names[] = {"paper", "depth", "safe"};
    int views = test_size(120, 1200), broken[3] = {0}, bits = 4;
    double tightness[3] = {0};
    uint64_t triangles[3] = {0};
    struct terrain *terrain = make_fractal(6, 1500);
    struct geomipmap_mesh mesh;
    struct geomipmap_tiles tiles;
    struct geomipmap_selection selection;
    assert_true(geomipmap_mesh_init(&mesh, bits));
    assert_true(geomipmap_tiles_init(&tiles, terrain, bits, GEOMIPMAP_STABLE, 1));
    assert_true(geomipmap_selection_init(&selection, &tiles));
    for (int metric = 0; metric < 3; metric++) {
        uint64_t seed = 12;
        for (int k = 0; k < views; k++) {
            const struct geomipmap_choice choice = {(enum geomipmap_metric)metric, 0.25 * (1 << k % 6), true};
            struct view view = random_view(terrain, &seed);
            geomipmap_select(&selection, &tiles, &choice, &view);
            double worst = worst_error(&tiles, &mesh, &selection, &view);
            broken[metric] += worst > choice.tau_px * (1 + 1e-9);
            tightness[metric] += worst / choice.tau_px / views;
            for (int i = 0; i < selection.count; i++)
                triangles[metric] += (uint64_t)mesh.sets[selection.picks[i].set].count / 3;
        }
        FIGURE("metric %s: claim broken in %d of %d views, worst error %.2f of tau on average, %llu "
               "triangles a view",
               names[metric], broken[metric], views, tightness[metric],
               (unsigned long long)triangles[metric] / (unsigned)views);
    }
    assert_int_equal(broken[GEOMIPMAP_SAFE], 0);
    assert_true(broken[GEOMIPMAP_PAPER] > 0);
    geomipmap_selection_finish(&selection);
    geomipmap_tiles_finish(&tiles);
    geomipmap_mesh_finish(&mesh);
    terrain_destroy(terrain);
}

static void same_view_same_selection(void **state)
{
    (void)state;
    struct terrain *terrain = make_fractal(8, 800);
    struct geomipmap_tiles tiles;
    struct geomipmap_selection fresh, used;
    assert_true(geomipmap_tiles_init(&tiles, terrain, 5, GEOMIPMAP_STABLE, 1));
    assert_true(geomipmap_selection_init(&fresh, &tiles));
    assert_true(geomipmap_selection_init(&used, &tiles));
    const struct geomipmap_choice choice = {GEOMIPMAP_SAFE, 1, true};
    uint64_t seed = 13;
    struct view view = random_view(terrain, &seed);
    geomipmap_select(&fresh, &tiles, &choice, &view);
    for (int k = 0; k < 20; k++) {
        struct view other = random_view(terrain, &seed);
        geomipmap_select(&used, &tiles, &choice, &other);
    }
    geomipmap_select(&used, &tiles, &choice, &view); // nothing of the other views is left
    assert_int_equal(fresh.count, used.count);
    assert_memory_equal(fresh.picks, used.picks, (size_t)fresh.count * sizeof *fresh.picks);
    assert_memory_equal(fresh.level, used.level, (size_t)fresh.tile_count);
    geomipmap_selection_finish(&fresh);
    geomipmap_selection_finish(&used);
    geomipmap_tiles_finish(&tiles);
    terrain_destroy(terrain);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(nothing_visible_is_missing),
        cmocka_unit_test(drawn_neighbours_agree_on_their_border),
        cmocka_unit_test(tiles_come_front_to_back),
        cmocka_unit_test(safe_claim_holds_and_paper_breaks),
        cmocka_unit_test(same_view_same_selection),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
