// SPDX-License-Identifier: MIT
#include "clipmap/sphere.h"

#include "clipmap/sphere_levels.h"
#include "common/report.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { HEIGHTS_UNIT = 0, RINGS_A_BLOCK = 24 };

struct block_selection { // blocks of one view that are drawn
    GLsizei *counts;
    size_t *first_index;
    GLint *base_vertex;
    int draws, blocks;
    uint64_t triangles;
};

struct sphere_view {
    struct sphere_store stores[SPHERE_MAX_LEVELS];
    struct view view;
    bool seen;   // view is that of an update before
    double turn; // of the pattern from east
    struct sphere_ring_range range;
    struct block_selection selection;
    GLuint heights; // one layer a level
    uint64_t texels_read, texels_left;
    int finest_there; // level: what is finer is not whole yet
};

struct sphere_program {
    struct gpu_program program;
    GLint heights, windows, grids, viewer, pattern, polar;
};

struct clipmap_sphere {
    struct gpu *gpu;
    const struct terrain *terrain;
    struct sphere_choice choice;
    struct sphere_rings rings;
    struct sphere_shape shape;
    int layers, max_blocks, view_count, frame;
    int row;               // vertices of a ring in the buffer: the first once more at the end, and the nadir
    size_t disc_first[16]; // index lists of the disc's octaves
    GLsizei disc_count[16];
    size_t fan_first; // of the fans, one a sector
    GLuint vertices, indices, vertex_array;
    float *scratch;
    int32_t *columns;
    struct sphere_view views[RENDERER_MAX_VIEWS];
    struct sphere_program programs[PASS_COUNT];
};

// ---- the static geometry ---------------------------------------------------

static bool upload_vertices(struct clipmap_sphere *s)
{
    const struct sphere_rings *rings = &s->rings;
    float(*vertices)[4] = malloc((size_t)s->row * (size_t)rings->count * sizeof *vertices);
    if (!vertices) return fail("clipmap: no memory for %d rings", rings->count);
    for (int ring = 0; ring < rings->count; ring++) {
        float(*row)[4] = vertices + (size_t)ring * (size_t)s->row;
        for (int a = 0; a <= rings->azimuths; a++) sphere_ring_vertex(rings, ring, a, row[a]);
        sphere_ring_vertex(rings, rings->count - 1, 0, row[rings->azimuths + 1]);
    }
    glBindBuffer(GL_ARRAY_BUFFER, s->vertices);
    gpu_buffer_data(s->gpu, GL_ARRAY_BUFFER, (size_t)s->row * (size_t)rings->count * sizeof *vertices,
                    vertices, GL_STATIC_DRAW);
    free(vertices);
    return true;
}

// ---- index lists, one sector each, counter-clockwise from above: azimuths run so, rings inwards
// ---------------

static uint32_t *add_triangle(uint32_t *to, int a, int b, int c)
{
    to[0] = (uint32_t)a, to[1] = (uint32_t)b, to[2] = (uint32_t)c;
    return to + 3;
}

static uint32_t *add_quads(uint32_t *to, int row, int ring, int ring_step, int rings, int across, int step)
{
    for (int r = ring; r < ring + rings; r += ring_step)
        for (int a = 0; a < across; a += step) {
            int outer = r * row + a, inner = outer + ring_step * row;
            to = add_triangle(to, outer, outer + step, inner + step);
            to = add_triangle(to, outer, inner + step, inner);
        }
    return to;
}

// From a ring with azimuths `step` / 2 apart to one with `step`.
static uint32_t *add_transition(uint32_t *to, int row, int ring_step, int across, int step)
{
    for (int a = 0; a < across; a += step) {
        int outer = a, middle = a + step / 2, inner = ring_step * row + a;
        to = add_triangle(to, outer, middle, inner);
        to = add_triangle(to, middle, inner + step, inner);
        to = add_triangle(to, middle, outer + step, inner + step);
    }
    return to;
}

static int disc_ring_step(int octave)
{
    return 1 << (octave < 4 ? octave : 4); // an octave has a multiple of 16 rings
}

static bool upload_indices(struct clipmap_sphere *s)
{
    int across = s->rings.azimuths / SPHERE_SECTORS, octave = s->rings.an_octave;
    size_t most =
        6 * (size_t)across * (size_t)(RINGS_A_BLOCK + 2 * octave + 4) + 3 * (size_t)s->rings.azimuths;
    uint32_t *indices = malloc(most * sizeof *indices), *to = indices;
    if (!indices) return fail("clipmap: no memory for %zu indices", most);
    to = add_quads(to, s->row, 0, 1, RINGS_A_BLOCK, across, 1);
    for (int k = 0; k <= s->rings.halvings; k++) {
        int step = 1 << k, ring_step = disc_ring_step(k), done = k ? ring_step : 0;
        s->disc_first[k] = (size_t)(to - indices);
        if (k) to = add_transition(to, s->row, ring_step, across, step);
        to = add_quads(to, s->row, done, ring_step, octave - done, across, step);
        s->disc_count[k] = (GLsizei)((size_t)(to - indices) - s->disc_first[k]);
    }
    s->fan_first = (size_t)(to - indices);
    for (int a = 0; a < s->rings.azimuths; a += 1 << s->rings.halvings)
        to = add_triangle(to, a, a + (1 << s->rings.halvings), s->row - 1);
    glBindBuffer(GL_ELEMENT_ARRAY_BUFFER, s->indices);
    gpu_buffer_data(s->gpu, GL_ELEMENT_ARRAY_BUFFER, (size_t)(to - indices) * sizeof *indices, indices,
                    GL_STATIC_DRAW);
    free(indices);
    return true;
}

static bool create_geometry(struct clipmap_sphere *s)
{
    s->row = s->rings.azimuths + 2;
    glGenVertexArrays(1, &s->vertex_array);
    glBindVertexArray(s->vertex_array);
    glGenBuffers(1, &s->vertices);
    glGenBuffers(1, &s->indices);
    if (!upload_vertices(s) || !upload_indices(s)) return false;
    glEnableVertexAttribArray(0);
    glVertexAttribPointer(0, 4, GL_FLOAT, GL_FALSE, 4 * sizeof(float), NULL);
    glBindVertexArray(0);
    return true;
}

static bool build_programs(struct clipmap_sphere *s, const struct scene_effects *effects)
{
    char defines[128];
    struct scene_effects common = scene_effects_common(effects);
    snprintf(defines, sizeof defines, GPU_SPHERE "#define SIZE %d\n#define FORM %d\n", s->shape.size,
             (int)s->choice.form);
    for (int pass = 0; pass < PASS_COUNT; pass++) {
        struct sphere_program *p = &s->programs[pass];
        if (!gpu_program_build(s->gpu, &p->program, "clipmap/sphere.vert", defines, &common, pass))
            return false;
        GLuint name = p->program.name;
        p->heights = glGetUniformLocation(name, "heights");
        p->windows = glGetUniformLocation(name, "windows");
        p->grids = glGetUniformLocation(name, "grids");
        p->viewer = glGetUniformLocation(name, "viewer");
        p->pattern = glGetUniformLocation(name, "pattern");
        p->polar = glGetUniformLocation(name, "polar");
    }
    return true;
}

// ---- one viewer ------------------------------------------------------------

static bool create_view(struct clipmap_sphere *s, struct sphere_view *own)
{
    struct block_selection *selection = &own->selection;
    size_t count = (size_t)s->max_blocks;
    selection->counts = calloc(count, sizeof *selection->counts);
    selection->first_index = calloc(count, sizeof *selection->first_index);
    selection->base_vertex = calloc(count, sizeof *selection->base_vertex);
    if (!selection->counts || !selection->first_index || !selection->base_vertex)
        return fail("clipmap: no memory for %zu blocks", count);
    for (int k = 0; k < SPHERE_MAX_LEVELS; k++) own->stores[k].held.box = clipmap_empty;
    glGenTextures(1, &own->heights);
    glActiveTexture(GL_TEXTURE0 + HEIGHTS_UNIT);
    glBindTexture(GL_TEXTURE_2D_ARRAY, own->heights);
    glTexParameteri(GL_TEXTURE_2D_ARRAY, GL_TEXTURE_MIN_FILTER, GL_NEAREST);
    glTexParameteri(GL_TEXTURE_2D_ARRAY, GL_TEXTURE_MAG_FILTER, GL_NEAREST);
    glTexParameteri(GL_TEXTURE_2D_ARRAY, GL_TEXTURE_MAX_LEVEL, 0);
    glTexImage3D(GL_TEXTURE_2D_ARRAY, 0, GL_R32F, s->shape.size, s->shape.size, s->layers, 0, GL_RED,
                 GL_FLOAT, NULL);
    return true;
}

struct layer {
    struct gpu *gpu;
    int index;
};

static void write_layer(void *user, int slot_x, int slot_y, int width, int height, const float *heights_q)
{
    const struct layer *layer = user;
    gpu_texture_sub_image(layer->gpu, GL_TEXTURE_2D_ARRAY, layer->index, slot_x, slot_y, width, height,
                          GL_RED, GL_FLOAT, heights_q);
}

// Coarse levels first; the coarsest is read whole whatever the budget, for without it there is nothing to
// draw.
static void refill(struct clipmap_sphere *s, struct sphere_view *own)
{
    bool all = true;
    own->texels_read = 0;
    own->finest_there = s->shape.coarsest;
    glActiveTexture(GL_TEXTURE0 + HEIGHTS_UNIT);
    glBindTexture(GL_TEXTURE_2D_ARRAY, own->heights);
    for (int level = s->shape.coarsest; level >= s->shape.finest; level--) {
        struct sphere_store *store = &own->stores[level - s->shape.finest];
        struct sphere_window wanted = sphere_window_wanted(&s->shape, level, own->view.eye_place);
        struct layer layer = {s->gpu, level - s->shape.finest};
        bool limited = level < s->shape.coarsest && own->texels_left < UINT64_MAX, whole;
        if (s->choice.rebuild) store->held.box = clipmap_empty;
        uint64_t read = sphere_store_move(store, &s->shape, s->terrain, level, &wanted,
                                          limited ? own->texels_left : UINT64_MAX, s->scratch, s->columns,
                                          write_layer, &layer, &whole);
        if (limited) own->texels_left -= read;
        own->texels_read += read;
        all = all && whole;
        if (all) own->finest_there = level;
    }
}

static double over_ground(const struct terrain *terrain, const struct view *view)
{
    const struct terrain_info *info = terrain_info(terrain);
    double q = info->min_q;
    terrain_truth_at(terrain, view->eye_place[0], view->eye_place[1], &q, NULL);
    return view->eye_place[2] - (q * info->quantum_m + info->offset_m);
}

static void add_block(struct block_selection *selection, GLsizei count, size_t first_index, int base_vertex)
{
    int k = selection->draws++;
    selection->counts[k] = count;
    selection->first_index[k] = first_index;
    selection->base_vertex[k] = base_vertex;
    selection->triangles += (uint64_t)count / 3;
}

// Heights over the datum that rings from `outer` inwards to `inner` may have: those of the levels they
// sample.
static void part_heights(const struct clipmap_sphere *s, const struct sphere_view *own, int outer, int inner,
                         double *low_m, double *high_m)
{
    const struct terrain_info *info = terrain_info(s->terrain);
    double angle = sphere_ring_angle(&s->rings, outer), least = sphere_ring_angle(&s->rings, inner);
    int from = least > 0 ? (int)floor(sphere_level_at(&s->shape, least)) : own->finest_there;
    int to = (int)floor(sphere_level_at(&s->shape, angle)) + 1;
    int32_t low_q = INT32_MAX, high_q = INT32_MIN;
    if (from < own->finest_there) from = own->finest_there;
    if (from > s->shape.coarsest) from = s->shape.coarsest;
    if (to > s->shape.coarsest) to = s->shape.coarsest;
    for (int level = from; level <= (to > from ? to : from); level++) {
        int32_t low, high;
        sphere_cap_bounds(&s->shape, s->terrain, level, &own->stores[level - s->shape.finest].held,
                          own->view.eye_place, angle, &low, &high);
        low_q = low < low_q ? low : low_q;
        high_q = high > high_q ? high : high_q;
    }
    *low_m = info->offset_m + info->quantum_m * low_q;
    *high_m = info->offset_m + info->quantum_m * high_q;
}

// The blocks of one part, a sector each.
static void select_sectors(struct clipmap_sphere *s, struct sphere_view *own, const struct frustum *frustum,
                           int outer, int inner, GLsizei count, size_t first_index)
{
    int across = s->rings.azimuths / SPHERE_SECTORS;
    double low_m = 0, high_m = 0;
    if (s->choice.cull) part_heights(s, own, outer, inner, &low_m, &high_m);
    for (int sector = 0; sector < SPHERE_SECTORS; sector++) {
        int ring[2] = {outer, inner}, azimuth[2] = {sector * across, (sector + 1) * across};
        double low[3], high[3];
        unsigned mask = FRUSTUM_ALL;
        own->selection.blocks++;
        sphere_block_box(&s->rings, &own->view, own->turn, ring, azimuth, low_m, high_m, low, high);
        if (!s->choice.cull || frustum_test_box(frustum, low, high, &mask) != FRUSTUM_OUTSIDE)
            add_block(&own->selection, count, first_index, outer * s->row + azimuth[0]);
    }
}

// Rings inwards, then the disc within the innermost: its octaves, and a fan at its middle.
static void select_blocks(struct clipmap_sphere *s, struct sphere_view *own)
{
    struct block_selection *selection = &own->selection;
    struct frustum frustum;
    int across = s->rings.azimuths / SPHERE_SECTORS, inner = own->range.inner, octave = s->rings.an_octave;
    int fan = inner + (s->rings.halvings + 1) * octave, fan_count = 3 * (across >> s->rings.halvings);
    frustum_init(&frustum, &own->view);
    selection->draws = selection->blocks = 0;
    selection->triangles = 0;
    for (int r = own->range.outer; r < inner; r += RINGS_A_BLOCK) {
        int end = r + RINGS_A_BLOCK < inner ? r + RINGS_A_BLOCK : inner;
        select_sectors(s, own, &frustum, r, end, 6 * across * (end - r), 0);
    }
    for (int k = 0; k <= s->rings.halvings; k++)
        select_sectors(s, own, &frustum, inner + k * octave, inner + (k + 1) * octave, s->disc_count[k],
                       s->disc_first[k]);
    for (int sector = 0; sector < SPHERE_SECTORS; sector++) // few triangles: not worth a test
        add_block(selection, fan_count, s->fan_first + (size_t)(sector * fan_count), fan * s->row);
}

static void update_view(struct clipmap_sphere *s, struct sphere_view *own, const struct view *view)
{
    own->turn = own->seen ? sphere_transport(&own->view, own->turn, view) : 0;
    own->seen = true;
    own->view = *view;
    own->range = sphere_ring_visible(&s->rings, s->terrain, view, over_ground(s->terrain, view));
    refill(s, own);
    select_blocks(s, own);
}

// ---- the contract ----------------------------------------------------------

// As for the plane: a frame's budget is spent once, and the first frame of a flight begins anew.
void clipmap_sphere_begin_frame(struct clipmap_sphere *s, int frame)
{
    bool first = s->frame < 0 || frame < s->frame;
    for (int i = 0; i < RENDERER_MAX_VIEWS; i++) {
        struct sphere_view *own = &s->views[i];
        if (frame != s->frame) own->texels_left = first ? UINT64_MAX : s->choice.budget;
        if (first) own->seen = false;
        for (int k = 0; first && s->choice.budget < UINT64_MAX && k < s->layers; k++)
            own->stores[k].held.box = clipmap_empty;
    }
    s->frame = frame;
}

bool clipmap_sphere_update(struct clipmap_sphere *s, const struct view *views, int count)
{
    for (int i = 0; i < count; i++) {
        if (!s->views[i].heights && !create_view(s, &s->views[i])) return false;
        update_view(s, &s->views[i], &views[i]);
    }
    s->view_count = count;
    return true;
}

static void set_uniforms(const struct clipmap_sphere *s, const struct sphere_program *p,
                         const struct sphere_view *own)
{
    GLint windows[SPHERE_MAX_LEVELS][4] = {{0}};
    GLfloat grids[SPHERE_MAX_LEVELS][4] = {{0}};
    const double *place = own->view.eye_place;
    double latitude = place[1] / s->shape.radius_m;
    for (int k = 0; k < s->layers; k++) {
        const struct sphere_window *window = &own->stores[k].held;
        int64_t texel[2];
        sphere_window_origin(&s->shape, s->shape.finest + k, window, place, texel, &grids[k][2]);
        windows[k][0] = clipmap_slot(texel[0], window->period);
        windows[k][1] = clipmap_slot(texel[1], s->shape.size);
        windows[k][2] = window->period;
        for (int axis = 0; axis < 2; axis++)
            grids[k][axis] =
                (float)(s->shape.radius_m / ldexp(s->shape.spacing_m[axis],
                                                  s->shape.finest + k + (axis ? 0 : window->decimation)));
    }
    glUniform1i(p->heights, HEIGHTS_UNIT);
    glUniform4iv(p->windows, s->layers, &windows[0][0]);
    glUniform4fv(p->grids, s->layers, &grids[0][0]);
    glUniform4f(p->viewer, (float)cos(latitude), (float)sin(latitude),
                (float)(sphere_level_at(&s->shape, M_PI) - s->shape.finest),
                1.0f / (float)s->rings.an_octave);
    glUniform4f(p->pattern, (float)cos(own->turn), (float)sin(own->turn),
                (float)(own->finest_there - s->shape.finest), (float)(s->layers - 1));
    if (p->polar >= 0) glUniform1f(p->polar, (float)(M_PI / 2 - latitude));
}

void clipmap_sphere_draw(struct clipmap_sphere *s, int view_index, enum render_pass pass)
{
    const struct sphere_view *own = &s->views[view_index];
    const struct block_selection *selection = &own->selection;
    if (!selection->draws) return;
    gpu_use_program(s->gpu, &s->programs[pass].program);
    glActiveTexture(GL_TEXTURE0 + HEIGHTS_UNIT);
    glBindTexture(GL_TEXTURE_2D_ARRAY, own->heights);
    set_uniforms(s, &s->programs[pass], own);
    glBindVertexArray(s->vertex_array);
    glBindBuffer(GL_ELEMENT_ARRAY_BUFFER, s->indices);
    gpu_multi_draw_elements(s->gpu, GL_TRIANGLES, selection->counts, GL_UNSIGNED_INT, selection->first_index,
                            selection->base_vertex, selection->draws, selection->triangles);
    glBindVertexArray(0);
}

void clipmap_sphere_stats(const struct clipmap_sphere *s, struct renderer_stats *stats)
{
    const struct sphere_view *own = &s->views[0];
    uint64_t texture =
        (uint64_t)s->shape.size * (uint64_t)s->shape.size * (uint64_t)s->layers * sizeof(float);
    double level_outer = sphere_level_at(&s->shape, sphere_ring_angle(&s->rings, own->range.outer));
    double level_inner = sphere_level_at(&s->shape, sphere_ring_angle(&s->rings, own->range.inner));
    level_outer = fmin(fmax(level_outer, own->finest_there), s->shape.coarsest);
    level_inner = fmin(fmax(level_inner, own->finest_there), s->shape.coarsest);
    *stats = (struct renderer_stats){
        .triangles = own->selection.triangles,
        .claimed_error_px = NAN,
        .resident_bytes =
            (uint64_t)s->row * (uint64_t)s->rings.count * 16 + texture * (uint64_t)s->view_count,
        .counters = {{"levels drawn", ceil(level_outer) - floor(level_inner) + 1},
                     {"rings drawn", own->range.inner - own->range.outer + 1},
                     {"blocks drawn", own->selection.draws},
                     {"blocks", own->selection.blocks},
                     {"samples updated", (double)own->texels_read},
                     {"levels behind", own->finest_there - s->shape.finest}},
    };
}

void clipmap_sphere_destroy(struct clipmap_sphere *s)
{
    if (!s) return;
    for (int pass = 0; pass < PASS_COUNT; pass++) gpu_program_finish(&s->programs[pass].program);
    for (int i = 0; i < RENDERER_MAX_VIEWS; i++) {
        if (s->views[i].heights) glDeleteTextures(1, &s->views[i].heights);
        free(s->views[i].selection.counts);
        free(s->views[i].selection.first_index);
        free(s->views[i].selection.base_vertex);
    }
    if (s->vertex_array) glDeleteVertexArrays(1, &s->vertex_array);
    if (s->vertices) glDeleteBuffers(1, &s->vertices);
    if (s->indices) glDeleteBuffers(1, &s->indices);
    free(s->scratch);
    free(s->columns);
    free(s);
}

struct clipmap_sphere *clipmap_sphere_create(const struct renderer_desc *desc,
                                             const struct sphere_choice *choice)
{
    struct clipmap_sphere *s = calloc(1, sizeof *s);
    if (!s) return fail("clipmap: no memory"), NULL;
    s->gpu = desc->gpu;
    s->terrain = desc->terrain;
    s->choice = *choice;
    s->frame = -1;
    s->rings = sphere_rings_make(choice->n);
    sphere_shape_init(&s->shape, desc->terrain, s->rings.azimuths);
    s->layers = s->shape.coarsest - s->shape.finest + 1;
    s->max_blocks = (s->rings.count / RINGS_A_BLOCK + 20) * SPHERE_SECTORS;
    size_t texels = (size_t)s->shape.size * (size_t)s->shape.size;
    s->scratch = malloc(texels * sizeof *s->scratch);
    s->columns = malloc((texels + 1) * sizeof *s->columns);
    if (!s->scratch || !s->columns)
        fail("clipmap: no memory for %zu texels", texels);
    else if (create_geometry(s) && build_programs(s, desc->effects))
        return s;
    clipmap_sphere_destroy(s);
    return NULL;
}
