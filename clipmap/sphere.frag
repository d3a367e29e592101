// The clipmap's own shading over a planet: the colour image out of toroidal textures by level, blended as heights are
// (sphere_colour.h).  Places are found per fragment, from the ray from the planet's centre: nothing that would jump at the
// seam is interpolated (numerics.md, D4).
vec3 surface_normal()
{
    vec3 normal = normalize(cross(dFdx(v_ground), dFdy(v_ground)) + vec3(0.0, 0.0, 1e-30));
    return normal.z < 0.0 ? -normal : normal;
}

#ifdef OWN_COLOUR
uniform sampler2DArray colours;
uniform ivec4 colour_windows[12]; // x, y: slot of the viewer's texel; z: texels of a turn or the size
uniform vec4 colour_grids[12];    // xy: texels per radian; zw: the viewer's fraction of a texel
uniform vec4 colour_levels;       // level of an angle of 1; the finest and the coarsest level; texels on a side
uniform vec2 colour_viewer;       // sine and cosine of the polar angle

vec3 colour_in(int layer, vec2 angles)
{
    vec4 grid = colour_grids[layer];
    ivec4 window = colour_windows[layer];
    int size = int(colour_levels.w);
    vec2 place = angles * grid.xy + grid.zw, corner = floor(place), f = place - corner;
    int x0 = (int(corner.x) + window.x + 2 * window.z) % window.z, x1 = x0 + 1 == window.z ? 0 : x0 + 1;
    int y0 = (int(corner.y) + window.y + 2 * size) % size, y1 = y0 + 1 == size ? 0 : y0 + 1;
    vec3 south = mix(texelFetch(colours, ivec3(x0, y0, layer), 0).rgb, texelFetch(colours, ivec3(x1, y0, layer), 0).rgb, f.x);
    vec3 north = mix(texelFetch(colours, ivec3(x0, y1, layer), 0).rgb, texelFetch(colours, ivec3(x1, y1, layer), 0).rgb, f.x);
    return mix(south, north, f.y);
}

vec3 ground_colour()
{
    vec3 ray = normalize(v_relative + vec3(0.0, 0.0, axes[1].w));
    float across = length(ray.xy), fall = dot(ray.xy, ray.xy) / (1.0 + ray.z); // 1 - cos without a difference
    // As in sphere.vert: stable_angles().
    float a = colour_viewer.x * -ray.y + colour_viewer.y * fall, x = colour_viewer.y * -ray.y + colour_viewer.x * ray.z;
    vec2 angles = vec2(x == 0.0 && ray.x == 0.0 ? 0.0 : atan(ray.x, x), -2.0 * atan(a, colour_viewer.x + length(vec2(x, ray.x))));
    float level = log2(max(atan(across, ray.z), 1e-9)) + colour_levels.x;
    level = clamp(level, colour_levels.y, colour_levels.z);
    int layer = int(floor(level));
    float w = clamp((level - float(layer)) * 2.0 - 1.0, 0.0, 1.0);
    vec3 colour = colour_in(layer, angles);
    return w > 0.0 ? mix(colour, colour_in(layer + 1, angles), w) : colour;
}
#endif
