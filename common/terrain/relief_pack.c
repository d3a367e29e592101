// SPDX-License-Identifier: MIT
#include "common/terrain/relief_pack.h"

#include "common/parallel.h"
#include "common/report.h"
#include "common/terrain/pack_region.h"
#include "common/terrain/pack_store.h"
#include "common/terrain/upsample.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

enum {
    LAMBDA_65536 = 26 << 8, // 0.1 step^2 a bit (Sullivan & Wiegand 1998: rate against distortion)
    MOST_LAMBDA = 1 << 26,
    STAGE_LEVELS = 3,
    SMALLEST_REGION = LAYOUT_SAMPLES << (STAGE_LEVELS - 1), // a tile of the coarsest level of a stage
    LARGEST_REGION = 2048,
    TOP_BYTES = 32, // that a map costs a sample when it is held whole
    MOST_THREADS = 64,
    ATTEMPTS = 6,
};

struct done { // what is known of a region
    bool reduced, coded;
    uint64_t offset, bytes; // of its tiles
};

struct stage { // levels fine..coarse-1
    int fine, coarse;
    int64_t columns, rows; // of regions
    struct done *regions;
    bool coded; // all of them
};

struct pack {
    const struct relief_source *source;
    const struct relief_pack_options *options;
    struct pack_coder coder;
    struct stage stages[LAYOUT_LEVELS / STAGE_LEVELS];
    int stage_count, region, threads;
    struct region top; // the levels above all stages
    void *top_room;
    struct pack_store store;
    bool has_store, failed; // failed: and a line was printed
    uint32_t attempt;
    struct region_sums sums; // of the regions of level 0 that are coded
    pthread_mutex_t lock;
    struct { // rooms of the regions that are worked on
        void *room[MOST_THREADS];
        bool used[MOST_THREADS];
        size_t bytes[MOST_THREADS];
    } rooms;
    struct { // what is done, in samples of level 0 that went through everything
        double done, all, begun_s, shown_s;
        const char *what;
    } progress;
};

static int64_t samples_of(const struct grid *grid, int level)
{
    return grid->size[level][0] * grid->size[level][1];
}

static bool stopped(const struct pack *p)
{
    return p->failed || p->store.error || (p->options->interrupted && *p->options->interrupted);
}

static struct rect whole_of(const struct grid *grid, int level)
{
    return (struct rect){0, 0, grid->size[level][0], grid->size[level][1]};
}

// ---- progress --------------------------------------------------------------

static double seconds_now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + (double)t.tv_nsec * 1e-9;
}

// Shares of the time that a sample takes, for the time left.
enum { WORK_REDUCE = 2, WORK_CODE = 10 };

static void progress_add(struct pack *p, double work, bool counts)
{
    if (!p->options->progress) return;
    pthread_mutex_lock(&p->lock);
    double now = seconds_now();
    p->progress.done += work;
    if (!counts) // done in an earlier run: no measure of speed
        p->progress.all -= work, p->progress.done -= work;
    if (now - p->progress.shown_s > 1 && p->progress.done > 0) {
        double left_s = (now - p->progress.begun_s) * (p->progress.all / p->progress.done - 1);
        fprintf(stderr, "\r%s: %-22s %5.1f %%  %d:%02d:%02d left ", p->source->name, p->progress.what,
                100 * p->progress.done / p->progress.all, (int)(left_s / 3600), (int)(left_s / 60) % 60,
                (int)left_s % 60);
        p->progress.shown_s = now;
    }
    pthread_mutex_unlock(&p->lock);
}

static void progress_end(const struct pack *p)
{
    if (p->options->progress && p->progress.shown_s > p->progress.begun_s) fprintf(stderr, "\r%79s\r", "");
}

// ---- rooms -----------------------------------------------------------------

static void *room_take(struct pack *p, size_t bytes)
{
    pthread_mutex_lock(&p->lock);
    int i = 0;
    while (i < MOST_THREADS - 1 && p->rooms.used[i]) i++;
    p->rooms.used[i] = true;
    pthread_mutex_unlock(&p->lock);
    if (p->rooms.bytes[i] < bytes) {
        free(p->rooms.room[i]);
        p->rooms.room[i] = malloc(bytes);
        p->rooms.bytes[i] = p->rooms.room[i] ? bytes : 0;
    }
    return p->rooms.room[i];
}

static void room_give(struct pack *p, const void *room)
{
    pthread_mutex_lock(&p->lock);
    for (int i = 0; i < MOST_THREADS; i++)
        if (p->rooms.used[i] && p->rooms.room[i] == room) {
            p->rooms.used[i] = false;
            break;
        }
    pthread_mutex_unlock(&p->lock);
}

static bool out_of_memory(struct pack *p)
{
    pthread_mutex_lock(&p->lock);
    if (!p->failed) fail("%s: a region does not fit in memory", p->source->name);
    p->failed = true;
    pthread_mutex_unlock(&p->lock);
    return false;
}

// ---- samples ---------------------------------------------------------------

// What level `level`, the finest of a stage or of the top, should be.
static bool read_wanted(struct pack *p, int level, const struct patch *to)
{
    if (level > 0) return store_read_level(&p->store, STORE_WANTED, level, to);
    if (!p->source->window(p->source, to)) {
        p->failed = true;
        return false;
    }
    int64_t count = rect_width(&to->rect) * rect_height(&to->rect);
    const int32_t unit = 1 << p->coder.fraction_bits;
    int32_t *samples = to->samples;
    for (int64_t i = 0; i < count; i++) samples[i] *= unit;
    return true;
}

static bool prepare_region(struct pack *p, struct region *r, void *room)
{
    if (!room) return out_of_memory(p);
    region_place(r, room);
    if (!read_wanted(p, r->fine, &r->level[r->fine].wanted)) return false;
    return region_reduce(r) || out_of_memory(p);
}

static bool read_decoded(void *user, int level, const struct patch *to);

// Samples of the finest level of a stage that is not coded yet, by coding what they hang on.
static bool decode_part(struct pack *p, const struct stage *stage, const struct patch *to)
{
    struct region *r = malloc(sizeof *r);
    if (!r) return out_of_memory(p);
    region_plan(r, &p->coder, stage->fine, stage->coarse, &to->rect, true);
    void *room = malloc(region_room(r));
    bool good = prepare_region(p, r, room) && read_decoded(p, r->coarse, &r->level[r->coarse].decoded) &&
                (region_code(r, false) || out_of_memory(p));
    const struct patch *from = &r->level[stage->fine].decoded;
    for (int64_t y = to->rect.y0; good && y < to->rect.y1; y++)
        memcpy(patch_at(to, to->rect.x0, y), patch_at(from, to->rect.x0, y),
               (size_t)rect_width(&to->rect) * sizeof(int32_t));
    free(room);
    free(r);
    return good;
}

static bool read_decoded(void *user, int level, const struct patch *to)
{
    struct pack *p = user;
    if (level >= p->top.fine) {
        const struct patch *from = &p->top.level[level].decoded;
        for (int64_t y = to->rect.y0; y < to->rect.y1; y++)
            memcpy(patch_at(to, to->rect.x0, y), patch_at(from, to->rect.x0, y),
                   (size_t)rect_width(&to->rect) * sizeof(int32_t));
        return true;
    }
    const struct stage *stage = &p->stages[level / STAGE_LEVELS];
    return stage->coded ? store_read_level(&p->store, STORE_DECODED, level, to) : decode_part(p, stage, to);
}

// ---- regions ---------------------------------------------------------------

struct work { // of one stage, on the regions that are not done
    struct pack *p;
    struct stage *stage;
    int number;
    int *pending;
};

static struct rect core_of(const struct pack *p, const struct stage *stage, int region)
{
    const int64_t *size = p->coder.grid.size[stage->fine], side = p->region;
    int64_t x0 = region % stage->columns * side, y0 = region / stage->columns * side;
    return (struct rect){x0, y0, x0 + side < size[0] ? x0 + side : size[0],
                         y0 + side < size[1] ? y0 + side : size[1]};
}

static double work_of(const struct stage *stage, const struct rect *core)
{
    return (double)rect_width(core) * (double)rect_height(core) * (stage->fine ? 0.5 : 1); // no source
}

static void reduce_region(int block, void *user)
{
    const struct work *w = user;
    struct pack *p = w->p;
    if (stopped(p)) return;
    struct region *r = malloc(sizeof *r);
    if (!r) {
        out_of_memory(p);
        return;
    }
    int number = w->pending[block];
    struct rect core = core_of(p, w->stage, number);
    region_plan(r, &p->coder, w->stage->fine, w->stage->coarse, &core, false);
    void *room = room_take(p, region_room(r));
    struct store_record record = {
        .kind = STORE_REDUCED, .stage = (uint32_t)w->number, .region = (uint32_t)number};
    const struct region_level *at = &r->level[r->coarse];
    if (prepare_region(p, r, room) &&
        store_write_level(&p->store, STORE_WANTED, r->coarse, &at->wanted, &at->core) &&
        store_note(&p->store, &record))
        w->stage->regions[number].reduced = true;
    room_give(p, room);
    free(r);
    progress_add(p, WORK_REDUCE * work_of(w->stage, &core), true);
}

struct tile_entry { // of a tile, in the file of tiles
    uint32_t bytes, error_q;
    int32_t min_q, max_q;
};

static size_t tile_count(const struct rect *tiles)
{
    return (size_t)(rect_width(tiles) * rect_height(tiles));
}

// Entries of the tiles, level by level from the finest; `beyond`; then the tiles' bytes in the same order.
static bool keep_region(struct pack *p, const struct region *r, const uint32_t *beyond, size_t beyond_count,
                        struct store_record *record)
{
    struct relief_bytes all = {0};
    for (int l = r->fine; l < r->coarse; l++)
        for (size_t i = 0; i < tile_count(&r->level[l].core_tiles); i++) {
            const struct packed_tile *tile = &r->level[l].packed[i];
            const struct tile_entry entry = {tile->bytes, tile->error_q, tile->min_q, tile->max_q};
            relief_put(&all, &entry, sizeof entry);
        }
    relief_put(&all, beyond, beyond_count * sizeof *beyond);
    for (int l = r->fine; l < r->coarse; l++)
        for (size_t i = 0; i < tile_count(&r->level[l].core_tiles); i++)
            relief_put(&all, r->level[l].packed[i].data, r->level[l].packed[i].bytes);
    record->bytes = all.size;
    bool good = all.full ? out_of_memory(p) : store_add_tiles(&p->store, all.data, all.size, &record->offset);
    free(all.data);
    return good && store_note(&p->store, record);
}

static bool keep_levels(struct pack *p, const struct region *r)
{
    for (int l = r->fine; l < r->coarse; l++)
        if (!store_write_level(&p->store, STORE_DECODED, l, &r->level[l].decoded, &r->level[l].core))
            return false;
    return true;
}

static void note_sums(const struct region_sums *sums, struct store_record *record)
{
    record->squares[0] = (uint64_t)sums->squares;
    record->squares[1] = (uint64_t)(sums->squares >> 64);
    record->samples = sums->samples, record->most = sums->most;
    record->min_q = sums->min_q, record->max_q = sums->max_q;
}

// Adds what a record tells of a coded region.
static void take_coded(struct pack *p, const struct store_record *record)
{
    struct stage *stage = &p->stages[record->stage];
    stage->regions[record->region].coded = true;
    stage->regions[record->region].offset = record->offset;
    stage->regions[record->region].bytes = record->bytes;
    if (record->stage > 0) return;
    p->sums.squares += (region_wide)record->squares[1] << 64 | record->squares[0];
    p->sums.samples += record->samples;
    if (record->most > p->sums.most) p->sums.most = record->most;
    if (record->min_q < p->sums.min_q) p->sums.min_q = record->min_q;
    if (record->max_q > p->sums.max_q) p->sums.max_q = record->max_q;
}

static const struct region_sums NO_SUMS = {.min_q = INT32_MAX, .max_q = INT32_MIN};

static bool code_and_keep(struct pack *p, struct region *r, struct store_record *record)
{
    const struct region_reader reader = {read_decoded, p};
    size_t beyond_count = r->fine == 0 ? region_beyond(r) : 0;
    uint32_t *beyond = malloc((beyond_count + 1) * sizeof *beyond);
    bool good = beyond && region_code(r, true);
    if (good && r->fine == 0) {
        struct region_sums sums = NO_SUMS;
        region_measure(r, &sums);
        note_sums(&sums, record);
        good = region_errors(r, &reader, beyond) || p->store.error;
    } else if (good)
        keep_levels(p, r);
    if (!good) out_of_memory(p);
    good = good && !p->store.error && keep_region(p, r, beyond, beyond_count, record);
    free(beyond);
    return good;
}

static void code_region(int block, void *user)
{
    const struct work *w = user;
    struct pack *p = w->p;
    if (stopped(p)) return;
    struct region *r = malloc(sizeof *r);
    if (!r) {
        out_of_memory(p);
        return;
    }
    int number = w->pending[block];
    struct rect core = core_of(p, w->stage, number);
    region_plan(r, &p->coder, w->stage->fine, w->stage->coarse, &core, true);
    void *room = room_take(p, region_room(r));
    struct store_record record = {
        .kind = STORE_CODED, .stage = (uint32_t)w->number, .attempt = p->attempt, .region = (uint32_t)number};
    if (prepare_region(p, r, room) && read_decoded(p, r->coarse, &r->level[r->coarse].decoded) &&
        code_and_keep(p, r, &record)) {
        pthread_mutex_lock(&p->lock);
        take_coded(p, &record);
        pthread_mutex_unlock(&p->lock);
    }
    room_give(p, room);
    region_finish(r);
    free(r);
    progress_add(p, WORK_CODE * work_of(w->stage, &core), true);
}

static bool run_stage(struct pack *p, int number, bool code)
{
    struct stage *stage = &p->stages[number];
    int count = (int)(stage->columns * stage->rows), left = 0;
    struct work w = {p, stage, number, malloc((size_t)count * sizeof(int))};
    if (!w.pending) return out_of_memory(p);
    for (int i = 0; i < count; i++) {
        struct rect core = core_of(p, stage, i);
        double work = (code ? WORK_CODE : WORK_REDUCE) * work_of(stage, &core);
        if (code ? stage->regions[i].coded : stage->regions[i].reduced)
            progress_add(p, work, false);
        else
            w.pending[left++] = i;
    }
    p->progress.what = code ? "coding" : "reducing";
    parallel_blocks(left, p->threads, code ? code_region : reduce_region, &w);
    free(w.pending);
    return !stopped(p);
}

// ---- the top ---------------------------------------------------------------

static bool prepare_top(struct pack *p)
{
    struct region *r = &p->top;
    int last = p->stage_count - 1, fine = last < 0 ? 0 : p->stages[last].coarse;
    struct rect whole = whole_of(&p->coder.grid, fine);
    region_plan(r, &p->coder, fine, p->coder.grid.count - 1, &whole, true);
    r->threads = p->options->threads;
    p->top_room = malloc(region_room(r));
    return prepare_region(p, r, p->top_room);
}

static bool code_top(struct pack *p, bool write)
{
    region_code_base(&p->top);
    return region_code(&p->top, write) || out_of_memory(p);
}

static bool is_coded(const struct stage *stage)
{
    for (int64_t i = 0; i < stage->columns * stage->rows; i++)
        if (!stage->regions[i].coded) return false;
    return true;
}

// Reduces what is left to reduce; what stages that are coded were made from is not needed any more.
static bool reduce_all(struct pack *p)
{
    bool needed[LAYOUT_LEVELS] = {false};
    for (int i = p->stage_count - 1; i >= 0; i--) {
        struct stage *stage = &p->stages[i];
        needed[i] |= i + 1 == p->stage_count || !is_coded(&p->stages[i + 1]);
        for (int64_t k = 0; needed[i] && i > 0 && k < stage->columns * stage->rows; k++)
            if (!stage->regions[k].reduced) needed[i - 1] = true;
    }
    for (int i = 0; i < p->stage_count; i++)
        if (needed[i] && !run_stage(p, i, false)) return false;
    return true;
}

static bool any_is_coded(const struct stage *stage)
{
    for (int64_t i = 0; i < stage->columns * stage->rows; i++)
        if (stage->regions[i].coded) return true;
    return false;
}

static bool any_is_reduced(const struct stage *stage)
{
    for (int64_t i = 0; i < stage->columns * stage->rows; i++)
        if (stage->regions[i].reduced) return true;
    return false;
}

static void forget_reduced(struct stage *stage)
{
    for (int64_t k = 0; k < stage->columns * stage->rows; k++) stage->regions[k].reduced = false;
}

// What a stage was reduced to is not there any more.
static bool note_dropped(struct pack *p, int number)
{
    struct store_record record = {.kind = STORE_DROPPED, .stage = (uint32_t)number};
    forget_reduced(&p->stages[number]);
    return store_note(&p->store, &record);
}

static bool code_all(struct pack *p)
{
    const struct region_reader nobody = {NULL, NULL};
    if (!reduce_all(p) || !code_top(p, true)) return false;
    for (int i = p->stage_count - 1; i >= 0; i--) {
        if (!run_stage(p, i, true)) return false;
        p->stages[i].coded = true;
        if (i == 0 || !any_is_reduced(&p->stages[i - 1])) continue;
        if (!note_dropped(p, i - 1)) return false; // what this stage was made from makes room
        store_drop_level(&p->store, STORE_WANTED, p->stages[i].fine);
    }
    if (p->stage_count > 0) return true;
    p->sums = NO_SUMS;
    region_measure(&p->top, &p->sums);
    return region_errors(&p->top, &nobody, NULL) || out_of_memory(p);
}

// ---- steps -----------------------------------------------------------------

static void set_bounded_steps(struct pack *p)
{
    double most = floor(p->options->max_m / p->source->quantum_m * (1 + 1e-12));
    int32_t step = 2 * (int32_t)(most < QUANTA_LIMIT ? most : QUANTA_LIMIT) + 1;
    for (int l = 0; l < p->coder.grid.count; l++) {
        int64_t own = p->options->scaled ? ((int64_t)step << (l < 24 ? l : 24)) | 1 : step;
        for (int b = 0; b < CODER_BANDS; b++)
            p->coder.step[l][b] = (int32_t)(own < 1 << 27 ? own : (1 << 27) - 1);
    }
}

// Equal slopes of error against rate: a band's step is inverse to what its coefficients add to level 0.
static void set_wavelet_steps(struct pack *p, double step)
{
    const double least = step / 64; // a floor of step / 16 costs 2 % at low rates
    int top = p->coder.grid.count - 1;
    for (int l = 0; l <= top; l++)
        for (int b = 0; b < CODER_BANDS; b++) {
            double norm = b == 0 ? layout_wavelet_norm(l > 0 ? l - 1 : 0, 0) : layout_wavelet_norm(l, b);
            double own = rint(fmax(step / norm, least));
            p->coder.step[l][b] = own < 1 ? 1 : own < 1 << 27 ? (int32_t)own : 1 << 27;
        }
}

// Squares of level 0 that a search looks at instead of the whole map: one in each cell of a coarse lattice,
// at a place of its own there.
struct sample {
    struct pack *p;
    struct rect *squares;
    struct region_sums *sums;
    int count, stride; // every stride-th is looked at
};

static uint64_t scrambled(uint64_t z) // the finaliser of splitmix64
{
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
    return z ^ (z >> 31);
}

static bool sample_init(struct sample *s, struct pack *p)
{
    enum { MOST = 1200, FEWEST = 256, PART = 16, SIDE = SMALLEST_REGION };
    const int64_t *size = p->coder.grid.size[0];
    int64_t columns = (size[0] + SIDE - 1) / SIDE, rows = (size[1] + SIDE - 1) / SIDE, all = columns * rows;
    int64_t wanted = all / PART > MOST ? MOST : all / PART > FEWEST ? all / PART : FEWEST;
    if (wanted > all) wanted = all;
    int64_t across = (int64_t)ceil(sqrt((double)wanted * (double)columns / (double)rows));
    across = across < 1 ? 1 : across > columns ? columns : across;
    int64_t along = (wanted + across - 1) / across;
    along = along > rows ? rows : along;
    *s = (struct sample){.p = p, .stride = 1};
    s->squares = malloc((size_t)(across * along) * sizeof *s->squares);
    s->sums = malloc((size_t)(across * along) * sizeof *s->sums);
    if (!s->squares || !s->sums) return out_of_memory(p);
    for (int64_t j = 0; j < along; j++)
        for (int64_t i = 0; i < across; i++) {
            uint64_t dice = scrambled(0x9e3779b97f4a7c15u * (uint64_t)(j * across + i + 1));
            double u = (double)(dice >> 32) * 0x1p-32, v = (double)(dice & 0xffffffff) * 0x1p-32;
            int64_t x = (int64_t)(((double)i + u) * (double)columns / (double)across) * SIDE;
            int64_t y = (int64_t)(((double)j + v) * (double)rows / (double)along) * SIDE;
            s->squares[s->count++] = (struct rect){x, y, x + SIDE < size[0] ? x + SIDE : size[0],
                                                   y + SIDE < size[1] ? y + SIDE : size[1]};
        }
    return true;
}

static void measure_square(int block, void *user)
{
    const struct sample *s = user;
    struct pack *p = s->p;
    s->sums[block] = NO_SUMS;
    if (stopped(p)) return;
    struct region *r = malloc(sizeof *r);
    if (!r) {
        out_of_memory(p);
        return;
    }
    region_plan(r, &p->coder, p->stages[0].fine, p->stages[0].coarse, &s->squares[block * s->stride], true);
    void *room = room_take(p, region_room(r));
    if (prepare_region(p, r, room) && read_decoded(p, r->coarse, &r->level[r->coarse].decoded) &&
        (region_code(r, false) || out_of_memory(p)))
        region_measure(r, &s->sums[block]);
    room_give(p, room);
    free(r);
}

static double rms_of(const struct pack *p, const struct region_sums *sums)
{
    return sqrt((double)sums->squares / (double)sums->samples) * p->source->quantum_m;
}

// How a wavelet map is quantised.
struct steps {
    double step; // 0: not known yet
    int32_t lambda_65536;
    bool uneven;
};

static void set_steps(struct pack *p, const struct steps *steps)
{
    set_wavelet_steps(p, steps->step);
    p->coder.lambda_65536 = steps->lambda_65536;
    p->coder.uneven = steps->uneven;
}

// What rms they give: of the whole map, or of the sample.
static bool try_steps(struct pack *p, const struct sample *sample, const struct steps *steps, double *rms_m)
{
    struct region_sums sums = NO_SUMS;
    set_steps(p, steps);
    if (!code_top(p, false)) return false;
    if (p->stage_count == 0) {
        region_measure(&p->top, &sums);
    } else {
        int count = (sample->count + sample->stride - 1) / sample->stride;
        parallel_blocks(count, p->threads, measure_square, (void *)sample);
        for (int i = 0; i < count; i++)
            sums.squares += sample->sums[i].squares, sums.samples += sample->sums[i].samples;
    }
    *rms_m = rms_of(p, &sums);
    return !stopped(p);
}

// On smooth maps a few coefficients carry everything, and the error jumps when one of them changes.  Finer
// steps have smaller jumps: with them the error is brought up again by making rate dearer.
static bool trim(struct pack *p, struct steps *steps)
{
    enum { FINER = 20, TRIES = 14 };
    const double aim = p->options->rms_m;
    struct steps best = {steps->step, 0, true}, next = {steps->step, 0, true}; // exact
    double best_rms_m = 0, rms_m;
    for (int finer = 0; finer < FINER && best_rms_m < 0.985 * aim; finer++, next.step *= 0.9) {
        double low = LAMBDA_65536 / 8, high = MOST_LAMBDA;
        for (int i = 0; i < TRIES && best_rms_m < 0.985 * aim; i++) {
            next.lambda_65536 = (int32_t)sqrt(low * high);
            if (!try_steps(p, NULL, &next, &rms_m)) return false;
            if (rms_m <= aim && rms_m > best_rms_m) best = next, best_rms_m = rms_m;
            *(rms_m <= aim ? &low : &high) = next.lambda_65536;
        }
    }
    *steps = best;
    return true;
}

struct window { // of the rms to reach, as shares of the aim
    double least, middle, most;
};

// Finds a step whose rms lies in the window, or else the one that comes closest from below, beginning at
// steps->step: the error grows with the step, nearly in proportion.
static bool search_step(struct pack *p, const struct sample *sample, struct window window,
                        struct steps *steps)
{
    enum { TRIES = 16 };
    const double aim = p->options->rms_m, most = window.most * aim;
    double low = 0, high = INFINITY, best = 0, best_rms_m = 0, rms_m;
    for (int i = 0; i < TRIES && best_rms_m < window.least * aim; i++) {
        if (!try_steps(p, sample, steps, &rms_m)) return false;
        if (rms_m <= most && (best == 0 || rms_m > best_rms_m)) best = steps->step, best_rms_m = rms_m;
        *(rms_m <= most ? &low : &high) = steps->step;
        double guess = rms_m > 0 ? steps->step * pow(window.middle * aim / rms_m, 1.15) : 4 * steps->step;
        bool inside = guess > low && guess < high && (i < 5 || i % 2);
        steps->step = inside ? guess : isinf(high) ? 2 * steps->step : low > 0 ? sqrt(low * high) : high / 2;
        if (steps->step < 1 && best == 0) steps->step = 1;
    }
    steps->step = best;
    if (best == 0)
        return fail("%s: an rms error of %g m is finer than the map's own steps; --lossless is smaller",
                    p->source->name, aim);
    return sample || best_rms_m >= 0.99 * aim || trim(p, steps);
}

// What is sampled aims at the middle of what is accepted, since the whole map will differ a little.
enum { LEAST_PER_MILLE = 980, AIM_PER_MILLE = 990, MOST_PER_MILLE = 1001 };

static bool choose_steps(struct pack *p, struct steps *steps)
{
    const double unit = ldexp(p->source->quantum_m, -p->coder.fraction_bits);
    *steps = (struct steps){p->options->rms_m / unit * 3.2, LAMBDA_65536, false};
    if (p->stage_count == 0) return search_step(p, NULL, (struct window){0.9985, 0.9993, 1}, steps);
    struct sample sample;
    p->progress.what = "looking for the steps";
    bool good = sample_init(&sample, p);
    if (good) {
        sample.stride = sample.count >= 128 ? sample.count / 64 : 1; // a few squares tell where to look
        good = search_step(p, &sample, (struct window){0.97, 0.99, 1.01}, steps);
        sample.stride = 1;
        good = good && search_step(p, &sample, (struct window){0.988, 0.99, 0.992}, steps);
    }
    free(sample.squares);
    free(sample.sums);
    return good;
}

static bool begin_attempt(struct pack *p, const struct steps *steps)
{
    struct store_record record = {.kind = STORE_STEP,
                                  .attempt = ++p->attempt,
                                  .step = steps->step,
                                  .lambda_65536 = steps->lambda_65536,
                                  .uneven = steps->uneven};
    p->sums = NO_SUMS;
    for (int i = 0; i < p->stage_count; i++) {
        p->stages[i].coded = false;
        for (int64_t k = 0; k < p->stages[i].columns * p->stages[i].rows; k++)
            p->stages[i].regions[k].coded = false;
    }
    return !p->has_store || (store_note(&p->store, &record) && store_forget_tiles(&p->store));
}

static bool code_wavelet(struct pack *p, struct steps *steps)
{
    const double aim = p->options->rms_m;
    if (steps->step == 0 && !(choose_steps(p, steps) && begin_attempt(p, steps))) return false;
    for (;;) {
        set_steps(p, steps);
        if (!code_all(p)) return false;
        double share = 1000 * rms_of(p, &p->sums) / aim;
        if (p->stage_count == 0 || (share >= LEAST_PER_MILLE && share <= MOST_PER_MILLE)) return true;
        if (p->attempt >= ATTEMPTS && share < LEAST_PER_MILLE) return true;
        if (p->attempt >= 2 * ATTEMPTS)
            return fail("%s: an rms error of %g m cannot be reached", p->source->name, aim);
        note("%s: the rms error is %.4f of the aim; once more, with other steps", p->source->name,
             share / 1000);
        steps->step *= share > 0 ? pow(AIM_PER_MILLE / share, 1.15) : 2;
        if (!begin_attempt(p, steps)) return false;
    }
}

// ---- the plan --------------------------------------------------------------

static size_t memory_of(const struct pack *p)
{
    return p->options->memory_bytes ? p->options->memory_bytes : (size_t)512 << 20;
}

static int stages_for(const struct pack *p)
{
    const struct grid *grid = &p->coder.grid;
    size_t most = memory_of(p) / TOP_BYTES;
    if (!p->has_store || (size_t)samples_of(grid, 0) <= most) return 0;
    int count = 1;
    while ((count + 1) * STAGE_LEVELS < grid->count &&
           (size_t)samples_of(grid, count * STAGE_LEVELS) > most / 3)
        count++;
    return count * STAGE_LEVELS < grid->count ? count : count - 1;
}

// Bytes that a region in the middle of the map takes, and how much more work than its core it is.
static size_t cost_of(struct pack *p, int side, double *more)
{
    const int64_t *size = p->coder.grid.size[0];
    int64_t x0 = size[0] / 2 / side * side, y0 = size[1] / 2 / side * side;
    const struct rect core = {x0, y0, x0 + side < size[0] ? x0 + side : size[0],
                              y0 + side < size[1] ? y0 + side : size[1]};
    struct region *r = malloc(sizeof *r);
    if (!r) return *more = 1, SIZE_MAX;
    region_plan(r, &p->coder, 0, STAGE_LEVELS, &core, true);
    double own = (double)rect_width(&core) * (double)rect_height(&core);
    *more = ((double)rect_width(&r->level[0].wanted.rect) * (double)rect_height(&r->level[0].wanted.rect) +
             2.0 * LAYOUT_SAMPLES * LAYOUT_SAMPLES * (double)tile_count(&r->level[0].tiles)) /
            (3 * own);
    size_t bytes = region_room(r) + (size_t)(6 * own); // surfaces, tiles
    free(r);
    return bytes;
}

static void choose_regions(struct pack *p)
{
    int most = p->options->threads > 0 ? p->options->threads : parallel_processors();
    if (most > MOST_THREADS) most = MOST_THREADS;
    size_t taken = (size_t)samples_of(&p->coder.grid, p->stages[p->stage_count - 1].coarse) * TOP_BYTES;
    size_t budget = memory_of(p) > taken ? memory_of(p) - taken : 0;
    double best = 0;
    int first = p->region ? p->region : SMALLEST_REGION, last = p->region ? p->region : LARGEST_REGION;
    for (int side = first; side <= last; side *= 2) {
        double more;
        size_t bytes = cost_of(p, side, &more), fit = budget / bytes;
        int threads = fit < 1 ? 1 : fit > (size_t)most ? most : (int)fit;
        if (fit < 1 && side > first) break;
        if (threads / more > best) best = threads / more, p->region = side, p->threads = threads;
    }
}

static bool make_stages(struct pack *p)
{
    for (int i = 0; i < p->stage_count; i++) {
        struct stage *stage = &p->stages[i];
        const int64_t *size = p->coder.grid.size[i * STAGE_LEVELS];
        stage->fine = i * STAGE_LEVELS;
        stage->coarse = stage->fine + STAGE_LEVELS;
        stage->columns = (size[0] + p->region - 1) / p->region;
        stage->rows = (size[1] + p->region - 1) / p->region;
        stage->regions = calloc((size_t)(stage->columns * stage->rows), sizeof *stage->regions);
        if (!stage->regions) return out_of_memory(p);
        p->progress.all += (WORK_CODE + WORK_REDUCE) * (double)size[0] * (double)size[1] * (i ? 0.5 : 1);
    }
    return true;
}

static uint64_t identity_of(const struct pack *p)
{
    const struct relief_pack_options *o = p->options;
    uint64_t hash = p->source->identity;
    const double aims[4] = {o->layout, o->rms_m, o->max_m, o->scaled};
    hash = scrambled(hash ^ relief_crc((const uint8_t *)aims, sizeof aims));
    hash = scrambled(hash ^ relief_crc((const uint8_t *)&CODER_TABLES, sizeof CODER_TABLES));
    hash = scrambled(hash ^ relief_crc((const uint8_t *)p->source->name, strlen(p->source->name)));
    return hash;
}

// A journal that lost its end tells of levels that were dropped since: these are made again.
static bool check_levels(struct pack *p, const struct steps *steps)
{
    bool lost = false;
    for (int i = 0; i < p->stage_count; i++) {
        if (p->stages[i].regions[0].reduced &&
            !store_has_level(&p->store, STORE_WANTED, p->stages[i].coarse) && !note_dropped(p, i))
            return false;
        lost |= i > 0 && any_is_coded(&p->stages[i]) && !is_coded(&p->stages[0]) &&
                !store_has_level(&p->store, STORE_DECODED, p->stages[i].fine);
    }
    return !lost || begin_attempt(p, steps);
}

// Takes the plan, and what is done, from the journal's records; or begins it.
static bool take_up(struct pack *p, const struct store_record *records, size_t count, struct steps *steps)
{
    struct store_record begun = {.kind = STORE_BEGUN, .identity = identity_of(p)};
    if (count > 0 && (records[0].kind != STORE_BEGUN || records[0].identity != begun.identity))
        return fail("%s: was begun from another source or with other options; --restart throws it away",
                    p->store.folder);
    p->stage_count = count > 0 ? (int)records[0].stage : stages_for(p);
    p->region = count > 0 ? (int)records[0].region : p->options->region;
    p->threads = 1;
    for (int i = 0; i < p->stage_count; i++) p->stages[i].coarse = (i + 1) * STAGE_LEVELS;
    if (p->stage_count > 0) choose_regions(p);
    if (!make_stages(p)) return false;
    begun.stage = (uint32_t)p->stage_count, begun.region = (uint32_t)p->region;
    if (count == 0 && p->has_store && !store_note(&p->store, &begun)) return false;
    for (size_t i = 1; i < count; i++) {
        const struct store_record *r = &records[i];
        if (r->kind == STORE_REDUCED) p->stages[r->stage].regions[r->region].reduced = true;
        if (r->kind == STORE_DROPPED) forget_reduced(&p->stages[r->stage]);
        if (r->kind == STORE_STEP)
            p->attempt = r->attempt, *steps = (struct steps){r->step, r->lambda_65536, r->uneven};
    }
    for (size_t i = 1; i < count; i++) {
        const struct store_record *r = &records[i];
        if (r->kind != STORE_CODED || r->attempt != p->attempt) continue;
        take_coded(p, r);
        if (r->offset + r->bytes > p->store.tiles_bytes) p->store.tiles_bytes = r->offset + r->bytes;
    }
    return check_levels(p, steps);
}

static void describe(struct pack *p, struct relief_header *h)
{
    const struct relief_source *s = p->source;
    memset(h, 0, sizeof *h);
    h->layout = p->options->layout;
    for (int axis = 0; axis < 2; axis++) {
        h->size[axis] = s->size[axis];
        h->spacing_m[axis] = s->spacing_m[axis];
    }
    h->quantum_m = s->quantum_m, h->offset_m = s->offset_m;
    h->fraction_bits = p->coder.fraction_bits;
    h->voids_filled = s->voids_filled;
    memcpy(h->name, s->name, sizeof h->name);
}

// ---- putting the file together ---------------------------------------------

struct assembly {
    struct pack *p;
    FILE *file; // NULL: only counted
    struct relief_bytes index, side;
    uint64_t payload_bytes;
    int64_t low;
    uint32_t *errors; // of the tiles of levels above the first stage; NULL without stages
};

static void put_base(const struct pack *p, struct relief_bytes *to)
{
    const struct pack_coder *c = &p->coder;
    const struct patch *base = &p->top.level[p->top.coarse].decoded;
    int top = p->top.coarse;
    for (int l = 0; l < top; l++)
        for (int b = BAND_HL; b < CODER_BANDS; b++) relief_put_varint(to, (uint64_t)c->step[l][b]);
    relief_put_varint(to, (uint64_t)c->step[top][0]);
    int32_t before = 0;
    for (int64_t i = 0; i < samples_of(&c->grid, top); i++) {
        int32_t k = base->samples[i] / c->step[top][0]; // a multiple: region_code_base
        relief_put_difference(to, (int64_t)k - before);
        before = k;
    }
}

static bool put_tile(struct assembly *a, const struct tile_entry *tile, uint32_t error_q, const uint8_t *data)
{
    relief_put_varint(&a->index, tile->bytes);
    if (tile->bytes) {
        uint32_t crc = relief_crc(data, tile->bytes);
        const uint8_t bytes[4] = {(uint8_t)crc, (uint8_t)(crc >> 8), (uint8_t)(crc >> 16),
                                  (uint8_t)(crc >> 24)};
        relief_put(&a->side, bytes, sizeof bytes);
    }
    relief_put_difference(&a->side, tile->min_q - a->low);
    relief_put_varint(&a->side, (uint64_t)((int64_t)tile->max_q - tile->min_q));
    const uint8_t code = relief_error_code(error_q);
    relief_put(&a->side, &code, 1);
    a->low = tile->min_q;
    a->payload_bytes += tile->bytes;
    return !a->file || fwrite(data, 1, tile->bytes, a->file) == tile->bytes;
}

static bool put_top(struct assembly *a, int level)
{
    const struct pack *p = a->p;
    const struct region_level *at = &p->top.level[level];
    for (size_t i = 0; i < tile_count(&at->core_tiles); i++) {
        const struct packed_tile *tile = &at->packed[i];
        const struct tile_entry entry = {tile->bytes, 0, tile->min_q, tile->max_q};
        uint32_t error_q =
            a->errors ? a->errors[p->coder.grid.first_tile[level] + (int64_t)i] : tile->error_q;
        if (!put_tile(a, &entry, error_q, tile->data)) return false;
    }
    return true;
}

struct kept {          // a region in the file of tiles
    struct rect tiles; // of the level at hand
    struct tile_entry *entries;
    uint64_t offset; // of the level's first tile
};

// Tiles of the levels of a region: how many before `level`, and in all.
static size_t entries_of(const struct region *r, int level, size_t *before)
{
    size_t all = 0;
    for (int l = r->fine; l < r->coarse; l++) {
        if (l == level) *before = all;
        all += tile_count(&r->level[l].core_tiles);
    }
    return all;
}

static bool kept_read(struct pack *p, const struct stage *stage, int number, int level, struct kept *kept)
{
    struct region *r = malloc(sizeof *r);
    if (!r) return out_of_memory(p);
    struct rect core = core_of(p, stage, number);
    region_plan(r, &p->coder, stage->fine, stage->coarse, &core, true);
    size_t before = 0, all = entries_of(r, level, &before), own = tile_count(&r->level[level].core_tiles);
    size_t beyond = stage->fine == 0 ? region_beyond(r) * sizeof(uint32_t) : 0;
    kept->tiles = r->level[level].core_tiles;
    free(r);
    struct tile_entry *entries = malloc((all + 1) * sizeof *entries);
    uint64_t offset = stage->regions[number].offset;
    bool good =
        entries ? store_read_tiles(&p->store, entries, all * sizeof *entries, offset) : out_of_memory(p);
    kept->offset = offset + all * sizeof *entries + beyond;
    for (size_t i = 0; good && i < before; i++) kept->offset += entries[i].bytes;
    if (good) memmove(entries, entries + before, own * sizeof *entries);
    kept->entries = entries;
    return good;
}

// A row of tiles of one region.
static bool put_kept_row(struct assembly *a, struct kept *kept, int level, int64_t ty,
                         struct relief_bytes *room)
{
    struct pack *p = a->p;
    int64_t columns = rect_width(&kept->tiles), first = (ty - kept->tiles.y0) * columns;
    const struct grid *grid = &p->coder.grid;
    size_t bytes = 0;
    for (int64_t i = 0; i < columns; i++) bytes += kept->entries[first + i].bytes;
    if (room->room < bytes + 1) {
        free(room->data);
        room->room = 2 * bytes + 1;
        room->data = malloc(room->room);
    }
    if (!room->data) return out_of_memory(p);
    if (!store_read_tiles(&p->store, room->data, bytes, kept->offset)) return false;
    kept->offset += bytes;
    const uint8_t *data = room->data;
    for (int64_t i = 0; i < columns; i++) {
        const struct tile_entry *entry = &kept->entries[first + i];
        int64_t number = grid->first_tile[level] + ty * grid->tiles[level][0] + kept->tiles.x0 + i;
        uint32_t error_q = level < p->stages[0].coarse ? entry->error_q : a->errors[number];
        if (!put_tile(a, entry, error_q, data)) return false;
        data += entry->bytes;
    }
    return true;
}

static bool put_region_row(struct assembly *a, const struct stage *stage, int level, int64_t row)
{
    struct kept *kept = calloc((size_t)stage->columns, sizeof *kept);
    struct relief_bytes room = {0};
    bool good = kept || out_of_memory(a->p);
    for (int64_t i = 0; good && i < stage->columns; i++)
        good = kept_read(a->p, stage, (int)(row * stage->columns + i), level, &kept[i]);
    for (int64_t ty = good ? kept[0].tiles.y0 : 0; good && ty < kept[0].tiles.y1; ty++)
        for (int64_t i = 0; good && i < stage->columns; i++)
            good = put_kept_row(a, &kept[i], level, ty, &room);
    for (int64_t i = 0; kept && i < stage->columns; i++) free(kept[i].entries);
    free(kept);
    free(room.data);
    return good;
}

// The errors of tiles above the first stage, from what the regions of level 0 saw.
static bool gather_errors(struct assembly *a)
{
    struct pack *p = a->p;
    const struct grid *grid = &p->coder.grid;
    const struct stage *stage = &p->stages[0];
    size_t count = (size_t)grid->first_tile[stage->coarse - 1];
    a->errors = calloc(count + 1, sizeof *a->errors);
    struct region *r = malloc(sizeof *r);
    bool good = (a->errors && r) || out_of_memory(p);
    for (int64_t i = 0; good && i < stage->columns * stage->rows; i++) {
        struct rect core = core_of(p, stage, (int)i);
        region_plan(r, &p->coder, 0, stage->coarse, &core, true);
        size_t before = 0, skipped = entries_of(r, 0, &before) * sizeof(struct tile_entry);
        size_t beyond_count = region_beyond(r);
        uint32_t *beyond = malloc((beyond_count + 1) * sizeof *beyond), *next = beyond;
        good = beyond ? store_read_tiles(&p->store, beyond, beyond_count * sizeof *beyond,
                                         stage->regions[i].offset + skipped)
                      : out_of_memory(p);
        for (int l = stage->coarse; good && l < grid->count - 1; l++) {
            struct rect tiles = region_tiles_above(r, l);
            for (int64_t y = tiles.y0; y < tiles.y1; y++)
                for (int64_t x = tiles.x0; x < tiles.x1; x++, next++) {
                    uint32_t *error = &a->errors[grid->first_tile[l] + y * grid->tiles[l][0] + x];
                    if (*next > *error) *error = *next;
                }
        }
        free(beyond);
    }
    free(r);
    return good;
}

static bool put_payload(struct assembly *a)
{
    struct pack *p = a->p;
    if (p->stage_count > 0 && !gather_errors(a)) return false;
    for (int l = p->top.coarse - 1; l >= p->top.fine; l--)
        if (!put_top(a, l)) return false;
    for (int l = p->top.fine - 1; l >= 0; l--) {
        const struct stage *stage = &p->stages[l / STAGE_LEVELS];
        for (int64_t row = 0; row < stage->rows; row++)
            if (!put_region_row(a, stage, l, row)) return false;
    }
    return true;
}

static bool put_sections(struct assembly *a, struct relief_header *h)
{
    struct relief_bytes base = {0};
    put_base(a->p, &base);
    const struct relief_bytes *const parts[3] = {&base, &a->index, &a->side};
    bool good = !base.full && !a->index.full && !a->side.full;
    h->payload_bytes = a->payload_bytes;
    h->base_bytes = base.size, h->index_bytes = a->index.size, h->side_bytes = a->side.size;
    if (good) {
        h->base_crc = relief_crc(base.data, base.size);
        h->index_crc = relief_crc(a->index.data, a->index.size);
        h->side_crc = relief_crc(a->side.data, a->side.size);
    }
    for (int i = 0; good && a->file && i < 3; i++)
        good = !parts[i]->size || fwrite(parts[i]->data, 1, parts[i]->size, a->file) == parts[i]->size;
    uint8_t bytes[RELIEF_HEADER];
    relief_header_write(h, bytes);
    if (good && a->file)
        good = fseek(a->file, 0, SEEK_SET) == 0 && fwrite(bytes, 1, sizeof bytes, a->file) == sizeof bytes &&
               fflush(a->file) == 0 && fsync(fileno(a->file)) == 0;
    free(base.data);
    return good;
}

static bool assemble(struct pack *p, struct relief_header *h)
{
    struct assembly a = {.p = p};
    char out[4300];
    const uint8_t nothing[RELIEF_HEADER] = {0};
    snprintf(out, sizeof out, "%s/out", p->store.folder);
    p->progress.what = "putting together";
    if (p->has_store) {
        store_drop_levels(&p->store, p->top.fine); // a pack killed from here on codes the top again
        a.file = fopen(out, "wb");
        if (!a.file) return fail("%s: cannot be written (%s)", out, strerror(errno));
    }
    errno = 0;
    bool good = (!a.file || fwrite(nothing, 1, sizeof nothing, a.file) == sizeof nothing) &&
                put_payload(&a) && put_sections(&a, h);
    int error = errno;
    if (a.file && fclose(a.file) != 0 && good) good = false, error = errno;
    if (good && a.file && rename(out, p->store.path) != 0) good = false, error = errno;
    if (!good && !p->failed && !store_fail(&p->store)) {
        if (!p->store.error)
            fail("%s: cannot be written (%s)", p->store.path, error ? strerror(error) : "out of memory");
        p->failed = true;
    }
    free(a.index.data);
    free(a.side.data);
    free(a.errors);
    return good;
}

// ---- packing ---------------------------------------------------------------

static bool pack_stages(struct pack *p, struct relief_header *header, struct steps *steps)
{
    bool wavelet = p->options->layout == LAYOUT_WAVELET;
    p->progress.begun_s = p->progress.shown_s = seconds_now();
    if (!reduce_all(p) || !prepare_top(p)) return false;
    if (!wavelet) set_bounded_steps(p);
    bool coded =
        wavelet ? code_wavelet(p, steps) : (p->attempt > 0 || begin_attempt(p, steps)) && code_all(p);
    if (!coded) return false;
    header->rms_m = rms_of(p, &p->sums);
    header->max_m = (double)p->sums.most * p->source->quantum_m;
    header->min_q = p->sums.min_q, header->max_q = p->sums.max_q;
    return assemble(p, header);
}

// Whether there is nothing worth going on from.
static bool nothing_is_done(const struct pack *p)
{
    for (int i = 0; i < p->stage_count; i++)
        for (int64_t k = 0; k < p->stages[i].columns * p->stages[i].rows; k++)
            if (p->stages[i].regions[k].reduced || p->stages[i].regions[k].coded) return false;
    return true;
}

static void finish(struct pack *p)
{
    region_finish(&p->top);
    free(p->top_room);
    for (int i = 0; i < MOST_THREADS; i++) free(p->rooms.room[i]);
    for (int i = 0; i < p->stage_count; i++) free(p->stages[i].regions);
    pthread_mutex_destroy(&p->lock);
}

bool relief_pack_source(const struct relief_source *source, const struct relief_pack_options *options,
                        const char *path, struct relief_header *header)
{
    struct pack *p = calloc(1, sizeof *p);
    if (!p) return fail("%s: out of memory", source->name);
    p->source = source, p->options = options, p->sums = NO_SUMS;
    pthread_mutex_init(&p->lock, NULL);
    struct pack_coder *c = &p->coder;
    grid_init(&c->grid, source->size[0], source->size[1]);
    c->layout = options->layout, c->method = pack_method(options->layout);
    c->lambda_65536 = LAMBDA_65536, c->counts = options->counts;
    if (c->layout == LAYOUT_WAVELET) // sums of U stay in 32 bits
        while (c->fraction_bits < RELIEF_FRACTION_BITS && source->magnitude_q <= 1 << (23 - c->fraction_bits))
            c->fraction_bits++;
    struct store_record *records = NULL;
    size_t count = 0;
    struct steps steps = {0};
    p->has_store = path != NULL;
    bool good = !path || store_open(&p->store, path, options->restart, &records, &count);
    for (int l = 0; l < LAYOUT_LEVELS; l++) p->store.width[l] = c->grid.size[l][0];
    describe(p, header);
    bool opened = good, taken = good && take_up(p, records, count, &steps);
    good = taken && pack_stages(p, header, &steps);
    progress_end(p);
    if (opened && path && !good && !p->failed) store_fail(&p->store);
    if (path && (good || (taken && nothing_is_done(p))))
        store_remove(&p->store);
    else if (path)
        store_close(&p->store);
    free(records);
    finish(p);
    free(p);
    return good;
}

bool relief_pack(struct heightfield *field, const struct relief_pack_options *options, const char *path,
                 struct relief_header *header)
{
    struct relief_source source;
    return relief_source_field(&source, field) && relief_pack_source(&source, options, path, header);
}
