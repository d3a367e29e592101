// Shading `common`: the normal of the drawn triangle itself, so that a picture shows geometry and nothing else.
vec3 surface_normal()
{
    vec3 normal = cross(dFdx(v_relative), dFdy(v_relative));
    return normal * inversesqrt(max(dot(normal, normal), 1e-30)) * (normal.z < 0.0 ? -1.0 : 1.0);
}
