// Entries by points, exact factors or rays, whichever is enough for the pair.
#include "compressed/pairs.hpp"

#include <algorithm>
#include <cstdint>

namespace kernel::compressed {

namespace {

// Additive sequence of the generalised golden ratio of four dimensions (Roberts 2018).
std::vector<double> low_discrepancy(int first, int count) {
    double ratio = 1;
    for (int k = 0; k < 64; ++k) ratio = std::pow(1 + ratio, 0.2);
    std::vector<double> points(4 * static_cast<std::size_t>(count));
    for (int k = 0; k < count; ++k)
        for (int d = 0; d < 4; ++d)
            points[4 * k + d] = std::fmod(0.5 + (first + k + 1) * std::pow(ratio, -(d + 1.0)), 1.0);
    return points;
}

// A shift of the rays for each pair (Cranley & Patterson 1976), so that errors along a shadow's edge cancel.
void shift_of(int i, int j, double shift[4]) {
    std::uint64_t z = (std::uint64_t(i) << 32 | std::uint32_t(j)) * 0x9e3779b97f4a7c15ULL;
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ULL;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebULL;
    z ^= z >> 31;
    for (int d = 0; d < 4; ++d) shift[d] = (z >> (16 * d) & 0xffff) / 65536.0;
}

}  // namespace

Pairs::Pairs(const Geometry &geometry, const std::vector<int> &order, const std::vector<Occluder> &occluders,
             Effort effort)
    : occluders_(occluders), effort_(effort), tolerance_(Tolerance::of(geometry.size())) {
    rays_ = low_discrepancy(effort.first_ray, effort.rays_max);
    far_.reserve(order.size()), near_.reserve(order.size());
    for (int patch : order) prepare(geometry, patch);
}

void Pairs::prepare(const Geometry &geometry, int patch) {
    Near near;
    double diameter = 0;
    for (int k = 0; k < 4; ++k) near.corner[k] = geometry.corner(patch, k);
    for (int k = 0; k < 4; ++k)
        for (int m = 0; m < k; ++m) diameter = std::max(diameter, norm(near.corner[k] - near.corner[m]));
    near.twist = (near.corner[0] - near.corner[1]) + (near.corner[2] - near.corner[3]);
    near.parallelogram = norm(near.twist) < 1e-12 * diameter;
    const double area = geometry.areas[patch];
    const GaussRule &rule = gauss_rule(2);
    Vec centre{0, 0, 0};
    for (int k = 0; k < 4; ++k) {
        double jacobian;
        near.gauss[k] = point(near, rule.node[k & 1], rule.node[k >> 1], &jacobian);
        near.weight[k] = 0.25 * jacobian / area;
        centre = centre + near.weight[k] * near.gauss[k];
    }
    far_.push_back({centre, load(geometry.normals + 3 * patch), std::sqrt(area), diameter * diameter});
    near_.push_back(near);
    total_area_ += area;
}

Cluster Pairs::alone(int i) const {
    Cluster c;
    c.begin = i, c.end = i + 1;
    c.flat = true, c.normal = far_[i].normal;
    c.hull.assign(near_[i].corner, near_[i].corner + 4);
    c.offset = dot(c.normal, c.hull[0]);
    c.middle = far_[i].centre;
    for (const Vec &p : c.hull) c.radius = std::max(c.radius, norm(p - c.middle));
    return c;
}

Vec Pairs::point(const Near &p, double u, double v, double *jacobian) const {
    const Vec along_u = p.corner[1] - p.corner[0] + v * p.twist, along_v = p.corner[3] - p.corner[0] + u * p.twist;
    if (jacobian) *jacobian = norm(cross(along_u, along_v));
    return p.corner[0] + u * (p.corner[1] - p.corner[0]) + v * along_v;
}

void Pairs::row(int i, int begin, int end, const std::vector<int> &candidates, double *out) const {
    for (int j = begin; j < end; ++j) out[j - begin] = value(i, j, candidates);
}

double Pairs::value(int i, int j, const std::vector<int> &candidates) const {
    if (i > j) std::swap(i, j);
    const double free = unhidden(i, j);
    if (candidates.empty() || free <= 0) return free;
    const int rays = rays_for(i, j, free);
    if (rays <= effort_.rays_max) return free * visible_share(i, j, rays, candidates);
    return visible(i, j, candidates);
}

double Pairs::unhidden(int i, int j) const {
    const Far &a = far_[i], &b = far_[j];
    const Vec d = b.centre - a.centre;
    const double squared = dot(d, d), size = std::max(a.diameter_squared, b.diameter_squared);
    const double over_a = dot(a.normal, d), over_b = -dot(b.normal, d);
    // A patch whose centre lies a diameter behind the other's plane lies wholly behind it.
    const double lowest = std::min(over_a, over_b);
    if (lowest < 0 && lowest * lowest > size) return 0;
    if (squared > effort_.far * effort_.far * size && 4 * over_a * over_a > size && 4 * over_b * over_b > size)
        return a.root_area * b.root_area * over_a * over_b / (PI * squared * squared);
    const bool low = 4 * lowest * lowest < size || lowest < 0;
    const bool cut = low && squared < effort_.far * effort_.far * size && (astride(i, j) || astride(j, i));
    if (squared > effort_.middle * effort_.middle * size && !cut) return by_points(i, j);
    return exact(i, j, squared < 2.5 * size);
}

// Patch i reaches through the plane of patch j.
bool Pairs::astride(int i, int j) const {
    bool before = false, behind = false;
    for (const Vec &p : near_[i].corner) {
        const double height = dot(far_[j].normal, p - near_[j].corner[0]);
        before |= height > tolerance_.touch, behind |= height < -tolerance_.touch;
    }
    return before && behind;
}

double Pairs::by_points(int i, int j) const {
    const Near &p = near_[i], &q = near_[j];
    double sum = 0;
    for (int k = 0; k < 4; ++k)
        for (int m = 0; m < 4; ++m) {
            const Vec d = q.gauss[m] - p.gauss[k];
            const double over_p = dot(far_[i].normal, d), over_q = -dot(far_[j].normal, d);
            const double squared = dot(d, d);
            if (over_p > 0 && over_q > 0) sum += p.weight[k] * q.weight[m] * over_p * over_q / (squared * squared);
        }
    return sum * far_[i].root_area * far_[j].root_area / PI;
}

double Pairs::exact(int i, int j, bool close) const {
    // The inner integral cuts its polygon exactly; the outer one goes over a patch that is whole, or the smaller.
    const bool whole_i = !astride(i, j), whole_j = !astride(j, i);
    const bool swap = whole_i != whole_j ? whole_j : far_[j].root_area < far_[i].root_area;
    if (swap) std::swap(i, j);
    const Polygon inner = polygon_of(j);
    const auto factor = [&](Vec p) { return std::max(point_factor(p, far_[i].normal, inner), 0.0); };
    const GaussRule &rule = gauss_rule(close ? effort_.order_close : effort_.order);
    return outer_integral(i, j, rule, factor) / (far_[i].root_area * far_[j].root_area);
}

// The same past occluders: the outer integral goes over the patch that they are further from.
double Pairs::visible(int i, int j, const std::vector<int> &candidates) const {
    double over_i = clearance(near_[i].corner, far_[i].normal, occluders_, candidates, tolerance_);
    double over_j = clearance(near_[j].corner, far_[j].normal, occluders_, candidates, tolerance_);
    if (over_j > over_i) std::swap(i, j), std::swap(over_i, over_j);
    const bool abrupt = over_i * over_i < 0.01 * far_[i].diameter_squared;
    const Polygon inner = polygon_of(j);
    const auto factor = [&](Vec p) {
        return visible_factor(p, far_[i].normal, inner, occluders_, candidates, tolerance_);
    };
    const double sum = outer_integral(i, j, gauss_rule(abrupt ? effort_.order_abrupt : effort_.order_close), factor);
    return sum / (far_[i].root_area * far_[j].root_area);
}

Polygon Pairs::polygon_of(int i) const {
    Polygon polygon;
    polygon.n = 4;
    std::copy(near_[i].corner, near_[i].corner + 4, polygon.corner);
    return polygon;
}

// Gauss over the part of patch i before the plane of patch j. [area]
template <class Factor>
double Pairs::outer_integral(int i, int j, const GaussRule &rule, const Factor &factor) const {
    if (!astride(i, j)) return integral_over(near_[i], rule, factor);
    const Polygon part =
        part_above(polygon_of(i), far_[j].normal, dot(far_[j].normal, near_[j].corner[0]), tolerance_.snap);
    double sum = 0;
    for (int k = 1; k + 1 < part.n; ++k) {
        Near triangle{};
        triangle.corner[0] = part.corner[0], triangle.corner[1] = part.corner[k];
        triangle.corner[2] = triangle.corner[3] = part.corner[k + 1];
        triangle.twist = triangle.corner[0] - triangle.corner[1];
        sum += integral_over(triangle, rule, factor);
    }
    return sum;
}

template <class Factor>
double Pairs::integral_over(const Near &part, const GaussRule &rule, const Factor &factor) const {
    double sum = 0;
    for (int k = 0; k < rule.n; ++k)
        for (int m = 0; m < rule.n; ++m) {
            double jacobian;
            const Vec p = point(part, rule.node[k], rule.node[m], &jacobian);
            sum += rule.weight[k] * rule.weight[m] * jacobian * factor(p);
        }
    return sum;
}

// The error of n rays on a partly hidden pair is about 1 / (2 n^3/4). More than rays_max: cut exactly instead.
int Pairs::rays_for(int i, int j, double unhidden_value) const {
    const double share = std::min(far_[i].root_area, far_[j].root_area) / std::sqrt(total_area_);
    const double ratio = 0.5 * unhidden_value / (effort_.ray_error * share);
    int rays = effort_.rays_min;
    while (rays <= effort_.rays_max && ratio * ratio * ratio * ratio > double(rays) * rays * rays) rays *= 2;
    return rays;
}

double Pairs::visible_share(int i, int j, int rays, const std::vector<int> &candidates) const {
    const Near &p = near_[i], &q = near_[j];
    const Vec normal_p = far_[i].normal, normal_q = far_[j].normal;
    double all = 0, seen = 0, shift[4], s[4];
    shift_of(i, j, shift);
    for (int k = 0; k < rays; ++k) {
        for (int d = 0; d < 4; ++d) {
            s[d] = rays_[4 * k + d] + shift[d];
            s[d] -= s[d] >= 1 ? 1 : 0;
        }
        double jacobian_p = 1, jacobian_q = 1;
        const Vec a = point(p, s[0], s[1], p.parallelogram ? nullptr : &jacobian_p);
        const Vec b = point(q, s[2], s[3], q.parallelogram ? nullptr : &jacobian_q);
        const Vec d = b - a;
        const double over_p = dot(normal_p, d), over_q = -dot(normal_q, d), squared = dot(d, d);
        if (over_p <= 0 || over_q <= 0) continue;
        const double weight = jacobian_p * jacobian_q * over_p * over_q / (squared * squared);
        all += weight;
        bool hidden = false;
        for (std::size_t c = 0; c < candidates.size() && !hidden; ++c)
            hidden = stops(occluders_[candidates[c]], a, b, tolerance_);
        if (!hidden) seen += weight;
    }
    return all > 0 ? seen / all : 0.0;
}

}  // namespace kernel::compressed
