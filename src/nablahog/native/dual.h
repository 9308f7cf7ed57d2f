// Dual numbers x + ẋ·δ, δ² = 0: a pass instantiated with them is its own jvp.  Derivatives at kinks are those of
// docs/derivatives.md: of a root at 0 it is 0, of a clip at the clip the mean of both sides.
#pragma once

#include "vec.h"

namespace nablahog {

// N is a number or a vector.
template <class N>
struct Dual {
  N value, tangent;

  friend Dual operator+(Dual a, Dual b) { return {a.value + b.value, a.tangent + b.tangent}; }
  friend Dual operator-(Dual a, Dual b) { return {a.value - b.value, a.tangent - b.tangent}; }
  friend Dual operator*(Dual a, Dual b) { return {a.value * b.value, a.value * b.tangent + a.tangent * b.value}; }
  Dual& operator+=(Dual other) { return *this = *this + other; }
};

template <class N>
constexpr bool is_dual = false;
template <class N>
constexpr bool is_dual<Dual<N>> = true;

// Where values and their tangents are
template <class T>
struct DualPointer {
  T *value, *tangent;

  friend DualPointer operator+(DualPointer p, int64_t k) { return {p.value + k, p.tangent + k}; }
  operator DualPointer<const T>() const { return {value, tangent}; }
};

// The numbers that a pointer T* or DualPointer<T> leads to, and vectors of them
template <class P>
struct Pointee;
template <class T>
struct Pointee<T*> {
  using Number = std::remove_const_t<T>;
  using Scalar = Number;
  using Vector = Vec<Scalar>;
};
template <class T>
struct Pointee<DualPointer<T>> {
  using Number = std::remove_const_t<T>;
  using Scalar = Dual<Number>;
  using Vector = Dual<Vec<Number>>;
};

template <class T>
[[gnu::always_inline]] inline T get(const T* from, int64_t k) {
  return from[k];
}
template <class T>
[[gnu::always_inline]] inline Dual<std::remove_const_t<T>> get(DualPointer<T> from, int64_t k) {
  return {from.value[k], from.tangent[k]};
}
template <class T>
[[gnu::always_inline]] inline void put(T* to, int64_t k, T x) {
  to[k] = x;
}
template <class T>
[[gnu::always_inline]] inline void put(DualPointer<T> to, int64_t k, Dual<T> x) {
  to.value[k] = x.value;
  to.tangent[k] = x.tangent;
}

// Without tangents
template <class T>
T* values_of(T* numbers) {
  return numbers;
}
template <class T>
T* values_of(DualPointer<T> numbers) {
  return numbers.value;
}

template <class T>
[[gnu::always_inline]] inline Vec<T> load_vector(const T* from) {
  return load<Vec<T>>(from);
}
template <class T>
[[gnu::always_inline]] inline auto load_vector(DualPointer<T> from) {
  using V = Vec<std::remove_const_t<T>>;
  return Dual<V>{load<V>(from.value), load<V>(from.tangent)};
}
template <class T>
[[gnu::always_inline]] inline void store_vector(T* to, Vec<T> x) {
  store(to, x);
}
template <class T>
[[gnu::always_inline]] inline void store_vector(DualPointer<T> to, Dual<Vec<T>> x) {
  store(to.value, x.value);
  store(to.tangent, x.tangent);
}

// The first `count` numbers, if that is less than a vector, and zeros; nothing beyond them is read.
template <class T>
[[gnu::always_inline]] inline Vec<T> load_first(const T* from, int64_t count) {
  if (count >= lanes<T>) return load<Vec<T>>(from);
#if defined(__AVX512F__)
  if constexpr (sizeof(T) == 4) return (Vec<T>)_mm512_maskz_loadu_ps(__mmask16((1u << count) - 1), from);
  if constexpr (sizeof(T) == 8) return (Vec<T>)_mm512_maskz_loadu_pd(__mmask8((1u << count) - 1), from);
#elif defined(__AVX2__)
  const auto mask = first_lanes<Vec<T>>(count);
  if constexpr (sizeof(T) == 4) return (Vec<T>)_mm256_maskload_ps(from, (__m256i)mask);
  if constexpr (sizeof(T) == 8) return (Vec<T>)_mm256_maskload_pd(from, (__m256i)mask);
#endif
  T numbers[lanes<T>] = {};
  for (int64_t k = 0; k < count; ++k) numbers[k] = from[k];
  return load<Vec<T>>(numbers);
}
template <class T>
[[gnu::always_inline]] inline auto load_first(DualPointer<T> from, int64_t count) {
  using N = std::remove_const_t<T>;
  return Dual<Vec<N>>{load_first<N>(from.value, count), load_first<N>(from.tangent, count)};
}

// Stores the first `count` numbers of a vector, all if `count` is larger; nothing beyond them is written.
template <class T>
[[gnu::always_inline]] inline void store_first(T* to, Vec<T> x, int64_t count) {
  if (count >= lanes<T>) return store(to, x);
#if defined(__AVX512F__)
  if constexpr (sizeof(T) == 4) return _mm512_mask_storeu_ps(to, __mmask16((1u << count) - 1), (__m512)x);
  if constexpr (sizeof(T) == 8) return _mm512_mask_storeu_pd(to, __mmask8((1u << count) - 1), (__m512d)x);
#elif defined(__AVX2__)
  const auto mask = first_lanes<Vec<T>>(count);
  if constexpr (sizeof(T) == 4) return _mm256_maskstore_ps(to, (__m256i)mask, (__m256)x);
  if constexpr (sizeof(T) == 8) return _mm256_maskstore_pd(to, (__m256i)mask, (__m256d)x);
#endif
  for (int64_t k = 0; k < count; ++k) to[k] = x[k];
}

template <class N>
[[gnu::always_inline]] inline N value_of(N x) {
  return x;
}
template <class N>
[[gnu::always_inline]] inline N value_of(Dual<N> x) {
  return x.value;
}

// A constant
template <class N, class T>
[[gnu::always_inline]] inline N constant(T x) {
  if constexpr (is_dual<N>) {
    return N{x, 0};
  } else {
    return N(x);
  }
}

// A number in all lanes
[[gnu::always_inline]] inline Vec<float> spread(float x) { return splat<Vec<float>>(x); }
[[gnu::always_inline]] inline Vec<double> spread(double x) { return splat<Vec<double>>(x); }
template <class T>
[[gnu::always_inline]] inline Dual<Vec<T>> spread(Dual<T> x) {
  return {spread(x.value), spread(x.tangent)};
}

// x times a number or vector without a tangent
template <class N, class S>
[[gnu::always_inline]] inline N times(N x, S factor) {
  return x * factor;
}
template <class N, class S>
[[gnu::always_inline]] inline Dual<N> times(Dual<N> x, S factor) {
  return {x.value * factor, x.tangent * factor};
}

// For numbers and vectors
template <class N>
[[gnu::always_inline]] inline N root(N x) {
  if constexpr (std::is_arithmetic_v<N>) {
    return std::sqrt(x);
  } else {
    return sqrt(x);
  }
}
template <class N>
[[gnu::always_inline]] inline Dual<N> root(Dual<N> x) {
  const N value = root(x.value);
  return {value, value > N{} ? x.tangent / (value + value) : N{}};
}

template <class T>
inline T reciprocal(T x) {
  return 1 / x;
}
template <class T>
inline Dual<T> reciprocal(Dual<T> x) {
  const T value = 1 / x.value;
  return {value, -(value * value) * x.tangent};
}

// The larger of x and a number, whose tangent is 0
template <class T>
inline T at_least(T x, T least) {
  return x < least ? least : x;
}
template <class T>
inline Dual<T> at_least(Dual<T> x, T least) {
  const T share = x.value > least ? T(1) : x.value == least ? T(0.5) : T(0);
  return {x.value < least ? least : x.value, share > 0 ? share * x.tangent : T(0)};
}

// Lanes of one vector or another
template <class M, class V>
[[gnu::always_inline]] inline V select(M mask, V a, V b) {
  return mask ? a : b;
}
template <class M, class V>
[[gnu::always_inline]] inline Dual<V> select(M mask, Dual<V> a, Dual<V> b) {
  return {mask ? a.value : b.value, mask ? a.tangent : b.tangent};
}

// Entries of at most `clip`
template <class V, class T>
[[gnu::always_inline]] inline V clipped(V entries, T clip) {
  return entries > splat<V>(clip) ? splat<V>(clip) : entries;  // NaN stays NaN
}
// The gradient with respect to entries before the clip; also the tangent behind it
template <class V, class T>
[[gnu::always_inline]] inline V through_clip(V entries, T clip, V grad) {
  return entries > splat<V>(clip) ? V{} : entries == splat<V>(clip) ? grad * T(0.5) : grad;
}
template <class V, class T>
[[gnu::always_inline]] inline Dual<V> clipped(Dual<V> entries, T clip) {
  return {clipped(entries.value, clip), through_clip(entries.value, clip, entries.tangent)};
}

template <class V>
[[gnu::always_inline]] inline Dual<Element<V>> sum(Dual<V> x) {
  return {sum(x.value), sum(x.tangent)};
}

// x · y + total
template <class V>
[[gnu::always_inline]] inline Dual<V> multiply_add(Dual<V> x, Dual<V> y, Dual<V> total) {
  return {multiply_add(x.value, y.value, total.value),
          multiply_add(x.value, y.tangent, multiply_add(x.tangent, y.value, total.tangent))};
}

}  // namespace nablahog
