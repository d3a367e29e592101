// SPDX-License-Identifier: MIT
#include "common/terrain/relief/pack.h"

#include "common/parallel.h"
#include "common/report.h"
#include "common/terrain/upsample.h"

#include <math.h>

enum {
    MOST_LAMBDA = 1 << 26,
    ATTEMPTS = 6,
};

void pack_set_bounded_steps(struct pack *p)
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
    if (!s->squares || !s->sums) return pack_out_of_memory(p);
    for (int64_t j = 0; j < along; j++)
        for (int64_t i = 0; i < across; i++) {
            uint64_t dice = pack_scrambled(0x9e3779b97f4a7c15u * (uint64_t)(j * across + i + 1));
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
    s->sums[block] = pack_no_sums();
    if (pack_stopped(p)) return;
    struct region *r = malloc(sizeof *r);
    if (!r) {
        pack_out_of_memory(p);
        return;
    }
    region_plan(r, &p->coder, p->stages[0].fine, p->stages[0].coarse, &s->squares[block * s->stride], true);
    void *room = pack_take_room(p, region_room(r));
    if (pack_prepare_region(p, r, room) && pack_read_decoded(p, r->coarse, &r->level[r->coarse].decoded) &&
        (region_code(r, false) || pack_out_of_memory(p)))
        region_measure(r, &s->sums[block]);
    pack_give_room(p, room);
    free(r);
}

double pack_rms_of(const struct pack *p, const struct region_sums *sums)
{
    return sqrt((double)sums->squares / (double)sums->samples) * p->source->quantum_m;
}

static void set_steps(struct pack *p, const struct steps *steps)
{
    set_wavelet_steps(p, steps->step);
    p->coder.lambda_65536 = steps->lambda_65536;
    p->coder.uneven = steps->uneven;
}

// What rms they give: of the whole map, or of the sample.
static bool try_steps(struct pack *p, const struct sample *sample, const struct steps *steps, double *rms_m)
{
    struct region_sums sums = pack_no_sums();
    set_steps(p, steps);
    if (!pack_code_top(p, false)) return false;
    if (p->stage_count == 0) {
        region_measure(&p->top, &sums);
    } else {
        int count = (sample->count + sample->stride - 1) / sample->stride;
        parallel_blocks(count, p->threads, measure_square, (void *)sample);
        for (int i = 0; i < count; i++)
            sums.squares += sample->sums[i].squares, sums.samples += sample->sums[i].samples;
    }
    *rms_m = pack_rms_of(p, &sums);
    return !pack_stopped(p);
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
    double start_s = pack_seconds();
    pack_progress_say(p, "looking for the steps");
    bool good = sample_init(&sample, p);
    if (good) {
        sample.stride = sample.count >= 128 ? sample.count / 64 : 1; // a few squares tell where to look
        good = search_step(p, &sample, (struct window){0.97, 0.99, 1.01}, steps);
        sample.stride = 1;
        good = good && search_step(p, &sample, (struct window){0.988, 0.99, 0.992}, steps);
    }
    p->progress.begun_s += pack_seconds() - start_s; // no measure of what is left
    free(sample.squares);
    free(sample.sums);
    return good;
}

bool pack_begin_attempt(struct pack *p, const struct steps *steps)
{
    struct store_record record = {.kind = STORE_STEP,
                                  .attempt = ++p->attempt,
                                  .step = steps->step,
                                  .lambda_65536 = steps->lambda_65536,
                                  .uneven = steps->uneven};
    p->sums = pack_no_sums();
    for (int i = 0; i < p->stage_count; i++) {
        p->stages[i].coded = false;
        for (int64_t k = 0; k < p->stages[i].columns * p->stages[i].rows; k++)
            p->stages[i].regions[k].coded = false;
    }
    return !p->has_store || (store_note(&p->store, &record) && store_forget_tiles(&p->store));
}

bool pack_code_wavelet(struct pack *p, struct steps *steps)
{
    const double aim = p->options->rms_m;
    if (steps->step == 0 && !(choose_steps(p, steps) && pack_begin_attempt(p, steps))) return false;
    for (;;) {
        set_steps(p, steps);
        if (!pack_code_all(p)) return false;
        double share = 1000 * pack_rms_of(p, &p->sums) / aim;
        if (p->stage_count == 0 || (share >= LEAST_PER_MILLE && share <= MOST_PER_MILLE)) return true;
        if (p->attempt >= ATTEMPTS && share < LEAST_PER_MILLE) return true;
        if (p->attempt >= 2 * ATTEMPTS)
            return fail("%s: an rms error of %g m cannot be reached", p->source->name, aim);
        note("%s: the rms error is %.4f of the aim; once more, with other steps", p->source->name,
             share / 1000);
        steps->step *= share > 0 ? pow(AIM_PER_MILLE / share, 1.15) : 2;
        if (!pack_begin_attempt(p, steps)) return false;
    }
}
