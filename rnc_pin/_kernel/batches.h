/* Runs side by side, each with the bits of a run alone. Included at the end of kernel.c.

   Each run has a velocity chart, and so an evaluator of its own. status (count): 1 where the kernel decided, 0 where
   the general way has to decide; other runs do not notice it. */

/* Evaluator of run i, or NULL: without one, or with an error if it is of another robot. */
static Evaluator *of_run(const Evaluator *ev, PyObject *evaluators, Py_ssize_t i)
{
    PyObject *object = PyTuple_GetItem(evaluators, i);
    if (!object || object == Py_None) return NULL;
    Evaluator *found = (Evaluator *)object;
    if (Py_TYPE(object) == Py_TYPE((PyObject *)ev) && found->ready && found->nq == ev->nq && found->n == ev->n
        && found->p == ev->p && found->joints == ev->joints)
        return found;
    PyErr_SetString(PyExc_ValueError, "kernel: the runs of a batch are of one robot");
    return NULL;
}

/* An array with a row for each run, which may be longer than size. */
static int take_rows(Arrays *all, PyObject *object, Py_ssize_t size, int flags, double **out, Py_ssize_t *length)
{
    Py_buffer *view = all->views + all->open;
    Py_ssize_t column = all->count * (Py_ssize_t)sizeof(double);
    *out = NULL;
    if (PyObject_GetBuffer(object, view, flags) < 0) return 0;
    all->open++, *out = view->buf, *length = column > 0 ? view->len / column : size;
    if (*length >= size && *length * column == view->len) return 1;
    PyErr_SetString(PyExc_ValueError, "kernel: an array of a batch has short rows");
    return 0;
}

/* Tuple of evaluators; q (nq), y that starts with the velocities of the chart, of one run mu and its rates (2 m) or
   None, record of kinematics or None, v (n), record of the sum of squares of R; infinite where the general way has to
   decide. */
static PyObject *admissible_velocities(Evaluator *ev, PyObject *const *args, Py_ssize_t given)
{
    Arrays all = {.count = -1};
    double *q, *y, *rates, *P = NULL, *v, *sizes;
    Py_ssize_t n = ev->n, in_y = 0;
    if (!expect(ev, given, 7) || (all.count = PyTuple_Size(args[0])) < 0) return NULL;
    if (!take(&all, args[1], ev->nq, READ, &q) || !take_rows(&all, args[2], 0, READ, &y, &in_y)
        || !optional(&all, args[3], 2 * ev->m, &rates)
        || (args[4] != Py_None && !take(&all, args[4], kinematics_size(ev), WRITE, &P))
        || !take(&all, args[5], n, WRITE, &v) || !take(&all, args[6], 1, WRITE, &sizes))
        return result(&all, -1);
    for (Py_ssize_t i = 0; i < all.count; i++, q += ev->nq, v += n, y += in_y) {
        Evaluator *chart = of_run(ev, args[0], i);
        double *own = !P ? ev->scratch + ev->work : P + i * kinematics_size(ev);
        sizes[i] = INFINITY;
        if (PyErr_Occurred() || !take_position(ev, q, own)) return result(&all, -1);
        if (!chart || !chart->fused || chart->r > in_y || (rates && chart != ev)) continue;
        if (!use_rates(chart, rates)) continue;
        double *F = chart->scratch + chart->work + kinematics_size(chart), *R = F + n * n + chart->m;
        if (!all_finite(y, in_y) || !factorize(chart, q, own, NULL, F)) continue;
        velocity(chart, F, chart->mu, y, v);
        sizes[i] = 0.0;
        for (Py_ssize_t j = 0; j < n; j++) sizes[i] += dot(R + j * n, R + j * n, chart->r);
    }
    return result(&all, 1);
}

/* All that a sampled controller reads: q (nq), v (n), kinematics; E and E^-1, rates, values of the outputs, status:
   only runs with 1 are measured. It becomes 0 where the general way has to decide. True if the kinematics are known. */
static int measured_known(Evaluator *ev, double *const *x)
{
    double *q = x[0], *v = x[1], *P = x[2], *F = x[3], *status = x[6];
    int ok = *status == 1.0 && !ev->external && !ev->external_vertical && factorize(ev, q, P, NULL, F);
    if (ok) ok = rates_with_C(ev, q, P, F, v, NULL, NULL, NULL, x[4]);
    if (ok > 0) values(ev, q, P, x[5]);
    *status = ok > 0;
    return ok < 0 ? -1 : 1;
}

static int measured_new(Evaluator *ev, double *const *x)
{ return take_position(ev, x[0], x[2]) ? measured_known(ev, x) : -1; }

static PyObject *measure(Evaluator *ev, PyObject *const *args, Py_ssize_t given)
{
    if (!expect(ev, given, 8)) return NULL;
    return args[7] == Py_True ? each_state(ev, args, 7, "qvPF!D!x!1!", measured_known)
                              : each_state(ev, args, 7, "qvP!F!D!x!1!", measured_new);
}

/* Tuple of evaluators; q (nq), y (s) and T (p), step, number of steps, kinematics at q or None; q and y at the end,
   status, roughness: where the status is 0, the others are undefined. Then of one run mu and its rates (2 m) at each
   half step, or None; damping (n) or None, entries of v with friction, and limits (B, rows) of these and of the inputs,
   or None without dissipation. With dissipation but without steps, y at the end starts with the generalized forces (n)
   of dry friction during the step, and is as long as these at least. */
static PyObject *integrate(Evaluator *ev, PyObject *const *args, Py_ssize_t given)
{
    Arrays all = {.count = -1}, one = {.count = 1}, listed = {.count = -1};
    double *q, *y, *T, *P, *q_end, *y_end, *status, *rough, *rates, *damping, *joints = NULL, *limits = NULL;
    Py_ssize_t s = 0, to = 0, n = ev->n, held = -1;
    Dissipation d = {.T = NULL};
    if (!expect(ev, given, 15) || (all.count = PyTuple_Size(args[0])) < 0) return NULL;
    double h = PyFloat_AsDouble(args[4]);
    Py_ssize_t steps = PyErr_Occurred() ? 0 : PyLong_AsSsize_t(args[5]);
    Py_ssize_t halves = within((long)steps, 1 << 20) ? 2 * steps + 1 : 0;
    int ok = -1, loses = args[14] != Py_None;
    if (!PyErr_Occurred() && take(&all, args[1], ev->nq, READ, &q) && take_rows(&all, args[2], 0, READ, &y, &s)
        && take(&all, args[3], ev->p, READ, &T) && optional(&all, args[6], kinematics_size(ev), &P)
        && take(&all, args[7], ev->nq, WRITE, &q_end) && take_rows(&all, args[8], 0, WRITE, &y_end, &to)
        && take(&all, args[9], 1, WRITE, &status) && take(&all, args[10], 1, WRITE, &rough)
        && optional(&all, args[11], halves * 2 * ev->m, &rates) && optional(&one, args[12], n, &damping)
        && (!loses || take(&listed, args[13], 1, READ, &joints))
        && (!loses || take_rows(&all, args[14], 0, READ, &limits, &d.rows))) {
        d.damping = damping, d.joints = joints, d.jointed = loses ? listed.count : 0;
        ok = (d.rows == d.jointed || d.rows == d.jointed + ev->p) && (steps || !loses ? to == s : to >= n) ? 1 : -1;
        for (Py_ssize_t j = 0; j < d.jointed; j++)
            if (!(joints[j] >= 0 && joints[j] < n)) ok = -1;
        if (ok < 0) PyErr_SetString(PyExc_ValueError, "kernel: rows of friction do not fit");
    }
    for (Py_ssize_t i = 0; i < all.count && ok > 0; i++, q_end += ev->nq, y_end += to, y += s, T += ev->p) {
        Evaluator *chart = of_run(ev, args[0], i);
        int done = chart && chart->fused && !chart->external_vertical && chart->curved && s == integrated(chart)
                   && all_finite(T, ev->p) && !chart->timed == !rates
                   && (!rates || (chart == ev && chart->mu && !loses));
        if (PyErr_Occurred()) ok = -1;
        if (done && loses && s != held) { /* charts of one reduction have equal sizes */
            free(all.memory);
            if (!dissipation_memory(chart, &d, &all.memory)) ok = -1;
            held = s;
        }
        const double *known = P ? P + i * kinematics_size(ev) : NULL;
        rough[i] = 0.0, d.T = T, d.limits = loses ? limits + i * d.rows : NULL;
        d.located = d.biased = 0, d.kinematics = known;
        memcpy(q_end, q + i * ev->nq, (size_t)ev->nq * sizeof(double));
        if (steps || !loses) memcpy(y_end, y, (size_t)s * sizeof(double));
        for (Py_ssize_t j = 0; j < steps && ok > 0 && done > 0; j++)
            done = loses ? dissipative_step(chart, &d, q_end, y_end, h, rough + i)
                         : step(chart, T, h, j ? NULL : known, rates ? rates + j * 4 * ev->m : NULL, q_end, y_end,
                                rough + i, NULL);
        if (loses && !steps && ok > 0 && done > 0 && (done = begin(chart, &d, q_end, y, h)) > 0) {
            memset(y_end, 0, (size_t)n * sizeof(double));
            for (Py_ssize_t j = 0; j < d.rows; j++) add(y_end, d.forces[j], d.J + j * n, n);
        }
        if (done < 0) ok = -1;
        status[i] = done > 0;
    }
    close_arrays(&one), close_arrays(&listed);
    return result(&all, ok);
}
