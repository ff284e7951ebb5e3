// Blinn-Phong with a light at the eye, two-sided.
// Source: Blinn 1977, "Models of light reflection for computer synthesized pictures".
// Twin: isosample/integral/shading.py

// Colour `straight` lit by a white light at the eye; `direction` is the unit ray, `material` is ambient, diffuse,
// specular, shininess. With the light at the eye the half vector is -direction; the sign of the normal is ignored.
vec3 blinn_phong(vec3 straight, vec3 normal, vec3 direction, vec4 material) {
    float cosine = min(abs(dot(normal, direction)), 1.0);
    float highlight = cosine > 0.0 ? pow(cosine, material.w) : 0.0;
    return straight * (material.x + material.y * cosine) + vec3(material.z * highlight);
}
