// Rows of a frame, sixteen pixels at a time, in segments whose intermediate rows fit the first cache. A segment goes
// through several short loops, not one long one: what a processor can look ahead then holds several blocks, not the
// latency of one. Sums run in fixed lanes: every instruction set gives the same bits. Loops over runs go by whole
// blocks; what a block writes beyond its run, the next run writes again.

#include <algorithm>

#include "frame.hpp"
#include "frame_lanes.hpp"
#include "frame_runs.hpp"

namespace kernel::frame::KERNEL_LEVEL {

namespace {

inline Light load_light(const Row &row, int k) {
    return {{load<Floats>(row[0] + k), load<Floats>(row[1] + k), load<Floats>(row[2] + k)}};
}

inline void store_light(Row &row, int k, const Light &light) {
    for (int b = 0; b < BANDS; ++b) store(row[b] + k, light.band[b]);
}

// Target over D in each band.
inline Light divided_target(const Pixels &pixels, const Frame &frame, std::int64_t first, int n) {
    const Codes codes = split(frame.codes + 3 * first, n);
    Light light;
    for (int b = 0; b < BANDS; ++b)
        light.band[b] = entries(frame.target + 256 * b, codes.channel[b]) * unpacked(pixels.inverse.band[b] + first, n);
    return light;
}

// The same, black taken off: the light of the bands that pixels ask for in all.
inline void ask(const Pixels &pixels, const Frame &frame, const Segment &at, Row &whole) {
    const float *unit = pixels.offset.unit;
    if (unit[0] == 0 && unit[1] == 0 && unit[2] == 0) {
        each_block(at.n, [&](int k, int n) { store_light(whole, k, divided_target(pixels, frame, at.first + k, n)); });
        return;
    }
    each_block(at.n, [&](int k, int n) {
        Light light = divided_target(pixels, frame, at.first + k, n);
        for (int b = 0; b < BANDS; ++b) light.band[b] -= unpacked(pixels.offset.band[b] + at.first + k, n);
        store_light(whole, k, light);
    });
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
    each_run(pixels, pixels.patches, at, [&](int begin, int end, std::int32_t patch) {
        for (int b = 0; b < BANDS; ++b) emitted[b * pixels.n_lit + patch] += run_sum(light[b], begin, end);
    });
}

// Where pixels look within their cells, in 255ths.
struct Place {
    Floats x, y;

    Place(const Pixels &pixels, std::int64_t first, int n)
        : x(read(pixels.place_x + first, n)), y(read(pixels.place_y + first, n)) {}

    static Floats read(const std::uint8_t *places, int n) {
        const Bytes bytes = load<Bytes>(places, n);
        return __builtin_convertvector(widened(bytes), Floats);
    }
};

// What irradiance pixels see: bilinear in their cells.
inline Light seen(const Pixels &pixels, const Frame &frame, const Segment &at, Cursor &cells, int k, int n) {
    const Place place(pixels, at.first + k, n);
    return cells.block(at.column + k, [&](std::int32_t cell) {
        Light light;
        for (int b = 0; b < BANDS; ++b) {
            const float *c = frame.cells + 4 * (BANDS * static_cast<std::int64_t>(cell) + b);
            const Floats along_y = fused(place.x, same(c[3]), same(c[2]));
            light.band[b] = fused(place.y, along_y, fused(place.x, same(c[1]), same(c[0])));
        }
        return light;
    });
}

// Camera value of unit irradiance over D, in each band.
inline Light gains(const Pixels &pixels, std::int64_t first, int n) {
    Light gain;
    for (int b = 0; b < BANDS; ++b)
        gain.band[b] = b && pixels.gain.band[b] == pixels.gain.band[0] ? gain.band[0]
                                                                        : unpacked(pixels.gain.band[b] + first, n);
    return gain;
}

// What is left to ask for once the light of all patches has come.
inline Light direct(const Pixels &pixels, const Frame &frame, const Segment &at, Cursor &cells, const Row &whole, int k,
                    int n) {
    const Light gain = gains(pixels, at.first + k, n), irradiance = seen(pixels, frame, at, cells, k, n);
    Light light = load_light(whole, k);
    for (int b = 0; b < BANDS; ++b) light.band[b] = fused(-gain.band[b], irradiance.band[b], light.band[b]);
    return light;
}

inline Light product(const float (&matrix)[BANDS][BANDS], bool full, const Light &light) {
    Light to;
    for (int i = 0; i < BANDS; ++i) {
        to.band[i] = matrix[i][i] * light.band[i];
        for (int j = 0; j < BANDS; ++j)
            if (full && i != j) to.band[i] = fused(same(matrix[i][j]), light.band[j], to.band[i]);
    }
    return to;
}

// Shares of the channels' spans that give light of the bands.
inline Light shares_of(const Frame &frame, const Light &light) { return product(frame.channels, frame.mixed, light); }

inline Light light_of(const Frame &frame, const Light &shares) { return product(frame.light, frame.mixed, shares); }

inline Light within_span(const Light &shares) {
    return {{within_unit(shares.band[0]), within_unit(shares.band[1]), within_unit(shares.band[2])}};
}

// 1 over each, with one division.
inline Light reciprocals(const Floats (&x)[BANDS]) {
    const Floats first = x[0] * x[1], all = 1 / (first * x[2]);
    return {{all * x[1] * x[2], all * x[0] * x[2], all * first}};
}

// Squared camera values of a pixel's light, of squared 1 / D.
inline Light camera_weights(const Frame &frame, const Light &squared_inverse) {
    // Products of six stay within single precision.
    constexpr float LEAST = 1.0f / (1 << 18);
    Floats safe[BANDS];
    for (int b = 0; b < BANDS; ++b)
        safe[b] = squared_inverse.band[b] < LEAST * LEAST ? same(1) : squared_inverse.band[b];
    Light weights = reciprocals(safe);
    for (int b = 0; b < BANDS; ++b)
        weights.band[b] = squared_inverse.band[b] > 0 ? weights.band[b] * frame.weight[b] : Floats{};
    return weights;
}

// What pixels ask for, what they would choose if nothing held them back, and what it counts for.
struct Free {
    alignas(64) Row wanted, light, weight;

    Free(const Pixels &pixels, const Frame &frame, const Segment &at, Cursor &cells, Cursor &patches,
         const Row &whole) {
        each_block(at.n, [&](int k, int n) {
            const Floats emission = unpacked(pixels.emission.band[0] + at.first + k, n);
            const Light pull = patches.block(at.column + k, [&](std::int32_t patch) {
                const float *p = frame.pull + patch;
                return Light{{same(p[0]), same(p[pixels.n_lit]), same(p[2 * pixels.n_lit])}};
            });
            const Light asked = direct(pixels, frame, at, cells, whole, k, n);
            Light free, squared_inverse;
            for (int b = 0; b < BANDS; ++b) {
                const Floats inverse = unpacked(pixels.inverse.band[b] + at.first + k, n);
                squared_inverse.band[b] = inverse * inverse;
                free.band[b] = fused(-(emission * squared_inverse.band[b]), pull.band[b], asked.band[b]);
            }
            store_light(wanted, k, asked);
            store_light(light, k, free);
            store_light(weight, k, camera_weights(frame, squared_inverse));
        });
    }
};

// Shares of the channels' spans whose mixture comes nearest to that of the shares asked for, in camera values, by
// coordinates: each round leaves about the square of the share that two channels have in common.
inline Light nearest(const Frame &frame, const Light &asked, const Light &weight) {
    constexpr float LEAST = 1e-12f;
    Light shares = within_span(asked);
    if (!frame.mixed) return shares;
    Floats common[BANDS][BANDS], own[BANDS];
    for (int c = 0; c < BANDS; ++c)
        for (int d = 0; d <= c; ++d) {
            Floats sum = same(c == d ? LEAST : 0);
            for (int b = 0; b < BANDS; ++b)
                sum = fused(weight.band[b], same(frame.light[b][c] * frame.light[b][d]), sum);
            (c == d ? own[c] : common[c][d]) = sum;
        }
    const Light per_own = reciprocals(own);
    for (int round = 0; round < frame.rounds; ++round)
        for (int c = 0; c < BANDS; ++c) {
            Floats others{};
            for (int d = 0; d < BANDS; ++d)
                if (d != c) others = fused(common[std::max(c, d)][std::min(c, d)], asked.band[d] - shares.band[d], others);
            shares.band[c] = within_unit(fused(others, per_own.band[c], asked.band[c]));
        }
    return shares;
}

// returned += light as seen by each cell's corners.
inline void add_by_cell(const Pixels &pixels, const Segment &at, const Row &light, double *returned) {
    each_run(pixels, pixels.cells, at, [&](int begin, int end, std::int32_t cell) {
        const std::int32_t *corner = pixels.corners + 4 * static_cast<std::int64_t>(cell);
        Floats sum[BANDS]{}, along_x[BANDS]{}, along_y[BANDS]{}, along_both[BANDS]{};
        for (int k = begin; k < end; k += BLOCK) {
            const Place place(pixels, at.first + k, std::min(at.n - k, BLOCK));
            for (int b = 0; b < BANDS; ++b) {
                const Floats value = k + lane_numbers() < end ? load<Floats>(light[b] + k) : Floats{};
                const Floats by_x = value * place.x;
                sum[b] += value;
                along_x[b] += by_x;
                along_y[b] = fused(value, place.y, along_y[b]);
                along_both[b] = fused(by_x, place.y, along_both[b]);
            }
        }
        for (int b = 0; b < BANDS; ++b) {
            const Four sums = lanes_sums(sum[b], along_x[b], along_y[b], along_both[b]);
            const float all = sums[0], x = sums[1] / 255, y = sums[2] / 255, xy = sums[3] / (255 * 255);
            double *to = returned + b * pixels.n_viewed;
            to[corner[0]] += all - x - y + xy;
            to[corner[1]] += x - xy;
            to[corner[2]] += y - xy;
            to[corner[3]] += xy;
        }
    });
}

inline Ints beyond(const Light &asked, const Light &within) {
    return -((asked.band[0] != within.band[0]) + (asked.band[1] != within.band[1]) + (asked.band[2] != within.band[2]));
}

// Codes of shares of the channels' spans.
inline void encode(const Frame &frame, const Light &shares, const Segment &at, int k, int n) {
    constexpr std::uint32_t TOE_BITS = 0x38800000;
    Codes codes;
    const std::uint8_t *dither = frame.dither + (at.row & (DITHER - 1)) * DITHER + ((at.column + k) & (DITHER - 1));
    for (int c = 0; c < BANDS; ++c) {
        const Words bits = same_bits<Words>(shares.band[c] + RESPONSE_TOE) - TOE_BITS;
        const Ints index = same_bits<Ints>(bits >> RESPONSE_SHIFT);
        const Words entry = same_bits<Words>(entries(frame.response[c], index));
        const Words step = high_product(entry, bits & 0xffff);
        const Words rounding = same_bits<Words>(widened(load<Bytes>(dither + c * DITHER * DITHER)));
        codes.channel[c] = same_bits<Ints>(((entry >> 16) + step + rounding) >> 8);
    }
    join(codes, n, frame.out + 3 * (at.first + k));
}

// Shares of the channels' spans that give what is asked for, within the spans.
inline Ints share_exactly(const Pixels &pixels, const Frame &frame, const Segment &at, Cursor &cells, const Row &whole,
                          Row &shares) {
    Ints clipped{};
    each_block(at.n, [&](int k, int n) {
        const Light asked = shares_of(frame, direct(pixels, frame, at, cells, whole, k, n));
        const Light within = within_span(asked);
        clipped += beyond(asked, within);
        store_light(shares, k, within);
    });
    return clipped;
}

// Shares of the channels' spans that the bounded optimum's conditions choose.
inline Ints share_nearest(const Frame &frame, const Segment &at, const Free &free, Row &shares) {
    Ints clipped{};
    each_block(at.n, [&](int k, int) {
        const Light asked = shares_of(frame, load_light(free.light, k));
        clipped += beyond(asked, within_span(asked));
        store_light(shares, k, nearest(frame, asked, load_light(free.weight, k)));
    });
    return clipped;
}

}  // namespace

void sum_row(const Pixels &pixels, const Frame &frame, std::int64_t row, Sums &sums) {
    each_segment(pixels, row, [&](const Segment &at) {
        alignas(64) Row light;
        each_block(at.n, [&](int k, int n) {
            const Light target = divided_target(pixels, frame, at.first + k, n);
            const Floats emission = unpacked(pixels.emission.band[0] + at.first + k, n);
            for (int b = 0; b < BANDS; ++b) store(light[b] + k, target.band[b] * emission);
        });
        add_by_patch(pixels, at, light, sums.emitted);
    });
}

void code_row(const Pixels &all, const Frame &whole_frame, bool bounded, std::int64_t row, Sums &sums) {
    Ints clipped{};
    Cursor cells(all.cells, row, all.width), patches(all.patches, row, all.width);
    each_segment(all, row, [&](const Segment &given) {
        // Own copies: the codes' bytes may be anything's, and all would be read again after each of them.
        const Segment at = given;
        const Pixels pixels = all;
        const Frame frame = whole_frame;
        alignas(64) Row whole, shares;
        ask(pixels, frame, at, whole);
        if (bounded)
            clipped += share_nearest(frame, at, Free(pixels, frame, at, cells, patches, whole), shares);
        else
            clipped += share_exactly(pixels, frame, at, cells, whole, shares);
        each_block(at.n, [&](int k, int n) { encode(frame, load_light(shares, k), at, k, n); });
    });
    for (int lane = 0; lane < BLOCK; ++lane) sums.clipped += clipped[lane];
}

void step_row(const Pixels &pixels, const Frame &frame, std::int64_t row, Sums &sums) {
    Cursor cells(pixels.cells, row, pixels.width), patches(pixels.patches, row, pixels.width);
    each_segment(pixels, row, [&](const Segment &at) {
        alignas(64) Row whole, emitted, returned;
        Floats squared{};
        ask(pixels, frame, at, whole);
        const Free free(pixels, frame, at, cells, patches, whole);
        each_block(at.n, [&](int k, int n) {
            const Light light = load_light(free.light, k), weight = load_light(free.weight, k);
            const Light q = light_of(frame, nearest(frame, shares_of(frame, light), weight));
            const Light gain = gains(pixels, at.first + k, n);
            const Floats emission = unpacked(pixels.emission.band[0] + at.first + k, n);
            for (int b = 0; b < BANDS; ++b) {
                const Floats delta = q.band[b] - light.band[b];
                const Floats error = q.band[b] - load<Floats>(free.wanted[b] + k);
                store(emitted[b] + k, emission * (load<Floats>(whole[b] + k) + delta));
                store(returned[b] + k, gain.band[b] * weight.band[b] * delta);
                squared = fused(error * error, weight.band[b], squared);
            }
        });
        add_by_patch(pixels, at, emitted, sums.emitted);
        add_by_cell(pixels, at, returned, sums.returned);
        sums.squared += lanes_sum(squared);
    });
}

}  // namespace kernel::frame::KERNEL_LEVEL
