// Where camera pixels land in the projector if their points lie on given walls, and how that moves with each unknown:
// calibration/geometry/bundle_residual.py says what it is for, calibration/reference/landing.py how it is computed.
#pragma once
#include <cstdint>

#include "lens.hpp"

namespace kernel {

// A lens as nine numbers: focal lengths and principal point [px], Brown's terms.
struct Optics {
    double fx, fy, cx, cy;
    Lens lens;
};

constexpr int LENS_TERMS = 8;  // focal length, principal point (2), Brown's five

// Derivative of undistorted pixels by the unknowns of their lens. units: what one of each unknown is; of the focal
// length as a share of what it is now.
struct BearingSlopes {
    const double *seen;      // (N, 2) pixels
    const double *bearings;  // (N, 3) of these, with 1 at the end
    Optics optics;
    const double *units;  // (8)
    double *slopes;       // (8, N, 2) out
    std::int64_t points;
};

struct Landings {
    const double *bearings;     // (N, 3) of the camera's pixels
    const double *seen;         // (N, 2) the projector's pixels
    const double *weight;       // (N, 2)
    const std::int64_t *label;  // (N) plane of each point
    const double *planes;       // (K, 3) normal / offset
    std::int64_t plane_count;
    Optics projector;
    const double *rotation, *translation;  // (3, 3) and (3) of the projector, from the camera's frame
    double fold;                           // squared distance from the axis at which distortion folds back
    double far;                            // beyond, a residual does not grow
    std::int64_t points;
};

// How Landings move. Unknowns: the camera's lens, the projector's, rotation (3), translation (3), turn of the planes'
// axes (3), and what each plane has of its own.
struct LandingSlopes {
    const double *by_lens;     // (8, N, 2) BearingSlopes of the camera
    const double *units;       // (8) of the projector's lens
    const double *turns;       // (3, 3, 3) derivative of the rotation
    const double *across;      // (3, 3) derivative of the translation
    const double *plane_turns; // (3, K, 3) derivative of the planes by their turn
    const std::int64_t *own;   // (K, 2) each plane's first unknown, and how many
    const double *own_slopes;  // (K, 3, 3) derivative of a plane by these
    double *jacobian;          // (n, N, 2) out, zero before
};

// Pixels of points in a device's frame.
struct Images {
    const double *points;  // (N, 3)
    Optics optics;
    double fold;     // squared distance from the axis at which distortion folds back
    double *pixels;  // (N, 2) out
    std::int64_t count;
};

void take_images(const Images &work);
void slope_bearings(const BearingSlopes &work);
void land(const Landings &work, double *error);  // error: (N, 2) out
void slope_landings(const Landings &work, const LandingSlopes &slopes);

}  // namespace kernel
