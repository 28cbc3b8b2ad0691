// Quadratic forms and their factors: see quadratic.py and factors.py.
#pragma once

#include "band.h"
#include "cone.h"

// A quadratic form over (component, cell), and its factor on the free directions of a face.
struct Quadratic {
  Algebra algebra;
  Index c, n;
  virtual ~Quadratic() = default;
  virtual void product(const double* x, double* out) const = 0;
  virtual void diagonal(double* out) const = 0;
  // Factor of W'HW + diag(more) for `more` (direction, cell); false if rounding makes it indefinite.
  virtual bool factor(const Face& face, bool mixed, const Vector& more) = 0;
  // H^-1 right, in place, for free directions in the order of Face::index.
  virtual void solve(Vector& right) const = 0;
};

// Free directions of one component (or of all, mixed), in the order of a chain: see factors.Part.
struct Part {
  Indices cell, direction, position;  // position: in Face::index
  std::shared_ptr<OwnBand> chain;
  double scale = 1.0;
  Vector block, gram;  // L^-1 G' (fours(direction), fours(reading)), and its Gram matrix
};

// Few readings and a penalty between neighbouring cells.
struct Few : Quadratic {
  Index readings, entries;
  const double* columns;  // (component, cell, reading)
  const double* values;   // (component, entry)
  const Index *row, *col;
  Indices starts, by_rank;  // entries of each row; cells in the order of the chain
  std::vector<Part> parts;
  Vector lower;  // of 1 + B'B

  Index lead() const { return fours(readings); }
  void prepare(const Index* rank) {
    starts.assign(n + 1, 0), by_rank.resize(n);
    for (Index e = 0; e < entries; ++e) ++starts[row[e] + 1];
    for (Index i = 0; i < n; ++i) starts[i + 1] += starts[i], by_rank[rank[i]] = i;
  }
  void product(const double* x, double* out) const override {
    Vector seen(readings);
    algebra.times("N", readings, c * n, 1.0, columns, readings, x, 1, 0.0, seen.data(), 1);
    for (Index k = 0; k < c; ++k)
      for (Index i = 0; i < n; ++i) {
        double sum = 0.0;
        for (Index e = starts[i]; e < starts[i + 1]; ++e) sum += values[k * entries + e] * x[k * n + col[e]];
        out[k * n + i] = sum;
      }
    algebra.times("T", readings, c * n, 1.0, columns, readings, seen.data(), 1, 1.0, out, 1);
  }
  void diagonal(double* out) const override {
    for (Index k = 0; k < c; ++k)
      for (Index i = 0; i < n; ++i) {
        const double* g = columns + (k * n + i) * readings;
        double sum = dot(g, g, readings);
        for (Index e = starts[i]; e < starts[i + 1]; ++e)
          if (col[e] == i) sum += values[k * entries + e];
        out[k * n + i] = sum;
      }
  }
  bool in_proportion(Index k, Index other) const {
    const double *a = values + k * entries, *b = values + other * entries, ratio = entries ? b[0] / a[0] : 1.0;
    for (Index e = 0; e < entries; ++e)
      if (!(std::fabs(a[e] * ratio - b[e]) <= 1e-13 * std::fabs(b[e]))) return false;
    return true;
  }
  // Factor of the penalty on the directions of a part: quadratic.Penalty.parts.
  bool chain_of(Part& part, const Face& face, const Vector& more) {
    const Index size = Index(part.cell.size());
    Indices first(n, -1), last(n, -1);
    for (Index a = size - 1; a >= 0; --a) first[part.cell[a]] = a;
    for (Index a = 0; a < size; ++a) last[part.cell[a]] = a;
    Indices begins(size);
    for (Index a = 0; a < size; ++a) {
      begins[a] = a;
      for (Index e = starts[part.cell[a]]; e < starts[part.cell[a] + 1]; ++e)
        if (first[col[e]] >= 0) begins[a] = std::min(begins[a], first[col[e]]);
    }
    part.chain = std::make_shared<OwnBand>(begins);
    for (Index a = 0; a < size; ++a) {
      const Index i = part.cell[a], p = part.direction[a];
      for (Index e = starts[i]; e < starts[i + 1]; ++e) {
        const Index j = col[e];
        if (first[j] < 0) continue;
        for (Index b = first[j]; b <= std::min(a, last[j]); ++b) {
          const Index q = part.direction[b];
          double sum = 0.0;
          if (face.oblique[i] || face.oblique[j])
            for (Index k = 0; k < c; ++k) sum += face.basis[(i * c + k) * c + p] * values[k * entries + e] * face.basis[(j * c + k) * c + q];
          else if (p == q)
            sum = values[p * entries + e];
          if (sum != 0.0) part.chain->entry(a, b) = sum;
        }
      }
      part.chain->entry(a, a) += more[p * n + i];
    }
    return part.chain->factorise();
  }
  void gather(Part& part, const Face& face) {
    part.block.assign(fours(Index(part.cell.size())) * lead(), 0.0);
    for (Index a = 0; a < Index(part.cell.size()); ++a) {
      const Index i = part.cell[a], d = part.direction[a];
      double* out = &part.block[a * lead()];
      for (Index k = 0; k < c; ++k) {
        const double weight = face.basis[(i * c + k) * c + d];
        const double* g = columns + (k * n + i) * readings;
        if (weight == 1.0)
          std::copy_n(g, readings, out);
        else if (weight != 0.0)
          for (Index r = 0; r < readings; ++r) out[r] += weight * g[r];
      }
    }
  }
  bool factor(const Face& face, bool mixed, const Vector& more) override {
    std::vector<Part> before;
    before.swap(parts);
    Indices place(c * n);
    Index count = 0;
    for (Index a = 0; a < c * n; ++a) place[a] = face.free[a] ? count++ : -1;
    parts.resize(mixed ? 1 : c);
    for (Index i : by_rank)
      for (Index d = 0; d < c; ++d)
        if (face.free[d * n + i]) {
          Part& part = parts[mixed ? 0 : d];
          part.cell.push_back(i), part.direction.push_back(d), part.position.push_back(place[d * n + i]);
        }
    for (Index s = 0; s < Index(parts.size()); ++s) {
      Part& part = parts[s];
      if (!mixed && !before.empty() && before[s].cell == part.cell) {  // as in the last step, but for its place
        before[s].position.swap(part.position);
        part = std::move(before[s]);
        continue;
      }
      for (Index other = 0; !mixed && other < s && !part.chain; ++other)
        if (parts[other].scale == 1.0 && parts[other].cell == part.cell && entries && in_proportion(other, s))
          part.chain = parts[other].chain, part.scale = values[s * entries] / values[other * entries];
      if (!part.chain && !chain_of(part, face, more)) return false;
      gather(part, face);
      part.chain->view().forward(part.block.data(), readings);
      if (part.scale != 1.0)
        for (double& b : part.block) b *= 1.0 / std::sqrt(part.scale);
      part.gram.assign(readings * readings, 0.0);
      algebra.square("L", "N", readings, Index(part.cell.size()), 1.0, part.block.data(), lead(), 0.0, part.gram.data(), readings);
    }
    lower.assign(readings * readings, 0.0);
    for (const Part& part : parts)
      for (Index a = 0; a < readings * readings; ++a) lower[a] += part.gram[a];
    for (Index r = 0; r < readings; ++r) lower[r * (readings + 1)] += 1.0;
    return algebra.cholesky("L", readings, lower.data(), readings);
  }
  void solve(Vector& right) const override {
    Vector seen(readings);
    std::vector<Vector> halves;
    for (const Part& part : parts) {
      const Index size = Index(part.cell.size());
      Vector half(4 * fours(size));  // one column of four is in use
      for (Index a = 0; a < size; ++a) half[4 * a] = right[part.position[a]];
      part.chain->view().forward(half.data(), 1);
      const double unit = 1.0 / std::sqrt(part.scale);
      algebra.times("N", readings, size, unit, part.block.data(), lead(), half.data(), 4, 1.0, seen.data(), 1);
      halves.push_back(std::move(half));
    }
    algebra.triangle("L", "N", readings, lower.data(), readings, seen.data());
    algebra.triangle("L", "T", readings, lower.data(), readings, seen.data());
    for (std::size_t s = 0; s < parts.size(); ++s) {
      const Part& part = parts[s];
      const Index size = Index(part.cell.size());
      const double unit = 1.0 / std::sqrt(part.scale);
      algebra.times("T", readings, size, -1.0, part.block.data(), lead(), seen.data(), 1, unit, halves[s].data(), 4);
      part.chain->view().backward(halves[s].data(), 1);
      for (Index a = 0; a < size; ++a) right[part.position[a]] = unit * halves[s][4 * a];
    }
  }
};

// A matrix: see quadratic.Formed.
struct Matrix : Quadratic {
  const double* matrix;
  Index size = 0;     // of the factor on the free directions
  Vector lower;       // the factor, or that of the Schur complement of pressure if `beside`
  bool beside = false, asked = false;
  Vector first, tied, left;  // factor of all shear, L^-1 of its coupling (pressure, shear), Schur complement of pressure
  Indices pressing;          // free cells of pressure, if `beside`

  Index shear() const { return (c - 1) * n; }
  void product(const double* x, double* out) const override {
    int size_ = int(c * n), one = 1;
    double alpha = 1.0, beta = 0.0;
    algebra.blas->symv("L", &size_, &alpha, matrix, &size_, x, &one, &beta, out, &one);
  }
  void diagonal(double* out) const override {
    for (Index a = 0; a < c * n; ++a) out[a] = matrix[a * (c * n + 1)];
  }
  bool eliminate_shear() {
    const Index s = shear(), all = c * n;
    first.assign(s * s, 0.0), tied.resize(n * s), left.resize(n * n);
    for (Index a = 0; a < s; ++a) std::copy_n(matrix + a * (all + 1), s - a, &first[a * (s + 1)]);
    for (Index a = 0; a < n; ++a) std::copy_n(matrix + (s + a) * all, s, &tied[a * s]), std::copy_n(matrix + (s + a) * all + s, n, &left[a * n]);
    if (!algebra.cholesky("L", s, first.data(), s)) return false;
    algebra.triangles("L", "L", "N", s, n, first.data(), s, tied.data(), s);
    algebra.square("L", "T", n, s, -1.0, tied.data(), s, 1.0, left.data(), n);
    return true;
  }
  bool factor(const Face& face, bool mixed, const Vector& more) override {
    const Indices index = face.index();
    beside = false, size = Index(index.size());
    if (c > 1 && !mixed && size >= shear() && (size == shear() || index[shear()] >= shear())) {
      const Index some = size - shear();
      if (asked || (n / 2 < some && some < n)) {
        if (first.empty() && !eliminate_shear()) return false;
        beside = true, size = some, pressing.assign(index.begin() + shear(), index.end());
        for (Index& i : pressing) i -= shear();
        lower.assign(size * size, 0.0);
        for (Index a = 0; a < size; ++a)
          for (Index b = a; b < size; ++b) lower[a * size + b] = left[pressing[a] * n + pressing[b]];
        return algebra.cholesky("L", size, lower.data(), size);
      }
      asked = true;
    }
    lower.assign(size * size, 0.0);
    Vector line(c * n);
    for (Index a = 0; a < size; ++a) {  // W' H W, one direction after another
      const Index d = index[a] / n, i = index[a] % n;
      const double* from = matrix + index[a] * (c * n);
      if (face.oblique[i]) {
        std::fill(line.begin(), line.end(), 0.0);
        for (Index k = 0; k < c; ++k)
          for (Index b = 0; b < c * n; ++b) line[b] += face.basis[(i * c + k) * c + d] * matrix[(k * n + i) * (c * n) + b];
        from = line.data();
      }
      for (Index b = a; b < size; ++b) lower[a * size + b] = from[index[b]];
      for (Index b = a; face.any_oblique && b < size; ++b) {
        const Index e = index[b] / n, j = index[b] % n;
        if (!face.oblique[j]) continue;
        double sum = 0.0;
        for (Index k = 0; k < c; ++k) sum += from[k * n + j] * face.basis[(j * c + k) * c + e];
        lower[a * size + b] = sum;
      }
      lower[a * (size + 1)] += more[index[a]];
    }
    return algebra.cholesky("L", size, lower.data(), size);
  }
  void solve(Vector& right) const override {
    if (!beside) {
      algebra.triangle("L", "N", size, lower.data(), size, right.data());
      algebra.triangle("L", "T", size, lower.data(), size, right.data());
      return;
    }
    const Index s = shear();
    Vector whole(n, 0.0), pressure(n);
    algebra.triangle("L", "N", s, first.data(), s, right.data());
    algebra.times("T", s, n, 1.0, tied.data(), s, right.data(), 1, 0.0, pressure.data(), 1);
    double* rest = right.data() + s;
    for (Index a = 0; a < size; ++a) rest[a] -= pressure[pressing[a]];
    algebra.triangle("L", "N", size, lower.data(), size, rest);
    algebra.triangle("L", "T", size, lower.data(), size, rest);
    for (Index a = 0; a < size; ++a) whole[pressing[a]] = rest[a];
    algebra.times("N", s, n, -1.0, tied.data(), s, whole.data(), 1, 1.0, right.data(), 1);
    algebra.triangle("L", "T", s, first.data(), s, right.data());
  }
};

