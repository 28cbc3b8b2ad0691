// Cholesky factor of a banded matrix.
#pragma once

#include "algebra.h"

// Four numbers that the compiler keeps in a vector register, or in two.
#ifdef __GNUC__
typedef double Four __attribute__((vector_size(32)));
#else
struct Four {
  double each[4];
  double& operator[](Index k) { return each[k]; }
  const double& operator[](Index k) const { return each[k]; }
};
inline Four operator*(double a, const Four& b) { return {{a * b[0], a * b[1], a * b[2], a * b[3]}}; }
inline Four& operator*=(Four& a, double b) { return a = b * a; }
inline Four& operator+=(Four& a, const Four& b) { return a = {{a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3]}}; }
inline Four& operator-=(Four& a, const Four& b) { return a = {{a[0] - b[0], a[1] - b[1], a[2] - b[2], a[3] - b[3]}}; }
#endif
inline Four load(const double* from) {
  Four out;
  std::memcpy(&out, from, sizeof out);
  return out;
}
inline void store(double* to, const Four& from) { std::memcpy(to, &from, sizeof from); }
// The next multiple of four.
inline Index fours(Index size) { return (size + 3) / 4 * 4; }

// A lower Cholesky factor L in panels of four rows. Each panel has its own first column, a multiple of four; the four
// entries of a column lie together. The last panel is filled up with rows of the identity.
struct Band {
  Index size;
  const Index *first, *at;  // of each panel: its first column, and the place of its first entry
  const double *entries, *inverse;  // inverse: of the diagonal

  Index panels() const { return (size + 3) / 4; }
  // Entry (4 p + i, j) is panel(p)[4 j + i].
  const double* panel(Index p) const { return entries + at[p] - 4 * first[p]; }

  // L^-1 right, in place, for `right` (fours(size), fours(many)) in C order, zero in the rows after the last.
  void forward(double* right, Index many) const {
    Index column = 0;
    for (; column + 12 <= many; column += 12) forward_some<3>(right + column, fours(many));
    for (; column < many; column += 4) forward_some<1>(right + column, fours(many));
  }
  // L'^-1 right, in place.
  void backward(double* right, Index many) const {
    Index column = 0;
    for (; column + 12 <= many; column += 12) backward_some<3>(right + column, fours(many));
    for (; column < many; column += 4) backward_some<1>(right + column, fours(many));
  }
  // The same for 4 * width columns, with zeros in the panels before `begin`.
  template <int width>
  void forward_some(double* right, Index stride, Index begin = 0) const {
    for (Index p = begin; p < panels(); ++p) {
      const double* mine = panel(p);
      Four sums[4][width];
      for (int i = 0; i < 4; ++i)
        for (int v = 0; v < width; ++v) sums[i][v] = load(right + (4 * p + i) * stride + 4 * v);
      for (Index j = std::max(first[p], 4 * begin); j < 4 * p; ++j) {
        Four known[width];
        for (int v = 0; v < width; ++v) known[v] = load(right + j * stride + 4 * v);
        for (int i = 0; i < 4; ++i)
          for (int v = 0; v < width; ++v) sums[i][v] -= mine[4 * j + i] * known[v];
      }
      for (int i = 0; i < 4; ++i)
        for (int v = 0; v < width; ++v) {
          for (int j = 0; j < i; ++j) sums[i][v] -= mine[4 * (4 * p + j) + i] * sums[j][v];
          sums[i][v] *= inverse[4 * p + i];
          store(right + (4 * p + i) * stride + 4 * v, sums[i][v]);
        }
    }
  }
  template <int width>
  void backward_some(double* right, Index stride) const {
    for (Index p = panels() - 1; p >= 0; --p) {
      const double* mine = panel(p);
      Four known[4][width];
      for (int i = 3; i >= 0; --i)
        for (int v = 0; v < width; ++v) {
          known[i][v] = load(right + (4 * p + i) * stride + 4 * v);
          for (int j = i + 1; j < 4; ++j) known[i][v] -= mine[4 * (4 * p + i) + j] * known[j][v];
          known[i][v] *= inverse[4 * p + i];
          store(right + (4 * p + i) * stride + 4 * v, known[i][v]);
        }
      for (Index j = first[p]; j < 4 * p; ++j)
        for (int v = 0; v < width; ++v) {
          Four sum = load(right + j * stride + 4 * v);
          for (int i = 0; i < 4; ++i) sum -= mine[4 * j + i] * known[i][v];
          store(right + j * stride + 4 * v, sum);
        }
    }
  }
};

// A banded matrix that is filled and then factorised.
struct OwnBand {
  Index size = 0;
  Indices first, at;
  Vector entries, inverse;

  // A matrix of zeros whose row i begins at column begins[i].
  explicit OwnBand(const Indices& begins) : size(Index(begins.size())) {
    const Index panels = fours(size) / 4;
    first.assign(panels, 0), at.assign(panels + 1, 0);
    for (Index p = 0; p < panels; ++p) {
      first[p] = *std::min_element(begins.begin() + 4 * p, begins.begin() + std::min(size, 4 * p + 4)) / 4 * 4;
      at[p + 1] = at[p] + 4 * (4 * p + 4 - first[p]);
    }
    entries.assign(at[panels], 0.0), inverse.assign(4 * panels, 1.0);
    for (Index i = size; i < 4 * panels; ++i) entry(i, i) = 1.0;
  }
  double& entry(Index i, Index j) { return entries[at[i / 4] + 4 * (j - first[i / 4]) + i % 4]; }
  Band view() const { return {size, first.data(), at.data(), entries.data(), inverse.data()}; }

  // Factorise in place, a block of four columns after the other; false if the matrix is not positive definite.
  bool factorise() {
    const Band made = view();
    for (Index p = 0; p < made.panels(); ++p) {
      double* mine = entries.data() + at[p] - 4 * first[p];
      for (Index q = first[p] / 4; q <= p; ++q) {
        const double* other = made.panel(q);
        Four block[4], more[4] = {};
        for (int j = 0; j < 4; ++j) block[j] = load(mine + 16 * q + 4 * j);
        for (Index k = std::max(first[p], first[q]); k < 4 * q; k += 2) {  // two columns at a time
          const Four here = load(mine + 4 * k), next = load(mine + 4 * k + 4);
          for (int j = 0; j < 4; ++j) block[j] -= other[4 * k + j] * here, more[j] += other[4 * k + 4 + j] * next;
        }
        for (int j = 0; j < 4; ++j) {
          block[j] -= more[j];
          for (int k = 0; k < j; ++k) block[j] -= (q < p ? other[4 * (4 * q + k) + j] : block[k][j]) * block[k];
          if (q == p) {
            if (!(block[j][j] > 0.0)) return false;
            inverse[4 * q + j] = 1.0 / std::sqrt(block[j][j]);
            for (int i = 0; i < j; ++i) block[j][i] = 0.0;
          }
          block[j] *= inverse[4 * q + j];
        }
        for (int j = 0; j < 4; ++j) store(mine + 16 * q + 4 * j, block[j]);
      }
    }
    return true;
  }
};
