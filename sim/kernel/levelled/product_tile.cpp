// Sums run in lanes: the last bit of a product may differ from one instruction set to the next.
#include "product_tile.hpp"

#include <algorithm>

namespace kernel::KERNEL_LEVEL {

namespace {

template <class T>
void multiply(const T *__restrict F, const double *areas, std::int64_t n, const double *__restrict x,
              double *__restrict out, Tile tile) {
    for (std::int64_t i = tile.row_begin; i < tile.row_end; ++i) {
        const std::int64_t begin = std::max(tile.column_begin, i + 1);
        const T *__restrict row = F + i * n;
        const double mine = areas[i] * x[i];
        double sum = 0;
#pragma omp simd reduction(+ : sum)
        for (std::int64_t j = begin; j < tile.column_end; ++j) {
            const double f = static_cast<double>(row[j]);
            sum += f * x[j];
            out[j] += f * mine;
        }
        out[i] += areas[i] * sum;
    }
}

}  // namespace

void product_tile(const double *F, const double *areas, std::int64_t n, const double *x, double *out, Tile tile) {
    multiply(F, areas, n, x, out, tile);
}

void product_tile(const float *F, const double *areas, std::int64_t n, const double *x, double *out, Tile tile) {
    multiply(F, areas, n, x, out, tile);
}

}  // namespace kernel::KERNEL_LEVEL
