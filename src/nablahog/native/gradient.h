// Eq. 1-2, a row of pixels at a time: stored values to gradients (Gx, Gy), and the vjp.
//
// A *line* holds a row of one channel, scaled, with a pixel more at either end: a *ghost*, the value beyond the border.
// Behind it are zeros up to whole vectors.  A ring buffer holds the last three lines of each channel.
#pragma once

#include "dual.h"
#include "plan.h"
#include "workspace.h"

namespace nablahog {

struct Images {
  const void* pixels;  // of the dtype in the plan
  int64_t strides[4];  // in elements: from image to image, channel, row, column
};

// Elements from line to line: a vector in front, whose last element is the ghost of the first pixel, and one behind
template <class T>
int64_t line_size(int64_t width) {
  return round_up(width, lanes<T>) + 2 * lanes<T>;
}

// Gradients of a vector of pixels, and the channel that they are of
template <class V, class I>
struct Gradients {
  V x, y;
  I winner;
};

// The lines of a channel above, at and below a row
template <class P>
struct Lines {
  P above, here, below;
};

// The derivative of the root of a stored value; 0 for black
template <class T>
T root_slope(const nablahog_plan& plan, T stored) {
  const T scale = T(plan.scale), value = scale * stored;
  return value <= T(plan.black) ? T(0) : scale * T(0.5) / std::sqrt(value);
}

// Reads rows of images from the first to the last.  P is T*, or DualPointer<T> if pixels have tangents.
template <class P>
class Reader {
 public:
  using T = typename Pointee<P>::Number;
  using I = Int<T>;
  using V = typename Pointee<P>::Vector;

  // `tangents`: T (images, channels, height, width)
  Reader(const nablahog_plan& plan, const Images& images, const T* tangents, Workspace& work)
      : channels(plan.averaged ? 1 : plan.channels),
        plan_(plan),
        images_(images),
        tangents_(tangents),
        size_(line_size<T>(plan.width)),
        ring_(lines(work, channels * 3)),
        constant_(lines(work, 1)),
        current_(work.zeros<Lines<P>>(channels)),
        last_wins_(static_cast<const I*>(plan.last_wins)) {
    if (plan.border == NABLAHOG_CONSTANT) {
      for (int64_t x = -1; x <= plan.width; ++x)
        put(constant_, x, constant<typename Pointee<P>::Scalar>(border_value()));
    }
    if (plan.border_doubled) {
      doubled_ = work.zeros<T>(size_);
      for (int64_t x = 0; x < plan.width; ++x) doubled_[x] = x == 0 || x == plan.width - 1 ? 2 : 1;
    }
  }

  // Begins with an image, a row above the first that is asked for
  void begin(int64_t image, int64_t first_row) {
    image_ = image;
    last_read_ = first_row - 2 < -1 ? -1 : first_row - 2;
    broken_ = Vec<T>{};
  }

  // Reads on to the end of the row before `stop`
  void read_until(int64_t stop) {
    while (last_read_ < stop - 1) read(++last_read_);
  }

  // Lines for the gradients of row y, for each channel
  const Lines<P>* lines_at(int64_t y) {
    read_until(y + 2 < plan_.height ? y + 2 : plan_.height);
    row_factor_ = plan_.border_doubled && (y == 0 || y == plan_.height - 1) ? 2 : 1;
    for (int64_t channel = 0; channel < channels; ++channel) current_[channel] = lines_of(channel, y);
    return current_;
  }

  // Whether a pixel of those read is NaN or infinite
  bool is_broken() const { return sum(broken_) != 0; }

  // Eq. 2 of a vector of pixels from column x on, of the channel of largest magnitude
  [[gnu::always_inline]] Gradients<V, Vec<I>> gradients(const Lines<P>* rows, int64_t x) const {
    auto [u, v] = differences(rows[0], x);
    Vec<I> winner{};
    if (channels > 1) {
      Vec<T> largest = squared(u, v);
      for (int64_t channel = 1; channel < channels; ++channel) {
        const auto [p, q] = differences(rows[channel], x);
        const Vec<T> magnitude = squared(p, q);
        const auto better = (magnitude > largest) | ((magnitude == largest) & load<Vec<I>>(last_wins_ + x));
        u = select(better, p, u);
        v = select(better, q, v);
        largest = better ? magnitude : largest;
        winner = better ? splat<Vec<I>>(I(channel)) : winner;
      }
    }
    return {u, v, winner};
  }

  const int64_t channels;  // that are compared

 private:
  static constexpr bool dual = is_dual<V>;

  P lines(Workspace& work, int64_t count) const {
    if constexpr (dual) {
      T* values = work.zeros<T>(count * size_) + lanes<T>;
      return {values, work.zeros<T>(count * size_) + lanes<T>};
    } else {
      return work.zeros<T>(count * size_) + lanes<T>;
    }
  }

  T border_value() const { return T(plan_.border_value); }
  P line(int64_t channel, int64_t y) const { return ring_ + (channel * 3 + y % 3) * size_; }

  Lines<P> lines_of(int64_t channel, int64_t y) const {
    const bool first = y == 0, last = y == plan_.height - 1;
    const P here = line(channel, y);
    if (first && last) return {here, here, here};
    const P above = first ? here : line(channel, y - 1), below = last ? here : line(channel, y + 1);
    if (plan_.border == NABLAHOG_REPEAT) return {above, here, below};
    const bool mirror = plan_.border == NABLAHOG_MIRROR;
    return {first ? (mirror ? below : constant_) : above, here, last ? (mirror ? above : constant_) : below};
  }

  // The masks [-1, 0, 1]; smoothed, differences come first, so that a flat area has a zero gradient
  [[gnu::always_inline]] std::pair<V, V> differences(const Lines<P>& rows, int64_t x) const {
    const auto across = [x](P line) { return load_vector(line + (x + 1)) - load_vector(line + (x - 1)); };
    const auto down = [&rows](int64_t at) { return load_vector(rows.below + at) - load_vector(rows.above + at); };
    V u = across(rows.here), v = down(x);
    if (plan_.sobel) {
      u = across(rows.above) + times(u, T(2)) + across(rows.below);
      v = down(x - 1) + times(v, T(2)) + down(x + 1);
    }
    if (doubled_) {
      u = times(u, load<Vec<T>>(doubled_ + x));
      v = times(v, row_factor_);
    }
    return {u, v};
  }

  [[gnu::always_inline]] static Vec<T> squared(V u, V v) {
    return value_of(u) * value_of(u) + value_of(v) * value_of(v);
  }

  void read(int64_t y) {
    for (int64_t channel = 0; channel < plan_.channels; ++channel) {
      const int64_t from = image_ * images_.strides[0] + channel * images_.strides[1] + y * images_.strides[2];
      switch (plan_.pixels) {
        case NABLAHOG_UINT8:
          read_channel(static_cast<const uint8_t*>(images_.pixels) + from, y, channel);
          break;
        case NABLAHOG_FLOAT32:
          read_channel(static_cast<const float*>(images_.pixels) + from, y, channel);
          break;
        default:
          read_channel(static_cast<const double*>(images_.pixels) + from, y, channel);
      }
    }
    for (int64_t channel = 0; channel < channels; ++channel) finish(line(channel, y));
  }

  template <class Stored>
  void read_channel(const Stored* from, int64_t y, int64_t channel) {
    const P to = line(plan_.averaged ? 0 : channel, y);
    const int64_t step = images_.strides[3];
    T* values;
    if constexpr (dual) {
      values = to.value;
      const T* tangents = tangents_ + ((image_ * plan_.channels + channel) * plan_.height + y) * plan_.width;
      convert_tangents(from, step, tangents, to.tangent, channel);
    } else {
      values = to;
    }
    if (step == 1) {
      convert(from, std::integral_constant<int64_t, 1>(), values, channel);
    } else {
      convert(from, step, values, channel);
    }
  }

  // Eq. 1: scales a row of stored values, takes roots, and averages channels
  template <class Stored, class Step>
  [[gnu::always_inline]] void convert(const Stored* __restrict from, Step step, T* __restrict to,
                                      int64_t channel) const {
    const int64_t width = plan_.width;
    const T scale = T(plan_.scale), weight = T(plan_.channel_weights[channel]), black = T(plan_.black);
    const bool first = channel == 0 || !plan_.averaged;
    if (plan_.square_root) {
      for (int64_t x = 0; x < width; ++x) {
        const T value = scale * T(from[x * step]);
        const T root = weight * (value <= black ? value * 0 + 0 : std::sqrt(value));  // of -∞ NaN, of others 0
        to[x] = first ? root : to[x] + root;
      }
    } else if (!plan_.averaged) {
      for (int64_t x = 0; x < width; ++x) to[x] = scale * T(from[x * step]);
    } else if (first) {
      for (int64_t x = 0; x < width; ++x) to[x] = weight * (scale * T(from[x * step]));
    } else {
      for (int64_t x = 0; x < width; ++x) to[x] += weight * (scale * T(from[x * step]));
    }
  }

  template <class Stored>
  void convert_tangents(const Stored* from, int64_t step, const T* tangents, T* __restrict to, int64_t channel) const {
    const T scale = T(plan_.scale), weight = T(plan_.channel_weights[channel]);
    const bool first = channel == 0 || !plan_.averaged;
    for (int64_t x = 0; x < plan_.width; ++x) {
      const T slope = plan_.square_root ? root_slope(plan_, T(from[x * step])) : scale;
      const T change = weight * slope * tangents[x];
      to[x] = first ? change : to[x] + change;
    }
  }

  // Fills in the ghosts, and looks for values that are not finite
  void finish(P to) {
    const int64_t width = plan_.width, last = width - 1;
    T* values;
    if constexpr (dual) {
      values = to.value;
    } else {
      values = to;
    }
    using Scalar = typename Pointee<P>::Scalar;
    const bool mirror = plan_.border == NABLAHOG_MIRROR || width == 1, repeat = plan_.border == NABLAHOG_REPEAT;
    const Scalar beyond = constant<Scalar>(border_value());
    put(to, -1, mirror ? get(to, width > 1) : repeat ? get(to, 0) : beyond);
    put(to, width, mirror ? get(to, last - (width > 1)) : repeat ? get(to, last) : beyond);
    if (plan_.pixels != NABLAHOG_UINT8) {
      for (int64_t x = 0; x < width; x += lanes<T>) broken_ += load<Vec<T>>(values + x) * T(0);
    }
  }

  const nablahog_plan& plan_;
  const Images& images_;
  const T* tangents_;
  const int64_t size_;
  P ring_, constant_;
  Lines<P>* current_;
  const I* last_wins_;
  T* doubled_ = nullptr;  // factors of the columns' differences, where those across the border count twice
  T row_factor_ = 1;
  int64_t image_ = 0, last_read_ = -1;
  Vec<T> broken_{};
};

// The vjp: gradients with respect to Gx and Gy, a row at a time from above, to those of the pixels of the row above.
template <class T>
class Writer {
 public:
  using V = Vec<T>;
  using I = Vec<Int<T>>;

  Writer(const nablahog_plan& plan, const Images& images, Workspace& work)
      : plan_(plan),
        images_(images),
        channels_(plan.averaged ? 1 : plan.channels),
        size_(line_size<T>(plan.width)),
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
      std::memset(x_line(channel, y), 0, plan_.width * sizeof(T));
      std::memset(y_line(channel, y), 0, plan_.width * sizeof(T));
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
    const int64_t width = plan_.width, height = plan_.height;
    const T factor = plan_.border == NABLAHOG_MIRROR ? T(0) : plan_.border_doubled ? T(2) : T(1);
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
    for (int64_t channel = 0; channel < plan_.channels; ++channel) {
      T* to = out + (channel * plan_.height + y) * plan_.width;
      const T slope = T(plan_.channel_weights[channel]) * T(plan_.scale);
      if (!plan_.averaged && !plan_.sobel && !plan_.square_root) {
        differences_vjp(channel, y, slope, to);
        continue;
      }
      if (channel == 0 || !plan_.averaged) {
        if (plan_.sobel) {
          sobel_vjp(channel, y, values_);
        } else {
          differences_vjp(channel, y, T(1), values_);
        }
      }
      if (plan_.square_root) {
        roots_vjp(channel, y, to);
      } else {
        for (int64_t x = 0; x < plan_.width; ++x) to[x] = slope * values_[x];
      }
    }
  }

 private:
  T* x_line(int64_t channel, int64_t y) const { return grad_x_ + (channel * 3 + y % 3) * size_; }
  T* y_line(int64_t channel, int64_t y) const { return grad_y_ + (channel * 3 + y % 3) * size_; }

  void differences_vjp(int64_t channel, int64_t y, T slope, T* __restrict to) const {
    const int64_t width = plan_.width;
    const T *here = x_line(channel, y), *above = y_line(channel, y + 2), *below = y_line(channel, y + 1);
    for (int64_t x = 0; x < width; ++x) to[x] = slope * (here[x - 1] - here[x + 1] + above[x] - below[x]);
    if (plan_.border != NABLAHOG_REPEAT) return;  // beyond the border is the outermost pixel itself
    const T* own = y_line(channel, y);
    to[0] -= slope * here[0];
    to[width - 1] += slope * here[width - 1];
    for (int64_t x = 0; x < width && y == 0; ++x) to[x] -= slope * own[x];
    for (int64_t x = 0; x < width && y == plan_.height - 1; ++x) to[x] += slope * own[x];
  }

  // Of smoothed differences of a mirrored image: the outermost rows and columns have one neighbour twice
  void sobel_vjp(int64_t channel, int64_t y, T* __restrict to) const {
    const int64_t width = plan_.width, height = plan_.height;
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
    const int64_t* strides = images_.strides;
    const int64_t from = image_ * strides[0] + channel * strides[1] + y * strides[2];
    const T weight = T(plan_.channel_weights[channel]);
    const auto each = [&](const auto* stored) {
      for (int64_t x = 0; x < plan_.width; ++x) {
        to[x] = weight * root_slope(plan_, T(stored[from + x * strides[3]])) * values_[x];
      }
    };
    switch (plan_.pixels) {
      case NABLAHOG_UINT8:
        return each(static_cast<const uint8_t*>(images_.pixels));
      case NABLAHOG_FLOAT32:
        return each(static_cast<const float*>(images_.pixels));
      default:
        return each(static_cast<const double*>(images_.pixels));
    }
  }

  const nablahog_plan& plan_;
  const Images& images_;
  const int64_t channels_, size_;
  T *grad_x_, *grad_y_, *values_;
  int64_t image_ = 0;
};

}  // namespace nablahog
