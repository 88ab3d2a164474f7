// Occluders in a tree of boxes: which of them a segment, or a thick one, may meet.
#pragma once
#include <numeric>

#include "geometry/occluder.hpp"

namespace kernel {

constexpr int LEAF = 8;

class Tree {
public:
    std::vector<Occluder> occluders;  // in the order of the leaves
    double size = 0;                  // of what they are tested against, for the tolerances

    Tree(const double *corners, int count, double scene_size) : size(scene_size) {
        std::vector<Occluder> given;
        for (int k = 0; k < count; ++k) {
            given.push_back(occluder(corners + 12 * k));
            if (given.back().n < 3 || norm(given.back().normal) == 0) given.pop_back();
        }
        std::vector<int> order(given.size());
        std::iota(order.begin(), order.end(), 0);
        if (!given.empty()) build(given, order, 0, static_cast<int>(given.size()));
        for (int k : order) occluders.push_back(given[k]);
    }

    // Calls visit(index) for each occluder in a leaf whose box, grown by radius, the segment meets, until
    // visit returns true; returns whether one did.
    template <class Visit>
    bool along(Vec begin, Vec end, double radius, Visit visit) const {
        if (nodes.empty()) return false;
        int stack[64], depth = 0;
        stack[depth++] = 0;
        const double d[3] = {end.x - begin.x, end.y - begin.y, end.z - begin.z};
        double inverse[3];
        for (int k = 0; k < 3; ++k) inverse[k] = 1 / (d[k] != 0 ? d[k] : 1e-300);
        while (depth) {
            const Node &node = nodes[stack[--depth]];
            if (!node.meets(begin, inverse, radius + COPLANAR * size)) continue;
            if (node.count) {
                for (int k = node.first; k < node.first + node.count; ++k)
                    if (visit(k)) return true;
            } else {
                stack[depth++] = node.first + 1;
                stack[depth++] = node.first;
            }
        }
        return false;
    }

    // An occluder that stands between two points, or -1; one that an end point lies on does not.
    int blocker(Vec begin, Vec end) const {
        int found = -1;
        along(begin, end, 0, [&](int k) {
            if (stops(k, begin, end)) found = k;
            return found >= 0;
        });
        return found;
    }

    bool stops(int index, Vec begin, Vec end) const {
        const Occluder &by = occluders[index];
        const double a = height(by, begin), b = height(by, end), touch = COPLANAR * size;
        if (a * b >= 0 || std::min(std::fabs(a), std::fabs(b)) <= touch) return false;
        const Vec at = begin + (a / (a - b)) * (end - begin);
        for (int k = 0; k < by.n; ++k)
            if (dot(by.edge[k], at) - by.edge_offset[k] < -SNAP * size) return false;
        return true;
    }

private:
    struct Node {
        double low[3], high[3];
        int first, count;  // of the occluders of a leaf; else the first child's index and 0

        bool meets(Vec begin, const double *inverse, double radius) const {
            const double from[3] = {begin.x, begin.y, begin.z};
            double enter = 0, leave = 1;
            for (int k = 0; k < 3; ++k) {
                const double a = (low[k] - radius - from[k]) * inverse[k];
                const double b = (high[k] + radius - from[k]) * inverse[k];
                enter = std::max(enter, std::min(a, b));
                leave = std::min(leave, std::max(a, b));
            }
            return enter <= leave;
        }
    };
    std::vector<Node> nodes;

    static Node around(const std::vector<Occluder> &given, const std::vector<int> &order, int first, int count) {
        Node node{{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}, first, count};
        for (int k = first; k < first + count; ++k)
            for (int c = 0; c < given[order[k]].n; ++c) {
                const Vec at = given[order[k]].corner[c];
                const double x[3] = {at.x, at.y, at.z};
                for (int axis = 0; axis < 3; ++axis) {
                    node.low[axis] = std::min(node.low[axis], x[axis]);
                    node.high[axis] = std::max(node.high[axis], x[axis]);
                }
            }
        return node;
    }

    // Halves by the centres along the longest side; equal centres by index, so that the tree is one.
    void build(const std::vector<Occluder> &given, std::vector<int> &order, int first, int count) {
        nodes.push_back(around(given, order, first, count));
        std::vector<int> open{0};
        while (!open.empty()) {
            const int here = open.back();
            open.pop_back();
            const Node node = nodes[here];
            if (node.count <= LEAF) continue;
            int axis = 0;
            for (int k = 1; k < 3; ++k)
                if (node.high[k] - node.low[k] > node.high[axis] - node.low[axis]) axis = k;
            const auto place = [&](int k) { return axis == 0 ? given[k].centre.x : axis == 1 ? given[k].centre.y : given[k].centre.z; };
            const auto begin = order.begin() + node.first, middle = begin + node.count / 2;
            std::nth_element(begin, middle, begin + node.count, [&](int a, int b) {
                return place(a) < place(b) || (place(a) == place(b) && a < b);
            });
            nodes[here].first = static_cast<int>(nodes.size());
            nodes[here].count = 0;
            open.push_back(nodes[here].first);
            open.push_back(nodes[here].first + 1);
            nodes.push_back(around(given, order, node.first, node.count / 2));
            nodes.push_back(around(given, order, node.first + node.count / 2, node.count - node.count / 2));
        }
    }
};

}  // namespace kernel
