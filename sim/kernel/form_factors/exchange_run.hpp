// Exchange areas A F of many pairs of axis-parallel rectangles at once.
#pragma once
#include "instruction_set.hpp"

namespace kernel {

constexpr int RUN = 128;  // pairs at a time: nine numbers of each are 9 KB, within the first cache

// Intervals of n <= RUN pairs (a, b) along two axes, each [low, high].
// Parallel rectangles: x and y, both across the normal, and the gap between their planes.
// Perpendicular ones: x is a's height over b's plane and b's over a's, y the axis that both share.
struct Run {
    int n;
    bool parallel;
    double gap[RUN];  // parallel only
    double ax0[RUN], ax1[RUN], bx0[RUN], bx1[RUN];
    double ay0[RUN], ay1[RUN], by0[RUN], by1[RUN];
};

// Relative error of the far rules and roundoff of the near ones are both below 1e-9 (tests/sim).
KERNEL_DECLARE(void exchange_areas(const Run &run, double *out))

}  // namespace kernel
