// Products of patch size for a frame, of matrices in 16 bits. Sums run in fixed lanes: every instruction set gives the
// same bits.
#include "frame.hpp"
#include "frame_lanes.hpp"

namespace kernel::frame::KERNEL_LEVEL {

namespace {

inline Floats widened(const std::int16_t *entries) {
    typedef std::int16_t Shorts __attribute__((vector_size(2 * BLOCK)));
    return __builtin_convertvector(__builtin_convertvector(load<Shorts>(entries), Ints), Floats);
}

}  // namespace

void product_columns(const Matrix &matrix, const float *x, std::int64_t begin, std::int64_t end, float *out) {
    for (std::int64_t column = begin; column < end; ++column) out[column] = 0;
    for (std::int64_t row = 0; row < matrix.rows; ++row) {
        const std::int16_t *entries = matrix.entries + row * matrix.columns;
        const float factor = x[row] * matrix.unit[row];
        for (std::int64_t column = begin; column < end; ++column)
            out[column] += static_cast<float>(entries[column]) * factor;
    }
}

float product_row(const Matrix &matrix, std::int64_t row, const float *x) {
    const std::int16_t *entries = matrix.entries + row * matrix.columns;
    Floats a{}, b{}, c{}, d{};
    float rest = 0;
    std::int64_t k = 0;
    for (; k + 4 * BLOCK <= matrix.columns; k += 4 * BLOCK) {
        a = fused(widened(entries + k), load<Floats>(x + k), a);
        b = fused(widened(entries + k + BLOCK), load<Floats>(x + k + BLOCK), b);
        c = fused(widened(entries + k + 2 * BLOCK), load<Floats>(x + k + 2 * BLOCK), c);
        d = fused(widened(entries + k + 3 * BLOCK), load<Floats>(x + k + 3 * BLOCK), d);
    }
    for (; k < matrix.columns; ++k) rest += static_cast<float>(entries[k]) * x[k];
    return (lanes_sum((a + b) + (c + d)) + rest) * matrix.unit[row];
}

}  // namespace kernel::frame::KERNEL_LEVEL
