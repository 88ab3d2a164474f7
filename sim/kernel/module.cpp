// sim._kernel: what Python sees. Each source binds its own functions; sim/_kernel.pyi states their types.
#include <omp.h>

#include "arrays.hpp"
#include "bind_instruction_set.hpp"
#include "bindings.hpp"

NB_MODULE(_kernel, m) {
    kernel::bind_instruction_set(m);
    m.def("threads", [] { return omp_get_max_threads(); });
    m.def("set_threads", [](int n) { omp_set_num_threads(n); }, nb::arg("n"));
    bind_closed_form(m);
    bind_paper(m);
    bind_polygon(m);
    bind_occlusion(m);
    bind_compressed(m);
    bind_sampling(m);
    bind_sixteenths(m);
    bind_exchange(m);
    bind_sparse(m);
    bind_solve(m);
    bind_image(m);
    bind_frame(m);
}
