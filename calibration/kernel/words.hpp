// One axis of a binary code, read from pairs of photographs: calibration/structured_light/bits.py is its definition.
#pragma once
#include <cstdint>

#include "instruction_set.hpp"

namespace kernel {

// As in calibration/structured_light/correspondence.py. Of two reasons the lower one counts, 0 last of all.
enum Reason : std::uint8_t { VALID = 0, DARK = 1, SATURATED = 2, UNCERTAIN_BIT = 3, OUT_OF_RANGE = 4 };

// All arrays have as many entries as pixels are read.
template <class T>
struct Words {
    const T *const *lit, *const *other;  // of each bit, the most significant first: is the first one brighter?
    int bits, wide;                      // of them, those whose stripes are wide: to be told by the pixel's own light
    const T *limit;                      // a bit of which both differ by less is open
    bool one_limit;                      // for all pixels
    const T *black;                      // null: wide stripes are like the others
    float sure_share;
    const T *saturation;                 // null: nothing is known to be clipped
    const std::uint16_t *table;          // position of each word
    std::uint16_t first, end;            // of what the projector shows, twice the position
    std::uint16_t *twice;                // out: twice the position
    std::uint8_t *reason;                // in and out
    std::int64_t pixels;
};

KERNEL_DECLARE(void read_words(const Words<std::uint8_t> &work))
KERNEL_DECLARE(void read_words(const Words<std::uint16_t> &work))
KERNEL_DECLARE(void read_words(const Words<float> &work))

}  // namespace kernel
