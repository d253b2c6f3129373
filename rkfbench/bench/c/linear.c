/* Kalman filter, Huber and least-absolute Kalman filters: n = 4 states, m = 3 measurements, one run after the other.
   y (runs, steps, m) in, posterior means (runs, steps, n) out. */
#include "small.h"

enum { n = 4, m = 3 };

typedef struct { const double *F, *H, *Q, *R, *x0, *P0; } Told;

#define EACH_RUN                                                                                                    \
    for (long r = 0; r < runs; r++) {                                                                               \
        double x[n], P[n * n];                                                                                      \
        memcpy(x, told->x0, sizeof x);                                                                              \
        memcpy(P, told->P0, sizeof P);                                                                              \
        for (long k = 0; k < steps; k++, y += m, out += n) {
#define END_RUN                                                                                                     \
            memcpy(out, x, sizeof x);                                                                               \
        }                                                                                                           \
    }

/* x- = F x, P- = F P F' + Q, nu = y - H x- */
INLINE void predict(const Told *told, double *x, double *P, const double *y, double *nu) {
    double was[n], FP[n * n], z[m];
    memcpy(was, x, sizeof was);
    times(n, n, told->F, was, x);
    double B[n * n];
    sandwich(n, n, told->F, P, told->Q, FP, B);
    memcpy(P, B, sizeof B);
    times(m, n, told->H, x, z);
    for (int i = 0; i < m; i++) nu[i] = y[i] - z[i];
}

INLINE void update(const Told *told, double *x, double *P, const double *nu, const double *R) {
    double HP[m * n], S[m * m];
    sandwich(m, n, told->H, P, R, HP, S);
    condition(m, n, x, P, HP, S, nu, 1);
}

void kf(long runs, long steps, const Told *told, const double *y, double *out) {
    EACH_RUN
        double nu[m];
        predict(told, x, P, y, nu);
        update(told, x, P, nu, told->R);
    END_RUN
}

/* The same with what does not depend on y computed once: `gains` (steps, n, m) is workspace. */
void kf_shared(long runs, long steps, const Told *told, const double *y, double *out, double *gains) {
    double P[n * n], B[n * n], FP[n * n], HP[m * n], S[m * m], L[m * m], g[m * n];
    memcpy(P, told->P0, sizeof P);
    for (long k = 0; k < steps; k++) {
        double *K = gains + k * n * m;
        sandwich(n, n, told->F, P, told->Q, FP, B);
        sandwich(m, n, told->H, B, told->R, HP, S);
        whiten(m, n, S, HP, L, g);
        for (int i = 0; i < n; i++) {
            for (int j = m - 1; j >= 0; j--) { /* K = g' L^-1 */
                double s = g[j * n + i];
                for (int l = j + 1; l < m; l++) s -= K[i * m + l] * L[l * m + j];
                K[i * m + j] = s / L[j * m + j];
            }
            for (int j = 0; j < n; j++) {
                double s = 0;
                for (int l = 0; l < m; l++) s += g[l * n + i] * g[l * n + j];
                P[i * n + j] = B[i * n + j] - s;
            }
        }
    }
    for (long r = 0; r < runs; r++) {
        double x[n], was[n], z[m], nu[m], step[n];
        memcpy(x, told->x0, sizeof x);
        for (long k = 0; k < steps; k++, y += m, out += n) {
            memcpy(was, x, sizeof x);
            times(n, n, told->F, was, x);
            times(m, n, told->H, x, z);
            for (int i = 0; i < m; i++) nu[i] = y[i] - z[i];
            times(n, m, gains + k * n * m, nu, step);
            for (int i = 0; i < n; i++) out[i] = x[i] += step[i];
        }
    }
}

/* R' = L diag(max(1, |e|/threshold)) L', e = L^-1 nu, L L' = R */
void hkf(long runs, long steps, const Told *told, const double *y, double *out, const double *L, const double *inverse,
         double threshold) {
    EACH_RUN
        double nu[m], e[m], w[m], R[m * m];
        predict(told, x, P, y, nu);
        times(m, m, inverse, nu, e);
        for (int i = 0; i < m; i++) w[i] = fabs(e[i]) > threshold ? fabs(e[i]) / threshold : 1;
        for (int i = 0; i < m; i++)
            for (int j = 0; j <= i; j++) {
                double s = 0;
                for (int l = 0; l < m; l++) s += L[i * m + l] * w[l] * L[j * m + l];
                R[i * m + j] = s;
            }
        update(told, x, P, nu, R);
    END_RUN
}

/* R' = lambda R, lambda = |L^-1 nu|, L L' = R */
void aladkf(long runs, long steps, const Told *told, const double *y, double *out, const double *inverse) {
    EACH_RUN
        double nu[m], e[m], R[m * m], square = 0;
        predict(told, x, P, y, nu);
        times(m, m, inverse, nu, e);
        for (int i = 0; i < m; i++) square += e[i] * e[i];
        double lambda = sqrt(square);
        for (int i = 0; i < m * m; i++) R[i] = lambda * told->R[i];
        update(told, x, P, nu, R);
    END_RUN
}
