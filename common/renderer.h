// The one contract that every terrain renderer fulfils.  The harness, the viewers and the tests see nothing
// else of clipmap/, geomipmap/ and pgm/; nothing is timed that is not verified through this same table.
//
// A frame:  begin_frame(n); update(views, count); draw(0, pass) ... draw(count-1, pass); stats().
// update() selects and uploads; draw() issues GL draws of what was selected for that view, in any pass, any
// number of times. Faces may be culled in the shaded and depth passes, never in the position pass: what is
// seen from below shows a crack. By default they are where nothing can drop out (enum renderer_faces). update
// and draw are timed apart.  Results depend on the frame number and the views alone, never on the clock,
// unless realtime. SPDX-License-Identifier: MIT
#ifndef COMMON_RENDERER_H
#define COMMON_RENDERER_H

#include "common/gl/gpu.h"

enum { RENDERER_MAX_VIEWS = 2, RENDERER_MAX_KNOBS = 32, RENDERER_MAX_COUNTERS = 24 };

// A knob: one number or one word out of `choices` (its value is then the word's index).
struct renderer_knob {
    const char *name;
    const char *help; // one line: unit and what it trades
    double fallback;  // the default
    double min, max;
    const char *choices; // "a|b|c", or NULL for a number
};

// Which faces are drawn in the shaded and depth passes: the knob `faces`, with words in this order.  The
// rasteriser culls by its snapped corners, as it fills, so a closed surface seen from above leaves no pixel
// undrawn without its back faces; but a triangle that is clipped gets new corners, rounded otherwise than its
// neighbours', and where it is nearly edge-on a pixel can drop out.  SAFE therefore culls what lies wholly
// inside the frustum (frustum_test_box: FRUSTUM_INSIDE), and that only while the eye is above the surface
// that is drawn at its place, which may be a coarse one.
enum renderer_faces { RENDERER_FACES_BOTH, RENDERER_FACES_SAFE, RENDERER_FACES_FRONT };
#define RENDERER_FACES_CHOICES "both|safe|front"
#define RENDERER_FACES_HELP                                                                                  \
    "triangles drawn: both sides of the surface, or only those that face the eye, where none is clipped or " \
    "everywhere (which may drop a pixel)"

struct renderer_desc {
    struct gpu *gpu;                     // borrowed until destroy
    const struct terrain *terrain;       // borrowed until destroy
    const struct scene_effects *effects; // borrowed until destroy
    int width, height;                   // pixels of the largest view
    bool realtime;                       // a viewer: what is drawn may depend on the clock
    double knobs[RENDERER_MAX_KNOBS];    // by index into type->knobs
};

struct renderer_counter { // a figure of the method's own, no time: cache hits, evictions, levels drawn ...
    const char *name;
    double value;
};

struct renderer_stats { // of this frame
    uint64_t
        triangles; // submitted by the last draw of view 0, stitches included, counted by the renderer itself
    double claimed_error_px; // what the method promises for this frame's view 0; NAN: it claims nothing
    uint64_t resident_bytes; // held in buffers and textures
    double select_ms;  // CPU time of the update that decided what to draw, uploads apart; 0: not told apart
    double prepare_ms; // wall time of create() for what it makes of the terrain, a light map; 0: nothing
    struct renderer_counter counters[RENDERER_MAX_COUNTERS]; // names NULL beyond the last
};

struct renderer {
    const struct renderer_type *type; // first member of each concrete renderer
};

struct renderer_type {
    const char *name;
    const char *summary;               // one line for --help and the report
    const struct renderer_knob *knobs; // ends with a NULL name
    const char *quality_knob;          // the one that a sweep turns; NULL: none
    const char *preset_knob; // one that stands in for the quality knob when it is turned; NULL: none
    // The quality knob's values, coarse to fine; each list ends with NAN.  A sweep starts where skylines are
    // less than 8 pixels off: beyond, what a coarse mesh misses counts as holes (reports/README.md).
    const double *quick, *full;
    bool spheres; // draws terrain on a sphere, too; others are not created for one
    struct renderer *(*create)(const struct renderer_desc *desc); // NULL after one line on stderr
    void (*begin_frame)(struct renderer *renderer, int frame);
    bool (*update)(struct renderer *renderer, const struct view *views,
                   int count); // false after one line on stderr
    void (*draw)(struct renderer *renderer, int view_index, enum render_pass pass);
    void (*stats)(const struct renderer *renderer, struct renderer_stats *stats);
    void (*destroy)(struct renderer *renderer); // accepts NULL and half-built objects
};

// Fills desc->knobs with the defaults.
void renderer_default_knobs(const struct renderer_type *type, double knobs[RENDERER_MAX_KNOBS]);
// Why a renderer cannot draw a terrain, in a word or two; NULL: it can.
const char *renderer_unsupported(const struct renderer_type *type, const struct terrain *terrain);
// Index of a knob, or -1.
int renderer_knob_index(const struct renderer_type *type, const char *name);
// Sets knobs[] from a word such as "127" or "safe"; false after one line on stderr that names the option.
bool renderer_parse_knob(const struct renderer_type *type, const char *name, const char *text,
                         double knobs[RENDERER_MAX_KNOBS]);
// Writes the value as its word or number.
void renderer_format_knob(const struct renderer_knob *knob, double value, char text[64]);

#endif
