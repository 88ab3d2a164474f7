// What a camera sees of light that is known by the patch: constant, or smooth within a flat region.
#include <algorithm>

#include "arrays.hpp"
#include "bindings.hpp"

namespace {

// One number a patch.
void shade_constant(In<std::int32_t, 2> patch, In<double, 1> value, Out<double, 2> indirect) {
    const auto n = static_cast<std::int64_t>(patch.size());
#pragma omp parallel for schedule(static)
    for (std::int64_t k = 0; k < n; ++k)
        indirect.data()[k] = patch.data()[k] < 0 ? 0.0 : value.data()[patch.data()[k]];
}

// A biquadratic a patch in its cell coordinates: (P, 3, 3) Bernstein coefficients, rows along t.
void shade_quadratic(In<std::int32_t, 2> patch, In<double, 3> place, In<double, 3> coefficients,
                     Out<double, 2> indirect) {
    const auto n = static_cast<std::int64_t>(patch.size());
#pragma omp parallel for schedule(static)
    for (std::int64_t k = 0; k < n; ++k) {
        const std::int64_t met = patch.data()[k];
        double sum = 0;
        if (met >= 0) {
            const double s = place.data()[2 * k], t = place.data()[2 * k + 1];
            const double along_s[] = {(1 - s) * (1 - s), 2 * s * (1 - s), s * s};
            const double along_t[] = {(1 - t) * (1 - t), 2 * t * (1 - t), t * t};
            const double *c = coefficients.data() + 9 * met;
            for (int row = 0; row < 3; ++row)
                sum += along_t[row] * (along_s[0] * c[3 * row] + along_s[1] * c[3 * row + 1] + along_s[2] * c[3 * row + 2]);
        }
        indirect.data()[k] = sum;
    }
}

// A fan of triangles about each patch's centroid: corners (P, 4, 2) in its plane, values (P, 5), the centre's last.
void shade_fan(In<std::int32_t, 2> patch, In<double, 3> place, In<double, 3> corners, In<double, 2> values,
               Out<double, 2> indirect) {
    const auto n = static_cast<std::int64_t>(patch.size());
#pragma omp parallel for schedule(static)
    for (std::int64_t k = 0; k < n; ++k) {
        const std::int64_t met = patch.data()[k];
        indirect.data()[k] = 0;
        if (met < 0) continue;
        const double x = place.data()[2 * k], y = place.data()[2 * k + 1];
        const double *c = corners.data() + 8 * met, *value = values.data() + 5 * met;
        double best = -1e300;
        for (int a = 0; a < 4; ++a) {
            const int b = (a + 1) % 4;
            const double twice = c[2 * a] * c[2 * b + 1] - c[2 * a + 1] * c[2 * b];
            if (!(twice > 0)) continue;
            const double at_a = (x * c[2 * b + 1] - y * c[2 * b]) / twice, at_b = (c[2 * a] * y - c[2 * a + 1] * x) / twice;
            // The triangle that the place lies in, or the nearest for one on the rim.
            if (std::min(at_a, at_b) <= best) continue;
            best = std::min(at_a, at_b);
            indirect.data()[k] = at_a * value[a] + at_b * value[b] + (1 - at_a - at_b) * value[4];
        }
    }
}

}  // namespace

void bind_image_shade(nb::module_ &m) {
    using release = nb::call_guard<nb::gil_scoped_release>;
    m.def("shade_constant", &shade_constant, nb::arg("patch"), nb::arg("value"), nb::arg("indirect"), release());
    m.def("shade_quadratic", &shade_quadratic, nb::arg("patch"), nb::arg("place"), nb::arg("coefficients"),
          nb::arg("indirect"), release());
    m.def("shade_fan", &shade_fan, nb::arg("patch"), nb::arg("place"), nb::arg("corners"), nb::arg("values"),
          nb::arg("indirect"), release());
}
