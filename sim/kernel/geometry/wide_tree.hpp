// The tree of geometry/tree.hpp with eight children a node and eight polygons a leaf, in single precision: for millions of
// rays of which a few in a million may err, where one vector tests a whole node.
#pragma once
#include <cstdint>
#include <vector>

#include "geometry/tree.hpp"
#include "instruction_set.hpp"

namespace kernel {

constexpr int WIDTH = 8;

// Bounds of eight children: low and high of x, y, z in turn.
struct alignas(64) WideNode {
    float bound[6][WIDTH];
    std::int32_t child[WIDTH];  // below 0: leaf ~child
};

// Eight polygons: the plane dot(normal, p) = offset, and dot(edge, p) >= edge_offset inside each of four edges; a triangle
// has its third edge twice, an empty place edges that hold nothing.
struct alignas(64) WideLeaf {
    float normal[3][WIDTH], offset[WIDTH];
    std::int32_t index[WIDTH];
    std::int32_t sides;  // 3: triangles only, whose fourth edge tells nothing
    struct Edge {
        float normal[3][WIDTH], offset[WIDTH];
    } edge[4];
};

// Rays by the block, origins from the tree's middle.
constexpr int RAYS = 64;
struct alignas(64) RayBlock {
    int n;
    float origin[3][RAYS], direction[3][RAYS];
    std::int32_t from[RAYS];  // polygon that the ray leaves, which it does not meet; -1: none
    std::int32_t met[RAYS];   // out: MISSED, MET_BEHIND or the polygon
    float at[RAYS];           // out: in lengths of the direction
};
constexpr std::int32_t MISSED = -1, MET_BEHIND = -2;

struct WideTree {
    std::vector<WideNode> nodes;
    std::vector<WideLeaf> leaves;
    Vec middle{0, 0, 0};
    // Single precision rounds places by 2^-24 of half the size, and some operations follow.
    static constexpr double ROUNDING = 5e-7;
    double slack = 0;  // ROUNDING of the size: how far beyond its edge a polygon is met, and rays begin above theirs

    explicit WideTree(const Tree &tree);
};

KERNEL_DECLARE(void nearest(const WideTree &tree, RayBlock &rays))

inline void find_nearest(const WideTree &tree, RayBlock &rays) { KERNEL_CALL(nearest(tree, rays)); }

}  // namespace kernel
