// calibration._kernel: what Python sees; calibration/_kernel.pyi states the types. Nothing here starts threads: whoever
// asks shares rows out among its own, and the interpreter is free meanwhile.
#include <nanobind/stl/optional.h>
#include <nanobind/stl/vector.h>

#include <optional>
#include <stdexcept>
#include <vector>

#include "arrays.hpp"
#include "beats.hpp"
#include "bind_instruction_set.hpp"
#include "landing.hpp"
#include "lens.hpp"
#include "words.hpp"

namespace {

using namespace kernel;

template <class T>
using Pictures = std::vector<In<T, 2>>;

template <class T>
std::vector<const T *> starts(const Pictures<T> &pictures, std::size_t pixels) {
    std::vector<const T *> found;
    for (const auto &picture : pictures) {
        if (picture.size() != pixels) throw std::invalid_argument("pictures of several sizes");
        found.push_back(picture.data());
    }
    return found;
}

template <class T>
void read_words_of(const Pictures<T> &lit, const Pictures<T> &other, const In<T, 1> &limit, int wide,
                   const std::optional<In<T, 2>> &black, float sure_share, const std::optional<In<T, 1>> &saturation,
                   const In<std::uint16_t, 1> &table, std::uint16_t first, std::uint16_t end,
                   const Out<std::uint16_t, 2> &twice, const Out<std::uint8_t, 2> &reason) {
    const std::size_t pixels = twice.size();
    const auto a = starts<T>(lit, pixels), b = starts<T>(other, pixels);
    if (a.size() != b.size() || a.empty() || table.size() != std::size_t(1) << a.size())
        throw std::invalid_argument("as many pictures as others, and a position for each word");
    if (reason.size() != pixels || (limit.size() != pixels && limit.size() != 1) || (black && black->size() != pixels))
        throw std::invalid_argument("pictures of several sizes");
    if (black && (wide < 1 || wide + 3 > static_cast<int>(a.size())))
        throw std::invalid_argument("wide stripes are told by three finer ones");
    const Words<T> work{a.data(), b.data(), static_cast<int>(a.size()), wide, limit.data(),
                        limit.size() == 1, black ? black->data() : nullptr, sure_share,
                        saturation ? saturation->data() : nullptr, table.data(), first, end, twice.data(),
                        reason.data(), static_cast<std::int64_t>(pixels)};
    nb::gil_scoped_release free;
    KERNEL_CALL(read_words(work));
}

template <class T>
void bind_read_words(nb::module_ &m) {
    m.def("read_words", &read_words_of<T>, nb::arg("lit").noconvert(), nb::arg("other").noconvert(), nb::arg("limit").noconvert(), nb::arg("wide"),
          nb::arg("black").none().noconvert(), nb::arg("sure_share"), nb::arg("saturation").none().noconvert(), nb::arg("table").noconvert(),
          nb::arg("first"), nb::arg("end"), nb::arg("twice").noconvert(), nb::arg("reason").noconvert());
}

// numbers: slow, fast, range, three periods, three weights, sigma, mean period, most apart (beats.hpp).
template <class T>
void read_beats_of(const Pictures<T> &frames, const In<float, 1> &noise, const In<float, 1> &numbers,
                   const Out<float, 2> &position, const Out<float, 2> &sigma, const Out<float, 2> &misfit,
                   const Out<std::uint8_t, 2> &ambiguous) {
    const std::size_t pixels = position.size();
    const auto starting = starts<T>(frames, pixels);
    if (starting.size() != FREQUENCIES * STEPS || numbers.size() != 12)
        throw std::invalid_argument("twelve frames and twelve numbers");
    if (sigma.size() != pixels || misfit.size() != pixels || ambiguous.size() != pixels ||
        (noise.size() != pixels && noise.size() != 1))
        throw std::invalid_argument("pictures of several sizes");
    const float *k = numbers.data();
    const Beats<T> work{starting.data(), noise.data(), noise.size() == 1, k[0], k[1], k[2], {k[3], k[4], k[5]},
                        {k[6], k[7], k[8]}, k[9], k[10], k[11], position.data(), sigma.data(), misfit.data(),
                        ambiguous.data(), static_cast<std::int64_t>(pixels)};
    nb::gil_scoped_release free;
    KERNEL_CALL(read_beats(work));
}

template <class T>
void bind_read_beats(nb::module_ &m) {
    m.def("read_beats", &read_beats_of<T>, nb::arg("frames").noconvert(), nb::arg("noise").noconvert(),
          nb::arg("numbers").noconvert(), nb::arg("position").noconvert(), nb::arg("sigma").noconvert(),
          nb::arg("misfit").noconvert(), nb::arg("ambiguous").noconvert());
}

// terms: Brown's five, in OpenCV's order.
void undistort_points(const In<double, 2> &real, const In<double, 1> &terms, double limit, int rounds,
                      const Out<double, 2> &ideal) {
    if (real.shape(1) != 2 || ideal.size() != real.size() || ideal.shape(1) != 2 || terms.size() != 5)
        throw std::invalid_argument("(N, 2) points, as many results, and five terms");
    const double *k = terms.data();
    const Undistortion work{real.data(), ideal.data(), {k[0], k[1], k[2], k[3], k[4]}, limit, rounds,
                            static_cast<std::int64_t>(real.shape(0))};
    nb::gil_scoped_release free;
    KERNEL_CALL(undistort(work));
}

Optics optics_of(const In<double, 1> &numbers) {
    if (numbers.size() != 9) throw std::invalid_argument("focal lengths, principal point and five terms");
    const double *k = numbers.data();
    return {k[0], k[1], k[2], k[3], {k[4], k[5], k[6], k[7], k[8]}};
}

void need(bool right, const char *what) {
    if (!right) throw std::invalid_argument(what);
}

// optics: nine numbers (landing.hpp).
void take_images_of(const In<double, 2> &points, const In<double, 1> &optics, double fold,
                    const Out<double, 2> &pixels) {
    const std::size_t count = points.shape(0);
    need(points.shape(1) == 3 && pixels.shape(0) == count && pixels.shape(1) == 2, "(N, 3) points, (N, 2) pixels");
    const Images work{points.data(), optics_of(optics), fold, pixels.data(), static_cast<std::int64_t>(count)};
    nb::gil_scoped_release free;
    take_images(work);
}

void slope_bearings_of(const In<double, 2> &seen, const In<double, 2> &bearings, const In<double, 1> &optics,
                       const In<double, 1> &units, const Out<double, 3> &slopes) {
    const std::size_t points = seen.shape(0);
    need(seen.shape(1) == 2 && bearings.size() == 3 * points && units.size() == LENS_TERMS &&
             slopes.size() == LENS_TERMS * 2 * points,
         "(N, 2) pixels, (N, 3) bearings, eight units, (8, N, 2) slopes");
    const BearingSlopes work{seen.data(), bearings.data(), optics_of(optics), units.data(), slopes.data(),
                             static_cast<std::int64_t>(points)};
    nb::gil_scoped_release free;
    slope_bearings(work);
}

// pose: rotation by rows, then translation.
Landings landings_of(const In<double, 2> &bearings, const In<double, 2> &seen, const In<double, 2> &weight,
                     const In<std::int64_t, 1> &label, const In<double, 2> &planes, const In<double, 1> &optics,
                     const In<double, 1> &pose, double fold, double far) {
    const std::size_t points = seen.shape(0);
    need(seen.shape(1) == 2 && bearings.size() == 3 * points && weight.size() == 2 * points && label.size() == points,
         "(N, 2) pixels, as many weights, (N, 3) bearings, (N,) labels");
    need(planes.shape(1) == 3 && pose.size() == 12, "(K, 3) planes, twelve numbers of a pose");
    const auto count = static_cast<std::int64_t>(planes.shape(0));
    for (std::size_t i = 0; i < points; ++i)
        need(label.data()[i] >= 0 && label.data()[i] < count, "a label of no plane");
    return {bearings.data(), seen.data(), weight.data(), label.data(), planes.data(), count, optics_of(optics),
            pose.data(), pose.data() + 9, fold, far, static_cast<std::int64_t>(points)};
}

void land_points(const In<double, 2> &bearings, const In<double, 2> &seen, const In<double, 2> &weight,
                 const In<std::int64_t, 1> &label, const In<double, 2> &planes, const In<double, 1> &optics,
                 const In<double, 1> &pose, double fold, double far, const Out<double, 2> &error) {
    const Landings work = landings_of(bearings, seen, weight, label, planes, optics, pose, fold, far);
    need(error.size() == seen.size(), "(N, 2) errors");
    nb::gil_scoped_release free;
    land(work, error.data());
}

void slope_landings_of(const In<double, 2> &bearings, const In<double, 2> &seen, const In<double, 2> &weight,
                       const In<std::int64_t, 1> &label, const In<double, 2> &planes, const In<double, 1> &optics,
                       const In<double, 1> &pose, const In<double, 3> &by_lens, const In<double, 1> &units,
                       const In<double, 3> &turns, const In<double, 2> &across, const In<double, 3> &plane_turns,
                       const In<std::int64_t, 2> &own, const In<double, 3> &own_slopes,
                       const Out<double, 3> &jacobian) {
    const Landings work = landings_of(bearings, seen, weight, label, planes, optics, pose, 0, 0);
    const auto points = static_cast<std::size_t>(work.points), count = static_cast<std::size_t>(work.plane_count);
    need(by_lens.size() == LENS_TERMS * 2 * points && units.size() == LENS_TERMS && turns.size() == 27 &&
             across.size() == 9 && plane_turns.size() == 9 * count && own.size() == 2 * count &&
             own_slopes.size() == 9 * count && jacobian.shape(1) == points && jacobian.shape(2) == 2,
         "slopes of other shapes");
    const auto unknowns = static_cast<std::int64_t>(jacobian.shape(0));
    for (std::size_t k = 0; k < count; ++k) {
        const std::int64_t first = own.data()[2 * k], many = own.data()[2 * k + 1];
        need(first >= 0 && many >= 0 && many <= 3 && first + many <= unknowns, "a plane's unknowns are among all");
    }
    need(unknowns >= 2 * LENS_TERMS + 9, "fewer unknowns than lenses and pose have");
    const LandingSlopes slopes{by_lens.data(), units.data(), turns.data(), across.data(), plane_turns.data(),
                               own.data(), own_slopes.data(), jacobian.data()};
    nb::gil_scoped_release free;
    slope_landings(work, slopes);
}

void bind_landing(nb::module_ &m) {
    m.def("take_images", &take_images_of, nb::arg("points").noconvert(), nb::arg("optics").noconvert(), nb::arg("fold"),
          nb::arg("pixels").noconvert());
    m.def("slope_bearings", &slope_bearings_of, nb::arg("seen").noconvert(), nb::arg("bearings").noconvert(),
          nb::arg("optics").noconvert(), nb::arg("units").noconvert(), nb::arg("slopes").noconvert());
    m.def("land", &land_points, nb::arg("bearings").noconvert(), nb::arg("seen").noconvert(),
          nb::arg("weight").noconvert(), nb::arg("label").noconvert(), nb::arg("planes").noconvert(),
          nb::arg("optics").noconvert(), nb::arg("pose").noconvert(), nb::arg("fold"), nb::arg("far"),
          nb::arg("error").noconvert());
    m.def("slope_landings", &slope_landings_of, nb::arg("bearings").noconvert(), nb::arg("seen").noconvert(),
          nb::arg("weight").noconvert(), nb::arg("label").noconvert(), nb::arg("planes").noconvert(),
          nb::arg("optics").noconvert(), nb::arg("pose").noconvert(), nb::arg("by_lens").noconvert(),
          nb::arg("units").noconvert(), nb::arg("turns").noconvert(), nb::arg("across").noconvert(),
          nb::arg("plane_turns").noconvert(), nb::arg("own").noconvert(), nb::arg("own_slopes").noconvert(),
          nb::arg("jacobian").noconvert());
}

}  // namespace

NB_MODULE(_kernel, m) {
    bind_instruction_set(m);
    bind_read_words<std::uint8_t>(m);
    bind_read_words<std::uint16_t>(m);
    bind_read_words<float>(m);
    bind_read_beats<std::uint8_t>(m);
    bind_read_beats<std::uint16_t>(m);
    bind_read_beats<float>(m);
    m.def("undistort", &undistort_points, nb::arg("real").noconvert(), nb::arg("terms").noconvert(), nb::arg("limit"),
          nb::arg("rounds"), nb::arg("ideal").noconvert());
    bind_landing(m);
}
