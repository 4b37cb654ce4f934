/* Rotation vectors of orientations; see coordinates.py, which has the formulas. Included in laws.h. */

#define SMALL_ANGLE 1e-2 /* [rad] below which quotients are taken from their series */

static void quaternion(const double *r, double *out) /* real part first */
{
    double u = sqrt(dot(r, r, 3)), scale = u < SMALL_ANGLE ? 0.5 - u * u / 48 + u * u * u * u / 3840 : sin(0.5 * u) / u;
    out[0] = cos(0.5 * u);
    for (int i = 0; i < 3; i++) out[1 + i] = scale * r[i];
}

/* log(exp(goal) exp(here)^T) */
static void rotation_error(const double *goal, const double *here, double *out)
{
    double a[4], b[4], turned[3], real;
    quaternion(goal, a);
    quaternion(here, b);
    cross(a + 1, b + 1, turned);
    real = dot(a, b, 4);
    for (int i = 0; i < 3; i++) out[i] = b[0] * a[1 + i] - a[0] * b[1 + i] - turned[i];
    double sine = sqrt(dot(out, out, 3)), sign = real < 0.0 ? -1.0 : 1.0;
    double scale = sine > 0.0 ? sign * 2 * atan2(sine, sign * real) / sine : 0.0;
    for (int i = 0; i < 3; i++) out[i] *= scale;
}

/* J(e)^-1 wd - J(-e)^-1 w of an error e, with the angular velocities of goal and body */
static void rotation_error_rate(const double *e, const double *wd, const double *w, double *out)
{
    double square = dot(e, e, 3), half = 0.5 * sqrt(square), c = 0.0, sum[3], change[3], once[3], twice[3];
    if (square < 1.0)
        for (int k = 13; k >= 0; k--) c = c * square + BERNOULLI[k];
    else c = (1.0 - half / tan(half)) / square;
    for (int i = 0; i < 3; i++) sum[i] = wd[i] + w[i], change[i] = wd[i] - w[i];
    cross(e, change, once);
    cross(e, once, twice);
    cross(e, sum, once);
    for (int i = 0; i < 3; i++) out[i] = change[i] - 0.5 * once[i] + c * twice[i];
}

/* Angular velocity and acceleration for a rotation vector r with two derivatives, by the left Jacobian of SO(3) */
static void angular_rates(const double *r, const double *r_dot, const double *r_ddot, double *w, double *w_dot)
{
    double square = dot(r, r, 3), u = sqrt(square), a, b, a_dot, b_dot, along = dot(r, r_dot, 3);
    if (u < SMALL_ANGLE) {
        a = 1 / 2.0 - square / 24, b = 1 / 6.0 - square / 120;
        a_dot = -1 / 12.0 + square / 180, b_dot = -1 / 60.0 + square / 1260;
    } else {
        double sine = sin(u), cosine = cos(u);
        a = (1 - cosine) / square, b = (u - sine) / (square * u);
        a_dot = (sine / u - 2 * a) / square, b_dot = ((1 - cosine) / square - 3 * b) / square;
    }
    double by_v[3], twice_v[3], by_a[3], twice_a[3], turned[3]; /* products with r, and with r twice */
    cross(r, r_dot, by_v);
    cross(r, by_v, twice_v);
    cross(r, r_ddot, by_a);
    cross(r, by_a, twice_a);
    cross(r_dot, by_v, turned);
    for (int i = 0; i < 3; i++) {
        w[i] = r_dot[i] + a * by_v[i] + b * twice_v[i];
        w_dot[i] =
            r_ddot[i] + a * by_a[i] + b * twice_a[i] + b * turned[i] + along * (a_dot * by_v[i] + b_dot * twice_v[i]);
    }
}
