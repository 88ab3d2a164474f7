// Exchange areas that rays have counted: K_ij = (c_ij + c_ji) / (nu_i + nu_j), c rays of i that meet j, nu rays a square
// metre. A transposition of all counts at once tells each row what others' rays say of it.
#pragma once
#include <cstdint>
#include <memory>
#include <vector>

#include "interrupt.hpp"

namespace kernel::sampling {

// Rays of some patches, ascending, as many of each: what they meet, below 0 nothing that sends light.
struct Batch {
    const std::int64_t *rows;
    std::int64_t n;
    const std::int32_t *met;
    std::int64_t rays;
};

// Rows of a sparse matrix of whole numbers; none (no starts) where the making of it was interrupted.
struct Counts {
    std::vector<std::int64_t> starts;
    std::unique_ptr<std::int32_t[]> columns, counts;
};

// Counts of n patches, each row in the order in which its rays first meet others.
Counts counted(const std::vector<Batch> &batches, std::int64_t n, Interruption &interruption);

// Rows of the transposed matrix, ascending.
Counts transposed(const Counts &of, Interruption &interruption);

// Where K is written to: at most twice as many entries as there are rays that meet something.
struct ExchangeAreas {
    std::int64_t *starts;  // n + 1
    std::int32_t *columns;
    double *values;     // [m²]
    double *by_others;  // n shares of a row that others' rays tell
    double *met;        // n: rays of each patch that meet something
};

// Returns the number of entries; none where it was interrupted.
std::int64_t weighed(const std::vector<Batch> &batches, const double *density, std::int64_t n, const ExchangeAreas &out,
                     Interruption &interruption);

}  // namespace kernel::sampling
