// Images to cells and descriptors, a band of rows at a time.
#pragma once

#include "gradient.h"
#include "operator.h"
#include "pooling.h"
#include "votes.h"

namespace nablahog {

// Eq. 1-6: the cells of images, a band at a time
template <class T, class Rule>
class Forward {
 public:
  Forward(const nablahog_tables& tables, const Images& images, Workspace& work)
      : tables_(tables),
        stride_(round_up(tables.width, lanes<T>)),
        reader_(tables, images, nullptr, work),
        rule_(tables, work),
        pooling_(tables, work),
        votes_{plane<T>(work), plane<T>(work), nullptr, plane<Int<T>>(work), stride_} {}

  // Calls body(band, its cells) for bands of an image.  Returns whether a pixel is NaN or infinite, of the rows of
  // these bands and, before the first and behind the last, of all others.
  template <class F>
  bool bands(int64_t image, Range bands, F body) {
    reader_.begin(image, bands.first > 0 ? stretch(tables_.rows, bands.first).begin : 0);
    for (int64_t band = bands.first; band < bands.last; ++band) {
      const Stretch rows = stretch(tables_.rows, band);
      for (int64_t y = rows.begin; y < rows.end; ++y) vote(y, (y - rows.begin) * stride_);
      body(band, pooling_.template pool<Rule::hard ? 1 : 2>(band, votes_));
    }
    const bool at_end = bands.last == tables_.rows.stretches;
    reader_.read_until(at_end ? tables_.height : stretch(tables_.rows, bands.last).begin);
    const bool broken = reader_.is_broken();
    if (broken) pooling_.clear();
    return broken;
  }

  void add_band(int64_t band, const T* band_cells, T* cells) const { pooling_.add_band(band, band_cells, cells); }

 private:
  template <class N>
  N* plane(Workspace& work) const {
    return work.zeros<N>(stride_ * tables_.rows.longest + lanes<T>);
  }

  void vote(int64_t y, int64_t at) {
    const auto* lines = reader_.lines_at(y);
    for (int64_t x = 0; x < tables_.width; x += lanes<T>) {
      const auto g = reader_.gradients(lines, x);
      const Votes<T> votes = rule_(g.x, g.y);
      if constexpr (Rule::hard) {
        store(votes_.here + at + x, votes.m);
      } else {
        const Vec<T> after = votes.m * votes.f;
        store(votes_.here + at + x, votes.m - after);
        store(votes_.after + at + x, after);
      }
      store(votes_.bin + at + x, votes.bin);
    }
    store(votes_.here + at + tables_.width, Vec<T>{});  // pixels beyond the row give nothing
    if constexpr (!Rule::hard) store(votes_.after + at + tables_.width, Vec<T>{});
  }

  const nablahog_tables& tables_;
  const int64_t stride_;
  Reader<T*> reader_;
  const Rule rule_;
  Pooling<T> pooling_;
  const Planes<T> votes_;
};

// Images to their cells (images, rows, cols, bins) and descriptors; one of them may be null
template <class T, class Rule>
void forward(const nablahog_tables& tables, const Images& images, Range range, T* cells, T* out) {
  thread_local Workspace work;
  work.clear();
  Forward<T, Rule> pass(tables, images, work);
  const auto norm = make_normalizer<T>(tables, work);
  T* own_cells = cells ? nullptr : work.zeros<T>(cells_size(tables));
  for (int64_t image = range.first; image < range.last; ++image) {
    T* of_image = cells ? cells + image * cells_size(tables) : own_cells;
    std::memset(of_image, 0, cells_size(tables) * sizeof(T));
    const bool broken = pass.bands(image, {0, tables.rows.stretches}, [&](int64_t band, const T* band_cells) {
      pass.add_band(band, band_cells, of_image);
    });
    if (broken) fill_nan(of_image, cells_size(tables));
    if (!out) continue;
    if (broken) {
      fill_nan(out + image * out_size(tables), out_size(tables));
    } else {
      norm->forward(of_image, out + image * out_size(tables));
    }
  }
}

// The cells of bands of one image, to `band_cells` (bands, …), for threads that share an image.  Returns whether a
// pixel is not finite.
template <class T, class Rule>
bool forward_bands(const nablahog_tables& tables, const Images& images, Range bands, T* band_cells) {
  thread_local Workspace work;
  work.clear();
  Forward<T, Rule> pass(tables, images, work);
  const int64_t size = Pooling<T>::band_size(tables);
  return pass.bands(0, bands, [&](int64_t band, const T* of_band) {
    std::memcpy(band_cells + band * size, of_band, size * sizeof(T));
  });
}

// The cells of an image from those of all its bands, always summed in the same order
template <class T>
void join_bands(const nablahog_tables& tables, const T* band_cells, T* cells) {
  thread_local Workspace work;
  work.clear();
  const Pooling<T> pooling(tables, work);
  std::memset(cells, 0, cells_size(tables) * sizeof(T));
  for (int64_t band = 0; band < tables.rows.stretches; ++band) {
    pooling.add_band(band, band_cells + band * Pooling<T>::band_size(tables), cells);
  }
}

}  // namespace nablahog
