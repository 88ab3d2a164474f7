// Outer points: Gauss nodes on a patch, cut first where occluders stand on it, since its view jumps there.
#pragma once
#include "geometry/tree.hpp"

namespace kernel {

constexpr int MOST_PARTS = 16;  // of one patch; further contact lines are left to the Gauss points

struct OuterRule {
    int n;
    const double *node, *weight;  // on [0, 1]
};

struct OuterPoint {
    Vec at;
    double weight;  // sums to the patch's area
};

// Whether the line in which an occluder meets a patch's plane passes through the patch.
inline bool touches(const Occluder &by, const FlatPolygon &patch, double touch) {
    double low = INFINITY, high = -INFINITY, heights[4];
    for (int k = 0; k < by.n; ++k) {
        heights[k] = height(patch, by.corner[k]);
        low = std::min(low, heights[k]);
        high = std::max(high, heights[k]);
    }
    if (low > touch || high < touch) return false;
    Polygon line;
    for (int k = 0; k < by.n; ++k) {
        const int next = k + 1 < by.n ? k + 1 : 0;
        if (std::fabs(heights[k]) <= touch) line.corner[line.n++] = by.corner[k];
        else if (std::fabs(heights[next]) > touch && heights[k] * heights[next] < 0)
            line.corner[line.n++] =
                by.corner[k] + (heights[k] / (heights[k] - heights[next])) * (by.corner[next] - by.corner[k]);
    }
    if (line.n < 2) return false;
    Vec begin = line.corner[0], end = line.corner[1];
    for (int k = 0; k < patch.n; ++k) {
        const Vec inwards = cross(patch.normal, patch.corner[k + 1 < patch.n ? k + 1 : 0] - patch.corner[k]);
        const double a = dot(inwards, begin - patch.corner[k]), b = dot(inwards, end - patch.corner[k]);
        if (a <= 0 && b <= 0) return false;
        if (a * b >= 0) continue;
        const Vec at = begin + (a / (a - b)) * (end - begin);
        (a < 0 ? begin : end) = at;
    }
    return norm(end - begin) > touch;
}

inline std::vector<Polygon> parts(const FlatPolygon &patch, const Tree &tree) {
    std::vector<Polygon> out{relative(patch, {0, 0, 0})}, next;
    const auto split = [&](std::int32_t k) {
        const Occluder &by = tree.occluders[k];
        if (out.size() * 2 > MOST_PARTS || !touches(by, patch, tree.tolerance.touch)) return false;
        next.clear();
        for (const Polygon &part : out) {
            Polygon above, below;
            cut(part, by.normal, by.offset, tree.tolerance.touch, above, &below);
            if (above.n >= 3) next.push_back(above);
            if (below.n >= 3) next.push_back(below);
        }
        out.swap(next);
        return false;
    };
    tree.along(patch.centre, patch.centre, patch.radius, split);
    return out;
}

// A convex polygon as a fan of quadrilaterals (the last may be a triangle), each the image of the square.
inline void add_points(const Polygon &part, const OuterRule &rule, std::vector<OuterPoint> &out) {
    for (int k = 1; k + 1 < part.n; k += 2) {
        const Vec a = part.corner[0], b = part.corner[k], c = part.corner[k + 1];
        const Vec d = k + 2 < part.n ? part.corner[k + 2] : c;
        for (int s = 0; s < rule.n; ++s)
            for (int t = 0; t < rule.n; ++t) {
                const double u = rule.node[s], v = rule.node[t];
                const Vec along_u = (1 - v) * (b - a) + v * (c - d), along_v = (1 - u) * (d - a) + u * (c - b);
                const double area = norm(cross(along_u, along_v));
                const Vec at = a + u * (b - a) + v * (d - a) + (u * v) * (a - b + (c - d));
                out.push_back({at, rule.weight[s] * rule.weight[t] * area});
            }
    }
}

}  // namespace kernel
