// Gradients and votes of cv2.HOGDescriptor, row by row: those of the operator's own loops, of images that are padded.
#pragma once

#include <algorithm>

#include "gradient.h"
#include "votes.h"

namespace nablahog::opencv {

// An image (height, width, channels) in a larger one, which it fills by reflection at its outermost pixels
struct PaddedImage {
  const uint8_t* pixels;
  int64_t height, width, channels;
  int64_t top, left;  // pixels of padding before it
  int64_t padded_height, padded_width;
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

// Copies pixels of a row from column `first` on, which may lie beyond it
inline void copy_row(const uint8_t* row, int64_t columns, int64_t channels, int64_t first, int64_t width, uint8_t* to) {
  const int64_t begin = std::clamp<int64_t>(-first, 0, width), end = std::clamp(columns - first, begin, width);
  const auto mirror = [&](int64_t k) {
    std::copy_n(row + reflected(first + k, columns) * channels, channels, to + k * channels);
  };
  for (int64_t k = 0; k < begin; ++k) mirror(k);
  std::copy_n(row + (first + begin) * channels, (end - begin) * channels, to + begin * channels);
  for (int64_t k = end; k < width; ++k) mirror(k);
}

// A region with a pixel more on each side, as an image of its own
struct Part {
  nablahog_tables tables;
  Images images;

  // The tables are those of any image size.
  Part(const PaddedImage& image, const nablahog_tables& any, const Region& region, Workspace& memory) : tables(any) {
    const int64_t channels = image.channels, left = region.left - 1, width = region.width + 2;
    const int64_t height = region.height + 2, line = width * channels;
    uint8_t* pixels = memory.uninitialized<uint8_t>(height * line);
    for (int64_t y = 0; y < height; ++y) {
      const int64_t row = reflected(region.top - 1 - image.top + y, image.height);
      copy_row(image.pixels + row * image.width * channels, image.width, channels, left - image.left, width,
               pixels + y * line);
    }
    // of equal channels the first, but in OpenCV's last columns, which it computes one by one, the last one
    int32_t* last_wins = memory.zeros<int32_t>(width + lanes<float>);
    for (int64_t x = std::max<int64_t>(image.padded_width / 4 * 4 - left, 0); x < width; ++x) last_wins[x] = -1;
    tables.channels = channels;
    tables.height = height;
    tables.width = width;
    tables.last_wins = last_wins;
    images = {pixels, {0, 1, line, channels}};
  }
};

// Votes of one row of a region after the other: `near` goes to the bin, `far` to the next one
class RowVotes {
 public:
  float *near, *far;
  int32_t* bin;

  RowVotes(const PaddedImage& image, const nablahog_tables& tables, const Region& region, Workspace& memory)
      : near(memory.zeros<float>(region.width)),
        far(memory.zeros<float>(region.width)),
        bin(memory.zeros<int32_t>(region.width)),
        width_(region.width),
        part_(image, tables, region, memory),
        reader_(part_.tables, part_.images, nullptr, memory),
        rule_(part_.tables, memory) {
    reader_.begin(0, 0);
  }

  // Row y, after row y - 1
  void compute(int64_t y) {
    const Lines<float*>* lines = reader_.lines_at(y + 1);
    for (int64_t x = 0; x < width_; x += lanes<float>) {
      const auto gradients = reader_.gradients(lines, x + 1);
      const Votes<float> votes = rule_(gradients.x, gradients.y);
      store(near + x, votes.m * (1.0f - votes.f));
      store(far + x, votes.m * votes.f);
      store(bin + x, votes.bin);
    }
  }

 private:
  const int64_t width_;
  const Part part_;
  Reader<float*> reader_;
  const OpenCV<float> rule_;
};

// Votes of all pixels of a padded image and the bins that they go to, to arrays (rows, cols, 2)
inline void votes(const PaddedImage& image, const nablahog_tables& tables, float* votes, uint8_t* bins) {
  thread_local Workspace memory;
  memory.clear();
  RowVotes row(image, tables, {0, 0, image.padded_width, image.padded_height}, memory);
  for (int64_t y = 0; y < image.padded_height; ++y) {
    row.compute(y);
    for (int64_t x = 0; x < image.padded_width; ++x, votes += 2, bins += 2) {
      votes[0] = row.near[x];
      votes[1] = row.far[x];
      bins[0] = uint8_t(row.bin[x]);
      bins[1] = uint8_t(row.bin[x] + 1 == tables.bins ? 0 : row.bin[x] + 1);
    }
  }
}

}  // namespace nablahog::opencv
