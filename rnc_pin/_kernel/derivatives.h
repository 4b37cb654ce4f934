/* Derivatives of v and v2_dot of one state; a part of kernel.c, which includes it.

   Two equations define a motion, with w the full acceleration and tau its inverse dynamics:

       E v = [mu; v2],    E w + gamma = [0; v2_dot],    tau(q, v, w) + A^T lambda = B T.

   Their variation, with frozen w and lambda, needs of each row the derivatives of E v, of E w + gamma and of A^T
   lambda. Pinocchio differentiates tau. Every other row is a wrench on frames, so its derivative along an entry of q or
   v is a product of two vectors: the slopes of the row with respect to the motion of its frames, and the variation of
   this motion. Below, S_d is column d of the Jacobian, U_d and W_d are twist and acceleration of the parent of its
   joint. Twists are about the origin of the world. A joint k that d moves has the variations

       V_k by q_d:  S_d x (V_k - U_d)
       A_k by q_d:  S_d x (A_k - W_d) - (S_d x U_d) x (V_k - U_d)
       A_k by v_d:  V_d x S_d + S_d x (V_k - U_d),

   if the columns of each joint are constant in the axes of the body that it moves. Otherwise Python decides. */

#include "slopes.h"

/* Tables and memory of the derivatives of an Evaluator, made at their first use. */
struct Derivatives {
    double *twist, *rate;                                 /* of the joints, (joints, 6) */
    double *forces;                                       /* on the joints, (joints, 6) */
    double *origin;                                       /* acceleration of the frames' origins, (frames, 3) */
    double *frames_q, *frames_v;                          /* changes of the frames by q and by v, (frames, n) */
    double *h_q, *tau_q, *tau_v, *N, *Ev_q, *Ew_q, *Ew_v; /* (n, n) each; rows of the last three are packed */
    double *tau, *acceleration, *multipliers, *unit;      /* (n) each; the last is zero between uses */
    double *RM, *Q, *Z, *L, *B;                           /* R^T M (r, n), (r, n) twice, (r, r), (n, p) */
    double *columns;                                      /* of E^-1 that belong to varying rows (n, n) */
    double *passive;                                      /* of the laws (forces) */
    Change *by_q, *by_v;                                  /* frames_q, frames_v */
    long *joint, *parent; /* joint of each entry of v (n), parent of each joint (joints) */
    long *varying;        /* rows of E that are not constant (n) */
    char *moves;          /* true if an entry of v moves a joint (joints, n) */
};

static Py_ssize_t derivatives_size(const Evaluator *ev)
{
    Py_ssize_t n = ev->n, r = ev->r;
    return n + r + n * n + n * r + r * n + r * r + r * ev->p;
}

/* Joints come before those that they carry, and a joint's entries of v come last in its support. */
static void find_joints(const Evaluator *ev, Derivatives *d)
{
    for (Py_ssize_t c = 0; c < ev->n; c++) d->joint[c] = -1;
    for (Py_ssize_t j = 0; j < ev->joints; j++)
        for (long s = ev->start[j]; s < ev->start[j + 1]; s++) {
            long c = ev->support[s];
            d->moves[j * ev->n + c] = 1;
            if (d->joint[c] < 0) d->joint[c] = (long)j;
            if (d->joint[c] != j) d->parent[j] = d->joint[c];
        }
}

static int prepare_derivatives(Evaluator *ev) /* false with an error if there is no memory */
{
    if (ev->derivatives) return 1;
    Py_ssize_t n = ev->n, r = ev->r, joints = ev->joints, frames = ev->frames, nn = n * n;
    Derivatives own, *d = &own;
    double *places, *moves;
    void *memory;
    if (!allocate(&memory, &places, (Py_ssize_t)(sizeof own / sizeof(double)), &d->twist, 6 * joints, &d->rate,
                  6 * joints, &d->forces, 6 * joints, &d->origin, 3 * frames, &d->frames_q, frames * n * CHANGE,
                  &d->frames_v, frames * n * CHANGE, &d->h_q, nn, &d->tau_q, nn, &d->tau_v, nn, &d->N, nn, &d->Ev_q, nn,
                  &d->Ew_q, nn, &d->Ew_v, nn, &d->columns, nn, &d->tau, n, &d->unit, n, &d->RM, n * r, &d->Q, n * r,
                  &d->Z, n * r, &d->acceleration, n, &d->multipliers, n, &d->L, r * r, &d->B, n * ev->p, &d->passive,
                  ev->forced, &places, 2 * n + joints, &moves, joints * n / 8 + 1, NULL))
        return 0;
    d->by_q = (Change *)d->frames_q, d->by_v = (Change *)d->frames_v, d->moves = (char *)moves;
    d->joint = (long *)places, d->varying = d->joint + n, d->parent = d->varying + n;
    ev->derivatives = memory; /* whose first part is for this structure */
    *ev->derivatives = own;
    find_joints(ev, ev->derivatives);
    return 1;
}

/* ------------------------------------------------------------------ twists */

static void cross_force(const double *x, const double *F, double *out) /* the same of a wrench */
{
    cross(x + 3, F, out);
    cross(x + 3, F + 3, out + 3);
    add_cross(out + 3, x, F);
}

/* twists and accelerations of all joints, then of all frames, at velocity v and acceleration w */
static void move_joints(Evaluator *ev, Derivatives *d, const double *J, const double *v, const double *w)
{
    Py_ssize_t n = ev->n;
    double S[6], turned[6];
    for (Py_ssize_t j = 0; j < ev->joints; j++) {
        double *V = d->twist + 6 * j, *A = d->rate + 6 * j;
        const double *V0 = d->twist + 6 * d->parent[j], *A0 = d->rate + 6 * d->parent[j];
        for (int i = 0; i < 6; i++) V[i] = j ? V0[i] : 0.0, A[i] = j ? A0[i] : 0.0;
        for (int pass = 0; pass < 2; pass++) /* the whole twist before the accelerations */
            for (long s = ev->start[j]; s < ev->start[j + 1]; s++) {
                long c = ev->support[s];
                if (d->joint[c] != j) continue;
                column(J, n, c, S);
                if (!pass) add(V, v[c], S, 6);
                else {
                    cross_motion(V, S, turned);
                    add(A, w[c], S, 6);
                    add(A, v[c], turned, 6);
                }
            }
    }
    for (Py_ssize_t f = 0; f < ev->frames; f++) {
        Motion *at = ev->motion + f;
        double *a = d->origin + 3 * f;
        memcpy(at->V, d->twist + 6 * ev->frame[f].joint, sizeof at->V);
        memcpy(at->A, d->rate + 6 * ev->frame[f].joint, sizeof at->A);
        memcpy(at->v, at->V, sizeof at->v);
        add_cross(at->v, at->V + 3, at->p);
        memcpy(a, at->A, 3 * sizeof(double));
        add_cross(a, at->A + 3, at->p);
        add_cross(a, at->V + 3, at->v);
    }
}

/* variation of a frame's motion by that of its twist and acceleration, at the place p + given change of it */
static void at_origin(const Motion *at, const double *V, const double *A, Change *out)
{
    memcpy(out->v, V, 3 * sizeof(double));
    memcpy(out->w, V + 3, 3 * sizeof(double));
    memcpy(out->a, A, 3 * sizeof(double));
    memcpy(out->b, A + 3, 3 * sizeof(double));
    add_cross(out->v, V + 3, at->p);
    add_cross(out->v, at->V + 3, out->p);
    add_cross(out->a, A + 3, at->p);
    add_cross(out->a, at->A + 3, out->p);
    add_cross(out->a, V + 3, at->v);
    add_cross(out->a, at->V + 3, out->v);
}

/* variations of the motion of all frames, along each entry of q and of v that moves them */
static void vary_frames(Evaluator *ev, Derivatives *d, const double *J)
{
    Py_ssize_t n = ev->n;
    for (Py_ssize_t f = 0; f < ev->frames; f++) {
        const Motion *at = ev->motion + f;
        long joint = ev->frame[f].joint;
        for (long s = ev->start[joint]; s < ev->start[joint + 1]; s++) {
            long c = ev->support[s], before = d->parent[d->joint[c]];
            const double *U = d->twist + 6 * before;
            double S[6], own[6], ahead[6], V[6], A[6], part[6];
            Change *by_q = d->by_q + f * n + c, *by_v = d->by_v + f * n + c;
            column(J, n, c, S);
            subtract(at->V, U, ahead, 6);
            cross_motion(S, ahead, V);
            cross_motion(d->twist + 6 * d->joint[c], S, own);
            add(own, 1.0, V, 6);
            at_origin(at, S, own, by_v); /* rotation and place remain zero */
            cross_motion(S, U, part);
            cross_motion(part, ahead, own);
            subtract(at->A, d->rate + 6 * before, ahead, 6);
            cross_motion(S, ahead, A);
            add(A, -1.0, own, 6);
            memcpy(by_q->s, S + 3, sizeof by_q->s);
            memcpy(by_q->p, S, sizeof by_q->p);
            add_cross(by_q->p, S + 3, at->p);
            at_origin(at, V, A, by_q);
        }
    }
}

/* ------------------------------------------------------------------ rows of E, and their forces */

/* Derivatives of the velocity of a row by q, and of its acceleration by q and v unless NULL */
static void wrench_row(const Evaluator *ev, const Derivatives *d, const Row *row, const Slopes *slopes, double *Ev_q,
                       double *Ew_q, double *Ew_v)
{
    int sides = sides_of(row);
    for (int side = 0; side < sides; side++) {
        long f = side ? row->b : row->a, joint = ev->frame[f].joint;
        const double *K = (const double *)(slopes->velocity + side), *G = (const double *)(slopes->acceleration + side);
        for (long s = ev->start[joint]; s < ev->start[joint + 1]; s++) {
            long c = ev->support[s];
            const double *by_q = (const double *)(d->by_q + f * ev->n + c),
                         *by_v = (const double *)(d->by_v + f * ev->n + c);
            Ev_q[c] += dot(K, by_q, UP_TO_VELOCITY);
            if (!Ew_q) continue;
            Ew_q[c] += dot(G, by_q, CHANGE);
            Ew_v[c] += dot(G + FROM_VELOCITY, by_v + FROM_VELOCITY, CHANGE - FROM_VELOCITY);
        }
    }
}

/* Momentum is X h, with the rows h = M v of the joint; its rate is X tau. Both depend on q by the placement too. */
static void momentum_row(const Evaluator *ev, const Derivatives *d, const Row *row, const double *P, const double *v,
                         double *Ev_q, double *Ew_q, double *Ew_v)
{
    Py_ssize_t n = ev->n, first = row->i[0];
    const double *places = P + n * n + 6 * n;
    double X[6], rate[6], h[6];
    int size = momentum(row, places, NULL, X, rate);
    for (int j = 0; j < size; j++) {
        add(Ev_q, X[j], d->h_q + (first + j) * n, n);
        add(Ew_q, X[j], d->tau_q + (first + j) * n, n);
        add(Ew_v, X[j], d->tau_v + (first + j) * n, n);
        h[j] = dot(P + (first + j) * n, v, n);
    }
    for (int c = 0; c < size && row->i[2]; c++) {
        d->unit[first + c] = 1.0;
        momentum(row, places, d->unit, X, rate);
        d->unit[first + c] = 0.0;
        Ev_q[first + c] += dot(rate, h, size);
        Ew_q[first + c] += dot(rate, d->tau + first, size);
    }
}

static void ackermann_row(const Row *row, const double *q, const double *v, const double *w, double *Ev_q, double *Ew_q,
                          double *Ew_v)
{
    double f[4], sl = row->w[1], sr = row->w[2];
    long l = row->i[1], r = row->i[3];
    double left = sl * v[l], right = sr * v[r], dl = sl * w[l], dr = sr * w[r];
    double squares = left * left + right * right, both = 2 * left * right;
    ackermann(row, q, f);
    Ev_q[l] += sl * (f[3] * right - f[0] * left);
    Ev_q[r] += sr * (f[3] * left - f[0] * right);
    Ew_q[l] += sl * (f[3] * dr - f[0] * dl - f[1] * squares - f[2] * both);
    Ew_q[r] += sr * (f[3] * dl - f[0] * dr - f[2] * squares - f[1] * both);
    Ew_v[l] += 2 * sl * (f[3] * right - f[0] * left);
    Ew_v[r] += 2 * sr * (f[3] * left - f[0] * right);
}

/* Derivatives of E v, of E w + gamma by q and v, for the rows that are not constant; returns their number. */
static Py_ssize_t vary_rows(Evaluator *ev, Derivatives *d, const double *q, const double *P, const double *v)
{
    Py_ssize_t n = ev->n, count = 0;
    Slopes slopes;
    for (Py_ssize_t i = 0; i < n; i++) {
        const Row *row = ev->rows + i;
        double *Ev_q = d->Ev_q + count * n, *Ew_q = d->Ew_q + count * n, *Ew_v = d->Ew_v + count * n;
        if (row->kind == CONSTANT) continue;
        memset(Ev_q, 0, (size_t)n * sizeof(double));
        memset(Ew_q, 0, (size_t)n * sizeof(double));
        memset(Ew_v, 0, (size_t)n * sizeof(double));
        if (row_slopes(ev, d->origin, row, &slopes)) wrench_row(ev, d, row, &slopes, Ev_q, Ew_q, Ew_v);
        else if (row->kind == MOMENTUM) momentum_row(ev, d, row, P, v, Ev_q, Ew_q, Ew_v);
        else if (row->kind == ACKERMANN) ackermann_row(row, q, v, d->acceleration, Ev_q, Ew_q, Ew_v);
        d->varying[count++] = (long)i;
    }
    return count;
}

/* forces on the joints += force times the wrenches of a row, or times their rates along a column of J */
static void add_force(Evaluator *ev, Derivatives *d, const Row *row, double force, long along_column)
{
    Wrench on[2];
    double W[6];
    if (!sides_of(row)) return; /* momenta have no reaction force */
    if (along_column >= 0 && !d->moves[ev->frame[row->a].joint * ev->n + along_column]
        && !(sides_of(row) == 2 && d->moves[ev->frame[row->b].joint * ev->n + along_column]))
        return;
    int sides = wrenches(ev, row, along_column >= 0, on);
    for (int side = 0; side < sides; side++) {
        if (along_column >= 0) rate_about_origin(on + side, W);
        else about_origin(on + side, W);
        add(d->forces + 6 * on[side].joint, force, W, 6);
    }
}

/* forces of A^T lambda - B T and of the laws on the joints, or their rates along a column of J */
static void add_forces(Evaluator *ev, Derivatives *d, const double *T, long along_column)
{
    Py_ssize_t first = ev->n + ev->k, last = ev->count - ev->forced;
    memset(d->forces, 0, (size_t)(6 * ev->joints) * sizeof(double));
    for (Py_ssize_t i = 0; i < ev->m; i++) add_force(ev, d, ev->rows + i, d->multipliers[i], along_column);
    for (Py_ssize_t i = first; i < last; i++) add_force(ev, d, ev->rows + i, -T[ev->columns[i - first]], along_column);
    for (Py_ssize_t i = last; i < ev->count; i++) add_force(ev, d, ev->rows + i, -d->passive[i - last], along_column);
}

/* N: derivative of A^T lambda - B T, less forces of laws, by q, at frozen lambda, T and laws. Moves the frames. */
static void vary_forces(Evaluator *ev, Derivatives *d, const double *q, const double *J, const double *T)
{
    Py_ssize_t n = ev->n;
    double S[6], turned[6], *N = d->N;
    memset(N, 0, (size_t)(n * n) * sizeof(double));
    add_forces(ev, d, T, -1);
    for (Py_ssize_t j = 1; j < ev->joints; j++) {
        const double *F = d->forces + 6 * j;
        if (dot(F, F, 6) == 0.0) continue;
        for (long s = ev->start[j]; s < ev->start[j + 1]; s++) {
            long c = ev->support[s], of = d->joint[c];
            column(J, n, c, S);
            cross_force(S, F, turned);
            project(ev, turned, of, J, N + c * n);
        }
    }
    for (long c = 0; c < n; c++) {
        double *out = d->tau; /* of no use any more */
        int any = 0;
        column(J, n, c, S);
        for (Py_ssize_t f = 0; f < ev->frames; f++) {
            Motion *at = ev->motion + f;
            int moved = d->moves[ev->frame[f].joint * n + c];
            any |= moved;
            for (int i = 0; i < 6; i++) at->V[i] = moved ? S[i] : 0.0;
            memcpy(at->v, at->V, sizeof at->v);
            add_cross(at->v, at->V + 3, at->p);
        }
        if (!any) continue;
        add_forces(ev, d, T, c);
        memset(out, 0, (size_t)n * sizeof(double));
        for (Py_ssize_t j = 1; j < ev->joints; j++)
            if (dot(d->forces + 6 * j, d->forces + 6 * j, 6) != 0.0) project(ev, d->forces + 6 * j, (long)j, J, out);
        for (Py_ssize_t i = 0; i < n; i++) N[i * n + c] += out[i];
    }
    for (Py_ssize_t i = 0; i < ev->m; i++) {
        const Row *row = ev->rows + i;
        if (row->kind != ACKERMANN) continue;
        double f[4], force = d->multipliers[i], both = force * row->w[1] * row->w[2];
        long l = row->i[1], r = row->i[3];
        ackermann(row, q, f);
        N[l * n + l] -= force * f[0], N[r * n + r] -= force * f[0];
        N[l * n + r] += both * f[3], N[r * n + l] += both * f[3];
    }
}

/* Subtract the derivatives of the laws, times their rows, from those of tau; then keep the laws. The frames move. */
static void vary_laws(Evaluator *ev, Derivatives *d, const double *q, const double *P, const double *v)
{
    Py_ssize_t n = ev->n, first = ev->count - ev->forced;
    double *rate_q = d->tau; /* of no use any more */
    for (Py_ssize_t f = 0; f < ev->forced; f++) {
        const Row *row = ev->rows + first + f;
        const double *of = ev->laws + f * FORCE_NUMBERS, *J = ev->force_row;
        double unused;
        Slopes slopes;
        assemble(ev, q, P, NULL, first + f, first + f + 1, ev->force_row);
        double w = dot(J, v, n), curved = of[F_LIMIT] != 0.0 ? tanh(w / of[F_SPEED]) : 0.0;
        double by_rate =
            -of[F_DAMPING] - (of[F_LIMIT] != 0.0 ? of[F_LIMIT] / of[F_SPEED] * (1.0 - curved * curved) : 0.0);
        d->passive[f] = law(ev, f, q, w, &unused);
        if (by_rate == 0.0 && of[F_STIFFNESS] == 0.0) continue;
        memset(rate_q, 0, (size_t)n * sizeof(double));
        if (row_slopes(ev, d->origin, row, &slopes)) wrench_row(ev, d, row, &slopes, rate_q, NULL, NULL);
        for (Py_ssize_t i = 0; i < n; i++) {
            if (J[i] == 0.0) continue;
            add(d->tau_q + i * n, J[i] * of[F_STIFFNESS], J, n);
            add(d->tau_q + i * n, -J[i] * by_rate, rate_q, n);
            add(d->tau_v + i * n, -J[i] * by_rate, J, n);
        }
    }
}

/* ------------------------------------------------------------------ one state */

/* Pinocchio's derivatives of the inverse dynamics at q, v and w; false with an error */
static int differentiated(Evaluator *ev, const double *q, const double *v, const double *w)
{
    take_state(ev, q, v);
    memcpy(ev->views[V_A].buf, w, (size_t)ev->n * sizeof(double));
    return called(ev, P_RNEA, 1);
}

/* acceleration w, tau and multipliers at v and v2_dot; then Pinocchio's derivatives */
static int solve_motion(Evaluator *ev, Derivatives *d, const double *q, const double *P, const double *F,
                        const double *S, const double *force, const double *v, const double *v2_dot)
{
    Py_ssize_t n = ev->n, m = ev->m;
    const double *inverse = F + n * n, *solved = S + 2 * n;
    double *w = d->acceleration;
    for (Py_ssize_t i = 0; i < n; i++) w[i] = dot(inverse + i * n + m, v2_dot, ev->r) - solved[i];
    memset(d->multipliers, 0, (size_t)n * sizeof(double));
    for (Py_ssize_t i = 0; i < n; i++) {
        d->tau[i] = S[i] + dot(P + i * n, w, n);
        add(d->multipliers, force[i] - d->tau[i], inverse + i * n, m);
    }
    if (ev->rates_need_C) { /* there are momenta: derivatives of M v, as gravity does not act along them */
        memset(d->h_q, 0, (size_t)n * sizeof(double));
        if (!differentiated(ev, q, d->h_q, v)) return 0;
        memcpy(d->h_q, ev->views[V_TAU_Q].buf, (size_t)(n * n) * sizeof(double));
    }
    if (!differentiated(ev, q, v, w)) return 0;
    memcpy(d->tau_q, ev->views[V_TAU_Q].buf, (size_t)(n * n) * sizeof(double));
    memcpy(d->tau_v, ev->views[V_TAU_V].buf, (size_t)(n * n) * sizeof(double));
    return 1;
}

/* out: v (n), v2_dot (r), v by q (n, n) and v2 (n, r), v2_dot by q (r, n), v2 (r, r) and T (r, p); v and v2_dot are
   given. B (n, p), H and E^-1 are those of the state. False if H is not positive definite. */
static int solve_variations(Evaluator *ev, Derivatives *d, const double *P, const double *F, const double *H,
                            const double *B, Py_ssize_t varying, double *out)
{
    Py_ssize_t n = ev->n, m = ev->m, r = ev->r, p = ev->p;
    const double *inverse = F + n * n, *R = inverse + m;
    double *v_q = out + n + r, *v_v2 = v_q + n * n, *by_q = v_v2 + n * r, *by_v2 = by_q + r * n, *by_T = by_v2 + r * r;
    if (!cholesky(H, r, 1, d->L, r)) return 0;
    memset(v_q, 0, (size_t)(n * n) * sizeof(double));
    for (Py_ssize_t i = 0; i < n; i++) {
        for (Py_ssize_t k = 0; k < varying; k++) add(v_q + i * n, -inverse[i * n + d->varying[k]], d->Ev_q + k * n, n);
        memcpy(v_v2 + i * r, R + i * n, (size_t)r * sizeof(double));
    }
    multiply_transposed(R, n, P, n, d->RM, r, n, n);
    for (Py_ssize_t i = 0; i < n; i++)
        for (Py_ssize_t k = 0; k < varying; k++) d->columns[i * varying + k] = inverse[i * n + d->varying[k]];
    multiply(d->RM, n, d->columns, varying, d->Q, r, n, varying);
    for (Py_ssize_t i = 0; i < n * n; i++) d->tau_q[i] += d->N[i];
    multiply_transposed(R, n, d->tau_q, n, by_q, r, n, n);
    multiply_transposed(R, n, d->tau_v, n, d->Z, r, n, n);
    for (Py_ssize_t i = 0; i < r * n; i++) by_q[i] = -by_q[i], d->Z[i] = -d->Z[i];
    for (Py_ssize_t i = 0; i < r; i++)
        for (Py_ssize_t k = 0; k < varying; k++) {
            double factor = d->Q[i * varying + k];
            add(by_q + i * n, factor, d->Ew_q + k * n, n);
            add(d->Z + i * n, factor, d->Ew_v + k * n, n);
        }
    for (Py_ssize_t i = 0; i < r; i++)
        for (Py_ssize_t j = 0; j < n; j++) add(by_q + i * n, d->Z[i * n + j], v_q + j * n, n);
    multiply(d->Z, n, R, n, by_v2, r, n, r);
    multiply_transposed(R, n, B, p, by_T, r, n, p);
    solve_cholesky(d->L, by_q, r, n);
    solve_cholesky(d->L, by_v2, r, r);
    solve_cholesky(d->L, by_T, r, p);
    return all_finite(out, derivatives_size(ev));
}

/* Record of derivatives of one state. False if the general way has to decide; -1: an error */
static int differentiate(Evaluator *ev, const double *q, const double *v2, const double *T, double *out)
{
    Py_ssize_t n = ev->n;
    Derivatives *d = ev->derivatives;
    double *P = ev->scratch + ev->work, *F = P + kinematics_size(ev), *S = F + 2 * n * n;
    double *force = S + dynamics_size(ev), *J = P + n * n, *B = d->B, *v = out, *v2_dot = out + n;
    int ok = locate_state(ev, q, v2, T, P, F);
    if (ok <= 0) return ok;
    input_matrix(ev, q, P, B, ev->scratch);
    for (Py_ssize_t j = 0; j < n; j++) force[j] = dot(B + j * ev->p, T, ev->p);
    velocity(ev, F, ev->mu, v2, v);
    if (!add_passive(ev, q, P, v, force, NULL)) return 0;
    if (!biases(ev, q, P, F, v, NULL, S)) return -1;
    ok = accelerate(ev, F, S, force, v2_dot, ev->scratch);
    if (ok > 0 && !solve_motion(ev, d, q, P, F, S, force, v, v2_dot)) ok = -1;
    if (ok <= 0) return ok;
    move_joints(ev, d, J, v, d->acceleration);
    vary_frames(ev, d, J);
    Py_ssize_t varying = vary_rows(ev, d, q, P, v);
    vary_laws(ev, d, q, P, v);
    vary_forces(ev, d, q, J, T);
    return solve_variations(ev, d, P, F, S + 4 * n, B, varying, out);
}

/* q, v2, T, mu and its rates or None -> record of derivatives */
static int derivatives_at(Evaluator *ev, double *const *x)
{ return ev->r && use_rates(ev, x[3]) ? differentiate(ev, x[0], x[1], x[2], x[4]) : 0; }

static PyObject *state_derivatives(Evaluator *ev, PyObject *const *args, Py_ssize_t given)
{ return prepare_derivatives(ev) ? fused(ev, args, given, "qrTu?", derivatives_size(ev), derivatives_at) : NULL; }
