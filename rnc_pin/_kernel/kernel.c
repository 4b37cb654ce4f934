/* Evaluation of a reduced model at states: the formulas of rnc_pin/model/, for the kinds of rows that the package has.

   Notation, as in state_evaluation.py: E = [A; J2], E^-1 = [.., R], v = E^-1 [mu; v2], gamma = Edot v - [mudot; 0].
   All matrices are stored by rows. A twist or wrench is (linear, angular), about the origin of the world and in its
   axes. Every row of E and J1 is W^T J on one or two frames, where W is a wrench and J the Jacobian of the frame's
   joint; its rate is Wdot^T J + W^T Jdot. Exceptions: constant rows, momenta (rows of M), Ackermann rows, and rows of
   the user, whose values come from Python.

   Memory: sizes are checked when an Evaluator is made. Each method checks the byte length of each array that it gets.
   Pinocchio is called through its Python functions, with a pin.Data that belongs to the Evaluator alone. */

#define Py_LIMITED_API 0x030b0000
#define PY_SSIZE_T_CLEAN
#include <Python.h>
#include <math.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#define AMPLIFIED 1e10 /* amplification of rounding errors above which actuators count as dependent */
#define FARTHEST 1e4   /* square of the longest step of the integrator [rad or m] */

#include "rows_generated.h" /* kinds of rows, their formulas, and the sizes of their tables */

typedef struct {
    long kind, a, b, i[5];
    double w[NUMBERS];
} Row;

typedef struct {
    long joint;
    double R[9], p[3];
} Frame; /* placement on its joint */

typedef struct {
    double R[9], p[3]; /* placement in the world */
    double V[6], A[6]; /* twist about the world's origin, and its rate at zero joint acceleration */
    double v[3];       /* velocity of the frame's origin */
} Motion;

typedef struct {
    long joint;
    double p[3], W[6];   /* force at the point p, and torque */
    double pd[3], Wd[6]; /* their rates */
} Wrench;

typedef struct Derivatives Derivatives; /* see derivatives.h */

typedef struct {
    PyObject_HEAD Py_ssize_t nq, n, m, r, k, p, joints, frames; /* k rows of J1, p inputs */
    Py_ssize_t external, external_vertical;                     /* rows of the user in E and in J1 */
    int normalized, fused, timed, rates_need_C, ready;          /* timed: mu depends on time, see use_rates */
    Row *rows;        /* of E, then of J1, then of inputs on frames, then of forces */
    Py_ssize_t count; /* number of rows */
    long *columns;    /* columns of B of the inputs on frames */
    Frame *frame;
    long *support, *start; /* entries of v that move each joint, in the order from the root */
    long *owner;           /* joint of each entry of v (n) */
    double *constant;      /* constant rows (count, n); zero for the others */
    double *B, *mu,
        *lengths;   /* constant part of B (n, p); (m) at the last configuration; typical lengths of the rows of E (n) */
    double *mu_dot; /* rates over time of mu (m), less those of moving ground; after mu, NULL without it */
    int slides;     /* ground moves */
    double fast_length, fast_limit;
    double *laws;      /* of the forces that follow from the state, FORCE_NUMBERS each */
    Py_ssize_t forced; /* their number */
    double *force_row; /* one row (n), then forces of springs (n) */
    long *curved;      /* joints with curved coordinates: kind and first entry of v; NULL if one has no formula */
    Py_ssize_t curves; /* their number */
    Py_ssize_t work;   /* size of the part of scratch for work; states of one call follow */
    double *stages;    /* the integrator's part of scratch, after them */
    Motion *motion;
    double *scratch;
    PyObject *refs;           /* tuple of Python objects, see below */
    Py_buffer views[10];      /* M, J, nle, C, placements, q, v, acceleration, derivatives of inverse dynamics */
    int open;                 /* number of views */
    void *memory[24];         /* that the evaluator owns */
    int owns;                 /* number of its blocks */
    Derivatives *derivatives; /* NULL until they are used */
} Evaluator;

enum { V_M, V_J, V_NLE, V_C, V_PLACES, V_Q, V_V, V_A, V_TAU_Q, V_TAU_V, VIEWS };
enum { P_MODEL, P_DATA, P_Q, P_V, P_CONVENTION, P_CRBA, P_NLE, P_C };
enum { P_NORMALIZED = P_C + 1, P_EPS, P_EMPTY, P_INTEGRATE, P_A, P_RNEA, REFS };

/* ------------------------------------------------------------------ small vectors */

static void cross(const double *a, const double *b, double *out)
{
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

static void add_cross(double *out, const double *a, const double *b)
{
    out[0] += a[1] * b[2] - a[2] * b[1];
    out[1] += a[2] * b[0] - a[0] * b[2];
    out[2] += a[0] * b[1] - a[1] * b[0];
}

static void cross_motion(const double *x, const double *y,
                         double *out) /* rate of the twist y that is carried along by x */
{
    cross(x + 3, y, out);
    add_cross(out, x, y + 3);
    cross(x + 3, y + 3, out + 3);
}

static double dot(const double *a, const double *b, Py_ssize_t n)
{
    double sum = 0.0;
    for (Py_ssize_t i = 0; i < n; i++) sum += a[i] * b[i];
    return sum;
}

static void add(double *restrict out, double factor, const double *restrict x, Py_ssize_t n)
{
    for (Py_ssize_t i = 0; i < n; i++) out[i] += factor * x[i];
}

static void turn(const double *R, const double *x, double *out) /* R x */
{
    for (int i = 0; i < 3; i++) out[i] = dot(R + 3 * i, x, 3);
}

static void subtract(const double *a, const double *b, double *out, Py_ssize_t n)
{
    for (Py_ssize_t i = 0; i < n; i++) out[i] = a[i] - b[i];
}

static int all_finite(const double *x, Py_ssize_t n)
{
    double sum = 0.0;
    for (Py_ssize_t i = 0; i < n; i++) sum += x[i];
    return isfinite(sum);
}

static int within(long index, Py_ssize_t size) { return index >= 0 && index < size; }

/* ------------------------------------------------------------------ small matrices */

/* out (a, c) = left (a, b) right (b, c); rows of both may be longer than their columns */
static void multiply(const double *left, Py_ssize_t ldl, const double *right, Py_ssize_t ldr, double *out, Py_ssize_t a,
                     Py_ssize_t b, Py_ssize_t c)
{
    memset(out, 0, (size_t)(a * c) * sizeof(double));
    for (Py_ssize_t i = 0; i < a; i++)
        for (Py_ssize_t j = 0; j < b; j++)
            if (left[i * ldl + j] != 0.0) add(out + i * c, left[i * ldl + j], right + j * ldr, c);
}

/* out (a, c) = left^T right with left (b, a), right (b, c) */
static void multiply_transposed(const double *left, Py_ssize_t ldl, const double *right, Py_ssize_t ldr, double *out,
                                Py_ssize_t a, Py_ssize_t b, Py_ssize_t c)
{
    memset(out, 0, (size_t)(a * c) * sizeof(double));
    for (Py_ssize_t j = 0; j < b; j++)
        for (Py_ssize_t i = 0; i < a; i++)
            if (left[j * ldl + i] != 0.0) add(out + i * c, left[j * ldl + i], right + j * ldr, c);
}

static void rotate(double *restrict x, double *restrict y, double cosine, double sine, Py_ssize_t n)
{
    for (Py_ssize_t i = 0; i < n; i++) {
        double kept = x[i];
        x[i] = cosine * kept - sine * y[i], y[i] = sine * kept + cosine * y[i];
    }
}

/* Rotations that make the rows of A (m, k) orthogonal (Hestenes), also applied to V (m, n); rows that are rounding keep
   their place. */
static void orthogonalize(double *A, Py_ssize_t k, double *V, Py_ssize_t n, Py_ssize_t m)
{
    double least = 1e-32 * dot(A, A, m * k);
    int turned = 1;
    for (int sweep = 0; sweep < 30 && turned; sweep++) {
        turned = 0;
        for (Py_ssize_t i = 1; i < m; i++)
            for (Py_ssize_t j = 0; j < i; j++) {
                double *x = A + i * k, *y = A + j * k, a = dot(x, x, k), b = dot(y, y, k), c = dot(x, y, k);
                if (!(a > least && b > least && fabs(c) > 1e-15 * sqrt(a * b))) continue;
                double theta = (b - a) / (2 * c), t = copysign(1 / (fabs(theta) + sqrt(theta * theta + 1)), theta);
                double cosine = 1 / sqrt(t * t + 1);
                rotate(x, y, cosine, t * cosine, k), rotate(V + i * n, V + j * n, cosine, t * cosine, n);
                turned = 1;
            }
    }
}

/* out (a) = left (a, b) x (b) */
static void multiply_vector(const double *left, const double *x, double *out, Py_ssize_t a, Py_ssize_t b)
{
    for (Py_ssize_t i = 0; i < a; i++) out[i] = dot(left + i * b, x, b);
}

/* inverse of (n, n) by LU factorization with row pivoting; false if it is singular. work: n * n */
static int invert(const double *matrix, double *out, double *work, Py_ssize_t n)
{
    memcpy(work, matrix, (size_t)(n * n) * sizeof(double));
    memset(out, 0, (size_t)(n * n) * sizeof(double));
    for (Py_ssize_t i = 0; i < n; i++) out[i * n + i] = 1.0;
    for (Py_ssize_t c = 0; c < n; c++) {
        Py_ssize_t best = c;
        for (Py_ssize_t i = c + 1; i < n; i++)
            if (fabs(work[i * n + c]) > fabs(work[best * n + c])) best = i;
        if (!(fabs(work[best * n + c]) > 0.0)) return 0;
        if (best != c)
            for (Py_ssize_t j = 0; j < n; j++) {
                double kept = work[c * n + j];
                work[c * n + j] = work[best * n + j], work[best * n + j] = kept;
                kept = out[c * n + j], out[c * n + j] = out[best * n + j], out[best * n + j] = kept;
            }
        double reciprocal = 1.0 / work[c * n + c];
        for (Py_ssize_t i = c + 1; i < n; i++) {
            if (work[i * n + c] == 0.0) continue;
            double factor = -work[i * n + c] * reciprocal;
            add(work + i * n + c, factor, work + c * n + c, n - c);
            add(out + i * n, factor, out + c * n, n);
        }
    }
    for (Py_ssize_t i = n - 1; i >= 0; i--) {
        double reciprocal = 1.0 / work[i * n + i];
        for (Py_ssize_t j = i + 1; j < n; j++)
            if (work[i * n + j] != 0.0) add(out + i * n, -work[i * n + j], out + j * n, n);
        for (Py_ssize_t j = 0; j < n; j++) out[i * n + j] *= reciprocal;
    }
    return 1;
}

/* Lower L (n, n) with L L^T = M, whose entry i, j is at i row + j column, for j <= i; false if M is not positive */
static int cholesky(const double *M, Py_ssize_t row, Py_ssize_t column, double *L, Py_ssize_t n)
{
    for (Py_ssize_t i = 0; i < n; i++)
        for (Py_ssize_t j = 0; j <= i; j++) {
            double rest = M[i * row + j * column] - dot(L + i * n, L + j * n, j);
            if (i > j) L[i * n + j] = rest / L[j * n + j];
            else if (rest > 0.0) L[i * n + i] = sqrt(rest);
            else return 0; /* also not a number */
        }
    return 1;
}

/* X <- (L L^T)^-1 X for X (r, c) */
static void solve_cholesky(const double *L, double *X, Py_ssize_t r, Py_ssize_t c)
{
    for (Py_ssize_t i = 0; i < r; i++) {
        for (Py_ssize_t j = 0; j < i; j++) add(X + i * c, -L[i * r + j], X + j * c, c);
        for (Py_ssize_t j = 0; j < c; j++) X[i * c + j] *= 1.0 / L[i * r + i];
    }
    for (Py_ssize_t i = r - 1; i >= 0; i--) {
        for (Py_ssize_t j = i + 1; j < r; j++) add(X + i * c, -L[j * r + i], X + j * c, c);
        for (Py_ssize_t j = 0; j < c; j++) X[i * c + j] *= 1.0 / L[i * r + i];
    }
}

/* x <- H^-1 x for symmetric positive definite H (r, r); false if it is not. work: r * r */
static int solve_positive_definite(const double *H, double *x, double *work, Py_ssize_t r)
{
    if (!cholesky(H, 1, r, work, r)) return 0;
    solve_cholesky(work, x, r, 1);
    return all_finite(x, r);
}

/* ------------------------------------------------------------------ frames */

/* placements of all frames, from those of the joints (joints, 12): rotation by columns, then translation */
static void place(Evaluator *ev, const double *places)
{
    for (Py_ssize_t f = 0; f < ev->frames; f++) {
        const Frame *on = ev->frame + f;
        const double *joint = places + 12 * on->joint;
        Motion *out = ev->motion + f;
        for (int i = 0; i < 3; i++) {
            double x = joint[i], y = joint[3 + i], z = joint[6 + i];
            for (int j = 0; j < 3; j++) out->R[3 * i + j] = x * on->R[j] + y * on->R[3 + j] + z * on->R[6 + j];
            out->p[i] = x * on->p[0] + y * on->p[1] + z * on->p[2] + joint[9 + i];
        }
    }
}

static void column(const double *J, Py_ssize_t n, Py_ssize_t c, double *S)
{
    for (int i = 0; i < 6; i++) S[i] = J[i * n + c];
}

/* Twist of a joint, and its rate A at zero joint accelerations, unless NULL. Axes are constant in the body that they
   move, so the rate grows along the chain by U x (V - U), with the twists U and V of a joint's bodies. */
static void move_joint(const Evaluator *ev, const double *J, const double *v, long joint, double *V, double *A)
{
    double S[6], own[6] = {0.0}, before[6] = {0.0}, turned[6];
    long last = ev->start[joint + 1];
    memset(V, 0, 6 * sizeof(double));
    if (A) memset(A, 0, 6 * sizeof(double));
    for (long s = ev->start[joint]; s < last; s++) {
        long c = ev->support[s];
        column(J, ev->n, c, S);
        add(V, v[c], S, 6);
        if (!A) continue;
        add(own, v[c], S, 6);
        if (s + 1 < last && ev->owner[ev->support[s + 1]] == ev->owner[c]) continue;
        cross_motion(before, own, turned);
        add(A, 1.0, turned, 6);
        memcpy(before, V, sizeof before);
        memset(own, 0, sizeof own);
    }
}

/* velocities of all frames; rates of their twists too if asked for */
static void move(Evaluator *ev, const double *J, const double *v, int with_rates)
{
    for (Py_ssize_t f = 0; f < ev->frames; f++) {
        Motion *out = ev->motion + f;
        if (f && ev->frame[f].joint == ev->frame[f - 1].joint) {
            memcpy(out->V, out[-1].V, sizeof out->V);
            memcpy(out->A, out[-1].A, sizeof out->A);
        } else move_joint(ev, J, v, ev->frame[f].joint, out->V, with_rates ? out->A : NULL);
        cross(out->V + 3, out->p, out->v);
        for (int i = 0; i < 3; i++) out->v[i] += out->V[i];
    }
}

/* dJ (6, n): rates of the columns of J, which their joints carry along */
static void jacobian_rates(const Evaluator *ev, const double *J, const double *v, double *dJ)
{
    double V[6], S[6], turned[6];
    for (Py_ssize_t c = 0; c < ev->n; c++) {
        if (!c || ev->owner[c] != ev->owner[c - 1]) move_joint(ev, J, v, ev->owner[c], V, NULL);
        column(J, ev->n, c, S);
        cross_motion(V, S, turned);
        for (int i = 0; i < 6; i++) dJ[i * ev->n + c] = turned[i];
    }
}

/* ------------------------------------------------------------------ wrenches of the rows */

#include "wrenches.h"

/* row += W^T J of a joint */
static void project(const Evaluator *ev, const double *W, long joint, const double *J, double *row)
{
    Py_ssize_t n = ev->n;
    for (long s = ev->start[joint]; s < ev->start[joint + 1]; s++) {
        const double *column = J + ev->support[s];
        double sum = 0.0;
        for (int i = 0; i < 6; i++) sum += W[i] * column[i * n];
        row[ev->support[s]] += sum;
    }
}

/* ------------------------------------------------------------------ other rows */

/* Momentum row i[1] of the joint a whose entries of v start at i[0]. If i[2] has bits, the joint allows these
   components of a spatial velocity; the momentum is transformed to the joint's fixed frame, by the placement w of the
   world in it. Returns the size of the block; X are the factors of its rows of M, X_rate their rates. */
static int momentum(const Row *row, const double *places, const double *v, double *X, double *X_rate)
{
    memset(X, 0, 6 * sizeof(double));
    memset(X_rate, 0, 6 * sizeof(double));
    if (!row->i[2]) {
        X[row->i[1]] = 1.0;
        return (int)row->i[3];
    }
    int of[6], size = 0;
    for (int c = 0; c < 6; c++)
        if (row->i[2] >> c & 1) of[size++] = c;
    const double *joint = places + 12 * row->a;
    double R[9], p[3], full[6], spatial[6] = {0.0}, turned[6];
    for (int i = 0; i < 3; i++) { /* placement of the body in the fixed frame */
        for (int j = 0; j < 3; j++) R[3 * i + j] = dot(row->w + 3 * i, joint + 3 * j, 3);
        p[i] = dot(row->w + 3 * i, joint + 9, 3) + row->w[9 + i];
    }
    int c = of[row->i[1]]; /* row c of the dual action matrix [R 0; p x R, R] */
    for (int j = 0; j < 3; j++) {
        double column[3] = {R[j], R[3 + j], R[6 + j]}, moment[3];
        cross(p, column, moment);
        full[j] = c < 3 ? column[c] : moment[c - 3];
        full[3 + j] = c < 3 ? 0.0 : column[c - 3];
    }
    for (int j = 0; j < size; j++) X[j] = full[of[j]];
    if (v) { /* times the dual action [w x, 0; v x, w x] of the body's velocity, restricted to the block */
        double kept[6] = {0.0}, part[3];
        for (int j = 0; j < size; j++) spatial[of[j]] = v[row->i[0] + j], kept[of[j]] = X[j];
        cross(kept, spatial + 3, turned); /* x^T (w x) = (x x w)^T */
        cross(kept + 3, spatial, part);
        cross(kept + 3, spatial + 3, turned + 3);
        for (int j = 0; j < 3; j++) turned[j] += part[j];
        for (int j = 0; j < size; j++) X_rate[j] = turned[of[j]];
    }
    return size;
}

/* Ackermann linkage; out: f, f_l, f_r, f_lr */
static void ackermann(const Row *row, const double *q, double *out)
{
    double directions[4], parameters[2] = {row->w[3], row->w[0]};
    for (int side = 0; side < 2; side++) {
        const double *at = q + row->i[2 * side];
        int continuous = row->i[4] >> side & 1;
        directions[2 * side] = continuous ? at[0] : cos(at[0]);
        directions[2 * side + 1] = row->w[1 + side] * (continuous ? at[1] : sin(at[0]));
    }
    linkage(directions, parameters, out);
}

/* ------------------------------------------------------------------ stages at one state */

/* Kinematics at a configuration: M (n, n), J (6, n), placements (joints, 12). */
static Py_ssize_t kinematics_size(const Evaluator *ev) { return ev->n * ev->n + 6 * ev->n + 12 * ev->joints; }

/* Call a function of Pinocchio, whose last arguments are v or a convention, and an acceleration if v comes first */
static int called(Evaluator *ev, int function, int with_velocity)
{
    PyObject *of[REFS];
    for (int i = 0; i < REFS; i++) of[i] = PyTuple_GetItem(ev->refs, i);
    PyObject *last = with_velocity ? of[P_V] : of[P_CONVENTION], *acceleration = function == P_RNEA ? of[P_A] : NULL;
    PyObject *result =
        PyObject_CallFunctionObjArgs(of[function], of[P_MODEL], of[P_DATA], of[P_Q], last, acceleration, NULL);
    Py_XDECREF(result);
    return result != NULL;
}

static void by_rows(const double *columns, double *out, Py_ssize_t rows, Py_ssize_t n)
{
    for (Py_ssize_t i = 0; i < rows; i++)
        for (Py_ssize_t j = 0; j < n; j++) out[i * n + j] = columns[j * rows + i];
}

static int take_position(Evaluator *ev, const double *q, double *P)
{
    Py_ssize_t n = ev->n;
    memcpy(ev->views[V_Q].buf, q, (size_t)ev->nq * sizeof(double));
    if (!called(ev, P_CRBA, 0)) return 0;
    memcpy(P, ev->views[V_M].buf, (size_t)(n * n) * sizeof(double)); /* symmetric */
    by_rows(ev->views[V_J].buf, P + n * n, 6, n);
    memcpy(P + n * n + 6 * n, ev->views[V_PLACES].buf, (size_t)(12 * ev->joints) * sizeof(double));
    return 1;
}

static void take_state(Evaluator *ev, const double *q, const double *v)
{
    memcpy(ev->views[V_Q].buf, q, (size_t)ev->nq * sizeof(double));
    memcpy(ev->views[V_V].buf, v, (size_t)ev->n * sizeof(double));
}

/* Rows first to last of E and J1, into out; false if one is not defined here. */
static int assemble(Evaluator *ev, const double *q, const double *P, const double *external, Py_ssize_t first,
                    Py_ssize_t last, double *out)
{
    Py_ssize_t n = ev->n;
    const double *J = P + n * n, *places = J + 6 * n;
    memcpy(out, ev->constant + first * n, (size_t)((last - first) * n) * sizeof(double));
    for (Py_ssize_t i = first; i < last; i++, out += n) {
        const Row *row = ev->rows + i;
        Wrench on[2];
        double W[6];
        int sides = wrenches(ev, row, 0, on);
        if (sides == 0) return 0;
        for (int side = 0; side < sides; side++) {
            about_origin(on + side, W);
            project(ev, W, on[side].joint, J, out);
        }
        if (row->kind == EXTERNAL) memcpy(out, external + row->i[0] * n, (size_t)n * sizeof(double));
        if (row->kind == MOMENTUM) {
            double X[6], rate[6];
            int size = momentum(row, places, NULL, X, rate);
            for (int j = 0; j < size; j++) add(out, X[j], P + (row->i[0] + j) * n, n);
        }
        if (row->kind == ACKERMANN) {
            double f[4];
            ackermann(row, q, f);
            out[row->i[1]] = row->w[1] * f[1];
            out[row->i[3]] = row->w[2] * f[2];
        }
    }
    return 1;
}

/* E and E^-1 into F; false where a row is not defined, E is singular, or other rows have to be considered. */
static int factorize(Evaluator *ev, const double *q, const double *P, const double *external, double *F)
{
    Py_ssize_t n = ev->n;
    double *inverse = F + n * n, rows = ev->fast_length, columns = 0.0;
    place(ev, P + n * n + 6 * n);
    if (!assemble(ev, q, P, external, 0, n, F) || !invert(F, inverse, ev->scratch, n)) return 0;
    for (Py_ssize_t i = 0; i < ev->m && ev->slides; i++)
        if (on_moving_ground(ev->rows + i)) {
            Wrench on[2];
            wrenches(ev, ev->rows + i, 0, on);
            ev->mu[i] = slide(ev->rows + i, on);
        }
    rows += dot(F, F, n * n);
    columns = dot(inverse, inverse, n * n);
    if (rows * columns < ev->fast_limit) return 1; /* a bound on the dependence of every row */
    for (Py_ssize_t i = 0; i < n; i++) {
        double column = 0.0, length = fmax(sqrt(dot(F + i * n, F + i * n, n)), ev->lengths[i]);
        for (Py_ssize_t j = 0; j < n; j++) column += inverse[j * n + i] * inverse[j * n + i];
        if (!(length * length * column < ev->fast_limit)) return 0;
    }
    return 1;
}

/* v = E^-1 [mu; v2] */
static void velocity(const Evaluator *ev, const double *F, const double *mu, const double *v2, double *v)
{
    Py_ssize_t n = ev->n, m = ev->m;
    for (Py_ssize_t i = 0; i < n; i++) {
        const double *row = F + n * n + i * n;
        v[i] = dot(row + m, v2, ev->r) + (mu ? dot(row, mu, m) : 0.0);
    }
}

/* H = R^T M R; work: n * r */
static void inertia(const Evaluator *ev, const double *P, const double *F, double *H, double *work)
{
    Py_ssize_t n = ev->n, r = ev->r;
    const double *R = F + n * n + ev->m;
    multiply(P, n, R, n, work, n, n, r);
    multiply_transposed(R, n, work, r, H, r, n, r);
}

static Py_ssize_t dynamics_size(const Evaluator *ev) { return 4 * ev->n + ev->r * ev->r; }

/* S: bias, gamma, E^-1 gamma and M E^-1 gamma - bias (n each), then H (r, r) */
static int biases(Evaluator *ev, const double *q, const double *P, const double *F, const double *v,
                  const double *external, double *S)
{
    Py_ssize_t n = ev->n;
    double *gamma = S + n, *solved = gamma + n, *unforced = solved + n;
    take_state(ev, q, v);
    if (!called(ev, P_NLE, 1)) return 0;
    memcpy(S, ev->views[V_NLE].buf, (size_t)n * sizeof(double));
    place(ev, P + n * n + 6 * n);
    move(ev, P + n * n, v, 1);
    for (Py_ssize_t i = 0; i < n; i++) {
        const Row *row = ev->rows + i;
        Wrench on[2];
        double W[6], sum = 0.0;
        int sides = wrenches(ev, row, 1, on);
        for (int side = 0; side < sides; side++) {
            const Motion *frame = ev->motion + (side || sides == 1 ? row->a : row->b);
            about_origin(on + side, W);
            sum += dot(W, frame->A, 6);
            rate_about_origin(on + side, W);
            sum += dot(W, frame->V, 6);
        }
        if (on_moving_ground(row)) sum -= slide_rate(row, on);
        if (row->kind == EXTERNAL) sum = external[row->i[0]];
        if (row->kind == MOMENTUM) {
            double X[6], rate[6];
            int size = momentum(row, P + n * n + 6 * n, NULL, X, rate);
            sum = dot(X, S + row->i[0], size);
        }
        if (row->kind == ACKERMANN) {
            double f[4], left = row->w[1] * v[row->i[1]], right = row->w[2] * v[row->i[3]];
            ackermann(row, q, f);
            sum = 2 * f[3] * left * right - f[0] * (left * left + right * right);
        }
        gamma[i] = ev->mu_dot && i < ev->m ? sum - ev->mu_dot[i] : sum;
    }
    for (Py_ssize_t i = 0; i < n; i++) solved[i] = dot(F + n * n + i * n, gamma, n);
    for (Py_ssize_t i = 0; i < n; i++) unforced[i] = dot(P + i * n, solved, n) - S[i];
    inertia(ev, P, F, S + 4 * n, ev->scratch);
    return 1;
}

/* v2_dot = H^-1 R^T (force + unforced); false if it is not finite. work: r * r */
static int accelerate(const Evaluator *ev, const double *F, const double *S, const double *force, double *v2_dot,
                      double *work)
{
    Py_ssize_t n = ev->n, r = ev->r;
    const double *R = F + n * n + ev->m, *unforced = S + 3 * n, *H = S + 4 * n;
    memset(v2_dot, 0, (size_t)r * sizeof(double));
    for (Py_ssize_t i = 0; i < n; i++) add(v2_dot, force[i] + unforced[i], R + i * n, r);
    return solve_positive_definite(H, v2_dot, work, r);
}

/* B (n, p) with the columns of inputs on frames; work: n */
static void input_matrix(Evaluator *ev, const double *q, const double *P, double *B, double *work)
{
    Py_ssize_t n = ev->n, p = ev->p, first = n + ev->k, last = ev->count - ev->forced;
    memcpy(B, ev->B, (size_t)(n * p) * sizeof(double));
    if (last > first) place(ev, P + n * n + 6 * n);
    for (Py_ssize_t i = first; i < last; i++) {
        assemble(ev, q, P, NULL, i, i + 1, work);
        for (Py_ssize_t j = 0; j < n; j++) B[j * p + ev->columns[i - first]] = work[j];
    }
}

/* force = B T; work: n */
static void input_force(Evaluator *ev, const double *q, const double *P, const double *T, double *force, double *work)
{
    Py_ssize_t n = ev->n, p = ev->p, first = n + ev->k, last = ev->count - ev->forced;
    for (Py_ssize_t i = 0; i < n; i++) force[i] = dot(ev->B + i * p, T, p);
    for (Py_ssize_t i = first; i < last; i++) {
        assemble(ev, q, P, NULL, i, i + 1, work);
        add(force, T[ev->columns[i - first]], work, n);
    }
}

/* J1 (k, n) and A_star (k, r) into Y */
static int vertical(Evaluator *ev, const double *q, const double *P, const double *F, const double *external, double *Y)
{
    Py_ssize_t n = ev->n, k = ev->k;
    place(ev, P + n * n + 6 * n);
    if (!assemble(ev, q, P, external, n, n + k, Y)) return 0;
    multiply(Y, n, F + n * n + ev->m, n, Y + k * n, k, n, ev->r);
    return 1;
}

/* Rates of rows first to last, into out; C (n, n) is for momenta, may be NULL without them. */
static void assemble_rates(Evaluator *ev, const double *q, const double *P, const double *dJ, const double *v,
                           const double *C, const double *external, Py_ssize_t first, Py_ssize_t last, double *out)
{
    Py_ssize_t n = ev->n;
    const double *J = P + n * n, *places = J + 6 * n;
    memset(out, 0, (size_t)((last - first) * n) * sizeof(double));
    for (Py_ssize_t i = first; i < last; i++, out += n) {
        const Row *row = ev->rows + i;
        Wrench on[2];
        double W[6];
        int sides = wrenches(ev, row, 1, on);
        for (int side = 0; side < sides; side++) {
            about_origin(on + side, W);
            project(ev, W, on[side].joint, dJ, out);
            rate_about_origin(on + side, W);
            project(ev, W, on[side].joint, J, out);
        }
        if (row->kind == EXTERNAL) memcpy(out, external + row->i[0] * n, (size_t)n * sizeof(double));
        if (row->kind == MOMENTUM) {
            double X[6], rate[6];
            int size = momentum(row, places, v, X, rate);
            for (int j = 0; j < size; j++) {
                Py_ssize_t of = row->i[0] + j;
                add(out, rate[j], P + of * n, n);
                for (Py_ssize_t c = 0; c < n; c++) out[c] += X[j] * (C[of * n + c] + C[c * n + of]);
            }
        }
        if (row->kind == ACKERMANN) {
            double f[4], left = row->w[1] * v[row->i[1]], right = row->w[2] * v[row->i[3]];
            ackermann(row, q, f);
            out[row->i[1]] = row->w[1] * (f[3] * right - f[0] * left);
            out[row->i[3]] = row->w[2] * (f[3] * left - f[0] * right);
        }
    }
}

static Py_ssize_t rates_size(const Evaluator *ev)
{ return ev->n * ev->n + ev->n * ev->r + 2 * ev->k * (ev->n + ev->r) + ev->n + ev->k; }

/* D: E_dot (n, n), R_dot (n, r), J1 (k, n), A_star (k, r), J1_dot (k, n), A_star_dot (k, r), E v (n), J1 v (k).
   Pinocchio's C is current if there are momenta. of_J1, E_rates and J1_rates have values of the user's rows.
   work: 2 n * n + 6 n. False if a row of J1 is undefined. */
static int rates(Evaluator *ev, const double *q, const double *P, const double *F, const double *v, const double *of_J1,
                 const double *E_rates, const double *J1_rates, double *D, double *work)
{
    Py_ssize_t n = ev->n, r = ev->r, k = ev->k;
    const double *inverse = F + n * n, *R = inverse + ev->m;
    double *R_dot = D + n * n, *Y = R_dot + n * r, *J1_dot = Y + k * (n + r), *A_star_dot = J1_dot + k * n;
    double *C = work, *product = work + n * n, *dJ = product + n * n, *rows = A_star_dot + k * r, *v1 = rows + n;
    if (!vertical(ev, q, P, F, of_J1, Y)) return 0;
    if (ev->rates_need_C) by_rows(ev->views[V_C].buf, C, n, n);
    jacobian_rates(ev, P + n * n, v, dJ);
    move(ev, P + n * n, v, 0);
    assemble_rates(ev, q, P, dJ, v, C, E_rates, 0, n, D);
    assemble_rates(ev, q, P, dJ, v, C, J1_rates, n, n + k, J1_dot);
    multiply(D, n, R, n, product, n, n, r);
    multiply(inverse, n, product, r, R_dot, n, n, r);
    for (Py_ssize_t i = 0; i < n * r; i++) R_dot[i] = -R_dot[i];
    multiply(J1_dot, n, R, n, A_star_dot, k, n, r);
    for (Py_ssize_t i = 0; i < k; i++)
        for (Py_ssize_t j = 0; j < n; j++) add(A_star_dot + i * r, Y[i * n + j], R_dot + j * r, r);
    for (Py_ssize_t i = 0; i < n; i++) rows[i] = dot(F + i * n, v, n);
    for (Py_ssize_t i = 0; i < k; i++) v1[i] = dot(Y + i * n, v, n);
    return 1;
}

/* Value of a row at q, where the frames are placed; zero if Python evaluates it. */
static double value(const Evaluator *ev, const Row *row, const double *q)
{
    const Motion *a = ev->motion + row->a, *b = ev->motion + row->b;
    double d[3];
    switch (row->i[4]) {
    case JOINT: return q[row->i[3]];
    case CONTINUOUS_JOINT: return atan2(q[row->i[3] + 1], q[row->i[3]]);
    case COORDINATE: return a->p[row->i[3]];
    case HEADING: return atan2(a->R[3 + row->i[0]], a->R[row->i[0]]);
    case ELEVATION: return atan2(a->R[6 + row->i[0]], hypot(a->R[row->i[0]], a->R[3 + row->i[0]]));
    case LENGTH:
        for (int c = 0; c < 3; c++) d[c] = b->p[c] - a->p[c];
        return sqrt(dot(d, d, 3));
    }
    return 0.0;
}

/* Values of the reducing outputs (r), then of the vertical outputs (k); zero for those that Python evaluates. */
static void values(Evaluator *ev, const double *q, const double *P, double *x)
{
    Py_ssize_t n = ev->n;
    place(ev, P + n * n + 6 * n);
    for (Py_ssize_t i = ev->m; i < n + ev->k; i++) *x++ = value(ev, ev->rows + i, q);
}

/* Law of force f at q, where the frames are placed, with the rate w of its row; spring: its part with a potential. See
   KernelForce in kernel_rows.py. The difference of values that turn is in (-pi, pi]. */
static double law(const Evaluator *ev, Py_ssize_t f, const double *q, double w, double *spring)
{
    const double *of = ev->laws + f * FORCE_NUMBERS;
    double force = of[F_CONSTANT] - of[F_DAMPING] * w;
    *spring = 0.0;
    if (of[F_STIFFNESS] != 0.0) {
        double apart = of[F_REST] - value(ev, ev->rows + ev->count - ev->forced + f, q), turn = 2 * M_PI;
        if (of[F_TURNS] != 0.0) apart = (M_PI - apart) / turn, apart = M_PI - turn * (apart - floor(apart));
        *spring = of[F_STIFFNESS] * apart;
    }
    if (of[F_LIMIT] != 0.0) force -= of[F_LIMIT] * tanh(w / of[F_SPEED]);
    return force + *spring;
}

/* Add the forces that follow from the state, and those of the springs unless NULL. The frames are placed. False if a
   row is not defined here. */
static int add_passive(Evaluator *ev, const double *q, const double *P, const double *v, double *force, double *springs)
{
    double spring;
    Py_ssize_t n = ev->n, first = ev->count - ev->forced;
    for (Py_ssize_t f = 0; f < ev->forced; f++) {
        if (!assemble(ev, q, P, NULL, first + f, first + f + 1, ev->force_row)) return 0;
        add(force, law(ev, f, q, dot(ev->force_row, v, n), &spring), ev->force_row, n);
        if (springs && spring != 0.0) add(springs, spring, ev->force_row, n);
    }
    return 1;
}

/* K: C (n, n), V (r, r), g (n), G (r). Pinocchio's C is current. work: 2 n * r */
static void coriolis(Evaluator *ev, const double *P, const double *F, const double *v, const double *bias,
                     const double *D, double *K, double *work)
{
    Py_ssize_t n = ev->n, r = ev->r;
    const double *R = F + n * n + ev->m, *R_dot = D + n * n;
    double *V = K + n * n, *g = V + r * r, *G = g + n;
    by_rows(ev->views[V_C].buf, K, n, n);
    multiply(P, n, R_dot, r, work, n, n, r);
    multiply(K, n, R, n, work + n * r, n, n, r);
    add(work, 1.0, work + n * r, n * r);
    multiply_transposed(R, n, work, r, V, r, n, r);
    for (Py_ssize_t i = 0; i < n; i++) g[i] = bias[i] - dot(K + i * n, v, n);
    multiply_transposed(R, n, g, 1, G, r, n, 1);
}

/* ------------------------------------------------------------------ arguments of the methods */

#define MOST 24 /* arrays of one call */
#define READ PyBUF_SIMPLE
#define WRITE PyBUF_WRITABLE

/* Arrays of one call. Each is a contiguous block of doubles: count states of a given size. */
typedef struct {
    Py_buffer views[MOST];
    int open;
    Py_ssize_t count, sizes[MOST];
    double numbers[MOST]; /* arguments that are no arrays */
    void *memory;         /* released with the arrays */
} Arrays;

static void close_arrays(Arrays *all)
{
    while (all->open) PyBuffer_Release(all->views + --all->open);
    free(all->memory);
    all->memory = NULL;
}

/* The first array sets the number of states; the others have to agree. */
static int take(Arrays *all, PyObject *object, Py_ssize_t size, int flags, double **out)
{
    Py_buffer *view = all->views + all->open;
    Py_ssize_t bytes = size * (Py_ssize_t)sizeof(double);
    *out = NULL;
    if (PyObject_GetBuffer(object, view, flags) < 0) return 0;
    all->open++;
    if (all->count < 0 && bytes) all->count = view->len / bytes;
    if (view->len != all->count * bytes) {
        PyErr_Format(PyExc_ValueError, "kernel: array of %zd bytes, expected %zd states of %zd numbers", view->len,
                     all->count, size);
        return 0;
    }
    *out = view->buf;
    return 1;
}

static int optional(Arrays *all, PyObject *object, Py_ssize_t size, double **out)
{
    *out = NULL;
    return object == Py_None || take(all, object, size, READ, out);
}

/* Arrays of given sizes, the last of which are written; false with an error */
static int take_sized(Arrays *all, PyObject *const *args, const Py_ssize_t *sizes, int count, int written, double **x)
{
    for (int i = 0; i < count; i++)
        if (!take(all, args[i], sizes[i], i < count - written ? READ : WRITE, x + i)) return 0;
    return 1;
}

static PyObject *result(Arrays *all, int outcome) /* -1: a Python error; else False or True */
{
    close_arrays(all);
    return outcome < 0 ? NULL : PyBool_FromLong(outcome);
}

static int expect(const Evaluator *ev, Py_ssize_t found, Py_ssize_t expected) /* ev: NULL for a function */
{
    if ((!ev || ev->ready) && found == expected) return 1;
    PyErr_Format(PyExc_TypeError, "kernel: expected %zd arguments, found %zd", expected, found);
    return 0;
}

/* Zeros in parts: pairs of a pointer's address and its numbers, a Py_ssize_t, then NULL. False with an error. */
static int allocate(void **memory, ...)
{
    Py_ssize_t size = 0;
    for (int counted = 0; counted < 2; counted++) {
        double **part;
        va_list parts;
        if (counted && !(*memory = calloc((size_t)size + 1, sizeof(double)))) return PyErr_NoMemory(), 0;
        va_start(parts, memory);
        for (size = 0; (part = va_arg(parts, double **)); size += va_arg(parts, Py_ssize_t))
            if (counted) *part = (double *)*memory + size;
        va_end(parts);
    }
    return 1;
}

/* Numbers of y of the integrator: v2, integrals of J1 v, time if mu depends on it, and work */
static Py_ssize_t integrated(const Evaluator *ev) { return ev->r + ev->k + (ev->timed ? 2 : 1); }

/* Numbers of an array at one state, by the letter that names it in the signature of a method */
static Py_ssize_t size_of(const Evaluator *ev, char letter)
{
    Py_ssize_t n = ev->n, r = ev->r, k = ev->k;
    switch (letter) {
    case 'q': return ev->nq;
    case 'v': return n; /* velocities, accelerations and forces */
    case 'r': return r; /* v2, its rate and reduced forces */
    case 'm': return ev->m;
    case 'k': return k;
    case 'T': return ev->p;
    case 'P': return kinematics_size(ev);
    case 'F': return 2 * n * n; /* E and E^-1 */
    case 'S': return dynamics_size(ev);
    case 'D': return rates_size(ev);
    case 'H': return r * r;
    case 'B': return n * ev->p;
    case 'G': return r * ev->p;
    case 'J': return k * n;
    case 'Y': return k * (n + r); /* J1 and A_star */
    case 'x': return r + k;       /* values of outputs */
    case 'y': return integrated(ev);
    case 'd': return n + integrated(ev);                  /* state derivative */
    case 'i': return ev->nq + 2 * n + 2 * integrated(ev); /* state on a trace */
    case 'e': return ev->external;
    case 'E': return ev->external * n;
    case 'W': return ev->external_vertical * n;
    case '2': return 2 * n;
    case 'w': return ev->count * NUMBERS;
    case 'u': return 2 * ev->m;
    }
    return 1;
}

/* Arrays with the sizes of a signature. "!" marks those that are written, "?" those that may be None. */
static int take_all(const Evaluator *ev, Arrays *all, PyObject *const *args, const char *signature, double **x)
{
    for (int i = 0; *signature; i++) {
        char letter = *signature++, mark = *signature == '!' || *signature == '?' ? *signature++ : ' ';
        all->sizes[i] = size_of(ev, letter), x[i] = NULL;
        if (mark == '?' && args[i] == Py_None) continue;
        if (!take(all, args[i], all->sizes[i], mark == '!' ? WRITE : READ, x + i)) return 0;
    }
    return 1;
}

static Py_ssize_t arguments(const char *signature)
{
    Py_ssize_t count = 0;
    for (; *signature; signature++) count += *signature != '!' && *signature != '?';
    return count;
}

/* Pointers to the arrays of the next state */
static void advance(const Arrays *all, double **x, Py_ssize_t count)
{
    for (Py_ssize_t i = 0; i < count; i++)
        if (x[i]) x[i] += all->sizes[i];
}

/* What a method does at one state. False if the general way has to decide; -1: an error */
typedef int (*AtState)(Evaluator *ev, double *const *x);

static PyObject *each_state(Evaluator *ev, PyObject *const *args, Py_ssize_t given, const char *signature, AtState one)
{
    Arrays all = {.count = -1};
    double *x[MOST];
    int ok = expect(ev, given, arguments(signature)) && take_all(ev, &all, args, signature, x) ? 1 : -1;
    for (Py_ssize_t i = 0; i < all.count && ok > 0; i++, advance(&all, x, given)) ok = one(ev, x);
    return result(&all, ok);
}

/* A method that calls a function at each state; see ``size_of`` for the letters of a signature. */
#define METHOD(name, signature, one)                                                                                   \
    static PyObject *name(Evaluator *ev, PyObject *const *args, Py_ssize_t given)                                      \
    { return each_state(ev, args, given, signature, one); }

/* ------------------------------------------------------------------ methods */

static Py_ssize_t terms_size(const Evaluator *ev)
{
    Py_ssize_t n = ev->n, r = ev->r;
    return kinematics_size(ev) + 2 * n * n + n + rates_size(ev) + n * n + r * r + n + r + n + r * r + (n + r) * ev->p
           + 2 * n;
}

static int configure_known(Evaluator *ev, double *const *x)
{ return x[3] || !ev->external ? factorize(ev, x[0], x[1], x[3], x[2]) : 0; }

static int configure_new(Evaluator *ev, double *const *x)
{ return take_position(ev, x[0], x[1]) ? configure_known(ev, x) : -1; }

/* q, P, F, external rows, True if P is known */
static PyObject *configure(Evaluator *ev, PyObject *const *args, Py_ssize_t given)
{
    if (!expect(ev, given, 5)) return NULL;
    return args[4] == Py_True ? each_state(ev, args, 4, "qPF!E?", configure_known)
                              : each_state(ev, args, 4, "qP!F!E?", configure_new);
}

static int velocity_at(Evaluator *ev, double *const *x) { return velocity(ev, x[0], x[1], x[2], x[3]), 1; }
METHOD(full_velocity, "Fm?rv!", velocity_at)

static int inertia_at(Evaluator *ev, double *const *x) { return inertia(ev, x[0], x[1], x[2], ev->scratch), 1; }
METHOD(reduced_inertia, "PFH!", inertia_at)

/* Use mu and its rates (m each) until the end of this call; those of moving ground are found at each configuration.
   NULL: those of the table. False if they are missing, or if the rows have none. */
static int use_rates(Evaluator *ev, const double *rates)
{
    if (!rates || !ev->mu) return !rates && !ev->timed;
    memcpy(ev->mu, rates, (size_t)(2 * ev->m) * sizeof(double));
    return 1;
}

/* q, P, F, v, external, mu and its rates or None, S */
static int biases_at(Evaluator *ev, double *const *x)
{
    if ((!x[4] && ev->external) || (x[5] && !use_rates(ev, x[5]))) return 0;
    return biases(ev, x[0], x[1], x[2], x[3], x[4], x[6]) ? 1 : -1;
}
METHOD(bias_forces, "qPFve?u?S!", biases_at)

static int acceleration_at(Evaluator *ev, double *const *x)
{ return accelerate(ev, x[0], x[1], x[2], x[3], ev->scratch); }
METHOD(acceleration, "FSvr!", acceleration_at)

/* F, S, B, accelerations of unit inputs (r, p), and those without inputs (r) */
static int input_accelerations_at(Evaluator *ev, double *const *x)
{
    Py_ssize_t n = ev->n, r = ev->r, p = ev->p;
    const double *R = x[0] + n * n + ev->m, *unforced = x[1] + 3 * n, *H = x[1] + 4 * n;
    if (!cholesky(H, 1, r, ev->scratch, r)) return 0;
    multiply_transposed(R, n, x[2], p, x[3], r, n, p);
    multiply_transposed(R, n, unforced, 1, x[4], r, n, 1);
    solve_cholesky(ev->scratch, x[3], r, p), solve_cholesky(ev->scratch, x[4], r, 1);
    return all_finite(x[3], r * p) && all_finite(x[4], r);
}
METHOD(input_accelerations, "FSBG!r!", input_accelerations_at)

static int vertical_at(Evaluator *ev, double *const *x)
{ return (x[3] || !ev->external_vertical) && vertical(ev, x[0], x[1], x[2], x[3], x[4]); }
METHOD(vertical_rows, "qPFW?Y!", vertical_at)

/* Rates at a state with a position and E. False if a row is undefined; -1: an error */
static int rates_with_C(Evaluator *ev, const double *q, const double *P, const double *F, const double *v,
                        const double *of_J1, const double *E_rates, const double *J1_rates, double *D)
{
    take_state(ev, q, v);
    if (ev->rates_need_C && !called(ev, P_C, 1)) return -1;
    return rates(ev, q, P, F, v, of_J1, E_rates, J1_rates, D, ev->scratch);
}

/* q, P, F, v, rows of J1, rates of E and of J1 from the user, D */
static int rates_at(Evaluator *ev, double *const *x)
{
    if ((!x[5] && ev->external) || ((!x[4] || !x[6]) && ev->external_vertical)) return 0;
    return rates_with_C(ev, x[0], x[1], x[2], x[3], x[4], x[5], x[6], x[7]);
}
METHOD(row_rates, "qPFvW?E?W?D!", rates_at)

/* E or J1 at the begin of a record, times v, with the bits of the rates */
static int row_velocities_at(Evaluator *ev, double *const *x)
{ return multiply_vector(x[0], x[1], x[2], ev->n, ev->n), 1; }
METHOD(row_velocities, "Fvv!", row_velocities_at)

static int vertical_velocities_at(Evaluator *ev, double *const *x)
{ return multiply_vector(x[0], x[1], x[2], ev->k, ev->n), 1; }
METHOD(vertical_velocities, "Yvk!", vertical_velocities_at)

/* q, P, v, record of the forces that follow from the state (n) and of those of springs (n) */
static int passive_at(Evaluator *ev, double *const *x)
{
    memset(x[3], 0, (size_t)(2 * ev->n) * sizeof(double));
    place(ev, x[1] + ev->n * ev->n + 6 * ev->n);
    return add_passive(ev, x[0], x[1], x[2], x[3], x[3] + ev->n);
}
METHOD(passive_forces, "qPv2!", passive_at)

static int values_at(Evaluator *ev, double *const *x) { return values(ev, x[0], x[1], x[2]), 1; }
METHOD(output_values, "qPx!", values_at)

/* q, P, J1, values: for outputs alone, without E. False if a row is undefined or Python evaluates it. */
static int outputs_at(Evaluator *ev, double *const *x)
{
    values(ev, x[0], x[1], x[3]);
    return !ev->external_vertical && assemble(ev, x[0], x[1], NULL, ev->n, ev->n + ev->k, x[2]);
}
METHOD(outputs, "qPJ!x!", outputs_at)

static int actuation_at(Evaluator *ev, double *const *x) { return input_matrix(ev, x[0], x[1], x[2], ev->scratch), 1; }
METHOD(actuation, "qPB!", actuation_at)

/* q, P, F, reduced force (r), record of the inputs T (p = r) with R^T B T = force. False if the general way has to
   decide, e.g. for dependent actuators. */
static int allocation_at(Evaluator *ev, double *const *x)
{
    Py_ssize_t n = ev->n, r = ev->r;
    double *B = ev->scratch, *matrix = B + n * r, *inverse = matrix + r * r, *work = inverse + r * r;
    if (ev->p != r) return 0;
    input_matrix(ev, x[0], x[1], B, work);
    multiply_transposed(x[2] + n * n + ev->m, n, B, r, matrix, r, n, r);
    if (!invert(matrix, inverse, work, r) || !all_finite(inverse, r * r)) return 0;
    for (Py_ssize_t a = 0; a < r; a++) {
        for (Py_ssize_t b = 0; b < r; b++) {
            double amplified = 0.0;
            for (Py_ssize_t c = 0; c < r; c++) amplified += fabs(matrix[a * r + c]) * fabs(inverse[c * r + b]);
            if (!(amplified < AMPLIFIED)) return 0;
        }
        x[4][a] = dot(inverse + a * r, x[3], r);
    }
    return 1;
}
METHOD(allocation, "qPFrT!", allocation_at)

static int numbers_set(Evaluator *ev, double *const *x) /* numbers of all rows */
{
    for (Py_ssize_t i = 0; i < ev->count; i++) memcpy(ev->rows[i].w, x[0] + i * NUMBERS, sizeof ev->rows->w);
    return 1;
}
METHOD(set_numbers, "w", numbers_set)

/* Finite numbers, and unit complex numbers and quaternions? Pinocchio's q is set. -1: a Python error */
static int admissible(Evaluator *ev, const double *q, const double *v2, const double *T)
{
    if (!all_finite(q, ev->nq) || !all_finite(v2, ev->r) || (T && !all_finite(T, ev->p))) return 0;
    memcpy(ev->views[V_Q].buf, q, (size_t)ev->nq * sizeof(double));
    if (!ev->normalized) return 1;
    PyObject *answer =
        PyObject_CallFunctionObjArgs(PyTuple_GetItem(ev->refs, P_NORMALIZED), PyTuple_GetItem(ev->refs, P_MODEL),
                                     PyTuple_GetItem(ev->refs, P_Q), PyTuple_GetItem(ev->refs, P_EPS), NULL);
    if (!answer) return -1;
    int found = answer == Py_True;
    Py_DECREF(answer);
    return found;
}

/* Position, E and its inverse of a caller's state, if its numbers are admissible. False if the general way has to
   decide; -1: an error */
static int locate_state(Evaluator *ev, const double *q, const double *v2, const double *T, double *P, double *F)
{
    int ok = admissible(ev, q, v2, T);
    if (ok > 0 && !take_position(ev, q, P)) ok = -1;
    return ok > 0 ? factorize(ev, q, P, NULL, F) : ok;
}

/* A method for one state of a caller or a stack of states (count, ...): a new array with size numbers of each, which
   follow the arguments in x. None where the general way has to decide, raise an error, or convert arrays: they are to
   be plain, float64, contiguous, of the right sizes, and with equal stacks. The last one may be None. */
static PyObject *fused(Evaluator *ev, PyObject *const *args, Py_ssize_t given, const char *signature, Py_ssize_t size,
                       AtState one)
{
    Arrays all = {.count = 1};
    double *x[MOST];
    Py_buffer *first = all.views, *made;
    PyObject *array = NULL;
    if (!expect(ev, given, arguments(signature))) return NULL;
    PyObject *empty = PyTuple_GetItem(ev->refs, P_EMPTY);
    int ok = ev->fused, stacked = 0;
    for (int i = 0; i < given && ok > 0; i++) {
        Py_buffer *view = all.views + i;
        all.sizes[i] = size_of(ev, signature[i]), x[i] = NULL;
        if (signature[i + 1] == '?' && args[i] == Py_None) break;
        if (PyObject_GetBuffer(args[i], view, PyBUF_ND | PyBUF_FORMAT) < 0) {
            PyErr_Clear();
            ok = 0;
            break;
        }
        all.open++, x[i] = view->buf, stacked = first->ndim == 2;
        ok = view->format && !strcmp(view->format, "d") && view->ndim == 1 + stacked
             && view->shape[stacked] == all.sizes[i] && (!stacked || view->shape[0] == first->shape[0]);
    }
    if (ok > 0) {
        all.sizes[given] = size, all.count = stacked ? first->shape[0] : 1, made = all.views + all.open;
        array =
            stacked ? PyObject_CallFunction(empty, "((nn))", all.count, size) : PyObject_CallFunction(empty, "n", size);
        if (!array || PyObject_GetBuffer(array, made, PyBUF_WRITABLE) < 0) ok = -1;
        else all.open++, x[given] = made->buf;
        if (ok > 0 && made->len != all.count * size * (Py_ssize_t)sizeof(double))
            ok = -1, PyErr_SetString(PyExc_ValueError, "kernel: a result has another size");
        for (int i = 0; i < given && ok > 0; i++) ok = !x[i] || Py_TYPE(args[i]) == Py_TYPE(array); /* not masked */
    }
    for (Py_ssize_t i = 0; i < all.count && ok > 0; i++, advance(&all, x, given + 1)) ok = one(ev, x);
    close_arrays(&all);
    if (ok > 0) return array;
    Py_XDECREF(array);
    if (ok < 0) return NULL;
    Py_RETURN_NONE;
}
#define FUSED(name, signature, size, one)                                                                              \
    static PyObject *name(Evaluator *ev, PyObject *const *args, Py_ssize_t given)                                      \
    { return fused(ev, args, given, signature, size, one); }

/* q, v2, T, mu and its rates or None -> v2_dot */
static int forward_at(Evaluator *ev, double *const *x)
{
    const double *q = x[0], *v2 = x[1], *T = x[2];
    double *P = ev->scratch + ev->work, *F = P + kinematics_size(ev), *v = F + 2 * ev->n * ev->n, *S = v + ev->n;
    double *force = S + dynamics_size(ev);
    int ok = ev->r && use_rates(ev, x[3]) ? locate_state(ev, q, v2, T, P, F) : 0;
    if (ok <= 0) return ok;
    input_force(ev, q, P, T, force, ev->scratch);
    velocity(ev, F, ev->mu, v2, v);
    if (!add_passive(ev, q, P, v, force, NULL)) return 0;
    if (!biases(ev, q, P, F, v, NULL, S)) return -1;
    return accelerate(ev, F, S, force, x[4], ev->scratch);
}
FUSED(forward_dynamics, "qrTu?", ev->r, forward_at)

/* q, v2, v2_dot, mu and its rates or None -> reduced forces R^T (M (R v2_dot - E^-1 gamma) + bias) */
static int inverse_at(Evaluator *ev, double *const *x)
{
    Py_ssize_t n = ev->n, r = ev->r;
    const double *q = x[0], *v2 = x[1], *v2_dot = x[2];
    double *P = ev->scratch + ev->work, *F = P + kinematics_size(ev), *v = F + 2 * n * n, *S = v + n;
    double *passive = S + dynamics_size(ev), *acceleration = ev->scratch, *F_reduced = x[4];
    int ok = r && all_finite(v2_dot, r) && use_rates(ev, x[3]) ? locate_state(ev, q, v2, NULL, P, F) : 0;
    if (ok <= 0) return ok;
    velocity(ev, F, ev->mu, v2, v);
    memset(passive, 0, (size_t)n * sizeof(double));
    if (!add_passive(ev, q, P, v, passive, NULL)) return 0;
    if (!biases(ev, q, P, F, v, NULL, S)) return -1;
    const double *R = F + n * n + ev->m, *solved = S + 2 * n;
    memset(F_reduced, 0, (size_t)r * sizeof(double));
    for (Py_ssize_t j = 0; j < n; j++) acceleration[j] = dot(R + j * n, v2_dot, r) - solved[j];
    for (Py_ssize_t j = 0; j < n; j++) {
        double force = dot(P + j * n, acceleration, n) + (S[j] - passive[j]);
        add(F_reduced, force, R + j * n, r);
    }
    return all_finite(F_reduced, r);
}
FUSED(inverse_dynamics, "qrru?", ev->r, inverse_at)

/* -mu^T lambda: power of moving constraints, with lambda from force = bias + M vdot + A^T lambda. work: 2 n */
static double constraint_power(const Evaluator *ev, const double *P, const double *F, const double *S,
                               const double *force, const double *v2_dot, double *work)
{
    Py_ssize_t n = ev->n, m = ev->m;
    const double *solved = S + 2 * n;
    double *acceleration = work, *push = work + n, power = 0.0;
    memset(push, 0, (size_t)n * sizeof(double));
    for (Py_ssize_t i = 0; i < n; i++) acceleration[i] = dot(F + n * n + i * n + m, v2_dot, ev->r) - solved[i];
    for (Py_ssize_t i = 0; i < n; i++) {
        double rest = force[i] - S[i] - dot(P + i * n, acceleration, n);
        add(push, rest, F + n * n + i * n, m);
    }
    for (Py_ssize_t i = 0; i < m; i++) power -= ev->mu[i] * push[i];
    return power;
}

/* State derivative where position, E and its inverse are in scratch: v (n), v2_dot (r), J1 v (k), 1 for the time, and
   the power of forces and moving constraints. Forces are those of T, further ones (n) and damping (n), unless NULL.
   biased: the biases of this state are in scratch too. 0: the general way has to decide; -1: an error */
static int rates_here(Evaluator *ev, const double *q, const double *v2, const double *T, const double *further,
                      const double *damping, int biased, double *out)
{
    Py_ssize_t n = ev->n, r = ev->r, k = ev->k;
    double *P = ev->scratch + ev->work, *F = P + kinematics_size(ev), *S = F + 2 * n * n + n;
    double *force = S + dynamics_size(ev), *v = out, *v2_dot = v + n, *rates_of_J1 = v2_dot + r, *row = ev->scratch;
    input_force(ev, q, P, T, force, ev->scratch);
    velocity(ev, F, ev->mu, v2, v);
    if (further) add(force, 1.0, further, n);
    for (Py_ssize_t j = 0; j < n && damping; j++) force[j] -= damping[j] * v[j];
    double *springs = ev->force_row + n;
    memset(springs, 0, (size_t)n * sizeof(double));
    if (!add_passive(ev, q, P, v, force, springs)) return 0;
    double stored = dot(springs, v, n);
    if (!biased && !biases(ev, q, P, F, v, NULL, S)) return -1;
    if (!accelerate(ev, F, S, force, v2_dot, ev->scratch)) return 0;
    for (Py_ssize_t j = 0; j < k; j++) {
        if (!assemble(ev, q, P, NULL, n + j, n + j + 1, row)) return 0;
        rates_of_J1[j] = dot(row, v, n);
    }
    double *power = rates_of_J1 + k;
    if (ev->timed) *power++ = 1.0;
    *power = dot(v, force, n) - stored;
    if (ev->mu) *power += constraint_power(ev, P, F, S, force, v2_dot, ev->scratch);
    return 1;
}

/* The same at a state with the kinematics that are known, or NULL */
static int derivative(Evaluator *ev, const double *q, const double *v2, const double *T, const double *further,
                      const double *damping, const double *known, double *out)
{
    double *P = ev->scratch + ev->work;
    if (known) memcpy(P, known, (size_t)kinematics_size(ev) * sizeof(double));
    else if (!take_position(ev, q, P)) return -1;
    return factorize(ev, q, P, NULL, P + kinematics_size(ev)) ? rates_here(ev, q, v2, T, further, damping, 0, out) : 0;
}

/* q, v2, T, kinematics at q or None, mu and its rates or None, record of the state derivative, v2 before a time (1),
   this time, rows (k, n), lower and upper bounds (k). True if v is farther from the bounds than the change since then
   and its error to second order, in the motions of q. */
static PyObject *far_within(Evaluator *ev, PyObject *const *args, Py_ssize_t given)
{
    Arrays all = {.count = 1}, bounds = {.count = -1};
    double *x[8], *row, *lower, *upper, *v = ev->scratch, *ahead = v + ev->n;
    int ok = expect(ev, given, 11) && take_all(ev, &all, args, "qrTP?u?d!rt", x)
                     && take(&bounds, args[8], ev->n, READ, &row) && take(&bounds, args[9], 1, READ, &lower)
                     && take(&bounds, args[10], 1, READ, &upper)
                 ? ev->fused && !ev->external_vertical && use_rates(ev, x[4])
                 : -1;
    if (ok > 0) ok = derivative(ev, x[0], x[1], x[2], NULL, NULL, x[3], x[5]);
    const double *F = ev->scratch + ev->work + kinematics_size(ev), *R = F + ev->n * ev->n + ev->m;
    if (ok > 0) velocity(ev, F, ev->mu, x[6], v);
    for (Py_ssize_t i = 0; i < ev->n && ok > 0; i++) ahead[i] = dot(R + i * ev->n, x[5] + ev->n, ev->r);
    for (Py_ssize_t i = 0; i < bounds.count && ok > 0; i++, row += ev->n) {
        double before = dot(row, v, ev->n), reached = dot(row, x[5], ev->n), change = reached - before;
        double away = fabs(change) + fabs(*x[7] * dot(row, ahead, ev->n) - change);
        ok = reached + away <= upper[i] && reached - away >= lower[i];
    }
    close_arrays(&bounds);
    return result(&all, ok);
}

/* ------------------------------------------------------------------ integration */

/* |B_2k| / (2k)!, k = 1 to 14, of the series of the inverse Jacobian of an exponential */
static const double BERNOULLI[14] = {
    0.08333333333333333,   0.001388888888888889,   3.306878306878307e-05,  8.267195767195768e-07, 2.08767569878681e-08,
    5.284190138687493e-10, 1.3382536530684679e-11, 3.3896802963225827e-13, 8.586062056277845e-15, 2.174868698558062e-16,
    5.50900282836023e-18,  1.3954464685812525e-19, 3.534707039629467e-21,  8.953517427037546e-23};

enum { PLANAR, SPHERICAL, FREE }; /* joints with curved coordinates */

/* [u, x] in the Lie algebra of a joint */
static void bracket(long kind, const double *u, const double *x, double *out)
{
    double coupled[3];
    if (kind == PLANAR) {
        out[0] = u[1] * x[2] - u[2] * x[1], out[1] = u[2] * x[0] - u[0] * x[2], out[2] = 0.0;
        return;
    }
    if (kind == SPHERICAL) {
        cross(u, x, out);
        return;
    }
    cross(u + 3, x, out);
    cross(u, x + 3, coupled);
    for (int i = 0; i < 3; i++) out[i] += coupled[i];
    cross(u + 3, x + 3, out + 3);
}

/* v -> rate of u where q = q0 (+) u; see integrators.py */
static void coordinate_rates(const Evaluator *ev, const double *u, double *v)
{
    for (Py_ssize_t j = 0; j < ev->curves; j++) {
        long kind = ev->curved[2 * j], at = ev->curved[2 * j + 1];
        int size = kind == FREE ? 6 : 3;
        const double *turn = u + at + (kind == PLANAR ? 2 : kind == FREE ? 3 : 0);
        double square = dot(turn, turn, kind == PLANAR ? 1 : 3), a = 0.0, b = 0.0, power[4][6];
        if (square < 1.0)
            for (int k = 14; k > 0; k--) {
                a = a * square + (2 - k) * BERNOULLI[k - 1];
                if (k > 1) b = b * square + (1 - k) * BERNOULLI[k - 1];
            }
        else {
            double half = 0.5 * sqrt(square), alpha = half / tan(half), beta = half * half / (sin(half) * sin(half));
            a = (2 * (1 - alpha) + 0.5 * (alpha - beta)) / square;
            b = (1 - alpha + 0.5 * (alpha - beta)) / (square * square);
        }
        bracket(kind, u + at, v + at, power[0]);
        for (int i = 1; i < 4; i++) bracket(kind, u + at, power[i - 1], power[i]);
        for (int i = 0; i < size; i++) v[at + i] += 0.5 * power[0][i] + a * power[1][i] + b * power[3][i];
    }
}

/* Numbers (n) that a Python function returns for arguments; false with an error */
static int copy_result(PyObject *function, PyObject *const *args, int count, Py_ssize_t n, double *out)
{
    Py_buffer view;
    PyObject *found = PyObject_CallFunctionObjArgs(function, args[0], args[1], count > 2 ? args[2] : NULL, NULL);
    if (!found || PyObject_GetBuffer(found, &view, PyBUF_SIMPLE) < 0) {
        Py_XDECREF(found);
        return 0;
    }
    int ok = view.len == n * (Py_ssize_t)sizeof(double);
    if (ok) memcpy(out, view.buf, (size_t)view.len);
    else PyErr_SetString(PyExc_ValueError, "kernel: a result of Pinocchio has another size");
    PyBuffer_Release(&view);
    Py_DECREF(found);
    return ok;
}

/* out = q (+) u; false with an error */
static int displace(Evaluator *ev, const double *q, const double *u, double *out)
{
    PyObject *of[REFS];
    if (ev->nq == ev->n) { /* all joints are real numbers */
        for (Py_ssize_t i = 0; i < ev->n; i++) out[i] = q[i] + u[i];
        return 1;
    }
    take_state(ev, q, u);
    for (int i = 0; i < REFS; i++) of[i] = PyTuple_GetItem(ev->refs, i);
    PyObject *args[] = {of[P_MODEL], of[P_Q], of[P_V]};
    return copy_result(of[P_INTEGRATE], args, 3, ev->nq, out);
}

static Py_ssize_t stages_size(const Evaluator *ev) { return 5 * (ev->n + integrated(ev)) + ev->nq; }

/* One step of the method of integrators.py: q and y after a time h. known: kinematics at q, or NULL. rates: mu and
   its rates at the begin, the middle and the end of the step, or NULL. rough: grows by the roughness of the step.
   trace: rates of q and y at the begin (n + s), and the displacement (n) from there, or NULL. */
static int step(Evaluator *ev, const double *T, double h, const double *known, const double *rates, double *q,
                double *y, double *rough, double *trace)
{
    static const int half_steps[4] = {0, 1, 1, 2};
    static const double fraction[4] = {0.0, 0.5, 0.5, 1.0}, weight[4] = {1.0, 2.0, 2.0, 1.0};
    static const double middle[4] = {0.0, -1.0, 1.0, 0.0}, ends[4] = {1.0, -1.0, -1.0, 1.0};
    Py_ssize_t n = ev->n, s = integrated(ev);
    double *rate = ev->stages, *sum = rate + n + s, *u = sum + n + s, *y_at = u + n, *q_at = y_at + s;
    double *uneven = q_at + ev->nq, *bent = uneven + n + s, largest = 0.0;
    memcpy(q_at, q, (size_t)ev->nq * sizeof(double));
    memset(sum, 0, (size_t)(n + s) * sizeof(double));
    memset(uneven, 0, (size_t)(2 * (n + s)) * sizeof(double));
    memset(rate, 0, (size_t)(n + s) * sizeof(double));
    for (int stage = 0; stage < 4; stage++) {
        for (Py_ssize_t i = 0; i < n; i++) u[i] = fraction[stage] * h * rate[i];
        for (Py_ssize_t i = 0; i < s; i++) y_at[i] = y[i] + fraction[stage] * h * rate[n + i];
        if (!(dot(u, u, n) < FARTHEST)) return 0;
        if (stage && !displace(ev, q, u, q_at)) return -1;
        if (!use_rates(ev, rates ? rates + half_steps[stage] * 2 * ev->m : NULL)) return 0;
        int ok = derivative(ev, q_at, y_at, T, NULL, NULL, stage ? NULL : known, rate);
        if (ok <= 0) return ok;
        if (trace && !stage) memcpy(trace, rate, (size_t)(n + s) * sizeof(double));
        coordinate_rates(ev, u, rate);
        add(sum, weight[stage], rate, n + s);
        add(uneven, middle[stage], rate, n + ev->r);
        add(bent, ends[stage], rate, n + ev->r);
    }
    for (Py_ssize_t i = 0; i < n + ev->r; i++) largest = fmax(largest, fmax(fabs(uneven[i]), fabs(bent[i])));
    *rough += h * largest;
    for (Py_ssize_t i = 0; i < n; i++) u[i] = h / 6 * sum[i];
    if (trace) memcpy(trace + n + s, u, (size_t)n * sizeof(double));
    if (!displace(ev, q, u, q_at)) return -1;
    memcpy(q, q_at, (size_t)ev->nq * sizeof(double));
    add(y, h / 6, sum + n, s);
    return 1;
}

/* Record of a state, T and the duration of a step; record of the state after it: q, y, and the trace of the step */
static int trace_at(Evaluator *ev, double *const *x)
{
    double *q = x[3], *y = q + ev->nq, rough = 0.0;
    if (!ev->fused || ev->external_vertical || ev->timed || !all_finite(x[1], ev->p)) return 0;
    memcpy(q, x[0], (size_t)(ev->nq + integrated(ev)) * sizeof(double));
    return step(ev, x[1], *x[2], NULL, NULL, q, y, &rough, y + integrated(ev));
}
METHOD(trace, "iT1i!", trace_at)

/* q, u or None, v2, T, further forces (n), damping (n), mu and its rates or None; record of the state derivative at
   q (+) u, in the coordinates u if they are given. False if the general way has to decide. */
static int state_derivative_at(Evaluator *ev, double *const *x)
{
    const double *q = x[0], *u = x[1];
    if (!ev->fused || ev->external_vertical || !use_rates(ev, x[6])) return 0;
    if (!u) return derivative(ev, q, x[2], x[3], x[4], x[5], NULL, x[7]);
    if (!ev->curved || !(dot(u, u, ev->n) < FARTHEST)) return 0;
    if (!displace(ev, q, u, ev->stages)) return -1;
    int ok = derivative(ev, ev->stages, x[2], x[3], x[4], x[5], NULL, x[7]);
    if (ok > 0) coordinate_rates(ev, u, x[7]);
    return ok;
}
METHOD(state_derivative, "qv?rTv?v?u?d!", state_derivative_at)

/* Velocity b of v = R v2 + b, and its rate; their forces are added to G. The frames move. work: 2 n */
static void add_offset(Evaluator *ev, const double *P, const double *F, const double *D, double *K, double *b,
                       double *b_dot, double *work)
{
    Py_ssize_t n = ev->n, m = ev->m, r = ev->r;
    const double *inverse = F + n * n, *R = inverse + m;
    double *rest = work, *force = work + n, *G = K + n * n + r * r + n;
    for (Py_ssize_t i = 0; i < n; i++) b[i] = dot(inverse + i * n, ev->mu, m);
    for (Py_ssize_t i = 0; i < n; i++) {
        const Row *row = ev->rows + i;
        rest[i] = (i < m ? ev->mu_dot[i] : 0.0) - dot(D + i * n, b, n);
        if (on_moving_ground(row)) {
            Wrench on[2];
            wrenches(ev, row, 1, on);
            rest[i] += slide_rate(row, on);
        }
    }
    for (Py_ssize_t i = 0; i < n; i++) b_dot[i] = dot(inverse + i * n, rest, n);
    for (Py_ssize_t i = 0; i < n; i++) force[i] = dot(P + i * n, b_dot, n) + dot(K + i * n, b, n);
    for (Py_ssize_t i = 0; i < n; i++) add(G, force[i], R + i * n, r);
}

/* q, v2 -> record of all matrices of a state: kinematics, F, v, D, K, bias, H, B, R^T B, b, its rate */
static int terms_at(Evaluator *ev, double *const *x)
{
    Py_ssize_t n = ev->n, r = ev->r;
    const double *q = x[0], *v2 = x[1];
    double *P = x[2], *F = P + kinematics_size(ev), *v = F + 2 * n * n, *D = v + n;
    double *K = D + rates_size(ev), *bias = K + n * n + r * r + n + r, *H = bias + n, *B = H + r * r;
    double *input = B + n * ev->p, *b = input + r * ev->p;
    int ok = ev->external_vertical || ev->timed ? 0 : locate_state(ev, q, v2, NULL, P, F);
    if (ok <= 0) return ok;
    velocity(ev, F, ev->mu, v2, v);
    take_state(ev, q, v);
    if (!called(ev, P_NLE, 1) || !called(ev, P_C, 1)) return -1;
    memset(bias, 0, (size_t)n * sizeof(double));
    if (!add_passive(ev, q, P, v, bias, NULL)) return 0;
    subtract(ev->views[V_NLE].buf, bias, bias, n);
    if (!rates(ev, q, P, F, v, NULL, NULL, NULL, D, ev->scratch)) return 0;
    coriolis(ev, P, F, v, bias, D, K, ev->scratch);
    if (ev->mu) add_offset(ev, P, F, D, K, b, b + n, ev->scratch);
    else memset(b, 0, (size_t)(2 * n) * sizeof(double));
    inertia(ev, P, F, H, ev->scratch);
    input_matrix(ev, q, P, B, ev->scratch);
    multiply_transposed(F + n * n + ev->m, n, B, ev->p, input, r, n, ev->p);
    return 1;
}
FUSED(terms, "qr", terms_size(ev), terms_at)

static Py_ssize_t sample_size(const Evaluator *ev)
{
    Py_ssize_t n = ev->n, r = ev->r, ends = 2 * (kinematics_size(ev) + 2 * n * n + ev->nq);
    return ends + dynamics_size(ev) + n + r + (n + r) * ev->p + r + ev->p * ev->p;
}

/* q, v2, duration -> record of a state and of the configuration after this time at its velocity: kinematics and F of
   both, both q, S, v, v2, B, accelerations of unit inputs (r, p) and of none, and the inverse of the former if p = r */
static int sample_at(Evaluator *ev, double *const *x)
{
    Py_ssize_t n = ev->n, size = kinematics_size(ev), inverses = 2 * n * n;
    double *P = x[3], *F = P + size, *at_end = F + inverses, *q = at_end + size + inverses, *q_end = q + ev->nq;
    double *S = q_end + ev->nq, *v = S + dynamics_size(ev), *v2 = v + n, *B = v2 + ev->r, *effects = B + n * ev->p;
    double *adverse = effects + ev->r * ev->p, *inputs = adverse + ev->r;
    int ok = ev->timed || ev->forced ? 0 : locate_state(ev, x[0], x[1], NULL, P, F);
    if (ok <= 0) return ok;
    memcpy(q, x[0], (size_t)ev->nq * sizeof(double));
    memcpy(v2, x[1], (size_t)ev->r * sizeof(double));
    velocity(ev, F, ev->mu, v2, v);
    if (!biases(ev, q, P, F, v, NULL, S)) return -1;
    input_matrix(ev, q, P, B, ev->scratch);
    if (!input_accelerations_at(ev, (double *[]){F, S, B, effects, adverse})) return 0;
    Py_ssize_t all = ev->p == ev->r ? ev->r * ev->r : 0; /* singular values of 1e-12 of the largest have no effect */
    int inverted = all && invert(effects, inputs, ev->scratch, ev->r);
    if (all && !(inverted && dot(inputs, inputs, all) * dot(effects, effects, all) < 1e24)) *inputs = INFINITY;
    for (Py_ssize_t i = 0; i < n; i++) ev->force_row[i] = *x[2] * v[i];
    if (!displace(ev, q, ev->force_row, q_end) || !take_position(ev, q_end, at_end)) return -1;
    return factorize(ev, q_end, at_end, NULL, at_end + size);
}
FUSED(sample, "qrt", sample_size(ev), sample_at)

/* ------------------------------------------------------------------ arguments of functions */

/* Arrays of a function, by the kinds of its arguments: "d" float64, "w" float64 that is written, "i" 64-bit integers,
   "f" one number. sizes: numbers in each array. False for other arrays, which NumPy has to convert or refuse; -1: an
   error */
static int arrays_of(Arrays *all, PyObject *const *args, const char *kinds, const Py_ssize_t *sizes, double **x)
{
    for (int i = 0; kinds[i]; i++) {
        Py_buffer *view = all->views + all->open;
        x[i] = NULL;
        if (kinds[i] == 'f') {
            all->numbers[i] = PyFloat_AsDouble(args[i]), x[i] = all->numbers + i;
            if (PyErr_Occurred()) return -1;
            continue;
        }
        if (PyObject_GetBuffer(args[i], view, PyBUF_ND | PyBUF_FORMAT) < 0) return PyErr_Clear(), 0;
        all->open++, x[i] = view->buf;
        const char *format = view->format ? view->format : "";
        int fits = kinds[i] == 'i' ? !strcmp(format, "l") || !strcmp(format, "q") : !strcmp(format, "d");
        if (!fits || view->len != 8 * sizes[i] || (kinds[i] == 'w' && view->readonly)) return 0;
    }
    return 1;
}

/* Sizes of one row of numbers, or of a stack of rows; false for other arrays. */
static int stacked(PyObject *object, Py_ssize_t *count, Py_ssize_t *size)
{
    Py_buffer view;
    if (PyObject_GetBuffer(object, &view, PyBUF_ND) < 0) return PyErr_Clear(), 0;
    int ok = view.ndim == 1 || view.ndim == 2;
    *count = view.ndim == 2 ? view.shape[0] : 1, *size = ok ? view.shape[view.ndim - 1] : 0;
    PyBuffer_Release(&view);
    return ok && *count < 1 << 20 && *size < 1 << 15;
}

static int all_within(const long *index, Py_ssize_t count, Py_ssize_t size)
{
    for (Py_ssize_t i = 0; i < count; i++)
        if (!within(index[i], size)) return 0;
    return 1;
}

/* A function of the module: ``name_by`` gets its arguments; False if NumPy has to decide, -1 for an error. */
#define FUNCTION(name, takes)                                                                                          \
    static PyObject *name(PyObject *module, PyObject *const *args, Py_ssize_t given)                                   \
    {                                                                                                                  \
        Arrays all = {.count = 1};                                                                                     \
        (void)module;                                                                                                  \
        return expect(NULL, given, takes) ? result(&all, name##_by(&all, args)) : NULL;                                \
    }

#include "derivatives.h"
#include "dissipation.h"
#include "batches.h"
#include "riccati.h"
#include "planned_motion.h"
#include "pairs.h"
#include "least_squares.h"

/* ------------------------------------------------------------------ creation */

/* Memory that is released with the evaluator: a copy of a table, or zeros for NULL; NULL with an error */
static void *owned(Evaluator *ev, PyObject *table, Py_ssize_t count, size_t item)
{
    Py_buffer view;
    void *out = calloc((size_t)count * item + 1, 1);
    if (!out) return PyErr_NoMemory();
    ev->memory[ev->owns++] = out;
    if (!table) return out;
    if (PyObject_GetBuffer(table, &view, PyBUF_SIMPLE) < 0) return NULL;
    if (view.len == count * (Py_ssize_t)item) memcpy(out, view.buf, (size_t)view.len);
    else {
        PyErr_Format(PyExc_ValueError, "kernel: table of %zd bytes, expected %zd entries of %zd bytes", view.len, count,
                     (Py_ssize_t)item);
        out = NULL;
    }
    PyBuffer_Release(&view);
    return out;
}

/* Every index of a row refers to something that exists. */
static int valid(const Evaluator *ev, const Row *row, Py_ssize_t external, int output)
{
    const long *i = row->i;
    if (output && (i[4] == JOINT || i[4] == CONTINUOUS_JOINT) && !within(i[3], ev->nq - (i[4] != JOINT))) return 0;
    if (output && i[4] == COORDINATE && (row->kind != WORLD || !within(i[3], 3))) return 0;
    if (output && (i[4] == HEADING || i[4] == ELEVATION) && row->kind != YAW && row->kind != TILT) return 0;
    if (output && i[4] == LENGTH && row->kind != DISTANCE) return 0;
    switch (row->kind) {
    case CONSTANT: return 1;
    case EXTERNAL: return within(i[0], external);
    case MOMENTUM: {
        int bits = 0;
        for (int c = 0; c < 6; c++) bits += i[2] >> c & 1;
        return within(row->a, ev->joints) && i[3] >= 1 && i[3] <= 6 && within(i[0], ev->n) && i[0] + i[3] <= ev->n
               && within(i[1], i[3]) && i[2] >= 0 && i[2] < 64 && (!i[2] || bits == i[3]);
    }
    case ACKERMANN:
        return within(i[0], ev->nq - (i[4] & 1)) && within(i[2], ev->nq - (i[4] >> 1 & 1)) && within(i[1], ev->n)
               && within(i[3], ev->n);
    }
    if (row->kind < WORLD || row->kind > CURVED || !within(row->a, ev->frames)) return 0;
    if (i[1] && (!ev->mu || row->b >= 0)) return 0; /* the material of ground on a frame does not move */
    if ((row->kind == YAW || row->kind == TILT) && !within(i[0], 3)) return 0;
    return within(row->b, ev->frames) || (row->b < 0 && row->kind != DISTANCE);
}

static int checked(Evaluator *ev)
{
    Py_ssize_t last = ev->start[ev->joints], forces = ev->count - ev->forced;
    for (Py_ssize_t j = 0; j < ev->joints; j++)
        if (ev->start[j] < 0 || ev->start[j] > ev->start[j + 1] || ev->start[j + 1] > last) return 0;
    for (Py_ssize_t s = 0; s < last; s++)
        if (!within(ev->support[s], ev->n)) return 0;
    for (Py_ssize_t f = 0; f < ev->frames; f++)
        if (!within(ev->frame[f].joint, ev->joints)) return 0;
    for (Py_ssize_t i = 0; i < ev->count; i++) {
        Py_ssize_t external = i < ev->n ? ev->external : i < ev->n + ev->k ? ev->external_vertical : 0;
        if (!valid(ev, ev->rows + i, external, i >= ev->m && (i < ev->n + ev->k || i >= forces))) return 0;
        if (i >= ev->n + ev->k && i < forces
            && (ev->rows[i].kind != OWN || !within(ev->columns[i - ev->n - ev->k], ev->p)))
            return 0;
        if (i >= forces && ev->rows[i].kind != CONSTANT && !sides_of(ev->rows + i)) return 0;
        if (ev->rows[i].kind == MOMENTUM) ev->rates_need_C = 1;
        if (on_moving_ground(ev->rows + i) && i >= ev->m) return 0;
        if (on_moving_ground(ev->rows + i)) ev->slides = 1;
    }
    return 1;
}

/* A joint comes before those that it carries, so the first joint that an entry of v moves is its own. */
static void find_owners(Evaluator *ev)
{
    for (Py_ssize_t j = ev->joints - 1; j >= 0; j--)
        for (long s = ev->start[j]; s < ev->start[j + 1]; s++) ev->owner[ev->support[s]] = (long)j;
}

/* Table of joints with curved coordinates; None if the coordinates of a joint have no formula here. */
static int bent(Evaluator *ev, PyObject *table)
{
    Py_ssize_t count = table == Py_None ? 0 : PyObject_Size(table);
    if (table == Py_None) return 1;
    if (count < 0 || !(ev->curved = owned(ev, table, count, 2 * sizeof(long)))) return 0;
    ev->curves = count;
    for (Py_ssize_t j = 0; j < ev->curves; j++) {
        long kind = ev->curved[2 * j], at = ev->curved[2 * j + 1];
        if (!within(kind, FREE + 1) || at < 0 || at + (kind == FREE ? 6 : 3) > ev->n) {
            PyErr_SetString(PyExc_ValueError, "kernel: coordinates of a joint are out of range");
            return 0;
        }
    }
    return 1;
}

static int opened(Evaluator *ev, PyObject *arrays) /* views of Pinocchio's memory, and of q and v */
{
    Py_ssize_t n = ev->n, square[2] = {n, n}, motions[2] = {6, n};
    Py_ssize_t *shapes[VIEWS] = {square, motions, &n, square, NULL, &ev->nq, &n, &n, square, square};
    for (int i = 0; i < VIEWS; i++) {
        Py_buffer *view = ev->views + i;
        PyObject *array = PyTuple_GetItem(arrays, i);
        if (!array || PyObject_GetBuffer(array, view, PyBUF_F_CONTIGUOUS | PyBUF_WRITABLE | PyBUF_FORMAT) < 0) return 0;
        ev->open++;
        Py_ssize_t places[2] = {12, ev->joints}, *shape = i == V_PLACES ? places : shapes[i];
        int two = shape == square || shape == motions || shape == places;
        if (strcmp(view->format, "d") || view->ndim != 1 + two || view->shape[0] != shape[0]
            || (two && view->shape[1] != shape[1])) {
            PyErr_Format(PyExc_ValueError, "kernel: view %d of Pinocchio's data has another layout", i);
            return 0;
        }
    }
    return 1;
}

/* The tables of Evaluator(...): sizes, references, views, then arrays of bytes, which reduction_kernel.py makes. */
static int initialize(PyObject *self, PyObject *args, PyObject *keywords)
{
    Evaluator *ev = (Evaluator *)self;
    PyObject *refs, *views, *rows, *columns, *frames, *start, *support, *constant, *B, *mu, *lengths, *curved, *forces;
    Py_ssize_t supported;
    if (ev->refs || keywords) {
        PyErr_SetString(PyExc_TypeError, "kernel: an Evaluator is made once, from positional arguments");
        return -1;
    }
    if (!PyArg_ParseTuple(args, "(nnnnnnnnnnnpppn)O!O!OOOOOOOOOOOdd", &ev->nq, &ev->n, &ev->m, &ev->k, &ev->p,
                          &ev->joints, &ev->frames, &ev->external, &ev->external_vertical, &ev->count, &supported,
                          &ev->normalized, &ev->fused, &ev->timed, &ev->forced, &PyTuple_Type, &refs, &PyTuple_Type,
                          &views, &rows, &columns, &frames, &start, &support, &constant, &B, &mu, &lengths, &curved,
                          &forces, &ev->fast_length, &ev->fast_limit))
        return -1;
    Py_ssize_t n = ev->n,
               sizes[] = {ev->nq, n, ev->m, ev->k, ev->p, ev->joints, ev->frames, ev->count, supported, ev->forced};
    for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++)
        if (!within((long)sizes[i], 1 << 15))
            return PyErr_SetString(PyExc_ValueError, "kernel: size out of range"), -1; /* products do not overflow */
    if (n < 1 || ev->m > n || ev->joints < 1 || ev->count < n + ev->k + ev->forced || PyTuple_Size(refs) != REFS
        || PyTuple_Size(views) != VIEWS)
        return PyErr_SetString(PyExc_ValueError, "kernel: sizes do not fit together"), -1;
    ev->r = n - ev->m;
    Py_INCREF(refs);
    ev->refs = refs;
    Py_ssize_t wide = n > ev->k ? n : ev->k, work = ev->work = 2 * n * n + 6 * n + wide * n;
    Py_ssize_t states = kinematics_size(ev) + 2 * n * n + n + dynamics_size(ev) + n;
    if (!opened(ev, views) || !(ev->rows = owned(ev, rows, ev->count, sizeof(Row)))
        || !(ev->columns = owned(ev, columns, ev->count - n - ev->k - ev->forced, sizeof(long)))
        || !(ev->frame = owned(ev, frames, ev->frames, sizeof(Frame)))
        || !(ev->start = owned(ev, start, ev->joints + 1, sizeof(long)))
        || !(ev->support = owned(ev, support, supported, sizeof(long)))
        || !(ev->constant = owned(ev, constant, ev->count * n, sizeof(double)))
        || !(ev->B = owned(ev, B, n * ev->p, sizeof(double)))
        || (mu != Py_None && (!(ev->mu = owned(ev, mu, 2 * ev->m, sizeof(double))) || !(ev->mu_dot = ev->mu + ev->m)))
        || !(ev->lengths = owned(ev, lengths, n, sizeof(double)))
        || !(ev->laws = owned(ev, forces, ev->forced * FORCE_NUMBERS, sizeof(double))) || !bent(ev, curved)
        || !(ev->owner = owned(ev, NULL, n, sizeof(long)))
        || !(ev->motion = owned(ev, NULL, ev->frames, sizeof(Motion)))
        || !(ev->scratch = owned(ev, NULL, work + states + stages_size(ev) + 2 * n, sizeof(double))))
        return -1;
    ev->stages = ev->scratch + work + states;
    ev->force_row = ev->stages + stages_size(ev);
    ev->ready = checked(ev) && ev->start[0] == 0 && ev->start[ev->joints] == supported;
    if (ev->ready) find_owners(ev);
    else PyErr_SetString(PyExc_ValueError, "kernel: a row refers to something that does not exist");
    return ev->ready ? 0 : -1;
}

static void destroy(PyObject *self)
{
    Evaluator *ev = (Evaluator *)self;
    PyTypeObject *type = Py_TYPE(self);
    while (ev->open) PyBuffer_Release(ev->views + --ev->open);
    while (ev->owns) free(ev->memory[--ev->owns]);
    free(ev->derivatives);
    Py_CLEAR(ev->refs);
    PyObject_Free(self);
    Py_DECREF(type);
}

#define METHOD(name, function) {#name, (PyCFunction)(void (*)(void))function, METH_FASTCALL, NULL}
/* clang-format off */
static PyMethodDef methods[] = {
    METHOD(configure, configure), METHOD(velocity, full_velocity), METHOD(inertia, reduced_inertia),
    METHOD(biases, bias_forces), METHOD(accelerate, acceleration), METHOD(actuation, actuation),
    METHOD(input_accelerations, input_accelerations), METHOD(outputs, outputs),
    METHOD(allocate, allocation), METHOD(set_numbers, set_numbers), METHOD(vertical, vertical_rows),
    METHOD(passive_forces, passive_forces), METHOD(values, output_values), METHOD(rates, row_rates),
    METHOD(inverse_dynamics, inverse_dynamics), METHOD(forward_dynamics, forward_dynamics),
    METHOD(state_derivative, state_derivative), 
    METHOD(planned_steps, planned_steps), METHOD(planned_derivatives, planned_derivatives),
    METHOD(integrate, integrate), METHOD(state_derivatives, state_derivatives),
    METHOD(vertical_velocities, vertical_velocities), METHOD(row_velocities, row_velocities),
    METHOD(admissible_velocities, admissible_velocities), METHOD(measure, measure), METHOD(terms, terms),
    METHOD(sample, sample), METHOD(far_within, far_within),
    METHOD(trace, trace),
    {NULL, NULL, 0, NULL},
};

static PyMethodDef functions[] = {
    METHOD(riccati_factors, riccati_factors), METHOD(riccati_solve, riccati_solve), METHOD(variances, variances),
    METHOD(interior_point, interior_point), METHOD(cascade, cascade), METHOD(solve, solve),
    METHOD(shape_poses, shape_poses), METHOD(frame_kinematics, frame_kinematics), METHOD(pair_rows, pair_rows),
    METHOD(pair_bounds, pair_bounds), METHOD(stopping, stopping), METHOD(program, program),
    {NULL, NULL, 0, NULL},
};

static PyType_Slot slots[] = {
    {Py_tp_init, initialize}, {Py_tp_new, PyType_GenericNew}, {Py_tp_dealloc, destroy}, {Py_tp_methods, methods},
    {0, NULL},
};

static PyType_Spec spec = {
    .name = "rnc_pin._kernel.compiled.Evaluator", .basicsize = sizeof(Evaluator), .flags = Py_TPFLAGS_DEFAULT,
    .slots = slots,
};
/* clang-format on */

static struct PyModuleDef module = {
    PyModuleDef_HEAD_INIT,
    .m_name = "compiled",
    .m_size = -1,
    .m_methods = functions,
};

PyMODINIT_FUNC PyInit_compiled(void)
{
    PyObject *made = PyModule_Create(&module), *type = made ? PyType_FromSpec(&spec) : NULL;
    if (!type || PyModule_AddObjectRef(made, "Evaluator", type) < 0
        || PyModule_AddIntConstant(made, "INTERFACE", INTERFACE) < 0) {
        Py_XDECREF(made);
        made = NULL;
    }
    Py_XDECREF(type);
    return made;
}
