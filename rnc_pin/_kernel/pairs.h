/* Frames, distances of shapes, joints that stop; see filled_arrays.py, rnc_pin/collision. Included in kernel.c. */

/* Rows of the rates: numbers (k, 10) of pairs (distance, normal, nearest points), pairs (k), signs of all pairs (K, n),
   joint Jacobians in the world (6, n), rows (k, n). False if the arrays need the other path. */
static int pair_rows_by(Arrays *all, PyObject *const *args)
{
    double *x[5];
    Py_ssize_t k = 0, ten = 0, K = 0, n = 0;
    if (!stacked(args[0], &k, &ten) || !stacked(args[2], &K, &n)) return 0;
    Py_ssize_t sizes[] = {10 * k, k, K * n, 6 * n, k * n};
    int ok = arrays_of(all, args, "diddw", sizes, x);
    const long *pair = (const long *)x[1];
    if (ok <= 0 || !all_within(pair, k, K)) return ok < 0 ? -1 : 0;
    double *J = x[3], *out = x[4];
    for (Py_ssize_t i = 0; i < k; i++, out += n) {
        /* The difference of the nearest points is along the normal, so both have the same moment about the origin. */
        const double *u = x[0] + 10 * i + 1, *b = x[0] + 10 * i + 7, *sign = x[2] + pair[i] * n;
        double m[3];
        cross(b, u, m);
        for (Py_ssize_t j = 0; j < n; j++)
            out[j] = sign[j]
                     * (u[0] * J[j] + u[1] * J[n + j] + u[2] * J[2 * n + j] + m[0] * J[3 * n + j] + m[1] * J[4 * n + j]
                        + m[2] * J[5 * n + j]);
    }
    return 1;
}
FUNCTION(pair_rows, 5)

/* Lower bounds of distances after a motion: rotations (s, 9) and middles (s, 3) now, the same before, radii (s), shapes
   of each pair (2, K), bounds (K), which decrease. False if the arrays need the other path. */
static int pair_bounds_by(Arrays *all, PyObject *const *args)
{
    double *x[7], *moved;
    Py_ssize_t s = 0, K = 0, one = 0;
    if (!stacked(args[4], &one, &s) || !stacked(args[6], &one, &K)) return 0;
    Py_ssize_t sizes[] = {9 * s, 3 * s, 9 * s, 3 * s, s, 2 * K, K};
    int ok = arrays_of(all, args, "dddddiw", sizes, x);
    const long *end = (const long *)x[5];
    if (ok <= 0 || !all_within(end, 2 * K, s)) return ok < 0 ? -1 : 0;
    if (!allocate(&all->memory, &moved, s, NULL)) return -1;
    for (Py_ssize_t i = 0; i < s; i++) {
        double turn = 0.0, shift = 0.0;
        for (Py_ssize_t j = 9 * i; j < 9 * i + 9; j++) turn += (x[0][j] - x[2][j]) * (x[0][j] - x[2][j]);
        for (Py_ssize_t j = 3 * i; j < 3 * i + 3; j++) shift += (x[1][j] - x[3][j]) * (x[1][j] - x[3][j]);
        /* The norm of a difference of rotations is its Frobenius norm over the root of two. */
        moved[i] = sqrt(shift) + sqrt(0.5 * turn) * x[4][i];
    }
    for (Py_ssize_t i = 0; i < K; i++) x[6][i] -= moved[end[i]] + moved[end[K + i]];
    return 1;
}
FUNCTION(pair_bounds, 7)

/* Placement and Jacobian of a frame: joint Jacobians in the world (6, n), placement of its joint (12) and in it (12),
   support of the joint (n), record of the placement (12) and of the Jacobian in world axes at the frame's origin (6,
   n). Placements are the columns of a rotation, then a translation. False if the arrays need the other path. */
static int frame_kinematics_by(Arrays *all, PyObject *const *args)
{
    double *x[5];
    Py_ssize_t one = 0, n = 0;
    if (!stacked(args[3], &one, &n)) return 0;
    Py_ssize_t sizes[] = {6 * n, 12, 12, n, 12 + 6 * n};
    int ok = arrays_of(all, args, "ddddw", sizes, x);
    if (ok <= 0) return ok;
    const double *J = x[0], *joint = x[1], *own = x[2], *support = x[3], *w = J + 3 * n;
    double *p = x[4] + 9, *rows = x[4] + 12;
    for (int column = 0; column < 4; column++)
        for (int i = 0; i < 3; i++) {
            const double *at = own + 3 * column;
            x[4][3 * column + i] =
                joint[i] * at[0] + joint[3 + i] * at[1] + joint[6 + i] * at[2] + (column == 3 ? joint[9 + i] : 0.0);
        }
    for (Py_ssize_t j = 0; j < n; j++) {
        double turned[3], axis[3] = {w[j], w[n + j], w[2 * n + j]};
        cross(axis, p, turned);
        for (int i = 0; i < 3; i++) {
            rows[i * n + j] = support[j] * (J[i * n + j] + turned[i]);
            rows[(3 + i) * n + j] = support[j] * axis[i];
        }
    }
    return 1;
}
FUNCTION(frame_kinematics, 5)

/* Poses of shapes: placements of all joints (joints, 12), joint of each of the first shapes (k), rotations (s, 9) and
   origins (s, 3) of all shapes in their joints, centres of their boxes in their own frames (s, 3), record of rotations
   (s, 9), origins (s, 3) and middles (s, 3) in the world. Further shapes are in the world already. False if the arrays
   need the other path. */
static int shape_poses_by(Arrays *all, PyObject *const *args)
{
    double *x[8];
    Py_ssize_t joints = 0, twelve = 0, one = 0, k = 0, s = 0, three = 0;
    if (!stacked(args[0], &joints, &twelve) || !stacked(args[1], &one, &k) || !stacked(args[4], &s, &three) || k > s)
        return 0;
    Py_ssize_t sizes[] = {12 * joints, k, 9 * s, 3 * s, 3 * s, 9 * s, 3 * s, 3 * s};
    int ok = arrays_of(all, args, "didddwww", sizes, x);
    const long *carrier = (const long *)x[1];
    if (ok <= 0 || !all_within(carrier, k, joints)) return ok < 0 ? -1 : 0;
    memcpy(x[5], x[2], (size_t)(9 * s) * sizeof(double)), memcpy(x[6], x[3], (size_t)(3 * s) * sizeof(double));
    for (Py_ssize_t at = 0; at < s; at++) {
        double *rotation = x[5] + 9 * at, *origin = x[6] + 3 * at;
        const double *turn = x[2] + 9 * at, *shift = x[3] + 3 * at, *joint = x[0] + 12 * (at < k ? carrier[at] : 0);
        for (int i = 0; i < 3 && at < k; i++) {
            for (int j = 0; j < 3; j++)
                rotation[3 * i + j] = joint[i] * turn[j] + joint[3 + i] * turn[3 + j] + joint[6 + i] * turn[6 + j];
            origin[i] = joint[i] * shift[0] + joint[3 + i] * shift[1] + joint[6 + i] * shift[2] + joint[9 + i];
        }
        for (int i = 0; i < 3; i++) x[7][3 * at + i] = origin[i] + dot(rotation + 3 * i, x[4] + 3 * at, 3);
    }
    return 1;
}
FUNCTION(shape_poses, 8)

#define NO_EFFECT 1e-9 /* acceleration of a joint per input, below which the input does not move it */
#define LEAST 0.1      /* of the planned deceleration that remains where the load takes more */

/* Velocities from which joints stop before their limits, as _BoundPositions in joint_limits.py: E^-1 (n, n), input
   accelerations (r, p) and those without inputs (r), planned efforts (p), q, v, entries of q and of v (2, k), ends of
   the motion (2, k) and decelerations (2, k) towards upper and lower limits, dt; lower and upper bounds (2, k). False
   if the arrays need the other path. */
static int stopping_by(Arrays *all, PyObject *const *args)
{
    double *x[11];
    Py_ssize_t n = 0, r = 0, p = 0, nq = 0, k = 0, other = 0;
    if (!stacked(args[0], &other, &n) || !stacked(args[1], &r, &p) || !stacked(args[4], &other, &nq)
        || !stacked(args[6], &other, &k) || r > n)
        return 0;
    Py_ssize_t sizes[] = {n * n, r * p, r, p, nq, n, 2 * k, 2 * k, 2 * k, 0, 2 * k};
    int ok = arrays_of(all, args, "ddddddiddfw", sizes, x);
    const long *at = (const long *)x[6];
    if (ok <= 0 || !all_within(at, k, nq) || !all_within(at + k, k, n)) return ok < 0 ? -1 : 0;
    for (Py_ssize_t i = 0; i < k; i++) {
        const double *row = x[0] + at[k + i] * n + n - r;
        double ahead = x[4][at[i]] + 0.5 * *x[9] * x[5][at[k + i]], planned = 0.0;
        for (Py_ssize_t j = 0; j < p; j++) {
            double effect = 0.0;
            for (Py_ssize_t s = 0; s < r; s++) effect += row[s] * x[1][s * p + j];
            if (fabs(effect) > NO_EFFECT || isfinite(x[3][j])) planned += fabs(effect) * x[3][j];
        }
        double most = planned > NO_EFFECT ? fmax(planned - fabs(dot(row, x[2], r)), LEAST * planned) : INFINITY;
        for (int lower = 0; lower < 2; lower++) {
            Py_ssize_t of = lower * k + i;
            double next = fmax(x[7][of] + (lower ? ahead : -ahead), 0.0) / *x[9];
            double unit = 0.5 * *x[9] * fmin(x[8][of], most), whole = floor(sqrt(next / unit + 0.25) - 0.5);
            double fastest = whole * unit + next / (whole + 1.0);
            x[10][lower ? i : k + i] = lower ? -fastest : fastest;
        }
    }
    return 1;
}
FUNCTION(stopping, 11)
