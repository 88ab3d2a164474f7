// Sums run in lanes: the last bit of a product may differ from one instruction set to the next.
#include "form_factors/product_tile.hpp"

#include <algorithm>

namespace kernel::KERNEL_INSTRUCTION_SET {

namespace {

constexpr int ROWS = 4;  // at a time: what a pass over the columns loads and stores serves all of them

template <class T>
void multiply_row(const T *__restrict row, double area, std::int64_t i, const double *__restrict x,
                  double *__restrict out, std::int64_t begin, std::int64_t end) {
    const double mine = area * x[i];
    double sum = 0;
#pragma omp simd reduction(+ : sum)
    for (std::int64_t j = begin; j < end; ++j) {
        const double f = static_cast<double>(row[j]);
        sum += f * x[j];
        out[j] += f * mine;
    }
    out[i] += area * sum;
}

template <class T>
void multiply_rows(const T *__restrict F, const double *areas, std::int64_t n, std::int64_t i,
                   const double *__restrict x, double *__restrict out, std::int64_t begin, std::int64_t end) {
    const T *__restrict a = F + i * n, *__restrict b = a + n, *__restrict c = b + n, *__restrict d = c + n;
    const double xa = areas[i] * x[i], xb = areas[i + 1] * x[i + 1];
    const double xc = areas[i + 2] * x[i + 2], xd = areas[i + 3] * x[i + 3];
    double sa = 0, sb = 0, sc = 0, sd = 0;
#pragma omp simd reduction(+ : sa, sb, sc, sd)
    for (std::int64_t j = begin; j < end; ++j) {
        const double fa = a[j], fb = b[j], fc = c[j], fd = d[j], xj = x[j];
        sa += fa * xj, sb += fb * xj, sc += fc * xj, sd += fd * xj;
        out[j] += (fa * xa + fb * xb) + (fc * xc + fd * xd);
    }
    out[i] += areas[i] * sa, out[i + 1] += areas[i + 1] * sb;
    out[i + 2] += areas[i + 2] * sc, out[i + 3] += areas[i + 3] * sd;
}

template <class T>
void multiply(const T *F, const double *areas, std::int64_t n, const double *x, double *out, Tile tile) {
    std::int64_t i = tile.row_begin;
    for (; i + ROWS <= tile.row_end; i += ROWS) {
        const std::int64_t common = std::max(tile.column_begin, i + ROWS);
        // The few columns between these rows belong to the triangle on the diagonal.
        for (std::int64_t r = i; r < i + ROWS; ++r) {
            const std::int64_t begin = std::max(tile.column_begin, r + 1);
            if (begin < std::min(common, tile.column_end))
                multiply_row(F + r * n, areas[r], r, x, out, begin, std::min(common, tile.column_end));
        }
        if (common < tile.column_end) multiply_rows(F, areas, n, i, x, out, common, tile.column_end);
    }
    for (; i < tile.row_end; ++i) {
        const std::int64_t begin = std::max(tile.column_begin, i + 1);
        if (begin < tile.column_end) multiply_row(F + i * n, areas[i], i, x, out, begin, tile.column_end);
    }
}

}  // namespace

void product_tile(const double *F, const double *areas, std::int64_t n, const double *x, double *out, Tile tile) {
    multiply(F, areas, n, x, out, tile);
}

void product_tile(const float *F, const double *areas, std::int64_t n, const double *x, double *out, Tile tile) {
    multiply(F, areas, n, x, out, tile);
}

}  // namespace kernel::KERNEL_INSTRUCTION_SET
