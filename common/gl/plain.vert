// Camera-relative vertices as they are.
layout(location = 0) in vec3 position;

vec3 relative_position()
{
    return position;
}
