// Sums over rays as Python sees them: what each patch's rays bring, and the exchange areas that they tell.
#include <nanobind/stl/vector.h>

#include "arrays.hpp"
#include "bindings.hpp"
#include "sampling/exchange.hpp"

namespace {

using namespace kernel;

using sampling::Batch;
using sampling::RayCounts;

// One batch for each array of rows (n,) and of what their rays meet (n, rays).
void create(RayCounts *self, const std::vector<In<std::int64_t, 1>> &rows, const std::vector<In<std::int32_t, 2>> &met,
            std::int64_t patches) {
    std::vector<Batch> batches;
    for (std::size_t k = 0; k < rows.size(); ++k)
        batches.push_back({rows[k].data(), static_cast<std::int64_t>(rows[k].shape(0)), met[k].data(),
                           static_cast<std::int64_t>(met[k].shape(1))});
    Interruption interruption;
    RayCounts counts(batches, patches, interruption);
    interruption.finish();
    new (self) RayCounts(std::move(counts));
}

void weigh(const RayCounts &counts, In<double, 1> density, Out<std::int64_t, 1> starts, Out<std::int32_t, 1> columns,
           Out<double, 1> values, Out<double, 1> by_others, Out<double, 1> hits) {
    Interruption interruption;
    counts.weigh(density.data(), {starts.data(), columns.data(), values.data(), by_others.data(), hits.data()},
                 interruption);
    interruption.finish();
}

// Means of what each row's rays meet; those that meet nothing bring 0.
void ray_means(In<std::int32_t, 2> met, In<double, 1> values, Out<double, 1> means) {
    const auto n = static_cast<std::int64_t>(met.shape(0)), rays = static_cast<std::int64_t>(met.shape(1));
    Interruption interruption;
#pragma omp parallel for schedule(static) if (n * rays > 1 << 16)
    for (std::int64_t row = 0; row < n; ++row) {
        if (row % 256 == 0 && interruption.stopped()) continue;
        const std::int32_t *here = met.data() + rays * row;
        double sum = 0;
        for (std::int64_t ray = 0; ray < rays; ++ray)
            if (here[ray] >= 0) sum += values.data()[here[ray]];
        means.data()[row] = sum / static_cast<double>(rays);
    }
    interruption.finish();
}

}  // namespace

void bind_exchange(nb::module_ &m) {
    const nb::call_guard<nb::gil_scoped_release> unlocked;
    nb::class_<RayCounts>(m, "RayCounts")
        .def("__init__", &create, nb::arg("rows"), nb::arg("met"), nb::arg("patches"), unlocked)
        .def_prop_ro("entries", &RayCounts::entries)
        .def("weigh", &weigh, nb::arg("density"), nb::arg("starts"), nb::arg("columns"), nb::arg("values"),
             nb::arg("by_others"), nb::arg("hits"), unlocked);
    m.def("ray_means", &ray_means, nb::arg("met"), nb::arg("values"), nb::arg("means"), unlocked);
}
