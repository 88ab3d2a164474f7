// A frame's rows: target codes in, sums over patches or projector codes out. sim/frame_reference.py defines them.
#pragma once
#include <cstdint>

#include "level.hpp"

namespace kernel::frame {

constexpr int BANDS = 3, SEGMENT = 256, BLOCK = 16, DITHER = 64;

// Packed numbers of each band (sim/frame_packed.py), and what 1 stands for.
struct Layers {
    const std::uint16_t *band[BANDS];
    float unit[BANDS];
};

// Runs of pixels of a row (sim/frame_runs.py).
struct Runs {
    const std::int32_t *row, *start, *value;
};

// Arrays of pixels, row by row.
struct Pixels {
    std::int64_t height, width, n_lit, n_viewed;
    Layers inverse, offset, gain, emission;
    const std::uint8_t *place_x, *place_y; // in the cell, in 255ths
    Runs patches, cells;
    const std::int32_t *corners;           // (cells, 4) viewed patches
};

// What differs from frame to frame, and small tables. Light of a band is in a unit of its own, in which what is added
// up a pixel needs no factors; that of a channel is a share of its span, the light of the highest code. Units of the
// packed layers are in these numbers, not in what a pixel reads.
struct Frame {
    const std::uint8_t *codes;
    const float *target;           // (3, 256) camera value of each code, over D of 1
    const float *cells;            // (cells, 3, 4) irradiance at the first corner, and by how much it rises along x, y, both
    const float *pull;             // (3, L) H^T V^T (predicted - wanted), emission as of the first band; bounded only
    float channels[BANDS][BANDS];  // [channel][band] K^-1
    float light[BANDS][BANDS];     // [band][channel] K
    float weight[BANDS];           // squared camera value of light where D is 1
    bool mixed;                    // K is not the identity
    int rounds;                    // over the channels, to bound their light together
    const std::int32_t *response[BANDS]; // (RESPONSE) code and step, both in 256ths, by the bits of a share of the span
    const std::uint8_t *dither;    // (3, 64, 64)
    std::uint8_t *out;
};

// Share p of the span: bits of p + TOE, 128 steps an octave from TOE on.
constexpr int RESPONSE = 14 * 128 + 2, RESPONSE_SHIFT = 16;
constexpr float RESPONSE_TOE = 1.0f / (1 << 14);

// Sums of a chunk of rows.
struct Sums {
    double *emitted;        // (3, L) S q
    double *returned;       // (3, W) V^T D (q - the light that a pixel would choose); bounded only
    double squared;         // of predicted minus wanted camera values; bounded only
    std::int64_t clipped;   // channels beyond the span
};

// S D^-1 of the target, black not subtracted.
KERNEL_DECLARE(void sum_row(const Pixels &pixels, const Frame &frame, std::int64_t row, Sums &sums))
// What the bounded optimum's conditions need of the light that the pixels choose (docs/explanation/live-frames.md).
KERNEL_DECLARE(void step_row(const Pixels &pixels, const Frame &frame, std::int64_t row, Sums &sums))
// The projector's codes.
KERNEL_DECLARE(void code_row(const Pixels &pixels, const Frame &frame, bool bounded, std::int64_t row, Sums &sums))
// Rows of 16-bit numbers, each in units of its own (sim/frame_packed.py).
struct Matrix {
    const std::int16_t *entries;
    const float *unit;
    std::int64_t rows, columns;
};

// out = matrix^T x for the columns begin ... end; and one row times x.
KERNEL_DECLARE(void product_columns(const Matrix &matrix, const float *x, std::int64_t begin, std::int64_t end,
                                    float *out))
KERNEL_DECLARE(float product_row(const Matrix &matrix, std::int64_t row, const float *x))

}  // namespace kernel::frame
