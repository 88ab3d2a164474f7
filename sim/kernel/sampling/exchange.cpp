// Counting rays, and weighing what both patches of a pair have counted.
#include "sampling/exchange.hpp"

#include <algorithm>
#include <numeric>

namespace kernel::sampling {
namespace {

// Rows that a thread takes at a time.
constexpr int ROWS = 32;
// Parts of the rows that are transposed side by side: as many on any number of threads.
constexpr std::int64_t PARTS = 16;

// Room for entries that is not filled with zeros first.
void make_room(Counts &counts, std::int64_t entries) {
    counts.columns.reset(new std::int32_t[entries]);
    counts.counts.reset(new std::int32_t[entries]);
}

// Where each row's rays lie: all batches that have some, a row after the other.
struct RowRays {
    struct Piece {
        const std::int32_t *met;
        std::int64_t rays;
    };
    std::vector<std::int64_t> starts;  // of the pieces, n + 1
    std::vector<Piece> pieces;
};

RowRays by_rows(const std::vector<Batch> &batches, std::int64_t n) {
    RowRays out;
    out.starts.assign(n + 1, 0);
    for (const Batch &batch : batches)
        for (std::int64_t k = 0; k < batch.n; ++k) ++out.starts[batch.rows[k] + 1];
    std::partial_sum(out.starts.begin(), out.starts.end(), out.starts.begin());
    out.pieces.resize(out.starts[n]);
    std::vector<std::int64_t> place(out.starts.begin(), out.starts.end() - 1);
    for (const Batch &batch : batches)
        for (std::int64_t k = 0; k < batch.n; ++k)
            out.pieces[place[batch.rows[k]]++] = {batch.met + batch.rays * k, batch.rays};
    return out;
}

// Each row in the order in which its rays first meet others.
Counts counted(const std::vector<Batch> &batches, std::int64_t n, Interruption &interruption) {
    const RowRays rays = by_rows(batches, n);
    Counts out;
    out.starts.assign(n + 1, 0);
    out.sizes.assign(n, 0);
    for (std::int64_t row = 0; row < n; ++row) {
        std::int64_t most = 0;
        for (std::int64_t k = rays.starts[row]; k < rays.starts[row + 1]; ++k) most += rays.pieces[k].rays;
        out.starts[row + 1] = out.starts[row] + most;
    }
    make_room(out, out.starts[n]);
#pragma omp parallel
    {
        std::vector<std::int32_t> seen(n, 0);
#pragma omp for schedule(dynamic, ROWS)
        for (std::int64_t row = 0; row < n; ++row) {
            if (interruption.stopped()) continue;
            std::int32_t *columns = out.columns.get() + out.starts[row], *counts = out.counts.get() + out.starts[row];
            std::int64_t size = 0;
            for (std::int64_t p = rays.starts[row]; p < rays.starts[row + 1]; ++p) {
                const RowRays::Piece &piece = rays.pieces[p];
                for (std::int64_t ray = 0; ray < piece.rays; ++ray)
                    if (piece.met[ray] >= 0 && seen[piece.met[ray]]++ == 0) columns[size++] = piece.met[ray];
            }
            for (std::int64_t k = 0; k < size; ++k) {
                counts[k] = seen[columns[k]];
                seen[columns[k]] = 0;
            }
            out.sizes[row] = size;
        }
    }
    return out;
}

// Rows of the transposed matrix, ascending.
Counts transposed(const Counts &of, Interruption &interruption) {
    const auto n = static_cast<std::int64_t>(of.sizes.size());
    const auto first_row = [n](std::int64_t part) { return n * part / PARTS; };
    std::vector<std::int64_t> place(PARTS * n, 0);  // of each part's next entry, by column
#pragma omp parallel for schedule(dynamic, 1)
    for (std::int64_t part = 0; part < PARTS; ++part)
        for (std::int64_t row = first_row(part); row < first_row(part + 1); ++row)
            for (std::int64_t k = of.starts[row]; k < of.starts[row] + of.sizes[row]; ++k)
                ++place[part * n + of.columns[k]];
    Counts out;
    out.starts.assign(n + 1, 0);
    out.sizes.assign(n, 0);
    std::int64_t entry = 0;
    for (std::int64_t column = 0; column < n; ++column) {
        out.starts[column] = entry;
        for (std::int64_t part = 0; part < PARTS; ++part) {
            const std::int64_t here = place[part * n + column];
            place[part * n + column] = entry;
            entry += here;
        }
        out.sizes[column] = entry - out.starts[column];
    }
    out.starts[n] = entry;
    make_room(out, entry);
#pragma omp parallel for schedule(dynamic, 1)
    for (std::int64_t part = 0; part < PARTS; ++part)
        for (std::int64_t row = first_row(part); row < first_row(part + 1); ++row) {
            if (interruption.stopped()) break;
            for (std::int64_t k = of.starts[row]; k < of.starts[row] + of.sizes[row]; ++k) {
                const std::int64_t to = place[part * n + of.columns[k]]++;
                out.columns[to] = static_cast<std::int32_t>(row);
                out.counts[to] = of.counts[k];
            }
        }
    return out;
}

}  // namespace

RayCounts::RayCounts(const std::vector<Batch> &batches, std::int64_t n, Interruption &interruption)
    : own_(counted(batches, n, interruption)), starts_(n + 1, 0) {
    if (interruption.stopped()) return;
    others_ = transposed(own_, interruption);
    if (interruption.stopped()) return;
#pragma omp parallel
    {
        std::vector<char> seen(n, 0);
#pragma omp for schedule(dynamic, ROWS)
        for (std::int64_t row = 0; row < n; ++row) {
            if (interruption.stopped()) continue;
            const std::int32_t *own = own_.columns.get() + own_.starts[row];
            const std::int32_t *others = others_.columns.get() + others_.starts[row];
            std::int64_t both = 0;
            for (std::int64_t k = 0; k < own_.sizes[row]; ++k) seen[own[k]] = 1;
            for (std::int64_t k = 0; k < others_.sizes[row]; ++k) both += seen[others[k]];
            for (std::int64_t k = 0; k < own_.sizes[row]; ++k) seen[own[k]] = 0;
            starts_[row + 1] = own_.sizes[row] + others_.sizes[row] - both;
        }
    }
    std::partial_sum(starts_.begin(), starts_.end(), starts_.begin());
}

void RayCounts::weigh(const double *density, const ExchangeAreas &out, Interruption &interruption) const {
    const std::int64_t n = rows();
    std::copy(starts_.begin(), starts_.end(), out.starts);
#pragma omp parallel
    {
        std::vector<std::int32_t> seen(n, 0);
#pragma omp for schedule(dynamic, ROWS)
        for (std::int64_t row = 0; row < n; ++row) {
            if (interruption.stopped()) continue;
            std::int64_t entry = starts_[row];
            double told = 0, by_others = 0, met = 0;
            const auto add = [&](std::int32_t column, std::int32_t count) {
                const double dense = density[row] + density[column], value = count / dense;
                out.columns[entry] = column;
                out.values[entry++] = value;
                told += value;
                by_others += value * density[column] / dense;
            };
            const std::int64_t own = own_.starts[row], others = others_.starts[row];
            for (std::int64_t k = own; k < own + own_.sizes[row]; ++k) seen[own_.columns[k]] = own_.counts[k];
            for (std::int64_t k = others; k < others + others_.sizes[row]; ++k) {
                add(others_.columns[k], others_.counts[k] + seen[others_.columns[k]]);
                seen[others_.columns[k]] = 0;
            }
            for (std::int64_t k = own; k < own + own_.sizes[row]; ++k) {
                const std::int32_t column = own_.columns[k];
                met += own_.counts[k];
                if (seen[column]) add(column, own_.counts[k]);
                seen[column] = 0;
            }
            out.by_others[row] = told > 0 ? by_others / told : 0;
            out.met[row] = met;
        }
    }
}

}  // namespace kernel::sampling
