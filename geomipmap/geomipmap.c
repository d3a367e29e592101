// SPDX-License-Identifier: MIT
#include "geomipmap/geomipmap.h"

#include "common/report.h"
#include "geomipmap/geomipmap_cache.h"
#include "geomipmap/geomipmap_select.h"
#include "geomipmap/geomipmap_shading.h"

#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

enum {
    KNOB_TAU,
    KNOB_PATCH,
    KNOB_MERGE,
    KNOB_METRIC,
    KNOB_HEIGHTS,
    KNOB_DELTA,
    KNOB_BORDERS,
    KNOB_INDICES,
    KNOB_HYSTERESIS,
    KNOB_MORPH,
    KNOB_BLEND,
    KNOB_TEXTURE,
    KNOB_TEXTURES,
    KNOB_AHEAD,
    KNOB_CULL,
    KNOB_FACES,
    KNOB_CACHE
};

enum { HEIGHTS_SAMPLES, HEIGHTS_LEVELS };

static const struct renderer_knob knobs[] = {
    {"tau", "screen-space error allowed, px: more is faster", 1, 0, 1e6, NULL},
    {"patch", "samples on a side of a tile: large tiles cost fewer draws and more triangles", 1, 0, 3,
     "9|17|33|65"},
    {"merge",
     "how often 2 x 2 distant tiles may merge into one of twice the size, at most up to 129 samples; those "
     "of a "
     ".relief file drawn with its levels merge on, to the size of the map",
     3, 0, 4, NULL},
    {"metric",
     "how error is projected: by distance, by depth, or so that it holds anywhere in the window; or the "
     "least "
     "mean error for the triangles, which claims nothing",
     GEOMIPMAP_SAFE, 0, 3, "paper|depth|safe|mean"},
    {"heights",
     "what coarse levels draw: samples of the finest level, or the filtered levels of the pyramid, which are "
     "nearer to the ground; morphing and removed vertices need samples",
     HEIGHTS_LEVELS, 0, 1, "samples|levels"},
    {"delta", "error of a tile: as published, or with the borders that finer neighbours ask for",
     GEOMIPMAP_STABLE, 0, 1, "published|stable"},
    {"borders",
     "where levels differ: add vertices, the same in five draw calls a tile, or remove vertices, which "
     "breaks "
     "tau (merge 0)",
     GEOMIPMAP_ADD, 0, 2, "add|regions|remove"},
    {"indices", "triangle lists, or strips in less memory", 0, 0, 1, "lists|strips"},
    {"hysteresis",
     "share of tau by which a tile must be better before it grows coarser; 0: levels may flicker", 0, 0, 0.9,
     NULL},
    {"morph", "vertices move towards the next coarser level before it is drawn: no popping, more time", 0, 0,
     1, "off|on"},
    {"blend", "shading own: how light map and colour are combined", GEOMIPMAP_MODULATE, 0, 2,
     "modulate|add|replace"},
    {"texture", "shading own: longest side of a sub-texture, px", 1024, 16, 65536, NULL},
    {"textures", "shading own: ceiling of all sub-textures, KiB", 65536, 1, 1e8, NULL},
    {"ahead",
     "shading own: sub-textures are loaded for where the eye will be so many frames on; 0: when needed", 8, 0,
     1000, NULL},
    {"cull", "draw only tiles that the frustum meets", 1, 0, 1, "off|on"},
    {"faces", RENDERER_FACES_HELP, RENDERER_FACES_SAFE, 0, 2, RENDERER_FACES_CHOICES},
    {"cache", "most tiles in the vertex buffer; 0: as many as a frame needs", 0, 0, 1e6, NULL},
    {NULL, NULL, 0, 0, 0, NULL},
};

static const double quick_tau[] = {8, 4, 2, 1, 0.5, NAN};
static const double full_tau[] = {8, 4, 2, 1, 0.5, 0.25, 0.125, NAN};

enum { FIRST_ROOM = 64, PLACES_UNIT = 0, HEIGHTS_UNIT, MORPHS_UNIT };
enum { NOT_DRAWN = INT32_MAX }; // height of a vertex that the tile's form leaves out

struct texel { // of the places buffer, one a slot
    int32_t cell[2], base, height;
};

struct geomipmap_view { // what was selected for one view
    struct geomipmap_selection selection;
    int drawn;                                             // picks drawn: those seen, or all
    int room;                                              // draws in the lists below
    int first_draw[GEOMIPMAP_WAYS], draws[GEOMIPMAP_WAYS]; // gathered in them, way by way; of own shading,
                                                           // which goes block by block, all in way 0
    bool below_ground;                                     // the viewer may be, as it is drawn
    GLsizei *counts;                                       // one draw a part of a tile
    size_t *first;
    GLint *base_vertex;
    GLint eye_cell[2];
    float eye_fraction[2];
    uint64_t triangles;
    float (*morphs)[8]; // by slot: what the vertex program reads; NULL without morphing
    int morph_room;     // slots in it
    GLuint morph_buffer, morph_texture;
    int *blocks; // by draw, for shading of its own; NULL without
    double eye_m[3], pixels_per_tangent;
};

struct geomipmap_program {
    struct gpu_program program;
    GLint eye_cell, eye_fraction, spacing, places, heights, morphs;
};

struct geomipmap {
    struct renderer base;
    struct gpu *gpu;
    struct geomipmap_choice choice;
    struct geomipmap_mesh mesh;
    struct geomipmap_tiles tiles;
    struct terrain_reader *reader; // NULL: the terrain is in memory
    struct geomipmap_cache cache;
    struct geomipmap_cache_counts counts_before; // of the cache, when the frame began
    struct geomipmap_view views[RENDERER_MAX_VIEWS];
    int view_count;
    int frame; // number of this frame
    enum renderer_faces faces;
    bool own_shading;
    int blend; // enum geomipmap_blend
    struct geomipmap_shading shading;
    struct scene_colour *held;           // whose pixels shading needs; NULL: none
    uint64_t loads_before, ahead_before; // of sub-textures, when the frame began
    double ahead;                        // frames to look ahead for them
    double eye_m[3];                     // of the frame before, where this one goes on
    bool goes_on;
    double select_ms; // CPU time of selection and culling in this frame
    bool streamed;    // the frame needs more tiles than the cache may hold: draw() uploads in batches

    struct geomipmap_program programs[PASS_COUNT][2]; // the second: GPU_INSIDE_OUTLINE
    GLuint vertex_array, indices, vertices, places, places_texture, heights_texture;
    int room;                     // slots in `vertices` and `places`
    int tile_vertices;            // in a slot
    int32_t highest_q;            // at least the highest sample of any level
    size_t vertex_bytes;          // 2, or 4 since a tile needed more than 16 bits
    struct geomipmap_form *forms; // by slot: of filtered tiles, that of the heights in it
    int form_room;                // slots in it
    uint64_t reformed;    // slots written anew this frame because a neighbour's step changed, or their own
    int32_t *heights;     // of one tile
    uint16_t *heights_16; // the same, above its base
};

// ---- the vertex buffer --------------------------------------------------------------------------

static GLuint resized_buffer(struct geomipmap *g, GLuint old, size_t old_bytes, size_t bytes)
{
    GLuint buffer;
    glGenBuffers(1, &buffer);
    glBindBuffer(GL_COPY_WRITE_BUFFER, buffer);
    gpu_buffer_data(g->gpu, GL_COPY_WRITE_BUFFER, bytes, NULL, GL_DYNAMIC_DRAW);
    if (old) {
        glBindBuffer(GL_COPY_READ_BUFFER, old);
        glCopyBufferSubData(GL_COPY_READ_BUFFER, GL_COPY_WRITE_BUFFER, 0, 0,
                            (GLsizeiptr)(old_bytes < bytes ? old_bytes : bytes));
        glDeleteBuffers(1, &old);
    }
    return buffer;
}

// Gives the buffers room for `room` slots and keeps what is in them.
static void resize_slots(struct geomipmap *g, int room)
{
    size_t slot_bytes = (size_t)g->tile_vertices * g->vertex_bytes;
    g->vertices = resized_buffer(g, g->vertices, (size_t)g->room * slot_bytes, (size_t)room * slot_bytes);
    g->places = resized_buffer(g, g->places, (size_t)g->room * sizeof(struct texel),
                               (size_t)room * sizeof(struct texel));
    g->room = room;
    glBindVertexArray(g->vertex_array);
    glBindBuffer(GL_ARRAY_BUFFER, g->vertices);
    glVertexAttribIPointer(0, 1, g->vertex_bytes == 2 ? GL_UNSIGNED_SHORT : GL_INT, (GLsizei)g->vertex_bytes,
                           NULL);
    glEnableVertexAttribArray(0);
    glActiveTexture(GL_TEXTURE0 + PLACES_UNIT);
    glBindTexture(GL_TEXTURE_BUFFER, g->places_texture);
    glTexBuffer(GL_TEXTURE_BUFFER, GL_RGBA32I, g->places);
    if (!g->choice.morph) return;
    glActiveTexture(GL_TEXTURE0 + HEIGHTS_UNIT);
    glBindTexture(GL_TEXTURE_BUFFER, g->heights_texture);
    glTexBuffer(GL_TEXTURE_BUFFER, g->vertex_bytes == 2 ? GL_R16UI : GL_R32I, g->vertices);
}

static void copy_slot(struct geomipmap *g, int from, int to)
{
    const GLuint buffers[2] = {g->vertices, g->places};
    if (g->tiles.filtered) g->forms[to] = g->forms[from];
    const size_t bytes[2] = {(size_t)g->tile_vertices * g->vertex_bytes, sizeof(struct texel)};
    for (int i = 0; i < 2; i++) {
        glBindBuffer(GL_COPY_READ_BUFFER, buffers[i]);
        glBindBuffer(GL_COPY_WRITE_BUFFER, buffers[i]);
        glCopyBufferSubData(GL_COPY_READ_BUFFER, GL_COPY_WRITE_BUFFER, (GLintptr)((size_t)from * bytes[i]),
                            (GLintptr)((size_t)to * bytes[i]), (GLsizeiptr)bytes[i]);
    }
}

// From now on heights take 4 bytes.  What the slots hold stays, above the bases of their tiles.
static void widen_slots(struct geomipmap *g)
{
    GLuint narrow = g->vertices;
    size_t count = (size_t)g->tile_vertices, bytes = count * sizeof *g->heights_16;
    g->vertices = 0;
    g->vertex_bytes = sizeof *g->heights;
    resize_slots(g, g->room);
    for (size_t slot = 0; slot < (size_t)g->room; slot++) {
        glBindBuffer(GL_COPY_READ_BUFFER, narrow);
        glGetBufferSubData(GL_COPY_READ_BUFFER, (GLintptr)(slot * bytes), (GLsizeiptr)bytes, g->heights_16);
        for (size_t i = 0; i < count; i++) g->heights[i] = g->heights_16[i];
        glBindBuffer(GL_COPY_WRITE_BUFFER, g->vertices);
        gpu_buffer_sub_data(g->gpu, GL_COPY_WRITE_BUFFER, slot * 2 * bytes, 2 * bytes, g->heights);
    }
    glDeleteBuffers(1, &narrow);
}

static struct geomipmap_range heights_range(const struct geomipmap *g)
{
    struct geomipmap_range range = {INT32_MAX, INT32_MIN};
    for (int i = 0; i < g->tile_vertices; i++) {
        int32_t q = g->heights[i];
        if (q < range.low) range.low = q;
        if (q > range.high && q != NOT_DRAWN) range.high = q;
    }
    return range;
}

static void read_tile(struct geomipmap *g, const struct geomipmap_pick *pick)
{
    struct geomipmap_form form = geomipmap_pick_form(pick);
    for (int i = 0; i < g->tile_vertices; i++) g->heights[i] = NOT_DRAWN;
    geomipmap_tiles_read(&g->tiles, g->reader, pick->place, g->tiles.filtered ? &form : NULL, g->heights);
}

static void upload_tile(struct geomipmap *g, const struct geomipmap_pick *pick, int slot)
{
    const struct geomipmap_tiles *tiles = &g->tiles;
    struct geomipmap_place place = pick->place;
    int size = 1 << (tiles->bits + place.height);
    struct texel texel = {.cell = {place.column * size, place.row * size}, .height = place.height};
    const void *data = g->heights;
    if (tiles->filtered) g->forms[slot] = geomipmap_pick_form(pick);
    read_tile(g, pick);
    struct geomipmap_range range = heights_range(g);
    if (g->vertex_bytes == 2 && (int64_t)range.high - range.low > UINT16_MAX) {
        widen_slots(g);
        read_tile(g, pick);
    }
    size_t bytes = (size_t)g->tile_vertices * g->vertex_bytes;
    if (g->vertex_bytes == 2) {
        texel.base = range.low;
        for (int i = 0; i < g->tile_vertices; i++) g->heights_16[i] = (uint16_t)(g->heights[i] - texel.base);
        data = g->heights_16;
    }
    glBindBuffer(GL_COPY_WRITE_BUFFER, g->vertices);
    gpu_buffer_sub_data(g->gpu, GL_COPY_WRITE_BUFFER, (size_t)slot * bytes, bytes, data);
    glBindBuffer(GL_COPY_WRITE_BUFFER, g->places);
    gpu_buffer_sub_data(g->gpu, GL_COPY_WRITE_BUFFER, (size_t)slot * sizeof texel, sizeof texel, &texel);
}

static int way_of(const struct geomipmap *g, const struct geomipmap_pick *pick)
{
    return g->own_shading ? 0 : pick->way;
}

static int most_parts(const struct geomipmap *g)
{
    return g->mesh.borders == GEOMIPMAP_REGIONS ? GEOMIPMAP_MAX_PARTS : 1;
}

// Gives each way room for the draws of its picks.
static void clear_draws(const struct geomipmap *g, struct geomipmap_view *view)
{
    int picks[GEOMIPMAP_WAYS] = {0}, first = 0;
    for (int i = 0; i < view->drawn; i++) picks[way_of(g, &view->selection.picks[i])]++;
    for (int way = 0; way < GEOMIPMAP_WAYS; way++) {
        view->first_draw[way] = first;
        view->draws[way] = 0;
        first += picks[way] * most_parts(g);
    }
}

static void add_draws(const struct geomipmap *g, struct geomipmap_view *view,
                      const struct geomipmap_pick *pick, int slot)
{
    struct geomipmap_part parts[GEOMIPMAP_MAX_PARTS];
    int count = geomipmap_mesh_parts(&g->mesh, pick->set, parts), way = way_of(g, pick);
    for (int i = 0; i < count; i++) {
        int draw = view->first_draw[way] + view->draws[way]++;
        view->counts[draw] = parts[i].count;
        view->first[draw] = parts[i].first;
        view->base_vertex[draw] = slot * g->tile_vertices;
        if (g->own_shading) view->blocks[draw] = geomipmap_shading_block(&g->shading, pick->place);
    }
}

static void set_morph(struct geomipmap_view *view, const struct geomipmap_pick *pick, int slot)
{
    float *texel = view->morphs[slot];
    int levels = 0;
    for (int side = 0; side < GEOMIPMAP_SIDES; side++) {
        texel[side] = (float)pick->hem[side].morph / GEOMIPMAP_MORPHED;
        levels |= pick->hem[side].level << 3 * side;
    }
    texel[4] = (float)pick->morph / GEOMIPMAP_MORPHED;
    texel[5] = (float)pick->level;
    texel[6] = (float)levels;
}

static bool reserve_morphs(struct geomipmap *g, struct geomipmap_view *view)
{
    if (!g->choice.morph || view->morph_room >= g->room) return true;
    float(*morphs)[8] = realloc(view->morphs, (size_t)g->room * sizeof *morphs);
    if (!morphs) return fail("geomipmap: no memory to morph %d tiles", g->room);
    view->morphs = morphs;
    view->morph_room = g->room;
    return true;
}

static bool reserve_forms(struct geomipmap *g)
{
    if (!g->tiles.filtered || g->form_room >= g->room) return true;
    struct geomipmap_form *forms = realloc(g->forms, (size_t)g->room * sizeof *forms);
    if (!forms) return fail("geomipmap: no memory for the forms of %d tiles", g->room);
    g->forms = forms;
    g->form_room = g->room;
    return true;
}

static void upload_morphs(struct geomipmap *g, struct geomipmap_view *view)
{
    size_t bytes = (size_t)g->cache.slot_count * sizeof *view->morphs;
    if (!g->choice.morph || bytes == 0) return;
    glBindBuffer(GL_TEXTURE_BUFFER, view->morph_buffer);
    gpu_buffer_data(g->gpu, GL_TEXTURE_BUFFER, bytes, view->morphs, GL_STREAM_DRAW);
    glActiveTexture(GL_TEXTURE0 + MORPHS_UNIT);
    glBindTexture(GL_TEXTURE_BUFFER, view->morph_texture);
    glTexBuffer(GL_TEXTURE_BUFFER, GL_RGBA32F, view->morph_buffer);
}

// Two views may see a filtered tile in different forms: each has its own.
static uint64_t slot_name(const struct geomipmap *g, const struct geomipmap_view *view,
                          const struct geomipmap_pick *pick)
{
    uint64_t name = geomipmap_tiles_name(pick->place);
    return g->tiles.filtered ? (uint64_t)(view - g->views) << 61 | name : name;
}

static bool changed_form(struct geomipmap *g, const struct geomipmap_pick *pick, int slot)
{
    struct geomipmap_form form = geomipmap_pick_form(pick);
    if (!g->tiles.filtered || memcmp(&g->forms[slot], &form, sizeof form) == 0) return false;
    g->reformed++;
    return true;
}

// Makes sure that picks from `start` are in the buffer and fills the view's list with their draws.  Returns
// the number of picks done: all, or as many as the cache takes in one batch.
static int gather(struct geomipmap *g, struct geomipmap_view *view, int start)
{
    int done = 0;
    clear_draws(g, view);
    for (; start + done < view->drawn; done++) {
        const struct geomipmap_pick *pick = &view->selection.picks[start + done];
        int slot;
        enum geomipmap_found found = geomipmap_cache_find(&g->cache, slot_name(g, view, pick), &slot);
        if (found == GEOMIPMAP_FULL) break;
        if (slot >= g->room) resize_slots(g, g->room + g->room / 16);
        if (!reserve_forms(g) || !reserve_morphs(g, view)) break;
        if (found == GEOMIPMAP_MISS || changed_form(g, pick, slot)) upload_tile(g, pick, slot);
        add_draws(g, view, pick, slot);
        if (g->choice.morph) set_morph(view, pick, slot);
    }
    upload_morphs(g, view);
    return done;
}

// ---- the frame ----------------------------------------------------------------------------------

static void begin_frame(struct renderer *renderer, int frame)
{
    struct geomipmap *g = (struct geomipmap *)renderer;
    for (int i = 0; frame != g->frame + 1 && i < RENDERER_MAX_VIEWS; i++)
        geomipmap_selection_restart(&g->views[i].selection); // another flight
    g->goes_on = frame == g->frame + 1;
    g->frame = frame;
    g->ahead_before = g->shading.light.ahead + g->shading.colour.ahead;
    int from, to;
    g->counts_before = g->cache.counts;
    g->loads_before = g->shading.light.loads + g->shading.colour.loads;
    g->view_count = 0;
    g->reformed = 0;
    g->select_ms = 0;
    g->streamed = false;
    if (geomipmap_cache_begin_frame(&g->cache, &from, &to)) copy_slot(g, from, to);
    if (g->room > FIRST_ROOM && g->cache.slot_count < g->room / 4) resize_slots(g, g->room / 2);
}

// Eyes farther away than any map is wide keep their side of it.
static GLint to_cell(int64_t cell)
{
    const int64_t limit = INT64_C(1) << 30;
    return (GLint)(cell < -limit ? -limit : cell > limit ? limit : cell);
}

static bool reserve_blocks(struct geomipmap_view *view, int room)
{
    int *blocks = realloc(view->blocks, (size_t)room * sizeof *blocks);
    if (blocks) view->blocks = blocks;
    return blocks || fail("geomipmap: no memory for the map blocks of %d draws", room);
}

static bool reserve_draws(struct geomipmap_view *view, int room, bool own_shading)
{
    if (view->room >= room) return true;
    if (room < view->room + view->room / 16) room = view->room + view->room / 16;
    if (own_shading && !reserve_blocks(view, room)) return false;
    GLsizei *counts = realloc(view->counts, (size_t)room * sizeof *counts);
    if (counts) view->counts = counts;
    size_t *first = realloc(view->first, (size_t)room * sizeof *first);
    if (first) view->first = first;
    GLint *base_vertex = realloc(view->base_vertex, (size_t)room * sizeof *base_vertex);
    if (base_vertex) view->base_vertex = base_vertex;
    if (!counts || !first || !base_vertex) return fail("geomipmap: no memory for a list of %d draws", room);
    view->room = room;
    return true;
}

static uint64_t set_triangles(const struct geomipmap_mesh *mesh, int set)
{
    struct geomipmap_part parts[GEOMIPMAP_MAX_PARTS];
    int count = geomipmap_mesh_parts(mesh, set, parts);
    uint64_t triangles = 0;
    for (int i = 0; i < count; i++) triangles += (uint64_t)geomipmap_mesh_triangles(mesh, parts[i]);
    return triangles;
}

// Below the highest sample around the eye.
static bool below_bounds(const struct terrain *terrain, const struct view *view)
{
    const struct terrain_info *info = terrain_info(terrain);
    struct view_origin eye = view_level_origin(view, info->finest);
    int32_t low, high;
    terrain_bounds(terrain, info->finest, eye.base[0], eye.base[1], eye.base[0] + 1, eye.base[1] + 1, &low,
                   &high);
    return view->eye_m[2] < high * info->quantum_m + info->offset_m;
}

// The tile that is seen around the eye; NULL: there is none.
static const struct geomipmap_pick *pick_around(const struct geomipmap *g, const struct geomipmap_view *own)
{
    for (int i = 0; i < own->selection.seen; i++) {
        const struct geomipmap_pick *pick = &own->selection.picks[i];
        int shift = g->tiles.bits + pick->place.height;
        if (own->eye_cell[0] >> shift == pick->place.column && own->eye_cell[1] >> shift == pick->place.row)
            return pick;
    }
    return NULL;
}

// Highest vertex that is drawn of the tile's cell around the eye, quanta.
static int32_t highest_around(struct geomipmap *g, const struct geomipmap_view *own,
                              const struct geomipmap_pick *pick)
{
    int row = (1 << g->tiles.bits) + 1, step = 1 << pick->level, first[2];
    const int place[2] = {pick->place.column, pick->place.row};
    struct geomipmap_form form = geomipmap_pick_form(pick);
    int32_t highest = INT32_MIN;
    for (int i = 0; i < g->tile_vertices; i++) g->heights[i] = INT32_MIN; // those not drawn stay so
    geomipmap_tiles_read(&g->tiles, g->reader, pick->place, g->tiles.filtered ? &form : NULL, g->heights);
    for (int axis = 0; axis < 2; axis++) {
        int cell = own->eye_cell[axis] - (place[axis] << (g->tiles.bits + pick->place.height));
        first[axis] = (cell >> pick->place.height) & ~(step - 1);
    }
    for (int j = first[1]; j <= first[1] + step; j++)
        for (int i = first[0]; i <= first[0] + step; i++)
            if (g->heights[j * row + i] > highest) highest = g->heights[j * row + i];
    return highest;
}

// Whether the eye may be below the drawn surface: only then may a ray meet it from below first.  Beside the
// map a ray may come in below any of its edges.
static bool below_ground(struct geomipmap *g, const struct geomipmap_view *own, const struct view *view)
{
    const struct terrain_info *info = terrain_info(g->tiles.terrain);
    const struct geomipmap_pick *pick = pick_around(g, own);
    double above_q = (view->eye_m[2] - info->offset_m) / info->quantum_m;
    struct geomipmap_range range;
    const float *errors;
    for (int axis = 0; axis < 2; axis++)
        if (view->eye_m[axis] < info->outline_m[axis] || view->eye_m[axis] > info->outline_m[axis + 2])
            return above_q < g->highest_q;
    if (!pick) return below_bounds(g->tiles.terrain, view);
    if (geomipmap_tiles_know(&g->tiles, pick->place, &range, &errors) && above_q >= range.high) return false;
    return above_q < highest_around(g, own, pick);
}

static double now_ms(void)
{
    struct timespec t;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return (double)t.tv_sec * 1e3 + (double)t.tv_nsec * 1e-6;
}

static bool select_view(struct geomipmap *g, struct geomipmap_view *own, const struct view *view)
{
    struct view_origin eye = view_level_origin(view, g->tiles.finest);
    const int64_t first[2] = {g->tiles.x0, g->tiles.y0};
    for (int axis = 0; axis < 2; axis++) {
        own->eye_cell[axis] = to_cell(eye.base[axis] - first[axis]);
        own->eye_fraction[axis] = eye.fraction[axis];
    }
    for (int axis = 0; axis < 3; axis++) own->eye_m[axis] = view->eye_m[axis];
    own->pixels_per_tangent = view->pixels_per_tangent;
    struct geomipmap_selection *selection = &own->selection;
    double start = now_ms();
    if (!geomipmap_select(selection, &g->tiles, &g->choice, view)) return false;
    g->select_ms += now_ms() - start;
    own->below_ground = below_ground(g, own, view);
    own->drawn = g->choice.cull ? selection->seen : selection->count;
    own->triangles = 0;
    for (int i = 0; i < own->drawn; i++) own->triangles += set_triangles(&g->mesh, selection->picks[i].set);
    if (g->own_shading &&
        !geomipmap_shading_add(&g->shading, selection, own->drawn, view->pixels_per_tangent))
        return false;
    return reserve_draws(own, own->drawn * most_parts(g), g->own_shading);
}

// An eye at rest sees nothing new coming.
static void foresee(struct geomipmap *g, const struct view *view)
{
    double step_m[3], way = 0;
    for (int axis = 0; axis < 3; axis++) {
        step_m[axis] = (view->eye_m[axis] - g->eye_m[axis]) * g->ahead;
        way += fabs(step_m[axis]);
        g->eye_m[axis] = view->eye_m[axis];
    }
    if (g->goes_on && way > 0) geomipmap_shading_foresee(&g->shading, &g->tiles, view, step_m);
}

static bool update(struct renderer *renderer, const struct view *views, int count)
{
    struct geomipmap *g = (struct geomipmap *)renderer;
    g->view_count = count;
    if (g->reader) terrain_reader_begin_frame(g->reader, g->frame, views[0].eye_m);
    if (g->own_shading) geomipmap_shading_begin(&g->shading);
    for (int i = 0; i < count; i++) {
        struct geomipmap_view *view = &g->views[i];
        if (!select_view(g, view, &views[i])) return false;
        if (!g->streamed) g->streamed = gather(g, view, 0) < view->drawn;
    }
    if (g->own_shading && !geomipmap_shading_end(&g->shading)) return false;
    if (g->own_shading) foresee(g, &views[0]);
    if (g->streamed && g->cache.slot_count == 0) return fail("geomipmap: no memory for a single tile");
    return true;
}

static void bind(struct geomipmap *g, const struct geomipmap_view *view,
                 const struct geomipmap_program *program)
{
    gpu_use_program(g->gpu, &program->program);
    glUniform2iv(program->eye_cell, 1, view->eye_cell);
    glUniform2fv(program->eye_fraction, 1, view->eye_fraction);
    glUniform2f(program->spacing, (float)g->tiles.spacing_m[0], (float)g->tiles.spacing_m[1]);
    glUniform1i(program->places, PLACES_UNIT);
    if (g->choice.morph) {
        glUniform1i(program->heights, HEIGHTS_UNIT);
        glUniform1i(program->morphs, MORPHS_UNIT);
        glActiveTexture(GL_TEXTURE0 + HEIGHTS_UNIT);
        glBindTexture(GL_TEXTURE_BUFFER, g->heights_texture);
        glActiveTexture(GL_TEXTURE0 + MORPHS_UNIT);
        glBindTexture(GL_TEXTURE_BUFFER, view->morph_texture);
    }
    glBindVertexArray(g->vertex_array);
    glActiveTexture(GL_TEXTURE0 + PLACES_UNIT);
    glBindTexture(GL_TEXTURE_BUFFER, g->places_texture);
}

static void draw_range(struct geomipmap *g, const struct geomipmap_view *view, int first, int draws)
{
    uint64_t triangles = 0;
    for (int i = first; i < first + draws; i++)
        triangles +=
            (uint64_t)geomipmap_mesh_triangles(&g->mesh, (struct geomipmap_part){0, view->counts[i]});
    if (draws > 0)
        gpu_multi_draw_elements(g->gpu, g->mesh.strips ? GL_TRIANGLE_STRIP : GL_TRIANGLES,
                                view->counts + first, GL_UNSIGNED_SHORT, view->first + first,
                                view->base_vertex + first, draws, triangles);
}

static bool front_only(const struct geomipmap *g, const struct geomipmap_view *view, int way)
{
    if (g->faces == RENDERER_FACES_SAFE) return way & GEOMIPMAP_WITHIN_VIEW && !view->below_ground;
    return g->faces == RENDERER_FACES_FRONT;
}

// All at once, or block by block where each has its own textures.
static void draw_way(struct geomipmap *g, const struct geomipmap_view *view, enum render_pass pass, int way)
{
    int first = view->first_draw[way], last = first + view->draws[way];
    if (!g->own_shading || pass != PASS_SHADED) {
        draw_range(g, view, first, last - first);
        return;
    }
    for (int end; first < last; first = end) {
        for (end = first + 1; end < last && view->blocks[end] == view->blocks[first];) end++;
        geomipmap_shading_bind(&g->shading, view->blocks[first], view->eye_m);
        draw_range(g, view, first, end - first);
    }
}

static void draw_gathered(struct geomipmap *g, const struct geomipmap_view *view, enum render_pass pass)
{
    for (int way = GEOMIPMAP_WAYS - 1; way >= 0; way--) { // most lie within both
        if (view->draws[way] == 0) continue;
        bind(g, view, &g->programs[pass][way & GEOMIPMAP_WITHIN_MAP]);
        // Measuring looks for faces seen from below.
        if (pass != PASS_POSITION && front_only(g, view, way))
            glEnable(GL_CULL_FACE);
        else
            glDisable(GL_CULL_FACE);
        draw_way(g, view, pass, way);
    }
    glDisable(GL_CULL_FACE);
}

static void draw(struct renderer *renderer, int view_index, enum render_pass pass)
{
    struct geomipmap *g = (struct geomipmap *)renderer;
    struct geomipmap_view *view = &g->views[view_index];
    if (!g->streamed) draw_gathered(g, view, pass);
    for (int start = 0, done; g->streamed && start < view->drawn; start += done) {
        geomipmap_cache_begin_batch(&g->cache);
        done = gather(g, view, start);
        draw_gathered(g, view, pass);
    }
}

// Buffers of the GL, for slots, index sets and morphs.
static size_t buffer_bytes(const struct geomipmap *g)
{
    size_t slot_bytes = (size_t)g->tile_vertices * g->vertex_bytes + sizeof(struct texel);
    size_t bytes = (size_t)g->room * slot_bytes + g->mesh.index_count * sizeof *g->mesh.indices;
    for (int i = 0; i < RENDERER_MAX_VIEWS; i++)
        bytes += (size_t)g->views[i].morph_room * sizeof *g->views[i].morphs;
    return bytes;
}

// What grows with the terrain or the view: tiles, cache, selections, index sets and lists of draws, and the
// buffers.
static size_t tile_bytes(const struct geomipmap *g)
{
    size_t bytes = geomipmap_tiles_bytes(&g->tiles) + geomipmap_cache_bytes(&g->cache) + buffer_bytes(g) +
                   (size_t)g->mesh.part_count * sizeof *g->mesh.parts;
    for (int i = 0; i < RENDERER_MAX_VIEWS; i++) {
        const struct geomipmap_view *view = &g->views[i];
        bytes +=
            (size_t)g->form_room * sizeof *g->forms / RENDERER_MAX_VIEWS +
            geomipmap_selection_bytes(&view->selection) +
            (size_t)view->room * (sizeof *view->counts + sizeof *view->first + sizeof *view->base_vertex +
                                  (view->blocks ? sizeof *view->blocks : 0)) +
            (size_t)view->morph_room * sizeof *view->morphs;
    }
    return bytes;
}

static void add_shading_counters(const struct geomipmap *g, struct renderer_stats *stats)
{
    const struct geomipmap_drape *light = &g->shading.light, *colour = &g->shading.colour;
    int n = 0;
    while (stats->counters[n].name) n++;
    stats->counters[n++] =
        (struct renderer_counter){"texture_bytes", (double)(light->resident_bytes + colour->resident_bytes)};
    stats->counters[n++] =
        (struct renderer_counter){"texture_loads", (double)(light->loads + colour->loads - g->loads_before)};
    stats->counters[n++] =
        (struct renderer_counter){"texture_ahead", (double)(light->ahead + colour->ahead - g->ahead_before)};
    stats->counters[n++] =
        (struct renderer_counter){"blocks_by_overview", light->shown_by_overview + colour->shown_by_overview};
}

// What is drawn stays within tau of the finest level: where errors are mean ones, where tiles are late, and
// where those of blocks from coarser levels are estimates, nothing is claimed.
static double claimed_px(const struct geomipmap *g, int late)
{
    const struct geomipmap_tiles *tiles = &g->tiles;
    bool estimated = tiles->drawn > tiles->merge &&
                     terrain_level(tiles->terrain, terrain_info(tiles->terrain)->coarsest).max_estimated;
    return g->choice.metric == GEOMIPMAP_MEAN || late > 0 || estimated ? (double)NAN : g->choice.tau_px;
}

static void stats(const struct renderer *renderer, struct renderer_stats *stats)
{
    const struct geomipmap *g = (const struct geomipmap *)renderer;
    const struct geomipmap_cache_counts *now = &g->cache.counts, *before = &g->counts_before;
    double samples = (double)terrain_info(g->tiles.terrain)->samples;
    size_t own = tile_bytes(g) + geomipmap_shading_bytes(&g->shading);
    int late = g->view_count > 0 ? g->views[0].selection.late : 0;
    *stats = (struct renderer_stats){
        .triangles = g->view_count > 0 ? g->views[0].triangles : 0,
        .claimed_error_px = claimed_px(g, late),
        .resident_bytes =
            buffer_bytes(g) + g->shading.light.resident_bytes + g->shading.colour.resident_bytes,
        .select_ms = g->select_ms,
        .prepare_ms = g->shading.light_ms,
        .counters = {{"tiles", g->view_count > 0 ? g->views[0].drawn : 0},
                     {"hits", (double)(now->hits - before->hits)},
                     {"misses", (double)(now->misses - before->misses)},
                     {"evictions", (double)(now->evictions - before->evictions)},
                     {"grown", (double)(now->grown - before->grown)},
                     {"shrunk", (double)(now->shrunk - before->shrunk)},
                     {"slots", g->cache.slot_count},
                     {"late", late},
                     {"reformed", (double)g->reformed},
                     {"height_bytes", (double)g->vertex_bytes},
                     {"index_bytes", (double)(g->mesh.index_count * sizeof *g->mesh.indices)},
                     {"tile_bytes_a_sample", (double)own / samples},
                     {"bytes_a_sample",
                      ((double)own + (double)terrain_resident_bytes(g->tiles.terrain)) / samples}},
    };
    if (g->own_shading) add_shading_counters(g, stats);
}

// ---- creation -----------------------------------------------------------------------------------

static bool build_program(struct geomipmap *g, const struct scene_effects *effects, enum render_pass pass,
                          bool inside)
{
    struct geomipmap_program *p = &g->programs[pass][inside];
    char defines[224];
    snprintf(defines, sizeof defines, "#define TILE_ROW %d\n%s#define HEIGHTS %s\n#define BLEND %d\n%s%s",
             (1 << g->tiles.bits) + 1, g->choice.morph ? "#define MORPH\n" : "",
             g->tiles.wide ? "isamplerBuffer" : "usamplerBuffer", g->blend,
             g->shading.colour.subs ? "#define COLOUR\n" : "", inside ? GPU_INSIDE_OUTLINE : "");
    if (!gpu_program_build(g->gpu, &p->program, "geomipmap/geomipmap.vert", defines, effects, pass))
        return false;
    p->eye_cell = glGetUniformLocation(p->program.name, "eye_cell");
    p->eye_fraction = glGetUniformLocation(p->program.name, "eye_fraction");
    p->spacing = glGetUniformLocation(p->program.name, "spacing");
    p->places = glGetUniformLocation(p->program.name, "places");
    p->heights = glGetUniformLocation(p->program.name, "heights");
    p->morphs = glGetUniformLocation(p->program.name, "morphs");
    return true;
}

static bool build_programs(struct geomipmap *g, const struct scene_effects *effects)
{
    for (int pass = 0; pass < PASS_COUNT; pass++)
        for (int inside = 0; inside < 2; inside++)
            if (!build_program(g, effects, (enum render_pass)pass, inside)) return false;
    return true;
}

static bool allocate(struct geomipmap *g)
{
    for (int i = 0; i < RENDERER_MAX_VIEWS; i++)
        if (!geomipmap_selection_init(&g->views[i].selection)) return false;
    g->heights = malloc((size_t)g->tile_vertices * sizeof *g->heights);
    g->heights_16 = malloc((size_t)g->tile_vertices * sizeof *g->heights_16);
    return (g->heights && g->heights_16) || fail("geomipmap: no memory for the heights of a tile");
}

// Slots are numbered by texels of the places buffer, and vertices by int; morphing reads both by texels.
static int most_slots(const struct geomipmap *g, double knob)
{
    GLint texels;
    glGetIntegerv(GL_MAX_TEXTURE_BUFFER_SIZE, &texels);
    int limit = INT_MAX / g->tile_vertices;
    if (limit > texels) limit = texels;
    if (g->choice.morph && limit > texels / g->tile_vertices) limit = texels / g->tile_vertices;
    return knob >= 1 && knob < limit ? (int)knob : limit;
}

static void create_buffers(struct geomipmap *g)
{
    glGenVertexArrays(1, &g->vertex_array);
    glBindVertexArray(g->vertex_array);
    glGenBuffers(1, &g->indices);
    glBindBuffer(GL_ELEMENT_ARRAY_BUFFER, g->indices);
    gpu_buffer_data(g->gpu, GL_ELEMENT_ARRAY_BUFFER, g->mesh.index_count * sizeof *g->mesh.indices,
                    g->mesh.indices, GL_STATIC_DRAW);
    geomipmap_mesh_release(&g->mesh);
    glGenTextures(1, &g->places_texture);
    glGenTextures(1, &g->heights_texture);
    for (int i = 0; i < RENDERER_MAX_VIEWS; i++) {
        glGenBuffers(1, &g->views[i].morph_buffer);
        glGenTextures(1, &g->views[i].morph_texture);
    }
    resize_slots(g, FIRST_ROOM);
}

static void destroy(struct renderer *renderer)
{
    struct geomipmap *g = (struct geomipmap *)renderer;
    if (!g) return;
    for (int pass = 0; pass < PASS_COUNT; pass++)
        for (int inside = 0; inside < 2; inside++) gpu_program_finish(&g->programs[pass][inside].program);
    if (g->vertex_array) { // GL objects come last, all or none
        const GLuint buffers[3] = {g->indices, g->vertices, g->places};
        glDeleteBuffers(3, buffers);
        glDeleteTextures(1, &g->places_texture);
        glDeleteTextures(1, &g->heights_texture);
        glDeleteVertexArrays(1, &g->vertex_array);
    }
    for (int i = 0; i < RENDERER_MAX_VIEWS; i++) {
        geomipmap_selection_finish(&g->views[i].selection);
        free(g->views[i].counts);
        free(g->views[i].first);
        free(g->views[i].base_vertex);
        free(g->views[i].morphs);
        free(g->views[i].blocks);
        if (!g->vertex_array) continue;
        glDeleteBuffers(1, &g->views[i].morph_buffer);
        glDeleteTextures(1, &g->views[i].morph_texture);
    }
    terrain_reader_destroy(g->reader);
    free(g->forms);
    free(g->heights);
    free(g->heights_16);
    geomipmap_shading_finish(&g->shading);
    scene_colour_release(g->held);
    geomipmap_cache_finish(&g->cache);
    geomipmap_tiles_finish(&g->tiles);
    geomipmap_mesh_finish(&g->mesh);
    free(g);
}

static bool init_shading(struct geomipmap *g, const struct renderer_desc *desc)
{
    struct scene_colour *image = desc->effects->colour;
    if (image && !scene_colour_hold(image)) return false;
    g->held = image;
    const struct geomipmap_colour colour = {image ? image->width : 0, image ? image->height : 0,
                                            image ? image->pixels : NULL};
    return geomipmap_shading_init(&g->shading, g->gpu, &g->tiles, &colour, (int)desc->knobs[KNOB_TEXTURE],
                                  (size_t)desc->knobs[KNOB_TEXTURES] * 1024);
}

// Samples of the finest level are too many to be asked for tile by tile: without the levels they are waited
// for.
static bool init_reader(struct geomipmap *g, const struct renderer_desc *desc, bool filtered)
{
    size_t stride;
    if (!filtered || terrain_samples(desc->terrain, terrain_info(desc->terrain)->finest, &stride))
        return true;
    g->choice.reader = g->reader = terrain_reader_create(desc->terrain, desc->realtime);
    return g->reader;
}

static bool init(struct geomipmap *g, const struct renderer_desc *desc)
{
    int bits = 3 + (int)desc->knobs[KNOB_PATCH];
    g->choice = (struct geomipmap_choice){.metric = (enum geomipmap_metric)desc->knobs[KNOB_METRIC],
                                          .tau_px = desc->knobs[KNOB_TAU],
                                          .cull = desc->knobs[KNOB_CULL] != 0,
                                          .borders = (enum geomipmap_borders)desc->knobs[KNOB_BORDERS],
                                          .hysteresis = desc->knobs[KNOB_HYSTERESIS],
                                          .morph = desc->knobs[KNOB_MORPH] != 0};
    g->faces = (enum renderer_faces)desc->knobs[KNOB_FACES];
    g->ahead = desc->knobs[KNOB_AHEAD];
    g->own_shading = desc->effects->shading == SCENE_SHADING_OWN;
    g->blend = (int)desc->knobs[KNOB_BLEND];
    enum geomipmap_delta delta = (enum geomipmap_delta)desc->knobs[KNOB_DELTA];
    if (g->choice.metric == GEOMIPMAP_MEAN) delta = GEOMIPMAP_SAVING;
    int merge = (int)desc->knobs[KNOB_MERGE], most = GEOMIPMAP_MAX_EXTENT - bits;
    if (g->choice.borders == GEOMIPMAP_REMOVE) merge = 0;
    bool filtered = desc->knobs[KNOB_HEIGHTS] == HEIGHTS_LEVELS && !g->choice.morph &&
                    g->choice.borders != GEOMIPMAP_REMOVE;
    if (!init_reader(g, desc, filtered)) return false;
    if (!geomipmap_mesh_init(&g->mesh, bits, g->choice.borders, desc->knobs[KNOB_INDICES] != 0) ||
        !geomipmap_tiles_init(&g->tiles, desc->terrain, bits, merge < most ? merge : most, delta, filtered,
                              0))
        return false;
    g->tile_vertices = ((1 << bits) + 1) * ((1 << bits) + 1);
    g->highest_q = geomipmap_tiles_bounds(&g->tiles, (struct geomipmap_place){g->tiles.top, 0, 0}).high;
    // Programs that morph are made for the one or the other; others follow what is really drawn.
    g->vertex_bytes = g->choice.morph && g->tiles.wide ? sizeof(int32_t) : sizeof(uint16_t);
    if (!geomipmap_cache_init(&g->cache, most_slots(g, desc->knobs[KNOB_CACHE]), 0) || !allocate(g) ||
        (g->own_shading && !init_shading(g, desc)) || !build_programs(g, desc->effects))
        return false;
    // A tile shows the pictures of one block.
    if (g->own_shading && g->tiles.drawn > g->shading.block_height) g->tiles.drawn = g->shading.block_height;
    if (g->own_shading) geomipmap_shading_use_program(&g->shading, g->programs[PASS_SHADED][0].program.name);
    create_buffers(g);
    return true;
}

static struct renderer *create(const struct renderer_desc *desc)
{
    struct geomipmap *g = calloc(1, sizeof *g);
    if (!g) {
        fail("geomipmap: no memory");
        return NULL;
    }
    g->base.type = &geomipmap_renderer;
    g->gpu = desc->gpu;
    if (init(g, desc)) return &g->base;
    destroy(&g->base);
    return NULL;
}

const struct renderer_type geomipmap_renderer = {
    .name = "geomipmap",
    .summary = "tiles at the coarsest level within tau, stitched borders, LRU vertex buffer",
    .knobs = knobs,
    .quality_knob = "tau",
    .quick = quick_tau,
    .full = full_tau,
    .create = create,
    .begin_frame = begin_frame,
    .update = update,
    .draw = draw,
    .stats = stats,
    .destroy = destroy,
};
