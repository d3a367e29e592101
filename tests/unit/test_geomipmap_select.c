// What is selected of a view: nothing visible is missing, borders agree, and the claim holds for everything
// that is seen.
// SPDX-License-Identifier: MIT
#include "geomipmap/geomipmap_select.h"
#include "tests/unit/test_geomipmap.h"

#include <string.h>

static struct terrain *make_fractal(uint64_t seed, double height_m)
{
    const struct test_map map = {.width = 257,
                                 .height = 237,
                                 .first = {-100, -30},
                                 .spacing_m = {30, 20},
                                 .quantum_m = 0.1,
                                 .offset_m = 12,
                                 .height_m = height_m,
                                 .rough = 0.55};
    return test_fractal(&map, seed);
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

// Vertex (i, j) of a tile, where i and j count samples of the finest level, relative to the eye.
static void vertex_relative(const struct geomipmap_tiles *tiles, const struct view *view,
                            struct geomipmap_place place, int i, int j, double height_q, double out[3])
{
    int64_t size = (int64_t)1 << (tiles->bits + place.height);
    out[0] = (double)(tiles->x0 + place.column * size + i) * tiles->spacing_m[0] - view->eye_m[0];
    out[1] = (double)(tiles->y0 + place.row * size + j) * tiles->spacing_m[1] - view->eye_m[1];
    out[2] = height_q * tiles->quantum_m + tiles->offset_m - view->eye_m[2];
}

static bool in_window(const struct view *view, const double relative[3])
{
    double pixel[2];
    return view_project(view, relative, pixel) && pixel[0] >= 0 && pixel[1] >= 0 && pixel[0] <= view->width &&
           pixel[1] <= view->height;
}

struct scene {
    struct terrain *terrain;
    struct geomipmap_mesh mesh;
    struct geomipmap_tiles tiles;
    struct geomipmap_selection selection;
};

static struct scene make_scene(uint64_t seed, int merge, double height_m)
{
    struct scene s = {.terrain = make_fractal(seed, height_m)};
    assert_true(geomipmap_mesh_init(&s.mesh, 4, GEOMIPMAP_ADD, false));
    assert_true(geomipmap_tiles_init(&s.tiles, s.terrain, 4, merge, GEOMIPMAP_STABLE, false, 1));
    assert_true(geomipmap_selection_init(&s.selection));
    return s;
}

static void use_borders(struct scene *s, enum geomipmap_borders borders)
{
    geomipmap_mesh_finish(&s->mesh);
    assert_true(geomipmap_mesh_init(&s->mesh, 4, borders, false));
}

static void finish_scene(struct scene *s)
{
    geomipmap_selection_finish(&s->selection);
    geomipmap_tiles_finish(&s->tiles);
    geomipmap_mesh_finish(&s->mesh);
    terrain_destroy(s->terrain);
}

// By tile of height 0: which pick covers it; -1: none.  Picks never overlap.
static void index_picks(const struct scene *s, int count, int *pick_of)
{
    const struct geomipmap_grid *grid = &s->tiles.grid[0];
    for (int i = 0; i < grid->columns * grid->rows; i++) pick_of[i] = -1;
    for (int k = 0; k < count; k++) {
        struct geomipmap_place place = s->selection.picks[k].place;
        int size = 1 << place.height;
        for (int j = place.row * size; j < (place.row + 1) * size && j < grid->rows; j++)
            for (int i = place.column * size; i < (place.column + 1) * size && i < grid->columns; i++) {
                assert_int_equal(pick_of[j * grid->columns + i], -1);
                pick_of[j * grid->columns + i] = k;
            }
    }
}

enum { MAX_TILES = 100000 };

static void nothing_visible_is_missing(void **state)
{
    (void)state;
    static int pick_of[MAX_TILES];
    uint64_t seed = 2, drawn = 0, hidden = 0;
    int32_t heights[17 * 17];
    for (int merge = 0; merge <= 3; merge++) {
        struct scene s = make_scene(1, merge, 1500);
        const struct geomipmap_choice choice = {.metric = GEOMIPMAP_SAFE, .tau_px = 1, .cull = true};
        for (int k = 0; k < test_size(60, 600); k++) {
            struct view view = random_view(s.terrain, &seed);
            assert_true(geomipmap_select(&s.selection, &s.tiles, &choice, &view));
            index_picks(&s, s.selection.seen, pick_of);
            drawn += (uint64_t)s.selection.seen;
            for (int tile = 0; tile < s.tiles.grid[0].columns * s.tiles.grid[0].rows; tile++) {
                if (pick_of[tile] >= 0) continue;
                hidden++;
                struct geomipmap_place place = {0, tile % s.tiles.grid[0].columns,
                                                tile / s.tiles.grid[0].columns};
                geomipmap_tiles_read(&s.tiles, NULL, place, NULL, heights);
                for (int v = 0; v < 17 * 17; v++) {
                    double relative[3];
                    vertex_relative(&s.tiles, &view, place, v % 17, v / 17, heights[v], relative);
                    assert_false(in_window(&view, relative));
                }
            }
        }
        finish_scene(&s);
    }
    FIGURE("%llu tiles drawn, %llu small tiles culled, no visible vertex among these",
           (unsigned long long)drawn, (unsigned long long)hidden);
    assert_true(drawn > 0 && hidden > 0);
}

// ---- borders and order --------------------------------------------------------------------------

// The vertices of every drawn border, in samples of the finest level: both tiles must draw the same ones.
// Each pick marks those on its four sides, once for the tiles to the south or west of the line and once for
// those beyond.
static void mark_borders(const struct scene *s, const struct geomipmap_pick *pick, uint8_t *marks, int row)
{
    const struct geomipmap_part *set = &s->mesh.parts[pick->set];
    int cells = 1 << s->tiles.bits, step = 1 << pick->place.height;
    int x0 = pick->place.column * cells * step, y0 = pick->place.row * cells * step;
    for (int i = 0; i < set->count; i++) {
        int v = s->mesh.indices[set->first + (size_t)i], x = v % (cells + 1), y = v / (cells + 1);
        uint8_t *mark = &marks[(size_t)(y0 + y * step) * (size_t)row + (size_t)(x0 + x * step)];
        if (x == 0) *mark |= 1;
        if (x == cells) *mark |= 2;
        if (y == 0) *mark |= 4;
        if (y == cells) *mark |= 8;
    }
}

static void drawn_neighbours_agree_on_their_border(void **state)
{
    (void)state;
    static int pick_of[MAX_TILES];
    uint64_t seed = 5, vertices = 0, merged = 0, picks = 0;
    for (int merge = -1; merge <= 3; merge++) { // -1: removing, of what is seen
        struct scene s = make_scene(3, merge < 0 ? 0 : merge, 500);
        enum geomipmap_borders borders = merge < 0 ? GEOMIPMAP_REMOVE : GEOMIPMAP_ADD;
        if (merge < 0) use_borders(&s, borders);
        const struct geomipmap_grid *grid = &s.tiles.grid[0];
        int row = (grid->columns + 8) * 16 + 1, rows = (grid->rows + 8) * 16 + 1;
        uint8_t *marks = malloc((size_t)row * (size_t)rows);
        assert_non_null(marks);
        for (int k = 0; k < test_size(60, 600); k++) {
            struct view view = random_view(s.terrain, &seed);
            const struct geomipmap_choice choice = {.metric = GEOMIPMAP_SAFE,
                                                    .tau_px = 0.5 * (1 << k % 5),
                                                    .cull = k % 2 == 0,
                                                    .borders = borders};
            assert_true(geomipmap_select(&s.selection, &s.tiles, &choice, &view));
            memset(marks, 0, (size_t)row * (size_t)rows);
            int count = merge < 0 ? s.selection.seen : s.selection.count;
            index_picks(&s, count, pick_of);
            for (int i = 0; i < count; i++) {
                mark_borders(&s, &s.selection.picks[i], marks, row);
                merged += s.selection.picks[i].place.height > 0;
                picks++;
            }
            for (int j = 1; j < grid->rows * 16; j++)
                for (int i = 1; i < grid->columns * 16; i++) {
                    uint8_t mark = marks[(size_t)j * (size_t)row + (size_t)i];
                    if (mark == 0) continue;
                    // Only borders between two picks, and no corners of four tiles.
                    int west = pick_of[j / 16 * grid->columns + (i - 1) / 16],
                        east = pick_of[j / 16 * grid->columns + i / 16],
                        south = pick_of[(j - 1) / 16 * grid->columns + i / 16],
                        north = pick_of[j / 16 * grid->columns + i / 16];
                    if (j % 16 != 0 && i % 16 == 0 && west != east && west >= 0 && east >= 0) {
                        assert_int_equal(mark & 3, 3);
                        vertices++;
                    }
                    if (i % 16 != 0 && j % 16 == 0 && south != north && south >= 0 && north >= 0) {
                        assert_int_equal(mark & 12, 12);
                        vertices++;
                    }
                }
        }
        free(marks);
        finish_scene(&s);
    }
    FIGURE("%llu vertices on borders of %llu tiles, %llu of them merged: none on one side only",
           (unsigned long long)vertices, (unsigned long long)picks, (unsigned long long)merged);
    assert_true(vertices > 0 && merged > 0);
}

// What is seen is drawn the same whether tiles outside the frustum are listed or not.
static void culling_changes_nothing_that_is_seen(void **state)
{
    (void)state;
    uint64_t seed = 21;
    for (int merge = 0; merge <= 3; merge++) {
        struct scene on = make_scene(9, merge, 1500), off = make_scene(9, merge, 1500);
        for (int k = 0; k < 40; k++) {
            struct view view = random_view(on.terrain, &seed);
            const struct geomipmap_choice culled = {.metric = GEOMIPMAP_SAFE, .tau_px = 1, .cull = true},
                                          all = {.metric = GEOMIPMAP_SAFE, .tau_px = 1, .cull = false};
            assert_true(geomipmap_select(&on.selection, &on.tiles, &culled, &view));
            assert_true(geomipmap_select(&off.selection, &off.tiles, &all, &view));
            assert_int_equal(on.selection.seen, off.selection.seen);
            for (int i = 0; i < on.selection.seen; i++) {
                const struct geomipmap_pick *a = &on.selection.picks[i], *b = &off.selection.picks[i];
                assert_memory_equal(&a->place, &b->place, sizeof a->place);
                assert_int_equal(a->set, b->set);
            }
            static int pick_of[MAX_TILES]; // all of the map is listed
            index_picks(&off, off.selection.count, pick_of);
            for (int i = 0; i < off.tiles.grid[0].columns * off.tiles.grid[0].rows; i++)
                assert_true(pick_of[i] >= 0);
        }
        finish_scene(&on);
        finish_scene(&off);
    }
}

// A tile may hide another only if it comes before it: along both axes it lies between the eye and that
// tile.
static void tiles_come_front_to_back(void **state)
{
    (void)state;
    static int pick_of[MAX_TILES];
    uint64_t seed = 7, pairs = 0;
    for (int merge = 0; merge <= 3; merge++) {
        struct scene s = make_scene(4, merge, 1500);
        int columns = s.tiles.grid[0].columns, rows = s.tiles.grid[0].rows;
        const struct geomipmap_choice choice = {.metric = GEOMIPMAP_SAFE, .tau_px = 2, .cull = true};
        for (int k = 0; k < 30; k++) {
            struct view view = random_view(s.terrain, &seed);
            assert_true(geomipmap_select(&s.selection, &s.tiles, &choice, &view));
            index_picks(&s, s.selection.seen, pick_of);
            double eye[2];
            for (int axis = 0; axis < 2; axis++)
                eye[axis] = floor(
                    (view.eye_m[axis] / s.tiles.spacing_m[axis] - (double)(axis ? s.tiles.y0 : s.tiles.x0)) /
                    (1 << s.tiles.bits));
            for (int tile = 0; tile < columns * rows; tile++) {
                int x = tile % columns, y = tile / columns;
                int dx = x > eye[0] ? -1 : x < eye[0] ? 1 : 0, dy = y > eye[1] ? -1 : y < eye[1] ? 1 : 0;
                int steps[3][2] = {{dx, 0}, {0, dy}, {dx, dy}};
                for (int n = 0; n < 3 && pick_of[tile] >= 0; n++) {
                    int nx = x + steps[n][0], ny = y + steps[n][1];
                    if (nx < 0 || ny < 0 || nx >= columns || ny >= rows) continue;
                    int nearer = pick_of[ny * columns + nx];
                    if (nearer < 0 || nearer == pick_of[tile]) continue;
                    assert_true(nearer < pick_of[tile]);
                    pairs++;
                }
            }
        }
        finish_scene(&s);
    }
    FIGURE("%llu pairs of tiles in order", (unsigned long long)pairs);
    assert_true(pairs > 0);
}

// ---- the claim ----------------------------------------------------------------------------------

// Error on the screen at the samples under one drawn triangle, where either surface is seen.  heights: all
// samples of the finest level in the tile, `row` in a row; x, y: the triangle's corners among them.
static double triangle_error(const struct scene *s, const struct view *view, struct geomipmap_place place,
                             const int32_t *heights, int row, const int x[3], const int y[3])
{
    int low[2] = {row, row}, high[2] = {0, 0};
    for (int k = 0; k < 3; k++) {
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
            double height = (1 - b - c) * heights[y[0] * row + x[0]] + b * heights[y[1] * row + x[1]] +
                            c * heights[y[2] * row + x[2]];
            vertex_relative(&s->tiles, view, place, i, j, heights[j * row + i], truth);
            vertex_relative(&s->tiles, view, place, i, j, height, drawn);
            if (!in_window(view, truth) && !in_window(view, drawn)) continue;
            view_project_vertical(view, truth[0], truth[1], truth[2], drawn[2], &length);
            worst = fmax(worst, length);
        }
    return worst;
}

static double worst_error(const struct scene *s, const struct view *view)
{
    static int32_t heights[129 * 129];
    double worst = 0;
    for (int k = 0; k < s->selection.seen; k++) {
        const struct geomipmap_pick *pick = &s->selection.picks[k];
        const struct geomipmap_part *set = &s->mesh.parts[pick->set];
        int vertices = (1 << s->tiles.bits) + 1, step = 1 << pick->place.height;
        int64_t size = (int64_t)(vertices - 1) * step;
        terrain_window(s->terrain, s->tiles.finest, s->tiles.x0 + pick->place.column * size,
                       s->tiles.y0 + pick->place.row * size, (int)size + 1, (int)size + 1, heights,
                       TERRAIN_WAIT);
        for (int i = 0; i < set->count; i += 3) {
            const uint16_t *index = s->mesh.indices + set->first + i;
            int x[3], y[3];
            for (int n = 0; n < 3; n++) x[n] = index[n] % vertices * step, y[n] = index[n] / vertices * step;
            worst = fmax(worst, triangle_error(s, view, pick->place, heights, (int)size + 1, x, y));
        }
    }
    return worst;
}

static void safe_claim_holds_and_paper_breaks(void **state)
{
    (void)state;
    static const char *const names[] = {"paper", "depth", "safe"};
    int views = test_size(100, 1000);
    for (int merge = 0; merge <= 3; merge += 3)
        for (int metric = 0; metric < 3; metric++) {
            struct scene s = make_scene(6, merge, merge ? 300 : 1500);
            uint64_t seed = 12, triangles = 0;
            double tightness = 0, most = 0;
            int broken = 0;
            for (int k = 0; k < views; k++) {
                const struct geomipmap_choice choice = {
                    .metric = (enum geomipmap_metric)metric, .tau_px = 0.25 * (1 << k % 6), .cull = true};
                struct view view = random_view(s.terrain, &seed);
                assert_true(geomipmap_select(&s.selection, &s.tiles, &choice, &view));
                double share = worst_error(&s, &view) / choice.tau_px;
                broken += share > 1 + 1e-9;
                tightness += share / views;
                most = fmax(most, share);
                for (int i = 0; i < s.selection.seen; i++)
                    triangles += (uint64_t)s.mesh.parts[s.selection.picks[i].set].count / 3;
            }
            FIGURE("merge %d, metric %s: claim broken in %d of %d views, worst error %.2f of tau on average, "
                   "at most "
                   "%.2f, %llu triangles a view",
                   merge, names[metric], broken, views, tightness, most,
                   (unsigned long long)triangles / (unsigned)views);
            if (metric == GEOMIPMAP_SAFE) assert_int_equal(broken, 0);
            if (metric == GEOMIPMAP_PAPER) assert_true(broken > 0);
            finish_scene(&s);
        }
}

// ---- hysteresis ---------------------------------------------------------------------------------

// Step that is drawn of every tile of height 0; GEOMIPMAP_NOTHING where none is.
static void list_steps(const struct scene *s, uint8_t *steps)
{
    static int pick_of[MAX_TILES];
    index_picks(s, s->selection.seen, pick_of);
    for (int tile = 0; tile < s->tiles.grid[0].columns * s->tiles.grid[0].rows; tile++) {
        const struct geomipmap_pick *pick = &s->selection.picks[pick_of[tile] < 0 ? 0 : pick_of[tile]];
        steps[tile] = pick_of[tile] < 0 ? GEOMIPMAP_NOTHING : (uint8_t)(pick->place.height + pick->level);
    }
}

// Coming into the picture is no switch.
static bool switched(uint8_t before, uint8_t now)
{
    return before != now && before != GEOMIPMAP_NOTHING && now != GEOMIPMAP_NOTHING;
}

static bool same_steps(struct scene *s, const struct geomipmap_choice *choice, const struct view *a,
                       const struct view *b)
{
    static uint8_t steps[2][MAX_TILES];
    for (int i = 0; i < 2; i++) {
        assert_true(geomipmap_select(&s->selection, &s->tiles, choice, i ? b : a));
        list_steps(s, steps[i]);
    }
    for (int tile = 0; tile < s->tiles.grid[0].columns * s->tiles.grid[0].rows; tile++)
        if (switched(steps[0][tile], steps[1][tile])) return false;
    return true;
}

static struct view lifted(const struct scene *s, const struct camera *camera, double metres)
{
    struct camera moved = *camera;
    struct view view;
    moved.eye_m[2] += metres;
    view_init(&view, s->terrain, &moved, 640, 480, 0);
    return view;
}

// Finds a height above the camera's at which a tile changes its level, to the last bit of the eye's place.
static bool find_switch(struct scene *s, const struct geomipmap_choice *choice, const struct camera *camera,
                        double *height)
{
    double low = 0;
    *height = 300;
    struct view a = lifted(s, camera, low), b = lifted(s, camera, *height);
    if (same_steps(s, choice, &a, &b)) return false;
    for (int i = 0; i < 60; i++) {
        double middle = (low + *height) / 2;
        b = lifted(s, camera, middle);
        if (same_steps(s, choice, &a, &b))
            low = middle;
        else
            *height = middle;
    }
    return true;
}

// C6: a camera that trembles by a few of its smallest steps around a switch.
static void hysteresis_stops_flicker(void **state)
{
    (void)state;
    enum { FRAMES = 100 };
    static uint8_t now[MAX_TILES], before[MAX_TILES], plain[MAX_TILES];
    static int switches[MAX_TILES];
    int worst[2] = {0, 0};
    uint64_t seed = 31, finer = 0, shown = 0;
    for (int merge = 0; merge <= 3; merge += 3)
        for (int k = 0; k < test_size(6, 60); k++) {
            struct scene s = make_scene(10, merge, 1500);
            struct geomipmap_choice choice = {.metric = GEOMIPMAP_SAFE, .tau_px = 2, .cull = true};
            int tiles = s.tiles.grid[0].columns * s.tiles.grid[0].rows;
            const double *o = terrain_info(s.terrain)->outline_m;
            struct camera camera;
            double height;
            do
                camera =
                    (struct camera){{test_uniform(&seed, o[0], o[2]), test_uniform(&seed, o[1], o[3]), 3000},
                                    test_uniform(&seed, -3, 3),
                                    -0.7,
                                    0,
                                    1.2};
            while (!find_switch(&s, &choice, &camera, &height));
            for (int on = 0; on < 2; on++) {
                uint64_t tremble = 32;
                choice.hysteresis = on ? 0.1 : 0;
                geomipmap_selection_restart(&s.selection);
                memset(switches, 0, sizeof switches);
                for (int frame = 0; frame < FRAMES; frame++) {
                    // The eye stands on a lattice, so that it moves by more than 1e-6 m or not at all.
                    struct view view = lifted(&s, &camera, height + test_uniform(&tremble, -1e-2, 1e-2));
                    if (on) { // what hysteresis draws is never coarser
                        const struct geomipmap_choice off = {
                            .metric = GEOMIPMAP_SAFE, .tau_px = 2, .cull = true};
                        struct geomipmap_selection kept = s.selection;
                        assert_true(geomipmap_selection_init(&s.selection));
                        assert_true(geomipmap_select(&s.selection, &s.tiles, &off, &view));
                        list_steps(&s, plain);
                        geomipmap_selection_finish(&s.selection);
                        s.selection = kept;
                    }
                    assert_true(geomipmap_select(&s.selection, &s.tiles, &choice, &view));
                    list_steps(&s, now);
                    for (int tile = 0; tile < tiles; tile++) {
                        if (frame > 0) switches[tile] += switched(before[tile], now[tile]);
                        if (frame == 0 || now[tile] != GEOMIPMAP_NOTHING) before[tile] = now[tile];
                        if (on) assert_true(now[tile] <= plain[tile]);
                        if (on) finer += now[tile] < plain[tile], shown++;
                        worst[on] = switches[tile] > worst[on] ? switches[tile] : worst[on];
                    }
                }
            }
            finish_scene(&s);
        }
    FIGURE(
        "%d frames around a switch: a tile switches at most %d times, with hysteresis %d; %.3f %% of tiles "
        "are finer for it",
        FRAMES, worst[0], worst[1], 100.0 * (double)finer / (double)shown);
    assert_true(worst[0] > 1);
    assert_true(worst[1] <= 1);
}

static void same_view_same_selection(void **state)
{
    (void)state;
    struct scene fresh = make_scene(8, 2, 1500), used = make_scene(8, 2, 1500);
    const struct geomipmap_choice choice = {.metric = GEOMIPMAP_SAFE, .tau_px = 1, .cull = true};
    uint64_t seed = 13;
    struct view view = random_view(fresh.terrain, &seed);
    assert_true(geomipmap_select(&fresh.selection, &fresh.tiles, &choice, &view));
    for (int k = 0; k < 20; k++) {
        struct view other = random_view(used.terrain, &seed);
        assert_true(geomipmap_select(&used.selection, &used.tiles, &choice, &other));
    }
    assert_true(
        geomipmap_select(&used.selection, &used.tiles, &choice, &view)); // nothing of the others is left
    assert_int_equal(fresh.selection.count, used.selection.count);
    for (int i = 0; i < fresh.selection.count; i++) {
        const struct geomipmap_pick *a = &fresh.selection.picks[i], *b = &used.selection.picks[i];
        assert_memory_equal(&a->place, &b->place, sizeof a->place);
        assert_int_equal(a->set, b->set);
    }
    finish_scene(&fresh);
    finish_scene(&used);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(nothing_visible_is_missing),
        cmocka_unit_test(drawn_neighbours_agree_on_their_border),
        cmocka_unit_test(culling_changes_nothing_that_is_seen),
        cmocka_unit_test(tiles_come_front_to_back),
        cmocka_unit_test(safe_claim_holds_and_paper_breaks),
        cmocka_unit_test(hysteresis_stops_flicker),
        cmocka_unit_test(same_view_same_selection),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
