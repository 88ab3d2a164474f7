// sim._kernel: what Python sees. Each source binds its own functions; sim/_kernel.pyi states their types.
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>
#include <omp.h>

#include <iterator>
#include <stdexcept>
#include <string>
#include <vector>

#include "arrays.hpp"
#include "bindings.hpp"
#include "instruction_set.hpp"

namespace {

const char *NAMES[] = {"baseline", "avx2", "avx512", "avx512vbmi"};

std::string name_of(kernel::InstructionSet set) { return NAMES[static_cast<int>(set)]; }

void set_instruction_set(const std::string &name) {
    std::string all;
    for (std::size_t k = 0; k < std::size(NAMES); ++k) {
        if (name == NAMES[k]) return kernel::set_instruction_set(static_cast<kernel::InstructionSet>(k));
        all += (k ? ", " : "") + std::string(NAMES[k]);
    }
    throw std::invalid_argument("unknown instruction set " + name + "; there are " + all);
}

// Those that this processor has.
std::vector<std::string> instruction_sets() {
    return {NAMES, NAMES + static_cast<int>(kernel::best_instruction_set()) + 1};
}

}  // namespace

NB_MODULE(_kernel, m) {
    m.def("instruction_set", [] { return name_of(kernel::instruction_set()); });
    m.def("best_instruction_set", [] { return name_of(kernel::best_instruction_set()); });
    m.def("instruction_sets", &instruction_sets);
    m.def("set_instruction_set", &set_instruction_set, nb::arg("name"));
    m.def("threads", [] { return omp_get_max_threads(); });
    m.def("set_threads", [](int n) { omp_set_num_threads(n); }, nb::arg("n"));
    bind_closed_form(m);
    bind_paper(m);
    bind_polygon(m);
    bind_occlusion(m);
    bind_compressed(m);
    bind_sampling(m);
    bind_solve(m);
    bind_image(m);
    bind_frame(m);
}
