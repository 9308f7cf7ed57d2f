// The interface of the loops of pre-images.  Shapes are in the headers.
#include "flat_regions.h"
#include "interface.h"
#include "smoothness.h"

using namespace nablahog;

// Images (count, height, width) to `out` (count,) and, of the images' shape, derivatives.
NABLAHOG_API int nablahog_smoothness(bool double_precision, int64_t count, int64_t height, int64_t width,
                                     double rounding, double tiny, const void* images, void* out, void* grads) {
  return guarded([&] {
    with_real(double_precision, [&]<class T>() {
      Smoothness<T> smoothness(height, width, T(tiny));
      for (int64_t k = 0; k < count; ++k) {
        const int64_t at = k * height * width;
        static_cast<T*>(out)[k] =
            T(smoothness(static_cast<const T*>(images) + at, rounding, static_cast<T*>(grads) + at));
      }
    });
  });
}

// Levels images (count, pixels), of which image k has the runs ends[index[k]] … ends[index[k] + 1] - 1.
NABLAHOG_API int nablahog_level_regions(bool double_precision, int64_t count, int64_t pixels, const int64_t* index,
                                        const int64_t* runs, const int64_t* ends, int64_t regions, const double* sizes,
                                        void* images) {
  return guarded([&] {
    with_real(double_precision, [&]<class T>() {
      std::vector<double> sums(regions);  // a region is in one image only
      for (int64_t k = 0; k < count; ++k) {
        const int64_t first = ends[index[k]], last = ends[index[k] + 1];
        level(static_cast<T*>(images) + k * pixels, reinterpret_cast<const Run*>(runs) + first, last - first, sizes,
              sums.data());
      }
    });
  });
}
