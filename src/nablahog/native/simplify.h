// Mesh simplification: edges are collapsed one after the other.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <utility>
#include <vector>

namespace nablahog::rendering {

// Merges the two vertices of each edge, unless a vertex would move farther than `tolerance`.  Sets `merged`
// (vertex_count,) to the vertex that each is merged with.
inline void collapse(const std::array<double, 3>* places, int64_t vertex_count, const std::array<int64_t, 2>* ends,
                     int64_t edge_count, double tolerance, int64_t* merged) {
  std::vector<double> radius(vertex_count);  // how far the vertices merged with each one have moved, at most
  for (int64_t v = 0; v < vertex_count; ++v) merged[v] = v;
  const auto root = [&](int64_t vertex) {  // of a union-find forest
    while (merged[vertex] != vertex) vertex = merged[vertex];
    return vertex;
  };
  for (int64_t edge = 0; edge < edge_count; ++edge) {
    int64_t a = root(ends[edge][0]), b = root(ends[edge][1]);
    if (radius[b] > radius[a]) std::swap(a, b);
    const double x = places[a][0] - places[b][0], y = places[a][1] - places[b][1], z = places[a][2] - places[b][2];
    const double moved = std::sqrt(x * x + y * y + z * z) + radius[b];
    if (a == b || moved > tolerance) continue;
    merged[b] = a;
    radius[a] = std::max(radius[a], moved);
  }
  for (int64_t v = 0; v < vertex_count; ++v) merged[v] = root(v);
}

}  // namespace nablahog::rendering
