// What the frame kernel does to sixteen numbers: packed ones, reciprocals, sums over lanes.
#pragma once
#include <cstdint>
#include <cstring>

#include "frame/frame.hpp"
#include "simd/frame_vectors.hpp"

namespace kernel::frame::KERNEL_INSTRUCTION_SET {

namespace {

// Packed numbers (sim/frame/packed.py), in units of PACKED_ONE of their layer: no more than a shift.
inline Floats packed(const std::uint16_t *bits, int n) { return as_floats(widened(bits, n) << 11); }

// The same in units of their layer.
inline Floats unpacked(const std::uint16_t *bits, int n) { return packed(bits, n) * same(PACKED_ONE); }

// 1 / x for normal numbers above 0, off by at most 2e-6 of itself: a guess by the exponent, two of Newton's steps.
// Division takes as long as a dozen other operations.
inline Floats reciprocal(const Floats &x) {
    Floats guess = as_floats(same(0x7ef311c7u) - as_words(x));
    for (int step = 0; step < 2; ++step) guess = fused(guess, less(x, guess, same(1.0f)), guess);
    return guess;
}

typedef float Eight __attribute__((vector_size(32)));
typedef float Four __attribute__((vector_size(16)));

inline Eight halves_sum(const Floats &lanes) {
#if defined(__AVX512F__)
    return __builtin_shufflevector(lanes, lanes, 0, 1, 2, 3, 4, 5, 6, 7) +
           __builtin_shufflevector(lanes, lanes, 8, 9, 10, 11, 12, 13, 14, 15);
#else
    Eight half[2];
    std::memcpy(half, &lanes, sizeof half);
    return half[0] + half[1];
#endif
}

// Sums of four vectors' lanes.
inline Four lanes_sums(const Floats &a, const Floats &b, const Floats &c, const Floats &d) {
    const auto pairs = [](const Eight &x, const Eight &y) {
        return __builtin_shufflevector(x, y, 0, 8, 1, 9, 4, 12, 5, 13) +
               __builtin_shufflevector(x, y, 2, 10, 3, 11, 6, 14, 7, 15);
    };
    const Eight ab = pairs(halves_sum(a), halves_sum(b)), cd = pairs(halves_sum(c), halves_sum(d));
    const Eight all = __builtin_shufflevector(ab, cd, 0, 1, 8, 9, 4, 5, 12, 13) +
                      __builtin_shufflevector(ab, cd, 2, 3, 10, 11, 6, 7, 14, 15);
    return __builtin_shufflevector(all, all, 0, 1, 2, 3) + __builtin_shufflevector(all, all, 4, 5, 6, 7);
}

// Sums of the lanes of three vectors, four times; the last lanes are 0.
struct FourSums {
    Four of[4];
};

inline FourSums lanes_sums(const Floats (&a)[BANDS], const Floats (&b)[BANDS], const Floats (&c)[BANDS],
                           const Floats (&d)[BANDS]) {
#if defined(__AVX512F__)
    // The same additions, for all four at once.
    const auto halves = [](const Floats &x, const Floats &y) {
        return Floats(_mm512_shuffle_f32x4(x, y, 0x44)) + Floats(_mm512_shuffle_f32x4(x, y, 0xee));
    };
    const auto pairs = [](const Floats &x, const Floats &y) {
        return Floats(_mm512_unpacklo_ps(x, y)) + Floats(_mm512_unpackhi_ps(x, y));
    };
    const auto quarters = [&](const Floats (&x)[BANDS], const Floats (&y)[BANDS]) {
        const Floats two = pairs(halves(x[0], y[0]), halves(x[1], y[1])), one = pairs(halves(x[2], y[2]), Floats{});
        return Floats(_mm512_shuffle_ps(two, one, 0x44)) + Floats(_mm512_shuffle_ps(two, one, 0xee));
    };
    const Floats ab = quarters(a, b), cd = quarters(c, d);
    return same_bits<FourSums>(Floats(_mm512_shuffle_f32x4(ab, cd, 0x88)) + Floats(_mm512_shuffle_f32x4(ab, cd, 0xdd)));
#else
    const Floats none{};
    return {{lanes_sums(a[0], a[1], a[2], none), lanes_sums(b[0], b[1], b[2], none),
             lanes_sums(c[0], c[1], c[2], none), lanes_sums(d[0], d[1], d[2], none)}};
#endif
}

// to += four numbers.
inline void add_four(double *to, const Four &numbers) {
    typedef double FourDoubles __attribute__((vector_size(32)));
    FourDoubles sum;
    std::memcpy(&sum, to, sizeof sum);
    sum += __builtin_convertvector(numbers, FourDoubles);
    std::memcpy(to, &sum, sizeof sum);
}

inline float lanes_sum(const Floats &lanes) {
    const Eight eight = halves_sum(lanes);
    const Four four =
        __builtin_shufflevector(eight, eight, 0, 1, 2, 3) + __builtin_shufflevector(eight, eight, 4, 5, 6, 7);
    const Four two = four + __builtin_shufflevector(four, four, 2, 3, 0, 1);
    return two[0] + two[1];
}

}  // namespace

}  // namespace kernel::frame::KERNEL_INSTRUCTION_SET
