// A row's pixels in segments, in blocks of sixteen, and in runs that have something in common (sim/frame/runs.py).
#pragma once
#include <algorithm>
#include <cstdint>

#include "frame/frame.hpp"
#include "simd/frame_lanes.hpp"

namespace kernel::frame::KERNEL_INSTRUCTION_SET {

namespace {

constexpr int PADDED = SEGMENT + BLOCK;
using Row = float[BANDS][PADDED];

// Pixels [first, first + n) of the picture.
struct Segment {
    std::int64_t first, row, column;
    int n;
};

template <class Work>
inline void each_segment(const Pixels &pixels, std::int64_t row, const Work &work) {
    for (std::int64_t column = 0; column < pixels.width; column += SEGMENT)
        work(Segment{row * pixels.width + column, row, column,
                     static_cast<int>(std::min<std::int64_t>(SEGMENT, pixels.width - column))});
}

// Calls work(k, number of pixels) for each block of a segment; the number is a constant but for the last.
template <class Work>
inline void each_block(int n, const Work &work) {
    int k = 0;
    for (; k + BLOCK <= n; k += BLOCK) work(k, BLOCK);
    if (k < n) work(k, n - k);
}

// The first run of a row that reaches into a segment.
inline std::int32_t run_at(const Runs &runs, const Segment &at) {
    std::int32_t low = runs.row[at.row], high = runs.row[at.row + 1];
    while (high - low > 1) {
        const std::int32_t middle = low + (high - low) / 2;
        (runs.start[middle] <= at.column ? low : high) = middle;
    }
    return low;
}

// Calls work(begin, end, value) for each run of a segment, columns counted from the segment's.
template <class Work>
inline void each_run(const Pixels &pixels, const Runs &runs, const Segment &at, const Work &work) {
    const std::int32_t last = runs.row[at.row + 1];
    int begin = 0;
    for (std::int32_t run = run_at(runs, at); begin < at.n; ++run) {
        const std::int64_t next = run + 1 < last ? runs.start[run + 1] : pixels.width;
        const int end = static_cast<int>(std::min<std::int64_t>(next - at.column, at.n));
        work(begin, end, runs.value[run]);
        begin = end;
    }
}

struct Light {
    Floats band[BANDS];
};

// Goes along a row's runs by whole blocks.
class Cursor {
  public:
    Cursor(const Runs &runs, std::int64_t row, std::int64_t width)
        : runs_(runs), run_(runs.row[row]), last_(runs.row[row + 1]), width_(width) { find_end(); }

    // What value(of run) gives in the lanes of each run, for the block that begins at a column; columns rise.
    template <class Value>
    Light block(std::int64_t column, const Value &value) {
        while (end_ <= column) next();
        Light light = value(runs_.value[run_]);
        while (end_ < column + BLOCK && end_ < width_) {
            const int first = static_cast<int>(end_ - column);
            next();
            const Light other = value(runs_.value[run_]);
            for (int b = 0; b < BANDS; ++b) light.band[b] = first_lanes(first, light.band[b], other.band[b]);
        }
        return light;
    }

  private:
    void next() { ++run_, find_end(); }
    void find_end() { end_ = run_ + 1 < last_ ? runs_.start[run_ + 1] : width_; }

    const Runs runs_;
    std::int32_t run_, last_;
    std::int64_t width_, end_;
};

}  // namespace

}  // namespace kernel::frame::KERNEL_INSTRUCTION_SET
