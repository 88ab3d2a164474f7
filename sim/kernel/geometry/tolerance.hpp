// The one rule of how near is near, for all that asks what stands where: polygons, trees, shafts, cuts.
#pragma once

namespace kernel {

// Lengths, from the size (the diagonal of the box) of the surface that is asked about.
//
// touch: what lies nearer to a polygon's plane than this lies on it. Corners may come from files in single
// precision, which moves each coordinate by up to half a unit in its last place, 2^-25 of the size, so a corner by up
// to sqrt(3) 2^-25 = 5.2e-8. Two places that were one before the file lie within twice that, 1.04e-7: two patches in
// one plane, a wall that stands on a floor, the end of a segment and the polygon that it was put on.
//
// snap: what lies nearer to an edge, or to a plane that cuts, than this lies on it, so that no ray falls between two
// polygons that share an edge and cuts leave no slivers. Places where lines cross planes are off by some units of
// 2^-53 = 1.1e-16 of the size, and by as many times more as the crossing is flat; 1e-12 holds them down to a slope of
// 1e-3 with ten operations before it.
//
// Two things have rules of their own, for their own reasons. Exact exchange areas (polygon_pairs.hpp) know roundoff
// alone: a neighbour that reaches 1e-15 of the surface behind a patch is cut there, as its light would be negative.
// Rays and gridded rectangles (simd/image_rays.cpp) go by shares of an edge, as their definition in numpy does.
struct Tolerance {
    double touch, snap;
    static constexpr Tolerance of(double size) { return {1e-7 * size, 1e-12 * size}; }
};

}  // namespace kernel
