// How the compressed matrix is made: which blocks are tried, divided, and kept whole.
#include "compressed/matrix.hpp"
#include "interrupt.hpp"

#include <algorithm>
#include <iterator>

namespace kernel::compressed {
namespace {

// Points and rays grow as the tolerance falls; 1e-3 is the usual one. What one of them does there, changed alone, to
// the error of F x against the whole matrix and to the time, in an empty room of 3600 patches and past a box of 1100:
//   far          one point a patch errs as (diameter / distance)^2. 5: the error is 1.7 and 5 times as large; 20: a
//                quarter smaller in the empty room, for about a third more time
//   middle       2 x 2 points err as its fourth power. 2: the same; 5: the same, for about a third more time
//   order_close  3: the worst row past the box errs 1.4 times as much; 8: hardly better, for about a quarter more time
//   rays_min     2, 16: hardly better or worse
//   rays_max     64: longer, as pairs are cut exactly where rays would do; 1024: the same
Effort effort_for(double tolerance) {
    const double finer = std::max(1.0, 1e-3 / tolerance);
    Effort e{};
    e.far = 10 * std::sqrt(finer);
    e.middle = 3 * std::pow(finer, 0.25);
    e.order = 3, e.order_close = tolerance < 2e-4 ? 8 : 5, e.order_abrupt = 2 * e.order_close;
    e.rays_min = 4, e.rays_max = 256;
    e.ray_error = tolerance;
    e.first_ray = 0;
    return e;
}

// For the measurement of the error: several times finer, and other rays.
Effort reference_for(double tolerance) {
    Effort e = effort_for(0.3 * tolerance);
    e.order = 5, e.order_close = 8, e.order_abrupt = 20;
    e.rays_min = 32, e.rays_max = 512;
    e.first_ray = 100'000;
    return e;
}

// Patches of a cluster seen partly; the rank that a shadow's edge asks for grows with them, and larger ones are not
// tried. Past a box of 1100 patches 128 do as well.
constexpr int LARGEST_MIXED = 1024;
// Twice what rooms ask for at a tolerance of 1e-3: there 12 and 48 give the same.
constexpr int HIGHEST_RANK = 24;
// Rank from which a block is kept whole instead, as a share of that at which both take as many numbers: 0.3 stores
// 4 ... 10 % more, 1 makes errors past a box 1.3 times as large.
constexpr double WORTHWHILE_RANK = 0.6;
// Blocks are tried from this distance on, in radii of the smaller cluster: 1 takes nearly twice the time past a box,
// 4 stores 1.2 ... 2.3 times the numbers.
constexpr double APART = 2;
// The smaller of two clusters is divided too unless the other is so many times as large. Above 1, or two of one size
// would never be; 3 gives the same.
constexpr double ALIKE = 1.5;

double pairs_of(const Cluster &a, const Cluster &b) { return double(a.size()) * b.size(); }

}  // namespace

CompressedMatrix::CompressedMatrix(const Geometry &geometry, const double *occluders, int n_occluders,
                                   double tolerance, int leaf_size)
    : tolerance_(tolerance), tree_(build_cluster_tree(geometry, leaf_size)) {
    for (int k = 0; k < n_occluders; ++k) occluders_.push_back(occluder(occluders + 12 * k));
    for (int k = 0; k < geometry.n; ++k) total_area_ += geometry.areas[k];
    pairs_ = std::make_unique<Pairs>(geometry, tree_.order, occluders_, effort_for(tolerance));
    reference_ = std::make_unique<Pairs>(geometry, tree_.order, occluders_, reference_for(tolerance));
    Task root{0, 0, std::vector<int>(n_occluders)};
    for (int k = 0; k < n_occluders; ++k) root.candidates[k] = k;
    stack_.push_back(std::move(root));
}

double CompressedMatrix::step(int limit) {
    const int count = std::min<int>(limit, static_cast<int>(stack_.size()));
    std::vector<Task> tasks(std::make_move_iterator(stack_.end() - count), std::make_move_iterator(stack_.end()));
    stack_.resize(stack_.size() - count);
    std::vector<Outcome> outcomes(count);
    Interruption interruption;
#pragma omp parallel for schedule(dynamic, 1)
    for (int k = 0; k < count; ++k)
        if (!interruption.stopped()) outcomes[k] = process(tasks[k]);
    interruption.finish();
    for (Outcome &outcome : outcomes) {
        done_ += outcome.done;
        if (outcome.block) keep(std::move(outcome.block));
        for (Task &child : outcome.children) stack_.push_back(std::move(child));
    }
    return stack_.empty() ? 1.0 : done_ / (0.5 * size() * double(size()));
}

void CompressedMatrix::keep(std::unique_ptr<Block> block) {
    const int kind = (block->rank < 0 ? 2 : 0) + (block->mixed ? 1 : 0);
    ++counts_.blocks[kind];
    counts_.numbers[kind] += block->numbers();
    if (block->numbers() > 0) blocks_.push_back(std::move(block));
}

CompressedMatrix::Outcome CompressedMatrix::process(const Task &task) const {
    const Cluster &a = tree_.clusters[task.a], &b = tree_.clusters[task.b];
    Outcome out;
    out.done = task.a == task.b ? 0.5 * pairs_of(a, a) : pairs_of(a, b);
    if (task.a == task.b && a.flat) return out;
    if (!facing(a, b, pairs_->tolerance())) return out;
    std::vector<int> candidates = task.candidates;
    if (task.a != task.b) {
        if (sight(a, b, occluders_, task.candidates, pairs_->tolerance(), candidates) == Sight::blocked) return out;
        if (compress(a, b, candidates, out)) return out;
    }
    if (!a.leaf() || !b.leaf()) return split(task, std::move(candidates));
    out.block = dense(a, b, candidates);
    return out;
}

CompressedMatrix::Outcome CompressedMatrix::split(const Task &task, std::vector<int> candidates) const {
    const Cluster &a = tree_.clusters[task.a], &b = tree_.clusters[task.b];
    Outcome out;
    if (task.a == task.b) {
        for (auto [p, q] : {std::pair(0, 0), {0, 1}, {1, 1}})
            out.children.push_back({a.child[p], a.child[q], candidates});
        return out;
    }
    const bool split_a = !a.leaf() && (b.leaf() || ALIKE * a.radius > b.radius);
    const bool split_b = !b.leaf() && (a.leaf() || ALIKE * b.radius > a.radius);
    for (int p = 0; p < (split_a ? 2 : 1); ++p)
        for (int q = 0; q < (split_b ? 2 : 1); ++q)
            out.children.push_back({split_a ? a.child[p] : task.a, split_b ? b.child[q] : task.b, candidates});
    return out;
}

// Errors of the blocks of a row add up in squares: with this share for each, their sum is `tolerance` however the
// row is cut. The rows of the smaller cluster are the ones that feel it most.
double CompressedMatrix::block_tolerance(const Cluster &a, const Cluster &b) const {
    return tolerance_ * std::sqrt(std::min(a.area, b.area) / total_area_);
}

bool CompressedMatrix::compress(const Cluster &a, const Cluster &b, const std::vector<int> &candidates,
                                Outcome &out) const {
    const bool mixed = !candidates.empty();
    if (std::min(a.radius, b.radius) * APART > distance_of(a, b)) return false;
    if (mixed && std::max(a.size(), b.size()) > LARGEST_MIXED) return false;
    const double break_even = WORTHWHILE_RANK * pairs_of(a, b) / (a.size() + b.size());
    const int limit = static_cast<int>(std::min(break_even, double(HIGHEST_RANK)));
    // A quarter as many past an occluder miss its edge: errors are three to five times as large.
    const int samples = std::max(32, (a.size() + b.size()) / (mixed ? 1 : 4));
    const double tolerance = block_tolerance(a, b);
    const BlockRange range{a.begin, a.end, b.begin, b.end};
    LowRank found = cross_approximation(*pairs_, range, candidates, tolerance, limit, samples);
    if (!found.reached) return false;
    recompress(found, 0.5 * tolerance);
    out.block = std::make_unique<Block>();
    out.block->range = range, out.block->rank = found.rank, out.block->mixed = mixed;
    out.block->left.assign(found.left.begin(), found.left.end());
    out.block->right.assign(found.right.begin(), found.right.end());
    return true;
}

std::unique_ptr<Block> CompressedMatrix::dense(const Cluster &a, const Cluster &b,
                                               const std::vector<int> &candidates) const {
    auto block = std::make_unique<Block>();
    block->range = {a.begin, a.end, b.begin, b.end};
    block->mixed = !candidates.empty(), block->diagonal = a.begin == b.begin;
    block->left.resize(std::size_t(a.size()) * b.size());
    std::vector<double> row(b.size());
    bool empty = true;
    for (int i = a.begin; i < a.end; ++i) {
        pairs_->row(i, b.begin, b.end, candidates, row.data());
        if (block->diagonal) row[i - a.begin] = 0;
        for (int j = 0; j < b.size(); ++j) {
            block->left[std::size_t(i - a.begin) * b.size() + j] = static_cast<float>(row[j]);
            empty &= row[j] == 0;
        }
    }
    if (empty) block->left.clear();
    return block;
}

void CompressedMatrix::exact_rows(const std::int64_t *rows, int n_rows, const double *x, double *y,
                                  int columns) const {
    std::vector<int> place(size()), all(occluders_.size());
    for (int k = 0; k < size(); ++k) place[tree_.order[k]] = k;
    for (std::size_t k = 0; k < all.size(); ++k) all[k] = static_cast<int>(k);
    Interruption interruption;
#pragma omp parallel for schedule(dynamic, 1)
    for (int k = 0; k < n_rows; ++k) {
        if (interruption.stopped()) continue;
        double *out = y + std::size_t(k) * columns;
        std::fill(out, out + columns, 0.0);
        visit(place[rows[k]], 0, all, x, out, columns);
    }
    interruption.finish();
}

void CompressedMatrix::visit(int row, int column, const std::vector<int> &candidates, const double *x, double *y,
                             int columns) const {
    const Cluster &b = tree_.clusters[column];
    const Cluster point = reference_->alone(row);
    std::vector<int> kept;
    if (!facing(point, b, pairs_->tolerance())) return;
    if (sight(point, b, occluders_, candidates, pairs_->tolerance(), kept) == Sight::blocked) return;
    if (!b.leaf()) {
        for (int child : b.child) visit(row, child, kept, x, y, columns);
        return;
    }
    for (int j = b.begin; j < b.end; ++j) {
        if (j == row) continue;
        const double share = reference_->value(row, j, kept) * reference_->root_area(j) / reference_->root_area(row);
        for (int c = 0; c < columns; ++c) y[c] += share * x[std::size_t(tree_.order[j]) * columns + c];
    }
}

}  // namespace kernel::compressed
