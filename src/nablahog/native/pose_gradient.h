// Poses: the rotation that they mean, and gradients with respect to them.
#pragma once

#include <array>
#include <cmath>
#include <numbers>

#include "vec.h"
#include "workspace.h"

namespace nablahog::rendering {

// Azimuth, elevation, distance, theta, x, y: degrees, units of the mesh, pixels
using Pose = std::array<double, 6>;

constexpr double degree = std::numbers::pi / 180;

// From the object's frame to the camera's: rows are the camera's axes right, down and forward
using Rotation = std::array<std::array<double, 3>, 3>;

inline Rotation rotation(const Pose& pose) {
  const double sa = std::sin(pose[0] * degree), ca = std::cos(pose[0] * degree);
  const double se = std::sin(pose[1] * degree), ce = std::cos(pose[1] * degree);
  const double st = std::sin(pose[3] * degree), ct = std::cos(pose[3] * degree);
  const double right[] = {ca, sa, 0}, down[] = {se * sa, -se * ca, -ce};
  Rotation axes;
  for (int k = 0; k < 3; ++k) {
    axes[0][k] = ct * right[k] + st * down[k];
    axes[1][k] = ct * down[k] - st * right[k];
  }
  axes[2] = {-ce * sa, ce * ca, -se};
  return axes;
}

// Moments [m][n] = Σ over pixels of grad_image · channel · x^m · y^n, the ray through a pixel's middle being (x, y, 1).
// grad_image, channel: (height, width); powers: (3, width), of x.
template <class T>
std::array<std::array<double, 3>, 3> moments(const T* grad_image, const T* channel, int64_t height, int64_t width,
                                             const double* powers, double y, double y_step) {
  using V = Vec<double>;
  using Part = Vec<T, size<V>>;
  std::array<std::array<double, 3>, 3> sums{};
  for (int64_t i = 0; i < height; ++i, grad_image += width, channel += width, y += y_step) {
    V partial[3] = {};
    double row[3] = {};
    int64_t j = 0;
    for (; j + size<V> <= width; j += size<V>) {
      const V part = __builtin_convertvector(load<Part>(grad_image + j) * load<Part>(channel + j), V);
      for (int m = 0; m < 3; ++m) partial[m] += part * load<V>(powers + m * width + j);
    }
    for (; j < width; ++j) {
      for (int m = 0; m < 3; ++m) row[m] += double(grad_image[j] * channel[j]) * powers[m * width + j];
    }
    for (int m = 0; m < 3; ++m) {
      row[m] += sum(partial[m]);
      sums[m][0] += row[m];
      sums[m][1] += row[m] * y;
      sums[m][2] += row[m] * y * y;
    }
  }
  return sums;
}

// Gradient with respect to a pose from that with respect to its image (height, width), and the derivative of the image
// by the motion of surfaces (4, height, width): nablahog/render/camera.py written out.  `focal` is in pixels.
template <class T>
Pose pose_vjp(const T* grad_image, const T* screen_gradient, const Pose& pose, double focal, int64_t height,
              int64_t width) {
  thread_local Workspace memory;
  memory.clear();
  double* powers = memory.zeros<double>(3 * width);
  for (int64_t j = 0; j < width; ++j) {
    const double x = (double(j) + 0.5 - double(width) / 2 - pose[4]) / focal;
    powers[j] = 1;
    powers[width + j] = x;
    powers[2 * width + j] = x * x;
  }
  const double y_first = (0.5 - double(height) / 2 - pose[5]) / focal;
  const auto channel = [&](int k) {
    return moments(grad_image, screen_gradient + k * height * width, height, width, powers, y_first, 1 / focal);
  };
  const auto x = channel(0), x_depth = channel(1), y = channel(2), y_depth = channel(3);
  const double distance = pose[2];
  const double se = std::sin(pose[1] * degree), ce = std::cos(pose[1] * degree);
  const double st = std::sin(pose[3] * degree), ct = std::cos(pose[3] * degree);
  // rotations of the object about its own origin, with the axes of the camera
  const double about_x = -x[1][1] - y[0][0] - y[0][2] + distance * y_depth[0][0];
  const double about_y = x[0][0] + x[2][0] + y[1][1] - distance * x_depth[0][0];
  const double about_z = y[1][0] - x[0][1];
  return {focal * degree * (st * ce * about_x + ct * ce * about_y + se * about_z),
          focal * degree * (ct * about_x - st * about_y),
          -focal * (x_depth[1][0] + y_depth[0][1]),
          -focal * degree * about_z,
          x[0][0],
          y[0][0]};
}

}  // namespace nablahog::rendering
