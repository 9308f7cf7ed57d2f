// dlib's extract_fhog_features for Python's ctypes; how to build it: README.md.

#include <dlib/image_transforms/fhog.h>

#include <cstring>

// Features of a gray image to `out`, plane by plane; returns how many numbers these are.
extern "C" long fhog(const unsigned char* pixels, long rows, long cols, int cell, float* out) {
  dlib::array2d<unsigned char> image(rows, cols);
  for (long r = 0; r < rows; ++r) std::memcpy(&image[r][0], pixels + r * cols, cols);
  dlib::array<dlib::array2d<float>> planes;
  dlib::extract_fhog_features(image, planes, cell);
  long count = 0;
  for (unsigned long k = 0; k < planes.size(); ++k)
    for (long r = 0; r < planes[k].nr(); ++r)
      for (long c = 0; c < planes[k].nc(); ++c) out[count++] = planes[k][r][c];
  return count;
}
