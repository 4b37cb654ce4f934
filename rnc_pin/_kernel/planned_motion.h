/* Motion under planned inputs. Included at the end of kernel.c; the step is that of
   action_models.py. */

enum { KINEMATIC, ACCELERATION, DYNAMIC }; /* forms: inputs v2, v2_dot or T */

#define LARGEST_TURN 4.0 /* square of the largest turn of a step that has derivatives here [rad^2] */
#define TERMS 25         /* of the series of its derivatives, whose rest is below the rounding */

typedef struct {
    long form;
    Py_ssize_t nw, nu; /* numbers of w and of inputs */
} Form;

static int take_form(const Evaluator *ev, PyObject *number, Form *out) /* false with an error */
{
    long form = PyLong_AsLong(number);
    *out = (Form){form, form == KINEMATIC ? 0 : ev->r, form == DYNAMIC ? ev->p : ev->r};
    return !PyErr_Occurred();
}

static int plannable(const Evaluator *ev, const double *u, Py_ssize_t count)
{ return ev->fused && !ev->external_vertical && !ev->timed && all_finite(u, count); }

/* Velocity (n) and reduced acceleration (r) of a form. 0: the general way has to decide; -1: an error */
static int planned_flow(Evaluator *ev, long form, const double *q, const double *w, const double *u, double *rate)
{
    Py_ssize_t n = ev->n, r = ev->r;
    if (form == DYNAMIC) return derivative(ev, q, w, u, NULL, NULL, NULL, rate);
    double *P = ev->scratch + ev->work, *F = P + kinematics_size(ev);
    if (!take_position(ev, q, P)) return -1;
    if (!factorize(ev, q, P, NULL, F)) return 0;
    velocity(ev, F, ev->mu, form == KINEMATIC ? u : w, rate);
    if (form == ACCELERATION) memcpy(rate + n, u, (size_t)r * sizeof(double));
    return 1;
}

/* One exponential midpoint step of q and w (nw, 0 or r); first: velocity and acceleration (n + r) at its start, which
   it computes if they are not known */
static int planned_step(Evaluator *ev, long form, double h, const double *u, double *q, double *w, Py_ssize_t nw,
                        double *shift, double *q_at, double *w_at, double *first, int known)
{
    Py_ssize_t n = ev->n;
    memcpy(q_at, q, (size_t)ev->nq * sizeof(double));
    memcpy(w_at, w, (size_t)nw * sizeof(double));
    for (int stage = 0; stage < 2; stage++) {
        double *rate = ev->stages;
        int ok = stage || !known ? planned_flow(ev, form, q_at, w_at, u, rate) : 1;
        if (ok <= 0) return ok;
        if (stage == 0 && known) rate = first;
        else if (stage == 0) memcpy(first, rate, (size_t)(n + nw) * sizeof(double));
        double length = stage ? h : h / 2;
        for (Py_ssize_t i = 0; i < n; i++) shift[i] = length * rate[i];
        for (Py_ssize_t i = 0; i < nw; i++) w_at[i] = w[i] + length * rate[n + i];
        if (!all_finite(shift, n) || !all_finite(w_at, nw)) return 0;
        if (!displace(ev, q, shift, q_at)) return -1;
    }
    memcpy(q, q_at, (size_t)ev->nq * sizeof(double));
    memcpy(w, w_at, (size_t)nw * sizeof(double));
    return 1;
}

/* True if the numbers (n) before x are the same: steps from one node share their first flow */
static int same(const double *x, Py_ssize_t n) { return !n || !memcmp(x - n, x, (size_t)n * sizeof(double)); }

/* Form, q and w of n nodes, or of the first one, whose motion goes on, inputs and steps h of each; record of q and w
   after one step of each. False if the general way has to decide. */
static PyObject *planned_steps(Evaluator *ev, PyObject *const *args, Py_ssize_t given)
{
    Arrays all = {.count = -1}, starts = {.count = -1};
    double *h, *u, *q, *w, *out, *shift, *q_at, *w_at, *first;
    Form of;
    if (!expect(ev, given, 6) || !take_form(ev, args[0], &of)) return NULL;
    Py_ssize_t nq = ev->nq, nw = of.nw, nu = of.nu;
    int ok = -1;
    if (take(&all, args[4], 1, READ, &h) && take(&all, args[3], nu, READ, &u) && take(&starts, args[1], nq, READ, &q)
        && take(&starts, args[2], nw, READ, &w) && take(&all, args[5], nq + nw, WRITE, &out)
        && allocate(&all.memory, &shift, ev->n, &q_at, nq, &w_at, nw, &first, ev->n + nw, NULL))
        ok = (starts.count == 1 || starts.count == all.count) && plannable(ev, u, all.count * nu);
    for (Py_ssize_t i = 0; i < all.count && ok > 0; i++, out += nq + nw, u += nu) {
        int goes_on = i && starts.count == 1, known = i && !goes_on;
        if (goes_on) q = out - nq - nw, w = out - nw;
        else if (i) q += nq, w += nw;
        if (known) known = same(q, nq) && same(w, nw) && same(u, nu);
        memcpy(out, q, (size_t)nq * sizeof(double));
        memcpy(out + nq, w, (size_t)nw * sizeof(double));
        ok = all_finite(out, nq + nw)
                 ? planned_step(ev, of.form, h[i], u, out, out + nq, nw, shift, q_at, w_at, first, known)
                 : 0;
    }
    close_arrays(&starts);
    return result(&all, ok);
}

/* Derivatives of velocity and acceleration of a form (nx, nx + nu + 1) by state, input, and step, which has none;
   found: record of ``differentiate`` */
static void flow_slopes(const Evaluator *ev, long form, const double *found, Py_ssize_t nx, Py_ssize_t columns,
                        double *out)
{
    Py_ssize_t n = ev->n, r = ev->r, p = ev->p;
    const double *v_q = found + n + r, *v_v2 = v_q + n * n, *by_q = v_v2 + n * r, *by_v2 = by_q + r * n,
                 *by_T = by_v2 + r * r;
    memset(out, 0, (size_t)(nx * columns) * sizeof(double));
    for (Py_ssize_t i = 0; i < n; i++, out += columns) {
        memcpy(out, v_q + i * n, (size_t)n * sizeof(double));
        memcpy(out + n, v_v2 + i * r, (size_t)r * sizeof(double)); /* v2 is a state, or the input */
    }
    for (Py_ssize_t i = 0; i < nx - n; i++, out += columns) {
        if (form == ACCELERATION) {
            out[nx + i] = 1.0;
            continue;
        }
        memcpy(out, by_q + i * n, (size_t)n * sizeof(double));
        memcpy(out + n, by_v2 + i * r, (size_t)r * sizeof(double));
        memcpy(out + nx, by_T + i * p, (size_t)p * sizeof(double));
    }
}

/* Derivatives of exp(u + x) by x, and of exp(y) exp(u) by y, at zero, in the axes at the end: series of the adjoint.
   False for a turn that is too large for them. */
static int exponential_slopes(long kind, const double *u, int size, double *by_step, double *by_start)
{
    const double *turn = u + (kind == PLANAR ? 2 : kind == FREE ? 3 : 0);
    if (!(dot(turn, turn, kind == PLANAR ? 1 : 3) < LARGEST_TURN)) return 0;
    for (int j = 0; j < size; j++) {
        double x[6] = {0.0}, next[6], factor = 1.0;
        x[j] = 1.0;
        for (int i = 0; i < size; i++) by_step[i * size + j] = by_start[i * size + j] = x[i];
        for (int k = 1; k <= TERMS; k++) {
            bracket(kind, u, x, next);
            memcpy(x, next, (size_t)size * sizeof(double));
            factor /= -k;
            for (int i = 0; i < size; i++) {
                by_start[i * size + j] += factor * x[i];
                by_step[i * size + j] += factor / (k + 1) * x[i];
            }
        }
    }
    return 1;
}

/* Derivatives of a state displaced by h times a flow, from those of the flow, in place; h is a share of the step.
   False if the general way has to decide */
static int displaced_slopes(const Evaluator *ev, Py_ssize_t nx, Py_ssize_t columns, const double *flow, double h,
                            double share, double *slopes)
{
    for (Py_ssize_t i = 0; i < nx; i++) {
        double *row = slopes + i * columns;
        for (Py_ssize_t j = 0; j < columns; j++) row[j] *= h;
        row[columns - 1] += share * flow[i];
    }
    for (Py_ssize_t k = 0; k < ev->curves; k++) {
        long kind = ev->curved[2 * k], at = ev->curved[2 * k + 1];
        int size = kind == FREE ? 6 : 3;
        double by_step[36], by_start[36], u[6], before[6], *block = slopes + at * columns;
        for (int i = 0; i < size; i++) u[i] = h * flow[at + i];
        if (!exponential_slopes(kind, u, size, by_step, by_start)) return 0;
        for (Py_ssize_t j = 0; j < columns; j++) {
            for (int i = 0; i < size; i++) before[i] = block[i * columns + j];
            for (int i = 0; i < size; i++) block[i * columns + j] = dot(by_step + i * size, before, size);
        }
        for (int i = 0; i < size; i++)
            for (int j = 0; j < size; j++) block[i * columns + at + j] += by_start[i * size + j] - (i == j);
    }
    for (Py_ssize_t i = 0; i < nx; i++) slopes[i * columns + i] += 1.0;
    return 1;
}

/* Form, q, w, inputs and steps h of n nodes; records of derivatives at the nodes, of q and w after one step of each,
   and of their derivatives (nx, nx + nu + 1) by state, input and step. False if the general way has to decide. */
static PyObject *planned_derivatives(Evaluator *ev, PyObject *const *args, Py_ssize_t given)
{
    Arrays all = {.count = -1};
    double *x[7], *none, *second, *flow, *shift, *q_at, *w_at, *by_middle, *slopes;
    Form of;
    if (!expect(ev, given, 8) || !prepare_derivatives(ev) || !take_form(ev, args[0], &of)) return NULL;
    Py_ssize_t n = ev->n, nq = ev->nq, r = ev->r, size = derivatives_size(ev), nw = of.nw, nu = of.nu, nx = n + nw;
    Py_ssize_t columns = nx + nu + 1, sizes[] = {nq, nw, nu, 1, size, nq + nw, nx * columns};
    if (!take_sized(&all, args + 1, sizes, 7, 3, x)
        || !allocate(&all.memory, &none, ev->p, &second, size, &flow, n + r, &shift, n, &q_at, nq, &w_at, nw,
                     &by_middle, nx * columns, &slopes, nx * columns, NULL))
        return result(&all, -1);
    int ok = plannable(ev, x[2], all.count * nu) && r && ev->curved;
    double *after = x[5], *out = x[6];
    for (Py_ssize_t i = 0; i < all.count && ok > 0; i++, out += nx * columns, after += nq + nw) {
        const double *q = x[0] + i * nq, *w = x[1] + i * nw, *u = x[2] + i * nu, *T = of.form == DYNAMIC ? u : none;
        memcpy(q_at, q, (size_t)nq * sizeof(double));
        memcpy(w_at, w, (size_t)nw * sizeof(double));
        for (int stage = 0; stage < 2 && ok > 0; stage++) {
            double *found = stage ? second : x[4] + i * size, length = stage ? x[3][i] : x[3][i] / 2;
            double *moved = stage ? out : by_middle;
            ok = differentiate(ev, q_at, of.form == KINEMATIC ? u : w_at, T, found);
            if (ok <= 0) break;
            memcpy(flow, found, (size_t)(n + r) * sizeof(double));
            if (of.form == ACCELERATION) memcpy(flow + n, u, (size_t)r * sizeof(double));
            for (Py_ssize_t j = 0; j < n; j++) shift[j] = length * flow[j];
            for (Py_ssize_t j = 0; j < nw; j++) w_at[j] = w[j] + length * flow[n + j];
            if (!displace(ev, q, shift, q_at)) ok = -1;
            flow_slopes(ev, of.form, found, nx, columns, stage ? slopes : by_middle);
            if (stage) {
                memset(out, 0, (size_t)(nx * columns) * sizeof(double));
                for (Py_ssize_t j = 0; j < nx; j++)
                    memcpy(out + j * columns + nx, slopes + j * columns + nx, (size_t)nu * sizeof(double));
                multiply_slopes(slopes, by_middle, out, nx, columns);
            }
            if (ok > 0) ok = displaced_slopes(ev, nx, columns, flow, length, stage ? 1.0 : 0.5, moved);
        }
        memcpy(after, q_at, (size_t)nq * sizeof(double));
        memcpy(after + nq, w_at, (size_t)nw * sizeof(double));
    }
    return result(&all, ok);
}
