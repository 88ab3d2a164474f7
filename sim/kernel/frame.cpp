// One call a frame: sums over patches, a product of patch size, and the projector's codes.
#include "frame.hpp"

#include <algorithm>
#include <vector>

#include "arrays.hpp"
#include "bindings.hpp"

namespace kernel::frame {
namespace {

constexpr std::int64_t CHUNKS = 16;  // rows are shared out in so many parts, whatever the number of threads

template <class T, int Dimensions>
In<T, Dimensions> array_of(const nb::object &owner, const char *name) {
    return nb::cast<In<T, Dimensions>>(owner.attr(name));
}

Layers layers_of(const nb::object &packed) {
    const auto bits = array_of<std::uint16_t, 3>(packed, "bits");
    const auto unit = array_of<double, 1>(packed, "unit");
    Layers layers{};
    const std::size_t n = bits.shape(0), size = bits.shape(1) * bits.shape(2);
    for (std::size_t b = 0; b < BANDS; ++b) {
        layers.band[b] = bits.data() + std::min(b, n - 1) * size;
        layers.unit[b] = static_cast<float>(unit.data()[std::min(b, n - 1)]);
    }
    return layers;
}

Runs runs_of(const nb::object &runs) {
    return {array_of<std::int32_t, 1>(runs, "row").data(), array_of<std::int32_t, 1>(runs, "start").data(),
            array_of<std::int32_t, 2>(runs, "value").data()};
}

// A sim.frame_model.FrameModel, whose arrays it keeps: nobody may change them meanwhile. One frame at a time.
class Kernel {
  public:
    // response: (3, RESPONSE) codes by light; unmixing: the inverse of the model's mixing.
    Kernel(nb::object model, In<std::uint32_t, 2> response, In<double, 2> unmixing)
        : kept_{model, nb::cast(response)} {
        pixels_.inverse = layers_of(model.attr("inverse_direct"));
        pixels_.offset = layers_of(model.attr("offset"));
        pixels_.gain = layers_of(model.attr("view_gain"));
        pixels_.emission = layers_of(model.attr("emission"));
        pixels_.patches = runs_of(model.attr("patch_runs"));
        const nb::object cells = model.attr("cells");
        pixels_.cells = runs_of(cells.attr("runs"));
        const auto place = array_of<std::uint8_t, 3>(cells, "place");
        pixels_.height = static_cast<std::int64_t>(place.shape(1));
        pixels_.width = static_cast<std::int64_t>(place.shape(2));
        pixels_.place_x = place.data();
        pixels_.place_y = place.data() + pixels_.height * pixels_.width;
        const auto matrix = array_of<float, 3>(model, "inverse");
        matrix_ = matrix.data();
        matrices_ = static_cast<std::int64_t>(matrix.shape(0));
        pixels_.n_viewed = static_cast<std::int64_t>(matrix.shape(1));
        pixels_.n_lit = static_cast<std::int64_t>(matrix.shape(2));
        const auto black = array_of<double, 2>(model, "black_emission");
        black_.assign(black.data(), black.data() + BANDS * pixels_.n_lit);
        frame_.response = response.data();
        frame_.dither = array_of<std::uint8_t, 3>(model, "dither").data();
        set_channels(array_of<double, 2>(model, "response"), array_of<double, 2>(model, "mixing"), unmixing);
        irradiance_.resize(BANDS * pixels_.n_viewed);
        emitted_.resize(BANDS * pixels_.n_lit);
        partial_.resize(CHUNKS * BANDS * pixels_.n_lit);
    }

    // Fills out; returns how many of the steered pixels' channels the range holds back.
    std::int64_t exact(In<std::uint8_t, 3> codes, Out<std::uint8_t, 3> out, In<float, 2> target, int threads) {
        begin_frame(codes, out, target);
        std::int64_t clipped = 0;
#pragma omp parallel num_threads(threads)
        {
            each_chunk([&](std::int64_t row, Sums &sums) { KERNEL_CALL(sum_row(pixels_, frame_, row, sums)); });
            add_up();
#pragma omp for schedule(static)
            for (std::int64_t j = 0; j < pixels_.n_viewed; ++j) products(j);
            each_chunk([&](std::int64_t row, Sums &sums) { KERNEL_CALL(code_row(pixels_, frame_, false, row, sums)); });
        }
        for (const Sums &sums : sums_) clipped += sums.clipped;
        return clipped;
    }

  private:
    void set_channels(const In<double, 2> &response, const In<double, 2> &mixing, const In<double, 2> &unmixing) {
        for (int b = 0; b < BANDS; ++b) {
            const double *light = response.data() + 256 * b;
            frame_.lower[b] = static_cast<float>(light[0]);
            frame_.span[b] = static_cast<float>(light[255] - light[0]);
            for (int c = 0; c < BANDS; ++c) {
                frame_.mixing[b][c] = static_cast<float>(mixing.data()[BANDS * b + c]);
                frame_.unmixing[b][c] = static_cast<float>(unmixing.data()[BANDS * b + c]);
                frame_.mixed |= mixing.data()[BANDS * b + c] != (b == c);
            }
        }
    }

    void begin_frame(const In<std::uint8_t, 3> &codes, const Out<std::uint8_t, 3> &out, const In<float, 2> &target) {
        frame_.codes = codes.data();
        frame_.out = out.data();
        frame_.target = target.data();
        frame_.irradiance = irradiance_.data();
        sums_.assign(CHUNKS, Sums{});
        std::fill(partial_.begin(), partial_.end(), 0.0);
        for (std::int64_t chunk = 0; chunk < CHUNKS; ++chunk)
            sums_[chunk].emitted = partial_.data() + chunk * BANDS * pixels_.n_lit;
    }

    // All rows by chunks, within a parallel region.
    template <class Work>
    void each_chunk(const Work &work) {
#pragma omp for schedule(dynamic, 1)
        for (std::int64_t chunk = 0; chunk < CHUNKS; ++chunk)
            for (std::int64_t row = begin(chunk); row < begin(chunk + 1); ++row) work(row, sums_[chunk]);
    }

    std::int64_t begin(std::int64_t chunk) const { return pixels_.height * chunk / CHUNKS; }

    // The chunks' sums in their order, less black's.
    void add_up() {
        const std::int64_t n = BANDS * pixels_.n_lit;
#pragma omp for schedule(static)
        for (std::int64_t i = 0; i < n; ++i) {
            double sum = -black_[i];
            for (std::int64_t chunk = 0; chunk < CHUNKS; ++chunk) sum += partial_[chunk * n + i];
            emitted_[i] = static_cast<float>(sum);
        }
    }

    // The j-th viewed patch's irradiance in each band.
    void products(std::int64_t j) {
        for (std::int64_t b = 0; b < BANDS; ++b) {
            const float *row = matrix_ + ((matrices_ == 1 ? 0 : b) * pixels_.n_viewed + j) * pixels_.n_lit;
            irradiance_[b * pixels_.n_viewed + j] =
                KERNEL_CALL(product_row(row, emitted_.data() + b * pixels_.n_lit, pixels_.n_lit));
        }
    }

    std::vector<nb::object> kept_;
    Pixels pixels_{};
    Frame frame_{};
    const float *matrix_;
    std::int64_t matrices_;
    std::vector<double> black_, partial_;
    std::vector<float> irradiance_, emitted_;
    std::vector<Sums> sums_;
};

}  // namespace
}  // namespace kernel::frame

void bind_frame(nb::module_ &m) {
    using kernel::frame::Kernel;
    nb::class_<Kernel>(m, "FrameKernel")
        .def(nb::init<nb::object, In<std::uint32_t, 2>, In<double, 2>>(), nb::arg("model"), nb::arg("response"),
             nb::arg("unmixing"))
        .def("exact", &Kernel::exact, nb::arg("codes"), nb::arg("out"), nb::arg("target"), nb::arg("threads"),
             nb::call_guard<nb::gil_scoped_release>());
}
