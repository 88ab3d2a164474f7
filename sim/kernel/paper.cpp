#include "arrays.hpp"
#include "bindings.hpp"

void bind_paper(nb::module_ &m) { (void)m; }
