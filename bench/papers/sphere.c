// Clasen & Hege 2006, section 5.2: the three views of Earth, from the ground, an aircraft and space, with and
// without the view-frustum culling that section 6.1 leaves to the future.
// SPDX-License-Identifier: MIT
#include "bench/papers/sphere.h"
#include "clipmap/clipmap.h"
#include "common/report.h"

#include <math.h>
#include <stdio.h>

static const char EARTH[] = "earth_etopo5_4320x2161.png";
static const double DEGREE = M_PI / 180;
enum { FINER_LEVELS = 14, FRAMES = 8 };

// Lake Garda from the south east, as in Figures 15 to 17; the first and the last frame.
static const struct printed_view {
    const char *label;
    double longitude[2], latitude[2], height_m, yaw, pitch;
    double frames_s, triangles_million, levels; // printed
} views[PAPERS_SPHERE_VIEWS] = {
    {"ground", {10.86, 10.8599}, {45.42, 45.4202}, 1.7, 120, 2, 25, 5.2, 16},
    {"aircraft", {11.05, 10.8}, {45.2, 45.45}, 10000, 125, -18, 40, 2.3, 7},
    {"space", {11.5, 9.5}, {44, 46}, 2e6, 110, -75, 65, 1.3, 4},
};

bool papers_sphere_scene(const struct papers *papers, struct terrain *earth, enum papers_sphere_view number,
                         bool still, int frames, struct scene *scene)
{
    const struct printed_view *view = &views[number];
    double radius_m = terrain_info(earth)->radius_m;
    struct path_key keys[2];
    for (int k = 0; k < 2; k++) {
        int place = still ? 0 : k;
        keys[k] = (struct path_key){.x_m = view->longitude[place] * DEGREE * radius_m,
                                    .y_m = view->latitude[place] * DEGREE * radius_m,
                                    .height_m = view->height_m,
                                    .above_ground = true,
                                    .yaw = (view->yaw + (still ? 60 * k : 0)) * DEGREE,
                                    .pitch = view->pitch * DEGREE};
    }
    *scene = (struct scene){.terrain = earth,
                            .width = papers->width,
                            .height = papers->height,
                            .fov_vertical = 2 * atan((double)papers->height / papers->width)};
    scene->path = path_from_keys(earth, keys, 2, frames, 1.2, scene->fov_vertical);
    return scene->path != NULL;
}

const char *papers_sphere_label(enum papers_sphere_view view)
{
    return views[view].label;
}

bool papers_sphere_earth(struct papers_table *table, struct terrain **earth)
{
    char path[1024];
    *earth = NULL;
    if (!papers_data(table, EARTH, path)) return true;
    *earth =
        terrain_load(path, &(struct terrain_options){.synthesize_levels = FINER_LEVELS, .seed = PAPERS_SEED});
    return *earth != NULL;
}

static bool view_rows(struct papers *papers, struct terrain *earth, enum papers_sphere_view number,
                      struct papers_table *table)
{
    const struct printed_view *view = &views[number];
    struct papers_flight flights[2] = {{.type = &clipmap_renderer, .knobs = {"n", "255"}},
                                       {.type = &clipmap_renderer, .knobs = {"n", "255", "cull", "off"}}};
    struct scene scene;
    bool good = papers_sphere_scene(papers, earth, number, false, FRAMES, &scene) &&
                papers_fly(papers, &scene, FRAMES, flights, 2);
    path_destroy(scene.path);
    for (int f = 0; f < 2 && good; f++) {
        double *values =
            papers_row(table, "%s, %g m%s", view->label, view->height_m, f ? ", without culling" : "");
        if (f) values[0] = view->frames_s, values[2] = view->triangles_million;
        values[1] = 1000 / flights[f].frame_ms;
        values[3] = flights[f].triangles * 1e-6;
        values[4] = view->levels;
        values[5] = papers_counter(flights[f].stats.counters, "levels drawn");
        values[6] = flights[f].triangles / flights[1].triangles;
        values[7] = flights[1].frame_ms / flights[f].frame_ms;
    }
    return good;
}

bool papers_sphere_views(struct papers *papers, struct papers_table *table)
{
    static const char *const names[] = {"frames", "frames", "triangles", "triangles",
                                        "levels", "levels", "share",     "gain"};
    static const char *const units[] = {"1/s", "1/s", "million", "million", "", "", "of vertices", "in time"};
    struct terrain *earth = NULL;
    snprintf(table->title, sizeof table->title,
             "Lake Garda from the ground, an aircraft and space: frame time against height above ground");
    snprintf(table->row_name, sizeof table->row_name, "view, height above ground");
    for (int c = 0; c < 8; c++) papers_column(table, names[c], units[c], c < 6 && c % 2 == 0);
    if (!papers_sphere_earth(table, &earth)) return false;
    if (!earth) return true;
    bool good = true;
    for (int v = 0; v < PAPERS_SPHERE_VIEWS && good; v++)
        good = view_rows(papers, earth, (enum papers_sphere_view)v, table);
    terrain_destroy(earth);
    papers_note(table,
                "Printed: 512 azimuths, 1280 x 960 pixels, GeForce 6800, no culling; here 512 azimuths, %d x "
                "%d pixels, 90 degrees wide, %s. The paper's map has 43200 x 21600 samples; here 4320 x 2161 "
                "and %d levels of synthesised detail down to 0.6 m.",
                papers->width, papers->height, gpu_info(papers->gpu)->renderer, FINER_LEVELS);
    papers_note(table, "The printed counts of triangles are 16 times 2 x 512 x 20 a level, for 16, 7 and 4 "
                       "levels (section 5.2); here an octave of rings is of triangles as long as wide, "
                       "and rings whose triangles are less than a pixel are a disc of pixel-sized ones.");
    papers_note(table, "Share: triangles with culling over those without; gain: the frame times' ratio. The "
                       "paper expects 8 from culling at 90 degrees.");
    return good;
}
