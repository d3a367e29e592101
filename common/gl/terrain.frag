// The one fragment program: a height ramp with Lambert shading, or the position itself, or depth alone.  Two pieces before
// it say what is shaded: `float cosine_to(vec3 direction)` of the surface's normal (face_normal.glsl; a renderer's own brings
// `vec3 surface_normal()`, unit) and `vec3 ground_colour()` (height_colour.glsl or image_colour.glsl).  A renderer that lights its ground itself defines OWN_LIGHT
// and `vec3 lit_ground()` in place of the normal.
#if defined(PASS_SHADED)
layout(location = 0) out vec4 colour;

// Light where the cosine between the ground's normal and the sun is this, at least 0.
vec3 sunlight(float cosine)
{
    return vec3(0.30, 0.35, 0.44) + vec3(1.05, 0.99, 0.88) * cosine;
}

#ifndef OWN_LIGHT
#ifdef SHADING_OWN
float cosine_to(vec3 direction)
{
    return dot(surface_normal(), direction);
}
#endif

vec3 to_sun()
{
#ifdef SPHERE
    // North-west turns about a pole.  So the light comes from over one place of the planet (30 N, 70 W): as low as on the
    // plane at a quarter turn from it, higher towards it and its antipode, and even everywhere.
    const vec3 sun = 0.82 * vec3(0.296, -0.814, 0.5);
    vec2 level = vec2(dot(axes[0].xyz, sun), dot(axes[1].xyz, sun));
    return vec3(level, sqrt(1.0 - dot(level, level)));
#else
    return vec3(-0.58, 0.58, 0.57); // north-west, 35 degrees high
#endif
}

vec3 lit_ground()
{
    return ground_colour() * sunlight(max(cosine_to(to_sun()), 0.0));
}
#endif

void main()
{
    // Derivatives come before the discard: they need the neighbours that it would take away.
    vec3 lit = lit_ground();
    if (outside_map()) discard;
    colour = vec4(lit, 1.0);
}
#elif defined(PASS_POSITION)
flat in vec4 v_corners[3]; // side.geom
flat in vec2 v_screen[3];
flat in vec3 v_altitude;
flat in int v_side;
layout(location = 0) out vec4 position_and_side;

// sqrt(2) steps of the sub-pixel grid: a corner moves by half a step along each axis, and the distance to an edge is
// interpolated between corners that moved as far.
const float SNAP_PX = 1.4142136 / 256.0;

float cross_2d(vec2 a, vec2 b)
{
    return a.x * b.y - a.y * b.x;
}

// Barycentric coordinates of the pixel's centre in the picture; not finite in a triangle of no area.
vec3 weights()
{
    vec2 a = v_screen[0] - gl_FragCoord.xy, b = v_screen[1] - gl_FragCoord.xy, c = v_screen[2] - gl_FragCoord.xy;
    return vec3(cross_2d(b, c), cross_2d(c, a), cross_2d(a, b)) / cross_2d(v_screen[1] - v_screen[0], v_screen[2] - v_screen[0]);
}

// Of the triangle's outline in the picture, the point nearest to the pixel's centre; in space.
vec3 nearest_point_of_outline()
{
    float least = 1e30;
    vec4 nearest = v_corners[0];
    for (int i = 0; i < 3; i++) {
        int j = (i + 1) % 3;
        vec2 edge = v_screen[j] - v_screen[i], from = gl_FragCoord.xy - v_screen[i];
        float t = clamp(dot(from, edge) / max(dot(edge, edge), 1e-30), 0.0, 1.0);
        vec2 apart = from - t * edge;
        if (dot(apart, apart) >= least) continue;
        least = dot(apart, apart);
        float weight_i = (1.0 - t) * v_corners[j].w, weight_j = t * v_corners[i].w; // the nearer corner weighs more
        nearest.xyz = (weight_i * v_corners[i].xyz + weight_j * v_corners[j].xyz) / (weight_i + weight_j);
    }
    return nearest.xyz;
}

void main()
{
    if (outside_map()) discard;
    vec3 weight = weights(), inside_px = weight * v_altitude;
    float least_px = min(inside_px.x, min(inside_px.y, inside_px.z));
    bool below = v_side == NEAR_BACK || (v_side == BACK && least_px > SNAP_PX);
    // Snapping never leads a whole pixel out; triangles so large or thin that rounding does are left as they are, and so
    // are points at a horizon whose nearest one lies beyond the map.
    bool outside = (v_side == FRONT || v_side == BACK) && least_px < 0.0 && least_px > -1.0;
    vec3 drawn = v_relative;
    if (outside) {
        vec3 nearest = nearest_point_of_outline();
        if (!outside_map(in_reliefs(nearest))) drawn = nearest;
    }
    position_and_side = vec4(drawn, below ? -1.0 : 1.0);
}
#else
void main()
{
    if (outside_map()) discard;
}
#endif
