/* Wrenches of the rows on their frames; a part of kernel.c. Their formulas are generated from those in Python.

   A row on ground that a frame carries is a function of the motion of frame a relative to frame b, the carrier, in the
   axes of b; see relative_rows.py. Its wrench acts on a, and its opposite on b. */

static void turn_back(const double *R, const double *x, double *out) /* R^T x */
{
    for (int i = 0; i < 3; i++) out[i] = R[i] * x[0] + R[3 + i] * x[1] + R[6 + i] * x[2];
}

/* Directions d of a row that its frame carries, and their rates e: three are the axes of the frame, fewer are in the
   numbers of the row. Returns the parameters of the row. */
static const double *directions(const Row *row, const Motion *at, double d[9], double e[9])
{
    int count = KINDS[row->kind].directions;
    for (int i = 0; i < count; i++) {
        if (count == 3)
            for (int j = 0; j < 3; j++) d[3 * i + j] = at->R[3 * j + i];
        else turn(at->R, row->w + 3 * i, d + 3 * i);
        cross(at->V + 3, d + 3 * i, e + 3 * i);
    }
    return count == 3 ? row->w : row->w + 3 * count;
}

/* Wrench of a row at the origin of its frame; false where it is not defined. */
static int at_frame(const Row *row, const Motion *at, Wrench *out)
{
    double d[9], e[9];
    const Kind *kind = KINDS + row->kind;
    const double *parameters = directions(row, at, d, e);
    memcpy(out->p, at->p, sizeof out->p);
    memcpy(out->pd, at->v, sizeof out->pd);
    return kind->wrench(d, e, parameters, out->f, out->fd) >= kind->least; /* m follows f */
}

/* Motion of a relative to b. The twist is about the origin of b. */
static void relative(const Motion *a, const Motion *b, Motion *out)
{
    double V[6], A[6], turned[6], d[3];
    subtract(a->V, b->V, V, 6), subtract(a->A, b->A, A, 6), subtract(a->p, b->p, d, 3);
    cross_motion(b->V, V, turned);
    add(A, -1.0, turned, 6);
    add_cross(V, V + 3, b->p), add_cross(A, A + 3, b->p);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            out->R[3 * i + j] = b->R[i] * a->R[j] + b->R[3 + i] * a->R[3 + j] + b->R[6 + i] * a->R[6 + j];
    for (int half = 0; half < 6; half += 3)
        turn_back(b->R, V + half, out->V + half), turn_back(b->R, A + half, out->A + half);
    turn_back(b->R, d, out->p);
    memcpy(out->v, out->V, sizeof out->v);
    add_cross(out->v, out->V + 3, out->p);
}

/* A wrench in the axes of the carrier b, and its rate, in the world. */
static void to_world(const Wrench *own, const Motion *b, Wrench *out)
{
    double arm[3], moved[3];
    const double *w = b->V + 3;
    turn(b->R, own->p, arm), turn(b->R, own->pd, moved);
    for (int i = 0; i < 3; i++) out->p[i] = b->p[i] + arm[i], out->pd[i] = b->v[i] + moved[i];
    add_cross(out->pd, w, arm);
    turn(b->R, own->f, out->f), turn(b->R, own->m, out->m);
    turn(b->R, own->fd, out->fd), turn(b->R, own->md, out->md);
    add_cross(out->fd, w, out->f), add_cross(out->md, w, out->m);
}

static void reverse(Wrench *out, const Wrench *from)
{
    memcpy(out->p, from->p, sizeof(double) * 18);
    for (int i = 0; i < 3; i++) {
        out->f[i] = -from->f[i], out->m[i] = -from->m[i];
        out->fd[i] = -from->fd[i], out->md[i] = -from->md[i];
    }
}

/* Number of frames of a row that consists of wrenches; 0 for other rows */
static int sides_of(const Row *row) { return row->kind < WORLD ? 0 : row->b < 0 ? 1 : 2; }

/* Wrenches of a row on its frames, on b first if there are two; returns their number, 0 for a row that is not defined
   here, -1 for other rows. */
static int wrenches(Evaluator *ev, const Row *row, Wrench out[2])
{
    int sides = sides_of(row);
    if (!sides) return -1;
    const Motion *a = ev->motion + row->a;
    out[sides - 1].joint = ev->frame[row->a].joint;
    if (sides == 1) return at_frame(row, a, out);
    const Motion *b = ev->motion + row->b;
    out[0].joint = ev->frame[row->b].joint;
    if (row->kind == DISTANCE) {
        double d[3], rate[3];
        subtract(b->p, a->p, d, 3), subtract(b->v, a->v, rate, 3);
        memcpy(out->p, b->p, sizeof out->p), memcpy(out->pd, b->v, sizeof out->pd);
        if (!(KINDS[DISTANCE].wrench(d, rate, NULL, out->f, out->fd) >= TOGETHER)) return 0;
        reverse(out + 1, out);
        memcpy(out[1].p, a->p, sizeof out->p), memcpy(out[1].pd, a->v, sizeof out->pd);
    } else {
        Motion local;
        Wrench own;
        relative(a, b, &local);
        if (!at_frame(row, &local, &own)) return 0;
        to_world(&own, b, out + 1);
        reverse(out, out + 1);
    }
    return 2;
}

static void about_origin(const Wrench *of, double *W)
{
    memcpy(W, of->f, 3 * sizeof(double));
    cross(of->p, of->f, W + 3);
    for (int i = 0; i < 3; i++) W[3 + i] += of->m[i];
}

static void rate_about_origin(const Wrench *of, double *W)
{
    double moved[3];
    memcpy(W, of->fd, 3 * sizeof(double));
    cross(of->p, of->fd, W + 3);
    cross(of->pd, of->f, moved);
    for (int i = 0; i < 3; i++) W[3 + i] += of->md[i] + moved[i];
}

static int on_moving_ground(const Row *row) { return row->kind >= WORLD && row->i[1]; }

/* Velocity mu of the ground's material along a row with a wrench on one frame, and its rate. */
static double slide(const Row *row, const Wrench *on)
{
    double W[6];
    about_origin(on, W);
    return dot(W, row->w + AT_GROUND, 6);
}

static double slide_rate(const Row *row, const Wrench *on)
{
    double W[6];
    rate_about_origin(on, W);
    return dot(W, row->w + AT_GROUND, 6);
}
