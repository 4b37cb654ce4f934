/* Laws of controllers over one sample. Included in kernel.c. */

#include "rotations.h"

#define HALF_TURN 3.14159265358979323846

/* Angle in (-pi, pi], as wrapped() of coordinates.py */
static double wrapped(double angle)
{
    double rest = fmod(HALF_TURN - angle, 2 * HALF_TURN);
    if (rest < 0.0) rest += 2 * HALF_TURN;
    return HALF_TURN - rest;
}

enum { REAL, ANGLE, ROTATION }; /* kinds of outputs; a rotation vector has three entries of its kind */

/* velocity + gain * error and acceleration + gain * error rate of k outputs, which are x[places[i]] (x[i] without
   places) with these rates. point: position, velocity, acceleration (k each). False if a value is not finite; an output
   with zero gain needs none. */
static int feed_back(Py_ssize_t k, double *const point[3], const double *x, const double *rate, const long *places,
                     const double *gain, const double *kind, double *out, double *out_dot)
{
    for (Py_ssize_t i = 0; i < k; i++) {
        Py_ssize_t at = places ? places[i] : i;
        if (kind[i] == ROTATION) {
            double here[3], turning[3], error[3], error_rate[3], velocity[3], acceleration[3];
            if (i + 2 >= k) return 0;
            for (int c = 0; c < 3; c++) {
                Py_ssize_t entry = places ? places[i + c] : i + c;
                here[c] = x[entry], turning[c] = rate[entry];
            }
            rotation_error(point[0] + i, here, error);
            angular_rates(point[0] + i, point[1] + i, point[2] + i, velocity, acceleration);
            rotation_error_rate(error, velocity, turning, error_rate);
            for (int c = 0; c < 3; c++) {
                out[i + c] = velocity[c] + gain[i + c] * error[c];
                out_dot[i + c] = acceleration[c] + gain[i + c] * error_rate[c];
            }
            if (!all_finite(out + i, 3) || !all_finite(out_dot + i, 3)) return 0;
            i += 2;
            continue;
        }
        double error = point[0][i] - x[at], product = 0.0;
        if (kind[i] == ANGLE) error = wrapped(error);
        if (gain[i] != 0.0) product = gain[i] * error;
        if (!isfinite(product)) return 0;
        out[i] = point[1][i] + product;
        out_dot[i] = point[2][i] + gain[i] * (point[1][i] - rate[at]);
    }
    return 1;
}

/* Position, velocity and acceleration of a reference (k), values and rates of the outputs of one run (k) or of a stack
   of runs, table (2, k) of gains and of kinds, record of the first sum of feed_back of all runs, then of the second.
   False if the arrays or the numbers need the other path. */
static int feedback_by(Arrays *all, PyObject *const *args)
{
    double *x[7];
    Py_ssize_t k = 0;
    if (!stacked(args[3], &all->count, &k)) return 0;
    Py_ssize_t sizes[] = {k, k, k, k, k, 2 * k, 2 * k};
    int ok = arrays_of(all, args, "dddDDdW", sizes, x);
    for (Py_ssize_t at = 0, end = all->count * k; at < end && ok > 0; at += k)
        ok = feed_back(k, x, x[3] + at, x[4] + at, NULL, x[5], x[5] + k, x[6] + at, x[6] + end + at);
    return ok;
}
FUNCTION(feedback, 7)

/* Law (10) over one sample; see velocity_tracker.py. v2, v2d, v2d_dot (r), deficit of force (r) or None, g (r), C (r,
   r), D (r, r^2), each of one run or of a stack of runs; gains (4, r) or (4, 1): k, beta, dead zone, compensation; True
   with a dead zone, decay, time of the leak, record of F, g, C, D, each of all runs. False if the arrays need the other
   path. */
static int track_by(Arrays *all, PyObject *const *args)
{
    enum { V2, V2D, V2D_DOT, DEFICIT, G, C_NOW, D_NOW, GAINS, ZONE, DECAY, LEAK, OUT };
    double *x[OUT + 1];
    Py_ssize_t r = 0, four = 0, next = 0;
    if (!stacked(args[V2], &all->count, &r) || !stacked(args[GAINS], &four, &next) || (next != r && next != 1))
        return 0;
    Py_ssize_t runs = all->count, sizes[] = {r, r, r, r, r, r * r, r * r * r, 4 * next, 0, 0, 0, r * (2 + r + r * r)};
    int ok = arrays_of(all, args, "DDDNDDDdfffW", sizes, x),
        each = next == r; /* gains of each output, or one for all */
    if (ok <= 0) return ok;
    const double *k = x[GAINS], decay = *x[DECAY], leak = *x[LEAK];
    double *out = x[OUT], *g_out = out + runs * r, *C_out = g_out + runs * r, *D_out = C_out + runs * r * r;
    for (Py_ssize_t run = 0; run < runs; run++) {
        const double *v2 = x[V2] + run * r, *v2d = x[V2D] + run * r, *v2d_dot = x[V2D_DOT] + run * r;
        double square = 1.0;
        for (Py_ssize_t i = 0; i < r; i++) {
            square += v2d_dot[i] * v2d_dot[i];
            for (Py_ssize_t j = 0; j < r; j++) square += v2[i] * v2d[j] * (v2[i] * v2d[j]);
        }
        for (Py_ssize_t i = 0; i < r; i++) {
            double feedback = k[each * i], beta = k[next + each * i], size = k[2 * next + each * i], keep = decay;
            double error = v2d[i] - v2[i], beyond = error - fmin(fmax(error, -size), size);
            double step = leak * beta / (1.0 + leak * beta * square / feedback) * beyond;
            Py_ssize_t at = run * r + i;
            if (*x[ZONE] != 0.0 && beyond == 0.0) keep = 1.0;
            if (x[DEFICIT] && x[DEFICIT][at] * error > 0.0) step = 0.0, keep = 1.0;
            double *g = g_out + at, *C = C_out + at * r, *D = D_out + at * r * r;
            const double *C_before = x[C_NOW] + at * r, *D_before = x[D_NOW] + at * r * r;
            *g = keep * x[G][at] + step;
            double force = *g + feedback * error + k[3 * next + each * i];
            for (Py_ssize_t j = 0; j < r; j++) {
                C[j] = keep * C_before[j] + step * v2d_dot[j];
                force += C[j] * v2d_dot[j];
            }
            for (Py_ssize_t a = 0; a < r; a++)
                for (Py_ssize_t b = 0; b < r; b++) {
                    D[a * r + b] = keep * D_before[a * r + b] + step * (v2[a] * v2d[b]);
                    force += D[a * r + b] * (v2[a] * v2d[b]);
                }
            out[at] = force;
        }
    }
    return 1;
}
FUNCTION(track, 12)

/* Outputs of a class-1 task: a vertical, b primary and c redundant ones, in k vertical and r reducing outputs. */
typedef struct {
    Py_ssize_t a, b, c, k, r;
    const long *vertical, *primary, *redundant;
} Task;

/* True if all indices are within the outputs. */
static int placed(Task *task, const long *places)
{
    task->vertical = places, task->primary = places + task->a, task->redundant = task->primary + task->b;
    return all_within(places, task->a, task->k) && all_within(places + task->a, task->b + task->c, task->r);
}

/* Rates of class 1, (12), over one sample; see redundancy.py. A_star and A_star_dot (k, r); first and wanted: rates of
   the primary outputs (b) and of the vertical ones (a), then their rates; cost^-1 (c); secondary rates and theirs (c
   each) or NULL; rates[2]: v2 and v2_dot (r). 0: A4 is nearly singular; -1: a Python error. */
static int spread_out(const Task *task, double *const A[2], double *const first[2], double *const wanted[2],
                      const double *cost, double *const secondary[2], double *const rates[2])
{
    Py_ssize_t a = task->a, b = task->b, c = task->c, r = task->r;
    const long *vertical = task->vertical, *primary = task->primary, *redundant = task->redundant;
    int wide = c > a, ok = 1;
    double *work = malloc((size_t)(a * (4 * c + 3 * a + 3)) * 8);
    if (!work) return PyErr_NoMemory(), -1;
    double *A4 = work, *A4_dot = A4 + a * c, *back = A4_dot + a * c, *back_dot = back + a * c, *S = back_dot + a * c;
    double *inverse = S + a * a, *right = inverse + 2 * a * a, *y = right + a, *y_dot = y + a;
    for (Py_ssize_t i = 0; i < a; i++)
        for (Py_ssize_t j = 0; j < c; j++) {
            A4[i * c + j] = A[0][vertical[i] * r + redundant[j]];
            A4_dot[i * c + j] = A[1][vertical[i] * r + redundant[j]];
            back[i * c + j] = cost[j] * A4[i * c + j]; /* columns of W^-1 A4^T */
            back_dot[i * c + j] = cost[j] * A4_dot[i * c + j];
        }
    for (Py_ssize_t i = 0; i < a; i++)
        for (Py_ssize_t j = 0; j < a; j++) S[i * a + j] = wide ? dot(A4 + i * c, back + j * c, c) : A4[i * c + j];
    ok = invert(S, inverse, inverse + a * a, a);
    for (int rate = 0; rate < 2 && ok; rate++) { /* the rates, then their rates, which use y */
        double largest = 0.0, *solution = rate ? y_dot : y;
        for (Py_ssize_t i = 0; i < a; i++) {
            const double *A3 = A[0] + vertical[i] * r, *A3_dot = A[1] + vertical[i] * r;
            right[i] = wanted[rate][i];
            for (Py_ssize_t j = 0; j < b; j++) {
                right[i] -= A3[primary[j]] * first[rate][j];
                if (rate) right[i] -= A3_dot[primary[j]] * first[0][j];
            }
            if (wide && secondary) right[i] -= dot(A4 + i * c, secondary[rate], c);
            if (rate && wide && secondary) right[i] -= dot(A4_dot + i * c, secondary[0], c);
            if (rate && wide)
                for (Py_ssize_t j = 0; j < a; j++)
                    right[i] -= (dot(A4_dot + i * c, back + j * c, c) + dot(A4 + i * c, back_dot + j * c, c)) * y[j];
            if (rate && !wide) right[i] -= dot(A4_dot + i * c, y, c);
            largest = fmax(largest, fabs(right[i]));
        }
        for (Py_ssize_t i = 0; i < a; i++) {
            solution[i] = dot(inverse + i * a, right, a);
            if (!(fabs(solution[i]) < STEEP * (1.0 + largest))) ok = 0;
        }
        for (Py_ssize_t j = 0; j < b; j++) rates[rate][primary[j]] = first[rate][j];
        for (Py_ssize_t j = 0; j < c; j++) {
            double sum = wide ? (secondary ? secondary[rate][j] : 0.0) : solution[j];
            for (Py_ssize_t i = 0; i < a && wide; i++) {
                sum += back[i * c + j] * solution[i];
                if (rate) sum += back_dot[i * c + j] * y[i];
            }
            rates[rate][redundant[j]] = sum;
        }
    }
    free(work);
    return ok;
}

/* Class 1 with its feedback, (12): A_star, A_star_dot (k, r), indices of the vertical, primary and redundant
   outputs (as many as a, b, c), position, velocity and acceleration of the primary reference (b each), then of the
   vertical one (a each), x2, v2 (r), x1, v1 (k), table of gains and of kinds of the primary outputs (b each), then of
   the vertical ones (a each), then cost^-1 (c); offset of v1 and its rate (k) or None, secondary rates and theirs (c)
   or None, record of v2, v2_dot, x2 and x1 desired (r, r, r, k). The references are those of all runs; all else may be
   a stack of runs, and the record then has v2 of all runs, v2_dot of all runs, and so on. False if the arrays need the
   other path, or A4 is nearly singular. */
static int pursue_by(Arrays *all, PyObject *const *args)
{
    enum { A_STAR, A_DOT, AT, FIRST, BASE = 6, X2 = 9, V2, X1, V1, TABLE, OFFSET, FREE_RATES = 16, OUT = 18 };
    double *x[OUT + 1], *sums;
    Py_ssize_t a = 0, b = 0, r = 0, k = 0, runs = 0, one = 0;
    if (!stacked(args[X2], &all->count, &r) || !stacked(args[X1], &runs, &k) || runs != all->count
        || !stacked(args[FIRST], &one, &b) || !stacked(args[BASE], &one, &a) || a < 1 || r - b < a)
        return 0;
    Task task = {.a = a, .b = b, .c = r - b, .k = k, .r = r};
    Py_ssize_t c = task.c, gains_size = 2 * b + 2 * a + c,
               sizes[] = {k * r, k * r, r + a, b, b, b, a, a, a, r, r, k, k, gains_size, k, k, c, c, 3 * r + k};
    int ok = arrays_of(all, args, "DDiddddddDDDDdNNNNW", sizes, x);
    if (ok <= 0 || !x[FREE_RATES] != !x[FREE_RATES + 1] || !placed(&task, (const long *)x[AT])) return ok < 0 ? -1 : 0;
    if (!(sums = memory_of(all, 2 * (a + b)))) return -1;
    const double *gains = x[TABLE];
    double *first[2] = {sums, sums + b}, *wanted[2] = {sums + 2 * b, sums + 2 * b + a}, *out = x[OUT];
    for (Py_ssize_t run = 0; run < runs && ok > 0; run++, advance(all, x, OUT)) {
        double *rates[2] = {out + run * r, out + (runs + run) * r};
        double *x2 = out + (2 * runs + run) * r, *x1 = out + 3 * runs * r + run * k;
        ok = feed_back(b, x + FIRST, x[X2], x[V2], task.primary, gains, gains + b, first[0], first[1])
             && feed_back(a, x + BASE, x[X1], x[V1], task.vertical, gains + 2 * b, gains + 2 * b + a, wanted[0],
                          wanted[1]);
        for (int rate = 0; rate < 2 && ok; rate++)
            for (Py_ssize_t i = 0; i < a && x[OFFSET + rate]; i++)
                wanted[rate][i] -= x[OFFSET + rate][task.vertical[i]];
        if (ok)
            ok = spread_out(&task, x + A_STAR, first, wanted, gains + 2 * (a + b),
                            x[FREE_RATES] ? x + FREE_RATES : NULL, rates);
        for (Py_ssize_t i = 0; i < r; i++) x2[i] = NAN; /* no goal */
        for (Py_ssize_t i = 0; i < k; i++) x1[i] = NAN;
        for (Py_ssize_t i = 0; i < b; i++) x2[task.primary[i]] = x[FIRST][i];
        for (Py_ssize_t i = 0; i < a; i++) x1[task.vertical[i]] = x[BASE][i];
    }
    return ok;
}
FUNCTION(pursue, 19)

/* Coefficients (count, size) of polynomials, lowest power first, argument, record of their values (size). */
static int polynomial_by(Arrays *all, PyObject *const *args)
{
    double *x[3];
    Py_ssize_t count = 0, size = 0;
    if (!stacked(args[0], &count, &size) || count < 1) return 0;
    Py_ssize_t sizes[] = {count * size, 0, size};
    int ok = arrays_of(all, args, "dfw", sizes, x);
    if (ok <= 0) return ok;
    memcpy(x[2], x[0] + (count - 1) * size, (size_t)size * sizeof(double));
    for (Py_ssize_t i = count - 2; i >= 0; i--)
        for (Py_ssize_t j = 0; j < size; j++) x[2][j] = x[2][j] * *x[1] + x[0][i * size + j];
    return 1;
}
FUNCTION(polynomial, 3)

/* Laws (8)-(9) over one sample; see position_tracker.py. Position, velocity, acceleration and jerk of the reference (k
   each), x2 (r), indices of the outputs (k), table (7, k): k1, k2, gamma, beta, dead zone, compensation, ones for
   angles; z, f (k), A, B (k, k), error (k) before; deficit of force (r), then velocity and acceleration of the
   reference before (k each), or None each if nothing can freeze; decay, time of the leak, sigma, time elapsed, record
   of F, z, f (k each), A, B (k, k), error (k), v2 and x2 desired (r each), each of all runs. x2, what was before and
   the deficit are those of one run or of a stack of runs. False if the arrays or the numbers need the other path. */
static int track_position_by(Arrays *all, PyObject *const *args)
{
    enum { X2 = 4, AT, TABLE, Z, F0, A0, B0, E0, DEFICIT, V_BEFORE, A_BEFORE, DECAY, LEAK, SIGMA, ELAPSED, OUT };
    double *x[OUT + 1];
    Py_ssize_t k = 0, r = 0, one = 0;
    if (!stacked(args[X2], &all->count, &r) || !stacked(args[0], &one, &k)) return 0;
    Py_ssize_t runs = all->count, sizes[] = {k,     k, k, k, r, k, 7 * k, k, k, k * k,
                                             k * k, k, r, k, k, 0, 0,     0, 0, 4 * k + 2 * k * k + 2 * r};
    int ok = arrays_of(all, args, "ddddDidDDDDDNnnffffW", sizes, x), freezes = x[DEFICIT] != NULL;
    if (ok <= 0 || (freezes && !(x[V_BEFORE] && x[A_BEFORE]))) return ok < 0 ? -1 : 0;
    const long *places = (const long *)x[AT];
    if (!all_within(places, k, r)) return 0;
    double decay = *x[DECAY], leak = *x[LEAK], sigma = *x[SIGMA], elapsed = *x[ELAPSED];
    const double *xd = x[1], *xdd = x[2], *xddd = x[3], *gains = x[TABLE];
    double *F = x[OUT], *z = F + runs * k, *f = z + runs * k, *A = f + runs * k, *B = A + runs * k * k;
    double *e = B + runs * k * k, *v2 = e + runs * k, *x2 = v2 + runs * r;
    for (Py_ssize_t i = 0; i < 2 * runs * r; i++) v2[i] = NAN; /* no goal */
    for (Py_ssize_t at = 0; at < runs * k && ok; at++) {
        Py_ssize_t i = at % k, place = at / k * r + places[i];
        double k1 = gains[i], k2 = gains[k + i], gamma = gains[2 * k + i], beta = gains[3 * k + i],
               error = x[0][i] - x[X2][place];
        if (gains[6 * k + i] != 0.0) error = wrapped(error);
        if (!isfinite(error)) ok = 0;
        double square = gamma * gamma, fade = exp(-2.0 * gamma * elapsed), step = beta * error, added = 0.0;
        double *A_i = A + at * k, *B_i = B + at * k;
        const double *A_before = x[A0] + at * k, *B_before = x[B0] + at * k;
        e[at] = error, z[at] = fade * x[Z][at] - (1.0 - fade) * square * error;
        double w = z[at] + square * error, drive = beta * (k2 / (k1 * gamma) * error - w / gamma);
        f[at] = decay * x[F0][at] + leak * (drive - sigma * step);
        for (Py_ssize_t j = 0; j < k; j++) {
            A_i[j] = decay * A_before[j] + leak * (drive * xdd[j] - step * (xddd[j] + sigma * xdd[j]));
            B_i[j] = decay * B_before[j] + leak * (drive * xd[j] - step * (xdd[j] + sigma * xd[j]));
        }
        if (freezes) { /* change of the force beside primed values that leave it unchanged */
            double stepped = beta * x[E0][at];
            const double *xd_before = x[V_BEFORE], *xdd_before = x[A_BEFORE];
            added = f[at] - (x[F0][at] + stepped - step);
            for (Py_ssize_t j = 0; j < k; j++) {
                added += (A_i[j] - (A_before[j] + stepped * xdd_before[j] - step * xdd[j])) * xdd[j];
                added += (B_i[j] - (B_before[j] + stepped * xd_before[j] - step * xd[j])) * xd[j];
            }
            if (fabs(error) < gains[4 * k + i] || x[DEFICIT][place] * added > 0.0) {
                f[at] = x[F0][at] + stepped - step;
                for (Py_ssize_t j = 0; j < k; j++) {
                    A_i[j] = A_before[j] + stepped * xdd_before[j] - step * xdd[j];
                    B_i[j] = B_before[j] + stepped * xd_before[j] - step * xd[j];
                }
            }
        }
        double force = f[at] + step + k1 * square * w + k2 * square * error + gains[5 * k + i];
        for (Py_ssize_t j = 0; j < k; j++) force += (A_i[j] + step * xdd[j]) * xdd[j] + (B_i[j] + step * xd[j]) * xd[j];
        F[at] = force, v2[place] = xd[i], x2[place] = x[0][i];
    }
    return ok;
}
FUNCTION(track_position, 20)

/* Parameters p (s), regressor W (e, s), prediction error (e), lowest and highest values (s each), step, record of the
   parameters after one sample of (20); see estimation.py. False if the arrays need the other path. */
static int adapt_by(Arrays *all, PyObject *const *args)
{
    double *x[7];
    Py_ssize_t s = 0, e = 0, one = 0;
    if (!stacked(args[0], &one, &s) || !stacked(args[2], &one, &e)) return 0;
    Py_ssize_t sizes[] = {s, e * s, e, s, s, 0, s};
    int ok = arrays_of(all, args, "dddddfw", sizes, x);
    double *matrix = ok > 0 ? memory_of(all, e * (2 * e + 1)) : NULL, *solution = matrix + e * e;
    if (!matrix) return ok > 0 ? -1 : ok;
    const double *W = x[1], step = *x[5];
    for (Py_ssize_t i = 0; i < e; i++) {
        for (Py_ssize_t j = 0; j < e; j++) matrix[i * e + j] = (i == j) + step * dot(W + i * s, W + j * s, s);
        solution[i] = step * x[2][i];
    }
    ok = solve_positive_definite(matrix, solution, solution + e, e);
    for (Py_ssize_t j = 0; j < s && ok; j++) {
        double next = x[0][j];
        for (Py_ssize_t i = 0; i < e; i++) next += solution[i] * W[i * s + j];
        x[6][j] = fmin(fmax(next, x[3][j]), x[4][j]);
    }
    return ok;
}
FUNCTION(adapt, 7)

/* Center, amplitude, rate and phase of sines (k each), growth of the amplitude with three derivatives (4), time, record
   of the value with three derivatives (4, k); see references.py. False if the arrays need the other path. */
static int harmonic_by(Arrays *all, PyObject *const *args)
{
    double *x[7];
    Py_ssize_t k = 0, one = 0;
    if (!stacked(args[0], &one, &k)) return 0;
    Py_ssize_t sizes[] = {k, k, k, k, 4, 0, 4 * k};
    int ok = arrays_of(all, args, "dddddfw", sizes, x);
    const double *g = x[4];
    double *out = x[6];
    for (Py_ssize_t i = 0; i < k && ok > 0; i++) {
        double w = x[2][i], angle = w * *x[5] + x[3][i], sine = x[1][i] * sin(angle), cosine = x[1][i] * cos(angle);
        double wave[4] = {sine, w * cosine, -w * w * sine, -w * w * w * cosine};
        out[i] = x[0][i] + g[0] * wave[0];
        out[k + i] = g[0] * wave[1] + g[1] * wave[0];
        out[2 * k + i] = g[0] * wave[2] + 2 * g[1] * wave[1] + g[2] * wave[0];
        out[3 * k + i] = g[0] * wave[3] + 3 * g[1] * wave[2] + 3 * g[2] * wave[1] + g[3] * wave[0];
    }
    return ok;
}
FUNCTION(harmonic, 7)

/* Arguments of ``steer`` */
enum { A_STAR, A_DOT, SLOPES, AT, V2, V21D, V21D_DOT, X1, POINT, TABLE = POINT + 3, K4, DAMPING, MOST_RATE, RATES };

/* Redundant rates (a) of one run of ``steer``, with its arguments x */
static int steering_rates(const Task *task, double *const *x, double *work)
{
    Py_ssize_t a = task->a, b = task->b, k = task->k, r = task->r;
    double *v1 = work, *wanted = v1 + k, *wanted_dot = wanted + a, *right = wanted_dot + a, *rest = right + a,
           *rate = rest + a;
    double *N = rate + a, *square = N + a * a, *factor = square + a * a, *out = x[RATES];
    memset(v1, 0, (size_t)k * sizeof(double));
    for (Py_ssize_t i = 0; i < a; i++) {
        long row = task->vertical[i];
        rate[i] = rest[i] = 0.0;
        for (Py_ssize_t j = 0; j < b; j++) {
            long column = task->primary[j];
            rate[i] += x[A_STAR][row * r + column] * x[V2][column];
            rest[i] += x[A_DOT][row * r + column] * x[V2][column] + x[A_STAR][row * r + column] * x[V21D_DOT][j];
        }
        for (Py_ssize_t c = 0; c < a; c++) {
            N[i * a + c] = 0.0;
            for (Py_ssize_t j = 0; j < b; j++)
                N[i * a + c] += x[SLOPES][(c * k + row) * r + task->primary[j]] * x[V2][task->primary[j]];
            rest[i] -= N[i * a + c] * x[V2][task->redundant[c]];
        }
        v1[row] = rate[i];
    }
    int ok = feed_back(a, x + POINT, x[X1], v1, task->vertical, x[TABLE], x[TABLE] + a, wanted, wanted_dot);
    for (Py_ssize_t i = 0; i < a; i++) right[i] = wanted_dot[i] + *x[K4] * (wanted[i] - rate[i]) - rest[i];
    for (Py_ssize_t i = 0; i < a; i++) {
        out[i] = 0.0;
        for (Py_ssize_t c = 0; c < a; c++) {
            out[i] += N[c * a + i] * right[c], square[i * a + c] = i == c ? *x[DAMPING] * *x[DAMPING] : 0.0;
            for (Py_ssize_t j = 0; j < a; j++) square[i * a + c] += N[j * a + i] * N[j * a + c];
        }
    }
    ok = ok && solve_positive_definite(square, out, factor, a);
    for (Py_ssize_t i = 0; i < a; i++) out[i] = fmin(fmax(out[i], -*x[MOST_RATE]), *x[MOST_RATE]);
    return ok;
}

/* Rates of steering outputs; see steering.py. Of one run or of a stack of runs: A_star, A_star_dot (k, r), slopes of
   A_star along each redundant output (a, k, r); indices of the vertical, primary and redundant outputs (a, b, a); of
   each run v2 (r), primary rates and theirs (b each), x1 (k), position, velocity and acceleration of the vertical
   reference (a each); table of gains and of kinds of the vertical outputs (2, a), k4, damping, largest rate, record of
   the redundant rates (a). False if the arrays or the numbers need the other path. */
static int steer_by(Arrays *all, PyObject *const *args)
{
    double *x[RATES + 1], *work;
    Py_ssize_t a = 0, r = 0, k = 0, b = 0, of_a = 0, of_b = 0, of_k = 0;
    if (!stacked(args[V2], &all->count, &r) || !stacked(args[V21D], &of_b, &b) || !stacked(args[X1], &of_k, &k)
        || !stacked(args[POINT], &of_a, &a) || of_a != all->count || of_b != of_a || of_k != of_a || a < 1 || a + b > r
        || a > k || k >= 1 << 10 || r >= 1 << 10)
        return 0;
    Task task = {.a = a, .b = b, .c = a, .k = k, .r = r};
    Py_ssize_t sizes[] = {k * r, k * r, a * k * r, 2 * a + b, r, b, b, k, a, a, a, 2 * a, 0, 0, 0, a};
    int ok = arrays_of(all, args, "DDDiDDDDDDDdfffW", sizes, x);
    if (ok <= 0 || !placed(&task, (const long *)x[AT])) return ok < 0 ? -1 : 0;
    if (!(work = memory_of(all, k + 5 * a + 3 * a * a))) return -1;
    for (Py_ssize_t run = 0; run < all->count && ok; run++, advance(all, x, RATES + 1))
        ok = steering_rates(&task, x, work);
    return ok;
}
FUNCTION(steer, 16)
