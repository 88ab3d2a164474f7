// What the rays of a patch share.
#include "sampling/patch_rays.hpp"

namespace kernel::sampling {
namespace {

void put(const Vec &value, float *out) {
    for (int axis = 0; axis < 3; ++axis) out[axis] = static_cast<float>(component(value, axis));
}

}  // namespace

PatchRays patch_rays(const double *corners, const Vec &middle, double slack, std::uint32_t seed) {
    PatchRays rays;
    const Vec normal = flat_polygon(corners).normal, centre = centroid(corners), first = load(corners);
    Vec side[3];
    for (int k = 0; k < 3; ++k) side[k] = load(corners + 3 * (k + 1)) - first;
    const double one = norm(cross(side[0], side[1])), other = norm(cross(side[1], side[2]));
    // Above the patch by what single precision rounds, but never by much of a small patch.
    const double rise = std::min(slack, 1e-3 * std::sqrt(0.5 * (one + other)));
    const Vec from = centre - middle;
    put(from, rays.high);
    put(from - Vec{rays.high[0], rays.high[1], rays.high[2]} + rise * normal, rays.low);
    put(first - centre, rays.corner);
    for (int k = 0; k < 3; ++k) put(side[k], rays.side[k]);
    const Vec along = unit(cross(normal, std::fabs(normal.x) < 0.7 ? Vec{1, 0, 0} : Vec{0, 1, 0}));
    put(along, rays.along);
    put(cross(normal, along), rays.across);
    put(normal, rays.normal);
    rays.share = static_cast<float>(one + other > 0 ? one / (one + other) : 1.0);
    for (std::uint32_t d = 0; d < DIMENSIONS; ++d) rays.seed[d] = hashed(seed ^ hashed(d + 0x9e3779b9u));
    return rays;
}

}  // namespace kernel::sampling
