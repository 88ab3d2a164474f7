#include "arrays.hpp"
#include "bindings.hpp"

void bind_polygon(nb::module_ &m) { (void)m; }
