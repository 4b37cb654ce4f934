/* All that a sampled controller reads at one state, in one call. Included at the end of kernel.c. */

static Py_ssize_t measured_size(const Evaluator *ev)
{ return kinematics_size(ev) + 2 * ev->n * ev->n + rates_size(ev) + ev->r + ev->k; }

/* E and E^-1, rates, and values of the outputs at one state with kinematics P. 0: the general way has to decide; -1: an
 * error */
static int measured(Evaluator *ev, const double *q, const double *v, const double *P, double *F, double *D, double *x)
{
    if (ev->external || ev->external_vertical || !factorize(ev, q, P, NULL, F)) return 0;
    take_state(ev, q, v);
    if (ev->rates_need_C && !called(ev, P_C, 1)) return -1;
    if (!rates(ev, q, P, F, v, NULL, NULL, NULL, D, ev->scratch)) return 0;
    values(ev, q, P, x);
    return 1;
}

/* q, v, record of kinematics, E and E^-1, rates, and values of the outputs. False if the general way has to decide. */
static PyObject *measure(Evaluator *ev, PyObject *const *args, Py_ssize_t given)
{
    Arrays all = {.count = 1};
    double *q, *v, *P;
    int ok = -1;
    if (expect(ev, given, 3) && take(&all, args[0], ev->nq, READ, &q) && take(&all, args[1], ev->n, READ, &v)
        && take(&all, args[2], measured_size(ev), WRITE, &P)) {
        double *F = P + kinematics_size(ev), *D = F + 2 * ev->n * ev->n, *x = D + rates_size(ev);
        ok = take_position(ev, q, P) ? measured(ev, q, v, P, F, D, x) : -1;
    }
    return result(&all, ok);
}

/* Record that starts with E (or with J1 if True), True or False, v, record of E v (n) or J1 v (k), with the bits of the
 * rates. */
static PyObject *row_velocities(Evaluator *ev, PyObject *const *args, Py_ssize_t given)
{
    Arrays all = {.count = -1};
    double *rows, *v, *out;
    int ok = -1, of_J1 = given > 1 && args[1] == Py_True;
    Py_ssize_t n = ev->n, count = of_J1 ? ev->k : n, size = of_J1 ? ev->k * (n + ev->r) : 2 * n * n;
    if (expect(ev, given, 4) && take(&all, args[0], size, READ, &rows) && take(&all, args[2], n, READ, &v)
        && take(&all, args[3], count, WRITE, &out)) {
        ok = 1;
        for (Py_ssize_t i = 0; i < all.count; i++, v += n, rows += size)
            for (Py_ssize_t j = 0; j < count; j++) *out++ = dot(rows + j * n, v, n);
    }
    return result(&all, ok);
}
