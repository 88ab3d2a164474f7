// What can stand between two clusters: the shaft culler handed down the cluster tree.
#pragma once
#include <vector>

#include "compressed/cluster_tree.hpp"
#include "geometry/shaft.hpp"

namespace kernel::compressed {

enum class Sight { clear, mixed, blocked };

// Keep the occluders, of those given, that may stand between a and b; `blocked` if one hides all of b from a.
Sight sight(const Cluster &a, const Cluster &b, const std::vector<Occluder> &occluders, const std::vector<int> &given,
            Tolerance tolerance, std::vector<int> &kept);

// False if no point of one can lie before the plane of the other.
bool facing(const Cluster &a, const Cluster &b, Tolerance tolerance);

}  // namespace kernel::compressed
