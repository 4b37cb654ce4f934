/* Programs of whole-body control; see task_hierarchy.py. Included at the
 * end of kernel.c. */

/* Inverse T (n, n) of the triangular factor in A (n, n + 1), and the right-hand side (n) before it; the norm of T, or
   zero if the factor is singular. */
static double invert_factor(const double *A, Py_ssize_t n, double *goal)
{
    double square = 0.0, *T = goal + n;
    memset(T, 0, (size_t)(n * n) * sizeof(double));
    for (Py_ssize_t i = n - 1; i >= 0; i--) {
        const double *factor = A + i * (n + 1);
        double *row = T + i * n;
        if (factor[i] == 0.0) return 0.0;
        row[i] = 1.0, goal[i] = factor[n];
        for (Py_ssize_t m = i + 1; m < n; m++)
            for (Py_ssize_t j = m; j < n; j++) row[j] -= factor[m] * T[m * n + j];
        for (Py_ssize_t j = i; j < n; j++) row[j] *= 1.0 / factor[i], square += row[j] * row[j];
    }
    return sqrt(square);
}

/* Least squares as a least distance: rows (k, n) and desired values (k), whose singular values have to exceed a
   threshold, damping, the threshold relative to all rows, record of the goal (n) and of T (n, n). With x = T y, the sum
   of squares is |y - goal|^2 and a constant. False unless singular values certainly exceed both thresholds, or if the
   arrays need the other path. */
static int least_squares_by(Arrays *all, PyObject *const *args)
{
    double *x[6], *A;
    Py_ssize_t k = 0, n = 0;
    if (!stacked(args[0], &k, &n) || n < 1 || n >= 255 || k < n) return 0;
    Py_ssize_t sizes[] = {k * n, k, 0, 0, 0, n + n * n};
    int ok = arrays_of(all, args, "ddfffw", sizes, x);
    if (ok <= 0) return ok;
    double least = *x[2], damping = *x[3], relative = *x[4], *goal = x[5];
    Py_ssize_t w = n + 1;
    if (!(A = memory_of(all, (k > 2 * n ? k : 2 * n) * w))) return -1;
    for (Py_ssize_t i = 0; i < k; i++)
        memcpy(A + i * w, x[0] + i * n, (size_t)n * sizeof(double)), A[i * w + n] = x[1][i];
    triangularize(A, k, n);
    /* The smallest singular value is at least the inverse of the norm of T; a NaN fails too. */
    double size = invert_factor(A, n, goal), square = 0.0;
    if (!(size > 0.0 && 1.0 > least * size)) return 0;
    if (!(damping > 0.0)) return 1;
    for (Py_ssize_t i = 0; i < n; i++) memset(A + i * w, 0, (size_t)i * sizeof(double)); /* below the diagonal */
    memset(A + n * w, 0, (size_t)(n * w) * sizeof(double));
    for (Py_ssize_t i = 0; i < n; i++) A[(n + i) * w + i] = damping;
    for (Py_ssize_t i = 0; i < 2 * n; i++)
        for (Py_ssize_t j = 0; j < n; j++) square += A[i * w + j] * A[i * w + j];
    triangularize(A, 2 * n, n);
    size = invert_factor(A, n, goal);
    return size > 0.0 && 1.0 > relative * sqrt(square) * size;
}
FUNCTION(least_squares, 6)

/* x with A x = b for A (n, n), b (n) or columns (n, k), and a number: by Cholesky's factor if it is not zero, otherwise
   by the inverse. False if neither exists, or if the arrays need the other path. */
static int solve_by(Arrays *all, PyObject *const *args)
{
    double *x[4], *work;
    Py_ssize_t n = 0, m = 0, rows = 0, k = 0;
    if (!stacked(args[0], &m, &n) || !stacked(args[1], &rows, &k) || m != n || n < 1 || rows * k % n) return 0;
    Py_ssize_t sizes[] = {n * n, rows * k, 0, rows * k}, columns = rows * k / n;
    int ok = arrays_of(all, args, "ddfw", sizes, x);
    if (ok <= 0) return ok;
    if (!(work = memory_of(all, 2 * n * n))) return -1;
    if (*x[2] == 0.0) {
        ok = invert(x[0], work, work + n * n, n);
        if (ok) multiply(work, n, x[1], columns, x[3], n, n, columns);
        return ok;
    }
    memcpy(x[3], x[1], (size_t)(rows * k) * sizeof(double));
    ok = cholesky(x[0], n, 1, work, n);
    if (ok) solve_cholesky(work, x[3], n, columns);
    return ok;
}
FUNCTION(solve, 4)
