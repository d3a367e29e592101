// SPDX-License-Identifier: MIT
#include "clipmap/clipmap.h"

#include "clipmap/clipmap_fit.h"
#include "clipmap/clipmap_select.h"
#include "clipmap/clipmap_shading.h"
#include "clipmap/sphere.h"
#include "common/report.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

enum {
    KNOB_N,
    KNOB_TRANSITION,
    KNOB_ALPHA,
    KNOB_STITCH,
    KNOB_LAYOUT,
    KNOB_FADE,
    KNOB_CULL,
    KNOB_FACES,
    KNOB_REFILL,
    KNOB_BUDGET,
    KNOB_THROTTLE,
    KNOB_AHEAD,
    KNOB_REGIONS,
    KNOB_SIZES,
    KNOB_NORMALS,
    KNOB_ANISOTROPY,
    KNOB_TRIGONOMETRY,
    KNOB_KEEP,
    KNOB_TEXTURE,
    KNOB_COLOURS,
    KNOB_FETCH
};

enum { N_MIN = 15, N_MAX = 1023 };

static const struct renderer_knob knobs[] = {
    {"n", "samples on a side of a level, odd: more is finer and slower", 255, N_MIN, N_MAX, NULL},
    {"transition", "width of the morph to the coarser level, as a share of n", 0.05, 0, 0.5, NULL},
    {"alpha", "morph parameter: as published, or right for cropped regions too", CLIPMAP_ALPHA_STABLE, 0, 1,
     "published|stable"},
    {"stitch",
     "how T-junctions between levels are closed: not, as published, or by splitting the coarse edges",
     CLIPMAP_STITCH_SPLIT, 0, 2, "none|zero-area|split"},
    {"layout",
     "index data: blocks, culled one by one, or as published: four rectangles a level, cropped to the "
     "frustum, in triangle strips",
     CLIPMAP_LAYOUT_BLOCKS, 0, 1, "blocks|strips"},
    {"fade", "fade a level before the viewer's height switches it off", 1, 0, 1, "off|on"},
    {"cull", "draw only what the frustum meets", 1, 0, 1, "off|on"},
    {"faces", RENDERER_FACES_HELP, RENDERER_FACES_SAFE, 0, 2, RENDERER_FACES_CHOICES},
    {"refill", "samples read each frame: those that the motion exposes, or every level whole (to compare)", 0,
     0, 1, "exposed|whole"},
    {"budget",
     "samples read a frame but the first, coarse levels first; what it does not reach is cropped (0: no "
     "limit)",
     0, 0, 1e9, NULL},
    {"throttle",
     "share of the levels' samples that is drawn, of smaller levels and, where they cannot get smaller, "
     "fewer: "
     "less is faster and coarser",
     1, 0.01, 1, NULL},
    {"ahead", "lines that a refill reads ahead of the motion: fewer refills, more memory", 0, 0, 64, NULL},
    {"regions", "squares about the viewer, or fitted to what a frustum narrower than 90 degrees sees", 0, 0,
     1, "viewer|frustum"},
    {"sizes",
     "n for every level, or less where the next coarser level errs less for its spacing, or as the mean "
     "error "
     "over the picture gains least",
     CLIPMAP_SIZES_EQUAL, 0, 2, "equal|error|mean"},
    {"normals",
     "shading own: what picks the resolution of normals, the level blended as the geometry, or mipmaps",
     CLIPMAP_LOD_LEVEL, 0, 1, "level|mipmap"},
    {"anisotropy",
     "shading own: most samples of a normal's filter along a slanted pixel, 1 for none; 0: 8, which "
     "near-level "
     "views want, but 1 on a software renderer, where it multiplies the cost",
     0, 0, 16, NULL},
    {"trigonometry",
     "over a sphere: where vertices sample, in stable half angles, by acos in float, or as published",
     SPHERE_STABLE, 0, 2, "stable|corrected|published"},
    {"keep", "over a sphere: transformed vertices are kept while the eye stands still", 1, 0, 1, "off|on"},
    {"texture",
     "over a sphere: texels across what a level serves, as a share of a ring's vertices (published: 1/8 to "
     "1/4)",
     0.5, 0.125, 1, NULL},
    {"colours",
     "shading own over a sphere: texels across what a level of colours serves, as a share of a ring's "
     "vertices (published: 1)",
     1, 0.25, 4, NULL},
    {"fetch",
     "over a sphere: texels that a vertex looks up: its triangle of the level, blended near the next; or, as "
     "published, four of one level, or eight of two",
     SPHERE_FETCH_SURFACE, 0, 2, "surface|four|eight"},
    {NULL, NULL, 0, 0, 0, NULL},
};

static const double quick_n[] = {63, 127, 255, 511, NAN};
static const double full_n[] = {47, 63, 95, 127, 191, 255, 383, 511, NAN};

enum { HEIGHTS_UNIT = 0 };

struct clipmap_view { // the levels about one viewer, and what was selected for it
    struct clipmap_store stores[CLIPMAP_MAX_LEVELS];
    struct clipmap_region regions[CLIPMAP_MAX_LEVELS];
    struct view_origin eyes[CLIPMAP_MAX_LEVELS];
    struct clipmap_fit fits[CLIPMAP_MAX_LEVELS]; // when regions are fitted to the frustum
    int64_t eye_lattice[2];                      // of the last update
    struct clipmap_selection selection;
    GLuint heights; // one layer a level
    GLuint corners; // of the selection
    GLuint vertex_array;
    struct clipmap_shading shading; // no maps unless the scene calls for shading `own`

    uint64_t samples_updated; // by the last update
    uint64_t samples_left;    // that this frame may still read
    int levels_behind;        // that do not hold what the viewer wants
    int levels_read;          // by the last update
    double spacing_px;        // of its view, clipmap_spacing_px
    bool below_ground;        // or below what is drawn there, the viewer is
};

enum { // programs of a pass, by bits: for split cells, and for what lies inside the map's outline
    PROGRAM_SPLIT = 1,
    PROGRAM_INSIDE = 2,
    CLIPMAP_PROGRAMS = 4
};

struct clipmap_program {
    struct gpu_program program;
    GLint heights, slot, place, sides, morph;
    struct clipmap_shading_uniforms shading;
};

struct clipmap {
    struct renderer base;
    struct clipmap_sphere *sphere; // draws instead when the terrain is one; nothing below is then used
    struct gpu *gpu;
    const struct terrain *terrain;
    struct clipmap_shape shape;
    struct clipmap_choice choice;
    enum renderer_faces faces;
    bool rebuild;                  // every level is read whole each frame
    bool fitted;                   // regions are fitted to the frustum
    uint64_t budget;               // samples a frame and view
    int frame;                     // the one begun last
    struct terrain_reader *reader; // of terrain that is read on demand; NULL: all is there
    bool realtime;
    bool wait;      // in this frame what is read is waited for
    bool new_frame; // no view of it has been updated
    bool own_shading;
    struct clipmap_shading_rules shading_rules;
    struct clipmap_mesh mesh;
    struct clipmap_scratch scratch;
    struct clipmap_view views[RENDERER_MAX_VIEWS]; // each is made when it is first used
    int view_count;
    struct clipmap_program programs[PASS_COUNT][CLIPMAP_PROGRAMS];
    GLuint indices;
};

// ---- levels about one viewer -----------------------------------------------

static void create_heights(const struct clipmap *c, struct clipmap_view *view)
{
    glGenTextures(1, &view->heights);
    glActiveTexture(GL_TEXTURE0 + HEIGHTS_UNIT);
    glBindTexture(GL_TEXTURE_2D_ARRAY, view->heights);
    glTexParameteri(GL_TEXTURE_2D_ARRAY, GL_TEXTURE_MIN_FILTER, GL_NEAREST);
    glTexParameteri(GL_TEXTURE_2D_ARRAY, GL_TEXTURE_MAG_FILTER, GL_NEAREST);
    glTexParameteri(GL_TEXTURE_2D_ARRAY, GL_TEXTURE_MAX_LEVEL, 0);
    glTexImage3D(GL_TEXTURE_2D_ARRAY, 0, GL_RG32F, c->shape.size, c->shape.size, c->shape.levels, 0, GL_RG,
                 GL_FLOAT, NULL);
}

static void create_vertex_array(struct clipmap *c, struct clipmap_view *view)
{
    glGenVertexArrays(1, &view->vertex_array);
    glBindVertexArray(view->vertex_array);
    glBindBuffer(GL_ELEMENT_ARRAY_BUFFER, c->indices);
    glGenBuffers(1, &view->corners);
    glBindBuffer(GL_ARRAY_BUFFER, view->corners);
    gpu_buffer_data(c->gpu, GL_ARRAY_BUFFER,
                    (size_t)view->selection.capacity * sizeof *view->selection.corners, NULL, GL_STREAM_DRAW);
    glEnableVertexAttribArray(0);
    glVertexAttribDivisor(0, 1);
}

static bool create_view(struct clipmap *c, struct clipmap_view *view)
{
    int finest = terrain_info(c->terrain)->finest;
    for (int k = 0; k < c->shape.levels; k++)
        if (!clipmap_store_init(&view->stores[k], c->terrain, finest + k, k < c->shape.levels - 1,
                                c->shape.size))
            return false;
    for (int k = 0; k < c->shape.levels; k++) {
        view->stores[k].reader = c->reader;
        view->stores[k].shaded = c->own_shading;
    }
    if (!clipmap_selection_init(&view->selection, &c->shape)) return false;
    if (c->own_shading && !clipmap_shading_init(&view->shading, c->gpu, c->terrain, &c->shading_rules,
                                                c->shape.levels, c->shape.size))
        return false;
    create_heights(c, view);
    create_vertex_array(c, view);
    return true;
}

static void destroy_view(struct clipmap_view *view)
{
    for (int k = 0; k < CLIPMAP_MAX_LEVELS; k++) clipmap_store_finish(&view->stores[k]);
    clipmap_selection_finish(&view->selection);
    clipmap_shading_finish(&view->shading);
    if (!view->heights) return; // GL objects come last, all or none
    glDeleteTextures(1, &view->heights);
    glDeleteBuffers(1, &view->corners);
    glDeleteVertexArrays(1, &view->vertex_array);
}

// ---- update ----------------------------------------------------------------

struct layer {
    struct gpu *gpu;
    int index;
};

static void write_layer(void *user, int slot_x, int slot_y, int width, int height, const float (*pairs)[2])
{
    const struct layer *layer = user;
    gpu_texture_sub_image(layer->gpu, GL_TEXTURE_2D_ARRAY, layer->index, slot_x, slot_y, width, height, GL_RG,
                          GL_FLOAT, pairs);
}

// Height of the viewer over the ground below it, or, off the map, over the nearest ground.
static double height_over_ground(const struct terrain *terrain, const struct view *view)
{
    const struct terrain_info *info = terrain_info(terrain);
    double place[3], ground_q = info->min_q;
    terrain_place_from_world(terrain, view->eye_m, place);
    for (int axis = 0; axis < 2; axis++)
        place[axis] = fmin(fmax(place[axis], info->outline_m[axis]), info->outline_m[axis + 2]);
    terrain_truth_at(terrain, place[0], place[1], &ground_q, NULL);
    return place[2] - (ground_q * info->quantum_m + info->offset_m);
}

// The way the viewer went since the last update: a sign for each axis.
static void turn(struct clipmap_view *own, const struct view *view, int heading[2])
{
    for (int axis = 0; axis < 2; axis++) {
        int64_t now = view->eye_lattice[axis], before = own->eye_lattice[axis];
        heading[axis] = (now > before) - (now < before);
        own->eye_lattice[axis] = now;
    }
}

// Moves level k, within the budget unless it is the coarsest: that one is read whole, once, for without it
// there is nothing to draw.
static void refill_level(struct clipmap *c, struct clipmap_view *own, int k,
                         const struct clipmap_box *desired, const int heading[2])
{
    struct clipmap_store *store = &own->stores[k];
    bool limited = k + 1 < c->shape.levels && own->samples_left < UINT64_MAX;
    if (c->rebuild) store->clip = clipmap_empty;
    store->wait = c->wait || c->rebuild || k + 1 == c->shape.levels;
    struct clipmap_box target =
        clipmap_target(&c->shape, k, &store->clip, &own->stores[k + 1].clip, desired, heading);
    struct layer layer = {c->gpu, k};
    uint64_t samples = clipmap_store_move(store, &target, limited ? own->samples_left : UINT64_MAX,
                                          &c->scratch, write_layer, &layer);
    if (limited) own->samples_left -= samples;
    own->samples_updated += samples;
    own->levels_read += samples > 0;
    own->levels_behind += !clipmap_box_holds(&store->clip, desired);
}

// Sections 4 and 5: coarse to fine, as far as the budget goes.
static void update_view(struct clipmap *c, struct clipmap_view *own, const struct view *view)
{
    struct clipmap_box clips[CLIPMAP_MAX_LEVELS];
    double height_m = height_over_ground(c->terrain, view);
    int finest = terrain_info(c->terrain)->finest, heading[2];
    const struct clipmap_fit *fits = c->fitted ? own->fits : NULL;
    turn(own, view, heading);
    for (int k = 0; k < c->shape.levels; k++) own->eyes[k] = view_level_origin(view, finest + k);
    if (c->fitted) clipmap_fit(&c->shape, c->terrain, view, own->eyes, own->fits);
    own->spacing_px =
        clipmap_spacing_px(fits ? fits[0].n : c->shape.drawn[0], view->width, view->tan_half[0]);
    own->samples_updated = 0;
    own->levels_behind = own->levels_read = 0;
    glActiveTexture(GL_TEXTURE0 + HEIGHTS_UNIT);
    glBindTexture(GL_TEXTURE_2D_ARRAY, own->heights);
    for (int k = c->shape.levels - 1; k >= 0; k--) {
        struct clipmap_box desired = clipmap_desired(&c->shape, k, &own->eyes[k], height_m, fits);
        refill_level(c, own, k, &desired, heading);
        clips[k] = own->stores[k].clip;
    }
    for (int k = c->shape.levels - 1; c->own_shading && k >= 0; k--)
        clipmap_shading_update(&own->shading, k, &clips[k], c->rebuild);
    clipmap_regions(&c->shape, own->eyes, height_m, fits, clips, own->regions);
    own->below_ground = height_m < 0 || !clipmap_eye_above(&c->shape, own->regions, own->stores, &c->scratch,
                                                           own->eyes, view);
    clipmap_select(&own->selection, &c->shape, &c->choice, &c->mesh, own->regions, own->stores, own->eyes,
                   view);
    glBindBuffer(GL_ARRAY_BUFFER, own->corners);
    gpu_buffer_data(c->gpu, GL_ARRAY_BUFFER,
                    (size_t)own->selection.corner_count * sizeof *own->selection.corners,
                    own->selection.corners, GL_STREAM_DRAW);
}

// A frame's budget is spent once, however often its number comes.  The first frame of a flight, which a
// smaller number than the last begins, reads everything anew: what a budget or late data draw depends on the
// views of this flight alone.
static void begin_frame(struct renderer *renderer, int frame)
{
    struct clipmap *c = (struct clipmap *)renderer;
    if (c->sphere) {
        clipmap_sphere_begin_frame(c->sphere, frame);
        return;
    }
    bool first = c->frame < 0 || frame < c->frame, another = frame != c->frame;
    c->view_count = 0;
    for (int i = 0; i < RENDERER_MAX_VIEWS; i++) {
        struct clipmap_view *view = &c->views[i];
        if (another) view->samples_left = first ? UINT64_MAX : c->budget;
        for (int k = 0; first && (c->budget < UINT64_MAX || c->reader) && k < c->shape.levels; k++)
            view->stores[k].clip = clipmap_empty;
    }
    if (another) c->wait = first;
    c->new_frame = another;
    c->frame = frame;
}

// A flight has a reader of its own.  The first frame waits for what it reads.
static bool begin_reading(struct clipmap *c, const struct view *view)
{
    double place[3];
    if (terrain_extrema(c->terrain) || !c->new_frame) return true; // all is in memory
    if (c->wait) {
        terrain_reader_destroy(c->reader);
        c->reader = terrain_reader_create(c->terrain, c->realtime);
        for (int i = 0; i < RENDERER_MAX_VIEWS * CLIPMAP_MAX_LEVELS; i++)
            c->views[i / CLIPMAP_MAX_LEVELS].stores[i % CLIPMAP_MAX_LEVELS].reader = c->reader;
        if (!c->reader) return false;
    }
    terrain_place_from_world(c->terrain, view->eye_m, place);
    terrain_reader_begin_frame(c->reader, c->frame, place);
    c->new_frame = false;
    return true;
}

static bool update(struct renderer *renderer, const struct view *views, int count)
{
    struct clipmap *c = (struct clipmap *)renderer;
    if (c->sphere) return clipmap_sphere_update(c->sphere, views, count);
    if (!begin_reading(c, &views[0])) return false;
    for (int i = 0; i < count; i++) {
        if (!c->views[i].heights && !create_view(c, &c->views[i])) return false;
        update_view(c, &c->views[i], &views[i]);
    }
    c->view_count = count;
    return true;
}

// ---- draw ------------------------------------------------------------------

static void set_level(const struct clipmap *c, const struct clipmap_program *program,
                      const struct clipmap_view *view, int k)
{
    const struct clipmap_region *region = &view->regions[k];
    const struct clipmap_store *store = &view->stores[k];
    const struct view_origin *eye = &view->eyes[k];
    struct terrain_level level = terrain_level(c->terrain, store->level);
    GLint slot[3] = {0, 0, k};
    for (int axis = 0; axis < 2; axis++)
        slot[axis] =
            (GLint)(eye->base[axis] - store->clip.lo[axis]) + clipmap_slot(store->clip.lo[axis], store->size);
    glUniform3iv(program->slot, 1, slot);
    glUniform4f(program->place, eye->fraction[0], eye->fraction[1], (float)level.spacing_m[0],
                (float)level.spacing_m[1]);
    glUniform4f(program->sides, region->low[0], region->low[1], region->high[0], region->high[1]);
    glUniform3f(program->morph, region->width, 1.0f / region->width, region->fade);
    if (c->own_shading && program->program.pass == PASS_SHADED)
        clipmap_shading_set_level(&view->shading, &program->shading, k, view->regions, view->eyes);
}

// Of the draws first .. end - 1, those of one way.
static void draw_way(const struct clipmap *c, const struct clipmap_program *program,
                     const struct clipmap_view *view, int first, int end, int way)
{
    for (int i = first, level = -1; i < end; i++) {
        const struct clipmap_draw *draw = &view->selection.draws[i];
        const struct clipmap_list *list = &draw->list;
        if (draw->way != way) continue;
        if (level < 0) {
            gpu_use_program(c->gpu, &program->program);
            glUniform1i(program->heights, HEIGHTS_UNIT);
        }
        if (draw->level != level) set_level(c, program, view, level = draw->level);
        glVertexAttribIPointer(0, 2, GL_INT, 0,
                               (const void *)((uintptr_t)draw->first * sizeof *view->selection.corners));
        gpu_draw_elements_instanced(c->gpu, draw->strip ? GL_TRIANGLE_STRIP : GL_TRIANGLES, list->count,
                                    GL_UNSIGNED_SHORT, list->first, 0, draw->count,
                                    (uint64_t)draw->count * list->triangles);
    }
}

static bool front_only(const struct clipmap *c, const struct clipmap_view *view, int way)
{
    if (c->faces == RENDERER_FACES_SAFE) return way & CLIPMAP_WITHIN_VIEW && !view->below_ground;
    return c->faces == RENDERER_FACES_FRONT;
}

// cull: back faces may be.
static void draw_some(const struct clipmap *c, const struct clipmap_view *view, enum render_pass pass,
                      bool split, int first, int end, bool cull)
{
    for (int way = CLIPMAP_WAYS - 1; way >= 0; way--) {
        int kind = (split ? PROGRAM_SPLIT : 0) | (way & CLIPMAP_WITHIN_MAP ? PROGRAM_INSIDE : 0);
        if (cull && front_only(c, view, way))
            glEnable(GL_CULL_FACE);
        else
            glDisable(GL_CULL_FACE);
        draw_way(c, &c->programs[pass][kind], view, first, end, way);
    }
    glDisable(GL_CULL_FACE);
}

static void draw(struct renderer *renderer, int view_index, enum render_pass pass)
{
    struct clipmap *c = (struct clipmap *)renderer;
    if (c->sphere) {
        clipmap_sphere_draw(c->sphere, view_index, pass);
        return;
    }
    const struct clipmap_view *view = &c->views[view_index];
    bool split = c->choice.stitch == CLIPMAP_STITCH_SPLIT;
    bool cull = pass != PASS_POSITION; // measuring looks for faces seen from below
    int draws = view->selection.draw_count, blocks = draws - view->selection.stitch_draws;
    glActiveTexture(GL_TEXTURE0 + HEIGHTS_UNIT);
    glBindTexture(GL_TEXTURE_2D_ARRAY, view->heights);
    glBindVertexArray(view->vertex_array);
    glBindBuffer(GL_ARRAY_BUFFER, view->corners);
    if (c->own_shading) clipmap_shading_begin(&view->shading);
    draw_some(c, view, pass, false, 0, blocks, cull);
    // A triangle of no area fills a dropped pixel whichever way it seems to face.
    draw_some(c, view, pass, split, blocks, draws, cull && split);
    if (c->own_shading) clipmap_shading_end();
}

static void stats(const struct renderer *renderer, struct renderer_stats *stats)
{
    const struct clipmap *c = (const struct clipmap *)renderer;
    if (c->sphere) {
        clipmap_sphere_stats(c->sphere, stats);
        return;
    }
    const struct clipmap_view *view = &c->views[0];
    size_t bytes = c->mesh.count * sizeof *c->mesh.indices;
    uint64_t samples = 0;
    for (int i = 0; i < RENDERER_MAX_VIEWS; i++) {
        const struct clipmap_view *v = &c->views[i];
        if (i < c->view_count) samples += v->samples_updated;
        if (v->heights)
            bytes +=
                (size_t)c->shape.size * (size_t)c->shape.size * (size_t)c->shape.levels * 2 * sizeof(float) +
                (size_t)v->selection.capacity * sizeof *v->selection.corners;
        bytes += clipmap_shading_bytes(&v->shading);
    }
    *stats = (struct renderer_stats){
        .triangles = c->view_count > 0 ? view->selection.triangles : 0,
        .claimed_error_px = NAN,
        .resident_bytes = bytes,
        .counters = {{"levels", view->selection.levels},
                     {"samples_updated", (double)samples},
                     {"levels_read", view->levels_read},
                     {"levels_behind", view->levels_behind},
                     {"blocks", view->selection.blocks},
                     {"culled", view->selection.culled},
                     {"spacing_px", view->spacing_px}},
    };
    if (!c->reader) return;
    struct terrain_reader_counters reads = terrain_reader_counters(c->reader);
    stats->counters[7] = (struct renderer_counter){"windows_missed", (double)reads.missed};
    stats->counters[8] = (struct renderer_counter){"blocks_arrived", (double)reads.arrived};
}

// ---- creation --------------------------------------------------------------

static bool build_program(struct clipmap *c, struct clipmap_program *p, const char *defines,
                          const struct scene_effects *effects, enum render_pass pass)
{
    if (!gpu_program_build(c->gpu, &p->program, "clipmap/clipmap.vert", defines, effects, pass)) return false;
    p->heights = glGetUniformLocation(p->program.name, "heights");
    p->slot = glGetUniformLocation(p->program.name, "slot");
    p->place = glGetUniformLocation(p->program.name, "place");
    p->sides = glGetUniformLocation(p->program.name, "sides");
    p->morph = glGetUniformLocation(p->program.name, "morph");
    p->shading = clipmap_shading_locate(p->program.name);
    return true;
}

static bool build_programs(struct clipmap *c, const struct scene_effects *effects)
{
    const char *alpha = c->shape.rules.alpha == CLIPMAP_ALPHA_PUBLISHED ? "#define PUBLISHED_ALPHA\n" : "";
    char defines[192], shading[64];
    clipmap_shading_defines(&c->shading_rules, shading);
    for (int kind = 0; kind < CLIPMAP_PROGRAMS; kind++) {
        bool split = kind & PROGRAM_SPLIT;
        snprintf(defines, sizeof defines, "#define SIZE %d\n#define ROW %d\n%s%s%s%s", c->shape.size,
                 split ? CLIPMAP_HALF_ROW : CLIPMAP_ROW, split ? "#define SPLIT\n" : "",
                 kind & PROGRAM_INSIDE ? GPU_INSIDE_OUTLINE : "", alpha, shading);
        for (int pass = 0; pass < PASS_COUNT; pass++)
            if (!build_program(c, &c->programs[pass][kind], defines, effects, (enum render_pass)pass))
                return false;
    }
    return true;
}

static void size_by_error(struct clipmap *c, enum clipmap_sizes sizes)
{
    double error_m[CLIPMAP_MAX_LEVELS];
    for (int k = 0; k < c->shape.available; k++)
        error_m[k] = terrain_level(c->terrain, terrain_info(c->terrain)->finest + k).rms_error_m;
    clipmap_shape_by_error(&c->shape, sizes, error_m);
}

static bool set_shape(struct clipmap *c, const double *values)
{
    double n = values[KNOB_N];
    if (!(n >= N_MIN && n <= N_MAX) || fmod(n, 2) != 1)
        return fail("clipmap: n is %g; an odd number from %d to %d is expected", n, N_MIN, N_MAX);
    struct clipmap_rules rules = {.n = (int)n,
                                  .transition = values[KNOB_TRANSITION],
                                  .alpha = (enum clipmap_alpha)values[KNOB_ALPHA],
                                  .fade = values[KNOB_FADE] != 0,
                                  .throttle = values[KNOB_THROTTLE],
                                  .ahead = (int)values[KNOB_AHEAD]};
    c->choice = (struct clipmap_choice){.cull = values[KNOB_CULL] != 0,
                                        .layout = (enum clipmap_layout)values[KNOB_LAYOUT],
                                        .stitch = (enum clipmap_stitch)values[KNOB_STITCH]};
    c->faces = (enum renderer_faces)values[KNOB_FACES];
    c->rebuild = values[KNOB_REFILL] != 0;
    c->fitted = values[KNOB_REGIONS] != 0;
    const struct terrain_info *info = terrain_info(c->terrain);
    struct terrain_level finest = terrain_level(c->terrain, info->finest);
    clipmap_shape_init(&c->shape, &rules, info->coarsest - info->finest + 1, &finest.extent,
                       fmax(finest.spacing_m[0], finest.spacing_m[1]));
    enum clipmap_sizes sizes = (enum clipmap_sizes)values[KNOB_SIZES];
    if (sizes != CLIPMAP_SIZES_EQUAL) size_by_error(c, sizes);
    c->budget = values[KNOB_BUDGET] > 0 ? (uint64_t)values[KNOB_BUDGET] : UINT64_MAX;
    if (c->budget < 4 * (uint64_t)c->shape.size)
        return fail("clipmap: budget is %g; 0 or at least %d, four lines of a level, is expected",
                    values[KNOB_BUDGET], 4 * c->shape.size);
    if (c->rebuild && c->budget < UINT64_MAX)
        return fail("clipmap: refill=whole reads every level each frame; it takes no budget");
    if (c->choice.layout == CLIPMAP_LAYOUT_STRIPS && c->shape.size > CLIPMAP_COLUMN_ROWS)
        return fail("clipmap: layout=strips: a level of %d rows; at most %d are expected", c->shape.size,
                    CLIPMAP_COLUMN_ROWS);
    int most = gpu_info(c->gpu)->max_texture_size;
    if (c->shape.size <= most) return true;
    return fail("clipmap: a level of %d x %d samples: textures of this OpenGL driver have at most %d",
                c->shape.size, c->shape.size, most);
}

static void destroy(struct renderer *renderer)
{
    struct clipmap *c = (struct clipmap *)renderer;
    if (!c) return;
    clipmap_sphere_destroy(c->sphere);
    for (int pass = 0; pass < PASS_COUNT; pass++)
        for (int kind = 0; kind < CLIPMAP_PROGRAMS; kind++)
            gpu_program_finish(&c->programs[pass][kind].program);
    for (int i = 0; i < RENDERER_MAX_VIEWS; i++) destroy_view(&c->views[i]);
    if (c->indices) glDeleteBuffers(1, &c->indices);
    terrain_reader_destroy(c->reader);
    clipmap_mesh_finish(&c->mesh);
    clipmap_scratch_finish(&c->scratch);
    free(c);
}

static bool init_sphere(struct clipmap *c, const struct renderer_desc *desc)
{
    const double *knobs_set = desc->knobs;
    struct sphere_choice choice = {.n = (int)knobs_set[KNOB_N],
                                   .cull = knobs_set[KNOB_CULL] > 0,
                                   .keep = knobs_set[KNOB_KEEP] > 0,
                                   .rebuild = knobs_set[KNOB_REFILL] > 0,
                                   .budget = knobs_set[KNOB_BUDGET] > 0 ? (uint64_t)knobs_set[KNOB_BUDGET]
                                                                        : UINT64_MAX,
                                   .texture = knobs_set[KNOB_TEXTURE],
                                   .colours = knobs_set[KNOB_COLOURS],
                                   .fetch = (enum sphere_fetch)knobs_set[KNOB_FETCH],
                                   .form = (enum sphere_form)knobs_set[KNOB_TRIGONOMETRY]};
    c->sphere = clipmap_sphere_create(desc, &choice);
    return c->sphere != NULL;
}

static bool init(struct clipmap *c, const struct renderer_desc *desc)
{
    if (terrain_info(desc->terrain)->datum == TERRAIN_SPHERE) return init_sphere(c, desc);
    c->gpu = desc->gpu;
    c->terrain = desc->terrain;
    c->frame = -1;
    c->realtime = desc->realtime;
    c->own_shading = desc->effects->shading == SCENE_SHADING_OWN;
    int anisotropy = (int)desc->knobs[KNOB_ANISOTROPY];
    if (anisotropy < 1) anisotropy = gpu_info(c->gpu)->software ? 1 : 8;
    c->shading_rules = (struct clipmap_shading_rules){(enum clipmap_lod)desc->knobs[KNOB_NORMALS],
                                                      clipmap_shading_anisotropy(anisotropy)};
    if (!set_shape(c, desc->knobs)) return false;
    int rows = c->choice.layout == CLIPMAP_LAYOUT_STRIPS ? c->shape.size : 0; // a column's at most
    if (!clipmap_mesh_init(&c->mesh, rows) || !clipmap_scratch_init(&c->scratch, c->shape.size) ||
        !build_programs(c, desc->effects))
        return false;
    glBindVertexArray(0); // the element array belongs to whichever vertex array is bound
    glGenBuffers(1, &c->indices);
    glBindBuffer(GL_ARRAY_BUFFER, c->indices);
    gpu_buffer_data(c->gpu, GL_ARRAY_BUFFER, c->mesh.count * sizeof *c->mesh.indices, c->mesh.indices,
                    GL_STATIC_DRAW);
    return create_view(c, &c->views[0]);
}

static struct renderer *create(const struct renderer_desc *desc)
{
    struct clipmap *c = calloc(1, sizeof *c);
    if (!c) {
        fail("clipmap: no memory");
        return NULL;
    }
    c->base.type = &clipmap_renderer;
    if (init(c, desc)) return &c->base;
    destroy(&c->base);
    return NULL;
}

const struct renderer_type clipmap_renderer = {
    .name = "clipmap",
    .summary = "nested grids about the viewer, toroidal update, morphed and stitched borders",
    .knobs = knobs,
    .quality_knob = "n",
    .quick = quick_n,
    .full = full_n,
    .spheres = true,
    .create = create,
    .begin_frame = begin_frame,
    .update = update,
    .draw = draw,
    .stats = stats,
    .destroy = destroy,
};
