// Three sinusoids told apart by their beats: calibration/reference/beats.py is the definition.
#pragma once
#include <cstdint>

#include "instruction_set.hpp"

namespace kernel {

constexpr int FREQUENCIES = 3, STEPS = 4;

template <class T>
struct Beats {
    const T *const *frames;  // of each frequency, long periods first, its phases a quarter of a period apart
    const float *noise;      // of one frame
    bool one_noise;          // for all pixels
    float slow, fast;        // periods of the beats over the range
    float range_px, period_px[FREQUENCIES], weight[FREQUENCIES];
    float sigma_px;          // of a coordinate, for phases that are off by one period of one pixel
    float mean_period_px, most_apart_px2;
    float *position, *sigma, *misfit;  // out
    std::uint8_t *ambiguous;           // out
    std::int64_t pixels;
};

KERNEL_DECLARE(void read_beats(const Beats<std::uint8_t> &work))
KERNEL_DECLARE(void read_beats(const Beats<std::uint16_t> &work))
KERNEL_DECLARE(void read_beats(const Beats<float> &work))

}  // namespace kernel
