// Products with the compressed matrix: every block once, in both directions, single numbers and double sums.
#include <algorithm>

#include "compressed/matrix.hpp"

namespace kernel::compressed {
namespace {

constexpr int LANES = 8;
constexpr int SHARES = 8;  // of the blocks, each with its own sum: the same result for every number of threads

double inner(const float *a, const double *x, int n) {
    double sum[LANES] = {};
    int k = 0;
    for (; k + LANES <= n; k += LANES)
        for (int lane = 0; lane < LANES; ++lane) sum[lane] += a[k + lane] * x[k + lane];
    for (; k < n; ++k) sum[0] += a[k] * x[k];
    return ((sum[0] + sum[1]) + (sum[2] + sum[3])) + ((sum[4] + sum[5]) + (sum[6] + sum[7]));
}

void add(double *to, const float *a, double times, int n) {
    for (int k = 0; k < n; ++k) to[k] += times * a[k];
}

void multiply(const Block &block, const double *x, double *y) {
    const int rows = block.range.rows(), columns = block.range.columns();
    const double *x_row = x + block.range.row_begin, *x_column = x + block.range.column_begin;
    double *y_row = y + block.range.row_begin, *y_column = y + block.range.column_begin;
    for (int k = 0; k < block.rank; ++k) {
        const float *left = &block.left[std::size_t(k) * rows], *right = &block.right[std::size_t(k) * columns];
        add(y_row, left, inner(right, x_column, columns), rows);
        add(y_column, right, inner(left, x_row, rows), columns);
    }
    for (int i = 0; block.rank < 0 && i < rows; ++i) {
        const float *line = &block.left[std::size_t(i) * columns];
        y_row[i] += inner(line, x_column, columns);
        if (!block.diagonal) add(y_column, line, x_row[i], columns);
    }
}

}  // namespace

void CompressedMatrix::apply(const double *x, double *y, int columns) const {
    const std::size_t n = tree_.order.size(), count = blocks_.size();
    std::vector<double> scaled(n * columns), sums(SHARES * n * columns, 0.0);
    for (std::size_t k = 0; k < n; ++k)
        for (int c = 0; c < columns; ++c)
            scaled[c * n + k] = pairs_->root_area(static_cast<int>(k)) * x[std::size_t(tree_.order[k]) * columns + c];
#pragma omp parallel for schedule(dynamic, 1)
    for (int share = 0; share < SHARES; ++share)
        for (std::size_t b = share; b < count; b += SHARES)
            for (int c = 0; c < columns; ++c)
                multiply(*blocks_[b], &scaled[c * n], &sums[(std::size_t(share) * columns + c) * n]);
#pragma omp parallel for schedule(static)
    for (std::size_t k = 0; k < n; ++k)
        for (int c = 0; c < columns; ++c) {
            double sum = 0;
            for (int share = 0; share < SHARES; ++share) sum += sums[(std::size_t(share) * columns + c) * n + k];
            y[std::size_t(tree_.order[k]) * columns + c] = sum / pairs_->root_area(static_cast<int>(k));
        }
}

}  // namespace kernel::compressed
