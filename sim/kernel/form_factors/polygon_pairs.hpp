// Exchange areas A F of pairs of flat convex patches of three or four corners.
//
// Far pairs: Gauss points on both patches (simd/polygon_far.cpp). Nearer ones: Gauss points on one, the exact
// factor to the other (simd/polygon_points.cpp); both eight pairs at a time. Touching pairs, and those cut by
// the plane of one of the two: contour integrals (polygon_contour.cpp).
#pragma once
#include <cstdint>
#include <vector>

#include "form_factors/gauss.hpp"
#include "geometry/vectors.hpp"
#include "instruction_set.hpp"

namespace kernel {

struct Polygon;

constexpr int LANES = 8;
constexpr int MAX_FAR = 3;     // points along a side on both patches; above it, exact factors are cheaper
constexpr int MAX_ORDER = 10;  // points along a side on one patch; above it, the contour is cheaper
// Relative error that n x n Gauss points on one patch make: below
//   2 POLE[n] (SIDE[n] + (1 - SIDE[n]) c^4) (1 + s rho / 3) (1 + d rho / 3) rho^-2n,   rho = g + sqrt(1 + g^2),
// g = gap / half its longest edge (Bernstein's ellipse), c = its extent along the line of centres over that edge,
// s and d = spread over sum of the extremes of its heights over the other's plane and of its area element. POLE and
// SIDE: the error in 1/r^4 along and across that line, from its Gegenbauer series. Points on both patches: the sum of
// both's errors. Points on one: times (g / 4)^2 for g in 0.5 ... 4, as the exact factor to the other softens the
// pole (measured).
constexpr double POLE[MAX_ORDER + 1] = {0, 0, 49.8, 122.9, 245.2, 429.3, 687.8, 1033.1, 1478.0, 2034.9, 2716.5};
constexpr double SIDE[MAX_ORDER + 1] = {0, 0, 0.0857, 0.0476, 0.0303, 0.0210, 0.0154, 0.0118, 0.0093, 0.0075, 0.0062};

// Columns of a table of patches. A corner's density is the area element of the bilinear map at that corner.
enum Field { CORNER = 0, DENSITY = 12, NORMAL = 16, CENTRE = 19, AREA = 22, HALF = 23, THIN = 24, FIELDS = 25 };

// All patches, one row a field; lengths from the middle of the surface.
struct Patches {
    std::int64_t n;
    double extent;  // largest coordinate
    std::vector<double> field[FIELDS];
};
Patches patches_of(const double *vertices, std::int64_t n);

// Some patches j in lanes.
struct PatchBlock {
    alignas(64) double field[FIELDS][LANES];
};

// Gauss points of one patch; an odd number is filled up with a point without weight.
struct Points {
    int n = 0;  // 0: not made yet
    double x[MAX_FAR * MAX_FAR + 1], y[MAX_FAR * MAX_FAR + 1], z[MAX_FAR * MAX_FAR + 1];
    double weight[MAX_FAR * MAX_FAR + 1];
};

// The patch i of a row: its fields, and its points of each order relative to its centre.
struct Outer {
    double field[FIELDS];
    Points points[MAX_FAR + 1];
};

struct Demand {
    double tolerance;   // relative error of a pair
    int highest_order;  // points along a side, up to MAX_ORDER
    double roundoff;    // of coordinates [m]
};

// How a pair is done. A far rule of order n is FAR + n, points on the smaller patch ON_I + n or ON_J + n.
enum Way { UNSEEN = 0, FAR = 0, ON_I = 16, ON_J = 32, BY_CONTOUR = 64 };

// Way of each lane, and the value of lanes with a far rule.
KERNEL_DECLARE(void far_exchange_areas(Outer &i, const PatchBlock &j, const Demand &demand, int *way, double *value))

// All lanes by points on one patch.
KERNEL_DECLARE(void point_exchange_areas(const Outer &i, const PatchBlock &j, int way, double *value))

// Two polygons that lie wholly before each other's plane, to a relative tolerance.
double contour_exchange_area(const Polygon &a, const Polygon &b, double tolerance);

// The same for any two patches: each is first cut by the other's plane.
double near_exchange_area(const Patches &patches, std::int64_t i, std::int64_t j, double tolerance);

// Pairs (i, j[0 ... n)); j == nullptr stands for i + 1, i + 2, ...
void exchange_areas_of_row(const Patches &patches, const Demand &demand, std::int64_t i, const std::int64_t *j,
                           std::int64_t n, double *out);

}  // namespace kernel
