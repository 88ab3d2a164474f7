// Some points at a time, their coordinates apart, so that all rounds of one stay in registers.
#include "lens.hpp"

#include <algorithm>

namespace kernel::KERNEL_INSTRUCTION_SET {
namespace {

constexpr int BLOCK = 8;  // points; what is left over of the last block is filled with zeros

inline double within(double value, double limit) {
    return value < -limit ? -limit : value > limit ? limit : value;
}

inline void undistort_block(double *x, double *y, const Undistortion &work) {
    const auto [k1, k2, p1, p2, k3] = work.lens;
    double real_x[BLOCK], real_y[BLOCK];
    for (int i = 0; i < BLOCK; ++i) {
        real_x[i] = x[i];
        real_y[i] = y[i];
        x[i] = within(x[i], work.limit);
        y[i] = within(y[i], work.limit);
    }
    for (int round = 0; round < work.rounds; ++round)
        for (int i = 0; i < BLOCK; ++i) {
            const double r2 = x[i] * x[i] + y[i] * y[i];
            const double radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3));
            const double to_x = x[i] * radial + 2 * p1 * x[i] * y[i] + p2 * (r2 + 2 * x[i] * x[i]);
            const double to_y = y[i] * radial + p1 * (r2 + 2 * y[i] * y[i]) + 2 * p2 * x[i] * y[i];
            x[i] = within(x[i] + real_x[i] - to_x, work.limit);
            y[i] = within(y[i] + real_y[i] - to_y, work.limit);
        }
}

}  // namespace

void undistort(const Undistortion &work) {
    for (std::int64_t first = 0; first < work.points; first += BLOCK) {
        const int count = static_cast<int>(std::min<std::int64_t>(BLOCK, work.points - first));
        double x[BLOCK] = {}, y[BLOCK] = {};
        for (int i = 0; i < count; ++i) {
            x[i] = work.real[2 * (first + i)];
            y[i] = work.real[2 * (first + i) + 1];
        }
        undistort_block(x, y, work);
        for (int i = 0; i < count; ++i) {
            work.ideal[2 * (first + i)] = x[i];
            work.ideal[2 * (first + i) + 1] = y[i];
        }
    }
}

}  // namespace kernel::KERNEL_INSTRUCTION_SET
