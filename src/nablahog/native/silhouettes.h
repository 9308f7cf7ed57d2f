// Silhouette edges of a mesh, and where visible edges cross between neighbouring samples.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "rasterize.h"

namespace nablahog::rendering {

constexpr float gap_share = 0.05f;  // relative difference of 1 / depth above which one surface ends before another
constexpr float touching = 0.004f;  // share of 1 / depth by which an edge behind a surface may still be its crease
constexpr int32_t boundary = 1;     // the kind of an edge of one face, or of more than two; 0 is a smooth surface

struct Edges {
  int64_t count;
  const std::array<int32_t, 2>* ends;  // (count,) vertices
  const int32_t* kind;                 // (count,)
  const float* planes;  // (2, 4, count): of both faces, the normal n, and n·x in its plane; 0 without area
};

// Marks silhouette edges, (eye_count, count): those with both faces on one side as seen from an eye, in the object's
// frame, and all boundaries.
inline void silhouette_edges(const Edges& edges, const std::array<float, 3>* eyes, int64_t eye_count,
                             uint8_t* silhouettes) {
  constexpr int64_t cached = 1024;  // edges that stay in a processor's cache
  const int64_t n = edges.count;
  for (int64_t first = 0; first < n; first += cached) {
    const int64_t last = std::min(first + cached, n);
    for (int64_t b = 0; b < eye_count; ++b) {
      const auto [x, y, z] = eyes[b];
      const float *one = edges.planes, *other = edges.planes + 4 * n;
      uint8_t* out = silhouettes + b * n;
      for (int64_t e = first; e < last; ++e) {
        const float side = one[e] * x + one[n + e] * y + one[2 * n + e] * z - one[3 * n + e];
        const float opposite = other[e] * x + other[n + e] * y + other[2 * n + e] * z - other[3 * n + e];
        out[e] = (edges.kind[e] == boundary) | (side * opposite >= 0);
      }
    }
  }
}

// Whether an edge at 1 / depth w is visible between two samples, and whether these have a gap in depth
struct Visibility {
  bool visible, gap;
};

inline Visibility visibility(float w, float here, float there, bool is_silhouette) {
  const float low = std::min(here, there), high = std::max(here, there);
  const bool gap = high - low > gap_share * high;
  const bool in_front = gap ? is_silhouette && !(w < 0.5f * (low + high)) : !(w < (1 - touching) * low);
  return {high != 0 && in_front, gap};
}

// Adds the crossings of one edge with the links along one axis.  `start` and `end` are (p, q, w): p runs across the
// links, q along them.  The links are at first…last along p.
template <int AXIS>
void follow_edge(int32_t edge, int first, int last, Point<float> start, Point<float> end, bool measured,
                 bool is_silhouette, const Samples& samples, int32_t* number, std::vector<Crossing>& crossings) {
  const int64_t width = samples.width, along = AXIS == 0 ? samples.height : width;
  const bool turned = end[0] < start[0];
  const float p0 = turned ? end[0] : start[0], p1 = turned ? start[0] : end[0];
  const float q0 = turned ? end[1] : start[1], q1 = turned ? start[1] : end[1];
  const float w0 = turned ? end[2] : start[2], w1 = turned ? start[2] : end[2];
  const float slope = (q1 - q0) / (p1 - p0), deepening = (w1 - w0) / (p1 - p0);
  const float q_end = float(along - 1);
  for (int p = first; p <= last; ++p) {
    const float further = float(p) + 0.5f - p0;
    const float q = q0 + further * slope - 0.5f;
    if (!(q >= 0 && q < q_end)) continue;
    const int k = int(q);
    const float w = w0 + further * deepening, t = q - float(k);
    const int row = AXIS == 0 ? k : p, col = AXIS == 0 ? p : k;
    const int64_t at = row * width + col;
    const float here = samples.inverse[at], there = samples.inverse[at + (AXIS == 0 ? width : 1)];
    const auto [visible, gap] = visibility(w, here, there, is_silhouette);
    if (!visible) continue;
    int32_t& known = number[AXIS * samples.height * width + at];
    const Crossing crossing{AXIS, row, col, edge, t, slope, w, measured};
    if (known == 0) {
      crossings.push_back(crossing);
      known = int32_t(crossings.size());
      continue;
    }
    // of several edges on one link, the outermost of the nearer surface counts where there is a gap, else the nearest
    Crossing& other = crossings[known - 1];
    const bool behind = gap ? (here > there ? t <= other.at : t >= other.at) : other.w >= w;
    if (!behind) other = crossing;
  }
}

// Follows each edge sample by sample along both axes, and lists the links that it crosses where it is visible: in front
// of what is behind.  `number` (2, height, width), zeros at first, gets 1 + the index of the crossing of the link from
// a sample along each axis.  `silhouette` (count,) is of one eye, `candidates` (count,) scratch.
inline void edge_crossings(const Point<float>* screen, const SampleBox* boxes, const Edges& edges,
                           const uint8_t* silhouette, int32_t* candidates, const Samples& samples, int32_t* number,
                           std::vector<Crossing>& crossings) {
  crossings.clear();
  int64_t listed = 0;
  for (int64_t e = 0; e < edges.count; ++e) {
    candidates[listed] = int32_t(e);
    listed += (edges.kind[e] | silhouette[e]) != 0;
  }
  for (int64_t c = 0; c < listed; ++c) {
    const int32_t e = candidates[c];
    const auto [a, b] = edges.ends[e];
    // links down are crossed at the middles of columns, links to the right at those of rows
    const SampleBox least = minimum(boxes[a], boxes[b]), most = maximum(boxes[a], boxes[b]);
    const int row = -most[0], last_row = -least[0] - 1, col = -most[2], last_col = -least[2] - 1;
    if ((row > last_row) & (col > last_col)) continue;
    const auto [xa, ya, wa] = screen[a];
    const auto [xb, yb, wb] = screen[b];
    if (!(wa > 0 && wb > 0)) continue;
    const bool steep = std::abs(yb - ya) > std::abs(xb - xa), is_silhouette = silhouette[e];
    follow_edge<0>(e, col, last_col, {xa, ya, wa}, {xb, yb, wb}, !steep, is_silhouette, samples, number, crossings);
    follow_edge<1>(e, row, last_row, {ya, xa, wa}, {yb, xb, wb}, steep, is_silhouette, samples, number, crossings);
  }
}

}  // namespace nablahog::rendering
