// SPDX-License-Identifier: MIT
#include "common/terrain/relief/relief_pack.h"

#include "common/parallel.h"
#include "common/report.h"
#include "common/terrain/relief/pack.h"
#include "common/terrain/upsample.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum {
    LARGEST_REGION = 2048,
    TOP_BYTES = 32, // that a map costs a sample when it is held whole
};

// ---- the plan --------------------------------------------------------------

static size_t memory_of(const struct pack *p)
{
    return p->options->memory_bytes ? p->options->memory_bytes : (size_t)512 << 20;
}

static int stages_for(const struct pack *p)
{
    const struct grid *grid = &p->coder.grid;
    size_t most = memory_of(p) / TOP_BYTES;
    if (!p->has_store || (size_t)pack_samples_of(grid, 0) <= most) return 0;
    int count = 1;
    while ((count + 1) * STAGE_LEVELS < grid->count &&
           (size_t)pack_samples_of(grid, count * STAGE_LEVELS) > most / 3)
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
             2.0 * LAYOUT_SAMPLES * LAYOUT_SAMPLES * (double)pack_tile_count(&r->level[0].tiles)) /
            (3 * own);
    size_t bytes = region_room(r) + (size_t)(6 * own); // surfaces, tiles
    free(r);
    return bytes;
}

static void choose_regions(struct pack *p)
{
    int most = p->options->threads > 0 ? p->options->threads : parallel_processors();
    if (most > MOST_THREADS) most = MOST_THREADS;
    size_t taken = (size_t)pack_samples_of(&p->coder.grid, p->stages[p->stage_count - 1].coarse) * TOP_BYTES;
    size_t most_bytes = memory_of(p) / 8 * 7; // the rest: the program, the index, what is read and written
    size_t budget = most_bytes > taken ? most_bytes - taken : 0;
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
        if (!stage->regions) return pack_out_of_memory(p);
    }
    return true;
}

static uint64_t identity_of(const struct pack *p)
{
    const struct relief_pack_options *o = p->options;
    uint64_t hash = p->source->identity;
    const double aims[5] = {o->layout, o->rms_m, o->max_m, o->scaled, RELIEF_VERSION_NUMBER};
    hash = pack_scrambled(hash ^ relief_crc((const uint8_t *)aims, sizeof aims));
    hash = pack_scrambled(hash ^ relief_crc((const uint8_t *)&CODER_TABLES, sizeof CODER_TABLES));
    hash = pack_scrambled(hash ^ relief_crc((const uint8_t *)p->source->name, strlen(p->source->name)));
    return hash;
}

// A journal that lost its end tells of levels that were dropped since: these are made again.
static bool check_levels(struct pack *p, const struct steps *steps)
{
    bool lost = false;
    for (int i = 0; i < p->stage_count; i++) {
        if (p->stages[i].regions[0].reduced &&
            !store_has_level(&p->store, STORE_WANTED, p->stages[i].coarse) && !pack_note_dropped(p, i))
            return false;
        lost |= i > 0 && stage_any_coded(&p->stages[i]) && !stage_is_coded(&p->stages[0]) &&
                !store_has_level(&p->store, STORE_DECODED, p->stages[i].fine);
    }
    return !lost || pack_begin_attempt(p, steps);
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
        if (r->kind == STORE_DROPPED) stage_forget_reduced(&p->stages[r->stage]);
        if (r->kind == STORE_STEP)
            p->attempt = r->attempt, *steps = (struct steps){r->step, r->lambda_65536, r->uneven};
    }
    for (size_t i = 1; i < count; i++) {
        const struct store_record *r = &records[i];
        if (r->kind != STORE_CODED || r->attempt != p->attempt) continue;
        pack_take_coded(p, r);
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
    h->radius_m = s->radius_m;
    h->margin = (int)p->coder.poles.margin, h->coarsest = p->coder.poles.coarsest;
    memcpy(h->name, s->name, sizeof h->name);
}

// ---- packing ---------------------------------------------------------------

static bool pack_stages(struct pack *p, const struct planet_source *planet, struct relief_header *header,
                        struct steps *steps)
{
    bool wavelet = p->options->layout == LAYOUT_WAVELET;
    p->progress.begun_s = p->progress.shown_s = pack_seconds();
    if (p->coder.poles.planet && !pack_find_poles(p, planet)) return false;
    if (!pack_reduce_all(p) || !pack_prepare_top(p)) return false;
    if (!wavelet) pack_set_bounded_steps(p);
    bool coded = wavelet ? pack_code_wavelet(p, steps)
                         : (p->attempt > 0 || pack_begin_attempt(p, steps)) && pack_code_all(p);
    if (!coded) return false;
    header->rms_m = pack_rms_of(p, &p->sums);
    header->max_m = (double)p->sums.most * p->source->quantum_m;
    header->min_q = p->sums.min_q, header->max_q = p->sums.max_q;
    return pack_assemble(p, header);
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

bool relief_pack_source(const struct relief_source *from, const struct relief_pack_options *options,
                        const char *path, struct relief_header *header)
{
    struct planet_source planet;
    int reach = pack_method(options->layout)->reach;
    // At least 1: tiles reach a sample beyond themselves, also at the seam.
    if (from->radius_m > 0 && !planet_source_init(&planet, from, reach > 0 ? reach : 1)) return false;
    const struct relief_source *source = from->radius_m > 0 ? &planet.map : from;
    struct pack *p = calloc(1, sizeof *p);
    if (!p) return fail("%s: out of memory", source->name);
    p->source = source, p->options = options, p->sums = pack_no_sums();
    pthread_mutex_init(&p->lock, NULL);
    struct pack_coder *c = &p->coder;
    if (from->radius_m > 0)
        c->poles = (struct pack_poles){
            .planet = true, .coarsest = planet.planet.coarsest, .margin = planet.planet.margin};
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
    good = taken && pack_stages(p, &planet, header, &steps);
    pack_progress_end(p);
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

bool relief_pack_max_for_rms(struct heightfield *field, struct relief_pack_options *options, double rms_m)
{
    const int32_t most = QUANTA_LIMIT; // any map keeps that
    int32_t low = 0, high = 1;
    for (bool grows = true; low < most && (grows || high - low > 1);) {
        int32_t middle = grows ? high : (low + high) / 2;
        struct relief_header header;
        options->max_m = middle * field->quantum_m;
        if (!relief_pack(field, options, NULL, &header)) return false;
        bool keeps = header.rms_m <= rms_m;
        *(keeps ? &low : &high) = middle;
        if (grows && keeps) high = middle < most / 2 ? 2 * middle : most;
        grows &= keeps;
    }
    options->max_m = low * field->quantum_m;
    return true;
}
