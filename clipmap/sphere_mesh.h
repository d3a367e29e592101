// The rings' static geometry in OpenGL buffers, the blocks of it that a view draws, and their transformed
// vertices, which are kept while the eye stands still (Clasen & Hege 2006, sections 3.4 and 6.1).
//
// A block is a part (some rings, or an octave of the disc within them, or the fan at the nadir) times a
// sector.  Vertices lie sector by sector and ring by ring, so that a sector's parts follow each other.
// SPDX-License-Identifier: MIT
#ifndef CLIPMAP_SPHERE_MESH_H
#define CLIPMAP_SPHERE_MESH_H

#include "clipmap/sphere_rings.h"
#include "common/gl/gpu.h"

enum { SPHERE_PART_RINGS = 24, SPHERE_HALVINGS = 16 };

struct sphere_mesh {
    struct gpu *gpu;
    const struct sphere_rings *rings;
    int across;                         // azimuths of a sector
    int row;                            // vertices of a ring in a sector: both its ends, and the nadir
    size_t disc_first[SPHERE_HALVINGS]; // index lists of the disc's octaves
    GLsizei disc_count[SPHERE_HALVINGS];
    size_t fan_first;
    GLsizei fan_count;
    GLuint vertices, indices, vertex_array;
};

// gpu and rings are borrowed until finish.  False after one line on stderr.
bool sphere_mesh_init(struct sphere_mesh *mesh, struct gpu *gpu, const struct sphere_rings *rings);
void sphere_mesh_finish(struct sphere_mesh *mesh); // accepts zeroed

struct sphere_part { // rings outer .. inner
    int outer, inner;
    GLsizei count; // of its index list
    size_t first_index;
};

// The parts that cover a range of rings and the disc within, from the horizon inwards; returns how many.
int sphere_mesh_parts(const struct sphere_mesh *mesh, const struct sphere_ring_range *range,
                      struct sphere_part *parts);
int sphere_mesh_most_parts(const struct sphere_mesh *mesh);

struct sphere_blocks { // of one view
    struct sphere_part *parts;
    uint8_t *state;  // bits of each part, sector by sector
    GLsizei *counts; // the draws
    size_t *first_index;
    GLint *base_vertex;
    int part_count, most_parts, draws;
    uint64_t triangles;
    GLuint kept, kept_array; // transformed vertices, where the mesh has them
};

bool sphere_blocks_init(struct sphere_blocks *blocks, const struct sphere_mesh *mesh); // false: one line
void sphere_blocks_finish(struct sphere_blocks *blocks);                               // accepts zeroed

// Begins a selection of a range's blocks; `same`: what is kept is still right.
void sphere_blocks_begin(struct sphere_blocks *blocks, const struct sphere_mesh *mesh,
                         const struct sphere_ring_range *range, bool same);
void sphere_blocks_add(struct sphere_blocks *blocks, const struct sphere_mesh *mesh, int part, int sector);

// Transforms, with the program in use, the selected blocks that are not kept; returns how many vertices.
uint64_t sphere_blocks_keep(struct sphere_blocks *blocks, const struct sphere_mesh *mesh);
// Draws the selected blocks from the mesh or from what is kept.
void sphere_blocks_draw(const struct sphere_blocks *blocks, const struct sphere_mesh *mesh, bool kept);

uint64_t sphere_mesh_bytes(const struct sphere_mesh *mesh); // of its vertices
uint64_t sphere_blocks_bytes(const struct sphere_blocks *blocks, const struct sphere_mesh *mesh);

#endif
