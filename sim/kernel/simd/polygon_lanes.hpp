// Eight pairs at a time: vectors of doubles, and the arc tangent that the libraries have no vector form of.
#pragma once
#include <cmath>
#include <cstring>

#include "form_factors/polygon_pairs.hpp"

// Vectors are passed within one instruction set only, where all sides agree on how.
#pragma GCC diagnostic ignored "-Wpsabi"

namespace kernel::KERNEL_INSTRUCTION_SET {

typedef double Lanes __attribute__((vector_size(8 * LANES)));

struct LaneVec {
    Lanes x, y, z;
};

// A patch in lanes: places from the centre of i.
struct LanePatch {
    LaneVec corner[4], normal;
    Lanes density[4];
};

// n x n Gauss points on the outer patch, exact factors to the inner one: A F.
void points_to_polygon(const LanePatch &outer, const LanePatch &inner, int n, double *value);

namespace {

inline Lanes load(const double *p) {
    Lanes v;
    std::memcpy(&v, p, sizeof v);
    return v;
}

inline Lanes least(const Lanes &a, const Lanes &b) { return a < b ? a : b; }
inline Lanes most(const Lanes &a, const Lanes &b) { return a > b ? a : b; }

inline Lanes root(const Lanes &a) {
    Lanes r;
    for (int k = 0; k < LANES; ++k) r[k] = std::sqrt(a[k]);
    return r;
}

inline Lanes dot(const LaneVec &a, const LaneVec &b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
inline LaneVec operator-(const LaneVec &a, const LaneVec &b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
inline LaneVec cross(const LaneVec &a, const LaneVec &b) {
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

// Corners' shares in the bilinear map of a patch at (u, v).
inline void shares_at(double u, double v, double *share) {
    share[0] = (1 - u) * (1 - v);
    share[1] = u * (1 - v);
    share[2] = u * v;
    share[3] = (1 - u) * v;
}

// Polynomial in t^2 of atan(t) / t, t <= tan(pi / 8): Chebyshev interpolation, error 2e-18.
constexpr double ARC[12] = {1.0, -0.3333333333333312, 0.19999999999940837, -0.14285714279244968,
                            0.11111110744657099, -0.09090896801472813, 0.07692045194561481, -0.06662950246036792,
                            0.05846866752275139, -0.05035049795312439, 0.03796390316111083, -0.01780389639481256};

// Angle in [0, pi] of the point (x, y), y >= 0.
inline Lanes angle_of(const Lanes &y, const Lanes &x) {
    const Lanes size = x < 0.0 ? -x : x;
    const Lanes low = least(size, y), high = most(size, y);
    // Beyond pi / 8 the angle from pi / 4 is the small one.
    const auto wide = low > 0.41421356237309503 * high;
    const Lanes t = (wide ? low - high : low) / ((wide ? low + high : high) + 1e-300);
    const Lanes z = t * t;
    Lanes series = z * 0.0 + ARC[11];
    for (int k = 10; k >= 0; --k) series = series * z + ARC[k];
    Lanes angle = t * series;
    angle = wide ? angle + PI / 4 : angle;
    angle = y > size ? PI / 2 - angle : angle;
    return x < 0.0 ? PI - angle : angle;
}

}  // namespace

}  // namespace kernel::KERNEL_INSTRUCTION_SET
