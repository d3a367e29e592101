// `bench fly`: long flights over maps that only fit on disk.
// SPDX-License-Identifier: MIT
#ifndef BENCH_FLY_H
#define BENCH_FLY_H

int fly_main(int argc, char **argv); // the subcommand; returns the exit code

#endif
