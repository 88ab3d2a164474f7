#include "compressed/shaft.hpp"

#include <algorithm>

namespace kernel::compressed {
namespace {

struct Range {
    double low = 1e300, high = -1e300;
    void add(double x) { low = std::min(low, x), high = std::max(high, x); }
};

Range range_of(const Vec *points, std::size_t n, Vec direction) {
    Range r;
    for (std::size_t k = 0; k < n; ++k) r.add(dot(direction, points[k]));
    return r;
}

Range both(const Cluster &a, const Cluster &b, Vec direction) {
    Range r = range_of(a.hull.data(), a.hull.size(), direction);
    const Range s = range_of(b.hull.data(), b.hull.size(), direction);
    r.add(s.low), r.add(s.high);
    return r;
}

// A direction parts the occluder from the clusters' common hull.
bool parts(const Cluster &a, const Cluster &b, const Occluder &o, Vec direction, double tolerance) {
    const Range shaft = both(a, b, direction), other = range_of(o.corner, o.n, direction);
    const double slack = tolerance * norm(direction);
    return other.low >= shaft.high - slack || other.high <= shaft.low + slack;
}

// Planes through an edge of one flat cluster and a corner of the other: the sides of the shaft.
bool side_parts(const Cluster &a, const Cluster &b, const Occluder &o, double tolerance) {
    const std::size_t n = a.hull.size();
    if (n != 4) return false;
    for (std::size_t k = 0; k < n; ++k) {
        const Vec edge = a.hull[(k + 1) % n] - a.hull[k];
        for (const Vec &p : b.hull) {
            const Vec direction = cross(edge, p - a.hull[k]);
            if (norm(direction) > tolerance * norm(edge) && parts(a, b, o, direction, tolerance)) return true;
        }
    }
    return false;
}

bool may_stand_between(const Cluster &a, const Cluster &b, const Occluder &o, double tolerance) {
    for (Vec axis : {Vec{1, 0, 0}, Vec{0, 1, 0}, Vec{0, 0, 1}, o.normal})
        if (parts(a, b, o, axis, tolerance)) return false;
    if (a.flat && parts(a, b, o, a.normal, tolerance)) return false;
    if (b.flat && parts(a, b, o, b.normal, tolerance)) return false;
    // Behind the plane of either cluster nothing hides what lies before it.
    const auto behind = [&](const Cluster &c) {
        return c.flat && range_of(o.corner, o.n, c.normal).high <= c.offset + tolerance;
    };
    if (behind(a) || behind(b)) return false;
    return !side_parts(a, b, o, tolerance) && !side_parts(b, a, o, tolerance);
}

// For a convex polygon, if every segment between hull corners crosses it, so does every other segment.
bool hides(const Cluster &a, const Cluster &b, const Occluder &o, double tolerance) {
    for (const Vec &p : a.hull)
        for (const Vec &q : b.hull)
            if (!crosses(o, p, q, tolerance)) return false;
    return true;
}

}  // namespace

Occluder make_occluder(const double *corners) {
    Occluder o;
    for (int k = 0; k < 4; ++k) {
        const Vec p = load(corners + 3 * k);
        if (k == 0 || (norm(p - o.corner[o.n - 1]) > 0 && norm(p - o.corner[0]) > 0)) o.corner[o.n++] = p;
    }
    Vec twice_area{0, 0, 0};
    for (int k = 1; k + 1 < o.n; ++k)
        twice_area = twice_area + cross(o.corner[k] - o.corner[0], o.corner[k + 1] - o.corner[0]);
    o.normal = (1 / std::max(norm(twice_area), 1e-300)) * twice_area;
    o.offset = dot(o.normal, o.corner[0]);
    for (int k = 0; k < o.n; ++k) {
        const Vec inward = cross(o.normal, o.corner[(k + 1) % o.n] - o.corner[k]);
        o.inward[k] = (1 / norm(inward)) * inward;
        o.inward_offset[k] = dot(o.inward[k], o.corner[k]);
    }
    return o;
}

View look(const Cluster &a, const Cluster &b, const std::vector<Occluder> &occluders, const std::vector<int> &given,
          double tolerance, std::vector<int> &kept) {
    kept.clear();
    for (int index : given) {
        if (!may_stand_between(a, b, occluders[index], tolerance)) continue;
        if (hides(a, b, occluders[index], tolerance)) return View::blocked;
        kept.push_back(index);
    }
    return kept.empty() ? View::clear : View::mixed;
}

bool facing(const Cluster &a, const Cluster &b, double tolerance) {
    const auto before = [tolerance](const Cluster &c, const Cluster &other) {
        return !c.flat || range_of(other.hull.data(), other.hull.size(), c.normal).high > c.offset + tolerance;
    };
    return before(a, b) && before(b, a);
}

}  // namespace kernel::compressed
