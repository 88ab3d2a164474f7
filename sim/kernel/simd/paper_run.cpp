// Patches are flat: r cos is the height of one sample over the other patch's plane, so that the 81 pairs of
// samples need 18 heights and one division each.
#include "form_factors/paper_run.hpp"

namespace kernel::KERNEL_INSTRUCTION_SET {

namespace {

// Heights below count as none [m]: the paper's samples of one wall, of some metres, lie in its plane to 1e-15.
constexpr double LEAST_HEIGHT = 1e-9;

inline double positive(double height) { return height > LEAST_HEIGHT ? height : 0.0; }

}  // namespace

void paper_row(const Samples &s, std::int64_t i, std::int64_t begin, std::int64_t end, double *out) {
    double px[SAMPLES], py[SAMPLES], pz[SAMPLES];
    for (int k = 0; k < SAMPLES; ++k) px[k] = s.x[k * s.n + i], py[k] = s.y[k * s.n + i], pz[k] = s.z[k * s.n + i];
    const double nx = s.nx[i], ny = s.ny[i], nz = s.nz[i], offset = s.offset[i];
#pragma omp simd
    for (std::int64_t j = begin; j < end; ++j) {
        double over_j[SAMPLES];
        for (int k = 0; k < SAMPLES; ++k)
            over_j[k] = positive(s.nx[j] * px[k] + s.ny[j] * py[k] + s.nz[j] * pz[k] - s.offset[j]);
        double total = 0;
        for (int q = 0; q < SAMPLES; ++q) {
            const double x = s.x[q * s.n + j], y = s.y[q * s.n + j], z = s.z[q * s.n + j];
            const double over_i = positive(nx * x + ny * y + nz * z - offset);
            double sum = 0;
            for (int k = 0; k < SAMPLES; ++k) {
                const double dx = x - px[k], dy = y - py[k], dz = z - pz[k];
                const double r2 = dx * dx + dy * dy + dz * dz;
                // Samples that coincide lie in both planes: nothing is exchanged between them.
                sum += over_j[k] / (r2 > 0 ? r2 * r2 : 1.0);
            }
            total += over_i * sum;
        }
        out[j - begin] = total;
    }
}

}  // namespace kernel::KERNEL_INSTRUCTION_SET
