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
    int near[3], far[3];  // which of a node's bounds is met first along each axis, and which last
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
        ray.far[axis] = ray.near[axis] ^ 1;
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
    for (int k = 0; k < leaf.sides; ++k)
        met &= load8(leaf.edge[k].normal[0]) * x + load8(leaf.edge[k].normal[1]) * y +
                   load8(leaf.edge[k].normal[2]) * z >=
               load8(leaf.edge[k].offset);
    for (unsigned bits = bits_of(met); bits; bits &= bits - 1) {
        const int k = __builtin_ctz(bits);
        const bool lit_side = towards[k] < 0;
        if (leaf.index[k] != ray.from && at[k] < found.limit(lit_side))
            found = {at[k], lit_side ? leaf.index[k] : MET_BEHIND};
    }
}

// Each level of the tree leaves at most seven others waiting; a binary tree of 64 levels makes at most 64 wide ones.
constexpr int STACK = 7 * 68;

// Children that wait, the nearest last. Two arrays: what is written as two numbers is slow to read as one.
struct Waiting {
    float at[STACK];
    std::int32_t child[STACK];
    int count = 0;

    // Among those from `base` on.
    void add(int base, std::int32_t which, float distance) {
        int place = count++;
        for (; place > base && at[place - 1] < distance; --place) {
            at[place] = at[place - 1];
            child[place] = child[place - 1];
        }
        at[place] = distance;
        child[place] = which;
    }
};

// Of the children that a ray meets nearer than `limit` the nearest; the others wait. False if there is none.
inline bool nearest_child(const WideNode &node, const Ray &ray, float limit, Waiting &waiting, std::int32_t &child) {
    Floats in = {}, out = Floats{} + limit;
    for (int axis = 0; axis < 3; ++axis) {
        in = larger8((load8(node.bound[ray.near[axis]]) - ray.origin[axis]) * ray.inverse[axis], in);
        out = smaller8((load8(node.bound[ray.far[axis]]) - ray.origin[axis]) * ray.inverse[axis], out);
    }
    unsigned bits = bits_of(in <= out);
    if (!bits) return false;
    int nearest = __builtin_ctz(bits);
    const int base = waiting.count;
    float at[WIDTH];
    std::memcpy(at, &in, sizeof at);
    for (bits &= bits - 1; bits; bits &= bits - 1) {
        const int k = __builtin_ctz(bits), further = at[k] <= at[nearest] ? nearest : k;
        nearest = at[k] <= at[nearest] ? k : nearest;
        waiting.add(base, node.child[further], at[further]);
    }
    child = node.child[nearest];
    return true;
}

// Of those that wait the nearest that is nearer than what was found; false if there is none.
inline bool take(Waiting &waiting, float limit, std::int32_t &child) {
    while (waiting.count) {
        const int last = --waiting.count;
        child = waiting.child[last];
        if (waiting.at[last] < limit) return true;
    }
    return false;
}

Found first_met(const WideTree &tree, const Ray &ray) {
    Waiting waiting;
    Found found;
    std::int32_t next = 0;
    do {
        bool lower = true;
        while (next >= 0 && lower) lower = nearest_child(tree.nodes[next], ray, found.at, waiting, next);
        if (lower) meet_leaf(tree.leaves[~next], ray, found);
    } while (take(waiting, found.at, next));
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
