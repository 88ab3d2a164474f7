// Boxes along the axes that hold points.
#pragma once
#include <algorithm>
#include <cstdint>

#include "geometry/vectors.hpp"

namespace kernel {

struct Box {
    Vec low{1e300, 1e300, 1e300}, high{-1e300, -1e300, -1e300};  // empty: grows by nothing, and by it nothing grows

    void grow(const Box &box) {
        low = {std::min(low.x, box.low.x), std::min(low.y, box.low.y), std::min(low.z, box.low.z)};
        high = {std::max(high.x, box.high.x), std::max(high.y, box.high.y), std::max(high.z, box.high.z)};
    }
    void grow(Vec p) { grow(Box{p, p}); }

    Vec middle() const { return 0.5 * (low + high); }
    double diagonal() const { return high.x < low.x ? 0.0 : norm(high - low); }
    double half_area() const {
        const Vec d = high - low;
        return d.x < 0 ? 0.0 : d.x * d.y + d.y * d.z + d.z * d.x;
    }
    int longest_axis() const {
        const Vec d = high - low;
        return d.x >= d.y && d.x >= d.z ? 0 : d.y >= d.z ? 1 : 2;
    }
};

// Of n points of 3 numbers.
inline Box box_of(const double *points, std::int64_t n) {
    Box box;
    for (std::int64_t k = 0; k < n; ++k) box.grow(load(points + 3 * k));
    return box;
}

}  // namespace kernel
