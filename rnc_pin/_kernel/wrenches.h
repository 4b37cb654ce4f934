/* Wrenches of the rows on their frames; a part of kernel.c. Their formulas are generated from those in Python.

   A row on ground that a frame carries is a function of the motion of frame a relative to frame b, the carrier, in the
   axes of b; see relative_rows.py. Its wrench acts on a, and its opposite on b. */

static void turn_back(const double *R, const double *x, double *out) /* R^T x */
{
    for (int i = 0; i < 3; i++) out[i] = R[i] * x[0] + R[3 + i] * x[1] + R[6 + i] * x[2];
}

enum { BALL_AXIS = 4 };          /* place of the axis of the ground in the numbers of a ball on curved ground */
static const double LEANS = 0.9; /* as in constraints/rolling_body.py */

/* For a ball on curved ground: the vector from the axis of the ground to the frame, and the direction whose projection
   is the first axis of the contact: the axis of a cylinder; for a sphere x, or y where the normal is near x. */
static void from_axis(const Row *row, const Motion *at, double *d, double *e)
{
    const double *axis = row->w + BALL_AXIS;
    subtract(at->p, row->w, d, 3);
    int sphere = !(axis[0] || axis[1] || axis[2]), other = d[0] * d[0] > LEANS * LEANS * dot(d, d, 3);
    for (int i = 0; i < 3; i++) d[3 + i] = sphere ? i == other : axis[i];
    if (!e) return;
    memcpy(e, at->v, sizeof at->v), memset(e + 3, 0, sizeof at->v);
}

/* Directions d of a row that its frame carries, and their rates e unless NULL: three are the axes of the frame, fewer
   are in the numbers of the row. Returns the parameters of the row. */
static const double *directions(const Row *row, const Motion *at, double *d, double *e)
{
    int count = KINDS[row->kind].directions;
    if (row->kind == CURVED) {
        from_axis(row, at, d, e);
        return row->w + 3;
    }
    for (int i = 0; i < count; i++) {
        if (count == 3)
            for (int j = 0; j < 3; j++) d[3 * i + j] = at->R[3 * j + i];
        else turn(at->R, row->w + 3 * i, d + 3 * i);
        if (e) cross(at->V + 3, d + 3 * i, e + 3 * i);
    }
    return count == 3 ? row->w : row->w + 3 * count;
}

/* Wrench of a row at the origin of its frame, with its rate if asked for; false where it is not defined. */
static int at_frame(const Row *row, const Motion *at, int with_rate, Wrench *out)
{
    double d[9], e[9];
    const Kind *kind = KINDS + row->kind;
    const double *parameters = directions(row, at, d, with_rate ? e : NULL);
    memcpy(out->p, at->p, sizeof out->p);
    if (!with_rate) return kind->wrench(d, parameters, out->W) >= kind->least;
    memcpy(out->pd, at->v, sizeof out->pd);
    kind->rates(d, e, parameters, out->W, out->Wd);
    return 1;
}

/* Motion of a relative to b up to an order: 0 for the place, 1 for velocities, 2 for accelerations too. The twist is
   about the origin of b. */
static void relative(const Motion *a, const Motion *b, int order, Motion *out)
{
    double V[6], A[6], turned[6], d[3];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            out->R[3 * i + j] = b->R[i] * a->R[j] + b->R[3 + i] * a->R[3 + j] + b->R[6 + i] * a->R[6 + j];
    subtract(a->p, b->p, d, 3);
    turn_back(b->R, d, out->p);
    if (order < 1) return;
    subtract(a->V, b->V, V, 6), memcpy(turned, V, sizeof V), add_cross(turned, V + 3, b->p);
    turn_back(b->R, turned, out->V), turn_back(b->R, V + 3, out->V + 3);
    memcpy(out->v, out->V, sizeof out->v), add_cross(out->v, out->V + 3, out->p);
    if (order < 2) return;
    subtract(a->A, b->A, A, 6), cross_motion(b->V, V, turned), add(A, -1.0, turned, 6);
    add_cross(A, A + 3, b->p);
    turn_back(b->R, A, out->A), turn_back(b->R, A + 3, out->A + 3);
}

/* A wrench in the axes of the carrier b, with its rate if asked for, in the world. */
static void to_world(const Wrench *own, const Motion *b, int with_rate, Wrench *out)
{
    double arm[3], moved[3];
    const double *w = b->V + 3;
    turn(b->R, own->p, arm), turn(b->R, own->W, out->W), turn(b->R, own->W + 3, out->W + 3);
    for (int i = 0; i < 3; i++) out->p[i] = b->p[i] + arm[i];
    if (!with_rate) return;
    turn(b->R, own->pd, moved), turn(b->R, own->Wd, out->Wd), turn(b->R, own->Wd + 3, out->Wd + 3);
    for (int i = 0; i < 3; i++) out->pd[i] = b->v[i] + moved[i];
    add_cross(out->pd, w, arm), add_cross(out->Wd, w, out->W), add_cross(out->Wd + 3, w, out->W + 3);
}

static void reverse(Wrench *out, const Wrench *from, int with_rate)
{
    memcpy(out->p, from->p, sizeof from->p);
    for (int i = 0; i < 6; i++) out->W[i] = -from->W[i];
    if (!with_rate) return;
    memcpy(out->pd, from->pd, sizeof from->pd);
    for (int i = 0; i < 6; i++) out->Wd[i] = -from->Wd[i];
}

/* Number of frames of a row that consists of wrenches; 0 for other rows */
static int sides_of(const Row *row) { return row->kind < WORLD ? 0 : row->b < 0 ? 1 : 2; }

/* Wrenches of a row on its frames, on b first if there are two, with their rates if asked for; returns their number, 0
   for a row that is not defined here, -1 for other rows. Only wrenches without rates tell whether they are defined. */
static int wrenches(Evaluator *ev, const Row *row, int with_rates, Wrench out[2])
{
    int sides = sides_of(row);
    if (!sides) return -1;
    const Motion *a = ev->motion + row->a;
    out[sides - 1].joint = ev->frame[row->a].joint;
    if (sides == 1) return at_frame(row, a, with_rates, out);
    const Motion *b = ev->motion + row->b;
    out[0].joint = ev->frame[row->b].joint;
    if (row->kind == DISTANCE) {
        double d[3], rate[3];
        subtract(b->p, a->p, d, 3), subtract(b->v, a->v, rate, 3);
        memcpy(out->p, b->p, sizeof out->p), memcpy(out->pd, b->v, sizeof out->pd);
        if (!with_rates) {
            if (!(KINDS[DISTANCE].wrench(d, NULL, out->W) >= KINDS[DISTANCE].least)) return 0;
        } else KINDS[DISTANCE].rates(d, rate, NULL, out->W, out->Wd);
        reverse(out + 1, out, with_rates);
        memcpy(out[1].p, a->p, sizeof out->p), memcpy(out[1].pd, a->v, sizeof out->pd);
    } else {
        Motion local;
        Wrench own;
        relative(a, b, with_rates, &local);
        if (!at_frame(row, &local, with_rates, &own)) return 0;
        to_world(&own, b, with_rates, out + 1);
        reverse(out, out + 1, with_rates);
    }
    return 2;
}

static void about_origin(const Wrench *of, double *W)
{
    memcpy(W, of->W, sizeof of->W);
    add_cross(W + 3, of->p, W);
}

static void rate_about_origin(const Wrench *of, double *W)
{
    memcpy(W, of->Wd, sizeof of->Wd);
    add_cross(W + 3, of->p, W), add_cross(W + 3, of->pd, of->W);
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
