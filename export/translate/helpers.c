static double squared(double x) { return x * x; }

static double cubed(double x) { return x * x * x; }

static int floor_quotient(int a, int b)
{
    return a / b - (a % b != 0 && (a < 0) != (b < 0));
}

static int floor_remainder(int a, int b)
{
    return a - b * (a / b - (a % b != 0 && (a < 0) != (b < 0)));
}

static double larger(double a, double b) { return b > a ? b : a; }

static int larger_int(int a, int b) { return b > a ? b : a; }

static double smaller(double a, double b) { return b < a ? b : a; }

static int smaller_int(int a, int b) { return b < a ? b : a; }

static void fill(double *a, double value, int count)
{
    int i;
    for (i = 0; i < count; ++i) {
        a[i] = value;
    }
}

static void fill_int(int *a, int value, int count)
{
    int i;
    for (i = 0; i < count; ++i) {
        a[i] = value;
    }
}

static void copy(double *a, const double *b, int count)
{
    int i;
    for (i = 0; i < count; ++i) {
        a[i] = b[i];
    }
}

static void copy_int(int *a, const int *b, int count)
{
    int i;
    for (i = 0; i < count; ++i) {
        a[i] = b[i];
    }
}
