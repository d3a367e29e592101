// B9: a flat world of 216,000 x 93,600 samples that is read where it is needed.  Flat to the bit, drawn to
// its outline and no farther, in every frame, wherever the viewer is.  SPDX-License-Identifier: MIT
#include "tests/gpu/test_clipmap.h"

#include "common/terrain/relief/relief_format.h"
#include "tests/folder.h"

static const struct relief_header world = {.layout = LAYOUT_BOUNDED,
                                           .size = {216000, 93600},
                                           .spacing_m = {30, 30},
                                           .quantum_m = 0.01,
                                           .min_q = 884886,
                                           .max_q = 884886,
                                           .name = "flat"};

// ---- the file: tiles of zeros have no bytes --------------------------------

static void put_sections(const struct relief_header *h, struct relief_bytes sections[3])
{
    struct grid grid;
    grid_init(&grid, h->size[0], h->size[1]);
    int top = grid.count - 1;
    for (int step = 0; step < 3 * top + 1; step++) relief_put_varint(&sections[0], 1);
    for (int64_t i = 0; i < grid.size[top][0] * grid.size[top][1]; i++)
        relief_put_difference(&sections[0], i == 0 ? h->min_q : 0);
    for (int64_t i = 0; i < grid.tile_count; i++) {
        const uint8_t exact = relief_error_code(0);
        relief_put_varint(&sections[1], 0);
        relief_put_difference(&sections[2], i == 0 ? h->min_q : 0);
        relief_put_varint(&sections[2], 0);
        relief_put(&sections[2], &exact, 1);
    }
}

static bool write_world(const char *path)
{
    struct relief_header h = world;
    struct relief_bytes sections[3] = {{.size = 0}};
    uint8_t bytes[RELIEF_HEADER];
    put_sections(&h, sections);
    h.base_bytes = sections[0].size, h.base_crc = relief_crc(sections[0].data, sections[0].size);
    h.index_bytes = sections[1].size, h.index_crc = relief_crc(sections[1].data, sections[1].size);
    h.side_bytes = sections[2].size, h.side_crc = relief_crc(sections[2].data, sections[2].size);
    relief_header_write(&h, bytes);
    FILE *file = fopen(path, "wb");
    bool good = file && fwrite(bytes, 1, sizeof bytes, file) == sizeof bytes;
    for (int i = 0; i < 3; i++) {
        good = good && !sections[i].full &&
               fwrite(sections[i].data, 1, sections[i].size, file) == sections[i].size;
        free(sections[i].data);
    }
    return file && fclose(file) == 0 && good;
}

static int make_world(void **state)
{
    return folder_create(state) == 0 && write_world(in_folder("flat.relief")) ? setup(state) : -1;
}

static int remove_world(void **state)
{
    return teardown(state) | folder_remove(state);
}

// ---- what should be seen ---------------------------------------------------

enum sight { INSIDE, OUTSIDE, AT_THE_RIM };

// Where the ray through a point of the picture meets the ground, relative to the eye; false: nowhere.
static bool meet(const struct view *view, double ground_m, double x_px, double y_px, double at[2])
{
    double direction[3];
    for (int axis = 0; axis < 3; axis++)
        direction[axis] = view->forward[axis] +
                          view->right[axis] * (2 * x_px / view->width - 1) * view->tan_half[0] +
                          view->up[axis] * (2 * y_px / view->height - 1) * view->tan_half[1];
    double depth = ground_m / direction[2];
    for (int axis = 0; axis < 2; axis++) at[axis] = direction[axis] * depth;
    return depth > 0 && isfinite(depth);
}

enum { SKY = 1 << 4 }; // and a bit for each side of the outline

// The sides that a place lies beyond; 0: it may be inside.  *inside: surely.
static unsigned sides_beyond(const double outline[4], const double at[2], double width, bool *inside)
{
    unsigned beyond = 0;
    *inside = true;
    for (int side = 0; side < 4; side++) {
        double within = (side < 2 ? 1 : -1) * (at[side & 1] - outline[side]);
        if (within < -width) beyond |= 1u << side;
        *inside = *inside && within > width;
    }
    return beyond;
}

// Of a pixel's centre and four points as far from it as the sub-pixel grid moves corners: all inside, all
// beyond one side of the outline or in the sky, or at the rim.  Interpolated places are good to 1e-4 of their
// distance (view_inside_outline).
static enum sight sight_of(const struct view *view, double ground_m, const double outline[4], int x, int y)
{
    const double grid_px = 1 / 128.0;
    unsigned beyond = ~0u;
    int inside = 0;
    for (int i = 0; i < 5; i++) {
        double at[2], to_x = i ? (i & 1 ? grid_px : -grid_px) : 0,
                      to_y = i ? (i & 2 ? grid_px : -grid_px) : 0;
        bool here = false;
        beyond &= meet(view, ground_m, x + 0.5 + to_x, y + 0.5 + to_y, at)
                      ? sides_beyond(outline, at, 1e-4 * hypot(hypot(at[0], at[1]), ground_m), &here)
                      : SKY;
        inside += here;
    }
    return inside == 5 ? INSIDE : beyond ? OUTSIDE : AT_THE_RIM;
}

// ---- what is seen ----------------------------------------------------------

struct tally {
    uint64_t frames, behind, vertices, lifted;          // lifted: vertices that are not at the ground
    uint64_t ground, undrawn, rim, drawn_beyond, given; // pixels; given: at a place beyond the outline
};

struct flat {
    float z; // of the first vertex
    uint64_t vertices, lifted;
};

static void check_flat(const float *triangles, size_t count, void *user)
{
    struct flat *flat = user;
    if (flat->vertices == 0 && count > 0) flat->z = triangles[2];
    for (size_t i = 2; i < 9 * count; i += 3) flat->lifted += triangles[i] != flat->z;
    flat->vertices += 3 * count;
}

// All vertices at one height, and that the ground's but for four roundings to float: a difference to the
// eye's whole quanta, one to what is left of it, the size of a quantum, and the product.
static void check_ground(struct fixture *f, struct renderer *renderer, const struct terrain *terrain,
                         const struct view *view, double ground_m, struct tally *tally)
{
    struct flat flat = {.vertices = 0};
    capture_chosen(f, renderer, terrain, view, check_flat, &flat);
    assert_true(flat.vertices == 0 || fabs((double)flat.z - ground_m) <= ldexp(fabs(ground_m), -22));
    tally->vertices += flat.vertices;
    tally->lifted += flat.lifted;
}

static void look(struct fixture *f, struct renderer *renderer, const struct terrain *terrain,
                 const struct view *view, struct tally *tally)
{
    double ground_m = (world.min_q - (double)view->eye_height / 256) * world.quantum_m, outline[4];
    for (int side = 0; side < 4; side++)
        outline[side] = terrain_info(terrain)->outline_m[side] - view->eye_m[side & 1];
    check_ground(f, renderer, terrain, view, ground_m, tally);
    draw_chosen(f, renderer, terrain, view);
    for (int p = 0; p < PIXELS; p++) {
        bool drawn = f->pixels[p][3] != 0;
        for (int axis = 0; drawn && axis < 2; axis++) { // the outline is rounded once, the place once
            double at = (double)f->pixels[p][axis];
            tally->given += at < outline[axis] - ldexp(fabs(outline[axis]), -23) ||
                            at > outline[axis + 2] + ldexp(fabs(outline[axis + 2]), -23);
        }
        enum sight sight = sight_of(view, ground_m, outline, p % WIDTH, p / WIDTH);
        tally->ground += sight == INSIDE;
        tally->rim += sight == AT_THE_RIM;
        tally->undrawn += sight == INSIDE && !drawn;
        tally->drawn_beyond += sight == OUTSIDE && drawn;
    }
    tally->frames++;
}

// ---- where the viewer is ---------------------------------------------------

// In turn over the map, about a corner of it, beyond its edge, and so high and far that all of it is in
// sight; looking anywhere, every other time towards the map's middle.
static struct view view_of_world(const struct terrain *terrain, int i, uint64_t *seed)
{
    const double *o = terrain_info(terrain)->outline_m;
    static const double away_m[4] = {0, 2e4, 1e6, 2e7};
    double height_m = 2 * pow(1e6, test_uniform(seed, 0, 1));
    struct camera camera = {.yaw = test_uniform(seed, -4, 4),
                            .pitch = test_uniform(seed, -1.5, 0.3),
                            .roll = test_uniform(seed, -0.5, 0.5),
                            .fov_vertical = test_uniform(seed, 0.5, 1.6)};
    for (int axis = 0; axis < 2; axis++) {
        bool upper = test_random(seed) & 1;
        camera.eye_m[axis] = i % 4 ? o[axis + 2 * upper] : test_uniform(seed, o[axis], o[axis + 2]);
        camera.eye_m[axis] += test_uniform(seed, -1, 1) * away_m[i % 4];
    }
    if (i % 4 == 3) height_m *= 10;
    if (i % 8 >= 4) {
        double x = (o[0] + o[2]) / 2 - camera.eye_m[0], y = (o[1] + o[3]) / 2 - camera.eye_m[1];
        camera.yaw = atan2(y, x);
        camera.pitch = -atan2(height_m, hypot(x, y));
    }
    camera.eye_m[2] = world.min_q * world.quantum_m + height_m;
    struct view view;
    view_init(&view, terrain, &camera, WIDTH, HEIGHT, 0);
    return view;
}

static void a_flat_world_is_flat_to_its_outline(void **state)
{
    struct fixture *f = *state;
    static const char *const settings[] = {"n=63", "n=255", "n=63 layout=strips stitch=zero-area",
                                           "n=31 regions=frustum sizes=error throttle=0.5",
                                           "n=127 budget=4000 ahead=8"};
    struct terrain_options options = {.cache_bytes = 32 << 20};
    struct terrain *terrain = terrain_load(in_folder("flat.relief"), &options);
    assert_non_null(terrain);
    assert_null(terrain_extrema(terrain)); // read on demand
    for (int s = 0; s < 5; s++) {
        struct renderer *renderer = create(f, terrain, settings[s]);
        struct tally tally = {.frames = 0};
        uint64_t seed = 9;
        int views = test_size(8, 200), frame = 0; // at full size: 1,000 in all
        for (int i = 0; i < views; i++) {
            struct view view = view_of_world(terrain, i, &seed);
            for (int late = 0; late < 4; late++) { // what is read arrives two frames later
                clipmap_renderer.begin_frame(renderer, frame++);
                assert_true(clipmap_renderer.update(renderer, &view, 1));
                tally.behind += counter(renderer, "levels_behind") > 0;
                if (late == 0 || late == 3) look(f, renderer, terrain, &view, &tally);
            }
        }
        FIGURE(
            "B9: 216000 x 93600 samples, flat, %s: %lu frames (%lu behind): %lu of %lu vertices lifted; of "
            "%lu pixels of ground %lu undrawn; %lu drawn beyond, %lu places given beyond; %lu at the rim",
            settings[s], tally.frames, tally.behind, tally.lifted, tally.vertices, tally.ground,
            tally.undrawn, tally.drawn_beyond, tally.given, tally.rim);
        assert_int_equal(tally.lifted, 0);
        assert_int_equal(tally.undrawn + tally.drawn_beyond + tally.given, 0);
        assert_true(tally.vertices > 0 && tally.behind > 0 && tally.rim < tally.ground / 100);
        clipmap_renderer.destroy(renderer);
    }
    FIGURE("B9: %.0f MiB hold the world", (double)terrain_resident_bytes(terrain) / (1 << 20));
    terrain_destroy(terrain);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(a_flat_world_is_flat_to_its_outline)};
    return cmocka_run_group_tests(tests, make_world, remove_world);
}
