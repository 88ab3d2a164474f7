// The compressed exchange matrix: block by block, each unordered pair of clusters once.
#pragma once
#include <memory>
#include <vector>

#include "compressed/cross_approximation.hpp"
#include "compressed/sight.hpp"

namespace kernel::compressed {

struct Block {
    BlockRange range;
    int rank = -1;  // -1: dense, (rows, columns) in `left`; a block on the diagonal is stored whole
    bool mixed = false, diagonal = false;
    std::vector<float> left, right;
    std::size_t numbers() const { return left.size() + right.size(); }
};

struct Task {
    int a, b;
    std::vector<int> candidates;
};

struct Counts {
    std::size_t numbers[4] = {0, 0, 0, 0};  // stored: low rank clear, low rank mixed, dense clear, dense mixed
    std::size_t blocks[4] = {0, 0, 0, 0};
};

class CompressedMatrix {
   public:
    CompressedMatrix(const Geometry &geometry, const double *occluders, int n_occluders, double tolerance,
                     int leaf_size);
    // Work on up to `limit` blocks; the share of all pairs that is done.
    double step(int limit);
    // y = F x for (n, columns), in the caller's order of patches.
    void apply(const double *x, double *y, int columns) const;
    // y[k] = (F x)[rows[k]] with the entries of whole rows evaluated again, with more points and other rays.
    void exact_rows(const std::int64_t *rows, int n_rows, const double *x, double *y, int columns) const;
    const Counts &counts() const { return counts_; }
    int size() const { return static_cast<int>(tree_.order.size()); }

   private:
    struct Outcome {
        std::vector<Task> children;
        std::unique_ptr<Block> block;
        double done = 0;  // pairs
    };
    double tolerance_, total_area_ = 0, done_ = 0;
    ClusterTree tree_;
    std::vector<Occluder> occluders_;
    std::unique_ptr<Pairs> pairs_, reference_;
    std::vector<Task> stack_;
    std::vector<std::unique_ptr<Block>> blocks_;
    Counts counts_;

    Outcome process(const Task &task) const;
    Outcome split(const Task &task, std::vector<int> candidates) const;
    bool compress(const Cluster &a, const Cluster &b, const std::vector<int> &candidates, Outcome &out) const;
    std::unique_ptr<Block> dense(const Cluster &a, const Cluster &b, const std::vector<int> &candidates) const;
    double block_tolerance(const Cluster &a, const Cluster &b) const;
    void keep(std::unique_ptr<Block> block);
    void visit(int row, int column, const std::vector<int> &candidates, const double *x, double *y, int columns) const;
};

}  // namespace kernel::compressed
