// SPDX-License-Identifier: MIT
#include "common/terrain/relief/pack_squares.h"

__extension__ typedef __int128 wide;

void triangle_add_line(struct triangle_sums *t, const struct triangle_line *line, int64_t cell,
                       const int32_t *fine)
{
    int64_t u = 0, uu = 0, e = 0, ue = 0, v = line->v;
    for (int64_t i = line->from; i < line->to; i++) {
        int64_t off = line->a + i * line->b - cell * fine[i];
        u += i, uu += i * i;
        e += off, ue += i * off;
    }
    int64_t n = line->to > line->from ? line->to - line->from : 0;
    t->n += n, t->u += u, t->v += n * v;
    t->uu += uu, t->uv += u * v, t->vv += n * v * v;
    t->e += e, t->ue += ue, t->ve += e * v;
    t->ee += triangle_line_squares(line, cell, fine);
}

squares_wide triangle_squares(const struct triangle_sums *t, const int64_t plane[3], int up)
{
    const wide a = plane[0], b = plane[1], c = plane[2], unit = (wide)1 << up;
    wide squares = a * a * t->n + b * b * t->uu + c * c * t->vv;
    wide products = a * b * t->u + a * c * t->v + b * c * t->uv + unit * (a * t->e + b * t->ue + c * t->ve);
    return (squares_wide)(squares + 2 * products) + (((squares_wide)t->ee << up) << up);
}
