// Which share of the light between two patches passes the occluders.
//
// Pairs that no occluder parts are culled by their shafts. For the others Gauss points on one patch see the
// occluders as disjoint cones, and each cone covers a convex part of the other patch, whose factor is exact.
#include "arrays.hpp"
#include "bindings.hpp"
#include "interrupt.hpp"
#include "form_factors/outer_points.hpp"
#include "form_factors/point_view.hpp"
#include "geometry/shaft.hpp"

using namespace kernel;

namespace {

// Targets along a side from each outer point, of views too crowded to clip: first, and where they disagree.
constexpr int FEW_RAYS = 4, MANY_RAYS = 9;

struct ShadedPair {
    int first, second;
    bool first_is_outer;
    long begin;  // of its occluders in the list of its row
    int count;   // 0: wholly hidden
    double visible;
};

struct Row {
    std::vector<ShadedPair> pairs;
    std::vector<int> occluders;
    std::vector<long> place;  // of the pairs in a caller's list
};

// The patch that looks smaller from the occluders is the outer one: its points differ least in what they see.
class Culling {
public:
    Culling(const Tree &tree, const std::vector<FlatPolygon> &patches) : tree(tree), patches(patches) {
        if (tree.occluders.size() * patches.size() > MOST_SEEN) return;
        for (const Occluder &by : tree.occluders)
            for (const FlatPolygon &patch : patches) table.push_back(centre_seen(by, patch.centre));
    }

    void test(int i, int j, Row &row) const {
        const FlatPolygon &a = patches[i], &b = patches[j];
        const long begin = static_cast<long>(row.occluders.size());
        double far_a = INFINITY, far_b = INFINITY;
        const ShaftEnd<4> from = shaft_end(a), to = shaft_end(b);
        const bool hidden = tree.along(a.centre, b.centre, std::max(a.radius, b.radius), [&](std::int32_t k) {
            const Occluder &by = tree.occluders[k];
            if (spheres_apart(by.n, seen(k, i), a.radius, seen(k, j), b.radius)) return false;
            const Meets answer = meets(by, from, to, tree.tolerance);
            if (answer == Meets::none) return false;
            row.occluders.push_back(k);
            const Vec at = passage(by, a.centre, b.centre);
            far_a = std::min(far_a, norm(a.centre - at) / a.radius);
            far_b = std::min(far_b, norm(b.centre - at) / b.radius);
            return answer == Meets::all;
        });
        if (hidden) row.occluders.resize(begin);
        const int count = static_cast<int>(row.occluders.size() - begin);
        if (hidden || count) row.pairs.push_back({i, j, far_a >= far_b * (1 - 1e-9), begin, count, 0.0});
    }

private:
    static constexpr size_t MOST_SEEN = 1 << 20;  // 40 MB of places are kept; more are found again for each pair
    const Tree &tree;
    const std::vector<FlatPolygon> &patches;
    std::vector<CentreSeen> table;  // [occluder][patch]

    CentreSeen seen(int occluder, int patch) const {
        return table.empty() ? centre_seen(tree.occluders[occluder], patches[patch].centre)
                             : table[occluder * patches.size() + patch];
    }
};

// What a view's point sees of a patch by rays to a grid of targets on it, weighted by their factors. Each view
// shifts the grid, and tries first what stopped the ray before.
double visible_by_rays(const Tree &tree, const PointView &view, const FlatPolygon &target, int n, long &rays) {
    double free = 0, visible = 0;
    int stopped_by = -1;
    const Vec from = view.point, normal = view.normal;
    const Vec a = target.corner[0], b = target.corner[1], c = target.corner[2];
    const Vec d = target.n > 3 ? target.corner[3] : c;
    for (int s = 0; s < n; ++s)
        for (int t = 0; t < n; ++t) {
            const double u = (s + view.shift_u) / n, v = (t + view.shift_v) / n;
            const Vec along_u = (1 - v) * (b - a) + v * (c - d), along_v = (1 - u) * (d - a) + u * (c - b);
            const Vec at = a + u * (b - a) + v * (d - a) + (u * v) * (a - b + (c - d));
            const Vec to = at - from;
            const double up = dot(normal, to), before = -dot(target.normal, to), squared = dot(to, to);
            if (up <= 0 || before <= 0) continue;
            const double weight = norm(cross(along_u, along_v)) * up * before / (squared * squared);
            free += weight;
            ++rays;
            if (stopped_by < 0 || !stops(tree.occluders[stopped_by], from, at, tree.tolerance))
                stopped_by = tree.blocker(from, at);
            if (stopped_by < 0) visible += weight;
        }
    return free > 0 ? visible / free : 1.0;
}

// Share of a patch's factor from the view's point that is hidden.
double blocked_factor(const Tree &tree, const PointView &view, const FlatPolygon &target, double &free, long &rays) {
    double blocked;
    view.factors(target, free, blocked);
    if (!view.crowded || free == 0) return std::min(blocked, free);
    double visible = visible_by_rays(tree, view, target, FEW_RAYS, rays);
    if (visible > 0 && visible < 1) visible = visible_by_rays(tree, view, target, MANY_RAYS, rays);
    return free * (1 - visible);
}

class OccludedScene {
public:
    Tree tree;
    std::vector<FlatPolygon> patches;

    OccludedScene(const In<double, 3> &vertices, const In<double, 3> &occluders)
        : tree(occluders.data(), static_cast<std::int64_t>(occluders.shape(0)),
               box_of(vertices.data(), static_cast<std::int64_t>(4 * vertices.shape(0))).diagonal()) {
        for (size_t k = 0; k < vertices.shape(0); ++k) patches.push_back(flat_polygon(vertices.data() + 12 * k));
    }

    // Visible share of each pair found; pairs that share an outer patch share its views.
    long measure(std::vector<Row> &rows, const OuterRule &rule) const {
        std::vector<std::vector<std::pair<int, int>>> by_outer(patches.size());
        for (size_t r = 0; r < rows.size(); ++r)
            for (size_t k = 0; k < rows[r].pairs.size(); ++k) {
                const ShadedPair &pair = rows[r].pairs[k];
                if (pair.count)
                    by_outer[pair.first_is_outer ? pair.first : pair.second].push_back(
                        {static_cast<int>(r), static_cast<int>(k)});
            }
        long rays = 0;
        Interruption interruption;
#pragma omp parallel for schedule(dynamic, 4) reduction(+ : rays)
        for (size_t outer = 0; outer < patches.size(); ++outer)
            if (!interruption.stopped() && !by_outer[outer].empty())
                rays += measure_outer(static_cast<int>(outer), by_outer[outer], rows, rule);
        interruption.finish();
        return rays;
    }

private:
    static std::vector<int> named(const Row &row, const ShadedPair &pair) {
        return {row.occluders.begin() + pair.begin, row.occluders.begin() + pair.begin + pair.count};
    }

    // Occluders of all the pairs; more than a view can be made of are left to the single pairs.
    static std::vector<int> named(const std::vector<std::pair<int, int>> &mine, const std::vector<Row> &rows) {
        std::vector<int> all;
        for (const auto &[r, k] : mine) {
            const std::vector<int> some = named(rows[r], rows[r].pairs[k]);
            for (int by : some)
                if (std::find(all.begin(), all.end(), by) == all.end()) all.push_back(by);
            if (all.size() > SHARED) break;
        }
        std::sort(all.begin(), all.end());
        return all;
    }

    long measure_outer(int outer, const std::vector<std::pair<int, int>> &mine, std::vector<Row> &rows,
                       const OuterRule &rule) const {
        std::vector<OuterPoint> points;
        for (const Polygon &part : parts(patches[outer], tree)) add_points(part, rule, points);
        std::vector<double> free(mine.size(), 0.0), blocked(mine.size(), 0.0);
        const std::vector<int> shared = named(mine, rows);
        const Vec normal = patches[outer].normal;
        long rays = 0;
        PointView view;
        for (const OuterPoint &point : points) {
            view.shift(static_cast<int>(&point - points.data()));
            if (shared.size() <= SHARED) view.look(tree, shared, point.at, normal);
            for (size_t k = 0; k < mine.size(); ++k) {
                const Row &row = rows[mine[k].first];
                const ShadedPair &pair = row.pairs[mine[k].second];
                if (shared.size() > SHARED) view.look(tree, named(row, pair), point.at, normal);
                double unhindered;
                const FlatPolygon &inner = patches[pair.first_is_outer ? pair.second : pair.first];
                blocked[k] += point.weight * blocked_factor(tree, view, inner, unhindered, rays);
                free[k] += point.weight * unhindered;
            }
        }
        for (size_t k = 0; k < mine.size(); ++k) {
            const double share = free[k] > 0 ? 1 - blocked[k] / free[k] : 1.0;
            // What roundoff leaves of 0 and of 1.
            rows[mine[k].first].pairs[mine[k].second].visible = share < 1e-12 ? 0 : share > 1 - 1e-12 ? 1 : share;
        }
        return rays;
    }
};

template <class T>
nb::ndarray<nb::numpy, T> array(const std::vector<T> &values) {
    T *data = new T[values.size()];
    std::copy(values.begin(), values.end(), data);
    nb::capsule owner(data, [](void *p) noexcept { delete[] static_cast<T *>(p); });
    return nb::ndarray<nb::numpy, T>(data, {values.size()}, owner);
}

// The pairs of a run of rows that an occluder parts, and their visible share.
struct Found {
    std::vector<std::int64_t> first, second;
    std::vector<double> visible;
    long rays = 0;

    void add(const std::vector<Row> &rows) {
        for (const Row &row : rows)
            for (const ShadedPair &pair : row.pairs)
                if (pair.visible < 1) {
                    first.push_back(pair.first);
                    second.push_back(pair.second);
                    visible.push_back(pair.visible);
                }
    }

    nb::tuple arrays() const { return nb::make_tuple(array(first), array(second), array(visible), rays); }
};

constexpr long CHUNK = 1L << 24;  // candidate pairs whose suspects are held at a time

nb::tuple visible_of_matrix(In<double, 3> vertices, In<double, 3> occluders, In<double, 2> exchange,
                            In<double, 1> nodes, In<double, 1> weights) {
    Found found;
    {
        nb::gil_scoped_release released;
        const OccludedScene scene(vertices, occluders);
        const OuterRule rule{static_cast<int>(nodes.shape(0)), nodes.data(), weights.data()};
        const Culling culling(scene.tree, scene.patches);
        const long n = static_cast<long>(scene.patches.size()), step = std::max(1L, CHUNK / std::max(1L, n));
        for (long from = 0; from < n; from += step) {
            std::vector<Row> rows(std::min(step, n - from));
            Interruption interruption;
#pragma omp parallel for schedule(dynamic, 4)
            for (size_t r = 0; r < rows.size(); ++r) {
                if (interruption.stopped()) continue;
                const long i = from + static_cast<long>(r);
                for (long j = i + 1; j < n; ++j)
                    if (exchange.data()[i * n + j] > 0) culling.test(static_cast<int>(i), static_cast<int>(j), rows[r]);
            }
            interruption.finish();
            found.rays += scene.measure(rows, rule);
            found.add(rows);
        }
    }
    return found.arrays();
}

long visible_of_pairs(In<double, 3> vertices, In<double, 3> occluders, In<std::int64_t, 1> first,
                      In<std::int64_t, 1> second, In<double, 1> nodes, In<double, 1> weights, Out<double, 1> visible) {
    const OccludedScene scene(vertices, occluders);
    const OuterRule rule{static_cast<int>(nodes.shape(0)), nodes.data(), weights.data()};
    const Culling culling(scene.tree, scene.patches);
    const long n = static_cast<long>(first.shape(0)), together = 256;
    long rays = 0;
    for (long from = 0; from < n; from += CHUNK) {
        const long until = std::min(n, from + CHUNK);
        std::vector<Row> rows((until - from + together - 1) / together);
        std::fill(visible.data() + from, visible.data() + until, 1.0);
        Interruption interruption;
#pragma omp parallel for schedule(dynamic, 4)
        for (size_t r = 0; r < rows.size(); ++r) {
            if (interruption.stopped()) continue;
            const long begin = from + static_cast<long>(r) * together;
            for (long k = begin; k < std::min(until, begin + together); ++k) {
                const size_t before = rows[r].pairs.size();
                culling.test(static_cast<int>(first.data()[k]), static_cast<int>(second.data()[k]), rows[r]);
                if (rows[r].pairs.size() > before) rows[r].place.push_back(k);
            }
        }
        interruption.finish();
        rays += scene.measure(rows, rule);
        for (const Row &row : rows)
            for (size_t k = 0; k < row.pairs.size(); ++k) visible.data()[row.place[k]] = row.pairs[k].visible;
    }
    return rays;
}

void segments_blocked(In<double, 3> occluders, double size, In<double, 2> begin, In<double, 2> end,
                      Out<bool, 1> blocked) {
    const Tree tree(occluders.data(), static_cast<std::int64_t>(occluders.shape(0)), size);
    const long n = static_cast<long>(blocked.shape(0)), together = 256;
    Interruption interruption;
#pragma omp parallel for schedule(dynamic, 1)
    for (long from = 0; from < n; from += together) {
        if (interruption.stopped()) continue;
        for (long k = from; k < std::min(n, from + together); ++k)
            blocked.data()[k] = tree.blocker(load(begin.data() + 3 * k), load(end.data() + 3 * k)) >= 0;
    }
    interruption.finish();
}

}  // namespace

void bind_occlusion(nb::module_ &m) {
    const auto released = nb::call_guard<nb::gil_scoped_release>();
    m.def("visible_of_matrix", &visible_of_matrix);
    m.def("visible_of_pairs", &visible_of_pairs, released);
    m.def("segments_blocked", &segments_blocked, released);
}
