// One call a frame: sums over patches, a product of patch size, and the projector's codes.
#include "frame.hpp"

#include <algorithm>
#include <cmath>
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
        frame_.response = reinterpret_cast<const std::int32_t *>(response.data());
        frame_.dither = array_of<std::uint8_t, 3>(model, "dither").data();
        set_channels(array_of<double, 2>(model, "response"), array_of<double, 2>(model, "mixing"), unmixing);
        frame_.rounds = rounds_for(frame_.mixing);
        rows_ = array_of<std::int32_t, 1>(model, "sum_rows").data();
        n_rows_ = static_cast<std::int64_t>(array_of<std::int32_t, 1>(model, "sum_rows").shape(0));
        row_scale_ = array_of<double, 1>(model, "row_scale").data();
        const auto curvature = array_of<double, 2>(model, "curvature");
        for (std::int64_t b = 0; b < BANDS; ++b) {
            const double *from = curvature.data() + (curvature.shape(0) == 1 ? 0 : b) * pixels_.n_lit;
            curvature_.insert(curvature_.end(), from, from + pixels_.n_lit);
        }
        for (auto *of_lit : {&emitted_, &adjoint_}) of_lit->resize(BANDS * pixels_.n_lit);
        for (auto *of_viewed : {&irradiance_, &returned_}) of_viewed->resize(BANDS * pixels_.n_viewed);
        partial_.resize(CHUNKS * BANDS * (pixels_.n_lit + pixels_.n_viewed));
    }

    // Fills out; returns how many of the steered pixels' channels the range holds back.
    std::int64_t exact(In<std::uint8_t, 3> codes, Out<std::uint8_t, 3> out, In<float, 2> target, int threads) {
        begin_frame(codes, out, target);
        forget_sums();
#pragma omp parallel num_threads(threads)
        {
            invert();
            code(false);
        }
        return clipped();
    }

    // The same for the bounded optimum: steps from what the last call left, or first_steps from the exact inverse if
    // fresh or if the target is quite another. Returns how many channels are held back, the sum of squared errors in
    // camera values before the last step, and how often the picture was gone through.
    nb::tuple bounded(In<std::uint8_t, 3> codes, Out<std::uint8_t, 3> out, In<float, 2> target, int steps,
                      int first_steps, bool fresh, int threads) {
        {
            const nb::gil_scoped_release unlocked;
            begin_frame(codes, out, target);
            fresh |= is_another();
            if (fresh) {
                steps = first_steps;
                std::fill(adjoint_.begin(), adjoint_.end(), 0.0f);
                forget_sums();
            }
#pragma omp parallel num_threads(threads)
            {
                if (fresh) invert();
                for (int step = 0; step < steps; ++step) improve();
                code(true);
            }
        }
        double squared = 0;
        for (const Sums &sums : sums_) squared += left_out() * sums.squared;
        return nb::make_tuple(clipped(), squared, steps + 1 + fresh);
    }

  private:
    void set_channels(const In<double, 2> &response, const In<double, 2> &mixing, const In<double, 2> &unmixing) {
        for (int b = 0; b < BANDS; ++b) {
            frame_.span[b] = static_cast<float>(response.data()[256 * b + 255]);
            frame_.per_span[b] = static_cast<float>(1 / response.data()[256 * b + 255]);
            for (int c = 0; c < BANDS; ++c) {
                frame_.mixing[b][c] = static_cast<float>(mixing.data()[BANDS * b + c]);
                frame_.unmixing[b][c] = static_cast<float>(unmixing.data()[BANDS * b + c]);
                frame_.mixed |= mixing.data()[BANDS * b + c] != (b == c);
            }
        }
    }

    // One if two channels have less than a fifth in common.
    static int rounds_for(const float (&mixing)[BANDS][BANDS]) {
        float most = 0;
        for (int c = 0; c < BANDS; ++c)
            for (int d = 0; d < BANDS; ++d) {
                float own = 0, common = 0;
                for (int b = 0; b < BANDS; ++b) {
                    own += mixing[b][c] * mixing[b][c];
                    common += mixing[b][c] * mixing[b][d];
                }
                if (c != d) most = std::max(most, std::abs(common) / own);
            }
        return most < 0.2f ? 1 : 4;
    }

    void begin_frame(const In<std::uint8_t, 3> &codes, const Out<std::uint8_t, 3> &out, const In<float, 2> &target) {
        frame_.codes = codes.data();
        frame_.out = out.data();
        for (int b = 0; b < BANDS; ++b)
            for (int code = 0; code < 256; ++code)
                target_[256 * b + code] = target.data()[256 * b + code] * pixels_.inverse.unit[b];
        frame_.target = target_;
        frame_.irradiance = irradiance_.data();
        frame_.adjoint = adjoint_.data();
        sums_.assign(CHUNKS, Sums{});
    }

    // Whether the target differs from the last one by more than a quarter, in a thin sample.
    bool is_another() {
        constexpr std::int64_t EACH = 16;
        double change = 0, light = 0;
        std::size_t k = 0;
        for (std::int64_t row = EACH / 2; row < pixels_.height; row += EACH)
            for (std::int64_t column = EACH / 2; column < pixels_.width; column += EACH)
                for (std::int64_t b = 0; b < BANDS; ++b, ++k) {
                    const float now = target_[256 * b + frame_.codes[BANDS * (row * pixels_.width + column) + b]];
                    if (k == sample_.size()) sample_.push_back(now);
                    change += std::abs(now - sample_[k]);
                    light += (now + sample_[k]) / 2;
                    sample_[k] = now;
                }
        return change > 0.25 * light;
    }

    void forget_sums() {
        const std::int64_t lit = BANDS * pixels_.n_lit, viewed = BANDS * pixels_.n_viewed;
        std::fill(partial_.begin(), partial_.end(), 0.0);
        for (std::int64_t chunk = 0; chunk < CHUNKS; ++chunk)
            sums_[chunk] = {partial_.data() + chunk * lit, partial_.data() + CHUNKS * lit + chunk * viewed, 0, 0};
    }

    std::int64_t clipped() const {
        std::int64_t sum = 0;
        for (const Sums &sums : sums_) sum += sums.clipped;
        return sum;
    }

    // The exact inverse's irradiance; like all below, within a parallel region.
    void invert() {
        each_chunk(n_rows_, [&](std::int64_t k, Sums &sums) { KERNEL_CALL(sum_row(pixels_, frame_, rows_[k], sums)); });
        const std::int64_t n = BANDS * pixels_.n_lit;
#pragma omp for schedule(static)
        for (std::int64_t i = 0; i < n; ++i) emitted_[i] = static_cast<float>(emission(i) - black_[i]);
        irradiate();
    }

    // One step towards the bounded optimum.
    void improve() {
#pragma omp single
        forget_sums();
        each_chunk(n_rows_, [&](std::int64_t k, Sums &sums) { KERNEL_CALL(step_row(pixels_, frame_, rows_[k], sums)); });
        const std::int64_t lit = BANDS * pixels_.n_lit, viewed = BANDS * pixels_.n_viewed;
#pragma omp for schedule(static)
        for (std::int64_t j = 0; j < viewed; ++j)
            returned_[j] = static_cast<float>(left_out() * added(partial_.data() + CHUNKS * lit, viewed, j));
        constexpr std::int64_t PARTS = 8;
#pragma omp for schedule(dynamic, 1)
        for (std::int64_t part = 0; part < BANDS * PARTS; ++part) {
            const std::int64_t b = part / PARTS, k = part % PARTS, n = pixels_.n_lit;
            KERNEL_CALL(product_columns(matrix_of(b), returned_.data() + b * pixels_.n_viewed, pixels_.n_viewed, n,
                                        n * k / PARTS, n * (k + 1) / PARTS, adjoint_.data() + b * n));
        }
#pragma omp for schedule(static)
        for (std::int64_t i = 0; i < lit; ++i)
            emitted_[i] = static_cast<float>(emission(i) - curvature_[i] * adjoint_[i]);
        irradiate();
    }

    // Calls work(row number, sums) for n rows by chunks, within a parallel region.
    template <class Work>
    void each_chunk(std::int64_t n, const Work &work) {
#pragma omp for schedule(dynamic, 1)
        for (std::int64_t chunk = 0; chunk < CHUNKS; ++chunk)
            for (std::int64_t row = n * chunk / CHUNKS; row < n * (chunk + 1) / CHUNKS; ++row) work(row, sums_[chunk]);
    }

    void code(bool bounded) {
        each_chunk(pixels_.height, [&](std::int64_t row, Sums &sums) {
            KERNEL_CALL(code_row(pixels_, frame_, bounded, row, sums));
        });
    }

    // The chunks' sums in their order.
    static double added(const double *partial, std::int64_t n, std::int64_t i) {
        double sum = 0;
        for (std::int64_t chunk = 0; chunk < CHUNKS; ++chunk) sum += partial[chunk * n + i];
        return sum;
    }

    double emission(std::int64_t i) const {
        return row_scale_[i % pixels_.n_lit] * added(partial_.data(), BANDS * pixels_.n_lit, i);
    }

    // How many rows each one of those that are summed stands for.
    double left_out() const { return static_cast<double>(pixels_.height) / static_cast<double>(n_rows_); }

    const float *matrix_of(std::int64_t band) const {
        return matrix_ + (matrices_ == 1 ? 0 : band) * pixels_.n_viewed * pixels_.n_lit;
    }

    // Irradiance of the viewed patches by what the lit ones emit. Where the inverse asks for light below 0, there is
    // none: it would be made up for elsewhere, and black would not be black.
    void irradiate() {
#pragma omp for schedule(static)
        for (std::int64_t j = 0; j < pixels_.n_viewed; ++j)
            for (std::int64_t b = 0; b < BANDS; ++b)
                irradiance_[b * pixels_.n_viewed + j] = std::max(
                    0.0f, KERNEL_CALL(product_row(matrix_of(b) + j * pixels_.n_lit,
                                                  emitted_.data() + b * pixels_.n_lit, pixels_.n_lit)));
    }

    std::vector<nb::object> kept_;
    Pixels pixels_{};
    Frame frame_{};
    const float *matrix_;
    std::int64_t matrices_, n_rows_;
    const std::int32_t *rows_;
    const double *row_scale_;
    std::vector<double> black_, curvature_, partial_;
    std::vector<float> sample_, irradiance_, returned_, emitted_, adjoint_;
    float target_[BANDS * 256];
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
             nb::call_guard<nb::gil_scoped_release>())
        .def("bounded", &Kernel::bounded, nb::arg("codes"), nb::arg("out"), nb::arg("target"), nb::arg("steps"),
             nb::arg("first_steps"), nb::arg("fresh"), nb::arg("threads"));
}
