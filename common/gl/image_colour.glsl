// The scene's colour image, draped from edge to edge of the map's outline; its first row is the north edge.  OWN_COLOUR:
// the renderer drapes it itself, and defines ground_colour().
#ifndef OWN_COLOUR
uniform sampler2D colour_image;

#ifdef SPHERE
// Longitude goes on from 1 to 0 at the 180th meridian: the gradient takes the shorter way (numerics.md, D4).
vec3 ground_colour()
{
    const float PI = 3.14159265;
    vec3 ray = v_relative + vec3(0.0, 0.0, axes[1].w);
    vec3 world = ray.x * axes[0].xyz + ray.y * axes[1].xyz + ray.z * axes[2].xyz;
    float across = length(world.xy);
    vec2 place = vec2(across > 0.0 ? atan(world.y, world.x) / (2.0 * PI) + 0.5 : 0.0, 0.5 - atan(world.z, across) / PI);
    vec2 along = dFdx(place), up = dFdy(place);
    along.x -= round(along.x);
    up.x -= round(up.x);
    return textureGrad(colour_image, place, along, up).rgb;
}
#else
vec3 ground_colour()
{
    return texture(colour_image, vec2(v_ground.x - outline.x, outline.w - v_ground.y) / (outline.zw - outline.xy)).rgb;
}
#endif
#endif
