// The clipmap's own shading: normal maps, blended between levels with the alpha of the geometry (Losasso & Hoppe 2004,
// section 6.3).  MIPMAP: the level's own map alone, the hardware choosing its resolution, to compare.  REACH: how far from
// its centre a filter may read, in lengths of a pixel's footprint; without it, filters are bilinear.
//
// A map is a torus: beyond the samples in memory the other side begins.  Nothing is read from beyond the active region: the
// place is held between the centres of its outermost texels, where a bilinear filter reads the region alone, and where a
// wider one might read beyond, a plain sampler of the same map takes over, no coarser than there is room for.  (Shrinking
// the gradients would not do: llvmpipe's anisotropic filter takes its own.)
in float v_alpha;

uniform sampler2D fine_normals, coarse_normals; // of this level and of the next coarser one
uniform sampler2D fine_plain, coarse_plain;     // the same, never anisotropic
uniform vec4 fine_place, coarse_place;          // texture coordinates: relative place * xy + zw
uniform vec4 fine_inside, coarse_inside;        // texture coordinates of the outermost texels' centres: low, high

vec2 normal_from(sampler2D map, sampler2D plain, vec4 place, vec4 inside, vec4 across)
{
    vec2 at = clamp(v_relative.xy * place.xy + place.zw, inside.xy, inside.zw);
#ifdef REACH
    vec4 gradient = across * place.xyxy;
    vec2 size = vec2(textureSize(map, 0)), rooms = min(at - inside.xy, inside.zw - at) * size;
    float footprint = dot(abs(gradient), size.xyxy); // texels; no axis of the ellipse is longer, nor is the way to a neighbour
    float room = min(rooms.x, rooms.y) - footprint;
    if (room < REACH * footprint) return textureLod(plain, at, log2(max(room / REACH, 1.0))).xy;
    return textureGrad(map, at, gradient.xy, gradient.zw).xy;
#else
    return textureLod(map, at, 0.0).xy;
#endif
}

vec3 surface_normal()
{
    vec4 across = vec4(dFdx(v_relative.xy), dFdy(v_relative.xy));
    vec2 normal = normal_from(fine_normals, fine_plain, fine_place, fine_inside, across);
#ifndef MIPMAP
    if (v_alpha > 0.0)
        normal += (normal_from(coarse_normals, coarse_plain, coarse_place, coarse_inside, across) - normal) * min(v_alpha, 1.0);
#endif
    return vec3(normal, sqrt(max(1.0 - dot(normal, normal), 0.0)));
}
