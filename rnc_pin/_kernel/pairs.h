/* Frames, distances of pairs of shapes, and joints that stop; see compiled_states.py and rnc_pin/collision. Included
 * at the end of kernel.c. */

/* Buffer of 64-bit integers; NULL for another array. */
static const long long *indices(Arrays *all, PyObject *object, Py_ssize_t size)
{
    Py_buffer *view = all->views + all->open;
    if (PyObject_GetBuffer(object, view, PyBUF_ND | PyBUF_FORMAT) < 0) return PyErr_Clear(), NULL;
    all->open++;
    int of_integers = view->format && view->itemsize == 8 && (!strcmp(view->format, "l") || !strcmp(view->format, "q"));
    return of_integers && view->len == 8 * size ? view->buf : NULL;
}

static int all_below(const long long *index, Py_ssize_t count, Py_ssize_t size)
{
    for (Py_ssize_t i = 0; i < count; i++)
        if (index[i] < 0 || index[i] >= size) return 0;
    return 1;
}

/* Rows of the rates: numbers (k, 10) of pairs (distance, normal, nearest points), pairs (k), signs of all pairs (K, n),
   joint Jacobians in the world (6, n), rows (k, n). False if the arrays need the other path. */
static PyObject *pair_rows(PyObject *module, PyObject *const *args, Py_ssize_t given)
{
    Arrays all = {.count = 1};
    Py_ssize_t k = 0, ten = 0, K = 0, n = 0;
    (void)module;
    if (given != 5) return PyErr_SetString(PyExc_TypeError, "kernel: pair_rows takes 5 arguments"), NULL;
    int ok = stacked(args[0], &k, &ten) && ten == 10 && stacked(args[2], &K, &n);
    const double *found = ok ? numbers(&all, args[0], 10 * k) : NULL;
    const long long *pair = found ? indices(&all, args[1], k) : NULL;
    const double *signs = pair ? numbers(&all, args[2], K * n) : NULL,
                 *J = signs ? numbers(&all, args[3], 6 * n) : NULL;
    double *out = J ? numbers(&all, args[4], k * n) : NULL;
    ok = out && !all.views[all.open - 1].readonly && all_below(pair, k, K);
    for (Py_ssize_t i = 0; i < k && ok; i++, out += n) {
        /* The difference of the nearest points is along the normal, so both have the same moment about the origin. */
        const double *u = found + 10 * i + 1, *b = found + 10 * i + 7, *sign = signs + pair[i] * n;
        double m[3] = {b[1] * u[2] - b[2] * u[1], b[2] * u[0] - b[0] * u[2], b[0] * u[1] - b[1] * u[0]};
        for (Py_ssize_t j = 0; j < n; j++)
            out[j] = sign[j]
                     * (u[0] * J[j] + u[1] * J[n + j] + u[2] * J[2 * n + j] + m[0] * J[3 * n + j] + m[1] * J[4 * n + j]
                        + m[2] * J[5 * n + j]);
    }
    return result(&all, ok);
}

/* Lower bounds of distances after a motion: rotations (s, 9) and middles (s, 3) now, the same before, radii (s), shapes
   of each pair (2, K), bounds (K), which decrease. False if the arrays need the other path. */
static PyObject *pair_bounds(PyObject *module, PyObject *const *args, Py_ssize_t given)
{
    Arrays all = {.count = 1};
    double *x[6] = {NULL}, *moved = NULL;
    Py_ssize_t s = 0, K = 0, one = 0;
    (void)module;
    if (given != 7) return PyErr_SetString(PyExc_TypeError, "kernel: pair_bounds takes 7 arguments"), NULL;
    int ok = stacked(args[4], &one, &s) && stacked(args[6], &one, &K);
    Py_ssize_t sizes[5] = {9 * s, 3 * s, 9 * s, 3 * s, s};
    for (int i = 0; i < 5 && ok; i++) ok = (x[i] = numbers(&all, args[i], sizes[i])) != NULL;
    const long long *end = ok ? indices(&all, args[5], 2 * K) : NULL;
    ok = end && (x[5] = numbers(&all, args[6], K)) && !all.views[all.open - 1].readonly && all_below(end, 2 * K, s)
         && (moved = malloc((size_t)(s + 1) * sizeof(double)));
    for (Py_ssize_t i = 0; i < s && ok; i++) {
        double turn = 0.0, shift = 0.0;
        for (Py_ssize_t j = 9 * i; j < 9 * i + 9; j++) turn += (x[0][j] - x[2][j]) * (x[0][j] - x[2][j]);
        for (Py_ssize_t j = 3 * i; j < 3 * i + 3; j++) shift += (x[1][j] - x[3][j]) * (x[1][j] - x[3][j]);
        /* The norm of a difference of rotations is its Frobenius norm over the root of two. */
        moved[i] = sqrt(shift) + sqrt(0.5 * turn) * x[4][i];
    }
    for (Py_ssize_t i = 0; i < K && ok; i++) x[5][i] -= moved[end[i]] + moved[end[K + i]];
    free(moved);
    return result(&all, ok);
}

/* Largest velocities from which joints stop in time; see joint_limits.py. q, v, places of the joints in both
   (k), limits and decelerations (3, k), duration of the sample, record of lower and upper bounds (2, k). False if the
   arrays need the other path. */
static PyObject *stopping_velocities(PyObject *module, PyObject *const *args, Py_ssize_t given)
{
    Arrays all = {.count = 1};
    Py_ssize_t one = 0, nq = 0, nv = 0, k = 0;
    (void)module;
    if (given != 7) return PyErr_SetString(PyExc_TypeError, "kernel: stopping_velocities takes 7 arguments"), NULL;
    int ok = stacked(args[0], &one, &nq) && one == 1 && stacked(args[1], &one, &nv) && one == 1
             && stacked(args[4], &one, &k);
    double dt = PyFloat_AsDouble(args[5]);
    if (PyErr_Occurred()) return NULL;
    const double *q = ok ? numbers(&all, args[0], nq) : NULL, *v = q ? numbers(&all, args[1], nv) : NULL;
    const long long *in_q = v ? indices(&all, args[2], k) : NULL, *in_v = in_q ? indices(&all, args[3], k) : NULL;
    const double *limits = in_v ? numbers(&all, args[4], 3 * k) : NULL;
    double *out = limits ? numbers(&all, args[6], 2 * k) : NULL;
    ok = out && !all.views[all.open - 1].readonly && all_below(in_q, k, nq) && all_below(in_v, k, nv);
    for (Py_ssize_t i = 0; i < k && ok; i++) {
        double ahead = 0.5 * dt * v[in_v[i]], at = q[in_q[i]], a = limits[2 * k + i], unit = 0.5 * a * (dt * dt);
        double rooms[2] = {at + ahead - limits[i], limits[k + i] - at - ahead};
        for (int side = 0; side < 2; side++) {
            double room = rooms[side] < 0.0 ? 0.0 : rooms[side];
            double whole = floor(0.5 * (sqrt(1.0 + 4.0 * room / unit) - 1.0));
            double found = whole * a * dt + (room - unit * whole * (whole + 1.0)) / (dt * (whole + 1.0));
            out[side * k + i] = side ? found : -found;
        }
    }
    return result(&all, ok);
}

/* Placement and Jacobian of a frame: joint Jacobians in the world (6, n), placement of its joint (12) and in it (12),
   support of the joint (n), record of the placement (12) and of the Jacobian in world axes at the frame's origin (6,
   n). Placements are the columns of a rotation, then a translation. False if the arrays need the other path. */
static PyObject *frame_kinematics(PyObject *module, PyObject *const *args, Py_ssize_t given)
{
    Arrays all = {.count = 1};
    Py_ssize_t one = 0, n = 0;
    (void)module;
    if (given != 5) return PyErr_SetString(PyExc_TypeError, "kernel: frame_kinematics takes 5 arguments"), NULL;
    int ok = stacked(args[3], &one, &n) && one == 1;
    const double *J = ok ? numbers(&all, args[0], 6 * n) : NULL, *joint = J ? numbers(&all, args[1], 12) : NULL;
    const double *own = joint ? numbers(&all, args[2], 12) : NULL, *support = own ? numbers(&all, args[3], n) : NULL;
    double *out = support ? numbers(&all, args[4], 12 + 6 * n) : NULL;
    ok = out && !all.views[all.open - 1].readonly;
    if (ok) {
        for (int column = 0; column < 4; column++)
            for (int i = 0; i < 3; i++) {
                const double *x = own + 3 * column;
                out[3 * column + i] =
                    joint[i] * x[0] + joint[3 + i] * x[1] + joint[6 + i] * x[2] + (column == 3 ? joint[9 + i] : 0.0);
            }
        const double *p = out + 9, *w = J + 3 * n;
        double *rows = out + 12;
        for (Py_ssize_t j = 0; j < n; j++) {
            double x = w[j], y = w[n + j], z = w[2 * n + j], held = support[j];
            rows[j] = held * (J[j] + (y * p[2] - z * p[1]));
            rows[n + j] = held * (J[n + j] + (z * p[0] - x * p[2]));
            rows[2 * n + j] = held * (J[2 * n + j] + (x * p[1] - y * p[0]));
            rows[3 * n + j] = held * x, rows[4 * n + j] = held * y, rows[5 * n + j] = held * z;
        }
    }
    return result(&all, ok);
}
