// The passes over images, a band of rows at a time: hog, its vjp and its jvp.
#pragma once

#include <limits>

#include "block_norm.h"
#include "cell_norm.h"
#include "four_block_norm.h"
#include "global_norm.h"
#include "gradient.h"
#include "plan.h"
#include "pooling.h"
#include "votes.h"

namespace nablahog {

// first … last - 1
struct Range {
  int64_t first, last;
};

inline int64_t cells_size(const nablahog_plan& plan) { return plan.rows.cells * plan.cols.cells * plan.bins; }
inline int64_t out_size(const nablahog_plan& plan) { return plan.out_rows * plan.out_cols * plan.out_channels; }
inline int64_t image_size(const nablahog_plan& plan) { return plan.channels * plan.height * plan.width; }

template <class T>
void fill_nan(T* to, int64_t count) {
  for (int64_t k = 0; k < count; ++k) to[k] = std::numeric_limits<T>::quiet_NaN();
}

template <class T>
std::unique_ptr<Normalizer<T>> make_normalizer(const nablahog_plan& plan, Workspace& work) {
  switch (plan.normalizer) {
    case NABLAHOG_GLOBAL:
      return std::make_unique<GlobalNorm<T>>(plan, work);
    case NABLAHOG_CELL:
      return std::make_unique<CellNorm<T>>(plan, work);
    case NABLAHOG_BLOCK:
      return std::make_unique<BlockNorm<T>>(plan, work);
    case NABLAHOG_FOUR_BLOCK:
      return std::make_unique<FourBlockNorm<T>>(plan, work);
    default:
      return nullptr;
  }
}

// Eq. 1-6: the cells of images, a band at a time
template <class T, class Rule>
class Forward {
 public:
  Forward(const nablahog_plan& plan, const Images& images, Workspace& work)
      : plan_(plan),
        stride_(round_up(plan.width, lanes<T>)),
        reader_(plan, images, nullptr, work),
        rule_(plan, work),
        pooling_(plan, work),
        votes_{plane<T>(work), plane<T>(work), nullptr, plane<Int<T>>(work), stride_} {}

  // Calls body(band, its cells) for bands of an image.  Returns whether a pixel is NaN or infinite, of the rows of
  // these bands and, before the first and behind the last, of all others.
  template <class F>
  bool bands(int64_t image, Range bands, F body) {
    reader_.begin(image, bands.first > 0 ? stretch(plan_.rows, bands.first).begin : 0);
    for (int64_t band = bands.first; band < bands.last; ++band) {
      const Stretch rows = stretch(plan_.rows, band);
      for (int64_t y = rows.begin; y < rows.end; ++y) vote(y, (y - rows.begin) * stride_);
      body(band, pooling_.template pool<Rule::hard ? 1 : 2>(band, votes_));
    }
    const bool at_end = bands.last == plan_.rows.stretches;
    reader_.read_until(at_end ? plan_.height : stretch(plan_.rows, bands.last).begin);
    const bool broken = reader_.is_broken();
    if (broken) pooling_.clear();
    return broken;
  }

  void add_band(int64_t band, const T* band_cells, T* cells) const { pooling_.add_band(band, band_cells, cells); }

 private:
  template <class N>
  N* plane(Workspace& work) const {
    return work.zeros<N>(stride_ * plan_.rows.longest + lanes<T>);
  }

  void vote(int64_t y, int64_t at) {
    const auto* lines = reader_.lines_at(y);
    for (int64_t x = 0; x < plan_.width; x += lanes<T>) {
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
    store(votes_.here + at + plan_.width, Vec<T>{});  // pixels beyond the row give nothing
    if constexpr (!Rule::hard) store(votes_.after + at + plan_.width, Vec<T>{});
  }

  const nablahog_plan& plan_;
  const int64_t stride_;
  Reader<T*> reader_;
  const Rule rule_;
  Pooling<T> pooling_;
  const Planes<T> votes_;
};

// Images to their cells (images, rows, cols, bins) and, unless `out` is null, descriptors
template <class T, class Rule>
void forward(const nablahog_plan& plan, const Images& images, Range range, T* cells, T* out) {
  thread_local Workspace work;
  work.clear();
  Forward<T, Rule> pass(plan, images, work);
  const auto norm = make_normalizer<T>(plan, work);
  for (int64_t image = range.first; image < range.last; ++image) {
    T* of_image = cells + image * cells_size(plan);
    std::memset(of_image, 0, cells_size(plan) * sizeof(T));
    const bool broken = pass.bands(image, {0, plan.rows.stretches}, [&](int64_t band, const T* band_cells) {
      pass.add_band(band, band_cells, of_image);
    });
    if (broken) fill_nan(of_image, cells_size(plan));
    if (!out) continue;
    if (broken) {
      fill_nan(out + image * out_size(plan), out_size(plan));
    } else {
      norm->forward(of_image, out + image * out_size(plan));
    }
  }
}

// The cells of bands of one image, to `band_cells` (bands, …), for threads that share an image.  Returns whether a
// pixel is not finite.
template <class T, class Rule>
bool forward_bands(const nablahog_plan& plan, const Images& images, Range bands, T* band_cells) {
  thread_local Workspace work;
  work.clear();
  Forward<T, Rule> pass(plan, images, work);
  const int64_t size = Pooling<T>::band_size(plan);
  return pass.bands(0, bands, [&](int64_t band, const T* of_band) {
    std::memcpy(band_cells + band * size, of_band, size * sizeof(T));
  });
}

// The cells of an image from those of all its bands, always summed in the same order
template <class T>
void join_bands(const nablahog_plan& plan, const T* band_cells, T* cells) {
  thread_local Workspace work;
  work.clear();
  const Pooling<T> pooling(plan, work);
  std::memset(cells, 0, cells_size(plan) * sizeof(T));
  for (int64_t band = 0; band < plan.rows.stretches; ++band) {
    pooling.add_band(band, band_cells + band * Pooling<T>::band_size(plan), cells);
  }
}

// The vjp of Eq. 1-6.  Votes are recomputed, which takes less time than reading them from memory.
template <class T, class Rule>
class Vjp {
 public:
  using V = Vec<T>;
  using I = Vec<Int<T>>;

  Vjp(const nablahog_plan& plan, const Images& images, Workspace& work)
      : plan_(plan),
        reader_(plan, images, nullptr, work),
        rule_(plan, work),
        exact_(plan, work),
        pooling_(plan, work),
        writer_(plan, images, work),
        gx_(row<T>(work)),
        gy_(row<T>(work)),
        m_(row<T>(work)),
        f_(row<T>(work)),
        winner_(row<Int<T>>(work)),
        bin_(row<Int<T>>(work)),
        exact_bin_(row<Int<T>>(work)) {}

  // Rows of the gradients of an image (channels, height, width).  Returns whether a pixel near them is not finite.
  bool rows(int64_t image, Range rows, const T* grad_cells, T* grad_image) {
    const int64_t height = plan_.height, first = rows.first > 0 ? rows.first - 1 : 0;
    reader_.begin(image, first);
    writer_.begin(image);
    int64_t band = 0, begun = -1;
    for (int64_t y = first; y <= rows.last; ++y) {  // with the rows beside those wanted
      while (band < plan_.rows.stretches && y >= stretch(plan_.rows, band).end) ++band;
      if (y < height && band < plan_.rows.stretches && y >= stretch(plan_.rows, band).begin) {
        if (begun != band) pooling_.begin_band(band, grad_cells);
        begun = band;
        row(y);
      } else {
        writer_.clear_row(y);
      }
      if (y > rows.first) writer_.write_row(y - 1, grad_image);
    }
    reader_.read_until(rows.last);
    return reader_.is_broken();
  }

 private:
  template <class N>
  N* row(Workspace& work) const {
    return work.zeros<N>(round_up(plan_.width, lanes<T>));
  }

  // In two loops: votes depend on each other's results in long chains, of which processors then overlap more.
  void row(int64_t y) {
    const auto* lines = reader_.lines_at(y);
    for (int64_t x = 0; x < plan_.width; x += lanes<T>) {
      const auto g = reader_.gradients(lines, x);
      const Votes<T> votes = rule_(g.x, g.y);
      store(gx_ + x, g.x);
      store(gy_ + x, g.y);
      store(winner_ + x, g.winner);
      store(m_ + x, votes.m);
      store(bin_ + x, votes.bin);
      if constexpr (!Rule::hard) store(f_ + x, votes.f);
    }
    pooling_.begin_row(y);
    const V slope = splat<V>(T(plan_.slope));
    for (int64_t x = 0; x < plan_.width; x += lanes<T>) {
      const V gx = load<V>(gx_ + x), gy = load<V>(gy_ + x), m = load<V>(m_ + x);
      const I winner = load<I>(winner_ + x);
      const VoteGradients<V> grad = pooling_.template read<Rule::hard>(x, bin_);
      if constexpr (Rule::hard) {
        const V along = along_vjp(m, grad.here);
        writer_.put(y, x, along * gx, along * gy, winner);
      } else {
        const V f = load<V>(f_ + x), along = along_vjp(m, f, grad.here, grad.after);
        V across;
        if constexpr (Rule::inexact) {  // derivatives by the angle are those of the exact one
          const Votes<T> exact = exact_(gx, gy);
          store(exact_bin_ + x, exact.bin);
          across = across_vjp(m, exact.f, pooling_.template read<false>(x, exact_bin_), slope);
        } else {
          across = across_vjp(m, f, grad, slope);
        }
        writer_.put(y, x, along * gx - across * gy, along * gy + across * gx, winner);
      }
    }
    writer_.finish_row(y);
  }

  const nablahog_plan& plan_;
  Reader<T*> reader_;
  const Rule rule_;
  const Linear<T> exact_;
  PoolingVjp<T> pooling_;
  Writer<T> writer_;
  T *gx_, *gy_, *m_, *f_, *along_;
  Int<T>*winner_, *bin_, *exact_bin_;
};

// Gradients of images (images, channels, height, width) from `grad`: of their descriptors, or, if `cells` is null, of
// their cells
template <class T, class Rule>
void vjp(const nablahog_plan& plan, const Images& images, Range range, const T* cells, const T* grad, T* grad_images) {
  thread_local Workspace work;
  work.clear();
  Vjp<T, Rule> pass(plan, images, work);
  const auto norm = cells ? make_normalizer<T>(plan, work) : nullptr;
  T* grad_cells = work.zeros<T>(cells ? cells_size(plan) : 0);
  for (int64_t image = range.first; image < range.last; ++image) {
    T* of_image = grad_images + image * image_size(plan);
    const T* of_cells = grad_cells;
    if (cells) {
      norm->vjp(cells + image * cells_size(plan), grad + image * out_size(plan), grad_cells);
    } else {
      of_cells = grad + image * cells_size(plan);
    }
    if (pass.rows(image, {0, plan.height}, of_cells, of_image)) fill_nan(of_image, image_size(plan));
  }
}

// Rows of the gradient of one image from that of its cells, for threads that share it.  Returns whether a pixel is not
// finite.
template <class T, class Rule>
bool vjp_rows(const nablahog_plan& plan, const Images& images, Range rows, const T* grad_cells, T* grad_image) {
  thread_local Workspace work;
  work.clear();
  return Vjp<T, Rule>(plan, images, work).rows(0, rows, grad_cells, grad_image);
}

// The jvp of Eq. 1-6, with tangents of the pixels
template <class T, class Rule>
class Jvp {
 public:
  using V = Vec<T>;
  using I = Vec<Int<T>>;

  Jvp(const nablahog_plan& plan, const Images& images, const T* tangents, Workspace& work)
      : plan_(plan),
        stride_(round_up(plan.width, lanes<T>)),
        reader_(plan, images, tangents, work),
        rule_(plan, work),
        exact_(plan, work),
        pooling_(plan, work),
        votes_(planes(work)),
        exact_votes_(Rule::inexact ? planes(work) : Planes<T>{}) {}

  // Tangents of the cells of an image.  Returns whether a pixel is not finite.
  bool cells(int64_t image, T* out) {
    std::memset(out, 0, cells_size(plan_) * sizeof(T));
    reader_.begin(image, 0);
    for (int64_t band = 0; band < plan_.rows.stretches; ++band) {
      const Stretch rows = stretch(plan_.rows, band);
      for (int64_t y = rows.begin; y < rows.end; ++y) vote(y, (y - rows.begin) * stride_);
      pooling_.add_band(band, pooling_.template pool<Rule::hard ? 1 : 3>(band, votes_), out);
      if constexpr (Rule::inexact) pooling_.add_band(band, pooling_.template pool<3>(band, exact_votes_), out);
    }
    reader_.read_until(plan_.height);
    if (reader_.is_broken()) pooling_.clear();
    return reader_.is_broken();
  }

 private:
  Planes<T> planes(Workspace& work) const {
    const int64_t size = stride_ * plan_.rows.longest + lanes<T>;
    return {work.zeros<T>(size), work.zeros<T>(size), work.zeros<T>(size), work.zeros<Int<T>>(size), stride_};
  }

  void vote(int64_t y, int64_t at) {
    const auto* lines = reader_.lines_at(y);
    const V slope = splat<V>(T(plan_.slope));
    for (int64_t x = 0; x < plan_.width; x += lanes<T>) {
      const auto g = reader_.gradients(lines, x);
      const V u = g.x.value, v = g.y.value, du = g.x.tangent, dv = g.y.tangent;
      const Votes<T> votes = rule_(u, v);
      VoteTangents<V> tangents = along_jvp(votes.m, votes.f, u, v, du, dv);
      if constexpr (Rule::inexact) {
        const Votes<T> exact = exact_(u, v);
        keep(exact_votes_, at + x, across_jvp(votes.m, exact.f, u, v, du, dv, slope), exact.bin);
      } else if constexpr (!Rule::hard) {
        const VoteTangents<V> across = across_jvp(votes.m, votes.f, u, v, du, dv, slope);
        tangents = {tangents.here + across.here, tangents.after + across.after, across.before};
      }
      keep(votes_, at + x, tangents, votes.bin);
    }
    keep_nothing(votes_, at + plan_.width);
    if constexpr (Rule::inexact) keep_nothing(exact_votes_, at + plan_.width);
  }

  [[gnu::always_inline]] static void keep(const Planes<T>& to, int64_t at, VoteTangents<V> tangents, I bin) {
    store(to.here + at, tangents.here);
    store(to.after + at, tangents.after);
    store(to.before + at, tangents.before);
    store(to.bin + at, bin);
  }
  static void keep_nothing(const Planes<T>& to, int64_t at) {
    for (T* plane : {to.here, to.after, to.before}) store(plane + at, V{});
  }

  const nablahog_plan& plan_;
  const int64_t stride_;
  Reader<DualPointer<T>> reader_;
  const Rule rule_;
  const Linear<T> exact_;
  Pooling<T> pooling_;
  const Planes<T> votes_, exact_votes_;
};

// Tangents of descriptors or, if `cells` is null, of cells, from those of images (images, channels, height, width)
template <class T, class Rule>
void jvp(const nablahog_plan& plan, const Images& images, Range range, const T* tangents, const T* cells, T* out) {
  thread_local Workspace work;
  work.clear();
  Jvp<T, Rule> pass(plan, images, tangents, work);
  const auto norm = cells ? make_normalizer<T>(plan, work) : nullptr;
  const int64_t size = cells ? out_size(plan) : cells_size(plan);
  T* cell_tangents = work.zeros<T>(cells ? cells_size(plan) : 0);
  T* values = work.zeros<T>(cells ? size : 0);
  for (int64_t image = range.first; image < range.last; ++image) {
    T* to = out + image * size;
    const bool broken = pass.cells(image, cells ? cell_tangents : to);
    if (broken) {
      fill_nan(to, size);
    } else if (cells) {
      norm->jvp({cells + image * cells_size(plan), cell_tangents}, {values, to});
    }
  }
}

// ---- The normaliser alone ------------------------------------------------------------------------------------------

template <class T>
void normalize(const nablahog_plan& plan, Range range, const T* cells, T* out) {
  thread_local Workspace work;
  work.clear();
  const auto norm = make_normalizer<T>(plan, work);
  for (int64_t image = range.first; image < range.last; ++image) {
    norm->forward(cells + image * cells_size(plan), out + image * out_size(plan));
  }
}

template <class T>
void normalize_vjp(const nablahog_plan& plan, Range range, const T* cells, const T* grad_out, T* grad_cells) {
  thread_local Workspace work;
  work.clear();
  const auto norm = make_normalizer<T>(plan, work);
  for (int64_t image = range.first; image < range.last; ++image) {
    const int64_t at = image * cells_size(plan);
    norm->vjp(cells + at, grad_out + image * out_size(plan), grad_cells + at);
  }
}

template <class T>
void normalize_jvp(const nablahog_plan& plan, Range range, const T* cells, const T* tangents, T* out) {
  thread_local Workspace work;
  work.clear();
  const auto norm = make_normalizer<T>(plan, work);
  T* values = work.zeros<T>(out_size(plan));
  for (int64_t image = range.first; image < range.last; ++image) {
    const int64_t at = image * cells_size(plan);
    norm->jvp({cells + at, tangents + at}, {values, out + image * out_size(plan)});
  }
}

}  // namespace nablahog
