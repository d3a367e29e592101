// A folder of its own for a test program's files: made before the tests, removed with all it holds after
// them. SPDX-License-Identifier: MIT
#ifndef TESTS_FOLDER_H
#define TESTS_FOLDER_H

#include "tests/test.h"

static char folder[32];

// Path of a file in the folder; good until the fourth call after this one.
static inline const char *in_folder(const char *name)
{
    static char paths[4][256];
    static int next;
    char *path = paths[next++ % 4];
    snprintf(path, sizeof paths[0], "%s/%s", folder, name);
    return path;
}

static inline int folder_create(void **state)
{
    (void)state;
    snprintf(folder, sizeof folder, "/tmp/relief-test-XXXXXX");
    return mkdtemp(folder) ? 0 : -1;
}

static inline int folder_remove(void **state)
{
    (void)state;
    char command[64];
    snprintf(command, sizeof command, "rm -rf '%s'", folder);
    return system(command) ? -1 : 0;
}

#endif
