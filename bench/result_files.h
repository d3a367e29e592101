// The files of a result folder other than results.json: frames/*.csv and pictures/*.png; and what every JSON
// of results has in common.  Each file is whole or absent.  All return false after one line on stderr.
// SPDX-License-Identifier: MIT
#ifndef BENCH_RESULT_FILES_H
#define BENCH_RESULT_FILES_H

#include "bench/run.h"

#include <cjson/cJSON.h>

extern const char *const moment_names[MOMENT_COUNT]; // "start", "middle", "worst"

// Makes frames/ and pictures/, and removes what an earlier run left there and its results.json.
bool result_make_folders(const char *folder);

// Makes the folder and its parents and proves that it can be written: before anything is measured.
bool result_prepare_folder(const char *folder);

// Parts that every JSON of results opens with (results.c): the time, and machine, build and gl.
void result_add_created(cJSON *root);
void result_add_machine(cJSON *root, const struct gpu_info *info);

// Writes a whole text file under a temporary name and renames it.
bool result_write_text(const char *path, const char *text);

// A frame's claim over its error, as far as that is certain: below 1 the claim is broken.  NAN where nothing
// is claimed, measured or off.
double frame_tightness(const struct frame_record *record);

// frames/<slug>.csv: one line a frame; an empty cell was not measured.
bool result_write_csv(const struct setting *setting, const char *folder);

// pictures/<slug>_<moment>.png and pictures/<slug>_<moment>_error.png.
bool result_write_pictures(const struct run *run, const struct setting *setting, const char *folder);

#endif
