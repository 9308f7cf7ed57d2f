// Eq. 1-2, a row of pixels at a time: stored values to gradients (Gx, Gy).
//
// A *line* holds a row of one channel, scaled, with a pixel more at either end: a *ghost*, the value beyond the border.
// Behind it are zeros up to whole vectors.  A ring buffer holds the last three lines of each channel.
#pragma once

#include "dual.h"
#include "tables.h"
#include "workspace.h"

namespace nablahog {

struct Images {
  const void* pixels;  // of the dtype in the tables
  int64_t strides[4];  // in elements: from image to image, channel, row, column
};

// Calls body(the first pixel of a row) with a pointer to the dtype in the tables.
template <class F>
void with_row(const nablahog_tables& tables, const Images& images, int64_t image, int64_t channel, int64_t y, F body) {
  const int64_t at = image * images.strides[0] + channel * images.strides[1] + y * images.strides[2];
  switch (tables.pixels) {
    case NABLAHOG_UINT8:
      return body(static_cast<const uint8_t*>(images.pixels) + at);
    case NABLAHOG_FLOAT32:
      return body(static_cast<const float*>(images.pixels) + at);
    default:
      return body(static_cast<const double*>(images.pixels) + at);
  }
}

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
T root_slope(const nablahog_tables& tables, T stored) {
  const T scale = T(tables.scale), value = scale * stored;
  return value <= T(tables.black) ? T(0) : scale * T(0.5) / std::sqrt(value);
}

// Reads rows of images from the first to the last.  P is T*, or DualPointer<T> if pixels have tangents.
template <class P>
class Reader {
 public:
  using T = typename Pointee<P>::Number;
  using I = Int<T>;
  using V = typename Pointee<P>::Vector;

  // `tangents`: T (images, channels, height, width)
  Reader(const nablahog_tables& tables, const Images& images, const T* tangents, Workspace& work)
      : channels(tables.averaged ? 1 : tables.channels),
        tables_(tables),
        images_(images),
        tangents_(tangents),
        size_(line_size<T>(tables.width)),
        ring_(lines(work, channels * 3)),
        constant_(lines(work, 1)),
        current_(work.zeros<Lines<P>>(channels)),
        last_wins_(static_cast<const I*>(tables.last_wins)) {
    if (tables.border == NABLAHOG_CONSTANT) {
      for (int64_t x = -1; x <= tables.width; ++x)
        put(constant_, x, constant<typename Pointee<P>::Scalar>(border_value()));
    }
    if (tables.border_doubled) {
      doubled_ = work.zeros<T>(size_);
      for (int64_t x = 0; x < tables.width; ++x) doubled_[x] = x == 0 || x == tables.width - 1 ? 2 : 1;
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
    read_until(y + 2 < tables_.height ? y + 2 : tables_.height);
    row_factor_ = tables_.border_doubled && (y == 0 || y == tables_.height - 1) ? 2 : 1;
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

  const int64_t channels;  // channels that are compared

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

  T border_value() const { return T(tables_.border_value); }
  P line(int64_t channel, int64_t y) const { return ring_ + (channel * 3 + y % 3) * size_; }

  Lines<P> lines_of(int64_t channel, int64_t y) const {
    const bool first = y == 0, last = y == tables_.height - 1;
    const P here = line(channel, y);
    if (first && last) return {here, here, here};
    const P above = first ? here : line(channel, y - 1), below = last ? here : line(channel, y + 1);
    if (tables_.border == NABLAHOG_REPEAT) return {above, here, below};
    const bool mirror = tables_.border == NABLAHOG_MIRROR;
    return {first ? (mirror ? below : constant_) : above, here, last ? (mirror ? above : constant_) : below};
  }

  // The masks [-1, 0, 1]; smoothed, differences come first, so that a flat area has a zero gradient
  [[gnu::always_inline]] std::pair<V, V> differences(const Lines<P>& rows, int64_t x) const {
    const auto across = [x](P line) { return load_vector(line + (x + 1)) - load_vector(line + (x - 1)); };
    const auto down = [&rows](int64_t at) { return load_vector(rows.below + at) - load_vector(rows.above + at); };
    V u = across(rows.here), v = down(x);
    if (tables_.sobel) {
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
    for (int64_t channel = 0; channel < tables_.channels; ++channel) {
      with_row(tables_, images_, image_, channel, y, [&](const auto* from) { read_channel(from, y, channel); });
    }
    for (int64_t channel = 0; channel < channels; ++channel) finish(line(channel, y));
  }

  template <class Stored>
  void read_channel(const Stored* from, int64_t y, int64_t channel) {
    const P to = line(tables_.averaged ? 0 : channel, y);
    const int64_t step = images_.strides[3];
    T* values = values_of(to);
    if constexpr (dual) {
      const T* tangents = tangents_ + ((image_ * tables_.channels + channel) * tables_.height + y) * tables_.width;
      convert_tangents(from, step, tangents, to.tangent, channel);
    }
    if (step == 1) {
      convert(from, std::integral_constant<int64_t, 1>(), values, channel);
    } else if (step == 3) {  // colours of a pixel side by side
      convert(from, std::integral_constant<int64_t, 3>(), values, channel);
    } else {
      convert(from, step, values, channel);
    }
  }

  // Eq. 1: scales a row of stored values, takes roots, and averages channels
  template <class Stored, class Step>
  [[gnu::always_inline]] void convert(const Stored* __restrict from, Step step, T* __restrict to,
                                      int64_t channel) const {
    const int64_t width = tables_.width;
    const T scale = T(tables_.scale), weight = T(tables_.channel_weights[channel]), black = T(tables_.black);
    const bool first = channel == 0 || !tables_.averaged;
    if (tables_.square_root) {
      for (int64_t x = 0; x < width; ++x) {
        const T value = scale * T(from[x * step]);
        const T root = weight * (value <= black ? value * 0 + 0 : std::sqrt(value));  // NaN for -∞, 0 for other values
        to[x] = first ? root : to[x] + root;
      }
    } else if (!tables_.averaged) {
      for (int64_t x = 0; x < width; ++x) to[x] = scale * T(from[x * step]);
    } else if (first) {
      for (int64_t x = 0; x < width; ++x) to[x] = weight * (scale * T(from[x * step]));
    } else {
      for (int64_t x = 0; x < width; ++x) to[x] += weight * (scale * T(from[x * step]));
    }
  }

  template <class Stored>
  void convert_tangents(const Stored* from, int64_t step, const T* tangents, T* __restrict to, int64_t channel) const {
    const T scale = T(tables_.scale), weight = T(tables_.channel_weights[channel]);
    const bool first = channel == 0 || !tables_.averaged;
    for (int64_t x = 0; x < tables_.width; ++x) {
      const T slope = tables_.square_root ? root_slope(tables_, T(from[x * step])) : scale;
      const T change = weight * slope * tangents[x];
      to[x] = first ? change : to[x] + change;
    }
  }

  // Fills in the ghosts, and looks for values that are not finite
  void finish(P to) {
    const int64_t width = tables_.width, last = width - 1;
    const T* values = values_of(to);
    using Scalar = typename Pointee<P>::Scalar;
    const bool mirror = tables_.border == NABLAHOG_MIRROR || width == 1, repeat = tables_.border == NABLAHOG_REPEAT;
    const Scalar beyond = constant<Scalar>(border_value());
    put(to, -1, mirror ? get(to, width > 1) : repeat ? get(to, 0) : beyond);
    put(to, width, mirror ? get(to, last - (width > 1)) : repeat ? get(to, last) : beyond);
    if (tables_.pixels != NABLAHOG_UINT8) {
      for (int64_t x = 0; x < width; x += lanes<T>) broken_ += load<Vec<T>>(values + x) * T(0);
    }
  }

  const nablahog_tables& tables_;
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

}  // namespace nablahog
