// How the cluster tree is cut, and what bounds its clusters.
#include "compressed/cluster_tree.hpp"

#include <algorithm>
#include <map>

namespace kernel::compressed {
namespace {

class Builder {
   public:
    Builder(const Geometry &geometry, int leaf_size)
        : g_(geometry), leaf_size_(leaf_size), touch_(Tolerance::of(geometry.size()).touch) {}

    ClusterTree build() {
        tree_.order.resize(g_.n);
        for (int i = 0; i < g_.n; ++i) tree_.order[i] = i;
        split(0, g_.n);
        return std::move(tree_);
    }

   private:
    const Geometry &g_;
    const int leaf_size_;
    const double touch_;
    ClusterTree tree_;

    int split(int begin, int end) {
        const int index = static_cast<int>(tree_.clusters.size());
        tree_.clusters.push_back(describe(begin, end));
        if (end - begin <= leaf_size_) return index;
        const int middle = one_region(begin, end) ? cut_patches(begin, end) : cut_regions(begin, end);
        const int first = split(begin, middle), second = split(middle, end);
        tree_.clusters[index].child[0] = first;
        tree_.clusters[index].child[1] = second;
        return index;
    }

    bool one_region(int begin, int end) const {
        for (int k = begin; k < end; ++k)
            if (g_.region[tree_.order[k]] != g_.region[tree_.order[begin]]) return false;
        return true;
    }

    // Cut at the middle of the longest extent, so that grids stay grids; at the median where that is lopsided.
    int cut_patches(int begin, int end) {
        Box box;
        for (int k = begin; k < end; ++k) box.grow(g_.centre(tree_.order[k]));
        const int axis = box.longest_axis();
        const double at = 0.5 * (component(box.low, axis) + component(box.high, axis));
        const auto first = tree_.order.begin() + begin, last = tree_.order.begin() + end;
        const auto key = [&](int patch) { return component(g_.centre(patch), axis); };
        const auto middle = std::stable_partition(first, last, [&](int patch) { return key(patch) < at; });
        const int left = static_cast<int>(middle - first), total = end - begin;
        if (std::min(left, total - left) >= total / 8 + 1) return begin + left;
        std::stable_sort(first, last, [&](int a, int b) { return key(a) < key(b); });
        return begin + total / 2;
    }

    // Part whole regions, ordered along the longest extent of their centres, about in half.
    int cut_regions(int begin, int end) {
        std::map<std::int64_t, std::pair<Box, int>> regions;
        for (int k = begin; k < end; ++k) {
            auto &[box, count] = regions[g_.region[tree_.order[k]]];
            box.grow(g_.centre(tree_.order[k])), ++count;
        }
        Box centres;
        for (const auto &[id, r] : regions) centres.grow(r.first.middle());
        const int axis = centres.longest_axis();
        std::map<std::int64_t, double> key;
        for (const auto &[id, r] : regions) key[id] = component(r.first.low, axis) + component(r.first.high, axis);
        const auto first = tree_.order.begin() + begin, last = tree_.order.begin() + end;
        std::stable_sort(first, last, [&](int a, int b) {
            const auto ra = g_.region[a], rb = g_.region[b];
            return std::pair(key[ra], ra) < std::pair(key[rb], rb);
        });
        int best = begin + regions[g_.region[tree_.order[begin]]].second;
        for (int k = best; k < end; k += regions[g_.region[tree_.order[k]]].second)
            if (std::abs(2 * k - begin - end) < std::abs(2 * best - begin - end)) best = k;
        return best;
    }

    Cluster describe(int begin, int end) const {
        Cluster c;
        c.begin = begin, c.end = end;
        Box box;
        for (int k = begin; k < end; ++k) {
            c.area += g_.areas[tree_.order[k]];
            for (int v = 0; v < 4; ++v) box.grow(g_.corner(tree_.order[k], v));
        }
        c.low = box.low, c.high = box.high;
        set_plane(c);
        set_hull(c);
        c.middle = 0.5 * (c.low + c.high);
        for (const Vec &p : c.hull) c.radius = std::max(c.radius, norm(p - c.middle));
        return c;
    }

    void set_plane(Cluster &c) const {
        const int first = tree_.order[c.begin];
        c.normal = load(g_.normals + 3 * first);
        c.offset = dot(c.normal, g_.corner(first, 0));
        c.flat = true;
        for (int k = c.begin; k < c.end && c.flat; ++k) {
            const int patch = tree_.order[k];
            c.flat = dot(load(g_.normals + 3 * patch), c.normal) > 0;
            for (int v = 0; v < 4; ++v) c.flat &= std::abs(dot(c.normal, g_.corner(patch, v)) - c.offset) <= touch_;
        }
    }

    void set_hull(Cluster &c) const {
        if (!c.flat) {
            for (int k = 0; k < 8; ++k)
                c.hull.push_back({k & 1 ? c.high.x : c.low.x, k & 2 ? c.high.y : c.low.y, k & 4 ? c.high.z : c.low.z});
            return;
        }
        const int first = tree_.order[c.begin];
        const Vec edge = g_.corner(first, 1) - g_.corner(first, 0);
        const Vec u = (1 / norm(edge)) * edge, v = cross(c.normal, u), origin = g_.corner(first, 0);
        double u0 = 0, u1 = 0, v0 = 0, v1 = 0;
        for (int k = c.begin; k < c.end; ++k)
            for (int corner = 0; corner < 4; ++corner) {
                const Vec p = g_.corner(tree_.order[k], corner) - origin;
                u0 = std::min(u0, dot(p, u)), u1 = std::max(u1, dot(p, u));
                v0 = std::min(v0, dot(p, v)), v1 = std::max(v1, dot(p, v));
            }
        for (auto [s, t] : {std::pair(u0, v0), {u1, v0}, {u1, v1}, {u0, v1}})
            c.hull.push_back(origin + s * u + t * v);
    }
};

}  // namespace

ClusterTree build_cluster_tree(const Geometry &geometry, int leaf_size) { return Builder(geometry, leaf_size).build(); }

double distance_of(const Cluster &a, const Cluster &b) {
    const Vec before = a.low - b.high, after = b.low - a.high;
    const Vec gap{std::max({0.0, before.x, after.x}), std::max({0.0, before.y, after.y}),
                  std::max({0.0, before.z, after.z})};
    return std::max(norm(gap), norm(a.middle - b.middle) - a.radius - b.radius);
}

}  // namespace kernel::compressed
