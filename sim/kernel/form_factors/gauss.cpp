// Nodes and weights of Gauss and Legendre's rules.
#include "form_factors/gauss.hpp"

#include <array>

#include "geometry/vectors.hpp"

namespace kernel {
namespace {

// Newton's method on the Legendre polynomial, from Tricomi's guess: five steps reach roundoff.
GaussRule make_rule(int n) {
    GaussRule rule{n, {}, {}};
    for (int k = 0; k < n; ++k) {
        double x = std::cos(PI * (k + 0.75) / (n + 0.5)), slope = 1;
        for (int step = 0; step < 10; ++step) {
            double before = 1, value = x;
            for (int m = 2; m <= n; ++m) {
                const double next = ((2 * m - 1) * x * value - (m - 1) * before) / m;
                before = value;
                value = next;
            }
            slope = n * (x * value - before) / (x * x - 1);
            x -= value / slope;
        }
        rule.node[k] = 0.5 * (1 - x);
        rule.weight[k] = 1 / ((1 - x * x) * slope * slope);
    }
    return rule;
}

std::array<GaussRule, MOST_POINTS + 1> make_rules() {
    std::array<GaussRule, MOST_POINTS + 1> rules{};
    for (int n = 1; n <= MOST_POINTS; ++n) rules[n] = make_rule(n);
    return rules;
}

}  // namespace

const GaussRule &gauss_rule(int n) {
    static const std::array<GaussRule, MOST_POINTS + 1> rules = make_rules();
    return rules[n];
}

}  // namespace kernel
