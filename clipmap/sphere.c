// SPDX-License-Identifier: MIT
#include "clipmap/sphere.h"

#include "clipmap/sphere_colour.h"
#include "clipmap/sphere_levels.h"
#include "clipmap/sphere_mesh.h"
#include "common/report.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { HEIGHTS_UNIT = 0, WHOLE_UNIT = 2 }; // colours are on 1

struct sphere_view {
    struct sphere_store stores[SPHERE_MAX_LEVELS];
    struct sphere_ranges ranges[SPHERE_MAX_LEVELS]; // of what is held
    struct view view;
    bool seen;   // view is that of an update before
    double turn; // of the pattern from east
    struct sphere_ring_range range;
    struct sphere_blocks blocks;
    int drawn;            // how often, since the vertices last changed
    uint64_t transformed; // vertices, to be kept, since the last update
    struct sphere_colours colours;
    uint64_t colours_read;
    GLuint heights; // one layer a level
    GLuint whole;   // the coarsest
    uint64_t texels_read, texels_left;
    int levels_behind; // that do not hold all they want to
    int finest_there;  // level: what is finer is not there yet
    double least;      // level that the innermost rings sample
};

struct sphere_program {
    struct gpu_program program;
    GLint heights, whole, windows, grids, bilinear_rows, viewer, pattern, polar;
};

struct refilling {
    struct clipmap_sphere *sphere;
    struct sphere_view *view;
};

struct clipmap_sphere {
    struct gpu *gpu;
    const struct terrain *terrain;
    struct terrain_reader *reader; // of terrain that is read on demand; NULL: all is there
    bool realtime, wait;           // wait: in this frame what is read is waited for
    bool new_frame;                // no view of it has been updated
    struct sphere_choice choice;
    struct sphere_rings rings;
    struct sphere_shape shape;
    struct sphere_mesh mesh;
    struct sphere_colour colour; // where the scene has a colour image and calls for shading `own`
    bool own_colour;
    int layers, view_count, frame;
    float *scratch;
    int32_t *columns;
    struct sphere_view views[RENDERER_MAX_VIEWS];
    struct sphere_program programs[PASS_COUNT][2]; // [1]: of kept vertices
};

// ---- programs --------------------------------------------------------------

static bool build_program(struct clipmap_sphere *s, struct sphere_program *p, const char *defines,
                          const struct scene_effects *effects, enum render_pass pass)
{
    if (!gpu_program_build(s->gpu, &p->program, "clipmap/sphere.vert", defines, effects, pass)) return false;
    GLuint name = p->program.name;
    p->heights = glGetUniformLocation(name, "heights");
    p->whole = glGetUniformLocation(name, "whole");
    p->windows = glGetUniformLocation(name, "windows");
    p->grids = glGetUniformLocation(name, "grids");
    p->bilinear_rows = glGetUniformLocation(name, "bilinear_rows");
    p->viewer = glGetUniformLocation(name, "viewer");
    p->pattern = glGetUniformLocation(name, "pattern");
    p->polar = glGetUniformLocation(name, "polar");
    return true;
}

static bool build_programs(struct clipmap_sphere *s, const struct scene_effects *effects)
{
    char defines[256];
    for (int kept = 0; kept < 2; kept++) {
        snprintf(
            defines, sizeof defines,
            GPU_SPHERE
            "#define SIZE %d\n#define WHOLE %d\n#define LAST %d\n#define FORM %d\n#define FETCH %d\n%s%s",
            s->shape.size, s->shape.whole, s->layers - 1, (int)s->choice.form, (int)s->choice.fetch,
            kept ? "#define KEPT\n" : "", s->own_colour ? "#define OWN_COLOUR\n" : "");
        for (int pass = 0; pass < PASS_COUNT; pass++)
            if (!build_program(s, &s->programs[pass][kept], defines, effects, (enum render_pass)pass))
                return false;
    }
    return true;
}

// ---- one viewer ------------------------------------------------------------

static void bind_heights(const struct sphere_view *own)
{
    glActiveTexture(GL_TEXTURE0 + WHOLE_UNIT);
    glBindTexture(GL_TEXTURE_2D, own->whole);
    glActiveTexture(GL_TEXTURE0 + HEIGHTS_UNIT);
    glBindTexture(GL_TEXTURE_2D_ARRAY, own->heights);
}

static bool create_view(struct clipmap_sphere *s, struct sphere_view *own)
{
    if (!sphere_blocks_init(&own->blocks, &s->mesh)) return false;
    if (s->own_colour) sphere_colours_init(&own->colours, &s->colour);
    for (int k = 0; k < s->layers; k++) {
        own->stores[k].held.box = clipmap_empty;
        if (!sphere_ranges_init(&own->ranges[k], sphere_level_size(&s->shape, s->shape.finest + k)))
            return false;
    }
    glGenTextures(1, &own->heights);
    glGenTextures(1, &own->whole);
    bind_heights(own);
    for (int k = 0; k < 2; k++) {
        GLenum target = k ? GL_TEXTURE_2D : GL_TEXTURE_2D_ARRAY;
        glActiveTexture(GL_TEXTURE0 + (k ? WHOLE_UNIT : HEIGHTS_UNIT));
        glTexParameteri(target, GL_TEXTURE_MIN_FILTER, GL_NEAREST);
        glTexParameteri(target, GL_TEXTURE_MAG_FILTER, GL_NEAREST);
        glTexParameteri(target, GL_TEXTURE_MAX_LEVEL, 0);
    }
    glTexImage2D(GL_TEXTURE_2D, 0, GL_R32F, s->shape.whole, s->shape.whole, 0, GL_RED, GL_FLOAT, NULL);
    glActiveTexture(GL_TEXTURE0 + HEIGHTS_UNIT);
    glTexImage3D(GL_TEXTURE_2D_ARRAY, 0, GL_R32F, s->shape.size, s->shape.size, s->layers - 1, 0, GL_RED,
                 GL_FLOAT, NULL);
    return true;
}

static void read_heights(void *user, int level, int decimation, const struct clipmap_box *box, int slot_x,
                         int slot_y)
{
    const struct refilling *refilling = user;
    struct clipmap_sphere *s = refilling->sphere;
    sphere_read_texels(&s->shape, s->terrain, level, decimation, box, s->scratch, s->columns);
    sphere_ranges_add(&refilling->view->ranges[level - s->shape.finest], box, s->scratch);
    bool whole = level == s->shape.coarsest;
    glActiveTexture(GL_TEXTURE0 + (whole ? WHOLE_UNIT : HEIGHTS_UNIT));
    gpu_texture_sub_image(s->gpu, whole ? GL_TEXTURE_2D : GL_TEXTURE_2D_ARRAY,
                          whole ? -1 : level - s->shape.finest, slot_x, slot_y,
                          (int)(box->hi[0] - box->lo[0] + 1), (int)(box->hi[1] - box->lo[1] + 1), GL_RED,
                          GL_FLOAT, s->scratch);
}

static bool heights_there(void *user, int level, int decimation, const struct clipmap_box *box)
{
    const struct clipmap_sphere *s = ((const struct refilling *)user)->sphere;
    return sphere_texels_there(&s->shape, s->reader, level, decimation, box);
}

// Coarse levels first, as fine as the innermost ring needs; the coarsest is read whole whatever the budget
// and waited for, for without it there is nothing to draw.
static void refill(struct clipmap_sphere *s, struct sphere_view *own)
{
    const struct sphere_shape *shape = &s->shape;
    struct refilling refilling = {s, own};
    const struct sphere_source source = {read_heights, s->reader ? heights_there : NULL, &refilling};
    const double *place = own->view.eye_place, innermost = sphere_ring_angle(&s->rings, own->range.inner);
    int finest = sphere_finest_wanted(shape, place, innermost);
    bool all = true;
    own->texels_read = 0;
    own->levels_behind = 0;
    own->finest_there = shape->coarsest;
    bind_heights(own);
    for (int level = shape->coarsest; level >= finest; level--) {
        struct sphere_store *store = &own->stores[level - shape->finest];
        struct sphere_window wanted = sphere_window_wanted(shape, level, place);
        bool limited = level < shape->coarsest && own->texels_left < UINT64_MAX;
        if (s->choice.rebuild) store->held.box = clipmap_empty;
        if (store->held.decimation != wanted.decimation || store->held.around != wanted.around)
            sphere_ranges_clear(&own->ranges[level - shape->finest]);
        uint64_t read = sphere_store_move(store, sphere_level_size(shape, level), level, &wanted,
                                          limited ? own->texels_left : UINT64_MAX,
                                          s->wait || s->choice.rebuild || level == shape->coarsest, &source);
        if (limited) own->texels_left -= read;
        own->texels_read += read;
        own->levels_behind += !clipmap_box_equal(&store->held.box, &wanted.box);
        all = all && sphere_window_serves(shape, level, &store->held, place);
        if (all) own->finest_there = level;
    }
    own->least = fmax(own->finest_there, sphere_level_at(shape, innermost));
    own->least = fmin(own->least, shape->coarsest);
}

static double over_ground(const struct terrain *terrain, const struct view *view)
{
    const struct terrain_info *info = terrain_info(terrain);
    double q = info->min_q;
    terrain_truth_at(terrain, view->eye_place[0], view->eye_place[1], &q, NULL);
    return view->eye_place[2] - (q * info->quantum_m + info->offset_m);
}

// Heights over the datum that rings from `outer` inwards to `inner` may have: those of the levels they
// sample.
static void part_heights(const struct clipmap_sphere *s, const struct sphere_view *own, int outer, int inner,
                         double *low_m, double *high_m)
{
    const struct terrain_info *info = terrain_info(s->terrain);
    double angle = sphere_ring_angle(&s->rings, outer), least = sphere_ring_angle(&s->rings, inner);
    int from = (int)floor(least > 0 ? sphere_level_at(&s->shape, least) : own->least);
    int to = (int)floor(sphere_level_at(&s->shape, angle)) + 1;
    float low_q = HUGE_VALF, high_q = -HUGE_VALF;
    if (from < (int)floor(own->least)) from = (int)floor(own->least);
    if (from > s->shape.coarsest) from = s->shape.coarsest;
    if (to > s->shape.coarsest) to = s->shape.coarsest;
    for (int level = from; level <= (to > from ? to : from); level++) {
        int k = level - s->shape.finest;
        sphere_ranges_within(&own->ranges[k], &s->shape, level, &own->stores[k].held, own->view.eye_place,
                             angle, &low_q, &high_q);
    }
    *low_m = info->offset_m + info->quantum_m * (double)low_q;
    *high_m = info->offset_m + info->quantum_m * (double)high_q;
}

static bool is_in_frustum(const struct frustum *frustum, const struct sphere_block *block)
{
    for (int plane = 0; plane < FRUSTUM_PLANES; plane++)
        if (sphere_block_reach(block, frustum->normal[plane]) + frustum->offset[plane] < 0) return false;
    return true;
}

static void select_blocks(struct clipmap_sphere *s, struct sphere_view *own, bool same)
{
    struct sphere_blocks *blocks = &own->blocks;
    struct frustum frustum;
    frustum_init(&frustum, &own->view);
    sphere_blocks_begin(blocks, &s->mesh, &own->range, same);
    for (int part = blocks->part_count - 1; part >= 0; part--) { // near ones hide far ones
        int ring[2] = {blocks->parts[part].outer, blocks->parts[part].inner};
        bool test = s->choice.cull && ring[0] < ring[1]; // the fan's few triangles are not worth it
        double low_m = 0, high_m = 0;
        if (test) part_heights(s, own, ring[0], ring[1], &low_m, &high_m);
        for (int sector = 0; sector < SPHERE_SECTORS; sector++) {
            int azimuth[2] = {sector * s->mesh.across, (sector + 1) * s->mesh.across};
            struct sphere_block block;
            sphere_block_make(&block, &s->rings, &own->view, own->turn, ring, azimuth, low_m, high_m);
            if (!test || is_in_frustum(&frustum, &block)) sphere_blocks_add(blocks, &s->mesh, part, sector);
        }
    }
}

// While the eye and the levels stand still, every vertex is where it was.
static void update_view(struct clipmap_sphere *s, struct sphere_view *own, const struct view *view)
{
    struct view before = own->view;
    struct sphere_ring_range range = own->range;
    double least = own->least;
    bool moved = memcmp(before.eye_place, view->eye_place, sizeof before.eye_place) != 0;
    if (!own->seen) own->turn = 0;
    if (own->seen && moved) own->turn = sphere_transport(&before, own->turn, view);
    own->view = *view;
    own->range = sphere_ring_visible(&s->rings, s->terrain, view, over_ground(s->terrain, view));
    refill(s, own);
    if (s->own_colour)
        own->colours_read = sphere_colours_update(&own->colours, &s->colour, view->eye_place,
                                                  sphere_ring_angle(&s->rings, own->range.inner));
    bool same = own->seen && !moved && range.outer == own->range.outer && range.inner == own->range.inner &&
                !(least < own->least || own->least < least) && own->texels_read == 0;
    if (!same) own->drawn = 0;
    own->seen = true;
    own->transformed = 0;
    select_blocks(s, own, same);
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
        for (int k = 0; first && (s->choice.budget < UINT64_MAX || s->reader) && k < s->layers; k++)
            own->stores[k].held.box = clipmap_empty;
    }
    if (frame != s->frame) s->wait = first;
    s->new_frame = frame != s->frame;
    s->frame = frame;
}

// A flight has a reader of its own.  The first frame waits for what it reads.
static bool begin_reading(struct clipmap_sphere *s, const struct view *view)
{
    if (terrain_extrema(s->terrain) || !s->new_frame) return true; // all is in memory
    if (s->wait) {
        terrain_reader_destroy(s->reader);
        s->reader = terrain_reader_create(s->terrain, s->realtime);
        if (!s->reader) return false;
    }
    terrain_reader_begin_frame(s->reader, s->frame, view->eye_place);
    s->new_frame = false;
    return true;
}

bool clipmap_sphere_update(struct clipmap_sphere *s, const struct view *views, int count)
{
    if (!begin_reading(s, &views[0])) return false;
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
    GLint bilinear_rows[SPHERE_MAX_LEVELS][2] = {{0}};
    const double *place = own->view.eye_place;
    double latitude = place[1] / s->shape.radius_m;
    for (int k = 0; k < s->layers; k++) {
        sphere_window_uniforms(&s->shape, s->shape.finest + k, &own->stores[k].held, place, windows[k],
                               grids[k]);
        sphere_bilinear_rows(&s->shape, s->shape.finest + k, place, bilinear_rows[k]);
    }
    glUniform1i(p->heights, HEIGHTS_UNIT);
    glUniform1i(p->whole, WHOLE_UNIT);
    glUniform4iv(p->windows, s->layers, &windows[0][0]);
    glUniform4fv(p->grids, s->layers, &grids[0][0]);
    glUniform2iv(p->bilinear_rows, s->layers, &bilinear_rows[0][0]);
    glUniform4f(p->viewer, (float)cos(latitude), (float)sin(latitude),
                (float)(sphere_level_at(&s->shape, M_PI) - s->shape.finest),
                1.0f / (float)s->rings.an_octave);
    glUniform4f(p->pattern, (float)cos(own->turn), (float)sin(own->turn),
                (float)(own->least - s->shape.finest), (float)(s->layers - 1));
    if (p->polar >= 0) glUniform1f(p->polar, (float)(M_PI / 2 - latitude));
}

static void use_program(struct clipmap_sphere *s, const struct sphere_view *own, enum render_pass pass,
                        bool kept)
{
    const struct sphere_program *program = &s->programs[pass][kept];
    gpu_use_program(s->gpu, &program->program);
    if (!kept) set_uniforms(s, program, own);
    if (s->own_colour && pass == PASS_SHADED)
        sphere_colours_use(&own->colours, &s->colour, program->program.name, own->view.eye_place);
}

// Vertices that are drawn once more are kept from then on (section 6.1).
void clipmap_sphere_draw(struct clipmap_sphere *s, int view_index, enum render_pass pass)
{
    struct sphere_view *own = &s->views[view_index];
    bool kept = s->choice.keep && own->drawn++ > 0;
    if (!own->blocks.draws) return;
    bind_heights(own);
    if (kept) {
        use_program(s, own, PASS_DEPTH, false);
        own->transformed += sphere_blocks_keep(&own->blocks, &s->mesh);
    }
    use_program(s, own, pass, kept);
    sphere_blocks_draw(&own->blocks, &s->mesh, kept);
}

void clipmap_sphere_stats(const struct clipmap_sphere *s, struct renderer_stats *stats)
{
    const struct sphere_view *own = &s->views[0];
    uint64_t size = (uint64_t)s->shape.size, whole = (uint64_t)s->shape.whole;
    uint64_t texture = (size * size * (uint64_t)(s->layers - 1) + whole * whole) * sizeof(float);
    double level_outer = sphere_level_at(&s->shape, sphere_ring_angle(&s->rings, own->range.outer));
    double level_inner = sphere_level_at(&s->shape, sphere_ring_angle(&s->rings, own->range.inner));
    level_outer = fmin(fmax(level_outer, own->least), s->shape.coarsest);
    level_inner = fmin(fmax(level_inner, own->least), s->shape.coarsest);
    *stats = (struct renderer_stats){
        .triangles = own->blocks.triangles,
        .claimed_error_px = NAN,
        .resident_bytes =
            sphere_mesh_bytes(&s->mesh) + (texture + (s->own_colour ? sphere_colours_bytes(&s->colour) : 0) +
                                           sphere_blocks_bytes(&own->blocks, &s->mesh)) *
                                              (uint64_t)s->view_count,
        .counters = {{"levels drawn", ceil(level_outer) - floor(level_inner) + 1},
                     {"rings drawn", own->range.inner - own->range.outer + 1},
                     {"blocks drawn", own->blocks.draws},
                     {"blocks", own->blocks.part_count * SPHERE_SECTORS},
                     {"vertices kept anew", (double)own->transformed},
                     {"samples updated", (double)own->texels_read},
                     {"colours updated", (double)own->colours_read},
                     {"levels_behind", own->levels_behind},
                     {"finest level", own->finest_there}},
    };
    if (!s->reader) return;
    struct terrain_reader_counters reads = terrain_reader_counters(s->reader);
    stats->counters[10] = (struct renderer_counter){"windows_missed", (double)reads.missed};
    stats->counters[11] = (struct renderer_counter){"blocks_arrived", (double)reads.arrived};
}

void clipmap_sphere_destroy(struct clipmap_sphere *s)
{
    if (!s) return;
    for (int k = 0; k < 2 * PASS_COUNT; k++) gpu_program_finish(&s->programs[k / 2][k % 2].program);
    for (int i = 0; i < RENDERER_MAX_VIEWS; i++) {
        if (s->views[i].heights) glDeleteTextures(1, &s->views[i].heights);
        if (s->views[i].whole) glDeleteTextures(1, &s->views[i].whole);
        sphere_blocks_finish(&s->views[i].blocks);
        for (int k = 0; k < s->layers; k++) sphere_ranges_finish(&s->views[i].ranges[k]);
        sphere_colours_finish(&s->views[i].colours);
    }
    sphere_mesh_finish(&s->mesh);
    sphere_colour_finish(&s->colour);
    terrain_reader_destroy(s->reader);
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
    s->realtime = desc->realtime;
    s->frame = -1;
    s->rings = sphere_rings_make(choice->n);
    sphere_shape_init(&s->shape, desc->terrain, s->rings.azimuths, choice->texture);
    s->layers = s->shape.coarsest - s->shape.finest + 1;
    size_t side = (size_t)(s->shape.size > s->shape.whole ? s->shape.size : s->shape.whole);
    size_t texels = side * side;
    s->scratch = malloc(texels * sizeof *s->scratch);
    s->columns = malloc((texels + 1) * sizeof *s->columns);
    s->own_colour = desc->effects->shading == SCENE_SHADING_OWN && desc->effects->colour;
    if (!s->scratch || !s->columns)
        fail("clipmap: no memory for %zu texels", texels);
    else if ((!s->own_colour || sphere_colour_init(&s->colour, s->gpu, desc->effects->colour,
                                                   s->shape.radius_m, s->rings.azimuths, choice->colours)) &&
             sphere_mesh_init(&s->mesh, s->gpu, &s->rings) && build_programs(s, desc->effects))
        return s;
    clipmap_sphere_destroy(s);
    return NULL;
}
