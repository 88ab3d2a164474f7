// One tile of a symmetric product.
#pragma once
#include <cstdint>

#include "instruction_set.hpp"

namespace kernel {

struct Tile {
    std::int64_t row_begin, row_end, column_begin, column_end;
};

// K = diag(areas) F, above the diagonal, both ways: out_i += K_ij x_j and out_j += K_ij x_i.
KERNEL_DECLARE(void product_tile(const double *F, const double *areas, std::int64_t n, const double *x, double *out,
                                 Tile tile))
KERNEL_DECLARE(void product_tile(const float *F, const double *areas, std::int64_t n, const double *x, double *out,
                                 Tile tile))

}  // namespace kernel
