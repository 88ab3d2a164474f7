// What a ray meets: gridded rectangles by the block, or a tree of polygons.
#pragma once
#include <cstdint>
#include <vector>

#include "geometry/tree.hpp"
#include "image/rays.hpp"

namespace kernel::image {

class Tracer {
  public:
    // rectangles: n rows of origin, u, v (unit axis over the edge's length), normal (3 each), columns, rows, first
    // patch. Corners: m polygons of 4 x 3 that stop segments: the rectangles, or the patches when there are none.
    // frames: for polygons, m rows of centroid, two axes, normal (3 each).
    Tracer(const double *rectangles, std::int64_t n, const double *corners, const double *frames, std::int64_t m);

    void block(const Rays &rays, Hits &hits) const;
    bool blocked(Vec from, Vec to) const { return tree_.blocker(from, to) >= 0; }

  private:
    void meet_polygons(const Rays &rays, Hits &hits) const;

    std::vector<Rectangle> rectangles_;
    std::vector<double> frames_;
    Tree tree_;
};

}  // namespace kernel::image
