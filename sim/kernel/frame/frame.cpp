// One call a frame: sums over patches, a product of patch size, and the projector's codes.
#include "frame/frame.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <utility>
#include <vector>

#include "arrays.hpp"
#include "bindings.hpp"
#include "frame/model_arrays.hpp"

namespace kernel::frame {
namespace {

// Rows of a picture, and of a matrix, are shared out in so many parts, whatever the number of threads.
constexpr std::int64_t CHUNKS = 16, PARTS = 8;

// A sim.frame.model.FrameModel, whose arrays it keeps: nobody may change them meanwhile. One frame at a time.
class Kernel {
  public:
    // response: (1 or 3, RESPONSE) codes by light; cubics: (0, 1 or 3, 4, 32), 0 where none would follow the response;
    // unmixing: the inverse of the model's mixing.
    Kernel(nb::object model, In<std::uint32_t, 2> response, In<float, 3> cubics, In<double, 2> unmixing)
        : kept_{model, nb::cast(response)} {
        pixels_.inverse = layers_of(model.attr("inverse_direct"));
        pixels_.offset = layers_of(model.attr("offset"));
        pixels_.gain = layers_of(model.attr("view_gain"));
        pixels_.emission = layers_of(model.attr("emission"));
        pixels_.patches = runs_of(model.attr("patch_runs"));
        const nb::object cells = model.attr("cells");
        pixels_.cells = runs_of(cells.attr("runs"));
        const auto corners = array_of<std::int32_t, 2>(cells, "corners");
        pixels_.corners = corners.data();
        n_cells_ = static_cast<std::int64_t>(corners.shape(0));
        const auto place = array_of<std::uint8_t, 3>(cells, "place");
        pixels_.height = static_cast<std::int64_t>(place.shape(1));
        pixels_.width = static_cast<std::int64_t>(place.shape(2));
        pixels_.place_x = place.data();
        pixels_.place_y = place.data() + pixels_.height * pixels_.width;
        const nb::object inverse = model.attr("inverse");
        const auto entries = array_of<std::int16_t, 3>(inverse, "entries");
        matrix_ = {entries.data(), array_of<float, 2>(inverse, "unit").data(),
                   static_cast<std::int64_t>(entries.shape(1)), static_cast<std::int64_t>(entries.shape(2))};
        matrices_ = static_cast<std::int64_t>(entries.shape(0));
        pixels_.n_lit = matrix_.columns;
        nodes_ = means_of(model.attr("nodes"));
        of_patch_ = nodes_.transposed(matrix_.rows);
        const auto black = array_of<double, 2>(model, "black_emission");
        black_.assign(black.data(), black.data() + BANDS * pixels_.n_lit);
        set_responses(response, cubics, array_of<std::uint8_t, 3>(model, "dither"));
        set_channels(array_of<double, 2>(model, "response"), array_of<double, 2>(model, "mixing"), unmixing);
        frame_.rounds = rounds_for(array_of<double, 2>(model, "mixing"));
        rows_ = array_of<std::int32_t, 1>(model, "sum_rows").data();
        n_rows_ = static_cast<std::int64_t>(array_of<std::int32_t, 1>(model, "sum_rows").shape(0));
        row_scale_ = array_of<double, 1>(model, "row_scale").data();
        const auto curvature = array_of<double, 2>(model, "curvature");
        for (std::int64_t b = 0; b < BANDS; ++b) {
            const double *from = curvature.data() + (curvature.shape(0) == 1 ? 0 : b) * pixels_.n_lit;
            curvature_.insert(curvature_.end(), from, from + pixels_.n_lit);
        }
        for (auto *of_lit : {&emitted_, &adjoint_, &pull_}) of_lit->resize(BANDS * pixels_.n_lit);
        for (auto *of_viewed : {&irradiance_, &returned_}) of_viewed->resize(BANDS * matrix_.rows);
        for (auto *of_node : {&node_irradiance_, &node_returned_}) of_node->resize(BANDS * nodes_.n);
        cells_.resize(n_cells_ * BANDS * 4);
        products_.resize(BANDS * PARTS * pixels_.n_lit);
        partial_.resize(CHUNKS * SUM_LANES * (pixels_.n_lit + nodes_.n));
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
        return clipped_;
    }

    // The same for the bounded optimum: steps from what the last call left, or first_steps from the exact inverse if
    // fresh or if the target is quite another. Returns how many channels are held back, the sum of squared errors in
    // camera values before the last step, and how often the picture was gone through.
    nb::tuple bounded(In<std::uint8_t, 3> codes, Out<std::uint8_t, 3> out, In<float, 2> target, int steps,
                      int first_steps, bool fresh, int threads) {
        {
            const nb::gil_scoped_release unlocked;
            begin_frame(codes, out, target);
            fresh |= is_another(target);
            if (fresh) {
                steps = first_steps;
                std::fill(pull_.begin(), pull_.end(), 0.0f);
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
        return nb::make_tuple(clipped_, squared * weight_unit_, steps + 1 + fresh);
    }

  private:
    void set_responses(const In<std::uint32_t, 2> &response, const In<float, 3> &cubics,
                       const In<std::uint8_t, 3> &dither) {
        for (std::size_t k = 0; k < dither.size(); ++k) dither_.push_back(dither.data()[k] / 256.0f);
        frame_.smooth = cubics.shape(0) > 0;
        for (std::size_t c = 0; c < BANDS; ++c) {
            Channel &channel = frame_.channel[c];
            const std::size_t table = std::min(c, response.shape(0) - 1) * RESPONSE;
            channel.table = reinterpret_cast<const std::int32_t *>(response.data()) + table - RESPONSE_FIRST;
            if (frame_.smooth) std::copy_n(cubics.data() + std::min(c, cubics.shape(0) - 1) * 128, 128, cubics_[c][0]);
            channel.cubics = cubics_[c];
            channel.dither = dither_.data() + c * DITHER * DITHER;
        }
    }

    // Units of light, in which packed numbers and their squares neither overflow nor vanish.
    void set_channels(const In<double, 2> &response, const In<double, 2> &mixing, const In<double, 2> &unmixing) {
        double weight[BANDS], most = 0;
        for (int b = 0; b < BANDS; ++b) {
            const double span = response.data()[256 * b + 255];
            light_unit_[b] = 0x1p32 * span;
            frame_.offset[b] = -static_cast<float>(per_packed(pixels_.offset, b));
            const double per_inverse = pixels_.inverse.unit[b] > 0 ? 1.0 / pixels_.inverse.unit[b] : 0;
            weight[b] = light_unit_[b] * light_unit_[b] * per_inverse * per_inverse;
        }
        for (int b = 0; b < BANDS; ++b)
            for (int c = 0; c < BANDS; ++c) {
                const double span = response.data()[256 * c + 255], by_share = mixing.data()[BANDS * b + c] * span;
                frame_.light[b][c] = static_cast<float>(by_share / light_unit_[b]);
                frame_.channels[c][b] = static_cast<float>(unmixing.data()[BANDS * c + b] * light_unit_[b] / span);
                frame_.mixed |= mixing.data()[BANDS * b + c] != (b == c);
                most = std::max(most, weight[b] * frame_.light[b][c] * frame_.light[b][c]);
            }
        weight_unit_ = most > 0 ? most : 1;
        for (int c = 0; c < BANDS; ++c)
            for (int d = 0; d < BANDS; ++d)
                for (int b = 0; b < BANDS; ++b) frame_.common[c][d][b] = frame_.light[b][c] * frame_.light[b][d];
        for (int b = 0; b < BANDS; ++b) frame_.weight[b] = static_cast<float>(weight[b] / weight_unit_);
    }

    // What a packed 1 stands for, in units of light. It may be beyond single precision, what it is multiplied with makes up
    // for that.
    double per_packed(const Layers &layers, std::int64_t b) const {
        return double{PACKED_ONE} * layers.unit[b] / light_unit_[b];
    }

    // One if two channels have less than a fifth in common.
    static int rounds_for(const In<double, 2> &mixing) {
        double most = 0;
        for (int c = 0; c < BANDS; ++c)
            for (int d = 0; d < BANDS; ++d) {
                double own = 0, common = 0;
                for (int b = 0; b < BANDS; ++b) {
                    own += mixing.data()[BANDS * b + c] * mixing.data()[BANDS * b + c];
                    common += mixing.data()[BANDS * b + c] * mixing.data()[BANDS * b + d];
                }
                if (c != d) most = std::max(most, std::abs(common) / own);
            }
        return most < 0.2 ? 1 : 4;
    }

    void begin_frame(const In<std::uint8_t, 3> &codes, const Out<std::uint8_t, 3> &out, const In<float, 2> &target) {
        frame_.codes = codes.data();
        frame_.out = out.data();
        for (int b = 0; b < BANDS; ++b) set_target(b, target.data() + 256 * b);
        frame_.cells = cells_.data();
        frame_.pull = pull_.data();
        sums_.assign(CHUNKS, Sums{});
        clipped_ = 0;
    }

    void set_target(int b, const float *wanted) {
        constexpr double MOST = 0x1p100;  // beyond all reach, and far from infinite
        const float most = *std::max_element(wanted, wanted + 256);
        const double unit = most / TARGET_RANGE * per_packed(pixels_.inverse, b);
        Target &target = frame_.target[b];
        target.unit = static_cast<float>(std::min(unit, MOST));
        target.none = -TARGET_LEAST * target.unit;
        target.light = target_light_[b];
        target.bytes = target_bytes_[b];
        for (int code = 0; code < 256; ++code) {
            const float number = (most > 0 ? wanted[code] / most : 0) * TARGET_RANGE + TARGET_LEAST;
            std::uint32_t bits;
            std::memcpy(&bits, &number, sizeof bits);
            for (int byte = 0; byte < 3; ++byte)
                target_bytes_[b][byte][code] = static_cast<std::uint8_t>(bits >> 8 * byte);
            target_light_[b][code] = (number - TARGET_LEAST) * target.unit;  // the difference is exact
        }
    }

    // Whether the target differs from the last one by more than a quarter, in means over tiles of a thin sample: what
    // moves within a tile leaves the patches' light as it was.
    bool is_another(const In<float, 2> &target) {
        const std::int64_t tile = std::max<std::int64_t>(1, pixels_.width / 16), each = (tile + 7) / 8;
        const std::int64_t across = (pixels_.width + tile - 1) / tile, down = (pixels_.height + tile - 1) / tile;
        std::vector<float> now(across * down * BANDS);
        for (std::int64_t row = each / 2; row < pixels_.height; row += each)
            for (std::int64_t column = each / 2; column < pixels_.width; column += each)
                for (std::int64_t b = 0; b < BANDS; ++b)
                    now[BANDS * (row / tile * across + column / tile) + b] +=
                        target.data()[256 * b + frame_.codes[BANDS * (row * pixels_.width + column) + b]];
        sample_.resize(now.size());
        double change = 0, light = 0;
        for (std::size_t k = 0; k < now.size(); ++k) {
            change += std::abs(now[k] - sample_[k]);
            light += (now[k] + sample_[k]) / 2;
        }
        sample_ = std::move(now);
        return change > 0.25 * light;
    }

    void forget_sums() {
        const std::int64_t lit = SUM_LANES * pixels_.n_lit, viewed = SUM_LANES * nodes_.n;
        std::fill(partial_.begin(), partial_.end(), 0.0);
        for (std::int64_t chunk = 0; chunk < CHUNKS; ++chunk)
            sums_[chunk] = {partial_.data() + chunk * lit, partial_.data() + CHUNKS * lit + chunk * viewed, 0};
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
        each_chunk(n_rows_, [&](std::int64_t k, Sums &sums) {
            KERNEL_CALL(step_row(pixels_, frame_, rows_[k], sums));
        });
        const std::int64_t lit = BANDS * pixels_.n_lit, viewed = BANDS * matrix_.rows;
        const double *returned = partial_.data() + CHUNKS * SUM_LANES * pixels_.n_lit;
#pragma omp for schedule(static)
        for (std::int64_t j = 0; j < BANDS * nodes_.n; ++j) {
            const std::int64_t b = j / nodes_.n;
            const double unit = left_out() * weight_unit_ * per_packed(pixels_.gain, b);
            node_returned_[j] = static_cast<float>(unit * added(returned, nodes_.n, j % nodes_.n, b));
        }
#pragma omp for schedule(static)
        for (std::int64_t j = 0; j < viewed; ++j)
            returned_[j] = of_patch_.sum(j % matrix_.rows, node_returned_.data() + j / matrix_.rows * nodes_.n);
#pragma omp for schedule(dynamic, 1)
        for (std::int64_t part = 0; part < BANDS * PARTS; ++part) {
            const std::int64_t b = part / PARTS, k = part % PARTS, n = pixels_.n_lit, rows = matrix_.rows;
            const float *x = returned_.data() + b * rows;
            float *out = products_.data() + part * n;
            std::fill(out, out + n, 0.0f);
            KERNEL_CALL(add_rows(matrix_of(b), x, rows * k / PARTS, rows * (k + 1) / PARTS, out));
        }
#pragma omp for schedule(static)
        for (std::int64_t i = 0; i < lit; ++i) {
            const std::int64_t b = i / pixels_.n_lit;
            const float *parts = products_.data() + b * PARTS * pixels_.n_lit + i % pixels_.n_lit;
            adjoint_[i] = 0;
            for (std::int64_t part = 0; part < PARTS; ++part) adjoint_[i] += parts[part * pixels_.n_lit];
            const double inverse = pixels_.inverse.unit[b];
            emitted_[i] = static_cast<float>(emission(i) - curvature_[i] * adjoint_[i]);
            pull_[i] = static_cast<float>(adjoint_[i] * inverse * inverse * pixels_.emission.unit[0] / light_unit_[b]);
        }
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
        std::int64_t clipped = 0;
#pragma omp for schedule(dynamic, 4)
        for (std::int64_t row = 0; row < pixels_.height; ++row)
            clipped += KERNEL_CALL(code_row(pixels_, frame_, bounded, row));
#pragma omp atomic
        clipped_ += clipped;
    }

    // The chunks' sums of a patch in a band, in their order.
    static double added(const double *partial, std::int64_t n, std::int64_t patch, std::int64_t band) {
        double sum = 0;
        for (std::int64_t chunk = 0; chunk < CHUNKS; ++chunk)
            sum += partial[SUM_LANES * (chunk * n + patch) + band];
        return sum;
    }

    double emission(std::int64_t i) const {
        const std::int64_t band = i / pixels_.n_lit, patch = i % pixels_.n_lit;
        return row_scale_[patch] * pixels_.emission.unit[0] * light_unit_[band] *
               added(partial_.data(), pixels_.n_lit, patch, band);
    }

    // How many rows each one of those that are summed stands for.
    double left_out() const { return static_cast<double>(pixels_.height) / static_cast<double>(n_rows_); }

    Matrix matrix_of(std::int64_t band) const {
        const std::int64_t layer = matrices_ == 1 ? 0 : band;
        Matrix matrix = matrix_;
        matrix.entries += layer * matrix.rows * matrix.columns;
        matrix.unit += layer * matrix.rows;
        return matrix;
    }

    // Irradiance of the viewed patches by what the lit ones emit, then of the nodes, and between the corners of the
    // cells. Where the inverse asks for light below 0, there is none: it would be made up for elsewhere, and black would
    // not be black.
    void irradiate() {
        const std::int64_t viewed = matrix_.rows, n = nodes_.n;
#pragma omp for schedule(static)
        for (std::int64_t i = 0; i < BANDS * viewed; ++i) {
            const float *light = emitted_.data() + i / viewed * pixels_.n_lit;
            irradiance_[i] = KERNEL_CALL(product_row(matrix_of(i / viewed), i % viewed, light));
        }
#pragma omp for schedule(static)
        for (std::int64_t i = 0; i < BANDS * n; ++i) {
            const float seen = nodes_.sum(i % n, irradiance_.data() + i / n * viewed);
            node_irradiance_[i] = static_cast<float>(-std::max(0.0f, seen) * per_packed(pixels_.gain, i / n));
        }
#pragma omp for schedule(static)
        for (std::int64_t cell = 0; cell < n_cells_; ++cell)
            for (std::int64_t b = 0; b < BANDS; ++b) {
                const std::int32_t *corner = pixels_.corners + 4 * cell;
                const float *h = node_irradiance_.data() + b * n;
                float *to = cells_.data() + 4 * (BANDS * cell + b);
                to[0] = h[corner[0]];
                to[1] = (h[corner[1]] - h[corner[0]]) / 255;
                to[2] = (h[corner[2]] - h[corner[0]]) / 255;
                to[3] = ((h[corner[3]] - h[corner[1]]) - (h[corner[2]] - h[corner[0]])) / (255 * 255);
            }
    }

    std::vector<nb::object> kept_;
    Pixels pixels_{};
    Frame frame_{};
    Matrix matrix_;
    std::int64_t matrices_, n_rows_, n_cells_, clipped_;
    const std::int32_t *rows_;
    const double *row_scale_;
    std::vector<double> black_, curvature_, partial_;
    std::vector<float> sample_, irradiance_, returned_, emitted_, adjoint_, pull_, cells_, products_;
    std::vector<float> node_irradiance_, node_returned_;
    Means nodes_, of_patch_;
    alignas(64) std::uint8_t target_bytes_[BANDS][3][256];
    alignas(64) float cubics_[BANDS][4][32];
    float target_light_[BANDS][256];
    double light_unit_[BANDS], weight_unit_;
    std::vector<Sums> sums_;
    std::vector<float> dither_;
};

}  // namespace
}  // namespace kernel::frame

void bind_frame(nb::module_ &m) {
    using kernel::frame::Kernel;
    nb::class_<Kernel>(m, "FrameKernel")
        .def(nb::init<nb::object, In<std::uint32_t, 2>, In<float, 3>, In<double, 2>>(), nb::arg("model"),
             nb::arg("response"), nb::arg("cubics"), nb::arg("unmixing"))
        .def("exact", &Kernel::exact, nb::arg("codes"), nb::arg("out"), nb::arg("target"), nb::arg("threads"),
             nb::call_guard<nb::gil_scoped_release>())
        .def("bounded", &Kernel::bounded, nb::arg("codes"), nb::arg("out"), nb::arg("target"), nb::arg("steps"),
             nb::arg("first_steps"), nb::arg("fresh"), nb::arg("threads"));
}
