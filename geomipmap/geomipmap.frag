// The tiler's own shading: a light map made from the terrain and, where the scene has one, a colour image, both cut along
// the map blocks (Brodersen 2005, section 5) and combined by one of OpenGL's operators.  BLEND 0: modulate; 1: add; 2:
// replace, the colour alone.  COLOUR: there is an image.
#define OWN_LIGHT

uniform sampler2D block_light;
uniform vec4 light_place; // texture coordinates: relative place * xy + zw
#ifdef COLOUR
uniform sampler2D block_colour;
uniform vec4 colour_place;
#endif

vec3 sunlight(float cosine);

vec3 lit_ground()
{
#ifdef COLOUR
    vec3 ground = texture(block_colour, v_relative.xy * colour_place.xy + colour_place.zw).rgb;
#else
    vec3 ground = ground_colour();
#endif
    vec3 light = sunlight(texture(block_light, v_relative.xy * light_place.xy + light_place.zw).r);
#if BLEND == 0
    return ground * light;
#elif BLEND == 1
    return ground + light - 1.0;
#else
    return ground;
#endif
}
