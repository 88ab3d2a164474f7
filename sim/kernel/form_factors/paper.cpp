// The paper's 3x3 midpoint quadrature of all pairs.
#include "form_factors/paper_run.hpp"

#include <algorithm>
#include <vector>

#include "arrays.hpp"
#include "bindings.hpp"
#include "interrupt.hpp"
#include "geometry/vectors.hpp"

namespace kernel {
namespace {

constexpr std::int64_t TILE = 64;  // squared, of doubles: 32 KB, the first cache

// points (3, 9, P), normals (3, P), offsets (P,), areas (P,). Fills exchange (P, P) with A_i F_ij, each pair once.
void paper_exchange_areas(In<double, 3> points, In<double, 2> normals, In<double, 1> offsets, In<double, 1> areas,
                          Out<double, 2> exchange) {
    const std::int64_t n = static_cast<std::int64_t>(areas.shape(0)), tiles = (n + TILE - 1) / TILE;
    const double *p = points.data(), *m = normals.data();
    const Samples samples{n, p, p + SAMPLES * n, p + 2 * SAMPLES * n, m, m + n, m + 2 * n, offsets.data()};
    const double *A = areas.data();
    double *K = exchange.data();
    Interruption interruption;
#pragma omp parallel for schedule(dynamic, 1)
    for (std::int64_t t = 0; t < tiles * tiles; ++t) {
        const std::int64_t i0 = t / tiles * TILE, j0 = t % tiles * TILE;
        if (j0 < i0 || interruption.stopped()) continue;
        const std::int64_t i1 = std::min(n, i0 + TILE), j1 = std::min(n, j0 + TILE);
        thread_local std::vector<double> tile(TILE * TILE);
        for (std::int64_t i = i0; i < i1; ++i) {
            double *out = tile.data() + (i - i0) * TILE;
            KERNEL_CALL(paper_row(samples, i, j0, j1, out));
            for (std::int64_t j = j0; j < j1; ++j) out[j - j0] *= A[i] * A[j] / (PI * SAMPLES * SAMPLES);
        }
        for (std::int64_t i = i0; i < i1; ++i)
            for (std::int64_t j = i0 == j0 ? i : j0; j < j1; ++j) K[i * n + j] = tile[(i - i0) * TILE + j - j0];
        for (std::int64_t j = j0; j < j1; ++j)
            for (std::int64_t i = i0; i < (i0 == j0 ? j : i1); ++i) K[j * n + i] = tile[(i - i0) * TILE + j - j0];
    }
    interruption.finish();
}

}  // namespace
}  // namespace kernel

void bind_paper(nb::module_ &m) {
    m.def("paper_exchange_areas", &kernel::paper_exchange_areas, nb::arg("points"), nb::arg("normals"),
          nb::arg("offsets"), nb::arg("areas"), nb::arg("exchange"), nb::call_guard<nb::gil_scoped_release>());
}
