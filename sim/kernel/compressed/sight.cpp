// Occluders between two clusters, by their shaft.
#include "compressed/sight.hpp"

#include <algorithm>

namespace kernel::compressed {
namespace {

ShaftEnd<8> shaft_end(const Cluster &c) {
    return {static_cast<int>(c.hull.size()), c.hull.data(), c.flat, c.normal, c.offset};
}

}  // namespace

Sight sight(const Cluster &a, const Cluster &b, const std::vector<Occluder> &occluders, const std::vector<int> &given,
            Tolerance tolerance, std::vector<int> &kept) {
    const ShaftEnd<8> from = shaft_end(a), to = shaft_end(b);
    kept.clear();
    for (int index : given) {
        const Occluder &by = occluders[index];
        if (spheres_apart(by.n, centre_seen(by, a.middle), a.radius, centre_seen(by, b.middle), b.radius)) continue;
        const Meets answer = meets(by, from, to, tolerance);
        if (answer == Meets::all) return Sight::blocked;
        if (answer == Meets::some && !outside(by, from, to, tolerance)) kept.push_back(index);
    }
    return kept.empty() ? Sight::clear : Sight::mixed;
}

bool facing(const Cluster &a, const Cluster &b, Tolerance tolerance) {
    const auto before = [tolerance](const Cluster &c, const Cluster &other) {
        return !c.flat || std::any_of(other.hull.begin(), other.hull.end(), [&](Vec p) {
            return dot(c.normal, p) > c.offset + tolerance.touch;
        });
    };
    return before(a, b) && before(b, a);
}

}  // namespace kernel::compressed
