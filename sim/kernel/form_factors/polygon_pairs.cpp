// Exchange areas between all flat convex patches of a surface, or between chosen pairs of them.
#include "form_factors/polygon_pairs.hpp"

#include <omp.h>

#include <algorithm>
#include <cmath>
#include <cstring>

#include "arrays.hpp"
#include "bindings.hpp"
#include "interrupt.hpp"
#include "geometry/polygon.hpp"

namespace kernel {
namespace {

Vec vec_of(const Patches &patches, int field, std::int64_t i) {
    return {patches.field[field][i], patches.field[field + 1][i], patches.field[field + 2][i]};
}

void put(Patches &patches, int field, std::int64_t i, Vec v) {
    patches.field[field][i] = v.x;
    patches.field[field + 1][i] = v.y;
    patches.field[field + 2][i] = v.z;
}

void put_patch(Patches &o, std::int64_t i, const Vec *corner) {
    // Half the cross product of the diagonals, for triangles and flat quads alike.
    const Vec twice = cross(corner[2] - corner[0], corner[3] - corner[1]);
    const double area = 0.5 * norm(twice);
    const Vec normal = 0.5 / area * twice;
    double longest = 0;
    for (int k = 0; k < 4; ++k) {
        const Vec next = corner[(k + 1) % 4] - corner[k], last = corner[(k + 3) % 4] - corner[k];
        put(o, CORNER + 3 * k, i, corner[k]);
        o.field[DENSITY + k][i] = dot(cross(next, last), normal);
        longest = std::max(longest, norm(next));
    }
    put(o, NORMAL, i, normal);
    put(o, CENTRE, i, 0.25 * (corner[0] + corner[1] + corner[2] + corner[3]));
    o.field[AREA][i] = area;
    o.field[HALF][i] = 0.5 * longest;
    o.field[THIN][i] = area / longest;
}

Polygon polygon_of(const Patches &patches, std::int64_t i) {
    Polygon o;
    for (int k = 0; k < 4; ++k) {
        const Vec corner = vec_of(patches, CORNER + 3 * k, i);
        const bool repeated = o.n > 0 && norm(corner - o.corner[o.n - 1]) == 0;
        if (!repeated) o.corner[o.n++] = corner;
    }
    return o;
}

// The part of a patch that lies before another's plane; all of it where only roundoff lies behind.
Polygon part_before(const Patches &patches, std::int64_t i, std::int64_t plane) {
    const Polygon whole = polygon_of(patches, i);
    const Vec normal = vec_of(patches, NORMAL, plane), centre = vec_of(patches, CENTRE, plane);
    const double distance = norm(vec_of(patches, CENTRE, i) - centre);
    const double noise = 1e-15 * patches.extent * (2 + distance / patches.field[THIN][plane]);
    double lowest = 0;
    for (int k = 0; k < whole.n; ++k) lowest = std::min(lowest, dot(normal, whole.corner[k] - centre));
    return lowest < -noise ? part_above(whole, normal, dot(normal, centre), 0) : whole;
}

inline std::int64_t other_of(const std::int64_t *j, std::int64_t i, std::int64_t k) { return j ? j[k] : i + 1 + k; }

void fill(const Patches &patches, const std::int64_t *others, bool in_a_row, PatchBlock &block) {
    for (int f = 0; f < FIELDS; ++f) {
        const double *field = patches.field[f].data();
        if (in_a_row)
            std::memcpy(block.field[f], field + others[0], sizeof block.field[f]);
        else
            for (int k = 0; k < LANES; ++k) block.field[f][k] = field[others[k]];
    }
}

// Pairs of a row, by their place, that wait until there are enough of one way to fill the lanes.
struct Waiting {
    int count[BY_CONTOUR] = {};
    std::int64_t place[BY_CONTOUR][LANES];
    bool add(int way, std::int64_t where) {
        place[way][count[way]++] = where;
        return count[way] == LANES;
    }
};

void serve(const Patches &patches, const Outer &outer, const std::int64_t *j, std::int64_t i, int way,
           Waiting &waiting, double *out) {
    const int count = waiting.count[way];
    std::int64_t others[LANES];
    for (int k = 0; k < LANES; ++k) others[k] = other_of(j, i, waiting.place[way][std::min(k, count - 1)]);
    PatchBlock block;
    double value[LANES];
    fill(patches, others, false, block);
    KERNEL_CALL(point_exchange_areas(outer, block, way, value));
    for (int k = 0; k < count; ++k) out[waiting.place[way][k]] = value[k];
    waiting.count[way] = 0;
}

void mirror(double *matrix, std::int64_t n) {
    constexpr std::int64_t TILE = 32;
#pragma omp parallel for schedule(dynamic, 1)
    for (std::int64_t top = 0; top < n; top += TILE)
        for (std::int64_t left = 0; left <= top; left += TILE)
            for (std::int64_t i = top; i < std::min(top + TILE, n); ++i)
                for (std::int64_t j = left; j < std::min(left + TILE, i); ++j) matrix[i * n + j] = matrix[j * n + i];
}

// vertices (P, 4, 3). Fills exchange (P, P).
void polygon_exchange_areas(In<double, 3> vertices, double tolerance, int highest_order, Out<double, 2> exchange) {
    const Patches patches = patches_of(vertices.data(), vertices.shape(0));
    const Demand demand{tolerance, highest_order, 1e-15 * patches.extent};
    const std::int64_t n = patches.n;
    Interruption interruption;
#pragma omp parallel for schedule(dynamic, 2)
    for (std::int64_t i = 0; i < n; ++i) {
        if (interruption.stopped()) continue;
        double *row = exchange.data() + i * n;
        row[i] = 0;
        exchange_areas_of_row(patches, demand, i, nullptr, n - 1 - i, row + i + 1);
    }
    interruption.finish();
    mirror(exchange.data(), n);
}

// Pairs (first[k], second[k]); fast where equal first ones stand together. Fills exchange (K,).
void polygon_exchange_areas_of_pairs(In<double, 3> vertices, In<std::int64_t, 1> first, In<std::int64_t, 1> second,
                                     double tolerance, int highest_order, Out<double, 1> exchange) {
    const Patches patches = patches_of(vertices.data(), vertices.shape(0));
    const Demand demand{tolerance, highest_order, 1e-15 * patches.extent};
    const std::int64_t n = static_cast<std::int64_t>(first.shape(0));
    const std::int64_t *i = first.data();
    std::vector<std::int64_t> start;
    for (std::int64_t k = 0; k < n; ++k)
        if (k == 0 || i[k] != i[k - 1] || k - start.back() >= 1024) start.push_back(k);
    const std::int64_t runs = static_cast<std::int64_t>(start.size());
    start.push_back(n);
    Interruption interruption;
#pragma omp parallel for schedule(dynamic, 4)
    for (std::int64_t r = 0; r < runs; ++r)
        if (!interruption.stopped())
            exchange_areas_of_row(patches, demand, i[start[r]], second.data() + start[r], start[r + 1] - start[r],
                                  exchange.data() + start[r]);
    interruption.finish();
}

}  // namespace

Patches patches_of(const double *vertices, std::int64_t n) {
    Patches o;
    o.n = n;
    for (auto &field : o.field) field.resize(n);
    double low[3] = {HUGE_VAL, HUGE_VAL, HUGE_VAL}, high[3] = {-HUGE_VAL, -HUGE_VAL, -HUGE_VAL};
    for (std::int64_t k = 0; k < 12 * n; ++k) {
        low[k % 3] = std::min(low[k % 3], vertices[k]);
        high[k % 3] = std::max(high[k % 3], vertices[k]);
    }
    const Vec middle = 0.5 * (load(low) + load(high));
    o.extent = 0;
    for (int axis = 0; axis < 3; ++axis)
        o.extent = std::max({o.extent, std::fabs(low[axis]), std::fabs(high[axis])});
    for (std::int64_t i = 0; i < n; ++i) {
        Vec corner[4];
        for (int k = 0; k < 4; ++k) corner[k] = load(vertices + 12 * i + 3 * k) - middle;
        put_patch(o, i, corner);
    }
    return o;
}

double near_exchange_area(const Patches &patches, std::int64_t i, std::int64_t j, double tolerance) {
    const Polygon a = part_before(patches, i, j), b = part_before(patches, j, i);
    return a.n && b.n ? contour_exchange_area(a, b, tolerance) : 0;
}

void exchange_areas_of_row(const Patches &patches, const Demand &demand, std::int64_t i, const std::int64_t *j,
                           std::int64_t n, double *out) {
    Outer outer;
    for (int f = 0; f < FIELDS; ++f) outer.field[f] = patches.field[f][i];
    Waiting waiting;
    PatchBlock block;
    for (std::int64_t begin = 0; begin < n; begin += LANES) {
        const int count = static_cast<int>(std::min<std::int64_t>(LANES, n - begin));
        std::int64_t others[LANES];
        int way[LANES];
        double value[LANES];
        for (int k = 0; k < LANES; ++k) others[k] = other_of(j, i, begin + std::min(k, count - 1));
        fill(patches, others, j == nullptr && count == LANES, block);
        KERNEL_CALL(far_exchange_areas(outer, block, demand, way, value));
        for (int k = 0; k < count; ++k)
            if (way[k] == BY_CONTOUR)
                out[begin + k] = near_exchange_area(patches, i, others[k], demand.tolerance);
            else if (way[k] < ON_I)
                out[begin + k] = way[k] == UNSEEN ? 0 : value[k];
            else if (waiting.add(way[k], begin + k))
                serve(patches, outer, j, i, way[k], waiting, out);
    }
    for (int way = ON_I; way < BY_CONTOUR; ++way)
        if (waiting.count[way] > 0) serve(patches, outer, j, i, way, waiting, out);
    for (std::int64_t k = 0; k < n; ++k) {
        const double most = std::min(patches.field[AREA][i], patches.field[AREA][other_of(j, i, k)]);
        out[k] = std::min(std::max(out[k], 0.0), most);
    }
}

}  // namespace kernel

void bind_polygon(nb::module_ &m) {
    const auto release = nb::call_guard<nb::gil_scoped_release>();
    m.def("polygon_exchange_areas", &kernel::polygon_exchange_areas, nb::arg("vertices"), nb::arg("tolerance"),
          nb::arg("highest_order"), nb::arg("exchange"), release);
    m.def("polygon_exchange_areas_of_pairs", &kernel::polygon_exchange_areas_of_pairs, nb::arg("vertices"),
          nb::arg("first"), nb::arg("second"), nb::arg("tolerance"), nb::arg("highest_order"), nb::arg("exchange"),
          release);
}
