// An error-state Kalman filter of attitude, velocity and gyro bias, as a firmware links it.
// Body axes forward-right-down, earth axes north-east-down; q turns body into earth, Hamilton, scalar first.
// One object per vehicle: no global state, no heap, no clock of its own.
#pragma once
#include <cstdint>

namespace ekf {

struct Imu {
    uint64_t time_us;         // end of the interval
    float delta_angle[3];     // integral of the gyro over dt, rad
    float delta_velocity[3];  // integral of specific force over dt, m/s
    float dt;                 // s
};

struct Mag {
    uint64_t time_us;
    float field[3];  // body, any unit
};

struct Gnss {
    uint64_t time_us;
    float velocity[3];  // NED, true north, m/s
    float sigma;        // m/s, 0 where the receiver tells none
};

struct Parameters {
    float gyro_noise = 0.005f;     // rad/s/sqrt(Hz)
    float acc_noise = 0.5f;        // m/s^2/sqrt(Hz)
    float bias_walk = 2e-4f;       // rad/s/sqrt(s)
    float velocity_noise = 0.3f;   // m/s, at least, of a GNSS velocity
    float hold_noise = 3.0f;       // m/s, spread of velocity about zero without GNSS
    float heading_noise = 0.15f;   // rad, of a magnetometer sample
    float gate = 5.0f;             // sigma
    float declination = 0.0f;      // rad, positive east
};

class Estimator {
public:
    explicit Estimator(const Parameters &parameters) : par_(parameters) { reset(); }
    void reset();

    void setImu(const Imu &sample);    // turns attitude and velocity on
    void setMag(const Mag &sample);    // waits for the next update, the newest wins
    void setGnss(const Gnss &sample);  // likewise
    bool update();                     // true where the filter ran: every 8 ms or slower

    bool aligned() const { return aligned_; }
    const float *quaternion() const { return q_; }  // at the time of the last IMU sample
    const float *velocity() const { return v_; }
    const float *gyroBias() const { return b_; }  // to be subtracted from the gyro, rad/s
    float sigmaTilt() const;                      // rad
    float sigmaHeading() const;                   // rad

private:
    static constexpr int N = 9;  // errors: attitude in earth axes, velocity, bias
    void align();
    void predictCovariance();
    void fuseHeading();
    bool fuseVelocity(const float *measured, float sigma, float age_s, bool gated);
    bool fuse(const float *h, float innovation, float variance, bool gated);
    void inject();
    void turnEarth(const float *angle);

    Parameters par_;
    float q_[4], v_[3], b_[3], P_[N][N], dx_[N];
    float rate_[3], acceleration_[3];       // of the last IMU sample: body rate, earth acceleration
    float R_[3][3], turned_s_, moved_[3];   // since the last covariance: attitude then, time, velocity gained
    float force_[3], force_s_;              // specific force summed up for the alignment
    uint64_t time_us_, mag_fused_us_, gnss_fused_us_, held_us_;
    Mag mag_;
    Gnss gnss_;
    bool aligned_, heading_known_, gnss_seen_, has_mag_, has_gnss_;
};

}  // namespace ekf
