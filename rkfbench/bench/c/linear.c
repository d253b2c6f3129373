/* Kalman filter, Huber and least-absolute Kalman filters: n = 4 states, m = 3 measurements, one run after the other.
   y (runs, steps, m) in, posterior means (runs, steps, n) out; with lanes (runs / LANES, steps, m, LANES) and so on. */
#include "small.h"

enum { n = 4, m = 3 };

typedef struct { const double *F, *H, *Q, *R, *x0, *P0; } Told;
typedef struct { real F[n * n], H[m * n], Q[n * n], R[m * m], x0[n], P0[n * n]; } Spread;

INLINE void spread_all(const Told *told, Spread *all) {
    spread(n * n, told->F, all->F);
    spread(m * n, told->H, all->H);
    spread(n * n, told->Q, all->Q);
    spread(m * m, told->R, all->R);
    spread(n, told->x0, all->x0);
    spread(n * n, told->P0, all->P0);
}

#define EACH_RUN                                                                                                    \
    Spread all;                                                                                                     \
    spread_all(told, &all);                                                                                         \
    for (long r = 0; r < runs; r += LANES) {                                                                        \
        real x[n], P[n * n];                                                                                        \
        memcpy(x, all.x0, sizeof x);                                                                                \
        memcpy(P, all.P0, sizeof P);                                                                                \
        for (long k = 0; k < steps; k++, y += m, out += n) {
#define END_RUN                                                                                                     \
            memcpy(out, x, sizeof x);                                                                               \
        }                                                                                                           \
    }

/* x- = F x, P- = F P F' + Q, nu = y - H x- */
INLINE void predict(const Spread *told, real *x, real *P, const each *y, real *nu) {
    real was[n], FP[n * n], z[m];
    memcpy(was, x, sizeof was);
    times(n, n, told->F, was, x);
    real B[n * n];
    sandwich(n, n, told->F, P, told->Q, FP, B);
    memcpy(P, B, sizeof B);
    times(m, n, told->H, x, z);
    for (int i = 0; i < m; i++) nu[i] = y[i] - z[i];
}

INLINE void update(const Spread *told, real *x, real *P, const real *nu, const real *R) {
    real HP[m * n], S[m * m];
    sandwich(m, n, told->H, P, R, HP, S);
    condition(m, n, x, P, HP, S, nu, 1);
}

void kf(long runs, long steps, const Told *told, const each *y, each *out) {
    EACH_RUN
        real nu[m];
        predict(&all, x, P, y, nu);
        update(&all, x, P, nu, all.R);
    END_RUN
}

/* The same with what does not depend on y computed once: `gains` (steps, n, m) is workspace. */
void kf_shared(long runs, long steps, const Told *told, const each *y, each *out, each *gains) {
    Spread all;
    spread_all(told, &all);
    real P[n * n], B[n * n], FP[n * n], HP[m * n], S[m * m], L[m * m], g[m * n];
    memcpy(P, all.P0, sizeof P);
    for (long k = 0; k < steps; k++) {
        each *K = gains + k * n * m;
        sandwich(n, n, all.F, P, all.Q, FP, B);
        sandwich(m, n, all.H, B, all.R, HP, S);
        whiten(m, n, S, HP, L, g);
        for (int i = 0; i < n; i++) {
            for (int j = m - 1; j >= 0; j--) { /* K = g' L^-1 */
                real s = g[j * n + i];
                for (int l = j + 1; l < m; l++) s -= K[i * m + l] * L[l * m + j];
                K[i * m + j] = s / L[j * m + j];
            }
            for (int j = 0; j < n; j++) {
                real s = {0};
                for (int l = 0; l < m; l++) s += g[l * n + i] * g[l * n + j];
                P[i * n + j] = B[i * n + j] - s;
            }
        }
    }
    for (long r = 0; r < runs; r += LANES) {
        real x[n], was[n], z[m], nu[m], K[n * m], step[n];
        memcpy(x, all.x0, sizeof x);
        for (long k = 0; k < steps; k++, y += m, out += n) {
            memcpy(was, x, sizeof x);
            times(n, n, all.F, was, x);
            times(m, n, all.H, x, z);
            for (int i = 0; i < m; i++) nu[i] = y[i] - z[i];
            memcpy(K, gains + k * n * m, sizeof K);
            times(n, m, K, nu, step);
            for (int i = 0; i < n; i++) out[i] = x[i] += step[i];
        }
    }
}

/* R' = L diag(max(1, |e|/threshold)) L', e = L^-1 nu, L L' = R */
void hkf(long runs, long steps, const Told *told, const each *y, each *out, const double *root_R, const double *whitener,
         double threshold) {
    real L[m * m], inverse[m * m];
    spread(m * m, root_R, L);
    spread(m * m, whitener, inverse);
    EACH_RUN
        real nu[m], e[m], R[m * m];
        predict(&all, x, P, y, nu);
        times(m, m, inverse, nu, e);
        for (int i = 0; i < m; i++) EACH_LANE AT(e[i]) = fmax(1, fabs(AT(e[i])) / threshold);
        for (int i = 0; i < m; i++)
            for (int j = 0; j <= i; j++) {
                real s = {0};
                for (int l = 0; l < m; l++) s += L[i * m + l] * e[l] * L[j * m + l];
                R[i * m + j] = s;
            }
        update(&all, x, P, nu, R);
    END_RUN
}

/* R' = lambda R, lambda = |L^-1 nu|, L L' = R */
void aladkf(long runs, long steps, const Told *told, const each *y, each *out, const double *whitener) {
    real inverse[m * m];
    spread(m * m, whitener, inverse);
    EACH_RUN
        real nu[m], e[m], R[m * m], square = {0};
        predict(&all, x, P, y, nu);
        times(m, m, inverse, nu, e);
        for (int i = 0; i < m; i++) square += e[i] * e[i];
        real lambda = root(square);
        for (int i = 0; i < m * m; i++) R[i] = lambda * all.R[i];
        update(&all, x, P, nu, R);
    END_RUN
}
