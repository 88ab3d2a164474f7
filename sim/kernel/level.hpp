// Instruction sets: sources in levelled/ are compiled once a set, each into a namespace of that name. What they
// include must be small enough to vanish by inlining, or static: a copy that the linker may share between sources
// could end up compiled for an instruction set that the processor lacks.
#pragma once

namespace kernel {

enum class Level { baseline, avx2, avx512, avx512vbmi };

// The level in use: the best one that this processor has, unless a test has chosen a lower one.
Level level();
Level best_level();
void set_level(Level wanted);

}  // namespace kernel

// Declares a levelled function under every level's namespace.
#ifdef KERNEL_X86
#define KERNEL_DECLARE(declaration)        \
    namespace baseline { declaration; }    \
    namespace avx2 { declaration; }        \
    namespace avx512 { declaration; }      \
    namespace avx512vbmi { declaration; }
// Calls a levelled function at the level in use.
#define KERNEL_CALL(call)                           \
    (level() == Level::avx512vbmi ? avx512vbmi::call \
     : level() == Level::avx512   ? avx512::call     \
     : level() == Level::avx2     ? avx2::call       \
                                  : baseline::call)
#else
#define KERNEL_DECLARE(declaration) namespace baseline { declaration; }
#define KERNEL_CALL(call) (baseline::call)
#endif
