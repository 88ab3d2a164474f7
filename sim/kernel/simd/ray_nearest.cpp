// The nearest polygon that each ray meets: eight boxes or eight polygons in one vector, one ray at a time.
#include <cstring>

#include "geometry/wide_tree.hpp"

#if defined(__AVX2__)
// GCC 12 takes its own headers' undefined lanes for a mistake.
#pragma GCC diagnostic ignored "-Wuninitialized"
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"
#include <immintrin.h>
#endif
#pragma GCC diagnostic ignored "-Wpsabi"

namespace kernel::KERNEL_INSTRUCTION_SET {
namespace {

typedef float Floats __attribute__((vector_size(4 * WIDTH)));
typedef std::int32_t Ints __attribute__((vector_size(4 * WIDTH)));

inline Floats load8(const float *p) {
    Floats v;
    std::memcpy(&v, p, sizeof v);
    return v;
}

inline Floats larger8(const Floats &a, const Floats &b) { return a > b ? a : b; }
inline Floats smaller8(const Floats &a, const Floats &b) { return a < b ? a : b; }

// A bit for each lane that is true.
inline unsigned bits_of(const Ints &lanes) {
#if defined(__AVX2__)
    return static_cast<unsigned>(_mm256_movemask_ps((__m256)lanes));
#else
    unsigned bits = 0;
    for (int k = 0; k < WIDTH; ++k) bits |= (static_cast<std::uint32_t>(lanes[k]) >> 31) << k;
    return bits;
#endif
}

struct Ray {
    Floats origin[3], direction[3], inverse[3];
    int near[3];  // which of a node's bounds is met first along each axis
    std::int32_t from;
};

inline Ray ray_of(const RayBlock &rays, int k) {
    Ray ray;
    for (int axis = 0; axis < 3; ++axis) {
        const float along = rays.direction[axis][k];
        // Never infinite: zero times infinity would be no number.
        const float safe = along > 1e-20f || along < -1e-20f ? along : 1e-20f;
        ray.origin[axis] = Floats{} + rays.origin[axis][k];
        ray.direction[axis] = Floats{} + along;
        ray.inverse[axis] = Floats{} + 1 / safe;
        ray.near[axis] = 2 * axis + (safe < 0);
    }
    ray.from = rays.from[k];
    return ray;
}

// Two sides of a sheet lie in one place: of what is met within this share of the distance, the lit side counts.
constexpr float TIE = 1e-6f;

struct Found {
    float at = HUGE_VALF;
    std::int32_t met = MISSED;

    // Nearer than this, a lit side or one from behind takes the place of what was found.
    float limit(bool lit_side) const {
        if (lit_side) return met == MET_BEHIND ? at * (1 + TIE) : at;
        return met >= 0 ? at * (1 - TIE) : at;
    }
};

inline void meet_leaf(const WideLeaf &leaf, const Ray &ray, Found &found) {
    const Floats nx = load8(leaf.normal[0]), ny = load8(leaf.normal[1]), nz = load8(leaf.normal[2]);
    const Floats towards = nx * ray.direction[0] + ny * ray.direction[1] + nz * ray.direction[2];
    const Floats height = load8(leaf.offset) - (nx * ray.origin[0] + ny * ray.origin[1] + nz * ray.origin[2]);
    const Floats at = height / towards;
    const Floats x = ray.origin[0] + at * ray.direction[0], y = ray.origin[1] + at * ray.direction[1],
                 z = ray.origin[2] + at * ray.direction[2];
    Ints met = (at > 0.0f) & (at <= found.at * (1 + TIE));
    for (int k = 0; k < 4; ++k)
        met &= load8(leaf.edge[k][0]) * x + load8(leaf.edge[k][1]) * y + load8(leaf.edge[k][2]) * z >=
               load8(leaf.edge_offset[k]);
    for (unsigned bits = bits_of(met); bits; bits &= bits - 1) {
        const int k = __builtin_ctz(bits);
        const bool lit_side = towards[k] < 0;
        if (leaf.index[k] != ray.from && at[k] < found.limit(lit_side))
            found = {at[k], lit_side ? leaf.index[k] : MET_BEHIND};
    }
}

// Each level of the tree leaves at most seven others waiting; a binary tree of 64 levels makes at most 64 wide ones.
constexpr int STACK = 7 * 68;

Found first_met(const WideTree &tree, const Ray &ray) {
    struct Entry {
        std::int32_t child;
        float at;
    } stack[STACK];
    Found found;
    int top = 0;
    stack[top++] = {0, 0.0f};
    while (top) {
        const Entry next = stack[--top];
        if (next.at >= found.at) continue;
        if (next.child < 0) {
            meet_leaf(tree.leaves[~next.child], ray, found);
            continue;
        }
        const WideNode &node = tree.nodes[next.child];
        Floats in = {}, out = Floats{} + found.at;
        for (int axis = 0; axis < 3; ++axis) {
            in = larger8((load8(node.bound[ray.near[axis]]) - ray.origin[axis]) * ray.inverse[axis], in);
            out = smaller8((load8(node.bound[ray.near[axis] ^ 1]) - ray.origin[axis]) * ray.inverse[axis], out);
        }
        const int base = top;
        for (unsigned bits = bits_of(in <= out); bits; bits &= bits - 1) {
            const int k = __builtin_ctz(bits);
            const Entry entry{node.child[k], in[k]};
            // The nearest ends on top.
            int place = top++;
            for (; place > base && stack[place - 1].at < entry.at; --place) stack[place] = stack[place - 1];
            stack[place] = entry;
        }
    }
    return found;
}

}  // namespace

void nearest(const WideTree &tree, RayBlock &rays) {
    for (int k = 0; k < rays.n; ++k) {
        const Found found = tree.nodes.empty() ? Found{} : first_met(tree, ray_of(rays, k));
        rays.met[k] = found.met;
        rays.at[k] = found.at;
    }
}

}  // namespace kernel::KERNEL_INSTRUCTION_SET
