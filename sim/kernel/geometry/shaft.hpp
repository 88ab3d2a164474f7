// Shaft culling: whether an occluder may stand between two patches, exactly for one that parts them.
#pragma once
#include "geometry/occluder.hpp"

namespace kernel {

enum class Meets { none, some, all };

// A patch's corners on one side of an occluder's plane, with their distances from it.
struct Side {
    int n = 0;
    Vec corner[8];
    double distance[8];
};

// Every segment between the two sides crosses the plane within the convex hull of the points where the
// segments between their corners do; each edge of the occluder may part that hull from the occluder.
inline Meets section(const Occluder &by, const Side &up, const Side &down, double touch) {
    if (!up.n || !down.n) return Meets::none;
    Meets answer = Meets::all;
    for (int e = 0; e < by.n; ++e) {
        double inside_up[8], inside_down[8];
        for (int k = 0; k < up.n; ++k) inside_up[k] = dot(by.edge[e], up.corner[k]) - by.edge_offset[e];
        for (int k = 0; k < down.n; ++k) inside_down[k] = dot(by.edge[e], down.corner[k]) - by.edge_offset[e];
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

// Both sides of a patch that the plane cuts; a patch beside it has corners on one only.
inline void sides(const Occluder &by, const Flat &patch, double touch, Side &up, Side &down) {
    double heights[4], low = 0, high = 0;
    for (int k = 0; k < patch.n; ++k) {
        const double h = height(by, patch.corner[k]);
        heights[k] = std::fabs(h) <= touch ? 0.0 : h;
        low = std::min(low, heights[k]);
        high = std::max(high, heights[k]);
    }
    const auto add = [](Side &side, Vec at, double distance) {
        side.corner[side.n] = at;
        side.distance[side.n++] = distance;
    };
    for (int k = 0; k < patch.n; ++k) {
        const int next = k + 1 < patch.n ? k + 1 : 0;
        const double here = heights[k], after = heights[next];
        if (high > 0 && here >= 0) add(up, patch.corner[k], here);
        if (low < 0 && here <= 0) add(down, patch.corner[k], -here);
        if (here * after < 0) {
            const Vec at = patch.corner[k] + (here / (here - after)) * (patch.corner[next] - patch.corner[k]);
            add(up, at, 0);
            add(down, at, 0);
        }
    }
}

// Where a patch's centre lies: its height over an occluder's plane, and how far inside each of its edges.
struct Seen {
    double over, inside[4];
};

inline Seen seen(const Occluder &by, const Flat &patch) {
    Seen o{height(by, patch.centre), {}};
    for (int e = 0; e < by.n; ++e) o.inside[e] = dot(by.edge[e], patch.centre) - by.edge_offset[e];
    return o;
}

// Quick answer from the patches' spheres: surely both on one side of the plane, or all crossings outside an
// edge. Where a segment crosses is a mean of its ends, weighted by heights that the radii bound.
inline bool apart(int n_edges, const Seen &i, double radius_i, const Seen &j, double radius_j) {
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

inline Meets meets(const Occluder &by, const Flat &i, const Flat &j, double size) {
    const double touch = COPLANAR * size;
    Side i_up, i_down, j_up, j_down;
    sides(by, i, touch, i_up, i_down);
    sides(by, j, touch, j_up, j_down);
    const Meets one = section(by, i_up, j_down, touch), other = section(by, j_up, i_down, touch);
    const bool cut = (i_up.n && i_down.n) || (j_up.n && j_down.n);
    if (one == Meets::none && other == Meets::none) return Meets::none;
    return !cut && (one == Meets::all || other == Meets::all) ? Meets::all : Meets::some;
}

// About where the light between two points passes an occluder's edge: the crossing, pulled into its outline.
inline Vec passage(const Occluder &by, Vec begin, Vec end) {
    const double a = std::fabs(height(by, begin)), b = std::fabs(height(by, end));
    Vec at = begin + (a + b > 0 ? a / (a + b) : 0.5) * (end - begin);
    at = at - height(by, at) * by.normal;
    for (int k = 0; k < by.n; ++k)
        at = at + std::max(0.0, by.edge_offset[k] - dot(by.edge[k], at)) * by.edge[k];
    return at;
}

}  // namespace kernel
