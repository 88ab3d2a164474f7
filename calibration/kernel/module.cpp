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
}
