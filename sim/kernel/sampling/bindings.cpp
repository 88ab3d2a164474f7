// Sampled form factors as Python sees them: which patches the rays of a patch meet.
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
    void sample_row(std::int64_t row, std::uint32_t stream, const SobolPoints &points, std::int64_t count,
                    std::int32_t *met) const {
        const auto patch = static_cast<std::uint32_t>(row);
        const PatchRays patch_rays(corners_.data() + 12 * row, tree_.middle, tree_.slack,
                                   hashed(patch ^ hashed(stream + 1)));
        RayBlock rays;
        for (std::int64_t start = 0; start < count; start += RAYS) {
            rays.n = static_cast<int>(std::min<std::int64_t>(RAYS, count - start));
            for (int k = 0; k < rays.n; ++k) {
                patch_rays.put(points[start + k], rays, k);
                rays.from[k] = static_cast<std::int32_t>(row);
            }
            find_nearest(tree_, rays);
            std::copy(rays.met, rays.met + rays.n, met + start);
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
        .def("trace", &RayTree::trace, nb::arg("origins"), nb::arg("directions"), nb::arg("met"), nb::arg("at"),
             unlocked);
}
