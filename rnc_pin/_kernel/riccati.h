/* Linear-quadratic problems: the Riccati recursion and an interior-point method; see
   optimal/interior_point.py. Included at the end of kernel.c. */

/* Functions with long loops, also for processors with vectors of four numbers; the results have the same bits. */
#if defined(__x86_64__) && defined(__GLIBC__) && defined(__GNUC__) && !defined(__clang__)
#define WIDE __attribute__((target_clones("avx2", "default")))
#else
#define WIDE
#endif

#define INLINE static inline __attribute__((always_inline))

/* Four numbers at any address; compilers make two of two where a processor has no vectors of four. */
typedef double Four __attribute__((vector_size(32), aligned(8), may_alias));

/* out (rows, 4 fours) += a (rows, k) b (k, 4 fours), without the first columns of out; sums stay in registers */
INLINE void multiply_tile(int rows, int fours, Py_ssize_t without, const double *a, Py_ssize_t row, Py_ssize_t column,
                          const double *b, Py_ssize_t b_row, double *out, Py_ssize_t out_row, Py_ssize_t k)
{
    Four sums[2][2];
    for (int i = 0; i < rows; i++)
        for (int j = 0; j < fours; j++) sums[i][j] = *(const Four *)(out + i * out_row + 4 * j);
    for (Py_ssize_t l = 0; l < k; l++, a += column, b += b_row)
        for (int j = 0; j < fours; j++) {
            Four other = *(const Four *)(b + 4 * j);
            for (int i = 0; i < rows; i++) sums[i][j] += a[i * row] * other;
        }
    for (int i = 0; i < rows; i++)
        for (int j = 0; j < fours; j++)
            if (!without) *(Four *)(out + i * out_row + 4 * j) = sums[i][j];
            else
                for (Py_ssize_t lane = without; lane < 4; lane++) out[i * out_row + 4 * j + lane] = sums[i][j][lane];
}

/* Some columns of a product; the last ones are the end of a tile of four, of which only they are written. */
INLINE Py_ssize_t multiply_columns(int rows, Py_ssize_t j, Py_ssize_t end, const double *a, Py_ssize_t row,
                                   Py_ssize_t column, const double *b, Py_ssize_t b_row, double *out,
                                   Py_ssize_t out_row, Py_ssize_t k)
{
    if (end - j >= 8) return multiply_tile(rows, 2, 0, a, row, column, b + j, b_row, out + j, out_row, k), j + 8;
    if (end - j >= 4) return multiply_tile(rows, 1, 0, a, row, column, b + j, b_row, out + j, out_row, k), j + 4;
    if (end >= 4) {
        Py_ssize_t first = end - 4;
        multiply_tile(rows, 1, j - first, a, row, column, b + first, b_row, out + first, out_row, k);
        return end;
    }
    for (int i = 0; i < rows; i++)
        for (Py_ssize_t l = 0; l < k; l++) out[i * out_row + j] += a[i * row + l * column] * b[l * b_row + j];
    return j + 1;
}

/* out (m, n) += a (m, k) b (k, n); entry i, l of a is at i row + l column. Lower: the lower triangle is enough. */
INLINE void multiply_add(int lower, const double *a, Py_ssize_t row, Py_ssize_t column, const double *b,
                         Py_ssize_t b_row, double *out, Py_ssize_t out_row, Py_ssize_t m, Py_ssize_t k, Py_ssize_t n)
{
    for (Py_ssize_t i = 0; i < m; i += 2, a += 2 * row, out += 2 * out_row) {
        Py_ssize_t end = lower && i + 2 < n ? i + 2 : n;
        for (Py_ssize_t j = 0; j < end;)
            j = i + 1 < m ? multiply_columns(2, j, end, a, row, column, b, b_row, out, out_row, k)
                          : multiply_columns(1, j, end, a, row, column, b, b_row, out, out_row, k);
    }
}

/* out (m, n) += a (k, m)^T b (k, n) */
INLINE void add_transposed_product(const double *a, const double *b, double *out, Py_ssize_t k, Py_ssize_t m,
                                   Py_ssize_t n)
{
    if (n == 1) multiply_add(0, b, 0, 1, a, m, out, 0, 1, k, m);
    else multiply_add(0, a, 1, m, b, n, out, n, m, k, n);
}

/* out (m, n) += a (m, k) b (k, n) */
INLINE void add_product(const double *a, const double *b, double *out, Py_ssize_t m, Py_ssize_t k, Py_ssize_t n)
{ multiply_add(0, a, k, 1, b, n, out, n, m, k, n); }

/* out (n, c) += first n columns of a (n, c), times b (n, c) */
WIDE static void multiply_slopes(const double *a, const double *b, double *out, Py_ssize_t n, Py_ssize_t c)
{ multiply_add(0, a, c, 1, b, c, out, c, n, n, c); }

/* Inverse (n, n) of a symmetric block in rows of length step; work (n, n). False if it is not positive definite. */
WIDE static int inverse_of_positive(const double *M, Py_ssize_t step, Py_ssize_t n, double *out, double *work)
{
    if (!cholesky(M, step, 1, work, n)) return 0;
    memset(out, 0, (size_t)(n * n) * sizeof(double));
    for (Py_ssize_t i = 0; i < n; i++) out[i * n + i] = 1;
    solve_cholesky(work, out, n, n);
    return 1;
}

/* Counts N, nx, nz and more of a call; false with an error */
static int stages(PyObject *const *args, Py_ssize_t *counts, int number)
{
    for (int i = 0; i < number; i++) {
        counts[i] = PyLong_AsSsize_t(args[i]);
        if (PyErr_Occurred() || counts[i] < 0 || counts[i] > 1 << 20) {
            if (!PyErr_Occurred())
                PyErr_SetString(PyExc_ValueError, "kernel: a size of a recursion is out of its range");
            return 0;
        }
    }
    if (counts[2] >= counts[1]) return 1;
    PyErr_SetString(PyExc_ValueError, "kernel: expected nz of at least nx");
    return 0;
}

/* Factors of H (N, nz, nz); P (N + 1, nx, nx) has the last Hessian at its end. The cost to go is that of the closed
   loop (Joseph's form), which stays positive where weights are stiff. False if the problem is not convex. */
WIDE static int factorize_stages(Py_ssize_t N, Py_ssize_t nx, Py_ssize_t nz, const double *AB, const double *H,
                                 double *P, double *K, double *inverse, double *work)
{
    Py_ssize_t nu = nz - nx;
    double *PB = work, *M = PB + nx * nu, *L = M + nu * nz, *closed = L + nu * nu, *P_closed = closed + nx * nx,
           *HK = P_closed + nx * nx;
    for (Py_ssize_t k = N; k-- > 0;) {
        const double *F = AB + k * nx * nz, *after = P + (k + 1) * nx * nx, *H_k = H + k * nz * nz;
        double *before = P + k * nx * nx, *gain = K + k * nu * nx, *inv = inverse + k * nu * nu;
        memset(PB, 0, (size_t)(nx * nu) * sizeof(double));
        multiply_add(0, after, nx, 1, F + nx, nz, PB, nu, nx, nx, nu);
        memcpy(M, H_k + nx * nz, (size_t)(nu * nz) * sizeof(double));
        multiply_add(0, PB, 1, nu, F, nz, M, nz, nu, nx, nz);
        if (!inverse_of_positive(M + nx, nz, nu, inv, L)) return 0;
        for (Py_ssize_t i = 0; i < nu * nu; i++) L[i] = -inv[i];
        memset(gain, 0, (size_t)(nu * nx) * sizeof(double));
        multiply_add(0, L, nu, 1, M, nz, gain, nx, nu, nu, nx);
        for (Py_ssize_t i = 0; i < nx; i++) memcpy(closed + i * nx, F + i * nz, (size_t)nx * sizeof(double));
        multiply_add(0, F + nx, nz, 1, gain, nx, closed, nx, nx, nu, nx);
        for (Py_ssize_t i = 0; i < nz; i++) memcpy(HK + i * nx, H_k + i * nz, (size_t)nx * sizeof(double));
        multiply_add(0, H_k + nx, nz, 1, gain, nx, HK, nx, nz, nu, nx);
        memset(P_closed, 0, (size_t)(nx * nx) * sizeof(double));
        multiply_add(0, after, nx, 1, closed, nx, P_closed, nx, nx, nx, nx);
        memcpy(before, HK, (size_t)(nx * nx) * sizeof(double));
        multiply_add(1, gain, 1, nx, HK + nx * nx, nx, before, nx, nx, nu, nx);
        multiply_add(1, closed, 1, nx, P_closed, nx, before, nx, nx, nx, nx);
        for (Py_ssize_t i = 0; i < nx; i++)
            for (Py_ssize_t j = 0; j < i; j++) before[j * nx + i] = before[i * nx + j];
    }
    return 1;
}

/* Numbers that factors and solutions for m terms need */
static Py_ssize_t recursion_work(Py_ssize_t nx, Py_ssize_t nz, Py_ssize_t m)
{ return (nx + nz) * m + 2 * nz * nz + nx * nz + 1; }

/* Minimisers z (N, nz, m) and states (N + 1, nx, m) for linear terms g (N, nz, m) and offsets gap (N, nx, m); p (N + 1,
   nx, m) has the last linear term at its end and becomes the linear terms of the cost to go. */
WIDE static void solve_stages(Py_ssize_t N, Py_ssize_t nx, Py_ssize_t nz, Py_ssize_t m, const double *AB,
                              const double *K, const double *inverse, const double *P, const double *g,
                              const double *gap, double *p, double *z, double *states, double *work)
{
    Py_ssize_t nu = nz - nx;
    double *ahead = work, *slope = work + nx * m;
    for (Py_ssize_t k = N; k-- > 0;) {
        const double *F = AB + k * nx * nz;
        double *feedforward = z + (k * nz + nx) * m;
        memcpy(ahead, p + (k + 1) * nx * m, (size_t)(nx * m) * sizeof(double));
        add_transposed_product(P + (k + 1) * nx * nx, gap + k * nx * m, ahead, nx, nx, m);
        memcpy(slope, g + k * nz * m, (size_t)(nz * m) * sizeof(double));
        add_transposed_product(F, ahead, slope, nx, nz, m);
        memset(feedforward, 0, (size_t)(nu * m) * sizeof(double));
        add_product(inverse + k * nu * nu, slope + nx * m, feedforward, nu, nu, m);
        for (Py_ssize_t i = 0; i < nu * m; i++) feedforward[i] = -feedforward[i];
        memcpy(p + k * nx * m, slope, (size_t)(nx * m) * sizeof(double));
        add_transposed_product(K + k * nu * nx, slope + nx * m, p + k * nx * m, nu, nx, m);
    }
    memset(states, 0, (size_t)(nx * m) * sizeof(double));
    for (Py_ssize_t k = 0; k < N; k++) {
        double *x = states + k * nx * m, *after = x + nx * m, *stage = z + k * nz * m;
        memcpy(stage, x, (size_t)(nx * m) * sizeof(double));
        add_product(K + k * nu * nx, x, stage + nx * m, nu, nx, m);
        memcpy(after, gap + k * nx * m, (size_t)(nx * m) * sizeof(double));
        add_product(AB + k * nx * nz, stage, after, nx, nz, m);
    }
}

/* Costates p (N + 1, nx, m) at states, from the linear terms of the cost to go */
static void add_costates(Py_ssize_t N, Py_ssize_t nx, Py_ssize_t m, const double *P, const double *states, double *p)
{
    for (Py_ssize_t k = 0; k <= N; k++)
        add_transposed_product(P + k * nx * nx, states + k * nx * m, p + k * nx * m, nx, nx, m);
}

/* Variances of rows C x + D u (N + 1, k), for inputs that are independent and have variances of one in AB (N, nx, nz),
   and scales in D */
WIDE static void spread_stages(Py_ssize_t N, Py_ssize_t nx, Py_ssize_t nz, Py_ssize_t k, const double *AB,
                               const double *C, const double *D, const double *scales, double *rows, double *work)
{
    Py_ssize_t nu = nz - nx;
    double *P = work, *PA = P + nx * nx, *turned = PA + nx * nx;
    memset(P, 0, (size_t)(nx * nx) * sizeof(double));
    for (Py_ssize_t stage = 0; stage <= N; stage++, AB += nx * nz) {
        for (Py_ssize_t i = 0; i < k; i++, C += nx, D += nu, rows++) {
            *rows = 0;
            for (Py_ssize_t j = 0; j < nx; j++)
                if (C[j] != 0) *rows += C[j] * dot(P + j * nx, C, nx);
            for (Py_ssize_t j = 0; j < nu && stage < N; j++) *rows += D[j] * scales[j] * (D[j] * scales[j]);
        }
        if (stage == N) return;
        for (Py_ssize_t i = 0; i < nx; i++)
            for (Py_ssize_t j = 0; j < nz; j++) turned[j * nx + i] = AB[i * nz + j];
        memset(PA, 0, (size_t)(nx * nx) * sizeof(double));
        multiply_add(0, P, nx, 1, turned, nx, PA, nx, nx, nx, nx);
        memset(P, 0, (size_t)(nx * nx) * sizeof(double));
        multiply_add(1, AB, nz, 1, PA, nx, P, nx, nx, nx, nx);
        multiply_add(1, AB + nx, nz, 1, turned + nx * nx, nx, P, nx, nx, nu, nx);
        for (Py_ssize_t i = 0; i < nx; i++)
            for (Py_ssize_t j = 0; j < i; j++) P[j * nx + i] = P[i * nx + j];
    }
}

/* N, nx, nz, k, AB (N, nx, nz), C (N + 1, k, nx), D (N + 1, k, nu), scales (nu); variances of rows (N + 1, k) */
static int variances_by(Arrays *all, PyObject *const *args)
{
    Py_ssize_t counts[4];
    double *x[5], *work;
    if (!stages(args, counts, 4)) return -1;
    Py_ssize_t N = counts[0], nx = counts[1], nz = counts[2], nu = nz - nx, k = counts[3];
    Py_ssize_t sizes[] = {N * nx * nz, (N + 1) * k * nx, (N + 1) * k * nu, nu, (N + 1) * k};
    if (!take_sized(all, args + 4, sizes, 5, 1, x) || !allocate(&all->memory, &work, 2 * nx * nx + nx * nz, NULL))
        return -1;
    spread_stages(N, nx, nz, k, x[0], x[1], x[2], x[3], x[4], work);
    return 1;
}
FUNCTION(variances, 9)

/* N, nx, nz, AB (N, nx, nz), H (N, nz, nz), P (N + 1, nx, nx) with the last Hessian at its end, K (N, nu, nx), inverse
   (N, nu, nu). False if the problem is not convex. */
static int riccati_factors_by(Arrays *all, PyObject *const *args)
{
    Py_ssize_t counts[3];
    double *x[5], *work;
    if (!stages(args, counts, 3)) return -1;
    Py_ssize_t N = counts[0], nx = counts[1], nz = counts[2], nu = nz - nx;
    Py_ssize_t sizes[] = {N * nx * nz, N * nz * nz, (N + 1) * nx * nx, N * nu * nx, N * nu * nu};
    if (!take_sized(all, args + 3, sizes, 5, 3, x) || !allocate(&all->memory, &work, recursion_work(nx, nz, 0), NULL))
        return -1;
    return factorize_stages(N, nx, nz, x[0], x[1], x[2], x[3], x[4], work);
}
FUNCTION(riccati_factors, 8)

/* N, nx, nz, m, AB, K, inverse, P, g (N, nz, m), gap (N, nx, m), p (N + 1, nx, m) with the last linear term at its end,
   z (N, nz, m), states (N + 1, nx, m). p becomes the costates. */
static int riccati_solve_by(Arrays *all, PyObject *const *args)
{
    Py_ssize_t counts[4];
    double *x[9], *work;
    if (!stages(args, counts, 4)) return -1;
    Py_ssize_t N = counts[0], nx = counts[1], nz = counts[2], m = counts[3], nu = nz - nx;
    Py_ssize_t sizes[] = {N * nx * nz, N * nu * nx,      N * nu * nu, (N + 1) * nx * nx, N * nz * m,
                          N * nx * m,  (N + 1) * nx * m, N * nz * m,  (N + 1) * nx * m};
    if (!take_sized(all, args + 4, sizes, 9, 3, x) || !allocate(&all->memory, &work, recursion_work(nx, nz, m), NULL))
        return -1;
    solve_stages(N, nx, nz, m, x[0], x[1], x[2], x[3], x[4], x[5], x[6], x[7], x[8], work);
    add_costates(N, nx, m, x[3], x[8], x[6]);
    return 1;
}
FUNCTION(riccati_solve, 13)

/* Problem within elastic rows ``G z <= limit``. Row i of G has the entries from start[i] to start[i + 1]. */
typedef struct {
    Py_ssize_t N, nx, nz, k, *start, *column;
    double *entry, weight;
    const double *AB, *gap, *H, *g, *H_end, *g_end, *limit, *active;
} Bounded;

/* Variables (N + 1, nz), slacks, elastic slacks and multipliers (N + 1, k) of an iterate, or their changes */
typedef struct {
    double *z, *s, *e, *y;
} Point;

/* What the Newton steps of an iteration share: weights of the rows, residuals, and factors */
typedef struct {
    double *W, *primal, *g, *gap, *H, *P, *K, *inverse, *first, *second, *offset, *slope, *p, *states, *work;
} Newton;

static double row_product(const Bounded *b, Py_ssize_t i, const double *z)
{
    double sum = 0;
    for (Py_ssize_t l = b->start[i]; l < b->start[i + 1]; l++) sum += b->entry[l] * z[b->column[l]];
    return sum;
}

static double complementarity(const Bounded *b, const Point *at, const Point *step, double length)
{
    double sum = 0;
    for (Py_ssize_t i = 0; i < (b->N + 1) * b->k; i++) {
        double y = at->y[i] + length * step->y[i];
        sum +=
            b->active[i] * ((at->s[i] + length * step->s[i]) * y + (at->e[i] + length * step->e[i]) * (b->weight - y));
    }
    return sum;
}

/* Longest part of a step, up to a part, that keeps slacks and multipliers positive */
static double longest_step(const Bounded *b, const Point *at, const Point *step, double most)
{
    double fastest = 1 / most;
    for (Py_ssize_t i = 0; i < (b->N + 1) * b->k; i++) {
        fastest = fmax(fastest, fmax(-step->s[i] / at->s[i], -step->e[i] / at->e[i]));
        fastest = fmax(fastest, fmax(-step->y[i] / at->y[i], step->y[i] / (b->weight - at->y[i])));
    }
    return 1 / fastest;
}

/* Residuals and factors at an iterate. False if the problem is not convex. */
WIDE static int prepare_newton(const Bounded *b, const Point *at, double stiffest, Newton *n)
{
    Py_ssize_t N = b->N, nx = b->nx, nz = b->nz;
    memcpy(n->H, b->H, (size_t)(N * nz * nz) * sizeof(double));
    memcpy(n->P + N * nx * nx, b->H_end, (size_t)(nx * nx) * sizeof(double));
    memcpy(n->g, b->g, (size_t)(N * nz) * sizeof(double));
    memcpy(n->g + N * nz, b->g_end, (size_t)nx * sizeof(double));
    memcpy(n->gap, b->gap, (size_t)(N * nx) * sizeof(double));
    for (Py_ssize_t k = 0; k <= N; k++) {
        const double *z = at->z + k * nz;
        if (k < N) {
            add_transposed_product(b->H + k * nz * nz, z, n->g + k * nz, nz, nz, 1);
            add_product(b->AB + k * nx * nz, z, n->gap + k * nx, nx, nz, 1);
            for (Py_ssize_t i = 0; i < nx; i++) n->gap[k * nx + i] -= z[nz + i];
        } else add_transposed_product(b->H_end, z, n->g + k * nz, nx, nx, 1);
        double *H = k < N ? n->H + k * nz * nz : n->P + N * nx * nx;
        Py_ssize_t width = k < N ? nz : nx;
        for (Py_ssize_t i = k * b->k; i < (k + 1) * b->k; i++) {
            n->primal[i] = row_product(b, i, z) + at->s[i] - at->e[i] - b->limit[i];
            n->W[i] = fmin(b->active[i] / (at->s[i] / at->y[i] + at->e[i] / (b->weight - at->y[i])), stiffest);
            for (Py_ssize_t l = b->start[i]; l < b->start[i + 1]; l++)
                for (Py_ssize_t o = b->start[i]; o < b->start[i + 1]; o++)
                    H[b->column[l] * width + b->column[o]] += n->W[i] * b->entry[l] * b->entry[o];
        }
    }
    return factorize_stages(N, nx, nz, b->AB, n->H, n->P, n->K, n->inverse, n->work);
}

/* Newton step to complementarity mu; with terms of second order of the step so far if it is a predictor */
WIDE static void newton_step(const Bounded *b, const Point *at, const Newton *n, double mu, int predicted, Point *step)
{
    Py_ssize_t N = b->N, nx = b->nx, nz = b->nz;
    memcpy(n->slope, n->g, (size_t)(N * nz + nx) * sizeof(double));
    for (Py_ssize_t k = 0; k <= N; k++)
        for (Py_ssize_t i = k * b->k; i < (k + 1) * b->k; i++) {
            double y = at->y[i], other = b->weight - y;
            n->first[i] = mu - at->s[i] * y - (predicted ? step->s[i] * step->y[i] : 0.0);
            n->second[i] = mu - at->e[i] * other + (predicted ? step->e[i] * step->y[i] : 0.0);
            n->offset[i] = n->primal[i] + n->first[i] / y - n->second[i] / other;
            double force = b->active[i] * (y + n->W[i] * n->offset[i]);
            for (Py_ssize_t l = b->start[i]; l < b->start[i + 1]; l++)
                n->slope[k * nz + b->column[l]] += force * b->entry[l];
        }
    memcpy(n->p + N * nx, n->slope + N * nz, (size_t)nx * sizeof(double));
    solve_stages(N, nx, nz, 1, b->AB, n->K, n->inverse, n->P, n->slope, n->gap, n->p, step->z, n->states, n->work);
    memcpy(step->z + N * nz, n->states + N * nx, (size_t)nx * sizeof(double));
    for (Py_ssize_t k = 0; k <= N; k++)
        for (Py_ssize_t i = k * b->k; i < (k + 1) * b->k; i++) {
            double dy = n->W[i] * (row_product(b, i, step->z + k * nz) + n->offset[i]);
            step->y[i] = dy;
            step->s[i] = b->active[i] * (n->first[i] - at->s[i] * dy) / at->y[i];
            step->e[i] = b->active[i] * (n->second[i] + at->e[i] * dy) / (b->weight - at->y[i]);
        }
}

/* Number of iterations that improve an iterate; 0 if the problem is not convex. Limits: largest number, part of the way
   to the boundary, stiffest weight, complementarity at the end, complementarity that is of use, and the part of the
   first residuals that may remain. */
static Py_ssize_t improve(const Bounded *b, const double *limits, Point *at, Point *step, Newton *n)
{
    Py_ssize_t rows = (b->N + 1) * b->k, most = (Py_ssize_t)limits[0];
    Py_ssize_t iteration = 1;
    double count = 0, mu = INFINITY, length = 0, rest = 1; /* of the linear residuals */
    for (Py_ssize_t i = 0; i < rows; i++) count += b->active[i];
    for (; iteration <= most; iteration++) {
        if (!prepare_newton(b, at, limits[2], n)) return iteration > 1 && mu <= limits[4] ? iteration : 0;
        mu = complementarity(b, at, step, 0) / (2 * fmax(count, 1));
        newton_step(b, at, n, 0, 0, step);
        double ahead = complementarity(b, at, step, longest_step(b, at, step, 1)) / (2 * fmax(count, 1));
        double sigma = fmin(1, fmax(ahead, 0) / fmax(mu, 1e-300));
        newton_step(b, at, n, sigma * sigma * sigma * mu, 1, step);
        length = fmin(1, limits[1] * longest_step(b, at, step, 1 / limits[1]));
        rest *= 1 - length;
        add(at->z, length, step->z, (b->N + 1) * b->nz);
        add(at->s, length, step->s, rows);
        add(at->e, length, step->e, rows);
        add(at->y, length, step->y, rows);
        if (mu <= limits[3] && length > 0.9 && rest <= limits[5]) break;
    }
    add_costates(b->N, b->nx, 1, n->P, n->states, n->p);
    return iteration < most ? iteration : most;
}

/* N, nx, nz, k, AB (N, nx, nz), gap (N, nx), H (N, nz, nz), g (N, nz), H_end (nx, nx), g_end (nx), G (N + 1, k, nz),
   limit (N + 1, k), active (N + 1, k), numbers (weight, and the limits of ``improve``), the iterate z (N + 1, nz), s, e
   and y (N + 1, k), costate (N + 1, nx), number of iterations. */
static int interior_point_by(Arrays *all, PyObject *const *args)
{
    Py_ssize_t counts[4];
    double *x[16], *entry, *start;
    if (!stages(args, counts, 4)) return -1;
    Py_ssize_t N = counts[0], nx = counts[1], nz = counts[2], nu = nz - nx, k = counts[3], rows = (N + 1) * k;
    Py_ssize_t widths[] = {N * nx * nz, N * nx, N * nz * nz,  N * nz, nx * nx, nx,   rows * nz,    rows,
                           rows,        7,      (N + 1) * nz, rows,   rows,    rows, (N + 1) * nx, 1};
    if (!take_sized(all, args + 4, widths, 16, 6, x)) return -1;
    const double *G = x[6], *numbers = x[9];
    Py_ssize_t entries = 0;
    for (Py_ssize_t i = 0; i < rows * nz; i++) entries += G[i] != 0;
    Bounded b = {N, nx, nz, k, NULL, NULL, NULL, numbers[0], x[0], x[1], x[2], x[3], x[4], x[5], x[7], x[8]};
    Point at = {x[10], x[11], x[12], x[13]}, step;
    Newton n = {.p = x[14]};
    if (!allocate(&all->memory, &step.z, (N + 1) * nz, &step.s, rows, &step.e, rows, &step.y, rows, &n.W, rows,
                  &n.primal, rows, &n.g, (N + 1) * nz, &n.gap, N * nx, &n.H, N * nz * nz, &n.P, (N + 1) * nx * nx, &n.K,
                  N * nu * nx, &n.inverse, N * nu * nu, &n.first, rows, &n.second, rows, &n.offset, rows, &n.slope,
                  (N + 1) * nz, &n.states, (N + 1) * nx, &n.work, recursion_work(nx, nz, 1), &entry, entries, &start,
                  rows + 1 + entries, NULL))
        return -1;
    b.entry = entry, b.start = (Py_ssize_t *)start, b.column = b.start + rows + 1;
    entries = 0;
    for (Py_ssize_t i = 0; i < rows; i++) {
        b.start[i] = entries;
        for (Py_ssize_t j = 0; j < (i < N * k ? nz : nx); j++)
            if (G[i * nz + j] != 0) b.entry[entries] = G[i * nz + j], b.column[entries++] = j;
    }
    b.start[rows] = entries;
    *x[15] = (double)improve(&b, numbers + 1, &at, &step, &n);
    return 1;
}
FUNCTION(interior_point, 20)
