/* Bootstrap particle filter on a linear model: n = 4 states, m = 3 measurements, Gaussian noise, systematic resampling
   below an effective sample size of half the particles. One run after the other; the particles (n, N) stay in the cache. */
#include <stdint.h>

#include "small.h"

enum { n = 4, m = 3 };

typedef struct { const double *F, *H, *x0, *start, *process, *whiten; } Told; /* roots of P0 and Q, inverse root of R */

/* xoshiro256+ */
typedef struct { uint64_t s[4]; } Random;

INLINE uint64_t rotate(uint64_t a, int k) { return a << k | a >> (64 - k); }

INLINE uint64_t bits(Random *g) {
    uint64_t *s = g->s, result = s[0] + s[3], t = s[1] << 17;
    s[2] ^= s[0];
    s[3] ^= s[1];
    s[1] ^= s[2];
    s[0] ^= s[3];
    s[2] ^= t;
    s[3] = rotate(s[3], 45);
    return result;
}

INLINE double uniform(Random *g) { return (double)(bits(g) >> 11) * 0x1p-53; }

static void seed(Random *g, uint64_t from) { /* splitmix64 */
    for (int i = 0; i < 4; i++) {
        uint64_t z = from += 0x9e3779b97f4a7c15;
        z = (z ^ z >> 30) * 0xbf58476d1ce4e5b9;
        z = (z ^ z >> 27) * 0x94d049bb133111eb;
        g->s[i] = z ^ z >> 31;
    }
}

/* Normals by the ziggurat of Marsaglia and Tsang (2000) with Doornik's (2005) independent bits: 128 layers of equal area */
enum { LAYERS = 128 };
static const double TAIL = 3.442619855899, AREA = 9.91256303526217e-3;
static double edge[LAYERS + 1], share[LAYERS];

static void layers(void) {
    double density = exp(-0.5 * TAIL * TAIL);
    edge[0] = AREA / density;
    edge[1] = TAIL;
    edge[LAYERS] = 0;
    for (int i = 2; i < LAYERS; i++) {
        edge[i] = sqrt(-2 * log(AREA / edge[i - 1] + density));
        density = exp(-0.5 * edge[i] * edge[i]);
    }
    for (int i = 0; i < LAYERS; i++) share[i] = edge[i + 1] / edge[i];
}

INLINE double normal(Random *g) {
    for (;;) {
        uint64_t drawn = bits(g);
        int i = drawn >> 4 & (LAYERS - 1); /* the lowest bits of xoshiro256+ are its weak ones */
        double u = (double)(int64_t)(drawn & ~(uint64_t)2047) * 0x1p-63;
        if (fabs(u) < share[i]) return u * edge[i];
        if (i == 0) {
            double x, y;
            do {
                x = log(1 - uniform(g)) / TAIL;
                y = log(1 - uniform(g));
            } while (-2 * y < x * x);
            return u < 0 ? x - TAIL : TAIL - x;
        }
        double x = u * edge[i];
        double low = exp(-0.5 * (edge[i] * edge[i] - x * x)), high = exp(-0.5 * (edge[i + 1] * edge[i + 1] - x * x));
        if (high + uniform(g) * (low - high) < 1) return x;
    }
}

/* x = A b + root g for every particle, g standard normal */
INLINE void move(long N, const double *A, const double *root, const double *from, double *to, double *noise,
                 Random *g) {
    for (long i = 0; i < n * N; i++) noise[i] = normal(g);
    for (int i = 0; i < n; i++)
        for (long p = 0; p < N; p++) {
            double s = 0;
            for (int j = 0; j < n; j++) s += A[i * n + j] * from[j * N + p] + root[i * n + j] * noise[j * N + p];
            to[i * N + p] = s;
        }
}

/* log weights += -|L^-1 (y - H x)|^2 / 2, R = L L' */
INLINE void weigh(long N, const Told *told, const double *y, const double *x, double *logs) {
    for (long p = 0; p < N; p++) {
        double nu[m], square = 0;
        for (int i = 0; i < m; i++) {
            nu[i] = y[i];
            for (int j = 0; j < n; j++) nu[i] -= told->H[i * n + j] * x[j * N + p];
        }
        for (int i = 0; i < m; i++) {
            double e = 0;
            for (int j = 0; j <= i; j++) e += told->whiten[i * m + j] * nu[j];
            square += e * e;
        }
        logs[p] -= 0.5 * square;
    }
}

/* `space`: (3 n + 2) N doubles */
void pf(long runs, long steps, const Told *told, const double *y, double *out, double *space, long N, long from) {
    double eye[n * n] = {0};
    double *x = space, *to = x + n * N, *noise = to + n * N, *logs = noise + n * N, *W = logs + N;
    for (int i = 0; i < n; i++) eye[i * n + i] = 1;
    Random g;
    layers();
    seed(&g, from);
    for (long r = 0; r < runs; r++) {
        for (int i = 0; i < n; i++)
            for (long p = 0; p < N; p++) to[i * N + p] = told->x0[i];
        move(N, eye, told->start, to, x, noise, &g);
        memset(logs, 0, N * sizeof *logs);
        for (long k = 0; k < steps; k++, y += m, out += n) {
            move(N, told->F, told->process, x, to, noise, &g);
            weigh(N, told, y, to, logs);
            double top = logs[0], sum = 0, squares = 0;
            for (long p = 1; p < N; p++) top = logs[p] > top ? logs[p] : top;
            for (long p = 0; p < N; p++) {
                logs[p] -= top;
                W[p] = exp(logs[p]);
                sum += W[p];
                squares += W[p] * W[p];
            }
            for (int i = 0; i < n; i++) {
                double s = 0;
                for (long p = 0; p < N; p++) s += W[p] * to[i * N + p];
                out[i] = s / sum;
            }
            double u = uniform(&g);
            if (sum * sum / squares < 0.5 * N) {
                double upto = 0;
                long next = 0;
                for (long p = 0; p < N; p++) {
                    upto += W[p];
                    double last = p == N - 1 ? N : ceil(N * upto / sum - u);
                    for (; next < last && next < N; next++)
                        for (int i = 0; i < n; i++) x[i * N + next] = to[i * N + p];
                }
                memset(logs, 0, N * sizeof *logs);
            } else {
                double *other = x;
                x = to;
                to = other;
            }
        }
    }
}
