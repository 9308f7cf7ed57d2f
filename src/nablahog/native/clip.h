// The part of a mesh in front of a camera's near plane.
#pragma once

#include <vector>

#include "screen.h"

namespace nablahog::rendering {

using Vertex = std::array<float, 3>;

// Brightness at the corners of a face
using Corners = std::array<float, 3>;

struct ClippedMesh {
  std::vector<Vertex> vertices;  // in the camera's frame: the mesh's own, and new ones on the plane
  std::vector<Face> faces;       // none of them with a corner behind the plane
  std::vector<Corners> brightness;
};

inline float lerp(float start, float end, float t) {
  return t < 0.5f ? start + t * (end - start) : end - (end - start) * (1 - t);
}

// Clips triangles at depth `near`.  With one corner in front a triangle stays one, with two it becomes two.
inline ClippedMesh clip(std::vector<Vertex> vertices, const Face* faces, const Corners* brightness, int64_t face_count,
                        float near) {
  ClippedMesh part{std::move(vertices), {}, {}};
  std::vector<Vertex>& points = part.vertices;
  const auto in_front = [&](int32_t vertex) { return points[vertex][2] > near; };
  const auto add = [&](Face face, Corners corners) {
    part.faces.push_back(face);
    part.brightness.push_back(corners);
  };
  for (const int number : {3, 1, 2}) {  // of corners in front
    for (int64_t f = 0; f < face_count; ++f) {
      const auto [a, b, c] = faces[f];
      if (in_front(a) + in_front(b) + in_front(c) != number) continue;
      if (number == 3) {
        add(faces[f], brightness[f]);
        continue;
      }
      // the odd corner, alone in front or alone behind, comes first
      const int odd = in_front(a) == (number == 1) ? 0 : in_front(b) == (number == 1) ? 1 : 2;
      Face corner;
      Corners bright;
      for (int k = 0; k < 3; ++k) {
        corner[k] = faces[f][(odd + k) % 3];
        bright[k] = brightness[f][(odd + k) % 3];
      }
      int32_t cut[3];
      float shade[3];
      for (const int other : {1, 2}) {
        // from front to back, so that two triangles cut their common edge at the very same point
        const int from = number == 1 ? 0 : other, to = number == 1 ? other : 0;
        const Vertex start = points[corner[from]], end = points[corner[to]];
        const float t = (near - start[2]) / (end[2] - start[2]);
        cut[other] = int32_t(points.size());
        shade[other] = lerp(bright[from], bright[to], t);
        points.push_back({lerp(start[0], end[0], t), lerp(start[1], end[1], t), near});
      }
      if (number == 1) {
        add({corner[0], cut[1], cut[2]}, {bright[0], shade[1], shade[2]});
      } else {
        add({corner[1], corner[2], cut[1]}, {bright[1], bright[2], shade[1]});
        add({corner[2], cut[2], cut[1]}, {bright[2], shade[2], shade[1]});
      }
    }
  }
  return part;
}

}  // namespace nablahog::rendering
