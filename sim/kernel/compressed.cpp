#include "arrays.hpp"
#include "bindings.hpp"

void bind_compressed(nb::module_ &m) { (void)m; }
