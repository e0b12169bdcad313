// A whole segment of a log through the library, every sample at its own time: all that Python calls.
#include "firmware_ekf.hpp"

namespace {

ekf::Parameters parameters(const double *x)
{
    ekf::Parameters p;
    float *const in_order[] = {&p.gyro_noise, &p.acc_noise, &p.bias_walk, &p.velocity_noise,
                               &p.hold_noise, &p.heading_noise, &p.gate, &p.declination};
    for (float *one : in_order)
        *one = static_cast<float>(*x++);
    return p;
}

void copy(const double *from, float *to, int n = 3)
{
    for (int i = 0; i < n; i++)
        to[i] = static_cast<float>(from[i]);
}

}  // namespace

// Times in us, rising. imu (n, 7): delta angle, delta velocity, dt; mag (m, 3); gnss (k, 4): velocity, sigma.
// out (n, 10): quaternion, bias, sigma of tilt and heading, 1 from the alignment on.
extern "C" void replay(const double *par, long n, const uint64_t *imu_us, const double *imu,
                       long m, const uint64_t *mag_us, const double *mag,
                       long k, const uint64_t *gnss_us, const double *gnss, double *out)
{
    ekf::Estimator filter(parameters(par));  // one for each run
    long next_mag = 0, next_gnss = 0;
    for (long i = 0; i < n; i++, imu += 7, out += 10) {
        ekf::Imu sample{imu_us[i], {}, {}, static_cast<float>(imu[6])};
        copy(imu, sample.delta_angle);
        copy(imu + 3, sample.delta_velocity);
        filter.setImu(sample);
        for (; next_mag < m && mag_us[next_mag] <= imu_us[i]; next_mag++) {
            ekf::Mag one{mag_us[next_mag], {}};
            copy(mag + 3 * next_mag, one.field);
            filter.setMag(one);
        }
        for (; next_gnss < k && gnss_us[next_gnss] <= imu_us[i]; next_gnss++) {
            ekf::Gnss one{gnss_us[next_gnss], {}, static_cast<float>(gnss[4 * next_gnss + 3])};
            copy(gnss + 4 * next_gnss, one.velocity);
            filter.setGnss(one);
        }
        filter.update();
        for (int j = 0; j < 4; j++)
            out[j] = filter.quaternion()[j];
        for (int j = 0; j < 3; j++)
            out[4 + j] = filter.gyroBias()[j];
        out[7] = filter.sigmaTilt();
        out[8] = filter.sigmaHeading();
        out[9] = filter.aligned();
    }
}
