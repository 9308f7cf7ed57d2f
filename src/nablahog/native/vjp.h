// Gradients of images from those of cells or descriptors, a row at a time.
#pragma once

#include "gradient_vjp.h"
#include "operator.h"
#include "pooling_vjp.h"
#include "votes.h"

namespace nablahog {

// The gradient with respect to the magnitude, over the magnitude, from that with respect to a vote of this size
template <class V>
[[gnu::always_inline]] inline V along_vjp(V m, V grad) {
  using T = Element<V>;
  const auto some = m > T(0);
  const V inverse = some ? T(1) / m : V{};
  return some ? grad * inverse : V{};
}

// The angle moves votes between bins, on a bin's centre by the mean of both sides: the gradient with respect to the
// angle, over the magnitude.  `slope` is in bins per radian.
template <class V>
[[gnu::always_inline]] inline V across_vjp(V m, V f, const VoteGradients<V>& grad, V slope) {
  using T = Element<V>;
  const auto some = m > T(0);
  const V inverse = some ? T(1) / m : V{};
  const V change = f == T(0) ? (grad.after - grad.before) * T(0.5) : grad.after - grad.here;
  return some ? slope * change * inverse : V{};
}

// The vjp of Eq. 1-6.  Votes are recomputed, which takes less time than reading them from memory.
template <class T, class Rule>
class Vjp {
 public:
  using V = Vec<T>;
  using I = Vec<Int<T>>;

  Vjp(const nablahog_tables& tables, const Images& images, Workspace& work)
      : tables_(tables),
        reader_(tables, images, nullptr, work),
        rule_(tables, work),
        exact_(tables, work),
        pooling_(tables, work),
        writer_(tables, images, work),
        gx_(row<T>(work)),
        gy_(row<T>(work)),
        m_(row<T>(work)),
        f_(row<T>(work)),
        winner_(row<Int<T>>(work)),
        bin_(row<Int<T>>(work)),
        exact_bin_(row<Int<T>>(work)) {}

  // Rows of the gradients of an image (channels, height, width).  Returns whether a pixel near them is not finite.
  bool rows(int64_t image, Range rows, const T* grad_cells, T* grad_image) {
    const int64_t height = tables_.height, first = rows.first > 0 ? rows.first - 1 : 0;
    reader_.begin(image, first);
    writer_.begin(image);
    int64_t band = 0, begun = -1;
    for (int64_t y = first; y <= rows.last; ++y) {  // with the rows beside those wanted
      while (band < tables_.rows.stretches && y >= stretch(tables_.rows, band).end) ++band;
      if (y < height && band < tables_.rows.stretches && y >= stretch(tables_.rows, band).begin) {
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
    return work.zeros<N>(round_up(tables_.width, lanes<T>));
  }

  // In two loops: votes depend on each other's results in long chains, of which processors then overlap more.
  void row(int64_t y) {
    const auto* lines = reader_.lines_at(y);
    for (int64_t x = 0; x < tables_.width; x += lanes<T>) {
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
    const V slope = splat<V>(T(tables_.slope));
    for (int64_t x = 0; x < tables_.width; x += lanes<T>) {
      const V gx = load<V>(gx_ + x), gy = load<V>(gy_ + x), m = load<V>(m_ + x);
      const I winner = load<I>(winner_ + x);
      const VoteGradients<V> grad = pooling_.template read<Rule::hard>(x, bin_);
      if constexpr (Rule::hard) {
        const V along = along_vjp(m, grad.here);
        writer_.put(y, x, along * gx, along * gy, winner);
      } else {
        const V f = load<V>(f_ + x), along = along_vjp(m, grad.here + f * (grad.after - grad.here));
        V across;
        if constexpr (Rule::inexact) {  // derivatives are by the exact angle
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

  const nablahog_tables& tables_;
  Reader<T*> reader_;
  const Rule rule_;
  const Linear<T> exact_;
  PoolingVjp<T> pooling_;
  Writer<T> writer_;
  T *gx_, *gy_, *m_, *f_;
  Int<T>*winner_, *bin_, *exact_bin_;
};

// Gradients of images (images, channels, height, width) from `grad`: of their descriptors, or, if `cells` is null, of
// their cells
template <class T, class Rule>
void vjp(const nablahog_tables& tables, const Images& images, Range range, const T* cells, const T* grad,
         T* grad_images) {
  thread_local Workspace work;
  work.clear();
  Vjp<T, Rule> pass(tables, images, work);
  const auto norm = cells ? make_normalizer<T>(tables, work) : nullptr;
  T* grad_cells = work.zeros<T>(cells ? cells_size(tables) : 0);
  for (int64_t image = range.first; image < range.last; ++image) {
    T* of_image = grad_images + image * image_size(tables);
    const T* of_cells = grad_cells;
    if (cells) {
      norm->vjp(cells + image * cells_size(tables), grad + image * out_size(tables), grad_cells);
    } else {
      of_cells = grad + image * cells_size(tables);
    }
    if (pass.rows(image, {0, tables.height}, of_cells, of_image)) fill_nan(of_image, image_size(tables));
  }
}

// Rows of the gradient of one image from that of its cells, for threads that share it.  Returns whether a pixel is not
// finite.
template <class T, class Rule>
bool vjp_rows(const nablahog_tables& tables, const Images& images, Range rows, const T* grad_cells, T* grad_image) {
  thread_local Workspace work;
  work.clear();
  return Vjp<T, Rule>(tables, images, work).rows(0, rows, grad_cells, grad_image);
}

}  // namespace nablahog
