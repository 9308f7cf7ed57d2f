// Vectors of the widest registers that this library is compiled for: GCC's and Clang's vector extensions, which have
// the operators of numbers (a comparison gives a mask, `mask ? a : b` selects lanes), and the functions that these
// lack.
#pragma once

#include <cmath>
#include <cstdint>
#include <cstring>
#include <type_traits>
#include <utility>
#if defined(__x86_64__)
#include <immintrin.h>
#elif defined(__aarch64__)
#include <arm_neon.h>
#endif

// Before a loop whose trip count is a small constant: arrays of vectors indexed by it stay in registers.
#ifdef __clang__
#define NABLAHOG_UNROLL _Pragma("clang loop unroll(full)")
#else
#define NABLAHOG_UNROLL _Pragma("GCC unroll 16")
#endif

namespace nablahog {

#if defined(__AVX512F__)
constexpr int vector_bytes = 64;
#elif defined(__AVX2__)
constexpr int vector_bytes = 32;
#else
constexpr int vector_bytes = 16;
#endif

// Numbers of a vector
template <class T>
constexpr int lanes = vector_bytes / sizeof(T);

template <class T, int N>
struct VectorOf {
  typedef T type __attribute__((vector_size(N * sizeof(T))));
};
template <class T, int N = lanes<T>>
using Vec = typename VectorOf<T, N>::type;

// Integers as wide as T: of masks and indices
template <class T>
using Int = std::conditional_t<sizeof(T) == 4, int32_t, int64_t>;

template <class V>
using Element = std::remove_cvref_t<decltype(std::declval<V>()[0])>;
template <class V>
constexpr int size = sizeof(V) / sizeof(Element<V>);
template <class V>
using Mask = Vec<Int<Element<V>>, size<V>>;

constexpr int64_t round_up(int64_t count, int64_t step) { return (count + step - 1) / step * step; }

template <class V>
[[gnu::always_inline]] inline V load(const Element<V>* from) {
  V v;
  std::memcpy(&v, from, sizeof v);
  return v;
}

template <class V>
[[gnu::always_inline]] inline void store(Element<V>* to, V v) {
  std::memcpy(to, &v, sizeof v);
}

template <class V>
[[gnu::always_inline]] inline V splat(Element<V> x) {
  return x - V{};  // x + V{} would turn -0 to 0
}

// The numbers 0, 1, 2, …
template <class V>
[[gnu::always_inline]] inline V iota() {
  return
      []<size_t... K>(std::index_sequence<K...>) { return V{Element<V>(K)...}; }(std::make_index_sequence<size<V>>());
}

// Lanes before the count-th
template <class V>
[[gnu::always_inline]] inline Mask<V> first_lanes(int64_t count) {
  return iota<Mask<V>>() < splat<Mask<V>>(Int<Element<V>>(count));
}

// √x and ⌊x⌋: compilers make one instruction of either loop, without traps and errno.
template <class V>
[[gnu::always_inline]] inline V sqrt(V x) {
  for (int k = 0; k < size<V>; ++k) x[k] = std::sqrt(x[k]);
  return x;
}
template <class V>
[[gnu::always_inline]] inline V floor(V x) {
  for (int k = 0; k < size<V>; ++k) x[k] = std::floor(x[k]);
  return x;
}

// a · b + c, rounded once where the processor can: always alike on one machine
template <class V>
[[gnu::always_inline]] inline V multiply_add(V a, V b, V c) {
#if defined(__AVX2__)
  if constexpr (std::is_same_v<V, Vec<float, 4>>) return (V)_mm_fmadd_ps((__m128)a, (__m128)b, (__m128)c);
  if constexpr (std::is_same_v<V, Vec<double, 2>>) return (V)_mm_fmadd_pd((__m128d)a, (__m128d)b, (__m128d)c);
  if constexpr (std::is_same_v<V, Vec<float, 8>>) return (V)_mm256_fmadd_ps((__m256)a, (__m256)b, (__m256)c);
  if constexpr (std::is_same_v<V, Vec<double, 4>>) return (V)_mm256_fmadd_pd((__m256d)a, (__m256d)b, (__m256d)c);
#endif
#if defined(__AVX512F__)
  if constexpr (std::is_same_v<V, Vec<float, 16>>) return (V)_mm512_fmadd_ps((__m512)a, (__m512)b, (__m512)c);
  if constexpr (std::is_same_v<V, Vec<double, 8>>) return (V)_mm512_fmadd_pd((__m512d)a, (__m512d)b, (__m512d)c);
#endif
#if defined(__aarch64__)
  if constexpr (std::is_same_v<V, Vec<float, 4>>) return (V)vfmaq_f32((float32x4_t)c, (float32x4_t)a, (float32x4_t)b);
  if constexpr (std::is_same_v<V, Vec<double, 2>>) return (V)vfmaq_f64((float64x2_t)c, (float64x2_t)a, (float64x2_t)b);
#endif
  return a * b + c;
}

template <class V>
[[gnu::always_inline]] inline V abs(V x) {
  return (V)((Mask<V>)x & ~(Mask<V>)splat<V>(Element<V>(-0.0)));
}

// |x| with the sign of another number
template <class V>
[[gnu::always_inline]] inline V copysign(V x, V sign) {
  const Mask<V> bit = (Mask<V>)splat<V>(Element<V>(-0.0));
  return (V)(((Mask<V>)x & ~bit) | ((Mask<V>)sign & bit));
}

template <class V>
[[gnu::always_inline]] inline V minimum(V a, V b) {
  return a < b ? a : b;
}

template <class V>
[[gnu::always_inline]] inline V maximum(V a, V b) {
  return a > b ? a : b;
}

// Rounded towards zero
template <class V>
[[gnu::always_inline]] inline Mask<V> to_int(V x) {
  return __builtin_convertvector(x, Mask<V>);
}

// Σ_k c_k x^k of `count` coefficients c
template <int COUNT, class V>
[[gnu::always_inline]] inline V polynomial(V x, const Element<V> (&coefficients)[COUNT]) {
  V value = splat<V>(coefficients[COUNT - 1]);
  NABLAHOG_UNROLL
  for (int k = COUNT - 2; k >= 0; --k) value = multiply_add(value, x, splat<V>(coefficients[k]));
  return value;
}

// The sum of a vector's numbers, by halves
template <class V>
[[gnu::always_inline]] inline Element<V> sum(V v) {
  if constexpr (size<V> == 2) {
    return v[0] + v[1];
  } else {
    Vec<Element<V>, size<V> / 2> half[2];
    std::memcpy(&half, &v, sizeof v);
    return sum(half[0] + half[1]);
  }
}

// One vector of several shorter ones
template <class V, class Part>
[[gnu::always_inline]] inline V join(const Part (&parts)[size<V> / size<Part>]) {
  if constexpr (size<V> == size<Part>) {
    return parts[0];
  } else if constexpr (size<V> == 2 * size<Part>) {
    return [&]<size_t... K>(std::index_sequence<K...>) {
      return (V)__builtin_shufflevector(parts[0], parts[1], int(K)...);
    }(std::make_index_sequence<size<V>>());
  } else {
    V v;
    std::memcpy(&v, parts, sizeof v);
    return v;
  }
}

// The numbers of a table of a few vectors at each lane's index; where a processor can: see `most_tables`.
template <class V, int VECTORS>
[[gnu::always_inline]] inline V permute(const V (&table)[VECTORS], [[maybe_unused]] Mask<V> index) {
#if defined(__AVX512F__)
  static_assert(VECTORS <= 2);
  if constexpr (sizeof(Element<V>) == 4 && VECTORS == 1) {
    return (V)_mm512_permutexvar_ps((__m512i)index, (__m512)table[0]);
  } else if constexpr (sizeof(Element<V>) == 4) {
    return (V)_mm512_permutex2var_ps((__m512)table[0], (__m512i)index, (__m512)table[1]);
  } else if constexpr (VECTORS == 1) {
    return (V)_mm512_permutexvar_pd((__m512i)index, (__m512d)table[0]);
  } else {
    return (V)_mm512_permutex2var_pd((__m512d)table[0], (__m512i)index, (__m512d)table[1]);
  }
#elif defined(__AVX2__)
  V out = (V)_mm256_permutevar8x32_ps((__m256)table[0], (__m256i)index);
  for (int k = 1; k < VECTORS; ++k) {
    const V here = (V)_mm256_permutevar8x32_ps((__m256)table[k], (__m256i)index);
    out = index > 8 * k - 1 ? here : out;
  }
  return out;
#else
  return table[0];
#endif
}

// Whether there is `permute` for tables of so many numbers
template <class T>
constexpr int most_tables = 0;
#if defined(__AVX512F__)
template <>
inline constexpr int most_tables<float> = 2;
template <>
inline constexpr int most_tables<double> = 2;
#elif defined(__AVX2__)
template <>
inline constexpr int most_tables<float> = 3;
#endif

// Of two vectors as rows of blocks of STEP numbers: the upper or lower row after every second pair of blocks is
// transposed
template <int STEP, bool UPPER, class V, size_t... K>
[[gnu::always_inline]] inline V swap_blocks(V a, V b, std::index_sequence<K...>) {
  constexpr int n = size<V>;
  if constexpr (UPPER) {
    return __builtin_shufflevector(a, b, (K & STEP ? n + int(K) - STEP : int(K))...);
  } else {
    return __builtin_shufflevector(a, b, (K & STEP ? n + int(K) : int(K) + STEP)...);
  }
}

// Transposes a square matrix of vectors: blocks of 1, 2, 4, … beside the diagonal change places
template <int STEP = 1, class V>
[[gnu::always_inline]] inline void transpose(V (&rows)[size<V>]) {
  if constexpr (STEP < size<V>) {
    using K = std::make_index_sequence<size<V>>;
    NABLAHOG_UNROLL
    for (int k = 0; k < size<V>; ++k) {
      if (!(k & STEP)) {
        const V a = rows[k], b = rows[k + STEP];
        rows[k] = swap_blocks<STEP, true>(a, b, K());
        rows[k + STEP] = swap_blocks<STEP, false>(a, b, K());
      }
    }
    transpose<STEP * 2>(rows);
  }
}

}  // namespace nablahog
