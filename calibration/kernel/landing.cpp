// One point after another: what a fit does with the numbers afterwards takes longer than these.
#include "landing.hpp"

#include <algorithm>
#include <cmath>

namespace kernel {
namespace {

constexpr double LEAST_DEPTH = 1e-9;       // nothing is divided by less
constexpr double JUST_BEFORE = 1 - 1e-6;   // of a fold, where a lens may have a pole

struct Pair {
    double x, y;
};

struct Triple {
    double x, y, z;
};

// Derivative of a distorted point: by its own coordinates (symmetric), and by Brown's terms.
struct Distortion {
    Pair real;
    double xx, xy, yy;
    Pair by_term[5];
};

inline double off_zero(double value) { return std::fabs(value) > LEAST_DEPTH ? value : LEAST_DEPTH; }

inline Pair distort(double x, double y, const Lens &k) {
    const double r2 = x * x + y * y, radial = 1 + r2 * (k.k1 + r2 * (k.k2 + r2 * k.k3));
    return {x * radial + 2 * k.p1 * x * y + k.p2 * (r2 + 2 * x * x),
            y * radial + k.p1 * (r2 + 2 * y * y) + 2 * k.p2 * x * y};
}

inline Distortion slope_distortion(double x, double y, const Lens &k) {
    const double r2 = x * x + y * y, radial = 1 + r2 * (k.k1 + r2 * (k.k2 + r2 * k.k3));
    const double rise = 2 * (k.k1 + r2 * (2 * k.k2 + r2 * 3 * k.k3)), r4 = r2 * r2, r6 = r4 * r2;
    return {distort(x, y, k),
            radial + x * x * rise + 2 * k.p1 * y + 6 * k.p2 * x,
            x * y * rise + 2 * (k.p1 * x + k.p2 * y),
            radial + y * y * rise + 6 * k.p1 * y + 2 * k.p2 * x,
            {{x * r2, y * r2},
             {x * r4, y * r4},
             {2 * x * y, r2 + 2 * y * y},
             {r2 + 2 * x * x, 2 * x * y},
             {x * r6, y * r6}}};
}

inline double dot(const double *a, const Triple &b) { return a[0] * b.x + a[1] * b.y + a[2] * b.z; }

inline Triple turned(const double *matrix, const Triple &v) {
    return {dot(matrix, v), dot(matrix + 3, v), dot(matrix + 6, v)};
}

// Row vector times matrix.
inline Triple turned_back(const Triple &v, const double *m) {
    return {v.x * m[0] + v.y * m[3] + v.z * m[6], v.x * m[1] + v.y * m[4] + v.z * m[7],
            v.x * m[2] + v.y * m[5] + v.z * m[8]};
}

// What is beyond a fold lies straight on outwards from there.
inline Pair image_of(const Triple &local, const Optics &optics, double fold) {
    const double depth = off_zero(local.z), x = local.x / depth, y = local.y / depth;
    const double inwards = std::min(std::sqrt(fold * JUST_BEFORE / std::max(x * x + y * y, JUST_BEFORE * fold)), 1.0);
    const bool beyond = x * x + y * y >= fold;
    const double in_x = beyond ? x * inwards : x, in_y = beyond ? y * inwards : y;
    const Pair real = distort(in_x, in_y, optics.lens);
    return {(real.x + (x - in_x)) * optics.fx + optics.cx, (real.y + (y - in_y)) * optics.fy + optics.cy};
}

// Derivative of one point's landing by the place of the point, as two rows; they are applied to many a vector.
struct ByPlace {
    Triple x, y;

    Pair of(const Triple &v) const { return {x.x * v.x + x.y * v.y + x.z * v.z, y.x * v.x + y.y * v.y + y.z * v.z}; }
    ByPlace turned(const double *rotation) const { return {turned_back(x, rotation), turned_back(y, rotation)}; }
};

// One point's column of the jacobian, weighted.
class Column {
  public:
    Column(double *jacobian, std::int64_t points, std::int64_t point, const double *weight)
        : first_(jacobian + 2 * point), stride_(2 * points), weight_{weight[2 * point], weight[2 * point + 1]} {}

    void set(std::int64_t unknown, const Pair &value) const {
        first_[unknown * stride_] = value.x * weight_.x;
        first_[unknown * stride_ + 1] = value.y * weight_.y;
    }

  private:
    double *first_;
    std::int64_t stride_;
    Pair weight_;
};

// Fills in lens and pose of the projector; returns the derivative by the point in the projector's frame.
ByPlace slope_projector(const Landings &work, const LandingSlopes &slopes, const Triple &point, const Column &column) {
    const Optics &p = work.projector;
    const double *t = work.translation, *units = slopes.units;
    Triple local = turned(work.rotation, point);
    local = {local.x + t[0], local.y + t[1], local.z + t[2]};
    const double depth = off_zero(local.z), x = local.x / depth, y = local.y / depth;
    const Distortion d = slope_distortion(x, y, p.lens);
    column.set(LENS_TERMS, {units[0] * p.fx * d.real.x, units[0] * p.fy * d.real.y});
    column.set(LENS_TERMS + 1, {units[1], 0});
    column.set(LENS_TERMS + 2, {0, units[2]});
    for (int k = 0; k < 5; ++k)
        column.set(LENS_TERMS + 3 + k, {units[3 + k] * p.fx * d.by_term[k].x, units[3 + k] * p.fy * d.by_term[k].y});
    const double xx = p.fx * d.xx / depth, xy = p.fx * d.xy / depth, yx = p.fy * d.xy / depth, yy = p.fy * d.yy / depth;
    const ByPlace by_local{{xx, xy, -(xx * x + xy * y)}, {yx, yy, -(yx * x + yy * y)}};
    for (int k = 0; k < 3; ++k) column.set(2 * LENS_TERMS + k, by_local.of(turned(slopes.turns + 9 * k, point)));
    const ByPlace by_translation = by_local.turned(slopes.across);
    column.set(2 * LENS_TERMS + 3, {by_translation.x.x, by_translation.y.x});
    column.set(2 * LENS_TERMS + 4, {by_translation.x.y, by_translation.y.y});
    column.set(2 * LENS_TERMS + 5, {by_translation.x.z, by_translation.y.z});
    return by_local;
}

// A plane or a ray that turns meets the other nearer or further away: the landing moves along the ray's image.
void slope_planes(std::int64_t planes, const LandingSlopes &slopes, std::int64_t label, const Triple &point,
                  const Pair &outwards, const Column &column) {
    const auto moved = [&](const double *slope) {
        const double nearer = dot(slope, point);
        return Pair{-outwards.x * nearer, -outwards.y * nearer};
    };
    for (int k = 0; k < 3; ++k)
        column.set(2 * LENS_TERMS + 6 + k, moved(slopes.plane_turns + 3 * (k * planes + label)));
    for (std::int64_t k = 0; k < slopes.own[2 * label + 1]; ++k)
        column.set(slopes.own[2 * label] + k, moved(slopes.own_slopes + 9 * label + 3 * k));
}

}  // namespace

void take_images(const Images &work) {
    for (std::int64_t i = 0; i < work.count; ++i) {
        const double *p = work.points + 3 * i;
        const Pair pixel = image_of({p[0], p[1], p[2]}, work.optics, work.fold);
        work.pixels[2 * i] = pixel.x;
        work.pixels[2 * i + 1] = pixel.y;
    }
}

void slope_bearings(const BearingSlopes &work) {
    const Optics &o = work.optics;
    const std::int64_t stride = 2 * work.points;
    for (std::int64_t i = 0; i < work.points; ++i) {
        const Distortion d = slope_distortion(work.bearings[3 * i], work.bearings[3 * i + 1], o.lens);
        const double scale = -1 / (d.xx * d.yy - d.xy * d.xy);
        const auto set = [&](int k, double x, double y) {  // what the distorted point would have to move back by
            work.slopes[k * stride + 2 * i] = scale * work.units[k] * (d.yy * x - d.xy * y);
            work.slopes[k * stride + 2 * i + 1] = scale * work.units[k] * (d.xx * y - d.xy * x);
        };
        set(0, (work.seen[2 * i] - o.cx) / o.fx, (work.seen[2 * i + 1] - o.cy) / o.fy);
        set(1, 1 / o.fx, 0);
        set(2, 0, 1 / o.fy);
        for (int k = 0; k < 5; ++k) set(3 + k, d.by_term[k].x, d.by_term[k].y);
    }
}

void land(const Landings &work, double *error) {
    for (std::int64_t i = 0; i < work.points; ++i) {
        const Triple bearing{work.bearings[3 * i], work.bearings[3 * i + 1], work.bearings[3 * i + 2]};
        const double along = off_zero(dot(work.planes + 3 * work.label[i], bearing));
        Triple local = turned(work.rotation, {bearing.x / along, bearing.y / along, bearing.z / along});
        const double *t = work.translation;
        const Pair image = image_of({local.x + t[0], local.y + t[1], local.z + t[2]}, work.projector, work.fold);
        const double off[2] = {image.x - work.seen[2 * i], image.y - work.seen[2 * i + 1]};
        for (int k = 0; k < 2; ++k)  // what is NaN stays so
            error[2 * i + k] = work.weight[2 * i + k] * (off[k] < -work.far ? -work.far : off[k] > work.far ? work.far : off[k]);
    }
}

void slope_landings(const Landings &work, const LandingSlopes &slopes) {
    for (std::int64_t i = 0; i < work.points; ++i) {
        const Column column(slopes.jacobian, work.points, i, work.weight);
        const Triple bearing{work.bearings[3 * i], work.bearings[3 * i + 1], work.bearings[3 * i + 2]};
        const double *plane = work.planes + 3 * work.label[i];
        const double along = off_zero(dot(plane, bearing));
        const Triple point{bearing.x / along, bearing.y / along, bearing.z / along};
        const ByPlace by_point = slope_projector(work, slopes, point, column).turned(work.rotation);
        const Pair outwards = by_point.of(point);
        slope_planes(work.plane_count, slopes, work.label[i], point, outwards, column);
        const double xx = (by_point.x.x - outwards.x * plane[0]) / along, xy = (by_point.x.y - outwards.x * plane[1]) / along;
        const double yx = (by_point.y.x - outwards.y * plane[0]) / along, yy = (by_point.y.y - outwards.y * plane[1]) / along;
        for (int k = 0; k < LENS_TERMS; ++k) {
            const double *ray = slopes.by_lens + 2 * (k * work.points + i);
            column.set(k, {xx * ray[0] + xy * ray[1], yx * ray[0] + yy * ray[1]});
        }
    }
}

}  // namespace kernel
