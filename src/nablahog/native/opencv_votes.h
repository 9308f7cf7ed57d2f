// Gradients and votes of cv2.HOGDescriptor, of images of bytes, row by row.
#pragma once

#include <algorithm>

#include "vec.h"
#include "workspace.h"

namespace nablahog::opencv {

// An image (height, width, channels) in a larger one, which it fills by reflection at its outermost pixels
struct PaddedImage {
  const uint8_t* pixels;
  int64_t height, width, channels;
  int64_t top, left;  // pixels of padding before it
  int64_t padded_height, padded_width;
};

// A dialect; sizes in pixels
struct Scheme {
  int64_t gamma;  // whether the root of the image is taken first
  int64_t bins;
  int64_t window_width, window_height;
  int64_t block_width, block_height;
  int64_t across, down;          // from block to block
  int64_t cell_cols, cell_rows;  // of a block
  float polynomial[7];           // of angles: orientation.opencv_table
  float offset;                  // of the first bin's centre, in bins
  float epsilon, epsilon_again, clip;

  int64_t numbers() const { return cell_cols * cell_rows * bins; }  // of a block
  int64_t block_cols(int64_t width) const { return (width - block_width) / across + 1; }
  int64_t block_rows(int64_t height) const { return (height - block_height) / down + 1; }
};

// A part of a padded image
struct Region {
  int64_t left, top, width, height;
};

// Pixel k of an axis of so many, which is mirrored at its first and last pixels
inline int64_t reflected(int64_t k, int64_t count) {
  if (count == 1) return 0;
  while (k < 0 || k >= count) k = k < 0 ? -k : 2 * (count - 1) - k;
  return k;
}

// Votes of one row of a region after the other: `near` goes to the bin, `far` to the next one
class RowVotes {
 public:
  float *near, *far;
  int32_t* bin;

  RowVotes(const PaddedImage& image, const Scheme& scheme, const Region& region, Workspace& memory)
      : image_(image), scheme_(scheme), region_(region), line_(round_up(region.width + 2, lanes<float>)) {
    near = memory.zeros<float>(line_);
    far = memory.zeros<float>(line_);
    bin = memory.zeros<int32_t>(line_);
    lines_ = memory.zeros<float>(3 * image.channels * line_);
    read(-1);
    read(0);
  }

  // Row y, after row y - 1
  void compute(int64_t y) {
    read(y + 1);
    for (int64_t x = 0; x < region_.width; x += lanes<float>) vote(y, x);
  }

 private:
  using V = Vec<float>;

  // Numbers of a row, from column -1 on; the last three rows are kept
  float* line(int64_t y, int64_t channel) const { return lines_ + ((y + 1) % 3 * image_.channels + channel) * line_; }

  // Reads row y, -1 to the region's height
  void read(int64_t y) {
    const int64_t channels = image_.channels, offset = region_.left - image_.left - 1;  // of columns in the image
    const uint8_t* row =
        image_.pixels + reflected(region_.top - image_.top + y, image_.height) * image_.width * channels;
    const int64_t size = region_.width + 2;
    const int64_t first = std::clamp<int64_t>(-offset, 0, size);
    const int64_t last = std::clamp(image_.width - offset, first, size);
    float* const to = line(y, 0);
    if (channels == 3) {
      copy<3>(row + offset * 3, first, last, to);
    } else {
      copy<1>(row + offset, first, last, to);
    }
    for (int64_t channel = 0; channel < channels; ++channel) {
      float* of_channel = to + channel * line_;
      const auto pad = [&](int64_t k) {
        of_channel[k] = row[reflected(k + offset, image_.width) * channels + channel];
      };
      for (int64_t k = 0; k < first; ++k) pad(k);
      for (int64_t k = last; k < size; ++k) pad(k);
      if (scheme_.gamma) {
        for (int64_t k = 0; k < size; k += lanes<float>) store<V>(of_channel + k, sqrt(load<V>(of_channel + k)));
      }
    }
  }

  template <int CHANNELS>
  void copy(const uint8_t* from, int64_t first, int64_t last, float* __restrict to) const {
    for (int channel = 0; channel < CHANNELS; ++channel) {
      for (int64_t k = first; k < last; ++k) to[channel * line_ + k] = from[k * CHANNELS + channel];
    }
  }

  // Votes of the pixels of row y from x on
  [[gnu::always_inline]] void vote(int64_t y, int64_t x) {
    V gx{}, gy{}, squared = splat<V>(-1.0f);
    const auto in_tail = iota<Mask<V>>() >= splat<Mask<V>>(int32_t(image_.padded_width / 4 * 4 - region_.left - x));
    for (int64_t channel = 0; channel < image_.channels; ++channel) {
      const float* const here = line(y, channel) + x;
      const V u = load<V>(here + 2) - load<V>(here);
      const V v = load<V>(line(y + 1, channel) + x + 1) - load<V>(line(y - 1, channel) + x + 1);
      const V energy = u * u + v * v;
      // of equals the first channel, but in OpenCV's last columns, which it computes one by one, the last one
      const auto better = (energy > squared) | ((energy == squared) & in_tail);
      gx = better ? u : gx;
      gy = better ? v : gy;
      squared = better ? energy : squared;
    }
    const auto& [p1, p3, p5, p7, guard, radian, per_radian] = scheme_.polynomial;
    const float bins = float(scheme_.bins);
    const V magnitude = sqrt(squared), ax = abs(gx), ay = abs(gy);
    const auto steep = ax < ay;
    const V t = (steep ? ax : ay) / ((steep ? ay : ax) + guard), s = t * t;
    V angle = (((p7 * s + p5) * s + p3) * s + p1) * t;  // degrees
    angle = steep ? 90.0f - angle : angle;
    angle = gx < 0.0f ? 180.0f - angle : angle;
    angle = gy < 0.0f ? 360.0f - angle : angle;
    const V position = angle * radian * per_radian - scheme_.offset, before = floor(position), f = position - before;
    V wrapped = before < 0.0f ? before + bins : before;
    wrapped = wrapped >= bins ? wrapped - bins : wrapped;
    store<V>(near + x, magnitude * (1.0f - f));
    store<V>(far + x, magnitude * f);
    store<Mask<V>>(bin + x, to_int(wrapped));
  }

  const PaddedImage& image_;
  const Scheme& scheme_;
  const Region region_;
  const int64_t line_;
  float* lines_;
};

// Votes of all pixels of a padded image
inline void votes(const PaddedImage& image, const Scheme& scheme, float* near, float* far, int32_t* bin) {
  thread_local Workspace memory;
  memory.clear();
  const int64_t width = image.padded_width;
  RowVotes row(image, scheme, {0, 0, width, image.padded_height}, memory);
  for (int64_t y = 0; y < image.padded_height; ++y) {
    row.compute(y);
    std::copy_n(row.near, width, near + y * width);
    std::copy_n(row.far, width, far + y * width);
    std::copy_n(row.bin, width, bin + y * width);
  }
}

}  // namespace nablahog::opencv
