// Tangents of cells and descriptors from those of images, a band of rows at a time.
#pragma once

#include "gradient.h"
#include "operator.h"
#include "pooling.h"
#include "votes.h"

namespace nablahog {

// Tangents of a pixel's votes for its own bin, the next, and the one before
template <class V>
struct VoteTangents {
  V here, after, before;
};

// The part by the tangent of the magnitude; of hard votes f is 0.
template <class V>
[[gnu::always_inline]] inline VoteTangents<V> along_jvp(V m, V f, V u, V v, V du, V dv) {
  using T = Element<V>;
  const V longer = m > T(0) ? (u * du + v * dv) / m : V{}, far = longer * f;
  return {longer - far, far, V{}};
}

// The part by the tangent of the angle
template <class V>
[[gnu::always_inline]] inline VoteTangents<V> across_jvp(V m, V f, V u, V v, V du, V dv, V slope) {
  using T = Element<V>;
  const V turned = m > T(0) ? slope * (u * dv - v * du) / m : V{}, half = turned * T(0.5);
  const auto centre = f == T(0);
  return {centre ? V{} : -turned, centre ? half : turned, centre ? -half : V{}};
}

// The jvp of Eq. 1-6, with tangents of the pixels
template <class T, class Rule>
class Jvp {
 public:
  using V = Vec<T>;
  using I = Vec<Int<T>>;

  Jvp(const nablahog_tables& tables, const Images& images, const T* tangents, Workspace& work)
      : tables_(tables),
        stride_(round_up(tables.width, lanes<T>)),
        reader_(tables, images, tangents, work),
        rule_(tables, work),
        exact_(tables, work),
        pooling_(tables, work),
        votes_(planes(work)),
        exact_votes_(Rule::inexact ? planes(work) : Planes<T>{}) {}

  // Tangents of the cells of an image.  Returns whether a pixel is not finite.
  bool cells(int64_t image, T* out) {
    std::memset(out, 0, cells_size(tables_) * sizeof(T));
    reader_.begin(image, 0);
    for (int64_t band = 0; band < tables_.rows.stretches; ++band) {
      const Stretch rows = stretch(tables_.rows, band);
      for (int64_t y = rows.begin; y < rows.end; ++y) vote(y, (y - rows.begin) * stride_);
      pooling_.add_band(band, pooling_.template pool<Rule::hard ? 1 : 3>(band, votes_), out);
      if constexpr (Rule::inexact) pooling_.add_band(band, pooling_.template pool<3>(band, exact_votes_), out);
    }
    reader_.read_until(tables_.height);
    if (reader_.is_broken()) pooling_.clear();
    return reader_.is_broken();
  }

 private:
  Planes<T> planes(Workspace& work) const {
    const int64_t size = stride_ * tables_.rows.longest + lanes<T>;
    return {work.zeros<T>(size), work.zeros<T>(size), work.zeros<T>(size), work.zeros<Int<T>>(size), stride_};
  }

  void vote(int64_t y, int64_t at) {
    const auto* lines = reader_.lines_at(y);
    const V slope = splat<V>(T(tables_.slope));
    for (int64_t x = 0; x < tables_.width; x += lanes<T>) {
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
    keep_nothing(votes_, at + tables_.width);
    if constexpr (Rule::inexact) keep_nothing(exact_votes_, at + tables_.width);
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

  const nablahog_tables& tables_;
  const int64_t stride_;
  Reader<DualPointer<T>> reader_;
  const Rule rule_;
  const Linear<T> exact_;
  Pooling<T> pooling_;
  const Planes<T> votes_, exact_votes_;
};

// Tangents of descriptors or, if `cells` is null, of cells, from those of images (images, channels, height, width)
template <class T, class Rule>
void jvp(const nablahog_tables& tables, const Images& images, Range range, const T* tangents, const T* cells, T* out) {
  thread_local Workspace work;
  work.clear();
  Jvp<T, Rule> pass(tables, images, tangents, work);
  const auto norm = cells ? make_normalizer<T>(tables, work) : nullptr;
  const int64_t size = cells ? out_size(tables) : cells_size(tables);
  T* cell_tangents = work.zeros<T>(cells ? cells_size(tables) : 0);
  T* values = work.zeros<T>(cells ? size : 0);
  for (int64_t image = range.first; image < range.last; ++image) {
    T* to = out + image * size;
    const bool broken = pass.cells(image, cells ? cell_tangents : to);
    if (broken) {
      fill_nan(to, size);
    } else if (cells) {
      norm->jvp({cells + image * cells_size(tables), cell_tangents}, {values, to});
    }
  }
}

}  // namespace nablahog
