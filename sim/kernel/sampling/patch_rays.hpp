// Rays that leave a patch as its light does: from places spread evenly over it, by the cosine to its normal.
#pragma once
#include <cstdint>

#include "geometry/wide_tree.hpp"
#include "sampling/sobol.hpp"

namespace kernel::sampling {

// A patch as rays leave it, in single precision; places from its centroid, which alone is told in two parts: what is
// small is added to the small one, so that a place is rounded but once.
struct PatchRays {
    float high[3], low[3];       // centroid from the tree's middle, and above the patch by what single precision rounds
    float corner[3];             // the first
    float side[3][3];            // from it to the others
    float along[3], across[3], normal[3];
    float share;                 // of the area, that the first of its two triangles has
    std::uint32_t seed[DIMENSIONS];
};

// Scrambling is the seed's own.
PatchRays patch_rays(const double *corners, const Vec &middle, double slack, std::uint32_t seed);

// Places about a patch's centroid.
struct Places {
    alignas(64) float at[3][RAYS];
};

// `points`: of each dimension, RAYS at most.
KERNEL_DECLARE(void make_rays(const PatchRays &patch, const Points &points, RayBlock &rays))
KERNEL_DECLARE(void make_places(const PatchRays &patch, const Points &points, int n, Places &places))

// Places and directions of the first rays.n points.
inline void rays_of(const PatchRays &patch, const Points &points, RayBlock &rays) {
    KERNEL_CALL(make_rays(patch, points, rays));
}

// Where the rays of the first n points begin, from the patch's centroid.
inline void places_of(const PatchRays &patch, const Points &points, int n, Places &places) {
    KERNEL_CALL(make_places(patch, points, n, places));
}

}  // namespace kernel::sampling
