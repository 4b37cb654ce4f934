/* Written by python -m tools.generate_rows from the formulas in Python: change those. */
/* clang-format off */

#define INTERFACE 43
#define INTEGERS 8
#define NUMBERS 18
#define AT_GROUND 12
enum { CONSTANT = 0, EXTERNAL = 1, MOMENTUM = 2, ACKERMANN = 3, WORLD = 4, OWN = 5, WHEEL = 6, YAW = 7, TILT = 8, ROLLING = 9, DISTANCE = 10, CURVED = 11 };
enum { NO_VALUE = 0, JOINT = 1, CONTINUOUS_JOINT = 2, COORDINATE = 3, HEADING = 4, ELEVATION = 5, LENGTH = 6 };
enum { F_CONSTANT, F_STIFFNESS, F_REST, F_TURNS, F_DAMPING, F_LIMIT, F_SPEED, FORCE_NUMBERS };

typedef struct {
    int directions; /* number of its directions, whose parameters follow in the numbers of a row */
    double least;   /* length below which the wrench is not defined */
    double (*wrench)(const double *d, const double *p, double *W);
    void (*rates)(const double *d, const double *e, const double *p, double *W, double *Wd);
    void (*slopes)(const double *d, const double *e, const double *p, const double *V, const double *A, double *W,
                   double *Wd, double *k, double *g);
} Kind;

static double world_wrench(const double *d, const double *p, double *W)
{
    (void)d; W[0] = p[0]; W[1] = p[1]; W[2] = p[2]; W[3] = p[3]; W[4] = p[4]; W[5] = p[5]; return 1.0;
}

static void world_rates(const double *d, const double *e, const double *p, double *W, double *Wd)
{
    (void)e; W[0] = p[0]; W[1] = p[1]; W[2] = p[2]; W[3] = p[3]; W[4] = p[4]; W[5] = p[5]; Wd[0] = 0.0; Wd[1] = 0.0;
    Wd[2] = 0.0; Wd[3] = 0.0; Wd[4] = 0.0; Wd[5] = 0.0;
}

static void world_slopes(const double *d, const double *e, const double *p, const double *V, const double *A, double *W, double *Wd, double *k, double *g)
{
    (void)e; (void)V; (void)A; (void)k; (void)g; W[0] = p[0]; W[1] = p[1]; W[2] = p[2]; W[3] = p[3]; W[4] = p[4];
    W[5] = p[5]; Wd[0] = 0.0; Wd[1] = 0.0; Wd[2] = 0.0; Wd[3] = 0.0; Wd[4] = 0.0; Wd[5] = 0.0;
}

static double own_wrench(const double *d, const double *p, double *W)
{
    (void)p; W[0] = d[0]; W[1] = d[1]; W[2] = d[2]; W[3] = d[3]; W[4] = d[4]; W[5] = d[5]; return 1.0;
}

static void own_rates(const double *d, const double *e, const double *p, double *W, double *Wd)
{
    (void)p; W[0] = d[0]; W[1] = d[1]; W[2] = d[2]; W[3] = d[3]; W[4] = d[4]; W[5] = d[5]; Wd[0] = e[0]; Wd[1] = e[1];
    Wd[2] = e[2]; Wd[3] = e[3]; Wd[4] = e[4]; Wd[5] = e[5];
}

static void own_slopes(const double *d, const double *e, const double *p, const double *V, const double *A, double *W, double *Wd, double *k, double *g)
{
    (void)p; W[0] = d[0]; W[1] = d[1]; W[2] = d[2]; W[3] = d[3]; W[4] = d[4]; W[5] = d[5]; Wd[0] = e[0]; Wd[1] = e[1];
    Wd[2] = e[2]; Wd[3] = e[3]; Wd[4] = e[4]; Wd[5] = e[5]; k[0] = V[0]; k[1] = V[1]; k[2] = V[2]; k[3] = V[3];
    k[4] = V[4]; k[5] = V[5]; g[0] = A[0]; g[1] = A[1]; g[2] = A[2]; g[3] = A[3]; g[4] = A[4]; g[5] = A[5];
}

static double wheel_wrench(const double *d, const double *p, double *W)
{
    const double x0 = p[3] * d[1] - p[2] * d[2], x1 = p[1] * d[2] - p[3] * d[0], x2 = p[2] * d[0] - p[1] * d[1],
    x3 = sqrt(x0 * x0 + x1 * x1 + x2 * x2), x4 = 1.0 / x3, x5 = x0 * x4, x6 = x2 * x4, x7 = x1 * x4,
    x8 = p[0] * (p[1] * d[0] + p[2] * d[1] + p[3] * d[2]);
    W[0] = p[4] * x5 + p[5] * (p[2] * x6 - p[3] * x7) + p[1] * p[6];
    W[1] = p[4] * x7 + p[5] * (p[3] * x5 - p[1] * x6) + p[2] * p[6];
    W[2] = p[4] * x6 + p[5] * (p[1] * x7 - p[2] * x5) + p[3] * p[6];
    W[3] = p[5] * p[0] * x0 - p[4] * p[0] * d[0] + p[6] * x5 * x8;
    W[4] = p[5] * p[0] * x1 - p[4] * p[0] * d[1] + p[6] * x7 * x8;
    W[5] = p[5] * p[0] * x2 - p[4] * p[0] * d[2] + p[6] * x6 * x8; return x3;
}

static void wheel_rates(const double *d, const double *e, const double *p, double *W, double *Wd)
{
    const double x0 = p[3] * d[1] - p[2] * d[2], x1 = p[1] * d[2] - p[3] * d[0], x2 = p[2] * d[0] - p[1] * d[1],
    x3 = 1.0 / sqrt(x0 * x0 + x1 * x1 + x2 * x2), x4 = x0 * x3, x5 = x2 * x3, x6 = x1 * x3,
    x7 = p[0] * (p[1] * d[0] + p[2] * d[1] + p[3] * d[2]), x8 = p[3] * e[1] - p[2] * e[2],
    x9 = p[1] * e[2] - p[3] * e[0], x10 = p[2] * e[0] - p[1] * e[1],
    x11 = (x0 * x8 * 2.0 + 2.0 * x1 * x9 + 2.0 * x2 * x10) * x3 * 0.5 * x3 * x3, x12 = x3 * x8 - x0 * x11,
    x13 = x3 * x10 - x2 * x11, x14 = x3 * x9 - x1 * x11, x15 = p[0] * (p[1] * e[0] + p[2] * e[1] + p[3] * e[2]);
    W[0] = p[4] * x4 + p[5] * (p[2] * x5 - p[3] * x6) + p[1] * p[6];
    W[1] = p[4] * x6 + p[5] * (p[3] * x4 - p[1] * x5) + p[2] * p[6];
    W[2] = p[4] * x5 + p[5] * (p[1] * x6 - p[2] * x4) + p[3] * p[6];
    W[3] = p[5] * p[0] * x0 - p[4] * p[0] * d[0] + p[6] * x4 * x7;
    W[4] = p[5] * p[0] * x1 - p[4] * p[0] * d[1] + p[6] * x6 * x7;
    W[5] = p[5] * p[0] * x2 - p[4] * p[0] * d[2] + p[6] * x5 * x7;
    Wd[0] = p[4] * x12 + p[5] * (p[2] * x13 - p[3] * x14); Wd[1] = p[4] * x14 + p[5] * (p[3] * x12 - p[1] * x13);
    Wd[2] = p[4] * x13 + p[5] * (p[1] * x14 - p[2] * x12);
    Wd[3] = p[5] * p[0] * x8 - p[4] * p[0] * e[0] + p[6] * (x7 * x12 + x4 * x15);
    Wd[4] = p[5] * p[0] * x9 - p[4] * p[0] * e[1] + p[6] * (x7 * x14 + x6 * x15);
    Wd[5] = p[5] * p[0] * x10 - p[4] * p[0] * e[2] + p[6] * (x7 * x13 + x5 * x15);
}

static void wheel_slopes(const double *d, const double *e, const double *p, const double *V, const double *A, double *W, double *Wd, double *k, double *g)
{
    const double x0 = p[3] * d[1] - p[2] * d[2], x1 = p[1] * d[2] - p[3] * d[0], x2 = p[2] * d[0] - p[1] * d[1],
    x3 = 1.0 / sqrt(x0 * x0 + x1 * x1 + x2 * x2), x4 = x0 * x3, x5 = x2 * x3, x6 = x1 * x3,
    x7 = p[0] * (p[1] * d[0] + p[2] * d[1] + p[3] * d[2]), x8 = p[3] * e[1] - p[2] * e[2],
    x9 = p[1] * e[2] - p[3] * e[0], x10 = p[2] * e[0] - p[1] * e[1],
    x11 = x0 * x8 * 2.0 + 2.0 * x1 * x9 + 2.0 * x2 * x10, x12 = x3 * 0.5, x13 = x11 * x12, x14 = x3 * x3,
    x15 = x13 * x14, x16 = x3 * x8 - x0 * x15, x17 = x3 * x10 - x2 * x15, x18 = x3 * x9 - x1 * x15,
    x19 = p[0] * (p[1] * e[0] + p[2] * e[1] + p[3] * e[2]), x20 = V[5] * p[6], x21 = V[4] * p[6], x22 = V[3] * p[6],
    x23 = p[0] * (x5 * x20 + x6 * x21 + x4 * x22), x24 = p[5] * V[2], x25 = p[5] * V[0],
    x26 = x7 * x21 + p[1] * x24 + p[4] * V[1] - p[3] * x25, x27 = x1 * x26, x28 = p[5] * V[1],
    x29 = x7 * x20 + p[4] * V[2] - p[1] * x28 + p[2] * x25, x30 = x2 * x29,
    x31 = x7 * x22 - p[2] * x24 + p[3] * x28 + p[4] * V[0], x32 = x0 * x31, x33 = x12 * x14 * (x27 + x30 + x32),
    x34 = -x2 * x33, x35 = x34 + p[0] * p[5] * V[5] + x3 * x29 + x34, x36 = -x1 * x33,
    x37 = x36 + p[0] * p[5] * V[4] + x3 * x26 + x36, x38 = -x0 * x33, x39 = x38 + p[0] * p[5] * V[3] + x3 * x31 + x38,
    x40 = A[5] * p[6], x41 = A[4] * p[6], x42 = A[3] * p[6],
    x43 = p[0] * (x17 * x20 + x18 * x21 + x16 * x22 + x5 * x40 + x6 * x41 + x4 * x42), x44 = -x27 - x30 - x32,
    x45 = x3 * x13 * x44, x46 = x14 * x44, x47 = p[5] * A[2], x48 = p[5] * A[0],
    x49 = x19 * x21 + x7 * x41 + p[1] * x47 + p[4] * A[1] - p[3] * x48, x50 = p[5] * A[1],
    x51 = x19 * x20 + x7 * x40 + p[4] * A[2] - p[1] * x50 + p[2] * x48,
    x52 = x19 * x22 + x7 * x42 - p[2] * x47 + p[3] * x50 + p[4] * A[0],
    x53 = x12 * x14 * (x45 + x9 * x26 + x10 * x29 + x45 + 0.5 * x11 * x46 + x8 * x31 + x1 * x49 + x2 * x51 + x0 * x52),
    x54 = -x2 * x53, x55 = 2.0 * x12 * x46, x56 = x54 + x10 * x55 - x15 * x29 + p[0] * p[5] * A[5] + x3 * x51 + x54,
    x57 = -x1 * x53, x58 = x57 + x9 * x55 - x15 * x26 + p[0] * p[5] * A[4] + x3 * x49 + x57, x59 = -x0 * x53,
    x60 = x59 + x8 * x55 - x15 * x31 + p[0] * p[5] * A[3] + x3 * x52 + x59;
    W[0] = p[4] * x4 + p[5] * (p[2] * x5 - p[3] * x6) + p[1] * p[6];
    W[1] = p[4] * x6 + p[5] * (p[3] * x4 - p[1] * x5) + p[2] * p[6];
    W[2] = p[4] * x5 + p[5] * (p[1] * x6 - p[2] * x4) + p[3] * p[6];
    W[3] = p[5] * p[0] * x0 - p[4] * p[0] * d[0] + p[6] * x4 * x7;
    W[4] = p[5] * p[0] * x1 - p[4] * p[0] * d[1] + p[6] * x6 * x7;
    W[5] = p[5] * p[0] * x2 - p[4] * p[0] * d[2] + p[6] * x5 * x7;
    Wd[0] = p[4] * x16 + p[5] * (p[2] * x17 - p[3] * x18); Wd[1] = p[4] * x18 + p[5] * (p[3] * x16 - p[1] * x17);
    Wd[2] = p[4] * x17 + p[5] * (p[1] * x18 - p[2] * x16);
    Wd[3] = p[5] * p[0] * x8 - p[4] * p[0] * e[0] + p[6] * (x7 * x16 + x4 * x19);
    Wd[4] = p[5] * p[0] * x9 - p[4] * p[0] * e[1] + p[6] * (x7 * x18 + x6 * x19);
    Wd[5] = p[5] * p[0] * x10 - p[4] * p[0] * e[2] + p[6] * (x7 * x17 + x5 * x19);
    k[0] = p[1] * x23 - p[0] * p[4] * V[3] + p[2] * x35 - p[3] * x37;
    k[1] = p[2] * x23 - p[0] * p[4] * V[4] - p[1] * x35 + p[3] * x39;
    k[2] = p[3] * x23 - p[0] * p[4] * V[5] + p[1] * x37 - p[2] * x39;
    g[0] = p[1] * x43 - p[0] * p[4] * A[3] + p[2] * x56 - p[3] * x58;
    g[1] = p[2] * x43 - p[0] * p[4] * A[4] - p[1] * x56 + p[3] * x60;
    g[2] = p[3] * x43 - p[0] * p[4] * A[5] + p[1] * x58 - p[2] * x60;
}

static double yaw_wrench(const double *d, const double *p, double *W)
{
    (void)p; const double x0 = d[0] * d[0] + d[1] * d[1], x1 = 1.0 / x0; W[0] = 0.0; W[1] = 0.0; W[2] = 0.0;
    W[3] = -d[0] * d[2] * x1; W[4] = -x1 * d[1] * d[2]; W[5] = 1.0; return sqrt(x0);
}

static void yaw_rates(const double *d, const double *e, const double *p, double *W, double *Wd)
{
    (void)p; const double x0 = d[0] * d[2], x1 = 1.0 / (d[0] * d[0] + d[1] * d[1]), x2 = d[1] * d[2],
    x3 = (2.0 * d[0] * e[0] + 2.0 * d[1] * e[1]) * x1 * x1; W[0] = 0.0; W[1] = 0.0; W[2] = 0.0; W[3] = -x0 * x1;
    W[4] = -x1 * x2; W[5] = 1.0; Wd[0] = 0.0; Wd[1] = 0.0; Wd[2] = 0.0;
    Wd[3] = -(x1 * (d[2] * e[0] + d[0] * e[2]) - x0 * x3); Wd[4] = -(x1 * (d[2] * e[1] + d[1] * e[2]) - x2 * x3);
    Wd[5] = 0.0;
}

static void yaw_slopes(const double *d, const double *e, const double *p, const double *V, const double *A, double *W, double *Wd, double *k, double *g)
{
    (void)p; const double x0 = d[0] * d[2], x1 = 1.0 / (d[0] * d[0] + d[1] * d[1]), x2 = d[1] * d[2],
    x3 = d[2] * e[0] + d[0] * e[2], x4 = 2.0 * d[0] * e[0] + 2.0 * d[1] * e[1], x5 = x1 * x1, x6 = x4 * x5,
    x7 = d[2] * e[1] + d[1] * e[2], x8 = V[4] * x2, x9 = V[3] * x0, x10 = x5 * (-x8 - x9), x11 = V[3] * x1,
    x12 = -d[1] * x10, x13 = V[4] * x1, x14 = x8 + x9, x15 = x1 * x4 * x14,
    x16 = x5 * (x15 + x15 - V[4] * x7 - V[3] * x3 - A[4] * x2 - A[3] * x0), x17 = -d[0] * x16, x18 = 2.0 * x5 * x14,
    x19 = V[3] * x6 - A[3] * x1, x20 = -d[1] * x16, x21 = V[4] * x6 - A[4] * x1; W[0] = 0.0; W[1] = 0.0; W[2] = 0.0;
    W[3] = -x0 * x1; W[4] = -x1 * x2; W[5] = 1.0; Wd[0] = 0.0; Wd[1] = 0.0; Wd[2] = 0.0; Wd[3] = -(x1 * x3 - x0 * x6);
    Wd[4] = -(x1 * x7 - x2 * x6); Wd[5] = 0.0; k[0] = -2.0 * d[0] * x10 - d[2] * x11; k[1] = x12 + x12 - d[2] * x13;
    k[2] = -d[1] * x13 - d[0] * x11; g[0] = x17 + e[0] * x18 - e[2] * x11 + x17 + d[2] * x19;
    g[1] = x20 + e[1] * x18 - e[2] * x13 + d[2] * x21 + x20; g[2] = d[1] * x21 - e[1] * x13 - e[0] * x11 + d[0] * x19;
}

static double tilt_wrench(const double *d, const double *p, double *W)
{
    (void)p; const double x0 = sqrt(d[0] * d[0] + d[1] * d[1]), x1 = 1.0 / x0; W[0] = 0.0; W[1] = 0.0; W[2] = 0.0;
    W[3] = d[1] * x1; W[4] = -d[0] * x1; W[5] = 0.0; return x0;
}

static void tilt_rates(const double *d, const double *e, const double *p, double *W, double *Wd)
{
    (void)p; const double x0 = 1.0 / sqrt(d[0] * d[0] + d[1] * d[1]),
    x1 = (2.0 * d[0] * e[0] + 2.0 * d[1] * e[1]) * 0.5 * x0 * x0 * x0; W[0] = 0.0; W[1] = 0.0; W[2] = 0.0;
    W[3] = d[1] * x0; W[4] = -d[0] * x0; W[5] = 0.0; Wd[0] = 0.0; Wd[1] = 0.0; Wd[2] = 0.0;
    Wd[3] = e[1] * x0 - d[1] * x1; Wd[4] = -(e[0] * x0 - d[0] * x1); Wd[5] = 0.0;
}

static void tilt_slopes(const double *d, const double *e, const double *p, const double *V, const double *A, double *W, double *Wd, double *k, double *g)
{
    (void)p; const double x0 = 1.0 / sqrt(d[0] * d[0] + d[1] * d[1]), x1 = 2.0 * d[0] * e[0] + 2.0 * d[1] * e[1],
    x2 = 0.5 * x0, x3 = x1 * x2, x4 = x0 * x0, x5 = x3 * x4, x6 = V[4] * d[0], x7 = V[3] * d[1],
    x8 = x2 * x4 * (x7 - x6), x9 = -d[0] * x8, x10 = -d[1] * x8, x11 = x6 - x7, x12 = x0 * x3 * x11, x13 = x4 * x11,
    x14 = x2 * x4 * (x12 + x12 - V[4] * e[0] + 0.5 * x1 * x13 + V[3] * e[1] - A[4] * d[0] + A[3] * d[1]),
    x15 = -d[0] * x14, x16 = 2.0 * x2 * x13, x17 = -d[1] * x14; W[0] = 0.0; W[1] = 0.0; W[2] = 0.0; W[3] = d[1] * x0;
    W[4] = -d[0] * x0; W[5] = 0.0; Wd[0] = 0.0; Wd[1] = 0.0; Wd[2] = 0.0; Wd[3] = e[1] * x0 - d[1] * x5;
    Wd[4] = -(e[0] * x0 - d[0] * x5); Wd[5] = 0.0; k[0] = x9 + x9 - V[4] * x0; k[1] = x10 + V[3] * x0 + x10;
    k[2] = 0.0; g[0] = x15 + V[4] * x5 + e[0] * x16 - A[4] * x0 + x15;
    g[1] = x17 + e[1] * x16 - V[3] * x5 + A[3] * x0 + x17; g[2] = 0.0;
}

static double rolling_wrench(const double *d, const double *p, double *W)
{
    const double x0 = p[3] * d[0] + p[4] * d[1] + p[5] * d[2], x1 = p[6] * x0,
    x2 = p[3] * d[6] + p[4] * d[7] + p[5] * d[8], x3 = p[8] * x2, x4 = p[3] * d[3] + p[4] * d[4] + p[5] * d[5],
    x5 = p[7] * x4, x6 = sqrt(x2 * x3 + x0 * x1 + x4 * x5), x7 = 1.0 / x6, x8 = -p[9] * x1 * x7 - p[10] * x0,
    x9 = -p[9] * x5 * x7 - p[10] * x4, x10 = -p[9] * x3 * x7 - p[10] * x2, x11 = d[1] * x8 + d[4] * x9 + d[7] * x10,
    x12 = d[2] * x8 + d[5] * x9 + d[8] * x10, x13 = d[0] * x8 + d[3] * x9 + d[6] * x10; W[0] = p[0]; W[1] = p[1];
    W[2] = p[2]; W[3] = p[2] * x11 - p[1] * x12; W[4] = p[0] * x12 - p[2] * x13; W[5] = p[1] * x13 - p[0] * x11;
    return x6;
}

static void rolling_rates(const double *d, const double *e, const double *p, double *W, double *Wd)
{
    const double x0 = p[3] * d[0] + p[4] * d[1] + p[5] * d[2], x1 = p[6] * x0, x2 = p[9] * x1,
    x3 = p[3] * d[6] + p[4] * d[7] + p[5] * d[8], x4 = p[8] * x3, x5 = p[3] * d[3] + p[4] * d[4] + p[5] * d[5],
    x6 = p[7] * x5, x7 = 1.0 / sqrt(x3 * x4 + x0 * x1 + x5 * x6), x8 = -x2 * x7 - p[10] * x0, x9 = p[9] * x6,
    x10 = -x9 * x7 - p[10] * x5, x11 = p[9] * x4, x12 = -x11 * x7 - p[10] * x3,
    x13 = d[1] * x8 + d[4] * x10 + d[7] * x12, x14 = d[2] * x8 + d[5] * x10 + d[8] * x12,
    x15 = d[0] * x8 + d[3] * x10 + d[6] * x12, x16 = p[3] * e[0] + p[4] * e[1] + p[5] * e[2], x17 = p[6] * x16,
    x18 = p[3] * e[6] + p[4] * e[7] + p[5] * e[8], x19 = p[8] * x18, x20 = p[3] * e[3] + p[4] * e[4] + p[5] * e[5],
    x21 = p[7] * x20, x22 = (x4 * x18 + x3 * x19 + x1 * x16 + x0 * x17 + x6 * x20 + x5 * x21) * 0.5 * x7 * x7 * x7,
    x23 = -(x7 * p[9] * x17 - x2 * x22) - p[10] * x16, x24 = -(x7 * p[9] * x21 - x9 * x22) - p[10] * x20,
    x25 = -(x7 * p[9] * x19 - x11 * x22) - p[10] * x18,
    x26 = e[1] * x8 + d[1] * x23 + e[4] * x10 + d[4] * x24 + e[7] * x12 + d[7] * x25,
    x27 = e[2] * x8 + d[2] * x23 + e[5] * x10 + d[5] * x24 + e[8] * x12 + d[8] * x25,
    x28 = e[0] * x8 + d[0] * x23 + e[3] * x10 + d[3] * x24 + e[6] * x12 + d[6] * x25; W[0] = p[0]; W[1] = p[1];
    W[2] = p[2]; W[3] = p[2] * x13 - p[1] * x14; W[4] = p[0] * x14 - p[2] * x15; W[5] = p[1] * x15 - p[0] * x13;
    Wd[0] = 0.0; Wd[1] = 0.0; Wd[2] = 0.0; Wd[3] = p[2] * x26 - p[1] * x27; Wd[4] = p[0] * x27 - p[2] * x28;
    Wd[5] = p[1] * x28 - p[0] * x26;
}

static void rolling_slopes(const double *d, const double *e, const double *p, const double *V, const double *A, double *W, double *Wd, double *k, double *g)
{
    const double x0 = p[3] * d[0] + p[4] * d[1] + p[5] * d[2], x1 = p[6] * x0, x2 = p[9] * x1,
    x3 = p[3] * d[6] + p[4] * d[7] + p[5] * d[8], x4 = p[8] * x3, x5 = p[3] * d[3] + p[4] * d[4] + p[5] * d[5],
    x6 = p[7] * x5, x7 = 1.0 / sqrt(x3 * x4 + x0 * x1 + x5 * x6), x8 = -x2 * x7 - p[10] * x0, x9 = p[9] * x6,
    x10 = -x9 * x7 - p[10] * x5, x11 = p[9] * x4, x12 = -x11 * x7 - p[10] * x3,
    x13 = d[1] * x8 + d[4] * x10 + d[7] * x12, x14 = d[2] * x8 + d[5] * x10 + d[8] * x12,
    x15 = d[0] * x8 + d[3] * x10 + d[6] * x12, x16 = p[3] * e[0] + p[4] * e[1] + p[5] * e[2], x17 = p[6] * x16,
    x18 = p[9] * x17, x19 = p[3] * e[6] + p[4] * e[7] + p[5] * e[8], x20 = p[8] * x19,
    x21 = p[3] * e[3] + p[4] * e[4] + p[5] * e[5], x22 = p[7] * x21,
    x23 = x4 * x19 + x3 * x20 + x1 * x16 + x0 * x17 + x6 * x21 + x5 * x22, x24 = 0.5 * x7, x25 = x23 * x24,
    x26 = x7 * x7, x27 = x25 * x26, x28 = -(x7 * x18 - x2 * x27) - p[10] * x16, x29 = p[9] * x22,
    x30 = -(x7 * x29 - x9 * x27) - p[10] * x21, x31 = p[9] * x20, x32 = -(x7 * x31 - x11 * x27) - p[10] * x19,
    x33 = e[1] * x8 + d[1] * x28 + e[4] * x10 + d[4] * x30 + e[7] * x12 + d[7] * x32,
    x34 = e[2] * x8 + d[2] * x28 + e[5] * x10 + d[5] * x30 + e[8] * x12 + d[8] * x32,
    x35 = e[0] * x8 + d[0] * x28 + e[3] * x10 + d[3] * x30 + e[6] * x12 + d[6] * x32, x36 = p[1] * V[5] - p[2] * V[4],
    x37 = p[0] * V[4] - p[1] * V[3], x38 = p[2] * V[3] - p[0] * V[5], x39 = d[0] * x36 + d[2] * x37 + d[1] * x38,
    x40 = d[6] * x36 + d[8] * x37 + d[7] * x38, x41 = x11 * x40, x42 = d[3] * x36 + d[5] * x37 + d[4] * x38,
    x43 = x9 * x42, x44 = x2 * x39, x45 = x24 * x26 * (-x41 - x43 - x44),
    x46 = p[6] * (-x0 * x45 - p[9] * x7 * x39) - p[10] * x39 - x1 * x45,
    x47 = p[7] * (-p[9] * x7 * x42 - x5 * x45) - p[10] * x42 - x6 * x45,
    x48 = p[8] * (-p[9] * x7 * x40 - x3 * x45) - p[10] * x40 - x4 * x45, x49 = p[1] * A[5] - p[2] * A[4],
    x50 = x44 + x41 + x43, x51 = x26 * x50, x52 = x24 * x51, x53 = p[0] * A[4] - p[1] * A[3],
    x54 = p[2] * A[3] - p[0] * A[5], x55 = e[0] * x36 + e[2] * x37 + e[1] * x38 + d[0] * x49 + d[2] * x53 + d[1] * x54,
    x56 = x7 * x25 * x50, x57 = e[6] * x36 + e[8] * x37 + e[7] * x38 + d[6] * x49 + d[8] * x53 + d[7] * x54,
    x58 = e[3] * x36 + e[5] * x37 + e[4] * x38 + d[3] * x49 + d[5] * x53 + d[4] * x54,
    x59 = x24 * x26 * (x56 + x56 - x31 * x40 - x29 * x42 + 0.5 * x23 * x51 - x18 * x39 - x11 * x57 - x9 * x58 - x2 * x55),
    x60 = x17 * x52 - p[10] * x55 - x1 * x59 + p[6] * (x16 * x52 - x0 * x59 + p[9] * (x27 * x39 - x7 * x55)),
    x61 = x22 * x52 - p[10] * x58 - x6 * x59 + p[7] * (x21 * x52 + p[9] * (x27 * x42 - x7 * x58) - x5 * x59),
    x62 = x20 * x52 - p[10] * x57 - x4 * x59 + p[8] * (x19 * x52 + p[9] * (x27 * x40 - x7 * x57) - x3 * x59);
    W[0] = p[0]; W[1] = p[1]; W[2] = p[2]; W[3] = p[2] * x13 - p[1] * x14; W[4] = p[0] * x14 - p[2] * x15;
    W[5] = p[1] * x15 - p[0] * x13; Wd[0] = 0.0; Wd[1] = 0.0; Wd[2] = 0.0; Wd[3] = p[2] * x33 - p[1] * x34;
    Wd[4] = p[0] * x34 - p[2] * x35; Wd[5] = p[1] * x35 - p[0] * x33; k[0] = x8 * x36 + p[3] * x46;
    k[1] = x8 * x38 + p[4] * x46; k[2] = x8 * x37 + p[5] * x46; k[3] = x10 * x36 + p[3] * x47;
    k[4] = x10 * x38 + p[4] * x47; k[5] = x10 * x37 + p[5] * x47; k[6] = x12 * x36 + p[3] * x48;
    k[7] = x12 * x38 + p[4] * x48; k[8] = x12 * x37 + p[5] * x48; g[0] = x28 * x36 + x8 * x49 + p[3] * x60;
    g[1] = x28 * x38 + x8 * x54 + p[4] * x60; g[2] = x28 * x37 + x8 * x53 + p[5] * x60;
    g[3] = x30 * x36 + x10 * x49 + p[3] * x61; g[4] = x30 * x38 + x10 * x54 + p[4] * x61;
    g[5] = x30 * x37 + x10 * x53 + p[5] * x61; g[6] = x32 * x36 + x12 * x49 + p[3] * x62;
    g[7] = x32 * x38 + x12 * x54 + p[4] * x62; g[8] = x32 * x37 + x12 * x53 + p[5] * x62;
}

static double curved_wrench(const double *d, const double *p, double *W)
{
    const double x0 = p[1] * d[0] + p[2] * d[1] + p[3] * d[2], x1 = p[0] * (d[0] - p[1] * x0),
    x2 = p[0] * (d[1] - p[2] * x0), x3 = p[0] * (d[2] - p[3] * x0), x4 = sqrt(x1 * x1 + x2 * x2 + x3 * x3),
    x5 = 1.0 / x4, x6 = x1 * x5, x7 = x2 * x5, x8 = x3 * x5, x9 = d[3] * x6 + d[4] * x7 + d[5] * x8,
    x10 = d[3] - x6 * x9, x11 = d[4] - x7 * x9, x12 = d[5] - x8 * x9,
    x13 = 1.0 / sqrt(x10 * x10 + x11 * x11 + x12 * x12), x14 = x10 * x13, x15 = x12 * x13, x16 = x11 * x13,
    x17 = p[5] * x14 + p[6] * (x7 * x15 - x8 * x16) + p[7] * x6,
    x18 = p[5] * x16 + p[6] * (x8 * x14 - x6 * x15) + p[7] * x7,
    x19 = p[5] * x15 + p[6] * (x6 * x16 - x7 * x14) + p[7] * x8, x20 = p[4] * x7, x21 = p[4] * x8, x22 = p[4] * x6;
    W[0] = x17; W[1] = x18; W[2] = x19; W[3] = x18 * x21 - x19 * x20 + p[8] * x6;
    W[4] = x19 * x22 - x17 * x21 + p[8] * x7; W[5] = x17 * x20 - x18 * x22 + p[8] * x8; return x4;
}

static void curved_rates(const double *d, const double *e, const double *p, double *W, double *Wd)
{
    const double x0 = p[1] * d[0] + p[2] * d[1] + p[3] * d[2], x1 = p[0] * (d[0] - p[1] * x0),
    x2 = p[0] * (d[1] - p[2] * x0), x3 = p[0] * (d[2] - p[3] * x0), x4 = 1.0 / sqrt(x1 * x1 + x2 * x2 + x3 * x3),
    x5 = x1 * x4, x6 = x2 * x4, x7 = x3 * x4, x8 = d[3] * x5 + d[4] * x6 + d[5] * x7, x9 = d[3] - x5 * x8,
    x10 = d[4] - x6 * x8, x11 = d[5] - x7 * x8, x12 = 1.0 / sqrt(x9 * x9 + x10 * x10 + x11 * x11), x13 = x9 * x12,
    x14 = x11 * x12, x15 = x10 * x12, x16 = p[5] * x13 + p[6] * (x6 * x14 - x7 * x15) + p[7] * x5,
    x17 = p[5] * x15 + p[6] * (x7 * x13 - x5 * x14) + p[7] * x6,
    x18 = p[5] * x14 + p[6] * (x5 * x15 - x6 * x13) + p[7] * x7, x19 = p[4] * x6, x20 = p[4] * x7, x21 = p[4] * x5,
    x22 = p[1] * e[0] + p[2] * e[1] + p[3] * e[2], x23 = p[0] * (e[0] - p[1] * x22), x24 = p[0] * (e[1] - p[2] * x22),
    x25 = p[0] * (e[2] - p[3] * x22), x26 = (2.0 * x1 * x23 + 2.0 * x2 * x24 + 2.0 * x3 * x25) * 0.5 * x4 * x4 * x4,
    x27 = x4 * x23 - x1 * x26, x28 = x4 * x24 - x2 * x26, x29 = x4 * x25 - x3 * x26,
    x30 = e[3] * x5 + d[3] * x27 + e[4] * x6 + d[4] * x28 + e[5] * x7 + d[5] * x29, x31 = e[3] - (x8 * x27 + x5 * x30),
    x32 = e[4] - (x8 * x28 + x6 * x30), x33 = e[5] - (x8 * x29 + x7 * x30),
    x34 = (2.0 * x9 * x31 + 2.0 * x10 * x32 + 2.0 * x11 * x33) * 0.5 * x12 * x12 * x12, x35 = x12 * x31 - x9 * x34,
    x36 = x12 * x33 - x11 * x34, x37 = x12 * x32 - x10 * x34,
    x38 = p[5] * x35 + p[6] * (x14 * x28 + x6 * x36 - (x15 * x29 + x7 * x37)) + p[7] * x27,
    x39 = p[5] * x37 + p[6] * (x13 * x29 + x7 * x35 - (x14 * x27 + x5 * x36)) + p[7] * x28,
    x40 = p[5] * x36 + p[6] * (x15 * x27 + x5 * x37 - (x13 * x28 + x6 * x35)) + p[7] * x29, x41 = p[4] * x28,
    x42 = p[4] * x29, x43 = p[4] * x27; W[0] = x16; W[1] = x17; W[2] = x18; W[3] = x17 * x20 - x18 * x19 + p[8] * x5;
    W[4] = x18 * x21 - x16 * x20 + p[8] * x6; W[5] = x16 * x19 - x17 * x21 + p[8] * x7; Wd[0] = x38; Wd[1] = x39;
    Wd[2] = x40; Wd[3] = x20 * x39 + x17 * x42 - (x19 * x40 + x18 * x41) + p[8] * x27;
    Wd[4] = x21 * x40 + x18 * x43 - (x20 * x38 + x16 * x42) + p[8] * x28;
    Wd[5] = x19 * x38 + x16 * x41 - (x21 * x39 + x17 * x43) + p[8] * x29;
}

static void curved_slopes(const double *d, const double *e, const double *p, const double *V, const double *A, double *W, double *Wd, double *k, double *g)
{
    const double x0 = p[1] * d[0] + p[2] * d[1] + p[3] * d[2], x1 = p[0] * (d[0] - p[1] * x0),
    x2 = p[0] * (d[1] - p[2] * x0), x3 = p[0] * (d[2] - p[3] * x0), x4 = 1.0 / sqrt(x1 * x1 + x2 * x2 + x3 * x3),
    x5 = x1 * x4, x6 = x2 * x4, x7 = x3 * x4, x8 = d[3] * x5 + d[4] * x6 + d[5] * x7, x9 = d[3] - x5 * x8,
    x10 = d[4] - x6 * x8, x11 = d[5] - x7 * x8, x12 = 1.0 / sqrt(x9 * x9 + x10 * x10 + x11 * x11), x13 = x9 * x12,
    x14 = x11 * x12, x15 = x10 * x12, x16 = p[5] * x13 + p[6] * (x6 * x14 - x7 * x15) + p[7] * x5,
    x17 = p[5] * x15 + p[6] * (x7 * x13 - x5 * x14) + p[7] * x6,
    x18 = p[5] * x14 + p[6] * (x5 * x15 - x6 * x13) + p[7] * x7, x19 = p[4] * x6, x20 = p[4] * x7, x21 = p[4] * x5,
    x22 = p[1] * e[0] + p[2] * e[1] + p[3] * e[2], x23 = p[0] * (e[0] - p[1] * x22), x24 = p[0] * (e[1] - p[2] * x22),
    x25 = p[0] * (e[2] - p[3] * x22), x26 = 2.0 * x1 * x23 + 2.0 * x2 * x24 + 2.0 * x3 * x25, x27 = 0.5 * x4,
    x28 = x26 * x27, x29 = x4 * x4, x30 = x28 * x29, x31 = x4 * x23 - x1 * x30, x32 = x4 * x24 - x2 * x30,
    x33 = x4 * x25 - x3 * x30, x34 = e[3] * x5 + d[3] * x31 + e[4] * x6 + d[4] * x32 + e[5] * x7 + d[5] * x33,
    x35 = e[3] - (x8 * x31 + x5 * x34), x36 = e[4] - (x8 * x32 + x6 * x34), x37 = e[5] - (x8 * x33 + x7 * x34),
    x38 = 2.0 * x9 * x35 + 2.0 * x10 * x36 + 2.0 * x11 * x37, x39 = 0.5 * x12, x40 = x38 * x39, x41 = x12 * x12,
    x42 = x40 * x41, x43 = x12 * x35 - x9 * x42, x44 = x12 * x37 - x11 * x42, x45 = x12 * x36 - x10 * x42,
    x46 = p[5] * x43 + p[6] * (x14 * x32 + x6 * x44 - (x15 * x33 + x7 * x45)) + p[7] * x31,
    x47 = p[5] * x45 + p[6] * (x13 * x33 + x7 * x43 - (x14 * x31 + x5 * x44)) + p[7] * x32,
    x48 = p[5] * x44 + p[6] * (x15 * x31 + x5 * x45 - (x13 * x32 + x6 * x43)) + p[7] * x33, x49 = p[4] * x32,
    x50 = p[4] * x33, x51 = p[4] * x31, x52 = V[2] + V[4] * x21 - V[3] * x19, x53 = V[1] + V[3] * x20 - V[5] * x21,
    x54 = p[6] * x53, x55 = V[0] + V[5] * x19 - V[4] * x20, x56 = p[6] * x55,
    x57 = V[5] * p[8] + p[4] * (V[3] * x17 - V[4] * x16) + p[7] * x52 + x13 * x54 - x15 * x56, x58 = p[6] * x52,
    x59 = x5 * x58 + p[5] * x53 - x7 * x56, x60 = x10 * x59, x61 = p[5] * x52 - x5 * x54 + x6 * x56, x62 = x11 * x61,
    x63 = x7 * x54 - x6 * x58 + p[5] * x55, x64 = x9 * x63, x65 = x39 * x41 * (x60 + x62 + x64), x66 = -x11 * x65,
    x67 = x12 * x61, x68 = x66 + x67 + x66, x69 = -x10 * x65, x70 = x12 * x59, x71 = x69 + x70 + x69, x72 = -x9 * x65,
    x73 = x12 * x63, x74 = x72 + x73 + x72, x75 = -x7 * x68 - x6 * x71 - x5 * x74, x76 = x57 - x8 * x68 + d[5] * x75,
    x77 = V[4] * p[8] + p[4] * (V[5] * x16 - V[3] * x18) - x13 * x58 + p[7] * x53 + x14 * x56,
    x78 = x77 - x8 * x71 + d[4] * x75,
    x79 = p[4] * (V[4] * x18 - V[5] * x17) + V[3] * p[8] + x15 * x58 - x14 * x54 + p[7] * x55,
    x80 = x79 - x8 * x74 + d[3] * x75, x81 = x27 * x29 * (x3 * x76 + x2 * x78 + x1 * x80), x82 = -x1 * x81,
    x83 = p[0] * (x82 + x4 * x80 + x82), x84 = -x3 * x81, x85 = p[0] * (x84 + x4 * x76 + x84), x86 = -x2 * x81,
    x87 = p[0] * (x86 + x4 * x78 + x86), x88 = -p[3] * x85 - p[2] * x87 - p[1] * x83, x89 = -x60 - x62 - x64,
    x90 = x41 * x89, x91 = 2.0 * x39 * x90, x92 = x67 + x11 * x91, x93 = x70 + x10 * x91, x94 = x73 + x9 * x91,
    x95 = -x7 * x92 - x6 * x93 - x5 * x94, x96 = x57 - x8 * x92 + d[5] * x95, x97 = x77 - x8 * x93 + d[4] * x95,
    x98 = x79 + d[3] * x95 - x8 * x94, x99 = -x3 * x96 - x2 * x97 - x1 * x98, x100 = x4 * x28 * x99, x101 = x29 * x99,
    x102 = A[2] + V[4] * x51 - V[3] * x49 + A[4] * x21 - A[3] * x19,
    x103 = A[1] + V[3] * x50 - V[5] * x51 - A[5] * x21 + A[3] * x20, x104 = p[6] * x103,
    x105 = A[0] + V[5] * x49 - V[4] * x50 + A[5] * x19 - A[4] * x20, x106 = p[6] * x105, x107 = x12 * x40 * x89,
    x108 = p[6] * x102, x109 = x31 * x58 - x33 * x56 + x5 * x108 + p[5] * x103 - x7 * x106,
    x110 = x32 * x56 - x31 * x54 + p[5] * x102 - x5 * x104 + x6 * x106,
    x111 = x33 * x54 - x32 * x58 - x6 * x108 + x7 * x104 + p[5] * x105,
    x112 = x39 * x41 * (x107 + x36 * x59 + x37 * x61 + x107 + 0.5 * x38 * x90 + x35 * x63 + x10 * x109 + x11 * x110 + x9 * x111),
    x113 = -x11 * x112, x114 = x113 + x37 * x91 - x42 * x61 + x12 * x110 + x113, x115 = -x10 * x112,
    x116 = x115 + x36 * x91 - x42 * x59 + x12 * x109 + x115, x117 = -x9 * x112,
    x118 = x117 + x35 * x91 - x42 * x63 + x12 * x111 + x117,
    x119 = -x33 * x92 - x32 * x93 - x31 * x94 - x7 * x114 - x6 * x116 - x5 * x118,
    x120 = x43 * x54 - x45 * x56 - x34 * x92 + e[5] * x95 + A[5] * p[8] + p[4] * (V[3] * x47 - V[4] * x46 - A[4] * x16 + A[3] * x17) + p[7] * x102 + x13 * x104 - x15 * x106 - x8 * x114 + d[5] * x119,
    x121 = x44 * x56 - x43 * x58 - x34 * x93 + e[4] * x95 + A[4] * p[8] + p[4] * (V[5] * x46 - V[3] * x48 + A[5] * x16 - A[3] * x18) - x13 * x108 + p[7] * x103 + x14 * x106 - x8 * x116 + d[4] * x119,
    x122 = x45 * x58 - x44 * x54 - x34 * x94 + e[3] * x95 + p[4] * (V[4] * x48 - V[5] * x47 - A[5] * x17 + A[4] * x18) + A[3] * p[8] + x15 * x108 - x14 * x104 + p[7] * x105 - x8 * x118 + d[3] * x119,
    x123 = x27 * x29 * (x100 + x25 * x96 + x24 * x97 + x100 + 0.5 * x26 * x101 + x23 * x98 + x3 * x120 + x2 * x121 + x1 * x122),
    x124 = -x1 * x123, x125 = 2.0 * x27 * x101, x126 = p[0] * (x124 + x23 * x125 - x30 * x98 + x4 * x122 + x124),
    x127 = -x3 * x123, x128 = p[0] * (x127 + x25 * x125 - x30 * x96 + x4 * x120 + x127), x129 = -x2 * x123,
    x130 = p[0] * (x129 + x24 * x125 - x30 * x97 + x4 * x121 + x129), x131 = -p[3] * x128 - p[2] * x130 - p[1] * x126;
    W[0] = x16; W[1] = x17; W[2] = x18; W[3] = x17 * x20 - x18 * x19 + p[8] * x5;
    W[4] = x18 * x21 - x16 * x20 + p[8] * x6; W[5] = x16 * x19 - x17 * x21 + p[8] * x7; Wd[0] = x46; Wd[1] = x47;
    Wd[2] = x48; Wd[3] = x20 * x47 + x17 * x50 - (x19 * x48 + x18 * x49) + p[8] * x31;
    Wd[4] = x21 * x48 + x18 * x51 - (x20 * x46 + x16 * x50) + p[8] * x32;
    Wd[5] = x19 * x46 + x16 * x49 - (x21 * x47 + x17 * x51) + p[8] * x33; k[0] = x83 + p[1] * x88;
    k[1] = x87 + p[2] * x88; k[2] = x85 + p[3] * x88; k[3] = x74 + x5 * x75; k[4] = x71 + x6 * x75;
    k[5] = x68 + x7 * x75; g[0] = x126 + p[1] * x131; g[1] = x130 + p[2] * x131; g[2] = x128 + p[3] * x131;
    g[3] = x31 * x95 + x118 + x5 * x119; g[4] = x32 * x95 + x116 + x6 * x119; g[5] = x33 * x95 + x114 + x7 * x119;
}

static double distance_wrench(const double *d, const double *p, double *W)
{
    (void)p; const double x0 = sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]), x1 = 1.0 / x0; W[0] = d[0] * x1;
    W[1] = d[1] * x1; W[2] = d[2] * x1; W[3] = 0.0; W[4] = 0.0; W[5] = 0.0; return x0;
}

static void distance_rates(const double *d, const double *e, const double *p, double *W, double *Wd)
{
    (void)p; const double x0 = 1.0 / sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]),
    x1 = (2.0 * d[0] * e[0] + 2.0 * d[1] * e[1] + 2.0 * d[2] * e[2]) * 0.5 * x0 * x0 * x0; W[0] = d[0] * x0;
    W[1] = d[1] * x0; W[2] = d[2] * x0; W[3] = 0.0; W[4] = 0.0; W[5] = 0.0; Wd[0] = e[0] * x0 - d[0] * x1;
    Wd[1] = e[1] * x0 - d[1] * x1; Wd[2] = e[2] * x0 - d[2] * x1; Wd[3] = 0.0; Wd[4] = 0.0; Wd[5] = 0.0;
}

static void distance_slopes(const double *d, const double *e, const double *p, const double *V, const double *A, double *W, double *Wd, double *k, double *g)
{
    (void)p; const double x0 = 1.0 / sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]),
    x1 = 2.0 * d[0] * e[0] + 2.0 * d[1] * e[1] + 2.0 * d[2] * e[2], x2 = 0.5 * x0, x3 = x1 * x2, x4 = x0 * x0,
    x5 = x3 * x4, x6 = V[0] * d[0], x7 = V[1] * d[1], x8 = V[2] * d[2], x9 = x2 * x4 * (x6 + x7 + x8),
    x10 = -d[0] * x9, x11 = -d[1] * x9, x12 = -d[2] * x9, x13 = -x8 - x7 - x6, x14 = x0 * x3 * x13, x15 = x4 * x13,
    x16 = x2 * x4 * (A[0] * d[0] + A[1] * d[1] + A[2] * d[2] + V[0] * e[0] + x14 + V[1] * e[1] + V[2] * e[2] + x14 + 0.5 * x1 * x15),
    x17 = -d[0] * x16, x18 = 2.0 * x2 * x15, x19 = -d[1] * x16, x20 = -d[2] * x16; W[0] = d[0] * x0; W[1] = d[1] * x0;
    W[2] = d[2] * x0; W[3] = 0.0; W[4] = 0.0; W[5] = 0.0; Wd[0] = e[0] * x0 - d[0] * x5; Wd[1] = e[1] * x0 - d[1] * x5;
    Wd[2] = e[2] * x0 - d[2] * x5; Wd[3] = 0.0; Wd[4] = 0.0; Wd[5] = 0.0; k[0] = x10 + V[0] * x0 + x10;
    k[1] = x11 + V[1] * x0 + x11; k[2] = x12 + V[2] * x0 + x12; g[0] = x17 + e[0] * x18 - V[0] * x5 + A[0] * x0 + x17;
    g[1] = x19 + e[1] * x18 - V[1] * x5 + A[1] * x0 + x19; g[2] = x20 + e[2] * x18 - V[2] * x5 + A[2] * x0 + x20;
}

static void linkage(const double *d, const double *p, double *W)
{
    const double x0 = p[0] * d[0], x1 = p[1] * d[1], x2 = p[0] * d[1], x3 = p[1] * d[0];
    W[0] = d[1] * d[2] - d[3] * x0 - d[3] * x1; W[1] = d[0] * d[2] + d[3] * x2 - d[3] * x3;
    W[2] = -(d[2] * x0 + d[1] * d[3]) - d[2] * x1; W[3] = d[2] * x2 - d[0] * d[3] - d[2] * x3;
}

static const Kind KINDS[] = {
    [WORLD] = {0, 1e-06, world_wrench, world_rates, world_slopes},
    [OWN] = {2, 1e-06, own_wrench, own_rates, own_slopes},
    [WHEEL] = {1, 1e-06, wheel_wrench, wheel_rates, wheel_slopes},
    [YAW] = {1, 1e-06, yaw_wrench, yaw_rates, yaw_slopes},
    [TILT] = {1, 1e-06, tilt_wrench, tilt_rates, tilt_slopes},
    [ROLLING] = {3, 1e-06, rolling_wrench, rolling_rates, rolling_slopes},
    [CURVED] = {2, 1e-06, curved_wrench, curved_rates, curved_slopes},
    [DISTANCE] = {1, 1e-09, distance_wrench, distance_rates, distance_slopes},
};
