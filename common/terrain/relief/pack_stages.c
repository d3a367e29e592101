// SPDX-License-Identifier: MIT
#include "common/terrain/relief/pack.h"

#include "common/parallel.h"
#include "common/report.h"

#include <stdio.h>
#include <string.h>
#include <time.h>

static struct rect whole_of(const struct grid *grid, int level)
{
    return (struct rect){0, 0, grid->size[level][0], grid->size[level][1]};
}

// ---- progress --------------------------------------------------------------

double pack_seconds(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + (double)t.tv_nsec * 1e-9;
}

static void progress_show(struct pack *p)
{
    double now = pack_seconds(), done = p->progress.done, left = p->progress.all - done;
    double left_s = done > 0 ? (now - p->progress.begun_s) * left / done : 0;
    fprintf(stderr, "\r%s: %-22s %5.1f %%", p->source->name, p->progress.what,
            p->progress.all > 0 ? 100 * done / p->progress.all : 0);
    if (done > 0)
        fprintf(stderr, "  %d:%02d:%02d left ", (int)(left_s / 3600), (int)(left_s / 60) % 60,
                (int)left_s % 60);
    p->progress.shown_s = now;
}

static void progress_add(struct pack *p, double work)
{
    if (!p->options->progress) return;
    pthread_mutex_lock(&p->lock);
    p->progress.done += work;
    if (pack_seconds() - p->progress.shown_s > 1) progress_show(p);
    pthread_mutex_unlock(&p->lock);
}

void pack_progress_say(struct pack *p, const char *what)
{
    p->progress.what = what;
    if (p->options->progress) progress_show(p);
}

void pack_progress_end(const struct pack *p)
{
    if (p->options->progress && p->progress.shown_s > p->progress.begun_s) fprintf(stderr, "\r%79s\r", "");
}

// ---- rooms -----------------------------------------------------------------

void *pack_take_room(struct pack *p, size_t bytes)
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

void pack_give_room(struct pack *p, const void *room)
{
    pthread_mutex_lock(&p->lock);
    for (int i = 0; i < MOST_THREADS; i++)
        if (p->rooms.used[i] && p->rooms.room[i] == room) {
            p->rooms.used[i] = false;
            break;
        }
    pthread_mutex_unlock(&p->lock);
}

bool pack_out_of_memory(struct pack *p)
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

bool pack_prepare_region(struct pack *p, struct region *r, void *room)
{
    if (!room) return pack_out_of_memory(p);
    region_place(r, room);
    if (!read_wanted(p, r->fine, &r->level[r->fine].wanted)) return false;
    return region_reduce(r) || pack_out_of_memory(p);
}

// Samples of the finest level of a stage that is not coded yet, by coding what they hang on.
static bool decode_part(struct pack *p, const struct stage *stage, const struct patch *to)
{
    struct region *r = malloc(sizeof *r);
    if (!r) return pack_out_of_memory(p);
    region_plan(r, &p->coder, stage->fine, stage->coarse, &to->rect, true);
    void *room = malloc(region_room(r));
    bool good = pack_prepare_region(p, r, room) &&
                pack_read_decoded(p, r->coarse, &r->level[r->coarse].decoded) &&
                (region_code(r, false) || pack_out_of_memory(p));
    const struct patch *from = &r->level[stage->fine].decoded;
    for (int64_t y = to->rect.y0; good && y < to->rect.y1; y++)
        memcpy(patch_at(to, to->rect.x0, y), patch_at(from, to->rect.x0, y),
               (size_t)rect_width(&to->rect) * sizeof(int32_t));
    free(room);
    free(r);
    return good;
}

bool pack_read_decoded(void *user, int level, const struct patch *to)
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
    bool code; // else reduce
};

struct rect pack_core_of(const struct pack *p, const struct stage *stage, int region)
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

static bool reduce_and_keep(struct pack *p, const struct region *r, struct store_record *record)
{
    const struct region_level *at = &r->level[r->coarse];
    return store_write_level(&p->store, STORE_WANTED, r->coarse, &at->wanted, &at->core) &&
           store_note(&p->store, record);
}

// Entries of the tiles, level by level from the finest; at level 0 the squares and `beyond`; then the tiles'
// bytes in the same order.
static bool keep_region(struct pack *p, const struct region *r, const uint32_t *beyond, size_t beyond_count,
                        struct store_record *record)
{
    struct relief_bytes all = {0};
    for (int l = r->fine; l < r->coarse; l++)
        for (size_t i = 0; i < pack_tile_count(&r->level[l].core_tiles); i++) {
            const struct packed_tile *tile = &r->level[l].packed[i];
            const struct tile_entry entry = {tile->bytes, tile->error_q, tile->min_q, tile->max_q};
            relief_put(&all, &entry, sizeof entry);
        }
    if (r->fine == 0) relief_put(&all, r->squares, (size_t)r->coder->grid.count * sizeof *r->squares);
    relief_put(&all, beyond, beyond_count * sizeof *beyond);
    for (int l = r->fine; l < r->coarse; l++)
        for (size_t i = 0; i < pack_tile_count(&r->level[l].core_tiles); i++)
            relief_put(&all, r->level[l].packed[i].data, r->level[l].packed[i].bytes);
    record->bytes = all.size;
    bool good =
        all.full ? pack_out_of_memory(p) : store_add_tiles(&p->store, all.data, all.size, &record->offset);
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
void pack_take_coded(struct pack *p, const struct store_record *record)
{
    struct stage *stage = &p->stages[record->stage];
    stage->regions[record->region].coded = true;
    stage->regions[record->region].offset = record->offset;
    stage->regions[record->region].bytes = record->bytes;
    if (record->stage > 0) return;
    p->sums.squares += (squares_wide)record->squares[1] << 64 | record->squares[0];
    p->sums.samples += record->samples;
    if (record->most > p->sums.most) p->sums.most = record->most;
    if (record->min_q < p->sums.min_q) p->sums.min_q = record->min_q;
    if (record->max_q > p->sums.max_q) p->sums.max_q = record->max_q;
}

static bool code_and_keep(struct pack *p, struct region *r, struct store_record *record)
{
    const struct region_reader reader = {pack_read_decoded, p};
    size_t beyond_count = r->fine == 0 ? region_beyond(r) : 0;
    if (!pack_read_decoded(p, r->coarse, &r->level[r->coarse].decoded)) return false;
    uint32_t *beyond = malloc((beyond_count + 1) * sizeof *beyond);
    bool good = beyond && region_code(r, true);
    if (good && r->fine == 0) {
        struct region_sums sums = pack_no_sums();
        region_measure(r, &sums);
        note_sums(&sums, record);
        good = region_errors(r, &reader, beyond) || p->store.error;
    } else if (good)
        keep_levels(p, r);
    if (!good) pack_out_of_memory(p);
    good = good && !p->store.error && keep_region(p, r, beyond, beyond_count, record);
    free(beyond);
    return good;
}

// Reduces or codes one region.
static void run_region(int block, void *user)
{
    const struct work *w = user;
    struct pack *p = w->p;
    if (pack_stopped(p)) return;
    struct region *r = malloc(sizeof *r);
    if (!r) {
        pack_out_of_memory(p);
        return;
    }
    int number = w->pending[block];
    struct rect core = pack_core_of(p, w->stage, number);
    struct store_record record = {.kind = w->code ? STORE_CODED : STORE_REDUCED,
                                  .stage = (uint32_t)w->number,
                                  .attempt = w->code ? p->attempt : 0,
                                  .region = (uint32_t)number};
    region_plan(r, &p->coder, w->stage->fine, w->stage->coarse, &core, w->code);
    void *room = pack_take_room(p, region_room(r));
    bool good = pack_prepare_region(p, r, room) &&
                (w->code ? code_and_keep(p, r, &record) : reduce_and_keep(p, r, &record));
    pthread_mutex_lock(&p->lock);
    if (good && w->code)
        pack_take_coded(p, &record);
    else if (good)
        w->stage->regions[number].reduced = true;
    pthread_mutex_unlock(&p->lock);
    pack_give_room(p, room);
    region_finish(r);
    free(r);
    progress_add(p, (w->code ? WORK_CODE : WORK_REDUCE) * work_of(w->stage, &core));
}

// What is left to do of all stages, with what is done in this run, makes the whole.  Work of an earlier run
// is no measure of speed.
static void plan_progress(struct pack *p)
{
    p->progress.all = p->progress.done;
    for (int i = 0; i < p->stage_count; i++) {
        const struct stage *stage = &p->stages[i];
        bool served = i + 1 < p->stage_count && stage_is_coded(&p->stages[i + 1]); // its levels are used up
        for (int k = 0; k < stage->columns * stage->rows; k++) {
            struct rect core = pack_core_of(p, stage, k);
            int share = (stage->regions[k].coded ? 0 : WORK_CODE) +
                        (stage->regions[k].reduced || served ? 0 : WORK_REDUCE);
            p->progress.all += share * work_of(stage, &core);
        }
    }
}

static bool run_stage(struct pack *p, int number, bool code)
{
    struct stage *stage = &p->stages[number];
    int count = (int)(stage->columns * stage->rows), left = 0;
    struct work w = {p, stage, number, malloc((size_t)count * sizeof(int)), code};
    if (!w.pending) return pack_out_of_memory(p);
    for (int i = 0; i < count; i++)
        if (!(code ? stage->regions[i].coded : stage->regions[i].reduced)) w.pending[left++] = i;
    plan_progress(p);
    if (left > 0) pack_progress_say(p, code ? "coding" : "reducing");
    parallel_blocks(left, p->threads, run_region, &w);
    free(w.pending);
    return !pack_stopped(p);
}

// ---- the top ---------------------------------------------------------------

bool pack_prepare_top(struct pack *p)
{
    struct region *r = &p->top;
    int last = p->stage_count - 1, fine = last < 0 ? 0 : p->stages[last].coarse;
    struct rect whole = whole_of(&p->coder.grid, fine);
    region_plan(r, &p->coder, fine, p->coder.grid.count - 1, &whole, true);
    r->threads = p->options->threads;
    p->top_room = malloc(region_room(r));
    return pack_prepare_region(p, r, p->top_room);
}

bool pack_code_top(struct pack *p, bool write)
{
    region_code_base(&p->top);
    return region_code(&p->top, write) || pack_out_of_memory(p);
}

bool stage_is_coded(const struct stage *stage)
{
    for (int64_t i = 0; i < stage->columns * stage->rows; i++)
        if (!stage->regions[i].coded) return false;
    return true;
}

// Reduces what is left to reduce; what stages that are coded were made from is not needed any more.
bool pack_reduce_all(struct pack *p)
{
    bool needed[LAYOUT_LEVELS] = {false};
    for (int i = p->stage_count - 1; i >= 0; i--) {
        struct stage *stage = &p->stages[i];
        needed[i] |= i + 1 == p->stage_count || !stage_is_coded(&p->stages[i + 1]);
        for (int64_t k = 0; needed[i] && i > 0 && k < stage->columns * stage->rows; k++)
            if (!stage->regions[k].reduced) needed[i - 1] = true;
    }
    for (int i = 0; i < p->stage_count; i++)
        if (needed[i] && !run_stage(p, i, false)) return false;
    return true;
}

bool stage_any_coded(const struct stage *stage)
{
    for (int64_t i = 0; i < stage->columns * stage->rows; i++)
        if (stage->regions[i].coded) return true;
    return false;
}

bool stage_any_reduced(const struct stage *stage)
{
    for (int64_t i = 0; i < stage->columns * stage->rows; i++)
        if (stage->regions[i].reduced) return true;
    return false;
}

void stage_forget_reduced(struct stage *stage)
{
    for (int64_t k = 0; k < stage->columns * stage->rows; k++) stage->regions[k].reduced = false;
}

// What a stage was reduced to is not there any more.
bool pack_note_dropped(struct pack *p, int number)
{
    struct store_record record = {.kind = STORE_DROPPED, .stage = (uint32_t)number};
    stage_forget_reduced(&p->stages[number]);
    return store_note(&p->store, &record);
}

bool pack_code_all(struct pack *p)
{
    const struct region_reader nobody = {NULL, NULL};
    if (!pack_reduce_all(p) || !pack_code_top(p, true)) return false;
    for (int i = p->stage_count - 1; i >= 0; i--) {
        if (!run_stage(p, i, true)) return false;
        p->stages[i].coded = true;
        if (i == 0 || !stage_any_reduced(&p->stages[i - 1])) continue;
        if (!pack_note_dropped(p, i - 1)) return false; // what this stage was made from makes room
        store_drop_level(&p->store, STORE_WANTED, p->stages[i].fine);
    }
    if (p->stage_count > 0) return true;
    p->sums = pack_no_sums();
    region_measure(&p->top, &p->sums);
    return region_errors(&p->top, &nobody, NULL) || pack_out_of_memory(p);
}
