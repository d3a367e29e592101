// The scene's colour image, draped from edge to edge of the map's outline; its first row is the north edge.  OWN_COLOUR:
// the renderer drapes it itself, and defines ground_colour().
#ifndef OWN_COLOUR
uniform sampler2D colour_image;

#ifdef SPHERE
// The level follows from the pixel's size on the ground, whatever the longitudes are that it spans: the image's kernels
// are round there (planet_image.h).  Nothing jumps at the 180th meridian (numerics.md, D4).
vec3 ground_colour()
{
    const float PI = 3.14159265;
    vec3 ray = v_relative + vec3(0.0, 0.0, axes[1].w), up = normalize(ray);
    vec3 world = ray.x * axes[0].xyz + ray.y * axes[1].xyz + ray.z * axes[2].xyz;
    float across = length(world.xy);
    vec2 place = vec2(across > 0.0 ? atan(world.y, world.x) / (2.0 * PI) + 0.5 : 0.0, 0.5 - atan(world.z, across) / PI);
    vec3 right = dFdx(v_relative), above = dFdy(v_relative);
    float angle = max(length(right - up * dot(up, right)), length(above - up * dot(up, above))) / length(ray);
    vec2 size = vec2(textureSize(colour_image, 0));
    return textureLod(colour_image, place, log2(max(angle * max(size.x / 2.0, size.y) / PI, 1e-9))).rgb;
}
#else
vec3 ground_colour()
{
    return texture(colour_image, vec2(v_ground.x - outline.x, outline.w - v_ground.y) / (outline.zw - outline.xy)).rgb;
}
#endif
#endif
