// What a point sees of a polygon past occluders: their shadows are cut out exactly.
#pragma once
#include <vector>

#include "form_factors/point_factor.hpp"
#include "geometry/occluder.hpp"

namespace kernel::compressed {

// Factor from the point p to the parts of a convex polygon that no candidate hides from it. PointView
// (form_factors/point_view.hpp) makes the candidates disjoint first, which pays where one point looks at many polygons;
// here it looks at one, past any number of candidates.
double visible_factor(Vec p, Vec normal, const Polygon &polygon, const std::vector<Occluder> &occluders,
                      const std::vector<int> &candidates, Tolerance tolerance);

// Smallest height over a flat quad of the candidates' parts that lie straight above it; infinite for none. What
// comes near to a patch makes its view change abruptly from point to point.
double clearance(const Vec corner[4], Vec normal, const std::vector<Occluder> &occluders,
                 const std::vector<int> &candidates, Tolerance tolerance);

}  // namespace kernel::compressed
