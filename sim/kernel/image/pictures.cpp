// Pictures: what a projector lights, and where rays end.
#include <algorithm>
#include <vector>

#include "arrays.hpp"
#include "bindings.hpp"
#include "image/tracer.hpp"
#include "interrupt.hpp"

namespace {

using namespace kernel;
using namespace kernel::image;

constexpr std::int64_t CHUNKS = 32;  // rows are shared out in so many parts, whatever the number of threads

void make_tracer(Tracer *self, In<double, 2> rectangles, In<double, 3> corners, In<double, 2> frames) {
    new (self) Tracer(rectangles.data(), static_cast<std::int64_t>(rectangles.shape(0)), corners.data(), frames.data(),
                      static_cast<std::int64_t>(corners.shape(0)));
}

// lens: fx, fy, cx, cy, k1, k2, p1, p2, k3.
void make_device(Device *self, std::int64_t width, std::int64_t height, In<double, 1> lens, In<double, 2> rotation,
                 In<double, 1> position) {
    const double *p = lens.data();
    new (self) Device{width, height, p[0], p[1], p[2], p[3], p[4], p[5], p[6], p[7], p[8], {}, load(position.data())};
    std::copy_n(rotation.data(), 9, self->rotation);
}

void trace(const Tracer &tracer, In<double, 2> origins, In<double, 2> directions, Out<std::int64_t, 1> face,
           Out<std::int64_t, 1> patch, Out<double, 1> distance, Out<double, 2> uv, Out<double, 1> cosine) {
    const auto n = static_cast<std::int64_t>(directions.shape(0));
    const std::int64_t stride = origins.shape(0) == 1 ? 0 : 3;
    const double *o = origins.data(), *d = directions.data();
    Interruption interruption;
#pragma omp parallel for schedule(dynamic, 4)
    for (std::int64_t first = 0; first < n; first += BLOCK) {
        if (interruption.stopped()) continue;
        Rays rays;
        Hits hits;
        rays.n = static_cast<int>(std::min<std::int64_t>(BLOCK, n - first));
        for (int k = 0; k < rays.n; ++k) {
            const double *origin = o + stride * (first + k), *direction = d + 3 * (first + k);
            rays.ox[k] = origin[0], rays.oy[k] = origin[1], rays.oz[k] = origin[2];
            rays.dx[k] = direction[0], rays.dy[k] = direction[1], rays.dz[k] = direction[2];
        }
        tracer.block(rays, hits);
        for (int k = 0; k < rays.n; ++k) {
            uv.data()[2 * (first + k)] = hits.u[k];
            uv.data()[2 * (first + k) + 1] = hits.v[k];
        }
        std::copy_n(hits.face, rays.n, face.data() + first);
        std::copy_n(hits.patch, rays.n, patch.data() + first);
        std::copy_n(hits.at, rays.n, distance.data() + first);
        std::copy_n(hits.towards, rays.n, cosine.data() + first);
    }
    interruption.finish();
}

void blocked(const Tracer &tracer, In<double, 2> from, In<double, 2> to, Out<std::uint8_t, 1> stopped) {
    const auto n = static_cast<std::int64_t>(from.shape(0));
    constexpr std::int64_t TOGETHER = 256;
    Interruption interruption;
#pragma omp parallel for schedule(dynamic, 1)
    for (std::int64_t first = 0; first < n; first += TOGETHER) {
        if (interruption.stopped()) continue;
        for (std::int64_t k = first; k < std::min(n, first + TOGETHER); ++k)
            stopped.data()[k] = tracer.blocked(load(from.data() + 3 * k), load(to.data() + 3 * k));
    }
    interruption.finish();
}

// Which emission a run of rows gives, and what its pixels meet.
struct Lighting {
    const Tracer &tracer;
    const Device &device;
    const double *picture, *reflectance;
    std::int64_t subsamples;  // 0: each pixel adds its direct light and is counted (eq. 5)
    bool physical;
    double *direct, *place;
    std::int32_t *patch;
    Interruption &interruption;

    void rows(std::int64_t begin, std::int64_t end, double *sum, double *count) const {
        for (std::int64_t row = begin; row < end && !interruption.stopped(); ++row)
            for (std::int64_t column = 0; column < device.width; column += BLOCK) {
                const int n = static_cast<int>(std::min<std::int64_t>(BLOCK, device.width - column));
                centres(row, column, n, sum, count);
                for (std::int64_t part = 0; part < subsamples * subsamples; ++part) parts(row, column, n, part, sum);
            }
    }

  private:
    void centres(std::int64_t row, std::int64_t column, int n, double *sum, double *count) const {
        Rays rays;
        Aim lens;
        Hits hits;
        double irradiance[BLOCK];
        KERNEL_CALL(aim(device, row, column, n, 0, 0, rays, lens));
        tracer.block(rays, hits);
        KERNEL_CALL(pixel_irradiance(lens, hits, n, physical, irradiance));
        const std::int64_t first = row * device.width + column;
        for (int k = 0; k < n; ++k) {
            const std::int64_t pixel = first + k, met = hits.patch[k];
            patch[pixel] = static_cast<std::int32_t>(met);
            place[2 * pixel] = hits.s[k];
            place[2 * pixel + 1] = hits.t[k];
            direct[pixel] = met < 0 ? 0.0 : reflectance[met] * irradiance[k] * picture[pixel];
            if (subsamples || met < 0) continue;
            sum[met] += irradiance[k] * picture[pixel];
            count[met] += 1;
        }
    }

    void parts(std::int64_t row, std::int64_t column, int n, std::int64_t part, double *sum) const {
        Rays rays;
        Aim lens;
        Hits hits;
        double flux[BLOCK];
        const double share = 1.0 / static_cast<double>(subsamples);
        const double x = (static_cast<double>(part % subsamples) + 0.5) * share - 0.5;
        const double y = (static_cast<double>(part / subsamples) + 0.5) * share - 0.5;
        KERNEL_CALL(aim(device, row, column, n, x, y, rays, lens));
        tracer.block(rays, hits);
        KERNEL_CALL(pixel_flux(device, lens, hits, n, physical, flux));
        const double *brightness = picture + row * device.width + column;
        for (int k = 0; k < n; ++k)
            if (hits.patch[k] >= 0) sum[hits.patch[k]] += share * share * flux[k] * brightness[k];
    }
};

// E by area (light of a pixel's parts that lands on a patch, over its area) or, with 0 subsamples, by eq. 5.
void light(const Tracer &tracer, const Device &device, In<double, 2> picture, In<double, 1> reflectance,
           In<double, 1> areas, std::int64_t subsamples, bool physical, Out<double, 2> direct,
           Out<std::int32_t, 2> patch, Out<double, 3> place, Out<double, 1> emission) {
    const auto n = static_cast<std::int64_t>(areas.shape(0));
    Interruption interruption;
    const Lighting work{tracer,   device,        picture.data(), reflectance.data(), subsamples,
                     physical, direct.data(), place.data(),   patch.data(), interruption};
    std::vector<double> sums(CHUNKS * n, 0.0), counts(subsamples ? 1 : CHUNKS * n, 0.0);
#pragma omp parallel for schedule(dynamic, 1)
    for (std::int64_t chunk = 0; chunk < CHUNKS; ++chunk)
        work.rows(device.height * chunk / CHUNKS, device.height * (chunk + 1) / CHUNKS, sums.data() + chunk * n,
                  counts.data() + (subsamples ? 0 : chunk * n));
    interruption.finish();
    for (std::int64_t i = 0; i < n; ++i) {
        double sum = 0, count = subsamples ? areas.data()[i] : 0.0;
        for (std::int64_t chunk = 0; chunk < CHUNKS; ++chunk) {
            sum += sums[chunk * n + i];
            if (!subsamples) count += counts[chunk * n + i];
        }
        emission.data()[i] = count > 0 ? reflectance.data()[i] * sum / count : 0.0;
    }
}

}  // namespace

void bind_image_shade(nb::module_ &m);
void bind_image_gather(nb::module_ &m);

void bind_image(nb::module_ &m) {
    using release = nb::call_guard<nb::gil_scoped_release>;
    nb::class_<Device>(m, "Device")
        .def("__init__", &make_device, nb::arg("width"), nb::arg("height"), nb::arg("lens"), nb::arg("rotation"),
             nb::arg("position"));
    nb::class_<Tracer>(m, "Tracer")
        .def("__init__", &make_tracer, nb::arg("rectangles"), nb::arg("corners"), nb::arg("frames"))
        .def("trace", &trace, nb::arg("origins"), nb::arg("directions"), nb::arg("face"), nb::arg("patch"),
             nb::arg("distance"), nb::arg("uv"), nb::arg("cosine"), release())
        .def("blocked", &blocked, nb::arg("start"), nb::arg("end"), nb::arg("stopped"), release())
        .def("light", &light, nb::arg("device"), nb::arg("picture"), nb::arg("reflectance"), nb::arg("areas"),
             nb::arg("subsamples"), nb::arg("physical"), nb::arg("direct"), nb::arg("patch"), nb::arg("place"),
             nb::arg("emission"), release());
    bind_image_shade(m);
    bind_image_gather(m);
}
