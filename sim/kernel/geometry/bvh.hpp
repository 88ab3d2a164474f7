// A tree of boxes over flat convex polygons: which one a ray meets first, and whether a segment is free.
#pragma once
#include <algorithm>
#include <cstdint>
#include <limits>
#include <vector>

#include "geometry/vectors.hpp"

namespace kernel::image {

// A flat polygon of three or four corners; a triangle repeats its last.
struct Flat {
    Vec corner[4];
    Vec normal;
    Vec inward[4];  // unit, in the plane, across the edge from each corner; 0 for an edge of no length
    double slack;   // how far outside its edges a ray may pass and still meet it [m]
};

inline Flat make_flat(const double *corners, double tolerance) {
    Flat flat;
    for (int k = 0; k < 4; ++k) flat.corner[k] = load(corners + 3 * k);
    const Vec diagonal = flat.corner[2] - flat.corner[0];
    const Vec across = cross(diagonal, flat.corner[3] - flat.corner[1]);
    const double length = norm(across);
    flat.normal = (length > 0 ? 1 / length : 0.0) * across;
    for (int k = 0; k < 4; ++k) {
        const Vec edge = flat.corner[(k + 1) % 4] - flat.corner[k];
        const double size = norm(edge);
        flat.inward[k] = (size > 0 ? 1 / size : 0.0) * cross(flat.normal, edge);
    }
    flat.slack = tolerance * norm(diagonal);
    return flat;
}

// Where along the direction the polygon is met; infinite for a miss. Both sides stop a ray.
inline double meet(const Flat &flat, Vec origin, Vec direction) {
    constexpr double miss = std::numeric_limits<double>::infinity();
    const double towards = dot(direction, flat.normal);
    if (!(std::abs(towards) > 1e-15)) return miss;
    const double at = dot(flat.corner[0] - origin, flat.normal) / towards;
    const Vec point = origin + at * direction;
    for (int k = 0; k < 4; ++k)
        if (dot(flat.inward[k], point - flat.corner[k]) < -flat.slack) return miss;
    return at;
}

struct Box {
    Vec low{1e300, 1e300, 1e300}, high{-1e300, -1e300, -1e300};
    // An empty box changes nothing.
    void grow(const Box &box) {
        low = {std::min(low.x, box.low.x), std::min(low.y, box.low.y), std::min(low.z, box.low.z)};
        high = {std::max(high.x, box.high.x), std::max(high.y, box.high.y), std::max(high.z, box.high.z)};
    }
    void grow(Vec p, double margin = 0) {
        const Vec room{margin, margin, margin};
        grow(Box{p - room, p + room});
    }
    double half_area() const {
        const Vec d = high - low;
        return d.x < 0 ? 0.0 : d.x * d.y + d.y * d.z + d.z * d.x;
    }
};

class Bvh {
  public:
    // corners: n polygons of 4 x 3 numbers.
    void build(const double *corners, std::int64_t n, double tolerance = 1e-9) {
        flats_.clear();
        for (std::int64_t i = 0; i < n; ++i) flats_.push_back(make_flat(corners + 12 * i, tolerance));
        std::vector<Box> boxes(n);
        for (std::int64_t i = 0; i < n; ++i)
            for (const Vec &corner : flats_[i].corner) boxes[i].grow(corner, 2 * flats_[i].slack);
        order_.resize(n);
        for (std::int64_t i = 0; i < n; ++i) order_[i] = static_cast<std::int32_t>(i);
        nodes_.clear();
        if (n) split(boxes, 0, static_cast<std::int32_t>(n), 0);
    }

    // Index of the polygon met first beyond `nearest`, or -1; `at` is where. Equal distances: the lower index.
    std::int32_t first_hit(Vec origin, Vec direction, double nearest, double &at) const {
        std::int32_t found = -1;
        at = std::numeric_limits<double>::infinity();
        walk(origin, direction, nearest, at, [&](std::int32_t flat) {
            const double here = meet(flats_[flat], origin, direction);
            if (here > nearest && (here < at || (here == at && flat < found))) {
                at = here;
                found = flat;
            }
            return false;
        });
        return found;
    }

    // True if something stands strictly between two points; touching the ends does not count.
    bool blocked(Vec from, Vec to) const {
        const Vec direction = to - from;
        constexpr double low = 1e-9, high = 1 - 1e-9;
        double limit = high;
        return walk(from, direction, low, limit, [&](std::int32_t flat) {
            const double here = meet(flats_[flat], from, direction);
            return here > low && here < high;
        });
    }

  private:
    struct Node {
        Box box;
        std::int32_t first, count;  // a leaf's polygons in order_; count 0: children are the next node and `first`
    };

    static constexpr int LEAF = 4, BINS = 16, DEPTH = 60;

    std::int32_t split(const std::vector<Box> &boxes, std::int32_t begin, std::int32_t end, int depth) {
        const auto index = static_cast<std::int32_t>(nodes_.size());
        nodes_.push_back({{}, begin, end - begin});
        Box centres;
        for (std::int32_t k = begin; k < end; ++k) {
            nodes_[index].box.grow(boxes[order_[k]]);
            centres.grow(middle(boxes[order_[k]]));
        }
        if (end - begin <= LEAF || depth >= DEPTH) return index;
        const std::int32_t cut = best_cut(boxes, centres, begin, end);
        if (cut == begin || cut == end) return index;
        split(boxes, begin, cut, depth + 1);
        const std::int32_t right = split(boxes, cut, end, depth + 1);
        nodes_[index].first = right;
        nodes_[index].count = 0;
        return index;
    }

    // Reorders begin ... end into two halves where the surface area heuristic is smallest among 16 bins.
    std::int32_t best_cut(const std::vector<Box> &boxes, const Box &centres, std::int32_t begin, std::int32_t end) {
        const Vec size = centres.high - centres.low;
        const int axis = size.x >= size.y && size.x >= size.z ? 0 : size.y >= size.z ? 1 : 2;
        const double low = component(centres.low, axis), extent = component(size, axis);
        if (!(extent > 0)) return begin;
        const auto bin = [&](std::int32_t flat) {
            const double place = (component(middle(boxes[flat]), axis) - low) / extent;
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
        const auto middle_of = std::stable_partition(
            first + begin, first + end, [&](std::int32_t flat) { return bin(flat) <= cut; });
        return static_cast<std::int32_t>(middle_of - first);
    }

    // Visits the polygons of every leaf whose box the ray meets in low ... high, the nearer child first, until
    // visit says true. `high` may shrink on the way.
    template <class Visit>
    bool walk(Vec origin, Vec direction, double low, double &high, Visit visit) const {
        if (nodes_.empty()) return false;
        const Vec inverse{inverted(direction.x), inverted(direction.y), inverted(direction.z)};
        struct Entry {
            std::int32_t index;
            double at;
        } stack[DEPTH + 4];
        int top = 0;
        const auto push = [&](std::int32_t index, double at) {
            // A miss is infinite, and so is `high` before the first hit.
            if (at < high) stack[top++] = {index, at};
        };
        push(0, entry(nodes_[0].box, origin, inverse, low));
        while (top) {
            const Entry next = stack[--top];
            if (next.at >= high) continue;
            const Node &node = nodes_[next.index];
            for (std::int32_t k = 0; k < node.count; ++k)
                if (visit(order_[node.first + k])) return true;
            if (node.count) continue;
            const double left = entry(nodes_[next.index + 1].box, origin, inverse, low);
            const double right = entry(nodes_[node.first].box, origin, inverse, low);
            if (left <= right) push(node.first, right);
            push(next.index + 1, left);
            if (left > right) push(node.first, right);
        }
        return false;
    }

    // Where a ray enters a box, not below `low`; infinite for a miss.
    static double entry(const Box &box, Vec origin, Vec inverse, double low) {
        const double x0 = (box.low.x - origin.x) * inverse.x, x1 = (box.high.x - origin.x) * inverse.x;
        const double y0 = (box.low.y - origin.y) * inverse.y, y1 = (box.high.y - origin.y) * inverse.y;
        const double z0 = (box.low.z - origin.z) * inverse.z, z1 = (box.high.z - origin.z) * inverse.z;
        const double in = std::max(std::max(std::min(x0, x1), std::min(y0, y1)), std::max(std::min(z0, z1), low));
        const double out = std::min(std::max(x0, x1), std::min(std::max(y0, y1), std::max(z0, z1)));
        return in <= out * (1 + 1e-12) ? in : std::numeric_limits<double>::infinity();
    }

    // Never infinite: zero times infinity would be no number.
    static double inverted(double x) { return std::abs(x) > 1e-300 ? 1 / x : 1e300; }
    static double component(Vec v, int axis) { return axis == 0 ? v.x : axis == 1 ? v.y : v.z; }
    static Vec middle(const Box &box) { return 0.5 * (box.low + box.high); }

    std::vector<Flat> flats_;
    std::vector<std::int32_t> order_;
    std::vector<Node> nodes_;
};

}  // namespace kernel::image
