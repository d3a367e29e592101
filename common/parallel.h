// Runs independent blocks of work on a few threads.  Blocks are numbered; which thread runs a block never
// changes what the block computes, so results are bitwise the same for any number of threads as long as each
// block writes only what is its own.
// SPDX-License-Identifier: MIT
#ifndef COMMON_PARALLEL_H
#define COMMON_PARALLEL_H

// Calls work(block, user) once for each block in 0..count-1 and returns when all are done.
// threads <= 0: one for each processor.
void parallel_blocks(int count, int threads, void (*work)(int block, void *user), void *user);

// Processors that this process may use, at least 1.
int parallel_processors(void);

#endif
