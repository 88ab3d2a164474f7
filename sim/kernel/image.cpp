#include "arrays.hpp"
#include "bindings.hpp"

void bind_image(nb::module_ &m) { (void)m; }
