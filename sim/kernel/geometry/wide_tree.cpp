// From the binary tree to the wide one.
#include "geometry/wide_tree.hpp"

#include "interrupt.hpp"

namespace kernel {
namespace {

class Collapse {
  public:
    Collapse(const Tree &tree, WideTree &out) : tree_(tree), out_(out) {}

    void run() {
        if (tree_.nodes().empty()) return;
        const Tree::Node &root = tree_.nodes()[0];
        node(root.count ? std::vector<Piece>{leaf_of(root)} : opened(0));
        interruption_.finish();
    }

  private:
    // A node of the binary tree, or (node < 0) a run of its order.
    struct Piece {
        std::int32_t node, first, count;
        Box box;
        bool divisible() const { return node >= 0 || count > WIDTH; }
    };

    Piece piece(std::int32_t index) const {
        const Tree::Node &node = tree_.nodes()[index];
        return node.count ? leaf_of(node) : Piece{index, 0, 0, node.box};
    }

    static Piece leaf_of(const Tree::Node &node) { return {-1, node.first, node.count, node.box}; }

    std::vector<Piece> opened(std::int32_t index) const {
        return {piece(index + 1), piece(tree_.nodes()[index].first)};
    }

    // Halves of a run: of more polygons in one place than a leaf holds.
    static std::vector<Piece> halves(const Piece &run) {
        const std::int32_t half = run.count / 2;
        return {{-1, run.first, half, run.box}, {-1, run.first + half, run.count - half, run.box}};
    }

    // Opens the largest pieces until there are eight.
    void open(std::vector<Piece> &pieces) const {
        while (pieces.size() < WIDTH) {
            int largest = -1;
            for (int k = 0; k < static_cast<int>(pieces.size()); ++k)
                if (pieces[k].divisible() &&
                    (largest < 0 || pieces[k].box.half_area() > pieces[largest].box.half_area()))
                    largest = k;
            if (largest < 0) return;
            const Piece chosen = pieces[largest];
            pieces.erase(pieces.begin() + largest);
            for (const Piece &part : chosen.node >= 0 ? opened(chosen.node) : halves(chosen)) pieces.push_back(part);
        }
    }

    std::int32_t node(std::vector<Piece> pieces) {
        if (interruption_.stopped()) return 0;
        open(pieces);
        const auto index = static_cast<std::int32_t>(out_.nodes.size());
        out_.nodes.push_back({});
        for (int k = 0; k < WIDTH; ++k) {
            WideNode &here = out_.nodes[index];
            if (k >= static_cast<int>(pieces.size())) {
                for (int side = 0; side < 6; ++side) here.bound[side][k] = side % 2 ? -HUGE_VALF : HUGE_VALF;
                here.child[k] = ~0;
                continue;
            }
            bound(here, k, pieces[k].box);
            const std::int32_t child = this->child(pieces[k]);
            out_.nodes[index].child[k] = child;
        }
        return index;
    }

    std::int32_t child(const Piece &part) {
        if (part.node >= 0) return node(opened(part.node));
        return part.count > WIDTH ? node(halves(part)) : ~leaf(part);
    }

    void bound(WideNode &node, int k, const Box &box) const {
        for (int axis = 0; axis < 3; ++axis) {
            const double from = component(out_.middle, axis);
            node.bound[2 * axis][k] = static_cast<float>(component(box.low, axis) - from - 2 * out_.slack);
            node.bound[2 * axis + 1][k] = static_cast<float>(component(box.high, axis) - from + 2 * out_.slack);
        }
    }

    std::int32_t leaf(const Piece &part) {
        WideLeaf leaf{};
        leaf.sides = 3;
        for (int k = 0; k < WIDTH; ++k) {
            leaf.index[k] = -1;
            for (auto &edge : leaf.edge) edge.offset[k] = HUGE_VALF;
            if (k < part.count) fill(leaf, k, tree_.order()[part.first + k]);
        }
        out_.leaves.push_back(leaf);
        return static_cast<std::int32_t>(out_.leaves.size()) - 1;
    }

    void fill(WideLeaf &leaf, int k, std::int32_t index) const {
        const Occluder &polygon = tree_.occluders[index];
        leaf.index[k] = index;
        leaf.sides = std::max(leaf.sides, polygon.n);
        leaf.offset[k] = static_cast<float>(polygon.offset - dot(polygon.normal, out_.middle));
        for (int axis = 0; axis < 3; ++axis) leaf.normal[axis][k] = static_cast<float>(component(polygon.normal, axis));
        for (int side = 0; side < 4; ++side) {
            const int own = std::min(side, polygon.n - 1);
            for (int axis = 0; axis < 3; ++axis)
                leaf.edge[side].normal[axis][k] = static_cast<float>(component(polygon.edge[own], axis));
            leaf.edge[side].offset[k] =
                static_cast<float>(polygon.edge_offset[own] - dot(polygon.edge[own], out_.middle) - out_.slack);
        }
    }

    const Tree &tree_;
    WideTree &out_;
    Interruption interruption_;
};

}  // namespace

WideTree::WideTree(const Tree &tree) {
    if (tree.nodes().empty()) return;
    const Box &box = tree.nodes()[0].box;
    middle = box.middle();
    slack = ROUNDING * box.diagonal();
    Collapse(tree, *this).run();
}

}  // namespace kernel
