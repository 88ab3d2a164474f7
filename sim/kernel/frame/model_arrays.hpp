// What the frame kernel reads of a sim.frame.model.FrameModel.
#pragma once
#include <algorithm>
#include <cstdint>
#include <numeric>
#include <vector>

#include "arrays.hpp"
#include "frame/frame.hpp"

namespace kernel::frame {

template <class T, int Dimensions>
inline In<T, Dimensions> array_of(const nb::object &owner, const char *name) {
    return nb::cast<In<T, Dimensions>>(owner.attr(name));
}

inline Layers layers_of(const nb::object &packed) {
    const auto bits = array_of<std::uint16_t, 3>(packed, "bits");
    const auto unit = array_of<double, 1>(packed, "unit");
    Layers layers{};
    const std::size_t n = bits.shape(0), size = bits.shape(1) * bits.shape(2);
    for (std::size_t b = 0; b < BANDS; ++b) {
        layers.band[b] = bits.data() + std::min(b, n - 1) * size;
        layers.unit[b] = static_cast<float>(unit.data()[std::min(b, n - 1)]);
    }
    return layers;
}

inline Runs runs_of(const nb::object &runs) {
    return {array_of<std::int32_t, 1>(runs, "row").data(), array_of<std::int32_t, 1>(runs, "start").data(),
            array_of<std::int32_t, 2>(runs, "value").data()};
}

// Sums with weights: of each of n, those from start to the next (sim/frame/runs.py, NodeMeans).
struct Means {
    std::int64_t n = 0;
    std::vector<std::int32_t> start, of;
    std::vector<float> weight;

    float sum(std::int64_t i, const float *values) const {
        float all = 0;
        for (std::int32_t k = start[i]; k < start[i + 1]; ++k) all += weight[k] * values[of[k]];
        return all;
    }

    // The same weights by what they are of.
    Means transposed(std::int64_t count) const {
        Means by{count, std::vector<std::int32_t>(count + 1), std::vector<std::int32_t>(of.size()),
                 std::vector<float>(of.size())};
        for (const std::int32_t each : of) ++by.start[each + 1];
        std::partial_sum(by.start.begin(), by.start.end(), by.start.begin());
        std::vector<std::int32_t> next(by.start.begin(), by.start.end() - 1);
        for (std::int64_t i = 0; i < n; ++i)
            for (std::int32_t k = start[i]; k < start[i + 1]; ++k) {
                const std::int32_t to = next[of[k]]++;
                by.of[to] = static_cast<std::int32_t>(i);
                by.weight[to] = weight[k];
            }
        return by;
    }
};

inline Means means_of(const nb::object &means) {
    const auto start = array_of<std::int32_t, 1>(means, "start"), of = array_of<std::int32_t, 1>(means, "patch");
    const auto weight = array_of<float, 1>(means, "weight");
    return {static_cast<std::int64_t>(start.shape(0)) - 1,
            {start.data(), start.data() + start.shape(0)},
            {of.data(), of.data() + of.shape(0)},
            {weight.data(), weight.data() + weight.shape(0)}};
}

}  // namespace kernel::frame
