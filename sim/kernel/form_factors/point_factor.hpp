// The exact factor from a surface point to a convex polygon (Lambert 1760).
#pragma once
#include "geometry/polygon.hpp"
#include "transcendental.hpp"

namespace kernel {

// Factor from a point at p with a unit normal to a polygon that lies wholly above its horizon and whose lit
// side looks at p: Lambert's formula, 1/(2 pi) sum of angle_k (g_k . normal). Below 0 if it looks away.
inline double point_factor_above(Vec p, Vec normal, const Polygon &polygon) {
    double sum = 0;
    Vec a = polygon.corner[polygon.n - 1] - p;
    for (int k = 0; k < polygon.n; ++k) {
        const Vec b = polygon.corner[k] - p;
        const Vec g = cross(b, a);
        const double length = norm(g);
        // Full accuracy for small and for nearly straight angles, where acos has none.
        if (length > 0) sum += angle_between(length, dot(a, b)) * dot(g, normal) / length;
        a = b;
    }
    return sum / (2 * PI);
}

// The same for any convex polygon: what lies below the horizon of p is cut off.
inline double point_factor(Vec p, Vec normal, const Polygon &polygon) {
    const double offset = dot(normal, p);
    bool below = false;
    for (int k = 0; k < polygon.n; ++k) below |= dot(normal, polygon.corner[k]) < offset;
    if (!below) return point_factor_above(p, normal, polygon);
    const Polygon above = part_above(polygon, normal, offset, 0);
    return above.n ? point_factor_above(p, normal, above) : 0.0;
}

}  // namespace kernel
