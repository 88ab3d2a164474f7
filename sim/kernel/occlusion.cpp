#include "arrays.hpp"
#include "bindings.hpp"

void bind_occlusion(nb::module_ &m) { (void)m; }
