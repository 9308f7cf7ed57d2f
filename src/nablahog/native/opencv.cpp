// The interface of the loops of compat/opencv.  Shapes are in the headers.
#include "interface.h"
#include "opencv_pyramid.h"
#include "opencv_windows.h"

using namespace nablahog;

// To arrays (padded_height, padded_width)
NABLAHOG_API int nablahog_opencv_votes(const opencv::PaddedImage* image, const opencv::Scheme* scheme, float* near,
                                       float* far, int32_t* bin) {
  return guarded([&] { opencv::votes(*image, *scheme, near, far, bin); });
}

// Of windows at corners (count, 2), x and y
NABLAHOG_API int nablahog_opencv_descriptors(const opencv::PaddedImage* image, const opencv::Scheme* scheme,
                                             const float* by_col, const float* by_row, const opencv::Corner* corners,
                                             int64_t count, float* out) {
  return guarded([&] { opencv::descriptors(*image, *scheme, {by_col, by_row}, corners, count, out); });
}

NABLAHOG_API int nablahog_opencv_scores(const opencv::PaddedImage* image, const opencv::Scheme* scheme,
                                        const float* by_col, const float* by_row, const opencv::Corner* corners,
                                        int64_t count, const float* coefficients, float* out) {
  return guarded([&] { opencv::scores(*image, *scheme, {by_col, by_row}, corners, count, coefficients, out); });
}

// An image (…, width, channels) of 1 or 3 channels to out (rows, cols, channels)
NABLAHOG_API int nablahog_opencv_resize(const uint8_t* image, int64_t width, int64_t channels, int64_t rows,
                                        const int32_t* row_low, const int32_t* row_weight, int64_t cols,
                                        const int32_t* col_low, const int32_t* col_weight, uint8_t* out) {
  return guarded([&] {
    const auto resize = channels == 3 ? opencv::resize<3> : opencv::resize<1>;
    resize(image, width * channels, {rows, row_low, row_weight}, {cols, col_low, col_weight}, out);
  });
}
