// What every native module of this package lets Python ask of its instruction sets.
#pragma once
#include <nanobind/nanobind.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <iterator>
#include <stdexcept>
#include <string>
#include <vector>

#include "instruction_set.hpp"

namespace kernel {

inline const char *const NAMES[] = {"baseline", "avx2", "avx512", "avx512vbmi"};

inline std::string name_of(InstructionSet set) { return NAMES[static_cast<int>(set)]; }

inline void choose_instruction_set(const std::string &name) {
    std::string all;
    for (std::size_t k = 0; k < std::size(NAMES); ++k) {
        if (name == NAMES[k]) return set_instruction_set(static_cast<InstructionSet>(k));
        all += (k ? ", " : "") + std::string(NAMES[k]);
    }
    throw std::invalid_argument("unknown instruction set " + name + "; there are " + all);
}

// Those that this processor has.
inline std::vector<std::string> instruction_sets() {
    return {NAMES, NAMES + static_cast<int>(best_instruction_set()) + 1};
}

inline void bind_instruction_set(nanobind::module_ &m) {
    m.def("instruction_set", [] { return name_of(instruction_set()); });
    m.def("best_instruction_set", [] { return name_of(best_instruction_set()); });
    m.def("instruction_sets", &instruction_sets);
    m.def("set_instruction_set", &choose_instruction_set, nanobind::arg("name"));
}

}  // namespace kernel
