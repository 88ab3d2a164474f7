// Logarithm and arc tangent without branches or calls, so that loops over many pairs run in vector registers.
// Relative error below 1e-15. The coefficients interpolate the functions at Chebyshev points (60 digits).
#pragma once
#include <cstdint>
#include <cstring>

#include "geometry/vectors.hpp"

namespace kernel {

// Internal linkage throughout: each source compiles its own copy, at its own instruction set.
template <int N>
static inline double polynomial(const double (&c)[N], double x) {
    double value = c[N - 1];
    for (int k = N - 2; k >= 0; --k) value = value * x + c[k];
    return value;
}

// Of a normal number above 0. log x = e log 2 + log m, sqrt(1/2) <= m < sqrt(2), log m = 2 atanh(s).
[[maybe_unused]] static inline double log_of(double x) {
    constexpr double C[] = {0.66666666666666666465,  0.40000000000000877606, 0.28571428570803230015,
                            0.22222222391800469329,  0.181817956308847532,   0.15386240205813477879,
                            0.13268759668560612686,  0.13086767009948173713};
    constexpr std::uint64_t ONE = 0x3ff0000000000000ull, HALF_ROOT = 0x3fe6a09e667f3bcdull;
    constexpr std::uint64_t MAGIC = 0x4330000000000000ull;  // 2^52: an integer in the mantissa becomes a double
    constexpr double LN2_HIGH = 0x1.62e42fefa0000p-1, LN2_LOW = 0x1.cf79abc9e3b3ap-40;
    std::uint64_t bits;
    std::memcpy(&bits, &x, 8);
    const std::uint64_t shifted = bits + (ONE - HALF_ROOT);
    const std::uint64_t biased = (shifted >> 52) | MAGIC, mantissa = (shifted & 0x000fffffffffffffull) + HALF_ROOT;
    double e, m;
    std::memcpy(&e, &biased, 8);
    std::memcpy(&m, &mantissa, 8);
    e -= 4503599627370496.0 + 1023.0;
    const double f = m - 1, s = f / (2 + f), z = s * s;
    return e * LN2_HIGH + (f - s * (f - z * polynomial(C, z)) + e * LN2_LOW);
}

// Angle of the point (x, y), x >= 0 and x + |y| > 0.
[[maybe_unused]] static inline double angle_of(double y, double x) {
    constexpr double C[] = {0.99999999999999999874,  -0.33333333333333120948, 0.19999999999940837328,
                            -0.14285714279244968487, 0.11111110744657099602,  -0.090908968014728134434,
                            0.07692045194561481467,  -0.06662950246036791267, 0.058468667522751389837,
                            -0.050350497953124393166, 0.037963903161110833033, -0.017803896394812563193};
    constexpr double TAN_EIGHTH = 0.41421356237309503;
    const double a = y < 0 ? -y : y;
    const double low = a < x ? a : x, high = a < x ? x : a;
    const bool turned = low > TAN_EIGHTH * high;
    const double t = (turned ? low - high : low) / (turned ? low + high : high);
    const double first = t * polynomial(C, t * t) + (turned ? PI / 4 : 0.0);
    const double angle = a < x ? first : PI / 2 - first;
    return y < 0 ? -angle : angle;
}

// Angle between two directions, 0 ... pi, from the length of their cross product and their dot product.
[[maybe_unused]] static inline double angle_between(double cross_length, double dot_product) {
    return dot_product < 0 ? PI - angle_of(cross_length, -dot_product) : angle_of(cross_length, dot_product);
}

}  // namespace kernel
