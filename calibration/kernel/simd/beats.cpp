// Some pixels at a time: phases, then coordinates; every operation rounds as numpy's.
#include "beats.hpp"

#include <algorithm>
#include <cmath>

namespace kernel::KERNEL_INSTRUCTION_SET {
namespace {

constexpr float TURN = 6.2831853071795864769f;
constexpr float LARGE = 12582912.0f;  // 1.5 * 2^23: what is added to it is rounded to whole numbers

constexpr float LEAST = 1e-30f;

inline float smaller(float a, float b) { return b < a ? b : a; }
inline float larger(float a, float b) { return a < b ? b : a; }
inline float one_if(bool is) { return is ? 1.0f : 0.0f; }

inline float rounded(float x) { return (x + LARGE) - LARGE; }

inline float whole_below(float x) {
    const float near = rounded(x);
    return near - one_if(near > x);
}

inline float fraction(float x) { return x - whole_below(x); }

// Cycles of which the fraction is known, and the whole number about.
inline float counted(float fraction, float about) { return fraction + rounded(about - fraction); }

// Angle of (x, y) in turns, 0 ... 1, within 2e-7. The polynomial is the least-squares fit of atan(t) / t over t*t
// at Chebyshev's points of 0 ... 1.
inline float turns(float y, float x) {
    const float ax = std::fabs(x), ay = std::fabs(y);
    const float t = smaller(ax, ay) / larger(larger(ax, ay), LEAST), s = t * t;
    float p = 0.0028340643f;
    p = p * s - 0.0160050305f;
    p = p * s + 0.0425876075f;
    p = p * s - 0.0749544544f;
    p = p * s + 0.106367541f;
    p = p * s - 0.142025705f;
    p = p * s + 0.199924836f;
    p = p * s - 0.333330668f;
    p = p * s + 0.999999984f;
    float angle = p * t;
    // By numbers, not by choices: of these the compiler makes branches, and no vectors.
    angle += one_if(ax < ay) * (0.25f * TURN - 2.0f * angle);
    angle += one_if(x < 0.0f) * (0.5f * TURN - 2.0f * angle);
    angle += one_if(y < 0.0f) * (TURN - 2.0f * angle);
    return angle * (1.0f / TURN);
}

constexpr int BLOCK = 1024;  // pixels, whose seven planes stay in the first-level cache
constexpr int APART = BLOCK + 48;

struct Block {
    float turns[FREQUENCIES][APART], twice_amplitude[FREQUENCIES][APART], noise[APART];
};

template <class T>
void find_phase(const T *const *frames, std::int64_t from, int n, float *__restrict phase,
                float *__restrict twice_amplitude) {
    const T *__restrict i0 = frames[0] + from, *__restrict i1 = frames[1] + from;
    const T *__restrict i2 = frames[2] + from, *__restrict i3 = frames[3] + from;
    for (int i = 0; i < n; ++i) {
        const float x = static_cast<float>(i0[i]) - static_cast<float>(i2[i]);
        const float y = static_cast<float>(i1[i]) - static_cast<float>(i3[i]);
        phase[i] = turns(y, x);
        twice_amplitude[i] = std::sqrt(x * x + y * y);
    }
}

template <class T>
void place(const Beats<T> &w, std::int64_t from, int n, const Block &block) {
    const float *__restrict a = block.turns[0], *__restrict b = block.turns[1], *__restrict c = block.turns[2];
    const float *__restrict amplitude = block.twice_amplitude[0], *__restrict noise = block.noise;
    float *__restrict position = w.position + from, *__restrict sigma = w.sigma + from;
    float *__restrict misfit = w.misfit + from;
    std::uint8_t *__restrict ambiguous = w.ambiguous + from;
    const float noise_per_turn = 1.41421356237309505f / TURN, beyond = w.period_px[1] / 2;
    const float slow = w.slow, fast = w.fast, range = w.range_px, most = w.most_apart_px2, scale = w.sigma_px;
    const float pa = w.period_px[0], pb = w.period_px[1], pc = w.period_px[2], mean = w.mean_period_px;
    const float wa = w.weight[0], wb = w.weight[1], wc = w.weight[2];
    for (int i = 0; i < n; ++i) {
        const float beat_low = fraction(b[i] - a[i]), beat_high = fraction(c[i] - b[i]);
        float share = counted(beat_low, slow * fraction(beat_high - beat_low)) / slow;
        share = counted(fraction(c[i] - a[i]), fast * share) / fast;
        const float about = share * range;
        const float xa = counted(a[i], about / pa) * pa, xb = counted(b[i], about / pb) * pb;
        const float xc = counted(c[i], about / pc) * pc;
        const float x = xa * wa + xb * wb + xc * wc;
        const float apart = (xa - x) * (xa - x) + (xb - x) * (xb - x) + (xc - x) * (xc - x);
        const float angle = noise[i] * noise_per_turn / amplitude[i];
        position[i] = x - range * whole_below((x + beyond) / range);
        sigma[i] = angle * scale;
        misfit[i] = apart / (2.0f * ((angle * mean) * (angle * mean)) + 1e-6f);
        ambiguous[i] = apart > most;
    }
}

void keep_least(float *__restrict least, const float *__restrict other, int n) {
    for (int i = 0; i < n; ++i) least[i] = smaller(least[i], other[i]);
}

template <class T>
void read(const Beats<T> &work) {
    Block block;
    for (std::int64_t from = 0; from < work.pixels; from += BLOCK) {
        const int n = static_cast<int>(std::min<std::int64_t>(BLOCK, work.pixels - from));
        for (int k = 0; k < FREQUENCIES; ++k)
            find_phase(work.frames + k * STEPS, from, n, block.turns[k], block.twice_amplitude[k]);
        for (int k = 1; k < FREQUENCIES; ++k) keep_least(block.twice_amplitude[0], block.twice_amplitude[k], n);
        if (work.one_noise)
            std::fill_n(block.noise, n, *work.noise);
        else
            std::copy_n(work.noise + from, n, block.noise);
        place(work, from, n, block);
    }
}

}  // namespace

void read_beats(const Beats<std::uint8_t> &work) { read(work); }
void read_beats(const Beats<std::uint16_t> &work) { read(work); }
void read_beats(const Beats<float> &work) { read(work); }

}  // namespace kernel::KERNEL_INSTRUCTION_SET
