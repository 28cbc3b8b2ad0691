// Newton's method: see cone.py.
#pragma once

#include "quadratic.h"

// Limits of Newton's method: the constants of cone.py.
struct Limits {
  double tolerance, smaller, nearly, turned, least_value;
  Index steps, patience;
};

// Newton's method of one problem: see cone.minimise.
struct Newton {
  Cone cone;
  Limits limits;
  std::unique_ptr<Quadratic> hessian;
  const double* linear;
  Vector step_size, x, gradient, best, best_gradient, v, residual, local, fixed, more, work;
  double reference = 0.0, best_size = std::numeric_limits<double>::infinity(), found_at = best_size, last = best_size;
  Index since = 0, taken = 0;
  bool known = false;
  Face face, next;

  void begin(const double* start) {
    const Index c = cone.c, n = cone.n, all = c * n;
    for (Vector* each : {&gradient, &v, &residual, &local, &fixed, &work}) each->resize(all);
    more.assign(all, 0.0), step_size.resize(n), x.assign(start, start + all);
    hessian->diagonal(work.data());
    for (Index i = 0; i < n; ++i) {
      double sum = 0.0;
      for (Index k = 0; k < c; ++k) sum += work[k * n + i];
      step_size[i] = double(c) / std::max(sum, 1e-300);
    }
    for (Index a = 0; a < all; ++a) reference = std::max(reference, std::fabs(step_size[a % n] * linear[a]));
    reference = std::max(reference, 1e-300);
    cone.project(x.data());
    find_gradient();
  }
  void find_gradient() {
    hessian->product(x.data(), gradient.data());
    for (std::size_t a = 0; a < x.size(); ++a) gradient[a] -= linear[a];
  }
  // The face and factor at the projection of v: cone._factored. False if the matrix is not positive definite.
  bool refresh(bool keep, bool& renewed) {
    next.at(cone, v.data(), limits.least_value);
    renewed = !(known && next.free == face.free && next.oblique == face.oblique && (keep || !next.any_oblique));
    if (!renewed) return true;
    std::swap(face, next), known = true;
    for (Index a = 0; cone.coupled && a < cone.c * cone.n; ++a)
      more[a] = face.free[a] ? (1.0 - face.values[a]) / (face.values[a] * step_size[a % cone.n]) : 0.0;
    return hessian->factor(face, cone.coupled, more);
  }
  // One step: 0 to go on, 1 if it is done, 2 if it cycles or fails.
  int step() {
    const Index n = cone.n, all = cone.c * n;
    double largest = 1e-6 * reference, size = 0.0;
    for (Index a = 0; a < all; ++a) residual[a] = v[a] = x[a] - step_size[a % n] * gradient[a];
    cone.project(residual.data());
    bool finite = true;
    for (Index a = 0; a < all; ++a) {
      residual[a] = x[a] - residual[a];
      finite = finite && std::isfinite(residual[a]);
      size = std::max(size, std::fabs(residual[a])), largest = std::max(largest, std::fabs(x[a]));
    }
    if (!finite) return 2;
    size /= largest;
    if (size < limits.smaller * best_size)
      best = x, best_gradient = gradient, best_size = size, since = 0;
    else
      ++since;
    if (size <= limits.tolerance || taken >= limits.steps) return 1;
    if (since > limits.patience) return 2;
    bool renewed = false;
    if (!refresh(found_at <= limits.nearly && size <= limits.turned * last, renewed)) return 2;
    if (renewed) found_at = size;
    last = size;
    move();
    find_gradient();
    ++taken;
    return 0;
  }
  // A semismooth Newton step: cone._newton.
  void move() {
    const Index n = cone.n, all = cone.c * n;
    face.rotate(residual.data(), local.data());
    bool any = false;
    for (Index a = 0; a < all; ++a) fixed[a] = face.free[a] ? 0.0 : -local[a], any = any || fixed[a] != 0.0;
    face.unrotate(fixed.data());
    if (any) {
      hessian->product(fixed.data(), work.data());
      Vector turned(all);
      face.rotate(work.data(), turned.data());
      work.swap(turned);
    }
    Vector right;
    for (Index a = 0; a < all; ++a)
      if (face.free[a]) right.push_back(-local[a] / (face.values[a] * step_size[a % n]) - (any ? work[a] : 0.0));
    hessian->solve(right);
    Index place = 0;
    for (Index a = 0; a < all; ++a) work[a] = face.free[a] ? right[place++] : 0.0;
    face.unrotate(work.data());
    for (Index a = 0; a < all; ++a) x[a] += fixed[a] + work[a];
  }
  bool finish() {
    for (std::size_t a = 0; a < x.size(); ++a) v[a] = best[a] - step_size[a % cone.n] * best_gradient[a];
    bool renewed = false;
    return refresh(found_at <= limits.nearly, renewed);
  }
};

