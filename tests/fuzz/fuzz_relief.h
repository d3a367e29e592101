// One execution of the fuzzer: some bytes are taken for a .relief file and read.  SPDX-License-Identifier:
// MIT
#ifndef TESTS_FUZZ_RELIEF_H
#define TESTS_FUZZ_RELIEF_H

#include <stddef.h>
#include <stdint.h>

// What is wrong must end in a refusal: whatever the bytes are, this returns.  Checksums are set right first,
// in a copy, so that what they protect is reached.
// Returns whether the file was opened.
int fuzz_relief(const uint8_t *data, size_t size);

#endif
