#include "arrays.hpp"
#include "bindings.hpp"

void bind_solve(nb::module_ &m) { (void)m; }
