// Sobol's points with Owen's scrambling: evenly spread in four dimensions, other ones for every seed.
//
// Direction numbers: Joe and Kuo, "Constructing Sobol sequences with better two-dimensional projections", SIAM J. Sci.
// Comput. 30, 2008. Scrambling by a hash whose low bits never depend on higher ones: Laine and Karras, "Stratified
// sampling for stochastic transparency", Computer Graphics Forum 30, 2011; constants by Vegdahl, 2021.
#pragma once
#include <algorithm>
#include <array>
#include <cstdint>
#include <utility>
#include <vector>

namespace kernel::sampling {

constexpr int DIMENSIONS = 4;

inline std::uint32_t reversed(std::uint32_t x) {
    x = (x >> 16) | (x << 16);
    x = ((x >> 8) & 0x00ff00ffu) | ((x & 0x00ff00ffu) << 8);
    x = ((x >> 4) & 0x0f0f0f0fu) | ((x & 0x0f0f0f0fu) << 4);
    x = ((x >> 2) & 0x33333333u) | ((x & 0x33333333u) << 2);
    return ((x >> 1) & 0x55555555u) | ((x & 0x55555555u) << 1);
}

// Of an integer, every bit about evenly.
inline std::uint32_t hashed(std::uint32_t x) {
    x = (x ^ (x >> 16)) * 0x21f0aaadu;
    x = (x ^ (x >> 15)) * 0xd35a2d97u;
    return x ^ (x >> 15);
}

// A number in [0, 1) from one whose bits are reversed: its first 24 bits, all that single precision holds.
inline float scrambled(std::uint32_t x, std::uint32_t seed) {
    x ^= x * 0x3d20adeau;
    x += seed;
    x *= (seed >> 16) | 1;
    x ^= x * 0x05526c56u;
    x ^= x * 0x53a22864u;
    return static_cast<float>(static_cast<std::int32_t>(reversed(x) >> 8)) * 0x1p-24f;
}

// Some points, bits reversed: of each dimension as many numbers.
struct Points {
    const std::uint32_t *of[DIMENSIONS];
};

// Points first ... first + count - 1, both multiples of a power of 2, so that runs of them are nets: within such a run
// those come together whose first two coordinates do. Rays of one patch then meet much the same one after the other.
// Scrambling and what sets one run off from another both flip bits below equal ones alike, which keeps neighbours.
class SobolPoints {
  public:
    SobolPoints(std::uint32_t first, std::uint32_t count) {
        const auto directions = direction_numbers();
        const std::vector<std::uint32_t> order = neighbours_first(directions, run_of(first, count));
        const auto run = static_cast<std::uint32_t>(order.size());
        for (int d = 0; d < DIMENSIONS; ++d) {
            points_[d].resize(count);
            for (std::uint32_t k = 0; k < count; ++k)
                points_[d][k] = reversed(coordinate(directions[d], first + k / run * run + order[k % run]));
        }
    }

    // From the k-th on.
    Points from(std::int64_t k) const {
        Points points;
        for (int d = 0; d < DIMENSIONS; ++d) points.of[d] = points_[d].data() + k;
        return points;
    }

    std::size_t size() const { return points_[0].size(); }

  private:
    using Direction = std::array<std::uint32_t, 32>;
    using Directions = std::array<Direction, DIMENSIONS>;
    static constexpr std::uint32_t LONGEST_RUN = 4096;

    static std::uint32_t coordinate(const Direction &direction, std::uint32_t index) {
        std::uint32_t x = 0;
        for (int bit = 0; bit < 32; ++bit)
            if (index >> bit & 1) x ^= direction[bit];
        return x;
    }

    // The longest power of 2 that divides both.
    static std::uint32_t run_of(std::uint32_t first, std::uint32_t count) {
        std::uint32_t run = 1;
        while (run < LONGEST_RUN && (first | count) % (2 * run) == 0 && count) run *= 2;
        return run;
    }

    static std::vector<std::uint32_t> neighbours_first(const Directions &directions, std::uint32_t run) {
        std::vector<std::pair<std::uint32_t, std::uint32_t>> keys(run);
        for (std::uint32_t k = 0; k < run; ++k) {
            std::uint32_t key = 0;
            for (int d = 0; d < 2; ++d)
                for (int bit = 0; bit < 16; ++bit)
                    key |= (coordinate(directions[d], k) >> (16 + bit) & 1) << (2 * bit + d);
            keys[k] = {key, k};
        }
        std::sort(keys.begin(), keys.end());
        std::vector<std::uint32_t> order;
        for (const auto &[key, k] : keys) order.push_back(k);
        return order;
    }

    static Directions direction_numbers() {
        // Degree and inner coefficients of each primitive polynomial, and its first odd numbers.
        struct Start {
            int degree;
            unsigned inner, odd[3];
        };
        constexpr Start STARTS[DIMENSIONS - 1] = {{1, 0, {1, 0, 0}}, {2, 1, {1, 3, 0}}, {3, 1, {1, 3, 1}}};
        Directions v{};
        for (int bit = 0; bit < 32; ++bit) v[0][bit] = 1u << (31 - bit);
        for (int d = 1; d < DIMENSIONS; ++d) {
            const Start &start = STARTS[d - 1];
            for (int bit = 0; bit < 32; ++bit) {
                if (bit < start.degree) {
                    v[d][bit] = start.odd[bit] << (31 - bit);
                    continue;
                }
                v[d][bit] = v[d][bit - start.degree] ^ (v[d][bit - start.degree] >> start.degree);
                for (int k = 1; k < start.degree; ++k)
                    if (start.inner >> (start.degree - 1 - k) & 1) v[d][bit] ^= v[d][bit - k];
            }
        }
        return v;
    }

    std::array<std::vector<std::uint32_t>, DIMENSIONS> points_;
};

}  // namespace kernel::sampling
