// Counting rays, and weighing what both patches of a pair have counted.
#include "sampling/exchange.hpp"

#include <algorithm>

namespace kernel::sampling {
namespace {

// Rows between two looks at the keyboard.
constexpr std::int64_t LOOK = 256;

bool stopped(std::int64_t row, Interruption &interruption) { return row % LOOK == 0 && interruption.stopped(); }

// Room for entries that is not filled with zeros first.
void make_room(Counts &counts, std::int64_t entries) {
    counts.columns.reset(new std::int32_t[entries]);
    counts.counts.reset(new std::int32_t[entries]);
}

}  // namespace

Counts counted(const std::vector<Batch> &batches, std::int64_t n, Interruption &interruption) {
    std::int64_t rays = 0, entry = 0;
    for (const Batch &batch : batches) rays += batch.n * batch.rays;
    Counts out;
    make_room(out, rays);
    out.starts.assign(n + 1, 0);
    std::vector<std::int32_t> seen(n, 0);
    std::vector<std::int64_t> next(batches.size(), 0);
    for (std::int64_t row = 0; row < n; ++row) {
        if (stopped(row, interruption)) return {};
        for (std::size_t k = 0; k < batches.size(); ++k) {
            const Batch &batch = batches[k];
            if (next[k] == batch.n || batch.rows[next[k]] != row) continue;
            const std::int32_t *met = batch.met + batch.rays * next[k]++;
            for (std::int64_t ray = 0; ray < batch.rays; ++ray)
                if (met[ray] >= 0 && seen[met[ray]]++ == 0) out.columns[entry++] = met[ray];
        }
        for (std::int64_t k = out.starts[row]; k < entry; ++k) {
            out.counts[k] = seen[out.columns[k]];
            seen[out.columns[k]] = 0;
        }
        out.starts[row + 1] = entry;
    }
    return out;
}

Counts transposed(const Counts &of, Interruption &interruption) {
    const auto n = static_cast<std::int64_t>(of.starts.size()) - 1;
    Counts out;
    out.starts.assign(n + 1, 0);
    make_room(out, of.starts[n]);
    for (std::int64_t k = 0; k < of.starts[n]; ++k) ++out.starts[of.columns[k] + 1];
    for (std::int64_t row = 0; row < n; ++row) out.starts[row + 1] += out.starts[row];
    std::vector<std::int64_t> place(out.starts.begin(), out.starts.end() - 1);
    for (std::int64_t row = 0; row < n; ++row) {
        if (stopped(row, interruption)) return {};
        for (std::int64_t k = of.starts[row]; k < of.starts[row + 1]; ++k) {
            const std::int64_t to = place[of.columns[k]]++;
            out.columns[to] = static_cast<std::int32_t>(row);
            out.counts[to] = of.counts[k];
        }
    }
    return out;
}

std::int64_t weighed(const std::vector<Batch> &batches, const double *density, std::int64_t n, const ExchangeAreas &out,
                     Interruption &interruption) {
    const Counts own = counted(batches, n, interruption);
    if (own.starts.empty()) return 0;
    const Counts others = transposed(own, interruption);
    if (others.starts.empty()) return 0;
    std::vector<std::int32_t> seen(n, 0);
    std::int64_t entry = 0;
    for (std::int64_t row = 0; row < n; ++row) {
        if (stopped(row, interruption)) return 0;
        double told = 0, by_others = 0, met = 0;
        const auto add = [&](std::int32_t column, std::int32_t count) {
            const double dense = density[row] + density[column], value = count / dense;
            out.columns[entry] = column;
            out.values[entry++] = value;
            told += value;
            by_others += value * density[column] / dense;
        };
        out.starts[row] = entry;
        for (std::int64_t k = own.starts[row]; k < own.starts[row + 1]; ++k) seen[own.columns[k]] = own.counts[k];
        for (std::int64_t k = others.starts[row]; k < others.starts[row + 1]; ++k) {
            add(others.columns[k], others.counts[k] + seen[others.columns[k]]);
            seen[others.columns[k]] = 0;
        }
        for (std::int64_t k = own.starts[row]; k < own.starts[row + 1]; ++k) {
            const std::int32_t column = own.columns[k];
            met += own.counts[k];
            if (seen[column]) add(column, own.counts[k]);
            seen[column] = 0;
        }
        out.by_others[row] = told > 0 ? by_others / told : 0;
        out.met[row] = met;
    }
    out.starts[n] = entry;
    return entry;
}

}  // namespace kernel::sampling
