// Shadows of occluders, cut out of a polygon as seen from a point.
#include "compressed/hidden.hpp"

#include <algorithm>

namespace kernel::compressed {
namespace {

struct Plane {
    Vec normal;
    double offset;
};

// The planes that bound the shadow of an occluder for light from p; none if p lies in its plane.
int shadow_of(const Occluder &by, Vec p, double touch, Plane planes[5]) {
    const double over = height(by, p);
    if (std::fabs(over) <= touch) return 0;
    const double side = over > 0 ? -1 : 1;
    planes[0] = {side * by.normal, side * by.offset + touch};
    for (int k = 0; k < by.n; ++k) {
        const Vec normal = unit(cross(by.corner[k] - p, by.corner[(k + 1) % by.n] - p));
        const double sign = dot(normal, by.edge[k]) > 0 ? 1 : -1;
        planes[k + 1] = {sign * normal, sign * dot(normal, p)};
    }
    return by.n + 1;
}

void cut_out(std::vector<Polygon> &pieces, const Plane *planes, int n, double snap) {
    std::vector<Polygon> left;
    Polygon inside, outside;
    for (Polygon &piece : pieces)
        for (int k = 0; k < n && piece.n > 0; ++k) {
            cut(piece, planes[k].normal, planes[k].offset, snap, inside, &outside);
            if (outside.n > 0) left.push_back(outside);
            piece = inside;
        }
    pieces = std::move(left);
}

}  // namespace

double visible_factor(Vec p, Vec normal, const Polygon &polygon, const std::vector<Occluder> &occluders,
                      const std::vector<int> &candidates, Tolerance tolerance) {
    std::vector<Polygon> pieces{polygon};
    for (int index : candidates) {
        Plane planes[5];
        const int n = shadow_of(occluders[index], p, tolerance.touch, planes);
        if (n > 0) cut_out(pieces, planes, n, tolerance.snap);
    }
    double sum = 0;
    for (const Polygon &piece : pieces) sum += std::max(point_factor(p, normal, piece), 0.0);
    return sum;
}

double clearance(const Vec corner[4], Vec normal, const std::vector<Occluder> &occluders,
                 const std::vector<int> &candidates, Tolerance tolerance) {
    double smallest = HUGE_VAL;
    const double offset = dot(normal, corner[0]), touch = tolerance.touch;
    for (int index : candidates) {
        Polygon above = part_above(relative(occluders[index], {0, 0, 0}), normal, offset - touch, tolerance.snap);
        for (int k = 0; k < 4; ++k) {
            const Vec inward = unit(cross(normal, corner[(k + 1) % 4] - corner[k]));
            if (norm(inward) > 0) above = part_above(above, inward, dot(inward, corner[k]) + touch, tolerance.snap);
        }
        for (int k = 0; k < above.n; ++k) smallest = std::min(smallest, dot(normal, above.corner[k]) - offset);
    }
    return smallest;
}

}  // namespace kernel::compressed
