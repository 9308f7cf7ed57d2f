// Images of one rigid object at many poses, with what their derivatives by the pose need.
#pragma once

#include <limits>
#include <vector>

#include "pixels.h"
#include "pose_gradient.h"
#include "rasterize.h"
#include "silhouettes.h"
#include "workspace.h"

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

constexpr double near_share = 1e-3;  // depth of the near plane, as a share of the camera's distance from the object

struct Mesh {
  int64_t vertex_count, face_count;
  const Vertex* vertices;
  const Face* faces;
  const Corners* brightness;
};

struct Camera {
  double focal;  // pixels
  int64_t height, width;
  int64_t step;  // samples of a pixel along a side
};

// A pose as the projection takes it
struct View {
  float rotation[3][3];
  float distance;   // to the object's origin
  Vertex eye;       // the camera in the object's frame
  float focal;      // samples
  float centre[2];  // principal point, samples
  float near;       // a mesh with a vertex at this depth or before it has to be clipped first
  float least;      // vertices before this depth are not drawn, nor what has them for corners
};

inline View view_of(const Pose& pose, const Camera& camera) {
  const Rotation axes = rotation(pose);
  const double distance = pose[2], near = near_share * distance;
  View view;
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) view.rotation[i][j] = float(axes[i][j]);
    view.eye[i] = float(-distance * axes[2][i]);
  }
  view.distance = float(distance);
  view.focal = float(camera.focal * double(camera.step));
  view.centre[0] = float((pose[4] + double(camera.width) / 2) * double(camera.step));
  view.centre[1] = float((pose[5] + double(camera.height) / 2) * double(camera.step));
  view.near = float(near);
  view.least = float(near * (1 - 1e-6));  // rounding puts clipped vertices no farther before the near plane
  return view;
}

// Projects a mesh's vertices; returns the least depth.
inline float project(const Mesh& mesh, const View& view, Point<float>* screen) {
  const auto& r = view.rotation;
  float least = std::numeric_limits<float>::infinity();
  for (int64_t v = 0; v < mesh.vertex_count; ++v) {
    const auto [x, y, z] = mesh.vertices[v];
    const float depth = r[2][0] * x + r[2][1] * y + r[2][2] * z + view.distance;
    const double inverse = 1 / double(depth);
    screen[v] = {
        float(double(view.focal * (r[0][0] * x + r[0][1] * y + r[0][2] * z)) * inverse + double(view.centre[0])),
        float(double(view.focal * (r[1][0] * x + r[1][1] * y + r[1][2] * z)) * inverse + double(view.centre[1])),
        depth >= view.least ? float(inverse) : 0};
    least = std::min(least, depth);
  }
  return least;
}

// The first of `count` pixels that may show something from `low` on, in samples, and the one after the last before
// `high`: one sample more to each side, for the edges
inline int64_t first_pixel(float low, int64_t step, int64_t count) {
  const double pixel = std::floor((std::floor(double(low)) - 1) / double(step));
  return int64_t(std::max(0., std::min(double(count), pixel)));
}
inline int64_t end_pixel(float high, int64_t step, int64_t count) {
  const double pixel = std::ceil((std::ceil(double(high)) + 1) / double(step));
  return int64_t(std::max(0., std::min(double(count), pixel)));
}

// Finds the box of pixels that the points may cover, and moves the points' origin to its corner.
inline void move_to_box(Point<float>* screen, int64_t count, Pixels& pixels) {
  constexpr float infinite = std::numeric_limits<float>::infinity();
  float top = infinite, left = infinite, bottom = -infinite, right = -infinite;
  for (int64_t v = 0; v < count; ++v) {
    const auto [x, y, w] = screen[v];
    if (w > 0) {
      top = std::min(top, y), bottom = std::max(bottom, y);
      left = std::min(left, x), right = std::max(right, x);
    }
  }
  pixels.top = first_pixel(top, pixels.step, pixels.height);
  pixels.left = first_pixel(left, pixels.step, pixels.width);
  pixels.rows = end_pixel(bottom, pixels.step, pixels.height) - pixels.top;
  pixels.cols = end_pixel(right, pixels.step, pixels.width) - pixels.left;
  const float x = float(pixels.left * pixels.step), y = float(pixels.top * pixels.step);
  for (int64_t v = 0; v < count; ++v) {
    screen[v][0] -= x;
    screen[v][1] -= y;
  }
}

// The part of a mesh in front of the near plane, and a view of it: the frame is the camera's.
inline ClippedMesh clip_to_view(const Mesh& mesh, View& view) {
  const auto& r = view.rotation;
  std::vector<Vertex> vertices(mesh.vertices, mesh.vertices + mesh.vertex_count);
  for (Vertex& vertex : vertices) {
    const auto [x, y, z] = vertex;
    for (int k = 0; k < 3; ++k) vertex[k] = r[k][0] * x + r[k][1] * y + r[k][2] * z;
    vertex[2] += view.distance;
  }
  const float near = view.near;
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) view.rotation[i][j] = i == j;
  }
  view.distance = 0;
  return clip(std::move(vertices), mesh.faces, mesh.brightness, mesh.face_count, near);
}

// Renders a mesh at one view over the image.  `silhouette` (edges.count,) is of its eye.
inline void render_view(Mesh mesh, const Edges& edges, const uint8_t* silhouette, View view, bool antialiased,
                        Pixels pixels) {
  thread_local Workspace memory;
  thread_local std::vector<Crossing> crossings;
  memory.clear();
  Point<float>* screen = memory.uninitialized<Point<float>>(mesh.vertex_count);
  ClippedMesh part;
  if (project(mesh, view, screen) <= view.near) {
    part = clip_to_view(mesh, view);
    mesh = {int64_t(part.vertices.size()), int64_t(part.faces.size()), part.vertices.data(), part.faces.data(),
            part.brightness.data()};
    screen = memory.uninitialized<Point<float>>(mesh.vertex_count);
    project(mesh, view, screen);
  }
  move_to_box(screen, mesh.vertex_count, pixels);
  if (pixels.rows <= 0 || pixels.cols <= 0 || mesh.face_count == 0) return;
  const int64_t height = pixels.rows * pixels.step, width = pixels.cols * pixels.step, size = height * width;
  const Samples samples{height, width, memory.uninitialized<int32_t>(size), memory.uninitialized<float>(size),
                        memory.uninitialized<float>(size)};
  SampleBox* boxes = memory.uninitialized<SampleBox>(mesh.vertex_count);
  sample_boxes(screen, mesh.vertex_count, height, width, boxes);
  rasterize(screen, boxes, mesh.faces, mesh.face_count, height, width, samples.ids, samples.inverse);
  shade(screen, mesh.faces, mesh.brightness, pixels, memory.zeros<uint8_t>(mesh.face_count),
        memory.uninitialized<BrightnessPlane>(mesh.face_count), samples);
  int32_t* number = memory.zeros<int32_t>(2 * size);
  edge_crossings(screen, boxes, edges, silhouette, memory.uninitialized<int32_t>(edges.count), samples, number,
                 crossings);
  if (antialiased) {
    antialias(samples, number, crossings, pixels, memory.zeros<float>(12 * width));
  } else {
    int32_t* drawn = memory.zeros<int32_t>(size);
    opendr::draw_silhouettes(samples, silhouette, crossings, drawn);
    opendr::resolve(samples, drawn, pixels);
  }
}

// Images (count, height, width) at poses, over what they hold at first, and their gradients by the motion of surfaces,
// (count, 4, height, width), zeros at first, or null.
inline void render(const Mesh& mesh, const Edges& edges, const Camera& camera, bool antialiased, const Pose* poses,
                   int64_t count, float* images, float* screen_gradients) {
  std::vector<View> views;
  std::vector<Vertex> eyes;
  for (int64_t b = 0; b < count; ++b) {
    views.push_back(view_of(poses[b], camera));
    eyes.push_back(views[b].eye);
  }
  std::vector<uint8_t> silhouettes(count * edges.count);
  silhouette_edges(edges, eyes.data(), count, silhouettes.data());
  const int64_t size = camera.height * camera.width;
  for (int64_t b = 0; b < count; ++b) {
    Pixels pixels{};
    pixels.height = camera.height;
    pixels.width = camera.width;
    pixels.step = camera.step;
    pixels.image = images + b * size;
    if (screen_gradients) pixels.screen_gradient = screen_gradients + b * 4 * size;
    render_view(mesh, edges, silhouettes.data() + b * edges.count, views[b], antialiased, pixels);
  }
}

}  // namespace nablahog::rendering
