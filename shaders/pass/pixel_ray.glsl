// The ray of a pixel, and what the box and the clip planes leave of it. Expects `frame`.

// A place (w = 1) or a direction (w = 0) in the box's own frame.
vec3 unit_from_local(vec3 local, float w) {
    return vec3(dot(frame.unit_row_x.xyz, local) + w * frame.unit_row_x.w,
                dot(frame.unit_row_y.xyz, local) + w * frame.unit_row_y.w,
                dot(frame.unit_row_z.xyz, local) + w * frame.unit_row_z.w);
}

// Distances at which a ray enters and leaves the box; empty if x >= y.
vec2 box_of_ray(vec3 origin, vec3 direction) {
    return box_interval(unit_from_local(origin, 1.0), unit_from_local(direction, 0.0));
}

// Way from the image's middle to a pixel: on the plane at distance 1 (perspective), or in the window.
vec3 pixel_offset(ivec2 pixel) {
    vec2 plane = image_plane_position(pixel, frame.image_size);
    return plane.x * frame.span_right + plane.y * frame.span_up;
}

// What of the distances `shown` is on the kept side of every clip plane; ends before it begins where nothing is.
//   The loop ends with its condition, and its counter is no index as it is: else Mesa unrolls it to all the planes that there is
// room for, and software renderers execute that for every ray, also where there are none.
vec2 cut_by_planes(vec2 shown, vec3 origin, vec3 direction) {
    int i = 0;
    do {
        vec4 plane = frame.clip_planes[min(i, MAX_CLIP_PLANES - 1)];
        float at_origin = dot(plane.xyz, origin) + plane.w;
        float along = dot(plane.xyz, direction);
        float cut = -at_origin / along;
        bool counts = i < frame.clip_plane_count;
        if (counts && along == 0.0 && at_origin < 0.0) shown.y = -1e30;
        if (counts && along > 0.0) shown.x = max(shown.x, cut);
        if (counts && along < 0.0) shown.y = min(shown.y, cut);
        ++i;
    } while (i < frame.clip_plane_count);
    return shown;
}
