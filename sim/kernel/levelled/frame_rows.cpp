// Rows of a frame, in segments that fit the first cache. Loops have fixed lanes, so that every instruction set adds
// in the same order. Loops over runs go by whole blocks; what a block writes beyond its run, the next run writes again.
#include <algorithm>
#include <cstring>

#include "frame.hpp"

#pragma GCC diagnostic ignored "-Wpsabi"

namespace kernel::frame::KERNEL_LEVEL {

namespace {

typedef std::uint8_t Bytes __attribute__((vector_size(16)));

constexpr int PADDED = SEGMENT + BLOCK, PACKED_SHIFT = 10;
constexpr float PACKED_TOE = 1.0f / 256;

using Row = float[BANDS][PADDED];

// A segment's pixels [first, first + n) of the picture, in plain rows.
struct Segment {
    std::int64_t first, column;
    int n;
};

inline float bits_as_float(std::uint32_t bits) {
    float value;
    std::memcpy(&value, &bits, sizeof value);
    return value;
}

inline std::uint32_t float_as_bits(float value) {
    std::uint32_t bits;
    std::memcpy(&bits, &value, sizeof bits);
    return bits;
}

// In units of the layer's unit.
inline float unpacked(std::uint16_t bits) {
    constexpr std::uint32_t first = 0x3b800000;  // the toe's bits
    return bits_as_float((static_cast<std::uint32_t>(bits) << PACKED_SHIFT) + first) - PACKED_TOE;
}

inline Bytes load_bytes(const std::uint8_t *p) {
    Bytes v;
    std::memcpy(&v, p, sizeof v);
    return v;
}

inline void store_bytes(std::uint8_t *p, Bytes v) { std::memcpy(p, &v, sizeof v); }

// Interleaved channels to planes.
void split(const std::uint8_t *codes, int n, std::uint8_t (*plane)[PADDED]) {
    int k = 0;
    for (; k + BLOCK <= n; k += BLOCK) {
        const Bytes a = load_bytes(codes + 3 * k), b = load_bytes(codes + 3 * k + 16), c = load_bytes(codes + 3 * k + 32);
        const Bytes r = __builtin_shufflevector(a, b, 0, 3, 6, 9, 12, 15, 18, 21, 24, 27, 30, 0, 0, 0, 0, 0);
        const Bytes g = __builtin_shufflevector(a, b, 1, 4, 7, 10, 13, 16, 19, 22, 25, 28, 31, 0, 0, 0, 0, 0);
        const Bytes u = __builtin_shufflevector(a, b, 2, 5, 8, 11, 14, 17, 20, 23, 26, 29, 0, 0, 0, 0, 0, 0);
        store_bytes(plane[0] + k, __builtin_shufflevector(r, c, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 17, 20, 23, 26, 29));
        store_bytes(plane[1] + k, __builtin_shufflevector(g, c, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 18, 21, 24, 27, 30));
        store_bytes(plane[2] + k, __builtin_shufflevector(u, c, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 16, 19, 22, 25, 28, 31));
    }
    for (; k < n; ++k)
        for (int b = 0; b < BANDS; ++b) plane[b][k] = codes[3 * k + b];
}

// Planes to interleaved channels.
void join(const std::uint8_t (*plane)[PADDED], int n, std::uint8_t *codes) {
    int k = 0;
    for (; k + BLOCK <= n; k += BLOCK) {
        const Bytes r = load_bytes(plane[0] + k), g = load_bytes(plane[1] + k), u = load_bytes(plane[2] + k);
        const Bytes a = __builtin_shufflevector(r, g, 0, 16, 0, 1, 17, 0, 2, 18, 0, 3, 19, 0, 4, 20, 0, 5);
        const Bytes b = __builtin_shufflevector(r, g, 21, 0, 6, 22, 0, 7, 23, 0, 8, 24, 0, 9, 25, 0, 10, 26);
        const Bytes c = __builtin_shufflevector(r, g, 0, 11, 27, 0, 12, 28, 0, 13, 29, 0, 14, 30, 0, 15, 31, 0);
        store_bytes(codes + 3 * k, __builtin_shufflevector(a, u, 0, 1, 16, 3, 4, 17, 6, 7, 18, 9, 10, 19, 12, 13, 20, 15));
        store_bytes(codes + 3 * k + 16,
                    __builtin_shufflevector(b, u, 0, 21, 2, 3, 22, 5, 6, 23, 8, 9, 24, 11, 12, 25, 14, 15));
        store_bytes(codes + 3 * k + 32,
                    __builtin_shufflevector(c, u, 26, 1, 2, 27, 4, 5, 28, 7, 8, 29, 10, 11, 30, 13, 14, 31));
    }
    for (; k < n; ++k)
        for (int b = 0; b < BANDS; ++b) codes[3 * k + b] = plane[b][k];
}

// Target over D in light of each band.
void divided_target(const Pixels &pixels, const Frame &frame, const Segment &at, Row &light) {
    alignas(64) std::uint8_t plane[BANDS][PADDED];
    split(frame.codes + 3 * at.first, at.n, plane);
    for (int b = 0; b < BANDS; ++b) {
        const std::uint16_t *inverse = pixels.inverse.band[b] + at.first;
        const float unit = pixels.inverse.unit[b], *target = frame.target + 256 * b;
        for (int k = 0; k < at.n; ++k) light[b][k] = target[plane[b][k]] * (unpacked(inverse[k]) * unit);
    }
}

void less_offset(const Pixels &pixels, const Segment &at, Row &light) {
    for (int b = 0; b < BANDS; ++b) {
        const std::uint16_t *offset = pixels.offset.band[b] + at.first;
        const float unit = pixels.offset.unit[b];
        if (unit == 0) continue;
        for (int k = 0; k < at.n; ++k) light[b][k] -= unpacked(offset[k]) * unit;
    }
}

// The first run of a row that reaches into a segment.
inline std::int32_t run_at(const Runs &runs, std::int64_t row, std::int64_t column) {
    std::int32_t low = runs.row[row], high = runs.row[row + 1];
    while (high - low > 1) {
        const std::int32_t middle = low + (high - low) / 2;
        (runs.start[middle] <= column ? low : high) = middle;
    }
    return low;
}

// Calls work(begin, end, value) for each run of a segment, columns counted from the segment's.
template <int K, class Work>
inline void each_run(const Pixels &pixels, const Runs &runs, std::int64_t row, const Segment &at, const Work &work) {
    const std::int32_t last = runs.row[row + 1];
    int begin = 0;
    for (std::int32_t run = run_at(runs, row, at.column); begin < at.n; ++run) {
        const std::int64_t next = run + 1 < last ? runs.start[run + 1] : pixels.width;
        const int end = static_cast<int>(std::min<std::int64_t>(next - at.column, at.n));
        work(begin, end, runs.value + K * static_cast<std::int64_t>(run));
        begin = end;
    }
}

// x and y within the cells; what lies beyond the segment is set, too.
void places(const Pixels &pixels, const Segment &at, float *x, float *y) {
    const std::uint8_t *px = pixels.place_x + at.first, *py = pixels.place_y + at.first;
    for (int k = 0; k < at.n; ++k) x[k] = px[k] * (1.0f / 255);
    for (int k = 0; k < at.n; ++k) y[k] = py[k] * (1.0f / 255);
    for (int k = at.n; k < at.n + BLOCK; ++k) x[k] = y[k] = 0;
}

// Less the light that comes from all patches, bilinear in each cell.
void less_indirect(const Pixels &pixels, const Frame &frame, std::int64_t row, const Segment &at, const float *x,
                   const float *y, Row &light) {
    alignas(64) Row seen;
    each_run<4>(pixels, pixels.cells, row, at, [&](int begin, int end, const std::int32_t *corner) {
        for (int b = 0; b < BANDS; ++b) {
            const float *h = frame.irradiance + b * pixels.n_viewed;
            const float h0 = h[corner[0]], hx = h[corner[1]] - h0, hy = h[corner[2]] - h0;
            const float hxy = h[corner[3]] - h[corner[1]] - hy;
            for (int k = begin; k < end; k += BLOCK)
                for (int lane = 0; lane < BLOCK; ++lane)
                    seen[b][k + lane] = h0 + x[k + lane] * hx + y[k + lane] * (hy + x[k + lane] * hxy);
        }
    });
    for (int b = 0; b < BANDS; ++b) {
        const std::uint16_t *gain = pixels.gain.band[b] + at.first;
        const float unit = pixels.gain.unit[b];
        for (int k = 0; k < at.n; ++k) light[b][k] -= unpacked(gain[k]) * unit * seen[b][k];
    }
}

inline float lanes_sum(const float *lanes) {
    float sum[BLOCK];
    for (int lane = 0; lane < BLOCK; ++lane) sum[lane] = lanes[lane];
    for (int half = BLOCK / 2; half; half /= 2)
        for (int lane = 0; lane < half; ++lane) sum[lane] += sum[lane + half];
    return sum[0];
}

// Sums of a row's values over the pixels [begin, end).
inline float run_sum(const float *values, int begin, int end) {
    float lanes[BLOCK] = {};
    int k = begin;
    for (; k + BLOCK <= end; k += BLOCK)
        for (int lane = 0; lane < BLOCK; ++lane) lanes[lane] += values[k + lane];
    for (int lane = 0; lane < BLOCK; ++lane) lanes[lane] += k + lane < end ? values[k + lane] : 0.0f;
    return lanes_sum(lanes);
}

// emitted += emission x light, by patch.
void add_emission(const Pixels &pixels, std::int64_t row, const Segment &at, Row &light, double *emitted) {
    const std::uint16_t *emission = pixels.emission.band[0] + at.first;
    const float unit = pixels.emission.unit[0];
    for (int b = 0; b < BANDS; ++b) {
        for (int k = 0; k < at.n; ++k) light[b][k] *= unpacked(emission[k]) * unit;
        for (int k = at.n; k < at.n + BLOCK; ++k) light[b][k] = 0;
    }
    each_run<1>(pixels, pixels.patches, row, at, [&](int begin, int end, const std::int32_t *patch) {
        for (int b = 0; b < BANDS; ++b) emitted[b * pixels.n_lit + *patch] += run_sum(light[b], begin, end);
    });
}

template <class Work>
inline void each_segment(const Pixels &pixels, std::int64_t row, const Work &work) {
    for (std::int64_t column = 0; column < pixels.width; column += SEGMENT)
        work(Segment{row * pixels.width + column, column,
                     static_cast<int>(std::min<std::int64_t>(SEGMENT, pixels.width - column))});
}

// Light of the channels that gives light of the bands.
void unmix(const Frame &frame, int n, Row &light) {
    if (!frame.mixed) return;
    const auto &m = frame.unmixing;
    for (int k = 0; k < n; ++k) {
        const float r = light[0][k], g = light[1][k], u = light[2][k];
        light[0][k] = m[0][0] * r + m[0][1] * g + m[0][2] * u;
        light[1][k] = m[1][0] * r + m[1][1] * g + m[1][2] * u;
        light[2][k] = m[2][0] * r + m[2][1] * g + m[2][2] * u;
    }
}

// Codes of channels' light, clamped; counts what the range holds back of the pixels that are steered.
std::int64_t encode(const Pixels &pixels, const Frame &frame, std::int64_t row, const Segment &at, const Row &light) {
    alignas(64) std::uint8_t plane[BANDS][PADDED];
    std::int32_t clipped = 0;
    const std::uint16_t *steered = pixels.inverse.band[0] + at.first;
    for (int b = 0; b < BANDS; ++b) {
        const std::uint32_t *table = frame.response + b * RESPONSE;
        const float lower = frame.lower[b], per_span = 1 / frame.span[b];
        const std::uint8_t *dither = frame.dither + (b * DITHER + row % DITHER) * DITHER;
        const std::uint32_t first = float_as_bits(RESPONSE_TOE);
        for (int k = 0; k < at.n; ++k) {
            const float wanted = (light[b][k] - lower) * per_span;
            const float share = wanted < 0 ? 0 : wanted > 1 ? 1 : wanted;
            clipped += (steered[k] != 0) & (share != wanted);
            const std::uint32_t bits = float_as_bits(share + RESPONSE_TOE) - first;
            const std::uint32_t entry = table[bits >> RESPONSE_SHIFT];
            const std::uint32_t step = ((entry & 0xffff) * (bits & 0xffff)) >> 16;
            // Segments begin at multiples of the tile's width.
            const std::uint32_t code = ((entry >> 16) + step + dither[k % DITHER]) >> 8;
            plane[b][k] = static_cast<std::uint8_t>(steered[k] != 0 ? code : 0);
        }
    }
    join(plane, at.n, frame.out + 3 * at.first);
    return clipped;
}

}  // namespace

void sum_row(const Pixels &pixels, const Frame &frame, std::int64_t row, Sums &sums) {
    each_segment(pixels, row, [&](const Segment &at) {
        alignas(64) Row light;
        divided_target(pixels, frame, at, light);
        add_emission(pixels, row, at, light, sums.emitted);
    });
}

void code_row(const Pixels &pixels, const Frame &frame, bool bounded, std::int64_t row, Sums &sums) {
    each_segment(pixels, row, [&](const Segment &at) {
        alignas(64) Row light;
        alignas(64) float x[PADDED], y[PADDED];
        divided_target(pixels, frame, at, light);
        less_offset(pixels, at, light);
        places(pixels, at, x, y);
        less_indirect(pixels, frame, row, at, x, y, light);
        unmix(frame, at.n, light);
        (void)bounded;
        sums.clipped += encode(pixels, frame, row, at, light);
    });
}

float product_row(const float *matrix, const float *x, std::int64_t n) {
    float lanes[4 * BLOCK] = {}, rest = 0;
    std::int64_t k = 0;
    for (; k + 4 * BLOCK <= n; k += 4 * BLOCK)
        for (int lane = 0; lane < 4 * BLOCK; ++lane) lanes[lane] += matrix[k + lane] * x[k + lane];
    for (; k < n; ++k) rest += matrix[k] * x[k];
    for (int lane = 0; lane < BLOCK; ++lane)
        lanes[lane] = (lanes[lane] + lanes[lane + BLOCK]) + (lanes[lane + 2 * BLOCK] + lanes[lane + 3 * BLOCK]);
    return lanes_sum(lanes) + rest;
}

}  // namespace kernel::frame::KERNEL_LEVEL
