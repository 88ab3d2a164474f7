// A frame's rows: target codes in, sums over patches or projector codes out. sim/reference/frame.py defines them.
#pragma once
#include <cstdint>

#include "instruction_set.hpp"

namespace kernel::frame {

constexpr int BANDS = 3, SEGMENT = 256, BLOCK = 16, DITHER = 64;

// What the largest packed number is, over the number of single precision whose upper bits after the sign it is.
constexpr float PACKED_ONE = 0x1p111f;

// Packed numbers of each band (sim/frame/packed.py), and what 1 stands for.
struct Layers {
    const std::uint16_t *band[BANDS];
    float unit[BANDS];
};

// Runs of pixels of a row (sim/frame/runs.py).
struct Runs {
    const std::int32_t *row, *start, *value;
};

// Arrays of pixels, row by row.
struct Pixels {
    std::int64_t height, width, n_lit;
    Layers inverse, offset, gain, emission;
    const std::uint8_t *place_x, *place_y; // in the cell, in 255ths
    Runs patches, cells;
    const std::int32_t *corners;           // (cells, 4) nodes
};

// What each code of a target asks for in a band, over D of 1: unit * number + none, the number of single precision with
// TARGET_TOP as its upper byte and those below from tables, 2 ... 8.
struct Target {
    const float *light;               // (256)
    const std::uint8_t (*bytes)[256]; // low, middle, high
    float unit, none;
};

constexpr std::uint8_t TARGET_TOP = 0x40;
constexpr float TARGET_LEAST = 2, TARGET_RANGE = 5.9999990f;

// Codes of a channel by its light's share p of the span, the light of the highest code: by the upper bits of
// p + RESPONSE_TOE, which part each octave into 128 entries, or into the halves that cubics are for.
struct Channel {
    const std::int32_t *table;      // code and step to the next, both in 256ths, 16 bits each
    const float (*cubics)[32];      // coefficients of the powers of p + RESPONSE_TOE
    const float *dither;            // (64, 64) codes to add before rounding down
};

constexpr int OCTAVES = 15, RESPONSE = OCTAVES * 128 + 2, RESPONSE_SHIFT = 16, CUBIC_SHIFT = 22;
constexpr int RESPONSE_FIRST = (127 - OCTAVES) << (23 - RESPONSE_SHIFT);
constexpr float RESPONSE_TOE = 1.0f / (1 << OCTAVES);

// What differs from frame to frame, and small tables. Light of a band is in a unit of its own; that of a channel is a
// share of its span. Units of the packed layers, and PACKED_ONE, are in these numbers, not in what a pixel reads.
struct Frame {
    const std::uint8_t *codes;
    std::uint8_t *out;
    Target target[BANDS];
    float offset[BANDS];           // - black over D, for packed 1
    const float *cells;            // (cells, 3, 4) - irradiance at the first corner, and its rise along x, y, both
    const float *pull;             // (3, L) H^T V^T (predicted - wanted), emission as of the first band; bounded only
    float channels[BANDS][BANDS];  // [channel][band] K^-1
    float light[BANDS][BANDS];     // [band][channel] K
    float common[BANDS][BANDS][BANDS]; // [channel][channel][band] products of two channels' light
    float weight[BANDS];           // squared camera value of light where D is 1
    bool mixed;                    // K is not the identity
    int rounds;                    // over the channels, to bound their light together
    Channel channel[BANDS];
    bool smooth;                   // the cubics follow all responses
};

// Sums of a chunk of rows: for each patch those of the bands, and one number more, so that they are added at once.
constexpr int SUM_LANES = 4;

struct Sums {
    double *emitted;        // (L, 4) S q
    double *returned;       // (W, 4), by node: V^T D (q - the light that a pixel would choose); bounded only
    double squared;         // of predicted minus wanted camera values; bounded only
};

// S D^-1 of the target, black not subtracted.
KERNEL_DECLARE(void sum_row(const Pixels &pixels, const Frame &frame, std::int64_t row, Sums &sums))
// What the bounded optimum's conditions need of the light that the pixels choose (docs/explanation/live-frames.md).
KERNEL_DECLARE(void step_row(const Pixels &pixels, const Frame &frame, std::int64_t row, Sums &sums))
// The projector's codes; returns how many channels lie beyond the span.
KERNEL_DECLARE(std::int64_t code_row(const Pixels &pixels, const Frame &frame, bool bounded, std::int64_t row))
// Rows of 16-bit numbers, each in units of its own (sim/frame/packed.py).
struct Matrix {
    const std::int16_t *entries;
    const float *unit;
    std::int64_t rows, columns;
};

// out += matrix^T x for the rows begin ... end; and one row times x.
KERNEL_DECLARE(void add_rows(const Matrix &matrix, const float *x, std::int64_t begin, std::int64_t end, float *out))
KERNEL_DECLARE(float product_row(const Matrix &matrix, std::int64_t row, const float *x))

}  // namespace kernel::frame
