// Rays of a patch by the block: simple loops that the compiler turns into vectors, without calls, so that every
// instruction set and every machine's library makes the same ones.
#include "sampling/patch_rays.hpp"

namespace kernel::sampling::KERNEL_INSTRUCTION_SET {
namespace {

struct Turn {
    float cosine, sine;
};

// Of u turns, u in [0, 1): the nearest quarter, and polynomials in the square of what is left, at most 1/8 turn, of which
// the coefficients interpolate the functions at Chebyshev points. Errors below 1e-7.
inline Turn turn_of(float u) {
    constexpr float S0 = 1.5707963219532366f, S1 = -0.6459634776648014f, S2 = 0.07968021764766381f,
                    S3 = -0.004602149212590905f;
    constexpr float C1 = -1.2337005406331625f, C2 = 0.25366920365512985f, C3 = -0.020860069500410923f,
                    C4 = 0.0009036280667058582f;
    const float quarters = 4 * u;
    const std::int32_t nearest = static_cast<std::int32_t>(quarters + 0.5f);
    const float rest = quarters - static_cast<float>(nearest), z = rest * rest;
    const float sine = rest * (S0 + z * (S1 + z * (S2 + z * S3)));
    const float cosine = 1 + z * (C1 + z * (C2 + z * (C3 + z * C4)));
    const float x = nearest & 1 ? sine : cosine, y = nearest & 1 ? cosine : sine;
    return {(nearest + 1) & 2 ? -x : x, nearest & 2 ? -y : y};
}

// Evenly over the patch: its two triangles by their share of the area.
inline void place(const PatchRays &patch, float u, float v, float &x, float &y, float &z) {
    const bool first = u < patch.share;
    const float s = first ? u / patch.share : (u - patch.share) / (1 - patch.share);
    const float root = std::sqrt(s), to_second = root * v, to_first = root - to_second;
    const auto along = [&](int axis) {
        const float a = first ? patch.side[0][axis] : patch.side[1][axis];
        const float b = first ? patch.side[1][axis] : patch.side[2][axis];
        return patch.corner[axis] + (to_first * a + to_second * b);
    };
    x = along(0);
    y = along(1);
    z = along(2);
}

}  // namespace

void make_places(const PatchRays &shared, const Points &points, int n, Places &places) {
    const PatchRays patch = shared;
    const std::uint32_t *across = points.of[2], *up = points.of[3];
#pragma omp simd
    for (int k = 0; k < n; ++k)
        place(patch, scrambled(across[k], patch.seed[2]), scrambled(up[k], patch.seed[3]), places.at[0][k],
              places.at[1][k], places.at[2][k]);
}

void make_rays(const PatchRays &shared, const Points &points, RayBlock &rays) {
    const PatchRays patch = shared;
    const std::uint32_t *out = points.of[0], *around = points.of[1];
    Places places;
    make_places(patch, points, rays.n, places);
    for (int axis = 0; axis < 3; ++axis) {
        const float high = patch.high[axis], low = patch.low[axis];
#pragma omp simd
        for (int k = 0; k < rays.n; ++k) rays.origin[axis][k] = high + (low + places.at[axis][k]);
    }
#pragma omp simd
    for (int k = 0; k < rays.n; ++k) {
        const float squared = scrambled(out[k], patch.seed[0]), radius = std::sqrt(squared);
        const Turn turn = turn_of(scrambled(around[k], patch.seed[1]));
        const float a = radius * turn.cosine, b = radius * turn.sine, up = std::sqrt(1 - squared);
        for (int axis = 0; axis < 3; ++axis)
            rays.direction[axis][k] = a * patch.along[axis] + b * patch.across[axis] + up * patch.normal[axis];
    }
}

}  // namespace kernel::sampling::KERNEL_INSTRUCTION_SET
