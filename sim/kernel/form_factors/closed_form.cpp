// Form factors between all patches of gridded rectangles that are parallel or perpendicular.
//
// Along an axis that two grids share only the difference of two cells matters, and a regular grid has few of
// those: each pair of faces needs a small table of exchange areas, and every factor is one look-up.
#include <algorithm>
#include <cmath>
#include <vector>

#include "arrays.hpp"
#include "bindings.hpp"
#include "interrupt.hpp"
#include "form_factors/exchange_run.hpp"
#include "geometry/vectors.hpp"

namespace kernel {
namespace {

struct Grid {  // one face: cells along u (columns) and v (rows)
    Vec origin, axis[2], normal;
    double pitch[2];
    int cells[2];
    std::int64_t first;
};

struct Interval {
    double low, high;
};

// Cells of a against cells of b along one direction, and the classes of pairs that are the same to the factor.
struct Axis {
    int of_a, of_b;           // 0: along u, 1: along v
    int n_classes;
    std::vector<int> klass;   // [cell of a][cell of b]
    std::vector<Interval> a, b;  // of each class
};

struct FacePair {
    int a, b;
    bool parallel;
    double gap;
    Axis x, y;
    std::vector<double> table;  // [class of x][class of y] exchange areas
};

// Which of a face's two axes runs along a direction.
int axis_along(const Grid &face, Vec direction) {
    return std::fabs(dot(face.axis[0], direction)) >= std::fabs(dot(face.axis[1], direction)) ? 0 : 1;
}

Interval cell(const Grid &face, int axis, Vec direction, Vec zero, int index) {
    const double start = dot(face.origin - zero, direction);
    const double step = std::copysign(face.pitch[axis], dot(face.axis[axis], direction));
    const double one = start + step * index, other = start + step * (index + 1);
    return {std::min(one, other), std::max(one, other)};
}

// Pitches as whole multiples of a common one, so that differences of cells fall into few classes.
bool commensurable(double pitch_a, double pitch_b, int &p, int &q) {
    for (q = 1; q <= 12; ++q) {
        p = static_cast<int>(std::lround(pitch_a / pitch_b * q));
        if (p >= 1 && p <= 12 && std::fabs(p * pitch_b - q * pitch_a) <= 1e-11 * pitch_a) return true;
    }
    return false;
}

Axis shared_axis(const Grid &a, int axis_a, const Grid &b, int axis_b) {
    const Vec direction = a.axis[axis_a], zero = a.origin;
    const int n_a = a.cells[axis_a], n_b = b.cells[axis_b];
    const int turn = dot(b.axis[axis_b], direction) > 0 ? 1 : -1;
    Axis o{axis_a, axis_b, 0, std::vector<int>(n_a * n_b), {}, {}};
    int p = 0, q = 0;
    const bool few = commensurable(a.pitch[axis_a], b.pitch[axis_b], p, q);
    const int least = turn > 0 ? -(n_b - 1) * q : 0;
    const int ids = few ? p * (n_a - 1) + q * (n_b - 1) + 1 : n_a * n_b;
    std::vector<int> found(ids, -1);
    for (int i = 0; i < n_a; ++i)
        for (int k = 0; k < n_b; ++k) {
            const int id = few ? p * i - turn * q * k - least : i * n_b + k;
            if (found[id] < 0) {
                found[id] = o.n_classes++;
                o.a.push_back(cell(a, axis_a, direction, zero, i));
                o.b.push_back(cell(b, axis_b, direction, zero, k));
            }
            o.klass[i * n_b + k] = found[id];
        }
    return o;
}

// Heights of each face's cells over the other's plane; what lies behind it is cut off.
Axis heights(const Grid &a, const Grid &b) {
    const int axis_a = axis_along(a, b.normal), axis_b = axis_along(b, a.normal);
    const int n_a = a.cells[axis_a], n_b = b.cells[axis_b];
    Axis o{axis_a, axis_b, n_a * n_b, std::vector<int>(n_a * n_b), {}, {}};
    const auto above = [](Interval i) { return Interval{std::max(i.low, 0.0), std::max(i.high, 0.0)}; };
    for (int i = 0; i < n_a; ++i)
        for (int k = 0; k < n_b; ++k) {
            o.klass[i * n_b + k] = i * n_b + k;
            o.a.push_back(above(cell(a, axis_a, b.normal, b.origin, i)));
            o.b.push_back(above(cell(b, axis_b, a.normal, a.origin, k)));
        }
    return o;
}

FacePair face_pair(const std::vector<Grid> &faces, int i, int j) {
    const Grid &a = faces[i], &b = faces[j];
    FacePair o{i, j, std::fabs(dot(a.normal, b.normal)) > 0.5, 0, {}, {}, {}};
    if (o.parallel) {
        o.gap = std::fabs(dot(b.origin - a.origin, a.normal));
        const int along_u = axis_along(b, a.axis[0]);
        o.x = shared_axis(a, 0, b, along_u);
        o.y = shared_axis(a, 1, b, 1 - along_u);
    } else {
        o.x = heights(a, b);
        o.y = shared_axis(a, 1 - o.x.of_a, b, 1 - o.x.of_b);
    }
    o.table.resize(static_cast<std::size_t>(o.x.n_classes) * o.y.n_classes);
    return o;
}

// RUN entries of a pair's table at a time.
void tabulate(FacePair &pair, std::size_t begin) {
    thread_local Run run;
    run.parallel = pair.parallel;
    run.n = static_cast<int>(std::min<std::size_t>(RUN, pair.table.size() - begin));
    for (int k = 0; k < run.n; ++k) {
        const std::size_t x = (begin + k) / pair.y.n_classes, y = (begin + k) % pair.y.n_classes;
        run.gap[k] = pair.gap;
        run.ax0[k] = pair.x.a[x].low, run.ax1[k] = pair.x.a[x].high;
        run.bx0[k] = pair.x.b[x].low, run.bx1[k] = pair.x.b[x].high;
        run.ay0[k] = pair.y.a[y].low, run.ay1[k] = pair.y.a[y].high;
        run.by0[k] = pair.y.b[y].low, run.by1[k] = pair.y.b[y].high;
    }
    KERNEL_CALL(exchange_areas(run, pair.table.data() + begin));
}

// One patch's factors to all patches of another face: a look-up each. Returns their sum.
double fill(const FacePair &pair, bool from_a, const int index[2], const int cells[2], double inverse_area,
            double *out) {
    // Place in the table of each column and each row of the other face.
    thread_local std::vector<std::size_t> place[2];
    const Axis *axes[2] = {&pair.x, &pair.y};
    for (int k = 0; k < 2; ++k) {
        const Axis &axis = *axes[k];
        const int mine = from_a ? axis.of_a : axis.of_b, theirs = from_a ? axis.of_b : axis.of_a;
        const int n_b = static_cast<int>(axis.klass.size()) / (from_a ? cells[mine] : cells[2 + theirs]);
        place[theirs].resize(cells[2 + theirs]);
        for (int c = 0; c < cells[2 + theirs]; ++c) {
            const int klass = from_a ? axis.klass[index[mine] * n_b + c] : axis.klass[c * n_b + index[mine]];
            place[theirs][c] = static_cast<std::size_t>(klass) * (k == 0 ? pair.y.n_classes : 1);
        }
    }
    const double *table = pair.table.data();
    const int columns = cells[2], rows = cells[3];
    double total = 0;
    for (int r = 0; r < rows; ++r) {
        const double *from = table + place[1][r];
        double *to = out + static_cast<std::size_t>(r) * columns;
        for (int c = 0; c < columns; ++c) to[c] = from[place[0][c]] * inverse_area;
        double sum = 0;
        for (int c = 0; c < columns; ++c) sum += to[c];
        total += sum;
    }
    return total;
}

std::vector<Grid> grids_of(In<double, 3> frames, In<std::int64_t, 2> counts) {
    std::vector<Grid> faces(frames.shape(0));
    for (std::size_t f = 0; f < faces.size(); ++f) {
        const double *o = frames.data() + 12 * f;
        const std::int64_t *n = counts.data() + 3 * f;
        const Vec u = load(o + 3), v = load(o + 6);
        const double length[2] = {norm(u), norm(v)};
        const int cells[2] = {static_cast<int>(n[0]), static_cast<int>(n[1])};
        faces[f] = {load(o), {1 / length[0] * u, 1 / length[1] * v}, load(o + 9),
                    {length[0] / cells[0], length[1] / cells[1]}, {cells[0], cells[1]}, n[2]};
    }
    return faces;
}

// frames (F, 4, 3): origin, edge u, edge v, unit normal. counts (F, 3): columns, rows, first patch.
// facing (F, F): which faces see each other. Fills factors (P, P) and row_sums (P,).
void grid_form_factors(In<double, 3> frames, In<std::int64_t, 2> counts, In<bool, 2> facing, Out<double, 2> factors,
                       Out<double, 1> row_sums) {
    const std::vector<Grid> faces = grids_of(frames, counts);
    const int n_faces = static_cast<int>(faces.size());
    const std::int64_t n_patches = static_cast<std::int64_t>(factors.shape(0));
    std::vector<std::pair<int, int>> seen;
    std::vector<int> pair_at(n_faces * n_faces, -1);
    for (int i = 0; i < n_faces; ++i)
        for (int j = i + 1; j < n_faces; ++j)
            if (facing.data()[i * n_faces + j]) {
                pair_at[i * n_faces + j] = pair_at[j * n_faces + i] = static_cast<int>(seen.size());
                seen.emplace_back(i, j);
            }
    std::vector<FacePair> pairs(seen.size());
    Interruption interruption;
#pragma omp parallel for schedule(dynamic, 1)
    for (std::size_t p = 0; p < seen.size(); ++p) pairs[p] = face_pair(faces, seen[p].first, seen[p].second);
    std::vector<std::pair<std::size_t, std::size_t>> work;
    for (std::size_t p = 0; p < pairs.size(); ++p)
        for (std::size_t begin = 0; begin < pairs[p].table.size(); begin += RUN) work.emplace_back(p, begin);
#pragma omp parallel
    {
#pragma omp for schedule(dynamic, 4)
        for (std::size_t w = 0; w < work.size(); ++w)
            if (!interruption.stopped()) tabulate(pairs[work[w].first], work[w].second);
#pragma omp for schedule(dynamic, 8)
        for (std::int64_t patch = 0; patch < n_patches; ++patch) {
            if (interruption.stopped()) continue;
            int f = 0;
            while (f + 1 < n_faces && faces[f + 1].first <= patch) ++f;
            const Grid &face = faces[f];
            const int local = static_cast<int>(patch - face.first);
            const int index[2] = {local % face.cells[0], local / face.cells[0]};
            const double inverse_area = 1 / (face.pitch[0] * face.pitch[1]);
            double sum = 0;
            for (int g = 0; g < n_faces; ++g) {
                double *out = factors.data() + patch * n_patches + faces[g].first;
                const int at = pair_at[f * n_faces + g];
                const int cells[4] = {face.cells[0], face.cells[1], faces[g].cells[0], faces[g].cells[1]};
                if (at < 0)
                    std::fill(out, out + static_cast<std::size_t>(cells[2]) * cells[3], 0.0);
                else
                    sum += fill(pairs[at], f < g, index, cells, inverse_area, out);
            }
            row_sums.data()[patch] = sum;
        }
    }
    interruption.finish();
}

}  // namespace
}  // namespace kernel

void bind_closed_form(nb::module_ &m) {
    m.def("grid_form_factors", &kernel::grid_form_factors, nb::arg("frames"), nb::arg("counts"), nb::arg("facing"),
          nb::arg("factors"), nb::arg("row_sums"), nb::call_guard<nb::gil_scoped_release>());
    bind_rectangles(m);
}
