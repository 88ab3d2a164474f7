// Crosses through the worst of sampled entries, and the smallest rank that is as good.
#include "compressed/cross_approximation.hpp"

#include <algorithm>
#include <cstdint>

namespace kernel::compressed {
namespace {

struct Sample {
    int row, column;
    double residual;
};

// SplitMix64: the same entries on every run.
struct Random {
    std::uint64_t state;
    int below(int n) {
        std::uint64_t z = (state += 0x9e3779b97f4a7c15ULL);
        z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ULL;
        z = (z ^ (z >> 27)) * 0x94d049bb133111ebULL;
        return static_cast<int>((z ^ (z >> 31)) % static_cast<std::uint64_t>(n));
    }
};

double inner(const double *a, const double *b, int n) {
    double sum[4] = {0, 0, 0, 0};
    int k = 0;
    for (; k + 4 <= n; k += 4)
        for (int lane = 0; lane < 4; ++lane) sum[lane] += a[k + lane] * b[k + lane];
    for (; k < n; ++k) sum[0] += a[k] * b[k];
    return (sum[0] + sum[1]) + (sum[2] + sum[3]);
}

void subtract(double *from, const double *what, double times, int n) {
    for (int k = 0; k < n; ++k) from[k] -= times * what[k];
}

int largest(const std::vector<double> &x) {
    int best = 0;
    for (std::size_t k = 1; k < x.size(); ++k)
        if (std::abs(x[k]) > std::abs(x[best])) best = static_cast<int>(k);
    return best;
}

class Crosses {
   public:
    Crosses(const Pairs &pairs, const BlockRange &block, const std::vector<int> &candidates, int samples)
        : pairs_(pairs), block_(block), candidates_(candidates), row_(block.columns()), column_(block.rows()) {
        Random random{static_cast<std::uint64_t>(block.row_begin) << 32 | static_cast<std::uint32_t>(block.column_begin)};
        samples_.resize(samples);
        for (Sample &s : samples_) {
            s.row = random.below(block.rows()), s.column = random.below(block.columns());
            s.residual = pairs.value(block.row_begin + s.row, block.column_begin + s.column, candidates);
        }
    }

    double error() const {
        double sum = 0;
        for (const Sample &s : samples_) sum += s.residual * s.residual;
        return std::sqrt(sum / samples_.size() * block_.rows() * double(block_.columns()));
    }

    void add_cross(LowRank &out) {
        const auto worst = std::max_element(samples_.begin(), samples_.end(), [](const Sample &a, const Sample &b) {
            return std::abs(a.residual) < std::abs(b.residual);
        });
        const int rows = block_.rows(), columns = block_.columns();
        residual_row(out, worst->row);
        const int at = largest(row_);
        residual_column(out, at);
        const double pivot = column_[worst->row];
        for (double &x : column_) x /= pivot;
        out.left.insert(out.left.end(), column_.begin(), column_.end());
        out.right.insert(out.right.end(), row_.begin(), row_.end());
        ++out.rank;
        const double *left = &out.left[std::size_t(out.rank - 1) * rows];
        const double *right = &out.right[std::size_t(out.rank - 1) * columns];
        for (Sample &s : samples_) s.residual -= left[s.row] * right[s.column];
    }

   private:
    const Pairs &pairs_;
    const BlockRange &block_;
    const std::vector<int> &candidates_;
    std::vector<Sample> samples_;
    std::vector<double> row_, column_;

    void residual_row(const LowRank &done, int row) {
        const int rows = block_.rows(), columns = block_.columns();
        pairs_.row(block_.row_begin + row, block_.column_begin, block_.column_end, candidates_, row_.data());
        for (int k = 0; k < done.rank; ++k)
            subtract(row_.data(), &done.right[std::size_t(k) * columns], done.left[std::size_t(k) * rows + row], columns);
    }

    void residual_column(const LowRank &done, int column) {
        const int rows = block_.rows(), columns = block_.columns();
        pairs_.row(block_.column_begin + column, block_.row_begin, block_.row_end, candidates_, column_.data());
        for (int k = 0; k < done.rank; ++k)
            subtract(column_.data(), &done.left[std::size_t(k) * rows], done.right[std::size_t(k) * columns + column],
                     rows);
    }
};

// Orthonormal rows by Gram and Schmidt, twice; r[k][m] = coefficient of basis m in the old row k.
std::vector<double> orthogonalise(std::vector<double> &rows, int rank, int n) {
    std::vector<double> r(std::size_t(rank) * rank, 0.0);
    for (int k = 0; k < rank; ++k) {
        double *row = &rows[std::size_t(k) * n];
        for (int pass = 0; pass < 2; ++pass)
            for (int m = 0; m < k; ++m) {
                const double *basis = &rows[std::size_t(m) * n];
                const double c = inner(row, basis, n);
                r[k * rank + m] += c;
                subtract(row, basis, c, n);
            }
        const double length = std::sqrt(inner(row, row, n));
        r[k * rank + k] = length;
        for (int i = 0; i < n; ++i) row[i] = length > 0 ? row[i] / length : 0.0;
    }
    return r;
}

// One-sided Jacobi: turn the columns of core (n x n) until orthogonal, and those of `turn` with them.
void jacobi(std::vector<double> &core, std::vector<double> &turn, int n) {
    for (int sweep = 0; sweep < 30; ++sweep) {
        double off = 0;
        for (int p = 0; p < n; ++p)
            for (int q = p + 1; q < n; ++q) {
                double pp = 0, qq = 0, pq = 0;
                for (int i = 0; i < n; ++i) {
                    const double x = core[i * n + p], y = core[i * n + q];
                    pp += x * x, qq += y * y, pq += x * y;
                }
                if (std::abs(pq) <= 1e-10 * std::sqrt(pp * qq) || pq == 0) continue;
                off = std::max(off, std::abs(pq) / std::sqrt(pp * qq));
                const double zeta = (qq - pp) / (2 * pq);
                const double t = (zeta >= 0 ? 1.0 : -1.0) / (std::abs(zeta) + std::sqrt(1 + zeta * zeta));
                const double c = 1 / std::sqrt(1 + t * t), s = c * t;
                for (std::vector<double> *matrix : {&core, &turn})
                    for (int i = 0; i < n; ++i) {
                        double &x = (*matrix)[i * n + p], &y = (*matrix)[i * n + q];
                        const double old = x;
                        x = c * old - s * y, y = s * old + c * y;
                    }
            }
        if (off < 1e-8) return;
    }
}

// rows_out[k] = sum over m of coefficient[m][kept[k]] basis[m].
std::vector<double> combine(const std::vector<double> &basis, const std::vector<double> &coefficient,
                            const std::vector<int> &kept, int rank, int n) {
    std::vector<double> out(kept.size() * n, 0.0);
    for (std::size_t k = 0; k < kept.size(); ++k)
        for (int m = 0; m < rank; ++m)
            subtract(&out[k * n], &basis[std::size_t(m) * n], -coefficient[m * rank + kept[k]], n);
    return out;
}

}  // namespace

LowRank cross_approximation(const Pairs &pairs, const BlockRange &block, const std::vector<int> &candidates,
                            double tolerance, int rank_limit, int samples) {
    LowRank out;
    Crosses crosses(pairs, block, candidates, samples);
    double error = crosses.error();
    while (error > tolerance && out.rank < rank_limit) {
        crosses.add_cross(out);
        error = crosses.error();
    }
    out.reached = error <= tolerance;
    return out;
}

void recompress(LowRank &block, double tolerance) {
    const int rank = block.rank;
    if (rank < 2) return;
    const int rows = static_cast<int>(block.left.size()) / rank, columns = static_cast<int>(block.right.size()) / rank;
    const std::vector<double> a = orthogonalise(block.left, rank, rows), b = orthogonalise(block.right, rank, columns);
    // Block = left^T (a^T b) right: turn the columns of core until they are orthogonal, largest first.
    std::vector<double> core(std::size_t(rank) * rank, 0.0), turn(core.size(), 0.0);
    for (int i = 0; i < rank; ++i) {
        turn[i * rank + i] = 1;
        for (int j = 0; j < rank; ++j)
            for (int k = 0; k < rank; ++k) core[i * rank + j] += a[k * rank + i] * b[k * rank + j];
    }
    jacobi(core, turn, rank);
    std::vector<std::pair<double, int>> squares(rank);
    for (int j = 0; j < rank; ++j) {
        squares[j] = {0, j};
        for (int i = 0; i < rank; ++i) squares[j].first += core[i * rank + j] * core[i * rank + j];
    }
    std::sort(squares.rbegin(), squares.rend());
    double dropped = 0;
    int kept_rank = rank;
    while (kept_rank > 0 && dropped + squares[kept_rank - 1].first <= tolerance * tolerance)
        dropped += squares[--kept_rank].first;
    std::vector<int> kept;
    for (int k = 0; k < kept_rank; ++k) kept.push_back(squares[k].second);
    block.left = combine(block.left, core, kept, rank, rows);
    block.right = combine(block.right, turn, kept, rank, columns);
    block.rank = kept_rank;
}

}  // namespace kernel::compressed
