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

inline int64_t cells_size(const nablahog_tables& tables) { return tables.rows.cells * tables.cols.cells * tables.bins; }
inline int64_t out_size(const nablahog_tables& tables) {
  return tables.out_rows * tables.out_cols * tables.out_channels;
}
inline int64_t image_size(const nablahog_tables& tables) { return tables.channels * tables.height * tables.width; }

template <class T>
void fill_nan(T* to, int64_t count) {
  for (int64_t k = 0; k < count; ++k) to[k] = std::numeric_limits<T>::quiet_NaN();
}

template <class T>
std::unique_ptr<Normalizer<T>> make_normalizer(const nablahog_tables& tables, Workspace& work) {
  if (!tables.normalizer) return nullptr;
  const std::string_view kind(tables.normalizer);
  if (kind == "global") return std::make_unique<GlobalNorm<T>>(tables, work);
  if (kind == "cell") return std::make_unique<CellNorm<T>>(tables, work);
  if (kind == "block") return std::make_unique<BlockNorm<T>>(tables, work);
  if (kind == "four-block") return std::make_unique<FourBlockNorm<T>>(tables, work);
  return nullptr;
}

}  // namespace nablahog
