// Cluster tree: patches sorted so that every cluster is a contiguous run, flat regions kept together.
//
// It divides the matrix into blocks, so that clusters must be compact, of about one size a level, and not mix regions.
// The tree of geometry/tree.hpp answers rays, by the surface area heuristic over occluders: another job, another cut.
#pragma once
#include <cstdint>
#include <vector>

#include "geometry/box.hpp"
#include "geometry/tolerance.hpp"

namespace kernel::compressed {

struct Cluster {
    int begin = 0, end = 0;      // its patches, in the tree's order
    int child[2] = {-1, -1};     // none for a leaf
    bool flat = false;           // all its patches lie in one plane and look the same way
    Vec normal{0, 0, 0};         // of that plane
    double offset = 0;           // dot(normal, x) on that plane
    std::vector<Vec> hull;       // corners of a rectangle (flat) or box around its patches
    Vec low{0, 0, 0}, high{0, 0, 0};
    Vec middle{0, 0, 0};
    double radius = 0;           // of the sphere around the middle that holds the hull
    double area = 0;
    int size() const { return end - begin; }
    bool leaf() const { return child[0] < 0; }
};

struct Geometry {
    int n = 0;
    const double *vertices = nullptr;  // (n, 4, 3)
    const double *normals = nullptr;   // (n, 3)
    const double *areas = nullptr;     // (n)
    const std::int64_t *region = nullptr;
    double size() const { return box_of(vertices, 4 * std::int64_t{n}).diagonal(); }
    Vec corner(int patch, int k) const { return load(vertices + 12 * patch + 3 * k); }
    Vec centre(int patch) const {
        return 0.25 * (corner(patch, 0) + corner(patch, 1) + (corner(patch, 2) + corner(patch, 3)));
    }
};

struct ClusterTree {
    std::vector<int> order;         // place in the tree -> patch
    std::vector<Cluster> clusters;  // the root first
};

ClusterTree build_cluster_tree(const Geometry &geometry, int leaf_size);

// Smallest distance that two clusters can have, from below.
double distance_of(const Cluster &a, const Cluster &b);

}  // namespace kernel::compressed
