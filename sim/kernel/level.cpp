// Which instruction set the levelled kernels run at.
#include "level.hpp"

#include <stdexcept>

namespace kernel {

Level best_level() {
#ifdef KERNEL_X86
    __builtin_cpu_init();
    const bool avx2 = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
    const bool avx512 = avx2 && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
                        __builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512bw");
    if (avx512 && __builtin_cpu_supports("avx512vbmi")) return Level::avx512vbmi;
    return avx512 ? Level::avx512 : avx2 ? Level::avx2 : Level::baseline;
#else
    return Level::baseline;
#endif
}

namespace {
Level in_use = best_level();
}

Level level() { return in_use; }

void set_level(Level wanted) {
    if (wanted > best_level()) throw std::invalid_argument("this processor lacks that instruction set");
    in_use = wanted;
}

}  // namespace kernel
