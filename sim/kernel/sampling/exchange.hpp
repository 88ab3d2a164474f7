// Exchange areas that rays have counted: K_ij = (c_ij + c_ji) / (nu_i + nu_j), c rays of i that meet j, nu rays a square
// metre. A transposition of all counts at once tells each row what others' rays say of it. Rows are shared among threads;
// the result does not depend on their number.
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

// Rows of a sparse matrix of whole numbers, each with room for more: `sizes` of it are entries.
struct Counts {
    std::vector<std::int64_t> starts, sizes;
    std::unique_ptr<std::int32_t[]> columns, counts;
};

// Where K is written to.
struct ExchangeAreas {
    std::int64_t *starts;  // n + 1
    std::int32_t *columns;
    double *values;     // [m²]
    double *by_others;  // n shares of a row that others' rays tell
    double *met;        // n: rays of each patch that meet something
};

class RayCounts {
  public:
    // Empty where it was interrupted.
    RayCounts(const std::vector<Batch> &batches, std::int64_t n, Interruption &interruption);

    // Entries of K.
    std::int64_t entries() const { return starts_.back(); }
    std::int64_t rows() const { return static_cast<std::int64_t>(starts_.size()) - 1; }

    // `density`: nu. Each row has others' counts, ascending, before those that only its own rays tell.
    void weigh(const double *density, const ExchangeAreas &out, Interruption &interruption) const;

  private:
    Counts own_, others_;
    std::vector<std::int64_t> starts_;  // of K, n + 1
};

}  // namespace kernel::sampling
