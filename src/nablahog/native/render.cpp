// The interface of the renderer's loops, and the simplification of meshes.  Shapes are in the headers.
#include <array>
#include <cmath>
#include <cstdint>
#include <utility>
#include <vector>

#include "interface.h"
#include "renderer.h"

using namespace nablahog;
using namespace nablahog::rendering;

namespace {

// Merges the two vertices of each edge, unless a vertex would move farther than `tolerance`.  Sets `merged`
// (vertex_count,) to the vertex that each is merged with.
void collapse(const std::array<double, 3>* places, int64_t vertex_count, const std::array<int64_t, 2>* ends,
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

template <class T>
const T* rows(const void* numbers) {
  return static_cast<const T*>(numbers);
}

}  // namespace

// Images at poses first…last - 1.  `screen_gradients` may be null.
NABLAHOG_API int nablahog_render(const float* vertices, int64_t vertex_count, const int32_t* faces,
                                 const float* brightness, int64_t face_count, const int32_t* ends, const int32_t* kind,
                                 const float* planes, int64_t edge_count, double focal, int64_t height, int64_t width,
                                 int64_t step, bool antialiased, const double* poses, int64_t first, int64_t last,
                                 float* images, float* screen_gradients) {
  return guarded([&] {
    const Mesh mesh{vertex_count, face_count, rows<Vertex>(vertices), rows<Face>(faces), rows<Corners>(brightness)};
    const Edges edges{edge_count, rows<std::array<int32_t, 2>>(ends), kind, planes};
    const int64_t size = height * width;
    render(mesh, edges, Camera{focal, height, width, step}, antialiased, rows<Pose>(poses) + first, last - first,
           images + first * size, screen_gradients ? screen_gradients + first * 4 * size : nullptr);
  });
}

// The constants that nablahog/render has, too
NABLAHOG_API int nablahog_render_constants(double* constants) {
  constants[0] = near_share;
  constants[1] = gap_share;
  constants[2] = touching;
  constants[3] = boundary;
  return 0;
}

// Of points (count, point_count, 3) of double or float
NABLAHOG_API int nablahog_rasterize(bool double_precision, const void* screen, int64_t count, int64_t point_count,
                                    const int32_t* faces, int64_t face_count, int64_t height, int64_t width,
                                    int32_t* ids, void* inverse) {
  return guarded([&] {
    with_real(double_precision, [&]<class T>() {
      rasterize_images(rows<Point<T>>(screen), count, point_count, rows<Face>(faces), face_count, height, width, ids,
                       static_cast<T*>(inverse));
    });
  });
}

// Rotations (count, 3, 3) at poses (count, 6)
NABLAHOG_API int nablahog_rotations(const double* poses, int64_t count, double* rotations) {
  for (int64_t b = 0; b < count; ++b) reinterpret_cast<Rotation*>(rotations)[b] = rotation(rows<Pose>(poses)[b]);
  return 0;
}

// Gradients (count, 6) with respect to poses from those with respect to images, of double or float
NABLAHOG_API int nablahog_pose_vjp(bool double_precision, const void* grad_images, const void* screen_gradients,
                                   const double* poses, int64_t count, double focal, int64_t height, int64_t width,
                                   double* grad_poses) {
  return guarded([&] {
    with_real(double_precision, [&]<class T>() {
      const int64_t size = height * width;
      for (int64_t b = 0; b < count; ++b) {
        reinterpret_cast<Pose*>(grad_poses)[b] =
            pose_vjp(rows<T>(grad_images) + b * size, rows<T>(screen_gradients) + b * 4 * size, rows<Pose>(poses)[b],
                     focal, height, width);
      }
    });
  });
}

NABLAHOG_API int nablahog_collapse(const double* places, int64_t vertex_count, const int64_t* ends, int64_t edge_count,
                                   double tolerance, int64_t* merged) {
  return guarded([&] {
    collapse(rows<std::array<double, 3>>(places), vertex_count, rows<std::array<int64_t, 2>>(ends), edge_count,
             tolerance, merged);
  });
}
