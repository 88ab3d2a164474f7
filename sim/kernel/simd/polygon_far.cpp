// The way of each pair, and Gauss x Gauss for those far apart: A F = 1/pi sum w_p w_q h_q h_p / r^4.
//
// r cos is the height of one point over the other patch's plane, so each point has one for all of the other's.
#include <algorithm>

#include "simd/polygon_lanes.hpp"

namespace kernel::KERNEL_INSTRUCTION_SET {

namespace {

constexpr double TINY = 1e-300;
constexpr Lanes zero = {};

inline Lanes all(double value) { return zero + value; }

// Both patches from the centre of i.
struct PairFrame {
    LanePatch i, j;
    LaneVec centre;  // of j
};

LanePatch patch_of(const PatchBlock &block, const double *centre) {
    LanePatch o;
    for (int k = 0; k < 4; ++k) {
        const double(*f)[LANES] = block.field + CORNER + 3 * k;
        o.corner[k] = {load(f[0]) - centre[0], load(f[1]) - centre[1], load(f[2]) - centre[2]};
        o.density[k] = load(block.field[DENSITY + k]);
    }
    const double(*n)[LANES] = block.field + NORMAL;
    o.normal = {load(n[0]), load(n[1]), load(n[2])};
    return o;
}

LanePatch patch_of(const double *field) {
    const double *c = field + CENTRE, *n = field + NORMAL;
    LanePatch o;
    for (int k = 0; k < 4; ++k) {
        const double *p = field + CORNER + 3 * k;
        o.corner[k] = {zero + (p[0] - c[0]), zero + (p[1] - c[1]), zero + (p[2] - c[2])};
        o.density[k] = zero + field[DENSITY + k];
    }
    o.normal = {zero + n[0], zero + n[1], zero + n[2]};
    return o;
}

struct Range {
    Lanes low, high;
};

inline Range range_of(const Lanes *values) {
    return {least(least(values[0], values[1]), least(values[2], values[3])),
            most(most(values[0], values[1]), most(values[2], values[3]))};
}

// Dot products of a direction with the corners as seen from a place.
inline Range range_along(const LaneVec &direction, const LanePatch &patch, const LaneVec &from) {
    Lanes values[4];
    for (int k = 0; k < 4; ++k) values[k] = dot(direction, patch.corner[k] - from);
    return range_of(values);
}

// Half the spread over the mean, of what is not below 0.
inline Lanes spread(const Range &range) { return (range.high - range.low) / (range.high + range.low + TINY); }

// What the error of Gauss points on one patch depends on (polygon_pairs.hpp).
struct Side {
    Lanes inverse, along, rises, near;  // inverse: 1 / rho^2
};

Side side_of(const Lanes &gap, const Lanes &extent, const Lanes &half, const Range &heights, const LanePatch &patch) {
    const Lanes g = most(gap / half, zero), rho = g + root(1.0 + g * g);
    const Lanes along = least(extent / (2.0 * half), zero + 1.0);
    const Lanes rises = (1.0 + spread(heights) * rho / 3.0) * (1.0 + spread(range_of(patch.density)) * rho / 3.0);
    const Lanes near = g > 0.5 ? least(g * g / 16.0, zero + 1.0) : zero + 1.0;
    return {1.0 / (rho * rho), along * along * along * along, rises, near};
}

// Errors of n = 2, 3 ... points one after the other.
struct Errors {
    Lanes power, inverse, along;
    Lanes next(int n) {
        power *= inverse;
        return power * POLE[n] * (SIDE[n] + (1 - SIDE[n]) * along);
    }
};

inline Errors errors_of(const Side &side) { return {2.0 * side.rises * side.inverse, side.inverse, side.along}; }

inline bool any_above(const Lanes &a, double limit) {
    bool any = false;
    for (int k = 0; k < LANES; ++k) any |= a[k] > limit;
    return any;
}

// The cheapest way whose error is small enough: points on both, points on the smaller, contour.
Lanes way_of(const Side &i, const Side &j, const Lanes &larger_i, const Demand &demand) {
    Errors of_i = errors_of(i), of_j = errors_of(j);
    const Lanes near = larger_i > 0.0 ? j.near : i.near, base = larger_i > 0.0 ? all(ON_J) : all(ON_I);
    Lanes way = all(BY_CONTOUR);
    for (int n = 2; n <= demand.highest_order; ++n) {
        const Lanes error_i = of_i.next(n), error_j = of_j.next(n);
        const Lanes error = near * (larger_i > 0.0 ? error_j : error_i);
        if (n <= MAX_FAR) way = (way >= all(ON_I)) & (error_i + error_j <= demand.tolerance) ? all(FAR + n) : way;
        way = (way == all(BY_CONTOUR)) & (error <= demand.tolerance) ? base + all(n) : way;
        if (n >= MAX_FAR && !any_above(way, BY_CONTOUR - 1)) break;
    }
    return way;
}

void ways_of(const Outer &i, const PatchBlock &block, const PairFrame &frame, const Demand &demand, int *way) {
    const Lanes distance = root(dot(frame.centre, frame.centre)), inverse = 1.0 / (distance + TINY);
    const LaneVec origin = {zero, zero, zero}, c = frame.centre;
    const LaneVec line = {c.x * inverse, c.y * inverse, c.z * inverse};
    const Range over_i = range_along(frame.i.normal, frame.j, origin);
    const Range over_j = range_along(frame.j.normal, frame.i, c);
    const Range along_i = range_along(line, frame.i, origin), along_j = range_along(line, frame.j, origin);
    const Lanes half_i = zero + i.field[HALF], half_j = load(block.field[HALF]), gap = along_j.low - along_i.high;
    const Side side_i = side_of(gap, along_i.high - along_i.low, half_i, over_j, frame.i);
    const Side side_j = side_of(gap, along_j.high - along_j.low, half_j, over_i, frame.j);
    const Lanes noise_i = demand.roundoff * (2.0 + distance / i.field[THIN]);
    const Lanes noise_j = demand.roundoff * (2.0 + distance / load(block.field[THIN]));
    Lanes found = way_of(side_i, side_j, half_i - half_j, demand);
    found = (over_i.low < -noise_i) | (over_j.low < -noise_j) ? all(BY_CONTOUR) : found;
    found = (over_i.high <= noise_i) | (over_j.high <= noise_j) ? all(UNSEEN) : found;
    for (int k = 0; k < LANES; ++k) way[k] = static_cast<int>(found[k]);
}

void make_points(Outer &i, int order) {
    const GaussRule &rule = gauss_rule(order);
    Points &o = i.points[order];
    const double *f = i.field;
    for (int a = 0; a < order; ++a)
        for (int b = 0; b < order; ++b) {
            double share[4], at[3] = {0, 0, 0}, density = 0;
            shares_at(rule.node[a], rule.node[b], share);
            for (int k = 0; k < 4; ++k) {
                for (int axis = 0; axis < 3; ++axis)
                    at[axis] += share[k] * (f[CORNER + 3 * k + axis] - f[CENTRE + axis]);
                density += share[k] * f[DENSITY + k];
            }
            o.x[o.n] = at[0], o.y[o.n] = at[1], o.z[o.n] = at[2];
            o.weight[o.n++] = rule.weight[a] * rule.weight[b] * density;
        }
    if (o.n % 2) {
        o.x[o.n] = o.x[o.n - 1], o.y[o.n] = o.y[o.n - 1], o.z[o.n] = o.z[o.n - 1];
        o.weight[o.n++] = 0;
    }
}

// Sum over i's points of weight, height over j's plane and 1 / r^4; two fractions a division.
inline Lanes points_sum(const Points &p, const Lanes *height, const LaneVec &q) {
    Lanes sum = {};
    for (int k = 0; k < p.n; k += 2) {
        const Lanes x0 = q.x - p.x[k], y0 = q.y - p.y[k], z0 = q.z - p.z[k];
        const Lanes x1 = q.x - p.x[k + 1], y1 = q.y - p.y[k + 1], z1 = q.z - p.z[k + 1];
        const Lanes r0 = x0 * x0 + y0 * y0 + z0 * z0, r1 = x1 * x1 + y1 * y1 + z1 * z1;
        const Lanes s0 = r0 * r0, s1 = r1 * r1;
        sum += (height[k] * s1 + height[k + 1] * s0) / (s0 * s1);
    }
    return sum;
}

void points_to_points(Outer &i, const PairFrame &frame, int order, double *value) {
    if (i.points[order].n == 0) make_points(i, order);
    const Points &p = i.points[order];
    const GaussRule &rule = gauss_rule(order);
    const LanePatch &j = frame.j;
    const LaneVec &c = frame.centre;
    Lanes height[MAX_FAR * MAX_FAR + 1], total = {};
    for (int k = 0; k < p.n; ++k)
        height[k] = p.weight[k] * dot(LaneVec{p.x[k] - c.x, p.y[k] - c.y, p.z[k] - c.z}, j.normal);
    for (int a = 0; a < order; ++a)
        for (int b = 0; b < order; ++b) {
            double share[4];
            shares_at(rule.node[a], rule.node[b], share);
            LaneVec q = {};
            Lanes weight = {};
            for (int k = 0; k < 4; ++k) {
                q.x += share[k] * j.corner[k].x, q.y += share[k] * j.corner[k].y, q.z += share[k] * j.corner[k].z;
                weight += share[k] * j.density[k];
            }
            total += rule.weight[a] * rule.weight[b] * weight * dot(frame.i.normal, q) * points_sum(p, height, q);
        }
    total *= 1 / PI;
    std::memcpy(value, &total, sizeof total);
}

}  // namespace

void far_exchange_areas(Outer &i, const PatchBlock &block, const Demand &demand, int *way, double *value) {
    const double *centre = i.field + CENTRE;
    const double(*c)[LANES] = block.field + CENTRE;
    const PairFrame frame{patch_of(i.field), patch_of(block, centre),
                      {load(c[0]) - centre[0], load(c[1]) - centre[1], load(c[2]) - centre[2]}};
    ways_of(i, block, frame, demand, way);
    for (int n = 2; n <= MAX_FAR; ++n) {
        bool wanted = false;
        for (int k = 0; k < LANES; ++k) wanted |= way[k] == FAR + n;
        if (!wanted) continue;
        double values[LANES];
        points_to_points(i, frame, n, values);
        for (int k = 0; k < LANES; ++k)
            if (way[k] == FAR + n) value[k] = values[k];
    }
}

void point_exchange_areas(const Outer &i, const PatchBlock &block, int way, double *value) {
    const LanePatch patch = patch_of(i.field), other = patch_of(block, i.field + CENTRE);
    if (way < ON_J)
        points_to_polygon(patch, other, way - ON_I, value);
    else
        points_to_polygon(other, patch, way - ON_J, value);
}

}  // namespace kernel::KERNEL_INSTRUCTION_SET
