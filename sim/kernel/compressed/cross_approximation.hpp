// Adaptive cross approximation of one block to an absolute Frobenius tolerance, judged on sampled entries.
#pragma once
#include <vector>

#include "compressed/pairs.hpp"

namespace kernel::compressed {

struct LowRank {
    bool reached = false;
    int rank = 0;
    std::vector<double> left, right;  // (rank, rows) and (rank, columns): block ~ left^T right
};

struct BlockRange {
    int row_begin, row_end, column_begin, column_end;
    int rows() const { return row_end - row_begin; }
    int columns() const { return column_end - column_begin; }
};

// Crosses (Bebendorf 2000) through the worst of a fixed set of random entries, until their mean square error says
// that the block's Frobenius error is below the tolerance, or the rank reaches its limit.
LowRank cross_approximation(const Pairs &pairs, const BlockRange &block, const std::vector<int> &candidates,
                            double tolerance, int rank_limit, int samples);

// Orthogonalise, and drop what is below the tolerance: the smallest rank for it.
void recompress(LowRank &block, double tolerance);

}  // namespace kernel::compressed
