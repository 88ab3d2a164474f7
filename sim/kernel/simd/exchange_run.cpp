// Near pairs by the closed form, far pairs by Gauss rules, where the closed form would cancel.
//
// Both cases are one integral over two differences, u along x and v along y, each spread by the convolution of
// two intervals:  A F = c / pi  iint W(u) W(v) / (q(u) + v^2)^2 du dv,
//   parallel       q = u^2 + gap^2,  c = gap^2
//   perpendicular  q = u,            c = 1/4,  with x^2 in place of x (x dx = d(x^2) / 2).
// A Gauss rule for the convolution follows from its even moments, so n x n points do what n^4 would.
#include "form_factors/exchange_run.hpp"

#include <algorithm>
#include <cmath>

#include "transcendental.hpp"
#include "geometry/vectors.hpp"

namespace kernel::KERNEL_INSTRUCTION_SET {

namespace {

constexpr double TINY = 1e-300;
// Distance over the half width from which 5, 4 and 3 points are enough, to 1e-10 (docs/decisions/0014).
constexpr double FROM[] = {8, 16, 48};

struct Spread {
    double centre, half_width, mass;
    double m1, m2, m3, m4;  // moments of order 2, 4, 6, 8 about the centre, over the mass
};

inline Spread spread(double a0, double a1, double b0, double b1) {
    const double a = a1 - a0, b = b1 - b0, s = a * a, t = b * b;
    Spread o;
    o.centre = 0.5 * (a0 + a1) - 0.5 * (b0 + b1);
    o.half_width = 0.5 * (a + b);
    o.mass = a * b;
    o.m1 = (s + t) / 12;
    o.m2 = (s * s + t * t) / 80 + s * t / 24;
    o.m3 = (s * s * s + t * t * t) / 448 + s * t * (s + t) / 64;
    o.m4 = (s * s * s * s + t * t * t * t) / 2304 + s * t * (s * s + t * t) / 192 + 7 * s * s * t * t / 640;
    return o;
}

template <int N>
struct Rule {
    double node[N], weight[N];
};

template <int N>
inline Rule<N> rule(const Spread &o) {
    Rule<N> r;
    if constexpr (N == 3) {
        const double t = o.m2 / (o.m1 + TINY), x = std::sqrt(t), w = 0.5 * o.m1 / (t + TINY);
        r = {{-x, 0, x}, {w, 1 - 2 * w, w}};
    } else {
        // Squares of the nodes: roots of the quadratic orthogonal to lower powers of the square.
        double p, q;
        if constexpr (N == 4) {
            p = (o.m1 * o.m2 - o.m3) / (o.m2 - o.m1 * o.m1 + TINY);
            q = -o.m2 - p * o.m1;
        } else {
            p = (o.m2 * o.m3 - o.m1 * o.m4) / (o.m1 * o.m3 - o.m2 * o.m2 + TINY);
            q = -(o.m3 + p * o.m2) / (o.m1 + TINY);
        }
        const double d = std::sqrt(std::max(0.25 * p * p - q, 0.0));
        const double t1 = d - 0.5 * p, t2 = std::max(-d - 0.5 * p, 0.0);
        const double x1 = std::sqrt(t1), x2 = std::sqrt(t2), split = 0.5 / (t1 - t2 + TINY);
        if constexpr (N == 4) {
            const double w1 = (o.m1 - t2) * split, w2 = 0.5 - w1;
            r = {{-x1, -x2, x2, x1}, {w1, w2, w2, w1}};
        } else {
            const double w1 = (o.m2 - o.m1 * t2) * split / (t1 + TINY);
            const double w2 = (o.m1 * t1 - o.m2) * split / (t2 + TINY);
            r = {{-x1, -x2, 0, x2, x1}, {w1, w2, 1 - 2 * (w1 + w2), w2, w1}};
        }
    }
    return r;
}

struct RectanglePair {
    double ax0, ax1, bx0, bx1, ay0, ay1, by0, by1;
};

// Perpendicular: the sum of squared heights as a difference of a^2 and -b^2.
template <bool PARALLEL>
inline Spread across(const RectanglePair &p) {
    if constexpr (PARALLEL) return spread(p.ax0, p.ax1, p.bx0, p.bx1);
    return spread(p.ax0 * p.ax0, p.ax1 * p.ax1, -p.bx1 * p.bx1, -p.bx0 * p.bx0);
}

template <bool PARALLEL, int N>
inline double far_value(const RectanglePair &p, double gap) {
    const Spread x = across<PARALLEL>(p), y = spread(p.ay0, p.ay1, p.by0, p.by1);
    const Rule<N> along_x = rule<N>(x), along_y = rule<N>(y);
    double squared[N], sum = 0;
    for (int k = 0; k < N; ++k) {
        const double v = y.centre + along_y.node[k];
        squared[k] = v * v;
    }
    for (int i = 0; i < N; ++i) {
        const double u = x.centre + along_x.node[i];
        const double q = PARALLEL ? u * u + gap * gap : u;
        double row = 0;
        for (int k = 0; k < N; ++k) {
            const double r2 = q + squared[k];
            row += along_y.weight[k] / (r2 * r2);
        }
        sum += along_x.weight[i] * row;
    }
    return sum * x.mass * y.mass * (PARALLEL ? gap * gap : 0.25) / PI;
}

// Ehlert & Smith 1993. What the fourfold differences drop anyway is left out: log(scale).
inline double parallel_corner(double x, double y, double gap, double scale) {
    const double p = std::sqrt(x * x + gap * gap), q = std::sqrt(y * y + gap * gap);
    return y * p * angle_of(y, p) + x * q * angle_of(x, q) -
           0.5 * gap * gap * log_of((x * x + y * y + gap * gap) / scale);
}

inline double perpendicular_corner(double squared, double y, double scale) {
    const double root = std::sqrt(squared), r2 = std::max(squared + y * y, TINY);
    return y * root * angle_of(y, std::max(root, TINY)) - 0.25 * (squared - y * y) * log_of(std::max(r2 / scale, TINY));
}

template <bool PARALLEL>
inline double near_value(const RectanglePair &p, double gap) {
    const Spread x = across<PARALLEL>(p), y = spread(p.ay0, p.ay1, p.by0, p.by1);
    const double q = PARALLEL ? x.centre * x.centre + gap * gap : x.centre;
    const double scale = q + y.centre * y.centre;
    const double ax[2] = {p.ax0, p.ax1}, bx[2] = {p.bx0, p.bx1}, ay[2] = {p.ay0, p.ay1}, by[2] = {p.by0, p.by1};
    double sum = 0;
    for (int i = 0; i < 2; ++i)
        for (int j = 0; j < 2; ++j)
            for (int k = 0; k < 2; ++k)
                for (int l = 0; l < 2; ++l) {
                    const double v = ay[k] - by[l];
                    const double corner = PARALLEL ? parallel_corner(ax[i] - bx[j], v, gap, scale)
                                                   : perpendicular_corner(ax[i] * ax[i] + bx[j] * bx[j], v, scale);
                    sum += ((i + j + k + l) & 1) ? -corner : corner;
                }
    const double least = std::min((p.ax1 - p.ax0) * (p.ay1 - p.ay0), (p.bx1 - p.bx0) * (p.by1 - p.by0));
    return std::min(std::max(sum / (2 * PI), 0.0), least);
}

inline RectanglePair pair_of(const Run &run, int k) {
    return {run.ax0[k], run.ax1[k], run.bx0[k], run.bx1[k], run.ay0[k], run.ay1[k], run.by0[k], run.by1[k]};
}

// How far a pair is: the least distance to the integrand's pole over the half width, along either axis.
template <bool PARALLEL>
inline double separation(const RectanglePair &p, double gap) {
    const Spread x = across<PARALLEL>(p), y = spread(p.ay0, p.ay1, p.by0, p.by1);
    const double q = PARALLEL ? x.centre * x.centre + gap * gap : x.centre;
    const double r2 = q + y.centre * y.centre, r = std::sqrt(r2);
    const double along_x = (PARALLEL ? r : r2) / (x.half_width + TINY);
    return std::min(along_x, r / (y.half_width + TINY));
}

constexpr int LANES = 8;

// The pairs that one rule takes, lane by lane; rule 0 is the closed form.
template <bool PARALLEL, int N>
void some_values(const Run &run, int n, int *which, double *out) {
    if (n == 0) return;
    double value[RUN + LANES];
    const int padded = (n + LANES - 1) / LANES * LANES;
    for (int k = n; k < padded; ++k) which[k] = which[n - 1];
#pragma omp simd
    for (int k = 0; k < padded; ++k) {
        const RectanglePair pair = pair_of(run, which[k]);
        const double gap = run.gap[which[k]];
        if constexpr (N == 0)
            value[k] = near_value<PARALLEL>(pair, gap);
        else
            value[k] = far_value<PARALLEL, N>(pair, gap);
    }
    for (int k = 0; k < n; ++k) out[which[k]] = value[k];
}

template <bool PARALLEL>
void run_values(const Run &run, double *out) {
    double ratio[RUN];
#pragma omp simd
    for (int k = 0; k < run.n; ++k) ratio[k] = separation<PARALLEL>(pair_of(run, k), run.gap[k]);
    int which[4][RUN + LANES], count[4] = {0, 0, 0, 0};
    for (int k = 0; k < run.n; ++k) {
        const int rule = (ratio[k] >= FROM[0]) + (ratio[k] >= FROM[1]) + (ratio[k] >= FROM[2]);
        which[rule][count[rule]++] = k;
    }
    some_values<PARALLEL, 0>(run, count[0], which[0], out);
    some_values<PARALLEL, 5>(run, count[1], which[1], out);
    some_values<PARALLEL, 4>(run, count[2], which[2], out);
    some_values<PARALLEL, 3>(run, count[3], which[3], out);
}

}  // namespace

void exchange_areas(const Run &run, double *out) {
    if (run.parallel)
        run_values<true>(run, out);
    else
        run_values<false>(run, out);
}

}  // namespace kernel::KERNEL_INSTRUCTION_SET
