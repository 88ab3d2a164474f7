// Gauss and Legendre's rules on [0, 1].
#pragma once

namespace kernel {

constexpr int MOST_POINTS = 20;

struct GaussRule {
    int n;
    double node[MOST_POINTS], weight[MOST_POINTS];
};

const GaussRule &gauss_rule(int n);  // 1 ... MOST_POINTS

}  // namespace kernel
