// Sixteenths of patches: each halved four times, as AdaptivePatches.halves() does it, which is their definition.
#include <array>

#include "arrays.hpp"
#include "bindings.hpp"
#include "geometry/vectors.hpp"

namespace {

using namespace kernel;

constexpr int CUTS = 4, PIECES = 1 << CUTS;

// Four corners; a triangle repeats its last.
struct Patch {
    Vec corner[4];
};

struct Halves {
    Patch first, second;
};

int longest_edge(const Patch &patch) {
    int longest = 0;
    double most = -1;
    for (int k = 0; k < 3; ++k) {
        const double length = norm(patch.corner[(k + 1) % 3] - patch.corner[k]);
        if (length > most) most = length, longest = k;
    }
    return longest;
}

inline Vec middle(Vec a, Vec b) { return {(a.x + b.x) / 2, (a.y + b.y) / 2, (a.z + b.z) / 2}; }

// Turned so that the edge to cut is the first.
Halves halves(const Patch &patch, bool triangular, int across) {
    const int turn = triangular ? longest_edge(patch) : across, count = triangular ? 3 : 4;
    const auto corner = [&](int k) { return patch.corner[(k + turn) % count]; };
    const Vec a = corner(0), b = corner(1), c = corner(2), d = triangular ? c : corner(3);
    const Vec low = middle(a, b), high = triangular ? c : middle(c, d);
    return {{{a, low, high, d}}, {{low, b, c, high}}};
}

// Piece k of 2^n becomes k and, after all first halves, k + 2^n.
std::array<Patch, PIECES> pieces_of(const Patch &patch, bool triangular) {
    std::array<Patch, PIECES> pieces{{patch}};
    for (int cut = 0; cut < CUTS; ++cut)
        for (int k = 0, count = 1 << cut; k < count; ++k) {
            const Halves both = halves(pieces[k], triangular, cut % 2);
            pieces[k] = both.first;
            pieces[k + count] = both.second;
        }
    return pieces;
}

void put(Vec value, double *out) { out[0] = value.x, out[1] = value.y, out[2] = value.z; }

// Area and centroid, of the two triangles.
double area_of(const Patch &patch, double *centre) {
    const Vec &a = patch.corner[0], &b = patch.corner[1], &c = patch.corner[2], &d = patch.corner[3];
    const double one = norm(cross(b - a, c - a)) / 2, other = norm(cross(c - a, d - a)) / 2, area = one + other;
    for (int axis = 0; axis < 3; ++axis) {
        const double shared = component(a, axis) + component(c, axis);
        const double first = (component(a, axis) + component(b, axis) + component(c, axis)) / 3;
        const double second = (shared + component(d, axis)) / 3;
        centre[axis] = (one * first + other * second) / area;
    }
    return area;
}

// Of n patches piece k of patch p is number k n + p.
void sixteenths(In<double, 3> vertices, Out<double, 3> corners, Out<double, 2> centres, Out<double, 1> areas) {
    const auto n = static_cast<std::int64_t>(vertices.shape(0));
#pragma omp parallel for schedule(static)
    for (std::int64_t p = 0; p < n; ++p) {
        const double *from = vertices.data() + 12 * p;
        const Patch patch{{load(from), load(from + 3), load(from + 6), load(from + 9)}};
        const std::array<Patch, PIECES> pieces = pieces_of(patch, std::equal(from + 6, from + 9, from + 9));
        for (std::int64_t k = 0; k < PIECES; ++k) {
            const std::int64_t at = k * n + p;
            for (int corner = 0; corner < 4; ++corner) put(pieces[k].corner[corner], corners.data() + 12 * at + 3 * corner);
            areas.data()[at] = area_of(pieces[k], centres.data() + 3 * at);
        }
    }
}

}  // namespace

void bind_sixteenths(nb::module_ &m) {
    m.def("sixteenths", &sixteenths, nb::arg("vertices"), nb::arg("corners"), nb::arg("centres"), nb::arg("areas"),
          nb::call_guard<nb::gil_scoped_release>());
}
