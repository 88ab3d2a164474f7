// One register's numbers on every instruction set: 16 with AVX-512, 8 with AVX2, else 4. Each instruction is named where
// compilers find others, or none. Results are the same bits everywhere.
#pragma once
#include <cstdint>
#include <cstring>

#if defined(__AVX512F__) || defined(__AVX2__)
// GCC 12 takes its own headers' undefined lanes for a mistake.
#pragma GCC diagnostic ignored "-Wuninitialized"
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"
#include <immintrin.h>
#endif

#include "frame/frame.hpp"

// Vectors are passed within one instruction set only, where all sides agree on how.
#pragma GCC diagnostic ignored "-Wpsabi"

namespace kernel::frame::KERNEL_INSTRUCTION_SET {

namespace {

#if defined(__AVX512F__)
constexpr int LANES = 16;
#elif defined(__AVX2__)
constexpr int LANES = 8;
#else
constexpr int LANES = 4;
#endif

typedef float FloatRegister __attribute__((vector_size(4 * LANES)));
typedef std::int32_t IntRegister __attribute__((vector_size(4 * LANES)));
typedef std::uint32_t WordRegister __attribute__((vector_size(4 * LANES)));

template <class To, class From>
inline To same_bits(const From &from) {
    static_assert(sizeof(To) == sizeof(From));
    To to;
    std::memcpy(&to, &from, sizeof to);
    return to;
}

// What is done to one register's numbers. fused: a b + c, and less: c - a b, rounded once. first_lanes: a in the first n
// lanes, b in the others. counted: 1 more where a and b differ. high_product: upper 16 bits of the product of the lower 16
// bits; only the lower 16 bits count. entries: of a table; picked: of a table of 32, by the lower five bits of the index.
#if defined(__AVX512F__)
inline FloatRegister fused(const FloatRegister &a, const FloatRegister &b, const FloatRegister &c) {
    return _mm512_fmadd_ps(a, b, c);
}

inline FloatRegister less(const FloatRegister &a, const FloatRegister &b, const FloatRegister &c) {
    return _mm512_fnmadd_ps(a, b, c);
}

inline FloatRegister larger(const FloatRegister &a, const FloatRegister &b) {
    return _mm512_max_ps(a, b);
}

inline FloatRegister smaller(const FloatRegister &a, const FloatRegister &b) {
    return _mm512_min_ps(a, b);
}

inline FloatRegister first_lanes(int n, const FloatRegister &a, const FloatRegister &b) {
    const auto first = static_cast<__mmask16>((1u << n) - 1);
    return _mm512_mask_mov_ps(b, first, a);
}

inline WordRegister counted(const WordRegister &count, const FloatRegister &a, const FloatRegister &b) {
    const __mmask16 differ = _mm512_cmpneq_ps_mask(a, b);
    const __m512i before = same_bits<__m512i>(count);
    return same_bits<WordRegister>(_mm512_mask_add_epi32(before, differ, before, _mm512_set1_epi32(1)));
}

inline WordRegister high_product(const WordRegister &a, const WordRegister &b) {
    return same_bits<WordRegister>(_mm512_mulhi_epu16(same_bits<__m512i>(a), same_bits<__m512i>(b)));
}

inline WordRegister entries(const std::int32_t *table, const WordRegister &index) {
    const __m512i none = _mm512_setzero_si512();
    return same_bits<WordRegister>(_mm512_mask_i32gather_epi32(none, 0xffff, same_bits<__m512i>(index), table, 4));
}

inline FloatRegister picked(const float *table, const WordRegister &index) {
    return _mm512_permutex2var_ps(_mm512_loadu_ps(table), same_bits<__m512i>(index), _mm512_loadu_ps(table + 16));
}

inline FloatRegister broadcast(float x) { return _mm512_set1_ps(x); }

inline WordRegister widened_register(const std::uint8_t *p) {
    return same_bits<WordRegister>(_mm512_cvtepu8_epi32(_mm_loadu_si128(reinterpret_cast<const __m128i *>(p))));
}

inline WordRegister widened_register(const std::uint16_t *p) {
    return same_bits<WordRegister>(_mm512_cvtepu16_epi32(_mm256_loadu_si256(reinterpret_cast<const __m256i *>(p))));
}

inline WordRegister widened_register(const std::int16_t *p) {
    return same_bits<WordRegister>(_mm512_cvtepi16_epi32(_mm256_loadu_si256(reinterpret_cast<const __m256i *>(p))));
}
#elif defined(__AVX2__)
inline FloatRegister fused(const FloatRegister &a, const FloatRegister &b, const FloatRegister &c) {
    return _mm256_fmadd_ps(a, b, c);
}

inline FloatRegister less(const FloatRegister &a, const FloatRegister &b, const FloatRegister &c) {
    return _mm256_fnmadd_ps(a, b, c);
}

inline FloatRegister larger(const FloatRegister &a, const FloatRegister &b) {
    return _mm256_max_ps(a, b);
}

inline FloatRegister smaller(const FloatRegister &a, const FloatRegister &b) {
    return _mm256_min_ps(a, b);
}

inline WordRegister high_product(const WordRegister &a, const WordRegister &b) {
    return same_bits<WordRegister>(_mm256_mulhi_epu16(same_bits<__m256i>(a), same_bits<__m256i>(b)));
}

inline WordRegister entries(const std::int32_t *table, const WordRegister &index) {
    return same_bits<WordRegister>(_mm256_i32gather_epi32(table, same_bits<__m256i>(index), 4));
}

inline FloatRegister broadcast(float x) { return _mm256_set1_ps(x); }

inline WordRegister widened_register(const std::uint8_t *p) {
    return same_bits<WordRegister>(_mm256_cvtepu8_epi32(_mm_loadl_epi64(reinterpret_cast<const __m128i *>(p))));
}

inline WordRegister widened_register(const std::uint16_t *p) {
    return same_bits<WordRegister>(_mm256_cvtepu16_epi32(_mm_loadu_si128(reinterpret_cast<const __m128i *>(p))));
}

inline WordRegister widened_register(const std::int16_t *p) {
    return same_bits<WordRegister>(_mm256_cvtepi16_epi32(_mm_loadu_si128(reinterpret_cast<const __m128i *>(p))));
}
#else
inline FloatRegister fused(const FloatRegister &a, const FloatRegister &b, const FloatRegister &c) {
    FloatRegister sum;
    for (int k = 0; k < LANES; ++k) sum[k] = __builtin_fmaf(a[k], b[k], c[k]);
    return sum;
}

inline FloatRegister less(const FloatRegister &a, const FloatRegister &b, const FloatRegister &c) {
    return fused(-a, b, c);
}

inline FloatRegister larger(const FloatRegister &a, const FloatRegister &b) { return a > b ? a : b; }

inline FloatRegister smaller(const FloatRegister &a, const FloatRegister &b) { return a < b ? a : b; }

inline WordRegister high_product(const WordRegister &a, const WordRegister &b) {
    return ((a & 0xffff) * (b & 0xffff)) >> 16;
}

inline WordRegister entries(const std::int32_t *table, const WordRegister &index) {
    WordRegister value;
    for (int k = 0; k < LANES; ++k) {
        std::uint32_t bits;
        std::memcpy(&bits, table + static_cast<std::int32_t>(index[k]), sizeof bits);
        value[k] = bits;
    }
    return value;
}

inline FloatRegister broadcast(float x) { return FloatRegister{x, x, x, x}; }

template <class Narrow>
inline WordRegister widened_register(const Narrow *p) {
    WordRegister value;
    for (int k = 0; k < LANES; ++k) value[k] = static_cast<std::uint32_t>(std::int32_t{p[k]});
    return value;
}
#endif

#if !defined(__AVX512F__)
inline FloatRegister first_lanes(int n, const FloatRegister &a, const FloatRegister &b) {
    IntRegister lane;
    for (int k = 0; k < LANES; ++k) lane[k] = k;
    return lane < n ? a : b;
}

inline WordRegister counted(const WordRegister &count, const FloatRegister &a, const FloatRegister &b) {
    return count - same_bits<WordRegister>(a != b);
}

inline FloatRegister picked(const float *table, const WordRegister &index) {
    return same_bits<FloatRegister>(entries(reinterpret_cast<const std::int32_t *>(table), index & 31));
}
#endif

inline FloatRegister within(const FloatRegister &x, float least, float most) {
    return smaller(larger(x, broadcast(least)), broadcast(most));
}

inline FloatRegister where_positive(const FloatRegister &x, const FloatRegister &a) {
    return x > 0 ? a : FloatRegister{};
}

inline FloatRegister as_floats(const WordRegister &bits) { return same_bits<FloatRegister>(bits); }

inline WordRegister as_words(const FloatRegister &numbers) { return same_bits<WordRegister>(numbers); }

// Whole numbers, signed.
inline FloatRegister to_floats(const WordRegister &numbers) {
    return __builtin_convertvector(same_bits<IntRegister>(numbers), FloatRegister);
}

inline WordRegister to_words(const FloatRegister &numbers) {
    return same_bits<WordRegister>(__builtin_convertvector(numbers, IntRegister));
}

}  // namespace

}  // namespace kernel::frame::KERNEL_INSTRUCTION_SET
