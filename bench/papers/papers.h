// `bench papers`: tables of the papers, measured again beside the printed figures.
//
// One function a table: it lays out the columns and the printed figures, measures its own, and says in notes
// what differs from the paper's set-up.  A table whose data is missing says why and is kept in the output. To
// add one, write the function and give it a line in papers.c.
//
//   papers.c               the list of tables, options, the order of work
//   table.c                a table as text, JSON and HTML
//   flight.c               timed flights of renderers
//   meter.h, motion.c      truth and error of one view; what moves on the screen
//   clipmap.c, mars.c      Losasso & Hoppe 2004; geometry clipmapping for Mars
//   compression.c          what both papers print of their coders
//   coders.c               the coder beside other people's
//   geomipmap.c, pgm.c     Brodersen 2005; Livny et al. 2008
//   sphere.c, sphere_knobs.c   Clasen & Hege 2006
// SPDX-License-Identifier: MIT
#ifndef BENCH_PAPERS_PAPERS_H
#define BENCH_PAPERS_PAPERS_H

#include "bench/report/parts.h"
#include "common/renderer.h"
#include "common/scene/scene.h"

enum { PAPERS_COLUMNS = 8, PAPERS_ROWS = 40, PAPERS_NOTES = 10, PAPERS_SEED = 1 };

struct papers_table { // starts zeroed
    char id[32], paper[96], title[160], row_name[48];
    struct papers_column {
        char name[32], unit[32];
        bool printed; // a figure of the paper
    } columns[PAPERS_COLUMNS];
    struct papers_row {
        char label[96];
        double values[PAPERS_COLUMNS]; // NAN: not printed, or not measured
    } rows[PAPERS_ROWS];
    char notes[PAPERS_NOTES][640];
    int column_count, row_count, note_count;
    char skipped[256]; // why there is nothing measured; empty otherwise
};

// The fixed sizes are those of the largest table; callers stay within them.
int papers_column(struct papers_table *table, const char *name, const char *unit, bool printed);
double *papers_row(struct papers_table *table, const char *format, ...) __attribute__((format(printf, 2, 3)));
void papers_note(struct papers_table *table, const char *format, ...) __attribute__((format(printf, 2, 3)));

// Both end with a newline.  The text is aligned in characters.
void papers_table_text(const struct papers_table *table, struct text *out);
void papers_table_html(const struct papers_table *table, struct text *page);
cJSON *papers_table_json(const struct papers_table *table);

// ---- measuring ---------------------------------------------------------------------------------

struct papers { // what every table may use
    struct gpu *gpu;
    int repeats;         // timed flights of each setting; stages of an update are repeated 50 times as often
    bool cpu_times;      // software rasteriser: times are CPU time of the GL thread, else wall time
    int width, height;   // pixels
    struct scene *scene; // made by papers_detailed_scene
};

// The built-in terrain with four synthesised levels, shaded by the renderer itself, a path and a horizontal
// view angle of 90 degrees. Made once; NULL after one line on stderr.
struct scene *papers_detailed_scene(struct papers *papers);
// Wraps a terrain, which it then owns, likewise; NULL after one line on stderr.
struct scene *papers_scene(const struct papers *papers, struct terrain *terrain);
// DIR/name of $RELIEF_DATA, or NULL with the reason in table->skipped.
const char *papers_data(struct papers_table *table, const char *name, char path[1024]);

double papers_clock_ms(const struct papers *papers);

struct papers_flight { // one setting over a whole path
    const struct renderer_type *type;
    const char *knobs[10];               // name, value, name, value ... NULL
    int samples;                         // a pixel; 0: one
    double frame_ms, update_ms, draw_ms; // measured: median over frames of the minimum over repeats
    double select_ms;                    // mean over the timed frames
    double triangles;                    // mean a frame, as submitted
    double triangles_per_s;
    struct renderer_stats stats;                             // of the last frame
    struct renderer_counter counters[RENDERER_MAX_COUNTERS]; // mean over the timed frames
};
// Flies all settings once untimed, then `repeats` times in seeded random order.
bool papers_fly(const struct papers *papers, const struct scene *scene, int frames,
                struct papers_flight *flights,
                int count); // false after one line on stderr

// Errors against the truth over `looks` frames of the whole path, and how far drawn ground moves on the
// screen, the camera's motion taken out, while the eye goes on from each by 1 / steps of the way to the next:
// popping and swimming.  False after one line on stderr.
struct papers_motion {
    double error_mean_px, error_p999_px;
    double mean_px, p999_px, max_px;
};
bool papers_look(const struct papers *papers, const struct scene *scene, const struct papers_flight *flight,
                 int looks, int steps, struct papers_motion *motion);

// A counter by its name; NAN: there is none.
double papers_counter(const struct renderer_counter *counters, const char *name);

// |PL(T_level) - PL(T_finest)| in quanta at every finest sample, as Losasso & Hoppe 2004 define e_l in
// section 9. errors has room for terrain_info()->samples.
void papers_level_errors(const struct terrain *terrain, int level, double *errors_q);

// Times of decoding 255 x 255 samples of the Puget Sound set from a .relief file, the coarser level being
// there, at `count` random places, for Table 1 of Losasso & Hoppe 2004; times[0] is NAN where the set is
// missing.  False after one line on stderr.
bool papers_decompression(struct papers *papers, double *times, int count);

// ---- the tables --------------------------------------------------------------------------------

// Each returns false after one line on stderr; a skipped table is no failure.
typedef bool papers_measure(struct papers *papers, struct papers_table *table);
papers_measure papers_clipmap_update, papers_clipmap_error, papers_clipmap_rate; // Losasso & Hoppe 2004
papers_measure papers_clipmap_space, papers_clipmap_compression, papers_clipmap_filter, papers_coders,
    papers_clipmap_apart, papers_mars_compression, papers_mars_growth;          // compression.c
papers_measure papers_mars_rendering;                                           // Mars, Table 3
papers_measure papers_sphere_views, papers_sphere_kept, papers_sphere_sampling; // Clasen & Hege 2006
papers_measure papers_geomipmap_sets, papers_geomipmap_rate, papers_geomipmap_work, papers_geomipmap_motion,
    papers_geomipmap_large; // Brodersen 2005
papers_measure papers_pgm_rates, papers_pgm_steps, papers_pgm_extension, papers_pgm_distortion,
    papers_pgm_error, papers_pgm_angles, papers_pgm_updates, papers_pgm_culled; // Livny et al. 2008

extern const struct renderer_type immediate_renderer; // mars.c: every vertex handed over anew each frame

int papers_main(int argc, char **argv); // the subcommand; returns the exit code

#endif
