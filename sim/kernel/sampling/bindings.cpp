// Sampled form factors as Python sees them: which patches the rays of a patch meet.
#include <limits>

#include "arrays.hpp"
#include "bindings.hpp"
#include "interrupt.hpp"
#include "sampling/patch_rays.hpp"

namespace {

using namespace kernel;
using namespace kernel::sampling;

class RayTree {
  public:
    RayTree(const double *corners, std::int64_t n)
        : corners_(corners, corners + 12 * n), tree_(Tree(corners, n, box_of(corners, 4 * n).diagonal())) {}

    // Points first ... first + count - 1 of each row's sequence number `stream`.
    void sample(In<std::int64_t, 1> rows, std::uint32_t stream, std::uint32_t first, Out<std::int32_t, 2> met) const {
        const auto n = static_cast<std::int64_t>(rows.shape(0)), count = static_cast<std::int64_t>(met.shape(1));
        const SobolPoints points(first, static_cast<std::uint32_t>(count));
        Interruption interruption;
#pragma omp parallel for schedule(dynamic, 16)
        for (std::int64_t k = 0; k < n; ++k)
            if (!interruption.stopped()) sample_row(rows.data()[k], stream, points, count, met.data() + k * count);
        interruption.finish();
    }

    // First moments of the light that rays bring: means (rows, 3) of what `met` sends, over the mean of all, times where
    // its ray began, from the patch's centroid. Arguments as for sample(), which found what they met.
    void moments(In<std::int64_t, 1> rows, std::uint32_t stream, std::uint32_t first, In<std::int32_t, 2> met,
                 In<double, 1> values, Out<double, 2> means) const {
        const auto n = static_cast<std::int64_t>(rows.shape(0)), count = static_cast<std::int64_t>(met.shape(1));
        const SobolPoints points(first, static_cast<std::uint32_t>(count));
        Interruption interruption;
#pragma omp parallel for schedule(dynamic, 16)
        for (std::int64_t k = 0; k < n; ++k)
            if (!interruption.stopped())
                moment_row(rows.data()[k], stream, points, met.data() + k * count, values.data(),
                           means.data() + 3 * k);
        interruption.finish();
    }

    // Light that rays of some pieces of polygons bring: means (rows, 2) of what is met as one number each, and as a
    // field that is linear within. `own`: the polygon that a piece belongs to. Pieces of one polygon send the same
    // directions, so that their light differs by what they see and hardly by noise.
    void gather(In<double, 3> pieces, In<std::int64_t, 1> own, std::uint32_t stream, std::int64_t count,
                In<double, 2> light, Out<double, 2> means) const {
        const auto n = static_cast<std::int64_t>(own.shape(0));
        const SobolPoints points(0, static_cast<std::uint32_t>(count));
        Interruption interruption;
#pragma omp parallel for schedule(dynamic, 16)
        for (std::int64_t k = 0; k < n; ++k)
            if (!interruption.stopped())
                gather_row(pieces.data() + 12 * k, own.data()[k], stream, points, count, light.data(),
                           means.data() + 2 * k);
        interruption.finish();
    }

    // Where the rays of each row land: the polygon, the place, and what the nearest of some places in that polygon has.
    // What `met` misses has 0 and no place.
    void land(In<std::int64_t, 1> rows, std::uint32_t stream, In<double, 3> places, In<double, 2> values,
              Out<std::int32_t, 2> met, Out<double, 3> landed, Out<double, 2> has) const {
        const auto n = static_cast<std::int64_t>(rows.shape(0)), count = static_cast<std::int64_t>(met.shape(1));
        const SobolPoints points(0, static_cast<std::uint32_t>(count));
        const Marks marks{places.data(), values.data(), static_cast<std::int64_t>(places.shape(1))};
        Interruption interruption;
#pragma omp parallel for schedule(dynamic, 16)
        for (std::int64_t k = 0; k < n; ++k)
            if (!interruption.stopped())
                land_row(rows.data()[k], stream, points, marks,
                         Landings{count, met.data() + k * count, landed.data() + 3 * k * count, has.data() + k * count});
        interruption.finish();
    }

    // The first polygon that any ray meets.
    void trace(In<float, 2> origins, In<float, 2> directions, Out<std::int32_t, 1> met, Out<float, 1> at) const {
        const auto n = static_cast<std::int64_t>(met.shape(0));
        Interruption interruption;
#pragma omp parallel for schedule(dynamic, 16)
        for (std::int64_t start = 0; start < n; start += RAYS) {
            if (interruption.stopped()) continue;
            RayBlock rays;
            rays.n = static_cast<int>(std::min<std::int64_t>(RAYS, n - start));
            for (int k = 0; k < rays.n; ++k) {
                rays.from[k] = -1;
                for (int axis = 0; axis < 3; ++axis) {
                    const double place = origins.data()[3 * (start + k) + axis];
                    rays.origin[axis][k] = static_cast<float>(place - component(tree_.middle, axis));
                    rays.direction[axis][k] = directions.data()[3 * (start + k) + axis];
                }
            }
            find_nearest(tree_, rays);
            std::copy(rays.met, rays.met + rays.n, met.data() + start);
            std::copy(rays.at, rays.at + rays.n, at.data() + start);
        }
        interruption.finish();
    }

  private:
    // Places in each polygon, and what each has.
    struct Marks {
        const double *places, *values;
        std::int64_t each;

        double nearest(std::int64_t polygon, const double *to) const {
            std::int64_t found = 0;
            double least = std::numeric_limits<double>::infinity();
            for (std::int64_t mark = each * polygon; mark < each * (polygon + 1); ++mark) {
                const double *at = places + 3 * mark;
                const double x = at[0] - to[0], y = at[1] - to[1], z = at[2] - to[2], squared = x * x + y * y + z * z;
                if (squared < least) least = squared, found = mark;
            }
            return values[found];
        }
    };

    struct Landings {
        std::int64_t count;
        std::int32_t *met;
        double *landed, *has;
    };

    void land_row(std::int64_t row, std::uint32_t stream, const SobolPoints &points, const Marks &marks,
                  const Landings &out) const {
        trace_row(corners_.data() + 12 * row, row, stream, points, out.count,
                  [&](const RayBlock &rays, std::int64_t start) {
                      for (int k = 0; k < rays.n; ++k) {
                          double *place = out.landed + 3 * (start + k);
                          const bool missed = rays.met[k] < 0;
                          for (int axis = 0; axis < 3; ++axis)
                              place[axis] = missed ? 0 : landing(rays, k, axis);
                          out.met[start + k] = rays.met[k];
                          out.has[start + k] = missed ? 0 : marks.nearest(rays.met[k], place);
                      }
                  });
    }

    double landing(const RayBlock &rays, int k, int axis) const {
        return rays.origin[axis][k] + static_cast<double>(rays.at[k]) * rays.direction[axis][k] +
               component(tree_.middle, axis);
    }

    // light: of each polygon its mean, and the linear field's value at the origin and gradient.
    void gather_row(const double *piece, std::int64_t own, std::uint32_t stream, const SobolPoints &points,
                    std::int64_t count, const double *light, double *means) const {
        double constant = 0, linear = 0;
        trace_row(piece, own, stream, points, count, [&](const RayBlock &rays, std::int64_t) {
            for (int k = 0; k < rays.n; ++k) {
                if (rays.met[k] < 0) continue;
                const double *field = light + 5 * rays.met[k];
                constant += field[0];
                linear += field[1] + field[2] * landing(rays, k, 0) + field[3] * landing(rays, k, 1) +
                          field[4] * landing(rays, k, 2);
            }
        });
        means[0] = constant / static_cast<double>(count);
        means[1] = linear / static_cast<double>(count);
    }

    void moment_row(std::int64_t row, std::uint32_t stream, const SobolPoints &points, const std::int32_t *met,
                    const double *values, double *means) const {
        const double *corners = corners_.data() + 12 * row;
        const PatchRays rays = from_patch(corners, row, stream);
        const auto count = static_cast<std::int64_t>(points.size());
        Vec sum{0, 0, 0}, origins{0, 0, 0};
        double seen = 0;
        Places places;
        for (std::int64_t start = 0; start < count; start += RAYS) {
            const int n = static_cast<int>(std::min<std::int64_t>(RAYS, count - start));
            places_of(rays, points.from(start), n, places);
            for (int k = 0; k < n; ++k) {
                const Vec from_centre{places.at[0][k], places.at[1][k], places.at[2][k]};
                origins = origins + from_centre;
                if (met[start + k] < 0) continue;
                seen += values[met[start + k]];
                sum = sum + values[met[start + k]] * from_centre;
            }
        }
        // What rays see on average is no slope, though they do not begin about the centroid on average.
        const double each = 1.0 / static_cast<double>(count);
        const Vec moment = each * (sum - (each * seen) * origins);
        for (int axis = 0; axis < 3; ++axis) means[axis] = component(moment, axis);
    }

    PatchRays from_patch(const double *corners, std::int64_t own, std::uint32_t stream) const {
        return patch_rays(corners, tree_.middle, tree_.slack,
                          hashed(static_cast<std::uint32_t>(own) ^ hashed(stream + 1)));
    }

    void sample_row(std::int64_t row, std::uint32_t stream, const SobolPoints &points, std::int64_t count,
                    std::int32_t *met) const {
        trace_row(corners_.data() + 12 * row, row, stream, points, count, [&](const RayBlock &rays, std::int64_t start) {
            std::copy(rays.met, rays.met + rays.n, met + start);
        });
    }

    // Calls done(rays, number of the first) for each block of the rays that leave corners of the polygon `own`.
    template <class Done>
    void trace_row(const double *corners, std::int64_t own, std::uint32_t stream, const SobolPoints &points,
                   std::int64_t count, const Done &done) const {
        const PatchRays patch = from_patch(corners, own, stream);
        RayBlock rays;
        std::fill(rays.from, rays.from + RAYS, static_cast<std::int32_t>(own));
        for (std::int64_t start = 0; start < count; start += RAYS) {
            rays.n = static_cast<int>(std::min<std::int64_t>(RAYS, count - start));
            rays_of(patch, points.from(start), rays);
            find_nearest(tree_, rays);
            done(rays, start);
        }
    }

    std::vector<double> corners_;
    WideTree tree_;
};

void create(RayTree *self, In<double, 3> corners) {
    new (self) RayTree(corners.data(), static_cast<std::int64_t>(corners.shape(0)));
}

}  // namespace

void bind_sampling(nb::module_ &m) {
    const nb::call_guard<nb::gil_scoped_release> unlocked;
    nb::class_<RayTree>(m, "RayTree")
        .def("__init__", &create, nb::arg("corners"), unlocked)
        .def("sample", &RayTree::sample, nb::arg("rows"), nb::arg("stream"), nb::arg("first"), nb::arg("met"), unlocked)
        .def("moments", &RayTree::moments, nb::arg("rows"), nb::arg("stream"), nb::arg("first"), nb::arg("met"),
             nb::arg("values"), nb::arg("means"), unlocked)
        .def("gather", &RayTree::gather, nb::arg("pieces"), nb::arg("own"), nb::arg("stream"), nb::arg("count"),
             nb::arg("light"), nb::arg("means"), unlocked)
        .def("land", &RayTree::land, nb::arg("rows"), nb::arg("stream"), nb::arg("places"), nb::arg("values"),
             nb::arg("met"), nb::arg("landed"), nb::arg("has"), unlocked)
        .def("trace", &RayTree::trace, nb::arg("origins"), nb::arg("directions"), nb::arg("met"), nb::arg("at"),
             unlocked);
}
