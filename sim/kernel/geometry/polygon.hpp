// Convex polygons that can be cut by planes.
#pragma once
#include <algorithm>
#include <cmath>

#include "geometry/vectors.hpp"

namespace kernel {

constexpr int MAX_CORNERS = 24;  // four, and one more for each of twenty cuts; further ones lose a corner

struct Polygon {
    int n = 0;  // 0: nothing is left
    Vec corner[MAX_CORNERS];

    void add(Vec p) {
        if (n < MAX_CORNERS) corner[n++] = p;
    }
};

// The part with dot(normal, x) >= offset and, if wanted, the rest (Sutherland & Hodgman 1974); heights within snap
// count as 0, and a polygon in the plane as the rest.
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
            above.add(at);
            if (below) below->add(at);
        }
        if (here >= 0) above.add(in.corner[k]);
        if (below && here <= 0) below->add(in.corner[k]);
    }
    if (above.n < 3) above.n = 0;
    if (below && below->n < 3) below->n = 0;
}

inline Polygon part_above(const Polygon &in, Vec normal, double offset, double snap) {
    Polygon above;
    cut(in, normal, offset, snap, above, nullptr);
    return above;
}

}  // namespace kernel
