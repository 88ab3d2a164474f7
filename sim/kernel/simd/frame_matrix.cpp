// Products of patch size for a frame, of matrices in 16 bits. Sums run in fixed lanes: every instruction set gives the
// same bits.
#include <algorithm>

#include "frame/frame.hpp"
#include "simd/frame_lanes.hpp"

namespace kernel::frame::KERNEL_INSTRUCTION_SET {

namespace {

inline Floats numbers(const std::int16_t *entries) {
    return to_floats(widened(entries));
}

}  // namespace

void add_rows(const Matrix &matrix, const float *x, std::int64_t begin, std::int64_t end, float *out) {
    constexpr int AT_ONCE = 4;
    for (std::int64_t first = begin; first < end; first += AT_ONCE) {
        const std::int16_t *rows[AT_ONCE];
        float factor[AT_ONCE];
        for (int r = 0; r < AT_ONCE; ++r) {
            const std::int64_t row = std::min(first + r, end - 1);
            rows[r] = matrix.entries + row * matrix.columns;
            factor[r] = first + r < end ? x[row] * matrix.unit[row] : 0;
        }
        std::int64_t k = 0;
        for (; k + BLOCK <= matrix.columns; k += BLOCK) {
            Floats sum = load(out + k);
            for (int r = 0; r < AT_ONCE; ++r) sum = fused(numbers(rows[r] + k), same(factor[r]), sum);
            store(out + k, sum);
        }
        for (; k < matrix.columns; ++k)
            for (int r = 0; r < AT_ONCE; ++r) out[k] += static_cast<float>(rows[r][k]) * factor[r];
    }
}

float product_row(const Matrix &matrix, std::int64_t row, const float *x) {
    const std::int16_t *entries = matrix.entries + row * matrix.columns;
    Floats a{}, b{}, c{}, d{};
    float rest = 0;
    std::int64_t k = 0;
    for (; k + 4 * BLOCK <= matrix.columns; k += 4 * BLOCK) {
        a = fused(numbers(entries + k), load(x + k), a);
        b = fused(numbers(entries + k + BLOCK), load(x + k + BLOCK), b);
        c = fused(numbers(entries + k + 2 * BLOCK), load(x + k + 2 * BLOCK), c);
        d = fused(numbers(entries + k + 3 * BLOCK), load(x + k + 3 * BLOCK), d);
    }
    for (; k < matrix.columns; ++k) rest += static_cast<float>(entries[k]) * x[k];
    return (lanes_sum((a + b) + (c + d)) + rest) * matrix.unit[row];
}

}  // namespace kernel::frame::KERNEL_INSTRUCTION_SET
