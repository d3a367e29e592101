// The three renderers over a map on disk, a 64th of a world of 216,000 x 93,600 samples, under a small
// ceiling: no holes on the way, little memory, and at rest the picture that waiting gives.  And planets in
// memory, with their images: little memory, too.
// SPDX-License-Identifier: MIT
#include "clipmap/clipmap.h"
#include "common/scene/scene.h"
#include "common/terrain/relief/relief_pack.h"
#include "geomipmap/geomipmap.h"
#include "pgm/pgm.h"
#include "tests/folder.h"
#include "tests/gpu/settings.h"

enum { WIDTH = 320, HEIGHT = 240, CACHE_MIB = 8 };

static const struct {
    const struct renderer_type *type;
    const char *settings, *in_words;
} FLOWN[] = {{&clipmap_renderer, "n=127", "clipmap:n=127"},
             {&geomipmap_renderer, "tau=2", "geomipmap:tau=2"},
             {&pgm_renderer, "rows=300", "pgm:rows=300"}};
enum { RENDERERS = sizeof FLOWN / sizeof *FLOWN };

static int make_world(void **state)
{
    struct relief_pack_options options = {.layout = LAYOUT_BOUNDED, .max_m = 1};
    struct relief_source source;
    struct relief_header header;
    if (folder_create(state) != 0) return -1;
    FILE *spec = fopen(in_folder("world.json"), "w");
    if (!spec) return -1;
    fputs("{\"generate\": \"amplify\", \"source\": \"jacksboro\", \"levels\": 2, \"width\": 3375, "
          "\"height\": 1463}",
          spec);
    fclose(spec);
    if (!relief_source_open(&source, in_folder("world.json"), 0, NULL)) return -1;
    bool good = relief_pack_source(&source, &options, in_folder("world.relief"), &header);
    relief_source_finish(&source);
    return good ? 0 : -1;
}

// ---- on the way ------------------------------------------------------------

struct flown { // what `bench fly` said
    unsigned long long ground, holes;
    double process_mib, terrain_mib, renderer_mib;
};

static struct flown fly(const char *words)
{
    struct flown flown = {.holes = 1};
    const char *build = getenv("RELIEF_BUILD");
    char command[1024], line[1024];
    snprintf(command, sizeof command, "env -u DISPLAY -u WAYLAND_DISPLAY %s/bench fly %s",
             build ? build : "build", words);
    FILE *said = popen(command, "r");
    assert_non_null(said);
    while (fgets(line, sizeof line, said)) {
        sscanf(line, "  memory: process at most %lf MiB, terrain %lf, renderer %lf", &flown.process_mib,
               &flown.terrain_mib, &flown.renderer_mib);
        sscanf(line, "  %*d frames held against the truth: %llu pixels of ground, holes %llu", &flown.ground,
               &flown.holes);
    }
    assert_int_equal(pclose(said), 0);
    return flown;
}

static void flights_are_whole(void **state)
{
    (void)state;
    for (int r = 0; r < RENDERERS; r++) {
        char words[512];
        snprintf(words, sizeof words,
                 "--terrain %s --cache-mib %d --frames %d --look %d --size %dx%d --renderers %s",
                 in_folder("world.relief"), CACHE_MIB, test_size(25, 1000), test_size(8, 10), WIDTH, HEIGHT,
                 FLOWN[r].in_words);
        struct flown flown = fly(words);
        FIGURE(
            "%s over 3375 x 1463 samples on disk, %d MiB kept: process %.0f MiB, terrain %.1f, holes %llu of "
            "%llu pixels",
            FLOWN[r].in_words, CACHE_MIB, flown.process_mib, flown.terrain_mib, flown.holes, flown.ground);
        assert_true(flown.ground > 10000);
        assert_int_equal(flown.holes, 0);
        assert_true(flown.terrain_mib <=
                    CACHE_MIB + 1.5); // beside the ceiling: 14 bytes a tile, descriptions
        assert_true(flown.process_mib < 400);
    }
}

// A map of 79 million samples: nothing is said of memory, and no more is taken than README.md tells.
static void little_memory_is_taken_unasked(void **state)
{
    (void)state;
    FILE *file = fopen(in_folder("finer.json"), "w");
    assert_true(file && fputs("{\"name\": \"finer\", \"terrain\": {\"file\": \"world.relief\", "
                              "\"synthesize_levels\": 2}}",
                              file) >= 0);
    fclose(file);
    for (int r = 0; r < RENDERERS; r++) {
        char words[512];
        snprintf(words, sizeof words,
                 "--scene %s --frames %d --look 0 --search 0 --size %dx%d --renderers %s",
                 in_folder("finer.json"), test_size(25, 1000), WIDTH, HEIGHT, FLOWN[r].in_words);
        struct flown flown = fly(words);
        FIGURE("%s over 13497 x 5849 samples, nothing said of memory: process %.0f MiB, terrain %.1f, "
               "renderer %.1f",
               FLOWN[r].in_words, flown.process_mib, flown.terrain_mib, flown.renderer_mib);
        assert_true(flown.terrain_mib <= 64 + 1.5);
        assert_true(flown.renderer_mib <= 32 + 2); // textures; vertices of the grid
        assert_true(flown.process_mib < 400);
    }
}

// Their maps and images are in memory, the latter as textures alone.
static void planets_are_flown_in_little_memory(void **state)
{
    (void)state;
    const struct {
        const char *scene, *terrain, *colour;
    } PLANETS[] = {{"earth", "earth_etopo5_4320x2161.png", "earth_colour_4096x2048.png"},
                   {"mars", "mars_mola_4ppd_1440x720.png", "mars_colour_2880x1440.png"},
                   {"earth_ground", "earth_etopo5_4320x2161.png", "earth_colour_4096x2048.png"},
                   {"earth_space", "earth_etopo5_4320x2161.png", "earth_colour_4096x2048.png"}};
    for (int k = 0; k < test_size(1, 4); k++) {
        char path[1024], words[512];
        if (!test_data(PLANETS[k].terrain, path) || !test_data(PLANETS[k].colour, path)) return;
        snprintf(words, sizeof words,
                 "--scene bench/scenes/%s.json --frames %d --look 8 --search 4 --renderers clipmap:n=127",
                 PLANETS[k].scene, test_size(4, 48));
        struct flown flown = fly(words);
        FIGURE("%s at the scene's size: process %.0f MiB, terrain %.1f, holes %llu of %llu pixels",
               PLANETS[k].scene, flown.process_mib, flown.terrain_mib, flown.holes, flown.ground);
        assert_true(flown.ground > 10000);
        assert_int_equal(flown.holes, 0);
        assert_true(flown.process_mib < 400);
    }
}

// ---- at rest ---------------------------------------------------------------

struct fixture {
    struct gpu *gpu;
    struct gpu_target target;
    uint8_t *pictures[2];
};

static void draw_frame(struct fixture *f, const struct scene *scene, struct renderer *renderer, int frame,
                       const struct view *view, uint8_t *picture)
{
    renderer->type->begin_frame(renderer, frame);
    assert_true(renderer->type->update(renderer, view, 1));
    gpu_set_view(f->gpu, scene->terrain, view);
    gpu_target_begin(f->gpu, &f->target);
    renderer->type->draw(renderer, 0, PASS_SHADED);
    if (picture) gpu_target_read(f->gpu, &f->target, picture);
}

static struct scene *open_world(int64_t frame_samples)
{
    char text[256];
    FILE *file = fopen(in_folder("scene.json"), "w");
    snprintf(text, sizeof text,
             "{\"name\": \"world\", \"terrain\": {\"file\": \"world.relief\", \"cache_mib\": %d, "
             "\"frame_samples\": %lld}}",
             CACHE_MIB, (long long)frame_samples);
    assert_true(file && fputs(text, file) >= 0);
    fclose(file);
    struct scene *scene = scene_load(in_folder("scene.json"), NULL, WIDTH, HEIGHT);
    assert_non_null(scene);
    return scene;
}

// Flies to a place with what arrives late, rests there, and looks.
static void look_at_rest(struct fixture *f, int r, int64_t frame_samples, int from, int to, uint8_t *picture)
{
    enum { FRAMES = 300, REST = 120 };
    struct scene *scene = open_world(frame_samples);
    struct renderer_desc desc = {.gpu = f->gpu,
                                 .terrain = scene->terrain,
                                 .effects = &scene->effects,
                                 .width = WIDTH,
                                 .height = HEIGHT};
    struct renderer *renderer = create_with(FLOWN[r].type, desc, FLOWN[r].settings);
    struct view view;
    for (int frame = from; frame <= to; frame++) {
        scene_view(scene, frame, FRAMES, &view);
        draw_frame(f, scene, renderer, frame, &view, NULL);
    }
    for (int k = 1; k <= REST; k++) draw_frame(f, scene, renderer, to + k, &view, k == REST ? picture : NULL);
    FLOWN[r].type->destroy(renderer);
    scene_destroy(scene);
}

static void at_rest_nothing_is_missing(void **state)
{
    (void)state;
    struct fixture f = {.gpu = gpu_create(GPU_OFFSCREEN, WIDTH, HEIGHT, "test", 0)};
    assert_non_null(f.gpu);
    assert_true(gpu_target_init(f.gpu, &f.target, WIDTH, HEIGHT, GL_RGBA8));
    for (int k = 0; k < 2; k++) f.pictures[k] = malloc((size_t)WIDTH * HEIGHT * 4);
    for (int r = 0; r < RENDERERS; r++)
        for (int place = 0; place < test_size(1, 6); place++) {
            int to = 60 + 40 * place;
            look_at_rest(&f, r, 8 * 128 * 128, to - 10, to, f.pictures[0]);
            look_at_rest(&f, r, -1, to, to, f.pictures[1]); // waits for all there is
            assert_memory_equal(f.pictures[0], f.pictures[1], (size_t)WIDTH * HEIGHT * 4);
        }
    for (int k = 0; k < 2; k++) free(f.pictures[k]);
    gpu_target_finish(&f.target);
    assert_int_equal(gpu_debug_errors(f.gpu), 0);
    gpu_destroy(f.gpu);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(flights_are_whole),
        cmocka_unit_test(little_memory_is_taken_unasked),
        cmocka_unit_test(planets_are_flown_in_little_memory),
        cmocka_unit_test(at_rest_nothing_is_missing),
    };
    return cmocka_run_group_tests(tests, make_world, folder_remove);
}
