// Near pairs: A F = 1/(2 pi) sum over edges e of a, f of b of (e . f) iint ln r ds dt (Stokes; Sparrow 1963).
//
// The integral along f is exact (logarithm and arc tangent). The one along e is a Gauss rule on panels, graded
// towards f where they come close; edges that touch or cross in one plane have a closed form.
#include <algorithm>
#include <cmath>

#include "form_factors/polygon_pairs.hpp"
#include "geometry/polygon.hpp"

namespace kernel {
namespace {

// Lengths are in units of the pair's size; a thousand times 2^-53, for what coordinates have gone through.
constexpr double ROUNDOFF = 1e-13;
constexpr int HIGHEST = 12;  // points on a panel before it is halved: 8 and 18 take as long
constexpr int DEEPEST = 60;  // halvings: what is left of an edge is below roundoff
constexpr double BESIDE = 1e-4;  // edges nearer than this are asked whether they come close or only lie side by side

struct Edge {
    Vec from, along;  // unit direction
    double length;
};

inline Vec at(const Edge &e, double s) { return e.from + s * e.along; }

// u ln r - u + p atan(u / p) at u = high less that at u = low, with r^2 = u^2 + p^2.
inline double log_integral(double low, double high, double p) {
    const double r_low = low * low + p * p, r_high = high * high + p * p;
    double value = low - high;
    if (r_low > 0) value -= 0.5 * low * std::log(r_low);
    if (r_high > 0) value += 0.5 * high * std::log(r_high);
    return p > 0 ? value + p * std::atan2(p * (high - low), p * p + low * high) : value;
}

// Integral of ln |x - y| over the points y of an edge.
inline double edge_potential(Vec x, const Edge &f) {
    const Vec w = x - f.from;
    const double u = dot(w, f.along);
    return log_integral(-u, f.length - u, norm(w - u * f.along));
}

inline double clamped(double x, double high) { return std::min(std::max(x, 0.0), high); }

// Distance between the part [low, high] of e and all of f (closest points of two segments).
double distance(const Edge &e, double low, double high, const Edge &f) {
    const Vec from = at(e, low), w = from - f.from;
    const double length = high - low, b = dot(e.along, f.along), d = dot(e.along, w), g = dot(f.along, w);
    const double sine2 = 1 - b * b;
    double s = sine2 > 1e-14 ? clamped((b * g - d) / sine2, length) : 0;
    double t = g + b * s;
    if (t < 0 || t > f.length) {
        t = clamped(t, f.length);
        s = clamped(b * t - d, length);
    }
    return norm(w + s * e.along - t * f.along);
}

// Points that a Gauss rule needs on a panel: its error is below size rho^-2n, where the ellipse of sum of half
// axes rho half-widths leaves f outside.
inline double points_needed(double half_width, double gap, double size, double tolerance) {
    const double g = gap / half_width, rho = g + std::sqrt(1 + g * g);
    return size <= tolerance ? 1 : 0.5 * std::log(size / tolerance) / std::log(rho);
}

double gauss_panel(const Edge &e, double low, double high, const Edge &f, int n) {
    const GaussRule &rule = gauss_rule(n);
    double sum = 0;
    for (int k = 0; k < n; ++k) sum += rule.weight[k] * edge_potential(at(e, low + (high - low) * rule.node[k]), f);
    return (high - low) * sum;
}

struct Crossing {
    double sine, height, s, t;  // of the two lines: angle, distance, and where on each they are closest
};

Crossing crossing_of(const Edge &e, const Edge &f) {
    const Vec w = f.from - e.from, axis = cross(e.along, f.along);
    const double sine = norm(axis), sine2 = sine * sine + 1e-300;
    return {sine, std::fabs(dot(w, axis)) / (sine + 1e-300), dot(cross(w, f.along), axis) / sine2,
            dot(cross(w, e.along), axis) / sine2};
}

inline double distance_to_point(const Edge &e, double low, double high, Vec x) {
    const double s = std::min(std::max(dot(e.along, x - e.from), low), high);
    return norm(at(e, s) - x);
}

// How far from the part [low, high] of e the integrand along e stops being smooth: at the ends of f, and where
// p^2, a square polynomial of s, is 0: beside the crossing, by height / sine off the real axis. For two edges that
// lie side by side, a rounding of coordinates apart, that is far more than their distance.
double smooth_gap(const Edge &e, double low, double high, const Edge &f, const Crossing &c) {
    const double ends = std::min(distance_to_point(e, low, high, f.from),
                                 distance_to_point(e, low, high, at(f, f.length)));
    if (c.sine < ROUNDOFF) return ends;
    return std::min(ends, std::hypot(std::max({low - c.s, c.s - high, 0.0}), c.height / c.sine));
}

double graded(const Edge &e, double low, double high, const Edge &f, const Crossing &c, double tolerance, int depth) {
    const double width = high - low, size = 2 * width * f.length;
    double gap = distance(e, low, high, f);
    if (gap < BESIDE) gap = std::max(gap, smooth_gap(e, low, high, f, c));
    const double n = points_needed(0.5 * width, gap, size, tolerance);
    if (n <= HIGHEST || depth == DEEPEST || 20 * size <= tolerance)
        return gauss_panel(e, low, high, f, static_cast<int>(clamped(std::ceil(n), HIGHEST - 1)) + 1);
    const double middle = 0.5 * (low + high);
    return graded(e, low, middle, f, c, tolerance, depth + 1) + graded(e, middle, high, f, c, tolerance, depth + 1);
}

// Twofold antiderivative of ln sqrt(x^2 + p^2).
inline double parallel_corner(double x, double p) {
    const double r2 = x * x + p * p;
    if (!(r2 > 0)) return 0;
    return 0.25 * (x * x - p * p) * std::log(r2) + p * x * (p > 0 ? std::atan(x / p) : 0) - 0.75 * x * x;
}

double parallel_edges(const Edge &e, const Edge &f) {
    const Vec w = f.from - e.from;
    const double start = dot(w, e.along), p = norm(w - start * e.along);
    const double end = start + std::copysign(f.length, dot(e.along, f.along));
    const double low = std::min(start, end), high = std::max(start, end);
    return parallel_corner(high, p) - parallel_corner(low, p) - parallel_corner(high - e.length, p) +
           parallel_corner(low - e.length, p);
}

// Integral over [0, s] x [0, t] along two lines from where they cross. It is homogeneous but for the logarithm,
// so Euler's theorem gives it from its derivatives.
inline double crossing_corner(double s, double t, double cosine, double sine) {
    if (s == 0 || t == 0) return 0;
    const auto side = [=](double x, double y) {  // integral of ln |x a - y b| over y from 0
        const double low = std::min(0.0, y) - x * cosine, high = std::max(0.0, y) - x * cosine;
        const double value = log_integral(low, high, std::fabs(x) * sine);
        return y < 0 ? -value : value;
    };
    return 0.5 * (s * side(s, t) + t * side(t, s) - s * t);
}

inline double snapped(double x) { return std::fabs(x) < ROUNDOFF ? 0 : x; }

double crossing_edges(const Edge &e, const Edge &f, const Crossing &c) {
    const double cosine = dot(e.along, f.along);
    const double s0 = snapped(-c.s), s1 = snapped(e.length - c.s), t0 = snapped(-c.t), t1 = snapped(f.length - c.t);
    return crossing_corner(s1, t1, cosine, c.sine) - crossing_corner(s0, t1, cosine, c.sine) -
           crossing_corner(s1, t0, cosine, c.sine) + crossing_corner(s0, t0, cosine, c.sine);
}

double pair_of_edges(const Edge &e, const Edge &f, double tolerance) {
    const double n = points_needed(0.5 * e.length, distance(e, 0, e.length, f), 2 * e.length * f.length, tolerance);
    if (n <= HIGHEST) return gauss_panel(e, 0, e.length, f, static_cast<int>(std::max(1.0, std::ceil(n))));
    const Crossing c = crossing_of(e, f);
    if (c.sine < ROUNDOFF) return parallel_edges(e, f);
    const double reach = 4 * (e.length + f.length);
    if (c.height < ROUNDOFF && c.sine > 0.01 && std::fabs(c.s) < reach && std::fabs(c.t) < reach)
        return crossing_edges(e, f, c);
    return graded(e, 0, e.length, f, c, tolerance, 0);
}

struct Contour {
    int n;
    double around;
    Edge edge[MAX_CORNERS];
};

Contour contour_of(const Polygon &polygon, Vec origin, double scale) {
    Contour o{0, 0, {}};
    for (int k = 0; k < polygon.n; ++k) {
        const Vec from = scale * (polygon.corner[k] - origin);
        const Vec edge = scale * (polygon.corner[(k + 1) % polygon.n] - polygon.corner[k]);
        const double length = norm(edge);
        if (length <= 0) continue;
        o.edge[o.n++] = {from, 1 / length * edge, length};
        o.around += length;
    }
    return o;
}

double area_of(const Contour &contour) {
    Vec sum{0, 0, 0};
    for (int k = 0; k < contour.n; ++k)
        sum = sum + cross(contour.edge[k].from - contour.edge[0].from, contour.edge[k].length * contour.edge[k].along);
    return 0.5 * norm(sum);
}

double contour_sum(const Contour &a, const Contour &b, double tolerance) {
    double sum = 0;
    for (int i = 0; i < a.n; ++i)
        for (int j = 0; j < b.n; ++j) {
            const double cosine = dot(a.edge[i].along, b.edge[j].along);
            if (std::fabs(cosine) > 1e-15) sum += cosine * pair_of_edges(a.edge[i], b.edge[j], tolerance);
        }
    return sum / (2 * PI);
}

}  // namespace

double contour_exchange_area(const Polygon &first, const Polygon &second, double tolerance) {
    const Vec origin = first.corner[0];
    double size = 0;
    for (int k = 0; k < first.n; ++k) size = std::max(size, norm(first.corner[k] - origin));
    for (int k = 0; k < second.n; ++k) size = std::max(size, norm(second.corner[k] - origin));
    if (!(size > 0)) return 0;
    Contour a = contour_of(first, origin, 1 / size), b = contour_of(second, origin, 1 / size);
    if (a.n < 3 || b.n < 3) return 0;
    if (a.around > b.around) std::swap(a, b);
    const double most = std::min(area_of(a), area_of(b));
    // The result is not known beforehand: a guess, then whatever is smaller.
    double expected = 0.02 * most, value = 0;
    for (int attempt = 0; attempt < 4; ++attempt) {
        value = std::min(std::max(contour_sum(a, b, tolerance * expected), 0.0), most);
        if (value >= expected) break;
        expected = std::max(0.5 * value, 1e-3 * expected);
    }
    return value * size * size;
}

}  // namespace kernel
