// The roofline: a plain matrix vertex program over one float3 vertex buffer.
layout(location = 0) in vec3 position;

vec3 relative_position()
{
    return position;
}
