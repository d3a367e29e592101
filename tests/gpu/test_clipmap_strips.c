// The published index layout, four rectangles cropped to the frustum and drawn in strips: the picture of the
// default layout, bit for bit, and nothing dropped.
// SPDX-License-Identifier: MIT
#include "tests/gpu/test_clipmap.h"

static const int sizes[] = {15, 31, 63, 127, 255};
enum { SIZES = sizeof sizes / sizeof *sizes };

// Anywhere over the map, sometimes below the ground or beyond the map.
static struct view any_view(const struct terrain *terrain, uint64_t *seed, int i)
{
    const struct terrain_info *info = terrain_info(terrain);
    struct view view = view_through(terrain, seed, 0.2, 20000, 0.1, 1.6);
    if (i % 5 == 4) view.eye_height -= (int64_t)test_uniform(seed, 0, 300 * 10 * 256); // up to 300 m lower
    if (i % 7 == 6) view.eye_lattice[0] += (int64_t)ldexp(test_uniform(seed, -3e3, 3e3), view.lattice_bits);
    view.eye_m[0] = (double)view.eye_lattice[0] * ldexp(info->spacing_m[0], -view.lattice_bits);
    view.eye_m[2] = (double)view.eye_height * info->quantum_m / 256 + info->offset_m;
    return view;
}

static uint64_t drawn_triangles(const struct renderer *renderer)
{
    struct renderer_stats stats;
    clipmap_renderer.stats(renderer, &stats);
    return stats.triangles;
}

// What the last draw sent down the pipeline, beside what the renderer says.
static void expect_triangles(struct fixture *f, struct renderer *renderer)
{
    GLuint query, generated = 0;
    glGenQueries(1, &query);
    gpu_reset_counters(f->gpu);
    glBeginQuery(GL_PRIMITIVES_GENERATED, query);
    clipmap_renderer.draw(renderer, 0, PASS_DEPTH);
    glEndQuery(GL_PRIMITIVES_GENERATED);
    glGetQueryObjectuiv(query, GL_QUERY_RESULT, &generated);
    glDeleteQueries(1, &query);
    assert_int_equal(generated, drawn_triangles(renderer));
    assert_int_equal(generated, gpu_counters(f->gpu).triangles);
}

static void strips_draw_the_picture_of_blocks(void **state)
{
    struct fixture *f = *state;
    struct terrain *terrain = test_terrain(&hills);
    static const char *const layouts[] = {"", "layout=strips", "layout=strips cull=off"};
    for (int s = 0; s < SIZES; s++)
        for (int split = 0; split < 2; split++) {
            const char *stitch = split ? "split" : "zero-area";
            struct renderer *renderers[3];
            for (int r = 0; r < 3; r++) {
                char settings[64];
                snprintf(settings, sizeof settings, "n=%d stitch=%s %s", sizes[s], stitch, layouts[r]);
                renderers[r] = create(f, terrain, settings);
            }
            uint64_t seed = 61 + (uint64_t)split, triangles[3] = {0, 0, 0};
            struct drops drops = {0, 0, 0};
            int views = test_size(sizes[s] < 100 ? 10 : 7, 200); // 2,000 in all
            for (int i = 0; i < views; i++) {
                struct view view = any_view(terrain, &seed, i);
                uint64_t pictures[3];
                for (int r = 0; r < 3; r++) {
                    draw(f, renderers[r], terrain, &view);
                    pictures[r] = picture_hash(f);
                    triangles[r] += drawn_triangles(renderers[r]);
                }
                assert_int_equal(pictures[0], pictures[1]);
                assert_int_equal(pictures[0], pictures[2]);
                expect_triangles(f, renderers[1]);
                if (i % 5 != 4 && i % 7 != 6) count_drops(f, renderers[1], terrain, &view, &drops);
            }
            FIGURE("strips, n=%d, stitch=%s: %d views alike; cropping leaves %.3f of the triangles, culled "
                   "blocks have %.3f of the strips'; %lu and %lu pixels dropped in %lu views",
                   sizes[s], stitch, views, (double)triangles[1] / (double)triangles[2],
                   (double)triangles[0] / (double)triangles[1], drops.position, drops.depth, drops.views);
            assert_int_equal(drops.position, 0);
            if (split) assert_int_equal(drops.depth, 0);
            assert_true(triangles[1] < triangles[2]);
            for (int r = 0; r < 3; r++) clipmap_renderer.destroy(renderers[r]);
        }
    terrain_destroy(terrain);
}

struct sum {
    uint64_t value, count, repeating;
};

// Of the hashes of triangles: whatever their order.  Those that repeat a vertex are left out.
static void sum_triangles(const float *triangles, size_t count, void *user)
{
    struct sum *sum = user;
    const size_t vertex = 3 * sizeof *triangles;
    for (const float *t = triangles; t < triangles + 9 * count; t += 9) {
        bool repeating =
            !memcmp(t, t + 3, vertex) || !memcmp(t + 3, t + 6, vertex) || !memcmp(t, t + 6, vertex);
        sum->repeating += repeating;
        if (repeating) continue;
        sum->value += hash(1, t, 3 * vertex);
        sum->count++;
    }
}

static void strips_are_the_triangles_of_blocks(void **state)
{
    struct fixture *f = *state;
    struct terrain *terrain = test_terrain(&hills);
    for (int s = 0; s < SIZES; s++)
        for (int split = 0; split < 2; split++) {
            char settings[64];
            const char *stitch = split ? "split" : "zero-area";
            snprintf(settings, sizeof settings, "n=%d stitch=%s cull=off", sizes[s], stitch);
            struct renderer *blocks = create(f, terrain, settings);
            snprintf(settings, sizeof settings, "n=%d stitch=%s cull=off layout=strips", sizes[s], stitch);
            struct renderer *strips = create(f, terrain, settings);
            uint64_t seed = 62;
            for (int i = 0; i < test_size(3, 100); i++) {
                struct view view = any_view(terrain, &seed, i);
                struct sum sums[2] = {{0, 0, 0}, {0, 0, 0}};
                capture(f, blocks, terrain, &view, sum_triangles, &sums[0]);
                capture(f, strips, terrain, &view, sum_triangles, &sums[1]);
                assert_int_equal(sums[0].value, sums[1].value);
                assert_int_equal(sums[0].count, sums[1].count);
                assert_int_equal(sums[1].count + sums[1].repeating, drawn_triangles(strips));
                assert_int_equal(sums[0].repeating, 0);
            }
            clipmap_renderer.destroy(blocks);
            clipmap_renderer.destroy(strips);
        }
    terrain_destroy(terrain);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(strips_draw_the_picture_of_blocks),
        cmocka_unit_test(strips_are_the_triangles_of_blocks),
    };
    return cmocka_run_group_tests(tests, setup, teardown);
}
