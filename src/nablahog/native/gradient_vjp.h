// The vjp of Eq. 1-2: gradients with respect to Gx and Gy, a row at a time from above, to those of the row above.
#pragma once

#include "gradient.h"

namespace nablahog {

template <class T>
class Writer {
 public:
  using V = Vec<T>;
  using I = Vec<Int<T>>;

  Writer(const nablahog_tables& tables, const Images& images, Workspace& work)
      : tables_(tables),
        images_(images),
        channels_(tables.averaged ? 1 : tables.channels),
        size_(line_size<T>(tables.width)),
        grad_x_(work.zeros<T>(channels_ * 3 * size_) + lanes<T>),
        grad_y_(work.zeros<T>(channels_ * 3 * size_) + lanes<T>),
        values_(work.zeros<T>(size_)) {}

  void begin(int64_t image) {
    image_ = image;
    std::memset(grad_x_ - lanes<T>, 0, channels_ * 3 * size_ * sizeof(T));
    std::memset(grad_y_ - lanes<T>, 0, channels_ * 3 * size_ * sizeof(T));
  }

  // A row that does not vote
  void clear_row(int64_t y) {
    for (int64_t channel = 0; channel < channels_; ++channel) {
      std::memset(x_line(channel, y), 0, tables_.width * sizeof(T));
      std::memset(y_line(channel, y), 0, tables_.width * sizeof(T));
    }
  }

  // Takes gradients with respect to Gx and Gy of a vector of pixels of row y, from column x on
  [[gnu::always_inline]] void put(int64_t y, int64_t x, V gx, V gy, I winner) {
    if (channels_ == 1) {
      store(x_line(0, y) + x, gx);
      store(y_line(0, y) + x, gy);
      return;
    }
    for (int64_t channel = 0; channel < channels_; ++channel) {
      const auto own = winner == splat<I>(Int<T>(channel));
      store(x_line(channel, y) + x, own ? gx : V{});
      store(y_line(channel, y) + x, own ? gy : V{});
    }
  }

  // Once a row is complete: nothing is beyond its end, and differences across the border have their factor
  void finish_row(int64_t y) {
    const int64_t width = tables_.width, height = tables_.height;
    const T factor = tables_.border == NABLAHOG_MIRROR ? T(0) : tables_.border_doubled ? T(2) : T(1);
    for (int64_t channel = 0; channel < channels_; ++channel) {
      T *gx = x_line(channel, y), *gy = y_line(channel, y);
      store(gx + width, V{});
      store(gy + width, V{});
      gx[0] = width > 1 ? gx[0] * factor : 0;
      if (width > 1) gx[width - 1] *= factor;
      if (y == 0 || y == height - 1) {
        for (int64_t x = 0; x < width; ++x) gy[x] = height > 1 ? gy[x] * factor : 0;
      }
    }
  }

  // Gradients of row y of all channels, to `out` (channels, height, width), from the rows above, at and below it
  void write_row(int64_t y, T* out) {
    for (int64_t channel = 0; channel < tables_.channels; ++channel) {
      T* to = out + (channel * tables_.height + y) * tables_.width;
      const T slope = T(tables_.channel_weights[channel]) * T(tables_.scale);
      if (!tables_.averaged && !tables_.sobel && !tables_.square_root) {
        differences_vjp(channel, y, slope, to);
        continue;
      }
      if (channel == 0 || !tables_.averaged) {
        if (tables_.sobel) {
          sobel_vjp(channel, y, values_);
        } else {
          differences_vjp(channel, y, T(1), values_);
        }
      }
      if (tables_.square_root) {
        roots_vjp(channel, y, to);
      } else {
        for (int64_t x = 0; x < tables_.width; ++x) to[x] = slope * values_[x];
      }
    }
  }

 private:
  T* x_line(int64_t channel, int64_t y) const { return grad_x_ + (channel * 3 + y % 3) * size_; }
  T* y_line(int64_t channel, int64_t y) const { return grad_y_ + (channel * 3 + y % 3) * size_; }

  void differences_vjp(int64_t channel, int64_t y, T slope, T* __restrict to) const {
    const int64_t width = tables_.width;
    const T *here = x_line(channel, y), *above = y_line(channel, y + 2), *below = y_line(channel, y + 1);
    for (int64_t x = 0; x < width; ++x) to[x] = slope * (here[x - 1] - here[x + 1] + above[x] - below[x]);
    if (tables_.border != NABLAHOG_REPEAT) return;  // beyond the border is the outermost pixel itself
    const T* own = y_line(channel, y);
    to[0] -= slope * here[0];
    to[width - 1] += slope * here[width - 1];
    for (int64_t x = 0; x < width && y == 0; ++x) to[x] -= slope * own[x];
    for (int64_t x = 0; x < width && y == tables_.height - 1; ++x) to[x] += slope * own[x];
  }

  // Of smoothed differences of a mirrored image: the outermost rows and columns have one neighbour twice
  void sobel_vjp(int64_t channel, int64_t y, T* __restrict to) const {
    const int64_t width = tables_.width, height = tables_.height;
    const T *x_here = x_line(channel, y), *x_above = x_line(channel, y + 2), *x_below = x_line(channel, y + 1);
    const T *y_above = y_line(channel, y + 2), *y_below = y_line(channel, y + 1);
    const T of_here = height == 1 ? 4 : 2, of_above = y == 1 ? 2 : 1, of_below = y == height - 2 ? 2 : 1;
    const auto across = [](const T* line, int64_t x) { return line[x - 1] - line[x + 1]; };
    const auto down = [=](int64_t x) { return y_above[x] - y_below[x]; };
    for (int64_t x = 0; x < width; ++x) {
      to[x] = of_here * across(x_here, x) + of_above * across(x_above, x) + of_below * across(x_below, x) +
              (down(x - 1) + 2 * down(x) + down(x + 1));
    }
    if (width == 1) {
      to[0] += 2 * down(0);
    } else {
      to[1] += down(0);
      to[width - 2] += down(width - 1);
    }
  }

  void roots_vjp(int64_t channel, int64_t y, T* to) const {
    const int64_t step = images_.strides[3];
    const T weight = T(tables_.channel_weights[channel]);
    with_row(tables_, images_, image_, channel, y, [&](const auto* from) {
      for (int64_t x = 0; x < tables_.width; ++x) {
        to[x] = weight * root_slope(tables_, T(from[x * step])) * values_[x];
      }
    });
  }

  const nablahog_tables& tables_;
  const Images& images_;
  const int64_t channels_, size_;
  T *grad_x_, *grad_y_, *values_;
  int64_t image_ = 0;
};

}  // namespace nablahog
