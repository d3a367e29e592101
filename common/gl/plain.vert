// Camera-relative vertices as they are; instances are moved by an offset where one is given.
layout(location = 0) in vec3 position;
layout(location = 1) in vec3 offset; // (0, 0, 0) unless the attribute is enabled

vec3 relative_position()
{
    return position + offset;
}
