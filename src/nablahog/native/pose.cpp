// The interface of the loops of pose searches.  Shapes are in the headers.
#include "interface.h"
#include "whitening.h"

using namespace nablahog;

NABLAHOG_API int nablahog_whiten(int64_t count, int64_t channels, int64_t frequencies, const float* matrices,
                                 const Complex* vectors, Complex* out) {
  return guarded([&] { whiten(Matrices{matrices, channels, frequencies}, vectors, count, out); });
}

NABLAHOG_API int nablahog_energies(int64_t count, int64_t channels, int64_t frequencies, const float* matrices,
                                   const Complex* vectors, const float* shares, float* out) {
  return guarded([&] { energies(Matrices{matrices, channels, frequencies}, vectors, count, shares, out); });
}
