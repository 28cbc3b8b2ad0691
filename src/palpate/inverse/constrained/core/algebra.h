// Linear algebra: that of SciPy, whose functions the caller passes, and a scalar product.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <memory>
#include <vector>

using Index = std::intptr_t;  // numpy.intp
using Vector = std::vector<double>;
using Indices = std::vector<Index>;

// A scalar product in four sums, which the compiler may keep in vectors.
inline double dot(const double* a, const double* b, Index size) {
  double sums[4] = {};
  Index k = 0;
  for (; k + 4 <= size; k += 4)
    for (Index s = 0; s < 4; ++s) sums[s] += a[k + s] * b[k + s];
  for (; k < size; ++k) sums[0] += a[k] * b[k];
  return (sums[0] + sums[1]) + (sums[2] + sums[3]);
}

// The functions of BLAS and LAPACK with integers of 32 bits, in the order of `compiled.FUNCTIONS`.
struct Blas {
  void (*gemv)(const char*, int*, int*, double*, const double*, int*, const double*, int*, double*, double*, int*);
  void (*symv)(const char*, int*, double*, const double*, int*, const double*, int*, double*, double*, int*);
  void (*syrk)(const char*, const char*, int*, int*, double*, const double*, int*, double*, double*, int*);
  void (*trsv)(const char*, const char*, const char*, int*, const double*, int*, double*, int*);
  void (*trsm)(const char*, const char*, const char*, const char*, int*, int*, double*, const double*, int*, double*, int*);
  void (*potrf)(const char*, int*, double*, int*, int*);
};

// The same with values instead of pointers. A matrix of Fortran (rows, columns) has the leading dimension `lead`.
struct Algebra {
  const Blas* blas;

  // y = beta y + alpha A x, or A' x, for vectors whose entries lie so many numbers apart.
  void times(const char* turned, Index rows, Index columns, double alpha, const double* a, Index lead, const double* x, Index apart, double beta,
             double* y, Index apart_y) const {
    int m = int(rows), n = int(columns), ld = int(std::max<Index>(lead, 1)), dx = int(apart), dy = int(apart_y);
    if (m && n) blas->gemv(turned, &m, &n, &alpha, a, &ld, x, &dx, &beta, y, &dy);
  }
  // One triangle of C = beta C + alpha A A', or A' A, for C (size, size).
  void square(const char* triangle, const char* turned, Index size, Index inner, double alpha, const double* a, Index lda, double beta, double* c, Index ldc) const {
    int n = int(size), k = int(inner), la = int(std::max<Index>(lda, 1)), lc = int(ldc);
    if (n) blas->syrk(triangle, turned, &n, &k, &alpha, a, &la, &beta, c, &lc);
  }
  // x = T^-1 x, or T'^-1 x.
  void triangle(const char* kind, const char* turned, Index size, const double* t, Index lead, double* x) const {
    int n = int(size), ld = int(lead), one = 1;
    if (n) blas->trsv(kind, turned, "N", &n, t, &ld, x, &one);
  }
  // B = T^-1 B (side L) or B T^-1 (side R), or with T'.
  void triangles(const char* side, const char* kind, const char* turned, Index rows, Index columns, const double* t, Index ldt, double* b, Index ldb) const {
    int m = int(rows), n = int(columns), lt = int(ldt), lb = int(ldb);
    double one = 1.0;
    if (m && n) blas->trsm(side, kind, turned, "N", &m, &n, &one, t, &lt, b, &lb);
  }
  bool cholesky(const char* triangle, Index size, double* a, Index lead) const {
    int n = int(size), ld = int(std::max<Index>(lead, 1)), wrong = 0;
    if (n) blas->potrf(triangle, &n, a, &ld, &wrong);
    return wrong == 0;
  }
};

