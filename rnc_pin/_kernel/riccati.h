/* Riccati recursion of linear-quadratic problems; see optimal/riccati.py. Included at the end of kernel.c. */

/* out (m, n) += a (k, m)^T b (k, n) */
static void add_transposed_product(const double *a, const double *b, double *out, Py_ssize_t k, Py_ssize_t m,
                                   Py_ssize_t n)
{
    for (Py_ssize_t l = 0; l < k; l++, a += m, b += n)
        for (Py_ssize_t i = 0; i < m; i++) {
            double factor = a[i], *row = out + i * n;
            for (Py_ssize_t j = 0; j < n; j++) row[j] += factor * b[j];
        }
}

/* out (m, n) += factor a (m, k) b (k, n) */
static void add_product(double factor, const double *a, const double *b, double *out, Py_ssize_t m, Py_ssize_t k,
                        Py_ssize_t n)
{
    for (Py_ssize_t i = 0; i < m; i++, out += n)
        for (Py_ssize_t l = 0; l < k; l++) {
            double entry = factor * *a++;
            const double *row = b + l * n;
            for (Py_ssize_t j = 0; j < n; j++) out[j] += entry * row[j];
        }
}

/* Inverse (n, n) of the symmetric block of a matrix with rows of length step; work (n, n). False if it is not positive
 * definite. */
static int inverse_of_positive(const double *M, Py_ssize_t step, Py_ssize_t n, double *out, double *work)
{
    for (Py_ssize_t i = 0; i < n; i++)
        for (Py_ssize_t j = 0; j <= i; j++) {
            double rest = M[i * step + j] - dot(work + i * n, work + j * n, j);
            if (i > j) work[i * n + j] = rest / work[j * n + j];
            else if (rest > 0) work[i * n + i] = sqrt(rest);
            else return 0; /* also not a number */
        }
    for (Py_ssize_t column = 0; column < n; column++) {
        for (Py_ssize_t i = 0; i < n; i++) {
            double rest = i == column;
            for (Py_ssize_t j = 0; j < i; j++) rest -= work[i * n + j] * out[j * n + column];
            out[i * n + column] = rest / work[i * n + i];
        }
        for (Py_ssize_t i = n; i-- > 0;) {
            double rest = out[i * n + column];
            for (Py_ssize_t j = i + 1; j < n; j++) rest -= work[j * n + i] * out[j * n + column];
            out[i * n + column] = rest / work[i * n + i];
        }
    }
    return 1;
}

/* N, nx, nz of a call; False with a Python error */
static int stages(PyObject *const *args, Py_ssize_t given, Py_ssize_t expected, Py_ssize_t *sizes, Py_ssize_t count)
{
    if (given != expected) {
        PyErr_Format(PyExc_TypeError, "kernel: expected %zd arguments, found %zd", expected, given);
        return 0;
    }
    for (Py_ssize_t i = 0; i < count; i++) {
        sizes[i] = PyLong_AsSsize_t(args[i]);
        if (sizes[i] < 0 || sizes[i] > 1 << 20) {
            if (!PyErr_Occurred())
                PyErr_SetString(PyExc_ValueError, "kernel: a size of a recursion is out of its range");
            return 0;
        }
    }
    if (sizes[2] >= sizes[1]) return 1;
    PyErr_SetString(PyExc_ValueError, "kernel: expected nz of at least nx");
    return 0;
}

/* N, nx, nz, AB (N, nx, nz), H (N, nz, nz), P (N + 1, nx, nx) with the last Hessian at its end, K (N, nu, nx), inverse
   (N, nu, nu). False if the problem is not convex. */
static PyObject *riccati_factors(PyObject *module, PyObject *const *args, Py_ssize_t given)
{
    Arrays all = {.count = 1};
    Py_ssize_t sizes[3];
    double *AB, *H, *P, *K, *inverse;
    (void)module;
    if (!stages(args, given, 8, sizes, 3)) return NULL;
    Py_ssize_t N = sizes[0], nx = sizes[1], nz = sizes[2], nu = nz - nx;
    if (!(take(&all, args[3], N * nx * nz, READ, &AB) && take(&all, args[4], N * nz * nz, READ, &H)
          && take(&all, args[5], (N + 1) * nx * nx, WRITE, &P) && take(&all, args[6], N * nu * nx, WRITE, &K)
          && take(&all, args[7], N * nu * nu, WRITE, &inverse)))
        return result(&all, -1);
    double *work = malloc((size_t)(nx * nz + nz * nz + nu * nu + nu * nx + 1) * sizeof(double));
    if (!work) return PyErr_NoMemory(), result(&all, -1);
    double *PF = work, *M = PF + nx * nz, *L = M + nz * nz, *cross = L + nu * nu;
    int ok = 1;
    for (Py_ssize_t k = N; k-- > 0 && ok;) {
        const double *F = AB + k * nx * nz, *after = P + (k + 1) * nx * nx;
        double *before = P + k * nx * nx, *gain = K + k * nu * nx, *inv = inverse + k * nu * nu;
        memset(PF, 0, (size_t)(nx * nz) * sizeof(double));
        add_product(1.0, after, F, PF, nx, nx, nz);
        memcpy(M, H + k * nz * nz, (size_t)(nz * nz) * sizeof(double));
        add_transposed_product(F, PF, M, nx, nz, nz);
        ok = inverse_of_positive(M + nx * nz + nx, nz, nu, inv, L);
        if (!ok) break;
        for (Py_ssize_t i = 0; i < nu; i++) memcpy(cross + i * nx, M + (nx + i) * nz, (size_t)nx * sizeof(double));
        memset(gain, 0, (size_t)(nu * nx) * sizeof(double));
        add_product(-1.0, inv, cross, gain, nu, nu, nx);
        for (Py_ssize_t i = 0; i < nx; i++) memcpy(before + i * nx, M + i * nz, (size_t)nx * sizeof(double));
        add_transposed_product(cross, gain, before, nu, nx, nx);
        for (Py_ssize_t i = 0; i < nx; i++)
            for (Py_ssize_t j = 0; j < i; j++)
                before[i * nx + j] = before[j * nx + i] = (before[i * nx + j] + before[j * nx + i]) / 2;
    }
    free(work);
    return result(&all, ok);
}

/* N, nx, nz, m, AB, K, inverse, P, g (N, nz, m), gap (N, nx, m), p (N + 1, nx, m) with the last linear term at its end,
   z (N, nz, m), states (N + 1, nx, m). p becomes the costates. */
static PyObject *riccati_solve(PyObject *module, PyObject *const *args, Py_ssize_t given)
{
    Arrays all = {.count = 1};
    Py_ssize_t sizes[4];
    double *AB, *K, *inverse, *P, *g, *gap, *p, *z, *states;
    (void)module;
    if (!stages(args, given, 13, sizes, 4)) return NULL;
    Py_ssize_t N = sizes[0], nx = sizes[1], nz = sizes[2], m = sizes[3], nu = nz - nx;
    if (!(take(&all, args[4], N * nx * nz, READ, &AB) && take(&all, args[5], N * nu * nx, READ, &K)
          && take(&all, args[6], N * nu * nu, READ, &inverse) && take(&all, args[7], (N + 1) * nx * nx, READ, &P)
          && take(&all, args[8], N * nz * m, READ, &g) && take(&all, args[9], N * nx * m, READ, &gap)
          && take(&all, args[10], (N + 1) * nx * m, WRITE, &p) && take(&all, args[11], N * nz * m, WRITE, &z)
          && take(&all, args[12], (N + 1) * nx * m, WRITE, &states)))
        return result(&all, -1);
    double *work = malloc((size_t)((nx + nz) * m + 1) * sizeof(double));
    if (!work) return PyErr_NoMemory(), result(&all, -1);
    double *ahead = work, *slope = work + nx * m;
    for (Py_ssize_t k = N; k-- > 0;) {
        const double *F = AB + k * nx * nz;
        double *feedforward = z + (k * nz + nx) * m;
        memcpy(ahead, p + (k + 1) * nx * m, (size_t)(nx * m) * sizeof(double));
        add_product(1.0, P + (k + 1) * nx * nx, gap + k * nx * m, ahead, nx, nx, m);
        memcpy(slope, g + k * nz * m, (size_t)(nz * m) * sizeof(double));
        add_transposed_product(F, ahead, slope, nx, nz, m);
        memset(feedforward, 0, (size_t)(nu * m) * sizeof(double));
        add_product(-1.0, inverse + k * nu * nu, slope + nx * m, feedforward, nu, nu, m);
        memcpy(p + k * nx * m, slope, (size_t)(nx * m) * sizeof(double));
        add_transposed_product(K + k * nu * nx, slope + nx * m, p + k * nx * m, nu, nx, m);
    }
    memset(states, 0, (size_t)(nx * m) * sizeof(double));
    for (Py_ssize_t k = 0; k < N; k++) {
        double *x = states + k * nx * m, *after = x + nx * m, *stage = z + k * nz * m;
        memcpy(stage, x, (size_t)(nx * m) * sizeof(double));
        add_product(1.0, K + k * nu * nx, x, stage + nx * m, nu, nx, m);
        memcpy(after, gap + k * nx * m, (size_t)(nx * m) * sizeof(double));
        add_product(1.0, AB + k * nx * nz, stage, after, nx, nz, m);
    }
    for (Py_ssize_t k = 0; k <= N; k++)
        add_product(1.0, P + k * nx * nx, states + k * nx * m, p + k * nx * m, nx, nx, m);
    free(work);
    return result(&all, 1);
}
