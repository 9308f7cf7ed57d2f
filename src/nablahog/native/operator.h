// What the passes over images share: sizes, and the normaliser, which runs alone, too.
#pragma once

#include <limits>
#include <string_view>

#include "block_norm.h"
#include "four_block_norm.h"
#include "per_cell_norm.h"

namespace nablahog {

// first … last - 1
struct Range {
  int64_t first, last;
};

inline int64_t cells_size(const nablahog_plan& plan) { return plan.rows.cells * plan.cols.cells * plan.bins; }
inline int64_t out_size(const nablahog_plan& plan) { return plan.out_rows * plan.out_cols * plan.out_channels; }
inline int64_t image_size(const nablahog_plan& plan) { return plan.channels * plan.height * plan.width; }

template <class T>
void fill_nan(T* to, int64_t count) {
  for (int64_t k = 0; k < count; ++k) to[k] = std::numeric_limits<T>::quiet_NaN();
}

template <class T>
std::unique_ptr<Normalizer<T>> make_normalizer(const nablahog_plan& plan, Workspace& work) {
  if (!plan.normalizer) return nullptr;
  const std::string_view kind(plan.normalizer);
  if (kind == "global") return std::make_unique<GlobalNorm<T>>(plan, work);
  if (kind == "cell") return std::make_unique<CellNorm<T>>(plan, work);
  if (kind == "block") return std::make_unique<BlockNorm<T>>(plan, work);
  if (kind == "four-block") return std::make_unique<FourBlockNorm<T>>(plan, work);
  return nullptr;
}

}  // namespace nablahog
