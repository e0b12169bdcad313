#include "firmware_ekf.hpp"

#include <cmath>

namespace ekf {
namespace {

constexpr float GRAVITY = 9.80665f, PI = 3.14159265f;
constexpr float ALIGN_S = 0.2f, FILTER_S = 0.008f;
constexpr float START_TILT = 0.3f, START_HEADING = 0.5f;  // rad
constexpr uint64_t MAG_US = 50'000, HOLD_US = 100'000, GNSS_LOST_US = 2'000'000, RESET_US = 7'000'000;

float square(float x) { return x * x; }

void cross(const float *a, const float *b, float *out)
{
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

void product(const float *a, const float *b, float *out)
{
    out[0] = a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3];
    out[1] = a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2];
    out[2] = a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1];
    out[3] = a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0];
}

void exponential(const float *angle, float *q)
{
    const float half = 0.5f * std::sqrt(square(angle[0]) + square(angle[1]) + square(angle[2]));
    const float k = half > 1e-6f ? 0.5f * std::sin(half) / half : 0.5f;
    q[0] = std::cos(half);
    for (int i = 0; i < 3; i++)
        q[i + 1] = k * angle[i];
}

void normalize(float *q)
{
    const float norm = std::sqrt(square(q[0]) + square(q[1]) + square(q[2]) + square(q[3]));
    for (int i = 0; i < 4; i++)
        q[i] /= norm;
}

void matrix(const float *q, float R[3][3])
{
    const float w = q[0], x = q[1], y = q[2], z = q[3];
    const float rows[3][3] = {{1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)},
                              {2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)},
                              {2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)}};
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            R[i][j] = rows[i][j];
}

}  // namespace

void Estimator::reset()
{
    const float sigma[N] = {START_TILT, START_TILT, PI, 2.0f, 2.0f, 2.0f, 0.05f, 0.05f, 0.05f};
    for (int i = 0; i < N; i++)
        for (int j = 0; j < N; j++)
            P_[i][j] = i == j ? square(sigma[i]) : 0.0f;
    for (float &one : dx_)
        one = 0.0f;
    for (int i = 0; i < 3; i++)
        v_[i] = b_[i] = rate_[i] = acceleration_[i] = moved_[i] = force_[i] = q_[i + 1] = 0.0f;
    q_[0] = 1.0f;
    matrix(q_, R_);
    turned_s_ = force_s_ = 0.0f;
    time_us_ = mag_fused_us_ = gnss_fused_us_ = held_us_ = 0;
    aligned_ = heading_known_ = gnss_seen_ = has_mag_ = has_gnss_ = false;
}

void Estimator::setImu(const Imu &s)
{
    if (!(s.dt > 0.0f) || s.time_us <= time_us_)
        return;
    time_us_ = s.time_us;
    if (!aligned_) {
        for (int i = 0; i < 3; i++)
            force_[i] += s.delta_velocity[i];
        force_s_ += s.dt;
        return;
    }
    float angle[3], turn[4], q[4], R[3][3], half[3];
    for (int i = 0; i < 3; i++) {
        angle[i] = s.delta_angle[i] - b_[i] * s.dt;
        rate_[i] = angle[i] / s.dt;
    }
    matrix(q_, R);
    cross(angle, s.delta_velocity, half);  // the body turns while it is pushed
    for (int i = 0; i < 3; i++) {
        float gained = 0.0f;
        for (int j = 0; j < 3; j++)
            gained += R[i][j] * (s.delta_velocity[j] + 0.5f * half[j]);
        moved_[i] += gained;
        gained += i == 2 ? GRAVITY * s.dt : 0.0f;
        v_[i] += gained;
        acceleration_[i] = gained / s.dt;
    }
    exponential(angle, turn);
    product(q_, turn, q);
    normalize(q);
    for (int i = 0; i < 4; i++)
        q_[i] = q[i];
    turned_s_ += s.dt;
}

void Estimator::setMag(const Mag &s)
{
    mag_ = s;
    has_mag_ = true;
}

void Estimator::setGnss(const Gnss &s)
{
    gnss_ = s;
    has_gnss_ = true;
}

bool Estimator::update()
{
    if (!aligned_) {
        if (force_s_ >= ALIGN_S)
            align();
        return aligned_;
    }
    if (turned_s_ < FILTER_S)
        return false;
    predictCovariance();
    if (has_mag_ && mag_.time_us >= mag_fused_us_ + MAG_US)
        fuseHeading();
    if (has_gnss_) {
        const bool gated = gnss_seen_ && gnss_.time_us < gnss_fused_us_ + RESET_US;
        const float sigma = std::fmax(gnss_.sigma, par_.velocity_noise);
        const float age = 1e-6f * static_cast<float>(time_us_ - gnss_.time_us);
        if (fuseVelocity(gnss_.velocity, sigma, age, gated)) {
            gnss_seen_ = true;
            gnss_fused_us_ = gnss_.time_us;
        }
        has_gnss_ = false;
    }
    if ((!gnss_seen_ || time_us_ > gnss_fused_us_ + GNSS_LOST_US) && time_us_ >= held_us_ + HOLD_US) {
        const float still[3] = {0.0f, 0.0f, 0.0f};
        fuseVelocity(still, par_.hold_noise, 0.0f, false);
        held_us_ = time_us_;
    }
    return true;
}

void Estimator::align()
{
    const float norm = std::sqrt(square(force_[0]) + square(force_[1]) + square(force_[2]));
    if (norm > 0.5f * GRAVITY * force_s_ && norm < 1.5f * GRAVITY * force_s_) {
        const float roll = 0.5f * std::atan2(-force_[1], -force_[2]);
        const float pitch = 0.5f * std::atan2(force_[0], std::hypot(force_[1], force_[2]));
        q_[0] = std::cos(pitch) * std::cos(roll);
        q_[1] = std::cos(pitch) * std::sin(roll);
        q_[2] = std::sin(pitch) * std::cos(roll);
        q_[3] = -std::sin(pitch) * std::sin(roll);
        matrix(q_, R_);
        aligned_ = true;
        if (has_mag_)
            fuseHeading();
    }
    force_[0] = force_[1] = force_[2] = force_s_ = 0.0f;
}

// F: attitude error -= R bias dt, velocity error += attitude error x (R f) dt, all in earth axes.
void Estimator::predictCovariance()
{
    const float T = turned_s_, *m = moved_;
    const float A[3][3] = {{0, m[2], -m[1]}, {-m[2], 0, m[0]}, {m[1], -m[0], 0}};
    float F[N][N] = {}, FP[N][N];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            F[i][6 + j] = -T * R_[i][j];
            F[3 + i][j] = A[i][j];
        }
    for (int i = 0; i < N; i++)
        F[i][i] = 1.0f;
    for (int i = 0; i < N; i++)
        for (int j = 0; j < N; j++) {
            FP[i][j] = 0.0f;
            for (int k = 0; k < N; k++)
                FP[i][j] += F[i][k] * P_[k][j];
        }
    const float density[3] = {par_.gyro_noise, par_.acc_noise, par_.bias_walk};
    for (int i = 0; i < N; i++)
        for (int j = 0; j <= i; j++) {
            float sum = i == j ? square(density[i / 3]) * T : 0.0f;
            for (int k = 0; k < N; k++)
                sum += FP[i][k] * F[j][k];
            P_[i][j] = P_[j][i] = sum;
        }
    matrix(q_, R_);
    turned_s_ = moved_[0] = moved_[1] = moved_[2] = 0.0f;
}

// The field's angle from the declination, and what an attitude error (earth axes) changes of it: one about down turns
// the field by as much, one about the field's horizontal part by the tangent of the dip.
void Estimator::fuseHeading()
{
    const float age = 1e-6f * static_cast<float>(time_us_ - mag_.time_us);
    float seen[3], turned[3], field[3] = {}, h[N] = {};
    cross(mag_.field, rate_, turned);  // the field as it is seen now, the body having turned since
    for (int i = 0; i < 3; i++)
        seen[i] = mag_.field[i] + age * turned[i];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            field[i] += R_[i][j] * seen[j];
    has_mag_ = false;
    const float level = std::hypot(field[0], field[1]);
    if (!(level > 0.05f * std::fabs(field[2])))  // no heading at the pole, none in a field of zero
        return;
    const float error = std::remainder(par_.declination - std::atan2(field[1], field[0]), 2.0f * PI);
    if (!heading_known_ || mag_.time_us > mag_fused_us_ + RESET_US) {
        const float turn[3] = {0.0f, 0.0f, error};
        turnEarth(turn);
        for (int i = 0; i < N; i++)
            P_[2][i] = P_[i][2] = 0.0f;
        P_[2][2] = square(START_HEADING);
        heading_known_ = true;
        mag_fused_us_ = mag_.time_us;
        return;
    }
    h[0] = -field[2] * field[0] / square(level);
    h[1] = -field[2] * field[1] / square(level);
    h[2] = 1.0f;
    if (fuse(h, error, square(par_.heading_noise), true))
        mag_fused_us_ = mag_.time_us;
    inject();
}

bool Estimator::fuseVelocity(const float *measured, float sigma, float age_s, bool gated)
{
    bool used = true;
    for (int i = 0; i < 3; i++) {
        float h[N] = {};
        h[3 + i] = 1.0f;
        used &= fuse(h, measured[i] + age_s * acceleration_[i] - v_[i], square(sigma), gated);
    }
    inject();
    return used;
}

// A number that the errors change by h; false where the innovation fails the gate.
bool Estimator::fuse(const float *h, float innovation, float variance, bool gated)
{
    float column[N], S = variance;
    for (int i = 0; i < N; i++) {
        column[i] = 0.0f;
        for (int j = 0; j < N; j++)
            column[i] += P_[i][j] * h[j];
        S += h[i] * column[i];
        innovation -= h[i] * dx_[i];
    }
    if (gated && square(innovation) > square(par_.gate) * S)
        return false;
    for (int i = 0; i < N; i++) {
        dx_[i] += column[i] / S * innovation;
        for (int j = 0; j < N; j++)
            P_[i][j] -= column[i] * column[j] / S;
    }
    return true;
}

// What the numbers of one time have found, taken over at once: their order then does not matter.
void Estimator::inject()
{
    turnEarth(dx_);
    for (int i = 0; i < 3; i++) {
        v_[i] += dx_[3 + i];
        b_[i] += dx_[6 + i];
    }
    for (float &one : dx_)
        one = 0.0f;
}

void Estimator::turnEarth(const float *angle)
{
    float turn[4], q[4];
    exponential(angle, turn);
    product(turn, q_, q);
    normalize(q);
    for (int i = 0; i < 4; i++)
        q_[i] = q[i];
    matrix(q_, R_);
}

float Estimator::sigmaTilt() const { return std::sqrt(std::fmax(P_[0][0] + P_[1][1], 0.0f)); }

float Estimator::sigmaHeading() const { return std::sqrt(std::fmax(P_[2][2], 0.0f)); }

}  // namespace ekf
