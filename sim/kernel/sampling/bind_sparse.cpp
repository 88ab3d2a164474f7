// Products with a sparse matrix, and its scaling in place, on all threads: most of what a solution by rays takes.
#include "arrays.hpp"
#include "bindings.hpp"

namespace {

// Fewer entries are done before other threads have begun.
constexpr std::int64_t ALONE = 1 << 15;
// Rows that a thread takes at a time.
constexpr int ROWS = 64;

// K x of one column: four sums a row, in the same order whatever the number of threads.
double row_times(const std::int32_t *columns, const double *values, std::int64_t n, const double *x) {
    double sums[4] = {0, 0, 0, 0};
    std::int64_t k = 0;
    for (; k + 4 <= n; k += 4)
        for (int lane = 0; lane < 4; ++lane) sums[lane] += values[k + lane] * x[columns[k + lane]];
    for (; k < n; ++k) sums[0] += values[k] * x[columns[k]];
    return (sums[0] + sums[1]) + (sums[2] + sums[3]);
}

void sparse_product(In<std::int32_t, 1> starts, In<std::int32_t, 1> columns, In<double, 1> values, In<double, 2> x,
                    Out<double, 2> out) {
    const auto n = static_cast<std::int64_t>(out.shape(0)), width = static_cast<std::int64_t>(out.shape(1));
#pragma omp parallel for schedule(dynamic, ROWS) if (width * static_cast<std::int64_t>(values.shape(0)) > ALONE)
    for (std::int64_t row = 0; row < n; ++row) {
        const std::int64_t first = starts.data()[row], last = starts.data()[row + 1];
        double *sums = out.data() + width * row;
        if (width == 1) {
            *sums = row_times(columns.data() + first, values.data() + first, last - first, x.data());
            continue;
        }
        for (std::int64_t c = 0; c < width; ++c) sums[c] = 0;
        for (std::int64_t k = first; k < last; ++k) {
            const double value = values.data()[k], *other = x.data() + width * columns.data()[k];
            for (std::int64_t c = 0; c < width; ++c) sums[c] += value * other[c];
        }
    }
}

// K_ij becomes scale_i K_ij scale_j.
void scale_both_sides(In<std::int32_t, 1> starts, In<std::int32_t, 1> columns, Out<double, 1> values,
                      In<double, 1> scale) {
    const auto n = static_cast<std::int64_t>(scale.shape(0));
#pragma omp parallel for schedule(dynamic, ROWS) if (static_cast<std::int64_t>(values.shape(0)) > ALONE)
    for (std::int64_t row = 0; row < n; ++row)
        for (std::int64_t k = starts.data()[row]; k < starts.data()[row + 1]; ++k)
            values.data()[k] *= scale.data()[row] * scale.data()[columns.data()[k]];
}

}  // namespace

void bind_sparse(nb::module_ &m) {
    const nb::call_guard<nb::gil_scoped_release> unlocked;
    m.def("sparse_product", &sparse_product, nb::arg("starts"), nb::arg("columns"), nb::arg("values"), nb::arg("x"),
          nb::arg("out"), unlocked);
    m.def("scale_both_sides", &scale_both_sides, nb::arg("starts"), nb::arg("columns"), nb::arg("values"),
          nb::arg("scale"), unlocked);
}
