// Rays by the block: a lens that aims them, a surface that stops them.
#pragma once
#include <cstdint>

#include "instruction_set.hpp"
#include "geometry/vectors.hpp"

namespace kernel::image {

constexpr int BLOCK = 256;  // rays at a time: with all that is found out about them 30 KB, the first cache

// A pinhole with distortion (sim.geometry.optics.Lens) and where it stands (sim.geometry.optics.Pose).
struct Device {
    std::int64_t width, height;
    double fx, fy, cx, cy;
    double k1, k2, p1, p2, k3;
    double rotation[9];  // device_from_world
    Vec position;
    bool distorted() const { return k1 != 0 || k2 != 0 || p1 != 0 || p2 != 0 || k3 != 0; }
};

struct Rays {
    int n;
    double ox[BLOCK], oy[BLOCK], oz[BLOCK];
    double dx[BLOCK], dy[BLOCK], dz[BLOCK];
};

// What the lens does with each ray of a block.
struct Aim {
    double cos_gamma[BLOCK];  // from the optical axis; the directions are 1 / cos_gamma long
    double jacobian[BLOCK];   // area that the distortion makes of a unit area
};

struct Hits {
    std::int64_t face[BLOCK];   // -1: nothing met
    std::int64_t patch[BLOCK];  // -1: nothing met, or from behind
    double at[BLOCK];           // in lengths of the direction; infinite for none
    double u[BLOCK], v[BLOCK];  // place: face coordinates in [0, 1], or metres about a polygon's centroid
    double s[BLOCK], t[BLOCK];  // place within the patch: cell coordinates in [0, 1], or the same metres
    double towards[BLOCK];      // minus direction . normal: above 0 on the lit side
};

// A rectangle gridded into patches (sim.geometry.scene.Face).
struct Rectangle {
    Vec origin, u, v, normal;  // u and v: unit axis over the edge's length
    double columns, rows, first;
};

// Rays through n pixels of a row, each at (offset_x, offset_y) from its centre [px].
KERNEL_DECLARE(void aim(const Device &device, std::int64_t row, std::int64_t column, int n, double offset_x,
                        double offset_y, Rays &rays, Aim &lens))
KERNEL_DECLARE(void meet_rectangles(const Rectangle *rectangles, std::int64_t n, const Rays &rays, Hits &hits))
// Power that a pixel of brightness 1 sends to the surface: its solid angle times r² where there is no fall-off
// (paper), the same from every pixel otherwise (physical).
KERNEL_DECLARE(void pixel_flux(const Device &device, const Aim &lens, const Hits &hits, int n, bool physical,
                               double *flux))
// Irradiance from it where the ray meets the surface: cos theta, over r² cos³ gamma if physical; 0 where unlit.
KERNEL_DECLARE(void pixel_irradiance(const Aim &lens, const Hits &hits, int n, bool physical, double *irradiance))

}  // namespace kernel::image
