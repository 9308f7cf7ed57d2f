// What the operator's loops know of a dialect, an image size and a dtype.  Plain C: Python fills it in, once for each
// (nablahog/hog/kernels/tables.py).  T below is the number type of the histograms: double for double pixels, else
// float.
#pragma once

#include <stdint.h>

enum nablahog_pixels { NABLAHOG_UINT8, NABLAHOG_FLOAT32, NABLAHOG_FLOAT64 };
// Values beyond the border: mirrored at the outermost pixels, these pixels again, or a constant.
enum nablahog_border { NABLAHOG_MIRROR, NABLAHOG_REPEAT, NABLAHOG_CONSTANT };
enum nablahog_votes { NABLAHOG_LINEAR, NABLAHOG_OPENCV, NABLAHOG_VLFEAT, NABLAHOG_NEAREST, NABLAHOG_BEGUN };

// Eq. 5-6 along one axis.  A stretch is neighbouring pixels that vote into the same `extent` neighbouring cells.
struct nablahog_axis {
  int64_t pixels, cells;
  int64_t extent;            // 1 or even
  int64_t stretches;         // how many
  int64_t longest;           // pixels of the longest stretch
  int64_t run;               // the same, rounded up to whole eights
  const int64_t* stretch;    // (stretches, 3): first pixel, the one after the last, first cell
  const void* weights;       // T (pixels, extent)
  const void* run_weights;   // T (stretches, extent, run), zeros behind a stretch; columns only
  const void* cell_weights;  // T (extent, pixels rounded up to 16, and 16 more); columns only
};

struct nablahog_tables {
  int64_t channels, height, width;
  int32_t pixels;  // nablahog_pixels

  // Eq. 1-2: stored values to gradients
  int32_t averaged;        // channels are averaged, not compared by magnitude
  int32_t square_root;     // of all values first, 0 up to `black`
  int32_t sobel;           // differences are smoothed by [1, 2, 1] along the other axis
  int32_t border;          // nablahog_border
  int32_t border_doubled;  // differences across the border count twice
  double scale, black, border_value;
  const double* channel_weights;  // (channels,)
  const void* last_wins;  // integers as wide as T, (width rounded up to 16, and 16 more): -1 where of channels of
                          // equal magnitude the last counts, 0 where the first does

  // Eq. 2-4: gradients to votes
  int32_t votes;  // nablahog_votes
  int32_t bins;
  int32_t is_signed;
  int32_t bin_before;  // begun: the bin before the first start
  double tiny;         // squared magnitudes below vote zero
  double up;           // -1 if bins go counterclockwise
  double bins_per_half_turn, bin_offset;
  double slope;              // bins per radian
  int64_t directions_count;  // axes, or bins
  const double* directions;  // nearest, vlfeat: (2, axes), cosines and sines.  begun: (3, bins), of where bins begin,
                             // and whether in the first half turn
  const float* arctangent;   // opencv: (7,), see orientation.py
  double arccosine_least, arccosine_unit;  // vlfeat: the least magnitude, radians from axis to axis

  struct nablahog_axis rows, cols;

  // Eq. 7: histograms to the descriptor
  const char* normalizer;  // its kind, or null
  int64_t out_rows, out_cols, out_channels;
  const double* constants;  // of the normaliser, in the order of its header
};
