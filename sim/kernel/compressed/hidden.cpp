#include "compressed/hidden.hpp"

#include <algorithm>
#include <limits>

namespace kernel::compressed {
namespace {

struct Plane {
    Vec normal;
    double offset;
};

Polygon polygon_of(const Occluder &o) {
    Polygon polygon;
    polygon.n = o.n;
    std::copy(o.corner, o.corner + o.n, polygon.corner);
    return polygon;
}

// The planes that bound the shadow of an occluder for light from p; none if p lies in its plane.
int shadow_of(const Occluder &o, Vec p, double tolerance, Plane planes[5]) {
    const double height = dot(o.normal, p) - o.offset;
    if (std::abs(height) <= tolerance) return 0;
    const double side = height > 0 ? -1 : 1;
    planes[0] = {side * o.normal, side * o.offset + tolerance};
    for (int k = 0; k < o.n; ++k) {
        const Vec normal = cross(o.corner[k] - p, o.corner[(k + 1) % o.n] - p);
        const double sign = dot(normal, o.inward[k]) > 0 ? 1 : -1;
        planes[k + 1] = {sign * normal, sign * dot(normal, p)};
    }
    return o.n + 1;
}

void cut_out(std::vector<Polygon> &pieces, const Plane *planes, int n) {
    std::vector<Polygon> left;
    for (Polygon piece : pieces) {
        for (int k = 0; k < n && piece.n > 0; ++k) {
            const Polygon outside = clip(piece, -1.0 * planes[k].normal, -planes[k].offset);
            piece = clip(piece, planes[k].normal, planes[k].offset);
            if (outside.n > 0) left.push_back(outside);
        }
    }
    pieces = std::move(left);
}

}  // namespace

double visible_factor(Vec p, Vec normal, const Polygon &polygon, const std::vector<Occluder> &occluders,
                      const std::vector<int> &candidates, double tolerance) {
    std::vector<Polygon> pieces{polygon};
    for (int index : candidates) {
        Plane planes[5];
        const int n = shadow_of(occluders[index], p, tolerance, planes);
        if (n > 0) cut_out(pieces, planes, n);
    }
    double sum = 0;
    for (const Polygon &piece : pieces) sum += std::max(point_factor(p, normal, piece), 0.0);
    return sum;
}

double clearance(const Vec corner[4], Vec normal, const std::vector<Occluder> &occluders,
                 const std::vector<int> &candidates, double tolerance) {
    double smallest = std::numeric_limits<double>::infinity();
    const double offset = dot(normal, corner[0]);
    for (int index : candidates) {
        Polygon above = clip(polygon_of(occluders[index]), normal, offset - tolerance);
        for (int k = 0; k < 4; ++k) {
            const Vec inward = cross(normal, corner[(k + 1) % 4] - corner[k]);
            if (norm(inward) > 0) above = clip(above, inward, dot(inward, corner[k]) + tolerance * norm(inward));
        }
        for (int k = 0; k < above.n; ++k) smallest = std::min(smallest, dot(normal, above.corner[k]) - offset);
    }
    return smallest;
}

}  // namespace kernel::compressed
