// Gauss points on one patch, Lambert's exact factor to the other: for pairs too near for points on both.
#include "simd/polygon_lanes.hpp"

namespace kernel::KERNEL_INSTRUCTION_SET {

namespace {

// 2 pi times the factor from p: sum over edges of the angle times its plane's cosine (form_factors/point_factor.hpp).
inline Lanes point_sum(const LaneVec &p, const LaneVec &normal, const LaneVec *corner) {
    Lanes sum = {};
    LaneVec a = corner[3] - p;
    for (int k = 0; k < 4; ++k) {
        const LaneVec b = corner[k] - p, g = cross(b, a);
        const Lanes length = root(dot(g, g));
        sum += angle_of(length, dot(a, b)) * dot(g, normal) / (length + 1e-300);
        a = b;
    }
    return sum;
}

}  // namespace

void points_to_polygon(const LanePatch &outer, const LanePatch &inner, int n, double *value) {
    const GaussRule &rule = gauss_rule(n);
    Lanes total = {};
    for (int a = 0; a < n; ++a)
        for (int b = 0; b < n; ++b) {
            double share[4];
            shares_at(rule.node[a], rule.node[b], share);
            LaneVec p = {};
            Lanes density = {};
            for (int k = 0; k < 4; ++k) {
                p.x += share[k] * outer.corner[k].x;
                p.y += share[k] * outer.corner[k].y;
                p.z += share[k] * outer.corner[k].z;
                density += share[k] * outer.density[k];
            }
            total += rule.weight[a] * rule.weight[b] * density * point_sum(p, outer.normal, inner.corner);
        }
    total *= 1 / (2 * PI);
    std::memcpy(value, &total, sizeof total);
}

}  // namespace kernel::KERNEL_INSTRUCTION_SET
