// What can stand between two clusters: planes that part the occluder from their common hull (Haines 1991).
#pragma once
#include <vector>

#include "compressed/cluster_tree.hpp"

namespace kernel::compressed {

struct Occluder {
    int n = 0;  // corners
    Vec corner[4];
    Vec normal{0, 0, 0};
    double offset = 0;
    Vec inward[4];  // inside: dot(inward[k], x) > inward_offset[k] for every edge
    double inward_offset[4];
};

Occluder make_occluder(const double *corners);

// True if the open segment crosses the polygon; one that ends in its plane does not. [tolerance: length]
inline bool crosses(const Occluder &o, Vec a, Vec b, double tolerance) {
    const double begin = dot(o.normal, a) - o.offset, end = dot(o.normal, b) - o.offset;
    if (!((begin > tolerance && end < -tolerance) || (begin < -tolerance && end > tolerance))) return false;
    const Vec at = a + (begin / (begin - end)) * (b - a);
    for (int k = 0; k < o.n; ++k)
        if (dot(o.inward[k], at) <= o.inward_offset[k]) return false;
    return true;
}

enum class View { clear, mixed, blocked };

// Keep the occluders, of those given, that may stand between a and b; `blocked` if one hides all of b from a.
View look(const Cluster &a, const Cluster &b, const std::vector<Occluder> &occluders, const std::vector<int> &given,
          double tolerance, std::vector<int> &kept);

// False if no point of one can lie before the plane of the other.
bool facing(const Cluster &a, const Cluster &b, double tolerance);

}  // namespace kernel::compressed
