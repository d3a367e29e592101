// What every test program starts from: cmocka, the two sizes of a property, printed figures, data that may be
// absent. SPDX-License-Identifier: MIT
#ifndef TESTS_TEST_H
#define TESTS_TEST_H

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

#include <cmocka.h>

// Picks the everyday size, or the full stated size under `make soak`.
static inline int test_size(int everyday, int full)
{
    return getenv("RELIEF_SOAK") ? full : everyday;
}

// Prints a measured figure; `tests/run` shows these lines.
#define FIGURE(...) (printf("figure: " __VA_ARGS__), printf("\n"), fflush(stdout))

// Path of a file in $RELIEF_DATA; NULL after printing a "skipped:" line when the folder or the file is
// missing.
static inline const char *test_data(const char *name, char path[1024])
{
    const char *folder = getenv("RELIEF_DATA");
    if (folder) {
        snprintf(path, 1024, "%s/%s", folder, name);
        if (access(path, R_OK) == 0) return path;
    }
    printf("skipped: %s is not in RELIEF_DATA\n", name);
    return NULL;
}

// Seeded numbers for tests (splitmix64).
static inline uint64_t test_random(uint64_t *state)
{
    uint64_t z = (*state += 0x9e3779b97f4a7c15u);
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
    return z ^ (z >> 31);
}

static inline double test_uniform(uint64_t *state, double low, double high)
{
    return low + (high - low) * (double)(test_random(state) >> 11) * 0x1p-53;
}

#endif
