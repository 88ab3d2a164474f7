// Long loops of the kernel can be ended from the keyboard: the calling thread asks the interpreter, the others a flag.
#pragma once
#include <nanobind/nanobind.h>
#include <omp.h>

#include <atomic>
#include <chrono>

namespace kernel {

// One for a loop. Every iteration asks stopped() and does nothing where it says so; after the loop, outside of it,
// finish() raises what the signal's handler raised. With or without the lock of the interpreter.
class Interruption {
  public:
    bool stopped() {
        if (omp_get_thread_num() == 0 && !stop_) ask();
        return stop_;
    }

    void finish() {
        if (!stop_) return;
        nanobind::gil_scoped_acquire locked;
        throw nanobind::python_error();
    }

  private:
    using Clock = std::chrono::steady_clock;
    // Rare enough to cost nothing, often enough for the half second in which a program is to end.
    static constexpr std::chrono::milliseconds EVERY{50};

    void ask() {
        const auto now = Clock::now();
        if (now < next_) return;
        next_ = now + EVERY;
        nanobind::gil_scoped_acquire locked;
        if (PyErr_CheckSignals() != 0) stop_ = true;
    }

    std::atomic<bool> stop_{false};
    Clock::time_point next_{};  // the first one asks: loops may be short, and many
};

}  // namespace kernel
