// The three views of Earth in Clasen & Hege 2006, section 5.2, for the tables that fly them.
// SPDX-License-Identifier: MIT
#ifndef BENCH_PAPERS_SPHERE_H
#define BENCH_PAPERS_SPHERE_H

#include "bench/papers/papers.h"

enum papers_sphere_view {
    PAPERS_SPHERE_GROUND,
    PAPERS_SPHERE_AIRCRAFT,
    PAPERS_SPHERE_SPACE,
    PAPERS_SPHERE_VIEWS
};

// Earth with its synthesised levels.  *earth is NULL where its data is missing: then the table says so. False
// after one line on stderr.
bool papers_sphere_earth(struct papers_table *table, struct terrain **earth);

// A scene of one view, 90 degrees wide; the path is the caller's, the terrain stays the lender's.  still: the
// eye stands and looks about instead of moving.
bool papers_sphere_scene(const struct papers *papers, struct terrain *earth, enum papers_sphere_view view,
                         bool still, int frames, struct scene *scene);
const char *papers_sphere_label(enum papers_sphere_view view);

#endif
