// The clipmap renderer over a sphere (Clasen & Hege 2006): static rings about the viewer, heights by level in
// toroidal textures.
//
// clang-format off
//   sphere_rings     rings, what of them is seen, where a vertex samples       (sections 3, 4.5, 5.1)
//   sphere_levels    windows of heights about the viewer                       (sections 4.1 to 4.3)
//   sphere_colour    the same of colours: shading `own`                        (sections 4.3, 6)
//   sphere_mesh      the rings' buffers, blocks of them, their vertices kept    (sections 3.4, 6.1)
//   sphere           the renderer: GL; clipmap.c hands over to it when the terrain is a sphere
// clang-format on
// SPDX-License-Identifier: MIT
#ifndef CLIPMAP_SPHERE_H
#define CLIPMAP_SPHERE_H

#include "clipmap/sphere_rings.h"
#include "common/renderer.h"

// How a vertex samples its level: one of its triangles, two in the half of a level that is blended with the
// next; or, as published (section 5.2), four texels of one level, or four each of two everywhere.
enum sphere_fetch { SPHERE_FETCH_SURFACE, SPHERE_FETCH_FOUR, SPHERE_FETCH_EIGHT };

struct sphere_choice {
    int n;           // the renderer's quality knob
    bool cull;       // blocks outside the frustum are not drawn
    bool keep;       // transformed vertices, while the eye stands still
    bool rebuild;    // every level is read whole each frame
    uint64_t budget; // texels a frame but the first; UINT64_MAX: no limit
    double texture;  // of heights: sphere_shape_init
    double colours;  // the same of colours, for shading `own`
    enum sphere_fetch fetch;
    enum sphere_form form;
};

struct clipmap_sphere;
struct clipmap_sphere *
clipmap_sphere_create(const struct renderer_desc *desc,
                      const struct sphere_choice *choice); // NULL after one line on stderr
void clipmap_sphere_begin_frame(struct clipmap_sphere *sphere, int frame);
bool clipmap_sphere_update(struct clipmap_sphere *sphere, const struct view *views, int count);
void clipmap_sphere_draw(struct clipmap_sphere *sphere, int view_index, enum render_pass pass);
void clipmap_sphere_stats(const struct clipmap_sphere *sphere, struct renderer_stats *stats);
void clipmap_sphere_destroy(struct clipmap_sphere *sphere); // accepts NULL

#endif
