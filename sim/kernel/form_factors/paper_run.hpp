// The paper's quadrature for one patch against many.
#pragma once
#include <cstdint>

#include "instruction_set.hpp"

namespace kernel {

constexpr int SAMPLES = 9;

// Sample points of n patches, one array of n for each sample and coordinate, and their planes.
struct Samples {
    std::int64_t n;
    const double *x, *y, *z;              // [sample][patch]
    const double *nx, *ny, *nz, *offset;  // [patch]: unit normal, and normal . point of the plane
};

// out[j - begin] = sum over the 81 sample pairs of (r cos) (r cos') / r^4, for patches j in begin ... end - 1.
KERNEL_DECLARE(void paper_row(const Samples &s, std::int64_t i, std::int64_t begin, std::int64_t end, double *out))

}  // namespace kernel
