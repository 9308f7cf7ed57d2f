// Loops at the limit of a processor, for limits.py, which compiles them: -O3 -march=native -ffast-math.

#include <cmath>

typedef float Vector __attribute__((vector_size(64), aligned(4), may_alias));
constexpr long lanes = 16;

// Multiply-adds: 32 of each of 4 · count numbers
extern "C" void fused(float* numbers, long count, long times) {
  float *first = numbers, *second = first + count, *third = second + count, *fourth = third + count;
  for (long turn = 0; turn < times; ++turn) {
    for (long i = 0; i < count; i += lanes) {
      Vector &p = (Vector&)first[i], &q = (Vector&)second[i], &r = (Vector&)third[i], &s = (Vector&)fourth[i];
      Vector a = p, b = q, c = r, d = s;
#pragma GCC unroll 32
      for (int k = 0; k < 32; ++k) {
        a = a * 0.5f + 0.5f;
        b = b * 0.5f + 0.5f;
        c = c * 0.5f + 0.5f;
        d = d * 0.5f + 0.5f;
      }
      p = a, q = b, r = c, s = d;
    }
  }
}

// Of `count` numbers, to the `count` after them
extern "C" void divisions(float* numbers, long count, long times) {
  for (long turn = 0; turn < times; ++turn)
    for (long i = 0; i < count; ++i) numbers[count + i] = 0.5f / numbers[i];
}

extern "C" void roots(float* numbers, long count, long times) {
  for (long turn = 0; turn < times; ++turn)
    for (long i = 0; i < count; ++i) numbers[count + i] = std::sqrt(numbers[i]);
}
