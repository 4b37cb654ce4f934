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

/* Slopes of a row W (V - G) of one frame, with the velocity G of the ground's material; origin: acceleration of the
   frame's origin. A rotation of the frame turns its directions, and their rates. */
static void frame_slopes(const Row *row, const Motion *at, const double *origin, Slopes *out)
{
    Change *K = out->velocity, *G = out->acceleration;
    const Kind *kind = KINDS + row->kind;
    const double *w = at->V + 3, *spin = row->w + AT_GROUND + 3;
    double d[9], e[9], k[9], g[9], W[12], V[6], A[6], turned[3];
    const double *parameters = directions(row, at, d, e);
    memcpy(V, at->v, sizeof at->v), memcpy(V + 3, w, sizeof at->v);
    memcpy(A, origin, sizeof at->v), memcpy(A + 3, at->A + 3, sizeof at->v);
    if (row->i[1]) { subtract(V, row->w + AT_GROUND, V, 6), add_cross(V, at->p, spin), add_cross(A, at->v, spin); }
    kind->rates(d, e, parameters, W, W + 6), kind->slopes(d, e, parameters, V, A, k, g);
    put(K->v, 1.0, W), put(K->w, 1.0, W + 3);
    put(G->a, 1.0, W), put(G->b, 1.0, W + 3), put(G->v, 1.0, W + 6), put(G->w, 1.0, W + 9);
    if (row->kind == CURVED) put(K->p, 1.0, k), put(G->p, 1.0, g), put(G->v, 1.0, k); /* of the place, not turning */
    else
        for (int i = 0; i < 3 * kind->directions; i += 3) {
            add_cross(K->s, d + i, k + i), add_cross(G->w, d + i, k + i);
            add_cross(g + i, k + i, w), add_cross(G->s, d + i, g + i);
        }
    if (!row->i[1]) return;
    cross(spin, W, turned);
    put(K->p, 1.0, turned), put(G->v, 1.0, turned), add_cross(G->p, spin, W + 6);
}

/* Slopes of a distance with respect to the vector from the first to the second frame, its rate and its second rate */
static void slopes_of_distance(const double *vector, const double *first, const double *second, Slopes *out)
{
    double k[3], g[3], W[12], V[6] = {first[0], first[1], first[2]}, A[6] = {second[0], second[1], second[2]};
    KINDS[DISTANCE].rates(vector, first, NULL, W, W + 6), KINDS[DISTANCE].slopes(vector, first, NULL, V, A, k, g);
    for (int side = 0; side < 2; side++) {
        double sign = side ? 1.0 : -1.0;
        Change *K = out->velocity + side, *G = out->acceleration + side;
        put(K->p, sign, k), put(K->v, sign, W);
        put(G->p, sign, g), put(G->v, sign, W + 6), put(G->v, sign, k), put(G->a, sign, W);
    }
}

/* Rows on ground that frame b carries. The relative motion of a is, in the axes of b, with d = p_a - p_b and e = v_a -
   v_b,

       d,   u = e - w_b x d,   o = w_a - w_b,   a_a - a_b - b_b x d - w_b x (e + u),   b_a - b_b - w_b x o.

   Slopes with respect to it, inner, become those with respect to the motion of both frames. Slopes of a velocity need
   no accelerations, NULL. */
static void carry(const Change *inner, const Motion *a, const Motion *b, const double *relative_acceleration,
                  const double *relative_turning, Change out[2])
{
    const double *w = b->V + 3, *turning = b->A + 3;
    double d[3], e[3], u[3], o[3], both[3], s[3], p[3], v[3], g[3], a_[3], b_[3], h[3], t[3];
    Change *on_a = out, *on_b = out + 1;
    subtract(a->p, b->p, d, 3), subtract(a->v, b->v, e, 3), subtract(a->V + 3, w, o, 3);
    memcpy(u, e, sizeof u), add_cross(u, d, w);
    turn(b->R, inner->s, s), turn(b->R, inner->p, p), turn(b->R, inner->v, v), turn(b->R, inner->w, g);
    add_cross(on_b->s, p, d), add_cross(on_b->s, v, u), add_cross(on_b->s, g, o);
    if (relative_acceleration) {
        turn(b->R, inner->a, a_), turn(b->R, inner->b, b_);
        for (int i = 0; i < 3; i++) both[i] = e[i] + u[i];
        add_cross(on_b->s, a_, relative_acceleration), add_cross(on_b->s, b_, relative_turning);
        add_cross(on_b->w, a_, both), add_cross(on_b->w, b_, o), add_cross(on_b->b, a_, d);
        cross(turning, a_, t), add(p, 1.0, t, 3);
        cross(w, b_, t), add(g, 1.0, t, 3);
        cross(w, a_, h), add(v, 1.0, h, 3); /* of e and once more of u, in the acceleration */
        put(on_a->a, 1.0, a_), put(on_a->b, 1.0, b_), put(on_b->a, -1.0, a_), put(on_b->b, -1.0, b_);
    }
    cross(w, v, t), add(p, 1.0, t, 3); /* v has all factors of u */
    add_cross(on_b->w, v, d);
    if (relative_acceleration) add(v, 1.0, h, 3);
    put(on_a->s, 1.0, s), put(on_a->p, 1.0, p), put(on_a->v, 1.0, v), put(on_a->w, 1.0, g);
    put(on_b->s, -1.0, s), put(on_b->p, -1.0, p), put(on_b->v, -1.0, v), put(on_b->w, -1.0, g);
}

static void carried_slopes(const Row *row, const Motion *a, const Motion *b, Slopes *out)
{
    Motion local;
    Slopes inner;
    double origin[3], acceleration[3], turning[3];
    relative(a, b, 2, &local);
    memcpy(origin, local.A, sizeof origin);
    add_cross(origin, local.A + 3, local.p), add_cross(origin, local.V + 3, local.v);
    turn(b->R, origin, acceleration), turn(b->R, local.A + 3, turning);
    memset(&inner, 0, sizeof inner);
    frame_slopes(row, &local, origin, &inner);
    carry(inner.velocity, a, b, NULL, NULL, out->velocity);
    carry(inner.acceleration, a, b, acceleration, turning, out->acceleration);
}

/* Slopes of a row that consists of wrenches; false for other rows. origins: accelerations of the frames' origins */
static int row_slopes(const Evaluator *ev, const double *origins, const Row *row, Slopes *out)
{
    if (!sides_of(row)) return 0;
    const Motion *a = ev->motion + row->a, *b = ev->motion + (row->b < 0 ? row->a : row->b);
    const double *origin = origins + 3 * row->a;
    memset(out, 0, sizeof *out);
    if (sides_of(row) == 1) frame_slopes(row, a, origin, out);
    else if (row->kind == DISTANCE) {
        double vector[3], first[3], second[3];
        subtract(b->p, a->p, vector, 3), subtract(b->v, a->v, first, 3),
            subtract(origins + 3 * row->b, origin, second, 3);
        slopes_of_distance(vector, first, second, out);
    } else carried_slopes(row, a, b, out);
    return 1;
}
