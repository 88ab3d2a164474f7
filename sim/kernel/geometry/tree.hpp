// A tree of boxes over occluders: which one a ray meets first, which one stands in a segment's way, and which ones
// may stand in the way of a thick one.
#pragma once
#include <cstdint>
#include <vector>

#include "geometry/box.hpp"
#include "geometry/occluder.hpp"

namespace kernel {

class Interruption;

class Tree {
  public:
    std::vector<Occluder> occluders;  // all that were given; those without area are never met
    Tolerance tolerance;

    // n polygons of 4 x 3 numbers; size: of the surface that they belong to, for the tolerance.
    Tree(const double *corners, std::int64_t n, double size);

    // The polygon met first beyond `nearest`, or -1; `at` is where. Equal distances: the lower index.
    std::int32_t first_hit(Vec origin, Vec direction, double nearest, double &at) const {
        std::int32_t found = -1;
        at = HUGE_VAL;
        walk(origin, direction, tolerance.snap, nearest, at, [&](std::int32_t index) {
            const double here = meet(occluders[index], origin, direction, tolerance);
            if (here > nearest && (here < at || (here == at && index < found))) {
                at = here;
                found = index;
            }
            return false;
        });
        return found;
    }

    // One that stands between two points, or -1.
    std::int32_t blocker(Vec begin, Vec end) const {
        std::int32_t found = -1;
        // What is met nearer to an end is touched by it.
        const double low = tolerance.touch / norm(end - begin);
        double high = 1 - low;
        walk(begin, end - begin, tolerance.snap, low, high, [&](std::int32_t index) {
            if (stops(occluders[index], begin, end, tolerance)) found = index;
            return found >= 0;
        });
        return found;
    }

    // Calls visit(index) for each in a leaf whose box, grown by radius, the segment meets, until visit returns true;
    // returns whether one did.
    template <class Visit>
    bool along(Vec begin, Vec end, double radius, const Visit &visit) const {
        double high = BEYOND_END;
        return walk(begin, end - begin, radius + tolerance.touch, 0, high, visit);
    }

    struct Node {
        Box box;
        std::int32_t first, count;  // a leaf's polygons in order(); count 0: children are the next node and `first`
    };
    const std::vector<Node> &nodes() const { return nodes_; }
    const std::vector<std::int32_t> &order() const { return order_; }

  private:

    // A leaf's most polygons. With 4, pairs past a box take 1.15 times as long, and pictures of meshes as long.
    static constexpr int LEAF = 8;
    static constexpr int BINS = 16;   // finer ones make no better trees (Wald 2007)
    static constexpr int DEPTH = 60;  // deeper only by many equal boxes; the stack holds one entry a level
    static constexpr double BEYOND_END = 1 + 1e-9;  // of a segment: a box that it only ends on is met

    std::int32_t split(const std::vector<Box> &boxes, std::int32_t begin, std::int32_t end, int depth,
                       Interruption &interruption);

    // Reorders begin ... end into two halves where the surface area heuristic is smallest among the bins.
    std::int32_t best_cut(const std::vector<Box> &boxes, const Box &centres, std::int32_t begin, std::int32_t end) {
        const int axis = centres.longest_axis();
        const double low = component(centres.low, axis), extent = component(centres.high, axis) - low;
        if (!(extent > 0)) return begin;
        const auto bin = [&](std::int32_t index) {
            const double place = (component(boxes[index].middle(), axis) - low) / extent;
            return std::min(BINS - 1, static_cast<int>(place * BINS));
        };
        Box box[BINS];
        int count[BINS] = {};
        for (std::int32_t k = begin; k < end; ++k) {
            box[bin(order_[k])].grow(boxes[order_[k]]);
            ++count[bin(order_[k])];
        }
        double cost[BINS] = {};
        Box left, right;
        for (int k = 0, n = 0; k < BINS - 1; ++k) {
            left.grow(box[k]);
            cost[k] += (n += count[k]) * left.half_area();
        }
        for (int k = BINS - 1, n = 0; k > 0; --k) {
            right.grow(box[k]);
            cost[k - 1] += (n += count[k]) * right.half_area();
        }
        const int cut = static_cast<int>(std::min_element(cost, cost + BINS - 1) - cost);
        const auto first = order_.begin();
        const auto middle =
            std::stable_partition(first + begin, first + end, [&](std::int32_t index) { return bin(index) <= cut; });
        return static_cast<std::int32_t>(middle - first);
    }

    // Visits the polygons of every leaf whose box, grown by radius, the ray meets in low ... high, the nearer child
    // first, until visit says true. `high` may shrink on the way.
    template <class Visit>
    bool walk(Vec origin, Vec direction, double radius, double low, double &high, const Visit &visit) const {
        if (nodes_.empty()) return false;
        const Vec room{radius, radius, radius};
        const Slabs slabs{origin + room, origin - room,
                          {inverted(direction.x), inverted(direction.y), inverted(direction.z)}};
        struct Entry {
            std::int32_t index;
            double at;
        } stack[DEPTH + 4];
        int top = 0;
        const auto push = [&](std::int32_t index, double at) {
            // A miss is infinite, and so is `high` before the first hit.
            if (at < high) stack[top++] = {index, at};
        };
        push(0, slabs.entry(nodes_[0].box, low));
        while (top) {
            const Entry next = stack[--top];
            if (next.at >= high) continue;
            const Node &node = nodes_[next.index];
            for (std::int32_t k = 0; k < node.count; ++k)
                if (visit(order_[node.first + k])) return true;
            if (node.count) continue;
            const double left = slabs.entry(nodes_[next.index + 1].box, low);
            const double right = slabs.entry(nodes_[node.first].box, low);
            if (left <= right) push(node.first, right);
            push(next.index + 1, left);
            if (left > right) push(node.first, right);
        }
        return false;
    }

    // A ray against boxes grown by a radius: growing a box is moving the ray.
    struct Slabs {
        Vec from_low, from_high, inverse;

        // Where the ray enters, not below `low`; infinite for a miss.
        double entry(const Box &box, double low) const {
            const double x0 = (box.low.x - from_low.x) * inverse.x, x1 = (box.high.x - from_high.x) * inverse.x;
            const double y0 = (box.low.y - from_low.y) * inverse.y, y1 = (box.high.y - from_high.y) * inverse.y;
            const double z0 = (box.low.z - from_low.z) * inverse.z, z1 = (box.high.z - from_high.z) * inverse.z;
            const double in = std::max(std::max(std::min(x0, x1), std::min(y0, y1)), std::max(std::min(z0, z1), low));
            const double out = std::min(std::max(x0, x1), std::min(std::max(y0, y1), std::max(z0, z1)));
            return in <= out * (1 + 1e-12) ? in : HUGE_VAL;
        }
    };

    // Never infinite: zero times infinity would be no number.
    static double inverted(double x) { return std::fabs(x) > 1e-300 ? 1 / x : 1e300; }

    std::vector<std::int32_t> order_;
    std::vector<Node> nodes_;
};

}  // namespace kernel
