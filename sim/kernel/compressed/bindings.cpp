// The compressed matrix as Python sees it.
#include "arrays.hpp"
#include "bindings.hpp"
#include "compressed/matrix.hpp"

namespace {

using kernel::compressed::CompressedMatrix;

void create(CompressedMatrix *self, In<double, 3> vertices, In<double, 2> normals, In<double, 1> areas,
            In<std::int64_t, 1> region, In<double, 3> occluders, double tolerance, int leaf_size) {
    kernel::compressed::Geometry geometry;
    geometry.n = static_cast<int>(areas.shape(0));
    geometry.vertices = vertices.data(), geometry.normals = normals.data();
    geometry.areas = areas.data(), geometry.region = region.data();
    new (self) CompressedMatrix(geometry, occluders.data(), static_cast<int>(occluders.shape(0)), tolerance, leaf_size);
}

void apply(const CompressedMatrix &self, In<double, 2> x, Out<double, 2> y) {
    self.apply(x.data(), y.data(), static_cast<int>(x.shape(1)));
}

void exact_rows(const CompressedMatrix &self, In<std::int64_t, 1> rows, In<double, 2> x, Out<double, 2> y) {
    self.exact_rows(rows.data(), static_cast<int>(rows.shape(0)), x.data(), y.data(), static_cast<int>(x.shape(1)));
}

nb::tuple blocks(const CompressedMatrix &self) {
    const auto &n = self.counts().blocks;
    return nb::make_tuple(n[0], n[1], n[2], n[3]);
}

nb::tuple numbers(const CompressedMatrix &self) {
    const auto &n = self.counts().numbers;
    return nb::make_tuple(n[0], n[1], n[2], n[3]);
}

}  // namespace

void bind_compressed(nb::module_ &m) {
    const nb::call_guard<nb::gil_scoped_release> unlocked;
    nb::class_<CompressedMatrix>(m, "CompressedMatrix")
        .def("__init__", &create, nb::arg("vertices"), nb::arg("normals"), nb::arg("areas"), nb::arg("region"),
             nb::arg("occluders"), nb::arg("tolerance"), nb::arg("leaf_size"))
        .def("step", &CompressedMatrix::step, nb::arg("limit"), unlocked)
        .def("apply", &apply, nb::arg("x"), nb::arg("y"), unlocked)
        .def("exact_rows", &exact_rows, nb::arg("rows"), nb::arg("x"), nb::arg("y"), unlocked)
        .def("blocks", &blocks)
        .def("numbers", &numbers);
}
