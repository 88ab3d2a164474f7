// What a surface point sees: the occluders in front of it, cut so that no direction is counted twice.
#pragma once
#include "form_factors/point_factor.hpp"
#include "geometry/tree.hpp"

namespace kernel {

// Most occluders that one view is made of, and most pieces of them; beyond, rays decide. With half of either some views
// of the furnished room are left to rays; with these none.
constexpr int SHARED = 24;
constexpr int FRAGMENTS = 64;

// A convex piece of an occluder seen from the origin, and the planes through the origin and its edges.
struct Cone {
    Polygon piece;
    Vec plane[MAX_CORNERS];  // unit normals, inwards
    Vec normal;              // of the occluder, towards the origin
    double offset;           // dot(normal, x) on the occluder: below 0

    void make_planes() {
        for (int k = 0; k < piece.n; ++k)
            plane[k] = unit(cross(piece.corner[k + 1 < piece.n ? k + 1 : 0], piece.corner[k]));
    }
};

class PointView {
public:
    Vec point, normal;
    bool crowded = false;  // too many pieces: ask rays
    double shift_u = 0.5, shift_v = 0.5;  // of their targets, within a cell
    std::vector<Cone> cones;

    // Other targets for the point of another index: the golden ratio of two dimensions spreads them evenly.
    void shift(int index) {
        shift_u = std::fmod(0.5 + index * 0.7548776662466927, 1.0);
        shift_v = std::fmod(0.5 + index * 0.5698402909980532, 1.0);
    }

    // Of the occluders named, seen from a point of a patch with a normal.
    void look(const Tree &tree, const std::vector<int> &named, Vec from, Vec up) {
        point = from;
        normal = up;
        tolerance = tree.tolerance;
        whole.clear();
        cones.clear();
        crowded = named.size() > SHARED;
        if (crowded) return;
        for (int k : named) add(tree.occluders[k]);
        for (size_t k = 0; k < whole.size() && !crowded; ++k) visible_pieces(k);
    }

    // Unoccluded and blocked factor of a polygon; what lies below its plane or the horizon sees nothing.
    void factors(const FlatPolygon &target, double &free, double &blocked) const {
        free = blocked = 0;
        const double before = height(target, point);
        if (before <= 0) return;
        Polygon seen;
        cut(relative(target, point), normal, 0, tolerance.snap, seen, nullptr);
        if (seen.n < 3) return;
        free = std::max(0.0, point_factor_above({0, 0, 0}, normal, seen));
        const Vec centre = target.centre - point;
        for (const Cone &cone : cones)
            if (!apart(cone, centre, target.radius)) blocked += shadow(cone, target, -before, seen);
    }

private:
    Tolerance tolerance = Tolerance::of(0);
    std::vector<Cone> whole;
    std::vector<Polygon> pieces, next, outside;

    static bool apart(const Cone &cone, Vec centre, double radius) {
        for (int k = 0; k < cone.piece.n; ++k)
            if (dot(cone.plane[k], centre) <= -radius) return true;
        return false;
    }

    void add(const Occluder &by) {
        const double h = height(by, point);
        if (std::fabs(h) <= tolerance.touch) return;
        whole.emplace_back();
        Cone &cone = whole.back();
        cut(relative(by, point), normal, 0, tolerance.snap, cone.piece, nullptr);
        if (cone.piece.n < 3) return whole.pop_back();
        if (h < 0) std::reverse(cone.piece.corner, cone.piece.corner + cone.piece.n);
        cone.normal = h < 0 ? -1.0 * by.normal : by.normal;
        cone.offset = -std::fabs(h);
        cone.make_planes();
    }

    // What of an occluder no nearer one hides.
    void visible_pieces(size_t index) {
        pieces.assign(1, whole[index].piece);
        for (size_t k = 0; k < whole.size() && !pieces.empty(); ++k) {
            if (k == index) continue;
            next.clear();
            for (const Polygon &piece : pieces) subtract(piece, whole[k], k < index);
            pieces.swap(next);
        }
        crowded = cones.size() + pieces.size() > FRAGMENTS;
        if (crowded) return;
        for (const Polygon &piece : pieces) {
            cones.push_back(whole[index]);
            if (pieces.size() == 1 && piece.n == whole[index].piece.n && same(piece, whole[index].piece)) continue;
            cones.back().piece = piece;
            cones.back().make_planes();
        }
    }

    static bool same(const Polygon &a, const Polygon &b) {
        for (int k = 0; k < a.n; ++k)
            if (norm(a.corner[k] - b.corner[k]) > 0) return false;
        return true;
    }

    // Adds to next what of a piece lies outside a nearer occluder's cone or before its plane. Of two in one
    // plane the first hides the second.
    void subtract(const Polygon &piece, const Cone &by, bool first) {
        double low = INFINITY, high = -INFINITY;
        for (int k = 0; k < piece.n; ++k) {
            const double h = dot(by.normal, piece.corner[k]) - by.offset;
            low = std::min(low, h);
            high = std::max(high, h);
        }
        const bool coplanar = low >= -tolerance.touch && high <= tolerance.touch;
        if (coplanar ? !first : low >= -tolerance.snap) return next.push_back(piece);
        outside.clear();
        Polygon rest = piece, kept, off;
        for (int k = 0; k < by.piece.n; ++k) {
            cut(rest, by.plane[k], 0, tolerance.snap, kept, &off);
            if (kept.n < 3) return next.push_back(piece);
            if (off.n >= 3) outside.push_back(off);
            rest = kept;
        }
        if (!coplanar) {
            cut(rest, -1.0 * by.normal, -by.offset, tolerance.snap, kept, &off);
            if (kept.n < 3) return next.push_back(piece);
            if (off.n >= 3) outside.push_back(off);
        }
        next.insert(next.end(), outside.begin(), outside.end());
    }

    // Factor of the part of a target, already cut at the horizon, that a cone's piece before it covers.
    double shadow(const Cone &cone, const FlatPolygon &target, double offset, const Polygon &seen) const {
        double low = INFINITY, high = -INFINITY;
        for (int k = 0; k < cone.piece.n; ++k) {
            const double h = dot(target.normal, cone.piece.corner[k]) - offset;
            low = std::min(low, h);
            high = std::max(high, h);
        }
        if (high <= tolerance.touch) return 0;
        if (low >= -tolerance.touch) return covered(cone, seen);
        Cone before = cone;
        cut(cone.piece, target.normal, offset, tolerance.snap, before.piece, nullptr);
        if (before.piece.n < 3) return 0;
        before.make_planes();
        return covered(before, seen);
    }

    double covered(const Cone &cone, const Polygon &seen) const {
        Polygon buffer[2];
        const Polygon *rest = &seen;
        for (int k = 0; k < cone.piece.n; ++k) {
            Polygon &kept = buffer[k & 1];
            cut(*rest, cone.plane[k], 0, tolerance.snap, kept, nullptr);
            if (kept.n < 3) return 0;
            rest = &kept;
        }
        return std::max(0.0, point_factor_above({0, 0, 0}, normal, *rest));
    }
};

}  // namespace kernel
