/* Written by python -m tools.generate_rows from the formulas in Python: change those. */
/* clang-format off */

#define INTEGERS 8
#define NUMBERS 18
#define AT_GROUND 12
enum { CONSTANT = 0, EXTERNAL = 1, MOMENTUM = 2, ACKERMANN = 3, WORLD = 4, OWN = 5, WHEEL = 6, YAW = 7, TILT = 8, ROLLING = 9, DISTANCE = 10 };
enum { NO_VALUE = 0, JOINT = 1, CONTINUOUS_JOINT = 2, COORDINATE = 3, HEADING = 4, ELEVATION = 5, LENGTH = 6 };

typedef struct {
    int directions; /* number of its directions, whose parameters follow in the numbers of a row */
    double least;   /* length below which the wrench is not defined */
    double (*wrench)(const double *d, const double *e, const double *p, double *W, double *Wd); /* e: rates of d */
    void (*slopes)(const double *d, const double *e, const double *p, const double *V, const double *A, double *k,
                   double *g);
} Kind;

static double world_wrench(const double *d, const double *e, const double *p, double *W, double *Wd)
{
    (void)e;
    W[0] = p[0];
    W[1] = p[1];
    W[2] = p[2];
    W[3] = p[3];
    W[4] = p[4];
    W[5] = p[5];
    Wd[0] = 0.0;
    Wd[1] = 0.0;
    Wd[2] = 0.0;
    Wd[3] = 0.0;
    Wd[4] = 0.0;
    Wd[5] = 0.0;
    return 1.0;
}

static void world_slopes(const double *d, const double *e, const double *p, const double *V, const double *A, double *k, double *g)
{
    (void)d;
    (void)e;
    (void)p;
    (void)V;
    (void)A;
    (void)k;
    (void)g;
}

static double own_wrench(const double *d, const double *e, const double *p, double *W, double *Wd)
{
    (void)p;
    W[0] = d[0];
    W[1] = d[1];
    W[2] = d[2];
    W[3] = d[3];
    W[4] = d[4];
    W[5] = d[5];
    Wd[0] = e[0];
    Wd[1] = e[1];
    Wd[2] = e[2];
    Wd[3] = e[3];
    Wd[4] = e[4];
    Wd[5] = e[5];
    return 1.0;
}

static void own_slopes(const double *d, const double *e, const double *p, const double *V, const double *A, double *k, double *g)
{
    (void)d;
    (void)e;
    (void)p;
    k[0] = V[0];
    k[1] = V[1];
    k[2] = V[2];
    k[3] = V[3];
    k[4] = V[4];
    k[5] = V[5];
    g[0] = A[0];
    g[1] = A[1];
    g[2] = A[2];
    g[3] = A[3];
    g[4] = A[4];
    g[5] = A[5];
}

static double wheel_wrench(const double *d, const double *e, const double *p, double *W, double *Wd)
{
    const double x0 = p[3] * d[1] - p[2] * d[2];
    const double x1 = p[1] * d[2] - p[3] * d[0];
    const double x2 = p[2] * d[0] - p[1] * d[1];
    const double x3 = sqrt(x0 * x0 + x1 * x1 + x2 * x2);
    const double x4 = 1.0 / x3;
    const double x5 = x0 * x4;
    const double x6 = x2 * x4;
    const double x7 = x1 * x4;
    const double x8 = p[0] * (p[1] * d[0] + p[2] * d[1] + p[3] * d[2]);
    const double x9 = p[3] * e[1] - p[2] * e[2];
    const double x10 = p[1] * e[2] - p[3] * e[0];
    const double x11 = p[2] * e[0] - p[1] * e[1];
    const double x12 = (x0 * x9 * 2.0 + 2.0 * x1 * x10 + 2.0 * x2 * x11) * x4 * 0.5 * x4 * x4;
    const double x13 = x4 * x9 - x0 * x12;
    const double x14 = x4 * x11 - x2 * x12;
    const double x15 = x4 * x10 - x1 * x12;
    const double x16 = p[0] * (p[1] * e[0] + p[2] * e[1] + p[3] * e[2]);
    W[0] = p[4] * x5 + p[5] * (p[2] * x6 - p[3] * x7) + p[1] * p[6];
    W[1] = p[4] * x7 + p[5] * (p[3] * x5 - p[1] * x6) + p[2] * p[6];
    W[2] = p[4] * x6 + p[5] * (p[1] * x7 - p[2] * x5) + p[3] * p[6];
    W[3] = p[5] * p[0] * x0 - p[4] * p[0] * d[0] + p[6] * x5 * x8;
    W[4] = p[5] * p[0] * x1 - p[4] * p[0] * d[1] + p[6] * x7 * x8;
    W[5] = p[5] * p[0] * x2 - p[4] * p[0] * d[2] + p[6] * x6 * x8;
    Wd[0] = p[4] * x13 + p[5] * (p[2] * x14 - p[3] * x15);
    Wd[1] = p[4] * x15 + p[5] * (p[3] * x13 - p[1] * x14);
    Wd[2] = p[4] * x14 + p[5] * (p[1] * x15 - p[2] * x13);
    Wd[3] = p[5] * p[0] * x9 - p[4] * p[0] * e[0] + p[6] * (x8 * x13 + x5 * x16);
    Wd[4] = p[5] * p[0] * x10 - p[4] * p[0] * e[1] + p[6] * (x8 * x15 + x7 * x16);
    Wd[5] = p[5] * p[0] * x11 - p[4] * p[0] * e[2] + p[6] * (x8 * x14 + x6 * x16);
    return x3;
}

static void wheel_slopes(const double *d, const double *e, const double *p, const double *V, const double *A, double *k, double *g)
{
    const double x0 = p[2] * d[0] - p[1] * d[1];
    const double x1 = p[3] * d[1] - p[2] * d[2];
    const double x2 = p[1] * d[2] - p[3] * d[0];
    const double x3 = 1.0 / sqrt(x1 * x1 + x2 * x2 + x0 * x0);
    const double x4 = x0 * x3;
    const double x5 = V[5] * p[6];
    const double x6 = x2 * x3;
    const double x7 = V[4] * p[6];
    const double x8 = x1 * x3;
    const double x9 = V[3] * p[6];
    const double x10 = p[0] * (x4 * x5 + x6 * x7 + x8 * x9);
    const double x11 = x3 * 0.5;
    const double x12 = x3 * x3;
    const double x13 = p[0] * (p[1] * d[0] + p[2] * d[1] + p[3] * d[2]);
    const double x14 = p[5] * V[2];
    const double x15 = p[5] * V[0];
    const double x16 = x13 * x7 + p[1] * x14 + p[4] * V[1] - p[3] * x15;
    const double x17 = x2 * x16;
    const double x18 = p[5] * V[1];
    const double x19 = x13 * x5 + p[4] * V[2] - p[1] * x18 + p[2] * x15;
    const double x20 = x0 * x19;
    const double x21 = x13 * x9 - p[2] * x14 + p[3] * x18 + p[4] * V[0];
    const double x22 = x1 * x21;
    const double x23 = x11 * x12 * (x17 + x20 + x22);
    const double x24 = -x0 * x23;
    const double x25 = x24 + p[0] * p[5] * V[5] + x3 * x19 + x24;
    const double x26 = -x2 * x23;
    const double x27 = x26 + p[0] * p[5] * V[4] + x3 * x16 + x26;
    const double x28 = -x1 * x23;
    const double x29 = x28 + p[0] * p[5] * V[3] + x3 * x21 + x28;
    const double x30 = p[2] * e[0] - p[1] * e[1];
    const double x31 = p[3] * e[1] - p[2] * e[2];
    const double x32 = p[1] * e[2] - p[3] * e[0];
    const double x33 = x1 * x31 * 2.0 + 2.0 * x2 * x32 + 2.0 * x0 * x30;
    const double x34 = x33 * x11;
    const double x35 = x34 * x12;
    const double x36 = A[5] * p[6];
    const double x37 = A[4] * p[6];
    const double x38 = A[3] * p[6];
    const double x39 = p[0] * ((x3 * x30 - x0 * x35) * x5 + (x3 * x32 - x2 * x35) * x7 + (x3 * x31 - x1 * x35) * x9 + x4 * x36 + x6 * x37 + x8 * x38);
    const double x40 = -x17 - x20 - x22;
    const double x41 = x3 * x34 * x40;
    const double x42 = x12 * x40;
    const double x43 = p[0] * (p[1] * e[0] + p[2] * e[1] + p[3] * e[2]);
    const double x44 = p[5] * A[2];
    const double x45 = p[5] * A[0];
    const double x46 = x43 * x7 + x13 * x37 + p[1] * x44 + p[4] * A[1] - p[3] * x45;
    const double x47 = p[5] * A[1];
    const double x48 = x43 * x5 + x13 * x36 + p[4] * A[2] - p[1] * x47 + p[2] * x45;
    const double x49 = x43 * x9 + x13 * x38 - p[2] * x44 + p[3] * x47 + p[4] * A[0];
    const double x50 = x11 * x12 * (x41 + x32 * x16 + x30 * x19 + x41 + 0.5 * x33 * x42 + x31 * x21 + x2 * x46 + x0 * x48 + x1 * x49);
    const double x51 = -x0 * x50;
    const double x52 = 2.0 * x11 * x42;
    const double x53 = x51 + x30 * x52 - x35 * x19 + p[0] * p[5] * A[5] + x3 * x48 + x51;
    const double x54 = -x2 * x50;
    const double x55 = x54 + x32 * x52 - x35 * x16 + p[0] * p[5] * A[4] + x3 * x46 + x54;
    const double x56 = -x1 * x50;
    const double x57 = x56 + x31 * x52 - x35 * x21 + p[0] * p[5] * A[3] + x3 * x49 + x56;
    k[0] = p[1] * x10 - p[0] * p[4] * V[3] + p[2] * x25 - p[3] * x27;
    k[1] = p[2] * x10 - p[0] * p[4] * V[4] - p[1] * x25 + p[3] * x29;
    k[2] = p[3] * x10 - p[0] * p[4] * V[5] + p[1] * x27 - p[2] * x29;
    g[0] = p[1] * x39 - p[0] * p[4] * A[3] + p[2] * x53 - p[3] * x55;
    g[1] = p[2] * x39 - p[0] * p[4] * A[4] - p[1] * x53 + p[3] * x57;
    g[2] = p[3] * x39 - p[0] * p[4] * A[5] + p[1] * x55 - p[2] * x57;
}

static double yaw_wrench(const double *d, const double *e, const double *p, double *W, double *Wd)
{
    (void)p;
    const double x0 = d[0] * d[2];
    const double x1 = d[0] * d[0] + d[1] * d[1];
    const double x2 = 1.0 / x1;
    const double x3 = d[1] * d[2];
    const double x4 = (2.0 * d[0] * e[0] + 2.0 * d[1] * e[1]) * x2 * x2;
    W[0] = 0.0;
    W[1] = 0.0;
    W[2] = 0.0;
    W[3] = -x0 * x2;
    W[4] = -x2 * x3;
    W[5] = 1.0;
    Wd[0] = 0.0;
    Wd[1] = 0.0;
    Wd[2] = 0.0;
    Wd[3] = -(x2 * (d[2] * e[0] + d[0] * e[2]) - x0 * x4);
    Wd[4] = -(x2 * (d[2] * e[1] + d[1] * e[2]) - x3 * x4);
    Wd[5] = 0.0;
    return sqrt(x1);
}

static void yaw_slopes(const double *d, const double *e, const double *p, const double *V, const double *A, double *k, double *g)
{
    (void)p;
    const double x0 = 1.0 / (d[0] * d[0] + d[1] * d[1]);
    const double x1 = x0 * x0;
    const double x2 = d[1] * d[2];
    const double x3 = V[4] * x2;
    const double x4 = d[0] * d[2];
    const double x5 = V[3] * x4;
    const double x6 = x1 * (-x3 - x5);
    const double x7 = V[3] * x0;
    const double x8 = -d[1] * x6;
    const double x9 = V[4] * x0;
    const double x10 = 2.0 * d[0] * e[0] + 2.0 * d[1] * e[1];
    const double x11 = x3 + x5;
    const double x12 = x0 * x10 * x11;
    const double x13 = x1 * (x12 + x12 - V[4] * (d[2] * e[1] + d[1] * e[2]) - V[3] * (d[2] * e[0] + d[0] * e[2]) - A[4] * x2 - A[3] * x4);
    const double x14 = -d[0] * x13;
    const double x15 = 2.0 * x1 * x11;
    const double x16 = x10 * x1;
    const double x17 = V[3] * x16 - A[3] * x0;
    const double x18 = -d[1] * x13;
    const double x19 = V[4] * x16 - A[4] * x0;
    k[0] = -2.0 * d[0] * x6 - d[2] * x7;
    k[1] = x8 + x8 - d[2] * x9;
    k[2] = -d[1] * x9 - d[0] * x7;
    g[0] = x14 + e[0] * x15 - e[2] * x7 + x14 + d[2] * x17;
    g[1] = x18 + e[1] * x15 - e[2] * x9 + d[2] * x19 + x18;
    g[2] = d[1] * x19 - e[1] * x9 - e[0] * x7 + d[0] * x17;
}

static double tilt_wrench(const double *d, const double *e, const double *p, double *W, double *Wd)
{
    (void)p;
    const double x0 = sqrt(d[0] * d[0] + d[1] * d[1]);
    const double x1 = 1.0 / x0;
    const double x2 = (2.0 * d[0] * e[0] + 2.0 * d[1] * e[1]) * 0.5 * x1 * x1 * x1;
    W[0] = 0.0;
    W[1] = 0.0;
    W[2] = 0.0;
    W[3] = d[1] * x1;
    W[4] = -d[0] * x1;
    W[5] = 0.0;
    Wd[0] = 0.0;
    Wd[1] = 0.0;
    Wd[2] = 0.0;
    Wd[3] = e[1] * x1 - d[1] * x2;
    Wd[4] = -(e[0] * x1 - d[0] * x2);
    Wd[5] = 0.0;
    return x0;
}

static void tilt_slopes(const double *d, const double *e, const double *p, const double *V, const double *A, double *k, double *g)
{
    (void)p;
    const double x0 = 1.0 / sqrt(d[0] * d[0] + d[1] * d[1]);
    const double x1 = 0.5 * x0;
    const double x2 = x0 * x0;
    const double x3 = V[4] * d[0];
    const double x4 = V[3] * d[1];
    const double x5 = x1 * x2 * (x4 - x3);
    const double x6 = -d[0] * x5;
    const double x7 = -d[1] * x5;
    const double x8 = 2.0 * d[0] * e[0] + 2.0 * d[1] * e[1];
    const double x9 = x8 * x1;
    const double x10 = x3 - x4;
    const double x11 = x0 * x9 * x10;
    const double x12 = x2 * x10;
    const double x13 = x1 * x2 * (x11 + x11 - V[4] * e[0] + 0.5 * x8 * x12 + V[3] * e[1] - A[4] * d[0] + A[3] * d[1]);
    const double x14 = -d[0] * x13;
    const double x15 = x9 * x2;
    const double x16 = 2.0 * x1 * x12;
    const double x17 = -d[1] * x13;
    k[0] = x6 + x6 - V[4] * x0;
    k[1] = x7 + V[3] * x0 + x7;
    k[2] = 0.0;
    g[0] = x14 + V[4] * x15 + e[0] * x16 - A[4] * x0 + x14;
    g[1] = x17 + e[1] * x16 - V[3] * x15 + A[3] * x0 + x17;
    g[2] = 0.0;
}

static double rolling_wrench(const double *d, const double *e, const double *p, double *W, double *Wd)
{
    const double x0 = p[3] * d[0] + p[4] * d[1] + p[5] * d[2];
    const double x1 = p[6] * x0;
    const double x2 = p[9] * x1;
    const double x3 = p[3] * d[6] + p[4] * d[7] + p[5] * d[8];
    const double x4 = p[8] * x3;
    const double x5 = p[3] * d[3] + p[4] * d[4] + p[5] * d[5];
    const double x6 = p[7] * x5;
    const double x7 = sqrt(x3 * x4 + x0 * x1 + x5 * x6);
    const double x8 = 1.0 / x7;
    const double x9 = -x2 * x8 - p[10] * x0;
    const double x10 = p[9] * x6;
    const double x11 = -x10 * x8 - p[10] * x5;
    const double x12 = p[9] * x4;
    const double x13 = -x12 * x8 - p[10] * x3;
    const double x14 = d[1] * x9 + d[4] * x11 + d[7] * x13;
    const double x15 = d[2] * x9 + d[5] * x11 + d[8] * x13;
    const double x16 = d[0] * x9 + d[3] * x11 + d[6] * x13;
    const double x17 = p[3] * e[0] + p[4] * e[1] + p[5] * e[2];
    const double x18 = p[6] * x17;
    const double x19 = p[3] * e[6] + p[4] * e[7] + p[5] * e[8];
    const double x20 = p[8] * x19;
    const double x21 = p[3] * e[3] + p[4] * e[4] + p[5] * e[5];
    const double x22 = p[7] * x21;
    const double x23 = (x4 * x19 + x3 * x20 + x1 * x17 + x0 * x18 + x6 * x21 + x5 * x22) * 0.5 * x8 * x8 * x8;
    const double x24 = -(x8 * p[9] * x18 - x2 * x23) - p[10] * x17;
    const double x25 = -(x8 * p[9] * x22 - x10 * x23) - p[10] * x21;
    const double x26 = -(x8 * p[9] * x20 - x12 * x23) - p[10] * x19;
    const double x27 = e[1] * x9 + d[1] * x24 + e[4] * x11 + d[4] * x25 + e[7] * x13 + d[7] * x26;
    const double x28 = e[2] * x9 + d[2] * x24 + e[5] * x11 + d[5] * x25 + e[8] * x13 + d[8] * x26;
    const double x29 = e[0] * x9 + d[0] * x24 + e[3] * x11 + d[3] * x25 + e[6] * x13 + d[6] * x26;
    W[0] = p[0];
    W[1] = p[1];
    W[2] = p[2];
    W[3] = p[2] * x14 - p[1] * x15;
    W[4] = p[0] * x15 - p[2] * x16;
    W[5] = p[1] * x16 - p[0] * x14;
    Wd[0] = 0.0;
    Wd[1] = 0.0;
    Wd[2] = 0.0;
    Wd[3] = p[2] * x27 - p[1] * x28;
    Wd[4] = p[0] * x28 - p[2] * x29;
    Wd[5] = p[1] * x29 - p[0] * x27;
    return x7;
}

static void rolling_slopes(const double *d, const double *e, const double *p, const double *V, const double *A, double *k, double *g)
{
    const double x0 = p[3] * d[0] + p[4] * d[1] + p[5] * d[2];
    const double x1 = p[6] * x0;
    const double x2 = p[9] * x1;
    const double x3 = p[3] * d[6] + p[4] * d[7] + p[5] * d[8];
    const double x4 = p[8] * x3;
    const double x5 = p[3] * d[3] + p[4] * d[4] + p[5] * d[5];
    const double x6 = p[7] * x5;
    const double x7 = 1.0 / sqrt(x3 * x4 + x0 * x1 + x5 * x6);
    const double x8 = -x2 * x7 - p[10] * x0;
    const double x9 = p[1] * V[5] - p[2] * V[4];
    const double x10 = p[0] * V[4] - p[1] * V[3];
    const double x11 = p[2] * V[3] - p[0] * V[5];
    const double x12 = d[0] * x9 + d[2] * x10 + d[1] * x11;
    const double x13 = 0.5 * x7;
    const double x14 = x7 * x7;
    const double x15 = p[9] * x4;
    const double x16 = d[6] * x9 + d[8] * x10 + d[7] * x11;
    const double x17 = x15 * x16;
    const double x18 = p[9] * x6;
    const double x19 = d[3] * x9 + d[5] * x10 + d[4] * x11;
    const double x20 = x18 * x19;
    const double x21 = x2 * x12;
    const double x22 = x13 * x14 * (-x17 - x20 - x21);
    const double x23 = p[6] * (-x0 * x22 - p[9] * x7 * x12) - p[10] * x12 - x1 * x22;
    const double x24 = -x18 * x7 - p[10] * x5;
    const double x25 = p[7] * (-p[9] * x7 * x19 - x5 * x22) - p[10] * x19 - x6 * x22;
    const double x26 = -x15 * x7 - p[10] * x3;
    const double x27 = p[8] * (-p[9] * x7 * x16 - x3 * x22) - p[10] * x16 - x4 * x22;
    const double x28 = p[3] * e[0] + p[4] * e[1] + p[5] * e[2];
    const double x29 = p[6] * x28;
    const double x30 = p[9] * x29;
    const double x31 = p[3] * e[6] + p[4] * e[7] + p[5] * e[8];
    const double x32 = p[8] * x31;
    const double x33 = p[3] * e[3] + p[4] * e[4] + p[5] * e[5];
    const double x34 = p[7] * x33;
    const double x35 = x4 * x31 + x3 * x32 + x1 * x28 + x0 * x29 + x6 * x33 + x5 * x34;
    const double x36 = x35 * x13;
    const double x37 = x36 * x14;
    const double x38 = -(x7 * x30 - x2 * x37) - p[10] * x28;
    const double x39 = p[1] * A[5] - p[2] * A[4];
    const double x40 = x21 + x17 + x20;
    const double x41 = x14 * x40;
    const double x42 = x13 * x41;
    const double x43 = p[0] * A[4] - p[1] * A[3];
    const double x44 = p[2] * A[3] - p[0] * A[5];
    const double x45 = e[0] * x9 + e[2] * x10 + e[1] * x11 + d[0] * x39 + d[2] * x43 + d[1] * x44;
    const double x46 = x7 * x36 * x40;
    const double x47 = p[9] * x32;
    const double x48 = p[9] * x34;
    const double x49 = e[6] * x9 + e[8] * x10 + e[7] * x11 + d[6] * x39 + d[8] * x43 + d[7] * x44;
    const double x50 = e[3] * x9 + e[5] * x10 + e[4] * x11 + d[3] * x39 + d[5] * x43 + d[4] * x44;
    const double x51 = x13 * x14 * (x46 + x46 - x47 * x16 - x48 * x19 + 0.5 * x35 * x41 - x30 * x12 - x15 * x49 - x18 * x50 - x2 * x45);
    const double x52 = x29 * x42 - p[10] * x45 - x1 * x51 + p[6] * (x28 * x42 - x0 * x51 + p[9] * (x37 * x12 - x7 * x45));
    const double x53 = -(x7 * x48 - x18 * x37) - p[10] * x33;
    const double x54 = x34 * x42 - p[10] * x50 - x6 * x51 + p[7] * (x33 * x42 + p[9] * (x37 * x19 - x7 * x50) - x5 * x51);
    const double x55 = -(x7 * x47 - x15 * x37) - p[10] * x31;
    const double x56 = x32 * x42 - p[10] * x49 - x4 * x51 + p[8] * (x31 * x42 + p[9] * (x37 * x16 - x7 * x49) - x3 * x51);
    k[0] = x8 * x9 + p[3] * x23;
    k[1] = x8 * x11 + p[4] * x23;
    k[2] = x8 * x10 + p[5] * x23;
    k[3] = x24 * x9 + p[3] * x25;
    k[4] = x24 * x11 + p[4] * x25;
    k[5] = x24 * x10 + p[5] * x25;
    k[6] = x26 * x9 + p[3] * x27;
    k[7] = x26 * x11 + p[4] * x27;
    k[8] = x26 * x10 + p[5] * x27;
    g[0] = x38 * x9 + x8 * x39 + p[3] * x52;
    g[1] = x38 * x11 + x8 * x44 + p[4] * x52;
    g[2] = x38 * x10 + x8 * x43 + p[5] * x52;
    g[3] = x53 * x9 + x24 * x39 + p[3] * x54;
    g[4] = x53 * x11 + x24 * x44 + p[4] * x54;
    g[5] = x53 * x10 + x24 * x43 + p[5] * x54;
    g[6] = x55 * x9 + x26 * x39 + p[3] * x56;
    g[7] = x55 * x11 + x26 * x44 + p[4] * x56;
    g[8] = x55 * x10 + x26 * x43 + p[5] * x56;
}

static double distance_wrench(const double *d, const double *e, const double *p, double *W, double *Wd)
{
    (void)p;
    const double x0 = sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
    const double x1 = 1.0 / x0;
    const double x2 = (2.0 * d[0] * e[0] + 2.0 * d[1] * e[1] + 2.0 * d[2] * e[2]) * 0.5 * x1 * x1 * x1;
    W[0] = d[0] * x1;
    W[1] = d[1] * x1;
    W[2] = d[2] * x1;
    W[3] = 0.0;
    W[4] = 0.0;
    W[5] = 0.0;
    Wd[0] = e[0] * x1 - d[0] * x2;
    Wd[1] = e[1] * x1 - d[1] * x2;
    Wd[2] = e[2] * x1 - d[2] * x2;
    Wd[3] = 0.0;
    Wd[4] = 0.0;
    Wd[5] = 0.0;
    return x0;
}

static void distance_slopes(const double *d, const double *e, const double *p, const double *V, const double *A, double *k, double *g)
{
    (void)p;
    const double x0 = 1.0 / sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
    const double x1 = 0.5 * x0;
    const double x2 = x0 * x0;
    const double x3 = V[0] * d[0];
    const double x4 = V[1] * d[1];
    const double x5 = V[2] * d[2];
    const double x6 = x1 * x2 * (x3 + x4 + x5);
    const double x7 = -d[0] * x6;
    const double x8 = -d[1] * x6;
    const double x9 = -d[2] * x6;
    const double x10 = 2.0 * d[0] * e[0] + 2.0 * d[1] * e[1] + 2.0 * d[2] * e[2];
    const double x11 = x10 * x1;
    const double x12 = -x5 - x4 - x3;
    const double x13 = x0 * x11 * x12;
    const double x14 = x2 * x12;
    const double x15 = x1 * x2 * (A[0] * d[0] + A[1] * d[1] + A[2] * d[2] + V[0] * e[0] + x13 + V[1] * e[1] + V[2] * e[2] + x13 + 0.5 * x10 * x14);
    const double x16 = -d[0] * x15;
    const double x17 = x11 * x2;
    const double x18 = 2.0 * x1 * x14;
    const double x19 = -d[1] * x15;
    const double x20 = -d[2] * x15;
    k[0] = x7 + V[0] * x0 + x7;
    k[1] = x8 + V[1] * x0 + x8;
    k[2] = x9 + V[2] * x0 + x9;
    g[0] = x16 + e[0] * x18 - V[0] * x17 + A[0] * x0 + x16;
    g[1] = x19 + e[1] * x18 - V[1] * x17 + A[1] * x0 + x19;
    g[2] = x20 + e[2] * x18 - V[2] * x17 + A[2] * x0 + x20;
}

static const Kind KINDS[] = {
    [WORLD] = {0, FLAT, world_wrench, world_slopes},
    [OWN] = {2, FLAT, own_wrench, own_slopes},
    [WHEEL] = {1, FLAT, wheel_wrench, wheel_slopes},
    [YAW] = {1, FLAT, yaw_wrench, yaw_slopes},
    [TILT] = {1, FLAT, tilt_wrench, tilt_slopes},
    [ROLLING] = {3, FLAT, rolling_wrench, rolling_slopes},
    [DISTANCE] = {1, TOGETHER, distance_wrench, distance_slopes},
};
