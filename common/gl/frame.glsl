// Shared by every vertex and fragment program: the frame's uniforms and the exact way from grid to camera-relative metres.
layout(std140) uniform frame {
    mat4 clip_from_relative; // reversed depth: z = near, w = depth
    vec4 outline;            // exact outline of the map relative to the eye: x_min, y_min, x_max, y_max, in reliefs
    vec4 height;             // x: eye height in quanta, integer part; y: its fraction; z: metres per quantum
    vec4 shade;              // x: lowest height of the map relative to the eye, reliefs; y: reliefs per metre; z, w: the view's width and height in pixels
    vec4 axes[3];            // xyz: east, north and up at the eye, in the world; axes[0].w: 1 / the eye's distance from a sphere's centre, 0 on the plane; axes[1].w: that distance
};

// Height in quanta (an integer, or a blend of integers) to metres relative to the eye.
float relative_height(float quanta)
{
    return ((quanta - height.x) - height.y) * height.z;
}

// Grid index relative to floor(eye / g), the eye's fraction of a cell, the spacing: metres relative to the
// eye.  One rounding of the difference and one of the product, so shared vertices agree bitwise (numerics.md, B2).
vec2 relative_place(vec2 cell, vec2 fraction, vec2 spacing)
{
    return (cell - fraction) * spacing;
}

// A relief is the map's highest less its lowest height (1 m on a flat map).  Fragments get their place in reliefs, x and y
// from the eye, z from the lowest height, so that normals and colour need nothing else.
vec3 in_reliefs(vec3 relative)
{
    float z = relative.z;
#ifdef SPHERE
    // Height over the eye's, without the difference of two large distances from the centre.
    float rise = 2.0 * z + dot(relative, relative) * axes[0].w;
    z = rise / (1.0 + sqrt(max(1.0 + rise * axes[0].w, 0.0)));
#endif
    return vec3(relative.xy * shade.y, z * shade.y - shade.x);
}

// Which side of a triangle the eye is on (side.geom to terrain.frag).
const int FRONT = 0, BACK = 1, NEAR_FRONT = 2, NEAR_BACK = 3;
