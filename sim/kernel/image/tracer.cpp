// Rays of a block against rectangles in vectors, or against the tree one by one.
#include "image/tracer.hpp"

namespace kernel::image {
namespace {
// Where a ray begins it meets nothing: four digits above the roundoff of its place. [lengths of the direction]
constexpr double BEYOND_START = 1e-12;
}  // namespace

Tracer::Tracer(const double *rectangles, std::int64_t n, const double *corners, const double *frames, std::int64_t m)
    : tree_(corners, m, box_of(corners, 4 * m).diagonal()) {
    for (std::int64_t i = 0; i < n; ++i) {
        const double *p = rectangles + 15 * i;
        rectangles_.push_back({load(p), load(p + 3), load(p + 6), load(p + 9), p[12], p[13], p[14]});
    }
    if (!n) frames_.assign(frames, frames + 12 * m);
}

void Tracer::block(const Rays &rays, Hits &hits) const {
    if (rectangles_.empty()) return meet_polygons(rays, hits);
    KERNEL_CALL(meet_rectangles(rectangles_.data(), static_cast<std::int64_t>(rectangles_.size()), rays, hits));
}

void Tracer::meet_polygons(const Rays &rays, Hits &hits) const {
    for (int k = 0; k < rays.n; ++k) {
        const Vec origin{rays.ox[k], rays.oy[k], rays.oz[k]}, direction{rays.dx[k], rays.dy[k], rays.dz[k]};
        const std::int32_t found = tree_.first_hit(origin, direction, BEYOND_START, hits.at[k]);
        hits.face[k] = found;
        hits.patch[k] = -1;
        hits.u[k] = hits.v[k] = hits.s[k] = hits.t[k] = hits.towards[k] = 0;
        if (found < 0) continue;
        const double *frame = frames_.data() + 12 * static_cast<std::size_t>(found);
        const Vec place = origin + hits.at[k] * direction - load(frame);
        hits.towards[k] = -dot(direction, load(frame + 9));
        hits.patch[k] = hits.towards[k] > 0 ? found : -1;
        hits.s[k] = hits.u[k] = dot(place, load(frame + 3));
        hits.t[k] = hits.v[k] = dot(place, load(frame + 6));
    }
}

}  // namespace kernel::image
