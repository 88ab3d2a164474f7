// Three-dimensional vectors: plain doubles, nothing hidden.
#pragma once
#include <cmath>

namespace kernel {

constexpr double PI = 3.14159265358979323846;

struct Vec {
    double x, y, z;
};

inline Vec operator+(Vec a, Vec b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
inline Vec operator-(Vec a, Vec b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
inline Vec operator*(double s, Vec a) { return {s * a.x, s * a.y, s * a.z}; }
inline double dot(Vec a, Vec b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
inline Vec cross(Vec a, Vec b) {
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
inline double norm(Vec a) { return std::sqrt(dot(a, a)); }
// Of length 1, or 0 where the vector is.
inline Vec unit(Vec a) {
    const double length = norm(a);
    return length > 0 ? (1 / length) * a : a;
}
inline double component(Vec a, int axis) { return axis == 0 ? a.x : axis == 1 ? a.y : a.z; }
inline Vec load(const double *p) { return {p[0], p[1], p[2]}; }

}  // namespace kernel
