// Instruction sets: sources in simd/ are compiled once for each, into a namespace of its name. What they include
// must be small enough to vanish by inlining, or static: a copy that the linker may share between sources could end
// up compiled for an instruction set that the processor lacks.
#pragma once

namespace kernel {

enum class InstructionSet { baseline, avx2, avx512, avx512vbmi };

// The one in use: the best that this processor has, unless a test has chosen a lower one.
InstructionSet instruction_set();
InstructionSet best_instruction_set();
void set_instruction_set(InstructionSet wanted);

}  // namespace kernel

// Declares a function of simd/ under every instruction set's namespace.
#ifdef KERNEL_X86
#define KERNEL_DECLARE(declaration)        \
    namespace baseline { declaration; }    \
    namespace avx2 { declaration; }        \
    namespace avx512 { declaration; }      \
    namespace avx512vbmi { declaration; }
// Calls it at the instruction set in use.
#define KERNEL_CALL(call)                                               \
    (instruction_set() == InstructionSet::avx512vbmi ? avx512vbmi::call \
     : instruction_set() == InstructionSet::avx512   ? avx512::call     \
     : instruction_set() == InstructionSet::avx2     ? avx2::call       \
                                                     : baseline::call)
#else
#define KERNEL_DECLARE(declaration) namespace baseline { declaration; }
#define KERNEL_CALL(call) (baseline::call)
#endif
