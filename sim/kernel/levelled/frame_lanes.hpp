// Sixteen pixels at a time: loads that stop at a row's end, packed numbers, tables.
#pragma once
#include <cstdint>
#include <cstring>

#if defined(__AVX512F__) || defined(__AVX2__)
// GCC 12 takes its own headers' undefined lanes for a mistake.
#pragma GCC diagnostic ignored "-Wuninitialized"
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"
#include <immintrin.h>
#endif

#include "frame.hpp"

// Vectors are passed within one level only, where all sides agree on how.
#pragma GCC diagnostic ignored "-Wpsabi"

namespace kernel::frame::KERNEL_LEVEL {

typedef float Floats __attribute__((vector_size(4 * BLOCK)));
typedef std::int32_t Ints __attribute__((vector_size(4 * BLOCK)));
typedef std::uint32_t Words __attribute__((vector_size(4 * BLOCK)));
typedef std::uint16_t Halves __attribute__((vector_size(2 * BLOCK)));
typedef std::int16_t Shorts __attribute__((vector_size(2 * BLOCK)));
typedef std::uint8_t Bytes __attribute__((vector_size(BLOCK)));

namespace {

// The first n of 16 numbers, 0 in the other lanes.
template <class Vector, class T>
inline Vector load(const T *p, int n = BLOCK) {
    static_assert(sizeof(Vector) == BLOCK * sizeof(T));
    Vector v{};
    if (n == BLOCK)
        std::memcpy(&v, p, sizeof v);
    else
        std::memcpy(&v, p, n * sizeof(T));
    return v;
}

template <class T, class Vector>
inline void store(T *p, const Vector &v) {
    static_assert(sizeof(Vector) == BLOCK * sizeof(T));
    std::memcpy(p, &v, sizeof v);
}

template <class To, class From>
inline To same_bits(const From &from) {
    static_assert(sizeof(To) == sizeof(From));
    To to;
    std::memcpy(&to, &from, sizeof to);
    return to;
}

// One number in all lanes. Adding it to zeros would be an addition: 0 + -0 is 0.
inline Floats same(float x) { return Floats{x, x, x, x, x, x, x, x, x, x, x, x, x, x, x, x}; }

// Wider integers: compilers take these apart instead of using the one instruction.
inline Ints widened(const Bytes &bytes) {
#if defined(__AVX512F__)
    return same_bits<Ints>(_mm512_cvtepu8_epi32(same_bits<__m128i>(bytes)));
#else
    return __builtin_convertvector(__builtin_convertvector(bytes, Halves), Ints);
#endif
}

inline Words widened(const Halves &halves) {
#if defined(__AVX512F__)
    return same_bits<Words>(_mm512_cvtepu16_epi32(same_bits<__m256i>(halves)));
#else
    return __builtin_convertvector(halves, Words);
#endif
}

// Upper 16 bits of the product of a's lower 16 bits and b < 2^16.
inline Words high_product(const Words &a, const Words &b) {
#if defined(__AVX512F__)
    return same_bits<Words>(_mm512_mulhi_epu16(same_bits<__m512i>(a), same_bits<__m512i>(b)));
#else
    return ((a & 0xffff) * b) >> 16;
#endif
}

inline Ints widened(const Shorts &shorts) {
#if defined(__AVX512F__)
    return same_bits<Ints>(_mm512_cvtepi16_epi32(same_bits<__m256i>(shorts)));
#else
    return __builtin_convertvector(shorts, Ints);
#endif
}

// Packed numbers (sim/frame_packed.py), in units of PACKED_ONE of their layer: no more than a shift.
inline Floats packed(const std::uint16_t *bits, int n) {
    return same_bits<Floats>(widened(load<Halves>(bits, n)) << 11);
}

// The same in units of their layer.
inline Floats unpacked(const std::uint16_t *bits, int n) { return packed(bits, n) * PACKED_ONE; }

// table[index]. Compilers tuned for any processor avoid the instruction.
inline Ints entries(const std::int32_t *table, const Ints &index) {
#if defined(__AVX512F__)
    const auto none = _mm512_setzero_si512();
    return same_bits<Ints>(_mm512_mask_i32gather_epi32(none, 0xffff, same_bits<__m512i>(index), table, 4));
#elif defined(__AVX2__)
    __m256i half[2];
    std::memcpy(half, &index, sizeof half);
    for (auto &each : half) each = _mm256_i32gather_epi32(table, each, 4);
    return same_bits<Ints>(half);
#else
    Ints value;
    for (int k = 0; k < BLOCK; ++k) value[k] = table[index[k]];
    return value;
#endif
}

inline Floats entries(const float *table, const Ints &index) {
    return same_bits<Floats>(entries(reinterpret_cast<const std::int32_t *>(table), index));
}

// The same for a table of 32, by the lower five bits of the index.
inline Floats picked(const float *table, const Ints &index) {
#if defined(__AVX512F__)
    return same_bits<Floats>(_mm512_permutex2var_ps(_mm512_loadu_ps(table), same_bits<__m512i>(index),
                                                    _mm512_loadu_ps(table + 16)));
#else
    return entries(table, index & 31);
#endif
}

// a b + c, rounded once, on every instruction set alike.
inline Floats fused(const Floats &a, const Floats &b, const Floats &c) {
#if defined(__AVX512F__)
    return same_bits<Floats>(_mm512_fmadd_ps(same_bits<__m512>(a), same_bits<__m512>(b), same_bits<__m512>(c)));
#elif defined(__FMA__)
    __m256 x[2], y[2], z[2];
    std::memcpy(x, &a, sizeof x), std::memcpy(y, &b, sizeof y), std::memcpy(z, &c, sizeof z);
    for (int half = 0; half < 2; ++half) z[half] = _mm256_fmadd_ps(x[half], y[half], z[half]);
    return same_bits<Floats>(z);
#else
    Floats sum;
    for (int k = 0; k < BLOCK; ++k) sum[k] = __builtin_fmaf(a[k], b[k], c[k]);
    return sum;
#endif
}

// c - a b, rounded once.
inline Floats less(const Floats &a, const Floats &b, const Floats &c) {
#if defined(__AVX512F__)
    return same_bits<Floats>(_mm512_fnmadd_ps(same_bits<__m512>(a), same_bits<__m512>(b), same_bits<__m512>(c)));
#else
    return fused(-a, b, c);
#endif
}

// 1 / x for normal numbers above 0, off by at most 2e-6 of itself: a guess by the exponent, two of Newton's steps.
// Division takes as long as a dozen other operations.
inline Floats reciprocal(const Floats &x) {
    Floats guess = same_bits<Floats>(0x7ef311c7 - same_bits<Words>(x));
    for (int step = 0; step < 2; ++step) guess = fused(guess, less(x, guess, same(1)), guess);
    return guess;
}

inline Floats within(const Floats &x, float least, float most) {
#if defined(__AVX512F__)
    const __m512 above = _mm512_max_ps(same_bits<__m512>(x), _mm512_set1_ps(least));
    return same_bits<Floats>(_mm512_min_ps(above, _mm512_set1_ps(most)));
#else
    const Floats above = x < least ? same(least) : x;
    return above > most ? same(most) : above;
#endif
}

// Adds 1 to the count of each lane in which two numbers differ.
inline void count_different(const Floats &a, const Floats &b, Ints &count) {
#if defined(__AVX512F__)
    const __mmask16 differ = _mm512_cmpneq_ps_mask(same_bits<__m512>(a), same_bits<__m512>(b));
    const __m512i before = same_bits<__m512i>(count);
    count = same_bits<Ints>(_mm512_mask_add_epi32(before, differ, before, _mm512_set1_epi32(1)));
#else
    count -= a != b;
#endif
}

typedef float Eight __attribute__((vector_size(32)));
typedef float Four __attribute__((vector_size(16)));

inline Eight halves_sum(const Floats &lanes) {
    return __builtin_shufflevector(lanes, lanes, 0, 1, 2, 3, 4, 5, 6, 7) +
           __builtin_shufflevector(lanes, lanes, 8, 9, 10, 11, 12, 13, 14, 15);
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

inline float lanes_sum(const Floats &lanes) {
    const Eight eight = halves_sum(lanes);
    const Four four = __builtin_shufflevector(eight, eight, 0, 1, 2, 3) + __builtin_shufflevector(eight, eight, 4, 5, 6, 7);
    const Four two = four + __builtin_shufflevector(four, four, 2, 3, 0, 1);
    return two[0] + two[1];
}

inline Ints lane_numbers() { return Ints{0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15}; }

}  // namespace

}  // namespace kernel::frame::KERNEL_LEVEL
