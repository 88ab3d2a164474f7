// Sixteen numbers at a time on every instruction set: one register with AVX-512, two with AVX2, else four. Compilers
// take vectors that fit no register apart, number by number at times.
#pragma once
#include <cstdint>
#include <cstring>

#include "frame/frame.hpp"
#include "simd/frame_registers.hpp"

namespace kernel::frame::KERNEL_INSTRUCTION_SET {

namespace {

#if defined(__AVX512F__)
typedef FloatRegister Floats;
typedef WordRegister Words;

inline Floats same(float x) { return broadcast(x); }

inline Words same(std::uint32_t x) { return Words{} + x; }

template <class V, class T>
inline V loaded(const T *p) {
    V all;
    std::memcpy(&all, p, sizeof all);
    return all;
}

template <class T, class V>
inline void store(T *p, const V &all) {
    std::memcpy(p, &all, sizeof all);
}

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

template <class V, class T>
inline V loaded(const T *p) {
    V all;
    for (int k = 0; k < BLOCK / LANES; ++k) std::memcpy(&all.part[k], p + k * LANES, sizeof all.part[k]);
    return all;
}

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

inline Floats load(const float *p) { return loaded<Floats>(p); }

inline Words load(const std::uint32_t *p) { return loaded<Words>(p); }

// The first n of sixteen narrow numbers as wide ones, 0 in the other lanes.
template <class Narrow>
inline Words widened(const Narrow *p, int n) {
    if (n == BLOCK) return widened(p);
    Narrow some[BLOCK] = {};
    std::memcpy(some, p, n * sizeof(Narrow));
    return widened(some);
}

}  // namespace

}  // namespace kernel::frame::KERNEL_INSTRUCTION_SET
