/* Slopes of rows: derivatives of a row's velocity W^T V, and of its acceleration, with respect to the motion of its
   frames. A part of derivatives.h, which has the variations of this motion. */

/* Motion of a frame, or slopes with respect to it: rotation, place, velocity and angular velocity, accelerations */
typedef struct {
    double s[3], p[3], v[3], w[3], a[3], b[3];
} Change;

enum { CHANGE = sizeof(Change) / sizeof(double), UP_TO_VELOCITY = 12, FROM_VELOCITY = 6 };

/* Slopes of a row and of its acceleration, with respect to the motion of its first and second frame. */
typedef struct {
    Change velocity[2], acceleration[2];
} Slopes;

static void put(double *to, double factor, const double *x) { add(to, factor, x, 3); }

/* Force f and torque m that are fixed in a frame that turns at t, on a motion u, w with acceleration du, dw. k and s:
   slopes of velocity and acceleration with respect to the frame's rotation; k also with respect to t; fd, md: rates */
static void turn_along(const double *f, const double *m, const double *u, const double *w, const double *du,
                       const double *dw, const double *t, double *k, double *s, double *fd, double *md)
{
    double part[3];
    cross(t, f, fd), cross(t, m, md);
    cross(f, u, k), add_cross(k, m, w);
    cross(f, du, s), add_cross(s, m, dw);
    cross(u, t, part), add_cross(s, f, part);
    cross(w, t, part), add_cross(s, m, part);
}

/* Slopes of a row that depends on a direction d, its rate and its second rate: g[0:3], g[3:6] and g[6:9] of the
   acceleration, g[9:12] and g[12:15] of the velocity with respect to d and its rate */
static void of_direction(const Motion *at, const double *d, const double *g, Slopes *out)
{
    Change *K = out->velocity, *G = out->acceleration;
    const double *w = at->V + 3, *b = at->A + 3, *g2 = g + 6;
    double rate[3], whole[3];
    cross(w, d, rate);
    memcpy(whole, g + 9, sizeof whole);
    add_cross(whole, g + 12, w);
    cross(d, whole, K->s);
    cross(d, g + 12, K->w);
    memcpy(whole, g + 3, sizeof whole);
    add_cross(whole, g2, w);
    cross(rate, g2, G->w);
    add_cross(G->w, d, whole);
    double place[3] = {g[0], g[1], g[2]};
    add_cross(place, g2, b);
    add_cross(place, whole, w);
    cross(d, place, G->s);
    cross(d, g2, G->b);
}

static void angle_slopes(const Row *row, const Motion *at, Slopes *out)
{
    double d[3] = {at->R[row->i[0]], at->R[3 + row->i[0]], at->R[6 + row->i[0]]}, d1[3], d2[3], g[15] = {0.0};
    cross(at->V + 3, d, d1);
    cross(at->A + 3, d, d2);
    add_cross(d2, at->V + 3, d1);
    double x = d[0], y = d[1], z = d[2], q = x * x + y * y, l = sqrt(q);
    if (row->kind == YAW) {
        double c = x * d2[1] - y * d2[0], h = x * d1[1] - y * d1[0], r = 2 * (x * d1[0] + y * d1[1]), qq = q * q;
        g[0] = d2[1] / q - 2 * x * c / qq - (d1[1] * r + 2 * h * d1[0]) / qq + 4 * x * h * r / (qq * q);
        g[1] = -d2[0] / q - 2 * y * c / qq - (-d1[0] * r + 2 * h * d1[1]) / qq + 4 * y * h * r / (qq * q);
        g[3] = (y * r - 2 * h * x) / qq;
        g[4] = (-x * r - 2 * h * y) / qq;
        g[6] = g[12] = -y / q;
        g[7] = g[13] = x / q;
        g[9] = d1[1] / q - 2 * h * x / qq;
        g[10] = -d1[0] / q - 2 * h * y / qq;
    } else {
        double cube = q * l, fall = d2[2] / cube + 3 * z * d1[2] * d1[2] / (cube * q);
        g[0] = -x * fall, g[1] = -y * fall;
        g[2] = d1[2] * d1[2] / cube;
        g[5] = 2 * z * d1[2] / cube;
        g[8] = g[14] = 1.0 / l;
        g[9] = -x * d1[2] / cube, g[10] = -y * d1[2] / cube;
    }
    of_direction(at, d, g, out);
}

/* Gradient with respect to the axle of the wheel's row on a motion (u, w). The heading h and the side c turn at the
   gradient of their angle, which is -h / s. */
static void axle_gradient(const Row *row, const double *h, const double *c, const double *turn_by, double z,
                          const double *u, const double *w, double *out)
{
    double r = row->w[0], c0 = row->w[4], c1 = row->w[5], c2 = row->w[6];
    double hw = dot(h, w, 2), k = c0 * dot(c, u, 2) - c1 * dot(h, u, 2) + r * c2 * z * dot(c, w, 2);
    out[0] = k * turn_by[0] - r * (c0 * w[0] + c1 * w[1]);
    out[1] = k * turn_by[1] + r * (c1 * w[0] - c0 * w[1]);
    out[2] = r * (c2 * hw - c0 * w[2]);
}

static void wheel_slopes(const Row *row, const Motion *at, const double *origin, Slopes *out)
{
    Change *K = out->velocity, *G = out->acceleration;
    Wrench now;
    double a[3], da[3], first[3], second[3];
    const double *w = at->V + 3, *u = at->v;
    along(&now, at);
    wheel(row, at, &now);
    turn(at->R, row->w + 1, a);
    cross(w, a, da);
    double r = row->w[0], c0 = row->w[4], c1 = row->w[5], c2 = row->w[6], z = a[2];
    double q = a[0] * a[0] + a[1] * a[1], s = sqrt(q), h[2] = {a[1] / s, -a[0] / s}, c[2] = {a[0] / s, a[1] / s};
    double turn_by[2] = {-a[1] / q, a[0] / q}, rate = dot(turn_by, da, 2), grows = 2 * dot(a, da, 2) / q;
    double turn_rate[2] = {-da[1] / q - turn_by[0] * grows, da[0] / q - turn_by[1] * grows};
    double hw = dot(h, w, 2), cw = dot(c, w, 2), hu = dot(h, u, 2), cu = dot(c, u, 2);
    double k = c0 * cu - c1 * hu + r * c2 * z * cw;
    double k_rate = -(c0 * hu + c1 * cu) * rate + r * c2 * (da[2] * cw - z * hw * rate);
    axle_gradient(row, h, c, turn_by, z, u, w, first);
    axle_gradient(row, h, c, turn_by, z, origin, at->A + 3, second);
    for (int i = 0; i < 2; i++) second[i] += k_rate * turn_by[i] + k * turn_rate[i];
    second[2] += r * c2 * cw * rate;
    add_cross(second, first, w);
    cross(a, first, K->s);
    put(K->v, 1.0, now.f), put(K->w, 1.0, now.m);
    cross(a, second, G->s);
    cross(a, first, G->w);
    put(G->v, 1.0, now.fd), put(G->w, 1.0, now.md), put(G->a, 1.0, now.f), put(G->b, 1.0, now.m);
}

static void wheel_slopes_on_plane(const Row *row, const Motion *at, const double *origin, Slopes *out)
{
    Motion local;
    double there[3];
    if (!row->i[0]) {
        wheel_slopes(row, at, origin, out);
        return;
    }
    to_plane(row, at, &local);
    turn(row->w + AT_PLANE, origin, there);
    wheel_slopes(row, &local, there, out);
    for (int i = 0; i < CHANGE; i += 3)
        from_plane(row, (double *)out->velocity + i), from_plane(row, (double *)out->acceleration + i);
}

/* out += arm x x + n x B x: the gradient of x . arm by the rotation */
static void by_rotation(const Contact *at, const double *n, const double *x, double *out)
{
    double spread[3];
    turn(at->spread, x, spread);
    add_cross(out, at->arm, x);
    add_cross(out, n, spread);
}

/* T(x, y), in world axes; see rolling.h */
static void bend(const Contact *of, const double *R, const double *x, const double *y, double *out)
{
    double a[3], b[3], Na[3], Nb[3], own[3];
    turn_back(R, x, a), turn_back(R, y, b);
    turn(of->N, a, Na), turn(of->N, b, Nb);
    double Pa = dot(of->P, a, 3), Pb = dot(of->P, b, 3), both = dot(a, Nb, 3);
    for (int i = 0; i < 3; i++) own[i] = -of->scale * (Na[i] * Pb + Nb[i] * Pa + of->P[i] * both) / of->l;
    turn(R, own, out);
}

/* Velocity f . (v + w x arm) less that of the ground, and acceleration f . (a + b x arm + w x arm') less its rate. With
   the arm's rate arm' = w x arm + B (w x n), its factor is e = f x w - f x W, where the ground turns at W. */
static void rolling_slopes(const Row *row, const Motion *at, Slopes *out)
{
    Change *K = out->velocity, *G = out->acceleration;
    const double *f = row->w, *n = row->w + AT_NORMAL, *w = at->V + 3, *b = at->A + 3;
    const double *W = row->w + AT_GROUND + 3; /* zero for ground at rest */
    Contact found;
    if (row->i[2]) {
        put(K->w, 1.0, n), put(G->b, 1.0, n);
        return;
    }
    touch(row, at, &found);
    double g[3], e[3], y[3], By[3], Be[3], x[3], rate[3], part[3];
    cross(f, W, g), cross(f, w, e), subtract(e, g, e, 3);
    cross(w, n, y);
    turn(found.spread, y, By), turn(found.spread, e, Be);
    memcpy(rate, By, sizeof rate), add_cross(rate, w, found.arm);
    put(K->v, 1.0, f), put(K->p, -1.0, g);
    cross(found.arm, f, K->w);
    by_rotation(&found, n, e, K->s);
    put(G->a, 1.0, f), put(G->v, -1.0, g);
    cross(found.arm, f, G->b);
    cross(rate, f, G->w);
    by_rotation(&found, n, e, G->w);
    cross(f, b, x), add_cross(x, e, w);
    by_rotation(&found, n, x, G->s);
    add_cross(G->s, By, e), add_cross(G->s, Be, y);
    bend(&found, at->R, e, y, part);
    add_cross(G->s, n, part);
}

/* Slopes with respect to a vector from the first to the second frame, its rate and its second rate. */
static void of_vector(Change *out, const double *e, const double *e1, const double *e2)
{
    for (int side = 0; side < 2; side++) {
        double sign = side ? 1.0 : -1.0;
        put(out[side].p, sign, e);
        put(out[side].v, sign, e1);
        if (e2) put(out[side].a, sign, e2);
    }
}

static void distance_slopes(const double *e, const double *e1, const double *e2, Slopes *out)
{
    double l = sqrt(dot(e, e, 3)), cube = l * l * l, rate = dot(e, e1, 3), square = dot(e1, e1, 3) + dot(e, e2, 3);
    double g[3], g1[3], g2[3], k[3];
    for (int i = 0; i < 3; i++) {
        g2[i] = e[i] / l;
        k[i] = e1[i] / l - rate * e[i] / cube;
        g1[i] = 2 * k[i];
        g[i] = (e2[i] - square * e[i] / (l * l) - 2 * rate * e1[i] / (l * l) + 3 * rate * rate * e[i] / (cube * l)) / l;
    }
    of_vector(out->velocity, k, g2, NULL);
    of_vector(out->acceleration, g, g1, g2);
}

/* The motion of b relative to a, in the axes of a: of the origin of a (CLOSURE) or of b (POINT), which is on the body
   of the other frame, x: its velocity there is the rate of e less the rotation of x. */
static void closure_slopes(const Row *row, const Motion *a, const Motion *b, const double *e, const double *e1,
                           const double *e2, Slopes *out)
{
    static const double none[3] = {0.0, 0.0, 0.0};
    double form[3], w[3], dw[3], k[3], s[3], fd[3], md[3];
    const double *t = a->V + 3;
    Change *K = out->velocity, *G = out->acceleration;
    for (int j = 0; j < 3; j++) form[j] = a->R[3 * j + row->i[0] % 3];
    if (row->i[0] >= 3) {
        subtract(b->V + 3, t, w, 3), subtract(b->A + 3, a->A + 3, dw, 3);
        turn_along(none, form, none, w, none, dw, t, k, s, fd, md);
        for (int side = 0; side < 2; side++) {
            double sign = side ? 1.0 : -1.0;
            put(K[side].w, sign, form), put(G[side].w, sign, md), put(G[side].b, sign, form);
        }
    } else {
        int side = row->kind == CLOSURE;
        const double *wx = (side ? b : a)->V + 3, *bx = (side ? b : a)->A + 3;
        double u[3], du[3], p0[3], p1[3], v1[3], arm[3];
        cross(e, wx, u), put(u, 1.0, e1);
        cross(e, bx, du), add_cross(du, e1, wx), put(du, 1.0, e2);
        turn_along(form, none, u, none, du, none, t, k, s, fd, md);
        cross(wx, form, p0);
        of_vector(K, p0, form, NULL);
        cross(form, e, arm);
        put(K[side].w, 1.0, arm), put(G[side].b, 1.0, arm);
        cross(wx, fd, p1), add_cross(p1, bx, form);
        memcpy(v1, fd, sizeof v1), put(v1, 1.0, p0);
        of_vector(G, p1, v1, form);
        add_cross(G[side].w, fd, e), add_cross(G[side].w, form, e1);
    }
    put(K[0].s, 1.0, k), put(G[0].s, 1.0, s), put(G[0].w, 1.0, k);
}

/* Knife edges: a force f and a torque m that are fixed in the frame */
static void own_slopes(const Row *row, const Motion *at, const double *origin, Slopes *out)
{
    Change *K = out->velocity, *G = out->acceleration;
    double f[3], m[3], k[3], s[3], fd[3], md[3];
    turn(at->R, row->w, f), turn(at->R, row->w + 3, m);
    turn_along(f, m, at->v, at->V + 3, origin, at->A + 3, at->V + 3, k, s, fd, md);
    put(K->s, 1.0, k), put(K->v, 1.0, f), put(K->w, 1.0, m);
    put(G->s, 1.0, s), put(G->v, 1.0, fd), put(G->w, 1.0, md), put(G->w, 1.0, k);
    put(G->a, 1.0, f), put(G->b, 1.0, m);
}

/* Wheels and knife edges: a row is the same function of the motion relative to the ground, whose material has the
   constant twist G = (U, W). With the velocity v of the origin p and its acceleration a, angular w and b, the relative
   motion is

       v - U - W x p,   w - W,   a - W x (2 v - U - W x p),   b - W x w. */
static int slopes_on_moving_ground(const Row *row, const Motion *at, Slopes *out)
{
    Motion relative = *at;
    Change *K = out->velocity, *G = out->acceleration;
    const double *ground = row->w + AT_GROUND, *W = ground + 3;
    double carried[6], origin[3], g[3], twice[3];
    subtract(at->V, ground, relative.V, 6);
    cross_motion(ground, at->V, carried);
    subtract(at->A, carried, relative.A, 6);
    memcpy(relative.v, relative.V, sizeof relative.v), add_cross(relative.v, relative.V + 3, at->p);
    memcpy(origin, relative.A, sizeof origin), add_cross(origin, relative.A + 3, at->p);
    add_cross(origin, relative.V + 3, relative.v);
    memset(out, 0, sizeof *out);
    if (row->kind == OWN) own_slopes(row, &relative, origin, out);
    else wheel_slopes_on_plane(row, &relative, origin, out);
    add_cross(K->p, W, K->v);
    cross(W, G->a, g), cross(W, g, twice);
    put(G->p, 1.0, twice), add_cross(G->p, W, G->v);
    put(G->v, 2.0, g), add_cross(G->w, W, G->b);
    return 1;
}

/* Rows on ground that frame b carries. The relative motion of a is, in the axes of b, with d = p_a - p_b and e = v_a -
   v_b,

       d,   u = e - w_b x d,   o = w_a - w_b,   a_a - a_b - b_b x d - w_b x (e + u),   b_a - b_b - w_b x o.

   Slopes with respect to it, inner, become those with respect to the motion of both frames. */
static void carry(const Change *inner, const Motion *a, const Motion *b, const double *relative_acceleration,
                  const double *relative_turning, Change out[2])
{
    const double *w = b->V + 3, *turning = b->A + 3;
    double d[3], e[3], u[3], o[3], both[3], s[3], p[3], v[3], g[3], a_[3], b_[3], h[3], t[3];
    subtract(a->p, b->p, d, 3), subtract(a->v, b->v, e, 3), subtract(a->V + 3, w, o, 3);
    memcpy(u, e, sizeof u), add_cross(u, d, w);
    for (int i = 0; i < 3; i++) both[i] = e[i] + u[i];
    turn(b->R, inner->s, s), turn(b->R, inner->p, p), turn(b->R, inner->v, v);
    turn(b->R, inner->w, g), turn(b->R, inner->a, a_), turn(b->R, inner->b, b_);
    Change *on_b = out + 1;
    add_cross(on_b->s, p, d), add_cross(on_b->s, v, u), add_cross(on_b->s, g, o);
    add_cross(on_b->s, a_, relative_acceleration), add_cross(on_b->s, b_, relative_turning);
    cross(w, a_, h);   /* of e and once more of u, in the acceleration */
    add(v, 1.0, h, 3); /* all factors of u */
    cross(w, v, t), add(p, 1.0, t, 3);
    add_cross(on_b->w, v, d);
    cross(turning, a_, t), add(p, 1.0, t, 3);
    add_cross(on_b->w, a_, both), add_cross(on_b->w, b_, o);
    add_cross(on_b->b, a_, d);
    add(v, 1.0, h, 3);
    cross(w, b_, t), add(g, 1.0, t, 3);
    for (int side = 0; side < 2; side++) {
        double sign = side ? -1.0 : 1.0;
        put(out[side].s, sign, s), put(out[side].p, sign, p), put(out[side].v, sign, v);
        put(out[side].w, sign, g), put(out[side].a, sign, a_), put(out[side].b, sign, b_);
    }
}

/* Slopes of a row of one frame on ground at rest; origin: acceleration of the frame's origin */
static void one_sided_slopes(const Row *row, const Motion *at, const double *origin, Slopes *out)
{
    Change *K = out->velocity, *G = out->acceleration;
    switch (row->kind) {
    case WORLD:
        put(K->v, 1.0, row->w), put(K->w, 1.0, row->w + 3), put(G->a, 1.0, row->w), put(G->b, 1.0, row->w + 3);
        return;
    case OWN: own_slopes(row, at, origin, out); return;
    case WHEEL: wheel_slopes_on_plane(row, at, origin, out); return;
    case ROLLING: rolling_slopes(row, at, out); return;
    default: angle_slopes(row, at, out);
    }
}

static void carried_slopes(const Row *row, const Motion *a, const Motion *b, Slopes *out)
{
    Motion local;
    Slopes inner;
    double origin[3], acceleration[3], turning[3];
    relative(a, b, &local);
    memcpy(origin, local.A, sizeof origin);
    add_cross(origin, local.A + 3, local.p), add_cross(origin, local.V + 3, local.v);
    turn(b->R, origin, acceleration), turn(b->R, local.A + 3, turning);
    memset(&inner, 0, sizeof inner);
    one_sided_slopes(row, &local, origin, &inner);
    carry(&inner.velocity[0], a, b, acceleration, turning, out->velocity);
    carry(&inner.acceleration[0], a, b, acceleration, turning, out->acceleration);
}

/* Slopes of a row that consists of wrenches; false for other rows. origins: accelerations of the frames' origins */
static int row_slopes(const Evaluator *ev, const double *origins, const Row *row, Slopes *out)
{
    if (!sides_of(row)) return 0;
    const Motion *a = ev->motion + row->a;
    const double *origin = origins + 3 * row->a;
    if (on_moving_ground(row) && row->kind != ROLLING) return slopes_on_moving_ground(row, a, out);
    memset(out, 0, sizeof *out);
    if (sides_of(row) == 1) {
        one_sided_slopes(row, a, origin, out);
        return 1;
    }
    const Motion *b = ev->motion + row->b;
    if (is_carried(row)) {
        carried_slopes(row, a, b, out);
        return 1;
    }
    double e[3], e1[3], e2[3];
    subtract(b->p, a->p, e, 3), subtract(b->v, a->v, e1, 3), subtract(origins + 3 * row->b, origin, e2, 3);
    if (row->kind == DISTANCE) distance_slopes(e, e1, e2, out);
    else closure_slopes(row, a, b, e, e1, e2, out);
    return 1;
}
