/* Steps of plants with viscous damping and dry friction: the formulas of plants/friction.py and of
   model/integrators.py (ExponentialRungeKutta4). Included in kernel.c.

   A step declines (0) where the general way has to decide: rows of the user, constraints over time, steps that leave
   the chart, and forces of friction that the inertia does not determine. */

#define AT_REST 1e-9    /* speed that counts as rest, relative to the speed that friction removes in the step */
#define RANK 1e-12      /* relative size of what is rounding */
#define SHORT_STOP 1e-6 /* time to rest below which a row counts as stopped, relative to the step */
#define PIVOTS 8        /* turns of a search for the rows that stick */

typedef struct {
    const double *T, *damping, *joints, *limits; /* inputs (p); coefficients (n) or NULL; entries of v; (rows) */
    Py_ssize_t jointed, rows, size;              /* joints, then inputs; numbers of a state (u, a, other integrals) */
    double *J, *along, *moved, *gram;            /* rows (rows, n); J R and H^-1 (J R)^T (rows, r); (rows, rows) */
    double *H, *modes, *inverse, *decay;         /* (r, r); linear part, as LinearPart: w = modes a, a = inverse w */
    double *follow;                              /* rates of u and of the other integrals per mode (size - r, r) */
    double *speeds, *forces, *stops, *now, *wanted, *shares, *slope; /* (rows) */
    double *bias, *basis, *a, *growth;                               /* (rows), (r, rows), (r), (5, r) twice */
    double *rest, *which, *slides;           /* 1 for rows: that stick at the end, that are to stop, that slide */
    double *x, *at, *y, *q, *flows, *stages; /* (size), (size), y (s), (nq), (size), work */
    double *inputs, *external, *B;           /* inputs (p) and generalized forces (n) with friction; (n, p) */
    double *at_q, *at_v2;                    /* state (nq), (r) whose position and biases are in scratch */
    int located, biased;                     /* whether they are */
    const double *kinematics;                /* those at the start of the run, or NULL */
} Dissipation;

/* Pointers into memory; false with an error */
static int dissipation_memory(const Evaluator *ev, Dissipation *d, void **memory)
{
    Py_ssize_t n = ev->n, r = ev->r, k = d->rows, size = d->size = n + integrated(ev), rr = r * r;
    return allocate(memory, &d->J, k * n, &d->along, k * r, &d->moved, k * r, &d->gram, k * k, &d->H, rr, &d->modes, rr,
                    &d->inverse, rr, &d->decay, r, &d->follow, (size - r) * r, &d->speeds, k, &d->forces, k, &d->stops,
                    k, &d->now, k, &d->wanted, k, &d->shares, k, &d->slope, k, &d->bias, k, &d->basis, r * k, &d->a, r,
                    &d->growth, 10 * r, &d->rest, k, &d->which, k, &d->slides, k, &d->x, size, &d->at, size, &d->y,
                    size, &d->q, ev->nq, &d->flows, size, &d->stages, 8 * size + k * (k + 1), &d->inputs, ev->p,
                    &d->external, n, &d->B, n * ev->p, &d->at_q, ev->nq, &d->at_v2, r, NULL);
}

/* The position, E and its inverse at q, in scratch, and the rows with friction */
static int locate(Evaluator *ev, Dissipation *d, const double *q)
{
    Py_ssize_t n = ev->n;
    double *P = ev->scratch + ev->work;
    if (d->located && !memcmp(d->at_q, q, (size_t)ev->nq * sizeof(double))) return 1;
    d->located = d->biased = 0;
    if (d->kinematics) memcpy(P, d->kinematics, (size_t)kinematics_size(ev) * sizeof(double));
    else if (!take_position(ev, q, P)) return -1;
    d->kinematics = NULL;
    if (!factorize(ev, q, P, NULL, P + kinematics_size(ev))) return 0;
    memcpy(d->at_q, q, (size_t)ev->nq * sizeof(double));
    d->located = 1;
    memset(d->J, 0, (size_t)(d->rows * n) * sizeof(double));
    for (Py_ssize_t i = 0; i < d->jointed; i++) d->J[i * n + (Py_ssize_t)d->joints[i]] = 1.0;
    if (d->rows == d->jointed) return 1;
    input_matrix(ev, q, P, d->B, ev->scratch);
    for (Py_ssize_t i = 0; i < ev->p; i++)
        for (Py_ssize_t j = 0; j < n; j++) d->J[(d->jointed + i) * n + j] = d->B[j * ev->p + i];
    return 1;
}

/* The state derivative at q, which is located */
static int rates_of(Evaluator *ev, Dissipation *d, const double *q, const double *v2, const double *T,
                    const double *further, double *out)
{
    int same = d->biased && !memcmp(d->at_v2, v2, (size_t)ev->r * sizeof(double));
    int ok = rates_here(ev, q, v2, T, further, d->damping, same, out);
    d->biased = ok > 0;
    memcpy(d->at_v2, v2, (size_t)ev->r * sizeof(double));
    return ok;
}

/* Solve A x = b for symmetric positive semidefinite A (k, k), in place, without square roots. Dependent rows get zero;
   their number is returned. */
static Py_ssize_t solve_semidefinite(double *A, double *x, Py_ssize_t k)
{
    Py_ssize_t dependent = 0;
    double largest = 0.0;
    for (Py_ssize_t i = 0; i < k; i++) largest = fmax(largest, A[i * k + i]);
    for (Py_ssize_t i = 0; i < k; i++) {
        if (!(A[i * k + i] > RANK * largest)) {
            A[i * k + i] = 0.0, dependent++;
            continue;
        }
        for (Py_ssize_t j = i + 1; j < k; j++) {
            double factor = A[j * k + i] / A[i * k + i];
            add(A + j * k + i, -factor, A + i * k + i, k - i);
            x[j] -= factor * x[i];
        }
    }
    for (Py_ssize_t i = k - 1; i >= 0; i--) {
        for (Py_ssize_t j = i + 1; j < k; j++) x[i] -= A[i * k + j] * x[j];
        x[i] = A[i * k + i] > 0.0 ? x[i] / A[i * k + i] : 0.0;
    }
    return dependent;
}

/* Velocities v2 after impulses that stop the rows of a mask; the kinetic energy that they change, into gain. The state
   is located. */
static int stop_rows(Evaluator *ev, Dissipation *d, const double *mask, double *v2, double *gain)
{
    Py_ssize_t n = ev->n, r = ev->r, k = 0;
    const double *P = ev->scratch + ev->work, *F = P + kinematics_size(ev), *R = F + n * n + ev->m;
    double *v = ev->scratch, *work = v + n, *impulse = d->wanted;
    velocity(ev, F, ev->mu, v2, v);
    for (Py_ssize_t i = 0; i < d->rows; i++) {
        if (mask[i] == 0.0) continue;
        multiply(d->J + i * n, n, R, n, d->along + k * r, 1, n, r);
        impulse[k++] = dot(d->J + i * n, v, n);
    }
    if (!k) return 1;
    inertia(ev, P, F, d->H, work);
    for (Py_ssize_t i = 0; i < k; i++) {
        memcpy(d->moved + i * r, d->along + i * r, (size_t)r * sizeof(double));
        if (!solve_positive_definite(d->H, d->moved + i * r, work, r)) return 0;
    }
    for (Py_ssize_t i = 0; i < k; i++)
        for (Py_ssize_t j = 0; j < k; j++) d->gram[i * k + j] = dot(d->along + i * r, d->moved + j * r, r);
    if (solve_semidefinite(d->gram, impulse, k) && ev->mu) return 0;
    for (int after = 0; after < 2; after++) {
        for (Py_ssize_t i = 0; gain && i < n; i++) *gain += (after ? 0.5 : -0.5) * v[i] * dot(P + i * n, v, n);
        for (Py_ssize_t i = 0; !after && i < k; i++) add(v2, -impulse[i], d->moved + i * r, r);
        velocity(ev, F, ev->mu, v2, v);
    }
    return 1;
}

/* y at q with the rows of a mask at rest; the lost kinetic energy is work of friction. */
static int stopped(Evaluator *ev, Dissipation *d, const double *q, const double *mask, double *y)
{
    double any = 0.0;
    for (Py_ssize_t i = 0; i < d->rows; i++) any += mask[i];
    int ok = any == 0.0 ? 1 : locate(ev, d, q);
    return ok <= 0 || any == 0.0 ? ok : stop_rows(ev, d, mask, y, y + integrated(ev) - 1);
}

/* ------------------------------------------------------------------ linear part */

/* phi_0 to phi_last of t times minus the decays, (last + 1, r): see phi_functions */
static void phi_functions(const double *decay, double t, int last, double *values, Py_ssize_t r)
{
    double factorial[6] = {1, 1, 2, 6, 24, 120};
    for (Py_ssize_t i = 0; i < r; i++) {
        double x = -t * decay[i], value = 0.0;
        if (x < -1.0) {
            values[i] = value = exp(x);
            for (int k = 0; k < last; k++) values[(k + 1) * r + i] = value = (value - 1.0 / factorial[k]) / x;
            continue;
        }
        for (int k = 17; k > 0; k--) value = (value + 1.0) * x / (last + k);
        values[last * r + i] = value = (value + 1.0) / factorial[last];
        for (int k = last - 1; k >= 0; k--) values[k * r + i] = value = x * value + 1.0 / factorial[k];
    }
}

/* Modes at the state of the last derivative, whose rates are in x; their decays, and what they drive. */
static int linear_part(Evaluator *ev, Dissipation *d)
{
    Py_ssize_t n = ev->n, r = ev->r, k = ev->k;
    const double *P = ev->scratch + ev->work, *F = P + kinematics_size(ev), *S = F + 2 * n * n + n;
    const double *H = S + 4 * n, *R = F + n * n + ev->m, *v = d->x, *v2_dot = v + n;
    double *L = ev->scratch, *A = L + r * r, *V = d->H, *row = V;
    if (!cholesky(H, 1, r, L, r)) return 0;
    memset(d->decay, 0, (size_t)r * sizeof(double));
    memset(V, 0, (size_t)(r * r) * sizeof(double));
    for (Py_ssize_t i = 0; i < r; i++) V[i * r + i] = 1.0;
    for (Py_ssize_t l = 0; l < n && d->damping; l++)
        if (d->damping[l] < 0.0) return 0;
    if (d->damping) { /* eigenvectors of A A^T with A = L^-1 R^T damping^(1/2) (r, n) */
        for (Py_ssize_t i = 0; i < r; i++) {
            for (Py_ssize_t l = 0; l < n; l++) A[i * n + l] = sqrt(d->damping[l]) * R[l * n + i];
            for (Py_ssize_t j = 0; j < i; j++) add(A + i * n, -L[i * r + j], A + j * n, n);
            for (Py_ssize_t l = 0; l < n; l++) A[i * n + l] /= L[i * r + i];
        }
        orthogonalize(A, n, V, r, r);
        for (Py_ssize_t i = 0; i < r; i++) d->decay[i] = dot(A + i * n, A + i * n, n);
    }
    for (Py_ssize_t i = 0; i < r; i++) { /* inverse = V L^T, and modes = L^-T V^T */
        for (Py_ssize_t j = 0; j < r; j++) {
            d->inverse[i * r + j] = 0.0;
            for (Py_ssize_t l = 0; l <= j; l++) d->inverse[i * r + j] += V[i * r + l] * L[j * r + l];
        }
        for (Py_ssize_t j = r - 1; j >= 0; j--) {
            double rest = V[i * r + j];
            for (Py_ssize_t l = j + 1; l < r; l++) rest -= L[l * r + j] * d->modes[l * r + i];
            d->modes[j * r + i] = rest / L[j * r + j];
        }
    }
    if (!d->damping) return 1;
    multiply(R, n, d->modes, r, d->follow, n, r, r);
    double *others = d->follow + n * r, *force = ev->scratch;
    for (Py_ssize_t j = 0; j < k; j++) {
        row = ev->force_row;
        if (!assemble(ev, d->q, P, NULL, n + j, n + j + 1, row)) return 0;
        multiply(row, n, d->follow, r, others + j * r, 1, n, r);
    }
    input_force(ev, d->q, P, d->T, force, force + n);
    for (Py_ssize_t j = 0; j < n; j++) force[j] -= d->damping[j] * v[j];
    multiply(force, n, d->follow, r, others + k * r, 1, n, r); /* power minus the rate of kinetic energy */
    for (Py_ssize_t i = 0; i < r; i++) others[k * r + i] -= dot(d->inverse + i * r, v2_dot, r);
    return 1;
}

/* ------------------------------------------------------------------ friction */

/* Shares in [-1, 1] that minimize x^T gram x / 2 + x^T wanted, by block principal pivoting; 0 if none are found */
static int pivoted(Dissipation *d, double *work)
{
    Py_ssize_t k = d->rows;
    double *is_free = d->slides, *x = d->shares, *wanted = d->wanted, *slope = d->slope, *own = work + k * k;
    for (Py_ssize_t i = 0; i < k; i++) {
        is_free[i] = wanted[i] == 0.0;
        x[i] = wanted[i] > 0.0 ? -1.0 : wanted[i] < 0.0 ? 1.0 : 0.0;
    }
    for (int turn_number = 0; turn_number < PIVOTS; turn_number++) {
        Py_ssize_t count = 0, place_of = 0;
        for (Py_ssize_t i = 0; i < k; i++) count += is_free[i] != 0.0;
        for (Py_ssize_t i = 0, a = 0; i < k; i++) {
            if (is_free[i] == 0.0) continue;
            own[a] = -wanted[i];
            for (Py_ssize_t j = 0, b = 0; j < k; j++)
                if (is_free[j] != 0.0) work[a * count + b++] = d->gram[i * k + j];
                else own[a] -= d->gram[i * k + j] * x[j];
            a++;
        }
        if (solve_semidefinite(work, own, count)) return 0;
        for (Py_ssize_t i = 0; i < k; i++)
            if (is_free[i] != 0.0) x[i] = own[place_of++];
        int optimal = 1;
        for (Py_ssize_t i = 0; i < k; i++) {
            slope[i] = dot(d->gram + i * k, x, k) + wanted[i];
            if (is_free[i] != 0.0 && !(fabs(slope[i]) <= RANK * (1.0 + fabs(wanted[i])))) return 0;
        }
        for (Py_ssize_t i = 0; i < k; i++) {
            if (is_free[i] != 0.0 && !(fabs(x[i]) < 1.0)) {
                is_free[i] = 0.0, optimal = 0;
                x[i] = x[i] > 0.0 ? 1.0 : -1.0;
            } else if (is_free[i] == 0.0 && x[i] * slope[i] > 0.0) is_free[i] = 1.0, optimal = 0;
        }
        if (optimal) return 1;
    }
    return 0;
}

/* Speed of a row after a time t while rows slide with accelerations a of the modes; rows of modes are in along */
static double speed_after(const Evaluator *ev, Dissipation *d, Py_ssize_t row, double t)
{
    double rate = d->bias[row], *growth = d->growth + 5 * ev->r;
    phi_functions(d->decay, t, 1, growth, ev->r);
    for (Py_ssize_t i = 0; i < ev->r; i++) rate += d->along[row * ev->r + i] * growth[ev->r + i] * d->a[i];
    return d->speeds[row] + t * rate;
}

/* Time in (0, h) at which a row comes to rest, by the method of Illinois */
static double stopping_time(const Evaluator *ev, Dissipation *d, Py_ssize_t row, double h, double at_h)
{
    double low = 0.0, high = h, at_low = d->speeds[row], at_high = at_h;
    int side = 0;
    for (int i = 0; i < 100 && high - low > 1e-14 * h; i++) {
        double t = (low * at_high - high * at_low) / (at_high - at_low), now;
        if (!d->damping) return t;
        now = speed_after(ev, d, row, t);
        if (now == 0.0) return t;
        if (now * at_high > 0.0) {
            high = t, at_high = now;
            if (side == -1) at_low *= 0.5;
            side = -1;
        } else {
            low = t, at_low = now;
            if (side == 1) at_high *= 0.5;
            side = 1;
        }
    }
    return 0.5 * (low + high);
}

/* Forces of friction during h: DryFriction.forces_in_step. The rows and the linear part are those of the last
   derivative, whose rates are in x. */
static int friction_in_step(Evaluator *ev, Dissipation *d, double h)
{
    Py_ssize_t n = ev->n, r = ev->r, k = d->rows;
    const double *P = ev->scratch + ev->work, *F = P + kinematics_size(ev), *S = F + 2 * n * n + n;
    const double *R = F + n * n + ev->m, *v = d->x, *v2_dot = v + n, *solved = S + 2 * n;
    double *growth = d->growth, size = 0.0, *row = d->stages;
    phi_functions(d->decay, h, 1, growth, r);
    growth += r;
    for (Py_ssize_t i = 0; i < r; i++) d->a[i] = dot(d->inverse + i * r, v2_dot, r);
    for (Py_ssize_t j = 0; j < k; j++) {
        multiply(d->J + j * n, n, R, n, row, 1, n, r);
        multiply(row, r, d->modes, r, d->along + j * r, 1, r, r);
        d->speeds[j] = dot(d->J + j * n, v, n);
        d->bias[j] = -dot(d->J + j * n, solved, n); /* the rows rotate relative to the chart */
        double rate = d->bias[j];
        for (Py_ssize_t i = 0; i < r; i++) {
            rate += d->along[j * r + i] * growth[i] * d->a[i];
            d->basis[i * k + j] = sqrt(growth[i]) * d->along[j * r + i];
            size = fmax(size, fabs(d->basis[i * k + j] * d->limits[j]));
        }
        d->now[j] = d->speeds[j] + h * rate;
        d->rest[j] = 0.0;
        d->forces[j] = d->now[j] > 0.0 ? -d->limits[j] : d->now[j] < 0.0 ? d->limits[j] : 0.0;
    }
    if (size > 0.0) {
        for (Py_ssize_t i = 0; i < k; i++) {
            d->wanted[i] = d->now[i] / h * d->limits[i] / (size * size);
            for (Py_ssize_t j = 0; j < k; j++) {
                double sum = 0.0;
                for (Py_ssize_t l = 0; l < r; l++)
                    sum += (d->basis[l * k + i] * d->limits[i] / size) * (d->basis[l * k + j] * d->limits[j] / size);
                d->gram[i * k + j] = sum;
            }
        }
        if (!pivoted(d, d->stages + r)) return 0;
        for (Py_ssize_t j = 0; j < k; j++) {
            d->forces[j] = d->shares[j] * d->limits[j];
            d->rest[j] = fabs(d->shares[j]) < 1.0;
        }
    }
    for (Py_ssize_t j = 0; j < k; j++) {
        double removable = 0.0;
        for (Py_ssize_t i = 0; i < r; i++) removable += d->basis[i * k + j] * d->basis[i * k + j];
        d->slides[j] = !(fabs(d->speeds[j]) <= AT_REST * h * removable * d->limits[j]);
        double opposing = d->slides[j] == 0.0 ? d->forces[j] : -copysign(d->limits[j], d->speeds[j]);
        for (Py_ssize_t i = 0; i < r; i++) d->a[i] += d->along[j * r + i] * opposing;
    }
    for (Py_ssize_t j = 0; j < k; j++) {
        d->stops[j] = d->slides[j] != 0.0 && d->rest[j] != 0.0 ? h : INFINITY;
        if (d->slides[j] == 0.0) continue;
        double at_h = speed_after(ev, d, j, h);
        if (d->speeds[j] * at_h < 0.0) d->stops[j] = stopping_time(ev, d, j, h, at_h);
    }
    return 1;
}

/* ------------------------------------------------------------------ a step without events */

/* Rates at x = (u, a, others) less the linear ones, which go into flows; sticking: mask of rows that stay at rest */
static int bent_rates(Evaluator *ev, Dissipation *d, const double *q, const double *x, const double *sticking,
                      double *out)
{
    Py_ssize_t n = ev->n, r = ev->r, size = d->size, s = size - n;
    double *y = d->y;
    if (!(dot(x, x, n) < FARTHEST)) return 0;
    memcpy(y, x + n, (size_t)s * sizeof(double));
    if (d->damping) multiply(d->modes, r, x + n, 1, y, r, r, 1);
    if (!displace(ev, q, x, d->q)) return -1;
    int ok = locate(ev, d, d->q);
    if (ok > 0 && sticking) ok = stop_rows(ev, d, sticking, y, NULL);
    if (ok > 0) ok = rates_of(ev, d, d->q, y, d->inputs, d->external, out);
    if (ok <= 0) return ok;
    coordinate_rates(ev, x, out);
    memset(d->flows, 0, (size_t)size * sizeof(double));
    if (!d->damping) return 1;
    memcpy(y, out + n, (size_t)r * sizeof(double));
    multiply(d->inverse, r, y, 1, out + n, r, r, 1);
    out[size - 1] -= dot(x + n, out + n, r); /* the rate of the kinetic energy of the frozen inertia */
    multiply(d->follow, r, x + n, 1, d->flows, n, r, 1);
    for (Py_ssize_t i = 0; i < r; i++) d->flows[n + i] = -d->decay[i] * x[n + i];
    multiply(d->follow + n * r, r, x + n, 1, d->flows + n + r, s - r, r, 1);
    add(out, -1.0, d->flows, size);
    return 1;
}

/* out += t phi_k(t L) x, with the phi functions of the decays over t */
static void add_phi(const Evaluator *ev, Dissipation *d, int k, const double *values, double t, const double *x,
                    double *out)
{
    static const double factorial[4] = {1, 1, 2, 6};
    Py_ssize_t n = ev->n, r = ev->r, size = d->size;
    for (Py_ssize_t i = 0; i < size; i++)
        out[i] += i < n || i >= n + r ? t * x[i] / factorial[k] : t * values[k * r + i - n] * x[i];
    for (Py_ssize_t i = 0; d->damping && i < size - r; i++) {
        double sum = 0.0;
        for (Py_ssize_t j = 0; j < r; j++) sum += d->follow[i * r + j] * values[(k + 1) * r + j] * x[n + j];
        out[i < n ? i : i + r] += t * t * sum;
    }
}

/* q and y after h, of a motion with constant forces of friction: ExponentialRungeKutta4, which without damping is the
   classical method in the velocities themselves */
static int smooth_step(Evaluator *ev, Dissipation *d, double *q, double *y, const double *sticking, double h,
                       double *rough)
{
    Py_ssize_t n = ev->n, r = ev->r, size = d->size, s = size - n;
    size_t bytes = (size_t)size * sizeof(double);
    double *x = d->x, *at = d->at, *N = d->stages, *N_a = N + size, *N_b = N_a + size, *N_c = N_b + size;
    double *first = N_c + size, *at_a = first + size, *flows = at_a + size, *sum = flows + size;
    double *half = d->growth, *whole = half + 5 * r, largest = 0.0;
    int ok;
    memset(x, 0, (size_t)n * sizeof(double));
    memcpy(x + n, y, (size_t)s * sizeof(double));
    if (d->damping) {
        multiply(d->inverse, r, y, 1, x + n, r, r, 1);
        x[size - 1] -= 0.5 * dot(x + n, x + n, r);
    }
    phi_functions(d->decay, 0.5 * h, 2, half, r);
    phi_functions(d->decay, h, 4, whole, r);
    if ((ok = bent_rates(ev, d, q, x, sticking, N)) <= 0) return ok;
    memcpy(flows, d->flows, bytes);
    for (Py_ssize_t i = 0; i < size; i++) first[i] = N[i] + flows[i];
    memcpy(at_a, x, bytes);
    add_phi(ev, d, 1, half, 0.5 * h, first, at_a);
    if ((ok = bent_rates(ev, d, q, at_a, sticking, N_a)) <= 0) return ok;
    for (Py_ssize_t i = 0; i < size; i++) sum[i] = flows[i] + N_a[i];
    memcpy(flows, d->flows, bytes);
    memcpy(at, x, bytes);
    add_phi(ev, d, 1, half, 0.5 * h, sum, at);
    if ((ok = bent_rates(ev, d, q, at, sticking, N_b)) <= 0) return ok;
    for (Py_ssize_t i = 0; i < size; i++) sum[i] = flows[i] + 2.0 * N_b[i] - N[i];
    memcpy(at, at_a, bytes);
    add_phi(ev, d, 1, half, 0.5 * h, sum, at);
    if ((ok = bent_rates(ev, d, q, at, sticking, N_c)) <= 0) return ok;
    add_phi(ev, d, 1, whole, h, first, x);
    for (Py_ssize_t i = 0; i < size; i++) sum[i] = 2.0 * (N_a[i] + N_b[i]) - 3.0 * N[i] - N_c[i];
    add_phi(ev, d, 2, whole, h, sum, x);
    for (Py_ssize_t i = 0; i < size; i++) {
        double bent = N[i] - N_a[i] - N_b[i] + N_c[i];
        sum[i] = 4.0 * bent;
        if (i < n + r) largest = fmax(largest, fmax(fabs(N_b[i] - N_a[i]), fabs(bent)));
    }
    add_phi(ev, d, 3, whole, h, sum, x);
    if (!(dot(x, x, n) < FARTHEST)) return 0;
    if (!displace(ev, q, x, d->q)) return -1;
    memcpy(q, d->q, (size_t)ev->nq * sizeof(double));
    memcpy(y, x + n, (size_t)s * sizeof(double));
    if (d->damping) {
        multiply(d->modes, r, x + n, 1, y, r, r, 1);
        y[s - 1] += 0.5 * dot(x + n, x + n, r);
    }
    *rough += h * largest;
    return 1;
}

/* The same with given forces of friction, and the rows of a mask at rest before, during and after it */
static int slide_step(Evaluator *ev, Dissipation *d, double *q, double *y, const double *forces, const double *sticking,
                      double h, double *rough)
{
    memcpy(d->inputs, d->T, (size_t)ev->p * sizeof(double));
    for (Py_ssize_t i = 0; i < d->rows; i++)
        if (i < d->jointed) d->external[(Py_ssize_t)d->joints[i]] = forces[i];
        else d->inputs[i - d->jointed] += forces[i];
    int ok = stopped(ev, d, q, sticking, y);
    if (ok > 0) ok = smooth_step(ev, d, q, y, d->rows ? sticking : NULL, h, rough);
    return ok > 0 ? stopped(ev, d, q, sticking, y) : ok;
}

/* ------------------------------------------------------------------ whole steps */

/* The rates at (q, y) without dry friction, the linear part, and the friction during h */
static int begin(Evaluator *ev, Dissipation *d, const double *q, const double *y, double h)
{
    int ok = locate(ev, d, q);
    memcpy(d->q, q, (size_t)ev->nq * sizeof(double));
    if (ok > 0) ok = rates_of(ev, d, q, y, d->T, NULL, d->x);
    if (ok > 0) ok = linear_part(ev, d);
    return ok > 0 ? friction_in_step(ev, d, h) : ok;
}

/* One step: DissipativeStep.advance */
static int dissipative_step(Evaluator *ev, Dissipation *d, double *q, double *y, double h, double *rough)
{
    double remaining = h;
    for (Py_ssize_t events = 2 * d->rows;; events--) {
        double first = INFINITY;
        int ok = begin(ev, d, q, y, remaining);
        if (ok <= 0) return ok;
        for (Py_ssize_t i = 0; i < d->rows; i++) first = fmin(first, d->stops[i]);
        int at_the_end = remaining <= first && first < INFINITY;
        if (!events || (first >= remaining && !at_the_end))
            return slide_step(ev, d, q, y, d->forces, d->rest, remaining, rough);
        *rough = INFINITY;
        for (Py_ssize_t i = 0; i < d->rows; i++) {
            int goes_on = isinf(d->stops[i]);
            d->now[i] = goes_on ? d->rest[i] : 0.0; /* rows that rest during the whole step */
            d->which[i] = at_the_end ? d->rest[i] : goes_on ? d->now[i] : d->stops[i] <= (1.0 + SHORT_STOP) * first;
            if (!goes_on) d->forces[i] = -copysign(d->limits[i], d->speeds[i]);
        }
        first = fmin(first, remaining);
        if (at_the_end || first >= SHORT_STOP * h) {
            ok = slide_step(ev, d, q, y, d->forces, d->now, first, rough);
            remaining -= first;
        }
        if (ok > 0) ok = stopped(ev, d, q, d->which, y);
        if (ok <= 0 || at_the_end) return ok;
    }
}
