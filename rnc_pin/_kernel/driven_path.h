/* A trailer on the path that its tractor has driven. Included in kernel.c; formulas and constants are those of
   slithering.py and path_fit.py. */

#define DEGREES 6    /* coefficients of the fitted polynomial */
#define FEWEST 4     /* places for a fit */
#define STEEPEST 1.0 /* [rad] */
#define NEWTON_STEPS 12
#define LAST_STEP 1e-13
#define POOR_FIT 1e-8 /* ratio of pivots below which NumPy decides about the rank */

typedef struct {
    double x, y, heading, curvature;
} PathPoint;

typedef struct {
    double length, offset, spacing, window, across, jump, kept; /* the table of SlitheringReference */
} Trailer;

/* Point of a cubic Hermite curve between two places (x, y, heading) at distance L from (px, py) */
static PathPoint chord_end_between(const double *begin, const double *end, double px, double py, double L)
{
    double dx = end[0] - begin[0], dy = end[1] - begin[1], h = hypot(dx, dy), s = 0.0;
    double ux = h * cos(begin[2]), uy = h * sin(begin[2]), vx = h * cos(end[2]), vy = h * sin(end[2]);
    double bx = 3 * dx - 2 * ux - vx, by = 3 * dy - 2 * uy - vy, ax = ux + vx - 2 * dx, ay = uy + vy - 2 * dy;
    double x = 0.0, y = 0.0, x_s = 0.0, y_s = 0.0;
    for (int i = 0; i < NEWTON_STEPS; i++) {
        x = begin[0] + s * (ux + s * (bx + s * ax)), y = begin[1] + s * (uy + s * (by + s * ay));
        x_s = ux + s * (2 * bx + 3 * s * ax), y_s = uy + s * (2 * by + 3 * s * ay);
        double rx = px - x, ry = py - y, slope = rx * x_s + ry * y_s;
        if (slope <= 0.0) break; /* the chord is across the path: refused later */
        double moved = fmin(fmax(s + (rx * rx + ry * ry - L * L) / (2 * slope), 0.0), 1.0);
        if (fabs(moved - s) < LAST_STEP) break;
        s = moved;
    }
    double speed = hypot(x_s, y_s), bend = x_s * (2 * by + 6 * s * ay) - y_s * (2 * bx + 6 * s * ax);
    return (PathPoint){x, y, atan2(y_s, x_s), bend / (speed * speed * speed)};
}

/* Least squares by Householder's reflections: rows (count, DEGREES) and right (count) are overwritten. False if the
 * rank is in doubt */
static int fitted(double *rows, double *right, Py_ssize_t count, double *curve)
{
    double pivot[DEGREES], largest = 0.0, smallest = INFINITY;
    for (int c = 0; c < DEGREES; c++) {
        double square = 0.0;
        for (Py_ssize_t i = c; i < count; i++) square += rows[i * DEGREES + c] * rows[i * DEGREES + c];
        double size = sqrt(square), head = rows[c * DEGREES + c];
        pivot[c] = head > 0.0 ? -size : size;
        largest = fmax(largest, size), smallest = fmin(smallest, size);
        if (!(size > 0.0)) return 0;
        rows[c * DEGREES + c] = head - pivot[c];
        double scale = -1.0 / (pivot[c] * rows[c * DEGREES + c]); /* 2 / |reflector|^2 */
        for (int j = c + 1; j <= DEGREES; j++) {
            double product = 0.0;
            for (Py_ssize_t i = c; i < count; i++)
                product += rows[i * DEGREES + c] * (j < DEGREES ? rows[i * DEGREES + j] : right[i]);
            product *= scale;
            for (Py_ssize_t i = c; i < count; i++) {
                double change = product * rows[i * DEGREES + c];
                if (j < DEGREES) rows[i * DEGREES + j] -= change;
                else right[i] -= change;
            }
        }
    }
    if (!(smallest > POOR_FIT * largest)) return 0;
    for (int c = DEGREES - 1; c >= 0; c--) {
        curve[c] = right[c];
        for (int j = c + 1; j < DEGREES; j++) curve[c] -= rows[c * DEGREES + j] * curve[j];
        curve[c] /= pivot[c];
    }
    return all_finite(curve, DEGREES);
}

/* Move a point to the polynomial y(x), in axes at the point and in units of the window, at distance L from (px, py) */
static void chord_end_along(const double *curve, PathPoint *near, double px, double py, double L, double window)
{
    double c = cos(near->heading), s = sin(near->heading), square = (L / window) * (L / window), u = 0.0;
    double ahead = (c * (px - near->x) + s * (py - near->y)) / window;
    double left = (c * (py - near->y) - s * (px - near->x)) / window, y = 0.0, slope = 0.0, bend = 0.0;
    for (int i = 0; i < NEWTON_STEPS; i++) {
        y = slope = bend = 0.0;
        for (int k = DEGREES - 1; k >= 0; k--)
            bend = bend * u + 2.0 * slope, slope = slope * u + y, y = y * u + curve[k];
        double rx = ahead - u, ry = left - y, along = rx + ry * slope;
        if (along <= 0.0) return; /* the chord is across the path: refused later */
        double step = (rx * rx + ry * ry - square) / (2 * along);
        u += step;
        if (fabs(u) > 1.0) return;
        if (fabs(step) < LAST_STEP) break;
    }
    double across = y * window, forward = u * window, steep = 1.0 + slope * slope;
    near->x += c * forward - s * across, near->y += s * forward + c * across, near->heading += atan(slope);
    near->curvature = bend / window / (steep * sqrt(steep));
}

/* First place whose distance driven is not below a value */
static Py_ssize_t place_from(const double *path, Py_ssize_t count, double driven)
{
    Py_ssize_t low = 0, high = count;
    while (low < high) {
        Py_ssize_t middle = low + (high - low) / 2;
        if (path[4 * middle + 3] < driven) low = middle + 1;
        else high = middle;
    }
    return low;
}

/* Move ``near`` to the quintic fitted to the places around it. False if NumPy has to decide; -1: a Python error */
static int chord_end_fitted(const double *path, Py_ssize_t count, Py_ssize_t older, PathPoint *near, double px,
                            double py, double L, double window)
{
    double middle = path[4 * older + 3] + hypot(near->x - path[4 * older], near->y - path[4 * older + 1]),
           curve[DEGREES];
    Py_ssize_t first = place_from(path, count, middle - window), last = place_from(path, count, middle + window),
               even = 0;
    if (first > older || last < older + 2) return 1;
    for (Py_ssize_t i = first; i < last; i++) even += fabs(wrapped(path[4 * i + 2] - near->heading)) < STEEPEST;
    if (even < FEWEST) return 1;
    double *rows = malloc((size_t)(2 * even * (DEGREES + 1)) * sizeof(double)), *right = rows + 2 * even * DEGREES;
    if (!rows) return PyErr_NoMemory(), -1;
    double c = cos(near->heading), s = sin(near->heading);
    Py_ssize_t at = 0;
    for (Py_ssize_t i = first; i < last; i++) {
        const double *place = path + 4 * i;
        double turned = wrapped(place[2] - near->heading), dx = place[0] - near->x, dy = place[1] - near->y;
        if (!(fabs(turned) < STEEPEST)) continue;
        double u = (c * dx + s * dy) / window, far = (place[3] - middle) / window, weight = 1.0 - far * far;
        double lever = weight * (cos(turned) * cos(turned)) * (L / window), power = 1.0;
        double *values = rows + at * DEGREES, *slopes = rows + (even + at) * DEGREES;
        slopes[0] = 0.0;
        for (int k = 0; k < DEGREES; k++, power *= u) {
            values[k] = weight * power;
            if (k + 1 < DEGREES) slopes[k + 1] = lever * ((k + 1) * power);
        }
        right[at] = weight * ((c * dy - s * dx) / window), right[even + at] = lever * tan(turned);
        at++;
    }
    int ok = fitted(rows, right, 2 * even, curve);
    free(rows);
    if (ok) chord_end_along(curve, near, px, py, L, window);
    return ok;
}

/* Point one chord behind the kingpin (px, py), and the index of the place before it; here: the tractor's x, y and
 * heading. */
static int behind(const double *path, Py_ssize_t count, const double *here, double px, double py,
                  const Trailer *trailer, Py_ssize_t *older, PathPoint *found)
{
    double L = trailer->length;
    Py_ssize_t i = count - 1;
    for (; i >= 0; i--) {
        double dx = path[4 * i] - px, dy = path[4 * i + 1] - py;
        if (dx * dx + dy * dy >= L * L) break;
    }
    *older = i < 0 ? 0 : i;
    if (i < 0) { /* on the straight before the oldest place */
        double dx = px - path[0], dy = py - path[1], c = cos(path[2]), s = sin(path[2]), along = dx * c + dy * s;
        double tau = sqrt(along * along + L * L - dx * dx - dy * dy) - along;
        *found = (PathPoint){path[0] - tau * c, path[1] - tau * s, path[2], 0.0};
        return 1;
    }
    *found = chord_end_between(path + 4 * i, i + 1 < count ? path + 4 * (i + 1) : here, px, py, L);
    return chord_end_fitted(path, count, i, found, px, py, L, trailer->window);
}

enum { UNDECIDED, FOLLOWED, NEW_PLACE }; /* outcomes of a run */

/* Heading with its rate and acceleration, index of the first place to keep, outcome. at: indices of the tractor's x, y
   and heading and of the kingpin's x and y in x1 (k). -1: a Python error */
static int follow(const double *path, Py_ssize_t count, double before, const double *x1, const double *v1,
                  const double *A_star, const double *A_star_dot, const double *v2, const double *v2_dot, Py_ssize_t r,
                  const long *at, const Trailer *trailer, double *out)
{
    const double *last = path + 4 * (count - 1);
    double here[3] = {x1[at[0]], x1[at[1]], x1[at[2]]}, px = x1[at[3]], py = x1[at[4]], L = trailer->length, a[2];
    double ahead = (here[0] - last[0]) * cos(last[2]) + (here[1] - last[1]) * sin(last[2]);
    PathPoint s;
    Py_ssize_t older;
    out[3] = 0.0, out[4] = UNDECIDED;
    if (ahead >= trailer->spacing || (ahead <= -trailer->spacing && count > 1)) return out[4] = NEW_PLACE, 1;
    int ok = behind(path, count, here, px, py, trailer, &older, &s);
    if (ok <= 0) return ok < 0 ? -1 : 1;
    for (int i = 0; i < 2; i++) a[i] = dot(A_star + at[3 + i] * r, v2_dot, r) + dot(A_star_dot + at[3 + i] * r, v2, r);
    double theta = atan2(py - s.y, px - s.x), vx = v1[at[3]], vy = v1[at[4]];
    double ex = cos(theta), ey = sin(theta), tx = cos(s.heading), ty = sin(s.heading), along = ex * tx + ey * ty;
    double turn = wrapped(theta + trailer->offset - before);
    if (!(fmin(along, cos(here[2] - theta)) >= trailer->across) || !(fabs(turn) <= trailer->jump)) return 1;
    double s_dot = (ex * vx + ey * vy) / along, wx = vx - s_dot * tx, wy = vy - s_dot * ty, square = s_dot * s_dot;
    double bx = a[0] + square * s.curvature * ty,
           by = a[1] - square * s.curvature * tx; /* without s'' t: centripetal at the path */
    double s_ddot = (ex * bx + ey * by + (wx * wx + wy * wy) / L) / along;
    out[0] = before + turn, out[1] = (ex * wy - ey * wx) / L;
    out[2] = (ex * (by - s_ddot * ty) - ey * (bx - s_ddot * tx)) / L;
    if (!all_finite(out, 3)) return 1;
    double oldest = last[3] - trailer->kept * L;
    if (older > 1 && path[7] < oldest) {
        Py_ssize_t first = place_from(path, count, fmin(path[4 * older + 3] - trailer->window, oldest));
        out[3] = first > 1 ? (double)(first - 1) : 0.0;
    }
    return out[4] = FOLLOWED, 1;
}

/* Tuple of paths (n, 4), one for each run; headings (1), x1 and v1 (k), A_star and A_star_dot (k, r), v2 and v2_dot
   (r), each of one run or of a stack of runs; indices (5), table of the trailer (7), record (5) of ``follow``. False if
   the arrays need the other path. */
static int slither_by(Arrays *all, PyObject *const *args)
{
    enum { PATHS, HEADINGS, X1, V1, A_STAR, A_DOT, V2, V2_DOT, AT, TABLE, OUT };
    double *x[OUT + 1];
    Py_ssize_t k = 0, r = 0, again = 0;
    if (!PyTuple_Check(args[PATHS]) || !stacked(args[X1], &all->count, &k) || !stacked(args[V2], &again, &r)
        || again != all->count || PyTuple_Size(args[PATHS]) != again || k >= 1 << 10 || r >= 1 << 10)
        return 0;
    Py_ssize_t sizes[] = {0, 1, k, k, k * r, k * r, r, r, 5, 7, 5};
    int ok = arrays_of(all, args + 1, "DDDDDDDidW", sizes + 1, x + 1);
    if (ok <= 0 || !all_within((const long *)x[AT], 5, k)) return ok < 0 ? -1 : 0;
    const double *t = x[TABLE];
    Trailer trailer = {t[0], t[1], t[2], t[3], t[4], t[5], t[6]};
    for (Py_ssize_t run = 0; run < again && ok > 0; run++, advance(all, x + 1, OUT)) {
        Py_buffer path;
        if (PyObject_GetBuffer(PyTuple_GetItem(args[PATHS], run), &path, PyBUF_ND | PyBUF_FORMAT) < 0)
            return PyErr_Clear(), 0;
        ok = path.format && !strcmp(path.format, "d") && path.ndim == 2 && path.shape[1] == 4 && path.shape[0] > 0;
        if (ok)
            ok = follow(path.buf, path.shape[0], *x[HEADINGS], x[X1], x[V1], x[A_STAR], x[A_DOT], x[V2], x[V2_DOT], r,
                        (const long *)x[AT], &trailer, x[OUT]);
        PyBuffer_Release(&path);
    }
    return ok;
}
FUNCTION(slither, 11)
