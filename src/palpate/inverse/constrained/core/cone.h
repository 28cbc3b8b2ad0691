// The cone of a traction and its faces: see cone.Cone and faces.Face.
#pragma once

#include "algebra.h"

constexpr Index MAX_COMPONENTS = 3;

// The set in which the traction of each cell lies, in scaled variables: see cone.Cone.
struct Cone {
  Index c, n;
  bool free, coupled;

  double shear(const double* v, Index i) const {
    double sum = 0.0;
    for (Index k = 0; k + 1 < c; ++k) sum += v[k * n + i] * v[k * n + i];
    return std::sqrt(sum);
  }
  // Nearest point, in place: cone.Cone.project.
  void project(double* v) const {
    if (free) return;
    double* p = v + (c - 1) * n;
    for (Index i = 0; i < n; ++i) {
      if (!coupled) {
        p[i] = std::max(p[i], 0.0);
        continue;
      }
      const double size = shear(v, i);
      if (size <= p[i]) continue;
      p[i] = std::max(0.5 * (p[i] + size), 0.0);
      for (Index k = 0; k + 1 < c; ++k) v[k * n + i] *= size == 0.0 ? p[i] : p[i] / size;
    }
  }
};

// Free directions of every cell: see faces.Face and cone.Cone.directions.
struct Face {
  Index c = 0, n = 0;
  Vector basis;              // (cell, component, direction)
  Vector values;             // (direction, cell)
  std::vector<char> free;    // (direction, cell)
  std::vector<char> oblique;  // (cell,)
  bool any_oblique = false;

  void at(const Cone& cone, const double* v, double least) {
    c = cone.c, n = cone.n, any_oblique = false;
    basis.assign(n * c * c, 0.0), values.assign(c * n, 1.0), oblique.assign(n, 0);
    const double* p = v + (c - 1) * n;
    for (Index i = 0; i < n; ++i) {
      double* w = &basis[i * c * c];
      for (Index k = 0; k < c; ++k) w[k * c + k] = 1.0;
      if (cone.free) continue;
      if (!cone.coupled) {
        values[(c - 1) * n + i] = p[i] > 0.0;
        continue;
      }
      const double size = cone.shear(v, i);
      if (size <= -p[i]) {
        for (Index k = 0; k < c; ++k) values[k * n + i] = 0.0;
      } else if (size > p[i]) {  // along the generator, across it, and round the cone: faces.slanted
        const double root = std::sqrt(0.5);
        std::fill(w, w + c * c, 0.0);
        for (Index k = 0; k + 1 < c; ++k) w[k * c] = root * v[k * n + i] / size, w[k * c + 1] = -w[k * c];
        w[(c - 1) * c] = w[(c - 1) * c + 1] = root;
        values[n + i] = 0.0;
        if (c == 3) {
          w[2] = -v[n + i] / size, w[c + 2] = v[i] / size;
          values[2 * n + i] = 0.5 * (1.0 + p[i] / size);
        }
        oblique[i] = 1, any_oblique = true;
      }
    }
    free.resize(c * n);
    for (Index a = 0; a < c * n; ++a) free[a] = values[a] > least;
  }
  // W'x, where the directions are not the components.
  void rotate(const double* x, double* out) const {
    std::copy(x, x + c * n, out);
    for (Index i = 0; any_oblique && i < n; ++i)
      for (Index d = 0; oblique[i] && d < c; ++d) {
        double sum = 0.0;
        for (Index k = 0; k < c; ++k) sum += basis[(i * c + k) * c + d] * x[k * n + i];
        out[d * n + i] = sum;
      }
  }
  // W x, in place.
  void unrotate(double* x) const {
    for (Index i = 0; any_oblique && i < n; ++i) {
      if (!oblique[i]) continue;
      double turned[MAX_COMPONENTS] = {};
      for (Index k = 0; k < c; ++k)
        for (Index d = 0; d < c; ++d) turned[k] += basis[(i * c + k) * c + d] * x[d * n + i];
      for (Index k = 0; k < c; ++k) x[k * n + i] = turned[k];
    }
  }
  // Index (direction, cell) of the free directions.
  Indices index() const {
    Indices out;
    for (Index a = 0; a < c * n; ++a)
      if (free[a]) out.push_back(a);
    return out;
  }
};

