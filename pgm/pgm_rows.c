// SPDX-License-Identifier: MIT
#include "pgm/pgm_rows.h"

#include "pgm/pgm_mesh.h"

#include <math.h>

enum { BINS = 256, SKYLINE_SLICES = 16 };

static double clamp(double value, double low, double high)
{
    return fmin(fmax(value, low), high);
}

// ---- levels ----------------------------------------------------------------

void pgm_level_for(double cells, enum pgm_lod lod, int levels, int *level, double *weight)
{
    *level = 0;
    *weight = 0;
    if (!(cells > 0) || levels <= 1) return;
    double lambda = clamp(log2(cells), -1, levels);
    double chosen = fmax(0, lod == PGM_LOD_FLOOR ? floor(lambda) : ceil(lambda));
    *level = (int)fmin(chosen, levels - 1);
    if (*level == levels - 1) return;
    *weight = clamp(cells * exp2(lod == PGM_LOD_FLOOR ? -chosen : 1 - chosen) - 1, 0, 1);
}

static double sampling_distance(const struct pgm_row *row, double step, int columns, enum pgm_spread spread)
{
    double across = 2 * row->half_width_m / columns;
    switch (spread) {
    case PGM_SPREAD_MEAN:
        return sqrt(step * across);
    case PGM_SPREAD_NEAR:
        return fmin(step, across);
    default:
        return fmax(step, across);
    }
}

static void set_level(struct pgm_row *row, const struct pgm_world *world, const struct pgm_settings *settings)
{
    double cells = row->spacing_m / world->spacing_m * exp2(settings->lod_bias);
    pgm_level_for(cells, settings->lod, world->levels, &row->level, &row->weight);
    row->range_m = 0;
    if (settings->lod == PGM_LOD_PUBLISHED && row->level < world->levels - 1)
        row->range_m = ldexp(world->spacing_m, row->level - 1);
}

// ---- a span of rows --------------------------------------------------------

// From one forward distance to a nearer one, on the sampling camera's image plane.
struct span {
    double sine, cosine, height_m; // of the depression; h
    double fall[2], y[2];          // of its far and its near end
    double log_span, growth;       // log and growth of the fall from end to end
    enum pgm_fall form;
    bool even; // the fall does not vary, as when looking straight down: rows are even in y
};

static struct span span_between(const struct pgm_sampler *sampler, double far_m, double near_m,
                                enum pgm_fall form)
{
    struct span span = {.sine = sin(sampler->depression),
                        .cosine = cos(sampler->depression),
                        .height_m = sampler->height_m,
                        .form = form};
    const double ends[2] = {far_m, near_m};
    double t[2];
    for (int end = 0; end < 2; end++) {
        t[end] = ends[end] * span.cosine + span.height_m * span.sine;
        span.fall[end] = span.height_m / t[end];
        span.y[end] = (ends[end] * span.sine - span.height_m * span.cosine) / t[end];
    }
    span.log_span = log(t[0] / t[1]);
    span.growth = expm1(span.log_span);
    span.even = !(span.log_span > 1e-6);
    return span;
}

// The share of the way, in fall and in y, at share x of the log of the fall.
static double way_at(const struct span *span, double x)
{
    return span->even || x <= 0 || x >= 1 ? x : expm1(x * span->log_span) / span->growth;
}

static double forward_at(const struct span *span, double way, double *fall)
{
    double y = span->y[0] + way * (span->y[1] - span->y[0]);
    // Sums of positive terms: sin A - y cos A cancels at the horizon (numerics.md, A2).
    *fall = span->form == PGM_FALL_STABLE
                ? span->fall[0] + way * (span->fall[1] - span->fall[0])
                : (double)((float)span->sine - (float)y * (float)span->cosine); // as a vertex program would
    return span->height_m * (span->cosine + y * span->sine) / *fall;
}

// Share x of the log of the fall at which a place lies.
static double log_share_of(const struct span *span, double forward_m)
{
    double fall = span->height_m / (forward_m * span->cosine + span->height_m * span->sine);
    return span->even ? 0.5 : clamp(log(fall / span->fall[0]) / span->log_span, 0, 1);
}

// ---- laws ------------------------------------------------------------------

// Solves (1 - share) expm1(x L) / K + share x = u for x in [0, 1], K = expm1(L): the share of the way from
// the far to the near fall when `share` of the rows' density is even in log b and the rest even in b.  Convex
// in x, so Newton's steps come down from the right of the root and stay there.
static double solve_law(double share, double log_span, double u, double start)
{
    if (share >= 1 || u <= 0 || u >= 1) return clamp(u, 0, 1);
    double span = expm1(log_span), x = start;
    if (share <= 0) return log1p(u * span) / log_span;
    for (int step = 0; step < 60; step++) {
        double grown = expm1(x * log_span);
        double value = (1 - share) * grown / span + share * x - u;
        double slope = (1 - share) * (grown + 1) * log_span / span + share;
        double moved = clamp(x - value / slope, 0, 1);
        if (fabs(moved - x) <= 1e-13) return moved;
        x = moved;
    }
    return x;
}

// Sampling distance at which p99.9 of the mesh's error is the target at a forward distance.  Between two
// levels it is blended as they are; within a cell of the finest it is the error at creases, which is in
// proportion.
static double wanted_spacing(const struct pgm_sampler *sampler, const struct view *view,
                             const struct pgm_world *world, double target_px, double forward_m)
{
    // Near the viewer, where it matters, the ground is not the sampling plane but what lies under the eye.
    double ahead = view->forward[0] * sampler->forward[0] + view->forward[1] * sampler->forward[1];
    double below_m = fmin(fmax(view->eye_m[2] - world->ground_m, 0), sampler->height_m);
    double depth = fmax(forward_m * ahead - below_m * view->forward[2], view->near_m);
    double allowed_m = target_px * depth / view->pixels_per_tangent;
    int k = 0;
    while (k < world->levels && world->error_m[k] < allowed_m) k++;
    if (k == world->levels) return ldexp(world->spacing_m, k - 1);
    if (k == 0) return world->spacing_m * allowed_m / world->error_m[0];
    double below = world->error_m[k - 1], part = (allowed_m - below) / (world->error_m[k] - below);
    return ldexp(world->spacing_m, k - 1) * (1 + part);
}

// Rows that the target takes from the far end to share k / BINS of the log of the fall, and the columns.
static double count_target(const struct pgm_sampler *sampler, const struct view *view,
                           const struct pgm_world *world, const struct pgm_settings *settings,
                           const struct span *span, double counts[BINS + 1], double *columns)
{
    double fall, before = forward_at(span, 0, &fall);
    counts[0] = 0;
    *columns = 1;
    for (int k = 0; k < BINS; k++) {
        double after = forward_at(span, way_at(span, (k + 1.0) / BINS), &fall);
        double spacing = wanted_spacing(sampler, view, world, settings->target_px, after);
        counts[k + 1] = counts[k] + fmax((before - after) / spacing, 1e-3); // strictly increasing
        *columns = fmax(*columns, 2 * pgm_sampler_half_width(sampler, before) / spacing);
        before = after;
    }
    return counts[BINS];
}

struct law {
    double share;         // of the rows' density that is even in log distance
    double focus, width;  // of PGM_LAW_FOCUS
    const double *counts; // of PGM_LAW_TARGET, else NULL
};

static double solve_counts(const double counts[BINS + 1], double u)
{
    double wanted = u * counts[BINS];
    int low = 0, high = BINS;
    while (high - low > 1) {
        int middle = (low + high) / 2;
        if (counts[middle] <= wanted)
            low = middle;
        else
            high = middle;
    }
    return (low + clamp((wanted - counts[low]) / (counts[low + 1] - counts[low]), 0, 1)) / BINS;
}

// Share of the log of the fall at share u of the rows.  start: that of the row before.
static double law_at(const struct law *law, const struct span *span, double u, double start)
{
    if (u <= 0 || u >= 1) return clamp(u, 0, 1);
    if (law->counts) return solve_counts(law->counts, u);
    double spread = pgm_focus(u, law->focus, law->width);
    if (span->even) return spread;
    return solve_law(law->share, span->log_span, spread, start);
}

// Where on the rows the focus lies: the share of the half-log law at the ground it looks at.
static double focus_share(const struct pgm_sampler *sampler, const struct view *view,
                          const struct pgm_settings *settings, const struct span *span)
{
    double elevation = view->pitch + atan(settings->focus[1] * sampler->tan_half[1]);
    double forward = elevation < 0 && elevation > -3.1 ? -sampler->height_m * cos(elevation) / sin(elevation)
                                                       : sampler->far_m;
    double x = log_share_of(span, clamp(forward, sampler->near_m, sampler->far_m));
    return span->even ? x : 0.5 * (way_at(span, x) + x);
}

static struct law law_for(const struct pgm_sampler *sampler, const struct view *view,
                          const struct pgm_settings *settings, const struct span *span)
{
    struct law law = {.share = settings->law == PGM_LAW_UNIFORM ? 0 : settings->law == PGM_LAW_LOG ? 1 : 0.5};
    if (settings->law == PGM_LAW_FOCUS) {
        law.focus = focus_share(sampler, view, settings, span);
        law.width = settings->focus_width / 2;
    }
    return law;
}

// ---- what a mesh errs by ---------------------------------------------------

// Ratios of the largest of `samples` to the rms, and of p99.9, where log P(|error| > x) = -(x / s)^b.
static double ratio_of(double log_rarity, double b)
{
    return pow(log_rarity, 1 / b) / sqrt(tgamma(1 + 2 / b));
}

double pgm_error_p999(double rms, double largest, double samples)
{
    if (!(rms > 0) || !(largest > rms) || !(samples > 1000)) return fmax(largest, 0);
    double heavy = 0.3, light = 4, rarity = log(samples);
    for (int step = 0; step < 50; step++) {
        double b = 0.5 * (heavy + light);
        if (ratio_of(rarity, b) > largest / rms)
            heavy = b;
        else
            light = b;
    }
    return fmin(rms * ratio_of(log(1000), light), largest);
}

double pgm_error_unaligned(double rms, double parent_rms)
{
    return sqrt(rms * rms + 2.0 / 15 * fmax(parent_rms * parent_rms - rms * rms, 0));
}

// ---- how many --------------------------------------------------------------

// Share of the window's height, in angle, from its lower edge to the highest terrain in it.
static double ground_share(const struct pgm_sampler *sampler, const struct view *view,
                           const struct pgm_world *world)
{
    const double half_pi = 1.57079632679489661923;
    double half = atan(sampler->tan_half[1]), top = -half_pi;
    double nearest = fmax(sampler->near_m, 1e-3 * sampler->far_m), ratio = sampler->far_m / nearest;
    if (sampler->near_m < 0 || !(ratio > 1)) return 1; // looks down
    for (int slice = 0; slice < SKYLINE_SLICES; slice++) {
        double from = slice ? nearest * pow(ratio, (double)slice / SKYLINE_SLICES) : sampler->near_m;
        double to = nearest * pow(ratio, (slice + 1.0) / SKYLINE_SLICES);
        double high = pgm_sampler_highest(sampler, view, world, from, to);
        top = fmax(top, atan2(high, high > 0 ? from : to));
    }
    return clamp((top - (view->pitch - half)) / (2 * half), 0, 1);
}

// The least rows that are at least `wanted`, of whole tiles, which are counted from the nearest of `most`
// rows.
static int cut_rows(int most, double wanted)
{
    int cut = (int)floor(clamp(most - wanted, 0, most - 1) / PGM_TILE);
    return most - cut * PGM_TILE;
}

// Likewise columns, of which tiles are counted from the first.
static int cut_columns(int most, double wanted)
{
    return (int)fmin(PGM_TILE * ceil(fmax(wanted, 1) / PGM_TILE), most);
}

static double step_at_edge(const struct pgm_sampler *sampler, const struct view *view,
                           const struct pgm_settings *settings, int rows, const struct span *span)
{
    struct law law = law_for(sampler, view, settings, span);
    double way = way_at(span, law_at(&law, span, (rows - 1.0) / rows, 1));
    return (1 - way) * fabs(span->y[1] - span->y[0]);
}

double pgm_hold_share(double share, double frame_ms, double hold_ms)
{
    double ratio = hold_ms / fmax(frame_ms, 1e-3);
    if (fabs(ratio - 1) <= 0.05) return share;
    return clamp(share * clamp(ratio, 0.7, 1.1), 1e-3, 1);
}

void pgm_rows_fit(const struct pgm_sampler *sampler, const struct view *view, const struct pgm_world *world,
                  const struct pgm_settings *settings, int most_rows, struct pgm_settings *used)
{
    double rows = settings->rows, columns = settings->columns, needed;
    double last_m = settings->strips ? sampler->edge_m : sampler->near_m; // that the law spreads rows to
    struct span span = span_between(sampler, sampler->far_m, last_m, settings->fall);
    if (settings->law == PGM_LAW_TARGET) {
        double counts[BINS + 1];
        rows = fmin(rows, count_target(sampler, view, world, settings, &span, counts, &needed));
        columns = fmin(columns, needed);
    }
    if (settings->shrink) rows *= ground_share(sampler, view, world);
    rows = fmax(1, ceil(rows * sqrt(settings->share)));
    if (settings->law != PGM_LAW_FOCUS)
        columns *= sqrt(settings->share); // its columns stand where they were put
    double extra = 0;
    if (settings->strips && sampler->edge_m > sampler->near_m) {
        struct span below = span_between(sampler, sampler->edge_m, sampler->near_m, settings->fall);
        double step = step_at_edge(sampler, view, settings, (int)rows, &span);
        extra = ceil(clamp(fabs(below.y[1] - below.y[0]) / fmax(step, 1e-9), 1, most_rows - rows));
    }
    *used = *settings;
    used->rows = cut_rows(most_rows, rows + extra);
    used->columns = cut_columns(settings->columns, columns);
    used->extra_rows = extra > 0 ? used->rows - (int)rows : 0;
}

// ---- laying ----------------------------------------------------------------

// Rows first .. first + count, the ends of a span included.
static void lay_span(const struct pgm_sampler *sampler, const struct span *span, const struct law *law,
                     bool by_law, int first, int count, struct pgm_row *rows)
{
    double x = 0;
    for (int j = 0; j <= count; j++) {
        double u = (double)j / count, way = u;
        if (by_law) way = way_at(span, x = law_at(law, span, u, x));
        struct pgm_row *row = &rows[first + j];
        row->forward_m = forward_at(span, way, &row->fall);
        row->half_width_m = pgm_sampler_half_width(sampler, row->forward_m);
    }
}

void pgm_rows_lay(const struct pgm_sampler *sampler, const struct view *view, const struct pgm_world *world,
                  const struct pgm_settings *settings, struct pgm_row *rows)
{
    bool strips = settings->extra_rows > 0 && settings->extra_rows < settings->rows;
    int extra = strips ? settings->extra_rows : 0, own = settings->rows - extra;
    struct span span =
        span_between(sampler, sampler->far_m, strips ? sampler->edge_m : sampler->near_m, settings->fall);
    struct law law = law_for(sampler, view, settings, &span);
    double counts[BINS + 1], columns;
    if (settings->law == PGM_LAW_TARGET) {
        count_target(sampler, view, world, settings, &span, counts, &columns);
        law.counts = counts;
    }
    lay_span(sampler, &span, &law, true, 0, own, rows);
    if (strips) {
        struct span below = span_between(sampler, sampler->edge_m, sampler->near_m, settings->fall);
        lay_span(sampler, &below, &law, false, own, extra, rows);
    }
    for (int j = 1; j <= settings->rows; j++) {
        double step = rows[j - 1].forward_m - rows[j].forward_m;
        rows[j].spacing_m = sampling_distance(&rows[j], step, settings->columns, settings->spread);
        set_level(&rows[j], world, settings);
    }
    rows[0].spacing_m = rows[1].spacing_m;
    set_level(&rows[0], world, settings);
}
