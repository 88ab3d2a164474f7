// Rows of a frame, sixteen pixels at a time, in segments whose intermediate rows fit the first cache. A segment goes
// through several short loops, not one long one: what a processor can look ahead then holds several blocks, not the
// latency of one. Sums run in fixed lanes: every instruction set gives the same bits.

#include <algorithm>
#include <numeric>

#include "frame/frame.hpp"
#include "simd/frame_codes.hpp"
#include "simd/frame_lanes.hpp"
#include "simd/frame_runs.hpp"

namespace kernel::frame::KERNEL_INSTRUCTION_SET {

namespace {

inline Light load_light(const Row &row, int k) {
    return {{load(row[0] + k), load(row[1] + k), load(row[2] + k)}};
}

inline void store_light(Row &row, int k, const Light &light) {
    for (int b = 0; b < BANDS; ++b) store(row[b] + k, light.band[b]);
}

// Target over D in each band, black taken off: the light of the bands that pixels ask for in all.
inline void ask(const Pixels &pixels, const Frame &frame, const Segment &at, Row &whole) {
    targets(frame, at.first, at.n, whole);
    const bool black = frame.offset[0] != 0 || frame.offset[1] != 0 || frame.offset[2] != 0;
    each_block(at.n, [&](int k, int n) {
        for (int b = 0; b < BANDS; ++b) {
            Floats light = load(whole[b] + k) * packed(pixels.inverse.band[b] + at.first + k, n);
            if (black)
                light = fused(packed(pixels.offset.band[b] + at.first + k, n), same(frame.offset[b]), light);
            store(whole[b] + k, light);
        }
    });
}

// Sums of the bands over a run, one in each of the first three lanes.
inline Four run_sums(const Row &light, int begin, int end) {
    Floats sums[BANDS];
    const int whole = (end - begin) / BLOCK * BLOCK;
    for (int b = 0; b < BANDS; ++b) sums[b] = first_lanes(end - begin - whole, load(light[b] + begin + whole), Floats{});
    for (int k = begin; k < begin + whole; k += BLOCK)
        for (int b = 0; b < BANDS; ++b) sums[b] += load(light[b] + k);
    return lanes_sums(sums[0], sums[1], sums[2], Floats{});
}

// emitted += light, by patch.
inline void add_by_patch(const Pixels &pixels, const Segment &at, const Row &light, double *emitted) {
    each_run(pixels, pixels.patches, at, [&](int begin, int end, std::int32_t patch) {
        add_four(emitted + SUM_LANES * static_cast<std::int64_t>(patch), run_sums(light, begin, end));
    });
}

// Where pixels look within their cells, in 255ths.
struct Place {
    Floats x, y;

    Place(const Pixels &pixels, std::int64_t first, int n)
        : x(read(pixels.place_x + first, n)), y(read(pixels.place_y + first, n)) {}

    static Floats read(const std::uint8_t *places, int n) { return to_floats(widened(places, n)); }
};

// What irradiance pixels see, negative: bilinear in their cells.
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

// Camera value of unit irradiance over D, in each band, packed.
inline Light gains(const Pixels &pixels, std::int64_t first, int n) {
    Light gain;
    for (int b = 0; b < BANDS; ++b)
        gain.band[b] = b && pixels.gain.band[b] == pixels.gain.band[0] ? gain.band[0]
                                                                        : packed(pixels.gain.band[b] + first, n);
    return gain;
}

// What is left to ask for once the light of all patches has come.
inline Light direct(const Pixels &pixels, const Frame &frame, const Segment &at, Cursor &cells, const Row &whole, int k,
                    int n) {
    const Light gain = gains(pixels, at.first + k, n), irradiance = seen(pixels, frame, at, cells, k, n);
    Light light = load_light(whole, k);
    for (int b = 0; b < BANDS; ++b) light.band[b] = fused(gain.band[b], irradiance.band[b], light.band[b]);
    return light;
}

// The matrix times light, plus a number.
inline Light product(const float (&matrix)[BANDS][BANDS], bool full, const Light &light, float plus) {
    Light to;
    for (int i = 0; i < BANDS; ++i) {
        to.band[i] = fused(same(matrix[i][i]), light.band[i], same(plus));
        for (int j = 0; j < BANDS; ++j)
            if (full && i != j) to.band[i] = fused(same(matrix[i][j]), light.band[j], to.band[i]);
    }
    return to;
}

// Shares of the channels' spans that give light of the bands, plus a number.
inline Light shares_of(const Frame &frame, const Light &light, float plus = 0) {
    return product(frame.channels, frame.mixed, light, plus);
}

inline Light light_of(const Frame &frame, const Light &shares) {
    return product(frame.light, frame.mixed, shares, 0);
}

// Shares within the spans, all of them plus a number.
inline Light within_span(const Light &shares, float plus = 0) {
    Light held;
    for (int c = 0; c < BANDS; ++c) held.band[c] = within(shares.band[c], plus, 1 + plus);
    return held;
}

inline Words counted(const Words &count, const Light &shares, const Light &held) {
    Words more = count;
    for (int c = 0; c < BANDS; ++c) more = counted(more, shares.band[c], held.band[c]);
    return more;
}

// Squared camera values of a pixel's light, of squared 1 / D.
inline Light camera_weights(const Frame &frame, const Light &squared_inverse) {
    Light weights;
    for (int b = 0; b < BANDS; ++b) {
        const Floats weight = reciprocal(squared_inverse.band[b]) * same(frame.weight[b]);
        weights.band[b] = where_positive(squared_inverse.band[b], weight);
    }
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
                free.band[b] = less(emission * squared_inverse.band[b], pull.band[b], asked.band[b]);
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
            Floats sum = same(c == d ? LEAST : 0.0f);
            for (int b = 0; b < BANDS; ++b) sum = fused(weight.band[b], same(frame.common[c][d][b]), sum);
            (c == d ? own[c] : common[c][d]) = sum;
        }
    for (Floats &each : own) each = reciprocal(each);
    for (int round = 0; round < frame.rounds; ++round)
        for (int c = 0; c < BANDS; ++c) {
            Floats others{};
            for (int d = 0; d < BANDS; ++d) {
                if (d == c) continue;
                const Floats held_back = asked.band[d] - shares.band[d];
                others = fused(common[std::max(c, d)][std::min(c, d)], held_back, others);
            }
            shares.band[c] = within(fused(others, own[c], asked.band[c]), 0, 1);
        }
    return shares;
}

// Sums over a run of light, and of it times x, times y and times both.
struct CellSums {
    Floats plain[BANDS], by_x[BANDS], by_y[BANDS], by_both[BANDS];

    CellSums(const Light &light, const Floats &x, const Floats &y) {
        for (int b = 0; b < BANDS; ++b) {
            plain[b] = light.band[b];
            by_x[b] = light.band[b] * x;
            by_y[b] = light.band[b] * y;
            by_both[b] = by_x[b] * y;
        }
    }

    void add(const Light &light, const Floats &x, const Floats &y) {
        for (int b = 0; b < BANDS; ++b) {
            const Floats along_x = light.band[b] * x;
            plain[b] += light.band[b];
            by_x[b] += along_x;
            by_y[b] = fused(light.band[b], y, by_y[b]);
            by_both[b] = fused(along_x, y, by_both[b]);
        }
    }
};

// returned += light as seen by each cell's corners.
inline void add_by_cell(const Pixels &pixels, const Segment &at, const Row &light, double *returned) {
    alignas(64) float x[PADDED]{}, y[PADDED]{};  // what lies beyond a run must be a number
    each_block(at.n, [&](int k, int n) {
        const Place place(pixels, at.first + k, n);
        store(x + k, place.x), store(y + k, place.y);
    });
    each_run(pixels, pixels.cells, at, [&](int begin, int end, std::int32_t cell) {
        const int rest = begin + (end - begin) / BLOCK * BLOCK;
        Light last = load_light(light, rest);
        for (Floats &values : last.band) values = first_lanes(end - rest, values, Floats{});
        CellSums sums(last, load(x + rest), load(y + rest));
        for (int k = begin; k < rest; k += BLOCK) sums.add(load_light(light, k), load(x + k), load(y + k));
        const FourSums four = lanes_sums(sums.plain, sums.by_x, sums.by_y, sums.by_both);
        constexpr float STEP = 1.0f / 255;
        const Four along_x = four.of[1] * STEP, along_y = four.of[2] * STEP, both = four.of[3] * (STEP * STEP);
        const std::int32_t *corner = pixels.corners + 4 * static_cast<std::int64_t>(cell);
        const auto add_to = [&](int k, const Four &sum) {
            add_four(returned + SUM_LANES * static_cast<std::int64_t>(corner[k]), sum);
        };
        add_to(0, four.of[0] - along_x - along_y + both);
        add_to(1, along_x - both);
        if (corner[2] == corner[3]) return add_to(2, along_y);  // a triangle: all cells of a mesh
        add_to(2, along_y - both);
        add_to(3, both);
    });
}

// Shares of the channels' spans that give what is asked for, within the spans, RESPONSE_TOE added.
inline Words share_exactly(const Pixels &pixels, const Frame &frame, const Segment &at, Cursor &cells, const Row &whole,
                          Row &shares) {
    Words clipped{};
    each_block(at.n, [&](int k, int n) {
        const Light asked = shares_of(frame, direct(pixels, frame, at, cells, whole, k, n), RESPONSE_TOE);
        const Light held = within_span(asked, RESPONSE_TOE);
        clipped = counted(clipped, asked, held);
        store_light(shares, k, held);
    });
    return clipped;
}

// Shares of the channels' spans that the bounded optimum's conditions choose, RESPONSE_TOE added.
inline Words share_nearest(const Frame &frame, const Segment &at, const Free &free, Row &shares) {
    Words clipped{};
    each_block(at.n, [&](int k, int) {
        const Light asked = shares_of(frame, load_light(free.light, k));
        clipped = counted(clipped, asked, within_span(asked));
        Light chosen = nearest(frame, asked, load_light(free.weight, k));
        for (Floats &share : chosen.band) share += same(RESPONSE_TOE);
        store_light(shares, k, chosen);
    });
    return clipped;
}

}  // namespace

void sum_row(const Pixels &pixels, const Frame &frame, std::int64_t row, Sums &sums) {
    each_segment(pixels, row, [&](const Segment &at) {
        alignas(64) Row light;
        targets(frame, at.first, at.n, light);
        each_block(at.n, [&](int k, int n) {
            const Floats emission = unpacked(pixels.emission.band[0] + at.first + k, n);
            for (int b = 0; b < BANDS; ++b)
                store(light[b] + k,
                      load(light[b] + k) * packed(pixels.inverse.band[b] + at.first + k, n) * emission);
        });
        add_by_patch(pixels, at, light, sums.emitted);
    });
}

std::int64_t code_row(const Pixels &all, const Frame &whole_frame, bool bounded, std::int64_t row) {
    Words clipped{};
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
        encode(frame, shares, at);
    });
    std::uint32_t by_lane[BLOCK];
    store(by_lane, clipped);
    return std::accumulate(by_lane, by_lane + BLOCK, std::int64_t{0});
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
                const Floats error = q.band[b] - load(free.wanted[b] + k);
                store(emitted[b] + k, emission * (load(whole[b] + k) + delta));
                store(returned[b] + k, gain.band[b] * weight.band[b] * delta);
                squared = fused(error * error, weight.band[b], squared);
            }
        });
        add_by_patch(pixels, at, emitted, sums.emitted);
        add_by_cell(pixels, at, returned, sums.returned);
        sums.squared += lanes_sum(squared);
    });
}

}  // namespace kernel::frame::KERNEL_INSTRUCTION_SET
