// Products with the form factor matrix, of which reciprocity needs only one half to be read.
#include <algorithm>
#include <vector>

#include "arrays.hpp"
#include "bindings.hpp"
#include "form_factors/product_tile.hpp"

namespace kernel {
namespace {

// Four rows of a tile, with as much of x and of the sums, are 24 KB: the first cache. BLOCK: whole cache lines.
constexpr std::int64_t TILE_ROWS = 32, TILE_COLUMNS = 512, BLOCK = 64;
// Patches up to which one thread does all: in a tenth of a millisecond, hardly more than others take to wake.
constexpr std::int64_t ALONE = 1024;

nb::ndarray<nb::numpy, std::int64_t> owned(const std::vector<std::int64_t> &values) {
    auto *data = new std::int64_t[values.size() + 1];
    std::copy(values.begin(), values.end(), data);
    nb::capsule owner(data, [](void *p) noexcept { delete[] static_cast<std::int64_t *>(p); });
    return nb::ndarray<nb::numpy, std::int64_t>(data, {values.size()}, owner);
}

// The columns above the diagonal in which a tile's rows are not all 0: whole runs of BLOCK columns. Patches of one
// face see nothing of each other, so that a room's matrix has many that need not be read.
template <class T>
nb::tuple occupied_columns(In<T, 2> factors) {
    const std::int64_t n = static_cast<std::int64_t>(factors.shape(0)), rows = (n + TILE_ROWS - 1) / TILE_ROWS;
    std::vector<std::vector<std::int64_t>> of_row(rows);
#pragma omp parallel for schedule(dynamic, 4)
    for (std::int64_t r = 0; r < rows; ++r) {
        const std::int64_t i0 = r * TILE_ROWS, i1 = std::min(n, i0 + TILE_ROWS);
        for (std::int64_t j0 = i0 / BLOCK * BLOCK; j0 < n; j0 += BLOCK) {
            const std::int64_t j1 = std::min(n, j0 + BLOCK);
            bool any = false;
            for (std::int64_t i = i0; i < i1 && !any; ++i)
                for (std::int64_t j = j0; j < j1 && !any; ++j) any = factors.data()[i * n + j] != 0;
            if (!any) continue;
            if (!of_row[r].empty() && of_row[r].back() == j0)
                of_row[r].back() = j1;
            else
                of_row[r].insert(of_row[r].end(), {j0, j1});
        }
    }
    std::vector<std::int64_t> starts{0}, ranges;
    for (const auto &some : of_row) {
        ranges.insert(ranges.end(), some.begin(), some.end());
        starts.push_back(static_cast<std::int64_t>(ranges.size()));
    }
    return nb::make_tuple(owned(starts), owned(ranges));
}

// out = diag(areas) F x for a matrix with areas_i F_ij = areas_j F_ji: reads the upper triangle only, and of that
// the columns begin, end, begin, end ... in ranges, from starts[r] on for the r-th tile of rows.
template <class T>
void reciprocal_product(In<T, 2> factors, In<double, 1> areas, In<std::int64_t, 1> starts,
                        In<std::int64_t, 1> ranges, In<double, 1> x, Out<double, 1> out) {
    const std::int64_t n = static_cast<std::int64_t>(areas.shape(0));
    const std::int64_t rows = (n + TILE_ROWS - 1) / TILE_ROWS;
    // A fixed number of partial sums, so that the result does not depend on the number of threads.
    constexpr int PARTS = 8;
    std::vector<double> partial(PARTS * n, 0.0);
#pragma omp parallel for schedule(dynamic, 1) if (n > ALONE)
    for (int part = 0; part < PARTS; ++part)
        for (std::int64_t r = part; r < rows; r += PARTS)
            for (std::int64_t k = starts.data()[r]; k < starts.data()[r + 1]; k += 2)
                for (std::int64_t j0 = ranges.data()[k]; j0 < ranges.data()[k + 1]; j0 += TILE_COLUMNS)
                    KERNEL_CALL(product_tile(factors.data(), areas.data(), n, x.data(), partial.data() + part * n,
                                             Tile{r * TILE_ROWS, std::min(n, (r + 1) * TILE_ROWS), j0,
                                                  std::min(ranges.data()[k + 1], j0 + TILE_COLUMNS)}));
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
    m.def("occupied_columns", &kernel::occupied_columns<double>, nb::arg("factors"));
    m.def("occupied_columns", &kernel::occupied_columns<float>, nb::arg("factors"));
    m.def("reciprocal_product", &kernel::reciprocal_product<double>, nb::arg("factors"), nb::arg("areas"),
          nb::arg("starts"), nb::arg("ranges"), nb::arg("x"), nb::arg("out"), guard);
    m.def("reciprocal_product", &kernel::reciprocal_product<float>, nb::arg("factors"), nb::arg("areas"),
          nb::arg("starts"), nb::arg("ranges"), nb::arg("x"), nb::arg("out"), guard);
    m.def("divide_rows", &kernel::divide_rows, nb::arg("exchange"), nb::arg("areas"), nb::arg("row_sums"), guard);
}
