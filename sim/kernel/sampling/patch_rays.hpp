// Rays that leave a patch as its light does: from places spread evenly over it, by the cosine to its normal.
#pragma once
#include "geometry/wide_tree.hpp"
#include "sampling/sobol.hpp"

namespace kernel::sampling {

class PatchRays {
  public:
    // A patch, and its seed: scrambling is its own in every patch.
    PatchRays(const double *corners, const Vec &middle, double slack, std::uint32_t seed) {
        const FlatPolygon patch = flat_polygon(corners);
        for (int k = 0; k < 4; ++k) corner_[k] = load(corners + 3 * k) - middle;
        centre_ = centroid(corners) - middle;
        normal_ = patch.normal;
        const double first = norm(cross(corner_[1] - corner_[0], corner_[2] - corner_[0]));
        const double second = norm(cross(corner_[2] - corner_[0], corner_[3] - corner_[0]));
        share_ = first + second > 0 ? first / (first + second) : 1.0;
        // Above the patch by what single precision rounds, but never by much of a small patch.
        rise_ = std::min(slack, 1e-3 * std::sqrt(0.5 * (first + second)));
        along_ = unit(cross(normal_, std::fabs(normal_.x) < 0.7 ? Vec{1, 0, 0} : Vec{0, 1, 0}));
        across_ = cross(normal_, along_);
        for (std::uint32_t d = 0; d < DIMENSIONS; ++d) seeds_[d] = hashed(seed ^ hashed(d + 0x9e3779b9u));
    }

    // Place and direction of a point, into place k of a block.
    void put(const SobolPoints::Point &point, RayBlock &rays, int k) const {
        double u[DIMENSIONS];
        for (int d = 0; d < DIMENSIONS; ++d) u[d] = scrambled(point[d], seeds_[d]);
        const double radius = std::sqrt(u[0]), angle = 2 * PI * u[1];
        const Vec direction = radius * std::cos(angle) * along_ + radius * std::sin(angle) * across_ +
                              std::sqrt(1 - u[0]) * normal_;
        const Vec origin = place(u[2], u[3]) + rise_ * normal_;
        for (int axis = 0; axis < 3; ++axis) {
            rays.origin[axis][k] = static_cast<float>(component(origin, axis));
            rays.direction[axis][k] = static_cast<float>(component(direction, axis));
        }
    }

    // Where the ray of a point begins, from the patch's centroid.
    Vec place(const SobolPoints::Point &point) const {
        return place(scrambled(point[2], seeds_[2]), scrambled(point[3], seeds_[3])) - centre_;
    }

    // Evenly over the patch: its two triangles by their share of the area.
    Vec place(double u, double v) const {
        const bool first = u < share_;
        const double s = first ? u / share_ : (u - share_) / (1 - share_);
        // Corner 0, and the other two of the triangle.
        const Vec &b = corner_[first ? 1 : 2], &c = corner_[first ? 2 : 3];
        const double root = std::sqrt(s);
        return corner_[0] + root * ((1 - v) * (b - corner_[0]) + v * (c - corner_[0]));
    }

    bool flat() const { return norm(normal_) > 0; }

  private:
    Vec corner_[4], centre_, normal_, along_, across_;
    double share_, rise_;
    std::uint32_t seeds_[DIMENSIONS];
};

}  // namespace kernel::sampling
