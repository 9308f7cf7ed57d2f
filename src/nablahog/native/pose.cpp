// The loops of pose searches: products of vectors v with one Hermitian matrix M for each frequency of a Fourier
// transform.
#include <algorithm>
#include <complex>
#include <vector>

#include "interface.h"
#include "vec.h"

namespace nablahog {

using Complex = std::complex<float>;

// Numbers at 16 frequencies that are next to each other in memory, real and imaginary parts apart
struct Block {
  static constexpr int64_t frequencies = 16;
  static constexpr int vectors = frequencies / lanes<float>;
  Vec<float> re[vectors] = {}, im[vectors] = {};
};

// M, (⌈frequencies / 16⌉, channels, channels, 2, 16), the last block filled up with zeros
struct Matrices {
  const float* numbers;
  int64_t channels, frequencies;

  // Row a of the matrices from frequency f on, (channels, 2, 16)
  const float* row(int64_t a, int64_t f) const {
    return numbers + (f / Block::frequencies * channels + a) * channels * 2 * Block::frequencies;
  }
};

// The first `count` numbers of a block, or all, from interleaved ones; the others are 0.
inline Block load_complex(const Complex* from, int64_t count) {
  float few[2 * Block::frequencies] = {};
  if (count < Block::frequencies) std::memcpy(few, from, count * sizeof *from);
  const float* at = count < Block::frequencies ? few : reinterpret_cast<const float*>(from);
  Block block;
  [&]<size_t... K>(std::index_sequence<K...>) {
    NABLAHOG_UNROLL
    for (int k = 0; k < Block::vectors; ++k, at += 2 * lanes<float>) {
      const auto low = load<Vec<float>>(at), high = load<Vec<float>>(at + lanes<float>);
      block.re[k] = __builtin_shufflevector(low, high, int(2 * K)...);
      block.im[k] = __builtin_shufflevector(low, high, int(2 * K + 1)...);
    }
  }(std::make_index_sequence<lanes<float>>());
  return block;
}

inline void store_complex(Complex* to, const Block& block, int64_t count) {
  constexpr int n = lanes<float>;
  float numbers[2 * Block::frequencies];
  float* at = count >= Block::frequencies ? reinterpret_cast<float*>(to) : numbers;
  [&]<size_t... K>(std::index_sequence<K...>) {
    NABLAHOG_UNROLL
    for (int k = 0; k < Block::vectors; ++k) {
      store(at + 2 * k * n, __builtin_shufflevector(block.re[k], block.im[k], int(K / 2 + K % 2 * n)...));
      store(at + (2 * k + 1) * n, __builtin_shufflevector(block.re[k], block.im[k], int(K / 2 + K % 2 * n + n / 2)...));
    }
  }(std::make_index_sequence<n>());
  if (at == numbers) std::memcpy(to, numbers, count * sizeof *to);
}

// Calls body(v, b, f) for each of `count` vectors (channels, frequencies) and each block of frequencies from f on,
// with v (channels,) of these.
template <class Body>
void for_each_block(const Matrices& m, const Complex* vectors, int64_t count, Body body) {
  std::vector<Block> v(m.channels);
  for (int64_t f = 0; f < m.frequencies; f += Block::frequencies) {
    for (int64_t b = 0; b < count; ++b) {
      const Complex* vector = vectors + b * m.channels * m.frequencies + f;
      for (int64_t c = 0; c < m.channels; ++c) v[c] = load_complex(vector + c * m.frequencies, m.frequencies - f);
      body(v.data(), b, f);
    }
  }
}

// Σ over channels c < count of M_ac v_c
inline Block product(const float* row, const Block* v, int64_t count) {
  Block sum;
  for (int64_t c = 0; c < count; ++c, row += 2 * Block::frequencies) {
    NABLAHOG_UNROLL
    for (int k = 0; k < Block::vectors; ++k) {
      const auto re = load<Vec<float>>(row + k * lanes<float>);
      const auto im = load<Vec<float>>(row + k * lanes<float> + Block::frequencies);
      sum.re[k] = multiply_add(re, v[c].re[k], multiply_add(-im, v[c].im[k], sum.re[k]));
      sum.im[k] = multiply_add(re, v[c].im[k], multiply_add(im, v[c].re[k], sum.im[k]));
    }
  }
  return sum;
}

// M v of vectors (count, channels, frequencies), to `out` of their shape
inline void whiten(const Matrices& m, const Complex* vectors, int64_t count, Complex* out) {
  for_each_block(m, vectors, count, [&](const Block* v, int64_t b, int64_t f) {
    for (int64_t a = 0; a < m.channels; ++a) {
      Complex* to = out + (b * m.channels + a) * m.frequencies + f;
      store_complex(to, product(m.row(a, f), v, m.channels), m.frequencies - f);
    }
  });
}

// Σ over frequencies of shares · vᴴ M v, of vectors (count, channels, frequencies), to `energies` (count,).
// `shares` are filled up with zeros to whole blocks.
inline void energies(const Matrices& m, const Complex* vectors, int64_t count, const float* shares, float* energies) {
  std::vector<double> sums(count);
  for_each_block(m, vectors, count, [&](const Block* v, int64_t b, int64_t f) {
    Vec<float> energy[Block::vectors] = {};
    for (int64_t a = 0; a < m.channels; ++a) {
      const float* row = m.row(a, f);
      const Block half = product(row, v, a);  // the other half of the matrix gives as much
      NABLAHOG_UNROLL
      for (int k = 0; k < Block::vectors; ++k) {
        const auto diagonal = load<Vec<float>>(row + a * 2 * Block::frequencies + k * lanes<float>);
        energy[k] += v[a].re[k] * (2 * half.re[k] + diagonal * v[a].re[k]);
        energy[k] += v[a].im[k] * (2 * half.im[k] + diagonal * v[a].im[k]);
      }
    }
    for (int k = 0; k < Block::vectors; ++k)
      sums[b] += sum(energy[k] * load<Vec<float>>(shares + f + k * lanes<float>));
  });
  std::copy(sums.begin(), sums.end(), energies);
}

}  // namespace nablahog

using namespace nablahog;

NABLAHOG_API int nablahog_whiten(int64_t count, int64_t channels, int64_t frequencies, const float* matrices,
                                 const Complex* vectors, Complex* out) {
  return guarded([&] { whiten(Matrices{matrices, channels, frequencies}, vectors, count, out); });
}

NABLAHOG_API int nablahog_energies(int64_t count, int64_t channels, int64_t frequencies, const float* matrices,
                                   const Complex* vectors, const float* shares, float* out) {
  return guarded([&] { energies(Matrices{matrices, channels, frequencies}, vectors, count, shares, out); });
}
