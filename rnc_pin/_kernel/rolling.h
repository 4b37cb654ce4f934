/* Bodies that roll on planes; a part of kernel.c, see rolling_body.py and rolling_wheel.py.

   A row of a body is a force f, constant in the world, at the contact point c = p + R point(-R^T n), which moves over the
   body. The plane has the normal n; its material moves at u + spin n x c. Of the body's surface, with its outward normal,

       B = R N R^T    is the derivative of the contact point by the normal, symmetric: arm' = w x arm + B (w x n),
       T(x, y)        the derivative of B y along x, less the part that turns with the body, symmetric too.

   Ellipsoid and torus have the same form: a unit-free point P = S d / l with l = sqrt(d S d), the part S of the semi-axes
   or of the directions across the axle. */

enum { ELLIPSOID, TORUS };
enum { AT_NORMAL = 3, AT_SHAPE = 6, AT_PLANE = 7, AT_SPIN = 16, AT_SLIDING = 17 }; /* places in the numbers of a row */

typedef struct {
    double arm[3], spread[9];      /* world axes */
    double P[3], N[9], l;          /* of the shape in its own axes */
    double scale;                  /* of the part that T belongs to */
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
            out->spread[3 * i + j] = at->R[3 * i] * columns[j] + at->R[3 * i + 1] * columns[3 + j] + at->R[3 * i + 2] * columns[6 + j];
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
        for (int j = 0; j < 3; j++) out->R[3 * i + j] = Q[3 * i] * at->R[j] + Q[3 * i + 1] * at->R[3 + j] + Q[3 * i + 2] * at->R[6 + j];
    for (int half = 0; half < 6; half += 3) turn(Q, at->V + half, out->V + half), turn(Q, at->A + half, out->A + half);
    turn(Q, at->p, out->p), turn(Q, at->v, out->v);
}

static void from_plane(const Row *row, double *x)
{
    double here[3] = {x[0], x[1], x[2]};
    turn_back(row->w + AT_PLANE, here, x);
}

/* Contact point of a wheel up to its height over the plane, and its rate. */
static void wheel_contact(const Row *row, const Motion *at, double *c, double *rate)
{
    Motion local;
    double a[3], da[3], r = row->w[0];
    to_plane(row, at, &local);
    turn(local.R, row->w + 1, a);
    cross(local.V + 3, a, da);
    double square = a[0] * a[0] + a[1] * a[1], s = sqrt(square), z = a[2], turned = (a[0] * da[1] - a[1] * da[0]) / square;
    c[0] = r * z * a[0] / s, c[1] = r * z * a[1] / s, c[2] = 0.0;
    rate[0] = r * (da[2] * a[0] - z * turned * a[1]) / s, rate[1] = r * (da[2] * a[1] + z * turned * a[0]) / s, rate[2] = 0.0;
    from_plane(row, c), from_plane(row, rate);
    for (int i = 0; i < 3; i++) c[i] += at->p[i], rate[i] += at->v[i];
}

static int on_moving_ground(const Row *row) { return (row->kind == WHEEL || row->kind == ROLLING) && row->i[1]; }

/* Velocity mu of the ground's material along a row, and its rate. */
static double slide(const Row *row, const Motion *at, const Wrench *on, double *rate)
{
    const double *n = row->kind == WHEEL ? row->w + AT_PLANE + 6 : row->w + AT_NORMAL;
    double spin = row->w[AT_SPIN], W[3] = {spin * n[0], spin * n[1], spin * n[2]}, c[3], cd[3], u[3], ud[3];
    *rate = 0.0;
    if (row->kind == ROLLING && row->i[2]) return spin;
    if (row->kind == WHEEL) wheel_contact(row, at, c, cd);
    else memcpy(c, on->p, sizeof c), memcpy(cd, on->pd, sizeof cd);
    memcpy(u, row->w + AT_SLIDING, sizeof u);
    add_cross(u, W, c);
    cross(W, cd, ud);
    *rate = dot(on->fd, u, 3) + dot(on->f, ud, 3);
    return dot(on->f, u, 3);
}
