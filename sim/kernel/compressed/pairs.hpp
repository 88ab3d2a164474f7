// One entry of the scaled exchange matrix S = A^-1/2 K A^-1/2, K_ij = A_i F_ij, evaluated when asked for.
#pragma once
#include <vector>

#include "compressed/cluster_tree.hpp"
#include "compressed/hidden.hpp"
#include "form_factors/gauss.hpp"

namespace kernel::compressed {

// How exactly pairs are evaluated; distances in patch diameters.
struct Effort {
    double far;         // beyond: one point a patch
    double middle;      // beyond: 2 x 2 points a patch; below: exact inner integral, Gauss outside
    int order, order_close, order_abrupt;
    int rays_min, rays_max;
    double ray_error;   // wanted error of a visible share times S, over sqrt(A / total area)
    int first_ray;      // where in the low-discrepancy sequence the rays begin
};

class Pairs {
   public:
    Pairs(const Geometry &geometry, const std::vector<int> &order, const std::vector<Occluder> &occluders,
          Effort effort);
    int size() const { return static_cast<int>(far_.size()); }
    double root_area(int i) const { return far_[i].root_area; }
    Tolerance tolerance() const { return tolerance_; }
    Cluster alone(int i) const;  // a cluster of one patch
    // out[j - begin] = S(i, j) for begin <= j < end past the candidate occluders.
    void row(int i, int begin, int end, const std::vector<int> &candidates, double *out) const;
    double value(int i, int j, const std::vector<int> &candidates) const;

   private:
    struct Far {
        Vec centre, normal;
        double root_area, diameter_squared;
    };
    struct Near {  // for points on the patch; a triangle repeats its last corner here, as the bilinear map wants it
        Vec corner[4];
        Vec twist;         // not 0 where the quad is no parallelogram
        bool parallelogram;
        Vec gauss[4];      // 2 x 2 points
        double weight[4];  // their shares of the area
    };
    std::vector<Far> far_;
    std::vector<Near> near_;
    const std::vector<Occluder> &occluders_;
    Effort effort_;
    double total_area_ = 0;
    Tolerance tolerance_;
    std::vector<double> rays_;  // (rays_max, 4) points of the unit cube

    void prepare(const Geometry &geometry, int patch);
    Vec point(const Near &patch, double u, double v, double *jacobian) const;
    double unhidden(int i, int j) const;
    double by_points(int i, int j) const;
    bool astride(int i, int j) const;
    double exact(int i, int j, bool close) const;
    double visible(int i, int j, const std::vector<int> &candidates) const;
    Polygon polygon_of(int i) const;
    template <class Factor>
    double outer_integral(int i, int j, const GaussRule &rule, const Factor &factor) const;
    template <class Factor>
    double integral_over(const Near &part, const GaussRule &rule, const Factor &factor) const;
    int rays_for(int i, int j, double unhidden_value) const;
    double visible_share(int i, int j, int rays, const std::vector<int> &candidates) const;
};

}  // namespace kernel::compressed
