// Rows of a frame, sixteen pixels at a time, in segments that fit the first cache. Sums run in fixed lanes: every
// instruction set gives the same bits. Loops over runs go by whole blocks; what a block writes beyond its run, the
// next run writes again.
#include <algorithm>
#include <limits>

#include "frame.hpp"
#include "frame_lanes.hpp"

namespace kernel::frame::KERNEL_LEVEL {

namespace {

constexpr int PADDED = SEGMENT + BLOCK;
using Row = float[BANDS][PADDED];

// Pixels [first, first + n) of the picture.
struct Segment {
    std::int64_t first, row, column;
    int n;
};

template <class Work>
inline void each_segment(const Pixels &pixels, std::int64_t row, const Work &work) {
    for (std::int64_t column = 0; column < pixels.width; column += SEGMENT)
        work(Segment{row * pixels.width + column, row, column,
                     static_cast<int>(std::min<std::int64_t>(SEGMENT, pixels.width - column))});
}

// Calls work(k, number of pixels) for each block of a segment; the number is a constant but for the last.
template <class Work>
inline void each_block(int n, const Work &work) {
    int k = 0;
    for (; k + BLOCK <= n; k += BLOCK) work(k, BLOCK);
    if (k < n) work(k, n - k);
}

// The first run of a row that reaches into a segment.
inline std::int32_t run_at(const Runs &runs, const Segment &at) {
    std::int32_t low = runs.row[at.row], high = runs.row[at.row + 1];
    while (high - low > 1) {
        const std::int32_t middle = low + (high - low) / 2;
        (runs.start[middle] <= at.column ? low : high) = middle;
    }
    return low;
}

// Calls work(begin, end, value) for each run of a segment, columns counted from the segment's.
template <int K, class Work>
inline void each_run(const Pixels &pixels, const Runs &runs, const Segment &at, const Work &work) {
    const std::int32_t last = runs.row[at.row + 1];
    int begin = 0;
    for (std::int32_t run = run_at(runs, at); begin < at.n; ++run) {
        const std::int64_t next = run + 1 < last ? runs.start[run + 1] : pixels.width;
        const int end = static_cast<int>(std::min<std::int64_t>(next - at.column, at.n));
        work(begin, end, runs.value + K * static_cast<std::int64_t>(run));
        begin = end;
    }
}

struct Light {
    Floats band[BANDS];
};

// Target over D in each band.
inline Light divided_target(const Pixels &pixels, const Frame &frame, std::int64_t first, int n) {
    const Codes codes = split(frame.codes + 3 * first, n);
    Light light;
    for (int b = 0; b < BANDS; ++b)
        light.band[b] = entries(frame.target + 256 * b, codes.channel[b]) * unpacked(pixels.inverse.band[b] + first, n);
    return light;
}

inline float run_sum(const float *values, int begin, int end) {
    Floats lanes{};
    int k = begin;
    for (; k + BLOCK <= end; k += BLOCK) lanes += load<Floats>(values + k);
    const Floats rest = load<Floats>(values + k);
    lanes += k + lane_numbers() < end ? rest : Floats{};
    return lanes_sum(lanes);
}

// emitted += light, by patch.
inline void add_by_patch(const Pixels &pixels, const Segment &at, const Row &light, double *emitted) {
    each_run<1>(pixels, pixels.patches, at, [&](int begin, int end, const std::int32_t *patch) {
        for (int b = 0; b < BANDS; ++b) emitted[b * pixels.n_lit + *patch] += run_sum(light[b], begin, end);
    });
}

// Where pixels look within their cells, and what irradiance they see there: bilinear.
struct Seen {
    alignas(64) float x[PADDED], y[PADDED];
    alignas(64) Row irradiance;

    Seen(const Pixels &pixels, const Frame &frame, const Segment &at) {
        each_block(at.n, [&](int k, int n) {
            for (auto [from, to] : {std::pair{pixels.place_x, x}, std::pair{pixels.place_y, y}}) {
                const Bytes bytes = load<Bytes>(from + at.first + k, n);
                store(to + k, __builtin_convertvector(widened(bytes), Floats) * (1.0f / 255));
            }
        });
        store(x + at.n, Floats{}), store(y + at.n, Floats{});
        each_run<4>(pixels, pixels.cells, at, [&](int begin, int end, const std::int32_t *corner) {
            for (int b = 0; b < BANDS; ++b) {
                const float *h = frame.irradiance + b * pixels.n_viewed;
                const float h0 = h[corner[0]], hx = h[corner[1]] - h0, hy = h[corner[2]] - h0;
                const float hxy = h[corner[3]] - h[corner[1]] - hy;
                for (int k = begin; k < end; k += BLOCK) {
                    const Floats px = load<Floats>(x + k), py = load<Floats>(y + k);
                    store(irradiance[b] + k, h0 + px * hx + py * (hy + px * hxy));
                }
            }
        });
    }
};

// Light of the bands that a pixel asks for: whole, and what is left once that of all patches has come.
struct Asked {
    Light whole, direct;
};

inline Asked asked(const Pixels &pixels, const Frame &frame, const Seen &seen, std::int64_t first, int k, int n) {
    Asked light{divided_target(pixels, frame, first + k, n), {}};
    Floats gain = unpacked(pixels.gain.band[0] + first + k, n);
    for (int b = 0; b < BANDS; ++b) {
        if (pixels.offset.unit[b] != 0)
            light.whole.band[b] -= unpacked(pixels.offset.band[b] + first + k, n) * pixels.offset.unit[b];
        if (b && pixels.gain.band[b] != pixels.gain.band[0]) gain = unpacked(pixels.gain.band[b] + first + k, n);
        light.direct.band[b] = light.whole.band[b] - gain * pixels.gain.unit[b] * load<Floats>(seen.irradiance[b] + k);
    }
    return light;
}

// Light of the channels that gives light of the bands.
inline Light unmixed(const Frame &frame, const Light &light) {
    if (!frame.mixed) return light;
    Light channels;
    for (int c = 0; c < BANDS; ++c)
        channels.band[c] = frame.unmixing[c][0] * light.band[0] + frame.unmixing[c][1] * light.band[1] +
                           frame.unmixing[c][2] * light.band[2];
    return channels;
}

inline Light mixed(const Frame &frame, const Light &channels) {
    if (!frame.mixed) return channels;
    Light light;
    for (int b = 0; b < BANDS; ++b)
        light.band[b] = frame.mixing[b][0] * channels.band[0] + frame.mixing[b][1] * channels.band[1] +
                        frame.mixing[b][2] * channels.band[2];
    return light;
}

// What a pixel's light counts for: emission of its patch, 1 / D and D.
struct Weights {
    Floats emission, inverse[BANDS], direct[BANDS];

    Weights(const Pixels &pixels, std::int64_t first, int n)
        : emission(unpacked(pixels.emission.band[0] + first, n) * pixels.emission.unit[0]) {
        for (int b = 0; b < BANDS; ++b) {
            inverse[b] = unpacked(pixels.inverse.band[b] + first, n) * pixels.inverse.unit[b];
            direct[b] = inverse[b] > 0 ? 1 / inverse[b] : Floats{};
        }
    }
};

// By how much the errors elsewhere pull at the light of each patch's pixels.
struct Pull {
    alignas(64) Row adjoint;

    Pull(const Pixels &pixels, const Frame &frame, const Segment &at, bool bounded) {
        if (!bounded) return;
        each_run<1>(pixels, pixels.patches, at, [&](int begin, int end, const std::int32_t *patch) {
            for (int b = 0; b < BANDS; ++b) {
                const Floats same = Floats{} + frame.adjoint[b * pixels.n_lit + *patch];
                for (int k = begin; k < end; k += BLOCK) store(adjoint[b] + k, same);
            }
        });
    }
};

inline Light pulled(const Light &direct, const Weights &weights, const Pull &pull, int k) {
    Light light;
    for (int b = 0; b < BANDS; ++b)
        light.band[b] = direct.band[b] - weights.emission * weights.inverse[b] * weights.inverse[b] *
                                             load<Floats>(pull.adjoint[b] + k);
    return light;
}

// The channels' light within the span whose mixture comes nearest in camera values, by coordinates: each round leaves
// about the square of the share that two channels have in common.
inline Light chosen(const Frame &frame, const Light &free, const Weights &weights) {
    const Light asked = unmixed(frame, free);
    Light channels;
    for (int c = 0; c < BANDS; ++c)
        channels.band[c] = within_unit(asked.band[c] * frame.per_span[c]) * frame.span[c];
    if (!frame.mixed) return channels;
    const Light now = mixed(frame, channels);
    Floats error[BANDS], share[BANDS][BANDS], per_curvature[BANDS];
    for (int b = 0; b < BANDS; ++b) error[b] = now.band[b] - free.band[b];
    for (int c = 0; c < BANDS; ++c) {
        Floats curvature = Floats{} + std::numeric_limits<float>::min();
        for (int b = 0; b < BANDS; ++b) {
            share[c][b] = weights.direct[b] * weights.direct[b] * frame.mixing[b][c];
            curvature += share[c][b] * frame.mixing[b][c];
        }
        per_curvature[c] = 1 / curvature;
    }
    for (int round = 0; round < frame.rounds; ++round)
        for (int c = 0; c < BANDS; ++c) {
            const Floats slope = share[c][0] * error[0] + share[c][1] * error[1] + share[c][2] * error[2];
            const Floats best = (channels.band[c] - slope * per_curvature[c]) * frame.per_span[c];
            const Floats next = within_unit(best) * frame.span[c], change = next - channels.band[c];
            for (int b = 0; b < BANDS; ++b) error[b] += frame.mixing[b][c] * change;
            channels.band[c] = next;
        }
    return channels;
}

// returned += light as seen by each cell's corners.
inline void add_by_cell(const Pixels &pixels, const Segment &at, const Seen &seen, const Row &light, double *returned) {
    each_run<4>(pixels, pixels.cells, at, [&](int begin, int end, const std::int32_t *corner) {
        for (int b = 0; b < BANDS; ++b) {
            Floats sum{}, along_x{}, along_y{}, along_both{};
            for (int k = begin; k < end; k += BLOCK) {
                const Floats value = k + lane_numbers() < end ? load<Floats>(light[b] + k) : Floats{};
                const Floats x = load<Floats>(seen.x + k), y = load<Floats>(seen.y + k);
                sum += value;
                along_x += value * x;
                along_y += value * y;
                along_both += value * x * y;
            }
            const float all = lanes_sum(sum), x = lanes_sum(along_x), y = lanes_sum(along_y), xy = lanes_sum(along_both);
            double *to = returned + b * pixels.n_viewed;
            to[corner[0]] += all - x - y + xy;
            to[corner[1]] += x - xy;
            to[corner[2]] += y - xy;
            to[corner[3]] += xy;
        }
    });
}

inline void count_beyond(const Frame &frame, const Light &channels, Ints &count) {
    for (int c = 0; c < BANDS; ++c) count -= (channels.band[c] < 0) | (channels.band[c] > frame.span[c]);
}

// Codes of channels' light, clamped.
inline void encode(const Frame &frame, const Light &light, std::int64_t row, std::int64_t column, std::int64_t first,
                   int n) {
    constexpr std::uint32_t TOE_BITS = 0x38800000;
    Codes codes;
    const std::uint8_t *dither = frame.dither + row % DITHER * DITHER + column % DITHER;
    for (int c = 0; c < BANDS; ++c) {
        const Floats share = within_unit(light.band[c] * frame.per_span[c]);
        const Words bits = same_bits<Words>(share + RESPONSE_TOE) - TOE_BITS;
        const Ints index = same_bits<Ints>(bits >> RESPONSE_SHIFT);
        const Words entry = same_bits<Words>(entries(frame.response + c * RESPONSE, index));
        const Words step = ((entry & 0xffff) * (bits & 0xffff)) >> 16;
        const Words rounding = same_bits<Words>(widened(load<Bytes>(dither + c * DITHER * DITHER)));
        codes.channel[c] = same_bits<Ints>(((entry >> 16) + step + rounding) >> 8);
    }
    join(codes, n, frame.out + 3 * first);
}

}  // namespace

void sum_row(const Pixels &pixels, const Frame &frame, std::int64_t row, Sums &sums) {
    each_segment(pixels, row, [&](const Segment &at) {
        alignas(64) Row light;
        each_block(at.n, [&](int k, int n) {
            const Light target = divided_target(pixels, frame, at.first + k, n);
            const Floats emission = unpacked(pixels.emission.band[0] + at.first + k, n) * pixels.emission.unit[0];
            for (int b = 0; b < BANDS; ++b) store(light[b] + k, target.band[b] * emission);
        });
        add_by_patch(pixels, at, light, sums.emitted);
    });
}

void code_row(const Pixels &all, const Frame &whole, bool bounded, std::int64_t row, Sums &sums) {
    Ints clipped{};
    each_segment(all, row, [&](const Segment &at) {
        // Own copies: the codes' bytes may be anything's, and all would be read again after each of them.
        const Pixels pixels = all;
        const Frame frame = whole;
        const Seen seen(pixels, frame, at);
        const Pull pull(pixels, frame, at, bounded);
        each_block(at.n, [&](int k, int n) {
            Light light = asked(pixels, frame, seen, at.first, k, n).direct;
            if (bounded) {
                const Weights weights(pixels, at.first + k, n);
                const Light free = pulled(light, weights, pull, k);
                count_beyond(frame, unmixed(frame, free), clipped);
                light = chosen(frame, free, weights);
            } else {
                light = unmixed(frame, light);
                count_beyond(frame, light, clipped);
            }
            encode(frame, light, row, at.column + k, at.first + k, n);
        });
    });
    for (int lane = 0; lane < BLOCK; ++lane) sums.clipped += clipped[lane];
}

void step_row(const Pixels &pixels, const Frame &frame, std::int64_t row, Sums &sums) {
    each_segment(pixels, row, [&](const Segment &at) {
        const Seen seen(pixels, frame, at);
        const Pull pull(pixels, frame, at, true);
        alignas(64) Row emitted, returned;
        Floats squared{};
        each_block(at.n, [&](int k, int n) {
            const Asked light = asked(pixels, frame, seen, at.first, k, n);
            const Weights weights(pixels, at.first + k, n);
            const Light free = pulled(light.direct, weights, pull, k);
            const Light q = mixed(frame, chosen(frame, free, weights));
            for (int b = 0; b < BANDS; ++b) {
                const Floats delta = q.band[b] - free.band[b], direct = weights.direct[b];
                const Floats gain = unpacked(pixels.gain.band[b] + at.first + k, n) * pixels.gain.unit[b];
                const Floats error = (q.band[b] - light.direct.band[b]) * direct;
                store(emitted[b] + k, weights.emission * (light.whole.band[b] + delta));
                store(returned[b] + k, gain * direct * direct * delta);
                squared += error * error;
            }
        });
        add_by_patch(pixels, at, emitted, sums.emitted);
        add_by_cell(pixels, at, seen, returned, sums.returned);
        sums.squared += lanes_sum(squared);
    });
}

void product_columns(const float *matrix, const float *x, std::int64_t rows, std::int64_t columns, std::int64_t begin,
                     std::int64_t end, float *out) {
    for (std::int64_t column = begin; column < end; ++column) out[column] = 0;
    for (std::int64_t row = 0; row < rows; ++row) {
        const float *values = matrix + row * columns, factor = x[row];
        for (std::int64_t column = begin; column < end; ++column) out[column] += values[column] * factor;
    }
}

float product_row(const float *matrix, const float *x, std::int64_t n) {
    Floats a{}, b{}, c{}, d{};
    float rest = 0;
    std::int64_t k = 0;
    for (; k + 4 * BLOCK <= n; k += 4 * BLOCK) {
        a += load<Floats>(matrix + k) * load<Floats>(x + k);
        b += load<Floats>(matrix + k + BLOCK) * load<Floats>(x + k + BLOCK);
        c += load<Floats>(matrix + k + 2 * BLOCK) * load<Floats>(x + k + 2 * BLOCK);
        d += load<Floats>(matrix + k + 3 * BLOCK) * load<Floats>(x + k + 3 * BLOCK);
    }
    for (; k < n; ++k) rest += matrix[k] * x[k];
    return lanes_sum((a + b) + (c + d)) + rest;
}

}  // namespace kernel::frame::KERNEL_LEVEL
