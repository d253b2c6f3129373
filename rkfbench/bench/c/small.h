/* Dense algebra of small fixed sizes. Matrices are row-major; sizes are constants at every call, so that the compiler
   unrolls the loops. Of a symmetric result only half is computed and then mirrored.

   Compiled with -DLANES=8 every number is a vector of 8 doubles, one of each of 8 runs, and the same text filters 8 runs
   at once; without it a number is a double. */
#include <math.h>
#include <string.h>

#define INLINE static inline __attribute__((always_inline))

#ifdef LANES
typedef double real __attribute__((vector_size(8 * LANES)));
#else
#define LANES 1
typedef double real;
#endif

typedef real each __attribute__((aligned(8))); /* one in an array of the caller's */

#define EACH_LANE for (int lane = 0; lane < LANES; lane++)
#define AT(a) ((double *)&(a))[lane]

INLINE real root(real a) {
    EACH_LANE AT(a) = sqrt(AT(a));
    return a;
}

/* a matrix that all runs share */
INLINE void spread(int size, const double *from, real *to) {
    for (int i = 0; i < size; i++) EACH_LANE AT(to[i]) = from[i];
}

INLINE void mirror(int n, real *A) {
    for (int i = 0; i < n; i++)
        for (int j = 0; j < i; j++) A[j * n + i] = A[i * n + j];
}

/* c = A b */
INLINE void times(int m, int n, const real *A, const real *b, real *c) {
    for (int i = 0; i < m; i++) {
        real s = {0};
        for (int j = 0; j < n; j++) s += A[i * n + j] * b[j];
        c[i] = s;
    }
}

/* AP = A P (m, n) for symmetric P (n, n), and B = AP A' + Q (m, m) */
INLINE void sandwich(int m, int n, const real *A, const real *P, const real *Q, real *AP, real *B) {
    for (int i = 0; i < m; i++)
        for (int j = 0; j < n; j++) {
            real s = {0};
            for (int k = 0; k < n; k++) s += A[i * n + k] * P[k * n + j];
            AP[i * n + j] = s;
        }
    for (int i = 0; i < m; i++)
        for (int j = 0; j <= i; j++) {
            real s = Q[i * m + j];
            for (int k = 0; k < n; k++) s += AP[i * n + k] * A[j * n + k];
            B[i * m + j] = s;
        }
    mirror(m, B);
}

/* lower L with L L' = A; its upper half is not touched */
INLINE void cholesky(int n, const real *A, real *L) {
    for (int j = 0; j < n; j++) {
        real d = A[j * n + j];
        for (int k = 0; k < j; k++) d -= L[j * n + k] * L[j * n + k];
        d = root(d);
        L[j * n + j] = d;
        real r = 1 / d;
        for (int i = j + 1; i < n; i++) {
            real s = A[i * n + j];
            for (int k = 0; k < j; k++) s -= L[i * n + k] * L[j * n + k];
            L[i * n + j] = s * r;
        }
    }
}

/* g = L^-1 C (m, n) for S = L L' (m, m) */
INLINE void whiten(int m, int n, const real *S, const real *C, real *L, real *g) {
    cholesky(m, S, L);
    for (int i = 0; i < m; i++) {
        for (int j = 0; j < n; j++) g[i * n + j] = C[i * n + j];
        for (int k = 0; k < i; k++)
            for (int j = 0; j < n; j++) g[i * n + j] -= L[i * m + k] * g[k * n + j];
        real r = 1 / L[i * m + i];
        for (int j = 0; j < n; j++) g[i * n + j] *= r;
    }
}

/* x += t C' S^-1 nu, P -= t C' S^-1 C for C = cov(y, x) (m, n) and S = cov(y) (m, m) */
INLINE void condition(int m, int n, real *x, real *P, const real *C, const real *S, const real *nu,
                      double t) {
    real L[m * m], g[m * n], e[m];
    whiten(m, n, S, C, L, g);
    for (int i = 0; i < m; i++) {
        real s = nu[i];
        for (int k = 0; k < i; k++) s -= L[i * m + k] * e[k];
        e[i] = s / L[i * m + i];
    }
    for (int i = 0; i < n; i++)
        for (int k = 0; k < m; k++) x[i] += t * g[k * n + i] * e[k];
    for (int i = 0; i < n; i++)
        for (int j = 0; j <= i; j++) {
            real s = {0};
            for (int k = 0; k < m; k++) s += g[k * n + i] * g[k * n + j];
            P[i * n + j] -= t * s;
        }
    mirror(n, P);
}
