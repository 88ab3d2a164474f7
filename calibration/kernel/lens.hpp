// Brown's distortion inverted: calibration/geometry/pinhole.py says what it is, calibration/reference/lens.py how.
#pragma once
#include <cstdint>

#include "instruction_set.hpp"

namespace kernel {

struct Lens {
    double k1, k2, p1, p2, k3;  // OpenCV's order
};

// Points are pairs (x, y), focal length 1; neither coordinate leaves +-limit. NaN stays NaN.
struct Undistortion {
    const double *real;
    double *ideal;  // out
    Lens lens;
    double limit;
    int rounds;  // of the fixed point
    std::int64_t points;
};

KERNEL_DECLARE(void undistort(const Undistortion &work))

}  // namespace kernel
