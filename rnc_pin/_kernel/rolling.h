/* Bodies that roll, and wheels on planes; a part of kernel.c, see rolling_body.py and rolling_wheel.py.

   A row of a body is a force f, constant in the world, at the contact point c = p + R point(-R^T n), which moves over
   the body. The plane has the normal n. Of the body's surface, with its outward normal,

       B = R N R^T    is the derivative of the contact point by the normal, symmetric: arm' = w x arm + B (w x n),
       T(x, y)        the derivative of B y along x, less the part that turns with the body, symmetric too.

   Ellipsoid and torus have the same form: a unit-free point P = S d / l with l = sqrt(d S d), the part S of the
   semi-axes or of the directions across the axle. */

enum { ELLIPSOID, TORUS };
enum { AT_NORMAL = 3, AT_SHAPE = 6, AT_PLANE = 7 }; /* places in the numbers of a row */

typedef struct {
    double arm[3], spread[9]; /* world axes */
    double P[3], N[9], l;     /* of the shape in its own axes */
    double scale;             /* of the part that T belongs to */
} Contact;

static void turn_back(const double *R, const double *x, double *out) /* R^T x */
{
    for (int i = 0; i < 3; i++) out[i] = R[i] * x[0] + R[3 + i] * x[1] + R[6 + i] * x[2];
}

/* Point of the surface that touches the plane; false where it is not one point. */
static int touch(const Row *row, const Motion *at, Contact *out)
{
    const double *shape = row->w + AT_SHAPE, *n = row->w + AT_NORMAL;
    double d[3], S[3], point[3], columns[9], tube = 0.0;
    turn_back(at->R, n, d);
    for (int i = 0; i < 3; i++) {
        d[i] = -d[i];
        S[i] = row->i[0] == TORUS ? i != row->i[3] : shape[i];
    }
    double square = 0.0;
    for (int i = 0; i < 3; i++) square += S[i] * d[i] * d[i];
    double l = out->l = sqrt(square);
    out->scale = 1.0;
    if (row->i[0] == TORUS) {
        out->scale = shape[0], tube = shape[1];
        if (!(l >= FLAT)) return 0;
    }
    for (int i = 0; i < 3; i++) out->P[i] = S[i] * d[i] / l;
    for (int i = 0; i < 3; i++) {
        point[i] = out->scale * out->P[i] + tube * d[i];
        for (int j = 0; j < 3; j++) out->N[3 * i + j] = ((i == j ? S[i] : 0.0) - out->P[i] * out->P[j]) / l;
    }
    turn(at->R, point, out->arm);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            columns[3 * i + j] = 0.0;
            for (int k = 0; k < 3; k++)
                columns[3 * i + j] += (out->scale * out->N[3 * i + k] + (i == k ? tube : 0.0)) * at->R[3 * j + k];
        }
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            out->spread[3 * i + j] =
                at->R[3 * i] * columns[j] + at->R[3 * i + 1] * columns[3 + j] + at->R[3 * i + 2] * columns[6 + j];
    return 1;
}

/* Row of a rolling body: two along the plane and one across it, or the angular velocity about the normal. */
static int rolling(const Row *row, const Motion *at, Wrench *out)
{
    Contact found;
    double turning[3], moved[3];
    const double *w = at->V + 3, *n = row->w + AT_NORMAL;
    if (!touch(row, at, &found)) return 0;
    if (row->i[2]) {
        memcpy(out->m, n, 3 * sizeof(double));
        return 1;
    }
    cross(w, n, turning);
    turn(found.spread, turning, moved);
    add_cross(moved, w, found.arm);
    memcpy(out->f, row->w, 3 * sizeof(double));
    for (int i = 0; i < 3; i++) out->p[i] += found.arm[i], out->pd[i] += moved[i];
    return 1;
}

/* Motion as a wheel needs it, in the axes of its plane. */
static void to_plane(const Row *row, const Motion *at, Motion *out)
{
    const double *Q = row->w + AT_PLANE;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            out->R[3 * i + j] = Q[3 * i] * at->R[j] + Q[3 * i + 1] * at->R[3 + j] + Q[3 * i + 2] * at->R[6 + j];
    for (int half = 0; half < 6; half += 3) turn(Q, at->V + half, out->V + half), turn(Q, at->A + half, out->A + half);
    turn(Q, at->p, out->p), turn(Q, at->v, out->v);
}

static void from_plane(const Row *row, double *x)
{
    double here[3] = {x[0], x[1], x[2]};
    turn_back(row->w + AT_PLANE, here, x);
}
