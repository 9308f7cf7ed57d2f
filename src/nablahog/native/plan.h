// What the operator's loops know of a dialect, an image size and a dtype.  Plain C: Python fills it in, once for each
// (nablahog/hog/kernels/plan.py).  T below is the number type of the histograms: double for double pixels, else float.
#pragma once

#include <stdint.h>

enum nablahog_pixels { NABLAHOG_UINT8, NABLAHOG_FLOAT32, NABLAHOG_FLOAT64 };
// Values beyond the border: mirrored at the outermost pixels, these pixels again, or a constant.
enum nablahog_border { NABLAHOG_MIRROR, NABLAHOG_REPEAT, NABLAHOG_CONSTANT };
enum nablahog_votes { NABLAHOG_LINEAR, NABLAHOG_OPENCV, NABLAHOG_VLFEAT, NABLAHOG_NEAREST, NABLAHOG_BEGUN };
enum nablahog_normalizer { NABLAHOG_NO_NORM, NABLAHOG_GLOBAL, NABLAHOG_CELL, NABLAHOG_BLOCK, NABLAHOG_FOUR_BLOCK };
enum nablahog_block_form { NABLAHOG_L1, NABLAHOG_L1_SQRT, NABLAHOG_L2, NABLAHOG_L2_HYS };

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

struct nablahog_plan {
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
  const float* arctangent;   // opencv: (7,), see library_angles.py
  double arccosine_least, arccosine_unit;  // vlfeat: the least magnitude, radians from axis to axis

  struct nablahog_axis rows, cols;

  // Eq. 7: histograms to the descriptor
  int32_t normalizer;  // nablahog_normalizer
  int64_t out_rows, out_cols, out_channels;
  const void* constants;  // of the normaliser, see below
};

struct nablahog_global_norm {
  double epsilon;
  int32_t robust;
};

struct nablahog_cell_norm {
  double epsilon;
};

struct nablahog_block_norm {
  int64_t block[2], step[2];  // in cells: rows, columns
  double epsilon, epsilon_again, clip;
  int32_t form;  // nablahog_block_form
  int32_t epsilon_outside_root;
};

// Channels are parts; a part that is left out begins at -1.
struct nablahog_four_block_norm {
  double epsilon, clip;
  double texture;            // factor of texture channels
  int64_t texture_order[4];  // the texture channel of the block up-left, up-right, down-left, down-right
  int64_t directed_at, undirected_at, texture_at, blocks_at, zero_at;
  int32_t floor;    // √energy is at least ε; else ε is added to the energy
  int32_t missing;  // blocks that reach beyond the grid add nothing
  int32_t dropped;  // outermost rings of cells that are not described
  int32_t is_signed;
  int32_t directed_texture;  // texture sums directed histograms
};
