// Sixteen numbers at a time on every instruction set: one register with AVX-512, two with AVX2, else four. Compilers
// take vectors that fit no register apart, number by number at times. Results are the same bits everywhere.
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
    return same_bits<FloatRegister>(_mm512_fmadd_ps(same_bits<__m512>(a), same_bits<__m512>(b), same_bits<__m512>(c)));
}

inline FloatRegister less(const FloatRegister &a, const FloatRegister &b, const FloatRegister &c) {
    return same_bits<FloatRegister>(_mm512_fnmadd_ps(same_bits<__m512>(a), same_bits<__m512>(b), same_bits<__m512>(c)));
}

inline FloatRegister larger(const FloatRegister &a, const FloatRegister &b) {
    return same_bits<FloatRegister>(_mm512_max_ps(same_bits<__m512>(a), same_bits<__m512>(b)));
}

inline FloatRegister smaller(const FloatRegister &a, const FloatRegister &b) {
    return same_bits<FloatRegister>(_mm512_min_ps(same_bits<__m512>(a), same_bits<__m512>(b)));
}

inline FloatRegister first_lanes(int n, const FloatRegister &a, const FloatRegister &b) {
    const auto first = static_cast<__mmask16>((1u << n) - 1);
    return same_bits<FloatRegister>(_mm512_mask_mov_ps(same_bits<__m512>(b), first, same_bits<__m512>(a)));
}

inline WordRegister counted(const WordRegister &count, const FloatRegister &a, const FloatRegister &b) {
    const __mmask16 differ = _mm512_cmpneq_ps_mask(same_bits<__m512>(a), same_bits<__m512>(b));
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
    return same_bits<FloatRegister>(_mm512_permutex2var_ps(_mm512_loadu_ps(table), same_bits<__m512i>(index),
                                                           _mm512_loadu_ps(table + 16)));
}

inline FloatRegister broadcast(float x) { return same_bits<FloatRegister>(_mm512_set1_ps(x)); }

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
    return same_bits<FloatRegister>(_mm256_fmadd_ps(same_bits<__m256>(a), same_bits<__m256>(b), same_bits<__m256>(c)));
}

inline FloatRegister less(const FloatRegister &a, const FloatRegister &b, const FloatRegister &c) {
    return same_bits<FloatRegister>(_mm256_fnmadd_ps(same_bits<__m256>(a), same_bits<__m256>(b), same_bits<__m256>(c)));
}

inline FloatRegister larger(const FloatRegister &a, const FloatRegister &b) {
    return same_bits<FloatRegister>(_mm256_max_ps(same_bits<__m256>(a), same_bits<__m256>(b)));
}

inline FloatRegister smaller(const FloatRegister &a, const FloatRegister &b) {
    return same_bits<FloatRegister>(_mm256_min_ps(same_bits<__m256>(a), same_bits<__m256>(b)));
}

inline WordRegister high_product(const WordRegister &a, const WordRegister &b) {
    return same_bits<WordRegister>(_mm256_mulhi_epu16(same_bits<__m256i>(a), same_bits<__m256i>(b)));
}

inline WordRegister entries(const std::int32_t *table, const WordRegister &index) {
    return same_bits<WordRegister>(_mm256_i32gather_epi32(table, same_bits<__m256i>(index), 4));
}

inline FloatRegister broadcast(float x) { return same_bits<FloatRegister>(_mm256_set1_ps(x)); }

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

#if defined(__AVX512F__)
typedef FloatRegister Floats;
typedef WordRegister Words;

inline Floats same(float x) { return broadcast(x); }

inline Words same(std::uint32_t x) { return Words{} + x; }

inline Floats load(const float *p) {
    Floats all;
    std::memcpy(&all, p, sizeof all);
    return all;
}

inline Words load(const std::uint32_t *p) {
    Words all;
    std::memcpy(&all, p, sizeof all);
    return all;
}

inline void store(float *p, const Floats &all) { std::memcpy(p, &all, sizeof all); }

inline void store(std::uint32_t *p, const Words &all) { std::memcpy(p, &all, sizeof all); }

template <class Narrow>
inline Words widened(const Narrow *p) {
    return widened_register(p);
}
#else
// Sixteen numbers in several registers.
template <class Register>
struct Lanes {
    Register part[BLOCK / LANES];
};

typedef Lanes<FloatRegister> Floats;
typedef Lanes<WordRegister> Words;

// What work gives for each register.
template <class To, class Work, class... From>
inline Lanes<To> by_parts(const Work &work, const Lanes<From> &...from) {
    Lanes<To> to;
    for (int k = 0; k < BLOCK / LANES; ++k) to.part[k] = work(from.part[k]...);
    return to;
}

template <class R>
inline Lanes<R> operator+(const Lanes<R> &a, const Lanes<R> &b) {
    return by_parts<R>([](const R &x, const R &y) { return x + y; }, a, b);
}

template <class R>
inline Lanes<R> operator-(const Lanes<R> &a, const Lanes<R> &b) {
    return by_parts<R>([](const R &x, const R &y) { return x - y; }, a, b);
}

template <class R>
inline Lanes<R> operator*(const Lanes<R> &a, const Lanes<R> &b) {
    return by_parts<R>([](const R &x, const R &y) { return x * y; }, a, b);
}

template <class R>
inline Lanes<R> &operator+=(Lanes<R> &a, const Lanes<R> &b) {
    return a = a + b;
}

inline Words operator|(const Words &a, const Words &b) {
    return by_parts<WordRegister>([](const WordRegister &x, const WordRegister &y) { return x | y; }, a, b);
}

inline Words operator&(const Words &a, std::uint32_t mask) {
    return by_parts<WordRegister>([mask](const WordRegister &x) { return x & mask; }, a);
}

inline Words operator<<(const Words &a, int bits) {
    return by_parts<WordRegister>([bits](const WordRegister &x) { return x << bits; }, a);
}

inline Words operator>>(const Words &a, int bits) {
    return by_parts<WordRegister>([bits](const WordRegister &x) { return x >> bits; }, a);
}

inline Floats fused(const Floats &a, const Floats &b, const Floats &c) {
    typedef FloatRegister R;
    return by_parts<R>([](const R &x, const R &y, const R &z) { return fused(x, y, z); }, a, b, c);
}

inline Floats less(const Floats &a, const Floats &b, const Floats &c) {
    typedef FloatRegister R;
    return by_parts<R>([](const R &x, const R &y, const R &z) { return less(x, y, z); }, a, b, c);
}

inline Floats within(const Floats &x, float least, float most) {
    return by_parts<FloatRegister>([=](const FloatRegister &v) { return within(v, least, most); }, x);
}

inline Floats where_positive(const Floats &x, const Floats &a) {
    typedef FloatRegister R;
    return by_parts<R>([](const R &v, const R &w) { return where_positive(v, w); }, x, a);
}

inline Floats first_lanes(int n, const Floats &a, const Floats &b) {
    Floats both;
    for (int k = 0; k < BLOCK / LANES; ++k) both.part[k] = first_lanes(n - k * LANES, a.part[k], b.part[k]);
    return both;
}

inline Words counted(const Words &count, const Floats &a, const Floats &b) {
    typedef FloatRegister R;
    return by_parts<WordRegister>([](const WordRegister &c, const R &x, const R &y) { return counted(c, x, y); },
                                  count, a, b);
}

inline Words high_product(const Words &a, const Words &b) {
    typedef WordRegister R;
    return by_parts<R>([](const R &x, const R &y) { return high_product(x, y); }, a, b);
}

inline Words entries(const std::int32_t *table, const Words &index) {
    return by_parts<WordRegister>([table](const WordRegister &x) { return entries(table, x); }, index);
}

inline Floats picked(const float *table, const Words &index) {
    return by_parts<FloatRegister>([table](const WordRegister &x) { return picked(table, x); }, index);
}

inline Floats as_floats(const Words &bits) {
    return by_parts<FloatRegister>([](const WordRegister &x) { return as_floats(x); }, bits);
}

inline Words as_words(const Floats &numbers) {
    return by_parts<WordRegister>([](const FloatRegister &x) { return as_words(x); }, numbers);
}

inline Floats to_floats(const Words &numbers) {
    return by_parts<FloatRegister>([](const WordRegister &x) { return to_floats(x); }, numbers);
}

inline Words to_words(const Floats &numbers) {
    return by_parts<WordRegister>([](const FloatRegister &x) { return to_words(x); }, numbers);
}

inline Floats same(float x) {
    Floats all;
    for (FloatRegister &part : all.part) part = broadcast(x);
    return all;
}

inline Words same(std::uint32_t x) {
    Words all;
    for (WordRegister &part : all.part) part = WordRegister{} + x;
    return all;
}

template <class R, class T>
inline Lanes<R> loaded(const T *p) {
    Lanes<R> all;
    for (int k = 0; k < BLOCK / LANES; ++k) std::memcpy(&all.part[k], p + k * LANES, sizeof all.part[k]);
    return all;
}

inline Floats load(const float *p) { return loaded<FloatRegister>(p); }

inline Words load(const std::uint32_t *p) { return loaded<WordRegister>(p); }

template <class T, class R>
inline void store(T *p, const Lanes<R> &all) {
    for (int k = 0; k < BLOCK / LANES; ++k) std::memcpy(p + k * LANES, &all.part[k], sizeof all.part[k]);
}

template <class Narrow>
inline Words widened(const Narrow *p) {
    Words all;
    for (int k = 0; k < BLOCK / LANES; ++k) all.part[k] = widened_register(p + k * LANES);
    return all;
}
#endif

// The first n of sixteen narrow numbers as wide ones, 0 in the other lanes.
template <class Narrow>
inline Words widened(const Narrow *p, int n) {
    if (n == BLOCK) return widened(p);
    Narrow some[BLOCK] = {};
    std::memcpy(some, p, n * sizeof(Narrow));
    return widened(some);
}

}  // namespace

}  // namespace kernel::frame::KERNEL_LEVEL
