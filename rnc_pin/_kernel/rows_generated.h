/* Written by python -m tools.generate_rows from the formulas in Python: change those. */
/* clang-format off */

#define INTERFACE 45
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
    void (*slopes)(const double *d, const double *e, const double *p, const double *V, const double *A, double *k,
                   double *g);
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

static void world_slopes(const double *d, const double *e, const double *p, const double *V, const double *A, double *k, double *g)
{
    (void)d; (void)e; (void)p; (void)V; (void)A; (void)k; (void)g;
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

static void own_slopes(const double *d, const double *e, const double *p, const double *V, const double *A, double *k, double *g)
{
    (void)d; (void)e; (void)p; k[0] = V[0]; k[1] = V[1]; k[2] = V[2]; k[3] = V[3]; k[4] = V[4]; k[5] = V[5];
    g[0] = A[0]; g[1] = A[1]; g[2] = A[2]; g[3] = A[3]; g[4] = A[4]; g[5] = A[5];
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

static void wheel_slopes(const double *d, const double *e, const double *p, const double *V, const double *A, double *k, double *g)
{
    const double x0 = p[2] * d[0] - p[1] * d[1], x1 = p[3] * d[1] - p[2] * d[2], x2 = p[1] * d[2] - p[3] * d[0],
    x3 = 1.0 / sqrt(x1 * x1 + x2 * x2 + x0 * x0), x4 = x0 * x3, x5 = V[5] * p[6], x6 = x2 * x3, x7 = V[4] * p[6],
    x8 = x1 * x3, x9 = V[3] * p[6], x10 = p[0] * (x4 * x5 + x6 * x7 + x8 * x9), x11 = x3 * 0.5, x12 = x3 * x3,
    x13 = p[0] * (p[1] * d[0] + p[2] * d[1] + p[3] * d[2]), x14 = p[5] * V[2], x15 = p[5] * V[0],
    x16 = x13 * x7 + p[1] * x14 + p[4] * V[1] - p[3] * x15, x17 = x2 * x16, x18 = p[5] * V[1],
    x19 = x13 * x5 + p[4] * V[2] - p[1] * x18 + p[2] * x15, x20 = x0 * x19,
    x21 = x13 * x9 - p[2] * x14 + p[3] * x18 + p[4] * V[0], x22 = x1 * x21, x23 = x11 * x12 * (x17 + x20 + x22),
    x24 = -x0 * x23, x25 = x24 + p[0] * p[5] * V[5] + x3 * x19 + x24, x26 = -x2 * x23,
    x27 = x26 + p[0] * p[5] * V[4] + x3 * x16 + x26, x28 = -x1 * x23, x29 = x28 + p[0] * p[5] * V[3] + x3 * x21 + x28,
    x30 = p[2] * e[0] - p[1] * e[1], x31 = p[3] * e[1] - p[2] * e[2], x32 = p[1] * e[2] - p[3] * e[0],
    x33 = x1 * x31 * 2.0 + 2.0 * x2 * x32 + 2.0 * x0 * x30, x34 = x33 * x11, x35 = x34 * x12, x36 = A[5] * p[6],
    x37 = A[4] * p[6], x38 = A[3] * p[6],
    x39 = p[0] * ((x3 * x30 - x0 * x35) * x5 + (x3 * x32 - x2 * x35) * x7 + (x3 * x31 - x1 * x35) * x9 + x4 * x36 + x6 * x37 + x8 * x38),
    x40 = -x17 - x20 - x22, x41 = x3 * x34 * x40, x42 = x12 * x40,
    x43 = p[0] * (p[1] * e[0] + p[2] * e[1] + p[3] * e[2]), x44 = p[5] * A[2], x45 = p[5] * A[0],
    x46 = x43 * x7 + x13 * x37 + p[1] * x44 + p[4] * A[1] - p[3] * x45, x47 = p[5] * A[1],
    x48 = x43 * x5 + x13 * x36 + p[4] * A[2] - p[1] * x47 + p[2] * x45,
    x49 = x43 * x9 + x13 * x38 - p[2] * x44 + p[3] * x47 + p[4] * A[0],
    x50 = x11 * x12 * (x41 + x32 * x16 + x30 * x19 + x41 + 0.5 * x33 * x42 + x31 * x21 + x2 * x46 + x0 * x48 + x1 * x49),
    x51 = -x0 * x50, x52 = 2.0 * x11 * x42, x53 = x51 + x30 * x52 - x35 * x19 + p[0] * p[5] * A[5] + x3 * x48 + x51,
    x54 = -x2 * x50, x55 = x54 + x32 * x52 - x35 * x16 + p[0] * p[5] * A[4] + x3 * x46 + x54, x56 = -x1 * x50,
    x57 = x56 + x31 * x52 - x35 * x21 + p[0] * p[5] * A[3] + x3 * x49 + x56;
    k[0] = p[1] * x10 - p[0] * p[4] * V[3] + p[2] * x25 - p[3] * x27;
    k[1] = p[2] * x10 - p[0] * p[4] * V[4] - p[1] * x25 + p[3] * x29;
    k[2] = p[3] * x10 - p[0] * p[4] * V[5] + p[1] * x27 - p[2] * x29;
    g[0] = p[1] * x39 - p[0] * p[4] * A[3] + p[2] * x53 - p[3] * x55;
    g[1] = p[2] * x39 - p[0] * p[4] * A[4] - p[1] * x53 + p[3] * x57;
    g[2] = p[3] * x39 - p[0] * p[4] * A[5] + p[1] * x55 - p[2] * x57;
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

static void yaw_slopes(const double *d, const double *e, const double *p, const double *V, const double *A, double *k, double *g)
{
    (void)p; const double x0 = 1.0 / (d[0] * d[0] + d[1] * d[1]), x1 = x0 * x0, x2 = d[1] * d[2], x3 = V[4] * x2,
    x4 = d[0] * d[2], x5 = V[3] * x4, x6 = x1 * (-x3 - x5), x7 = V[3] * x0, x8 = -d[1] * x6, x9 = V[4] * x0,
    x10 = 2.0 * d[0] * e[0] + 2.0 * d[1] * e[1], x11 = x3 + x5, x12 = x0 * x10 * x11,
    x13 = x1 * (x12 + x12 - V[4] * (d[2] * e[1] + d[1] * e[2]) - V[3] * (d[2] * e[0] + d[0] * e[2]) - A[4] * x2 - A[3] * x4),
    x14 = -d[0] * x13, x15 = 2.0 * x1 * x11, x16 = x10 * x1, x17 = V[3] * x16 - A[3] * x0, x18 = -d[1] * x13,
    x19 = V[4] * x16 - A[4] * x0; k[0] = -2.0 * d[0] * x6 - d[2] * x7; k[1] = x8 + x8 - d[2] * x9;
    k[2] = -d[1] * x9 - d[0] * x7; g[0] = x14 + e[0] * x15 - e[2] * x7 + x14 + d[2] * x17;
    g[1] = x18 + e[1] * x15 - e[2] * x9 + d[2] * x19 + x18; g[2] = d[1] * x19 - e[1] * x9 - e[0] * x7 + d[0] * x17;
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

static void tilt_slopes(const double *d, const double *e, const double *p, const double *V, const double *A, double *k, double *g)
{
    (void)p; const double x0 = 1.0 / sqrt(d[0] * d[0] + d[1] * d[1]), x1 = 0.5 * x0, x2 = x0 * x0, x3 = V[4] * d[0],
    x4 = V[3] * d[1], x5 = x1 * x2 * (x4 - x3), x6 = -d[0] * x5, x7 = -d[1] * x5,
    x8 = 2.0 * d[0] * e[0] + 2.0 * d[1] * e[1], x9 = x8 * x1, x10 = x3 - x4, x11 = x0 * x9 * x10, x12 = x2 * x10,
    x13 = x1 * x2 * (x11 + x11 - V[4] * e[0] + 0.5 * x8 * x12 + V[3] * e[1] - A[4] * d[0] + A[3] * d[1]),
    x14 = -d[0] * x13, x15 = x9 * x2, x16 = 2.0 * x1 * x12, x17 = -d[1] * x13; k[0] = x6 + x6 - V[4] * x0;
    k[1] = x7 + V[3] * x0 + x7; k[2] = 0.0; g[0] = x14 + V[4] * x15 + e[0] * x16 - A[4] * x0 + x14;
    g[1] = x17 + e[1] * x16 - V[3] * x15 + A[3] * x0 + x17; g[2] = 0.0;
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

static void rolling_slopes(const double *d, const double *e, const double *p, const double *V, const double *A, double *k, double *g)
{
    const double x0 = p[3] * d[0] + p[4] * d[1] + p[5] * d[2], x1 = p[6] * x0, x2 = p[9] * x1,
    x3 = p[3] * d[6] + p[4] * d[7] + p[5] * d[8], x4 = p[8] * x3, x5 = p[3] * d[3] + p[4] * d[4] + p[5] * d[5],
    x6 = p[7] * x5, x7 = 1.0 / sqrt(x3 * x4 + x0 * x1 + x5 * x6), x8 = -x2 * x7 - p[10] * x0,
    x9 = p[1] * V[5] - p[2] * V[4], x10 = p[0] * V[4] - p[1] * V[3], x11 = p[2] * V[3] - p[0] * V[5],
    x12 = d[0] * x9 + d[2] * x10 + d[1] * x11, x13 = 0.5 * x7, x14 = x7 * x7, x15 = p[9] * x4,
    x16 = d[6] * x9 + d[8] * x10 + d[7] * x11, x17 = x15 * x16, x18 = p[9] * x6,
    x19 = d[3] * x9 + d[5] * x10 + d[4] * x11, x20 = x18 * x19, x21 = x2 * x12, x22 = x13 * x14 * (-x17 - x20 - x21),
    x23 = p[6] * (-x0 * x22 - p[9] * x7 * x12) - p[10] * x12 - x1 * x22, x24 = -x18 * x7 - p[10] * x5,
    x25 = p[7] * (-p[9] * x7 * x19 - x5 * x22) - p[10] * x19 - x6 * x22, x26 = -x15 * x7 - p[10] * x3,
    x27 = p[8] * (-p[9] * x7 * x16 - x3 * x22) - p[10] * x16 - x4 * x22, x28 = p[3] * e[0] + p[4] * e[1] + p[5] * e[2],
    x29 = p[6] * x28, x30 = p[9] * x29, x31 = p[3] * e[6] + p[4] * e[7] + p[5] * e[8], x32 = p[8] * x31,
    x33 = p[3] * e[3] + p[4] * e[4] + p[5] * e[5], x34 = p[7] * x33,
    x35 = x4 * x31 + x3 * x32 + x1 * x28 + x0 * x29 + x6 * x33 + x5 * x34, x36 = x35 * x13, x37 = x36 * x14,
    x38 = -(x7 * x30 - x2 * x37) - p[10] * x28, x39 = p[1] * A[5] - p[2] * A[4], x40 = x21 + x17 + x20,
    x41 = x14 * x40, x42 = x13 * x41, x43 = p[0] * A[4] - p[1] * A[3], x44 = p[2] * A[3] - p[0] * A[5],
    x45 = e[0] * x9 + e[2] * x10 + e[1] * x11 + d[0] * x39 + d[2] * x43 + d[1] * x44, x46 = x7 * x36 * x40,
    x47 = p[9] * x32, x48 = p[9] * x34,
    x49 = e[6] * x9 + e[8] * x10 + e[7] * x11 + d[6] * x39 + d[8] * x43 + d[7] * x44,
    x50 = e[3] * x9 + e[5] * x10 + e[4] * x11 + d[3] * x39 + d[5] * x43 + d[4] * x44,
    x51 = x13 * x14 * (x46 + x46 - x47 * x16 - x48 * x19 + 0.5 * x35 * x41 - x30 * x12 - x15 * x49 - x18 * x50 - x2 * x45),
    x52 = x29 * x42 - p[10] * x45 - x1 * x51 + p[6] * (x28 * x42 - x0 * x51 + p[9] * (x37 * x12 - x7 * x45)),
    x53 = -(x7 * x48 - x18 * x37) - p[10] * x33,
    x54 = x34 * x42 - p[10] * x50 - x6 * x51 + p[7] * (x33 * x42 + p[9] * (x37 * x19 - x7 * x50) - x5 * x51),
    x55 = -(x7 * x47 - x15 * x37) - p[10] * x31,
    x56 = x32 * x42 - p[10] * x49 - x4 * x51 + p[8] * (x31 * x42 + p[9] * (x37 * x16 - x7 * x49) - x3 * x51);
    k[0] = x8 * x9 + p[3] * x23; k[1] = x8 * x11 + p[4] * x23; k[2] = x8 * x10 + p[5] * x23;
    k[3] = x24 * x9 + p[3] * x25; k[4] = x24 * x11 + p[4] * x25; k[5] = x24 * x10 + p[5] * x25;
    k[6] = x26 * x9 + p[3] * x27; k[7] = x26 * x11 + p[4] * x27; k[8] = x26 * x10 + p[5] * x27;
    g[0] = x38 * x9 + x8 * x39 + p[3] * x52; g[1] = x38 * x11 + x8 * x44 + p[4] * x52;
    g[2] = x38 * x10 + x8 * x43 + p[5] * x52; g[3] = x53 * x9 + x24 * x39 + p[3] * x54;
    g[4] = x53 * x11 + x24 * x44 + p[4] * x54; g[5] = x53 * x10 + x24 * x43 + p[5] * x54;
    g[6] = x55 * x9 + x26 * x39 + p[3] * x56; g[7] = x55 * x11 + x26 * x44 + p[4] * x56;
    g[8] = x55 * x10 + x26 * x43 + p[5] * x56;
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

static void curved_slopes(const double *d, const double *e, const double *p, const double *V, const double *A, double *k, double *g)
{
    const double x0 = p[1] * d[0] + p[2] * d[1] + p[3] * d[2], x1 = p[0] * (d[0] - p[1] * x0),
    x2 = p[0] * (d[1] - p[2] * x0), x3 = p[0] * (d[2] - p[3] * x0), x4 = 1.0 / sqrt(x1 * x1 + x2 * x2 + x3 * x3),
    x5 = 0.5 * x4, x6 = x4 * x4, x7 = x1 * x4, x8 = x2 * x4, x9 = x3 * x4, x10 = d[3] * x7 + d[4] * x8 + d[5] * x9,
    x11 = d[3] - x7 * x10, x12 = d[4] - x8 * x10, x13 = d[5] - x9 * x10,
    x14 = 1.0 / sqrt(x11 * x11 + x12 * x12 + x13 * x13), x15 = x11 * x14, x16 = x13 * x14, x17 = x12 * x14,
    x18 = p[5] * x15 + p[6] * (x8 * x16 - x9 * x17) + p[7] * x7,
    x19 = p[5] * x17 + p[6] * (x9 * x15 - x7 * x16) + p[7] * x8, x20 = p[4] * x7, x21 = p[4] * x8,
    x22 = V[2] + V[4] * x20 - V[3] * x21, x23 = p[4] * x9, x24 = V[1] + V[3] * x23 - V[5] * x20, x25 = p[6] * x24,
    x26 = V[0] + V[5] * x21 - V[4] * x23, x27 = p[6] * x26,
    x28 = V[5] * p[8] + p[4] * (V[3] * x19 - V[4] * x18) + p[7] * x22 + x15 * x25 - x17 * x27, x29 = 0.5 * x14,
    x30 = x14 * x14, x31 = p[6] * x22, x32 = x7 * x31 + p[5] * x24 - x9 * x27, x33 = x12 * x32,
    x34 = p[5] * x22 - x7 * x25 + x8 * x27, x35 = x13 * x34, x36 = x9 * x25 - x8 * x31 + p[5] * x26, x37 = x11 * x36,
    x38 = x29 * x30 * (x33 + x35 + x37), x39 = -x13 * x38, x40 = x14 * x34, x41 = x39 + x40 + x39, x42 = -x12 * x38,
    x43 = x14 * x32, x44 = x42 + x43 + x42, x45 = -x11 * x38, x46 = x14 * x36, x47 = x45 + x46 + x45,
    x48 = -x9 * x41 - x8 * x44 - x7 * x47, x49 = x28 - x10 * x41 + d[5] * x48,
    x50 = p[5] * x16 + p[6] * (x7 * x17 - x8 * x15) + p[7] * x9,
    x51 = V[4] * p[8] + p[4] * (V[5] * x18 - V[3] * x50) - x15 * x31 + p[7] * x24 + x16 * x27,
    x52 = x51 - x10 * x44 + d[4] * x48,
    x53 = p[4] * (V[4] * x50 - V[5] * x19) + V[3] * p[8] + x17 * x31 - x16 * x25 + p[7] * x26,
    x54 = x53 - x10 * x47 + d[3] * x48, x55 = x5 * x6 * (x3 * x49 + x2 * x52 + x1 * x54), x56 = -x1 * x55,
    x57 = p[0] * (x56 + x4 * x54 + x56), x58 = -x3 * x55, x59 = p[0] * (x58 + x4 * x49 + x58), x60 = -x2 * x55,
    x61 = p[0] * (x60 + x4 * x52 + x60), x62 = -p[3] * x59 - p[2] * x61 - p[1] * x57,
    x63 = p[1] * e[0] + p[2] * e[1] + p[3] * e[2], x64 = p[0] * (e[0] - p[1] * x63), x65 = p[0] * (e[1] - p[2] * x63),
    x66 = p[0] * (e[2] - p[3] * x63), x67 = 2.0 * x1 * x64 + 2.0 * x2 * x65 + 2.0 * x3 * x66, x68 = x67 * x5,
    x69 = -x33 - x35 - x37, x70 = x30 * x69, x71 = 2.0 * x29 * x70, x72 = x40 + x13 * x71, x73 = x43 + x12 * x71,
    x74 = x46 + x11 * x71, x75 = -x9 * x72 - x8 * x73 - x7 * x74, x76 = x28 - x10 * x72 + d[5] * x75,
    x77 = x51 - x10 * x73 + d[4] * x75, x78 = x53 + d[3] * x75 - x10 * x74, x79 = -x3 * x76 - x2 * x77 - x1 * x78,
    x80 = x4 * x68 * x79, x81 = x6 * x79, x82 = x68 * x6, x83 = x4 * x64 - x1 * x82, x84 = x4 * x65 - x2 * x82,
    x85 = x4 * x66 - x3 * x82, x86 = e[3] * x7 + d[3] * x83 + e[4] * x8 + d[4] * x84 + e[5] * x9 + d[5] * x85,
    x87 = e[3] - (x10 * x83 + x7 * x86), x88 = e[4] - (x10 * x84 + x8 * x86), x89 = e[5] - (x10 * x85 + x9 * x86),
    x90 = 2.0 * x11 * x87 + 2.0 * x12 * x88 + 2.0 * x13 * x89, x91 = x90 * x29, x92 = x91 * x30,
    x93 = x14 * x87 - x11 * x92, x94 = x14 * x88 - x12 * x92, x95 = x14 * x89 - x13 * x92,
    x96 = p[5] * x93 + p[6] * (x16 * x84 + x8 * x95 - (x17 * x85 + x9 * x94)) + p[7] * x83,
    x97 = p[5] * x94 + p[6] * (x15 * x85 + x9 * x93 - (x16 * x83 + x7 * x95)) + p[7] * x84, x98 = p[4] * x83,
    x99 = p[4] * x84, x100 = A[2] + V[4] * x98 - V[3] * x99 + A[4] * x20 - A[3] * x21, x101 = p[4] * x85,
    x102 = A[1] + V[3] * x101 - V[5] * x98 - A[5] * x20 + A[3] * x23, x103 = p[6] * x102,
    x104 = A[0] + V[5] * x99 - V[4] * x101 + A[5] * x21 - A[4] * x23, x105 = p[6] * x104, x106 = x14 * x91 * x69,
    x107 = p[6] * x100, x108 = x83 * x31 - x85 * x27 + x7 * x107 + p[5] * x102 - x9 * x105,
    x109 = x84 * x27 - x83 * x25 + p[5] * x100 - x7 * x103 + x8 * x105,
    x110 = x85 * x25 - x84 * x31 - x8 * x107 + x9 * x103 + p[5] * x104,
    x111 = x29 * x30 * (x106 + x88 * x32 + x89 * x34 + x106 + 0.5 * x90 * x70 + x87 * x36 + x12 * x108 + x13 * x109 + x11 * x110),
    x112 = -x13 * x111, x113 = x112 + x89 * x71 - x92 * x34 + x14 * x109 + x112, x114 = -x12 * x111,
    x115 = x114 + x88 * x71 - x92 * x32 + x14 * x108 + x114, x116 = -x11 * x111,
    x117 = x116 + x87 * x71 - x92 * x36 + x14 * x110 + x116,
    x118 = -x85 * x72 - x84 * x73 - x83 * x74 - x9 * x113 - x8 * x115 - x7 * x117,
    x119 = x93 * x25 - x94 * x27 - x86 * x72 + e[5] * x75 + A[5] * p[8] + p[4] * (V[3] * x97 - V[4] * x96 - A[4] * x18 + A[3] * x19) + p[7] * x100 + x15 * x103 - x17 * x105 - x10 * x113 + d[5] * x118,
    x120 = p[5] * x95 + p[6] * (x17 * x83 + x7 * x94 - (x15 * x84 + x8 * x93)) + p[7] * x85,
    x121 = x95 * x27 - x93 * x31 - x86 * x73 + e[4] * x75 + A[4] * p[8] + p[4] * (V[5] * x96 - V[3] * x120 + A[5] * x18 - A[3] * x50) - x15 * x107 + p[7] * x102 + x16 * x105 - x10 * x115 + d[4] * x118,
    x122 = x94 * x31 - x95 * x25 - x86 * x74 + e[3] * x75 + p[4] * (V[4] * x120 - V[5] * x97 - A[5] * x19 + A[4] * x50) + A[3] * p[8] + x17 * x107 - x16 * x103 + p[7] * x104 - x10 * x117 + d[3] * x118,
    x123 = x5 * x6 * (x80 + x66 * x76 + x65 * x77 + x80 + 0.5 * x67 * x81 + x64 * x78 + x3 * x119 + x2 * x121 + x1 * x122),
    x124 = -x1 * x123, x125 = 2.0 * x5 * x81, x126 = p[0] * (x124 + x64 * x125 - x82 * x78 + x4 * x122 + x124),
    x127 = -x3 * x123, x128 = p[0] * (x127 + x66 * x125 - x82 * x76 + x4 * x119 + x127), x129 = -x2 * x123,
    x130 = p[0] * (x129 + x65 * x125 - x82 * x77 + x4 * x121 + x129), x131 = -p[3] * x128 - p[2] * x130 - p[1] * x126;
    k[0] = x57 + p[1] * x62; k[1] = x61 + p[2] * x62; k[2] = x59 + p[3] * x62; k[3] = x47 + x7 * x48;
    k[4] = x44 + x8 * x48; k[5] = x41 + x9 * x48; g[0] = x126 + p[1] * x131; g[1] = x130 + p[2] * x131;
    g[2] = x128 + p[3] * x131; g[3] = x83 * x75 + x117 + x7 * x118; g[4] = x84 * x75 + x115 + x8 * x118;
    g[5] = x85 * x75 + x113 + x9 * x118;
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

static void distance_slopes(const double *d, const double *e, const double *p, const double *V, const double *A, double *k, double *g)
{
    (void)p; const double x0 = 1.0 / sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]), x1 = 0.5 * x0, x2 = x0 * x0,
    x3 = V[0] * d[0], x4 = V[1] * d[1], x5 = V[2] * d[2], x6 = x1 * x2 * (x3 + x4 + x5), x7 = -d[0] * x6,
    x8 = -d[1] * x6, x9 = -d[2] * x6, x10 = 2.0 * d[0] * e[0] + 2.0 * d[1] * e[1] + 2.0 * d[2] * e[2], x11 = x10 * x1,
    x12 = -x5 - x4 - x3, x13 = x0 * x11 * x12, x14 = x2 * x12,
    x15 = x1 * x2 * (A[0] * d[0] + A[1] * d[1] + A[2] * d[2] + V[0] * e[0] + x13 + V[1] * e[1] + V[2] * e[2] + x13 + 0.5 * x10 * x14),
    x16 = -d[0] * x15, x17 = x11 * x2, x18 = 2.0 * x1 * x14, x19 = -d[1] * x15, x20 = -d[2] * x15;
    k[0] = x7 + V[0] * x0 + x7; k[1] = x8 + V[1] * x0 + x8; k[2] = x9 + V[2] * x0 + x9;
    g[0] = x16 + e[0] * x18 - V[0] * x17 + A[0] * x0 + x16; g[1] = x19 + e[1] * x18 - V[1] * x17 + A[1] * x0 + x19;
    g[2] = x20 + e[2] * x18 - V[2] * x17 + A[2] * x0 + x20;
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
