// What stands in the light: flat convex polygons with their planes, and cuts that leave no slivers.
#pragma once
#include <algorithm>
#include <cmath>
#include <vector>

#include "geometry/polygon.hpp"

namespace kernel {

// Relative to the scene's size. Below SNAP a corner counts as lying on the plane that cuts; below COPLANAR
// a patch lies on an occluder, which then never shades it. Vertices stored as float32 are flat to 4e-8.
constexpr double SNAP = 1e-12, COPLANAR = 1e-7;

struct Flat {
    int n = 0;
    Vec corner[4];
    Vec normal;
    double offset;  // dot(normal, x) on the plane
    Vec centre;
    double radius;  // of the sphere about the centre that holds every corner
};

struct Occluder : Flat {
    Vec edge[4];  // unit normals in the plane, inwards, of the edge that begins at corner k
    double edge_offset[4];
};

inline double height(const Flat &over, Vec x) { return dot(over.normal, x) - over.offset; }

inline Vec unit(Vec a) {
    const double length = norm(a);
    return length > 0 ? (1 / length) * a : a;
}

// Four corners, a triangle's last repeated; corners that fall together are counted once.
inline Flat flat(const double *corners) {
    Flat out;
    for (int k = 0; k < 4; ++k) {
        const Vec here = load(corners + 3 * k);
        if (out.n && norm(here - out.corner[out.n - 1]) == 0) continue;
        if (k == 3 && norm(here - out.corner[0]) == 0) continue;
        out.corner[out.n++] = here;
    }
    Vec area = {0, 0, 0}, sum = {0, 0, 0};
    for (int k = 0; k < out.n; ++k) {
        area = area + cross(out.corner[k] - out.corner[0], out.corner[(k + 1) % out.n] - out.corner[0]);
        sum = sum + out.corner[k];
    }
    out.normal = unit(area);
    out.centre = (1.0 / std::max(out.n, 1)) * sum;
    out.offset = dot(out.normal, out.centre);
    out.radius = 0;
    for (int k = 0; k < out.n; ++k) out.radius = std::max(out.radius, norm(out.corner[k] - out.centre));
    return out;
}

inline Occluder occluder(const double *corners) {
    Occluder out;
    static_cast<Flat &>(out) = flat(corners);
    for (int k = 0; k < out.n; ++k) {
        out.edge[k] = unit(cross(out.normal, out.corner[(k + 1) % out.n] - out.corner[k]));
        out.edge_offset[k] = dot(out.edge[k], out.corner[k]);
    }
    return out;
}

// The part with dot(normal, x) >= offset and, if wanted, the rest; heights within snap count as 0.
inline void cut(const Polygon &in, Vec normal, double offset, double snap, Polygon &above, Polygon *below) {
    double heights[MAX_CORNERS];
    bool some_above = false, some_below = false;
    for (int k = 0; k < in.n; ++k) {
        const double h = dot(normal, in.corner[k]) - offset;
        heights[k] = std::fabs(h) <= snap ? 0.0 : h;
        some_above |= heights[k] > 0;
        some_below |= heights[k] < 0;
    }
    above.n = 0;
    if (below) below->n = 0;
    if (!some_below || !some_above) {
        Polygon *whole = some_above ? &above : below;
        if (!whole) return;
        whole->n = in.n;
        std::copy(in.corner, in.corner + in.n, whole->corner);
        return;
    }
    for (int k = 0, last = in.n - 1; k < in.n; last = k++) {
        const double before = heights[last], here = heights[k];
        if ((before < 0 && here > 0) || (before > 0 && here < 0)) {
            const Vec at = in.corner[last] + (before / (before - here)) * (in.corner[k] - in.corner[last]);
            if (above.n < MAX_CORNERS) above.corner[above.n++] = at;
            if (below && below->n < MAX_CORNERS) below->corner[below->n++] = at;
        }
        if (here >= 0 && above.n < MAX_CORNERS) above.corner[above.n++] = in.corner[k];
        if (below && here <= 0 && below->n < MAX_CORNERS) below->corner[below->n++] = in.corner[k];
    }
}

// A flat polygon seen from an origin.
inline Polygon relative(const Flat &flat, Vec origin) {
    Polygon out;
    out.n = flat.n;
    for (int k = 0; k < flat.n; ++k) out.corner[k] = flat.corner[k] - origin;
    return out;
}

}  // namespace kernel
