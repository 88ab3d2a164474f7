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

// Wider and narrower integers: compilers take these apart instead of using the one instruction.
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

inline Bytes narrowed(const Ints &numbers) {
#if defined(__AVX512F__)
    return same_bits<Bytes>(_mm512_cvtepi32_epi8(same_bits<__m512i>(numbers)));
#else
    return __builtin_convertvector(__builtin_convertvector(numbers, Halves), Bytes);
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

// Packed numbers (sim/frame_packed.py) in units of their layer.
inline Floats unpacked(const std::uint16_t *bits, int n) {
    constexpr std::uint32_t TOE_BITS = 0x3b800000;
    constexpr float TOE = 1.0f / 256;
    const Words words = widened(load<Halves>(bits, n));
    return same_bits<Floats>((words << 10) + TOE_BITS) - TOE;
}

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

// The channels of n pixels' interleaved codes.
struct Codes {
    Ints channel[BANDS];
};

#if defined(__AVX512F__) && defined(__AVX512BW__)
// Within four pixels of twelve bytes, which a quarter of a vector holds.
inline __m512i by_quarter(std::int32_t a, std::int32_t b, std::int32_t c, std::int32_t d) {
    return _mm512_broadcast_i32x4(_mm_setr_epi32(a, b, c, d));
}

inline Codes split(const std::uint8_t *codes, int n) {
    const __mmask64 some = n == BLOCK ? 0xffffffffffff : (std::uint64_t{1} << 3 * n) - 1;
    const __m512i quarters = _mm512_setr_epi32(0, 1, 2, 2, 3, 4, 5, 5, 6, 7, 8, 8, 9, 10, 11, 11);
    const __m512i bytes = _mm512_permutexvar_epi32(quarters, _mm512_maskz_loadu_epi8(some, codes));
    constexpr std::int32_t NONE = static_cast<std::int32_t>(0x80808000);
    Codes channels;
    for (int c = 0; c < BANDS; ++c)
        channels.channel[c] =
            same_bits<Ints>(_mm512_shuffle_epi8(bytes, by_quarter(NONE + c, NONE + 3 + c, NONE + 6 + c, NONE + 9 + c)));
    return channels;
}

inline void join(const Codes &from, int n, std::uint8_t *codes) {
    const __mmask64 some = n == BLOCK ? 0xffffffffffff : (std::uint64_t{1} << 3 * n) - 1;
    const __m512i pixels = same_bits<__m512i>(from.channel[0] | from.channel[1] << 8 | from.channel[2] << 16);
    const __m512i quarters = _mm512_shuffle_epi8(
        pixels, by_quarter(0x04020100, 0x09080605, 0x0e0d0c0a, static_cast<std::int32_t>(0x80808080)));
    const __m512i together = _mm512_setr_epi32(0, 1, 2, 4, 5, 6, 8, 9, 10, 12, 13, 14, 0, 0, 0, 0);
    _mm512_mask_storeu_epi8(codes, some, _mm512_permutexvar_epi32(together, quarters));
}
#else
inline Codes split(const std::uint8_t *codes, int n) {
    std::uint8_t some[3 * BLOCK] = {};
    if (n < BLOCK) {
        std::memcpy(some, codes, 3 * n);
        codes = some;
    }
    const Bytes a = load<Bytes>(codes), b = load<Bytes>(codes + 16), c = load<Bytes>(codes + 32);
    const Bytes r = __builtin_shufflevector(a, b, 0, 3, 6, 9, 12, 15, 18, 21, 24, 27, 30, 0, 0, 0, 0, 0);
    const Bytes g = __builtin_shufflevector(a, b, 1, 4, 7, 10, 13, 16, 19, 22, 25, 28, 31, 0, 0, 0, 0, 0);
    const Bytes u = __builtin_shufflevector(a, b, 2, 5, 8, 11, 14, 17, 20, 23, 26, 29, 0, 0, 0, 0, 0, 0);
    const Bytes red = __builtin_shufflevector(r, c, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 17, 20, 23, 26, 29);
    const Bytes green = __builtin_shufflevector(g, c, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 18, 21, 24, 27, 30);
    const Bytes blue = __builtin_shufflevector(u, c, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 16, 19, 22, 25, 28, 31);
    return {{widened(red), widened(green), widened(blue)}};
}

inline void join(const Codes &from, int n, std::uint8_t *codes) {
    const Bytes r = narrowed(from.channel[0]);
    const Bytes g = narrowed(from.channel[1]);
    const Bytes u = narrowed(from.channel[2]);
    const Bytes a = __builtin_shufflevector(r, g, 0, 16, 0, 1, 17, 0, 2, 18, 0, 3, 19, 0, 4, 20, 0, 5);
    const Bytes b = __builtin_shufflevector(r, g, 21, 0, 6, 22, 0, 7, 23, 0, 8, 24, 0, 9, 25, 0, 10, 26);
    const Bytes c = __builtin_shufflevector(r, g, 0, 11, 27, 0, 12, 28, 0, 13, 29, 0, 14, 30, 0, 15, 31, 0);
    std::uint8_t whole[3 * BLOCK];
    store(whole, __builtin_shufflevector(a, u, 0, 1, 16, 3, 4, 17, 6, 7, 18, 9, 10, 19, 12, 13, 20, 15));
    store(whole + 16, __builtin_shufflevector(b, u, 0, 21, 2, 3, 22, 5, 6, 23, 8, 9, 24, 11, 12, 25, 14, 15));
    store(whole + 32, __builtin_shufflevector(c, u, 26, 1, 2, 27, 4, 5, 28, 7, 8, 29, 10, 11, 30, 13, 14, 31));
    std::memcpy(codes, whole, 3 * n);
}
#endif

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

inline Floats same(float x) { return Floats{} + x; }

inline Floats within_unit(const Floats &x) {
#if defined(__AVX512F__)
    const __m512 above = _mm512_max_ps(same_bits<__m512>(x), _mm512_setzero_ps());
    return same_bits<Floats>(_mm512_min_ps(above, _mm512_set1_ps(1)));
#else
    const Floats above = x < 0 ? Floats{} : x;
    return above > 1 ? Floats{} + 1 : above;
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
