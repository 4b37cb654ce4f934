/* Programs of whole-body control; see task_hierarchy.py, distance_limits.py and output_tasks.py. Included at the
 * end of kernel.c. */

/* Triangular factor of rows (k, n + 1), whose last column is the right-hand side, by reflections; in place, k >= n. */
static void triangularize(double *A, Py_ssize_t k, Py_ssize_t n)
{
    Py_ssize_t w = n + 1;
    for (Py_ssize_t j = 0; j < n; j++) {
        double square = 0.0, first = A[j * w + j];
        for (Py_ssize_t i = j; i < k; i++) square += A[i * w + j] * A[i * w + j];
        if (square == 0.0) continue;
        double size = first > 0.0 ? -sqrt(square) : sqrt(square), scale = 1.0 / (square - first * size);
        A[j * w + j] = first - size;
        double sums[256];
        for (Py_ssize_t c = j + 1; c < w; c++) sums[c] = 0.0;
        for (Py_ssize_t i = j; i < k; i++)
            for (Py_ssize_t c = j + 1; c < w; c++) sums[c] += A[i * w + j] * A[i * w + c];
        for (Py_ssize_t c = j + 1; c < w; c++) sums[c] *= scale;
        for (Py_ssize_t i = j; i < k; i++)
            for (Py_ssize_t c = j + 1; c < w; c++) A[i * w + c] -= A[i * w + j] * sums[c];
        A[j * w + j] = size;
    }
}

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
   threshold, further rows (l, n) and their values (l), damping, the threshold relative to all rows, record of the goal
   (n) and of T (n, n). With x = T y, the sum of squares is |y - goal|^2 and a constant. False unless singular values
   certainly exceed both thresholds, or if the arrays need the other path. */
static PyObject *least_squares(PyObject *module, PyObject *const *args, Py_ssize_t given)
{
    Arrays all = {.count = 1};
    Py_ssize_t k = 0, n = 0, l = 0, columns = 0;
    (void)module;
    if (given != 8) return PyErr_SetString(PyExc_TypeError, "kernel: least_squares takes 8 arguments"), NULL;
    double least = PyFloat_AsDouble(args[4]), damping = PyFloat_AsDouble(args[5]), relative = PyFloat_AsDouble(args[6]);
    if (PyErr_Occurred()) return NULL;
    int ok = stacked(args[0], &k, &n) && stacked(args[2], &l, &columns) && columns == n && 0 < n && n < 255 && k >= n;
    const double *rows = ok ? numbers(&all, args[0], k * n) : NULL, *desired = rows ? numbers(&all, args[1], k) : NULL;
    const double *more = desired ? numbers(&all, args[2], l * n) : NULL,
                 *values = more ? numbers(&all, args[3], l) : NULL;
    double *goal = values ? numbers(&all, args[7], n + n * n) : NULL, *A = NULL;
    ok = goal && !all.views[all.open - 1].readonly;
    Py_ssize_t w = n + 1, damped = damping > 0.0 ? n : 0, further = n + l + damped;
    if (ok && !(A = malloc((size_t)((k > further ? k : further) * w) * sizeof(double))))
        return close_arrays(&all), PyErr_NoMemory();
    if (ok) {
        for (Py_ssize_t i = 0; i < k; i++)
            memcpy(A + i * w, rows + i * n, (size_t)n * sizeof(double)), A[i * w + n] = desired[i];
        triangularize(A, k, n);
        /* The smallest singular value is at least the inverse of the norm of T; a NaN fails too. */
        double size = invert_factor(A, n, goal), square = 0.0;
        ok = size > 0.0 && 1.0 > least * size;
        if (ok && further > n) {
            for (Py_ssize_t i = 0; i < n; i++)
                memset(A + i * w, 0, (size_t)i * sizeof(double)); /* below the diagonal */
            for (Py_ssize_t i = 0; i < l; i++)
                memcpy(A + (n + i) * w, more + i * n, (size_t)n * sizeof(double)), A[(n + i) * w + n] = values[i];
            memset(A + (n + l) * w, 0, (size_t)(damped * w) * sizeof(double));
            for (Py_ssize_t i = 0; i < damped; i++) A[(n + l + i) * w + i] = damping;
            for (Py_ssize_t i = 0; i < further; i++)
                for (Py_ssize_t j = 0; j < n; j++) square += A[i * w + j] * A[i * w + j];
            triangularize(A, further, n);
            size = invert_factor(A, n, goal);
            ok = size > 0.0 && 1.0 > relative * sqrt(square) * size;
        }
    }
    free(A);
    return result(&all, ok);
}

/* Rows of a frame that looks at a point: Jacobians (6, n) of the frame and of the other frame or None, axis (3), ray to
   the point (3) and its length, record of the rows (3, n). False if the arrays need the other path. */
static PyObject *look_rows(PyObject *module, PyObject *const *args, Py_ssize_t given)
{
    Arrays all = {.count = 1};
    Py_ssize_t six = 0, n = 0;
    (void)module;
    if (given != 6) return PyErr_SetString(PyExc_TypeError, "kernel: look_rows takes 6 arguments"), NULL;
    double length = PyFloat_AsDouble(args[4]);
    if (PyErr_Occurred()) return NULL;
    int ok = stacked(args[0], &six, &n) && six == 6;
    const double *J = ok ? numbers(&all, args[0], 6 * n) : NULL;
    const double *other = J && args[1] != Py_None ? numbers(&all, args[1], 6 * n) : NULL;
    ok = J && (other || args[1] == Py_None);
    const double *a = ok ? numbers(&all, args[2], 3) : NULL, *ray = a ? numbers(&all, args[3], 3) : NULL;
    double *out = ray ? numbers(&all, args[5], 3 * n) : NULL;
    ok = out && !all.views[all.open - 1].readonly;
    for (Py_ssize_t j = 0; j < n && ok; j++) {
        double d[3], u[3], along = 0.0, w[3] = {J[3 * n + j], J[4 * n + j], J[5 * n + j]};
        for (int i = 0; i < 3; i++) {
            u[i] = ray[i] / length, d[i] = (other ? other[i * n + j] : 0.0) - J[i * n + j];
            along += u[i] * d[i];
        }
        for (int i = 0; i < 3; i++) {
            int x = (i + 1) % 3, y = (i + 2) % 3;
            out[i * n + j] = -(a[x] * w[y] - a[y] * w[x]) - (d[i] - u[i] * along) / length;
        }
    }
    return result(&all, ok);
}

/* Decelerations of rows that efforts allow: rows (k, n), inverse of E (n, n) with R in its last columns, H (r, r),
   input matrix (r, p), forces without inputs (n), efforts for braking (p), 1 for each actuator without a limit (p),
   least share, least effect, record (k). False if H is not positive definite or if the arrays need the other path. */
static PyObject *decelerations(PyObject *module, PyObject *const *args, Py_ssize_t given)
{
    Arrays all = {.count = 1};
    Py_ssize_t k = 0, n = 0, r = 0, rows_H = 0, rows_B = 0, p = 0;
    (void)module;
    if (given != 10) return PyErr_SetString(PyExc_TypeError, "kernel: decelerations takes 10 arguments"), NULL;
    double share = PyFloat_AsDouble(args[7]), least = PyFloat_AsDouble(args[8]);
    if (PyErr_Occurred()) return NULL;
    int ok = stacked(args[0], &k, &n) && stacked(args[2], &rows_H, &r) && rows_H == r && stacked(args[3], &rows_B, &p)
             && rows_B == r && 0 < r && r <= n;
    Py_ssize_t sizes[7] = {k * n, n * n, r * r, r * p, n, p, p};
    double *x[7] = {NULL}, *out = NULL, *work = NULL;
    for (int i = 0; i < 7 && ok; i++) ok = (x[i] = numbers(&all, args[i], sizes[i])) != NULL;
    out = ok ? numbers(&all, args[9], k) : NULL;
    ok = out && !all.views[all.open - 1].readonly;
    if (ok && !(work = malloc((size_t)(r * r + 2 * r) * sizeof(double)))) return close_arrays(&all), PyErr_NoMemory();
    double *L = work, *y = ok ? work + r * r : NULL, *force = ok ? y + r : NULL, *R = ok ? x[1] + n - r : NULL;
    for (Py_ssize_t i = 0; i < r && ok; i++) {
        force[i] = 0.0;
        for (Py_ssize_t j = 0; j < n; j++) force[i] += x[4][j] * R[j * n + i];
        for (Py_ssize_t j = 0; j <= i; j++) {
            double sum = x[2][i * r + j];
            for (Py_ssize_t m = 0; m < j; m++) sum -= L[i * r + m] * L[j * r + m];
            if (j < i) L[i * r + j] = sum / L[j * r + j];
            else if (sum > 0.0) L[i * r + i] = sqrt(sum);
            else ok = 0;
        }
    }
    for (Py_ssize_t row = 0; row < k && ok; row++) {
        memset(y, 0, (size_t)r * sizeof(double));
        for (Py_ssize_t j = 0; j < n; j++) {
            double entry = x[0][row * n + j];
            if (entry != 0.0)
                for (Py_ssize_t i = 0; i < r; i++) y[i] += entry * R[j * n + i];
        }
        for (Py_ssize_t i = 0; i < r; i++) {
            for (Py_ssize_t m = 0; m < i; m++) y[i] -= L[i * r + m] * y[m];
            y[i] /= L[i * r + i];
        }
        for (Py_ssize_t i = r - 1; i >= 0; i--) {
            for (Py_ssize_t m = i + 1; m < r; m++) y[i] -= L[m * r + i] * y[m];
            y[i] /= L[i * r + i];
        }
        double planned = 0.0, adverse = 0.0;
        int unlimited = 0;
        for (Py_ssize_t i = 0; i < r; i++) adverse += y[i] * force[i];
        for (Py_ssize_t a = 0; a < p; a++) {
            double effect = 0.0;
            for (Py_ssize_t i = 0; i < r; i++) effect += y[i] * x[3][i * p + a];
            effect = fabs(effect), planned += effect * x[5][a];
            unlimited |= x[6][a] != 0.0 && effect > least;
        }
        double found = planned + (adverse < 0.0 ? adverse : 0.0);
        out[row] = unlimited || planned <= least ? INFINITY : found > share * planned ? found : share * planned;
    }
    free(work);
    return result(&all, ok);
}

/* Poses of shapes: placements of all joints (joints, 12), joint of each of the first shapes (k), rotations (s, 9) and
   origins (s, 3) of all shapes in their joints, centres of their boxes in their own frames (s, 3), record of rotations
   (s, 9), origins (s, 3) and middles (s, 3) in the world. Further shapes are in the world already. False if the arrays
   need the other path. */
static PyObject *shape_poses(PyObject *module, PyObject *const *args, Py_ssize_t given)
{
    Arrays all = {.count = 1};
    Py_ssize_t joints = 0, twelve = 0, one = 0, k = 0, s = 0, three = 0;
    (void)module;
    if (given != 8) return PyErr_SetString(PyExc_TypeError, "kernel: shape_poses takes 8 arguments"), NULL;
    int ok = stacked(args[0], &joints, &twelve) && twelve == 12 && stacked(args[1], &one, &k)
             && stacked(args[4], &s, &three) && three == 3 && k <= s;
    const double *joint = ok ? numbers(&all, args[0], 12 * joints) : NULL;
    const long long *carrier = joint ? indices(&all, args[1], k) : NULL;
    const double *own[3] = {NULL};
    double *out[3] = {NULL};
    ok = carrier && all_below(carrier, k, joints);
    for (int i = 0; i < 3 && ok; i++) ok = (own[i] = numbers(&all, args[2 + i], (i ? 3 : 9) * s)) != NULL;
    for (int i = 0; i < 3 && ok; i++)
        ok = (out[i] = numbers(&all, args[5 + i], (i ? 3 : 9) * s)) && !all.views[all.open - 1].readonly;
    for (Py_ssize_t at = 0; at < s && ok; at++) {
        double *rotation = out[0] + 9 * at, *origin = out[1] + 3 * at;
        const double *turn = own[0] + 9 * at, *shift = own[1] + 3 * at, *center = own[2] + 3 * at;
        memcpy(rotation, turn, 9 * sizeof(double)), memcpy(origin, shift, 3 * sizeof(double));
        if (at < k) {
            const double *x = joint + 12 * carrier[at];
            for (int i = 0; i < 3; i++) {
                for (int j = 0; j < 3; j++)
                    rotation[3 * i + j] = x[i] * turn[j] + x[3 + i] * turn[3 + j] + x[6 + i] * turn[6 + j];
                origin[i] = x[i] * shift[0] + x[3 + i] * shift[1] + x[6 + i] * shift[2] + x[9 + i];
            }
        }
        for (int i = 0; i < 3; i++) out[2][3 * at + i] = origin[i] + dot(rotation + 3 * i, center, 3);
    }
    return result(&all, ok);
}
