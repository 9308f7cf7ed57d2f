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

// Of an image of 8 rows: the magnitudes of its gradients, and their angles, in half turns, to the planes after it
extern "C" void angles(float* numbers, long columns, long times) {
  for (long turn = 0; turn < times; ++turn) {
    for (long row = 1; row < 7; ++row) {
      const float *here = numbers + row * columns, *above = here - columns, *below = here + columns;
      float* __restrict magnitudes = numbers + (8 + row) * columns, * __restrict angles = magnitudes + 8 * columns;
      for (long i = 1; i < columns - 1; ++i) {
        const float across = here[i + 1] - here[i - 1], down = below[i] - above[i];
        magnitudes[i] = std::sqrt(across * across + down * down);
        const float x = std::fabs(across), y = std::fabs(down);
        const float large = x > y ? x : y, small = x > y ? y : x;
        const float t = small / (large + 1e-30f), s = t * t;
        float angle = 0.002168260411f;
        angle = angle * s - 0.01069655349f;
        angle = angle * s + 0.02534499976f;
        angle = angle * s - 0.04212303499f;
        angle = angle * s + 0.06305023492f;
        angle = angle * s - 0.1060524763f;
        angle = (angle * s + 0.3183086485f) * t;
        angle = y > x ? 0.5f - angle : angle;
        angles[i] = across * down < 0 ? -angle : angle;
      }
    }
  }
}
