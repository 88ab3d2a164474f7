// Flat polygons of three or four corners: patches, and what stands in their light.
#pragma once
#include "geometry/polygon.hpp"
#include "geometry/tolerance.hpp"

namespace kernel {

struct FlatPolygon {
    int n = 0;
    Vec corner[4];
    Vec normal{0, 0, 0};  // unit; 0 for a polygon without area
    double offset = 0;    // dot(normal, x) on the plane
    Vec centre{0, 0, 0};
    double radius = 0;    // of the sphere about the centre that holds every corner
};

struct Occluder : FlatPolygon {
    Vec edge[4];  // unit normals in the plane, inwards, of the edge that begins at corner k
    double edge_offset[4];
};

inline double height(const FlatPolygon &over, Vec x) { return dot(over.normal, x) - over.offset; }

// How far inside the edge k a place is.
inline double inside(const Occluder &by, int k, Vec x) { return dot(by.edge[k], x) - by.edge_offset[k]; }

// Of the area between four corners, a triangle's last repeated.
inline Vec centroid(const double *corners) {
    const Vec a = load(corners), b = load(corners + 3), c = load(corners + 6), d = load(corners + 9);
    const double first = norm(cross(b - a, c - a)), second = norm(cross(c - a, d - a));
    const double all = 3 * (first + second);
    return all > 0 ? (first / all) * (a + b + c) + (second / all) * (a + c + d) : a;
}

// Four corners, a triangle's last repeated; corners that fall together are counted once.
inline FlatPolygon flat_polygon(const double *corners) {
    FlatPolygon out;
    Vec sum = {0, 0, 0};
    for (int k = 0; k < 4; ++k) {
        const Vec here = load(corners + 3 * k);
        if (out.n && norm(here - out.corner[out.n - 1]) == 0) continue;
        if (k == 3 && norm(here - out.corner[0]) == 0) continue;
        out.corner[out.n++] = here;
        sum = sum + here;
    }
    // Twice the area is the cross product of the diagonals, or of a triangle's sides.
    if (out.n > 2) out.normal = unit(cross(out.corner[2] - out.corner[0], out.corner[out.n - 1] - out.corner[1]));
    out.centre = (1.0 / std::max(out.n, 1)) * sum;
    out.offset = dot(out.normal, out.centre);
    for (int k = 0; k < out.n; ++k) out.radius = std::max(out.radius, norm(out.corner[k] - out.centre));
    return out;
}

inline Occluder occluder(const double *corners) {
    Occluder out{flat_polygon(corners), {}, {}};
    for (int k = 0; k < out.n; ++k) {
        out.edge[k] = unit(cross(out.normal, out.corner[(k + 1) % out.n] - out.corner[k]));
        out.edge_offset[k] = dot(out.edge[k], out.corner[k]);
    }
    return out;
}

inline bool has_area(const FlatPolygon &polygon) { return norm(polygon.normal) > 0; }

// With corners seen from an origin.
inline Polygon relative(const FlatPolygon &polygon, Vec origin) {
    Polygon out;
    out.n = polygon.n;
    for (int k = 0; k < polygon.n; ++k) out.corner[k] = polygon.corner[k] - origin;
    return out;
}

// A place in its plane lies in the polygon; its edges belong to it, so that no light leaks between two that meet.
inline bool holds(const Occluder &by, Vec at, double snap) {
    for (int k = 0; k < by.n; ++k)
        if (inside(by, k, at) < -snap) return false;
    return true;
}

// The polygon stands between two points; one that an end lies on does not.
inline bool stops(const Occluder &by, Vec begin, Vec end, Tolerance tolerance) {
    const double a = height(by, begin), b = height(by, end);
    if (a * b >= 0 || std::min(std::fabs(a), std::fabs(b)) <= tolerance.touch) return false;
    return holds(by, begin + (a / (a - b)) * (end - begin), tolerance.snap);
}

// Where along the direction a ray meets the polygon, from either side; infinite for a miss. One along the plane misses.
inline double meet(const Occluder &by, Vec origin, Vec direction, Tolerance tolerance) {
    const double towards = dot(direction, by.normal);
    if (!(std::fabs(towards) > 1e-15)) return HUGE_VAL;
    const double at = dot(by.corner[0] - origin, by.normal) / towards;
    return holds(by, origin + at * direction, tolerance.snap) ? at : HUGE_VAL;
}

}  // namespace kernel
