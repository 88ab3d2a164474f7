// Which instruction set the functions of simd/ run at.
#include "instruction_set.hpp"

#include <stdexcept>

namespace kernel {

InstructionSet best_instruction_set() {
#ifdef KERNEL_X86
    __builtin_cpu_init();
    const bool avx2 = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
    const bool avx512 = avx2 && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
                        __builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512bw");
    if (avx512 && __builtin_cpu_supports("avx512vbmi")) return InstructionSet::avx512vbmi;
    return avx512 ? InstructionSet::avx512 : avx2 ? InstructionSet::avx2 : InstructionSet::baseline;
#else
    return InstructionSet::baseline;
#endif
}

namespace {
InstructionSet in_use = best_instruction_set();
}

InstructionSet instruction_set() { return in_use; }

void set_instruction_set(InstructionSet wanted) {
    if (wanted > best_instruction_set()) throw std::invalid_argument("this processor lacks that instruction set");
    in_use = wanted;
}

}  // namespace kernel
