// Codes: what a target's ask for, and those of the projector's channels.
#pragma once
#include <cstdint>

#include "frame/frame.hpp"
#include "simd/frame_lanes.hpp"
#include "simd/frame_runs.hpp"

namespace kernel::frame::KERNEL_INSTRUCTION_SET {

namespace {

// Codes of sixteen pixels, channel by channel.
struct Codes {
    Words channel[BANDS];
};

#if defined(__AVX512VBMI__)
// Sixty-four codes' entries of a table of bytes.
inline __m512i entries(const std::uint8_t *table, const __m512i &codes) {
    const __mmask64 odd = _mm512_movepi8_mask(_mm512_add_epi8(codes, codes)), upper = _mm512_movepi8_mask(codes);
    const auto half = [&](int first) {
        const __m512i even = _mm512_permutexvar_epi8(codes, _mm512_load_si512(table + first));
        return _mm512_mask_permutexvar_epi8(even, odd, codes, _mm512_load_si512(table + first + 64));
    };
    return _mm512_mask_mov_epi8(half(0), upper, half(128));
}

// Where a channel's codes of sixty-four pixels lie in 192 bytes, in the order that unpacking bytes, then pairs, undoes.
struct Places {
    alignas(64) std::uint8_t byte[BANDS][64];
};

constexpr Places places() {
    Places at{};
    for (int channel = 0; channel < BANDS; ++channel)
        for (int k = 0; k < 64; ++k)
            at.byte[channel][k] = static_cast<std::uint8_t>(3 * (16 * (k % 16 / 4) + 4 * (k / 16) + k % 4) + channel);
    return at;
}

constexpr Places PLACES = places();

inline __m512i codes_of(const __m512i (&bytes)[3], int channel) {
    const __m512i at = _mm512_load_si512(PLACES.byte[channel]);
    const __m512i two = _mm512_permutex2var_epi8(bytes[0], at, bytes[1]);
    return _mm512_mask_permutexvar_epi8(two, _mm512_movepi8_mask(at), at, bytes[2]);
}

inline void targets(const Frame &frame, std::int64_t first, int n, Row &light) {
    constexpr int AT_ONCE = 64;
    for (int k = 0; k < n; k += AT_ONCE) {
        __m512i bytes[3];
        for (int part = 0; part < 3; ++part) {
            const int left = 3 * (n - k) - AT_ONCE * part;
            const __mmask64 some = left >= AT_ONCE ? ~std::uint64_t{} : left > 0 ? (std::uint64_t{1} << left) - 1 : 0;
            bytes[part] = _mm512_maskz_loadu_epi8(some, frame.codes + 3 * (first + k) + AT_ONCE * part);
        }
        for (int b = 0; b < BANDS; ++b) {
            const Target &target = frame.target[b];
            const __m512i codes = codes_of(bytes, b);
            const __m512i low = entries(target.bytes[0], codes), middle = entries(target.bytes[1], codes);
            const __m512i high = entries(target.bytes[2], codes), top = _mm512_set1_epi8(TARGET_TOP);
            const __m512i lower[] = {_mm512_unpacklo_epi8(low, middle), _mm512_unpackhi_epi8(low, middle)};
            const __m512i upper[] = {_mm512_unpacklo_epi8(high, top), _mm512_unpackhi_epi8(high, top)};
            for (int half = 0; half < 2; ++half) {
                const __m512i near = _mm512_unpacklo_epi16(lower[half], upper[half]);
                const __m512i far = _mm512_unpackhi_epi16(lower[half], upper[half]);
                float *to = light[b] + k + 32 * half;
                store(to, fused(same_bits<Floats>(near), same(target.unit), same(target.none)));
                store(to + BLOCK, fused(same_bits<Floats>(far), same(target.unit), same(target.none)));
            }
        }
    }
}
#endif

#if defined(__AVX512F__)
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
        channels.channel[c] = same_bits<Words>(
            _mm512_shuffle_epi8(bytes, by_quarter(NONE + c, NONE + 3 + c, NONE + 6 + c, NONE + 9 + c)));
    return channels;
}

inline void join(const Codes &from, int n, std::uint8_t *codes) {
    const __mmask64 some = n == BLOCK ? 0xffffffffffff : (std::uint64_t{1} << 3 * n) - 1;
    const Words whole = from.channel[0] | from.channel[1] << 8 | from.channel[2] << 16;
    const __m512i pixels = same_bits<__m512i>(whole);
    const __m512i quarters = _mm512_shuffle_epi8(
        pixels, by_quarter(0x04020100, 0x09080605, 0x0e0d0c0a, static_cast<std::int32_t>(0x80808080)));
    const __m512i together = _mm512_setr_epi32(0, 1, 2, 4, 5, 6, 8, 9, 10, 12, 13, 14, 0, 0, 0, 0);
    _mm512_mask_storeu_epi8(codes, some, _mm512_permutexvar_epi32(together, quarters));
}
#else
typedef std::uint8_t Bytes __attribute__((vector_size(BLOCK)));

inline Bytes bytes_at(const std::uint8_t *p) {
    Bytes bytes;
    std::memcpy(&bytes, p, sizeof bytes);
    return bytes;
}

inline Words widened(const Bytes &bytes) {
    std::uint8_t byte[BLOCK];
    std::memcpy(byte, &bytes, sizeof byte);
    return widened(byte);
}

inline Bytes narrowed(const Words &numbers) {
#if defined(__AVX2__)
    const __m256i pairs = _mm256_packus_epi32(same_bits<__m256i>(numbers.part[0]), same_bits<__m256i>(numbers.part[1]));
    const __m256i halves = _mm256_permute4x64_epi64(pairs, 0xd8);
    return same_bits<Bytes>(_mm_packus_epi16(_mm256_castsi256_si128(halves), _mm256_extracti128_si256(halves, 1)));
#else
    std::uint32_t number[BLOCK];
    store(number, numbers);
    Bytes bytes;
    for (int k = 0; k < BLOCK; ++k) bytes[k] = static_cast<std::uint8_t>(number[k]);
    return bytes;
#endif
}

inline Codes split(const std::uint8_t *codes, int n) {
    std::uint8_t some[3 * BLOCK] = {};
    if (n < BLOCK) {
        std::memcpy(some, codes, 3 * n);
        codes = some;
    }
    const Bytes a = bytes_at(codes), b = bytes_at(codes + 16), c = bytes_at(codes + 32);
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
    const Bytes x = __builtin_shufflevector(a, u, 0, 1, 16, 3, 4, 17, 6, 7, 18, 9, 10, 19, 12, 13, 20, 15);
    const Bytes y = __builtin_shufflevector(b, u, 0, 21, 2, 3, 22, 5, 6, 23, 8, 9, 24, 11, 12, 25, 14, 15);
    const Bytes z = __builtin_shufflevector(c, u, 26, 1, 2, 27, 4, 5, 28, 7, 8, 29, 10, 11, 30, 13, 14, 31);
    const Bytes all[] = {x, y, z};
    std::memcpy(codes, all, 3 * n);
}
#endif

#if !defined(__AVX512VBMI__)
// What the codes ask for, over D of 1.
inline void targets(const Frame &frame, std::int64_t first, int n, Row &light) {
    each_block(n, [&](int k, int m) {
        const Codes codes = split(frame.codes + 3 * (first + k), m);
        for (int b = 0; b < BANDS; ++b) {
            const auto *bits = reinterpret_cast<const std::int32_t *>(frame.target[b].light);
            store(light[b] + k, as_floats(entries(bits, codes.channel[b])));
        }
    });
}
#endif

// Codes of a share of the span, RESPONSE_TOE added, by the channel's table and by its cubics.
inline Floats tabled(const Channel &channel, const Floats &share) {
    const Words bits = as_words(share), entry = entries(channel.table, bits >> RESPONSE_SHIFT);
    return to_floats((entry >> 16) + (high_product(entry, bits) & 0xffff)) * same(1.0f / 256);
}

inline Floats cubic(const Channel &channel, const Floats &share) {
    const Words part = as_words(share) >> CUBIC_SHIFT;
    Floats code = picked(channel.cubics[3], part);
    for (int power = 2; power >= 0; --power) code = fused(code, share, picked(channel.cubics[power], part));
    return code;
}

template <Floats (*code_of)(const Channel &, const Floats &)>
inline void encode(const Frame &frame, const Row &shares, const Segment &at) {
    alignas(64) std::uint32_t codes[BANDS][PADDED];
    for (int c = 0; c < BANDS; ++c) {
        const Channel channel = frame.channel[c];
        const float *dither = channel.dither + (at.row & (DITHER - 1)) * DITHER;
        each_block(at.n, [&](int k, int) {
            const Floats more = load(dither + ((at.column + k) & (DITHER - 1)));
            store(codes[c] + k, to_words(code_of(channel, load(shares[c] + k)) + more));
        });
    }
    each_block(at.n, [&](int k, int n) {
        join({{load(codes[0] + k), load(codes[1] + k), load(codes[2] + k)}}, n, frame.out + 3 * (at.first + k));
    });
}

// Codes of shares of the channels' spans, RESPONSE_TOE added.
inline void encode(const Frame &frame, const Row &shares, const Segment &at) {
    if (frame.smooth)
        encode<cubic>(frame, shares, at);
    else
        encode<tabled>(frame, shares, at);
}

}  // namespace

}  // namespace kernel::frame::KERNEL_INSTRUCTION_SET
