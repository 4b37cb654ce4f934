/* Programs of whole-body control without active limits: formulas of task_hierarchy.py. At the end of kernel.c. */

#define DEPENDENT 1e-8   /* singular value, relative to the rows of the level, below which a direction is free */
#define ATTAINED 1e-12   /* residual, relative to the rate, that is rounding; also the excess of a limit */
#define LEAST_SHARE 1e-9 /* of a direction that lower levels may use, below which they do not see it */

/* One level: its rows A^T (m, k) on the directions that are free become sigma u^T, and amounts (m) their products with
   the rates (k). squares (m): sigma^2, zero for a direction that stays free. */
typedef struct {
    Py_ssize_t m, k, rows; /* k: with the rows of stiffness, which come after those of tasks */
    double *A, *rate, *amounts, *squares, factor;
    const double *curved; /* 1 for rows of tasks whose damping counts */
} Level;

/* Residual of the curved rows with a damping; its slope at zero if asked */
static double residual(const Level *of, double added, int slope)
{
    double square = 0.0;
    for (Py_ssize_t i = 0; i < of->rows; i++) {
        double rest = slope ? 0.0 : of->rate[i];
        for (Py_ssize_t j = 0; j < of->m; j++)
            if (of->squares[j] > 0.0)
                rest -= of->A[j * of->k + i] * of->amounts[j] / (of->squares[j] + added) / (slope ? of->squares[j] : 1);
        square += of->curved[i] * rest * rest;
    }
    return sqrt(square);
}

/* As residual_damping in task_hierarchy.py */
static double residual_damping(const Level *of)
{
    double most = 0.0, low = 0.0, before = 0.0, at_before = 0.0;
    for (Py_ssize_t i = 0; i < of->rows; i++) most += of->curved[i] * of->rate[i] * of->rate[i];
    if (residual(of, 0.0, 0) <= ATTAINED * sqrt(most)) at_before = 1 / fmax(of->factor * residual(of, 0.0, 1), 1e-300);
    double high = of->factor * sqrt(most), now = high;
    if (at_before >= 1.0 || !(high > 0.0)) return 0.0;
    for (int iteration = 0; iteration < 20; iteration++) {
        double at_now = now / fmax(of->factor * residual(of, now, 0), 1e-300), rise = at_now - at_before;
        if (fabs(at_now - 1.0) <= 1e-6 || (at_now < 1.0 && now >= high)) return now;
        if (at_now < 1.0) low = now;
        else high = now;
        double ahead = rise != 0.0 ? now + (1.0 - at_now) * (now - before) / rise : low;
        before = now, at_before = at_now, now = ahead > low && ahead < high ? ahead : now / at_now;
    }
    return high;
}

/* Rows (k, n) of all levels, their rates (k), 1 for curved rows (k), ends of the levels and damping over residual of
   each (levels), limits (l, n) with lower and upper bounds (l), and the unknowns (n). False if a limit is active, or if
   the arrays need the other path. */
static int cascade_by(Arrays *all, PyObject *const *args)
{
    Py_ssize_t k = 0, n = 0, l = 0, other = 0, levels = 0;
    double *x[9], *Z, *next, *stiffness, *rate, *A, *amounts, *squares, *along;
    if (!stacked(args[0], &k, &n) || !stacked(args[3], &other, &levels) || !stacked(args[5], &l, &other)) return 0;
    Py_ssize_t sizes[] = {k * n, k, k, levels, levels, l * n, l, l, n}, most = k + n, m = n, first = 0;
    int ok = n < 255 ? arrays_of(all, args, "dddiddddw", sizes, x) : 0;
    if (ok <= 0) return ok;
    if (!allocate(&all->memory, &Z, n * n, &next, n * n, &stiffness, n, &rate, most, &A, n * most, &amounts, n,
                  &squares, n, &along, n, NULL))
        return -1;
    const long *ends = (const long *)x[3];
    double *kept = x[8];
    if (!all_within(ends, levels, k + 1)) return 0;
    memset(kept, 0, (size_t)n * sizeof(double));
    for (Py_ssize_t j = 0; j < n; j++) Z[j * n + j] = 1.0;
    for (Py_ssize_t level = 0; level < levels && m; first = ends[level++]) {
        Py_ssize_t rows = ends[level] - first, stiff = 0;
        const double *J = x[0] + first * n;
        if (rows < 0) return 0;
        for (Py_ssize_t j = 0; j < m; j++) stiff = stiffness[j] > 0.0 ? m : stiff;
        Level of = {m, rows + stiff, rows, A, rate, amounts, squares, x[4][level], x[2] + first};
        double norm = 0.0, added = 0.0, speed = 0.0, size = fmax(sqrt(dot(J, J, rows * n)), 1e-100);
        for (Py_ssize_t i = 0; i < rows; i++) {
            rate[i] = x[1][first + i] - dot(J + i * n, kept, n);
            for (Py_ssize_t j = 0; j < m; j++) {
                double entry = A[j * of.k + i] = dot(J + i * n, Z + j * n, n);
                norm += entry * entry;
            }
        }
        norm = fmax(sqrt(norm), 1e-100);
        for (Py_ssize_t i = 0; i < stiff; i++) {
            rate[rows + i] = 0.0;
            for (Py_ssize_t j = 0; j < m; j++) A[j * of.k + rows + i] = i == j ? norm * stiffness[i] : 0.0;
        }
        orthogonalize(A, of.k, Z, n, m);
        for (Py_ssize_t j = 0; j < m; j++) {
            double square = dot(A + j * of.k, A + j * of.k, of.k);
            squares[j] = sqrt(square) > DEPENDENT * size ? square : 0.0, amounts[j] = dot(A + j * of.k, rate, of.k);
        }
        if (of.factor > 0.0) added = residual_damping(&of);
        for (Py_ssize_t j = 0; j < m; j++)
            if (squares[j] > 0.0) add(kept, amounts[j] / (squares[j] + added), Z + j * n, n);
        for (Py_ssize_t i = 0; i < l; i++) {
            double reached = dot(x[5] + i * n, kept, n), room = 1.0;
            for (Py_ssize_t j = 0; j < n; j++) room += fabs(x[5][i * n + j]);
            if (!(reached <= x[7][i] + ATTAINED * room && reached >= x[6][i] - ATTAINED * room)) return 0;
        }
        for (Py_ssize_t below = level + 1, i = ends[level]; below < levels && added > 0.0; below++) {
            double largest = 0.0, whole = 0.0;
            memset(along, 0, (size_t)m * sizeof(double));
            for (; i < ends[below]; i++) {
                double square = 0.0, left = x[1][i] - dot(x[0] + i * n, kept, n);
                for (Py_ssize_t j = 0; j < m; j++) {
                    double entry = dot(x[0] + i * n, Z + j * n, n);
                    along[j] += left * entry, square += entry * entry;
                }
                largest = fmax(largest, square), whole += dot(x[0] + i * n, x[0] + i * n, n);
            }
            if (largest > DEPENDENT * DEPENDENT * whole) speed += sqrt(dot(along, along, m)) / largest;
        }
        Py_ssize_t left = 0;
        for (Py_ssize_t j = 0; j < m; j++) {
            double near = 1.0 - sqrt(squares[j]) / fmax(2.0 * of.factor * speed, 1e-300), share = 1.0;
            if (squares[j] > 0.0) share = added / (squares[j] + added) * fmax(0.0, near);
            if (!(share > LEAST_SHARE)) continue;
            for (Py_ssize_t i = 0; i < n; i++) next[left * n + i] = sqrt(share) * Z[j * n + i];
            stiffness[left++] = sqrt(1.0 - share);
        }
        memcpy(Z, next, (size_t)(left * n) * sizeof(double));
        m = left;
    }
    return 1;
}
FUNCTION(cascade, 9)

/* Tasks and limits of a sample on its unknowns: ``_posed`` in inverse_dynamics_qp.py. Rows of tasks (2, k, n) and their
   rates (2, k), at the end and at the start; roots (k), squares (levels, k), curvature (n), decay; at the end E^-1
   (n, n), velocity without unknowns (n); v at the start (n); unknowns of v2 (r, r), wanted v2 (r), motion (r, p); rows
   of limits (l, n), lower and upper bounds (l); inputs (e, p), those without unknowns (e), efforts (e). Then rows
   (k + r, x), rates (k + r), levers (levels), rows (g, x) of limits and bounds (2, g), whose last ones stay. False if
   the arrays need the other path. */
static int program_by(Arrays *all, PyObject *const *args)
{
    double *x[23], *V;
    Py_ssize_t one = 0, k = 0, n = 0, r = 0, p = 0, l = 0, e = 0, g = 0, width = 0, levels = 0;
    if (!stacked(args[2], &one, &k) || !stacked(args[4], &one, &n) || !stacked(args[11], &r, &p)
        || !stacked(args[13], &one, &l) || !stacked(args[17], &one, &e) || !stacked(args[20], &one, &levels)
        || !stacked(args[21], &g, &width) || r > n || p > width || l + e > g)
        return 0;
    Py_ssize_t sizes[] = {2 * k * n, 2 * k, k, levels * k, n, 0, n * n,           n,     n,      r * r,     r,    r * p,
                          l * n,     l,     l, e * p,      e, e, (k + r) * width, k + r, levels, g * width, 2 * g};
    int ok = arrays_of(all, args, "dddddfddddddddddddwwwww", sizes, x);
    if (ok <= 0) return ok;
    if (!allocate(&all->memory, &V, n * p, NULL)) return -1;
    double *rates = x[19], *levers = x[20], *lower = x[22], *upper = lower + g;
    multiply(x[6] + n - r, n, x[11], p, V, n, r, p);
    for (Py_ssize_t i = 0; i < k; i++) {
        const double *J = x[0] + i * n, *before = J + k * n;
        double *row = x[18] + i * width, size = 0.0, ahead = dot(before, x[8], n) - x[1][k + i];
        multiply(J, n, V, p, row, 1, n, p);
        for (Py_ssize_t j = 0; j < p; j++) row[j] *= x[2][i];
        rates[i] = x[2][i] * (x[1][i] - dot(J, x[7], n) + *x[5] * ahead);
        for (Py_ssize_t j = 0; j < n; j++) size += J[j] * J[j] * x[4][j];
        for (Py_ssize_t j = 0; j < levels; j++) levers[j] += x[3][j * k + i] * size;
    }
    for (Py_ssize_t j = 0; j < levels; j++) levers[j] = sqrt(levers[j]);
    for (Py_ssize_t i = 0; i < r; i++) {
        multiply(x[9] + i * r, r, x[11], p, x[18] + (k + i) * width, 1, r, p);
        rates[k + i] = dot(x[9] + i * r, x[10], r);
    }
    for (Py_ssize_t i = 0; i < l; i++) {
        double away = dot(x[12] + i * n, x[7], n);
        multiply(x[12] + i * n, n, V, p, x[21] + i * width, 1, n, p);
        lower[i] = x[13][i] - away, upper[i] = x[14][i] - away;
    }
    for (Py_ssize_t i = 0; i < e; i++) {
        memcpy(x[21] + (l + i) * width, x[15] + i * p, (size_t)p * sizeof(double));
        lower[l + i] = -x[17][i] - x[16][i], upper[l + i] = x[17][i] - x[16][i];
    }
    return 1;
}
FUNCTION(program, 23)

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
    if (!allocate(&all->memory, &work, 2 * n * n, NULL)) return -1;
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
