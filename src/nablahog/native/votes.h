// Eq. 2-4: gradients to votes.  A pixel of magnitude m gives (1 - f) · m to one bin and f · m to the next; a hard vote
// has no f.  Ties are decided by rounding: products are fused with sums only in polynomials.
#pragma once

#include "tables.h"
#include "vec.h"
#include "workspace.h"

namespace nablahog {

template <class T>
struct Votes {
  Vec<T> m, f;
  Vec<Int<T>> bin;
};

// ‖∇‖ of Eq. 2
template <class T>
[[gnu::always_inline]] inline Vec<T> magnitude(Vec<T> u, Vec<T> v, T tiny) {
  const Vec<T> squared = u * u + v * v;
  return squared < splat<Vec<T>>(tiny) ? Vec<T>{} : sqrt(squared);
}

// The angle of (u, v) in half turns, -1…1, by a polynomial of atan(t) / π within 8e-8.  It is odd, so that right angles
// are exact; so are their halves.
[[gnu::always_inline]] inline Vec<float> half_turns(Vec<float> u, Vec<float> v) {
  using V = Vec<float>;
  constexpr float odd[] = {0.3183086485f,  -0.1060524763f,  0.06305023492f, -0.04212303499f,
                           0.02534499976f, -0.01069655349f, 0.002168260411f};
  const V au = abs(u), av = abs(v), least = splat<V>(0x1p-120f);  // of a zero gradient, any number
  const auto steep = au < av;
  const V small = steep ? au : av, large = steep ? av : au, t = small / (large < least ? least : large);
  V turn = t * polynomial(t * t, odd);
  turn = small == large ? splat<V>(0.25f) : turn;
  turn = steep ? 0.5f - turn : turn;
  turn = u < 0.0f ? 1.0f - turn : turn;
  return copysign(turn, v);
}

// The same in double precision, in radians first: derivatives jump at a bin's centre, and an angle that is one only by
// rounding must round as that of the C library.  By the coefficients of Cephes, atan(t) = t + t³ P(t²) / Q(t²) for
// |t| ≤ tan(π/8); constants have a second part, the digits beyond a double.
[[gnu::always_inline]] inline Vec<double> half_turns(Vec<double> u, Vec<double> v) {
  using V = Vec<double>;
  constexpr double p[] = {-6.485021904942025371773e1, -1.228866684490136173410e2, -7.500855792314704667340e1,
                          -1.615753718733365076637e1, -8.750608600031904122785e-1};
  constexpr double q[] = {1.945506571482613964425e2, 4.853903996359136964868e2, 4.328810604912902668951e2,
                          1.650270098316988542046e2, 2.485846490142306297962e1, 1.0};
  constexpr double pi = 3.141592653589793116, more = 1.2246467991473532e-16;
  const V au = abs(u), av = abs(v), least = splat<V>(0x1p-1000);
  const auto steep = au < av;
  const V small = steep ? au : av, larger = steep ? av : au, large = larger < least ? least : larger;
  const auto turned = small > large * 0.41421356237309503;  // back by π/4
  const V t = (turned ? small - large : small) / (turned ? small + large : large), s = t * t;
  V angle = multiply_add(t * s, polynomial(s, p) / polynomial(s, q), t);
  angle = turned ? (angle + more / 4) + pi / 4 : angle;
  angle = steep ? pi / 2 - (angle - more / 2) : angle;
  angle = u < 0.0 ? pi - (angle - more) : angle;
  return copysign(angle / pi, v);
}

// A position among bin centres, in bins: the bin at or before it, cyclic, and the distance from there; bin 0 of NaN
template <class V>
struct Position {
  V distance, bin;

  [[gnu::always_inline]] Position(V position, V count, V per_bin) {
    const V before = floor(position);
    const V wrapped = before - floor((before + Element<V>(0.5)) * per_bin) * count;
    distance = position - before;
    bin = wrapped > Element<V>(0) ? wrapped : V{};
  }
};

// Linear votes by the exact angle
template <class T>
class Linear {
 public:
  static constexpr bool hard = false, inexact = false;

  Linear(const nablahog_tables& tables, Workspace&)
      : tiny_(T(tables.tiny)),
        up_(T(tables.up)),
        to_bins_(T(tables.bins_per_half_turn)),
        offset_(T(tables.bin_offset)),
        count_(T(tables.bins)),
        per_bin_(T(1.0 / tables.bins)) {}

  [[gnu::always_inline]] Votes<T> operator()(Vec<T> u, Vec<T> v) const {
    using V = Vec<T>;
    const V m = magnitude<T>(u, v, tiny_);
    V turns = half_turns(u, v * up_);
    if constexpr (sizeof(T) == 8) turns = m > T(0) ? turns : V{};
    const Position<V> at(turns * to_bins_ - offset_, splat<V>(count_), splat<V>(per_bin_));
    return {m, at.distance, to_int(at.bin)};
  }

 private:
  const T tiny_, up_, to_bins_, offset_, count_, per_bin_;
};

// Linear votes by OpenCV's arctangent, a polynomial in degrees, in float32: orientation.opencv_angle
template <class T>
class OpenCV {
 public:
  static constexpr bool hard = false, inexact = false;

  OpenCV(const nablahog_tables& tables, Workspace&)
      : tiny_(T(tables.tiny)),
        table_(tables.arctangent),
        offset_(float(tables.bin_offset)),
        count_(float(tables.bins)),
        per_bin_(float(1.0 / tables.bins)) {}

  [[gnu::always_inline]] Votes<T> operator()(Vec<T> u, Vec<T> v) const {
    using V = Vec<float, lanes<T>>;
    const float p1 = table_[0], p3 = table_[1], p5 = table_[2], p7 = table_[3];
    const float guard = table_[4], radian = table_[5], per_radian = table_[6];
    const V x = __builtin_convertvector(u, V), y = __builtin_convertvector(v, V);
    const V ax = abs(x), ay = abs(y);
    const auto steep = ax < ay;
    const V small = steep ? ax : ay, large = steep ? ay : ax;
    const V t = small / (large + guard), s = t * t;
    V angle = (((p7 * s + p5) * s + p3) * s + p1) * t;
    angle = steep ? 90.0f - angle : angle;
    angle = x < 0.0f ? 180.0f - angle : angle;
    angle = y < 0.0f ? 360.0f - angle : angle;
    const Position<V> at(angle * radian * per_radian - offset_, splat<V>(count_), splat<V>(per_bin_));
    return {magnitude<T>(u, v, tiny_), __builtin_convertvector(at.distance, Vec<T>),
            __builtin_convertvector(at.bin, Vec<Int<T>>)};
  }

 private:
  const T tiny_;
  const float* table_;
  const float offset_, count_, per_bin_;
};

// The arccosine of 0…1 in some unit of angle, four times the arcsine s of the sine of a quarter of the angle:
// with the coefficients of fdlibm s = x (1 + x² P(x²) / Q(x²)), in one division.
[[gnu::always_inline]] inline Vec<double> arccosine(Vec<double> cosine, double unit) {
  using V = Vec<double>;
  constexpr double p[] = {1.66666666666666657415e-01,  -3.25565818622400915405e-01, 2.01212532134862925881e-01,
                          -4.00555345006794114027e-02, 7.91534994289814532176e-04,  3.47933107596021167570e-05};
  constexpr double q[] = {1.0, -2.40339491173441421878, 2.02094576023350569471, -6.88283971605453293030e-01,
                          7.70381505559019352791e-02};
  const V z = 0.5 - sqrt(cosine * 0.5 + 0.5) * 0.5, denominator = polynomial(z, q);
  return sqrt(z) * multiply_add(z, polynomial(z, p), denominator) * 4.0 / (denominator * unit);
}

// Linear votes by VLFeat's arccosine of the cosine to the nearest axis, in float32: orientation.vlfeat_weights.  The
// axis nearest by dot product and the next get the vote.
template <class T>
class VLFeat {
 public:
  static constexpr bool hard = false, inexact = true;  // derivatives are by the exact angle

  VLFeat(const nablahog_tables& tables, Workspace& work)
      : tiny_(T(tables.tiny)),
        axes_(int(tables.directions_count)),
        opposite_(tables.is_signed ? axes_ : 0),
        bins_(tables.bins),
        least_(tables.arccosine_least),
        unit_(tables.arccosine_unit),
        directions_(work.zeros<float>(2 * axes_)) {
    for (int k = 0; k < 2 * axes_; ++k) directions_[k] = float(tables.directions[k]);
  }

  [[gnu::always_inline]] Votes<T> operator()(Vec<T> u, Vec<T> v) const {
    using V = Vec<float, lanes<T>>;
    using I = Vec<int32_t, lanes<T>>;
    const V x = __builtin_convertvector(u, V), y = __builtin_convertvector(v, V);
    V largest = splat<V>(-1.0f), next = splat<V>(-1.0f);
    I best{}, second{};
    for (int k = 0; k < axes_; ++k) {
      const V dot = x * directions_[k] + y * directions_[axes_ + k], length = abs(dot);
      const I bin = splat<I>(k) + (dot < 0.0f ? splat<I>(opposite_) : I{});
      const auto better = largest < length, good = next < length;
      next = better ? largest : good ? length : next;
      second = better ? best : good ? bin : second;
      largest = better ? length : largest;
      best = better ? bin : best;
    }
    const V of_second = share_of_second(largest, sqrt(x * x + y * y));
    I after = best + 1;
    after = after == bins_ ? I{} : after;
    const auto ahead = second == after;
    return {magnitude<T>(u, v, tiny_), __builtin_convertvector(ahead ? of_second : 1.0f - of_second, Vec<T>),
            __builtin_convertvector(ahead ? best : second, Vec<Int<T>>)};
  }

 private:
  // In as many vectors of double as are needed; VLFeat rounds the cosine to float32.
  template <class V>
  [[gnu::always_inline]] V share_of_second(V projection, V length) const {
    using D = Vec<double>;
    using Single = Vec<float, lanes<double>>;
    constexpr int parts = size<V> / lanes<double>;
    Single projections[parts], lengths[parts], shares[parts];
    std::memcpy(projections, &projection, sizeof projection);
    std::memcpy(lengths, &length, sizeof length);
    NABLAHOG_UNROLL
    for (int k = 0; k < parts; ++k) {
      const D size = __builtin_convertvector(lengths[k], D);
      D cosine = __builtin_convertvector(projections[k], D) / (size > least_ ? size : splat<D>(least_));
      cosine = cosine < 1.0 ? cosine : splat<D>(1.0);
      const D rounded = __builtin_convertvector(__builtin_convertvector(cosine, Single), D);
      shares[k] = __builtin_convertvector(arccosine(rounded, unit_), Single);
    }
    return join<V>(shares);
  }

  const T tiny_;
  const int axes_, opposite_, bins_;
  const double least_, unit_;
  float* directions_;
};

// Hard votes for the largest |dot product| with the bins' directions, the first on ties
template <class T>
class Nearest {
 public:
  static constexpr bool hard = true, inexact = false;

  Nearest(const nablahog_tables& tables, Workspace& work)
      : tiny_(T(tables.tiny)),
        axes_(int(tables.directions_count)),
        opposite_(tables.is_signed ? axes_ : 0),
        directions_(work.zeros<T>(2 * axes_)) {
    for (int k = 0; k < 2 * axes_; ++k) directions_[k] = T(tables.directions[k]);
  }

  [[gnu::always_inline]] Votes<T> operator()(Vec<T> u, Vec<T> v) const {
    using V = Vec<T>;
    using I = Vec<Int<T>>;
    V largest = splat<V>(-1), product{};
    I axis{};
    for (int k = 0; k < axes_; ++k) {
      const V dot = u * directions_[k] + v * directions_[axes_ + k], length = abs(dot);
      const auto better = largest < length;
      largest = better ? length : largest;
      product = better ? dot : product;
      axis = better ? splat<I>(k) : axis;
    }
    return {magnitude<T>(u, v, tiny_), V{}, axis + (product < T(0) ? splat<I>(opposite_) : I{})};
  }

 private:
  const T tiny_;
  const int axes_;
  const Int<T> opposite_;  // bins to the bin of the opposite direction
  T* directions_;
};

// Hard votes for the last bin at or before whose start the gradient points; its axis, if bins are not signed
template <class T>
class Begun {
 public:
  static constexpr bool hard = true, inexact = false;

  Begun(const nablahog_tables& tables, Workspace& work)
      : tiny_(T(tables.tiny)),
        up_(T(tables.up)),
        count_(int(tables.directions_count)),
        before_(tables.bin_before),
        is_signed_(tables.is_signed),
        starts_(work.zeros<T>(3 * count_)) {
    for (int k = 0; k < 3 * count_; ++k) starts_[k] = T(tables.directions[k]);
  }

  [[gnu::always_inline]] Votes<T> operator()(Vec<T> u, Vec<T> v) const {
    using V = Vec<T>;
    using I = Vec<Int<T>>;
    const V m = magnitude<T>(u, v, tiny_);
    v = v * up_;
    const auto opposite = (v < T(0)) | ((v == T(0)) & (u < T(0)));
    u = opposite ? -u : u;  // turned into the first half turn
    v = opposite ? -v : v;
    I bin = splat<I>(before_);
    for (int k = 0; k < count_; ++k) {
      const V across = v * starts_[k] - u * starts_[count_ + k];
      auto begun = across >= T(0);
      if (is_signed_) {  // a start in the first half turn is behind all gradients in the second, and the reverse
        begun = opposite ? across <= T(0) : begun;
        begun = starts_[2 * count_ + k] > 0 ? begun | opposite : begun & opposite;
      }
      bin -= begun;
    }
    for (int k = 0; k < 2; ++k) bin = bin >= count_ ? bin - count_ : bin;
    return {m, V{}, bin};
  }

 private:
  const T tiny_, up_;
  const Int<T> count_, before_;
  const bool is_signed_;
  T* starts_;
};

}  // namespace nablahog
