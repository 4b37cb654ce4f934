/* Motion under planned inputs, with their feedback. Included at the end of kernel.c; the step is that of
   action_models.py. */

enum { KINEMATIC, ACCELERATION, DYNAMIC }; /* forms: inputs v2, v2_dot or T */

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

/* One exponential midpoint step of q and w (nw, 0 or r) */
static int planned_step(Evaluator *ev, long form, double h, const double *u, double *q, double *w, Py_ssize_t nw,
                        double *shift, double *q_at, double *w_at)
{
    Py_ssize_t n = ev->n;
    double *rate = ev->stages;
    memcpy(q_at, q, (size_t)ev->nq * sizeof(double));
    memcpy(w_at, w, (size_t)nw * sizeof(double));
    for (int stage = 0; stage < 2; stage++) {
        int ok = planned_flow(ev, form, q_at, w_at, u, rate);
        if (ok <= 0) return ok;
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

/* Form, q, w, inputs and steps h of n nodes; record of q and w after one step of each. False if the general way has to
   decide. */
static PyObject *planned_steps(Evaluator *ev, PyObject *const *args, Py_ssize_t given)
{
    Arrays all = {.count = -1};
    double *q, *w, *u, *h, *out;
    int ok = -1;
    if (!expect(ev, given, 6)) return NULL;
    long form = PyLong_AsLong(args[0]);
    if (PyErr_Occurred()) return NULL;
    Py_ssize_t n = ev->n, nq = ev->nq, nw = form == KINEMATIC ? 0 : ev->r, nu = form == DYNAMIC ? ev->p : ev->r;
    double *shift = malloc((size_t)(n + nq + nw + 1) * sizeof(double));
    if (!shift) return PyErr_NoMemory();
    if (take(&all, args[1], nq, READ, &q) && take(&all, args[2], nw, READ, &w) && take(&all, args[3], nu, READ, &u)
        && take(&all, args[4], 1, READ, &h) && take(&all, args[5], nq + nw, WRITE, &out)) {
        ok = ev->fused && !ev->external_vertical && !ev->timed && all_finite(u, all.count * nu);
        for (Py_ssize_t i = 0; i < all.count && ok > 0; i++, out += nq + nw) {
            memcpy(out, q + i * nq, (size_t)nq * sizeof(double));
            memcpy(out + nq, w + i * nw, (size_t)nw * sizeof(double));
            ok = all_finite(out, nq + nw)
                     ? planned_step(ev, form, h[i], u + i * nu, out, out + nq, nw, shift, shift + n, shift + n + nq)
                     : 0;
        }
    }
    free(shift);
    return result(&all, ok);
}

/* out (n) = tangent vector from the first to the second of two arrays, from a function of Pinocchio; false with an
   error */
static int planned_difference(PyObject *const *call, Py_ssize_t n, double *out)
{
    Py_buffer view;
    PyObject *found = PyObject_CallFunctionObjArgs(call[0], call[1], call[2], NULL);
    if (!found || PyObject_GetBuffer(found, &view, PyBUF_SIMPLE) < 0) {
        Py_XDECREF(found);
        return 0;
    }
    int ok = view.len == n * (Py_ssize_t)sizeof(double);
    if (ok) memcpy(out, view.buf, (size_t)view.len);
    else PyErr_SetString(PyExc_ValueError, "kernel: the difference has another size");
    PyBuffer_Release(&view);
    Py_DECREF(found);
    return ok;
}

/* Form, intervals K, steps of each, step; q, w and inputs (K nu); gains (K nu nx) or None with the planned states of
   all steps, limits (2 nu), the difference and its two arrays (nq). Record of q, w and inputs of all K steps. False if
   the general way has to decide. */
static PyObject *planned_motion(Evaluator *ev, PyObject *const *args, Py_ssize_t given)
{
    Arrays all = {.count = 1};
    double *q, *w, *u, *gains, *planned, *limits, *first, *second, *out;
    int ok = -1;
    if (!expect(ev, given, 14)) return NULL;
    long form = PyLong_AsLong(args[0]);
    Py_ssize_t K = PyLong_AsSsize_t(args[1]), steps = PyLong_AsSsize_t(args[2]), n = ev->n, nq = ev->nq;
    double h = PyFloat_AsDouble(args[3]);
    if (PyErr_Occurred() || !within((long)K, 1 << 20) || !within((long)steps, 1 << 20)) return NULL;
    Py_ssize_t nw = form == KINEMATIC ? 0 : ev->r, nu = form == DYNAMIC ? ev->p : ev->r, nx = n + nw;
    Py_ssize_t row = nq + nw + nu, own = 2 * nq + 2 * nw + n + nx;
    double *work = malloc((size_t)own * sizeof(double) + 1);
    if (!work) return PyErr_NoMemory();
    if (take(&all, args[4], nq, READ, &q) && take(&all, args[5], nw, READ, &w) && take(&all, args[6], K * nu, READ, &u)
        && optional(&all, args[7], K * nu * nx, &gains) && optional(&all, args[8], K * steps * (nq + nw), &planned)
        && take(&all, args[9], 2 * nu, READ, &limits) && take(&all, args[11], nq, WRITE, &first)
        && take(&all, args[12], nq, WRITE, &second) && take(&all, args[13], K * steps * row, WRITE, &out)) {
        double *q_now = work, *w_now = q_now + nq, *q_at = w_now + nw, *w_at = q_at + nq, *shift = w_at + nw,
               *dx = shift + n;
        ok = ev->fused && !ev->external_vertical && !ev->timed && (!gains || planned) && all_finite(u, K * nu);
        memcpy(q_now, q, (size_t)nq * sizeof(double));
        memcpy(w_now, w, (size_t)nw * sizeof(double));
        for (Py_ssize_t i = 0; i < K * steps && ok > 0; i++, out += row) {
            const double *input = u + i / steps * nu, *low = limits, *high = limits + nu;
            double *used = out + nq + nw;
            memcpy(used, input, (size_t)nu * sizeof(double));
            if (gains) {
                const double *gain = gains + i / steps * nu * nx, *there = planned + i * (nq + nw);
                memcpy(first, there, (size_t)nq * sizeof(double));
                memcpy(second, q_now, (size_t)nq * sizeof(double));
                if (!planned_difference(args + 10, n, dx)) ok = -1;
                for (Py_ssize_t j = 0; j < nw; j++) dx[n + j] = w_now[j] - there[nq + j];
                for (Py_ssize_t j = 0; j < nu && ok > 0; j++)
                    used[j] = fmin(fmax(input[j] + dot(gain + j * nx, dx, nx), fmin(low[j], input[j])),
                                   fmax(high[j], input[j]));
                if (ok > 0 && !all_finite(used, nu)) ok = 0;
            }
            if (ok > 0) ok = planned_step(ev, form, h, used, q_now, w_now, nw, shift, q_at, w_at);
            memcpy(out, q_now, (size_t)nq * sizeof(double));
            memcpy(out + nq, w_now, (size_t)nw * sizeof(double));
        }
    }
    free(work);
    return result(&all, ok);
}
