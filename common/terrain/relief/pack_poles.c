// SPDX-License-Identifier: MIT
#include "common/terrain/relief/pack.h"

#include <math.h>

// Adds the samples of a row of `level` that a piece of level 0's row y, eastwards from x, becomes.
static bool add_piece(struct pack *p, int level, int64_t x, int64_t y, int64_t width, int64_t *sum)
{
    struct region *r = malloc(sizeof *r);
    if (!r) return pack_out_of_memory(p);
    const struct rect piece = {x, y, x + width, y + 1};
    region_plan(r, &p->coder, 0, level, &piece, false);
    void *room = malloc(region_room(r));
    bool good = pack_prepare_region(p, r, room);
    const struct region_level *at = &r->level[level];
    for (int64_t i = at->core.x0; good && i < at->core.x1; i++)
        *sum += *patch_at(&at->wanted, i, at->core.y0);
    free(room);
    free(r);
    return good;
}

static bool find_pole(struct pack *p, const struct relief_planet *planet, int level, int end)
{
    enum { PIECE = 4096 };
    int64_t piece = (int64_t)1 << level > PIECE ? (int64_t)1 << level : PIECE, sum = 0;
    int64_t y = region_pole_row(&p->coder, 0, end), x_end = planet->margin + planet->grid.columns;
    for (int64_t x = planet->margin; x < x_end; x += piece)
        if (pack_stopped(p) || !add_piece(p, level, x, y, piece < x_end - x ? piece : x_end - x, &sum))
            return false;
    double mean = (double)sum / (double)(planet->grid.columns >> level);
    p->coder.poles.q[level][end] = (int32_t)llround(ldexp(mean, -p->coder.fraction_bits));
    return true;
}

// Coarser poles are made from the finer ones, so level by level.
bool pack_find_poles(struct pack *p, const struct planet_source *planet)
{
    struct pack_poles *poles = &p->coder.poles;
    pack_progress_say(p, "looking at the poles");
    for (int level = 0; level <= planet->planet.coarsest; level++) {
        for (int end = 0; end < 2; end++) {
            poles->q[level][end] = planet->pole_q[end];
            bool filtered = level > 0 && p->coder.method->reach > 0;
            if (filtered && !find_pole(p, &planet->planet, level, end)) return false;
        }
        poles->known = level + 1;
    }
    return true;
}
