// Products with the form factor matrix, of which reciprocity needs only one half to be read.
#include <algorithm>
#include <vector>

#include "arrays.hpp"
#include "bindings.hpp"
#include "product_tile.hpp"

namespace kernel {
namespace {

constexpr std::int64_t TILE_ROWS = 32, TILE_COLUMNS = 512, ALONE = 1024;

// out = diag(areas) F x for a matrix with areas_i F_ij = areas_j F_ji: reads the upper triangle only.
template <class T>
void reciprocal_product(In<T, 2> factors, In<double, 1> areas, In<double, 1> x, Out<double, 1> out) {
    const std::int64_t n = static_cast<std::int64_t>(areas.shape(0));
    const std::int64_t rows = (n + TILE_ROWS - 1) / TILE_ROWS;
    // A fixed number of partial sums, so that the result does not depend on the number of threads.
    constexpr int PARTS = 8;
    std::vector<double> partial(PARTS * n, 0.0);
#pragma omp parallel for schedule(dynamic, 1) if (n > ALONE)
    for (int part = 0; part < PARTS; ++part)
        for (std::int64_t r = part; r < rows; r += PARTS)
            for (std::int64_t j0 = r * TILE_ROWS / TILE_COLUMNS * TILE_COLUMNS; j0 < n; j0 += TILE_COLUMNS)
                KERNEL_CALL(product_tile(factors.data(), areas.data(), n, x.data(), partial.data() + part * n,
                                         Tile{r * TILE_ROWS, std::min(n, (r + 1) * TILE_ROWS), j0,
                                              std::min(n, j0 + TILE_COLUMNS)}));
    double *o = out.data();
    std::fill(o, o + n, 0.0);
    for (int part = 0; part < PARTS; ++part)
        for (std::int64_t i = 0; i < n; ++i) o[i] += partial[part * n + i];
}

// Turns exchange areas A_i F_ij into F in place, and sums its rows.
void divide_rows(Out<double, 2> exchange, In<double, 1> areas, Out<double, 1> row_sums) {
    const std::int64_t n = static_cast<std::int64_t>(areas.shape(0));
#pragma omp parallel for schedule(static) if (n > 256)
    for (std::int64_t i = 0; i < n; ++i) {
        double *row = exchange.data() + i * n, sum = 0;
        const double inverse = 1 / areas.data()[i];
#pragma omp simd reduction(+ : sum)
        for (std::int64_t j = 0; j < n; ++j) sum += row[j] *= inverse;
        row_sums.data()[i] = sum;
    }
}

}  // namespace
}  // namespace kernel

void bind_solve(nb::module_ &m) {
    const auto guard = nb::call_guard<nb::gil_scoped_release>();
    m.def("reciprocal_product", &kernel::reciprocal_product<double>, nb::arg("factors"), nb::arg("areas"),
          nb::arg("x"), nb::arg("out"), guard);
    m.def("reciprocal_product", &kernel::reciprocal_product<float>, nb::arg("factors"), nb::arg("areas"), nb::arg("x"),
          nb::arg("out"), guard);
    m.def("divide_rows", &kernel::divide_rows, nb::arg("exchange"), nb::arg("areas"), nb::arg("row_sums"), guard);
}
