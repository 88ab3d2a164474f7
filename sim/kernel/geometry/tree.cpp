// Building a tree, which can be ended from the keyboard.
#include "geometry/tree.hpp"

#include "interrupt.hpp"

namespace kernel {

Tree::Tree(const double *corners, std::int64_t n, double size) : tolerance(Tolerance::of(size)) {
    Interruption interruption;
    std::vector<Box> boxes(n);
    for (std::int64_t i = 0; i < n; ++i) {
        if (i % 1024 == 0 && interruption.stopped()) break;
        occluders.push_back(occluder(corners + 12 * i));
        boxes[i] = box_of(corners + 12 * i, 4);
        if (has_area(occluders[i])) order_.push_back(static_cast<std::int32_t>(i));
    }
    if (!order_.empty()) split(boxes, 0, static_cast<std::int32_t>(order_.size()), 0, interruption);
    interruption.finish();
}

std::int32_t Tree::split(const std::vector<Box> &boxes, std::int32_t begin, std::int32_t end, int depth,
                         Interruption &interruption) {
    const auto index = static_cast<std::int32_t>(nodes_.size());
    nodes_.push_back({{}, begin, end - begin});
    Box centres;
    for (std::int32_t k = begin; k < end; ++k) {
        nodes_[index].box.grow(boxes[order_[k]]);
        centres.grow(boxes[order_[k]].middle());
    }
    if (end - begin <= LEAF || depth >= DEPTH || interruption.stopped()) return index;
    const std::int32_t cut = best_cut(boxes, centres, begin, end);
    if (cut == begin || cut == end) return index;
    split(boxes, begin, cut, depth + 1, interruption);
    const std::int32_t right = split(boxes, cut, end, depth + 1, interruption);
    nodes_[index].first = right;
    nodes_[index].count = 0;
    return index;
}

}  // namespace kernel
