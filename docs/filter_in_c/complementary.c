/* complementary.c: gravity and heading error with one gain */
#include <math.h>

void update(double *q, double kp, double dt, const double *gyr, const double *acc, const double *mag)
{
    const double w = q[0], x = q[1], y = q[2], z = q[3];
    const double down[3] = {2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)};
    const double north[3] = {1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)};
    const double east[3] = {2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)};
    const double g = 9.80665;
    double rate[3], heading = 0, hx = 0, hy = 0, square = 0;

    for (int i = 0; i < 3; i++) {
        hx += north[i] * mag[i];
        hy += east[i] * mag[i];
    }
    if (hx != 0 || hy != 0)
        heading = -hy / sqrt(hx * hx + hy * hy);
    for (int i = 0; i < 3; i++) {
        const int j = (i + 1) % 3, k = (i + 2) % 3;
        const double tilt = (acc[k] * down[j] - acc[j] * down[k]) / g; /* (-f/g) x d */
        rate[i] = gyr[i] + kp * (tilt + heading * down[i]);
        square += rate[i] * rate[i];
    }
    const double half = 0.5 * dt * sqrt(square), c = cos(half), s = half > 0 ? 0.5 * dt * sin(half) / half : 0.5 * dt;
    const double a = s * rate[0], b = s * rate[1], d = s * rate[2];
    q[0] = c * w - a * x - b * y - d * z;
    q[1] = c * x + a * w + d * y - b * z;
    q[2] = c * y + b * w + a * z - d * x;
    q[3] = c * z + d * w + b * x - a * y;
    const double norm = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    for (int i = 0; i < 4; i++)
        q[i] /= norm;
}

void update_all(double *q, double kp, int n, const double *t, const double *gyr, const double *acc, const double *mag)
{
    for (int k = 1; k < n; k++) {
        for (int i = 0; i < 4; i++)
            q[4 * k + i] = q[4 * (k - 1) + i];
        /* the vectors of the attitude that they are compared with */
        update(q + 4 * k, kp, t[k] - t[k - 1], gyr + 3 * k, acc + 3 * (k - 1), mag + 3 * (k - 1));
    }
}
