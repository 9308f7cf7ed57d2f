// The loops of pre-images.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numeric>
#include <vector>

#include "interface.h"

namespace nablahog {

// Adds ‖∇i‖ of pixels of a row to `sums`.  ∇i is by the mask [-1, 0, 1]; it is 0 where its square is below `tiny`.
template <class T>
void add_magnitudes(const T* above, const T* row, const T* below, int64_t count, T tiny, T* __restrict sums) {
  for (int64_t x = 0; x < count; ++x) {
    const T u = row[x + 1] - row[x - 1], v = below[x] - above[x], squared = u * u + v * v;
    sums[x] += squared < tiny ? T(0) : std::sqrt(squared);
  }
}

// `factor` · ∇i / ‖∇i‖ of pixels of a row
template <class T>
void directions(const T* above, const T* row, const T* below, int64_t count, T tiny, T factor, T* __restrict along_x,
                T* __restrict along_y) {
  for (int64_t x = 0; x < count; ++x) {
    const T u = row[x + 1] - row[x - 1], v = below[x] - above[x], squared = u * u + v * v;
    const T share = squared < tiny ? T(0) : factor / std::sqrt(squared);
    along_x[x] = share * u;
    along_y[x] = share * v;
  }
}

// Adds √(d² + ρ²) and 1/√(d² + ρ²) to `roots` and `reciprocals`, for the differences d = second - first of pixels.
// `slopes` are d/√(d² + ρ²).
template <class T>
void add_differences(const T* first, const T* second, int64_t count, T rho_squared, T* __restrict roots,
                     T* __restrict reciprocals, T* __restrict slopes) {
  for (int64_t x = 0; x < count; ++x) {
    const T d = second[x] - first[x], root = std::sqrt(d * d + rho_squared), reciprocal = 1 / root;
    slopes[x] = d * reciprocal;
    roots[x] += root;
    reciprocals[x] += reciprocal;
  }
}

// Adds numbers to one row, and subtracts them from another.  The rows may overlap.
template <class T>
void add_difference(const T* __restrict numbers, int64_t count, T* to, T* from) {
  for (int64_t x = 0; x < count; ++x) to[x] += numbers[x];
  for (int64_t x = 0; x < count; ++x) from[x] -= numbers[x];
}

// The default prior of pre-images with its derivative: Σ√(d² + ρ²) over the differences d of neighbours, as a share of
// Σ‖∇i‖, of images (height, width).  Each loop is over a row and has sums of its own for each column, so that compilers
// make vectors of it.
template <class T>
class Smoothness {
 public:
  Smoothness(int64_t height, int64_t width, T tiny)
      : height_(height), width_(width), tiny_(tiny), rows_(3, std::vector<T>(width)) {}

  // The prior of an image; to `grad` its derivative.  ρ is `rounding` times the mean of ‖∇i‖.
  double operator()(const T* image, double rounding, T* grad) {
    const double pixels = double(height_ * width_), visible = gradient_sum(image) / pixels;
    const double scale = visible > 0 ? visible : 1;
    std::fill_n(grad, height_ * width_, T(0));
    const auto [roots, reciprocals] = differences(image, T(rounding * scale), grad);
    const T share = T(1 / (pixels * scale));
    for (int64_t k = 0; k < height_ * width_; ++k) grad[k] *= share;
    if (visible > 0) {
      const double by_scale = rounding * rounding * reciprocals / pixels - roots / (pixels * scale * scale);
      gradient_sum_vjp(image, T(by_scale / pixels), grad);
    }
    return roots / (pixels * scale);
  }

 private:
  struct Sums {
    double roots, reciprocals;
  };

  // Σ‖∇i‖ over the inner pixels
  double gradient_sum(const T* image) {
    T* sums = cleared(0);
    for (int64_t y = 1; y < height_ - 1; ++y) {
      const T* row = image + y * width_ + 1;
      add_magnitudes(row - width_, row, row + width_, width_ - 2, tiny_, sums);
    }
    return total(0);
  }

  // Adds `factor` times the derivative of Σ‖∇i‖.
  void gradient_sum_vjp(const T* image, T factor, T* grad) {
    T *along_x = rows_[0].data(), *along_y = rows_[1].data();
    for (int64_t y = 1; y < height_ - 1; ++y) {
      const T* row = image + y * width_ + 1;
      T* grad_row = grad + y * width_ + 1;
      directions(row - width_, row, row + width_, width_ - 2, tiny_, factor, along_x, along_y);
      add_difference(along_x, width_ - 2, grad_row + 1, grad_row - 1);
      add_difference(along_y, width_ - 2, grad_row + width_, grad_row - width_);
    }
  }

  // Σ√(d² + ρ²), whose derivative is added to `grad`, and Σ1/√(d² + ρ²)
  Sums differences(const T* image, T rho, T* grad) {
    T *roots = cleared(0), *reciprocals = cleared(1), *slopes = rows_[2].data();
    const auto add = [&](int64_t at, int64_t step, int64_t count) {
      add_differences(image + at, image + at + step, count, rho * rho, roots, reciprocals, slopes);
      add_difference(slopes, count, grad + at + step, grad + at);
    };
    for (int64_t y = 0; y < height_; ++y) {
      add(y * width_, 1, width_ - 1);
      if (y < height_ - 1) add(y * width_, width_, width_);
    }
    return {total(0), total(1)};
  }

  T* cleared(int k) { return rows_[k].assign(width_, T(0)), rows_[k].data(); }
  double total(int k) const { return std::accumulate(rows_[k].begin(), rows_[k].end(), 0.0); }

  int64_t height_, width_;
  T tiny_;
  std::vector<std::vector<T>> rows_;
};

// Pixels first … end - 1 of one region, in a row
using Run = std::array<int64_t, 3>;  // first, end, region

// Sets the pixels of each region to their mean.  `sizes` (regions,) are the numbers of pixels.
template <class T>
void level(T* image, const Run* runs, int64_t count, const double* sizes, double* sums) {
  for (int64_t k = 0; k < count; ++k) {
    const auto [first, end, region] = runs[k];
    double total = 0;
    for (int64_t x = first; x < end; ++x) total += image[x];
    sums[region] += total;
  }
  for (int64_t k = 0; k < count; ++k) {
    const auto [first, end, region] = runs[k];
    std::fill(image + first, image + end, T(sums[region] / sizes[region]));
  }
}

}  // namespace nablahog

using namespace nablahog;

// Images (count, height, width) to `out` (count,) and, of the images' shape, derivatives.
NABLAHOG_API int nablahog_smoothness(bool double_precision, int64_t count, int64_t height, int64_t width,
                                     double rounding, double tiny, const void* images, void* out, void* grads) {
  return guarded([&] {
    with_real(double_precision, [&]<class T>() {
      Smoothness<T> smoothness(height, width, T(tiny));
      for (int64_t k = 0; k < count; ++k) {
        const int64_t at = k * height * width;
        static_cast<T*>(out)[k] =
            T(smoothness(static_cast<const T*>(images) + at, rounding, static_cast<T*>(grads) + at));
      }
    });
  });
}

// Levels images (count, pixels), of which image k has the runs ends[index[k]] … ends[index[k] + 1] - 1.
NABLAHOG_API int nablahog_level_regions(bool double_precision, int64_t count, int64_t pixels, const int64_t* index,
                                        const int64_t* runs, const int64_t* ends, int64_t regions, const double* sizes,
                                        void* images) {
  return guarded([&] {
    with_real(double_precision, [&]<class T>() {
      std::vector<double> sums(regions);  // a region is in one image only
      for (int64_t k = 0; k < count; ++k) {
        const int64_t first = ends[index[k]], last = ends[index[k] + 1];
        level(static_cast<T*>(images) + k * pixels, reinterpret_cast<const Run*>(runs) + first, last - first, sizes,
              sums.data());
      }
    });
  });
}
