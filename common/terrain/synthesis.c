// SPDX-License-Identifier: MIT
#include "common/terrain/synthesis.h"

static inline uint64_t mix(uint64_t z) // the finaliser of splitmix64
{
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
    return z ^ (z >> 31);
}

static inline uint64_t row_key(int64_t j, int level, uint64_t seed)
{
    uint64_t key = mix(seed + 0x9e3779b97f4a7c15u * ((uint64_t)(int64_t)level + 0x100u));
    return mix(key ^ (uint64_t)j * 0xd6e8feb86659fd93u);
}

static inline int population(uint64_t x)
{
    x -= (x >> 1) & 0x5555555555555555u;
    x = (x & 0x3333333333333333u) + ((x >> 2) & 0x3333333333333333u);
    x = (x + (x >> 4)) & 0x0f0f0f0f0f0f0f0fu;
    return (int)((x * 0x0101010101010101u) >> 56);
}

// 64 coin tosses (variance 16) plus two uniforms (1/12 each) that close the steps between whole counts.
static inline double normal(uint64_t key, int64_t i)
{
    uint64_t tosses = mix(key ^ (uint64_t)i * 0xa0761d6478bd642fu);
    uint64_t steps = mix(tosses + 0x9e3779b97f4a7c15u);
    double sum = population(tosses) - 33 +
                 (double)((int64_t)(steps >> 32) + (int64_t)(steps & 0xffffffffu) + 1) * 0x1p-32;
    return sum * 0.24870800168690346; // 1 / sqrt(16 + 1/6)
}

double synthesis_normal(int64_t i, int64_t j, int level, uint64_t seed)
{
    return normal(row_key(j, level, seed), i);
}

// The nearest integer, halves upwards.
static inline int32_t rounded(double x)
{
    return (int32_t)(x + (0x1p26 + 0.5)) - (1 << 26);
}

void synthesis_add_row(int32_t *samples, int64_t count, int64_t i0, int64_t j, int level, uint64_t seed,
                       double sigma_q)
{
    uint64_t key = row_key(j, level, seed);
    for (int64_t i = 0; i < count; i++) samples[i] += rounded(sigma_q * normal(key, i0 + i));
}

struct synthesis_row synthesis_row(int64_t j, int level, uint64_t seed, double sigma_q)
{
    return (struct synthesis_row){row_key(j, level, seed), sigma_q};
}

double synthesis_deviate(const struct synthesis_row *row, int64_t i)
{
    return normal(row->key, i);
}

int32_t synthesis_rounded(double q)
{
    return rounded(q);
}

static int table_index(int64_t index)
{
    int rest = (int)(index % SYNTHESIS_TABLE);
    return rest < 0 ? rest + SYNTHESIS_TABLE : rest;
}

void synthesis_fill_table(struct synthesis_table *table, uint64_t seed)
{
    for (int j = 0; j < SYNTHESIS_TABLE; j++)
        for (int i = 0; i < SYNTHESIS_TABLE; i++) table->deviates[j][i] = synthesis_normal(i, j, 0, seed);
}

void synthesis_add_table_row(int32_t *samples, int64_t count, int64_t i0, int64_t j,
                             const struct synthesis_table *table, double sigma_q)
{
    const double *row = table->deviates[table_index(j)];
    int at = table_index(i0);
    for (int64_t i = 0; i < count; i++) {
        samples[i] += rounded(sigma_q * row[at]);
        at = at + 1 == SYNTHESIS_TABLE ? 0 : at + 1;
    }
}
