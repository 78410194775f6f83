// The sphere on a square, every texel with the same solid angle (Clarberg 2008, Fast Equal-Area Mapping of the
// (Hemi)Sphere using SIMD).

// Place in [0, 1]^2 of a unit direction; `extent` is how far an ellipse around it with the half axes `first` and
// `second`, both at right angles to it, reaches along the square's sides to first order.
vec2 octahedral_place(vec3 direction, vec3 first, vec3 second, out vec2 extent) {
    vec3 magnitude = abs(direction);
    precise float radius = sqrt(max(0.0, 1.0 - magnitude.z));
    float larger = max(magnitude.x, magnitude.y);
    float smaller = min(magnitude.x, magnitude.y);
    precise float turn = larger > 0.0 ? atan(smaller / larger) * 0.636619772 : 0.0; // of a right angle
    if (magnitude.x < magnitude.y) turn = 1.0 - turn;
    precise vec2 place = vec2(radius - turn * radius, turn * radius);

    // Derivatives of radius and turn along both axes.
    float kept_radius = max(radius, 0.01);
    vec2 sides = vec2(direction.x < 0.0 ? -1.0 : 1.0, direction.y < 0.0 ? -1.0 : 1.0);
    float towards_z = direction.z < 0.0 ? 0.5 : -0.5;
    vec2 outward = vec2(first.z, second.z) * (towards_z / kept_radius);
    float across2 = max(1.0 - direction.z * direction.z, 2e-4);
    vec2 around = sides.x * sides.y
                * (direction.x * vec2(first.y, second.y) - direction.y * vec2(first.x, second.x))
                * (0.636619772 / across2) * kept_radius;
    vec2 along_x = outward * (1.0 - turn) - around;
    vec2 along_y = outward * turn + around;
    precise vec2 reach = sqrt(vec2(dot(along_x, along_x), dot(along_y, along_y)));
    if (direction.z < 0.0) {
        place = 1.0 - place.yx;
        reach = reach.yx;
    }
    extent = 0.5 * reach;
    return 0.5 + 0.5 * mix(place, -place, lessThan(direction.xy, vec2(0.0)));
}

// Unit direction of a place in [0, 1]^2.
vec3 octahedral_direction(vec2 place) {
    place = 2.0 * place - 1.0;
    vec2 size = abs(place);
    float beyond = 1.0 - size.x - size.y; // negative in the lower half
    float radius = 1.0 - abs(beyond);
    // Angle from the diagonal, at most an eighth of a turn: its sine and cosine by their series, to 4e-6.
    float angle = (size.y - size.x) / max(radius, 1e-6) * 0.785398163;
    float angle2 = angle * angle;
    float sine = angle * (1.0 - angle2 * (1.0 / 6.0 - angle2 * (1.0 / 120.0 - angle2 / 5040.0)));
    float cosine = 1.0 - angle2 * (0.5 - angle2 * (1.0 / 24.0 - angle2 / 720.0));
    float across = radius * sqrt(max(0.0, 1.0 - 0.5 * radius * radius)); // over the root of 2
    vec2 flat_ = vec2(cosine - sine, cosine + sine) * across;
    float height = 1.0 - radius * radius;
    return vec3(place.x < 0.0 ? -flat_.x : flat_.x, place.y < 0.0 ? -flat_.y : flat_.y, beyond < 0.0 ? -height : height);
}

// A cell that may lie up to a side beyond an edge, where the sphere goes on.
ivec2 octahedral_cell(ivec2 cell, int side) {
    if (cell.x < 0 || cell.x >= side) cell = ivec2((cell.x < 0 ? -1 : 2 * side - 1) - cell.x, side - 1 - cell.y);
    if (cell.y < 0 || cell.y >= side) cell = ivec2(side - 1 - cell.x, (cell.y < 0 ? -1 : 2 * side - 1) - cell.y);
    return cell;
}
