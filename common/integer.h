// Of two whole numbers. SPDX-License-Identifier: MIT
#ifndef COMMON_INTEGER_H
#define COMMON_INTEGER_H

#include <stdint.h>

static inline int64_t smaller(int64_t a, int64_t b)
{
    return a < b ? a : b;
}
static inline int64_t larger(int64_t a, int64_t b)
{
    return a > b ? a : b;
}

#endif
