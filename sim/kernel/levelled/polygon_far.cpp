// Gauss x Gauss for pairs far apart against their size: A F = 1/pi sum w_p w_q h_q h_p / r^4.
//
// r cos is the height of one point over the other patch's plane, so each point has one for all of the other's.
#include <algorithm>
#include <cmath>
#include <cstring>

#include "polygon_pairs.hpp"

namespace kernel::KERNEL_LEVEL {

namespace {

typedef double Lanes __attribute__((vector_size(8 * LANES)));

struct LaneVec {
    Lanes x, y, z;
};

inline Lanes load(const double *p) {
    Lanes v;
    std::memcpy(&v, p, sizeof v);
    return v;
}

inline Lanes least(Lanes a, Lanes b) { return a < b ? a : b; }
inline Lanes most(Lanes a, Lanes b) { return a > b ? a : b; }
inline Lanes dot(const LaneVec &a, const LaneVec &b) { return a.x * b.x + a.y * b.y + a.z * b.z; }

// The patches j of a block, seen from the centre of i.
struct Seen {
    LaneVec corner[4], normal, centre;
};

Seen seen_from(const double *centre, const Block &block) {
    Seen o;
    for (int k = 0; k < 4; ++k) {
        const double(*f)[LANES] = block.field + CORNER + 3 * k;
        o.corner[k] = {load(f[0]) - centre[0], load(f[1]) - centre[1], load(f[2]) - centre[2]};
    }
    const double(*n)[LANES] = block.field + NORMAL, (*c)[LANES] = block.field + CENTRE;
    o.normal = {load(n[0]), load(n[1]), load(n[2])};
    o.centre = {load(c[0]) - centre[0], load(c[1]) - centre[1], load(c[2]) - centre[2]};
    return o;
}

struct Range {
    Lanes low, high;
};

inline void widen(Range &range, Lanes value) {
    range.low = least(range.low, value);
    range.high = most(range.high, value);
}

// Half the spread over the mean, of what is not below 0.
inline Lanes spread(const Range &range) { return (range.high - range.low) / (range.high + range.low + 1e-300); }

inline Range density_of(const Outer &i) {
    const double *d = i.field + DENSITY;
    const Lanes zero = {};
    return {zero + std::min(std::min(d[0], d[1]), std::min(d[2], d[3])),
            zero + std::max(std::max(d[0], d[1]), std::max(d[2], d[3]))};
}

inline Range density_of(const Block &block) {
    Range range = {load(block.field[DENSITY]), load(block.field[DENSITY])};
    for (int k = 1; k < 4; ++k) widen(range, load(block.field[DENSITY + k]));
    return range;
}

inline int order_for(double rho, double along, double rises, const Demand &demand) {
    const double inverse = 1 / (rho * rho), c4 = along * along * along * along;
    double error = 4 * rises * inverse;
    for (int n = 2; n <= demand.highest_order; ++n) {
        error *= inverse;
        if (error * POLE[n] * (SIDE[n] + (1 - SIDE[n]) * c4) <= demand.tolerance) return n;
    }
    return BY_CONTOUR;
}

// Heights over i's plane, heights of i over j's, and the gap between planes across the line of centres.
void orders_of(const Outer &i, const Block &block, const Seen &j, const Demand &demand, int *order) {
    const double *f = i.field;
    const Lanes zero = {}, distance2 = dot(j.centre, j.centre);
    Lanes distance;
    for (int k = 0; k < LANES; ++k) distance[k] = std::sqrt(distance2[k]);
    Range over_i, over_j, along_i, along_j;
    for (int k = 0; k < 4; ++k) {
        const double *p = f + CORNER + 3 * k;
        const LaneVec mine = {zero + (p[0] - f[CENTRE]), zero + (p[1] - f[CENTRE + 1]), zero + (p[2] - f[CENTRE + 2])};
        const LaneVec normal = {zero + f[NORMAL], zero + f[NORMAL + 1], zero + f[NORMAL + 2]};
        const LaneVec from_j = {mine.x - j.centre.x, mine.y - j.centre.y, mine.z - j.centre.z};
        const Lanes values[4] = {dot(normal, j.corner[k]), dot(j.normal, from_j), dot(mine, j.centre),
                                 dot(j.corner[k], j.centre)};
        Range *ranges[4] = {&over_i, &over_j, &along_i, &along_j};
        for (int r = 0; r < 4; ++r) {
            if (k == 0) *ranges[r] = {values[r], values[r]};
            widen(*ranges[r], values[r]);
        }
    }
    const Lanes half = most(load(block.field[HALF]), zero + f[HALF]), thin = load(block.field[THIN]);
    const Lanes g = (along_j.low - along_i.high) / (distance * half + 1e-300), under = 1.0 + g * g;
    Lanes rho;
    for (int k = 0; k < LANES; ++k) rho[k] = g[k] > 0 ? g[k] + std::sqrt(under[k]) : 1;
    const Lanes along = least(most(along_i.high - along_i.low, along_j.high - along_j.low) /
                                  (2.0 * distance * half + 1e-300), zero + 1.0);
    const Lanes third = rho / 3.0;
    const Lanes rises = most((1.0 + spread(over_j) * third) * (1.0 + spread(density_of(i)) * third),
                             (1.0 + spread(over_i) * third) * (1.0 + spread(density_of(block)) * third));
    const Lanes noise_i = demand.roundoff * (1.0 + distance / f[THIN]), noise_j = demand.roundoff * (1.0 + distance / thin);
    for (int k = 0; k < LANES; ++k) {
        const bool unseen = over_i.high[k] <= noise_i[k] || over_j.high[k] <= noise_j[k];
        const bool cut = over_i.low[k] < -noise_i[k] || over_j.low[k] < -noise_j[k];
        order[k] = unseen ? UNSEEN : cut ? BY_CONTOUR : order_for(rho[k], along[k], rises[k], demand);
    }
}

// Corners' shares in the bilinear map at (u, v).
inline void shares_at(double u, double v, double *share) {
    share[0] = (1 - u) * (1 - v);
    share[1] = u * (1 - v);
    share[2] = u * v;
    share[3] = (1 - u) * v;
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
                for (int axis = 0; axis < 3; ++axis) at[axis] += share[k] * (f[CORNER + 3 * k + axis] - f[CENTRE + axis]);
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

Lanes far_value(Outer &i, const Block &block, const Seen &j, int order) {
    if (i.points[order].n == 0) make_points(i, order);
    const Points &p = i.points[order];
    const GaussRule &rule = gauss_rule(order);
    Lanes height[MAX_ORDER * MAX_ORDER + 1], total = {};
    for (int k = 0; k < p.n; ++k)
        height[k] = p.weight[k] * ((p.x[k] - j.centre.x) * j.normal.x + (p.y[k] - j.centre.y) * j.normal.y +
                                   (p.z[k] - j.centre.z) * j.normal.z);
    const double *normal = i.field + NORMAL;
    for (int a = 0; a < order; ++a)
        for (int b = 0; b < order; ++b) {
            double share[4];
            shares_at(rule.node[a], rule.node[b], share);
            LaneVec q = {};
            Lanes weight = {};
            for (int k = 0; k < 4; ++k) {
                q.x += share[k] * j.corner[k].x, q.y += share[k] * j.corner[k].y, q.z += share[k] * j.corner[k].z;
                weight += share[k] * load(block.field[DENSITY + k]);
            }
            weight *= rule.weight[a] * rule.weight[b] * (normal[0] * q.x + normal[1] * q.y + normal[2] * q.z);
            Lanes sum = {};
            for (int k = 0; k < p.n; k += 2) {  // two fractions, one division
                const Lanes x0 = q.x - p.x[k], y0 = q.y - p.y[k], z0 = q.z - p.z[k];
                const Lanes x1 = q.x - p.x[k + 1], y1 = q.y - p.y[k + 1], z1 = q.z - p.z[k + 1];
                const Lanes r0 = x0 * x0 + y0 * y0 + z0 * z0, r1 = x1 * x1 + y1 * y1 + z1 * z1;
                const Lanes s0 = r0 * r0, s1 = r1 * r1;
                sum += (height[k] * s1 + height[k + 1] * s0) / (s0 * s1);
            }
            total += weight * sum;
        }
    return total * (1 / PI);
}

}  // namespace

void far_exchange_areas(Outer &i, const Block &block, const Demand &demand, int *order, double *value) {
    const Seen j = seen_from(i.field + CENTRE, block);
    orders_of(i, block, j, demand, order);
    for (int n = 2; n <= MAX_ORDER; ++n) {
        bool wanted = false;
        for (int k = 0; k < LANES; ++k) wanted |= order[k] == n;
        if (!wanted) continue;
        const Lanes values = far_value(i, block, j, n);
        for (int k = 0; k < LANES; ++k)
            if (order[k] == n) value[k] = values[k];
    }
}

}  // namespace kernel::KERNEL_LEVEL
