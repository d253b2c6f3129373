/* UKF, CKF and progressive EKF on the altitude model: n = 6 states, m = 4 measurements, one run after the other
   (or LANES of them). x = [p, v], p advances by dt v; y = [bearing of p, |p|, pz, p'v/|p|]. */
#include "small.h"

enum { n = 6, m = 4 };

typedef struct { const double *F, *Q, *R, *x0, *P0, *dt; } Told;
typedef struct { real F[n * n], Q[n * n], R[m * m], x0[n], P0[n * n]; double dt; } Spread;

INLINE void spread_all(const Told *told, Spread *all) {
    spread(n * n, told->F, all->F);
    spread(n * n, told->Q, all->Q);
    spread(m * m, told->R, all->R);
    spread(n, told->x0, all->x0);
    spread(n * n, told->P0, all->P0);
    all->dt = *told->dt;
}

static const double PI = 3.14159265358979323846;

INLINE real wrap(real a) {
    EACH_LANE AT(a) -= 2 * PI * floor((AT(a) + PI) / (2 * PI));
    return a;
}

INLINE real direction(real y, real x) {
    EACH_LANE AT(y) = atan2(AT(y), AT(x));
    return y;
}

INLINE void f(double dt, const real *x, real *to) {
    for (int i = 0; i < 3; i++) {
        to[i] = x[i] + dt * x[3 + i];
        to[3 + i] = x[3 + i];
    }
}

INLINE void h(const real *x, real *z) {
    real r = root(x[0] * x[0] + x[1] * x[1] + x[2] * x[2]);
    z[0] = direction(x[1], x[0]);
    z[1] = r;
    z[2] = x[2];
    z[3] = (x[0] * x[3] + x[1] * x[4] + x[2] * x[5]) / r;
}

/* z = h(x) and the Jacobian H (m, n) */
INLINE void slopes(const real *x, real *z, real *H) {
    h(x, z);
    real ground = x[0] * x[0] + x[1] * x[1];
    memset(H, 0, m * n * sizeof *H);
    H[0] = -x[1] / ground;
    H[1] = x[0] / ground;
    H[2 * n + 2] += 1;
    for (int i = 0; i < 3; i++) {
        real u = x[i] / z[1];
        H[n + i] = H[3 * n + 3 + i] = u;
        H[3 * n + i] = (x[3 + i] - z[3] * u) / z[1];
    }
}

/* the 2n + 1 points x and x +- scale l_i, L L' = P */
INLINE void draw(double scale, const real *x, const real *P, real (*points)[n]) {
    real L[n * n];
    cholesky(n, P, L);
    for (int j = 0; j < n; j++) points[0][j] = x[j];
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++) {
            real d = {0};
            if (j >= i) d = scale * L[j * n + i];
            points[1 + i][j] = x[j] + d;
            points[1 + n + i][j] = x[j] - d;
        }
}

/* mean of d components of the points; the points become offsets from it */
INLINE void centre(int d, double w0, double w, real (*points)[d], real *mean) {
    for (int j = 0; j < d; j++) mean[j] = w0 * points[0][j];
    for (int i = 1; i <= 2 * n; i++)
        for (int j = 0; j < d; j++) mean[j] += w * points[i][j];
    for (int i = 0; i <= 2 * n; i++)
        for (int j = 0; j < d; j++) points[i][j] -= mean[j];
}

/* C = sum_i w_i a_i b_i' + Q */
INLINE void covariance(int p, int q, double w0, double w, real (*a)[p], real (*b)[q], const real *Q, real *C) {
    for (int i = 0; i < p; i++)
        for (int j = 0; j < q; j++) {
            real s = {0};
            for (int l = 1; l <= 2 * n; l++) s += a[l][i] * b[l][j];
            s = w * s + w0 * a[0][i] * b[0][j];
            C[i * q + j] = Q ? s + Q[i * q + j] : s;
        }
}

/* Sigma-point filter: points at distance scale, weights 1/(2 scale^2), and w0 of the centre in means, c0 in covariances.
   New points are drawn from the prediction. */
void sigma(long runs, long steps, const Told *told, const each *y, each *out, double scale, double w0, double c0) {
    double w = 1 / (2 * scale * scale);
    Spread all;
    spread_all(told, &all);
    for (long r = 0; r < runs; r += LANES) {
        real x[n], P[n * n];
        memcpy(x, all.x0, sizeof x);
        memcpy(P, all.P0, sizeof P);
        for (long k = 0; k < steps; k++, y += m, out += n) {
            real points[2 * n + 1][n], moved[2 * n + 1][n], seen[2 * n + 1][m];
            real z[m], first, nu[m], S[m * m], C[m * n];
            draw(scale, x, P, points);
            for (int i = 0; i <= 2 * n; i++) f(all.dt, points[i], moved[i]);
            centre(n, w0, w, moved, x);
            covariance(n, n, c0, w, moved, moved, all.Q, P);
            draw(scale, x, P, points);
            for (int i = 0; i <= 2 * n; i++) h(points[i], seen[i]);
            first = seen[0][0];
            for (int i = 0; i <= 2 * n; i++) seen[i][0] = first + wrap(seen[i][0] - first);
            centre(m, w0, w, seen, z);
            for (int i = 0; i <= 2 * n; i++)
                for (int j = 0; j < n; j++) points[i][j] -= x[j];
            covariance(m, m, c0, w, seen, seen, all.R, S);
            covariance(m, n, c0, w, seen, points, 0, C);
            for (int i = 0; i < m; i++) nu[i] = y[i] - z[i];
            nu[0] = wrap(nu[0]);
            condition(m, n, x, P, C, S, nu, 1);
            memcpy(out, x, sizeof x);
        }
    }
}

/* EKF prediction, then `parts` sub-steps x + K nu/parts, P - K S K'/parts */
void pekf(long runs, long steps, const Told *told, const each *y, each *out, long parts) {
    Spread all;
    spread_all(told, &all);
    for (long r = 0; r < runs; r += LANES) {
        real x[n], P[n * n];
        memcpy(x, all.x0, sizeof x);
        memcpy(P, all.P0, sizeof P);
        for (long k = 0; k < steps; k++, y += m, out += n) {
            real was[n], FP[n * n], B[n * n];
            memcpy(was, x, sizeof x);
            f(all.dt, was, x);
            sandwich(n, n, all.F, P, all.Q, FP, B);
            memcpy(P, B, sizeof B);
            for (long l = 0; l < parts; l++) {
                real z[m], H[m * n], HP[m * n], S[m * m], nu[m];
                slopes(x, z, H);
                for (int i = 0; i < m; i++) nu[i] = y[i] - z[i];
                nu[0] = wrap(nu[0]);
                sandwich(m, n, H, P, all.R, HP, S);
                condition(m, n, x, P, HP, S, nu, 1.0 / parts);
            }
            memcpy(out, x, sizeof x);
        }
    }
}
