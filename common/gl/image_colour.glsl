// The scene's colour image, draped from edge to edge of the map's outline; its first row is the north edge.  OWN_COLOUR:
// the renderer drapes it itself, and defines ground_colour().
#ifndef OWN_COLOUR
uniform sampler2D colour_image;

vec3 ground_colour()
{
    return texture(colour_image, vec2(v_ground.x - outline.x, outline.w - v_ground.y) / (outline.zw - outline.xy)).rgb;
}
#endif
