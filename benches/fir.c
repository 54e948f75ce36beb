/* The integrals of the estimator's kernels as FIR filters in optimised C, for comparison with the estimator. The benchmark compiles it
 * with `cc -O3 -march=native -ffast-math`, which lets the compiler reorder sums and fuse multiplications, unlike Rust. */

#include <stddef.h>

enum { KERNELS = 4 };

/* Sums of KERNELS kernels over two signals at once: eight independent sums keep the multipliers busy. */

static void pair(const double *restrict w, size_t n, const double *restrict x, const double *restrict y,
                 double *restrict out)
{
    const double *w0 = w, *w1 = w + n, *w2 = w + 2 * n, *w3 = w + 3 * n;
    double a0 = 0, a1 = 0, a2 = 0, a3 = 0, b0 = 0, b1 = 0, b2 = 0, b3 = 0;
    for (size_t j = 0; j < n; j++) {
        a0 += w0[j] * x[j];
        a1 += w1[j] * x[j];
        a2 += w2[j] * x[j];
        a3 += w3[j] * x[j];
        b0 += w0[j] * y[j];
        b1 += w1[j] * y[j];
        b2 += w2[j] * y[j];
        b3 += w3[j] * y[j];
    }
    out[0] = a0, out[1] = a1, out[2] = a2, out[3] = a3;
    out[4] = b0, out[5] = b1, out[6] = b2, out[7] = b3;
}

/* Every sample is stored twice, so that every window is contiguous; `next` is the index of the next one. Signals come in pairs:
 * the positions, weighted by `position`, then `others` more, weighted by `force`. */
size_t fir_push(double *restrict ring, size_t n, size_t next, const double *restrict sample, size_t others,
                const double *restrict position, const double *restrict force, double *restrict out)
{
    for (size_t s = 0; s < 2 + others; s++) {
        ring[2 * n * s + next] = sample[s];
        ring[2 * n * s + next + n] = sample[s];
    }
    next = next + 1 == n ? 0 : next + 1;
    const double *window = ring + next;
    pair(position, n, window, window + 2 * n, out);
    for (size_t s = 2; s < 2 + others; s += 2)
        pair(force, n, window + 2 * n * s, window + 2 * n * (s + 1), out + KERNELS * s);
    return next;
}
