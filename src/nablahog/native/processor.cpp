// Which of the libraries this processor can run.
#include "interface.h"
#include "vec.h"

#if defined(__x86_64__)
#include <cpuid.h>

namespace {

constexpr unsigned bit(int k) { return 1u << k; }

// Register 0…3 (eax…edx) of a leaf of cpuid, 0 where the processor does not have the leaf.
unsigned cpuid(unsigned leaf, int which) {
  unsigned registers[4] = {};
  return __get_cpuid_count(leaf, 0, &registers[0], &registers[1], &registers[2], &registers[3]) ? registers[which] : 0u;
}

bool has(unsigned flags, unsigned wanted) { return (flags & wanted) == wanted; }

// The psABI's level: the processor has its instructions, and the system saves their registers.  Not by
// __builtin_cpu_supports, which under some compilers' libraries always says no.
int level() {
  constexpr unsigned fma = bit(12), movbe = bit(22), xsave = bit(27), avx = bit(28), f16c = bit(29);
  constexpr unsigned bmi1 = bit(3), avx2 = bit(5), bmi2 = bit(8), lzcnt = bit(5);
  constexpr unsigned avx512 = bit(16) | bit(17) | bit(28) | bit(30) | bit(31);  // F, DQ, CD, BW, VL
  constexpr unsigned vector_256 = 0x6, vector_512 = 0xe6;                       // registers that the system saves
  const unsigned features = cpuid(7, 1);
  if (!has(cpuid(1, 2), fma | movbe | xsave | avx | f16c) || !has(features, bmi1 | avx2 | bmi2) ||
      !has(cpuid(0x80000001, 2), lzcnt))
    return 2;
  unsigned saved, high;
  __asm__("xgetbv" : "=a"(saved), "=d"(high) : "c"(0));
  if (!has(saved, vector_256)) return 2;
  return has(features, avx512) && has(saved, vector_512) ? 4 : 3;
}

}  // namespace

// The x86-64 level of this processor, 2 to 4; 0 for another kind of processor.
NABLAHOG_API int nablahog_level() { return level(); }

#else

NABLAHOG_API int nablahog_level() { return 0; }

#endif

// Bytes of this library's vectors
NABLAHOG_API int nablahog_vector_bytes() { return nablahog::vector_bytes; }
