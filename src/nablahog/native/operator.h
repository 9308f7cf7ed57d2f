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
using NormalizerMaker = std::unique_ptr<Normalizer<T>> (*)(const nablahog_tables&, Workspace&);

template <class T, class Norm>
std::unique_ptr<Normalizer<T>> make(const nablahog_tables& tables, Workspace& work) {
  return std::make_unique<Norm>(tables, work);
}

// What makes the normaliser of a kind; null if there is no such loop.
template <class T>
NormalizerMaker<T> normalizer_maker(std::string_view kind) {
  if (kind == "global") return make<T, GlobalNorm<T>>;
  if (kind == "cell") return make<T, CellNorm<T>>;
  if (kind == "block") return make<T, BlockNorm<T>>;
  if (kind == "four-block") return make<T, FourBlockNorm<T>>;
  return nullptr;
}

template <class T>
std::unique_ptr<Normalizer<T>> make_normalizer(const nablahog_tables& tables, Workspace& work) {
  return tables.normalizer ? normalizer_maker<T>(tables.normalizer)(tables, work) : nullptr;
}

}  // namespace nablahog
