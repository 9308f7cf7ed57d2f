// Derivatives of votes by the gradient (u, v): along it by the magnitude, across it by the angle.
#pragma once

#include "vec.h"

namespace nablahog {

// Gradients with respect to a vector of pixels' votes for the bin before their own, their own and the next
template <class V>
struct VoteGradients {
  V before, here, after;
};

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

// The jvp: tangents of a pixel's votes for its own bin, the next, and the one before
template <class V>
struct VoteTangents {
  V here, after, before;
};

// By the tangent of the magnitude; of hard votes f is 0.
template <class V>
[[gnu::always_inline]] inline VoteTangents<V> along_jvp(V m, V f, V u, V v, V du, V dv) {
  using T = Element<V>;
  const V longer = m > T(0) ? (u * du + v * dv) / m : V{}, far = longer * f;
  return {longer - far, far, V{}};
}

// By that of the angle
template <class V>
[[gnu::always_inline]] inline VoteTangents<V> across_jvp(V m, V f, V u, V v, V du, V dv, V slope) {
  using T = Element<V>;
  const V turned = m > T(0) ? slope * (u * dv - v * du) / m : V{}, half = turned * T(0.5);
  const auto centre = f == T(0);
  return {centre ? V{} : -turned, centre ? half : turned, centre ? -half : V{}};
}

}  // namespace nablahog
