// Shaft culling (Haines 1991): whether an occluder may stand between two patches, or two clusters of them.
#pragma once
#include "geometry/occluder.hpp"

namespace kernel {

enum class Meets { none, some, all };

// What a shaft joins: the hull of up to MOST points, 4 of a patch or 8 of a box (small tables are worth a tenth of the
// time). A flat one gives and takes light on its lit side only.
template <int MOST>
struct ShaftEnd {
    int n;
    const Vec *corner;  // of a flat one they go round it
    bool flat;
    Vec normal;
    double offset;
    Vec middle() const {
        Vec sum{0, 0, 0};
        for (int k = 0; k < n; ++k) sum = sum + corner[k];
        return (1.0 / n) * sum;
    }
};

inline ShaftEnd<4> shaft_end(const FlatPolygon &patch) {
    return {patch.n, patch.corner, true, patch.normal, patch.offset};
}

// Where an end's centre lies: its height over an occluder's plane, and how far inside each of its edges.
struct CentreSeen {
    double over, inside[4];
};

inline CentreSeen centre_seen(const Occluder &by, Vec centre) {
    CentreSeen o{height(by, centre), {}};
    for (int e = 0; e < by.n; ++e) o.inside[e] = inside(by, e, centre);
    return o;
}

// Quick answer from the ends' spheres: surely both on one side of the plane, or all crossings outside an
// edge. Where a segment crosses is a mean of its ends, weighted by heights that the radii bound.
inline bool spheres_apart(int n_edges, const CentreSeen &i, double radius_i, const CentreSeen &j, double radius_j) {
    if ((i.over > radius_i && j.over > radius_j) || (i.over < -radius_i && j.over < -radius_j)) return true;
    const double a = std::fabs(i.over), b = std::fabs(j.over);
    double nearest = 0, farthest = 1;  // bounds of the crossing's place from i (0) to j (1)
    if (a > radius_i && b > radius_j) {
        nearest = (a - radius_i) / (a - radius_i + b + radius_j);
        farthest = (a + radius_i) / (a + radius_i + b - radius_j);
    }
    for (int e = 0; e < n_edges; ++e) {
        const double inside_i = i.inside[e] + radius_i, along = j.inside[e] + radius_j - inside_i;
        if (inside_i + nearest * along < 0 && inside_i + farthest * along < 0) return true;
    }
    return false;
}

// An end's part on one side of an occluder's plane: points that span it, with their distances from the plane.
template <int MOST>
struct ShaftSide {
    // The corners, and where segments between corners on different sides cross: half of them on each at worst.
    static constexpr int ALL = MOST + MOST * MOST / 4;
    int n = 0;
    Vec corner[ALL];
    double distance[ALL];
    void add(Vec at, double from_plane) {
        corner[n] = at;
        distance[n++] = from_plane;
    }
};

// Both sides of an end that the plane cuts; an end beside it has points on one only. Returns whether the whole end lies
// beside the plane, but for an edge: of a hull that is not flat, what touches the plane may be patches that lie on it.
template <int MOST>
bool sides(const Occluder &by, const ShaftEnd<MOST> &end, double touch, ShaftSide<MOST> &up, ShaftSide<MOST> &down) {
    double heights[MOST], low = 0, high = 0;
    bool touches = false;
    for (int k = 0; k < end.n; ++k) {
        const double h = height(by, end.corner[k]);
        heights[k] = std::fabs(h) <= touch ? 0.0 : h;
        touches |= heights[k] == 0;
        low = std::min(low, heights[k]);
        high = std::max(high, heights[k]);
    }
    for (int k = 0; k < end.n; ++k) {
        if (high > 0 && heights[k] >= 0) up.add(end.corner[k], heights[k]);
        if (low < 0 && heights[k] <= 0) down.add(end.corner[k], -heights[k]);
        for (int l = 0; l < k && high > 0 && low < 0; ++l) {
            // Of a flat end's corners, which go round it, neighbours are enough.
            const bool spans = !end.flat || l + 1 == k || (l == 0 && k + 1 == end.n);
            if (!spans || !(heights[k] * heights[l] < 0)) continue;
            const double share = heights[k] / (heights[k] - heights[l]);
            const Vec at = end.corner[k] + share * (end.corner[l] - end.corner[k]);
            up.add(at, 0);
            down.add(at, 0);
        }
    }
    return !(low < 0 && high > 0) && (end.flat || !touches);
}

// Every segment between the two sides crosses the plane within the convex hull of the points where the
// segments between their corners do; each edge of the occluder may part that hull from the occluder.
template <int MOST>
Meets section(const Occluder &by, const ShaftSide<MOST> &up, const ShaftSide<MOST> &down, double touch) {
    if (!up.n || !down.n) return Meets::none;
    Meets answer = Meets::all;
    for (int e = 0; e < by.n; ++e) {
        double inside_up[ShaftSide<MOST>::ALL], inside_down[ShaftSide<MOST>::ALL];
        for (int k = 0; k < up.n; ++k) inside_up[k] = inside(by, e, up.corner[k]);
        for (int k = 0; k < down.n; ++k) inside_down[k] = inside(by, e, down.corner[k]);
        bool some_in = false, some_out = false;
        for (int k = 0; k < up.n && !(some_in && some_out); ++k)
            for (int l = 0; l < down.n; ++l) {
                const double share = up.distance[k] + down.distance[l];
                const double at = up.distance[k] * inside_down[l] + down.distance[l] * inside_up[k];
                const bool in_plane = share <= touch;
                some_in |= in_plane ? std::max(inside_up[k], inside_down[l]) > touch : at > touch * share;
                some_out |= in_plane ? std::min(inside_up[k], inside_down[l]) < -touch : at < -touch * share;
            }
        if (!some_in) return Meets::none;
        if (some_out) answer = Meets::some;
    }
    return answer;
}

// All corners lie beyond a plane, or on it: dot(direction, x) >= offset.
inline bool all_beyond(const Vec *corner, int n, Vec direction, double offset) {
    for (int k = 0; k < n; ++k)
        if (dot(direction, corner[k]) < offset) return false;
    return true;
}

// A plane across an axis, a side of the box that is an end, parts the occluder from the shaft.
template <int MOST>
bool box_parts(const Occluder &by, const ShaftEnd<MOST> &from, const ShaftEnd<MOST> &to, double touch) {
    for (int axis = 0; axis < 6; ++axis) {
        const double sign = axis < 3 ? 1 : -1;
        const Vec outwards{axis % 3 == 0 ? sign : 0, axis % 3 == 1 ? sign : 0, axis % 3 == 2 ? sign : 0};
        double lowest = HUGE_VAL;
        for (int k = 0; k < by.n; ++k) lowest = std::min(lowest, dot(outwards, by.corner[k]));
        if (all_beyond(from.corner, from.n, -1.0 * outwards, -lowest - touch) &&
            all_beyond(to.corner, to.n, -1.0 * outwards, -lowest - touch))
            return true;
    }
    return false;
}

// The same for a plane through an edge of a flat end and a corner of the other.
template <int MOST>
bool side_parts(const Occluder &by, const ShaftEnd<MOST> &from, const ShaftEnd<MOST> &to, double touch) {
    if (!from.flat) return box_parts(by, from, to, touch);
    const Vec within = from.middle();
    for (int k = 0; k < from.n; ++k) {
        const Vec begin = from.corner[k], edge = from.corner[k + 1 < from.n ? k + 1 : 0] - begin;
        for (int l = 0; l < to.n; ++l) {
            Vec outwards = cross(edge, to.corner[l] - begin);
            if (dot(outwards, within - begin) > 0) outwards = -1.0 * outwards;
            const double offset = dot(outwards, begin), slack = touch * norm(outwards);
            if (all_beyond(by.corner, by.n, outwards, offset - slack) && slack > touch * touch * norm(edge) &&
                all_beyond(to.corner, to.n, -1.0 * outwards, -offset - slack))
                return true;
        }
    }
    return false;
}

// Nothing before a flat end's plane is hidden by what lies behind it.
template <int MOST>
bool behind(const Occluder &by, const ShaftEnd<MOST> &end, double touch) {
    return end.flat && all_beyond(by.corner, by.n, -1.0 * end.normal, -end.offset - touch);
}

// Whether the occluder stands between no points of the two ends, all, or maybe some. What only touches does not.
template <int MOST>
Meets meets(const Occluder &by, const ShaftEnd<MOST> &i, const ShaftEnd<MOST> &j, Tolerance tolerance) {
    const double touch = tolerance.touch;
    ShaftSide<MOST> i_up, i_down, j_up, j_down;
    const bool beside = sides(by, i, touch, i_up, i_down) & sides(by, j, touch, j_up, j_down);
    const Meets one = section(by, i_up, j_down, touch), other = section(by, j_up, i_down, touch);
    if (one == Meets::none && other == Meets::none) return Meets::none;
    if (beside && (one == Meets::all || other == Meets::all)) return Meets::all;
    return behind(by, i, touch) || behind(by, j, touch) ? Meets::none : Meets::some;
}

// Whether one that may stand between some is parted from the shaft after all, by the shaft's own sides. It takes as
// long as all above: worth it for clusters, of which a clear one saves many pairs, not for single pairs of patches.
template <int MOST>
bool outside(const Occluder &by, const ShaftEnd<MOST> &i, const ShaftEnd<MOST> &j, Tolerance tolerance) {
    // Most do stand between, and there the segment between the middles tells it soonest.
    if (stops(by, i.middle(), j.middle(), tolerance)) return false;
    return side_parts(by, i, j, tolerance.touch) || side_parts(by, j, i, tolerance.touch);
}

// About where the light between two points passes an occluder's edge: the crossing, pulled into its outline.
inline Vec passage(const Occluder &by, Vec begin, Vec end) {
    const double a = std::fabs(height(by, begin)), b = std::fabs(height(by, end));
    Vec at = begin + (a + b > 0 ? a / (a + b) : 0.5) * (end - begin);
    at = at - height(by, at) * by.normal;
    for (int k = 0; k < by.n; ++k) at = at + std::max(0.0, -inside(by, k, at)) * by.edge[k];
    return at;
}

}  // namespace kernel
