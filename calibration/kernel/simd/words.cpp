// Some pixels of all pictures at a time: what is known of them stays in the first-level cache, and each picture comes
// from the memory once.
#include "words.hpp"

#include <algorithm>

namespace kernel::KERNEL_INSTRUCTION_SET {
namespace {

constexpr int BLOCK = 2048;  // pixels; six planes of bytes, and two of the pictures' kind
constexpr int BYTE = 8;
constexpr int OWN_LIGHT_BITS = 3;

constexpr int APART = BLOCK + 96;  // a load a page behind a store would wait for it

template <class T>
struct Block {
    std::uint8_t bits[2][APART], open[2][APART];  // low and high byte of each pixel's words
    std::uint8_t weak[APART];
    std::uint16_t word[APART], other[APART];
    T most[APART], limit[APART];
};

template <class T>
inline T larger(T a, T b) {
    return a > b ? a : b;
}

template <class T>
inline T smaller(T a, T b) {
    return a > b ? b : a;
}

template <class T>
inline T apart(T a, T b) {
    return static_cast<T>(larger(a, b) - smaller(a, b));
}

template <class T>
void add_bit(const T *__restrict lit, const T *__restrict other, const T *__restrict limit, std::uint8_t *__restrict bits,
             std::uint8_t *__restrict open, int n) {
    for (int i = 0; i < n; ++i) {
        const T a = lit[i], b = other[i];
        bits[i] = static_cast<std::uint8_t>((bits[i] + bits[i]) | (a > b));
        open[i] = static_cast<std::uint8_t>((open[i] + open[i]) | (apart(a, b) < limit[i]));
    }
}

template <class T>
void add_light(const T *__restrict lit, const T *__restrict other, T *__restrict most, int n) {
    for (int i = 0; i < n; ++i) most[i] = larger(most[i], larger(lit[i], other[i]));
}

template <class T>
void gather(const Words<T> &work, std::int64_t from, int n, Block<T> &block) {
    for (int byte = 0; byte < 2; ++byte) {
        std::fill_n(block.bits[byte], n, 0);
        std::fill_n(block.open[byte], n, 0);
    }
    std::fill_n(block.most, n, T(0));
    const T *limit = work.limit + from;
    if (work.one_limit) {
        std::fill_n(block.limit, n, *work.limit);
        limit = block.limit;
    }
    for (int k = 0; k < work.bits; ++k) {
        const int byte = k + BYTE < work.bits;
        add_bit(work.lit[k] + from, work.other[k] + from, limit, block.bits[byte], block.open[byte], n);
        if (work.saturation) add_light(work.lit[k] + from, work.other[k] + from, block.most, n);
    }
}

// Each word, and the word that the pixel has if its one open bit is the other way.
template <class T>
void join_bytes(Block<T> &block, int n) {
    const std::uint8_t *__restrict low = block.bits[0], *__restrict high = block.bits[1];
    const std::uint8_t *__restrict open_low = block.open[0], *__restrict open_high = block.open[1];
    std::uint16_t *__restrict word = block.word, *__restrict other = block.other;
    std::uint8_t *__restrict weak = block.weak;
    for (int i = 0; i < n; ++i) {
        const auto bits = static_cast<std::uint16_t>(low[i] | high[i] << BYTE);
        const auto open = static_cast<std::uint16_t>(open_low[i] | open_high[i] << BYTE);
        const bool several = static_cast<std::uint16_t>(open & (open - 1)) != 0;
        word[i] = bits;
        other[i] = several ? bits : static_cast<std::uint16_t>(bits ^ open);
        weak[i] = several;
    }
}

// Twice the position. One open bit is no harm if both its values give neighbours: the pixel is on their border.
template <class T>
void place(const Words<T> &work, std::int64_t from, int n, Block<T> &block) {
    join_bytes(block, n);
    const std::uint16_t *__restrict table = work.table;
    std::uint16_t *__restrict here = block.word, *__restrict there = block.other;
#pragma GCC unroll 4
    for (int i = 0; i < n; ++i) here[i] = table[here[i]];
#pragma GCC unroll 4
    for (int i = 0; i < n; ++i) there[i] = table[there[i]];
    std::uint16_t *__restrict twice = work.twice + from;
    std::uint8_t *__restrict weak = block.weak;
    for (int i = 0; i < n; ++i) {
        twice[i] = static_cast<std::uint16_t>(here[i] + there[i]);
        weak[i] |= apart(here[i], there[i]) > 1;
    }
}

template <class T>
inline float own_light(T a, T b, T c) {
    return static_cast<float>(larger(smaller(larger(a, b), c), smaller(a, b)));
}

// Where both frames of a wide stripe have more light than the pixel's own, no difference between them is proof.
template <class T>
void outshone(const Words<T> &work, std::int64_t from, int n, Block<T> &block) {
    T *__restrict most = block.most;
    std::fill_n(most, n, T(0));
    for (int k = 0; k < work.wide; ++k) {
        const T *__restrict lit = work.lit[k] + from, *__restrict other = work.other[k] + from;
        for (int i = 0; i < n; ++i) {
            const T darker = smaller(lit[i], other[i]);
            most[i] = k ? larger(most[i], darker) : darker;
        }
    }
    const T *const *lit = work.lit + work.wide, *const *other = work.other + work.wide;
    const T *__restrict a = lit[0] + from, *__restrict b = lit[1] + from, *__restrict c = lit[2] + from;
    const T *__restrict d = other[0] + from, *__restrict e = other[1] + from, *__restrict f = other[2] + from;
    const T *__restrict black = work.black + from;
    for (int i = 0; i < n; ++i) {
        float own = own_light(apart(a[i], d[i]), apart(b[i], e[i]), apart(c[i], f[i]));
        own = own * work.sure_share + static_cast<float>(black[i]);
        block.weak[i] |= static_cast<float>(most[i]) >= own;
    }
}

inline std::uint8_t lower(std::uint8_t reason, bool is, Reason found) {
    const auto shifted = static_cast<std::uint8_t>(reason - 1);
    const auto other = static_cast<std::uint8_t>(is ? found - 1 : 255);
    return static_cast<std::uint8_t>(smaller(shifted, other) + 1);
}

template <class T>
void give_reasons(const Words<T> &work, std::int64_t from, int n, const Block<T> &block) {
    std::uint8_t *__restrict reason = work.reason + from;
    const std::uint16_t *__restrict twice = work.twice + from;
    for (int i = 0; i < n; ++i) {
        const std::uint8_t known = lower(reason[i], (twice[i] >= work.end) | (twice[i] < work.first), OUT_OF_RANGE);
        reason[i] = lower(known, block.weak[i] != 0, UNCERTAIN_BIT);
    }
}

template <class T>
void note_clipped(const Words<T> &work, std::int64_t from, int n, const Block<T> &block) {
    std::uint8_t *__restrict reason = work.reason + from;
    const T saturation = *work.saturation;
    for (int i = 0; i < n; ++i) reason[i] = lower(reason[i], block.most[i] >= saturation, SATURATED);
}

template <class T>
void read(const Words<T> &work) {
    Block<T> block;
    for (std::int64_t from = 0; from < work.pixels; from += BLOCK) {
        const int n = static_cast<int>(std::min<std::int64_t>(BLOCK, work.pixels - from));
        gather(work, from, n, block);
        place(work, from, n, block);
        if (work.saturation) note_clipped(work, from, n, block);  // before the place of its light is taken
        if (work.black) outshone(work, from, n, block);
        give_reasons(work, from, n, block);
    }
}

}  // namespace

void read_words(const Words<std::uint8_t> &work) { read(work); }
void read_words(const Words<std::uint16_t> &work) { read(work); }
void read_words(const Words<float> &work) { read(work); }

}  // namespace kernel::KERNEL_INSTRUCTION_SET
