// Triangle lists made into strips.  No GL.
// SPDX-License-Identifier: MIT
#ifndef GEOMIPMAP_GEOMIPMAP_STRIP_H
#define GEOMIPMAP_GEOMIPMAP_STRIP_H

#include <stddef.h>
#include <stdint.h>

// Writes `count` indices of a list, whose triangles share each edge with one other at most, as one strip:
// the same triangles turning the same way, in another order, joined by triangles without area, and turned by
// others.  `out` has
// room for geomipmap_strip_bound(count) indices.  Returns their number; 0 when there is no memory.
size_t geomipmap_strip_write(const uint16_t *list, size_t count, uint16_t *out);
size_t geomipmap_strip_bound(size_t count);

#endif
