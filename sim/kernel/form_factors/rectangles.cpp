// Form factors between axis-parallel rectangles of any size and place: every pair on its own.
#include <algorithm>
#include <cmath>
#include <vector>

#include "arrays.hpp"
#include "bindings.hpp"
#include "interrupt.hpp"
#include "form_factors/exchange_run.hpp"

namespace kernel {
namespace {

constexpr int TILE = RUN;

struct Rectangles {
    const double *low, *high;      // (P, 3)
    const std::int64_t *axis;      // (P,) that the normal runs along
    const double *sign;            // (P,) +1 or -1
};

// Extent of rectangle j over the plane of i, on its lit side.
void height(const Rectangles &r, std::int64_t i, std::int64_t j, double &low, double &high) {
    const int k = static_cast<int>(r.axis[i]);
    const double one = (r.low[3 * j + k] - r.low[3 * i + k]) * r.sign[i];
    const double other = (r.high[3 * j + k] - r.low[3 * i + k]) * r.sign[i];
    low = std::max(std::min(one, other), 0.0);
    high = std::max(std::max(one, other), 0.0);
}

void set_interval(const Rectangles &r, std::int64_t i, int axis, double &low, double &high) {
    low = r.low[3 * i + axis];
    high = r.high[3 * i + axis];
}

// Adds pair (i, j) to its run; false if they cannot see each other.
bool add(const Rectangles &r, std::int64_t i, std::int64_t j, Run &run) {
    double a_low, a_high, b_low, b_high;
    height(r, j, i, a_low, a_high);
    height(r, i, j, b_low, b_high);
    if (!(a_high > 0 && b_high > 0)) return false;
    const int k = run.n++, axis = static_cast<int>(r.axis[i]);
    int y;
    if (run.parallel) {
        const int x = (axis + 1) % 3;
        y = (axis + 2) % 3;
        run.gap[k] = b_high;
        set_interval(r, i, x, run.ax0[k], run.ax1[k]);
        set_interval(r, j, x, run.bx0[k], run.bx1[k]);
    } else {
        y = 3 - axis - static_cast<int>(r.axis[j]);
        run.gap[k] = 0;
        run.ax0[k] = a_low, run.ax1[k] = a_high, run.bx0[k] = b_low, run.bx1[k] = b_high;
    }
    set_interval(r, i, y, run.ay0[k], run.ay1[k]);
    set_interval(r, j, y, run.by0[k], run.by1[k]);
    return true;
}

// Exchange areas of row i with columns begin ... end - 1, at most RUN of them.
void row(const Rectangles &r, std::int64_t i, std::int64_t begin, std::int64_t end, double *out) {
    thread_local Run run;
    thread_local double value[RUN];
    int which[RUN];
    std::fill(out, out + (end - begin), 0.0);
    for (const bool parallel : {true, false}) {
        run.n = 0;
        run.parallel = parallel;
        for (std::int64_t j = begin; j < end; ++j) {
            if (j == i || (r.axis[j] == r.axis[i]) != parallel) continue;
            const int at = run.n;
            if (add(r, i, j, run)) which[at] = static_cast<int>(j - begin);
        }
        KERNEL_CALL(exchange_areas(run, value));
        for (int k = 0; k < run.n; ++k) out[which[k]] = value[k];
    }
}

// Fills exchange (P, P) with A_i F_ij: each tile above the diagonal once, and its mirror image.
void rectangle_exchange_areas(In<double, 2> low, In<double, 2> high, In<std::int64_t, 1> axis, In<double, 1> sign,
                              Out<double, 2> exchange) {
    const Rectangles r{low.data(), high.data(), axis.data(), sign.data()};
    const std::int64_t n = static_cast<std::int64_t>(axis.shape(0)), tiles = (n + TILE - 1) / TILE;
    double *K = exchange.data();
    Interruption interruption;
#pragma omp parallel for schedule(dynamic, 1)
    for (std::int64_t t = 0; t < tiles * tiles; ++t) {
        const std::int64_t ti = t / tiles, tj = t % tiles;
        if (tj < ti || interruption.stopped()) continue;
        thread_local std::vector<double> tile(TILE * TILE);
        const std::int64_t i0 = ti * TILE, i1 = std::min(n, i0 + TILE), j0 = tj * TILE, j1 = std::min(n, j0 + TILE);
        for (std::int64_t i = i0; i < i1; ++i) {
            double *out = tile.data() + (i - i0) * TILE;
            // On the diagonal each pair once: the lower half comes from the mirror.
            const std::int64_t begin = ti == tj ? i : j0;
            row(r, i, begin, j1, out + (begin - j0));
        }
        for (std::int64_t i = i0; i < i1; ++i)
            for (std::int64_t j = ti == tj ? i : j0; j < j1; ++j) K[i * n + j] = tile[(i - i0) * TILE + j - j0];
        for (std::int64_t j = j0; j < j1; ++j)
            for (std::int64_t i = i0; i < (ti == tj ? j : i1); ++i) K[j * n + i] = tile[(i - i0) * TILE + j - j0];
    }
    interruption.finish();
}

}  // namespace
}  // namespace kernel

void bind_rectangles(nb::module_ &m) {
    m.def("rectangle_exchange_areas", &kernel::rectangle_exchange_areas, nb::arg("low"), nb::arg("high"),
          nb::arg("axis"), nb::arg("sign"), nb::arg("exchange"), nb::call_guard<nb::gil_scoped_release>());
}
