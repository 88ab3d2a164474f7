// Aiming rays and meeting gridded rectangles: simple loops over a block that the compiler turns into vectors.
#include "image/rays.hpp"

#include <limits>

namespace kernel::image::KERNEL_INSTRUCTION_SET {

namespace {

double unit_range(double x) { return x < 0 ? 0 : x > 1 ? 1 : x; }

// Image point to the plane z = 1, by Newton's method from the distorted point.
void undistort(const Device &d, int n, double *px, double *py, double *jacobian) {
    for (int k = 0; k < n; ++k) {
        const double bent_x = px[k], bent_y = py[k];
        double x = bent_x, y = bent_y, det = 1;
        for (int step = 0; step < 12; ++step) {
            const double s = x * x + y * y, slope = d.k1 + s * (2 * d.k2 + s * 3 * d.k3);
            const double radial = 1 + s * (d.k1 + s * (d.k2 + s * d.k3));
            const double error_x = x * radial + 2 * d.p1 * x * y + d.p2 * (s + 2 * x * x) - bent_x;
            const double error_y = y * radial + d.p1 * (s + 2 * y * y) + 2 * d.p2 * x * y - bent_y;
            const double xx = radial + 2 * x * x * slope + 2 * d.p1 * y + 6 * d.p2 * x;
            const double yy = radial + 2 * y * y * slope + 6 * d.p1 * y + 2 * d.p2 * x;
            const double xy = 2 * x * y * slope + 2 * d.p1 * x + 2 * d.p2 * y;
            det = xx * yy - xy * xy;
            x -= (yy * error_x - xy * error_y) / det;
            y -= (xx * error_y - xy * error_x) / det;
        }
        px[k] = x;
        py[k] = y;
        jacobian[k] = det;
    }
}

// The patch of each hit, and the place in it. Loops apart, so that the second becomes vectors.
void find_cells(const Rectangle *rectangles, int n, Hits &hits) {
    double columns[BLOCK], rows[BLOCK], first[BLOCK];
    for (int k = 0; k < n; ++k) {
        const Rectangle &face = rectangles[hits.face[k] < 0 ? 0 : hits.face[k]];
        columns[k] = face.columns;
        rows[k] = face.rows;
        first[k] = face.first;
    }
    for (int k = 0; k < n; ++k) {
        const double u = unit_range(hits.u[k]), v = unit_range(hits.v[k]);
        const double x = u * columns[k], y = v * rows[k];
        const double whole_x = static_cast<double>(static_cast<std::int64_t>(x));
        const double whole_y = static_cast<double>(static_cast<std::int64_t>(y));
        const double column = whole_x < columns[k] ? whole_x : columns[k] - 1;
        const double row = whole_y < rows[k] ? whole_y : rows[k] - 1;
        hits.u[k] = u;
        hits.v[k] = v;
        hits.s[k] = x - column;
        hits.t[k] = y - row;
        const auto patch = static_cast<std::int64_t>(first[k] + row * columns[k] + column);
        hits.patch[k] = (hits.towards[k] > 0) & (hits.face[k] >= 0) ? patch : -1;
    }
}

}  // namespace

void aim(const Device &device, std::int64_t row, std::int64_t column, int n, double offset_x, double offset_y,
         Rays &rays, Aim &lens) {
    double px[BLOCK], py[BLOCK];
    for (int k = 0; k < n; ++k) {
        px[k] = (static_cast<double>(column + k) + offset_x - device.cx) / device.fx;
        py[k] = (static_cast<double>(row) + offset_y - device.cy) / device.fy;
        lens.jacobian[k] = 1;
    }
    if (device.distorted()) undistort(device, n, px, py, lens.jacobian);
    const double *r = device.rotation;
    const double r0 = r[0], r1 = r[1], r2 = r[2], r3 = r[3], r4 = r[4], r5 = r[5], r6 = r[6], r7 = r[7], r8 = r[8];
    rays.n = n;
    for (int k = 0; k < n; ++k) {
        rays.dx[k] = px[k] * r0 + py[k] * r3 + r6;
        rays.dy[k] = px[k] * r1 + py[k] * r4 + r7;
        rays.dz[k] = px[k] * r2 + py[k] * r5 + r8;
        rays.ox[k] = device.position.x;
        rays.oy[k] = device.position.y;
        rays.oz[k] = device.position.z;
        lens.cos_gamma[k] = 1 / std::sqrt(1 + px[k] * px[k] + py[k] * py[k]);
    }
}

void meet_rectangles(const Rectangle *rectangles, std::int64_t count, const Rays &rays, Hits &hits) {
    // In shares of an edge, as the definition has it (sim.scene.intersect_reference): no ray falls between two faces.
    constexpr double low = -1e-9, high = 1 + 1e-9, miss = std::numeric_limits<double>::infinity();
    const int n = rays.n;
    for (int k = 0; k < n; ++k) {
        hits.face[k] = -1;
        hits.at[k] = miss;
        hits.u[k] = hits.v[k] = hits.towards[k] = 0;
    }
    for (std::int64_t index = 0; index < count; ++index) {
        const Rectangle face = rectangles[index];
        for (int k = 0; k < n; ++k) {
            const Vec d{rays.dx[k], rays.dy[k], rays.dz[k]};
            const Vec relative{rays.ox[k] - face.origin.x, rays.oy[k] - face.origin.y, rays.oz[k] - face.origin.z};
            const double towards = dot(d, face.normal);
            const double at = -dot(relative, face.normal) / towards;
            const double u = dot(relative, face.u) + at * dot(d, face.u);
            const double v = dot(relative, face.v) + at * dot(d, face.v);
            const bool met = (std::abs(towards) > 1e-15) & (at > 1e-12) & (at < hits.at[k]) & (u >= low) & (u <= high) &
                             (v >= low) & (v <= high);
            hits.face[k] = met ? index : hits.face[k];
            hits.at[k] = met ? at : hits.at[k];
            hits.u[k] = met ? u : hits.u[k];
            hits.v[k] = met ? v : hits.v[k];
            hits.towards[k] = met ? -towards : hits.towards[k];
        }
    }
    find_cells(rectangles, n, hits);
}

void pixel_flux(const Device &device, const Aim &lens, const Hits &hits, int n, bool physical, double *flux) {
    const double pixel = 1 / (device.fx * device.fy);
    for (int k = 0; k < n; ++k)
        flux[k] = physical ? pixel : pixel * hits.at[k] * hits.at[k] * lens.cos_gamma[k] / lens.jacobian[k];
}

void pixel_irradiance(const Aim &lens, const Hits &hits, int n, bool physical, double *irradiance) {
    for (int k = 0; k < n; ++k) {
        const double cos_theta = hits.towards[k] * lens.cos_gamma[k];
        const double fall_off = hits.at[k] * hits.at[k] * lens.cos_gamma[k] / lens.jacobian[k];
        const double value = physical ? cos_theta / fall_off : cos_theta;
        irradiance[k] = hits.patch[k] >= 0 ? value : 0.0;
    }
}

}  // namespace kernel::image::KERNEL_INSTRUCTION_SET
